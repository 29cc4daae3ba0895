"""Point sequences against their definitions in exact arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import stats
from support import naive

from pmopt.numerics.sequences import (
    BLOCK,
    SAMPLERS,
    SOBOL_BITS,
    Sequence,
    golden_steps,
    make_grid,
    make_sequence,
    sobol_directions,
)

RANDOM = [name for name in SAMPLERS if name != "grid"]
FAR = 10**10 // BLOCK * BLOCK
# Rounding of base and stride of a block: 2**-53 each, the latter times up to 511 points.
BLOCK_ROUNDING = 1e-13


def sequence(sampler, dimension=3, replicates=2, seed=7):
    return make_sequence(sampler, dimension, replicates, np.random.SeedSequence(seed))


def unit_points(points, replicate, first, count):
    dimension = points.start.shape[1]
    return naive.fill(points, replicate, first, count, np.zeros(dimension), np.ones(dimension))


def gap_on_circle(a, b):
    return np.abs((a - b + 0.5) % 1 - 0.5)


# --- additive recurrence ------------------------------------------------------------------


@pytest.mark.parametrize("dimension", range(1, 9))
def test_golden_steps_are_rounded_powers_of_the_root(dimension):
    """Roberts 2018: g**-1 .. g**-d, here to the last of 64 bits."""
    steps = golden_steps(dimension)
    assert steps.dtype == np.uint64
    for power, step in enumerate(steps, 1):
        error = Fraction(int(step), 2**64) - naive.golden_step(dimension, power)
        assert abs(error) <= Fraction(1, 2**65)


@pytest.mark.parametrize("first", [0, 3 * BLOCK, FAR])
@pytest.mark.parametrize("dimension", [1, 3, 6])
def test_recurrence_has_random_access(first, dimension):
    """Point k is the fractional part of start + k g**-(1..d), wherever k lies."""
    points = sequence("r-sequence", dimension)
    for replicate in range(2):
        made = unit_points(points, replicate, first, BLOCK)
        start = [int(s) for s in points.start[replicate]]
        for d in range(dimension):
            step = int(points.step[d])
            wanted = [(start[d] + (first + i) * step) % 2**64 / 2**64 for i in range(BLOCK)]
            assert gap_on_circle(made[d], np.array(wanted)).max() < BLOCK_ROUNDING
            # The 64-bit step drifts from the true one by at most 2**-65 a point.
            last = first + BLOCK - 1
            true = Fraction(start[d], 2**64) + last * naive.golden_step(dimension, d + 1)
            assert gap_on_circle(made[d, -1], float(true % 1)) < BLOCK_ROUNDING + last / 2**65


# --- Sobol' -------------------------------------------------------------------------------


def unscrambled(dimension):
    directions = sobol_directions(dimension)
    high = np.zeros((1, dimension, 64), dtype=np.uint64)
    high[0, :, :SOBOL_BITS] = directions
    low = np.zeros((1, dimension, BLOCK), dtype=np.uint64)
    for index in range(BLOCK):
        for bit in range(index.bit_length()):
            if index >> bit & 1:
                low[0, :, index] ^= directions[:, bit]
    start = np.zeros((1, dimension), dtype=np.uint64)
    return Sequence(SAMPLERS.index("sobol"), golden_steps(dimension), start, high, low, 0)


def as_integers(points):
    return np.floor(points * 2**SOBOL_BITS).astype(np.int64)


@pytest.mark.parametrize("dimension", range(1, 9))
@pytest.mark.parametrize("power", [0, 3, 9, 12])
def test_sobol_points_are_scipys(dimension, power):
    """Joe and Kuo 2008; the order differs (SciPy counts in Gray code), sets of 2^k do not."""
    made = unit_points(unscrambled(dimension), 0, 0, 2**power)
    theirs = naive.sobol(dimension, 2**power).T
    assert sorted(zip(*as_integers(made), strict=True)) == sorted(
        zip(*as_integers(theirs), strict=True)
    )


@pytest.mark.parametrize("first", [0, 5 * BLOCK, FAR])
def test_sobol_has_random_access(first):
    """Point k is the shift and the directions of k's bits, all XORed."""
    points = sequence("sobol")
    for replicate in range(2):
        made = unit_points(points, replicate, first, BLOCK)
        for i in (0, 1, 77, BLOCK - 1):
            for d in range(3):
                value = int(points.low[replicate, d, 0])
                for bit in range((first + i).bit_length()):
                    if (first + i) >> bit & 1:
                        value ^= int(points.high[replicate, d, bit])
                assert made[d, i] == (value + 0.5) / 2**SOBOL_BITS


def test_scrambling_takes_its_choices_one_by_one():
    """Bit j from the top of a direction is the parity of its bit j and of a choice of those above.

    What is drawn at once is what is drawn number by number: the points of a seed stay.
    """
    points = sequence("sobol", 5, 2)
    for replicate, child in enumerate(np.random.SeedSequence(7).spawn(2)):
        rng = np.random.Generator(np.random.PCG64(child))
        rng.integers(0, 2**64, size=5, dtype=np.uint64)
        for d, directions in enumerate(sobol_directions(5).tolist()):
            wanted = [0] * SOBOL_BITS
            for j in range(SOBOL_BITS):
                chosen = int(rng.integers(0, 1 << j)) << 1 if j else 0
                mask = (chosen | 1) << (SOBOL_BITS - 1 - j)
                for k, direction in enumerate(directions):
                    wanted[k] |= ((direction & mask).bit_count() & 1) << (SOBOL_BITS - 1 - j)
            assert points.high[replicate, d, :SOBOL_BITS].tolist() == wanted


