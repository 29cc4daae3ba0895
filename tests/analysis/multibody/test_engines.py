"""Independent multibody engines say the same: MuJoCo and Pinocchio."""

import json
import math
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.cli_runner import CONFIGS, csv_rows, error_line, here, pmopt, strict_json

from pmopt import ik, mjcf
from pmopt.analysis.motion.config import resolve_motion
from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.motion.motion import Loads, compute_motion
from pmopt.analysis.motion.trajectories import plan_trajectory
from pmopt.analysis.multibody.mjcf import to_mjcf
from pmopt.analysis.multibody.model import BASE, build_tree, link_frames
from pmopt.analysis.multibody.mujoco_engine import Engine
from pmopt.analysis.multibody.simulation import holds, simulate_motion, tree_of
from pmopt.errors import InputError
from pmopt.mechanisms import find, names
from pmopt.mechanisms.mechanism import PLATFORM

#: Two designs each, regular about their homes.
DESIGNS = {
    "2pauu-ppap": ({}, {"m": 0.8, "n": 0.5, "l1": 0.8, "l2": 1.2, "c": 0.2}),
    "2uu-upu": ({}, {"bs": 0.4, "ps": 0.3, "L": 0.3}),
    "3-cur": ({}, {"Ra": 0.3, "Rb": 0.15, "L": 0.4, "d1": 0.05}),
    "3-ups-sp": ({"kite": 0.6, "twist": 0.6}, {"A": 50, "a": 25, "kite": 0.5, "twist": 0.5}),
    "4-ups-rps": ({}, {"R1": 800, "R": 600, "r": 250}),
}
CASES = [(name, k) for name in DESIGNS for k in range(2)]


def task_of(name, params, duration=2.0, step=0.05, seed=0, swing=0.08, **tables):
    """Return a smooth random motion about home, with a payload off the centre."""
    mechanism = find(name)
    parameters = mechanism.resolve(params)
    size = mechanism.characteristic_length(parameters)
    rng = np.random.default_rng([seed, len(name)])
    trajectory = {"duration": duration, "step": step}
    for c, home in zip(mechanism.pose, mechanism.home(parameters).values(), strict=True):
        scale = size if c.kind == "length" else 1.0
        a, w, p = swing * scale * rng.uniform(0.4, 1), rng.uniform(1.5, 4), rng.uniform(-3, 3)
        trajectory[c.name] = f"{home!r} + {a!r}*sin({w!r}*t + {p!r})"
    data = {
        "mechanism": name, "parameters": params, "trajectory": trajectory,
        "payload": {"mass": 0.3 * total_mass(mechanism, parameters),
                    "centre": [0.1 * size, 0.05 * size, 0.08 * size]},
        **tables,
    }  # fmt: skip
    return resolve_motion(data, "test", Path())


def total_mass(mechanism, parameters):
    return float(sum(body.mass for body in mechanism.bodies(parameters)))


def moved(task, step=None):
    if step is not None:
        settings = task.config.trajectory.model_copy(update={"step": step})
        task = replace(task, config=task.config.model_copy(update={"trajectory": settings}))
    motion = compute_motion(
        task.mechanism, task.parameters, plan_trajectory(task).trajectory,
        working_mode=task.config.working_mode,
        loads=Loads(task.bodies, task.payload, task.config.gravity),
        limits={c.name: (-1e4, 1e4) if c.kind == "length" else (-math.pi, math.pi)
                for c in task.mechanism.limited},
    )  # fmt: skip
    assert not motion.infeasible
    return motion


@cache
def case(name, design):
    task = task_of(name, DESIGNS[name][design], seed=design)
    return task, moved(task)


def start_of(motion):
    return dict(zip([c.name for c in motion.pose.coordinates], motion.pose.values[0].tolist(),
                    strict=True))  # fmt: skip


