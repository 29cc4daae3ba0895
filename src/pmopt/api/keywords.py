"""The keywords of each analysis: what it reads and nothing else, for people, editors and mypy.

A name that is not among them is a type error and, at run time, one line with the nearest name.
Their names and types are those of the fields of the analysis's settings
(:mod:`pmopt.analysis.settings`): a type checker needs them written out, and tests hold the two
together.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, ParamSpec, TypedDict, TypeVar

from pmopt.analysis.settings import Norm, WorkspaceSettings
from pmopt.api.inputs import Ends, Number, Sampling
from pmopt.errors import unknown_name
from pmopt.mechanisms.mechanism import JacobianKind

#: Ends by the name of a coordinate, an angle also in degrees under its name with ``_deg``.
Ranges = Mapping[str, Ends]
#: Values by the name of a coordinate or parameter, an angle also under its name with ``_deg``.
Values = Mapping[str, Number]
#: Design parameters by name; those left out take their defaults, None unsets an optional one.
Params = Mapping[str, Number | None]
#: A place in the platform's frame.
Point = tuple[Number, Number, Number] | Sequence[float] | list[str]

Sampler = Literal["r-sequence", "sobol", "monte-carlo"]

_P = ParamSpec("_P")
_R = TypeVar("_R")


class _Place(TypedDict, total=False):
    """Which poses count: working mode, ranges of the pose and of joints."""

    working_mode: str | None
    domain: Ranges
    limits: Ranges


class _Index(TypedDict, total=False):
    """What the index of a pose depends on."""

    norm: Norm
    jacobian: JacobianKind | None
    characteristic_length: Number | None


class _Checks(TypedDict, total=False):
    """Further conditions on a pose: clearances of links, cones of joints, the tool's place."""

    link_diameter: Number | None
    platform_diameter: Number | None
    cone_angle: Number | None
    cone_angle_deg: float
    tool: Point | None


class WorkspaceOptions(_Place, _Index, _Checks, total=False):
    """Keywords of :func:`pmopt.workspace`.

    ``sampling``: a :class:`pmopt.Sampling` in the place of its single keywords;
    ``shape_grid``: cells per axis on which pieces and voids are counted, 0 leaves the shape out;
    ``scheduler``: address of a Dask scheduler whose workers sample; ``threads`` and it change
    nothing of the result. The others are the keys of ``[workspace]`` in a configuration.
    """

    seed: int
    threads: int | None
    shape_grid: int | None
    scheduler: str | None
    sampling: Sampling | None
    sampler: Literal["r-sequence", "sobol", "monte-carlo", "lines"]
    samples: int | None
    replicates: int | None
    grid: int | None
    target_error: Number | None
    min_lci: Number
    regions: Sequence[float]
    aspect: Literal["home"] | None
    block: Literal["translational", "rotational"] | None


class SectionOptions(_Place, _Index, _Checks, total=False):
    """Keywords of :meth:`pmopt.Design.sections`; ``resolution``: points along each axis."""

    threads: int | None
    resolution: int
    min_lci: Number
    aspect: Literal["home"] | None
    block: Literal["translational", "rotational"] | None


class SingularityOptions(_Place, _Index, _Checks, total=False):
    """Keywords of :func:`pmopt.singularities`; ``grid``: cells an axis for the aspects."""

    sampling: Sampling | None
    seed: int
    threads: int | None
    grid: int | None
    sampler: Sampler
    samples: int | None
    replicates: int | None
    min_lci: Number


class CertifyOptions(_Place, _Index, total=False):
    """Keywords of :func:`pmopt.certify`: budgets in seconds (default 30) and boxes."""

    time_budget: Number | None
    box_budget: int | None
    min_lci: Number


class CertifyVolumeOptions(_Place, _Index, total=False):
    """Keywords of :func:`pmopt.certify_volume`: relative gap, budgets in seconds and boxes."""

    gap: Number
    time_budget: Number | None
    box_budget: int | None


class CapabilityWorkspace(_Place, _Index, _Checks, total=False):
    """Settings of the workspace that :func:`pmopt.capability` reads."""

    sampler: Sampler
    min_lci: Number


class CapabilityOptions(TypedDict, total=False):
    """Keywords of :func:`pmopt.capability`.

    ``motors``: ``<joint>_rate`` (length unit/s, rad/s) and ``<joint>_effort`` (N, N m) that there
    are; ``payload`` in kg at ``payload_centre`` in the platform's frame; then the sizes of what is
    to be done, see :class:`pmopt.analysis.sizing.actuators.Task`.
    """

    motors: Mapping[str, Number] | None
    payload: Number
    payload_centre: Point
    samples: int
    seed: int
    threads: int | None
    workspace: CapabilityWorkspace | None
    speed: Number
    acceleration: Number
    turn: Number
    angular_acceleration: Number
    force: Number
    point_speed: Number
    point_acceleration: Number
    rotation_speed: Number
    rotation_acceleration: Number


class JacobianOptions(TypedDict, total=False):
    """Keywords of :func:`pmopt.jacobian`."""

    kind: JacobianKind | None
    characteristic_length: float | Literal["optimal"] | None
    norm: Norm
    limits: Ranges | None


class MobilityOptions(TypedDict, total=False):
    """Keywords of :func:`pmopt.mobility`; ``samples``: of the full-cycle check."""

    layout: str | None
    pose: Values | None
    working_mode: str | None
    samples: int
    seed: int


class RunOptions(TypedDict, total=False):
    """Keywords of :func:`pmopt.motion` and :func:`pmopt.simulate`."""

    force: bool
    threads: int | None


class ParetoOptions(TypedDict, total=False):
    """Keywords of :func:`pmopt.pareto`."""

    force: bool
    resume: bool
    threads: int | None
    scheduler: str | None


class BatchOptions(TypedDict, total=False):
    """Keywords of :func:`pmopt.batch`; ``shard="2/5"``: only the second of five parts."""

    workers: int | None
    threads: int | None
    scheduler: str | None
    shard: str | None
    force: bool
    notify: Callable[[str], None] | None


def keywords_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return the keywords of a function: its own and those of its ``Unpack``."""
    found: list[str] = []
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            # Only this annotation is looked up: those of results are not imported.
            options = parameter.annotation.removeprefix("Unpack[").removesuffix("]")
            found += function.__globals__[options].__annotations__
        elif parameter.kind is not parameter.VAR_POSITIONAL and name != "self":
            found.append(name)
    return tuple(found)


def named(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Refuse a keyword that a function does not have, in one line with the nearest name.

    What is a setting of other analyses passes: its own check says who reads it.
    """
    known: set[str] = set()

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        if kwargs and not known:
            known.update(keywords_of(function))
        for name in kwargs:
            if name not in known and not _setting_elsewhere(name, known):
                raise unknown_name(function.__name__, name, sorted(known))
        return function(*args, **kwargs)

    return checked


def _setting_elsewhere(name: str, known: set[str]) -> bool:
    """Return whether a keyword is a setting, of a function that reads some of them."""
    return "domain" in known and name in WorkspaceSettings.model_fields


def settings_of(options: Mapping[str, Any], own: Sequence[str]) -> dict[str, Any]:
    """Return the settings among the keywords: all but the analysis's own, tables as plain dicts."""
    return {
        name: dict(value) if isinstance(value, Mapping) else value
        for name, value in options.items()
        if name not in own
    }
