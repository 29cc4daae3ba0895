"""What a workspace is in space: the positions the platform reaches, and the floor it needs.

A workspace of poses has a volume in mixed units; papers plot the positions reached in it. Their
volume is measured on a sample of positions (:mod:`pmopt.analysis.workspace.positions`), their
pieces and voids are counted on voxels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.sampling.cells import hull, label
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.estimates import from_replicates
from pmopt.analysis.sampling.evaluator import Evaluator
from pmopt.analysis.sampling.sampler import Sampler
from pmopt.analysis.workspace.positions import measure_positions
from pmopt.analysis.workspace.shape import Shape, Topology, confirmed, measure_shape, topology_of
from pmopt.execution.threads import ordered_map
from pmopt.mechanisms.mechanism import Vector
from pmopt.numerics.elementary import power
from pmopt.numerics.matrices import dot
from pmopt.numerics.sequences import BLOCK, Sequence
from pmopt.quantity import Quantity
from pmopt.units import measure_unit

PROJECTION_SAMPLES = 1 << 20
_REPLICATES = 4
#: Points that fall into a voxel on average: fewer would leave holes by chance.
_POINTS_A_VOXEL = 24
_MOST_VOXELS = 128
#: Fewer reachable poses say nothing about the positions.
_LEAST_POSES = 8
#: The same for a picture, whose holes by chance are closed, and the empty voxels around it.
_POINTS_A_PICTURED = 6
_MARGIN = 4
#: Poses that a thread takes at once.
_BATCH = 1 << 16
#: Holes of so many voxels are taken for chance, larger ones for holes.
_MISSED = 8
#: Cells an axis for a shape that nobody has asked for.
_ROUGH = 24


@dataclass(frozen=True)
class Projection:
    """Measures in space of one workspace.

    Attributes
    ----------
    volume : Quantity
        Of the positions reached by the platform's centre, or by the tool point where there is
        one, in length_unit^3.
    lower : bool
        Whether the volume is a lower bound: with more than five pose coordinates not all poses of
        a position are searched.
    footprint : Quantity
        Area on the floor of the convex hull of all links over all reachable poses, length_unit^2.
    shape : Topology
        Pieces and voids of the positions reached, counted on the voxels.
    grid : int
        Voxels along the longest side.
    """

    volume: Quantity
    footprint: Quantity
    shape: Topology
    grid: int
    lower: bool = False


def reachable_poses(
    evaluator: Evaluator, design: Design, points: Sequence, first: int, last: int
) -> tuple[NDArray[np.float64], Vector]:
    """Return the points of the first replicate that are reachable, (d, N), and their indices."""
    poses = evaluator.points(design, points, first, last)
    margin, lci = evaluator.field(design, poses)
    kept = (margin >= 0) & (lci >= evaluator.space.settings.min_lci)
    return poses[:, kept], lci[kept]


def replicate(points: Sequence, number: int) -> Sequence:
    """Return one replicate of a sequence."""
    one = slice(number, number + 1)
    return points._replace(start=points.start[one], high=points.high[one], low=points.low[one])


def positions_are_poses(evaluator: Evaluator, design: Design) -> bool:
    """Return whether a pose is a position and nothing else, as where a platform only translates."""
    if [c.kind for c in evaluator.space.mechanism.pose] != ["length"] * 3:
        return False
    poses = design.lower[:, None] + design.width[:, None] * np.array([0.3, 0.5, 0.8, 0.9])
    poses[0] = np.roll(poses[0], 1)
    offset = evaluator.probe(design, poses).tool - poses.T
    return bool(np.ptp(offset, axis=0).max() <= 1e-12 * design.width.max())


def measure_projection(
    sampler: Sampler,
    design: Design,
    samples: int = PROJECTION_SAMPLES,
    known: tuple[Quantity, Shape] | None = None,
) -> Projection:
    """Measure the positions reached and the floor area needed.

    Where a pose is a position the positions reached are the workspace, measured as such.

    With fewer than three pose coordinates the positions have no volume.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    samples : int
        Of all replicates together.
    known : (Quantity, Shape), optional
        Volume and shape of the workspace, where they have been measured.
    """
    unit = measure_unit(["length"] * 3, sampler.space.mechanism.length_unit)
    if design.box_volume == 0:
        area = measure_unit(["length"] * 2, sampler.space.mechanism.length_unit)
        return _nothing(Quantity(math.nan, math.nan, area), unit)
    points = sampler.for_purpose(f"{sampler.purpose}, projection").sequence(_REPLICATES)
    count = max(1, samples // _REPLICATES // BLOCK) * BLOCK
    parts = [replicate(points, r) for r in range(_REPLICATES)]
    footprint = measure_footprint(sampler, design, points, count)
    if positions_are_poses(sampler.evaluator, design):
        if known is None:
            sums = sampler.evaluator.tally([design], sampler.sequence(16), 0, max(count // 4, 1))
            known = from_replicates(sums).volume, measure_shape(sampler.evaluator, design, _ROUGH)
        return Projection(known[0], footprint, known[1].workspace, known[1].grid)
    poses, places = _reachable(sampler, design, parts, count)
    if places.shape[1] < _LEAST_POSES:
        return _nothing(footprint, unit)
    found = measure_positions(sampler, design, poses, places, samples)
    joined = np.concatenate([places, found.places], axis=1).T
    lower, upper = joined.min(axis=0), joined.max(axis=0)
    sides = np.maximum(upper - lower, 1e-9 * (upper - lower).max())
    size = float(np.clip(np.prod(sides / sides.max()), 1e-6, 1.0))
    voxels = len(joined) / _POINTS_A_VOXEL
    grid = int(np.clip((voxels / size) ** (1 / 3), 3, _MOST_VOXELS))
    step = float(sides.max()) / grid
    full, rough = (occupied(joined, lower, s) for s in (step, 1.5 * step))
    uncut = np.zeros((3, 2), dtype=bool)
    shape = confirmed(topology_of(full, uncut), topology_of(rough, uncut))
    volume = found.volume.in_unit(unit, sign=">=" if found.lower else "")
    return Projection(volume, footprint, shape, grid, found.lower)


def _nothing(footprint: Quantity, unit: str) -> Projection:
    """Return the measures where positions are too few to say anything."""
    nothing = Quantity(math.nan, math.nan, unit)
    return Projection(nothing, footprint, Topology(0, (), 0, 0, 0, True), 0)


def _reachable(
    sampler: Sampler, design: Design, parts: list[Sequence], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the points of sequences that are reachable, (d, K), and their positions, (3, K)."""

    def located(work: tuple[Sequence, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        points, first = work
        poses = sampler.evaluator.points(design, points, first, min(first + _BATCH, count))
        slack, places = sampler.evaluator.locate(design, poses)
        return poses[:, slack >= 0], places[:, slack >= 0]

    work = [(part, first) for part in parts for first in range(0, count, _BATCH)]
    found = list(ordered_map(located, work, sampler.threads))
    return (np.concatenate([f[0] for f in found], axis=1),
            np.concatenate([f[1] for f in found], axis=1))  # fmt: skip


def measure_footprint(sampler: Sampler, design: Design, points: Sequence, count: int) -> Quantity:
    """Measure the floor area needed; NaN where no pose of the sample is reachable.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    points : Sequence
        Of some replicates.
    count : int
        Points of each.
    """
    parts = [replicate(points, r) for r in range(points.replicates)]
    ends = list(
        ordered_map(
            lambda part: sampler.evaluator.outline(design, part, 0, count), parts, sampler.threads
        )
    )
    unit = measure_unit(["length"] * 2, sampler.space.mechanism.length_unit)
    if not any(map(len, ends)):
        return Quantity(math.nan, math.nan, unit)
    return _footprint([hull(corners) for corners in ends], len(design.width)).in_unit(unit)


def _footprint(corners: list[NDArray[np.float64]], axes: int) -> Quantity:
    """Return the area of the hull of points from the hulls of parts of them.

    A hull of N points is too small. Where the extremes of d coordinates lie on one smooth limit,
    what is missing falls with N^(-2 / (d + 1)): what the parts together have added shows how much
    more all points would.
    """
    areas = np.array([area(c) for c in corners])
    whole = area(hull(np.concatenate(corners)))
    gained = power(len(corners), 2 / (axes + 1)) - 1
    missing = (whole - float(areas.mean())) / gained
    return Quantity(
        whole + missing, max(math.hypot(missing, float(areas.std(ddof=1))), 1e-12 * whole)
    )


def area(corners: NDArray[np.float64]) -> float:
    """Return the area of a polygon, 0 of fewer than three corners."""
    u, v = corners.T
    return abs(dot(u, np.roll(v, -1)) - dot(v, np.roll(u, -1))) / 2


@dataclass(frozen=True)
class Positions:
    """The positions reached on voxels, with an empty layer all around.

    Attributes
    ----------
    lower : (3,) float64
        Centre of the first voxel.
    step : float
    best : (nx, ny, nz) float64
        The largest LCI met in and around each voxel, NaN where nothing is reached.
    """

    lower: Vector
    step: float
    best: NDArray[np.float64]


def reached_positions(
    sampler: Sampler, design: Design, samples: int = PROJECTION_SAMPLES, most: int = 80
) -> Positions | None:
    """Return where the platform's centre, or the tool point, gets; None where it gets nowhere.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    samples : int
        Of poses; up to eight times as many where few of them are reachable.
    most : int
        Voxels along the longest side, fewer where positions are few.
    """
    points = sampler.for_purpose(f"{sampler.purpose}, positions").sequence(1)
    count = max(1, samples // BLOCK) * BLOCK
    found: list[tuple[NDArray[np.float64], Vector]] = []
    known = 0
    while known < samples // 4 and len(found) < 8:
        first = len(found) * count
        poses, lci = reachable_poses(sampler.evaluator, design, points, first, first + count)
        found.append((sampler.evaluator.probe(design, poses).tool, lci))
        known += len(lci)
        if known == 0:
            break
    places = np.concatenate([part for part, _ in found])
    lci = np.concatenate([part for _, part in found])
    if len(places) < _POINTS_A_VOXEL:
        return None
    lower, upper = places.min(axis=0), places.max(axis=0)
    side = float((upper - lower).max())
    if side == 0:
        return None
    # As fine as the positions leave it: what fills a part of its box has the more in each voxel.
    grid = 6
    for finer in range(8, most + 1, 4):
        taken = np.zeros((finer + 1,) * 3, dtype=bool)
        taken[tuple(np.floor((places - lower) * (finer / side)).astype(np.int64).T)] = True
        if len(places) < _POINTS_A_PICTURED * np.count_nonzero(taken):
            break
        grid = finer
    step = side / grid
    # Whole steps from 0 on, so that a plane through voxels' centres has a round coordinate.
    start = np.floor(lower / step + 0.5).astype(np.int64) - _MARGIN
    cells = np.floor(places / step + 0.5).astype(np.int64) - start
    best = np.full(cells.max(axis=0) + 1 + _MARGIN, -1.0)
    np.maximum.at(best, tuple(cells.T), lci)
    from scipy import ndimage

    # What chance has left out among what is reached is filled, and takes its surroundings' value.
    ball = ndimage.iterate_structure(ndimage.generate_binary_structure(3, 1), 2)
    full = ndimage.binary_closing(best >= 0, ball)
    best = np.where(best < 0, ndimage.maximum_filter(best, 3), best)
    # The largest of few values differs by chance from voxel to voxel: their mean is shown.
    known_there = (full & (best >= 0)).astype(float)
    weight = ndimage.gaussian_filter(known_there, 1.0)
    mean = ndimage.gaussian_filter(np.where(known_there > 0, best, 0.0), 1.0)
    best = np.where(full, mean / np.maximum(weight, 1e-12), np.nan)
    return Positions(start * step, step, best)


def occupied(
    places: NDArray[np.float64], lower: NDArray[np.float64], step: float
) -> NDArray[np.bool_]:
    """Return which voxels of an edge length hold places."""
    cells = np.floor((places - lower) / step).astype(np.int64)
    full = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    full[tuple(cells.T)] = True
    # A few voxels all around which the set is occupied have been missed by chance.
    labels, _ = label(np.pad(~full, 1, constant_values=True), diagonal=True)
    sizes = np.bincount(labels.ravel())
    missed = (labels > 0) & (labels != labels[0, 0, 0]) & (sizes[labels] <= _MISSED)
    return np.asarray(full | missed[1:-1, 1:-1, 1:-1])
