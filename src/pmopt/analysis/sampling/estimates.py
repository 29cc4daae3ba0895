"""Numbers from tallies, each with its error.

Volume, GCI, region volumes and region shares are entries of one vector (:data:`_FIGURES`), so that
one jackknife over replicates gives all their errors. Quantiles of LCI and their errors come from
the histogram.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.tallies import Tallies
from pmopt.numerics.bins import bin_edges
from pmopt.quantity import Quantity
from pmopt.units import ONE

QUANTILES = (0.05, 0.5, 0.95)
#: By the number of replicates, what their standard error is multiplied by: two errors then hold
#: as often as with 16 (Student's t). From 16 on it is 1.
_FEW_REPLICATES = {
    4: 1.436, 5: 1.270, 6: 1.185, 7: 1.133, 8: 1.099, 9: 1.074, 10: 1.056, 11: 1.041, 12: 1.030,
    13: 1.020, 14: 1.012, 15: 1.006,
}  # fmt: skip
#: Standard errors of an independent sample that a grid's error bound contains.
_BOUND = 3.0


@dataclass(frozen=True)
class Estimates:
    """All sampled numbers of one workspace; ``smallest`` and ``largest`` are of the sample."""

    volume: Quantity
    gci: Quantity
    smallest: float
    largest: float
    quantiles: tuple[Quantity, ...]
    region_volumes: tuple[Quantity, ...]
    region_shares: tuple[Quantity, ...]
    samples: int
    reachable: int

    def in_unit(self, unit: str, bounded: bool = False) -> Estimates:
        """Return them with the unit of volumes, and whether their errors are bounds."""

        def of(several: tuple[Quantity, ...], unit: str) -> tuple[Quantity, ...]:
            return tuple(one.in_unit(unit, bounded) for one in several)

        return replace(
            self,
            volume=self.volume.in_unit(unit, bounded),
            gci=self.gci.in_unit(ONE, bounded),
            quantiles=of(self.quantiles, ONE),
            region_volumes=of(self.region_volumes, unit),
            region_shares=of(self.region_shares, ONE),
        )


class _Sums(NamedTuple):
    """Tallies of one design pooled over replicates, leading axis: which pool."""

    points: NDArray[np.float64]
    reachable: NDArray[np.float64]
    total: NDArray[np.float64]
    above: NDArray[np.float64]


#: Figures of which there is one a region.
_BY_REGION = ("region_volumes", "region_shares")


def _members(sums: _Sums) -> NDArray[np.float64]:
    """Return the poses of each pool in each region (P, r)."""
    count = sums.reachable[:, None]
    bounded = np.concatenate([count, sums.above, np.zeros_like(count)], axis=1)
    return np.asarray(bounded[:, :-1] - bounded[:, 1:])


class _Figure(NamedTuple):
    """A number, or one a region, that all errors of one vector are estimated for together.

    Attributes
    ----------
    of : callable
        ``of(box, sums)``: one for each pool (P,), or some (P, r).
    resolution : callable
        ``resolution(one point's volume, reachable points)``: the error is no less.
    """

    of: Callable[[float, _Sums], NDArray[np.float64]]
    resolution: Callable[[float, float], float]


#: By the names of :class:`Estimates`.
_FIGURES = {
    "volume": _Figure(lambda box, s: box * s.reachable / s.points, lambda point, count: point),
    "gci": _Figure(lambda box, s: s.total / s.reachable, lambda point, count: 0.0),
    "region_volumes": _Figure(
        lambda box, s: box * _members(s) / s.points[:, None], lambda point, count: point
    ),
    "region_shares": _Figure(
        lambda box, s: _members(s) / s.reachable[:, None], lambda point, count: 1 / count
    ),
}


def _vector(box: float, sums: _Sums) -> NDArray[np.float64]:
    """Return all figures of each pool, (P, n), one after the other; NaN for no index."""
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = [figure.of(box, sums) for figure in _FIGURES.values()]
    return np.concatenate([c[:, None] if c.ndim == 1 else c for c in columns], axis=1)


def _pool(tallies: Tallies) -> tuple[_Sums, _Sums]:
    """Return one design's sums over all replicates, and over all but each one."""
    replicates = tallies.reachable.shape[-1]
    sums = [values[0] for values in (tallies.reachable, tallies.total, tallies.above)]
    pooled = _Sums(
        np.array([float(tallies.points * replicates)]),
        *(values.sum(axis=0, keepdims=True) for values in sums),
    )
    if replicates == 1:
        return pooled, pooled
    left_out = _Sums(
        np.full(replicates, float(tallies.points * (replicates - 1))),
        *(values.sum(axis=0) - values for values in sums),
    )
    return pooled, left_out


def widening(replicates: int) -> float:
    """Return what standard errors over few replicates are multiplied by."""
    return _FEW_REPLICATES.get(replicates, 1.0)


class _Distribution:
    """The distribution of LCI over the reachable volume, linear within the histogram's bins.

    Bins end at the sample's extremes, so that nothing is beyond them and a constant index is exact.

    Parameters
    ----------
    histogram : (R, BINS) float64
    hits : float
        Points behind the counts, which are less on lines.
    smallest, largest : float
    """

    def __init__(
        self, histogram: NDArray[np.float64], hits: float, smallest: float, largest: float
    ) -> None:
        edges = np.clip(bin_edges(), smallest, largest)
        self._left, self._width = edges[:-1], np.diff(edges)
        self._parts = histogram
        self._counts = histogram.sum(axis=0)
        self._below = np.concatenate([[0.0], np.cumsum(self._counts)])
        self._total = float(self._below[-1])
        self._hits = hits

    def quantile(self, q: float) -> Quantity:
        """Return a quantile; its error is of the sample and of what is unknown within its bin."""
        value, k, part = self._find(q)
        # The share below the value is a mean: its error over replicates, brought to the axis of
        # LCI by the distribution itself (Woodruff 1952), needs no second look at the points.
        below = self._parts[:, :k].sum(axis=1) + part * self._parts[:, k]
        replicates = len(below)
        rest = below - q * self._parts.sum(axis=1)
        spread = math.sqrt(replicates / max(replicates - 1, 1) * float((rest**2).sum()))
        off = max(widening(replicates) * spread / self._total, 1 / self._hits)
        error = max(self._rise(value, q, off), self._rise(value, q, -off))
        return Quantity(value, error + self.resolution(k, part))

    def _find(self, q: float) -> tuple[float, int, float]:
        """Return a quantile, its bin and the share of the bin's points that is below it."""
        wanted = q * self._total
        k = int(np.searchsorted(self._below[1:], wanted, side="left"))
        k = min(k, len(self._counts) - 1)
        part = min((wanted - float(self._below[k])) / float(self._counts[k]), 1.0)
        return float(self._left[k] + part * self._width[k]), k, part

    def _rise(self, value: float, q: float, off: float) -> float:
        """Return how far the quantile of q + off is from that of q, beyond the extremes in line."""
        room = 1 - q if off > 0 else q
        scale = max(abs(off) / room, 1.0)
        end = self._find(min(max(q + off, 1e-12), 1.0))[0]
        return abs(end - value) * scale

    def resolution(self, k: int, part: float) -> float:
        """Return how far a value within a bin may be off, since points in it have no place.

        The density there may differ from the bin's mean by as much as those of its neighbours do,
        less what chance does. A bin that stands out far holds its points anywhere.
        """
        width = float(self._width[k])
        if not width > 0:
            return 0.0
        near = [n for n in (k - 1, k + 1) if 0 <= n < len(self._width) and self._width[n] > 0]
        points = self._hits / self._total
        own = points * float(self._counts[k])
        excess = 0.0
        for n in near:
            ratio = width / float(self._width[n])
            other = points * float(self._counts[n])
            chance = math.sqrt(own + ratio * ratio * other)
            excess = max(excess, abs(own - ratio * other) - chance)
        if excess > own / 2:
            return width * max(part, 1 - part)
        return width * min(part, 1 - part) * excess / own


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
    errors *= widening(replicates)
    return _assemble(values, errors, _quantiles(tallies), tallies)


def from_grid(grid: Tallies, sample: Tallies) -> Estimates:
    """Return the estimates of a grid; their errors are bounds.

    A grid has no error of its own that can be estimated: its coarser versions share its ways to
    err. What an independent sample finds differs from it by the grid's error and the sample's own,
    of which three standard errors are added.

    Parameters
    ----------
    grid : Tallies
        A single replicate.
    sample : Tallies
        Of independent points in the same box.
    """
    box = float(grid.box[0])
    found = from_replicates(sample)
    values = _vector(box, _pool(grid)[0])[0]
    others = [
        estimate
        for name in _FIGURES
        for estimate in (getattr(found, name) if name in _BY_REGION else [getattr(found, name)])
    ]
    errors = np.array([_bound(float(v), e) for v, e in zip(values, others, strict=True)])
    quantiles = []
    own = _distribution(grid)
    for q, other in zip(QUANTILES, found.quantiles, strict=True):
        if own is None:
            quantiles.append(Quantity(math.nan, math.nan))
            continue
        value, k, part = own._find(q)
        quantiles.append(Quantity(value, _bound(value, other) + own.resolution(k, part)))
    return _assemble(values, errors, tuple(quantiles), grid)


def _bound(value: float, other: Quantity) -> float:
    return abs(value - other.value) + _BOUND * other.error


def _distribution(tallies: Tallies) -> _Distribution | None:
    histogram, hits = tallies.histogram[0], float(tallies.hits[0].sum())
    if hits == 0 or histogram.size == 0:
        return None
    smallest, largest = tallies.smallest[0].min(), tallies.largest[0].max()
    return _Distribution(histogram, hits, float(smallest), float(largest))


def _quantiles(tallies: Tallies) -> tuple[Quantity, ...]:
    found = _distribution(tallies)
    if found is None:
        return (Quantity(math.nan, math.nan),) * len(QUANTILES)
    return tuple(found.quantile(q) for q in QUANTILES)


def _assemble(
    values: NDArray[np.float64],
    errors: NDArray[np.float64],
    quantiles: tuple[Quantity, ...],
    tallies: Tallies,
) -> Estimates:
    samples = tallies.points * tallies.reachable.shape[-1]
    reachable = int(tallies.hits[0].sum())
    one_point = float(tallies.box[0]) / samples
    regions = tallies.above.shape[-1] + 1
    pairs = zip(values.tolist(), errors.tolist(), strict=True)
    found: dict[str, Any] = {}
    for name, figure in _FIGURES.items():
        least = figure.resolution(one_point, reachable or math.nan)
        several = [
            Quantity(value, float(np.maximum(error, least)))
            for value, error in islice(pairs, regions if name in _BY_REGION else 1)
        ]
        found[name] = tuple(several) if name in _BY_REGION else several[0]
    return Estimates(
        **found,
        smallest=float(tallies.smallest[0].min()) if reachable else math.nan,
        largest=float(tallies.largest[0].max()) if reachable else math.nan,
        quantiles=quantiles,
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
    scale, wider = replicates / (replicates - 1), widening(replicates)
    with np.errstate(invalid="ignore", divide="ignore"):
        gci = tallies.total.sum(axis=1) / count
        residual = tallies.total - gci[:, None] * tallies.reachable
        gci_error = wider * np.sqrt(scale * (residual**2).sum(axis=1)) / count
    deviation = tallies.reachable - tallies.reachable.mean(axis=1, keepdims=True)
    sem = wider * np.sqrt(scale * (deviation**2).sum(axis=1)) / (replicates * points)
    return PopulationEstimates(
        volume=tallies.box * count / (replicates * points),
        volume_error=tallies.box * np.maximum(sem, 1 / (replicates * points)),
        gci=gci,
        gci_error=gci_error,
    )
