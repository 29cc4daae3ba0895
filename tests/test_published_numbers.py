"""Numbers of 3-CUR, 3-UPS/SP, 4-UPS-RPS and 2UU-UPS, derived twice by hand, to all their digits.

Tolerance: half a unit of the tenth digit after the point, a little more where a difference of
rounded inputs stands in the reference.
"""

import math

import numpy as np
import pytest

from pmopt.mechanisms import find

DIGITS = 1.2e-10


def inverse(name, pose, change=None):
    mechanism = find(name)
    params = mechanism.resolve(change or {})
    named = dict(zip((c.name for c in mechanism.pose), pose, strict=True))
    return mechanism, params, named, mechanism.inverse(params, named)[0]


def jacobian_by_differences(mechanism, params, pose, mode):
    """Return d(joints) / d(pose) from the inverse kinematics."""

    def joints(at):
        (found,) = [s for s in mechanism.inverse(params, at) if s.working_mode == mode]
        return np.array(list(found.joints.values()))

    columns = []
    for c in mechanism.pose:
        step = 1e-6 if c.kind == "angle" else 1e-6 * mechanism.characteristic_length(params)
        ends = [joints({**pose, c.name: pose[c.name] + s}) for s in (step, -step)]
        columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=1)


def test_jacobians_against_finite_differences(mechanism):
    params = mechanism.resolve({})
    home = mechanism.home(params)
    rng = np.random.default_rng(3)
    size = mechanism.characteristic_length(params)
    for mode in mechanism.working_modes[:3]:
        for _ in range(6):
            pose = {
                c.name: home[c.name] + rng.uniform(-0.1, 0.1) * (size if c.kind == "length" else 1)
                for c in mechanism.pose
            }
            found = [s for s in mechanism.inverse(params, pose) if s.working_mode == mode]
            if not found:
                continue
            j_x, j_q = mechanism.velocity_maps(params, pose, found[0].joints)
            wanted = jacobian_by_differences(mechanism, params, pose, mode)
            # Difference quotients: curvature times the step, rounding over it.
            np.testing.assert_allclose(
                np.linalg.solve(j_q, j_x), wanted, atol=2e-6 * np.abs(wanted).max()
            )


# --- 3-CUR --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pose", "parasitic", "heights"),
    [
        (
            (0.3, 0.1, -0.2),
            (0.0251248178, 0.0488161288, -0.0098756562),
            (0.0489538259, 0.0448742129, 0.1179643441),
        ),
        (
            (0.35, 0.25, 0.15),
            (0.0564790354, -0.0380114305, 0.0211446589),
            (0.0743604840, 0.1787056007, 0.1213653580),
        ),
    ],
)
def test_cur_inverse(pose, parasitic, heights):
    _, _, _, found = inverse("3-cur", pose)
    assert list(found.parasitic.values()) == pytest.approx(parasitic, abs=DIGITS)
    assert list(found.joints.values()) == pytest.approx(heights, abs=DIGITS)


def test_cur_passive_joints():
    *_, found = inverse("3-cur", (0.3, 0.1, -0.2))
    wanted = (0.0548969216, 1.7880988258, -0.2038464447, 1.8945654343)
    assert [found.passive[f"theta{k}_1"] for k in (2, 3, 4, 5)] == pytest.approx(wanted, abs=DIGITS)


def test_cur_twists_of_the_sliders():
    mechanism, params, pose, found = inverse("3-cur", (0.3, 0.1, -0.2))
    constraint, drive, heights, _ = mechanism.full_map(params, pose, found.joints)
    right = np.vstack([np.zeros((3, 3)), np.diag(heights)])
    wanted = [
        [-0.7472918216, 0.3799242233, 0.3673675984],
        [0.0073258509, -0.6375553365, 0.6302294857],
        [0.4267754838, 0.4430255680, 0.1301989482],
        [-0.2743140819, 2.7745083240, -2.5001942421],
        [-3.340753052, 1.9068873707, 1.4338656813],
        [0.3865543178, -0.3740184721, -0.0125358457],
    ]
    twists = np.linalg.solve(np.vstack([constraint, drive]), right)
    np.testing.assert_allclose(twists, wanted, atol=2e-9)