@pytest.mark.parametrize("power", [4, 9, 11])
def test_scrambled_projections_are_nets(power):
    """One of 2^m points in each of 2^m bins, each coordinate; the first pair is a (0,m,2)-net."""
    points = sequence("sobol", 8, 3)
    count = 2**power
    for replicate in range(3):
        for first in (0, 6 * count):
            made = naive_net(points, replicate, first, count)
            for coordinate in made:
                assert sorted(coordinate) == list(range(count))
            for bits in range(power + 1):
                cells = (made[0] >> (power - bits)) << (power - bits) | made[1] >> bits
                assert len(set(cells.tolist())) == count


def naive_net(points, replicate, first, count):
    """Return the bins of 1/count that ``count`` points from a multiple of ``count`` lie in."""
    aligned = first // BLOCK * BLOCK
    made = unit_points(points, replicate, aligned, first - aligned + count)[:, first - aligned :]
    return np.floor(made * count).astype(np.int64)


def test_scrambling_is_random_in_every_bit():
    """Over many scrambles each coordinate of a point is uniform, and so is that of another."""
    points = sequence("sobol", 3, 200)
    values = np.stack([unit_points(points, r, 0, 4) for r in range(200)])
    for d in range(3):
        for i in (0, 3):
            assert stats.kstest(values[:, d, i], "uniform").pvalue > 1e-3
        # Without a random matrix two points would keep one distance, by XOR, in all replicates.
        bits = as_integers(values[:, d, 0]) ^ as_integers(values[:, d, 3])
        assert len(set(bits.tolist())) == 200
    across = np.corrcoef(values[:, :, 0].T)[~np.eye(3, dtype=bool)]
    assert np.abs(across).max() < 4.5 / np.sqrt(200)


# --- Monte Carlo --------------------------------------------------------------------------


@pytest.mark.parametrize("first", [0, FAR])
def test_monte_carlo_has_random_access(first):
    """Number k of the stream is splitmix64 of key + k golden ratios (Steele et al. 2014)."""
    points = sequence("monte-carlo")
    made = unit_points(points, 1, first, BLOCK)
    key = int(points.start[1, 0])
    for i in (0, 1, BLOCK - 1):
        for d in range(3):
            bits = naive.splitmix(key + ((first + i) * 3 + d) * 0x9E3779B97F4A7C15)
            assert made[d, i] == ((bits >> 12) + 0.5) / 2**52


def test_splitmix_oracle():
    """First outputs for seed 1234567 of the reference implementation."""
    golden = 0x9E3779B97F4A7C15
    assert [naive.splitmix(1234567 + k * golden) for k in (1, 2)] == [
        6457827717110365317,
        3203168211198807973,
    ]


def test_monte_carlo_is_uniform_and_independent():
    points = sequence("monte-carlo", 3, 2)
    made = np.concatenate([unit_points(points, r, 0, 8 * BLOCK) for r in range(2)])
    for row in made:
        assert stats.kstest(row, "uniform").pvalue > 1e-3
    # Correlations of independent rows are normal with variance 1 / N.
    bound = 4.5 / np.sqrt(made.shape[1])
    ranks = np.corrcoef(made)
    assert np.abs(ranks[~np.eye(6, dtype=bool)]).max() < bound
    for lag in (1, 2, 3):
        for row in made:
            assert abs(np.corrcoef(row[lag:], row[:-lag])[0, 1]) < bound
    cells = np.floor(made[:3] * 8).astype(int)
    counts = np.bincount(cells[0] * 64 + cells[1] * 8 + cells[2], minlength=512)
    assert stats.chisquare(counts).pvalue > 1e-3


# --- grid and what all share --------------------------------------------------------------


@pytest.mark.parametrize(("dimension", "cells"), [(1, 7), (2, 30), (3, 11), (4, 5)])
def test_grid_is_meshgrid_of_midpoints(dimension, cells):
    lower, width = np.arange(dimension) - 1.5, np.arange(dimension) + 0.5
    made = naive.fill(make_grid(dimension, cells), 0, 0, cells**dimension, lower, width)
    axes = [low + w * (np.arange(cells) + 0.5) / cells for low, w in zip(lower, width, strict=True)]
    wanted = np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")])
    np.testing.assert_allclose(made, wanted, rtol=0, atol=1e-14)


@pytest.mark.parametrize("sampler", RANDOM)
def test_points_fill_the_box(sampler):
    """Affine image of the unit points, inside the box and near each of its faces."""
    points = sequence(sampler)
    lower, width = np.array([-1.0, 2.0, 0.5]), np.array([0.5, 3.0, 1e-3])
    made = naive.fill(points, 0, 0, 4 * BLOCK, lower, width)
    unit = unit_points(points, 0, 0, 4 * BLOCK)
    np.testing.assert_allclose((made - lower[:, None]) / width[:, None], unit, atol=1e-12)
    assert unit.min() >= 0
    assert unit.max() < 1
    assert (unit.min(axis=1) < 0.01).all()
    assert (unit.max(axis=1) > 0.99).all()


@pytest.mark.parametrize("sampler", RANDOM)
def test_replicates_differ_and_do_not_depend_on_their_number(sampler):
    few, many = sequence(sampler, replicates=2), sequence(sampler, replicates=5)
    made = [unit_points(many, r, 0, BLOCK) for r in range(5)]
    for r in range(2):
        assert (unit_points(few, r, 0, BLOCK) == made[r]).all()
    for r in range(5):
        for s in range(r):
            assert np.abs(made[r] - made[s]).max(axis=1).min() > 1e-6
    other = unit_points(sequence(sampler, seed=8), 0, 0, BLOCK)
    assert np.abs(other - made[0]).max(axis=1).min() > 1e-6
