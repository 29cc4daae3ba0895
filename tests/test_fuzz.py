"""Anything is input: success or one clear line, no traceback, no NaN, no file it should not be."""

import shutil
import tempfile
from pathlib import Path

import fuzzing
import pytest
from cli_runner import pmopt_all
from fuzzing import ends_well, folder, run
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from killing import outputs

import pmopt as package
from pmopt.reporting.runs import workspace_checkpoint

#: Too many fast ones to shrink for long; slow drawing is no fault.
FEW = settings(max_examples=120, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile the kernels, or a first example does."""
    package.workspace("2pauu-ppap", samples=1000, shape_grid=8)
    with fuzzing.nothing_drawn():
        yield


def poses(example):
    """Check one line of ``ik``, ``fk`` or ``jacobian``."""
    words, table = example
    with folder() as cwd:
        if table is not None:
            (cwd / "input.csv").write_bytes(table)
        return ends_well(run(words, cwd), cwd, ["input.csv"])


def workspaces(words):
    """Check one line of ``workspace``."""
    with folder() as cwd:
        (cwd / "input.csv").write_bytes(b"a file\n")
        allowed = ["input.csv"]
        if "--out" in words:
            out = words[words.index("--out") + 1]
            allowed += ["run"] if out != "." else FILES
        result = run(words, cwd)
        assert (cwd / "input.csv").read_bytes() == b"a file\n"
        return ends_well(result, cwd, allowed)


FILES = ["manifest.json", "result.json", "lci_histogram.csv", "regions.csv"]


def searches(raw):
    """Check one configuration of ``pareto``."""
    with folder() as cwd:
        (cwd / "input.toml").write_bytes(raw)
        result = run(["pareto", "input.toml", "--out", "run", "--quiet"], cwd)
        return ends_well(result, cwd, ["input.toml", "run"])


def motions(example):
    """Check one configuration of ``motion``, with or without a table of points."""
    raw, table = example
    with folder() as cwd:
        (cwd / "input.toml").write_bytes(raw)
        if table is not None:
            (cwd / "input.csv").write_bytes(table)
        result = run(["motion", "input.toml", "--out", "run", "--quiet"], cwd)
        how = ends_well(result, cwd, ["input.toml", "input.csv", "run"])
        assert (cwd / "run").exists() == (how == "success")
        return how


def capabilities(words):
    """Check one line of ``capability``."""
    with folder() as cwd:
        return ends_well(run([*words, "--quiet"], cwd), cwd)


SMALL = """
mechanism = "2pauu-ppap"
[parameters]
m = [0.5, 1.5]
[workspace]
samples = 200
[algorithm]
population = 6
generations = 4
[final]
target_error = 0.3
"""
RUNS = {
    "pareto": ["pareto", "input.toml"],
    "workspace": ["workspace", "2pauu-ppap", "--samples", str(3 << 22), "--shape-grid", "0"],
}


def begun(command, kept):
    """Return the folder of a run that was cut off after its last checkpoint, and its outputs."""
    if command not in kept:
        kept[command] = Path(tempfile.mkdtemp(prefix="pmopt-fuzz-"))
        cwd = kept[command]
        (cwd / "input.toml").write_text(SMALL)
        assert run([*RUNS[command], "--out", "whole", "--quiet"], cwd).returncode == 0
        shutil.copytree(cwd / "whole" / "checkpoint", cwd / "run" / "checkpoint")
    return kept[command]


def checkpoints(example, kept):
    """Check a run that is taken up from checkpoints that something has been done to."""
    command, data = example
    source = begun(command, kept)
    with folder() as cwd:
        shutil.copytree(source, cwd, dirs_exist_ok=True)
        files = sorted((cwd / "run" / "checkpoint").iterdir())
        changed = []
        for _ in range(data.draw(st.integers(1, 2))):
            path = data.draw(st.sampled_from(files))
            raw = data.draw(fuzzing.mangled(path.read_bytes()) | st.binary(max_size=300))
            other = data.draw(st.sampled_from(files))
            how = data.draw(st.sampled_from(["bytes", "bytes", "bytes", "another", "gone", "new"]))
            if how == "gone":
                path.unlink(missing_ok=True)
            elif how == "new":
                path.with_name(data.draw(st.sampled_from(NAMES))).write_bytes(raw)
            else:
                path.write_bytes(other.read_bytes() if how == "another" and other.exists() else raw)
            changed.append((path.name, how))
            files = [path for path in files if path.exists()]
        result = run([*RUNS[command], "--out", "run", "--resume"], cwd)
        how = ends_well(result, cwd, ["input.toml", "run", "whole"])
        if how == "success":
            assert outputs(cwd / "run") == outputs(cwd / "whole"), changed
        else:
            assert "run.json" in result.stderr, (changed, result.stderr)
        return how


#: Files that are none of a run's, or of no number it has reached.
NAMES = ["generation-0000009.bin", "chunk-0000007.bin", "generation-x.bin", "-.bin",
         "x-\u0663.bin"]  # fmt: skip


@pytest.fixture(scope="module")
def kept():
    """Keep runs that were cut off, and remove them at the end."""
    folders = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workspace_checkpoint, "EVERY", 0.0)
        yield folders
    for path in folders.values():
        shutil.rmtree(path)


@FEW
@given(st.sampled_from(sorted(RUNS)), st.data())
@pytest.mark.slow
def test_checkpoints(kept, command, data):
    checkpoints((command, data), kept)


@FEW
@given(fuzzing.pose_commands())
def test_poses(example):
    poses(example)


@FEW
@given(fuzzing.workspace_commands(wide=False))
@pytest.mark.slow
def test_workspaces(words):
    workspaces(words)


@settings(FEW, max_examples=60)
@given(fuzzing.search_configs(wide=False))
@pytest.mark.slow
def test_searches(raw):
    searches(raw)


@FEW
@given(fuzzing.motion_configs(wide=False))
@pytest.mark.slow
def test_motions(example):
    motions(example)


@settings(FEW, max_examples=60)
@given(fuzzing.capability_commands(wide=False))
@pytest.mark.slow
def test_capabilities(words):
    capabilities(words)


@pytest.mark.slow
def test_as_processes(tmp_path):
    """What only a process can be given: bytes that are no text, and an environment of its own."""
    (tmp_path / "input.toml").write_bytes(b'mechanism = "\xff"\n')
    (tmp_path / "input.csv").write_bytes(b"x,y,z\n\x00,1,2\n")
    odd = b"\xff\xfe".decode(errors="surrogateescape")
    commands = [
        ("workspace", odd),
        ("workspace", "2pauu-ppap", "--params", f"{odd}=1"),
        ("workspace", "2pauu-ppap", "--domain", f"x={odd}:1"),
        ("ik", "2pauu-ppap", "--poses", odd),
        ("ik", "2pauu-ppap", "--poses", "input.csv"),
        ("pareto", "input.toml"),
        ("pareto", odd, "--out", odd),
        ("jacobian", "2pauu-ppap", "--pose", "x=1e308,y=-1e308,z=1"),
    ]
    for result in pmopt_all(commands, tmp_path):
        assert ends_well(result, tmp_path, ["input.toml", "input.csv"]) == "bad input"
