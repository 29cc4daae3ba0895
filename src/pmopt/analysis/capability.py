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
rates of the pose's angles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.dynamics import Mover
from pmopt.analysis.estimates import Estimate
from pmopt.analysis.projection import reachable_poses, replicate
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sweeper import Sweeper
from pmopt.errors import InputError, unknown_name
from pmopt.inputs.quantities import QuantityError, as_quantity
from pmopt.mechanisms.base import Mechanism, Parameters
from pmopt.mechanisms.bodies import Body, MassProperties
from pmopt.numerics.sequences import BLOCK
from pmopt.units import ONE, effort_unit, unit_of

Values = NDArray[np.float64]

REPLICATES = 16
DEFAULT_SAMPLES = 1 << 16
SHARES = (0.5, 0.9, 0.95, 0.99)


@dataclass(frozen=True)
class Task:
    """What the platform is to do at every pose, in any direction.

    Attributes
    ----------
    speed, acceleration : float
        Of translational coordinates, in the length unit per s and s^2.
    turn, angular_acceleration : float
        Of angular coordinates, rad/s and rad/s^2.
    force : float
        N, on the platform's centre.
    payload : MassProperties or None
    """

    speed: float = 0.0
    acceleration: float = 0.0
    turn: float = 0.0
    angular_acceleration: float = 0.0
    force: float = 0.0
    payload: MassProperties | None = None


@dataclass(frozen=True)
class Demand:
    """What a joint is asked for over the workspace.

    Attributes
    ----------
    name, unit : str
        ``<joint>_rate`` or ``<joint>_effort``.
    limit : float or None
        What the motor has.
    levels : tuple of Estimate
        What is enough in each of :data:`SHARES` of the reachable volume. In all of it nothing is:
        next to singularities demands have no bound.
    volume : Estimate
        Where the limit is enough, of the mechanism's pose volume; NaN without one.
    """

    name: str
    unit: str
    limit: float | None
    levels: tuple[Estimate, ...]
    volume: Estimate


