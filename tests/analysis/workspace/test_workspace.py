"""Volume, dexterity and shape of whole workspaces, with their error estimates."""

import importlib.util
import json
import math
import os
import re
import subprocess
import sys
import tracemalloc
from typing import NamedTuple

import numpy as np
import pytest
from support import naive

from pmopt.analysis.sampling import measuring
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import chunk_ranges
from pmopt.analysis.settings import WorkspaceSettings, split_samples
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.analysis.workspace.shape import topology_of
from pmopt.compiler import machine_code, program_text
from pmopt.errors import InputError, PmoptError
from pmopt.kernels import sweep
from pmopt.mechanisms import find
from pmopt.numerics import sequences

PAUU = find("2pauu-ppap")
# With m = n both limbs sweep one torus; above its axis lies half of 2 pi^2 l1 l2^2.
TORUS = {"m": 0.8, "n": 0.8, "l1": 1.0, "l2": 0.6, "c": 0.15}
HALF_TORUS = math.pi**2 * 1.0 * 0.6**2
SAMPLERS = ["r-sequence", "sobol", "monte-carlo"]
EVERYWHERE = {"z": (-math.inf, math.inf)}


def compute(params=None, *, seed=1, threads=1, shape_grid=0, **options):
    settings = WorkspaceSettings(**options)
    return compute_workspace(
        PAUU, params, settings, seed=seed, threads=threads, shape_grid=shape_grid
    )


def text(result):
    return json.dumps(result.to_dict(), allow_nan=False)


# --- exact volume and honest errors -------------------------------------------------------


@pytest.mark.parametrize(
    ("sampler", "relative"), [("r-sequence", 1e-3), ("sobol", 1e-3), ("monte-carlo", 5e-3)]
)
def test_volume_of_a_torus(sampler, relative):
    """Exact by Pappus: pi^2 l1 l2^2, within four stated errors, and those are small."""
    result = compute(TORUS, sampler=sampler, samples=2**18)
    assert abs(result.volume.value - HALF_TORUS) < 4 * result.volume.error
    assert result.volume.error < relative * HALF_TORUS
    assert result.samples == 2**18
    box = math.prod(high - low for low, high in result.box.values())
    assert result.volume.value == pytest.approx(box * result.reachable / 2**18, rel=1e-12)


@pytest.mark.parametrize("cells", [20, 33, 64, 101])
def test_volume_of_a_torus_on_a_grid(cells):
    result = compute(TORUS, grid=cells)
    assert result.samples == cells**3
    assert abs(result.volume.value - HALF_TORUS) < 4 * result.volume.error
    assert result.volume.error < 0.5 / cells * HALF_TORUS


def test_grid_error_covers_an_axis_aligned_limit():
    """There a grid converges with the first power of the spacing only."""
    reference = compute(TORUS, samples=2**21, limits={"d": (-0.6, 0.3123)}).volume
    for cells in (25, 40, 60):
        result = compute(TORUS, grid=cells, limits={"d": (-0.6, 0.3123)}).volume
        assert abs(result.value - reference.value) < 4 * math.hypot(result.error, reference.error)
        assert result.error < 2 / cells * reference.value


def test_monte_carlo_error_is_binomial():
    """The one sampler with an error known beforehand: box sqrt(p (1 - p) / N)."""
    result = compute(TORUS, sampler="monte-carlo", samples=2**18, replicates=64)
    box = math.prod(high - low for low, high in result.box.values())
    share = HALF_TORUS / box
    expected = box * math.sqrt(share * (1 - share) / 2**18)
    # A standard deviation of 64 values is known to 9 %.
    assert result.volume.error == pytest.approx(expected, rel=0.35)


@pytest.mark.parametrize("sampler", SAMPLERS)
@pytest.mark.slow
def test_stated_errors_are_honest(sampler):
    """Over 60 seeds deviations in units of the stated error have mean 0 and deviation 1.

    With 16 replicates they follow Student's t with 15 degrees of freedom, deviation 1.07.
    """
    reference = compute(TORUS, samples=2**22)
    deviations = {"volume": [], "gci": [], "share": []}
    for seed in range(60):
        result = compute(TORUS, sampler=sampler, samples=2**13, seed=seed, replicates=16)
        deviations["volume"].append((result.volume.value - HALF_TORUS) / result.volume.error)
        deviations["gci"].append((result.gci.value - reference.gci.value) / result.gci.error)
        mine, theirs = result.regions[1].share, reference.regions[1].share
        deviations["share"].append((mine.value - theirs.value) / mine.error)
    for name, values in deviations.items():
        assert 0.7 < np.std(values) < 1.4, name
        assert abs(np.mean(values)) < 0.5, name  # 3.9 standard errors of the mean


