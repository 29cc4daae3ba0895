"""Pictures of a motion over time as PNG bytes, the same for the same input."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion.config import ACCELERATION, EFFORT, POWER, RATE
from pmopt.analysis.motion.records import Motion
from pmopt.analysis.motion.summary import columns
from pmopt.mechanisms import Mechanism
from pmopt.reporting.pictures.chart_text import design_parts, heading, line_style, name_axis
from pmopt.reporting.pictures.gallery import Gallery
from pmopt.reporting.pictures.style import CHARACTER, label, new_figure, to_picture
from pmopt.units import per_second

#: Characters at an axis that a panel has room for.
_LONGEST = 34
#: Most points of a curve that are drawn, about the pixels of a panel twice over.
_POINTS = 4000


#: What curves of a picture are, where their names do not say it.
_QUANTITIES = {
    "rates": "rate", "accelerations": "acceleration", "efforts": "effort", "power": "power",
}  # fmt: skip


class _Panel(NamedTuple):
    """Curves of one unit: what they are, as a title and at an axis, and the curves by name."""

    title: str
    quantity: str
    unit: str
    curves: dict[str, NDArray[np.float64]]


def draw_motion(motion: Motion, mechanism: Mechanism) -> dict[str, bytes]:
    """Draw every group of quantities: pose, joints, rates, accelerations, efforts, ..

    Parameters
    ----------
    motion : Motion
        Feasible throughout.
    mechanism : Mechanism

    Returns
    -------
    dict of str to bytes
        PNG by file name.
    """
    gallery = Gallery()
    for name, draw in quantities(motion, mechanism).items():
        gallery.add(f"{name}.png", draw)
    return gallery


def quantities(motion: Motion, mechanism: Mechanism) -> dict[str, Callable[[], bytes]]:
    """Return what draws each group of quantities that the motion has, by its name."""
    series = columns(motion, mechanism)
    joints = [c.name for c in motion.joints.coordinates]
    poses = [c.name for course in (motion.pose, motion.parasitic) for c in course.coordinates]
    groups = {
        "pose": ("pose", poses),
        "joints": ("actuated joints", joints),
        "passive": ("passive joints", [c.name for c in motion.passive.coordinates]),
        "rates": ("rates of the actuated joints", [f"{n}_rate" for n in joints]),
        "accelerations": (
            "accelerations of the actuated joints", [f"{n}_acceleration" for n in joints],
        ),
        "efforts": ("efforts of the actuators", [f"{n}_effort" for n in joints]),
        "power": ("power of the actuators", [f"{n}_power" for n in joints]),
    }  # fmt: skip
    found: dict[str, Callable[[], bytes]] = {}
    for file, (title, names) in groups.items():
        known = [name for name in names if name in series]
        units = dict.fromkeys(series[name].unit for name in known)
        panels = [
            _Panel(title, _QUANTITIES.get(file, ""), unit,
                   {_short(n): series[n].values for n in known if series[n].unit == unit})
            for unit in units
        ]  # fmt: skip
        if panels:
            rows = [[panel] for panel in panels]
            found[file] = functools.partial(_draw, motion, mechanism, title, rows)
    if motion.centres:
        found["centres"] = lambda: _draw(
            motion, mechanism, "centres of mass", _centre_panels(motion, mechanism.length_unit)
        )
    return found


def _short(name: str) -> str:
    """Return the joint's name, without the quantity."""
    for ending in (RATE, ACCELERATION, EFFORT, POWER):
        name = name.removesuffix(ending)
    return name


def _centre_panels(motion: Motion, unit: str) -> list[list[_Panel]]:
    """Return a row each of positions, velocities and accelerations, a column an axis."""
    orders = (("", unit), ("velocity ", per_second(unit)), ("acceleration ", per_second(unit, 2)))
    return [
        [
            _Panel(f"{what}{axis}", what.strip(), shown,
                   {name: values[:, order, k] for name, values in motion.centres.items()})
            for k, axis in enumerate("xyz")
        ]
        for order, (what, shown) in enumerate(orders)
    ]  # fmt: skip


def _draw(
    motion: Motion, mechanism: Mechanism, title: str, rows: Sequence[Sequence[_Panel]]
) -> bytes:
    """Draw panels over one axis of time, with their names at the right."""
    from matplotlib.lines import Line2D

    across = len(rows[0])
    shared = across > 1
    longest = max(len(name) for row in rows for panel in row for name in panel.curves)
    legend = 0.75 + 1.15 * CHARACTER * longest
    width, each = (3.3 * across if shared else 7.2) + legend, 2.1
    most = max(len(panel.curves) for row in rows for panel in row)
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    above = heading(
        width, f"{mechanism.name}: {title}",
        [*design_parts(motion.params, units), f"working mode {motion.working_mode}"],
    )  # fmt: skip
    height = max(each * len(rows), 0.2 * most) + 0.55 + above.height
    stride = -(-len(motion.t) // _POINTS)
    with new_figure(width, height) as figure:
        above.write(figure)
        grid: Any = figure.subplots(len(rows), across, sharex=True, squeeze=False)
        for row, panels in zip(grid, rows, strict=True):
            for axes, panel in zip(row, panels, strict=True):
                for k, values in enumerate(panel.curves.values()):
                    axes.plot(motion.t[::stride], values[::stride], **line_style(k))
                axes.set_xlim(motion.t[0], motion.t[-1])
                _set_range(axes, list(panel.curves.values()))
                axes.grid(True)
                name_axis(axes.yaxis, _named(panel, shared), panel.unit)
                handles = [Line2D([], [], label=name, **line_style(k))
                           for k, name in enumerate(panel.curves)]  # fmt: skip
                if not shared:
                    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.03),
                                frameon=False, fontsize=8, handlelength=2.8)  # fmt: skip
        for axes in grid[-1]:
            axes.set_xlabel(label("t", "s"))
        left, right = 0.95 / width, 1 - legend / width
        figure.subplots_adjust(left, 0.5 / height, right, 1 - above.height / height, hspace=0.16,
                               wspace=0.42)  # fmt: skip
        figure.align_ylabels(grid)
        if shared:
            figure.legend(handles=handles, loc="upper left", frameon=False, fontsize=8,
                          bbox_to_anchor=(right, 1 - above.height / height),
                          handlelength=2.8)  # fmt: skip
        return to_picture(figure)


def _named(panel: _Panel, shared: bool) -> str:
    """Return what stands at an axis: the quantity, and of whom where there is room for it."""
    if shared:
        return panel.title
    names = ", ".join(panel.curves)
    text = f"{panel.quantity} of {names}" if panel.quantity else names
    return text if len(text) < _LONGEST else panel.quantity or panel.title


def _set_range(axes: Any, curves: Sequence[NDArray[np.float64]]) -> None:
    """Give a range in which rounding about a constant is no curve."""
    low, high = min(float(c.min()) for c in curves), max(float(c.max()) for c in curves)
    size = max(abs(low), abs(high), 1e-9)
    margin = 0.06 * (high - low) if high - low > 1e-6 * size else 0.1 * size
    axes.set_ylim(low - margin, high + margin)
