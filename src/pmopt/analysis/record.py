"""What a result is of: one record, the same in every result over a workspace."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Subject:
    """One design of a mechanism in a working mode, and which of its poses are in question.

    A result at given poses has no domain: ``box`` is empty.

    Attributes
    ----------
    mechanism : str
        Its name.
    params : dict
        All parameters, in ``length_unit``; None where one is not set.
    length_unit : {"m", "mm"}
    working_mode : str
        ``"all"`` where every one is in question.
    box : dict
        The domain, by pose coordinate: the mechanism's own or what was given.
    limits : dict
        Of joints and of the tool's place, the mechanism's own or what was given.
    """

    mechanism: str
    params: dict[str, float | None]
    length_unit: str
    working_mode: str
    box: dict[str, tuple[float, float]]
    limits: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class OfSubject:
    """A result: what it is of stands in ``subject``, and is said by its own attributes too."""

    subject: Subject

    @property
    def mechanism(self) -> str:
        """Name of the mechanism."""
        return self.subject.mechanism

    @property
    def params(self) -> dict[str, float | None]:
        """All parameters of the design."""
        return self.subject.params

    @property
    def length_unit(self) -> str:
        """The mechanism's unit of length."""
        return self.subject.length_unit

    @property
    def working_mode(self) -> str:
        """The working mode."""
        return self.subject.working_mode

    @property
    def box(self) -> dict[str, tuple[float, float]]:
        """The domain, by pose coordinate."""
        return self.subject.box

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Limits of joints and of the tool's place."""
        return self.subject.limits
