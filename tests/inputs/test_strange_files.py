"""Whatever lies where a file is read: one line in little time, to every command that reads one."""

import json
import os
import shutil
import socket
import subprocess
import threading
import warnings

import pytest
from support.cli_runner import CONFIGS, SEARCH, environment, error_line, here, pmopt
from support.strange import STRANGE, empty, in_time

from pmopt.inputs import reading
from pmopt.reporting.runs import run_pictures, workspace_checkpoint

MECH = "2pauu-ppap"
POSE = ("--pose", "x=0,y=0,z=1.6")
BATCH = (
    'command = "workspace"\nmechanism = "2pauu-ppap"\nshape_grid = 0\n'
    "[workspace]\nsamples = 1000\n[sweep]\nseed = [1, 2]\n"
)
MOTION = 'mechanism = "2pauu-ppap"\n[trajectory]\nfile = "given"\n'


def a_socket(path):
    with socket.socket(socket.AF_UNIX) as made:
        short = f"/tmp/pmopt-{os.getpid()}.socket"  # longer names are not taken
        made.bind(short)
    shutil.move(short, path)


def device(path):
    path.symlink_to("/dev/zero")


def zeros(path):
    path.write_bytes(b"a = 1\n" + b"\0" * 1000)


def cut(path):
    path.write_text('{"command": "workspace", "config": {"mechanism": "2pauu-pp')


def numbers(path):
    path.write_text('{"a": 1e999, "b": 1' + "0" * 3000 + "}")


def half_a_character(path):
    path.write_text('{"command": "\\ud83d", "parameters": {"\\ud83d": 1}}')


def one_line(path):
    path.write_text(" " * 100_000 + "(")


def digits(path):
    path.write_text("x,y,z\n" + "1" * 100_000 + ",0,1\n")


def tables(path):
    path.write_text(f"a{'.a' * 100_000} = 1\n")


def sparse_behind_a_head(path):
    path.write_text("x,y,z\n0,0,1.6\n")
    os.truncate(path, 1 << 30)


ALL = [*STRANGE, a_socket, device, zeros, cut, numbers, half_a_character, one_line, digits, tables,
       sparse_behind_a_head]  # fmt: skip

#: Commands that are given the file itself, as ``given`` with a suffix.
GIVEN = {
    "poses": ("ik", MECH, "--poses", "given.csv"),
    "joints": ("fk", MECH, "--joints-file", "given.csv"),
    "path": ("singularities", MECH, "--path", "given.csv"),
    "search": ("pareto", "given.toml", "--dry-run"),
    "motion": ("motion", "given.toml"),
    "simulate": ("simulate", "given.toml"),
    "batch": ("batch", "given.toml", "--out", "out"),
    "design": ("ik", MECH, *POSE, "--params", "@given.toml"),
    "result": ("ik", MECH, *POSE, "--params", "@given.json"),
    "front": ("ik", MECH, *POSE, "--params", "@given.csv:1"),
    "best": ("ik", MECH, *POSE, "--params", "@given.csv:best-volume"),
    "mechanism": ("info", "given.toml"),
}


def check(result, given=False):
    for text in ("Traceback", "unexpected"):
        assert text not in result.stderr + result.stdout
    assert result.returncode in (0, 1, 2)
    assert all(len(line) < 2100 for line in result.stderr.splitlines())
    if given:
        error_line(result)


@pytest.mark.parametrize("strange", ALL)
def test_a_file_that_is_given(strange, tmp_path, monkeypatch):
    monkeypatch.setattr(reading, "_WAIT", 0.1)
    for name, words in GIVEN.items():
        place = (
            tmp_path / name / next(w.lstrip("@").partition(":")[0] for w in words if "given" in w)
        )
        place.parent.mkdir()
        strange(place)
        nothing = name == "design" and strange is empty  # all at their defaults
        check(in_time(*words, "--quiet", cwd=place.parent), given=not nothing)


