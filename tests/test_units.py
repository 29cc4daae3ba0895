"""Numbers and ranges in words."""

import math

import pytest

from pmopt.units import span_text


@pytest.mark.parametrize(("ends", "text"), [
    ((-1.8499999999999999, 1.8499999999999999), "-1.85 .. 1.85 m"),
    ((-0.1, 0.123456789012345), "-0.1 .. 0.123456789012345 m"),
    ((-math.inf, 1e-7), "-inf .. 1e-07 m"),
    ((-0.0, 650), "0 .. 650 m"),
])  # fmt: skip
def test_a_range_has_the_digits_that_it_was_given_with(ends, text):
    assert span_text(ends, "m") == text
