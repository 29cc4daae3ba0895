"""Point sequences with random access by index, host side.

The sweep (:mod:`pmopt.kernels.sweep`) makes points on the fly, block by block; what it
needs to do so is prepared here once per run: starts of the additive recurrence, scrambled
direction numbers of Sobol' points, keys of the counter-based generator.
"""

from __future__ import annotations

import functools
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

SamplerName = Literal["r-sequence", "sobol", "monte-carlo", "grid"]
SAMPLERS: tuple[SamplerName, ...] = get_args(SamplerName)

#: Points of one block; Sobol' points combine a block's base with a table of this length.
BLOCK_BITS = 9
BLOCK = 1 << BLOCK_BITS
SOBOL_BITS = 52

# Primitive polynomials (degree, coefficients) and initial direction numbers of
# Joe and Kuo (2008), "new-joe-kuo-6", for dimensions 2 to 8.
_JOE_KUO = (
    (1, 0, (1,)),
    (2, 1, (1, 3)),
    (3, 1, (1, 3, 1)),
    (3, 2, (1, 1, 1)),
    (4, 1, (1, 1, 3, 3)),
    (4, 4, (1, 3, 5, 13)),
    (5, 2, (1, 1, 5, 5, 17)),
)
MAX_DIMENSION = len(_JOE_KUO) + 1


class Sequence(NamedTuple):
    """What the compiled sweep needs to make the points of every replicate.

    Attributes
    ----------
    kind : int
        Index into :data:`SAMPLERS`.
    step : (d,) uint64
        Additive recurrence: the step of each coordinate, as a fraction of 2**64.
    start : (R, d) uint64
        Additive recurrence: the random start of each replicate. Monte Carlo: keys in column 0.
    high : (R, d, 64) uint64
        Sobol': scrambled direction numbers, bit j of the index, as fractions of 2**52.
    low : (R, d, BLOCK) uint64
        Sobol': the first BLOCK points, random shift included.
    cells : int
        Grid: cells per axis.
    """

    kind: int
    step: NDArray[np.uint64]
    start: NDArray[np.uint64]
    high: NDArray[np.uint64]
    low: NDArray[np.uint64]
    cells: int

    @property
    def replicates(self) -> int:
        """Number of independent randomisations."""
        return int(self.start.shape[0])

    def with_last(self, axis: int) -> Sequence:
        """Return the sequence with its last, least even coordinate moved to an axis."""
        dimension = self.start.shape[1]
        order = list(range(dimension - 1))
        order.insert(axis, dimension - 1)
        return self._replace(
            step=np.ascontiguousarray(self.step[order]),
            start=np.ascontiguousarray(self.start[:, order]),
            high=np.ascontiguousarray(self.high[:, order]),
            low=np.ascontiguousarray(self.low[:, order]),
        )


@functools.cache
def golden_steps(dimension: int) -> NDArray[np.uint64]:
    """Return the steps of the R-sequence as fractions of 2**64.

    The steps are g**-1, .., g**-d with g the root above 1 of g**(d + 1) = g + 1
    (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018). They are
    computed in integers: in doubles the points would drift after some 10**9 indices.
    """
    bits = 160
    one = 1 << bits
    root = one + (one >> 1)
    for _ in range(400):  # g <- (1 + g)**(1 / (d + 1)), a contraction with factor <= 1/2
        root = _integer_root((one + root) << (bits * dimension), dimension + 1)
    steps = []
    power = one
    for _ in range(dimension):
        power = (power << bits) // root
        steps.append((power + (1 << (bits - 65))) >> (bits - 64))
    found = np.array(steps, dtype=np.uint64)
    found.flags.writeable = False  # it is shared
    return found


