"""Elementary functions that give the same bits on every processor.

Those of ``math`` are the C library's and those of NumPy have code for each kind of processor; their
last bits differ between machines. These are made of additions, multiplications, divisions and
square roots alone, each correctly rounded everywhere, and are in error by less than 2 units in the
last place. ``math.hypot``, ``math.sqrt`` and ``math.ldexp`` are of that kind already.

Polynomials and reductions are those of fdlibm (Sun Microsystems 1993): k_sin.c, k_cos.c,
e_rem_pio2.c, e_exp.c, e_log.c.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmopt.kernels import trigonometry
from pmopt.kernels.trigonometry import arc_tangent

Values = NDArray[np.float64]

# pi / 2 in parts of 33 bits, and what follows the second.
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
#: Angles up to here are reduced in three parts, larger ones in whole numbers.
_MEDIUM = 1e5
#: pi / 2 scaled by 2**_BITS: enough for the largest double.
_BITS = 1200
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_INVERSE_LN2 = 1.44269504088896338700e00
_EXP = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05,
    -1.65339022054652515390e-06, 4.13813679705723846039e-08,
)  # fmt: skip
_LOG = (
    6.666666666666735130e-01, 3.999999999940941908e-01, 2.857142874366239149e-01,
    2.222219843214978396e-01, 1.818357216161805012e-01, 1.531383769920937332e-01,
    1.479819860511658591e-01,
)  # fmt: skip
_ROOT_HALF = 0.7071067811865476
#: Arguments of the exponential function beyond which it is infinite or 0.
_OVERFLOW, _UNDERFLOW = 709.782712893384, -745.1332191019411
_WHOLE = 1024


def _scaled_pi() -> int:
    """Return pi / 2 times 2**_BITS, rounded: Machin's formula in whole numbers."""
    one = 1 << (_BITS + 64)

    def arctan_of_inverse(n: int) -> int:
        power = total = one // n
        k = 1
        while power:
            power //= -n * n
            k += 2
            total += power // k
        return total

    quarter = 4 * arctan_of_inverse(5) - arctan_of_inverse(239)
    return (2 * quarter) >> 64


def _reduced(angle: float) -> tuple[int, float, float]:
    """Return k modulo 4 and the angle less k pi / 2, as a sum of two numbers."""
    if abs(angle) <= 0.7853981633974483:
        return 0, angle, 0.0
    if abs(angle) > _MEDIUM:
        above, below = angle.as_integer_ratio()
        half_pi = _scaled_pi()
        scaled = (above << _BITS) // below
        k = (2 * scaled + half_pi) // (2 * half_pi)
        rest = scaled - k * half_pi
        shift = max(rest.bit_length() - 60, 0)
        high = math.ldexp(float(rest >> shift), shift - _BITS)
        return k & 3, high, 0.0
    turns = math.floor(angle * trigonometry.TWO_OVER_PI + 0.5)
    return turns & 3, *_less(angle, turns)


# Of numbers and of arrays, with the same bits.
def _less(angle: Any, turns: Any) -> tuple[Any, Any]:
    """Return an angle less some quarter turns, as a sum of two numbers."""
    first = angle - turns * _HALF_PI[0]
    less = turns * _HALF_PI[1]
    rest = first - less
    less = turns * _HALF_PI[2] - ((first - rest) - less)
    high = rest - less
    return high, (rest - high) - less


def _sine(x: Any, y: Any) -> Any:
    z = x * x
    v = z * x
    r = trigonometry.S2 + z * (
        trigonometry.S3 + z * (trigonometry.S4 + z * (trigonometry.S5 + z * trigonometry.S6))
    )
    return x - ((z * (0.5 * y - v * r) - y) - v * trigonometry.S1)


def _cosine(x: Any, y: Any) -> Any:
    z = x * x
    w = z * z
    r = z * (trigonometry.K1 + z * (trigonometry.K2 + z * trigonometry.K3)) + w * w * (
        trigonometry.K4 + z * (trigonometry.K5 + z * trigonometry.K6)
    )
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + (z * r - x * y))


def sin_cos(angle: float) -> tuple[float, float]:
    """Return sine and cosine of a finite angle."""
    quadrant, x, y = _reduced(float(angle))
    s, c = _sine(x, y), _cosine(x, y)
    if quadrant & 1:
        s, c = c, -s
    return (-s, -c) if quadrant & 2 else (s, c)


def sin(angle: float) -> float:
    """Return the sine of a finite angle."""
    return sin_cos(angle)[0]


def cos(angle: float) -> float:
    """Return the cosine of a finite angle."""
    return sin_cos(angle)[1]


def tan(angle: float) -> float:
    """Return the tangent of a finite angle."""
    s, c = sin_cos(angle)
    return s / c


