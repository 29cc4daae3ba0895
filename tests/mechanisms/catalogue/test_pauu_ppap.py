"""2PaUU-PPaP against its paper and against independent geometry.

Paper: "Kinematic Analysis and Multi-objective Scale Synthesis of Low Coupling 2PaUU-PPaP
Parallel Mechanism".
"""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from support import naive

from pmopt.analysis.kinematics.forward import forward_kinematics
from pmopt.analysis.kinematics.inverse import inverse_kinematics
from pmopt.analysis.kinematics.jacobian import jacobian_at
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms import find
from pmopt.mechanisms.mechanism import within, wrap_angle

PAUU = find("2pauu-ppap")
MODES = list(naive.SIDES)
ROUNDING = 5e-5  # of the paper's four printed decimals

# --- tables 2 and 3 -----------------------------------------------------------------------

# Section 3. The tables' crank pivots lie at 0.2 m where the text says c = 0.1 m: z = 2c.
PAPER = PAUU.resolve({"m": 1, "n": 0.5, "l1": 0.6, "l2": 1.2, "c": 0.1})
POSE = {"x": -0.9165, "y": -0.5846, "z": 0.8792}
TABLE_2 = [
    (-3.1033, -2.6997, -0.5846),
    (-2.2855, -2.6997, -0.5846),
    (-3.1033, 0.6583, -0.5846),
    (-2.2855, 0.6583, -0.5846),
]
# Rows 1 and 3 are the assembly modes table 2 does not have; rows 2 and 4 repeat the pose of
# table 2, printed with four wrong cells (y twice, theta1 and theta2), here mended.
TABLE_3 = [
    ((-3.1033, -2.6997, -0.5846), (0.8593, -0.5846, -0.1998)),
    ((-3.1033, -2.6997, -0.5846), (-0.9165, -0.5846, 0.8792)),
    ((-3.1033, 0.6583, -0.5846), (-0.1576, -0.5846, -0.8234)),
    ((-3.1033, 0.6583, -0.5846), (-0.9165, -0.5846, 0.8792)),
]


def named(coordinates, values):
    return {c.name: v for c, v in zip(coordinates, values, strict=True)}


def print_error(matrix):
    """Return the largest effect of rounded input through ``matrix``, plus rounded output."""
    return np.abs(matrix).sum(axis=1) * ROUNDING + ROUNDING


def joint_gap(a, b):
    return np.array(
        [
            naive.angle_gap(a["theta1"], b["theta1"]),
            naive.angle_gap(a["theta2"], b["theta2"]),
            abs(a["d"] - b["d"]),
        ]
    )


def closest(solutions, wanted):
    return min((joint_gap(s.joints, wanted) for s in solutions), key=np.max)


@pytest.mark.parametrize("row", TABLE_2)
def test_table_2(row):
    """Each printed row is a branch, to the rounding of X and of the joints themselves."""
    wanted = named(PAUU.joints, row)
    j_x, j_q = naive.velocity_maps(PAPER, POSE, wanted)
    bound = print_error(np.linalg.solve(j_q, j_x))
    assert bound.max() < 5e-4
    assert (closest(PAUU.inverse(PAPER, POSE), wanted) <= bound).all()


def test_computed_joints_of_table_2():
    """What the printed X gives when solved to more digits than the paper prints."""
    branches = {s.working_mode: s.joints for s in PAUU.inverse(PAPER, POSE)}
    assert list(branches) == MODES
    assert {round(b["theta1"], 5) for b in branches.values()} == {-3.10359, -2.28539}
    assert {round(b["theta2"], 5) for b in branches.values()} == {-2.69993, 0.65851}
    assert {b["d"] for b in branches.values()} == {-0.5846}
    assert len({tuple(b.values()) for b in branches.values()}) == 4


@pytest.mark.parametrize(("row", "pose"), TABLE_3)
def test_table_3(row, pose):
    """Both assembly modes, to the rounding of the printed joints and of the pose itself."""
    joints = named(PAUU.joints, row)
    j_x, j_q = naive.velocity_maps(PAPER, named(PAUU.pose, pose), joints)
    bound = print_error(np.linalg.solve(j_x, j_q))
    assert bound.max() < 5e-4
    solutions = PAUU.forward(PAPER, joints)
    assert len(solutions) == 2
    gaps = [np.abs(np.subtract(list(s.pose.values()), pose)) for s in solutions]
    assert (min(gaps, key=np.max) <= bound).all()


