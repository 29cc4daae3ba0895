"""Configurations of motions: what resolves, what comes back, what is refused."""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.cli_runner import CONFIGS
from support.strategies import junk, places, put

from pmopt.analysis.motion.config import load_motion, resolve_motion
from pmopt.analysis.motion.trajectories import plan_trajectory
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.mechanisms.bodies import STEEL
from pmopt.mechanisms.mechanism import PLATFORM

WHERE = "c.toml"
STILL = {"x": 0, "y": 0, "z": 1.5, "duration": 1.0}


def config(trajectory=STILL, mechanism="2pauu-ppap", **tables):
    return {"mechanism": mechanism, "trajectory": trajectory, **tables}


def resolve(data):
    return resolve_motion(data, WHERE, Path())


def refusal(data):
    with pytest.raises(InputError) as caught:
        resolve(data)
    message = str(caught.value)
    assert message.startswith(f"{WHERE}: ") and "\n" not in message
    return message


TRAJECTORIES = [
    STILL,
    {"x": "a*t", "y": "sin(t)", "z": 1.5, "duration": 1.0, "constants": {"a": 0.1}, "step": 0.1},
    {"space": "joint", "theta1": 0.1, "theta2_deg": "5*t", "d": 0, "duration": 1.0},
    {"waypoints": [[0, 0, 1.5], {"x": 0.1, "y": 0, "z": 1.5}], "law": "trapezoidal", "blend": 0.2,
     "dwell": 0.1, "duration": 2.0},
    {"waypoints": [[0, 0, 1.5], [0.1, 0, 1.5]], "max_rate": {"x": 1.0}},
    {"waypoints": [[0, 0, 1.5], [0.1, 0, 1.5]], "duration": 1.0, "through": True},
    {"gate": {"pick": {"x": -0.1, "y": 0.0, "z": 1.5}, "place": {"x": 0.1, "y": 0.0, "z": 1.5},
              "up": "z", "height": -0.1, "radius": 0.02, "cycle": 1.0, "cycles": 3}},
    {"file": "p.csv", "spline": "cubic", "ends": "periodic", "largest_step": 0.1},
    {"file": "p.csv", "fit": {"kind": "harmonics", "count": 2, "period": {"x": 1.0, "y": "free"}}},
    {"file": "p.csv", "fit": {"kind": "spline", "pieces": 8}, "duration": 1.0},
]  # fmt: skip
FULL = {
    "parameters": {"l1": 0.7, "h": 2.0},
    "working_mode": "in-in",
    "gravity": [0, 0, 9.81],
    "bodies": {
        "gripper": {"limb": "platform", "rod": {"diameter": 0.05, "length": 0.1}},
        "motor": {"limb": 1, "joint": 1, "part": "link", "mass": 1.5, "centre": [0, 0, 0.01],
                  "inertia": [[0.02, 0, 0], [0, 0.02, 0], [0, 0, 0.02]]},
    },
    "payload": {"mass": 2.0, "centre": [0, 0, 0.05]},
    "limits": {"theta1": [-1, "inf"], "d_rate": [-1, 1], "theta2_effort": [-50, 50],
               "theta1_power": [-100, 100], "theta1_acceleration": ["-inf", 50]},
    "controller": {"kp": 100, "ki": {"theta1": 1.0}, "feedforward": True, "hold": 0.01},
    "engine": {"name": "mujoco", "step": 0.0005},
}  # fmt: skip


@pytest.mark.parametrize("trajectory", TRAJECTORIES)
@pytest.mark.parametrize("tables", [{}, FULL])
def test_comes_back_from_its_json(trajectory, tables):
    data = config(trajectory, **tables)
    before = copy.deepcopy(data)
    task = resolve(data)
    assert data == before
    document = task.to_dict()
    again = resolve_motion(document, WHERE, Path())
    assert again.to_dict() == document
    assert again.joint_limits == task.joint_limits and again.other_limits == task.other_limits
    assert [b.name for b in again.bodies] == [b.name for b in task.bodies]
    for key, value in trajectory.items():
        assert document["trajectory"][key] == value
    assert document["working_mode"] == tables.get("working_mode", "out-out")


