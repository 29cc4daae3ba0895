"""Layout, platform, posture and skeleton of a mechanism against one another."""

from __future__ import annotations

import math
import re

import numpy as np

from pmopt.analysis.kinematics.limits import of_limb
from pmopt.analysis.mobility import screws
from pmopt.mechanisms.mechanism import PLATFORM, Chain, Joint, Matrix, Vector
from pmopt.testing.declarations import ROLES
from pmopt.testing.findings import Examination
from pmopt.testing.kinematics import BY_DIFFERENCES, inverse_jacobian
from pmopt.testing.subject import Sample, Subject

#: Allowed deviation of points and axes, as a share of the mechanism's size.
_PLACED = 1e-8


def check_platform(found: Examination, subject: Subject) -> None:
    """The platform turns, and is where the pose coordinates' roles say."""
    mechanism = subject.mechanism
    with found.check("platform", "platform", "rotation, and place against roles", _PLACED) as c:
        for sample in subject.samples:
            c.at = subject.shown(sample.pose, sample.mode)
            rotation, place = mechanism.platform(subject.parameters, sample.pose, sample.mode)
            c.agree(
                float(np.abs(rotation @ rotation.T - np.eye(3)).max()),
                "returns a matrix that is no rotation",
            )
            c.require(float(np.linalg.det(rotation)) > 0, "returns a reflection")
            values = dict(zip(ROLES, _coordinates(rotation, place), strict=True))
            known = {**sample.pose, **sample.solution.parasitic}
            for role, coordinate in (
                *zip(mechanism.roles, mechanism.pose, strict=False),
                *zip(mechanism.parasitic_roles, mechanism.parasitic, strict=False),
            ):
                is_of = values.get(role, sample.solution.joints.get(role, np.nan))
                given = known[coordinate.name]
                gap = is_of - given
                if coordinate.kind == "angle":
                    gap = math.remainder(gap, 2 * math.pi)
                c.agree(
                    abs(gap) / (subject.size if coordinate.kind == "length" else 1.0),
                    f"{role} is {is_of:.6g} {mechanism.unit(coordinate)}, but {coordinate.name} is "
                    f"{given:.6g}",
                )


def _coordinates(rotation: Matrix, place: Vector) -> list[float]:
    """Return x, y, z, yaw, pitch, roll."""
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    return [
        *map(float, place),
        float(yaw),
        float(pitch),
        float(np.arctan2(rotation[2, 1], rotation[2, 2])),
    ]


def _platform_twists(subject: Subject, sample: Sample) -> tuple[Matrix, Matrix] | None:
    """Return the platform's twists by pose coordinates, from differences, and their errors.

    None at the edge of the reach.

    Scaled lengths, counted from the platform's centre.
    """
    mechanism = subject.mechanism
    rotation, place = mechanism.platform(subject.parameters, sample.pose, sample.mode)
    columns, errors = [], []
    for k in range(len(mechanism.pose)):
        near = subject.neighbours(sample, k)
        if not near:
            return None
        values = []
        for pose, _ in near:
            turned, moved = mechanism.platform(subject.parameters, pose, sample.mode)
            values.append(
                screws.small((turned @ rotation.T, (np.asarray(moved) - place) / subject.size))
            )
        slope, error = subject.slope(values, k)
        if error.max() > 1e-3 * np.abs(slope).max():
            return None
        columns.append(slope)
        errors.append(error)
    return np.array(columns).T, np.array(errors).T


