"""A whole ``pmopt simulate`` run: motion, engine, tables, files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.analysis.motion.config import EFFORT, MAX_INSTANTS, MotionTask
from pmopt.analysis.multibody.mujoco_engine import require_mujoco
from pmopt.analysis.multibody.simulation import (
    Comparison,
    Progress,
    Simulation,
    engine_settings,
    holds,
    simulate_motion,
)
from pmopt.analysis.record import Subject
from pmopt.analysis.workspace.compute import number
from pmopt.errors import InputError
from pmopt.reporting.pictures.gallery import Gallery, write_pictures
from pmopt.reporting.runs.motion_run import MotionRun, run_motion, write_origin
from pmopt.reporting.runs.run_folder import RunFolder, claimed
from pmopt.reporting.tables.table import Cell, Shown, Table, to_csv
from pmopt.units import effort_unit

Notify = Callable[[str], None]


@dataclass(frozen=True)
class Agreement:
    """How well one joint agrees in one mode.

    Attributes
    ----------
    mode : {"inverse", "forward"}
    joint : str
    peak : float
        Of the motion's effort, in ``unit``.
    unit : str
    error, at, rms : float or None
        Largest size of the error in per cent of the peak, when it is met first (s), and root of
        its mean square; None of a joint without load, which has no per cent.
    tracking, tracking_rms : float
        Largest size of the tracking error and root of its mean square, in ``tracking_unit``.
    tracking_unit : str
    """

    mode: str
    joint: str
    peak: float
    unit: str
    error: float | None
    at: float | None
    rms: float | None
    tracking: float
    tracking_rms: float
    tracking_unit: str


@dataclass(frozen=True)
class SimulationRun:
    """A motion, the engine's results for it, and how well both agree."""

    task: MotionTask
    motion: MotionRun
    simulation: Simulation
    agreements: tuple[Agreement, ...]

    @property
    def subject(self) -> Subject:
        """The design, and where the motion goes."""
        return self.simulation.subject

    @property
    def shown(self) -> tuple[str, Comparison]:
        """Mode and rows of ``simulate.csv``: forward where there is a controller."""
        forward = self.simulation.forward
        return ("inverse", self.simulation.inverse) if forward is None else ("forward", forward)

    @property
    def worst(self) -> float:
        """Largest error of the inverse dynamics, in per cent of a joint's peak."""
        inverse = self.simulation.inverse
        unloaded = np.isnan(inverse.error[0])
        left = np.abs(inverse.engine_effort - inverse.effort)[:, unloaded]
        errors = [a.error for a in self.agreements if a.mode == "inverse" and a.error is not None]
        # What a joint without load differs by counts in per cent of the largest peak.
        largest = float(inverse.peak.max())
        return max([*errors, 100 * float(left.max()) / largest if left.size and largest else 0.0])

    @property
    def agrees(self) -> bool:
        """Whether the inverse dynamics of both sides agree within the tolerance."""
        return self.worst <= engine_settings(self.task).tolerance

    def complaint(self) -> str | None:
        """Return the line that says what does not hold, None where all does."""
        unstable, singular = self.simulation.unstable, self.simulation.singular
        if unstable is not None:
            return f"unstable: {unstable.reason} at t = {unstable.t:.9g} s ({unstable.joint})" + (
                f"; {singular}" if singular else "; other gains or a shorter hold are needed"
            )
        if self.agrees:
            return None
        text = f"by {self.worst:.3g} % of a joint's peak"
        if singular is not None:
            return f"{singular}, and both sides differ {text}"
        return f"the engine disagrees: {text}"

    @property
    def units(self) -> dict[str, str]:
        """Unit of every name."""
        mechanism = self.task.mechanism
        units = {p.name: mechanism.unit(p) for p in mechanism.parameters} | {"t": "s"}
        for joint in self.simulation.joints:
            effort, position = effort_unit(joint.kind), mechanism.unit(joint)
            units |= {
                f"{joint.name}_effort": effort, f"{joint.name}_engine_effort": effort,
                f"{joint.name}_error": "%", f"{joint.name}_tracking": position,
            }  # fmt: skip
        return units | {
            "max_error": "%", "rms_error": "%", "tolerance": "%", "at": "s", "step": "s",
            "hold": "s", "position_error": "m", "gap": "m, rad", "first": "s", "duration": "s",
        } | self._gain_units()  # fmt: skip

    def _gain_units(self) -> dict[str, str]:
        """Unit of each gain; of joints of both kinds one after the other."""
        found: dict[str, list[str]] = {"kp": [], "ki": [], "kd": []}
        for joint in self.simulation.joints:
            effort, position = effort_unit(joint.kind), self.task.mechanism.unit(joint)
            found["kp"].append(f"{effort}/{position}")
            found["ki"].append(f"{effort}/({position} s)")
            found["kd"].append(f"{effort} s/{position}")
        return {gain: ", ".join(dict.fromkeys(units)) for gain, units in found.items()}

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        simulation, config = self.simulation, self.task.config
        settings = engine_settings(self.task)
        controller = config.controller
        names = [c.name for c in simulation.joints]
        gains = {
            name: dict(zip(names, values.tolist(), strict=True))
            for name, values in (simulation.gains or {}).items()
        }
        return {
            "mechanism": self.task.mechanism.name,
            "params": dict(self.task.parameters),
            "working_mode": self.motion.motion.working_mode,
            "engine": {"name": simulation.engine, "version": simulation.version,
                       "step": simulation.step},
            "controller": None if controller is None else {
                **gains, "feedforward": controller.feedforward, "hold": simulation.hold,
            },
            "joints": [
                {"mode": a.mode, "joint": a.joint, "peak": a.peak, "unit": a.unit,
                 "max_error": a.error, "at": a.at, "rms_error": a.rms, "max_tracking": a.tracking,
                 "rms_tracking": a.tracking_rms, "tracking_unit": a.tracking_unit}
                for a in self.agreements
            ],
            "position_error": simulation.position_error,
            "gap": simulation.gap,
            "tolerance": settings.tolerance,
            "agrees": self.agrees,
            "saturation": [
                {"joint": s.joint, "lower": number(s.lower), "upper": number(s.upper),
                 "first": s.first, "duration": s.duration}
                for s in simulation.saturation
            ],
            "unstable": None if simulation.unstable is None else asdict(simulation.unstable),
            "singular": simulation.singular,
            "units": self.units,
        }  # fmt: skip


