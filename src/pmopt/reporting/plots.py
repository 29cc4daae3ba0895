"""Pictures as PNG bytes, the same for the same input.

Matplotlib is imported when something is drawn, and used without pyplot: no window opens, no state
is left behind, and the reader's own matplotlibrc changes nothing.
"""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmopt.analysis.estimates import Estimate
from pmopt.analysis.workspace import WorkspaceResult
from pmopt.reporting.fields import Section, SurfaceMesh
from pmopt.units import ONE, pretty

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

_DPI = 150
_MAP = "viridis"
_INK, _FAINT, _LINE = "#222222", "#808080", "#2f5d8a"
_STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.edgecolor": _FAINT,
    "axes.linewidth": 0.7,
    "axes.labelcolor": _INK,
    "text.color": _INK,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}
#: Elevation and azimuth of the view in degrees: onto the cut across the second coordinate.
_VIEW = (24.0, -66.0)
#: Towards the light, from the viewer's upper left.
_LIGHT = np.array([-0.45, -0.6, 0.66])
_BINS = 100
#: Width of a character of the smaller text, in inches.
_CHARACTER = 0.072
_NAMES = {"gci": "GCI", "lci": "LCI"}


def draw_surface(mesh: SurfaceMesh, result: WorkspaceResult) -> bytes:
    """Draw the surface of a workspace, cut open, its faces coloured by LCI.

    Parameters
    ----------
    mesh : SurfaceMesh
    result : WorkspaceResult
        Of the same design.
    """
    if len(mesh.faces) == 0:
        return _draw_nothing(result)
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    with _figure(7.4, 5.6) as figure:
        axes: Any = figure.add_axes((0.0, 0.03, 0.87, 0.87), projection="3d")
        quads = mesh.vertices[mesh.faces]
        scale = _colour_scale(result)
        colours = _shade(scale.to_rgba(mesh.lci)[:, :3], quads)
        # Edges in the face's colour close the hairlines between antialiased neighbours.
        axes.add_collection3d(
            Poly3DCollection(quads, facecolors=colours, edgecolors=colours, linewidths=0.3)
        )
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        to_scale = len(set(mesh.units)) == 1
        axes.set_box_aspect(high - low if to_scale else None, zoom=1.1)
        for k, axis in enumerate((axes.xaxis, axes.yaxis, axes.zaxis)):
            getattr(axes, f"set_{'xyz'[k]}lim")(low[k], high[k])
            axis.set_label_text(_label(mesh.names[k], mesh.units[k]))
            axis.set_pane_color("white")
        axes.view_init(*_VIEW)
        bar = figure.colorbar(scale, cax=figure.add_axes((0.89, 0.2, 0.022, 0.55)))
        bar.set_label(_index_label(result))
        _caption(figure, result, [f"cut at {mesh.cut}"] if mesh.cut else [])
        return _png(figure)


def draw_sections(sections: Sequence[Section], result: WorkspaceResult) -> bytes:
    """Draw sections side by side, to one scale, with the edges of the dexterity regions.

    Parameters
    ----------
    sections : sequence of Section
    result : WorkspaceResult
        Of the same design.
    """
    if not any(np.isfinite(section.lci).any() for section in sections):
        return _draw_nothing(result)
    sides = np.array([[np.ptp(s.horizontal), np.ptp(s.vertical)] for s in sections])
    if len({unit for s in sections for unit in s.units}) > 1:
        sides = np.ones_like(sides)  # lengths and angles have no common scale
    sides *= min(9.3 / sides[:, 0].sum(), 3.4 / sides[:, 1].max())
    left, bottom, gap, tallest = 0.65, 0.75, 0.75, sides[:, 1].max()
    size = np.array([left + sides[:, 0].sum() + gap * len(sides) + 0.6, bottom + tallest + 0.9])
    edges = list(result.settings.regions[1:-1])
    with _figure(*size) as figure:
        scale = _colour_scale(result)
        for section, side in zip(sections, sides, strict=True):
            axes = figure.add_axes((*([left, bottom] / size), *(side / size)))
            x, y = section.horizontal, section.vertical
            dx, dy = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
            extent = (x[0] - dx, x[-1] + dx, y[0] - dy, y[-1] + dy)
            axes.imshow(
                section.lci, scale.cmap, scale.norm, origin="lower", extent=extent, aspect="auto"
            )
            if section.inside.min() < 0 <= section.inside.max():
                axes.contour(x, y, section.inside, [0.0], colors=_INK, linewidths=0.9)
                axes.contour(x, y, section.lci, edges, colors="white", linewidths=0.8)
            axes.set_title(section.title)
            axes.set_xlabel(_label(section.names[0], section.units[0]))
            axes.set_ylabel(_label(section.names[1], section.units[1]), labelpad=1)
            left += side[0] + gap
        place = (*([left - gap + 0.25, bottom] / size), *([0.15, tallest] / size))
        bar = figure.colorbar(scale, cax=figure.add_axes(place))
        for edge in edges:
            bar.ax.axhline(edge, color="white", linewidth=1.0)
        bar.set_label(_index_label(result))
        _caption(figure, result, ["white lines: edges of the dexterity regions"])
        return _png(figure)


