"""The compiled sweep against C: time a sampled point of every mechanism, on one thread.

The references in c/ are C as one would write it for one mechanism; they are built with gcc into a
temporary folder. Both sides make the same points and must agree before anything is timed.

Run: python benchmarks/kernels.py [--points POINTS] [--pairs PAIRS] [MECHANISM ..]
"""

from __future__ import annotations

import argparse
import ctypes
import math
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import Tallies, chunk_ranges
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms import find
from pmopt.numerics.sequences import Sequence

SOURCES = Path(__file__).resolve().parent / "c"
# -ffast-math is for compiling alone: at linking it would switch the whole process to flushing
# denormal numbers.
FLAGS = ("-O3", "-march=native", "-ffast-math", "-std=gnu11", "-fPIC")
WIDTHS = (512, 256)
REPLICATES = 16
TOLERANCE = 1e-9
#: Stands for no limit: the references are compiled for finite numbers.
NO_LIMIT = 1e300
POINTER = ctypes.POINTER(ctypes.c_double)


class Sums(NamedTuple):
    """What a reference returns of one design: the fields of the same name of a Tallies.

    ``above`` (1, R, e), the others (1, R).
    """

    within: NDArray[np.float64]
    total: NDArray[np.float64]
    smallest: NDArray[np.float64]
    largest: NDArray[np.float64]
    above: NDArray[np.int64]


Sweep = Callable[[Design, Sequence, int, int], Sums]


def strokes(design: Design, joints: tuple[str, ...]) -> list[float]:
    """Return the lower ends of all joints' limits, then the upper ones."""
    return [design.limits[joint][side] for side in (0, 1) for joint in joints]


def pauu_ppap(design: Design) -> list[float]:
    top = design.parameters["h"]
    lengths = [design.parameters[k] for k in ("m", "n", "l1", "l2", "c")]
    return [*lengths, -1.0, -1.0, NO_LIMIT if top is None else top]


def ups_sp(design: Design) -> list[float]:
    big, small, kite, twist = (design.parameters[k] for k in ("A", "a", "kite", "twist"))
    arms = small * np.array([[1.0, 0.0], [kite, kite], [0.0, 1.0]])
    turn = np.array([[math.cos(twist), -math.sin(twist)], [math.sin(twist), math.cos(twist)]])
    limits = strokes(design, ("l1", "l2", "l3", "l4"))
    return [big / 2, *(arms @ turn.T).ravel(), 1 / design.length, *limits]


def ups_rps(design: Design) -> list[float]:
    big1, big, small = (design.parameters[k] for k in ("R1", "R", "r"))
    side = big / math.sqrt(2)
    anchors = [[big1, 0], [side, side], [-side, side], [-side, -side], [side, -side]]
    turns = 2 * math.pi / 5 * np.arange(5)
    points = small * np.stack([np.sin(turns), -np.cos(turns)], axis=1)
    limits = strokes(design, ("l1", "l2", "l3", "l4", "l5"))
    return [*np.ravel(anchors), *points.ravel(), small, 1 / design.length, *limits]


def cur(design: Design) -> list[float]:
    sizes = [design.parameters[k] for k in ("Ra", "Rb", "L", "d1")]
    arcs: list[float] = []
    for low, high in (design.limits[name] for name in ("theta4", "theta5")):
        arcs += [math.cos((low + high) / 2), math.sin((low + high) / 2), math.cos((high - low) / 2)]
    down, up = design.limits["elevation"]
    elevation = [math.sin(down), NO_LIMIT if up >= math.pi / 2 else math.sin(up)]
    return [*sizes, design.length, *strokes(design, ("h1", "h2", "h3")), *arcs, *elevation]


def uu_upu(design: Design) -> list[float]:
    sizes = [design.parameters[k] for k in ("bs", "ps", "L")]
    return [*sizes, design.length, *design.limits["l1"]]


#: The constants of each reference by mechanism, in the order of its ``struct design``; those of
#: the first working mode and the default limits.
CONSTANTS: dict[str, Callable[[Design], list[float]]] = {
    "2pauu-ppap": pauu_ppap,
    "3-ups-sp": ups_sp,
    "4-ups-rps": ups_rps,
    "3-cur": cur,
    "2uu-upu": uu_upu,
}
#: Points by mechanism, for about a second of both sides.
POINTS = {
    "2pauu-ppap": 1 << 22,
    "3-ups-sp": 1 << 21,
    "4-ups-rps": 1 << 20,
    "3-cur": 1 << 21,
    "2uu-upu": 1 << 20,
}


def build(name: str, width: int, folder: Path) -> Sweep:
    """Compile one reference and return it for points as :meth:`Evaluator.tally` takes them."""
    stem = folder / f"{name}-{width}"
    source = SOURCES / f"{name}.c"
    wide = f"-mprefer-vector-width={width}"
    subprocess.run(["gcc", *FLAGS, wide, "-c", str(source), "-o", f"{stem}.o"], check=True)
    subprocess.run(["gcc", "-shared", f"{stem}.o", "-o", f"{stem}.so", "-lm"], check=True)
    function = ctypes.CDLL(f"{stem}.so").sweep
    function.restype = None

    def sweep(design: Design, points: Sequence, first: int, last: int) -> Sums:
        edges = np.array(WorkspaceSettings().regions[1:-1])
        found = np.empty((1, points.replicates, 4))
        above = np.empty((1, points.replicates, len(edges)), dtype=np.int64)
        arrays = [np.array(CONSTANTS[name](design), dtype=float), points.step, points.start]
        box = [design.lower, design.width, edges]
        function(
            *(_address(a) for a in arrays),
            points.replicates,
            ctypes.c_int64(first),
            ctypes.c_int64(last),
            *(_address(a) for a in box),
            len(edges),
            _address(found),
            _address(above),
        )
        return Sums(*np.moveaxis(found, 2, 0), above)

    return sweep


