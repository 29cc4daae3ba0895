"""What a check of a mechanism has compared, and what it has found wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from pmopt.errors import PmoptError


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes
    ----------
    check : str
        Stable name of the check that is not held, such as ``"kernel-jacobian"``.
    place : str
        The attribute of the mechanism that is wrong, such as ``"posture"``.
    text : str
        What is wrong, with numbers and units, in one line.
    """

    check: str
    place: str
    text: str

    def __str__(self) -> str:
        return f"{self.place}: {self.text} [{self.check}]"

    def to_dict(self) -> dict[str, str]:
        """Return the JSON form."""
        return {"check": self.check, "part": self.place, "text": self.text}


@dataclass(frozen=True)
class Check:
    """One comparison that was made.

    Attributes
    ----------
    name, place : str
        As in :class:`Finding`.
    compared : str
        What was compared with what.
    count : int
        How often.
    deviation, allowed : float or None
        The largest deviation and what is allowed, without unit: as a share of the size of what is
        compared. None where there is nothing to measure.
    held : bool
    """

    name: str
    place: str
    compared: str
    count: int
    deviation: float | None
    allowed: float | None
    held: bool

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        finite = self.deviation is not None and math.isfinite(self.deviation)
        return {
            "check": self.name,
            "part": self.place,
            "compared": self.compared,
            "count": self.count,
            "deviation": self.deviation if finite else None,
            "allowed": self.allowed,
            "held": self.held,
        }


class MechanismError(PmoptError):
    """A mechanism that contradicts itself; ``findings`` has all that is wrong."""

    exit_code = 4

    def __init__(self, mechanism: str, findings: tuple[Finding, ...]) -> None:
        more = len(findings) - 1
        rest = f"; and {more} more: pmopt check {mechanism}" if more else ""
        super().__init__(f"{mechanism}: {findings[0]}{rest}")
        self.findings = findings


@dataclass
class Examination:
    """What was compared of one mechanism, and what was found.

    Attributes
    ----------
    mechanism : str
    checks : list of Check
        In the order in which they were made. What rests on a check that is not held is left out.
    findings : list of Finding
        Empty where everything agrees.
    """

    mechanism: str
    checks: list[Check] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    @property
    def held(self) -> bool:
        """Whether everything agrees."""
        return not self.findings

    def require_held(self) -> None:
        """Raise what was found.

        Raises
        ------
        MechanismError
        """
        if self.findings:
            raise MechanismError(self.mechanism, tuple(self.findings))

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "held": self.held,
            "checks": [check.to_dict() for check in self.checks],
            "findings": [finding.to_dict() for finding in self.findings],
            "units": {"deviation": "1", "allowed": "1"},
        }

    @contextmanager
    def check(
        self, name: str, place: str, compared: str, allowed: float | None = None
    ) -> Iterator[Comparison]:
        """Make one comparison; whatever the mechanism raises in it is a finding."""
        comparison = Comparison(allowed)
        try:
            yield comparison
        except Exception as error:
            comparison.wrong.insert(0, (_raised(error) + comparison.at, ""))
        for text, where in comparison.wrong[:1]:
            self.findings.append(Finding(name, where or place, text))
        self.checks.append(
            Check(
                name,
                place,
                compared,
                comparison.count,
                comparison.deviation,
                allowed,
                not comparison.wrong,
            )
        )

    @contextmanager
    def guard(self, name: str) -> Iterator[None]:
        """Make a finding of an error that the mechanism raises outside a comparison."""
        try:
            yield
        except Exception as error:
            place = getattr(error, "name", None) or "Mechanism"
            self.findings.append(Finding(name, str(place), _raised(error)))


def _raised(error: Exception) -> str:
    return f"raises {type(error).__name__}: {' '.join(str(error).split())}"


@dataclass
class Comparison:
    """One comparison while it is made: the first error is reported.

    Attributes
    ----------
    allowed : float or None
        Largest deviation that is allowed.
    at : str
        Where it is made, for texts: ``" at x = 1 m"``.
    """

    allowed: float | None
    count: int = 0
    deviation: float | None = None
    at: str = ""
    wrong: list[tuple[str, str]] = field(default_factory=list)

    def require(self, held: bool, text: str, place: str = "") -> bool:
        """Note one requirement, with the text of the error where it does not hold."""
        self.count += 1
        if not held:
            self.wrong.append((f"{text}{self.at}", place))
        return held

    def agree(self, deviation: float, text: str, place: str = "") -> bool:
        """Note a deviation, with the text of the error where it exceeds the allowed one."""
        assert self.allowed is not None
        known = deviation if math.isfinite(deviation) else math.inf
        self.deviation = max(self.deviation or 0.0, known)
        return self.require(known <= self.allowed, text, place)
