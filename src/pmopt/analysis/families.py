"""Families of singular poses: slices with some coordinates fixed that are singular throughout.

Slices with coordinates at 0 and, for angles, at quarter and half turns are tried; in each, a
further coordinate is fixed where the determinant changes sign at the same value for all of the
others. All orientations that the limits leave are searched, also beyond a mechanism's default
domain.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.aspects import determinants
from pmopt.analysis.measures import measures_at
from pmopt.analysis.sweeper import Design, Sweeper
from pmopt.mechanisms.base import Vector
from pmopt.seeds import seed_sequence

#: A slice is singular if no pose of it has a larger index.
_SINGULAR = 1e-7
#: Reachable poses of a slice that are looked at, the least number that tells anything, and how
#: many are drawn for one that is to be reachable.
_POSES, _LEAST, _DRAWN = 96, 24, 64
#: Lines along a further coordinate, points of each, lines that must agree on a zero, and halvings
#: that locate it.
_LINES, _POINTS, _AGREE, _HALVINGS = 8, 97, 5, 60
#: A zero this close to a special value, or to another zero, is the same.
_SAME = 1e-9


@dataclass(frozen=True)
class Family:
    """A slice of what can be reached that is singular throughout.

    Attributes
    ----------
    kind : str
    fixed : dict
        The coordinates that define it.
    free : tuple of str
        Those that may have any value in reach.
    in_domain : bool
        Whether it passes through the domain that was searched, or beyond it.
    largest_lci : float
        Over ``poses`` poses of it.
    """

    kind: str
    fixed: dict[str, float]
    free: tuple[str, ...]
    in_domain: bool
    largest_lci: float
    poses: int


class _Search:
    """One search, over the box of everything within reach."""

    def __init__(self, sweeper: Sweeper, design: Design) -> None:
        mechanism = sweeper.mechanism
        self.sweeper, self.design = sweeper, design
        self.names = [c.name for c in mechanism.pose]
        self.lower, upper = mechanism.reach_box(design.parameters, design.limits)
        for k, name in enumerate(self.names):
            low, high = sweeper.domain.get(name, (-math.inf, math.inf))
            self.lower[k], upper[k] = max(self.lower[k], low), min(upper[k], high)
        self.width = upper - self.lower
        self.rng = np.random.Generator(
            np.random.PCG64(seed_sequence(sweeper.seed, "singular slices"))
        )
        self.found: list[Family] = []

    def special(self, k: int) -> list[float]:
        """Return the values of a coordinate that slices are tried at."""
        angle = self.sweeper.mechanism.pose[k].kind == "angle"
        some = (0.0, math.pi / 2, -math.pi / 2, math.pi) if angle else (0.0,)
        low, high = self.lower[k], self.lower[k] + self.width[k]
        return [v for v in some if low - 1e-12 <= v <= high + 1e-12]

    def known(self, fixed: dict[str, float]) -> bool:
        """Return whether a slice lies in a family that has been found."""
        return any(f.fixed.items() <= fixed.items() for f in self.found)

    def reachable(self, fixed: dict[str, float]) -> tuple[NDArray[np.float64], Vector]:
        """Return some reachable poses of a slice and their indices."""
        unit = self.rng.uniform(0.001, 0.999, (len(self.names), _DRAWN * _POSES))
        poses = self.lower[:, None] + self.width[:, None] * unit
        for name, value in fixed.items():
            poses[self.names.index(name)] = value
        margin, lci = self.sweeper.field(self.design, poses)
        inside = np.flatnonzero(margin > 0)[:_POSES]
        return poses[:, inside], lci[inside]

    def examine(self, fixed: dict[str, float]) -> NDArray[np.float64] | None:
        """Add the slice if it is singular throughout; return poses of it that are not."""
        poses, lci = self.reachable(fixed)
        if poses.shape[1] < _LEAST:
            return None
        if lci.max() > _SINGULAR:
            return poses
        kinds = self._kinds(poses[:, 0])
        if kinds:  # else the angles are singular there (gimbal lock), not the mechanism
            width = 1e-12 * np.maximum(self.design.width, 1.0)
            places = [(self.names.index(k), v) for k, v in fixed.items()]
            low, high = self.design.lower - width, self.design.lower + self.design.width + width
            self.found.append(
                Family(
                    kinds[0],
                    fixed,
                    tuple(n for n in self.names if n not in fixed),
                    all(low[k] <= v <= high[k] for k, v in places),
                    float(lci.max()),
                    poses.shape[1],
                )
            )
        return None

    def _kinds(self, values: Vector) -> list[str]:
        """Return the kinds of the measures that vanish at a pose, the smallest first."""
        pose = dict(zip(self.names, values.tolist(), strict=True))
        sweeper = self.sweeper
        measures = (
            measures_at(sweeper.mechanism, sweeper.working_mode, self.design.parameters, pose) or {}
        )
        small = {key: abs(v) for key, v in measures.items() if abs(v) <= _SINGULAR}
        return [kind for kind, _ in sorted(small, key=lambda key: small[key])]

    def further(self, fixed: dict[str, float], poses: NDArray[np.float64]) -> None:
        """Look for a value of one more coordinate at which the rest of the slice is singular."""
        for k, name in enumerate(self.names):
            if name in fixed:
                continue
            lines = np.repeat(poses[:, :_LINES], _POINTS, axis=1)
            line = np.linspace(self.lower[k], self.lower[k] + self.width[k], _POINTS)
            lines[k] = np.tile(line, min(_LINES, poses.shape[1]))
            shape = (-1, _POINTS)
            inside = self.sweeper.field(self.design, lines)[0].reshape(shape) >= 0
            dets = determinants(self.sweeper, self.design, lines).reshape(shape)
            crossed = (dets[:, :-1] * dets[:, 1:] <= 0) & inside[:, :-1] & inside[:, 1:]
            # Only where most lines have a zero in about the same place is it worth locating.
            spread = crossed[:, :-1] | crossed[:, 1:]
            for cell in np.flatnonzero(spread.sum(axis=0) >= _AGREE):
                value = self._zero(k, lines.reshape(len(lines), *shape), dets, crossed, int(cell))
                if value is None:
                    continue
                pinned = {**fixed, name: value}
                ordered = {n: pinned[n] for n in self.names if n in pinned}
                if not self.known(ordered):
                    self.examine(ordered)

    def _zero(
        self,
        k: int,
        lines: NDArray[np.float64],
        dets: NDArray[np.float64],
        crossed: NDArray[np.bool_],
        cell: int,
    ) -> float | None:
        """Return where the determinant vanishes on all lines that cross near a cell, if it does."""
        ends = []
        for row in range(len(dets)):
            for place in (cell, cell + 1):
                if place < crossed.shape[1] and crossed[row, place]:
                    ends.append((row, place))
                    break
        rows, places = (np.array(v) for v in zip(*ends, strict=True))
        low, high = lines[:, rows, places].copy(), lines[:, rows, places + 1].copy()
        sign = np.sign(dets[rows, places])
        for halving in range(_HALVINGS):
            middle = (low + high) / 2
            same = determinants(self.sweeper, self.design, middle) * sign > 0
            low, high = np.where(same, middle, low), np.where(same, high, middle)
            if halving == 12 and np.ptp(middle[k]) > 4 * np.abs(high[k] - low[k]).max():
                return None
        zeros = (low[k] + high[k]) / 2
        if np.ptp(zeros) > _SAME * max(1.0, float(np.abs(zeros).max())):
            return None
        value = float(np.median(zeros))
        if self.sweeper.mechanism.pose[k].kind == "angle" and abs(value + math.pi) <= _SAME:
            value = math.pi
        return next((v for v in self.special(k) if abs(v - value) <= _SAME), value)


def find_families(sweeper: Sweeper, design: Design) -> tuple[Family, ...]:
    """Find slices that are singular throughout; one that lies in another found is left out.

    Parameters
    ----------
    sweeper : Sweeper
        Its domain, where one is given, bounds the search; a mechanism's default domain does not.
    design : Design
        Its box must not be empty.
    """
    search = _Search(sweeper, design)
    dimension = len(search.names)
    for size in range(dimension):
        for chosen in itertools.combinations(range(dimension), size):
            for values in itertools.product(*(search.special(k) for k in chosen)):
                fixed = {search.names[k]: v for k, v in zip(chosen, values, strict=True)}
                if search.known(fixed):
                    continue
                poses = search.examine(fixed)
                if poses is not None and size + 1 < dimension:
                    search.further(fixed, poses)
    # One found early by a further coordinate may lie in one found later.
    whole = [
        family
        for family in search.found
        if not any(other.fixed.items() < family.fixed.items() for other in search.found)
    ]
    return tuple(sorted(whole, key=lambda f: (not f.in_domain, len(f.fixed))))
