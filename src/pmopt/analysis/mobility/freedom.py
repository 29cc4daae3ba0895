"""Mobility from declared limbs: freedoms, constraints, loops and the full cycle.

Screw theory at one configuration, then finite motion of the same joints. Nothing is taken from a
mechanism but the kinds, axes and points of its joints.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pmopt.analysis.mobility import closed_form, screws
from pmopt.analysis.mobility.closed_form import Agreement
from pmopt.analysis.mobility.finite_motion import Assembly, platform_twists
from pmopt.analysis.mobility.screws import Screw
from pmopt.analysis.record import OfSubject, Subject
from pmopt.errors import InputError, UnreachableError, unknown_name
from pmopt.mechanisms.mechanism import Chain, Matrix, Mechanism, Vector
from pmopt.seeds import seed_sequence

#: The name of a mechanism's own layout.
DECLARED = "declared"
DEFAULT_SAMPLES = 20
#: Steps of a random walk between home and a sample, and their mean length.
_WALK, _STRIDE = 6, 0.12
#: Poses at which the closed form is compared with the joints.
_COMPARED = 5


@dataclass(frozen=True)
class Characteristic:
    """Position and orientation characteristic: independent translations and rotations."""

    translations: int
    rotations: int

    @classmethod
    def of(cls, space: Matrix) -> Characteristic:
        """Return the characteristic of a space of twists.

        Rotations are the rank of its angular velocities, translations the rest.
        """
        turning = screws.rank(space[:3]) if space.shape[1] else 0
        return cls(screws.rank(space) - turning, turning)

    @property
    def kind(self) -> str:
        """The freedoms as usual: 3T, 1T2R, 3R1T; three rotations come before fewer translations."""
        parts = [f"{self.translations}T"] * bool(self.translations)
        parts.insert(
            0 if self.rotations == 3 > self.translations else len(parts),
            f"{self.rotations}R" * bool(self.rotations),
        )
        return "".join(parts) or "0"

    def to_dict(self) -> dict[str, int]:
        """Return the JSON form."""
        return {"t": self.translations, "r": self.rotations}

    def __str__(self) -> str:
        return f"t{self.translations} r{self.rotations}"


@dataclass(frozen=True)
class LimbSystem:
    """A limb's twist system and the wrench system reciprocal to it."""

    name: str
    joints: str
    freedoms: int
    poc: Characteristic
    twists: tuple[Screw, ...]
    wrenches: tuple[Screw, ...]


@dataclass(frozen=True)
class Loop:
    """An independent loop: the open chain that closes it.

    Attributes
    ----------
    chain : str
        Names of its limbs.
    freedoms, driven : int
        Sum of its joints' freedoms without local ones, and how many of them are actuated.
    equations : int
        Independent displacement equations: the dimension of the union of the twists it joins.
    """

    chain: str
    freedoms: int
    driven: int
    equations: int

    @property
    def degree(self) -> int:
        """Constraint degree of the open chain."""
        return self.freedoms - self.driven - self.equations


@dataclass(frozen=True)
class Decomposition:
    """Single open chains in the order that couples them least.

    ``guide`` is the limb whose motion group the loops are closed in; "" for whole limbs.
    """

    guide: str
    loops: tuple[Loop, ...]

    @property
    def coupling(self) -> float | None:
        """k, half the sum of |constraint degrees|; None where the drives do not fit."""
        degrees = [loop.degree for loop in self.loops]
        return None if sum(degrees) else sum(map(abs, degrees)) / 2

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "guide": self.guide or None,
            "coupling_degree": _whole(self.coupling),
            "loops": [
                {
                    "chain": x.chain,
                    "freedoms": x.freedoms,
                    "driven": x.driven,
                    "equations": x.equations,
                    "constraint_degree": x.degree,
                }
                for x in self.loops
            ],
        }


