"""The text of the kernel functions of a structure, and its vectors evaluated one by one."""

from __future__ import annotations

import functools
import itertools
import keyword
import linecache
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast, get_type_hints

from pmopt.compiler.records import is_record
from pmopt.errors import InputError, unknown_name
from pmopt.kernels.vectors import Rotation, Vec3, cross, direction, minus, normal
from pmopt.mechanisms.serial_chains import Along, Normal, Way

#: Sine of an angle between vectors up to which a layout takes them as parallel: what rounding
#: leaves of a configuration computed to be so.
PARALLEL = 1e-9
#: What generated text calls ours.
_OURS: dict[str, Callable[..., Any]] = {
    "Vec3": Vec3, "cross": cross, "direction": direction, "minus": minus, "normal": normal,
}  # fmt: skip
_WORDS: dict[type[Any], str] = {Vec3: "point or vector", Rotation: "rotation"}
#: Texts made so far, which files of a debugger or a traceback are distinguished by.
_COUNT = itertools.count(1)
#: Names that the text uses itself.
_RESERVED = ("at", "cones", "moved", "constants", "skeleton", "posture")
_LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Evaluated:
    """A kernel function and the record, a NamedTuple, that it returns."""

    function: Callable[..., Any]
    record: type[Any]


def value_of(way: Way, named: Callable[[str], Any]) -> Any:
    """Return a vector of a configuration, as the kernel functions compute it."""
    match way:
        case str():
            return named(way)
        case Vec3():
            return way
        case Along():
            return _OURS["direction"](value_of((way.start, way.end), named))
        case Normal():
            first, second = value_of(way.first, named), value_of(way.second, named)
            if way.otherwise is not None:
                across, one, two = (
                    _OURS["direction"](v).length
                    for v in (_OURS["cross"](first, second), first, second)
                )
                if across <= PARALLEL * one * two:
                    return way.otherwise
            return _OURS["normal"](first, second)
    start, end = way
    return _OURS["minus"](named(end), named(start))


class Text:
    """The text of a kernel function of a structure.

    Parameters
    ----------
    points : Evaluated
        Called first, with the pose and the constants.
    pose : sequence of str
        Names of the pose coordinates.
    """

    def __init__(self, points: Evaluated, pose: Sequence[str]) -> None:
        self.space: dict[str, Any] = {**_OURS, "__name__": points.function.__module__}
        self.pose = [
            f"{name}_" if name in _RESERVED or keyword.iskeyword(name) else name for name in pose
        ]
        self.lines: list[str] = []
        self.records: dict[str, type[Any]] = {}
        self.ways: dict[Way, str] = {}
        self.call("at", points, *self.pose)

    def call(self, local: str, evaluated: Evaluated, *arguments: str) -> None:
        """Add a line that calls a kernel function."""
        self.records[local] = evaluated.record
        function = evaluated.function
        name = function.__name__
        while name in {*_RESERVED, *self.pose} or self.space.setdefault(name, function) != function:
            name += "_"
        self.lines.append(f"{local} = {name}({', '.join((*arguments, 'constants'))})")

    def place(self, name: str, wanted: type[Any] = Vec3) -> str:
        """Return how a name is read, after a check that it exists and is of that kind."""
        first = name.partition(".")[0]
        local = next((k for k, r in self.records.items() if first in _fields(r)), "at")
        found: Any = self.records[local]
        for part in name.split("."):
            fields = _fields(found) if is_record(found) else {}
            if part not in fields:
                known = [n for record in self.records.values() for n in _names(record, wanted)]
                raise unknown_name(f"structure: {_WORDS[wanted]}", name, known)
            found = fields[part]
        if not _holds(found, wanted):
            raise InputError(f"structure: {name!r} is no {_WORDS[wanted]}")
        return f"{local}.{name}"

    def point(self, name: str) -> list[str]:
        """Return a named point's numbers."""
        return _xyz(self.place(name))

    def platform(self, place: str, rotation: str | None) -> list[list[str]]:
        """Return the platform's place and rotation; None where it never turns."""
        if rotation is None:
            return [self.point(place), [repr(value) for value in _LEVEL]]
        read = self.place(rotation, Rotation)
        return [self.point(place), [f"{read}.{entry}" for entry in Rotation._fields]]

    def number(self, local: str, name: str) -> str:
        """Return a number of a record that a call has returned."""
        fields = _fields(self.records[local])
        if name not in fields:
            raise unknown_name("structure: position", name, fields)
        return f"{local}.{name}"

    def vector(self, way: Way) -> list[str]:
        """Return a vector's numbers; each is computed once."""
        if isinstance(way, Vec3):
            return [repr(float(value)) for value in way]
        return _xyz(self.place(way) if isinstance(way, str) else self.local(way))

    def local(self, way: Way) -> str:
        """Return the name of a vector that is computed."""
        if way not in self.ways:
            made = self.made(way)
            self.ways[way] = f"way{len(self.ways) + 1}"
            self.lines.append(f"{self.ways[way]} = {made}")
        return self.ways[way]

    def made(self, way: Way) -> str:
        """Return the text of a vector."""
        match way:
            case str():
                return self.place(way)
            case Vec3():
                return f"Vec3({', '.join(repr(float(value)) for value in way)})"
            case Along():
                return f"direction({self.made((way.start, way.end))})"
            case Normal():
                inner = (
                    self.local(w) if isinstance(w, Along | Normal) else self.made(w)
                    for w in (way.first, way.second)
                )  # fmt: skip
                return f"normal({', '.join(inner)})"
        start, end = way
        return f"minus({self.place(end)}, {self.place(start)})"

    def function(
        self, name: str, numbers: Sequence[Sequence[str]]
    ) -> Callable[..., tuple[float, ...]]:
        """Return the function that returns the numbers, its text kept where Python looks for it."""
        arguments = ", ".join((*self.pose, "constants"))
        body = [f"    {line}\n" for line in self.lines]
        body.append("    return (\n")
        body += [f"        {', '.join(group)},\n" for group in numbers if group]
        lines = [f"def {name}({arguments}):\n", *body, "    )\n"]
        used = {k: v for k, v in self.space.items() if k in "".join(lines) or k == "__name__"}
        file = f"<{name} of {used['__name__']}, {next(_COUNT)}>"
        exec(compile("".join(lines), file, "exec"), used)
        linecache.cache[file] = (sum(map(len, lines)), None, lines, file)
        made: Callable[..., tuple[float, ...]] = used[name]
        return made


def _xyz(name: str) -> list[str]:
    return [f"{name}.x", f"{name}.y", f"{name}.z"]


def _fields(record: type[Any]) -> dict[str, Any]:
    """Return what the fields of a record hold."""
    return _hints(cast(Any, record))


@functools.cache
def _hints(record: Any) -> dict[str, Any]:
    return get_type_hints(record)


def _holds(kind: Any, wanted: type[Any]) -> bool:
    """Return whether a record has the fields of another."""
    return is_record(kind) and {*wanted._fields} <= {*kind._fields}


def _names(record: type[Any], wanted: type[Any]) -> Iterator[str]:
    """Yield what a record calls points, vectors or rotations; dotted in records that it holds."""
    for name, kind in _fields(record).items():
        if _holds(kind, wanted):
            yield name
        elif is_record(kind):
            yield from (f"{name}.{inner}" for inner in _names(kind, wanted))