def test_quasi_random_points_beat_random_ones():
    errors = {s: compute(TORUS, sampler=s, samples=2**18).volume.error for s in SAMPLERS}
    assert 2 * max(errors["r-sequence"], errors["sobol"]) < errors["monte-carlo"]


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_target_error_is_reached(sampler):
    target = 2e-3 if sampler == "monte-carlo" else 5e-4
    result = compute(TORUS, sampler=sampler, target_error=target)
    assert result.volume.error <= target * result.volume.value
    assert result.gci.error <= target * result.gci.value
    assert abs(result.volume.value - HALF_TORUS) < 4 * result.volume.error
    assert result.samples & (result.samples - 1) == 0
    half = compute(TORUS, sampler=sampler, samples=result.samples // 2, replicates=32)
    assert any(e.error > target * e.value for e in (half.volume, half.gci))  # no more than needed


def test_target_error_is_not_met_by_a_near_miss():
    """With a target a tenth below the error of 2^16 samples, more are taken."""
    options = {"sampler": "monte-carlo", "replicates": 16}
    first = compute(TORUS, samples=2**16, **options)
    estimates = (first.volume, first.gci)
    target = 0.9 * max(e.error / e.value for e in estimates)
    result = compute(TORUS, target_error=target, **options)
    assert result.samples > 2**16
    assert max(e.error / e.value for e in (result.volume, result.gci)) <= target


def test_target_error_out_of_reach_is_an_error(monkeypatch):
    monkeypatch.setattr(measuring, "MAX_SAMPLES", 2**20)
    with pytest.raises(PmoptError, match=r"target error 1e-07 not reached with 1048576 samples"):
        compute(TORUS, target_error=1e-7)


@pytest.mark.parametrize(
    ("sampler", "replicates"),
    [
        ("r-sequence", 5),
        ("monte-carlo", 7),
        ("sobol", 8),
        ("sobol", 5),
    ],
)
def test_doubling_continues_the_sequence(sampler, replicates):
    """Samples added until a target is met are the ones a single run would take."""
    doubled = compute(TORUS, sampler=sampler, replicates=replicates, target_error=3e-3)
    each = doubled.samples // replicates
    assert each & (each - 1) == 0
    assert each > 512  # more than the first blocks, which are made again
    direct = compute(TORUS, sampler=sampler, replicates=replicates, samples=doubled.samples)
    assert doubled.reachable == direct.reachable
    assert doubled.histogram == direct.histogram
    assert doubled.gci.value == pytest.approx(direct.gci.value, rel=1e-12)


# --- the same for any number of threads, in constant memory -------------------------------


@pytest.mark.parametrize(
    "options",
    [
        {"samples": 3 * 2**18 + 48},
        {"samples": 2**20, "sampler": "sobol", "norm": "fro"},
        {"samples": 2**20, "sampler": "monte-carlo", "min_lci": 0.1},
        {"grid": 90},
        {"target_error": 1e-3, "limits": {"theta1": (-3.0, 2.5)}},
    ],
)
def test_result_does_not_depend_on_threads(options):
    """Byte for byte; several chunks each, so that an order of addition could show."""
    runs = [text(compute(threads=threads, **options)) for threads in (1, 2, 3)]
    assert runs[0] == runs[1] == runs[2]


def test_shape_does_not_depend_on_threads():
    runs = [text(compute(samples=2**14, shape_grid=40, threads=t)) for t in (1, 3)]
    assert runs[0] == runs[1]


def test_seed_and_samples_are_all_that_matters():
    first = compute(samples=2**16, seed=5)
    assert text(compute(samples=2**16, seed=5)) == text(first)
    assert compute(samples=2**16, seed=6).volume.value != first.volume.value


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.slow
def test_memory_does_not_grow_with_samples(threads):
    def peak(samples):
        tracemalloc.start()
        compute(samples=samples, threads=threads)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(2**20)  # whatever is loaded on first use
    # One chunk's tallies kept would be 130 kB, of 76 chunks 10 MB. Both are more than a block.
    assert peak(30_000_000) < 1.3 * peak(10_000_000) + 500_000


@pytest.mark.parametrize(("first", "last"), [(0, 1), (0, 10**6), (32768, 10**6 + 1)])
@pytest.mark.parametrize("replicates", [1, 16, 31])
def test_chunks_are_whole_blocks_and_leave_nothing_out(first, last, replicates):
    ranges = list(chunk_ranges(first, last, replicates))
    assert ranges[0][0] == first
    assert ranges[-1][1] == last
    for (_, stop), (start, _) in zip(ranges, ranges[1:], strict=False):
        assert stop == start
        assert start % sequences.BLOCK == 0
    assert all(start < stop for start, stop in ranges)
    assert max(stop - start for start, stop in ranges) * replicates <= 2**18


@pytest.mark.parametrize("samples", [16, 17, 1000, 4096, 10**6, 3 * 2**18 + 48])
def test_samples_are_what_was_asked_for(samples):
    replicates, each = split_samples(samples, None)
    assert replicates * each == samples
    assert 8 <= replicates <= 32
    assert all(samples % r for r in range(8, 33) if abs(r - 16) < abs(replicates - 16))
    assert compute(samples=samples).samples == samples
    assert split_samples(samples, 5) == (5, math.ceil(samples / 5))


# --- numbers of a result against a naive loop ---------------------------------------------

# Default design with everything set that changes which poses count.
BOUNDED = {
    "limits": {"theta1": (-2.6, 0.4), "theta2": (-9.4, -5.4), "d": (-0.8, 1.1)},
    "domain": {"x": (-0.9, 1.0), "z": (0.5, math.inf)},
}
NAIVE_CASES = [
    ({}, {}),
    ({}, {"working_mode": "in-out", "norm": "fro"}),
    ({}, {"jacobian": "homogenized", "sampler": "sobol"}),
    ({}, {"characteristic_length": 0.3, "working_mode": "in-in"}),
    ({}, {"min_lci": 0.25, "sampler": "monte-carlo", "domain": EVERYWHERE}),
    ({"h": 1.4}, {**BOUNDED, "working_mode": "in-out"}),
    ({"l1": 1.2, "l2": 0.7, "c": 0}, {"working_mode": "out-in", "regions": (0, 0.2, 0.4, 0.5, 1)}),
]


def naive_workspace(params, result, settings):
    """Return the indices of the poses that count, and the number of all poses."""
    lower = np.array([low for low, _ in result.box.values()])
    width = np.array([high for _, high in result.box.values()]) - lower
    length = 1.0
    if settings.characteristic_length:
        length = settings.characteristic_length
    elif settings.jacobian == "homogenized":
        length = params["l1"]
    points = make_sampler(PAUU, settings).sequence(result.replicates)
    each = result.samples // result.replicates
    indices = []
    for replicate in range(result.replicates):
        for row in naive.fill(points, replicate, 0, each, lower, width).T.tolist():
            pose = dict(zip("xyz", row, strict=True))
            joints = naive.inverse(params, pose).get(result.working_mode)
            if joints is None or not naive.keeps_limits(params, pose, joints, settings.limits):
                continue
            index = naive.dexterity(params, pose, joints, settings.norm, length)
            if index >= settings.min_lci:
                indices.append(index)
    return np.array(indices), each * result.replicates


@pytest.mark.parametrize(("given", "options"), NAIVE_CASES)
def test_result_equals_trigonometry_and_singular_values(given, options):
    """Every number of a workspace from the mechanism's geometry, pose by pose.

    The same sample points, but inverse kinematics by the law of cosines, J from u.e and limits,
    domain and index by their definitions.
    """
    settings = WorkspaceSettings(samples=8 * 750, replicates=8, **options)
    params = PAUU.resolve(given)
    result = compute_workspace(PAUU, given, settings, threads=1, shape_grid=0)
    indices, count = naive_workspace(params, result, settings)
    assert len(indices) > 100
    assert result.reachable == len(indices)
    assert result.samples == count
    box = math.prod(high - low for low, high in result.box.values())
    assert result.volume.value == pytest.approx(box * len(indices) / count, rel=1e-12)
    # The stated accuracy of the closed form, 3e-8, and a hundredth near isotropy.
    assert result.gci.value == pytest.approx(indices.mean(), abs=1e-9)
    # The extremes are sharpened: nothing of the sample is beyond them.
    assert result.smallest.value <= indices.min() + 3e-8
    assert result.largest.value >= indices.max() - 3e-8
    low, high = result.regions[0].lower, result.regions[-1].upper
    assert (low, high) == (0, 1)
    for region in result.regions:
        inside = (indices >= region.lower) & (indices < region.upper)
        assert region.share.value == pytest.approx(inside.mean(), rel=1e-12)
        assert region.volume.value == pytest.approx(box * inside.sum() / count, rel=1e-12)
    wanted = np.quantile(indices, [0.05, 0.5, 0.95], method="inverted_cdf")
    # Quantiles are interpolated within bins of 1/128 of an octave.
    np.testing.assert_allclose([q.value for q in result.quantiles], wanted, rtol=1 / 128)
    histogram = naive.histogram(indices)
    assert np.abs(np.cumsum(np.array(result.histogram) - histogram)).max() <= 1


@pytest.mark.parametrize("options", [options for _, options in NAIVE_CASES])
def test_numbers_are_ordered_and_add_up(options):
    result = compute(samples=2**16, **options)
    told = result.to_dict()
    lci = told["lci"]
    quantiles = [lci["quantiles"][q] for q in ("0.05", "0.5", "0.95")]
    assert list(lci["quantiles"]) == ["0.05", "0.5", "0.95"]
    assert 0 <= lci["min"] <= quantiles[0] < quantiles[1] < quantiles[2] <= lci["max"] <= 1
    assert lci["min"] >= options.get("min_lci", 0)
    assert lci["mean"] == told["gci"]["value"]
    regions = told["regions"]
    assert sum(r["share"] for r in regions) == pytest.approx(1, abs=1e-12)
    assert sum(r["volume"] for r in regions) == pytest.approx(told["volume"]["value"], rel=1e-12)
    assert [r["upper"] for r in regions[:-1]] == [r["lower"] for r in regions[1:]]
    assert sum(result.histogram) == result.reachable == told["reachable"]
    estimates = [*result.quantiles, *(r.share for r in result.regions)]
    for estimate in (result.volume, result.gci, *estimates):
        assert 0 < estimate.error < 0.1 * max(result.volume.value, 1)


def test_both_halves_of_the_torus():
    """The default domain z >= 2c holds half of it; z unbounded, all."""
    half, whole = (compute(TORUS, samples=2**18, **o) for o in ({}, {"domain": EVERYWHERE}))
    assert half.box["z"][0] == 2 * TORUS["c"]
    assert whole.box["z"] == pytest.approx((0.3 - 1.6, 0.3 + 1.6))
    assert abs(half.volume.value - HALF_TORUS) < 4 * half.volume.error
    assert abs(whole.volume.value - 2 * HALF_TORUS) < 4 * whole.volume.error
    # The mechanism is the same upside down with inner and outer knees exchanged; LCI is even in y.
    mirrored = compute(TORUS, samples=2**18, domain={"z": (-math.inf, 0.3)}, working_mode="in-in")
    assert mirrored.gci.value == pytest.approx(half.gci.value, abs=5 * half.gci.error)


def test_slices_of_a_domain_add_up():
    whole = compute(samples=2**18)
    parts = [
        compute(samples=2**18, domain={"y": ends})
        for ends in ((-math.inf, -0.5), (-0.5, 0.7), (0.7, math.inf))
    ]
    errors = math.hypot(whole.volume.error, *(p.volume.error for p in parts))
    assert abs(sum(p.volume.value for p in parts) - whole.volume.value) < 4 * errors


def test_limits_and_h_only_take_away():
    """Joint limits, h and min_lci: a wide one changes nothing, a narrow one does."""
    # Same box, hence the same points: the reachable ones can be counted against each other.
    free = compute(samples=2**16)
    wide = {"theta1": (-math.pi, math.pi), "theta2": (-20.0, 20.0)}
    assert compute(samples=2**16, limits=wide).reachable == free.reachable
    narrow = [
        compute(samples=2**16, limits={"theta1": (-1.0, 0.5)}),
        compute(samples=2**16, limits={"theta2": (-1.0, 0.5)}),
        compute(samples=2**16, limits={"theta1": (-1.0, 0.5), "theta2": (-1.0, 0.5)}),
    ]
    assert 0 < narrow[2].reachable < narrow[0].reachable < free.reachable
    assert narrow[2].reachable < narrow[1].reachable
    low, high = compute({"h": 1.0}, samples=2**16), compute({"h": 50.0}, samples=2**16)
    assert high.reachable == free.reachable
    assert low.box["z"][1] == 1.0
    assert 0.2 < low.volume.value / free.volume.value < 0.9
    assert compute(samples=2**16, domain={"z": (0.2, 1.0)}).volume.value == low.volume.value


def test_min_lci_keeps_what_is_above():
    """The same as cutting the regions there."""
    free = compute(samples=2**16, regions=(0, 0.25, 1))
    kept = compute(samples=2**16, regions=(0, 0.25, 1), min_lci=0.25)
    assert kept.volume.value == free.regions[1].volume.value
    assert kept.regions[0].volume.value == 0
    assert kept.regions[1].share.value == 1
    assert kept.smallest.value >= 0.25
    assert kept.largest == free.largest


def test_homogenised_index_does_not_depend_on_the_unit_of_length():
    """All lengths in millimetres: homogenised the same index, raw another."""
    small, large = TORUS, {k: 1000 * v for k, v in TORUS.items()}
    same = [compute(p, samples=2**14, jacobian="homogenized") for p in (small, large)]
    assert same[1].gci.value == pytest.approx(same[0].gci.value, rel=1e-9)
    assert same[0].characteristic_length == 1.0
    assert same[1].characteristic_length == 1000.0
    assert same[1].reachable == same[0].reachable
    raw = [compute(p, samples=2**14) for p in (small, large)]
    assert raw[1].gci.value < 0.1 * raw[0].gci.value
    assert raw[0].characteristic_length is None
    assert "mixes units" in raw[0].index_note
    # With l1 = 1 m the crank columns are divided by 1: raw and homogenised agree.
    assert raw[0].gci.value == pytest.approx(same[0].gci.value, rel=1e-12)
    assert "1000.0 m" in same[1].index_note
    given = compute(TORUS, samples=2**14, characteristic_length=0.5)
    assert given.jacobian == "homogenized"
    assert given.gci.value != pytest.approx(same[0].gci.value, rel=1e-2)


def test_frobenius_index_lies_between_a_third_and_all_of_the_other():
    """|A|_2 <= |A|_F <= sqrt(3) |A|_2, for J and its inverse; a third only at isotropy."""
    two, fro = compute(samples=2**14), compute(samples=2**14, norm="fro")
    assert (two.norm, fro.norm) == ("2", "fro")
    assert two.gci.value / 3 < fro.gci.value < two.gci.value
    assert two.largest.value / 3 < fro.largest.value < 1 / 3
    assert fro.volume.value == two.volume.value


def test_all_numbers_have_units():
    told = compute(samples=2**10, shape_grid=8).to_dict()
    units = told["units"]
    for group in (told["params"], told["domain"]):
        assert set(group) <= set(units)
    assert told["volume"]["unit"] == units["volume"] == "m^3"
    assert units["theta1"] == "rad"
    assert units["gci"] == units["lci"] == units["share"] == "1"


# --- empty workspaces ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "options"),
    [
        ({"m": 1.5, "n": 0.2, "l1": 0.5, "l2": 0.5}, {}),  # limbs out of each other's reach
        ({"l1": 0.2, "l2": 1e-6}, {}),  # links too short to span the platform
        ({}, {"domain": {"x": (5.0, math.inf)}}),
        ({}, {"domain": {"z": (3.0, 4.0)}}),
        ({}, {"domain": {"x": (-0.02, 0.02), "z": (0.2, 0.25), "y": (-0.1, 0.1)}}),  # the cavity
        ({"h": 0.15}, {}),  # lower than the pivots, where the default domain begins
        ({}, {"limits": {"d": (2.0, 3.0)}}),
        ({}, {"min_lci": 0.9}),
        # No height is left between domain and h, though the corner of the box is in reach.
        ({"h": 1.4}, {"domain": {"x": (0.1, 0.2), "y": (0, 0.1), "z": (1.4, 2.0)}}),
        # About (0, 0, 1.25) the cranks stand at -0.1 to 0.4 rad.
        (
            {},
            {
                "domain": {"x": (-0.1, 0.1), "y": (-0.2, 0.2), "z": (1.2, 1.3)},
                "limits": {"theta1": (1, 2)},
            },
        ),
    ],
)
@pytest.mark.parametrize("how", [{"samples": 4096}, {"grid": 12}, {"target_error": 0.01}])
def test_empty_workspace(given, options, how):
    """Volume 0, no index, no NaN: an answer, not an error."""
    result = compute(given, shape_grid=8, **options, **how)
    told = json.loads(text(result))
    assert told["volume"]["value"] == 0
    assert told["reachable"] == 0
    error = "error_bound" if "grid" in how else "standard_error"
    assert told["gci"] == {"value": None, error: None}
    assert told["lci"]["min"] is told["lci"]["max"] is told["lci"]["quantiles"]["0.5"] is None
    assert [r["volume"] for r in told["regions"]] == [0, 0, 0]
    assert [r["share"] for r in told["regions"]] == [None] * 3
    assert told["shape"]["workspace"]["pieces"] == 0
    assert sum(result.histogram) == 0


