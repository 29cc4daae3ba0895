"""Kernel, inverse and forward kinematics and Jacobian of a mechanism against one another."""

from __future__ import annotations

import math

import numpy as np

from pmopt.analysis.kinematics.limits import of_limb
from pmopt.mechanisms.assembling import assemble_plainly
from pmopt.mechanisms.mechanism import InverseSolution, Matrix, Mechanism, Ranges, within
from pmopt.testing.findings import Comparison, Examination
from pmopt.testing.subject import Sample, Subject

#: Allowed deviation of numbers that come of one formula, and of differences.
EXACT, BY_DIFFERENCES = 1e-8, 1e-6
#: Least share of random poses that can be judged reachable or not.
_POSES = 60
#: A margin this small, as a share of the largest met, may be rounding on a limit.
_ON_LIMIT = 1e-9
#: Least index 1 / condition of a regular home.
_REGULAR = 1e-6
_ASSEMBLED = 3


def check_home(found: Examination, subject: Subject) -> None:
    """Home is reachable within the default limits and regular; samples are found at all."""
    mechanism = subject.mechanism
    with found.check(
        "home", "home", "home against inverse, the kernel's margin and its entries"
    ) as c:
        mode = mechanism.working_modes[0]
        c.at = subject.shown(subject.home, mode)
        solutions = mechanism.inverse(subject.parameters, subject.home)
        for solution in solutions:
            _named_as_declared(c, mechanism, solution)
        if c.require(any(s.working_mode == mode for s in solutions), "is not reachable"):
            margin, *entries = mechanism.kernel(
                *subject.home.values(), subject.constants(mode, subject.size, subject.limits)
            )
            c.require(
                margin >= 0, f"lies outside of the default limits: the margin is {margin:.3g}"
            )
            values = np.linalg.svd(
                np.reshape(entries, (subject.order, subject.order)), compute_uv=False
            )
            index = float(values[-1] / values[0])
            c.require(index > _REGULAR, f"is singular: the index 1 / condition is {index:.3g}")
    if c.wrong:
        return
    with found.check("reachable", "reach_box", "random poses of the box that are reachable") as c:
        for mode in subject.modes:
            count = sum(s.mode == mode for s in subject.samples)
            # Limits may leave other working modes nothing.
            c.require(
                count > 0 or mode != mechanism.working_modes[0],
                f"hardly a pose of the box is reachable ({mode})",
            )


def _named_as_declared(c: Comparison, mechanism: Mechanism, solution: InverseSolution) -> None:
    """Note names of a solution that are not those declared."""
    for given, declared in (
        (solution.joints, mechanism.joints),
        (solution.parasitic, mechanism.parasitic),
    ):
        wanted = [x.name for x in declared]
        c.require(
            list(given) == wanted,
            f"returns {', '.join(given) or 'nothing'} where {', '.join(wanted) or 'nothing'} is "
            "declared",
            "inverse",
        )


def check_line(found: Examination, subject: Subject) -> None:
    """Every reachable pose lies on the parts that the line leaves; parts ascend."""
    mechanism = subject.mechanism
    if mechanism.line is None:
        return
    axis = mechanism.line_axis
    name, unit = mechanism.pose[axis].name, mechanism.unit(mechanism.pose[axis])
    low, high = (float(end[axis]) for end in subject.box)
    with found.check("line", "line", "reachable poses on the parts that the line leaves") as c:
        for sample in subject.samples:
            c.at = subject.shown(sample.pose, sample.mode)
            constants = subject.constants(sample.mode, 1.0, subject.limits)
            flat = mechanism.line(*sample.pose.values(), low, high, constants)
            parts = [(a, b) for a, b in zip(flat[::2], flat[1::2], strict=True) if a < b]
            near = _ON_LIMIT * (high - low)
            value = sample.pose[mechanism.pose[axis].name]
            shown = ", ".join(f"{a:.6g} to {b:.6g}" for a, b in parts) or "nothing"
            c.require(
                any(a - near <= value <= b + near for a, b in parts),
                f"leaves {shown} {unit} of {name}, but a pose beside is reachable:",
            )
            ends = [end for part in parts for end in part]
            c.require(ends == sorted(ends), f"leaves {shown} {unit}, which do not ascend")


