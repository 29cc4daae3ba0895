"""Where a motion meets a forward singularity, or comes near one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.dynamics import Mover, State
from pmopt.analysis.motion.records import (
    Approach,
    Motion,
    Span,
    Values,
    stretches,
)
from pmopt.analysis.singularities.touching import Jets, Least, between, least_sizes
from pmopt.mechanisms.mechanism import (
    Vector,
)

#: LCI of the homogenized Jacobian below which a pose counts as singular.
SINGULAR = 1e-9
#: A least LCI below this share of the motion's median is an approach to report.
_APPROACH = 0.2
#: Efforts that grow by so much between the instants are reported.
_GROWS = 1.01


def met_singularities(
    state: State, feasible: NDArray[np.bool_], index: Vector, t: Vector
) -> list[Span]:
    """Return where the motion meets a forward singularity, at an instant or between two."""
    near = feasible & (index < SINGULAR)
    words = "a singularity: the actuated joints do not hold the platform, efforts have no bound"
    spans = [
        Span(a, b, a, "singularity", float(index[a]), "1", f"LCI = {index[a]:.3g}: {words}")
        for a, b in stretches(near)
    ]
    determined = np.flatnonzero(feasible & ~near)
    with np.errstate(invalid="ignore"):
        sign = np.sign(np.linalg.det(np.where(
            state.valid[:, None, None], state.inverse_jacobian, 0.0
        )))  # fmt: skip
    for a, b in pairwise(determined.tolist()):
        # What lies between two determined instants is singular or out of reach.
        if sign[a] != sign[b] and (b == a + 1 or near[a + 1 : b].all()):
            if b > a + 1:
                continue  # reported above
            text = f"between t = {t[a]:.9g} s and t = {t[b]:.9g} s {words}"
            worst = a if index[a] < index[b] else b
            spans.append(Span(a, b, worst, "singularity", float(index[worst]), "1", text))
    return spans


def touched_singularities(
    t: Vector,
    jets: Jets,
    determined: NDArray[np.bool_],
    index: Callable[[Values], Vector],
    spans: Sequence[Span],
) -> tuple[list[Span], Least]:
    """Return where the motion touches a singularity between instants, and where it comes near.

    Parameters
    ----------
    t : (N,) float64
    jets : Jets
        Of the pose.
    determined : (N,) bool
        Where the motion is known.
    index : callable
        Returns the LCI at poses (M, n).
    spans : sequence of Span
        Singular ones that are known already.
    """
    least = least_sizes(t, jets, determined, index)
    covered = np.zeros(len(t), dtype=bool)
    for span in spans:
        covered[span.first : span.last + 1] = True
    found = []
    near = np.ones(len(least.size), dtype=bool)
    for k, (first, share, size) in enumerate(zip(*map(np.ndarray.tolist, least), strict=True)):
        if size >= SINGULAR:
            continue
        near[k] = False
        if covered[first] and covered[first + 1]:
            continue
        covered[first : first + 2] = True
        time = t[first] + share * (t[first + 1] - t[first])
        text = (
            f"at t = {time:.9g} s a singularity is touched (LCI = {size:.3g}): the actuated joints "
            "do not hold the platform, efforts have no bound"
        )
        found.append(Span(first, first + 1, first + round(share), "singularity", size, "1", text))
    return found, Least(least.first[near], least.share[near], least.size[near])


def approaches(
    mover: Mover, motion: Motion, jets: Jets, near: Least, index: Vector
) -> tuple[Approach, ...]:
    """Return where efforts between instants exceed those at them, near a singularity."""
    assert motion.effort is not None
    low = near.size < _APPROACH * float(np.median(index))
    if not low.any():
        return ()
    first, share, size = near.first[low], near.share[low], near.size[low]
    found = mover.state(*between(motion.t, jets, first, share)).efforts
    peaks = np.abs(motion.effort).max(axis=0)
    times = motion.t[first] + share * (motion.t[first + 1] - motion.t[first])
    names = [c.name for c in motion.joints.coordinates]
    result = []
    for k in np.argsort(times, kind="stable").tolist():
        beside = np.abs(motion.effort[first[k] : first[k] + 2]).max(axis=0) >= peaks
        grown = {
            name: float(found[k, j])
            for j, name in enumerate(names)
            if abs(found[k, j]) > _GROWS * peaks[j] or (beside[j] and peaks[j] > 0)
        }
        if grown:
            result.append(Approach(float(times[k]), float(size[k]), grown))
    return tuple(result)