def test_cur_workspace():
    """0.1869 m rad^2 on a grid of 2 degrees, .1954 without the passive joints' limits."""
    mechanism = find("3-cur")
    params = mechanism.resolve({})
    strokes = {k: v for k, v in mechanism.default_limits(params).items() if k.startswith("h")}
    assert mechanism._integrated(params, None, 2.0) == pytest.approx(0.186928, abs=5e-7)
    assert mechanism._integrated(params, strokes, 2.0) == pytest.approx(0.1954, abs=5e-5)


@pytest.mark.slow
def test_cur_workspace_by_sampling_and_by_integration():
    from pmopt.analysis.workspace.compute import compute_workspace

    mechanism = find("3-cur")
    volume, error = mechanism.decoupled_volume(mechanism.resolve({}))
    assert volume == pytest.approx(0.187077, abs=5e-7)
    sampled = compute_workspace(mechanism, shape_grid=0).volume
    assert abs(sampled.value - volume) < 3 * math.hypot(sampled.error, error)


def test_cur_modes_are_eight_and_all_assemble():
    mechanism, params, pose, _ = inverse("3-cur", (0.3, 0.1, -0.2))
    solutions = mechanism.inverse(params, pose)
    assert [s.working_mode for s in solutions] == list(mechanism.working_modes)
    for s in solutions:
        found = mechanism.forward(params, s.joints)
        gaps = [max(abs(f.pose[k] - pose[k]) for k in pose) for f in found]
        assert min(gaps) < 1e-8


# --- 3-UPS/SP -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pose", "centre", "lengths"),
    [
        ((0, 0, 0, 45), (-7.5, -7.5, 45), (47.4341649025, 49.7493718553, 47.4341649025, 45)),
        (
            (0.1, 0.2, -0.15, 60),
            (1.8014664744, 3.3852694264, 54.6924026984),
            (55.6911224861, 51.8554595858, 56.0795357517, 60),
        ),
    ],
)
def test_ups_sp_inverse(pose, centre, lengths):
    mechanism, params, named, found = inverse("3-ups-sp", pose)
    assert mechanism.platform(params, named)[1] == pytest.approx(centre, abs=DIGITS)
    assert list(found.joints.values()) == pytest.approx(lengths, abs=DIGITS)


def smallest_singular_value(mechanism, params, pose):
    return np.linalg.svd(mechanism.velocity_maps(params, pose, {})[0], compute_uv=False)[-1]


@pytest.mark.parametrize("phi", np.linspace(-0.6, 0.6, 7))
@pytest.mark.parametrize("twist", [0.0, 0.6])
def test_ups_sp_squares_are_singular_when_level(phi, twist):
    mechanism = find("3-ups-sp")
    params = mechanism.resolve({"twist": twist})
    for l4 in (45.0, 60.0, 90.0):
        pose = {"phi": float(phi), "theta": 0.0, "psi": 0.0, "l4": l4}
        assert smallest_singular_value(mechanism, params, pose) < 1e-13


def test_ups_sp_kite_is_regular_when_level():
    mechanism = find("3-ups-sp")
    params = mechanism.resolve({"kite": 0.6})
    for phi in (0.3, -0.3):
        pose = {"phi": phi, "theta": 0.0, "psi": 0.0, "l4": 60.0}
        assert smallest_singular_value(mechanism, params, pose) == pytest.approx(0.91, abs=0.005)
    assert smallest_singular_value(mechanism, params, {**pose, "phi": 0.0}) < 1e-13


# --- 4-UPS-RPS ----------------------------------------------------------------------------

T5 = -math.pi / 36
QUARTER = math.pi / 2
HUNG = [
    ((900, 0, 0, 0, QUARTER), 0,
     (1036.9305666244, 1017.1777228818, 1004.7174588946, 1004.7174588946, 1017.1777228818)),
    ((950, 0, T5, T5, 0), 201.2313290145,
     (1205.1648814239, 1056.3768541278, 1111.3116223134, 1282.1937663912, 1286.5148540868)),
    ((950, 0, T5, T5, QUARTER), 0,
     (1096.4842216191, 1051.3550702153, 1028.1587920168, 1046.2498533585, 1082.3095872821)),
    ((900, 30, 0.05, -0.08, QUARTER + 0.1), -20.1018522520,
     (1012.7607946713, 1001.8159928834, 1023.9381582852, 1023.3892234003, 1005.5554574693)),
]  # fmt: skip


