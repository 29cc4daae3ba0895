"""The compiled sweep against NumPy: time a sampled point, 2PaUU-PPaP, making of points included.

Run: python benchmarks/sweep.py [POINTS]
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import chunk_ranges
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms import find
from pmopt.numerics.sequences import make_grid

REPEATS = 7
MODE = (-1.0, -1.0)


def numpy_lci(
    points: NDArray[np.float64], m: float, n: float, l1: float, l2: float, c: float, svd: bool
) -> NDArray[np.float64]:
    """LCI of the reachable points, as a careful NumPy script computes it."""
    x, y, z = points
    a = np.stack([m - n - x, m - n + x])
    b = z - 2 * c
    big_c = a**2 + b**2 + y**2 + l1**2 - l2**2
    square = 4 * l1**2 * (a**2 + b**2) - big_c**2
    reachable = (square >= 0).all(axis=0)
    a, b, y, big_c = a[:, reachable], b[reachable], y[reachable], big_c[:, reachable]
    root = np.sqrt(square[:, reachable]) * np.array(MODE)[:, None]
    scale = 0.5 / (a**2 + b**2)
    across = a - (a * big_c + b * root) * scale
    along = b + (a * root - b * big_c) * scale
    q1, q2 = root / 2
    zero = np.zeros_like(y)
    rows = [
        [-across[0] * q2, y * q2, along[0] * q2],
        [across[1] * q1, y * q1, along[1] * q1],
        [zero, q1 * q2, zero],
    ]
    if svd:
        matrices = np.moveaxis(np.array(rows), 2, 0)
        values = np.linalg.svd(matrices, compute_uv=False)
        return values[:, 2] / values[:, 0]
    return numpy_closed_form(rows)


def numpy_closed_form(rows: list[list[NDArray[np.float64]]]) -> NDArray[np.float64]:
    """Smallest over largest singular value by the trigonometric formula, vectorised."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    g11, g22, g33 = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
    g12, g13, g23 = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    mean = (g11 + g22 + g33) / 3
    d1, d2, d3 = g11 - mean, g22 - mean, g33 - mean
    spread = np.sqrt((d1**2 + d2**2 + d3**2 + 2 * (g12**2 + g13**2 + g23**2)) / 6)
    det = d1 * (d2 * d3 - g23**2) - g12 * (g12 * d3 - g23 * g13) + g13 * (g12 * g23 - d2 * g13)
    angle = np.arccos(np.clip(det / 2 / spread**3, -1, 1)) / 3
    largest = mean + 2 * spread * np.cos(angle)
    smallest = mean + 2 * spread * np.cos(angle + 2 * np.pi / 3)
    return np.sqrt(np.maximum(smallest, 0) / largest)


def main(count: int) -> None:
    """Check agreement, then time interleaved."""
    mechanism = find("2pauu-ppap")
    params = mechanism.resolve({})
    design_values = tuple(float(params[k] or 0.0) for k in ("m", "n", "l1", "l2", "c"))
    samplers = {
        threads: make_sampler(mechanism, WorkspaceSettings(), threads=threads, notify=print)
        for threads in (1, 2)
    }
    design = samplers[1].design(params)
    lower, width = design.lower[:, None], design.width[:, None]

    cells = 60
    tallies = samplers[1].evaluator.tally([design], make_grid(3, cells), 0, cells**3)
    axis = (np.arange(cells) + 0.5) / cells
    grid = np.stack([v.ravel() for v in np.meshgrid(axis, axis, axis, indexing="ij")])
    for svd, tolerance in ((True, 1e-9), (False, 1e-6)):
        values = numpy_lci(lower + width * grid, *design_values, svd=svd)
        assert len(values) == tallies.reachable.sum(), "the reachable counts differ"
        difference = abs(values.sum() / tallies.total.sum() - 1)
        assert difference < tolerance, f"sums of LCI differ by {difference:.1e}"
        print(f"agree: {len(values)} reachable, LCI sums within {difference:.1e} (svd={svd})")

    rng = np.random.default_rng(1)

    def by_numpy(svd: bool, length: int, arrays: int) -> tuple[Callable[[], None], int]:
        def run() -> None:
            for _ in range(arrays):
                numpy_lci(lower + width * rng.random((3, length)), *design_values, svd=svd).sum()

        return run, length * arrays

    def by_sweep(threads: int) -> Callable[[], None]:
        sampler = samplers[threads]
        sequence = sampler.sequence(16)

        def run() -> None:
            for _ in sampler.stream(design, sequence, chunk_ranges(0, count // 16, 16)):
                pass

        return run

    long = max(100_000, min(1_000_000, count // 8))
    peers = {
        "NumPy, one long array": by_numpy(False, long, 1),
        "NumPy, short arrays": by_numpy(False, 20_000, 10),
        "NumPy, batched svd": by_numpy(True, 20_000, 5),
        "pmopt, 1 thread": (by_sweep(1), count),
        "pmopt, 2 threads": (by_sweep(2), count),
    }
    times: dict[str, list[float]] = {name: [] for name in peers}
    for run, _ in peers.values():
        run()
    for _ in range(REPEATS):
        for name, (run, points) in peers.items():
            began = time.perf_counter()
            run()
            times[name].append((time.perf_counter() - began) / points * 1e9)
    ours = times["pmopt, 1 thread"]
    print(f"\n{'':22s} ns a point (min, median, max)   times pmopt on 1 thread (median of pairs)")
    for name, values in times.items():
        ratio = statistics.median(v / o for v, o in zip(values, ours, strict=True))
        print(
            f"{name:22s} {min(values):9.2f} {statistics.median(values):9.2f} "
            f"{max(values):9.2f}   {ratio:8.2f}"
        )


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 8_000_000)
