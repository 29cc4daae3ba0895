"""Compiled programs: which kernel text each is made of, and what of it can be called.

Those of a workspace are put together by :mod:`pmopt.compiler.program_text`.
"""

from __future__ import annotations

import functools
import inspect
import itertools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from pmopt.compiler import records
from pmopt.compiler.lowering import AND, PIECE
from pmopt.compiler.machine_code import SCALAR, Compiled, Entry, once
from pmopt.compiler.program_text import INLINE, PLAIN, PREFACE, collect
from pmopt.kernels import (
    affine_forms,
    ascent,
    assembly,
    cells,
    inverse_dynamics,
    trigonometry,
)


def _numbers(module: Any, names: Iterable[str]) -> list[str]:
    return [f"{name} = {getattr(module, name)!r}" for name in names]


# --- sets of cells ------------------------------------------------------------------------


@functools.cache
def counting() -> Compiled:
    """Return the compiled functions of :mod:`pmopt.kernels.cells`."""
    entries = (
        Entry("lattice", ("float64[:,:]", "int64", "float64[:,:]")),
        Entry("label_runs", (
            "uint8[:,:]", "int64[:]", "int64", "int32[:,:]", "int64[:,:]", "int64[:]", "int64[:]",
        )),
        Entry("chain", ("float64[:,:]", "int64[:]", "int64[:]")),
    )  # fmt: skip
    functions = (cells.lattice, cells.label_runs, cells.chain)
    text = "".join(f"@njit\n{inspect.getsource(f)}\n\n" for f in functions)
    return Compiled(f"{SCALAR}import numpy as np\nfrom numba import njit\n\n\n{text}", entries)


# --- searches along fibres ----------------------------------------------------------------


@functools.cache
def searching() -> Compiled:
    """Return the compiled ``advance`` of :mod:`pmopt.kernels.ascent`."""
    entry = Entry("advance", (
        "int64", "int64[:]", "float64[:,:]", "float64[:,:,:]", "float64[:,:]", "float64[:]",
        "float64[:]", "float64[:,:]", "float64[:,:]", "float64[:,:]", "float64[:,:,:]",
        "float64[:,:]", "int64[:]", "float64[:,:]", "float64[:,:]",
    ))  # fmt: skip
    numbers = _numbers(ascent, (
        "MOST_FREE", "PLANES", "DIFFERENCE", "CLOSE", "NEAR", "HALF", "LEAST_STEP", "LONGEST",
        "BENT", "AIM", "POOR", "FIRST_STEP", "STEP", "MISSED", "PART", "FROM", "AIMED",
        "HOPE_TURNS", "GOES_ON", "REACHED", "ENDED",
    ))  # fmt: skip
    functions = (
        ascent.least_plane, ascent.offer, ascent.highest, ascent.newton, ascent.across,
        ascent.raise_slack, ascent.add_plane, ascent.advance,
    )  # fmt: skip
    text = "".join(f"{INLINE}\n{inspect.getsource(f)}\n\n" for f in functions)
    head = "import math\n\nfrom numba import njit\n\n" + "".join(f"{n}\n" for n in numbers)
    return Compiled(f"{SCALAR}{head}\n\n{text}", (entry,))


# --- forward and inverse kinematics -------------------------------------------------------


class Assembler(NamedTuple):
    """What the forward kinematics of a mechanism is compiled from.

    Attributes
    ----------
    assemble : function
        ``assemble(joints, constants, found, work) -> (count, proven)``.
    modes, columns, work : int
        Rows and columns of ``found`` (pose, parasitic coordinates, residual, what rows are sorted
        by) and the length of the scratch space.
    """

    assemble: Callable[..., tuple[int, bool]]
    modes: int
    columns: int
    work: int


@functools.cache
def assembling(assembler: Assembler) -> Compiled:
    """Return the compiled :func:`pmopt.kernels.assembly.assemble_all` of a mechanism."""
    entry = Entry("assemble_all", (
        "float64[:,:]", "float64[:]", "float64[:,:,:]", "int64[:,:]", "float64[:]",
    ))  # fmt: skip
    blocks: dict[str, str] = {}
    collect(assembler.assemble, blocks, (), PLAIN)
    blocks["assemble_one"] = f"assemble_one = {assembler.assemble.__name__}"
    collect(assembly.assemble_all, blocks, ("assemble_one",), PLAIN)
    return Compiled(SCALAR + PREFACE + "\n\n".join(blocks.values()), (entry,))


# --- motions ------------------------------------------------------------------------------


class Moving(NamedTuple):
    """What motions are compiled for: see :attr:`pmopt.mechanisms.mechanism.Mechanism.posture`."""

    posture: Callable[..., tuple[float, ...]]
    pose_size: int
    constants: type[Any]
    stance_size: int


