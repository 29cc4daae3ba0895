"""Compile generated kernel texts to machine code, keep it, and call it without numba.

A text is compiled by numba entry by entry, when an entry is first called. What is kept is the
object code; a later process loads it with llvmlite alone, in a few milliseconds where importing
numba takes half a second. The folder of a text is named after the hash of the text, the versions
of numba, llvmlite, NumPy and Python, what the environment tells numba, this file and the one by
which code is optimised, and the processor that code is made for: an edit anywhere changes the
folder, so that machine code cannot go stale. Files are written whole or not at all, so that
processes that begin at once on an empty cache do not meet half a file, and begin with a hash of
their place and content: what is cut short, altered or another entry's is compiled anew, never run.

Code is made for the processor at hand. Texts ask for no fast arithmetic, so that its bits are those
of code for any other. ``$PMOPT_TARGET`` says ``haswell`` for code that every x86-64 with AVX2 and
FMA runs: machines of several kinds then share one cache.

Machine code is taken from files that this user or root owns and that nobody else can write. Where
the cache has others, or cannot be written, a folder of this user's own is used beside it.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import importlib.metadata
import json
import os
import queue
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, Protocol

import numpy as np

from pmopt.compiler import lowering, whole_program
from pmopt.compiler.undisturbed import IDLE, undisturbed
from pmopt.compiler.whole_program import collecting_nothing, compiled_as_text

#: Symbols that numba's code refers to where it raises or frees. Entries do neither: each is bound
#: to ``abort``, so that a mistake ends the process and never goes on with wrong numbers.
_UNUSED = (
    "numba_gil_ensure", "numba_gil_release", "numba_unpickle", "numba_do_raise",
    "numba_runtime_build_excinfo_struct", "NRT_Free", "NRT_MemInfo_call_dtor", "NRT_Allocate",
    "NRT_MemInfo_alloc_safe_aligned",
)  # fmt: skip
#: Symbols that count references: arrays of a caller have no count, and a view of one asks for it.
#: Each is bound to a function without effect.
_IDLE = ("NRT_incref", "NRT_decref")
_SYMBOL = "pmopt_entry"
#: Begins a text without long loops: vectors would cost time, and more of it to be made.
SCALAR = "# Without vectors.\n"
#: Bytes of the hash that precedes object code in a file: LLVM ends the process on half a file.
_DIGEST = 32
#: Largest file of machine code that is read, in bytes.
_LARGEST = 1 << 27
#: Permissions of files and folders of the cache, less those that the umask takes: nobody else may
#: write what this user will run.
_FILE_MODE, _FOLDER_MODE = 0o644, 0o755
#: Settings of numba that leave machine code as it is.
_HARMLESS = ("NUMBA_NUM_THREADS", "NUMBA_CACHE_DIR", *IDLE)
_KINDS: dict[str, Any] = {
    "int64": ctypes.c_int64, "uint64": ctypes.c_uint64, "float64": ctypes.c_double,
    "uint8": ctypes.c_uint8, "int32": ctypes.c_int32,
}  # fmt: skip
#: LLVM's name of the oldest processor of its kind (2013), and what runs code for it.
FIXED = "haswell"
_NEEDED = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt")
#: What ``$PMOPT_TARGET`` may say; the first is the default.
TARGETS = ("host", FIXED)
#: What makes machine code of a text.
_SOURCES = (
    Path(__file__), Path(whole_program.__file__),
    *sorted(Path(lowering.__file__).parent.glob("*.py")),
)  # fmt: skip
#: As many kernels take another process longer than it takes to begin.
_WORTH_A_PROCESS = 4
_lock = threading.Lock()
_engines: list[Any] = []  # what keeps loaded machine code alive
_compiling = [0.0]  # s, spent on it by this process


def seconds_compiling() -> float:
    """Return the seconds that this process has spent on compiling, or on waiting for it."""
    return _compiling[0]


@contextlib.contextmanager
def _counted() -> Iterator[None]:
    """Count what is done as compilation."""
    began, before = time.monotonic(), _compiling[0]
    try:
        yield
    finally:
        _compiling[0] = before + time.monotonic() - began  # what is counted within, once


class Entry(NamedTuple):
    """A function of a text that can be called from outside.

    Attributes
    ----------
    name : str
    arguments : tuple of str
        ``"int64"``, ``"uint64"``, ``"float64"``, ``"uint8"``, ``"int32"`` or one of them with
        ``"[:]"``, ``"[:,:]"``, .. appended: a C-contiguous array. A number in place of a colon
        fixes the length of an axis, so that the compiler knows where rows lie and that they do not
        overlap. Entries return nothing (results go into arrays), allocate nothing (scratch space is
        an argument) and raise nothing.
    """

    name: str
    arguments: tuple[str, ...]


def cache_root() -> Path:
    """Return the folder of compiled kernels: ``$PMOPT_CACHE_DIR`` or the user's cache folder."""
    given = os.environ.get("PMOPT_CACHE_DIR")
    if given:
        return Path(given)
    from platformdirs import user_cache_path

    try:
        found = user_cache_path("pmopt", appauthor=False)
    except RuntimeError:  # a user without a home
        return own_root()
    return found if found.is_absolute() else own_root()  # older ones leave "~" as it is


