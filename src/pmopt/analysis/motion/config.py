"""The configuration of ``pmopt motion`` and ``pmopt simulate``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from pmopt.analysis.motion.formulas import check_constants
from pmopt.analysis.motion.waypoint_laws import LawName
from pmopt.analysis.settings import MECHANISM_KEY, FiniteFloat, Range, named_mechanism
from pmopt.analysis.validation import read_config, validated
from pmopt.errors import InputError, unknown_name
from pmopt.inputs.fields import LENGTH, Unit, UnitByName, UnitInWords
from pmopt.inputs.overrides import overridden
from pmopt.mechanisms import Mechanism
from pmopt.mechanisms.bodies import (
    STEEL,
    Body,
    MassProperties,
    Part,
    disc,
    plate,
    triangle,
    tube,
)
from pmopt.mechanisms.mechanism import (
    LARGEST_COORDINATE,
    PLATFORM,
    Coordinate,
    Matrix,
    Parameters,
    Ranges,
    as_number,
)
from pmopt.units import METRES

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Triple = Annotated[tuple[FiniteFloat, FiniteFloat, FiniteFloat], Field(strict=False)]
Row = Triple
Size = Annotated[Positive, Unit(LENGTH)]
Place = Annotated[tuple[FiniteFloat, FiniteFloat, FiniteFloat], Field(strict=False), Unit(LENGTH)]
Density = Annotated[Positive, Unit("kg/m^3")]
Seconds = Annotated[Positive, Unit("s")]
Gain = FiniteFloat | dict[str, FiniteFloat] | None
Inertia = Triple | Annotated[tuple[Row, Row, Row], Field(strict=False)]
#: Most instants of a motion.
MAX_INSTANTS = 1_000_000
#: kg and kg m^2: beyond them products with accelerations leave what doubles can resolve.
LARGEST_MASS, LARGEST_INERTIA = 1e12, 1e18
#: What limits can be set on beside positions: rates and accelerations of all joints, efforts and
#: power of actuated ones.
RATE, ACCELERATION, EFFORT, POWER = "_rate", "_acceleration", "_effort", "_power"

#: What keys of several tables mean.
DENSITY_KEY = "Density of its material; the default is steel"
OFFSET_KEY = "Shift of the body from that place, in the link's frame"
INERTIA_KEY = "Inertia about the centre of mass: the diagonal, or three rows"

_FROZEN = ConfigDict(frozen=True, extra="forbid", strict=True)
#: Where the points of a motion come from, and the keys that go with each source.
_SOURCES: dict[str, frozenset[str]] = {
    "waypoints": frozenset(
        {"law", "blend", "through", "dwell", "max_rate", "max_acceleration", "duration"}
    ),
    "gate": frozenset({"law", "blend", "dwell"}),
    "file": frozenset({"fit", "spline", "ends", "largest_step", "duration"}),
    "expressions": frozenset({"constants", "duration"}),
}


class FitSettings(BaseModel):
    """The key ``fit``: what is fitted to recorded points."""

    model_config = _FROZEN

    kind: Literal["harmonics", "spline"] = Field(description="What is fitted by least squares")
    count: int | None = Field(default=None, ge=1, le=50, description="Of harmonics: their number")
    period: Annotated[
        Positive | Literal["free"] | dict[str, Positive | Literal["free"]] | None, Unit("s")
    ] = Field(
        default=None,
        description="Of harmonics, one or by coordinate; `free`: the one with the least residual",
    )
    pieces: int | None = Field(
        default=None, ge=1, le=10_000, description="Of a spline of degree 5: how many pieces"
    )

    @model_validator(mode="before")
    @classmethod
    def _period(cls, data: Any) -> Any:
        """Say in one line what a period may be."""
        period = data.get("period") if isinstance(data, dict) else None
        for value in period.values() if isinstance(period, dict) else [period]:
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if value is not None and value != "free" and not (number and 0 < value < float("inf")):
                raise ValueError(f'period={value!r} must be a number > 0 in s or "free"')
        return data

    @model_validator(mode="after")
    def _consistent(self) -> FitSettings:
        if self.kind == "spline" and (self.count is not None or self.period is not None):
            raise ValueError("count and period belong to harmonics, a spline has pieces")
        if self.kind == "harmonics" and self.pieces is not None:
            raise ValueError("pieces belong to a spline, harmonics have count and period")
        return self


class GateSettings(BaseModel):
    """The table ``gate``: a pick-and-place path, up, across and down, there and back."""

    model_config = _FROZEN

    pick: Annotated[dict[str, FiniteFloat], UnitByName()] = Field(
        description="One end, every coordinate"
    )
    place: Annotated[dict[str, FiniteFloat], UnitByName()] = Field(
        description="The other end, every coordinate"
    )
    up: str = Field(description="Name of the coordinate that rises")
    height: Annotated[FiniteFloat, Unit(LENGTH)] = Field(
        description="How far it rises above the higher end, with its sign"
    )
    radius: Size = Field(description="Roundings begin and end this far from the corners")
    cycle: Seconds = Field(description="Time there and back")
    cycles: int = Field(default=1, ge=1, le=10_000, description="Number of cycles")


class TrajectorySettings(BaseModel):
    """The ``[trajectory]`` table; further keys are expressions, one a coordinate."""

    model_config = ConfigDict(frozen=True, extra="allow", strict=True)

    #: Values, unit, default and meaning of the keys beside the fields.
    FURTHER_KEYS: ClassVar = (
        "formula of `t`, or a number",
        "the coordinate's",
        "",
        "One for every coordinate, where there are no waypoints, gate or file",
    )

    space: Literal["task", "joint"] = Field(
        default="task", description="Whether coordinates are the pose's or the actuated joints'"
    )
    duration: Annotated[Positive | None, Unit("s")] = Field(
        default=None,
        description="Duration of the motion. Expressions need it; for waypoints it may follow from "
        "their times or the largest rates, for a recording it is that of its rows",
    )
    step: Seconds = Field(default=0.01, description="Time between two computed instants")
    constants: dict[str, FiniteFloat] = Field(
        default_factory=dict, description="Numbers by name, for the expressions"
    )
    waypoints: list[Any] | None = Field(
        default=None, min_length=2, max_length=100_000,
        description="Points to move through: lists of all coordinates in order, or tables, which "
        "may have a time `t` in s",
    )  # fmt: skip
    gate: GateSettings | None = Field(default=None, description="A pick-and-place cycle")
    file: str | None = Field(
        default=None, min_length=1,
        description="CSV file beside the configuration: `t` and every coordinate",
    )  # fmt: skip
    law: LawName = Field(
        default="quintic", description="Law of motion on a stretch between two points"
    )
    blend: Annotated[float, Field(gt=0, le=0.5)] | None = Field(
        default=None,
        description="Of the trapezoidal law: share of a stretch's time in which it accelerates. "
        "Default: the shortest motion within `max_rate` and `max_acceleration`, else 0.25",
    )
    through: bool = Field(default=False, description="Do not stop at inner waypoints")
    dwell: Annotated[NotNegative, Unit("s")] = Field(
        default=0.0, description="Rest at each waypoint but the last, and at both ends of a gate"
    )
    max_rate: Annotated[dict[str, Positive], UnitByName("/s")] = Field(
        default_factory=dict,
        description="Largest rate by coordinate, from which the time between waypoints follows",
    )
    max_acceleration: Annotated[dict[str, Positive], UnitByName("/s^2")] = Field(
        default_factory=dict, description="Largest acceleration by coordinate, with `max_rate`"
    )
    spline: Literal["quintic", "cubic"] = Field(
        default="quintic", description="Kind of the spline through the rows of `file`"
    )
    ends: Literal["free", "rest", "periodic"] = Field(
        default="free", description="Ends of that spline; periodic: the end equals the beginning"
    )
    largest_step: Annotated[Positive | None, Unit("s")] = Field(
        default=None,
        description="Largest gap between two rows of `file`. Default: 2.5 times the median",
    )
    fit: FitSettings | None = Field(
        default=None, description="Fit the rows of `file` instead of passing through them"
    )

    @property
    def expressions(self) -> dict[str, str | float]:
        """Expressions of t by coordinate."""
        return self.model_extra or {}

    @property
    def source(self) -> str:
        """Where the points come from: one of waypoints, gate, file, expressions."""
        given = [k for k in ("waypoints", "gate", "file") if getattr(self, k) is not None]
        return given[0] if given else "expressions"

    @model_validator(mode="after")
    def _consistent(self) -> TrajectorySettings:
        sources = [k for k in ("waypoints", "gate", "file") if getattr(self, k) is not None]
        sources += ["expressions"] if self.expressions else []
        if len(sources) != 1:
            given = " and ".join(sources) or "none"
            raise ValueError(
                f"one of waypoints, gate, file or an expression for each coordinate is needed, "
                f"{given} given"
            )
        for key, value in self.expressions.items():
            number = as_number(value)
            if not isinstance(value, str) and (number is None or math.isinf(number)):
                raise ValueError(f"{key}={value!r} must be an expression of t or a number")
        source = sources[0]
        for key in frozenset().union(*_SOURCES.values()) & self.model_fields_set:
            if key not in _SOURCES[source] and getattr(self, key) is not None:
                raise ValueError(f"{key}: not together with {source}")
        if source == "expressions" and self.duration is None:
            raise ValueError("duration is missing: expressions need one, in s")
        if self.blend is not None and self.law != "trapezoidal":
            raise ValueError("blend belongs to law = trapezoidal")
        if self.fit is not None and self.model_fields_set & {"spline", "ends"}:
            raise ValueError("spline and ends: not together with fit")
        if self.through and (self.dwell or self.max_rate or self.max_acceleration):
            raise ValueError("through: not together with dwell, max_rate and max_acceleration")
        return self


class RodSettings(BaseModel):
    """A rod from the origin of its link's frame along z, moved by ``offset``."""

    model_config = _FROZEN

    diameter: Size = Field(description="Outer diameter")
    length: Size = Field(description="Along z of the link's frame")
    density: Density = Field(default=STEEL, description=DENSITY_KEY)
    offset: Place = Field(default=(0.0, 0.0, 0.0), description=OFFSET_KEY)


