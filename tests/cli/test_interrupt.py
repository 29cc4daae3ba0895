"""Ctrl-C and SIGTERM: exit 130 within a second or two, one line, a folder to be taken up."""

import os
import signal
import subprocess
import sys
import threading
import types
from concurrent.futures import ThreadPoolExecutor

import pytest
from support.cli_runner import COMMAND, environment
from support.interrupting import PHASES, interrupted

from pmopt.cli import interrupt

SOON = 2.5  # s: a second or two


@pytest.mark.parametrize("loaded", [True, False], ids=["loaded", "half imported"])
def test_threads_may_be_half_imported(monkeypatch, loaded):
    """A signal between the first and the last line of that module's import is one as any other."""
    module = types.ModuleType("pmopt.execution.threads")
    if loaded:
        module.ending = threading.Event()
    monkeypatch.setitem(sys.modules, "pmopt.execution.threads", module)
    try:
        with pytest.raises(interrupt.Interrupted):
            interrupt._interrupt(signal.SIGTERM, None)
    finally:
        interrupt.disarm()
    assert not loaded or module.ending.is_set()


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Return what came of an interruption in each phase, and its folder."""

    def hit(number):
        folder = tmp_path_factory.mktemp("phase")
        phase = list(PHASES)[number]
        return *interrupted(phase, (signal.SIGINT, signal.SIGTERM)[number % 2], folder), folder

    for mechanism in ("2uu-upu", "3-cur"):  # or they would be compiling
        subprocess.run([*COMMAND, "warmup", mechanism, "--quiet"], check=True, env=environment(),
                       capture_output=True)  # fmt: skip
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(PHASES, pool.map(hit, range(len(PHASES))), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("phase", PHASES)
def test_ends_soon(answers, phase):
    code, output, errors, seconds, folder = answers[phase]
    assert code is not None, f"was over before: {errors}"
    assert (code, output) == (130, "")
    (line,) = errors.splitlines()
    assert line.startswith("error: interrupted")
    assert seconds < SOON
    written = {p.name for p in folder.rglob("run/*")}
    assert written <= {"checkpoint"}
    if "run" in PHASES[phase][0]:
        assert "--resume" in line
    assert not [n for n in os.listdir(folder) if n not in ("test.toml", "cache", "run")]
