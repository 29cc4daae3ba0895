"""What a batch is to run: configurations, their sweeps, safe names, shards."""

from __future__ import annotations

import copy
import glob
import hashlib
import itertools
import json
import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from pmopt.analysis.validation import read_toml
from pmopt.errors import InputError, InputErrors
from pmopt.inputs.examples import advice_for_pattern
from pmopt.inputs.identify import describe
from pmopt.inputs.overrides import (
    SET,
    overridden,
    range_values,
    read_overrides,
    set_key,
    spaced_values,
    sweep_values,
)
from pmopt.reporting.batch.runners import Runner, resolve
from pmopt.reporting.tables.table import Cell

SWEEP = "sweep"
#: Most runs of a batch.
MAX_RUNS = 100_000
#: Longest name of a run, in characters, and how many of them may be a digest.
MAX_NAME = 100
_DIGEST = 8
#: What a name may hold; all else becomes a line below.
_UNSAFE = re.compile(r"[^A-Za-z0-9._=+-]+")
#: Names that some systems keep for devices.
_DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\.|$)")


#: Keys of a range of values.
_SPAN = {"start", "stop", "num"}


class BatchKeys(BaseModel):
    """Keys of a batch's configuration beside those of its command; see :func:`plan_runs`."""

    model_config = ConfigDict(frozen=True, extra="allow")

    command: Literal["pareto", "workspace", "motion"] = Field(
        default="pareto",
        description="What runs the configuration, and whose keys the others are. With a table "
        "`[trajectory]` the default is motion",
    )
    sweep: dict[str, Any] = Field(
        default_factory=dict,
        description="Dotted keys and what they are to be, one after the other: a list of values, a "
        'range `"FROM:TO:STEP"` or `{start, stop, num}`. Every combination is a run, the last key '
        "varies fastest",
    )


@dataclass(frozen=True)
class PlannedRun:
    """One run of a batch.

    Attributes
    ----------
    name : str
        Of its folder, unlike any other in the batch.
    source : str
        The configuration's file, as it was given.
    swept : dict
        Value by dotted key of ``[sweep]``.
    runner : Runner
    """

    name: str
    source: str
    swept: dict[str, Any]
    runner: Runner

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form, the same for the same run anywhere."""
        text = json.dumps(self.runner.document(), sort_keys=True)
        return {
            "name": self.name,
            "command": self.runner.command,
            "mechanism": self.runner.mechanism,
            "source": self.source,
            "swept": {key: as_cell(value) for key, value in self.swept.items()},
            "config_sha256": hashlib.sha256(text.encode()).hexdigest(),
        }


def as_cell(value: Any) -> Cell:
    """Return a swept value as a table has it; ranges and tables as JSON."""
    return json.dumps(value, default=str) if isinstance(value, list | dict) else value


def find_configs(patterns: Sequence[str]) -> list[str]:
    """Return the files of paths and quoted globs, in order, each once.

    Raises
    ------
    InputErrors
        A line for each path that is no file and each glob that matches none.
    """
    found: dict[str, str] = {}
    lines = []
    for pattern in patterns:
        matches = [pattern]
        if not os.path.exists(pattern) and glob.has_magic(pattern):
            matches = sorted(m for m in glob.glob(pattern, recursive=True) if os.path.isfile(m))
            if not matches:
                lines.append(f"{pattern}: no file matches{advice_for_pattern(pattern)}")
        for match in matches:
            if not match:
                lines.append("CONFIG: '' is not the name of a file")
            if os.path.isdir(match):
                what = describe(Path(match))
                lines.append(f"{match}: {what}; a quoted glob like '{match}/*.toml' is needed")
            found.setdefault(os.path.abspath(match), match)
    if lines:
        raise InputErrors(lines)
    return list(found.values())


def plan_runs(paths: Iterable[str], sets: Sequence[str] = ()) -> list[PlannedRun]:
    """Read configurations and resolve every run of them.

    Parameters
    ----------
    paths : iterable of str
    sets : sequence of str
        ``KEY=VALUE`` in every configuration; a list or range of values sweeps over them.

    Raises
    ------
    InputErrors
        With a line for everything that is wrong, whatever the number of runs it is wrong in.
    """
    lines: list[str] = []
    found: list[tuple[str, str, dict[str, Any], Runner]] = []
    for path in paths:
        try:
            data = _changed(read_toml(Path(path), path), sets)
            variants = list(expand(data, path))
        except InputError as error:
            lines.append(str(error))
            continue
        if len(found) + len(variants) > MAX_RUNS:
            raise InputError(f"{path}: more than {MAX_RUNS} runs; several batches are needed")
        wrong: Counter[str] = Counter()
        for swept, variant in variants:
            try:
                runner = resolve(variant, path)
            except InputError as error:
                wrong[str(error)] += 1
            else:
                found.append((_label(path, swept), path, swept, runner))
        several = len(variants) > 1
        lines += [f"{text} ({n} of {len(variants)} runs)" if several else text
                  for text, n in wrong.items()]  # fmt: skip
    if lines:
        raise InputErrors(lines)
    names = unique_names([label for label, *_ in found], [f"{p} {s}" for _, p, s, _ in found])
    return [
        PlannedRun(name, path, swept, runner)
        for name, (_, path, swept, runner) in zip(names, found, strict=True)
    ]


def _changed(data: dict[str, Any], sets: Sequence[str]) -> dict[str, Any]:
    """Return a configuration with the values set on the command line, lists as a sweep."""
    for key, text in read_overrides(sets).items():
        try:
            values = sweep_values(text)
        except InputError as error:
            raise InputError(f"{SET}: {key}: {error}") from None
        if values is None:
            data = overridden(data, [f"{key}={text}"])
        else:
            sweep = data.get(SWEEP, {})
            data = {**data, SWEEP: {**(sweep if isinstance(sweep, dict) else {}), key: values}}
    return data


def expand(data: dict[str, Any], where: str) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield the swept values and the configuration of every point of ``[sweep]``'s grid.

    Keys are dotted, quoted or not; the last one varies fastest. Without ``[sweep]`` the
    configuration itself is the only one.

    Raises
    ------
    InputError
    """
    rest = {key: value for key, value in data.items() if key != SWEEP}
    if SWEEP not in data:
        yield {}, rest
        return
    place = f"{where}: {SWEEP}"
    axes = dict(_axes(data[SWEEP], place))
    for key in axes:
        parts = key.split(".")
        for end in range(1, len(parts)):
            if ".".join(parts[:end]) in axes:
                raise InputError(f"{place}: {key} is part of {'.'.join(parts[:end])}: give one")
    count = math.prod(len(values) for values in axes.values())
    if count > MAX_RUNS:
        raise InputError(f"{place}: {count} runs, allowed: at most {MAX_RUNS}")
    for values in itertools.product(*axes.values()):
        swept = dict(zip(axes, values, strict=True))
        variant = copy.deepcopy(rest)
        for key, value in swept.items():
            set_key(variant, key, copy.deepcopy(value), place)
        yield swept, variant


