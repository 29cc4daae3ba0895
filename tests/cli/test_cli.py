"""Every command: results, forms, exit codes, files, streams and the one line of an error."""

import hashlib
import math
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys

import pytest
from support.cli_runner import (
    COMMAND,
    CONFIGS,
    TIMEOUT,
    Terminal,
    answer,
    csv_answer,
    csv_rows,
    environment,
    error_line,
    files_in,
    here,
    json_answer,
    pmopt,
    pmopt_all,
    strict_json,
)

import pmopt as package
from pmopt.cli.commands import COMMANDS
from pmopt.execution import threads

MECH = "2pauu-ppap"
POSE = "x=0.1,y=0.2,z=1.2"
JOINTS = "theta1=0.4,theta2=0.1,d=0.2"
M, N, L1, L2, C = 1.0, 0.7, 0.65, 1.5, 0.1  # the defaults
FORMS = ("table", "json", "csv")
MODES = ["out-out", "in-in", "out-in", "in-out"]
SMALL = ("--samples", "20000", "--shape-grid", "0")
# Angles and lengths of size 1 through a dozen operations of double precision.
ROUNDING = 1e-12

SHORT = {
    "list": ("list",),
    "info": ("info", MECH),
    "ik": ("ik", MECH, "--pose", POSE),
    "fk": ("fk", MECH, "--joints", JOINTS),
    "jacobian": ("jacobian", MECH, "--pose", POSE),
    "workspace": ("workspace", MECH, *SMALL),
}


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile the kernels, or a first process says on stderr that it does."""
    package.workspace(MECH, samples=1000, shape_grid=8)


def link_lengths(pose, joints):
    """Return the distances of the links' ends, from the paper's figure 1: both must be l2."""
    x, y, z = pose["x"], pose["y"], pose["z"]
    t1, t2 = joints["theta1"], joints["theta2"]
    c1 = (M + L1 * math.cos(t1), 0.0, 2 * C - L1 * math.sin(t1))
    c2 = (-M - L1 * math.cos(t2), 0.0, 2 * C - L1 * math.sin(t2))
    return math.dist(c1, (x + N, y, z)), math.dist(c2, (x - N, y, z))


# --- help and examples --------------------------------------------------------------------


def example_of(text):
    """Return the command below ``Example:`` of a help text."""
    found = re.search(r"^ *Example:\n *(pmopt .+)$", text, re.MULTILINE)
    assert found, text
    return found.group(1).strip()


def test_help_of_the_program(tmp_path):
    text = answer("--help", cwd=tmp_path)
    assert all(re.search(rf"^  {name} ", text, re.MULTILINE) for name in COMMANDS)
    assert example_of(text).split()[1] in COMMANDS
    assert answer("-h", cwd=tmp_path) == text
    assert re.fullmatch(r"pmopt, version \d+\.\d+\.\d+\S*\n", answer("--version", cwd=tmp_path))


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """Run the example of each command's help, as pasted, in one folder beside the configs."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(CONFIGS, folder / "configs")
    program = " ".join(map(shlex.quote, COMMAND))
    found = {}
    for name in COMMANDS:
        example = example_of(answer(name, "--help", cwd=folder))
        home = {"HOME": str(folder)} if "~" in example else {}
        found[name] = example, subprocess.run(
            example.replace("pmopt", program, 1), shell=True, cwd=folder, timeout=TIMEOUT,
            env=environment(**home), capture_output=True, text=True,
        )  # fmt: skip
    return folder, found


@pytest.mark.parametrize("name", COMMANDS)
def test_example_of_the_help_runs(examples, name):
    example, result = examples[1][name]
    assert example.startswith(f"pmopt {name} ")
    assert result.returncode == 0, result.stderr
    assert "Traceback" not in result.stderr


def test_examples_write_what_they_say(examples):
    folder, _ = examples
    assert (folder / "my-design.toml").is_file()
    assert (folder / "outputs/quickstart/front.csv").is_file()
    assert files_in(folder / "pictures") == ["front.png", "history.png"]
    for name in files_in(folder / "pictures"):
        drawn = (folder / "pictures" / name).read_bytes()
        assert drawn == (folder / "outputs/quickstart" / name).read_bytes()
    assert "_PMOPT_COMPLETE" in (folder / ".bashrc").read_text()


# --- the three forms ----------------------------------------------------------------------


@pytest.mark.parametrize("name", SHORT)
def test_forms_hold_the_same_and_only_the_result(tmp_path, name):
    commands = [(*SHORT[name], "--format", form) for form in FORMS]
    runs = dict(zip(FORMS, pmopt_all(commands, tmp_path), strict=True))
    for command, run in zip(commands, runs.values(), strict=True):
        assert run.returncode == 0, run.stderr
        assert "\x1b" not in run.stdout + run.stderr
        assert "\r" not in run.stdout + run.stderr
        assert run.stdout == answer(*command, cwd=tmp_path)
    assert strict_json(runs["json"].stdout)
    assert csv_rows(runs["csv"].stdout)
    assert answer(*SHORT[name], cwd=tmp_path) == runs["table"].stdout
    assert files_in(tmp_path) == []


def test_list(tmp_path):
    document = json_answer("list", cwd=tmp_path)
    assert [m["name"] for m in document["mechanisms"]][:1] == [MECH]
    assert [r["name"] for r in csv_answer("list", cwd=tmp_path)] == [
        m["name"] for m in document["mechanisms"]
    ]
    assert MECH in answer("list", cwd=tmp_path)


