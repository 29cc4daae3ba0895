"""Disks that are full or read-only, links and names: one line, and nothing lost that was there."""

import errno
import os
import shlex
import shutil
import subprocess

import pytest
from support.cli_runner import COMMAND, SEARCH, environment, error_line, files_in, here, pmopt
from support.killing import outputs

import pmopt as package
from pmopt.reporting.runs import run_pictures, workspace_checkpoint
from pmopt.storage import files

MECH = "2pauu-ppap"
COMMANDS = {
    "pareto": ("pareto", "test.toml"),
    "workspace": ("workspace", MECH, "--samples", 3 * 2**22, "--shape-grid", 0),
}
KINDS = {
    "full": OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
    "read-only": OSError(errno.EROFS, os.strerror(errno.EROFS)),
}


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile the kernels; keep every block and draw next to nothing."""
    package.workspace(MECH, samples=1000, shape_grid=8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workspace_checkpoint, "EVERY", 0.0)
        for name in ("of_workspace", "of_pareto"):
            patch.setattr(run_pictures, name, lambda *_: {"picture.png": b"drawn"})
        yield


@pytest.fixture
def home(tmp_path):
    """Return a folder with a configuration."""
    (tmp_path / "test.toml").write_text(SEARCH)
    return tmp_path


class Disk:
    """Fails once so many files have been flushed to it."""

    def __init__(self, monkeypatch, room, error):
        self.room = room
        flush = os.fsync

        def fsync(handle):
            self.room -= 1
            if self.room < 0:
                raise error
            flush(handle)

        monkeypatch.setattr(files.os, "fsync", fsync)


def contents(folder):
    return {name: (folder / name).read_bytes() for name in files_in(folder)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", COMMANDS)
def test_full_at_any_file(home, command, kind, monkeypatch):
    """One line whichever file does not fit; with room again the run goes on to the same bytes."""
    words = (*COMMANDS[command], "--quiet", "--out")
    assert here(*words, "whole", cwd=home).returncode == 0
    for room in range(100):
        with monkeypatch.context() as patch:
            disk = Disk(patch, room, KINDS[kind])
            result = here(*words, "run", "--resume", cwd=home)
        if disk.room >= 0:
            break
        assert KINDS[kind].strerror in error_line(result, code=1)
        assert not list(home.rglob("*.pmopt-tmp"))
        assert not (home / "run" / "manifest.json").exists()
        # Outputs come all together or not at all.
        assert outputs(home / "run") == {} if (home / "run").exists() else True
        if room % 3 == 0:
            shutil.rmtree(home / "run")
    assert room > 5
    assert result.returncode == 0
    assert outputs(home / "run") == outputs(home / "whole")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_finished_run_is_there_until_another_one_fits(home, command, monkeypatch):
    """--force writes the first file of the new run before it takes anything of the old one."""
    words = (*COMMANDS[command], "--quiet", "--out", "run")
    assert here(*words, cwd=home).returncode == 0
    before = contents(home / "run")
    with monkeypatch.context() as patch:
        Disk(patch, 0, KINDS["full"])
        error_line(here(*words, "--force", "--seed", 5, cwd=home), code=1)
    assert contents(home / "run") == before


@pytest.fixture
def small_disk(tmp_path):
    """Mount a file system of 300 kB, where that is allowed."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True)
    except FileNotFoundError:
        pytest.skip("there is no mount here")
    if done.returncode:
        pytest.skip("mounting is not allowed here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.slow
def test_a_disk_that_is_full(home, small_disk):
    """As a process; with more room it goes on to the bytes of a run in one go."""
    long = SEARCH.replace("generations = 3", "generations = 200")
    (home / "test.toml").write_text(long)
    result = pmopt("pareto", "test.toml", "--out", "small/run", "--quiet", cwd=home)
    assert "No space left on device" in error_line(result, code=1)
    assert len(files_in(small_disk / "run" / "checkpoint")) > 10
    subprocess.run(["mount", "-o", "remount,size=9m", str(small_disk)], check=True)
    assert here("pareto", "test.toml", "--out", "small/run", "--resume", "--quiet",
                cwd=home).returncode == 0  # fmt: skip
    assert here("pareto", "test.toml", "--out", "whole", "--quiet", cwd=home).returncode == 0
    assert outputs(small_disk / "run") == outputs(home / "whole")
    before = contents(small_disk / "run")
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    for options in ("--force", "--resume"):
        (home / "test.toml").write_text(long.replace("= 200", "= 201"))
        result = pmopt("pareto", "test.toml", "--out", "small/run", options, "--quiet", cwd=home)
        assert "Read-only file system" in error_line(result, code=1)
        assert contents(small_disk / "run") == before


@pytest.mark.parametrize("command", COMMANDS)
def test_links(home, command):
    """A run's folder may be a link to a folder; what is in it is never written through one."""
    words = (*COMMANDS[command], "--quiet")
    elsewhere = home / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "generation-0000001.bin").write_bytes(b"mine")
    (elsewhere / "front.csv").write_bytes(b"mine")
    (home / "link").symlink_to(home / "target")
    assert "link" in error_line(here(*words, "--out", "link", cwd=home))
    (home / "target").mkdir()
    for name in ("front.csv", "regions.csv", "result.json", "manifest.json"):
        (home / "target" / name).symlink_to(elsewhere / "front.csv")
    assert here(*words, "--out", "link", cwd=home).returncode == 0
    written = "front.csv" if command == "pareto" else "result.json"
    assert not (home / "target" / written).is_symlink()
    (home / "run").mkdir()
    (home / "run" / "checkpoint").symlink_to(elsewhere)
    assert "is a link" in error_line(here(*words, "--out", "run", "--force", cwd=home))
    assert contents(elsewhere) == {"generation-0000001.bin": b"mine", "front.csv": b"mine"}


@pytest.mark.parametrize("name", ["", "\0", "x" * 300, "test.toml/run"])
@pytest.mark.parametrize("command", COMMANDS)
def test_names_that_are_none(home, command, name):
    result = here(*COMMANDS[command], "--out", name, "--quiet", cwd=home)
    error_line(result, code=result.returncode)
    assert result.returncode in (1, 2)
    assert files_in(home) == ["test.toml"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("words", [("list",), ("workspace", MECH, "--samples", "1000")])
def test_output_that_does_not_fit(tmp_path, words):
    with open("/dev/full", "w") as full:
        result = subprocess.run([*COMMAND, *words], cwd=tmp_path, env=environment(), text=True,
                                stdout=full, stderr=subprocess.PIPE)  # fmt: skip
    assert "No space left on device" in error_line(result, code=1)


@pytest.mark.slow
def test_no_output_at_all(tmp_path):
    """A run whose output is closed still writes its folder."""
    command = f"{shlex.join(COMMAND)} workspace {MECH} --samples 1000 --out run --quiet >&-"
    result = subprocess.run(command, shell=True, cwd=tmp_path, env=environment(), text=True,
                            capture_output=True)  # fmt: skip
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "run" / "manifest.json").exists()
