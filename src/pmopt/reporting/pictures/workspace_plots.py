"""Pictures of workspaces as PNG bytes, the same for the same input."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.regions.sections import Section, SurfaceMesh
from pmopt.analysis.workspace.compute import WorkspaceResult
from pmopt.reporting.pictures.chart_text import Heading, heading, name_axis
from pmopt.reporting.pictures.style import (
    CHARACTER,
    COLOURS,
    FAINT,
    INK,
    caption_parts,
    draw_index_bar,
    estimate_text,
    fit_axes,
    index_label,
    index_scale,
    label,
    new_figure,
    rounded_up,
    to_picture,
    write_note,
)
from pmopt.units import ONE, pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch

#: Elevation and azimuth of the view in degrees: onto the cut across the second coordinate.
_VIEW = (24.0, -66.0)
#: Towards the light, and the outward normal of the cut, which keeps the colours of the scale.
_LIGHT = np.array([0.35, -0.45, 0.82])
_CUT = np.array([0.0, -1.0, 0.0])
#: Points between tick labels and names of axes in three dimensions.
_PAD = 9.0
#: Largest ratio of sides that are drawn to one scale.
_MOST_SLENDER = 12.0
_BINS = 100
#: Where the largest LCI is more than so many times the upper quantile the axis leaves it out.
_TAIL = 4.0
SINGULAR = "#E69F00"
_NO_SCALE = "sides not to one scale"
_STEPS = [1, 2, 2.5, 5, 10]


def draw_surface(mesh: SurfaceMesh, result: WorkspaceResult, remarks: Sequence[str] = ()) -> bytes:
    """Draw the surface of a workspace, cut open, its faces coloured by LCI.

    Parameters
    ----------
    mesh : SurfaceMesh
    result : WorkspaceResult
        Of the same design.
    remarks : sequence of str
        What the caption says further.
    """
    if len(mesh.faces) == 0:
        return _draw_nothing(result)
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    with new_figure(7.4, 5.4) as figure:
        from matplotlib.ticker import MaxNLocator

        axes: Any = figure.add_axes((0.1, 0.1, 0.8, 0.8), projection="3d")
        axes.view_init(*_VIEW)
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        true = high - low
        sides = _sides(true, mesh.units)
        notes = [*remarks, *([f"cut at {mesh.cut}"] if mesh.cut else [])]
        notes += _unscaled(true, sides, mesh.units)
        axes.set_box_aspect(sides)
        for k, axis in enumerate((axes.xaxis, axes.yaxis, axes.zaxis)):
            getattr(axes, f"set_{'xyz'[k]}lim")(low[k], high[k])
            axis.set_label_text(label(mesh.names[k], mesh.units[k]))
            axis.labelpad = _PAD
            count = 1 + round(7 * sides[k] / sides.max())
            ticks = MaxNLocator(count, steps=_STEPS, min_n_ticks=1)
            places = ticks.tick_values(low[k], high[k])
            # At the near corner a label of x would meet the first one of y.
            end = high[k] - (0.04 * (high[k] - low[k]) if k == 0 else 0.0)
            axis.set_ticks(places[(places >= low[k]) & (places <= end)])
            axis.set_pane_color("white")
        if mesh.downwards:
            axes.invert_zaxis()
        fit_axes(figure, axes, (0.02, 0.07, 0.84, 0.8))
        mesh = _facing(axes, mesh)
        quads = mesh.vertices[mesh.faces]
        scale = index_scale(mesh.lci)
        light = _LIGHT * [1.0, 1.0, -1.0 if mesh.downwards else 1.0]
        colours = _shade(scale.mappable.to_rgba(mesh.lci)[:, :3], quads, light)
        # Edges in the face's colour close the hairlines between antialiased neighbours.
        axes.add_collection3d(
            Poly3DCollection(quads, facecolors=colours, edgecolors=colours, linewidths=0.4),
            autolim=False,
        )
        draw_index_bar(figure, figure.add_axes((0.88, 0.2, 0.02, 0.55)), scale, result)
        _write_caption(figure, result, notes)
        return to_picture(figure)


def _write_caption(figure: Figure, result: WorkspaceResult, remarks: Sequence[str] = ()) -> None:
    """Write mechanism, dimensions and volume above, what the index is of below."""
    heading(figure.get_figwidth(), *caption_parts(result, remarks)).write(figure)
    write_note(figure, result)


def _draw_nothing(result: WorkspaceResult) -> bytes:
    """Draw what stands for a picture of an empty workspace."""
    with new_figure(6.0, 2.2) as figure:
        found = "nothing reachable" if result.reachable == 0 else (
            "the reachable set is too small for the grid of this picture"
        )  # fmt: skip
        figure.text(0.5, 0.42, found, ha="center", va="center", fontsize=13, color=FAINT)
        _write_caption(figure, result)
        return to_picture(figure)


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
    edges = list(result.settings.regions[1:-1])
    scale = index_scale(np.concatenate([section.lci.ravel() for section in sections]))
    lines = ["white lines: edges of the dexterity regions"] if edges else []
    lines += ["orange lines: forward or constraint singularity"]

    def above(width: float, remarks: list[str]) -> Heading:
        return heading(width, *caption_parts(result, [*remarks, *lines]))

    with section_panels(sections, above) as (figure, panels, beside):
        for section, axes in zip(sections, panels, strict=True):
            _draw_section(axes, section, scale.end, edges)
        bar = draw_index_bar(figure, beside, scale, result)
        for edge in edges:
            if edge < scale.end:
                bar.ax.axhline(edge, color="white", linewidth=1.0)
        write_note(figure, result)
        return to_picture(figure)


@contextmanager
def section_panels(
    sections: Sequence[Section],
    above: Callable[[float, list[str]], Heading],
) -> Iterator[tuple[Figure, list[Axes], Axes]]:
    """Give a figure with axes for each section, to one scale, and axes for a colour bar.

    The axes have their titles, labels and ticks. ``above`` makes the heading from the figure's
    width and remarks about the scale.
    """
    true = np.array([[np.ptp(s.horizontal), np.ptp(s.vertical)] for s in sections])
    units = [unit for s in sections for unit in s.units]
    sides = _sides(true, units)
    remarks = _unscaled(true, sides, units)
    sides = sides * min(9.3 / sides[:, 0].sum(), 3.4 / sides[:, 1].max())
    left, bottom, gap, tallest = 0.8, 0.75, 0.85, sides[:, 1].max()
    width = left + sides[:, 0].sum() + gap * len(sides) + 0.6
    written = above(float(width), remarks)
    head = max(0.9, written.height + 0.2)
    head += 0.15 * max(section.plane.count("\n") for section in sections)
    size = np.array([width, bottom + tallest + head])
    with new_figure(*size) as figure:
        from matplotlib.ticker import MaxNLocator

        written.write(figure)
        panels = []
        for section, side in zip(sections, sides, strict=True):
            axes = figure.add_axes((*([left, bottom] / size), *(side / size)))
            axes.set_title(section.plane)
            axes.set_xlabel(label(section.names[0], section.units[0]))
            axes.set_ylabel(label(section.names[1], section.units[1]), labelpad=2)
            axes.set_xlim(section.horizontal[0], section.horizontal[-1])
            axes.set_ylim(section.vertical[0], section.vertical[-1])
            # A label is wider than it is high.
            for axis, count in ((axes.xaxis, side[0] / 0.5), (axes.yaxis, side[1] / 0.3)):
                ticks = MaxNLocator(max(1, int(count)), steps=_STEPS, min_n_ticks=1)
                axis.set_major_locator(ticks)
            panels.append(axes)
            left += side[0] + gap
        place = (*([left - gap + 0.25, bottom] / size), *([0.15, tallest] / size))
        yield figure, panels, figure.add_axes(place)


def outline_of(axes: Axes, section: Section) -> PathPatch | None:
    """Draw the outline of the reachable set; None where it is empty."""
    from matplotlib.patches import PathPatch

    if section.inside.max() < 0:
        return None
    x, y = section.horizontal, section.vertical
    filled = axes.contourf(x, y, section.inside, [0.0, 2 * section.inside.max() + 1])
    outline = PathPatch(filled.get_paths()[0], fill=False, edgecolor=INK, linewidth=0.9)
    filled.remove()
    axes.add_patch(outline)
    return outline


def draw_singular(
    axes: Axes, section: Section, colour: str = SINGULAR, dashes: Any = "solid"
) -> None:
    """Draw where the inverse Jacobian's determinant changes sign."""
    sign = np.sign(section.determinant)
    if sign.min() < sign.max():
        # Only within reach: beyond it the determinant says nothing.
        reached = np.where(section.inside >= 0, section.determinant, np.nan)
        if np.nanmin(reached) < 0 < np.nanmax(reached):
            axes.contour(
                section.horizontal, section.vertical, reached, [0.0], colors=[colour],
                linewidths=1.4, linestyles=[dashes], zorder=4,
            )  # fmt: skip


