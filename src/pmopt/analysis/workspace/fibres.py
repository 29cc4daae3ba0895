"""Whether a position is reached: a search among the poses that have it.

With d pose coordinates the poses of one position form a fibre of d - 3 dimensions. A position is
reached if the slack (see :meth:`pmopt.analysis.sampling.evaluator.Evaluator.locate`) is >= 0
somewhere on its fibre. A search begins at a pose whose position is near; see
:mod:`pmopt.kernels.ascent`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Evaluator
from pmopt.compiler import programs
from pmopt.execution.threads import ordered_map
from pmopt.kernels import ascent
from pmopt.mechanisms.mechanism import Vector

Array = NDArray[np.float64]

_STEPS = 24
#: Positions of one batch: what a thread takes at once.
_BATCH = 2048


@dataclass(frozen=True)
class Ground:
    """What a search of one design needs.

    Attributes
    ----------
    spread : (d,) float64
        Of the poses that are known to be reachable, > 0: the units of steps.
    sides : (3,) float64
        Of their positions, > 0: the units of misses.
    """

    evaluator: Evaluator
    design: Design
    spread: Vector
    sides: Vector


def seek(
    ground: Ground, targets: Array, poses: Array, effort: int = 1
) -> tuple[NDArray[np.bool_], Array]:
    """Search the fibres of positions for reachable poses.

    Parameters
    ----------
    ground : Ground
    targets : (3, N) float64
    poses : (d, N) float64
        Where each search begins.
    effort : int
        Multiplies the most steps of a search.

    Returns
    -------
    reached : (N,) bool
    poses : (d, N) float64
        Where the searches end, NaN for those that have come to no end.
    """
    parts = [slice(k, k + _BATCH) for k in range(0, targets.shape[1], _BATCH)]
    found = list(
        ordered_map(
            lambda part: _seek(ground, targets[:, part], poses[:, part], effort),
            parts,
            ground.evaluator.threads,
        )
    )
    if not found:
        return np.zeros(0, dtype=bool), poses
    return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found], axis=1)


def _seek(
    ground: Ground, targets: Array, poses: Array, effort: int
) -> tuple[NDArray[np.bool_], Array]:
    """Search for some positions on one thread."""
    axes, size = poses.shape
    design, scale, sides = ground.design, ground.spread[:, None], ground.sides
    lower, upper = (
        np.ascontiguousarray(end / ground.spread)
        for end in (design.lower, design.lower + design.width)
    )
    goal = np.ascontiguousarray(targets / sides[:, None])
    poses = np.ascontiguousarray(poses / scale)
    state = np.zeros((ascent.STATE, size))
    state[ascent.STEP] = ascent.FIRST_STEP
    heights = np.empty((ascent.PLANES, size))
    slopes = np.empty((ascent.PLANES, axes, size))
    before = np.empty_like(poses)
    status = np.full(size, ascent.GOES_ON, dtype=np.int64)
    vectors = np.empty((4 + ascent.MOST_FREE, axes))
    planes = np.empty((ascent.PLANES, 1 + ascent.MOST_FREE))
    at = np.arange(size)
    for turn in range(_STEPS * effort):
        # Each pose and, for differences, the pose moved along each coordinate.
        moved = np.repeat(poses[:, None, at], axes + 1, axis=1)
        for k in range(axes):
            moved[k, 1 + k] += ascent.DIFFERENCE
        slack, places = ground.evaluator.locate(design, moved.reshape(axes, -1) * scale)
        places /= sides[:, None]
        programs.searching().advance(
            turn, at, slack.reshape(axes + 1, -1), places.reshape(3, axes + 1, -1), goal,
            lower, upper, poses, state, heights, slopes, before, status,
            vectors, planes,
        )  # fmt: skip
        at = np.flatnonzero(status == ascent.GOES_ON)
        if len(at) == 0:
            break
    ends = poses * scale
    ends[:, status == ascent.GOES_ON] = np.nan
    return status == ascent.REACHED, ends
