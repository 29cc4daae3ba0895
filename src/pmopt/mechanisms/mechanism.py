"""What a mechanism declares. Each mechanism is one file with a ``MECHANISM`` of this kind."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler.records import Constants, size
from pmopt.errors import InputError, unknown_name
from pmopt.inputs.fields import Units
from pmopt.inputs.quantities import QuantityError, as_quantity, in_degrees
from pmopt.numerics.elementary import cos
from pmopt.units import (
    ANGLE,
    METRES,
    ONE,
    WATT,
    Kind,
    LengthUnit,
    ParameterKind,
    effort_unit,
    measure_unit,
    per_second,
    unit_of,
)

if TYPE_CHECKING:
    from pmopt.compiler.programs import Assembler
    from pmopt.mechanisms.bodies import Body

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
#: Design parameters by name, complete and validated; None for an unset optional one.
Parameters = Mapping[str, float | None]
#: Ranges by coordinate name.
Ranges = Mapping[str, tuple[float, float]]
JacobianKind = Literal["raw", "homogenized"]

#: Physical range of lengths, in the mechanism's length unit: beyond it squares and fourth powers
#: of lengths leave what doubles can tell apart. Coordinates may lie further out.
SMALLEST_LENGTH, LARGEST_LENGTH = 1e-6, 1e6
LARGEST_COORDINATE = 1e9
#: Poses from which on it pays to load or compile what solves them.
_MANY = 64
#: Stands for a limb's number where a segment belongs to the platform.
PLATFORM = -1


@dataclass(frozen=True)
class Parameter:
    """A design parameter.

    Attributes
    ----------
    name : str
        The symbol of the literature.
    kind : {"length", "angle", "ratio"}
    default : float or None
        None for an optional parameter that is unset.
    bounds : tuple of float or None
        Optimisation bounds; None where it is no design variable.
    positive : bool
        False where the physical range includes 0.
    meaning, source : str
        What it is, and who chose default and bounds.
    """

    name: str
    kind: ParameterKind
    default: float | None
    bounds: tuple[float, float] | None
    positive: bool
    meaning: str
    source: str

    @property
    def optional(self) -> bool:
        """Whether the parameter may be unset."""
        return self.default is None

    def allowed(self) -> str:
        """Return the physical range in words."""
        if self.kind == "angle":
            return "a number from -pi to pi"
        text = f"a number from {SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g}"
        return text if self.positive else f"{text}, or 0"

    def accepts(self, value: float) -> bool:
        """Return whether the value is within the physical range."""
        if self.kind == "angle":
            return abs(value) <= math.pi
        return SMALLEST_LENGTH <= value <= LARGEST_LENGTH or (value == 0 and not self.positive)


@dataclass(frozen=True)
class Coordinate:
    """A pose or joint coordinate."""

    name: str
    kind: Kind
    meaning: str


@dataclass(frozen=True)
class Limb:
    """A limb.

    Attributes
    ----------
    name : str
    joints : str
        From base to platform (``P_a`` is a parallelogram).
    description : str
        With the joints' names.
    joint_names : tuple of str
        What the joints are called everywhere: one that turns or slides in one way is called as its
        coordinate is (``theta1``), others by kind and point (``U_C1``).
    """

    name: str
    joints: str
    description: str
    joint_names: tuple[str, ...] = ()


JointKind = Literal["R", "P", "C", "U", "S", "Pa"]


@dataclass(frozen=True)
class Joint:
    """A joint of a limb at one configuration, in the base frame.

    Attributes
    ----------
    kind : {"R", "P", "C", "U", "S", "Pa"}
        Revolute, prismatic, cylindrical, universal, spherical, planar parallelogram.
    point : (3,) float64
        A point of the axis; the centre of U and S; for Pa the middle of its base-side short bar.
    axes : tuple of (3,) float64
        Unit vectors. R, P, C: the axis; U: both, the one nearer to the base first; S: none;
        Pa: the common direction of its four revolute axes.
    bar : (3,) float64 or None
        Pa only: the long bar, from its base side to its platform side.
    drive : (str, int) or None
        The actuated coordinate and which elementary freedom of the joint it is (C: 0 turns,
        1 slides; U: 0 turns about the first axis, 1 about the second; R, P, Pa: 0).
    """

    kind: JointKind
    point: Vector
    axes: tuple[Vector, ...] = ()
    bar: Vector | None = None
    drive: tuple[str, int] | None = None


@dataclass(frozen=True)
class Chain:
    """A limb at one configuration: its joints from base to platform."""

    name: str
    joints: tuple[Joint, ...]


@dataclass(frozen=True)
class InverseSolution:
    """One branch of the inverse kinematics: a working mode and its joint positions.

    ``passive`` are the positions of the passive joints that limits can be set on.
    """

    working_mode: str
    joints: dict[str, float]
    parasitic: dict[str, float]
    passive: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ForwardSolution:
    """One assembly mode: a pose and the largest residual of the constraints at it."""

    pose: dict[str, float]
    parasitic: dict[str, float]
    residual: float


@dataclass(frozen=True)
class Assemblies:
    """The assembly modes of one set of joint positions.

    Attributes
    ----------
    solutions : tuple of ForwardSolution
        Nearest to home first.
    proven : bool
        Whether it is proven that there are no others.
    free : bool
        Whether the joint positions leave the platform free to move, with no end of solutions.
    """

    solutions: tuple[ForwardSolution, ...]
    proven: bool = False
    free: bool = False


@dataclass(frozen=True)
class Reach:
    """How far a pose is inside (> 0) or outside (< 0) the reach of one limb.

    ``distance`` is the distance to the limb's singular surface, in the length unit; ``reason``
    says what a pose outside is, "too far" or "too close".
    """

    limb: str
    distance: float
    reason: str


@dataclass(frozen=True)
class Implicit:
    """Equations that a kernel solves, for proofs about its solution.

    Attributes
    ----------
    unknowns : int
        Number m of unknowns, angles not reduced to a turn.
    inner : tuple of int
        Numbers of the pose coordinates that the unknowns depend on.
    residuals : callable
        ``residuals(*pose, unknowns, constants)``: m expressions that vanish at the solution.
    outcome : callable
        ``outcome(*pose, unknowns, constants)``: what the kernel returns, at unknowns that solve.
    start : callable
        ``start(*pose, constants)``: the kernel's solution, m numbers.
    """

    unknowns: int
    inner: tuple[int, ...]
    residuals: Callable[..., tuple[Any, ...]]
    outcome: Callable[..., tuple[Any, ...]]
    start: Callable[..., list[float]]


@dataclass(frozen=True)
class Curve:
    """A curve of configurations along which a kernel seeks a pose coordinate, for proofs.

    With the other coordinates given, the configurations are told by v in [-pi, pi]. The pose is
    reached on the piece about v = 0 on which the coordinate is monotonic.

    Attributes
    ----------
    coordinate : int
        Number of the pose coordinate.
    outcome : callable
        ``outcome(*pose with v in the coordinate's place, constants)``: the coordinate, its slope by
        v with the sign that is asked for, and what the kernel returns.
    """

    coordinate: int
    outcome: Callable[..., tuple[Any, ...]]


class Mechanism(ABC):
    """A parallel mechanism: declarations, clear NumPy-level functions and one hot kernel.

    Lengths are in ``length_unit`` throughout, angles in radians.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    description: ClassVar[str]
    source: ClassVar[str]
    freedom: ClassVar[str]
    length_unit: ClassVar[LengthUnit]
    parameters: ClassVar[tuple[Parameter, ...]]
    pose: ClassVar[tuple[Coordinate, ...]]
    joints: ClassVar[tuple[Coordinate, ...]]
    limbs: ClassVar[tuple[Limb, ...]]
    #: Passive-joint quantities that limits can be set on.
    passive: ClassVar[tuple[Coordinate, ...]] = ()
    parasitic: ClassVar[tuple[Coordinate, ...]] = ()
    #: Other readings of the limbs, for ``pmopt mobility``: name to description.
    layouts: ClassVar[Mapping[str, str]] = {}
    #: In words where a measure of :meth:`singularity_measures` vanishes, by ``"kind"`` or by
    #: ``"kind, part"``.
    conditions: ClassVar[Mapping[str, str]]
    working_modes: ClassVar[tuple[str, ...]]
    default_jacobian: ClassVar[JacobianKind]
    length_meaning: ClassVar[str]

    #: ``kernel(*pose, constants) -> (margin, *entries)``; see pmopt.compiler.program_text. The
    #: margin is >= 0 inside every limit and continuous outside; the entries, row by row, are any
    #: common scalar multiple of the inverse of the Jacobian made homogeneous by the length.
    kernel: ClassVar[Callable[..., tuple[float, ...]]]
    #: What the constants are, a NamedTuple of numbers and of such NamedTuples; without it they are
    #: a plain tuple of :attr:`constant_count` numbers.
    constants: ClassVar[type[Any] | None] = None
    constant_count: ClassVar[int]
    #: Where the kernel solves equations step by step, the equations: what proofs are about.
    implicit: ClassVar[Implicit | None] = None
    curve: ClassVar[Curve | None] = None
    #: ``skeleton(*pose, constants) -> flat tuple``: the platform's position (3) and rotation
    #: (9, row by row), both ends of each segment of :attr:`segments` (6 each), and the cosine of
    #: each cone angle of :attr:`cones`. What clearances, cone limits, tool and pictures need.
    skeleton: ClassVar[Callable[..., tuple[float, ...]]]
    #: Limb (from 0) of each segment of the skeleton; PLATFORM for the platform's own.
    segments: ClassVar[tuple[int, ...]] = ()
    #: For each platform segment, in order, the limb that is joined to its far end.
    spokes: ClassVar[tuple[int, ...]] = ()
    #: Coordinate of the base frame that is across the floor.
    vertical: ClassVar[int] = 2
    #: Exact reach along one coordinate, where a mechanism offers it:
    #: ``line(*pose, low, high, constants) -> (start, end, start, end, ..)``, the parts outside of
    #: which nothing is reachable of the line along coordinate :attr:`line_axis` through the pose,
    #: from ``low`` to ``high``: :attr:`line_parts` of them, disjoint, ascending, empty where
    #: end <= start. What is not reachable of them is left to the margin. A kernel function.
    line: ClassVar[Callable[..., tuple[float, ...]] | None] = None
    line_axis: ClassVar[int] = 0
    line_parts: ClassVar[int] = 0
    #: What motions and forces need, where a mechanism offers it:
    #: ``posture(*pose, constants) -> flat tuple``: place of the platform as in the skeleton, the
    #: actuated joints' positions, those of :attr:`followed`, then of every joint of
    #: :meth:`layout`, in order, its point, its axes and, for Pa, its bar. A kernel function.
    posture: ClassVar[Callable[..., tuple[float, ...]] | None] = None
    #: What the pose coordinates and the parasitic ones are: ``x``, ``y``, ``z`` of the platform's
    #: centre, ``yaw``, ``pitch``, ``roll`` of Rz Ry Rx, or the name of an actuated joint.
    roles: ClassVar[tuple[str, ...]] = ()
    parasitic_roles: ClassVar[tuple[str, ...]] = ()
    #: Passive joints that motions tell: each the sum of freedoms (limb, number in it, weight).
    followed: ClassVar[Mapping[str, tuple[tuple[int, int, float], ...]]] = {}
    #: Direction of gravity unless another is given.
    down: ClassVar[tuple[float, float, float]] = (0.0, 0.0, -1.0)
    #: How the compiled forward kinematics solves; its constants are :meth:`assembly_constants`.
    #: A mechanism without one has a :meth:`forward` of its own.
    assembler: ClassVar[Assembler | None] = None
    #: How the assembly modes are found, in words: what it rests on that they are all.
    completeness: ClassVar[str] = "no proof is offered that these are all"
    #: In words where joint positions leave the platform free to move.
    freed: ClassVar[str] = "a forward singularity: the platform is free to move"
    #: How :meth:`inverse` solves where it takes long, so that it can be compiled for many poses;
    #: its constants are :meth:`inversion_constants`. A row of what is found holds the number of a
    #: branch (:meth:`branch`), joints, parasitic coordinates and :attr:`inverted_passive`.
    inverter: ClassVar[Assembler | None] = None
    inverted_passive: ClassVar[tuple[str, ...]] = ()
    #: Names of the passive U and S joints whose cone angle the skeleton tells.
    cones: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        if cls.constants is not None:
            cls.constant_count = size(cls.constants)

    @property
    def form_of_constants(self) -> Constants:
        """What the kernel's constants are: the class of a record, or how many plain numbers."""
        return self.constants or self.constant_count

    # -- declared geometry -------------------------------------------------------------

    @abstractmethod
    def characteristic_length(self, parameters: Parameters) -> float:
        """Return the length that makes the Jacobian homogeneous by default."""

    @abstractmethod
    def reach_box(self, parameters: Parameters, limits: Ranges) -> tuple[Vector, Vector]:
        """Return a tight box around what limits leave reachable; empty where lower >= upper."""

    @abstractmethod
    def default_domain(self, parameters: Parameters) -> Ranges:
        """Return the ranges a workspace is searched in unless others are given."""

    @abstractmethod
    def home(self, parameters: Parameters) -> dict[str, float]:
        """Return the declared regular pose that working modes and aspects are told from."""

    @abstractmethod
    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return the platform's rotation (3, 3) and the position (3,) of its centre at a pose.

        The parasitic coordinates are included.
        """

    @abstractmethod
    def layout(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Chain, ...]:
        """Return every limb's joints at a reachable pose: what mobility and drawing read."""

    def alternative_layout(self, parameters: Parameters, name: str) -> tuple[Chain, ...]:
        """Return one of :attr:`layouts` at its home pose; for mobility only."""
        raise unknown_name("layout", name, self.layouts)

    def bodies(self, parameters: Parameters) -> tuple[Body, ...]:
        """Return the rigid bodies of limbs and platform; see :mod:`pmopt.mechanisms.bodies`."""
        return ()

    def default_limits(self, parameters: Parameters) -> Ranges:
        """Return the limits of actuated and passive joints that hold unless others are given."""
        return {}

    # -- kinematics --------------------------------------------------------------------

    @abstractmethod
    def reach(self, parameters: Parameters, pose: Mapping[str, float]) -> tuple[Reach, ...]:
        """Return each limb's distance to its singular surface at a pose."""

    @abstractmethod
    def inverse(
        self, parameters: Parameters, pose: Mapping[str, float]
    ) -> tuple[InverseSolution, ...]:
        """Return all branches of the inverse kinematics, one a working mode; () out of reach."""

    def inverses(
        self, parameters: Parameters, poses: Sequence[Mapping[str, float]]
    ) -> list[tuple[InverseSolution, ...]]:
        """Return what :meth:`inverse` does of each of many poses, to the last bit."""
        if self.inverter is None:
            return [self.inverse(parameters, pose) for pose in poses]
        return self.inverted(parameters, poses)

    def inverted(
        self, parameters: Parameters, poses: Sequence[Mapping[str, float]]
    ) -> list[tuple[InverseSolution, ...]]:
        """Return the branches that :attr:`inverter` finds, compiled where poses are many.

        Compiled or not, every sum, product and root is the same.
        """
        from pmopt.execution.threads import default_threads, ordered_map
        from pmopt.mechanisms.assembling import assemble_plainly, assemble_rows, is_ready

        assert self.inverter is not None
        table = np.array([[pose[c.name] for c in self.pose] for pose in poses], dtype=float)
        table = table.reshape(len(poses), len(self.pose))
        constants = np.array(self.inversion_constants(parameters), dtype=float)
        if len(poses) < _MANY and not is_ready(self.inverter):
            found, counts = assemble_plainly(self.inverter, table, constants)
        elif len(poses) < _MANY:
            found, counts = assemble_rows(self.inverter, table, constants, map)
        else:
            found, counts = assemble_rows(
                self.inverter, table, constants,
                lambda solve, starts: ordered_map(solve, starts, default_threads()),
            )  # fmt: skip
        joints = [c.name for c in self.joints]
        others = [c.name for c in self.parasitic]
        first, last = 1 + len(joints), 1 + len(joints) + len(others)
        return [
            tuple(
                InverseSolution(
                    self.branch(int(row[0])),
                    dict(zip(joints, row[1:first], strict=True)),
                    dict(zip(others, row[first:last], strict=True)),
                    dict(zip(self.inverted_passive, row[last:], strict=True)),
                )
                for row in rows[:count].tolist()
            )
            for rows, count in zip(found, counts[:, 0].tolist(), strict=True)
        ]

    def branch(self, number: int) -> str:
        """Return the name of a branch that :attr:`inverter` numbers."""
        return self.working_modes[number]

    def inversion_constants(self, parameters: Parameters) -> Sequence[float]:
        """Return the constants of :attr:`inverter` for one design."""
        raise NotImplementedError

    def assembly_constants(self, parameters: Parameters) -> Sequence[float]:
        """Return the constants of :attr:`assembler` for one design."""
        raise NotImplementedError

    def forward(
        self, parameters: Parameters, joints: Mapping[str, float]
    ) -> tuple[ForwardSolution, ...]:
        """Return the real assembly modes found; () where it cannot be assembled.

        Raises
        ------
        InputError
            Where the joint positions leave the platform free to move.
        """
        (found,) = self.assemblies(parameters, [joints])
        if found.free:
            raise InputError(f"joints: {self.freed}")
        return found.solutions

    def assemblies(
        self, parameters: Parameters, rows: Sequence[Mapping[str, float]]
    ) -> list[Assemblies]:
        """Return the assembly modes of many sets of joint positions, each as if alone."""
        if self.assembler is None:
            return [Assemblies(self.forward(parameters, joints)) for joints in rows]
        from pmopt.execution.threads import default_threads, ordered_map
        from pmopt.mechanisms.assembling import assemble_rows

        table = np.array([[joints[c.name] for c in self.joints] for joints in rows], dtype=float)
        constants = np.array(self.assembly_constants(parameters), dtype=float)
        found, counts = assemble_rows(
            self.assembler,
            table.reshape(len(rows), len(self.joints)),
            constants,
            lambda solve, starts: ordered_map(solve, starts, default_threads()),
        )
        names = [c.name for c in self.pose]
        others = [c.name for c in self.parasitic]
        first, last = len(names), len(names) + len(others)
        return [
            Assemblies(
                tuple(
                    ForwardSolution(
                        dict(zip(names, mode[:first], strict=True)),
                        dict(zip(others, mode[first:last], strict=True)),
                        mode[last],
                    )
                    for mode in modes[: max(count, 0)].tolist()
                ),
                bool(proven),
                count < 0,
            )
            for modes, (count, proven) in zip(found, counts.tolist(), strict=True)
        ]

    @abstractmethod
    def velocity_maps(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> tuple[Matrix, Matrix]:
        """Return J_X and J_q of J_X Xdot = J_q qdot."""

    @abstractmethod
    def singularity_measures(
        self, parameters: Parameters, pose: Mapping[str, float], joints: Mapping[str, float]
    ) -> dict[str, dict[str, float]]:
        """Return normalised determinants, 0 at a singularity.

        ``inverse`` by limb, ``forward`` and, where the limbs' constraints alone can become
        dependent, ``constraint``.
        """

    @abstractmethod
    def velocity_map_units(self) -> dict[str, str]:
        """Return the units of J_X and J_q in words."""

    def condition(self, kind: str, part: str) -> str:
        """Say in words where a measure vanishes."""
        return self.conditions.get(f"{kind}, {part}") or self.conditions[kind]

    def admits(self, parameters: Parameters, pose: Mapping[str, float]) -> bool:
        """Return whether a pose keeps the limits that are design parameters."""
        return all(
            low <= pose[name] <= high for name, (low, high) in self.pose_limits(parameters).items()
        )

    def pose_limits(self, parameters: Parameters) -> Ranges:
        """Return the limits of pose coordinates that are design parameters."""
        return {}

    def why_not(self, parameters: Parameters, joints: Mapping[str, float]) -> str:
        """Say why the mechanism can not be assembled with these joint positions."""
        return "no real solution of the constraints was found"

    # -- the hot path ------------------------------------------------------------------

    def switches(self, limits: Ranges) -> dict[str, int]:
        """Return constants of the kernel's module that these limits allow to be 0.

        They may stand in the conditions of ``if``: what they switch off is not compiled.
        """
        return {}

    @abstractmethod
    def kernel_constants(
        self, parameters: Parameters, working_mode: str, length: float, limits: Ranges
    ) -> Sequence[Any]:
        """Return the constants the kernel takes for one design.

        ``length`` is the characteristic length, 1 for the raw Jacobian.
        """

    def idle_slacks(self, limits: Ranges) -> frozenset[int]:
        """Return the numbers of those slacks of the kernel's margin that the limits can not touch.

        Counted in the order in which the kernel takes their minimum. What is proven of a workspace
        leaves them out.
        """
        return frozenset()

    # -- shared by all mechanisms --------------------------------------------------------

    def homogenizing(self, length: float) -> tuple[Vector, Vector]:
        """Return the factors of J's rows and the divisors of its columns that leave no unit.

        Rates of angular pose coordinates are multiplied by the length, columns of angular joints
        divided by it: every entry then is a speed of a point over a speed of a point.
        """
        rows = np.array([length if c.kind == "angle" else 1.0 for c in self.pose])
        columns = np.array([length if c.kind == "angle" else 1.0 for c in self.joints])
        return rows, columns

    def joint_name(self, limb: int, joint: int, kind: JointKind) -> str:
        """Return the name of a joint, both counted from 0, or kind and numbers without one."""
        given = self.limbs[limb].joint_names
        return given[joint] if joint < len(given) else f"{kind}_{limb + 1}_{joint + 1}"

    @property
    def limited(self) -> tuple[Coordinate, ...]:
        """Coordinates that limits can be set on: actuated joints, then passive ones."""
        return (*self.joints, *self.passive)

    def unit(self, coordinate: Coordinate | Parameter) -> str:
        """Return the unit of a coordinate or parameter."""
        return unit_of(coordinate.kind, self.length_unit)

    def unit_named(self, name: str) -> str | None:
        """Return the unit of a coordinate, of a limit such as ``l1_rate``, of a volume, or None.

        Efforts and power are of actuated joints.
        """
        for c in (*self.pose, *self.joints, *self.passive, *self.parasitic):
            if name == c.name:
                return self.unit(c)
            for ending, order in (("_rate", 1), ("_acceleration", 2)):
                if name == f"{c.name}{ending}":
                    return per_second(self.unit(c), order)
        for joint in self.joints:
            if name == f"{joint.name}_effort":
                return effort_unit(joint.kind)
            if name == f"{joint.name}_power":
                return WATT
        if name in ("tool_x", "tool_y", "tool_z"):
            return self.length_unit
        if name == "volume":
            return self.volume_unit
        lengths = {"projected_volume": 3, "footprint": 2}.get(name)
        return None if lengths is None else measure_unit(["length"] * lengths, self.length_unit)

    @property
    def units(self) -> Units:
        """What units in configurations of this mechanism are."""
        return Units(self.length_unit, self.unit_named)

    @property
    def entry_units(self) -> tuple[tuple[str, ...], ...]:
        """Unit of each entry of the raw Jacobian, row by row."""
        return tuple(
            tuple(f"{self.unit(row)}/{self.unit(column)}" for column in self.joints)
            for row in self.pose
        )

    @property
    def volume_unit(self) -> str:
        """Unit of a volume of poses."""
        return measure_unit([c.kind for c in self.pose], self.length_unit)

    def parameter(self, name: str) -> Parameter:
        """Return a parameter by name."""
        return next(p for p in self.parameters if p.name == name)

    def resolve(self, given: Mapping[str, Any], where: str = "params") -> dict[str, float | None]:
        """Return all parameters, those given checked and the others at their defaults.

        A value is a number in the mechanism's unit or a text with a unit, such as ``"650mm"``; an
        angle may be given in degrees under its name with ``_deg`` appended.

        Raises
        ------
        InputError
            For an unknown name or a value out of the physical range.
        """
        plain = self.plain_names(given, self.parameters, where)
        return {
            p.name: self.check_parameter(p, plain[p.name], where) if p.name in plain else p.default
            for p in self.parameters
        }

    def plain_names(
        self, given: Mapping[str, Any], known: Sequence[Coordinate | Parameter], where: str
    ) -> dict[str, Any]:
        """Return what is given under the names that are known; ``<angle>_deg`` is in degrees.

        Raises
        ------
        InputError
            For a name that is unknown or belongs elsewhere, and one that is given twice.
        """
        kinds = {k.name: k.kind for k in known}
        plain: dict[str, Any] = {}
        for name, value in given.items():
            base, found = name, value
            if name not in kinds and name.endswith("_deg"):
                base = name.removesuffix("_deg")
                found = in_degrees(value)
            if base not in kinds or (base != name and kinds[base] != "angle"):
                raise self.unknown_coordinate(where, name, list(kinds))
            if base in plain:
                raise InputError(f"{where}: {base} is given twice")
            plain[base] = found
        return plain

    def unknown_coordinate(self, where: str, name: str, allowed: Sequence[str]) -> InputError:
        """Return the error for a name that is not allowed, saying where it belongs if it is known.

        Parameters
        ----------
        where : str
        name : str
        allowed : sequence of str
        """
        base = name.removesuffix("_deg")
        places: tuple[tuple[Sequence[Coordinate | Parameter], str], ...] = (
            (self.pose, "a pose coordinate: --pose gives it, domain (--domain) bounds it"),
            (self.joints, "an actuated joint: --joints gives it, limits (--limits) bound it"),
            (self.passive, "a passive joint: limits (--limits) bound it"),
            (self.parasitic, "parasitic: it follows from the pose"),
            (self.parameters, "a parameter: parameters (--params) set it"),
        )
        for group, what in places:
            if base not in allowed and base in [c.name for c in group]:
                return InputError(f"{where}: {base} is {what}; here: {', '.join(allowed)}")
        stem, _, limb = base.rpartition("_")
        if limb.isdigit() and stem in allowed:
            return InputError(f"{where}: {name} is {stem} of one limb; here {stem} is of all limbs")
        return unknown_name(where, name, allowed)

    def beyond_bounds(self, parameters: Mapping[str, Any], where: str) -> list[str]:
        """Return one line for parameters outside their optimisation bounds, none where all are in.

        What is no number, such as a range or an unset parameter, does not count.

        It asks about a unit where a value would be within them in another one.
        """
        found = []
        for name, value in parameters.items():
            parameter = self.parameter(name)
            if not isinstance(value, float) or parameter.bounds is None:
                continue
            low, high = parameter.bounds
            if low <= value <= high:
                continue
            unit = self.unit(parameter)
            units = METRES if parameter.kind == "length" else {ANGLE: 1.0, "deg": math.pi / 180}
            meant = [
                other
                for other, size in units.items()
                if parameter.kind != "ratio"
                and other != unit
                and low <= value * size / units[unit] <= high  # type: ignore[index]
            ]
            found.append(
                f"{name} = {value:g}{'' if unit == ONE else f' {unit}'} is outside its bounds "
                f"{low:g} to {high:g}{'' if unit == ONE else f' {unit}'}"
                f"{f'; {value:g} {meant[0]}?' if meant else ''}"
            )
        return [f"{where}: {', '.join(found)}"] if found else []

    def check_parameter(self, parameter: Parameter, value: Any, where: str) -> float | None:
        """Return one parameter's value as a float, or None for an optional one that is unset."""
        if value is None and parameter.optional:
            return None
        unit = self.unit(parameter)
        reason = ""
        try:
            number = as_quantity(value, unit)
            if parameter.accepts(number):
                return number
        except QuantityError as error:
            reason = f"{error}; " if isinstance(value, str) else ""
        raise InputError(
            f"{where}: {parameter.name}={value} is not allowed: {reason}{parameter.name} "
            f"({parameter.meaning}) must be {parameter.allowed()}, in {unit}"
        )

    def check_mode(self, mode: str | None, where: str = "working mode") -> str:
        """Return the working mode, the first declared one for None."""
        if mode is None:
            return self.working_modes[0]
        if mode not in self.working_modes:
            raise unknown_name(where, mode, self.working_modes)
        return mode

    def check_ranges(
        self, ranges: Mapping[str, Any], coordinates: tuple[Coordinate, ...], where: str
    ) -> dict[str, tuple[float, float]]:
        """Return ranges of pose or joint coordinates, checked; for units see :meth:`resolve`."""
        checked = {}
        for name, value in self.plain_names(ranges, coordinates, where).items():
            coordinate = next(c for c in coordinates if c.name == name)
            ends = list(value) if isinstance(value, list | tuple) else []
            shown = ":".join(map(str, ends)) if ends else value
            try:
                pair = [as_quantity(end, self.unit(coordinate)) for end in ends]
            except QuantityError as error:
                raise InputError(f"{where}: {name}={shown} is no range: {error}") from None
            if len(pair) != 2 or not pair[0] < pair[1]:
                raise InputError(f"{where}: {name}={shown} is no range: lower < upper is needed")
            low, high = pair
            if coordinate.kind == "angle":
                # Results lie in (-pi, pi]: that is where an open range ends.
                low = -math.pi if low == -math.inf else low
                high = math.pi if high == math.inf else high
                if not low < high:
                    raise InputError(f"{where}: {name}={shown} is empty: angles lie in (-pi, pi]")
            checked[name] = (low, high)
        return checked

    def check_coordinates(
        self, given: Mapping[str, Any], coordinates: tuple[Coordinate, ...], where: str
    ) -> dict[str, float]:
        """Return a complete pose or set of joint positions as finite floats.

        For units and degrees see :meth:`resolve`.
        """
        names = [c.name for c in coordinates]
        plain = self.plain_names(given, coordinates, where)
        values: dict[str, float] = {}
        for coordinate in coordinates:
            name = coordinate.name
            if name not in plain:
                raise InputError(f"{where}: {name} is missing, needed: {', '.join(names)}")
            unit = self.unit(coordinate)
            reason = ""
            try:
                values[name] = as_quantity(plain[name], unit)
            except QuantityError as error:
                reason = f"{error}; " if isinstance(plain[name], str) else ""
                values[name] = math.nan
            if not abs(values[name]) <= LARGEST_COORDINATE:
                raise InputError(
                    f"{where}: {name}={plain[name]} is not allowed: {reason}a number of at most "
                    f"{LARGEST_COORDINATE:g} {unit} in size is needed"
                )
        return values


def as_number(value: Any) -> float | None:
    """Return a number as a float, None for anything else (text, booleans, NaN)."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return None if math.isnan(number) else number


def wrap_angle(angle: float) -> float:
    """Return the angle in (-pi, pi]."""
    wrapped = math.remainder(angle, 2 * math.pi)
    return math.pi if wrapped <= -math.pi else wrapped


def within(value: float, limits: tuple[float, float], kind: Kind) -> bool:
    """Return whether a joint position is within its limits; angles count modulo a full turn."""
    low, high = limits
    if kind == "length":
        return low <= value <= high
    if not high - low < 2 * math.pi:
        return True
    return cos(value - (low + high) / 2) >= cos((high - low) / 2) - 4e-16
