"""Aspects, singular families and walls, for every mechanism and against known cases."""

import math
from functools import cache

import numpy as np
import pytest

from pmopt.analysis.sampling.aspects import determinants, map_aspects
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.singularities.crossings import follow_path
from pmopt.analysis.singularities.survey import find_singularities
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.errors import InfeasibleError, InputError, UnreachableError
from pmopt.mechanisms import find

FEW = WorkspaceSettings(samples=1 << 15)


def families(result):
    return [f.fixed for f in result.families]


def wall(result, coordinate, direction):
    (found,) = [w for w in result.walls if (w.coordinate, w.direction) == (coordinate, direction)]
    return found


@cache
def surveyed(name):
    """Return what is found of a default design, once."""
    return find_singularities(find(name), settings=FEW)


# --- every mechanism ----------------------------------------------------------------------


def test_aspects_make_up_the_workspace(mechanism):
    """Volumes add up to that of the workspace, the home aspect is one of them."""
    result = surveyed(mechanism.name)
    volume = compute_workspace(mechanism, settings=FEW, shape_grid=0).volume
    total = sum(a.volume.value for a in result.aspects)
    assert total <= volume.value * (1 + 1e-9)
    assert total >= 0.97 * volume.value
    assert sum(a.home for a in result.aspects) == 1
    assert result.home_lci > 0
    shares = sum(a.share.value for a in result.aspects)
    assert shares == pytest.approx(total / volume.value, rel=1e-9)


@pytest.mark.slow
def test_home_aspect_is_what_workspace_counts(mechanism):
    result = surveyed(mechanism.name)
    (home,) = [a for a in result.aspects if a.home]
    settings = WorkspaceSettings(samples=1 << 15, aspect="home")
    counted = compute_workspace(mechanism, settings=settings, shape_grid=0)
    assert counted.volume.value == pytest.approx(home.volume.value, rel=1e-12)
    whole = compute_workspace(mechanism, settings=FEW, shape_grid=0)
    assert counted.volume.value <= whole.volume.value
    assert counted.reachable == round(home.share.value * whole.reachable)


@pytest.mark.slow
def test_same_for_any_number_of_threads(mechanism):
    few = WorkspaceSettings(samples=1 << 13)
    documents = [find_singularities(mechanism, settings=few, threads=n).to_dict() for n in (1, 3)]
    assert documents[0] == documents[1]


def test_families_are_singular_and_walls_are_real(mechanism):
    """Fresh poses of a told slice have no Jacobian; at a told wall reach or sign ends."""
    result = surveyed(mechanism.name)
    sampler = make_sampler(mechanism, FEW)
    design = sampler.design(mechanism.resolve({}))
    names = [c.name for c in mechanism.pose]
    rng = np.random.default_rng(11)
    lower, upper = mechanism.reach_box(design.parameters, design.limits)
    for family in result.families:
        assert set(family.free) == set(names) - set(family.fixed)
        unit = rng.uniform(size=(len(names), 20000))
        poses = lower[:, None] + (upper - lower)[:, None] * unit
        inside = True
        for name, value in family.fixed.items():
            k = names.index(name)
            poses[k] = value
            inside &= design.lower[k] - 1e-9 <= value <= design.lower[k] + design.width[k] + 1e-9
        margin, lci = sampler.evaluator.field(design, poses)
        assert (margin >= 0).sum() > 5
        assert lci[margin >= 0].max() < 1e-7
        assert family.in_domain == inside
    assert len(result.walls) >= len(names)
    home = list(result.home.values())
    for w in result.walls:
        if w.what == "end of the domain":
            continue
        k = names.index(w.coordinate)
        near = np.array([home, home]).T
        step = 1e-7 * design.width[k]
        near[k] = w.value - w.direction * step, w.value + w.direction * step
        margin, _ = sampler.evaluator.field(design, near)
        sign = np.sign(determinants(sampler.evaluator, design, near))
        assert margin[0] >= 0
        assert margin[1] < 0 or sign[0] != sign[1]


def test_signs_are_those_of_the_determinant(mechanism):
    """The map's aspect of a random reachable pose has the sign of its determinant."""
    sampler = make_sampler(mechanism, FEW)
    design = sampler.design(mechanism.resolve({}))
    found = map_aspects(sampler.evaluator, design)
    poses = sampler.evaluator.points(design, sampler.sequence(4), 0, 4096)
    poses = poses[:, sampler.evaluator.field(design, poses)[0] >= 0]
    dets = determinants(sampler.evaluator, design, poses)
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
    assert families(result) == [{}]
    assert result.families[0].free == ("x", "y", "z")


def test_3_ups_sp_is_singular_at_every_level_pose():
    """theta = psi = 0, any phi and l4: the paper's squares, and any of one twist."""
    mechanism = find("3-ups-sp")
    for result in (surveyed("3-ups-sp"), find_singularities(mechanism, {"twist": 0.6}, FEW)):
        assert {"theta": 0.0, "psi": 0.0} in families(result)


def test_3_ups_sp_kite_leaves_one_wall_among_level_poses():
    """kite = 0.6: level poses are regular but at phi + twist = 0."""
    mechanism = find("3-ups-sp")
    kite = find_singularities(mechanism, {"kite": 0.6}, FEW)
    assert {"theta": 0.0, "psi": 0.0} not in families(kite)
    assert {"phi": 0.0, "theta": 0.0, "psi": 0.0} in families(kite)


