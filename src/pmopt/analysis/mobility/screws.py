"""Twists, wrenches, their spaces, and joints and limbs moved by finite displacements.

Points and lengths are divided by a characteristic length and counted from the platform's centre,
so that angles and lengths weigh alike and ranks do not depend on units. A twist is (w, v), the
angular velocity and the velocity of the point at the origin; a wrench is (f, m), the force and
its moment about the origin; they are reciprocal where w.m + v.f = 0. A space is a matrix of
columns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from pmopt.mechanisms.mechanism import Chain, Joint, JointKind, Matrix, Vector

#: Singular values below this share of the largest count as 0.
RANK_TOLERANCE = 1e-8
#: Freedoms of a joint.
FREEDOMS: dict[JointKind, int] = {"R": 1, "P": 1, "C": 2, "U": 2, "S": 3, "Pa": 1}
#: Components smaller than this are rounding, where directions and points are shown.
SNAP = 1e-9
_AXES = np.eye(3)

#: A rigid displacement: rotation and translation, p -> R p + t.
Displacement = tuple[Matrix, Vector]
IDENTITY: Displacement = (np.eye(3), np.zeros(3))


# -- spaces --------------------------------------------------------------------------------


def _svd(columns: Matrix) -> tuple[Matrix, Vector, Matrix, int]:
    if columns.shape[1] == 0:
        rows = columns.shape[0]
        return np.eye(rows), np.zeros(0), np.zeros((0, 0)), 0
    u, values, vt = np.linalg.svd(columns)
    count = int((values > RANK_TOLERANCE * max(float(values[0]), 1e-300)).sum())
    # Spaces are spanned by vectors of about unit size: a tiny matrix is rounding.
    return u, values, vt, count if values[0] > RANK_TOLERANCE else 0


def rank(columns: Matrix) -> int:
    """Return the number of independent columns."""
    return _svd(columns)[3]


def span(columns: Matrix) -> Matrix:
    """Return an orthonormal basis of the span of the columns."""
    u, _, _, count = _svd(columns)
    basis: Matrix = u[:, :count]
    return basis


def null(rows: Matrix) -> Matrix:
    """Return an orthonormal basis of the space perpendicular to every row."""
    if rows.shape[0] == 0:
        return np.eye(rows.shape[1])
    _, _, vt, count = _svd(rows)
    basis: Matrix = vt[count:].T
    return basis


def gap(columns: Matrix) -> tuple[float, float]:
    """Return the least singular value kept and the largest dropped, relative to the largest.

    Infinity and 0 where there is none. The rank is as certain as they lie apart.
    """
    _, values, _, count = _svd(columns)
    if not values.size or not values[0]:
        return math.inf, 0.0
    relative = values / values[0]
    return (
        float(relative[count - 1]) if count else math.inf,
        float(relative[count]) if count < relative.size else 0.0,
    )


def reciprocal(space: Matrix) -> Matrix:
    """Return the wrenches that do no work on a space of twists, or the twists of wrenches."""
    return null(np.vstack([space[3:], space[:3]]).T)


def intersection(*spaces: Matrix) -> Matrix:
    """Return an orthonormal basis of the intersection of all spaces."""
    outside = [null(space.T) for space in spaces]
    return null(np.hstack(outside).T)


def distance(first: Matrix, second: Matrix) -> float:
    """Return the sine of the largest principal angle; 1 where the dimensions differ."""
    a, b = span(first), span(second)
    if a.shape[1] != b.shape[1]:
        return 1.0
    if not a.shape[1]:
        return 0.0
    return min(1.0, float(np.linalg.norm(b - a @ (a.T @ b), 2)))


# -- motion --------------------------------------------------------------------------------


def rotation(vector: Vector) -> Matrix:
    """Return the rotation by a rotation vector."""
    angle = math.sqrt(float(vector @ vector))
    k = _cross(vector)
    a, b = 1.0, 0.5
    if angle > 1e-6:
        a, b = math.sin(angle) / angle, (1 - math.cos(angle)) / angle**2
    matrix: Matrix = np.eye(3) + a * k + b * (k @ k)
    return matrix


def _cross(v: Vector) -> Matrix:
    """Return the matrix of v x; np.cross takes ten times as long for one vector."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def compose(after: Displacement, before: Displacement) -> Displacement:
    """Return the displacement that does ``before``, then ``after``."""
    return after[0] @ before[0], after[0] @ before[1] + after[1]


def inverse(displacement: Displacement) -> Displacement:
    """Return the displacement back."""
    r, t = displacement
    return r.T, -(r.T @ t)


def small(displacement: Displacement) -> Vector:
    """Return (rotation vector, translation of the origin): a twist where both are small."""
    r, t = displacement
    w = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    sine = float(np.linalg.norm(w))
    cosine = (float(np.trace(r)) - 1) / 2
    if sine > 1e-6 or cosine < 0:
        w = w * (math.atan2(sine, cosine) / max(sine, 1e-300))
    return np.concatenate([w, t])


