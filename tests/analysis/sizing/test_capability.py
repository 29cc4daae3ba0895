"""What motors a workspace asks for: bounds against sampled directions, volumes, the command."""

import json

import numpy as np
import pytest
from support.cli_runner import error_line, here, json_answer
from support.courses import MOVED, course

import pmopt as package
from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sizing.actuators import Demands, Task, compute_capability
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.mechanisms.bodies import point_mass

T = np.linspace(0.0, 1.0, 5)


def directions(mechanism, speed, turn, count, rng):
    """Return pose rates of the given sizes in random directions."""
    rates = np.zeros((count, len(mechanism.pose)))
    for kind, size in (("length", speed), ("angle", turn)):
        columns = [k for k, c in enumerate(mechanism.pose) if c.kind == kind]
        v = rng.standard_normal((count, len(columns)))
        if columns:
            rates[:, columns] = size * v / np.linalg.norm(v, axis=1, keepdims=True)
    return rates


@pytest.mark.parametrize("name", MOVED)
@pytest.mark.slow
def test_no_direction_asks_for_more_and_some_for_nearly_as_much(name):
    mechanism = find(name)
    parameters = mechanism.resolve({})
    mode = mechanism.working_modes[0]
    size = mechanism.characteristic_length(parameters)
    load = point_mass(3.0, (0.1 * size, 0.0, 0.2 * size))
    bodies = (*mechanism.bodies(parameters), load.body("payload"))
    mover = Mover(mechanism, parameters, mode, bodies)
    rng = np.random.default_rng(len(name))
    n, count = len(mechanism.joints), 4000
    for pose in course(name, T, swing=0.05)[0][:3]:
        poses = np.repeat(pose[None], count, axis=0)
        speeds = directions(mechanism, 2.0 * size, 0.7, count, rng)
        changes = directions(mechanism, 9.0 * size, 4.0, count, rng)
        none = np.zeros_like(speeds)
        moved = mover.state(poses, speeds, none)
        rates = np.abs(moved.joint_rates / mover.si(mechanism.joints)).max(axis=0)
        accelerated = np.abs(mover.state(poses, none, changes).efforts).max(axis=0)
        both = np.abs(mover.state(poses, speeds, changes).efforts).max(axis=0)
        at = pose[:, None]

        def asked(at=at, **task):
            return Demands(mechanism, parameters, mode, Task(payload=load, **task)).at(at)[:, 0]

        fast = asked(speed=2.0 * size, turn=0.7)
        still = asked(acceleration=9.0 * size, angular_acceleration=4.0)
        whole = asked(speed=2.0 * size, turn=0.7, acceleration=9.0 * size, angular_acceleration=4.0)
        assert (rates <= fast[:n] * (1 + 1e-12)).all()
        assert (rates >= 0.85 * fast[:n]).all()
        assert (accelerated <= still[n:] * (1 + 1e-12)).all()
        assert (accelerated >= 0.85 * still[n:]).all()
        assert (both <= whole[n:] * (1 + 1e-12)).all()


def test_a_force_in_any_direction_is_the_transposed_jacobian():
    """2PaUU-PPaP only translates: tau = J^T F."""
    mechanism = find("2pauu-ppap")
    parameters = mechanism.resolve({})
    poses = course("2pauu-ppap", T)[0].T
    plain = Demands(mechanism, parameters, "out-out", Task(), bodies=()).at(poses)
    pressed = Demands(mechanism, parameters, "out-out", Task(force=7.0), bodies=()).at(poses)
    np.testing.assert_array_equal(plain, 0)
    for k, pose in enumerate(poses.T):
        given = dict(zip("xyz", pose.tolist(), strict=True))
        joints = mechanism.inverse(parameters, given)[0].joints
        j_x, j_q = mechanism.velocity_maps(parameters, given, joints)
        jacobian = np.linalg.solve(j_x, j_q)
        np.testing.assert_allclose(pressed[3:, k], 7 * np.linalg.norm(jacobian, axis=0), rtol=1e-10)


def test_volumes_shrink_with_the_motors_and_agree_with_the_share():
    mechanism = find("3-cur")
    parameters = mechanism.resolve({})

    def run(limits, **more):
        task = Task(speed=0.5, turn=1.0)
        return compute_capability(
            mechanism, parameters, WorkspaceSettings(), task, limits, samples=16384, **more
        )

    free = run({})
    assert free.capable == free.volume
    assert free.share.value == 1
    # The fraction that the median of a demand leaves is a half.
    median = free.demands[0].levels[0]
    half = run({"h1_rate": median.value})
    assert half.share.value == pytest.approx(0.5, abs=1e-3)
    assert half.capable.value == pytest.approx(half.demands[0].volume.value)
    assert half.capable.value == pytest.approx(half.share.value * half.volume.value)
    less = run({"h1_rate": median.value, "h2_effort": free.demands[4].levels[0].value})
    assert 0 < less.capable.value < half.capable.value
    other = run({"h1_rate": median.value}, seed=2)
    error = np.hypot(half.capable.error, other.capable.error)
    assert abs(half.capable.value - other.capable.value) < 5 * error
    assert run({"h1_rate": median.value}, threads=1).to_dict() == half.to_dict()


