"""2UU-UPU (as 2UU-UPS) against geometry written down a second time.

The numbers of its model are in test_published_numbers.py, the zeros of its determinant in
test_singularities.py.
"""

import itertools
import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from support.poses import random_poses, reachable, ready

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms import find

UU = find("2uu-upu")
DEFAULT = UU.resolve({})
#: Platform smaller and larger than the base; links that let kappa turn right round.
DESIGNS = [
    DEFAULT,
    UU.resolve({"bs": 0.25, "ps": 0.45, "L": 0.4}),
    UU.resolve({"bs": 0.33, "ps": 0.21, "L": 0.37}),
]
NAMES = tuple(c.name for c in UU.joints)
SIDES = (1.0, -1.0)
QUARTER = math.pi / 2


def posed(*values):
    return dict(zip(("x", "beta", "gamma"), map(float, values), strict=True))


# --- the geometry a second time -----------------------------------------------------------


def turn(axis, angle):
    """Return Rodrigues' rotation."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


X, Y, Z = np.eye(3)


def triangle(side):
    """Return corners 1, 2, 3: the first on x, the line from the third to the second along y."""
    radius = side / math.sqrt(3)
    angles = [0, 2 * math.pi / 3, -2 * math.pi / 3]
    return np.array([[radius * math.cos(a), radius * math.sin(a), 0] for a in angles])


def largest_kappa(params):
    """Return where both links are in line with each other, pi where they never are."""
    a, c = params["bs"] / 2, params["ps"] / 2
    return math.acos(max((a * a + c * c - params["L"] ** 2) / (2 * a * c), -1.0))


def assembled(params, phi, kappa, psi, side):
    """Return Rot, P and P1 .. P3: links of length L in the plane that is turned by phi.

    The middle of P2P3, seen from that of B2B3, is as far from (u, -v) as from (-u, v).
    """
    rotation = turn(Y, phi) @ turn(X, kappa) @ turn(Y, psi)
    base, local = triangle(params["bs"]), triangle(params["ps"])
    half = params["ps"] / 2
    u, v = params["bs"] / 2 - half * math.cos(kappa), half * math.sin(kappa)
    far = params["L"] ** 2 - u * u - v * v
    assert far > -1e-15
    far = max(far, 0.0)
    y, height = np.array([v, u]) * side * math.sqrt(far) / math.hypot(u, v)
    middle = (base[1] + base[2]) / 2 + turn(Y, phi) @ [0, y, height]
    centre = middle - rotation @ (local[1] + local[2]) / 2
    return rotation, centre, centre + local @ rotation.T


def task_of(rotation, centre):
    """Return the pose (x, beta, gamma)."""
    beta = math.atan2(-rotation[2, 0], math.hypot(rotation[2, 1], rotation[2, 2]))
    return posed(centre[0], beta, math.atan2(rotation[2, 1], rotation[2, 2]))


def corners(params, pose, solution):
    """Return Rot, P and P1 .. P3 as pose and parasitic coordinates tell them."""
    told = solution.parasitic
    rotation = turn(Z, told["alpha"]) @ turn(Y, pose["beta"]) @ turn(X, pose["gamma"])
    centre = np.array([pose["x"], told["y"], told["z"]])
    return rotation, centre, centre + triangle(params["ps"]) @ rotation.T


def limb_ends(params, solution):
    """Return P1 .. P3 as joints and passive joints tell them."""
    q, p = solution.joints, solution.passive
    base, length = triangle(params["bs"]), params["L"]
    first = [
        math.sin(q["theta1"]) * math.cos(p["eta1"]), math.sin(p["eta1"]),
        math.cos(q["theta1"]) * math.cos(p["eta1"]),
    ]  # fmt: skip
    swing = [[0, math.sin(d), math.cos(d)] for d in (p["delta2"], q["delta3"])]
    links = [p["l1"] * np.array(first), *(length * turn(Y, q["phi"]) @ s for s in swing)]
    return base + links


lengths = {"bs": st.floats(0.25, 0.5), "ps": st.floats(0.2, 0.45), "L": st.floats(0.2, 0.4)}
designs = st.fixed_dictionaries(lengths).map(UU.resolve)
turns = st.floats(-math.pi, math.pi)
#: Tilts, among them those at which o is level.
tilts = st.one_of(st.floats(-1.5, 1.5), st.sampled_from([0.0, 1e-9, -1e-5, QUARTER]))


def close(params, one, other):
    """Return the greatest difference of two places (Rot, P, ..), lengths over L."""
    return max(np.abs(one[0] - other[0]).max(), np.abs(one[1] - other[1]).max() / params["L"])


# --- declarations -------------------------------------------------------------------------


def test_declared_as_in_the_paper():
    """Sides, link and stroke of 120 mm; the domain is ours."""
    assert DEFAULT == {"bs": 0.35, "ps": 0.31, "L": 0.25}
    assert UU.default_limits(DEFAULT) == {"l1": pytest.approx((0.16, 0.28), rel=1e-14)}
    assert [limb.joints for limb in UU.limbs] == ["UPS", "UU", "UU"]
    assert UU.working_modes == ("up", "down")
    assert UU.characteristic_length(DEFAULT) == pytest.approx(0.31 / math.sqrt(3), rel=1e-15)
    assert math.degrees(largest_kappa(DEFAULT)) == pytest.approx(98.3199, abs=5e-5)


@given(designs)
def test_home_stands_level_above_the_base(params):
    assume(abs(params["bs"] - params["ps"]) > 1e-6)
    home = UU.home(params)
    rotation, centre = UU.platform(params, home)
    np.testing.assert_allclose(rotation, np.eye(3), rtol=0, atol=1e-9)
    # The plane stands at an angle whose sine is at most 0.9.
    height = math.sqrt(params["L"] ** 2 - (params["bs"] - params["ps"]) ** 2 / 4)
    assert 0.43 * height < centre[2] <= height
    assert UU.platform(params, home, "down")[1][2] == pytest.approx(-centre[2], abs=1e-9)


# --- inverse kinematics -------------------------------------------------------------------


@given(designs, st.floats(-0.5, 0.5), tilts, tilts)
def test_every_branch_is_an_assembly(params, x, beta, gamma):
    """The platform's corners are where the limbs end, for every answer; none comes twice."""
    pose = posed(x, beta, gamma)
    places = []
    for s in UU.inverse(params, pose):
        place = corners(params, pose, s)
        np.testing.assert_allclose(limb_ends(params, s), place[2], rtol=0, atol=1e-9)
        phi, kappa, psi = s.joints["phi"], s.passive["kappa"], s.passive["psi"]
        rotation = turn(Y, phi) @ turn(X, kappa) @ turn(Y, psi)
        np.testing.assert_allclose(rotation, place[0], rtol=0, atol=1e-9)
        assert s.passive["l1"] > 0
        assert abs(s.passive["eta1"]) <= QUARTER
        values = [*s.joints.values(), *s.passive.values(), s.parasitic["alpha"]]
        assert all(-math.pi <= v <= math.pi for v in values)
        assert all(close(params, place, other) > 1e-9 for other in places)
        places.append(place)