def own_root() -> Path:
    """Return a folder for temporary files that is this user's alone, once it is made."""
    try:
        folder = tempfile.gettempdir()
    except OSError:  # there is none that can be written
        folder = "/tmp"
    return Path(folder) / f"pmopt-{os.geteuid()}"


def _roots() -> Iterator[Path]:
    """Yield where machine code may be kept: the cache, and a folder of this user's own."""
    first = cache_root()
    if first != own_root():
        yield first
    own = own_root()
    with contextlib.suppress(OSError):
        with contextlib.suppress(FileExistsError):
            own.mkdir(0o700)
        found = own.lstat()
        others = stat.S_IWGRP | stat.S_IWOTH
        ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid()
        if ours and not found.st_mode & others:
            yield own


def _read_trusted(path: Path) -> bytes | None:
    """Return the content of a file of the cache, empty where there is none.

    None for what cannot be read, or might be another user's: machine code in it is not run.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        return b""
    except OSError:
        return None
    try:
        with os.fdopen(handle, "rb") as stream:
            found = os.fstat(handle)
            ours = found.st_uid in (os.geteuid(), 0)
            others = found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
            if not stat.S_ISREG(found.st_mode) or not ours or others or found.st_size > _LARGEST:
                return None
            return stream.read(_LARGEST + 1)
    except OSError:
        return None


def _is_writable(folder: Path) -> bool:
    """Return whether a folder, or what it would be made in, can be written by this user."""
    for path in (folder, *folder.parents):
        if os.path.lexists(path):
            return path.is_dir() and os.access(path, os.W_OK | os.X_OK)
    return False


@functools.cache
def _machine() -> tuple[str, ...]:
    """Return what machine code depends on beside its text."""
    import llvmlite

    return (
        importlib.metadata.version("numba"),
        llvmlite.__version__,
        np.__version__,
        sys.version,
        *(path.read_text(encoding="utf-8") for path in _SOURCES),
        *(
            f"{k}={v}"
            for k, v in sorted(os.environ.items())
            if k.startswith("NUMBA_") and k not in _HARMLESS
        ),
    )


class Target(NamedTuple):
    """The processor that code is made for: LLVM's name of it, and what it has beside its own."""

    cpu: str
    features: str


def target() -> Target:
    """Return what code is made for: see ``$PMOPT_TARGET``.

    A processor that cannot run the code of :data:`FIXED` has its own.

    Raises
    ------
    ValueError
        Where ``$PMOPT_TARGET`` is none of :data:`TARGETS`.
    """
    import llvmlite.binding as llvm

    given = os.environ.get("PMOPT_TARGET") or TARGETS[0]
    if given not in TARGETS:
        raise ValueError(f"PMOPT_TARGET: {given!r} is not allowed, allowed: {', '.join(TARGETS)}")
    features = llvm.get_host_cpu_features()
    if given == FIXED and all(features.get(name) for name in _NEEDED):
        return Target(FIXED, "")
    return Target(llvm.get_host_cpu_name(), features.flatten())


#: What numba makes code for in this process, once it is known.
_numba_target: list[Target] = []


def _set_numba() -> bool:
    """Have numba make code for the target; return whether it does, which it settles once only."""
    wanted = target()
    if not _numba_target and "numba" not in sys.modules:
        from numba.core import config

        config.CPU_NAME, config.CPU_FEATURES = wanted
        _numba_target.append(wanted)
    return wanted in _numba_target


def folder_of(text: str, entries: Sequence[Entry]) -> Path:
    """Return the folder in the cache that holds a text and its machine code."""
    parts = (text, repr(tuple(entries)), *_machine(), *target())
    return cache_root() / hashlib.sha256("\0".join(parts).encode()).hexdigest()[:20]