@dataclass(frozen=True)
class Gruebler:
    """d (n - g - 1) + sum_f + v: n bodies with the base, g joints, v redundant constraints."""

    d: int
    n: int
    g: int
    sum_f: int
    v: int = 0

    @property
    def mobility(self) -> int:
        """M."""
        return self.d * (self.n - self.g - 1) + self.sum_f + self.v

    def to_dict(self) -> dict[str, int]:
        """Return the JSON form."""
        return {
            "d": self.d,
            "n": self.n,
            "g": self.g,
            "sum_f": self.sum_f,
            "v": self.v,
            "M": self.mobility,
        }

    def __str__(self) -> str:
        tail = f" + {self.v}" if self.v else ""
        return f"{self.d} ({self.n} - {self.g} - 1) + {self.sum_f}{tail} = {self.mobility}"


@dataclass(frozen=True)
class FullCycle:
    """What remains of the freedoms in finite motion.

    Attributes
    ----------
    freedom : int
        Least number of freedoms at the samples that a projected step really keeps.
    samples : int
    kept_at_home : int
        Freedoms of the first configuration that survive a step.
    instantaneous : tuple of int
        Least and most platform freedoms at the samples.
    kinds : dict
        How many samples have which kind of freedoms.
    travel : float
        Largest rotation (rad) or shift (characteristic lengths) of the platform from home.
    """

    freedom: int
    samples: int
    kept_at_home: int
    instantaneous: tuple[int, int]
    kinds: dict[str, int]
    travel: float

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "freedom": self.freedom,
            "samples": self.samples,
            "kept_at_home": self.kept_at_home,
            "instantaneous": list(self.instantaneous),
            "kinds": self.kinds,
            "travel": self.travel,
        }


@dataclass(frozen=True)
class MobilityResult(OfSubject):
    """All that the declared joints say about a mechanism's mobility.

    ``local_freedoms`` move limbs while the platform rests; ``rank_gap`` is the least singular
    value kept and the largest dropped where the platform's freedoms were counted.
    """

    layout: str
    layout_note: str
    pose: dict[str, float] | None
    characteristic_length: float
    freedom: int
    poc: Characteristic
    freedoms: tuple[Screw, ...]
    constraints: tuple[Screw, ...]
    common_constraints: tuple[Screw, ...]
    redundant_constraints: int
    local_freedoms: int
    kutzbach_gruebler: Gruebler
    gruebler: Gruebler
    gruebler_revolutes: Gruebler
    declared_order: Decomposition
    whole_limbs: Decomposition
    decomposition: Decomposition
    limbs: tuple[LimbSystem, ...]
    rank_gap: tuple[float, float]
    full_cycle: FullCycle
    closed_form: Agreement | None
    units: dict[str, str]

    @property
    def working_mode(self) -> str | None:  # type: ignore[override]  # of some layouts there is none
        """The working mode, None of a layout that has one pose, its own."""
        return self.subject.working_mode or None

    @property
    def kind(self) -> str:
        """The kind of the freedoms, e.g. 1T2R."""
        return self.poc.kind

    @property
    def coupling_degree(self) -> int | float | None:
        """Coupling degree of the least coupled decomposition."""
        return _whole(self.decomposition.coupling)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        unit = self.length_unit

        def shown(group: tuple[Screw, ...]) -> list[dict[str, Any]]:
            return [screw.to_dict(unit) for screw in group]

        kept, dropped = self.rank_gap
        return {
            "mechanism": self.mechanism,
            "layout": self.layout,
            "params": self.params,
            "pose": self.pose,
            "working_mode": self.working_mode,
            "freedom": self.freedom,
            "kind": self.kind,
            "poc": self.poc.to_dict(),
            "freedoms": shown(self.freedoms),
            "constraints": shown(self.constraints),
            "common_constraints": shown(self.common_constraints),
            "redundant_constraints": self.redundant_constraints,
            "local_freedoms": self.local_freedoms,
            "full_cycle": self.full_cycle.to_dict(),
            "kutzbach_gruebler": self.kutzbach_gruebler.to_dict(),
            "gruebler": self.gruebler.to_dict(),
            "gruebler_revolutes": self.gruebler_revolutes.to_dict(),
            "coupling_degree": self.coupling_degree,
            "coupling": {
                "declared_order": self.declared_order.to_dict(),
                "whole_limbs": self.whole_limbs.to_dict(),
                "least": self.decomposition.to_dict(),
            },
            "limbs": [
                {
                    "name": limb.name,
                    "joints": limb.joints,
                    "freedoms": limb.freedoms,
                    "poc": limb.poc.to_dict(),
                    "twists": shown(limb.twists),
                    "wrenches": shown(limb.wrenches),
                }
                for limb in self.limbs
            ],
            "rank_gap": {"kept": kept if np.isfinite(kept) else None, "dropped": dropped},
            "closed_form": None if self.closed_form is None else self.closed_form.to_dict(),
            "characteristic_length": self.characteristic_length,
            "units": self.units,
        }


