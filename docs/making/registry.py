"""Makers: each computes some figures or pictures and states what documents say of them."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from making.pages import Finding, Statement

Function = Callable[[], Iterable[Statement | Finding]]


@dataclass(frozen=True)
class Maker:
    """A maker.

    Attributes
    ----------
    name : str
    run : callable
        Yields statements, and findings of what does not hold otherwise.
    about : str
        One line.
    slow : bool
        Left out of a check unless asked for.
    """

    name: str
    run: Function
    about: str
    slow: bool = False


MAKERS: dict[str, Maker] = {}


def add(name: str, run: Function, about: str, slow: bool = False) -> None:
    """Register a maker."""
    if name in MAKERS:
        raise ValueError(f"two makers of the name {name}")
    MAKERS[name] = Maker(name, run, about, slow)


def maker(name: str, slow: bool = False) -> Callable[[Function], Function]:
    """Register the function below."""

    def register(function: Function) -> Function:
        about = (function.__doc__ or "").strip().splitlines()[0]
        add(name, function, about.removeprefix("Yield "), slow)
        return function

    return register


def run(name: str) -> list[Statement | Finding]:
    """Return all that a maker states; a failure is a finding."""
    return list(_run(MAKERS[name]))


def _run(found: Maker) -> Iterator[Statement | Finding]:
    try:
        yield from found.run()
    except Exception as error:  # whatever it is, the other makers go on
        line = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{type(error).__name__}: {error} ({line.name}, line {line.lineno})"
        yield Finding(found.name, 0, "made by this", f"failed: {' '.join(text.split())}")