@dataclass(frozen=True)
class Capability:
    """Where the motors are strong and fast enough.

    Attributes
    ----------
    volume, capable, share : Estimate
        Reachable, within all limits, and the latter as a share.
    """

    mechanism: str
    params: Parameters
    working_mode: str
    task: Task
    volume: Estimate
    capable: Estimate
    share: Estimate
    demands: tuple[Demand, ...]
    samples: int
    reachable: int
    seed: int
    units: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""

        def finite(value: float) -> float | None:
            return value if math.isfinite(value) else None

        def told(estimate: Estimate) -> dict[str, float | None]:
            return {"value": finite(estimate.value), "standard_error": finite(estimate.error)}

        payload = self.task.payload
        return {
            "mechanism": self.mechanism,
            "params": dict(self.params),
            "working_mode": self.working_mode,
            "task": {
                "speed": self.task.speed,
                "acceleration": self.task.acceleration,
                "turn": self.task.turn,
                "angular_acceleration": self.task.angular_acceleration,
                "force": self.task.force,
                "payload": 0.0 if payload is None else payload.mass,
            },
            "volume": told(self.volume),
            "capable": told(self.capable),
            "share": told(self.share),
            "demands": [
                {
                    "name": demand.name,
                    "limit": demand.limit,
                    "needed": {str(s): told(e) for s, e in zip(SHARES, demand.levels, strict=True)},
                    "volume": told(demand.volume),
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
        with np.errstate(over="ignore"):
            try:
                transposed[known] = np.linalg.inv(inverse[known]).transpose(0, 2, 1)
            except np.linalg.LinAlgError:
                condition = np.linalg.cond(inverse[known])
                kept = np.flatnonzero(known)[condition < 1e15]
                transposed[kept] = np.linalg.inv(inverse[kept]).transpose(0, 2, 1)
        linear = transposed @ rest.mass_matrix
        rate = np.zeros((count, n))
        effort = np.abs(rest.efforts)
        for columns, size in sizes:
            rate += size * np.linalg.norm(inverse[:, :, columns], axis=2)
        for columns, size in (
            (~angular, task.acceleration * unit), (angular, task.angular_acceleration)
        ):  # fmt: skip
            effort = effort + size * np.linalg.norm(linear[:, :, columns], axis=2)
        if task.speed or task.turn or task.force:
            form, places = self._quadratic(given, rest.efforts, factor)
            effort = effort + _largest(form, sizes)
            pressed = transposed @ places.transpose(0, 2, 1)
            effort = effort + task.force * np.linalg.norm(pressed, axis=2)
        rate = rate / mover.si(mechanism.joints)
        found = np.concatenate([rate, effort], axis=1).T
        return np.where(np.isfinite(found), found, np.inf)

    def _quadratic(self, poses: Values, weight: Values, factor: Values) -> tuple[Values, Values]:
        """Return efforts as quadratic forms of the pose's rates (N, n, d, d), and dP/dX (N, 3, d).

        From the efforts at unit rates: each alone, and each pair together.
        """
        mover = self._mover
        count, d = poses.shape
        n = weight.shape[1]
        none = np.zeros_like(poses)
        form = np.empty((count, n, d, d))
        places = np.empty((count, 3, d))

        def asked(*which: int) -> Values:
            rates = none.copy()
            rates[:, list(which)] = 1.0 / factor[list(which)]
            state = mover.state(poses, rates, none)
            if len(which) == 1:
                places[:, :, which[0]] = state.platform[:, 1, :3]
            return state.efforts - weight

        for i in range(d):
            form[:, :, i, i] = asked(i)
        for i in range(d):
            for j in range(i):
                both = (asked(i, j) - form[:, :, i, i] - form[:, :, j, j]) / 2
                form[:, :, i, j] = form[:, :, j, i] = both
        return form, places


def _largest(form: Values, sizes: list[tuple[NDArray[np.bool_], float]]) -> Values:
    """Bound |x^T C x| over vectors whose two parts have at most the given lengths."""
    (first, v), (second, w) = sizes
    bound = np.zeros(form.shape[:2])
    finite = np.where(np.isfinite(form), form, 0.0)
    for part, size in sizes:
        if part.any() and size:
            block = finite[:, :, part][:, :, :, part]
            bound += size**2 * np.abs(np.linalg.eigvalsh(block)).max(axis=2)
    if first.any() and second.any() and v and w:
        block = finite[:, :, first][:, :, :, second]
        bound += 2 * v * w * np.linalg.norm(block, ord=2, axis=(2, 3))
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
        Domain, joint limits and working mode of the workspace.
    task : Task
    limits : mapping
        ``<joint>_rate`` (length unit/s, rad/s) and ``<joint>_effort`` (N, N m), each a size; those
        left out are not limited.
    samples : int
        In all replicates, rounded up to whole blocks.
    """
    given = check_limits(mechanism, limits, "capability")
    mode = mechanism.check_mode(settings.working_mode)
    sweeper = Sweeper(mechanism, settings, seed, threads, notify, where="capability")
    asked = Demands(mechanism, parameters, mode, task, bodies, threads, notify)
    design = sweeper.design(parameters)
    points = sweeper.sequence(REPLICATES)
    count = max(1, math.ceil(samples / REPLICATES / BLOCK)) * BLOCK
    bounds = np.array([given.get(name, math.inf) for name in asked.names])
    found: list[Values] = []
    for r in range(REPLICATES):
        poses, _ = reachable_poses(sweeper, design, replicate(points, r), 0, count)
        found.append(asked.at(poses))
    part = design.box_volume / count
    whole = [part * values.shape[1] for values in found]
    capable = [part * int((values <= bounds[:, None]).all(axis=0).sum()) for values in found]
    demands = []
    for k, name in enumerate(asked.names):
        joined = np.concatenate([values[k] for values in found])
        levels = []
        for share in SHARES:
            each = [float(np.quantile(v[k], share)) for v in found if v.shape[1]]
            value = float(np.quantile(joined, share)) if joined.size else math.nan
            levels.append(Estimate(value, _error(each)))
        enough = Estimate(math.nan, math.nan)
        if name in given:
            enough = _mean([part * int((v[k] <= bounds[k]).sum()) for v in found])
        demands.append(Demand(name, asked.units[name], given.get(name), tuple(levels), enough))
    length = unit_of("length", mechanism.length_unit)
    units = {
        **asked.units,
        **{p.name: mechanism.unit(p) for p in mechanism.parameters},
        "volume": mechanism.volume_unit,
        "capable": mechanism.volume_unit,
        "share": "1",
        "speed": f"{length}/s",
        "acceleration": f"{length}/s^2",
        "turn": "rad/s",
        "angular_acceleration": "rad/s^2",
        "force": "N",
        "payload": "kg",
    }
    shares = [c / w for c, w in zip(capable, whole, strict=True) if w]
    total = sum(whole)
    return Capability(
        mechanism=mechanism.name,
        params=dict(parameters),
        working_mode=mode,
        task=task,
        volume=_mean(whole),
        capable=_mean(capable),
        share=Estimate(sum(capable) / total if total else math.nan, _error(shares)),
        demands=tuple(demands),
        samples=REPLICATES * count,
        reachable=sum(values.shape[1] for values in found),
        seed=seed,
        units=units,
    )


def _error(values: Sequence[float]) -> float:
    """Return the standard error of the mean of replicates."""
    finite = np.array(values)
    if len(finite) < 2 or not np.isfinite(finite).all():
        return math.nan
    spread = float(finite.std(ddof=1))
    # What is the same everywhere differs by rounding.
    return spread / math.sqrt(len(finite)) if spread > 1e-12 * np.abs(finite).max() else 0.0


def _mean(values: Sequence[float]) -> Estimate:
    return Estimate(float(np.mean(values)), _error(values))