@example(UU.resolve({"bs": 0.25, "ps": 0.21875, "L": 0.25}), -math.pi, 0.875, 1.0, 1.0)  # v = pi
@given(designs, turns, st.floats(-0.999, 0.999), turns, st.sampled_from(SIDES))
def test_every_configuration_is_an_answer(params, phi, share, psi, side):
    """Whatever plane, coupler and platform are turned by: its pose tells it among others.

    Where P_x is extreme two answers are one: their distance is the root of rounding.
    """
    assume(abs(params["bs"] - params["ps"]) > 1e-4)
    place = assembled(params, phi, share * largest_kappa(params), psi, side)
    pose = task_of(*place[:2])
    gaps = [close(params, corners(params, pose, s), place) for s in UU.inverse(params, pose)]
    assert min(gaps) < 1e-6


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize("near", [0.0, 1e-9, 1e-4, 1e-2])
def test_configurations_about_a_flat_plane_are_answers(params, near):
    """Phi at a right angle or near it, kappa from tiny to large: there m is small."""
    rng = np.random.default_rng(8)
    for _ in range(25):
        kappa = largest_kappa(params) * rng.choice(SIDES) * 10 ** rng.uniform(-7, -0.01)
        phi, psi = rng.choice(SIDES) * (QUARTER - near), rng.uniform(-3.1, 3.1)
        place = assembled(params, phi, kappa, psi, rng.choice(SIDES))
        pose = task_of(*place[:2])
        gaps = [close(params, corners(params, pose, s), place) for s in UU.inverse(params, pose)]
        assert min(gaps) < 1e-6


@pytest.mark.parametrize("near", [0.0, 1e-15, 1e-12, 1e-8, 1e-4])
def test_configurations_with_links_in_line_are_answers(near):
    """Both signs of f meet where kappa is largest: there is one answer, not two and not none."""
    rng = np.random.default_rng(10)
    for _ in range(40):
        kappa = rng.choice(SIDES) * largest_kappa(DEFAULT) * (1 - near)
        q = (rng.uniform(-3, 3), kappa, rng.uniform(-3, 3), rng.choice(SIDES))
        place = assembled(DEFAULT, *q)
        pose = task_of(*place[:2])
        found = [corners(DEFAULT, pose, s) for s in UU.inverse(DEFAULT, pose)]
        gaps = sorted(close(DEFAULT, f, place) for f in found)
        # f is the root of what rounding leaves of L^2 - rho^2.
        assert gaps[0] < 1e-7
        if near <= 1e-12:
            assert len(gaps) % 2 == 0
            assert gaps[1] > 1e-4


