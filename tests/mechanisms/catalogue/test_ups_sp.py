"""3-UPS/SP against its model, and against geometry written down a second time.

Paper: "Inverse Kinematics and Reachable Workspace of 3-UPS/SP Parallel Mechanism". It prints no
joint lengths: the numbers here are those of the model, to ten decimals.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from support.exponentials import moved, screws, turn
from support.poses import random_poses, reachable, ready

from pmopt.mechanisms import find
from pmopt.mechanisms.mechanism import within

SP = find("3-ups-sp")
DEFAULT = SP.resolve({})
DESIGNS = [DEFAULT, SP.resolve({"kite": 0.6, "twist": 0.6}), SP.resolve({"A": 50, "a": 30})]
PRINTED = 5e-11  # half a unit of the last printed digit

angles = st.floats(-1.5, 1.5)
designs = st.fixed_dictionaries(
    {
        "A": st.floats(25, 60),
        "a": st.floats(10, 40),
        "kite": st.floats(0.4, 1.0),
        "twist": st.floats(-0.8, 0.8),
    }
).map(SP.resolve)


def posed(*values):
    return dict(zip(("phi", "theta", "psi", "l4"), map(float, values), strict=True))


# No fixed_dictionaries: it shuffles keys, and kernels take coordinates in order.
poses = st.builds(posed, angles, angles, angles, st.floats(45, 90))

# --- the geometry a second time -----------------------------------------------------------


def rotation_of(pose):
    x, y, z = np.eye(3)
    return turn(z, pose["phi"]) @ turn(y, pose["theta"]) @ turn(x, pose["psi"])


def corners(params):
    """Return A_i and b_i: square, then the kite, then the twist about the square's centre."""
    signs = [(1, -1), (1, 1), (-1, 1), (-1, -1)]
    base = [np.array([params["A"] / 2 * x, params["A"] / 2 * y, 0]) for x, y in signs]
    end = [np.array([params["a"] / 2 * x, params["a"] / 2 * y, 0]) for x, y in signs]
    end[1] = end[3] + params["kite"] * (end[0] - end[3] + end[2] - end[3])
    return base, [turn((0, 0, 1), params["twist"]) @ b for b in end]


def ends_of(params, pose):
    """Return R, P and B_i."""
    base, end = corners(params)
    r = rotation_of(pose)
    centre = base[3] + r @ (np.array([0, 0, pose["l4"]]) - end[3])
    return r, centre, [centre + r @ b for b in end]


def lengths_of(params, pose):
    base, _ = corners(params)
    return [
        float(np.linalg.norm(b - a)) for a, b in zip(base, ends_of(params, pose)[2], strict=True)
    ]


def slopes(function, pose, step=1e-3):
    """Return derivatives by each pose coordinate, of fourth order."""
    columns = []
    for name in pose:
        total = 0.0
        for shift, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            moved = {**pose, name: pose[name] + shift * step}
            total = total + weight * np.array(function(moved)) / (12 * step)
        columns.append(total)
    return np.stack(columns, axis=-1)


# --- the model's numbers ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pose", "place", "lengths"),
    [
        ((0, 0, 0, 45), (-7.5, -7.5, 45), (47.4341649025, 49.7493718553, 47.4341649025, 45)),
        (
            (0.1, 0.2, -0.15, 60),
            (1.8014664744, 3.3852694264, 54.6924026984),
            (55.6911224861, 51.8554595858, 56.0795357517, 60),
        ),
    ],
)
def test_numbers_of_the_model(pose, place, lengths):
    pose = posed(*pose)
    assert SP.platform(DEFAULT, pose)[1] == pytest.approx(place, rel=0, abs=PRINTED)
    (solution,) = SP.inverse(DEFAULT, pose)
    assert solution.working_mode == "direct"
    assert list(solution.joints) == ["l1", "l2", "l3", "l4"]
    assert list(solution.joints.values()) == pytest.approx(lengths, rel=0, abs=PRINTED)