def _some_limits(subject: Subject, mode: str) -> Ranges:
    """Return limits of the actuated joints that cut into the workspace."""
    limits = {}
    solutions = [s.solution for s in subject.samples if s.mode == mode]
    for k, joint in enumerate(subject.mechanism.joints):
        values = [subject.joint_values(s, solutions[0])[k] for s in solutions]
        low, high = np.quantile(values, [0.15, 0.85]).tolist()
        if low < high:
            limits[joint.name] = (low, high)
    return limits


def check_margin(found: Examination, subject: Subject) -> None:
    """The kernel's margin is >= 0 exactly where inverse has a solution within the limits."""
    mechanism, params = subject.mechanism, subject.parameters
    compared = "sign of the kernel's margin against inverse and limits"
    with found.check("kernel-margin", "kernel", compared) as c:
        rows = subject.random_poses(_POSES, 0.1, 2)
        poses = [subject.named(row) for row in rows] + [s.pose for s in subject.samples]
        solved = [mechanism.inverse(params, pose) for pose in poses]
        for mode in subject.modes:
            if not any(s.mode == mode for s in subject.samples):
                continue
            for extra in ({}, _some_limits(subject, mode)):
                limits = {**subject.limits, **extra}
                constants = subject.constants(mode, 1.0, limits)
                margins = [mechanism.kernel(*pose.values(), constants)[0] for pose in poses]
                largest = max((abs(m) for m in margins if math.isfinite(m)), default=0.0)
                for pose, solutions, margin in zip(poses, solved, margins, strict=True):
                    if abs(margin) <= _ON_LIMIT * largest:
                        continue
                    beyond = _beyond(subject, pose, mode, limits, solutions)
                    c.at = subject.shown(pose, mode)
                    reason = beyond or "inverse has a solution within every limit"
                    c.require(
                        (margin >= 0) == (not beyond), f"the margin is {margin:.6g}, but {reason}"
                    )


def _beyond(
    subject: Subject,
    pose: dict[str, float],
    mode: str,
    limits: Ranges,
    solutions: tuple[InverseSolution, ...],
) -> str:
    """Return why a pose is not reachable in a working mode, "" where it is."""
    mechanism = subject.mechanism
    solution = next((s for s in solutions if s.working_mode == mode), None)
    if solution is None:
        return "inverse has no solution"
    if not mechanism.admits(subject.parameters, pose):
        return "pose_limits rule the pose out"
    for name, value in {**solution.passive, **solution.joints}.items():
        for coordinate in mechanism.limited:
            limit = limits.get(coordinate.name)
            if limit is None or not of_limb(coordinate.name, name):
                continue
            if not within(value, limit, coordinate.kind):
                unit = mechanism.unit(coordinate)
                return f"{name} = {value:.6g} {unit} is outside of {limit[0]:g} to {limit[1]:g}"
    return ""


def check_box(found: Examination, subject: Subject) -> None:
    """Nothing is reachable outside of the box."""
    mechanism = subject.mechanism
    lower, upper = subject.box
    with found.check("box", "reach_box", "reachable poses outside of the box of reach") as c:
        rows = subject.random_poses(12 * _POSES, 0.25, 3)
        roles = (*mechanism.roles, *[""] * subject.order)
        # Beyond half a turn, and half of that for the pitch, lies a pose that is also within.
        most = [
            math.inf if x.kind == "length" else math.pi / (2 if role == "pitch" else 1)
            for x, role in zip(mechanism.pose, roles, strict=False)
        ]
        turned = (np.abs(rows) > most).any(axis=1)
        outside = ((rows < lower) | (rows > upper)).any(axis=1)
        for mode in subject.modes:
            constants = subject.constants(mode, 1.0, subject.limits)
            for row in rows[outside & ~turned]:
                pose = subject.named(row)
                margin = mechanism.kernel(*pose.values(), constants)[0]
                if margin <= 0:
                    c.count += 1
                    continue
                # What is computed beyond the reach may end anywhere: inverse decides.
                solution = subject.solution(pose, mode)
                k = int(np.argmax(np.maximum(lower - row, row - upper)))
                x = mechanism.pose[k]
                c.at = subject.shown(pose, mode)
                c.require(
                    solution is None,
                    f"ends at {x.name} = {lower[k]:.6g} and {upper[k]:.6g} "
                    f"{mechanism.unit(x)}, but a pose beyond is reachable:",
                )


