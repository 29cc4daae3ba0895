"""Families of singular poses: slices with some coordinates fixed that are singular throughout.

Slices with coordinates at 0 and, for angles, at quarter and half turns are tried; in each, a
further coordinate is fixed wherever the determinant vanishes, with a change of sign or without,
at the same value for all of the others that get there. All orientations that the limits leave are
searched, also beyond a mechanism's default domain.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.determinants import measures_at
from pmopt.analysis.sampling.aspects import determinants, determinants_along
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import Sampler
from pmopt.analysis.singularities.touching import least_along
from pmopt.mechanisms.mechanism import Vector
from pmopt.seeds import seed_sequence

#: A slice is singular if no pose of it has a larger index.
_SINGULAR = 1e-7
#: Reachable poses of a slice that are looked at, the least number that says anything, and how
#: many are drawn for one that is to be reachable.
_POSES, _LEAST, _DRAWN = 96, 24, 64
#: Most draws for a slice that only few poses of its other coordinates reach.
_MOST_DRAWN = 1 << 18
#: Lines along a further coordinate, points of each, the fewest that must have a zero, and halvings
#: that locate it.
_LINES, _POINTS, _FEWEST, _HALVINGS = 48, 97, 3, 60
#: A zero this close to a special value, or to another zero, is the same: touches are located to
#: the root of what rounding leaves.
_NEARLY = 2e-7
#: A determinant this small is 0.
_TOUCHES = 1e-13


@dataclass(frozen=True)
class Family:
    """A slice of the reachable set that is singular throughout.

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

    def __init__(self, sampler: Sampler, design: Design) -> None:
        mechanism = sampler.space.mechanism
        self.sampler, self.design = sampler, design
        self.names = [c.name for c in mechanism.pose]
        self.lower, upper = mechanism.reach_box(design.parameters, design.limits)
        for k, name in enumerate(self.names):
            low, high = sampler.space.domain.get(name, (-math.inf, math.inf))
            self.lower[k], upper[k] = max(self.lower[k], low), min(upper[k], high)
        self.width = upper - self.lower
        self.rng = np.random.Generator(
            np.random.PCG64(seed_sequence(sampler.seed, "singular slices"))
        )
        self.found: list[Family] = []

    def special(self, k: int) -> list[float]:
        """Return the values of a coordinate that slices are tried at."""
        angle = self.sampler.space.mechanism.pose[k].kind == "angle"
        some = (0.0, math.pi / 2, -math.pi / 2, math.pi) if angle else (0.0,)
        low, high = self.lower[k], self.lower[k] + self.width[k]
        return [v for v in some if low - 1e-12 <= v <= high + 1e-12]

    def known(self, fixed: dict[str, float]) -> bool:
        """Return whether a slice lies in a family that has been found."""
        return any(f.fixed.items() <= fixed.items() for f in self.found)

    def reachable(self, fixed: dict[str, float]) -> tuple[NDArray[np.float64], Vector]:
        """Return some reachable poses of a slice and their indices.

        Of a slice that is rarely reached more are drawn, unless nothing of it is.
        """
        count, kept, indices = _DRAWN * _POSES, [], []
        while True:
            unit = self.rng.uniform(0.001, 0.999, (len(self.names), count))
            poses = self.lower[:, None] + self.width[:, None] * unit
            for name, value in fixed.items():
                poses[self.names.index(name)] = value
            margin, lci = self.sampler.evaluator.field(self.design, poses)
            inside = np.flatnonzero(margin > 0)[:_POSES]
            kept.append(poses[:, inside])
            indices.append(lci[inside])
            found = sum(map(len, indices))
            if found == 0 or found >= _LEAST or count >= _MOST_DRAWN:
                return np.concatenate(kept, axis=1), np.concatenate(indices)
            count *= 4

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
        sampler = self.sampler
        measures = (
            measures_at(
                sampler.space.mechanism, sampler.space.working_mode, self.design.parameters, pose
            )
            or {}
        )
        small = {key: abs(v) for key, v in measures.items() if abs(v) <= _SINGULAR}
        return [kind for kind, _ in sorted(small, key=lambda key: small[key])]

    def further(self, fixed: dict[str, float], poses: NDArray[np.float64]) -> None:
        """Look for values of one more coordinate at which the rest of the slice is singular."""
        free = [k for k, name in enumerate(self.names) if name not in fixed]
        for k, values in zip(free, self._zeros(free, poses[:, :_LINES]), strict=True):
            for value in values:
                pinned = {**fixed, self.names[k]: value}
                ordered = {n: pinned[n] for n in self.names if n in pinned}
                if not self.known(ordered):
                    self.examine(ordered)

    def _zeros(self, free: list[int], through: NDArray[np.float64]) -> list[list[float]]:
        """Return where the determinant vanishes on all lines along a coordinate that get there.

        Lines go through poses of a slice, along each of the free coordinates. Zeros are changes of
        sign, and touches: least sizes that are 0. How many lines get to a value depends on their
        other coordinates. Changes of sign along all coordinates are located together.
        """
        brackets = [self._bracketed(k, through) for k in free]
        crossed = self._crossed(through, [changes for changes, _ in brackets])
        touched = [self._touched(through, dips) for _, dips in brackets]
        zeros = []
        for k, across, touching in zip(free, crossed, touched, strict=True):
            values: list[float] = []
            for group in _grouped([*across, *touching]):
                value = self._snapped(k, float(np.median(group)))
                if value not in values and self._common(k, through, value, len(group)):
                    values.append(value)
            zeros.append(values)
        return zeros

    def _bracketed(self, k: int, through: NDArray[np.float64]) -> tuple[_Brackets, _Brackets]:
        """Return where the determinant changes its sign along a coordinate, and where it dips."""
        line = np.linspace(self.lower[k], self.lower[k] + self.width[k], _POINTS)
        lines = np.repeat(through, _POINTS, axis=1)
        lines[k] = np.tile(line, through.shape[1])
        shape = (-1, _POINTS)
        inside = self.sampler.evaluator.field(self.design, lines)[0].reshape(shape) >= 0
        dets = determinants(self.sampler.evaluator, self.design, lines).reshape(shape)
        rows, cells = np.nonzero(
            (dets[:, :-1] * dets[:, 1:] <= 0) & inside[:, :-1] & inside[:, 1:]
            & (dets[:, :-1] != dets[:, 1:])
        )  # fmt: skip
        crossed = _Brackets(k, rows, line[cells], line[cells + 1], np.sign(dets[rows, cells]))
        size = np.abs(dets)
        least = (size[:, 1:-1] <= size[:, :-2]) & (size[:, 1:-1] <= size[:, 2:])
        least &= (dets[:, :-2] * dets[:, 2:] > 0) & inside[:, 1:-1]
        rows, cells = np.nonzero(least)
        return crossed, _Brackets(k, rows, line[cells], line[cells + 2], np.ones(len(rows)))

    def _crossed(
        self, through: NDArray[np.float64], brackets: Sequence[_Brackets]
    ) -> list[list[float]]:
        """Return the zeros of lines at which the determinant changes sign, by halving."""
        if not any(len(b.rows) for b in brackets):
            return [[] for _ in brackets]
        axes, rows, low, high, sign = _joined(brackets)
        poses = through[:, rows]
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            same = (
                determinants_along(self.sampler.evaluator, self.design, poses, axes, middle) * sign
                > 0
            )
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        zeros = (low + high) / 2
        dets = self._along(poses, axes, zeros)
        kept = np.abs(dets) <= _TOUCHES
        return [zeros[kept & (axes == b.axis)].tolist() for b in brackets]

    def _touched(self, through: NDArray[np.float64], brackets: _Brackets) -> list[float]:
        """Return where the determinant's size is least and 0 without a change of sign."""
        if len(brackets.rows) == 0:
            return []
        poses, axis = through[:, brackets.rows], brackets.axis

        def size_at(values: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.abs(
                determinants_along(self.sampler.evaluator, self.design, poses, axis, values)
            )

        place, smallest = least_along(size_at, brackets.low, brackets.high)
        return list(place[smallest <= _TOUCHES].tolist())

    def _along(
        self, poses: NDArray[np.float64], axes: int | NDArray[np.int64],
        values: NDArray[np.float64],
    ) -> NDArray[np.float64]:  # fmt: skip
        """Return the determinants of poses with other values of a coordinate each."""
        return determinants_along(self.sampler.evaluator, self.design, poses, axes, values)

    def _common(self, k: int, through: NDArray[np.float64], value: float, count: int) -> bool:
        """Return whether nearly all lines that reach it, and at least some, have the zero."""
        poses = through.copy()
        poses[k] = value
        able = self.sampler.evaluator.field(self.design, poses)[0] >= 0
        # At the very end of the reach rounding decides.
        return count >= _FEWEST and count >= 0.8 * int(able.sum()) - 1

    def _snapped(self, k: int, value: float) -> float:
        """Return the special value that a zero is, if it is one."""
        if self.sampler.space.mechanism.pose[k].kind == "angle" and abs(value + math.pi) <= _NEARLY:
            value = math.pi
        return next((v for v in self.special(k) if abs(v - value) <= _NEARLY), value)


class _Brackets(NamedTuple):
    """Ends between which determinants vanish, maybe, along one coordinate of m lines.

    Attributes
    ----------
    axis : int
        The coordinate.
    rows : (m,) int64
        Which pose each line goes through.
    low, high : (m,) float64
    sign : (m,) float64
        That of the determinant at ``low``, where it changes.
    """

    axis: int
    rows: NDArray[np.int64]
    low: Vector
    high: Vector
    sign: Vector


def _joined(
    brackets: Sequence[_Brackets],
) -> tuple[NDArray[np.int64], NDArray[np.int64], Vector, Vector, Vector]:
    """Return the coordinates of all brackets and what else they hold, one after the other."""
    axes = np.repeat([b.axis for b in brackets], [len(b.rows) for b in brackets])
    rows, low, high, sign = (np.concatenate(part) for part in list(zip(*brackets, strict=True))[1:])
    return axes, rows, low, high, sign


def _grouped(values: list[float]) -> list[list[float]]:
    """Return values in groups that are the same, each with the accuracy of its zeros."""
    groups: list[list[float]] = []
    for value in sorted(values):
        if groups and value - groups[-1][0] <= _NEARLY * max(1.0, abs(value)):
            groups[-1].append(value)
        else:
            groups.append([value])
    return groups


def find_families(sampler: Sampler, design: Design) -> tuple[Family, ...]:
    """Find slices that are singular throughout; one that lies in another found is left out.

    Parameters
    ----------
    sampler : Sampler
        Its domain, where one is given, bounds the search; a mechanism's default domain does not.
    design : Design
        Its box must not be empty.
    """
    search = _Search(sampler, design)
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
