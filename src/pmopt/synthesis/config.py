"""The configuration of a ``pmopt pareto`` run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from pmopt.analysis.reads import TOOL_NEEDS, Reads
from pmopt.analysis.sampling.design_space import TOOL
from pmopt.analysis.settings import (
    MAX_SAMPLES,
    MECHANISM_KEY,
    SAMPLING,
    FiniteFloat,
    WorkspaceSettings,
    named_mechanism,
)
from pmopt.analysis.validation import read_config, validated
from pmopt.errors import InputError
from pmopt.inputs.fields import Unit, UnitByName, UnitInWords
from pmopt.inputs.overrides import overridden
from pmopt.inputs.quantities import QuantityError, as_quantity
from pmopt.mechanisms import Mechanism
from pmopt.synthesis.objectives import OBJECTIVES, SENSES, ObjectiveName

#: Samples of a design where a search that chooses their number itself does not say, about what it
#: takes on average: on points anywhere and on lines.
SEARCH_SAMPLES = 20_000
SEARCH_ON_LINES = 1 << 12
#: What ``samples`` may say instead of a number, and the default.
ADAPTIVE = "adaptive"


#: The unit of a bound.
QUANTITY = UnitInWords("the quantity's")


class AlgorithmSettings(BaseModel):
    """The ``[algorithm]`` table."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    name: Literal["nsga2"] = Field(default="nsga2", description="The algorithm of the search")
    population: int = Field(
        default=200,
        ge=4,
        le=100_000,
        description="Designs of a generation, and largest size of the front",
    )
    generations: int = Field(
        default=200, ge=1, le=1_000_000,
        description="Number of generations; with a larger number a finished run continues",
    )  # fmt: skip
    crossover_eta: FiniteFloat = Field(
        default=20.0, gt=0,
        description="Distribution index of simulated binary crossover: larger is nearer to parents",
    )  # fmt: skip
    crossover_probability: FiniteFloat = Field(
        default=0.9, ge=0, le=1, description="Probability that two parents are crossed"
    )
    mutation_eta: FiniteFloat = Field(
        default=20.0, gt=0,
        description="Distribution index of polynomial mutation: larger stays nearer to the design",
    )  # fmt: skip
    seed: int = Field(
        default=1, ge=0, lt=2**63, description="Seed of the search and of all sample points"
    )
    reference: Annotated[dict[ObjectiveName, FiniteFloat], UnitByName()] = Field(
        default_factory=dict,
        description="Point from which hypervolumes are measured, by objective. Default: 0 for "
        "what is maximised, for what is minimised the largest value over designs of the bounds",
    )


class ConstraintSettings(BaseModel):
    """One entry of the ``[constraints]`` table: bounds on a quantity, inclusive."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    min: Annotated[FiniteFloat | None, QUANTITY] = Field(default=None, description="Least value")
    max: Annotated[FiniteFloat | None, QUANTITY] = Field(default=None, description="Largest value")

    @model_validator(mode="after")
    def _consistent(self) -> ConstraintSettings:
        if self.min is None and self.max is None:
            raise ValueError("needs min or max")
        if self.min is not None and self.max is not None and self.min > self.max:
            raise ValueError(f"min {self.min} is larger than max {self.max}")
        return self


class FinalSettings(BaseModel):
    """The ``[final]`` table: how finely the designs of the front are measured at the end."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    target_error: Annotated[FiniteFloat, Unit("1")] = Field(
        default=5e-4, ge=1e-7, lt=1,
        description="Relative standard error of volume and GCI to which each design is measured",
    )  # fmt: skip


class SearchWorkspace(WorkspaceSettings):
    """The ``[workspace]`` table of a search, which may choose the number of samples itself."""

    samples: Annotated[int | None, SAMPLING] = Field(
        default=None, ge=16, le=MAX_SAMPLES,
        description='Sample points, over all replicates. Default: `"adaptive"`, which doubles them '
        "when the front has stalled",
    )  # fmt: skip


