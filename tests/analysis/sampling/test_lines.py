"""The sampler "lines": parts against brute force, sums against a loop and plain samplers."""

import math

import numpy as np
import pytest
from support import naive
from support.poses import constants_of

from pmopt.analysis.sampling.estimates import from_replicates
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import BINS
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.errors import InputError
from pmopt.kernels import sweep
from pmopt.mechanisms import find, names

OFFERED = [name for name in names() if find(name).line is not None]

#: Settings that leave the parts known, cut them, or know limits that the parts do not.
CASES = {
    "default": ({}, {}),
    "design": (
        {
            "2pauu-ppap": {"m": 0.6, "n": 0.9, "l1": 0.7, "l2": 1.1, "h": 1.2},
            "3-cur": {"Ra": 0.24, "Rb": 0.1, "L": 0.32, "d1": 0.05},
            "3-ups-sp": {"A": 45.0, "a": 25.0, "kite": 0.7, "twist": 0.5},
            "4-ups-rps": {"R1": 800.0, "R": 600.0, "r": 260.0},
        },
        {},
    ),
    "limits": (
        {},
        {
            "2pauu-ppap": {"limits": {"theta1": (-0.6, 2.2), "d": (-0.3, 0.8)}},
            "3-cur": {"limits": {"h1": (0.05, 0.2), "theta4": (-0.3, 0.4)}},
            "3-ups-sp": {"limits": {"l1": (50.0, 70.0), "l4": (48.0, 80.0)}},
            "4-ups-rps": {"limits": {"l2": (300.0, 1100.0), "l5": (820.0, 1250.0)}},
        },
    ),
    "both parts": (  # short limbs may point either way
        {},
        {
            "2pauu-ppap": {"domain": {"y": (-0.7, 0.4), "z": (-math.inf, math.inf)}},
            "3-cur": {"working_mode": "down-down-down",
                      "limits": {"elevation": (-math.pi / 2, 0.0), "theta5": (-3.0, -0.2)}},
            "3-ups-sp": {"domain": {"l4": (-90.0, 90.0)}, "limits": {"l4": (-90.0, 90.0)}},
            "4-ups-rps": {"domain": {"x": (-1300.0, 1300.0)}},
        },
    ),
    "checks": (
        {},
        {
            "2pauu-ppap": {"norm": "fro", "cone_angle": 1.0},
            "4-ups-rps": {"norm": "fro", "link_diameter": 60.0},
        },
    ),
}  # fmt: skip


#: Each mechanism in each case that is another for it. The largest kernel with checks takes longest.
EACH = [
    pytest.param(
        name, case, marks=pytest.mark.slow if (name, case) == ("4-ups-rps", "checks") else ()
    )
    for case, given in CASES.items()
    for name in OFFERED
    if case == "default" or any(name in part for part in given)
]


def case_of(name, case, **settings):
    """Return parameters and settings of a case."""
    params, options = CASES[case]
    return params.get(name, {}), {**options.get(name, {}), **settings}


def parts_in(sampler, design):
    """Return what gives the parts of the line through a pose, by the plain function.

    They are (start, end) pairs.
    """
    mechanism, axis = sampler.space.mechanism, sampler.space.mechanism.line_axis
    low = design.lower[axis]
    constants = constants_of(mechanism, design)

    def parts_of(pose):
        flat = mechanism.line(*pose, low, low + design.width[axis], constants)
        assert len(flat) == 2 * mechanism.line_parts
        return list(zip(flat[::2], flat[1::2], strict=True))

    return parts_of


@pytest.mark.parametrize(("name", "case"), EACH)
def test_parts_hold_all_that_is_reachable(name, case):
    """Parts are disjoint and ascend, and no reachable point is outside them."""
    params, settings = case_of(name, case)
    sampler = make_sampler(find(name), WorkspaceSettings(**settings), threads=1)
    design = sampler.design(sampler.space.mechanism.resolve(params))
    poses = sampler.evaluator.points(design, sampler.sequence(4), 0, 20_000)
    margin, _ = sampler.evaluator.field(design, poses)
    axis, parts_of = sampler.space.mechanism.line_axis, parts_in(sampler, design)
    reached = np.flatnonzero(margin >= 0)
    assert len(reached) > 100
    for i in reached[:2000]:
        parts = parts_of(poses[:, i].tolist())
        ends = [end for part in parts if part[1] > part[0] for end in part]
        assert ends == sorted(ends)
        slack = 1e-12 * (abs(poses[axis, i]) + 1)
        assert any(low - slack <= poses[axis, i] <= high + slack for low, high in parts)


