"""MuJoCo at the work of this package: inverse dynamics and steps of a mechanism's model.

Nothing here knows a mechanism's equations. The model's own equality residuals r(q) and their
Jacobian J, as MuJoCo computes them, close the loops, and S picks the actuated coordinates::

    r(q) = 0, S q = q_a          Newton, from the instant before
    [J; S] v = [0; v_a]          rates of all tree coordinates
    [J; S] a = [-J' v; a_a]      accelerations

in least squares, as equations may say the same twice. J' v is the derivative of J(q) v along
q(t) with v held, by differences of 8th order. MuJoCo's inverse dynamics asks of the open tree
f = S^T effort + J^T lambda; the columns of V, the rates by unit rates of the actuated joints, are
in the null space of J and S V = 1, hence::

    effort = V^T f
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.errors import PmoptError
from pmopt.mechanisms.mechanism import Matrix, Vector

Values = NDArray[np.float64]

#: Weights of the central difference of 8th order.
_WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
#: Step of the differences, as a share of a radian or of the model's size.
_STEP = 0.02
#: Newton ends when a step is this small, rad or share of the size, or no longer shrinks.
_CLOSED = 1e-13
_ROUNDS = 30
#: Gaps of the loops, over the size, that count as open.
_OPEN = 1e-9


def require_mujoco() -> Any:
    """Import and return the engine.

    Raises
    ------
    PmoptError
        When it is not installed.
    """
    try:
        import mujoco
    except ImportError:
        raise PmoptError(
            "the engine mujoco is not installed: pip install 'pmopt[engines]'"
        ) from None
    return mujoco


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the engine from writing warnings to a file in the working directory.

    What they are about ends in an error of ours.
    """
    mujoco = require_mujoco()
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


class Followed(NamedTuple):
    """What the engine's inverse dynamics give for N instants.

    Attributes
    ----------
    efforts : (N, n)
        N, N m.
    joints : (N, n)
        Actuated joints of the closed loops, m and rad.
    centres : (N, B, 3)
        Of the bodies' mass, m.
    gaps : (N,)
        Largest residual of the loops and of the actuated positions, m and rad.
    """

    efforts: Values
    joints: Values
    centres: Values
    gaps: Vector


