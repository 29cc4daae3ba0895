"""Cost to an accuracy: samples and time, on one thread, until volume and GCI are known to 0.1 %.

For a ladder of sample counts the true error (root mean square over independent seeds, against a far
finer run) is measured and a power law fitted; time is measured at the count where the law meets the
target. For 2PaUU-PPaP peers are timed in turn with pmopt's samplers, at the counts they need.

Run: python benchmarks/accuracy.py [--target 0.001] [--seeds 24] [MECHANISM ..]
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from sweep import numpy_lci

from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.estimates import from_replicates
from pmopt.analysis.sampling.measuring import measure_to_target
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.settings import DEFAULT_REPLICATES, WorkspaceSettings
from pmopt.errors import PmoptError
from pmopt.mechanisms import Mechanism, find, names
from pmopt.numerics.sequences import make_grid

PEERED = "2pauu-ppap"
FIRST = 1 << 11
#: Points of a rung, all seeds together, beyond which the law is extrapolated.
BUDGET = 20_000_000
#: Most samples of the reference, whose error is printed.
REFERENCE_SAMPLES = 1 << 26
ROUNDS = 7
#: A timed run lasts at least this long, in s: short ones are repeated within it.
SHORTEST = 0.02

#: Takes a count and a seed and returns volume and GCI.
Estimator = Callable[[int, int], tuple[float, float]]


class Need(NamedTuple):
    """Samples for the target error of volume and of GCI; whether a fit was extrapolated."""

    volume: int
    gci: int
    extrapolated: bool

    @property
    def both(self) -> int:
        return max(self.volume, self.gci)


@dataclass
class Method:
    """One way to sample: its estimator, what a timed run of it does, and what it needs."""

    name: str
    timed: Callable[[int], object]
    need: Need
    note: str = ""


def sampler_names() -> list[str]:
    """Return every sampler of the settings, and the grid, which has a setting of its own."""

    def literals(annotation: Any) -> Iterator[str]:
        for part in get_args(annotation):
            if isinstance(part, str):
                yield part
            else:
                yield from literals(part)

    return [*literals(WorkspaceSettings.model_fields["sampler"].annotation), "grid"]


def grid_estimator(sampler: Sampler, design: Design) -> Estimator:
    dimension = len(design.width)
    prepare = functools.cache(lambda cells: make_grid(dimension, cells))

    def estimate(count: int, seed: int) -> tuple[float, float]:
        cells = cells_of(count, dimension) + seed
        tallies = sampler.evaluator.tally([design], prepare(cells), 0, cells**dimension)
        found = from_replicates(tallies)
        return found.volume.value, found.gci.value

    return estimate


def cells_of(count: int, dimension: int) -> int:
    return max(2, round(count ** (1 / dimension)))


def sampler_estimator(mechanism: Mechanism, sampler: str) -> Estimator:
    """Return the estimator of one of the settings' samplers, with pmopt's replicates."""
    settings = WorkspaceSettings(sampler=sampler)
    samplers: dict[int, tuple[Sampler, Design, Any]] = {}

    def estimate(count: int, seed: int) -> tuple[float, float]:
        if seed not in samplers:  # points are prepared once a run
            sampler = make_sampler(mechanism, settings, seed=seed, threads=1, notify=print)
            design = sampler.design(mechanism.resolve({}))
            samplers[seed] = sampler, design, sampler.sequence(DEFAULT_REPLICATES)
        sampler, design, points = samplers[seed]
        found = from_replicates(sampler.evaluator.tally([design], points, 0, per_replicate(count)))
        return found.volume.value, found.gci.value

    return estimate


def per_replicate(count: int) -> int:
    return max(1, math.ceil(count / DEFAULT_REPLICATES))


def need_of(
    estimate: Estimator,
    truth: tuple[float, float],
    target: float,
    seeds: int,
    slope: float | None = None,
    counts: Callable[[int], int] = lambda count: count,
    spread: Callable[[int], int] | None = None,
) -> Need:
    """Measure errors up a ladder of counts and return where a power law meets the target.

    ``slope`` fixes the exponent (Monte Carlo: -1/2), so that all rungs tell the factor; else it is
    fitted to the last four. ``spread`` tells the number of neighbouring grids of a rung.
    """
    rungs: list[tuple[float, NDArray[np.float64]]] = []
    count = FIRST
    while True:
        number = seeds if spread is None else min(seeds, spread(count))
        found = np.array([estimate(count, seed) for seed in range(1, number + 1)])
        errors = np.sqrt(((found / np.array(truth) - 1) ** 2).mean(axis=0))
        rungs.append((float(counts(count)), errors))
        enough = sum(bool((e < target).all()) for _, e in rungs) >= 2
        if enough or 2 * count * number > BUDGET:
            break
        count *= 2
    where = []
    log_counts = np.log([n for n, _ in rungs])
    for k in (0, 1):
        log_errors = np.log([max(e[k], 1e-300) for _, e in rungs])
        if slope is None:
            few = slice(-4, None)
            b, a = np.polyfit(log_counts[few], log_errors[few], 1) if len(rungs) > 1 else (-0.5, 0)
            b = min(b, -0.3)  # chance may make a short ladder flatter than any sampler is
            a = float((log_errors[few] - b * log_counts[few]).mean())
        else:
            b, a = slope, float((log_errors - slope * log_counts).mean())
        where.append(round(math.exp((math.log(target) - a) / b)))
    return Need(where[0], where[1], max(where) > 2 * rungs[-1][0])


def own_methods(
    mechanism: Mechanism, truth: tuple[float, float], target: float, seeds: int
) -> list[Method]:
    """Return pmopt's samplers with what they need."""
    methods = []
    for sampler in sampler_names():
        if sampler == "grid":
            over = make_sampler(mechanism, WorkspaceSettings(), threads=1)
            estimate = grid_estimator(over, over.design(mechanism.resolve({})))
            dimension = len(mechanism.pose)
            # Grids are not random: neighbouring ones stand for seeds, up to a fifth finer.
            need = need_of(
                estimate, truth, target, seeds,
                counts=lambda n, d=dimension: (1.1 * cells_of(n, d)) ** d,
                spread=lambda n, d=dimension: max(3, cells_of(n, d) // 5),
            )  # fmt: skip
        else:
            estimate = sampler_estimator(mechanism, sampler)
            try:
                slope = -0.5 if sampler == "monte-carlo" else None
                need = need_of(estimate, truth, target, seeds, slope)
            except PmoptError as error:
                print(f"  left out: {error}")
                continue
        seed = 0 if sampler == "grid" else 1
        methods.append(Method(f"pmopt, {sampler}", lambda n, e=estimate, s=seed: e(n, s), need))
    return methods


# -- peers: 2PaUU-PPaP as scripts compute it -------------------------------------------------------


def script_workspace(
    count: int, seed: int, lower: NDArray[np.float64], width: NDArray[np.float64],
    m: float, n: float, l1: float, l2: float, c: float,
) -> tuple[float, float]:  # fmt: skip
    """Volume and GCI by Monte Carlo, vectorised over all points: angles, J, np.linalg.cond."""
    rng = np.random.default_rng(seed)
    x, y, z = lower[:, None] + width[:, None] * rng.random((3, count))
    theta = []
    reachable = np.ones(count, dtype=bool)
    for a in (m - n - x, m - n + x):
        big_a, big_b = 2 * l1 * a, 2 * l1 * (z - 2 * c)
        big_c = a**2 + (z - 2 * c) ** 2 + y**2 + l1**2 - l2**2
        cosine = -big_c / np.hypot(big_a, big_b)
        reachable &= np.abs(cosine) <= 1
        theta.append(np.arctan2(big_b, big_a) - np.arccos(np.clip(cosine, -1, 1)))
    x, y, z = x[reachable], y[reachable], z[reachable]
    t1, t2 = theta[0][reachable], theta[1][reachable]
    zero, one = np.zeros_like(x), np.ones_like(x)
    u1 = np.stack([x + n - m - l1 * np.cos(t1), y, z - 2 * c + l1 * np.sin(t1)], axis=1)
    u2 = np.stack([x - n + m + l1 * np.cos(t2), y, z - 2 * c + l1 * np.sin(t2)], axis=1)
    e1 = np.stack([-l1 * np.sin(t1), zero, -l1 * np.cos(t1)], axis=1)
    e2 = np.stack([l1 * np.sin(t2), zero, -l1 * np.cos(t2)], axis=1)
    j_x = np.stack([u1, u2, np.stack([zero, one, zero], axis=1)], axis=1)
    j_q = np.stack([(u1 * e1).sum(axis=1), (u2 * e2).sum(axis=1), one], axis=1)
    lci = 1 / np.linalg.cond(j_x / j_q[:, :, None])
    return float(np.prod(width)) * len(lci) / count, float(lci.mean())


def careful_workspace(
    points: Callable[[int, int], NDArray[np.float64]], count: int, lower: NDArray[np.float64],
    width: NDArray[np.float64], lengths: tuple[float, ...],
) -> tuple[float, float]:  # fmt: skip
    """Return the same in chunks that fit the cache, by a closed form of what is reachable."""
    chunk, reachable, total = 20_000, 0, 0.0
    for first in range(0, count, chunk):
        unit = points(first, min(chunk, count - first))
        lci = numpy_lci(lower[:, None] + width[:, None] * unit, *lengths, svd=False)
        reachable += len(lci)
        total += float(lci.sum())
    return float(np.prod(width)) * reachable / count, total / reachable


def jax_workspace(
    lower: NDArray[np.float64], width: NDArray[np.float64], lengths: tuple[float, ...]
) -> Estimator | None:
    """Return the estimator compiled by JAX in double precision, None without JAX."""
    # Before JAX starts: everything is timed on one thread.
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        print("  JAX is not installed: left out")
        return None
    jax.config.update("jax_enable_x64", True)
    m, n, l1, l2, c = lengths
    batch = 1 << 16

    @jax.jit
    def sums(key: Any) -> tuple[Any, Any]:
        unit = jax.random.uniform(key, (3, batch), dtype=jnp.float64)
        x, y, z = jnp.asarray(lower)[:, None] + jnp.asarray(width)[:, None] * unit
        a = jnp.stack([m - n - x, m - n + x])
        b = z - 2 * c
        big_c = a**2 + b**2 + y**2 + l1**2 - l2**2
        square = 4 * l1**2 * (a**2 + b**2) - big_c**2
        root = -jnp.sqrt(jnp.maximum(square, 0))
        scale = 0.5 / (a**2 + b**2)
        across = a - (a * big_c + b * root) * scale
        along = b + (a * root - b * big_c) * scale
        q1, q2 = root / 2
        # The middle row is (0, q1 q2, 0).
        r1 = -across[0] * q2, y * q2, along[0] * q2
        r2 = across[1] * q1, y * q1, along[1] * q1
        g11, g22, g33 = sum(v * v for v in r1), sum(v * v for v in r2), (q1 * q2) ** 2
        g12 = sum(v * w for v, w in zip(r1, r2, strict=True))
        g13, g23 = r1[1] * q1 * q2, r2[1] * q1 * q2
        mean = (g11 + g22 + g33) / 3
        d1, d2, d3 = g11 - mean, g22 - mean, g33 - mean
        spread = jnp.sqrt((d1**2 + d2**2 + d3**2 + 2 * (g12**2 + g13**2 + g23**2)) / 6)
        det = d1 * (d2 * d3 - g23**2) - g12 * (g12 * d3 - g23 * g13) + g13 * (g12 * g23 - d2 * g13)
        angle = jnp.arccos(jnp.clip(det / 2 / spread**3, -1, 1)) / 3
        largest = mean + 2 * spread * jnp.cos(angle)
        smallest = mean + 2 * spread * jnp.cos(angle + 2 * jnp.pi / 3)
        within = (square >= 0).all(axis=0)
        lci = jnp.where(within, jnp.sqrt(jnp.maximum(smallest, 0) / largest), 0.0)
        return within.sum(), lci.sum()

    def estimate(count: int, seed: int) -> tuple[float, float]:
        rounds = math.ceil(count / batch)
        parts = [sums(key) for key in jax.random.split(jax.random.key(seed), rounds)]
        reachable, total = (sum(float(p[k]) for p in parts) for k in (0, 1))
        return float(np.prod(width)) * reachable / (rounds * batch), total / reachable

    return estimate


def peers(
    mechanism: Mechanism, truth: tuple[float, float], target: float, seeds: int, own: list[Method]
) -> list[Method]:
    """Return what others would write, each checked against the reference.

    Monte Carlo needs what pmopt's needs: the law of its points is the same.
    """
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    design = sampler.design(mechanism.resolve({}))
    lower, width = design.lower, design.width
    lengths = tuple(float(design.parameters[k] or 0.0) for k in ("m", "n", "l1", "l2", "c"))
    random = next(method.need for method in own if method.name.endswith("monte-carlo"))
    golden = np.array([1.2207440846057596 ** -(d + 1) for d in range(3)])[:, None]

    def script(count: int, seed: int) -> tuple[float, float]:
        return script_workspace(count, seed, lower, width, *lengths)

    def careful(count: int, seed: int) -> tuple[float, float]:
        rng = np.random.default_rng(seed)
        return careful_workspace(lambda _, n: rng.random((3, n)), count, lower, width, lengths)

    def recurrence(count: int, seed: int) -> tuple[float, float]:
        start = np.random.default_rng(seed).random((3, 1))
        return careful_workspace(
            lambda first, n: (start + np.arange(first, first + n) * golden) % 1.0,
            count, lower, width, lengths,
        )  # fmt: skip

    found: list[tuple[str, Estimator | None, Need | None]] = [
        ("NumPy script, Monte Carlo", script, random),
        ("careful NumPy, Monte Carlo", careful, random),
        ("careful NumPy, R-sequence", recurrence, None),
        ("JAX jit, x64, Monte Carlo", jax_workspace(lower, width, lengths), random),
    ]
    methods = []
    for name, estimate, need in found:
        if estimate is None:
            continue
        need = need or need_of(estimate, truth, target, seeds)
        # Five times the Monte Carlo error of this many points, and what rounding of a batch adds.
        count = min(random.both, 1 << 18)
        allowed = 5 * target * math.sqrt(random.both / count)
        for value, true in zip(estimate(count, 1), truth, strict=True):
            if not abs(value / true - 1) < allowed:
                raise SystemExit(f"{name} gives {value!r}, the reference is {true!r}")
        methods.append(Method(name, lambda n, e=estimate: e(n, 1), need))
    return methods


# -- measuring and printing ------------------------------------------------------------------------


def interleaved(methods: list[Method]) -> list[list[float]]:
    """Return the times of every method at its count, in s, run in turn."""
    repeats = []
    for method in methods:
        method.timed(method.need.both)
        began = time.process_time()
        method.timed(method.need.both)
        repeats.append(max(1, round(SHORTEST / (time.process_time() - began))))
    times: list[list[float]] = [[] for _ in methods]
    for _ in range(ROUNDS):
        for k, method in enumerate(methods):
            began = time.process_time()
            for _ in range(repeats[k]):
                method.timed(method.need.both)
            times[k].append((time.process_time() - began) / repeats[k])
    return times


def measure(name: str, target: float, seeds: int, reference: float) -> None:
    """Print the table of one mechanism."""
    mechanism = find(name)
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1, notify=print)
    design = sampler.design(mechanism.resolve({}))
    finer = sampler.for_purpose("reference")
    _, fine = measure_to_target(finer, design, reference, most=REFERENCE_SAMPLES)
    truth = fine.volume.value, fine.gci.value
    errors = [e.error / e.value for e in (fine.volume, fine.gci)]
    print(
        f"\n{name}: volume {truth[0]:.6g} {mechanism.volume_unit}, GCI {truth[1]:.6g}; relative "
        f"standard errors of this reference {errors[0]:.1e} and {errors[1]:.1e}"
    )
    methods = own_methods(mechanism, truth, target, seeds)
    own = len(methods)
    if name == PEERED:
        methods += peers(mechanism, truth, target, seeds, methods)
    times = interleaved(methods)
    best = min(range(own), key=lambda k: statistics.median(times[k]))
    print(
        f"  {'':28s} {'samples to ' + format(target, '.1%'):>25s}  {'time for both':>13s}   "
        f"times {methods[best].name}\n"
        f"  {'':28s} {'volume':>12s} {'GCI':>12s}  {'ms, 1 thread':>13s}   (quartiles)"
    )
    for method, values in zip(methods, times, strict=True):
        ratio = [a / b for a, b in zip(values, times[best], strict=True)]
        low, middle, high = statistics.quantiles(ratio, n=4, method="inclusive")
        mark = "*" if method.need.extrapolated else " "
        print(
            f"  {method.name:28s} {method.need.volume:12d} {method.need.gci:12d}{mark} "
            f"{statistics.median(values) * 1e3:13.3f}   {middle:.3g} ({low:.3g} .. {high:.3g})"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description="Samples and time to an accuracy.")
    parser.add_argument("mechanisms", nargs="*", metavar="MECHANISM", help="default: all")
    parser.add_argument("--target", type=float, default=1e-3, help="relative error, one sigma")
    parser.add_argument("--seeds", type=int, default=24, help="independent runs of a rung")
    parser.add_argument("--reference", type=float, default=3e-5, help="error of the reference")
    given = parser.parse_args()
    print(
        f"Root mean square of the true errors over {given.seeds} seeds (grids: over neighbouring "
        f"ones); pmopt with {DEFAULT_REPLICATES} replicates, whose points are prepared once a run "
        "and not timed; processor time; * extrapolated to more than twice what was measured"
    )
    for name in given.mechanisms or names():
        measure(name, given.target, given.seeds, given.reference)


if __name__ == "__main__":
    main()