def test_offset_is_twice_c():
    """With the pivots at z = c = 0.1, as the text has it, no branch fits table 2."""
    as_printed = {**PAPER, "c": 0.05}
    for row in TABLE_2:
        assert closest(PAUU.inverse(as_printed, POSE), named(PAUU.joints, row)).max() > 0.05


def test_defaults_and_bounds_of_the_paper():
    """Sections 5.1 and 6.2."""
    assert PAUU.resolve({}) == {"m": 1, "n": 0.7, "l1": 0.65, "l2": 1.5, "c": 0.1, "h": None}
    assert {p.name: p.bounds for p in PAUU.parameters} == {
        "m": (0.5, 1.5),
        "n": (0.2, 1),
        "l1": (0.5, 1.5),
        "l2": (0.5, 1.5),
        "c": (0.1, 0.5),
        "h": None,
    }


# --- random designs and poses -------------------------------------------------------------


@st.composite
def designs(draw):
    """Draw designs in and around the paper's bounds: l1 > l2, m < n and c = 0 among them."""
    given = {
        "m": draw(st.floats(0.3, 1.6)),
        "n": draw(st.floats(0.2, 1.2)),
        "l1": draw(st.floats(0.3, 1.6)),
        "l2": draw(st.floats(0.3, 1.6)),
        "c": draw(st.just(0.0) | st.floats(0.01, 0.5)),
    }
    assume(abs(given["m"] - given["n"]) < 0.9 * (given["l1"] + given["l2"]))
    return PAUU.resolve(given)


def reachable_poses(params, seed, count=1):
    """Return random poses with solutions, found without the package's own box."""
    rng = np.random.default_rng(seed)
    size = params["l1"] + params["l2"]
    found = []
    while len(found) < count:
        x, y, z = rng.uniform(-size, size, 3)
        pose = {"x": x, "y": y, "z": z + 2 * params["c"]}
        if naive.inverse(params, pose):
            found.append(pose)
    return found


def clearance(params, pose):
    return min(r.distance for r in PAUU.reach(params, pose))


seeds = st.integers(0, 2**32 - 1)
angles = st.floats(-math.pi, math.pi)
DEFAULT = PAUU.resolve({})


@given(designs(), seeds)
@example(PAUU.resolve({"l1": 1.5, "l2": 0.5, "m": 0.5, "n": 1.0, "c": 0}), 1)
def test_inverse_equals_trigonometry(params, seed):
    """Every working mode by name: out is the knee outwards (s = -1), in the knee inwards."""
    for pose in reachable_poses(params, seed, 5):
        expected = naive.inverse(params, pose)
        # The angle moves with the root of the distance to the surface, where arccos is steep.
        tolerance = 1e-14 / math.sqrt(max(clearance(params, pose), 1e-12)) + 1e-12
        found = PAUU.inverse(params, pose)
        assert [s.working_mode for s in found] == MODES
        for solution in found:
            assert (joint_gap(solution.joints, expected[solution.working_mode]) < tolerance).all()
            assert -math.pi < solution.joints["theta1"] <= math.pi
            assert -math.pi < solution.joints["theta2"] <= math.pi
            assert solution.parasitic == {}


@given(designs(), seeds)
def test_inverse_then_forward(params, seed):
    for pose in reachable_poses(params, seed, 5):
        for solution in PAUU.inverse(params, pose):
            assert naive.residual(params, pose, solution.joints) < 1e-12
            det = PAUU.singularity_measures(params, pose, solution.joints)["forward"]["platform"]
            if abs(det) < 1e-6:  # a type II singularity: the pose is not determined
                continue
            tolerance = 1e-12 / abs(det)
            gaps = [
                max(abs(f.pose[k] - pose[k]) for k in pose)
                for f in PAUU.forward(params, solution.joints)
            ]
            assert len(gaps) == 2
            assert min(gaps) < tolerance


