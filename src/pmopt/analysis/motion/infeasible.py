"""Why a motion is infeasible: the limb, joint or limit, and by how much."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.limits import of_limb
from pmopt.analysis.motion.records import (
    Span,
    Values,
    stretches,
)
from pmopt.mechanisms.mechanism import (
    InverseSolution,
    Mechanism,
    Parameters,
    Ranges,
    Vector,
    within,
    wrap_angle,
)
from pmopt.units import exact, unit_of

#: Instants of an infeasible stretch that are looked at for the reason and the largest miss.
_LOOKS = 40


def out_of_reach(
    mechanism: Mechanism,
    parameters: Parameters,
    mode: str,
    limits: Ranges,
    poses: Values,
    out: NDArray[np.bool_],
    margin: Vector,
) -> list[Span]:
    """Return the stretches that no limb reaches or some limit excludes, each by its reason."""
    spans = []
    for first, last in stretches(out):
        looks = np.unique(np.linspace(first, last, _LOOKS).astype(int)).tolist()
        looks.append(first + int(np.argmin(margin[first : last + 1])))
        misses = []
        for k in sorted(set(looks)):
            pose = dict(zip([c.name for c in mechanism.pose], poses[k].tolist(), strict=True))
            misses.append((k, *_miss(mechanism, parameters, mode, limits, pose)))
        k, what, miss, unit, text = max(misses, key=lambda found: found[2])
        spans.append(Span(first, last, k, what, miss, unit, text))
    return spans


def unknown(lost: NDArray[np.bool_]) -> list[Span]:
    """Return where poses are reached but do not determine how the mechanism moves."""
    text = (
        "the pose's angles do not determine the motion (pitch at 90 degrees), or joints of a "
        "limb are dependent there"
    )
    return [Span(a, b, a, "coordinates", 0.0, "rad", text) for a, b in stretches(lost)]


def _miss(
    mechanism: Mechanism,
    parameters: Parameters,
    mode: str,
    limits: Ranges,
    pose: Mapping[str, float],
) -> tuple[str, float, str, str]:
    """Return which limb or limit excludes a pose, by how much, the unit and the same in words."""
    length = unit_of("length", mechanism.length_unit)
    solutions = mechanism.inverse(parameters, pose)
    solution = next((s for s in solutions if s.working_mode == mode), None)
    if solution is not None:
        return _limit_missed(mechanism, parameters, limits, pose, solution)
    worst = min(mechanism.reach(parameters, pose), key=lambda reach: reach.distance)
    if worst.distance < 0 and not solutions:
        miss = -float(worst.distance)
        text = f"{worst.limb} misses by {miss:.6g} {length} ({worst.reason})"
        return worst.limb, miss, length, text
    modes = ", ".join(s.working_mode for s in solutions) or "none"
    return "working mode", 0.0, length, f"not reached in working mode {mode} (reached in: {modes})"


def _limit_missed(
    mechanism: Mechanism,
    parameters: Parameters,
    limits: Ranges,
    pose: Mapping[str, float],
    solution: InverseSolution,
) -> tuple[str, float, str, str]:
    size = mechanism.characteristic_length(parameters)
    found: list[tuple[float, str, float, str, str]] = []
    values = {**solution.passive, **solution.joints}
    for coordinate in mechanism.limited:
        if coordinate.name not in limits:
            continue
        low, high = limits[coordinate.name]
        unit = mechanism.unit(coordinate)
        for name, value in values.items():
            if of_limb(coordinate.name, name) and not within(value, (low, high), coordinate.kind):
                if coordinate.kind == "angle":
                    miss = abs(wrap_angle(value - (low + high) / 2)) - (high - low) / 2
                    weight = miss
                else:
                    miss = max(low - value, value - high)
                    weight = miss / size
                text = (
                    f"{name} = {value:.6g} {unit} misses [{exact(low)}, {exact(high)}] "
                    f"by {miss:.6g} {unit}"
                )
                found.append((weight, name, miss, unit, text))
    if found:
        return max(found)[1:]
    length = unit_of("length", mechanism.length_unit)
    if not mechanism.admits(parameters, pose):
        return "design limit", 0.0, length, "a limit that is a design parameter is exceeded"
    # On a boundary, where the kernel and the equations differ by rounding.
    return "reach", 0.0, length, "at the very end of the reach"