def image_place(section: Section) -> tuple[float, float, float, float]:
    """Return the extent of an image whose pixels are the section's points."""
    x, y = section.horizontal, section.vertical
    dx, dy = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    return x[0] - dx, x[-1] + dx, y[0] - dy, y[-1] + dy


def _draw_section(axes: Axes, section: Section, largest: float, edges: Sequence[float]) -> None:
    """Draw LCI and the edges of its regions, clipped to the outline of the reachable set."""
    x, y, values = section.horizontal, section.vertical, section.continued
    outline = outline_of(axes, section)
    if outline is None:
        return
    draw_singular(axes, section)
    image = axes.imshow(
        values, COLOURS, vmin=0.0, vmax=largest, origin="lower", extent=image_place(section),
        aspect="auto", interpolation="bilinear",
    )  # fmt: skip
    image.set_clip_path(outline)
    crossed = [edge for edge in edges if values.min() < edge < values.max()]
    if crossed:
        lines = axes.contour(x, y, values, crossed, colors="white", linewidths=0.8)
        lines.set_clip_path(outline)


def draw_histogram(result: WorkspaceResult) -> bytes:
    """Draw the distribution of LCI over the reachable volume and the share of each region.

    Parameters
    ----------
    result : WorkspaceResult
    """
    if result.reachable == 0:
        return _draw_nothing(result)
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    inner = list(result.settings.regions[1:-1])
    width, height, left, bottom, right = 7.2, 3.4, 0.85, 0.75, 0.25
    inches = width - left - right
    end, step = _axis(result)
    inner = [edge for edge in inner if edge < end]
    shares = _shares(result, step)
    colours = ScalarMappable(Normalize(0.0, end), COLOURS)
    texts, spans, absent = [], [], []
    for region in result.regions:
        share = estimate_text(100 * region.share.value, 100 * region.share.error)
        if region.lower >= end:
            absent.append(f"LCI ≥ {region.lower:g}: {share} %")
            continue
        bracket = "]" if region.upper == 1.0 else ")"
        texts.append(f"[{region.lower:g}, {region.upper:g}{bracket}\n{share} %")
        half = len(share + " %") * CHARACTER / 2
        centre = (region.lower + min(region.upper, end)) / 2 / end * inches
        spans.append((min(max(centre, half), inches - half), half))
    rows = _rows(spans)
    strip = 0.36 * (max(rows) + 1)
    ends = ((result.smallest, "≤", "least"), (result.largest, "≥", "largest"))
    remarks = [
        f"{name} LCI {'' if extreme.bound == 'proven' else f'{sign} '}{extreme.value:.4g}"
        for extreme, sign, name in ends
    ]
    if result.largest.value > end:
        remarks.append(f"{100 * (1 - shares.sum()):.2g} % are beyond the axis")
    above = heading(width, *caption_parts(result, [*remarks, *absent]))
    total = bottom + height + strip + above.height
    with new_figure(width, total) as figure:
        axes = figure.add_axes((left / width, bottom / total, inches / width, height / total))
        middles = step * (np.arange(len(shares)) + 0.5)
        axes.bar(
            middles, 100 * shares, step, color=colours.to_rgba(middles),
            edgecolor="white", linewidth=0.3,
        )  # fmt: skip
        for edge in inner:
            axes.axvline(edge, color=FAINT, linewidth=0.8, linestyle="--")
        for text, (centre, _), row in zip(texts, spans, rows, strict=True):
            place = (centre / inches, 1 + (0.06 + 0.36 * row) / height)
            axes.text(*place, text, transform=axes.transAxes, ha="center", va="bottom", fontsize=8)
        axes.set_xlim(0.0, end)
        name_axis(axes.xaxis, index_label(result), ONE)
        axes.set_ylabel(f"share of the reachable volume\nper {step:.3g} of LCI (%)")
        axes.spines[["top", "right"]].set_visible(False)
        above.write(figure)
        write_note(figure, result)
        return to_picture(figure)


