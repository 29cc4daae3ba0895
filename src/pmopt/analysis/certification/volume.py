"""Guaranteed bounds of a workspace's volume.

Boxes of poses are bisected (:mod:`pmopt.analysis.certification.bisection`) until what is open of
the volume is small enough.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.certification.bisection import (
    BATCH,
    INSTEAD,
    MAX_OPEN,
    Progress,
    above,
    announced,
    below,
    bisected,
    halved,
    prepared,
    relative,
)
from pmopt.analysis.certification.budgets import Budget
from pmopt.analysis.certification.certified_index import IndexBounds
from pmopt.analysis.certification.enclosing import enclose
from pmopt.analysis.certification.enclosures import Enclosure
from pmopt.analysis.kinematics.index_units import entry_units, index_note
from pmopt.analysis.reads import Reads
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.settings import VolumeSettings, WorkspaceSettings
from pmopt.errors import InputError
from pmopt.kernels.affine_forms import EPS
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.numerics.elementary import exp_of
from pmopt.quantity import Quantity
from pmopt.units import ONE

Array = NDArray[np.float64]
Stop = Literal["gap", "time budget", "box budget", "boxes"]
#: Share of the gap that is bisected in one round.
_ROUND = 0.5
#: Boxes that are bisected in all ways in each round, and how fast weights follow, in octaves.
_TRIALS, _LEARNT = 512, 1.0
#: Numbers that are summed without a correction.
_GROUP = 256
#: Share of the gap that may be outside all boxes before it is looked at.
_COVER = 0.2
#: While it falls so fast boxes wait.
_FALLING = 0.9
READS = Reads("certify", VolumeSettings, instead=INSTEAD)


@dataclass(frozen=True)
class CertifiedVolume(OfSubject):
    """Guaranteed bounds of a workspace's volume; every number in the unit that ``units`` gives.

    Attributes
    ----------
    lower, upper : Quantity
        Of the volume, proven.
    gap : float
        (upper - lower) / upper, 0 for an empty workspace.
    target : float
        The gap asked for.
    boxes, undecided : int
        Boxes examined, and how many of the last ones are neither within nor outside.
    stopped : {"gap", "time budget", "box budget", "boxes"}
        Why it ended: the gap was reached, or a budget or memory had run out.
    index : IndexBounds or None
        Of the least and the largest LCI, proven; None for an empty box.
    norm, index_note : str
        What the index is of.
    """

    lower: Quantity
    upper: Quantity
    gap: float
    target: float
    boxes: int
    undecided: int
    stopped: Stop
    index: IndexBounds | None
    norm: str
    index_note: str
    volume_unit: str
    units: dict[str, str]

    @property
    def empty(self) -> bool:
        """Whether it is proven that nothing is reachable."""
        return self.upper == 0

    @property
    def note(self) -> str:
        """Which quantity the bounds enclose, and whether they are as close as asked for."""
        text = "guaranteed bounds; of the poses in the domain that keep every limit"
        if self.stopped == "time budget":
            return f"{text}; stopped at the time budget: how close they are depends on the machine"
        if self.stopped == "box budget":
            return f"{text}; stopped at the budget of boxes"
        if self.stopped == "boxes":
            return f"{text}; stopped at {MAX_OPEN} open boxes"
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "params": self.params,
            "length_unit": self.length_unit,
            "working_mode": self.working_mode,
            "domain": {name: list(ends) for name, ends in self.box.items()},
            "limits": {
                name: [end if math.isfinite(end) else None for end in ends]
                for name, ends in self.limits.items()
            },
            "volume": {
                "value": (self.lower + self.upper) / 2,
                "unit": self.volume_unit,
                "error_bound": above((self.upper - self.lower) / 2),
                "lower": self.lower.value,
                "upper": self.upper.value,
            },
            "lci": None if self.index is None else self.index.to_dict(),
            "norm": self.norm,
            "index_note": self.index_note,
            "gap": self.gap,
            "target_gap": self.target,
            "boxes": self.boxes,
            "undecided": self.undecided,
            "stopped": self.stopped,
            "note": self.note,
            "units": self.units,
        }


def certify_volume(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None = None,
    settings: WorkspaceSettings | None = None,
    *,
    gap: float = 1e-2,
    time_budget: float | None = None,
    box_budget: int | None = None,
    progress: Progress | None = None,
    notify: Notify | None = None,
) -> CertifiedVolume:
    """Enclose the volume of one design's workspace.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    settings : WorkspaceSettings, optional
        Working mode, domain and limits; norm, Jacobian and characteristic length of the index.
    gap : float
        Relative gap between the bounds that is asked for.
    time_budget : float, optional
        Seconds of work after which the bounds so far are returned; compilation does not count.
    box_budget : int, optional
        Boxes examined after which they are: the same on every machine.
    progress, notify : callable, optional

    Raises
    ------
    InputError
        For settings that nothing is proven for, unknown names and values out of range.
    """
    if not 0 < gap < 1:
        raise InputError(f"certify: {gap} is not allowed: a gap between 0 and 1 is needed")
    budget = Budget(time_budget, box_budget)
    settings = settings or WorkspaceSettings()
    if settings.min_lci > 0:
        raise InputError(
            f"certify: min_lci={settings.min_lci} is not allowed: the volume is proven of all "
            "reachable poses; pmopt certify --min-lci proves the index over a box"
        )
    sampler, design = prepared(mechanism, params, settings, READS, notify)
    found = _Boxes(0) if design.box_volume == 0 else None
    scale = Fraction(0)
    stopped: Stop = "gap"
    index = None
    if found is None:
        from pmopt.analysis.certification.certified_index import bound_index

        enclosure = enclose(mechanism, design, announced(notify))
        found, stopped = _enclose(enclosure, gap, budget, progress)
        scale = Fraction(1)
        for width in enclosure.width.tolist():
            scale *= Fraction(width)
        index = bound_index(enclosure, settings.norm, found.examined, budget)
    low, high = found.bounds()
    lower, upper = below(float(Fraction(low) * scale)), above(float(Fraction(high) * scale))
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    units |= {c.name: mechanism.unit(c) for c in (*mechanism.pose, *mechanism.limited)}
    units |= dict.fromkeys(("volume", "lower", "upper"), mechanism.volume_unit)
    return CertifiedVolume(
        subject=sampler.space.subject(design),
        lower=Quantity(lower, 0.0, mechanism.volume_unit, ">="),
        upper=Quantity(upper, 0.0, mechanism.volume_unit, "<="),
        gap=relative(lower, upper),
        target=gap,
        boxes=found.examined,
        undecided=int((found.high > found.low).sum()),
        stopped=stopped,
        index=index,
        norm=settings.norm,
        index_note=index_note(
            sampler.space.jacobian, design.length, mechanism.length_unit, entry_units(mechanism)
        ),
        volume_unit=mechanism.volume_unit,
        units=units | {"gap": ONE},
    )


class _Boxes:
    """Boxes of the unit cube that are not settled, and the volume of those that are."""

    def __init__(self, dimension: int) -> None:
        self.centres = np.empty((0, dimension))
        self.halves = np.empty((0, dimension))
        self.low, self.high = np.empty(0), np.empty(0)
        self.examined = 0
        self.weight = 1.0
        self.open_measure = 0.0
        self._settled: list[float] = [0.0]

    def volumes(self) -> Array:
        """Return the volumes; they are powers of two."""
        found = np.ones(len(self.halves))
        for column in self.halves.T:
            found *= 2 * column
        return found

    def add(self, parts: list[tuple[Array, Array, Array, Array]]) -> None:
        """Take boxes with their bounds; those that are settled leave their volume only."""
        kept = [(self.centres, self.halves, self.low, self.high)]
        for centres, halves, low, high in parts:
            done = low == high
            inside = done & (high > 0)
            if inside.any():
                volumes = np.prod(2 * halves[inside], axis=1) * high[inside]
                self._settled.append(math.fsum(volumes.tolist()))
            kept.append((centres[~done], halves[~done], low[~done], high[~done]))
        self.centres, self.halves, self.low, self.high = map(
            np.concatenate, zip(*kept, strict=True)
        )

    def take(self, which: NDArray[np.bool_]) -> tuple[Array, Array, Array, Array]:
        """Return and remove boxes."""
        taken = self.centres[which], self.halves[which], self.low[which], self.high[which]
        keep = ~which
        self.centres, self.halves = self.centres[keep], self.halves[keep]
        self.low, self.high = self.low[keep], self.high[keep]
        return taken

    def bounds(self) -> tuple[float, float]:
        """Return bounds of the volume. A settled box that counts is within as a whole."""
        volumes = self.volumes()
        low = math.fsum([*map(below, self._settled), *map(below, _sums(volumes * self.low))])
        high = math.fsum([*map(above, self._settled), *map(above, _sums(volumes * self.high))])
        # What the sums of groups may err.
        low, high = low * (1 - _GROUP * EPS), high * (1 + _GROUP * EPS)
        return below(low * self.weight), above(high * self.weight + self.open_measure)


def _enclose(
    enclosure: Enclosure,
    gap: float,
    budget: Budget,
    progress: Progress | None,
) -> tuple[_Boxes, Stop]:
    """Bisect the boxes that leave most of the volume open until the gap is reached."""
    boxes = _Boxes(len(enclosure.lower))
    centres, halves, boxes.weight = enclosure.first()
    boxes.open_measure = enclosure.open_measure
    boxes.examined = len(centres)
    weights = np.ones(centres.shape[1])
    boxes.add([(centres, halves, *enclosure.measures(centres, halves))])
    while True:
        low, high = boxes.bounds()
        reached = relative(low, high)
        if progress:
            progress(reached, gap)
        if reached <= gap:
            return boxes, "gap"
        if len(boxes.low) > MAX_OPEN:
            return boxes, "boxes"
        if boxes.open_measure > _COVER * (high - low):
            found = enclosure.more(_ROUND)
            if found is not None:
                fell = enclosure.open_measure < _FALLING * boxes.open_measure
                boxes.open_measure = enclosure.open_measure
                boxes.examined += len(found[0])
                boxes.add([(*found, *enclosure.measures(*found))])
                spent = budget.spent(boxes.examined)
                if spent is not None:
                    return boxes, spent
                if fell:
                    continue
        # No more than what closes the gap if every bisection halved its part.
        wanted = min(_ROUND, 2 * (1 - gap / reached) + 0.05)
        taken = boxes.take(_largest((boxes.high - boxes.low) * boxes.volumes(), wanted))
        parts: list[tuple[Array, Array, Array, Array]] = []
        weights = _weighed(enclosure, taken[0], taken[1], weights)
        for start in range(0, len(taken[0]), BATCH):
            spent = budget.spent(boxes.examined)
            if spent is not None:
                centres, halves, lows, highs = (a[start:] for a in taken)
                boxes.add([*parts, (centres, halves, lows, highs)])
                return boxes, spent
            part = slice(start, start + BATCH)
            children = bisected(taken[0][part], taken[1][part], weights)
            boxes.examined += len(children[0])
            parts.append((*children, *enclosure.measures(*children)))
        boxes.add(parts)


def _sums(values: Array) -> list[float]:
    """Return sums of groups of values >= 0, exact to half of _GROUP EPS in whatever order."""
    even = len(values) - len(values) % _GROUP
    found = values[:even].reshape(-1, _GROUP).sum(axis=1)
    return [*found.tolist(), *values[even:].tolist()]


def _largest(values: Array, share: float) -> NDArray[np.bool_]:
    """Return which of the values > 0 are the largest that make up a share of their sum.

    To a quarter of an octave: no sorting of millions.
    """
    fraction, exponent = np.frexp(values)
    level = exponent * 4 + np.floor(fraction * 8).astype(np.int64)
    level -= level.min()
    sums = np.cumsum(np.bincount(level, weights=values)[::-1])
    depth = int(np.searchsorted(sums, share * sums[-1]))
    return np.asarray(level >= len(sums) - 1 - depth)


def _weighed(enclosure: Enclosure, centres: Array, halves: Array, weights: Array) -> Array:
    """Return better weights of the coordinates: their longest side is split next.

    Some boxes are bisected across each coordinate. One that closes the gap best more often than it
    is chosen gains weight.
    """
    some = slice(None, None, max(len(centres) // _TRIALS, 1))
    centres, halves = centres[some], halves[some]
    gaps = []
    for axis in range(len(weights)):
        low, high = enclosure.measures(*halved(centres, halves, np.int64(axis)))
        gaps.append((high - low).reshape(2, -1).sum(axis=0))
    stacked = np.stack(gaps)
    # Where all are alike nothing is learnt.
    differing = stacked.min(axis=0) < stacked.max(axis=0) * (1 - 1e-6)
    size = len(weights)
    best = np.bincount(stacked.argmin(axis=0)[differing], minlength=size)
    taken = np.bincount(np.argmax(halves * weights, axis=1)[differing], minlength=size)
    change = (best - taken) / max(int(differing.sum()), 1)
    return np.asarray(weights * exp_of(_LEARNT * change * math.log(2)))
