"""Motion to second order and inverse dynamics, on every mechanism."""

import math
from functools import cache

import numpy as np
import pytest
from support.courses import MOVED, course

from pmopt.analysis.motion.dynamics import Mover, angular_motion
from pmopt.mechanisms import find
from pmopt.mechanisms.bodies import plate
from pmopt.mechanisms.mechanism import PLATFORM


@cache
def mover(name, loaded=True, mode=None):
    mechanism = find(name)
    parameters = mechanism.resolve({})
    bodies = mechanism.bodies(parameters)
    if loaded:
        unit = {"m": 1.0, "mm": 1e-3}[mechanism.length_unit]
        size = mechanism.characteristic_length(parameters)
        load = plate((0.3 * size, 0.2 * size, 0.1 * size), unit).at((0.1 * size, 0.05 * size, 0.0))
        bodies = (*bodies, load.body("payload"))
    return Mover(mechanism, parameters, mode or mechanism.working_modes[0], bodies)


def stencil(function, t, h):
    """Return the derivative by differences of 8th order."""
    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    return (
        sum(w * (function(t + k * h) - function(t - k * h)) for k, w in enumerate(weights, 1)) / h
    )


T = np.linspace(0.0, 5.0, 40)


@pytest.mark.parametrize("name", MOVED)
def test_posture_is_the_layout(name):
    mechanism = find(name)
    parameters = mechanism.resolve({})
    for mode in mechanism.working_modes[:2]:
        constants = mechanism.kernel_constants(parameters, mode, 1.0, {})
        for pose in course(name, T[:6])[0]:
            given = dict(zip([c.name for c in mechanism.pose], pose.tolist(), strict=True))
            solution = next(
                (s for s in mechanism.inverse(parameters, given) if s.working_mode == mode), None
            )
            if solution is None:
                continue
            found = np.array(mechanism.posture(*pose, constants))
            rotation, centre = mechanism.platform(parameters, given, mode)
            expected = [*centre, *rotation.ravel(), *solution.joints.values()]
            expected += [solution.passive[k] for k in mechanism.followed]
            for chain in mechanism.layout(parameters, given, mode):
                for joint in chain.joints:
                    expected += [*joint.point, *np.ravel(joint.axes)]
                    expected += [] if joint.bar is None else [*joint.bar]
            # The foot of a cylindrical joint's axis may lie anywhere on it.
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(centre).max())


@pytest.mark.parametrize("name", MOVED)
def test_rates_and_accelerations_are_derivatives(name):
    moving = mover(name)
    unit = moving.unit
    mechanism = moving.mechanism
    state = moving.state(*course(name, T))
    assert state.valid.all()
    h = 2e-3
    factor = moving.si(mechanism.joints)
    passive = find(name).followed
    lengths = np.array([unit if k == "l1" else 1.0 for k in passive])

    def at(t):
        return moving.state(*course(name, t))

    def platform(t, order):
        return at(t).platform[:, order]

    for found, values in (
        (state.joint_rates, lambda t: at(t).joints * factor),
        (state.joint_accelerations, lambda t: at(t).joint_rates),
        (state.passive_rates, lambda t: at(t).passive * lengths),
        (state.passive_accelerations, lambda t: at(t).passive_rates),
        (state.platform[:, 1], lambda t: platform(t, 0)),
        (state.platform[:, 2], lambda t: platform(t, 1)),
        (state.centres[:, :, 1], lambda t: at(t).centres[:, :, 0]),
        (state.centres[:, :, 2], lambda t: at(t).centres[:, :, 1]),
    ):
        if found.size:
            size = np.abs(found).max()
            np.testing.assert_allclose(found, stencil(values, T, h), rtol=0, atol=3e-9 * size)