class TubeSettings(RodSettings):
    """A tube: a rod with a bore."""

    bore: Annotated[NotNegative, Unit(LENGTH)] = Field(description="Inner diameter")

    @model_validator(mode="after")
    def _thick(self) -> TubeSettings:
        if not self.bore < self.diameter:
            raise ValueError(f"bore {self.bore:g} is not smaller than diameter {self.diameter:g}")
        return self


class DiscSettings(BaseModel):
    """A disc about the origin, across an axis of the link's frame."""

    model_config = _FROZEN

    diameter: Size = Field(description="Diameter of the disc")
    thickness: Size = Field(description="Thickness along its normal")
    normal: Literal["x", "y", "z"] = Field(default="z", description="Axis of the link's frame")
    density: Density = Field(default=STEEL, description=DENSITY_KEY)
    offset: Place = Field(default=(0.0, 0.0, 0.0), description=OFFSET_KEY)


class PlateSettings(BaseModel):
    """A box about the origin."""

    model_config = _FROZEN

    size: Annotated[tuple[Positive, Positive, Positive], Field(strict=False), Unit(LENGTH)] = Field(
        description="Along x, y, z of the link's frame"
    )
    density: Density = Field(default=STEEL, description=DENSITY_KEY)
    offset: Place = Field(default=(0.0, 0.0, 0.0), description=OFFSET_KEY)