def count_roots(params, pose, nodes=6000):
    """Count sign changes of P_x - x by brute force: kappa for phi and phi for kappa, finely."""
    m = abs(math.cos(pose["beta"]) * math.sin(pose["gamma"]))
    top = largest_kappa(params)
    if m >= math.sin(min(top, QUARTER)):
        return 0
    steep = math.acos(m)
    acute = np.arcsin(m / np.cos(np.linspace(0, steep, nodes)[:-1]))
    least = math.asin(m)
    # Both ends of the range of kappa are approached as squares: there phi is, or f, a root.
    squares = np.linspace(0, 1, nodes) ** 2
    most = min(top, math.pi - least)
    spread = [least + (most - least) * squares, most - (most - least) * squares]
    logs = np.exp(np.linspace(math.log(least), math.log(most), nodes))
    kappa = np.concatenate([acute, math.pi - acute, *spread, logs])
    kappa = np.unique(kappa[(kappa >= least) & (kappa <= most)])
    a, c = params["bs"] / 2, params["ps"] / 2
    ckappa, skappa = np.cos(kappa), np.sin(kappa)
    arms = a - c * ckappa, c * skappa
    far = params["L"] ** 2 - arms[0] ** 2 - arms[1] ** 2
    height = arms[0] * np.sqrt(np.maximum(far, 0.0) / (arms[0] ** 2 + arms[1] ** 2))
    height[-1] *= most < top
    cphi = np.minimum(m / skappa, 1.0)
    deep, size = cphi * ckappa, np.sqrt(1 - cphi**2)
    rise, level = math.sin(pose["beta"]), math.cos(pose["beta"]) * math.cos(pose["gamma"])
    count = 0
    for half in SIDES:
        sphi = half * size
        # Sine and cosine of psi, both times the same.
        s, c = deep * rise - sphi * level, sphi * rise + deep * level
        across = (cphi * c - sphi * ckappa * s) / np.sqrt(s * s + c * c)
        for side in SIDES:
            x = side * height * sphi + params["ps"] / math.sqrt(12) * across
            above = x - params["bs"] / math.sqrt(12) >= pose["x"]
            count += int((above[1:] != above[:-1]).sum())
    return count


@pytest.mark.parametrize("params", [*DESIGNS, UU.resolve({"bs": 0.32, "ps": 0.3195})])
def test_as_many_answers_as_by_brute_force(params):
    """Tilts in full, and small ones, at which pairs of roots are close to phi = 90 degrees."""
    rng = np.random.default_rng(4)
    seen = Counter()
    lower, upper = UU.reach_box(params, {})
    for k in range(240):
        gamma = rng.uniform(-math.pi, math.pi) if k % 2 else 10 ** rng.uniform(-5, 0)
        pose = posed(rng.uniform(lower[0], upper[0]), rng.uniform(-1.4, 1.4), gamma)
        count, found = count_roots(params, pose), UU.inverse(params, pose)
        if len(found) != count:
            count = count_roots(params, pose, 200_000)
        assert len(found) == count
        seen[count] += 1
    assert seen[2] + seen[4] + seen[6] + seen[8] > 60


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize("upright", [False, True])
def test_answers_where_o_is_level(params, upright):
    """m = 0: kappa is 0 (or 180 degrees), or the plane lies flat, in pairs mirrored at y = 0.

    At gamma = 0 and at beta = 90 degrees; each configuration counts once, found by brute force
    with phi within +-90 degrees where kappa is 0 and phi = 90 degrees alone where it is not.
    """
    top = largest_kappa(params)
    rng = np.random.default_rng(5)
    lower, upper = UU.reach_box(params, {})
    flat_ones = 0
    for _ in range(12):
        x = rng.uniform(0.8 * lower[0], 0.8 * upper[0])
        tilt = QUARTER if upright else rng.uniform(-1.4, 1.4)
        pose = posed(x, tilt, 0.7 if upright else 0.0)
        level = math.cos(tilt) * math.cos(pose["gamma"])
        a, c, r = params["bs"] / 2, params["ps"] / 2, params["ps"] / math.sqrt(12)
        # Of M at kappa = 0 and 180 degrees: one phi on either side of the base, if any.
        spans = [pose["x"] + params["bs"] / math.sqrt(12) - k * r * level for k in (1, -1)]
        squares = [params["L"] ** 2 - gap**2 for gap in (a - c, a + c)]
        straight = [span**2 < far for span, far in zip(spans, squares, strict=True)]
        count = 2 * sum(straight)
        kappa = np.concatenate([top * np.linspace(0, 1, 40_001) ** 2, [top]])[1:-1]
        kappa = np.unique(np.concatenate([kappa, top - kappa]))
        arm = a - c * np.cos(kappa)
        rho = np.hypot(arm, c * np.sin(kappa))
        height = arm * np.sqrt(np.maximum(params["L"] ** 2 - rho**2, 0.0)) / rho
        for side in SIDES:  # and kappa < 0
            above = side * height + r * level * (np.cos(kappa) - 1) >= spans[0]
            count += 2 * int((above[1:] != above[:-1]).sum())
        found = UU.inverse(params, pose)
        assert len(found) == count
        modes = [s.working_mode for s in found if s.working_mode in UU.working_modes]
        assert modes == (["up", "down"] if straight[0] else [])
        flat = [s for s in found if abs(math.sin(s.passive["kappa"])) > 1e-6]
        flat_ones += len(flat)
        for s in flat:
            assert abs(s.joints["phi"]) == pytest.approx(QUARTER, abs=1e-12)
            assert s.parasitic["z"] == pytest.approx(corners(params, pose, s)[1][2], abs=1e-12)
        sides = sorted(s.parasitic["y"] for s in flat)
        assert sides == pytest.approx([-y for y in reversed(sides)], abs=1e-9)
    assert flat_ones > 4