@given(designs(), angles, angles, st.floats(-1, 1))
def test_forward_then_inverse(params, theta1, theta2, slide):
    joints = {"theta1": theta1, "theta2": theta2, "d": slide * params["l2"]}
    c1, c2 = naive.knees(params, joints)
    apart = np.hypot(c1[0] - c2[0] - 2 * params["n"], c1[2] - c2[2]) / 2
    spare = params["l2"] ** 2 - joints["d"] ** 2 - apart**2
    assume(abs(spare) > 1e-6 and apart > 1e-3)
    solutions = PAUU.forward(params, joints)
    assert len(solutions) == (2 if spare > 0 else 0)
    if solutions:
        first, second = (np.array(list(s.pose.values())) for s in solutions)
        assert np.linalg.norm(first - second) == pytest.approx(2 * math.sqrt(spare), rel=1e-6)
    for solution in solutions:
        assert solution.residual < 1e-12
        assert naive.residual(params, solution.pose, joints) < 1e-12
        distance = clearance(params, solution.pose)
        # Cranks cannot leave the reachable set; near its surface branches run together.
        assert distance > -1e-12
        tolerance = 1e-12 / math.sqrt(max(distance, 1e-10))
        assert closest(PAUU.inverse(params, solution.pose), joints).max() < tolerance


def test_forward_out_of_reach():
    assert PAUU.forward(DEFAULT, {"theta1": 0.3, "theta2": -0.2, "d": 1.6}) == ()
    joints = {"theta1": -math.pi / 2, "theta2": -math.pi / 2, "d": math.sqrt(1.6**2 - 0.3**2)}
    with pytest.raises(UnreachableError, match=r"1\.6 m long, 0\.1 m more than l2 = 1\.5 m"):
        forward_kinematics(PAUU, {}, joints)


@pytest.mark.parametrize(
    ("given", "theta"),
    [
        ({"m": 1.0, "n": 0.5, "l1": 0.5}, math.pi),
        ({"m": 0.7, "n": 0.7}, math.pi / 2),  # but for a rounding error
    ],
)
def test_forward_where_every_pose_of_a_circle_fits(given, theta):
    """The crank ends coincide as seen from the platform."""
    with pytest.raises(InputError, match="forward singularity"):
        PAUU.forward(PAUU.resolve(given), {"theta1": theta, "theta2": theta, "d": 0.0})


@given(designs(), seeds)
def test_velocity_maps_equal_the_oracle(params, seed):
    (pose,) = reachable_poses(params, seed)
    for solution in PAUU.inverse(params, pose):
        found = PAUU.velocity_maps(params, pose, solution.joints)
        for matrix, expected in zip(
            found, naive.velocity_maps(params, pose, solution.joints), strict=True
        ):
            np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-14)


@given(designs(), seeds)
def test_jacobian_equals_finite_differences(params, seed):
    """J = J_X^-1 J_q against central differences of the forward kinematics."""
    (pose,) = reachable_poses(params, seed)
    for solution in PAUU.inverse(params, pose):
        joints = solution.joints
        det = PAUU.singularity_measures(params, pose, joints)["forward"]["platform"]
        if abs(det) < 0.05:  # the step must be small beside the distance to the singularity
            continue
        jacobian = np.linalg.solve(*PAUU.velocity_maps(params, pose, joints))
        step = 1e-4 * det**2
        for column, name in enumerate(joints):
            slope = np.zeros(3)
            for shift, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
                moved = {**joints, name: joints[name] + shift * step}
                poses = [list(f.pose.values()) for f in PAUU.forward(params, moved)]
                nearest = min(poses, key=lambda p: math.dist(p, pose.values()))
                slope += weight * np.array(nearest) / (12 * step)
            # Rounding eps / det / step; truncation, of fourth order, stays below it.
            tolerance = 1e-10 / abs(det) ** 3
            np.testing.assert_allclose(jacobian[:, column], slope, rtol=0, atol=tolerance)


