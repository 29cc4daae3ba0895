"""Motions through waypoints by a law of the time, as piecewise polynomials.

All are straight lines in the coordinates unless they run through their waypoints without a stop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pmopt.mechanisms.mechanism import Vector

Values = NDArray[np.float64]
LawName = Literal["quintic", "trapezoidal"]


class Path(Protocol):
    """Coordinates over a variable: ``path(x, order)`` is the derivative of that order, (N, k)."""

    def __call__(self, x: Vector, nu: int = 0) -> Values:
        """Return the derivative of order ``nu`` at x (N,)."""


class Law(NamedTuple):
    """How a stretch from rest to rest is run through: its share s of 0..1 over a time 0..1.

    ``peak_rate`` and ``peak_acceleration`` are the largest ds/du and d2s/du2. ``pieces`` are
    polynomials in the time since the piece's start, highest power last.
    """

    knots: tuple[float, ...]
    pieces: tuple[tuple[float, ...], ...]
    peak_rate: float
    peak_acceleration: float


def law_of(name: LawName, blend: float) -> Law:
    """Return a law.

    Parameters
    ----------
    name : {"quintic", "trapezoidal"}
        ``s = 10 u^3 - 15 u^4 + 6 u^5``, or constant acceleration, rate and deceleration.
    blend : float
        Of the trapezoidal law: share of the time in which it accelerates, and again in which it
        decelerates, in (0, 0.5].
    """
    if name == "quintic":
        pieces = ((0.0, 0.0, 0.0, 10.0, -15.0, 6.0),)
        return Law((0.0, 1.0), pieces, 1.875, 10 / math.sqrt(3))
    rate = 1 / (1 - blend)
    slope = rate / blend
    reached = rate * blend / 2
    rise, level = (0.0, 0.0, slope / 2), (reached, rate, 0.0)
    fall = (1 - reached, rate, -slope / 2)
    if blend < 0.5:
        return Law((0.0, blend, 1 - blend, 1.0), (rise, level, fall), rate, slope)
    return Law((0.0, 0.5, 1.0), (rise, fall), rate, slope)


def shortest(
    steps: Values, name: LawName, blend: float | None, rates: Vector, accelerations: Vector
) -> tuple[Vector, list[Law]]:
    """Return the least time of each stretch within rates and accelerations, and its law.

    Parameters
    ----------
    steps : (n, k) float64
        By how much each coordinate changes on each stretch.
    name : {"quintic", "trapezoidal"}
    blend : float or None
        Of the trapezoidal law; None for the share that takes the least time.
    rates, accelerations : (k,) float64
        Largest sizes allowed; inf where there is none.

    Returns
    -------
    (n,) float64
        s; 0 for a stretch without a change.
    list of Law
    """
    size = np.abs(steps)
    # Of the share s: ds/dt <= 1 / slowness, d2s/dt2 <= 1 / inertia.
    slowness = (size / rates).max(axis=1)
    inertia = (size / accelerations).max(axis=1)
    if name == "trapezoidal" and blend is None:
        short = slowness**2 <= inertia
        times = np.where(short, 2 * np.sqrt(inertia), 0.0)
        shares = np.full(len(times), 0.5)
        ramps = np.divide(inertia, slowness, out=np.zeros_like(inertia), where=~short)
        times = np.where(short, times, slowness + ramps)
        shares = np.divide(ramps, times, out=shares, where=~short & (times > 0))
        return times, [law_of(name, float(share)) for share in shares]
    law = law_of(name, 0.25 if blend is None else blend)
    times = np.maximum(law.peak_rate * slowness, np.sqrt(law.peak_acceleration * inertia))
    return times, [law] * len(times)


def rest_to_rest(points: Values, times: Vector, laws: Sequence[Law], dwell: float = 0.0) -> Path:
    """Return straight lines from waypoint to waypoint, at rest at each.

    Parameters
    ----------
    points : (n, k) float64
    times : (n,) float64
        s, ascending: of the arrival at each waypoint, of the start at the first.
    laws : sequence of Law
        Of each of the n - 1 stretches.
    dwell : float
        s, of rest at each waypoint but the last, after the arrival.
    """
    knots, pieces = [float(times[0])], []
    for number, law in enumerate(laws):
        start, way = points[number], points[number + 1] - points[number]
        begin = float(times[number])
        if dwell > 0:
            begin += dwell
            pieces.append(_polynomial([(1.0, start)]))
            knots.append(begin)
        duration = float(times[number + 1]) - begin
        for end, terms in zip(law.knots[1:], law.pieces, strict=True):
            scaled = [(c / duration**n, way) for n, c in enumerate(terms)]
            scaled[0] = (1.0, start + terms[0] * way)
            pieces.append(_polynomial(scaled))
            knots.append(begin + end * duration)
        knots[-1] = float(times[number + 1])
    return _joined(pieces, knots)


def through_quintic(points: Values, times: Vector) -> Path:
    """Return the quintic spline through the waypoints, at rest at its ends only.

    Derivatives up to the fourth are continuous; between waypoints it is no straight line.
    """
    return spline(times, points, 5, "rest")


def through_trapezoidal(points: Values, times: Vector, blend: float) -> Path:
    """Return straight lines joined by parabolas: the trapezoidal law without a stop.

    Each inner waypoint is passed at a distance of at most the change of the rate there times an
    eighth of the time of its parabola, which is ``2 blend`` of the shorter stretch beside it.

    Parameters
    ----------
    points : (n, k) float64
    times : (n,) float64
        s; the first and last line start and end at rest.
    blend : float
        In (0, 0.5].
    """
    spans = np.diff(times)
    shorter = np.minimum(np.append(spans, np.inf), np.insert(spans, 0, np.inf))
    width = 2 * blend * shorter
    # The first and last parabola lie within their stretch: half as long, like that of a stop.
    width[[0, -1]] /= 2
    effective = spans.copy()
    effective[0] -= width[0] / 2
    effective[-1] -= width[-1] / 2
    rates = np.diff(points, axis=0) / effective[:, None]
    knots, pieces = [float(times[0])], []
    position = points[0]
    last = len(points) - 1
    for k in range(len(points)):
        before = np.zeros_like(position) if k == 0 else rates[k - 1]
        after = np.zeros_like(position) if k == last else rates[k]
        centre = times[k] + (width[k] / 2 if k == 0 else 0) - (width[k] / 2 if k == last else 0)
        begin, end = float(centre - width[k] / 2), float(centre + width[k] / 2)
        if begin > knots[-1] * (1 + 1e-15) + 1e-15:
            pieces.append(_polynomial([(1.0, position), (1.0, before)]))
            position = position + before * (begin - knots[-1])
            knots.append(begin)
        duration = end - knots[-1]
        curvature = (after - before) / (2 * duration)
        pieces.append(_polynomial([(1.0, position), (1.0, before), (1.0, curvature)]))
        position = position + (before + after) / 2 * duration
        knots.append(end)
    knots[-1] = float(times[-1])
    return _joined(pieces, knots)


def spline(
    times: Vector, points: Values, degree: int, ends: Literal["free", "rest", "periodic"]
) -> Path:
    """Return the spline of an odd degree, 3 or 5, through samples.

    Parameters
    ----------
    times : (n,) float64
        Ascending; more than ``degree`` of them unless the ends are at rest.
    points : (n, k) float64
    degree : int
    ends : {"free", "rest", "periodic"}
        No knot beside the ends; derivatives of 0 there (the first, and the second of degree 5);
        or all derivatives alike at both.
    """
    from scipy.interpolate import make_interp_spline

    condition: object = None
    if ends == "periodic":
        condition = "periodic"
    elif ends == "rest":
        zero = np.zeros(points.shape[1])
        derivatives = [(order, zero) for order in range(1, (degree + 1) // 2)]
        condition = (derivatives, derivatives)
    made: Path = make_interp_spline(times, points, k=degree, bc_type=condition)
    return made


class Gate(NamedTuple):
    """A pick-and-place path: up, across, down, with rounded corners.

    Attributes
    ----------
    path : Path
        The coordinates over the path's length.
    length : float
        In the length unit, without the roundings.
    """

    path: Path
    length: float


def gate(start: Vector, end: Vector, top: Vector, lengths: Sequence[int], radius: float) -> Gate:
    """Return the path from start to end over the top.

    A corner is rounded within ``radius`` of it, by a curve of the fourth order with continuous
    curvature: run through at a constant rate of the path's length, rates and accelerations are
    continuous.

    Parameters
    ----------
    start, end : (k,) float64
    top : (2, k) float64
        The corners above start and end.
    lengths : sequence of int
        Numbers of the coordinates that are lengths; the others follow.
    radius : float
        In the length unit, > 0, at most the first and last line and half of the line between.
    """
    vertices = np.array([start, *top, end])
    steps = np.diff(vertices, axis=0)
    sizes = np.linalg.norm(steps[:, lengths], axis=1)
    ways = steps / sizes[:, None]
    knots, pieces = [0.0], []
    position = start
    for k, (size, way) in enumerate(zip(sizes, ways, strict=True)):
        trimmed = size - radius * ((k > 0) + (k < 2))
        if trimmed > 1e-12 * sizes.max():
            pieces.append(_polynomial([(1.0, position), (1.0, way)]))
            position = position + trimmed * way
            knots.append(knots[-1] + float(trimmed))
        if k < 2:
            # The direction turns from one line's to the next one's by 3 v^2 - 2 v^3.
            span, turn = 2 * radius, ways[k + 1] - way
            terms = [(1.0, position), (1.0, way), (0.0, turn)]
            terms += [(1 / span**2, turn), (-1 / (2 * span**3), turn)]
            pieces.append(_polynomial(terms))
            position = position + radius * (way + ways[k + 1])
            knots.append(knots[-1] + span)
    return Gate(_joined(pieces, knots), knots[-1])


def _polynomial(terms: Sequence[tuple[float, Vector]]) -> Values:
    """Return coefficients (order + 1, k), lowest power first, from factors and vectors."""
    return np.array([factor * vector for factor, vector in terms])


def _joined(pieces: Sequence[Values], knots: Sequence[float]) -> Path:
    from scipy.interpolate import PPoly

    order = max(len(piece) for piece in pieces)
    padded = [np.vstack([p, np.zeros((order - len(p), p.shape[1]))]) for p in pieces]
    joined: Path = PPoly(np.stack(padded, axis=1)[::-1], np.array(knots))
    return joined
