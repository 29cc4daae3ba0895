"""Rates, accelerations, forces and masses of a mechanism at given poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.mobility.screws import FREEDOMS
from pmopt.compiler import programs
from pmopt.compiler.machine_code import Program
from pmopt.compiler.records import flat
from pmopt.errors import InputError
from pmopt.execution.threads import default_threads, ordered_map
from pmopt.kernels import inverse_dynamics
from pmopt.kernels.inverse_dynamics import Model, Motion, Results, Scratch
from pmopt.mechanisms.bodies import Body
from pmopt.mechanisms.mechanism import (
    PLATFORM,
    Coordinate,
    JointKind,
    Mechanism,
    Parameters,
    Vector,
)
from pmopt.numerics.elementary import sin_cos_of
from pmopt.units import METRES

Values = NDArray[np.float64]

#: Standard figure of the models, m/s^2.
GRAVITY = 9.81
_CHUNK = 2048
_KINDS: dict[JointKind, int] = {
    "R": inverse_dynamics.REVOLUTE, "P": inverse_dynamics.PRISMATIC,
    "C": inverse_dynamics.CYLINDRICAL, "U": inverse_dynamics.UNIVERSAL,
    "S": inverse_dynamics.SPHERICAL, "Pa": inverse_dynamics.PARALLELOGRAM,
}  # fmt: skip
#: Directions a joint's part of the stance holds beside its point.
_DIRECTIONS: dict[JointKind, int] = {"R": 1, "P": 1, "C": 1, "U": 2, "S": 0, "Pa": 2}
_ROLES = ("x", "y", "z", "yaw", "pitch", "roll")


@dataclass(frozen=True)
class State:
    """What holds at N instants; SI units but for ``joints`` and ``passive`` positions.

    Attributes
    ----------
    joints, joint_rates, joint_accelerations : (N, n)
        Positions in the mechanism's unit, rates in m/s and rad/s.
    passive, passive_rates, passive_accelerations : (N, p)
        Of :attr:`Mechanism.followed`.
    platform : (N, 3, 6)
        Values, rates and accelerations of x, y, z, yaw, pitch, roll.
    efforts : (N, n)
        N, N m.
    kinetic, potential : (N,)
        J.
    centres : (N, B, 3, 3)
        Position, velocity and acceleration of the centre of mass of every body. Empty where they
        are not asked for.
    mass_matrix : (N, n, n)
        By pose coordinates: kinetic energy is X' M X' / 2. Empty where it is not asked for.
    inverse_jacobian : (N, n, n)
        q' by X'.
    valid : (N,) bool
        False where the joints do not determine the motion.
    """

    joints: Values
    joint_rates: Values
    joint_accelerations: Values
    passive: Values
    passive_rates: Values
    passive_accelerations: Values
    platform: Values
    efforts: Values
    kinetic: Vector
    potential: Vector
    centres: Values
    mass_matrix: Values
    inverse_jacobian: Values
    valid: NDArray[np.bool_]


def angular_motion(platform: Values) -> Values:
    """Return angular velocity and acceleration, (N, 2, 3), in the base frame.

    Parameters
    ----------
    platform : (N, 3, 6) float64
        See :class:`State`: yaw, pitch, roll of Rz Ry Rx are the last three, with their rates.
    """
    (a, b, _), (da, db, dc), (dda, ddb, ddc) = (platform[:, k, 3:].T for k in range(3))
    (sin_a, cos_a), (sin_b, cos_b) = sin_cos_of(a), sin_cos_of(b)
    zero, one = np.zeros_like(a), np.ones_like(a)
    about_z = np.stack([zero, zero, one], axis=1)
    about_y = np.stack([-sin_a, cos_a, zero], axis=1)
    about_x = np.stack([cos_a * cos_b, sin_a * cos_b, -sin_b], axis=1)

    def weighed(*rates: Vector) -> Values:
        first, second, third = (r[:, None] for r in rates)
        total: Values = first * about_z + second * about_y + third * about_x
        return total

    bias = (da * db)[:, None] * np.cross(about_z, about_y)
    bias += dc[:, None] * np.cross(weighed(da, db, zero), about_x)
    return np.stack([weighed(da, db, dc), weighed(dda, ddb, ddc) + bias], axis=1)


class Mover:
    """Moves one design of a mechanism: kinematics to second order and inverse dynamics.

    Parameters
    ----------
    mechanism : Mechanism
    parameters : mapping
        Complete and checked.
    working_mode : str
    bodies : sequence of Body
        None of them: efforts are 0.
    gravity : (3,) of float, optional
        m/s^2; default 9.81 along :attr:`Mechanism.down`.
    threads : int, optional
        Results do not depend on it.
    notify : callable, optional
        Receives a line when kernels have to be compiled.

    Raises
    ------
    InputError
        If the mechanism does not declare how it moves, or a body is on a joint it does not have.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        parameters: Parameters,
        working_mode: str,
        bodies: Sequence[Body] = (),
        gravity: Sequence[float] | None = None,
        threads: int | None = None,
        notify: Callable[[str], None] | None = None,
    ) -> None:
        posture = mechanism.posture
        if posture is None:
            raise InputError(f"{mechanism.name} declares no posture: it cannot be moved")
        self.mechanism, self.parameters = mechanism, parameters
        self.working_mode = working_mode
        self.threads = threads or default_threads()
        self.unit = METRES[mechanism.length_unit]
        self.bodies = tuple(bodies)
        self.gravity = np.array(
            [GRAVITY * d for d in mechanism.down] if gravity is None else gravity, dtype=float
        )
        self._constants = np.array(
            flat(mechanism.kernel_constants(parameters, working_mode, 1.0, {})), dtype=float
        )
        self._tables()
        self._kernel = programs.moving(
            programs.Moving(
                posture,
                len(mechanism.pose),
                mechanism.constants,
                self._stance_size,
            ),
            None
            if notify is None
            else lambda: notify(f"compiling the motion of {mechanism.name}, once: some seconds"),
        )

    def _tables(self) -> None:
        mechanism = self.mechanism
        own = mechanism.resolve({})
        chains = mechanism.layout(own, mechanism.home(own))
        joints: list[list[int]] = []
        limbs: list[list[int]] = []
        drives: dict[str, int] = {}
        starts: list[int] = []  # number of each limb's first joint
        place = mechanism.structure.posture_row.layout.start
        column = 0
        for i, chain in enumerate(chains):
            starts.append(len(joints))
            limbs.append([len(joints), len(chain.joints), column, 0, column + i])
            for k, joint in enumerate(chain.joints):
                last = k == len(chain.joints) - 1
                freedoms = FREEDOMS[joint.kind]
                joints.append(
                    [i, _KINDS[joint.kind], place, column, freedoms, -1 if last else len(joints)+1]
                )  # fmt: skip
                if joint.drive is not None:
                    drives[joint.drive[0]] = column + joint.drive[1]
                place += 3 + 3 * _DIRECTIONS[joint.kind]
                column += freedoms
            limbs[i][3] = column - limbs[i][2]
        self._stance_size = place
        self._joints = np.array(joints, dtype=np.int64)
        self._limbs = np.array(limbs, dtype=np.int64)
        self._columns = column
        self._drives = np.array([drives[c.name] for c in mechanism.joints], dtype=np.int64)
        self._roles = np.array(
            [
                _ROLES.index(role) if role in _ROLES else inverse_dynamics.COLUMN + drives[role]
                for role in mechanism.roles
            ],
            dtype=np.int64,
        )
        self._followed = [
            [(limbs[limb][2] + number, weight) for limb, number, weight in terms]
            for terms in mechanism.followed.values()
        ]
        table, masses = [], []
        for body in self.bodies:
            if body.limb == PLATFORM:
                joint_number = -1
            else:
                count = limbs[body.limb][1] if 0 <= body.limb < len(limbs) else 0
                if not 0 <= body.joint < count:
                    raise InputError(
                        f"body {body.name!r}: {mechanism.name} has no joint {body.joint} in limb "
                        f"{body.limb}"
                    )
                joint_number = starts[body.limb] + body.joint
            table.append(
                [
                    joint_number,
                    inverse_dynamics.BARS if body.part == "bars" else inverse_dynamics.LINK,
                ]
            )
            centre = self.unit * np.asarray(body.centre, dtype=float)
            masses.append([body.mass, *centre, *np.asarray(body.inertia, dtype=float).ravel()])
        self._bodies = np.array(table, dtype=np.int64).reshape(-1, 2)
        self._masses = np.array(masses, dtype=float).reshape(-1, 13)

    @property
    def kernels(self) -> dict[Program, tuple[str, ...]]:
        """The compiled text of this mover and the entry it calls."""
        return {self._kernel: ("move_all",)}

    def si(self, coordinates: Sequence[Coordinate]) -> Vector:
        """Return the factors that turn coordinates' rates to m and rad."""
        return np.array([self.unit if c.kind == "length" else 1.0 for c in coordinates])

    def state(
        self, poses: Values, rates: Values, accelerations: Values, masses: bool = False,
        centres: bool = True,
    ) -> State:  # fmt: skip
        """Return what holds at poses (N, n) with these rates and accelerations, mechanism's units.

        There is a ``mass_matrix`` only with ``masses``, and there are no centres without
        ``centres``. Poses have to be reachable; what is not known is NaN.
        """
        mechanism = self.mechanism
        n, columns, count = len(mechanism.joints), self._columns, len(poses)
        factor = self.si(mechanism.pose)
        scaled = [np.ascontiguousarray(a * factor) for a in (rates, accelerations)]
        poses = np.ascontiguousarray(poses)
        followed = len(self._followed)
        row = self.mechanism.structure.posture_row
        joints, passive = np.empty((count, n)), np.empty((count, followed))
        turned, swung = np.empty((2, count, n)), np.zeros((2, count, followed))
        platform = np.empty((count, 3, 6))
        efforts = np.empty((count, n))
        energies = np.empty((count, 2))
        bodies = len(self.bodies)
        middles = np.empty((count if centres else 0, bodies, 9))
        # Nothing is read of matrices that are not asked for.
        matrix = np.full((count, n, n), np.nan) if masses else np.empty((0, n, n))
        inverse = np.empty((count, n, n))
        valid = np.empty(count, dtype=np.uint8)

        def chunk(start: int) -> None:
            part = slice(start, min(start + _CHUNK, count))
            size = part.stop - start
            stance, moved = np.empty((size, self._stance_size)), np.empty((size, columns, 2))
            self._kernel.move_all(
                *Motion(poses[part], scaled[0][part], scaled[1][part]),
                *Model(
                    constants=self._constants,
                    unit=self.unit,
                    gravity=self.gravity,
                    joints=self._joints,
                    limbs=self._limbs,
                    roles=self._roles,
                    drives=self._drives,
                    bodies=self._bodies,
                    masses=self._masses,
                    with_mass_matrix=int(masses),
                ),
                *Results(
                    stances=stance,
                    platform=platform[part],
                    rates=moved,
                    efforts=efforts[part],
                    energies=energies[part],
                    centres=middles[part] if centres else np.empty((size, bodies, 9)),
                    mass_matrix=matrix[part] if masses else np.empty((size, n, n)),
                    inverse_jacobian=inverse[part],
                    valid=valid[part],
                ),
                *_scratch(len(self._joints), columns, len(self._limbs), n),
            )
            joints[part] = stance[:, row.joints]
            passive[part] = stance[:, row.followed]
            turned[:, part] = moved[:, self._drives].transpose(2, 0, 1)
            for k, terms in enumerate(self._followed):
                for c, weight in terms:
                    swung[:, part, k] += weight * moved[:, c].T
            known = np.isfinite(moved).all(axis=(1, 2)) & np.isfinite(platform[part]).all((1, 2))
            valid[part] &= known

        for _ in ordered_map(chunk, range(0, count, _CHUNK), self.threads):
            pass
        state = State(
            joints=joints,
            joint_rates=turned[0],
            joint_accelerations=turned[1],
            passive=passive,
            passive_rates=swung[0],
            passive_accelerations=swung[1],
            platform=platform,
            efforts=efforts,
            kinetic=energies[:, 0],
            potential=energies[:, 1],
            centres=middles.reshape(len(middles), bodies, 3, 3),
            mass_matrix=matrix,
            inverse_jacobian=inverse,
            valid=valid.astype(bool),
        )
        for item in fields(state):
            values = getattr(state, item.name)
            if item.name != "valid" and len(values) == count:
                values[~state.valid] = np.nan
        return state


def _scratch(joints: int, columns: int, limbs: int, order: int) -> Scratch:
    """Return the scratch arrays of :func:`pmopt.kernels.inverse_dynamics.move`."""
    rows = 6 * limbs + order
    return Scratch(
        screws=np.empty((columns, 6)),
        derivatives=np.empty((columns, 6)),
        turned=np.zeros((columns, 2, 6)),
        twists=np.empty((columns + limbs, 6)),
        changes=np.empty((limbs + 3, 6)),
        inverses=np.empty((columns, 6)),
        qt=np.empty((rows, rows)),
        r=np.empty((6, 6)),
        square=np.empty((rows, max(6, order))),
        rows=np.empty((rows, 6)),
        pseudo=np.empty((6, rows)),
        right=np.empty(rows),
        by_pose=np.empty((columns, order)),
        frames=np.empty((3, 12)),
        partials=np.empty((2, order, 6)),
        tensors=np.empty((6, 9)),
        small=np.empty(max(6, columns)),
    )
