"""The volume of the positions reached, by a sample of positions.

Of each sampled position a search decides whether it is reached
(:mod:`pmopt.analysis.workspace.fibres`). It begins at a pose that is
known to be reachable and whose position is near: of the poses that a sample of the workspace has
found, and of the positions found before, so that the search goes on from neighbour to neighbour
where the poses are thin. What a search can miss is estimated: some of the positions not found are
searched for again, from other poses and for longer.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import Sampler
from pmopt.analysis.workspace.fibres import Ground, seek
from pmopt.kernels import ascent
from pmopt.numerics.elementary import power
from pmopt.numerics.sequences import make_sequence
from pmopt.quantity import Quantity
from pmopt.seeds import seed_sequence

Array = NDArray[np.float64]

#: Positions whose box is thinner, over its longest side, have no volume.
_FLAT = 1e-9
#: Samples of poses for each position, and the fewest and most positions near those reached.
_POSES_A_POSITION = 32
_FEWEST = 1 << 10
_REPLICATES = 16
#: Positions in the box of those reached, for each that is near one.
_MOST_FOR_ONE = 4.0
#: Distances between positions by which the box is wider than the poses' positions.
_WIDER = 1.5
#: Edge of the cells in which known positions are looked for, in the same distances.
_CELL = 1.5
_MOST_WIDENINGS = 6
#: The share of what is reached that may lie at the box's faces.
_NEGLIGIBLE = 1e-3
#: The share of the positions, one in so many, that show how wide it is.
_OUTLINED = 16
#: Of the positions not found, every so many is searched for again, from how many and how long.
_AUDITED = 8
_AUDIT_TRIES = 4
_AUDIT_EFFORT = 2
_MOST_ROUNDS = 16
#: Poses that differ by more than this share of their spread in a coordinate are apart.
_APART = 0.2


@dataclass(frozen=True)
class Reached:
    """Positions that are reached.

    Attributes
    ----------
    volume : Quantity
    places : (3, K) float64
        Sampled positions that are reached.
    lower : bool
        Whether the volume is a lower bound, as not all poses of a position are searched.
    """

    volume: Quantity
    places: Array
    lower: bool


class _Map:
    """Known poses by the cells of their positions, and which are nearest to a position.

    Positions are in units of the box: in [0, 1]^3. Of the poses in a cell one is kept for each way
    in which a pose's coordinates lie below or above the middle ones: what is reached in one way
    does not hide what is reached in another.
    """

    def __init__(self, cells: int, middle: Array, spread: Array) -> None:
        self._cells = cells
        self._wide = cells + 2
        self._middle, self._spread = middle[:, None], spread[:, None]
        ends = itertools.product((0, 1), repeat=3)
        self._shifts = [(a * self._wide + b) * self._wide + c for a, b, c in ends]

    def _cell(self, places: Array) -> NDArray[np.int64]:
        index = np.clip(np.floor(places * self._cells).astype(np.int64) + 1, 0, self._cells)
        return np.asarray((index[0] * self._wide + index[1]) * self._wide + index[2])

    def fill(self, places: Array, poses: Array) -> None:
        """Enter positions (3, K) and poses (d, K); of those alike the last one is kept."""
        self._places, self._poses = places, poses / self._spread
        cell = self._cell(places)
        bits = 1 << np.arange(len(poses))
        kind = (bits[:, None] * (poses > self._middle)).sum(axis=0)
        self._layers = []
        for each in np.unique(kind).tolist():
            layer = np.full(self._wide**3, -1, dtype=np.int64)
            some = np.flatnonzero(kind == each)
            layer[cell[some]] = some
            self._layers.append(layer)

    def nearest(
        self, places: Array, count: int = 1, apart: Array | None = None
    ) -> NDArray[np.int64]:
        """Return the nearest ``count`` known to each position (count, N); -1 where none is near.

        Of the eight cells about a cell's corner that is nearest to a position; with ``apart``
        (d, N) of those whose pose differs from it.
        """
        size = places.shape[1]
        found = np.full((count, size), -1, dtype=np.int64)
        distance = np.full((count, size), np.inf)
        corner = self._cell(places - 0.5 / self._cells)
        if apart is not None:
            apart = apart / self._spread
        for shift, layer in itertools.product(self._shifts, self._layers):
            known = layer[corner + shift]
            some = np.flatnonzero(known >= 0)
            known = known[some]
            if apart is not None:
                alike = np.abs(self._poses[:, known] - apart[:, some]).max(axis=0) <= _APART
                some, known = some[~alike], known[~alike]
            far = ((self._places[:, known] - places[:, some]) ** 2).sum(axis=0)
            for k in range(count):
                kept, length = found[k, some], distance[k, some]
                nearer = far < length
                found[k, some] = np.where(nearer, known, kept)
                distance[k, some] = np.where(nearer, far, length)
                known, far = np.where(nearer, kept, known), np.where(nearer, length, far)
        return found


def measure_positions(
    sampler: Sampler,
    design: Design,
    poses: Array,
    places: Array,
    samples: int,
) -> Reached:
    """Measure the volume of the positions reached.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    poses, places : (d, K), (3, K) float64
        Reachable poses and their positions.
    samples : int
        Of poses that the reachable ones are of: the number of positions follows.
    """
    first, last = places.min(axis=1), places.max(axis=1)
    sides = last - first
    if len(poses) < 3 or not sides.min() > _FLAT * sides.max():
        return Reached(Quantity(0.0, 0.0), places[:, :0], False)
    spread = np.ptp(poses, axis=1)
    ground = Ground(sampler.evaluator, design, np.where(spread > 0, spread, design.width), sides)
    near = max(samples // (_POSES_A_POSITION * sampler.evaluator.slowness), _FEWEST)
    filled = _filled((places - first[:, None]) / sides[:, None])
    each = int(near * min(1 / filled, _MOST_FOR_ONE)) // _REPLICATES
    points = make_sequence("r-sequence", 3, _REPLICATES, seed_sequence(
        sampler.seed, f"{sampler.purpose}, places"))  # fmt: skip
    numbers = np.arange(each, dtype=np.uint64)
    shares = (
        np.concatenate(
            [
                (start[:, None] + points.step[:, None] * numbers).astype(np.float64)
                for start in points.start
            ],
            axis=1,
        )
        * 2.0**-64
    )
    # Few positions show about how far the box must reach, then all of them are searched.
    few = max(each // _OUTLINED, min(each, _FEWEST // _REPLICATES))
    for turn in range(_MOST_WIDENINGS):
        whole = turn == _MOST_WIDENINGS - 1 or few == each
        count = each if whole else few
        some = shares.reshape(3, _REPLICATES, each)[:, :, :count].reshape(3, -1)
        edge = _WIDER * power(some.shape[1], -1 / 3)
        lower, width = first - edge * (last - first), (1 + 2 * edge) * (last - first)
        found, missed, doubt = _search(ground, lower, width, some, poses, places)
        met = lower[:, None] + width[:, None] * some[:, found]
        # Where something is reached at the box's faces there may be as much beyond.
        some = some[:, found]
        inner = edge / (1 + 2 * edge) / 3
        beyond = float(((some < inner) | (some > 1 - inner)).any(axis=0).sum()) / found.size
        first = np.minimum(first, met.min(axis=1, initial=math.inf))
        last = np.maximum(last, met.max(axis=1, initial=-math.inf))
        held = beyond <= _NEGLIGIBLE * found.mean()
        if held and whole:
            break
        few = each if held else few
    box = float(np.prod(width))
    by_replicate = found.reshape(_REPLICATES, -1).mean(axis=1)
    error = float(by_replicate.std(ddof=1)) / math.sqrt(_REPLICATES)
    if not found.any():
        error = 3 / found.size
    value = float(by_replicate.mean()) + missed
    return Reached(
        Quantity(box * value, box * math.hypot(error, missed, doubt, beyond)),
        met,
        len(poses) > 3 + ascent.MOST_FREE,
    )


def _filled(shares: Array) -> float:
    """Return about which share of their box positions fill."""
    cells = int(np.clip((shares.shape[1] / 8) ** (1 / 3), 1, 32))
    index = np.minimum((shares * cells).astype(np.int64), cells - 1)
    full = np.zeros((cells,) * 3, dtype=bool)
    full[tuple(index)] = True
    return float(full.mean())


def _search(
    ground: Ground, lower: Array, width: Array, shares: Array, poses: Array, places: Array
) -> tuple[NDArray[np.bool_], float, float]:
    """Return which positions of a box are reached, the share that was missed and its error."""
    size = shares.shape[1]
    targets = lower[:, None] + width[:, None] * shares
    cells = max(1, int(size ** (1 / 3) / _CELL))
    known = _Map(cells, np.median(poses, axis=1), ground.spread)
    known.fill((places - lower[:, None]) / width[:, None], poses)
    reached = np.zeros(size, dtype=bool)
    ends = np.zeros((poses.shape[0], size))

    def attempt(which: NDArray[np.int64], starts: Array, effort: int = 1) -> NDArray[np.int64]:
        done, found = seek(ground, targets[:, which], starts, effort)
        reached[which[done]] = True
        ends[:, which] = found
        return which[done]

    # From the nearest pose of the sample, and once more from one that differs from where that led.
    begin = known.nearest(shares)[0]
    tried = begin >= 0
    first = np.flatnonzero(tried)
    fresh = attempt(first, poses[:, begin[first]])
    left = np.flatnonzero(tried & ~reached)
    begin = known.nearest(shares[:, left], apart=ends[:, left])[0]
    left, begin = left[begin >= 0], begin[begin >= 0]
    fresh = np.concatenate([fresh, attempt(left, poses[:, begin])])
    # From what is found on to positions that none was near to, and once more to others.
    again = tried & ~reached
    for _ in range(_MOST_ROUNDS):
        if len(fresh) == 0:
            break
        known.fill(shares[:, fresh], ends[:, fresh])
        blank, left = np.flatnonzero(~tried), np.flatnonzero(again & ~reached)
        begin = np.concatenate([
            known.nearest(shares[:, blank])[0],
            known.nearest(shares[:, left], apart=ends[:, left])[0],
        ])  # fmt: skip
        left = np.concatenate([blank, left])[begin >= 0]
        tried[left] = True
        again[left] = False
        fresh = attempt(left, ends[:, fresh[begin[begin >= 0]]])
    # Some of those not found again.
    left = np.flatnonzero(tried & ~reached)
    audited = left[::_AUDITED]
    have = np.flatnonzero(reached)
    if len(audited) == 0 or len(have) == 0:
        return reached, 0.0, 0.0
    known.fill(shares[:, have], ends[:, have])
    starts = known.nearest(shares[:, audited], _AUDIT_TRIES)
    starts = np.where(starts >= 0, have[starts], -1)
    kept, found = reached.copy(), ends.copy()
    for row in starts:
        still = ~reached[audited] & (row >= 0)
        attempt(audited[still], found[:, row[still]], _AUDIT_EFFORT)
    share = float(reached[audited].mean())
    part = len(left) / size
    likely = (share * len(audited) + 0.5) / (len(audited) + 1)
    return kept, share * part, part * math.sqrt(likely * (1 - likely) / len(audited))