def _whole(value: float | None) -> int | float | None:
    return int(value) if value is not None and value == int(value) else value


def mobility_of(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None = None,
    *,
    layout: str | None = None,
    pose: Mapping[str, Any] | None = None,
    working_mode: str | None = None,
    samples: int = DEFAULT_SAMPLES,
    seed: int = 1,
    where: str = "pose",
) -> MobilityResult:
    """Analyse the mobility of a mechanism from its declared joints.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    layout : str, optional
        ``"declared"`` or another of the mechanism's layouts.
    pose : mapping, optional
        Where it is analysed; the declared home by default. Other layouts have one pose.
    working_mode : str, optional
    samples : int
        Random assembled configurations of the full-cycle check.
    seed : int
    where : str
        What errors call the pose.

    Raises
    ------
    InputError
        For unknown names and a pose out of reach.
    """
    parameters = mechanism.resolve(params or {})
    name = layout or DECLARED
    if name not in (DECLARED, *mechanism.layouts):
        raise unknown_name("layout", name, (DECLARED, *mechanism.layouts))
    if samples < 1:
        raise InputError(f"samples={samples} is not allowed: at least 1 is needed")
    length = mechanism.characteristic_length(parameters)
    at: dict[str, float] | None = None
    mode: str | None = None
    if name == DECLARED:
        mode = mechanism.check_mode(working_mode)
        at = (
            mechanism.home(parameters)
            if pose is None
            else mechanism.check_coordinates(pose, mechanism.pose, where)
        )
        if all(s.working_mode != mode for s in mechanism.inverse(parameters, at)):
            shown = ",".join(f"{k}={v!r}" for k, v in at.items())
            raise UnreachableError(f"{where}: {shown} is out of reach in working mode {mode}")
        chains = mechanism.layout(parameters, at, mode)
        centre = mechanism.platform(parameters, at, mode)[1]
        note = "at home" if pose is None else "at the pose given"
    else:
        for given, option in ((pose, where), (working_mode, "working mode")):
            if given is not None:
                raise InputError(f"{option}: layout {name!r} has one pose, its own")
        chains = mechanism.alternative_layout(parameters, name)
        # The centre of what the limbs' last joints hold.
        centre = np.mean([c.joints[-1].point for c in chains], axis=0)
        note = mechanism.layouts[name]
    agreement = None
    if name == DECLARED and mode is not None:
        rng = np.random.default_rng(seed_sequence(seed, "mobility, closed form"))
        agreement = closed_form.compare(mechanism, parameters, mode, _COMPARED, rng)
    facts = analyse(chains, np.asarray(centre, dtype=float), length, samples, seed)
    return MobilityResult(
        subject=Subject.of(mechanism, parameters, mode, {k: (v, v) for k, v in (at or {}).items()}),
        layout=name,
        layout_note=note,
        pose=at,
        characteristic_length=length,
        closed_form=agreement,
        units=_result_units(mechanism),
        **facts,
    )


def _result_units(mechanism: Mechanism) -> dict[str, str]:
    """Return the units of a result; a coordinate called pitch leaves the screws' another name."""
    unit = mechanism.length_unit
    named = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    named |= {c.name: mechanism.unit(c) for c in mechanism.pose}
    return named | {
        "characteristic_length": unit,
        "point": unit,
        "screw pitch" if "pitch" in named else "pitch": (
            f"{unit}/rad for twists, {unit} for wrenches"
        ),
        "travel": "rad or characteristic lengths",
        "misfit": "characteristic lengths",
    }


