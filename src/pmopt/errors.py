"""The errors that users see: each has the text to print and the exit code of the command."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class PmoptError(Exception):
    """A failure at run time that the user can read in one line.

    Line breaks in the message, say from a name in a file, become spaces.
    """

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(" ".join(message.split()))

    @property
    def lines(self) -> list[str]:
        """The lines to print, one for each error."""
        return [str(self)]


class InputError(PmoptError):
    """Bad usage or bad input: names the key, the value and what is allowed."""

    exit_code = 2


class InputErrors(InputError):
    """Several things wrong with the input, a line each."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("; ".join(lines))
        self._lines = [str(InputError(line)) for line in lines]

    @property
    def lines(self) -> list[str]:
        """The lines to print, one for each error."""
        return self._lines


class UnreachableError(InputError):
    """A pose or a set of joint positions that the mechanism cannot take."""


class InfeasibleError(PmoptError):
    """Nothing satisfies the constraints."""

    exit_code = 3


def unknown_name(what: str, name: str, allowed: Iterable[str]) -> InputError:
    """Return the error for a name that is not among the allowed ones, with the nearest valid one.

    Parameters
    ----------
    what : str
        What the name stands for, e.g. ``"--params"`` or ``"mechanism"``.
    name : str
    allowed : iterable of str
    """
    names = list(allowed)
    folded = {candidate.casefold(): candidate for candidate in names}
    close = difflib.get_close_matches(name.casefold(), folded, n=1, cutoff=0.0)
    hint = f"; nearest: {folded[close[0]]}" if close else ""
    return InputError(f"{what}: unknown name {name!r}, allowed: {', '.join(names)}{hint}")
