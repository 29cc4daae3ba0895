"""4-UPS-RPS against its model, and against geometry written down a second time.

Paper: "Kinematics Analysis of 4-UPS-RPS Spatial 5-DOF Parallel Mechanism". It prints curves and no
numbers: those here are the model's, to ten decimals.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from support.exponentials import moved, screws, turn
from support.poses import random_poses, reachable, ready

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms import find
from pmopt.mechanisms.mechanism import within

RPS = find("4-ups-rps")
DEFAULT = RPS.resolve({})
DESIGNS = [DEFAULT, RPS.resolve({"R1": 600, "R": 700, "r": 280})]
PRINTED = 5e-11  # half a unit of the last printed digit
NAMES = ("x", "y", "alpha", "beta", "gamma")
JOINTS = ("l1", "l2", "l3", "l4", "l5")
QUARTER = math.pi / 2


def posed(*values):
    return dict(zip(NAMES, map(float, values), strict=True))


designs = st.builds(
    lambda big1, big, small: RPS.resolve({"R1": big1, "R": big, "r": small}),
    st.floats(500, 950), st.floats(450, 850), st.floats(120, 350),
)  # fmt: skip
tilts = st.floats(-1.2, 1.2)
poses = st.builds(
    posed, st.floats(300, 1300), st.floats(-300, 300), tilts, tilts, st.floats(-3.1, 3.1)
)


# --- the geometry a second time -----------------------------------------------------------


def rotation_of(pose):
    x, y, z = np.eye(3)
    return turn(z, pose["alpha"]) @ turn(y, pose["beta"]) @ turn(x, pose["gamma"])


def feet(params):
    """Return T_k, by angle from Y towards Z."""
    polar = [(params["R1"], 0)] + [(params["R"], a) for a in (45, 135, 225, 315)]
    return [
        np.array([0, r * math.cos(math.radians(a)), r * math.sin(math.radians(a))])
        for r, a in polar
    ]


def place_of(params, pose):
    """Return Rot, P and the ends S_k in the base: z is where S1 lies in the plane Z = 0."""
    rotation, r = rotation_of(pose), params["r"]
    local = [
        np.array([0, r * math.sin(math.radians(s)), -r * math.cos(math.radians(s))])
        for s in (0, 72, 144, 216, 288)
    ]
    arms = [rotation @ point for point in local]
    centre = np.array([pose["x"], pose["y"], -arms[0][2]])
    return rotation, centre, [centre + arm for arm in arms]


def lengths_of(params, pose):
    ends = place_of(params, pose)[2]
    return [float(np.linalg.norm(e - f)) for e, f in zip(ends, feet(params), strict=True)]


def slopes(function, pose):
    """Return derivatives by each pose coordinate, of fourth order."""
    columns = []
    for name in pose:
        step = 0.5 if name in "xy" else 1e-3
        total = 0.0
        for shift, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            moved_pose = {**pose, name: pose[name] + shift * step}
            total = total + weight * np.array(function(moved_pose)) / (12 * step)
        columns.append(total)
    return np.stack(columns, axis=-1)


# --- the model's numbers ------------------------------------------------------------------


@pytest.mark.parametrize(("pose", "z", "lengths"), [
    ((900, 0, 0, 0, QUARTER), 0,
     (1036.9305666244, 1017.1777228818, 1004.7174588946, 1004.7174588946, 1017.1777228818)),
    ((950, 0, -math.pi / 36, -math.pi / 36, 0), 201.2313290145,
     (1205.1648814239, 1056.3768541278, 1111.3116223134, 1282.1937663912, 1286.5148540868)),
    ((950, 0, -math.pi / 36, -math.pi / 36, QUARTER), 0,
     (1096.4842216191, 1051.3550702153, 1028.1587920168, 1046.2498533585, 1082.3095872821)),
    ((900, 30, 0.05, -0.08, QUARTER + 0.1), -20.1018522520,
     (1012.7607946713, 1001.8159928834, 1023.9381582852, 1023.3892234003, 1005.5554574693)),
])  # fmt: skip
def test_numbers_of_the_model(pose, z, lengths):
    (solution,) = RPS.inverse(DEFAULT, posed(*pose))
    assert solution.working_mode == "direct"
    assert list(solution.joints) == list(JOINTS)
    assert list(solution.joints.values()) == pytest.approx(lengths, rel=0, abs=PRINTED)
    assert solution.parasitic == {"z": pytest.approx(z, rel=0, abs=PRINTED)}


def test_declared_as_in_the_paper():
    """Section 3.1; the strokes are ours."""
    assert DEFAULT == {"R1": 717.0, "R": 645.0, "r": 202.0}
    assert RPS.default_limits(DEFAULT) == dict.fromkeys(JOINTS, (700.0, 1300.0))
    assert [limb.joints for limb in RPS.limbs] == ["RPS", "UPS", "UPS", "UPS", "UPS"]
    assert RPS.characteristic_length(DEFAULT) == 202.0
    assert RPS.home(DEFAULT) == posed(900, 0, 0, 0, QUARTER)
    domain = RPS.default_domain(DEFAULT)
    assert domain["x"] == (0.0, math.inf)
    assert domain["alpha"] == domain["beta"] == pytest.approx((-math.pi / 4, math.pi / 4))
    assert domain["gamma"] == pytest.approx((math.pi / 6, 5 * math.pi / 6))
    assert "y" not in domain


def test_home_is_inside_for_every_corner_of_the_bounds():
    for big1 in (500, 950):
        for big in (450, 850):
            for small in (120, 350):
                params = RPS.resolve({"R1": big1, "R": big, "r": small})
                assert all(700 < v < 1300 for v in lengths_of(params, RPS.home(params)))


# --- positions ----------------------------------------------------------------------------


@given(designs, poses)
def test_inverse_and_platform_equal_the_geometry(params, pose):
    (solution,) = RPS.inverse(params, pose)
    rotation, centre, _ = place_of(params, pose)
    found, place = RPS.platform(params, pose)
    np.testing.assert_allclose(found, rotation, rtol=0, atol=1e-14)
    np.testing.assert_allclose(place, centre, rtol=0, atol=1e-10)
    expected = lengths_of(params, pose)
    np.testing.assert_allclose(list(solution.joints.values()), expected, rtol=0, atol=1e-9)
    assert solution.parasitic["z"] == place[2]
    assert solution.passive == {}


def test_printed_height_of_the_trajectory_is_out_of_reach():
    """Z = 980 of section 3.1: no orientation lifts P more than r off the plane of limb 1."""
    rng = np.random.default_rng(2)
    zs = [RPS.inverse(DEFAULT, p)[0].parasitic["z"] for p in (
        posed(900, 0, *angles) for angles in rng.uniform(-math.pi, math.pi, (500, 3)))]  # fmt: skip
    assert max(map(abs, zs)) <= DEFAULT["r"] < 980


def test_reach_tells_the_end_of_the_stroke():
    told = {r.limb: r for r in RPS.reach(DEFAULT, RPS.home(DEFAULT))}
    assert told["limb 1"].distance == pytest.approx(1300 - 1036.9305666244, abs=PRINTED)
    assert all(r.distance > 0 for r in told.values())
    far, near = (RPS.reach(DEFAULT, posed(x, 0, 0, 0, QUARTER))[0] for x in (1300, 300))
    side = DEFAULT["R1"] - DEFAULT["r"]
    assert (far.reason, near.reason) == ("too far", "too close")
    assert far.distance == pytest.approx(1300 - math.hypot(1300, side), abs=1e-9)
    assert near.distance == pytest.approx(math.hypot(300, side) - 700, abs=1e-9)


@pytest.mark.parametrize("params", DESIGNS)
def test_margin_is_the_least_distance_to_a_strokes_end(params):
    """And >= 0 exactly where the strokes hold, in a box wider than what is reachable."""
    constants = ready(RPS, params, "direct")
    inside = []
    for pose in random_poses(RPS, params, 1500, margin=0.1):
        margin = RPS.kernel(*pose.values(), constants)[0]
        lengths = lengths_of(params, pose)
        assert margin == pytest.approx(min(min(v - 700, 1300 - v) for v in lengths), abs=1e-9)
        assert margin == pytest.approx(min(r.distance for r in RPS.reach(params, pose)), abs=1e-9)
        (solution,) = RPS.inverse(params, pose)
        inside.append(margin >= 0)
        assert inside[-1] == all(within(v, (700, 1300), "length") for v in solution.joints.values())
    assert 20 < sum(inside) < 1480


@pytest.mark.parametrize("name", JOINTS)
def test_margin_counts_each_limit_alone(name):
    """One joint limited, the others free: the margin is that joint's."""
    free = dict.fromkeys(JOINTS, (-math.inf, math.inf))
    for limits in ({**free, name: (900.0, 1000.0)}, {name: (900.0, 1000.0)}):
        constants = RPS.kernel_constants(DEFAULT, "direct", 1.0, limits)
        for pose in random_poses(RPS, DEFAULT, 100):
            length = dict(zip(JOINTS, lengths_of(DEFAULT, pose), strict=True))[name]
            margin = RPS.kernel(*pose.values(), constants)[0]
            assert margin == pytest.approx(min(length - 900, 1000 - length), abs=1e-9)


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize(
    "change", [{}, {"l1": (700, 900)}, {"l2": (900, 1000), "l5": (700, 800)}, {"l3": (700, 750)}]
)
def test_reach_box_cuts_nothing_off(params, change):
    """Poses drawn from a box far wider than the box, which is no looser than needed along y."""
    limits = {**RPS.default_limits(params), **change}
    lower, upper = RPS.reach_box(params, limits)
    assert (lower[2:] <= [-math.pi, -QUARTER, -math.pi]).all()
    assert (upper[2:] >= [math.pi, QUARTER, math.pi]).all()
    sampler = make_sampler(RPS, WorkspaceSettings(limits=change))
    wide = np.array([2500, 2500, math.pi, QUARTER, math.pi])
    poses = np.random.default_rng(6).uniform(-wide, wide, (400_000, 5)).T
    met = poses[:, sampler.evaluator.field(sampler.design(params), poses)[0] >= 0]
    assert met.shape[1] > 100
    assert (lower[:2] <= met.min(axis=1)[:2]).all()
    assert (met.max(axis=1)[:2] <= upper[:2]).all()


