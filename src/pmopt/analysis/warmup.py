"""Compile kernels before they are needed, several at once."""

from __future__ import annotations

from collections.abc import Iterable

from pmopt.analysis.sweeper import Sweeper
from pmopt.numerics import cells
from pmopt.numerics.compiled import compile_ahead


def warm_up(sweepers: Iterable[Sweeper], workers: int, shapes: bool = True) -> dict[str, int]:
    """Compile what is missing of all that some sweepers and the shapes of their workspaces call.

    In processes of their own: this one stays free to be interrupted.

    Parameters
    ----------
    sweepers : iterable of Sweeper
    workers : int
        Processes at most.
    shapes : bool
        False leaves out what only shapes, positions and pictures call.

    Returns
    -------
    dict
        By mechanism, the number of kernels that had to be compiled.
    """
    shared = cells.kernels()
    wanted = [(shared, entry.name) for entry in shared.entries] if shapes else []
    missing: dict[str, int] = {}
    for sweeper in sweepers:
        new = [
            (compiled, entry)
            for compiled, entries in (
                sweeper.kernels if shapes else sweeper.sampling_kernels
            ).items()
            for entry in entries
            if (compiled, entry) not in wanted
        ]
        wanted += new
        missing.setdefault(sweeper.mechanism.name, 0)
        missing[sweeper.mechanism.name] += sum(not c.is_compiled(name) for c, name in new)
    compile_ahead(wanted, workers)
    return missing
