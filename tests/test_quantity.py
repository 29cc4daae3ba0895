"""Numbers with an error and a unit: how they print, and that they are numbers."""

import copy
import json
import math
import operator
import pickle

import numpy as np
import pytest

from pmopt.quantity import Quantity

VOLUME = Quantity(12.3449, 0.0123, "m^3")


@pytest.mark.parametrize(("quantity", "text"), [
    (VOLUME, "12.345 ± 0.012 m^3"),
    (Quantity(0.5, 0.01), "0.500 ± 0.010"),
    (Quantity(2.153e8, 1.7e7, "mm^3"), "(2.15 ± 0.17)e8 mm^3"),
    (Quantity(12.3449, 0.0123, "m^3", bounded=True), "12.345 ± 0.012 m^3 (bound)"),
    (Quantity(12.3449, 0.0123, "m^3", ">="), ">= 12.345 ± 0.012 m^3"),
    (Quantity(0.123456789, 0.0, sign="<="), "<= 0.123457"),
    (Quantity(0.123456789, 0.0), "0.123457"),
    (Quantity(3.0, math.nan, "N"), "3 ± ? N"),
    (Quantity(math.nan, math.nan, "m^3"), "-"),
    (Quantity(math.nan, 0.0, sign="<="), "-"),
    (Quantity(math.inf, math.nan, "N"), "inf ± ? N"),
])  # fmt: skip
def test_how_it_prints(quantity, text):
    assert str(quantity) == repr(quantity) == f"{quantity}" == text


def test_it_is_a_number():
    assert VOLUME == 12.3449 == float(VOLUME)
    assert VOLUME != 12
    assert VOLUME < 13 <= max(VOLUME, 13)
    assert type(VOLUME.value) is float
    assert (VOLUME / 2, 1 + VOLUME, -VOLUME) == (12.3449 / 2, 13.3449, -12.3449)
    assert f"{VOLUME:.2f} {VOLUME:8.1e}|" == "12.34  1.2e+01|"
    assert {VOLUME: 1}[12.3449] == 1
    assert math.sqrt(VOLUME) == math.sqrt(12.3449)
    array = np.array([VOLUME, VOLUME])
    assert (array.shape, array.dtype) == ((2,), np.float64)
    assert np.asarray(VOLUME).shape == ()
    assert operator.eq(VOLUME, np.array([12.3449, 1.0])).tolist() == [True, False]
    assert operator.ne(VOLUME, np.array([12.3449, 1.0])).tolist() == [False, True]
    assert operator.eq(VOLUME, pytest.approx(12.3449 + 1e-9))
    assert VOLUME != "12.3449"
    assert json.dumps([VOLUME]) == "[12.3449]"


def test_it_is_taken_apart_and_copied():
    value, error = VOLUME
    assert (value, error) == VOLUME == (12.3449, 0.0123)
    for same in (copy.deepcopy(VOLUME), pickle.loads(pickle.dumps(VOLUME))):
        assert (str(same), same.unit, same.error) == (str(VOLUME), "m^3", 0.0123)
    assert str(VOLUME.in_unit("mm^3", sign="<=")) == "<= 12.345 ± 0.012 mm^3"
    assert (VOLUME.bound, Quantity(0.1, 0.0, sign="<=").bound) == ("proven", "found")


def test_it_cannot_be_changed():
    with pytest.raises(AttributeError, match="error of a quantity"):
        VOLUME.error = 0.0