@pytest.mark.parametrize("name", MOVED)
def test_pose_coordinates_come_back(name):
    moving = mover(name)
    poses, rates, accelerations = course(name, T)
    state = moving.state(poses, rates, accelerations)
    roles = ("x", "y", "z", "yaw", "pitch", "roll")
    factor = moving.si(moving.mechanism.pose)
    for k, role in enumerate(moving.mechanism.roles):
        for order, given in enumerate((poses, rates, accelerations)):
            wanted = given[:, k] * factor[k]
            if role in roles:
                found = state.platform[:, order, roles.index(role)]
            else:
                j = [c.name for c in moving.mechanism.joints].index(role)
                found = (state.joints * moving.si(moving.mechanism.joints), state.joint_rates,
                         state.joint_accelerations)[order][:, j]  # fmt: skip
            np.testing.assert_allclose(
                found, wanted, rtol=0, atol=1e-11 * (1 + np.abs(wanted).max())
            )


@pytest.mark.parametrize("name", MOVED)
def test_inverse_jacobian_is_that_of_the_velocity_maps(name):
    moving = mover(name)
    mechanism = moving.mechanism
    parameters = mechanism.resolve({})
    poses, rates, accelerations = course(name, T[:5])
    found = moving.state(poses, rates, accelerations).inverse_jacobian
    scale = np.outer(moving.si(mechanism.joints), 1 / moving.si(mechanism.pose))
    for pose, inverse in zip(poses, found, strict=True):
        given = dict(zip([c.name for c in mechanism.pose], pose.tolist(), strict=True))
        joints = mechanism.inverse(parameters, given)[0].joints
        j_x, j_q = mechanism.velocity_maps(parameters, given, joints)
        np.testing.assert_allclose(
            inverse, np.linalg.solve(j_q, j_x) * scale, rtol=0, atol=1e-10 * np.abs(inverse).max()
        )


@pytest.mark.parametrize("name", MOVED)
def test_power_in_is_the_change_of_energy(name):
    moving = mover(name)
    state = moving.state(*course(name, T))
    power = (state.efforts * state.joint_rates).sum(axis=1)

    def energy(t):
        now = moving.state(*course(name, t))
        return now.kinetic + now.potential

    np.testing.assert_allclose(
        power, stencil(energy, T, 2e-3), rtol=0, atol=1e-9 * np.abs(power).max()
    )


@pytest.mark.parametrize("name", MOVED)
def test_mass_matrix_gives_kinetic_energy_and_the_part_of_acceleration(name):
    moving = mover(name)
    poses, rates, accelerations = course(name, T[:8])
    factor = moving.si(moving.mechanism.pose)
    state = moving.state(poses, rates, accelerations, masses=True)
    matrix = state.mass_matrix
    np.testing.assert_allclose(matrix, matrix.transpose(0, 2, 1), rtol=0, atol=1e-13 * matrix.max())
    assert (np.linalg.eigvalsh(matrix) > 0).all()
    speed = rates * factor
    kinetic = np.einsum("ni,nij,nj->n", speed, matrix, speed) / 2
    np.testing.assert_allclose(state.kinetic, kinetic, rtol=1e-11)
    still = moving.state(poses, rates, 0 * accelerations)
    more = np.einsum("nij,nj->ni", matrix, accelerations * factor)
    found = np.einsum("nji,nj->ni", state.inverse_jacobian, state.efforts - still.efforts)
    whole = np.einsum("nji,nj->ni", np.abs(state.inverse_jacobian), np.abs(state.efforts))
    np.testing.assert_allclose(found, more, rtol=0, atol=1e-12 * whole.max())


@pytest.mark.parametrize("name", MOVED)
def test_standing_still_holds_the_weight(name):
    """Efforts at rest are the slope of potential energy by the joints."""
    moving = mover(name)
    poses = course(name, T[:4])[0]
    none = np.zeros_like(poses)
    state = moving.state(poses, none, none)
    factor = moving.si(moving.mechanism.pose)
    slope = np.empty_like(poses)
    for k in range(poses.shape[1]):
        step = np.zeros(poses.shape[1])
        step[k] = 1e-3 / factor[k]

        def potential(h, step=step):
            return moving.state(poses + h * step, none, none).potential

        weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
        slope[:, k] = sum(
            w * (potential(i) - potential(-i)) for i, w in enumerate(weights, 1)
        ) / 1e-3  # fmt: skip
    found = np.einsum("nji,nj->ni", state.inverse_jacobian, state.efforts)
    np.testing.assert_allclose(found, slope, rtol=0, atol=1e-8 * np.abs(slope).max())


