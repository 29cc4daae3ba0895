"""What people type by mistake, and the one line that names the cause."""

import shutil
import tomllib

import pytest
from support.cli_runner import CONFIGS, here

from pmopt import api

MOTION = "motion.toml"
SEARCH = "search.toml"
BATCH = "batch.toml"
RECORD = "record.csv"
RUN = "run"

MISTAKES = [
    # another command's file, a run, a mechanism
    (["pareto", MOTION], "motion.toml: is the configuration of a motion: pmopt motion motion.toml"),
    (["motion", SEARCH], "is the configuration of a search: pmopt pareto search.toml"),
    (["simulate", BATCH], "is the configuration of a batch: pmopt batch batch.toml"),
    (["pareto", BATCH], "is the configuration of a batch: pmopt batch batch.toml"),
    (["pareto", RUN], "run: is a finished run of pmopt pareto: pmopt plot run draws it"),
    (["motion", RUN], "is a finished run of pmopt pareto"),
    (["batch", RUN], "run: is a finished run of pmopt pareto"),
    (["batch", "."], ".: is a folder; a quoted glob like './*.toml' is needed"),
    (["pareto", "run/front.csv"], "is a table, no configuration; a TOML file is needed"),
    (["pareto", "run/manifest.json"], "is a finished run of pmopt pareto"),
    (["motion", RECORD], "is a table, no configuration"),
    (["pareto", "run/front.png"], "is a picture or page"),
    (["pareto", "2pauu-ppap"], "is a mechanism, pmopt pareto needs a configuration: pmopt init"),
    (["motion", "2uu-upu"], "is a mechanism, pmopt motion needs a configuration"),
    (["pareto", "none.toml"], "none.toml: no such file"),
    (["workspace", SEARCH], "search.toml is the configuration of a search: pmopt pareto"),
    (["workspace", RUN], "run is a finished run of pmopt pareto"),
    (["workspace", MOTION], "is the configuration of a motion"),
    (["plot", SEARCH], "is the configuration of a search: pmopt pareto search.toml"),
    (["plot", "none"], "none: no such folder; the folder of a finished run is needed"),
    (["plot", "."], "is a folder; the folder of a finished run is needed"),
    # names in the wrong place
    (["workspace", "2pauu-ppap", "--limits", "x=0:1"], "--limits: x is a pose coordinate"),
    (["workspace", "2pauu-ppap", "--domain", "theta1=0:1"], "theta1 is an actuated joint"),
    (["workspace", "2pauu-ppap", "--domain", "l1=0:1"], "l1 is a parameter"),
    (["singularities", "3-cur", "--domain", "alpha=0:1"], "alpha is parasitic: it follows"),
    (["certify", "2pauu-ppap", "--limits", "l1=0:1"], "--limits: l1 is a parameter"),
    (["workspace", "2pauu-ppap", "--params", "x=1"], "--params: x is a pose coordinate: --pose"),
    (["ik", "2pauu-ppap", "--pose", "theta1=1"], "theta1 is an actuated joint: --joints gives it"),
    (["fk", "2pauu-ppap", "--joints", "x=1"], "x is a pose coordinate: --pose gives it"),
    (["pareto", "domain.toml"], "workspace.domain: theta1 is an actuated joint"),
    (["pareto", "limits.toml"], "workspace.limits: x is a pose coordinate"),
    # forms of pairs and ranges
    (["ik", "2pauu-ppap", "--pose", "x=1 y=2 z=3"], "not NAME=VALUE: x=1,y=2,z=3?"),
    (["ik", "2pauu-ppap", "--pose", "x=1;y=2;z=3"], "not NAME=VALUE: x=1,y=2,z=3?"),
    (["ik", "2pauu-ppap", "--pose", "x: 1, y: 2"], "not NAME=VALUE: x=1,y=2?"),
    (["ik", "2pauu-ppap", "--pose", "0.1,0.2,1.2"], "each value needs a name"),
    (["ik", "2pauu-ppap", "--pose", "x=1", "y=2", "z=3"], "commas, without spaces, behind their"),
    (["ik", "2pauu-ppap", "x=1,y=2,z=3"], "--pose x=1,y=2,z=3"),
    (["workspace", "2pauu-ppap", "--params", "l1=0,8"], "a decimal point is needed, l1=0.8"),
    (["workspace", "2pauu-ppap", "l1=0.8"], "--params l1=0.8"),
    (["workspace", "2pauu-ppap", "--params", "l1=0.8", "l2=0.9"], "--params l1=0.8,l2=0.9"),
    (["workspace", "2pauu-ppap", "--limits", "theta1=[0,1]"], "LOWER:UPPER, without brackets"),
    (["workspace", "2pauu-ppap", "--limits", "theta1=0-1"], "such as theta1=0:1"),
    (["workspace", "2pauu-ppap", "--limits", "theta1=1:0"], "LOWER:UPPER with LOWER < UPPER"),
    (["workspace", "2pauu-ppap", "--tool", "1,2"], "three numbers X,Y,Z are needed"),
    # options and commands
    (["workspace", "2pauu-ppap", "--l1", "0.8"], "--l1 is not an option: --params l1=VALUE is"),
    (["ik", "2pauu-ppap", "--x", "0.8"], "--x is not an option: --pose x=VALUE is"),
    (["workspace", "2pauu-ppap", "--x", "0:1"], "--x is not an option: --domain x=LOWER:UPPER is"),
    (["ik", "2pauu-ppap", "--joints", "theta1=1"], "not an option of pmopt ik, but of fk"),
    (["fk", "2pauu-ppap", "--pose", "x=1"], "not an option of pmopt fk, but of ik"),
    (["workspace", "2pauu-ppap", "--sample", "9"], "--samples"),
    (["workspace"], "MECH is missing: one of 2pauu-ppap"),
    (["pareto"], "CONFIG.toml is missing: pmopt init MECH writes one"),
    (["Workspace", "2pauu-ppap"], "nearest: workspace"),
    (["pmopt", "list"], "pmopt is given twice: pmopt list"),
    # files
    (["ik", "2pauu-ppap", "--poses", "run/front.csv"], "x is missing, needed: x, y, z; the header"),
    (["ik", "2pauu-ppap", "--poses", SEARCH], "search.toml: "),
    (["ik", "2pauu-ppap", "--poses", "run/front.png"], "is not a CSV file"),
    (["draw", "3-cur", "--out", "a.docx"], ".docx is not offered, allowed: .png, .svg, .pdf"),
    (["draw", "3-cur", "--out", "a"], "no suffix is not offered"),
    (["export", "3-cur", "--out", "a.urdf"], ".urdf is not offered, allowed: .xml, .mjcf"),
    (["export", "3-cur", "--out", "a.stl"], ".stl is not offered"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mistakes")
    shutil.copy(CONFIGS / "quickstart.toml", folder / SEARCH)
    shutil.copy(CONFIGS / "batch/links.toml", folder / BATCH)
    shutil.copy(CONFIGS / "motion/2uu-upu-t1.toml", folder / MOTION)
    shutil.copy(CONFIGS / "motion/3-ups-sp-strokes.csv", folder / RECORD)
    head = 'mechanism = "2pauu-ppap"\n'
    (folder / "domain.toml").write_text(head + "[workspace.domain]\ntheta1 = [0, 1]\n")
    (folder / "limits.toml").write_text(head + "[workspace.limits]\nx = [0, 1]\n")
    config = tomllib.loads((CONFIGS / "quickstart.toml").read_text())
    config["algorithm"] |= {"population": 8, "generations": 2}
    config["workspace"] |= {"samples": 256}
    config["final"] = {"target_error": 0.1}
    api.pareto(config, folder / RUN)
    return folder


@pytest.mark.parametrize(("words", "says"), MISTAKES, ids=lambda v: " ".join(v)[:60])
def test_the_cause_is_named_in_one_line(words, says, folder):
    result = here(*words, cwd=folder)
    assert result.returncode == 2
    assert result.stdout == ""
    assert len(result.stderr.splitlines()) == 1
    assert says in result.stderr


def test_help_is_a_command(folder):
    whole, one = here("help", cwd=folder), here("help", "workspace", cwd=folder)
    assert (whole.returncode, one.returncode) == (0, 0)
    assert "Commands" in whole.stdout
    assert one.stdout == here("workspace", "--help", cwd=folder).stdout


@pytest.mark.parametrize(
    ("form", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")]
)
def test_pictures_are_what_their_suffix_says(form, begins, folder, tmp_path):
    out = tmp_path / f"a.{form}"
    assert here("draw", "3-cur", "--out", out, cwd=folder).returncode == 0
    assert out.read_bytes().startswith(begins)
    assert b"image/png" not in out.read_bytes()
    again = tmp_path / f"b.{form}"
    here("draw", "3-cur", "--out", again, cwd=folder)
    assert again.read_bytes() == out.read_bytes()
    plotted = here("plot", RUN, "--out", tmp_path, "--picture-format", form, cwd=folder)
    assert plotted.returncode == 0
    assert (tmp_path / f"front.{form}").read_bytes().startswith(begins)


@pytest.mark.parametrize(
    "command",
    [["jacobian"], ["draw", "--out", "a.png"], ["export", "--out", "a.xml"]],
    ids=lambda words: words[0],
)
def test_strokes_of_ours_may_be_others(command, tmp_path):
    """h3 of this pose is beyond the stroke of 0.3 m that the mechanism has from us."""
    name, *options = command
    pose = ["3-cur", "--pose", "z=0.55,beta=0.25,gamma=0.15", *options]
    refused = here(name, *pose, cwd=tmp_path)
    assert refused.returncode == 2
    assert "misses its stroke" in refused.stderr
    wider = "h1=0:800mm,h2=0:0.8,h3=0:0.8"
    assert here(name, *pose, "--limits", wider, cwd=tmp_path).returncode == 0
