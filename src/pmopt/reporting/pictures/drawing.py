"""The mechanism itself at a pose: links, joints and platform as a static 3-D picture."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.mechanism import PLATFORM, Chain, Mechanism, Parameters
from pmopt.reporting.pictures.chart_text import LINES
from pmopt.reporting.pictures.style import (
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
#: Of limbs, which the colour-blind can distinguish (M. Okabe, K. Ito, 2008).
_LIMBS = LINES[:6]
_PATH = "#D55E00"
_PLATFORM = "#c9ced6"
#: Elevation and azimuth of the view in degrees.
_VIEW = (16.0, -62.0)
#: Where along its link the prismatic joint of a telescopic limb is drawn.
_TELESCOPE = 0.42
#: Where along its longest link a limb's name stands.
_MIDDLE = 0.62
#: Half the width of a marker, in pixels.
_MARK = 11.0
#: Distances of labels from their places, in these; from the last one on a line leads there.
_REACHES = (1.0, 1.5, 2.2, 3.2, 4.5, 6.0, 8.0)
_LEADS = 3.2
#: Width of figures and of what is beside the mechanism, in inches.
_WIDTH, _BESIDE = 7.4, 1.95
#: Height of the mechanism's part and of what is written above it, in inches.
_LEAST, _MOST, _HEAD = 3.3, 6.4, 0.6
#: Length of the base frame's arrows, as a share of the size.
_ARROW = 0.16
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
    units = {c.name: mechanism.unit(c) for c in mechanism.pose}
    with new_figure(_WIDTH, _MOST) as figure:
        axes = _new_axes(figure)
        _write_head(figure, mechanism, parameters,
                    f"at {parameter_text(pose, units)}, working mode {scene.mode}")  # fmt: skip
        labels = _draw_scene(axes, mechanism, scene)
        _set_box(figure, axes, mechanism, scene.places(mechanism))
        labels += _draw_frame(axes, mechanism)
        gravity = mechanism.down if mechanism.bodies(parameters) else None
        _write_beside(figure, axes, mechanism, scene.chains, gravity)
        _write_labels(figure, axes, labels)
        return to_picture(figure)


class _Scene(NamedTuple):
    """What is drawn at one pose: the platform's centre, segments and the joints of every limb."""

    mode: str
    place: NDArray[np.float64]
    segments: NDArray[np.float64]
    chains: tuple[Chain, ...]

    def places(self, mechanism: Mechanism) -> NDArray[np.float64]:
        """Return all points that are drawn (n, 3), in the order of the picture's axes."""
        points = [np.zeros(3), *(j.point for chain in self.chains for j in chain.joints)]
        return np.concatenate([self.segments.reshape(-1, 3), points])[:, _order(mechanism)]


