"""A whole ``pmopt capability`` run: result, tables, picture, files."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.regions.sections import Section, section_fields
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sizing.actuators import (
    SHARES,
    SIZES,
    Capability,
    Demand,
    Demands,
    Task,
    check_limits,
    compute_capability,
)
from pmopt.analysis.validation import validated
from pmopt.analysis.workspace.emptiness import require_reachable
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.bodies import point_mass
from pmopt.mechanisms.mechanism import Parameters
from pmopt.quantity import Quantity, uncertain
from pmopt.reporting.pictures import workspace_plots
from pmopt.reporting.pictures.chart_text import Heading, heading
from pmopt.reporting.pictures.gallery import Gallery, write_pictures
from pmopt.reporting.pictures.style import (
    INK,
    estimate_text,
    parameter_text,
    to_picture,
    with_unit,
)
from pmopt.reporting.runs.run_folder import RunFolder, claimed
from pmopt.reporting.tables.table import (
    Cell,
    Table,
    Uncertain,
    design_facts,
    facts,
    given,
    to_csv,
    to_json,
)
from pmopt.units import ONE, exact

#: Colours end at twice what the motors have.
_MOST = 2.0
_RESOLUTION = 160
#: Blue is enough, red too little, yellow between; none of the colour-blind mixes them up.
_COLOURS = "RdYlBu_r"
_SINGULAR = "#ffffff"


@dataclass(frozen=True)
class CapabilityTask:
    """What is asked of a mechanism's motors, and where."""

    mechanism: Mechanism
    parameters: Parameters
    settings: WorkspaceSettings
    task: Task
    limits: Mapping[str, float]
    samples: int
    seed: int

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form, enough to do it again."""
        payload = self.task.payload
        return {
            "mechanism": self.mechanism.name,
            "parameters": dict(self.parameters),
            "workspace": self.settings.model_dump(mode="json"),
            "task": {
                **{k: getattr(self.task, k) for k in SIZES},
                "payload": 0.0 if payload is None else payload.mass,
                "payload_centre": [0.0] * 3 if payload is None else payload.centre.tolist(),
            },
            "limits": dict(self.limits),
            "samples": self.samples,
            "seed": self.seed,
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], where: str) -> CapabilityTask:
        """Return the task a manifest describes.

        Raises
        ------
        InputError
        """
        try:
            mechanism, task = find(document["mechanism"]), document["task"]
            payload = point_mass(float(task["payload"]), task["payload_centre"])
            return cls(
                mechanism,
                mechanism.resolve(document["parameters"]),
                validated(WorkspaceSettings, {**document["workspace"], "samples": None}, where),
                Task(
                    **{k: float(task.get(k, 0.0)) for k in SIZES},
                    payload=payload if payload.mass else None,
                ),
                check_limits(mechanism, document["limits"], where),
                int(document["samples"]),
                int(document["seed"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{where}: is not the manifest of a capability run: {error}") from None


def compute(
    asked: CapabilityTask,
    threads: int | None = None,
    notify: Callable[[str], None] | None = None,
) -> Capability:
    """Sample demands and the capable region."""
    return compute_capability(
        asked.mechanism, asked.parameters, asked.settings, asked.task, asked.limits,
        samples=asked.samples, seed=asked.seed, threads=threads, notify=notify,
    )  # fmt: skip


def run_capability(
    asked: CapabilityTask,
    out: Path | None = None,
    *,
    force: bool = False,
    threads: int | None = None,
    notify: Callable[[str], None] | None = None,
) -> Capability:
    """Sample demands and the capable region and, with ``out``, write the run's folder.

    Raises
    ------
    InfeasibleError
        When nothing is reachable, with what rules it out.
    """
    with claimed(out, force) as folder:
        return _run(asked, folder, threads, notify)


def _run(
    asked: CapabilityTask, folder: RunFolder | None, threads: int | None,
    notify: Callable[[str], None] | None,
) -> Capability:  # fmt: skip
    result = compute(asked, threads, notify)
    require_reachable(
        result.reachable, asked.mechanism, asked.parameters, asked.settings, "capability",
        result.samples,
    )  # fmt: skip
    if folder is None:
        return result
    folder.open()
    folder.write("result.json", to_json(result.to_dict()) + "\n")
    folder.write("demands.csv", to_csv([demands_table(result)]) + "\n")
    missing = write_pictures(folder, lambda: draw_capability(asked, result, threads), notify)
    folder.close(
        "capability",
        {
            "mechanism": asked.mechanism.name,
            "config": asked.to_dict(),
            "seed": asked.seed,
            "resumes": [],
            "units": result.units,
            **missing,
        },
    )
    return result


def _demand_table(result: Capability, demands: Sequence[Demand], notes: Sequence[str]) -> Table:
    """Return a row for each of the demands."""
    shares = [f"p{100 * share:.0f}" for share in SHARES]
    columns = ("demand", "unit", "limit", *shares, "volume")

    def cell(estimate: Quantity) -> Cell:
        # Next to singularities demands have no bound.
        return Uncertain(estimate.value, estimate.error) if np.isfinite(estimate.value) else None

    rows = tuple(
        (demand.name, demand.unit, given(demand.limit), *map(cell, demand.levels),
         cell(demand.volume))
        for demand in demands
    )  # fmt: skip
    unit = result.units["volume"]
    return Table(
        f"{result.mechanism}, {result.working_mode}: what the joints are asked for", columns, rows,
        {"volume": unit, "volume_error": unit}, tuple(notes), "demand",
        errors={name: (f"{name}_error",) for name in (*shares, "volume")},
    )  # fmt: skip


def demands_table(result: Capability) -> Table:
    """Return every demand, whether anything is asked for or not."""
    return _demand_table(result, result.demands, ())


def capability_tables(result: Capability) -> list[Table]:
    """Return a row for each rate and effort that is asked for, and the volumes."""
    asked = [d for d in result.demands if d.limit is not None or any(e.value for e in d.levels)]
    kept = ""
    if any(demand.limit is not None for demand in result.demands):
        share = uncertain(100 * result.share.value, 100 * result.share.error, "%")
        kept = f"; all limits are kept in {result.capable}, {share}"
    notes = ["p90: enough at 90 % of the reachable volume" if asked else "nothing is asked for"]
    if kept:
        notes[0] += "; volume: where the limit is enough"
    notes.append(f"task: {_task_text(result, _plain_unit)}")
    if len(asked) < len(result.demands):
        notes.append(_idle_text(result, [d for d in result.demands if d not in asked]))
    notes += result.task.moved(find(result.mechanism))
    notes.append(f"reachable volume {result.volume}{kept}")
    return [_demand_table(result, asked, notes)]


def _idle_text(result: Capability, idle: Sequence[Demand]) -> str:
    """Say which demands are 0 at every pose, and what would ask for them."""
    moved = any(getattr(result.task, size) for size in SIZES if size != "force")
    names = ", ".join(d.name for d in idle)
    needed = "--payload, --tool-force" if moved else "--speed, --turn, --payload, --tool-force, .."
    if not moved and all(d.name.endswith("_rate") for d in idle):
        needed = "--speed, --turn, --point-speed, --rotation-speed"
    return f"nothing is asked of {names}: {needed} do"


def capability_data(result: Capability) -> list[Table]:
    """Return all of it for CSV."""
    unit = result.units["volume"]
    numbers: dict[str, tuple[float | int | None, str]] = {
        name: (value, kind)
        for estimate, name, kind in (
            (result.volume, "volume", unit), (result.capable, "capable", unit),
            (result.share, "share", ONE),
        )
        for name, value in ((name, estimate.value), (f"{name}_error", estimate.error))
        if np.isfinite(value)
    }  # fmt: skip
    task = result.to_dict()["task"]
    numbers |= {f"task {name}": (size, result.units[name]) for name, size in task.items()}
    numbers |= {name: (getattr(result, name), ONE) for name in ("samples", "reachable", "seed")}
    numbers |= design_facts(result.params, result.units)
    texts = {"mechanism": result.mechanism, "working mode": result.working_mode,
             "moved": "; ".join(result.task.moved(find(result.mechanism)))}  # fmt: skip
    return [demands_table(result), facts(numbers, texts)]


def _plain_unit(text: str, unit: str) -> str:
    """Return a number with its unit as tables have it."""
    return text if unit == ONE else f"{text} {unit}"


def _task_text(result: Capability, with_unit: Callable[[str, str], str] = with_unit) -> str:
    task = result.to_dict()["task"]
    parts = [
        f"{k.replace('_', ' ')} {with_unit(exact(v), result.units[k])}"
        for k, v in task.items()
        if v
    ]
    return ", ".join(parts) or "standing still"


def draw_capability(
    asked: CapabilityTask, result: Capability, threads: int | None = None
) -> dict[str, bytes]:
    """Return sections that show the needed share of the motors' capability, by file name."""
    given = asked.limits
    if not given or result.reachable == 0:
        return {}
    demands = Demands(
        asked.mechanism, asked.parameters, result.working_mode, asked.task, None, threads
    )
    limited = [k for k, name in enumerate(demands.names) if name in given]
    bounds = np.array([[given[demands.names[k]]] for k in limited])

    def used(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        share: NDArray[np.float64] = (demands.at(poses)[limited] / bounds).max(axis=0)
        return share

    sampler = make_sampler(asked.mechanism, asked.settings, asked.seed, threads)
    sections = section_fields(sampler, sampler.design(asked.parameters), _RESOLUTION, used)
    gallery = Gallery()
    for k in range(0, len(sections), 3):
        gallery.add(
            f"capability{f'_{k // 3 + 1}' if k else ''}.png",
            functools.partial(_draw, sections[k : k + 3], result, given),
        )
    return gallery


def _draw(sections: tuple[Section, ...], result: Capability, limits: Mapping[str, float]) -> bytes:
    """Draw sections coloured by the largest share of a motor that is asked for; 1 is a line."""

    def above(width: float, remarks: list[str]) -> Heading:
        return _heading(result, limits, width, remarks)

    with workspace_plots.section_panels(sections, above) as (figure, panels, beside):
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        colours = colormaps[_COLOURS]
        norm = Normalize(0.0, _MOST)
        for section, axes in zip(sections, panels, strict=True):
            outline = workspace_plots.outline_of(axes, section)
            if outline is None:
                continue
            values = np.minimum(section.continued, 10 * _MOST)
            # Not interpolated: beside what is out of reach there is nothing to interpolate with.
            image = axes.imshow(
                values, colours, norm=norm, origin="lower", aspect="auto",
                extent=workspace_plots.image_place(section), interpolation="nearest",
            )  # fmt: skip
            image.set_clip_path(outline)
            workspace_plots.draw_singular(axes, section, _SINGULAR, (0, (3, 1.5)))
            if np.nanmin(values) < 1 < np.nanmax(values):
                axes.contour(section.horizontal, section.vertical, values, [1.0], colors=[INK],
                             linewidths=1.2)  # fmt: skip
        bar = figure.colorbar(ScalarMappable(norm, colours), cax=beside, extend="max")
        bar.ax.axhline(1.0, color=INK, linewidth=1.2)
        bar.set_label("needed / available, largest of all joints")
        return to_picture(figure)


def _heading(
    result: Capability, limits: Mapping[str, float], width: float, remarks: list[str]
) -> Heading:
    """Return what stands above: design, task, limits and what the lines are."""
    params = {k: v for k, v in result.params.items() if v is not None}
    motors = [f"{k} {with_unit(exact(v), result.units[k])}" for k, v in limits.items()]
    share = estimate_text(100 * result.share.value, 100 * result.share.error)
    return heading(
        width,
        f"{result.mechanism}: {parameter_text(params, result.units)}",
        [
            *_task_text(result).split(", "), *result.task.moved(find(result.mechanism))[:2],
            *(f"{'limits: ' if k == 0 else ''}{text}" for k, text in enumerate(motors)),
            f"kept in {share} % of the volume", f"working mode {result.working_mode}", *remarks,
            "black lines: limits just enough", "white dashes: singular",
        ],
    )  # fmt: skip
