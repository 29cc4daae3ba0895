"""The cache of machine code never lies: what is stale, torn or another's is compiled anew."""

import errno
import importlib.metadata
import os
import shutil
import subprocess
import sys
import types
from pathlib import Path

import llvmlite
import llvmlite.binding as llvm
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import fuzzing
from support.cli_runner import environment

import pmopt
from pmopt.compiler import machine_code

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
ENTRIES = [machine_code.Entry(name, ("float64[:]",)) for name in ("scale", "shift")]


def kernels(factor=3.0):
    return machine_code.Compiled(TEXT.format(factor=factor), ENTRIES)


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
    compile_one = machine_code.Compiled._compile
    monkeypatch.setattr(
        machine_code.Compiled, "_compile",
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
        machine_code._machine.cache_clear()
        after = kernels().folder
    machine_code._machine.cache_clear()
    assert after != before
    assert kernels().folder == before


@pytest.mark.skipif(
    not all(llvm.get_host_cpu_features().get(n) for n in machine_code._NEEDED),
    reason="an older one",
)
def test_code_for_another_kind_of_processor_is_another_folder(cache, monkeypatch):
    """It is made in a process of its own where numba has settled here, and is the same for all."""
    host = kernels()
    monkeypatch.setenv("PMOPT_TARGET", "haswell")
    fixed = kernels()
    assert fixed.folder != host.folder
    monkeypatch.setattr(machine_code, "_numba_target", [])  # another has imported numba
    monkeypatch.setitem(sys.modules, "numba", types.ModuleType("numba"))
    assert called(fixed) == [3.0, 6.0]
    assert cache.made == ["scale"]
    monkeypatch.setattr(llvm, "get_host_cpu_name", lambda: "znver9")
    assert kernels().folder == fixed.folder


FOLDERS = """
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.motion.dynamics import Mover
from pmopt.mechanisms import find, names
from pmopt.compiler import programs
for name in names():
    mechanism = find(name)
    print(name, "assembly", programs.assembling(mechanism.assembler).folder.name)
    if mechanism.inverter is not None:
        print(name, "inverse", programs.assembling(mechanism.inverter).folder.name)
    moves = Mover(mechanism, mechanism.resolve({}), mechanism.working_modes[0])._kernel
    for compiled, part in moves.parts("move_all"):
        print(name, part, compiled.folder.name)
    for sampler in ("r-sequence", *(["lines"] if mechanism.line else [])):
        settings = WorkspaceSettings(
            sampler=sampler, link_diameter=0.1, cone_angle=1.0 if mechanism.cones else None)
        evaluator = make_sampler(mechanism, settings).evaluator
        for kernels, entries in evaluator.kernels.items():
            for entry in entries:
                for compiled, part in kernels.parts(entry):
                    print(name, part, sampler, compiled.folder.name)
for made in (programs.counting(), programs.searching(), programs.enclosing()):
    print("shared", *(e.name for e in made.entries), made.folder.name)
"""
CATALOGUE = "mechanisms/catalogue"
EVERYTHING = None
#: Kernel files, what of them is edited, and which pieces change, where not all that have it are.
CHANGED = {
    "kernels/sweep.py": {"fill"},
    "kernels/pieces.py": {"margins"},
    "kernels/conditioning.py": {"indices", "conditions"},
    "kernels/segment_distance.py": {"margins", "evaluations", "placed", "probe"},
    "kernels/strokes.py": {"lines"},
    "kernels/inverse_dynamics.py": {"move_all"},
    "kernels/assembly.py": {"assembly"},
    "kernels/cells.py": {"lattice"},
    "kernels/ascent.py": {"advance"},
    "kernels/affine_forms.py": {"evaluate"},
    "compiler/machine_code.py": EVERYTHING,
    "compiler/whole_program.py": EVERYTHING,
    "compiler/lowering/operations.py": EVERYTHING,
    "compiler/lowering/statements.py": EVERYTHING,
}
#: What of them is edited.
EDITS = {
    "kernels/sweep.py": ("TWO_POW_M52 = 1.0", "TWO_POW_M52 = 2.0"),
    "kernels/conditioning.py": ("0.5 *", "0.25 *"),
    "kernels/segment_distance.py": ("0.0", "0.125"),
    "kernels/trigonometry.py": ("0.5", "0.25"),
    "kernels/strokes.py": ("<", ">"),
    "compiler/machine_code.py": ("opt=3", "opt=2"),
    "compiler/whole_program.py": ("return 0", "return 1"),
    "kernels/cells.py": ("range(", "range(0 + "),
    "kernels/pieces.py": ("margin[i] = margin_of", "margin[i] = 1.0 * margin_of"),
    "kernels/inverse_dynamics.py": ("dot *= 2.0", "dot *= 1.0"),
    "kernels/ascent.py": ("height < low", "height > low"),
    "kernels/affine_forms.py": ("2.0 * EPS", "1.0 * EPS"),
    "compiler/lowering/operations.py": ('"fadd"', '"fsub"'),
    "compiler/lowering/statements.py": ("add nsw", "add"),
    "kernels/octics.py": ("60", "61"),
    "kernels/assembly.py": ("0.0", "0.125"),
    **{f"{CATALOGUE}/{name}.py": ("1.0", "1.5")
       for name in ("ups_rps", "ups_sp", "uu_upu_inverse", "cur_inverse")},
    **{f"{CATALOGUE}/{p.name}": ("1.0", "1.5") for p in (SOURCE / CATALOGUE).glob("*_kernel.py")},
    **{f"{CATALOGUE}/{p.name}": ("0.5", "0.75")
       for p in (SOURCE / CATALOGUE).glob("*_forward.py")},
    f"{CATALOGUE}/pauu_ppap.py": ("0.5 *", "0.25 *"),
    f"{CATALOGUE}/cur_structure.py": ("ra * CUR_C2", "ra * CUR_S2"),
}  # fmt: skip


def folders_of(source):
    done = subprocess.run(
        [sys.executable, "-c", FOLDERS], env=environment(PYTHONPATH=str(source)), text=True,
        capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return {tuple(line.split()[:-1]): line for line in done.stdout.splitlines()}


@pytest.fixture(scope="module")
def unedited():
    return folders_of(SOURCE.parent)


@pytest.mark.parametrize("name", EDITS)
@pytest.mark.slow
def test_an_edit_in_any_kernel_file_is_another_folder(unedited, tmp_path, name):
    """In a copy of the package, in a process of its own."""
    shutil.copytree(SOURCE, tmp_path / "pmopt", ignore=shutil.ignore_patterns("__pycache__"))
    if name == "kernels/sweep.py":
        assert folders_of(tmp_path) == unedited  # a place is no edit
    path, (old, new) = tmp_path / "pmopt" / name, EDITS[name]
    text = path.read_text(encoding="utf-8")
    assert old in text
    body = text.index("def ") if old in text[text.index("def ") :] else 0
    path.write_text(text[:body] + text[body:].replace(old, new), encoding="utf-8")
    changed = {key for key, line in folders_of(tmp_path).items() if line != unedited[key]}
    assert changed
    if name in CHANGED:
        expected = CHANGED[name]
        assert changed == unedited.keys() if expected is EVERYTHING else True
        assert expected is EVERYTHING or {key[1] for key in changed} <= expected


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
            machine_code.Compiled, "_compile",
            lambda self, entry: made.append(entry.name) or whole[32:],
        )  # fmt: skip
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
    owner = {"mkdir": Path, "mkstemp": machine_code.tempfile, "replace": machine_code.os}[call]
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
from pmopt.analysis.sampling import cells
print(cells.hull(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0], [0.5, 0.5]])).tolist())
"""


def begin(cache):
    """Start a process with a cache of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT], env=environment(PMOPT_CACHE_DIR=str(cache)), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@pytest.mark.slow
