"""``pmopt motion``: shipped configurations, tables, files, infeasible motions, moving pictures."""

import io
import json
import math
import re
import shutil
import subprocess
import tomllib

import numpy as np
import pytest
from PIL import Image
from support.cli_runner import (
    COMMAND,
    CONFIGS,
    TIMEOUT,
    csv_answer,
    csv_rows,
    environment,
    error_line,
    files_in,
    here,
    json_answer,
    pmopt,
    strict_json,
)

import pmopt as package
from pmopt.analysis.motion.config import resolve_motion
from pmopt.analysis.motion.records import Course, Motion
from pmopt.analysis.motion.summary import broken_limits, columns, demands, rms
from pmopt.analysis.motion.trajectories import plan_trajectory
from pmopt.analysis.record import Subject
from pmopt.mechanisms import find
from pmopt.reporting.pictures import animation

MOTIONS = CONFIGS / "motion"
FEASIBLE = (
    "2pauu-ppap-pick-and-place", "2uu-upu-t1", "3-cur-eq16", "3-ups-sp-strokes", "4-ups-rps-home",
)  # fmt: skip
INFEASIBLE = ("2uu-upu-eq16", "4-ups-rps-paper")
SHORT = """
mechanism = "2pauu-ppap"
[trajectory]
duration = 0.5
step = 0.05
x = "0.1*sin(4*t)"
y = "0.1*t"
z = 1.5
"""


@pytest.fixture
def short(tmp_path):
    """Write a small configuration and return its folder."""
    (tmp_path / "m.toml").write_text(SHORT)
    return tmp_path


def test_every_shipped_configuration_is_here():
    assert {p.stem for p in MOTIONS.glob("*.toml")} == {*FEASIBLE, *INFEASIBLE}


