"""What motors a workspace asks for, and where given motors suffice.

At a pose the platform is to move at some speed in any direction, to accelerate in any direction and
to press with some force in any direction, a payload on it. What a joint has to do at most follows
from its row of the inverse Jacobian R and of what efforts are linear in::

    rate   <= v |R_t| + w |R_r|
    effort <= |weight| + a |A_t| + e |A_r| + (quadratic in v, w) + F |B|
    A = R^-T M,   B = R^-T (dP/dX)^T

with the columns of translational and rotational coordinates apart: the bounds of a sum of two
independent directions. What is quadratic in the speeds (centrifugal and Coriolis terms) is bounded
by its largest eigenvalues; every other term is attained. Speeds of angular coordinates are the
rates of the pose's angles. With sizes of the platform itself (its centre's velocity, its angular
velocity) directions are those of its twists at the pose; see :mod:`pmopt.analysis.sizing.twists`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.dynamics import Mover, angular_motion
from pmopt.analysis.reads import INDEX, TOOL_NEEDS, WITH_MIN_LCI, Reads
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import MAX_SAMPLES, CapabilityWorkspace, WorkspaceSettings
from pmopt.analysis.sizing.twists import Motions
from pmopt.analysis.workspace.projection import reachable_poses, replicate
from pmopt.errors import InputError, unknown_name
from pmopt.inputs.quantities import QuantityError, as_quantity
from pmopt.mechanisms import find
from pmopt.mechanisms.bodies import Body, MassProperties
from pmopt.mechanisms.mechanism import Mechanism, Parameters, as_number
from pmopt.numerics import matrices
from pmopt.numerics.sequences import BLOCK
from pmopt.quantity import Quantity
from pmopt.units import METRES, ONE, effort_unit, unit_of

Values = NDArray[np.float64]

REPLICATES = 16
DEFAULT_SAMPLES = 1 << 16
SHARES = (0.5, 0.9, 0.95, 0.99)
#: Fields of a :class:`Task` that are plain sizes: of coordinates, of the platform, and the force.
_OF_COORDINATES = ("speed", "acceleration", "turn", "angular_acceleration")
_OF_PLATFORM = ("point_speed", "point_acceleration", "rotation_speed", "rotation_acceleration")
SIZES = (*_OF_COORDINATES, *_OF_PLATFORM, "force")
_LARGEST = 1e9
#: Poses of a replicate that are looked at at once.
_PART = 1 << 14
#: Poses whose demands are kept, at most; those of more are counted.
_MOST_KEPT = 1 << 21
#: Bits of the fraction that give a bin, octaves of bins, and the first bits of the lowest, 2**-40.
_BITS, _OCTAVES = 12, 100
_LOWEST = (1023 - 40) << _BITS
#: Settings of the workspace that change what is found.
READS = Reads(
    "capability",
    CapabilityWorkspace,
    {"tool": TOOL_NEEDS, **dict.fromkeys(INDEX, WITH_MIN_LCI)},
    "samples, seed and threads stand beside the settings",
)


@dataclass(frozen=True)
class Task:
    """What the platform is to do at every pose, in any direction.

    Sizes of coordinates and sizes of the platform exclude each other.

    Attributes
    ----------
    speed, acceleration : float
        Of the pose's translational coordinates, in the length unit per s and s^2: length of the
        vector of their rates.
    turn, angular_acceleration : float
        Of the pose's angular coordinates, rad/s and rad/s^2.
    force : float
        N, on the platform's centre.
    payload : MassProperties or None
    point_speed, point_acceleration : float
        Of the platform's centre in space, in any direction that it can move at a pose, what is
        parasitic included; in the length unit per s and s^2.
    rotation_speed, rotation_acceleration : float
        Of the platform about any axis that it can turn about, rad/s and rad/s^2. Accelerations are
        those that accelerations of the pose's coordinates add to what the speeds bring.
    """

    speed: float = 0.0
    acceleration: float = 0.0
    turn: float = 0.0
    angular_acceleration: float = 0.0
    force: float = 0.0
    payload: MassProperties | None = None
    point_speed: float = 0.0
    point_acceleration: float = 0.0
    rotation_speed: float = 0.0
    rotation_acceleration: float = 0.0

    def __post_init__(self) -> None:
        for name in SIZES:
            value = as_number(getattr(self, name))
            if value is None or not 0 <= value < _LARGEST:
                raise InputError(
                    f"capability: {name}={getattr(self, name)} is not allowed: a number from 0 to "
                    f"{_LARGEST:g} is needed"
                )
        mixed = [
            [k for k in group if getattr(self, k)] for group in (_OF_COORDINATES, _OF_PLATFORM)
        ]
        if all(mixed):
            raise InputError(
                f"capability: {mixed[0][0]} and {mixed[1][0]} exclude each other: one is of the "
                "pose's coordinates, the other of the platform"
            )

    def moved(self, mechanism: Mechanism) -> list[str]:
        """Say in words what each size moves."""
        names = {kind: ", ".join(c.name for c in mechanism.pose if c.kind == kind)
                 for kind in ("length", "angle")}  # fmt: skip
        found = []
        for kind, sizes in (("length", ("speed", "acceleration")),
                            ("angle", ("turn", "angular_acceleration"))):  # fmt: skip
            given = " and ".join(s.replace("_", " ") for s in sizes if getattr(self, s))
            if given:
                moves = f"of the vector of {names[kind]} in any direction"
                if "," not in names[kind]:
                    moves = f"of {names[kind] or 'none of the coordinates'} alone"
                found.append(f"{given}: {moves}")
        for what, sizes in (
            ("the centre in any direction that it can move", _OF_PLATFORM[:2]),
            ("about any axis that it can turn about", _OF_PLATFORM[2:]),
        ):
            given = " and ".join(s.replace("_", " ") for s in sizes if getattr(self, s))
            if given:
                found.append(f"{given}: {what}")
        for first, second, words in (
            ("point_speed", "rotation_speed", "speed"),
            ("point_acceleration", "rotation_acceleration", "acceleration"),
        ):
            sizes = getattr(self, first), getattr(self, second)
            if all(sizes):
                found.append(f"every motion with both {words}s within their sizes")
            elif any(sizes):
                found.append("with the least turning" if sizes[0] else "with the least motion of "
                             "the centre")  # fmt: skip
        return found


@dataclass(frozen=True)
class Demand:
    """What a joint is asked for over the workspace.

    Attributes
    ----------
    name, unit : str
        ``<joint>_rate`` or ``<joint>_effort``.
    limit : float or None
        What the motor has.
    levels : tuple of Quantity
        What is enough in each of :data:`SHARES` of the reachable volume. In all of it nothing is:
        next to singularities demands have no bound.
    volume : Quantity
        Where the limit is enough, of the mechanism's pose volume; NaN without one.
    """

    name: str
    unit: str
    limit: float | None
    levels: tuple[Quantity, ...]
    volume: Quantity


@dataclass(frozen=True)
class Capability(OfSubject):
    """Where the motors are strong and fast enough.

    Attributes
    ----------
    volume, capable, share : Quantity
        Reachable, within all limits, and the latter as a share.
    """

    task: Task
    volume: Quantity
    capable: Quantity
    share: Quantity
    demands: tuple[Demand, ...]
    samples: int
    reachable: int
    seed: int
    units: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""

        def finite(value: float) -> float | None:
            return value if math.isfinite(value) else None

        def pair(estimate: Quantity) -> dict[str, float | None]:
            return {"value": finite(estimate.value), "standard_error": finite(estimate.error)}

        payload = self.task.payload
        return {
            "mechanism": self.mechanism,
            "params": dict(self.params),
            "working_mode": self.working_mode,
            "task": {
                **{name: getattr(self.task, name) for name in SIZES},
                "payload": 0.0 if payload is None else payload.mass,
            },
            "moved": self.task.moved(find(self.mechanism)),
            "volume": pair(self.volume),
            "capable": pair(self.capable),
            "share": pair(self.share),
            "demands": [
                {
                    "name": demand.name,
                    "limit": demand.limit,
                    "needed": {str(s): pair(e) for s, e in zip(SHARES, demand.levels, strict=True)},
                    "volume": pair(demand.volume),
                }
                for demand in self.demands
            ],
            "samples": self.samples,
            "reachable": self.reachable,
            "seed": self.seed,
            "units": self.units,
        }


class Demands:
    """What the joints of one design are asked for at given poses."""

    def __init__(
        self,
        mechanism: Mechanism,
        parameters: Parameters,
        working_mode: str,
        task: Task,
        bodies: Sequence[Body] | None = None,
        threads: int | None = None,
        notify: Callable[[str], None] | None = None,
    ) -> None:
        own = mechanism.bodies(parameters) if bodies is None else tuple(bodies)
        if task.payload is not None:
            own = (*own, task.payload.body("payload", source="given"))
        self.mechanism = mechanism
        self.task = task
        self._length = mechanism.characteristic_length(parameters) * METRES[mechanism.length_unit]
        self._mover = Mover(mechanism, parameters, working_mode, own, None, threads, notify)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the demands: rates, then efforts."""
        joints = [c.name for c in self.mechanism.joints]
        return (*(f"{j}_rate" for j in joints), *(f"{j}_effort" for j in joints))

    @property
    def units(self) -> dict[str, str]:
        """Unit of each demand."""
        units = {}
        for c in self.mechanism.joints:
            units[f"{c.name}_rate"] = f"{self.mechanism.unit(c)}/s"
            units[f"{c.name}_effort"] = effort_unit(c.kind)
        return units

    def at(self, poses: Values) -> Values:
        """Return the demands at poses (d, N), shape (2 n, N); infinite at singular ones."""
        mover, task = self._mover, self.task
        mechanism = self.mechanism
        count, n = poses.shape[1], len(mechanism.joints)
        given = np.ascontiguousarray(poses.T)
        none = np.zeros_like(given)
        unit = mover.unit
        factor = mover.si(mechanism.pose)
        angular = np.array([c.kind == "angle" for c in mechanism.pose])
        sizes = [(~angular, task.speed * unit), (angular, task.turn)]
        rest = mover.state(given, none, none, masses=True)
        inverse = rest.inverse_jacobian
        known = np.isfinite(inverse).all(axis=(1, 2))
        transposed = np.full_like(inverse, np.nan)
        found = matrices.inverse(inverse[known]).transpose(0, 2, 1)
        transposed[known] = np.where(
            np.isfinite(found).all(axis=(1, 2), keepdims=True), found, np.nan
        )
        linear = matrices.product(transposed, rest.mass_matrix)
        rate = np.zeros((count, n))
        effort = np.abs(rest.efforts)
        for columns, size in sizes:
            rate += size * np.linalg.norm(inverse[:, :, columns], axis=2)
        for columns, size in (
            (~angular, task.acceleration * unit), (angular, task.angular_acceleration)
        ):  # fmt: skip
            effort = effort + size * np.linalg.norm(linear[:, :, columns], axis=2)
        if any(getattr(task, k) for k in ("speed", "turn", "force", *_OF_PLATFORM)):
            form, places, turns = self._quadratic(given, rest.efforts, factor)
            effort = effort + _largest(form, sizes)
            speeds, changes = (
                Motions(places, turns, moved * unit, turned, self._length)
                for moved, turned in (
                    (task.point_speed, task.rotation_speed),
                    (task.point_acceleration, task.rotation_acceleration),
                )
            )
            rate = rate + speeds.most(inverse)
            effort = effort + speeds.most_quadratic(form) + changes.most(linear)
            pressed = matrices.product(transposed, places.transpose(0, 2, 1))
            effort = effort + task.force * np.linalg.norm(pressed, axis=2)
        rate = rate / mover.si(mechanism.joints)
        found = np.concatenate([rate, effort], axis=1).T
        return np.where(np.isfinite(found), found, np.inf)

    def _quadratic(
        self, poses: Values, weight: Values, factor: Values
    ) -> tuple[Values, Values, Values]:
        """Return efforts as quadratic forms of the pose's rates, and how the platform moves.

        From the efforts at unit rates: each alone, and each pair together.

        Returns
        -------
        form : (N, n, d, d) float64
        places, turns : (N, 3, d) float64
            Velocity of the platform's centre and angular velocity at unit rates; 0 if not known.
        """
        mover = self._mover
        count, d = poses.shape
        n = weight.shape[1]
        none = np.zeros_like(poses)
        form = np.empty((count, n, d, d))
        places, turns = np.empty((count, 3, d)), np.empty((count, 3, d))

        def asked(*which: int) -> Values:
            rates = none.copy()
            rates[:, list(which)] = 1.0 / factor[list(which)]
            state = mover.state(poses, rates, none)
            if len(which) == 1:
                places[:, :, which[0]] = state.platform[:, 1, :3]
                turns[:, :, which[0]] = angular_motion(state.platform)[:, 0]
            return state.efforts - weight

        for i in range(d):
            form[:, :, i, i] = asked(i)
        for i in range(d):
            for j in range(i):
                both = (asked(i, j) - form[:, :, i, i] - form[:, :, j, j]) / 2
                form[:, :, i, j] = form[:, :, j, i] = both
        return form, np.nan_to_num(places), np.nan_to_num(turns)


