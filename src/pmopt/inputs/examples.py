"""The shipped example configurations: those of ``configs/``, which lie in the wheel too.

An example is a TOML file and what lies beside it under its name: the files that it refers to.
"""

from __future__ import annotations

import shlex
import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pmopt.errors import unknown_name

#: Name of the folder, in the package of a wheel and in a checkout.
FOLDER = "configs"


@dataclass(frozen=True)
class Example:
    """One example.

    Attributes
    ----------
    name : str
        Its path within the folder, without suffix.
    kind : str
        ``pareto``, ``motion`` or ``batch``: the command that reads it.
    mechanism : str
    about : str
        First sentence of its comment.
    path : Path
    beside : tuple of Path
        The other files that belong to it.
    """

    name: str
    kind: str
    mechanism: str
    about: str
    path: Path
    beside: tuple[Path, ...]


def folder() -> Path:
    """Return the folder of the examples: in the package, or in the checkout it is run from."""
    package = Path(__file__).resolve().parents[1]
    packed = package / FOLDER
    return packed if packed.is_dir() else package.parents[1] / FOLDER


@cache
def examples() -> tuple[Example, ...]:
    """Return all examples, searches first."""
    root = folder()
    paths = sorted(root.rglob("*.toml"), key=lambda p: (p.parent != root, str(p)))
    return tuple(_example(path, root) for path in paths)


def _example(path: Path, root: Path) -> Example:
    text = path.read_text(encoding="utf-8")
    place = path.relative_to(root)
    return Example(
        place.with_suffix("").as_posix(),
        place.parts[0] if len(place.parts) > 1 else "pareto",
        _mechanism(text),
        _about(text),
        path,
        tuple(p for p in sorted(path.parent.glob(f"{path.stem}.*")) if p != path),
    )


def _mechanism(text: str) -> str:
    """Return the kind of a configuration; None for one that is being edited in a checkout."""
    try:
        return str(tomllib.loads(text).get("mechanism", ""))
    except tomllib.TOMLDecodeError:
        return ""


def _about(text: str) -> str:
    """Return the first sentence of the comment that a file begins with."""
    lines = text.splitlines()
    end = next((k for k, line in enumerate(lines) if not line.startswith("#")), len(lines))
    words = " ".join(line.lstrip("# ") for line in lines[:end])
    return f"{words.partition('. ')[0].rstrip('.')}."


def find_example(name: str) -> Example:
    """Return an example by its name, or by the last part of it.

    Raises
    ------
    InputError
        For an unknown name; the nearest valid one is given.
    """
    found = _named(name)
    if found is None:
        raise unknown_name("--example", name, [example.name for example in examples()])
    return found


def _named(name: str) -> Example | None:
    """Return the example that a name or a path stands for, or to which that file belongs."""
    parts = Path(name.strip().casefold()).parts
    parts = parts[parts.index(FOLDER) + 1 :] if FOLDER in parts else parts
    asked = "/".join(parts)
    for example in examples():
        suffixes = ("", *(path.suffix for path in (example.path, *example.beside)))
        for known in (f"{example.name}{suffix}".casefold() for suffix in suffixes):
            if asked == known or (len(parts) == 1 and asked == known.rpartition("/")[2]):
                return example
    return None


def advice(path: Path) -> str:
    """Return the command that writes a missing file of an example; else nothing."""
    found = _named(str(path))
    if found is None:
        return ""
    wanted = path.with_suffix(found.path.suffix)
    out = "" if str(wanted) == found.path.name else f" --out {shlex.quote(str(wanted))}"
    return f"; pmopt init --example {found.name}{out} writes {'it' if path.suffix else wanted}"


def advice_for_pattern(pattern: str) -> str:
    """Return the command that lists the examples, where a pattern without a match means some."""
    known = (Path(FOLDER, f"{example.name}.toml") for example in examples())
    if FOLDER in Path(pattern).parts and any(path.match(pattern) for path in known):
        return "; pmopt init --list names the configurations that pmopt brings"
    return ""
