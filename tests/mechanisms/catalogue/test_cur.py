"""3-CUR against its model, and against geometry written down a second time.

Paper: "Kinematics Analysis and Simulation of 3-CUR Parallel Sorting Robot". Its numbers, which are
those of the model, stand in test_published_numbers.py.
"""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import fsolve, least_squares
from support.poses import random_poses, ready

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.mechanisms.mechanism import within

CUR = find("3-cur")
DEFAULT = CUR.resolve({})
DESIGNS = [
    DEFAULT,
    CUR.resolve({"Ra": 0.15, "Rb": 0.2, "L": 0.3, "d1": 0.04}),
    CUR.resolve({"Ra": 0.35, "Rb": 0.1, "L": 0.4}),
]
NAMES = ("z", "beta", "gamma")
HEIGHTS = ("h1", "h2", "h3")
Z = np.array([0.0, 0.0, 1.0])
#: Sign of each link's height, by working mode.
SIGNS = {
    "-".join({1: "up", -1: "down"}[s] for s in signs): signs
    for signs in itertools.product((1, -1), repeat=3)
}
#: Every passive joint free, the sliders too.
FREE = {
    **dict.fromkeys(HEIGHTS, (-math.inf, math.inf)),
    **dict.fromkeys(("theta4", "theta5", "elevation"), (-math.pi, math.pi)),
}


def posed(*values):
    return dict(zip(NAMES, map(float, values), strict=True))


def sized(ra, rb, length, d1):
    return CUR.resolve({"Ra": ra, "Rb": rb, "L": length, "d1": d1})


designs = st.builds(
    sized,
    st.floats(0.1, 0.4),
    st.floats(0.05, 0.25),
    st.floats(0.15, 0.5),
    st.sampled_from([0.0, 0.03]),
).filter(lambda p: abs(p["Ra"] - p["Rb"]) < 0.9 * p["L"])
tilts = st.floats(-0.6, 0.6)
poses = st.builds(posed, st.floats(0.1, 0.6), tilts, tilts)
modes = st.sampled_from(list(SIGNS))


# --- the geometry a second time -----------------------------------------------------------


def turn(axis, angle):
    """Return Rodrigues' rotation."""
    x, y, z = axis
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


RADIAL = [turn(Z, math.radians(a)) @ [1, 0, 0] for a in (0, 120, 240)]
TANGENTIAL = [np.cross(Z, r) for r in RADIAL]


def rotation_of(alpha, beta, gamma):
    x, y, z = np.eye(3)
    return turn(z, alpha) @ turn(y, beta) @ turn(x, gamma)


def limbs_of(params, pose, parasitic, joints):
    """Return Rot, P and, limb by limb, (A, b, e, w) in the base frame."""
    rotation = rotation_of(parasitic["alpha"], pose["beta"], pose["gamma"])
    centre = np.array([parasitic["x"], parasitic["y"], pose["z"]])
    limbs = []
    for radial, tangential, name in zip(RADIAL, TANGENTIAL, HEIGHTS, strict=True):
        a, b = params["Ra"] * radial, rotation @ (params["Rb"] * radial)
        w = centre + b - a - (joints[name] + params["d1"]) * Z
        limbs.append((a, b, rotation @ tangential, w))
    return rotation, centre, limbs


def solutions(params, pose):
    return {s.working_mode: s for s in CUR.inverse(params, pose)}


def solved(params, pose, mode):
    """Return a mode's solution; skip the example where there is none."""
    found = solutions(params, pose).get(mode)
    assume(found is not None)
    return found


def away_from_flat(params, pose, solution, least=0.1):
    """Return whether no link lies flat: there the rates of the sliders are infinite."""
    *_, limbs = limbs_of(params, pose, solution.parasitic, solution.joints)
    return min(abs(w[2]) for *_, w in limbs) > least * params["L"]


