"""Numbers from tallies, each with its error estimate.

Every quantity of a workspace is one entry of a vector, so that one jackknife over replicates (or
one comparison of grids) gives all errors:

    volume, gci, lci min, lci max, quantiles .., region volumes .., region shares ..
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sweeper import BINS, Tallies

QUANTILES = (0.05, 0.5, 0.95)


class Estimate(NamedTuple):
    """A sampled number and its error estimate; both NaN where there is nothing to measure."""

    value: float
    error: float


@dataclass(frozen=True)
class Estimates:
    """All sampled numbers of one workspace."""

    volume: Estimate
    gci: Estimate
    smallest: Estimate
    largest: Estimate
    quantiles: tuple[Estimate, ...]
    region_volumes: tuple[Estimate, ...]
    region_shares: tuple[Estimate, ...]
    samples: int
    reachable: int


class _Sums(NamedTuple):
    """Tallies of one design pooled over replicates, leading axis: which pool."""

    points: NDArray[np.float64]
    reachable: NDArray[np.float64]
    hits: NDArray[np.float64]
    total: NDArray[np.float64]
    smallest: NDArray[np.float64]
    largest: NDArray[np.float64]
    above: NDArray[np.float64]
    histogram: NDArray[np.float64]


def _vector(box: float, sums: _Sums) -> NDArray[np.float64]:
    """Return the vector of quantities of each pool, NaN where nothing is reachable."""
    with np.errstate(invalid="ignore", divide="ignore"):
        count = sums.reachable
        volume = box * count / sums.points
        bounded = np.concatenate(
            [count[:, None], sums.above, np.zeros_like(count)[:, None]], axis=1
        )
        members = bounded[:, :-1] - bounded[:, 1:]
        empty = count == 0
        columns = [
            volume,
            sums.total / count,
            np.where(empty, np.nan, sums.smallest),
            np.where(empty, np.nan, sums.largest),
            *_quantiles(sums.histogram, sums.smallest, sums.largest),
            *(box * members / sums.points[:, None]).T,
            *(members / count[:, None]).T,
        ]
    return np.stack(columns, axis=1)


def _quantiles(
    histogram: NDArray[np.float64], smallest: NDArray[np.float64], largest: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Interpolate quantiles within histogram bins, never beyond the extremes."""
    cumulative = np.concatenate(
        [np.zeros((len(histogram), 1)), np.cumsum(histogram, axis=1)], axis=1
    )
    edges = np.linspace(0.0, 1.0, BINS + 1)
    result = []
    for q in QUANTILES:
        values = np.full(len(histogram), np.nan)
        for row, counts in enumerate(cumulative):
            if counts[-1] > 0:
                k = int(np.searchsorted(counts, q * counts[-1], side="left"))
                k = max(k, 1)
                part = (q * counts[-1] - counts[k - 1]) / (counts[k] - counts[k - 1])
                value = edges[k - 1] + part / BINS
                values[row] = min(max(value, smallest[row]), largest[row])
        result.append(values)
    return result


def _pool(tallies: Tallies) -> tuple[_Sums, _Sums]:
    """Return one design's sums over all replicates, and over all but each one."""
    replicates = tallies.reachable.shape[-1]
    keep = ~np.eye(replicates, dtype=bool)

    def without_each(values: NDArray[np.generic]) -> NDArray[np.float64]:
        whole = values.astype(float)
        return np.asarray(whole.sum(axis=0) - whole)

    reachable, total = tallies.reachable[0], tallies.total[0]
    smallest, largest = tallies.smallest[0], tallies.largest[0]
    all_points = np.array([float(tallies.points * replicates)])
    pooled = _Sums(
        all_points,
        reachable.sum(keepdims=True),
        tallies.hits[0].sum(keepdims=True),
        total.sum(keepdims=True),
        smallest.min(keepdims=True),
        largest.max(keepdims=True),
        tallies.above[0].sum(axis=0, keepdims=True),
        tallies.histogram[0].sum(axis=0, keepdims=True),
    )
    if replicates == 1:
        return pooled, pooled
    left_out = _Sums(
        np.full(replicates, float(tallies.points * (replicates - 1))),
        without_each(reachable),
        without_each(tallies.hits[0]),
        without_each(total),
        np.array([smallest[k].min() for k in keep]),
        np.array([largest[k].max() for k in keep]),
        without_each(tallies.above[0]),
        without_each(tallies.histogram[0]),
    )
    return pooled, left_out


