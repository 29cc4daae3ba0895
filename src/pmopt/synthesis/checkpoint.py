"""What a run has evaluated, on disk after every generation: plain numbers, checked on loading.

Telling NSGA-II the recorded results again restores a run exactly (:mod:`pmopt.synthesis.optimise`),
so that the evaluations are the whole checkpoint: those of each generation, and of the designs
measured again after it where there were any. Each generation is one file, written whole: a line of
JSON, then its table as little-endian doubles.
"""

from __future__ import annotations

import hashlib
import json
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from pmopt.errors import InputError
from pmopt.files import remove_leftovers, write_atomic
from pmopt.synthesis.config import ADAPTIVE, RunConfig, differences
from pmopt.synthesis.optimise import Record
from pmopt.synthesis.problem import DesignProblem, Evaluations

SCHEMA = 2
FOLDER = "checkpoint"
#: Keys that may change when a run is taken up again: more generations continue it.
_GENERATIONS = ("algorithm", "generations")


def plain(config: RunConfig) -> dict[str, Any]:
    """Return the configuration as JSON has it."""
    document: dict[str, Any] = json.loads(config.model_dump_json())
    if config.adaptive:
        document["workspace"]["samples"] = ADAPTIVE
    return document


class Checkpoint:
    """The checkpoint folder of a run.

    Parameters
    ----------
    folder : Path
        The run's folder.
    problem : DesignProblem
    version : str
        Of pmopt: another version may compute other digits.
    """

    def __init__(self, folder: Path, problem: DesignProblem, version: str) -> None:
        self.folder = folder / FOLDER
        self.problem = problem
        self.version = version
        config = plain(problem.config)
        config["algorithm"].pop(_GENERATIONS[1])
        self._key = hashlib.sha256(
            json.dumps([SCHEMA, version, config], sort_keys=True).encode()
        ).hexdigest()
        self.resumes: list[int] = []
        self._writer = ThreadPoolExecutor(1)
        self._writing: Future[None] | None = None

    @staticmethod
    def exists(folder: Path) -> bool:
        """Return whether a run was begun in this folder."""
        return (folder / FOLDER / "run.json").exists()

    @staticmethod
    def configuration(folder: Path) -> dict[str, Any] | None:
        """Return the configuration of the run that was begun in this folder, None without one."""
        try:
            run = json.loads((folder / FOLDER / "run.json").read_text(encoding="utf-8"))
            return dict(run["config"])
        except (OSError, ValueError, KeyError, TypeError):
            return None

    @staticmethod
    def generations(folder: Path) -> int:
        """Return how many generations this folder has on disk."""
        return sum(1 for _ in (folder / FOLDER).glob("generation-*.bin"))

    def start(self) -> None:
        """Begin a new run, forgetting any earlier one."""
        for path in self._files():
            path.unlink()
        self._write_run()

    def resume(self) -> list[Record]:
        """Return the recorded generations, as far as their files are whole.

        Raises
        ------
        InputError
            When the folder's run had another configuration; the differences are named.
        """
        path = self.folder / "run.json"
        try:
            run = json.loads(path.read_text(encoding="utf-8"))
            schema, version, config = run["schema"], run["version"], run["config"]
            self.resumes = [int(g) for g in run["resumes"]]
            generations = int(config["algorithm"]["generations"])
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{path}: is no checkpoint of pmopt; --force starts afresh") from None
        if (schema, version) != (SCHEMA, self.version):
            raise InputError(
                f"{path}: was written by pmopt {version} (schema {schema}), this is "
                f"{self.version} (schema {SCHEMA}); --force starts afresh"
            )
        changed = differences(config, plain(self.problem.config))
        key = ".".join(_GENERATIONS)
        if self.problem.config.algorithm.generations >= generations:
            changed = [line for line in changed if not line.startswith(f"{key}:")]
        if changed:
            raise InputError(
                f"{self.folder.parent}: --resume with a changed configuration: {'; '.join(changed)}"
            )
        recorded = []
        for number, path in enumerate(self._files(), start=1):
            part = self._read(path, number)
            if part is None:
                break
            recorded.append(part)
        self.resumes.append(len(recorded))
        self._write_run()
        return recorded

    def save(self, number: int, record: Record) -> None:
        """Record one generation, while the next one is computed: a disk takes its time."""
        parts = [record.evaluated] if record.again is None else [record.evaluated, record.again]
        table = np.ascontiguousarray(Evaluations.join(parts).table(), dtype="<f8")
        raw = table.tobytes()
        header = {
            "key": self._key,
            "generation": number,
            "shape": table.shape,
            "designs": len(record.evaluated),
            "sha256": hashlib.sha256(raw).hexdigest(),
        }
        data = json.dumps(header).encode() + b"\n" + raw
        self.flush()
        self._writing = self._writer.submit(write_atomic, self._path(number), data)

    def flush(self) -> None:
        """Wait for what is being written."""
        if self._writing is not None:
            self._writing.result()

    def _read(self, path: Path, number: int) -> Record | None:
        """Return one generation, None where the file is torn or another run's."""
        try:
            line, raw = path.read_bytes().split(b"\n", 1)
            header = json.loads(line)
            rows, columns = header["shape"]
            designs = int(header["designs"])
            stated = (header["key"], header["generation"], header["sha256"])
            if stated != (self._key, number, hashlib.sha256(raw).hexdigest()):
                return None
            table = np.frombuffer(raw, dtype="<f8").reshape(rows, columns).astype(float)
            ends = np.cumsum(
                [len(self.problem.variables), *[len(self.problem.objectives)] * 2]
            ).tolist()
            evaluated, again = (
                Evaluations(*np.split(part, ends, axis=1)) for part in np.split(table, [designs])
            )
            return Record(evaluated, again if len(again) else None)
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def _write_run(self) -> None:
        remove_leftovers(self.folder)
        document = {
            "schema": SCHEMA,
            "version": self.version,
            "config": plain(self.problem.config),
            "resumes": self.resumes,
        }
        write_atomic(self.folder / "run.json", json.dumps(document, indent=1))

    def _path(self, number: int) -> Path:
        return self.folder / f"generation-{number:07d}.bin"

    def _files(self) -> list[Path]:
        return sorted(self.folder.glob("generation-*.bin"))