def _largest(form: Values, sizes: list[tuple[NDArray[np.bool_], float]]) -> Values:
    """Bound |x^T C x| over vectors whose two parts have at most the given lengths."""
    (first, v), (second, w) = sizes
    bound = np.zeros(form.shape[:2])
    finite = np.where(np.isfinite(form), form, 0.0)
    for part, size in sizes:
        if part.any() and size:
            block = finite[:, :, part][:, :, :, part]
            bound += size * size * np.abs(matrices.eigen(block)[0]).max(axis=2)
    if first.any() and second.any() and v and w:
        block = finite[:, :, first][:, :, :, second]
        bound += 2 * v * w * matrices.singular_values(block)[..., 0]
    return bound


def check_limits(mechanism: Mechanism, limits: Mapping[str, Any], where: str) -> dict[str, float]:
    """Return the limits of rates and efforts by name, checked.

    Raises
    ------
    InputError
    """
    allowed = [f"{c.name}_{what}" for what in ("rate", "effort") for c in mechanism.joints]
    checked = {}
    for name, value in limits.items():
        if name not in allowed:
            raise unknown_name(where, name, allowed)
        unit = mechanism.unit_named(name) or ONE
        try:
            number, reason = as_quantity(value, unit), ""
        except QuantityError as error:
            number, reason = math.nan, f"{error}; "
        if not number > 0:
            raise InputError(
                f"{where}: {name}={value} is not allowed: {reason}a number > 0 in {unit} is needed"
            )
        checked[name] = number
    return checked


