"""Code for any x86-64 with AVX2 and FMA against code for the processor at hand: time and bits.

Every mechanism's sweep, on one thread, both timed in turn in one process.

Run: python benchmarks/targets.py [POINTS] [MECHANISM ..]
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from typing import NamedTuple

import numpy as np

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.sampling.tallies import Tallies
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler import program_text
from pmopt.compiler.machine_code import TARGETS
from pmopt.mechanisms import find, names
from pmopt.numerics.sequences import Sequence

REPEATS = 9


class Case(NamedTuple):
    """A sweep ready to be run."""

    sampler: Sampler
    design: Design
    points: Sequence

    def run(self, count: int) -> Tallies:
        """Sweep the first points."""
        return self.sampler.evaluator.tally([self.design], self.points, 0, count)


def made(target: str, name: str) -> Case:
    """Return a mechanism's sweep, compiled for a target."""
    os.environ["PMOPT_TARGET"] = target
    program_text._loaded.clear()  # texts are kept with the code of the target they were loaded for
    mechanism = find(name)
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1, notify=print)
    case = Case(sampler, sampler.design(mechanism.resolve({})), sampler.sequence(1))
    case.run(4096)
    return case


def main(count: int, mechanisms: list[str]) -> None:
    """Compare the sums to the last bit, then time in turn."""
    for name in mechanisms:
        cases = {target: made(target, name) for target in TARGETS}
        sums = [case.run(count) for case in cases.values()]
        same = all(
            np.array_equal(getattr(sums[0], field), getattr(sums[1], field), equal_nan=True)
            for field in Tallies.__dataclass_fields__
        )
        times: dict[str, list[float]] = {target: [] for target in cases}
        for _ in range(REPEATS):
            for target, case in cases.items():
                began = time.process_time()
                case.run(count)
                times[target].append(time.process_time() - began)
        own, fixed = (statistics.median(times[target]) / count * 1e9 for target in TARGETS)
        print(
            f"{name:12} {TARGETS[0]} {own:6.1f} ns, {TARGETS[1]} {fixed:6.1f} ns a point, "
            f"ratio {fixed / own:.2f}; {'the same bits' if same else 'OTHER BITS'}"
        )


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 1 << 20, sys.argv[2:] or names())