@given(designs(), angles, angles)
def test_stretched_and_folded_limbs_are_type_1_singular(params, turn, tube):
    """Crank and link in one plane with the axis: u.e = 0 and the branches meet."""
    radius = params["l1"] + params["l2"] * math.cos(tube)
    pose = {
        "x": params["m"] - params["n"] - radius * math.cos(turn),
        "y": params["l2"] * math.sin(tube),
        "z": 2 * params["c"] + radius * math.sin(turn),
    }
    other = PAUU.reach(params, pose)[1]
    assume(abs(radius) > 1e-3 and other.distance > 1e-3)
    assert abs(PAUU.reach(params, pose)[0].distance) < 1e-14
    out, inside = PAUU.inverse(params, pose)[0], PAUU.inverse(params, pose)[3]
    # The root of rounding errors is left of what vanishes.
    assert naive.angle_gap(out.joints["theta1"], inside.joints["theta1"]) < 1e-6
    for solution in (out, inside):
        assert naive.residual(params, pose, solution.joints) < 1e-7
        measures = PAUU.singularity_measures(params, pose, solution.joints)["inverse"]
        assert abs(measures["limb 1"]) < 1e-6
        assert abs(measures["limb 2"]) > 1e-3
    constants = PAUU.kernel_constants(params, "out-out", 1.0, {})
    margin, *entries = PAUU.kernel(*pose.values(), constants)
    assert abs(margin) < 1e-12
    assert naive.inverse_condition(np.reshape(entries, (3, 3))) < 1e-5


def test_jacobian_at_singular_poses_is_an_answer():
    """A stretched limb (type I) and aligned links (type II): no J, index 0, and why."""
    stretched = {"x": 0.3, "y": 0.0, "z": 0.2 + math.sqrt((0.65 + 1.5) ** 2 - (0.3 + 0.3) ** 2)}
    result = jacobian_at(PAUU, {}, stretched)
    assert result.jacobian is None
    assert result.singular_values is None
    assert result.lci == result.lci_raw == result.lci_homogenized == 0
    assert result.singular == ("type 1, limb 2",)
    apart = DEFAULT["m"] - DEFAULT["n"] + 0.65 * math.cos(0.5)
    joints = {"theta1": 0.5, "theta2": 0.5, "d": math.sqrt(1.5**2 - apart**2)}
    pose = PAUU.forward(DEFAULT, joints)[0].pose
    modes = {s.working_mode: s.joints for s in PAUU.inverse(DEFAULT, pose)}
    mode = min(modes, key=lambda k: joint_gap(modes[k], joints).max())
    # The pose is known to the root of rounding errors only, hence the wide measure.
    assert abs(jacobian_at(PAUU, {}, pose, mode).forward_measure["platform"]) < 1e-7
    regular = jacobian_at(PAUU, {}, {"x": 0.1, "y": 0.2, "z": 1.3})
    assert regular.singular == ()
    assert regular.singular_values[-1] / regular.singular_values[0] == pytest.approx(regular.lci)


@given(designs(), seeds)
def test_sign_of_the_type_1_determinant_is_the_working_mode(params, seed):
    """u_i.e_i has the sign s_i of the root: - for out, + for in; it never changes within a mode."""
    (pose,) = reachable_poses(params, seed)
    assume(clearance(params, pose) > 1e-6)
    for solution in PAUU.inverse(params, pose):
        measures = PAUU.singularity_measures(params, pose, solution.joints)["inverse"]
        for value, knee in zip(measures.values(), solution.working_mode.split("-"), strict=True):
            assert (value > 0) == (knee == "in")
            assert abs(value) <= 1


@given(designs(), angles, angles, st.floats(0, 0.95))
def test_type_2_determinant(params, theta1, theta2, slide):
    """u1x u2z - u1z u2x is the area the two links span as seen along y; 0 where they align."""
    joints = {"theta1": theta1, "theta2": theta2, "d": slide * params["l2"]}
    c1, c2 = naive.knees(params, joints)
    base = np.hypot(c1[0] - c2[0] - 2 * params["n"], c1[2] - c2[2])
    spare = params["l2"] ** 2 - joints["d"] ** 2 - base**2 / 4
    assume(base > 1e-3 and spare > 1e-6)
    above, below = PAUU.forward(params, joints)
    for solution, sign in ((above, 1), (below, -1)):
        value = PAUU.singularity_measures(params, solution.pose, joints)["forward"]["platform"]
        area = base * math.sqrt(spare)
        assert abs(value) * params["l2"] ** 2 == pytest.approx(area, rel=1e-9)
        j_x, _ = naive.velocity_maps(params, solution.pose, joints)
        assert abs(np.linalg.det(j_x)) == pytest.approx(area, rel=1e-9)
        assert sign * value * (c1[0] - c2[0] - 2 * params["n"]) <= 0
    # The slide at which both assembly modes meet.
    joints["d"] = math.sqrt(params["l2"] ** 2 - base**2 / 4)
    for solution in PAUU.forward(params, joints):
        value = PAUU.singularity_measures(params, solution.pose, joints)["forward"]["platform"]
        assert abs(value) < 1e-6