def engine_of(task, motion):
    tree = tree_of(task, start_of(motion))
    return Engine(to_mjcf(tree), tree.actuated)


# -- the model -----------------------------------------------------------------------------


def test_every_mechanism_is_here():
    assert sorted(DESIGNS) == sorted(n for n in names() if find(n).posture is not None)


@pytest.mark.parametrize(("name", "design"), CASES)
def test_model_has_the_declared_freedoms_masses_and_joints(name, design):
    task, motion = case(name, design)
    tree = tree_of(task, start_of(motion))
    engine = Engine(to_mjcf(tree), tree.actuated)
    model = engine.model
    _, jacobian = engine.partial(model.qpos0)
    values = np.linalg.svd(jacobian, compute_uv=False)
    rank = int((values > 1e-9 * values[0]).sum())
    assert model.nv - rank == len(task.mechanism.joints)
    declared = (*task.bodies, task.payload)
    assert model.body_subtreemass[0] == pytest.approx(sum(b.mass for b in declared), rel=1e-14)
    assert model.nu == len(task.mechanism.joints)
    for k, c in enumerate(task.mechanism.joints):
        unit = 1e-3 if c.kind == "length" and task.mechanism.length_unit == "mm" else 1.0
        assert model.joint(c.name).qpos0[0] == pytest.approx(
            motion.joints.values[0, k] * unit, rel=1e-12, abs=1e-14
        )
        assert model.actuator(k).name == c.name
        assert model.actuator(k).trnid[0] == model.joint(c.name).id
    for body in task.bodies:
        assert model.body(body.name).mass[0] == body.mass
        np.testing.assert_allclose(
            np.sort(model.body(body.name).inertia), np.linalg.eigvalsh(body.inertia), rtol=1e-9
        )


@pytest.mark.parametrize(("name", "design"), CASES)
def test_link_frames_are_those_of_the_kernel(name, design):
    """Centres of bodies put anywhere in every link's frame are the kernel's."""
    task, motion = case(name, design)
    mechanism = task.mechanism
    parameters, mode = task.parameters, mechanism.working_modes[0]
    rotation, centre = mechanism.platform(parameters, start_of(motion), mode)
    chains = mechanism.layout(parameters, start_of(motion), mode)
    size = mechanism.characteristic_length(parameters)
    offset = size * np.array([0.3, -0.2, 0.5])
    bodies, expected = [], []
    model = task.bodies[0]
    for limb, chain in enumerate(chains):
        for k, (origin, axes) in enumerate(link_frames(chain, (centre, rotation))):
            bodies.append(replace(model, name=f"{limb} {k}", limb=limb, joint=k, part="link",
                                  centre=offset))  # fmt: skip
            expected.append(origin + axes @ offset)
            assert np.linalg.det(axes) == pytest.approx(1)
    bodies.append(replace(model, name="platform", limb=PLATFORM, joint=0, centre=offset))
    expected.append(centre + rotation @ offset)
    mover = Mover(mechanism, parameters, mode, bodies)
    pose = motion.pose.values[:1]
    found = mover.state(pose, 0 * pose, 0 * pose).centres[0, :, 0] / mover.unit
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)


def test_model_does_not_depend_on_who_asks():
    task, motion = case("3-cur", 0)
    assert to_mjcf(tree_of(task, start_of(motion))) == to_mjcf(tree_of(task, start_of(motion)))


def test_two_limbs_that_end_in_sliders_can_not_be_closed(monkeypatch):
    mechanism = find("2pauu-ppap")
    parameters = mechanism.resolve({})
    chains = mechanism.layout(parameters, mechanism.home(parameters))
    monkeypatch.setattr(type(mechanism), "layout", lambda *_: (chains[0], chains[2], chains[2]))
    with pytest.raises(InputError, match="only one limb may end"):
        build_tree(mechanism, parameters, mechanism.home(parameters), "out-out",
                   mechanism.bodies(parameters)[:3], (0, 0, -9.81))  # fmt: skip


