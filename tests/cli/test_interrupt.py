"""Ctrl-C and SIGTERM: exit 130 within a second or two, one line, a folder to be taken up."""

import os
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor

import pytest
from support.cli_runner import COMMAND, environment
from support.interrupting import PHASES, interrupted

pytestmark = pytest.mark.slow
SOON = 2.5  # s: a second or two


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