@pytest.mark.parametrize("strange", ALL)
def test_a_recording(strange, tmp_path):
    (tmp_path / "motion.toml").write_text(MOTION)
    strange(tmp_path / "given")
    for words in (("motion",), ("batch", "--out", "out")):
        result = in_time(words[0], "motion.toml", *words[1:], "--quiet", cwd=tmp_path)
        check(result, given=True)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with a run of each command that can be taken up or read."""
    home = tmp_path_factory.mktemp("runs")
    (home / "search.toml").write_text(SEARCH)
    (home / "batch.toml").write_text(BATCH)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workspace_checkpoint, "EVERY", 0.0)
        for words in (
            ("pareto", "search.toml", "--out", "search"),
            ("workspace", MECH, "--samples", 3 * 2**22, "--shape-grid", 0, "--out", "long"),
            ("batch", "batch.toml", "--out", "batch", "--workers", 1),
        ):
            assert here(*words, "--quiet", cwd=home).returncode == 0
    (home / "long" / "manifest.json").unlink()
    assert (home / "long" / "checkpoint" / "run.json").exists()
    return home


LONG = ("workspace", MECH, "--samples", 3 * 2**22, "--shape-grid", 0, "--out", "long", "--resume")
IN_RUNS = {
    "search/manifest.json": [
        ("plot", "search"),
        ("pareto", "search.toml", "--out", "search", "--resume"),
        ("ik", MECH, *POSE, "--params", "@search:knee"),
        ("ik", MECH, *POSE, "--params", "@search/manifest.json:1"),
    ],
    "search/front.csv": [
        ("plot", "search"),
        ("ik", MECH, *POSE, "--params", "@search:best-volume"),
        ("ik", MECH, *POSE, "--params", "@search:1"),
    ],
    "search/history.csv": [("plot", "search")],
    "long/checkpoint": [LONG],
    "long/checkpoint/run.json": [LONG],
    "long/checkpoint/chunk-0000003.bin": [LONG],
    "long/manifest.json": [LONG, ("plot", "long")],
    "batch/batch.json": [
        ("batch", "--merge", "batch", "--out", "merged"),
        ("batch", "batch.toml", "--out", "batch", "--resume", "--workers", 1),
    ],
    "batch/manifest.json": [("batch", "batch.toml", "--out", "batch", "--resume", "--workers", 1)],
    "batch/runs/batch-seed=1": [("batch", "--merge", "batch", "--out", "merged")],
    "batch/runs/batch-seed=1/manifest.json": [
        ("batch", "--merge", "batch", "--out", "merged"),
        ("batch", "batch.toml", "--out", "batch", "--resume", "--workers", 1),
    ],
    "batch/runs/batch-seed=1/result.json": [("batch", "--merge", "batch", "--out", "merged")],
}


def laid(home, runs, name, strange):
    """Put something strange into a copy of the runs."""
    subprocess.run(["cp", "-a", str(runs), str(home)], check=True)
    place = home / name
    shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
    strange(place)


def look(home, runs, name, strange, every):
    """Let commands that read a file of a run find something strange in its place."""
    for k, words in enumerate(IN_RUNS[name]):
        if every or k == ALL.index(strange) % len(IN_RUNS[name]):
            laid(home / f"{strange.__name__}{k}", runs, name, strange)
            check(in_time(*words, "--quiet", cwd=home / f"{strange.__name__}{k}"))


@pytest.fixture(autouse=True)
def nothing_drawn(monkeypatch):
    monkeypatch.setattr(run_pictures, "of_workspace", lambda *_: {"picture.png": b"drawn"})


@pytest.mark.parametrize("name", IN_RUNS)
def test_a_file_of_a_run(name, runs, tmp_path):
    for strange in ALL[list(IN_RUNS).index(name) % 4 :: 4]:
        look(tmp_path, runs, name, strange, every=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", IN_RUNS)
def test_a_file_of_a_run_to_all(name, runs, tmp_path):
    for strange in ALL:
        look(tmp_path, runs, name, strange, every=True)


BAD = [None, True, -1, 1e300, "text", "", [], [1], {}, {"a": 1}, [{}], 2**63, "x" * 5000]


def places(document, path=()):
    """Yield the path of every value within a document, of lists the first ones only."""
    yield path
    items = document.items() if isinstance(document, dict) else enumerate(document[:2])
    for key, value in items:
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))
        else:
            yield (*path, key)


def changed(text, path, value):
    """Return a document with another value, or none, at a path."""
    document = json.loads(text)
    if not path:
        return json.dumps(value)
    table = document
    for key in path[:-1]:
        table = table[key]
    if value is KeyError:
        del table[path[-1]]
    else:
        table[path[-1]] = value
    return json.dumps(document)


DAMAGED = {
    ("search/manifest.json", ("command", "config", "result")): [
        ("ik", MECH, *POSE, "--params", "@search:knee"),
        ("ik", MECH, *POSE, "--params", "@search/manifest.json:3"),
        ("ik", MECH, *POSE, "--params", "@search"),
        ("pareto", "search.toml", "--out", "search"),
    ],
    ("batch/batch.json", ("schema", "shard", "runs")): [
        ("batch", "--merge", "batch", "--out", "merged", "--force"),
        ("batch", "batch.toml", "--out", "batch", "--dry-run"),
    ],
    ("batch/runs/batch-seed=1/manifest.json", ("command", "config")): [
        ("batch", "--merge", "batch", "--out", "merged", "--force"),
        ("batch", "batch.toml", "--out", "batch", "--dry-run"),
    ],
    ("batch/runs/batch-seed=1/result.json", ("volume", "gci", "samples", "reachable")): [
        ("batch", "--merge", "batch", "--out", "merged", "--force"),
    ],
}


@pytest.mark.parametrize(("name", "keys"), DAMAGED)
def test_a_value_of_another_kind(name, keys, runs, tmp_path):
    """At each key, with each of the commands in turn."""
    shutil.copytree(runs, tmp_path / "home", symlinks=True)
    path = tmp_path / "home" / name
    text = path.read_text()
    commands = DAMAGED[name, keys]
    count = 0
    for place in places(json.loads(text)):
        if place and place[0] not in keys:
            continue
        for value in [*BAD, *([KeyError] if place else [])]:
            count += 1
            if count % 3:  # a third of them, spread over keys, values and commands
                continue
            path.write_text(changed(text, place, value))
            words = commands[count // 3 % len(commands)]
            check(here(*words, "--quiet", cwd=tmp_path / "home"))


@pytest.mark.parametrize("cell", ["inf", "1e308", "nan", "", "text"])
def test_a_cell_of_another_kind(cell, runs, tmp_path):
    """Drawn or refused, never with a warning of what draws."""
    shutil.copytree(runs / "search", tmp_path / "run")
    path = tmp_path / "run" / "front.csv"
    head, first, *rest = path.read_text().splitlines()
    for k, name in enumerate(head.split(",")):
        cells = first.split(",")
        cells[k] = cell
        path.write_text("\n".join([head, ",".join(cells), *rest]) + "\n")
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            result = here("plot", "run", "--out", "pictures", "--quiet", cwd=tmp_path)
        check(result)
        if cell in ("inf", "1e308"):
            assert "front.csv has a number" in error_line(result), name
        words = ("ik", MECH, *POSE, "--params", "@run:best-volume", "--quiet")
        check(here(*words, cwd=tmp_path))


def test_a_pipe_that_is_written(tmp_path):
    """What ``<(command)`` gives is read, whenever it comes."""
    (tmp_path / "poses.csv").write_text("x,y,z\n0,0,1.6\n0.1,0,1.5\n")
    words = ("ik", MECH, "--format", "csv", "--poses")
    whole = pmopt(*words, "poses.csv", cwd=tmp_path)
    assert whole.returncode == 0
    os.mkfifo(tmp_path / "pipe")
    script = "(sleep 0.3; cat poses.csv) > pipe"
    writer = subprocess.Popen(["sh", "-c", script], cwd=tmp_path, env=environment())
    assert pmopt(*words, "pipe", cwd=tmp_path).stdout == whole.stdout
    assert writer.wait() == 0


def test_a_pipe_that_goes_on_and_on(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)

    def write():
        with open(path, "wb", buffering=0) as stream:
            try:
                while True:
                    stream.write(b"x" * 1000)
            except BrokenPipeError:
                pass

    writer = threading.Thread(target=write)
    writer.start()
    with pytest.raises(OSError, match="gives more than 100000 bytes"):
        reading.read_given(path, 100_000)
    writer.join(10)
    assert not writer.is_alive()


def test_a_file_that_may_not_be_read(monkeypatch, tmp_path):
    shutil.copy(CONFIGS / "quickstart.toml", tmp_path / "given.toml")
    (tmp_path / "given.csv").write_text("x,y,z\n0,0,1.6\n")
    (tmp_path / "given.json").write_text("{}")
    opened = os.open

    def refusing(path, *args, **options):
        if "given" in str(path):
            raise PermissionError(13, os.strerror(13), str(path))
        return opened(path, *args, **options)

    monkeypatch.setattr(reading.os, "open", refusing)
    for name, words in GIVEN.items():
        if name != "mechanism":
            line = error_line(here(*words, "--quiet", cwd=tmp_path))
            assert "Permission denied" in line
            assert "given" in line
