"""From kernel text to LLVM's text, directly.

Kernels are plain Python on numbers, tuples and arrays: what a value is follows from the arguments
of an entry alone. :func:`lowered` walks the text once for each kind of arguments of a function and
writes the operations down in their order. numba, which understands all of Python, takes far longer
for that, and time to be imported; it stays the road for a text that has more than is understood
here (:class:`Unsupported`).

Meaning is numba's, with ``error_model="numpy"``: division by zero gives infinities, ``min`` and
``max`` keep Python's order of comparison, and a number that is an integer in one place and a float
in another is a float. Two things are left out, since kernels do not need them: an index that is a
bare name is not negative (one with a difference or a sign in it may be), and slices end within
their array.
"""

from __future__ import annotations

from collections.abc import Sequence

from pmopt.compiler.lowering.statements import Program
from pmopt.compiler.lowering.values import AND, PIECE, Unsupported

__all__ = ["AND", "PIECE", "Unsupported", "lowered"]


def lowered(text: str, name: str, arguments: Sequence[str], symbol: str) -> str:
    """Return LLVM's text of an entry of a kernel text.

    Raises
    ------
    Unsupported
    """
    try:
        return Program(text).entry(name, arguments, symbol)
    except (KeyError, IndexError, ValueError, TypeError, AttributeError, NameError) as error:
        raise Unsupported(f"{type(error).__name__}: {error}") from None
