"""A whole ``pmopt pareto`` run: search, files, checkpoints, interruption, front."""

import hashlib
import itertools
import json
import math
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import moocore
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.cli_runner import (
    COMMAND,
    TIMEOUT,
    answer,
    csv_rows,
    environment,
    error_line,
    files_in,
    here,
    json_answer,
    pmopt,
    strict_json,
)
from support.killing import kill_and_resume

import pmopt as package
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.errors import InfeasibleError, InputError
from pmopt.reporting.runs.pareto_run import finished as pareto_finished
from pmopt.reporting.runs.pareto_run import run_pareto
from pmopt.storage.installation import versions
from pmopt.synthesis import optimise
from pmopt.synthesis.checkpoint import Checkpoint
from pmopt.synthesis.config import resolve_config
from pmopt.synthesis.front import idle_directions
from pmopt.synthesis.optimise import Optimisation, hypervolume, spread
from pmopt.synthesis.problem import DesignProblem
from pmopt.synthesis.search import Search

MECH = "2pauu-ppap"
POPULATION, GENERATIONS, LONG = 20, 6, 60
SMALL = ("--samples", "1000", "--shape-grid", "0")
TABLES = ["front.csv", "regions.csv", "history.csv", "evaluations.csv"]
PICTURES = ["front.png", "history.png"]
MARGIN = 5  # standard errors; by chance once in a million