def test_names_count_outwards_and_modes_come_first():
    """v, the curve's parameter, is the turn of the platform's z in the plane normal to o."""
    seen = 0
    for pose in random_poses(UU, DEFAULT, 200):
        found = UU.inverse(DEFAULT, pose)
        names = [s.working_mode for s in found]
        modes = [n for n in names if n in UU.working_modes]
        assert names[: len(modes)] == modes == [n for n in UU.working_modes if n in modes]
        for mode in UU.working_modes:
            others = [s for s in found if s.working_mode.startswith(mode + "-")]
            assert [s.working_mode for s in others] == [
                f"{mode}-{k}" for k in range(2, len(others) + 2)
            ]
            seen += len(others)
            out = []
            for s in others:
                phi, kappa = s.joints["phi"], s.passive["kappa"]
                out.append(abs(math.atan2(math.sin(phi), math.cos(phi) * math.cos(kappa))))
                # s: M is on that side of B2B3, seen along the height in the plane.
                middle = (math.cos(s.joints["delta3"]) + math.cos(s.passive["delta2"])) / 2
                over = DEFAULT["bs"] - DEFAULT["ps"] * math.cos(kappa)
                assert middle * over * (1 if mode == "up" else -1) > 0
            assert out == sorted(out)
    assert seen > 100


def joints_of(params, q, side):
    """Return the joints of a configuration."""
    arms = assembled(params, *q, side)[2] - triangle(params["bs"])
    swing = turn(Y, -q[0]) @ arms[2]
    values = math.atan2(arms[0][0], arms[0][2]), q[0], math.atan2(swing[1], swing[2])
    return dict(zip(NAMES, values, strict=True))


def test_configurations_at_extremes_of_x_are_answers():
    """Two roots that are one: rounding may leave P_x short of x there."""
    rng = np.random.default_rng(14)
    count = 0
    while count < 40:
        phi, kappa, side = rng.uniform(-1.5, 1.5), rng.uniform(-1.6, 1.6), rng.choice(SIDES)

        def extreme(psi, phi=phi, kappa=kappa, side=side):
            q = phi, kappa, psi
            pose = task_of(*assembled(DEFAULT, *q, side)[:2])
            joints = joints_of(DEFAULT, q, side)
            return UU.singularity_measures(DEFAULT, pose, joints)["inverse"]["limb 2"]

        low, high = -QUARTER, QUARTER
        before = extreme(low)
        if before * extreme(high) > 0:
            continue
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if extreme(middle) * before > 0 else (low, middle)
        place = assembled(DEFAULT, phi, kappa, low, side)
        pose = task_of(*place[:2])
        gaps = [close(DEFAULT, corners(DEFAULT, pose, s), place) for s in UU.inverse(DEFAULT, pose)]
        assert min(gaps) < 1e-5
        count += 1


def test_further_answers_are_no_modes():
    pose = posed(0.1, 0.1, 0.05)
    assert "up-2" in {s.working_mode for s in UU.inverse(DEFAULT, pose)}
    with pytest.raises(InputError, match="unknown name 'up-2'"):
        UU.platform(DEFAULT, pose, "up-2")


def test_two_answers_become_one_at_an_extreme_of_x():
    """At the end of mode up, at tilts of either sign: there up and up-2 meet, and then neither is.

    A tenth of a nanometre before it they are still told apart.
    """
    for beta, gamma in ((0.2, 0.05), (-0.1, 0.09), (0.05, 0.01), (0.4, -1e-4)):

        def names(x, beta=beta, gamma=gamma):
            return {s.working_mode: s for s in UU.inverse(DEFAULT, posed(x, beta, gamma))}

        low, high = 0.1, 0.3
        assert "up" in names(low)
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if "up" in names(middle) else (low, middle)
        # It counts as reached up to 5e-10 m beyond the extreme.
        before, after = names(low - 6e-10), names(high + 1e-9)
        assert len(before) == len(after) + 2
        up, other = before["up"], before["up-2"]
        assert 0 < abs(up.joints["phi"] - other.joints["phi"]) < 1e-2
        measures = [
            UU.singularity_measures(DEFAULT, posed(low - 6e-10, beta, gamma), s.joints)["inverse"]
            for s in (up, other)
        ]
        assert measures[0]["limb 2"] * measures[1]["limb 2"] < 0
        assert max(abs(m["limb 2"]) for m in measures) < 1e-2
        # About the extreme itself the mode's root is no third one beside the two.
        for step in (0.0, *np.geomspace(1e-17, 1e-10, 15)):
            assert len(names(low - 5e-10 - step)) <= len(after) + 2


def test_sides_of_equal_length_do_not_divide_by_zero():
    """bs = ps: a parallelogram, whose swing at kappa = 0 no internal coordinate tells."""
    params = UU.resolve({"bs": 0.3, "ps": 0.3})
    home = UU.home(params)
    assert UU.kernel(*home.values(), ready(UU, params, "up"))[0] < 0
    assert not any(s.working_mode == "up" for s in UU.inverse(params, home))
    tilted = UU.inverse(params, posed(0.02, 0.1, 0.3))
    assert tilted
    for s in tilted:
        ends = corners(params, posed(0.02, 0.1, 0.3), s)[2]
        np.testing.assert_allclose(limb_ends(params, s), ends, rtol=0, atol=1e-12)