def test_info(tmp_path):
    document = json_answer("info", "2PaUU PPaP", cwd=tmp_path)
    assert document["mechanism"] == MECH
    assert len(document["limbs"]) == 3
    assert [p["name"] for p in document["parameters"]] == ["m", "n", "l1", "l2", "c", "h"]
    assert [p["default"] for p in document["parameters"]] == [M, N, L1, L2, C, None]
    assert all(p["unit"] == "m" and p["source"] for p in document["parameters"])
    assert document["parameters"][1]["bounds"] == [0.2, 1.0]
    assert [(c["name"], c["unit"]) for c in document["pose"]] == [
        ("x", "m"),
        ("y", "m"),
        ("z", "m"),
    ]
    assert [(c["name"], c["unit"]) for c in document["joints"]] == [
        ("theta1", "rad"), ("theta2", "rad"), ("d", "m"),
    ]  # fmt: skip
    assert document["working_modes"] == MODES
    assert "limits" in document
    bodies = {b["name"]: b for b in document["bodies"]}
    assert bodies["platform"]["limb"] == "platform"
    assert bodies["limb 1 link"]["mass"] > 0
    assert document["units"]["mass"] == "kg"
    rows = csv_answer("info", MECH, cwd=tmp_path)
    found = [r for r in rows if r["table"] == "parameter"]
    assert [(r["name"], r["default"], r["lower"]) for r in found] == [
        (
            p["name"],
            *("" if v is None else repr(v) for v in (p["default"], (p["bounds"] or [None])[0])),
        )
        for p in document["parameters"]
    ]
    table = answer("info", MECH, cwd=tmp_path)
    assert all(word in table for word in ("theta1", "rad", "out-in", "limb 3", "l2", "0.5 .. 1.5"))


# --- ik, fk, jacobian ---------------------------------------------------------------------


def test_ik_of_all_modes_and_of_one(tmp_path):
    document = json_answer(*SHORT["ik"], cwd=tmp_path)
    assert set(document) == {"mechanism", "pose", "solutions", "units"}
    assert document["pose"] == {"x": 0.1, "y": 0.2, "z": 1.2}
    assert [s["working_mode"] for s in document["solutions"]] == MODES
    for solution in document["solutions"]:
        assert set(solution) == {"working_mode", "joints", "parasitic", "within_limits"}
        assert list(solution["joints"]) == ["theta1", "theta2", "d"]
        assert all(-math.pi < solution["joints"][k] <= math.pi for k in ("theta1", "theta2"))
        assert solution["within_limits"] is True
        lengths = link_lengths(document["pose"], solution["joints"])
        assert lengths == pytest.approx((L2, L2), abs=ROUNDING)
    assert len({tuple(s["joints"].values()) for s in document["solutions"]}) == 4
    units = {"x": "m", "y": "m", "z": "m", "theta1": "rad", "theta2": "rad", "d": "m"}
    assert document["units"] == units
    one = json_answer(*SHORT["ik"], "--working-mode", "out-in", cwd=tmp_path)
    assert one["solutions"] == [document["solutions"][2]]
    rows = csv_answer(*SHORT["ik"], cwd=tmp_path)
    assert [float(r["theta1"]) for r in rows] == [
        s["joints"]["theta1"] for s in document["solutions"]
    ]
    assert "theta1 (rad)" in answer(*SHORT["ik"], cwd=tmp_path)


@pytest.mark.parametrize(
    ("option", "inside"),
    [
        (("--limits", "theta1=-1.5:1.5"), [True, False, True, False]),
        (("--limits", "d=0.3:1"), [False] * 4),
        (("--limits", "theta1=-inf:inf"), [True] * 4),
        (("--params", "h=1.1"), [False] * 4),
    ],
)
def test_ik_tells_what_is_within_limits(tmp_path, option, inside):
    document = json_answer(*SHORT["ik"], *option, cwd=tmp_path)
    assert [s["within_limits"] for s in document["solutions"]] == inside


def test_fk_has_two_solutions(tmp_path):
    document = json_answer(*SHORT["fk"], cwd=tmp_path)
    assert set(document) == {"mechanism", "joints", "solutions", "complete", "units"}
    assert document["complete"] == "proven"
    assert document["joints"] == {"theta1": 0.4, "theta2": 0.1, "d": 0.2}
    first, second = document["solutions"]
    for solution in (first, second):
        assert set(solution) == {"pose", "parasitic", "residual"}
        assert abs(solution["residual"]) < ROUNDING
        lengths = link_lengths(solution["pose"], document["joints"])
        assert lengths == pytest.approx((L2, L2), abs=ROUNDING)
    assert first["pose"]["z"] > second["pose"]["z"]
    assert document["units"]["residual"] == "m"
    assert len(csv_answer(*SHORT["fk"], cwd=tmp_path)) == 2


def test_jacobian_keys(tmp_path):
    document = json_answer(*SHORT["jacobian"], cwd=tmp_path)
    assert {
        "mechanism", "pose", "J_X", "J_q", "J", "singular_values", "lci", "lci_raw",
        "lci_homogenized", "characteristic_length", "units",
    } <= set(document)  # fmt: skip
    shapes = {k: (len(document[k]), len(document[k][0])) for k in ("J_X", "J_q", "J")}
    assert set(shapes.values()) == {(3, 3)}
    values = document["singular_values"]
    assert values == sorted(values, reverse=True)
    # The index is the ratio of the printed singular values up to rounding of an SVD.
    assert document["lci_raw"] == pytest.approx(values[-1] / values[0], rel=ROUNDING)
    assert document["lci"] == document["lci_raw"]
    assert document["characteristic_length"] == L1
    assert {"J", "singular_values", "characteristic_length", "lci"} <= set(document["units"])
    rows = csv_answer(*SHORT["jacobian"], cwd=tmp_path)
    indices = {r["quantity"]: r["value"] for r in rows}
    assert float(indices["lci_raw"]) == document["lci_raw"]


def test_jacobian_asked_for_homogenized(tmp_path):
    options = (), ("--jacobian", "homogenized"), *(
        ("--characteristic-length", length) for length in (L1, 1)
    )  # fmt: skip
    commands = [(*SHORT["jacobian"], *given) for given in options]
    raw, kind, length, unit = (json_answer(*command, cwd=tmp_path) for command in commands)
    assert kind["lci"] == kind["lci_homogenized"] == raw["lci_homogenized"] != raw["lci"]
    assert length["lci"] == kind["lci"]
    # Dividing by 1 m changes nothing.
    assert unit["lci"] == unit["lci_homogenized"] == raw["lci_raw"]


def test_a_singular_pose_is_an_answer(tmp_path):
    """At x = y = 0 both limbs are stretched where z - 2c = sqrt((l1 + l2)^2 - (m - n)^2)."""
    z = 2 * C + math.sqrt((L1 + L2) ** 2 - (M - N) ** 2)
    document = json_answer("jacobian", MECH, "--pose", f"x=0,y=0,z={z!r}", cwd=tmp_path)
    assert document["J"] is None
    assert document["singular_values"] is None
    assert document["lci"] == document["lci_raw"] == document["lci_homogenized"] == 0.0
    assert len(document["J_X"]) == len(document["J_q"]) == 3
    near = json_answer("jacobian", MECH, "--pose", f"x=0,y=0,z={z - 1e-3!r}", cwd=tmp_path)
    assert near["J"] is not None
    assert 0 < near["lci"] < 0.1
    beyond = here("jacobian", MECH, "--pose", f"x=0,y=0,z={z + 1e-3!r}", cwd=tmp_path)
    assert "out of reach" in error_line(beyond)