def run_simulation(
    task: MotionTask,
    out: Path | None = None,
    *,
    force: bool = False,
    threads: int | None = None,
    notify: Notify | None = None,
    progress: Progress | None = None,
) -> SimulationRun:
    """Run a motion on an engine and, with ``out``, write the run's folder.

    Raises
    ------
    InputError
        When the folder holds a run, or for a motion that is infeasible or has no masses.
    PmoptError
        When the engine is missing.
    """
    with claimed(out, force) as folder:
        return _run(task, folder, threads, notify, progress)


def _run(
    task: MotionTask, folder: RunFolder | None, threads: int | None, notify: Notify | None,
    progress: Progress | None,
) -> SimulationRun:  # fmt: skip
    require_mujoco()  # before anything that takes long
    motion = _feasible(task, threads, notify)
    fine = None
    if task.config.controller is not None:
        hold = _checked_hold(task, motion)
        trajectory = task.config.trajectory.model_copy(update={"step": hold / 2})
        config = task.config.model_copy(update={"trajectory": trajectory})
        fine = _feasible(replace(task, config=config), threads, notify).motion
    simulation = simulate_motion(task, motion.motion, fine, progress)
    run = SimulationRun(task, motion, simulation, tuple(_agreements(task, simulation)))
    if folder is not None:
        _write(run, folder, notify)
    return run


def _checked_hold(task: MotionTask, motion: MotionRun) -> float:
    """Return the controller's hold, one that the motion is long and short enough for."""
    hold, _ = holds(task)
    t = motion.motion.t
    duration = float(t[-1] - t[0])
    if not hold <= duration < hold * MAX_INSTANTS / 2:
        raise InputError(
            f"{task.where}: controller.hold={hold:g} is not allowed: at least one and at most "
            f"{MAX_INSTANTS // 2} holds in the motion's {duration:g} s are"
        )
    return hold


def _feasible(task: MotionTask, threads: int | None, notify: Notify | None) -> MotionRun:
    """Return the motion; under a controller drives saturate, so that its efforts may be beyond."""
    if task.config.controller is not None:
        limits = {k: v for k, v in task.other_limits.items() if not k.endswith(EFFORT)}
        task = replace(task, other_limits=limits)
    run = run_motion(task, threads=threads, notify=notify)
    if run.infeasible:
        raise InputError(run.complaint())
    return run


def _agreements(task: MotionTask, simulation: Simulation) -> Iterator[Agreement]:
    for mode, found in (("inverse", simulation.inverse), ("forward", simulation.forward)):
        if found is None:
            continue
        for k, joint in enumerate(simulation.joints):
            error, tracking = np.abs(found.error[:, k]), np.abs(found.tracking[:, k])
            figures: tuple[float | None, float | None, float | None] = (None, None, None)
            if np.isfinite(error).all():
                at = int(error.argmax())
                figures = (
                    float(error[at]), float(found.t[at]), float(np.sqrt((error**2).mean())),
                )  # fmt: skip
            yield Agreement(
                mode, joint.name, float(found.peak[k]), effort_unit(joint.kind), *figures,
                float(tracking.max()), float(np.sqrt((tracking**2).mean())),
                task.mechanism.unit(joint),
            )  # fmt: skip


