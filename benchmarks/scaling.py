"""Scaling: time and memory against samples, cost of a design against designs; a picture of each.

Times are of the processor: one thread's, without what other processes took meanwhile.

Run: python benchmarks/scaling.py [--samples 1e10] [--designs 1e5] [--out docs/images]
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import chunk_ranges
from pmopt.analysis.settings import DEFAULT_REPLICATES, WorkspaceSettings
from pmopt.mechanisms import find
from pmopt.reporting.pictures.style import FAINT, LINE, new_figure, to_picture
from pmopt.storage.files import write_atomic
from pmopt.synthesis.config import resolve_config
from pmopt.synthesis.problem import DesignProblem

ROOT = Path(__file__).resolve().parents[1]
MECHANISM = "2pauu-ppap"
DESIGN_SAMPLES = 1000
#: Points, and designs times samples, of all rounds together: larger ones are repeated less often.
POINTS_OF_ROUNDS = 5e9


def decades(first: float, last: float) -> list[int]:
    """Return powers of ten from the first to the last, and the last."""
    steps = [10**k for k in range(round(np.log10(first)), 20) if first <= 10**k < last]
    return [*steps, int(last)]


def peak_memory() -> float:
    """Return this process's largest resident memory so far, in MB."""
    try:  # getrusage tells the parent's too, where the process was forked from a larger one
        status = Path("/proc/self/status").read_text()
        kilobytes = float(status.split("VmHWM:")[1].split()[0])
    except (OSError, IndexError):
        kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        kilobytes /= 1024 if sys.platform == "darwin" else 1
    return kilobytes / 1024