def check_payload(mass: float, centre: Sequence[float], where: str) -> None:
    """Refuse a place of a payload without mass, which changes nothing.

    Raises
    ------
    InputError
    """
    if not mass and any(centre):
        raise InputError(f"{where}={list(centre)} is read together with a payload only")


def compute_capability(
    mechanism: Mechanism,
    parameters: Parameters,
    settings: WorkspaceSettings,
    task: Task,
    limits: Mapping[str, Any],
    *,
    bodies: Sequence[Body] | None = None,
    samples: int = DEFAULT_SAMPLES,
    seed: int = 1,
    threads: int | None = None,
    notify: Callable[[str], None] | None = None,
) -> Capability:
    """Sample what the joints are asked for, and the region where limits suffice.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete and checked.
    settings : WorkspaceSettings
        Domain, limits and working mode of the workspace; :data:`READS` lists what is read.
    task : Task
    limits : mapping
        ``<joint>_rate`` (length unit/s, rad/s) and ``<joint>_effort`` (N, N m), each a size; those
        left out are not limited.
    samples : int
        In all replicates, rounded up to whole blocks. Beyond two millions demands are not kept but
        counted in fine steps: memory does not grow, and the steps are in the errors.

    Raises
    ------
    InputError
        For settings that are not read, unknown names and values out of range.
    """
    READS.check(settings)
    if not (isinstance(samples, int) and 16 <= samples <= MAX_SAMPLES):
        raise InputError(
            f"capability: samples={samples} is not allowed: a whole number from 16 to "
            f"{MAX_SAMPLES} is needed"
        )
    given = check_limits(mechanism, limits, "capability")
    mode = mechanism.check_mode(settings.working_mode)
    sampler = make_sampler(mechanism, settings, seed, threads, notify, where="capability")
    asked = Demands(mechanism, parameters, mode, task, bodies, threads, notify)
    design = sampler.design(parameters)
    points = sampler.sequence(REPLICATES)
    count = max(1, math.ceil(samples / REPLICATES / BLOCK)) * BLOCK
    bounds = np.array([given.get(name, math.inf) for name in asked.names])
    kept: type[_Exact] | type[_Binned] = _Exact if REPLICATES * count <= _MOST_KEPT else _Binned
    joined = kept(len(bounds))
    met: list[int] = []
    capable_met: list[int] = []
    enough_met: list[NDArray[np.int64]] = []
    each: list[Values] = []
    for r in range(REPLICATES):
        one = kept(len(bounds))
        reached, within, enough = 0, 0, np.zeros(len(bounds), dtype=np.int64)
        for first in range(0, count, _PART):
            last = min(first + _PART, count)
            poses, _ = reachable_poses(sampler.evaluator, design, replicate(points, r), first, last)
            values = asked.at(poses)
            kept_here = values <= bounds[:, None]
            reached += values.shape[1]
            within += int(kept_here.all(axis=0).sum())
            enough += kept_here.sum(axis=1)
            one.add(values)
        met.append(reached)
        capable_met.append(within)
        enough_met.append(enough)
        if reached:
            each.append(one.levels())
        joined.join(one)
    part = design.box_volume / count
    whole = [part * number for number in met]
    capable = [part * number for number in capable_met]
    total_levels = joined.levels() if sum(met) else np.full((len(bounds), len(SHARES)), math.nan)
    demands, unit = [], mechanism.volume_unit
    for k, name in enumerate(asked.names):
        levels = []
        for j in range(len(SHARES)):
            value = float(total_levels[k, j])
            error = _error([float(found[k, j]) for found in each], value)
            error = math.hypot(error, kept.resolution * abs(value)) if error > 0 else error
            levels.append(Quantity(value, error, asked.units[name]))
        volume = Quantity(math.nan, math.nan, unit)
        if name in given:
            volume = _mean([part * int(numbers[k]) for numbers in enough_met], part, unit)
        demands.append(Demand(name, asked.units[name], given.get(name), tuple(levels), volume))
    length = unit_of("length", mechanism.length_unit)
    units = {
        **asked.units,
        **{p.name: mechanism.unit(p) for p in mechanism.parameters},
        "volume": mechanism.volume_unit,
        "capable": mechanism.volume_unit,
        "share": "1",
        **dict.fromkeys(("speed", "point_speed"), f"{length}/s"),
        **dict.fromkeys(("acceleration", "point_acceleration"), f"{length}/s^2"),
        **dict.fromkeys(("turn", "rotation_speed"), "rad/s"),
        **dict.fromkeys(("angular_acceleration", "rotation_acceleration"), "rad/s^2"),
        "force": "N",
        "payload": "kg",
    }
    shares = [c / w for c, w in zip(capable, whole, strict=True) if w]
    total, reachable = sum(whole), sum(met)
    part_kept = Quantity(math.nan, math.nan)
    if reachable:
        value = sum(capable) / total
        part_kept = Quantity(value, max(_error(shares, value), 1 / reachable))
    return Capability(
        subject=sampler.space.subject(design),
        task=task,
        volume=_mean(whole, part, unit),
        capable=_mean(capable, part, unit),
        share=part_kept,
        demands=tuple(demands),
        samples=REPLICATES * count,
        reachable=reachable,
        seed=seed,
        units=units,
    )


