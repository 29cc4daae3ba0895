"""Make the text of the compiled sweep of one mechanism.

A specialised module is ONE source text: the kernel, the conditioning function, their constants and
helpers and the functions of :mod:`pmopt.kernels.sweep`, copied from their sources.
:mod:`pmopt.compiler.machine_code` compiles and keeps it.
"""

from __future__ import annotations

import inspect
import itertools
import linecache
import math
import textwrap
from collections.abc import Callable, Container
from typing import Any, NamedTuple

import numpy as np

from pmopt.compiler import records
from pmopt.compiler.apart import apart, clash, is_ours, keep_name, names_of, renamed
from pmopt.compiler.machine_code import Compiled, Entry
from pmopt.kernels import conditioning, segment_distance, sweep
from pmopt.kernels.vectors import Vec3

CONDITIONING = {"2": conditioning.inverse_condition_2, "fro": conditioning.inverse_condition_fro}
CAREFUL = {"2": conditioning.careful_condition_2, "fro": conditioning.careful_condition_fro}
BLOCK_CONDITIONING = {
    "2": conditioning.inverse_conditions_2,
    "fro": conditioning.inverse_conditions_fro,
}
#: What precedes the segments in a skeleton: position and rotation of the platform.
PLACE = 12
#: Begins every module.
PREFACE = "import math\n\nimport numpy as np\nfrom numba import njit\n\n\n"

# No fast arithmetic, contraction of products and sums neither: LLVM then keeps the order and the
# rounding of every operation, for vectors of any width, and all processors give the same bits.
# Contraction would save an eighth of the time.
# Functions are inlined by LLVM: by numba it takes twice as long and more, and gains nothing.
_OPTIONS = 'error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True'
INLINE = f"@njit(forceinline=True, {_OPTIONS})"
#: Length of kernel and skeleton, in characters, beyond which a kernel of order 3 is heavy.
_SMALL = 5000
#: Numbers in the longest vector.
_LANES = 8
PLAIN = f"@njit({_OPTIONS})"
_STUBS = (
    "margin_of", "index_block", "evaluate_block", "index_all", "place_on_line", "facts_of",
    "placed_of", "skeleton_of", "unpack", "FACTS", "ORDER", "AXES", "LINES", "LINE_AXIS", "HEAVY",
    "PLACE", "ENDS", "posture_to",
)  # fmt: skip
#: What is written into a text beside what is collected.
_TAKEN = (*_STUBS, "careful_index", "assemble_one", "njit")
_SEQUENCE = ("int64", "uint64[:]", "uint64[:,:]", "uint64[:,:,:]", "uint64[:,:,:]", "int64")
_TABLE = "float64[:,:]"
#: Begins the second look at indices that the closed form has doubted.
_DOUBTFUL = (
    "    doubtful = 0\n"
    "    for i in range(count):\n"
    "        doubtful += 1 if lci[i] < 0.0 else 0\n"
    "    if doubtful > 0:\n"
    "        for i in range(count):\n"
)
ENTRIES = ("sweep", "field", "points", "probe", "outline", "locate")