def test_a_full_disk_under_the_cache(tmp_path):
    """A process whose cache holds 4 kB gives the same numbers."""
    folder = tmp_path / "cache"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4k", "tmpfs", str(folder)]
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


@pytest.mark.slow
def test_processes_that_begin_at_once(tmp_path):
    """Four on an empty cache: the same numbers, and a cache that the next one takes whole."""
    answers = [process.communicate() for process in [begin(tmp_path) for _ in range(4)]]
    assert set(answers) == {("[[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]]\n", "")}
    (path,) = tmp_path.rglob("*.o")
    assert not list(tmp_path.rglob("*.tmp"))
    stamp = path.stat().st_mtime_ns
    assert begin(tmp_path).communicate() == answers[0]
    assert path.stat().st_mtime_ns == stamp


# --- caches that are shared, foreign or not there -----------------------------------------------


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Return the folder for temporary files that is this user's own."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(machine_code.tempfile, "gettempdir", lambda: str(folder))
    return folder / f"pmopt-{os.geteuid()}"


def writable_by_others(path):
    path.chmod(0o664)


def of_another_user(path):
    if os.geteuid():
        pytest.skip("only root can give a file away")
    os.chown(path, 12345, 12345)


def pipe(path):
    path.unlink()
    os.mkfifo(path)


def folder_of_that_name(path):
    path.unlink()
    path.mkdir()


def sparse(path):
    with path.open("r+b") as stream:
        stream.truncate(1 << 30)


@pytest.mark.parametrize("change", [
    writable_by_others, of_another_user, pipe, folder_of_that_name, sparse,
])  # fmt: skip
def test_machine_code_of_others_is_not_run(cache, own, change):
    """It is compiled anew, once, and put aside; what is another's stays as it is."""
    (path,) = cache.folder.glob("*/scale.o")
    change(path)
    before = path.lstat()
    for _ in range(2):
        assert called(kernels()) == [3.0, 6.0]
        assert cache.made == ["scale"]
    assert path.lstat() == before
    assert [p.name for p in own.rglob("*.o")] == ["scale.o"]
    assert own.stat().st_mode & 0o777 == 0o700
    assert called(kernels(), "shift") == [4.0, 5.0]
    assert cache.made == ["scale"]


def a_file(path):
    path.write_text("mine")


