"""Numbers with units."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmopt.inputs.quantities import UNITS, QuantityError, parse_quantity, parse_unit

TEXTS = [
    ("650mm", "m", 0.65),
    ("0.65", "m", 0.65),
    ("0.65m", "mm", 650.0),
    ("15deg", "rad", math.radians(15)),
    ("15 °", "rad", math.radians(15)),
    ("-.5deg", "rad", math.radians(-0.5)),
    ("2kg", "kg", 2.0),
    ("250 g", "kg", 0.25),
    ("3Nm", "N m", 3.0),
    ("3 N m", "N m", 3.0),
    ("3 N*m", "N m", 3.0),
    ("400ms", "s", 0.4),
    ("90 rpm", "rad/s", 3 * math.pi),
    ("30 deg/s", "rad/s", math.radians(30)),
    ("9.81 m/s²", "m/s^2", 9.81),
    ("2 m s⁻²", "m/s^2", 2.0),
    ("1500 mm/s2", "m/s^2", 1.5),
    ("2 kg mm^2", "kg m^2", 2e-6),
    ("20%", "1", 0.2),
    ("5 Nm/deg", "N m/rad", 5 * 180 / math.pi),
    ("1e-3 in", "mm", 0.0254),
    ("1_000mm", "m", 1.0),
    ("1732771701123456789 ns", "s", 1732771701.123456789),
    ("inf", "m", math.inf),
    ("1e999mm", "m", math.inf),
]


@pytest.mark.parametrize(("text", "unit", "value"), TEXTS)
def test_a_quantity_is_rounded_once(text, unit, value):
    assert parse_quantity(text, unit) == pytest.approx(value, rel=2e-16, abs=0)


def test_common_quantities_are_exact():
    for number in range(1, 2000):
        assert parse_quantity(f"{number}mm", "m") == number / 1000
        assert parse_quantity(f"{number}deg", "rad") == math.radians(number)


@pytest.mark.parametrize(
    ("text", "unit", "says"),
    [
        ("15deg", "m", "the unit deg does not fit: a number in m is needed"),
        ("15deg", "1", "a plain number is needed"),
        ("2 1/s", "rad/s", "does not fit"),
        ("650 MM", "m", "'MM' is not a known unit: mm?"),
        ("650 mmm", "m", "not a known unit"),
        ("0,65", "m", "a decimal point is needed"),
        ("1m+2m", "m", "not a known unit"),
        ("0.7*m", "m", "no number"),
        ("5/s", "1/s", "no number"),
        ("m", "m", "no number"),
        ("", "m", "no number"),
        ("0x10", "m", "not a known unit"),
        ("1e", "m", "not a known unit"),
    ],
)
def test_what_is_no_quantity(text, unit, says):
    with pytest.raises(QuantityError, match=None) as error:
        parse_quantity(text, unit)
    assert says in str(error.value)
    assert "\n" not in str(error.value)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(sorted(UNITS)))
def test_every_number_in_its_own_unit_is_itself(value, symbol):
    assert parse_quantity(f"{value!r}{' ' if symbol[0].isdigit() else ''}{symbol}", symbol) == value


@given(st.text(max_size=20))
def test_no_text_raises_anything_else(text):
    try:
        parse_quantity(text, "m")
    except QuantityError as error:
        assert len(str(error).splitlines()) <= 1 or "\n" in text


def test_aliases_and_products():
    assert parse_unit("N m") == parse_unit("Nm") == parse_unit("kg m^2/s^2") == parse_unit("J")
    assert parse_unit("°/s") == parse_unit("deg/s")