def draw_histogram(result: WorkspaceResult) -> bytes:
    """Draw the distribution of LCI over the reachable volume and the share of each region.

    Parameters
    ----------
    result : WorkspaceResult
    """
    if result.reachable == 0:
        return _draw_nothing(result)
    counts = np.array(result.histogram, dtype=float).reshape(_BINS, -1).sum(axis=1)
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    inner = list(result.settings.regions[1:-1])
    width, height, left, bottom, right = 7.2, 3.4, 0.7, 0.75, 0.25
    inches = width - left - right
    scale = _colour_scale(result)
    end = min(1.0, max([scale.norm.vmax or 1.0, *(edge + 0.1 for edge in inner)]))
    texts, spans = [], []
    for region in result.regions:
        bracket = "]" if region.upper == 1.0 else ")"
        share = format_estimate(Estimate(*(100 * v for v in region.share)))
        texts.append(f"[{region.lower:g}, {region.upper:g}{bracket}\n{share} %")
        half = len(share + " %") * _CHARACTER / 2
        centre = (region.lower + min(region.upper, end)) / 2 / end * inches
        spans.append((min(max(centre, half), inches - half), half))
    rows = _rows(spans)
    strip = 0.36 * (max(rows) + 1)
    total = bottom + height + strip + 0.7
    with _figure(width, total) as figure:
        axes = figure.add_axes((left / width, bottom / total, inches / width, height / total))
        middles = (edges[:-1] + edges[1:]) / 2
        axes.bar(
            middles, 100 * counts / counts.sum(), 1 / _BINS, color=scale.to_rgba(middles),
            edgecolor="white", linewidth=0.3,
        )  # fmt: skip
        for edge in inner:
            axes.axvline(edge, ymax=1 + strip / height, color=_FAINT, linewidth=0.8, linestyle="--",
                         clip_on=False)  # fmt: skip
        for text, (centre, _), row in zip(texts, spans, rows, strict=True):
            place = (centre / inches, 1 + (0.06 + 0.36 * row) / height)
            axes.text(*place, text, transform=axes.transAxes, ha="center", va="bottom", fontsize=8)
        axes.set_xlim(0.0, end)
        axes.set_xlabel(_index_label(result))
        axes.set_ylabel(f"share of the reachable volume\nper {1 / _BINS:g} of LCI (%)")
        axes.spines[["top", "right"]].set_visible(False)
        _caption(figure, result)
        return _png(figure)


