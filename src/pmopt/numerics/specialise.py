"""Make, cache and load the compiled sweep of one mechanism.

A specialised module is ONE file of source text: the kernel, the conditioning function, their
constants and helpers and the functions of :mod:`pmopt.numerics.sweep`, copied from their
sources. The file lies in a folder named after the hash of that text, the versions of numba and
NumPy, and the processor. numba keeps its machine code beside it. An edit anywhere changes the
text, hence the folder: machine code can not go stale.
"""

from __future__ import annotations

import ast
import atexit
import hashlib
import importlib.util
import inspect
import math
import os
import shutil
import sys
import tempfile
import textwrap
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pmopt.numerics import condition, sweep

CONDITIONING = {"2": condition.inverse_condition_2, "fro": condition.inverse_condition_fro}

# Contraction only: it fuses multiply and add, and assumes nothing about NaN or infinity.
_INLINE = '@njit(inline="always", fastmath={"contract"}, error_model="numpy")'
_ENTRY = '@njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")'
_ENTRIES = ("sweep", "field")
_STUBS = ("margin_of", "lci_of", "unpack")
_FIXED_TIME = 1_000_000_000  # numba checks the file's time stamp: the same text, the same stamp

_loaded: dict[tuple[Callable[..., Any], int, int, int, str], ModuleType] = {}


def cache_root() -> Path:
    """Return the folder of compiled kernels: ``$PMOPT_CACHE_DIR`` or the user's cache folder."""
    given = os.environ.get("PMOPT_CACHE_DIR")
    if given:
        return Path(given)
    from platformdirs import user_cache_path

    return user_cache_path("pmopt", appauthor=False)


def _collect(function: Callable[..., Any], blocks: dict[str, str]) -> None:
    """Add the source of ``function`` and of all it refers to, dependencies first."""
    for name in sorted(_names(function)):
        if name not in function.__globals__ or name in _STUBS:
            continue
        value = function.__globals__[name]
        if inspect.isfunction(value):
            _collect(value, blocks)
        elif isinstance(value, bool | int | float):
            text = f"{name} = {value!r}"
            if blocks.setdefault(name, text) != text:
                raise TypeError(f"two kernel constants are named {name}")
        elif value is not math and value is not np:
            raise TypeError(f"kernel {function.__name__} refers to {name}, which is no number")
    source = textwrap.dedent(inspect.getsource(function))
    text = f"{_ENTRY if function.__name__ in _ENTRIES else _INLINE}\n{source}"
    if blocks.setdefault(function.__name__, text) != text:
        raise TypeError(f"two kernel functions are named {function.__name__}")


def _names(function: Callable[..., Any]) -> set[str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def module_text(
    kernel: Callable[..., Any], pose_size: int, constant_count: int, order: int, norm: str
) -> str:
    """Return the source text of the specialised module.

    Parameters
    ----------
    kernel : function
        ``kernel(*pose, constants) -> (margin, *entries)`` with the ``order**2`` entries of any
        scalar multiple of the inverse Jacobian, row by row. Plain Python on floats; it may use
        ``math``, ``np``, module constants and other plain functions.
    pose_size, constant_count, order : int
        Pose coordinates, kernel constants, rows of the Jacobian.
    norm : str
        A key of :data:`CONDITIONING`.
    """
    if order != 3:
        raise NotImplementedError(f"conditioning of order {order} is not compiled yet")
    conditioning = CONDITIONING[norm]
    blocks: dict[str, str] = {}
    _collect(kernel, blocks)
    _collect(conditioning, blocks)
    pose = ", ".join(f"pose[{d}, i]" for d in range(pose_size))
    entries = ", ".join(f"result[{1 + e}]" for e in range(order**2))
    constants = ", ".join(f"constants[{c}]" for c in range(constant_count))
    blocks["margin_of"] = (
        f"{_INLINE}\ndef margin_of(pose, i, constants):\n"
        f"    return {kernel.__name__}({pose}, constants)[0]\n"
    )
    blocks["lci_of"] = (
        f"{_INLINE}\ndef lci_of(pose, i, constants):\n"
        f"    result = {kernel.__name__}({pose}, constants)\n"
        f"    return {conditioning.__name__}({entries})\n"
    )
    blocks["unpack"] = f"{_INLINE}\ndef unpack(constants):\n    return ({constants},)\n"
    for entry in _ENTRIES:
        _collect(getattr(sweep, entry), blocks)
    return "import math\n\nimport numpy as np\nfrom numba import njit\n\n\n" + "\n\n".join(
        blocks.values()
    )


def _digest(text: str) -> str:
    import llvmlite
    import llvmlite.binding as llvm
    import numba

    llvm_features = llvm.get_host_cpu_features().flatten()
    parts = (
        text,
        numba.__version__,
        llvmlite.__version__,
        np.__version__,
        sys.version,
        llvm.get_host_cpu_name(),
        llvm_features,
    )
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:20]


def _place(text: str, folder: Path) -> Path:
    """Write the module's text into the folder, whole or not at all, and return its path."""
    path = folder / "specialised.py"
    try:
        if path.read_text(encoding="utf-8") == text:
            return path
    except OSError:
        pass
    folder.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=folder, suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.utime(temporary, (_FIXED_TIME, _FIXED_TIME))
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def is_compiled(folder: Path) -> bool:
    """Return whether numba has kept machine code for the sweep in this folder."""
    return any(folder.glob("**/specialised.sweep-*.nbc"))


def specialise(
    kernel: Callable[..., Any],
    pose_size: int,
    constant_count: int,
    order: int,
    norm: str,
    on_compile: Callable[[], None] | None = None,
) -> ModuleType:
    """Return the compiled module with ``sweep`` and ``field`` for this kernel and norm.

    Compiled once per machine and kernel text. A cache folder that can not be written costs
    time, not results: the module is then compiled from a temporary folder.

    Parameters
    ----------
    on_compile : callable, optional
        Called before a compilation that will take seconds.

    See Also
    --------
    module_text : the other parameters.
    """
    key = (kernel, pose_size, constant_count, order, norm)
    if key in _loaded:
        return _loaded[key]
    text = module_text(*key)
    digest = _digest(text)
    folder = cache_root() / digest
    try:
        path = _place(text, folder)
        if not os.access(folder, os.W_OK):
            raise PermissionError(folder)
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="pmopt-kernels-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        path = _place(text, folder)
    if on_compile is not None and not is_compiled(folder):
        on_compile()
    name = f"pmopt_specialised_{digest}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:  # pragma: no cover - a file path always has a loader
        raise ImportError(name)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    _loaded[key] = module
    return module