def _multiple(found: Matrix, wanted: Matrix) -> tuple[float, tuple[int, int], Matrix]:
    """Return the largest deviation of a matrix from a multiple of another, where, and scaled."""
    square = float((found * found).sum())
    factor = float((found * wanted).sum()) / square if square else math.nan
    scaled: Matrix = found * factor
    gap = np.abs(scaled - wanted)
    worst = divmod(int(np.argmax(np.where(np.isfinite(gap), gap, np.inf))), gap.shape[1])
    return float(gap[worst] / np.abs(wanted).max()), worst, scaled


def inverse_jacobian(subject: Subject, sample: Sample) -> Matrix:
    """Return what the velocity maps say: rates of actuated joints by those of the pose."""
    j_x, j_q = subject.mechanism.velocity_maps(
        subject.parameters, sample.pose, sample.solution.joints
    )
    return np.asarray(np.linalg.solve(j_q, j_x), dtype=np.float64)


def check_velocity_maps(found: Examination, subject: Subject) -> None:
    """The velocity maps are the slopes of the inverse kinematics, sign by sign."""
    mechanism = subject.mechanism
    compared = "J_q^-1 J_X against differences of inverse"
    n = subject.order
    with found.check("jacobian-differences", "velocity_maps", compared, BY_DIFFERENCES) as c:
        for sample in subject.samples:
            c.at = subject.shown(sample.pose, sample.mode)
            j_x, j_q = mechanism.velocity_maps(
                subject.parameters, sample.pose, sample.solution.joints
            )
            if not c.require(
                np.shape(j_x) == np.shape(j_q) == (n, n),
                f"have shapes {np.shape(j_x)} and {np.shape(j_q)}, {n} x {n} is needed",
            ):
                return
            inverse = inverse_jacobian(subject, sample)
            slopes, errors = np.full((n, n), np.nan), np.full((n, n), np.inf)
            for k in range(n):
                near = subject.neighbours(sample, k)
                if near:
                    values = [subject.joint_values(s, sample.solution) for _, s in near]
                    slopes[:, k], errors[:, k] = subject.slope(values, k)
            rows, columns = mechanism.homogenizing(subject.size)
            scale = columns[:, None] / rows  # everything a speed over a speed
            known = errors * scale < 1e-3 * np.abs(inverse * scale).max()
            if not known.any():
                continue
            # What differences leave open, by their error, is no deviation.
            gap = np.where(known, np.abs(slopes - inverse) - errors, 0.0).clip(0.0) * scale
            i, k = divmod(int(np.argmax(gap)), n)
            c.agree(
                float(gap[i, k] / np.abs(inverse * scale).max()),
                f"d{mechanism.joints[i].name}/d{mechanism.pose[k].name} is {inverse[i, k]:.6g} "
                f"{mechanism.unit(mechanism.joints[i])}/{mechanism.unit(mechanism.pose[k])}, "
                f"differences of inverse give {slopes[i, k]:.6g}",
            )


def check_entries(found: Examination, subject: Subject) -> None:
    """The kernel's entries are one multiple of the inverse Jacobian, with and without length."""
    mechanism = subject.mechanism
    compared = "entries against a multiple of J_q^-1 J_X"
    with found.check("kernel-jacobian", "kernel", compared, EXACT) as c:
        for length in (1.0, subject.size):
            rows, columns = mechanism.homogenizing(length)
            made: dict[str, tuple[float, ...]] = {}
            for sample in subject.samples:
                c.at = subject.shown(sample.pose, sample.mode)
                if sample.mode not in made:
                    made[sample.mode] = subject.constants(sample.mode, length, subject.limits)
                flat = mechanism.kernel(*sample.pose.values(), made[sample.mode])
                entries = np.reshape(np.array(flat[1:], dtype=float), (subject.order,) * 2)
                wanted = columns[:, None] * inverse_jacobian(subject, sample) / rows
                gap, (i, k), scaled = _multiple(entries, wanted)
                text = (
                    f"entry {i + 1}, {k + 1} ({mechanism.joints[i].name} by "
                    f"{mechanism.pose[k].name}) is {scaled[i, k]:.6g} where the velocity maps give "
                    f"{wanted[i, k]:.6g}, with the characteristic length {length:g} "
                    f"{mechanism.length_unit}"
                )
                c.agree(gap, text)