def misfit(params, beta, gamma, signs):
    """Return e_i . w_i over L as a function of x, y, alpha, with w_iz from |w_i| = L."""
    local = [turn((0, 1, 0), beta) @ turn((1, 0, 0), gamma) @ v for v in (*RADIAL, *TANGENTIAL)]
    ends = params["Rb"] * np.array(local[:3])
    axes = np.array(local[3:])
    feet = params["Ra"] * np.array(RADIAL)[:, :2]
    length = params["L"]

    def function(u):
        yaw = np.array([[math.cos(u[2]), -math.sin(u[2])], [math.sin(u[2]), math.cos(u[2])]])
        g = u[:2] + ends[:, :2] @ yaw.T - feet
        square = length**2 - (g * g).sum(axis=1)
        height = signs * np.sqrt(np.maximum(square, 1e-14))
        return ((axes[:, :2] @ yaw.T * g).sum(axis=1) + axes[:, 2] * height) / length, square

    return function


def root_from(function, start):
    """Return the root that scipy finds from a start, None without one."""
    end, info, flag, _ = fsolve(lambda u: function(u)[0], start, full_output=True, xtol=1e-13)
    if flag != 1 or np.abs(info["fvec"]).max() > 1e-10 or function(end)[1].min() < 1e-6:
        return None
    return np.array([*end[:2], math.remainder(end[2], 2 * math.pi)])


def slopes(function, pose):
    """Return derivatives by each pose coordinate, of fourth order."""
    columns = []
    for name in pose:
        step, total = 2e-5, 0.0
        for shift, weight in ((-2, 1), (-1, -8), (1, 8), (2, -1)):
            moved_pose = {**pose, name: pose[name] + shift * step}
            total = total + weight * np.array(function(moved_pose)) / (12 * step)
        columns.append(total)
    return np.stack(columns, axis=-1)


def heights_of(params, mode):
    """Return the sliders' heights as a function of the pose."""
    return lambda pose: list(solutions(params, pose)[mode].joints.values())


# --- positions ----------------------------------------------------------------------------


def test_declared_as_in_the_paper():
    assert DEFAULT == {"Ra": 0.20, "Rb": 0.12, "L": 0.25, "d1": 0.0}
    assert [limb.joints for limb in CUR.limbs] == ["CUR"] * 3
    assert CUR.characteristic_length(DEFAULT) == 0.12
    assert list(CUR.working_modes) == list(SIGNS)
    assert CUR.default_domain(DEFAULT) == dict.fromkeys(
        ("beta", "gamma"), pytest.approx((-math.radians(80), math.radians(80)))
    )


@given(designs, poses)
def test_solutions_close_the_limbs(params, pose):
    """e . w = 0, |w| = L, links up and down as the mode says; z moves the sliders alone."""
    found = solutions(params, pose)
    higher = solutions(params, {**pose, "z": pose["z"] + 0.1})
    assert list(found) == list(higher)
    for mode, solution in found.items():
        rotation, centre, limbs = limbs_of(params, pose, solution.parasitic, solution.joints)
        for sign, (_, _, e, w) in zip(SIGNS[mode], limbs, strict=True):
            assert abs(e @ w) < 1e-9 * params["L"]
            assert np.linalg.norm(w) == pytest.approx(params["L"], rel=1e-9)
            assert sign * w[2] >= -1e-12
        for place, wanted in zip(CUR.platform(params, pose, mode), (rotation, centre), strict=True):
            np.testing.assert_allclose(place, wanted, rtol=0, atol=1e-14)
        assert higher[mode].parasitic == solution.parasitic
        for name in HEIGHTS:
            assert higher[mode].joints[name] == pytest.approx(solution.joints[name] + 0.1)


@given(designs, st.floats(0.1, 0.6))
def test_level_platform_has_all_modes(params, z):
    rise = math.sqrt(params["L"] ** 2 - (params["Ra"] - params["Rb"]) ** 2)
    found = solutions(params, posed(z, 0, 0))
    assert list(found) == list(SIGNS)
    for mode, solution in found.items():
        assert solution.parasitic == pytest.approx(dict.fromkeys("xy", 0.0) | {"alpha": 0.0})
        wanted = [z - params["d1"] - s * rise for s in SIGNS[mode]]
        assert list(solution.joints.values()) == pytest.approx(wanted, abs=1e-12)
    home = CUR.home(params)
    middle = solutions(params, home)["up-up-up"].joints
    assert middle == pytest.approx(dict.fromkeys(HEIGHTS, 0.15), abs=1e-12)