class TriangleSettings(BaseModel):
    """An equilateral triangular plate about the origin, a corner on the x axis."""

    model_config = _FROZEN

    side: Size = Field(description="Side of the triangle")
    thickness: Size = Field(description="Along z of the link's frame")
    density: Density = Field(default=STEEL, description=DENSITY_KEY)
    offset: Place = Field(default=(0.0, 0.0, 0.0), description=OFFSET_KEY)


_SHAPES = ("rod", "tube", "disc", "plate", "triangle")


class PayloadSettings(BaseModel):
    """The ``[payload]`` table, in the platform's frame: a point mass unless it has an inertia."""

    model_config = _FROZEN

    mass: Annotated[NotNegative, Unit("kg")] = Field(description="Mass that the platform carries")
    centre: Place = Field(
        default=(0.0, 0.0, 0.0), description="Centre of mass, in the platform's frame"
    )
    inertia: Annotated[Inertia, Unit("kg m^2")] = Field(
        default=(0.0, 0.0, 0.0), description=INERTIA_KEY
    )


class BodySettings(BaseModel):
    """A table of ``[bodies]``: a body of the mechanism, changed, or a further one."""

    model_config = _FROZEN

    limb: int | str | None = Field(
        default=None,
        description='Number of the limb from 1, or `"platform"`; a further body needs it',
    )
    joint: int | None = Field(
        default=None, ge=1, description="Number of the limb's joint that the body follows"
    )
    part: Part | None = Field(
        default=None,
        description="Of a parallelogram joint: the link behind it, or its long bars. Default: "
        "`link`",
    )
    rod: RodSettings | None = Field(
        default=None, description="A rod along z, from the origin of its link's frame"
    )
    tube: TubeSettings | None = Field(default=None, description="A rod with a bore")
    disc: DiscSettings | None = Field(default=None, description="A disc about the origin")
    plate: PlateSettings | None = Field(default=None, description="A box about the origin")
    triangle: TriangleSettings | None = Field(
        default=None,
        description="An equilateral plate about the origin, a corner on the x axis",
    )
    mass: Annotated[NotNegative | None, Unit("kg")] = Field(
        default=None,
        description="Mass, instead of a shape. A new mass alone scales the inertia of a known body",
    )
    centre: Annotated[Triple | None, Unit(LENGTH)] = Field(
        default=None, description="Centre of mass, in the link's frame"
    )
    inertia: Annotated[Inertia | None, Unit("kg m^2")] = Field(
        default=None, description=INERTIA_KEY
    )

    @property
    def shape(self) -> str | None:
        """The shape that is given."""
        return next((k for k in _SHAPES if getattr(self, k) is not None), None)

    @model_validator(mode="after")
    def _consistent(self) -> BodySettings:
        shapes = [k for k in _SHAPES if getattr(self, k) is not None]
        if len(shapes) > 1:
            raise ValueError(f"{shapes[0]} and {shapes[1]} exclude each other: give one")
        own = [k for k in ("mass", "centre", "inertia") if getattr(self, k) is not None]
        if shapes and own:
            raise ValueError(f"{shapes[0]} and {own[0]} exclude each other: a shape has its own")
        return self


