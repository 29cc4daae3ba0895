"""Random streams, keyed by a run's seed and the purpose of the numbers."""

from __future__ import annotations

import zlib

import numpy as np


def seed_sequence(seed: int, purpose: str) -> np.random.SeedSequence:
    """Return the seed sequence of one purpose within a run.

    Streams of different purposes are independent, and none depends on how many numbers another
    has drawn, on threads, workers or order of arrival.
    """
    return np.random.SeedSequence(seed, spawn_key=(zlib.crc32(purpose.encode()),))
