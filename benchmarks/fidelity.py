"""The Pareto search with adaptive samples against a fixed number of them, in one run.

The fixed search and one adaptive search take points of the R-sequence, the other adaptive search
the sampler of the configuration. All fronts are measured again on the same sample, finer than any
search's and independent of all, and compared by hypervolume.

Run: python benchmarks/fidelity.py [--population 200] [--generations 200] [--samples 100000]
     [--fine 4194304] [--config configs/2pauu-ppap.toml] [--seed 1]
"""

from __future__ import annotations

import argparse
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.reporting.runs.pareto_run import ParetoRun, run_pareto
from pmopt.synthesis.config import RunConfig, resolve_config
from pmopt.synthesis.optimise import hypervolume
from pmopt.synthesis.problem import DesignProblem

CONFIG = Path(__file__).parent.parent / "configs" / "2pauu-ppap.toml"


def timed(config: RunConfig) -> tuple[ParetoRun, float, float]:
    """Run without writing; return the run, wall and CPU time in s."""
    wall, cpu = time.perf_counter(), time.process_time()
    run = run_pareto(config)
    return run, time.perf_counter() - wall, time.process_time() - cpu


def main() -> None:
    """Run both searches, measure both fronts, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--population", type=int)
    parser.add_argument("--generations", type=int)
    parser.add_argument("--samples", type=int, default=100_000, help="of the fixed search")
    parser.add_argument("--fine", type=int, default=1 << 22, help="samples to compare on")
    parser.add_argument("--seed", type=int)
    given = parser.parse_args()

    data: dict[str, Any] = tomllib.loads(given.config.read_text(encoding="utf-8"))
    for name in ("population", "generations", "seed"):
        if getattr(given, name) is not None:
            data.setdefault("algorithm", {})[name] = getattr(given, name)

    own = data.get("workspace", {}).get("sampler", "r-sequence")

    def config(samples: int | str, sampler: str, **changes: int) -> RunConfig:
        workspace = {**data.get("workspace", {}), "samples": samples, "sampler": sampler}
        changed = {**data, "workspace": workspace}
        changed["algorithm"] = {**data.get("algorithm", {}), **changes}
        return resolve_config(changed, str(given.config))

    fixed = config(given.samples, "r-sequence")
    searches = {f"fixed, {given.samples}": fixed}
    for sampler in dict.fromkeys(("r-sequence", own)):
        searches[f"adaptive, {sampler}"] = config("adaptive", sampler)
        # Compiles, loads and imports.
        run_pareto(config("adaptive", sampler, population=4, generations=2))
    # Another seed gives points that none of the searches has seen.
    fine = DesignProblem(config(given.fine, own, seed=fixed.algorithm.seed + 1_000_003))
    reference = None
    print(
        f"{'search':>22s} {'wall s':>8s} {'CPU s':>8s} {'samples':>10s} {'designs':>8s} hypervolume"
    )
    found = []
    for name, one in searches.items():
        run, wall, cpu = timed(one)
        reference = reference or run.front.reference
        rows = np.array([[d.parameters[k] for k in fine.variables] for d in run.front.designs])
        measured = fine.evaluate(rows.astype(float))
        volume = hypervolume(measured.values[measured.feasible], fine.senses, reference)
        history = run.tables["history"]
        spent = (
            int(history["spent"].sum())
            if "spent" in history
            else given.samples * int(history["evaluations"].iloc[-1])
        )
        print(f"{name:>22s} {wall:8.2f} {cpu:8.2f} {spent:10.3g} {len(rows):8d} {volume:.7g}",
              flush=True)  # fmt: skip
        found.append((volume, wall, cpu))
    for name, (volume, wall, cpu) in zip(list(searches)[1:], found[1:], strict=True):
        print(
            f"{name} against fixed: hypervolume {100 * (volume / found[0][0] - 1):+.4f} %, "
            f"wall time x {wall / found[0][1]:.3f}, CPU time x {cpu / found[0][2]:.3f}"
        )


if __name__ == "__main__":
    main()