class ControllerSettings(BaseModel):
    """The ``[controller]`` table: PID on the joints, with the model's efforts or without.

    Gains are one number for all joints or one a joint: effort by error of position (kp), by its
    integral (ki) and by the error of rate (kd), 0 where another is given and
    :func:`pmopt.analysis.multibody.simulation.controller_gains` where none is. ``hold`` is the time
    in s between two samples of the controller, the engine's step by default.
    """

    model_config = _FROZEN

    kp: Annotated[Gain, UnitInWords("N or N m, by length unit or rad")] = Field(
        default=None,
        description="Effort per error of position, one value or by joint. Default: where no gain "
        "is given, from the inertia that each joint feels; else 0",
    )
    ki: Annotated[Gain, UnitInWords("that of kp, by s")] = Field(
        default=None, description="Effort per integral of the error over time. Default: 0"
    )
    kd: Annotated[Gain, UnitInWords("that of kp, times s")] = Field(
        default=None, description="Effort per error of the rate. Default: as kp"
    )
    feedforward: bool = Field(
        default=False, description="Add the motion's own effort in the middle of the hold"
    )
    hold: Annotated[Positive | None, Unit("s")] = Field(
        default=None, description="Time between two commands. Default: the engine's step"
    )


class EngineSettings(BaseModel):
    """The ``[engine]`` table: the multibody engine and its step in s.

    ``tolerance``, in per cent of a joint's peak effort, is how far the engine's inverse dynamics
    may be from the motion's before the verification fails.
    """

    model_config = _FROZEN

    name: Literal["mujoco"] = Field(default="mujoco", description="The multibody engine")
    step: Seconds = Field(default=0.001, description="Step of its integration")
    tolerance: Annotated[Positive, Unit("%")] = Field(
        default=0.01,
        description="Of a joint's peak effort: largest difference of the inverse dynamics, beyond "
        "which the comparison has failed",
    )