def check_screws(found: Examination, subject: Subject) -> None:
    """The joints of the layout let the platform move as it does, and move with it as J says."""
    mechanism, n = subject.mechanism, subject.order
    names = [c.name for c in mechanism.joints]
    rows, columns = mechanism.homogenizing(subject.size)
    moved = subject.samples
    twists = {k: _platform_twists(subject, s) for k, s in enumerate(moved)}
    layouts = [mechanism.layout(subject.parameters, s.pose, s.mode) for s in moved]
    compared = "the platform's motion against the wrenches of every limb"
    with found.check("layout-motion", "layout", compared, BY_DIFFERENCES) as c:
        for k, sample in enumerate(moved):
            twist = twists[k]
            if twist is None:
                continue
            motion, error = twist
            c.at = subject.shown(sample.pose, sample.mode)
            for limb in _scaled(subject, sample, layouts[k]):
                wrenches = screws.reciprocal(screws.span(screws.limb_twists(limb)))
                held = np.vstack([wrenches[3:], wrenches[:3]]).T
                # What differences leave open, by their error, is no deviation.
                gap = (np.abs(held @ motion) - np.abs(held) @ error).clip(0.0)
                share = float((gap / np.abs(motion).max(axis=0)).max()) if gap.size else 0.0
                c.agree(
                    share,
                    f"the joints of {limb.name} do not let the platform move by "
                    f"the pose coordinates: {share:.3g} of a motion is ruled out",
                )
    if c.wrong:
        return
    compared = "J_q^-1 J_X against the screws of the layout"
    with found.check("jacobian-screws", "layout", compared, BY_DIFFERENCES) as c:
        for k, sample in enumerate(moved):
            twist = twists[k]
            if twist is None:
                continue
            motion, error = twist
            c.at = subject.shown(sample.pose, sample.mode)
            rates, open_ = np.full((n, n), np.nan), np.zeros((n, n))
            for limb in _scaled(subject, sample, layouts[k]):
                solve = np.linalg.pinv(screws.limb_twists(limb))
                solved, left = solve @ motion, np.abs(solve) @ error
                for name, column in screws.drive_columns(limb).items():
                    i = names.index(name)
                    length = subject.size if mechanism.joints[i].kind == "length" else 1.0
                    rates[i], open_[i] = solved[column] * length, left[column] * length
            inverse = inverse_jacobian(subject, sample)
            scale = columns[:, None] / rows
            gaps = (np.abs(rates - inverse) - open_).clip(0.0) * scale
            i, j = divmod(int(np.argmax(gaps)), n)
            unit = f"{mechanism.unit(mechanism.joints[i])}/{mechanism.unit(mechanism.pose[j])}"
            c.agree(
                float(gaps[i, j] / np.abs(inverse * scale).max()),
                f"by the joints d{names[i]}/d{mechanism.pose[j].name} is {rates[i, j]:.6g} {unit}, "
                f"by the velocity maps {inverse[i, j]:.6g}",
            )
    if mechanism.followed:
        _check_followed(found, subject, twists, layouts)
    compared = "number and kind of freedoms by the joints against those declared"
    with found.check("freedom", "freedom", compared) as c:
        for k, sample in enumerate(moved):
            spaces = [
                screws.span(screws.limb_twists(x)) for x in _scaled(subject, sample, layouts[k])
            ]
            common = screws.intersection(*spaces)
            c.at = subject.shown(sample.pose, sample.mode)
            if not c.require(
                common.shape[1] == n,
                f"the joints leave {common.shape[1]} freedoms, {n} pose coordinates are declared",
            ):
                continue
            # Parasitic motions come with others: there may be more, but not less than declared.
            for letter, part in (("R", common[:3]), ("T", common[3:])):
                named = re.search(rf"(\d){letter}", mechanism.freedom)
                wanted, left = int(named[1]) if named else 0, screws.rank(part)
                c.require(
                    left >= wanted,
                    f"{mechanism.freedom} is declared, the joints leave {left}{letter}",
                )


def _check_followed(
    found: Examination,
    subject: Subject,
    twists: dict[int, tuple[Matrix, Matrix] | None],
    layouts: list[tuple[Chain, ...]],
) -> None:
    """The passive joints that motions show move as the freedoms they are declared as."""
    mechanism = subject.mechanism
    compared = "rates of followed joints by the layout against differences of inverse"
    with found.check("followed", "followed", compared, BY_DIFFERENCES) as c:
        for k, sample in enumerate(subject.samples):
            motion = twists[k]
            if motion is None:
                continue
            c.at = subject.shown(sample.pose, sample.mode)
            rates = [
                np.linalg.pinv(screws.limb_twists(limb)) @ motion[0]
                for limb in _scaled(subject, sample, layouts[k])
            ]
            for name, terms in mechanism.followed.items():
                kinds = [x.kind for x in mechanism.passive if of_limb(x.name, name)]
                size = subject.size if kinds == ["length"] else 1.0
                about = sample.solution.passive[name]
                for j, coordinate in enumerate(mechanism.pose):
                    values = []
                    for _, solution in subject.neighbours(sample, j):
                        moved = solution.passive[name] - about
                        turned = math.remainder(moved, 2 * math.pi) if size == 1.0 else moved
                        values.append(np.array([turned / size]))
                    (slope,), (error,) = subject.slope(values, j)
                    rate = sum(weight * rates[limb][number, j] for limb, number, weight in terms)
                    scale = subject.size if coordinate.kind == "length" else 1.0
                    gap = max(abs(float(rate - slope)) - 2 * float(error), 0.0) * scale
                    c.agree(
                        gap / max(1.0, abs(float(slope)) * scale),
                        f"d{name}/d{coordinate.name} by the joints is {float(rate) * size:.6g}, by "
                        f"differences of inverse {float(slope) * size:.6g}",
                    )


def _scaled(subject: Subject, sample: Sample, chains: tuple[Chain, ...]) -> list[Chain]:
    place = subject.mechanism.platform(subject.parameters, sample.pose, sample.mode)[1]
    return [screws.scaled(chain, np.asarray(place, dtype=float), subject.size) for chain in chains]