def twists(joint: Joint) -> Matrix:
    """Return the twist of each elementary freedom of a joint, as columns."""

    def turn(axis: Vector) -> Vector:
        return np.concatenate([axis, _cross(joint.point) @ axis])

    def slide(axis: Vector) -> Vector:
        return np.concatenate([np.zeros(3), axis])

    kind, axes = joint.kind, joint.axes
    if kind == "Pa":
        columns = [slide(_cross(axes[0]) @ _bar(joint))]
    elif kind == "P":
        columns = [slide(axes[0])]
    elif kind == "C":
        columns = [turn(axes[0]), slide(axes[0])]
    else:
        columns = [turn(axis) for axis in (axes if kind != "S" else _AXES)]
    return np.array(columns).T


def _bar(joint: Joint) -> Vector:
    if joint.bar is None:
        raise ValueError("a parallelogram without its bar")
    return joint.bar


def limb_twists(chain: Chain) -> Matrix:
    """Return the twists of all elementary freedoms of a limb, (6, f)."""
    return np.hstack([twists(joint) for joint in chain.joints])


def freedoms(chain: Chain) -> int:
    """Return the sum of the freedoms of a limb's joints."""
    return sum(FREEDOMS[joint.kind] for joint in chain.joints)


def drive_columns(chain: Chain) -> dict[str, int]:
    """Return the column of the limb's twists that each drive of the limb moves."""
    found, start = {}, 0
    for joint in chain.joints:
        if joint.drive is not None:
            found[joint.drive[0]] = start + joint.drive[1]
        start += FREEDOMS[joint.kind]
    return found


def locked_twists(chain: Chain) -> Matrix:
    """Return the twists of a limb whose drives stand still."""
    columns = limb_twists(chain)
    driven = set(drive_columns(chain).values())
    return columns[:, [k for k in range(columns.shape[1]) if k not in driven]]


def _joint_displacement(joint: Joint, q: Vector) -> tuple[Displacement, Displacement]:
    """Return what a joint does to all beyond it, and to its own later axis.

    The latter is the displacement of a U joint's first axis.
    """

    def turn(vector: Vector) -> Displacement:
        r = rotation(vector)
        return r, joint.point - r @ joint.point

    kind, axes = joint.kind, joint.axes
    if kind == "Pa":
        bar = _bar(joint)
        return (np.eye(3), rotation(q[0] * axes[0]) @ bar - bar), IDENTITY
    if kind == "P":
        return (np.eye(3), q[0] * axes[0]), IDENTITY
    if kind == "C":
        r, t = turn(q[0] * axes[0])
        return (r, t + q[1] * axes[0]), IDENTITY
    if kind == "U":
        first = turn(q[0] * axes[0])
        return compose(first, turn(q[1] * axes[1])), first
    # R about its axis, S by its rotation vector.
    return turn(q if kind == "S" else q[0] * axes[0]), IDENTITY


def move(chain: Chain, q: Vector) -> tuple[Chain, Displacement]:
    """Return a limb with its joints moved by q, and the displacement of its end.

    The product of exponentials, joint by joint from the base.
    """
    total, start, joints = IDENTITY, 0, []
    for joint in chain.joints:
        count = FREEDOMS[joint.kind]
        own, first = _joint_displacement(joint, q[start : start + count])
        r, t = total
        axes = tuple(r @ (first[0] @ a if k else a) for k, a in enumerate(joint.axes))
        bar = None
        if joint.bar is not None:
            bar = r @ rotation(q[start] * joint.axes[0]) @ joint.bar
        joints.append(replace(joint, point=r @ joint.point + t, axes=axes, bar=bar))
        total = compose(total, own)
        start += count
    return Chain(chain.name, tuple(joints)), total


def scaled(chain: Chain, centre: Vector, length: float) -> Chain:
    """Return a limb with points counted from a centre and lengths divided."""
    return Chain(
        chain.name,
        tuple(
            replace(
                joint,
                point=(np.asarray(joint.point, dtype=float) - centre) / length,
                axes=tuple(np.asarray(a, dtype=float) / np.linalg.norm(a) for a in joint.axes),
                bar=None if joint.bar is None else np.asarray(joint.bar, dtype=float) / length,
            )
            for joint in chain.joints
        ),
    )


# -- screws one can read -------------------------------------------------------------------


@dataclass(frozen=True)
class Screw:
    """A twist or wrench as a line: direction, a point of it and the pitch.

    ``point`` and ``pitch`` are None for a translation or couple; the pitch is in lengths per
    radian for a twist, in lengths for a wrench.
    """

    kind: Literal["rotation", "translation", "screw", "force", "couple", "wrench"]
    direction: tuple[float, ...]
    point: tuple[float, ...] | None
    pitch: float | None

    def text(self, unit: str) -> str:
        """Return the screw in words."""
        turning = self.kind in ("rotation", "couple")
        text = f"{self.kind} {'about' if turning else 'along'} {_direction(self.direction)}"
        if self.point is not None:
            shown = ", ".join(_number(v) for v in self.point)
            text += f" through ({shown}) {unit}"
        if self.kind in ("screw", "wrench") and self.pitch is not None:
            per = f"{unit}/rad" if self.kind == "screw" else unit
            text += f", pitch {_number(self.pitch)} {per}"
        return text

    def to_dict(self, unit: str) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "text": self.text(unit),
            "kind": self.kind,
            "direction": list(self.direction),
            "point": None if self.point is None else list(self.point),
            "pitch": self.pitch,
        }