def test_from_python_it_is_the_command(tmp_path):
    found = package.capability(
        "3-cur", motors={"h1_rate": 0.4}, payload=2.0, payload_centre=(0.0, 0.0, 0.1), speed=0.3,
        turn=0.5, samples=16384, workspace={"domain": {"beta": (-0.3, 0.3)}},
    )  # fmt: skip
    words = [
        "--motors",
        "h1_rate=0.4",
        "--payload",
        2,
        "--payload-centre",
        "0,0,0.1",
        "--speed",
        0.3,
        "--turn",
        0.5,
        "--samples",
        16384,
        "--domain",
        "beta=-0.3:0.3",
    ]
    document = json_answer("capability", "3-cur", *words, cwd=tmp_path)
    assert found.to_dict() == document


def test_command_writes_its_folder_and_refuses_in_one_line(tmp_path):
    out = tmp_path / "run"
    document = json_answer(
        "capability", "2uu-upu", "--payload", "1", "--speed", "0.2", "--samples", "16384",
        "--motors", "theta1_effort=20,phi_effort=20", "--out", out, cwd=tmp_path,
    )  # fmt: skip
    assert 0 < document["share"]["value"] < 1
    assert document["share"]["standard_error"] > 0
    assert document == json.loads((out / "result.json").read_text())
    assert (out / "capability.png").read_bytes()[:4] == b"\x89PNG"
    drawn = (out / "capability.png").read_bytes()
    assert here("plot", out, cwd=tmp_path).returncode == 0
    assert (out / "capability.png").read_bytes() == drawn
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["units"]["theta1_effort"] == "N m"
    for words, told in (
        (["--motors", "theta_effort=3"], "theta1_effort"),
        (["--motors", "phi_rate=-1"], "a number > 0"),
        (["--speed", "-1"], "--speed: -1.0 is not allowed"),
        (["--payload-centre", "1,2"], "three numbers X,Y,Z are needed"),
    ):
        assert told in error_line(here("capability", "2uu-upu", *words, cwd=tmp_path))


def test_nothing_reachable_or_next_to_nothing(tmp_path):
    words = ("capability", "2pauu-ppap", "--samples", "2000", "--motors", "theta1_rate=3")
    line = error_line(here(*words, "--params", "m=100", "--quiet", cwd=tmp_path), code=3)
    assert "nothing is reachable: parameters: m=100 m leaves nothing" in line
    # Some replicates meet none of it.
    small = "n=0.85,l1=0.0083,c=0.082,m=1.131"
    few = json_answer(*words, "--quiet", "--params", small, cwd=tmp_path)
    assert 0 < few["reachable"] < 100


# --- the platform itself --------------------------------------------------------------------


def twist_maps(mover, mechanism, pose):
    """Return A and W by central differences of the platform's place; see analysis.twists."""
    d = len(pose)
    factor = mover.si(mechanism.pose)
    none = np.zeros((1, d))
    columns = []
    for k in range(d):
        step = 1e-5 / factor[k]
        ends = []
        for sign in (1, -1):
            at = pose.copy()
            at[k] += sign * step
            ends.append(mover.state(at[None], none, none).platform[0, 0])
        rotations = [turned(*e[3:]) for e in ends]
        spin = (rotations[0] - rotations[1]) @ turned(*(ends[0] + ends[1])[3:] / 2).T / 2e-5
        columns.append([*((ends[0] - ends[1])[:3] / 2e-5), spin[2, 1], spin[0, 2], spin[1, 0]])
    maps = np.array(columns).T
    return maps[:3], maps[3:]


def turned(yaw, pitch, roll):
    a, b, c = np.cos([yaw, pitch, roll])
    p, q, r = np.sin([yaw, pitch, roll])
    return np.array([[a * b, a * q * r - p * c, a * q * c + p * r],
                     [p * b, p * q * r + a * c, p * q * c - a * r],
                     [-q, b * r, b * c]])  # fmt: skip


def least_other(reached, kept, wanted):
    """Return rates with ``reached x`` nearest to what is wanted, and least ``|kept x|``, slowly."""
    heavy = np.vstack([1e7 * reached, kept])
    return np.linalg.lstsq(heavy, np.concatenate([1e7 * wanted, np.zeros(3)]), rcond=1e-14)[0]


