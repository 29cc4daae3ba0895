"""What every result does: print in one line, show as tables, give a DataFrame, be plotted."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

from pmopt.api.keywords import named
from pmopt.errors import PmoptError, unknown_name
from pmopt.reporting.tables.table import Table
from pmopt.units import ONE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Showing:
    """A record that shows itself; it is one: every attribute is that of the record.

    ``frames`` are the names of what :meth:`to_frame` gives, the first one by default.
    """

    frames: ClassVar[tuple[str, ...]] = ("result",)

    @classmethod
    def of(cls, record: object, **beside: Any) -> Self:
        """Return the record as one that shows itself, with what its pictures need beside it."""
        found = object.__new__(cls)
        found.__dict__.update(vars(record))
        found.__dict__.update({f"_{name}": value for name, value in beside.items()})
        return found

    @abstractmethod
    def _headline(self) -> str:
        """Return the result in one line, with units and errors."""

    @abstractmethod
    def _tables(self) -> list[Table]:
        """Return the tables that people read, as the command line prints them."""

    def _frame(self, name: str) -> Table:
        """Return the table behind a DataFrame."""
        return self._tables()[self.frames.index(name)]

    @named
    def to_frame(self, name: str | None = None) -> pd.DataFrame:
        """Return a DataFrame: the main table or another of ``frames`` by its name.

        Errors stand in columns of their own; ``attrs["units"]`` has the units by column.

        Raises
        ------
        pmopt.InputError
        """
        import pandas as pd

        table = self._frame(self._checked(name))
        heads, rows = table.data()
        found = pd.DataFrame(rows, columns=heads)
        found.attrs["units"] = {name: table.units.get(name, ONE) for name in heads}
        return found

    def _checked(self, name: str | None) -> str:
        if name is not None and name not in self.frames:
            raise unknown_name("to_frame", name, self.frames)
        return name or self.frames[0]

    def __repr__(self) -> str:
        return f"<{self._headline()}>"

    def _repr_html_(self) -> str:
        from pmopt.reporting.tables.html import to_html

        return to_html(self._tables())


def axes_of(draw: Callable[[], object]) -> Axes:
    """Return the first axes of a picture, which pyplot knows: notebooks show it.

    Raises
    ------
    pmopt.PmoptError
        For what cannot be drawn.
    """
    from pmopt.reporting.pictures.gallery import lines_of, wanted
    from pmopt.reporting.pictures.style import kept_figures

    with kept_figures() as figures, wanted("plot"):
        drawn = draw()
    if not figures or not figures[0].axes:
        lines = lines_of(getattr(drawn, "missing", {}))
        raise PmoptError(lines[0] if lines else "plot: there is nothing to draw")
    return figures[0].axes[0]


def place_text(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Return a pose or joint positions in words."""
    return ", ".join(f"{k} = {v:.6g} {units[k]}".removesuffix(f" {ONE}")
                     for k, v in values.items())  # fmt: skip
