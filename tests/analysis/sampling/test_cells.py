"""Pieces of sets of cells, lattices, hulls and outlines, against scipy and brute force."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

from pmopt.analysis.sampling.cells import hull, label, lattice_points
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms import find, names


@pytest.mark.parametrize("diagonal", [False, True])
@pytest.mark.parametrize("density", [0.0, 0.15, 0.4, 0.6, 0.9, 1.0])
@pytest.mark.parametrize(
    "shape", [(40,), (1, 9), (30, 50), (20, 9, 25), (7, 8, 9, 6), (5, 3, 6, 4, 5)]
)
def test_pieces_are_numbered_as_by_scipy(shape, density, diagonal):
    members = np.random.default_rng(len(shape)).random(shape) < density
    labels, count = label(members, diagonal)
    structure = np.ones((3,) * len(shape)) if diagonal else None
    wanted, number = ndimage.label(members, structure)
    assert count == number
    np.testing.assert_array_equal(labels, wanted)


def test_a_spiral_is_one_piece():
    """Runs that meet late: joined from both ends."""
    grid = np.zeros((21, 21), dtype=bool)
    for k in range(0, 10, 2):
        grid[k, k : 21 - k] = grid[20 - k, k : 21 - k] = True
        grid[k : 21 - k, k] = grid[k : 21 - k, 20 - k] = True
        grid[k + 1, k] = False
        grid[k + 2, k : k + 3] = True
    assert label(grid)[1] == ndimage.label(grid)[1]


@given(st.integers(1, 4), st.integers(2, 6))
def test_lattice(dimension, count):
    axes = np.random.default_rng(count).normal(size=(dimension, count))
    wanted = np.stack([m.ravel() for m in np.meshgrid(*axes, indexing="ij")])
    np.testing.assert_array_equal(lattice_points(axes), wanted)


@given(st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=60))
def test_hull_of_points_on_a_grid(points):
    """Repeated and collinear points are no corners."""
    points = np.array(points, dtype=float)
    corners = hull(points)
    try:
        wanted = ConvexHull(points)
    except QhullError:
        assert len(corners) < 3
        return
    u, v = corners.T
    area = (u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2
    assert area == pytest.approx(wanted.volume, rel=1e-12)
    assert len(corners) <= len(wanted.vertices)


@pytest.mark.parametrize("least", [0.0, 0.02])
@pytest.mark.parametrize("name", names())
def test_outline_bounds_all_ends(name, least):
    """The hull of the strips' extremes is that of all ends of links at the same poses."""
    sampler = make_sampler(find(name), WorkspaceSettings(min_lci=least))
    design = sampler.design(sampler.space.mechanism.resolve({}))
    points = sampler.sequence(1)
    every = sampler.evaluator.shadow(design, sampler.evaluator.points(design, points, 0, 40_000))
    assert len(every) > 1000
    found = sampler.evaluator.outline(design, points, 0, 40_000)
    assert len(found) < len(every) or least > 0
    # Of the same poses, whose numbers differ in the last digit where they are compiled apart.
    assert cKDTree(every).query(found)[0].max() < 1e-9 * np.ptp(every)
    whole = ConvexHull(every).volume
    assert ConvexHull(found).volume == pytest.approx(whole, rel=2e-4)
    assert ConvexHull(found).volume <= whole * (1 + 1e-12)
