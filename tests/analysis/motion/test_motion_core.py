"""A motion along a trajectory: joint space, infeasible instants, singularities on the way."""

import math

import numpy as np
import pytest
from support.courses import MOVED, course

from pmopt.analysis.motion.motion import Loads, compute_motion
from pmopt.analysis.motion.records import Trajectory
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.mechanisms.bodies import plate

T = np.linspace(0.0, 2.0, 81)


def along(*functions, t=T, space="task"):
    """Return a trajectory from functions of t, differentiated by Fourier-exact complex steps."""
    h = 1e-3
    values = np.stack([f(t) for f in functions], axis=1)
    ends = [np.stack([f(t + k * h) for f in functions], axis=1) for k in (-2, -1, 1, 2)]
    rates = (ends[0] - 8 * ends[1] + 8 * ends[2] - ends[3]) / (12 * h)
    changes = (-ends[0] + 16 * ends[1] - 30 * values + 16 * ends[2] - ends[3]) / (12 * h * h)
    return Trajectory(space, t, values, rates, changes)


def paper_4_ups_rps(gamma, t):
    tilt = math.pi / 36
    return along(
        lambda t: 900 + 50 * np.cos(2 * t), lambda t: 50 * np.sin(2 * t),
        lambda t: tilt * (t - 1), lambda t: tilt * (t - 1), lambda t: 0 * t + gamma, t=t,
    )  # fmt: skip


@pytest.mark.parametrize("name", MOVED)
def test_joint_space_comes_back_to_the_same_motion(name):
    mechanism = find(name)
    # 3-UPS/SP's singular wall is near.
    given = course(name, T, swing=0.05)
    task = compute_motion(mechanism, None, Trajectory("task", T, *given))
    assert task.infeasible == ()
    joints = Trajectory(
        "joint", T, task.joints.values, task.joints.rates, task.joints.accelerations
    )
    back = compute_motion(mechanism, None, joints)
    for first, second in ((task.pose, back.pose), (task.parasitic, back.parasitic)):
        for field in ("values", "rates", "accelerations"):
            given = getattr(first, field)
            if given.size:
                np.testing.assert_allclose(
                    getattr(second, field), given, rtol=0, atol=1e-8 * (np.abs(given).max() + 1e-3)
                )
    np.testing.assert_allclose(
        back.effort, task.effort, rtol=0, atol=1e-7 * np.abs(task.effort).max()
    )


def test_a_singular_wall_on_the_way_is_told_at_an_instant_and_between_two():
    at = compute_motion(find("4-ups-rps"), None, paper_4_ups_rps(0.0, np.linspace(0, 2, 201)))
    (span,) = at.infeasible
    assert (span.what, span.first, span.last) == ("singularity", 100, 100)
    assert np.isnan(at.effort[100]).all()
    assert np.isfinite(at.effort[[99, 101]]).all()
    times = np.linspace(0.005, 1.995, 200)
    between = compute_motion(find("4-ups-rps"), None, paper_4_ups_rps(0.0, times))
    (span,) = between.infeasible
    assert (span.what, span.first, span.last) == ("singularity", 99, 100)
    assert "between t = 0.995 s and t = 1.005 s" in span.text
    home = compute_motion(find("4-ups-rps"), None, paper_4_ups_rps(math.pi / 2, times))
    assert home.infeasible == ()
    assert np.nanmax(np.abs(home.effort)) < 400


def test_the_printed_equation_16_says_where_and_by_how_much():
    deg = math.pi / 180
    t = np.arange(2401) * 0.01
    printed = along(
        lambda t: 0.175 + 0.025 * np.sin(math.pi * t / 6),
        lambda t: deg * (20 * np.sin(math.pi * t / 6 - math.pi / 3) + 3),
        lambda t: deg * (25 * np.cos(math.pi * t / 8) + 10), t=t,
    )  # fmt: skip
    motion = compute_motion(find("2uu-upu"), None, printed)
    reasons = {span.what for span in motion.infeasible}
    assert reasons == {"limb 2", "l1"}
    stroke = next(span for span in motion.infeasible if span.what == "l1")
    l1 = float(stroke.text.split()[2])
    assert stroke.miss == pytest.approx(0.16 - l1, abs=1e-6)
    out = np.isnan(motion.pose.values[:, 0]) | np.isnan(motion.effort[:, 0])
    told = np.zeros(len(t), dtype=bool)
    for span in motion.infeasible:
        told[span.first : span.last + 1] = True
    np.testing.assert_array_equal(out, told)