def _write(run: SimulationRun, folder: RunFolder, notify: Notify | None) -> None:
    simulation = run.simulation
    mode, _ = run.shown
    folder.open()
    folder.write("simulate.csv", to_csv([series_table(run)]) + "\n")
    if mode == "forward":
        folder.write("inverse.csv", to_csv([series_table(run, simulation.inverse)]) + "\n")
    folder.write("summary.csv", to_csv([summary_table(run)]) + "\n")
    folder.write("model.xml", simulation.model)
    origin = write_origin(run.task, folder)
    missing = write_pictures(folder, lambda: draw_run(run), notify)
    document = run.to_dict()
    folder.close(
        "simulate",
        {
            "mechanism": run.task.mechanism.name,
            **origin,
            "engine": document["engine"],
            "controller": document["controller"],
            "seed": None,
            "resumes": [],
            **missing,
            "units": document["units"] | {"mass": "kg", "centre": run.task.mechanism.length_unit,
                                          "inertia": "kg m^2"},
        },
    )  # fmt: skip


def draw_run(run: SimulationRun) -> dict[str, bytes]:
    """Return the pictures of a run by file name."""
    from pmopt.reporting.pictures import simulation_plots

    mode, shown = run.shown
    gallery = Gallery()
    gallery.add(
        "simulate.png",
        lambda: simulation_plots.draw_comparison(run.task, run.simulation, shown, mode),
    )
    return gallery


def series_table(run: SimulationRun, found: Comparison | None = None) -> Table:
    """Return one mode's efforts, errors and tracking, one row an instant."""
    mode, shown = run.shown
    found = shown if found is None else found
    names = [c.name for c in run.simulation.joints]
    columns: dict[str, Any] = {"t": found.t}
    for ending, values in (
        ("effort", found.effort), ("engine_effort", found.engine_effort), ("error", found.error),
        ("tracking", found.tracking),
    ):  # fmt: skip
        columns |= {f"{name}_{ending}": values[:, k] for k, name in enumerate(names)}
    order = ["t", *(f"{name}_{ending}" for name in names
                    for ending in ("effort", "engine_effort", "error", "tracking"))]  # fmt: skip
    table = np.stack([columns[name] for name in order], axis=1)
    rows = np.where(np.isnan(table), None, table.astype(object)).tolist()  # type: ignore[call-overload]
    return Table(f"{run.task.mechanism.name}: {mode}", tuple(order), tuple(map(tuple, rows)),
                 run.units)  # fmt: skip


def _difference(value: float | None) -> Cell:
    """Return a difference of two nearly equal numbers, which has few digits."""
    return None if value is None else Shown(value, f"{value:.2g}")


def summary_table(run: SimulationRun) -> Table:
    """Return the agreement of every joint in every mode."""
    simulation, settings = run.simulation, engine_settings(run.task)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (a.mode, a.joint, a.peak, a.unit, _difference(a.error), a.at, _difference(a.rms),
         _difference(a.tracking), _difference(a.tracking_rms), a.tracking_unit)
        for a in run.agreements
    )  # fmt: skip
    notes = [
        f"{simulation.engine} {simulation.version}, a step of {simulation.step:g} s; centres of "
        f"mass within {simulation.position_error:.2g} m of the motion's",
        f"inverse dynamics {'agree' if run.agrees else 'DO NOT agree'} within "
        f"{settings.tolerance:g} % of each joint's peak",
    ]
    if simulation.hold is not None:
        ahead = "with" if run.task.config.controller.feedforward else "without"  # type: ignore[union-attr]
        notes.append(f"forward: a controller every {simulation.hold:g} s, {ahead} feed-forward")
    else:
        notes.append("no forward run: [controller] is not given")
    units = run.units
    notes += [
        f"{s.joint} saturates at [{s.lower:g}, {s.upper:g}] {units[f'{s.joint}_effort']}: first at "
        f"t = {s.first:.6g} s, {s.duration:.6g} s in all"
        for s in simulation.saturation
    ]
    if simulation.unstable is not None:
        notes.append(f"UNSTABLE at t = {simulation.unstable.t:.6g} s: the forward run ends there")
    if simulation.singular is not None:
        notes.append(simulation.singular)
    unloaded = dict.fromkeys(a.joint for a in run.agreements if a.error is None)
    if unloaded:
        notes.append(f"no load on {', '.join(unloaded)}: no error in per cent")
    return Table(
        f"{run.task.mechanism.name}: efforts of the engine against the motion's",
        ("mode", "joint", "peak", "unit", "max_error", "at", "rms_error", "max_tracking",
         "rms_tracking", "tracking_unit"),
        rows, {"max_error": "%", "rms_error": "%", "at": "s"}, tuple(notes),
    )  # fmt: skip
