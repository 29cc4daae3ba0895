"""Make the texts of the compiled sweep of one mechanism.

A sweep is put together of pieces that are compiled apart and call each other by address, a block of
points at a time. What all mechanisms share is :mod:`pmopt.kernels.sweep` and, by order and norm,
the conditioning of Jacobians; :mod:`pmopt.kernels.pieces` has what a mechanism brings. The text of
a piece is its function, the mechanism's own, their constants and helpers, copied from their
sources, and nothing else: what does not change is not compiled again.
:mod:`pmopt.compiler.machine_code` compiles and keeps it.
"""

from __future__ import annotations

import functools
import inspect
import itertools
import linecache
import math
import textwrap
from collections.abc import Callable, Container, Sequence
from typing import Any, NamedTuple

import numpy as np

from pmopt.compiler import records
from pmopt.compiler.apart import apart, clash, is_ours, keep_name, names_of, renamed
from pmopt.compiler.lowering import AND, PIECE
from pmopt.compiler.machine_code import Compiled, Entry, once
from pmopt.kernels import conditioning, pieces, segment_distance, sweep
from pmopt.kernels.vectors import Vec3

CONDITIONING = {"2": conditioning.inverse_condition_2, "fro": conditioning.inverse_condition_fro}
CAREFUL = {"2": conditioning.careful_condition_2, "fro": conditioning.careful_condition_fro}
BLOCK_CONDITIONING = {
    "2": conditioning.inverse_conditions_2,
    "fro": conditioning.inverse_conditions_fro,
}
#: What precedes the segments in a skeleton: position and rotation of the platform.
PLACE = sweep.PLACE
#: Begins every module.
PREFACE = "import math\n\nimport numpy as np\nfrom numba import njit\n\n\n"

# No fast arithmetic, contraction of products and sums neither: LLVM then keeps the order and the
# rounding of every operation, for vectors of any width, and all processors give the same bits.
# Contraction would save an eighth of the time.
# Functions are inlined by LLVM: by numba it takes twice as long and more, and gains nothing.
_OPTIONS = 'error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True'
INLINE = f"@njit(forceinline=True, {_OPTIONS})"
#: Length of a kernel, in characters, beyond which a kernel of order 3 is heavy.
_SMALL = 5000
#: Numbers in the longest vector.
_LANES = 8
PLAIN = f"@njit({_OPTIONS})"
_STUBS = (
    "margin_of", "index_block", "evaluate_block", "condition_block", "place_on_line", "facts_to",
    "skeleton_to", "place_to", "unpack", "ORDER", "POSE", "SKELETON", "LINE_AXIS",
    "posture_to",
)  # fmt: skip
#: What is written into a text beside what is collected.
_TAKEN = (
    *_STUBS, "careful_index", "assemble_one", "njit", "margins", "evaluations", "indices",
    "conditions", "lines", "skeletons", "placed", "probe", "sweep", "field", "points", "outline",
    "locate", "fill", "take",
)  # fmt: skip
_SEQUENCE = ("int64", "uint64[:]", "uint64[:,:]", "uint64[:,:,:]", "uint64[:,:,:]", "int64")
_TABLE = "float64[:,:]"
_BLOCK = f"float64[:,{sweep.PITCH}]"
_CHOSEN = f"int64[{sweep.BLOCK}]"
#: What pieces take; in their own texts the number of a block's rows is known.
_FILL = (
    "int64", "uint64[:]", "uint64[:]", "uint64[:,:]", "uint64[:,:]", "int64", "int64", "int64",
    "float64[:]", "float64[:]", _BLOCK,
)  # fmt: skip
_POINTWISE = (_BLOCK, "int64", "float64[:]")
_CONDITIONS = (_BLOCK, "int64")
_LINES = (_BLOCK, "int64", "float64[:]", "float64[:]", "float64[:]")


def _piece(arguments: Sequence[str]) -> str:
    return PIECE + AND.join(arguments)