@pytest.mark.parametrize("path", sorted((CONFIGS / "motion").glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_configurations_come_back(path):
    task = load_motion(path)
    assert path.stem.startswith(task.mechanism.name)
    again = resolve_motion(task.to_dict(), str(path), path.parent)
    assert again.to_dict() == task.to_dict()


def test_limits_are_told_apart():
    task = resolve(config(**FULL))
    assert task.joint_limits == {"theta1": (-1.0, np.pi)}
    assert task.other_limits["d_rate"] == (-1.0, 1.0)
    assert task.other_limits["theta1_acceleration"] == (-np.inf, 50.0)


def by_name(**bodies):
    return {b.name: b for b in resolve(config(bodies=bodies)).bodies}


def test_bodies_are_changed_and_added():
    own = by_name()
    name, body = next((n, b) for n, b in own.items() if b.limb >= 0 and b.mass > 0)
    heavier = by_name(**{name: {"mass": 2 * body.mass}})[name]
    assert heavier.mass == 2 * body.mass
    np.testing.assert_allclose(heavier.inertia, 2 * body.inertia)
    np.testing.assert_array_equal(heavier.centre, body.centre)
    assert (heavier.limb, heavier.joint, heavier.part) == (body.limb, body.joint, body.part)
    rod = {"diameter": 0.02, "length": 0.5, "offset": [0, 0, 0.1], "density": 2700.0}
    other = by_name(**{name: {"rod": rod}})[name]
    assert other.mass == pytest.approx(2700 * np.pi * 1e-4 * 0.5)
    np.testing.assert_allclose(other.centre, [0, 0, 0.35])
    assert "[bodies]" in other.source and "[bodies]" not in own[name].source
    more = by_name(plate={"limb": "platform", "plate": {"size": [0.1, 0.2, 0.01]}})
    assert list(more) == [*own, "plate"]
    assert more["plate"].limb == PLATFORM
    assert more["plate"].mass == pytest.approx(STEEL * 2e-4)
    disc = by_name(d={"limb": 3, "joint": 2, "disc": {"diameter": 0.1, "thickness": 0.01,
                                                     "normal": "x"}})["d"]  # fmt: skip
    assert (disc.limb, disc.joint, disc.part) == (2, 1, "link")
    moments = np.diag(disc.inertia)
    assert moments[0] > moments[1] == pytest.approx(moments[2])


def test_shapes_in_millimetres():
    level = {"phi": 0, "theta": 0.2, "psi": 0, "l4": 60, "duration": 1.0}
    tube = {"limb": "platform", "tube": {"diameter": 10.0, "bore": 6.0, "length": 20.0}}
    task = resolve(config(level, "3-ups-sp", bodies={"nozzle": tube}))
    nozzle = task.bodies[-1]
    assert nozzle.mass == pytest.approx(STEEL * np.pi / 4 * (0.01**2 - 0.006**2) * 0.02)
    np.testing.assert_array_equal(nozzle.centre, [0, 0, 10])


REFUSED = [
    ({"bodies": {"a": {}}}, "bodies.a: limb is missing"),
    ({"bodies": {"a": {"limb": 1}}}, "bodies.a: joint is missing: 1 to 3"),
    ({"bodies": {"a": {"limb": 1, "joint": 4, "mass": 1.0}}}, "bodies.a.joint=4 is not allowed"),
    ({"bodies": {"a": {"limb": 9, "joint": 1}}}, "bodies.a.limb=9 is not allowed: 1 to 3"),
    ({"bodies": {"a": {"limb": "q", "joint": 1}}}, "bodies.a.limb='q' is not allowed: 1 to 3"),
    ({"bodies": {"a": {"limb": 1, "joint": 1}}}, "bodies.a: mass is missing"),
    ({"bodies": {"a": {"limb": "platform", "joint": 1, "mass": 1}}}, "joint and part: not"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "mass": -1.0}}}, "bodies.a.mass=-1.0"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "rod": {"diameter": 1.0}}}}, "rod.length is missing"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "rod": {"diameter": 1.0, "length": 1.0, "q": 1}}}},
     "unknown key bodies.a.rod.q, allowed: diameter, length, density, offset"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "tube": {"diameter": 1, "length": 1, "bore": 2}}}},
     "bore 2 is not smaller than diameter 1"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "mass": 1, "inertia": [1, 1, 3]}}}, "of no body"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "mass": 1,
                       "inertia": [[1, 2, 0], [0, 1, 0], [0, 0, 1]]}}}, "is not symmetric"),
    ({"bodies": {"a": {"limb": 1, "joint": 1, "mass": 1, "disc": {"diameter": 1, "thickness": 1}}}},
     "disc and mass exclude each other"),
    ({"bodies": {"a": {"limb": 1, "joint": 2, "part": "bars", "mass": 1}}},
     "joint 2 of limb 1 is no parallelogram"),
    ({"bodies": {"payload": {"limb": "platform", "mass": 1}}}, "[payload]"),
    ({"payload": {"centre": [0, 0, 0]}}, "payload.mass is missing"),
    ({"payload": {"mass": 1, "centre": [0, 0]}}, "payload.centre.2 is missing"),
    ({"limits": {"theta1_rat": [0, 1]}}, "limits: unknown name 'theta1_rat'"),
    ({"limits": {"theta1_rate": [1, 0]}}, "limits: theta1_rate=1.0:0.0 is no range"),
    ({"limits": {"theta1_rate": 3}}, "limits.theta1_rate=3 is not allowed"),
    ({"limits": {"x": [0, 1]}}, "limits: x is a pose coordinate"),
    ({"controller": {"kp": "high"}}, "controller.kp='high' is not allowed"),
    ({"controller": {"kd": {"theta3": 1.0}}}, "controller.kd: unknown name 'theta3'"),
    ({"controller": {"hold": 0}}, "controller.hold=0"),
    ({"engine": {"name": "adams"}}, "engine.name='adams'"),
    ({"gravity": [0, 0]}, "gravity.2 is missing"),
    ({"gravity": -9.81}, "gravity=-9.81 is not allowed"),
    ({"working_mode": "up"}, "working_mode: unknown name 'up'"),
    ({"parameters": {"l3": 1}}, "parameters: unknown name 'l3'"),
    ({"parameters": {"l1": -1}}, "parameters: l1=-1 is not allowed"),
    ({"paramters": {}}, "unknown key paramters"),
    ({"trajectory": 3}, "trajectory=3 is not allowed"),
    ({"mechanism": "2pauu"}, "unknown name '2pauu'"),
    ({"mechanism": 3}, "mechanism=3 is not allowed"),
]  # fmt: skip


