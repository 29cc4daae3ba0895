"""Names, numbers and lengths of what a mechanism declares: read before anything is compiled."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from pmopt.analysis.mobility.screws import FREEDOMS
from pmopt.compiler import program_text
from pmopt.compiler.program_text import Recipe
from pmopt.compiler.records import flat, size
from pmopt.mechanisms.mechanism import PLATFORM, Chain, JointKind, Mechanism
from pmopt.testing.findings import Comparison, Examination
from pmopt.testing.subject import Subject

#: What a pose coordinate can be of the platform, beside an actuated joint.
ROLES = ("x", "y", "z", "yaw", "pitch", "roll")
#: Axes of each kind of joint.
AXES: dict[JointKind, int] = {"R": 1, "P": 1, "C": 1, "U": 2, "S": 0, "Pa": 1}
#: Names that mean something else on the command line and in files, and endings that do.
_TAKEN = (
    "tool_x", "tool_y", "tool_z", "volume", "projected_volume", "footprint", "t", "time",
    "residual", "characteristic_length", "space", "duration", "step", "constants",
)  # fmt: skip
_ENDINGS = ("_deg", "_rate", "_acceleration", "_effort", "_power")
_NAME = re.compile(r"[^\W\d]\w*")
_WIDE = 1e-9


def check_words(found: Examination, mechanism: Mechanism) -> None:
    """Names, kinds, units and references: nothing is computed."""
    groups: dict[str, Sequence[Any]] = {
        "parameters": mechanism.parameters,
        "pose": mechanism.pose,
        "joints": mechanism.joints,
        "passive": mechanism.passive,
        "parasitic": mechanism.parasitic,
    }
    with found.check("names", "parameters", "names of parameters, coordinates and limbs") as c:
        owner: dict[str, str] = {}
        for place, group in groups.items():
            for member in group:
                name = str(member.name)
                c.require(
                    bool(_NAME.fullmatch(name)),
                    f"{name!r} is no name: letters, digits and _ are allowed",
                    place,
                )
                taken = name in _TAKEN or name.endswith(_ENDINGS)
                c.require(not taken, f"the name {name!r} is taken: it means something else", place)
                # A joint's position may be a pose coordinate: both then have its name.
                same = place == "joints" and name in mechanism.roles and owner.get(name) == "pose"
                c.require(
                    name not in owner or same, f"{name!r} is also one of {owner.get(name)}", place
                )
                owner[name] = place
        limbs = [limb.name for limb in mechanism.limbs]
        c.require(len(set(limbs)) == len(limbs), f"limbs of one name: {limbs}", "limbs")
        modes = mechanism.working_modes
        c.require(bool(modes), "there is no working mode", "working_modes")
        c.require(len(set(modes)) == len(modes), f"twice the same: {modes}", "working_modes")
    with found.check("kinds", "pose", "kinds of coordinates and parameters, defaults, bounds") as c:
        for place in ("pose", "joints", "passive", "parasitic"):
            for member in groups[place]:
                c.require(
                    member.kind in ("length", "angle"),
                    f"{member.name} has the kind {member.kind!r}: length or angle is allowed",
                    place,
                )
        _parameters(c, mechanism)
        c.require(
            mechanism.length_unit in ("m", "mm"),
            f"{mechanism.length_unit!r} is no unit: m or mm is allowed",
            "length_unit",
        )
        c.require(
            mechanism.default_jacobian in ("raw", "homogenized"),
            f"{mechanism.default_jacobian!r} is not raw or homogenized",
            "default_jacobian",
        )
    with found.check(
        "counts", "joints", "coordinates, roles, segments, cones against another"
    ) as c:
        _counts(c, mechanism)


def _parameters(c: Comparison, mechanism: Mechanism) -> None:
    for p in mechanism.parameters:
        c.require(
            p.kind in ("length", "angle", "ratio"),
            f"{p.name} has the kind {p.kind!r}: length, angle or ratio is allowed",
            "parameters",
        )
        if p.default is not None:
            c.require(
                p.accepts(p.default),
                f"{p.name}: the default {p.default:g} {mechanism.unit(p)} is not allowed: "
                f"{p.allowed()}",
                "parameters",
            )
        if p.bounds is not None:
            low, high = p.bounds
            c.require(
                low < high and p.accepts(low) and p.accepts(high),
                f"{p.name}: the bounds {low:g} to {high:g} {mechanism.unit(p)} are not within "
                f"what is allowed: {p.allowed()}",
                "parameters",
            )


def _counts(c: Comparison, mechanism: Mechanism) -> None:
    n, joints = len(mechanism.pose), {j.name for j in mechanism.joints}
    c.require(
        n == len(mechanism.joints) > 0,
        f"{n} pose coordinates, {len(mechanism.joints)} actuated joints: as many are needed",
        "pose",
    )
    c.require(n <= 6, f"{n} pose coordinates: a platform has 6 freedoms", "pose")
    counted = sum(int(count) for count, _ in re.findall(r"(\d)([TR])", mechanism.freedom))
    c.require(
        counted == n,
        f"{mechanism.freedom} are {counted} freedoms, the pose has {n} coordinates",
        "freedom",
    )
    for place, roles, named in (
        ("roles", mechanism.roles, mechanism.pose),
        ("parasitic_roles", mechanism.parasitic_roles, mechanism.parasitic),
    ):
        if mechanism.roles:
            c.require(
                len(roles) == len(named), f"{len(roles)} roles for {len(named)} coordinates", place
            )
        for role in roles:
            c.require(
                role in ROLES or role in joints,
                f"{role!r} is no role: {', '.join(ROLES)} or an actuated joint",
                place,
            )
        c.require(len(set(roles)) == len(roles), f"twice the same: {roles}", place)
    limbs = [limb.name for limb in mechanism.limbs]
    chains = [chain.name for chain in mechanism.structure.chains]
    c.require(
        limbs == chains, f"chains of {', '.join(chains)}, limbs are {', '.join(limbs)}", "structure"
    )
    called = {name for limb in mechanism.limbs for name in limb.joint_names}
    for name in mechanism.cones if called else ():
        c.require(name in called, f"{name!r} is no joint of a limb", "cones")
    c.require(
        mechanism.vertical in (0, 1, 2),
        f"{mechanism.vertical} is no axis of the base: 0, 1, 2 are",
        "vertical",
    )
    c.require(
        len(mechanism.down) == 3 and abs(math.hypot(*mechanism.down) - 1) < 1e-9,
        f"{mechanism.down} is no unit vector",
        "down",
    )
    if mechanism.line is not None:
        c.require(
            0 <= mechanism.line_axis < n,
            f"{mechanism.line_axis} is no pose coordinate: 0 to {n - 1} are",
            "line_axis",
        )
        c.require(mechanism.line_parts > 0, f"{mechanism.line_parts} parts of a line", "line_parts")


def check_ranges(found: Examination, subject: Subject) -> None:
    """Limits, domain, box, home and characteristic length at the defaults."""
    mechanism, params = subject.mechanism, subject.parameters
    pose = [c.name for c in mechanism.pose]
    with found.check("ranges", "default_limits", "names and order of limits, domain and box") as c:
        for place, ranges, allowed in (
            ("default_limits", subject.limits, [x.name for x in mechanism.limited]),
            ("default_domain", mechanism.default_domain(params), pose),
            ("pose_limits", mechanism.pose_limits(params), pose),
        ):
            for name, (low, high) in ranges.items():
                c.require(name in allowed, f"{name!r} is not one of {', '.join(allowed)}", place)
                c.require(low < high, f"{name} from {low:g} to {high:g} is empty", place)
        c.require(
            list(subject.home) == pose,
            f"{', '.join(subject.home)} is given, {', '.join(pose)} is the pose",
            "home",
        )
        c.require(
            all(math.isfinite(v) for v in subject.home.values()),
            f"{subject.home} is not finite",
            "home",
        )
        c.require(
            math.isfinite(subject.size) and subject.size > 0,
            f"{subject.size:g} {mechanism.length_unit} is no length",
            "characteristic_length",
        )
        lower, upper = subject.box
        c.require(
            lower.shape == upper.shape == (len(pose),),
            f"bounds of shape {lower.shape} and {upper.shape} for {len(pose)} coordinates",
            "reach_box",
        )
        c.require(
            bool(np.isfinite([*lower, *upper]).all() and (lower < upper).all()),
            f"{lower} to {upper} is empty or not finite",
            "reach_box",
        )


def check_kernel_lengths(found: Examination, subject: Subject) -> None:
    """Lengths of the constants and of what the kernel returns of them."""
    mechanism, n = subject.mechanism, subject.order
    home = tuple(subject.home.values())
    with found.check("constants", "constants", "length of kernel_constants") as c:
        for each in mechanism.working_modes:
            given = flat(subject.constants(each, 1.0, subject.limits))
            count = size(mechanism.constants)
            if not c.require(
                len(given) == count,
                f"{mechanism.constants.__name__} has {count} numbers, but kernel_constants returns "
                f"{len(given)} numbers ({each})",
            ):
                break
            c.require(
                all(isinstance(v, int | float | np.floating) for v in given),
                f"{given} are not all numbers",
                "kernel_constants",
            )
    if c.wrong:
        return
    with found.check("kernel-length", "kernel", "length of what the kernel returns") as c:
        constants = subject.constants(mechanism.working_modes[0], 1.0, subject.limits)
        row = mechanism.kernel(*home, constants)
        c.require(
            len(row) == 1 + n * n,
            f"returns {len(row)} numbers: the margin and {n} x {n} entries are {1 + n * n}",
        )
        c.require(all(math.isfinite(v) for v in row), f"returns {row} at home")


def check_lengths(found: Examination, subject: Subject) -> None:
    """Lengths of all other tuples that compiled programs take apart, at home."""
    mechanism, n = subject.mechanism, subject.order
    mode = mechanism.working_modes[0]
    home = tuple(subject.home.values())
    constants = subject.constants(mode, 1.0, subject.limits)
    with found.check("skeleton-length", "skeleton", "length of what the skeleton returns") as c:
        wanted = mechanism.structure.skeleton_row.size
        row = mechanism.skeleton(*home, constants)
        c.require(
            len(row) == wanted,
            f"returns {len(row)} numbers: platform, {len(mechanism.structure.segments)} segments "
            f"and {len(mechanism.cones)} cones are {wanted}",
        )
    if mechanism.line is not None:
        with found.check("line-length", "line", "length of what the line returns") as c:
            axis = mechanism.line_axis
            row = mechanism.line(*home, subject.box[0][axis], subject.box[1][axis], constants)
            c.require(
                len(row) == 2 * mechanism.line_parts,
                f"returns {len(row)} numbers: {mechanism.line_parts} parts have "
                f"{2 * mechanism.line_parts} ends",
            )
    with found.check(
        "layout", "layout", "limbs and joints of the layout against what is declared"
    ) as c:
        chains = mechanism.layout(subject.parameters, subject.home, mode)
        _layout(c, subject, chains)
    if c.wrong:
        return
    if mechanism.posture is not None:
        with found.check("posture-length", "posture", "length of what the posture returns") as c:
            wanted = mechanism.structure.posture_row.size
            row = mechanism.posture(*home, constants)
            c.require(
                len(row) == wanted,
                f"returns {len(row)} numbers: platform, {n} actuated and "
                f"{len(mechanism.followed)} followed joints and the layout are {wanted}",
            )
    with found.check("bodies", "bodies", "masses, inertias and joints of bodies") as c:
        _bodies(c, subject, chains)


def _layout(c: Comparison, subject: Subject, chains: Sequence[Chain]) -> None:
    mechanism = subject.mechanism
    c.require(
        len(chains) == len(mechanism.limbs),
        f"has {len(chains)} limbs, {len(mechanism.limbs)} are declared",
    )
    driven: list[str] = []
    seen: list[str] = []
    for number, (limb, chain) in enumerate(zip(mechanism.limbs, chains, strict=False)):
        named = len(limb.joint_names)
        c.require(
            named in (0, len(chain.joints)),
            f"{limb.name} has {named} joint names and {len(chain.joints)} joints",
            "limbs",
        )
        for k, joint in enumerate(chain.joints):
            name = mechanism.joint_name(number, k, joint.kind)
            which = f"{limb.name}, {name}"
            seen.append(name)
            if not c.require(joint.kind in AXES, f"{which}: {joint.kind!r} is no kind of joint"):
                continue
            c.require(
                len(joint.axes) == AXES[joint.kind],
                f"{which}: {len(joint.axes)} axes, {joint.kind} has {AXES[joint.kind]}",
            )
            c.require(
                (joint.bar is not None) == (joint.kind == "Pa"),
                f"{which}: Pa has a bar, {joint.kind} {'no' if joint.bar is None else 'a'} bar",
            )
            c.require(
                np.shape(joint.point) == (3,) and bool(np.isfinite(joint.point).all()),
                f"{which}: {joint.point} is no point",
            )
            for axis in joint.axes:
                long = float(np.linalg.norm(axis))
                c.require(
                    abs(long - 1) < _WIDE, f"{which}: an axis has the length {long:.9g}, not 1"
                )
            if joint.drive is not None:
                coordinate, freedom = joint.drive
                driven.append(coordinate)
                c.require(
                    0 <= freedom < FREEDOMS[joint.kind],
                    f"{which}: drives freedom {freedom} of {FREEDOMS[joint.kind]}",
                )
    for name in (j.name for j in mechanism.joints):
        c.require(
            driven.count(name) == 1,
            f"{name} drives {driven.count(name)} joints of the layout, 1 is needed",
        )
    for name in driven:
        c.require(
            name in {j.name for j in mechanism.joints},
            f"drives {name!r}, which is no actuated joint",
        )
    c.require(len(set(seen)) == len(seen), f"joints of one name: {seen}", "limbs")
    others = {p.name for p in mechanism.parameters}
    for name in seen:
        c.require(name not in others, f"the joint {name!r} has a parameter's name", "limbs")


def _bodies(c: Comparison, subject: Subject, chains: Sequence[Chain]) -> None:
    bodies = subject.mechanism.bodies(subject.parameters)
    called = [body.name for body in bodies]
    c.require(len(set(called)) == len(called), f"bodies of one name: {called}")
    for body in bodies:
        name = f"{body.name!r}"
        c.require(
            math.isfinite(body.mass) and body.mass > 0, f"{name}: {body.mass:g} kg is no mass"
        )
        inertia = np.asarray(body.inertia, dtype=float)
        if not c.require(
            inertia.shape == (3, 3) and bool(np.isfinite(inertia).all()),
            f"{name}: an inertia has 3 x 3 finite numbers",
        ):
            continue
        c.require(np.shape(body.centre) == (3,), f"{name}: a centre of mass has 3 numbers")
        low, middle, high = np.linalg.eigvalsh(inertia)
        c.require(
            bool(np.abs(inertia - inertia.T).max() <= 1e-9 * abs(high)),
            f"{name}: the inertia is not symmetric",
        )
        c.require(
            bool(low >= -1e-9 * abs(high) and high <= (low + middle) * (1 + 1e-9)),
            f"{name}: no body has the principal inertias {low:.4g}, {middle:.4g}, "
            f"{high:.4g} kg m^2",
        )
        if body.limb == PLATFORM:
            continue
        if not c.require(0 <= body.limb < len(chains), f"{name}: there is no limb {body.limb}"):
            continue
        joints = chains[body.limb].joints
        if not c.require(
            0 <= body.joint < len(joints), f"{name}: limb {body.limb} has no joint {body.joint}"
        ):
            continue
        kind = joints[body.joint].kind
        c.require(body.part == "link" or kind == "Pa", f"{name}: {kind} has no bars")
        if subject.mechanism.posture is not None:
            reason = frame_fault(chains[body.limb], body.joint, subject.size)
            c.require(not reason, f"{name}: {reason}")


def frame_fault(chain: Chain, k: int, size: float) -> str:
    """Return why the frame of the link after joint k is not determined, "" where it is.

    See :mod:`pmopt.mechanisms.bodies`.
    """
    if k == len(chain.joints) - 1:
        return ""
    joint, after = chain.joints[k], chain.joints[k + 1]
    link = f"the frame of the link from joint {k} ({joint.kind}) to {k + 1} ({after.kind})"
    if joint.kind in ("R", "U", "S"):
        if joint.kind == "S" and after.kind != "P":
            return f"{link} is not determined: after S a P follows"
        along = np.asarray(after.axes[0] if after.kind == "P" else after.point - joint.point)
        if float(np.linalg.norm(along)) < 1e-9 * (1.0 if after.kind == "P" else size):
            return f"{link} is not determined: both have one point"
        along = along / np.linalg.norm(along)
        if joint.axes and float(np.linalg.norm(np.cross(along, joint.axes[-1]))) < 1e-9:
            return f"{link} is not determined: the axis lies along the link"
    if joint.kind == "C" and (
        not after.axes or float(np.linalg.norm(np.cross(joint.axes[0], after.axes[0]))) < 1e-9
    ):
        return f"{link} is not determined: the next axis is parallel, or there is none"
    return ""


def check_text(found: Examination, mechanism: Mechanism) -> None:
    """The text that is compiled can be put together; nothing is compiled."""
    with found.check("kernel-text", "kernel", "what kernel, skeleton and line refer to") as c:
        recipe = Recipe(
            mechanism.kernel,
            mechanism.skeleton,
            len(mechanism.pose),
            mechanism.constants,
            len(mechanism.joints),
            "2",
            mechanism.segments,
            mechanism.spokes,
            len(mechanism.cones),
            line=mechanism.line,
            line_axis=mechanism.line_axis,
            line_parts=mechanism.line_parts,
            switches=tuple(sorted(mechanism.switches({}).items())),
        )
        compile(program_text.module_text(recipe), "kernel", "exec")
        c.require(True, "")
    for place, function in (
        ("posture", mechanism.posture),
        ("assembler", mechanism.assembler and mechanism.assembler.assemble),
        ("inverter", mechanism.inverter and mechanism.inverter.assemble),
    ):
        if function is not None:
            with found.check("kernel-text", place, f"what the {place} refers to") as c:
                blocks: dict[str, str] = {}
                program_text.collect(function, blocks)
                compile("\n\n".join(blocks.values()), place, "exec")
                c.require(True, "")