class Checks(NamedTuple):
    """Constants that follow the kernel's where there are checks; in the mechanism's length unit."""

    limbs2: float  # squared least distance between limbs
    platform2: float  # squared least distance of limbs to the platform and the tool
    cosine: float  # least cosine of cone angles
    tool: Vec3  # tool point, platform frame
    low: Vec3  # bounds on its place, base frame
    high: Vec3


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
    pose_size, order : int
        Pose coordinates, rows of the Jacobian.
    constants : type or int
        What the kernel's constants are; see :data:`pmopt.compiler.records.Constants`.
    norm : str
        A key of :data:`CONDITIONING`.
    segments, spokes : tuple of int
        Limb of each segment, -1 for the platform's, and of each of the latter the limb it meets.
    cones : int
        Number of cone angles.
    checks : tuple of str
        Of "clearance", "cone" and "tool": limits that the margin is to hold beside the kernel's.
    line : function, optional
        ``line(*pose, low, high, constants) -> (start, end, ..)``: points are placed on the parts it
        leaves of lines along a coordinate; see :attr:`pmopt.mechanisms.mechanism.Mechanism.line`.
    line_axis, line_parts : int
        Which coordinate, and how many parts it returns.
    switches : tuple of (str, int)
        Constants of the kernel's module that take other values.
    """

    kernel: Callable[..., Any]
    skeleton: Callable[..., Any]
    pose_size: int
    constants: records.Constants
    order: int
    norm: str
    segments: tuple[int, ...]
    spokes: tuple[int, ...]
    cones: int
    checks: tuple[str, ...] = ()
    line: Callable[..., Any] | None = None
    line_axis: int = 0
    line_parts: int = 0
    switches: tuple[tuple[str, int], ...] = ()

    @property
    def facts(self) -> int:
        """Length of what a probe tells of a pose."""
        return 1 + self.order**2 + PLACE + 6 * len(self.segments) + self.cones

    @property
    def scratch_rows(self) -> int:
        """Rows of PITCH numbers that a sweep needs for itself."""
        return 2 * self.pose_size + 3 + self.order**2

    @property
    def entries(self) -> tuple[Entry, ...]:
        """The functions of :mod:`pmopt.kernels.sweep` with the types of their arguments."""
        scratch = f"float64[{self.scratch_rows},{sweep.PITCH}]"
        return (
            Entry("sweep", (
                *_SEQUENCE, "int64", "int64", _TABLE, _TABLE, _TABLE, "float64", "float64[:]",
                "float64[:,:,:]", "float64[:,:,:]", "float64[:,:,:]", scratch,
                f"int64[{sweep.BLOCK}]",
            )),
            Entry("field", (_TABLE, "float64[:]", "float64[:]", "float64[:]", scratch)),
            Entry("points", (
                *_SEQUENCE, "int64", "int64", "float64[:]", "float64[:]", _TABLE, scratch,
            )),
            Entry("probe", (_TABLE, "float64[:]", _TABLE)),
            Entry("outline", (
                *_SEQUENCE, "int64", "int64", "float64[:]", "float64[:]", "float64[:]",
                "int64", "int64", "float64", "float64", _TABLE, _TABLE, scratch,
            )),
            Entry("locate", (
                _TABLE, "float64[:]", "float64[:]", "float64[:]", _TABLE, scratch,
            )),
        )  # fmt: skip


_loaded: dict[Recipe, Compiled] = {}


def collect(
    function: Callable[..., Any],
    blocks: dict[str, str],
    switched: Container[str] = (),
    decorator: str = INLINE,
    name: str = "",
) -> None:
    """Add the source of ``function`` and of all it refers to, dependencies first.

    ``name`` is what the function is called in the text, by default as in its source.
    """
    if not name:
        name = function.__name__
        keep_name(name, function)
    called = {function.__name__: name}
    if not is_ours(function) and name in _TAKEN:
        raise clash(name, function)
    for known in sorted(names_of(function.__code__)):
        if known not in function.__globals__ or known in switched:
            continue
        if known in _STUBS and is_ours(function):
            continue
        value = function.__globals__[known]
        if inspect.isfunction(value):
            if value is function:
                continue
            called[known] = apart(value.__name__, value)
            collect(value, blocks, switched, decorator, called[known])
        elif records.is_record(value):
            called[known] = records.declare(value, blocks)
        elif isinstance(value, bool | int | float | tuple):
            called[known] = apart(known, function)
            text = f"{called[known]} = {records.text_of(value, blocks)}"
            if blocks.setdefault(called[known], text) != text:
                raise TypeError(f"two kernel constants are named {known}")
        elif value is not math and value is not np:
            raise TypeError(f"kernel {function.__name__} refers to {known}, which is no number")
    source = renamed(_source(function), called)
    # Entries are compiled into the one function that calls them, where rows lie at known places.
    text = f"{decorator}\n{source}"
    if blocks.setdefault(name, text) != text:
        raise clash(name, function)


def _source(function: Callable[..., Any]) -> str:
    """Return the text of a function; ``inspect`` takes ten times as long where no doubt is."""
    lines = linecache.getlines(function.__code__.co_filename)
    first = function.__code__.co_firstlineno - 1
    last = first + 1
    while last < len(lines) and (not lines[last].strip() or lines[last][0] in " )"):
        last += 1
    text = "".join(lines[first:last])
    if text.startswith("def ") and text.count('"""') in (0, 2):
        return text.rstrip() + "\n"
    return textwrap.dedent(inspect.getsource(function))