@pytest.mark.parametrize("gap", [1e-3, 1e-5, 1e-8])
def test_sides_of_nearly_equal_length_lose_no_digits(gap):
    params = UU.resolve({"bs": 0.3, "ps": 0.3 - gap})
    rng = np.random.default_rng(3)
    count = 0
    for _ in range(60):
        pose = posed(rng.uniform(-0.2, 0.2), rng.uniform(-1, 1), rng.choice([0.0, 0.3, 1e-6]))
        for s in UU.inverse(params, pose):
            ends = corners(params, pose, s)[2]
            np.testing.assert_allclose(limb_ends(params, s), ends, rtol=0, atol=1e-11)
            count += 1
    assert count > 60


# --- the kernel's root --------------------------------------------------------------------


def within_of(params, solutions, mode):
    low, high = UU.default_limits(params)["l1"]
    found = [s for s in solutions if s.working_mode == mode]
    return bool(found) and low <= found[0].passive["l1"] <= high


def mode_within(params, pose, mode):
    return within_of(params, UU.inverse(params, pose), mode)


@pytest.mark.parametrize("mode", UU.working_modes)
def test_kernel_reaches_what_inverse_reaches_up_to_the_extreme(mode):
    """gamma = 0: along x to where the plane lies flat, ever finer steps."""
    constants = ready(UU, DEFAULT, mode)
    _, upper = UU.reach_box(DEFAULT, {})
    for step in np.geomspace(0.02, 1e-9, 200):
        for beta in (0.0, 0.1):
            level = 0.31 / math.sqrt(12) * (1 - math.cos(beta))
            pose = posed(upper[0] - level - step, beta, 0.0)
            margin = UU.kernel(*pose.values(), constants)[0]
            assert (margin >= 0) == mode_within(DEFAULT, pose, mode)
        assert UU.kernel(upper[0] + step, 0.0, 0.0, constants)[0] < 0


@pytest.mark.parametrize("mode", UU.working_modes)
def test_where_the_kernel_ends_inverse_has_a_root(mode):
    """What is found at the end of reach by bisection has joints, at any tilt."""
    constants = ready(UU, DEFAULT, mode, limits={"l1": (0.0, 1.0)})
    for beta, gamma in itertools.product(np.linspace(-0.3, 0.3, 13).tolist(), (0.0, 0.02, -0.05)):
        low, high = 0.1, 0.3
        assert UU.kernel(low, beta, gamma, constants)[0] >= 0
        for _ in range(70):
            middle = (low + high) / 2
            inside = UU.kernel(middle, beta, gamma, constants)[0] >= 0
            low, high = (middle, high) if inside else (low, middle)
        assert mode in {s.working_mode for s in UU.inverse(DEFAULT, posed(low, beta, gamma))}


@pytest.mark.parametrize(
    ("mode", "pose"),
    [
        ("up", (-0.29156887526895336, -0.27659200587056165, 0.05207267929090276)),
        ("up", (-0.33887319437087493, -0.43477789359435937, -0.0031599501042753886)),
        ("up", (-0.3493683404414506, 0.7904134594024914, -0.009096552504862965)),
        ("down", (0.37031184945178564, -0.8970104039364156, -0.02894200508205813)),
        ("down", (-0.31263206677544464, 0.46472151675492546, -0.004194097773076999)),
    ],
)
def test_kernel_sees_both_turns_about_a_right_angle(mode, pose):
    """Links that let kappa turn right round: near v = 90 degrees P_x turns back, and again."""
    params = DESIGNS[1]
    assert mode_within(params, posed(*pose), mode)
    assert UU.kernel(*pose, ready(UU, params, mode))[0] >= 0


@pytest.mark.parametrize("params", DESIGNS)
def test_kernel_and_inverse_agree(params):
    """Of some thousand poses of the default domain; the cells may miss a shallow pair of turns."""
    for mode in UU.working_modes:
        sampler = make_sampler(UU, WorkspaceSettings(working_mode=mode), threads=1)
        design = sampler.design(params)
        unit = np.random.default_rng(9).random((3, 1500))
        poses = design.lower[:, None] + design.width[:, None] * unit
        margin, _ = sampler.evaluator.field(design, poses)
        answers = UU.inverses(params, [posed(*pose) for pose in poses.T])
        inside = [within_of(params, solutions, mode) for solutions in answers]
        assert sum(inside) > 50
        assert ((margin >= 0) != inside).sum() <= 1


@given(designs, turns, st.floats(-0.99, 0.99), turns, st.sampled_from(SIDES))
def test_reach_box_cuts_nothing_off(params, phi, share, psi, side):
    assume(abs(params["bs"] - params["ps"]) > 1e-4)
    rotation, centre, ends = assembled(params, phi, share * largest_kappa(params), psi, side)
    pose = np.array(list(task_of(rotation, centre).values()))
    lower, upper = UU.reach_box(params, {})
    assert (lower - 1e-12 <= pose).all()
    assert (pose <= upper + 1e-12).all()
    l1 = float(np.linalg.norm(ends[0] - triangle(params["bs"])[0]))
    for limits in ({"l1": (0.0, l1)}, {"l1": (l1 - 0.01, l1 + 1e-9)}):
        lower, upper = UU.reach_box(params, limits)
        assert (lower - 1e-12 <= pose).all()
        assert (pose <= upper + 1e-12).all()


