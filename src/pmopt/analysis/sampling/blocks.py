"""Blocks of a workspace, summed on the workers of a cluster to the same bits as in one process."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.sampling.tallies import Done, Tallies, block_ranges
from pmopt.mechanisms import find
from pmopt.numerics.sequences import Sequence, make_grid

if TYPE_CHECKING:
    from pmopt.execution.cluster import Cluster

#: Tasks for each thread of the cluster, and most blocks of a task: a block's sums are some 460 kB.
_TASKS = 4
_MOST = 16


@dataclass(frozen=True)
class _Work:
    """Some blocks, as a worker gets them: all that makes their points, a few kB."""

    sampler: bytes
    design: Design
    replicates: int
    cells: int
    ranges: tuple[tuple[int, int], ...]


def blocks_on(
    cluster: Cluster, sampler: Sampler, design: Design, points: Sequence, first: int, last: int,
    done: Done,
) -> Iterator[Tallies]:  # fmt: skip
    """Yield the tallies of blocks in order, computed on a cluster; see :meth:`Sampler.blocks`."""
    packed = pickle.dumps(
        (sampler.space.mechanism.name, sampler.space.settings, sampler.seed, sampler.purpose)
    )
    ranges = list(block_ranges(first, last, points.replicates))
    size = min(_MOST, max(1, len(ranges) // (_TASKS * cluster.threads)))
    works = (
        _Work(packed, design, points.replicates, points.cells, tuple(ranges[k : k + size]))
        for k in range(0, len(ranges), size)
    )
    ends = iter(ranges)
    for summed in cluster.ordered_map(sum_blocks, works):
        for block in summed:
            done(next(ends)[1])
            yield block


def sum_blocks(work: _Work) -> list[Tallies]:
    """Return the tallies of some blocks: what a worker does."""
    sampler = _sampler(work.sampler)
    dimension = len(work.design.width)
    points = make_grid(dimension, work.cells) if work.cells else sampler.sequence(work.replicates)
    return [
        block
        for first, last in work.ranges
        for block in sampler.blocks(work.design, points, first, last, lambda count: None)
    ]


@lru_cache(maxsize=8)
def _sampler(packed: bytes) -> Sampler:
    name, settings, seed, purpose = pickle.loads(packed)
    return make_sampler(find(name), settings, seed, threads=1).for_purpose(purpose)