def test_nothing_is_reachable_where_strokes_contradict():
    lower, upper = RPS.reach_box(DEFAULT, {"l1": (100, 150), "l3": (100, 150)})
    assert (lower >= upper).any()


# --- assembly modes -----------------------------------------------------------------------


def regular(params, count, least, seed=1):
    """Return reachable (pose, solution) pairs of the domain that are off the singularities."""
    sampler = make_sampler(RPS, WorkspaceSettings())
    design = sampler.design(params)
    unit = np.random.default_rng(seed).random((5, 2000))
    poses = design.lower[:, None] + design.width[:, None] * unit
    pairs = []
    for values in poses[:, sampler.evaluator.field(design, poses)[0] >= 0].T:
        pose = posed(*values)
        if abs(measure(params, pose)) > least:
            pairs.append((pose, RPS.inverse(params, pose)[0]))
    return pairs[:count]


@pytest.mark.parametrize("params", DESIGNS)
def test_inverse_then_forward(params):
    """The pose comes back; every solution assembles, is another pose, nearest to home first."""
    pairs = regular(params, 6, 1e-3)
    assert len(pairs) == 6
    home = RPS.home(params)
    for pose, solution in pairs:
        found = RPS.forward(params, solution.joints)
        gaps = [max(abs(f.pose[k] - pose[k]) for k in pose) for f in found]
        assert min(gaps) < 1e-6
        places = []
        for one in found:
            assert tuple(one.pose) == NAMES
            assert one.residual < 1e-7
            assert abs(one.pose["beta"]) <= QUARTER
            assert all(-math.pi < one.pose[k] <= math.pi for k in ("alpha", "gamma"))
            np.testing.assert_allclose(
                lengths_of(params, one.pose), list(solution.joints.values()), rtol=0, atol=1e-7
            )
            rotation, centre, _ = place_of(params, one.pose)
            assert one.parasitic["z"] == pytest.approx(centre[2], abs=1e-9)
            places.append(np.hstack([rotation.ravel(), centre / 1000]))
        for i, one in enumerate(places):
            assert all(np.abs(one - other).max() > 1e-6 for other in places[:i])
        away = [
            math.hypot(
                f.pose["x"] - home["x"], f.pose["y"] - home["y"],
                *(params["r"] * math.remainder(f.pose[k] - home[k], 2 * math.pi)
                  for k in ("alpha", "beta", "gamma")),
            )
            for f in found
        ]  # fmt: skip
        assert away == pytest.approx(sorted(away), abs=1e-6)


