"""The mechanism itself at a pose: links, joints and platform as a static 3-D picture."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.base import PLATFORM, Chain, Mechanism, Parameters
from pmopt.reporting.canvas import (
    FAINT,
    INK,
    fit_axes,
    label,
    new_figure,
    parameter_text,
    to_picture,
)

#: Marker of each kind of joint.
_MARKERS = {"R": "o", "P": "s", "C": "h", "U": "D", "S": "P", "Pa": "^"}
_NAMES = {
    "R": "revolute", "P": "prismatic", "C": "cylindrical", "U": "universal", "S": "spherical",
    "Pa": "parallelogram",
}  # fmt: skip
_LIMBS = ("#2f5d8a", "#c1573b", "#4f8a4f", "#8a5aa8", "#b08a2e")
_ACTUATED = "#e3342f"
#: Elevation and azimuth of the view in degrees.
_VIEW = (16.0, -62.0)
#: Where along its link the prismatic joint of a telescopic limb is drawn.
_TELESCOPE = 0.42
#: Half the width of a marker, in pixels.
_MARK = 9.0
_FRAME_DPI = 100
#: Points between tick labels and names of axes; more in frames, whose pixels are fewer.
_PAD, _FRAME_PAD = 4.0, 9.0


class _Label(NamedTuple):
    """A name in the picture and the place (3,) it belongs to."""

    place: NDArray[np.float64]
    text: str
    colour: str


def draw_mechanism(
    mechanism: Mechanism,
    parameters: Parameters,
    pose: Mapping[str, float],
    working_mode: str | None = None,
) -> bytes:
    """Draw a mechanism at a reachable pose.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete.
    pose : mapping
        Reachable in the working mode.
    working_mode : str, optional
        Default: the mechanism's first.

    Returns
    -------
    bytes
        PNG.
    """
    scene = _scene(mechanism, parameters, pose, mechanism.check_mode(working_mode))
    places = scene.places(mechanism)
    with new_figure(7.0, 6.0) as figure:
        axes = _new_axes(figure)
        labels = _draw_scene(axes, mechanism, scene)
        _set_box(figure, axes, mechanism, places.min(axis=0), places.max(axis=0))
        _write_labels(figure, axes, labels)
        _write_legend(figure, mechanism, scene.chains)
        _write_head(figure, mechanism, parameters)
        units = {c.name: mechanism.unit(c) for c in mechanism.pose}
        figure.text(0.02, 0.93, f"at {parameter_text(pose, units)}, working mode {scene.mode}",
                    va="top", fontsize=8.5, color="#555555")  # fmt: skip
        return to_picture(figure)


class _Scene(NamedTuple):
    """What is drawn at one pose: skeleton (flat), its segments and the joints of every limb."""

    mode: str
    flat: NDArray[np.float64]
    segments: NDArray[np.float64]
    chains: tuple[Chain, ...]

    def places(self, mechanism: Mechanism) -> NDArray[np.float64]:
        """Return all points that are drawn (n, 3), in the order of the picture's axes."""
        points = [j.point for chain in self.chains for j in chain.joints]
        return np.concatenate([self.segments.reshape(-1, 3), points])[:, _order(mechanism)]


def _scene(
    mechanism: Mechanism, parameters: Parameters, pose: Mapping[str, float], mode: str
) -> _Scene:
    constants = mechanism.kernel_constants(parameters, mode, 1.0, {})
    with np.errstate(over="ignore", invalid="ignore"):  # as in compiled code
        flat = np.array(mechanism.skeleton(*pose.values(), tuple(constants)))
    first = 12
    segments = flat[first : first + 6 * len(mechanism.segments)].reshape(-1, 2, 3)
    return _Scene(mode, flat, segments, mechanism.layout(parameters, pose, mode))


def _order(mechanism: Mechanism) -> list[int]:
    """Return the coordinates of the base frame as the picture has them, the vertical one last."""
    return [k for k in range(3) if k != mechanism.vertical] + [mechanism.vertical]


def _new_axes(figure: Any) -> Any:
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8), projection="3d")
    axes.view_init(*_VIEW)
    axes.set_proj_type("ortho")
    return axes