# -- inverse dynamics ----------------------------------------------------------------------


@pytest.mark.parametrize(("name", "design"), CASES)
def test_mujoco_needs_the_same_efforts(name, design):
    task, motion = case(name, design)
    found = simulate_motion(task, motion)
    assert found.inverse.peak.min() > 0
    # The loops are closed to 1e-13; what is left is rounding of the differences.
    assert np.abs(found.inverse.error).max() < 1e-7
    unit = 1e-3 if task.mechanism.length_unit == "mm" else 1.0
    assert found.position_error < 1e-12 * max(1.0, float(np.abs(motion.pose.values).max()) * unit)


@pytest.mark.parametrize(
    ("name", "mode"),
    [("2pauu-ppap", "in-in"), ("2pauu-ppap", "out-in"), ("2uu-upu", "down"),
     ("3-cur", "down-down-down"), ("3-cur", "up-down-up")],
)  # fmt: skip
def test_mujoco_needs_the_same_efforts_in_other_working_modes(name, mode):
    """delta3 of 2uu-upu's passes pi there: engines count angles on."""
    task = task_of(name, DESIGNS[name][0], working_mode=mode, duration=0.5)
    assert np.abs(simulate_motion(task, moved(task)).inverse.error).max() < 1e-7


def test_a_wrong_mass_is_seen():
    task, motion = case("2uu-upu", 0)
    bodies = list(task.bodies)
    bodies[0] = replace(bodies[0], mass=1.01 * bodies[0].mass)
    found = simulate_motion(replace(task, bodies=tuple(bodies)), motion)
    assert 0.01 < np.abs(found.inverse.error).max() < 1


@pytest.mark.parametrize(
    ("name", "massless"),
    [
        ("2pauu-ppap", ["limb 1 bars", "limb 3 knee", "limb 3 carriage"]),
        ("2uu-upu", ["limb 2 link", "limb 1 cylinder"]),
        ("3-cur", ["limb 1 slider", "limb 2 slider"]),
        ("3-ups-sp", ["limb 1 cylinder", "limb 4 cylinder"]),
        ("4-ups-rps", ["limb 1 cylinder", "limb 3 cylinder"]),
    ],
)
def test_links_without_mass(name, massless):
    tables = {"bodies": {body: {"mass": 0.0} for body in massless}}
    task = task_of(name, DESIGNS[name][0], duration=0.5, **tables)
    motion = moved(task)
    assert np.abs(simulate_motion(task, motion).inverse.error).max() < 1e-7


@pytest.mark.parametrize(
    ("name", "massless"),
    [
        ("2pauu-ppap", ["limb 2 knee"]),  # two hinges of it are on one axis
        ("4-ups-rps", ["limb 1 rod"]),
        ("4-ups-rps", ["limb 2 rod"]),
        ("2uu-upu", ["limb 3 link", "limb 1 rod"]),
    ],
)
def test_links_without_mass_that_an_engine_needs_get_next_to_none(name, massless):
    tables = {"bodies": {body: {"mass": 0.0} for body in massless}}
    task = task_of(name, DESIGNS[name][0], duration=0.5, **tables)
    motion = moved(task)
    assert np.abs(simulate_motion(task, motion).inverse.error).max() < 1e-3


def test_no_masses_no_model():
    mechanism = find("3-cur")
    parameters = mechanism.resolve({})
    with pytest.raises(InputError, match="no bodies with a mass"):
        build_tree(mechanism, parameters, mechanism.home(parameters), "up-up-up", (), (0, 0, 0))


