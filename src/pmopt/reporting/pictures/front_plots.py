"""Pictures of Pareto fronts and of the course of a search, the same for the same input."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmopt.reporting.pictures.chart_text import heading, name_axis, power_of, scaled_unit
from pmopt.reporting.pictures.style import (
    COLOURS,
    FAINT,
    INK,
    LINE,
    NAMES,
    estimate_text,
    new_figure,
    parameter_text,
    to_picture,
    with_unit,
)
from pmopt.synthesis.objectives import SENSES
from pmopt.units import ONE, pretty, product_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Table = Mapping[str, NDArray[Any]]
_STEPS = [1, 2, 2.5, 5, 10]
#: Inches: a panel, what is left and below of it for ticks and names, its colour bar, and the text.
_PANEL = {1: (4.4, 3.4), 2: (3.5, 2.8)}
_LEFT, _BOTTOM, _BAR, _GAP, _TEXT = 0.95, 0.62, 0.95, 0.12, 2.85
#: A line of the text beside, in inches, and its characters, plain and bold.
_LINE, _WIDE, _BOLD = 0.158, 38, 29
#: Points that a letter stays away from its design, and how near others count, in points.
_AWAY, _NEAR = 11.0, 9.0
#: A bar is seen where it is longer than this on either side, in points: the radius of a marker.
_SEEN = 2.2
#: Rows beside each other at most.
_ACROSS = 2


@dataclass(frozen=True)
class _Marked:
    """A design that has a letter."""

    row: int
    letter: str
    meaning: str


def influential(
    table: Table,
    ranges: Mapping[str, Any],
    idle: Iterable[Mapping[str, float]],
    objectives: Sequence[str],
) -> str | None:
    """Return the variable that says most of where a design is on the front, None without any.

    It is the one with the largest product of spread, relative to its range, and rank correlation
    with an objective. A variable without influence on the objectives is never chosen, and one that
    has an influence only together with others, as m - n, only where there is no other.

    Parameters
    ----------
    table : mapping
        Columns of the front.
    ranges : mapping
        (lower, upper) of every variable; what is no range is none.
    idle : iterable of mapping
        See :class:`pmopt.synthesis.front.Front`.
    objectives : sequence of str
    """
    directions = [set(direction) for direction in idle]
    alone = {name for direction in directions if len(direction) == 1 for name in direction}
    bound = set().union(*directions) if directions else set()
    scores = {}
    for name, ends in ranges.items():
        if not isinstance(ends, list | tuple) or name not in table or name in alone:
            continue
        values = np.asarray(table[name], dtype=float)
        spread = float(np.ptp(values)) / (ends[1] - ends[0])
        tied = max(
            (abs(_rank_correlation(values, np.asarray(table[k], dtype=float))) for k in objectives),
            default=0.0,
        )
        scores[name] = (name not in bound, spread * tied)
    best = max(scores, key=lambda name: scores[name], default=None)
    return best if best is not None and scores[best][1] > 0 else None


def _rank_correlation(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    ranks = [np.argsort(np.argsort(v, kind="stable"), kind="stable") for v in (first, second)]
    parts = [rank - rank.mean() for rank in ranks]
    size = math.sqrt(float((parts[0] ** 2).sum() * (parts[1] ** 2).sum()))
    return float((parts[0] * parts[1]).sum()) / size if size > 0 else 0.0


def draw_front(
    columns: Mapping[str, ArrayLike],
    units: Mapping[str, str],
    parameters: Sequence[str],
    objectives: Sequence[str] = ("volume", "gci"),
    *,
    title: str = "",
    notes: Sequence[str] = (),
    knee: int | None = None,
    colour_by: str | None = None,
) -> bytes:
    """Draw a Pareto front, a panel a pair of objectives, its ends and knee listed beside.

    Parameters
    ----------
    columns : mapping
        Parameters, objectives and ``<objective>_error`` by name, an entry a design.
    units : mapping
    parameters : sequence of str
        The columns that are dimensions.
    objectives : sequence of str
    title : str
    notes : sequence of str
        Stand below the title.
    knee : int, optional
        Row of the knee design.
    colour_by : str, optional
        A column that colours the points; of three objectives the third does in each panel.
    """
    table = {name: np.asarray(column) for name, column in columns.items()}
    pairs = list(itertools.combinations(objectives, 2)) or [(colour_by or "design", objectives[0])]
    if "design" not in table:
        table["design"] = np.arange(1, len(table[objectives[0]]) + 1)
    marked = _marked(table, objectives, knee)
    texts = [_described(table, units, parameters, objectives, one) for one in marked]
    titles = [textwrap.wrap(f"{one.letter}  {one.meaning}", _BOLD) for one in marked]
    across = min(_ACROSS, len(pairs))
    down = -(-len(pairs) // across)
    wide, high = _PANEL[across]
    bars = _BAR if colour_by or len(objectives) > 2 else 0.15
    each = _LEFT + wide + bars + _GAP
    # Where the last row has room the text stands there, else at the right.
    within = across > 1 and len(pairs) % across == 1
    width = across * each + (0.0 if within else _TEXT)
    above = heading(width, title, [*notes, "bars: standard errors, where they can be seen"])
    lines = sum(
        1.3 * len(title) + len(text) + 0.8 for title, text in zip(titles, texts, strict=True)
    )
    first = (down - 1) * (high + _BOTTOM) if within else 0.0
    height = above.height + max(down * (high + _BOTTOM), first + lines * _LINE) + 0.1
    with new_figure(width, height) as figure:
        above.write(figure)
        for number, pair in enumerate(pairs):
            row, column = divmod(number, across)
            left = _LEFT + column * each
            bottom = height - above.height - (row + 1) * high - row * _BOTTOM
            axes = figure.add_axes((left / width, bottom / height, wide / width, high / height))
            rest = [name for name in objectives if name not in pair]
            by = rest[0] if len(rest) == 1 and len(objectives) == 3 else colour_by
            beside = None
            if by:
                place = (left + wide + 0.1) / width, bottom / height, 0.13 / width, high / height
                beside = figure.add_axes(place)
            _draw_panel(figure, axes, beside, table, units, pair, by, marked)
        x = (width - each + _LEFT if within else width - _TEXT + 0.15) / width
        y = height - above.height - first
        for title_lines, text in zip(titles, texts, strict=True):
            figure.text(x, y / height, "\n".join(title_lines), va="top", weight="bold")
            y -= 1.3 * _LINE * len(title_lines)
            figure.text(x, y / height, "\n".join(text), va="top", fontsize=8, linespacing=1.4)
            y -= _LINE * (len(text) + 0.8)
        return to_picture(figure)


def _marked(table: Table, objectives: Sequence[str], knee: int | None) -> list[_Marked]:
    """Return the best design of each objective and the knee, each once, in the front's order."""
    count = len(table[objectives[0]])
    if count == 1:
        return [_Marked(0, "A", "the only design")]
    found: dict[int, list[str]] = {}
    for name in objectives:
        values = np.asarray(table[name], dtype=float)
        least = SENSES.get(name, 1) < 0
        row = int(np.argmin(values) if least else np.argmax(values))
        found.setdefault(row, []).append(f"{'smallest' if least else 'largest'} {_name(name)}")
    if knee is not None:
        found.setdefault(knee, []).append("knee")
    return [
        _Marked(row, "ABCDEFGHIJKLMNOPQRSTUVWXYZ"[number % 26], ", ".join(found[row]))
        for number, row in enumerate(sorted(found))
    ]