def _draw_scene(axes: Any, mechanism: Mechanism, scene: _Scene) -> list[_Label]:
    """Draw links, joints and platform; return the names of the joints."""
    order, flat, segments = _order(mechanism), scene.flat, scene.segments
    corners = [
        end[1] for limb, end in zip(mechanism.segments, segments, strict=True) if limb == PLATFORM
    ]
    _draw_platform(axes, np.array(corners)[:, order], flat[:3][order])
    labels: list[_Label] = [_Label(flat[:3][order], "P", INK)]
    for number, chain in enumerate(scene.chains):
        colour = _LIMBS[number % len(_LIMBS)]
        own = [s for limb, s in zip(mechanism.segments, segments, strict=True) if limb == number]
        joints = [joint.point for joint in chain.joints]
        if own:
            # A column or rail along which the first joint slides.
            rail = np.array([joints[0], own[0][0]])[:, order]
            axes.plot(*rail.T, color=colour, linewidth=1.2, linestyle=":", zorder=2)
        for line in own or [np.array(joints)]:
            axes.plot(*line[:, order].T, color=colour, linewidth=3.0, solid_capstyle="round",
                      zorder=3)  # fmt: skip
        labels += _draw_joints(axes, chain.joints, own, number + 1, order, colour)
    bases = np.array([chain.joints[0].point for chain in scene.chains])[:, order]
    ring = np.vstack([bases, bases[:1]])
    axes.plot(*ring.T, color=FAINT, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
    return labels


def _set_box(
    figure: Any, axes: Any, mechanism: Mechanism, low: NDArray[np.float64],
    high: NDArray[np.float64], pad: float = _PAD,
) -> None:  # fmt: skip
    """Set limits, ticks and names of the axes, and fit them to the figure."""
    from matplotlib.ticker import MaxNLocator

    # A flat mechanism gets some depth: its labels would meet.
    half = np.maximum((high - low) / 2, 0.15 * float((high - low).max())) * 1.06
    low, high = (low + high) / 2 - half, (low + high) / 2 + half
    axes.set_box_aspect(high - low)
    names = np.array(["x", "y", "z"])[_order(mechanism)]
    for k, axis in enumerate((axes.xaxis, axes.yaxis, axes.zaxis)):
        getattr(axes, f"set_{'xyz'[k]}lim")(low[k], high[k])
        axis.set_label_text(label(str(names[k]), mechanism.length_unit))
        axis.set_pane_color("white")
        axis.labelpad = pad
        count = 2 + round(4 * (high[k] - low[k]) / float((high - low).max()))
        axis.set_major_locator(MaxNLocator(count))
    if mechanism.vertical == 0:
        axes.invert_zaxis()  # the paper's x points downwards
    fit_axes(figure, axes, (0.03, 0.06, 0.74, 0.8))


def _write_head(figure: Any, mechanism: Mechanism, parameters: Parameters) -> None:
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    shown = {k: v for k, v in parameters.items() if v is not None}
    figure.text(0.02, 0.97, f"{mechanism.name}: {parameter_text(shown, units)}", va="top",
                fontsize=10.5)  # fmt: skip


def draw_frames(
    mechanism: Mechanism,
    parameters: Parameters,
    poses: Sequence[Mapping[str, float]],
    captions: Sequence[str],
    working_mode: str | None = None,
) -> Iterator[NDArray[np.uint8]]:
    """Draw a moving mechanism, all frames in one box, with the path of the platform's centre.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete.
    poses : sequence of mappings
        Reachable in the working mode, one a frame.
    captions : sequence of str
        What is written above each frame.
    working_mode : str, optional
        Default: the mechanism's first.

    Yields
    ------
    (height, width, 3) uint8
        Red, green and blue.
    """
    mode = mechanism.check_mode(working_mode)
    scenes = [_scene(mechanism, parameters, pose, mode) for pose in poses]
    lows, highs = [], []
    for scene in scenes:
        places = scene.places(mechanism)
        lows.append(places.min(axis=0))
        highs.append(places.max(axis=0))
    centres = np.array([scene.flat[:3] for scene in scenes])[:, _order(mechanism)]
    with new_figure(7.0, 6.0) as figure:
        figure.set_dpi(_FRAME_DPI)
        axes = _new_axes(figure)
        _draw_scene(axes, mechanism, scenes[0])
        _set_box(figure, axes, mechanism, np.min(lows, axis=0), np.max(highs, axis=0), _FRAME_PAD)
        _write_legend(figure, mechanism, scenes[0].chains)
        _write_head(figure, mechanism, parameters)
        written = figure.text(0.02, 0.93, "", va="top", fontsize=8.5, color="#555555")
        for number, (scene, caption) in enumerate(zip(scenes, captions, strict=True)):
            for artist in [*axes.lines, *axes.collections]:
                artist.remove()
            axes.plot(*centres.T, color=FAINT, linewidth=0.6, zorder=1)
            axes.plot(*centres[: number + 1].T, color=_ACTUATED, linewidth=1.4, zorder=4)
            _draw_scene(axes, mechanism, scene)
            written.set_text(caption)
            canvas: Any = figure.canvas
            canvas.draw()
            yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _draw_platform(axes: Any, corners: NDArray[np.float64], centre: NDArray[np.float64]) -> None:
    """Draw the platform: the polygon of its joints around the centre."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if len(corners) == 2:
        axes.plot(*corners.T, color=INK, linewidth=4.0, solid_capstyle="round", zorder=2)
        return
    arms = corners - corners.mean(axis=0)
    _, _, basis = np.linalg.svd(arms)
    around = np.argsort(np.arctan2(arms @ basis[1], arms @ basis[0]))
    axes.add_collection3d(
        Poly3DCollection([corners[around]], facecolor="#d9dde2", edgecolor=INK, alpha=0.75),
        autolim=False,
    )
    axes.scatter(*centre[:, None], color=INK, s=12, zorder=5)


def _draw_joints(
    axes: Any,
    joints: Any,
    links: list[NDArray[np.float64]],
    number: int,
    order: list[int],
    colour: str,
) -> list[_Label]:
    """Draw markers and return their names; joints at one place share a label.

    A prismatic joint at the end of a link stands within the link, where the link telescopes.
    """
    labels: list[_Label] = []
    for joint in joints:
        place = joint.point[order]
        taken = any(np.allclose(other.place, place) for other in labels)
        along = [s for s in links if np.allclose(s[0], joint.point)]
        if joint.kind == "P" and taken and along:
            place = (along[0][0] + _TELESCOPE * (along[0][1] - along[0][0]))[order]
        face = _ACTUATED if joint.drive else "white"
        axes.scatter(*place[:, None], marker=_MARKERS[joint.kind], s=46, facecolor=face,
                     edgecolor=colour, linewidth=1.3, depthshade=False, zorder=5)  # fmt: skip
        name = f"{joint.kind}{number}"
        same = [k for k, other in enumerate(labels) if np.allclose(other.place, place)]
        if same:
            labels[same[0]] = labels[same[0]]._replace(text=f"{labels[same[0]].text}, {name}")
        else:
            labels.append(_Label(place, name, colour))
    return labels


def _write_labels(figure: Any, axes: Any, labels: list[_Label]) -> None:
    """Write names beside their joints, each where it covers least, preferably outwards."""
    from matplotlib.patheffects import withStroke
    from mpl_toolkits.mplot3d import proj3d

    def projected(places: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = np.stack(proj3d.proj_transform(*places.T, axes.get_proj())[:2], axis=1)
        return np.asarray(axes.transData.transform(flat))

    pixels = projected(np.array([one.place for one in labels]))
    renderer = figure.canvas.get_renderer()
    # Tick labels, markers and points along the lines: boxes (x0, y0, x1, y1) not to be covered.
    boxes = [
        text.get_window_extent(renderer).extents
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis)
        for text in (*axis.get_ticklabels(), axis.label)
        if text.get_text()
    ]
    boxes += [np.concatenate([pixel - _MARK, pixel + _MARK]) for pixel in pixels]
    for line in axes.lines:
        ends = projected(np.stack(line.get_data_3d(), axis=1))
        for start, end in itertools.pairwise(ends):
            count = 2 + int(np.linalg.norm(end - start) / 6)
            for point in np.linspace(start, end, count):
                boxes.append(np.concatenate([point - 3, point + 3]))
    covered = np.array(boxes)
    frame = np.array([figure.bbox.width, figure.bbox.height])
    ways = [np.array([np.cos(t), np.sin(t)]) for t in np.linspace(0, 2 * np.pi, 24, endpoint=False)]
    centre = pixels.mean(axis=0)
    halo = [withStroke(linewidth=2.2, foreground="white")]
    for one, pixel in zip(labels, pixels, strict=True):
        written = figure.text(0.0, 0.0, one.text, fontsize=7.5, color=one.colour, ha="center",
                              va="center", path_effects=halo)  # fmt: skip
        box = written.get_window_extent(renderer)
        half = np.array([box.width, box.height]) / 2
        outward = (pixel - centre) / max(float(np.linalg.norm(pixel - centre)), 1.0)
        best, least = pixel, np.inf
        for reach, way in itertools.product((1.0, 1.5, 2.2), ways):
            middle = pixel + way * (reach * _MARK + np.abs(way) @ half)
            if (middle - half < 4).any() or (middle + half > frame - 4).any():
                continue
            over = np.minimum(middle + half, covered[:, 2:])
            over = np.maximum(over - np.maximum(middle - half, covered[:, :2]), 0.0)
            cost = over.prod(axis=1).sum() + 20.0 * (1 - way @ outward) + 60.0 * (reach - 1.0)
            if cost < least:
                best, least = middle, cost
        written.set_position(figure.transFigure.inverted().transform(best))
        covered = np.vstack([covered, [*(best - half), *(best + half)]])


def _write_legend(figure: Any, mechanism: Mechanism, chains: Any) -> None:
    from matplotlib.lines import Line2D

    limbs = [
        Line2D([], [], color=_LIMBS[k % len(_LIMBS)], linewidth=3,
               label=f"{limb.name}: {limb.joints}")
        for k, limb in enumerate(mechanism.limbs)
    ]  # fmt: skip
    kinds = dict.fromkeys(joint.kind for chain in chains for joint in chain.joints)
    marks = [
        Line2D([], [], color=INK, marker=_MARKERS[kind], markerfacecolor="white", linestyle="",
               label=f"{kind}, {_NAMES[kind]}")
        for kind in kinds
    ]  # fmt: skip
    marks.append(
        Line2D([], [], color=INK, marker="o", markerfacecolor=_ACTUATED, linestyle="",
               label="actuated")
    )  # fmt: skip
    figure.legend(handles=limbs, loc="upper right", bbox_to_anchor=(0.99, 0.88), frameon=False,
                  fontsize=8)  # fmt: skip
    height = 0.88 - 0.035 * (len(limbs) + 1)
    figure.legend(handles=marks, loc="upper right", bbox_to_anchor=(0.99, height), frameon=False,
                  fontsize=8)  # fmt: skip