def test_reach_box_is_tight_and_may_be_empty():
    """Both ends along x are met, the plane flat; a stroke too short leaves nothing."""
    lower, upper = UU.reach_box(DEFAULT, {})
    for x, tilt in ((upper[0], 0.0), (lower[0], math.pi)):
        inward = 1e-6 if tilt == 0.0 else -1e-6
        assert UU.inverse(DEFAULT, posed(x - inward, 0.0, tilt))
        assert not UU.inverse(DEFAULT, posed(x + inward, 0.0, tilt))
    lower, upper = UU.reach_box(UU.resolve({"bs": 5, "ps": 0.2, "L": 4}), {"l1": (0.0, 0.1)})
    assert (lower >= upper).any()


# --- forward kinematics -------------------------------------------------------------------


@pytest.mark.parametrize("params", DESIGNS)
def test_inverse_then_forward(params):
    """Every answer's pose comes back, with y, z and alpha; every assembly mode has the joints."""
    count = 0
    for pose in random_poses(UU, params, 40, seed=2):
        for s in UU.inverse(params, pose):
            place = corners(params, pose, s)
            found = UU.forward(params, s.joints)
            gaps = []
            for one in found:
                told = turn(Z, one.parasitic["alpha"]) @ turn(Y, one.pose["beta"])
                told = told @ turn(X, one.pose["gamma"])
                centre = np.array([one.pose["x"], one.parasitic["y"], one.parasitic["z"]])
                gaps.append(close(params, (told, centre), place))
                ends = centre + triangle(params["ps"]) @ told.T
                wanted = limb_ends(params, s)
                np.testing.assert_allclose(ends[2], wanted[2], rtol=0, atol=1e-9)
                arms = ends - triangle(params["bs"])
                assert np.linalg.norm(arms[1]) == pytest.approx(params["L"], abs=1e-9)
                normal = turn(Y, s.joints["phi"]) @ X
                assert arms[1] @ normal == pytest.approx(0.0, abs=1e-9)
                angle = math.atan2(arms[0][0], arms[0][2]) - s.joints["theta1"]
                assert math.remainder(angle, 2 * math.pi) == pytest.approx(0.0, abs=1e-7)
                assert one.residual < 1e-9
            # At a type II singularity two assembly modes meet: the root of rounding.
            assert min(gaps) < 1e-7
            count += 1
    assert count > 40


def assemblies(params, joints, nodes=20_000):
    """Count assembly modes by brute force: kappa all round, psi all round."""
    a, c, length = params["bs"] / 2, params["ps"] / 2, params["L"]
    phi, d3, t1 = joints["phi"], joints["delta3"], joints["theta1"]
    grid = np.linspace(-math.pi, math.pi, nodes)
    p3 = np.array([-a + length * math.sin(d3), length * math.cos(d3)])

    def p2(kappa):
        return p3 + 2 * c * np.stack([np.cos(kappa), np.sin(kappa)], axis=-1)

    def gap(kappa):
        return np.linalg.norm(p2(kappa) - [a, 0.0], axis=-1) - length

    count = 0
    values = gap(grid)
    for k in np.flatnonzero(values[1:] * values[:-1] < 0):
        low, high = grid[k], grid[k + 1]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if gap(middle) * values[k] > 0 else (low, middle)
        half = turn(Y, phi) @ [0, *(p2(low) + p3) / 2]
        about = turn(Y, phi) @ turn(X, low)
        # Rot x for psi all round
        across = np.cos(grid)[:, None] * about[:, 0] - np.sin(grid)[:, None] * about[:, 2]
        middle = half - [a / math.sqrt(3), 0, 0]
        arms = middle + params["ps"] * math.sqrt(3) / 2 * across - triangle(params["bs"])[0]
        off = arms @ [math.cos(t1), 0.0, -math.sin(t1)]
        ahead = arms @ [math.sin(t1), 0.0, math.cos(t1)] > 0
        count += int(((off[1:] * off[:-1] < 0) & ahead[1:]).sum())
    return count


@pytest.mark.parametrize("params", DESIGNS)
def test_forward_finds_as_many_as_by_brute_force(params):
    """Any number up to four: of the two psi of each kappa one may put P1 behind theta1's axis."""
    rng = np.random.default_rng(6)
    seen = Counter()
    for k in range(160):
        share = (1.0, 1.0, 1.0) if k % 2 else (0.3, 0.4, 0.5)
        joints = dict(zip(NAMES, rng.uniform(-math.pi, math.pi, 3) * share, strict=True))
        found = UU.forward(params, joints)
        assert len(found) == assemblies(params, joints)
        seen[len(found)] += 1
        if not found:
            assert "span" in UU.why_not(params, joints) or "turn" in UU.why_not(params, joints)
    assert set(seen) == {0, 1, 2, 3, 4}


# --- velocities ---------------------------------------------------------------------------


def follow(answers, solution):
    """Return the joints on the same branch, of the answers at a neighbouring pose, unwrapped."""
    was = {**solution.joints, **solution.passive}

    def gap(other):
        now = {**other.joints, **other.passive}
        return max(
            abs(math.remainder(now[k] - was[k], 2 * math.pi))
            for k in ("phi", "kappa", "psi", "delta3")
        )

    best = min(answers, key=gap)
    assert gap(best) < 0.02
    return np.array(
        [was[k] + math.remainder(best.joints[k] - was[k], 2 * math.pi) for k in solution.joints]
    )


