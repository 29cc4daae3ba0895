"""Figures of how often errors hold: studies of many seeds, all slow but the first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

import pmopt
from making.figures import Figure, rounded
from making.pages import Says, Statement
from making.registry import maker
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.estimates import Estimates, from_replicates
from pmopt.analysis.sampling.measuring import measure_on_grid, measure_to_target
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.sampling.tallies import BINS
from pmopt.analysis.settings import WorkspaceSettings, split_samples
from pmopt.mechanisms import find

PAGE, CAPABILITY = "docs/method.md", "docs/capability.md"
TORUS = {"m": 0.9, "n": 0.9, "l1": 1.0, "l2": 0.8}
VOLUME = math.pi**2 * 0.8**2
SAMPLERS = ("r-sequence", "sobol", "monte-carlo", "lines")
#: Mechanism, design and settings of what quantiles are taken of.
CASES = (
    ("4-ups-rps", {"R1": 710.571, "R": 571.213, "r": 184.038}, {"jacobian": "raw", "norm": "fro"}),
    ("2pauu-ppap", {}, {}),
    ("3-ups-sp", {}, {}),
)


@cache
def _prepared(name: str, params: tuple[tuple[str, float], ...], settings: tuple[tuple[str, str]],
              sampler: str) -> tuple[Sampler, Design]:  # fmt: skip
    mechanism, asked = find(name), WorkspaceSettings(sampler=sampler, **dict(settings))
    made = make_sampler(mechanism, asked, threads=1)
    return made, made.design(mechanism.resolve(dict(params)))


def prepared(name: str, params: dict[str, float], sampler: str = "r-sequence",
             **settings: str) -> tuple[Sampler, Design]:  # fmt: skip
    """Return a sampler, of which each run takes one with its seed, and a design."""
    return _prepared(name, tuple(params.items()), tuple(settings.items()), sampler)


def sampled_by(sampler: Sampler, design: Design, samples: int, seed: int) -> Estimates:
    """Return the estimates of one run."""
    sampler = sampler.with_seed(seed)
    replicates, each = split_samples(samples, None)
    return from_replicates(
        sampler.evaluator.tally([design], sampler.sequence(replicates), 0, each, BINS)
    )


def within(scores: Iterable[float] | NDArray[np.float64]) -> list[float]:
    """Return the shares in per cent of scores within one, two, three errors."""
    sizes = np.abs(np.asarray(scores, dtype=float))
    return [100 * float((sizes <= k).mean()) for k in (1, 2, 3)]


def spans(shares: list[list[float]]) -> tuple[Figure, ...]:
    """Return least and largest share within one, two, three errors; a chance of some per cent."""
    columns = np.array(shares).T
    return tuple(rounded(v, ".0f", within=3) for c in columns for v in (c.min(), c.max()))


@maker("errors-of-a-torus")
def torus() -> Iterator[Statement]:
    """Yield how errors of a known volume compare with the stated ones, over 100 seeds."""
    found = []
    for kind, samples in (("r-sequence", 200_000), ("monte-carlo", 20_000)):
        sampler, design = prepared("2pauu-ppap", TORUS, kind)
        volumes = [sampled_by(sampler, design, samples, seed).volume for seed in range(100)]
        found.append(np.array([(v.value - VOLUME) / v.error for v in volumes]))
    # The deviation of 100 is good to 7 %.
    first, second = (rounded(float(s.std()), ".2f", within=0.2) for s in found)
    largest = tuple(rounded(float(np.abs(s).max()), ".1f", within=0.8) for s in found)
    yield Says(
        PAGE,
        "had a standard deviation of {} for the R-sequence (200,000 samples) and {} for Monte "
        "Carlo (20,000); the largest were {} and {}.",
        (first, second, *largest),
    )


@maker("errors-of-quantiles", slow=True)
def quantiles() -> Iterator[Statement]:
    """Yield how often quantiles of LCI are within their errors, over 400 seeds."""
    shares = []
    for name, params, settings in CASES:
        truth = sampled_by(*prepared(name, params, "lines", **settings), 1 << 24, 99).quantiles
        for kind in SAMPLERS:
            sampler, design = prepared(name, params, kind, **settings)
            for samples in (2_000, 100_000):
                runs = [sampled_by(sampler, design, samples, s).quantiles for s in range(400)]
                for k, wanted in enumerate(truth):
                    off = [(r[k].value - wanted.value) / r[k].error for r in runs]
                    shares.append(within(off))
    yield Says(
        PAGE,
        "of three mechanisms by each sampler, {} to {} % of the quantiles were within one stated "
        "error of those of 2^24 samples, {} to {} % within two and {} to {} % within three.",
        spans(shares),
    )


@maker("bounds-of-grids", slow=True)
def grids() -> Iterator[Statement]:
    """Yield how the bounds of grids hold on a torus of known volume."""
    sampler, design = prepared("2pauu-ppap", TORUS)
    sizes = range(12, 139, 2)
    off = [
        (abs(v.value - VOLUME) / v.error)
        for v in (measure_on_grid(sampler, design, cells)[1].volume for cells in sizes)
    ]
    beyond = sum(o > 1 for o in off)
    yield Says(
        PAGE,
        "Of {} grids of 12 to 138 cells on that torus {} exceeded it, the median error was {} % "
        "of it.",
        (str(len(sizes)), "none" if beyond == 0 else str(beyond),
         rounded(100 * float(np.median(off)), ".0f", within=1)),
    )  # fmt: skip


@maker("errors-at-targets", slow=True)
def targets() -> Iterator[Statement]:
    """Yield how often errors hold where a run ends at a target error, over 400 seeds."""
    truth = sampled_by(*prepared("2pauu-ppap", {}, "lines"), 1 << 24, 99)
    shares, counts = [], {}
    for kind in SAMPLERS:
        sampler, design = prepared("2pauu-ppap", {}, kind)
        for target in (0.1, 0.03, 0.01, 0.003):
            runs = []
            for seed in range(400):
                runs.append(measure_to_target(sampler.with_seed(seed), design, target)[1])
            for key in ("volume", "gci"):
                wanted = getattr(truth, key).value
                ends = [getattr(r, key) for r in runs]
                shares.append(within([(e.value - wanted) / e.error for e in ends]))
            counts[kind, target] = float(np.mean([r.samples for r in runs]))
    yield Says(
        PAGE,
        "volume and GCI were within one stated error in {} to {} %, within two in {} to {} %, "
        "within three in {} to {} %.",
        spans(shares),
    )
    yield Says(
        PAGE,
        "Default 2PaUU-PPaP takes {} samples on average to 1 %, {} to 0.3 %.",
        tuple(
            rounded(round(counts["r-sequence", target], -3), ",.0f", within=1000)
            for target in (0.01, 0.003)
        ),
    )


@maker("errors-of-capability", slow=True)
def capability() -> Iterator[Statement]:
    """Yield how often figures of capability are within their errors, over 80 seeds of 3-CUR."""
    task = {"speed": 1.0, "acceleration": 10.0, "turn": 1.0, "payload": 1.0}
    needed = pmopt.capability("3-cur", samples=1 << 14, **task).to_dict()["demands"]
    # Motors that are enough in half of the workspace, each.
    motors = {d["name"]: d["needed"]["0.5"]["value"] for d in needed}

    def run(samples: int, seed: int) -> dict[str, tuple[float, float]]:
        return _figures(
            pmopt.capability("3-cur", samples=samples, seed=seed, motors=motors, **task).to_dict()
        )

    truth = run(1 << 20, 99)
    runs = [run(1 << 14, seed) for seed in range(80)]
    shares = []
    for key, (wanted, _) in truth.items():
        off = [(r[key][0] - wanted) / r[key][1] for r in runs if r[key][1] > 0]
        if len(off) == len(runs):
            shares.append(within(off))
    mean, least = np.mean(shares, axis=0), np.min(shares, axis=0)
    yield Says(
        CAPABILITY,
        "on average over all figures {}, {} and {} % lay within 1, 2 and 3 errors (a normal error: "
        "68, 95, 99.7), of the worst one {}, {} and {} %.",
        (
            *(rounded(v, ".0f", within=2) for v in mean),
            *(rounded(v, ".0f", within=5) for v in least),
        ),
    )


def _figures(document: object, path: str = "") -> dict[str, tuple[float, float]]:
    """Return every value of a JSON document beside which its error stands."""
    found: dict[str, tuple[float, float]] = {}
    if isinstance(document, dict):
        for key, value in document.items():
            error = document.get(f"{key}_error", document.get(f"{key}_standard_error"))
            if key == "value":
                error = document.get("standard_error")
            if isinstance(value, float) and isinstance(error, float):
                found[f"{path}{key}"] = value, error
            found |= _figures(value, f"{path}{key}.")
    elif isinstance(document, list):
        for k, value in enumerate(document):
            found |= _figures(value, f"{path}{k}.")
    return found