class Pinocchio:
    """The same tree in Pinocchio, its loops closed with its own frames' Jacobians."""

    def __init__(self, tree):
        import pinocchio as pin

        self.pin = pin
        self.model = model = pin.Model()
        model.gravity.linear = tree.gravity
        self.columns, self.starts, self.frames = {}, {}, []
        joints, points = {BASE: 0}, {BASE: np.zeros(3)}
        for number, link in enumerate(tree.links):
            joint, point = joints[link.parent], points[link.parent]
            for freedom in link.freedoms:
                kind = {
                    "hinge": lambda axis: pin.JointModelRevoluteUnaligned(axis),
                    "slide": lambda axis: pin.JointModelPrismaticUnaligned(axis),
                    "ball": lambda axis: pin.JointModelSpherical(),
                }[freedom.kind](freedom.axis)
                place = pin.SE3(np.eye(3), freedom.point - point)
                joint, point = model.addJoint(joint, kind, place, freedom.name), freedom.point
                self.columns[freedom.name] = model.joints[joint].idx_v
                self.starts[freedom.name] = (model.joints[joint].idx_q, freedom.start)
            joints[number], points[number] = joint, point
            place = pin.SE3(link.rotation, link.origin - point)
            for body in link.bodies:
                inertia = pin.Inertia(body.mass, np.array(body.centre), np.array(body.inertia))
                model.appendBodyToJoint(joint, inertia, place)
        self.loops = []
        for closure in tree.closures:
            ends = []
            for number in (closure.link, tree.platform):
                place = pin.SE3(np.eye(3), closure.point - points[number])
                frame = pin.Frame(f"{closure.name} {number}", joints[number], place,
                                  pin.FrameType.OP_FRAME)  # fmt: skip
                ends.append(model.addFrame(frame))
            self.loops.append((*ends, closure.perpendicular))
        self.opposite = [[self.columns[n] for n in pair] for pair in tree.opposite]
        self.actuated = tree.actuated
        self.data = model.createData()

    def constraints(self, q, v):
        """Return residuals, their Jacobian and its derivative times v, analytically."""
        pin, model, data = self.pin, self.model, self.data
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        r, j, drift = [], [], []
        for first, second, pairs in self.loops:
            one, two = data.oMf[first], data.oMf[second]
            j1, j2 = (pin.getFrameJacobian(model, data, f, world) for f in (first, second))
            a1, a2 = (pin.getFrameClassicalAcceleration(model, data, f, world)
                      for f in (first, second))  # fmt: skip
            r += list(one.translation - two.translation)
            j += list(j1[:3] - j2[:3])
            drift += list(a1.linear - a2.linear)
            w1, w2 = j1[3:] @ v, j2[3:] @ v
            for u, a in pairs:
                u, a = one.rotation @ u, two.rotation @ a
                du, da = np.cross(w1, u), np.cross(w2, a)
                r.append(u @ a)
                j.append(np.cross(u, a) @ (j1[3:] - j2[3:]))
                ddu = np.cross(a1.angular, u) + np.cross(w1, du)
                dda = np.cross(a2.angular, a) + np.cross(w2, da)
                drift.append(ddu @ a + 2 * du @ da + u @ dda)
        for pair in self.opposite:
            row = np.zeros(model.nv)
            row[pair] = 1.0
            r.append(sum(q[self.q_of(c)] for c in pair))
            j.append(row)
            drift.append(0.0)
        return np.array(r), np.array(j), np.array(drift)

    def q_of(self, column):
        return next(self.starts[n][0] for n, c in self.columns.items() if c == column)

    def efforts(self, joints, rates, accelerations):
        pin, model = self.pin, self.model
        select = np.zeros((len(self.actuated), model.nv))
        for k, name in enumerate(self.actuated):
            select[k, self.columns[name]] = 1.0
        q, result = pin.neutral(model), []
        for at, rate, change in zip(joints, rates, accelerations, strict=True):
            for _ in range(20):
                r, j, _ = self.constraints(q, np.zeros(model.nv))
                now = [q[self.starts[n][0]] + self.starts[n][1] for n in self.actuated]
                whole = np.vstack([j, select])
                step = np.linalg.lstsq(whole, np.concatenate([-r, at - now]), rcond=1e-11)[0]
                q = pin.integrate(model, q, step)
                if np.abs(step).max() < 1e-13:
                    break
            right = np.vstack([np.zeros((len(j), len(rate))), np.eye(len(rate))])
            partial = np.linalg.lstsq(whole, right, rcond=1e-11)[0]
            v = partial @ rate
            drift = self.constraints(q, v)[2]
            a = np.linalg.lstsq(whole, np.concatenate([-drift, change]), rcond=1e-11)[0]
            result.append(partial.T @ pin.rnea(model, self.data, q, v, a))
        return np.array(result)


