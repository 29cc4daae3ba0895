"""What a workspace is in space: the positions the platform reaches, and the floor it needs.

A workspace of poses has a volume in mixed units; papers plot the positions reached in it. Their
volume is counted on voxels that reachable sample poses fall into. A voxel at the boundary is
occupied as soon as a point falls into the part of it that lies inside, which on average is half
of it: occupied voxels with a free neighbour count half.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.estimates import Estimate
from pmopt.analysis.sweeper import Design, Sweeper
from pmopt.numerics.sequences import BLOCK, Sequence

PROJECTION_SAMPLES = 1 << 20
_REPLICATES = 4
#: Points that fall into a voxel on average: fewer would leave holes by chance.
_POINTS_A_VOXEL = 24
_MOST_VOXELS = 128


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
    grid : int
        Voxels along the longest side.
    lower, upper : tuple of float
        Box around the positions; empty where nothing is reachable.
    """

    volume: Estimate
    footprint: Estimate
    grid: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]


def reachable_poses(
    sweeper: Sweeper, design: Design, points: Sequence, first: int, last: int
) -> NDArray[np.float64]:
    """Return the points of the first replicate that are reachable, shape (d, N)."""
    poses = sweeper.points(design, points, first, last)
    margin, lci = sweeper.field(design, poses)
    return poses[:, (margin >= 0) & (lci >= sweeper.settings.min_lci)]


def replicate(points: Sequence, number: int) -> Sequence:
    """Return one replicate of a sequence."""
    one = slice(number, number + 1)
    return points._replace(start=points.start[one], high=points.high[one], low=points.low[one])


def measure_projection(
    sweeper: Sweeper, design: Design, samples: int = PROJECTION_SAMPLES
) -> Projection:
    """Measure the positions reached and the floor area needed.

    The error combines the spread of replicates with the difference between two sizes of voxels.

    Parameters
    ----------
    sweeper : Sweeper
    design : Design
    samples : int
        Of all replicates together.
    """
    nothing = Estimate(math.nan, math.nan)
    if design.box_volume == 0:
        return Projection(nothing, nothing, 0, (), ())
    points = sweeper.for_purpose(f"{sweeper.purpose}, projection").sequence(_REPLICATES)
    count = max(1, samples // _REPLICATES // BLOCK) * BLOCK
    floor = [k for k in range(3) if k != sweeper.mechanism.vertical]
    places, corners = [], []
    for r in range(_REPLICATES):
        poses = reachable_poses(sweeper, design, replicate(points, r), 0, count)
        facts = sweeper.probe(design, poses)
        places.append(facts.tool)
        ends = facts.segments.reshape(-1, 3)[:, floor]
        corners.append(ends[_extreme(ends)])
    joined = np.concatenate(places)
    if len(joined) < 8:
        return Projection(nothing, nothing, 0, (), ())
    lower, upper = joined.min(axis=0), joined.max(axis=0)
    sides = np.maximum(upper - lower, 1e-9 * (upper - lower).max())
    voxels = len(joined) / _POINTS_A_VOXEL
    size = float(np.clip(np.prod(sides / sides.max()), 1e-6, 1.0))
    grid = int(np.clip((voxels / size) ** (1 / 3), 6, _MOST_VOXELS))
    step = float(sides.max()) / grid
    fine, coarse = (_occupied(joined, lower, s) for s in (step, 1.5 * step))
    # Parts of the sample see parts of the boundary: their voxels are as many points wide.
    wide = step * _REPLICATES ** (1 / 3)
    parts = np.array([_occupied(p, lower, wide) for p in places])
    statistical = float(parts.std(ddof=1)) / math.sqrt(_REPLICATES)
    volume = Estimate(fine, math.hypot(statistical, (coarse - fine) / math.sqrt(1.5**2 + 1)))
    areas = [_hull_area(c) for c in corners]
    whole = _hull_area(np.concatenate(corners))
    # A hull of points is too small: parts of the sample tell by how much it still grows.
    spread = max(float(np.std(areas, ddof=1)), whole - float(np.mean(areas)))
    return Projection(
        volume, Estimate(whole, max(spread, 1e-12 * whole)), grid,
        tuple(lower.tolist()), tuple(upper.tolist()),
    )  # fmt: skip


def _occupied(places: NDArray[np.float64], lower: NDArray[np.float64], step: float) -> float:
    """Return the volume of the occupied voxels, those at the boundary counted half."""
    from scipy import ndimage

    cells = np.floor((places - lower) / step).astype(np.int64)
    shape = cells.max(axis=0) + 1
    full = np.zeros(shape, dtype=bool)
    full[tuple(cells.T)] = True
    # A voxel all around which the set is occupied has been missed by chance.
    full = ndimage.binary_fill_holes(full)
    inner = ndimage.binary_erosion(full)
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