class MotionConfig(BaseModel):
    """A validated, frozen configuration; see :func:`load_motion`."""

    model_config = _FROZEN

    mechanism: str = Field(description=MECHANISM_KEY)
    parameters: dict[str, Any] = Field(
        default_factory=dict,
        description="Design parameters by name, numbers. Default: the mechanism's own; "
        "`pmopt info` lists them with their units",
    )
    working_mode: str | None = Field(
        default=None,
        description="Working mode by name; `pmopt info` lists them. Default: the mechanism's first",
    )
    gravity: Annotated[Triple | None, Unit("m/s^2")] = Field(
        default=None, description="Gravity along x, y, z of the base. Default: 9.81 m/s^2 downwards"
    )
    efforts: bool = Field(
        default=True, description="Whether to compute forces, torques and power, or only the motion"
    )
    trajectory: TrajectorySettings = Field(description="The path, and its timing")
    bodies: dict[str, BodySettings] = Field(
        default_factory=dict,
        description="Bodies by name: changes to the mechanism's own, and further ones",
    )
    payload: PayloadSettings | None = Field(
        default=None, description="Payload on the platform; a point mass unless it has an inertia"
    )
    limits: Annotated[dict[str, Annotated[Range, Field(strict=False)]], UnitByName()] = Field(
        default_factory=dict,
        description="Ranges of joints by name, passive ones too, with `_rate` or `_acceleration` "
        "of these, and with `_effort` or `_power` of actuated ones. Default: the mechanism's own",
    )
    controller: ControllerSettings | None = Field(
        default=None,
        description="PID on the joints, for `pmopt simulate`. Default: no forward simulation",
    )
    engine: EngineSettings | None = Field(
        default=None, description="The multibody engine of `pmopt simulate`"
    )


@dataclass(frozen=True)
class MotionTask:
    """What is to move, and how: a configuration with every name checked.

    Attributes
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete.
    config : MotionConfig
    bodies : tuple of Body
        The mechanism's own, changed and completed; empty where it has none.
    payload : MassProperties or None
    joint_limits : Ranges
        Of positions, of actuated and passive joints.
    other_limits : Ranges
        By ``<joint>_rate``, ``_acceleration``, ``_effort`` and ``_power``.
    where : str
        What errors call the configuration.
    folder : Path
        What file names in it are relative to.
    """

    mechanism: Mechanism
    parameters: Parameters
    config: MotionConfig
    bodies: tuple[Body, ...]
    payload: MassProperties | None
    joint_limits: Ranges
    other_limits: Ranges
    where: str
    folder: Path

    @property
    def driven(self) -> tuple[Coordinate, ...]:
        """Coordinates that the trajectory gives."""
        joint = self.config.trajectory.space == "joint"
        return self.mechanism.joints if joint else self.mechanism.pose

    def to_dict(self) -> dict[str, Any]:
        """Return the configuration as JSON has it, enough to do it again.

        What is unset and keys of other sources of trajectories are left out.
        """
        document = self.config.model_dump(mode="json", exclude_none=True)
        settings = self.config.trajectory
        strange = frozenset().union(*_SOURCES.values()) - _SOURCES[settings.source]
        strange |= {"spline", "ends"} if settings.fit is not None else set()
        document["trajectory"] = {
            k: v for k, v in document["trajectory"].items() if k not in strange
        }
        return document


