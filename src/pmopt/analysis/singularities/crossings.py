"""Where a path of poses crosses singularities."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from pmopt.analysis.kinematics.determinants import Part, measures_at
from pmopt.analysis.record import OfSubject, Subject
from pmopt.analysis.singularities.touching import Values, least_along
from pmopt.errors import InputError, UnreachableError
from pmopt.mechanisms.mechanism import Mechanism, Parameters
from pmopt.units import ONE

#: A determinant this small at a row of the path is 0: rounding leaves no more.
_ZERO = 1e-12
_HALVINGS = 60
#: Points that are looked at, at least; most between two rows; least sizes that are located.
_LOOKS, _MOST_INNER, _LOCATED = 1000, 16, 16


@dataclass(frozen=True)
class Crossing:
    """A zero of a determinant on the path.

    ``row`` counts the rows of the path from 1, with a fraction between them, ``until`` is the last
    row of a stretch that is singular throughout; ``time`` is interpolated like the pose, None
    without times. ``changes_sign`` says whether the determinant has the other sign behind.
    """

    kind: str
    part: str
    row: float
    until: float
    time: float | None
    changes_sign: bool
    pose: dict[str, float]


@dataclass(frozen=True)
class Nearest:
    """The row where a determinant is smallest in size, and its value there."""

    kind: str
    part: str
    row: int
    value: float


@dataclass(frozen=True)
class PathResult(OfSubject):
    """What :func:`follow_path` found."""

    rows: int
    crossings: tuple[Crossing, ...]
    nearest: tuple[Nearest, ...]
    units: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "params": self.params,
            "working_mode": self.working_mode,
            "rows": self.rows,
            "crossings": [asdict(c) for c in self.crossings],
            "nearest": [asdict(n) for n in self.nearest],
            "units": self.units,
        }


def follow_path(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None,
    path: Sequence[Mapping[str, Any]],
    times: Sequence[float] | None = None,
    working_mode: str | None = None,
    *,
    where: str = "path",
    rows: Sequence[int] | None = None,
) -> PathResult:
    """Follow a path of poses, straight from row to row in the pose's coordinates.

    Limits on joints do not count; a pose that no limb position reaches is an error.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    path : sequence of mappings
        At least two poses.
    times : sequence of float, optional
        Time at each row, s.
    working_mode : str, optional
        Default: the mechanism's first.
    where : str
        What errors call the path.
    rows : sequence of int, optional
        What errors call its rows; default: counted from 1.

    Raises
    ------
    InputError
        For fewer than two poses, and unknown names or values that are no finite numbers.
    UnreachableError
        Naming the first row out of reach.
    """
    numbers = list(range(1, len(path) + 1)) if rows is None else list(rows)
    if len(path) < 2:
        raise InputError(f"{where}: a path needs at least two poses, {len(path)} given")
    mode = mechanism.check_mode(working_mode, f"{where}: working_mode")
    parameters = mechanism.resolve(params or {})
    poses, values = [], []
    for number, given in zip(numbers, path, strict=True):
        pose = mechanism.check_coordinates(given, mechanism.pose, f"{where}, line {number}")
        measures = measures_at(mechanism, mode, parameters, pose)
        if measures is None:
            shown = ",".join(f"{k}={v!r}" for k, v in pose.items())
            raise UnreachableError(
                f"{where}, line {number}: {shown} is out of reach in working mode {mode}"
            )
        poses.append(pose)
        values.append(measures)
    crossings: list[Crossing] = []
    nearest = []
    looks = _looks(mechanism, mode, parameters, poses, tuple(values[0]))
    for part in values[0]:
        series = [row[part] for row in values]
        row = min(range(len(series)), key=lambda i: abs(series[i]))
        nearest.append(Nearest(*part, row + 1, series[row]))
        for first, last, changes, pose in _zeros(
            mechanism, mode, parameters, part, poses, series, looks
        ):
            time = None if times is None else _at(times, first)
            crossings.append(Crossing(*part, first + 1, last + 1, time, changes, pose))
    crossings.sort(key=lambda c: (c.row, c.kind, c.part))
    units = {c.name: mechanism.unit(c) for c in mechanism.pose}
    units |= {p.name: mechanism.unit(p) for p in mechanism.parameters}
    box = {
        c.name: (min(p[c.name] for p in poses), max(p[c.name] for p in poses))
        for c in mechanism.pose
    }
    return PathResult(
        Subject.of(mechanism, parameters, mode, box), len(path), tuple(crossings),
        tuple(nearest), units | {"time": "s", "row": ONE, "value": ONE},
    )  # fmt: skip


class _Looks(NamedTuple):
    """Places along a path, in rows from 0, and the sizes of determinants at those between rows.

    They are infinite out of reach, and where a row is.
    """

    places: Values
    sizes: dict[Part, Values]


def _looks(
    mechanism: Mechanism,
    mode: str,
    parameters: Parameters,
    poses: Sequence[Mapping[str, float]],
    parts: Sequence[Part],
) -> _Looks:
    """Return the sizes of all determinants at some places between the rows."""
    count = len(poses)
    inner = int(np.clip(_LOOKS // (count - 1), 1, _MOST_INNER))
    places = np.arange((count - 1) * (inner + 1) + 1) / (inner + 1)
    sizes = {part: np.full(len(places), math.inf) for part in parts}
    for i in np.flatnonzero(places % 1 > 0).tolist():
        place = float(places[i])
        k = min(int(place), count - 2)
        pose = _between(poses[k], poses[k + 1], place - k)
        measures = measures_at(mechanism, mode, parameters, pose)
        if measures is not None:
            for part in parts:
                sizes[part][i] = abs(measures[part])
    return _Looks(places, sizes)


def _touches(
    mechanism: Mechanism,
    mode: str,
    parameters: Parameters,
    part: Part,
    poses: Sequence[Mapping[str, float]],
    series: Sequence[float],
    looks: _Looks,
) -> list[tuple[float, float, bool, dict[str, float]]]:
    """Return where a determinant touches 0 between rows, without a change of sign."""
    count = len(poses)

    @functools.cache
    def size_at(place: float) -> float:
        k = min(int(place), count - 2)
        pose = _between(poses[k], poses[k + 1], place - k)
        measures = measures_at(mechanism, mode, parameters, pose)
        return math.inf if measures is None else abs(measures[part])

    def size(places: Values) -> Values:
        return np.array(list(map(size_at, places.ravel().tolist()))).reshape(places.shape)

    places = looks.places
    sizes = np.where(
        places % 1 > 0, looks.sizes[part], np.abs(np.interp(places, np.arange(count), series))
    )
    k = np.arange(1, len(places) - 1)
    before, here, after = sizes[k - 1], sizes[k], sizes[k + 1]
    # Where all are alike, as along a rest, there is nothing to look for.
    k = k[(here <= before) & (here <= after) & ((here < before) | (here < after))]
    k = k[np.argsort(sizes[k], kind="stable")[:_LOCATED]]
    if len(k) == 0:
        return []
    found, smallest = least_along(size, places[k - 1], places[k + 1])
    zeros = []
    for place, value, low, high in zip(
        found.tolist(), smallest.tolist(), places[k - 1].tolist(), places[k + 1].tolist(),
        strict=True,
    ):  # fmt: skip
        if value > _ZERO or any(
            abs(series[row]) <= _ZERO for row in (round(place),) if abs(place - row) < 1e-9
        ):
            continue
        ends = [_signed(mechanism, mode, parameters, part, poses, end) for end in (low, high)]
        # Where the ends vanish too it is a stretch that is singular, which rows show.
        if ends[0] * ends[1] > 0 and min(map(abs, ends)) > _ZERO:
            row = min(int(place), count - 2)
            pose = _between(poses[row], poses[row + 1], place - row)
            zeros.append((place, place, False, pose))
    return zeros


def _signed(
    mechanism: Mechanism,
    mode: str,
    parameters: Parameters,
    part: Part,
    poses: Sequence[Mapping[str, float]],
    place: float,
) -> float:
    row = min(int(place), len(poses) - 2)
    pose = _between(poses[row], poses[row + 1], place - row)
    measures = measures_at(mechanism, mode, parameters, pose)
    return 0.0 if measures is None else measures[part]


def _at(times: Sequence[float], place: float) -> float:
    share, whole = math.modf(place)
    first = times[int(whole)]
    return first + share * (times[int(whole) + 1] - first) if share else first


def _between(
    first: Mapping[str, float], second: Mapping[str, float], share: float
) -> dict[str, float]:
    return {k: v + share * (second[k] - v) for k, v in first.items()}


def _zeros(
    mechanism: Mechanism,
    mode: str,
    parameters: Parameters,
    part: Part,
    poses: Sequence[Mapping[str, float]],
    series: Sequence[float],
    looks: _Looks,
) -> list[tuple[float, float, bool, dict[str, float]]]:
    """Return the zeros of a determinant: first and last row (from 0), change of sign, pose."""
    zeros = _touches(mechanism, mode, parameters, part, poses, series, looks)
    signs = [0 if abs(v) <= _ZERO else (1 if v > 0 else -1) for v in series]
    i = 0
    while i < len(signs):
        if signs[i] == 0:
            last = next((k for k in range(i, len(signs)) if signs[k]), len(signs)) - 1
            around = (signs[i - 1] if i else 0, signs[last + 1] if last + 1 < len(signs) else 0)
            zeros.append((float(i), float(last), around[0] * around[1] < 0, dict(poses[i])))
            i = last + 1
            continue
        if i + 1 < len(signs) and signs[i] * signs[i + 1] < 0:
            low, high, value = 0.0, 1.0, series[i]
            for _ in range(_HALVINGS):
                middle = (low + high) / 2
                pose = _between(poses[i], poses[i + 1], middle)
                measures = measures_at(mechanism, mode, parameters, pose)
                if measures is None:
                    break
                value = measures[part]
                low, high = (middle, high) if value * signs[i] > 0 else (low, middle)
            # A jump of the measure, from one branch to another, is no zero of it.
            if abs(value) <= math.sqrt(_ZERO):
                place = i + low
                zeros.append((place, place, True, _between(poses[i], poses[i + 1], low)))
        i += 1
    return zeros