@pytest.mark.parametrize("params", DESIGNS)
def test_velocity_maps_equal_finite_differences_on_every_branch(params):
    seen = Counter()
    # Rates of the angles grow as 1 / cos beta.
    poses = [p for p in random_poses(UU, params, 260, seed=12) if abs(p["beta"]) <= 1.3]
    steps = ((-2, 1), (-1, -8), (1, 8), (2, -1))
    shifted = [
        {**pose, name: pose[name] + shift * 1e-5}
        for pose in poses for name in pose for shift, _ in steps
    ]  # fmt: skip
    answers = iter(UU.inverses(params, shifted))
    for pose, solutions in zip(poses, UU.inverses(params, poses), strict=True):
        near = {(name, weight): next(answers) for name in pose for _, weight in steps}
        for s in solutions:
            measures = UU.singularity_measures(params, pose, s.joints)
            extreme, aside = measures["inverse"]["limb 2"], measures["inverse"]["limb 1"]
            slack = largest_kappa(params) - abs(s.passive["kappa"])
            if abs(extreme) < 0.05 or abs(aside) < 0.2 or slack < 0.05:
                continue
            columns = [
                sum(weight * follow(near[name, weight], s) for _, weight in steps) / 12e-5
                for name in pose
            ]
            wanted = np.stack(columns, axis=1)
            j_x, j_q = UU.velocity_maps(params, pose, s.joints)
            found = np.linalg.solve(j_q, j_x)
            atol = 1e-6 * np.abs(wanted).max()
            np.testing.assert_allclose(found, wanted, rtol=0, atol=atol)
            seen[s.working_mode in UU.working_modes] += 1
    assert seen[True] > 50
    assert seen[False] > 50


@pytest.mark.parametrize("params", DESIGNS)
def test_velocity_maps_of_a_flat_plane(params):
    """gamma = 0 and phi = 90 degrees: o's height does not tell kappa, the joints do.

    Against pose and joints of configurations about it, moved by phi, kappa and psi.
    """
    lower, upper = UU.reach_box(params, {})
    poses = [posed(x, 0.3, 0.0) for x in np.linspace(lower[0], upper[0], 12)]
    answers = [(pose, s) for pose in poses for s in UU.inverse(params, pose)]
    flat = [(p, s) for p, s in answers if 0.05 < abs(s.passive["kappa"]) < 3.0]
    assert len(flat) >= 4
    for pose, s in flat:
        phi, kappa, psi = s.joints["phi"], s.passive["kappa"], s.passive["psi"]
        assert abs(phi) == pytest.approx(QUARTER, abs=1e-12)
        (side,) = [
            side for side in SIDES
            if close(params, assembled(params, phi, kappa, psi, side), corners(params, pose, s))
            < 1e-9
        ]  # fmt: skip

        def both(q, side=side):
            task = task_of(*assembled(params, *q, side)[:2])
            return np.array([*task.values(), *joints_of(params, q, side).values()])

        rates = np.zeros((6, 3))
        for k in range(3):
            step = np.eye(3)[k] * 1e-5
            q = np.array([phi, kappa, psi])
            for shift, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
                rates[:, k] += weight * both(q + shift * step) / 12e-5
        wanted = rates[3:] @ np.linalg.inv(rates[:3])
        j_x, j_q = UU.velocity_maps(params, pose, s.joints)
        found = np.linalg.solve(j_q, j_x)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())


# --- singularities ------------------------------------------------------------------------


def test_link_2_in_line_with_the_coupler():
    """kappa = -17.624512 degrees at the default sizes, and the mirrored one for link 3.

    P2 is then between B2 and P3, and B2, B3, P3 a triangle of sides bs, L and L + ps. On either
    side the measure has another sign; there the Jacobian is lost.
    """
    bs, ps, length = DEFAULT["bs"], DEFAULT["ps"], DEFAULT["L"]
    reach = length + ps
    kappa = -math.acos((bs**2 + reach**2 - length**2) / (2 * bs * reach))
    assert math.degrees(kappa) == pytest.approx(-17.624512, abs=5e-7)
    told = {}
    for change in (-1e-3, 0.0, 1e-8, 1e-3):
        for phi, psi in ((0.3, -0.4), (-0.6, 0.2)):
            place = assembled(DEFAULT, phi, kappa + change, psi, 1.0)
            pose = task_of(*place[:2])
            answers = UU.inverse(DEFAULT, pose)
            s = min(answers, key=lambda s: close(DEFAULT, corners(DEFAULT, pose, s), place))
            measure = UU.singularity_measures(DEFAULT, pose, s.joints)["forward"]
            j_x, j_q = UU.velocity_maps(DEFAULT, pose, s.joints)
            values = np.linalg.svd(np.linalg.solve(j_q, j_x), compute_uv=False)
            told[change, phi] = measure["link 2"]
            if change == 0.0:
                assert abs(measure["link 2"]) < 1e-12
                assert values[-1] < 1e-9 * values[0]
            elif abs(change) == 1e-3:
                assert values[-1] > 1e-6 * values[0]
    for phi in (0.3, -0.6):
        assert told[1e-3, phi] == pytest.approx(-told[-1e-3, phi], rel=0.05)
        # No digit is lost where two circles touch.
        assert told[1e-8, phi] * 1e5 == pytest.approx(told[1e-3, phi], rel=0.05)
        assert abs(told[1e-3, phi]) > 1e-3


