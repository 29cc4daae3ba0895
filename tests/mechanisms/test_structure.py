"""One structure: what its kernel functions return, what a layout is, and what is named amiss."""

import inspect
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from support.poses import reachable, ready

from pmopt.compiler import program_text
from pmopt.errors import InputError
from pmopt.kernels.vectors import Rotation, Vec3, X, Y, Z
from pmopt.mechanisms.joints import PLATFORM
from pmopt.mechanisms.structure import (
    Along,
    Cylindrical,
    Evaluated,
    Freedom,
    Normal,
    Parallelogram,
    Prismatic,
    Revolute,
    Segment,
    SerialChain,
    Spherical,
    Structure,
    Universal,
)


class Inner(NamedTuple):
    b: Vec3


class Points(NamedTuple):
    a: Vec3
    inner: Inner
    turn: Rotation
    size: float


class Cones(NamedTuple):
    U_A: float


class Positions(NamedTuple):
    q: float
    h: float
    way: Vec3


def made(at, x, lambda_, constants):
    turn = Rotation(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return Points(Vec3(at, 0.0, 0.0), Inner(Vec3(at, x, lambda_)), turn, constants[0])


def skeleton(at, constants):
    """A helper that is called as what is made."""
    return Cones(at.size)


def positions(at, constants):
    return Positions(at.a.x + 1.0, constants[0], Vec3(0.0, 0.0, 1.0))


CHAIN = SerialChain(
    "limb 1",
    (
        Cylindrical("a", Z, slide="q"),
        Universal("a", Along("a", "inner.b"), Normal(X, ("a", "inner.b"))),
        Parallelogram("inner.b", "way", bar=("inner.b", "a")),
        Revolute("a", Normal(Along("a", "inner.b"), X)),
        Spherical("inner.b"),
    ),
    bars=("a", "inner.b", "a"),
    spoke="inner.b",
)
BY_HAND = Structure(
    Evaluated(made, Points),
    place="a",
    rotation="turn",
    chains=(CHAIN, SerialChain("limb 2", (Prismatic("a", Y),))),
    cones=Evaluated(skeleton, Cones),
    positions=Evaluated(positions, Positions),
    followed={"h": (Freedom("C_A", "turn"),)},
)
#: Coordinates called as what a text has, or as no name can be.
POSE = ("at", "x", "lambda")
TURN = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
A, B = [2.0, 0.0, 0.0], [2.0, 3.0, 4.0]


def test_numbers_of_a_skeleton():
    found = BY_HAND.skeleton(POSE)(2.0, 3.0, 4.0, (0.5,))
    assert list(found) == [*A, *TURN, *A, *B, *B, *A, *A, *B, 0.5]
    row = BY_HAND.skeleton_row
    assert row.size == len(found)
    assert list(found[row.place]) == A
    assert list(found[row.rotation]) == TURN
    assert list(found[row.cones]) == [0.5]
    assert BY_HAND.segments == (
        Segment("a", "inner.b", 0, 0), Segment("inner.b", "a", 0, 0),
        Segment("a", "inner.b", PLATFORM, 0),
    )  # fmt: skip


def test_numbers_of_a_posture():
    found = BY_HAND.posture(POSE, ("q",))(2.0, 3.0, 4.0, (0.5,))
    along, across = [0.0, 0.6, 0.8], [0.0, -0.8, 0.6]
    back = [0.0, 0.8, -0.6]
    assert list(found) == [
        *A, *TURN, 3.0, 0.5, *A, *Z, *A, *along, *across, *B, *Z, 0.0, -3.0, -4.0, *A, *back, *B,
        *A, *Y,
    ]  # fmt: skip
    row = BY_HAND.posture_row
    assert row.size == len(found)
    assert list(found[row.joints]) == [3.0]
    assert list(found[row.followed]) == [0.5]
    assert replace(BY_HAND, positions=None).posture(POSE, ("q",)) is None


def test_a_layout_is_the_posture():
    chains = BY_HAND.layout(made(2.0, 3.0, 4.0, (0.5,)), (0.5,))
    found = BY_HAND.posture(POSE, ("q",))(2.0, 3.0, 4.0, (0.5,))
    numbers = []
    for chain in chains:
        for joint in chain.joints:
            bar = [] if joint.bar is None else joint.bar
            numbers += [*joint.point, *np.ravel(joint.axes), *bar]
    assert numbers == list(found[BY_HAND.posture_row.layout])
    assert [chain.name for chain in chains] == ["limb 1", "limb 2"]
    assert [j.kind for j in chains[0].joints] == ["C", "U", "Pa", "R", "S"]
    assert chains[0].joints[0].drive == ("q", 1)


def test_across_what_is_parallel():
    """A layout has a direction there, any that is across."""
    chain = SerialChain("limb", (Revolute("a", Normal(Y, ("a", "inner.b"), otherwise=X)),))
    structure = replace(BY_HAND, chains=(chain,))
    for x, z, wanted in ((3.0, 0.0, [1.0, 0.0, 0.0]), (3.0, 1e-12, [1.0, 0.0, 0.0]),
                         (3.0, -1e-6, [-1.0, 0.0, 0.0])):  # fmt: skip
        ((joint,),) = [c.joints for c in structure.layout(made(2.0, x, z, (0.5,)), (0.5,))]
        np.testing.assert_allclose(joint.axes[0], wanted, atol=1e-15)


def test_the_text_is_found(mechanism):
    for function in (mechanism.skeleton, mechanism.posture):
        text = inspect.getsource(function)
        assert text.startswith(f"def {function.__name__}(")
        blocks = {}
        program_text.collect(function, blocks)
        assert text in blocks[function.__name__]
    assert mechanism.skeleton is mechanism.skeleton


def test_in_a_text_functions_keep_their_names_apart():
    """A helper called ``skeleton`` is not what is made."""
    blocks = {}
    program_text.collect(BY_HAND.skeleton(POSE), blocks)
    assert [name for name in blocks if name.startswith("skeleton")] == [
        f"skeleton__{__name__}", "skeleton"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        (replace(BY_HAND, place="b"),
         "structure: point or vector: unknown name 'b', allowed: a, inner.b; nearest: inner.b"),
        (replace(BY_HAND, place="inner"), "structure: 'inner' is no point or vector"),
        (replace(BY_HAND, place="size"), "structure: 'size' is no point or vector"),
        (replace(BY_HAND, rotation="trun"),
         "structure: rotation: unknown name 'trun', allowed: turn; nearest: turn"),
        (replace(BY_HAND, rotation="a"), "structure: 'a' is no rotation"),
        (replace(BY_HAND, chains=(replace(CHAIN, bars=("a", "way")),)),
         "structure: point or vector: unknown name 'way', allowed: a, inner.b; nearest: a"),
    ],
)  # fmt: skip
def test_names_amiss_of_a_skeleton(changed, text):
    with pytest.raises(InputError) as caught:
        changed.skeleton(POSE)
    assert str(caught.value) == text


