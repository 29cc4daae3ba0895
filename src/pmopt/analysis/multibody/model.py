"""A mechanism as a tree of rigid links whose loops are closed, for multibody engines.

Made of what a mechanism declares and nothing else: the joints of its layout at one pose, and its
bodies. Everything is in the base frame at that pose, SI units.

The platform is carried by one limb. Every other limb ends before its last joint, which is
what closes its loop: its two points stay together, and for a universal or revolute joint one or two
pairs of directions, the first of each fixed in the limb and the second in the platform, stay
perpendicular. That is as many equations as the joint takes freedoms, none of them twice.

A link without mass is no body of its own where an engine can do without: its freedoms are those of
the next link. Parallelograms are two hinges, of the bars and of the short side, that
turn by opposite angles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pmopt.analysis.kinematics.inverse import inverse_kinematics, reached
from pmopt.analysis.mobility.screws import rank
from pmopt.analysis.motion.dynamics import GRAVITY
from pmopt.errors import InputError
from pmopt.mechanisms.bodies import Body
from pmopt.mechanisms.mechanism import PLATFORM, Chain, Joint, Matrix, Mechanism, Parameters, Vector
from pmopt.units import METRES

#: Number of the link that is the base.
BASE = -1
#: Mass of a link that an engine needs and nobody has declared, as a share of all mass.
NEGLIGIBLE = 1e-7

#: Share of its way that each of two telescoping links is drawn along.
HALF = 0.55

#: Origin and rotation of a frame.
Frame = tuple[Vector, Matrix]
#: What it takes to close a limb at its last joint beside the point; those not named cannot be.
_CLOSING = {"S": 0, "U": 1, "R": 2}


@dataclass(frozen=True)
class Freedom:
    """An elementary joint: a hinge, a slide or a ball.

    Attributes
    ----------
    name : str
        The coordinate's where it is actuated.
    kind : {"hinge", "slide", "ball"}
    point : (3,) float64
    axis : (3,) float64
        Unit vector; of no meaning for a ball.
    start : float
        Its position at the pose, m or rad: the coordinate's where it is actuated, else 0.
    actuated : bool
    """

    name: str
    kind: Literal["hinge", "slide", "ball"]
    point: Vector
    axis: Vector
    start: float = 0.0
    actuated: bool = False


@dataclass(frozen=True)
class Link:
    """A rigid link.

    Attributes
    ----------
    name : str
    parent : int
        Number of the link that carries it, or BASE.
    origin, rotation : (3,), (3, 3) float64
        Its frame; see :mod:`pmopt.mechanisms.bodies`.
    freedoms : tuple of Freedom
        That it has against its parent, in order.
    bodies : tuple of Body
        Centres in m.
    limb : int
        Number of the limb, or PLATFORM.
    path : tuple of (3,) float64
        Where the link reaches: its joints.
    """

    name: str
    parent: int
    origin: Vector
    rotation: Matrix
    freedoms: tuple[Freedom, ...]
    bodies: tuple[Body, ...]
    limb: int
    path: tuple[Vector, ...]


@dataclass(frozen=True)
class Closure:
    """A loop that is closed: a point of a limb's last link stays at one of the platform.

    Attributes
    ----------
    name : str
    link : int
    point : (3,) float64
    perpendicular : tuple of ((3,), (3,)) float64
        Unit vectors of the link and of the platform that stay perpendicular.
    """

    name: str
    link: int
    point: Vector
    perpendicular: tuple[tuple[Vector, Vector], ...]


@dataclass(frozen=True)
class Tree:
    """A mechanism at one pose as links; see :func:`build_tree`.

    Attributes
    ----------
    mechanism : str
    links : tuple of Link
        Parents before their children.
    platform, carrier : int
        Number of the platform's link and of the limb that carries it.
    closures : tuple of Closure
    opposite : tuple of (str, str)
        Names of freedoms that turn by opposite angles.
    actuated : tuple of str
        In the mechanism's order.
    base : tuple of (3,) float64
        The limbs' first joints.
    centre, size : (3,) float64, float
        Middle and largest side of the box around all joints, m.
    gravity : (3,) float64
        m/s^2.
    """

    mechanism: str
    links: tuple[Link, ...]
    platform: int
    carrier: int
    closures: tuple[Closure, ...]
    opposite: tuple[tuple[str, str], ...]
    actuated: tuple[str, ...]
    base: tuple[Vector, ...]
    centre: Vector
    size: float
    gravity: Vector


def link_frames(chain: Chain, platform: Frame) -> tuple[Frame, ...]:
    """Return the frame of the link after each joint; see :mod:`pmopt.mechanisms.bodies`."""
    frames: list[Frame] = []
    rotation = np.eye(3)
    for joint, following in zip(chain.joints, chain.joints[1:], strict=False):
        origin = joint.point if joint.kind in ("R", "U", "S") else following.point
        if joint.kind == "Pa" and joint.bar is not None:
            origin = joint.point + joint.bar
        if joint.kind == "C":
            rotation = _along(joint.axes[0], following.axes[0])
        elif joint.kind in ("R", "U", "S"):
            slides = following.kind == "P"
            along = following.axes[0] if slides else following.point - joint.point
            rotation = _along(along, platform[1][:, 0] if joint.kind == "S" else joint.axes[-1])
        frames.append((origin, rotation))
    return (*frames, platform)


def bar_frame(joint: Joint) -> Frame:
    """Return the frame of the long bars of a parallelogram."""
    assert joint.bar is not None
    return joint.point, _along(joint.bar, joint.axes[0])


def _along(z: Vector, x: Vector) -> Matrix:
    """Return the rotation with this z axis and x as near as it can be to this direction."""
    z = z / np.linalg.norm(z)
    x = x - (x @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def build_tree(
    mechanism: Mechanism,
    parameters: Parameters,
    pose: Mapping[str, float],
    working_mode: str,
    bodies: Sequence[Body],
    gravity: Sequence[float],
) -> Tree:
    """Return a mechanism as a tree of links with closed loops.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete.
    pose : mapping
        Reachable, in the mechanism's unit: where all freedoms but the actuated are 0.
    working_mode : str
    bodies : sequence of Body
    gravity : (3,) of float
        m/s^2.

    Raises
    ------
    InputError
        If there is no mass, or more than one limb ends in a joint that no loop can be closed at.
    """
    if not any(body.mass > 0 for body in bodies):
        raise InputError(f"{mechanism.name} has no bodies with a mass: an engine cannot move it")
    unit = METRES[mechanism.length_unit]
    chains = [_in_metres(c, unit) for c in mechanism.layout(parameters, pose, working_mode)]
    rotation, centre = mechanism.platform(parameters, pose, working_mode)
    solutions = mechanism.inverse(parameters, pose)
    joints = next(s.joints for s in solutions if s.working_mode == working_mode)
    lengths = {c.name for c in mechanism.joints if c.kind == "length"}
    starts = {k: v * unit if k in lengths else v for k, v in joints.items()}
    masses: dict[tuple[int, int, str], list[Body]] = {}
    for body in bodies:
        if body.mass > 0:
            key = (body.limb, -1 if body.limb == PLATFORM else body.joint, body.part)
            # The link after a limb's last joint is the platform.
            if body.limb != PLATFORM and body.part == "link":
                last = body.joint == len(chains[body.limb].joints) - 1
                key = (PLATFORM, -1, "link") if last else key
            masses.setdefault(key, []).append(replace(body, centre=unit * np.asarray(body.centre)))
    names = [
        [mechanism.joint_name(limb, k, joint.kind) for k, joint in enumerate(chain.joints)]
        for limb, chain in enumerate(chains)
    ]
    total = sum(body.mass for body in bodies)
    builder = _Builder(masses, total, (unit * centre, rotation), starts, names)
    carrier = _carrier(mechanism, chains)
    ends = [_seat(chain.joints[-1], unit * centre) for chain in chains]
    points = np.array([j.point for chain in chains for j in chain.joints])
    builder.size = float(np.ptp(points, axis=0).max())
    for limb in (carrier, *(k for k in range(len(chains)) if k != carrier)):
        builder.add(limb, chains[limb], limb == carrier, ends)
    return Tree(
        mechanism.name, tuple(builder.links), builder.platform, carrier, tuple(builder.closures),
        tuple(builder.opposite), tuple(c.name for c in mechanism.joints),
        tuple(chain.joints[0].point for chain in chains),
        (points.min(axis=0) + points.max(axis=0)) / 2, builder.size, np.array(gravity, float),
    )  # fmt: skip


def declared_tree(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None = None,
    pose: Mapping[str, Any] | None = None,
    working_mode: str | None = None,
    where: str = "pose",
    limits: Mapping[str, Any] | None = None,
) -> Tree:
    """Return a mechanism with its own bodies and gravity as a tree.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    pose : mapping, optional
        Default: the declared home.
    working_mode : str, optional
        Default: the mechanism's first.
    where : str
        What errors call the pose.
    limits : mapping, optional
        Of joints, instead of the mechanism's own.

    Raises
    ------
    InputError
        For unknown names and a pose out of reach.
    """
    parameters = mechanism.resolve(params or {})
    mode = mechanism.check_mode(working_mode)
    given = mechanism.home(parameters) if pose is None else pose
    found = inverse_kinematics(mechanism, parameters, given, mode, limits, where)
    reached(mechanism, found, where)
    gravity = [GRAVITY * d for d in mechanism.down]
    bodies = mechanism.bodies(parameters)
    return build_tree(mechanism, parameters, found.pose, mode, bodies, gravity)


def _in_metres(chain: Chain, unit: float) -> Chain:
    return Chain(chain.name, tuple(
        replace(j, point=unit * j.point, bar=None if j.bar is None else unit * j.bar)
        for j in chain.joints
    ))  # fmt: skip


def _carrier(mechanism: Mechanism, chains: Sequence[Chain]) -> int:
    """Return the limb whose loop is the hardest to close: it carries the platform."""

    def cost(chain: Chain) -> float:
        last = chain.joints[-1]
        return math.inf if last.drive is not None else _CLOSING.get(last.kind, math.inf)

    costs = [cost(chain) for chain in chains]
    if costs.count(math.inf) > 1:
        raise InputError(
            f"{mechanism.name}: only one limb may end in an actuated joint or one other than "
            f"{', '.join(_CLOSING)}: the loops cannot be closed"
        )
    return costs.index(max(costs))


def _freedoms(joint: Joint, name: str, starts: Mapping[str, float]) -> list[Freedom]:
    """Return a joint's freedoms from base to platform."""
    point = joint.point
    if joint.kind == "Pa":
        assert joint.bar is not None
        found = [Freedom(f"{name}.1", "hinge", point, joint.axes[0]),
                 Freedom(f"{name}.2", "hinge", point + joint.bar, joint.axes[0])]  # fmt: skip
    elif joint.kind == "C":
        found = [Freedom(f"{name}.1", "hinge", point, joint.axes[0]),
                 Freedom(f"{name}.2", "slide", point, joint.axes[0])]  # fmt: skip
    elif joint.kind == "U":
        found = [Freedom(f"{name}.{i}", "hinge", point, a) for i, a in enumerate(joint.axes, 1)]
    elif joint.kind == "S":
        found = [Freedom(name, "ball", point, np.zeros(3))]
    else:
        found = [Freedom(name, "slide" if joint.kind == "P" else "hinge", point, joint.axes[0])]
    if joint.drive is not None:
        drive, number = joint.drive
        found[number] = replace(found[number], name=drive, start=starts[drive], actuated=True)
    return found


