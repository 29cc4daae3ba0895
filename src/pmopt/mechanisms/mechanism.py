"""What a mechanism declares. Each mechanism is one file with a ``MECHANISM`` of this kind."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from pmopt.errors import InputError, unknown_name
from pmopt.mechanisms.declarations import (
    LARGEST_COORDINATE,
    LARGEST_LENGTH,
    SMALLEST_LENGTH,
    Coordinate,
    JacobianKind,
    Limb,
    Matrix,
    Parameter,
    Parameters,
    Ranges,
    Vector,
    as_number,
    within,
    wrap_angle,
)
from pmopt.mechanisms.joints import PLATFORM, Chain, Joint, JointKind
from pmopt.mechanisms.named import Named
from pmopt.mechanisms.proofs import Curve, Implicit
from pmopt.mechanisms.solutions import Assemblies, ForwardSolution, InverseSolution, Reach
from pmopt.mechanisms.structure import Structure

if TYPE_CHECKING:
    from pmopt.compiler.programs import Assembler
    from pmopt.mechanisms.bodies import Body

#: What a mechanism is declared with: a file of the catalogue takes all of it from here.
__all__ = [
    "LARGEST_COORDINATE", "LARGEST_LENGTH", "PLATFORM", "SMALLEST_LENGTH", "Assemblies", "Chain",
    "Coordinate", "Curve", "ForwardSolution", "Implicit", "InverseSolution", "JacobianKind",
    "Joint", "JointKind", "Limb", "Matrix", "Mechanism", "Parameter", "Parameters", "Ranges",
    "Reach", "Vector", "as_number", "within", "wrap_angle",
]  # fmt: skip

#: Poses from which on it pays to load or compile what solves them.
_MANY = 64


class Mechanism(Named, ABC):
    """A parallel mechanism: declarations, clear NumPy-level functions and one hot kernel."""

    title: ClassVar[str]
    description: ClassVar[str]
    source: ClassVar[str]
    freedom: ClassVar[str]
    limbs: ClassVar[tuple[Limb, ...]]
    #: Other readings of the limbs, for ``pmopt mobility``: name to description.
    layouts: ClassVar[Mapping[str, str]] = {}
    #: In words where a measure of :meth:`singularity_measures` vanishes, by ``"kind"`` or by
    #: ``"kind, part"``.
    conditions: ClassVar[Mapping[str, str]]
    default_jacobian: ClassVar[JacobianKind]
    length_meaning: ClassVar[str]

    #: ``kernel(*pose, constants) -> (margin, *entries)``; see pmopt.compiler.program_text. The
    #: margin is >= 0 inside every limit and continuous outside; the entries, row by row, are any
    #: common scalar multiple of the inverse of the Jacobian made homogeneous by the length.
    kernel: ClassVar[Callable[..., tuple[float, ...]]]
    #: What the constants are: a NamedTuple of numbers and of such NamedTuples.
    constants: ClassVar[type[Any]]
    #: Where the kernel solves equations step by step, the equations: what proofs are about.
    implicit: ClassVar[Implicit | None] = None
    curve: ClassVar[Curve | None] = None
    #: Joints, links and platform by the names of their points: :meth:`layout`, :attr:`skeleton`
    #: and :attr:`posture` come from it.
    structure: ClassVar[Structure]
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
    #: What the pose coordinates and the parasitic ones are: ``x``, ``y``, ``z`` of the platform's
    #: centre, ``yaw``, ``pitch``, ``roll`` of Rz Ry Rx, or the name of an actuated joint.
    roles: ClassVar[tuple[str, ...]] = ()
    parasitic_roles: ClassVar[tuple[str, ...]] = ()
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

    # -- what comes from the structure -----------------------------------------------------

    @property
    def skeleton(self) -> Callable[..., tuple[float, ...]]:
        """The kernel function that clearances, cone limits, tool and pictures need."""
        return skeleton_of(self.structure, tuple(c.name for c in self.pose))

    @property
    def posture(self) -> Callable[..., tuple[float, ...]] | None:
        """The kernel function that motions and forces need; None where it is not offered."""
        pose, joints = (tuple(c.name for c in group) for group in (self.pose, self.joints))
        return posture_of(self.structure, pose, joints)

    @property
    def segments(self) -> tuple[int, ...]:
        """Limb (from 0) of each segment of the skeleton, as compiled programs take it.

        PLATFORM stands for the platform's own.
        """
        return tuple(segment.limb for segment in self.structure.segments)

    @property
    def spokes(self) -> tuple[int, ...]:
        """Limb at the far end of each of the platform's segments, as compiled programs take it."""
        return tuple(s.meets for s in self.structure.segments if s.limb == PLATFORM)

    @property
    def cones(self) -> tuple[str, ...]:
        """Names of the passive U and S joints whose cone angle the skeleton has."""
        return self.structure.cone_names

    @property
    def followed(self) -> Mapping[str, tuple[tuple[int, int, float], ...]]:
        """Passive joints that motions show: each the sum of (limb, freedom in it, weight)."""
        return self.structure.followed_terms(self.limbs)

    def layout(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Chain, ...]:
        """Return every limb's joints at a reachable pose: what mobility and drawing read."""
        mode = self.check_mode(working_mode)
        constants = _plain_constants(self, tuple(parameters.items()), mode)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # as in compiled code
            at = self.points_at(parameters, pose, mode, constants)
            return self.structure.layout(at, constants)

    def points_at(
        self, parameters: Parameters, pose: Mapping[str, float], mode: str, constants: Any
    ) -> Any:
        """Return the record of points of a configuration.

        ``constants`` are the kernel's, without limits and a characteristic length.
        """
        return self.structure.points.function(*(float(pose[c.name]) for c in self.pose), constants)

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
        """Return the declared regular pose that defines working modes and aspects."""

    @abstractmethod
    def platform(
        self, parameters: Parameters, pose: Mapping[str, float], working_mode: str | None = None
    ) -> tuple[Matrix, Vector]:
        """Return the platform's rotation (3, 3) and the position (3,) of its centre at a pose.

        The parasitic coordinates are included.
        """

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
        """Say why the mechanism cannot be assembled with these joint positions."""
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
        """Return the numbers of those slacks of the kernel's margin that the limits cannot touch.

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


@functools.cache
def skeleton_of(structure: Structure, pose: tuple[str, ...]) -> Callable[..., tuple[float, ...]]:
    """Return a skeleton, once: what is compiled for it is kept by the function."""
    return structure.skeleton(pose)


@functools.cache
def posture_of(
    structure: Structure, pose: tuple[str, ...], joints: tuple[str, ...]
) -> Callable[..., tuple[float, ...]] | None:
    """Return a posture, once: what is compiled for it is kept by the function."""
    return structure.posture(pose, joints)


@functools.lru_cache(maxsize=16)
def _plain_constants(
    mechanism: Mechanism, parameters: tuple[tuple[str, float | None], ...], mode: str
) -> Any:
    """Return the kernel's constants of a design; layouts are asked for at many poses of one."""
    constants = mechanism.kernel_constants(dict(parameters), mode, 1.0, {})
    return constants if mechanism.constants is not None else tuple(constants)