def sweep_once(samples: int) -> None:
    """Sweep so many points as a process of its own, and write what it took as JSON."""
    mechanism = find(MECHANISM)
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    design = sampler.design(mechanism.resolve({}))
    points = sampler.sequence(DEFAULT_REPLICATES)
    sampler.evaluator.tally([design], points, 0, 1)
    before = peak_memory()
    began = time.process_time()
    total = None
    last = max(1, samples // DEFAULT_REPLICATES)
    for part in sampler.stream(design, points, chunk_ranges(0, last, DEFAULT_REPLICATES)):
        if total is None:
            total = part
        else:
            total.add(part)
    seconds = time.process_time() - began
    print(json.dumps([seconds / (last * DEFAULT_REPLICATES) * 1e9, before, peak_memory()]))


def by_samples(counts: Sequence[int], rounds: int) -> list[list[list[float]]]:
    """Return, count by count, the rounds' ns a point, and MB before and after."""
    found: list[list[list[float]]] = [[] for _ in counts]
    for turn in range(rounds):
        for k, count in enumerate(counts):
            if turn and turn * count > POINTS_OF_ROUNDS:
                continue
            line = [sys.executable, __file__, "--sweep", str(count)]
            done = subprocess.run(line, check=True, capture_output=True, text=True)
            found[k].append(json.loads(done.stdout.splitlines()[-1]))
    print(f"{MECHANISM}, 1 thread, a process each\n{'samples':>14s}  ns a point  peak MB (before)")
    for count, runs in zip(counts, found, strict=True):
        nanoseconds, before, after = (statistics.median(v) for v in zip(*runs, strict=True))
        print(f"{count:14,d}  {nanoseconds:10.2f}  {after:7.1f} ({before:.1f})", flush=True)
    return found


def by_designs(counts: Sequence[int], rounds: int, samples: int) -> list[list[float]]:
    """Return, count by count, the rounds' microseconds a design."""
    with (ROOT / "configs" / f"{MECHANISM}.toml").open("rb") as stream:
        data: dict[str, Any] = tomllib.load(stream)
    data["workspace"]["samples"] = samples
    problem = DesignProblem(resolve_config(data, "scaling"), threads=1)
    rng = np.random.default_rng(1)
    unit = rng.random((max(counts), len(problem.variables)))
    designs = problem.lower + (problem.upper - problem.lower) * unit
    problem.evaluate(designs[:2])
    found: list[list[float]] = [[] for _ in counts]
    for turn in range(rounds):
        for k, count in enumerate(counts):
            if turn and turn * count * samples > POINTS_OF_ROUNDS:
                continue
            # What is too short for the clock is repeated, over other designs.
            repeats = max(1, min(20, max(counts) // count))
            began = time.process_time()
            for r in range(repeats):
                problem.evaluate(designs[r * count : (r + 1) * count])
            found[k].append((time.process_time() - began) / repeats / count * 1e6)
    print(
        f"\n{MECHANISM}, random designs, {samples} samples each, 1 thread\n"
        f"{'designs':>14s}  us a design (quartiles)"
    )
    for count, values in zip(counts, found, strict=True):
        low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
        print(f"{count:14,d}  {middle:10.2f} ({low:.2f} .. {high:.2f})", flush=True)
    return found


def curve(axes: Any, counts: Sequence[int], runs: Iterable[Sequence[float]], label: str) -> None:
    """Draw medians of rounds over the range between their quartiles, from 0 upwards."""
    low, middle, high = np.array([np.quantile(list(v), (0.25, 0.5, 0.75)) for v in runs]).T
    axes.fill_between(counts, low, high, color=LINE, alpha=0.2, linewidth=0)
    axes.plot(counts, middle, color=LINE, marker="o", markersize=4)
    axes.set_xscale("log")
    axes.set_ylim(0, 1.15 * float(max(high)))
    axes.set_ylabel(label)
    axes.grid(visible=True)
    axes.spines[["top", "right"]].set_visible(False)


def draw_samples(path: Path, counts: Sequence[int], found: list[list[list[float]]]) -> None:
    """Draw time and memory against samples."""
    with new_figure(6.0, 4.6) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        curve(
            above,
            counts,
            ([r[0] for r in runs] for runs in found),
            "CPU time of a sample, ns",
        )
        curve(below, counts, ([r[2] for r in runs] for runs in found), "peak memory, MB")
        before = statistics.median(r[1] for runs in found for r in runs)
        below.axhline(before, color=FAINT, linestyle="--", linewidth=1)
        below.annotate("before the sweep", (counts[0], before), xytext=(0, -4), color=FAINT,
                       textcoords="offset points", va="top", fontsize=8)  # fmt: skip
        below.set_xlabel("number of samples")
        above.set_title(f"{MECHANISM}, one design, 1 thread; median and quartiles")
        figure.tight_layout()
        write_atomic(path, to_picture(figure))


def draw_designs(path: Path, counts: Sequence[int], found: list[list[float]], samples: int) -> None:
    """Draw the cost of a design against the number evaluated at once."""
    with new_figure(6.0, 3.2) as figure:
        axes = figure.subplots()
        curve(axes, counts, found, "CPU time of a design, µs")
        axes.set_xlabel("number of designs evaluated at once")
        axes.set_title(f"{MECHANISM}, {samples} samples a design, 1 thread; median and quartiles")
        figure.tight_layout()
        write_atomic(path, to_picture(figure))


def main() -> None:
    parser = argparse.ArgumentParser(description="Scaling with samples and with designs.")
    number = {"type": lambda text: int(float(text))}
    parser.add_argument("--samples", **number, default=10**10, help="largest number of samples")
    parser.add_argument("--designs", **number, default=10**5, help="largest number of designs")
    parser.add_argument("--design-samples", **number, default=DESIGN_SAMPLES, help="of a design")
    parser.add_argument("--rounds", **number, default=5, help="interleaved repetitions")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images", help="folder")
    parser.add_argument("--sweep", **number, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.sweep is not None:
        sweep_once(given.sweep)
        return
    given.out.mkdir(parents=True, exist_ok=True)
    samples = decades(min(1e6, given.samples / 10), given.samples)
    runs = by_samples(samples, given.rounds)
    draw_samples(given.out / "scaling-samples.png", samples, runs)
    designs = decades(10, given.designs)
    times = by_designs(designs, given.rounds, given.design_samples)
    draw_designs(given.out / "scaling-designs.png", designs, times, given.design_samples)
    print(f"\nscaling-samples.png and scaling-designs.png are in {given.out}")


if __name__ == "__main__":
    main()
