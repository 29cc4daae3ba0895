"""What a kernel solves step by step, as equations: what proofs are about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Implicit:
    """Equations that a kernel solves, for proofs about its solution.

    Attributes
    ----------
    unknowns : int
        Number m of unknowns, angles not reduced to a turn.
    inner : tuple of int
        Numbers of the pose coordinates that the unknowns depend on.
    residuals : callable
        ``residuals(*pose, unknowns, constants)``: m expressions that vanish at the solution.
    outcome : callable
        ``outcome(*pose, unknowns, constants)``: what the kernel returns, at unknowns that solve.
    start : callable
        ``start(*pose, constants)``: the kernel's solution, m numbers.
    """

    unknowns: int
    inner: tuple[int, ...]
    residuals: Callable[..., tuple[Any, ...]]
    outcome: Callable[..., tuple[Any, ...]]
    start: Callable[..., list[float]]


@dataclass(frozen=True)
class Curve:
    """A curve of configurations along which a kernel seeks a pose coordinate, for proofs.

    With the other coordinates given, the configurations are numbered by v in [-pi, pi]. The pose is
    reached on the piece about v = 0 on which the coordinate is monotonic.

    Attributes
    ----------
    coordinate : int
        Number of the pose coordinate.
    outcome : callable
        ``outcome(*pose with v in the coordinate's place, constants)``: the coordinate, its slope by
        v with the sign that is asked for, and what the kernel returns.
    """

    coordinate: int
    outcome: Callable[..., tuple[Any, ...]]
