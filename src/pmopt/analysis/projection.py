"""What a workspace is in space: the positions the platform reaches, and the floor it needs.

A workspace of poses has a volume in mixed units; papers plot the positions reached in it. Their
volume is counted on voxels that reachable sample poses fall into, those with a free neighbour half.
How many voxels at the boundary are met depends on how thin the sample is there; parts of the sample
on wider voxels tell how the count changes with the voxels' size, and it is extrapolated to none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.estimates import Estimate
from pmopt.analysis.shape import Topology, confirmed, topology_of
from pmopt.analysis.sweeper import Design, Sweeper
from pmopt.mechanisms.base import Vector
from pmopt.numerics.sequences import BLOCK, Sequence

PROJECTION_SAMPLES = 1 << 20
_REPLICATES = 4
#: Points that fall into a voxel on average: fewer would leave holes by chance.
_POINTS_A_VOXEL = 24
_MOST_VOXELS = 128
#: Steps by which grids of voxels are shifted against each other, as a share of a voxel.
_SHIFT = np.array([0.25, 0.5, 0.75])
#: Holes of so many voxels are taken for chance, larger ones for holes.
_MISSED = 8


@dataclass(frozen=True)
class Projection:
    """Measures in space of one workspace.

    Attributes
    ----------
    volume : Estimate
        Of the positions reached by the platform's centre, or by the tool point where there is
        one, in length_unit^3.
    footprint : Estimate
        Area on the floor of the convex hull of all links over all reachable poses, length_unit^2.
    shape : Topology
        Pieces and voids of the positions reached, counted on the voxels.
    grid : int
        Voxels along the longest side.
    lower, upper : tuple of float
        Box around the positions; empty where nothing is reachable.
    """

    volume: Estimate
    footprint: Estimate
    shape: Topology
    grid: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]


def reachable_poses(
    sweeper: Sweeper, design: Design, points: Sequence, first: int, last: int
) -> tuple[NDArray[np.float64], Vector]:
    """Return the points of the first replicate that are reachable, (d, N), and their indices."""
    poses = sweeper.points(design, points, first, last)
    margin, lci = sweeper.field(design, poses)
    kept = (margin >= 0) & (lci >= sweeper.settings.min_lci)
    return poses[:, kept], lci[kept]


def replicate(points: Sequence, number: int) -> Sequence:
    """Return one replicate of a sequence."""
    one = slice(number, number + 1)
    return points._replace(start=points.start[one], high=points.high[one], low=points.low[one])


def measure_projection(
    sweeper: Sweeper, design: Design, samples: int = PROJECTION_SAMPLES
) -> Projection:
    """Measure the positions reached and the floor area needed.

    The error combines the spread of replicates and of the grid's places, half of what the
    extrapolation to voxels of no size adds, and half the difference between two ways to tell a
    boundary voxel. Against seven volumes known otherwise, 3 seeds each, from 4,096 to 4 million
    samples, no volume was further off than 1.4 times its error.

    Parameters
    ----------
    sweeper : Sweeper
    design : Design
    samples : int
        Of all replicates together.
    """
    nothing = Estimate(math.nan, math.nan)
    if design.box_volume == 0:
        return Projection(nothing, nothing, Topology(0, (), 0, 0, 0, True), 0, (), ())
    points = sweeper.for_purpose(f"{sweeper.purpose}, projection").sequence(_REPLICATES)
    count = max(1, samples // _REPLICATES // BLOCK) * BLOCK
    floor = [k for k in range(3) if k != sweeper.mechanism.vertical]
    places, corners = [], []
    for r in range(_REPLICATES):
        poses, _ = reachable_poses(sweeper, design, replicate(points, r), 0, count)
        facts = sweeper.probe(design, poses)
        places.append(facts.tool)
        ends = facts.segments.reshape(-1, 3)[:, floor]
        corners.append(ends[_extreme(ends)])
    joined = np.concatenate(places)
    if len(joined) < 8:
        return Projection(nothing, nothing, Topology(0, (), 0, 0, 0, True), 0, (), ())
    lower, upper = joined.min(axis=0), joined.max(axis=0)
    sides = np.maximum(upper - lower, 1e-9 * (upper - lower).max())
    voxels = len(joined) / _POINTS_A_VOXEL
    size = float(np.clip(np.prod(sides / sides.max()), 1e-6, 1.0))
    grid = int(np.clip((voxels / size) ** (1 / 3), 3, _MOST_VOXELS))
    step = float(sides.max()) / grid
    # Where the grid of voxels begins changes the count: some places are averaged over.
    shifts = (np.arange(_REPLICATES)[:, None] * _SHIFT) % 1.0
    grids = [occupied(joined, lower - shift * step, step) for shift in shifts]
    counts = np.array([_half_edged(full, step) for full in grids])
    fine = float(counts.mean())
    tight = float(np.mean([_half_edged(full, step, corners=True) for full in grids]))
    # Parts of the sample on voxels as many points wide: what is lost and gained at the boundary
    # falls with the size of the voxels, to which the volume is extrapolated.
    growth = _REPLICATES ** (1 / 3) - 1
    wide = step * (1 + growth)
    parts = np.array([
        np.mean([_half_edged(occupied(p, lower - shift * wide, wide), wide) for shift in shifts])
        for p in places
    ])  # fmt: skip
    change = (fine - float(parts.mean())) / growth
    statistical = float(parts.std(ddof=1)) / math.sqrt(_REPLICATES) / growth
    placed = float(counts.std(ddof=1)) / math.sqrt(_REPLICATES) * (1 + 1 / growth)
    volume = Estimate(
        max(fine + change, tight / 2),
        math.hypot(change / 2, (fine - tight) / 2, statistical, placed, fine / math.sqrt(voxels)),
    )
    full, rough = grids[0], occupied(joined, lower, 1.5 * step)
    uncut = np.zeros((3, 2), dtype=bool)
    shape = confirmed(topology_of(full, uncut), topology_of(rough, uncut))
    areas = np.array([_hull_area(c) for c in corners])
    whole = _hull_area(np.concatenate(corners))
    # A hull of points is too small: what four times the points have added, they will add again.
    missing = whole - float(areas.mean())
    footprint = Estimate(
        whole + missing, max(math.hypot(missing, float(areas.std(ddof=1))), 1e-12 * whole)
    )
    return Projection(
        volume, footprint, shape, grid,
        tuple(lower.tolist()), tuple(upper.tolist()),
    )  # fmt: skip


@dataclass(frozen=True)
class Positions:
    """The positions reached on voxels: ``best`` is the largest LCI met in each, NaN in none."""

    lower: Vector
    step: float
    best: NDArray[np.float64]


def reached_positions(
    sweeper: Sweeper, design: Design, samples: int = PROJECTION_SAMPLES, most: int = 44
) -> Positions | None:
    """Return where the platform's centre, or the tool point, gets; None where it gets nowhere.

    Parameters
    ----------
    sweeper : Sweeper
    design : Design
    samples : int
    most : int
        Voxels along the longest side, fewer where samples are few.
    """
    points = sweeper.for_purpose(f"{sweeper.purpose}, positions").sequence(1)
    poses, lci = reachable_poses(sweeper, design, points, 0, max(1, samples // BLOCK) * BLOCK)
    places = sweeper.probe(design, poses).tool
    if len(places) < _POINTS_A_VOXEL:
        return None
    lower, upper = places.min(axis=0), places.max(axis=0)
    grid = int(np.clip((len(places) / _POINTS_A_VOXEL) ** (1 / 3) * 1.5, 6, most))
    step = float((upper - lower).max()) / grid
    if step == 0:
        return None
    cells = np.floor((places - lower) / step).astype(np.int64)
    best = np.full(cells.max(axis=0) + 1, -1.0)
    np.maximum.at(best, tuple(cells.T), lci)
    # A hole of few voxels is one by chance: it takes its surroundings' value.
    from scipy import ndimage

    full = occupied(places, lower, step)
    around = ndimage.maximum_filter(best, 3)
    best = np.where(best < 0, np.where(full, around, np.nan), best)
    return Positions(lower, step, best)


def occupied(
    places: NDArray[np.float64], lower: NDArray[np.float64], step: float
) -> NDArray[np.bool_]:
    """Return which voxels of an edge length hold places."""
    from scipy import ndimage

    cells = np.floor((places - lower) / step).astype(np.int64)
    full = np.zeros(cells.max(axis=0) + 1, dtype=bool)
    full[tuple(cells.T)] = True
    # A few voxels all around which the set is occupied have been missed by chance.
    labels, _ = ndimage.label(np.pad(~full, 1, constant_values=True), np.ones((3, 3, 3)))
    sizes = np.bincount(labels.ravel())
    missed = (labels > 0) & (labels != labels[0, 0, 0]) & (sizes[labels] <= _MISSED)
    return np.asarray(full | missed[1:-1, 1:-1, 1:-1])


def _half_edged(full: NDArray[np.bool_], step: float, corners: bool = False) -> float:
    """Return the volume of the voxels, those at the boundary counted half.

    At the boundary are those that share a face with a free one; with ``corners`` an edge or a
    corner is enough, which for a plane boundary is exact if every voxel that meets it is occupied.
    """
    from scipy import ndimage

    inner = ndimage.binary_erosion(full, np.ones((3, 3, 3)) if corners else None)
    return step**3 * (int(full.sum()) + int(inner.sum())) / 2


def _extreme(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the corners of the convex hull; all points where they span no area."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 3:
        return np.arange(len(points))
    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        return np.arange(len(points))


def _hull_area(points: NDArray[np.float64]) -> float:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0