#: What is compiled once for all mechanisms: functions of :mod:`pmopt.kernels.sweep`.
_COMMON = {
    "fill": _FILL,
    "sweep": (
        *_SEQUENCE, "int64", "int64", _TABLE, _TABLE, _TABLE, "float64", "float64[:]",
        "float64[:,:,:]", "float64[:,:,:]", "float64[:,:,:]", _BLOCK, _CHOSEN,
        *map(_piece, (_FILL, _POINTWISE, _POINTWISE, _CONDITIONS, _LINES)),
    ),
    "field": (
        _TABLE, "float64[:]", "float64[:]", "float64[:]", _BLOCK,
        *map(_piece, (_POINTWISE, _POINTWISE, _CONDITIONS)),
    ),
    "points": (
        *_SEQUENCE, "int64", "int64", "float64[:]", "float64[:]", _TABLE, _BLOCK, _piece(_FILL),
    ),
    "outline": (
        *_SEQUENCE, "int64", "int64", "float64[:]", "float64[:]", "float64[:]", "int64", "int64",
        "float64", "float64", _TABLE, _TABLE, _BLOCK, "int64", _CHOSEN, "int64",
        *map(_piece, (_FILL, _POINTWISE, _POINTWISE)),
    ),
    "locate": (
        _TABLE, "float64[:]", "float64[:]", "float64[:]", _TABLE, _BLOCK, _piece(_POINTWISE),
    ),
}  # fmt: skip
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
    constants : type
        What the kernel's constants are: a NamedTuple.
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
    constants: type[Any]
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
        return 1 + self.order**2 + self.skeleton_size

    @property
    def skeleton_size(self) -> int:
        """Length of a skeleton."""
        return PLACE + 6 * len(self.segments) + self.cones

    @property
    def first_pose(self) -> int:
        """The row of a block where poses begin."""
        beside = self.pose_size if self.order > 4 else 0
        return sweep.WORK + max(self.order**2 + beside, PLACE)

    @property
    def scratch_rows(self) -> int:
        """Rows of PITCH numbers that a sweep needs for itself."""
        return self.first_pose + self.pose_size


#: Whole sweeps by recipe, and texts with their entries, as far as they are in use.
_loaded: dict[Any, Any] = {}


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


def common_text(name: str) -> str:
    """Return the text of a function that is compiled once for all mechanisms."""
    blocks: dict[str, str] = {}
    collect(getattr(sweep, name), blocks)
    return PREFACE + "\n\n".join(blocks.values())


def conditions_text(order: int, norm: str) -> str:
    """Return the text that takes the indices of Jacobians which a block holds."""
    of_matrix = (CONDITIONING if order == 3 else BLOCK_CONDITIONING)[norm]
    blocks = {"ORDER": f"ORDER = {order}"}
    collect(of_matrix, blocks)
    each = "    for i in range(count):\n"
    if order == 3:
        collect(CAREFUL[norm], blocks)
        entries = ", ".join(f"work[{e}, i]" for e in range(9))
        careful = f"{CAREFUL[norm].__name__}({entries})"
        _define(blocks, "careful_index", "work, i", f"    return {careful}\n", PLAIN)
        again = "            if lci[i] < 0.0 and margin[i] >= 0.0:\n"
        again += "                lci[i] = careful_index(work, i)\n"
        closed = f"        lci[i] = {of_matrix.__name__}({entries})\n"
        body = each + closed + _DOUBTFUL + again
    else:
        filled = f"    filled = (count + {_LANES - 1}) & {-_LANES}\n"
        body = f"{filled}    {of_matrix.__name__}(work, filled, lci)\n"
    _define(blocks, "condition_block", "count, work, margin, lci", body)
    collect(pieces.conditions, blocks)
    return PREFACE + "\n\n".join(blocks.values())


def _define(
    blocks: dict[str, str], name: str, arguments: str, body: str, decorator: str = INLINE
) -> None:
    blocks[name] = f"{decorator}\ndef {name}({arguments}):\n{body}"


