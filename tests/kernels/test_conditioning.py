"""Closed forms of the inverse condition number against singular values."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import naive

from pmopt.kernels.conditioning import (
    careful_condition_2,
    careful_condition_fro,
    inverse_condition_2,
    inverse_condition_fro,
)

EPS = np.finfo(float).eps
ACCURACY = 1e-12
CAREFUL = {
    inverse_condition_2: careful_condition_2,
    inverse_condition_fro: careful_condition_fro,
}
BOTH = pytest.mark.parametrize(
    ("norm", "index"), [("2", inverse_condition_2), ("fro", inverse_condition_fro)]
)

seeds = st.integers(0, 2**32 - 1)
# Few digits, so that exact zeros, equal rows and vanishing determinants are common.
entries = st.lists(st.integers(-(2**20), 2**20).map(lambda k: k / 2**20), min_size=9, max_size=9)
small_integers = st.lists(st.integers(-9, 9), min_size=3, max_size=3)


def rotation(rng):
    return np.linalg.qr(rng.normal(size=(3, 3)))[0]


def with_singular_values(seed, values):
    rng = np.random.default_rng(seed)
    return rotation(rng) @ np.diag(values) @ rotation(rng)


def apply(index, matrix):
    """Return the index as the sweep does: the closed form's, or a careful one where it doubts."""
    entries = list(map(float, np.asarray(matrix).ravel()))
    found = index(*entries)
    return found if found >= 0 else CAREFUL[index](*entries)


@BOTH
@given(entries)
def test_equals_singular_values(norm, index, values):
    matrix = np.reshape(values, (3, 3))
    assert apply(index, matrix) == pytest.approx(
        naive.inverse_condition(matrix, norm), abs=ACCURACY
    )


@given(seeds, st.floats(-7, 0), st.floats(-9, 0), st.floats(-40, 40))
def test_nearly_singular_and_wildly_scaled(seed, second, third, scale):
    """The error of a determinant, eps, reaches the index divided by the second singular value."""
    values = np.array([1, 10**second, 10 ** (second + third)])
    matrix = with_singular_values(seed, values) * 10.0**scale
    expected = naive.inverse_condition(matrix, "2")
    assert apply(inverse_condition_2, matrix) == pytest.approx(expected, abs=ACCURACY)
    expected = naive.inverse_condition(matrix, "fro")
    assert apply(inverse_condition_fro, matrix) == pytest.approx(expected, abs=4 * EPS / values[1])


@given(seeds, st.floats(-17, -4))
def test_nearly_isotropic(seed, size):
    rng = np.random.default_rng(seed)
    matrix = rotation(rng) @ (np.eye(3) + 10**size * rng.normal(size=(3, 3)))
    value = apply(inverse_condition_2, matrix)
    assert value == pytest.approx(naive.inverse_condition(matrix, "2"), abs=ACCURACY)
    assert value <= 1
    assert apply(inverse_condition_fro, matrix) == pytest.approx(
        naive.inverse_condition(matrix, "fro"), abs=4 * EPS
    )


@given(seeds, st.floats(0.05, 1), st.floats(-12, -2))
def test_two_equal_singular_values(seed, value, gap):
    """Smallest and second nearly equal, then second and largest."""
    for values in ([1, value, value * (1 - 10**gap)], [1, 1 - 10**gap, value * (1 - 10**gap)]):
        matrix = with_singular_values(seed, values)
        expected = naive.inverse_condition(matrix, "2")
        assert apply(inverse_condition_2, matrix) == pytest.approx(expected, abs=ACCURACY)


@given(st.permutations([0, 1, 2]), st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=3))
def test_diagonal_in_any_order(order, diagonal):
    matrix = np.diag(diagonal)[order]
    expected = min(diagonal) / max(diagonal)
    assert apply(inverse_condition_2, matrix) == pytest.approx(expected, abs=ACCURACY)
    squares = np.square(diagonal)
    expected = 1 / np.sqrt(squares.sum() * (1 / squares).sum())
    assert apply(inverse_condition_fro, matrix) == pytest.approx(expected, rel=1e-13)


@given(seeds)
def test_isotropy_is_one_and_a_third(seed):
    """The Frobenius index is a third of the other where J is isotropic."""
    rng = np.random.default_rng(seed)
    for _ in range(20):  # one in fifty would be above 1 by rounding
        matrix = 0.37 * rotation(rng)
        assert 1 - ACCURACY < apply(inverse_condition_2, matrix) <= 1
        assert apply(inverse_condition_fro, matrix) == pytest.approx(1 / 3, abs=4 * EPS)


@BOTH
@given(small_integers, small_integers)
def test_rank_one_and_zero_give_zero(norm, index, u, v):
    """Products of small integers are exact, so the minors vanish and the index with them."""
    assert apply(index, np.outer(u, v)) == 0
    assert apply(index, np.zeros((3, 3))) == 0


@BOTH
def test_rounded_rank_one(norm, index):
    rng = np.random.default_rng(0)
    for _ in range(50):
        matrix = np.outer(rng.normal(size=3), rng.normal(size=3))
        expected = naive.inverse_condition(matrix, norm)
        assert apply(index, matrix) == pytest.approx(expected, abs=ACCURACY)


@BOTH
@given(seeds, st.floats(-2, 0))
def test_rank_two_is_nearly_zero(norm, index, seed, second):
    matrix = with_singular_values(seed, [1, 10**second, 0])
    assert apply(index, matrix) <= 4 * EPS / 10**second


@BOTH
@given(seeds, st.floats(-30, 30))
def test_invariances(norm, index, seed, scale):
    matrix = np.random.default_rng(seed).normal(size=(3, 3))
    value = apply(index, matrix)
    assert value > 0
    inverse = np.linalg.inv(matrix)
    # The inverse carries an error of eps over the index.
    tolerance = ACCURACY if norm == "2" else 1e-14 / value
    for other in (matrix * 10**scale, -matrix, matrix.T, matrix[[2, 0, 1]], inverse):
        assert apply(index, other) == pytest.approx(value, abs=tolerance)