def analyse(
    chains: Sequence[Chain],
    centre: Vector,
    length: float,
    samples: int = DEFAULT_SAMPLES,
    seed: int = 1,
) -> dict[str, Any]:
    """Return what limbs that meet in one platform say, as fields of :class:`MobilityResult`.

    Parameters
    ----------
    chains : sequence of Chain
        At a configuration in which they meet.
    centre : (3,) float64
        Of the platform.
    length : float
        Lengths are divided by it before ranks are counted.
    samples, seed : int
        Of the full-cycle check.
    """
    limbs = tuple(screws.scaled(chain, centre, length) for chain in chains)
    spaces = [screws.limb_twists(limb) for limb in limbs]
    wrenches = [screws.reciprocal(space) for space in spaces]
    marks = [joint.point for limb in limbs for joint in limb.joints if joint.kind in "US"]

    def shown(space: Matrix, is_twist: bool, near: list[Vector] | None = None) -> tuple[Screw, ...]:
        return screws.readable(space, is_twist, centre, length, near or marks)

    twists = platform_twists(limbs)
    common = screws.intersection(*wrenches)
    sum_f = sum(space.shape[1] for space in spaces)
    g = sum(len(limb.joints) for limb in limbs)
    n = g - len(limbs) + 2
    closure = Assembly.of(limbs).closure()
    loops = len(limbs) - 1
    redundant = 6 * loops - (screws.rank(closure) if loops else 0)
    d = 6 - common.shape[1]
    parallelograms = sum(joint.kind == "Pa" for limb in limbs for joint in limb.joints)
    declared, whole, least = _decompositions(limbs)
    return {
        "freedom": twists.shape[1],
        "poc": Characteristic.of(twists),
        "freedoms": shown(twists, True),
        "constraints": shown(screws.span(np.hstack(wrenches)), False),
        "common_constraints": shown(common, False),
        "redundant_constraints": redundant,
        "local_freedoms": sum(space.shape[1] - screws.rank(space) for space in spaces),
        "kutzbach_gruebler": Gruebler(d, n, g, sum_f, redundant - common.shape[1] * loops),
        "gruebler": Gruebler(6, n, g, sum_f),
        # A parallelogram is four bodies in a loop of four revolute joints.
        "gruebler_revolutes": Gruebler(
            6, n + 2 * parallelograms, g + 3 * parallelograms, sum_f + 3 * parallelograms
        ),
        "declared_order": declared,
        "whole_limbs": whole,
        "decomposition": least,
        "limbs": tuple(
            LimbSystem(
                name=limb.name,
                joints="".join("P_a" if j.kind == "Pa" else j.kind for j in limb.joints),
                freedoms=space.shape[1],
                poc=Characteristic.of(space),
                twists=tuple(
                    screw
                    for k in _independent(space)
                    for screw in shown(space[:, [k]], True, [j.point for j in limb.joints])
                ),
                wrenches=shown(own, False, [j.point for j in limb.joints]),
            )
            for limb, space, own in zip(limbs, spaces, wrenches, strict=True)
        ),
        "rank_gap": screws.gap(np.hstack(wrenches)),
        "full_cycle": _full_cycle(limbs, samples, seed),
    }  # fmt: skip


def _independent(space: Matrix) -> list[int]:
    """Return the columns that do not depend on those before them."""
    kept: list[int] = []
    for k in range(space.shape[1]):
        if screws.rank(space[:, [*kept, k]]) > len(kept):
            kept.append(k)
    return kept


# -- single open chains ----------------------------------------------------------------------


