"""What of a workspace has been summed so far: enough to go on with it later, to the same bits."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.tallies import Tallies

_ARRAYS = tuple(Tallies.__dataclass_fields__)[1:]


@dataclass(frozen=True)
class Sums:
    """The sums over the first blocks of a workspace, never changed once made.

    Attributes
    ----------
    chunks : int
        Whole chunks in the sums.
    whole : tuple of Tallies
        Where there is a grid, of the sample that it is compared with, once that is done.
    part : Tallies or None
        Of the first points of each replicate; the next block begins where they end.
    """

    chunks: int = 0
    whole: tuple[Tallies, ...] = ()
    part: Tallies | None = None

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
        """Return facts that JSON can hold and a table of one row."""
        rows = [*self.whole, *([] if self.part is None else [self.part])]
        facts = {
            "whole": len(self.whole),
            "shapes": [[getattr(t, name).shape for name in _ARRAYS] for t in rows],
        }
        parts = [
            part for t in rows for part in ([t.points], *(getattr(t, k).ravel() for k in _ARRAYS))
        ]
        return facts, np.concatenate(parts)[None]

    @classmethod
    def from_plain(cls, chunks: int, facts: Mapping[str, Any], table: NDArray[np.float64]) -> Sums:
        """Return the sums that :meth:`to_plain` gave."""
        numbers, start = table[0], 0
        rows = []
        for shapes in facts["shapes"]:
            points, start = int(numbers[start]), start + 1
            arrays: list[Any] = []
            for shape in shapes:
                size = math.prod(shape)
                arrays.append(numbers[start : start + size].reshape(shape).copy())
                start += size
            rows.append(Tallies(points, *arrays))
        count = facts["whole"]
        return cls(chunks, tuple(rows[:count]), rows[count] if len(rows) > count else None)