# --- reach --------------------------------------------------------------------------------


@given(designs(), seeds)
def test_reach_is_the_distance_to_the_surface(params, seed):
    rng = np.random.default_rng(seed)
    size = params["l1"] + params["l2"]
    x, y, z = rng.uniform(-1.5 * size, 1.5 * size, 3)
    pose = {"x": x, "y": y, "z": z}
    sights = naive.lines_of_sight(params, pose)
    shadow = naive.link_shadow(params, pose)
    shift = params["m"] - params["n"]
    for i, (limb, a) in enumerate(
        zip(PAUU.reach(params, pose), (shift - x, shift + x), strict=True)
    ):
        distance = naive.surface_distance(params, a, y, z - 2 * params["c"])
        assert abs(limb.distance) == pytest.approx(distance, abs=1e-8)
        r = sights[i][0]
        inside = shadow is not None and abs(params["l1"] - shadow) <= r <= params["l1"] + shadow
        assert (limb.distance >= 0) == inside
    assert bool(PAUU.inverse(params, pose)) == all(
        r.distance >= 0 for r in PAUU.reach(params, pose)
    )


@pytest.mark.parametrize(
    ("given", "pose", "reason", "miss"),
    [
        ({}, {"x": 3.0, "y": 0.0, "z": 0.2}, "too far", 3.3 - 0.65 - 1.5),
        ({}, {"x": 0.0, "y": 0.0, "z": 0.5}, "too close", 1.5 - 0.65 - math.hypot(0.3, 0.3)),
        ({"l1": 1.5, "l2": 0.5}, {"x": 0.0, "y": 0.0, "z": 0.5}, "too close",
         1.5 - 0.5 - math.hypot(0.3, 0.3)),
        pytest.param(
            {}, {"x": 0.0, "y": 3.0, "z": 0.5}, "too far",
            math.hypot(math.hypot(0.3, 0.3) - 0.65, 3.0) - 1.5,
        ),
    ],
)  # fmt: skip
def test_out_of_reach_names_limb_reason_and_miss(given, pose, reason, miss):
    worst = min(PAUU.reach(PAUU.resolve(given), pose), key=lambda r: r.distance)
    assert worst.distance == pytest.approx(-miss, abs=1e-12)
    with pytest.raises(UnreachableError) as caught:
        inverse_kinematics(PAUU, given, pose)
    assert f"{worst.limb} misses by {miss:.6g} m ({reason})" in str(caught.value)


# --- box ----------------------------------------------------------------------------------


def box_of_samples(params, limits=None, count=400_000):
    """Return the extent of random reachable poses, and of the box they were sought in."""
    rng = np.random.default_rng(3)
    size = params["l1"] + params["l2"]
    x, y, z = rng.uniform(-size, size, (3, count))
    shift = params["m"] - params["n"]
    square = params["l2"] ** 2 - y**2
    shadow = np.sqrt(np.maximum(square, 0))
    inside = square >= 0
    for side in (-1, 1):
        r = np.hypot(x + side * shift, z)
        inside &= (r <= params["l1"] + shadow) & (r >= np.abs(params["l1"] - shadow))
    z = z + 2 * params["c"]
    if params["h"] is not None:
        inside &= z <= params["h"]
    low, high = (limits or {}).get("d", (-math.inf, math.inf))
    inside &= (y >= low) & (y <= high)
    poses = np.stack([x, y, z])[:, inside]
    return poses.min(axis=1), poses.max(axis=1)


TIGHT = [
    {},
    {"m": 0.8, "n": 0.8, "l1": 1.0, "l2": 0.6},
    {"m": 0.6, "n": 1.0, "l1": 0.7, "l2": 0.7, "c": 0},
    {"m": 1.5, "n": 0.2, "l1": 0.8, "l2": 0.9},
    {"h": 1.1},
]