def _decompositions(limbs: Sequence[Chain]) -> tuple[Decomposition, Decomposition, Decomposition]:
    """Return the limbs as declared, their least coupled order, and the least coupled one at all.

    Limbs are added one by one: loop j takes dim(intersection of the limbs so far, joined with
    the next limb's twists) displacement equations, and the constraint degree of the chain that
    closes it is its freedoms less its drives less these. k = min sum |degree| / 2.

    A limb whose locked joints generate a motion group (a slider, a plane, a sphere) guides the
    platform: with its drive known the others need to be closed within that group only, by the
    freedoms they have in it. That is how such a mechanism is solved by hand.
    """
    drives = [len(screws.drive_columns(limb)) for limb in limbs]
    spaces = [screws.span(screws.limb_twists(limb)) for limb in limbs]
    freedoms = [space.shape[1] for space in spaces]
    names = [limb.name for limb in limbs]
    declared = Decomposition("", _loops(range(len(limbs)), names, spaces, freedoms, drives))
    whole = Decomposition("", _least_coupled(names, spaces, freedoms, drives))
    best = whole
    if whole.coupling is None:
        return declared, whole, whole
    for k, limb in enumerate(limbs):
        group = screws.span(screws.locked_twists(limb))
        others = [i for i in range(len(limbs)) if i != k]
        if len(others) < 2 or not group.shape[1] or not _is_group(limb, group):
            continue
        inner = [screws.intersection(screws.locked_twists(limbs[i]), group) for i in others]
        sizes = [space.shape[1] for space in inner]
        chains = _least_coupled([names[i] for i in others], inner, sizes, [0] * len(others))
        guided = Decomposition(limb.name, chains)
        if guided.coupling is not None and guided.coupling < (best.coupling or 0.0):
            best = guided
    return declared, whole, best


def _least_coupled(
    names: list[str], spaces: list[Matrix], freedoms: list[int], drives: list[int]
) -> tuple[Loop, ...]:
    """Return the loops of the order of least coupling; of equal ones, of the least degree."""

    def score(loops: tuple[Loop, ...]) -> tuple[int, int]:
        degrees = [abs(loop.degree) for loop in loops]
        return sum(degrees), max(degrees, default=0)

    orders = itertools.permutations(range(len(names)))
    return min(
        (
            _loops(order, names, spaces, freedoms, drives)
            for order in orders
            if len(order) < 2 or order[0] < order[1]  # the first two limbs make one loop
        ),
        key=score,
    )


def _loops(
    order: Sequence[int],
    names: list[str],
    spaces: list[Matrix],
    freedoms: list[int],
    drives: list[int],
) -> tuple[Loop, ...]:
    loops: list[Loop] = []
    reached = spaces[order[0]]
    for j, k in enumerate(order[1:]):
        members = (order[0], k) if j == 0 else (k,)
        loops.append(
            Loop(
                " - ".join(names[i] for i in members),
                sum(freedoms[i] for i in members),
                sum(drives[i] for i in members),
                screws.rank(np.hstack([reached, spaces[k]])),
            )
        )
        reached = screws.intersection(reached, spaces[k])
    return tuple(loops)


def _is_group(limb: Chain, group: Matrix) -> bool:
    """Return whether a locked limb generates a group: closed under brackets, and as it moves."""
    brackets = [
        np.concatenate(
            [np.cross(a[:3], b[:3]), np.cross(a[:3], b[3:]) + np.cross(a[3:], b[:3])]
        )
        for a, b in itertools.combinations(group.T, 2)
    ]  # fmt: skip
    if screws.rank(np.column_stack([group, *brackets])) > group.shape[1]:
        return False
    driven = set(screws.drive_columns(limb).values())
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = rng.uniform(-0.5, 0.5, screws.freedoms(limb))
        q[list(driven)] = 0.0
        moved = screws.locked_twists(screws.move(limb, q)[0])
        if screws.distance(moved, group) > 1e-9:
            return False
    return True


# -- full cycle ------------------------------------------------------------------------------


def _full_cycle(limbs: Sequence[Chain], samples: int, seed: int) -> FullCycle:
    """Walk from home at random, each step projected back on closure, and count again."""
    home = Assembly.of(limbs)
    rng = np.random.default_rng(seed_sequence(seed, "mobility, full cycle"))
    kept_at_home = home.kept(rng)
    kept = kept_at_home
    counts, kinds, travel = [], [], 0.0
    for _ in range(samples):
        there = home.walked(rng, _WALK, _STRIDE)
        twists = there.freedom()
        counts.append(twists.shape[1])
        kinds.append(Characteristic.of(twists).kind)
        kept = min(kept, there.kept(rng))
        travel = max(travel, float(np.abs(screws.small(there.ends[0])).max()))
    return FullCycle(
        freedom=min(kept, *counts),
        samples=samples,
        kept_at_home=kept_at_home,
        instantaneous=(min(counts), max(counts)),
        kinds={kind: kinds.count(kind) for kind in sorted(set(kinds))},
        travel=travel,
    )
