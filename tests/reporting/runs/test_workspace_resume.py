"""``pmopt workspace --resume``: what was cut off goes on to the bytes of a run in one go."""

import random
import shlex
import shutil
import signal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.cli_runner import TIMEOUT, error_line, files_in, here, strict_json, wait_for
from support.killing import checkpoints, kill_and_resume, outputs, start

from pmopt.analysis.sampling.measuring import Course
from pmopt.analysis.sampling.partial_sums import Sums
from pmopt.analysis.sampling.tallies import BLOCK_CHUNKS, CHUNK
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.reporting.runs import run_pictures, workspace_checkpoint, workspace_run
from pmopt.reporting.runs.tasks import WorkspaceTask
from pmopt.reporting.runs.workspace_checkpoint import WorkspaceCheckpoint

MECH = "2pauu-ppap"
BLOCK = BLOCK_CHUNKS * CHUNK  # points of all 16 replicates
LONG = 40 * BLOCK
RUNS = {
    "long": {"samples": LONG},
    "samples": {"samples": 5 * BLOCK + 16},
    "target": {"target_error": 3e-4, "sampler": "monte-carlo"},
    "grid": {"grid": 260},
    "sobol": {"samples": 3 * BLOCK, "sampler": "sobol", "replicates": 16},
}
SHORT = [name for name in RUNS if name != "long"]


def task_of(**settings):
    mechanism = find(MECH)
    return WorkspaceTask(mechanism, mechanism.resolve({}), WorkspaceSettings(**settings), 1, 0)


def resumes_of(folder):
    return strict_json((folder / "manifest.json").read_text())["resumes"]