def atan2(y: float, x: float) -> float:
    """Return the angle of (x, y), both finite, in [-pi, pi]."""
    return float(arc_tangent(float(y), float(x)))  # type: ignore[no-untyped-call]


def asin(x: float) -> float:
    """Return the angle in [-pi / 2, pi / 2] with this sine."""
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


def acos(x: float) -> float:
    """Return the angle in [0, pi] with this cosine."""
    return atan2(math.sqrt((1.0 - x) * (1.0 + x)), x)


def exp(x: float) -> float:
    """Return e to the power of x."""
    x = float(x)
    if x != x or x > _OVERFLOW:
        return x if x != x else math.inf
    if x < _UNDERFLOW:
        return 0.0
    k = math.floor(x * _INVERSE_LN2 + 0.5)
    high, low = x - k * _LN2_HIGH, k * _LN2_LOW
    r = high - low
    z = r * r
    p = _EXP
    c = r - z * (p[0] + z * (p[1] + z * (p[2] + z * (p[3] + z * p[4]))))
    return math.ldexp(1.0 - ((low - (r * c) / (2.0 - c)) - high), k)


def log(x: float) -> float:
    """Return the natural logarithm of x > 0."""
    x = float(x)
    if not 0.0 < x < math.inf:
        return math.log(x) if x != math.inf else x  # raises as that does
    m, k = math.frexp(x)
    if m < _ROOT_HALF:
        m, k = 2.0 * m, k - 1
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    p = _LOG
    r = z * (p[0] + z * (p[1] + z * (p[2] + z * (p[3] + z * (p[4] + z * (p[5] + z * p[6]))))))
    half = 0.5 * f * f
    return k * _LN2_HIGH - ((half - (s * (half + r) + k * _LN2_LOW)) - f)


def power(x: float, exponent: float) -> float:
    """Return x to a power; x > 0 where the exponent is not whole."""
    if float(exponent).is_integer() and abs(exponent) <= _WHOLE:
        n, square, found = abs(int(exponent)), float(x), 1.0
        while n:
            found = found * square if n & 1 else found
            n >>= 1
            square = square * square if n else square
        return found if exponent >= 0 else 1.0 / found
    return exp(exponent * log(x)) if x > 0 else 0.0


def each(function: Callable[..., float], *arguments: ArrayLike) -> Values:
    """Return a function of one of these of every element of arrays, broadcast."""
    arrays = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in arguments))
    flat = map(function, *(a.ravel().tolist() for a in arrays))
    return np.fromiter(flat, dtype=np.float64, count=arrays[0].size).reshape(arrays[0].shape)


def sin_cos_of(angles: ArrayLike) -> tuple[Values, Values]:
    """Return sines and cosines of finite angles of at most some thousand turns, NaN of NaN."""
    angle = np.asarray(angles, dtype=np.float64)
    turns = np.floor(angle * trigonometry.TWO_OVER_PI + 0.5)
    x, y = _less(angle, turns)
    s, c = _sine(x, y), _cosine(x, y)
    quadrant = turns - 4.0 * np.floor(0.25 * turns)
    odd = (quadrant == 1.0) | (quadrant == 3.0)
    sine, cosine = np.where(odd, c, s), np.where(odd, s, c)
    return (
        np.where(quadrant > 1.5, -sine, sine),
        np.where((quadrant == 1.0) | (quadrant == 2.0), -cosine, cosine),
    )


def exp_of(values: Values) -> Values:
    """Return e to the power of finite numbers within +-700."""
    k = np.floor(values * _INVERSE_LN2 + 0.5)
    high, low = values - k * _LN2_HIGH, k * _LN2_LOW
    r = high - low
    z = r * r
    p = _EXP
    c = r - z * (p[0] + z * (p[1] + z * (p[2] + z * (p[3] + z * p[4]))))
    return np.ldexp(1.0 - ((low - (r * c) / (2.0 - c)) - high), k.astype(np.int64))


def log_of(values: Values) -> Values:
    """Return the natural logarithms of numbers > 0."""
    m, k = np.frexp(values)
    small = m < _ROOT_HALF
    m, k = np.where(small, 2.0 * m, m), k - small
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    p = _LOG
    r = z * (p[0] + z * (p[1] + z * (p[2] + z * (p[3] + z * (p[4] + z * (p[5] + z * p[6]))))))
    half = 0.5 * f * f
    return np.asarray(k * _LN2_HIGH - ((half - (s * (half + r) + k * _LN2_LOW)) - f))


def power_of(values: Values, exponent: float) -> Values:
    """Return numbers >= 0 to a power; 0 stays 0."""
    positive = np.where(values > 0, values, 1.0)
    found = exp_of(np.clip(exponent * log_of(positive), -700.0, 700.0))
    return np.where(values > 0, found, 0.0)