@pytest.mark.parametrize("name", MOVED)
def test_bytes_do_not_depend_on_threads(name):
    moving = mover(name)
    t = np.linspace(0, 5, 5000)
    results = []
    for threads in (1, 2, 3):
        moving.threads = threads
        results.append(moving.state(*course(name, t)).efforts.tobytes())
    moving.threads = 2
    assert results[0] == results[1] == results[2]


def t1(t):
    """Trajectory T1 of 2UU-UPU, nearest feasible to the paper's eq. (16)."""
    w, slow, deg = math.pi / 6, math.pi / 8, math.pi / 180
    fast = w * t - math.pi / 3
    return (
        np.stack([0.175 + 0.025 * np.sin(w * t), deg * (3 + 16 * np.sin(fast)),
                  deg * (0.2 + 0.5 * np.cos(slow * t))], axis=1),
        np.stack([0.025 * w * np.cos(w * t), deg * 16 * w * np.cos(fast),
                  -deg * 0.5 * slow * np.sin(slow * t)], axis=1),
        np.stack([-0.025 * w**2 * np.sin(w * t), -deg * 16 * w**2 * np.sin(fast),
                  -deg * 0.5 * slow**2 * np.cos(slow * t)], axis=1),
    )  # fmt: skip


def test_numbers_of_2uu_upu_on_t1():
    state = mover("2uu-upu", loaded=False).state(*t1(np.array([0.0, 1.0, 5.0])))
    expected = [
        [-4.6520881682, -3.3707134927, -1.0977351632],
        [-4.1571294192, -3.8992031137, -1.0162085370],
        [-2.8442344263, -4.4348006345, -0.0060174475],
    ]
    np.testing.assert_allclose(state.efforts, expected, rtol=0, atol=6e-11)
    q = np.stack([state.joints[:, 1], state.passive[:, 3], state.passive[:, 4]], axis=1)
    expected = [[0.8677374626, 0.0185584334, -1.0573162488],
                [0.9584721777, 0.00024859047544, -0.6268596308]]  # fmt: skip
    np.testing.assert_allclose(q[[0, 2]], expected, rtol=0, atol=6e-11)
    rates = [state.joint_rates[0, 1], *state.passive_rates[0, 3:]]
    np.testing.assert_allclose(
        rates, [0.0768806873, 0.0019438870, -0.0037830608], rtol=0, atol=6e-11
    )
    lengths = mover("2uu-upu", loaded=False).state(*t1(np.linspace(0, 24, 2401))).passive[:, 0]
    assert round(lengths.min(), 4) == 0.1634
    assert round(lengths.max(), 4) == 0.2727


def test_numbers_of_2uu_upu_at_state_s():
    """q = (phi, kappa, psi) with rates and accelerations, through the pose they belong to."""
    moving = mover("2uu-upu", loaded=False)
    q, dq, ddq = (np.array(v) for v in ((0.5, 0.05, -0.4), (1, 0.2, -0.5), (2, -1, 3)))
    pose = np.array([0.0994700610, 0.1004292481, 0.0440972621])

    def coordinates(state):
        return np.array([state.joints[0, 1], *state.passive[0, 3:]])

    def state(pose, rate=(0, 0, 0), change=(0, 0, 0)):
        return moving.state(pose[None], np.array([rate]), np.array([change]))

    def slopes(pose):
        """dq/dX column by column, from the rates by unit pose rates."""
        columns = [state(pose, e) for e in np.eye(3)]
        return np.array([[s.joint_rates[0, 1], *s.passive_rates[0, 3:]] for s in columns]).T

    for _ in range(3):
        pose = pose - np.linalg.solve(slopes(pose), coordinates(state(pose)) - q)
    rate = np.linalg.solve(slopes(pose), dq)
    still = state(pose, rate)
    bias = np.array([still.joint_accelerations[0, 1], *still.passive_accelerations[0, 3:]])
    change = np.linalg.solve(slopes(pose), ddq - bias)
    found = state(pose, rate, change)
    place = [*found.platform[0, 0, :3], *pose[1:]]
    expected = [0.0994700610, 0.0874655011, 0.1950997181, 0.1004292481, 0.0440972621]
    np.testing.assert_allclose(place, expected, rtol=0, atol=6e-11)
    expected = [0.4025836316, 0.5, 0.4529319134]
    np.testing.assert_allclose(found.joints[0], expected, rtol=0, atol=6e-11)
    l1, eta1, delta2 = found.passive[0, :3]
    np.testing.assert_allclose(
        [l1, eta1, delta2], [0.2100670872, 0.4112843791, 0.2796861593], rtol=0, atol=6e-11
    )
    np.testing.assert_allclose(
        found.efforts[0], [-7.9093812814, 5.2866001595, -5.1196863333], rtol=0, atol=6e-10
    )
    by_q = np.linalg.inv(slopes(pose))
    matrix = moving.state(pose[None], rate[None], change[None], masses=True).mass_matrix[0]
    matrix = by_q.T @ matrix @ by_q
    # The models' page prints M33 as .0547930146; by hand, from its own masses, it is .0547930154.
    np.testing.assert_allclose(
        matrix[np.triu_indices(3)],
        [0.3270944691, 0.1899681551, 0.0862788375, 9.9373635424, 0.2131480520, 0.0547930154],
        rtol=0, atol=6e-10,
    )  # fmt: skip
    force = by_q.T @ found.inverse_jacobian[0].T @ found.efforts[0]
    np.testing.assert_allclose(
        force, [-7.5009887549, -32.4673263638, -3.2874128822], rtol=0, atol=6e-10
    )