@pytest.mark.parametrize("command", ["ik", "jacobian"])
def test_out_of_reach_names_limb_and_miss(tmp_path, command):
    """In the plane y = 0 the miss is what the stretched limb lacks: r - l1 - l2."""
    result = pmopt(command, MECH, "--pose", "x=9,y=0,z=1", cwd=tmp_path)
    assert result.stdout == ""
    line = error_line(result)
    misses = dict(re.findall(r"(limb \d) misses by ([\d.]+) m", line))
    for limb, a in (("limb 1", M - N - 9), ("limb 2", M - N + 9)):
        miss = math.hypot(a, 1 - 2 * C) - L1 - L2
        assert float(misses[limb]) == pytest.approx(miss, rel=1e-5)  # six digits are printed
    assert "x=9," in line


def test_out_of_reach_names_only_the_limb_that_misses(tmp_path):
    result = here("ik", MECH, "--pose", "x=0.1,y=0,z=1", cwd=tmp_path)
    line = error_line(result)
    assert "limb 1" in line
    assert "limb 2" not in line
    # Too close: l2 is longer than the folded limb can take, r + l1 < l2.
    miss = L2 - L1 - math.hypot(M - N - 0.1, 1 - 2 * C)
    assert float(re.search(r"by ([\d.]+) m", line).group(1)) == pytest.approx(miss, rel=1e-5)


# --- many poses at once -------------------------------------------------------------------


def written(folder, text, name="rows.csv"):
    (folder / name).write_text(text, encoding="utf-8")
    return name


def test_poses_of_a_file(tmp_path):
    poses = [(0.1, 0.2, 1.2), (0.0, 0.0, 1.1), (-0.3, -0.5, 1.5)]
    text = "x,y,z\n" + "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in poses)
    name = written(tmp_path, text)
    documents = json_answer("ik", MECH, "--poses", name, cwd=tmp_path)
    assert len(documents) == 3
    for (x, y, z), document in zip(poses, documents, strict=True):
        assert document == json_answer("ik", MECH, "--pose", f"x={x},y={y},z={z}", cwd=tmp_path)
    rows = csv_answer("ik", MECH, "--poses", name, "--working-mode", "in-in", cwd=tmp_path)
    assert [(float(r["x"]), float(r["y"]), float(r["z"])) for r in rows] == poses
    assert [r["row"] for r in rows] == ["1", "2", "3"]
    # A byte-order mark and carriage returns, as spreadsheets write them.
    windows = "\ufeff" + text.replace("\n", "\r\n")
    again = json_answer("ik", MECH, "--poses", written(tmp_path, windows, "w.csv"), cwd=tmp_path)
    assert again == documents


def test_joints_of_a_file_in_degrees(tmp_path):
    radians = [math.radians(20.0), math.radians(-7.5)]
    degrees = written(tmp_path, "theta1_deg,theta2_deg,d\n20,-7.5,0.2\n0,90,0.1\n")
    plain = f"theta1,theta2,d\n{radians[0]!r},{radians[1]!r},0.2\n0,{math.radians(90)!r},0.1\n"
    found = json_answer("fk", MECH, "--joints-file", degrees, cwd=tmp_path)
    assert found == json_answer("fk", MECH, "--joints-file", written(tmp_path, plain, "r.csv"),
                                cwd=tmp_path)  # fmt: skip
    assert list(found[0]["joints"].values()) == [*radians, 0.2]
    inline = json_answer(
        "fk", MECH, "--joints", "theta1_deg=20,theta2_deg=-7.5,d=0.2", cwd=tmp_path
    )
    assert inline == found[0]


def test_rows_out_of_reach_are_kept_and_said(tmp_path):
    name = written(tmp_path, "x,y,z\n0,0,1.1\n5,0,1\n0,0,99\n")
    result = here("ik", MECH, "--poses", name, "--format", "json", cwd=tmp_path)
    assert [len(d["solutions"]) for d in strict_json(result.stdout)] == [4, 0, 0]
    line = error_line(result)
    assert f"{name}, line 3" in line
    assert "limb 1 misses by" in line
    assert "2 of 3 rows" in line