def _axes(table: Any, place: str, prefix: str = "") -> Iterator[tuple[str, list[Any]]]:
    """Yield the dotted keys of a sweep and their values; tables within tables are paths."""
    if not isinstance(table, dict) or not table:
        raise InputError(f"{place}{_at(prefix)}: a table of KEY = [VALUE, ..] is needed")
    for name, values in table.items():
        key = f"{prefix}{name}"
        if isinstance(values, dict) and set(values) != _SPAN:
            yield from _axes(values, place, f"{key}.")
            continue
        if not all(key.split(".")) or key.split(".")[0] == SWEEP:
            raise InputError(f"{place}: {key!r} is not a key of a configuration")
        values = _listed(values, f"{place}: {key}")
        texts = Counter(_text(value) for value in values)
        for text, times in texts.items():
            if times > 1:
                raise InputError(f"{place}: {key}: {text} is given twice")
        yield key, values


def _listed(values: Any, place: str) -> list[Any]:
    """Return the values of a list, of a range ``"0.5:1:0.1"`` or of {start, stop, num}."""
    try:
        if isinstance(values, dict):
            return list(spaced_values(**values))
        span = range_values(values) if isinstance(values, str) else values
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    if not isinstance(span, list) or not span:
        raise InputError(
            f'{place}={values!r} is not allowed: a list, a range "FROM:TO:STEP" or '
            "{start, stop, num} is needed"
        )
    return span


def _at(prefix: str) -> str:
    return f".{prefix[:-1]}" if prefix else ""


def _text(value: Any) -> str:
    """Return a value as names have it."""
    if isinstance(value, list):
        return "_".join(map(_text, value))
    if isinstance(value, dict):
        return "_".join(f"{name}={_text(item)}" for name, item in value.items())
    return str(value)


def _label(path: str, swept: dict[str, Any]) -> str:
    """Return what a run is called: its file, and the swept values by the shortest clear keys."""
    last = Counter(key.rpartition(".")[2] for key in swept)
    parts = [os.path.splitext(os.path.basename(path))[0]]
    for key, value in swept.items():
        short = key.rpartition(".")[2]
        parts.append(f"{short if last[short] == 1 else key}={_text(value)}")
    return "-".join(parts)


def unique_names(labels: Sequence[str], identities: Sequence[str]) -> list[str]:
    """Return folder names for labels: safe on any file system, short, none like another.

    Where a name is too long, or two would share a folder (also where case does not count), a digest
    of the run's identity is added: a name never depends on the order of runs.

    Parameters
    ----------
    labels, identities : sequence of str
        An identity is unlike any other.
    """
    clean = [_clean(label) for label in labels]
    taken = Counter(name.casefold() for name in clean)
    names = []
    for name, who in zip(clean, identities, strict=True):
        if taken[name.casefold()] > 1 or len(name) > MAX_NAME:
            digest = hashlib.sha256(os.fsencode(who)).hexdigest()[:_DIGEST]
            name = f"{name[: MAX_NAME - _DIGEST - 1]}-{digest}"
        names.append(name)
    again = Counter(name.casefold() for name in names)
    for name, label in zip(names, labels, strict=True):
        if again[name.casefold()] > 1:
            raise InputError(f"runs {label!r}: two of the same name {name}; rename a file")
    return names


def _clean(label: str) -> str:
    name = _UNSAFE.sub("_", label).strip(".") or "run"
    return f"_{name}" if _DEVICES.match(name) else name


def parse_shard(text: str) -> tuple[int, int]:
    """Return (k, n) of ``k/n``.

    Raises
    ------
    InputError
    """
    found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
    shard = (int(found[1]), int(found[2])) if found else (0, 0)
    if not 1 <= shard[0] <= shard[1]:
        raise InputError(f"--shard: {text!r} is not allowed: K/N with 1 <= K <= N, e.g. 2/5")
    return shard


def in_shard(number: int, shard: tuple[int, int] | None) -> bool:
    """Return whether the run with this number, from 0, is in a shard: every n-th one is."""
    return shard is None or number % shard[1] == shard[0] - 1