def check_posture(found: Examination, subject: Subject) -> None:
    """The posture is platform, joints' positions and layout, number by number."""
    mechanism, unit = subject.mechanism, subject.mechanism.length_unit
    posture = mechanism.posture
    if posture is None:
        return
    with found.check("posture", "posture", "platform, joints and layout", _PLACED) as c:
        for sample in subject.samples:
            c.at = subject.shown(sample.pose, sample.mode)
            constants = subject.constants(sample.mode, 1.0, subject.limits)
            flat = np.array(posture(*sample.pose.values(), constants), dtype=float)
            rotation, place = mechanism.platform(subject.parameters, sample.pose, sample.mode)
            wanted: list[tuple[str, float, float]] = []
            wanted += [("the platform's place", float(v), subject.size) for v in place]
            wanted += [("the platform's rotation", float(v), 1.0) for v in np.ravel(rotation)]
            for joint in mechanism.joints:
                size = subject.size if joint.kind == "length" else 1.0
                wanted.append((joint.name, sample.solution.joints[joint.name], size))
            for name in mechanism.followed:
                kinds = [x.kind for x in mechanism.passive if of_limb(x.name, name)]
                size = subject.size if kinds == ["length"] else 1.0
                wanted.append((name, sample.solution.passive[name], size))
            chains = mechanism.layout(subject.parameters, sample.pose, sample.mode)
            for number, chain in enumerate(chains):
                for k, part in enumerate(chain.joints):
                    name = mechanism.joint_name(number, k, part.kind)
                    wanted += [(f"the point of {name}", float(v), subject.size) for v in part.point]
                    wanted += [(f"an axis of {name}", float(v), 1.0) for v in np.ravel(part.axes)]
                    bar = () if part.bar is None else part.bar
                    wanted += [(f"the bar of {name}", float(v), subject.size) for v in bar]
            for k, (what, value, size) in enumerate(wanted):
                shown = unit if size != 1.0 or what.startswith(("the point", "the bar")) else ""
                c.agree(
                    abs(flat[k] - value) / size,
                    f"number {k} ({what}) is {flat[k]:.6g}, not {value:.6g} {shown}".rstrip(),
                )


def check_skeleton(found: Examination, subject: Subject) -> None:
    """The skeleton's platform is the platform; its segments end where joints and others do."""
    mechanism, unit = subject.mechanism, subject.mechanism.length_unit
    row = mechanism.structure.skeleton_row
    declared = mechanism.structure.segments
    compared = "platform, segments and cones against platform and layout"
    with found.check("skeleton", "skeleton", compared, _PLACED) as c:
        for sample in subject.samples:
            c.at = subject.shown(sample.pose, sample.mode)
            constants = subject.constants(sample.mode, 1.0, subject.limits)
            flat = np.array(mechanism.skeleton(*sample.pose.values(), constants), dtype=float)
            rotation, place = mechanism.platform(subject.parameters, sample.pose, sample.mode)
            c.agree(
                float(np.abs(flat[row.place] - place).max() / subject.size),
                f"the platform is at {flat[row.place]} {unit}, not at {np.asarray(place)}",
            )
            c.agree(
                float(np.abs(flat[row.rotation].reshape(3, 3) - rotation).max()),
                "the platform's rotation is not that of platform",
            )
            segments = flat[row.segments].reshape(-1, 2, 3)
            chains = mechanism.layout(subject.parameters, sample.pose, sample.mode)
            for segment, (start, end) in zip(declared, segments, strict=True):
                which = f"the segment from {segment.start} to {segment.end}"
                if segment.limb == PLATFORM:
                    c.agree(
                        _distance(start, place) / subject.size,
                        f"{which} does not begin at the platform's centre",
                    )
                    limb = mechanism.limbs[segment.meets].name
                    far = [
                        ends[1]
                        for other, ends in zip(declared, segments, strict=True)
                        if other.limb == segment.meets
                    ]
                    gap = min((_distance(end, f) for f in far), default=np.inf)
                    c.agree(gap / subject.size, f"{which} ends {gap:.3g} {unit} off {limb}")
                    continue
                for what, point in (("begins", start), ("ends", end)):
                    chain = chains[segment.limb]
                    gap = min(_off(point, joint) for joint in chain.joints)
                    gap = min(gap, _distance(point, place))  # a link that is the platform
                    c.agree(
                        gap / subject.size,
                        f"{which} {what} {gap:.3g} {unit} off every joint of {chain.name}",
                    )
            cosines = flat[row.cones]
            c.require(bool((np.abs(cosines) <= 1 + 1e-9).all()), f"{cosines} are no cosines")
    with found.check("cones", "cones", "cone angles at home against 0", _PLACED) as c:
        mode = mechanism.working_modes[0]
        flat = np.array(
            mechanism.skeleton(*subject.home.values(), subject.constants(mode, 1.0, subject.limits))
        )
        for name, cosine in zip(mechanism.cones, flat[row.cones], strict=True):
            c.agree(abs(cosine - 1), f"{name} has the cosine {cosine:.6g} at home, 1 is declared")


def _distance(a: Vector, b: Vector) -> float:
    return float(np.linalg.norm(np.asarray(a) - b))


def _off(point: Vector, joint: Joint) -> float:
    """Return the distance of a point to a joint: to its axis where it slides along or is one."""
    rest = np.asarray(point) - joint.point
    gaps = [float(np.linalg.norm(rest))]
    if joint.kind in ("R", "P", "C"):
        gaps.append(float(np.linalg.norm(np.cross(joint.axes[0], rest))))
    if joint.bar is not None:
        gaps.append(float(np.linalg.norm(rest - joint.bar)))
    return min(gaps)