@pytest.mark.parametrize(("name", "case"), EACH)
def test_agrees_with_the_plain_sampler(name, case):
    """Volume, GCI, regions and quantiles within their errors, which are the smaller ones."""
    found = {}
    for kind in ("lines", "r-sequence"):
        params, settings = case_of(name, case, sampler=kind)
        sampler = make_sampler(find(name), WorkspaceSettings(**settings), seed=4, threads=2)
        design = sampler.design(sampler.space.mechanism.resolve(params))
        found[kind] = from_replicates(
            sampler.evaluator.tally([design], sampler.sequence(32), 0, 1 << 12, BINS)
        )
    lines, plain = found["lines"], found["r-sequence"]
    pairs = [(lines.volume, plain.volume), (lines.gci, plain.gci)]
    pairs += zip(lines.region_volumes, plain.region_volumes, strict=True)
    pairs += zip(lines.quantiles, plain.quantiles, strict=True)
    for a, b in pairs:
        assert abs(a.value - b.value) <= 4.5 * math.hypot(a.error, b.error)
    assert lines.volume.error < plain.volume.error
    assert lines.reachable > plain.reachable


@pytest.mark.parametrize("least", [0.0, 0.01])
@pytest.mark.parametrize("name", OFFERED)
def test_sums_equal_a_loop(name, least):
    """Weights, indices, extremes, regions and histogram of some blocks, the last one not full."""
    settings = WorkspaceSettings(sampler="lines", min_lci=least)
    sampler = make_sampler(find(name), settings, seed=3, threads=1)
    design = sampler.design(sampler.space.mechanism.resolve({}))
    points, count = sampler.sequence(1), 2 * sweep.BLOCK + 77
    tallies = sampler.evaluator.tally([design], points, 0, count, BINS)
    poses = sampler.evaluator.points(design, points, 0, count)
    axis, parts_of = sampler.space.mechanism.line_axis, parts_in(sampler, design)
    weights = np.empty(count)
    for i, pose in enumerate(poses.T.tolist()):
        parts = [(low, high) for low, high in parts_of(pose) if high > low]
        total = sum(high - low for low, high in parts)
        weights[i] = total / design.width[axis]
        along = (pose[axis] - design.lower[axis]) * weights[i]
        for low, high in parts:
            if along < high - low:
                poses[axis, i] = low + along
                break
            along -= high - low
    margin, lci = sampler.evaluator.field(design, poses)
    within = (margin >= 0) & (weights > 0)
    kept = within & (lci >= least)
    assert kept.sum() > 20
    assert tallies.hits[0, 0] == kept.sum()
    assert tallies.within[0, 0] == pytest.approx(weights[within].sum(), rel=1e-12)
    assert tallies.reachable[0, 0] == pytest.approx(weights[kept].sum(), rel=1e-12)
    assert tallies.total[0, 0] == pytest.approx((weights * lci)[kept].sum(), rel=1e-9)
    assert tallies.smallest[0, 0] == pytest.approx(lci[kept].min(), abs=1e-9)
    assert tallies.largest[0, 0] == pytest.approx(lci[within].max(), abs=1e-9)
    wanted = [weights[kept & (lci >= edge)].sum() for edge in settings.regions[1:-1]]
    assert tallies.above[0, 0].tolist() == pytest.approx(wanted, rel=1e-9)
    bins = naive.histogram(lci[kept], weights[kept])
    assert np.abs(np.cumsum(tallies.histogram[0, 0] - bins)).max() <= 1


@pytest.mark.parametrize("name", OFFERED)
def test_errors_are_honest(name):
    """Standardised differences to a much finer run have a standard deviation of about one."""
    first = make_sampler(find(name), WorkspaceSettings(sampler="lines"), threads=1)
    design = first.design(first.space.mechanism.resolve({}))

    def measured(seed, each):
        sampler = first.with_seed(seed)
        points = sampler.sequence(16)
        return from_replicates(sampler.evaluator.tally([design], points, 0, each, BINS))

    fine = measured(99, 1 << 17)
    scores = []
    for seed in range(40):
        found = measured(seed, 1 << 9)
        scores += [(found.volume.value - fine.volume.value) / found.volume.error,
                   (found.gci.value - fine.gci.value) / found.gci.error]  # fmt: skip
    assert 0.75 < np.std(scores) < 1.35
    assert np.abs(scores).max() < 5


def test_torus_of_known_volume():
    """Two full cranks whose tori coincide: 2 pi^2 l1 l2^2 to the error, and that is small."""
    result = compute_workspace(
        find("2pauu-ppap"),
        {"m": 0.8, "n": 0.8, "l1": 1.0, "l2": 0.6},
        WorkspaceSettings(sampler="lines", samples=1 << 18, domain={"z": (-math.inf, math.inf)}),
        shape_grid=0,
    )
    exact = 2 * math.pi**2 * 0.6**2
    assert result.volume.error < 3e-5 * exact
    assert abs(result.volume.value - exact) < 4 * result.volume.error


def test_refused_where_it_is_not_offered():
    with pytest.raises(InputError, match=r"sampler=lines is not offered by 2uu-upu, allowed: r-"):
        compute_workspace(find("2uu-upu"), {}, WorkspaceSettings(sampler="lines"))
    with pytest.raises(ValueError, match="aspect and sampler = lines exclude each other"):
        WorkspaceSettings(sampler="lines", aspect="home")
