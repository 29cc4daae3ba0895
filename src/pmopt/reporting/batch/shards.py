"""What the folder of a batch is to hold, and parts of a batch brought together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmopt.errors import InputError
from pmopt.inputs.reading import read_json
from pmopt.reporting.batch.plan import (
    in_shard,
    parse_shard,
)
from pmopt.reporting.batch.runners import RUNNERS
from pmopt.reporting.batch.summary import BatchResult, summary_of
from pmopt.reporting.runs.run_folder import (
    PLAN,
    RUNS,
    RunFolder,
)
from pmopt.reporting.tables.table import to_csv
from pmopt.storage.checkpoint import differences

if TYPE_CHECKING:
    pass

#: The batch's summary, and the file that shows workers that it is alive.
SUMMARY, LOCK = "summary.csv", "batch.lock"
SCHEMA = 1


def read_plan(folder: Path) -> dict[str, Any] | None:
    """Return what a batch's folder is to hold, None where there is no batch."""
    try:
        document = read_json(folder / PLAN)
        shard, runs = document["shard"], document["runs"]
        if document["schema"] != SCHEMA or not all(map(_is_planned, runs)):
            return None
        if shard is not None:
            parse_shard(shard)
        return {"shard": shard, "runs": list(runs)}
    except (OSError, ValueError, LookupError, TypeError, AttributeError, InputError):
        return None


def _is_planned(run: Any) -> bool:
    """Return whether this is a run of a plan, as :meth:`PlannedRun.to_dict` gives it."""
    texts = [run[key] for key in ("name", "command", "mechanism", "source", "config_sha256")]
    return (
        all(isinstance(text, str) for text in texts)
        and Path(run["name"]).name == run["name"] not in ("", "..")
        and run["command"] in RUNNERS
        and all(not isinstance(cell, list | dict) for cell in run["swept"].values())
    )


def shard_text(shard: tuple[int, int] | None) -> str | None:
    """Return which part of a batch a shard is, as it is given: ``k/n``."""
    return None if shard is None else f"{shard[0]}/{shard[1]}"


def merge(folders: Sequence[Path], out: Path, force: bool = False) -> BatchResult:
    """Bring the shards of a batch together into one summary, the same as of the whole batch.

    Runs of shards that are missing or were cut off are ``pending``.

    Raises
    ------
    InputError
        For a folder that holds no batch, or shards of different batches.
    """
    plans = []
    for path in folders:
        plan = read_plan(path)
        if plan is None:
            raise InputError(f"--merge: {path} holds no batch")
        plans.append(plan)
        if plan["runs"] != plans[0]["runs"]:
            raise InputError(
                f"--merge: {path} holds a part of another batch than {folders[0]}: "
                f"{_difference(plans[0]['runs'], plan['runs'])}"
            )
    if any(path.resolve() == out.resolve() for path in folders):
        raise InputError(f"--out: {out} is one of the shards")
    runs = []
    for number, planned in enumerate(plans[0]["runs"]):
        parts = [summary_of(planned, path / RUNS / planned["name"])
                 for path, plan in zip(folders, plans, strict=True)
                 if in_shard(number, _shard(plan["shard"]))]  # fmt: skip
        done = [part for part in parts if part.status == "finished"] + parts
        runs.append(done[0] if done else summary_of(planned, out / RUNS / planned["name"]))
    result = BatchResult(out, tuple(runs))
    with RunFolder(out, force) as folder:
        folder.write(SUMMARY, to_csv([result.table()]) + "\n")
        folder.close(
            "batch", {"merged": [str(path) for path in folders], "runs": result.to_dict()["runs"]}
        )
    return result


def _shard(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    k, n = text.split("/")
    return int(k), int(n)


def _difference(one: list[dict[str, Any]], other: list[dict[str, Any]]) -> str:
    """Return the first thing in which two plans differ."""
    if len(one) != len(other):
        return f"{len(one)} and {len(other)} runs"
    found = (d for a, b in zip(one, other, strict=True) for d in differences(a, b))
    key, old, new = next(found)
    return f"{key}: {old} -> {new}"
