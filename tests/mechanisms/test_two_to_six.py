"""Planar mechanisms of two and three coordinates and one of six, through every command."""

from pathlib import Path

import numpy as np
import pytest
from support import five_bar, gough, naive, planar, plugins
from support.cli_runner import answer, here, json_answer

from pmopt.analysis.certification.enclosing import enclose
from pmopt.analysis.kinematics.jacobian import jacobian_at
from pmopt.analysis.mobility.freedom import mobility_of
from pmopt.analysis.regions.sections import section_fields
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms import registry
from pmopt.reporting.pictures.drawing import draw_mechanism
from pmopt.testing import check_mechanism, kept

MECHANISMS = {m.name: m for m in (five_bar.MECHANISM, planar.MECHANISM, gough.MECHANISM)}
POSES = {
    "five-bar": "x=0.1,y=0.7",
    "3-rrr": "x=0.02,y=0.01,phi=0.3",
    "6-ups": "x=0,y=0.02,z=0.55,yaw=0.1,pitch=0,roll=0.05",
}
MOTIONS = {
    "five-bar": 'x = "0.1*sin(pi*t)"\ny = "0.7 + 0.05*cos(pi*t)"\n',
    "3-rrr": 'x = "0.02*sin(pi*t)"\ny = "0.01"\nphi = "0.3 + 0.1*sin(pi*t)"\n',
    "6-ups": 'x = "0.05*sin(pi*t)"\ny = "0.03*cos(pi*t)"\nz = "0.55"\nyaw = "0.1*sin(pi*t)"\n'
    'pitch = "0.05*sin(pi*t)"\nroll = "0.02*t"\n',
}
BOXES = {
    "five-bar": "x=-0.05:0.05,y=0.7:0.75",
    "3-rrr": "x=-0.01:0.01,y=-0.01:0.01,phi=0.29:0.31",
    "6-ups": "z=0.54:0.56,"
    + ",".join(f"{c}=-0.01:0.01" for c in ("x", "y", "yaw", "pitch", "roll")),
}
SEARCHED = {
    "five-bar": "a = [0.1, 0.4]\nl1 = [0.3, 0.9]\n",
    "3-rrr": "r = [0.1, 0.2]\n",
    "6-ups": "r = [0.25, 0.4]\n",
}
every = pytest.mark.parametrize("name", MECHANISMS)


@pytest.fixture
def plugged(monkeypatch, tmp_path):
    """Install the folder of the example, and the other mechanism beside it."""
    site = tmp_path / "site"
    plugins.install(
        site,
        {
            "five-bar": ("five_bar:MECHANISM", (five_bar.FOLDER / "five_bar.py").read_text()),
            "planar": ("plugged_planar:MECHANISM", Path(planar.__file__).read_text()),
            "gough": ("plugged_gough:MECHANISM", Path(gough.__file__).read_text()),
        },
    )
    monkeypatch.syspath_prepend(site)
    registry._registry.cache_clear()
    yield site
    registry._registry.cache_clear()
    kept.require_checked.cache_clear()


@every
def test_they_hold(name):
    assert check_mechanism(MECHANISMS[name]).held


def test_the_example_says_what_is_looked_for():
    text = (five_bar.FOLDER / "pyproject.toml").read_text()
    assert f'[project.entry-points."{registry.ENTRY_POINT_GROUP}"]' in text
    assert 'five-bar = "five_bar:MECHANISM"' in text


@every
def test_single_poses_as_plugins(name, plugged, tmp_path):
    found = json_answer("ik", name, "--pose", POSES[name], cwd=tmp_path)
    solution = found["solutions"][0]
    joints = ",".join(f"{k}={v!r}" for k, v in solution["joints"].items())
    back = json_answer("fk", name, "--joints", joints, cwd=tmp_path)
    given = dict(pair.split("=") for pair in POSES[name].split(","))
    gaps = [max(abs(s["pose"][k] - float(v)) for k, v in given.items()) for s in back["solutions"]]
    assert min(gaps) < 1e-9
    assert MECHANISMS[name].title in answer("info", name, cwd=tmp_path)
    assert here("init", name, cwd=tmp_path).returncode == 0
    assert here("check", name, cwd=tmp_path).returncode == 0