def test_numbers_of_3_cur():
    """The motion under the drives of the paper's eq. (16), at t = 0.1."""
    moving = mover("3-cur", loaded=False)
    t, w = 0.1, 2 * math.pi
    angle = np.array([w * t + 0.5 * math.pi, w * t - math.pi / 2, w * t])
    # 10 cos(2 pi t + pi / 2), 10 sin(2 pi t), 10 cos(2 pi t), mm
    h = 0.1 + 0.01 * np.cos(angle)
    dh, ddh = -0.01 * w * np.sin(angle), -0.01 * w * w * np.cos(angle)
    pose = np.array([0.3392979163, 0.0431494353, -0.0062939152])
    zero = np.zeros((1, 3))
    for _ in range(4):
        now = moving.state(pose[None], zero, zero)
        pose = pose - np.linalg.solve(now.inverse_jacobian[0], now.joints[0] - h)
    rate = np.linalg.solve(now.inverse_jacobian[0], dh)
    bias = moving.state(pose[None], rate[None], zero).joint_accelerations[0]
    change = np.linalg.solve(now.inverse_jacobian[0], ddh - bias)
    found = moving.state(pose[None], rate[None], change[None])
    np.testing.assert_allclose(found.joint_accelerations[0], ddh, rtol=0, atol=1e-12)
    expected = [0.0101258570, 0.0015164963, 0.3392979163, -0.00013876195, 0.0431494353,
                -0.0062939152]  # fmt: skip
    np.testing.assert_allclose(found.platform[0, 0], expected, rtol=0, atol=6e-11)
    expected = [0.0452984852, -0.0601470025, -0.0140885315]
    np.testing.assert_allclose(found.platform[0, 1, :3], expected, rtol=0, atol=6e-11)
    expected = [-0.3994986577, -0.0611743426, -0.1138695480]
    np.testing.assert_allclose(found.platform[0, 2, :3], expected, rtol=0, atol=6e-11)
    expected = [[0.2498842818, 0.1956238505, -0.0059187832],
                [0.2092769442, -1.7265722571, 0.0034709293]]  # fmt: skip
    np.testing.assert_allclose(angular_motion(found.platform)[0], expected, rtol=0, atol=6e-10)


@pytest.mark.parametrize("name", MOVED)
def test_bodies_are_declared_whole(name):
    mechanism = find(name)
    parameters = mechanism.resolve({})
    bodies = mechanism.bodies(parameters)
    assert any(body.limb == PLATFORM for body in bodies)
    assert len({body.name for body in bodies}) == len(bodies)
    for body in bodies:
        assert body.mass > 0
        assert body.source
        moments = np.linalg.eigvalsh(body.inertia)
        assert moments[0] > 0
        assert moments[2] <= moments[0] + moments[1]