def test_forward_mirrors_at_the_base():
    """x -> -x turns each assembly mode into another: half of them hang, half of them stand."""
    pose, solution = regular(DEFAULT, 1, 1e-3)[0]
    found = [f.pose["x"] for f in RPS.forward(DEFAULT, solution.joints)]
    assert sorted(x for x in found if x > 0) == pytest.approx(
        sorted(-x for x in found if x < 0), abs=1e-6
    )
    assert pose["x"] == pytest.approx(min(found, key=lambda x: abs(x - pose["x"])), abs=1e-6)


def test_forward_of_home_finds_home_first():
    for params in DESIGNS:
        home = RPS.home(params)
        first = RPS.forward(params, RPS.inverse(params, home)[0].joints)[0].pose
        assert first == pytest.approx(home, abs=1e-6)


def test_forward_finds_as_many_as_a_dense_search():
    """Assembly modes by least squares from 250 random poses: none is missed."""
    _, solution = regular(DEFAULT, 1, 1e-3, seed=5)[0]
    wanted = list(solution.joints.values())
    found = [place_of(DEFAULT, f.pose) for f in RPS.forward(DEFAULT, solution.joints)]

    def unscaled(u):
        return posed(1000 * u[0], 1000 * u[1], *u[2:])

    def residual(u):
        return np.subtract(lengths_of(DEFAULT, unscaled(u)), wanted) / 1000

    seen = set()
    for start in np.random.default_rng(7).uniform(-1, 1, (250, 5)) * [1.2, 0.6, 3.14, 1.57, 3.14]:
        end = least_squares(residual, start, xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=60)
        if np.abs(end.fun).max() > 1e-11:
            continue
        rotation, centre, _ = place_of(DEFAULT, unscaled(end.x))
        gaps = [max(np.abs(rotation - r).max(), np.abs(centre - p).max() / 1000)
                for r, p, _ in found]  # fmt: skip
        assert min(gaps) < 1e-5
        seen.add(int(np.argmin(gaps)))
    assert len(found) >= 4
    assert len(seen) >= 0.75 * len(found)


