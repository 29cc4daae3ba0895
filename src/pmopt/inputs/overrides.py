"""Keys of a configuration given on the command line, and the values of a sweep.

``algorithm.population=50`` sets a key by its dotted name; the value is read as TOML where it is
that, else it is text, so that ``parameters.l1=650mm`` needs no quotes.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from pmopt.errors import InputError
from pmopt.inputs.reading import parse_toml

SET = "--set"
#: Most values of a range.
MOST = 100_000
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?"
_RANGE = re.compile(rf"\s*({_NUMBER})\s*:\s*({_NUMBER})\s*:\s*({_NUMBER})\s*")


def read_overrides(texts: Sequence[str]) -> dict[str, str]:
    """Return dotted keys and the texts of their values.

    Raises
    ------
    InputError
        For what is not a KEY=VALUE, and a key that is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        key, value = key.strip(), value.strip()
        if not equals or not value or not all(part.strip() for part in key.split(".")):
            raise InputError(f"{SET}: {text!r} is not KEY=VALUE, such as algorithm.population=50")
        if key in found:
            raise InputError(f"{SET}: {key} is given twice")
        found[key] = value
    return found


def toml_value(text: str) -> Any:
    """Return the value of a text as TOML has it, or the text."""
    try:
        found = parse_toml(f"value = {text}")
    except ValueError:
        return text
    return found["value"] if len(found) == 1 else text


def overridden(data: dict[str, Any], texts: Sequence[str]) -> dict[str, Any]:
    """Return a configuration with the keys of ``--set`` in place.

    Raises
    ------
    InputError
        Also where a key leads through a value that is not a table.
    """
    changed = copy.deepcopy(data)
    for key, text in read_overrides(texts).items():
        set_key(changed, key, toml_value(text), SET)
    return changed


def set_key(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Set a value by its dotted key, making tables on the way.

    Raises
    ------
    InputError
    """
    *path, last = key.split(".")
    for name in path:
        data = data.setdefault(name, {})
        if not isinstance(data, dict):
            raise InputError(f"{where}: {key}: {name} is not a table")
    data[last] = value


def sweep_values(text: str) -> list[Any] | None:
    """Return the values of a comma list or of a range ``from:to:step``; None for one value."""
    span = range_values(text)
    if span is not None:
        return span
    if isinstance(toml_value(text), str) and "," in text:
        return [toml_value(part.strip()) for part in text.split(",")]
    return None


def range_values(text: str) -> list[Any] | None:
    """Return the numbers of ``from:to:step``, ends included; None for another text.

    They are the decimal numbers that they look like, whole ones as such.

    Raises
    ------
    InputError
    """
    match = _RANGE.fullmatch(text)
    if match is None:
        return None
    low, high, step = (Fraction(part) for part in match.groups())
    if step == 0 or (high - low) / step < 0:
        raise InputError(f"{text.strip()} is no range: FROM:TO:STEP with STEP from FROM to TO")
    count = (high - low) // step + 1
    if count > MOST:
        raise InputError(f"{text.strip()}: {count} values, allowed: at most {MOST}")
    whole = all(re.fullmatch(r"[+-]?\d+", part) for part in match.groups())
    values = [low + step * k for k in range(count)]
    return [int(v) if whole else float(v) for v in values]


def spaced_values(start: Any, stop: Any, num: Any) -> list[float]:
    """Return ``num`` numbers from start to stop, ends included, as decimal as these are.

    Raises
    ------
    InputError
    """
    ends = [None if isinstance(v, bool) or not isinstance(v, int | float) else v
            for v in (start, stop)]  # fmt: skip
    if None in ends or isinstance(num, bool) or not isinstance(num, int) or not 2 <= num <= MOST:
        raise InputError(
            f"start={start!r}, stop={stop!r}, num={num!r} is no range: two numbers and a whole "
            f"number from 2 to {MOST} are needed"
        )
    try:
        low, high = (Fraction(repr(end)) for end in ends)
    except ValueError:
        raise InputError(f"start={start!r}, stop={stop!r}: finite numbers are needed") from None
    return [float(low + (high - low) * k / (num - 1)) for k in range(num)]