def module_text(recipe: Recipe) -> str:
    """Return the source text of the specialised module."""
    kernel, order = recipe.kernel, recipe.order
    of_matrix = (CONDITIONING if order == 3 else BLOCK_CONDITIONING)[recipe.norm]
    blocks: dict[str, str] = {}
    records.declare(recipe.constants, blocks)
    blocks["ORDER"] = f"ORDER = {order}"
    blocks["AXES"] = f"AXES = {recipe.pose_size}"
    blocks["LINES"] = f"LINES = {int(recipe.line is not None)}"
    blocks["LINE_AXIS"] = f"LINE_AXIS = {recipe.line_axis}"
    blocks["PLACE"] = f"PLACE = {PLACE}"
    blocks["ENDS"] = f"ENDS = {2 * len(recipe.segments)}"
    blocks |= {name: f"{name} = {value}" for name, value in recipe.switches}
    blocks["FACTS"] = f"FACTS = {recipe.facts}"
    collect(kernel, blocks, dict(recipe.switches))
    collect(recipe.skeleton, blocks)
    if recipe.line is not None:
        collect(recipe.line, blocks)
    own_length = sum(map(len, blocks.values()))
    collect(of_matrix, blocks)
    if order == 3:
        collect(CAREFUL[recipe.norm], blocks)
    collect(segment_distance.segment_distance2, blocks)
    pose = ", ".join(f"pose[{d}, i]" for d in range(recipe.pose_size))
    entries = [f"result[{1 + e}]" for e in range(order**2)]
    own = "constants[0]" if recipe.checks else "constants"
    call = f"{kernel.__name__}({pose}, {own})"
    margin = "    margin = result[0]\n" + (_checks(recipe, pose) if recipe.checks else "")
    heavy = order == 3 and own_length > _SMALL
    blocks["HEAVY"] = f"HEAVY = {int(heavy)}"

    def define(name: str, arguments: str, body: str, decorator: str = INLINE) -> None:
        blocks[name] = f"{decorator}\ndef {name}({arguments}):\n{body}"

    point, block = "pose, i, constants", "pose, count, constants"
    evaluated = f"    result = {call}\n"
    each = "    for i in range(count):\n"
    # Whole vectors: the last pose fills them, where single points would cost as much as ten.
    whole = (
        f"    filled = (count + {_LANES - 1}) & {-_LANES}\n"
        f"    for d in range({recipe.pose_size}):\n"
        "        for i in range(count, filled):\n"
        "            pose[d, i] = pose[d, count - 1]\n"
        "    for i in range(filled):\n"
    )
    kept = "".join(f"    work[{e}, i] = {text}\n" for e, text in enumerate(entries))
    define("margin_of", point, f"{evaluated}{margin}    return margin\n")
    if order == 3:
        stored = [f"work[{e}, i]" for e in range(9)]
        closed = f"    lci[i] = {of_matrix.__name__}({', '.join(stored if heavy else entries)})\n"
        careful = f"{CAREFUL[recipe.norm].__name__}({', '.join(stored if heavy else entries)})"
        if heavy:
            define("careful_index", "work, i", f"    return {careful}\n", PLAIN)
        else:
            define("careful_index", point, f"{evaluated}    return {careful}\n", PLAIN)
    if heavy:
        # The kernel is worth being evaluated, and compiled, once: entries are kept for all points.
        each_point = textwrap.indent(f"{evaluated}{margin}    margins[i] = margin\n{kept}", "    ")
        define("evaluate_block", f"{block}, work, margins", each + each_point)
        again = "            if lci[i] < 0.0 and margins[i] >= 0.0:\n"
        again += "                lci[i] = careful_index(work, i)\n"
        define("index_block", f"{block}, work, lci", "    raise NotImplementedError\n")
        define("index_all", "count, work, margins, lci",
               each + textwrap.indent(closed, "    ") + _DOUBTFUL + again)  # fmt: skip
    elif order == 3:
        again = "            if lci[i] < 0.0:\n"
        again += "                lci[i] = careful_index(pose, i, constants)\n"
        each_point = textwrap.indent(f"{evaluated}{closed}", "    ")
        define("index_block", f"{block}, work, lci", whole + each_point + _DOUBTFUL + again)
    else:
        # Larger matrices: poses are moved next to them, or 4-UPS-RPS takes a fifth more time in
        # every other run.
        size, axes = order**2, range(recipe.pose_size)
        moved = "".join(f"        work[{size + d}, i] = pose[{d}, i]\n" for d in axes)
        moved = f"{moved}    for i in range(filled):\n" if order > 4 else ""
        at = ", ".join(f"work[{size + d}, i]" for d in axes) if order > 4 else pose
        near = f"    result = {kernel.__name__}({at}, {own})\n"
        define("index_block", f"{block}, work, lci",
               f"{whole}{moved}"
               + textwrap.indent(f"{near}{kept}", "    ")
               + f"    {of_matrix.__name__}(work, filled, lci)\n")  # fmt: skip
    define("place_on_line", "pose, i, low, width, constants",
           _place(recipe, f"({pose}, low, low + width, {own})"))  # fmt: skip
    skeleton = f"{recipe.skeleton.__name__}({pose}, {own})"
    define("skeleton_of", point, f"    return {skeleton}\n")
    place = ", ".join(f"found[{k}]" for k in range(PLACE))
    placed = f"    found = {skeleton}\n    return (margin, {place})\n"
    define("placed_of", point, evaluated + margin + placed)
    facts = f"    return (margin, {', '.join(entries)}) + {skeleton}\n"
    define("facts_of", point, evaluated + margin + facts)
    numbers = (f"constants[{c}]" for c in itertools.count())
    unpacked = records.call(recipe.constants, numbers)
    if recipe.checks:
        records.declare(Checks, blocks)
        unpacked = f"({unpacked}, {records.call(Checks, numbers)})"
    define("unpack", "constants", f"    return {unpacked}\n")
    for entry in ENTRIES:
        collect(getattr(sweep, entry), blocks)
    text = "\n\n".join(blocks.values())
    return PREFACE + text


