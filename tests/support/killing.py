"""Runs as processes of their own that are killed at random moments and taken up again."""

import hashlib
import subprocess
import sys
import time
from dataclasses import dataclass

from support.cli_runner import COMMAND, TIMEOUT, environment

#: A process that keeps every block and draws nothing, which would take longer than all the rest.
WORKSPACE = """
import sys, types
from pmopt.cli import entry
from pmopt.reporting.runs import workspace_checkpoint
workspace_checkpoint.EVERY = 0.0
sys.modules["pmopt.reporting.runs.run_pictures"] = types.SimpleNamespace(of_workspace=lambda *_: {})
entry.main()
"""


@dataclass
class Killed:
    """What kills have met.

    ``torn`` counts the kills that have left a file half written; ``after`` those after the last
    checkpoint, while designs are measured and files written.
    """

    kills: int = 0
    torn: int = 0
    after: int = 0
    runs: int = 0

    def add(self, other):
        """Add what the kills of another run have met."""
        for name in self.__dataclass_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


def start(words, folder):
    """Start a run as a process beside its folder."""
    command = [sys.executable, "-c", WORKSPACE] if words[0] == "workspace" else COMMAND
    return subprocess.Popen(
        [*command, *map(str, words), "--out", folder.name, "--resume", "--quiet"],
        cwd=folder.parent, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=environment(),
    )  # fmt: skip


def checkpoints(folder):
    """Return the numbered checkpoint files."""
    return sorted(p.name for p in folder.glob("checkpoint/*-*.bin"))


def outputs(folder):
    """Return the hash of all a run has written but its checkpoint and the manifest's times."""
    return {
        p.name: hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.iterdir())
        if p.is_file() and p.name != "manifest.json"
    }


def kill_and_resume(words, folder, chance, last):
    """Kill a run again and again until it ends by itself; return what the kills have met.

    Each process may get some checkpoints further, then a random while, so that kills come while
    it starts, computes, writes a checkpoint, measures and writes files.

    Parameters
    ----------
    words : sequence
        The command without --out.
    folder : Path
    chance : random.Random
    last : str
        Name of the last checkpoint file of the run.
    """
    met = Killed(runs=1)
    while True:
        known, process = set(checkpoints(folder)), start(words, folder)
        wanted, seen = chance.choice((0, 1, 1, 2, 4)), set(known)
        while process.poll() is None and len(seen) - len(known) < wanted and last not in seen:
            time.sleep(0.001)
            seen.update(checkpoints(folder))
        # Later and later where there are no more checkpoints to come.
        time.sleep(chance.uniform(0, 0.02 if last not in known else 0.3 + 0.2 * met.after))
        if wanted == 0:
            time.sleep(chance.uniform(0, 0.3))
        process.kill()
        _, errors = process.communicate(timeout=TIMEOUT)
        if process.returncode == 0:
            return met
        assert process.returncode == -9, errors
        assert errors == ""
        met.kills += 1
        met.torn += any(folder.rglob("*.pmopt-tmp"))
        met.after += last in checkpoints(folder)