def test_declared_as_in_the_paper():
    """Section 4: a = 20, A = 35, limbs from 45 to 90 mm; square and untwisted."""
    assert DEFAULT == {"A": 35.0, "a": 20.0, "kite": 1.0, "twist": 0.0}
    assert SP.default_limits(DEFAULT) == dict.fromkeys(("l1", "l2", "l3", "l4"), (45.0, 90.0))
    assert [limb.joints for limb in SP.limbs] == ["UPS", "UPS", "UPS", "SP"]
    assert SP.characteristic_length(DEFAULT) == pytest.approx(
        np.linalg.norm(corners(DEFAULT)[1][0])
    )


def test_home_is_inside_and_regular_for_every_corner_of_the_bounds():
    for big in (25, 60):
        for small in (10, 40):
            for kite in (0.4, 1):
                for twist in (0, 0.8):
                    params = SP.resolve({"A": big, "a": small, "kite": kite, "twist": twist})
                    home = SP.home(params)
                    lengths = lengths_of(params, home)
                    assert all(45 < v < 90 for v in lengths)
    # Of the paper's squares home is regular, by little: 0.089 mm/rad beside 60.
    assert smallest(DEFAULT, SP.home(DEFAULT))[0] == pytest.approx(0.0889, abs=5e-5)


# --- positions ----------------------------------------------------------------------------