def check_determinant(found: Examination, subject: Subject) -> None:
    """The determinant of the entries changes sign with the forward measures, and only there."""
    mechanism = subject.mechanism
    compared = "sign of the entries' determinant against the forward measures"
    with found.check("singularity-sign", "singularity_measures", compared) as c:
        signs: dict[str, tuple[float, Sample]] = {}
        for sample in subject.samples:
            c.at = subject.shown(sample.pose, sample.mode)
            measures = mechanism.singularity_measures(
                subject.parameters, sample.pose, sample.solution.joints
            )
            for kind in ("inverse", "forward"):
                if not c.require(bool(measures.get(kind)), f"has no measure of kind {kind!r}"):
                    return
            for kind, parts in measures.items():
                for part, value in parts.items():
                    c.require(
                        abs(value) <= 1 + 1e-9, f"{kind}, {part} is {value:.6g}: -1 to 1 is allowed"
                    )
                    c.require(
                        bool(mechanism.condition(kind, part).strip()),
                        f"has no words for {kind}, {part}",
                        "conditions",
                    )
            size = np.abs(sample.entries).max()
            forward = measures["forward"]
            # Where there is one of the platform, the others are its factors.
            product = forward.get("platform", math.prod(forward.values()))
            sign = math.copysign(1, product * float(np.linalg.det(sample.entries / size)))
            if abs(product) < 1e-6:
                continue
            first, other = signs.setdefault(sample.mode, (sign, sample))
            c.require(
                first == sign,
                "the sign of the forward measures against that of the entries' determinant "
                f"is not the one it has{subject.shown(other.pose)}, though every change of "
                "sign is to be a forward singularity:",
            )


def check_forward(found: Examination, subject: Subject) -> None:
    """The forward kinematics leads back to the pose."""
    mechanism = subject.mechanism
    scale = np.array([subject.size if x.kind == "length" else 1.0 for x in mechanism.pose])
    with found.check("forward", "forward", "poses of forward against the pose", EXACT * 10) as c:
        for mode in subject.modes:
            for sample in [s for s in subject.samples if s.mode == mode][:_ASSEMBLED]:
                c.at = subject.shown(sample.pose, mode)
                solutions = _assembled(subject, sample)
                if not c.require(bool(solutions), "finds no pose with the joints"):
                    return
                gaps = [
                    max(
                        abs(_apart(value - sample.pose[x.name], x.kind)) / s
                        for value, x, s in zip(found_pose, mechanism.pose, scale, strict=True)
                    )
                    for found_pose in solutions
                ]
                c.agree(
                    min(gaps),
                    f"none of {len(gaps)} poses is the one the joints are of: the "
                    f"nearest is {min(gaps):.3g} characteristic lengths or rad off",
                )


def _assembled(subject: Subject, sample: Sample) -> list[list[float]]:
    """Return the poses of forward, coordinate by coordinate; an assembler is not compiled."""
    mechanism, joints = subject.mechanism, sample.solution.joints
    if mechanism.assembler is None:
        found = mechanism.forward(subject.parameters, joints)
        return [[f.pose[x.name] for x in mechanism.pose] for f in found]
    row = np.array([[joints[x.name] for x in mechanism.joints]])
    constants = np.array(mechanism.assembly_constants(subject.parameters), dtype=float)
    rows, counts = assemble_plainly(mechanism.assembler, row, constants)
    poses: list[list[float]] = rows[0, : max(int(counts[0, 0]), 0), : subject.order].tolist()
    return poses


def _apart(difference: float, kind: str) -> float:
    return math.remainder(difference, 2 * math.pi) if kind == "angle" else difference
