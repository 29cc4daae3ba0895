"""Compiled forward and inverse kinematics: many sets of joint positions, or poses, in one call.

A mechanism's ``assemble(joints, constants, found, work)`` is plain Python on floats and arrays; it
writes the assembly modes of one set of joint positions, a row each, and returns how many there are
and whether they are proven to be all. Here its text is compiled and called for a table of joint
positions. Multiplications and additions are not contracted: every processor gives the same digits.
The inverse kinematics, where it is not written out in closed form, is such a function of a pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.machine_code import Compiled, Entry
from pmopt.compiler.program_text import PREFACE, collect
from pmopt.kernels.trigonometry import arc_tangent

Array = NDArray[np.float64]

#: Neither contracted nor inlined by force: results are to be the same everywhere.
_DECORATOR = '@njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)'
_ENTRIES = (
    Entry("assemble_all", (
        "float64[:,:]", "float64[:]", "float64[:,:,:]", "int64[:,:]", "float64[:]",
    )),
)  # fmt: skip
#: Sets of joint positions in a call: what a thread takes at once.
CHUNK = 256


def assembly_angles(r):  # type: ignore[no-untyped-def]
    """Return a, b, c of Rz(a) Ry(b) Rx(c), b in [-pi/2, pi/2], of a rotation row by row."""
    r11, r12, r13, r21, r22, r23, r31, _, _ = r
    level = math.sqrt(r11 * r11 + r21 * r21)
    ca = r11 / level if level > 0.0 else 1.0
    sa = r21 / level if level > 0.0 else 0.0
    a = arc_tangent(sa, ca)
    b = arc_tangent(0.0 - r31, level)
    # From the rotation with a taken out: exact where b is a quarter turn, too.
    c = arc_tangent(sa * r13 - ca * r23, ca * r22 - sa * r12)
    half = 3.141592653589793
    return a if a > -half else half, b, c if c > -half else half


def assembly_principal(angle):  # type: ignore[no-untyped-def]
    """Return the angle within half a turn of 0."""
    return angle - 6.283185307179586 * math.floor(angle / 6.283185307179586 + 0.5)


def assembly_sort(found, count, columns):  # type: ignore[no-untyped-def]
    """Sort the first rows by their last column, equal ones in their order."""
    for i in range(1, count):
        k = i
        while k > 0 and found[k, columns - 1] < found[k - 1, columns - 1]:
            for c in range(columns):
                value = found[k, c]
                found[k, c] = found[k - 1, c]
                found[k - 1, c] = value
            k -= 1


def assemble_all(joints, constants, found, counts, work):  # type: ignore[no-untyped-def]
    """Call a mechanism's ``assemble_one`` for each row of joint positions.

    Parameters
    ----------
    joints : (N, n)
    constants : (c,)
    found : (N, modes, columns)
    counts : (N, 2) int64
        How many assembly modes, and 1 where they are proven to be all. Joint positions that leave
        the platform free to move have -1.
    work : (w,)
        0 where it begins.
    """
    for i in range(joints.shape[0]):
        count, proven = assemble_one(joints[i], constants, found[i], work)
        counts[i, 0] = count
        counts[i, 1] = 1 if proven else 0


def assemble_one(joints, constants, found, work):  # type: ignore[no-untyped-def]
    """Stand for the mechanism's own function."""
    raise NotImplementedError


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


_loaded: dict[Assembler, Compiled] = {}


def load(assembler: Assembler) -> Compiled:
    """Return the compiled ``assemble_all`` of a mechanism."""
    if assembler not in _loaded:
        blocks: dict[str, str] = {}
        collect(assembler.assemble, blocks, (), _DECORATOR)
        name = assembler.assemble.__name__
        blocks["assemble_one"] = f"assemble_one = {name}"
        collect(assemble_all, blocks, ("assemble_one",), _DECORATOR)
        _loaded[assembler] = Compiled(PREFACE + "\n\n".join(blocks.values()), _ENTRIES)
    return _loaded[assembler]


def assemble_rows(
    assembler: Assembler,
    joints: Array,
    constants: Array,
    spread: Callable[[Callable[[int], None], range], Iterable[None]] = map,
) -> tuple[Array, NDArray[np.int64]]:
    """Return what :func:`assemble_all` finds and counts.

    Parameters
    ----------
    assembler : Assembler
    joints : (N, n) float64
    constants : (c,) float64
    spread : callable
        Like ``map``, and may call on several threads at once: results do not depend on it.
    """
    compiled = load(assembler)
    solve = compiled.assemble_all  # compiled here, before threads ask for it
    found = np.zeros((len(joints), assembler.modes, assembler.columns))
    counts = np.zeros((len(joints), 2), dtype=np.int64)

    def one(start: int) -> None:
        rows = slice(start, start + CHUNK)
        solve(joints[rows], constants, found[rows], counts[rows], np.zeros(assembler.work))

    for _ in spread(one, range(0, len(joints), CHUNK)):
        pass
    return found, counts


def assemble_plainly(
    assembler: Assembler, rows: Array, constants: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Return what :func:`assemble_rows` does, uncompiled: for a few rows."""
    found = np.zeros((len(rows), assembler.modes, assembler.columns))
    counts = np.zeros((len(rows), 2), dtype=np.int64)
    plain = tuple(constants.tolist())
    # Far off numbers overflow, and end in a gap.
    with np.errstate(over="ignore", invalid="ignore"):
        for k, row in enumerate(rows.tolist()):
            counts[k] = assembler.assemble(row, plain, found[k], np.zeros(assembler.work))
    return found, counts