def draw_front(
    columns: Mapping[str, ArrayLike],
    units: Mapping[str, str],
    parameters: Sequence[str],
    objectives: tuple[str, str] = ("volume", "gci"),
    *,
    title: str = "",
    knee: int | None = None,
    colour_by: str | None = None,
) -> bytes:
    """Draw a Pareto front, its ends and knee marked and their dimensions listed beside.

    Parameters
    ----------
    columns : mapping
        Parameters, objectives and ``<objective>_error`` by name, an entry a design.
    units : mapping
    parameters : sequence of str
        The columns that are dimensions.
    objectives : tuple of str
        Horizontal and vertical one.
    title : str
    knee : int, optional
        Row of the knee design.
    colour_by : str, optional
        A parameter that colours the points.
    """
    table = {name: np.asarray(column) for name, column in columns.items()}
    x, y = (table[name].astype(float) for name in objectives)
    x_name, y_name = (_NAMES.get(name, name) for name in objectives)
    marked = {int(np.argmax(y)): f"largest {y_name}"}
    if knee is not None:
        marked.setdefault(knee, "knee")
    marked.setdefault(int(np.argmax(x)), f"largest {x_name}")
    with _figure(8.4, 4.4) as figure:
        from matplotlib.ticker import MaxNLocator

        axes = figure.add_axes((0.085, 0.13, 0.5 if colour_by else 0.57, 0.76))
        axes.errorbar(
            x, y, *(table[f"{name}_error"] for name in reversed(objectives)), fmt="none",
            ecolor=_FAINT, elinewidth=0.8, capsize=1.5,
        )  # fmt: skip
        if colour_by:
            points = axes.scatter(x, y, 16, table[colour_by], cmap=_MAP, zorder=3)
            bar = figure.colorbar(points, cax=figure.add_axes((0.605, 0.13, 0.016, 0.76)))
            bar.set_label(_label(colour_by, units[colour_by]))
        else:
            axes.scatter(x, y, 14, color=_LINE, zorder=3)
        for (row, meaning), sign, top in zip(
            marked.items(), "ABC", (0.87, 0.6, 0.33), strict=False
        ):
            axes.scatter(x[row], y[row], 90, facecolor="none", edgecolor=_INK, zorder=4)
            axes.annotate(sign, (x[row], y[row]), (7, 7), textcoords="offset points", weight="bold")
            lines = [
                f"{_NAMES.get(name, name)} {_with_unit(_shown(table, name, row), units[name])}"
                for name in objectives
            ]
            lines += _parameter_lines({p: table[p][row] for p in parameters}, units, 30)
            figure.text(0.72, top, f"{sign}  {meaning}", va="bottom", weight="bold")
            figure.text(0.72, top - 0.005, "\n".join(lines), va="top", fontsize=8, linespacing=1.4)
        axes.margins(0.07)
        axes.xaxis.set_major_locator(MaxNLocator(7))
        axes.set_xlabel(_label(x_name, units[objectives[0]]))
        axes.set_ylabel(_label(y_name, units[objectives[1]]))
        axes.grid(color="#e6e6e6", linewidth=0.6)
        axes.set_axisbelow(True)
        figure.text(0.085, 0.94, title, fontsize=10.5)
        return _png(figure)


