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
from typing import Any, NamedTuple

import numpy as np

from pmopt.numerics import clearance, condition, sweep

CONDITIONING = {"2": condition.inverse_condition_2, "fro": condition.inverse_condition_fro}
BLOCK_CONDITIONING = {"2": condition.inverse_conditions_2, "fro": condition.inverse_conditions_fro}
#: Numbers that follow the kernel's constants where there are checks: squared least distances of
#: limbs and of limbs to the platform, least cosine of cone angles, tool point in the platform's
#: frame, lower and upper bounds on its place in the base's.
CHECK_CONSTANTS = 12
#: What precedes the segments in a skeleton: position and rotation of the platform.
PLACE = 12

# Contraction only: it fuses multiply and add, and assumes nothing about NaN or infinity.
# Inlining in numba's own code gives 5 to 8 % faster loops than LLVM's; for all but small kernels
# it takes minutes to compile (3-UPS/SP: 57 s against 8 s).
_INLINE = '@njit(inline="always", fastmath={"contract"}, error_model="numpy")'
_FORCE = '@njit(forceinline=True, fastmath={"contract"}, error_model="numpy")'
_SMALL = 5000
_ENTRY = '@njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")'
_ENTRIES = ("sweep", "field", "points", "probe")
_STUBS = ("margin_of", "index_block", "facts_of", "unpack", "WORK", "FACTS", "ORDER")
_FIXED_TIME = 1_000_000_000  # numba checks the file's time stamp: the same text, the same stamp


class Recipe(NamedTuple):
    """What a module is specialised to.

    Attributes
    ----------
    kernel : function
        ``kernel(*pose, constants) -> (margin, *entries)`` with the ``order**2`` entries of any
        scalar multiple of the inverse Jacobian, row by row. Plain Python on floats; it may use
        ``math``, ``np``, module constants and other plain functions.
    skeleton : function
        ``skeleton(*pose, constants)``: place of the platform, ends of segments, cosines of cones.
    pose_size, constant_count, order : int
        Pose coordinates, kernel constants, rows of the Jacobian.
    norm : str
        A key of :data:`CONDITIONING`.
    segments, spokes : tuple of int
        Limb of each segment, -1 for the platform's, and of each of the latter the limb it meets.
    cones : int
        Number of cone angles.
    checks : tuple of str
        Of "clearance", "cone" and "tool": limits that the margin is to hold beside the kernel's.
    """

    kernel: Callable[..., Any]
    skeleton: Callable[..., Any]
    pose_size: int
    constant_count: int
    order: int
    norm: str
    segments: tuple[int, ...]
    spokes: tuple[int, ...]
    cones: int
    checks: tuple[str, ...] = ()

    @property
    def facts(self) -> int:
        """Length of what a probe tells of a pose."""
        return 1 + self.order**2 + PLACE + 6 * len(self.segments) + self.cones


_loaded: dict[Recipe, ModuleType] = {}


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