@given(designs, modes, st.floats(0, 2 * math.pi))
def test_parasitic_motion_is_first_order_in_the_tilts(params, mode, direction):
    """x = H beta and y = -H gamma, all links up; in general by the three tangential equations."""
    small = 1e-5
    beta, gamma = small * math.cos(direction), small * math.sin(direction)
    rise = math.sqrt(params["L"] ** 2 - (params["Ra"] - params["Rb"]) ** 2)
    rows = [[t[0], t[1], params["Ra"]] for t in TANGENTIAL]
    right = [
        rise * s * (t[0] * beta - t[1] * gamma)
        for s, t in zip(SIGNS[mode], TANGENTIAL, strict=True)
    ]
    wanted = np.linalg.solve(rows, right)
    if mode == "up-up-up":
        np.testing.assert_allclose(wanted, [rise * beta, -rise * gamma, 0], atol=1e-15)
    found = solutions(params, posed(0.3, beta, gamma))[mode].parasitic
    # Second order: some hundred times the square of the tilt in mixed modes of wide links.
    np.testing.assert_allclose(list(found.values()), wanted, rtol=0, atol=1000 * small**2)


@pytest.mark.parametrize("params", DESIGNS)
def test_no_other_solution_in_any_mode(params):
    """scipy from random starts finds what the inverse kinematics finds, and nothing else.

    Ra + Rb >= L: the platform turned half about z is out of the links' reach.
    """
    assert params["Ra"] + params["Rb"] >= params["L"]
    rng = np.random.default_rng(5)
    seen = 0
    for _ in range(4):
        beta, gamma = rng.uniform(-0.6, 0.6, 2)
        found = solutions(params, posed(0.35, beta, gamma))
        for mode, signs in SIGNS.items():
            function = misfit(params, beta, gamma, np.array(signs))
            wide = params["L"] * np.array([1, 1, 0]) + [0, 0, math.pi]
            roots = [root_from(function, u) for u in rng.uniform(-wide, wide, (12, 3))]
            for root in roots:
                if root is not None:
                    assert list(found[mode].parasitic.values()) == pytest.approx(root, abs=1e-7)
                    seen += 1
    assert seen > 150


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize("mode", SIGNS)
@pytest.mark.slow
def test_nothing_is_lost_on_the_way_from_level(params, mode):
    """Rays of tilt followed in small steps by scipy, until a link comes within 2 degrees of flat.

    The kernel takes ten steps in all.
    """
    constants = CUR.kernel_constants(params, mode, 1.0, FREE)
    signs = np.array(SIGNS[mode])
    furthest = 0.0
    for direction in np.radians([10, 100, 190, 280, 325]):
        root = np.zeros(3)
        for tilt in np.radians(np.arange(2, 79, 4)):
            beta, gamma = tilt * math.cos(direction), tilt * math.sin(direction)
            function = misfit(params, beta, gamma, signs)
            before, root = root, root_from(function, root)
            flat = (params["L"] * math.sin(math.radians(2))) ** 2
            # A jump is no following: the solution has ended.
            if root is None or function(root)[1].min() < flat or np.abs(root - before).max() > 0.3:
                break
            pose = posed(0.3, beta, gamma)
            assert list(solutions(params, pose)[mode].parasitic.values()) == pytest.approx(
                root, abs=1e-7
            )
            assert CUR.kernel(*pose.values(), constants)[0] >= 0
            furthest = max(furthest, tilt)
    assert furthest > math.radians(25)


@pytest.mark.parametrize("direction", [125, 235])
def test_margin_passes_zero_where_a_link_lies_flat(direction):
    """On rays where the solution goes on beyond: no jump, and no infinite slope as of a root.

    On others it meets another solution and ends, some tenths of a degree to two before.
    """
    constants = CUR.kernel_constants(DEFAULT, "up-up-up", 1.0, FREE)
    turns = np.linspace(0, math.radians(60), 401)
    direction = math.radians(direction)
    ray = [posed(0.3, t * math.cos(direction), t * math.sin(direction)) for t in turns]
    margins = np.array([CUR.kernel(*pose.values(), constants)[0] for pose in ray]) / DEFAULT["L"]
    assert margins[0] > 0.9
    end = int(np.argmax(margins < 0))
    assert end > 0
    # Some steps on either side: a root's margin would change by a tenth over the last of them.
    assert np.abs(np.diff(margins[end - 6 : end + 6])).max() < 0.015
    assert (margins[end:] < 0).all()
    for pose, there in ((ray[end - 1], True), (ray[end], False)):
        assert ("up-up-up" in solutions(DEFAULT, pose)) == there


