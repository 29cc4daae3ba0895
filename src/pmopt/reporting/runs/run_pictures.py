"""The pictures of a run, from its results or from the files of its folder."""

from __future__ import annotations

import functools
import io
import os
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmopt.analysis.regions.sections import (
    Section,
    SurfaceMesh,
    position_field,
    section_fields,
    surface_field,
)
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.workspace.compute import WorkspaceResult, compute_workspace
from pmopt.errors import InputError
from pmopt.inputs.reading import LARGEST, read_file
from pmopt.reporting.pictures import workspace_plots
from pmopt.reporting.pictures.drawing import draw_mechanism
from pmopt.reporting.pictures.front_plots import (
    draw_front,
    draw_history,
    influential,
    reference_text,
)
from pmopt.reporting.pictures.gallery import Gallery
from pmopt.reporting.runs.run_folder import MANIFEST, read_manifest
from pmopt.reporting.runs.tasks import WorkspaceTask

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pandas as pd

#: Larger values are none of a front's, and leave what an axis can show.
_LARGEST_VALUE = 1e100


def of_workspace(
    task: WorkspaceTask, result: WorkspaceResult, threads: int | None = None
) -> dict[str, bytes]:
    """Return histogram, 3-D picture and sections by file name."""
    sampler = make_sampler(task.mechanism, task.settings, task.seed, threads)
    design = sampler.design(task.parameters)
    remarks = _of_positions(task)
    gallery = Gallery()
    gallery.add("lci_histogram.png", lambda: workspace_plots.draw_histogram(result))
    gallery.add_all(
        "workspace.png",
        lambda: _drawn_surface("workspace.png", surface_field(sampler, design), result),
    )
    gallery.add_all(
        "positions.png",
        lambda: _drawn_surface("positions.png", position_field(sampler, design), result, remarks),
    )
    gallery.add_all(
        "sections.png", lambda: _drawn_sections(section_fields(sampler, design), result)
    )
    gallery.add_all("mechanism.png", lambda: _drawn_mechanism(task))
    return gallery


def draw_part(
    task: WorkspaceTask, result: WorkspaceResult, part: str, threads: int | None = None
) -> bytes:
    """Draw one picture of a workspace.

    Parameters
    ----------
    task : WorkspaceTask
    result : WorkspaceResult
        Of the same design.
    part : {"sections", "surface", "positions"}
        Of the sections the first three; a surface needs three coordinates and positions a pose
        that is none: each stands for the other where there is none.
    threads : int, optional
    """
    sampler = make_sampler(task.mechanism, task.settings, task.seed, threads)
    design = sampler.design(task.parameters)
    if part == "sections":
        return workspace_plots.draw_sections(section_fields(sampler, design)[:3], result)
    mesh, remarks = position_field(sampler, design), _of_positions(task)
    if mesh is None or (part == "surface" and len(task.mechanism.pose) == 3):
        mesh, remarks = surface_field(sampler, design), []
    if mesh is None:
        raise InputError(f"plot: {task.mechanism.name} has no picture of its {part}")
    return workspace_plots.draw_surface(mesh, result, remarks)


def _of_positions(task: WorkspaceTask) -> list[str]:
    what = "the tool point" if task.settings.tool else "the platform's centre"
    return [f"positions of {what}, coloured by the largest LCI met there"]


def _drawn_surface(
    name: str, mesh: SurfaceMesh | None, result: WorkspaceResult, remarks: Sequence[str] = ()
) -> dict[str, bytes]:
    """Return a 3-D picture, nothing where the mechanism has none of its kind."""
    return {} if mesh is None else {name: workspace_plots.draw_surface(mesh, result, remarks)}


def _drawn_sections(sections: Sequence[Section], result: WorkspaceResult) -> dict[str, bytes]:
    """Return the sections, three a picture."""
    gallery = Gallery()
    for k in range(0, len(sections), 3):
        shown = sections[k : k + 3]
        gallery.add(
            f"sections{f'_{k // 3 + 1}' if k else ''}.png",
            functools.partial(workspace_plots.draw_sections, shown, result),
        )
    return gallery


def _drawn_mechanism(task: WorkspaceTask) -> dict[str, bytes]:
    """Return the mechanism at home, nothing where the design does not reach it."""
    mechanism, parameters = task.mechanism, task.parameters
    mode = mechanism.check_mode(task.settings.working_mode)
    home = mechanism.home(parameters)
    if not any(s.working_mode == mode for s in mechanism.inverse(parameters, home)):
        return {}
    return {"mechanism.png": draw_mechanism(mechanism, parameters, home, mode)}


def of_singularities(task: WorkspaceTask, threads: int | None = None) -> dict[str, bytes]:
    """Return sections with the singular loci by file name."""
    result = compute_workspace(
        task.mechanism, task.parameters, task.settings, seed=task.seed, threads=threads,
        shape_grid=0,
    )  # fmt: skip
    sampler = make_sampler(task.mechanism, task.settings, task.seed, threads)
    gallery = Gallery()
    gallery.add_all(
        "sections.png",
        lambda: _drawn_sections(section_fields(sampler, sampler.design(task.parameters)), result),
    )
    gallery.add_all("mechanism.png", lambda: _drawn_mechanism(task))
    return gallery