@given(turns, st.floats(-0.95, 0.95), st.sampled_from(SIDES))
def test_theta1_does_not_hold_psi(phi, share, side):
    """Where theta1, told from the geometry, is extreme in psi the measure of limb 1 vanishes."""
    kappa = share * largest_kappa(DEFAULT)
    foot = triangle(DEFAULT["bs"])[0]

    def slope(psi):
        rotation, _, ends = assembled(DEFAULT, phi, kappa, psi, side)
        w = ends[0] - foot
        moved = np.cross(rotation[:, 1], rotation[:, 0])  # of P1, over its distance from P2P3
        return (moved[0] * w[2] - moved[2] * w[0]) / math.hypot(w[0], w[2])

    grid = np.linspace(-math.pi, math.pi, 73)
    values = [slope(psi) for psi in grid]
    for k in [k for k in range(72) if values[k] * values[k + 1] < 0][:2]:
        low, high = grid[k], grid[k + 1]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if slope(middle) * values[k] > 0 else (low, middle)
        for psi in (low, grid[k]):
            place = assembled(DEFAULT, phi, kappa, psi, side)
            pose = task_of(*place[:2])
            answers = UU.inverse(DEFAULT, pose)
            s = min(answers, key=lambda s: close(DEFAULT, corners(DEFAULT, pose, s), place))
            gap = close(DEFAULT, corners(DEFAULT, pose, s), place)
            told = UU.singularity_measures(DEFAULT, pose, s.joints)["forward"]
            assert told["limb 1"] == pytest.approx(slope(psi), abs=1e-9 + 10 * gap)
            assert told["platform"] == pytest.approx(told["limb 1"] * told["link 2"], abs=1e-15)


# --- layout and skeleton ------------------------------------------------------------------


@pytest.mark.parametrize("mode", UU.working_modes)
@pytest.mark.parametrize("params", DESIGNS)
def test_layout_and_skeleton_join_the_points(params, mode):
    """Joints at B_i and P_i; U axes square to each other and, the inner ones, to the limb."""
    base, home = triangle(params["bs"]), UU.home(params)
    constants = ready(UU, params, mode)

    def place_of(pose):
        (s,) = [s for s in UU.inverse(params, pose) if s.working_mode == mode]
        return corners(params, pose, s), s

    (r_home, _, ends_home), _ = place_of(home)
    for pose, _ in reachable(UU, params, 6, mode):
        (rotation, centre, ends), s = place_of(pose)
        told, where = UU.platform(params, pose, mode)
        np.testing.assert_allclose(told, rotation, rtol=0, atol=1e-9)
        np.testing.assert_allclose(where, centre, rtol=0, atol=1e-9)
        chains = UU.layout(params, pose, mode)
        assert ["".join(j.kind for j in c.joints) for c in chains] == ["UPS", "UU", "UU"]
        normal, o = turn(Y, s.joints["phi"]) @ X, rotation[:, 1]
        flat = np.array(UU.skeleton(*pose.values(), constants))
        np.testing.assert_allclose(flat[:3], centre, rtol=0, atol=1e-9)
        np.testing.assert_allclose(flat[3:12].reshape(3, 3), rotation, rtol=0, atol=1e-9)
        segments = flat[12:48].reshape(6, 2, 3)
        cones = dict(zip(UU.cones, flat[48:], strict=True))
        assert len(flat) == 12 + 6 * len(UU.segments) + len(UU.cones)
        for k, name in enumerate(("S_P1", "U_P2", "U_P3")):
            first, last = chains[k].joints[0], chains[k].joints[-1]
            np.testing.assert_allclose([first.point, last.point], [base[k], ends[k]], atol=1e-9)
            np.testing.assert_allclose(segments[k], [base[k], ends[k]], rtol=0, atol=1e-9)
            np.testing.assert_allclose(segments[3 + k], [centre, ends[k]], rtol=0, atol=1e-9)
            link, at_home = (e[k] - base[k] for e in (ends, ends_home))
            link, at_home = link / np.linalg.norm(link), at_home / np.linalg.norm(at_home)
            carried = rotation @ r_home.T @ at_home
            assert cones[name] == pytest.approx(link @ carried, abs=1e-9)
            outer, inner = first.axes
            np.testing.assert_array_equal(outer, Y)
            np.testing.assert_allclose([outer @ inner, inner @ link], 0, atol=1e-9)
            if k == 0:
                np.testing.assert_allclose(chains[0].joints[1].axes[0], link, atol=1e-9)
                assert first.drive == ("theta1", 0)
                continue
            # Turning about -n swings the link from the height towards y.
            np.testing.assert_allclose(inner, -normal, atol=1e-9)
            np.testing.assert_allclose(last.axes, [normal, o], atol=1e-9)
            assert first.drive == (("phi", 0), ("delta3", 1))[k - 1]


def test_out_of_reach_is_told():
    with pytest.raises(UnreachableError, match="working mode up"):
        UU.layout(DEFAULT, posed(0.9, 0.0, 0.0))
    told = {r.limb: r for r in UU.reach(DEFAULT, posed(0.9, 0.0, 0.0))}
    assert told["limb 2"].distance == told["limb 3"].distance < 0
    assert told["limb 2"].reason == "too far"
    assert all(r.distance > 0 for r in UU.reach(DEFAULT, UU.home(DEFAULT)))
