"""Formulas of the time: what they are worth, their derivatives, and what is refused."""

import math
import string

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from pmopt.analysis.motion.formulas import (
    MAX_DEPTH,
    MAX_EXPONENT,
    MAX_LENGTH,
    check_constants,
    parse,
)
from pmopt.errors import InputError
from pmopt.numerics.derivatives import FUNCTIONS

WHERE = "c.toml: trajectory.x"
CONSTANTS = {"a": 0.7, "phase1": -1.3}

# --- formulas beside functions of a complex number -------------------------------------------

NUMPY = {
    "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin, "acos": np.arccos,
    "atan": np.arctan, "sqrt": np.sqrt, "exp": np.exp, "log": np.log,
    "rad": lambda x: x * (np.pi / 180), "deg": lambda x: x * (180 / np.pi),
}  # fmt: skip
OPERATORS = {
    "+": lambda x, y: x + y, "-": lambda x, y: x - y, "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
}  # fmt: skip


def number(value):
    return repr(value), lambda t: value + 0 * t


leaves = st.one_of(
    st.just(("t", lambda t: t)),
    st.just(("pi", lambda t: np.pi + 0 * t)),
    st.sampled_from([(k, lambda t, v=v: v + 0 * t) for k, v in CONSTANTS.items()]),
    st.floats(0.1, 9).map(number),
)


def larger(inner):
    return st.one_of(
        st.builds(
            lambda a, o, b: (f"({a[0]}) {o} ({b[0]})", lambda t: OPERATORS[o](a[1](t), b[1](t))),
            inner, st.sampled_from(sorted(OPERATORS)), inner,
        ),
        st.builds(
            lambda f, a: (f"{f}({a[0]})", lambda t: NUMPY[f](a[1](t))),
            st.sampled_from(sorted(FUNCTIONS)), inner,
        ),
        st.builds(
            lambda a, n: (f"({a[0]})**{n}", lambda t: a[1](t) ** n),
            inner, st.sampled_from([0, 1, 2, 3, -1, -2, 0.5, 2.5]),
        ),
        inner.map(lambda a: (f"-({a[0]})", lambda t: -a[1](t))),
    )  # fmt: skip


formulas = st.recursive(leaves, larger, max_leaves=8)


def derivative(function, t, step=1e-30):
    """Return the derivative by a complex step: exact to rounding."""
    return np.imag(function(t + 1j * step)) / step


@given(formulas, st.floats(0.05, 3))
@example(("sin(pi*t/6 - pi/3)", lambda t: np.sin(np.pi * t / 6 - np.pi / 3)), 1.0)
def test_values_and_derivatives(formula, time):
    text, function = formula
    t = np.array([time])
    h = 1e-3
    places = time + h * np.array([-3, -2, -1, 0, 1, 2, 3])
    with np.errstate(all="ignore"):
        values = function(places)
        slopes = derivative(function, places)
    # Where it is smooth and of moderate size, finite differences can tell.
    assume(np.isfinite(values).all() and np.isfinite(slopes).all())
    assume(max(np.abs(values).max(), np.abs(slopes).max()) < 1e4)
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
    coarse = np.array([0, 1, -8, 0, 8, -1, 0]) / (12 * h)
    second, other = weights @ slopes, coarse @ slopes
    size = max(1.0, np.abs(slopes).max(), abs(second))
    assume(abs(second - other) < 1e-6 * size)
    jet = parse(text, CONSTANTS, WHERE)(t)
    assert jet.value[0] == pytest.approx(float(np.real(values[3])), rel=1e-12, abs=1e-12)
    # The complex plane's functions round otherwise near the ends of their domain.
    assert jet.first[0] == pytest.approx(slopes[3], rel=1e-8, abs=1e-9 * size)
    assert jet.second[0] == pytest.approx(second, rel=1e-6, abs=1e-6 * size)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function(name):
    """Within all domains: rates by complex step, accelerations by differences of these."""
    t, h = np.linspace(0, 3, 31), 1e-3

    def function(t):
        return NUMPY[name](0.5 + 0.3 * np.sin(2 * t))

    jet = parse(f"{name}(0.5 + 0.3*sin(2*t))", {}, WHERE)(t)
    np.testing.assert_allclose(jet.value, function(t), rtol=1e-14)
    np.testing.assert_allclose(jet.first, derivative(function, t), rtol=1e-12, atol=1e-13)
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * h)
    slopes = [derivative(function, t + k * h) for k in range(-3, 4)]
    np.testing.assert_allclose(jet.second, weights @ slopes, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2 + 3*4 - 6/2", 11.0),
        ("-2**2", -4.0),
        ("2**3**2", 512.0),
        ("2**-1", 0.5),
        ("  1.5e-1 ", 0.15),
        ("7 - 2 - 1", 4.0),
        ("8/4/2", 1.0),
        ("rad(180) - pi", 0.0),
        ("deg(pi)", 180.0),
        ("+t", 2.0),
        (".5*t", 1.0),
        ("phase1", -1.3),
    ],
)
def test_reads_as_written(text, value):
    assert parse(text, CONSTANTS, WHERE)(np.array([2.0])).value[0] == pytest.approx(
        value, abs=1e-15
    )