def a_link_to_nowhere(path):
    path.symlink_to(path.with_name("nowhere") / "deeper")


@pytest.mark.parametrize("kind", [a_file, a_link_to_nowhere])
def test_no_folder_where_the_cache_should_be(cache, own, tmp_path, monkeypatch, kind):
    place = tmp_path / "strange"
    kind(place)
    before = place.lstat()
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(place))
    for _ in range(2):
        assert called(kernels()) == [3.0, 6.0]
    assert cache.made == ["scale"]
    assert place.lstat() == before
    assert [p.name for p in own.rglob("*.o")] == ["scale.o"]


@pytest.mark.parametrize("kind", ["file", "link", "open to others", "foreign"])
def test_a_folder_that_is_not_this_users_own_is_not_used(cache, own, tmp_path, monkeypatch, kind):
    place = tmp_path / "strange"
    place.write_text("")
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(place))
    if kind == "file":
        own.write_text("")
    elif kind == "link":
        (tmp_path / "elsewhere").mkdir()
        own.symlink_to(tmp_path / "elsewhere")
    else:
        own.mkdir()
        own.chmod(0o777 if kind == "open to others" else 0o755)
        if kind == "foreign":
            of_another_user(own)
    for _ in range(2):
        assert called(kernels()) == [3.0, 6.0]
    assert cache.made == ["scale", "scale"]
    assert not list(own.rglob("*.o"))


@pytest.mark.parametrize(("umask", "mode"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o644)])
def test_files_of_the_cache_are_nobody_elses_to_write(tmp_path, monkeypatch, umask, mode):
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(machine_code, "_object_code_of", lambda text, vectors: b"code")
    monkeypatch.setattr(machine_code, "_load", lambda code: 1)
    before = os.umask(umask)
    machine_code._umask.cache_clear()
    try:
        kernels().scale  # noqa: B018
    finally:
        os.umask(before)
        machine_code._umask.cache_clear()
    found = [p for p in (tmp_path / "cache").rglob("*") if p.is_file()]
    assert sorted(p.name for p in found) == ["kernels.py", "scale.o"]
    assert {p.stat().st_mode & 0o777 for p in found} == {mode}


#: Another user, who may read what this one may: the interpreter may be in a home.
OTHER = ["setpriv", "--reuid", "12345", "--regid", "12345", "--clear-groups",
         "--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search"]  # fmt: skip


@pytest.fixture
def other():
    """Return the words that make a command another user's, without a home or a name."""
    if not shutil.which("setpriv") or subprocess.run([*OTHER, "true"]).returncode:
        pytest.skip("there is no other user to be")
    if subprocess.run([*OTHER, sys.executable, "-c", "import pmopt"], cwd="/").returncode:
        pytest.skip("another user cannot read this installation")
    return [*OTHER, "env", "-i", f"PATH={os.environ['PATH']}", "NUMBA_NUM_THREADS=1"]


def as_other(other, *settings, cwd):
    return subprocess.run([*other, *settings, sys.executable, "-c", SCRIPT], cwd=cwd, text=True,
                          capture_output=True)  # fmt: skip


def folders_for_all(tmp_path, *names):
    """Return new folders that every user can reach and write."""
    for path in (tmp_path, *list(tmp_path.parents)[:3]):
        path.chmod(path.stat().st_mode | 0o011)
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name).chmod(0o1777)
        yield tmp_path / name


def test_two_users_of_one_cache(other, tmp_path):
    """Neither runs the other's code, each keeps its own."""
    shared, temporary = folders_for_all(tmp_path, "shared", "temporary")
    here = (f"PMOPT_CACHE_DIR={shared}", f"TMPDIR={temporary}")
    first = as_other(other, *here, cwd=tmp_path)
    assert (first.stdout, first.stderr) == ("[[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]]\n", "")
    (path,) = shared.rglob("*.o")
    assert path.stat().st_uid == 12345
    before = path.stat()
    env = environment(PMOPT_CACHE_DIR=str(shared), TMPDIR=str(temporary))
    for _ in range(2):
        second = subprocess.run([sys.executable, "-c", SCRIPT], env=env, text=True,
                                capture_output=True)  # fmt: skip
        assert (second.stdout, second.stderr) == (first.stdout, "")
    assert path.stat() == before
    if os.geteuid() == 0:
        (mine,) = temporary.rglob("*.o")
        assert (mine.stat().st_uid, mine.parents[1].name) == (0, "pmopt-0")


def test_a_user_without_home_and_name(other, tmp_path):
    """Nothing is written into the working folder; the second time nothing is compiled."""
    work, temporary = folders_for_all(tmp_path, "work", "temporary")
    stamps = []
    for _ in range(2):
        done = as_other(other, f"TMPDIR={temporary}", cwd=work)
        assert (done.returncode, done.stderr) == (0, "")
        (path,) = temporary.rglob("*.o")
        assert path.parents[1].name == "pmopt-12345"
        stamps.append(path.stat().st_mtime_ns)
    assert stamps[0] == stamps[1]
    assert list(work.iterdir()) == []