def load_motion(path: Path, sets: Sequence[str] = ()) -> MotionTask:
    """Read and resolve a TOML configuration.

    Parameters
    ----------
    path : Path
    sets : sequence of str
        ``KEY=VALUE`` that take the place of what stands there.

    Raises
    ------
    InputError
        For a file that cannot be read, is no TOML or does not validate.
    """
    data = overridden(read_config(path, "motion"), sets)
    return resolve_motion(data, str(path), path.parent)


def resolve_motion(data: Any, where: str, folder: Path) -> MotionTask:
    """Validate a configuration and complete it: every name checked.

    Parameters
    ----------
    data : dict
        As TOML gives it.
    where : str
        What errors call it, usually the file's name.
    folder : Path
        What file names in it are relative to.

    Raises
    ------
    InputError
        One line: file, key, value and what is allowed.
    """
    mechanism = _mechanism(data, where)
    config = validated(MotionConfig, data, where, mechanism.units)
    parameters = mechanism.resolve(config.parameters, f"{where}: parameters")
    mode = mechanism.check_mode(config.working_mode, f"{where}: working_mode")
    _check_expressions(config.trajectory, mechanism, where)
    limits = _limits(config.limits, mechanism, where)
    names = {c.name for c in mechanism.limited}
    declared = mechanism.bodies(parameters)
    bodies = _bodies(config.bodies, declared, mechanism, where)
    payload = None
    if config.payload is not None:
        place = f"{where}: payload"
        payload = MassProperties(
            config.payload.mass,
            np.array(config.payload.centre),
            _tensor(config.payload.inertia, place),
        )
        _check_size(payload, mechanism, place)
        if not bodies:
            raise InputError(f"{place}: {mechanism.name} has no bodies: [bodies] is needed")
    for name in limits:
        if name.endswith((EFFORT, POWER)) and not bodies:
            raise InputError(
                f"{where}: limits: {name} needs masses, {mechanism.name} has none: "
                "[bodies] is needed"
            )
    _check_gains(config.controller, mechanism, where)
    resolved = config.model_copy(
        update={"mechanism": mechanism.name, "parameters": dict(parameters), "working_mode": mode}
    )
    return MotionTask(
        mechanism, parameters, resolved, bodies, payload,
        {k: v for k, v in limits.items() if k in names},
        {k: v for k, v in limits.items() if k not in names},
        where, folder,
    )  # fmt: skip


def _mechanism(data: Any, where: str) -> Mechanism:
    """Return the mechanism, and refuse keys of [trajectory] that are no coordinate of it.

    The model takes any further key for one.
    """
    mechanism = named_mechanism(data, where)
    table = data.get("trajectory")
    if isinstance(table, dict):
        coordinates = mechanism.joints if table.get("space") == "joint" else mechanism.pose
        allowed = [c.name for c in coordinates]
        allowed += [f"{c.name}_deg" for c in coordinates if c.kind == "angle"]
        allowed += TrajectorySettings.model_fields
        for key in table:
            if key not in allowed:
                raise unknown_name(f"{where}: trajectory", key, allowed)
    return mechanism