def test_whole_powers_at_zero_and_below():
    jet = parse("t**3", {}, WHERE)(np.array([0.0, -2.0]))
    np.testing.assert_array_equal(jet, [[0, -8], [0, 12], [0, -12]])
    jet = parse("t**1 + t**0", {}, WHERE)(np.array([0.0]))
    np.testing.assert_array_equal(jet, [[1], [1], [0]])


REFUSED = [
    ("", "is empty"),
    ("t +", "position"),
    ("t) + (t", "position 2"),
    ("x + t", "position 1: unknown name 'x'"),
    ("t + sine(t)", "position 5: unknown name 'sine'"),
    ("t + sin", "position 5: 'sin' is a function"),
    ("1 + sin(t, t)", "position 5: 'sin(t, t)' takes one argument"),
    ("sin()", "takes one argument"),
    ("sin(x=t)", "takes one argument"),
    ("t**t", "position 4: 't' is no constant"),
    ("9**9**9", "position 4: '9**9' is 3.8742e+08"),
    ("t**1000", f"at most {MAX_EXPONENT}"),
    ("1e400*t", "position 1: '1e400' is no finite number"),
    ("1_000*t", "position 1: '1_000' is not allowed"),
    ("0x10", "not allowed"),
    ("1j", "not allowed"),
    ("t.real", "not allowed"),
    ("t[0]", "not allowed"),
    ("[t]", "not allowed"),
    ("t if t else 1", "not allowed"),
    ("lambda: t", "not allowed"),
    ("(t := 2)", "not allowed"),
    ("t < 1", "not allowed"),
    ("t // 2", "not allowed"),
    ("t % 2", "not allowed"),
    ("'t'", "not allowed"),
    ("True", "not allowed"),
    ("f'{t}'", "not allowed"),
    ("__import__('os').system('true')", "position 1"),
    ("t; t", "one expression"),
    ("t # t", "one expression"),
    ("t\nt", "position 2"),
    ("2·t", "position 2: '·'"),
    ("1is t", "position"),
    ("t" * (MAX_LENGTH + 1), "too long"),
    ("(" * (MAX_DEPTH + 1) + "t" + ")" * (MAX_DEPTH + 1), "nested deeper"),
    ("-" * 1000 + "t", "nested deeper"),
]


@pytest.mark.parametrize(("text", "told"), REFUSED)
def test_refused_in_one_line(text, told, recwarn):
    with pytest.raises(InputError) as caught:
        parse(text, CONSTANTS, WHERE)
    message = str(caught.value)
    assert message.startswith(WHERE)
    assert told in message
    assert "\n" not in message and len(message) < 500
    assert not recwarn.list


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("log(t)", "at t=0.0 s it is -inf"),
        ("sqrt(t)", "at t=0.0 s its rate is inf"),
        ("t**1.5", "at t=0.0 s its acceleration is inf"),
        ("asin(2*t)", "at t=0.5 s its rate is inf"),
        ("exp(exp(10*t))", "at t=0.5 s"),
        ("1e300*t*1e300", "at t=0.0 s its rate is inf"),
        ("log(t - 0.7)", "at t=0.0 s it is not defined"),
    ],
)
def test_where_it_is_no_motion(text, told):
    with pytest.raises(InputError, match=r"c.toml: trajectory.x: ") as caught:
        parse(text, {}, WHERE)(np.array([0.0, 0.5, 1.0]))
    assert told in str(caught.value)


def test_long_sums_are_no_deep_ones():
    text = "+".join(["t"] * (MAX_LENGTH // 2))
    jet = parse(text, {}, WHERE)(np.array([2.0]))
    assert jet.value[0] == 2.0 * (MAX_LENGTH // 2)
    assert jet.first[0] == MAX_LENGTH // 2


@given(
    st.text(st.sampled_from("t1.5+-*/()[]{}'\" =<>,;:abcpisinqrtexplog_\\@!~^&|%\n#0"), max_size=40)
)
def test_any_text_is_a_formula_or_one_line(text):
    try:
        jet = parse(text, CONSTANTS, WHERE)(np.array([0.5, 1.0]))
    except InputError as error:
        assert str(error).startswith(WHERE)
    else:
        assert np.isfinite(jet).all()
        assert set(text) <= set(string.ascii_letters + string.digits + "+-*/(). _")


@pytest.mark.parametrize("name", ["t", "pi", "sin", "rad", "1a", "a b", "", "a.b", "größe"])
def test_names_of_constants(name):
    with pytest.raises(InputError, match=r"c.toml: trajectory.constants: "):
        check_constants({name: 1.0}, "c.toml: trajectory.constants")


def test_constants_are_named_in_what_is_allowed():
    with pytest.raises(InputError, match="nearest: phase1"):
        parse("phase", CONSTANTS, WHERE)
    assert math.isfinite(parse("phase1", CONSTANTS, WHERE)(np.zeros(1)).value[0])
