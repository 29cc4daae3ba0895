"""What a motion asks of its joints: peaks, RMS values, and limits that it breaks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pmopt.analysis.motion.config import ACCELERATION, EFFORT, POWER, RATE
from pmopt.analysis.motion.records import Motion, Span, stretches
from pmopt.mechanisms.mechanism import Mechanism, Ranges, Vector
from pmopt.units import ANGLE, JOULE, WATT, effort_unit, exact, per_second


class Series(NamedTuple):
    """A quantity over time, (N,), and its unit."""

    values: Vector
    unit: str


@dataclass(frozen=True)
class Demand:
    """What a motion asks of one joint in one quantity.

    Attributes
    ----------
    joint : str
    quantity : {"position", "rate", "acceleration", "effort", "power"}
    unit : str
    low, high : float
        Least and greatest value.
    peak : float
        Largest size.
    at : float
        s, when it is met first.
    rms : float or None
        Root of the mean square over time; None for positions.
    """

    joint: str
    quantity: str
    unit: str
    low: float
    high: float
    peak: float
    at: float
    rms: float | None


def rms(t: Vector, values: Vector) -> float:
    """Return the root of the mean square over time, by the trapezoidal rule."""
    square = values**2
    weights = np.diff(t)
    mean = float(((square[1:] + square[:-1]) * weights).sum() / 2 / (t[-1] - t[0]))
    return math.sqrt(mean)


def columns(motion: Motion, mechanism: Mechanism) -> dict[str, Series]:
    """Return every quantity of a motion by the name its column has, in order.

    Pose, parasitic coordinates, joints and passive joints; then rate and acceleration of each; then
    effort and power of the actuated joints; then angular velocity and acceleration of the platform
    and energies. A joint that is also a pose coordinate is listed once.
    """
    courses = (motion.pose, motion.parasitic, motion.joints, motion.passive)
    found: dict[str, Series] = {}
    derivatives: dict[str, Series] = {}
    for course in courses:
        for k, coordinate in enumerate(course.coordinates):
            if coordinate.name in found:
                continue
            unit = mechanism.unit(coordinate)
            found[coordinate.name] = Series(course.values[:, k], unit)
            derivatives[f"{coordinate.name}{RATE}"] = Series(course.rates[:, k], per_second(unit))
            derivatives[f"{coordinate.name}{ACCELERATION}"] = Series(
                course.accelerations[:, k], per_second(unit, 2)
            )
    found |= derivatives
    for k, joint in enumerate(motion.joints.coordinates):
        if motion.effort is not None:
            found[f"{joint.name}{EFFORT}"] = Series(motion.effort[:, k], effort_unit(joint.kind))
        if motion.power is not None:
            found[f"{joint.name}{POWER}"] = Series(motion.power[:, k], WATT)
    for order, ending in enumerate(("", RATE)):
        for k, axis in enumerate("xyz"):
            found[f"omega_{axis}{ending}"] = Series(
                motion.angular[:, order, k], per_second(ANGLE, order + 1)
            )
    if motion.kinetic is not None and motion.potential is not None:
        found["kinetic_energy"] = Series(motion.kinetic, JOULE)
        found["potential_energy"] = Series(motion.potential, JOULE)
    return found


def demands(motion: Motion, mechanism: Mechanism) -> tuple[Demand, ...]:
    """Return what a feasible motion asks of its actuated joints: what a motor is sized by."""
    series = columns(motion, mechanism)
    found = []
    for joint in motion.joints.coordinates:
        for quantity in ("position", "rate", "acceleration", "effort", "power"):
            one = series.get(joint.name if quantity == "position" else f"{joint.name}_{quantity}")
            if one is None:
                continue
            size = np.abs(one.values)
            at = int(np.argmax(size))
            found.append(
                Demand(
                    joint.name, quantity, one.unit, float(one.values.min()),
                    float(one.values.max()), float(size[at]), float(motion.t[at]),
                    None if quantity == "position" else rms(motion.t, one.values),
                )
            )  # fmt: skip
    return tuple(found)


def broken_limits(motion: Motion, mechanism: Mechanism, limits: Ranges) -> tuple[Span, ...]:
    """Return where rates, accelerations, efforts and power leave their limits.

    Parameters
    ----------
    motion : Motion
    mechanism : Mechanism
    limits : Ranges
        By ``<joint>_rate``, ``_acceleration``, ``_effort`` and ``_power``.
    """
    series = columns(motion, mechanism)
    spans = []
    for name, (low, high) in limits.items():
        values, unit = series[name]
        with np.errstate(invalid="ignore"):
            miss = np.maximum(low - values, values - high)
        miss = np.where(np.isnan(miss), -np.inf, miss)
        for first, last in stretches(miss > 0):
            worst = first + int(np.argmax(miss[first : last + 1]))
            value = float(values[worst])
            side, limit = ("below", low) if value < low else ("above", high)
            spans.append(
                Span(
                    first, last, worst, name, float(miss[worst]), unit,
                    f"{name} = {value:.6g} {unit} is {side} {exact(limit)} {unit}",
                )
            )  # fmt: skip
    return tuple(sorted(spans, key=lambda span: (span.first, span.what)))
