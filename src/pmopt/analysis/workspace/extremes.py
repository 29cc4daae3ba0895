"""The least and the largest LCI of a workspace: from its best samples on, by direct search.

A sample's extremes are bounds from one side. They are sharpened by a search around the best poses
of a further sample, within the box and all limits. What it finds is still a bound: the least LCI is
at most, the largest at least what is found, unless it is proven.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.aspects import determinants
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import Sampler
from pmopt.numerics import sequences
from pmopt.quantity import Quantity
from pmopt.seeds import seed_sequence

#: Poses among which the search begins, places where it does, and how far apart they are at least,
#: as a share of the box.
_POSES = 1 << 15
_PLACES, _AMONG, _APART = 24, 1024, 0.1
#: Poses tried around each place in a round, a coordinate, and most rounds.
_TRIALS, _ROUNDS = 12, 96
#: Half the cube they lie in at first; what it is multiplied by after a round that has found a
#: better pose and after one that has not; where it ends.
_FIRST, _WIDER, _NARROWER, _LAST = 0.1, 1.4, 0.6, 1e-10
#: An index is as exact as this.
_EXACT = 1e-12
#: Poses of small LCI among which the determinant's sign is compared, pairs that are followed up,
#: and how often they are halved.
_SIGNED, _PAIRS, _HALVINGS = 512, 16, 30
#: Least determinant, normalised, that has a sign, and largest one next to a zero.
_CLEAR, _NEXT = 1e-6, 1e-6


def find_extremes(
    sampler: Sampler, design: Design, smallest: float, largest: float
) -> tuple[Quantity, Quantity]:
    """Return the least and the largest LCI of a design, with a sign where it may be beyond.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    smallest, largest : float
        Of a sample, NaN where nothing of it is reachable.

    Notes
    -----
    Proven are: the largest possible index (1, in the Frobenius norm 1 over the number of rows); the
    smallest that counts (``min_lci``); and 0, where the determinant of the inverse Jacobian is
    small and of different signs at two poses 1e-9 of the box apart, both within every limit.
    """
    if not smallest <= largest:
        return Quantity(smallest, 0.0, sign="<="), Quantity(largest, 0.0, sign=">=")
    settings = sampler.space.settings
    dimension = len(design.width)
    points = sequences.make_sequence(
        "r-sequence", dimension, 1, seed_sequence(sampler.seed, "extremes of the index")
    )
    poses = sampler.evaluator.points(design, points, 0, _POSES)
    margin, lci = sampler.evaluator.field(design, poses)
    inside = np.flatnonzero((margin >= 0) & (lci >= settings.min_lci))
    if len(inside) > 0:
        poses, lci = poses[:, inside], lci[inside]
        found = _search(sampler, design, poses, lci)
        smallest, largest = min(smallest, found[0]), max(largest, found[1])
        # An aspect has no singularity inside, and a block's index may be anything at one.
        whole = settings.aspect is None and settings.block is None
        if whole and settings.min_lci == 0 and _crosses(sampler, design, poses, lci):
            smallest = 0.0
    least = smallest <= settings.min_lci + (_EXACT if settings.min_lci > 0 else 0.0)
    most = largest >= _ceiling(sampler) - _EXACT
    return (
        Quantity(smallest, 0.0, sign="" if least else "<="),
        Quantity(largest, 0.0, sign="" if most else ">="),
    )


def _ceiling(sampler: Sampler) -> float:
    """Return the index at isotropy."""
    settings = sampler.space.settings
    if settings.norm == "2":
        return 1.0
    if settings.block is None:
        return 1.0 / len(sampler.space.mechanism.joints)
    kind = "length" if settings.block == "translational" else "angle"
    return 1.0 / sum(c.kind == kind for c in sampler.space.mechanism.pose)


def _search(
    sampler: Sampler, design: Design, poses: NDArray[np.float64], lci: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the least and the largest LCI met by a direct search from the best poses.

    Around each place poses are tried in a cube that moves to the best one, and is narrowed where
    none is better. All places are evaluated together.
    """
    dimension = len(poses)
    lower, width = design.lower[:, None], design.width[:, None]
    inner = (poses - lower) / width
    starts = [_spread(inner, sign * lci) for sign in (1.0, -1.0)]
    sign = np.repeat([1.0, -1.0], [len(s) for s in starts])
    chosen = np.concatenate(starts)
    at, best = inner[:, chosen], sign * lci[chosen]
    size = np.full(len(chosen), _FIRST)
    step = np.zeros_like(at)
    trials = _TRIALS * dimension
    steps = sequences.golden_steps(dimension).astype(np.float64) / 2.0**64
    for number in range(_ROUNDS):
        index = np.arange(1 + number * trials, 1 + (number + 1) * trials)
        cube = 2 * ((index * steps[:, None]) % 1.0) - 1
        tried = np.empty((dimension, trials + 1, len(chosen)))
        tried[:, :-1] = at[:, None] + cube[:, :, None] * size
        tried[:, -1] = at + 2 * step  # on, where the last round has led
        tried = np.clip(tried, 0.0, 1.0)
        margin, found = sampler.evaluator.field(
            design, lower + width * tried.reshape(dimension, -1)
        )
        counts = (margin >= 0) & (found >= sampler.space.settings.min_lci)
        values = np.where(counts, found, np.inf).reshape(trials + 1, -1)
        values = np.where(np.isfinite(values), sign * values, np.inf)
        pick = values.argmin(axis=0)
        column = np.arange(len(chosen))
        better = values[pick, column] < best
        there = tried[:, pick, column]
        step = np.where(better, there - at, 0.0)
        at = np.where(better, there, at)
        best = np.where(better, values[pick, column], best)
        size = np.where(better, np.minimum(_WIDER * size, 0.25), _NARROWER * size)
        if size.max() < _LAST:
            break
    return float(best[sign > 0].min()), float(-best[sign < 0].min())


def _spread(inner: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return some of the smallest values that lie apart."""
    order = np.argsort(values, kind="stable")[:_AMONG]
    kept = [int(order[0])]
    for k in order[1:].tolist():
        if len(kept) == _PLACES:
            break
        if np.abs(inner[:, kept] - inner[:, k : k + 1]).max(axis=0).min() >= _APART:
            kept.append(k)
    return np.array(kept)


def _crosses(
    sampler: Sampler, design: Design, poses: NDArray[np.float64], lci: NDArray[np.float64]
) -> bool:
    """Return whether a singularity lies between two poses next to each other within the limits."""
    order = np.argsort(lci, kind="stable")[:_SIGNED]
    poses = poses[:, order]
    dets = determinants(sampler.evaluator, design, poses)
    above, below = (np.flatnonzero(s * dets > _CLEAR) for s in (1.0, -1.0))
    if len(above) == 0 or len(below) == 0:
        return False
    inner = (poses - design.lower[:, None]) / design.width[:, None]
    apart = np.zeros((len(above), len(below)))
    for row in inner:
        apart += (row[above][:, None] - row[below]) ** 2
    nearest = apart.argmin(axis=1)
    pairs = np.argsort(apart[np.arange(len(above)), nearest], kind="stable")[:_PAIRS]
    one, other = above[pairs], below[nearest[pairs]]
    low, high, sign = poses[:, one], poses[:, other], np.sign(dets[one])
    near = np.ones(len(one))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        near = determinants(sampler.evaluator, design, middle)
        same = near * sign > 0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    within = [sampler.evaluator.field(design, ends)[0] >= 0 for ends in (low, high)]
    return bool((within[0] & within[1] & (np.abs(near) < _NEXT)).any())
