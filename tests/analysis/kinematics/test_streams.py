"""Many rows at once: the same answers as one by one, in bounded memory."""

import io
import json
import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.cli_runner import COMMAND, environment, error_line, here, pmopt

from pmopt.analysis.kinematics.inverse import Inverting, OutOfReach, inverse_kinematics
from pmopt.analysis.kinematics.jacobian import Index, Jacobians, jacobian_at
from pmopt.analysis.kinematics.pose_rows import read_rows
from pmopt.analysis.sizing import actuators
from pmopt.errors import InputError, UnreachableError
from pmopt.inputs import tables, text
from pmopt.mechanisms import assembling, find

MECH = "2pauu-ppap"
#: kB that thousands of rows may take beside what a few do.
ROOM = 60_000


def poses_about_home(mechanism, count, seed=3):
    """Return poses about home, some of them out of reach."""
    parameters = mechanism.resolve({})
    home, size = mechanism.home(parameters), mechanism.characteristic_length(parameters)
    rng = np.random.default_rng(seed)
    return [
        {
            c.name: home[c.name] + float(rng.uniform(-1, 1)) * (0.5 * size, 1.2)[c.kind == "angle"]
            for c in mechanism.pose
        }
        for _ in range(count)
    ]


def written(folder, poses, name="poses.csv"):
    """Write a CSV file of poses and return its name."""
    lines = [",".join(poses[0]), *(",".join(map(repr, pose.values())) for pose in poses)]
    (folder / name).write_text("\n".join(lines) + "\n")
    return name


@pytest.fixture
def one_by_one_plainly(monkeypatch):
    """Solve few poses without machine code, whether the process has it or not."""
    monkeypatch.setattr(assembling, "is_ready", lambda _: False)


@pytest.mark.usefixtures("one_by_one_plainly")
def test_many_poses_have_the_branches_of_each(mechanism):
    poses = poses_about_home(mechanism, 100)
    parameters = mechanism.resolve({})
    many = mechanism.inverses(parameters, poses)
    assert many == [mechanism.inverse(parameters, pose) for pose in poses]
    assert any(many)


@pytest.mark.usefixtures("one_by_one_plainly")
def test_many_results_are_those_of_each(mechanism):
    poses = poses_about_home(mechanism, 80, seed=4)
    limits = {mechanism.joints[0].name: (-0.1, 0.4)}
    places = [f"row {k}" for k in range(len(poses))]
    for found, pose, place in zip(
        Inverting(mechanism, None, "all", limits).at(poses, places), poses, places, strict=True
    ):
        if isinstance(found, OutOfReach):
            with pytest.raises(UnreachableError) as error:
                inverse_kinematics(mechanism, None, pose, "all", limits, place)
            assert str(found.error()) == str(error.value)
        else:
            assert found == inverse_kinematics(mechanism, None, pose, "all", limits, place)


def test_few_poses_are_solved_by_machine_code_that_is_there(monkeypatch):
    """A pose after many takes a hundredth of the time; the bits are the same."""
    mechanism = find("2uu-upu")
    parameters, (pose, *_) = mechanism.resolve({}), poses_about_home(mechanism, 1)
    monkeypatch.setattr(assembling, "_ready", set())
    plain = mechanism.inverse(parameters, pose)
    mechanism.inverses(parameters, [pose] * 70)
    monkeypatch.setattr(assembling, "assemble_plainly", None)
    assert mechanism.inverse(parameters, pose) == plain


@pytest.mark.usefixtures("one_by_one_plainly")
def test_far_poses_overflow_alike(mechanism):
    pose = {c.name: 1e9 if c.kind == "length" else 1e6 for c in mechanism.pose}
    parameters = mechanism.resolve({})
    with np.errstate(all="ignore"):
        alone = mechanism.inverse(parameters, pose)
        assert repr(mechanism.inverses(parameters, [pose] * 70)[-1]) == repr(alone)


