"""Whole commands, and the paper's 200 x 200 run against what its parts account for.

Run: python benchmarks/commands.py [--repeats 5] [--generations 200]
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from pmopt.synthesis.config import load_config
from pmopt.synthesis.optimise import Optimisation
from pmopt.synthesis.problem import DesignProblem, Evaluations

ROOT = Path(__file__).resolve().parents[1]


def command(*arguments: str, repeats: int) -> None:
    """Time a command as a process, after one run that fills the caches."""
    line = [sys.executable, "-m", "pmopt", *arguments]
    times = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        subprocess.run(line, check=True, capture_output=True)
        times.append(time.perf_counter() - began)
    values = times[1:]
    print(
        f"pmopt {' '.join(arguments):28s} first {times[0]:6.2f} s, then median "
        f"{statistics.median(values):.2f} s ({min(values):.2f} .. {max(values):.2f})"
    )


class FreeProblem(DesignProblem):
    """The same problem with a made-up front and no sweep: what is left is pymoo's own time."""

    def evaluate(self, variables: np.ndarray, samples: int | None = None) -> Evaluations:
        """Return two opposed objectives."""
        unit = (variables - self.lower) / (self.upper - self.lower)
        values = np.stack([unit[:, 2] + unit[:, 3], 1 - unit[:, 2] + unit[:, 3]], axis=1)
        return Evaluations(variables, values, 0 * values, np.zeros((len(variables), 1)))


def run_time(problem: DesignProblem) -> float:
    """Return the seconds of a search."""
    began = time.perf_counter()
    for _ in Optimisation(problem).generations():
        pass
    return time.perf_counter() - began


def paper_run(generations: int) -> None:
    """Compare the search with pymoo's own time plus points x ns / threads."""
    config = load_config(ROOT / "configs" / "2pauu-ppap.toml")
    algorithm = config.algorithm.model_copy(update={"generations": generations})
    config = config.model_copy(update={"algorithm": algorithm})
    problem = DesignProblem(config, threads=2)
    single = DesignProblem(config, threads=1)
    settings = config.algorithm
    samples = config.workspace.samples or 0
    rng = np.random.default_rng(1)
    # Designs as a search meets them: most of its time goes to those near the front.
    front = np.array([0.7, 0.7, 1.3, 1.5, 0.3]) + rng.uniform(-0.05, 0.0, (200, 5))
    single.evaluate(front)
    began = time.perf_counter()
    for _ in range(5):
        single.evaluate(front)
    each = (time.perf_counter() - began) / 5 / (200 * samples)
    points = settings.population * settings.generations * samples
    own = run_time(FreeProblem(config, threads=1))
    whole = run_time(problem)
    parts = own + points * each / 2
    print(
        f"\n{settings.population} x {settings.generations} at {samples} points, 2 threads: "
        f"{whole:.1f} s; pymoo's own {own:.1f} s + {points:.1e} points x {each * 1e9:.1f} ns / 2 = "
        f"{parts:.1f} s; ratio {whole / parts:.2f}"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Whole commands and the paper's run.")
    parser.add_argument("--repeats", type=int, default=5, help="of each command")
    parser.add_argument("--generations", type=int, default=200, help="of the paper's run")
    given = parser.parse_args()
    command("--help", repeats=given.repeats)
    command("workspace", "2pauu-ppap", repeats=given.repeats)
    paper_run(given.generations)
