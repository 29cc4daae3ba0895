"""Trajectories from recorded points: splines through them and fits to them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.pose_rows import TIME, read_rows
from pmopt.analysis.motion.waypoint_laws import Path as Curve
from pmopt.errors import InputError, unknown_name
from pmopt.mechanisms.mechanism import LARGEST_COORDINATE, Coordinate, Mechanism, Vector
from pmopt.numerics.derivatives import Jet

Values = NDArray[np.float64]

#: A step of a recording that is this much longer than its median is a gap.
_GAP = 2.5
#: Periods that are looked for, in cycles a record: from, to, step.
_FEWEST, _MOST, _STEP = 0.5, 100.0, 0.1


class Recording(NamedTuple):
    """Points over time: ``t`` (N,) in s, ``values`` (N, k), ``lines`` of the file, and notes."""

    t: Vector
    values: Values
    lines: NDArray[np.int64]
    notes: tuple[str, ...] = ()


def read_recording(
    path: Path,
    mechanism: Mechanism,
    coordinates: Sequence[Coordinate],
    where: str,
    largest_step: float | None = None,
) -> Recording:
    """Read a CSV file with a column ``t`` and one of each coordinate.

    Angles may stand in degrees, in columns whose name ends in ``_deg``. Further columns are left
    aside, and named in the notes.

    Parameters
    ----------
    path : Path
    mechanism : Mechanism
    coordinates : sequence of Coordinate
    where : str
        What errors call the file.
    largest_step : float, optional
        s, beyond which a step in time is a gap; default: 2.5 times the median step.

    Raises
    ------
    InputError
        One line with file and row.
    """
    found = read_rows(path, where, mechanism, coordinates)
    if found.times is None:
        names = ", ".join(c.name for c in coordinates)
        raise InputError(f"{where}: {path}: column {TIME} is missing, needed: {TIME}, {names}")
    t, lines = found.times, found.lines
    for coordinate in coordinates:
        large = np.flatnonzero(~(np.abs(found.columns[coordinate.name]) <= LARGEST_COORDINATE))
        if len(large):  # said as of any pose
            k = int(large[0])
            place = f"{where}: {path}, line {lines[k]}"
            mechanism.check_coordinates(found.poses(k, k + 1)[0], tuple(coordinates), place)
    steps = np.diff(t)
    for k in np.flatnonzero(steps <= 0)[:1]:
        raise InputError(
            f"{where}: {path}, line {lines[k + 1]}: t={float(t[k + 1])!r} s does not come after "
            f"t={float(t[k])!r} s of line {lines[k]}"
        )
    longest = largest_step or _GAP * float(np.median(steps)) if len(steps) else math.inf
    for k in np.flatnonzero(steps > longest)[:1]:
        raise InputError(
            f"{where}: {path}, line {lines[k + 1]}: a gap from t={float(t[k])!r} to "
            f"{float(t[k + 1])!r} s: at most {longest:g} s is allowed (trajectory.largest_step)"
        )
    values = np.stack([found.columns[c.name] for c in coordinates], axis=1)
    for k, coordinate in enumerate(coordinates):
        if coordinate.kind == "angle":  # recorded in (-pi, pi], it may pass over a full turn
            values[:, k] = np.unwrap(values[:, k])
    return Recording(t, values, lines, found.notes)


@dataclass(frozen=True)
class Residual:
    """What a fit leaves of one coordinate, and the fit itself.

    ``rms`` and ``max`` are of the differences at the recorded points, in ``unit``. Harmonics:
    ``offset + sum_k amplitude_k sin(2 pi k t / period + phase_k)``, t in s and phases in rad.
    """

    coordinate: str
    unit: str
    points: int
    rms: float
    max: float
    period: float | None = None
    offset: float | None = None
    amplitudes: tuple[float, ...] = ()
    phases: tuple[float, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            k: list(v) if isinstance(v, tuple) else v
            for k, v in asdict(self).items()
            if v not in (None, ())
        }


@dataclass(frozen=True)
class Harmonics:
    """Sums of harmonics, one a coordinate: period (k,), offset (k,), sine and cosine (count, k)."""

    period: Vector
    offset: Vector
    sine: Values
    cosine: Values

    def __call__(self, t: Vector) -> list[Jet]:
        """Return the jet of each coordinate at the times."""
        jets = []
        for k, period in enumerate(self.period):
            value = np.full(len(t), self.offset[k])
            first, second = np.zeros(len(t)), np.zeros(len(t))
            for n in range(len(self.sine)):
                w = 2 * math.pi * (n + 1) / period
                sine, cosine = np.sin(w * t), np.cos(w * t)
                wave = self.sine[n, k] * sine + self.cosine[n, k] * cosine
                value += wave
                first += w * (self.sine[n, k] * cosine - self.cosine[n, k] * sine)
                second -= w * w * wave
            jets.append(Jet(value, first, second))
        return jets


def fit_harmonics(
    recording: Recording, count: int, periods: Sequence[float | None], where: str
) -> Harmonics:
    """Fit an offset and harmonics to each coordinate by least squares.

    Parameters
    ----------
    recording : Recording
    count : int
        Number of harmonics.
    periods : sequence of float or None
        s; None for the period with the least residual, from a hundredth of the record to two.
    where : str
        What errors call it.

    Raises
    ------
    InputError
        For fewer points than coefficients.
    """
    t, values = recording.t, recording.values
    needed = 2 * count + 1 + any(p is None for p in periods)
    if len(t) < needed:
        raise InputError(f"{where}: {len(t)} points are too few: {count} harmonics need {needed}")
    found = [_free_period(t, values[:, k], count) if p is None else p
             for k, p in enumerate(periods)]  # fmt: skip
    coefficients = np.array(
        [_least_squares(t, values[:, k], count, p)[0] for k, p in enumerate(found)]
    ).T
    return Harmonics(np.array(found), coefficients[0], coefficients[1::2], coefficients[2::2])


def _least_squares(t: Vector, y: Vector, count: int, period: float) -> tuple[Vector, float]:
    """Return offset, sine, cosine, sine, .. and the sum of squared residuals."""
    angles = 2 * math.pi / period * t
    columns = [np.ones_like(t)]
    for n in range(1, count + 1):
        columns += [np.sin(n * angles), np.cos(n * angles)]
    design = np.stack(columns, axis=1)
    solution = np.asarray(np.linalg.lstsq(design, y, rcond=1e-10)[0], dtype=np.float64)
    return solution, float(((design @ solution - y) ** 2).sum())


def _free_period(t: Vector, y: Vector, count: int) -> float:
    """Return the period with the least residual: a grid of frequencies, then a search."""
    from scipy.optimize import minimize_scalar

    span = float(t[-1] - t[0])
    centred = t - t[0]
    if not np.ptp(y) > 0:
        return span
    # A harmonic faster than half the points would fit anything.
    most = min(_MOST, (len(t) - 1) / (2 * count))
    cycles = np.arange(_FEWEST, max(most, _FEWEST) + _STEP / 2, _STEP)
    errors = [_least_squares(centred, y, count, span / c)[1] for c in cycles]
    best = cycles[int(np.argmin(errors))]
    result = minimize_scalar(
        lambda c: _least_squares(centred, y, count, span / c)[1],
        bounds=(max(best - _STEP, 0.9 * _FEWEST), best + _STEP), method="bounded",
        options={"xatol": 1e-12},
    )  # fmt: skip
    return float(span / result.x)


def fit_spline(recording: Recording, pieces: int, where: str) -> Curve:
    """Fit a quintic spline of equally long pieces to all coordinates by least squares.

    Raises
    ------
    InputError
        For fewer points than a piece needs.
    """
    from scipy.interpolate import make_lsq_spline

    t = recording.t
    inner = np.linspace(t[0], t[-1], pieces + 1)[1:-1]
    knots = np.concatenate([np.full(6, t[0]), inner, np.full(6, t[-1])])
    if len(t) < pieces + 5:
        raise InputError(
            f"{where}: {len(t)} points are too few: a spline of {pieces} pieces needs {pieces + 5}"
        )
    try:
        made: Curve = make_lsq_spline(t, recording.values, knots, k=5)
    except (ValueError, np.linalg.LinAlgError):
        raise InputError(
            f"{where}: pieces={pieces} is not allowed: a piece has too few points, fewer pieces "
            "are needed"
        ) from None
    return made


def residuals(
    recording: Recording,
    fitted: Values,
    coordinates: Sequence[Coordinate],
    mechanism: Mechanism,
    harmonics: Harmonics | None = None,
) -> tuple[Residual, ...]:
    """Return what a fit leaves of each coordinate at the recorded points."""
    found = []
    for k, coordinate in enumerate(coordinates):
        difference = fitted[:, k] - recording.values[:, k]
        harmonic: dict[str, Any] = {}
        if harmonics is not None:
            sine, cosine = harmonics.sine[:, k], harmonics.cosine[:, k]
            harmonic = {
                "period": float(harmonics.period[k]),
                "offset": float(harmonics.offset[k]),
                "amplitudes": tuple(map(float, np.hypot(sine, cosine))),
                "phases": tuple(map(float, np.arctan2(cosine, sine))),
            }
        found.append(
            Residual(
                coordinate.name, mechanism.unit(coordinate), len(recording.t),
                float(np.sqrt((difference**2).mean())), float(np.abs(difference).max()), **harmonic,
            )
        )  # fmt: skip
    return tuple(found)


def periods_by_name(
    given: float | Literal["free"] | Mapping[str, float | Literal["free"]],
    names: Sequence[str],
    where: str,
) -> list[float | None]:
    """Return the period of each coordinate, None for a free one.

    Raises
    ------
    InputError
        For an unknown name or one that is missing.
    """
    if not isinstance(given, Mapping):
        return [None if isinstance(given, str) else given] * len(names)
    for name in given:
        if name not in names:
            raise unknown_name(where, name, names)
    for name in names:
        if name not in given:
            raise InputError(f"{where}: {name} is missing, needed: {', '.join(names)}")
    by_name = {k: None if isinstance(v, str) else v for k, v in given.items()}
    return [by_name[name] for name in names]