def _check_expressions(settings: TrajectorySettings, mechanism: Mechanism, where: str) -> None:
    """Refuse coordinates that are missing or given twice, and unknown ones elsewhere."""
    place = f"{where}: trajectory"
    coordinates = mechanism.joints if settings.space == "joint" else mechanism.pose
    if settings.source == "expressions":
        for c in coordinates:
            given = [k for k in (c.name, f"{c.name}_deg") if k in settings.expressions]
            if len(given) != 1:
                how = "is given twice" if given else "is missing"
                raise InputError(
                    f"{place}: {c.name} {how}, needed: {', '.join(c.name for c in coordinates)}"
                )
    check_constants(settings.constants, f"{place}.constants")
    for key in ("max_rate", "max_acceleration"):
        names = [c.name for c in coordinates]
        for name in getattr(settings, key):
            if name not in names:
                raise unknown_name(f"{place}.{key}", name, names)


def _limits(given: Mapping[str, Any], mechanism: Mechanism, where: str) -> Ranges:
    further = [
        Coordinate(f"{c.name}{ending}", "length", "")
        for group, endings in (
            (mechanism.limited, (RATE, ACCELERATION)),
            (mechanism.joints, (EFFORT, POWER)),
        )
        for c in group
        for ending in endings
    ]
    return mechanism.check_ranges(given, (*mechanism.limited, *further), f"{where}: limits")


def _check_gains(controller: ControllerSettings | None, mechanism: Mechanism, where: str) -> None:
    if controller is None:
        return
    names = [c.name for c in mechanism.joints]
    for key in ("kp", "ki", "kd"):
        gains = getattr(controller, key)
        for name in gains if isinstance(gains, dict) else ():
            if name not in names:
                raise unknown_name(f"{where}: controller.{key}", name, names)


Shape = TypeVar("Shape", bound=BaseModel)


def _shaped(settings: BodySettings, mechanism: Mechanism) -> MassProperties | None:
    """Return the mass properties of the shape that is given."""
    unit = METRES[mechanism.length_unit]
    if settings.rod is not None:
        s = settings.rod
        return tube(s.diameter, s.length, unit, density=s.density).at(s.offset)
    if settings.tube is not None:
        t = settings.tube
        return tube(t.diameter, t.length, unit, t.bore, t.density).at(t.offset)
    if settings.disc is not None:
        d = settings.disc
        normal = "xyz".index(d.normal)
        return disc(d.diameter, d.thickness, unit, normal, d.density).at(d.offset)
    if settings.plate is not None:
        p = settings.plate
        return plate(p.size, unit, p.density).at(p.offset)
    if settings.triangle is not None:
        r = settings.triangle
        return triangle(r.side, r.thickness, unit, r.density).at(r.offset)
    return None


def _tensor(given: Inertia, where: str) -> Matrix:
    """Return an inertia (3, 3) from its diagonal or its rows.

    Raises
    ------
    InputError
        For what no mass distribution has.
    """
    tensor = np.array(given, dtype=float)
    tensor = np.diag(tensor) if tensor.ndim == 1 else tensor
    if not np.array_equal(tensor, tensor.T):
        raise InputError(f"{where}.inertia={np.array(given).tolist()} is not symmetric")
    moments = np.linalg.eigvalsh(tensor)
    slack = 1e-12 * abs(moments[2])
    if moments[0] < -slack or moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        raise InputError(
            f"{where}.inertia={np.array(given).tolist()} is that of no body: moments are >= 0 and "
            "the largest is at most the sum of the others"
        )
    return tensor


def _check_size(body: MassProperties, mechanism: Mechanism, where: str) -> None:
    """Refuse a body too large for forces and energies to be computed."""
    sizes = {
        "mass": (body.mass, LARGEST_MASS, "kg"),
        "centre": (float(np.abs(body.centre).max()), LARGEST_COORDINATE, mechanism.length_unit),
        "inertia": (float(np.abs(body.inertia).max()), LARGEST_INERTIA, "kg m^2"),
    }
    for name, (size, largest, unit) in sizes.items():
        if not size <= largest:
            raise InputError(
                f"{where}: {name} {size:.4g} {unit} is not allowed: at most {largest:g} {unit}"
            )