def test_hardly_a_point_is_no_error_either():
    """One reachable point: leaving its replicate out leaves nothing to take a mean of."""
    counts = set()
    for seed in range(40):
        result = compute(TORUS, samples=16, seed=seed, sampler="monte-carlo")
        assert (result.gci.value >= 0) == (result.reachable > 0)
        json.loads(text(result))
        counts.add(result.reachable)
    few = [compute(samples=16, seed=s, sampler="monte-carlo", min_lci=0.5) for s in range(40)]
    assert {0, 1} <= {r.reachable for r in few}
    assert all(text(r) for r in few)


@pytest.mark.parametrize("name", ["d", "theta1"])
def test_open_limits_can_be_written(name):
    text(compute(samples=1024, limits={name: (-math.inf, math.inf)}))


# --- settings -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"limits": {"theta3": (0, 1)}}, "workspace: limits: unknown name 'theta3'"),
        ({"domain": {"d": (0, 1)}}, "workspace: domain: d is an actuated joint"),
        ({"working_mode": "out"}, "workspace: working_mode: unknown name 'out'"),
    ],
)
def test_names_the_mechanism_does_not_have(options, message):
    with pytest.raises(InputError, match=re.escape(message)):
        compute(samples=1024, **options)


# --- shape --------------------------------------------------------------------------------


