"""Singularities that are touched and not crossed, and families with several zeros."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmopt import api
from pmopt.analysis.kinematics.determinants import measures_at
from pmopt.analysis.motion.config import resolve_motion
from pmopt.analysis.singularities.crossings import follow_path
from pmopt.analysis.singularities.touching import Jets, between, least_along, least_sizes
from pmopt.mechanisms import find
from pmopt.reporting.runs.motion_run import run_motion

GRAZE = {
    "mechanism": "3-ups-sp",
    "trajectory": {"duration": 0.6, "phi": 0.1, "theta": "0.2*(t-0.3033)**2",
                   "psi": "0.1*(t-0.3033)**2", "l4": "60+2*t"},
}  # fmt: skip
UPS = find("3-ups-sp")


def moved(config, folder=Path(), notify=None, **trajectory):
    config = config | {"trajectory": config["trajectory"] | trajectory}
    return run_motion(resolve_motion(config, "c", folder), notify=notify)


@given(st.floats(-5, 5), st.floats(0.1, 3), st.sampled_from([1.0, 2.0, 4.0]))
def test_least_sizes_are_located(place, width, power):
    def size(values):
        return np.abs(values - place) ** power

    found, smallest = least_along(size, np.array([place - 0.3 * width]), np.array([place + width]))
    assert abs(found[0] - place) <= max(1e-15, 1e-9 ** (2 / max(power, 2))) * 10 + 1e-12
    assert smallest[0] <= 1e-15


@given(st.lists(st.floats(-2, 2), min_size=6, max_size=6), st.floats(0.01, 2))
def test_between_instants_quintics_are_exact(coefficients, h):
    poly = np.polynomial.Polynomial(coefficients)
    t = np.array([0.3, 0.3 + h])
    jets = Jets(*(poly.deriv(k)(t)[:, None] if k else poly(t)[:, None] for k in range(3)))
    shares = np.linspace(0, 1, 7)
    found = between(t, jets, np.zeros(7, dtype=int), shares)
    inner = 0.3 + shares * h
    scale = 1 + np.abs(coefficients).sum() * 100
    assert np.allclose(found.values[:, 0], poly(inner), atol=1e-12 * scale)
    assert np.allclose(found.rates[:, 0], poly.deriv()(inner), atol=1e-10 * scale / h)
    assert np.allclose(found.accelerations[:, 0], poly.deriv(2)(inner), atol=1e-9 * scale / h**2)


def test_a_dip_between_two_instants_is_seen():
    """No instant shows it: the size rises on from instant to instant."""
    t = np.arange(5.0)
    jets = Jets(t[:, None], np.ones((5, 1)), np.zeros((5, 1)))

    def size(poses):
        return np.minimum(1 + poses[:, 0], 20 * np.abs(poses[:, 0] - 2.37))

    found = least_sizes(t, jets, np.ones(5, dtype=bool), size)
    assert found.first[0] + found.share[0] == pytest.approx(2.37, abs=1e-12)
    assert found.size[0] < 1e-12


@pytest.mark.parametrize("step", [0.6, 0.1, 0.05, 0.01, 0.003, 0.001])
def test_a_graze_is_found_whatever_the_step(step):
    run = moved(GRAZE, step=step)
    assert run.infeasible
    assert {span.what for span in run.infeasible} == {"singularity"}
    first, last = run.infeasible[0].first, run.infeasible[-1].last
    assert run.motion.t[first] - step <= 0.3033 <= run.motion.t[last] + step
    if len(run.infeasible) == 1 and last == first + 1 and step >= 0.01:
        assert "at t = 0.3033" in run.complaint() or "at t = 0.3032" in run.complaint()


@pytest.mark.parametrize("t0", [0.1, 0.2357, 0.31])
@pytest.mark.parametrize(("theta", "psi"), [("0.3*(t-T)", "-0.3*(t-T)**2"), ("(t-T)**2", "0.0")])
def test_other_touches(t0, theta, psi):
    expressions = {"theta": theta.replace("T", str(t0)), "psi": psi.replace("T", str(t0))}
    run = moved(GRAZE, step=0.02, **expressions)
    assert "singularity" in {span.what for span in run.infeasible}


def test_recorded_and_in_joint_space(tmp_path):
    """A motion that is known by rows alone touches where the spline through them does."""
    t = np.arange(0, 0.61, 0.02)
    dip = (t - 0.3033) ** 2
    rows = np.stack([t, 0.1 + 0 * t, 0.2 * dip, 0.1 * dip, 60 + 2 * t], axis=1)
    text = "t,phi,theta,psi,l4\n" + "\n".join(",".join(map(repr, row)) for row in rows.tolist())
    (tmp_path / "p.csv").write_text(text)
    config = {"mechanism": "3-ups-sp", "trajectory": {"file": "p.csv", "step": 0.02}}
    run = run_motion(resolve_motion(config, "c", tmp_path))
    assert "singularity" in {span.what for span in run.infeasible}


def test_without_efforts_a_touch_is_a_note():
    run = moved(GRAZE | {"efforts": False}, step=0.05)
    assert not run.infeasible
    assert any("a singularity is touched" in note for note in run.planned.notes)


def test_a_near_approach_is_reported_and_no_touch():
    lines = []
    run = moved(GRAZE, notify=lines.append, step=0.01, psi="0.02 + 0.1*(t-0.3033)**2",
                theta="0.0002 + 0.2*(t-0.3033)**2")  # fmt: skip
    assert not run.infeasible
    plain = moved(GRAZE, step=0.01, psi="0.02 + 0.1*(t-0.3033)**2", theta="0.1")
    assert plain.motion.approaches == ()
    finer = moved(GRAZE, step=0.0005, psi="0.02 + 0.1*(t-0.3033)**2",
                  theta="0.0002 + 0.2*(t-0.3033)**2")  # fmt: skip
    for approach in run.motion.approaches:
        peaks = {d.joint: d.peak for d in finer.demands if d.quantity == "effort"}
        for name, value in approach.efforts.items():
            assert abs(value) <= peaks[name] * 1.01
    assert [line for line in lines if "near a singularity" in line] == [
        a.text({f"l{k}": "N" for k in range(1, 5)}) for a in run.motion.approaches
    ]


def test_a_peak_that_no_other_instant_has_is_explained():
    """Two instants each side are far from the singularity; the motion passes it closely."""
    lines = []
    run = moved(GRAZE, notify=lines.append, step=0.01, theta="3e-4 + 0.2*(t-0.3033)**2",
                psi="1e-4 + 0.1*(t-0.3033)**2")  # fmt: skip
    assert not run.infeasible
    (approach,) = run.motion.approaches
    assert approach.t == pytest.approx(0.3033, abs=1e-3)
    finer = moved(GRAZE, step=1e-4, theta="3e-4 + 0.2*(t-0.3033)**2",
                  psi="1e-4 + 0.1*(t-0.3033)**2")  # fmt: skip
    peaks = {d.joint: d.peak for d in finer.demands if d.quantity == "effort"}
    for name, value in approach.efforts.items():
        assert abs(value) == pytest.approx(peaks[name], rel=2e-2)
    assert lines and "near a singularity at t = 0.3033" in lines[-1]


@pytest.mark.parametrize("rows", [2, 3, 40])
def test_a_path_that_touches_between_its_rows(rows, monkeypatch):
    """A determinant that is a square along the path, as at a fold."""
    from pmopt.analysis.singularities import crossings

    def square(mechanism, mode, parameters, pose):
        found = measures_at(mechanism, mode, parameters, pose)
        return found | {("forward", "platform"): (pose["theta"] - 0.0123) ** 2 * (1 + pose["psi"])}

    monkeypatch.setattr(crossings, "measures_at", square)
    thetas = np.linspace(-0.05, 0.05, rows)
    path = [{"phi": 0.1, "theta": theta, "psi": 0.1, "l4": 60.0} for theta in thetas.tolist()]
    found = follow_path(UPS, None, path)
    (touch,) = [x for x in found.crossings if x.kind == "forward"]
    assert not touch.changes_sign
    assert touch.pose["theta"] == pytest.approx(0.0123, abs=1e-6)


DESIGNS = [
    {"A": 33, "a": 22, "kite": 0.8, "twist": 0.35},
    {"A": 40, "a": 25, "kite": 0.7, "twist": -0.2},
    {},
]


def zeros_of_phi(parameters, mode, psi, heights):
    """Where the forward determinant vanishes for all heights at which a platform turned over, or
    level, reaches: by halving along phi, without the compiled kernels."""
    found = None
    for height in heights:

        def det(phi, height=height):
            pose = {"phi": phi, "theta": 0.0, "psi": psi, "l4": height}
            measures = measures_at(UPS, mode, parameters, pose)
            return math.nan if measures is None else measures["forward", "platform"]

        grid = np.linspace(-math.pi + 0.01, math.pi + 0.01, 181)
        values = [det(phi) for phi in grid]
        zeros = set()
        for a, b, x, y in zip(grid, grid[1:], values, values[1:], strict=False):
            if not x * y < 0:
                continue
            for _ in range(50):
                middle = (a + b) / 2
                a, b = (middle, b) if det(middle) * x > 0 else (a, middle)
            zeros.add(round(math.remainder(a, 2 * math.pi), 6))
        found = zeros if found is None else found & zeros
    return found


@pytest.mark.slow
@pytest.mark.parametrize("design", DESIGNS)
def test_all_zeros_of_a_located_coordinate(design):
    parameters = UPS.resolve(design)
    mode = UPS.working_modes[0]
    result = api.singularities("3-ups-sp", design, samples=4096)
    for psi in (0.0, math.pi):
        slices = [f.fixed for f in result.families if f.fixed.get("theta") == 0.0
                  and abs(f.fixed.get("psi", math.nan) - psi) < 1e-12]  # fmt: skip
        if any("phi" not in fixed for fixed in slices):
            continue  # the whole slice is singular
        located = {round(math.remainder(fixed["phi"], 2 * math.pi), 6) for fixed in slices}
        limits = UPS.default_limits(parameters)
        reached = set()
        for phi in zeros_of_phi(parameters, mode, psi, [41.3, 47.7, 55.1]):
            for height in np.linspace(20, 120, 201).tolist():
                pose = {"phi": phi, "theta": 0.0, "psi": psi, "l4": height}
                solutions = api.ik("3-ups-sp", pose, design, mode).solutions if all(
                    r.distance >= 0 for r in UPS.reach(parameters, pose)) else ()  # fmt: skip
                if any(
                    all(limits[k][0] < v < limits[k][1] for k, v in s.joints.items() if k in limits)
                    for s in solutions
                ):
                    reached.add(phi)
                    break
        assert reached <= located


def test_the_family_that_only_low_posts_reach():
    result = api.singularities("3-ups-sp", DESIGNS[0], samples=4096)
    found = [f.fixed["phi"] for f in result.families if f.fixed.get("psi") == math.pi]
    assert np.allclose(sorted(found), [0.35 - math.pi / 2, 0.35 + math.pi / 2], atol=1e-6)