@pytest.mark.parametrize("name", MOVED)
def test_the_platform_in_any_direction_that_it_can_move(name):
    """No motion of the sizes asks for more, and some for nearly as much, by brute force."""
    mechanism = find(name)
    parameters = mechanism.resolve({})
    mode = mechanism.working_modes[0]
    size = mechanism.characteristic_length(parameters)
    bodies = mechanism.bodies(parameters)
    mover = Mover(mechanism, parameters, mode, bodies)
    si = mover.unit * size
    rng = np.random.default_rng(7)
    n = len(mechanism.joints)
    for pose in course(name, T, swing=0.05)[0][1:3]:
        point, turn = twist_maps(mover, mechanism, pose)

        def asked(pose=pose, **task):
            return Demands(mechanism, parameters, mode, Task(**task)).at(pose[:, None])[:, 0]

        def moved(rates, pose=pose):
            """Return the largest joint rates and efforts of pose rates in m and rad."""
            x = np.array(rates) / mover.si(mechanism.pose)
            state = mover.state(np.repeat(pose[None], len(x), axis=0), x, np.zeros_like(x))
            joints = np.abs(state.joint_rates / mover.si(mechanism.joints)).max(axis=0)
            return joints, np.abs(state.efforts).max(axis=0)

        for reached, kept, task in (
            (point, turn, {"point_speed": 0.4 * size}), (turn, point, {"rotation_speed": 0.5}),
        ):  # fmt: skip
            amount = 0.4 * si if reached is point else 0.5
            rank = np.linalg.matrix_rank(reached, tol=1e-5 * np.linalg.norm(reached))
            basis = np.linalg.svd(reached)[0][:, :rank]
            draws = rng.standard_normal((600, rank)) if rank else np.zeros((1, 0))
            draws /= np.linalg.norm(draws, axis=1, keepdims=True) + (0 if rank else 1)
            rates = [least_other(reached, kept, amount * basis @ u) for u in draws]
            joints, efforts = moved(rates)
            found = asked(**task)
            assert (joints <= found[:n] * (1 + 1e-4) + 1e-9).all(), (name, task)
            assert (joints >= 0.85 * found[:n] - 1e-9).all(), (name, task)
            assert (efforts <= found[n:] * (1 + 1e-4) + 1e-9).all(), (name, task)
        # Both: rates in all directions, as large as one of the sizes allows.
        x = rng.standard_normal((20_000, n))
        x[::2] = x[::2] @ np.diag(1 / np.linalg.norm(np.vstack([point / (0.4 * si), turn / 0.5]),
                                                     axis=0))  # fmt: skip
        scale = np.maximum(np.linalg.norm(x @ point.T, axis=1) / (0.4 * si),
                           np.linalg.norm(x @ turn.T, axis=1) / 0.5)  # fmt: skip
        joints, efforts = moved(x / scale[:, None])
        found = asked(point_speed=0.4 * size, rotation_speed=0.5)
        assert (joints <= found[:n] * (1 + 1e-4)).all(), name
        assert (joints >= 0.8 * found[:n]).all(), name
        assert (efforts <= found[n:] * (1 + 1e-4) + 1e-9).all(), name


def test_where_a_platform_only_translates_the_centre_is_the_pose():
    mechanism = find("2pauu-ppap")
    parameters = mechanism.resolve({})
    poses = course("2pauu-ppap", T)[0].T

    def asked(**task):
        return Demands(mechanism, parameters, "out-out", Task(**task)).at(poses)

    np.testing.assert_allclose(
        asked(point_speed=0.7, point_acceleration=3.0), asked(speed=0.7, acceleration=3.0),
        rtol=1e-9,
    )  # fmt: skip
    still = asked()
    np.testing.assert_array_equal(asked(rotation_speed=2.0, rotation_acceleration=2.0), still)


def test_what_moves_is_said(tmp_path):
    told = here("capability", "3-cur", "--speed", 1, "--samples", 4096, cwd=tmp_path).stdout
    assert "speed: of z alone" in told
    told = here("capability", "4-ups-rps", "--speed", 1, "--samples", 4096, cwd=tmp_path).stdout
    assert "speed: of the vector of x, y in any direction" in told
    document = json_answer("capability", "3-cur", "--point-speed", 1, "--samples", 4096,
                           cwd=tmp_path)  # fmt: skip
    assert document["moved"][0].startswith("point speed: the centre")
    assert document["units"]["rotation_acceleration"] == "rad/s^2"
    for words, why in (
        (["--speed", 1, "--point-speed", 1], "exclude each other"),
        (["--payload-centre", "0,0,1"], "payload only"),
    ):
        assert why in error_line(here("capability", "3-cur", *words, cwd=tmp_path))
    with pytest.raises(InputError, match="nearest: speed"):
        package.capability("3-cur", speeed=1.0)