@pytest.fixture(scope="module", autouse=True)
def nothing_drawn():
    """Pictures take longer than these runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_pictures, "of_workspace", lambda *_: {})
        yield


@pytest.fixture(scope="module")
def in_one_go(tmp_path_factory):
    """Return a function that runs in one go, once, to a folder."""
    made = {}

    def run(name):
        if name not in made:
            made[name] = tmp_path_factory.mktemp(name) / "run"
            workspace_run.run_workspace(task_of(**RUNS[name]), made[name])
        return made[name]

    return run


@pytest.fixture
def every_block(monkeypatch):
    monkeypatch.setattr(workspace_checkpoint, "EVERY", 0.0)


class Stopper:
    """Stands for a kill after some checkpoints: nothing more is written."""

    def __init__(self, monkeypatch, after):
        self.left = after
        keep = WorkspaceCheckpoint.keep

        def stopping(checkpoint, sums):
            keep(checkpoint, sums)
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt

        monkeypatch.setattr(WorkspaceCheckpoint, "keep", stopping)


@pytest.mark.parametrize("after", [1, 2, 3])
@pytest.mark.parametrize("name", SHORT)
def test_cut_off_and_taken_up_again(in_one_go, tmp_path, monkeypatch, every_block, name, after):
    folder, task = tmp_path / "run", task_of(**RUNS[name])
    with monkeypatch.context() as patch:
        Stopper(patch, after)
        with pytest.raises(KeyboardInterrupt):
            workspace_run.run_workspace(task, folder)
    with pytest.raises(InputError, match="interrupted run"):
        workspace_run.run_workspace(task, folder)
    workspace_run.run_workspace(task, folder, resume=True, threads=1)
    assert outputs(folder) == outputs(in_one_go(name))
    (resumed,) = resumes_of(folder)
    assert resumed > 0


def test_begun_on_another_installation(in_one_go, tmp_path, monkeypatch, every_block):
    """What was summed there is kept; a line says so, and the manifest."""
    folder, task = tmp_path / "run", task_of(**RUNS["samples"])
    with monkeypatch.context() as patch:
        Stopper(patch, 2)
        patch.setattr("pmopt.storage.installation.processor", lambda: "Z80")
        patch.setattr("pmopt.storage.installation.__version__", "0.0.1")
        with pytest.raises(KeyboardInterrupt):
            workspace_run.run_workspace(task, folder)
    lines = []
    workspace_run.run_workspace(task, folder, resume=True, notify=lines.append)
    (line,) = lines
    assert line.startswith("resumed with pmopt ")
    assert "begun with 0.0.1; on " in line
    assert ", begun on Z80" in line
    assert strict_json((folder / "manifest.json").read_text())["resume_notes"] == [line]
    assert outputs(folder) == outputs(in_one_go("samples"))


@settings(max_examples=20)
@given(st.sampled_from(SHORT), st.data())
def test_sums_come_back_as_plain_numbers(name, data):
    """From any state on, written and read, the result is the same."""
    kept = STATES.setdefault(name, [])
    task = task_of(**RUNS[name])
    if not kept:
        whole = compute_workspace(task.mechanism, task.parameters, task.settings, shape_grid=0,
                                  course=Course(keep=kept.append))  # fmt: skip
        kept.append(whole)
    *sums, whole = kept
    state = data.draw(st.sampled_from(sums))
    facts, table = state.to_plain()
    again = Sums.from_plain(state.chunks, facts, table)
    assert again.to_plain()[0] == facts
    found = compute_workspace(task.mechanism, task.parameters, task.settings, shape_grid=0,
                              course=Course(again))  # fmt: skip
    assert repr(found) == repr(whole)


STATES = {}


def test_a_short_run_keeps_nothing(tmp_path):
    folder = tmp_path / "run"
    workspace_run.run_workspace(task_of(samples=BLOCK), folder)
    assert not (folder / "checkpoint").exists()
    assert resumes_of(folder) == []


@pytest.mark.parametrize(
    ("first", "then"),
    [
        ({"samples": 2 * BLOCK + 32}, RUNS["samples"]),
        ({"samples": 2 * BLOCK}, RUNS["samples"]),
        ({**RUNS["target"], "target_error": 7e-4}, RUNS["target"]),
    ],
)
def test_more_continues_a_finished_run(in_one_go, tmp_path, every_block, first, then):
    folder = tmp_path / "run"
    workspace_run.run_workspace(task_of(**first), folder)
    kept = max(int(p.stem[6:]) for p in folder.glob("checkpoint/chunk-*"))
    workspace_run.run_workspace(task_of(**then), folder, resume=True)
    name = "target" if "target_error" in then else "samples"
    assert outputs(folder) == outputs(in_one_go(name))
    assert resumes_of(folder) == [kept]
    assert kept % BLOCK_CHUNKS == 0  # where a run ends within a block, a longer one does not


def test_more_after_a_short_run_starts_afresh(in_one_go, tmp_path):
    folder = tmp_path / "run"
    workspace_run.run_workspace(task_of(samples=1600), folder)
    workspace_run.run_workspace(task_of(**RUNS["samples"]), folder, resume=True)
    assert outputs(folder) == outputs(in_one_go("samples"))


CHANGES = [
    (("--samples", BLOCK), f"workspace.samples: {2 * BLOCK} -> {BLOCK}"),
    (("--samples", 2 * BLOCK + 2), "workspace.replicates: 16 -> 10"),
    (("--samples", 2 * BLOCK, "--seed", 2), "seed: 1 -> 2"),
    (("--samples", 2 * BLOCK, "--params", "l1=0.7"), "parameters.l1: 0.65 -> 0.7"),
    (("--samples", 2 * BLOCK, "--sampler", "sobol"), "workspace.sampler: r-sequence -> sobol"),
    (("--grid", 100), "workspace.grid: None -> 100"),
    (("--target-error", 1e-2), "workspace.target_error: None -> 0.01"),
]


@pytest.mark.parametrize(("options", "named"), CHANGES, ids=[n for _, n in CHANGES])
@pytest.mark.parametrize("state", ["finished", "cut off"])
def test_a_changed_command_is_refused(long, tmp_path, options, named, state):
    shutil.copytree(long, tmp_path / "run")
    if state == "cut off":
        (tmp_path / "run" / "manifest.json").unlink()
    before = {n: (tmp_path / "run" / n).read_bytes() for n in files_in(tmp_path / "run")}
    words = ("workspace", MECH, "--shape-grid", 0, "--out", "run", "--resume", *options)
    assert named in error_line(here(*words, cwd=tmp_path))
    assert before == {n: (tmp_path / "run" / n).read_bytes() for n in files_in(tmp_path / "run")}


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Return the folder of a finished run of two blocks with its checkpoints."""
    folder = tmp_path_factory.mktemp("long") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workspace_checkpoint, "EVERY", 0.0)
        workspace_run.run_workspace(task_of(samples=2 * BLOCK), folder)
    return folder


