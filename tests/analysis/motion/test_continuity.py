"""Joints along motions turn on: they do not jump by a turn, and keep their limits as they turn."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmopt.analysis.motion.config import resolve_motion
from pmopt.analysis.motion.continuity import continuous, in_limits
from pmopt.analysis.motion.motion import Loads, compute_motion
from pmopt.analysis.motion.summary import columns
from pmopt.analysis.motion.trajectories import plan_trajectory
from pmopt.mechanisms import find
from pmopt.reporting.runs.motion_run import run_motion

TURNING = {
    "mechanism": "2pauu-ppap",
    "working_mode": "in-in",
    "efforts": False,
    "parameters": {"m": 1.5, "n": 0.2, "l1": 0.5, "l2": 1.5},
    "trajectory": {"space": "joint", "duration": 2.0, "step": 0.01, "d": 0.0,
                   "theta1": "2.6 + 0.5*t", "theta2": "2.6 + 0.5*t"},
}  # fmt: skip


def motion_of(config):
    return run_motion(resolve_motion(config, "c", Path()))


def changed(base, **tables):
    return base | {k: {**base.get(k, {}), **v} for k, v in tables.items()}


@given(
    st.floats(-40, 40), st.floats(-3, 3), st.floats(0.05, 1.5), st.floats(0, 3), st.floats(0.2, 3)
)
def test_principal_angles_come_back(mean, offset, step, swing, speed):
    t = np.arange(0, 12, step)
    angle = offset + mean * t / 4 + swing * np.sin(speed * t)
    rate = mean / 4 + swing * speed * np.cos(speed * t)
    acceleration = -swing * speed**2 * np.sin(speed * t)
    principal = np.angle(np.exp(1j * angle))

    def between(first, last, shares):
        inner = t[first] + shares * (t[last] - t[first])
        value = offset + mean * inner / 4 + swing * np.sin(speed * inner)
        return np.angle(np.exp(1j * value))[:, None]

    found = continuous(t, principal[:, None], rate[:, None], acceleration[:, None], between)[:, 0]
    assert np.abs(found - found[0] - (angle - angle[0])).max() < 1e-9


def test_instants_that_are_not_known_are_passed_over():
    t = np.linspace(0, 4, 401)
    angle = 3 * t
    values = np.angle(np.exp(1j * angle))[:, None]
    values[100:110] = np.nan
    rate, none = np.full_like(values, 3.0), np.zeros_like(values)
    found = continuous(t, values, rate, none)[:, 0]
    known = np.isfinite(found)
    assert not known[100:110].any()
    assert np.abs(found - angle)[known].max() < 1e-9


@pytest.mark.parametrize(
    ("values", "limits", "turns"),
    [
        ([-3.0, -2.5], (2.0, 4.5), 1),
        ([3.0, 3.5], (2.0, 4.5), 0),
        ([3.0, 3.5], (-4.5, -2.0), -1),
        ([0.0, 7.0], (-10.0, 10.0), 0),
        ([0.0, 7.0], (-7.0, 3.0), -1),
        ([-3.0, 0.0], (2.0, 4.5), 1),
        ([0.0, 0.5], (2.0, 3.0), 0),
        ([3.0, 4.0], (-math.pi, 2.0), -1),
    ],
)
def test_the_turn_that_keeps_the_limits(values, limits, turns):
    found = in_limits(np.array(values), limits)
    assert np.allclose(found, np.array(values) + 2 * math.pi * turns)


def test_a_crank_turns_on_past_half_a_turn():
    run = motion_of(TURNING)
    series = columns(run.motion, run.task.mechanism)
    assert not run.infeasible
    for name in ("theta1", "theta2"):
        assert np.allclose(series[name].values, 2.6 + 0.5 * run.motion.t, atol=1e-12)
    bounds = {d.joint: (d.low, d.high) for d in run.demands if d.quantity == "position"}
    assert bounds["theta1"] == pytest.approx((2.6, 3.6))


@pytest.mark.parametrize(
    ("limits", "feasible"),
    [
        ({"theta1": [2.0, 4.5]}, True),
        ({"theta1": [2.0, 3.5]}, False),
        ({"theta1": [-4.0, 4.0]}, True),
        ({"theta1": [-4.0, 3.5]}, False),
        ({"theta1": [2.0, 9.5]}, True),
    ],
)
def test_limits_are_kept_as_the_joint_turns(limits, feasible):
    run = motion_of(changed(TURNING, limits=limits))
    assert bool(run.infeasible) != feasible
    if not feasible:
        assert run.infeasible[0].what == "theta1"
        beyond = run.infeasible[0].first
        assert run.motion.t[beyond] == pytest.approx(1.8, abs=0.011)


def recorded(run, folder, step):
    """The same motion in task space, from its poses as a file of rows."""
    pose = run.motion.pose
    names = [c.name for c in pose.coordinates]
    rows = [",".join(["t", *names])]
    table = np.column_stack([run.motion.t, pose.values]).tolist()
    rows += [",".join(map(repr, row)) for row in table]
    (folder / "p.csv").write_text("\n".join(rows))
    base = {k: v for k, v in TURNING.items() if k != "trajectory"}
    config = base | {"trajectory": {"file": "p.csv", "step": step}}
    return run_motion(resolve_motion(config, "c", folder))


@pytest.mark.parametrize("step", [0.01, 0.25, 1.0])
def test_steps_do_not_matter(step, tmp_path):
    """The crank swings past half a turn, several times in a long step."""
    fast = changed(TURNING, trajectory={"theta1": "2.6+0.9*sin(3*t)", "theta2": "2.6+0.9*sin(3*t)",
                                        "duration": 3.0})  # fmt: skip
    run = motion_of(fast)
    assert not run.infeasible
    again = recorded(run, tmp_path, step)
    assert not again.infeasible
    t = again.motion.t
    assert np.allclose(again.motion.joints.values[:, 0], 2.6 + 0.9 * np.sin(3 * t), atol=1e-4)
    assert step == 1.0 or again.motion.joints.values[:, 0].max() > 3.2


@pytest.mark.parametrize("step", [0.002, 0.05, 0.4])
def test_full_turns_of_a_platform(step):
    """phi of 3-UPS/SP is given from 0 to two turns where legs allow: passive joints go along."""
    config = {
        "mechanism": "3-ups-sp",
        "parameters": {"kite": 0.6, "twist": 0.6},
        "trajectory": {"duration": 1.2, "step": step, "phi": "0.3*sin(4*t)",
                       "theta": "0.1+0.05*t", "psi": "0.05*t", "l4": 60.0},
        "efforts": False,
    }  # fmt: skip
    task = resolve_motion(config, "c", Path())
    motion = compute_motion(task.mechanism, task.parameters, plan_trajectory(task).trajectory,
                            loads=Loads(efforts=False))  # fmt: skip
    for course in (motion.joints, motion.passive, motion.parasitic):
        for k, coordinate in enumerate(course.coordinates):
            if coordinate.kind != "angle" or not np.isfinite(course.values[:, k]).all():
                continue
            values, rates = course.values[:, k], course.rates[:, k]
            ahead = np.diff(motion.t) * (rates[1:] + rates[:-1]) / 2
            assert np.abs(np.diff(values) - ahead).max() < 0.5


def test_an_engine_takes_the_same_turn():
    pytest.importorskip("mujoco")
    from pmopt.reporting.runs.simulate_run import run_simulation

    config = {k: v for k, v in TURNING.items() if k != "efforts"}
    expressions = dict.fromkeys(("theta1", "theta2"), "3.0+0.5*t")
    limits = {"theta1": [-4.0, -2.0]}
    config = changed(config, trajectory={"duration": 0.6} | expressions, limits=limits)
    with pytest.raises(Exception, match="theta1"):
        run_simulation(resolve_motion(config, "c", Path()))
    run = run_simulation(resolve_motion(config | {"limits": {"theta1": [2.0, 4.0]}}, "c", Path()))
    assert run.agrees
    assert np.abs(run.simulation.inverse.tracking).max() < 1e-9


@pytest.mark.parametrize("name", ["2pauu-ppap", "3-cur", "3-ups-sp", "4-ups-rps", "2uu-upu"])
def test_joints_at_home_are_principal(name):
    mechanism = find(name)
    home = mechanism.home(mechanism.resolve({}))
    trajectory = {"duration": 0.1, "step": 0.05} | dict(home)
    config = {"mechanism": name, "efforts": False, "trajectory": trajectory}
    motion = motion_of(config).motion
    for course in (motion.joints, motion.passive, motion.parasitic):
        for k, coordinate in enumerate(course.coordinates):
            if coordinate.kind == "angle":
                assert (np.abs(course.values[:, k]) <= math.pi).all()
