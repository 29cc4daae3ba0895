"""Commands that are interrupted in each phase of their work."""

import subprocess
import time

from support.cli_runner import COMMAND, environment

#: Slow to compile, to search and to measure.
TEXT = """
mechanism = "4-ups-rps"
objectives = ["volume", "gci", "projected_volume"]
[algorithm]
population = 8
generations = 1
[workspace]
samples = 1000
link_diameter = 5.0
[final]
target_error = 1e-6
"""
#: Where it is hit: command, whether kernels are there already, seconds after its start.
PHASES = {
    "importing": (("workspace", "2uu-upu"), True, 0.15),
    "compiling a workspace": (("workspace", "2uu-upu"), False, 2.0),
    "compiling without shape": (("workspace", "2uu-upu", "--shape-grid", "0"), False, 1.5),
    "compiling a search": (("pareto", "test.toml", "--out", "run"), False, 2.0),
    "sampling": (("workspace", "2uu-upu", "--samples", "1e10", "--out", "run"), True, 3.0),
    "sampling an aspect": (
        ("workspace", "3-cur", "--aspect", "home", "--samples", "1e8", "--out", "run"), True, 3.0,
    ),
    "shape": (("workspace", "2uu-upu", "--samples", "1e5", "--shape-grid", "250"), True, 2.0),
    "measuring the front": (("pareto", "test.toml", "--out", "run"), True, 3.0),
    "singularities": (("singularities", "4-ups-rps"), True, 1.5),
    "certifying": (("workspace", "4-ups-rps", "--certify", "1e-3"), True, 2.0),
}  # fmt: skip


def interrupted(phase, number, folder, wait=None):
    """Run the command of a phase, interrupt it, return exit code, output, errors and seconds.

    Parameters
    ----------
    phase : str
    number : signal.Signals
    folder : Path
        Empty.
    wait : float, optional
        Seconds after its start, instead of the phase's.
    """
    words, compiled, usual = PHASES[phase]
    (folder / "test.toml").write_text(TEXT)
    changes = {} if compiled else {"PMOPT_CACHE_DIR": str(folder / "cache")}
    process = subprocess.Popen(
        [*COMMAND, *words, "--quiet"], cwd=folder, env=environment(**changes), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        process.wait(usual if wait is None else wait)
    except subprocess.TimeoutExpired:
        began = time.monotonic()
        process.send_signal(number)
        output, errors = process.communicate(timeout=60)
        return process.returncode, output, errors, time.monotonic() - began
    return None, *process.communicate(), 0.0
