"""The scripts of benchmarks/ run, and their checks of agreement can fail. Nothing is timed."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms import find, names

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")


def run(script, *arguments):
    line = [sys.executable, str(FOLDER / script), *map(str, arguments)]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def kernels():
    """Return benchmarks/kernels.py as a module of its own."""
    spec = importlib.util.spec_from_file_location("benchmark_kernels", FOLDER / "kernels.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_sweep_runs():
    text = run("sweep.py", 20_000)
    assert text.count("agree: ") == 2
    assert re.search(r"^pmopt, 1 thread +[\d.]+ +[\d.]+ +[\d.]+ +1\.00$", text, re.M)


@pytest.mark.slow
def test_dynamics_runs():
    text = run("dynamics.py", "--instants", 500, "--pairs", 1, "3-cur-eq16")
    assert "errors below 1e-06 %" in text


def test_commands_run():
    text = run("commands.py", "--repeats", 1, "--generations", 2, "--warm")
    assert "pmopt workspace 2pauu-ppap" in text
    assert re.search(r"first generation +[\d.]+ s", text)
    assert re.search(r"200 x 2 at .* ratio [\d.]+$", text, re.M)
    assert re.search(r"200 x 2 without samples: .* ms a generation$", text, re.M)


def test_fidelity_runs():
    """Both searches end, on the same points, with the fronts compared."""
    text = run("fidelity.py", "--config", FOLDER.parent / "configs/quickstart.toml", "--population",
               8, "--generations", 4, "--samples", 2000, "--fine", 20_000)  # fmt: skip
    assert text.count(" against fixed: hypervolume ") == 2


@needs_gcc
@pytest.mark.parametrize("name", names())
@pytest.mark.slow
def test_kernels_run(name):
    """The reference of every mechanism gives the same sums."""
    text = run("kernels.py", name, "--points", 20_000, "--pairs", 2)
    assert re.search(rf"^{name} +20000 .* \((512|256)\) +[\d.]+ ", text, re.M)


def test_kernels_skip_without_gcc(kernels, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    kernels.main(names(), 1000, 1)
    assert capsys.readouterr().out == "no gcc: nothing to compare with\n"


@needs_gcc
def test_kernels_notice_a_wrong_reference(kernels, monkeypatch, tmp_path):
    """A factor that is two millionths off is reported before anything is timed."""
    changed = shutil.copytree(FOLDER / "c", tmp_path / "c")
    source = changed / "2pauu-ppap.c"
    text = source.read_text()
    assert text.count("double q1 = 0.5 * root1") == 1
    source.write_text(text.replace("double q1 = 0.5 * root1", "double q1 = 0.500001 * root1"))
    monkeypatch.setattr(kernels, "SOURCES", changed)
    with pytest.raises(SystemExit, match=r"2pauu-ppap: pmopt and C .* disagree: "):
        kernels.measure("2pauu-ppap", 20_000, 1, tmp_path)


@needs_gcc
@pytest.mark.parametrize(
    ("field", "change", "expected"),
    [
        ("total", lambda values: values * (1 + 3e-9), "sums of LCI"),
        ("within", lambda values: values + 1, "points within"),
        ("above", lambda values: values + 1, "points above"),
        ("smallest", lambda values: values + 3e-9, "the smallest LCI"),
        ("largest", lambda values: values * float("nan"), "the largest LCI"),
    ],
)
def test_disagreement_names_every_sum(kernels, tmp_path, field, change, expected):
    mechanism = find("2pauu-ppap")
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    design, points = sampler.design(mechanism.resolve({})), sampler.sequence(2)
    ours = sampler.evaluator.tally([design], points, 0, 1000)
    theirs = kernels.build(mechanism.name, 256, tmp_path)(design, points, 0, 1000)
    assert kernels.disagreement(ours, theirs) is None
    wrong = theirs._replace(**{field: change(getattr(theirs, field))})
    assert kernels.disagreement(ours, wrong).startswith(expected)


def test_accuracy_runs():
    text = run("accuracy.py", "2pauu-ppap", "2uu-upu", "--target", 0.03, "--seeds", 2,
               "--reference", 1e-3)  # fmt: skip
    for method in ("pmopt, r-sequence", "pmopt, grid", "NumPy script, Monte Carlo"):
        assert re.search(rf"^  {method} +\d+ +\d+[* ] +[\d.]+ ", text, re.M), method
    assert "2uu-upu: volume" in text
    assert "  left out: workspace: sampler=lines" in text


def test_scaling_runs(tmp_path):
    text = run("scaling.py", "--samples", 1e5, "--designs", 100, "--rounds", 2, "--out", tmp_path)
    assert re.search(r"^ +100,000 +[\d.]+ +[\d.]+ \([\d.]+\)$", text, re.M)
    assert re.search(r"^ +100 +[\d.]+ \([\d.]+ \.\. [\d.]+\)$", text, re.M)
    for name in ("scaling-samples.png", "scaling-designs.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


def test_cluster_runs():
    text = run("cluster.py", "--threads", 4, "--designs", 20, "--runs", 3, "--rounds", 1)
    assert re.search(r"^  20,000 samples: +[\d.]+ ", text, re.M)
    assert re.search(r"^  added to a run: +[\d.]+ ", text, re.M)
    assert re.search(r"^  one task, there and back: [\d.]+ ", text, re.M)
    assert re.search(r"^ +300 +\d+   0\.\d+ ", text, re.M)
    assert text.count("1,000,000 designs of") == 2


def test_cold_runs():
    """Against itself: what is compared is the same."""
    text = run("cold.py", "--repeats", 1, "--commands", "certify", "--changes")
    assert re.search(r"^2pauu-ppap certify( +[\d.]+){5}", text, re.M)
