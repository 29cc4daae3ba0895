"""Anything is input: success or one clear line, no traceback, no NaN, no file it should not be."""

import shutil

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import fuzz_checks, fuzzing
from support.cli_runner import pmopt_all
from support.fuzzing import ends_well

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
@given(st.sampled_from(sorted(fuzz_checks.RUNS)), st.data())
@pytest.mark.slow
def test_checkpoints(kept, command, data):
    fuzz_checks.checkpoints((command, data), kept)


@FEW
@given(fuzzing.pose_commands())
def test_poses(example):
    fuzz_checks.poses(example)


@FEW
@given(fuzzing.workspace_commands(wide=False))
@pytest.mark.slow
def test_workspaces(words):
    fuzz_checks.workspaces(words)


@settings(FEW, max_examples=60)
@given(fuzzing.search_configs(wide=False))
@pytest.mark.slow
def test_searches(raw):
    fuzz_checks.searches(raw)


@FEW
@given(fuzzing.motion_configs(wide=False))
@pytest.mark.slow
def test_motions(example):
    fuzz_checks.motions(example)


@settings(FEW, max_examples=60)
@given(fuzzing.capability_commands(wide=False))
@pytest.mark.slow
def test_capabilities(words):
    fuzz_checks.capabilities(words)


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