def _described(
    table: Table, units: Mapping[str, str], parameters: Sequence[str], objectives: Sequence[str],
    one: _Marked,
) -> list[str]:  # fmt: skip
    """Return the lines of a design: objectives, dimensions."""
    lines = []
    for name in objectives:
        error = float(table[f"{name}_error"][one.row]) if f"{name}_error" in table else math.nan
        lines.append(
            f"{_name(name)} {estimate_text(float(table[name][one.row]), error, units[name])}"
        )
    text = parameter_text({p: table[p][one.row] for p in parameters}, units)
    return lines + textwrap.wrap(text, _WIDE, break_on_hyphens=False)


def _name(objective: str) -> str:
    """Return what pictures call an objective or a variable."""
    return NAMES.get(objective, objective.replace("_", " "))


def _draw_panel(
    figure: Figure, axes: Axes, beside: Axes | None, table: Table, units: Mapping[str, str],
    pair: tuple[str, str], colour_by: str | None, marked: Sequence[_Marked],
) -> None:  # fmt: skip
    """Draw two objectives, coloured by a third or by a variable."""
    from matplotlib.ticker import MaxNLocator

    x, y = (np.asarray(table[name], dtype=float) for name in pair)
    axes.scatter(x, y, 16, color=LINE, zorder=3)
    axes.margins(0.09)
    axes.autoscale_view()
    if len(x) == 1:  # a point alone has no scale
        axes.set_xlim(*_around(float(x[0])))
        axes.set_ylim(*_around(float(y[0])))
    axes.autoscale(False)
    _draw_errors(axes, x, y, table, pair)
    for axis, name, values in ((axes.xaxis, pair[0], x), (axes.yaxis, pair[1], y)):
        axis.set_major_locator(MaxNLocator(6, steps=_STEPS))
        name_axis(axis, _axis_name(name), units.get(name, ONE), values)
    if colour_by is not None and beside is not None:
        shade = np.asarray(table[colour_by], dtype=float)
        axes.collections[0].remove()
        points = axes.scatter(x, y, 16, shade, cmap=COLOURS, zorder=3)
        bar = figure.colorbar(points, cax=beside)
        name_axis(bar.ax.yaxis, _axis_name(colour_by), units.get(colour_by, ONE), shade)
    axes.grid(color="#e6e6e6", linewidth=0.6)
    axes.set_axisbelow(True)
    _write_letters(axes, x, y, marked)


