"""The cache of machine code never lies: what is stale, torn or another's is compiled anew."""

import errno
import importlib.metadata
import os
import shutil
import subprocess
import sys
import types
from pathlib import Path

import fuzzing
import llvmlite
import llvmlite.binding as llvm
import numpy as np
import pytest
from cli_runner import environment
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pmopt
from pmopt.numerics import compiled

SOURCE = Path(pmopt.__file__).parent
TEXT = """
import numba

@numba.njit(inline="always")
def factor():
    return {factor}

@numba.njit
def scale(values):
    for i in range(values.shape[0]):
        values[i] *= factor()

@numba.njit
def shift(values):
    for i in range(values.shape[0]):
        values[i] += factor()
"""
ENTRIES = [compiled.Entry(name, ("float64[:]",)) for name in ("scale", "shift")]


def kernels(factor=3.0):
    return compiled.Compiled(TEXT.format(factor=factor), ENTRIES)


def called(module, name="scale"):
    values = np.array([1.0, 2.0])
    getattr(module, name)(values)
    return values.tolist()


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """Return a cache that holds both entries."""
    folder = tmp_path_factory.mktemp("kept")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PMOPT_CACHE_DIR", str(folder))
        module = kernels()
        assert [called(module), called(module, "shift")] == [[3.0, 6.0], [4.0, 5.0]]
    return folder


@pytest.fixture
def cache(kept, tmp_path, monkeypatch):
    """Return a copy of it, and count what is compiled."""
    shutil.copytree(kept, tmp_path / "cache")
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path / "cache"))
    made = []
    compile_one = compiled.Compiled._compile
    monkeypatch.setattr(
        compiled.Compiled, "_compile",
        lambda self, entry: made.append(entry.name) or compile_one(self, entry),
    )  # fmt: skip
    return types.SimpleNamespace(folder=tmp_path / "cache", made=made)


def test_what_is_kept_is_loaded(cache):
    assert called(kernels()) == [3.0, 6.0]
    assert cache.made == []


def test_an_edit_is_compiled(cache):
    assert called(kernels(5.0)) == [5.0, 10.0]
    assert cache.made == ["scale"]


PARTS = {
    "numba": lambda m: m.setattr(importlib.metadata, "version", lambda _: "0.0"),
    "llvmlite": lambda m: m.setattr(llvmlite, "__version__", "0.0"),
    "numpy": lambda m: m.setattr(np, "__version__", "0.0"),
    "python": lambda m: m.setattr(sys, "version", "2.7"),
    "processor": lambda m: m.setattr(llvm, "get_host_cpu_name", lambda: "i386"),
    "its features": lambda m: m.setattr(
        llvm, "get_host_cpu_features", lambda: types.SimpleNamespace(flatten=lambda: "+x87")
    ),
    "settings of numba": lambda m: m.setenv("NUMBA_OPT", "0"),
}


@pytest.mark.parametrize("part", PARTS)
def test_machine_code_of_another_machine_is_not_taken(cache, monkeypatch, part):
    """Other versions, another processor: another folder, so that what is kept is not seen."""
    before = kernels().folder
    with monkeypatch.context() as patch:
        PARTS[part](patch)
        compiled._machine.cache_clear()
        after = kernels().folder
    compiled._machine.cache_clear()
    assert after != before
    assert kernels().folder == before


FOLDERS = """
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sweeper import Sweeper
from pmopt.mechanisms import find, names
from pmopt.numerics import cells
from pmopt.numerics.assembly import load
for name in names():
    mechanism = find(name)
    print(name, "assembly", load(mechanism.assembler).folder.name)
    for sampler in ("r-sequence", *(["lines"] if mechanism.line else [])):
        settings = WorkspaceSettings(
            sampler=sampler, link_diameter=0.1, cone_angle=1.0 if mechanism.cones else None)
        sweeper = Sweeper(mechanism, settings)
        print(name, sampler, *sorted(k.folder.name for k in sweeper.kernels))
print("cells", "all", cells.kernels().folder.name)
"""
#: Kernel files, what of them is edited, and whose folders have to change.
EDITS = {
    "numerics/sweep.py": ("TWO_POW_M52 = 1.0", "TWO_POW_M52 = 2.0"),
    "numerics/condition.py": ("0.5 *", "0.25 *"),
    "numerics/clearance.py": ("0.0", "0.125"),
    "numerics/trigonometry.py": ("0.5", "0.25"),
    "numerics/strokes.py": ("<", ">"),
    "numerics/compiled.py": ("opt=3", "opt=2"),
    "numerics/cells.py": ("range(", "range(0 + "),
    "numerics/octics.py": ("60", "61"),
    "numerics/assembly.py": ("0.0", "0.125"),
    **{f"mechanisms/{p.name}": ("1.0", "1.5") for p in (SOURCE / "mechanisms").glob("*_*.py")
       if "MECHANISM =" in p.read_text(encoding="utf-8")},
    **{f"mechanisms/{p.name}": ("0.5", "0.75")
       for p in (SOURCE / "mechanisms").glob("*_forward.py")},
    "mechanisms/cur.py": ("1.0", "1.5"),
}  # fmt: skip