BAD_FILES = {
    "bad cell": ("x,y,z\n0,0,1.1\n0,abc,1\n", ("line 3", "y=abc", "finite number")),
    "not finite": ("x,y,z\n0,0,inf\n", ("line 2", "z=inf", "finite number")),
    "empty cell": ("x,y,z\n0,,1\n", ("line 2", "y=", "finite number")),
    "short row": ("x,y,z\n0,0\n", ("line 2", "header")),
    "long row": ("x,y,z\n0,0,1,5\n", ("line 2", "header")),
    "no rows": ("x,y,z\n", ("no rows", "x, y, z")),
    "empty": ("", ("no rows", "x, y, z")),
    "column missing": ("x,y\n0,0\n", ("z is missing",)),
    "column misspelt": ("x,y,w\n0,0,1\n", ("z is missing", "x, y, z", "has x, y, w")),
    "column twice": ("x,x,y,z\n0,0,0,1\n", ("twice",)),
    "degrees of a length": ("x_deg,y,z\n0,0,1\n", ("x_deg", "x, y, z")),
    "points among commas": ("x;y;z\n0,5;0.1;1\n", ("line 2", "0.1", "decimal comma")),
    "too large": ("x,y,z\n0,0,1e10\n", ("line 2", "z=1", "1e+09 m")),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_poses_file(tmp_path, case):
    text, fragments = BAD_FILES[case]
    line = error_line(here("ik", MECH, "--poses", written(tmp_path, text), cwd=tmp_path))
    assert all(fragment in line for fragment in ("--poses", "rows.csv", *fragments)), line


def test_bad_poses_file_that_is_no_text(tmp_path):
    (tmp_path / "rows.csv").write_bytes(b"\xff\xfe\x00x")
    assert "rows.csv" in error_line(here("ik", MECH, "--poses", "rows.csv", cwd=tmp_path))
    (tmp_path / "folder").mkdir()
    assert "folder" in error_line(here("ik", MECH, "--poses", "folder", cwd=tmp_path))


def test_bad_joints_file_names_the_column_in_degrees(tmp_path):
    name = written(tmp_path, "theta1_deg,theta2,d\n10,0,x\n")
    line = error_line(here("fk", MECH, "--joints-file", name, cwd=tmp_path))
    assert "--joints-file" in line
    assert "line 2: d=x" in line
    name = written(tmp_path, "theta1_deg,theta1,theta2,d\n10,0,0,0\n")
    line = error_line(here("fk", MECH, "--joints-file", name, cwd=tmp_path))
    assert "theta1 is given twice" in line


def test_line_number_after_a_blank_line(tmp_path):
    name = written(tmp_path, "x,y,z\n0,0,1.1\n\n0,abc,1\n")
    assert "line 4" in error_line(here("ik", MECH, "--poses", name, cwd=tmp_path))


def test_column_twice_but_for_a_space(tmp_path):
    name = written(tmp_path, "x, x,y,z\n0,0.1,0,1.1\n")
    assert "twice" in error_line(here("ik", MECH, "--poses", name, cwd=tmp_path))


def test_columns_do_not_depend_on_the_number_of_rows(tmp_path):
    one = csv_answer("ik", MECH, "--poses", written(tmp_path, "x,y,z\n0,0,1.1\n"), cwd=tmp_path)
    text = "x,y,z\n0,0,1.1\n0,0,1.2\n"
    two = csv_answer("ik", MECH, "--poses", written(tmp_path, text), cwd=tmp_path)
    assert list(one[0]) == list(two[0])


def test_columns_do_not_depend_on_which_rows_are_out_of_reach(tmp_path):
    """Parasitic coordinates have columns also where the first pose is out of reach."""
    good, bad = "0.5,0,0\n", "99,0,0\n"
    heads = set()
    for name, rows in (("one", good), ("two", bad + good), ("three", bad)):
        path = tmp_path / f"{name}.csv"
        path.write_text(f"z,beta,gamma\n{rows}")
        result = here("ik", "3-cur", "--poses", path, "--format", "csv", cwd=tmp_path)
        assert result.returncode == (2 if bad in rows else 0), result.stderr
        heads.add(tuple(csv_rows(result.stdout)[0]))
    (head,) = heads
    assert {"h1", "h2", "h3", "x", "y", "alpha"} <= set(head)


# --- workspace ----------------------------------------------------------------------------


def test_workspace_keys(tmp_path):
    document = json_answer("workspace", MECH, "--samples", "20000", cwd=tmp_path)
    assert {
        "mechanism", "params", "length_unit", "working_mode", "norm", "jacobian",
        "characteristic_length", "sampler", "volume", "gci", "lci", "regions", "samples",
        "reachable", "units",
    } <= set(document)  # fmt: skip
    assert document["mechanism"] == MECH
    assert document["params"] == {"m": M, "n": N, "l1": L1, "l2": L2, "c": C, "h": None}
    assert (document["length_unit"], document["working_mode"]) == ("m", "out-out")
    assert (document["norm"], document["jacobian"]) == ("2", "raw")
    assert document["characteristic_length"] is None
    assert {"name", "samples", "seed", "grid"} <= set(document["sampler"])
    assert document["sampler"]["name"] == "r-sequence"
    assert document["sampler"]["samples"] == document["samples"] == 20000
    assert (document["sampler"]["seed"], document["sampler"]["grid"]) == (1, None)
    volume, gci, lci = document["volume"], document["gci"], document["lci"]
    assert volume["unit"] == document["units"]["volume"] == "m^3"
    assert set(volume) >= {"value", "unit"}
    assert set(volume) & {"standard_error", "error_bound"}
    assert set(gci) == {"value", "standard_error"}
    assert {"min", "max", "mean", "quantiles"} <= set(lci)
    assert list(lci["quantiles"]) == ["0.05", "0.5", "0.95"]
    ordered = [lci["min"], *lci["quantiles"].values(), lci["max"]]
    assert ordered == sorted(ordered)
    assert lci["mean"] == gci["value"]
    assert 0 < document["reachable"] < document["samples"]
    edges = [(r["lower"], r["upper"]) for r in document["regions"]]
    assert edges == [(0.0, 0.1), (0.1, 0.3), (0.3, 1.0)]
    assert all({"lower", "upper", "volume", "share"} <= set(r) for r in document["regions"])
    # Shares are counts over one total: only the division rounds.
    assert sum(r["share"] for r in document["regions"]) == pytest.approx(1, abs=1e-15 * 3)
    total = sum(r["volume"] for r in document["regions"])
    assert total == pytest.approx(volume["value"], rel=1e-15 * 3)


def test_workspace_options_are_taken(tmp_path):
    document = json_answer(
        "workspace", MECH, *SMALL, "--params", "m=1.2,l1=0.8", "--params", "h=1.5", "--sampler",
        "sobol", "--replicates", "10", "--seed", "7", "--working-mode", "in-in", "--norm", "fro",
        "--characteristic-length", "0.5", "--min-lci", "0.05", "--regions", "0,0.5,1",
        "--domain", "z=0.5:inf", "--limits", "d=-0.5:0.5", cwd=tmp_path,
    )  # fmt: skip
    assert document["params"] == {"m": 1.2, "n": N, "l1": 0.8, "l2": L2, "c": C, "h": 1.5}
    assert document["sampler"]["name"] == "sobol"
    assert document["sampler"]["seed"] == 7
    assert (document["working_mode"], document["norm"]) == ("in-in", "fro")
    assert (document["jacobian"], document["characteristic_length"]) == ("homogenized", 0.5)
    assert [r["upper"] for r in document["regions"]] == [0.5, 1.0]
    assert document["lci"]["min"] >= 0.05
    assert document["domain"]["z"] == [0.5, 1.5]
    assert document["domain"]["y"] == [-0.5, 0.5]


def test_workspace_by_grid_and_to_a_target_error(tmp_path):
    grid = json_answer("workspace", MECH, "--grid", "24", "--shape-grid", "0", cwd=tmp_path)
    assert (grid["sampler"]["name"], grid["sampler"]["grid"]) == ("grid", 24)
    assert grid["samples"] == 24**3
    target = ("--target-error", "2e-3", "--shape-grid", "0")
    fine = json_answer("workspace", MECH, *target, cwd=tmp_path)
    for quantity in (fine["volume"], fine["gci"]):
        assert 0 < quantity["standard_error"] <= 2e-3 * quantity["value"]
    # The grid's bound and four errors of the sample: hardly ever more by chance.
    for name in ("volume", "gci"):
        allowed = grid[name]["error_bound"] + 4 * fine[name]["standard_error"]
        assert abs(grid[name]["value"] - fine[name]["value"]) < allowed


def test_workspace_with_nothing_in_it(tmp_path):
    result = here("workspace", MECH, *SMALL, "--domain", "z=50:51", cwd=tmp_path)
    assert result.stdout == ""
    assert "nothing is reachable: domain: z=50:51 m" in error_line(result, code=3)


@pytest.mark.parametrize("end", ["-inf:1", "-1:inf"])
def test_workspace_with_an_open_limit(tmp_path, end):
    document = json_answer("workspace", MECH, *SMALL, "--limits", f"d={end}", cwd=tmp_path)
    assert document["reachable"] > 0


@pytest.mark.parametrize(
    "options",
    [
        ("--samples", "1_000_000", "--shape-grid", "24"),
        ("--samples", "1e6", "--sampler", "sobol", "--shape-grid", "0"),
        ("--grid", "80", "--shape-grid", "0"),
    ],
)
def test_any_number_of_threads_gives_the_same_bytes(tmp_path, options):
    command = ("workspace", MECH, "--format", "json", *options)
    one, two, three = (answer(*command, "--threads", n, cwd=tmp_path) for n in (1, 2, 3))
    assert one == two == three


def test_seed_changes_the_sample(tmp_path):
    one, two = (json_answer(*SHORT["workspace"], "--seed", s, cwd=tmp_path) for s in (1, 2))
    assert one["volume"]["value"] != two["volume"]["value"]
    allowed = 6 * (one["volume"]["standard_error"] + two["volume"]["standard_error"])
    assert abs(one["volume"]["value"] - two["volume"]["value"]) < allowed


# --- run folder, plot, init, completion, dry run ------------------------------------------

OUTPUTS = [
    "lci_histogram.csv", "lci_histogram.png", "mechanism.png", "regions.csv", "result.json",
    "sections.png", "workspace.png",
]  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("workspace")
    result = pmopt("workspace", MECH, "--samples", "20000", "--out", "run", "--format", "json",
                   cwd=folder)  # fmt: skip
    return folder, result


def test_workspace_writes_its_folder(run):
    folder, result = run
    assert result.returncode == 0
    assert "written to run" in result.stderr
    assert files_in(folder / "run") == sorted([*OUTPUTS, "manifest.json"])
    assert (folder / "run/result.json").read_text() == result.stdout
    document = strict_json(result.stdout)
    rows = csv_rows((folder / "run/regions.csv").read_text())
    keys = ("lower", "upper", "volume", "share")
    assert [[float(r[k]) for k in keys] for r in rows] == [
        [r[k] for k in keys] for r in document["regions"]
    ]
    histogram = csv_rows((folder / "run/lci_histogram.csv").read_text())
    assert sum(int(r["count"]) for r in histogram) == document["reachable"]
    assert (float(histogram[0]["lower"]), float(histogram[-1]["upper"])) == (0.0, 1.0)
    for name in OUTPUTS:
        if name.endswith(".png"):
            assert (folder / "run" / name).read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_manifest(run):
    folder = run[0] / "run"
    manifest = strict_json((folder / "manifest.json").read_text())
    assert (manifest["command"], manifest["mechanism"], manifest["seed"]) == ("workspace", MECH, 1)
    assert manifest["config"]["workspace"]["samples"] == 20000
    assert manifest["config"]["parameters"]["l1"] == L1
    assert {"pmopt", "python", "numpy", "numba"} <= set(manifest["versions"])
    assert manifest["versions"]["python"] == ".".join(map(str, sys.version_info[:3]))
    assert manifest["git_commit"] is None or re.fullmatch("[0-9a-f]{40}", manifest["git_commit"])
    assert manifest["platform"]
    assert manifest["wall_time"] > 0
    assert manifest["cpu_time"] > 0
    assert manifest["resumes"] == []
    assert manifest["units"]["volume"] == "m^3"
    assert sorted(manifest["outputs"]) == OUTPUTS
    for name, digest in manifest["outputs"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_plot_redraws_the_same_bytes(run, tmp_path):
    folder = run[0] / "run"
    document = json_answer("plot", folder, "--out", "again", "--threads", "1", cwd=tmp_path)
    pictures = [name for name in OUTPUTS if name.endswith(".png")]
    assert sorted(document["written"]) == [f"again/{name}" for name in pictures]
    for name in pictures:
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()


def test_a_finished_run_is_not_overwritten(run):
    folder = run[0]
    before = {name: (folder / "run" / name).read_bytes() for name in files_in(folder / "run")}
    again = ("workspace", MECH, *SMALL, "--out", "run")
    line = error_line(here(*again, cwd=folder))
    assert "run" in line
    assert "--force" in line
    assert before == {n: (folder / "run" / n).read_bytes() for n in files_in(folder / "run")}


def test_force_overwrites(run, tmp_path):
    shutil.copytree(run[0] / "run", tmp_path / "run")
    again = ("workspace", MECH, *SMALL, "--seed", "3", "--out", "run", "--force", "--quiet")
    assert answer(*again, cwd=tmp_path)
    assert strict_json((tmp_path / "run/manifest.json").read_text())["seed"] == 3
    assert strict_json((tmp_path / "run/result.json").read_text())["sampler"]["seed"] == 3


def test_plot_of_what_is_no_finished_run(run, tmp_path):
    assert "finished run" in error_line(here("plot", "nothing", cwd=tmp_path))
    shutil.copytree(run[0] / "run", tmp_path / "run")
    (tmp_path / "run/manifest.json").write_text('{"command": "workspace", "config": {}}')
    assert "run" in error_line(here("plot", "run", cwd=tmp_path))


def test_init_writes_a_config_that_pareto_takes(tmp_path):
    assert json_answer("init", cwd=tmp_path)["written"] == f"{MECH}.toml"
    before = (tmp_path / f"{MECH}.toml").read_bytes()
    plan = json_answer("pareto", f"{MECH}.toml", "--dry-run", cwd=tmp_path)
    assert plan["points"] == 200 * 200 * 4096  # what an adaptive search takes on lines
    assert plan["estimated_time"] > 0
    assert plan["units"]["estimated_time"] == "s"
    line = error_line(here("init", cwd=tmp_path))
    assert f"{MECH}.toml" in line
    assert "--force" in line
    (tmp_path / f"{MECH}.toml").write_text("mine")
    error_line(here("init", cwd=tmp_path))
    assert (tmp_path / f"{MECH}.toml").read_text() == "mine"
    answer("init", "--force", cwd=tmp_path)
    assert (tmp_path / f"{MECH}.toml").read_bytes() == before
    assert files_in(tmp_path) == [f"{MECH}.toml"]


def test_completion_script_is_a_script(tmp_path):
    script = answer("completion", "bash", cwd=tmp_path)
    subprocess.run(["bash", "-n"], input=script, text=True, check=True)
    subprocess.run(["bash", "-c", f"{script}\ncomplete -p pmopt"], check=True, capture_output=True)
    assert json_answer("completion", "zsh", cwd=tmp_path)["script"].startswith("#compdef pmopt")


@pytest.mark.parametrize(
    ("words", "expected"),
    [("pmopt wor", "workspace"), (f"pmopt info {MECH[:3]}", MECH), (f"pmopt ik {MECH} --form",
     "--format")],
)  # fmt: skip
def test_completion_completes(tmp_path, words, expected):
    env = {"_PMOPT_COMPLETE": "bash_complete", "COMP_WORDS": words,
           "COMP_CWORD": str(len(words.split()) - 1)}  # fmt: skip
    result = pmopt(cwd=tmp_path, env=env)
    assert (result.returncode, result.stdout.split()) == (0, [f"plain,{expected}"])


@pytest.mark.parametrize(
    "options", [(), ("--grid", "100"), ("--target-error", "1e-4"), ("--out", "run")]
)
def test_dry_run_of_workspace(tmp_path, options):
    plan = json_answer("workspace", MECH, *options, "--dry-run", cwd=tmp_path)
    assert plan["points"] > 0
    assert plan["estimated_time"] > 0
    assert plan["units"] == {"points": "1", "estimated_time": "s"}
    assert files_in(tmp_path) == []


def test_dry_run_of_pareto_writes_nothing(tmp_path):
    config = CONFIGS / "quickstart.toml"
    result = here("pareto", config, "--out", "run", "--dry-run", "--format", "csv", cwd=tmp_path)
    assert result.returncode == 0
    (row,) = csv_rows(result.stdout)
    assert float(row["points"]) == 60 * 40 * 4096  # what an adaptive search takes on lines
    assert files_in(tmp_path) == []


# --- --params -----------------------------------------------------------------------------


def test_params_of_a_file_and_inline(tmp_path):
    (tmp_path / "p.toml").write_text("l1 = 0.8\nm = 1\n")
    (tmp_path / "config.toml").write_text("seed = 1\n[parameters]\nl1 = 0.8\nm = 1\n")
    expected = json_answer("jacobian", MECH, "--pose", POSE, "--params", "l1=0.8,m=1,l2=1.4",
                           cwd=tmp_path)  # fmt: skip
    assert expected["params"] == {"m": 1.0, "n": N, "l1": 0.8, "l2": 1.4, "c": C, "h": None}
    for given in ("@p.toml", "@config.toml", "l1=0.8, m=1"):
        command = ("jacobian", MECH, "--pose", POSE, "--params", given, "--params", "l2=1.4")
        assert json_answer(*command, cwd=tmp_path) == expected


BAD_PARAMS = [
    (("@p.toml", "l1=0.9"), ("l1", "twice")),
    (("l1=0.9", "@p.toml"), ("l1", "twice")),
    (("l1=0.9,l1=0.9",), ("l1", "twice")),
    (("l1=0.9", "l1=0.9"), ("l1", "twice")),
    (("@unknown.toml",), ("q", "m, n, l1, l2, c, h", "nearest")),
    (("@wrong.toml",), ("l1=yes", "1e-06 to 1e+06", "m")),
    (("@boolean.toml",), ("l1=True", "1e-06 to 1e+06")),
    (("@table.toml",), ("parameters", "table.toml")),
    (("@torn.toml",), ("torn.toml", "TOML")),
    (("@missing.toml",), ("missing.toml", "no such file")),
    (("@",), ("--params",)),
    (("@deep.toml",), ("deep.toml", "TOML")),
    (("@long.toml",), ("long.toml", "TOML")),
    (("@hexadecimal.toml",), ("hexadecimal.toml", "TOML")),
]


@pytest.mark.parametrize(("given", "fragments"), BAD_PARAMS, ids=str)
def test_bad_params(tmp_path, given, fragments):
    for name, text in {
        "p": "l1 = 0.8", "unknown": "q = 1", "wrong": 'l1 = "yes"', "boolean": "l1 = true",
        "table": "parameters = 5", "torn": "l1 = ", "ranges": "[parameters]\nm = [0.5, 1.5]",
        "deep": "m = " + "[" * 50_000, "long": "m = " + "9" * 5000,
        "hexadecimal": "m = 0x" + "f" * 5000,
    }.items():  # fmt: skip
        (tmp_path / f"{name}.toml").write_text(text)
    options = [word for text in given for word in ("--params", text)]
    line = error_line(here("ik", MECH, "--pose", POSE, *options, cwd=tmp_path))
    assert all(fragment in line for fragment in ("params", *fragments)), line


# --- bad inputs ---------------------------------------------------------------------------

IK = f"ik {MECH} --pose {POSE}"
WS = f"workspace {MECH} --shape-grid 0"
BAD = [
    ("nope", ("'nope'", "workspace", "nearest: ")),
    ("workspac", ("'workspac'", "nearest: workspace")),
    ("--nope", ("--nope",)),
    ("info", ("MECH",)),
    ("info 3-urc", ("mechanism", "'3-urc'", MECH, "nearest: ")),
    (f"info {MECH} more", ("more",)),
    (f"info {MECH} --format xml", ("--format", "'xml'", "table", "json", "csv")),
    (f"{IK} --quite", ("--quite", "--quiet")),
    (f"ik {MECH}", ("--pose", "--poses")),
    (f"{IK} --poses a.csv", ("--pose", "--poses")),
    (f"ik {MECH} --poses no.csv", ("--poses", "no.csv", "no such file")),
    (f"ik {MECH} --pose x=0,y=0", ("--pose", "z is missing", "x, y, z")),
    (f"ik {MECH} --pose x=0,y=0,z=1,w=2", ("--pose", "'w'", "x, y, z", "nearest: z")),
    (f"ik {MECH} --pose x=0,y=0,z=1,z=1", ("--pose", "z", "twice")),
    (f"ik {MECH} --pose x=0,y=0,z", ("--pose", "'z'", "NAME=VALUE")),
    (f"ik {MECH} --pose x=0,y=0,z=one", ("--pose", "z=one", "is no number")),
    (f"ik {MECH} --pose x=0,y=0,z=nan", ("--pose", "z=nan", "is no number")),
    (f"ik {MECH} --pose x=0,y=0,z=1e400", ("--pose", "z=1e400", "1e+09 m")),
    (f"ik {MECH} --pose x=0,y=0,z=1e10", ("--pose", "z=1", "1e+09 m")),
    (f"{IK} --params l3=1", ("params", "'l3'", "m, n, l1, l2, c, h", "nearest: l")),
    (f"{IK} --params l1=0", ("params", "l1=0", "1e-06 to 1e+06", "in m")),
    (f"{IK} --params l1=-1", ("params", "l1=-1", "1e-06 to 1e+06", "in m")),
    (f"{IK} --params c=-1", ("params", "c=-1", "or 0", "in m")),
    (f"{IK} --params l1=inf", ("--params", "l1=inf", "1e-06 to 1e+06")),
    (f"{IK} --params l1", ("--params", "'l1'", "NAME=VALUE")),
    (f"{IK} --working-mode outout", ("working-mode", "'outout'", *MODES, "nearest: out-out")),
    (f"{IK} --limits theta3=0:1", ("limits", "'theta3'", "theta1, theta2, d", "nearest: theta")),
    (f"{IK} --limits theta1=1:0", ("--limits", "theta1=1:0", "LOWER < UPPER")),
    (f"{IK} --limits theta1=1", ("--limits", "theta1=1", "LOWER:UPPER")),
    (f"fk {MECH} --joints theta1=0,theta2=0,d=5", ("--joints", "d=5", "l2 = 1.5 m")),
    (f"fk {MECH} --joints theta1=0,theta2=0", ("--joints", "d is missing")),
    (f"fk {MECH} --joints theta1=0,theta2=0,d_deg=1", ("--joints", "'d_deg'", "nearest: d")),
    (f"jacobian {MECH}", ("--pose",)),
    (f"jacobian {MECH} --pose {POSE} --working-mode all", ("working-mode", "'all'")),
    (f"jacobian {MECH} --pose {POSE} --characteristic-length -1", ("-1", "> 0")),
    (f"jacobian {MECH} --pose {POSE} --jacobian raw --characteristic-length 1", ("raw",)),
    (f"jacobian {MECH} --pose {POSE} --norm 3", ("--norm", "'3'", "'2'", "'fro'")),
    (f"{WS} --samples 1.5", ("--samples", "1.5", "whole number")),
    (f"{WS} --samples 5", ("samples=5", "16")),
    (f"{WS} --samples 1e30", ("samples=1", "17592186044416")),
    (f"{WS} --samples 100 --grid 10", ("samples", "grid")),
    (f"{WS} --grid 2", ("grid=2", "4")),
    (f"{WS} --grid 10 --sampler sobol", ("grid", "sampler")),
    (f"{WS} --target-error 0", ("target_error=0", "greater than 0")),
    (f"{WS} --target-error nan", ("--target-error", "nan is no number")),
    (f"{WS} --samples 100 --replicates 2", ("replicates=2", "4")),
    (f"{WS} --min-lci 2", ("min_lci=2", "1")),
    (f"{WS} --regions 0,0.5", ("regions", "0.5", "from 0 to 1")),
    (f"{WS} --regions 0,a,1", ("--regions", "a", "number")),
    (f"{WS} --domain w=0:1", ("domain", "'w'", "x, y, z", "nearest: ")),
    (f"{WS} --domain z=1:0", ("--domain", "z=1:0", "LOWER < UPPER")),
    (f"{WS} --limits theta=0:1", ("limits", "'theta'", "theta1, theta2, d", "nearest: theta")),
    (f"{WS} --working-mode out", ("working_mode", "'out'", *MODES)),
    (f"{WS} --sampler halton", ("--sampler", "'halton'", "sobol")),
    (f"{WS} --seed -1", ("--seed", "-1")),
    (f"{WS} --threads 0", ("--threads", "0")),
    (f"{WS} --dry-run --threads x", ("--threads", "x")),
    ("pareto no.toml", ("no.toml", "no such file")),
    ("pareto .", (".", "is a folder")),
    ("pareto bad.toml", ("bad.toml", "'volumes'", "volume", "gci")),
    ("pareto good.toml --resume", ("--resume", "--out")),
    ("pareto good.toml --resume --force --out run", ("--resume", "--force")),
    ("plot no", ("no", "no such folder", "finished run")),
    ("init no-such", ("kind or mechanism", "'no-such'", MECH)),
    ("init --out good.toml", ("--out", "good.toml", "--force")),
    ("completion tcsh", ("'tcsh'", "bash", "zsh", "fish")),
]


@pytest.fixture
def folder_of_configs(tmp_path):
    (tmp_path / "good.toml").write_text(f'mechanism = "{MECH}"\n')
    (tmp_path / "bad.toml").write_text(f'mechanism = "{MECH}"\nobjectives = ["volumes", "gci"]\n')
    return tmp_path


@pytest.mark.parametrize(("command", "fragments"), BAD, ids=[c for c, _ in BAD])
def test_bad_input_is_one_line(folder_of_configs, command, fragments):
    result = here(*command.split(), cwd=folder_of_configs)
    assert result.stdout == ""
    line = error_line(result)
    assert all(fragment in line for fragment in fragments), line
    assert files_in(folder_of_configs) == ["bad.toml", "good.toml"]


def test_bad_input_of_a_process(folder_of_configs):
    """One of each command, as a process: the same code and the same line."""
    commands = {command.split()[0]: command.split() for command, _ in BAD}.values()
    for command, result in zip(commands, pmopt_all(commands, folder_of_configs), strict=True):
        assert result.stdout == ""
        assert error_line(result) == error_line(here(*command, cwd=folder_of_configs))


def test_quiet_keeps_errors(tmp_path):
    line = error_line(here("ik", MECH, "--pose", "x=9,y=0,z=1", "--quiet", cwd=tmp_path))
    assert "out of reach" in line


def test_debug_shows_where(tmp_path):
    result = pmopt("ik", MECH, "--pose", "x=9,y=0,z=1", "--debug", cwd=tmp_path)
    assert result.returncode != 0
    assert "Traceback" in result.stderr


def test_no_arguments_show_the_help(tmp_path):
    assert answer(cwd=tmp_path) == answer("--help", cwd=tmp_path)


# --- streams, threads, signals ------------------------------------------------------------


def test_quiet_silences_stderr_only(run, tmp_path):
    loud = run[1]
    quiet = pmopt("workspace", MECH, "--samples", "20000", "--out", "b", "--format", "json",
                  "--quiet", cwd=tmp_path)  # fmt: skip
    assert loud.stderr == "written to run\n"
    assert quiet.stderr == ""
    assert quiet.stdout == loud.stdout != ""


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["info", "workspace"])
def test_a_reader_that_has_gone(tmp_path, name, form):
    """As with ``pmopt .. | head -0``: no traceback, no complaint at exit."""
    reading, writing = os.pipe()
    os.close(reading)
    result = subprocess.run(
        [*COMMAND, *SHORT[name], "--format", form], cwd=tmp_path, stdout=writing,
        stderr=subprocess.PIPE, text=True, timeout=TIMEOUT, env=environment(),
    )  # fmt: skip
    os.close(writing)
    assert result.stderr == ""
    assert result.returncode in (0, 1)


def test_a_reader_that_goes_after_one_line(tmp_path):
    process = subprocess.Popen(
        [*COMMAND, *SHORT["jacobian"], "--format", "json"], cwd=tmp_path, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(),
    )  # fmt: skip
    assert process.stdout.readline() == "{\n"
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(TIMEOUT) in (0, 1)


@pytest.fixture
def helpers(monkeypatch):
    """Record the threads that are started beside the caller's."""
    started = []

    class Helper(threads.Thread):
        def start(self):
            started.append(self)
            super().start()

    monkeypatch.setattr(threads, "Thread", Helper)
    return started


def test_number_of_threads(monkeypatch, helpers):
    def count(**options):
        helpers.clear()
        package.workspace(MECH, samples=600_000, shape_grid=0, **options)
        return 1 + len(helpers)

    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert count() == 3
    assert count(threads=2) == 2
    assert count(threads=1) == 1
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    assert count() == 1
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert count() == cores


@pytest.mark.parametrize("value", ["0", "-1", "two", "1.5", "", "\u00b2"])
def test_bad_number_of_threads_in_the_environment(tmp_path, monkeypatch, value):
    """The variable is numba's, and may be left from elsewhere: a line, and the cores."""
    plain = here(*SHORT["workspace"], cwd=tmp_path)
    monkeypatch.setenv("NUMBA_NUM_THREADS", value)
    result = here(*SHORT["workspace"], cwd=tmp_path)
    assert (result.returncode, result.stdout) == (0, plain.stdout)
    (line,) = result.stderr.splitlines()
    assert all(text in line for text in ("NUMBA_NUM_THREADS", repr(value), "at least 1"))
    assert here(*SHORT["workspace"], "--quiet", cwd=tmp_path).stderr == ""
    assert here(*SHORT["workspace"], "--threads", "1", cwd=tmp_path).stderr == ""


def test_far_too_many_threads_in_the_environment(monkeypatch, helpers):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "100000")
    package.workspace(MECH, samples=600_000, shape_grid=0)
    assert 1 + len(helpers) == 8 * len(os.sched_getaffinity(0))