def _axis(result: WorkspaceResult) -> tuple[float, float]:
    """Return where the axis of LCI ends, and the width of bars.

    It ends soon behind the largest index, or where nearly all are small against that, behind these.
    """
    most, high = result.largest.value, result.quantiles[-1].value
    reach = most if most <= _TAIL * high else _TAIL / 2 * high
    end = min(1.0, rounded_up(reach)) if reach > 0 else 1.0
    # In hundredths where there are enough of them.
    return end, 0.01 if end >= _BINS / 250 else end / _BINS


def _shares(result: WorkspaceResult, step: float) -> NDArray[np.float64]:
    """Return the shares of the points in bars of equal width from 0 on.

    The bins of the histogram are narrower than bars but for the lowest indices and, for the
    highest, nearly as wide: what a bar cuts off is taken as even within its bin.
    """
    counts = np.array(result.histogram, dtype=float)
    below = np.concatenate([[0.0], np.cumsum(counts)]) / counts.sum()
    edges = np.clip(result.histogram_edges, result.smallest.value, result.largest.value)
    ends = step * np.arange(_BINS + 1)
    found = np.interp(ends, edges, below, left=0.0, right=1.0)
    return np.asarray(np.diff(found))


def _rows(spans: Sequence[tuple[float, float]]) -> list[int]:
    """Give each label (centre, half its width) the lowest row where it meets no other."""
    ends: list[float] = []
    rows = []
    for centre, half in spans:
        row = next((r for r, end in enumerate(ends) if centre - half > end), len(ends))
        ends[row : row + 1] = [centre + half + CHARACTER]
        rows.append(row)
    return rows