class RunConfig(BaseModel):
    """A validated, frozen configuration; see :func:`load_config`."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    mechanism: str = Field(description=MECHANISM_KEY)
    objectives: tuple[ObjectiveName, ...] = Field(
        default=("volume", "gci"), strict=False,
        description="Two or more. All are maximised but "
        + ", ".join(f"`{name}`" for name, sense in SENSES.items() if sense < 0),
    )  # fmt: skip
    parameters: dict[str, Any] = Field(
        default_factory=dict,
        description="Design parameters by name: a range `[lower, upper]` is searched, a number is "
        "fixed. Default: the mechanism's own bounds; `pmopt info` lists them with their units",
    )
    workspace: SearchWorkspace = Field(
        default_factory=SearchWorkspace,
        description="How each design's workspace is sampled and its dexterity measured",
    )
    algorithm: AlgorithmSettings = Field(
        default_factory=AlgorithmSettings, description="How designs are searched"
    )
    constraints: dict[ObjectiveName, ConstraintSettings] = Field(
        default_factory=dict,
        description="Bounds, inclusive, on a quantity that may be an objective",
    )
    final: FinalSettings = Field(
        default_factory=FinalSettings,
        description="How finely the designs of the front are measured at the end",
    )

    @model_validator(mode="before")
    @classmethod
    def _adaptive(cls, data: Any) -> Any:
        """Treat ``samples = "adaptive"`` as the default, unless another size is given."""
        workspace = data.get("workspace") if isinstance(data, dict) else None
        if not isinstance(workspace, dict) or not isinstance(workspace.get("samples"), str):
            return data
        if workspace["samples"] != ADAPTIVE:
            raise ValueError(
                f"workspace.samples={workspace['samples']!r} must be a number or {ADAPTIVE}"
            )
        for other in ("grid", "target_error"):
            if workspace.get(other) is not None:
                raise ValueError(f"workspace: samples and {other} exclude each other: give one")
        rest = {key: value for key, value in workspace.items() if key != "samples"}
        return {**data, "workspace": rest}

    @property
    def adaptive(self) -> bool:
        """Whether the search chooses the number of samples."""
        workspace = self.workspace
        return workspace.samples is workspace.grid is workspace.target_error is None

    @property
    def search_samples(self) -> int | None:
        """Samples of a design in the search; None on grids and to a target error."""
        if not self.adaptive:
            return self.workspace.samples
        return SEARCH_ON_LINES if self.workspace.sampler == "lines" else SEARCH_SAMPLES

    @model_validator(mode="after")
    def _consistent(self) -> RunConfig:
        if len(self.objectives) < 2 or len(set(self.objectives)) < len(self.objectives):
            raise ValueError(
                f"objectives {list(self.objectives)} must be at least two different ones of "
                f"{', '.join(OBJECTIVES)}"
            )
        for name in self.algorithm.reference:
            if name not in self.objectives:
                raise ValueError(
                    f"algorithm.reference: {name} is not an objective of this search, allowed: "
                    f"{', '.join(self.objectives)}"
                )
        return self


def resolve_config(data: Any, where: str) -> RunConfig:
    """Validate a configuration and complete it: every key present, every name checked.

    Parameters
    ----------
    data : dict
        As TOML gives it.
    where : str
        What errors call it, usually the file's name.

    Raises
    ------
    InputError
        One line: file, key, value and what is allowed.
    """
    mechanism = named_mechanism(data, where)
    config = validated(RunConfig, data, where, mechanism.units)
    parameters = _parameters(config, mechanism, where)
    workspace = config.workspace
    mechanism.check_mode(workspace.working_mode, f"{where}: workspace.working_mode")
    mechanism.check_ranges(workspace.domain, mechanism.pose, f"{where}: workspace.domain")
    tool = TOOL if workspace.tool is not None else ()
    mechanism.check_ranges(
        workspace.limits, (*mechanism.limited, *tool), f"{where}: workspace.limits"
    )
    space = {"projected_volume"} & {*config.objectives, *config.constraints}
    needs = (f"{TOOL_NEEDS[0]}, or projected_volume", TOOL_NEEDS[1])
    Reads(
        f"{where}: workspace", WorkspaceSettings,
        {} if space else {"tool": needs},
    ).check(workspace)  # fmt: skip
    workspace = workspace.model_copy(
        update={
            "working_mode": mechanism.check_mode(workspace.working_mode),
            "jacobian": workspace.jacobian
            or ("homogenized" if workspace.characteristic_length else mechanism.default_jacobian),
        }
    )
    return config.model_copy(
        update={"mechanism": mechanism.name, "parameters": parameters, "workspace": workspace}
    )


def _parameters(
    config: RunConfig, mechanism: Mechanism, where: str
) -> dict[str, float | tuple[float, float] | None]:
    """Return every parameter as a fixed number, a range or None (unset)."""
    place = f"{where}: parameters"
    plain = mechanism.plain_names(config.parameters, mechanism.parameters, place)
    resolved: dict[str, float | tuple[float, float] | None] = {}
    for parameter in mechanism.parameters:
        own = parameter.default if parameter.bounds is None else parameter.bounds
        given = plain.get(parameter.name, own)
        if not isinstance(given, list | tuple):
            resolved[parameter.name] = mechanism.check_parameter(parameter, given, place)
            continue
        unit = mechanism.unit(parameter)
        try:
            ends, reason = [as_quantity(v, unit) for v in given], ""
        except QuantityError as error:
            ends, reason = [], f"{error}; "
        if len(ends) != 2 or not all(map(parameter.accepts, ends)) or not ends[0] < ends[1]:
            raise InputError(
                f"{place}: {parameter.name}={list(given)} is not allowed: {reason}a range is "
                f"[lower, upper] with lower < upper, each {parameter.allowed()}, in {unit}"
            )
        resolved[parameter.name] = (ends[0], ends[1])
    if not any(isinstance(v, tuple) for v in resolved.values()):
        raise InputError(f"{place}: every parameter is fixed, at least one needs a range")
    return resolved


def load_config(path: Path, sets: Sequence[str] = ()) -> RunConfig:
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
    data = overridden(read_config(path, "pareto"), sets)
    return resolve_config(data, str(path))