class _Texts:
    """The texts of what a mechanism brings, by recipe."""

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self.pose = ", ".join(f"pose[{d}, i]" for d in range(recipe.pose_size))
        self.own = "constants[0]" if recipe.checks else "constants"
        self.call = f"{recipe.kernel.__name__}({self.pose}, {self.own})"
        self.skeleton = f"{recipe.skeleton.__name__}({self.pose}, {self.own})"
        self.entries = [f"result[{1 + e}]" for e in range(recipe.order**2)]

    @property
    def heavy(self) -> bool:
        """Whether the kernel costs so much that it is evaluated once for margin and entries."""
        if self.recipe.order != 3:
            return False
        blocks = self.head()
        self.add_kernel(blocks)
        return sum(map(len, blocks.values())) > _SMALL

    def head(self) -> dict[str, str]:
        """Return what begins every text: the constants and how they are taken apart."""
        recipe = self.recipe
        blocks: dict[str, str] = {}
        records.declare(recipe.constants, blocks)
        blocks["ORDER"] = f"ORDER = {recipe.order}"
        blocks["POSE"] = f"POSE = {recipe.first_pose}"
        blocks["SKELETON"] = f"SKELETON = {recipe.scratch_rows}"
        return blocks

    def add_kernel(self, blocks: dict[str, str]) -> None:
        """Add the kernel with its switches."""
        blocks |= {name: f"{name} = {value}" for name, value in self.recipe.switches}
        collect(self.recipe.kernel, blocks, dict(self.recipe.switches))

    def whole(self, blocks: dict[str, str], function: Callable[..., Any]) -> str:
        """Return the text of a piece, once its stubs are filled."""
        recipe = self.recipe
        numbers = (f"constants[{c}]" for c in itertools.count())
        unpacked = records.call(recipe.constants, numbers)
        if recipe.checks:
            records.declare(Checks, blocks)
            unpacked = f"({unpacked}, {records.call(Checks, numbers)})"
        _define(blocks, "unpack", "constants", f"    return {unpacked}\n")
        collect(function, blocks)
        return PREFACE + "\n\n".join(blocks.values())

    def with_margin(self, blocks: dict[str, str]) -> str:
        """Add what the margin needs; return the lines that compute it."""
        self.add_kernel(blocks)
        lines = f"    result = {self.call}\n    margin = result[0]\n"
        if self.recipe.checks:
            collect(self.recipe.skeleton, blocks)
            collect(segment_distance.segment_distance2, blocks)
            lines += _checks(self.recipe, self.pose)
        return lines

    def margins(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.margins`."""
        blocks = self.head()
        lines = self.with_margin(blocks)
        _define(blocks, "margin_of", "pose, i, constants", f"{lines}    return margin\n")
        return self.whole(blocks, pieces.margins)

    def evaluations(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.evaluations`."""
        blocks = self.head()
        lines = self.with_margin(blocks) + "    margins[i] = margin\n" + self.kept()
        body = "    for i in range(count):\n" + textwrap.indent(lines, "    ")
        _define(blocks, "evaluate_block", "pose, count, constants, work, margins", body)
        return self.whole(blocks, pieces.evaluations)

    def kept(self) -> str:
        return "".join(f"    work[{e}, i] = {text}\n" for e, text in enumerate(self.entries))

    def indices(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.indices`."""
        recipe, order = self.recipe, self.recipe.order
        blocks = self.head()
        self.add_kernel(blocks)
        axes = range(recipe.pose_size)
        # Whole vectors: the last pose fills them, where single points would cost as much as ten.
        body = (
            f"    filled = (count + {_LANES - 1}) & {-_LANES}\n"
            f"    for d in range({recipe.pose_size}):\n"
            "        for i in range(count, filled):\n"
            "            pose[d, i] = pose[d, count - 1]\n"
            "    for i in range(filled):\n"
        )
        call = self.call
        if order == 3:
            closed, careful = CONDITIONING[recipe.norm], CAREFUL[recipe.norm]
            collect(closed, blocks)
            collect(careful, blocks)
            entries = ", ".join(self.entries)
            again = f"    result = {call}\n    return {careful.__name__}({entries})\n"
            _define(blocks, "careful_index", "pose, i, constants", again, PLAIN)
            last = f"        lci[i] = {closed.__name__}({entries})\n{_DOUBTFUL}"
            last += "            if lci[i] < 0.0:\n"
            last += "                lci[i] = careful_index(pose, i, constants)\n"
        else:
            last = textwrap.indent(self.kept(), "    ")
        if order > 4:
            # Poses are moved next to the matrices, or 4-UPS-RPS takes a fifth more time in every
            # other run.
            size = order**2
            body += "".join(f"        work[{size + d}, i] = pose[{d}, i]\n" for d in axes)
            body += "    for i in range(filled):\n"
            moved = ", ".join(f"work[{size + d}, i]" for d in axes)
            call = f"{recipe.kernel.__name__}({moved}, {self.own})"
        body += f"        result = {call}\n{last}"
        _define(blocks, "index_block", "pose, count, constants, work, lci", body)
        return self.whole(blocks, pieces.indices)

    def lines(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.lines`."""
        recipe = self.recipe
        assert recipe.line is not None
        blocks = self.head()
        blocks["LINE_AXIS"] = f"LINE_AXIS = {recipe.line_axis}"
        collect(recipe.line, blocks)
        body = _place(recipe, f"({self.pose}, low, low + width, {self.own})")
        _define(blocks, "place_on_line", "pose, i, low, width, constants", body)
        return self.whole(blocks, pieces.lines)

    def skeletons(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.skeletons`."""
        blocks = self.head()
        collect(self.recipe.skeleton, blocks)
        body = f"    found = {self.skeleton}\n"
        body += _written("work", range(self.recipe.skeleton_size), "found")
        _define(blocks, "skeleton_to", "pose, i, constants, work", body)
        return self.whole(blocks, pieces.skeletons)

    def placed(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.placed`."""
        blocks = self.head()
        body = self.with_margin(blocks)
        collect(self.recipe.skeleton, blocks)
        body += f"    found = {self.skeleton}\n{_written('work', range(PLACE), 'found')}"
        _define(blocks, "place_to", "pose, i, constants, work", f"{body}    return margin\n")
        return self.whole(blocks, pieces.placed)

    def probe(self) -> str:
        """Return the text of :func:`pmopt.kernels.pieces.probe`."""
        blocks = self.head()
        body = self.with_margin(blocks)
        collect(self.recipe.skeleton, blocks)
        body += f"    found = {self.skeleton}\n    facts[0, i] = margin\n"
        body += "".join(f"    facts[{1 + e}, i] = {text}\n" for e, text in enumerate(self.entries))
        first = 1 + self.recipe.order**2
        body += _written("facts", range(self.recipe.skeleton_size), "found", first)
        _define(blocks, "facts_to", "pose, i, constants, facts", body)
        return self.whole(blocks, pieces.probe)


def _written(rows: str, numbers: Sequence[int], found: str, first: int = 0) -> str:
    """Return the lines that write the numbers of a tuple into rows."""
    return "".join(f"    {rows}[{first + k}, i] = {found}[{k}]\n" for k in numbers)


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


class Sweep:
    """The compiled entries of a recipe: :data:`ENTRIES`.

    Each is put together, compiled or loaded at its first call.

    Parameters
    ----------
    recipe : Recipe
    """

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        texts = _Texts(recipe)
        own = {
            "skeletons": texts.skeletons, "placed": texts.placed, "probe": texts.probe,
            "indices": texts.indices, "lines": texts.lines,
            "margins": texts.evaluations if texts.heavy else texts.margins,
        }  # fmt: skip
        self._own = own
        self._heavy = texts.heavy
        self._on_compile: Callable[[], None] | None = None

    @property
    def on_compile(self) -> Callable[[], None] | None:
        """Called before a compilation."""
        return self._on_compile

    @on_compile.setter
    def on_compile(self, call: Callable[[], None] | None) -> None:
        self._on_compile = once(call)
        for name in ENTRIES:
            for compiled, _ in self.parts(name):
                compiled.on_compile = self._on_compile

    def _made_of(self, name: str) -> tuple[str, ...]:
        """Return the pieces that an entry takes, in order; "" for one that there is none of."""
        indices = "" if self._heavy else "indices"
        conditions = "conditions" if self._heavy or self.recipe.order != 3 else ""
        lines = "lines" if self.recipe.line is not None else ""
        return {
            "sweep": ("fill", "margins", indices, conditions, lines),
            "field": ("margins", indices, conditions),
            "points": ("fill",),
            "probe": (),
            "outline": ("fill", "margins", "skeletons"),
            "locate": ("placed",),
        }[name]

    def _part(self, name: str) -> tuple[Compiled, str]:
        """Return the text of a piece and its entry."""
        recipe = self.recipe
        if name in _COMMON:
            return _shared(("common", name), lambda: common_text(name), name, _COMMON[name])
        if name == "conditions":
            key = ("conditions", recipe.order, recipe.norm)
            text = functools.partial(conditions_text, recipe.order, recipe.norm)
            return _shared(key, text, name, _CONDITIONS)
        rows = recipe.scratch_rows + (recipe.skeleton_size if name == "skeletons" else 0)
        block = f"float64[{rows},{sweep.PITCH}]"
        given = {"lines": _LINES, "probe": (_TABLE, "float64[:]", _TABLE)}.get(name, _POINTWISE)
        given = tuple(block if a == _BLOCK else a for a in given)
        entry = "evaluations" if name == "margins" and self._heavy else name
        return _shared((recipe, name), self._own[name], entry, given)

    def parts(self, name: str) -> list[tuple[Compiled, str]]:
        """Return the texts, and their entries, that an entry is put together of."""
        return [self._part(part) for part in (name, *self._made_of(name)) if part]

    def is_compiled(self, name: str) -> bool:
        """Return whether the machine code of all that an entry is made of is kept."""
        return all(compiled.is_compiled(entry) for compiled, entry in self.parts(name))

    def __getattr__(self, name: str) -> Callable[..., None]:
        """Return an entry as a function of numbers and arrays."""
        if name not in ENTRIES:
            raise AttributeError(name)
        compiled, entry = self._part(name)
        function: Callable[..., None] = getattr(compiled, entry)
        addresses = []
        for piece in self._made_of(name):
            if piece:
                part, part_entry = self._part(piece)
                addresses.append(part.address(part_entry))
            else:
                addresses.append(0)
        rows, ends = self.recipe.scratch_rows, 2 * len(self.recipe.segments)

        at = _COMMON.get(name, ()).index(_BLOCK) if name in _COMMON else -1

        def call(*arguments: Any) -> None:
            if len(arguments[at]) != rows:  # pieces take the length for granted
                raise TypeError(f"{name}: a C-contiguous float64[{rows},{sweep.PITCH}] is needed")
            function(*arguments, *addresses)

        def with_room(*arguments: Any) -> None:
            # Skeletons take a larger block.
            block = np.empty((rows + self.recipe.skeleton_size, sweep.PITCH))
            chosen = np.empty(sweep.BLOCK, dtype=np.int64)
            function(*arguments[:-1], block, rows, chosen, ends, *addresses)

        made = with_room if name == "outline" else call if addresses else function
        setattr(self, name, made)
        return made


def _shared(
    key: Any, text: Callable[[], str], entry: str, arguments: tuple[str, ...]
) -> tuple[Compiled, str]:
    """Return a text that several recipes may have, and its entry."""
    if key not in _loaded:
        made = text()
        _loaded[key] = _loaded.setdefault((made, entry), Compiled(made, [Entry(entry, arguments)]))
    return _loaded[key], entry


def module_text(recipe: Recipe) -> str:
    """Return all that is compiled of a recipe, one text after the other."""
    made = Sweep(recipe)
    texts = {c.text for name in ENTRIES for c, _ in made.parts(name)}
    return "\n\n".join(sorted(texts))


def specialise(recipe: Recipe, on_compile: Callable[[], None] | None = None) -> Sweep:
    """Return the compiled sweep of a recipe.

    Each piece is compiled once per machine and kernel text, when it is first called.

    Parameters
    ----------
    recipe : Recipe
    on_compile : callable, optional
        Called before a compilation, which takes a second.
    """
    if recipe not in _loaded:
        _loaded[recipe] = Sweep(recipe)
    found: Sweep = _loaded[recipe]
    found.on_compile = on_compile
    return found
