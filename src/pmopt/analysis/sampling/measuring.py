"""A design measured on a number of samples, to a target error or on a grid: block by block."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from pmopt.analysis.sampling.blocks import blocks_on
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.estimates import Estimates, from_grid, from_replicates
from pmopt.analysis.sampling.partial_sums import Sums
from pmopt.analysis.sampling.sampler import Sampler
from pmopt.analysis.sampling.tallies import (
    BLOCK_CHUNKS,
    Tallies,
    block_length,
    block_ranges,
    check_grid,
)
from pmopt.analysis.settings import (
    DEFAULT_REPLICATES,
    DEFAULT_SAMPLES,
    MAX_SAMPLES,
    WorkspaceSettings,
    split_samples,
)
from pmopt.errors import PmoptError
from pmopt.numerics.sequences import BLOCK, Sequence, make_grid

if TYPE_CHECKING:
    from pmopt.execution.cluster import Cluster

#: Called with points done and points planned.
Progress = Callable[[int, int], None]
#: Called with what has been summed after every whole block: to go on from it another time.
Keep = Callable[[Sums], None]

#: Least samples that a grid is compared with.
_LEAST_COMPARED = 1 << 14
#: On the way to a target error: replicates (that an error estimate be less by chance where it is
#: looked at again and again), samples of the first round, reachable ones that an error estimate
#: needs, and samples none of which is reachable that end the search.
_TARGET_REPLICATES = 32
_FIRST_ROUND = 1 << 10
_ENOUGH_REACHABLE = 64
_ALL_IN_VAIN = 1 << 18
#: Samples of the home aspect or of a block: each costs some hundred times a compiled one.
FIELD_SAMPLES = 1 << 20


@dataclass(frozen=True)
class Course:
    """How the sums over a design's points come about.

    Attributes
    ----------
    sums : Sums
        Where they begin: with nothing, or what ``keep`` was given in a run that was cut off, with
        the same settings but for more samples or a smaller target error.
    keep, progress : callable, optional
    cluster : Cluster, optional
        Sums the blocks on its workers: the result is the same.
    """

    sums: Sums = field(default_factory=Sums)
    keep: Keep | None = None
    progress: Progress | None = None
    cluster: Cluster | None = None

    def at(self, sums: Sums, progress: Progress | None = None) -> Course:
        """Return this course from other sums on, with another progress where it is given."""
        return replace(self, sums=sums, progress=progress or self.progress)


def planned_samples(settings: WorkspaceSettings) -> int:
    """Return the samples of a run that is given neither a grid nor a target error."""
    default = FIELD_SAMPLES if settings.aspect or settings.block else DEFAULT_SAMPLES
    return settings.samples or default


def _accumulate(
    sampler: Sampler,
    design: Design,
    points: Sequence,
    last: int,
    course: Course,
) -> Sums:
    """Go on to the points ``.. last - 1`` of every replicate, block by block in order."""
    sums, replicates = course.sums, points.replicates
    first = sums.points

    def done(count: int) -> None:
        if course.progress:
            course.progress(count * replicates, last * replicates)

    if course.cluster is None:
        blocks = sampler.blocks(design, points, first, last, done)
    else:
        blocks = blocks_on(course.cluster, sampler, design, points, first, last, done)
    for (start, stop), block in zip(block_ranges(first, last, replicates), blocks, strict=True):
        # A chunk that rounds of a target error share is counted once it is whole.
        length = block_length(replicates) // BLOCK_CHUNKS
        sums = sums.with_block(block, stop // length - start // length)
        # Where a run ends within a block, one with more samples does not.
        if course.keep and stop % block_length(replicates) == 0:
            course.keep(sums)
    return sums


def measure_samples(
    sampler: Sampler, design: Design, samples: int, course: Course | None = None
) -> tuple[Tallies, Estimates]:
    """Sum over a number of samples, all replicates together."""
    replicates, count = split_samples(samples, sampler.space.settings.replicates)
    points = sampler.sequence(replicates)
    tallies = _whole(_accumulate(sampler, design, points, count, course or Course()))
    return tallies, from_replicates(tallies)


def measure_as_set(
    sampler: Sampler, design: Design, course: Course | None = None
) -> tuple[Tallies, Estimates]:
    """Sum over a grid, to a target error or over a number of samples, as the settings say.

    Raises
    ------
    PmoptError
        When ``target_error`` is not reached within the largest number of samples.
    """
    settings = sampler.space.settings
    if settings.grid is not None:
        return measure_on_grid(sampler, design, settings.grid, course)
    if settings.target_error is not None:
        return measure_to_target(sampler, design, settings.target_error, course)
    return measure_samples(sampler, design, planned_samples(settings), course)


def _whole(sums: Sums) -> Tallies:
    assert sums.part is not None  # every range holds a point
    return sums.part


def measure_to_target(
    sampler: Sampler,
    design: Design,
    target: float,
    course: Course | None = None,
    most: int | None = None,
) -> tuple[Tallies, Estimates]:
    """Double the samples until volume and GCI have the relative standard error asked for.

    At ``most`` samples it ends with what is reached.

    Raises
    ------
    PmoptError
        Without ``most``, when the largest number of samples does not do.
    """
    course = course or Course()
    sums = course.sums
    replicates = sampler.space.settings.replicates or _TARGET_REPLICATES
    # A power of two, and once a block is reached whole blocks, as Sobol' points need them.
    last = 1 << max(4, math.ceil(math.log2(_FIRST_ROUND / replicates)))
    while last < sums.points:
        last *= 2
    points = sampler.sequence(replicates)
    while True:
        if sums.points % BLOCK:
            sums = Sums()  # less than a block: again from its beginning
        sums = _accumulate(sampler, design, points, last, course.at(sums))
        tallies = _whole(sums)
        estimates = from_replicates(tallies)
        errors = [e.error / e.value if e.value else 0.0 for e in (estimates.volume, estimates.gci)]
        worst = max((e for e in errors if not math.isnan(e)), default=0.0)
        if worst <= target and estimates.reachable >= _ENOUGH_REACHABLE:
            return tallies, estimates
        samples = last * replicates
        if estimates.reachable == 0 and samples >= _ALL_IN_VAIN:
            return tallies, estimates
        if most is not None and 2 * samples > most:
            return tallies, estimates
        if 2 * samples > MAX_SAMPLES:
            raise PmoptError(
                f"target error {target} not reached with {samples} samples: "
                f"the relative standard error is {worst:.2g}"
            )
        last *= 2


def measure_on_grid(
    sampler: Sampler,
    design: Design,
    cells: int,
    course: Course | None = None,
) -> tuple[Tallies, Estimates]:
    """Evaluate a grid and as many independent samples, that bound its error."""
    dimension = len(design.width)
    check_grid(cells, dimension)
    course = course or Course()
    sums, progress = course.sums, course.progress
    count = cells**dimension
    replicates, each = split_samples(max(count, _LEAST_COMPARED), DEFAULT_REPLICATES)
    samples = replicates * each

    def report(done: int) -> Progress:
        return lambda points, _: progress(done + points, samples + count) if progress else None

    if not sums.whole:
        points = sampler.sequence(replicates)
        sums = _accumulate(sampler, design, points, each, course.at(sums, report(0)))
        sums = replace(sums, whole=(_whole(sums),), part=None)
    grid = make_grid(dimension, cells)
    sums = _accumulate(sampler, design, grid, count, course.at(sums, report(samples)))
    tallies = _whole(sums)
    return tallies, from_grid(tallies, sums.whole[0])
