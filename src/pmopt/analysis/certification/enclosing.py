"""Which kind of enclosure the kernel of a mechanism needs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from pmopt.analysis.certification.curve_enclosure import CurveEnclosure
from pmopt.analysis.certification.enclosures import Enclosure
from pmopt.analysis.certification.implicit_enclosure import Sheet
from pmopt.analysis.sampling.design_space import Design
from pmopt.compiler.tracing import Traced, Untraceable, trace
from pmopt.errors import InputError
from pmopt.mechanisms.mechanism import Mechanism


def enclose(
    mechanism: Mechanism, design: Design, notify: Callable[[], None] | None = None
) -> Enclosure:
    """Return what can be proven of a design.

    Parameters
    ----------
    mechanism : Mechanism
    design : Design
    notify : callable, optional
        Called before a compilation that takes seconds.

    Raises
    ------
    InputError
        For a mechanism whose kernel cannot be traced.
    """
    if mechanism.implicit is not None:
        return Sheet(mechanism, design, notify)
    if mechanism.curve is not None:
        return CurveEnclosure(mechanism, design, notify)
    try:
        return Enclosure(mechanism, design, _traced(mechanism), notify)
    except Untraceable as error:
        raise InputError(
            f"certify: {mechanism.name}: nothing can be proven of its kernel: {error}"
        ) from None


@cache
def _traced(mechanism: Mechanism) -> Traced:
    return trace(mechanism.kernel, len(mechanism.pose), mechanism.constants)
