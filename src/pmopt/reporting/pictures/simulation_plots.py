"""Pictures of a motion against an engine as PNG bytes, the same for the same input."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pmopt.analysis.motion.config import MotionTask
from pmopt.analysis.multibody.simulation import Comparison, Simulation
from pmopt.reporting.pictures.chart_text import LINES, Heading, design_parts, heading, name_axis
from pmopt.reporting.pictures.style import LINE, label, new_figure, to_picture
from pmopt.units import effort_unit

_ENGINE, _ERROR = LINES[1], "#555555"
#: Inches: of a figure at least, so that its heading has room; of the legend below that.
_NARROWEST, _LEGEND = 6.0, 0.15
#: Panels of joints side by side.
_ACROSS = 3
#: Most points of a curve that are drawn.
_POINTS = 4000


def draw_comparison(
    task: MotionTask, simulation: Simulation, found: Comparison, mode: str
) -> bytes:
    """Draw each actuated joint's effort, theory over engine, and the error below.

    Parameters
    ----------
    task : MotionTask
    simulation : Simulation
    found : Comparison
        One of its modes.
    mode : {"inverse", "forward"}

    Returns
    -------
    bytes
        PNG.
    """
    joints = simulation.joints
    across = min(_ACROSS, len(joints))
    bands = -(-len(joints) // across)
    width = max(3.3 * across + 0.5, _NARROWEST)
    above = _heading(width, task, simulation, mode)
    top_of = above.height + _LEGEND
    height = 3.7 * bands + 0.5 + top_of
    stride = -(-len(found.t) // _POINTS)
    t = found.t[::stride]
    with new_figure(width, height) as figure:
        grid = figure.add_gridspec(
            bands, across, left=0.95 / width, right=1 - 0.15 / width, bottom=0.5 / height,
            top=1 - top_of / height, wspace=0.42, hspace=0.32,
        )  # fmt: skip
        for k, joint in enumerate(joints):
            cell = grid[k // across, k % across].subgridspec(2, 1, height_ratios=(1.6, 1),
                                                             hspace=0.12)  # fmt: skip
            top: Any = figure.add_subplot(cell[0])
            low: Any = figure.add_subplot(cell[1], sharex=top)
            top.plot(t, found.effort[::stride, k], color=LINE, linewidth=2.6, alpha=0.55,
                     label="theory")  # fmt: skip
            top.plot(t, found.engine_effort[::stride, k], color=_ENGINE, linewidth=1.0,
                     linestyle=(0, (5, 2)), label=simulation.engine)  # fmt: skip
            _pad(top, found.effort[:, k], found.engine_effort[:, k])
            for drive in simulation.saturation if mode == "forward" else ():
                if drive.joint == joint.name:
                    for end in (drive.lower, drive.upper):
                        if math.isfinite(end):
                            top.axhline(end, color="#808080", linewidth=0.8, linestyle=":")
                    top.axvline(drive.first, color="#808080", linewidth=0.8, linestyle="-.")
            name_axis(top.yaxis, f"effort of {joint.name}", effort_unit(joint.kind))
            top.tick_params(labelbottom=False)
            low.plot(t, found.error[::stride, k], color=_ERROR, linewidth=0.9)
            if np.isnan(found.error[:, k]).all():
                low.text(0.5, 0.5, "no load", transform=low.transAxes, ha="center", va="center")
            name_axis(low.yaxis, "error", "% of peak")
            low.set_ylabel(low.get_ylabel().replace(" (", "\n("))
            low.set_xlabel(label("t", "s"))
            for axes in (top, low):
                axes.grid(True)
                axes.set_xlim(simulation.inverse.t[0], simulation.inverse.t[-1])
            figure.align_ylabels([top, low])
            if k == 0:
                figure.legend(*top.get_legend_handles_labels(), loc="upper right", frameon=False,
                              ncols=2, fontsize=8,
                              bbox_to_anchor=(1 - 0.1 / width, 1 - (above.height - 0.1) / height)
                              )  # fmt: skip
        above.write(figure)
        return to_picture(figure)


def _pad(axes: Any, *curves: Any) -> None:
    """Give a range in which rounding about a constant is no curve."""
    low, high = (float(f(c)) for f, c in ((np.min, curves), (np.max, curves)))
    size = max(abs(low), abs(high), 1e-9)
    margin = 0.06 * (high - low) if high - low > 1e-6 * size else 0.1 * size
    axes.set_ylim(low - margin, high + margin)


def _heading(width: float, task: MotionTask, simulation: Simulation, mode: str) -> Heading:
    mechanism = task.mechanism
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    controller = task.config.controller
    if mode == "forward" and controller is not None:
        ahead = "feed-forward and PID" if controller.feedforward else "PID"
        how = f"forward under {ahead} every {simulation.hold:g} s"
        if simulation.unstable is not None:
            how += f", unstable at t = {simulation.unstable.t:.4g} s"
    else:
        how = "inverse dynamics"
    parts = design_parts(task.parameters, units)
    if mode == "forward" and simulation.saturation:
        parts.append("dotted: a drive's limits, which it meets first at the dash-dotted line")
    head = f"{mechanism.name}: efforts, theory and {simulation.engine}, {how}"
    return heading(width, head, parts)
