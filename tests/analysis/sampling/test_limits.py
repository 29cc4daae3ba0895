"""Limits of real machines: clearances, cone angles, the tool; and the positions reached."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.poses import random_poses, reachable, ready

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.analysis.workspace.projection import measure_projection
from pmopt.compiler.records import flat
from pmopt.errors import InputError
from pmopt.kernels.segment_distance import segment_distance2
from pmopt.kernels.vectors import Vec3
from pmopt.mechanisms import find


def columns(poses):
    return np.array([list(p.values()) for p in poses]).T


def skeleton(mechanism, params, pose):
    """Return position, rotation, segments (s, 2, 3) and cosines of cones, plainly."""
    flat = np.array(
        mechanism.skeleton(*pose.values(), ready(mechanism, params, mechanism.working_modes[0]))
    )
    row = mechanism.structure.skeleton_row
    assert len(flat) == row.size == 12 + 6 * len(mechanism.segments) + len(mechanism.cones)
    return (
        flat[row.place],
        flat[row.rotation].reshape(3, 3),
        flat[row.segments].reshape(-1, 2, 3),
        flat[row.cones],
    )


def test_skeleton_is_where_the_platform_is(mechanism):
    """Position, rotation, spokes from the centre, and links that end at the platform's joints."""
    params = mechanism.resolve({})
    size = mechanism.characteristic_length(params)
    assert len(mechanism.spokes) == mechanism.segments.count(-1)
    for pose, _ in reachable(mechanism, params, 20):
        position, rotation, segments, cosines = skeleton(mechanism, params, pose)
        wanted_rotation, wanted = mechanism.platform(params, pose)
        np.testing.assert_allclose(position, wanted, atol=1e-9 * size)
        np.testing.assert_allclose(rotation, wanted_rotation, atol=1e-9)
        joined = iter(mechanism.spokes)
        for limb, (start, end) in zip(mechanism.segments, segments, strict=True):
            if limb >= 0:
                continue
            np.testing.assert_allclose(start, position, atol=1e-9 * size)
            met = next(joined)
            far = [s[1] for n, s in zip(mechanism.segments, segments, strict=True) if n == met]
            assert far
            assert min(np.linalg.norm(end - f) for f in far) < 1e-9 * size
        assert (np.abs(cosines) <= 1 + 1e-12).all()


def test_cones_are_closed_at_home(mechanism):
    params = mechanism.resolve({})
    *_, cosines = skeleton(mechanism, params, mechanism.home(params))
    np.testing.assert_allclose(cosines, 1.0, atol=1e-9)


def check_clearances(mechanism, tool=None, **more):
    """Hold the margin against distances of all pairs of links that are not joined.

    Those to the tool's shaft count as those to the platform. Diameters are quantiles of the least
    distances met: half of the poses are too close.
    """
    params = mechanism.resolve({})
    poses = [p for p, _ in reachable(mechanism, params, 60)]
    spokes = iter(mechanism.spokes)
    joined = [next(spokes) if limb < 0 else limb for limb in mechanism.segments]
    least = []  # between limbs, and between limbs and platform
    for pose in poses:
        position, rotation, segments, _ = skeleton(mechanism, params, pose)
        nearest = [math.inf, math.inf]
        for i, a in enumerate(segments):
            if mechanism.segments[i] < 0:
                continue
            for j, b in enumerate(segments):
                if joined[i] == joined[j]:
                    continue
                distance = math.sqrt(segment_distance2(*(Vec3(*end) for end in (*a, *b))))
                which = int(mechanism.segments[j] < 0)
                nearest[which] = min(nearest[which], distance)
            if tool:
                shaft = position, position + rotation @ tool
                distance = math.sqrt(segment_distance2(*(Vec3(*end) for end in (*a, *shaft))))
                nearest[1] = min(nearest[1], distance)
        least.append(nearest)
    between, to_platform = np.array(least).T
    link = float(np.quantile(between, 0.4))
    platform = max(2 * float(np.quantile(to_platform, 0.4)) - link, 0.1 * link)
    settings = WorkspaceSettings(link_diameter=link, platform_diameter=platform, tool=tool, **more)
    sampler = make_sampler(mechanism, settings, threads=1)
    margin, _ = sampler.evaluator.field(sampler.design(params), columns(poses))
    free = (between >= link) & (to_platform >= (link + platform) / 2)
    # The pose whose distance is the quantile itself may fall on either side by rounding.
    told = (np.abs(between - link) > 1e-9 * link) & (
        np.abs(to_platform - (link + platform) / 2) > 1e-9 * link
    )
    assert ((margin >= 0) == free)[told].all()
    assert 0 < free.sum() < len(free)


