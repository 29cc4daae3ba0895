"""Drives that saturate, controllers that do not hold a motion, and whom to blame."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from support.cli_runner import CONFIGS, here

from pmopt.analysis.motion.config import resolve_motion
from pmopt.reporting.runs.simulate_run import run_simulation, series_table, summary_table

pytest.importorskip("mujoco")

SWING = {
    "mechanism": "2pauu-ppap",
    "trajectory": {"duration": 0.6, "step": 0.01, "x": "0.1*sin(pi*t)", "y": 0.1,
                   "z": "1.5+0.05*cos(2*pi*t)"},
}  # fmt: skip
LIMITED = SWING | {
    "limits": {"theta1_effort": [-100.0, 100.0], "theta2_effort": [-100.0, 100.0]},
    "controller": {"kp": 50.0, "kd": 500.0, "hold": 0.02},
}


def simulated(config):
    return run_simulation(resolve_motion(config, "c.toml", Path()))


def test_a_drive_gives_no_more_than_its_limit():
    run = simulated(LIMITED)
    assert run.simulation.unstable is None
    assert run.complaint() is None
    forward = run.simulation.forward
    assert np.abs(forward.engine_effort[:, :2]).max() == 100.0
    free = simulated(LIMITED | {"limits": {}}).simulation.forward
    assert np.abs(free.engine_effort).max() > 300
    for k, drive in enumerate(run.simulation.saturation):
        assert (drive.joint, drive.lower, drive.upper) == (f"theta{k + 1}", -100.0, 100.0)
        at = np.abs(forward.engine_effort[:, k]) == 100.0
        assert drive.duration == pytest.approx(0.02 * at.sum())
        assert drive.first == pytest.approx(forward.t[at][0] - 0.01)  # rows are at middles of holds
    notes = "\n".join(summary_table(run).notes)
    assert "theta1 saturates at [-100, 100] N m: first at t = 0.5 s, 0.06 s in all" in notes


def test_a_drive_at_its_limit_does_not_wind_up():
    """A weak drive lags behind; its integral does not grow meanwhile, so that it comes back."""
    config = SWING | {
        "trajectory": SWING["trajectory"] | {"duration": 3.0, "x": "0.1*sin(pi*t)"},
        "controller": {"kp": 3000.0, "ki": 30000.0, "kd": 300.0, "hold": 0.001},
        "limits": {"theta1_effort": [-70.0, 70.0]},
    }
    run = simulated(config)
    assert run.simulation.saturation
    assert run.simulation.unstable is None
    tracking = np.abs(run.simulation.forward.tracking[:, 0])
    assert tracking[500:1000].max() > 0.05
    assert tracking[1500:2000].max() < 0.01


@pytest.mark.parametrize(
    ("gains", "joint"),
    [
        ({"kp": 1e9, "kd": 0.0, "hold": 0.01}, "theta"),
        ({"kp": 1e7, "hold": 0.01}, "theta"),
        ({"kp": -1e4, "hold": 0.01}, "theta"),
        ({"kp": 0.0, "ki": 0.0, "kd": -500.0, "hold": 0.01}, "theta"),
    ],
)
def test_an_unstable_controller_is_called_so(gains, joint):
    run = simulated(SWING | {"controller": gains})
    unstable = run.simulation.unstable
    assert unstable is not None and unstable.joint.startswith(joint)
    assert 0 < unstable.t <= 0.6
    assert run.complaint().startswith("unstable: the controller ")
    assert run.agrees  # the engine is not to blame
    forward = run.simulation.forward
    assert forward.t[-1] < unstable.t
    assert np.isfinite(forward.engine_effort).all()


def test_the_exit_code_is_4(tmp_path):
    text = (
        'mechanism = "2pauu-ppap"\n[trajectory]\nduration = 0.6\nstep = 0.01\n'
        'x = "0.1*sin(pi*t)"\ny = 0.1\nz = "1.5+0.05*cos(2*pi*t)"\n'
        "[controller]\nkp = 1e9\nhold = 0.01\n"
    )
    (tmp_path / "pid.toml").write_text(text)
    result = here("simulate", "pid.toml", "--format", "json", "--out", "run", cwd=tmp_path)
    assert result.returncode == 4
    assert result.stderr.splitlines()[-1].startswith("unstable: the controller asks for")
    import json

    document = json.loads(result.stdout)
    assert document["unstable"]["t"] == pytest.approx(0.02)
    assert document["agrees"] is True
    assert (tmp_path / "run/simulate.png").exists()


def test_a_joint_without_load_has_no_per_cent():
    config = {
        "mechanism": "2pauu-ppap",
        "gravity": [0.0, 0.0, -9.81],
        "trajectory": {"duration": 0.2, "step": 0.01, "x": 0.05, "y": 0.0, "z": "1.4+0.1*t*t"},
    }
    run = simulated(config)
    inverse = {a.joint: a for a in run.agreements if a.mode == "inverse"}
    assert inverse["d"].error is inverse["d"].at is inverse["d"].rms is None
    assert run.agrees
    assert inverse["theta1"].error < 1e-6
    table = series_table(run)
    column = table.columns.index("d_error")
    assert {row[column] for row in table.rows} == {None}
    assert "no load on d" in "\n".join(summary_table(run).notes)


def test_a_singularity_is_named():
    """Close to level the 3-UPS/SP is singular: what the sides differ by there is laid to that."""
    config = {
        "mechanism": "3-ups-sp",
        "trajectory": {"duration": 0.2, "step": 0.01, "phi": 0.1, "theta": "4e-4 + 0.001*t",
                       "psi": 2e-4, "l4": 60.0},
    }  # fmt: skip
    run = simulated(config)
    assert "nearly singular at t = 0 s" in run.simulation.singular
    assert simulated(SWING).simulation.singular is None


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted((CONFIGS / "motion").glob("*.toml")), ids=lambda p: p.stem)
def test_shipped_motions_are_held(path):
    task = resolve_motion(tomllib.loads(path.read_text()), str(path), path.parent)
    if task.config.controller is None or not task.config.efforts:
        pytest.skip("has no controller")
    run = run_simulation(task)
    assert run.simulation.unstable is None
    assert run.simulation.saturation == ()
