"""Compiling ahead: in processes of its own, what is missing only, told in a line each."""

import re
import subprocess

import numpy as np
import pytest
from support.cli_runner import COMMAND, Terminal, environment, json_answer

from pmopt import api
from pmopt.analysis.sampling import cells
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.warmup import warm_up
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler import machine_code, programs
from pmopt.mechanisms import find


@pytest.fixture
def nothing_kept(empty_cache, monkeypatch):
    """Forget the shared kernels too."""
    for name in ("counting", "searching"):
        monkeypatch.setattr(programs, name, getattr(programs, name).__wrapped__)
    return empty_cache


def test_all_that_a_workspace_needs(nothing_kept):
    told = []
    sampler = make_sampler(find("2pauu-ppap"), WorkspaceSettings(), notify=told.append)
    assert warm_up([sampler.evaluator], 2) == {"2pauu-ppap": 6}
    assert len(told) == 1
    assert "compiling the kernels of 2pauu-ppap" in told[0]
    kept = sorted(path.name for path in nothing_kept.glob("*/*.o"))
    assert kept == [
        "advance.o", "chain.o", "field.o", "fill.o", "indices.o", "label_runs.o", "lattice.o",
        "locate.o", "margins.o", "outline.o", "placed.o", "points.o", "probe.o", "skeletons.o",
        "sweep.o",
    ]  # fmt: skip
    assert warm_up([sampler.evaluator], 2) == {"2pauu-ppap": 0}
    assert len(told) == 1


def test_a_cache_that_can_not_be_written_is_no_error(nothing_kept, monkeypatch):
    blocked = nothing_kept / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(blocked / "cache"))
    monkeypatch.setattr(machine_code, "own_root", lambda: blocked / "own")
    cells_only = programs.counting()
    machine_code.compile_ahead([(cells_only, "chain")], 2)
    assert not cells_only.is_compiled("chain")
    assert blocked.read_text() == "no folder"


def test_processes_that_fail_leave_it_to_the_call(nothing_kept, monkeypatch):
    monkeypatch.setattr(machine_code.sys, "executable", "/bin/false")
    machine_code.compile_ahead([(programs.counting(), "chain")], 2)
    assert len(cells.hull(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))) == 3


@pytest.mark.slow
def test_command(tmp_path):
    """Cold it compiles, warm it says that nothing was missing; a wrong name is one line."""
    with_cache = {**environment(), "PMOPT_CACHE_DIR": str(tmp_path)}

    def warm(*arguments):
        return subprocess.run([*COMMAND, "warmup", *arguments], env=with_cache,
                              capture_output=True, text=True)  # fmt: skip

    first = warm("2pauu-ppap", "--format", "json")
    assert first.returncode == 0
    assert '"2pauu-ppap": 9' in first.stdout
    assert first.stderr.count("compiling the kernels of 2pauu-ppap") == 1
    (ended,) = re.findall(r"compiled (\d+)/(\d+) kernels\n$", first.stderr)
    assert ended[0] == ended[1]
    assert int(ended[0]) > 9  # those that all mechanisms share, too
    second = warm("2pauu-ppap", "--format", "json", "--quiet")
    assert '"2pauu-ppap": 0' in second.stdout
    assert second.stderr == ""
    wrong = warm("2pauu-ppa")
    assert wrong.returncode == 2
    assert wrong.stderr.count("\n") == 1
    assert "2pauu-ppap" in wrong.stderr


@pytest.mark.slow
def test_progress_on_a_terminal(tmp_path, monkeypatch):
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path))
    terminal = Terminal("warmup", "2pauu-ppap", "--format", "csv", cwd=tmp_path)
    terminal.read(lambda text: re.search(r"compiling, kernel [1-9]\d*/\d+", text))
    terminal.read()
    code, output = terminal.close()
    assert code == 0
    assert output.startswith("mechanism,compiled\n2pauu-ppap,")


def test_progress_counts_what_is_compiled(nothing_kept):
    told = []
    sampler = make_sampler(find("2pauu-ppap"), WorkspaceSettings())
    warm_up([sampler.evaluator], 2, shapes=False, progress=lambda *counts: told.append(counts))
    assert len(told) > 1
    assert told == [(k, len(told) - 1) for k in range(len(told))]
    warm_up([sampler.evaluator], 2, shapes=False, progress=lambda *counts: told.append(counts))
    assert told[-1][0] == len(told) - 1


def test_all_mechanisms_by_default(tmp_path):
    found = api.warmup()
    assert list(found) == api.mechanism_names()
    answer = json_answer("warmup", "--format", "json", cwd=tmp_path)
    assert set(answer["compiled"].values()) == {0}