TEXT = """\
mechanism = "2pauu-ppap"
objectives = ["volume", "gci"]
[parameters]
m = [0.5, 1.5]
n = 0.7
l1 = [0.5, 1.5]
l2 = [0.5, 1.5]
c = 0.1
[workspace]
samples = 2000
[algorithm]
population = 20
generations = 6
seed = 1
[constraints]
[final]
target_error = 1e-2
"""


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile the kernels, or a first process says on stderr that it does."""
    package.workspace(MECH, samples=1000, shape_grid=8)


NO_FRONT = np.empty((0, 5))


def text_of(**changes):
    """Return the configuration with keys changed, wherever they stand."""
    text = TEXT
    for key, value in changes.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        if not count:  # a new key of the table that is named with it
            table, name = key.split("__")
            text = text.replace(f"[{table}]\n", f"[{table}]\n{name} = {value}\n")
    return text


def config_of(**changes):
    return resolve_config(tomllib.loads(text_of(**changes)), "test.toml")


def read(folder, names=(*TABLES, *PICTURES)):
    return {name: (folder / name).read_bytes() for name in names}


def table(folder, name):
    return csv_rows((folder / f"{name}.csv").read_text(encoding="utf-8"))


def column(rows, name):
    return np.array([float(row[name]) for row in rows])


def manifest_of(folder):
    return strict_json((folder / "manifest.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Return the folder of a finished run and what it returned."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    return folder, run_pareto(config_of(), folder)


@pytest.fixture(scope="module")
def long_run(tmp_path_factory):
    """Return the folder of a run long enough to be hit in the middle."""
    folder = tmp_path_factory.mktemp("long") / "run"
    run_pareto(config_of(generations=LONG), folder)
    return folder


@pytest.fixture
def cut_off(finished, tmp_path):
    """Return a copy of the run as if it had been cut off before its tables were written."""
    folder = tmp_path / "run"
    shutil.copytree(finished[0], folder)
    for name in ("manifest.json", *TABLES, *PICTURES):
        (folder / name).unlink()
    return folder


# --- files --------------------------------------------------------------------------------


def test_files_and_manifest(finished):
    folder, _ = finished
    written = [name for name in files_in(folder) if not name.startswith("checkpoint/")]
    assert written == sorted(["manifest.json", *TABLES, *PICTURES])
    manifest = manifest_of(folder)
    assert (manifest["command"], manifest["mechanism"], manifest["seed"]) == ("pareto", MECH, 1)
    assert manifest["config"]["algorithm"]["population"] == POPULATION
    assert manifest["config"]["parameters"] == {
        "m": [0.5, 1.5], "n": 0.7, "l1": [0.5, 1.5], "l2": [0.5, 1.5], "c": 0.1, "h": None,
    }  # fmt: skip
    assert {"pmopt", "python", "numpy", "numba", "pymoo", "moocore"} <= set(manifest["versions"])
    assert {"git_commit", "platform"} <= set(manifest)
    assert manifest["wall_time"] > 0
    assert manifest["cpu_time"] > 0
    assert manifest["resumes"] == []
    assert manifest["units"]["volume"] == manifest["units"]["hypervolume"] == "m^3"
    assert sorted(manifest["outputs"]) == sorted([*TABLES, *PICTURES])
    for name, digest in manifest["outputs"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_front(finished):
    folder, run = finished
    rows = table(folder, "front")
    assert list(rows[0]) == [
        "design", "m", "n", "l1", "l2", "c", "volume", "volume_error", "gci", "gci_error",
    ]  # fmt: skip
    assert [row["design"] for row in rows] == [str(i) for i in range(1, len(rows) + 1)]
    assert len(rows) == len(run.front.designs) > 2
    volume, gci = column(rows, "volume"), column(rows, "gci")
    assert np.all(np.diff(volume) > 0)
    assert np.all(np.diff(gci) < 0)  # with both sorted, no design dominates another
    for name in ("volume", "gci"):
        assert np.all(column(rows, f"{name}_error") > 0)
        assert np.all(column(rows, f"{name}_error") <= 1e-2 * column(rows, name))
    for name, low, high in (("m", 0.5, 1.5), ("l1", 0.5, 1.5), ("l2", 0.5, 1.5)):
        assert np.all((column(rows, name) >= low) & (column(rows, name) <= high))
    assert {row["n"] for row in rows} == {"0.7"}
    # Every design of the front was met in the search.
    met = {(r["m"], r["l1"], r["l2"]) for r in table(folder, "evaluations")}
    assert {(r["m"], r["l1"], r["l2"]) for r in rows} <= met


def test_front_is_what_another_sample_measures(finished):
    rows = table(finished[0], "front")
    for row in (rows[0], rows[len(rows) // 2], rows[-1]):
        params = {name: float(row[name]) for name in ("m", "n", "l1", "l2", "c")}
        found = package.workspace(MECH, params, seed=99, samples=2_000_000, shape_grid=0)
        for name, estimate in (("volume", found.volume), ("gci", found.gci)):
            allowed = MARGIN * math.hypot(float(row[f"{name}_error"]), estimate.error)
            assert abs(float(row[name]) - estimate.value) < allowed


def test_designs_that_the_finer_measurement_finds_dominated_are_dropped():
    """With 64 samples the search takes noise for progress."""
    config = config_of(samples=64)
    search = Optimisation(DesignProblem(config))
    for _ in search.generations():
        pass
    front = run_pareto(config).front
    assert front.dropped == len(search.front_variables) - len(front.designs) > 0
    values = np.array([[d.objectives["volume"], d.objectives["gci"]] for d in front.designs])
    assert len(naive_front(values)) == len(values)


def test_regions(finished):
    front, regions = table(finished[0], "front"), table(finished[0], "regions")
    assert list(regions[0])[:5] == ["design", "lower", "upper", "volume", "share"]
    assert len(regions) == 3 * len(front)
    for row in front:
        own = [r for r in regions if r["design"] == row["design"]]
        edges = [(float(r["lower"]), float(r["upper"])) for r in own]
        assert edges == [(0.0, 0.1), (0.1, 0.3), (0.3, 1.0)]
        # Counts over one total: only divisions and this sum round.
        assert column(own, "share").sum() == pytest.approx(1, abs=1e-14)
        assert column(own, "volume").sum() == pytest.approx(float(row["volume"]), rel=1e-14)


def test_evaluations(finished):
    rows = table(finished[0], "evaluations")
    assert list(rows[0])[:8] == [
        "generation", "m", "l1", "l2", "volume", "gci", "volume_error", "gci_error",
    ]  # fmt: skip
    assert len(rows) == POPULATION * GENERATIONS
    generations = [int(row["generation"]) for row in rows]
    assert generations == sorted(list(range(1, GENERATIONS + 1)) * POPULATION)
    assert len({(r["m"], r["l1"], r["l2"]) for r in rows}) == len(rows)
    assert {row["feasible"] for row in rows} == {"1"}


def test_history(finished):
    history, rows = table(finished[0], "history"), table(finished[0], "evaluations")
    assert list(history[0]) == [
        "generation", "evaluations", "feasible", "hypervolume", "volume_best", "gci_best",
    ]  # fmt: skip
    assert [int(r["generation"]) for r in history] == list(range(1, GENERATIONS + 1))
    for line in history:
        known = [r for r in rows if int(r["generation"]) <= int(line["generation"])]
        assert int(line["evaluations"]) == len(known)
        assert int(line["feasible"]) == sum(r["feasible"] == "1" for r in known)
        values = np.array([(float(r["volume"]), float(r["gci"])) for r in known])
        # As long as the front fits into the population nothing of it is lost.
        assert len(naive_front(values)) <= POPULATION
        assert float(line["hypervolume"]) == pytest.approx(naive_hypervolume(values), rel=1e-12)
        assert [float(line[k]) for k in ("volume_best", "gci_best")] == values.max(axis=0).tolist()


def test_json_and_table(finished, tmp_path):
    (tmp_path / "test.toml").write_text(text_of())
    result = pmopt("pareto", "test.toml", "--out", "run", "--format", "json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    document = strict_json(result.stdout)
    assert {
        "out", "designs", "hypervolume", "reference_point", "knee", "ends", "units",
    } <= set(document)  # fmt: skip
    rows = table(tmp_path / "run", "front")
    assert document["out"] == "run"
    assert document["designs"] == len(rows)
    assert document["reference_point"] == {"volume": 0.0, "gci": 0.0}
    assert document["knee"]["params"]["h"] is None
    assert [end["design"] for end in document["ends"]] == [1, len(rows)]
    for end, row in zip(document["ends"], (rows[0], rows[-1]), strict=True):
        assert (end["volume"], end["gci"]) == (float(row["volume"]), float(row["gci"]))
        assert end["params"]["m"] == float(row["m"])
    # A process writes the bytes a call wrote; progress has gone to stderr, a line at a time.
    assert read(tmp_path / "run") == read(finished[0])
    lines = result.stderr.splitlines()
    assert sum("hypervolume" in line and "ETA" in line for line in lines) == GENERATIONS
    assert "\r" not in result.stderr
    assert "\x1b" not in result.stderr


def test_nothing_is_written_without_a_folder(tmp_path, monkeypatch, finished):
    monkeypatch.chdir(tmp_path)
    run = package.pareto(tomllib.loads(text_of()))
    assert files_in(tmp_path) == []
    assert run.to_dict() == {**finished[1].to_dict(), "out": None}


def test_default_folder(tmp_path):
    (tmp_path / "test.toml").write_text(text_of(generations=2))
    command = ("pareto", "test.toml", "--quiet")
    one, two = (json_answer(*command, cwd=tmp_path)["out"] for _ in range(2))
    assert one != two
    for out in (one, two):
        assert re.fullmatch(rf"outputs/pareto-{MECH}-\d{{8}}-\d{{6}}(-2)?", out)
        assert (tmp_path / out / "manifest.json").is_file()


def test_quiet(tmp_path):
    (tmp_path / "test.toml").write_text(text_of(generations=2))
    result = here("pareto", "test.toml", "--out", "run", "--quiet", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "knee" in result.stdout


# --- the same bytes -----------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_the_same_bytes_for_any_number_of_threads(finished, tmp_path, threads):
    run_pareto(config_of(), tmp_path / "run", threads=threads)
    assert read(tmp_path / "run") == read(finished[0])


def test_another_seed_gives_other_designs(finished, tmp_path):
    (tmp_path / "test.toml").write_text(text_of())
    answer("pareto", "test.toml", "--out", "run", "--seed", "2", cwd=tmp_path)
    assert manifest_of(tmp_path / "run")["seed"] == 2
    assert read(tmp_path / "run", TABLES)["front.csv"] != read(finished[0])["front.csv"]
    run_pareto(config_of(seed=2), tmp_path / "config")
    assert read(tmp_path / "config") == read(tmp_path / "run")


# --- resuming -----------------------------------------------------------------------------


def start(folder, *options, generations=LONG):
    """Start a long run as a process beside its folder."""
    (folder.parent / "test.toml").write_text(text_of(generations=generations))
    return subprocess.Popen(
        [*COMMAND, "pareto", "test.toml", "--out", folder.name, "--quiet", *options],
        cwd=folder.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(),
    )  # fmt: skip


def wait_for_generation(process, folder, number):
    """Wait until a generation is on disk."""
    path = folder / "checkpoint" / f"generation-{number:07d}.bin"
    deadline = time.monotonic() + TIMEOUT
    while not path.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    assert path.exists(), process.communicate()[1]


@pytest.mark.slow
def test_killed_at_random_moments(long_run, tmp_path):
    """Kills while it starts, searches, writes a checkpoint, measures, and writes its files."""
    folder = tmp_path / "run"
    (tmp_path / "test.toml").write_text(text_of(generations=LONG))
    last = generation(folder, LONG).name
    met = kill_and_resume(("pareto", "test.toml"), folder, random.Random(3), last)
    assert met.kills >= 12
    assert min(met.torn, met.after) >= 1
    assert read(folder) == read(long_run)
    assert not list(folder.rglob("*.pmopt-tmp"))
    resumes = manifest_of(folder)["resumes"]
    # A process that is killed before it has looked into the folder takes nothing up.
    assert len(resumes) <= met.kills
    assert resumes == sorted(resumes)
    assert resumes[-1] == LONG


@pytest.mark.parametrize(
    ("number", "name", "seed"),
    [(signal.SIGINT, "run", ()), (signal.SIGTERM, "a run", ("--seed", 1))],
)
def test_interrupted_and_taken_up_again(long_run, tmp_path, number, name, seed):
    folder = tmp_path / name
    process = start(folder, *map(str, seed))
    wait_for_generation(process, folder, 5)
    process.send_signal(number)
    output, errors = process.communicate(timeout=20)  # some seconds, on a slow machine
    assert (process.returncode, output) == (130, "")
    (line,) = [line for line in errors.splitlines() if line.strip()]
    words = ["pmopt", "pareto", "test.toml", "--out", name, "--resume", *seed]
    assert line == f"error: interrupted; continue with: {shlex.join(map(str, words))}"
    left = files_in(folder)
    assert all(re.fullmatch(r"checkpoint/(run\.json|generation-\d{7}\.bin)", f) for f in left)
    assert len(left) >= 6
    # What it says is what works.
    assert here(*words[1:], "--quiet", cwd=tmp_path).returncode == 0
    assert read(folder) == read(long_run)
    assert manifest_of(folder)["resumes"] == [len(left) - 1]


def catches_sigterm(process):
    """Return whether a process has its own answer to SIGTERM, as the kernel reports."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    caught = int(re.search(r"SigCgt:\s*([0-9a-f]+)", status).group(1), 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_interrupted_while_it_starts(tmp_path):
    """Between the first import and the first generations nothing takes the signal away."""
    chance = random.Random(1)

    def interrupted(number):
        folder = tmp_path / str(number) / "run"
        folder.parent.mkdir()
        # As a whole it takes longer than the second after which a lost interruption comes again.
        process = start(folder, generations=20 * LONG)
        while not catches_sigterm(process):
            time.sleep(0.002)
        time.sleep(chance.uniform(0, 0.8))
        process.send_signal((signal.SIGINT, signal.SIGTERM)[number % 2])
        errors = process.communicate(timeout=TIMEOUT)[1]
        return process.returncode, [line for line in errors.splitlines() if line.strip()]

    with ThreadPoolExecutor(2) as pool:
        for code, lines in pool.map(interrupted, range(16)):
            assert code == 130, lines
            assert len(lines) == 1
            assert lines[0].startswith("error: interrupted")