@pytest.mark.parametrize(("tables", "told"), REFUSED)
def test_refused_in_one_line(tables, told):
    assert told in refusal(config() | tables)


def test_efforts_need_masses(monkeypatch):
    mechanism = find("2pauu-ppap")
    monkeypatch.setattr(type(mechanism), "bodies", lambda self, parameters: ())
    assert resolve(config()).bodies == ()
    assert "limits: d_effort needs masses" in refusal(config(limits={"d_effort": [0, 1]}))
    assert "limits: theta1_power needs masses" in refusal(config(limits={"theta1_power": [0, 1]}))
    assert "payload: 2pauu-ppap has no bodies" in refusal(config(payload={"mass": 1.0}))
    assert "bodies.a: limb is missing: limb and joint" in refusal(config(bodies={"a": {}}))
    bodies = {"a": {"limb": "platform", "mass": 1.0}}
    task = resolve(config(bodies=bodies, payload={"mass": 1.0}, limits={"d_effort": [0, 1]}))
    assert [b.name for b in task.bodies] == ["a"]


@pytest.mark.parametrize("data", [{}, {"mechanism": "3-cur"}, [], 3, None])
def test_no_configuration(data):
    refusal(data)


@settings(max_examples=300)
@given(st.data())
def test_anything_anywhere_resolves_or_is_refused_in_one_line(data):
    whole = config(data.draw(st.sampled_from(TRAJECTORIES)), **FULL)
    path = data.draw(st.sampled_from(places(whole)))
    try:
        task = resolve(put(whole, path, data.draw(junk)))
    except InputError as error:
        assert str(error).startswith(f"{WHERE}: ")
        assert len(str(error).splitlines()) == 1
        return
    resolve(task.to_dict())
    try:
        planned = plan_trajectory(task)
    except InputError as error:
        assert str(error).startswith(f"{WHERE}: ")
        assert len(str(error).splitlines()) == 1
    else:
        assert np.isfinite(planned.trajectory.values).all()
        assert (np.diff(planned.trajectory.t) > 0).all()


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"bodies": {"platform": {"rod": {"diameter": 1e200, "length": 1.0}}}}, "mass inf kg"),
        ({"bodies": {"platform": {"mass": 1e13}}}, "mass 1e+13 kg"),
        ({"payload": {"mass": 1.0, "centre": [0.0, 0.0, 1e12]}}, "centre 1e+12 m"),
        ({"payload": {"mass": 1.0, "inertia": [1e20, 1e20, 1e20]}}, "inertia 1e+20 kg m^2"),
    ],
)
def test_bodies_beyond_what_can_be_told(table, told):
    data = {
        "mechanism": "2pauu-ppap",
        "trajectory": {"duration": 1.0, "x": 0.0, "y": 0.0, "z": 1.5},
        **table,
    }
    with pytest.raises(InputError, match=re.escape(f"{told} is not allowed: at most")):
        resolve_motion(data, "test", Path())
