"""A run's folder: one command at a time, and what is replaced is replaced as one whole."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from support.cli_runner import (
    BATCH,
    COMMAND,
    CONFIGS,
    SEARCH,
    TIMEOUT,
    environment,
    error_line,
    files_in,
    here,
    pmopt,
)
from support.runs import make
from support.strange import STRANGE, in_time

from pmopt.errors import InputError, PmoptError
from pmopt.reporting.runs import run_pictures, workspace_checkpoint
from pmopt.reporting.runs.run_folder import RunFolder, read_manifest
from pmopt.storage import files, folder_lock, swap
from pmopt.storage.folder_lock import FolderLock

MECH = "2pauu-ppap"
#: One of each command that writes a run's folder; a second one of them differs in its numbers.
COMMANDS = {
    "pareto": ("pareto", "search.toml"),
    "workspace": ("workspace", MECH, "--samples", 1000, "--shape-grid", 0),
    "long workspace": ("workspace", MECH, "--samples", 3 * 2**22, "--shape-grid", 0),
    "volume": ("workspace", MECH, "--certify", 0.5),
    "certify": ("certify", MECH, "--min-lci", 0.01, "--time-budget", 2,
                "--domain", "x=-0.01:0.01,y=-0.01:0.01,z=1.2:1.21"),
    "singularities": ("singularities", MECH, "--samples", 1000, "--grid", 6),
    "capability": ("capability", MECH, "--samples", 1000),
    "motion": ("motion", CONFIGS / "motion" / "2uu-upu-t1.toml"),
    "batch": ("batch", "batch.toml", "--workers", 1),
}  # fmt: skip


@pytest.fixture
def home(tmp_path):
    (tmp_path / "search.toml").write_text(SEARCH)
    (tmp_path / "batch.toml").write_text(BATCH)
    return tmp_path


@pytest.fixture(autouse=True)
def nothing_drawn(monkeypatch):
    """Keep every block and draw next to nothing."""
    monkeypatch.setattr(workspace_checkpoint, "EVERY", 0.0)
    for name in ("of_workspace", "of_pareto", "of_singularities"):
        monkeypatch.setattr(run_pictures, name, lambda *_: {"picture.png": b"drawn"})


def contents(folder):
    return {name: (folder / name).read_bytes() for name in files_in(folder)}


def state(folder):
    """Return whose files are there, by name; manifest and checkpoint say by which command."""
    found = {}
    for name, data in contents(folder).items():
        text = data.decode()
        found[name] = json.loads(text)["command"] if name.endswith(".json") else text
    return found


OLD = dict.fromkeys(["a.csv", "b.csv", "checkpoint/run.json", "manifest.json"], "old")
NEW = dict.fromkeys(["b.csv", "c.csv", "checkpoint/run.json", "manifest.json"], "new")
MINE = {"notes.txt": "mine"}


@pytest.fixture
def replaced(tmp_path):
    """Return a folder with an old run and something of the user's."""
    folder = tmp_path / "run"
    make(folder, "old", ["a.csv", "b.csv"])
    (folder / "notes.txt").write_text("mine")
    assert state(folder) == OLD | MINE
    return folder


def test_a_run_replaces_another_with_all_it_had(replaced):
    make(replaced, "new", ["b.csv", "c.csv"])
    assert state(replaced) == NEW | MINE
    assert sorted(p.name for p in replaced.iterdir()) == [
        "b.csv", "c.csv", "checkpoint", "manifest.json", "notes.txt",
    ]  # fmt: skip


#: What the script below imports from.
TESTS = os.path.dirname(os.path.dirname(__file__))
#: Replaces the run and is killed at a call of those that change what lies where.
KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from support.runs import make
from support.strange import STRANGE, in_time
left = {after}
def deadly(call):
    def called(*args, **options):
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return call(*args, **options)
    return called
from pmopt.storage import swap
whole = swap.swap
def counted(*args):
    for name in ("rename", "replace", "unlink", "mkdir", "rmdir"):
        setattr(os, name, deadly(getattr(os, name)))
    whole(*args)
    os.write(1, b"survived\\n")
    os._exit(0)