def folders_of(source):
    done = subprocess.run(
        [sys.executable, "-c", FOLDERS], env=environment(PYTHONPATH=str(source)), text=True,
        capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return {tuple(line.split()[:2]): line for line in done.stdout.splitlines()}


@pytest.fixture(scope="module")
def unedited():
    return folders_of(SOURCE.parent)


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_in_any_kernel_file_is_another_folder(unedited, tmp_path, name):
    """In a copy of the package, in a process of its own."""
    shutil.copytree(SOURCE, tmp_path / "pmopt", ignore=shutil.ignore_patterns("__pycache__"))
    assert folders_of(tmp_path) == unedited  # a place is no edit
    path, (old, new) = tmp_path / "pmopt" / name, EDITS[name]
    text = path.read_text(encoding="utf-8")
    assert old in text
    body = text.index("def ") if old in text[text.index("def ") :] else 0
    path.write_text(text[:body] + text[body:].replace(old, new), encoding="utf-8")
    changed = {key for key, line in folders_of(tmp_path).items() if line != unedited[key]}
    assert changed
    if name in ("numerics/sweep.py", "numerics/compiled.py"):
        # Cells and forward kinematics have nothing of the sweep.
        assert changed >= {key for key in unedited if key[1] not in ("all", "assembly")}


@settings(max_examples=40, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_a_damaged_file_is_compiled_anew(kept, data):
    """Any bytes in its place: LLVM would end the process on half a file, or run what is in it."""
    with fuzzing.folder() as cwd, pytest.MonkeyPatch.context() as patch:
        shutil.copytree(kept, cwd / "cache")
        patch.setenv("PMOPT_CACHE_DIR", str(cwd / "cache"))
        (path,) = cwd.glob("cache/*/scale.o")
        whole = path.read_bytes()
        damaged = data.draw(fuzzing.mangled(whole) | st.binary(max_size=200))
        path.write_bytes(damaged)
        made = []
        patch.setattr(
            compiled, "_object_code", lambda entry, _: made.append(entry.name) or whole[32:]
        )
        assert called(kernels()) == [3.0, 6.0]
        assert made == ([] if damaged == whole else ["scale"])
        assert path.read_bytes() == whole


def test_the_code_of_another_entry_or_text_is_not_run(cache):
    """A whole file in a wrong place."""
    (path,) = cache.folder.glob("*/scale.o")
    shutil.copy(path.with_name("shift.o"), path)
    assert called(kernels()) == [3.0, 6.0]
    other = kernels(5.0)
    other.folder.mkdir()
    shutil.copy(path, other.folder / "scale.o")
    assert called(other) == [5.0, 10.0]
    assert cache.made == ["scale", "scale"]


def refuse(*_, **__):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("call", ["mkdir", "mkstemp", "replace"])
def test_a_full_cache_costs_time_only(cache, monkeypatch, call):
    owner = {"mkdir": Path, "mkstemp": compiled.tempfile, "replace": compiled.os}[call]
    with monkeypatch.context() as patch:
        patch.setattr(owner, call, refuse)
        assert called(kernels(7.0)) == [7.0, 14.0]
    assert not list(cache.folder.rglob("*.tmp"))
    assert not list(cache.folder.rglob("*.o")) or len(list(cache.folder.rglob("*.o"))) == 2
    assert called(kernels(7.0)) == [7.0, 14.0]
    assert cache.made == ["scale", "scale"]


#: Compiles one small entry.
SCRIPT = """
import numpy as np
from pmopt.numerics import cells
print(cells.hull(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0], [0.5, 0.5]])).tolist())
"""


def begin(cache):
    """Start a process with a cache of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT], env=environment(PMOPT_CACHE_DIR=str(cache)), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def test_a_full_disk_under_the_cache(tmp_path):
    """A process whose cache holds 8 kB gives the same numbers."""
    folder = tmp_path / "cache"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", str(folder)]
    try:
        if subprocess.run(command, capture_output=True).returncode:
            pytest.skip("mounting is not allowed here")
    except FileNotFoundError:
        pytest.skip("there is no mount here")
    try:
        full, usual = (begin(cache).communicate() for cache in (folder, tmp_path / "usual"))
        assert full == usual
        assert len(list(tmp_path.glob("usual/*/chain.o"))) == 1
        assert not list(folder.rglob("*.o"))
        assert not list(folder.rglob("*.tmp"))
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_processes_that_begin_at_once(tmp_path):
    """Four on an empty cache: the same numbers, and a cache that the next one takes whole."""
    answers = [process.communicate() for process in [begin(tmp_path) for _ in range(4)]]
    assert set(answers) == {("[[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]]\n", "")}
    (path,) = tmp_path.rglob("*.o")
    assert not list(tmp_path.rglob("*.tmp"))
    stamp = path.stat().st_mtime_ns
    assert begin(tmp_path).communicate() == answers[0]
    assert path.stat().st_mtime_ns == stamp
