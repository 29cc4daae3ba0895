"""Forward kinematics of all mechanisms: every pose comes back, near singularities too."""

import csv
import json
import math
import subprocess

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.cli_runner import COMMAND, csv_answer, environment, error_line, here, json_answer

from pmopt import api
from pmopt.analysis.kinematics.conditioning import homogenize, inverse_condition
from pmopt.analysis.kinematics.forward import Assembling, forward_kinematics
from pmopt.errors import InputError, UnreachableError
from pmopt.kernels import octics
from pmopt.mechanisms import find, names
from pmopt.mechanisms.assembling import assemble_rows
from pmopt.mechanisms.catalogue import ups_rps_forward
from pmopt.mechanisms.catalogue.ups_rps import MECHANISM as RPS
from pmopt.numerics.rotation import rotation_matrices


def place(mechanism, solution):
    """Return rotation and other coordinates of a pose with its parasitic ones."""
    values = dict(zip(mechanism.roles, solution.pose.values(), strict=True))
    values |= dict(zip(mechanism.parasitic_roles, solution.parasitic.values(), strict=True))
    angles = [[values.pop(k, 0.0) for k in ("yaw", "pitch", "roll")]]
    return rotation_matrices(np.array(angles))[0][0], np.array(list(values.values()))


def apart(mechanism, size, one, other):
    (r, p), (s, q) = place(mechanism, one), place(mechanism, other)
    return max(np.abs(r - s).max(), np.abs(p - q).max() / size)


class Asked:
    """A pose with the parasitic coordinates of a working mode."""

    def __init__(self, pose, solution):
        self.pose, self.parasitic = pose, solution.parasitic


def scaled(mechanism, values, declared, scale):
    kinds = {c.name: c.kind for c in declared}
    return {k: v * scale if kinds[k] == "length" and v is not None else v
            for k, v in values.items()}  # fmt: skip


def design(mechanism, rng):
    """Return random dimensions within bounds that can be assembled at home."""
    bounded = [p for p in mechanism.parameters if p.bounds]
    while True:
        params = mechanism.resolve({p.name: float(rng.uniform(*p.bounds)) for p in bounded})
        if mechanism.inverse(params, mechanism.home(params)):
            return params


def some_pose(mechanism, params, rng):
    lower, upper = mechanism.reach_box(params, mechanism.default_limits(params))
    domain = mechanism.default_domain(params)
    values = {}
    for c, low, high in zip(mechanism.pose, lower, upper, strict=True):
        least, most = domain.get(c.name, (-math.inf, math.inf))
        values[c.name] = float(rng.uniform(max(low, least), min(high, most)))
    return values


def index_at(mechanism, params, pose, solution):
    j_x, j_q = mechanism.velocity_maps(params, pose, solution.joints)
    try:
        jacobian = np.linalg.solve(j_x, j_q)
    except np.linalg.LinAlgError:
        return 0.0
    size = mechanism.characteristic_length(params)
    return inverse_condition(homogenize(mechanism, jacobian, size), "2")


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32), scale=st.sampled_from([1.0, 1e-3, 1e3]))
@pytest.mark.parametrize("name", names())
def test_every_pose_comes_back(name, seed, scale):
    """In every working mode, of designs within bounds, in any unit of length."""
    mechanism, rng = find(name), np.random.default_rng(seed)
    params = design(mechanism, rng)
    cases = []
    while len(cases) < 8:
        pose = some_pose(mechanism, params, rng)
        cases += [(pose, s) for s in mechanism.inverse(params, pose)]
    big = scaled(mechanism, params, mechanism.parameters, scale)
    size = 4 * mechanism.characteristic_length(big)
    rows = [scaled(mechanism, s.joints, mechanism.joints, scale) for _, s in cases]
    for (pose, s), found in zip(cases, mechanism.assemblies(big, rows), strict=True):
        asked = Asked(scaled(mechanism, pose, mechanism.pose, scale), s)
        asked.parasitic = scaled(mechanism, s.parasitic, mechanism.parasitic, scale)
        # Near a singularity what rounding of the joints leaves of the pose.
        lci = index_at(mechanism, params, pose, s)
        allowed = max(1e-8, 1e-12 / max(lci, 1e-6))
        assert min(apart(mechanism, size, asked, f) for f in found.solutions) < allowed
        assert max(f.residual for f in found.solutions) < 1e-11 * size
        assert len(found.solutions) <= mechanism.assembler.modes


