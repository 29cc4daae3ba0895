"""Designs from anywhere: a run's knee, a row of a front, a manifest, a configuration, a file.

A reference is the name of a run's folder, of a ``.csv`` front, of a ``.json`` (a manifest, or what
``--format json`` printed) or of a TOML file; for a search ``:`` and the design follow: ``knee``, a
number, or ``best-<objective>``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmopt.analysis.kinematics.pose_rows import parse_number
from pmopt.analysis.validation import read_toml
from pmopt.errors import InputError, unknown_name
from pmopt.inputs.examples import advice
from pmopt.inputs.reading import parse_json
from pmopt.inputs.tables import Table, read_table
from pmopt.inputs.text import read_text
from pmopt.mechanisms import Mechanism, find
from pmopt.reporting.runs.run_folder import MANIFEST
from pmopt.synthesis.objectives import SENSES
from pmopt.units import ONE

FRONT = "front.csv"
KNEE = "knee"
_BEST = "best-"


@dataclass(frozen=True)
class Design:
    """Parameters that a reference gives, those left out at their defaults, and remarks."""

    parameters: dict[str, Any]
    notes: tuple[str, ...] = ()


def read_design(reference: str, mechanism: Mechanism, where: str) -> Design:
    """Return the design that a reference names.

    Parameters
    ----------
    reference : str
        ``PATH`` or ``PATH:DESIGN``.
    mechanism : Mechanism
        Whose design it is to be.
    where : str
        What errors call the reference.

    Raises
    ------
    InputError
        One line: what was looked for, and what there is.
    """
    path, chosen = _split(reference)
    if not os.path.exists(path):  # also where the name is too long for one
        raise InputError(f"{where}: no such file or folder{advice(path)}")
    if path.is_dir():
        found = _of_run(path, chosen, mechanism, where)
    elif path.suffix.lower() == ".csv":
        found = _of_table(path, chosen, mechanism, where)
    elif path.suffix.lower() == ".json":
        document = _json(path, where)
        found = (
            _of_manifest(document, path.parent, chosen, mechanism, where)
            if "command" in document
            else _of_document(document, chosen, mechanism, where)
        )
    else:
        if chosen is not None:
            raise InputError(f"{where}: {path} holds one design: no :{chosen} is needed")
        found = _of_document(read_toml(path, where), None, mechanism, where)
    return found


def _split(reference: str) -> tuple[Path, str | None]:
    """Return file or folder, and the design behind the last colon."""
    whole = Path(reference)
    front, colon, chosen = reference.rpartition(":")
    if not colon or os.path.exists(whole) or not front:
        return whole, None
    return Path(front), chosen


def _json(path: Path, where: str) -> dict[str, Any]:
    try:
        document = parse_json(read_text(path))
    except OSError as error:
        raise InputError(f"{where}: {path}: cannot read: {error.strerror or error}") from None
    except ValueError as error:
        raise InputError(f"{where}: {path}: is not a JSON file: {error}") from None
    if not isinstance(document, dict):
        raise InputError(f"{where}: {path}: is neither a run nor the result of one")
    return document


def _of_run(folder: Path, chosen: str | None, mechanism: Mechanism, where: str) -> Design:
    if (folder / MANIFEST).is_file():
        document = _json(folder / MANIFEST, where)
        return _of_manifest(document, folder, chosen, mechanism, where)
    runs = sorted(p.parent.name for p in folder.glob(f"*/{MANIFEST}"))
    if runs:
        raise InputError(
            f"{where}: {folder} holds several runs: one of {', '.join(runs)} is needed"
        )
    raise InputError(f"{where}: {folder} holds no finished run")


def _of_manifest(
    document: Mapping[str, Any],
    folder: Path,
    chosen: str | None,
    mechanism: Mechanism,
    where: str,
) -> Design:
    if document.get("command") != "pareto":
        for key in ("config", "task"):
            if isinstance(document.get(key), dict):
                return _of_document({**document, **document[key]}, chosen, mechanism, where)
        return _of_document(document, chosen, mechanism, where)
    config, result = document.get("config"), document.get("result")
    if not (
        isinstance(config, dict)
        and isinstance(result, dict)
        and all(isinstance(config.get(key), dict) for key in ("parameters", "workspace"))
        and isinstance(config.get("objectives"), list)
    ):
        raise InputError(f"{where}: {folder / MANIFEST}: is not the manifest of a search")
    _check_mechanism(config, mechanism, where)
    if chosen is None:
        best = ", ".join(f":{_BEST}{name}" for name in config["objectives"])
        raise InputError(
            f"{where}: a search has many designs: :{KNEE}, {best} or the number of one is needed"
        )
    if chosen == KNEE:
        knee = result.get(KNEE)
        if not isinstance(knee, dict) or not isinstance(knee.get("params"), dict):
            raise InputError(f"{where}: {folder / MANIFEST}: names no knee")
        parameters = dict(knee["params"])
    else:
        fixed = {k: v for k, v in config["parameters"].items() if not _is_range(v)}
        parameters = fixed | _of_table(folder / FRONT, chosen, mechanism, where).parameters
    mode = config["workspace"].get("working_mode")
    notes: tuple[str, ...] = ()
    if mode not in (None, mechanism.working_modes[0]):
        notes = (f"{where}: the search was in working mode {mode}: --working-mode {mode}",)
    return Design(parameters, notes)


def _of_table(path: Path, chosen: str | None, mechanism: Mechanism, where: str) -> Design:
    table = read_table(path, f"{where}: {path}" if str(path) not in where else where)
    names = [p.name for p in mechanism.parameters if p.name in table.names]
    if "design" not in table.names or not names:
        raise InputError(
            f"{where}: {path}: is not a front of {mechanism.name}: columns design and "
            f"{', '.join(p.name for p in mechanism.parameters)} are needed"
        )
    row = _row(table, chosen, where)
    found = {name: row[table.names.index(name)] for name in names}
    return Design({name: cell for name, cell in found.items() if cell})


def _row(table: Table, chosen: str | None, where: str) -> tuple[str, ...]:
    objectives = [name for name in table.names if name in SENSES]
    choices = [f"{_BEST}{name}" for name in objectives]
    numbers = table.column("design")
    if chosen is None:
        raise InputError(
            f"{where}: a front has many designs: :NUMBER or :{' or :'.join(choices)} is needed"
        )
    if chosen.startswith(_BEST):
        if chosen not in choices:
            raise unknown_name(where, chosen, choices)
        name = chosen.removeprefix(_BEST)
        values = [
            SENSES[name] * parse_number(f"{where}, line {line}", name, cell, ONE)
            for line, cell in zip(table.lines, table.column(name), strict=True)
        ]
        return table.cells[values.index(max(values))]
    if chosen not in numbers:
        raise InputError(
            f"{where}: no design {chosen!r}: the front has {numbers[0]} to {numbers[-1]}"
            f"{''.join(f', {choice}' for choice in choices)}"
        )
    return table.cells[numbers.index(chosen)]


def _of_document(
    document: Mapping[str, Any], chosen: str | None, mechanism: Mechanism, where: str
) -> Design:
    """Return the parameters of a configuration, a manifest or a printed result."""
    _check_mechanism(document, mechanism, where)
    if chosen is not None:
        raise InputError(f"{where}: holds one design: no :{chosen} is needed")
    table: Any = document
    for key in ("parameters", "params"):
        if key in document:
            table = document[key]
    if not isinstance(table, dict):
        raise InputError(f"{where}: parameters is not a table of NAME = VALUE")
    if table is document and "mechanism" in document:  # all parameters at their defaults
        table = {}
    ranges = [name for name, value in table.items() if _is_range(value)]
    notes: tuple[str, ...] = ()
    if ranges:
        notes = (f"{where}: {', '.join(ranges)}: a range is no design, the default is taken",)
    return Design({k: v for k, v in table.items() if k not in ranges}, notes)


def _is_range(value: Any) -> bool:
    return isinstance(value, list | dict)


def _check_mechanism(document: Mapping[str, Any], mechanism: Mechanism, where: str) -> None:
    name = document.get("mechanism")
    if isinstance(name, str) and find(name).name != mechanism.name:
        raise InputError(f"{where}: is a design of {name}, not of {mechanism.name}")
