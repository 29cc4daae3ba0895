"""Anything is input: success or one clear line, no traceback, no NaN, no file it should not be."""

import fuzzing
import pytest
from fuzzing import ends_well, folder, run
from hypothesis import HealthCheck, given, settings

import pmopt as package

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


@FEW
@given(fuzzing.pose_commands())
def test_poses(example):
    poses(example)


@FEW
@given(fuzzing.workspace_commands(wide=False))
def test_workspaces(words):
    workspaces(words)


@settings(FEW, max_examples=60)
@given(fuzzing.search_configs(wide=False))
def test_searches(raw):
    searches(raw)