class _Exact:
    """Demands of some poses, all of them kept."""

    resolution = 0.0

    def __init__(self, size: int) -> None:
        self._parts: list[Values] = [np.empty((size, 0))]

    def add(self, values: Values) -> None:
        """Take demands (2 n, N)."""
        self._parts.append(values)

    def join(self, other: Any) -> None:
        """Take those of another one."""
        self._parts += other._parts

    def levels(self) -> Values:
        """Return the quantiles (2 n, s) at :data:`SHARES`."""
        return np.array(
            [
                [float(np.quantile(np.concatenate([p[k] for p in self._parts]), s)) for s in SHARES]
                for k in range(len(self._parts[0]))
            ]
        )


class _Binned:
    """Demands of any number of poses, counted in bins an equal share of their size wide.

    A bin is what the first bits of a double give: its exponent and ``_BITS`` bits of its fraction.
    """

    #: Half the width of a bin over its place, at most.
    resolution = 2.0 ** -(_BITS + 1)

    def __init__(self, size: int) -> None:
        self._counts = np.zeros((size, _OCTAVES << _BITS), dtype=np.int64)
        self._least, self._most = np.full(size, np.inf), np.zeros(size)

    def add(self, values: Values) -> None:
        """Take demands (2 n, N), none of them below 0."""
        if values.shape[1] == 0:
            return
        first = np.ascontiguousarray(values).view(np.int64) >> (52 - _BITS)
        bins = np.clip(first - _LOWEST, 0, self._counts.shape[1] - 1)
        for counts, found in zip(self._counts, bins, strict=True):
            np.add(counts, np.bincount(found, minlength=len(counts)), out=counts)
        np.minimum(self._least, values.min(axis=1), out=self._least)
        np.maximum(self._most, values.max(axis=1), out=self._most)

    def join(self, other: Any) -> None:
        """Take those of another one."""
        self._counts += other._counts
        np.minimum(self._least, other._least, out=self._least)
        np.maximum(self._most, other._most, out=self._most)

    def levels(self) -> Values:
        """Return the quantiles (2 n, s) at :data:`SHARES`, interpolated within bins."""
        ends = (np.arange((_OCTAVES << _BITS) + 1) + _LOWEST) << (52 - _BITS)
        edges = ends.view(np.float64).copy()
        edges[0], edges[-1] = 0.0, np.inf
        found = np.empty((len(self._counts), len(SHARES)))
        for k, counts in enumerate(self._counts):
            sums = np.cumsum(counts)
            for j, share in enumerate(SHARES):
                rank = share * float(sums[-1] - 1)
                place = int(np.searchsorted(sums, rank, side="right"))
                within = (rank - float(sums[place] - counts[place]) + 0.5) / float(counts[place])
                low, high = edges[place], edges[place + 1]
                value = np.inf if np.isinf(high) else low + min(within, 1.0) * (high - low)
                found[k, j] = min(max(value, self._least[k]), self._most[k])
        return found


def _error(values: Sequence[float], pooled: float) -> float:
    """Return the standard error of the pooled value of all replicates, from the value of each.

    That of their mean, raised by what an error from few replicates misses (the standard deviation
    of Student's t), and how far the mean is from the pooled value: quantiles of few points are
    biased.
    """
    finite = np.array(values)
    count = len(finite)
    if count < 4 or not np.isfinite([*finite, pooled]).all():
        return math.nan
    spread = float(finite.std(ddof=1)) * math.sqrt((count - 1) / (count - 3) / count)
    error = math.hypot(spread, float(finite.mean()) - pooled)
    # What is the same everywhere differs by rounding.
    return error if error > 1e-12 * np.abs(finite).max() else 0.0


def _mean(values: Sequence[float], point: float, unit: str) -> Quantity:
    """Return the mean of volumes; its error is at least one point, the sample's resolution."""
    value = float(np.mean(values))
    return Quantity(value, max(_error(values, value), point / len(values)), unit)
