"""Runs of proofs: results, tables and files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pmopt.analysis.certification.bisection import Progress
from pmopt.analysis.certification.certified_index import IndexBounds
from pmopt.analysis.certification.claim import Claim, certify_claim
from pmopt.analysis.certification.volume import CertifiedVolume, certify_volume
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.mechanisms.mechanism import Mechanism, Parameters
from pmopt.reporting.runs.run_folder import RunFolder, claimed
from pmopt.reporting.tables.table import Cell, Shown, Table, design_facts, facts, to_csv, to_json
from pmopt.units import ONE, span_text

#: Of a claim, where no budget is given.
DEFAULT_SECONDS = 30.0


@dataclass(frozen=True)
class Budgets:
    """What a proof may spend: seconds of work, boxes examined, either or none."""

    time_budget: float | None = None
    box_budget: int | None = None


def run_volume(
    mechanism: Mechanism,
    parameters: Parameters,
    settings: WorkspaceSettings,
    gap: float,
    budgets: Budgets,
    out: Path | None = None,
    *,
    force: bool = False,
    notify: Notify | None = None,
    progress: Progress | None = None,
) -> CertifiedVolume:
    """Enclose a workspace's volume and, with ``out``, write the run's folder."""
    with claimed(out, force) as folder:
        result = certify_volume(
            mechanism, parameters, settings, gap=gap, progress=progress, notify=notify,
            **asdict(budgets),
        )  # fmt: skip
        if folder is not None:
            config = {"certify": gap, **asdict(budgets)}
            _write(folder, result.to_dict(), certified_data(result), settings, config)
        return result


def run_claim(
    mechanism: Mechanism,
    parameters: Parameters,
    settings: WorkspaceSettings,
    budgets: Budgets,
    out: Path | None = None,
    *,
    force: bool = False,
    notify: Notify | None = None,
) -> Claim:
    """Decide a claim and, with ``out``, write the run's folder."""
    with claimed(out, force) as folder:
        result = certify_claim(mechanism, parameters, settings, notify=notify, **asdict(budgets))
        if folder is not None:
            _write(folder, result.to_dict(), certified_data(result), settings, asdict(budgets))
        return result


def _write(
    folder: RunFolder,
    document: dict[str, Any],
    tables: list[Table],
    settings: WorkspaceSettings,
    config: dict[str, Any],
) -> None:
    folder.open()
    folder.write("result.json", to_json(document) + "\n")
    folder.write("result.csv", to_csv(tables) + "\n")
    config = {
        "mechanism": document["mechanism"],
        "parameters": document["params"],
        "workspace": settings.model_dump(mode="json"),
        **config,
    }
    folder.close(
        "certify",
        {
            "mechanism": document["mechanism"],
            "config": config,
            "seed": None,
            "resumes": [],
            "units": document["units"],
        },
    )


def volume_tables(result: CertifiedVolume) -> list[Table]:
    """Return the bounds of the volume as a row, those of the index as two."""
    gap = Shown(result.gap, f"{100 * result.gap:.3g} %")
    bounds = [Shown(v, f"{v:.12g}") for v in (result.lower, result.upper)]
    row: tuple[Cell, ...] = (*bounds, gap, result.boxes, result.undecided, result.stopped)
    return [
        Table(
            f"{result.mechanism}, {result.working_mode}: guaranteed bounds of the volume",
            ("lower", "upper", "gap", "boxes", "undecided", "stopped"),
            (row,),
            result.units,
            (result.note, f"domain: {_domain(result.box, result.units)}"),
            "volume",
        ),
        *([] if result.index is None else [_index_table(result, result.index)]),
    ]


def _index_table(result: CertifiedVolume, index: IndexBounds) -> Table:
    """Return the bounds of the least and the largest LCI, a row each."""
    rows = (
        ("least", index.min_lower, index.min_upper),
        ("largest", index.max_lower, index.max_upper),
    )
    return Table(
        "Guaranteed bounds of LCI",
        ("lci", "lower", "upper"),
        tuple((name, *(None if v != v else v for v in ends)) for name, *ends in rows),
        {},
        (f"LCI of the {result.index_note}; {result.norm}-norm",),
        "lci",
    )


def claim_tables(result: Claim) -> list[Table]:
    """Return the verdict as a row, with the witness if there is one."""
    witness = result.witness or dict.fromkeys(result.box)
    columns = ("verdict", *witness, "witness_lci", "reachable", "open_share", "boxes", "stopped")
    row: tuple[Cell, ...] = (
        result.verdict, *witness.values(), result.witness_lci, result.reachable,
        Shown(result.open_share, f"{result.open_share:.3g}"), result.boxes, result.stopped,
    )  # fmt: skip
    title = f"{result.mechanism}, {result.working_mode}: {result.claim}"
    notes = [f"domain: {_domain(result.box, result.units)}", result.note]
    notes += [f"LCI of the {result.index_note}"] if result.min_lci is not None else []
    return [Table(title, columns, (row,), result.units, tuple(notes), "claim")]


def _domain(box: Mapping[str, tuple[float, float]], units: Mapping[str, str]) -> str:
    return ", ".join(f"{name} = {span_text(ends, units[name])}" for name, ends in box.items())


def certified_data(result: Claim | CertifiedVolume) -> list[Table]:
    """Return all of a claim or of bounds for CSV."""
    tables = claim_tables(result) if isinstance(result, Claim) else volume_tables(result)
    ranges = {"domain": result.box, "limit": result.limits}
    numbers: dict[str, tuple[float | int | None, str]] = {
        f"{kind} {name} {side}": (value if math.isfinite(value) else None, result.units[name])
        for kind, group in ranges.items()
        for name, ends in group.items()
        for side, value in zip(("lower", "upper"), ends, strict=True)
    }
    numbers |= design_facts(result.params, result.units)
    texts = {"mechanism": result.mechanism, "working mode": result.working_mode,
             "norm": result.norm, "index": result.index_note, "note": result.note}  # fmt: skip
    if isinstance(result, Claim):
        numbers["min_lci"] = result.min_lci, ONE
        texts["claim"] = result.claim
    return [*tables, facts(numbers, texts)]