@pytest.mark.parametrize(("name", "design"), CASES)
def test_pinocchio_needs_the_same_efforts(name, design):
    task, motion = case(name, design)
    engine = Pinocchio(tree_of(task, start_of(motion)))
    unit = 1e-3 if task.mechanism.length_unit == "mm" else 1.0
    factor = np.array([unit if c.kind == "length" else 1.0 for c in task.mechanism.joints])
    course = motion.joints
    part = slice(0, 12)
    found = engine.efforts(*(factor * x[part] for x in (course.values, course.rates,
                                                        course.accelerations)))  # fmt: skip
    peak = np.abs(motion.effort).max(axis=0)
    assert (np.abs(found - motion.effort[part]).max(axis=0) < 1e-9 * peak).all()


# -- forward -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DESIGNS)
def test_forward_under_feed_forward_and_feedback(name):
    task = task_of(name, DESIGNS[name][1], duration=0.3, step=0.01, seed=5,
                   controller={"feedforward": True, "hold": 0.001})  # fmt: skip
    found = simulate_motion(task, moved(task), moved(task, 0.0005))
    assert len(found.forward.t) == 300
    assert np.abs(found.forward.error).max() < 0.1
    np.testing.assert_allclose(found.forward.t[:2], [0.0005, 0.0015], atol=1e-12)
    size = task.mechanism.characteristic_length(task.parameters)
    scale = [size if c.kind == "length" else 1.0 for c in task.mechanism.joints]
    assert (np.abs(found.forward.tracking) / scale).max() < 1e-5


def test_feedback_alone_finds_the_efforts():
    task = task_of("3-cur", {}, duration=0.6, step=0.01, controller={"hold": 0.001})
    found = simulate_motion(task, moved(task), moved(task, 0.0005)).forward
    error = np.abs(found.error)
    assert 1e-6 < error.max() < 3  # a lag, but no blow at the start
    # It received what it was told: the efforts are those of the position errors.
    assert np.abs(found.tracking).max() > 1e-6


def test_a_finer_step_of_the_engine_comes_nearer():
    errors = []
    for step in (0.002, 0.001, 0.0005):
        task = task_of(
            "3-ups-sp",
            DESIGNS["3-ups-sp"][0],
            duration=0.3,
            step=0.01,
            engine={"step": step},
            controller={"feedforward": True, "hold": 0.002},
        )
        found = simulate_motion(task, moved(task), moved(task, 0.001)).forward
        errors.append(np.sqrt((found.error**2).mean()))
    assert errors[0] > errors[1] > errors[2]


def test_too_weak_a_controller_loses_the_motion():
    task = task_of("2uu-upu", {}, duration=2.0, step=0.01,
                   controller={"kp": 0.1, "hold": 0.01})  # fmt: skip
    found = simulate_motion(task, moved(task), moved(task, 0.005))
    assert found.unstable.reason == "the controller loses the motion"
    assert found.forward.t[-1] < found.unstable.t < 2.0


def test_a_hold_is_a_whole_number_of_steps():
    task = task_of("3-cur", {}, controller={"hold": 0.0025}, engine={"step": 0.001})
    with pytest.raises(InputError, match=r"test: controller.hold=0.0025 is not allowed"):
        holds(task)