def test_names_amiss_of_a_posture():
    chain = replace(CHAIN, joints=(Revolute("a", Along("a", "c")),))
    with pytest.raises(InputError, match=r"unknown name 'c', allowed: a, inner\.b, way; nearest"):
        replace(BY_HAND, chains=(chain,)).posture(POSE, ("q",))
    with pytest.raises(InputError, match=r"structure: position: unknown name 'q1', .*nearest: q"):
        BY_HAND.posture(POSE, ("q1",))


def test_followed_joints_by_names(mechanism):
    terms = mechanism.structure.followed_terms(mechanism.limbs)
    assert [*terms] == [*mechanism.structure.followed] == [*mechanism.followed]
    if mechanism.name == "2uu-upu":
        assert terms["kappa"] == ((1, 2, 1.0), (1, 1, -1.0))
        assert terms["l1"] == ((0, 2, 1.0),)
    limbs = mechanism.limbs
    name = limbs[0].joint_names[0]
    for freedom, text in (
        (Freedom("nothing"), "structure: followed q: unknown name 'nothing', allowed: "),
        (Freedom(name, "sideways"), "structure: followed q: unknown name 'sideways', allowed: "),
    ):
        with pytest.raises(InputError, match=text):
            replace(mechanism.structure, followed={"q": (freedom,)}).followed_terms(limbs)


def test_links_keep_their_lengths(mechanism):
    """But telescopes, which are as long as their joint; the platform's radii are rigid too."""
    params = mechanism.resolve({})
    size = mechanism.characteristic_length(params)
    constants = ready(mechanism, params, mechanism.working_modes[0])
    row = mechanism.structure.skeleton_row
    lengths, telescopes = [], []
    for pose, solution in reachable(mechanism, params, 20):
        flat = np.array(mechanism.skeleton(*pose.values(), constants))
        ends = flat[row.segments].reshape(-1, 2, 3)
        lengths.append(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))
        values = {**solution.joints, **solution.passive}
        telescopes.append(
            [values.get(f"l{s.limb + 1}", np.nan) for s in mechanism.structure.segments]
        )
    found, joints = np.array(lengths), np.array(telescopes)
    telescopic = np.isfinite(joints).all(axis=0)
    assert telescopic.sum() == sum(
        bool(chain.bars) and any(isinstance(joint, Prismatic) for joint in chain.joints)
        for chain in mechanism.structure.chains
    )
    np.testing.assert_allclose(found[:, telescopic], joints[:, telescopic], atol=1e-9 * size)
    rigid = found[:, ~telescopic]
    np.testing.assert_allclose(rigid, np.broadcast_to(rigid[0], rigid.shape), atol=1e-8 * size)
