"""What a result is of: one record, the same in every result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pmopt.mechanisms.mechanism import Mechanism, Parameters


@dataclass(frozen=True)
class Subject:
    """One design of a mechanism in a working mode, and which of its poses are in question.

    Attributes
    ----------
    mechanism : str
        Its name.
    params : dict
        All parameters, in ``length_unit``; None where one is not set.
    length_unit : {"m", "mm"}
    working_mode : str
        ``"all"`` where every one is in question; empty where it is of none, as joints of a layout
        that is drawn in one pose only.
    box : dict
        Where the poses in question are, by pose coordinate: the domain, the mechanism's own or what
        was given; of a motion or a path what it goes through; of one pose that pose; empty
        where the result is poses.
    limits : dict
        Of joints and of the tool's place, the mechanism's own or what was given; empty where they
        do not count.
    """

    mechanism: str
    params: dict[str, float | None]
    length_unit: str
    working_mode: str
    box: dict[str, tuple[float, float]]
    limits: dict[str, tuple[float, float]]

    @classmethod
    def of(
        cls,
        mechanism: Mechanism,
        params: Parameters,
        working_mode: str | None,
        box: Mapping[str, tuple[float, float]],
        limits: Mapping[str, tuple[float, float]] | None = None,
    ) -> Subject:
        """Return the subject: a design with all its parameters, and which poses of it."""
        return cls(
            mechanism.name, dict(params), mechanism.length_unit, working_mode or "", dict(box),
            dict(limits or {}),
        )  # fmt: skip


@dataclass(frozen=True)
class OfSubject:
    """A result; ``subject`` says of what, and so do its own attributes."""

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