@functools.cache
def _umask() -> int:
    """Return the permissions that this process takes from new files."""
    found = os.umask(0o077)
    os.umask(found)
    return found


def write_whole(path: Path, content: bytes) -> bool:
    """Write a file of the cache whole or not at all; return whether it could be written."""
    temporary = None
    try:
        path.parent.mkdir(_FOLDER_MODE, parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        with os.fdopen(handle, "wb") as stream:
            os.fchmod(handle, _FILE_MODE & ~_umask())
            stream.write(content)
        os.replace(temporary, path)
    except OSError:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        return False
    return True


def once(call: Callable[[], None] | None) -> Callable[[], None] | None:
    """Return what does something once, however many texts it is called for."""
    if call is None:
        return None
    left = [call]

    def first() -> None:
        if left:
            left.pop()()

    return first


class Compiled:
    """The entries of one text as attributes, each compiled or loaded at its first call.

    Parameters
    ----------
    text : str
        Source of a module; functions are decorated for numba in it.
    entries : sequence of Entry
    on_compile : callable, optional
        Called before the first compilation, which takes seconds.
    """

    def __init__(
        self,
        text: str,
        entries: Sequence[Entry],
        on_compile: Callable[[], None] | None = None,
    ) -> None:
        self.folder = folder_of(text, entries)
        self.on_compile = on_compile
        self.text = text
        self.entries = tuple(entries)
        self._by_name = {e.name: e for e in entries}
        self._module: ModuleType | None = None
        self._addresses: dict[str, int] = {}
        self._begun = False

    def __getattr__(self, name: str) -> Callable[..., None]:
        """Return an entry as a function of numbers and arrays."""
        try:
            entry = self.__dict__["_by_name"][name]
        except KeyError:
            raise AttributeError(name) from None
        address = self.address(name)
        with _lock:
            if name not in self.__dict__:
                setattr(self, name, _caller(entry, address))
        found: Callable[..., None] = self.__dict__[name]
        return found

    def address(self, name: str) -> int:
        """Return where the machine code of an entry begins."""
        with _lock:
            if name not in self._addresses:
                self._addresses[name] = self._address(self._by_name[name])
        return self._addresses[name]

    def parts(self, name: str) -> list[tuple[Compiled, str]]:
        """Return what an entry is put together of: itself."""
        return [(self, name)]

    def is_compiled(self, name: str) -> bool:
        """Return whether the machine code of an entry is kept."""
        return bool(self._kept(self._by_name[name])[0])

    def _kept(self, entry: Entry) -> tuple[bytes, Path | None]:
        """Return an entry's object code, empty where none is kept, and the place to keep it."""
        for root in _roots():
            path = root / self.folder.name / f"{entry.name}.o"
            kept = _read_trusted(path)
            if kept and self._digest(entry, kept[_DIGEST:]) == kept[:_DIGEST]:
                return kept[_DIGEST:], path
            # What is damaged is replaced; what is another user's is left alone.
            if kept is not None and _is_writable(path.parent):
                return b"", path
        return b"", None

    def _address(self, entry: Entry) -> int:
        """Return the address of an entry's machine code, compiling it where none is kept."""
        code, path = self._kept(entry)
        if not code:  # none is kept, or it is not what was
            with _counted():
                code = self._compile(entry)
            if path is not None:  # a cache that cannot be written costs time only
                write_whole(path, self._digest(entry, code) + code)
        return _load(code)

    def _digest(self, entry: Entry, code: bytes) -> bytes:
        """Return the hash of an entry's object code and of the place where it is kept."""
        return hashlib.sha256(f"{self.folder.name}/{entry.name}\0".encode() + code).digest()

    def _compile(self, entry: Entry) -> bytes:
        """Return an entry's object code."""
        if not self._begun:
            self._begun = True
            if self.on_compile is not None:
                self.on_compile()
            path = self.folder / "kernels.py"  # to be read
            if _is_writable(path.parent):
                write_whole(path, self.text.encode())
        try:
            text = lowering.lowered(self.text, entry.name, entry.arguments, _SYMBOL)
        except lowering.Unsupported:
            return self._compile_by_numba(entry)
        return _object_code_of(text, vectors=not self.text.startswith(SCALAR))

    def _compile_by_numba(self, entry: Entry) -> bytes:
        """Return an entry's object code, of a text with more of Python than kernels need."""
        if self._module is None:
            if not _set_numba():
                return _compiled_elsewhere(self, entry)
            with undisturbed():
                self._module = self._import()
        with undisturbed():
            return _object_code(entry, getattr(self._module, entry.name))

    def _import(self) -> ModuleType:
        """Import the text."""
        name = f"pmopt_kernels_{self.folder.name}"
        path = self.folder / "kernels.py"
        module = ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module
        exec(compile(self.text, str(path), "exec"), module.__dict__)
        return module


class Program(Protocol):
    """What has entries that are compiled: one text, or several that call each other."""

    on_compile: Callable[[], None] | None

    def parts(self, name: str) -> list[tuple[Compiled, str]]:
        """Return the texts, and their entries, that an entry is put together of."""

    def is_compiled(self, name: str) -> bool:
        """Return whether the machine code of an entry is kept."""


def compile_ahead(
    wanted: Sequence[tuple[Program, str]],
    workers: int,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Compile what is missing of the entries wanted, in this process and in others.

    Whatever another process cannot do is done later, by the call that needs it.

    Parameters
    ----------
    wanted : sequence of (Compiled, entry name)
    workers : int
        Processes at most, this one included.
    progress : callable, optional
        Receives how many are compiled and how many were missing, at first and after each.
    """
    parts = dict.fromkeys(part for program, name in wanted for part in program.parts(name))
    missing = [(c, name) for c, name in parts if not c.is_compiled(name)]
    if not missing:
        return
    for compiled in dict.fromkeys(c for c, _ in missing):
        if compiled.on_compile is not None:
            compiled.on_compile()
            compiled.on_compile = None
    # The longest texts first; each process, this one too, takes the next one when it has done one.
    missing.sort(key=lambda item: -len(item[0].text))
    left = iter(missing)
    taking = threading.Lock()
    command = [sys.executable, "-c", f"from {__name__} import _serve; _serve()"]
    processes: list[subprocess.Popen[str]] = []
    done: queue.SimpleQueue[bool] = queue.SimpleQueue()  # True for a kernel, False for a thread
    report = progress or (lambda count, planned: None)  # by this thread: it may print

    def following() -> tuple[Compiled, str] | None:
        with taking:
            return next(left, None)

    def feed(process: subprocess.Popen[str]) -> None:
        assert process.stdin is not None and process.stdout is not None
        try:
            with contextlib.suppress(OSError):
                while (item := following()) is not None:
                    compiled, name = item
                    asked = json.dumps([compiled.text, compiled.entries, name])
                    process.stdin.write(asked + "\n")
                    process.stdin.flush()
                    if not process.stdout.readline():
                        break
                    done.put(True)
                process.stdin.close()
        finally:
            done.put(False)

    try:
        with _counted():
            for _ in range(min(workers - 1, len(missing) // _WORTH_A_PROCESS)):
                process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL, text=True, encoding="utf-8",
                )  # fmt: skip
                processes.append(process)
            threads = [threading.Thread(target=feed, args=(p,), daemon=True) for p in processes]
            for thread in threads:
                thread.start()
            count, working = 0, len(threads)
            report(count, len(missing))
            while True:
                item = following()
                if item is not None:
                    with contextlib.suppress(Exception):  # the call that needs it will say it
                        item[0].address(item[1])
                    done.put(True)
                elif not working and done.empty():
                    break
                while not done.empty() or (item is None and working):
                    if done.get():
                        count += 1
                        report(count, len(missing))
                    else:
                        working -= 1
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _compiled_elsewhere(compiled: Compiled, entry: Entry) -> bytes:
    """Return an entry's object code from a process in which numba does not have its own target."""
    command = [sys.executable, "-c", f"from {__name__} import _emit; _emit()"]
    asked = json.dumps([compiled.text, compiled.entries, entry.name])
    done = subprocess.run(command, input=asked.encode(), capture_output=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{entry.name}: not compiled: {done.stderr.decode().strip()[-300:]}")
    return done.stdout


def _emit() -> None:
    """Write the object code that stdin asks for: what a process of its own runs."""
    text, entries, name = json.load(sys.stdin)
    compiled = Compiled(text, [Entry(n, tuple(a)) for n, a in entries])
    sys.stdout.buffer.write(compiled._compile(compiled._by_name[name]))


def _serve() -> None:
    """Compile what stdin asks for, a line each: what a process of :func:`compile_ahead` runs."""
    texts: dict[str, Compiled] = {}
    for line in sys.stdin:
        text, entries, name = json.loads(line)
        if text not in texts:
            texts[text] = Compiled(text, [Entry(n, tuple(a)) for n, a in entries])
        getattr(texts[text], name)
        print(name, flush=True)


def _object_code_of(text: str, vectors: bool) -> bytes:
    """Optimise LLVM's text of a module and return its object code."""
    import llvmlite.binding as llvm

    _initialize()
    machine = _target_machine()
    module = llvm.parse_assembly(text)
    module.triple = llvm.get_process_triple()
    module.data_layout = str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=3 if vectors else 2)
    options.loop_vectorization = vectors
    options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    code: bytes = machine.emit_object(module)
    return code


def _object_code(entry: Entry, function: Any) -> bytes:
    """Compile an entry for calls through pointers and return the object code."""
    from numba import carray, cfunc, types

    kinds = {name: getattr(types, name) for name in _KINDS}
    signature, names, views = [], [], []
    for k, argument in enumerate(entry.arguments):
        kind, _, axes = argument.partition("[")
        if axes:
            given = axes.rstrip("]").split(",")
            shape = [f"n{k}_{a}" for a in range(len(given))]
            signature += [types.CPointer(kinds[kind]), *(types.int64 for _ in shape)]
            names += [f"p{k}", *shape]
            fixed = [n if g == ":" else g for n, g in zip(shape, given, strict=True)]
            views.append(f"carray(p{k}, ({', '.join(fixed)},))")
        else:
            signature.append(kinds[kind])
            names.append(f"p{k}")
            views.append(f"p{k}")
    source = f"def outer({', '.join(names)}):\n    inner({', '.join(views)})\n"
    scope = {"inner": function, "carray": carray}
    exec(source, scope)
    with collecting_nothing(), compiled_as_text() as optimised:
        outer = cfunc(types.void(*signature), nopython=True, error_model="numpy")(scope["outer"])
        text = outer.inspect_llvm().replace(outer.native_name, _SYMBOL)
        module = optimised(outer, text, _SYMBOL)
    _initialize()
    code: bytes = _target_machine().emit_object(module)
    return code


@functools.cache
def _initialize() -> None:
    """Make LLVM ready and bind the symbols that are never called."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if "numba" in sys.modules:  # it has bound them
        return
    library = ctypes.CDLL(None)
    for symbol in _UNUSED:
        llvm.add_symbol(symbol, ctypes.cast(library.abort, ctypes.c_void_p).value)
    for symbol in _IDLE:
        llvm.add_symbol(symbol, ctypes.cast(library.labs, ctypes.c_void_p).value)


def _target_machine() -> Any:
    """Return LLVM's code generator for the target, with numba's options."""
    import llvmlite.binding as llvm

    wanted = target()
    triple = llvm.get_process_triple()
    return llvm.Target.from_triple(triple).create_target_machine(
        cpu=wanted.cpu,
        features=wanted.features,
        opt=3,
        reloc="static" if triple.startswith("x86") else "default",
        codemodel="jitdefault",
        jit=True,
    )


def _load(code: bytes) -> int:
    """Load object code and return the address of its entry."""
    import llvmlite.binding as llvm

    _initialize()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine())
    engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
    engine.finalize_object()
    address: int = engine.get_function_address(_SYMBOL)
    _engines.append(engine)
    return address


def _caller(entry: Entry, address: int) -> Callable[..., None]:
    """Return a function that passes numbers and arrays to an entry; it releases the GIL."""
    types: list[Any] = []
    arrays: list[tuple[np.dtype[Any], tuple[int | None, ...]] | None] = []
    for argument in entry.arguments:
        kind, _, axes = argument.partition("[")
        if argument.startswith(lowering.PIECE):
            types.append(ctypes.c_void_p)
            arrays.append(None)
            continue
        if not axes:
            types.append(_KINDS[kind])
            arrays.append(None)
            continue
        shape = tuple(None if n == ":" else int(n) for n in axes.rstrip("]").split(","))
        types += [ctypes.c_void_p, *[ctypes.c_int64] * len(shape)]
        arrays.append((np.dtype(kind), shape))
    pointer = ctypes.CFUNCTYPE(None, *types)(address)

    def call(*arguments: Any) -> None:
        passed: list[Any] = []
        for value, array, stated in zip(arguments, arrays, entry.arguments, strict=True):
            if array is None:
                passed.append(value)
                continue
            kind, shape = array
            fits = value.dtype == kind and value.ndim == len(shape) and value.flags.c_contiguous
            if not fits or any(n not in (None, m) for n, m in zip(shape, value.shape, strict=True)):
                raise TypeError(f"{entry.name}: a C-contiguous {stated} is needed")
            passed += [value.ctypes.data, *value.shape]
        pointer(*passed)

    return call
