"""Settings of the analyses: each has a type, with the fields that it reads and nothing else.

A type is the table of a configuration, what the keywords of the Python function are checked by, and
what the options of the command are made of (:mod:`pmopt.cli.fields`). What several analyses read
is declared once, as an annotated type with its unit, range, group and description.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, model_validator

from pmopt.analysis.validation import validated
from pmopt.errors import InputError
from pmopt.inputs.fields import LENGTH, Group, OnCommandLine, Unit, UnitByName
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.mechanism import JacobianKind

Norm = Literal["2", "fro"]
DEFAULT_SAMPLES = 1 << 22
DEFAULT_REPLICATES = 16
DEFAULT_SEED = 1
#: Most samples of a run: beyond this the indices of a replicate leave the range that is tested.
MAX_SAMPLES = 1 << 44

#: What the first key of every configuration means.
MECHANISM_KEY = "Its name, upper or lower case, with or without dashes; `pmopt list` has them"

FiniteFloat = Annotated[float, Field(allow_inf_nan=False)]


def _end(value: Any) -> Any:
    return float(value) if value in ("inf", "-inf") else value


def _end_to_json(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)


#: An end of a range may be infinite, in JSON "inf"; NaN fails the comparison of the ends below.
RangeEnd = Annotated[float, BeforeValidator(_end), PlainSerializer(_end_to_json, when_used="json")]
Range = tuple[RangeEnd, RangeEnd]


def _length(value: Any) -> Any:
    if isinstance(value, str) and value != "optimal":
        raise ValueError("a number > 0 or optimal")
    return value


def _norm(value: Any) -> Any:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


class _Named(BaseModel):
    """What has to be known before the rest of a configuration is read: the mechanism."""

    model_config = ConfigDict(frozen=True, strict=True)

    mechanism: str = Field(description=MECHANISM_KEY)


def named_mechanism(data: Any, where: str) -> Mechanism:
    """Return the mechanism that a configuration names.

    Raises
    ------
    InputError
    """
    name = validated(_Named, data, where).mechanism
    try:
        return find(name)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


SAMPLING, PLACE, INDEX, CHECKS = Group("Sampling"), Group("Poses"), Group("Index"), Group("Checks")
TASK, MOTORS, PROOF = Group("Task"), Group("Motors"), Group("Proof")

Sampler = Annotated[
    Literal["r-sequence", "sobol", "monte-carlo", "lines"],
    SAMPLING,
    Field(
        description="How sample points are placed. `lines` is exact along one coordinate and the "
        "fastest where the mechanism offers it"
    ),
]
#: Where points on lines are of no use.
PointSampler = Annotated[
    Literal["r-sequence", "sobol", "monte-carlo"],
    SAMPLING,
    Field(description="How sample points are placed"),
]
Replicates = Annotated[
    int | None,
    SAMPLING,
    Field(
        ge=4, le=256,
        description="Independent randomisations, from which errors are estimated. "
        "Default: about 16",
    ),
]  # fmt: skip
Seed = Annotated[int, SAMPLING, Field(ge=0, lt=2**63, description="Seed of the sample points")]
WorkingMode = Annotated[
    str | None,
    PLACE,
    OnCommandLine(metavar="MODE"),
    Field(
        description="Working mode by name; `pmopt info` lists them. Default: the mechanism's first"
    ),
]
Domain = Annotated[
    dict[str, Annotated[Range, Field(strict=False)]],
    UnitByName(),
    PLACE,
    OnCommandLine(metavar="COORD=LOWER:UPPER,.."),
    Field(
        description="Ranges of pose coordinates by name; an end may be inf. Default: the "
        "mechanism's own search domain"
    ),
]
Limits = Annotated[
    dict[str, Annotated[Range, Field(strict=False)]],
    UnitByName(),
    PLACE,
    OnCommandLine(metavar="JOINT=LOWER:UPPER,.."),
    Field(
        description="Ranges of joints by name, passive ones too, and of the tool's position. "
        "Default: the mechanism's own limits"
    ),
]
MinLci = Annotated[
    FiniteFloat,
    Unit("1"),
    PLACE,
    Field(ge=0, le=1, description="Poses with a smaller index do not count"),
]
NormOfIndex = Annotated[
    Norm,
    BeforeValidator(_norm),
    INDEX,
    Field(description="Norm of the index LCI: smallest over largest singular value, or Frobenius"),
]
Jacobian = Annotated[
    JacobianKind | None,
    INDEX,
    Field(
        description="Whether a characteristic length converts rates of angles to lengths before "
        "the index is computed. Default: the mechanism's"
    ),
]
CharacteristicLength = Annotated[
    Annotated[float, Field(gt=0, allow_inf_nan=False)] | Literal["optimal"] | None,
    BeforeValidator(_length),
    Unit(LENGTH),
    INDEX,
    Field(
        description="Length that makes the Jacobian homogeneous; `optimal` is the one with the "
        "largest GCI. Default: the mechanism's"
    ),
]
LinkDiameter = Annotated[
    FiniteFloat | None,
    Unit(LENGTH),
    CHECKS,
    Field(
        gt=0,
        description="Links (limbs and cranks, joint to joint) are capsules of this diameter that "
        "must not meet those of other limbs. Default: not checked",
    ),
]
PlatformDiameter = Annotated[
    FiniteFloat | None,
    Unit(LENGTH),
    CHECKS,
    Field(
        gt=0,
        description="Diameter of the platform's spokes, centre to limb, and of the tool; needs "
        "`link_diameter`, whose value is the default",
    ),
]
ConeAngle = Annotated[
    FiniteFloat | None,
    Unit("rad"),
    CHECKS,
    Field(
        gt=0, le=math.pi,
        description="Largest angle at passive U and S joints between the link and its direction at "
        "home, seen from base or platform. Default: not checked",
    ),
]  # fmt: skip
Tool = Annotated[
    tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None,
    Field(strict=False),
    Unit(LENGTH),
    CHECKS,
    Field(
        description="A point in the platform's frame; positions reached are then the tool's, and "
        "`limits` may bound tool_x, tool_y and tool_z"
    ),
]
Aspect = Annotated[
    Literal["home"] | None,
    PLACE,
    Field(
        description="Count only the region around home that holds no forward or constraint "
        "singularity"
    ),
]
Block = Annotated[
    Literal["translational", "rotational"] | None,
    INDEX,
    Field(description="Take the index from the Jacobian's rows for lengths, or for angles, alone"),
]
TimeBudget = Annotated[
    FiniteFloat | None,
    Unit("s"),
    PROOF,
    Field(
        gt=0,
        description="Seconds of work after which a proof stops where it is; compilation does not "
        "count",
    ),
]
BoxBudget = Annotated[
    int | None,
    PROOF,
    Field(
        gt=0,
        description="Boxes examined after which a proof stops where it is: the same result on "
        "every machine",
    ),
]


#: Bounds of every size of a task.
_SIZE = Field(ge=0, lt=1e9, allow_inf_nan=False)


class Settings(BaseModel):
    """Checks common to the settings of all analyses: values that contradict each other.

    Names of coordinates and working modes are checked against the mechanism when it is known.

    Attributes
    ----------
    OWN : frozenset of str
        Fields that say something else than the field of that name of a workspace.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
    OWN: ClassVar[frozenset[str]] = frozenset()

    @classmethod
    def shared(cls) -> frozenset[str]:
        """Return the fields that are settings of a workspace."""
        return frozenset(WorkspaceSettings.model_fields) & set(cls.model_fields) - cls.OWN

    def of_workspace(self) -> WorkspaceSettings:
        """Return the settings of the workspace in question, the others at their defaults."""
        return WorkspaceSettings(**{name: getattr(self, name) for name in self.shared()})

    def _has(self, name: str) -> bool:
        return getattr(self, name, None) is not None

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        if self._has("characteristic_length") and getattr(self, "jacobian", None) == "raw":
            raise ValueError("characteristic_length needs jacobian = homogenized, not raw")
        if self._has("platform_diameter") and not self._has("link_diameter"):
            raise ValueError("platform_diameter needs link_diameter")
        for table in ("domain", "limits"):
            for name, (low, high) in getattr(self, table, {}).items():
                if not low < high:
                    raise ValueError(f"{table}.{name}=[{low}, {high}]: lower < upper is needed")
        return self