def _place(recipe: Recipe, arguments: str) -> str:
    """Return the lines that place a point at the share of the parts that it had of the line."""
    axis = f"pose[{recipe.line_axis}, i]"
    if recipe.line is None:
        return f"    return {axis}, 1.0\n"
    parts = range(recipe.line_parts)
    lines = [f"parts = {recipe.line.__name__}{arguments}"]
    for k in parts:
        lines += [
            f"length{k} = parts[{2 * k + 1}] - parts[{2 * k}]",
            f"length{k} = length{k} if length{k} > 0.0 else 0.0",
        ]
    lines += [
        f"total = {' + '.join(f'length{k}' for k in parts)}",
        "share = total / width",
        f"along = ({axis} - low) * share",
        "place = parts[0] + along",
    ]
    for k in parts[1:]:
        lines += [
            f"along = along - length{k - 1}",
            f"place = parts[{2 * k}] + along if along >= 0.0 else place",
        ]
    lines.append(f"return (place if total > 0.0 else {axis}), share")
    return "".join(f"    {line}\n" for line in lines)


def _checks(recipe: Recipe, pose: str) -> str:
    """Return the lines that lower the margin to the clearance, cone and tool limits."""
    lines = [f"s = {recipe.skeleton.__name__}({pose}, constants[0])", "checks = constants[1]"]

    def limit(slack: str) -> None:
        lines.extend((f"slack = {slack}", "margin = slack if slack < margin else margin"))

    def ends(segment: int) -> str:
        start = PLACE + 6 * segment
        return ", ".join(f"Vec3(s[{k}], s[{k + 1}], s[{k + 2}])" for k in (start, start + 3))

    tool = [f"checks.tool.{axis}" for axis in "xyz"]
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
                    least = "checks.platform2" if other < 0 else "checks.limbs2"
                    limit(f"segment_distance2({ends(a)}, {ends(b)}) - {least}")
            if "tool" in recipe.checks:
                shaft = "Vec3(s[0], s[1], s[2]), Vec3(tool0, tool1, tool2)"
                limit(f"segment_distance2({ends(a)}, {shaft}) - checks.platform2")
    if "cone" in recipe.checks:
        start = PLACE + 6 * len(recipe.segments)
        for k in range(recipe.cones):
            limit(f"s[{start + k}] - checks.cosine")
    if "tool" in recipe.checks:
        for k, axis in enumerate("xyz"):
            limit(f"tool{k} - checks.low.{axis}")
            limit(f"checks.high.{axis} - tool{k}")
    return "".join(f"    {line}\n" for line in lines)


def specialise(recipe: Recipe, on_compile: Callable[[], None] | None = None) -> Compiled:
    """Return the compiled ``sweep``, ``field``, ``points`` and ``probe`` of a recipe.

    Each is compiled once per machine and kernel text, when it is first called.

    Parameters
    ----------
    recipe : Recipe
    on_compile : callable, optional
        Called before a compilation, which takes seconds.
    """
    if recipe not in _loaded:
        _loaded[recipe] = Compiled(module_text(recipe), recipe.entries)
    found = _loaded[recipe]
    found.on_compile = on_compile
    return found