def _integer_root(value: int, order: int) -> int:
    """Return floor(value ** (1 / order)) by Newton's iteration from above."""
    guess: int = 1 << -(-value.bit_length() // order)
    while True:
        better: int = ((order - 1) * guess + value // guess ** (order - 1)) // order
        if better >= guess:
            return int(guess)
        guess = better


@functools.cache
def sobol_directions(dimension: int) -> NDArray[np.uint64]:
    """Return unscrambled Sobol' direction numbers, shape (d, SOBOL_BITS), scaled by 2**52."""
    directions = np.zeros((dimension, SOBOL_BITS), dtype=np.uint64)
    for row in range(dimension):
        if row == 0:
            numbers = [1] * SOBOL_BITS
        else:
            degree, coefficients, initial = _JOE_KUO[row - 1]
            numbers = list(initial)
            for k in range(degree, SOBOL_BITS):
                value = numbers[k - degree] ^ (numbers[k - degree] << degree)
                for j in range(1, degree):
                    if (coefficients >> (degree - 1 - j)) & 1:
                        value ^= numbers[k - j] << j
                numbers.append(value)
        for k, number in enumerate(numbers):
            directions[row, k] = number << (SOBOL_BITS - 1 - k)
    directions.flags.writeable = False  # it is shared
    return directions


def _scramble(directions: NDArray[np.uint64], rng: np.random.Generator) -> NDArray[np.uint64]:
    """Multiply direction numbers by a random lower-triangular bit matrix (Matousek 1998)."""
    dimension, bits = directions.shape
    left = np.arange(bits - 1, -1, -1, dtype=np.uint64)
    # Output bit j (from the top) is the parity of input bits 0..j, a random choice of the first j
    # and always the j-th.
    mask = np.ones((dimension, bits), dtype=np.uint64)
    chosen = rng.integers(0, 1 << np.arange(1, bits), size=(dimension, bits - 1))
    mask[:, 1:] |= chosen.astype(np.uint64) << np.uint64(1)
    mask <<= left
    kept = directions[:, None, :] & mask[:, :, None]
    parity = np.bitwise_count(kept).astype(np.uint64) & np.uint64(1)
    scrambled: NDArray[np.uint64] = np.bitwise_or.reduce(parity << left[:, None], axis=1)
    return scrambled


def make_sequence(
    sampler: SamplerName, dimension: int, replicates: int, seeds: np.random.SeedSequence
) -> Sequence:
    """Prepare the randomised sequences of all replicates.

    Parameters
    ----------
    sampler : str
        One of :data:`SAMPLERS` except ``"grid"``.
    dimension : int
        Coordinates of a point, at most :data:`MAX_DIMENSION`.
    replicates : int
        Independent randomisations.
    seeds : numpy.random.SeedSequence
        One child is spawned per replicate, so that replicate r is the same whatever their number.
    """
    step = golden_steps(dimension)
    start = np.zeros((replicates, dimension), dtype=np.uint64)
    sobol = sampler == "sobol"
    high = np.zeros((replicates, dimension, 64 if sobol else 1), dtype=np.uint64)
    low = np.zeros((replicates, dimension, BLOCK if sobol else 1), dtype=np.uint64)
    plain = sobol_directions(dimension) if sobol else None
    for r, child in enumerate(seeds.spawn(replicates)):
        rng = np.random.Generator(np.random.PCG64(child))
        start[r] = rng.integers(0, 2**64, size=dimension, dtype=np.uint64)
        if plain is not None:
            scrambled = _scramble(plain, rng)
            high[r, :, :SOBOL_BITS] = scrambled
            table = low[r]
            table[:] = rng.integers(0, 1 << SOBOL_BITS, size=(dimension, 1), dtype=np.uint64)
            index = np.arange(BLOCK, dtype=np.uint64)
            for j in range(BLOCK_BITS):
                table ^= scrambled[:, j : j + 1] * ((index >> np.uint64(j)) & np.uint64(1))
    return Sequence(SAMPLERS.index(sampler), step, start, high, low, 0)


def make_grid(dimension: int, cells: int) -> Sequence:
    """Prepare the midpoint grid with ``cells`` cells per axis: one replicate, no randomness."""
    nothing = np.zeros((1, dimension, 1), dtype=np.uint64)
    return Sequence(
        SAMPLERS.index("grid"),
        golden_steps(dimension),
        np.zeros((1, dimension), dtype=np.uint64),
        nothing,
        nothing,
        cells,
    )
