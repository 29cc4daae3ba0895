"""Proven bounds of the least and the largest LCI of a workspace, from both sides.

Boxes of poses are bisected as for a volume (:mod:`pmopt.analysis.certification.bisection`): all
reachable poses bound the index from outside, single poses that are proven reachable from inside.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.certification.bisection import bisected
from pmopt.analysis.certification.budgets import Budget
from pmopt.analysis.certification.enclosures import Enclosure
from pmopt.analysis.certification.proven_matrices import index_bounds

#: Relative gap at which the search ends, boxes evaluated at once, least and most in all.
_GAP = 1e-3
_BATCH, _FEWEST, _MOST = 1 << 12, 1 << 14, 1 << 17


class IndexBounds(NamedTuple):
    """Proven bounds: ``min_lower <= least <= min_upper``, ``max_lower <= largest <= max_upper``.

    The inner ones are NaN where no pose is proven reachable, all where none can be.
    """

    min_lower: float
    min_upper: float
    max_lower: float
    max_upper: float

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {k: None if np.isnan(v) else v for k, v in self._asdict().items()}


def bound_index(enclosure: Enclosure, norm: str, boxes: int, budget: Budget) -> IndexBounds:
    """Return proven bounds of the extremes of LCI.

    Parameters
    ----------
    enclosure : Enclosure
    norm : {"2", "fro"}
    boxes : int
        To be examined at most, within reason.
    budget : Budget
        Of its seconds; at least one round is done.
    """
    found, most = _Extremes(enclosure, norm), min(max(boxes, _FEWEST), _MOST)
    centres, halves = enclosure.whole()
    low = high = np.empty(0)
    while len(centres):
        parts = [
            found.examine(centres[k : k + _BATCH], halves[k : k + _BATCH])
            for k in range(0, len(centres), _BATCH)
        ]
        centres, halves, low, high = (np.concatenate(p) for p in zip(*parts, strict=True))
        if budget.late:
            break
        taken = found.wanted(low, high)
        # Twice as many boxes come of those that may hold an extreme; the others are done with.
        found.close(low[~taken], high[~taken])
        centres, halves = centres[taken], halves[taken]
        low, high = low[taken], high[taken]
        if found.examined + 2 * len(centres) > most:
            break
        centres, halves = bisected(centres, halves)
    found.close(low, high)
    return found.bounds()


class _Extremes:
    """What has been proven so far."""

    def __init__(self, enclosure: Enclosure, norm: str) -> None:
        self._enclosure, self._norm = enclosure, norm
        self.examined = 0
        self._inner = [np.inf, -np.inf]  # least and largest index of poses proven reachable
        self._outer = [np.inf, -np.inf]  # of all boxes that are done with

    def examine(
        self, centres: NDArray[np.float64], halves: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the boxes that may be reachable, with bounds of the index in each."""
        self.examined += len(centres)
        kept = self._enclosure.shares(centres, halves)[1] > 0
        centres, halves = centres[kept], halves[kept]
        if len(centres) == 0:
            return centres, halves, np.empty(0), np.empty(0)
        low, high = self._index(centres, halves)
        points = np.zeros_like(centres)
        within = self._enclosure.shares(centres, points)[0] == 1
        if within.any():
            least, most = self._index(centres[within], points[within])
            self._inner[0] = min(self._inner[0], float(most.min()))
            self._inner[1] = max(self._inner[1], float(least.max()))
        return centres, halves, low, high

    def _index(
        self, centres: NDArray[np.float64], halves: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        with np.errstate(all="ignore"):
            low, high = index_bounds(*self._enclosure.jacobians(centres, halves), self._norm)
        return np.nan_to_num(low, nan=0.0), np.nan_to_num(high, nan=1.0)

    def wanted(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which boxes leave an extreme open by more than the gap asked for."""
        least, most = self._inner
        if least > most:  # no pose is proven reachable yet
            return np.ones(len(low), dtype=bool)
        # A least index of about 0 is not sought more closely: no index is below 0.
        below = low < least - _GAP * max(least, most)
        return np.asarray(below | (high > most + _GAP * most))

    def close(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
        """Take the bounds of boxes that are no longer examined."""
        if len(low):
            self._outer[0] = min(self._outer[0], float(low.min()))
            self._outer[1] = max(self._outer[1], float(high.max()))

    def bounds(self) -> IndexBounds:
        """Return the bounds."""
        inner = [v if np.isfinite(v) else np.nan for v in self._inner]
        outer = [v if np.isfinite(v) else np.nan for v in self._outer]
        return IndexBounds(outer[0], inner[0], inner[1], outer[1])