class _Builder:
    """Collects links, limb by limb."""

    def __init__(
        self,
        masses: Mapping[tuple[int, int, str], list[Body]],
        total: float,
        platform: Frame,
        starts: Mapping[str, float],
        names: Sequence[Sequence[str]],
    ) -> None:
        self.masses = masses
        self.names = names
        self.total = total
        self.frame = platform
        self.starts = starts
        self.links: list[Link] = []
        self.closures: list[Closure] = []
        self.opposite: list[tuple[str, str]] = []
        self.platform = BASE
        self.size = 1.0

    def add(self, limb: int, chain: Chain, carries: bool, ends: Sequence[Vector]) -> None:
        """Add a limb's links, and the platform or what closes the loop."""
        frames = link_frames(chain, self.frame)
        parent = BASE
        pending: list[Freedom] = []
        last = len(chain.joints) - 1
        for k, joint in enumerate(chain.joints):
            if k == last and not carries:
                self._close(chain, joint, parent)
                return
            name = f"{chain.name}/{self.names[limb][k]}"
            freedoms = _freedoms(joint, name, self.starts)
            if joint.kind == "Pa":
                self.opposite.append((freedoms[0].name, freedoms[1].name))
                bars = self._bodies((limb, k, "bars"))
                if bars:
                    assert joint.bar is not None
                    path: tuple[Vector, ...] = (joint.point, joint.point + joint.bar)
                    parent = self._emit(f"{name} bars", parent, bar_frame(joint),
                                        (*pending, freedoms[0]), bars, limb, path)  # fmt: skip
                    pending, freedoms = [], freedoms[1:]
            pending += freedoms
            if k == last:
                bodies = self._bodies((PLATFORM, -1, "link"))
                bodies = bodies or self._nearly_nothing("platform")
                self.platform = self._emit("platform/link", parent, frames[k], tuple(pending),
                                           bodies, PLATFORM, (frames[k][0], *ends))  # fmt: skip
                return
            bodies = self._bodies((limb, k, "link"))
            following = chain.joints[k + 1]
            needed = k + 1 == last and not carries
            if not bodies and (needed or not _stack(pending, following)):
                bodies = self._nearly_nothing(name)
            if bodies:
                start = joint.point if joint.bar is None else joint.point + joint.bar
                start = frames[k][0] if joint.kind in ("P", "C") else start
                path = _reach(chain, k, start, ends[limb])
                parent = self._emit(f"{name} link", parent, frames[k], tuple(pending), bodies,
                                    limb, path)  # fmt: skip
                pending = []

    def _bodies(self, key: tuple[int, int, str]) -> tuple[Body, ...]:
        return tuple(self.masses.get(key, ()))

    def _nearly_nothing(self, name: str) -> tuple[Body, ...]:
        mass = NEGLIGIBLE * self.total
        inertia = mass * (0.1 * self.size) ** 2 * np.eye(3)
        return (Body(f"{name} (negligible)", 0, 0, mass, np.zeros(3), inertia),)

    def _emit(
        self, name: str, parent: int, frame: Frame, freedoms: tuple[Freedom, ...],
        bodies: tuple[Body, ...], limb: int, path: tuple[Vector, ...],
    ) -> int:  # fmt: skip
        self.links.append(Link(name, parent, *frame, freedoms, bodies, limb, path))
        return len(self.links) - 1

    def _close(self, chain: Chain, joint: Joint, link: int) -> None:
        pairs: tuple[tuple[Vector, Vector], ...] = ()
        if joint.kind == "U":
            pairs = ((joint.axes[0], joint.axes[1]),)
        elif joint.kind == "R":
            axis = joint.axes[0]
            across = _along(axis, np.eye(3)[int(np.abs(axis).argmin())])
            pairs = ((across[:, 0], axis), (across[:, 1], axis))
        self.closures.append(Closure(chain.name, link, joint.point, pairs))


