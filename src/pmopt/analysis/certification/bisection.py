"""Boxes of poses, bisected until the proof is close enough: interval branch and bound.

What is proven is about the poses that a sampled workspace counts: those in the design's box that
keep every limit in the working mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.reads import Reads
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.kernels.affine_forms import EPS
from pmopt.mechanisms.mechanism import Mechanism

Array = NDArray[np.float64]
#: Called with a number that falls to 0 when the work is done, e.g. the gap.
Progress = Callable[[float, float], None]
#: Most boxes kept open: some hundred bytes each.
MAX_OPEN = 1 << 22
#: Boxes evaluated between looks at the clock.
BATCH = 1 << 13
INSTEAD = "nothing is sampled, and proven with a working mode, a domain and limits of joints"


def bisected(centres: Array, halves: Array, weights: Array | None = None) -> tuple[Array, Array]:
    """Return both halves of each box, across its longest side, by weights of the coordinates."""
    return halved(
        centres, halves, np.argmax(halves if weights is None else halves * weights, axis=1)
    )


def halved(
    centres: Array, halves: Array, axis: NDArray[np.int64] | np.int64
) -> tuple[Array, Array]:
    """Return both halves of each box, across an axis of each or of all."""
    rows = np.arange(len(centres))
    halves = halves.copy()
    halves[rows, axis] /= 2
    shift = np.zeros_like(halves)
    shift[rows, axis] = halves[rows, axis]
    return np.concatenate([centres - shift, centres + shift]), np.concatenate([halves, halves])


def prepared(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    settings: WorkspaceSettings,
    reads: Reads[Any],
    notify: Notify | None,
) -> tuple[Sampler, Design]:
    """Return a sampler and its design; settings that proofs do not cover are refused."""
    reads.check(settings)
    sampler = make_sampler(mechanism, settings, notify=notify, where="certify")
    return sampler, sampler.design(mechanism.resolve(params or {}))


def announced(notify: Notify | None) -> Callable[[], None] | None:
    """Return what says that proofs are being compiled; None where nobody listens."""
    if notify is None:
        return None
    return lambda: notify("compiling the code for proofs, once: some seconds")


def relative(lower: float, upper: float) -> float:
    """Return the gap between two bounds over the upper one, rounded up."""
    return above((upper - lower) / upper * (1 + 4 * EPS)) if upper > lower else 0.0


def below(value: float) -> float:
    """Return the next number below, 0 at least."""
    return math.nextafter(value, -math.inf) if value > 0.0 else 0.0


def above(value: float) -> float:
    """Return the next number above; 0 stays."""
    return math.nextafter(value, math.inf) if value > 0.0 else 0.0