class Engine:
    """A model in MuJoCo.

    Parameters
    ----------
    xml : str
        The model; see :mod:`pmopt.analysis.multibody.mjcf`.
    actuated : sequence of str
        Joints in the order of all arrays.
    bodies : sequence of str
        Bodies whose centres are reported.

    Raises
    ------
    PmoptError
        When MuJoCo is not installed or refuses the model.
    """

    name = "mujoco"

    @_quiet()
    def __init__(self, xml: str, actuated: Sequence[str], bodies: Sequence[str] = ()) -> None:
        self._mj = require_mujoco()
        try:
            self.model = self._mj.MjModel.from_xml_string(xml)
            #: The same without equalities: inverse dynamics of the open tree.
            self._open = self._mj.MjModel.from_xml_string(xml)
        except ValueError as error:
            raise PmoptError(f"mujoco refuses the model: {error}") from None
        self._open.opt.disableflags |= int(self._mj.mjtDisableBit.mjDSBL_EQUALITY)
        self.data = self._mj.MjData(self.model)
        self._free = self._mj.MjData(self._open)
        model, kinds = self.model, self._mj.mjtJoint
        joints = [model.joint(name).id for name in actuated]
        self._places = model.jnt_qposadr[joints]
        self._columns = model.jnt_dofadr[joints]
        slides = model.jnt_type[model.dof_jntid] == kinds.mjJNT_SLIDE
        self._scale = np.where(slides, model.stat.extent, 1.0)
        self._select = np.eye(model.nv)[self._columns]
        self._bodies = [model.body(name).id for name in bodies]

    @property
    def version(self) -> str:
        """Version of the engine."""
        return str(self._mj.__version__)

    # -- inverse dynamics --------------------------------------------------------------

    @_quiet()
    def inverse(self, t: Vector, joints: Values, rates: Values, accelerations: Values) -> Followed:
        """Return what drives a motion, and where it leads.

        Parameters
        ----------
        t : (N,)
            s, ascending, from the model's own pose on.
        joints, rates, accelerations : (N, n)
            Of the actuated joints, m and rad.

        Raises
        ------
        PmoptError
            When the loops do not close at an instant.
        """
        count, n = joints.shape
        efforts, found, gaps = np.empty((count, n)), np.empty((count, n)), np.empty(count)
        centres = np.empty((count, len(self._bodies), 3))
        data = self._free
        q = np.array(self.model.qpos0)
        for k in range(count):
            if k:
                h = float(t[k] - t[k - 1])
                self._mj.mj_integratePos(self.model, q, data.qvel + 0.5 * h * data.qacc, h)
            try:
                q, gaps[k] = self.close(q, joints[k])
            except PmoptError as error:
                raise PmoptError(f"t = {t[k]:.9g} s: {error}") from None
            efforts[k] = self._efforts(q, rates[k], accelerations[k])
            found[k] = q[self._places]
            centres[k] = data.xipos[self._bodies]
        return Followed(efforts, found, centres, gaps)

    def close(self, q: Vector, joints: Vector) -> tuple[Vector, float]:
        """Return tree positions near q that close the loops with these joints, and the gap left.

        Raises
        ------
        PmoptError
            When Newton's method finds none.
        """
        q = np.array(q)
        best, size = math.inf, float(self.model.stat.extent)
        for _ in range(_ROUNDS):
            jacobian, residual = self._constraints(q)
            missed = np.concatenate([-residual, joints - q[self._places]])
            step = self._solve(jacobian, missed)
            length = float(np.abs(step / self._scale).max())
            if not length < math.inf:
                break
            if length <= _CLOSED or (length < 1e-9 and length >= best):
                break
            best = length
            # Long steps are cut: loops have more than one assembly.
            step *= min(1.0, 0.3 / length)
            self._mj.mj_integratePos(self.model, q, step, 1.0)
        gap = float(np.abs(missed).max())
        if not gap <= _OPEN * max(size, 1.0):
            raise PmoptError(f"the engine's loops do not close: {gap:.3g} (m, rad) are left")
        return q, gap

    def _constraints(self, q: Vector) -> tuple[Matrix, Vector]:
        """Return the equalities' Jacobian (m, nv) and residuals (m,) as the engine has them."""
        mj, model, data = self._mj, self.model, self.data
        data.qpos[:] = q
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)
        mj.mj_tendon(model, data)
        mj.mj_makeConstraint(model, data)
        rows = data.ne
        return (
            data.efc_J.reshape(-1, model.nv)[:rows].copy(), data.efc_pos[:rows].copy(),
        )  # fmt: skip

    def _solve(self, jacobian: Matrix, right: Values) -> Values:
        """Solve [J; S] x = right for x, in least squares, lengths over the model's size."""
        matrix = np.concatenate([jacobian, self._select]) * self._scale
        found = np.linalg.lstsq(matrix, right, rcond=1e-11)[0]
        return np.asarray((self._scale * found.T).T)

    def partial(self, q: Vector) -> tuple[Matrix, Matrix]:
        """Return V (nv, n), tree rates by unit rates of the actuated joints, and J (m, nv)."""
        jacobian, _ = self._constraints(q)
        n = len(self._columns)
        right = np.concatenate([np.zeros((len(jacobian), n)), np.eye(n)])
        return self._solve(jacobian, right), jacobian

    def _drift(self, q: Vector, v: Vector) -> Vector:
        """Return J' v."""
        speed = float(np.abs(v / self._scale).max())
        total = np.zeros(self.data.ne)
        if speed == 0.0:
            return total
        h = _STEP / speed
        for k, weight in enumerate(_WEIGHTS, 1):
            for side in (1.0, -1.0):
                moved = np.array(q)
                self._mj.mj_integratePos(self.model, moved, v, side * k * h)
                total += side * weight / h * (self._constraints(moved)[0] @ v)
        return total

    def _efforts(self, q: Vector, rates: Vector, accelerations: Vector) -> Vector:
        partial, jacobian = self.partial(q)
        v = partial @ rates
        drift = self._drift(q, v)
        a = self._solve(jacobian, np.concatenate([-drift, accelerations]))
        data = self._free
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        self._mj.mj_inverse(self._open, data)
        return np.asarray(partial.T @ data.qfrc_inverse)

    # -- forward -----------------------------------------------------------------------

    @_quiet()
    def begin(self, joints: Vector, rates: Vector) -> None:
        """Place the model at rest or in motion, its loops closed."""
        q, _ = self.close(self.model.qpos0, joints)
        partial, _ = self.partial(q)
        self._mj.mj_resetData(self.model, self.data)
        self.data.qpos[:] = q
        self.data.qvel[:] = partial @ rates
        self._mj.mj_forward(self.model, self.data)

    def measure(self) -> tuple[Vector, Vector]:
        """Return positions and rates of the actuated joints."""
        return self.data.qpos[self._places].copy(), self.data.qvel[self._columns].copy()

    @_quiet()
    def advance(self, efforts: Vector, steps: int) -> bool:
        """Hold these efforts for some steps; return whether the state is still finite."""
        self.data.ctrl[:] = efforts
        self._mj.mj_step(self.model, self.data, nstep=steps)
        return bool(np.isfinite(self.data.qpos).all() and self.data.time > 0.0)

    @_quiet()
    def joint_masses(self) -> Vector:
        """Return the mass or inertia (n,) that each actuated joint feels, the others free.

        At the model's own pose, kg or kg m^2: 1 / (M^-1)_ii of the mass matrix by these joints,
        which inverse dynamics at rest give column by column.
        """
        q = np.array(self.model.qpos0)
        partial, _ = self.partial(q)
        data = self._free
        data.qpos[:], data.qvel[:] = q, 0.0
        momenta = []
        for change in (np.zeros(len(partial)), *partial.T):
            data.qacc[:] = change
            self._mj.mj_inverse(self._open, data)
            momenta.append(data.qfrc_inverse.copy())
        matrix = (np.array(momenta[1:]) - momenta[0]) @ partial
        return np.asarray(1 / np.diag(np.linalg.inv(matrix)))