def test_resume_of_a_finished_run_does_nothing(finished, tmp_path):
    shutil.copytree(finished[0], tmp_path / "run")
    (tmp_path / "test.toml").write_text(text_of())
    stamps = {f: (tmp_path / "run" / f).stat().st_mtime_ns for f in files_in(tmp_path / "run")}
    result = here("pareto", "test.toml", "--out", "run", "--resume", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (0, "")
    assert result.stderr.count("\n") == 1
    assert "finished" in result.stderr
    assert stamps == {
        f: (tmp_path / "run" / f).stat().st_mtime_ns for f in files_in(tmp_path / "run")
    }


def test_resume_where_there_is_nothing_starts_afresh(finished, tmp_path):
    run_pareto(config_of(), tmp_path / "run", resume=True)
    assert read(tmp_path / "run") == read(finished[0])
    assert manifest_of(tmp_path / "run")["resumes"] == []


CHANGES = [
    ({"seed": 2}, "algorithm.seed: 1 -> 2"),
    ({"population": 16}, "algorithm.population: 20 -> 16"),
    ({"generations": 4}, "algorithm.generations: 6 -> 4"),
    ({"samples": 3000}, "workspace.samples: 2000 -> 3000"),
    ({"workspace__min_lci": 0.1}, "workspace.min_lci: 0.0 -> 0.1"),
    ({"l1": "[0.5, 1.4]"}, "parameters.l1: [0.5, 1.5] -> [0.5, 1.4]"),
    ({"n": 0.8}, "parameters.n: 0.7 -> 0.8"),
    ({"target_error": "5e-3"}, "final.target_error: 0.01 -> 0.005"),
    ({"constraints__gci": "{min = 0.1}"}, "constraints.gci"),
    ({"objectives": '["gci", "volume"]'}, "objectives"),
]


@pytest.mark.parametrize(("change", "named"), CHANGES, ids=[n for _, n in CHANGES])
@pytest.mark.parametrize("state", ["finished", "cut off"])
def test_resume_with_a_changed_configuration_is_refused(finished, cut_off, state, change, named):
    folder = cut_off if state == "cut off" else finished[0]
    before = {name: (folder / name).read_bytes() for name in files_in(folder)}
    with pytest.raises(InputError) as caught:
        run_pareto(config_of(**change), folder, resume=True)
    assert named in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    assert before == {name: (folder / name).read_bytes() for name in files_in(folder)}


def test_resume_with_a_changed_configuration_of_a_process(cut_off, tmp_path):
    (tmp_path / "test.toml").write_text(text_of(seed=2))
    result = pmopt("pareto", "test.toml", "--out", cut_off, "--resume", cwd=tmp_path)
    assert "algorithm.seed: 1 -> 2" in error_line(result)


def test_resume_never_overwrites_another_finished_run(finished, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(finished[0], folder)
    shutil.rmtree(folder / "checkpoint")
    with pytest.raises(InputError):
        run_pareto(config_of(seed=2), folder, resume=True)
    assert read(folder) == read(finished[0])


@pytest.mark.parametrize("state", ["finished", "cut off"])
def test_more_generations_continue_a_run(finished, cut_off, tmp_path, state):
    more = config_of(generations=GENERATIONS + 3)
    run_pareto(more, tmp_path / "in one go")
    folder = cut_off
    if state == "finished":
        shutil.rmtree(folder)
        shutil.copytree(finished[0], folder)
    seen = []
    run_pareto(more, folder, resume=True, on_generation=seen.append)
    assert [g.recorded for g in seen] == [True] * GENERATIONS + [False] * 3
    assert read(folder) == read(tmp_path / "in one go")
    assert manifest_of(folder)["resumes"] == [GENERATIONS]


def generation(folder, number):
    return folder / "checkpoint" / f"generation-{number:07d}.bin"


def tear(path):
    path.write_bytes(path.read_bytes()[:-20])


def tear_the_header(path):
    path.write_bytes(path.read_bytes()[:30])


def empty(path):
    path.write_bytes(b"")


def flip_a_bit(path):
    raw = bytearray(path.read_bytes())
    raw[-100] ^= 1
    path.write_bytes(bytes(raw))


def take_the_next(path):
    shutil.copy(generation(path.parent.parent, 4), path)


def take_junk(path):
    path.write_bytes(b'{"key": 1, "shape": "x"}\n\x00')


@pytest.mark.parametrize(
    "damage",
    [
        tear,
        tear_the_header,
        empty,
        flip_a_bit,
        take_the_next,
        take_junk,
        lambda path: path.unlink(),
    ],
)
def test_damaged_generation_falls_back_to_the_earlier_ones(finished, cut_off, damage):
    damage(generation(cut_off, 3))
    run_pareto(config_of(), cut_off, resume=True)
    assert manifest_of(cut_off)["resumes"] == [2]
    assert read(cut_off) == read(finished[0])


def test_generation_of_another_run_is_not_taken(finished, cut_off, tmp_path):
    run_pareto(config_of(seed=2), tmp_path / "other")
    shutil.copy(generation(tmp_path / "other", 4), generation(cut_off, 4))
    run_pareto(config_of(), cut_off, resume=True)
    assert manifest_of(cut_off)["resumes"] == [3]
    assert read(cut_off) == read(finished[0])


def test_resumes_add_up(cut_off):
    generation(cut_off, 5).unlink()
    with pytest.raises(KeyboardInterrupt):
        run_pareto(config_of(), cut_off, resume=True, on_measured=interrupt)
    tear(generation(cut_off, 2))
    run_pareto(config_of(), cut_off, resume=True)
    assert manifest_of(cut_off)["resumes"] == [4, 1]


def interrupt(*_):
    raise KeyboardInterrupt


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": 1}', "\x00"])
def test_damaged_run_file_is_refused(cut_off, text):
    (cut_off / "checkpoint" / "run.json").write_text(text)
    with pytest.raises(InputError, match=r"run\.json.*--force"):
        run_pareto(config_of(), cut_off, resume=True)


@pytest.mark.parametrize("stored", ["[]", "{}"])
def test_run_file_with_a_damaged_configuration(cut_off, stored):
    path = cut_off / "checkpoint" / "run.json"
    document = strict_json(path.read_text())
    kept = f'"schema": {document["schema"]}, "notes": [], "resumes": []'
    path.write_text(f'{{{kept}, "config": {stored}}}')
    with pytest.raises(InputError):
        run_pareto(config_of(), cut_off, resume=True)


def begun_with(folder, **versions):
    """Have the record of a run say that it was begun with other versions."""
    path = folder / "checkpoint" / "run.json"
    document = strict_json(path.read_text())
    document["installation"]["versions"] |= versions
    path.write_text(json.dumps(document))


def test_run_of_other_versions_goes_on(cut_off, finished):
    begun_with(cut_off, pymoo="0.1.2", pmopt="0.0.0")
    lines = []
    run_pareto(config_of(), cut_off, resume=True, notify=lines.append)
    now = versions()
    assert lines[0] == (
        f"resumed with pmopt {now['pmopt']}, begun with 0.0.0; with pymoo {now['pymoo']}, "
        "begun with 0.1.2: what is recorded is kept as it is"
    )
    assert manifest_of(cut_off)["resume_notes"] == lines[:1]
    assert read(cut_off) == read(finished[0])


def test_run_of_another_processor_goes_on(cut_off, monkeypatch):
    """What is said once is not said of the same installation again."""
    monkeypatch.setattr("pmopt.storage.installation.processor", lambda: "Pentium")
    for expected in (1, 1):
        lines = []
        run_pareto(config_of(generations=GENERATIONS + 1), cut_off, resume=True, force=False,
                   notify=lines.append)  # fmt: skip
        notes = manifest_of(cut_off)["resume_notes"]
        assert len(notes) == expected
        assert notes[0].startswith("resumed on Pentium, begun on ")
        (cut_off / "manifest.json").unlink()


def test_another_form_of_checkpoint_is_refused(cut_off):
    path = cut_off / "checkpoint" / "run.json"
    path.write_text(re.sub('"schema": [0-9]*', '"schema": 4', path.read_text()))
    with pytest.raises(InputError, match=r"form 4 by pmopt \S+, this one .*finish .*--force"):
        run_pareto(config_of(), cut_off, resume=True)


def test_a_record_that_differs_in_last_digits_is_the_truth(cut_off, finished):
    """Of another processor, or other operators: the search goes on from what is recorded."""
    problem = DesignProblem(config_of())
    checkpoint = Checkpoint(cut_off, problem)
    recorded = checkpoint.resume()
    changed = recorded[1]
    moved = changed.evaluated.variables.copy()
    moved[::2] = np.nextafter(moved[::2], 0.0)
    evaluated = replace(changed.evaluated, variables=moved)
    checkpoint.save(2, replace(changed, evaluated=evaluated))
    checkpoint.flush()
    lines = []
    run_pareto(config_of(), cut_off, resume=True, notify=lines.append)
    assert "from generation 2 on" in lines[0]
    assert manifest_of(cut_off)["resume_notes"] == lines[:1]
    rows = table(cut_off, "evaluations")
    assert len(rows) == len(table(finished[0], "evaluations"))
    found = np.array([[float(row[k]) for k in problem.variables] for row in rows])
    first = len(recorded[0].evaluated)
    assert (found[first : first + len(moved)] == moved).all()
    assert rows != table(finished[0], "evaluations")


# --- adaptive samples ---------------------------------------------------------------------

ADAPTIVE = {"samples": '"adaptive"', "generations": 40, "target_error": "2e-3"}
#: Short runs are to double their samples: their hypervolume has stalled sooner.
EAGER = 1.0
PROCESS = f"""
import tomllib
from pathlib import Path
from pmopt.reporting.runs.pareto_run import run_pareto
from pmopt.synthesis import optimise
from pmopt.synthesis.config import resolve_config
optimise._DISTINGUISHED = {EAGER}
data = tomllib.loads(Path("test.toml").read_text())
run_pareto(resolve_config(data, "test.toml"), Path("run"), resume=True)
"""


@pytest.fixture
def eager(monkeypatch):
    monkeypatch.setattr(optimise, "_DISTINGUISHED", EAGER)


@pytest.fixture(scope="module")
def adaptive(tmp_path_factory):
    """Return the folder of a finished adaptive run, in which the samples doubled, and the run."""
    folder = tmp_path_factory.mktemp("adaptive") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optimise, "_DISTINGUISHED", EAGER)
        return folder, run_pareto(config_of(**ADAPTIVE), folder)


def test_samples_of_an_adaptive_run(adaptive):
    history = table(adaptive[0], "history")
    samples, spent = (column(history, name) for name in ("samples", "spent"))
    assert set(samples[1:] / samples[:-1]) == {1.0, 2.0}
    # What is taken beyond the generation's designs measures some again on twice the samples.
    again = (spent - POPULATION * samples) / (2 * samples)
    doubled = np.flatnonzero(again)
    assert len(doubled) >= 2
    assert (again[doubled] >= POPULATION).all()
    assert (again[doubled] == again[doubled].astype(int)).all()
    assert (np.flatnonzero(np.diff(samples)) == doubled[: len(np.unique(samples)) - 1]).all()
    assert column(history, "evaluations").tolist() == [
        POPULATION * g for g in range(1, len(history) + 1)
    ]
    rows = table(adaptive[0], "evaluations")
    assert list(rows[0])[:2] == ["generation", "samples"]
    assert column(rows, "samples").tolist() == np.repeat(samples, POPULATION).tolist()
    manifest = manifest_of(adaptive[0])
    assert manifest["config"]["workspace"]["samples"] == "adaptive"
    assert manifest["samples"]["first"] == samples[0]
    assert manifest["samples"]["last"] == samples[-1]
    assert manifest["samples"]["spent"] == spent.sum()


def test_all_that_is_compared_has_the_same_samples(monkeypatch, eager):
    """Selection receives of a design what that many samples say, never fewer."""
    problem = DesignProblem(config_of(**ADAPTIVE))
    seen = []
    for name in ("tell", "replace"):
        method = getattr(Search, name)

        def spy(self, *given, method=method):
            rows = method(self, *given)
            seen.append(self.algorithm.pop.get("X", "F"))
            return rows

        monkeypatch.setattr(Search, name, spy)
    current = problem.first_samples
    for generation in Optimisation(problem).generations():
        assert generation.samples == current
        current *= 1 if generation.record.again is None else 2
        if generation.record.again is not None or generation.number % 10 == 0:
            variables, objectives = seen[-1]
            assert (problem.evaluate(variables, current).values == -objectives).all()
    assert current >= 4 * problem.first_samples


def test_fewer_samples_are_among_more():
    """Common random numbers: twice the samples keep the points of the first half."""
    problem = DesignProblem(config_of(samples='"adaptive"'))
    variables = designs_of(problem, 5)
    volumes = []
    for samples in (4096, 8192):
        found = problem.evaluate(variables, samples).values[:, 0]
        boxes = np.array([problem.design(row).box_volume for row in variables])
        volumes.append(np.round(found / boxes * samples))
    assert (volumes[1] >= volumes[0]).all()
    assert (volumes[1] - volumes[0] <= 4096).all()


def test_front_of_an_adaptive_run_holds_on_another_sample(adaptive):
    """No design stands on the front that finer sampling finds dominated beyond the errors."""
    rows = table(adaptive[0], "front")
    assert len(rows) > 10
    problem = DesignProblem(config_of(samples=1 << 19, seed=99))
    fine = problem.evaluate(np.array([[float(r[k]) for k in problem.variables] for r in rows]))
    stated = np.array([[float(r[f"{k}_error"]) for k in problem.objectives] for r in rows])
    errors = np.hypot(stated, fine.errors)
    for value, error in zip(fine.values, errors, strict=True):
        lead = (fine.values - value) / np.hypot(errors, error)
        assert not (lead > MARGIN).all(axis=1).any()


@pytest.mark.parametrize("threads", [1, 3])
def test_adaptive_run_is_the_same_for_any_number_of_threads(adaptive, eager, tmp_path, threads):
    run_pareto(config_of(**ADAPTIVE), tmp_path / "run", threads=threads)
    assert read(tmp_path / "run") == read(adaptive[0])


@pytest.mark.parametrize("after", [0, 1, -1])
def test_adaptive_run_is_taken_up_again_to_the_same_bytes(adaptive, eager, tmp_path, after):
    """Cut off before, at and after a generation behind which designs were measured again."""
    folder = tmp_path / "run"
    shutil.copytree(adaptive[0], folder)
    for name in ("manifest.json", *TABLES, *PICTURES):
        (folder / name).unlink()
    history = table(adaptive[0], "history")
    samples = column(history, "samples")
    last = int(np.flatnonzero(np.diff(samples))[1]) + 1 + after
    for number in range(last + 1, len(history) + 1):
        generation(folder, number).unlink()
    run_pareto(config_of(**ADAPTIVE), folder, resume=True)
    assert manifest_of(folder)["resumes"] == [last]
    assert read(folder) == read(adaptive[0])


def test_adaptive_run_killed(adaptive, eager, tmp_path):
    (tmp_path / "test.toml").write_text(text_of(**ADAPTIVE))
    for number in (8, 25):
        process = subprocess.Popen(
            [sys.executable, "-c", PROCESS], cwd=tmp_path, env=environment(), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip
        wait_for_generation(process, tmp_path / "run", number)
        process.kill()
        process.communicate(timeout=TIMEOUT)
    run_pareto(config_of(**ADAPTIVE), tmp_path / "run", resume=True)
    assert len(manifest_of(tmp_path / "run")["resumes"]) == 2
    assert read(tmp_path / "run") == read(adaptive[0])


def test_more_generations_continue_an_adaptive_run(adaptive, eager, tmp_path):
    run_pareto(config_of(**{**ADAPTIVE, "generations": 15}), tmp_path / "run")
    for name in ("manifest.json", *TABLES, *PICTURES):
        (tmp_path / "run" / name).unlink()
    run_pareto(config_of(**ADAPTIVE), tmp_path / "run", resume=True)
    assert read(tmp_path / "run") == read(adaptive[0])


def test_checkpoint_of_the_old_form_is_refused(cut_off):
    path = cut_off / "checkpoint" / "run.json"
    path.write_text(re.sub(r'"schema": \d+', '"schema": 1', path.read_text()))
    with pytest.raises(InputError, match=r"form 1.*--force"):
        run_pareto(config_of(), cut_off, resume=True)


def test_adaptive_run_with_an_active_bound(eager):
    """Errors alone must not rule the front out, nor a coarse design stand on it."""
    bounds = {"constraints__volume": "{max = 12}", "constraints__gci": "{min = 0.2}"}
    run = run_pareto(config_of(**ADAPTIVE, **bounds))
    assert run.front.designs
    for design in run.front.designs:
        assert min(design.slack.values()) >= 0
    assert max(d.objectives["volume"] for d in run.front.designs) > 11


def test_dry_run_of_an_adaptive_search(tmp_path):
    (tmp_path / "test.toml").write_text(text_of(**ADAPTIVE))
    plan = json_answer("pareto", "test.toml", "--dry-run", cwd=tmp_path)
    assert plan["points"] > 0
    assert plan["estimated_time"] > 0


@given(
    st.lists(st.tuples(*[st.integers(0, 40)] * 2), min_size=1, max_size=40), st.integers(2, 12)
)  # fmt: skip
def test_spread_drops_the_smallest_share_first(points, count):
    # Shares that differ: equal ones may leave in any order.
    points = 1 + np.array(points) + 1e-3 * np.random.default_rng(1).random((len(points), 2))
    points = np.unique(points, axis=0)
    front = points[moocore.is_nondominated(points, maximise=True)]
    kept = front[spread(front, count)]
    left = list(map(tuple, front))
    while len(left) > count:
        rest = [left[:i] + left[i + 1 :] for i in range(1, len(left) - 1)]
        left = max(rest, key=lambda rows: naive_hypervolume(np.array(rows)))
    assert len(kept) == min(len(front), count)
    assert set(map(tuple, kept)) == set(left)


# --- which folder -------------------------------------------------------------------------


def test_folder_of_a_run_is_kept(finished, cut_off, tmp_path):
    (tmp_path / "test.toml").write_text(text_of())
    command = ("pareto", "test.toml", "--out")
    before = read(finished[0])
    line = error_line(here(*command, finished[0], cwd=tmp_path))
    assert "finished run" in line
    assert "--force" in line
    assert read(finished[0]) == before
    line = error_line(here(*command, cut_off, cwd=tmp_path))
    assert all(word in line for word in ("interrupted run", "--resume", "--force"))
    result = here(*command, cut_off, "--force", "--quiet", cwd=tmp_path)
    assert result.returncode == 0
    assert read(cut_off) == before
    assert manifest_of(cut_off)["resumes"] == []


def test_folder_of_another_command_is_kept(tmp_path):
    (tmp_path / "test.toml").write_text(text_of())
    answer("workspace", MECH, *SMALL, "--out", "run", cwd=tmp_path)
    for options in ((), ("--resume",)):
        result = here("pareto", "test.toml", "--out", "run", *options, cwd=tmp_path)
        assert "finished" in error_line(result)


def test_a_run_that_replaces_another_is_taken_up_again(finished, tmp_path):
    """Until it is finished the earlier one is there, whole."""
    folder = tmp_path / "run"
    shutil.copytree(finished[0], folder)
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    other = config_of(seed=2, generations=2)
    with pytest.raises(KeyboardInterrupt):
        run_pareto(other, folder, force=True, on_measured=interrupt)
    assert {p: p.read_bytes() for p in before} == before
    with pytest.raises(InputError, match="a finished and an interrupted run; --resume"):
        run_pareto(other, folder)
    assert not pareto_finished(other, folder)
    run_pareto(other, folder, resume=True)
    assert manifest_of(folder)["resumes"] == [2]
    run_pareto(other, tmp_path / "alone")
    assert read(folder) == read(tmp_path / "alone")
    assert [p.name for p in folder.iterdir() if p.name.startswith(".")] == []
    assert len(list((folder / "checkpoint").glob("generation-*"))) == 2


@pytest.mark.parametrize("options", [{"resume": True}])
def test_a_finished_run_that_is_reopened_is_unfinished(finished, tmp_path, options):
    folder = tmp_path / "run"
    shutil.copytree(finished[0], folder)
    more = config_of(generations=GENERATIONS + 2)
    with pytest.raises(KeyboardInterrupt):
        run_pareto(more, folder, on_measured=interrupt, **options)
    assert not (folder / "manifest.json").exists()
    with pytest.raises(InputError, match="interrupted run"):
        run_pareto(more, folder)
    run_pareto(more, folder, resume=True)
    assert manifest_of(folder)["resumes"][-1] == GENERATIONS + 2


def test_force_forgets_the_earlier_checkpoint(finished, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(finished[0], folder)
    run_pareto(config_of(generations=2), folder, force=True)
    assert len(list((folder / "checkpoint").glob("generation-*"))) == 2
    assert len(table(folder, "history")) == 2


@pytest.mark.parametrize("command", ["pareto", "workspace"])
def test_folder_that_can_not_be_written(tmp_path, command):
    (tmp_path / "test.toml").write_text(text_of())
    (tmp_path / "file").write_text("")
    words = {"pareto": ("pareto", "test.toml"), "workspace": ("workspace", MECH, *SMALL)}
    result = here(*words[command], "--out", "file/run", "--quiet", cwd=tmp_path)
    assert "file/run" in error_line(result, code=1)
    result = here(*words[command], "--out", "file", "--quiet", cwd=tmp_path)
    assert "is a file" in error_line(result, code=2)
    assert files_in(tmp_path) == ["file", "test.toml"]


# --- nothing feasible ---------------------------------------------------------------------

DESIGNS = POPULATION * GENERATIONS
INFEASIBLE = [
    ({"constraints__gci": "{min = 0.99}"}, f"gci >= 0.99 rules out {DESIGNS} of {DESIGNS} designs"),
    (
        {"constraints__volume": "{max = 0.01}"},
        f"volume <= 0.01 m^3 rules out {DESIGNS} of {DESIGNS} designs",
    ),
    (
        {"workspace__domain": "{z = [50, 60]}"},
        f"no reachable pose in {DESIGNS} of {DESIGNS} designs",
    ),
]


@pytest.mark.parametrize(("change", "reason"), INFEASIBLE, ids=[r for _, r in INFEASIBLE])
def test_nothing_feasible(tmp_path, change, reason):
    (tmp_path / "test.toml").write_text(text_of(**change))
    result = here("pareto", "test.toml", "--out", "run", "--quiet", cwd=tmp_path)
    assert result.stdout == ""
    assert reason in error_line(result, code=3)
    rows = table(tmp_path / "run", "evaluations")
    assert len(rows) == DESIGNS
    assert {row["feasible"] for row in rows} == {"0"}
    assert not (tmp_path / "run" / "manifest.json").exists()
    with pytest.raises(InfeasibleError):
        run_pareto(config_of(**change))


def test_nothing_feasible_of_a_process(tmp_path):
    (tmp_path / "test.toml").write_text(text_of(constraints__gci="{min = 0.99}"))
    result = pmopt("pareto", "test.toml", "--out", "run", "--quiet", cwd=tmp_path)
    line = error_line(result, code=3)
    best = float(re.search(r"best ([\d.]+)", line).group(1))
    values = column(table(tmp_path / "run", "evaluations"), "gci")
    assert best == pytest.approx(values.max(), rel=1e-3)  # four digits are printed


def test_nothing_feasible_says_no_nan(tmp_path):
    change = {"constraints__gci": "{min = 0.99}", "workspace__domain": "{z = [50, 60]}"}
    with pytest.raises(InfeasibleError) as caught:
        run_pareto(config_of(**change))
    assert "nan" not in str(caught.value)


def test_nothing_feasible_names_min_lci():
    with pytest.raises(InfeasibleError, match="min_lci"):
        run_pareto(config_of(workspace__min_lci=0.999))


# --- constraints --------------------------------------------------------------------------


def test_constraints_are_kept_and_shown(tmp_path):
    bounds = {"constraints__volume": "{min = 5, max = 12}", "constraints__gci": "{min = 0.2}"}
    config = config_of(generations=8, **bounds)
    run_pareto(config, tmp_path / "run")
    front = table(tmp_path / "run", "front")
    assert set(list(front[0])[-3:]) == {"volume_min", "volume_max", "gci_min"}
    assert column(front, "volume").min() >= 5
    assert column(front, "volume").max() <= 12
    assert column(front, "gci").min() >= 0.2
    rows = table(tmp_path / "run", "evaluations")
    values = {name: column(rows, name) for name in ("volume", "gci")}
    kept = (values["volume"] >= 5) & (values["volume"] <= 12) & (values["gci"] >= 0.2)
    assert 0 < kept.sum() < len(rows)
    assert [row["feasible"] for row in rows] == [str(int(k)) for k in kept]
    # What is left of each bound, >= 0 where it is kept.
    np.testing.assert_array_equal(column(rows, "volume_min"), values["volume"] - 5)
    np.testing.assert_array_equal(column(rows, "volume_max"), -(values["volume"] - 12))
    np.testing.assert_array_equal(column(front, "gci_min"), column(front, "gci") - 0.2)


def test_objectives_in_the_other_order(tmp_path):
    run_pareto(config_of(objectives='["gci", "volume"]'), tmp_path / "run")
    front = table(tmp_path / "run", "front")
    assert list(front[0])[6:] == ["gci", "gci_error", "volume", "volume_error"]
    assert np.all(np.diff(column(front, "gci")) > 0)
    assert np.all(np.diff(column(front, "volume")) < 0)


# --- evaluation ---------------------------------------------------------------------------


def designs_of(problem, count=6):
    rng = np.random.default_rng(5)
    return problem.lower + (problem.upper - problem.lower) * rng.uniform(
        size=(count, len(problem.lower))
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"samples": 4000},
        {"samples": 2000, "workspace__sampler": '"sobol"', "workspace__replicates": 10},
        {"samples": 2000, "workspace__sampler": '"monte-carlo"', "seed": 3},
        {"samples": 2000, "workspace__norm": '"fro"', "workspace__jacobian": '"homogenized"'},
        {"samples": 2000, "workspace__min_lci": 0.1, "workspace__working_mode": '"in-in"'},
        {"samples": 2000, "workspace__domain": "{x = [-0.5, 1]}", "h": 1.2},
        {"samples": 2000, "workspace__limits": "{theta1 = [-1, 1], d = [-0.5, 0.2]}"},
    ],
)
def test_population_is_evaluated_as_single_designs_are(changes):
    if "h" in changes:
        changes = {**changes, "parameters__h": changes["h"]}
        del changes["h"]
    config = config_of(**changes)
    problem = DesignProblem(config)
    variables = designs_of(problem)
    found = problem.evaluate(variables)
    assert problem.objectives == ["volume", "gci"]
    for row, values, errors in zip(variables, found.values, found.errors, strict=True):
        single = compute_workspace(
            problem.mechanism, problem.parameters(row), config.workspace,
            seed=config.algorithm.seed, shape_grid=0,
        )  # fmt: skip
        # The same points and counts; sums of indices may round in another order.
        assert values[0] == pytest.approx(single.volume.value, rel=1e-12)
        assert values[1] == pytest.approx(single.gci.value, rel=1e-12)
        assert errors[0] == pytest.approx(single.volume.error, rel=1e-9)
        # The linearised error against the jackknife: equal in first order of 1/replicates.
        assert errors[1] == pytest.approx(single.gci.error, rel=0.2)


@pytest.mark.parametrize("size", [{"grid": 16}, {"target_error": 0.05}])
def test_population_on_grids_and_to_a_target_error(size):
    data = tomllib.loads(text_of())
    data["workspace"] = size
    config = resolve_config(data, "test.toml")
    problem = DesignProblem(config)
    variables = designs_of(problem, 3)
    found = problem.evaluate(variables)
    for row, values, errors in zip(variables, found.values, found.errors, strict=True):
        single = compute_workspace(problem.mechanism, problem.parameters(row), config.workspace,
                                   shape_grid=0)  # fmt: skip
        assert values.tolist() == [single.volume.value, single.gci.value]
        assert errors.tolist() == [single.volume.error, single.gci.error]


@pytest.mark.parametrize("size", [{"grid": 8}, {"target_error": 0.05}])
def test_whole_run_on_grids_and_to_a_target_error(tmp_path, size):
    data = tomllib.loads(text_of(population=4, generations=3))
    data["workspace"] = size
    run = run_pareto(resolve_config(data, "test.toml"), tmp_path / "run")
    assert run.front.designs
    assert len(table(tmp_path / "run", "history")) == 3


def test_design_without_a_workspace_is_infeasible():
    problem = DesignProblem(config_of(workspace__domain="{z = [2.5, 9]}"))
    small, large = problem.lower.copy(), problem.upper.copy()
    found = problem.evaluate(np.array([small, large]))
    assert found.feasible.tolist() == [False, True]
    assert found.values[0, 0] == 0.0
    assert math.isnan(found.values[0, 1])


# --- hypervolume, knee, idle directions ---------------------------------------------------


def naive_front(values):
    """Return the non-dominated rows, each compared with every other."""
    return [
        a for a in values.tolist()
        if not any(b[0] >= a[0] and b[1] >= a[1] and b != a for b in values.tolist())
    ]  # fmt: skip


def naive_hypervolume(values):
    """Return the area between the origin and a set of points: a staircase of rectangles."""
    points = sorted({(x, y) for x, y in values.tolist() if x > 0 and y > 0}, reverse=True)
    area = height = 0.0
    for (x, y), (smaller, _) in itertools.pairwise([*points, (0.0, 0.0)]):
        height = max(height, y)
        area += (x - smaller) * height
    return area


sides = st.floats(0, 100, width=32)


@given(st.lists(st.tuples(sides, sides), max_size=12))
def test_hypervolume(points):
    values = np.array(points, dtype=float).reshape(-1, 2)
    # A dozen sums of products of size 1e4 at most.
    found = hypervolume(values, np.array([1, 1]), (0.0, 0.0))
    assert found == pytest.approx(naive_hypervolume(values), rel=1e-12, abs=1e-9)
    # The same with the second objective minimised below a reference.
    flipped = values * [1, -1] + [0.0, 7.0]
    found = hypervolume(flipped, np.array([1, -1]), (0.0, 7.0))
    assert found == pytest.approx(naive_hypervolume(values), rel=1e-9, abs=1e-9)


def test_naive_hypervolume_of_known_sets():
    assert naive_hypervolume(np.array([[2.0, 3.0]])) == 6
    assert naive_hypervolume(np.array([[1.0, 3.0], [3.0, 1.0]])) == 5
    assert naive_hypervolume(np.array([[1.0, 3.0], [3.0, 1.0], [1.0, 1.0]])) == 5
    assert naive_hypervolume(np.empty((0, 2))) == 0


def test_hypervolume_of_the_front(finished):
    folder, run = finished
    rows = table(folder, "front")
    values = np.stack([column(rows, "volume"), column(rows, "gci")], axis=1)
    assert run.front.hypervolume == pytest.approx(naive_hypervolume(values), rel=1e-12)
    assert manifest_of(folder)["result"]["hypervolume"] == run.front.hypervolume


def test_knee_is_farthest_from_the_line_between_the_ends(finished, long_run):
    for folder in (finished[0], long_run):
        rows = table(folder, "front")
        x, y = column(rows, "volume"), column(rows, "gci")
        x, y = x / np.ptp(x), y / np.ptp(y)
        # Twice the area of the triangle with the ends; positive on the side of better designs.
        off = (x - x[0]) * (y[0] - y[-1]) - (x[-1] - x[0]) * (y[0] - y)
        assert len(rows) > 2
        assert off.max() > 0
        assert manifest_of(folder)["result"]["knee"]["design"] == int(np.argmax(off)) + 1


@pytest.mark.parametrize(
    ("parameters", "workspace", "expected"),
    [
        # The mechanism depends on m - n only, and c moves everything along z.
        ({}, {}, [{"c": 1.0}, {"m": 1.0, "n": 1.0}]),
        ({"n": 0.7}, {}, [{"c": 1.0}]),
        ({"c": 0.1}, {}, [{"m": 1.0, "n": 1.0}]),
        ({"n": 0.7, "c": 0.1}, {}, []),
        ({}, {"jacobian": "homogenized"}, [{"c": 1.0}, {"m": 1.0, "n": 1.0}]),
        # A lid or a fixed floor is not moved by c.
        ({"n": 0.7, "h": 1.0}, {}, []),
        ({"n": 0.7, "h": 3.0}, {}, []),
        ({"h": 1.0}, {}, [{"m": 1.0, "n": 1.0}]),
        ({"n": 0.7}, {"domain": {"z": [0.5, 2.0]}}, []),
    ],
)
def test_idle_directions(parameters, workspace, expected):
    data = {
        "mechanism": MECH,
        "parameters": parameters,
        "workspace": {"samples": 2000, **workspace},
    }
    problem = DesignProblem(resolve_config(data, "test.toml"))
    found = [
        scaled(direction)
        for direction in idle_directions(problem, NO_FRONT[:, : len(problem.variables)])
    ]
    assert sorted(found, key=str) == sorted(map(scaled, expected), key=str)
    # And so it is: along each the objectives stay as they are.
    middle = (problem.lower + problem.upper) / 2
    for direction in found:
        moved = middle + 0.02 * np.array([direction.get(k, 0.0) for k in problem.variables])
        values = problem.evaluate(np.array([middle, moved])).values
        np.testing.assert_allclose(values[0], values[1], rtol=1e-6)


def test_idle_directions_where_little_depends_on_them():
    """A lid at 3.2 m cuts large designs only, and these are what the front is made of."""
    data = {"mechanism": MECH, "parameters": {"n": 0.7, "h": 3.2}, "workspace": {"samples": 2000}}
    problem = DesignProblem(resolve_config(data, "test.toml"))
    assert problem.variables == ["m", "l1", "l2", "c"]
    large = np.array([[0.7, 1.5, 1.5, 0.1], [0.7, 1.5, 1.5, 0.5]])
    low, high = problem.evaluate(large).values[:, 0]
    assert high < 0.95 * low
    assert {"c": 1.0} not in idle_directions(problem, NO_FRONT[:, : len(problem.variables)])


def scaled(direction):
    """Return a direction with a first coefficient of 1, in the order of the names."""
    first = direction[min(direction)]
    return {name: direction[name] / first for name in sorted(direction)}


def test_idle_directions_are_told(tmp_path):
    (tmp_path / "test.toml").write_text(text_of(generations=2, n="[0.2, 1.0]", c="[0.1, 0.5]"))
    document = json_answer("pareto", "test.toml", "--out", "run", "--quiet", cwd=tmp_path)
    assert sorted(document["idle_directions"], key=str) == [{"c": 1.0}, {"m": 1.0, "n": 1.0}]
    text = answer("pareto", "test.toml", "--out", "run", "--force", "--quiet", cwd=tmp_path)
    assert "c changes no objective" in text
    assert re.search(r"m by \+1, n by \+1", text)


# --- edges --------------------------------------------------------------------------------


def tight():
    """Return a problem of two designs: the ends of a range one rounding step wide."""
    fixed = {"n": 0.5, "l1": 0.5, "l2": 0.5, "c": 0.1}
    return {"parameters": {"m": [0.5, math.nextafter(0.5, 1)], **fixed}}


def test_search_that_runs_out_of_designs(tmp_path):
    data = {**tomllib.loads(text_of()), **tight()}
    run = run_pareto(resolve_config(data, "test.toml"), tmp_path / "run")
    assert len(run.front.designs) >= 1
    assert len(table(tmp_path / "run", "evaluations")) < DESIGNS


def test_dry_run_of_a_search_that_runs_out_of_designs(tmp_path):
    rest = "\n".join(f"{k} = {v}" for k, v in tight()["parameters"].items())
    (tmp_path / "test.toml").write_text(f'mechanism = "{MECH}"\n[parameters]\n{rest}\n')
    assert json_answer("pareto", "test.toml", "--dry-run", cwd=tmp_path)["estimated_time"] >= 0


def test_checkpoint_is_told_by_its_folder(finished, tmp_path):
    assert Checkpoint.exists(finished[0])
    assert not Checkpoint.exists(tmp_path)


def test_records_of_another_installation_are_taken_up():
    """Designs or random numbers that this installation would not have are taken as recorded."""
    problem = DesignProblem(config_of())
    recorded = [g.record for g in Optimisation(problem).generations()]
    second = recorded[1].evaluated
    moved = replace(recorded[1], evaluated=replace(second, variables=second.variables + 1e-9))
    drawn = replace(recorded[1], generator=recorded[2].generator)
    asked = replace(recorded[1], asked=recorded[2].generator)
    for other in (moved, drawn, asked):
        lines = []
        again = [
            g.record for g in Optimisation(problem).generations([recorded[0], other], lines.append)
        ]
        assert again[:2] == [recorded[0], other]
        assert len(again) == len(recorded)
        assert len(lines) == 1
        assert "from generation 2 on" in lines[0]
    lines = []
    again = [g.record for g in Optimisation(problem).generations(recorded[:2], lines.append)]
    assert lines == []
    for one, other in zip(again, recorded, strict=True):
        assert (one.evaluated.table() == other.evaluated.table()).all()
        assert (one.asked, one.generator) == (other.asked, other.generator)


def test_active_bounds_leave_a_front(tmp_path):
    """The front lies on a bound: sampling errors must not rule it out as a whole."""
    bounds = {"constraints__volume": "{min = 5, max = 12}", "constraints__gci": "{min = 0.2}"}
    run = run_pareto(config_of(population=12, generations=10, **bounds))
    for design in run.front.designs:
        assert min(design.slack.values()) >= 0
        assert design.objectives["volume"] > 11


def test_leftovers_of_a_kill_are_removed(tmp_path, cut_off):
    left = [cut_off / ".front.csv.abc.pmopt-tmp", cut_off / "checkpoint" / ".x.pmopt-tmp"]
    for path in left:
        path.write_text("torn")
    run_pareto(config_of(), cut_off, resume=True)
    assert not any(path.exists() for path in left)


# --- designs that fail --------------------------------------------------------------------


@pytest.fixture
def fragile(monkeypatch):
    """Let every design with a small l1 fail while it is made ready."""
    kind = type(package.mechanism(MECH).declaration)
    constants = kind.kernel_constants

    def failing(self, parameters, *rest):
        if parameters["l1"] < 0.8:
            raise ZeroDivisionError("division by zero")
        return constants(self, parameters, *rest)

    monkeypatch.setattr(kind, "kernel_constants", failing)


def test_designs_that_fail_are_told_and_left_out(fragile, finished, tmp_path, cut_off):
    (tmp_path / "test.toml").write_text(text_of())
    result = here("pareto", "test.toml", "--out", "fragile", "--quiet", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    rows = table(tmp_path / "fragile", "evaluations")
    failed = [row for row in rows if float(row["l1"]) < 0.8]
    assert 3 < len(failed) < len(rows)
    assert all(row["feasible"] == "0" and row["gci"] == "" for row in failed)
    assert all(float(row["l1"]) >= 0.8 for row in table(tmp_path / "fragile", "front"))
    failures = manifest_of(tmp_path / "fragile")["failures"]
    assert list(failures) == ["ZeroDivisionError: division by zero"]
    # Beside those of the search there may be some that the influence of parameters is tried on.
    assert sum(failures.values()) >= len(failed)
    assert manifest_of(finished[0])["failures"] == {}
    shutil.rmtree(cut_off)
    shutil.copytree(tmp_path / "fragile", cut_off)
    (cut_off / "manifest.json").unlink()
    result = here("pareto", "test.toml", "--out", cut_off, "--resume", cwd=tmp_path)
    assert manifest_of(cut_off)["failures"] == failures
    (line,) = [line for line in result.stderr.splitlines() if "could not be evaluated" in line]
    assert "ZeroDivisionError: division by zero" in line
    assert read(cut_off) == read(tmp_path / "fragile")


def test_no_design_that_does_not_fail(fragile, tmp_path):
    (tmp_path / "test.toml").write_text(text_of(l1="[0.5, 0.7]"))
    line = error_line(here("pareto", "test.toml", "--out", "run", "--quiet", cwd=tmp_path), code=3)
    assert "could not be evaluated (ZeroDivisionError: division by zero)" in line