# -- the command ---------------------------------------------------------------------------

T1 = (CONFIGS / "motion" / "2uu-upu-t1.toml").read_text().replace("duration = 24.0", "duration = 2")


def test_simulate_t1(tmp_path):
    (tmp_path / "t1.toml").write_text(T1)
    result = pmopt("simulate", "t1.toml", "--out", "run", "--format", "json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    document = strict_json(result.stdout)
    assert document["agrees"]
    assert {j["mode"] for j in document["joints"]} == {"inverse", "forward"}
    for joint in document["joints"]:
        assert joint["max_error"] < (1e-8 if joint["mode"] == "inverse" else 0.1)
    files = {p.name for p in (tmp_path / "run").iterdir()}
    assert files == {"simulate.csv", "inverse.csv", "summary.csv", "model.xml", "simulate.png",
                     "manifest.json"}  # fmt: skip
    for name, start in (("simulate.csv", 0.005), ("inverse.csv", 0.0)):
        rows = csv_rows((tmp_path / "run" / name).read_text())
        assert float(rows[0]["t"]) == start
        for joint in ("theta1", "phi", "delta3"):
            ours, theirs, error = (
                np.array([float(row[f"{joint}_{k}"]) for row in rows])
                for k in ("effort", "engine_effort", "error")
            )
            np.testing.assert_allclose(
                error, 100 * (theirs - ours) / np.abs(ours).max(), rtol=1e-9, atol=1e-12
            )
            assert f"{joint}_tracking" in rows[0]
    # The literature's numbers at t = 0, from the engine.
    expected = [-4.6520881682, -3.3707134927, -1.0977351632]
    found = [float(rows[0][f"{k}_engine_effort"]) for k in ("theta1", "phi", "delta3")]
    np.testing.assert_allclose(found, expected, rtol=0, atol=6e-11)
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert manifest["engine"]["name"] == "mujoco"
    assert manifest["units"]["theta1_error"] == "%"
    again = pmopt("simulate", "t1.toml", "--out", "run", cwd=tmp_path)
    assert again.returncode == 2
    twice = here("simulate", "t1.toml", "--out", "run2", "--format", "json", cwd=tmp_path)
    assert twice.stdout == result.stdout
    drawn = (tmp_path / "run2" / "simulate.png").read_bytes()
    (tmp_path / "run2" / "simulate.png").write_bytes(b"")
    assert here("plot", "run2", cwd=tmp_path).returncode == 0
    assert (tmp_path / "run2" / "simulate.png").read_bytes() == drawn
    for name in sorted(files - {"manifest.json"}):
        assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "run2" / name).read_bytes()


def test_disagreement_is_exit_code_4(tmp_path):
    text = T1.replace("[controller]", "[engine]\ntolerance = 1e-16\n\n[controller]")
    (tmp_path / "t1.toml").write_text(text)
    result = here("simulate", "t1.toml", cwd=tmp_path)
    assert result.returncode == 4
    assert "DO NOT agree" in result.stdout
    assert "the engine disagrees: by" in result.stderr


def test_series_without_controller(tmp_path):
    (tmp_path / "t1.toml").write_text(T1.split("[controller]")[0])
    result = here("simulate", "t1.toml", "--format", "csv", cwd=tmp_path)
    assert result.returncode == 0
    rows = csv_rows(result.stdout)
    assert len(rows) == 201
    assert list(rows[0])[:5] == ["t", "theta1_effort", "theta1_engine_effort", "theta1_error",
                                 "theta1_tracking"]  # fmt: skip