def _scene(
    mechanism: Mechanism, parameters: Parameters, pose: Mapping[str, float], mode: str
) -> _Scene:
    constants = mechanism.kernel_constants(parameters, mode, 1.0, {})
    with np.errstate(over="ignore", invalid="ignore"):  # as in compiled code
        flat = np.array(mechanism.skeleton(*pose.values(), constants))
    row = mechanism.structure.skeleton_row
    segments = flat[row.segments].reshape(-1, 2, 3)
    return _Scene(mode, flat[row.place], segments, mechanism.layout(parameters, pose, mode))


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
    order, place = _order(mechanism), scene.place
    segments = list(zip(mechanism.structure.segments, scene.segments, strict=True))
    corners = [ends[1] for segment, ends in segments if segment.limb == PLATFORM]
    _draw_platform(axes, np.reshape(corners, (-1, 3))[:, order], place[order])
    labels: list[_Label] = [_Label(place[order], "P", INK)]
    for number, chain in enumerate(scene.chains):
        colour = _LIMBS[number % len(_LIMBS)]
        own = [ends for segment, ends in segments if segment.limb == number]
        joints = [joint.point for joint in chain.joints]
        if own:
            # A column or rail along which the first joint slides.
            rail = np.array([joints[0], own[0][0]])[:, order]
            axes.plot(*rail.T, color=colour, linewidth=1.2, linestyle=":", zorder=2)
        for line in own or [np.array(joints)]:
            axes.plot(*line[:, order].T, color=colour, linewidth=3.0, solid_capstyle="round",
                      zorder=3)  # fmt: skip
        names = [mechanism.joint_name(number, k, j.kind) for k, j in enumerate(chain.joints)]
        labels += _draw_joints(axes, chain.joints, names, own, order, colour)
        longest = max(own or [np.array([joints[0], joints[-1]])],
                      key=lambda line: float(np.linalg.norm(line[1] - line[0])))  # fmt: skip
        middle = longest[0] + _MIDDLE * (longest[1] - longest[0])
        labels.append(_Label(middle[order], mechanism.limbs[number].name, colour))
    bases = np.array([chain.joints[0].point for chain in scene.chains])[:, order]
    ring = np.vstack([bases, bases[:1]])
    axes.plot(*ring.T, color=FAINT, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
    return labels


def _set_box(
    figure: Any, axes: Any, mechanism: Mechanism, places: NDArray[np.float64], pad: float = _PAD
) -> None:
    """Set limits, ticks and names of the axes about places (n, 3), and the figure's height."""
    from matplotlib.ticker import MaxNLocator
    from matplotlib.transforms import Bbox

    low, high = places.min(axis=0), places.max(axis=0)
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
        # The view shortens the second axis.
        count = 2 + round((4, 2, 4)[k] * (high[k] - low[k]) / float((high - low).max()))
        axis.set_major_locator(MaxNLocator(count))
    if mechanism.down[mechanism.vertical] > 0:
        axes.invert_zaxis()  # the vertical axis points downwards
    if mechanism.vertical == 1:
        axes.invert_yaxis()  # x, z, y: else a mirror image
    # As high as what is drawn is at the width there is.
    wide, above = (_WIDTH - _BESIDE - 0.2) / _WIDTH, _HEAD + 0.15
    for _ in range(2):
        height = float(figure.get_size_inches()[1])
        fit_axes(figure, axes, (0.1 / _WIDTH, 0.1 / height, wide, 1 - above / height))
        renderer = figure.canvas.get_renderer()
        parts = [axis.get_tightbbox(renderer) for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        drawn = Bbox.union(parts)
        needed = drawn.height * wide * _WIDTH / drawn.width
        figure.set_size_inches(_WIDTH, above + float(np.clip(needed, _LEAST, _MOST)))
    height = float(figure.get_size_inches()[1])
    fit_axes(figure, axes, (0.1 / _WIDTH, 0.1 / height, wide, 1 - above / height))
    axes.apply_aspect()  # where what is drawn will be


def _draw_frame(axes: Any, mechanism: Mechanism) -> list[_Label]:
    """Draw the base frame's axes as arrows from its origin; return their names."""
    limits = np.reshape(axes.get_w_lims(), (3, 2))
    length = _ARROW * float(np.abs(np.diff(limits)).max())
    order = _order(mechanism)
    labels = []
    for k, name in enumerate("xyz"):
        end = np.zeros(3)
        end[order.index(k)] = length
        axes.plot(*np.stack([np.zeros(3), end]).T, color=INK, linewidth=1.1, zorder=4)
        axes.plot(*0.999 * end[:, None], color=INK, marker=".", markersize=5, zorder=4)
        labels.append(_Label(end, name, INK))
    return labels


def _write_head(figure: Any, mechanism: Mechanism, parameters: Parameters, below: str) -> Any:
    """Write name and dimensions above the picture and a line below them; return the latter."""
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    shown = {k: v for k, v in parameters.items() if v is not None}
    head = f"{mechanism.name}: {parameter_text(shown, units)}"
    inches = figure.dpi_scale_trans
    from matplotlib.transforms import ScaledTranslation

    def at(down: float) -> Any:
        return figure.transFigure + ScaledTranslation(0.0, -down, inches)

    figure.text(0.02, 1.0, head, va="top", transform=at(0.12),
                fontsize=min(10.5, 10.5 * 84 / len(head)))  # fmt: skip
    return figure.text(0.02, 1.0, below, va="top", transform=at(0.36), color="#555555",
                       fontsize=min(8.5, 8.5 * 104 / max(len(below), 1)))  # fmt: skip


def draw_frames(
    mechanism: Mechanism,
    parameters: Parameters,
    poses: Sequence[Mapping[str, float]],
    captions: Sequence[str],
    working_mode: str | None = None,
    gravity: Sequence[float] | None = None,
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
    gravity : (3,) of float, optional
        In the base frame; default: as the mechanism stands.

    Yields
    ------
    (height, width, 3) uint8
        Red, green and blue.
    """
    mode = mechanism.check_mode(working_mode)
    scenes = [_scene(mechanism, parameters, pose, mode) for pose in poses]
    places = np.concatenate([scene.places(mechanism) for scene in scenes])
    centres = np.array([scene.place for scene in scenes])[:, _order(mechanism)]
    pulled = mechanism.down if gravity is None else gravity
    with new_figure(_WIDTH, _MOST) as figure:
        figure.set_dpi(_FRAME_DPI)
        axes = _new_axes(figure)
        written = _write_head(figure, mechanism, parameters, " " * max(map(len, captions)))
        _draw_scene(axes, mechanism, scenes[0])
        _set_box(figure, axes, mechanism, places, _FRAME_PAD)
        _write_beside(figure, axes, mechanism, scenes[0].chains,
                      pulled if mechanism.bodies(parameters) else None)  # fmt: skip
        for one in _draw_frame(axes, mechanism):
            axes.text(*(1.15 * one.place), one.text, fontsize=8, ha="center", va="center")
        for number, (scene, caption) in enumerate(zip(scenes, captions, strict=True)):
            for artist in [*axes.lines, *axes.collections]:
                artist.remove()
            axes.plot(*centres.T, color=FAINT, linewidth=0.6, zorder=1)
            axes.plot(*centres[: number + 1].T, color=_PATH, linewidth=1.4, zorder=4)
            _draw_scene(axes, mechanism, scene)
            _draw_frame(axes, mechanism)
            written.set_text(caption)
            canvas: Any = figure.canvas
            canvas.draw()
            yield np.asarray(canvas.buffer_rgba())[:, :, :3].copy()


def _draw_platform(axes: Any, corners: NDArray[np.float64], centre: NDArray[np.float64]) -> None:
    """Draw the platform: the polygon of its joints around the centre, or what there is of it."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if len(corners) < 2:  # a point, or an arm, that a limb's link ends in
        axes.plot(*np.vstack([corners, centre]).T, color=INK, linewidth=6.0, zorder=2)
        axes.scatter(*centre[:, None], color=INK, s=12, zorder=5)
        return
    if len(corners) == 2:
        axes.plot(*corners.T, color=INK, linewidth=6.0, solid_capstyle="round", zorder=2)
        return
    arms = corners - corners.mean(axis=0)
    _, _, basis = np.linalg.svd(arms)
    around = np.argsort(np.arctan2(arms @ basis[1], arms @ basis[0]))
    axes.add_collection3d(
        Poly3DCollection([corners[around]], facecolor=_PLATFORM, alpha=0.75), autolim=False
    )
    axes.plot(*corners[[*around, around[0]]].T, color=INK, linewidth=1.6, zorder=3)
    axes.scatter(*centre[:, None], color=INK, s=12, zorder=5)


def _draw_joints(
    axes: Any,
    joints: Any,
    names: Sequence[str],
    links: list[NDArray[np.float64]],
    order: list[int],
    colour: str,
) -> list[_Label]:
    """Draw markers and return their names; joints at one place share a label.

    A prismatic joint at the end of a link stands within the link, where the link telescopes.
    """
    labels: list[_Label] = []
    for joint, name in zip(joints, names, strict=True):
        place = joint.point[order]
        taken = any(np.allclose(other.place, place) for other in labels)
        along = [s for s in links if np.allclose(s[0], joint.point)]
        if joint.kind == "P" and taken and along:
            place = (along[0][0] + _TELESCOPE * (along[0][1] - along[0][0]))[order]
        same = [k for k, other in enumerate(labels) if np.allclose(other.place, place)]
        # Of joints at one place the later one is drawn within the earlier.
        axes.scatter(*place[:, None], marker=_MARKERS[joint.kind], s=22 if same else 58,
                     facecolor=colour if joint.drive else "white", edgecolor=INK,
                     linewidth=1.0, depthshade=False, zorder=5)  # fmt: skip
        if joint.drive and joint.drive[0] != name:
            name = f"{name}: {joint.drive[0]}"
        if same:
            labels[same[0]] = labels[same[0]]._replace(text=f"{labels[same[0]].text}, {name}")
        else:
            labels.append(_Label(place, name, colour))
    return labels


def _write_labels(figure: Any, axes: Any, labels: list[_Label]) -> None:
    """Write names beside their joints, each where it covers least, preferably outwards."""
    from matplotlib.lines import Line2D
    from matplotlib.patheffects import withStroke
    from mpl_toolkits.mplot3d import proj3d

    def projected(places: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = np.stack(proj3d.proj_transform(*places.T, axes.get_proj())[:2], axis=1)
        return np.asarray(axes.transData.transform(flat))

    figure.draw_without_rendering()  # tick labels have no place before
    pixels = projected(np.array([one.place for one in labels]))
    renderer = figure.canvas.get_renderer()
    # Tick labels, markers and points along the lines: boxes (x0, y0, x1, y1) not to be covered.
    boxes = [
        text.get_window_extent(renderer).extents
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis)
        for text in (*(tick.label1 for tick in axis.get_major_ticks()), axis.label)
        if text.get_text()
    ]
    boxes += [np.concatenate([pixel - _MARK, pixel + _MARK]) for pixel in pixels]
    for line in axes.lines:
        ends = projected(np.stack(line.get_data_3d(), axis=1))
        for start, end in itertools.pairwise(ends):
            count = 2 + int(np.linalg.norm(end - start) / 6)
            for point in np.linspace(start, end, count):
                boxes.append(np.concatenate([point - 3, point + 3]))
    boxes += [t.get_window_extent(renderer).extents for t in figure.texts]
    boxes += [t.get_window_extent(renderer).extents for t in figure.legends]
    covered = np.array(boxes)
    frame = np.array([figure.bbox.width, figure.bbox.height])
    ways = [np.array([np.cos(t), np.sin(t)]) for t in np.linspace(0, 2 * np.pi, 24, endpoint=False)]
    centre = pixels.mean(axis=0)
    halo = [withStroke(linewidth=2.2, foreground="white")]
    for one, pixel in zip(labels, pixels, strict=True):
        written = figure.text(0.0, 0.0, one.text, fontsize=7.5, color=INK, ha="center",
                              va="center", path_effects=halo)  # fmt: skip
        box = written.get_window_extent(renderer)
        half = np.array([box.width, box.height]) / 2
        outward = (pixel - centre) / max(float(np.linalg.norm(pixel - centre)), 1.0)
        best, least, far = pixel, np.inf, 0.0
        for reach, way in itertools.product(_REACHES, ways):
            middle = pixel + way * (reach * _MARK + np.abs(way) @ half)
            if (middle - half < 4).any() or (middle + half > frame - 4).any():
                continue
            over = np.minimum(middle + half, covered[:, 2:])
            over = np.maximum(over - np.maximum(middle - half, covered[:, :2]), 0.0)
            # What is covered weighs more than any distance.
            hidden = float(over.prod(axis=1).sum())
            cost = 10.0 * hidden + 20.0 * (1 - way @ outward) + 60.0 * (reach - 1.0)
            if cost < least:
                best, least, far = middle, cost, reach
        inverse = figure.transFigure.inverted()
        written.set_position(inverse.transform(best))
        if far >= _LEADS:
            ends = inverse.transform([pixel, best])
            figure.add_artist(Line2D(*ends.T, color=FAINT, linewidth=0.6, zorder=1))
        covered = np.vstack([covered, [*(best - half), *(best + half)]])


def _write_beside(figure: Any, axes: Any, mechanism: Mechanism, chains: Any, gravity: Any) -> None:
    """Write what colours and markers mean, and show where gravity pulls, beside the mechanism."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import FancyArrowPatch, Patch

    limbs: list[Any] = [
        Line2D([], [], color=_LIMBS[k % len(_LIMBS)], linewidth=3,
               label=f"{limb.name}: {limb.joints}")
        for k, limb in enumerate(mechanism.limbs)
    ]  # fmt: skip
    if sum(segment.limb == PLATFORM for segment in mechanism.structure.segments) == 2:
        limbs.append(Line2D([], [], color=INK, linewidth=6, label="platform"))
    else:
        limbs.append(Patch(facecolor=_PLATFORM, edgecolor=INK, label="platform"))
    limbs.append(Line2D([], [], color=FAINT, linestyle=(0, (4, 3)), label="base"))
    kinds = dict.fromkeys(joint.kind for chain in chains for joint in chain.joints)
    marks = [
        Line2D([], [], color=INK, marker=_MARKERS[kind], markerfacecolor="white", linestyle="",
               label=f"{kind}, {_NAMES[kind]}")
        for kind in kinds
    ]  # fmt: skip
    marks.append(
        Line2D([], [], color=INK, marker="o", markerfacecolor=INK, linestyle="",
               label="filled: actuated")
    )  # fmt: skip
    height = float(figure.get_size_inches()[1])
    top = 1 - (_HEAD + 0.1) / height
    left = 1 - _BESIDE / _WIDTH
    for handles in (limbs, marks):
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(left, top),
                      frameon=False, fontsize=8)  # fmt: skip
        top -= (0.19 * len(handles) + 0.12) / height
    if gravity is None or not np.any(gravity):
        return
    from mpl_toolkits.mplot3d import proj3d

    order = _order(mechanism)
    way = np.asarray(gravity, dtype=float)[order] / float(np.linalg.norm(gravity))
    middle = np.reshape(axes.get_w_lims(), (3, 2)).mean(axis=1)
    size = float(np.abs(np.diff(np.reshape(axes.get_w_lims(), (3, 2)))).max())
    ends = np.stack([middle, middle + 0.1 * size * way])
    flat = np.stack(proj3d.proj_transform(*ends.T, axes.get_proj())[:2], axis=1)
    pixels = axes.transData.transform(flat)
    along = (pixels[1] - pixels[0]) / max(float(np.linalg.norm(pixels[1] - pixels[0])), 1e-9)
    start = np.array([left * _WIDTH + 0.35, top * height - 0.35]) - 0.22 * along
    scale = np.array([_WIDTH, height])
    figure.add_artist(
        FancyArrowPatch(start / scale, (start + 0.45 * along) / scale, arrowstyle="-|>",
                        mutation_scale=12, color=INK, transform=figure.transFigure)
    )  # fmt: skip
    figure.text(*((start + 0.22 * along + [0.18, 0.0]) / scale), "g", style="italic", va="center",
                fontsize=10)  # fmt: skip
