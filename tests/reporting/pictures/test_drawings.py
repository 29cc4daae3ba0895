"""Pictures of shapes: surfaces without holes, planes and scales, drawings whose labels are free."""

import itertools
import math

import numpy as np
import pytest

from pmopt.analysis.regions.sections import round_level
from pmopt.analysis.regions.surface import surface_nets
from pmopt.errors import InputError
from pmopt.mechanisms import find, names
from pmopt.reporting.pictures import drawing, workspace_plots

AXES = [np.linspace(0.0, 1.0, n) for n in (24, 20, 22)]


def seen_from_above(field):
    """Return the area of what faces upwards, projected, and how often each edge is used."""
    net = surface_nets(field, AXES)
    x, y, _ = np.moveaxis(net.vertices[net.faces], 2, 0)
    turn = (x[:, 2] - x[:, 0]) * (y[:, 3] - y[:, 1]) - (y[:, 2] - y[:, 0]) * (x[:, 3] - x[:, 1])
    edges = np.sort(np.stack([net.faces, np.roll(net.faces, -1, axis=1)], axis=2).reshape(-1, 2))
    return float(turn[turn > 0].sum() / 2), np.unique(edges, axis=0, return_counts=True)[1]


def plate(thickness, slope, lift=0.31):
    def field(points):
        x, y, z = points
        bent = lift + slope * x + 0.4 * slope * np.sin(3 * y)
        return thickness / 2 - np.abs(z - bent)

    return field


@pytest.mark.parametrize("thickness", [0.1, 0.02, 0.002])
@pytest.mark.parametrize("slope", [0.0, 0.03, 0.3])
def test_a_sheet_thinner_than_the_grid_is_whole(thickness, slope):
    area, uses = seen_from_above(plate(thickness, slope))
    assert area == pytest.approx(1.0, abs=1e-3)
    assert (uses % 2 == 0).all()


@pytest.mark.parametrize("thickness", [0.02, 0.002])
def test_a_gap_thinner_than_the_grid_is_whole(thickness):
    area, uses = seen_from_above(lambda p: -plate(thickness, 0.03)(p))
    assert area == pytest.approx(2.0, abs=1e-3)  # the top, and the lower part's
    assert (uses % 2 == 0).all()


def test_a_ball_has_its_radius():
    net = surface_nets(lambda p: 0.09 - ((p - 0.5) ** 2).sum(axis=0), AXES)
    assert np.linalg.norm(net.crossings - 0.5, axis=1) == pytest.approx(0.3, abs=1e-4)
    assert np.linalg.norm(net.vertices - 0.5, axis=1) == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize(
    ("value", "width", "rounded"),
    [(0.362, 0.3, 0.36), (1.0983, 2.1, 1.1), (-0.0049, 0.5, -0.005), (1e-9, 0.5, 0.0),
     (4.617, 404.0, 5.0)],
)  # fmt: skip
def test_planes_have_round_levels(value, width, rounded):
    assert round_level(value, width) == rounded


def test_lengths_are_to_one_scale():
    true = np.array([[750.0, 1500.0], [750.0, 1.5]])
    units = ["mm", "mm", "mm", "rad"]
    drawn = workspace_plots._sides(true, units)
    assert drawn.tolist() == [[0.5, 1.0], [0.5, 1.0]]
    assert workspace_plots._unscaled(true, drawn, units) == ["mm and rad not to one scale"]
    assert workspace_plots._unscaled(true[:1], drawn[:1], units[:2]) == []
    thin = np.array([[1500.0, 10.0]])
    assert workspace_plots._unscaled(
        thin, workspace_plots._sides(thin, ["mm", "mm"]), ["mm", "mm"]
    ) == [workspace_plots._NO_SCALE]


def drawn(monkeypatch, mechanism, params, pose):
    kept = []
    monkeypatch.setattr(drawing, "to_picture", lambda figure: kept.append(figure) or b"")
    drawing.draw_mechanism(mechanism, params, pose)
    return kept[0]


@pytest.mark.parametrize("name", names())
def test_labels_are_free_and_within_the_frame(monkeypatch, name):
    mechanism = find(name)
    params = mechanism.resolve({})
    figure = drawn(monkeypatch, mechanism, params, mechanism.home(params))
    texts = {text.get_text(): text for text in figure.texts}
    joints = {name for limb in mechanism.limbs for name in limb.joint_names}
    written = {part.split(":")[0] for text in texts for part in text.split(", ")}
    assert joints | {limb.name for limb in mechanism.limbs} | {"x", "y", "z", "g"} <= written
    assert {c.name for c in mechanism.joints} <= {
        part for text in texts for part in text.replace(", ", ": ").split(": ")
    }
    boxes = [text.get_window_extent() for text in figure.texts]
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)
    for box in boxes:
        assert 0 <= box.x0 < box.x1 <= figure.bbox.width
        assert 0 <= box.y0 < box.y1 <= figure.bbox.height
    # What is drawn takes most of the room beside the legend.
    axes = figure.axes[0]
    parts = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    wide = (max(p.x1 for p in parts) - min(p.x0 for p in parts)) / figure.bbox.width
    high = (max(p.y1 for p in parts) - min(p.y0 for p in parts)) / figure.bbox.height
    assert wide > 0.6 or high > 0.7
    assert high > 0.5


def test_frames_do_not_move():
    mechanism = find("2pauu-ppap")
    params = mechanism.resolve({})
    poses = [mechanism.home(params) | {"y": y} for y in (-0.4, 0.0, 0.4)]
    frames = list(drawing.draw_frames(mechanism, params, poses, ["", "", ""], gravity=(0, 0, 0)))
    beside = int(frames[0].shape[1] * (1 - drawing._BESIDE / drawing._WIDTH))
    assert all((frame[:, beside:] == frames[0][:, beside:]).all() for frame in frames)
    assert not (frames[0] == frames[2]).all()


def test_a_limit_of_one_limb_names_that_of_all():
    mechanism = find("3-cur")
    with pytest.raises(InputError, match="theta4_2 is theta4 of one limb; here theta4 is of all"):
        mechanism.check_ranges({"theta4_2": (-1, math.pi / 4)}, mechanism.limited, "limits")