@pytest.mark.parametrize("change", [{"Ra": 0.4}, {"Rb": 0.5, "Ra": 0.2}, {"Ra": 0.37, "L": 0.25}])
def test_impossible_dimensions(change):
    """|Ra - Rb| >= L: no link reaches the level platform."""
    params = CUR.resolve(change)
    assert abs(params["Ra"] - params["Rb"]) >= params["L"]
    lower, upper = CUR.reach_box(params, CUR.default_limits(params))
    assert (lower >= upper).all()
    constants = ready(CUR, params, "up-up-up")
    rng = np.random.default_rng(3)
    for values in rng.uniform([0, -1.5, -3], [0.6, 1.5, 3], (50, 3)).tolist():
        assert CUR.inverse(params, posed(*values)) == ()
        assert CUR.kernel(*values, constants)[0] < 0
    assert CUR.inverse(params, CUR.home(params)) == ()


# --- limits -------------------------------------------------------------------------------

LIMITS = {
    **dict.fromkeys(HEIGHTS, (-0.6, 0.9)),
    "h2": (-0.1, 0.5),
    "theta4": (-1.1, 0.8),
    "theta5": (-2.6, 2.4),
    "elevation": (math.radians(-76), math.radians(74)),
}


@pytest.mark.parametrize("mode", SIGNS)
def test_margin_is_the_limits_in_every_mode(mode):
    """Passive limits of either sign, each of them met alone."""
    params = sized(0.2, 0.12, 0.25, 0.03)
    sets = [LIMITS] + [{**FREE, name: LIMITS[name]} for name in LIMITS]
    inside = np.zeros(len(sets), int)
    near = {
        **FREE, **dict.fromkeys(HEIGHTS, (-0.6, 0.9)),
        "elevation": (-math.pi / 2, math.pi / 2),
    }  # fmt: skip
    lower, upper = CUR.reach_box(params, near)
    # Tilts that the limits cut: up to 50 degrees.
    lower, upper = np.maximum(lower, [-9, -0.9, -0.9]), np.minimum(upper, [9, 0.9, 0.9])
    constants = [CUR.kernel_constants(params, mode, 1.0, limits) for limits in sets]
    total = 0
    for values in np.random.default_rng(8).uniform(lower, upper, (120, 3)).tolist():
        found = solutions(params, posed(*values)).get(mode)
        total += found is not None
        for k, limits in enumerate(sets):
            kept = found is not None and all(
                within(v, limits[n.split("_")[0]], "length" if n in HEIGHTS else "angle")
                for n, v in (found.joints | found.passive).items()
                if n.split("_")[0] in limits
            )
            assert (CUR.kernel(*values, constants[k])[0] >= 0) == kept
            inside[k] += kept
    assert total > 60
    assert 0 < inside[0] < total
    assert (inside < total).sum() >= 5, inside


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize(
    ("mode", "change"),
    [
        ("up-up-up", {}),
        ("up-up-up", {"h1": (0.1, 0.2), "elevation": (-1.5, 1.42)}),
        ("down-down-down", {"elevation": (-1.2, -0.2), "theta5": (-math.pi, math.pi)}),
        ("up-down-up", {**dict.fromkeys(HEIGHTS, (-0.4, 0.6)), "elevation": (-1.45, 1.5),
                        "theta5": (-3.0, 3.0), "theta4": (-1.2, 1.2)}),
    ],
)  # fmt: skip
def test_reach_box_cuts_nothing_off(params, mode, change):
    """Poses from a box far wider than it, all kept ones lie within."""
    limits = {**CUR.default_limits(params), **change}
    lower, upper = CUR.reach_box(params, limits)
    assert (lower[1:] <= [-math.pi / 2, -math.pi]).all()
    assert (upper[1:] >= [math.pi / 2, math.pi]).all()
    settings = WorkspaceSettings(limits=change, working_mode=mode)
    sampler = make_sampler(CUR, settings)
    wide = np.array([1.2, 1.5, 1.5])
    poses = np.random.default_rng(6).uniform(-wide, wide, (200_000, 3)).T
    met = poses[0, sampler.evaluator.field(sampler.design(params), poses)[0] >= 0]
    assert len(met) > 30
    assert lower[0] <= met.min()
    assert met.max() <= upper[0]