def test_full_torus_is_one_piece():
    """Its hole runs through, so it encloses nothing."""
    shape = compute(TORUS, samples=1024, shape_grid=48, domain=EVERYWHERE).shape
    assert (shape.workspace.pieces, shape.workspace.voids) == (1, 0)
    assert shape.workspace.piece_shares == (1.0,)
    assert shape.workspace.confirmed
    assert shape.grid == 48


def test_hole_of_a_torus_is_no_pocket():
    """No boundary of the domain closes it: reach ends there by itself."""
    shape = compute(TORUS, samples=1024, shape_grid=48, domain=EVERYWHERE).shape
    assert shape.workspace.pockets == 0


def test_spindle_torus_has_a_cavity():
    """With l2 > l1 the links cannot fold onto the axis: the lens there is out of reach.

    Enclosed in the whole, open to the floor in the half of the default domain.
    """
    spindle = {**TORUS, "l1": 0.5, "l2": 1.0}
    whole = compute(spindle, samples=1024, shape_grid=48, domain=EVERYWHERE).shape.workspace
    assert (whole.pieces, whole.voids, whole.pockets) == (1, 1, 0)
    half = compute(spindle, samples=1024, shape_grid=48).shape.workspace
    assert (half.pieces, half.voids, half.pockets) == (1, 0, 1)