import pmopt.reporting.runs.run_folder as run_folder
run_folder.swap = counted
make(Path({folder!r}), "new", ["b.csv", "c.csv"])
"""


@pytest.mark.slow
def test_killed_at_any_step(replaced):
    """After the next look at the folder it holds one run or the other, and nothing else."""
    seen = set()
    for after in range(100):
        make(replaced, "old", ["a.csv", "b.csv"])
        assert state(replaced) == OLD | MINE
        script = KILLED.format(tests=TESTS, folder=str(replaced), after=after)
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True,
                              env=environment())  # fmt: skip
        if done.stdout == "survived\n":
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        assert read_manifest(replaced)["command"] in ("old", "new")
        with pytest.raises(InputError, match="holds a finished"):
            RunFolder(replaced)
        found = state(replaced)
        ahead = {n for n in found if n.startswith(swap.NEXT)}
        left = {n: found[n] for n in found if n not in ahead and n != folder_lock.NAME}
        assert left in (OLD | MINE, NEW | MINE)
        assert not ahead or left == OLD | MINE
        seen.add(left["manifest.json"])
    assert after > 10
    assert seen == {"old", "new"}


@pytest.mark.parametrize("checkpoint", [True, False])
def test_what_cannot_be_moved_is_undone(replaced, monkeypatch, checkpoint):
    rename = os.rename
    for room in range(100):
        left = room

        def fails(*args, **options):
            nonlocal left
            left -= 1
            if left == -1:
                raise OSError(errno.EPERM, os.strerror(errno.EPERM), args[0])
            rename(*args, **options)

        with monkeypatch.context() as patch:
            patch.setattr(os, "rename", fails)
            try:
                make(replaced, "new", ["b.csv", "c.csv"], checkpoint)
            except PmoptError as error:
                assert "Operation not permitted" in str(error)
            else:
                break
        found = state(replaced)
        # What a search has reached is kept for --resume.
        assert {n: v for n, v in found.items() if not n.startswith(".")} == OLD | MINE
        kept = {n for n in found if n.startswith(".")}
        assert kept == ({f"{swap.NEXT}/checkpoint/run.json"} if checkpoint else set())
    assert room == 4 + 3 + checkpoint
    assert len(state(replaced)) == 4 + checkpoint


def test_a_folder_in_the_way_of_a_file(replaced):
    (replaced / "c.csv").mkdir()
    (replaced / "c.csv" / "precious").write_text("mine")
    with pytest.raises(PmoptError, match=r"c\.csv: cannot write: is a folder"):
        make(replaced, "new", ["b.csv", "c.csv"], checkpoint=False)
    assert state(replaced) == OLD | MINE | {"c.csv/precious": "mine"}


@pytest.fixture
def immutable(replaced):
    path = replaced / "b.csv"
    if subprocess.run(["chattr", "+i", str(path)], capture_output=True).returncode:
        pytest.skip("no file can be made immutable here")
    yield path
    subprocess.run(["chattr", "-i", str(path)], check=True)


def test_a_file_that_cannot_be_moved(replaced, immutable):
    with pytest.raises(PmoptError, match="cannot write: Operation not permitted"):
        make(replaced, "new", ["b.csv", "c.csv"], checkpoint=False)
    assert state(replaced) == OLD | MINE


def test_a_journal_that_is_none(replaced):
    (replaced / swap.JOURNAL).write_text('{"old": ["../precious"], "new": []}')
    with pytest.raises(InputError, match="is not a journal of pmopt"):
        make(replaced, "new", ["b.csv"])
    with pytest.raises(InputError, match="is not a journal of pmopt"):
        read_manifest(replaced)


@pytest.mark.parametrize("name", [n for n in COMMANDS if n != "batch"])
@pytest.mark.slow
def test_every_command_replaces_a_run_as_one_whole(home, monkeypatch, name):
    """Whatever cannot be moved: the earlier run is as it was, and nothing lies about."""
    assert here(*COMMANDS["workspace"], "--seed", 7, "--out", "run", cwd=home).returncode == 0
    before = contents(home / "run")
    rename, moved = os.rename, []

    def fails(*args, **options):
        if len(moved) == 3:
            moved.append(None)
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), args[0])
        moved.append(None)
        rename(*args, **options)

    words = (*COMMANDS[name], "--out", "run", "--force", "--quiet")
    with monkeypatch.context() as patch:
        patch.setattr(os, "rename", fails)
        assert "Read-only file system" in error_line(here(*words, cwd=home), 1)
    found = contents(home / "run")
    assert {n: v for n, v in found.items() if not n.startswith(swap.NEXT)} == before
    assert all("/checkpoint/" in n for n in found if n.startswith(swap.NEXT))
    result = here(*words, cwd=home)
    assert result.returncode == 0, result.stderr
    assert here(*COMMANDS[name], "--out", "alone", cwd=home).returncode == 0
    assert files_in(home / "run") == files_in(home / "alone")


@pytest.mark.slow
def test_a_batch_is_replaced_as_one_whole(home, monkeypatch):
    words = ("batch", "batch.toml", "--workers", 1, "--out", "out", "--quiet")
    assert here(*words, cwd=home).returncode == 0
    before = contents(home / "out")
    (home / "batch.toml").write_text(BATCH.replace("[1, 2]", "[3, 4]"))
    from pmopt.reporting.batch.run import Batch

    keep = Batch._keep

    def interrupted(batch, run, outcome):
        keep(batch, run, outcome)
        raise PmoptError("enough")

    with monkeypatch.context() as patch:
        patch.setattr(Batch, "_keep", interrupted)
        assert "enough" in error_line(here(*words, "--force", cwd=home), 1)
    found = contents(home / "out")
    assert {n: v for n, v in found.items() if not n.startswith(".")} == before
    assert f"{swap.NEXT}/runs/batch-seed=3/manifest.json" in found
    stamp = found[f"{swap.NEXT}/runs/batch-seed=3/manifest.json"]
    assert here(*words, "--resume", cwd=home).returncode == 0
    found = contents(home / "out")
    assert found["runs/batch-seed=3/manifest.json"] == stamp
    assert sorted(p.name for p in (home / "out" / "runs").iterdir()) == [
        "batch-seed=3", "batch-seed=4",
    ]  # fmt: skip
    assert not [n for n in found if n.startswith(".")]
    assert ".pmopt" not in found["manifest.json"].decode()


# --- one at a time ----------------------------------------------------------------------------


def hold(folder):
    """Start a process that holds the lock until its stdin ends."""
    script = (
        "import sys; from pathlib import Path; from pmopt.storage.folder_lock import FolderLock\n"
        f"with FolderLock(Path({str(folder)!r})): print('held', flush=True); sys.stdin.read()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script, "motion", "x y"], text=True, env=environment(),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout.readline() == "held\n"
    return process


@pytest.fixture
def holder(home):
    process = hold(home / "run")
    yield process
    process.kill()
    process.communicate()


@pytest.mark.parametrize("name", COMMANDS)
def test_the_second_command_says_who_is_first(home, holder, name):
    for options in ((), ("--force",), ("--resume",)):
        if options == ("--resume",) and COMMANDS[name][0] not in ("pareto", "workspace", "batch"):
            continue
        if options == ("--resume",) and name == "volume":
            continue
        line = error_line(here(*COMMANDS[name], "--out", "run", *options, cwd=home))
        assert f"run: is being written by process {holder.pid} on " in line
        assert line.endswith(": -c motion 'x y'")
        assert " since 20" in line
    assert files_in(home / "run") == [folder_lock.NAME]


@pytest.mark.slow
def test_a_worker_waits_for_one_whose_batch_was_killed(home):
    """Such a worker ends within a second or so."""
    process = subprocess.Popen(
        [*COMMAND, "batch", "batch.toml", "--workers", "1", "--out", "out"], cwd=home, text=True,
        env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    other = hold(home / "out" / "runs" / "batch-seed=1")
    while not (home / "out" / "batch.lock").exists():
        time.sleep(0.01)
    time.sleep(3)
    other.kill()
    other.communicate()
    assert process.communicate(timeout=TIMEOUT)[1].count("finished") == 2
    assert process.returncode == 0


def test_a_killed_command_holds_nobody_up(home, holder):
    holder.kill()
    holder.wait()
    assert (home / "run" / folder_lock.NAME).exists()
    assert here(*COMMANDS["workspace"], "--out", "run", cwd=home).returncode == 0
    assert not (home / "run" / folder_lock.NAME).exists()


def test_plot_waits_for_nobody(home):
    assert here(*COMMANDS["workspace"], "--out", "run", cwd=home).returncode == 0
    process = hold(home / "run")
    line = error_line(here("plot", "run", cwd=home))
    assert f"is being written by process {process.pid}" in line
    assert here("plot", "run", "--out", "elsewhere", cwd=home).returncode == 0
    assert files_in(home / "elsewhere") == ["picture.png"]
    process.communicate()
    assert here("plot", "run", cwd=home).returncode == 0


def test_what_was_made_for_a_lock_goes_with_it(tmp_path):
    with FolderLock(tmp_path / "a" / "b"), FolderLock(tmp_path / "c"):
        (tmp_path / "c" / "file").write_text("")
        with pytest.raises(InputError, match=f"by process {os.getpid()} on"):
            FolderLock(tmp_path / "c")
    assert files_in(tmp_path) == ["c/file"]
    assert [p.name for p in tmp_path.iterdir()] == ["c"]


def test_threads_take_turns(tmp_path):
    """Folder and file come and go all the time, and never two hold them."""
    inside, most, refused = 0, 0, 0

    def one(_):
        nonlocal inside, most, refused
        try:
            with FolderLock(tmp_path / "run"):
                inside += 1
                most = max(most, inside)
                time.sleep(0.002)
                inside -= 1
        except InputError:
            refused += 1

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(one, range(60)))
    assert (most, inside) == (1, 0)
    assert refused < 60
    assert files_in(tmp_path) == []


def test_without_locks_the_record_counts(tmp_path, monkeypatch):
    """As on a file system that has none: a living process is respected, a dead one is not."""
    monkeypatch.setattr(folder_lock, "_lock", lambda handle: None)
    folder = tmp_path / "run"
    with FolderLock(folder), pytest.raises(InputError, match=f"by process {os.getpid()} on"):
        FolderLock(folder)
    process = hold(folder)
    with pytest.raises(InputError, match=f"by process {process.pid} on"):
        FolderLock(folder)
    process.kill()
    process.communicate()
    with FolderLock(folder):
        record = json.loads((folder / folder_lock.NAME).read_text())
    with_other_start = record | {"start": "long ago", "token": "another"}
    folder.mkdir(exist_ok=True)
    (folder / folder_lock.NAME).write_text(json.dumps(with_other_start))
    with FolderLock(folder):  # the number has been given to another process since
        pass
    elsewhere = record | {"host": "elsewhere", "token": "another"}
    (folder / folder_lock.NAME).write_text(json.dumps(elsewhere))
    with pytest.raises(InputError, match="on elsewhere since"):
        FolderLock(folder)


@pytest.mark.parametrize("kind", ["folder", "pipe", "link"])
def test_a_lock_that_is_no_file(tmp_path, kind):
    path = tmp_path / folder_lock.NAME
    make_it = {"folder": path.mkdir, "pipe": lambda: os.mkfifo(path),
               "link": lambda: path.symlink_to(tmp_path / "precious")}[kind]  # fmt: skip
    make_it()
    with pytest.raises(PmoptError):
        FolderLock(tmp_path)
    assert not (tmp_path / "precious").exists()


@pytest.mark.slow
def test_eight_at_once(home):
    words = ("workspace", MECH, "--samples", 2**29, "--shape-grid", 0, "--threads", 1, "--quiet")
    assert pmopt(*words[:3], 1000, *words[4:], cwd=home).returncode == 0
    processes = [
        subprocess.Popen([*COMMAND, *map(str, words), "--out", "run"], cwd=home, text=True,
                         stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment())
        for _ in range(8)
    ]  # fmt: skip
    with ThreadPoolExecutor(8) as pool:
        ended = list(pool.map(lambda p: (p, *p.communicate(timeout=TIMEOUT)), processes))
    (first,) = [p for p in processes if p.returncode == 0]
    for process, _, errors in ended:
        if process is not first:
            assert process.returncode == 2
            assert f"is being written by process {first.pid} on" in errors
            assert errors.count("\n") == 1
    assert read_manifest(home / "run")["command"] == "workspace"
    assert not [n for n in files_in(home / "run") if n.startswith(".")]


# --- modes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_files_have_the_mode_that_is_asked_for(tmp_path, umask, mode):
    folder = tmp_path / "run"
    before = os.umask(umask)
    try:
        make(folder, "old", ["a.csv"])
        files.write_atomic(tmp_path / "single", "new")
        (folder / "a.csv").chmod(0o640)
        (tmp_path / "kept").write_text("")
        (tmp_path / "kept").chmod(0o604)
        make(folder, "new", ["a.csv", "b.csv"])
        files.write_atomic(tmp_path / "kept", "new")
    finally:
        os.umask(before)
    modes = {p.name: p.stat().st_mode & 0o777 for p in (*folder.iterdir(), *tmp_path.iterdir())
             if p.is_file()}  # fmt: skip
    assert modes == {"manifest.json": mode, "b.csv": mode, "single": mode, "a.csv": 0o640,
                     "kept": 0o604}  # fmt: skip
    assert (folder / "checkpoint" / "run.json").stat().st_mode & 0o777 == mode


# --- strange files ----------------------------------------------------------------------------


NAMES = ["manifest.json", "checkpoint", "checkpoint/run.json", "front.csv", "history.csv",
         "checkpoint/generation-0000002.bin", swap.JOURNAL, swap.NEXT]  # fmt: skip


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    folder = tmp_path_factory.mktemp("searched")
    (folder / "search.toml").write_text(SEARCH)
    assert here("pareto", "search.toml", "--out", "run", "--quiet", cwd=folder).returncode == 0
    assert here("batch", "search.toml", "--out", "out", "--quiet", cwd=folder).returncode == 0
    return folder


LOOKS = [
    ("plot", "run"),
    ("pareto", "search.toml", "--out", "run", "--resume"),
    ("pareto", "search.toml", "--out", "run"),
    ("pareto", "search.toml", "--out", "run", "--force"),
    ("batch", "search.toml", "--out", "out", "--workers", 1),
    ("batch", "search.toml", "--out", "out", "--workers", 1, "--force"),
]


def look(home, searched, words, name, strange):
    """Put something strange into a copy of a run, and let a command look at it."""
    subprocess.run(["cp", "-a", str(searched), str(home)], check=True)
    place = home / ("out/runs/search" if words[0] == "batch" else "run") / name
    subprocess.run(["rm", "-rf", str(place)], check=True)
    strange(place)
    result = in_time(*words, "--quiet", cwd=home)
    for text in ("Traceback", "unexpected"):
        assert text not in result.stderr + result.stdout
    assert result.returncode in (0, 1, 2)
    if result.returncode and words[0] != "batch":
        error_line(result, result.returncode)


@pytest.mark.parametrize("name", NAMES)
def test_strange_files_are_one_line(searched, tmp_path, name):
    """Some of them, each with one of the commands that look at a run."""
    for k, strange in list(enumerate(STRANGE))[NAMES.index(name) % 3 :: 3]:
        words = LOOKS[(k + NAMES.index(name)) % len(LOOKS)]
        look(tmp_path / str(k), searched, words, name, strange)


@pytest.mark.slow
@pytest.mark.parametrize("strange", STRANGE)
@pytest.mark.parametrize("name", NAMES)
def test_strange_files_are_one_line_to_all(searched, tmp_path, name, strange):
    """A command does its work, or says in a line why not; one of the commands in turn."""
    words = LOOKS[(STRANGE.index(strange) + 2 * NAMES.index(name)) % len(LOOKS)]
    look(tmp_path / "0", searched, words, name, strange)


BATCH_NAMES = ["manifest.json", "batch.json", "batch.lock", "summary.csv", "runs",
               "runs/search/failure.json", "runs/search"]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("strange", STRANGE)
@pytest.mark.parametrize("name", BATCH_NAMES)
def test_strange_files_in_a_batch_are_one_line(searched, tmp_path, name, strange):
    looks = [("--out", "out"), ("--out", "out", "--force")]
    turn = (STRANGE.index(strange) + BATCH_NAMES.index(name)) % 2
    for k, words in enumerate(looks[turn : turn + 1]):
        home = tmp_path / str(k)
        subprocess.run(["cp", "-a", str(searched), str(home)], check=True)
        place = home / "out" / name
        subprocess.run(["rm", "-rf", str(place)], check=True)
        (home / "out" / "runs" / "search" / "manifest.json").unlink(missing_ok=True)
        strange(place)
        result = in_time("batch", "search.toml", *words, "--quiet", cwd=home)
        assert "Traceback" not in result.stderr
        assert "unexpected" not in result.stderr, result.stderr
        assert result.returncode in (0, 1, 2)