def from_replicates(tallies: Tallies) -> Estimates:
    """Return the estimates of one design with jackknife standard errors over replicates.

    Where replicates agree to the last point (a box wholly inside or outside the workspace) the
    resolution of the sample, one point, stands for the error.
    """
    box = float(tallies.box[0])
    pooled, left_out = _pool(tallies)
    values = _vector(box, pooled)[0]
    parts = _vector(box, left_out)
    replicates = len(parts)
    spread = parts - parts.mean(axis=0)
    errors = np.sqrt((replicates - 1) / replicates * (spread**2).sum(axis=0))
    return _assemble(values, errors, box, pooled)


def from_grids(fine: Tallies, coarse: Sequence[tuple[float, Tallies]]) -> Estimates:
    """Return the estimates of the finest grid, with errors from coarser ones.

    Each coarser grid differs from the fine one by both errors. A grid's error falls at least
    with the first power of its spacing (with the second, on average, where no boundary follows an
    axis), so that with ratio s of the spacings the difference has a mean square of at least
    (s^2 + 1) times the fine grid's.

    Parameters
    ----------
    fine : Tallies
    coarse : sequence of (ratio of spacings, tallies)
    """
    box = float(fine.box[0])
    pooled = _pool(fine)[0]
    values = _vector(box, pooled)[0]
    squares = [
        (_vector(box, _pool(tallies)[0])[0] - values) ** 2 / (ratio**2 + 1)
        for ratio, tallies in coarse
    ]
    return _assemble(values, np.sqrt(np.mean(squares, axis=0)), box, pooled)


def _assemble(
    values: NDArray[np.float64], errors: NDArray[np.float64], box: float, sums: _Sums
) -> Estimates:
    samples, reachable = int(sums.points[0]), int(sums.hits[0])
    regions = sums.above.shape[1] + 1
    one_point = box / samples
    floors = np.zeros_like(values)
    floors[0] = one_point
    first = 4 + len(QUANTILES)
    floors[first : first + regions] = one_point
    floors[first + regions :] = 1 / reachable if reachable else math.nan
    pairs = [
        Estimate(float(v), float(e))
        for v, e in zip(values, np.maximum(errors, floors), strict=True)
    ]
    return Estimates(
        volume=pairs[0],
        gci=pairs[1],
        smallest=pairs[2],
        largest=pairs[3],
        quantiles=tuple(pairs[4:first]),
        region_volumes=tuple(pairs[first : first + regions]),
        region_shares=tuple(pairs[first + regions :]),
        samples=samples,
        reachable=reachable,
    )


@dataclass(frozen=True)
class PopulationEstimates:
    """Volume and GCI of many designs, shape (D,) each; GCI is NaN where nothing is reachable."""

    volume: NDArray[np.float64]
    volume_error: NDArray[np.float64]
    gci: NDArray[np.float64]
    gci_error: NDArray[np.float64]


def of_population(tallies: Tallies) -> PopulationEstimates:
    """Return volume and GCI with standard errors over replicates, all designs at once.

    The error of the ratio GCI is the linearised one, equal to the jackknife's in first order.
    """
    replicates = tallies.reachable.shape[1]
    points = tallies.points
    count = tallies.reachable.sum(axis=1)
    scale = replicates / (replicates - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        gci = tallies.total.sum(axis=1) / count
        residual = tallies.total - gci[:, None] * tallies.reachable
        gci_error = np.sqrt(scale * (residual**2).sum(axis=1)) / count
    deviation = tallies.reachable - tallies.reachable.mean(axis=1, keepdims=True)
    sem = np.sqrt(scale * (deviation**2).sum(axis=1)) / (replicates * points)
    return PopulationEstimates(
        volume=tallies.box * count / (replicates * points),
        volume_error=tallies.box * np.maximum(sem, 1 / (replicates * points)),
        gci=gci,
        gci_error=gci_error,
    )