def of_pareto(
    tables: Mapping[str, pd.DataFrame], units: Mapping[str, str], manifest: Mapping[str, Any]
) -> dict[str, bytes]:
    """Return front and course of the search by file name.

    Parameters
    ----------
    tables : mapping
        ``front`` and ``history`` as their CSV files have them.
    units : mapping
        Unit by column name.
    manifest : mapping
        ``mechanism``, ``config`` and ``result`` of the run's manifest.
    """
    gallery = Gallery()
    for name, draw in of_search(tables, units, manifest).items():
        gallery.add(f"{name}.png", draw)
    return gallery


def of_search(
    tables: Mapping[str, pd.DataFrame], units: Mapping[str, str], manifest: Mapping[str, Any]
) -> dict[str, Callable[[], bytes]]:
    """Return what draws ``front`` and ``history``, see :func:`of_pareto`."""
    front, history = (
        {str(name): column.to_numpy() for name, column in tables[table].items()}
        for table in ("front", "history")
    )
    config, result = manifest["config"], manifest["result"]
    objectives, ranges, measured = config["objectives"], config["parameters"], config["workspace"]
    parameters = [name for name in ranges if name in front]
    count = len(tables["front"])
    title = (
        f"{manifest['mechanism']}: Pareto front, {count} design{'s' if count > 1 else ''} "
        f"({measured['working_mode']}, {measured['jacobian']} Jacobian, {measured['norm']}-norm)"
    )
    knee = int(result["knee"]["design"]) - 1
    colour = influential(front, ranges, result["idle_directions"], objectives)
    reference = reference_text(result, units, objectives)
    return {
        "front": lambda: draw_front(
            front, units, parameters, objectives, title=title, notes=[reference], knee=knee,
            colour_by=colour,
        ),
        "history": lambda: draw_history(
            history, units, objectives, title=f"{manifest['mechanism']}: course of the search",
            notes=["on the samples of the search", f"measured finely: {reference}"],
        ),
    }  # fmt: skip


def of_folder(folder: Path, threads: int | None = None) -> dict[str, bytes]:
    """Return the pictures of a finished run, drawn anew from its folder.

    Raises
    ------
    InputError
        When the folder holds no finished run, or its files are not what the manifest says.
    """
    manifest = manifest_of(folder)
    drawn = _drawn(folder, manifest, threads)
    if manifest_of(folder) != manifest:
        raise InputError(f"{folder}: another command has written it meanwhile")
    return drawn


def manifest_of(folder: Path) -> dict[str, Any]:
    """Return the manifest of a finished run that has pictures.

    Raises
    ------
    InputError
    """
    manifest = read_manifest(folder)
    if manifest is None:
        damaged = os.path.lexists(folder / MANIFEST)
        why = f"{MANIFEST} is damaged" if damaged else f"no {MANIFEST}"
        raise InputError(f"{folder}: holds no finished run ({why})")
    if manifest["command"] == "certify":
        raise InputError(f"{folder}: a run of proofs has no pictures")
    return manifest


def _drawn(folder: Path, manifest: dict[str, Any], threads: int | None) -> dict[str, bytes]:
    try:
        _check_outputs(folder, manifest)
        if manifest["command"] == "workspace":
            task = WorkspaceTask.from_dict(manifest["config"], str(folder))
            result = compute_workspace(
                task.mechanism, task.parameters, task.settings, seed=task.seed, threads=threads,
                shape_grid=0,
            )  # fmt: skip
            return of_workspace(task, result, threads)
        if manifest["command"] == "singularities":
            task = WorkspaceTask.from_dict(manifest["config"], str(folder))
            return of_singularities(task, threads)
        if manifest["command"] == "motion":
            from pmopt.analysis.motion.config import resolve_motion
            from pmopt.reporting.pictures.motion_plots import draw_motion
            from pmopt.reporting.runs.motion_run import run_motion

            moved = resolve_motion(manifest["config"], str(folder), folder)
            return draw_motion(run_motion(moved, threads=threads).motion, moved.mechanism)
        if manifest["command"] == "capability":
            from pmopt.reporting.runs.capability_run import CapabilityTask, compute, draw_capability

            asked = CapabilityTask.from_dict(manifest["config"], str(folder))
            return draw_capability(asked, compute(asked, threads), threads)
        if manifest["command"] == "simulate":
            from pmopt.analysis.motion.config import resolve_motion
            from pmopt.reporting.runs.simulate_run import draw_run, run_simulation

            moved = resolve_motion(manifest["config"], str(folder), folder)
            return draw_run(run_simulation(moved, threads=threads))
        import pandas as pd

        if manifest["command"] != "pareto":
            raise InputError(f"{folder}: a {manifest['command']} run has no pictures")
        tables = {}
        for name in ("front", "history"):
            tables[name] = pd.read_csv(io.BytesIO(read_file(folder / f"{name}.csv")))
            if (tables[name].select_dtypes("number").abs() > _LARGEST_VALUE).any(axis=None):
                raise ValueError(f"{name}.csv has a number that none of its columns can have")
        return of_pareto(tables, manifest["units"], manifest)
    except (OSError, ArithmeticError, LookupError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"{folder}: the run's files are damaged: {error}") from None


def _check_outputs(folder: Path, manifest: dict[str, Any]) -> None:
    """Refuse a run with a pipe, a folder or gigabytes in the place of one of its files.

    Raises
    ------
    OSError, ValueError
    """
    for name in dict(manifest["outputs"]):
        found = (folder / name).stat()
        if not stat.S_ISREG(found.st_mode) or found.st_size > LARGEST:
            raise ValueError(f"{name} is none of its files")
