"""Pictures of a motion over time as PNG bytes, the same for the same input."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.motion import Motion
from pmopt.analysis.motion_config import ACCELERATION, EFFORT, POWER, RATE
from pmopt.analysis.motion_summary import columns
from pmopt.mechanisms import Mechanism
from pmopt.reporting.canvas import label, new_figure, parameter_text, to_picture
from pmopt.reporting.gallery import Gallery
from pmopt.units import per_second

#: Told apart without colour too, by the dashes.
_COLOURS = ("#2f5d8a", "#c1573b", "#4f8a4f", "#8a5aa8", "#b08a2e", "#3a8f9b", "#d08fb5", "#555555")
_DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)))
#: Most points of a curve that are drawn, about the pixels of a panel twice over.
_POINTS = 4000


class _Panel(NamedTuple):
    """Curves of one unit: what stands on the axis, and the curves by name, (N,) each."""

    title: str
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
    gallery = Gallery()
    for file, (title, names) in groups.items():
        known = [name for name in names if name in series]
        units = dict.fromkeys(series[name].unit for name in known)
        panels = [
            _Panel(title, unit,
                   {_short(n): series[n].values for n in known if series[n].unit == unit})
            for unit in units
        ]  # fmt: skip
        if panels:
            rows = [[panel] for panel in panels]
            gallery.add(
                f"{file}.png", functools.partial(_draw, motion, mechanism, title, rows)
            )
    if motion.centres:
        gallery.add(
            "centres.png",
            lambda: _draw(
                motion, mechanism, "centres of mass", _centre_panels(motion, mechanism.length_unit)
            ),
        )
    return gallery


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
            _Panel(f"{what}{axis}", told,
                   {name: values[:, order, k] for name, values in motion.centres.items()})
            for k, axis in enumerate("xyz")
        ]
        for order, (what, told) in enumerate(orders)
    ]  # fmt: skip


def _draw(
    motion: Motion, mechanism: Mechanism, title: str, rows: Sequence[Sequence[_Panel]]
) -> bytes:
    """Draw panels over one axis of time, with their names at the right."""
    from matplotlib.lines import Line2D

    across = len(rows[0])
    shared = across > 1
    longest = max(len(name) for row in rows for panel in row for name in panel.curves)
    legend = 0.55 + 0.075 * longest
    width, each = (3.3 * across if shared else 7.2), 2.1
    most = max(len(panel.curves) for row in rows for panel in row)
    height = max(each * len(rows), 0.2 * most) + 1.1
    size = (width + legend, height)
    stride = -(-len(motion.t) // _POINTS)
    with new_figure(*size) as figure:
        grid: Any = figure.subplots(len(rows), across, sharex=True, squeeze=False)
        for row, panels in zip(grid, rows, strict=True):
            for axes, panel in zip(row, panels, strict=True):
                for k, values in enumerate(panel.curves.values()):
                    axes.plot(motion.t[::stride], values[::stride], **_line(k))
                axes.set_xlim(motion.t[0], motion.t[-1])
                _set_range(axes, list(panel.curves.values()))
                axes.grid(True)
                named = panel.title if shared else ", ".join(panel.curves)
                axes.set_ylabel(label(named if len(named) < 40 else panel.title, panel.unit))
                handles = [Line2D([], [], label=name, **_line(k))
                           for k, name in enumerate(panel.curves)]  # fmt: skip
                if not shared:
                    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.03),
                                frameon=False, fontsize=8, handlelength=2.6)  # fmt: skip
        for axes in grid[-1]:
            axes.set_xlabel(label("t", "s"))
        left, right = 0.85 / size[0], 1 - legend / size[0]
        figure.subplots_adjust(left, 0.5 / height, right, 1 - 0.6 / height, hspace=0.16,
                               wspace=0.42)  # fmt: skip
        figure.align_ylabels(grid)
        if shared:
            figure.legend(handles=handles, loc="upper left", frameon=False, fontsize=8,
                          bbox_to_anchor=(right, 1 - 0.5 / height), handlelength=2.6)  # fmt: skip
        units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
        shown = {k: v for k, v in motion.params.items() if v is not None}
        x = 0.15 / size[0]
        figure.text(x, 1 - 0.1 / height, f"{mechanism.name}: {title}", va="top", fontsize=10.5)
        figure.text(x, 1 - 0.31 / height,
                    f"{parameter_text(shown, units)}, working mode {motion.working_mode}",
                    va="top", fontsize=8.5, color="#555555")  # fmt: skip
        return to_picture(figure)


def _line(number: int) -> dict[str, Any]:
    return {
        "color": _COLOURS[number % len(_COLOURS)],
        "linestyle": _DASHES[number // len(_COLOURS) % len(_DASHES)],
        "linewidth": 1.3,
    }


def _set_range(axes: Any, curves: Sequence[NDArray[np.float64]]) -> None:
    """Give a range in which rounding about a constant is no curve."""
    low, high = min(float(c.min()) for c in curves), max(float(c.max()) for c in curves)
    size = max(abs(low), abs(high), 1e-9)
    margin = 0.06 * (high - low) if high - low > 1e-6 * size else 0.1 * size
    axes.set_ylim(low - margin, high + margin)