@pytest.mark.parametrize(("pose", "z", "lengths"), HUNG)
def test_ups_rps_inverse_and_forward(pose, z, lengths):
    mechanism, params, named, found = inverse("4-ups-rps", pose)
    assert found.parasitic["z"] == pytest.approx(z, abs=DIGITS)
    assert list(found.joints.values()) == pytest.approx(lengths, abs=DIGITS)
    modes = mechanism.forward(params, found.joints)
    assert min(max(abs(m.pose[k] - named[k]) for k in named) for m in modes) < 1e-6


def full(pose):
    mechanism = find("4-ups-rps")
    params = mechanism.resolve({})
    named = dict(zip((c.name for c in mechanism.pose), pose, strict=True))
    rows = mechanism.full_map(params, named)
    rows[:, 3:] /= 202
    return rows


def test_ups_rps_wall_of_level_poses():
    for x, y in ((900, 0), (800, 120), (1000, -60)):
        assert np.linalg.svd(full((x, y, 0, 0, 0)), compute_uv=False)[-1] < 1e-13
    home = np.linalg.svd(full((900, 0, 0, 0, QUARTER)), compute_uv=False)[-1]
    assert home == pytest.approx(0.07, abs=0.005)


@pytest.mark.parametrize(("gamma", "crosses"), [(0.0, True), (QUARTER, False)])
def test_ups_rps_trajectory_of_the_paper(gamma, crosses):
    """At gamma = 0 the determinant changes sign at t = 1 s; turned a quarter it never does."""

    def determinant(t):
        tilt = math.radians(5) * (t - 1)
        return np.linalg.det(
            full((900 + 50 * math.cos(2 * t), 50 * math.sin(2 * t), tilt, tilt, gamma))
        )

    times = np.linspace(0, 2, 201)
    signs = np.sign([determinant(t) for t in times if abs(t - 1) > 1e-9])
    assert (signs[0] != signs[-1]) == crosses
    assert (np.abs(np.diff(signs)) > 0).sum() == int(crosses)


# --- 2UU-UPS ------------------------------------------------------------------------------

STATE = (0.0994700610, 0.1004292481, 0.0440972621)


def test_uu_upu_state():
    """From x, beta, gamma of ten digits: what follows differs by some units of the tenth."""
    mechanism, params, named, found = inverse("2uu-upu", STATE)
    assert found.joints["theta1"] == pytest.approx(0.4025836316, abs=2e-9)
    assert found.joints["phi"] == pytest.approx(0.5, abs=2e-9)
    assert found.joints["delta3"] == pytest.approx(0.4529319134, abs=2e-9)
    wanted = {"eta1": 0.4112843791, "l1": 0.2100670872, "delta2": 0.2796861593, "kappa": 0.05}
    for name, value in wanted.items():
        assert found.passive[name] == pytest.approx(value, abs=3e-9), name
    assert mechanism.platform(params, named)[1] == pytest.approx(
        (0.0994700610, 0.0874655011, 0.1950997181), abs=2e-9
    )


def test_uu_upu_trajectory():
    mechanism = find("2uu-upu")
    params = mechanism.resolve({})

    def at(t):
        pose = {
            "x": 0.175 + 0.025 * math.sin(math.pi * t / 6),
            "beta": math.radians(3 + 16 * math.sin(math.pi * t / 6 - math.pi / 3)),
            "gamma": math.radians(0.2 + 0.5 * math.cos(math.pi * t / 8)),
        }
        return mechanism.inverse(params, pose)[0]

    for t, q in (
        (0, (0.8677374626, 0.0185584334, -1.0573162488)),
        (5, (0.9584721777, 0.00024859047544, -0.6268596308)),
    ):
        found = at(t)
        values = (found.joints["phi"], found.passive["kappa"], found.passive["psi"])
        assert values == pytest.approx(q, abs=DIGITS)
    found = [at(t) for t in np.linspace(0, 48, 241)]
    assert {s.working_mode for s in found} == {mechanism.working_modes[0]}
    lengths = [s.passive["l1"] for s in found]
    assert min(lengths) == pytest.approx(0.1634, abs=2e-4)
    assert max(lengths) == pytest.approx(0.2727, abs=2e-4)