def check_cones_and_tool(mechanism, **more):
    params = mechanism.resolve({})
    size = mechanism.characteristic_length(params)
    poses = [p for p, _ in reachable(mechanism, params, 60)]
    tool = (0.3 * size, -0.2 * size, 0.9 * size)
    places = []
    for pose in poses:
        position, rotation, *_ = skeleton(mechanism, params, pose)
        places.append(position + rotation @ tool)
    low, high = np.quantile(places, [0.2, 0.8], axis=0).T[1]
    settings = WorkspaceSettings(cone_angle=0.5, tool=tool, limits={"tool_y": (low, high)}, **more)
    sampler = make_sampler(mechanism, settings, threads=1)
    design = sampler.design(params)
    margin, _ = sampler.evaluator.field(design, columns(poses))
    facts = sampler.evaluator.probe(design, columns(poses))
    np.testing.assert_allclose(facts.tool, places, atol=1e-9 * size)
    np.testing.assert_allclose(facts.margin, margin, rtol=1e-12, atol=1e-14)
    verdicts = []
    for pose, place, found in zip(poses, places, margin, strict=True):
        cosines = skeleton(mechanism, params, pose)[3]
        free = bool((cosines >= math.cos(0.5)).all() and low <= place[1] <= high)
        assert (found >= 0) == free
        verdicts.append(free)
    assert sum(verdicts) < len(verdicts)
    assert sum(verdicts) > 0 or mechanism.name == "4-ups-rps"  # nine cones at once


# With all checks at once one program is compiled of each mechanism: those that are not looked at
# are kept by every pose.


def test_margin_with_clearances(mechanism):
    size = mechanism.characteristic_length(mechanism.resolve({}))
    check_clearances(mechanism, tool=(0.0, 0.1 * size, 0.4 * size), cone_angle=math.pi)


def test_margin_with_cones_and_tool(mechanism):
    size = mechanism.characteristic_length(mechanism.resolve({}))
    check_cones_and_tool(mechanism, link_diameter=1e-9 * size)


def test_margin_with_one_check_alone(pauu):
    check_clearances(pauu)
    check_cones_and_tool(pauu)


@pytest.mark.slow
def test_limits_shrink_the_workspace(mechanism):
    size = mechanism.characteristic_length(mechanism.resolve({}))
    narrow = {"cone_angle": 0.5, "tool": (0.0, 0.0, 0.0)}
    found = [
        compute_workspace(
            mechanism, settings=WorkspaceSettings(samples=1 << 15, **given), shape_grid=0
        ).volume.value
        for given in (
            {},
            {**narrow, "link_diameter": 1e-9 * size},
            {**narrow, "link_diameter": 0.5 * size},
        )
    ]
    assert found[0] > found[1] >= found[2]


def test_tool_limits_need_a_tool(mechanism):
    with pytest.raises(InputError, match="tool_x"):
        make_sampler(mechanism, WorkspaceSettings(limits={"tool_x": (0.0, 1.0)}))


def test_projected_volume_of_translations_is_the_volume():
    """2PaUU-PPaP: poses are positions, and their volume is known."""
    mechanism = find("2pauu-ppap")
    sampler = make_sampler(mechanism, WorkspaceSettings())
    for change in ({}, {"n": 1.0}, {"l1": 1.2, "l2": 0.9}):
        params = mechanism.resolve(change)
        found = measure_projection(sampler, sampler.design(params))
        exact = compute_workspace(mechanism, change, shape_grid=0).volume.value
        assert abs(found.volume.value - exact) < 3 * found.volume.error
        assert found.volume.error < 0.1 * exact


@pytest.mark.slow
def test_footprint_of_few_samples_is_that_of_many(mechanism):
    """Hulls of few points are too small; what they miss is told."""
    params = mechanism.resolve({})
    sampler = make_sampler(mechanism, WorkspaceSettings())
    design = sampler.design(params)
    many = measure_projection(sampler, design, 1 << 20).footprint
    few = measure_projection(sampler, design, 1 << 15).footprint
    assert abs(few.value - many.value) < 2.5 * few.error
    assert many.error < few.error < 0.12 * many.value