def test_jacobians_are_those_of_each_pose(mechanism):
    poses = poses_about_home(mechanism, 30, seed=5)
    mode = mechanism.working_modes[0]
    asked = Jacobians(mechanism, None, mode, Index(norm="fro"))
    met = 0
    for found, pose in zip(asked.at(poses, ["row"] * 30), poses, strict=True):
        if isinstance(found, OutOfReach):
            with pytest.raises(UnreachableError) as error:
                jacobian_at(mechanism, None, pose, mode, norm="fro", where="row")
            assert str(found.error()) == str(error.value)
        else:
            one = jacobian_at(mechanism, None, pose, mode, norm="fro")
            assert found.to_dict() == one.to_dict()
            met += 1
    assert met


def test_jacobian_of_many_poses(tmp_path):
    reach = "x,y,z\n0.1,0.2,1.2\n0,0,1.3\n9,0,1\n"
    (tmp_path / "p.csv").write_text(reach)
    result = here("jacobian", MECH, "--poses", "p.csv", "--format", "csv", cwd=tmp_path)
    assert "line 4" in error_line(result)
    assert result.returncode == 2
    head, *rows = [line.split(",") for line in result.stdout.splitlines()]
    one = json.loads(
        here("jacobian", MECH, "--pose", "x=0.1,y=0.2,z=1.2", "--format", "json",
             cwd=tmp_path).stdout
    )  # fmt: skip
    first = dict(zip(head, rows[0], strict=True))
    assert [first[f"singular_value_{k}"] for k in (1, 2, 3)] == list(
        map(repr, one["singular_values"])
    )
    assert (first["lci"], first["lci_homogenized"]) == (
        repr(one["lci"]), repr(one["lci_homogenized"]),
    )  # fmt: skip
    assert first["determinant_type_2_platform"] == repr(
        one["singularity"]["type_2"]["determinant"]["platform"]
    )
    assert first["singular"] == "false"
    assert set(rows[2][4:]) == {""}
    documents = json.loads(
        here("jacobian", MECH, "--poses", "p.csv", "--format", "json", cwd=tmp_path).stdout
    )
    assert documents[0] == one
    assert documents[2]["lci"] is None
    assert "line 4" in documents[2]["out_of_reach"]


def test_a_singular_pose_among_many(tmp_path):
    """The 3-UPS/SP is singular at every level pose."""
    (tmp_path / "p.csv").write_text("phi,theta,psi,l4\n0.3,0,0,67\n0.3,0.1,0.05,67\n")
    result = here("jacobian", "3-ups-sp", "--poses", "p.csv", "--format", "csv", cwd=tmp_path)
    head, *rows = [line.split(",") for line in result.stdout.splitlines()]
    column = head.index("singular")
    assert [row[column] for row in rows] == ["true", "false"]
    assert rows[0][head.index("lci")] == "0.0"


def test_forms_of_many_rows(tmp_path):
    poses = [{"x": 0.0, "y": 0.0, "z": 1.0 + 0.0005 * k} for k in range(600)]  # two blocks
    name = written(tmp_path, poses)
    printed = {
        form: here("ik", MECH, "--poses", name, "--format", form, "--out", f"all.{other}",
                   "--force", cwd=tmp_path)
        for form, other in (("csv", "json"), ("json", "csv"), ("table", "csv"))
    }  # fmt: skip
    documents = json.loads(printed["json"].stdout)
    assert printed["json"].stdout == json.dumps(documents, indent=2) + "\n"
    assert printed["json"].stdout == (tmp_path / "all.json").read_text()
    assert [d["pose"] for d in documents] == poses
    rows = printed["csv"].stdout.splitlines()
    assert printed["csv"].stdout == (tmp_path / "all.csv").read_text()
    assert len(rows) == 1 + sum(max(len(d["solutions"]), 1) for d in documents)
    assert [row.split(",")[0] for row in rows[1::4]] == [str(k + 1) for k in range(600)]
    shown = printed["table"].stdout
    assert "600 poses" in shown
    assert f"... {len(rows) - 1 - 20:,} more rows: --format csv" in shown


def test_the_file_of_many_rows_is_not_overwritten(tmp_path):
    name = written(tmp_path, [{"x": 0.0, "y": 0.0, "z": 1.1}])
    (tmp_path / "kept.csv").write_text("mine")
    for words, says in (
        (("--poses", name, "--out", "kept.csv"), "--force"),
        (("--poses", name, "--out", "kept.txt"), ".csv or .json"),
        (("--pose", "x=0,y=0,z=1.1", "--out", "a.csv"), "--poses"),
    ):
        assert says in error_line(here("ik", MECH, *words, cwd=tmp_path))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["kept.csv", name]


