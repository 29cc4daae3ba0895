"""What stands on charts: headings that fit, axes whose numbers are short, lines that differ."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pmopt.reporting.pictures.style import CHARACTER, RAISED, label, parameter_text
from pmopt.units import ONE

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

#: Okabe and Ito's colours, in an order whose neighbours differ most to the colour-blind too.
LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
#: Distinguished without colour, by their dashes.
DASHES = ("-", (0, (6, 1.6)), (0, (1.4, 1.2)), (0, (7, 1.5, 1.5, 1.5)), (0, (3, 1.2)))
#: Sizes of a heading's first line and of the others, in points, and a line of each in inches.
_HEAD, _BODY = 10.5, 8.5
_HEAD_LINE, _BODY_LINE = 0.21, 0.17
_MARGIN, _ABOVE, _BELOW = 0.15, 0.1, 0.14
#: Wide characters over those of most texts.
_WIDE = 1.06
#: Numbers from here on, and below, are written with a power of ten beside the unit.
_LARGE, _SMALL = 1e5, 1e-2


def line_style(number: int) -> dict[str, Any]:
    """Return colour and dashes of a curve: 35 curves all look different."""
    return {
        "color": LINES[number % len(LINES)],
        "linestyle": DASHES[number % len(DASHES)],
        "linewidth": 1.3,
    }


@dataclass(frozen=True)
class Heading:
    """Lines above a chart, within its width.

    Attributes
    ----------
    head, body : tuple of str
    height : float
        In inches, with the space below.
    """

    head: tuple[str, ...]
    body: tuple[str, ...]

    @property
    def height(self) -> float:
        """Return the height in inches, with the space below."""
        return _ABOVE + _HEAD_LINE * len(self.head) + _BODY_LINE * len(self.body) + _BELOW

    def write(self, figure: Figure) -> None:
        """Write it at the top of a figure."""
        width, height = figure.get_size_inches()
        x, top = _MARGIN / width, 1 - _ABOVE / height
        figure.text(x, top, "\n".join(self.head), va="top", fontsize=_HEAD)
        top -= _HEAD_LINE * len(self.head) / height
        figure.text(x, top, "\n".join(self.body), va="top", fontsize=_BODY, color="#555555")


def heading(width: float, head: str, parts: Iterable[str] = ()) -> Heading:
    """Return a heading for a figure of a width in inches.

    Parameters
    ----------
    width : float
    head : str
        First line.
    parts : iterable of str
        Follow with commas between; each stays on one line where it can.
    """
    bound = ", ".join(part.replace(" ", "\u00a0") for part in parts if part)
    return Heading(_wrapped(head, width, _HEAD), _wrapped(bound, width, _BODY))


def design_parts(params: Mapping[str, float | None], units: Mapping[str, str]) -> list[str]:
    """Return the parameters of a design, one a part of a heading."""
    shown = {name: value for name, value in params.items() if value is not None}
    return re.split(r"(?<=[^,]), ", parameter_text(shown, units)) if shown else []


def _wrapped(text: str, width: float, size: float) -> tuple[str, ...]:
    room = max(10, int((width - 2 * _MARGIN) / (_WIDE * CHARACTER * size / 8)))
    # Spaces that do not break do so where a part alone is wider than the figure.
    lines = [
        piece
        for line in textwrap.wrap(text, room, break_on_hyphens=False, break_long_words=False)
        for piece in ([line] if len(line) <= room else
                      textwrap.wrap(line.replace("\u00a0", " "), room, break_on_hyphens=False))
    ]  # fmt: skip
    return tuple(lines)


def power_of(values: Any) -> int:
    """Return the power of ten by which numbers are divided to be short, a multiple of three."""
    finite = np.abs(np.asarray(values, dtype=float))
    finite = finite[np.isfinite(finite)]
    most = float(finite.max()) if finite.size else 0.0
    if most == 0.0 or _SMALL <= most < _LARGE:
        return 0
    return 3 * math.floor(math.log10(most) / 3)


def scaled_unit(unit: str, power: int) -> str:
    """Return a unit behind a power of ten, e.g. ``10⁶ mm³``."""
    if power == 0:
        return unit
    raised = f"10{str(power).translate(RAISED)}"
    return raised if unit == ONE else f"{raised} {unit}"


def name_axis(axis: Axis, name: str, unit: str, values: Any = ()) -> None:
    """Write quantity and unit at an axis; large and small numbers go with a power of ten there."""
    power = power_of(values if np.size(values) else axis.get_view_interval())
    axis.set_label_text(label(name, scaled_unit(unit, power)))
    axis.set_major_formatter(_formatter(power))


def _formatter(power: int) -> Any:
    from matplotlib.ticker import Formatter

    class Scaled(Formatter):
        """Ticks with as many digits as they need, all with the same number."""

        def __call__(self, value: float, pos: int | None = None) -> str:
            return f"{value / 10.0**power:g}".replace("-", "\u2212")

        def format_ticks(self, values: Any) -> list[str]:
            scaled = np.asarray(values, dtype=float) / 10.0**power
            if not scaled.size:
                return []
            size = float(np.abs(scaled).max())
            digits = next(
                (
                    d
                    for d in range(9)
                    if np.all(np.abs(np.round(scaled, d) - scaled) <= 1e-9 * size)
                ),
                9,
            )
            return [f"{value + 0.0:.{digits}f}".replace("-", "\u2212") for value in scaled]

    return Scaled()