def test_good_number_of_threads_in_the_environment(tmp_path):
    result = pmopt(*SHORT["workspace"], cwd=tmp_path, env={"NUMBA_NUM_THREADS": "3"})
    assert (result.returncode, result.stdout) == (0, answer(*SHORT["workspace"], cwd=tmp_path))


def shows_rate_and_time_left(text):
    return re.search(r"\d %.* \d+(\.\d+)? [kMG]?points/s ETA \d+:\d\d:\d\d", text) is not None


def test_progress_on_a_terminal_and_interrupt(tmp_path):
    """10^13 points would take a day: rate and time left appear, then Ctrl-C ends it."""
    terminal = Terminal("workspace", MECH, "--samples", "1e13", "--format", "json", "--out", "run",
                        cwd=tmp_path)  # fmt: skip
    terminal.read(shows_rate_and_time_left)
    assert shows_rate_and_time_left(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", terminal.text))
    terminal.process.send_signal(signal.SIGINT)
    terminal.read()
    code, output = terminal.close()
    assert (code, output) == (130, "")
    assert terminal.text.count("error: interrupted") == 1
    assert "Traceback" not in terminal.text
    assert all(name.startswith("run/checkpoint/") for name in files_in(tmp_path))


def test_stdout_is_clean_beside_a_terminal(tmp_path):
    terminal = Terminal("workspace", MECH, "--samples", "1e7", "--shape-grid", "0", "--format",
                        "json", cwd=tmp_path)  # fmt: skip
    terminal.read()
    code, output = terminal.close()
    assert code == 0
    assert strict_json(output)["samples"] == 10**7
    assert "points/s" in terminal.text
    quiet = Terminal("workspace", MECH, *SMALL, "--quiet", cwd=tmp_path)
    quiet.read()
    assert quiet.close()[0] == 0
    assert quiet.text == ""


def test_no_bar_off_a_terminal(tmp_path):
    result = pmopt("workspace", MECH, "--samples", "1e7", "--shape-grid", "0", cwd=tmp_path)
    assert result.stderr == ""
    config = CONFIGS / "quickstart.toml"
    result = pmopt("pareto", config, "--dry-run", cwd=tmp_path)
    assert result.stderr == ""
