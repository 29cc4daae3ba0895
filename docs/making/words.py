"""Texts that several pages share."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

from making.figures import Figure, rounded
from making.pages import ROOT, Block, table
from pmopt.analysis.mobility.freedom import MobilityResult
from pmopt.analysis.workspace.shape import Topology
from pmopt.mechanisms import Mechanism
from pmopt.units import exact

_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


def word(count: int) -> str:
    """Return a small number in words."""
    return _WORDS[count] if count < len(_WORDS) else str(count)


def shape(found: Topology) -> str:
    """Return what a set looks like, e.g. ``one piece, no void``; it has to be confirmed."""
    many = f"{word(found.pieces)} piece{'' if found.pieces == 1 else 's'}"
    voids = f"{word(found.voids)} void{'s' if found.voids > 1 else ''}"
    return f"{many}, {voids}" if found.confirmed else f"{many}, {voids}, not confirmed"


def mobility(found: MobilityResult) -> str:
    """Return kind, formula and what finite motion leaves, as the pages have it."""
    formula = str(found.kutzbach_gruebler).replace(" ", "").replace("=", " = ")
    return f"{found.kind}, {formula}, full cycle {found.full_cycle.freedom}"


def parameters(page: str, mechanism: Mechanism) -> Block:
    """Return the table of design parameters."""
    rows = []
    for p in mechanism.parameters:
        unit = "" if mechanism.unit(p) == "1" else f", {mechanism.unit(p)}"
        default = "unset" if p.default is None else exact(p.default)
        bounds = "" if p.bounds is None else f"{exact(p.bounds[0])} .. {exact(p.bounds[1])}"
        rows.append((f"`{p.name}`", f"{p.meaning}{unit}", default, bounds, p.source))
    return table(page, "parameters", ("", "meaning", "default", "bounds", "source"), rows)


def numbers(values: Mapping[str, float], digits: int) -> str:
    """Return values in a row of a table."""
    return ", ".join(f"{v + 0.0:.{digits}f}".replace("-0." + "0" * digits, "0." + "0" * digits)
                     for v in values.values())  # fmt: skip


def trimmed(value: float, digits: int) -> str:
    """Return a value without zeros at its end."""
    return f"{value + 0.0:.{digits}f}".rstrip("0").rstrip(".").removesuffix("-0") or "0"


@contextlib.contextmanager
def run_folder(*command: str) -> Iterator[Path]:
    """Run a command of pmopt and yield the folder it wrote; ``{}`` stands for it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "run"
        words = [word.format(folder) for word in command]
        if "{}" not in " ".join(command):
            words += ["--out", str(folder)]
        result = subprocess.run(
            [sys.executable, "-m", "pmopt", *words], cwd=ROOT, capture_output=True, text=True
        )
        if result.returncode != 0:
            raise RuntimeError(f"pmopt {' '.join(words)}: {result.stderr.strip()}")
        yield folder


def printed(*command: str) -> str:
    """Return what a command prints on both streams, as it stands in a terminal of 100 columns."""
    result = subprocess.run(
        [sys.executable, "-m", "pmopt", *command], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "COLUMNS": "100"},
    )  # fmt: skip
    return result.stderr + result.stdout


def percent(share: float, error: float = 0.0, form: str = ".0f") -> Figure:
    """Return a share in per cent."""
    return rounded(100 * share, form, 100 * error)
