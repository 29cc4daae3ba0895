"""Trajectories: coordinates with exact first and second derivatives, from what a config says."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.pose_rows import TIME
from pmopt.analysis.motion import formulas, recordings, waypoint_laws
from pmopt.analysis.motion.config import MAX_INSTANTS, MotionTask
from pmopt.analysis.motion.recordings import Residual
from pmopt.analysis.motion.records import Trajectory
from pmopt.errors import InputError, unknown_name
from pmopt.mechanisms.mechanism import LARGEST_COORDINATE, Vector, as_number
from pmopt.numerics.derivatives import Jet

Values = NDArray[np.float64]
#: Decimals of a time: k times the step is the decimal number it looks like.
_DECIMALS = 12
#: Least radius of a gate's corners, of the largest that fits.
_SHARPEST = 1e-3


@dataclass(frozen=True)
class Planned:
    """A trajectory, what a fit to recorded points has left, and remarks on it."""

    trajectory: Trajectory
    residuals: tuple[Residual, ...] = ()
    notes: tuple[str, ...] = ()


def plan_trajectory(task: MotionTask) -> Planned:
    """Return the trajectory that a configuration describes.

    Raises
    ------
    InputError
        One line with file and key, and the row or time where there is one.
    """
    sources: Mapping[str, Callable[[MotionTask], Planned]] = {
        "expressions": _from_expressions,
        "waypoints": _from_waypoints,
        "gate": _from_gate,
        "file": _from_file,
    }
    return sources[task.config.trajectory.source](task)


def instants(start: float, duration: float, step: float, where: str) -> Vector:
    """Return the times from the start, a step apart, and the end.

    Raises
    ------
    InputError
        For more instants than a motion may have, or fewer than two.
    """
    count = duration / step
    if not count < MAX_INSTANTS:
        raise InputError(
            f"{where}: step={step:g} is not allowed: {count:.3g} instants in {duration:g} s, at "
            f"most {MAX_INSTANTS} are, which take 1 to 2 GB of memory"
        )
    if count < 1 - 1e-9:
        raise InputError(f"{where}: step={step:g} s is longer than the motion, {duration:g} s")
    whole = int(count * (1 + 1e-12) + 1e-9)
    times = np.round(start + step * np.arange(whole + 1), _DECIMALS)
    end = start + duration
    if end - times[-1] > 1e-9 * duration:
        times = np.append(times, np.round(end, _DECIMALS))
    return np.asarray(times)


def _place(task: MotionTask) -> str:
    return f"{task.where}: trajectory"


def _built(
    task: MotionTask, t: Vector, parts: tuple[Values, Values, Values], **details: Any
) -> Planned:
    """Return the trajectory, its values checked."""
    for k, coordinate in enumerate(task.driven):
        large = np.flatnonzero(~(np.abs(parts[0][:, k]) <= LARGEST_COORDINATE))
        if len(large):
            value, time = float(parts[0][large[0], k]), float(t[large[0]])
            raise InputError(
                f"{_place(task)}: {coordinate.name}={value:g} at t={time:g} s is not allowed: at "
                f"most {LARGEST_COORDINATE:g} {task.mechanism.unit(coordinate)} in size"
            )
    return Planned(Trajectory(task.config.trajectory.space, t, *parts), **details)


def _stacked(jets: list[Jet]) -> tuple[Values, Values, Values]:
    value, first, second = (np.stack(part, axis=1) for part in zip(*jets, strict=True))
    return value, first, second


def _evaluated(path: waypoint_laws.Path, t: Vector) -> tuple[Values, Values, Values]:
    return path(t), path(t, 1), path(t, 2)


def _from_expressions(task: MotionTask) -> Planned:
    settings = task.config.trajectory
    parsed = []
    for coordinate in task.driven:
        in_degrees = f"{coordinate.name}_deg"
        key = in_degrees if in_degrees in settings.expressions else coordinate.name
        given = settings.expressions[key]
        text = given if isinstance(given, str) else repr(float(given))
        where = f"{_place(task)}.{key}"
        parsed.append((key == in_degrees, formulas.parse(text, settings.constants, where)))
    assert settings.duration is not None  # validated
    t = instants(0.0, settings.duration, settings.step, _place(task))
    jets = [(degrees, formula(t)) for degrees, formula in parsed]
    return _built(
        task, t, _stacked([Jet(*map(np.radians, jet)) if deg else jet for deg, jet in jets])
    )


def _from_waypoints(task: MotionTask) -> Planned:
    settings = task.config.trajectory
    where = _place(task)
    points, given = _waypoints(task)
    steps = np.diff(points, axis=0)
    names = [c.name for c in task.driven]
    trapezoidal = settings.law == "trapezoidal"
    limited = bool(settings.max_rate or settings.max_acceleration)
    said = [k for k, on in (
        ("times t of the waypoints", given is not None),
        ("duration", settings.duration is not None),
        ("max_rate or max_acceleration", limited),
    ) if on]  # fmt: skip
    if len(said) != 1:
        sources = " and ".join(said) or "nothing"
        raise InputError(
            f"{where}: how long it takes is given by one of duration, times t of the waypoints, "
            f"max_rate and max_acceleration: {sources} given"
        )
    blend = settings.blend
    if limited:
        if trapezoidal and blend is None and not (settings.max_rate and settings.max_acceleration):
            raise InputError(
                f"{where}: law = trapezoidal needs max_rate and max_acceleration, or blend"
            )
        caps = [np.array([table.get(name, np.inf) for name in names])
                for table in (settings.max_rate, settings.max_acceleration)]  # fmt: skip
        spans, chosen = waypoint_laws.shortest(steps, settings.law, blend, *caps)
        for k in np.flatnonzero(~(spans > 0))[:1]:
            raise InputError(
                f"{where}: waypoints {k + 1} and {k + 2} differ in nothing that max_rate or "
                "max_acceleration limit: how long it takes is not given"
            )
        times = np.insert(np.cumsum(spans + settings.dwell), 0, 0.0)
    else:
        chosen = [waypoint_laws.law_of(settings.law, 0.25 if blend is None else blend)] * len(steps)
        if given is not None:
            times = given
        else:
            assert settings.duration is not None
            times = np.linspace(0.0, settings.duration, len(points))
        short = np.flatnonzero(np.diff(times) <= settings.dwell)
        if len(short):
            k = int(short[0])
            raise InputError(
                f"{where}: dwell={settings.dwell:g} s leaves no time from waypoint {k + 1} to "
                f"{k + 2}, {times[k + 1] - times[k]:g} s apart"
            )
    if not settings.through:
        path = waypoint_laws.rest_to_rest(points, times, chosen, settings.dwell)
    elif trapezoidal:
        path = waypoint_laws.through_trapezoidal(points, times, 0.25 if blend is None else blend)
    else:
        path = waypoint_laws.through_quintic(points, times)
    t = instants(float(times[0]), float(times[-1] - times[0]), settings.step, where)
    notes = []
    if settings.through and trapezoidal and len(points) > 2:
        missed = np.abs(path(times[1:-1]) - points[1:-1]).max(axis=0)
        shown = ", ".join(f"{c.name} {value:.3g} {task.mechanism.unit(c)}"
                         for c, value in zip(task.driven, missed, strict=True))  # fmt: skip
        notes.append(f"inner waypoints are passed, not met; largest misses: {shown}")
    return _built(task, t, _evaluated(path, t), notes=tuple(notes))


def _waypoints(task: MotionTask) -> tuple[Values, Vector | None]:
    """Return the waypoints (n, k), and their times where they have some."""
    rows = task.config.trajectory.waypoints or []
    names = [c.name for c in task.driven]
    points: list[list[float]] = []
    times: list[float | None] = []
    for number, row in enumerate(rows, start=1):
        where = f"{_place(task)}: waypoint {number}"
        if isinstance(row, list | tuple):
            if len(row) != len(names):
                raise InputError(
                    f"{where}: {len(row)} numbers, needed: {', '.join(names)}, or a table"
                )
            row = dict(zip(names, row, strict=True))
        if not isinstance(row, dict):
            raise InputError(
                f"{where}={row!r} is not allowed: numbers for {', '.join(names)} or a table"
            )
        pose = {k: v for k, v in row.items() if k != TIME}
        checked = task.mechanism.check_coordinates(pose, task.driven, where)
        points.append([checked[name] for name in names])
        time = as_number(row[TIME]) if TIME in row else None
        if TIME in row and (time is None or not abs(time) <= LARGEST_COORDINATE):
            raise InputError(f"{where}: t={row['t']} is not allowed: a number in s is needed")
        times.append(time)
    known = [time for time in times if time is not None]
    if not known:
        return np.array(points), None
    for number, time in enumerate(times, start=1):
        if time is None:
            raise InputError(
                f"{_place(task)}: waypoint {number}: t is missing: all waypoints have one or none"
            )
    for k, (first, second) in enumerate(zip(known, known[1:], strict=False), start=1):
        if not first < second:
            raise InputError(
                f"{_place(task)}: waypoint {k + 1}: t={second:g} s does not come after t={first:g} "
                "s of the one before"
            )
    return np.array(points), np.array(known)


def _from_gate(task: MotionTask) -> Planned:
    settings, gate = task.config.trajectory, task.config.trajectory.gate
    assert gate is not None  # the source
    where = f"{_place(task)}.gate"
    coordinates = task.driven
    ends = []
    for key in ("pick", "place"):
        given = task.mechanism.check_coordinates(getattr(gate, key), coordinates, f"{where}.{key}")
        ends.append(np.array([given[c.name] for c in coordinates]))
    pick, place = ends
    lengths = [k for k, c in enumerate(coordinates) if c.kind == "length"]
    names = [coordinates[k].name for k in lengths]
    if gate.up not in names:
        raise unknown_name(f"{where}.up", gate.up, names)
    up = [c.name for c in coordinates].index(gate.up)
    if gate.height == 0:
        raise InputError(f"{where}: height=0 is not allowed: by how much it rises, with its sign")
    rise = max if gate.height > 0 else min
    level = rise(pick[up], place[up]) + gate.height
    top = np.array([pick, place])
    top[:, up] = level
    unit = task.mechanism.length_unit
    across = float(np.linalg.norm((place - pick)[[k for k in lengths if k != up]]))
    if not across > 0:
        raise InputError(
            f"{where}: pick and place differ in no length across {gate.up}: there is no way between"
        )
    room = min(across / 2, abs(level - pick[up]), abs(level - place[up]))
    if not _SHARPEST * room <= gate.radius <= room * (1 + 1e-12):
        raise InputError(
            f"{where}: radius={gate.radius:g} is not allowed: at most {room:.6g} {unit}, the "
            f"height and half the way across, and at least {_SHARPEST:g} of that: corners are "
            "passed without a stop"
        )
    one_way = gate.cycle / 2
    if settings.dwell >= one_way:
        raise InputError(
            f"{_place(task)}: dwell={settings.dwell:g} s, twice a cycle, leaves no time of "
            f"{gate.cycle:g} s to move"
        )
    made = waypoint_laws.gate(pick, place, top, lengths, min(gate.radius, room))
    strokes = 2 * gate.cycles
    numbers = np.arange(strokes + 1, dtype=np.float64)
    along = made.length * (numbers[:, None] % 2)
    law = waypoint_laws.law_of(settings.law, settings.blend or 0.25)
    times = one_way * numbers
    run = waypoint_laws.rest_to_rest(along, times, [law] * strokes, settings.dwell)
    t = instants(0.0, float(times[-1]), settings.step, _place(task))
    s, rate, acceleration = (part[:, 0] for part in _evaluated(run, t))
    s = np.clip(s, 0.0, made.length)
    value, first, second = _evaluated(made.path, s)
    parts = (
        value,
        first * rate[:, None],
        second * rate[:, None] ** 2 + first * acceleration[:, None],
    )
    return _built(task, t, parts)


def _from_file(task: MotionTask) -> Planned:
    settings = task.config.trajectory
    assert settings.file is not None  # the source
    where = f"{_place(task)}.file"
    path = task.folder / settings.file
    if os.path.exists(path) and not os.path.isfile(path):  # it is read again, for the manifest
        raise InputError(f"{where}: {path}: is no file")
    recording = recordings.read_recording(
        path, task.mechanism, task.driven, where, settings.largest_step
    )
    start, span = float(recording.t[0]), float(recording.t[-1] - recording.t[0])
    if len(recording.t) < 2:
        raise InputError(f"{where}: {path}: one row is no motion: at least two are needed")
    duration = span if settings.duration is None else settings.duration
    fit = settings.fit
    if duration > span * (1 + 1e-12) and (fit is None or fit.kind != "harmonics"):
        raise InputError(
            f"{_place(task)}: duration={duration:g} s is longer than {path}, {span:g} s"
        )
    t = instants(start, min(duration, span) if fit is None else duration, settings.step,
                 _place(task))  # fmt: skip
    if fit is None:
        spline = _evaluated(_spline(task, recording, path), t)
        return _built(task, t, spline, notes=recording.notes)
    place = f"{_place(task)}.fit"
    if fit.kind == "spline":
        fitted = recordings.fit_spline(recording, 10 if fit.pieces is None else fit.pieces, place)
        left = recordings.residuals(recording, fitted(recording.t), task.driven, task.mechanism)
        return _built(task, t, _evaluated(fitted, t), residuals=left, notes=recording.notes)
    periods = recordings.periods_by_name(
        "free" if fit.period is None else fit.period,
        [c.name for c in task.driven], f"{place}.period",
    )  # fmt: skip
    harmonics = recordings.fit_harmonics(recording, fit.count or 1, periods, place)
    left = recordings.residuals(
        recording, _stacked(harmonics(recording.t))[0], task.driven, task.mechanism, harmonics
    )
    return _built(task, t, _stacked(harmonics(t)), residuals=left, notes=recording.notes)


def _spline(task: MotionTask, recording: recordings.Recording, path: Any) -> waypoint_laws.Path:
    settings = task.config.trajectory
    degree = 5 if settings.spline == "quintic" else 3
    needed = 2 if settings.ends == "rest" else degree + 1
    if len(recording.t) < needed:
        raise InputError(
            f"{_place(task)}.file: {path}: {len(recording.t)} rows are too few: a "
            f"{settings.spline} spline needs {needed}"
        )
    values = recording.values
    if settings.ends == "periodic":
        size = np.abs(values).max(axis=0)
        for k in np.flatnonzero(np.abs(values[-1] - values[0]) > 1e-9 * size)[:1]:
            raise InputError(
                f"{_place(task)}.file: {path}, line {recording.lines[-1]}: ends = periodic needs "
                f"the values of the first row: {task.driven[k].name}={values[-1, k]!r} is not "
                f"{values[0, k]!r}"
            )
        values = values.copy()
        values[-1] = values[0]
    return waypoint_laws.spline(recording.t, values, degree, settings.ends)