def test_footprint_grows_with_the_base():
    mechanism = find("2pauu-ppap")
    sampler = make_sampler(mechanism, WorkspaceSettings())
    areas = [
        measure_projection(sampler, sampler.design(mechanism.resolve({"m": m, "n": m})), 1 << 16)
        for m in (0.8, 1.0, 1.3)
    ]
    assert areas[0].footprint.value < areas[1].footprint.value < areas[2].footprint.value
    assert all(a.footprint.error < 0.05 * a.footprint.value for a in areas)


def test_random_poses_are_told_apart(mechanism):
    """The positions told by a probe are those of the platform, for poses in and out of reach."""
    params = mechanism.resolve({})
    poses = random_poses(mechanism, params, 200)
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=2)
    facts = sampler.evaluator.probe(sampler.design(params), columns(poses))
    assert np.isfinite(facts.position).all()
    assert np.isfinite(facts.segments).all()
    assert np.isfinite(facts.entries).all()


def test_shape_is_counted_in_any_dimension(mechanism):
    """Pose space and positions; the papers' "no holes" is answered for every mechanism."""
    result = compute_workspace(mechanism, settings=WorkspaceSettings(samples=1 << 16))
    document = result.to_dict()
    cells = {3: 96, 4: 28, 5: 14}[len(mechanism.pose)]
    assert document["shape"]["grid"] == cells
    assert (result.shape.workspace.pieces, result.shape.workspace.voids) == (1, 0)
    assert document["projected_shape"]["pieces"] == 1
    for region, topology in zip(result.regions, result.shape.regions, strict=True):
        if region.volume.value == 0:
            assert topology.pieces == 0


@pytest.mark.parametrize(
    ("samples", "largest"), [(1 << 14, 0.08), (1 << 17, 0.02), (1 << 20, 0.005)]
)
def test_projected_volume_where_it_is_known_otherwise(samples, largest):
    """3-CUR: position and tilt tell each other, so that the integral of z's range is the volume.

    At a tilt z runs through the common part of the strokes; x and y are the tilt's alone.
    """
    mechanism = find("3-cur")
    params = mechanism.resolve({})
    free = {f"h{k}": (-math.inf, math.inf) for k in (1, 2, 3)}
    sampler = make_sampler(mechanism, WorkspaceSettings())
    design = sampler.design(params)
    limits = {**mechanism.default_limits(params), **free}
    unbounded = mechanism.kernel_constants(params, "up-up-up", 1.0, limits)
    tilts = np.linspace(-0.9, 0.9, 401)
    beta, gamma = (m.ravel() for m in np.meshgrid(tilts, tilts, indexing="ij"))
    poses = np.stack([0 * beta, beta, gamma])
    inside = sampler.evaluator.field(replace(design, constants=flat(unbounded)), poses)[0] >= 0
    facts = sampler.evaluator.probe(design, poses)
    heights = facts.segments[:, :3, 0, 2]  # of the sliders where z is 0
    depth = np.where(inside, 0.3 - np.ptp(heights, axis=1), 0.0).clip(0).reshape(401, 401)
    x, y = (facts.position[:, k].reshape(401, 401) for k in (0, 1))
    (x_b, x_g), (y_b, y_g) = (np.gradient(v, tilts[1] - tilts[0]) for v in (x, y))
    areas = x_b * y_g - x_g * y_b
    assert (areas[depth > 0] < 0).all()  # one sign: no position is met twice nearby
    exact = float((depth * np.abs(areas)).sum() * (tilts[1] - tilts[0]) ** 2)
    found = measure_projection(sampler, design, samples).volume
    assert abs(found.value - exact) < 2.5 * found.error
    assert found.error < largest * exact


def test_a_cavity_of_the_positions_is_a_void_and_no_volume():
    """A spindle torus' cavity, whole: neither counted with the positions nor filled by chance."""
    mechanism = find("2pauu-ppap")
    settings = WorkspaceSettings(domain={"z": (-math.inf, math.inf)})
    sampler = make_sampler(mechanism, settings)
    change = {"m": 1, "n": 1, "l1": 1, "l2": 1.6}
    found = measure_projection(sampler, sampler.design(mechanism.resolve(change)))
    assert (found.shape.pieces, found.shape.voids, found.shape.confirmed) == (1, 1, True)
    exact = compute_workspace(mechanism, change, settings, shape_grid=0).volume.value
    assert abs(found.volume.value - exact) < 3 * found.volume.error


def test_too_fine_a_grid_is_refused(mechanism):
    with pytest.raises(InputError, match="shape_grid=9999"):
        compute_workspace(mechanism, shape_grid=9999)