def module_text(recipe: Recipe) -> str:
    """Return the source text of the specialised module."""
    kernel, order = recipe.kernel, recipe.order
    conditioning = (CONDITIONING if order == 3 else BLOCK_CONDITIONING)[recipe.norm]
    count = recipe.constant_count + (CHECK_CONSTANTS if recipe.checks else 0)
    blocks: dict[str, str] = {}
    blocks["ORDER"] = f"ORDER = {order}"
    blocks["WORK"] = f"WORK = {0 if order == 3 else order**2}"
    blocks["FACTS"] = f"FACTS = {recipe.facts}"
    _collect(kernel, blocks)
    _collect(recipe.skeleton, blocks)
    own_length = sum(map(len, blocks.values()))
    _collect(conditioning, blocks)
    _collect(clearance.segment_distance2, blocks)
    pose = ", ".join(f"pose[{d}, i]" for d in range(recipe.pose_size))
    entries = [f"result[{1 + e}]" for e in range(order**2)]
    constants = ", ".join(f"constants[{c}]" for c in range(count))
    own = f"constants[:{recipe.constant_count}]" if recipe.checks else "constants"
    call = f"{kernel.__name__}({pose}, {own})"
    blocks["margin_of"] = f"{_INLINE}\ndef margin_of(pose, i, constants):\n    " + (
        f"margin = {call}[0]\n{_checks(recipe, pose)}    return margin\n"
        if recipe.checks
        else f"return {call}[0]\n"
    )
    head = "def index_block(pose, count, constants, work, lci):\n    for i in range(count):\n"
    if order == 3:
        body = f"        lci[i] = {conditioning.__name__}({', '.join(entries)})\n"
    else:
        body = "".join(f"        work[{e}, i] = {text}\n" for e, text in enumerate(entries))
        body += f"    {conditioning.__name__}(work, count, lci)\n"
    blocks["index_block"] = f"{_INLINE}\n{head}        result = {call}\n{body}"
    skeleton = f"{recipe.skeleton.__name__}({pose}, {own})"
    blocks["facts_of"] = (
        f"{_INLINE}\ndef facts_of(pose, i, constants):\n    result = {call}\n"
        f"    return (margin_of(pose, i, constants), {', '.join(entries)}) + {skeleton}\n"
    )
    blocks["unpack"] = f"{_INLINE}\ndef unpack(constants):\n    return ({constants},)\n"
    for entry in _ENTRIES:
        _collect(getattr(sweep, entry), blocks)
    text = "\n\n".join(blocks.values())
    if own_length > _SMALL or recipe.checks:
        text = text.replace(_INLINE, _FORCE)
    return f"import math\n\nimport numpy as np\nfrom numba import njit\n\n\n{text}"


def _checks(recipe: Recipe, pose: str) -> str:
    """Return the lines that lower the margin to the clearance, cone and tool limits."""
    first = recipe.constant_count
    lines = [f"s = {recipe.skeleton.__name__}({pose}, constants[:{first}])"]

    def limit(slack: str) -> None:
        lines.extend((f"slack = {slack}", "margin = slack if slack < margin else margin"))

    def ends(segment: int) -> str:
        start = PLACE + 6 * segment
        return ", ".join(f"s[{k}]" for k in range(start, start + 6))

    tool = [f"constants[{first + 3 + k}]" for k in range(3)]
    place = [
        f"s[{k}] + " + " + ".join(f"s[{3 + 3 * k + j}] * {tool[j]}" for j in range(3))
        for k in range(3)
    ]
    lines += [f"tool{k} = {text}" for k, text in enumerate(place)]
    if "clearance" in recipe.checks:
        met = iter(recipe.spokes)
        joined = [next(met) if limb < 0 else limb for limb in recipe.segments]
        for a, limb in enumerate(recipe.segments):
            if limb < 0:
                continue
            for b, other in enumerate(recipe.segments):
                if joined[b] != limb and (other < 0 or b > a):
                    least = f"constants[{first + (1 if other < 0 else 0)}]"
                    limit(f"segment_distance2({ends(a)}, {ends(b)}) - {least}")
            if "tool" in recipe.checks:
                shaft = "s[0], s[1], s[2], tool0, tool1, tool2"
                limit(f"segment_distance2({ends(a)}, {shaft}) - constants[{first + 1}]")
    if "cone" in recipe.checks:
        start = PLACE + 6 * len(recipe.segments)
        for k in range(recipe.cones):
            limit(f"s[{start + k}] - constants[{first + 2}]")
    if "tool" in recipe.checks:
        for k in range(3):
            limit(f"tool{k} - constants[{first + 6 + k}]")
            limit(f"constants[{first + 9 + k}] - tool{k}")
    return "".join(f"    {line}\n" for line in lines)


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


def specialise(recipe: Recipe, on_compile: Callable[[], None] | None = None) -> ModuleType:
    """Return the compiled module with ``sweep``, ``field``, ``points`` and ``probe``.

    Compiled once per machine and kernel text. A cache folder that can not be written costs
    time, not results: the module is then compiled from a temporary folder.

    Parameters
    ----------
    recipe : Recipe
    on_compile : callable, optional
        Called before a compilation that will take seconds.
    """
    if recipe in _loaded:
        return _loaded[recipe]
    text = module_text(recipe)
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
    _loaded[recipe] = module
    return module
