"""Whole commands, and the paper's 200 x 200 run against what its parts account for.

Run: python benchmarks/commands.py [--repeats 5] [--generations 200]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import pmopt.synthesis.search  # noqa: F401 - importing pymoo is no search
from pmopt.synthesis.config import load_config
from pmopt.synthesis.optimise import Optimisation
from pmopt.synthesis.problem import DesignProblem, Evaluations

ROOT = Path(__file__).resolve().parents[1]
PMOPT = [sys.executable, "-m", "pmopt"]
SAMPLES = 20_000


def told(what: str, times: list[float]) -> None:
    """Print the median and the range of some times."""
    print(f"{what:58s} {statistics.median(times):6.2f} s ({min(times):.2f} .. {max(times):.2f})")


def command(*arguments: str, repeats: int) -> None:
    """Time a command as a process, after one run that fills the caches."""
    times = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        subprocess.run([*PMOPT, *arguments], check=True, capture_output=True)
        times.append(time.perf_counter() - began)
    told(f"pmopt {' '.join(arguments)}", times[1:])


def cold(*arguments: str) -> None:
    """Time a command on an empty cache of kernels."""
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        subprocess.run([*PMOPT, *arguments], check=True, capture_output=True,
                       env={**os.environ, "PMOPT_CACHE_DIR": folder})  # fmt: skip
        told(f"pmopt {' '.join(arguments)}, empty cache", [time.perf_counter() - began])


def first_generation(repeats: int) -> None:
    """Time the start of a search until its first generation is kept."""
    times = []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            line = [
                *PMOPT,
                "pareto",
                str(ROOT / "configs/2pauu-ppap.toml"),
                "--out",
                f"{folder}/run",
            ]
            began = time.perf_counter()
            process = subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            while not list(Path(folder).glob("run/**/*0001*")) and process.poll() is None:
                time.sleep(0.005)
            times.append(time.perf_counter() - began)
            process.kill()
            process.wait()
    told("pmopt pareto configs/2pauu-ppap.toml, first generation", times)


class FreeProblem(DesignProblem):
    """The same problem with a made-up front and no sweep: what is left is the search itself."""

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
    """Compare the search with its own time plus points x ns / threads."""
    config = load_config(ROOT / "configs" / "2pauu-ppap.toml")
    algorithm = config.algorithm.model_copy(update={"generations": generations})
    workspace = config.workspace.model_copy(update={"samples": SAMPLES, "sampler": "r-sequence"})
    config = config.model_copy(update={"algorithm": algorithm, "workspace": workspace})
    problem = DesignProblem(config, threads=2)
    single = DesignProblem(config, threads=1)
    settings = config.algorithm
    rng = np.random.default_rng(1)
    # Designs as a search meets them: most of its time goes to those near the front.
    front = np.array([0.7, 0.7, 1.3, 1.5, 0.3]) + rng.uniform(-0.05, 0.0, (200, 5))
    single.evaluate(front)
    began = time.perf_counter()
    for _ in range(5):
        single.evaluate(front)
    each = (time.perf_counter() - began) / 5 / (200 * SAMPLES)
    points = settings.population * settings.generations * SAMPLES
    free = FreeProblem(config, threads=1)
    own = run_time(free)
    whole = run_time(problem)
    parts = own + points * each / 2
    size = f"{settings.population} x {settings.generations}"
    print(
        f"\n{size} at {SAMPLES} points, 2 threads: {whole:.1f} s; "
        f"the search's own {own:.1f} s + {points:.1e} points x {each * 1e9:.1f} ns / 2 = "
        f"{parts:.1f} s; ratio {whole / parts:.2f}"
    )
    each = 1e3 * own / settings.generations
    print(f"{size} without samples: {own:.2f} s, {each:.1f} ms a generation")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Whole commands and the paper's run.")
    parser.add_argument("--repeats", type=int, default=5, help="of each command")
    parser.add_argument("--generations", type=int, default=200, help="of the paper's run")
    parser.add_argument("--warm", action="store_true", help="leave the empty cache out")
    given = parser.parse_args()
    command("--help", repeats=given.repeats)
    command("workspace", "2pauu-ppap", "--samples", "1000000", repeats=given.repeats)
    command("workspace", "2pauu-ppap", "--samples", "1000000", "--shape-grid", "0",
            repeats=given.repeats)  # fmt: skip
    first_generation(given.repeats)
    if not given.warm:
        cold("workspace", "2pauu-ppap", "--samples", "1000000")
    paper_run(given.generations)