def test_limits_are_told_by_their_name():
    trajectory = Trajectory("task", T, *course("2pauu-ppap", T))
    free = compute_motion(find("2pauu-ppap"), None, trajectory)
    theta = free.joints.values[:, 0]
    low, high = float(theta.min()) + 0.05, float(theta.max()) + 1.0
    motion = compute_motion(find("2pauu-ppap"), None, trajectory, limits={"theta1": (low, high)})
    assert {span.what for span in motion.infeasible} == {"theta1"}
    assert max(span.miss for span in motion.infeasible) == pytest.approx(0.05, abs=1e-6)


def test_joints_that_can_not_be_assembled_are_told():
    trajectory = along(lambda t: 0.1 + 0.4 * t, lambda t: 0.1 + 0 * t, lambda t: 0.1 + 0 * t,
                       space="joint")  # fmt: skip
    motion = compute_motion(find("3-cur"), None, trajectory)
    assert "assembly" in {span.what for span in motion.infeasible}
    assert np.isnan(motion.pose.values[-1]).all()
    start = along(*[lambda t, k=k: 5.0 * k + 0 * t for k in range(3)], space="joint")
    (span,) = compute_motion(find("3-cur"), None, start).infeasible
    assert (span.what, span.first, span.last) == ("assembly", 0, len(T) - 1)


def test_payload_and_gravity_change_efforts_and_no_bodies_means_none():
    mechanism = find("3-cur")
    trajectory = Trajectory("task", T, *course("3-cur", T))
    plain = compute_motion(mechanism, None, trajectory)
    load = plate((0.1, 0.1, 0.1), 1.0)
    loaded = compute_motion(mechanism, None, trajectory, loads=Loads(payload=load))
    assert (loaded.effort.sum(axis=1) > plain.effort.sum(axis=1) + 5 * load.mass).all()
    floating = compute_motion(mechanism, None, trajectory, loads=Loads(gravity=(0, 0, 0)))
    np.testing.assert_allclose(floating.potential, 0)
    bare = compute_motion(mechanism, None, trajectory, loads=Loads(bodies=()))
    assert bare.effort is None
    assert bare.power is None
    assert bare.centres == {}


def test_a_body_on_a_joint_that_is_not_there_is_refused():
    body = plate((0.1, 0.1, 0.1), 1.0).body("extra", limb=0, joint=7)
    with pytest.raises(InputError, match="'extra': 3-cur has no joint 7 in limb 0"):
        compute_motion(
            find("3-cur"),
            None,
            Trajectory("task", T, *course("3-cur", T)),
            loads=Loads(bodies=(body,)),
        )


def test_gimbal_lock_is_told_apart_from_a_singularity():
    """Pitch at 90 degrees: the platform is held, its angles do not tell how it moves."""
    zero, quarter = np.zeros_like(T), np.pi / 2
    values = np.stack([zero + 0.3, quarter * T, zero + 0.2, zero + 60.0], axis=1)
    rates = np.stack([zero, zero + quarter, zero, zero], axis=1)
    trajectory = Trajectory("task", T, values, rates, np.zeros_like(values))
    wide = {f"l{k}": (1.0, 1000.0) for k in range(1, 5)}
    for efforts in (True, False):
        loads = Loads(efforts=efforts)
        motion = compute_motion(find("3-ups-sp"), None, trajectory, limits=wide, loads=loads)
        lock = [span for span in motion.infeasible if span.what == "coordinates"]
        assert [(span.first, span.last) for span in lock] == [(40, 40)]
        assert np.isnan(motion.joints.values[40]).all()
        assert np.isfinite(motion.joints.rates[39]).all()
