"""Positions reached: the search of their fibres against scans, and what is stated of its misses."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.analysis.workspace.fibres import Ground, seek
from pmopt.analysis.workspace.positions import measure_positions
from pmopt.analysis.workspace.projection import measure_projection
from pmopt.mechanisms.registry import find
from pmopt.reporting.tables.table import shown
from pmopt.reporting.tables.workspace import workspace_tables

#: Limits that bend the boundary of what is reached.
SETTINGS = ({}, {"cone_angle": 0.5})


def sample(name, settings, count=1 << 16):
    """A sampler, its default design and the poses and positions within reach of a sample."""
    mechanism = find(name)
    sampler = make_sampler(mechanism, WorkspaceSettings(**settings), threads=1)
    design = sampler.design(mechanism.resolve({}))
    poses = sampler.evaluator.points(design, sampler.sequence(4), 0, count)
    slack, places = sampler.evaluator.locate(design, poses)
    return sampler, design, poses[:, slack >= 0], places[:, slack >= 0]


def inside(design, poses):
    low = design.lower[:, None]
    return ((poses >= low) & (poses <= low + design.width[:, None])).all(axis=0)


def scan_ups_sp(sampler, design, place):
    """Largest slack over the circle of poses about A4 to a position, none where l4 is out."""
    a_half, b_half = design.parameters["A"] / 2, design.parameters["a"] / 2
    arm = place - np.array([-a_half, -a_half, 0.0])
    level = np.array([b_half, b_half])
    height = math.sqrt(max(arm @ arm - level @ level, 0.0))
    own, axis = np.array([*level, height]), arm / np.linalg.norm(arm)
    # The shortest turn from own to arm, then turns about the arm.
    cross = np.cross(own / np.linalg.norm(own), axis)
    k = np.array([[0, -cross[2], cross[1]], [cross[2], 0, -cross[0]], [-cross[1], cross[0], 0]])
    first = np.eye(3) + k + k @ k / (1 + own @ axis / np.linalg.norm(own))
    u = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    t = np.linspace(-np.pi, np.pi, 4000)[:, None, None]
    r = (np.eye(3) + np.sin(t) * u + (1 - np.cos(t)) * (u @ u)) @ first
    poses = np.stack([
        np.arctan2(r[:, 1, 0], r[:, 0, 0]), -np.arcsin(np.clip(r[:, 2, 0], -1, 1)),
        np.arctan2(r[:, 2, 1], r[:, 2, 2]), np.full(len(r), height),
    ])  # fmt: skip
    slack, places = sampler.evaluator.locate(design, poses)
    assert np.abs(places - place[:, None]).max() < 1e-9 * height
    return float(np.where(inside(design, poses), slack, -np.inf).max())


def scan_ups_rps(sampler, design, place):
    """Largest slack over a grid of alpha and beta; gamma follows from z = r cos beta cos gamma."""
    radius = design.parameters["r"]
    ends = [np.linspace(design.lower[k], design.lower[k] + design.width[k], 80) for k in (2, 3)]
    alpha, beta = (m.ravel() for m in np.meshgrid(*ends))
    cosine = place[2] / (radius * np.cos(beta))
    possible = np.abs(cosine) <= 1
    alpha, beta, gamma = alpha[possible], beta[possible], np.arccos(cosine[possible])
    poses = np.stack(
        [np.full(len(beta), place[0]), np.full(len(beta), place[1]), alpha, beta, gamma]
    )
    slack, places = sampler.evaluator.locate(design, poses)
    assert len(beta) == 0 or np.abs(places - place[:, None]).max() < 1e-9 * radius
    return float(np.where(inside(design, poses), slack, -np.inf).max(initial=-np.inf))


@pytest.mark.parametrize("settings", SETTINGS)
@pytest.mark.parametrize(("name", "scan"), [("3-ups-sp", scan_ups_sp), ("4-ups-rps", scan_ups_rps)])
def test_search_finds_what_a_scan_of_the_fibre_finds(name, scan, settings):
    sampler, design, poses, places = sample(name, settings)
    first, last = places.min(axis=1), places.max(axis=1)
    ground = Ground(sampler.evaluator, design, np.ptp(poses, axis=1), last - first)
    rng = np.random.default_rng(5)
    targets = first[:, None] + (last - first)[:, None] * rng.random((3, 250))
    reached = np.zeros(targets.shape[1], dtype=bool)
    gaps = ((places[:, :, None] - targets[:, None]) / (last - first)[:, None, None]) ** 2
    nearest = np.argsort(gaps.sum(axis=0), axis=0)
    for row in nearest[[0, 8, 64]]:
        found, ends = seek(ground, targets, poses[:, row])
        # What is found has a pose to show.
        slack, shown = sampler.evaluator.locate(design, ends[:, found])
        assert (slack >= 0).all() and inside(design, ends[:, found]).all()
        assert np.abs((shown - targets[:, found]) / (last - first)[:, None]).max() < 2e-6
        reached |= found
    scanned = np.array([scan(sampler, design, place) for place in targets.T]) >= 0
    assert 40 < scanned.sum() < 210
    assert (scanned & ~reached).sum() <= 2
    assert (reached & ~scanned).sum() <= 4  # the scan's own steps


@pytest.mark.parametrize("name", ["3-cur", "3-ups-sp", "4-ups-rps", "2uu-upu"])
@pytest.mark.slow
def test_volumes_of_few_positions_agree_with_those_of_many(name):
    mechanism = find(name)
    design = make_sampler(mechanism, WorkspaceSettings()).design(mechanism.resolve({}))

    def volume(seed, samples):
        sampler = make_sampler(mechanism, WorkspaceSettings(), seed=seed)
        return measure_projection(sampler, design, samples).volume

    many = volume(1, 1 << 20)
    assert 0 < many.error < 0.007 * many.value
    misses = []
    for seed in range(8):
        few = volume(seed, 1 << 13)
        assert few.error < 0.15 * few.value
        misses.append((few.value - many.value) / math.hypot(few.error, many.error))
    misses = np.abs(misses)
    assert misses.max() < 3.5
    assert np.median(misses) < 1.5


def test_a_tool_moves_what_is_reached():
    """The corner of 3-UPS/SP that the post carries stays in the shell between its strokes' ends."""
    mechanism = find("3-ups-sp")
    settings = WorkspaceSettings(tool=(-10.0, -10.0, 0.0))  # the corner on the post
    sampler = make_sampler(mechanism, settings)
    found = measure_projection(sampler, sampler.design(mechanism.resolve({})), 1 << 18).volume
    # The corner is at l4 along the post: a part of the shell between both ends of the stroke.
    shell = 2 * math.pi / 3 * (90.0**3 - 45.0**3)
    assert 0.1 * shell < found.value < shell