LINE = ("workspace", MECH, "--shape-grid", 0, "--samples", 2 * BLOCK, "--out", "run")


def test_a_finished_run_has_nothing_to_do(long, tmp_path):
    shutil.copytree(long, tmp_path / "run")
    result = here(*LINE, "--resume", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (0, "")
    assert result.stderr.count("\n") == 1
    assert "nothing to do" in result.stderr


def test_a_folder_of_another_command_is_kept(long, tmp_path):
    shutil.copytree(long, tmp_path / "run")
    (tmp_path / "test.toml").write_text(f'mechanism = "{MECH}"')
    for _ in ("finished", "cut off"):
        result = here("pareto", "test.toml", "--out", "run", "--resume", cwd=tmp_path)
        assert "workspace run, not pareto" in error_line(result)
        (tmp_path / "run" / "manifest.json").unlink(missing_ok=True)


@pytest.mark.parametrize("option", ["--certify", "--force", "no --out"])
def test_resume_needs_what_it_resumes(tmp_path, option):
    words = {
        "--certify": (*LINE, "--certify", 0.1), "--force": (*LINE, "--force"),
        "no --out": LINE[:-2],
    }[option]  # fmt: skip
    if option == "--certify":
        words = [w for w in words if w not in ("--samples", 2 * BLOCK, "--shape-grid", 0)]
    assert "--resume" in error_line(here(*words, "--resume", cwd=tmp_path))
    assert files_in(tmp_path) == []


def newest(folder):
    return sorted(folder.glob("checkpoint/chunk-*.bin"))[-1]


def cut_short(path):
    path.write_bytes(path.read_bytes()[:-9])


def flip(path):
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 4
    path.write_bytes(bytes(raw))


def flip_the_head(path):
    raw = bytearray(path.read_bytes())
    raw[100] ^= 1
    path.write_bytes(bytes(raw))


def empty(path):
    path.write_bytes(b"")


def take_another(path):
    other = path.parents[2] / "other"
    task = task_of(samples=2 * BLOCK, min_lci=0.2)
    workspace_run.run_workspace(task, other)
    shutil.copy(newest(other), path)


@pytest.mark.parametrize("damage", [cut_short, flip, flip_the_head, empty, take_another])
def test_what_is_torn_or_foreign_is_refused(long, tmp_path, every_block, damage):
    """One line says so, and the one before is used."""
    folder = tmp_path / "run"
    shutil.copytree(long, folder)
    (folder / "manifest.json").unlink()
    path = newest(folder)
    damage(path)
    result = here(*LINE, "--resume", cwd=tmp_path)
    assert result.returncode == 0
    line, last = result.stderr.splitlines()
    assert path.name in line
    assert "not used" in line
    assert last == "written to run"
    assert outputs(folder) == outputs(long)
    assert resumes_of(folder) == [BLOCK_CHUNKS]


COMMAND = (*LINE[:4], "--samples", LONG)


@pytest.mark.slow
def test_killed_at_random_moments(in_one_go, tmp_path):
    """Kills while it starts, sums, writes a checkpoint, and writes its files."""
    last = f"chunk-{LONG // CHUNK:07d}.bin"
    met = kill_and_resume(COMMAND, tmp_path / "run", random.Random(5), last)
    assert met.kills >= 5
    assert outputs(tmp_path / "run") == outputs(in_one_go("long"))
    assert not list(tmp_path.rglob("*.pmopt-tmp"))
    assert len(resumes_of(tmp_path / "run")) <= met.kills


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted(in_one_go, tmp_path, number):
    folder = tmp_path / "a run"
    process = start(COMMAND, folder)
    wait_for(lambda: checkpoints(folder), process)
    process.send_signal(number)
    output, errors = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, output) == (130, "")
    said, _, line = errors.strip().partition("; continue with: ")
    assert said == "error: interrupted"
    assert {n.split("-")[0] for n in files_in(folder)} == {
        "checkpoint/chunk",
        "checkpoint/run.json",
    }
    words = shlex.split(line)
    assert words[0] == "pmopt"
    assert here(*words[1:], cwd=tmp_path).returncode == 0  # what it says is what works
    assert outputs(folder) == outputs(in_one_go("long"))