@pytest.mark.parametrize("twist", [0.3, 0.6])
def test_3_ups_sp_twist_moves_the_wall_of_the_kite(twist):
    """phi + twist = 0: found where the determinant vanishes, at no special value."""
    result = find_singularities(find("3-ups-sp"), {"kite": 0.6, "twist": twist}, FEW)
    (wall,) = [f.fixed for f in result.families if f.in_domain]
    assert wall == {"phi": pytest.approx(-twist, abs=1e-9), "theta": 0.0, "psi": 0.0}


def test_4_ups_rps_wall_of_level_poses():
    """Beyond the default domain, found all the same; inside it if the domain is given wider."""
    mechanism = find("4-ups-rps")
    level = {"alpha": 0.0, "beta": 0.0, "gamma": 0.0}
    wide = WorkspaceSettings(samples=1 << 15, domain={"gamma": (-0.5, 2.7)})
    results = (surveyed(mechanism.name), find_singularities(mechanism, settings=wide))
    for result, inside in zip(results, (False, True), strict=True):
        assert [f.in_domain for f in result.families if f.fixed == level] == [inside]
    narrow = WorkspaceSettings(samples=1 << 15, domain={"gamma": (1.0, 2.0)})
    assert level not in families(find_singularities(mechanism, settings=narrow))


def test_gimbal_lock_is_no_family():
    """At beta = 90 deg the angles' rates are dependent, whatever the mechanism does."""
    mechanism = find("4-ups-rps")
    found = families(surveyed(mechanism.name))
    assert {"beta": math.pi / 2} not in found


def test_2uu_upu_forward_singularity_where_link_and_coupler_are_in_line():
    """Found from the zeros alone: at every one kappa is -17.624512 deg."""
    result = surveyed("2uu-upu")
    (link,) = [n for n in result.nearness if n.part == "link 2"]
    assert link.crossed
    assert link.located >= 6
    assert math.degrees(link.always["kappa"]) == pytest.approx(-17.624512, abs=5e-7)
    assert not {"x", "|x|"} & set(link.always)


def test_home_out_of_reach_is_told():
    settings = WorkspaceSettings(samples=1 << 12, aspect="home", limits={"d": (0.5, 1.0)})
    with pytest.raises(InputError, match="home pose"):
        compute_workspace(find("2pauu-ppap"), settings=settings)
    with pytest.raises(InfeasibleError):
        find_singularities(find("2pauu-ppap"), {"l2": 0.01, "l1": 0.01}, FEW)


# --- paths --------------------------------------------------------------------------------


def papers_trajectory(gamma, count=201):
    """Return times and poses of section 3.1 of the 4-UPS-RPS paper, z from the constraint."""
    times = np.linspace(0, 2, count).tolist()
    return times, [
        {
            "x": 900 + 50 * math.cos(2 * t), "y": 50 * math.sin(2 * t),
            "alpha": math.pi / 36 * (t - 1), "beta": math.pi / 36 * (t - 1), "gamma": gamma,
        }
        for t in times
    ]  # fmt: skip


@pytest.mark.parametrize("count", [41, 40])
def test_the_papers_trajectory_crosses_at_one_second(count):
    """At a row of the path (41 rows, the zero itself) and between two of them."""
    mechanism = find("4-ups-rps")
    times, path = papers_trajectory(0.0, count)
    result = follow_path(mechanism, {}, path, times)
    (crossing,) = result.crossings
    assert (crossing.kind, crossing.part) == ("forward", "platform")
    assert crossing.changes_sign
    assert crossing.time == pytest.approx(1.0, abs=1e-9)
    assert crossing.row == crossing.until == pytest.approx(1 + (count - 1) / 2, abs=1e-9)
    assert crossing.pose["alpha"] == pytest.approx(0.0, abs=1e-9)
    turned = follow_path(mechanism, {}, papers_trajectory(math.pi / 2, count)[1])
    assert turned.crossings == ()
    (least,) = [n for n in turned.nearest if n.kind == "forward"]
    assert abs(least.value) > 1e-3


def test_a_stretch_that_is_singular_is_one_crossing():
    """3-UPS/SP: along level poses, then off them and through the level at a tilt's zero."""
    path = [
        {"phi": 0.1 * k, "theta": theta, "psi": 0.0, "l4": 60.0}
        for k, theta in enumerate((0.0, 0.0, 0.0, 0.02, -0.04))
    ]
    first, second = follow_path(find("3-ups-sp"), {}, path).crossings
    assert (first.row, first.until, first.changes_sign) == (1.0, 3.0, False)
    assert second.row == pytest.approx(4 + 1 / 3, abs=1e-9)
    assert second.changes_sign
    assert second.time is None


def test_bad_paths_are_told_by_line():
    mechanism = find("2pauu-ppap")
    good, far = {"x": 0.0, "y": 0.0, "z": 1.5}, {"x": 9.0, "y": 0.0, "z": 1.5}
    with pytest.raises(UnreachableError, match=r"line 2.*out of reach"):
        follow_path(mechanism, {}, [good, far])
    with pytest.raises(InputError, match="at least two"):
        follow_path(mechanism, {}, [good])
    with pytest.raises(InputError, match="line 1: z is missing"):
        follow_path(mechanism, {}, [{"x": 0.0, "y": 0.0}, good])