#: What the posture of a mechanism takes.
_POSTURE = ("float64[:,:]", "int64", "float64[:]", "float64[:]")


@functools.cache
def _posture(recipe: Moving) -> Compiled:
    """Return what writes the posture of a mechanism."""
    blocks: dict[str, str] = {}
    collect(recipe.posture, blocks, (), PLAIN)
    pose = ", ".join(f"poses[t, {k}]" for k in range(recipe.pose_size))
    records.declare(recipe.constants, blocks)
    constants = records.call(recipe.constants, (f"constants[{k}]" for k in itertools.count()))
    lines = [f"s = {recipe.posture.__name__}({pose}, {constants})"]
    lines += [f"out[{k}] = s[{k}]" for k in range(recipe.stance_size)]
    body = "".join(f"    {line}\n" for line in lines)
    blocks["posture_to"] = f"{PLAIN}\ndef posture_to(poses, t, constants, out):\n{body}"
    text = SCALAR + PREFACE + "\n\n".join(blocks.values())
    return Compiled(text, (Entry("posture_to", _POSTURE),))


@functools.cache
def _move() -> Compiled:
    """Return :func:`pmopt.kernels.inverse_dynamics.move` as an entry of arrays and numbers."""
    blocks: dict[str, str] = {}
    collect(inverse_dynamics.move, blocks, (), PLAIN)
    made: list[str] = []
    names: list[str] = []
    types: list[str] = []
    for record in inverse_dynamics.RECORDS:
        records.declare(record, blocks)
        names += record._fields
        types += [kind.__metadata__[0] for kind in record.__annotations__.values()]
        made.append(records.call(record, record._fields))
    body = f"    move({', '.join(made)}, posture_to)\n"
    blocks["move_all"] = f"{PLAIN}\ndef move_all({', '.join(names)}, posture_to):\n{body}"
    entry = Entry("move_all", (*types, PIECE + AND.join(_POSTURE)))
    return Compiled(SCALAR + PREFACE + "\n\n".join(blocks.values()), (entry,))


class Moves:
    """The compiled inverse dynamics of a mechanism, put together of two texts.

    Parameters
    ----------
    recipe : Moving
    on_compile : callable, optional
        Called before a compilation.
    """

    def __init__(self, recipe: Moving, on_compile: Callable[[], None] | None = None) -> None:
        self._parts = [(_move(), "move_all"), (_posture(recipe), "posture_to")]
        self.on_compile = once(on_compile)
        for compiled, _ in self._parts:
            compiled.on_compile = self.on_compile

    def parts(self, name: str) -> list[tuple[Compiled, str]]:
        """Return the texts, and their entries, that the entry is put together of."""
        return self._parts

    def is_compiled(self, name: str) -> bool:
        """Return whether the machine code of both is kept."""
        return all(compiled.is_compiled(entry) for compiled, entry in self._parts)

    def move_all(self, *arguments: Any) -> None:
        """Call :func:`pmopt.kernels.inverse_dynamics.move` with what its records hold."""
        (move, name), (posture, entry) = self._parts
        getattr(move, name)(*arguments, posture.address(entry))


def moving(recipe: Moving, on_compile: Callable[[], None] | None = None) -> Moves:
    """Return the compiled inverse dynamics of a mechanism."""
    return Moves(recipe, on_compile)


# --- certificates -------------------------------------------------------------------------


def enclosing(on_compile: Callable[[], None] | None = None) -> Compiled:
    """Return the compiled ``evaluate`` and ``shares`` of :mod:`pmopt.kernels.affine_forms`."""
    entries = (
        Entry("evaluate", (
            "int64[:,:]", "float64[:]", "int64[:]", "float64[:,:,:]", "float64[:,:]",
            f"float64[:,:,{affine_forms.LANES}]", "float64[:,:,:]",
        )),
        Entry("shares", ("float64[:,:,:]", "float64[:]", "float64[:]", "float64[:]")),
    )  # fmt: skip
    lines = ["import math", "import numpy as np", "from numba import njit"]
    lines += _numbers(affine_forms, ("LANES", "EPS", "UP", "LEAST", "SINE_ERROR"))
    lines += _numbers(trigonometry, (
        "TWO_OVER_PI", "HALF_PI_1", "HALF_PI_2", *(f"S{k}" for k in range(1, 7)),
        *(f"K{k}" for k in range(1, 7)),
    ))  # fmt: skip
    functions = (
        trigonometry.sin_cos, affine_forms.half_space, affine_forms.evaluate, affine_forms.shares,
    )  # fmt: skip
    for function in functions:
        lines.append(f'@njit(error_model="numpy")\n{inspect.getsource(function)}')
    return Compiled(SCALAR + "\n\n".join(lines), entries, on_compile)