def _number(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-12 else value:.4g}"


def _direction(direction: tuple[float, ...]) -> str:
    for name, axis in zip("xyz", _AXES, strict=True):
        if abs(abs(float(np.dot(axis, direction))) - 1) < 1e-12:
            return name
    return f"({', '.join(_number(v) for v in direction)})"


def _line(
    a: Vector, b: Vector, is_twist: bool, centre: Vector, length: float, marks: list[Vector]
) -> Screw:
    """Return the screw (a, b); its point is the first of ``marks`` on it, else the nearest one."""
    size = float(np.linalg.norm(a))
    if size < SNAP:
        kind: Any = "translation" if is_twist else "couple"
        return Screw(kind, _shown(_upright(b / np.linalg.norm(b))), None, None)
    unit = a / size
    moment = b / size
    pitch = float(unit @ moment)
    foot = np.cross(unit, moment)
    pure = abs(pitch) < SNAP
    for mark in marks:
        if np.linalg.norm(np.cross(unit, foot - mark)) < SNAP * 10:
            foot = mark
            break
    kind = ("rotation" if pure else "screw") if is_twist else ("force" if pure else "wrench")
    place = centre + length * foot
    place[np.abs(place) < SNAP * length] = 0.0
    return Screw(kind, _shown(_upright(unit)), _shown(place), 0.0 if pure else pitch * length)


def _shown(vector: Vector) -> tuple[float, ...]:
    return tuple(0.0 if v == 0 else float(v) for v in vector)


def _upright(unit: Vector) -> Vector:
    """Return the direction with rounding removed and its first component positive."""
    clean = np.where(np.abs(unit) < SNAP, 0.0, unit)
    clean /= np.linalg.norm(clean)
    return clean if clean[np.flatnonzero(clean)[0]] > 0 else -clean


def echelon(columns: Matrix, width: int) -> Matrix:
    """Return the columns' combinations whose first ``width`` rows are in reduced echelon form."""
    rows = columns.T.copy()
    top = 0
    for k in range(width):
        if top == rows.shape[0]:
            break
        best = top + int(np.argmax(np.abs(rows[top:, k])))
        if abs(rows[best, k]) < SNAP * 10:
            continue
        rows[[top, best]] = rows[[best, top]]
        rows[top] /= rows[top, k]
        for other in range(rows.shape[0]):
            if other != top:
                rows[other] -= rows[other, k] * rows[top]
        top += 1
    return rows.T


def readable(
    space: Matrix, is_twist: bool, centre: Vector, length: float, marks: list[Vector]
) -> tuple[Screw, ...]:
    """Return a basis of a space in its simplest form: pure lines where there are some.

    Parameters
    ----------
    space : (6, k) float64
        Of twists or wrenches, in scaled lengths.
    is_twist : bool
    centre, length
        What the lengths were scaled by.
    marks : list of (3,) float64
        Points, scaled, that lines are preferably given by: joint centres.
    """
    if not space.shape[1]:
        return ()
    _, _, vt, count = _svd(space[:3])
    free = space @ vt[count:].T if vt.size else space  # translations or couples
    free = echelon(free[3:], 3) if free.shape[1] else np.zeros((3, 0))
    lines = echelon(space @ vt[:count].T, 3)
    basis = span(free)
    for k in range(lines.shape[1]):
        lines[3:, k] = _least_pitch(lines[:3, k], lines[3:, k], basis)
    lines = _pure(lines)
    found = [_line(x[:3], x[3:], is_twist, centre, length, marks) for x in lines.T]
    found += [_line(np.zeros(3), b, is_twist, centre, length, marks) for b in free.T]
    return tuple(found)


def _least_pitch(a: Vector, b: Vector, free: Matrix) -> Vector:
    """Return b less a combination of the free vectors: shortest, of pitch 0 if it can be."""
    rest: Vector = b - free @ (free.T @ b)
    along = free.T @ a
    size = float(along @ along)
    if size > SNAP:
        rest = rest - free @ along * (float(a @ rest) / size)
    return rest


def _pure(lines: Matrix) -> Matrix:
    """Return another basis with lines of pitch 0, or principal screws, where there is need."""
    form = lines[:3].T @ lines[3:]
    form = (form + form.T) / 2
    if np.abs(np.diag(form)).max(initial=0.0) < SNAP * 10:
        return lines
    metric = lines[:3].T @ lines[:3]
    root = np.linalg.cholesky(np.linalg.inv(metric))
    pitches, vectors = np.linalg.eigh(root.T @ form @ root)
    principal = root @ vectors
    if lines.shape[1] == 2 and pitches[0] < -SNAP and pitches[1] > SNAP:
        # Two screws of opposite pitch span two lines of pitch 0.
        a, b = math.sqrt(pitches[1]), math.sqrt(-pitches[0])
        principal = principal @ np.array([[a, a], [b, -b]]) / math.hypot(a, b)
    matrix: Matrix = lines @ principal
    return matrix