def draw_history(
    columns: Mapping[str, ArrayLike],
    units: Mapping[str, str],
    objectives: Sequence[str] = ("volume", "gci"),
    *,
    title: str = "",
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
    """
    unit = " ".join(units[name] for name in objectives if units[name] != ONE) or ONE
    with _figure(6.4, 3.6) as figure:
        from matplotlib.ticker import MaxNLocator

        axes = figure.add_axes((0.12, 0.15, 0.84, 0.73))
        generation, value = np.asarray(columns["generation"]), np.asarray(columns["hypervolume"])
        axes.plot(
            generation, value, color=_LINE, linewidth=1.5, marker="." if len(value) < 50 else ""
        )
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel("generation")
        axes.set_ylabel(_label("hypervolume", unit))
        axes.grid(color="#e6e6e6", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        figure.text(0.12, 0.93, title, fontsize=10.5)
        return _png(figure)


def format_estimate(estimate: Estimate) -> str:
    """Return value and error to the error's first digit, e.g. ``10.206 ± 0.001``."""
    value, error = estimate
    if not math.isfinite(error) or error <= 0:
        return f"{value:.6g}"
    digits = max(0, -math.floor(math.log10(float(f"{error:.0e}"))))
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _shown(table: Mapping[str, NDArray[Any]], name: str, row: int) -> str:
    return format_estimate(Estimate(float(table[name][row]), float(table[f"{name}_error"][row])))


def _label(name: str, unit: str) -> str:
    return name if unit == ONE else f"{name} ({pretty(unit)})"


def _with_unit(text: str, unit: str) -> str:
    return text if unit == ONE else f"{text} {pretty(unit)}"


def _index_label(result: WorkspaceResult) -> str:
    norm = "Frobenius norm" if result.norm == "fro" else f"{result.norm}-norm"
    return f"LCI ({result.jacobian}, {norm})"


def _parameter_lines(values: Mapping[str, Any], units: Mapping[str, str], width: int) -> list[str]:
    """Return the parameters as lines; a unit that all share stands once, at the end."""
    shared = {units[name] for name in values}
    parts = [f"{name} = {value:.4g}" if len(shared) == 1
             else f"{name} = {_with_unit(f'{value:.4g}', units[name])}"
             for name, value in values.items()]  # fmt: skip
    text = ", ".join(part.replace(" ", "\u00a0") for part in parts)
    if len(shared) == 1:
        text = _with_unit(text, shared.pop())
    return textwrap.wrap(text, width)


def _rows(spans: Sequence[tuple[float, float]]) -> list[int]:
    """Give each label (centre, half its width) the lowest row where it meets no other."""
    ends: list[float] = []
    rows = []
    for centre, half in spans:
        row = next((r for r, end in enumerate(ends) if centre - half > end), len(ends))
        ends[row : row + 1] = [centre + half + _CHARACTER]
        rows.append(row)
    return rows


def _colour_scale(result: WorkspaceResult) -> ScalarMappable:
    """Return the colours of LCI, the same in every picture of a workspace."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    largest = result.largest.value
    top = 1.0 if math.isnan(largest) else min(1.0, max(0.1, math.ceil(10 * largest) / 10))
    return ScalarMappable(Normalize(0.0, top), _MAP)


def _shade(colours: NDArray[np.float64], quads: NDArray[np.float64]) -> NDArray[np.float64]:
    """Darken faces turned away from the light and brighten those that face it."""
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    lit = (normals @ (_LIGHT / np.linalg.norm(_LIGHT)))[:, None]
    shaded = colours * (0.72 + 0.28 * lit) + 0.14 * np.maximum(lit, 0.0)
    return np.clip(shaded, 0.0, 1.0)


def _caption(figure: Figure, result: WorkspaceResult, remarks: Sequence[str] = ()) -> None:
    """Write mechanism, dimensions and volume above, what the index is of below."""
    width, height = figure.get_size_inches()
    characters = int(width / 0.085)
    params = {name: value for name, value in result.params.items() if value is not None}
    lines = _parameter_lines(params, result.units, characters - len(result.mechanism))
    head = f"{result.mechanism}: " + "\n".join(lines)
    unit = pretty(result.volume_unit)
    parts = [f"volume {_with_unit(format_estimate(result.volume), unit)}"]
    if result.reachable:
        parts.append(f"GCI {format_estimate(result.gci)}")
    parts += [f"{name} in [{low:.4g}, {high:.4g}] {result.units[name]}"
              for name, (low, high) in result.settings.limits.items()]  # fmt: skip
    if result.settings.min_lci > 0:
        parts.append(f"LCI >= {result.settings.min_lci:g}")
    parts += [f"working mode {result.working_mode}", *remarks]
    body = "\n".join(textwrap.wrap(", ".join(parts), characters))
    figure.text(0.15 / width, 1 - 0.12 / height, head, va="top", fontsize=10.5)
    below = 0.12 + 0.2 * len(lines)
    figure.text(0.15 / width, 1 - below / height, body, va="top", fontsize=8.5, color="#555555")
    note = "\n".join(textwrap.wrap(result.index_note, characters))
    figure.text(0.15 / width, 0.1 / height, f"LCI: {note}", fontsize=7, color="#555555")


def _draw_nothing(result: WorkspaceResult) -> bytes:
    with _figure(6.0, 2.2) as figure:
        found = "nothing reachable" if result.reachable == 0 else (
            "the reachable set is too small for the grid of this picture"
        )  # fmt: skip
        figure.text(0.5, 0.42, found, ha="center", va="center", fontsize=13, color=_FAINT)
        _caption(figure, result)
        return _png(figure)


@contextmanager
def _figure(width: float, height: float) -> Iterator[Figure]:
    """Give a figure that is styled alike whatever the reader's own settings are."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield Figure((width, height), dpi=_DPI, facecolor="white")


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()
