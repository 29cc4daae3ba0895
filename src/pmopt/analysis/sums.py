"""What of a workspace has been summed so far: enough to go on with it later, to the same bits."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sweeper import Tallies

_ARRAYS = tuple(Tallies.__dataclass_fields__)[1:]


@dataclass(frozen=True)
class Sums:
    """The sums over the first blocks of a workspace, never changed once made.

    Attributes
    ----------
    chunks : int
        Chunks in the sums.
    whole : tuple of Tallies
        Of the coarser grids that are done, where there are grids.
    part : Tallies or None
        Of the first points of each replicate; the next block begins where they end.
    worst : float
        On the way to a target error, the relative standard error after the round before.
    """

    chunks: int = 0
    whole: tuple[Tallies, ...] = ()
    part: Tallies | None = None
    worst: float = math.inf

    @property
    def points(self) -> int:
        """Points of each replicate in ``part``."""
        return 0 if self.part is None else self.part.points

    def with_block(self, block: Tallies, chunks: int) -> Sums:
        """Return the sums with one more block."""
        part = block
        if self.part is not None:
            part = copy.deepcopy(self.part)
            part.add(block)
        return replace(self, chunks=self.chunks + chunks, part=part)

    def to_plain(self) -> tuple[dict[str, Any], NDArray[np.float64]]:
        """Return facts that JSON can hold and a table, a row for each of the tallies."""
        rows = [*self.whole, *([] if self.part is None else [self.part])]
        facts = {
            "whole": len(self.whole),
            "worst": self.worst if math.isfinite(self.worst) else None,
            "shapes": [getattr(rows[0], name).shape for name in _ARRAYS],
        }
        table = [
            np.concatenate([[t.points], *(getattr(t, name).ravel() for name in _ARRAYS)])
            for t in rows
        ]
        return facts, np.stack(table)

    @classmethod
    def from_plain(cls, chunks: int, facts: Mapping[str, Any], table: NDArray[np.float64]) -> Sums:
        """Return the sums that :meth:`to_plain` gave."""
        shapes = [tuple(shape) for shape in facts["shapes"]]
        ends = np.cumsum([1, *(math.prod(shape) for shape in shapes)])
        rows = []
        for row in table:
            parts = np.split(row, ends)
            arrays: list[Any] = [
                part.reshape(shape).copy() for part, shape in zip(parts[1:], shapes, strict=False)
            ]
            rows.append(Tallies(int(row[0]), *arrays))
        count, worst = facts["whole"], facts["worst"]
        part = rows[count] if len(rows) > count else None
        return cls(chunks, tuple(rows[:count]), part, math.inf if worst is None else worst)
