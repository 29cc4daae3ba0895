"""The Pareto front, measured finely, with its knee and idle directions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.estimates import Estimates
from pmopt.analysis.workspace.compute import number
from pmopt.numerics.matrices import decomposed
from pmopt.seeds import seed_sequence
from pmopt.synthesis.optimise import hypervolume
from pmopt.synthesis.problem import DesignProblem
from pmopt.units import ONE

#: Idle directions: random designs, most corners of the bounds, step of the differences as a share
#: of each range, share of the steepest response below which a direction is a candidate, and
#: largest relative change of an objective along a confirmed one (what rounding leaves).
_PROBES = 16
_CORNERS = 64
_STEP = 0.05
_CANDIDATE = 0.05
_UNCHANGED = 1e-6


@dataclass(frozen=True)
class FrontDesign:
    """A design on the front."""

    number: int
    parameters: dict[str, float | None]
    estimates: Estimates
    objectives: dict[str, float]
    errors: dict[str, float]
    slack: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "design": self.number,
            "params": self.parameters,
            **self.objectives,
            **{f"{name}_error": error for name, error in self.errors.items()},
            **self.slack,
        }


@dataclass(frozen=True)
class Front:
    """The front after its designs were measured finely, sorted by the first objective.

    Attributes
    ----------
    designs : tuple of FrontDesign
    dropped : int
        Designs that the search offered and the finer measurement found dominated or infeasible.
    hypervolume : float
        From the reference point.
    searched : float
        The same at the end of the search, before the designs were measured finely.
    reference : tuple of float
    senses : tuple of int
        +1 for objectives to maximise, -1 for those to minimise.
    idle : tuple of dict
        Directions of the design space along which no objective changes: parameter to
        coefficient. ``{"c": 1.0}`` is a parameter without influence, ``{"m": 1.0, "n": 1.0}``
        says that only m - n matters.
    units : dict
    """

    designs: tuple[FrontDesign, ...]
    dropped: int
    hypervolume: float
    searched: float
    reference: tuple[float, ...]
    senses: tuple[int, ...]
    idle: tuple[dict[str, float], ...]
    units: dict[str, str]

    @property
    def knee(self) -> FrontDesign:
        """The design farthest from the line between the ends, objectives scaled to the front."""
        names = list(self.designs[0].objectives)
        values = np.array([[d.objectives[k] for k in names] for d in self.designs])
        values *= self.senses
        span = np.ptp(values, axis=0)
        if len(self.designs) < 3 or not np.all(span > 0):
            return self.designs[len(self.designs) // 2]
        return self.designs[int(np.argmax(((values - values.min(axis=0)) / span).sum(axis=1)))]

    def beyond(self) -> dict[str, int]:
        """Return how many designs are not better than the reference point, by objective."""
        names = list(self.designs[0].objectives)
        values = np.array([[d.objectives[k] for k in names] for d in self.designs])
        lost = (values - self.reference) * self.senses < 0
        return {k: int(n) for k, n in zip(names, lost.sum(axis=0), strict=True) if n}

    def remarks(self) -> list[str]:
        """Return a line on unexpected properties of the hypervolume."""
        unit = "" if self.units["hypervolume"] == ONE else f" {self.units['hypervolume']}"
        lines = [
            f"{count} of {len(self.designs)} designs do not count in the hypervolume: their "
            f"{name} is beyond the reference (algorithm.reference)"
            for name, count in self.beyond().items()
        ]
        if abs(self.hypervolume - self.searched) > 1e-6 * abs(self.searched):
            lines.append(
                f"hypervolume {self.hypervolume:.6g}{unit}: the front was measured again, finely; "
                f"on the search's samples it was {self.searched:.6g}{unit}"
            )
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        names = list(self.designs[0].objectives)
        return {
            "designs": len(self.designs),
            "dropped": self.dropped,
            "hypervolume": number(self.hypervolume),
            "search_hypervolume": number(self.searched),
            "reference_point": dict(zip(names, self.reference, strict=True)),
            "knee": self.knee.to_dict(),
            "ends": [self.designs[0].to_dict(), self.designs[-1].to_dict()],
            "idle_directions": list(self.idle),
            "units": self.units,
        }


def measure_front(
    problem: DesignProblem,
    variables: NDArray[np.float64],
    reference: tuple[float, ...],
    searched: float,
    progress: Callable[[int, int], None] | None = None,
) -> Front:
    """Measure the designs of a front to the final target error and keep the non-dominated.

    Parameters
    ----------
    problem : DesignProblem
    variables : (N, v) float64
    reference : tuple of float
        Point the hypervolume is measured from.
    searched : float
        Hypervolume at the end of the search.
    progress : callable, optional
    """
    import moocore

    measured = []
    for count, finely in enumerate(problem.measure(variables), start=1):
        measured.append((variables[count - 1], finely))
        if progress:
            progress(count, len(variables))
    rows = []
    for row, (found, by_name) in measured:
        slack = {
            key: sign * (by_name[name].value - bound)
            for key, (name, sign, bound) in problem.bounds.items()
        }
        exists = all(math.isfinite(by_name[name].value) for name in problem.objectives)
        if found.reachable and exists and all(v >= 0 for v in slack.values()):
            rows.append((row, found, by_name, slack))
    values = np.array([[r[2][k].value for k in problem.objectives] for r in rows])
    if len(rows):
        kept = np.flatnonzero(moocore.is_nondominated(values * problem.senses, maximise=True))
        order = kept[np.lexsort(values[kept].T[::-1])]
    else:
        order = np.array([], dtype=int)
    designs = tuple(
        FrontDesign(
            number=i,
            parameters=problem.parameters(rows[k][0]),
            estimates=rows[k][1],
            objectives={name: rows[k][2][name].value for name in problem.objectives},
            errors={name: rows[k][2][name].error for name in problem.objectives},
            slack=rows[k][3],
        )
        for i, k in enumerate(order, start=1)
    )
    return Front(
        designs=designs,
        dropped=len(variables) - len(designs),
        hypervolume=hypervolume(values[order], problem.senses, reference) if len(designs) else 0.0,
        searched=searched,
        reference=reference,
        senses=tuple(problem.senses.tolist()),
        idle=idle_directions(problem, variables),
        units=problem.units,
    )


def idle_directions(
    problem: DesignProblem, front: NDArray[np.float64]
) -> tuple[dict[str, float], ...]:
    """Find the directions of design space along which no objective changes.

    Central differences of all objectives at random designs, on common sample points, are the
    rows of a matrix whose near null space proposes directions. In reduced echelon form a
    parameter without influence stands alone. Coefficients are rounded to simple fractions, and a
    direction is confirmed by moving along it as far as the bounds allow, from random designs,
    corners of the bounds and designs of the front: on common points an invariance is exact.

    Parameters
    ----------
    problem : DesignProblem
    front : (N, v) float64
    """
    if problem.samples is None:
        return ()  # points differ from design to design
    count = len(problem.variables)
    rng = np.random.Generator(np.random.PCG64(seed_sequence(problem.sampler.seed, "idle")))
    span = problem.upper - problem.lower
    centres = problem.lower + span * rng.uniform(_STEP, 1 - _STEP, (_PROBES, count))
    steps = _STEP * span * np.concatenate([np.eye(count), -np.eye(count)])
    values = problem.evaluate((centres[:, None, :] + steps).reshape(-1, count)).values
    changes = values.reshape(_PROBES, 2, count, -1)
    slopes = changes[:, 0] - changes[:, 1]  # (probe, variable, objective)
    slopes = slopes[np.isfinite(slopes).all(axis=(1, 2))]
    if len(slopes) < count:
        return ()
    # Objectives differ in unit and size: each is scaled to its steepest response.
    scale = np.abs(slopes).max(axis=(0, 1))
    rows = (slopes / np.where(scale > 0, scale, 1.0)).transpose(0, 2, 1).reshape(-1, count)
    _, singular, basis = (part[0] for part in decomposed(rows[None]))
    rank = int((singular > _CANDIDATE * singular[0]).sum())
    corners = itertools.product(*zip(problem.lower, problem.upper, strict=True))
    some = np.array(list(itertools.islice(corners, _CORNERS)))
    bases = np.concatenate([centres, some, front[:: max(1, len(front) // _PROBES)]])
    before = problem.evaluate(bases).values
    found = []
    for direction in _reduced(basis[rank:] * span):
        simple = np.array([float(Fraction(v).limit_denominator(6)) for v in direction])
        ends = [problem.evaluate(_farthest(problem, bases, d)).values for d in (simple, -simple)]
        if all(
            np.allclose(after, before, rtol=_UNCHANGED, atol=0.0, equal_nan=True) for after in ends
        ):
            found.append(
                {k: float(v) for k, v in zip(problem.variables, simple, strict=True) if v != 0}
            )
    return tuple(found)


def _farthest(
    problem: DesignProblem, bases: NDArray[np.float64], direction: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the designs as far along a direction as their bounds allow."""
    room = np.where(direction > 0, problem.upper - bases, bases - problem.lower)
    moving = direction != 0
    length = (room[:, moving] / np.abs(direction[moving])).min(axis=1, keepdims=True)
    moved: NDArray[np.float64] = np.clip(bases + length * direction, problem.lower, problem.upper)
    return moved


def _reduced(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the reduced row echelon form of a basis."""
    matrix = rows.copy()
    row = 0
    for column in range(matrix.shape[1]):
        if row == len(matrix):
            break
        pivot = row + int(np.argmax(np.abs(matrix[row:, column])))
        if abs(matrix[pivot, column]) < 1e-4 * np.abs(matrix).max():
            continue
        matrix[[row, pivot]] = matrix[[pivot, row]]
        matrix[row] /= matrix[row, column]
        others = np.arange(len(matrix)) != row
        matrix[others] -= np.outer(matrix[others, column], matrix[row])
        row += 1
    return matrix[:row]


def describe_idle(direction: dict[str, float]) -> str:
    """Say in words what an idle direction means."""
    if len(direction) == 1:
        return f"{next(iter(direction))} changes no objective"
    moved = ", ".join(f"{name} by {value:+.4g}" for name, value in direction.items())
    return f"moving together {moved} changes no objective"