def assert_tight(params, limits=None):
    lower, upper = PAUU.reach_box(params, limits or {})
    least, most = box_of_samples(params, limits)
    assert (least >= lower).all()
    assert (most <= upper).all()
    # A corner of the set fills a cap of height t only as t^2 or t^(5/2): 400,000 points leave
    # some 4 % of the width empty. A face that is off by more goes red.
    slack = 0.05 * (upper - lower)
    assert (least <= lower + slack).all()
    assert (most >= upper - slack).all()


@pytest.mark.parametrize("given", TIGHT)
def test_reach_box_is_tight(given):
    assert_tight(PAUU.resolve(given))


def test_reach_box_is_tight_where_holes_cut_it():
    """There |x| <= l1 l2 / |m - n|: 0.75, the box has l1 + l2 - |m - n| = 0.85."""
    assert_tight(PAUU.resolve({"m": 1.5, "n": 0.2, "l1": 0.65, "l2": 1.5}))


@pytest.mark.parametrize("given", [*TIGHT, {"m": 1.5, "n": 0.2, "l1": 0.65, "l2": 1.5}])
def test_extreme_poses_touch_the_box(given):
    """At the ends of y and z both limbs are at a singular surface, and none lies beyond."""
    params = PAUU.resolve({**given, "h": None})
    lower, upper = PAUU.reach_box(params, {})
    shift = abs(params["m"] - params["n"])
    b = math.sqrt(max(params["l1"] ** 2 - shift**2, 0))
    top = {"x": 0, "y": 0, "z": upper[2]}
    side = {"x": 0, "y": upper[1], "z": 2 * params["c"] + b}
    for pose in (top, side):
        for limb in PAUU.reach(params, pose):
            assert limb.distance == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(lower[:2], -upper[:2])
    assert upper[2] - 2 * params["c"] == pytest.approx(2 * params["c"] - lower[2])
    # At the end of x a limb is stretched, level with the cranks unless a hole cuts x there.
    reach2 = (params["l1"] + params["l2"]) ** 2
    rise = math.sqrt(max(reach2 - (shift + upper[0]) ** 2, 0))
    end = {"x": upper[0], "y": 0, "z": 2 * params["c"] + rise}
    for limb in PAUU.reach(params, end):
        assert limb.distance >= -1e-12
    assert max(naive.lines_of_sight(params, end))[0] == pytest.approx(params["l1"] + params["l2"])


def test_reach_box_with_limits():
    """h cuts z, the slider's limits cut y; both faces are reached."""
    params = PAUU.resolve({"h": 1.0})
    limits = {"d": (-0.4, 0.9), "theta1": (-1.0, 1.0)}
    lower, upper = PAUU.reach_box(params, limits)
    assert upper[2] == 1.0
    assert (lower[1], upper[1]) == (-0.4, 0.9)
    assert_tight(params, {"d": limits["d"]})
    whole_lower, whole_upper = PAUU.reach_box(PAUU.resolve({}), {})
    wide = PAUU.reach_box(PAUU.resolve({"h": 99.0}), {"d": (-9.0, 9.0)})
    assert (wide[0] == whole_lower).all()
    assert (wide[1] == whole_upper).all()


@pytest.mark.parametrize(
    "given",
    [{"m": 1.5, "n": 0.2, "l1": 0.5, "l2": 0.5}, {"m": 0.2, "n": 2.0, "l1": 0.5, "l2": 0.5}],
)
def test_reach_box_of_nothing_is_empty(given):
    """The limbs' reaches do not overlap where |m - n| > l1 + l2."""
    lower, upper = PAUU.reach_box(PAUU.resolve(given), {})
    assert not (upper > lower).all()


# --- limits -------------------------------------------------------------------------------


@given(angles, angles, st.floats(0.01, 6.2) | st.floats(6.4, 12), st.sampled_from([-1, 0, 2]))
def test_angle_limits_count_modulo_a_turn(value, low, size, turns):
    offset = (value - low) % (2 * math.pi)
    assume(min(abs(offset - size), abs(offset), abs(offset - 2 * math.pi)) > 1e-6)
    limits = (low, low + size)
    assert within(value + 2 * math.pi * turns, limits, "angle") == (offset <= size)


