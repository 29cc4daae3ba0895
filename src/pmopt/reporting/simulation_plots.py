"""Pictures of a motion against an engine as PNG bytes, the same for the same input."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pmopt.analysis.motion_config import MotionTask
from pmopt.analysis.simulation import Comparison, Simulation
from pmopt.reporting.canvas import LINE, label, new_figure, parameter_text, to_picture
from pmopt.units import effort_unit

_ENGINE, _ERROR = "#c1573b", "#555555"
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
    width, height = 3.3 * across + 0.5, 3.9 * bands + 0.6
    stride = -(-len(found.t) // _POINTS)
    t = found.t[::stride]
    with new_figure(width, height) as figure:
        grid = figure.add_gridspec(
            bands, across, left=0.8 / width, right=1 - 0.15 / width, bottom=0.5 / height,
            top=1 - 0.7 / height, wspace=0.42, hspace=0.32,
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
            top.set_ylabel(label(joint.name, effort_unit(joint.kind)))
            top.tick_params(labelbottom=False)
            low.plot(t, found.error[::stride, k], color=_ERROR, linewidth=0.9)
            if np.isnan(found.error[:, k]).all():
                low.text(0.5, 0.5, "no load", transform=low.transAxes, ha="center", va="center")
            low.set_ylabel("error (% of peak)")
            low.set_xlabel(label("t", "s"))
            low.ticklabel_format(axis="y", style="sci", scilimits=(-3, 3))
            low.yaxis.get_offset_text().set_fontsize(7)
            for axes in (top, low):
                axes.grid(True)
                axes.set_xlim(simulation.inverse.t[0], simulation.inverse.t[-1])
            figure.align_ylabels([top, low])
            if k == 0:
                figure.legend(*top.get_legend_handles_labels(), loc="upper right", frameon=False,
                              ncols=2, fontsize=8,
                              bbox_to_anchor=(1 - 0.1 / width, 1 - 0.32 / height))  # fmt: skip
        _write_head(figure, task, simulation, mode)
        return to_picture(figure)


def _pad(axes: Any, *curves: Any) -> None:
    """Give a range in which rounding about a constant is no curve."""
    low, high = (float(f(c)) for f, c in ((np.min, curves), (np.max, curves)))
    size = max(abs(low), abs(high), 1e-9)
    margin = 0.06 * (high - low) if high - low > 1e-6 * size else 0.1 * size
    axes.set_ylim(low - margin, high + margin)


def _write_head(figure: Any, task: MotionTask, simulation: Simulation, mode: str) -> None:
    width, height = figure.get_size_inches()
    mechanism = task.mechanism
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    shown = {k: v for k, v in task.parameters.items() if v is not None}
    controller = task.config.controller
    if mode == "forward" and controller is not None:
        ahead = "feed-forward and PID" if controller.feedforward else "PID"
        how = f"forward under {ahead} every {simulation.hold:g} s"
        if simulation.unstable is not None:
            how += f", unstable at t = {simulation.unstable.t:.4g} s"
    else:
        how = "inverse dynamics"
    x = 0.15 / width
    figure.text(x, 1 - 0.1 / height, f"{mechanism.name}: efforts, theory and {simulation.engine}, "
                f"{how}", va="top", fontsize=10.5)  # fmt: skip
    below = parameter_text(shown, units)
    if mode == "forward" and simulation.saturation:
        below += "; dotted: a drive's limits, which it meets first at the dash-dotted line"
    figure.text(x, 1 - 0.31 / height, below, va="top", fontsize=8.5, color="#555555")