def test_infeasible_motion_is_refused(tmp_path):
    result = here("simulate", CONFIGS / "motion" / "2uu-upu-eq16.toml", cwd=tmp_path)
    assert "infeasible at" in error_line(result)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ("[controller]\nhold = 0.0025", "controller.hold=0.0025 is not allowed: a whole number"),
        ("[controller]\nhold = 3.0", "controller.hold=3 is not allowed: at least one"),
        ("[engine]\nstep = 1e-6\n[controller]\nhold = 2e-6", "controller.hold=2e-06"),
        ('[engine]\nname = "adams"', "engine.name"),
        ("[engine]\nstep = 0.0", "engine.step"),
        ("[engine]\ntolerance = -1.0", "engine.tolerance"),
        ("[controller]\nkp = {theta9 = 1.0}", "controller.kp: unknown name 'theta9'"),
    ],
)
def test_bad_tables_are_one_line(tables, said, tmp_path):
    (tmp_path / "t1.toml").write_text(T1.split("[controller]")[0] + tables)
    line = error_line(here("simulate", "t1.toml", cwd=tmp_path))
    assert line.startswith("error: t1.toml: ")
    assert said in line


def test_gains_that_no_motion_survives(tmp_path):
    (tmp_path / "t1.toml").write_text(T1.replace("feedforward = true", "kp = 1e12"))
    result = here("simulate", "t1.toml", "--out", "run", cwd=tmp_path)
    assert result.returncode == 4
    assert "unstable: the controller asks for " in result.stderr
    assert json.loads((tmp_path / "run/manifest.json").read_text())["command"] == "simulate"
    assert not list(tmp_path.glob("MUJOCO_LOG*"))


def test_missing_engine_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    (tmp_path / "t1.toml").write_text(T1)
    result = here("simulate", "t1.toml", cwd=tmp_path)
    assert result.returncode == 1
    assert result.stderr == (
        "error: the engine mujoco is not installed: pip install 'pmopt[engines]'\n"
    )


@pytest.mark.parametrize("name", DESIGNS)
def test_export(name, tmp_path, monkeypatch):
    import mujoco

    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "mujoco", None)  # a model is made without the engine
        result = here("export", name, "--out", "model.xml", "--format", "json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    document = strict_json(result.stdout)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-12
    assert model.nu == len(find(name).joints)
    assert sum(link["mass"] for link in document["links"]) == pytest.approx(
        model.body_subtreemass[0]
    )
    # Everything that is drawn lies within the mechanism.
    ends = data.geom_xpos[model.geom_bodyid > 0] - model.stat.center
    assert len(ends) > 5
    assert np.linalg.norm(ends, axis=1).max() < 1.2 * model.stat.extent
    refused = here("export", name, "--out", "model.xml", cwd=tmp_path)
    assert refused.returncode == 2
    assert "--force" in refused.stderr


def test_export_at_a_pose(tmp_path):
    import mujoco

    pose = {"z": 0.35, "beta": 0.1, "gamma": 0.05}
    given = ",".join(f"{k}={v}" for k, v in pose.items())
    args = ("export", "3-cur", "--out", "m.xml", "--pose", given, "--params", "L=0.3")
    assert here(*args, cwd=tmp_path).returncode == 0
    text = (tmp_path / "m.xml").read_text()
    assert text == mjcf("3-cur", pose, {"L": 0.3})
    model = mujoco.MjModel.from_xml_string(text)
    joints = ik("3-cur", pose, {"L": 0.3}, "up-up-up").solutions[0].joints
    assert {k: model.joint(k).qpos0[0] for k in joints} == pytest.approx(joints, abs=1e-14)


def test_export_refuses(tmp_path):
    far = ("export", "2uu-upu", "--pose", "x=5,beta=0,gamma=0", "--out", "n.xml")
    assert "misses" in error_line(here(*far, cwd=tmp_path))
    slow = ("export", "3-cur", "--out", "n.xml", "--step", "1")
    assert "--step" in error_line(here(*slow, cwd=tmp_path))
    missing = ("export", "3-cur", "--out", "n.xml", "--pose", "z=0.35")
    assert "beta is missing" in error_line(here(*missing, cwd=tmp_path))
    assert not (tmp_path / "n.xml").exists()
