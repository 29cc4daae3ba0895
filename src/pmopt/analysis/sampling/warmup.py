"""Compile kernels before they are needed, several at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from pmopt.analysis.sampling.evaluator import Evaluator
from pmopt.compiler import programs
from pmopt.compiler.machine_code import Program, compile_ahead

if TYPE_CHECKING:  # a workspace does without
    from pmopt.analysis.kinematics.forward import Assembling
    from pmopt.analysis.kinematics.inverse import Inverting
    from pmopt.analysis.motion.dynamics import Mover


def warm_up(
    users: Iterable[Evaluator | Mover | Assembling | Inverting],
    workers: int,
    shapes: bool = True,
    extremes: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, int]:
    """Compile what is missing of all that workspaces, their shapes and motions call.

    In several processes, where there is enough of it.

    Parameters
    ----------
    users : iterable of Evaluator, Mover, Assembling and Inverting
    workers : int
        Processes at most.
    shapes : bool
        False leaves out what only shapes, positions and pictures call.
    extremes : bool
        Without shapes, keep what looks for the extremes of the index.
    progress : callable, optional
        Receives how many kernels are compiled and how many were missing.

    Returns
    -------
    dict
        By mechanism, the number of kernels that had to be compiled.
    """
    shared = (programs.counting(), programs.searching()) if shapes else ()
    wanted: list[tuple[Program, str]] = [
        (compiled, entry.name) for compiled in shared for entry in compiled.entries
    ]
    missing: dict[str, int] = {}
    for user in users:
        called: Mapping[Program, tuple[str, ...]] = user.kernels  # type: ignore[assignment]
        if isinstance(user, Evaluator) and not shapes:
            called = user.measuring_kernels if extremes else user.sampling_kernels
        new = [
            (compiled, entry)
            for compiled, entries in called.items()
            for entry in entries
            if (compiled, entry) not in wanted
        ]
        wanted += new
        missing.setdefault(user.mechanism.name, 0)
        missing[user.mechanism.name] += sum(not c.is_compiled(name) for c, name in new)
    compile_ahead(wanted, workers, progress)
    return missing
