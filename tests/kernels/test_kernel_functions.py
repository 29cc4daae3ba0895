"""Shared kernel functions against plain oracles: trigonometry, distances, conditioning, Newton."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from support import naive

from pmopt.compiler import program_text
from pmopt.kernels import conditioning, sweep
from pmopt.kernels.segment_distance import segment_distance2
from pmopt.kernels.trigonometry import roll_pitch_yaw, sin_cos
from pmopt.kernels.vectors import Vec3


class One(NamedTuple):
    """Constants of which there is one, unused."""

    unused: float


angles = st.floats(-20, 20)
points = st.lists(st.floats(-2, 2), min_size=12, max_size=12)


@given(angles)
def test_sin_cos(angle):
    sine, cosine = sin_cos(angle)
    assert sine == pytest.approx(math.sin(angle), abs=2e-15)
    assert cosine == pytest.approx(math.cos(angle), abs=2e-15)


@pytest.mark.parametrize("quarter", range(-8, 9))
def test_sin_cos_at_quarter_turns(quarter):
    """On both sides of every change of quadrant."""
    for angle in (quarter * math.pi / 4 + d for d in (-1e-9, 0.0, 1e-9)):
        assert sin_cos(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=1e-15)


@given(angles, angles, angles)
def test_roll_pitch_yaw(z, y, x):
    wanted = Rotation.from_euler("ZYX", [z, y, x]).as_matrix()
    np.testing.assert_allclose(np.reshape(roll_pitch_yaw(z, y, x), (3, 3)), wanted, atol=1e-14)


def points_of(numbers):
    """Return points of a flat row."""
    row = list(numbers)
    return [Vec3(*row[k : k + 3]) for k in range(0, len(row), 3)]


@given(points)
def test_segment_distance(ends):
    """Against a minimisation from both ends and the middle of each segment."""
    a, b, c, d = np.reshape(ends, (4, 3))

    def square(p):
        return float((((a + p[0] * (b - a)) - (c + p[1] * (d - c))) ** 2).sum())

    starts = [(s, t) for s in (0.0, 0.5, 1.0) for t in (0.0, 0.5, 1.0)]
    wanted = min(
        minimize(square, start, bounds=[(0, 1)] * 2, options={"ftol": 1e-15, "gtol": 1e-12}).fun
        for start in starts
    )
    assert segment_distance2(*points_of(ends)) == pytest.approx(wanted, abs=2e-6)


@pytest.mark.parametrize(
    ("ends", "distance"),
    [
        ((0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0), 1.0),  # parallel
        ((0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0), 1.0),  # in line
        ((0, 0, 0, 1, 0, 0, 0.5, -1, 0.3, 0.5, 1, 0.3), 0.3),  # crossing
        ((0, 0, 0, 0, 0, 0, 0, 3, 4, 0, 3, 4), 5.0),  # two points
        ((0, 0, 0, 2, 0, 0, 3, 1, 0, 3, 5, 0), math.sqrt(2)),  # end to end
        ((0, 0, 0, 4, 0, 0, 3, 2, 0, 1, 2, 0), 2.0),  # antiparallel, overlapping
    ],
)
def test_segment_distance_of_known_cases(ends, distance):
    found = segment_distance2(*points_of(map(float, ends)))
    assert math.sqrt(found) == pytest.approx(distance, abs=1e-12)


def kernel4(a, b, c, d, constants):
    e = constants[0]
    return (
        1.0, a, b * a, c, d, d + b, a * e, c * c, b, a - c, b + d * d, c, d * a, a * b, b * c,
        c * d, d + e,
    )  # fmt: skip


def kernel5(a, b, c, d, f, constants):
    e = constants[0]
    return (
        1.0, a, b * a, c, d, f, d + b, a * e, c * c, b, f * f, a - c, b + d * d, c, d * a, f,
        a * b, b * c, c * d, d + e, f - a, f, a, b, c * c, d,
    )  # fmt: skip


def still4(a, b, c, d, constants):
    return (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def still5(a, b, c, d, f, constants):
    return (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize("norm", ["2", "fro"])
@pytest.mark.parametrize(("order", "kernel", "still"), [(4, kernel4, still4), (5, kernel5, still5)])
def test_conditioning_of_larger_matrices(order, kernel, still, norm):
    """Blocks of Jacobi rotations against LAPACK, singular and zero matrices among them."""
    recipe = program_text.Recipe(kernel, still, order, One, order, norm, (), (), 0)
    module = program_text.specialise(recipe)
    poses = np.random.default_rng(5).uniform(-1, 1, (order, 3 * 512 + 17))
    poses[:, 3] = 0.0
    poses[0, 4:8] = 1e-9
    margin, lci = np.empty(poses.shape[1]), np.empty(poses.shape[1])
    module.field(poses, np.array([0.3]), margin, lci, np.empty((recipe.scratch_rows, sweep.PITCH)))
    for pose, found in zip(poses.T.tolist(), lci, strict=True):
        matrix = np.reshape(kernel(*pose, (0.3,))[1:], (order, order))
        assert found == pytest.approx(naive.inverse_condition(matrix, norm), abs=1e-11)


def plain3(a, b, c, d, e, f, g, h, i, constants):
    return (1.0, a, b, c, d, e, f, g, h, i)


def plain4(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, constants):
    return (1.0, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p)


def plain5(
    a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, v, w, x, y, constants
):  # fmt: skip
    return (
        1.0, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, v, w, x, y,
    )  # fmt: skip


def still9(a, b, c, d, e, f, g, h, i, constants):
    return (0.0,) * 12


def still16(a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, constants):
    return (0.0,) * 12


def still25(
    a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, v, w, x, y, constants
):  # fmt: skip
    return (0.0,) * 12


def awkward_matrices(order, count, seed=7):
    """Return matrices near singular, of any rank, with values that coincide or nearly do."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(0, 1, (count, order))
    kind = np.arange(count) % 6
    values[kind == 1] = 10.0 ** rng.uniform(-18, 0, ((kind == 1).sum(), order))
    values[kind == 2] = 1.0
    values[kind == 2, -1] = 10.0 ** rng.uniform(-12, 0, (kind == 2).sum())
    near = 1 + 10.0 ** rng.uniform(-16, 0, ((kind == 3).sum(), order - 1))
    values[kind == 3, 1:] = values[kind == 3, 1:2] * near
    near = 1 + 10.0 ** rng.uniform(-16, 0, ((kind == 4).sum(), order - 1))
    values[kind == 4, : order - 1] = values[kind == 4, :1] * near
    turns = [np.linalg.qr(rng.normal(size=(count, order, order)))[0] for _ in range(2)]
    found = (turns[0] * values[:, None, :]) @ turns[1]
    found *= 10.0 ** rng.uniform(-30, 30, (count, 1, 1))
    found[5::60] = np.round(rng.normal(size=found[5::60].shape))  # singular ones, exactly
    found[11] = 0.0
    return found