class WorkspaceSettings(Settings):
    """The ``[workspace]`` table of a configuration, and the options of ``pmopt workspace``."""

    sampler: Sampler = "r-sequence"
    samples: Annotated[int | None, SAMPLING] = Field(
        default=None, ge=16, le=MAX_SAMPLES,
        description="Sample points, over all replicates. Default: 4,194,304",
    )  # fmt: skip
    replicates: Replicates = Field(
        default=None,
        description="Independent randomisations, from which errors are estimated. Default: about "
        "16, with `target_error` 32",
    )
    grid: Annotated[int | None, SAMPLING] = Field(
        default=None, ge=4, le=30_000,
        description="Cells on each axis of a regular grid, instead of `samples`; errors are then "
        "bounds",
    )  # fmt: skip
    target_error: Annotated[FiniteFloat | None, Unit("1"), SAMPLING] = Field(
        default=None, gt=0, lt=1,
        description="Relative standard error of volume and GCI to sample to, instead of `samples`",
    )  # fmt: skip
    working_mode: WorkingMode = None
    norm: NormOfIndex = "2"
    jacobian: Jacobian = None
    characteristic_length: CharacteristicLength = None
    min_lci: MinLci = 0.0
    regions: Annotated[
        tuple[FiniteFloat, ...],
        Field(strict=False),
        INDEX,
        OnCommandLine(metavar="0,..,1"),
        Field(description="Edges of the dexterity regions, ascending from 0 to 1"),
    ] = (0.0, 0.1, 0.3, 1.0)
    domain: Domain = Field(default_factory=dict)
    limits: Limits = Field(default_factory=dict)
    link_diameter: LinkDiameter = None
    platform_diameter: PlatformDiameter = None
    cone_angle: ConeAngle = None
    tool: Tool = None
    aspect: Aspect = None
    block: Block = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        chosen = [k for k in ("samples", "grid", "target_error") if getattr(self, k) is not None]
        if len(chosen) > 1:
            raise ValueError(f"{chosen[0]} and {chosen[1]} exclude each other: give one")
        random = self.sampler != type(self).model_fields["sampler"].default
        if self.grid is not None and (self.replicates is not None or random):
            other = "replicates" if self.replicates is not None else "sampler"
            raise ValueError(f"grid and {other} exclude each other: a grid is not random")
        edges = self.regions
        if len(edges) < 2 or edges[0] != 0 or edges[-1] != 1 or not _ascending(edges):
            raise ValueError(
                f"regions {list(edges)} must ascend from 0 to 1, e.g. [0, 0.1, 0.3, 1]"
            )
        for name in ("aspect", "block"):
            if getattr(self, name) is not None and self.grid is not None:
                raise ValueError(f"{name} and grid exclude each other")
            if getattr(self, name) is not None and self.sampler == "lines":
                raise ValueError(f"{name} and sampler = lines exclude each other")
        return self

    @property
    def sampler_name(self) -> Literal["r-sequence", "sobol", "monte-carlo", "lines", "grid"]:
        """The sampler, the grid included."""
        return "grid" if self.grid is not None else self.sampler