def towards_a_singularity(mechanism, params, rng, index):
    """Return a pose at which the LCI has a value, on a line to a forward singularity."""
    for _ in range(200):
        ends = []
        while len(ends) < 2:
            pose = some_pose(mechanism, params, rng)
            ends += [(pose, s) for s in mechanism.inverse(params, pose)][:1]
        (a, first), (b, _) = ends
        mode = first.working_mode

        def at(t, a=a, b=b, mode=mode):
            pose = {k: a[k] + t * (b[k] - a[k]) for k in a}
            for s in mechanism.inverse(params, pose):
                if s.working_mode == mode:
                    measures = mechanism.singularity_measures(params, pose, s.joints)
                    return pose, s, measures["forward"]["platform"]
            return pose, None, math.nan

        start, end = at(0.0)[2], at(1.0)[2]
        if not start * end < 0:
            continue
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if at(middle)[2] * start > 0 else (low, middle)
        step = 1e-4
        for _ in range(5):
            pose, solution, _ = at(low - step)
            if low < step or solution is None:
                break
            lci = index_at(mechanism, params, pose, solution)
            if 0.5 < lci / index < 2:
                return pose, solution
            step *= index / max(lci, 1e-12)
    raise AssertionError("no singularity found")


@pytest.mark.parametrize("index", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("name", names())
def test_a_pose_near_a_singularity_comes_back_and_its_twin_is_another(name, index):
    """Two assembly modes run together there; neither hides the other."""
    mechanism, rng = find(name), np.random.default_rng(5)
    for _ in range(2):
        params = design(mechanism, rng)
        pose, s = towards_a_singularity(mechanism, params, rng, index)
        size = 4 * mechanism.characteristic_length(params)
        asked = Asked(pose, s)
        (found,) = mechanism.assemblies(params, [s.joints])
        gaps = sorted(apart(mechanism, size, asked, f) for f in found.solutions)
        assert gaps[0] < max(1e-8, 1e-14 / index)
        # Of 2uu-upu the twin may lie behind theta1's axis.
        if index < 1e-3 and (name != "2uu-upu" or len(gaps) > 1):
            # The twin is as far as the singularity is near: not the same, and not missing.
            assert 1e-3 * index < gaps[1] < 3e4 * index
        near = forward_kinematics(mechanism, params, s.joints, near=pose).solutions
        assert len(near) == 1
        assert apart(mechanism, size, asked, near[0]) == gaps[0]


def test_near_level_poses_of_3_ups_sp_are_told_apart():
    """Level poses are singular: eight modes, three of which are within 0.3 degrees of level."""
    pose = {"phi": 0.3, "theta": 0.003, "psi": 0.0015, "l4": 60.0}
    (solution,) = api.ik("3-ups-sp", pose).solutions
    found = api.fk("3-ups-sp", solution.joints, near=pose)
    assert found.solutions[0].pose == pytest.approx(pose, abs=1e-11)
    every = api.fk("3-ups-sp", solution.joints)
    assert len(every.solutions) == 8
    assert every.complete == "proven"


def test_near_counts_both_ways_to_write_a_rotation():
    """Rz(a) Ry(b) Rx(c) = Rz(a + pi) Ry(pi - b) Rx(c + pi)."""
    pose = {"phi": 0.1, "theta": 0.2, "psi": -0.15, "l4": 60.0}
    other = {"phi": 0.1 + math.pi, "theta": math.pi - 0.2, "psi": math.pi - 0.15, "l4": 60.0}
    joints = api.ik("3-ups-sp", other).solutions[0].joints
    assert api.fk("3-ups-sp", joints, near=other).solutions[0].pose == pytest.approx(pose)


@pytest.mark.parametrize("name", names())
def test_many_at_once_give_the_bytes_of_each_alone(name, monkeypatch):
    mechanism, rng = find(name), np.random.default_rng(3)
    params = mechanism.resolve({})
    rows = []
    while len(rows) < 300:
        found = mechanism.inverse(params, some_pose(mechanism, params, rng))
        rows += [s.joints for s in found]
    places = [str(k) for k in range(len(rows))]
    solver = Assembling(mechanism, params)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    one = solver.at(rows, places)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert solver.at(rows, places) == one
    for k in range(0, 300, 37):
        assert repr(forward_kinematics(mechanism, params, rows[k])) == repr(one[k])


@pytest.mark.parametrize("name", [n for n in names() if n != "4-ups-rps"])
def test_machine_code_has_the_digits_of_the_text(name):
    """No multiplication is fused with an addition: results do not depend on the processor."""
    mechanism, rng = find(name), np.random.default_rng(4)
    params = design(mechanism, rng)
    rows = []
    while len(rows) < 10:
        found = mechanism.inverse(params, some_pose(mechanism, params, rng))
        rows += [list(s.joints.values()) for s in found]
    how = mechanism.assembler
    constants = np.array(mechanism.assembly_constants(params))
    compiled, counts = assemble_rows(how, np.array(rows), constants)
    for k, row in enumerate(rows):
        plain = np.zeros((how.modes, how.columns))
        count, proven = how.assemble(np.array(row), constants, plain, np.zeros(how.work))
        assert (count, proven) == tuple(counts[k])
        assert (plain[:count] == compiled[k, :count]).all()


@pytest.mark.parametrize("name", names())
@pytest.mark.slow
def test_kept_machine_code_runs_in_another_process(name, tmp_path):
    """Loaded without numba, it refers to nothing of it."""
    mechanism = find(name)
    params = mechanism.resolve({})
    (s, *_) = mechanism.inverse(params, mechanism.home(params))
    first = mechanism.forward(params, s.joints)[0].pose  # compiled here at the latest
    joints = ",".join(f"{k}={v!r}" for k, v in s.joints.items())
    done = subprocess.run(
        [*COMMAND, "fk", name, "--joints", joints, "--format", "csv"],
        env=environment(), cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    row = next(csv.DictReader(done.stdout.splitlines()))
    assert {k: float(row[k]) for k in first} == first


def test_joint_positions_that_leave_the_platform_free():
    """P3 in B2 with a link as long as the platform's side: they turn about it together."""
    params = {"bs": 0.25, "ps": 0.25, "L": 0.25}
    flat = {"theta1": 0.3, "phi": 0.2, "delta3": math.pi / 2}
    with pytest.raises(InputError, match="free to move"):
        api.fk("2uu-upu", flat, params)
    with pytest.raises(UnreachableError):
        api.fk("2uu-upu", flat, {**params, "ps": 0.26})


@pytest.mark.parametrize("name", ["3-ups-sp", "4-ups-rps"])
def test_a_negative_length_does_not_assemble(name):
    joints = api.ik(name, find(name).home(find(name).resolve({}))).solutions[0].joints
    with pytest.raises(UnreachableError, match="cannot be assembled"):
        api.fk(name, {**joints, "l2": -joints["l2"]})


# --- what completeness rests on -------------------------------------------------------------


@given(
    st.lists(st.floats(-1.4, 1.4), min_size=0, max_size=8, unique=True),
    st.integers(0, 2**32),
)
def test_roots_of_degree_8(roots, seed):
    """Every real root is in the answer, and the bound is no less than their number."""
    rng = np.random.default_rng(seed)
    if len(roots) % 2:
        roots = roots[:-1]
    pairs = rng.uniform((-1.5, 0.5), (1.5, 3.5), (4 - len(roots) // 2, 2))
    nodes = np.array(octics.nodes())
    values = np.ones(9)
    for root in roots:
        values *= nodes - root
    for real, imaginary in pairs:
        values *= (nodes - real) ** 2 + imaginary**2
    error = 1e-14 * np.abs(values).max()
    found = np.zeros(2 * octics.octic_MOST)
    stack = np.zeros(octics.octic_DEPTH * octics.octic_ROW)
    count, bound = octics.octic_roots(values, error, np.array(octics.bernstein()), stack, found)
    inside = [r for r in roots if abs(r) < 1 - 1e-9]
    places = found[: 2 * count : 2]
    widths = found[1 : 2 * count : 2]
    for root in inside:
        assert (np.abs(places - root) <= 0.5 * widths + 1e-6).any()
    assert bound >= len(inside)
    gaps = np.diff(sorted([*roots, -1.0, 1.0]))
    if (gaps > 0.02).all():
        assert bound == len(inside)
        assert (widths == 0.0).all()


def test_start_solutions_of_4_ups_rps():
    """All 18 solve the equations at the general dimensions; Newton's method finds no other."""
    rps = ups_rps_forward
    whole = np.array(rps.DIMENSIONS)
    k = rps.rps_coefficients(rps.Dimensions(*(whole[::2] + 1j * whole[1::2]).tolist()))
    known = []
    for start in np.reshape(rps.STARTS, (rps.rps_PATHS, 12)):
        found = rps.rps_corrected(rps.rps_load(start, 0), k, 6, 1e-14)
        assert found.first < 1e-5
        assert found.last < 1e-13
        known.append(np.array(found.state))
    mirror = np.repeat([1.0, -1.0], 3)
    rng = np.random.default_rng(1)
    hits = set()
    for _ in range(400):
        state = rps.rps_load(rng.normal(size=12) * np.repeat([1.0, 1.0, 1.0, 1.0, 1.0, 4.0], 2), 0)
        for _ in range(40):
            step = rps.rps_solve(state, k, rps.rps_missed(state, k))
            share = min(1.0, 0.5 / math.sqrt(step.moved / step.size))
            state = rps.State(*(np.array(state) + share * np.array(step.change)).tolist())
        if not step.moved < 1e-24 * step.size:
            continue
        end = np.array(state)
        gaps = [min(np.abs(end - x).max(), np.abs(end * mirror - x).max()) for x in known]
        assert min(gaps) < 1e-8
        hits.add(int(np.argmin(gaps)))
    assert len(hits) > 12


@pytest.mark.slow
@pytest.mark.parametrize("name", ["3-cur", "3-ups-sp", "4-ups-rps"])
def test_a_dense_search_finds_no_other_mode(name):
    """Newton's method on J = J_X^-1 J_q by the mechanism's own inverse, from many poses."""
    mechanism, rng = find(name), np.random.default_rng(11)
    for _ in range(3):
        params = design(mechanism, rng)
        size = 4 * mechanism.characteristic_length(params)
        solutions = ()
        while not solutions:
            solutions = mechanism.inverse(params, some_pose(mechanism, params, rng))
        wanted = solutions[0].joints
        found = mechanism.forward(params, wanted)
        for _ in range(300):
            pose = some_pose(mechanism, params, rng)
            if "gamma" in pose:
                pose["gamma"] = float(rng.uniform(-math.pi, math.pi))
            end = newton(mechanism, params, pose, wanted, size)
            if end is not None:
                assert min(apart(mechanism, size, end, f) for f in found) < 1e-6


def newton(mechanism, params, pose, wanted, size):
    """Return the pose with these joint positions that Newton's method leads to, if any."""
    mode = None
    for _ in range(30):
        solutions = mechanism.inverse(params, pose)
        chosen = [s for s in solutions if mode in (None, s.working_mode)]
        if not chosen:
            return None
        s = chosen[0]
        mode = s.working_mode
        gap = np.array([wanted[k] - v for k, v in s.joints.items()])
        if np.abs(gap).max() < 1e-11 * size:
            return Asked(pose, s)
        try:
            step = np.linalg.solve(*mechanism.velocity_maps(params, pose, s.joints)) @ gap
        except np.linalg.LinAlgError:
            return None
        units = [size if c.kind == "length" else 1.0 for c in mechanism.pose]
        share = min(1.0, 0.2 / max(np.abs(step / units).max(), 1e-300))
        pose = {k: v + share * float(d) for (k, v), d in zip(pose.items(), step, strict=True)}
    return None


def test_dimensions_at_which_a_coefficient_is_lost():
    """R1 = sqrt 5 R / sqrt 2: P_y does not follow from q_y and p_z."""
    params = RPS.resolve({"R": 500.0, "R1": math.sqrt(2.5) * 500.0})
    pose = {"x": 850.0, "y": 40.0, "alpha": 0.1, "beta": -0.05, "gamma": 1.4}
    found = RPS.forward(params, RPS.inverse(params, pose)[0].joints)
    assert min(max(abs(f.pose[k] - pose[k]) for k in pose) for f in found) < 1e-7
    assert max(f.residual for f in found) < 1e-9


# --- on the command line ----------------------------------------------------------------------


def test_the_answer_says_whether_it_is_complete(tmp_path):
    args = ("fk", "4-ups-rps", "--joints", "l1=1036,l2=1017,l3=1004,l4=1004,l5=1017")
    assert json_answer(*args, cwd=tmp_path)["complete"] == "not proven"
    assert {r["complete"] for r in csv_answer(*args, cwd=tmp_path)} == {"not proven"}
    table = here(*args, cwd=tmp_path).stdout
    assert "not proven" in table
    assert "complete: the real ends of 18 paths" in table


def test_near_on_the_command_line(tmp_path):
    args = (
        "--joints", "l1=62.23854070485956,l2=64.52483985019612,l3=62.368450605253344,l4=60",
        "--near", "phi=0.3,theta=0.003,psi=0.0015,l4=60",
    )  # fmt: skip
    (row,) = csv_answer("fk", "3-ups-sp", *args, cwd=tmp_path)
    assert float(row["phi"]) == pytest.approx(0.3, abs=1e-10)
    assert float(row["theta"]) == pytest.approx(0.003, abs=1e-10)
    assert row["complete"] == "proven"


@pytest.mark.parametrize("form", ["json", "csv"])
@pytest.mark.parametrize("name", names())
def test_one_mode_gives_what_all_give_of_it(name, form, tmp_path):
    """Whether limits are kept or not, of one pose and of many: the same answers and exit codes."""
    mechanism, rng = find(name), np.random.default_rng(2)
    params = mechanism.resolve({})
    poses = [mechanism.home(params), some_pose(mechanism, params, rng)]
    poses += [some_pose(mechanism, params, rng) for _ in range(2)]
    with (tmp_path / "poses.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(poses[0]))
        writer.writeheader()
        writer.writerows(poses)

    def answers(*args):
        result = here("ik", name, *args, "--format", form, cwd=tmp_path)
        if form == "csv":
            return list(csv.DictReader(result.stdout.splitlines())), result
        documents = json_or_none(result.stdout)
        documents = documents if isinstance(documents, list) else [documents]
        return [s for d in documents if d for s in d["solutions"]], result

    def json_or_none(text):
        return json.loads(text) if text.strip() else None

    def of(mode, rows):
        return [r for r in rows if r["working_mode"] == mode]

    for pose in poses:
        shown = ",".join(f"{k}={v!r}" for k, v in pose.items())
        every, whole = answers("--pose", shown)
        for mode in mechanism.working_modes:
            some, result = answers("--pose", shown, "--working-mode", mode)
            assert some == of(mode, every)
            if some:
                assert result.returncode == whole.returncode
                assert result.stderr == whole.stderr
                for row in some:
                    kept = row["within_limits"] in (True, "true")
                    assert kept == (not row.get("beyond"))
            else:
                assert result.returncode == 2
    every, _ = answers("--poses", "poses.csv")
    for mode in mechanism.working_modes:
        some, _ = answers("--poses", "poses.csv", "--working-mode", mode)
        assert of(mode, some) == of(mode, every)


def test_a_mode_beyond_its_stroke_is_listed_with_its_miss(tmp_path):
    """up-up-up is within every limit, the others are not; asked for alone they are listed too."""
    args = ("ik", "3-cur", "--pose", "z=0.35,beta=0.25,gamma=0.15")
    one = json_answer(*args, "--working-mode", "up-up-down", cwd=tmp_path)
    (solution,) = one["solutions"]
    assert solution["within_limits"] is False
    h3 = solution["beyond"][0]
    assert h3["name"] == "h3"
    assert (h3["lower"], h3["upper"], h3["unit"]) == (0.0, 0.3, "m")
    assert h3["miss"] == pytest.approx(solution["joints"]["h3"] - 0.3, abs=1e-15)
    (row,) = csv_answer(*args, "--working-mode", "up-up-down", cwd=tmp_path)
    assert row["beyond"].startswith("h3 = 0.578368 m misses [0, 0.3] m by 0.278368 m (too far)")
    far = here("ik", "3-ups-sp", "--pose", "phi=0,theta=0.1,psi=0.1,l4=95", cwd=tmp_path)
    assert "l4 by 5 mm" in far.stdout
    assert "limb 4, l4 = 95 mm misses its stroke [45, 90] mm by 5 mm" in error_line(far)


@pytest.mark.parametrize("name", names())
def test_cells_are_plain_numbers(name, tmp_path):
    """Of every command on a pose; the reader refuses what is no shortest float."""
    mechanism = find(name)
    home = mechanism.home(mechanism.resolve({}))
    pose = ",".join(f"{k}={v + 0.01!r}" for k, v in home.items())
    rows = csv_answer("ik", name, "--pose", pose, cwd=tmp_path)
    joints = ",".join(f"{j.name}={rows[0][j.name]}" for j in mechanism.joints)
    assert csv_answer("fk", name, "--joints", joints, cwd=tmp_path)
    assert csv_answer("jacobian", name, "--pose", pose, cwd=tmp_path)
    assert csv_answer("info", name, cwd=tmp_path)