def test_reach_box_needs_sliders_with_ends():
    with pytest.raises(InputError, match="h1, h2 and h3 need bounds"):
        CUR.reach_box(DEFAULT, {"h1": (0.0, 0.3)})


def test_reach_tells_the_end_of_the_stroke():
    home = CUR.home(DEFAULT)
    for told in CUR.reach(DEFAULT, home):  # flat is nearer than the stroke's end
        assert told.distance == pytest.approx(0.15, abs=1e-12)
    low, high = (CUR.reach(DEFAULT, {**home, "z": home["z"] + d})[0] for d in (-0.2, 0.2))
    assert (low.reason, high.reason) == ("too close", "too far")
    assert low.distance == pytest.approx(-0.05, abs=1e-12) == high.distance


def test_volume_of_another_design_by_sampling_and_by_integration():
    """As in test_published_numbers.py, with other sizes and limits, on a coarse grid."""
    params = CUR.resolve({"Ra": 0.25, "Rb": 0.15, "L": 0.35})
    change = {"h2": (0.05, 0.35), "theta4": (-0.5, 0.6)}
    volume, error = CUR.decoupled_volume(params, {**CUR.default_limits(params), **change}, 2.0)
    settings = WorkspaceSettings(limits=change, samples=400_000)
    sampled = compute_workspace(CUR, params, settings, shape_grid=0).volume
    assert 0 < error < 0.01 * volume
    assert abs(sampled.value - volume) < 3 * math.hypot(sampled.error, error)


# --- assembly modes -----------------------------------------------------------------------


def place_of(params, solution):
    """Return Rot and P over L of a solution of the forward kinematics."""
    rotation = rotation_of(
        solution.parasitic["alpha"], solution.pose["beta"], solution.pose["gamma"]
    )
    centre = np.array([solution.parasitic["x"], solution.parasitic["y"], solution.pose["z"]])
    return rotation, centre / params["L"]


@pytest.mark.parametrize(
    ("params", "mode", "pose"),
    [
        (DESIGNS[0], "up-up-up", (0.33, 0.3, -0.25)),
        (DESIGNS[0], "up-down-up", (0.2, -0.15, 0.1)),
        (DESIGNS[1], "up-up-up", (0.4, -0.2, 0.35)),
        (DESIGNS[1], "down-up-down", (0.1, 0.1, 0.2)),
        (DESIGNS[2], "down-down-down", (0.0, 0.2, 0.3)),
    ],
)
def test_inverse_then_forward(params, mode, pose):
    """The pose comes back; every solution closes and is another one, nearest to home first."""
    pose = posed(*pose)
    joints = solutions(params, pose)[mode].joints
    found = CUR.forward(params, joints)
    assert min(max(abs(f.pose[k] - pose[k]) for k in pose) for f in found) < 1e-8
    places = []
    home = CUR.home(params)
    away = []
    for one in found:
        assert tuple(one.pose) == NAMES
        assert one.residual < 1e-10
        assert abs(one.pose["beta"]) <= math.pi / 2
        *_, limbs = limbs_of(params, one.pose, one.parasitic, joints)
        for _, _, e, w in limbs:
            assert abs(e @ w) < 1e-9
            assert np.linalg.norm(w) == pytest.approx(params["L"], abs=1e-9)
        places.append(np.hstack([part.ravel() for part in place_of(params, one)]))
        turns = (one.pose["beta"], one.pose["gamma"], one.parasitic["alpha"])
        away.append(math.hypot(one.pose["z"] - home["z"], *(params["Rb"] * t for t in turns)))
    for i, one in enumerate(places):
        assert all(np.abs(one - other).max() > 1e-6 for other in places[:i])
    assert away == sorted(away)


