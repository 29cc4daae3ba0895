"""How a workspace is to be sampled and its dexterity measured."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, model_validator

from pmopt.analysis.validation import validated
from pmopt.errors import InputError
from pmopt.inputs.fields import LENGTH, Unit, UnitByName
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.mechanism import JacobianKind

Norm = Literal["2", "fro"]
DEFAULT_SAMPLES = 1 << 22
DEFAULT_REPLICATES = 16
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


class WorkspaceSettings(BaseModel):
    """The ``[workspace]`` table of a configuration, and the options of ``pmopt workspace``.

    Names of coordinates and working modes are checked against the mechanism when it is known.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    sampler: Literal["r-sequence", "sobol", "monte-carlo", "lines"] = Field(
        default="r-sequence",
        description="How sample points are placed. `lines` is exact along one coordinate and the "
        "fastest where the mechanism offers it",
    )
    samples: int | None = Field(
        default=None, ge=16, le=MAX_SAMPLES,
        description="Sample points, over all replicates. Default: 4,194,304; in a search "
        '`"adaptive"`, which doubles them when the front has stalled',
    )  # fmt: skip
    replicates: int | None = Field(
        default=None, ge=4, le=256,
        description="Independent randomisations, from which errors are estimated. Default: about "
        "16, with `target_error` 32",
    )  # fmt: skip
    grid: int | None = Field(
        default=None, ge=4, le=30_000,
        description="Cells on each axis of a regular grid, instead of `samples`",
    )  # fmt: skip
    target_error: Annotated[FiniteFloat | None, Unit("1")] = Field(
        default=None, gt=0, lt=1,
        description="Relative standard error of volume and GCI to sample to, instead of `samples`",
    )  # fmt: skip
    working_mode: str | None = Field(
        default=None,
        description="By name; `pmopt info` lists them. Default: the mechanism's first",
    )
    norm: Annotated[Norm, BeforeValidator(_norm)] = Field(
        default="2",
        description="Norm of the index LCI: smallest over largest singular value, or Frobenius",
    )
    jacobian: JacobianKind | None = Field(
        default=None,
        description="Whether rates of angles are made lengths by a characteristic length before "
        "the index is taken. Default: the mechanism's",
    )
    characteristic_length: Annotated[
        Annotated[float, Field(gt=0, allow_inf_nan=False)] | Literal["optimal"] | None,
        BeforeValidator(_length),
        Unit(LENGTH),
    ] = Field(
        default=None,
        description="Of the homogenized Jacobian; `optimal` is the one with the largest GCI. "
        "Default: the mechanism's",
    )
    min_lci: Annotated[FiniteFloat, Unit("1")] = Field(
        default=0.0, ge=0, le=1, description="Poses with a smaller index do not count"
    )
    regions: Annotated[tuple[FiniteFloat, ...], Field(strict=False)] = Field(
        default=(0.0, 0.1, 0.3, 1.0),
        description="Edges of the dexterity regions, ascending from 0 to 1",
    )
    domain: Annotated[dict[str, Annotated[Range, Field(strict=False)]], UnitByName()] = Field(
        default_factory=dict,
        description="Range of each pose coordinate that is named. Default: the mechanism's own "
        "search domain",
    )
    limits: Annotated[dict[str, Annotated[Range, Field(strict=False)]], UnitByName()] = Field(
        default_factory=dict,
        description="Range of each joint that is named, passive ones too, and of the tool's place. "
        "Default: the mechanism's own limits",
    )
    link_diameter: Annotated[FiniteFloat | None, Unit(LENGTH)] = Field(
        default=None, gt=0,
        description="Links are capsules of this diameter that must not meet. Default: not checked",
    )  # fmt: skip
    platform_diameter: Annotated[FiniteFloat | None, Unit(LENGTH)] = Field(
        default=None, gt=0,
        description="Diameter of the platform's spokes and of the tool; needs `link_diameter`, "
        "which is the default",
    )  # fmt: skip
    cone_angle: Annotated[FiniteFloat | None, Unit("rad")] = Field(
        default=None, gt=0, le=math.pi,
        description="Largest angle of passive U and S joints from their direction at home. "
        "Default: not checked",
    )  # fmt: skip
    tool: Annotated[
        tuple[FiniteFloat, FiniteFloat, FiniteFloat] | None, Field(strict=False), Unit(LENGTH)
    ] = Field(
        default=None,
        description="A point in the platform's frame; positions reached are then the tool's",
    )
    aspect: Literal["home"] | None = Field(
        default=None,
        description="Count only the region around home that holds no forward or constraint "
        "singularity",
    )
    block: Literal["translational", "rotational"] | None = Field(
        default=None,
        description="Take the index of the Jacobian's rows for lengths or for angles alone",
    )

    @model_validator(mode="after")
    def _consistent(self) -> WorkspaceSettings:
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
        if self.characteristic_length is not None and self.jacobian == "raw":
            raise ValueError("characteristic_length needs jacobian = homogenized, not raw")
        if self.platform_diameter is not None and self.link_diameter is None:
            raise ValueError("platform_diameter needs link_diameter")
        for name in ("aspect", "block"):
            if getattr(self, name) is not None and self.grid is not None:
                raise ValueError(f"{name} and grid exclude each other")
            if getattr(self, name) is not None and self.sampler == "lines":
                raise ValueError(f"{name} and sampler = lines exclude each other")
        for table in ("domain", "limits"):
            for name, (low, high) in getattr(self, table).items():
                if not low < high:
                    raise ValueError(f"{table}.{name}=[{low}, {high}]: lower < upper is needed")
        return self

    @property
    def sampler_name(self) -> Literal["r-sequence", "sobol", "monte-carlo", "lines", "grid"]:
        """The sampler, the grid included."""
        return "grid" if self.grid is not None else self.sampler


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
