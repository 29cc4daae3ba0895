"""What a file or folder is, and which command reads it."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pmopt.errors import InputError
from pmopt.inputs.examples import advice
from pmopt.inputs.reading import parse_toml, read_json
from pmopt.inputs.text import read_text

MANIFEST = "manifest.json"
BATCH = "batch.json"
#: Bytes beyond which a file is not looked into.
_MOST = 1 << 22
#: What kinds of configurations are called, and the commands that read them.
_READERS = {
    "pareto": ("a search", ("pareto",)),
    "motion": ("a motion", ("motion", "simulate")),
    "batch": ("a batch", ("batch",)),
}


def kind_of_config(data: Mapping[str, Any]) -> str | None:
    """Return what a configuration is of: a key of the readers, or None for parameters alone."""
    if "sweep" in data or data.get("command", "pareto") not in ("pareto", "motion"):
        return "batch"
    if "command" in data:
        return str(data["command"])
    if "trajectory" in data:
        return "motion"
    if any(key in data for key in ("objectives", "algorithm", "workspace", "final")):
        return "pareto"
    return None


def describe(path: Path) -> str:
    """Return in a few words what a file or folder is and what reads it; empty where unknown."""
    if path.is_dir():
        return _describe_folder(path)
    try:
        found = path.stat()
    except OSError:
        return ""
    suffix = path.suffix.lower()
    if not stat.S_ISREG(found.st_mode) or found.st_size > _MOST:
        return ""
    if path.name == MANIFEST:
        return _describe_run(path)
    if suffix == ".toml":
        try:
            data = parse_toml(read_text(path))
        except (OSError, ValueError):
            return ""
        return describe_config(data, path)
    if suffix == ".csv":
        return "is a table, no configuration"
    if suffix in (".png", ".svg", ".pdf", ".gif", ".html"):
        return "is a picture or page"
    return "is a result, no configuration" if suffix == ".json" else ""


def describe_config(data: Mapping[str, Any], path: Path | str) -> str:
    """Return what a configuration is of, and the commands that read it."""
    kind = kind_of_config(data)
    if kind is None:
        return "holds parameters: --params @FILE reads it"
    what, commands = _READERS[kind]
    return f"is the configuration of {what}: {' or '.join(f'pmopt {c} {path}' for c in commands)}"


def _describe_folder(path: Path) -> str:
    if (path / MANIFEST).is_file():
        return _describe_run(path / MANIFEST)
    if (path / BATCH).is_file():
        return "is the folder of a batch: its summary.csv has the results, each run its own folder"
    return "is a folder"


def _describe_run(manifest: Path) -> str:
    try:
        document = read_json(manifest)
    except (OSError, ValueError):
        document = {}
    command = document.get("command") if isinstance(document, dict) else None
    if not isinstance(command, str):
        return "is a folder"
    design = f", --params @{manifest.parent}:knee takes a design" if command == "pareto" else ""
    return f"is a finished run of pmopt {command}: pmopt plot {manifest.parent} draws it{design}"


def check_config(path: Path, data: Mapping[str, Any], command: str) -> None:
    """Refuse another command's configuration.

    Raises
    ------
    InputError
        Naming the command that reads it.
    """
    kind = kind_of_config(data)
    if kind is not None and command not in _READERS[kind][1]:
        raise InputError(f"{path}: {describe_config(data, path)}")


def missing(path: Path, names: Mapping[str, Any] | list[str], command: str) -> InputError:
    """Return the error for a configuration that is not there, or is none.

    Parameters
    ----------
    path : Path
    names : collection of str
        Of the mechanisms, since one may have been given instead of a file.
    command : str
        Which wants to read it.
    """
    if not os.path.lexists(path):
        key = str(path).casefold().replace(" ", "").replace("-", "").replace("_", "")
        for name in names:
            if name.replace("-", "") == key:
                return InputError(
                    f"{path}: is a mechanism, pmopt {command} needs a configuration"
                    f"{f': pmopt init {name} writes one' if command == 'pareto' else ''}"
                )
        return InputError(f"{path}: no such file{advice(path)}")
    return InputError(f"{path}: {describe(path) or 'is not a text file'}; a TOML file is needed")