def _stack(pending: Sequence[Freedom], following: Joint) -> bool:
    """Return whether one more joint's freedoms may be added to those of one body.

    A ball and another turning joint may not be in one body of an engine. Freedoms that say the
    same, like two hinges on one axis, would leave the body without inertia against one another.
    """
    turns = any(f.kind != "slide" for f in pending)
    ball = any(f.kind == "ball" for f in pending)
    if (ball and following.kind != "P") or (turns and following.kind == "S"):
        return False
    freedoms = [*pending, *_freedoms(replace(following, drive=None), "", {})]
    twists = [np.concatenate([np.zeros(3), f.axis]) if f.kind == "slide"
              else np.concatenate([f.axis, np.cross(f.point - following.point, f.axis)])
              for f in freedoms if f.kind != "ball"]  # fmt: skip
    return rank(np.array(twists).T) == len(twists)


def _seat(joint: Joint, centre: Vector) -> Vector:
    """Return where on the platform a limb ends, for pictures."""
    if joint.kind in ("P", "C"):
        return joint.point + _part(centre - joint.point, joint.axes[0])
    return joint.point


def _reach(chain: Chain, k: int, start: Vector, seat: Vector) -> tuple[Vector, ...]:
    """Return the ends of the link after joint k, for pictures.

    Of the two links that telescope each is a good half of the way.
    """
    joint, following = chain.joints[k], chain.joints[k + 1]
    end = following.point
    if following.kind == "P" and np.allclose(end, start):
        beyond = chain.joints[k + 2].point if k + 2 < len(chain.joints) else seat
        return start, start + HALF * _part(beyond - start, following.axes[0])
    if joint.kind == "P" and k > 0:
        return end - HALF * _part(end - joint.point, joint.axes[0]), end
    return start, end


def _part(way: Vector, axis: Vector) -> Vector:
    """Return the part of a way along an axis."""
    return (way @ axis) * axis