def test_forward_out_of_reach():
    assert RPS.forward(DEFAULT, {**dict.fromkeys(JOINTS, 900.0), "l1": 2500.0}) == ()


# --- velocities ---------------------------------------------------------------------------


@given(designs, poses)
def test_velocity_maps_equal_finite_differences(params, pose):
    j_x, j_q = RPS.velocity_maps(params, pose, RPS.inverse(params, pose)[0].joints)
    expected = slopes(lambda p: lengths_of(params, p), pose)
    tolerance = [1e-9, 1e-9, 1e-6, 1e-6, 1e-6]  # lengths over 300 mm and more, steps 0.5 mm, 1e-3
    assert (np.abs(np.linalg.solve(j_q, j_x) - expected) < 100 * np.array(tolerance)).all()


@given(designs, poses)
def test_full_map_tells_limb_rates_and_the_constraint(params, pose):
    """Fed with (v, omega) of each pose coordinate: rates of lengths, and S1 stays in its plane."""
    motion = slopes(lambda p: np.column_stack([*place_of(params, p)[:2]]), pose)
    rotation = rotation_of(pose)
    full = RPS.full_map(params, pose)
    rates = slopes(lambda p: lengths_of(params, p), pose)
    for k in range(5):
        spin = motion[:, :3, k] @ rotation.T
        omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        told = full @ np.concatenate([motion[:, 3, k], omega])
        np.testing.assert_allclose(told[:5], rates[:, k], rtol=0, atol=1e-4)
        assert abs(told[5]) < 1e-4