def _around(value: float) -> tuple[float, float]:
    margin = 0.1 * abs(value) or 1.0
    return value - margin, value + margin


def _axis_name(name: str) -> str:
    return f"{_name(name)}, minimised" if SENSES.get(name, 1) < 0 else _name(name)


def _draw_errors(
    axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], table: Table, pair: tuple[str, str]
) -> None:
    """Draw the errors that reach out of their markers; they do not widen the axes."""
    for values, other, name, sideways in ((x, y, pair[0], True), (y, x, pair[1], False)):
        if f"{name}_error" not in table:
            continue
        errors = np.asarray(table[f"{name}_error"], dtype=float)
        low, high = axes.get_xlim() if sideways else axes.get_ylim()
        box = axes.get_window_extent()
        points = (box.width if sideways else box.height) * 72.0 / axes.figure.dpi
        seen = np.isfinite(errors) & (errors * points / (high - low) > _SEEN)
        if seen.any():
            part = {"xerr" if sideways else "yerr": errors[seen]}
            places = (values[seen], other[seen]) if sideways else (other[seen], values[seen])
            axes.errorbar(*places, **part, fmt="none", ecolor=FAINT, elinewidth=0.8, capsize=1.5)


def _write_letters(
    axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], marked: Sequence[_Marked]
) -> None:
    """Ring the designs that have a letter and write it where it covers least."""
    scale = 72.0 / axes.figure.dpi
    points = axes.transData.transform(np.stack([x, y], axis=1)) * scale
    frame = axes.get_window_extent()
    low, high = np.array([frame.x0, frame.y0]) * scale, np.array([frame.x1, frame.y1]) * scale
    taken = points.copy()
    for one in marked:
        axes.scatter(x[one.row], y[one.row], 90, facecolor="none", edgecolor=INK, zorder=4)
        costs: list[tuple[float, int, NDArray[np.float64], NDArray[np.float64]]] = []
        for turn in np.linspace(0.25, 2.25, 16, endpoint=False) * np.pi:
            away = _AWAY * np.array([math.cos(turn), math.sin(turn)])
            place = points[one.row] + away
            near = np.linalg.norm(taken - place, axis=1) / _NEAR
            out = bool(((place < low + 4) | (place > high - 4)).any())
            costs.append((float(np.maximum(1 - near, 0).sum()) + 10 * out, len(costs), away, place))
        _, _, away, place = min(costs, key=lambda cost: cost[:2])
        taken = np.vstack([taken, place])
        offset = (float(away[0]), float(away[1]))
        axes.annotate(one.letter, (x[one.row], y[one.row]), offset, textcoords="offset points",
                      weight="bold", ha="center", va="center", zorder=5)  # fmt: skip


def draw_history(
    columns: Mapping[str, ArrayLike],
    units: Mapping[str, str],
    objectives: Sequence[str] = ("volume", "gci"),
    *,
    title: str = "",
    notes: Sequence[str] = (),
) -> bytes:
    """Draw the hypervolume of the current front over the generations.

    Parameters
    ----------
    columns : mapping
        ``generation`` and ``hypervolume``.
    units : mapping
    objectives : sequence of str
        Their units multiply to the hypervolume's.
    title : str
    notes : sequence of str
        Stand below the title.
    """
    unit = product_unit(units[name] for name in objectives)
    width = 6.4
    above = heading(width, title, notes)
    height = above.height + 3.1
    with new_figure(width, height) as figure:
        from matplotlib.ticker import MaxNLocator

        above.write(figure)
        axes = figure.add_axes((0.95 / width, 0.55 / height, (width - 1.2) / width, 2.5 / height))
        generation = np.asarray(columns["generation"])
        value = np.asarray(columns["hypervolume"], dtype=float)
        axes.plot(
            generation, value, color=LINE, linewidth=1.5, marker="." if len(value) < 50 else ""
        )
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        axes.set_xlabel("generation")
        if len(value) == 1:
            axes.set_ylim(*_around(float(value[0])))
        name_axis(axes.yaxis, "hypervolume", unit, value)
        axes.grid(color="#e6e6e6", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        return to_picture(figure)


def reference_text(
    result: Mapping[str, Any], units: Mapping[str, str], objectives: Sequence[str]
) -> str:
    """Return the hypervolume and the point it is measured from, in words."""
    point = result.get("reference_point") or {}
    value = result.get("hypervolume")
    if value is None or any(point.get(name) is None for name in objectives):
        return ""
    power = power_of([value])
    unit = scaled_unit(product_unit(units[name] for name in objectives), power)
    start = " and ".join(
        f"{_name(name)} {estimate_text(float(point[name]), math.nan, units[name])}"
        for name in objectives
    )
    size = f"{value / 10.0**power:.6g}"
    size = f"{size}·{pretty(unit)}" if power else with_unit(size, unit)
    return f"hypervolume {size} from {start}"