def test_forward_finds_as_many_as_a_dense_search():
    """Assembly modes from 400 random starts by scipy, in Rot and P: none is missed."""
    heights = solutions(DEFAULT, posed(0.3, 0.1, -0.2))["up-up-up"].joints
    found = [place_of(DEFAULT, one) for one in CUR.forward(DEFAULT, heights)]
    length = DEFAULT["L"]
    feet = np.array([DEFAULT["Ra"] * r + h * Z for r, h in zip(RADIAL, heights.values(),
                                                                strict=True)])  # fmt: skip

    def residual(u):
        rotation = rotation_of(*u[3:])
        w = length * u[:3] + DEFAULT["Rb"] * np.array(RADIAL) @ rotation.T - feet
        e = np.array(TANGENTIAL) @ rotation.T
        return np.hstack([(e * w).sum(axis=1) / length, (w * w).sum(axis=1) / length**2 - 1])

    seen = set()
    wide = np.array([1, 1, 2, math.pi, math.pi / 2, math.pi])
    for start in np.random.default_rng(7).uniform(-wide, wide, (400, 6)):
        end, info, flag, _ = fsolve(residual, start, full_output=True, xtol=1e-12)
        if flag != 1 or np.abs(info["fvec"]).max() > 1e-9:
            continue
        rotation = rotation_of(*end[3:])
        gaps = [max(np.abs(rotation - r).max(), np.abs(end[:3] - p).max()) for r, p in found]
        assert min(gaps) < 1e-5
        seen.add(int(np.argmin(gaps)))
    assert len(found) == len(seen) == 8


def test_forward_out_of_reach():
    assert CUR.forward(DEFAULT, {"h1": 0.0, "h2": 0.0, "h3": 3.0}) == ()


# --- velocities ---------------------------------------------------------------------------


