"""A whole ``pmopt capability`` run: result, tables, picture, files."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.capability import (
    SHARES,
    SIZES,
    Capability,
    Demands,
    Task,
    check_limits,
    compute_capability,
)
from pmopt.analysis.emptiness import require_reachable
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sweeper import Sweeper
from pmopt.analysis.validation import validated
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.base import Parameters
from pmopt.mechanisms.bodies import point_mass
from pmopt.reporting import plots
from pmopt.reporting.canvas import (
    INK,
    estimate_text,
    parameter_text,
    to_picture,
    with_unit,
)
from pmopt.reporting.chart_text import Heading, heading
from pmopt.reporting.fields import Section, section_fields
from pmopt.reporting.gallery import Gallery, write_pictures
from pmopt.reporting.run_folder import RunFolder, claimed
from pmopt.reporting.table import Cell, Table, to_csv, to_json, uncertain, with_error
from pmopt.units import exact

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
            raise InputError(f"{where}: is no manifest of a capability run: {error}") from None


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
    folder.write("demands.csv", to_csv(capability_tables(result)) + "\n")
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


def capability_tables(result: Capability) -> list[Table]:
    """Return a row for each rate and effort, and the volumes."""
    columns = ["demand", "unit", "limit"]
    for share in SHARES:
        columns += [f"p{100 * share:.0f}", f"p{100 * share:.0f}_error"]
    columns += ["volume", "volume_error"]

    def cell(value: float) -> Cell:
        return value if np.isfinite(value) else None

    rows: list[tuple[Cell, ...]] = []
    display: list[tuple[Cell, ...]] = []
    for demand in result.demands:
        pairs = [*demand.levels, demand.volume]
        rows.append((demand.name, demand.unit, demand.limit,
                     *(cell(value) for pair in pairs for value in pair)))  # fmt: skip
        shown = [text for pair in pairs for text in with_error(*pair)]
        limit = None if demand.limit is None else exact(demand.limit)
        display.append((demand.name, demand.unit, limit, *shown))
    unit = result.units["volume"]
    units = {"volume": unit, "volume_error": unit}
    task = _task_text(result)
    percent = estimate_text(100 * result.share.value, 100 * result.share.error)
    kept = ""
    if any(demand.limit is not None for demand in result.demands):
        kept = f"; all limits are kept in {uncertain(*result.capable, unit)}, {percent} %"
    notes = [
        "p90: enough at 90 % of the reachable volume; volume: where the limit is enough",
        f"task: {task}",
        *result.task.moved(find(result.mechanism)),
        f"reachable volume {uncertain(*result.volume, unit)}{kept}",
    ]
    return [
        Table(
            f"{result.mechanism}, {result.working_mode}: what the joints are asked for",
            tuple(columns), tuple(rows), units, tuple(notes), tuple(display),
        )
    ]  # fmt: skip


def _task_text(result: Capability) -> str:
    told = result.to_dict()["task"]
    parts = [
        f"{k.replace('_', ' ')} {with_unit(exact(v), result.units[k])}"
        for k, v in told.items()
        if v
    ]
    return ", ".join(parts) or "standing still"


def draw_capability(
    asked: CapabilityTask, result: Capability, threads: int | None = None
) -> dict[str, bytes]:
    """Return sections that show how much of what the motors have is asked for, by file name."""
    given = asked.limits
    if not given or result.reachable == 0:
        return {}
    demands = Demands(
        asked.mechanism, asked.parameters, result.working_mode, asked.task, None, threads
    )
    bounds = np.array([given.get(name, np.inf) for name in demands.names])

    def used(poses: NDArray[np.float64]) -> NDArray[np.float64]:
        share: NDArray[np.float64] = (demands.at(poses) / bounds[:, None]).max(axis=0)
        return share

    sweeper = Sweeper(asked.mechanism, asked.settings, asked.seed, threads)
    sections = section_fields(sweeper, sweeper.design(asked.parameters), _RESOLUTION, used)
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

    with plots.section_panels(sections, above) as (figure, panels, beside):
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        colours = colormaps[_COLOURS]
        norm = Normalize(0.0, _MOST)
        for section, axes in zip(sections, panels, strict=True):
            outline = plots.outline_of(axes, section)
            if outline is None:
                continue
            values = np.minimum(section.continued, 10 * _MOST)
            # Not interpolated: beside what is out of reach there is nothing to interpolate with.
            image = axes.imshow(
                values, colours, norm=norm, origin="lower", extent=plots.image_place(section),
                aspect="auto", interpolation="nearest",
            )  # fmt: skip
            image.set_clip_path(outline)
            plots.draw_singular(axes, section, _SINGULAR, (0, (3, 1.5)))
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