def test_aspects_bound_what_is_reached():
    mechanism = find("3-ups-sp")
    found = []
    for aspect in (None, "home"):
        sampler = make_sampler(mechanism, WorkspaceSettings(aspect=aspect))
        design = sampler.design(mechanism.resolve({}))
        found.append(measure_projection(sampler, design, 1 << 16).volume)
    assert 0.5 * found[0].value < found[1].value < found[0].value + 3 * found[0].error


def lifted(axes):
    """What measure_positions asks of a sampler, for a ball of poses over the unit cube's corner.

    Positions are the first three coordinates, bent by the others: all of |p| < 1 are reached.
    """

    def locate(design, poses):
        bent = poses[:3] + 0.2 * np.sin(poses[3:].sum(axis=0))
        return 1.0 - np.sqrt((bent**2).sum(axis=0) + (poses[3:] ** 2).sum(axis=0)), bent

    evaluator = SimpleNamespace(locate=locate, threads=1, slowness=1)
    sampler = SimpleNamespace(evaluator=evaluator, threads=1, seed=3, purpose="test")
    design = SimpleNamespace(lower=np.full(axes, -2.0), width=np.full(axes, 4.0))
    poses = -2 + 4 * np.random.default_rng(1).random((axes, 20_000 * 4 ** (axes - 3)))
    slack, places = locate(design, poses)
    return sampler, design, poses[:, slack >= 0], places[:, slack >= 0]


@pytest.mark.parametrize("axes", [3, 4, 5, 6])
def test_volume_of_a_ball(axes):
    found = measure_positions(*lifted(axes), 1 << 17)
    assert abs(found.volume.value - 4 / 3 * math.pi) < 3 * found.volume.error
    assert found.volume.error < 0.02 * found.volume.value
    assert found.lower == (axes > 5)


def test_positions_on_a_plane_have_no_volume():
    sampler, design, poses, places = lifted(3)
    places[2] = 0.0
    assert measure_positions(sampler, design, poses, places, 1 << 15).volume == (0.0, 0.0)


def test_a_lower_bound_is_printed_as_one():
    settings = WorkspaceSettings(samples=1 << 14)
    result = compute_workspace(find("3-ups-sp"), settings=settings, shape_grid=8)
    assert "bound" not in result.to_dict()["projected_volume"]
    result = replace(result, projection=replace(result.projection, lower=True))
    assert result.to_dict()["projected_volume"]["bound"] == "lower"
    assert "bound" not in result.to_dict()["footprint"]
    texts = {row[0]: shown(row[1]) for row in workspace_tables(result)[0].rows}
    bounds = [name for name, text in texts.items() if text.startswith(">= ")]
    assert bounds == ["lci max", "projected volume"]