def _facing(axes: Any, mesh: SurfaceMesh) -> SurfaceMesh:
    """Leave out faces of a closed surface that look away from the reader: they are hidden.

    Left in, they would shine through thin parts, whose sides are drawn by their depth.
    """
    from mpl_toolkits.mplot3d import proj3d

    flat = proj3d.proj_transform(*mesh.vertices.T, axes.get_proj())
    x, y = (np.asarray(v)[mesh.faces] for v in flat[:2])
    turn = (x[:, 2] - x[:, 0]) * (y[:, 3] - y[:, 1]) - (y[:, 2] - y[:, 0]) * (x[:, 3] - x[:, 1])
    front = turn < 0 if axes.zaxis_inverted() else turn > 0
    return replace(mesh, faces=mesh.faces[front], lci=mesh.lci[front])


def _shade(
    colours: NDArray[np.float64], quads: NDArray[np.float64], towards: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Brighten faces that are lit more than the cut and darken those that are lit less."""
    normals = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    light = ((normals - _CUT) @ towards / np.linalg.norm(towards))[:, None]
    lit, dark = np.maximum(light, 0.0), np.minimum(light, 0.0)
    return np.asarray(np.clip(colours * (1 + 0.5 * dark) + (1 - colours) * 0.5 * lit, 0.0, 1.0))


def _sides(sides: NDArray[np.float64], units: Sequence[str]) -> NDArray[np.float64]:
    """Return the sides to draw: those with one unit to one scale, else all alike.

    Lengths and angles have no scale in common: the longest side of each unit is drawn alike, and
    what is too slender to be seen is drawn as long.
    """
    flat, drawn = sides.ravel(), np.ones(sides.size)
    for unit in dict.fromkeys(units):
        own = np.array([u == unit for u in units])
        if flat[own].max() <= _MOST_SLENDER * flat[own].min():
            drawn[own] = flat[own] / flat[own].max()
    return drawn.reshape(sides.shape)


def _unscaled(
    sides: NDArray[np.float64], drawn: NDArray[np.float64], units: Sequence[str]
) -> list[str]:
    """Say which sides are drawn to different scales, nothing where none are."""
    scales: dict[str, set[float]] = {}
    for scale, unit in zip((drawn / np.maximum(sides, 1e-300)).ravel(), units, strict=True):
        scales.setdefault(unit, set()).add(float(f"{scale:.9g}"))
    if any(len(found) > 1 for found in scales.values()):
        return [_NO_SCALE]
    return [f"{' and '.join(map(pretty, scales))} not to one scale"] if len(scales) > 1 else []
