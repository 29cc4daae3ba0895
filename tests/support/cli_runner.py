"""The command line, and what every answer of it must keep.

``pmopt`` runs it as a process, ``here`` inside this one: some hundred answers in the time of one
import. That both print the same bytes is a test of its own.
"""

import contextlib
import csv
import fcntl
import io
import json
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
COMMAND = [sys.executable, "-m", "pmopt"]
TIMEOUT = 300  # s; only a hang takes that long, also beside other work
#: A search of three generations, and a batch of two workspaces.
SEARCH = """
mechanism = "2pauu-ppap"
[parameters]
m = [0.5, 1.5]
[workspace]
samples = 1000
[algorithm]
population = 8
generations = 3
[final]
target_error = 0.1
"""
BATCH = (
    'command = "workspace"\nmechanism = "2pauu-ppap"\nshape_grid = 0\n'
    "[workspace]\nsamples = 1000\n[sweep]\nseed = [1, 2]\n"
)


def environment(**changes):
    """Return the environment without settings of threads and colours, with changes."""
    names = ("NUMBA_NUM_THREADS", "NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "COLUMNS")
    return {k: v for k, v in os.environ.items() if k not in names} | changes


def pmopt(*args, cwd, env=None):
    """Run the command line; arguments as a shell would pass them."""
    return subprocess.run(
        [*COMMAND, *map(str, args)], cwd=cwd, env=environment(**(env or {})), timeout=TIMEOUT,
        capture_output=True, text=True, encoding="utf-8",
    )  # fmt: skip


def pmopt_all(commands, cwd):
    """Run several commands, two at a time, and return their results in order."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda command: pmopt(*command, cwd=cwd), commands))


def wait_for(condition, process):
    """Wait until something holds while a process is at work."""
    began = time.monotonic()
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() - began < TIMEOUT
        time.sleep(0.01)


def here(*args, cwd):
    """Run the command line in this process."""
    from pmopt.cli import main, options

    out, err = io.StringIO(), io.StringIO()
    handlers = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)}
    try:
        with (
            contextlib.chdir(cwd),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            code = main.run(list(map(str, args)))
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        options.set_resume_hint("")
    return subprocess.CompletedProcess(args, code, out.getvalue(), err.getvalue())


def answer(*args, cwd):
    """Return what a command that has to succeed prints."""
    result = here(*args, cwd=cwd)
    assert result.returncode == 0, result.stderr
    return result.stdout


def json_answer(*args, cwd):
    """Return a command's JSON, refusing what JSON does not have."""
    return strict_json(answer(*args, "--format", "json", cwd=cwd))


def csv_answer(*args, cwd):
    """Return a command's CSV as dictionaries, checked."""
    return csv_rows(answer(*args, "--format", "csv", cwd=cwd))


def error_line(result, code=2):
    """Return the one line on stderr of a command that has to fail."""
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr
    lines = [line for line in result.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("error: ")
    return lines[0]


def strict_json(text):
    """Parse JSON; NaN and Infinity are no JSON."""

    def refuse(name):
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def csv_rows(text):
    """Parse CSV: a header of unique names, as many cells in every row, shortest floats."""
    head, *body = list(csv.reader(io.StringIO(text)))
    assert len(set(head)) == len(head)
    for row in body:
        assert len(row) == len(head)
        for cell in row:
            assert "np." not in cell, f"{cell} is NumPy's, not a plain number"
            if is_float(cell):
                assert repr(float(cell)) == cell, f"{cell} is not in shortest form"
    return [dict(zip(head, row, strict=True)) for row in body]


def is_float(cell):
    """Return whether a cell holds a float (not a whole number or text)."""
    try:
        float(cell)
    except ValueError:
        return False
    return not cell.lstrip("-").isdigit()


def files_in(folder):
    """Return every file below a folder."""
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file())


def shows_pace(unit):
    """Return whether a text has a line with a share, a rate and the time left."""
    pattern = rf"\d % \d[\d.]* [kMG]?{unit}/(s|min|h) ETA \d+:\d\d:\d\d"
    return lambda text: re.search(pattern, text) is not None


class Terminal:
    """A process whose stderr is a terminal and whose stdout is a pipe."""

    def __init__(self, *args, cwd, width=120):
        self.master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, width, 0, 0))
        self.process = subprocess.Popen(
            [*COMMAND, *args], cwd=cwd, stdin=slave, stdout=subprocess.PIPE, stderr=slave,
            env=environment(TERM="xterm-256color"),
        )  # fmt: skip
        os.close(slave)
        self.text = ""

    def read(self, enough=lambda text: False):
        """Read until the process ends or ``enough`` is said of the text without its colours."""
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            if not select.select([self.master], [], [], 1)[0]:
                continue
            try:
                data = os.read(self.master, 1 << 16)
            except OSError:  # the other end has gone
                return
            if not data:
                return
            self.text += data.decode("utf-8", "replace")
            if enough(re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.text)):
                return
        raise AssertionError(f"no end within {TIMEOUT} s: {self.text[-500:]}")

    def close(self):
        """Return the exit code and stdout."""
        output = self.process.communicate(timeout=TIMEOUT)[0]
        os.close(self.master)
        return self.process.returncode, output.decode()
