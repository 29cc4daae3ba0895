"""Whether a position is reached: a search among the poses that have it.

With d pose coordinates the poses of one position form a fibre of d - 3 dimensions. A position is
reached if the slack (see :meth:`pmopt.analysis.sweeper.Sweeper.locate`) is >= 0 somewhere on its
fibre. The search begins at a pose whose position is near. Newton's method leads to the fibre, while
the slack is raised along it: it is a least one of many, so that its ridges are what counts. Its
slopes at the last poses of the search give planes, and the next pose is where the least of them is
largest, within a step that is trusted (Kelley 1960, with a trust region).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sweeper import Design, Sweeper
from pmopt.mechanisms.base import Vector
from pmopt.threads import ordered_map

Array = NDArray[np.float64]

#: Dimensions of a fibre that are searched.
MOST_FREE = 2
#: Differences and steps are shares of the reachable poses' spread, misses of the positions'.
_DIFFERENCE = 1e-6
_CLOSE = 1e-6
_FIRST_STEP = 0.25
_LEAST_STEP = 1e-4
_LONGEST = 0.5
_STEPS = 14
_PLANES = 5
#: Positions of one batch: what a thread takes at once.
_BATCH = 4096


@dataclass(frozen=True)
class Ground:
    """What a search of one design needs.

    Attributes
    ----------
    spread : (d,) float64
        Of the poses that are known to be reachable, > 0.
    sides : (3,) float64
        Of their positions, > 0.
    """

    sweeper: Sweeper
    design: Design
    spread: Vector
    sides: Vector


def seek(ground: Ground, targets: Array, poses: Array, effort: int = 1) -> tuple[Array, Array]:
    """Search the fibres of positions for reachable poses.

    Parameters
    ----------
    ground : Ground
    targets : (3, N) float64
    poses : (d, N) float64
        Where each search begins.
    effort : int
        Multiplies the steps of a search.

    Returns
    -------
    reached : (N,) bool
    poses : (d, N) float64
        Where the searches end.
    """
    size = targets.shape[1]
    parts = [slice(k, k + _BATCH) for k in range(0, size, _BATCH)]
    found = list(
        ordered_map(
            lambda part: _seek(ground, targets[:, part], poses[:, part], effort),
            parts,
            ground.sweeper.threads,
        )
    )
    if not found:
        return np.zeros(0, dtype=bool), poses
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found], axis=1)


def _slack(ground: Ground, poses: Array) -> tuple[Vector, Array]:
    """Return slack, that of the box included, and position over sides of poses (d, N)."""
    slack, places = ground.sweeper.locate(ground.design, poses)
    lower = ground.design.lower[:, None]
    inside = np.minimum(poses - lower, lower + ground.design.width[:, None] - poses)
    inside /= ground.spread[:, None]
    return np.minimum(slack, inside.min(axis=0)), places / ground.sides[:, None]


def _seek(ground: Ground, targets: Array, poses: Array, effort: int) -> tuple[Array, Array]:
    axes, size = poses.shape
    free = axes - 3
    scale = ground.spread[:, None]
    reached = np.zeros(size, dtype=bool)
    best = poses.copy()
    # Of the searches that go on: their numbers, targets, poses in spreads, planes and steps.
    at = np.arange(size)
    goal = targets / ground.sides[:, None]
    u = poses / scale
    step = np.full(size, _FIRST_STEP)
    heights = np.empty((0, size))
    slopes = np.empty((0, axes, size))
    for turn in range(_STEPS * effort):
        n = len(at)
        # The pose and, for differences, one moved along each coordinate.
        moved = np.repeat(u[:, None, :], axes + 1, axis=1)
        for k in range(axes):
            moved[k, 1 + k] += _DIFFERENCE
        slack, places = _slack(ground, moved.reshape(axes, -1) * scale)
        slack, places = slack.reshape(axes + 1, n), places.reshape(3, axes + 1, n)
        miss = goal - places[:, 0]
        close = np.abs(miss).max(axis=0) <= _CLOSE
        done = close & (slack[0] >= 0.0)
        reached[at[done]] = True
        best[:, at] = u * scale
        jacobian = (places[:, 1:] - places[:, :1]) / _DIFFERENCE
        rows, root = _orthonormal(jacobian, miss)
        if free == 0:
            length = np.sqrt((root * root).sum(axis=0))
            going = ~done & ~close & np.isfinite(length)
            ahead = root
        else:
            slope = (slack[1:] - slack[0]) / _DIFFERENCE
            # A plane: height at the origin and slope.
            height = slack[0] - (slope * u).sum(axis=0)
            heights = np.concatenate([heights[-(_PLANES - 1) :], height[None]])
            slopes = np.concatenate([slopes[-(_PLANES - 1) :], slope[None]])
            basis = _complement(rows, free)
            near = u + root
            values = heights + (slopes * near).sum(axis=1)
            along = np.einsum("pan,fan->pfn", slopes, basis)
            s, top = _highest(values, along, step)
            # No further along the fibre than is needed: its bends would lead off it.
            here = values.min(axis=0)
            share = (0.3 * top - here) / np.maximum(top - here, 1e-300)
            share = np.where(here >= 0.0, 0.0, np.where(top > 0.0, np.minimum(share, 1.0), 1.0))
            s = s * share
            ahead = root + np.einsum("fn,fan->an", s, basis)
            length = np.sqrt((ahead * ahead).sum(axis=0))
            ended = close & ((top < 0.0) & (np.abs(s).max(axis=0) < _LEAST_STEP))
            going = ~done & ~ended & np.isfinite(length)
            # Where the planes promise more than there is, shorter steps are taken.
            if turn > 2:
                step = np.where(np.abs(s).max(axis=0) >= 0.99 * step, step, 0.5 * step)
        if not going.any():
            break
        ahead *= np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))
        u = (u + ahead)[:, going]
        at, goal, step = at[going], goal[:, going], step[going]
        heights, slopes = heights[:, going], slopes[:, :, going]
    return reached, best


def _orthonormal(jacobian: Array, miss: Array) -> tuple[Array, Array]:
    """Return orthonormal rows that span those of Jacobians, and the least step of a miss.

    Parameters
    ----------
    jacobian : (3, d, N) float64
    miss : (3, N) float64

    Returns
    -------
    rows : (3, d, N) float64
    root : (d, N) float64
        The shortest step by which the linearised position changes by the miss.
    """
    rows = np.empty_like(jacobian)
    weights = np.empty_like(miss)
    for k in range(3):
        row, rest = jacobian[k].copy(), miss[k].copy()
        for j in range(k):
            share = (jacobian[k] * rows[j]).sum(axis=0)
            row -= share * rows[j]
            rest -= share * weights[j]
        length = np.sqrt((row * row).sum(axis=0))
        length = np.maximum(length, 1e-9)
        rows[k] = row / length
        weights[k] = rest / length
    return rows, (weights[:, None] * rows).sum(axis=0)


def _complement(rows: Array, free: int) -> Array:
    """Return orthonormal vectors (free, d, N) across orthonormal rows (3, d, N)."""
    have = list(rows)
    axes, size = rows.shape[1:]
    found = []
    for _ in range(free):
        # What is left of each coordinate's direction; the longest is taken.
        left = 1.0 - sum(v * v for v in have)
        first = np.argmax(left, axis=0)
        vector = np.zeros((axes, size))
        vector[first, np.arange(size)] = 1.0
        for v in have:
            vector -= (vector * v).sum(axis=0) * v
        vector /= np.maximum(np.sqrt((vector * vector).sum(axis=0)), 1e-300)
        have.append(vector)
        found.append(vector)
    return np.stack(found)


def _highest(values: Array, slopes: Array, step: Vector) -> tuple[Array, Vector]:
    """Return where in |s| <= step the least of planes is largest, and how high it is there.

    Parameters
    ----------
    values : (p, N) float64
        Of the planes at s = 0.
    slopes : (p, f, N) float64
    step : (N,) float64
    """
    count, free = slopes.shape[:2]
    size = len(step)
    best_s, best = np.zeros((free, size)), values.min(axis=0)

    def offer(s: Array) -> None:
        nonlocal best_s, best
        s = np.clip(np.nan_to_num(s), -step, step)
        low = values[0] + sum(slopes[0, f] * s[f] for f in range(free))
        for p in range(1, count):
            low = np.minimum(low, values[p] + sum(slopes[p, f] * s[f] for f in range(free)))
        better = low > best
        best = np.where(better, low, best)
        best_s = np.where(better, s, best_s)

    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for ends in itertools.product((-1.0, 1.0), repeat=free):
            offer(np.stack([e * step for e in ends]))
        for a, b in itertools.combinations(range(count), 2):
            gap, tilt = values[b] - values[a], slopes[a] - slopes[b]
            if free == 1:
                offer((gap / tilt[0])[None])
                continue
            for f, end in itertools.product((0, 1), (-1.0, 1.0)):
                s = np.empty((2, size))
                s[f] = end * step
                s[1 - f] = (gap - tilt[f] * s[f]) / tilt[1 - f]
                offer(s)
            for c in range(b + 1, count):
                gap2, tilt2 = values[c] - values[a], slopes[a] - slopes[c]
                det = tilt[0] * tilt2[1] - tilt[1] * tilt2[0]
                offer(np.stack([(gap * tilt2[1] - gap2 * tilt[1]) / det,
                                (tilt[0] * gap2 - tilt2[0] * gap) / det]))  # fmt: skip
    return best_s, best
