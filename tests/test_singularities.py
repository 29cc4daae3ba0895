"""Aspects, singular families and walls, for every mechanism and against known cases."""

import math

import numpy as np
import pytest

from pmopt.analysis.aspects import determinants, map_aspects
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.singularities import find_singularities
from pmopt.analysis.sweeper import Sweeper
from pmopt.analysis.workspace import compute_workspace
from pmopt.errors import InfeasibleError, InputError
from pmopt.mechanisms import find

FEW = WorkspaceSettings(samples=1 << 15)


def families(result):
    return [f.fixed for f in result.families]


def wall(result, coordinate, direction):
    (found,) = [w for w in result.walls if (w.coordinate, w.direction) == (coordinate, direction)]
    return found


# --- every mechanism ----------------------------------------------------------------------


def test_aspects_make_up_the_workspace(mechanism):
    """Volumes add up to that of the workspace, the home aspect is one of them."""
    result = find_singularities(mechanism, settings=FEW)
    volume = compute_workspace(mechanism, settings=FEW, shape_grid=0).volume
    total = sum(a.volume.value for a in result.aspects)
    assert total <= volume.value * (1 + 1e-9)
    assert total >= 0.97 * volume.value
    assert sum(a.home for a in result.aspects) == 1
    assert result.home_lci > 0
    shares = sum(a.share.value for a in result.aspects)
    assert shares == pytest.approx(total / volume.value, rel=1e-9)


def test_home_aspect_is_what_workspace_counts(mechanism):
    result = find_singularities(mechanism, settings=FEW)
    (home,) = [a for a in result.aspects if a.home]
    settings = WorkspaceSettings(samples=1 << 15, aspect="home")
    counted = compute_workspace(mechanism, settings=settings, shape_grid=0)
    assert counted.volume.value == pytest.approx(home.volume.value, rel=1e-12)
    whole = compute_workspace(mechanism, settings=FEW, shape_grid=0)
    assert counted.volume.value <= whole.volume.value
    assert counted.reachable == round(home.share.value * whole.reachable)


def test_same_for_any_number_of_threads(mechanism):
    documents = [find_singularities(mechanism, settings=FEW, threads=n).to_dict() for n in (1, 3)]
    assert documents[0] == documents[1]


def test_families_are_singular_and_walls_are_real(mechanism):
    """Fresh poses of a told slice have no Jacobian; at a told wall reach or sign ends."""
    result = find_singularities(mechanism, settings=FEW)
    sweeper = Sweeper(mechanism, FEW)
    design = sweeper.design(mechanism.resolve({}))
    names = [c.name for c in mechanism.pose]
    rng = np.random.default_rng(11)
    for family in families(result):
        poses = design.lower[:, None] + design.width[:, None] * rng.uniform(size=(len(names), 4000))
        for name, value in family.items():
            poses[names.index(name)] = value
        margin, lci = sweeper.field(design, poses)
        assert (margin >= 0).sum() > 5
        assert lci[margin >= 0].max() < 1e-7
    assert len(result.walls) >= len(names)
    home = list(result.home.values())
    for w in result.walls:
        if w.what == "end of the domain":
            continue
        k = names.index(w.coordinate)
        near = np.array([home, home]).T
        step = 1e-7 * design.width[k]
        near[k] = w.value - w.direction * step, w.value + w.direction * step
        margin, _ = sweeper.field(design, near)
        sign = np.sign(determinants(sweeper, design, near))
        assert margin[0] >= 0
        assert margin[1] < 0 or sign[0] != sign[1]


def test_signs_are_those_of_the_determinant(mechanism):
    """The map's aspect of a random reachable pose has the sign of its determinant."""
    sweeper = Sweeper(mechanism, FEW)
    design = sweeper.design(mechanism.resolve({}))
    found = map_aspects(sweeper, design)
    poses = sweeper.points(design, sweeper.sequence(4), 0, 4096)
    poses = poses[:, sweeper.field(design, poses)[0] >= 0]
    dets = determinants(sweeper, design, poses)
    labels = found.of(poses, dets)
    assert (labels > 0).mean() > 0.97
    signs = np.array((0, *found.signs))[labels]
    assert (signs[labels > 0] == np.where(dets > 0, 1, -1)[labels > 0]).all()
    assert (np.abs(dets) <= 1 + 1e-12).all()


# --- known cases --------------------------------------------------------------------------


def test_2pauu_with_one_torus_splits_along_the_forward_singularity():
    """m = n, l1 = l2: u1x u2z = u1z u2x vanishes on the workspace's diagonals near the floor."""
    result = find_singularities(find("2pauu-ppap"), {"m": 1, "n": 1, "l1": 1, "l2": 1})
    assert any(n.crossed for n in result.nearness if n.kind == "forward")
    assert wall(result, "x", 1).what.startswith("inverse (type I)")


def test_2pauu_out_in_is_singular_everywhere_for_one_torus():
    """With one knee out and one in and m = n both links coincide: every pose is a type II one."""
    result = find_singularities(
        find("2pauu-ppap"),
        {"m": 1, "n": 1},
        WorkspaceSettings(samples=1 << 14, working_mode="out-in"),
    )
    assert {"x": 0.0} in families(result) or result.smallest_lci < 1e-12


def test_3_ups_sp_is_singular_at_every_level_pose():
    """theta = psi = 0, any phi and l4: the paper's squares, and any of one twist."""
    mechanism = find("3-ups-sp")
    for change in ({}, {"twist": 0.6}):
        assert {"theta": 0.0, "psi": 0.0} in families(find_singularities(mechanism, change, FEW))


def test_3_ups_sp_kite_leaves_one_wall_among_level_poses():
    """kite = 0.6: level poses are regular but at phi + twist = 0."""
    mechanism = find("3-ups-sp")
    kite = find_singularities(mechanism, {"kite": 0.6}, FEW)
    assert {"theta": 0.0, "psi": 0.0} not in families(kite)
    assert {"phi": 0.0, "theta": 0.0, "psi": 0.0} in families(kite)
    both = find_singularities(mechanism, {"kite": 0.6, "twist": 0.6}, FEW)
    assert not any({"theta", "psi"} <= set(f) for f in families(both))


def test_4_ups_rps_wall_of_level_poses():
    result = find_singularities(find("4-ups-rps"), settings=WorkspaceSettings(
        samples=1 << 15, domain={"gamma": (-0.5, 2.7)}))  # fmt: skip
    assert {"alpha": 0.0, "beta": 0.0, "gamma": 0.0} in families(result)


def test_2uu_upu_forward_singularity_where_link_and_coupler_are_in_line():
    """Found from the zeros alone: at every one kappa is 17.624512 deg in size."""
    result = find_singularities(find("2uu-upu"), settings=FEW)
    (link,) = [n for n in result.nearness if n.part == "link 2"]
    assert link.crossed
    assert link.located >= 6
    assert math.degrees(link.always["kappa"]) == pytest.approx(17.624512, abs=5e-7)
    assert "x" not in link.always


def test_home_out_of_reach_is_told():
    settings = WorkspaceSettings(samples=1 << 12, aspect="home", limits={"d": (0.5, 1.0)})
    with pytest.raises(InputError, match="home pose"):
        compute_workspace(find("2pauu-ppap"), settings=settings)
    with pytest.raises(InfeasibleError):
        find_singularities(find("2pauu-ppap"), {"l2": 0.01, "l1": 0.01}, FEW)