def exact_indices(matrices, norm):
    """Return the index from LAPACK's singular values, whose error is a rounding of the largest."""
    values = np.linalg.svd(matrices, compute_uv=False)
    largest = values[:, :1]
    scaled = np.divide(values, largest, out=np.zeros_like(values), where=largest > 0)
    if norm == "2":
        return scaled[:, -1]
    inverse = (1 / np.maximum(scaled, 1e-140) ** 2).sum(axis=1)
    return np.where(scaled[:, 0] > 0, 1 / np.sqrt((scaled**2).sum(axis=1) * inverse + 1e-300), 0.0)


@pytest.mark.parametrize("norm", ["2", "fro"])
@pytest.mark.parametrize(
    ("order", "kernel", "still"), [(3, plain3, still9), (4, plain4, still16), (5, plain5, still25)]
)
def test_index_is_exact_near_singularity(order, kernel, still, norm):
    """The error of the index is below 1e-12 for every matrix."""
    recipe = program_text.Recipe(kernel, still, order**2, One, order, norm, (), (), 0)
    module = program_text.specialise(recipe)
    matrices = awkward_matrices(order, 60_000)
    poses = np.ascontiguousarray(matrices.reshape(len(matrices), -1).T)
    margin, lci = np.empty(len(matrices)), np.empty(len(matrices))
    module.field(poses, np.zeros(1), margin, lci, np.empty((recipe.scratch_rows, sweep.PITCH)))
    assert np.abs(lci - exact_indices(matrices, norm)).max() < 1e-12


@pytest.mark.parametrize("norm", ["2", "fro"])
def test_conditioning_of_six(monkeypatch, norm):
    """No mechanism here has six coordinates: the text itself, run as plain Python."""
    monkeypatch.setattr(conditioning, "ORDER", 6)
    matrices = awkward_matrices(6, 240)
    work = np.ascontiguousarray(matrices.reshape(len(matrices), -1).T)
    lci = np.empty(len(matrices))
    getattr(conditioning, f"inverse_conditions_{norm}")(work, len(matrices), lci)
    assert np.abs(lci - exact_indices(matrices, norm)).max() < 1e-12
