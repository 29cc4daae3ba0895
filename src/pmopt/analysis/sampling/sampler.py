"""Sample points of designs: sequences by seed and purpose, chunks of them, threads, sums."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pmopt.analysis.sampling.aspects import FieldEvaluator
from pmopt.analysis.sampling.design_space import Design, DesignSpace
from pmopt.analysis.sampling.evaluator import Evaluator, Notify
from pmopt.analysis.sampling.tallies import BINS, Done, Tallies, block_ranges, chunk_ranges
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.execution.threads import ordered_map
from pmopt.mechanisms.mechanism import Mechanism, Parameters
from pmopt.numerics import sequences
from pmopt.numerics.elementary import exp, log
from pmopt.seeds import seed_sequence

#: The characteristic length that is best is sought on this many points, within this factor.
_LENGTH_POINTS = 1 << 13
_LENGTH_FACTOR = 30.0


@dataclass(eq=False)
class Sampler:
    """Samples designs of one mechanism under one set of settings.

    Attributes
    ----------
    evaluator : Evaluator
    seed : int
    purpose : str
        Points of two purposes are independent.
    """

    evaluator: Evaluator
    seed: int = 1
    purpose: str = "workspace samples"
    _sequences: dict[tuple[int, str, int], sequences.Sequence] = field(
        default_factory=dict, repr=False
    )

    @property
    def space(self) -> DesignSpace:
        """The designs that the settings are about."""
        return self.evaluator.space

    @property
    def threads(self) -> int:
        """Threads; results do not depend on it."""
        return self.evaluator.threads

    def for_purpose(self, purpose: str) -> Sampler:
        """Return a sampler with the same settings and independent sample points."""
        return replace(self, purpose=purpose)

    def with_seed(self, seed: int) -> Sampler:
        """Return a sampler with the same settings and another seed."""
        return replace(self, seed=seed)

    def on_threads(self, threads: int) -> Sampler:
        """Return a sampler of the same points on another number of threads."""
        return replace(self, evaluator=replace(self.evaluator, threads=threads))

    def design(self, parameters: Parameters) -> Design:
        """Return a design ready to be sampled, its box cut to the domain."""
        design = self.space.design(parameters)
        if self.space.settings.characteristic_length == "optimal" and design.box_volume > 0:
            return self.space.design(parameters, self._best_length(parameters, design.length))
        return design

    def _best_length(self, parameters: Parameters, about: float) -> float:
        """Return the characteristic length with the largest GCI over a fixed sample.

        The mean of the inverse condition number stands for the condition number, whose mean over
        a workspace that reaches a singularity does not exist.
        """
        from scipy.optimize import minimize_scalar

        points = sequences.make_sequence(
            "r-sequence",
            len(self.space.mechanism.pose),
            1,
            seed_sequence(self.seed, "length samples"),
        )

        def loss(log_length: float) -> float:
            tallies = self.evaluator.tally(
                [self.space.design(parameters, exp(log_length))], points, 0, _LENGTH_POINTS
            )
            return -float(tallies.total[0, 0]) / max(float(tallies.within[0, 0]), 1.0)

        middle, half = log(about), log(_LENGTH_FACTOR)
        found = minimize_scalar(loss, bounds=(middle - half, middle + half), method="bounded",
                                options={"xatol": 1e-6})  # fmt: skip
        return exp(found.x)

    def sequence(self, replicates: int) -> sequences.Sequence:
        """Return the sample points shared by all designs of a run."""
        sampler = self.space.settings.sampler
        key = self.seed, self.purpose, replicates
        if key not in self._sequences:
            points = sequences.make_sequence(
                "sobol" if sampler == "lines" else sampler,
                len(self.space.mechanism.pose),
                replicates,
                seed_sequence(self.seed, self.purpose),
            )
            if sampler == "lines":
                points = points.with_last(self.space.mechanism.line_axis)
            self._sequences[key] = points
        return self._sequences[key]

    def tally_population(
        self, designs: Sequence[Design], points: sequences.Sequence, count: int
    ) -> Tallies:
        """Sweep ``count`` points a replicate for a whole population, designs over threads."""
        slices = max(1, min(len(designs), 4 * self.threads))
        bounds = [i * len(designs) // slices for i in range(slices + 1)]
        parts = [designs[a:b] for a, b in zip(bounds, bounds[1:], strict=False)]
        ranges = list(chunk_ranges(0, count, points.replicates))
        swept = ordered_map(
            lambda work: self.evaluator.tally(work[0], points, *work[1]),
            ((part, span) for part in parts for span in ranges),
            self.threads,
        )
        tallies = []
        for _ in parts:
            whole = next(swept)
            for _ in ranges[1:]:
                whole.add(next(swept))
            tallies.append(whole)
        arrays: list[Any] = [
            np.concatenate([getattr(t, name) for t in tallies])
            for name in list(Tallies.__dataclass_fields__)[1:]
        ]
        return Tallies(count, *arrays)

    def stream(
        self, design: Design, points: sequences.Sequence, ranges: Iterable[tuple[int, int]]
    ) -> Iterator[Tallies]:
        """Yield the tallies of ranges of points in order, computed on all threads."""
        return ordered_map(
            lambda r: self.evaluator.tally([design], points, r[0], r[1], BINS), ranges, self.threads
        )

    def blocks(
        self, design: Design, points: sequences.Sequence, first: int, last: int, done: Done
    ) -> Iterator[Tallies]:
        """Yield the tallies of the blocks of a range of points in order, on all threads.

        A block's tallies are those of its chunks added in order, wherever they are computed.
        ``done`` receives how many points are done, after every chunk.
        """
        replicates = points.replicates
        chunks = self.stream(design, points, chunk_ranges(first, last, replicates))
        for start, stop in block_ranges(first, last, replicates):
            block = None
            for _, end in chunk_ranges(start, stop, replicates):
                part = next(chunks)
                if block is None:
                    block = part
                else:
                    block.add(part)
                done(end)
            assert block is not None  # every range holds a point
            yield block


def make_sampler(
    mechanism: Mechanism,
    settings: WorkspaceSettings,
    seed: int = 1,
    threads: int | None = None,
    notify: Notify | None = None,
    where: str = "workspace",
) -> Sampler:
    """Return a sampler that knows what the settings ask for, compiled where it can be.

    Parameters
    ----------
    mechanism : Mechanism
    settings : WorkspaceSettings
    seed : int
    threads : int, optional
        Default: see :func:`pmopt.execution.threads.default_threads`. Results do not depend on it.
    notify : callable, optional
        Receives a line when kernels have to be compiled.
    where : str
        What errors call the settings.

    Raises
    ------
    InputError
        For names in the settings that the mechanism does not have.
    """
    kind = FieldEvaluator if settings.aspect or settings.block else Evaluator
    return Sampler(kind.of(DesignSpace.of(mechanism, settings, where), threads, notify), seed)
