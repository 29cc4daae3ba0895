"""From settings to designs: the box of their poses, and the constants of the kernel."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.record import Subject
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler.program_text import Checks
from pmopt.compiler.records import flat, size
from pmopt.errors import InputError
from pmopt.kernels.vectors import Vec3
from pmopt.mechanisms.mechanism import (
    Coordinate,
    JacobianKind,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
)
from pmopt.numerics.elementary import cos

#: Where the tool point is in the base frame; limits can be set on it where there is a tool.
TOOL = tuple(Coordinate(f"tool_{axis}", "length", f"{axis} of the tool point") for axis in "xyz")
#: A domain and the reach are apart if more than this share of their ends' size is between them.
_TOUCHING = 1e-9


@dataclass(frozen=True)
class Design:
    """One design ready to be evaluated: kernel constants and the box its points fill.

    ``cut`` (d, 2) says which faces of the box, lower and upper, cut off what can be reached.
    ``given`` is the domain as it was given, the box's own ends in the place of infinite ones and of
    coordinates without; ``void`` says that no pose in reach is in the domain, proven.
    """

    parameters: Parameters
    length: float
    limits: Ranges
    lower: Vector
    width: Vector
    cut: NDArray[np.bool_]
    constants: list[float]
    given: Ranges = field(default_factory=dict)
    void: bool = False

    @property
    def box_volume(self) -> float:
        """Volume of the box; 0 where nothing can be reached."""
        return float(np.prod(self.width))


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """Which designs and poses settings are about, every name in them checked.

    Attributes
    ----------
    mechanism : Mechanism
    settings : WorkspaceSettings
    working_mode : str
    jacobian : {"raw", "homogenized"}
        That the index is of.
    domain, limits : dict
        Of pose coordinates, and of joints and the tool's place: those that are given.
    checks : tuple of str
        What a pose has to keep beside the kernel's own limits; see
        :class:`pmopt.compiler.program_text.Recipe`.
    """

    mechanism: Mechanism
    settings: WorkspaceSettings
    working_mode: str
    jacobian: JacobianKind
    domain: Ranges
    limits: Ranges
    checks: tuple[str, ...]

    @classmethod
    def of(
        cls, mechanism: Mechanism, settings: WorkspaceSettings, where: str = "workspace"
    ) -> DesignSpace:
        """Return the designs that settings are about.

        Raises
        ------
        InputError
            For names in the settings that the mechanism does not have, and for what it does not
            offer.
        """
        working_mode = mechanism.check_mode(settings.working_mode, f"{where}: working_mode")
        domain = mechanism.check_ranges(settings.domain, mechanism.pose, f"{where}: domain")
        tool = TOOL if settings.tool is not None else ()
        limits = mechanism.check_ranges(
            settings.limits, (*mechanism.limited, *tool), f"{where}: limits"
        )
        if settings.cone_angle is not None and not mechanism.cones:
            raise InputError(f"{where}: cone_angle: {mechanism.name} has no passive U or S joints")
        if settings.sampler == "lines" and mechanism.line is None:
            raise InputError(
                f"{where}: sampler=lines is not offered by {mechanism.name}, "
                "allowed: r-sequence, sobol, monte-carlo"
            )
        if settings.block is not None:
            wanted = "length" if settings.block == "translational" else "angle"
            if not any(c.kind == wanted for c in mechanism.pose):
                raise InputError(
                    f"{where}: block: {mechanism.name} has no {settings.block} freedom"
                )
        jacobian: JacobianKind = settings.jacobian or mechanism.default_jacobian
        if settings.characteristic_length is not None:
            jacobian = "homogenized"
        checks = {
            "clearance": settings.link_diameter,
            "cone": settings.cone_angle,
            "tool": settings.tool,
        }
        return cls(
            mechanism, settings, working_mode, jacobian, domain, limits,
            tuple(name for name, given in checks.items() if given is not None),
        )  # fmt: skip

    def subject(self, design: Design) -> Subject:
        """Return what results of a design are of."""
        return Subject.of(
            self.mechanism, design.parameters, self.working_mode, design.given, design.limits
        )

    def design(self, parameters: Parameters, length: float | None = None) -> Design:
        """Return a design ready to be evaluated, its box cut to the domain.

        Parameters
        ----------
        parameters : mapping
            Complete.
        length : float, optional
            Characteristic length; default: that of the settings, in the place of the optimal one,
            which :class:`pmopt.analysis.sampling.sampler.Sampler` looks for, the mechanism's.
        """
        mechanism = self.mechanism
        limits = {**mechanism.default_limits(parameters), **self.limits}
        lower, upper = mechanism.reach_box(parameters, limits)
        whole = np.stack([lower, upper], axis=1)
        domain = {**mechanism.default_domain(parameters), **self.domain}
        for i, coordinate in enumerate(mechanism.pose):
            low, high = domain.get(coordinate.name, (-math.inf, math.inf))
            lower[i], upper[i] = max(lower[i], low), min(upper[i], high)
        cut = np.stack([lower, upper], axis=1) != whole
        asked = {
            c.name: _as_given(self.domain.get(c.name), domain.get(c.name), low, high)
            for c, low, high in zip(mechanism.pose, lower.tolist(), upper.tolist(), strict=True)
        }
        # What only touches the reach, to rounding, is not proven to be out of it.
        slack = _TOUCHING * np.maximum(np.abs(lower), np.abs(upper))
        void = bool((lower - upper > slack).any())
        width = upper - lower
        if not np.all(width > 0):
            width = np.zeros_like(width)
        if length is None:
            length = self._length(parameters)
        own = mechanism.kernel_constants(parameters, self.working_mode, length, limits)
        constants = flat(own)
        if self.checks:
            constants += flat(self._check_constants())
        return Design(parameters, length, limits, lower, width, cut, constants, asked, void)

    def _length(self, parameters: Parameters) -> float:
        if self.jacobian != "homogenized":
            return 1.0
        given = self.settings.characteristic_length
        if isinstance(given, int | float):
            return float(given)
        return self.mechanism.characteristic_length(parameters)

    def nothing(self, parameters: Parameters) -> Design:
        """Return a design with an empty box, for one that cannot be made ready."""
        axes = len(self.mechanism.pose)
        count = size(self.mechanism.constants)
        count += size(Checks) if self.checks else 0
        return Design(
            parameters, 1.0, {}, np.zeros(axes), np.zeros(axes), np.zeros((axes, 2), dtype=bool),
            [0.0] * count,
        )  # fmt: skip

    def _check_constants(self) -> Checks:
        """Return what the margin's checks compare with; see pmopt.compiler.program_text."""
        settings = self.settings
        link = settings.link_diameter or 0.0
        half_sum = (link + (settings.platform_diameter or link)) / 2
        ends = [self.limits.get(c.name, (-math.inf, math.inf)) for c in TOOL]
        return Checks(
            limbs2=link * link,
            platform2=half_sum * half_sum,
            cosine=-2.0 if settings.cone_angle is None else cos(settings.cone_angle),
            tool=Vec3(*(settings.tool or (0.0, 0.0, 0.0))),
            low=Vec3(*(low for low, _ in ends)),
            high=Vec3(*(high for _, high in ends)),
        )


def _as_given(
    given: tuple[float, float] | None,
    searched: tuple[float, float] | None,
    low: float,
    high: float,
) -> tuple[float, float]:
    """Return the domain of a coordinate: as given, else by default, else what can be reached."""
    if given is None:
        if low <= high or searched is None:
            return low, high
        given = searched
    return (given[0] if math.isfinite(given[0]) else low,
            given[1] if math.isfinite(given[1]) else high)  # fmt: skip