class WorkspaceConfig(BaseModel):
    """A configuration with ``command = "workspace"``: the options of ``pmopt workspace``."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    mechanism: str = Field(description=MECHANISM_KEY)
    parameters: dict[str, Any] = Field(
        default_factory=dict,
        description="Design parameters by name, numbers. Default: the mechanism's own; "
        "`pmopt info` lists them with their units",
    )
    workspace: WorkspaceSettings = Field(
        default_factory=WorkspaceSettings,
        description="How the workspace is sampled and its dexterity measured",
    )
    seed: Seed = 1
    shape_grid: Annotated[int | None, SAMPLING] = Field(
        default=None, ge=0,
        description="Cells on each axis on which pieces and voids are counted, 0 for none. "
        "Default: 96, with four coordinates 28, with five 14",
    )  # fmt: skip


class SingularitySettings(Settings):
    """What ``pmopt singularities`` reads."""

    OWN = frozenset({"grid"})
    samples: Annotated[int | None, SAMPLING] = Field(
        default=None, ge=16, le=MAX_SAMPLES,
        description="Sample points behind the volumes of aspects. Default: 262,144",
    )  # fmt: skip
    sampler: PointSampler = "r-sequence"
    replicates: Replicates = None
    grid: Annotated[int | None, SAMPLING] = Field(
        default=None, ge=4, le=400,
        description="Cells on each axis on which aspects are distinguished. Default: 72 with three "
        "coordinates, 26 with four, 14 with five",
    )  # fmt: skip
    seed: Seed = 1
    working_mode: WorkingMode = None
    domain: Domain = Field(default_factory=dict)
    limits: Limits = Field(default_factory=dict)
    min_lci: MinLci = 0.0
    norm: NormOfIndex = "2"
    jacobian: Jacobian = None
    characteristic_length: CharacteristicLength = None
    link_diameter: LinkDiameter = None
    platform_diameter: PlatformDiameter = None
    cone_angle: ConeAngle = None
    tool: Tool = None


class SectionSettings(Settings):
    """What plane sections of a workspace read."""

    working_mode: WorkingMode = None
    domain: Domain = Field(default_factory=dict)
    limits: Limits = Field(default_factory=dict)
    min_lci: MinLci = 0.0
    norm: NormOfIndex = "2"
    jacobian: Jacobian = None
    characteristic_length: CharacteristicLength = None
    link_diameter: LinkDiameter = None
    platform_diameter: PlatformDiameter = None
    cone_angle: ConeAngle = None
    tool: Tool = None
    aspect: Aspect = None
    block: Block = None


class CapabilityWorkspace(Settings):
    """Which poses ``pmopt capability`` is about."""

    sampler: PointSampler = "r-sequence"
    working_mode: WorkingMode = None
    domain: Domain = Field(default_factory=dict)
    limits: Limits = Field(default_factory=dict)
    min_lci: MinLci = 0.0
    norm: NormOfIndex = "2"
    jacobian: Jacobian = None
    characteristic_length: CharacteristicLength = None
    link_diameter: LinkDiameter = None
    platform_diameter: PlatformDiameter = None
    cone_angle: ConeAngle = None
    tool: Tool = None


Speed = Annotated[float, Unit(f"{LENGTH}/s"), TASK, _SIZE]
Turn = Annotated[float, Unit("rad/s"), TASK, _SIZE]
Acceleration = Annotated[float, Unit(f"{LENGTH}/s^2"), TASK, _SIZE]
TurnAcceleration = Annotated[float, Unit("rad/s^2"), TASK, _SIZE]


class TaskSettings(Settings):
    """What ``pmopt capability`` asks of the motors, and how many poses it looks at."""

    OWN = frozenset({"samples"})
    speed: Speed = Field(
        default=0.0,
        description="Speed of the pose's translational coordinates, as one vector in any "
        "direction; other coordinates, parasitic ones too, only follow",
    )
    turn: Turn = Field(
        default=0.0, description="Rate of the pose's angles, as one vector in any direction"
    )
    acceleration: Acceleration = Field(
        default=0.0, description="Acceleration of the pose's translational coordinates"
    )
    angular_acceleration: TurnAcceleration = Field(
        default=0.0, description="Acceleration of the pose's angles"
    )
    point_speed: Speed = Field(
        default=0.0,
        description="Instead of coordinates: speed of the platform's centre in any direction that "
        "it can move, with the least turning",
    )
    rotation_speed: Turn = Field(
        default=0.0,
        description="Instead of coordinates: angular speed of the platform about any axis that it "
        "can turn about; with `point_speed` all motions within both",
    )
    point_acceleration: Acceleration = Field(
        default=0.0,
        description="Acceleration of the platform's centre, in the same way as `point_speed`",
    )
    rotation_acceleration: TurnAcceleration = Field(
        default=0.0,
        description="Angular acceleration of the platform, in the same way as `rotation_speed`",
    )
    force: Annotated[float, Unit("N"), TASK, _SIZE, OnCommandLine(name="tool-force")] = Field(
        default=0.0, description="Force on the platform's centre in any direction"
    )
    payload: Annotated[float, Unit("kg"), TASK, _SIZE] = Field(
        default=0.0, description="Mass on the platform"
    )
    payload_centre: Annotated[
        tuple[FiniteFloat, FiniteFloat, FiniteFloat], Field(strict=False), Unit(LENGTH), TASK
    ] = Field(
        default=(0.0, 0.0, 0.0), description="The payload's centre of mass, in the platform's frame"
    )
    motors: Annotated[dict[str, Any], MOTORS, OnCommandLine(metavar="NAME=VALUE,..")] = Field(
        default_factory=dict,
        description="What the joints can do: <joint>_rate (length unit/s, rad/s) and "
        "<joint>_effort (N, N m). Default: no limits, only what is needed is reported",
    )
    samples: Annotated[int, SAMPLING] = Field(
        default=1 << 16, ge=16, le=MAX_SAMPLES, description="Sample points"
    )
    seed: Seed = 1


class ClaimSettings(Settings):
    """What ``pmopt certify`` reads."""

    min_lci: Annotated[FiniteFloat, Unit("1"), PROOF] = Field(
        default=0.0, ge=0, le=1,
        description="Claim LCI >= X at every reachable pose. Default: the claim that none is "
        "singular",
    )  # fmt: skip
    time_budget: Annotated[FiniteFloat | None, Unit("s"), PROOF] = Field(
        default=None, gt=0,
        description="Seconds of work after which the claim is left undecided; compilation does not "
        "count. Default: 30, none with `box_budget`",
    )  # fmt: skip
    box_budget: BoxBudget = None
    working_mode: WorkingMode = None
    domain: Domain = Field(default_factory=dict)
    limits: Limits = Field(default_factory=dict)
    norm: NormOfIndex = "2"
    jacobian: Jacobian = None
    characteristic_length: CharacteristicLength = None


class VolumeSettings(Settings):
    """What guaranteed bounds of a volume read: ``pmopt workspace --certify``."""

    gap: Annotated[
        FiniteFloat, Unit("1"), PROOF, OnCommandLine("certify", "GAP", default=False)
    ] = Field(
        default=1e-2, gt=0, lt=1,
        description="Instead of samples: guaranteed bounds of the volume, which differ by "
        "at most the share GAP of it, and of the least and largest LCI",
    )  # fmt: skip
    time_budget: TimeBudget = None
    box_budget: BoxBudget = None
    working_mode: WorkingMode = None
    domain: Domain = Field(default_factory=dict)
    limits: Limits = Field(default_factory=dict)
    norm: NormOfIndex = "2"
    jacobian: Jacobian = None
    characteristic_length: CharacteristicLength = None


def _ascending(values: tuple[float, ...]) -> bool:
    return all(a < b for a, b in zip(values, values[1:], strict=False))


def split_samples(samples: int, replicates: int | None) -> tuple[int, int]:
    """Return (replicates, samples of each).

    Unless the number of replicates is given, it is the divisor of ``samples`` between 8 and 32
    nearest to the default, so that the total is exactly what was asked for; where there is none,
    the total is rounded up.
    """
    if replicates is None:
        divisors = [r for r in range(8, 33) if samples % r == 0]
        replicates = min(
            divisors, key=lambda r: abs(r - DEFAULT_REPLICATES), default=DEFAULT_REPLICATES
        )
    return replicates, math.ceil(samples / replicates)
