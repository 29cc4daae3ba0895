"""Trajectories: every source against finite differences and what it promises, and bad input."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from pmopt.analysis.motion import waypoint_laws
from pmopt.analysis.motion.config import MAX_INSTANTS, resolve_motion
from pmopt.analysis.motion.trajectories import instants, plan_trajectory
from pmopt.errors import InputError

WAYPOINTS = [[0.0, 0.0, 1.5], {"x": 0.1, "y": 0.1, "z": 1.6}, [0.2, 0.0, 1.4]]
GATE = {
    "pick": {"x": -0.2, "y": 0.1, "z": 1.5}, "place": {"x": 0.2, "y": -0.1, "z": 1.55},
    "up": "z", "height": -0.1, "radius": 0.05, "cycle": 1.0,
}  # fmt: skip


def plan(table, folder, mechanism="2pauu-ppap"):
    task = resolve_motion({"mechanism": mechanism, "trajectory": table}, "c.toml", folder)
    return plan_trajectory(task)


def refusal(table, folder, mechanism="2pauu-ppap"):
    with pytest.raises(InputError) as caught:
        plan(table, folder, mechanism)
    message = str(caught.value)
    assert message.startswith("c.toml: ") and "\n" not in message
    return message


def check_derivatives(trajectory, jumps=False):
    """Hold rates and accelerations against differences of fourth order.

    With ``jumps``, accelerations may jump at some instants: there differences tell nothing.
    """
    t, step = trajectory.t, trajectory.t[1] - trajectory.t[0]
    inner = slice(2, -2)
    weights = np.array([1, -8, 0, 8, -1]) / (12 * step)
    floor = 1e-8 * (np.abs(trajectory.values).max(axis=0) + 1e-3) / step
    pairs = ((trajectory.values, trajectory.rates), (trajectory.rates, trajectory.accelerations))
    for values, slopes in pairs:
        n = len(t) - 4
        found = sum(w * values[k : k + n] for k, w in enumerate(weights))
        size = np.abs(slopes).max(axis=0) + floor
        error = np.abs(found - slopes[inner]) / size
        # What differences can tell: rounding over the step where all is smooth.
        assert np.quantile(error, 0.8, axis=0).max() < 1e-5
        if not jumps:
            assert error.max() < 1e-2


# --- laws -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "blend"), [("quintic", 0.25), ("trapezoidal", 0.2), ("trapezoidal", 0.5)]
)
def test_a_law_runs_from_rest_to_rest(name, blend):
    law = waypoint_laws.law_of(name, blend)
    path = waypoint_laws.rest_to_rest(np.array([[0.0], [1.0]]), np.array([0.0, 1.0]), [law])
    u = np.linspace(0, 1, 100_001)
    s, rate, acceleration = (path(u, order)[:, 0] for order in range(3))
    assert s[0] == 0 and s[-1] == pytest.approx(1, abs=1e-14)
    assert abs(rate[0]) < 1e-14 and abs(rate[-1]) < 1e-12
    assert (np.diff(s) >= -1e-15).all()
    assert rate.max() == pytest.approx(law.peak_rate, rel=1e-8)
    assert np.abs(acceleration).max() == pytest.approx(law.peak_acceleration, rel=1e-8)
    if name == "quintic":
        assert abs(acceleration[0]) < 1e-12 and abs(acceleration[-1]) < 1e-10
    np.testing.assert_allclose(np.gradient(s, u)[1:-1], rate[1:-1], atol=1e-4)


steps = st.lists(
    st.tuples(*[st.floats(-2, 2).filter(lambda v: abs(v) > 1e-3)] * 2), min_size=1, max_size=3
)
caps = st.tuples(*[st.floats(0.05, 20)] * 2)


@given(
    steps, st.sampled_from(["quintic", "trapezoidal"]), st.none() | st.floats(0.05, 0.5), caps, caps
)
def test_shortest_times_meet_a_limit_and_break_none(given_steps, name, blend, rates, accelerations):
    steps = np.array(given_steps)
    rates, accelerations = np.array(rates), np.array(accelerations)
    spans, chosen = waypoint_laws.shortest(steps, name, blend, rates, accelerations)
    times = np.insert(np.cumsum(spans), 0, 0.0)
    points = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    path = waypoint_laws.rest_to_rest(points, times, chosen)
    for k, span in enumerate(spans):
        t = times[k] + np.linspace(0, span, 2001)[1:-1]
        peaks = np.abs(path(t, 1)).max(axis=0) / rates
        pushes = np.abs(path(t, 2)).max(axis=0) / accelerations
        assert max(peaks.max(), pushes.max()) <= 1 + 1e-9
        assert max(peaks.max(), pushes.max()) >= 1 - 1e-3


def test_both_limits_give_the_shortest_trapezoid():
    free, _ = waypoint_laws.shortest(
        np.array([[1.0]]), "trapezoidal", None, np.ones(1), np.full(1, 4.0)
    )
    assert free[0] == pytest.approx(1.25)  # rate 1 for 1 m, and 0.25 s to reach it
    for blend in (0.1, 0.2, 0.3, 0.5):
        other, _ = waypoint_laws.shortest(
            np.array([[1.0]]), "trapezoidal", blend, np.ones(1), np.full(1, 4.0)
        )
        assert other[0] >= free[0] - 1e-12


# --- expressions ----------------------------------------------------------------------------


def test_expressions_with_constants_and_degrees(tmp_path):
    table = {
        "x": "0.175 + a*sin(pi*t/6)", "beta_deg": "3 + 16*sin(pi*t/6 - pi/3)", "gamma": 0.01,
        "constants": {"a": 0.025}, "duration": 2.0, "step": 0.001,
    }  # fmt: skip
    trajectory = plan(table, tmp_path, "2uu-upu").trajectory
    t = trajectory.t
    assert len(t) == 2001 and t[3] == 0.003 and t[-1] == 2.0
    np.testing.assert_allclose(
        trajectory.values[:, 0], 0.175 + 0.025 * np.sin(np.pi * t / 6), rtol=1e-15
    )
    np.testing.assert_allclose(
        trajectory.values[:, 1], np.radians(3 + 16 * np.sin(np.pi * t / 6 - np.pi / 3)), rtol=1e-13,
        atol=1e-15,
    )  # fmt: skip
    assert (trajectory.values[:, 2] == 0.01).all() and not trajectory.rates[:, 2].any()
    check_derivatives(trajectory)


def test_expressions_in_joint_space(tmp_path):
    table = {
        "space": "joint",
        "h1": "0.1 + 0.01*cos(2*pi*t)",
        "h2": 0.1,
        "h3": 0.1,
        "duration": 1.0,
    }
    trajectory = plan(table, tmp_path, "3-cur").trajectory
    assert trajectory.space == "joint"
    assert trajectory.values[0].tolist() == [0.11, 0.1, 0.1]


# --- waypoints ------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["quintic", "trapezoidal"])
@pytest.mark.parametrize("dwell", [0.0, 0.1])
def test_waypoints_from_rest_to_rest(tmp_path, law, dwell):
    table = {"waypoints": WAYPOINTS, "law": law, "dwell": dwell, "duration": 2.0, "step": 0.001}
    trajectory = plan(table, tmp_path).trajectory
    for k, point in ((0, [0, 0, 1.5]), (1000, [0.1, 0.1, 1.6]), (2000, [0.2, 0, 1.4])):
        np.testing.assert_allclose(trajectory.values[k], point, atol=1e-14)
        np.testing.assert_allclose(trajectory.rates[k], 0, atol=1e-12)
    still = trajectory.t < dwell
    assert not trajectory.rates[still].any()
    # A straight line in the coordinates.
    first = trajectory.values[:1001] - trajectory.values[0]
    np.testing.assert_allclose(first[:, 0], first[:, 1], atol=1e-14)
    np.testing.assert_allclose(first[:, 0], first[:, 2], atol=1e-14)
    check_derivatives(trajectory, jumps=True)


def test_through_waypoints(tmp_path):
    table = {"waypoints": WAYPOINTS, "through": True, "duration": 2.0, "step": 0.001}
    quintic = plan(table, tmp_path).trajectory
    np.testing.assert_allclose(quintic.values[1000], [0.1, 0.1, 1.6], atol=1e-14)
    assert np.linalg.norm(quintic.rates[1000]) > 0.05
    for end in (0, -1):
        np.testing.assert_allclose(quintic.rates[end], 0, atol=1e-12)
        np.testing.assert_allclose(quintic.accelerations[end], 0, atol=1e-10)
    check_derivatives(quintic)
    planned = plan(table | {"law": "trapezoidal", "blend": 0.2}, tmp_path)
    passed = planned.trajectory
    np.testing.assert_allclose(passed.values[[0, -1]], [[0, 0, 1.5], [0.2, 0, 1.4]], atol=1e-14)
    # Rates before and after differ by 0.2 / 0.9 m/s along y; the parabola takes 0.4 s.
    miss = 0.2 / 0.9 * 0.4 / 8
    assert passed.values[1000, 1] == pytest.approx(0.1 - miss)
    assert "y 0.0111 m" in planned.notes[0]
    check_derivatives(passed, jumps=True)


def test_times_of_waypoints(tmp_path):
    points = [(1.0, 0, 1.5), (1.5, 0.1, 1.5), (3.0, 0, 1.4)]
    table = {"waypoints": [{"t": t, "x": x, "y": 0, "z": z} for t, x, z in points]}
    trajectory = plan(table, tmp_path).trajectory
    assert trajectory.t[[0, -1]].tolist() == [1.0, 3.0]
    at = np.searchsorted(trajectory.t, 1.5 - 1e-9)
    np.testing.assert_allclose(trajectory.values[at], [0.1, 0, 1.5], atol=1e-14)


def test_limits_tell_the_time(tmp_path):
    table = {
        "waypoints": WAYPOINTS, "law": "trapezoidal", "max_rate": {"x": 0.2, "y": 0.2, "z": 0.2},
        "max_acceleration": {"x": 1.0, "y": 1.0, "z": 1.0}, "step": 0.001,
    }  # fmt: skip
    trajectory = plan(table, tmp_path).trajectory
    # 0.1 at 0.2 and 0.2 s to reach it, then 0.2 along z.
    assert trajectory.t[-1] == pytest.approx(0.7 + 1.2)
    assert np.abs(trajectory.rates).max() == pytest.approx(0.2)
    assert np.abs(trajectory.accelerations).max() == pytest.approx(1.0)


# --- pick and place -------------------------------------------------------------------------


def test_gate(tmp_path):
    table = {"gate": GATE | {"cycles": 2}, "dwell": 0.1, "step": 0.0005}
    trajectory = plan(table, tmp_path).trajectory
    t, values = trajectory.t, trajectory.values
    assert t[-1] == 2.0
    for time, point in ((0.0, [-0.2, 0.1, 1.5]), (0.5, [0.2, -0.1, 1.55]), (1.0, [-0.2, 0.1, 1.5]),
                        (1.5, [0.2, -0.1, 1.55])):  # fmt: skip
        k = int(np.searchsorted(t, time - 1e-9))
        np.testing.assert_allclose(
            values[k : k + 200], [point] * len(values[k : k + 200]), atol=1e-12
        )
    assert values[:, 2].min() == pytest.approx(1.4)  # 0.1 above the higher end
    # There and back on one path.
    there, back = values[200:1001], values[1200:2001][::-1]
    np.testing.assert_allclose(there, back, atol=1e-12)
    check_derivatives(trajectory)
    # No acceleration jumps: over half the step it changes half as much.
    changes = [np.abs(np.diff(trajectory.accelerations[::k], axis=0)).max() for k in (1, 2)]
    assert changes[1] > 1.7 * changes[0]


@given(st.floats(1e-4, 0.15))
def test_gate_corners_lie_within_their_radius(radius):
    start, end = np.array([0.0, 0.0, 0.0]), np.array([0.6, 0.0, 0.05])
    top = np.array([[0.0, 0.0, 0.2], [0.6, 0.0, 0.2]])
    made = waypoint_laws.gate(start, end, top, [0, 1, 2], radius)
    s = np.linspace(0, made.length, 5001)
    points = made.path(s)
    np.testing.assert_allclose(points[[0, -1]], [start, end], atol=1e-12)
    on_line = (
        (np.abs(points[:, 0]) < 1e-9)
        | (np.abs(points[:, 0] - 0.6) < 1e-9)
        | (np.abs(points[:, 2] - 0.2) < 1e-9)
    )
    near = np.minimum(*(np.abs(points - corner).max(axis=1) for corner in top))
    assert (near[~on_line] <= radius + 1e-9).all()
    assert (np.diff(points[:, 0]) >= -1e-12).all()


def test_gate_with_angles(tmp_path):
    gate = {
        "pick": {"x": 850.0, "y": -30, "alpha": 0, "beta": 0, "gamma_deg": 80},
        "place": {"x": 850.0, "y": 30, "alpha": 0, "beta": 0.1, "gamma_deg": 100},
        "up": "x",
        "height": -40.0,
        "radius": 10.0,
        "cycle": 1.0,
    }
    with pytest.raises(InputError, match=r"gate\.pick: unknown name .q."):
        plan({"gate": gate | {"pick": {"q": 1.0}}}, tmp_path, "4-ups-rps")
    trajectory = plan({"gate": gate, "step": 0.001}, tmp_path, "4-ups-rps").trajectory
    np.testing.assert_allclose(trajectory.values[500, 3:], [0.1, math.radians(100)], atol=1e-12)
    check_derivatives(trajectory)


# --- recordings -----------------------------------------------------------------------------


def record(path, t, *columns, head="t,x,y,z"):
    lines = [
        head,
        *(",".join(repr(float(v)) for v in row) for row in zip(t, *columns, strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def wave(t):
    return 0.1 * np.sin(2 * t), 0.05 * np.cos(t), 1.5 + 0.01 * t


def test_quintic_spline_through_a_file(tmp_path):
    t = 0.5 + np.arange(41) * 0.05
    record(tmp_path / "p.csv", t, *wave(t))
    trajectory = plan({"file": "p.csv", "step": 0.001}, tmp_path).trajectory
    assert trajectory.t[0] == 0.5 and trajectory.t[-1] == pytest.approx(2.5)
    exact = np.stack(wave(trajectory.t), axis=1)
    np.testing.assert_allclose(trajectory.values, exact, atol=2e-9)
    np.testing.assert_allclose(trajectory.accelerations[:, 0], -4 * exact[:, 0], atol=1e-4)
    check_derivatives(trajectory)


def test_cubic_spline_is_scipys(tmp_path):
    t = np.arange(21) * 0.1
    record(tmp_path / "p.csv", t, *wave(t))
    trajectory = plan({"file": "p.csv", "spline": "cubic"}, tmp_path).trajectory
    other = CubicSpline(t, np.stack(wave(t), axis=1))
    for order, values in enumerate((trajectory.values, trajectory.rates, trajectory.accelerations)):
        np.testing.assert_allclose(values, other(trajectory.t, order), atol=1e-11)


@pytest.mark.parametrize("spline", ["quintic", "cubic"])
def test_ends_of_splines(tmp_path, spline):
    t = np.linspace(0, 2 * np.pi, 41)
    record(tmp_path / "p.csv", t, 0.1 * np.sin(t), 0.1 * np.cos(t), 1.5 + 0 * t)
    table = {"file": "p.csv", "spline": spline, "step": 0.001}
    rest = plan(table | {"ends": "rest"}, tmp_path).trajectory
    np.testing.assert_allclose(rest.rates[[0, -1]], 0, atol=1e-9)
    closed = plan(table | {"ends": "periodic"}, tmp_path).trajectory
    np.testing.assert_allclose(closed.rates[0], closed.rates[-1], atol=1e-9)
    np.testing.assert_allclose(closed.accelerations[0], closed.accelerations[-1], atol=1e-7)
    assert closed.rates[0, 0] == pytest.approx(0.1, abs=1e-4)


def test_degrees_and_full_turns_in_a_file(tmp_path):
    t = np.arange(50) * 0.1
    angle = np.degrees(np.angle(np.exp(1j * (2.5 + t))))  # passes over 180 degrees
    record(tmp_path / "p.csv", t, angle, 0.2 + 0 * t, 0 * t, 60 + 0 * t,
           head="t,phi_deg,theta,psi,l4")  # fmt: skip
    trajectory = plan({"file": "p.csv"}, tmp_path, "3-ups-sp").trajectory
    np.testing.assert_allclose(trajectory.values[:, 0], 2.5 + trajectory.t, atol=1e-12)


def test_fit_finds_the_periods_of_the_papers_trajectory(tmp_path):
    t = np.arange(0, 48, 0.1)
    noise = np.random.default_rng(1).normal(size=(3, len(t)))
    x = 0.175 + 0.025 * np.sin(np.pi * t / 6) + 1e-4 * noise[0]
    beta = np.radians(3 + 16 * np.sin(np.pi * t / 6 - np.pi / 3)) + 1e-3 * noise[1]
    gamma = np.radians(0.2 + 0.5 * np.cos(np.pi * t / 8)) + 1e-4 * noise[2]
    record(tmp_path / "p.csv", t, x, beta, gamma, head="t,x,beta,gamma")
    table = {"file": "p.csv", "fit": {"kind": "harmonics"}, "step": 0.01}
    planned = plan(table, tmp_path, "2uu-upu")
    first, second, third = planned.residuals
    assert [r.period for r in planned.residuals] == pytest.approx([12, 12, 16], rel=2e-3)
    assert first.offset == pytest.approx(0.175, abs=2e-5)
    assert first.amplitudes[0] == pytest.approx(0.025, abs=2e-5)
    assert second.phases[0] == pytest.approx(-np.pi / 3, abs=3e-3)
    assert (first.unit, second.unit) == ("m", "rad")
    assert [first.rms, second.rms, third.rms] == pytest.approx([1e-4, 1e-3, 1e-4], rel=0.1)
    assert first.max > 2 * first.rms
    check_derivatives(planned.trajectory)
    longer = plan(table | {"duration": 100.0}, tmp_path, "2uu-upu").trajectory
    assert longer.t[-1] == 100.0
    given = {"kind": "harmonics", "count": 2, "period": {"x": 12, "beta": 12.0, "gamma": "free"}}
    fixed = plan(table | {"fit": given}, tmp_path, "2uu-upu").residuals
    assert fixed[0].period == 12.0 and len(fixed[0].amplitudes) == 2
    assert fixed[0].amplitudes[1] < 3e-5


def test_fitted_spline(tmp_path):
    t = np.arange(0, 10, 0.02)
    noise = 1e-4 * np.random.default_rng(2).normal(size=len(t))
    record(tmp_path / "p.csv", t, 0.1 * np.sin(t) + noise, 0.1 * np.cos(t), 1.5 + 0 * t)
    planned = plan({"file": "p.csv", "fit": {"kind": "spline", "pieces": 12}}, tmp_path)
    assert planned.residuals[0].rms == pytest.approx(1e-4, rel=0.1)
    assert planned.residuals[1].rms < 1e-5
    exact = 0.1 * np.sin(planned.trajectory.t)
    np.testing.assert_allclose(planned.trajectory.values[:, 0], exact, atol=2e-4)
    check_derivatives(planned.trajectory)


# --- what is refused ------------------------------------------------------------------------

BAD_FILES = [
    ("t,x,y,z\n0,0,0,1\n0.1,0,nan,1\n", "p.csv, line 3: y=nan"),
    ("t,x,y,z\n0,0,0,1\n0.1,0,zero,1\n", "p.csv, line 3: y=zero"),
    ("t,x,y,z\n0,0,0,1\n0.1,0,0\n", "p.csv, line 3: 3 cells"),
    ("t,x,y,z\n0,0,0,1\n0.2,0,0,1\n0.1,0,0,1\n",
     "p.csv, line 4: t=0.1 s does not come after t=0.2 s of "),
    ("t,x,y,z\n0,0,0,1\n0,0,0,1\n", "line 3: t=0.0 s does not come after"),
    ("t,x,y,z\n0,0,0,1\n1,0,0,1\n2,0,0,1\n3,0,0,1\n9,0,0,1\n10,0,0,1\n",
     "p.csv, line 6: a gap from t=3.0 to 9.0 s: at most 2.5 s"),
    ("t,x,y\n0,0,0\n1,0,0\n", "p.csv: z is missing, needed: x, y, z"),
    ("x,y,z\n0,0,0\n1,0,0\n", "p.csv: column t is missing"),
    ("t,x,y,z_deg\n0,0,0,1\n1,0,0,1\n", "z is missing, needed: x, y, z; the header has t"),
    ("t [mm],x,y,z\n0,0,0,1\n1,0,0,1\n", "column t: the unit mm does not fit: a number in s"),
    ("t,x [kg],y,z\n0,0,0,1\n1,0,0,1\n", "column x: the unit kg does not fit: a number in m"),
    ("t,x,x,z\n0,0,0,1\n1,0,0,1\n", "column x is given twice"),
    ("t,x,y,z\n0,0,0,1e300\n1,0,0,1\n", "z=1e+300 is not allowed"),
    ("t,x,y,z\n", "has no rows"),
    ("", "has no rows"),
    ("t,x,y,z\n0,0,0,1\n", "one row is no motion"),
    ("t,x,y,z\n0,0,0,1\n1,0,0,1\n2,0,0,1\n", "3 rows are too few: a quintic spline needs 6"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "told"), BAD_FILES)
def test_bad_files(tmp_path, text, told):
    (tmp_path / "p.csv").write_text(text, encoding="utf-8")
    assert told in refusal({"file": "p.csv"}, tmp_path)


def test_more_of_files(tmp_path):
    assert "no such file" in refusal({"file": "none.csv"}, tmp_path)
    t = np.arange(11.0)
    record(tmp_path / "p.csv", t, t, t, t)
    assert "duration=11 s is longer" in refusal({"file": "p.csv", "duration": 11.0}, tmp_path)
    assert "ends = periodic needs" in refusal({"file": "p.csv", "ends": "periodic"}, tmp_path)
    few = refusal({"file": "p.csv", "fit": {"kind": "harmonics", "count": 9}}, tmp_path)
    assert "11 points are too few: 9 harmonics need 20" in few
    few = refusal({"file": "p.csv", "fit": {"kind": "spline", "pieces": 9}}, tmp_path)
    assert "a spline of 9 pieces needs 14" in few
    gap = refusal({"file": "p.csv", "largest_step": 0.5}, tmp_path)
    assert "line 3: a gap from t=0.0 to 1.0 s: at most 0.5 s" in gap
    record(tmp_path / "q.csv", [*range(6), 9.0], *[range(7)] * 3)
    assert "a gap" in refusal({"file": "q.csv"}, tmp_path)
    assert plan({"file": "q.csv", "largest_step": 4.0}, tmp_path).trajectory.t[-1] == 9.0


BASE = {"waypoints": WAYPOINTS, "duration": 1.0}
BAD_TABLES = [
    ({"waypoints": WAYPOINTS}, "one of duration, times t of the waypoints, max_rate"),
    (BASE | {"max_rate": {"x": 1.0}}, "duration and max_rate or max_acceleration given"),
    (BASE | {"max_rate": {"q": 1.0}}, "trajectory.max_rate: unknown name 'q'"),
    (BASE | {"blend": 0.2}, "blend belongs to law = trapezoidal"),
    (BASE | {"law": "cubic"}, "trajectory.law='cubic'"),
    (BASE | {"dwell": 0.5}, "dwell=0.5 s leaves no time from waypoint 1 to 2, 0.5 s apart"),
    (BASE | {"through": True, "dwell": 0.1}, "through: not together with dwell"),
    (BASE | {"waypoints": [[0, 0, 1]]}, "trajectory.waypoints"),
    (BASE | {"waypoints": [[0, 0, 1], [0, 0]]}, "waypoint 2: 2 numbers, needed: x, y, z"),
    (BASE | {"waypoints": [[0, 0, 1], [0, 0, "1 s"]]}, "waypoint 2: z=1 s is not allowed"),
    (BASE | {"waypoints": [[0, 0, 1], [0, 0, math.inf]]}, "waypoint 2: z=inf is not allowed"),
    (BASE | {"waypoints": [[0, 0, 1], 3]}, "waypoint 2=3 is not allowed"),
    (BASE | {"waypoints": [[0, 0, 1], {"x": 1, "y": 1, "w": 1}]}, "waypoint 2: unknown name 'w'"),
    ({"waypoints": [{"x": 0, "y": 0, "z": 1, "t": 0}, [0, 0, 2]]}, "waypoint 2: t is missing"),
    ({"waypoints": [{"x": 0, "y": 0, "z": 1, "t": 0}] * 2}, "waypoint 2: t=0 s does not come"),
    ({"waypoints": [{"x": 0, "y": 0, "z": 1, "t": "0"}] * 2}, "waypoint 1: t=0 is not allowed"),
    ({"waypoints": [[0, 0, 1], [0, 0, 2]], "max_rate": {"x": 1.0}}, "1 and 2 differ in nothing"),
    ({"waypoints": WAYPOINTS, "law": "trapezoidal", "max_rate": {"x": 1.0}},
     "needs max_rate and max_acceleration"),
    ({"gate": GATE | {"radius": 0.3}}, "radius=0.3 is not allowed: at most 0.1 m"),
    ({"gate": GATE | {"radius": 1e-9}}, "and at least 0.001 of that"),
    ({"gate": {k: v for k, v in GATE.items() if k != "radius"}}, "gate.radius is missing"),
    ({"gate": GATE | {"up": "w"}}, "gate.up: unknown name 'w'"),
    ({"gate": GATE | {"height": 0.0}}, "height=0 is not allowed"),
    ({"gate": GATE | {"place": {"x": -0.2, "y": 0.1, "z": 1.6}}}, "differ in no length across z"),
    ({"gate": GATE | {"place": {"x": -0.2, "y": 0.1}}}, "gate.place: z is missing"),
    ({"gate": GATE, "dwell": 0.5}, "leaves no time"),
    ({"gate": GATE, "duration": 1.0}, "duration: not together with gate"),
    ({"gate": GATE | {"cycle": 0.0}}, "gate.cycle=0.0 is not allowed"),
    ({"gate": GATE | {"heigth": 0.1}}, "unknown key trajectory.gate.heigth"),
    ({"x": "t", "y": 0, "z": 1, "duration": 1.0, "law": "quintic"}, "law: not together with ex"),
    ({"x": "t", "y": 0, "z": 1, "duration": 1.0, "file": "p.csv"}, "file and expressions given"),
    ({"x": "t", "y": 0, "z": 1}, "duration is missing"),
    ({"x": "t", "z": 1, "duration": 1.0}, "trajectory: y is missing"),
    ({"x": "t", "y": 0, "z": 1, "x_deg": 1, "duration": 1.0}, "unknown name 'x_deg'"),
    ({"x": "t", "y": 0, "z": 1, "q": 1, "duration": 1.0}, "unknown name 'q'"),
    ({"x": "1e10*t", "y": 0, "z": 1, "duration": 1.0}, "x=1.1e+09 at t=0.11 s is not allowed"),
    ({"x": True, "y": 0, "z": 1, "duration": 1.0}, "x=True must be an expression of t or a number"),
    ({"x": "t", "y": 0, "z": 1, "duration": 1.0, "constants": {"pi": 3.0}}, "constants: pi is a"),
    ({"x": "log(t)", "y": 0, "z": 1, "duration": 1.0}, "trajectory.x: 'log(t)': at t=0.0 s"),
    ({"x": "t", "y": 0, "z": 1, "duration": 1.0, "step": 1e-9}, f"at most {MAX_INSTANTS}"),
    ({"x": "t", "y": 0, "z": 1, "duration": 1.0, "step": 2.0}, "step=2 s is longer"),
    ({}, "none given"),
    ({"space": "joint", "x": "t", "y": 0, "z": 1, "duration": 1.0},
     "unknown name 'x', allowed: theta1"),
]  # fmt: skip


@pytest.mark.parametrize(("table", "told"), BAD_TABLES)
def test_bad_tables(tmp_path, table, told):
    assert told in refusal(table, tmp_path)


@given(st.floats(0.01, 30), st.floats(0.001, 5), st.floats(-100, 100))
def test_instants(duration, step, start):
    if step > duration:
        return
    t = instants(start, duration, step, "c.toml")
    assert t[0] == pytest.approx(start, abs=1e-12)
    assert t[-1] == pytest.approx(start + duration, abs=1e-8)
    assert (np.diff(t) > 0).all() and (np.diff(t) <= step * (1 + 1e-9) + 1e-11).all()


PEOPLE = {
    "further column": ("t,x,y,z,gripper\n", ",", ",1", "."),
    "semicolons": ("t;x;y;z\n", ";", "", "."),
    "decimal commas": ("t;x;y;z\n", ";", "", ","),
    "tabs": ("t\tx\ty\tz\n", "\t", "", "."),
    "sep": ("sep=;\nt;x;y;z\n", ";", "", ","),
    "other order": ("gripper;t;x;y;z\n", ";", "", "."),
}


@pytest.mark.parametrize("form", PEOPLE.values(), ids=PEOPLE)
def test_recordings_as_people_have_them(form, tmp_path):
    head, separator, tail, decimal = form
    t = np.arange(7) / 8
    rows = np.stack([t, 0.1 * t, 0.2 * t, 1 + t], axis=1)
    record(tmp_path / "plain.csv", *rows.T)
    front = f"1{separator}" if head.startswith("gripper") else ""
    lines = [front + separator.join(map(repr, row)).replace(".", decimal) + tail
             for row in rows.tolist()]  # fmt: skip
    (tmp_path / "p.csv").write_bytes(b"\xef\xbb\xbf" + (head + "\n".join(lines)).encode())
    found = plan({"file": "p.csv"}, tmp_path)
    plain = plan({"file": "plain.csv"}, tmp_path)
    assert np.array_equal(found.trajectory.values, plain.trajectory.values)
    assert any("columns left aside: gripper" in n for n in found.notes) == ("gripper" in head)


def test_recordings_in_other_units(tmp_path):
    t = np.arange(7) / 8
    record(tmp_path / "plain.csv", t, 0.001 * t, 0.2 * t, 1 + t)
    rows = [f"{1000 * a!r};{a!r};{0.2 * a!r};{1 + a!r} m" for a in t.tolist()]
    (tmp_path / "p.csv").write_text("t [ms];x (mm);y;z / mm\n" + "\n".join(rows))
    found, plain = (
        plan({"file": name}, tmp_path).trajectory.values for name in ("p.csv", "plain.csv")
    )
    assert np.allclose(found, plain, rtol=0, atol=1e-14)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_time_stamps_since_an_epoch_keep_their_digits(unit, tmp_path):
    from fractions import Fraction

    factor = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[unit]
    exact = [Fraction(1732771701123456789 + 7 * k * k + 1000 * k, 10**9) for k in range(8)]
    cells = [
        str(int(e * 10**9) * factor // 10**9)
        + ("." + f"{int(e * factor * 10**9) % 10**9:09d}" if factor < 10**9 else "")
        for e in exact
    ]
    rows = [f"{cell},0.0,{k},1.0" for k, cell in enumerate(cells)]
    (tmp_path / "p.csv").write_text(f"t [{unit}],x,y,z\n" + "\n".join(rows))
    task = plan({"file": "p.csv", "step": 1e-6}, tmp_path)
    read = [float(e - exact[0]) for e in exact]
    from pmopt.analysis.motion.recordings import read_recording
    from pmopt.mechanisms import find

    mechanism = find("2pauu-ppap")
    recording = read_recording(tmp_path / "p.csv", mechanism, mechanism.pose, "file")
    assert recording.t.tolist() == read
    assert any("times count from t = 17327717011" in note.replace(".", "") for note in task.notes)