def _address(array: NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def disagreement(ours: Tallies, theirs: Sums) -> str | None:
    """Say what differs by more than rounding; None where both are the same."""
    for field in ("within", "above"):
        a, b = (np.asarray(getattr(t, field)[0].sum(axis=0)) for t in (ours, theirs))
        if (a != b).any():
            return f"points {field}: {a.tolist()} and {b.tolist()}"
    total, other = (float(t.total.sum()) for t in (ours, theirs))
    if not abs(other - total) <= TOLERANCE * abs(total):
        return f"sums of LCI: {total!r} and {other!r}"
    for field in ("smallest", "largest"):
        gap = float(np.abs(getattr(ours, field) - getattr(theirs, field)).max())
        if not gap <= TOLERANCE:
            return f"the {field} LCI: {gap:.1e} apart"
    return None


def paired(
    runs: dict[str, Callable[[], object]],
    pairs: int,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, list[float]]:
    """Time each run once, in turn, ``pairs`` times.

    One thread's runs in processor time, which leaves out what other processes took meanwhile.
    """
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(pairs):
        for name, run in runs.items():
            began = clock()
            run()
            times[name].append(clock() - began)
    return times


def ratios(times: dict[str, list[float]], above: str, below: str) -> str:
    """Return the median and the quartiles of the ratios of pairs."""
    values = [a / b for a, b in zip(times[above], times[below], strict=True)]
    low, middle, high = statistics.quantiles(values, n=4, method="inclusive")
    return f"{middle:5.2f} ({low:.2f} .. {high:.2f})"


def measure(name: str, points: int, pairs: int, folder: Path) -> None:
    """Check agreement of one mechanism, then time interleaved and print a line."""
    mechanism = find(name)
    samplers = {
        threads: make_sampler(mechanism, WorkspaceSettings(), threads=threads, notify=print)
        for threads in (1, 2)
    }
    design = samplers[1].design(mechanism.resolve({}))
    sequence = samplers[1].sequence(REPLICATES)
    count = max(1, points // REPLICATES)
    points = count * REPLICATES
    ours = samplers[1].evaluator.tally([design], sequence, 0, count)
    references = {width: build(name, width, folder) for width in WIDTHS}
    for width, reference in references.items():
        found = disagreement(ours, reference(design, sequence, 0, count))
        if found is not None:
            sys.exit(f"{name}: pmopt and C ({width} bit) disagree: {found}")
    trial = paired(
        {str(w): lambda w=w: references[w](design, sequence, 0, count) for w in WIDTHS}, 3
    )
    width = min(WIDTHS, key=lambda w: min(trial[str(w)]))

    def stream(threads: int) -> None:
        for _ in samplers[threads].stream(design, sequence, chunk_ranges(0, count, REPLICATES)):
            pass

    runs: dict[str, Callable[[], object]] = {
        "C": lambda: references[width](design, sequence, 0, count),
        "pmopt": lambda: samplers[1].evaluator.tally([design], sequence, 0, count),
    }
    times = paired(runs, pairs)
    threads = paired({"1": lambda: stream(1), "2": lambda: stream(2)}, pairs, time.perf_counter)
    c, own = (statistics.median(times[k]) / points * 1e9 for k in ("C", "pmopt"))
    share = float(ours.within.sum()) / points
    print(
        f"{name:11s} {points:9d} {share:6.1%} {c:8.2f} ({width}) {own:9.2f}   "
        f"{ratios(times, 'pmopt', 'C'):22s} {ratios(threads, '1', '2')}",
        flush=True,
    )


def main(names: list[str], points: int | None, pairs: int) -> None:
    if shutil.which("gcc") is None:
        print("no gcc: nothing to compare with")
        return
    print(
        f"agreement first: sums of LCI within {TOLERANCE:g}, the same counts; gcc {' '.join(FLAGS)}"
    )
    print(
        f"{'':11s} {'points':>9s} {'within':>6s} {'C, ns (bits)':>14s} {'pmopt, ns':>9s}   "
        f"{'pmopt / C (quartiles)':22s} pmopt, 1 thread / 2 threads"
    )
    with tempfile.TemporaryDirectory(prefix="pmopt-references-") as folder:
        for name in names:
            measure(name, points or POINTS[name], pairs, Path(folder))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="The compiled sweep against C.")
    parser.add_argument("mechanisms", nargs="*", metavar="MECHANISM", help="default: all five")
    parser.add_argument("--points", type=lambda text: int(float(text)), help="sampled points")
    parser.add_argument("--pairs", type=int, default=9, help="interleaved pairs")
    given = parser.parse_args()
    for unknown in set(given.mechanisms) - set(CONSTANTS):
        parser.error(f"{unknown}: no reference; there are {', '.join(CONSTANTS)}")
    main(given.mechanisms or list(CONSTANTS), given.points, given.pairs)