@every
def test_index_is_that_of_the_velocity_maps(name):
    mechanism = MECHANISMS[name]
    params = mechanism.resolve({})
    pose = {k: float(v) for k, v in (pair.split("=") for pair in POSES[name].split(","))}
    solution = mechanism.inverse(params, pose)[0]
    j_x, j_q = mechanism.velocity_maps(params, pose, solution.joints)
    rows, columns = mechanism.homogenizing(mechanism.characteristic_length(params))
    inverse = columns[:, None] * np.linalg.solve(j_q, j_x) / rows
    result = jacobian_at(mechanism, {}, pose, kind="homogenized")
    assert result.lci == pytest.approx(naive.inverse_condition(inverse, "2"), abs=1e-10)


@pytest.mark.parametrize(
    ("name", "freedom", "kind"),
    [("five-bar", 2, "1T1R"), ("3-rrr", 3, "2T1R"), ("6-ups", 6, "3T3R")],
)
def test_mobility(name, freedom, kind):
    found = mobility_of(MECHANISMS[name], samples=3)
    assert (found.freedom, found.kind, found.full_cycle.freedom) == (freedom, kind, freedom)
    assert found.closed_form is not None
    assert found.closed_form.holds


def test_a_coordinate_called_pitch_has_its_unit():
    units = mobility_of(gough.MECHANISM, samples=1).units
    assert units["pitch"] == "rad"
    assert units["screw pitch"] == "m/rad for twists, m for wrenches"


@every
def test_they_are_drawn(name):
    mechanism = MECHANISMS[name]
    params = mechanism.resolve({})
    picture = draw_mechanism(mechanism, params, mechanism.home(params), mechanism.working_modes[0])
    assert picture[:8] == b"\x89PNG\r\n\x1a\n"


@every
def test_their_kernels_are_proven_of(name):
    mechanism = MECHANISMS[name]
    design = make_sampler(mechanism, WorkspaceSettings(), threads=1).design(mechanism.resolve({}))
    assert enclose(mechanism, design) is not None


@pytest.mark.slow
@every
def test_every_command(name, plugged, tmp_path):
    """Exit code 0, and every picture is drawn."""
    motion = f'mechanism = "{name}"\n[trajectory]\nspace = "task"\nduration = 2.0\nstep = 0.1\n'
    (tmp_path / "motion.toml").write_text(motion + MOTIONS[name])
    (tmp_path / "pareto.toml").write_text(
        f'mechanism = "{name}"\n[parameters]\n{SEARCHED[name]}[workspace]\nsamples = 1000\n'
        "[algorithm]\npopulation = 8\ngenerations = 2\n[final]\ntarget_error = 0.4\n"
    )
    for words in (
        ("jacobian", name, "--pose", POSES[name]),
        ("draw", name, "--out", "draw.png"),
        ("workspace", name, "--samples", 4000, "--out", "workspace"),
        ("singularities", name, "--samples", 2000, "--out", "singularities"),
        ("certify", name, "--domain", BOXES[name], "--min-lci", 0.05),
        ("capability", name, "--speed", 1, "--samples", 2048, "--out", "capability"),
        ("motion", "motion.toml", "--out", "motion"),
        ("pareto", "pareto.toml", "--out", "pareto"),
    ):
        result = here(*words, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
        assert "not drawn" not in result.stderr
    for folder in ("workspace", "singularities"):
        assert (tmp_path / folder / "sections.png").exists()
        assert (tmp_path / folder / "mechanism.png").exists()


@pytest.mark.slow
def test_the_section_of_two_coordinates_is_the_workspace():
    mechanism = five_bar.MECHANISM
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    (section,) = section_fields(sampler, sampler.design(mechanism.resolve({})), 60)
    assert section.names == ("x", "y")
    assert section.plane == "all poses"
    assert 0.5 < (section.inside >= 0).mean() < 0.95
