"""Guaranteed bounds of a workspace's volume, and proven or refuted claims about its dexterity.

Boxes of poses are bisected until what is proven of them
(:mod:`pmopt.analysis.certification.enclosures`) does: interval branch and bound. What is proven is
about the poses that a sampled workspace counts: those in the design's box that keep every limit in
the working mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.certification.budgets import Budget
from pmopt.analysis.certification.enclosures import Enclosure, enclose
from pmopt.analysis.kinematics.index_units import entry_units, index_note
from pmopt.analysis.reads import INDEX, WITH_MIN_LCI, Reads
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.settings import ClaimSettings, VolumeSettings, WorkspaceSettings
from pmopt.analysis.workspace.emptiness import explain
from pmopt.errors import InputError
from pmopt.kernels.affine_forms import EPS
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.numerics.elementary import exp_of
from pmopt.numerics.matrices import decomposed, determinant, inverse, product
from pmopt.quantity import Quantity
from pmopt.units import ONE, exact

if TYPE_CHECKING:
    from pmopt.analysis.certification.certified_index import IndexBounds

Array = NDArray[np.float64]
Stop = Literal["gap", "time budget", "box budget", "boxes"]
Verdict = Literal["proven", "refuted", "undecided", "empty"]
Ended = Literal["proven", "witness", "time budget", "box budget", "boxes", "edge"]
#: Called with a number that falls to 0 when the work is done, e.g. the gap.
Progress = Callable[[float, float], None]

#: Most boxes kept open: some hundred bytes each.
MAX_OPEN = 1 << 22
#: Boxes evaluated between looks at the clock.
_BATCH = 1 << 13
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
#: Backward error of a determinant up to order 6: n^3 EPS times a growth of at most 2^(n - 1).
_BACKWARD = 1e-11
_INSTEAD = "nothing is sampled, and proven with a working mode, a domain and limits of joints"
#: Of a claim about the index, and of one that no pose is singular.
READS = Reads("certify", ClaimSettings, dict.fromkeys(INDEX, WITH_MIN_LCI), instead=_INSTEAD)
VOLUME_READS = Reads("certify", VolumeSettings, instead=_INSTEAD)


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
        """What the bounds are of, and whether they are what was asked for."""
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
                "error_bound": _above((self.upper - self.lower) / 2),
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
    sampler, design = _prepared(mechanism, params, settings, VOLUME_READS, notify)
    found = _Boxes(0) if design.box_volume == 0 else None
    scale = Fraction(0)
    stopped: Stop = "gap"
    index = None
    if found is None:
        from pmopt.analysis.certification.certified_index import bound_index

        enclosure = enclose(mechanism, design, _announced(notify))
        found, stopped = _enclose(enclosure, gap, budget, progress)
        scale = Fraction(1)
        for width in enclosure.width.tolist():
            scale *= Fraction(width)
        index = bound_index(enclosure, settings.norm, found.examined, budget)
    low, high = found.bounds()
    lower, upper = _below(float(Fraction(low) * scale)), _above(float(Fraction(high) * scale))
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    units |= {c.name: mechanism.unit(c) for c in (*mechanism.pose, *mechanism.limited)}
    units |= dict.fromkeys(("volume", "lower", "upper"), mechanism.volume_unit)
    return CertifiedVolume(
        subject=sampler.space.subject(design),
        lower=Quantity(lower, 0.0, mechanism.volume_unit, ">="),
        upper=Quantity(upper, 0.0, mechanism.volume_unit, "<="),
        gap=_relative(lower, upper),
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
        low = math.fsum([*map(_below, self._settled), *map(_below, _sums(volumes * self.low))])
        high = math.fsum([*map(_above, self._settled), *map(_above, _sums(volumes * self.high))])
        # What the sums of groups may err.
        low, high = low * (1 - _GROUP * EPS), high * (1 + _GROUP * EPS)
        return _below(low * self.weight), _above(high * self.weight + self.open_measure)


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
        reached = _relative(low, high)
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
        for start in range(0, len(taken[0]), _BATCH):
            spent = budget.spent(boxes.examined)
            if spent is not None:
                centres, halves, lows, highs = (a[start:] for a in taken)
                boxes.add([*parts, (centres, halves, lows, highs)])
                return boxes, spent
            part = slice(start, start + _BATCH)
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


def bisected(centres: Array, halves: Array, weights: Array | None = None) -> tuple[Array, Array]:
    """Return both halves of each box, across its longest side, by weights of the coordinates."""
    return _halved(
        centres, halves, np.argmax(halves if weights is None else halves * weights, axis=1)
    )


def _halved(
    centres: Array, halves: Array, axis: NDArray[np.int64] | np.int64
) -> tuple[Array, Array]:
    rows = np.arange(len(centres))
    halves = halves.copy()
    halves[rows, axis] /= 2
    shift = np.zeros_like(halves)
    shift[rows, axis] = halves[rows, axis]
    return np.concatenate([centres - shift, centres + shift]), np.concatenate([halves, halves])


def _weighed(enclosure: Enclosure, centres: Array, halves: Array, weights: Array) -> Array:
    """Return better weights of the coordinates: their longest side is split next.

    Some boxes are bisected across each coordinate. One that closes the gap best more often than it
    is chosen gains weight.
    """
    some = slice(None, None, max(len(centres) // _TRIALS, 1))
    centres, halves = centres[some], halves[some]
    gaps = []
    for axis in range(len(weights)):
        low, high = enclosure.measures(*_halved(centres, halves, np.int64(axis)))
        gaps.append((high - low).reshape(2, -1).sum(axis=0))
    stacked = np.stack(gaps)
    # Where all are alike nothing is learnt.
    telling = stacked.min(axis=0) < stacked.max(axis=0) * (1 - 1e-6)
    size = len(weights)
    best = np.bincount(stacked.argmin(axis=0)[telling], minlength=size)
    taken = np.bincount(np.argmax(halves * weights, axis=1)[telling], minlength=size)
    change = (best - taken) / max(int(telling.sum()), 1)
    return np.asarray(weights * exp_of(_LEARNT * change * math.log(2)))


def _prepared(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    settings: WorkspaceSettings,
    reads: Reads[Any],
    notify: Notify | None,
) -> tuple[Sampler, Design]:
    """Return a sampler and its design, settings that nothing is proven for refused."""
    reads.check(settings)
    sampler = make_sampler(mechanism, settings, notify=notify, where="certify")
    return sampler, sampler.design(mechanism.resolve(params or {}))


def _announced(notify: Notify | None) -> Callable[[], None] | None:
    if notify is None:
        return None
    return lambda: notify("compiling what proofs are evaluated with, once: some seconds")


def _relative(lower: float, upper: float) -> float:
    return _above((upper - lower) / upper * (1 + 4 * EPS)) if upper > lower else 0.0


def _below(value: float) -> float:
    return math.nextafter(value, -math.inf) if value > 0.0 else 0.0


def _above(value: float) -> float:
    return math.nextafter(value, math.inf) if value > 0.0 else 0.0


@dataclass(frozen=True)
class Claim(OfSubject):
    """A claim about every reachable pose of a box, and what became of it.

    Attributes
    ----------
    claim : str
        In words.
    min_lci : float or None
        None for the claim that there is no singularity.
    verdict : {"proven", "refuted", "undecided", "empty"}
        Proven only where some pose of the box is proven to be reachable, empty where it is proven
        that none is: a claim about nothing.
    witness : dict or None
        A reachable pose that refutes it.
    witness_lci : float or None
        Of a pose below ``min_lci``, an upper bound.
    boxes : int
        Boxes examined.
    open_share : float
        Share of the box in which nothing is proven yet, at most.
    reachable : {"all", "some", "none", "unknown"}
        Of the box's poses, as far as it is proven.
    stopped : {"proven", "witness", "time budget", "box budget", "boxes", "edge"}
        Why it ended; "edge": the box touches what can be reached, to rounding.
    reason : str or None
        What rules all poses out, where none is reachable.
    """

    norm: str
    index_note: str
    claim: str
    min_lci: float | None
    verdict: Verdict
    witness: dict[str, float] | None
    witness_lci: float | None
    boxes: int
    open_share: float
    reachable: Literal["all", "some", "none", "unknown"]
    stopped: Ended
    units: dict[str, str]
    reason: str | None = None

    @property
    def note(self) -> str:
        """What the claim is about."""
        text = "of the poses in the domain that keep every limit; those out of reach do not count"
        if self.verdict == "empty":
            text += "; no pose of it is reachable, proven: the claim is about nothing"
        elif self.verdict == "undecided" and self.reachable == "unknown":
            text += "; no pose of it is proven to be reachable"
        if self.stopped == "time budget":
            text += "; stopped at the time budget: another machine may decide it"
        if self.stopped == "box budget":
            text += "; stopped at the budget of boxes: more of them may decide it"
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "params": self.params,
            "length_unit": self.length_unit,
            "working_mode": self.working_mode,
            "norm": self.norm,
            "index_note": self.index_note,
            "domain": {name: list(ends) for name, ends in self.box.items()},
            "limits": {
                name: [end if math.isfinite(end) else None for end in ends]
                for name, ends in self.limits.items()
            },
            "claim": self.claim,
            "min_lci": self.min_lci,
            "verdict": self.verdict,
            "witness": self.witness,
            "witness_lci": self.witness_lci,
            "reachable": self.reachable,
            "open_share": self.open_share,
            "boxes": self.boxes,
            "stopped": self.stopped,
            "reason": self.reason,
            "note": self.note,
            "units": self.units,
        }


def certify_claim(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None = None,
    settings: WorkspaceSettings | None = None,
    *,
    time_budget: float | None = 30.0,
    box_budget: int | None = None,
    progress: Progress | None = None,
    notify: Notify | None = None,
) -> Claim:
    """Prove or refute that every reachable pose of a box is well conditioned.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    settings : WorkspaceSettings, optional
        Working mode, domain, limits, norm and characteristic length. With ``min_lci`` > 0 the claim
        is LCI >= min_lci at every reachable pose, else that none is singular.
    time_budget : float, optional
        Seconds of work after which the claim is left undecided; compilation does not count.
    box_budget : int, optional
        Boxes examined after which it is: the same on every machine.
    progress, notify : callable, optional

    Raises
    ------
    InputError
        For settings that nothing is proven for, unknown names and values out of range.
    """
    budget = Budget(time_budget, box_budget)
    settings = settings or WorkspaceSettings()
    least = settings.min_lci
    sampler, design = _prepared(mechanism, params, settings, READS, notify)
    verdict: Verdict = "empty" if design.void else "undecided"
    stopped: Ended = "proven" if design.void else "edge"
    witness, index, examined, share = None, None, 0, 0.0 if design.void else 1.0
    reached: dict[str, bool] = {}
    if design.box_volume > 0:
        search = _Search(mechanism, design, settings, _announced(notify))
        verdict, stopped = search.run(budget, progress)
        witness, index = search.witness, search.witness_lci
        examined, share = search.examined, search.open_share
        reached = search.reached
    reachable: Literal["all", "some", "none", "unknown"] = "unknown"
    if reached.get("in") or witness is not None:
        whole = verdict == "proven" and not (reached["out"] or reached["edge"])
        reachable = "all" if whole else "some"
    elif verdict == "empty":
        reachable = "none"
    reason = None
    if verdict == "empty":  # the index is what is claimed, no restriction
        every = settings.model_copy(update={"min_lci": 0.0})
        reason = explain(mechanism, design.parameters, every)
    names = [c.name for c in mechanism.pose]
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    units |= {c.name: mechanism.unit(c) for c in (*mechanism.pose, *mechanism.limited)}
    units |= dict.fromkeys(("min_lci", "witness_lci", "open_share"), ONE)
    return Claim(
        subject=sampler.space.subject(design),
        norm=settings.norm,
        index_note=index_note(
            sampler.space.jacobian, design.length, mechanism.length_unit, entry_units(mechanism)
        ),
        claim=f"LCI >= {exact(least)} at every reachable pose" if least > 0 else
        "no reachable pose is singular",
        min_lci=least if least > 0 else None,
        verdict=verdict,
        witness=None if witness is None else dict(zip(names, witness.tolist(), strict=True)),
        witness_lci=index,
        boxes=examined,
        open_share=share,
        reachable=reachable,
        stopped=stopped,
        units=units,
        reason=reason,
    )  # fmt: skip


class _Search:
    """Bisects a box until a claim is proven of all of it or a witness refutes it.

    ``reached`` says whether boxes within reach, out of it, and across its edge were met. Boxes in
    which the claim holds, but none is proven to be reachable, are kept until one is.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        design: Design,
        settings: WorkspaceSettings,
        announced: Callable[[], None] | None,
    ) -> None:
        self.enclosure = enclose(mechanism, design, announced)
        self.design = design
        self.norm = settings.norm
        self.least = settings.min_lci
        self.witness: Array | None = None
        self.witness_lci: float | None = None
        self.examined = 0
        self.open_share = 1.0
        self.reached = dict.fromkeys(("in", "out", "edge"), False)
        self._unsure: list[tuple[Array, Array]] = []

    def run(self, budget: Budget, progress: Progress | None) -> tuple[Verdict, Ended]:
        """Return the verdict and why the search ended."""
        verdict, stopped = self._hold(budget, progress)
        if verdict == "proven" and not self.reached["in"]:
            return self._exist(budget)
        return verdict, stopped

    def _exist(self, budget: Budget) -> tuple[Verdict, Ended]:
        """Return whether the claim, which holds, is about some pose or about none."""
        size = len(self.enclosure.lower)
        centres, halves = (
            np.concatenate([np.empty((0, size)), *(part[k] for part in self._unsure)])
            for k in range(2)
        )
        while len(centres):
            parts: list[tuple[Array, Array]] = []
            for start in range(0, len(centres), _BATCH):
                spent = budget.spent(self.examined)
                if spent is not None:
                    return "undecided", spent
                part = slice(start, start + _BATCH)
                self.examined += len(centres[part])
                low, high = self.enclosure.shares(centres[part], halves[part])
                point, _ = self.enclosure.shares(centres[part], np.zeros_like(halves[part]))
                self.reached["out"] |= bool((high == 0).any())
                if (low > 0).any() or (point == 1).any():
                    self.reached["in"] = True
                    return "proven", "proven"
                parts.append((centres[part][high > 0], halves[part][high > 0]))
            centres, halves = (np.concatenate(p) for p in zip(*parts, strict=True))
            if len(centres) > MAX_OPEN // 2:
                return "undecided", "boxes"
            centres, halves = bisected(centres, halves)
        return "empty", "proven"

    def _hold(self, budget: Budget, progress: Progress | None) -> tuple[Verdict, Ended]:
        """Bisect until the claim holds in every box, or a witness refutes it."""
        centres, halves = self.enclosure.whole()
        while len(centres):
            parts: list[tuple[Array, Array]] = []
            for start in range(0, len(centres), _BATCH):
                spent = budget.spent(self.examined)
                if spent is not None:
                    return "undecided", spent
                part = slice(start, start + _BATCH)
                open_boxes = self._examine(centres[part], halves[part])
                parts.append((centres[part][open_boxes], halves[part][open_boxes]))
                if self.witness is not None:
                    return "refuted", "witness"
            centres, halves = (np.concatenate(p) for p in zip(*parts, strict=True))
            self.open_share = min(_above(float(np.prod(2 * halves, axis=1).sum())), 1.0)
            if progress:
                progress(self.open_share, 0.0)
            if len(centres) > MAX_OPEN // 2:
                return "undecided", "boxes"
            centres, halves = bisected(centres, halves)
        self.open_share = 0.0
        return "proven", "proven"

    def _examine(self, centres: Array, halves: Array) -> NDArray[np.bool_]:
        """Return which boxes stay open, and look for a witness in them."""
        self.examined += len(centres)
        low, high = self.enclosure.shares(centres, halves)
        self.reached["out"] |= bool((high == 0).any())
        self.reached["in"] |= bool((low > 0).any())
        middles, ranges = self.enclosure.jacobians(centres, halves)
        held = np.asarray(high == 0)
        rest = np.flatnonzero(~held)
        if self.least > 0:
            below, _ = index_bounds(middles[rest], ranges[rest], self.norm)
            held[rest] = below >= self.least
        else:
            held[rest] = regular(middles[rest], ranges[rest])
        self.reached["edge"] |= bool((held & (high > 0) & (low < 1)).any())
        if self.reached["in"]:
            self._unsure.clear()
        else:
            unsure = held & (high > 0)
            self._unsure.append((centres[unsure], halves[unsure]))
        rest = np.flatnonzero(~held)
        if len(rest):
            if self.least > 0:
                self._find_below(centres[rest])
            else:
                inside = rest[low[rest] == 1]
                self._find_crossing(centres[inside], halves[inside])
        return ~held

    def _find_below(self, centres: Array) -> None:
        """Look for a centre that is reachable and whose index is too small."""
        points = np.zeros_like(centres)
        within, _ = self.enclosure.shares(centres, points)
        _, above = index_bounds(*self.enclosure.jacobians(centres, points), self.norm)
        found = np.flatnonzero((within == 1) & (above < self.least))
        if len(found):
            worst = found[np.argmin(above[found])]
            self.witness = self.enclosure.pose(centres[worst])
            self.witness_lci = float(above[worst])

    def _find_crossing(self, centres: Array, halves: Array) -> None:
        """Look for two ends of a diagonal, within reach like all between, whose signs differ."""
        ends = centres - halves, centres + halves
        signs = [self._signs(points) for points in ends]
        found = np.flatnonzero(signs[0] * signs[1] < 0)
        if not len(found):
            return
        low, high = (points[found[0]] for points in ends)
        sign = signs[0][found[0]]
        for _ in range(60):
            middle = (low + high) / 2
            here = self._signs(middle[None])[0]
            if here == 0:
                break
            low, high = (middle, high) if here == sign else (low, middle)
        self.witness = self.enclosure.pose((low + high) / 2)

    def _signs(self, points: Array) -> NDArray[np.int64]:
        """Return the proven signs of the determinant at points, 0 where none is proven."""
        return proven_signs(*self.enclosure.jacobians(points, np.zeros_like(points)))