@given(designs, poses, modes)
def test_velocity_maps_equal_finite_differences(params, pose, mode):
    solution = solved(params, pose, mode)
    assume(away_from_flat(params, pose, solution))
    j_x, j_q = CUR.velocity_maps(params, pose, solution.joints)
    jacobian = np.linalg.solve(j_q, j_x)
    assume(np.abs(jacobian).max() < 10)  # far from where x, y, alpha cannot follow
    expected = slopes(heights_of(params, mode), pose)
    np.testing.assert_allclose(jacobian, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@given(designs, poses, modes)
def test_full_map_tells_the_sliders_rates_and_the_constraints(params, pose, mode):
    """Fed with (v, omega) of each pose coordinate: 0, then w_z h'."""
    solution = solved(params, pose, mode)
    assume(away_from_flat(params, pose, solution))
    rates = slopes(heights_of(params, mode), pose)
    assume(np.abs(rates).max() < 10)
    motion = slopes(lambda p: np.column_stack(CUR.platform(params, p, mode)), pose)
    rotation, _, limbs = limbs_of(params, pose, solution.parasitic, solution.joints)
    constraint, drive, heights, _ = CUR.full_map(params, pose, solution.joints)
    assert heights == pytest.approx([w[2] for *_, w in limbs], abs=1e-12)
    for k in range(3):
        spin = motion[:, :3, k] @ rotation.T
        twist = [*motion[:, 3, k], spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(constraint @ twist, 0, rtol=0, atol=1e-7)
        np.testing.assert_allclose(drive @ twist, heights * rates[:, k], rtol=0, atol=1e-7)


@given(designs, poses, modes, st.sampled_from([1.0, 0.12, 0.037]))
def test_kernel_entries_are_the_homogenised_inverse_jacobian(params, pose, mode, length):
    """Up to the product of det F and the links' heights."""
    solution = solved(params, pose, mode)
    assume(away_from_flat(params, pose, solution, 0.02))
    constants = CUR.kernel_constants(params, mode, length, FREE)
    margin, *entries = CUR.kernel(*pose.values(), constants)
    assert margin >= 0
    j_x, j_q = CUR.velocity_maps(params, pose, solution.joints)
    inverse = np.linalg.solve(j_q, j_x) / [1.0, length, length]
    found = np.reshape(entries, (3, 3))
    np.testing.assert_allclose(
        found, found[0, 0] * inverse, rtol=0, atol=1e-9 * np.abs(found).max()
    )


@given(designs, poses, modes)
def test_measures_are_those_of_the_rows(params, pose, mode):
    """w_z / L by limb, the determinant of unit rows with moments over Rb, their volume."""
    solution = solved(params, pose, mode)
    *_, limbs = limbs_of(params, pose, solution.parasitic, solution.joints)
    rows = []
    for _, b, e, w in limbs:
        force = np.cross(np.cross(e, w), Z)  # w_z e - e_z w: horizontal
        rows.append([*force, *np.cross(b - w, force)])
    rows += [[*w, *np.cross(b, w)] for _, b, _, w in limbs]
    rows = np.array(rows) / np.repeat([1, params["Rb"]], 3)
    norms = np.linalg.norm(rows, axis=1, keepdims=True)
    assume(norms.min() > 1e-3 * params["L"])
    rows /= norms
    found = CUR.singularity_measures(params, pose, solution.joints)
    assert list(found["inverse"].values()) == pytest.approx(
        [w[2] / params["L"] for *_, w in limbs], abs=1e-9
    )
    assert abs(found["forward"]["platform"]) == pytest.approx(abs(np.linalg.det(rows)), abs=1e-7)
    volume = np.prod(np.linalg.svd(rows[:3], compute_uv=False))
    assert found["constraint"]["platform"] == pytest.approx(volume, abs=1e-7)


# --- joints -------------------------------------------------------------------------------


@given(designs, poses, modes)
def test_passive_joints_lead_from_the_column_to_the_platform(params, pose, mode):
    """Turned by theta2 .. theta5 one after another, the limb's frame ends at the platform."""
    solution = solved(params, pose, mode)
    assume(away_from_flat(params, pose, solution, 0.01))
    rotation, _, limbs = limbs_of(params, pose, solution.parasitic, solution.joints)
    for k, (_, _, e, w) in enumerate(limbs):
        theta2, theta3, theta4, theta5 = (
            solution.passive[f"theta{n}_{k + 1}"] for n in (2, 3, 4, 5)
        )
        first = turn(Z, theta2) @ TANGENTIAL[k]
        link = turn(-first, theta3) @ np.cross(first, Z)
        second = np.cross(first, link)
        axis = turn(second, theta4) @ first
        np.testing.assert_allclose(axis, e, rtol=0, atol=1e-8)
        direction = np.cross(second, axis)
        np.testing.assert_allclose(params["L"] * direction, w, rtol=0, atol=1e-8)
        radial = turn(axis, theta5) @ direction
        np.testing.assert_allclose(radial, rotation @ RADIAL[k], rtol=0, atol=1e-8)
        elevation = solution.passive[f"elevation_{k + 1}"]
        assert elevation == pytest.approx(math.atan2(w[2], math.hypot(w[0], w[1])), abs=1e-7)
        assert abs(theta4) <= math.pi / 2


def screws(joint):
    """Return the elementary freedoms of a joint: (is a turn, axis)."""
    if joint.kind == "C":
        return [(True, joint.axes[0]), (False, joint.axes[0])]
    return [(True, axis) for axis in joint.axes]


def moved(chain, values):
    """Return where a product of exponentials takes the platform: rotation and shift of points."""
    rotation, shift = np.eye(3), np.zeros(3)
    steps = iter(values)
    for joint in chain.joints:
        for is_turn, axis in screws(joint):
            value = next(steps)
            r = turn(axis, value) if is_turn else np.eye(3)
            d = joint.point - r @ joint.point if is_turn else value * axis
            rotation, shift = rotation @ r, rotation @ d + shift
    return rotation, shift


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize("mode", ["up-up-up", "down-up-down"])
def test_layout_carries_the_platform_along(params, mode):
    """Some motion of each limb's joints takes the platform to a pose some way off, exactly.

    The slider then has moved by what the inverse kinematics says, the passive joints by theirs.
    """
    here, there = posed(0.3, 0.1, -0.12), posed(0.33, -0.05, 0.07)
    (r0, p0), (r1, p1) = (CUR.platform(params, pose, mode) for pose in (here, there))
    before, after = (solutions(params, pose)[mode] for pose in (here, there))
    wanted = r1 @ r0.T
    for k, (chain, limb) in enumerate(zip(CUR.layout(params, here, mode), CUR.limbs, strict=True)):
        assert chain.name == limb.name
        assert "".join(j.kind for j in chain.joints) == limb.joints

        def gap(values, chain=chain):
            rotation, shift = moved(chain, values)
            return np.hstack([(rotation - wanted).ravel(), rotation @ p0 + shift - p1])

        end = least_squares(gap, np.zeros(5), xtol=1e-15, ftol=1e-15, gtol=1e-15)
        assert np.abs(end.fun).max() < 1e-10
        name = HEIGHTS[k]
        assert chain.joints[0].drive == (name, 1)
        change = after.joints[name] - before.joints[name]
        assert end.x[1] == pytest.approx(change, abs=1e-8)
        change = after.passive[f"theta5_{k + 1}"] - before.passive[f"theta5_{k + 1}"]
        assert abs(end.x[4]) == pytest.approx(abs(change), abs=1e-8)


@pytest.mark.parametrize("params", DESIGNS)
@pytest.mark.parametrize("mode", ["up-up-up", "down-down-down", "up-up-down"])
def test_layout_and_skeleton_join_the_points(params, mode):
    """C on the columns, U on the sliders, R at the platform; segments and cones."""
    constants = CUR.kernel_constants(params, mode, 1.0, FREE)
    home = CUR.home(params)
    at_home = solutions(params, home)[mode]
    *_, limbs_home = limbs_of(params, home, at_home.parasitic, at_home.joints)
    seen = 0
    for pose in random_poses(CUR, params, 12, seed=3):
        pose = {**pose, "beta": 0.4 * pose["beta"], "gamma": 0.2 * pose["gamma"]}
        solution = solutions(params, pose).get(mode)
        if solution is None:
            continue
        seen += 1
        rotation, centre, limbs = limbs_of(params, pose, solution.parasitic, solution.joints)
        flat = np.array(CUR.skeleton(*pose.values(), constants))
        assert len(flat) == 12 + 6 * len(CUR.segments) + len(CUR.cones)
        np.testing.assert_allclose(flat[:3], centre, rtol=0, atol=1e-12)
        np.testing.assert_allclose(flat[3:12], rotation.ravel(), rtol=0, atol=1e-12)
        segments = flat[12:48].reshape(6, 2, 3)
        chains = CUR.layout(params, pose, mode)
        for k, (a, b, e, w) in enumerate(limbs):
            slider = a + (solution.joints[HEIGHTS[k]] + params["d1"]) * Z
            end = centre + b
            np.testing.assert_allclose(segments[k], [slider, end], rtol=0, atol=1e-10)
            np.testing.assert_allclose(segments[3 + k], [centre, end], rtol=0, atol=1e-10)
            cone = w @ limbs_home[k][3] / params["L"] ** 2
            assert flat[48 + k] == pytest.approx(cone, abs=1e-10)
            column, cross, last = chains[k].joints
            np.testing.assert_allclose(column.point[:2], a[:2], rtol=0, atol=1e-12)
            np.testing.assert_array_equal(column.axes, [Z])
            np.testing.assert_allclose([cross.point, last.point], [slider, end], atol=1e-10)
            np.testing.assert_allclose(last.axes, [e], rtol=0, atol=1e-12)
            first, second = cross.axes
            # First across the column, second across the link and the R joint's axis.
            np.testing.assert_allclose([first[2], first @ second, second @ w, second @ e], 0,
                                       atol=1e-9)  # fmt: skip
            np.testing.assert_allclose([first @ first, second @ second], 1, rtol=1e-9)
            assert first @ e > 0
    assert seen >= 6


def test_literal_layout_lacks_the_second_axis():
    chains = CUR.alternative_layout(DEFAULT, "literal")
    assert ["".join(j.kind for j in chain.joints) for chain in chains] == ["CRR"] * 3
    with pytest.raises(InputError, match="nonsense"):
        CUR.alternative_layout(DEFAULT, "nonsense")
