"""Cluster: what a design, a task, a block and a run of a batch cost; what 1,000 cores would give.

The scheduler is driven by tasks that sleep, so that a few cores stand for many: what is measured is
how long the threads of a cluster wait for their next task. Processor times are of one thread.

Run: python benchmarks/cluster.py [--threads 100] [--designs 2000] [--rounds 3]
"""

from __future__ import annotations

import argparse
import pickle
import statistics
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import BLOCK_CHUNKS, CHUNK
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.execution.cluster import Cluster
from pmopt.execution.workers import LocalWorkers
from pmopt.mechanisms import find
from pmopt.reporting.batch.plan import plan_runs
from pmopt.reporting.batch.run import Batch
from pmopt.reporting.batch.summary import RunSummary
from pmopt.synthesis.config import resolve_config
from pmopt.synthesis.problem import DesignProblem

ROOT = Path(__file__).resolve().parents[1]
MECHANISM = "2pauu-ppap"
#: The study on paper.
CORES, DESIGNS = 1000, 10**6
#: Seconds of a task.
LENGTHS = (0.0, 0.01, 0.03, 0.1, 0.3)
#: Tasks of each thread: at the end some wait for the last.
WAVES = 10


def median(values: list[float]) -> str:
    """Return the median and the range of rounds."""
    return f"{statistics.median(values):.3g} ({min(values):.3g} .. {max(values):.3g})"


def cpu(work: Callable[[], Any]) -> float:
    """Return the processor time of some work, in s."""
    began = time.process_time()
    work()
    return time.process_time() - began


def designs(count: int, rounds: int) -> tuple[float, float]:
    """Return the seconds of a design in the search and measured finely."""
    with (ROOT / "configs" / f"{MECHANISM}.toml").open("rb") as stream:
        data: dict[str, Any] = tomllib.load(stream)
    data["workspace"] = {"samples": 20_000}
    problem = DesignProblem(resolve_config(data, "cluster"), threads=1)
    rng = np.random.default_rng(1)
    unit = rng.random((count, len(problem.variables)))
    some = problem.lower + (problem.upper - problem.lower) * unit
    problem.evaluate(some[:2])
    few = some[: max(2, count // 100)]
    coarse = [cpu(lambda: problem.evaluate(some)) / count for _ in range(rounds)]
    fine = [cpu(lambda: list(problem.measure(few))) / len(few) for _ in range(rounds)]
    print(f"{MECHANISM}, 1 thread, processor time of a design")
    print(f"  20,000 samples:    {median([1e6 * v for v in coarse])} us")
    target = problem.config.final.target_error
    print(f"  to an error of {target:g}: {median([1e3 * v for v in fine])} ms")
    return statistics.median(coarse), statistics.median(fine)


def blocks(rounds: int) -> None:
    """Tell what a block of a workspace takes and what its sums weigh."""
    mechanism = find(MECHANISM)
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    design, points = sampler.design(mechanism.resolve({})), sampler.sequence(16)
    last = CHUNK * BLOCK_CHUNKS // 16
    found = list(sampler.blocks(design, points, 0, last, lambda count: None))
    times = [cpu(lambda: list(sampler.blocks(design, points, 0, last, lambda count: None)))
             for _ in range(rounds)]  # fmt: skip
    print(f"\na block of {CHUNK * BLOCK_CHUNKS:,d} samples")
    print(f"  processor time:    {median([1e3 * v for v in times])} ms")
    print(f"  its sums:          {len(pickle.dumps(found[0])) / 1000:.0f} kB")


def batch(runs: int, rounds: int) -> None:
    """Tell what a batch adds to each of its runs, and what a worker process takes to start."""
    text = f"""
command = "workspace"
mechanism = "{MECHANISM}"
shape_grid = 0
[workspace]
samples = 10000
[sweep]
seed = {list(range(runs))}
"""
    added: list[float] = []
    starts: list[float] = []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "runs.toml"
            path.write_text(text)
            ends: list[float] = []
            planned = Batch(plan_runs([str(path)]), Path(folder) / "out")
            began = time.perf_counter()

            def on_done(run: RunSummary, ends: list[float] = ends) -> None:
                ends.append(time.perf_counter())

            with LocalWorkers(1) as pool:
                done = planned.run(pool, threads=1, notify=print, on_done=on_done)
            first, *others = [run.wall_time or 0.0 for run in done.runs]
            added.append((ends[-1] - ends[0] - sum(others)) / len(others))
            starts.append(ends[0] - began - first)
    print(f"\na batch of {runs} short runs on one worker process")
    print(f"  added to a run:    {median([1e3 * v for v in added])} ms")
    print(f"  first, once:       {median(starts)} s")


def tasks(threads: int, rounds: int) -> float:
    """Return the seconds the scheduler takes for a task, from tasks that sleep."""
    from distributed import LocalCluster

    processes = max(1, min(4, threads // 8))
    threads = processes * (threads // processes)
    with (
        LocalCluster(
            n_workers=processes, threads_per_worker=threads // processes, dashboard_address=":0"
        ) as local,
        Cluster(local.scheduler_address) as cluster,
    ):

        def wall(length: float, count: int) -> float:
            began = time.perf_counter()
            for _ in cluster.ordered_map(time.sleep, [length] * count):
                pass
            return time.perf_counter() - began

        wall(0.01, threads)
        trips = [wall(0.0, 1) for _ in range(4 * rounds)]
        print(f"\n{threads} threads that sleep, in {processes} processes")
        print(f"  one task, there and back: {median([1e3 * v for v in trips])} ms")
        print("  task, ms   tasks/s   share of the time asleep")
        count = WAVES * threads
        overhead = 0.0
        for length in LENGTHS:
            walls = [wall(length, count) for _ in range(rounds)]
            overhead = overhead or statistics.median(walls) / count
            shares = median([count * length / threads / v for v in walls])
            print(f"  {1e3 * length:8.0f}   {count / statistics.median(walls):7.0f}   {shares}")
    print(f"  the scheduler: {1e3 * overhead:.2g} ms a task")
    return overhead


def paper(design: float, task: float) -> None:
    """Print what many cores give by the number of designs in a task.

    All tasks pass one scheduler, ``task`` seconds each; the cores need their share of the work,
    and at the end wait for the last task.
    """
    total = DESIGNS * design
    print(
        f"\n{DESIGNS:,d} designs of {1e3 * design:.3g} ms, {total:.3g} s of one core, "
        f"on {CORES:,d} cores"
    )
    print("  designs a task   task, s   whole, s   efficiency   cores kept busy")
    for size in (1, 10, 100, 1000):
        length = size * design
        wall = max(total / CORES, DESIGNS / size * task) + length
        busy = min(DESIGNS / size, length / task)
        print(
            f"  {size:14,d}   {length:7.2g}   {wall:8.3g}   {total / CORES / wall:10.2f}   "
            f"{busy:15,.0f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="What a cluster costs and gives.")
    number = {"type": lambda text: int(float(text))}
    parser.add_argument("--threads", **number, default=96, help="that sleep")
    parser.add_argument("--designs", **number, default=5000, help="to time")
    parser.add_argument("--runs", **number, default=8, help="of the batch")
    parser.add_argument("--rounds", **number, default=5, help="repetitions")
    given = parser.parse_args()
    coarse, fine = designs(given.designs, given.rounds)
    blocks(given.rounds)
    batch(given.runs, given.rounds)
    task = tasks(given.threads, given.rounds)
    for design in (coarse, fine):
        paper(design, task)


if __name__ == "__main__":
    main()