@pytest.fixture(scope="module", params=FEASIBLE)
def run(request, tmp_path_factory):
    """Run a shipped configuration into a folder, and print it as JSON."""
    folder = tmp_path_factory.mktemp("run")
    args = ("motion", MOTIONS / f"{request.param}.toml", "--out", "run", "--format", "json")
    result = here(*args, "--quiet", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return request.param, folder / "run", strict_json(result.stdout)


def numbers(path):
    rows = csv_rows(path.read_text())
    return {k: np.array([float(row[k]) for row in rows]) for k in rows[0]}


def test_shipped_motion(run):
    _, folder, document = run
    mechanism = find(document["mechanism"])
    motion = numbers(folder / "motion.csv")
    manifest = json.loads((folder / "manifest.json").read_text())
    poses = [c.name for c in (*mechanism.pose, *mechanism.parasitic)]
    joints = [c.name for c in mechanism.joints]
    head = list(motion)
    # The columns of the interface, in its order.
    positions = list(dict.fromkeys([*poses, *joints]))
    assert head[: 1 + len(positions)] == ["t", *positions]
    angular = [f"omega_{axis}{ending}" for ending in ("", "_rate") for axis in "xyz"]
    assert head[-8:] == [*angular, "kinetic_energy", "potential_energy"]
    head = head[:-8]
    followed = [
        k for k in head[1:] if not k.endswith(("_rate", "_acceleration", "_effort", "_power"))
    ]
    assert [k for k in head if k.endswith(("_rate", "_acceleration"))] == [
        f"{k}{ending}" for k in followed for ending in ("_rate", "_acceleration")
    ]
    assert head[-2 * len(joints) :] == [
        f"{k}{ending}" for k in joints for ending in ("_effort", "_power")
    ]
    power = sum(motion[f"{k}_power"] for k in joints)
    change = np.gradient(motion["kinetic_energy"] + motion["potential_energy"], motion["t"])
    assert np.quantile(np.abs(power - change), 0.9) < 2e-2 * np.abs(power).max()
    assert set(manifest["units"]) >= set(head)
    assert set(document["units"]) >= set(head)
    assert all(np.isfinite(column).all() for column in motion.values())
    # Rates and accelerations are those of the values.
    t, step = motion["t"], motion["t"][1] - motion["t"][0]
    for k in followed:
        inner = slice(2, -2)
        for slope, values in ((f"{k}_rate", motion[k]), (f"{k}_acceleration", motion[f"{k}_rate"])):
            found = np.gradient(values, t, edge_order=2)[inner]
            size = np.abs(motion[slope]).max() + 1e-9 * (1 + np.abs(motion[k]).max()) / step
            assert np.quantile(np.abs(found - motion[slope][inner]) / size, 0.9) < 2e-2, slope
    metres = {"m": 1.0, "mm": 1e-3}
    for joint in joints:
        factor = metres.get(document["units"][joint], 1.0)
        power = motion[f"{joint}_effort"] * motion[f"{joint}_rate"] * factor
        np.testing.assert_allclose(motion[f"{joint}_power"], power, atol=1e-9 * np.abs(power).max())
    # The summary is that of the motion.
    for row in document["actuators"]:
        for quantity in ("rate", "acceleration", "effort", "power"):
            values, said = motion[f"{row['joint']}_{quantity}"], row[quantity]
            assert said["peak"] == np.abs(values).max()
            assert (said["min"], said["max"]) == (values.min(), values.max())
            assert abs(values[np.searchsorted(t, said["at"])]) == said["peak"]
            assert said["rms"] == pytest.approx(math.sqrt(np.trapezoid(values**2, t) / np.ptp(t)))
        assert row["position"]["min"] == motion[row["joint"]].min()
    summary = csv_rows((folder / "summary.csv").read_text())
    assert len(summary) == 5 * len(joints)
    assert document["infeasible"] == [] and document["infeasible_instants"] == 0
    assert document["instants"] == len(t)
    # Centres of mass of all bodies, with their rates.
    centres = numbers(folder / "centres.csv")
    assert len(centres) == 1 + 9 * len(manifest["bodies"]) + 9 * ("payload" in manifest["config"])
    assert set(manifest["units"]) >= set(centres)
    pictures = {"pose", "joints", "rates", "accelerations", "efforts", "power", "centres"}
    assert {f"{k}.png" for k in pictures} <= set(files_in(folder))
    assert manifest["config"]["trajectory"]["step"] == pytest.approx(step)
    assert set(manifest["outputs"]) == set(files_in(folder)) - {"manifest.json"}


def test_the_folder_draws_its_pictures_again(tmp_path):
    """From the manifest and the recording in the folder alone."""
    shutil.copy(MOTIONS / "3-ups-sp-strokes.toml", tmp_path)
    shutil.copy(MOTIONS / "3-ups-sp-strokes.csv", tmp_path)
    args = ("motion", "3-ups-sp-strokes.toml", "--out", "run", "--quiet")
    assert here(*args, cwd=tmp_path).returncode == 0
    (tmp_path / "3-ups-sp-strokes.csv").unlink()
    drawn = json_answer("plot", "run", "--out", "again", cwd=tmp_path)["written"]
    assert len(drawn) == 7
    for path in drawn:
        again = (tmp_path / path).read_bytes()
        assert again == (tmp_path / "run" / path.removeprefix("again/")).read_bytes()


def test_published_efforts_of_t1(tmp_path):
    """Ours, to 10 digits: 2UU-UPS along T1."""
    rows = csv_answer("motion", MOTIONS / "2uu-upu-t1.toml", cwd=tmp_path)
    for row, efforts in (
        (0, (-4.6520881682, -3.3707134927, -1.0977351632)),
        (100, (-4.1571294192, -3.8992031137, -1.0162085370)),
        (500, (-2.8442344263, -4.4348006345, -0.0060174475)),
    ):
        found = [float(rows[row][f"{k}_effort"]) for k in ("theta1", "phi", "delta3")]
        assert found == pytest.approx(efforts, abs=1e-9)


def test_pose_and_rates_of_the_papers_drives(tmp_path):
    """Ours, 3-CUR at t = 0.1 s of equation (16)."""
    rows = csv_answer("motion", MOTIONS / "3-cur-eq16.toml", cwd=tmp_path)
    row = {k: float(v) for k, v in rows[20].items()}
    assert row["t"] == 0.1
    expected = {
        "x": 0.0101258570, "y": 0.0015164963, "z": 0.3392979163, "alpha": -0.00013876195,
        "beta": 0.0431494353, "gamma": -0.0062939152, "x_rate": 0.0452984852,
        "y_rate": -0.0601470025, "z_rate": -0.0140885315, "x_acceleration": -0.3994986577,
        "y_acceleration": -0.0611743426, "z_acceleration": -0.1138695480,
    }  # fmt: skip
    for name, value in expected.items():
        assert row[name] == pytest.approx(value, abs=1e-9), name


def test_the_printed_trajectory_is_infeasible_and_says_where(tmp_path):
    args = ("motion", MOTIONS / "2uu-upu-eq16.toml", "--out", "run", "--format")
    result = here(*args, "json", cwd=tmp_path)
    assert result.returncode == 2
    lines = [s for s in result.stderr.splitlines() if not s.startswith("compiling")]
    document = strict_json(result.stdout)
    spans = document["infeasible"]
    count = document["infeasible_instants"]
    assert document["instants"] == 481 and 440 < count < 470
    assert document["actuators"] == []
    assert spans[0]["from"] == 0.0 and spans[0]["what"].startswith("limb ")
    assert {s["unit"] for s in spans} == {"m"}
    assert all(s["from"] <= s["worst_at"] <= s["to"] and s["miss"] > 0 for s in spans)
    worst = max(spans, key=lambda s: s["miss"])
    assert len(lines) == 1
    assert f"infeasible at {count} of 481 instants, {len(spans)} spans: first at t=0 s" in lines[0]
    assert f"worst at t={worst['worst_at']:g} s, {worst['text']}" in lines[0]
    # Nothing is written: no part of a motion looks like one.
    assert files_in(tmp_path) == []
    rows = csv_rows(here(*args, "csv", cwd=tmp_path).stdout)
    assert [float(r["from"]) for r in rows] == [s["from"] for s in spans]
    assert "limb 2 misses by" in here(*args, "table", cwd=tmp_path).stdout


def test_the_singular_wall_is_told(tmp_path):
    args = ("motion", MOTIONS / "4-ups-rps-paper.toml", "--format", "json")
    result = here(*args, cwd=tmp_path)
    assert result.returncode == 2
    (span,) = strict_json(result.stdout)["infeasible"]
    assert (span["from"], span["to"], span["what"]) == (1.0, 1.0, "singularity")
    # Between two instants it is met too.
    text = (MOTIONS / "4-ups-rps-paper.toml").read_text().replace("step = 0.005", "step = 0.0057")
    (tmp_path / "m.toml").write_text(text)
    result = here("motion", "m.toml", "--format", "json", cwd=tmp_path)
    (span,) = strict_json(result.stdout)["infeasible"]
    assert span["from"] < 1.0 < span["to"] < span["from"] + 0.006
    line = error_line(subprocess.CompletedProcess((), 2, "", result.stderr))
    assert "singularity" in line


def test_limits_of_rates_efforts_and_power(short):
    text = SHORT + "[limits]\ntheta1_rate = [-0.1, 0.1]\nd_power = [-1e3, 1e3]\n"
    (short / "m.toml").write_text(text)
    result = here("motion", "m.toml", "--format", "json", "--out", "run", cwd=short)
    line = error_line(result)
    spans = strict_json(result.stdout)["infeasible"]
    assert {s["what"] for s in spans} == {"theta1_rate"}
    assert {s["unit"] for s in spans} == {"rad/s"}
    assert "theta1_rate = " in line and "0.1 rad/s" in line
    assert not (short / "run").exists()
    (short / "m.toml").write_text(text.replace("0.1, 0.1", "9, 9"))
    assert here("motion", "m.toml", cwd=short).returncode == 0
    (short / "m.toml").write_text(SHORT + "[limits]\nd = [0.0, 0.02]\n")
    result = here("motion", "m.toml", "--format", "json", cwd=short)
    assert strict_json(result.stdout)["infeasible"][0]["what"] == "d"


def test_a_motion_without_masses(short, monkeypatch):
    mechanism = find("2pauu-ppap")
    monkeypatch.setattr(type(mechanism), "bodies", lambda self, parameters: ())
    result = here("motion", "m.toml", "--out", "run", cwd=short)
    assert result.returncode == 0, result.stderr
    assert "no efforts: the mechanism has no masses" in result.stdout
    assert "effort |" not in result.stdout
    names = files_in(short / "run")
    assert not {"centres.csv", "centres.png", "efforts.png", "power.png"} & set(names)
    head = (short / "run/motion.csv").read_text().splitlines()[0]
    assert "d_acceleration" in head and "effort" not in head


def test_payload_and_gravity_change_efforts(short):
    def peak():
        found = json_answer("motion", "m.toml", cwd=short)["actuators"][0]["effort"]["peak"]
        return float(found)

    bare = peak()
    (short / "m.toml").write_text(SHORT + "[payload]\nmass = 10.0\n")
    assert abs(peak() - bare) > 1.0
    (short / "m.toml").write_text("gravity = [0.0, 0.0, 0.0]\n" + SHORT)
    assert peak() < bare


def test_same_bytes_for_any_threads(tmp_path):
    texts = [
        here("motion", MOTIONS / "4-ups-rps-home.toml", "--threads", n, "--format", "csv",
             cwd=tmp_path).stdout
        for n in (1, 2, 3)
    ]  # fmt: skip
    assert texts[0] == texts[1] == texts[2] != ""


def test_forms_as_a_process(short):
    runs = [
        pmopt("motion", "m.toml", "--format", form, cwd=short) for form in ("table", "json", "csv")
    ]
    assert [r.returncode for r in runs] == [0, 0, 0], runs[0].stderr
    assert "theta1 | effort" in runs[0].stdout and "N m" in runs[0].stdout
    assert len(csv_rows(runs[2].stdout)) == 11
    assert strict_json(runs[1].stdout)["units"]["d_effort"] == "N"
    assert files_in(short) == ["m.toml"]


def test_finished_runs_are_kept(short):
    args = ("motion", "m.toml", "--out", "run")
    assert here(*args, cwd=short).returncode == 0
    before = (short / "run/motion.csv").read_bytes()
    assert "--force" in error_line(here(*args, cwd=short))
    assert here(*args, "--force", cwd=short).returncode == 0
    assert (short / "run/motion.csv").read_bytes() == before
    (short / "file").write_text("")
    assert "is a file" in error_line(here("motion", "m.toml", "--out", "file", cwd=short))


def test_a_fit_is_told(tmp_path):
    t = np.arange(0, 4, 0.05)
    lines = ["t,x,y,z", *(f"{a!r},{0.1 * math.sin(2 * a) + 1e-3 * (k % 2)!r},0.1,1.5"
                          for k, a in enumerate(t.tolist()))]  # fmt: skip
    (tmp_path / "p.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "m.toml").write_text(
        'mechanism = "2pauu-ppap"\n[trajectory]\nfile = "p.csv"\n'
        'fit = {kind = "harmonics", period = "free"}\n'
    )
    fits = json_answer("motion", "m.toml", "--out", "run", cwd=tmp_path)["fit"]
    assert [f["coordinate"] for f in fits] == ["x", "y", "z"]
    assert fits[0]["rms"] == pytest.approx(5e-4, rel=0.1) and fits[0]["unit"] == "m"
    assert fits[0]["period"] == pytest.approx(math.pi, rel=1e-2)
    table = here("motion", "m.toml", cwd=tmp_path).stdout
    assert "Fit to the recorded points" in table and "period (s)" in table
    # The folder holds the recording: it is enough to draw the run again.
    (tmp_path / "p.csv").unlink()
    assert (tmp_path / "run/recording.csv").read_text().startswith("t,x,y,z")
    assert here("plot", "run", cwd=tmp_path).returncode == 0


def test_strokes_come_from_their_script(tmp_path):
    for name in ("3-ups-sp-strokes.py", "3-ups-sp-strokes.csv"):
        shutil.copy(MOTIONS / name, tmp_path)
    shipped = np.loadtxt(tmp_path / "3-ups-sp-strokes.csv", delimiter=",", skiprows=1)
    subprocess.run([COMMAND[0], "3-ups-sp-strokes.py"], cwd=tmp_path, check=True, timeout=TIMEOUT)
    made = np.loadtxt(tmp_path / "3-ups-sp-strokes.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(made, shipped, atol=2e-9)
    # The nozzle's tip touches the sphere's cap along the strokes, and never enters it.
    mechanism = find("3-ups-sp")
    parameters = mechanism.resolve({"kite": 0.6, "twist": 0.6})
    heights = []
    for row in shipped[:, 1:]:
        pose = dict(zip(("phi", "theta", "psi", "l4"), row.tolist(), strict=True))
        rotation, centre = mechanism.platform(parameters, pose)
        tip = centre + rotation @ [0, 0, 20.0] - [-7.5, -7.5, 86.0 - 90.0]
        heights.append(np.linalg.norm(tip) - 90.0)
    heights = np.array(heights)
    assert heights.max() < 1e-6 and heights.min() > -3.2
    assert 0.4 < (heights > -1e-6).mean() < 0.9


# --- what is refused ------------------------------------------------------------------------

REFUSED = [
    ("x = ", 'x = "0.1*sin(4*u)" #', "trajectory.x: '0.1*sin(4*u)', position 11: unknown"),
    ("x = ", 'x = "log(t - 0.2)" #', "at t=0.0 s it is not defined"),
    ("step = ", "stepp = ", "m.toml: trajectory: unknown name 'stepp'"),
    ("duration = ", "duration = -", "m.toml: trajectory.duration=-0.5 is not allowed"),
    ("2pauu", "3pauu", "nearest: 2pauu-ppap"),
    ("[trajectory]", "[trajectory", "is not a TOML file"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "expected"), REFUSED)
def test_refused_in_one_line(short, old, new, expected):
    (short / "m.toml").write_text(SHORT.replace(old, new, 1))
    result = here("motion", "m.toml", "--out", "run", cwd=short)
    assert expected in error_line(result)
    assert result.stdout == ""
    assert files_in(short) == ["m.toml"]


def test_refused_as_a_process(short):
    (short / "p.csv").write_text("t,x,y,z\n0,0,0,1.5\n0.1,0,nan,1.5\n")
    (short / "m.toml").write_text('mechanism = "2pauu-ppap"\n[trajectory]\nfile = "p.csv"\n')
    line = error_line(pmopt("motion", "m.toml", cwd=short))
    assert "m.toml: trajectory.file: p.csv, line 3: y=nan is not allowed" in line
    assert "none.toml: no such file" in error_line(pmopt("motion", "none.toml", cwd=short))


def test_drawings_in_time_are_checked_first(short):
    def refusal(*args):
        return error_line(here("motion", "m.toml", *args, cwd=short))

    assert "ending in .gif or .mp4" in refusal("--animate", "a.avi")
    assert "only together with --animate" in refusal("--fps", "10")
    assert "--fps: 100 is not allowed" in refusal("--animate", "a.gif", "--fps", "100")
    (short / "a.gif").write_text("")
    assert "exists; --force" in refusal("--animate", "a.gif")


def test_mp4_without_ffmpeg_is_one_line(short):
    (short / "none").mkdir()
    result = subprocess.run(
        [*COMMAND, "motion", "m.toml", "--animate", "a.mp4"], cwd=short, timeout=TIMEOUT,
        env=environment(PATH=str(short / "none")), capture_output=True, text=True,
    )  # fmt: skip
    assert "needs ffmpeg, which is not installed" in error_line(result)


def test_tables_of_the_page_resolve(tmp_path):
    """What docs/motion.md shows is read, table by table."""
    text = (CONFIGS.parent / "docs/motion.md").read_text()
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    fits = re.findall(r"fit = \{.*?\}", text)
    assert len(blocks) == 8 and len(fits) == 2
    first, constants, waypoints, gate, file, _, masses, limits = blocks
    still = "[trajectory]\nx = 0.0\ny = 0.0\nz = 1.5\nduration = 1.0\n"
    whole = first.replace('space = "task"', "", 1)
    plain = 'mechanism = "2pauu-ppap"\n'
    limits = limits.replace("l1 =", "theta1 =")
    tables = [
        first, whole + constants, plain + waypoints, plain + gate, plain + file,
        *(plain + '[trajectory]\nfile = "p.csv"\n' + fit for fit in fits),
        plain + still + masses, plain + still + limits,
    ]  # fmt: skip
    for table in tables:
        task = resolve_motion(tomllib.loads(table), "page", tmp_path)
        if task.config.trajectory.source != "file":
            plan_trajectory(task)


# --- pictures and sums ----------------------------------------------------------------------


def test_a_gif_in_real_time(short):
    args = ("motion", "m.toml", "--animate", "a.gif", "--fps", "10", "--force", "--quiet")
    assert here(*args, cwd=short).returncode == 0
    data = (short / "a.gif").read_bytes()
    image = Image.open(io.BytesIO(data))
    assert image.n_frames == 6
    frames, delays = [], []
    for k in range(image.n_frames):
        image.seek(k)
        delays.append(image.info["duration"])
        frames.append(np.asarray(image.convert("RGB"), dtype=int))
    assert delays == [100] * 6
    changed = [np.abs(b - a).max(axis=2) > 60 for a, b in zip(frames, frames[1:], strict=False)]
    # The mechanism moves, axes and legend do not.
    assert all(c.sum() > 200 for c in changed)
    assert not any(c[80:, 560:].any() for c in changed)
    assert here(*args, cwd=short).returncode == 0
    assert (short / "a.gif").read_bytes() == data


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg")
def test_an_mp4(short):
    assert here("motion", "m.toml", "--animate", "a.mp4", "--quiet", cwd=short).returncode == 0
    assert (short / "a.mp4").read_bytes()[4:8] == b"ftyp"


def test_what_ffmpeg_says_is_one_line(short):
    tool = short / "bin/ffmpeg"
    tool.parent.mkdir()
    tool.write_text("#!/bin/sh\necho first >&2\necho no encoder >&2\nexit 1\n")
    tool.chmod(0o755)
    result = subprocess.run(
        [*COMMAND, "motion", "m.toml", "--animate", "a.mp4", "--fps", "2"], cwd=short,
        timeout=TIMEOUT, env=environment(PATH=f"{tool.parent}:/usr/bin:/bin"),
        capture_output=True, text=True,
    )  # fmt: skip
    assert "ffmpeg: no encoder" in error_line(result, 1)
    assert not (short / "a.mp4").exists()


@pytest.mark.parametrize("fps", [7.0, 20.0, 30.0, 50.0])
def test_delays_add_up(fps):
    delays = animation._delays(200, fps)
    assert sum(delays) == pytest.approx(1000 * 200 / fps, abs=5)
    assert all(d % 10 == 0 and d > 0 for d in delays)


def test_rms_counts_time_not_instants():
    t = np.array([0.0, 1.0, 1.1, 1.2, 1.3])
    assert rms(t, np.full(5, -2.0)) == pytest.approx(2.0)
    line = np.linspace(0, 1, 2001)
    assert rms(line, line) == pytest.approx(math.sqrt(1 / 3), abs=1e-6)


def made(values, rates):
    """Return a motion of 2PaUU-PPaP with the same course of every joint, without masses."""
    mechanism = find("2pauu-ppap")
    t = np.arange(len(values)) * 0.1
    whole = [
        np.repeat(np.array(v, dtype=float)[:, None], 3, axis=1) for v in (values, rates, rates)
    ]
    empty = Course((), *np.empty((3, len(t), 0)))
    subject = Subject.of(mechanism, mechanism.resolve({}), "out-out", {})
    return mechanism, Motion(
        subject, t, Course(mechanism.pose, *whole), empty,
        Course(mechanism.joints, *whole), empty, None, None, None, None, {},
        np.zeros((len(t), 2, 3)), (), (),
    )  # fmt: skip


def test_spans_of_broken_limits():
    mechanism, motion = made([0] * 6, [0, 2, 3, math.nan, -5, 0])
    spans = broken_limits(motion, mechanism, {"d_rate": (-1.0, 1.5)})
    assert [(s.first, s.last, s.worst, s.miss, s.unit) for s in spans] == [
        (1, 2, 2, 1.5, "m/s"), (4, 4, 4, 4.0, "m/s"),
    ]  # fmt: skip
    assert spans[1].text == "d_rate = -5 m/s is below -1 m/s"
    assert broken_limits(motion, mechanism, {"d_rate": (-math.inf, 3.0)}) == ()


def test_demands_without_masses():
    mechanism, motion = made([1, -3, 2], [0, 1, 0])
    found = demands(motion, mechanism)
    assert {d.quantity for d in found} == {"position", "rate", "acceleration"}
    first = found[0]
    assert (first.low, first.high, first.peak, first.at, first.rms) == (-3.0, 2.0, 3.0, 0.1, None)
    assert not any(k.endswith("_effort") for k in columns(motion, mechanism))


def test_from_python(tmp_path):
    table = {"x": "0.1*t", "y": 0.0, "z": 1.5, "duration": 0.5}
    run = package.motion({"mechanism": "2pauu-ppap", "trajectory": table}, tmp_path / "run")
    assert run.motion.joints.values.shape == (51, 3)
    assert run.demands[0].joint == "theta1"
    assert (tmp_path / "run/manifest.json").exists()
    with pytest.raises(package.PmoptError, match=r"^config: trajectory: z is missing"):
        package.motion(
            {"mechanism": "2pauu-ppap", "trajectory": {k: table[k] for k in table if k != "z"}}
        )


def test_without_efforts_a_singular_wall_is_passed_and_told(tmp_path):
    text = (MOTIONS / "4-ups-rps-paper.toml").read_text().replace("# efforts", "efforts")
    (tmp_path / "motion.toml").write_text(text)
    result = here("motion", "motion.toml", "--out", "run", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "at t = 1 s LCI" in result.stdout
    motion = numbers(tmp_path / "run" / "motion.csv")
    assert not any("effort" in name or "energy" in name for name in motion)
    assert all(np.isfinite(column).all() for column in motion.values())
    # The models' page, at t = 0.
    expected = [1205.1648814239, 1056.3768541278, 1111.3116223134, 1282.1937663912, 1286.5148540868]
    found = [motion[f"l{k}"][0] for k in range(1, 6)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=6e-11)