def test_a_bad_row_far_down_is_said_before_anything_is_printed(tmp_path):
    poses = [{"x": 0.0, "y": 0.0, "z": 1.1}] * 1500
    name = written(tmp_path, poses)
    with (tmp_path / name).open("a") as stream:
        stream.write("0,0,1e10\n")
    result = here("ik", MECH, "--poses", name, "--format", "csv", "--out", "a.csv", cwd=tmp_path)
    assert "line 1502" in error_line(result)
    assert result.stdout == ""
    assert not (tmp_path / "a.csv").exists()


def test_a_closed_pipe_ends_quietly(tmp_path):
    name = written(tmp_path, [{"x": 0.0, "y": 0.0, "z": 1.1}] * 4000)
    command = [*COMMAND, "ik", MECH, "--poses", name, "--format", "csv", "--out", "a.csv"]
    with subprocess.Popen(
        command, cwd=tmp_path, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout.readline().startswith(b"row,x,y,z")
        process.stdout.close()
        assert process.stderr.read() == b""
    assert [p.name for p in tmp_path.iterdir()] == [name]  # whole or not at all


def peak(*args, cwd):
    """Return the most memory of a command, kB."""
    script = (
        "import resource, subprocess, sys\n"
        "subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)\n"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", script, *COMMAND, *map(str, args)], cwd=cwd, text=True,
        env=environment(NUMBA_NUM_THREADS="1"), capture_output=True, check=True,
    )  # fmt: skip
    return int(found.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["table", "csv", "json"])
@pytest.mark.parametrize(
    ("command", "option", "row"),
    [
        ("ik", "--poses", {"x": 0.0, "y": 0.0, "z": 1.1}),
        ("jacobian", "--poses", {"x": 0.0, "y": 0.0, "z": 1.1}),
        ("fk", "--joints-file", {"theta1": 0.4, "theta2": 0.1, "d": 0.2}),
    ],
)
def test_memory_does_not_grow_with_rows(command, option, row, form, tmp_path):
    """8,000 rows of it once took 200 MB."""
    few, many = (written(tmp_path, [row] * n, f"{n}.csv") for n in (600, 8_000))
    here(command, MECH, option, few, cwd=tmp_path)  # compiles
    small, large = (
        peak(command, MECH, option, name, "--format", form, cwd=tmp_path) for name in (few, many)
    )
    assert large - small < ROOM


def test_reading_takes_little_memory(tmp_path):
    """As text and objects the rows of this file take 90 MB and more."""
    written(tmp_path, [{"x": 0.1234567890123, "y": 0.25, "z": 1.1}] * 100_000)
    script = (
        "import resource\nfrom pathlib import Path\n"
        "from pmopt.analysis.kinematics.pose_rows import read_rows\n"
        "from pmopt.mechanisms import find\n"
        f"m = find({MECH!r})\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "rows = read_rows(Path('poses.csv'), '--poses', m, m.pose)\n"
        "assert len(rows) == 100_000 and rows.lines[-1] == 100_001\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, text=True, capture_output=True, check=True
    )
    assert int(found.stdout) < 30_000


def test_a_file_of_too_many_lines_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(tables, "MAX_LINES", 3)
    written(tmp_path, [{"x": 0.0, "y": 0.0, "z": 1.1}] * 4)
    mechanism = find(MECH)
    with pytest.raises(InputError, match="5 lines are not allowed: at most 3 are read"):
        read_rows(tmp_path / "poses.csv", "--poses", mechanism, mechanism.pose)


def test_rows_come_through_a_pipe(tmp_path):
    command = [*COMMAND, "ik", MECH, "--poses", "/dev/stdin", "--format", "csv"]
    found = subprocess.run(
        command, input="x;y;z\n0,0;0;1,1\n", text=True, capture_output=True, cwd=tmp_path,
        env=environment(),
    )  # fmt: skip
    assert found.stdout.splitlines()[1].startswith("1,0.0,0.0,1.1,out-out,")


@given(st.text("ab,é\r\n\u2028\x0b", max_size=40), st.sampled_from(["utf-8", "utf-16-le"]))
def test_lines_are_those_of_the_whole_text(content, encoding):
    mark = b"\xff\xfe" if encoding == "utf-16-le" else b""
    block, text._BLOCK = text._BLOCK, 5
    try:
        lines = text.Lines(io.BytesIO(mark + content.encode(encoding)))
        assert list(lines) == content.splitlines(keepends=True)
        assert list(lines) == content.splitlines(keepends=True)
    finally:
        text._BLOCK = block


# --- capability ---------------------------------------------------------------------------


def asked_of(samples=4096):
    mechanism = find(MECH)
    settings = actuators.WorkspaceSettings()
    return actuators.compute_capability(
        mechanism, mechanism.resolve({}), settings, actuators.Task(speed=1.0),
        {"theta1_rate": 2.0}, samples=samples,
    )  # fmt: skip


def test_blocks_of_demands_change_nothing(monkeypatch):
    whole = asked_of(16 * 4096)
    monkeypatch.setattr(actuators, "_PART", 1 << 10)
    assert asked_of(16 * 4096).to_dict() == whole.to_dict()


def test_counted_demands_are_those_kept():
    values = np.exp(np.random.default_rng(1).normal(size=(3, 40_000)))
    values[1] = 0.7
    values[2, :200] = np.inf
    kept, counted = actuators._Exact(3), actuators._Binned(3)
    for part in np.array_split(values, 5, axis=1):
        kept.add(part)
        counted.add(part)
    exact, found = kept.levels(), counted.levels()
    assert found == pytest.approx(exact, rel=2 * counted.resolution)
    assert found[1] == pytest.approx([0.7] * 4, rel=1e-15)
    joined = actuators._Binned(3)
    joined.join(counted)
    joined.join(counted)
    assert joined.levels() == pytest.approx(found, rel=2 * counted.resolution)


def test_of_many_samples_demands_are_counted(monkeypatch):
    kept = asked_of()
    monkeypatch.setattr(actuators, "_MOST_KEPT", 0)
    counted = asked_of()
    for one, other in zip(kept.demands, counted.demands, strict=True):
        assert other.volume == pytest.approx(one.volume, nan_ok=True)
        for level, found in zip(one.levels, other.levels, strict=True):
            assert math.isclose(found.value, level.value, abs_tol=max(level.error, 1e-12))


# --- budgets ------------------------------------------------------------------------------

CLAIM = ("certify", MECH, "--domain", "x=-0.1:0.1,y=-0.1:0.1,z=1.3:1.5", "--min-lci", "0.2")


def test_compilation_is_no_part_of_a_budget(tmp_path):
    """Compiling takes ten times this budget and more, the claim a hundredth of it."""
    cache = {"PMOPT_CACHE_DIR": str(tmp_path / "cache")}
    command = (*CLAIM, "--time-budget", "2", "--format", "json")
    cold, warm = (pmopt(*command, cwd=tmp_path, env=cache) for _ in range(2))
    assert "compiling" in cold.stderr
    assert json.loads(cold.stdout)["verdict"] == "proven"
    assert cold.stdout == warm.stdout
    assert cold.returncode == warm.returncode == 0


def test_a_budget_of_boxes_is_the_same_everywhere(tmp_path):
    command = ("certify", "3-cur", "--min-lci", "0.1", "--box-budget", "1000", "--format", "json")
    first, second = (here(*command, cwd=tmp_path) for _ in range(2))
    document = json.loads(first.stdout)
    assert first.stdout == second.stdout
    assert (document["verdict"], document["stopped"]) == ("undecided", "box budget")
    assert document["boxes"] >= 1000
    assert "budget of boxes" in document["note"]
    bounds = [
        here("workspace", "4-ups-rps", "--certify", "1e-6", "--box-budget", "2000", "--format",
             "json", cwd=tmp_path).stdout
        for _ in range(2)
    ]  # fmt: skip
    assert bounds[0] == bounds[1]
    assert json.loads(bounds[0])["stopped"] == "box budget"
    assert "> 0" in error_line(here(*CLAIM, "--box-budget", "0", cwd=tmp_path))
    alone = here("workspace", MECH, "--box-budget", "9", cwd=tmp_path)
    assert "--certify" in error_line(alone)