arcs = st.tuples(angles, st.floats(0.3, 6.2) | st.floats(6.4, 9))


@given(designs(), seeds, arcs, arcs, st.floats(-1, 0), st.floats(0, 1), st.floats(0.2, 1))
def test_kernel_keeps_every_limit(params, seed, first, second, low, high, share):
    """Margin >= 0 exactly within theta1, theta2, d and h, each limit in turn and all at once."""
    _, upper = PAUU.reach_box(params, {})
    capped = {**params, "h": max(share * float(upper[2]), 1e-3)}
    slide = (low * params["l2"] - 1e-3, high * params["l2"] + 1e-3)
    limits = {
        "theta1": (first[0], sum(first)),
        "theta2": (second[0], sum(second)),
        "d": slide,
    }
    cases = [(capped, {}), (params, limits), (capped, limits)]
    cases += [(params, {name: limits[name]}) for name in limits]
    for pose in reachable_poses(params, seed, 10):
        for mode, joints in naive.inverse(params, pose).items():
            for case, ranges in cases:
                constants = PAUU.kernel_constants(case, mode, 1.0, ranges)
                kept = naive.keeps_limits(case, pose, joints, ranges)
                assert (PAUU.kernel(*pose.values(), constants)[0] >= 0) == kept


def test_kernel_keeps_nearly_a_full_turn():
    """theta1 = -3.1036 of table 2 lies in the sliver that -3.1 .. 3.1 leaves out."""
    mode = min(
        PAUU.inverse(PAPER, POSE), key=lambda s: naive.angle_gap(s.joints["theta1"], -3.10359)
    ).working_mode
    for limits, inside in [((-3.1, 3.1), False), ((-3.11, 3.1), True), ((3.1, 3.2), True)]:
        constants = PAUU.kernel_constants(PAPER, mode, 1.0, {"theta1": limits})
        assert (PAUU.kernel(*POSE.values(), constants)[0] >= 0) == inside


def test_angles_are_wrapped_to_the_half_open_turn():
    """(-pi, pi]: of the two ends the positive one."""
    assert wrap_angle(-math.pi) == wrap_angle(math.pi) == wrap_angle(-3 * math.pi) == math.pi
    assert wrap_angle(7.0) == pytest.approx(7 - 2 * math.pi, abs=1e-15)
    assert wrap_angle(-3.0) == -3.0


def test_h_is_a_limit_on_z():
    params = PAUU.resolve({"h": 1.0})
    assert PAUU.admits(params, {"x": 0, "y": 0, "z": 1.0})
    assert not PAUU.admits(params, {"x": 0, "y": 0, "z": 1.0 + 1e-9})
    assert PAUU.admits(DEFAULT, {"x": 0, "y": 0, "z": 1e9})
    low = inverse_kinematics(PAUU, {"h": 1.3}, {"x": 0, "y": 0, "z": 1.2})
    high = inverse_kinematics(PAUU, {"h": 1.3}, {"x": 0, "y": 0, "z": 1.4})
    assert low.within_limits == (True,) * 4
    assert high.within_limits == (False,) * 4


def test_default_domain_is_the_half_above_the_pivots():
    assert PAUU.default_domain(PAUU.resolve({"c": 0.3})) == {"z": (0.6, math.inf)}


def test_half_open_angle_limits_end_at_half_a_turn():
    """Results lie in (-pi, pi]: an open end of a range is there."""
    checked = PAUU.check_ranges(
        {"theta1": (-math.inf, 1.0), "d": (0.0, math.inf)}, PAUU.joints, "limits"
    )
    assert checked == {"theta1": (-math.pi, 1.0), "d": (0.0, math.inf)}
    constants = PAUU.kernel_constants(DEFAULT, "out-out", 1.0, {"theta1": checked["theta1"]})
    for pose in reachable_poses(DEFAULT, 0, 20):
        (out,) = (s for s in PAUU.inverse(DEFAULT, pose) if s.working_mode == "out-out")
        assert (PAUU.kernel(*pose.values(), constants)[0] >= 0) == (out.joints["theta1"] <= 1.0)
    with pytest.raises(InputError, match=r"theta1=-inf:-4 is empty"):
        PAUU.check_ranges({"theta1": (-math.inf, -4)}, PAUU.joints, "limits")