def index_bounds(middles: Array, ranges: Array, norm: str) -> tuple[Array, Array]:
    """Return proven bounds of the conditioning index of matrices.

    Parameters
    ----------
    middles, ranges : (N, n, n) float64
        Entries and how far each may be off.
    norm : {"2", "fro"}

    Returns
    -------
    lower, upper : (N,) float64
        NaN where the entries are not finite.

    Notes
    -----
    What the decomposition gives is checked, not trusted: of M = U S V^T + R singular values differ
    by at most |R|_F, and those of U S V^T from S by factors that |U^T U - I|_F and |V^T V - I|_F
    bound (both norms rounded up). The range adds at most its Frobenius norm (Weyl).
    """
    size = middles.shape[1]
    good = np.isfinite(middles).all(axis=(1, 2)) & np.isfinite(ranges).all(axis=(1, 2))
    lower, upper = np.full(len(middles), np.nan), np.full(len(middles), np.nan)
    middle, reach = middles[good], ranges[good]
    left, values, right = decomposed(middle)
    norms = np.sqrt((middle**2).sum(axis=(1, 2)))
    # Products of n terms of unit rows and columns: n + 2 roundings of size EPS / 2 and spare.
    rounding = 4 * size * (size + 2) * EPS
    rest = middle - product(left * values[:, None, :], right)
    off = np.sqrt((rest**2).sum(axis=(1, 2))) + rounding * norms
    eye = np.eye(size)
    tilt = np.zeros(len(middle))
    for factor in (left, np.swapaxes(right, 1, 2)):
        defect = product(np.swapaxes(factor, 1, 2), factor) - eye
        tilt += np.sqrt((defect**2).sum(axis=(1, 2))) + rounding
    off += np.sqrt((reach**2).sum(axis=(1, 2))) * (1 + rounding)
    off = (off + 2 * tilt * values[:, 0]) * (1 + rounding)
    least, most = np.maximum(values - off[:, None], 0.0), values + off[:, None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if norm == "2":
            below, above = least[:, -1] / most[:, 0], most[:, -1] / least[:, 0]
        else:
            below = 1 / np.sqrt((most**2).sum(axis=1) * (1 / least**2).sum(axis=1))
            above = 1 / np.sqrt((least**2).sum(axis=1) * (1 / most**2).sum(axis=1))
    lower[good] = np.where(least[:, -1] > 0, below * (1 - rounding), 0.0)
    upper[good] = np.where(np.isnan(above), 1.0, np.minimum(above * (1 + rounding), 1.0))
    return lower, upper


def regular(middles: Array, ranges: Array) -> NDArray[np.bool_]:
    """Return which matrices are proven regular, whatever their entries within the ranges.

    With Y near the inverse of the middle, |I - Y M| < 1 row by row (Krawczyk); that Y is regular
    follows.
    """
    size = middles.shape[1]
    good = np.isfinite(middles).all(axis=(1, 2)) & np.isfinite(ranges).all(axis=(1, 2))
    middle, reach = middles[good], ranges[good]
    scale = np.abs(middle).max(axis=(1, 2))
    scale = np.where(scale > 0, scale, 1.0)[:, None, None]
    near = _inverses(middle / scale) / scale
    found = np.zeros(len(middles), dtype=bool)
    absolute = np.abs(near)
    rounding = 4 * (size + 2) * EPS
    with np.errstate(invalid="ignore", over="ignore"):
        rest = np.abs(np.eye(size) - product(near, middle))
        rest += rounding * product(absolute, np.abs(middle))
        rest += product(absolute, reach)
        found[good] = (rest.sum(axis=2) * (1 + rounding) + rounding < 1).all(axis=1)
    return found


def _inverses(matrices: Array) -> Array:
    """Return the inverses, 0 of what is singular to rounding."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        bad = ~(np.abs(determinant(matrices)) > 0)
    usable = np.where(bad[:, None, None], np.eye(matrices.shape[1]), matrices)
    return np.asarray(np.where(bad[:, None, None], 0.0, inverse(usable)))


def proven_signs(middles: Array, ranges: Array) -> NDArray[np.int64]:
    """Return the signs of the determinants of matrices, 0 where none is proven.

    What elimination with pivoting tells is the determinant of a matrix that differs in each entry
    by less than _BACKWARD times the greatest (Higham): it has the sign of all that are proven
    regular together with it.
    """
    with np.errstate(invalid="ignore"):
        off = _BACKWARD * np.abs(middles).max(axis=(1, 2), keepdims=True)
        good = regular(middles, ranges + off)
    scale = np.where(good, np.abs(middles).max(axis=(1, 2)), 1.0)
    usable = np.where(good[:, None, None], middles / scale[:, None, None], 0.0)
    return np.asarray(np.sign(determinant(usable))).astype(np.int64)
