"""Claims about the dexterity of all reachable poses of a box, proven or refuted.

The box is bisected (:mod:`pmopt.analysis.certification.bisection`) until the claim is proven of all
its parts, or a witness is found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
    bisected,
    prepared,
)
from pmopt.analysis.certification.budgets import Budget
from pmopt.analysis.certification.enclosing import enclose
from pmopt.analysis.certification.proven_matrices import index_bounds, proven_signs, regular
from pmopt.analysis.kinematics.index_units import entry_units, index_note
from pmopt.analysis.reads import INDEX, WITH_MIN_LCI, Reads
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.settings import ClaimSettings, WorkspaceSettings
from pmopt.analysis.workspace.emptiness import explain
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.units import ONE, exact

Array = NDArray[np.float64]
Verdict = Literal["proven", "refuted", "undecided", "empty"]
Ended = Literal["proven", "witness", "time budget", "box budget", "boxes", "edge"]
#: Of a claim about the index, and of one that no pose is singular.
READS = Reads("certify", ClaimSettings, dict.fromkeys(INDEX, WITH_MIN_LCI), instead=INSTEAD)


@dataclass(frozen=True)
class Claim(OfSubject):
    """A claim about every reachable pose of a box, and the verdict.

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
    sampler, design = prepared(mechanism, params, settings, READS, notify)
    verdict: Verdict = "empty" if design.void else "undecided"
    stopped: Ended = "proven" if design.void else "edge"
    witness, index, examined, share = None, None, 0, 0.0 if design.void else 1.0
    reached: dict[str, bool] = {}
    if design.box_volume > 0:
        search = _Search(mechanism, design, settings, announced(notify))
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
    if verdict == "empty":  # the claim is about the index, which is no restriction
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
            for start in range(0, len(centres), BATCH):
                spent = budget.spent(self.examined)
                if spent is not None:
                    return "undecided", spent
                part = slice(start, start + BATCH)
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
            for start in range(0, len(centres), BATCH):
                spent = budget.spent(self.examined)
                if spent is not None:
                    return "undecided", spent
                part = slice(start, start + BATCH)
                open_boxes = self._examine(centres[part], halves[part])
                parts.append((centres[part][open_boxes], halves[part][open_boxes]))
                if self.witness is not None:
                    return "refuted", "witness"
            centres, halves = (np.concatenate(p) for p in zip(*parts, strict=True))
            self.open_share = min(above(float(np.prod(2 * halves, axis=1).sum())), 1.0)
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