@given(designs, poses, st.sampled_from([1.0, 202.0, 37.0]))
def test_kernel_entries_are_the_homogenised_inverse_jacobian(params, pose, length):
    _, *entries = RPS.kernel(*pose.values(), ready(RPS, params, "direct", length))
    j_x, j_q = RPS.velocity_maps(params, pose, RPS.inverse(params, pose)[0].joints)
    inverse = np.linalg.solve(j_q, j_x) / [1.0, 1.0, length, length, length]
    found = np.reshape(entries, (5, 5))
    np.testing.assert_allclose(found, inverse, rtol=0, atol=1e-12 * np.abs(inverse).max())


@pytest.mark.parametrize("params", DESIGNS)
def test_layout_carries_the_platform_along(params):
    """Some motion of each limb's joints takes the platform to a pose some way off, exactly.

    The prismatic joint then has moved by what the inverse kinematics says.
    """
    here, there = posed(900, 30, 0.05, -0.08, 1.7), posed(940, -20, -0.09, 0.1, 1.52)
    (r0, p0), (r1, p1) = (RPS.platform(params, pose) for pose in (here, there))
    before, after = (RPS.inverse(params, p)[0].joints for p in (here, there))
    wanted = r1 @ r0.T
    for chain, limb in zip(RPS.layout(params, here), RPS.limbs, strict=True):
        assert chain.name == limb.name
        assert "".join(j.kind for j in chain.joints) == limb.joints
        freedoms = [(j, k) for j in chain.joints for k in range(len(screws(j)))]
        sizes = np.array([1000.0 if j.kind == "P" else 1.0 for j, _ in freedoms])

        def gap(values, chain=chain, sizes=sizes):
            rotation, shift = moved(chain, values * sizes)
            return np.hstack([(rotation - wanted).ravel(), (rotation @ p0 + shift - p1) / 1000])

        start = np.zeros(len(freedoms))
        end = least_squares(gap, start, xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.abs(end.fun).max() < 1e-10
        ((joint, number),) = [(j, j.drive[1]) for j in chain.joints if j.drive]
        at = next(i for i, (j, k) in enumerate(freedoms) if j is joint and k == number)
        name = joint.drive[0]
        assert end.x[at] * sizes[at] == pytest.approx(after[name] - before[name], abs=1e-6)


@pytest.mark.parametrize("params", DESIGNS)
def test_layout_and_skeleton_join_the_points(params):
    """Joints at T_k and S_k, U axes square to each other and to the limb; segments and cones."""
    base, home = feet(params), RPS.home(params)
    constants = ready(RPS, params, "direct")
    r_home, _, ends_home = place_of(params, home)
    for pose, _ in reachable(RPS, params, 6):
        r, centre, ends = place_of(params, pose)
        flat = np.array(RPS.skeleton(*pose.values(), constants))
        assert len(flat) == 12 + 6 * len(RPS.segments) + len(RPS.cones)
        segments = flat[12:72].reshape(10, 2, 3)
        cones = dict(zip(RPS.cones, flat[72:], strict=True))
        chains = RPS.layout(params, pose)
        for k in range(5):
            np.testing.assert_allclose(segments[k], [base[k], ends[k]], rtol=0, atol=1e-9)
            np.testing.assert_allclose(segments[5 + k], [centre, ends[k]], rtol=0, atol=1e-9)
            link, at_home = (e[k] - base[k] for e in (ends, ends_home))
            link, at_home = link / np.linalg.norm(link), at_home / np.linalg.norm(at_home)
            if k:
                assert cones[f"U_T{k + 1}"] == pytest.approx(link @ at_home, abs=1e-12)
            carried = r @ r_home.T @ at_home
            assert cones[f"S_S{k + 1}"] == pytest.approx(link @ carried, abs=1e-12)
            first, slide, last = chains[k].joints
            np.testing.assert_allclose([first.point, last.point], [base[k], ends[k]], atol=1e-9)
            np.testing.assert_allclose(slide.axes[0], link, atol=1e-12)
            assert slide.drive == (JOINTS[k], 0)
            if k == 0:
                np.testing.assert_array_equal(first.axes, [(0, 0, 1)])
                assert abs(link[2]) < 1e-12
                continue
            outer, inner = first.axes
            np.testing.assert_allclose([outer @ inner, inner @ link], 0, atol=1e-12)
            # In the base's plane, along its circle, at every pose.
            np.testing.assert_allclose([outer[0], outer @ base[k]], 0, atol=1e-9)


# --- singularities ------------------------------------------------------------------------


def six(params, pose):
    """Return the full map with its angular columns divided by r."""
    full = RPS.full_map(params, pose)
    full[:, 3:] /= params["r"]
    return full


def measure(params, pose):
    return RPS.singularity_measures(params, pose, {})["forward"]["platform"]


def on_trajectory(t, gamma):
    """Return the pose of section 3.1 at a time in seconds, with z from the constraint."""
    tilt = -math.pi / 36 + math.pi / 36 * t
    return posed(900 + 50 * math.cos(2 * t), 50 * math.sin(2 * t), tilt, tilt, gamma)


@given(st.floats(300, 1300), st.floats(-300, 300))
def test_level_poses_at_gamma_0_are_singular(x, y):
    values = np.linalg.svd(six(DEFAULT, posed(x, y, 0, 0, 0)), compute_uv=False)
    assert values[-1] < 1e-13 * values[0]
    assert abs(measure(DEFAULT, posed(x, y, 0, 0, 0))) < 1e-12


def test_home_is_regular():
    values = np.linalg.svd(six(DEFAULT, RPS.home(DEFAULT)), compute_uv=False)
    assert values[-1] == pytest.approx(0.07, abs=5e-3)


def test_the_papers_trajectory_crosses_a_singularity():
    """At t = 1 s, and nowhere else in 0 .. 2 s: the determinant changes sign there."""
    before, after = on_trajectory(0, 0), on_trajectory(2, 0)
    assert measure(DEFAULT, before) * measure(DEFAULT, after) < 0
    assert abs(measure(DEFAULT, on_trajectory(1, 0))) < 1e-12
    times = np.linspace(0, 2, 401)
    signs = np.sign([measure(DEFAULT, on_trajectory(t, 0)) for t in times if abs(t - 1) > 1e-9])
    assert (signs[:200] == signs[0]).all()
    assert (signs[200:] == -signs[0]).all()
    slow, fast = (1 - 1e-6, 1 + 1e-6)
    assert measure(DEFAULT, on_trajectory(slow, 0)) * measure(DEFAULT, on_trajectory(fast, 0)) < 0


def test_the_papers_trajectory_is_regular_at_the_home_it_describes():
    """gamma = pi/2: the smallest singular value stays above half of home's, 0.07."""
    for t in np.linspace(0, 2, 201):
        pose = on_trajectory(t, QUARTER)
        assert measure(DEFAULT, pose) * measure(DEFAULT, RPS.home(DEFAULT)) > 0
        assert np.linalg.svd(six(DEFAULT, pose), compute_uv=False)[-1] > 0.035


@given(designs, poses)
def test_measure_and_kernel_vanish_with_the_full_map(params, pose):
    """det J1 J2 is cos(beta) times the 6x6 determinant: one sign within the chart."""
    j_x, _ = RPS.velocity_maps(params, pose, {})
    full = RPS.full_map(params, pose)
    det = np.linalg.det(full)
    scale = np.prod(np.linalg.norm(full, axis=1))
    assert abs(np.linalg.det(j_x) - math.cos(pose["beta"]) * det) < 1e-11 * scale
    rows = np.linalg.norm(six(params, pose), axis=1)
    wanted = det / params["r"] ** 3 / np.prod(rows)
    found = RPS.singularity_measures(params, pose, {})
    assert found["forward"]["platform"] == pytest.approx(wanted, abs=1e-12)
    assert set(found) == {"inverse", "forward"}
    assert all(0 < v <= 1 for v in found["inverse"].values())