@given(designs, poses)
def test_inverse_and_platform_equal_the_geometry(params, pose):
    (solution,) = SP.inverse(params, pose)
    np.testing.assert_allclose(
        list(solution.joints.values()), lengths_of(params, pose), rtol=0, atol=1e-12 * 100
    )
    rotation, centre = SP.platform(params, pose)
    expected, place, _ = ends_of(params, pose)
    np.testing.assert_allclose(rotation, expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(centre, place, rtol=0, atol=1e-12)
    assert solution.joints["l4"] == pose["l4"]
    assert solution.parasitic == solution.passive == {}


@given(designs, poses)
def test_limb_4_is_the_platforms_normal(params, pose):
    """B4 lies l4 above A4 along the normal, whatever kite and twist."""
    rotation, centre = SP.platform(params, pose)
    base, end = corners(params)
    np.testing.assert_allclose(
        centre + rotation @ end[3] - base[3], pose["l4"] * rotation[:, 2], rtol=0, atol=1e-12
    )


def test_reach_tells_the_end_of_the_stroke():
    told = {r.limb: r for r in SP.reach(DEFAULT, posed(0, 0, 0, 45))}
    assert told["limb 4"].distance == pytest.approx(0, abs=1e-12)
    assert told["limb 2"].distance == pytest.approx(4.7493718553, abs=PRINTED)
    far, near = (SP.reach(DEFAULT, posed(0, 0, 0, l4))[3] for l4 in (97, 40))
    assert (far.reason, far.distance) == ("too far", -7)
    assert (near.reason, near.distance) == ("too close", -5)


@pytest.mark.parametrize("params", DESIGNS)
def test_margin_is_the_least_distance_to_a_strokes_end(params):
    """And >= 0 exactly where the strokes hold, in a box half as wide again."""
    constants = ready(SP, params, "direct")
    inside = []
    for pose in random_poses(SP, params, 600, margin=0.25):
        margin = SP.kernel(*pose.values(), constants)[0]
        lengths = lengths_of(params, pose)
        assert margin == pytest.approx(min(min(v - 45, 90 - v) for v in lengths), abs=1e-11)
        assert margin == pytest.approx(min(r.distance for r in SP.reach(params, pose)), abs=1e-11)
        (solution,) = SP.inverse(params, pose)
        inside.append(margin >= 0)
        assert inside[-1] == all(within(v, (45, 90), "length") for v in solution.joints.values())
    assert 20 < sum(inside) < 580


@pytest.mark.parametrize("name", ["l1", "l2", "l3", "l4"])
def test_margin_counts_each_limit_alone(name):
    """One joint limited, the others free: the margin is that joint's."""
    limits = dict.fromkeys(("l1", "l2", "l3", "l4"), (-math.inf, math.inf)) | {name: (55.0, 70.0)}
    for ends in (limits, {name: (55.0, 70.0)}):
        constants = SP.kernel_constants(DEFAULT, "direct", 1.0, ends)
        for pose in random_poses(SP, DEFAULT, 100):
            length = dict(zip(limits, lengths_of(DEFAULT, pose), strict=True))[name]
            margin = SP.kernel(*pose.values(), constants)[0]
            assert margin == pytest.approx(min(length - 55, 70 - length), abs=1e-11)


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize(
    "limits",
    [
        {"l1": (70, 72), "l2": (45, 90), "l3": (45, 90)},
        {"l2": (30, 50), "l3": (110, 120)},
        {"l4": (20, 130), "l1": (60, 62), "l2": (61, 63), "l3": (60, 65)},
    ],
)
def test_reach_box_cuts_nothing_off(params, limits):
    lower, upper = SP.reach_box(params, limits)
    assert (lower[:3] <= [-math.pi, -math.pi / 2, -math.pi]).all()
    assert (upper[:3] >= [math.pi, math.pi / 2, math.pi]).all()
    constants = SP.kernel_constants(params, "direct", 1.0, limits)
    rng = np.random.default_rng(4)
    met = []
    for values in rng.uniform([-3.14, -1.57, -3.14, 0], [3.14, 1.57, 3.14, 250], (20000, 4)):
        if SP.kernel(*values.tolist(), constants)[0] >= 0:
            met.append(values[3])
    if met:
        assert lower[3] <= min(met)
        assert max(met) <= upper[3]
    assert met or lower[3] >= upper[3] or len(limits) != 3


def test_nothing_is_reachable_where_strokes_contradict():
    """Limbs 1 and 4 differ by no more than both sides."""
    lower, upper = SP.reach_box(DEFAULT, {"l4": (45, 90), "l1": (200, 210)})
    assert lower[3] >= upper[3]


# --- assembly modes -----------------------------------------------------------------------


@pytest.mark.parametrize("params", DESIGNS)
def test_inverse_then_forward(params):
    """The pose comes back; every solution assembles, is another rotation, nearest to home first.

    Near singularities two assembly modes run together and are known to the root of rounding
    errors only: left out.
    """
    home = SP.home(params)
    checked = 0
    for pose, solution in reachable(SP, params, 14):
        if abs(SP.singularity_measures(params, pose, {})["forward"]["platform"]) < 1e-4:
            continue
        found = SP.forward(params, solution.joints)
        gaps = [max(abs(f.pose[k] - pose[k]) for k in pose) for f in found]
        assert min(gaps) < 1e-8
        for one in found:
            assert list(one.pose) == ["phi", "theta", "psi", "l4"]
            assert one.residual < 1e-7
            assert abs(one.pose["theta"]) <= math.pi / 2
            assert all(-math.pi < one.pose[k] <= math.pi for k in ("phi", "psi"))
            np.testing.assert_allclose(
                lengths_of(params, one.pose), list(solution.joints.values()), rtol=0, atol=1e-7
            )
        turns = [rotation_of(f.pose) for f in found]
        for i, one in enumerate(turns):
            assert all(np.abs(one - other).max() > 1e-5 for other in turns[:i])
        away = [
            math.hypot(*(math.remainder(f.pose[k] - home[k], 2 * math.pi)
                         for k in ("phi", "theta", "psi")))
            for f in found
        ]  # fmt: skip
        assert away == sorted(away)
        checked += 1
    assert checked >= 12


def test_forward_of_home_finds_home_first():
    for params in DESIGNS:
        home = SP.home(params)
        first = SP.forward(params, SP.inverse(params, home)[0].joints)[0].pose
        assert first == pytest.approx(home, abs=1e-9)


def test_forward_finds_as_many_as_a_dense_search():
    """Assembly modes by least squares from 150 random rotations: none is missed."""
    params = DESIGNS[1]
    rng = np.random.default_rng(7)
    (pose, solution), *_ = reachable(SP, params, 1, seed=3)
    wanted = list(solution.joints.values())[:3]
    found = [rotation_of(f.pose) for f in SP.forward(params, solution.joints)]

    def residual(x):
        return np.subtract(lengths_of(params, posed(*x, pose["l4"]))[:3], wanted)

    seen = set()
    for start in rng.uniform(-math.pi, math.pi, (150, 3)):
        end = least_squares(residual, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if np.abs(end.fun).max() > 1e-9:
            continue
        gaps = [np.abs(rotation_of(posed(*end.x, 0)) - r).max() for r in found]
        assert min(gaps) < 1e-5
        seen.add(int(np.argmin(gaps)))
    assert len(seen) == len(found) >= 4


def test_forward_out_of_reach():
    assert SP.forward(DEFAULT, {"l1": 200.0, "l2": 50.0, "l3": 50.0, "l4": 60.0}) == ()


# --- velocities ---------------------------------------------------------------------------


@given(designs, poses)
def test_velocity_maps_equal_finite_differences(params, pose):
    j_x, j_q = SP.velocity_maps(params, pose, SP.inverse(params, pose)[0].joints)
    expected = slopes(lambda p: lengths_of(params, p), pose)
    np.testing.assert_allclose(np.linalg.solve(j_q, j_x), expected, rtol=0, atol=1e-8)


@given(designs, poses, st.sampled_from([1.0, 14.1, 0.37]))
def test_kernel_entries_are_the_homogenised_inverse_jacobian(params, pose, length):
    _, *entries = SP.kernel(*pose.values(), ready(SP, params, "direct", length))
    j_x, j_q = SP.velocity_maps(params, pose, SP.inverse(params, pose)[0].joints)
    inverse = np.linalg.solve(j_q, j_x) / [length, length, length, 1.0]
    np.testing.assert_allclose(np.reshape(entries, (4, 4)), inverse, rtol=0, atol=1e-11 * 90)


@pytest.mark.parametrize("params", DESIGNS[:2])
def test_layout_carries_the_platform_along(params):
    """Some motion of each limb's joints takes the platform to a pose 0.15 rad away, exactly.

    The prismatic joint then has moved by what the inverse kinematics says.
    """
    there = posed(0.17, 0.09, -0.21, 64.0)
    here = SP.home(params)
    (r0, p0), (r1, p1) = (SP.platform(params, pose) for pose in (here, there))
    before, after = (SP.inverse(params, p)[0].joints for p in (here, there))
    wanted = r1 @ r0.T
    for chain, limb in zip(SP.layout(params, here), SP.limbs, strict=True):
        assert chain.name == limb.name
        assert "".join(j.kind for j in chain.joints) == limb.joints
        freedoms = [(j, k) for j in chain.joints for k in range(len(screws(j)))]

        def gap(values, chain=chain):
            rotation, shift = moved(chain, values)
            return np.concatenate([(rotation - wanted).ravel(), (rotation @ p0 + shift - p1) / 60])

        start = np.zeros(len(freedoms))
        end = least_squares(gap, start, xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale="jac")
        assert np.abs(end.fun).max() < 1e-10
        ((joint, number),) = [(j, j.drive[1]) for j in chain.joints if j.drive]
        slid = end.x[next(i for i, (j, k) in enumerate(freedoms) if j is joint and k == number)]
        name = joint.drive[0]
        assert slid == pytest.approx(after[name] - before[name], abs=1e-8)


@pytest.mark.parametrize("params", DESIGNS)
def test_layout_and_skeleton_join_the_corners(params):
    """Joints at A_i and B_i, U axes square to each other and to the limb; segments and cones."""
    base, _ = corners(params)
    constants = ready(SP, params, "direct")
    home = SP.home(params)
    r_home, _, ends_home = ends_of(params, home)
    for pose, _ in reachable(SP, params, 8):
        r, centre, ends = ends_of(params, pose)
        flat = np.array(SP.skeleton(*pose.values(), constants))
        assert len(flat) == 12 + 6 * len(SP.segments) + len(SP.cones)
        segments = flat[12:60].reshape(8, 2, 3)
        for i in range(4):
            np.testing.assert_allclose(segments[i], [base[i], ends[i]], rtol=0, atol=1e-12 * 100)
            np.testing.assert_allclose(segments[4 + i], [centre, ends[i]], rtol=0, atol=1e-10)
        cones = dict(zip(SP.cones, flat[60:], strict=True))
        for i in range(4):
            link, at_home = (e[i] - base[i] for e in (ends, ends_home))
            link, at_home = link / np.linalg.norm(link), at_home / np.linalg.norm(at_home)
            if i == 3:  # the platform is rigid on the post: its S is in the base
                assert cones["S_A4"] == pytest.approx(link @ at_home, abs=1e-12)
                continue
            assert cones[f"U_A{i + 1}"] == pytest.approx(link @ at_home, abs=1e-12)
            carried = r @ r_home.T @ at_home
            assert cones[f"S_B{i + 1}"] == pytest.approx(link @ carried, abs=1e-12)
        for i, chain in enumerate(SP.layout(params, pose)[:3]):
            u, p, s = chain.joints
            np.testing.assert_allclose([u.point, s.point], [base[i], ends[i]], atol=1e-10)
            along = (ends[i] - base[i]) / np.linalg.norm(ends[i] - base[i])
            np.testing.assert_allclose(p.axes[0], along, atol=1e-12)
            first, second = u.axes
            np.testing.assert_allclose([first @ second, second @ along], 0, atol=1e-12)
            # In the base's plane, along the circle through its corners, at every pose.
            np.testing.assert_allclose([first[2], first @ base[i]], 0, atol=1e-10)


# --- singularities ------------------------------------------------------------------------


def smallest(params, pose):
    """Return the smallest singular value of the 4x4 map in mm/rad, and its largest."""
    values = np.linalg.svd(SP.velocity_maps(params, pose, {})[0], compute_uv=False)
    return values[-1], values[0]


@given(
    st.floats(25, 60), st.floats(10, 40), st.floats(-3, 3), st.floats(45, 90), st.floats(-0.8, 0.8)
)
def test_every_level_pose_of_squares_is_singular(big, small, phi, l4, twist):
    """The paper finds none. Row 2 is the sum of rows 1 and 3, each times its length."""
    params = SP.resolve({"A": big, "a": small, "twist": twist})
    pose = posed(phi, 0, 0, l4)
    least, most = smallest(params, pose)
    assert least < 1e-13 * most
    assert abs(SP.singularity_measures(params, pose, {})["forward"]["platform"]) < 1e-12
    lengths = np.array(lengths_of(params, pose))[:3, None]
    one, two, three = SP.velocity_maps(params, pose, {})[0][:3, :3] * lengths
    np.testing.assert_allclose(two, one + three, rtol=0, atol=1e-9)


@pytest.mark.parametrize("phi", [-0.3, 0.3])
def test_kite_leaves_level_poses_regular(phi):
    params = SP.resolve({"kite": 0.6})
    assert smallest(params, posed(phi, 0, 0, 60))[0] == pytest.approx(0.91, abs=5e-3)


@given(st.floats(0.4, 0.9), st.floats(0, 0.8), st.floats(45, 90))
def test_kite_leaves_one_wall_and_twist_moves_it(kite, twist, l4):
    """At phi + twist = 0, where the determinant changes sign."""
    params = SP.resolve({"kite": kite, "twist": twist})

    def measure(phi):
        return SP.singularity_measures(params, posed(phi, 0, 0, l4), {})["forward"]["platform"]

    assert abs(measure(-twist)) < 1e-12
    assert smallest(params, posed(-twist, 0, 0, l4))[0] < 1e-11
    assert measure(-twist - 0.05) * measure(-twist + 0.05) < 0
    same = [math.copysign(1, measure(phi - twist)) for phi in (0.05, 0.3, 1.0, 1.5)]
    assert len(set(same)) == 1


def test_kite_and_twist_together_leave_home_and_assembly_regular():
    params = SP.resolve({"kite": 0.6, "twist": 0.6})
    for pose in (SP.home(params), posed(0, 0, 0, 45), posed(0, 0, 0, 60)):
        assert smallest(params, pose)[0] > 0.5


@given(designs, poses)
def test_measure_is_the_determinant_of_the_velocity_map(params, pose):
    """Up to |s_i| and the chart's own -cos(theta); one that cannot vanish within the domain."""
    det = np.linalg.det(SP.velocity_maps(params, pose, {})[0])
    base, _ = corners(params)
    reaches = [np.linalg.norm(end - base[3]) for end in ends_of(params, pose)[2][:3]]
    found = SP.singularity_measures(params, pose, {})
    wanted = -det / (math.cos(pose["theta"]) * np.prod(reaches))
    assert found["forward"]["platform"] == pytest.approx(wanted, abs=1e-10)
    assert set(found) == {"inverse", "forward"}
    assert abs(found["forward"]["platform"]) <= 1
    assert all(0 < v <= 1 for v in found["inverse"].values())
