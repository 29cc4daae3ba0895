"""Runs of what is proven: results, tables and files."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pmopt.analysis.certified_index import IndexBounds
from pmopt.analysis.certify import (
    CertifiedVolume,
    Claim,
    Progress,
    certify_claim,
    certify_volume,
)
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.sweeper import Notify
from pmopt.mechanisms.base import Mechanism, Parameters
from pmopt.reporting.run_folder import RunFolder, claimed
from pmopt.reporting.table import Table, to_csv, to_json
from pmopt.units import span_text

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
            _write(folder, result.to_dict(), volume_tables(result), settings, config)
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
            _write(folder, result.to_dict(), claim_tables(result), settings, asdict(budgets))
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
    row = (result.lower, result.upper, result.gap, result.boxes, result.undecided, result.stopped)
    return [
        Table(
            f"{result.mechanism}, {result.working_mode}: guaranteed bounds of the volume",
            ("lower", "upper", "gap", "boxes", "undecided", "stopped"),
            (row,),
            result.units,
            (result.note,),
            display=((f"{result.lower:.12g}", f"{result.upper:.12g}", f"{result.gap:.3g}",
                      *row[3:]),),
        ),
        *([] if result.index is None else [_index_table(result, result.index)]),
    ]  # fmt: skip


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
    )


def claim_tables(result: Claim) -> list[Table]:
    """Return the verdict as a row, with the witness if there is one."""
    witness = result.witness or dict.fromkeys(result.box)
    columns = ("verdict", *witness, "witness_lci", "reachable", "open_share", "boxes", "stopped")
    row = (
        result.verdict, *witness.values(), result.witness_lci, result.reachable,
        result.open_share, result.boxes, result.stopped,
    )  # fmt: skip
    domain = ", ".join(
        f"{name} = {span_text(ends, result.units[name])}" for name, ends in result.box.items()
    )
    title = f"{result.mechanism}, {result.working_mode}: {result.claim}"
    notes = [f"domain: {domain}", result.note]
    notes += [f"LCI of the {result.index_note}"] if result.min_lci is not None else []
    return [Table(title, columns, (row,), result.units, tuple(notes))]