def _bodies(
    given: Mapping[str, BodySettings], declared: tuple[Body, ...], mechanism: Mechanism, where: str
) -> tuple[Body, ...]:
    """Return the declared bodies, changed by those of their name, and the further ones."""
    bodies = {body.name: body for body in declared}
    for name, settings in given.items():
        place = f"{where}: bodies.{name}"
        if name == "payload":
            raise InputError(f"{place}: a payload has a table of its own, [payload]")
        known = bodies.get(name)
        moved = known is None or any(
            getattr(settings, k) is not None for k in ("limb", "joint", "part")
        )
        if known is None and settings.limb is None:
            needed = f"limb and joint, of a further body, or a name of {', '.join(bodies)}"
            raise InputError(f"{place}: limb is missing: {needed if bodies else 'limb and joint'}")
        limb, joint, part = (
            _link(settings, mechanism, place) if moved else (known.limb, known.joint, known.part)  # type: ignore[union-attr]
        )
        found = _shaped(settings, mechanism)
        if found is None:
            found = _properties(settings, known, place)
        _check_size(found, mechanism, place)
        body = found.body(name, limb, joint, part, f"{where}: [bodies]")
        bodies[name] = body if known is None or moved else replace(
            known, mass=body.mass, centre=body.centre, inertia=body.inertia, source=body.source
        )  # fmt: skip
    return tuple(bodies.values())


def _properties(settings: BodySettings, known: Body | None, where: str) -> MassProperties:
    """Return mass, centre and inertia; what is not given comes from the known body.

    A new mass alone scales the inertia: the same shape of another density.
    """
    if settings.mass is None and known is None:
        raise InputError(
            f"{where}: mass is missing: one of {', '.join(_SHAPES)} or mass, centre and inertia "
            "is needed"
        )
    mass = known.mass if settings.mass is None and known is not None else settings.mass or 0.0
    if settings.centre is not None:
        centre = np.array(settings.centre)
    else:
        centre = np.zeros(3) if known is None else known.centre
    if settings.inertia is not None:
        inertia = _tensor(settings.inertia, where)
    elif known is None:
        inertia = np.zeros((3, 3))
    else:
        inertia = known.inertia * (mass / known.mass if known.mass > 0 else 1.0)
    return MassProperties(mass, centre, inertia)


def _link(settings: BodySettings, mechanism: Mechanism, where: str) -> tuple[int, int, Part]:
    """Return limb and joint, counted from 0, and part of a body."""
    limb = settings.limb
    if limb is None:
        raise InputError(f"{where}: limb is missing")
    if limb == "platform":
        if settings.joint is not None or settings.part is not None:
            raise InputError(f"{where}: joint and part: not together with limb = platform")
        return PLATFORM, 0, "link"
    if not isinstance(limb, int) or not 1 <= limb <= len(mechanism.limbs):
        raise InputError(
            f'{where}.limb={limb!r} is not allowed: 1 to {len(mechanism.limbs)} or "platform"'
        )
    joints = re.findall(r"P_a|[RPCUS]", mechanism.limbs[limb - 1].joints)
    if settings.joint is None or not settings.joint <= len(joints):
        shown = (
            f"{where}: joint is missing"
            if settings.joint is None
            else f"{where}.joint={settings.joint} is not allowed"
        )
        raise InputError(f"{shown}: 1 to {len(joints)}, the joint that the link follows")
    part = settings.part or "link"
    if part == "bars" and joints[settings.joint - 1] != "P_a":
        raise InputError(
            f"{where}: part = bars: joint {settings.joint} of limb {limb} is no parallelogram"
        )
    return limb - 1, settings.joint - 1, part
