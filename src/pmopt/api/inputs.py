"""Inputs of analyses as objects: sampling, and ranges by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

from pmopt.errors import InputError

#: A number in the mechanism's unit (rad, s), or a text with a unit: ``0.65``, ``"650mm"``.
Number = float | str
#: A lower and an upper end.
Ends = tuple[Number, Number] | Sequence[float] | list[str]


@dataclass(frozen=True)
class Sampling:
    """How poses are sampled: a number of samples, an error to reach, or a grid.

    Without one of these it is the default number of samples.

    Attributes
    ----------
    samples : int, optional
        Over all replicates.
    target_error : float, optional
        Relative standard error of volume and GCI to sample to.
    grid : int, optional
        Cells on each axis.
    sampler : {"r-sequence", "sobol", "monte-carlo", "lines"}
        ``lines`` where the mechanism offers it.
    replicates : int, optional
        From which errors are estimated.

    Examples
    --------
    >>> Sampling.to_error(1e-3)
    Sampling.to_error(0.001)
    """

    samples: int | None = None
    target_error: Number | None = None
    grid: int | None = None
    sampler: Literal["r-sequence", "sobol", "monte-carlo", "lines"] = "r-sequence"
    replicates: int | None = None

    @classmethod
    def to_error(
        cls,
        target_error: Number,
        sampler: Literal["r-sequence", "sobol", "monte-carlo", "lines"] = "r-sequence",
        replicates: int | None = None,
    ) -> Sampling:
        """Return the sampling until volume and GCI have a relative standard error."""
        return cls(target_error=target_error, sampler=sampler, replicates=replicates)

    @classmethod
    def on_grid(cls, cells: int) -> Sampling:
        """Return the midpoint grid with so many cells on each axis; its errors are bounds."""
        return cls(grid=cells)

    def keywords(self) -> dict[str, Any]:
        """Return the equivalent keywords."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in given.items()
                if value is not None and (name, value) != ("sampler", "r-sequence")}  # fmt: skip

    def __repr__(self) -> str:
        given = self.keywords()
        if set(given) == {"target_error"}:
            return f"Sampling.to_error({self.target_error!r})"
        return f"Sampling({', '.join(f'{name}={value!r}' for name, value in given.items())})"


class Limits(Mapping[str, Ends]):
    """Ranges of joints, of the tool's place or of pose coordinates, by name.

    The names are those that the mechanism brings: they are checked where they are used, and a
    wrong one is refused with the nearest. An angle may also be given in degrees, under its name
    with ``_deg``.

    Examples
    --------
    >>> Limits(theta1=(-0.5, 1.5), theta2_deg=(-30, 80))
    Limits(theta1=(-0.5, 1.5), theta2_deg=(-30, 80))
    """

    def __init__(self, **ranges: Ends) -> None:
        self._ranges = dict(ranges)

    def __getitem__(self, name: str) -> Ends:
        return self._ranges[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._ranges)

    def __len__(self) -> int:
        return len(self._ranges)

    def __repr__(self) -> str:
        return f"Limits({', '.join(f'{name}={ends!r}' for name, ends in self.items())})"


def with_sampling(options: Mapping[str, Any], where: str, own: frozenset[str]) -> dict[str, Any]:
    """Return keywords with those of ``sampling`` in its place.

    Parameters
    ----------
    options : mapping
    where : str
    own : frozenset of str
        Keywords that say something else here than in a sampling.

    Raises
    ------
    InputError
        Where both are given, and for what is not read here.
    """
    given = dict(options)
    sampling = given.pop("sampling", None)
    if sampling is None:
        return given
    if not isinstance(sampling, Sampling):
        raise InputError(
            f"{where}: sampling={sampling!r} is not allowed: a pmopt.Sampling is needed, such as "
            "pmopt.Sampling.to_error(1e-3)"
        )
    beside = sampling.keywords()
    for field in fields(sampling):
        if given.get(field.name) is not None and field.name not in own:
            raise InputError(
                f"{where}: sampling and {field.name} exclude each other: give one of them"
            )
    for name in own & set(beside):
        raise InputError(f"{where}: {name} of a sampling is not read by {where}")
    return {**given, **beside}
