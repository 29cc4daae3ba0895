"""The point that hypervolumes are measured from: fixed by the problem, the same for every run.

It is 0 for what is maximised, which nothing falls below, and for what is minimised the largest
value over a fixed sample of designs of the bounds: quasi-random ones, and the corners, where the
largest machines are. Neither seed nor sampler nor the number of samples of a run changes it.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.cells import hull
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.workspace.projection import area, measure_footprint, replicate
from pmopt.errors import PmoptError
from pmopt.execution.threads import ordered_map
from pmopt.numerics.sequences import golden_steps, make_sequence
from pmopt.seeds import seed_sequence
from pmopt.synthesis.problem import DesignProblem

#: Quasi-random designs, and most corners of the bounds beside them.
DESIGNS = 4096
CORNERS = 512
#: Poses of each design at the first look; how many are measured, and on how many poses.
_FEW = 512
_MEASURED = 32
POSES = 1 << 16
_REPLICATES = 4


def reference_point(problem: DesignProblem) -> tuple[float, ...]:
    """Return the point that hypervolumes of a problem are measured from.

    What ``[algorithm] reference`` gives stands; NaN where something is minimised and no design of
    the sample has a workspace.

    Parameters
    ----------
    problem : DesignProblem
    """
    given = problem.config.algorithm.reference
    found = []
    for name, sense in zip(problem.objectives, problem.senses, strict=True):
        if name in given:
            found.append(given[name])
        else:
            found.append(0.0 if sense > 0 else _largest(problem, name))
    return tuple(found)


def sample_designs(problem: DesignProblem) -> NDArray[np.float64]:
    """Return the fixed sample of designs, shape (N, v): first the corners of the bounds."""
    corners = list(
        itertools.islice(itertools.product((0.0, 1.0), repeat=len(problem.lower)), CORNERS)
    )
    steps = golden_steps(len(problem.lower)).astype(np.uint64)
    counts = np.arange(1, DESIGNS + 1, dtype=np.uint64)
    inner = (counts[:, None] * steps).astype(np.float64) / 2.0**64
    unit = np.concatenate([np.array(corners), inner])
    return np.asarray(problem.lower + (problem.upper - problem.lower) * unit)


def _largest(problem: DesignProblem, name: str) -> float:
    """Return the largest value of a minimised objective over the sample.

    All designs are looked at roughly, and those with the largest values measured.
    """
    assert name == "footprint"  # the only one
    sampler, rows = problem.alone, sample_designs(problem)
    axes = len(problem.mechanism.pose)
    points = make_sequence("r-sequence", axes, _REPLICATES, seed_sequence(0, "reference"))

    def rough(row: NDArray[np.float64]) -> float:
        design = _design(problem, row)
        if design is None:
            return np.nan
        ends = sampler.evaluator.shadow(
            design, sampler.evaluator.points(design, replicate(points, 0), 0, _FEW)
        )
        return area(hull(ends)) if len(ends) else np.nan

    def finely(row: NDArray[np.float64]) -> float:
        design = _design(problem, row)
        assert design is not None  # it has been looked at
        return measure_footprint(sampler, design, points, POSES // _REPLICATES).value

    threads = problem.sampler.threads
    guesses = np.array(list(ordered_map(rough, rows, threads)))
    known = np.flatnonzero(np.isfinite(guesses))
    if len(known) == 0:
        return float("nan")
    largest = known[np.argsort(-guesses[known], kind="stable")[:_MEASURED]]
    return max(ordered_map(finely, rows[largest], threads))


def _design(problem: DesignProblem, row: NDArray[np.float64]) -> Design | None:
    """Return a design ready to be swept, None for one that cannot be or reaches nothing."""
    try:
        design = problem.alone.design(problem.parameters(row))
    except (PmoptError, ArithmeticError, ValueError):
        return None  # what cannot be evaluated is on no front either
    return design if design.box_volume > 0 else None
