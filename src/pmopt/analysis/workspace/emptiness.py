"""Why nothing is reachable: the restriction that rules it out, and what is reachable without it.

Restrictions are dropped one at a time; where that does not do, all of them, and then as many are
taken back as leave something reachable. What is found is found on a sample of poses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.determinants import branch_at
from pmopt.analysis.kinematics.limits import of_limb
from pmopt.analysis.sampling.aspects import FieldEvaluator
from pmopt.analysis.sampling.design_space import TOOL, Design
from pmopt.analysis.sampling.evaluator import Evaluator
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.errors import InfeasibleError, InputError, PmoptError
from pmopt.mechanisms.mechanism import Coordinate, Mechanism, Parameters
from pmopt.units import ONE, exact, unit_of

#: Poses that each trial samples, those at which joints are looked at, and steps of a bisection.
_POSES, _PROBES, _STEPS = 1 << 16, 256, 12
#: Most restrictions that are named where any of them does.
_NAMED = 3
_OPEN = (-math.inf, math.inf)
Kind = Literal["domain", "limits", "min_lci", "check", "aspect", "working_mode", "parameters"]


@dataclass(frozen=True)
class Restriction:
    """Something that may rule poses out.

    Attributes
    ----------
    kind : str
    name : str
        Of the coordinate, joint, setting or parameter.
    own : bool
        Whether it was given; else it is the mechanism's default.
    """

    kind: Kind
    name: str
    own: bool


@dataclass(frozen=True)
class _Trial:
    """What a trial reaches: a sample of poses (d, N) and their LCI."""

    sampler: Sampler
    design: Design
    poses: NDArray[np.float64]
    lci: NDArray[np.float64]


@dataclass
class _Question:
    """An empty workspace, and trials without some of its restrictions."""

    mechanism: Mechanism
    parameters: Parameters
    settings: WorkspaceSettings
    _trials: dict[frozenset[Restriction], _Trial | None] = field(default_factory=dict)

    def restrictions(self, free: Sequence[str]) -> list[Restriction]:
        """Return all that may rule poses out, what was given first; parameters but the free."""
        mechanism, settings = self.mechanism, self.settings
        domain, limits = (
            mechanism.default_domain(self.parameters), mechanism.default_limits(self.parameters)
        )  # fmt: skip
        found = [Restriction("domain", name, True) for name in settings.domain]
        found += [Restriction("limits", name, True) for name in settings.limits]
        found += [
            Restriction("check", name, True)
            for name in ("platform_diameter", "link_diameter", "cone_angle")
            if getattr(settings, name) is not None
        ]
        if settings.min_lci > 0:
            found.append(Restriction("min_lci", "min_lci", True))
        if settings.aspect is not None:
            found.append(Restriction("aspect", "aspect", True))
        if settings.working_mode not in (None, mechanism.working_modes[0]):
            found.append(Restriction("working_mode", "working_mode", True))
        found += [
            Restriction("parameters", p.name, True)
            for p in mechanism.parameters
            if p.name not in free and self.parameters[p.name] != p.default
        ]
        found += [Restriction("limits", n, False) for n in limits if n not in settings.limits]
        found += [Restriction("domain", n, False) for n in domain if n not in settings.domain]
        return found

    def without(self, dropped: frozenset[Restriction]) -> _Trial | None:
        """Return what is reachable without some restrictions, None where nothing is."""
        if dropped not in self._trials:
            update: dict[str, Any] = {
                "domain": dict(self.settings.domain), "limits": dict(self.settings.limits)
            }  # fmt: skip
            parameters = dict(self.parameters)
            for r in sorted(dropped, key=lambda r: not r.own):
                if r.kind in ("domain", "limits"):
                    if r.own:
                        del update[r.kind][r.name]
                    else:
                        update[r.kind][r.name] = _OPEN
                elif r.kind == "parameters":
                    parameters[r.name] = self.mechanism.parameter(r.name).default
                else:
                    update[r.name] = 0.0 if r.kind == "min_lci" else None
                    if r.name == "link_diameter":
                        update["platform_diameter"] = None
            self._trials[dropped] = self.trial(update, parameters)
        return self._trials[dropped]

    def trial(self, update: Mapping[str, Any], parameters: Parameters) -> _Trial | None:
        """Return what is reachable with other settings and parameters, None where nothing is."""
        idle = {"sampler": "r-sequence", "grid": None, "block": None}
        settings = self.settings.model_copy(update={**idle, **update})
        try:
            sampler = make_sampler(self.mechanism, settings)
            design = sampler.design(parameters)
            if not 0 < design.box_volume < math.inf:
                return None
            poses = sampler.evaluator.points(design, sampler.sequence(1), 0, _POSES)
            margin, lci = sampler.evaluator.field(design, poses)
        except (PmoptError, ArithmeticError, ValueError):
            return None  # such a design cannot be made ready: nothing of it is reachable
        kept = (margin >= 0) & (lci >= settings.min_lci)
        return _Trial(sampler, design, poses[:, kept], lci[kept]) if kept.any() else None

    def edge(self, good: float, bad: float, trial: Callable[[float], _Trial | None]) -> float:
        """Return about the last value, from one that reaches something, that does."""
        for _ in range(_STEPS):
            middle = (good + bad) / 2
            if trial(middle) is None:
                bad = middle
            else:
                good = middle
        return good

    def say(self, one: Restriction, dropped: frozenset[Restriction]) -> str:
        """Say what a restriction rules out, and what is reachable without the dropped ones."""
        found = self.without(dropped)
        assert found is not None
        if one.kind in ("domain", "limits"):
            return self._range(one, found)
        unit, value = self._given(one)
        if one.kind == "min_lci":
            best = float(found.lci.max())
            return f"min_lci={exact(value)} leaves nothing; the largest LCI found is {best:.4g}"
        if one.kind == "aspect":
            return f"aspect={value} leaves nothing"
        if one.kind == "working_mode":
            return (
                f"working_mode={value} leaves nothing; {found.sampler.space.working_mode} does not"
            )
        return self._size(one, unit, value, dropped - {one})

    def _range(self, one: Restriction, found: _Trial) -> str:
        """Say what a range of a coordinate or joint rules out."""
        unit, ends = self._given(one)
        head = f"{one.kind}: {one.name}={exact(ends[0])}:{exact(ends[1])} {unit}"
        if not one.own:
            head += " (the default)"
        met = self._met(one, found)
        if not len(met):
            return f"{head} leaves nothing"
        low, high = float(met.min()), float(met.max())
        reach = f"about {low:.4g} .. {high:.4g} {unit}"
        if ends[1] < low or ends[0] > high:
            return f"{head} lies beyond the reach, {reach}"
        return f"{head} leaves nothing; without it {one.name} is {reach}"

    def _size(
        self, one: Restriction, unit: str, value: float | None, rest: frozenset[Restriction]
    ) -> str:
        """Say what a number rules out, a parameter or a size of a check, and from where it does."""
        shown = "unset" if value is None else _with_unit(exact(value), unit)
        good: float | None
        if one.kind == "parameters":
            good = self.mechanism.parameter(one.name).default
            default = "unset" if good is None else _with_unit(exact(good), unit)
            text = f"parameters: {one.name}={shown} leaves nothing; the default {default} does not"
        else:
            good = math.pi if one.name == "cone_angle" else 0.0
            text = f"{one.name}={shown} leaves nothing"
        if good is None or value is None:
            return text

        def trial(number: float) -> _Trial | None:
            if one.kind == "parameters":
                other = replace(self, parameters={**self.parameters, one.name: number}, _trials={})
            else:
                settings = self.settings.model_copy(update={one.name: number})
                other = replace(self, settings=settings, _trials={})
            return other.without(rest)

        edge = self.edge(good, value, trial)
        about = f"about {_with_unit(f'{edge:.3g}', unit)}"
        reach = f"from {about} on" if edge > value else f"up to {about}"
        return f"{text}; something is reachable {reach}"

    def _given(self, one: Restriction) -> tuple[str, Any]:
        """Return the unit and the value of a restriction."""
        mechanism, settings = self.mechanism, self.settings
        if one.kind in ("domain", "limits"):
            tables = {
                "domain": (settings.domain, mechanism.default_domain(self.parameters)),
                "limits": (settings.limits, mechanism.default_limits(self.parameters)),
            }[one.kind]
            return mechanism.unit(self._coordinate(one)), tables[not one.own][one.name]
        if one.kind == "parameters":
            return mechanism.unit(mechanism.parameter(one.name)), self.parameters[one.name]
        unit = {"cone_angle": "rad", "min_lci": ONE, "aspect": ONE, "working_mode": ONE}
        length = unit_of("length", mechanism.length_unit)
        return unit.get(one.name, length), getattr(settings, one.name)

    def _coordinate(self, one: Restriction) -> Coordinate:
        mechanism = self.mechanism
        known = mechanism.pose if one.kind == "domain" else (*mechanism.limited, *TOOL)
        return next(c for c in known if c.name == one.name)

    def _met(self, one: Restriction, found: _Trial) -> NDArray[np.float64]:
        """Return values of a coordinate or joint at reachable poses."""
        names = [c.name for c in self.mechanism.pose]
        if one.kind == "domain":
            return np.asarray(found.poses[names.index(one.name)])
        step = max(1, found.poses.shape[1] // _PROBES)
        poses = found.poses[:, ::step]
        tools = [c.name for c in TOOL]
        if one.name in tools:
            places: NDArray[np.float64] = found.sampler.evaluator.probe(found.design, poses).tool
            met: NDArray[np.float64] = places[:, tools.index(one.name)]
            return met
        values = []
        for column in poses.T.tolist():
            pose = dict(zip(names, column, strict=True))
            branch = branch_at(
                self.mechanism, found.sampler.space.working_mode, found.design.parameters, pose
            )
            if branch is not None:
                joints = {**branch.joints, **branch.passive}
                values += [v for name, v in joints.items() if of_limb(one.name, name)]
        return np.array(values)


def _with_unit(text: str, unit: str) -> str:
    return text if unit == ONE else f"{text} {unit}"


def explain(
    mechanism: Mechanism,
    parameters: Parameters,
    settings: WorkspaceSettings,
    free: Sequence[str] = (),
) -> str:
    """Say which restrictions leave nothing reachable, and what is reachable without them.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete and checked.
    settings : WorkspaceSettings
        With which nothing is reachable.
    free : sequence of str
        Parameters that are not to be named, as those that a search varies.
    """
    asked = _Question(mechanism, parameters, settings)
    some = asked.without(frozenset())
    if some is not None:
        return f"too few samples, {some.poses.shape[1]} of {_POSES} poses are"
    every = asked.restrictions(free)
    for own in (True, False):
        alone = [r for r in every if r.own == own and asked.without(frozenset([r])) is not None]
        if alone:
            texts = [asked.say(r, frozenset([r])) for r in alone[:_NAMED]]
            if len(alone) == 1:
                return texts[0]
            return f"without one of these something is reachable: {'; or '.join(texts)}"
    dropped = frozenset(every)
    if asked.without(dropped) is None:
        return "no limit, domain or parameter alone explains it: the design itself reaches nothing"
    for r in reversed(every):
        if asked.without(dropped - {r}) is not None:
            dropped -= {r}
    texts = [asked.say(r, dropped) for r in every if r in dropped]
    return f"together they leave nothing: {'; and '.join(texts)}"


def require_reachable(
    reachable: int,
    mechanism: Mechanism,
    parameters: Parameters,
    settings: WorkspaceSettings,
    where: str,
    samples: int,
) -> None:
    """Raise where no pose of a sample is reachable, saying what rules all of them out.

    Raises
    ------
    InfeasibleError
    """
    if reachable == 0:
        raise nothing_reachable(mechanism, parameters, settings, where, samples)


def nothing_reachable(
    mechanism: Mechanism,
    parameters: Parameters,
    settings: WorkspaceSettings,
    where: str,
    samples: int | None = None,
) -> InfeasibleError:
    """Return the error for a workspace that is empty, or in which no sample was reachable."""
    sampled = make_sampler(mechanism, settings).design(parameters).box_volume > 0
    met = f"none of {samples} poses is" if samples and sampled else "nothing is"
    return InfeasibleError(f"{where}: {met} reachable: {explain(mechanism, parameters, settings)}")


def require_home(evaluator: Evaluator, design: Design) -> None:
    """Refuse a design whose home pose is out of reach: it has no home aspect.

    Raises
    ------
    InfeasibleError
    InputError
    """
    space = evaluator.space
    if not isinstance(evaluator, FieldEvaluator) or space.settings.aspect is None:
        return
    if design.box_volume == 0:
        raise nothing_reachable(space.mechanism, design.parameters, space.settings, "aspect")
    if evaluator.home(design)[1] == 0:
        home = space.mechanism.home(design.parameters)
        shown = ",".join(f"{k}={exact(v)}" for k, v in home.items())
        raise InputError(f"aspect: the home pose {shown} is not within reach and limits")
