"""The forward or inverse kinematics of a mechanism, row by row: compiled, or plainly for a few."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler import programs
from pmopt.compiler.programs import Assembler

Array = NDArray[np.float64]

#: Rows in a call: what a thread takes at once.
CHUNK = 256
#: What this process has the machine code of.
_ready: set[Assembler] = set()


def assemble_rows(
    assembler: Assembler,
    joints: Array,
    constants: Array,
    spread: Callable[[Callable[[int], None], range], Iterable[None]] = map,
) -> tuple[Array, NDArray[np.int64]]:
    """Return what :func:`pmopt.kernels.assembly.assemble_all` finds and counts.

    Parameters
    ----------
    assembler : Assembler
    joints : (N, n) float64
    constants : (c,) float64
    spread : callable
        Like ``map``, and may call on several threads at once: results do not depend on it.
    """
    compiled = programs.assembling(assembler)
    solve = compiled.assemble_all  # compiled here, before threads ask for it
    _ready.add(assembler)
    found = np.zeros((len(joints), assembler.modes, assembler.columns))
    counts = np.zeros((len(joints), 2), dtype=np.int64)

    def one(start: int) -> None:
        rows = slice(start, start + CHUNK)
        solve(joints[rows], constants, found[rows], counts[rows], np.zeros(assembler.work))

    for _ in spread(one, range(0, len(joints), CHUNK)):
        pass
    return found, counts


def is_ready(assembler: Assembler) -> bool:
    """Return whether this process has the machine code: then a few rows are solved by it, too."""
    return assembler in _ready


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