def test_two_pieces_of_a_workspace():
    """A slab about the height of the torus's axis holds a cut through either side of it."""
    slab = compute(TORUS, samples=1024, shape_grid=48, domain={"z": (0.2, 0.4)}).shape.workspace
    assert slab.pieces == 2
    assert slab.piece_shares == pytest.approx((0.5, 0.5), abs=0.02)


def test_regions_nest_like_dolls():
    """Dexterity rises from 0 at the boundary to two cores: each region holds the next ones."""
    shape = compute(TORUS, samples=1024, shape_grid=96, domain=EVERYWHERE).shape
    assert [r.pieces for r in shape.regions] == [1, 2, 2]
    assert [r.voids for r in shape.regions] == [2, 2, 0]
    assert all(sum(r.piece_shares) == pytest.approx(1, abs=1e-3) for r in shape.regions)


def ball(radius, centre=(0.0, 0.0, 0.0), cells=40):
    axis = (np.arange(cells) + 0.5) / cells * 2 - 1
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    cx, cy, cz = centre
    return (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2 < radius**2


WHOLE = np.zeros((3, 2), dtype=bool)  # no face of the box cuts off what could be reached


def counts(members, cut=WHOLE):
    topology = topology_of(members, cut)
    return topology.pieces, topology.voids, topology.pockets, topology.specks


def testtopology_of_of_balls():
    large, small = ball(0.4, (-0.5, -0.5, -0.5)), ball(0.3, (0.5, 0.5, 0.5))
    assert counts(large) == (1, 0, 0, 0)
    assert counts(large | small) == (2, 0, 0, 0)
    sizes = np.array([large.sum(), small.sum()])
    assert topology_of(small | large, WHOLE).piece_shares == pytest.approx(sizes / sizes.sum())


def testtopology_of_of_holes():
    hollow = ball(0.8) & ~ball(0.5)
    assert counts(hollow) == (1, 1, 0, 0)
    assert counts(hollow | ball(0.2)) == (2, 1, 0, 0)
    drilled = hollow.copy()
    drilled[18:22, 18:22, 20:] = False
    assert counts(drilled) == (1, 0, 0, 0)
    two = ball(0.9) & ~ball(0.3, (0.4, 0, 0)) & ~ball(0.3, (-0.4, 0, 0))
    assert counts(two) == (1, 2, 0, 0)


def testtopology_of_of_a_bowl():
    """A hollow ball cut in half: its hole opens to the face of the domain only."""
    hollow = ball(0.8) & ~ball(0.5)
    floor, side = WHOLE.copy(), WHOLE.copy()
    floor[2, 0] = side[0, 0] = True
    assert counts(hollow[:, :, 20:], floor) == (1, 0, 1, 0)
    assert counts(hollow[20:], side) == (1, 0, 1, 0)
    assert counts(hollow[:, :, 20:]) == (1, 0, 0, 0)  # a face where reach ends is open
    full = ball(0.8)
    assert counts(full[:, :, 20:], floor) == (1, 0, 0, 0)


def testtopology_of_of_specks():
    """Less than 0.1 % of the cells, or eight: too small for the grid to tell."""
    members = ball(0.9)
    members[0, 0, 0] = True
    members[20, 20, 20] = False
    members[0, :3, 30] = True
    assert counts(members) == (1, 0, 0, 3)
    few = np.zeros((9, 9, 9), dtype=bool)
    few[:4, :4, :4] = few[8, 8, :7] = True
    assert counts(few) == (1, 0, 0, 1)
    few[8, 7, 0] = True
    assert counts(few) == (2, 0, 0, 0)
    nothing = np.zeros((6, 6, 6), dtype=bool)
    assert counts(nothing) == (0, 0, 0, 0)
    assert counts(~nothing) == (1, 0, 0, 0)


def testtopology_of_joins_by_faces():
    """Pieces share faces; holes leak through edges and corners."""
    members = np.zeros((12, 12, 12), dtype=bool)
    members[1:5, 1:5, 1:5] = True
    members[5:9, 5:9, 1:5] = True
    assert counts(members) == (2, 0, 0, 0)
    shell = np.zeros((12, 12, 12), dtype=bool)
    shell[2:10, 2:10, 2:10] = True
    shell[3:9, 3:9, 3:9] = False
    assert counts(shell) == (1, 1, 0, 0)
    shell[2, 2, 2] = False
    assert counts(shell) == (1, 0, 0, 0)


# --- compiled kernels ---------------------------------------------------------------------

KERNEL = """
import math

FACTOR = {factor}
TINY = {tiny}


def widen(value):
    return FACTOR * value + TINY


def kernel(x, y, z, constants):
    (radius,) = constants
    square = radius * radius - x * x - y * y - z * z
    return (square, widen(1.0), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
"""


def still(x, y, z, constants):
    return (0.0,) * 12


class One(NamedTuple):
    """Constants of which there is one."""

    one: float


def recipe(kernel, norm="2", constants=One):
    """Return what a kernel of three coordinates is specialised to, without a skeleton."""
    return program_text.Recipe(kernel, still, 3, constants, 3, norm, (), (), 0)


def folders_of(module):
    """Return the folders of all that a sweep is made of."""
    return frozenset(c.folder for name in program_text.ENTRIES for c, _ in module.parts(name))


def load_kernel(path, factor=1.0, tiny=1e-300):
    """Return the kernel of a module of its own whose helper depends on constants."""
    path.write_text(KERNEL.format(factor=factor, tiny=tiny))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.kernel


def test_edits_anywhere_change_the_folder(tmp_path, monkeypatch):
    """A constant of a helper, the norm, a shared function: none leaves the machine code's key."""

    def digest(kernel, norm="2"):
        monkeypatch.setattr(program_text, "_loaded", {})
        return folders_of(program_text.specialise(recipe(kernel, norm)))

    (tmp_path / "elsewhere").mkdir()
    base = load_kernel(tmp_path / "one.py")
    assert digest(load_kernel(tmp_path / "elsewhere" / "one.py")) == digest(base)
    other = digest(load_kernel(tmp_path / "three.py", factor=2.0))
    digests = {digest(base), other, digest(base, "fro")}
    monkeypatch.setattr(program_text.conditioning, "C7", 1.25)
    digests.add(digest(base))
    monkeypatch.setattr(program_text.sweep, "TWO_POW_M52", 0.5)
    digests.add(digest(base))
    assert len(digests) == 5


def test_text_stands_alone():
    """The specialised module imports nothing of the package."""
    for norm in ("2", "fro"):
        module = program_text.module_text(recipe(PAUU.kernel, norm, PAUU.constants))
        compile(module, "specialised", "exec")
        assert "pmopt" not in re.sub(r":mod:`[^`]*`|:class:`[^`]*`", "", module)
        assert f"inverse_condition_{norm}(" in module


def test_constants_of_one_name_do_not_mix(tmp_path):
    """A kernel's TINY must not become that of the conditioning, nor the other way round."""
    text = program_text.module_text(recipe(load_kernel(tmp_path / "clash.py", tiny=0.5)))
    assert "\nTINY__clash = 0.5\n" in text
    assert "return FACTOR__clash * value + TINY__clash\n" in text
    assert re.search(r"^TINY = 1e-", text, re.MULTILINE)


def field_of(module, poses, constants):
    """Return margins and indices at poses, with scratch space for the kernels of these tests."""
    margin, lci = np.empty(poses.shape[1]), np.empty(poses.shape[1])
    rows = recipe(still).scratch_rows
    module.field(poses, np.array(constants), margin, lci, np.empty((rows, sweep.PITCH)))
    return margin, lci


@pytest.mark.slow
def test_edited_kernel_is_recompiled(tmp_path, empty_cache):
    """New text, new folder, new numbers: machine code cannot go stale."""
    folders, values = [], []
    for factor in (2.0, 4.0):
        kernel = load_kernel(tmp_path / "kernel.py", factor)
        told = []
        module = program_text.specialise(recipe(kernel), lambda: told.append(1))  # noqa: B023
        margin, lci = field_of(module, np.zeros((3, 1)), [0.5])
        assert told == [1]
        assert program_text.specialise(recipe(kernel)) is module
        assert margin[0] == 0.25
        folders.append(folders_of(module))
        values.append(lci[0])
    assert values == pytest.approx([1 / 2, 1 / 4])
    assert folders[0] != folders[1]
    assert all(folder.parent == empty_cache for made in folders for folder in made)


@pytest.mark.slow
def test_kept_machine_code_needs_no_numba(tmp_path):
    """A second process takes what the first one kept, to the same numbers.

    Neither imports numba: the first one has had it compiled by a process of its own.
    """
    code = (
        "import sys, pmopt\n"
        "print(pmopt.workspace('2pauu-ppap', samples=4096, shape_grid=0).volume)\n"
        "print('numba' in sys.modules)"
    )
    environment = {**os.environ, "PMOPT_CACHE_DIR": str(tmp_path)}
    first, second = (
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True,
                       text=True, check=True).stdout.splitlines()
        for _ in range(2)
    )  # fmt: skip
    assert first[0] == second[0]
    assert list(tmp_path.glob("*/sweep.o"))
    assert (first[1], second[1]) == ("False", "False")


def test_entries_check_their_arrays(tmp_path, empty_cache):
    """What machine code cannot check is checked before: type, rank, order, fixed lengths."""
    module = program_text.specialise(recipe(load_kernel(tmp_path / "kernel.py")))
    scratch = np.empty((recipe(still).scratch_rows, sweep.PITCH))
    good = [np.zeros((3, 4)), np.array([0.5]), np.empty(4), np.empty(4), scratch]
    module.field(*good)
    for place, bad in (
        (0, np.zeros((4, 3)).T), (0, np.zeros(12)), (1, np.array([1])), (4, scratch[1:]),
    ):  # fmt: skip
        with pytest.raises(TypeError, match="field: a C-contiguous"):
            module.field(*good[:place], bad, *good[place + 1 :])


@pytest.mark.slow
def test_unwritable_cache_costs_time_only(empty_cache, monkeypatch):
    """A cache folder that cannot be made, here below a file: the numbers are the same."""
    blocked = empty_cache / "file"
    blocked.write_text("no folder")
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(blocked / "cache"))
    there = text(compute(samples=2**12))
    monkeypatch.undo()
    assert text(compute(samples=2**12)) == there
    assert blocked.read_text() == "no folder"
    assert machine_code.cache_root() != blocked / "cache"
