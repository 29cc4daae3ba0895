"""Formulas of the time: a small language of numbers, ``t``, named constants and functions.

A formula is parsed into a tree of a dozen kinds of nodes; nothing of it is ever executed as Python.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pmopt.errors import InputError, unknown_name
from pmopt.mechanisms.mechanism import Vector
from pmopt.numerics import derivatives
from pmopt.numerics.derivatives import Jet

#: Longest text and deepest nesting of a formula, largest size of an exponent.
MAX_LENGTH, MAX_DEPTH, MAX_EXPONENT = 2000, 40, 100
TIME = "t"
_CONSTANTS = {"pi": math.pi}
RESERVED = frozenset({TIME, *_CONSTANTS, *derivatives.FUNCTIONS})
#: Beyond this size a value or derivative is no motion.
_LARGEST = 1e12
_SHOWN = 120

_OPERATIONS: dict[type[ast.operator], Callable[[Jet, Jet], Jet]] = {
    ast.Add: derivatives.add,
    ast.Sub: derivatives.subtract,
    ast.Mult: derivatives.multiply,
    ast.Div: derivatives.divide,
}
_LANGUAGE = f"numbers, t, pi, constants, + - * / **, {' '.join(derivatives.FUNCTIONS)}"
#: Python reads these too; here they would hide a slip.
_NUMBER = re.compile(r"(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

Node = Callable[[Vector], Jet]


@dataclass(frozen=True)
class Formula:
    """A formula of the time.

    Attributes
    ----------
    text : str
    where : str
        What errors call it.
    """

    text: str
    where: str
    _node: Node

    def __call__(self, t: Vector) -> Jet:
        """Return the value, first and second derivative at the times.

        Parameters
        ----------
        t : (N,) float64
            s.

        Raises
        ------
        InputError
            Naming the first time at which one of them is not finite.
        """
        with np.errstate(all="ignore"):
            jet = self._node(t)
        bad = ~(np.abs(np.array(jet)) <= _LARGEST)
        if bad.any():
            place = int(np.argmax(bad.any(axis=0)))
            order = int(np.argmax(bad[:, place]))
            value = float(jet[order][place])
            shown = "not defined" if math.isnan(value) else f"{value:g}"
            raise InputError(
                f"{self.where}: {_shown(self.text)}: at t={float(t[place])!r} s "
                f"{('it', 'its rate', 'its acceleration')[order]} is {shown}: at most {_LARGEST:g} "
                "in size is allowed"
            )
        return jet


def check_constants(given: Mapping[str, float], where: str) -> None:
    """Refuse names of constants that a formula cannot use.

    Raises
    ------
    InputError
    """
    for name in given:
        if name in RESERVED:
            raise InputError(f"{where}: {name} is a name of the language: another is needed")
        if not _NAME.fullmatch(name):
            raise InputError(f"{where}: {name!r} is no name: letters, digits and _ are needed")


def parse(text: str, constants: Mapping[str, float], where: str) -> Formula:
    """Return the formula that a text describes.

    Parameters
    ----------
    text : str
        E.g. ``"0.175 + 0.025*sin(pi*t/6)"``.
    constants : mapping
        Values of further names.
    where : str
        What errors call it: file and key.

    Raises
    ------
    InputError
        One line: where, the text, the position in it and what is allowed.
    """
    if len(text) > MAX_LENGTH:
        raise InputError(
            f"{where}: {len(text)} characters are too long: at most {MAX_LENGTH} are allowed"
        )
    place = f"{where}: {_shown(text)}"
    strange = re.search(r"[^ -~\t]", text)
    if strange:
        raise InputError(
            f"{place}, position {strange.start() + 1}: {strange.group()!r} is not allowed: "
            f"{_LANGUAGE}"
        )
    source = text.strip()
    lead = len(text) - len(text.lstrip())
    if not source:
        raise InputError(f"{place} is empty: a formula is needed: {_LANGUAGE}")
    if re.search(r"[\n\r;#]", source):
        raise InputError(f"{place} is not a formula: one expression is needed: {_LANGUAGE}")
    nesting = 0
    for position, character in enumerate(text, start=1):
        nesting += (character in "([{") - (character in ")]}")
        if nesting > MAX_DEPTH:
            raise InputError(f"{place}, position {position}: nested deeper than {MAX_DEPTH}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's remarks on style; what is wrong is refused
            tree = ast.parse(source, mode="eval")
    except SyntaxError as error:
        position = lead + min(max(error.offset or 1, 1), len(source) + 1)
        raise InputError(f"{place}, position {position}: {error.msg}") from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{place} is not a formula: {error}") from None
    builder = _Builder(source, place, lead, _CONSTANTS | dict(constants))
    return Formula(text, where, builder.build(tree.body, 0))


def _shown(text: str) -> str:
    """Return a text as errors show it."""
    return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..")


class _Builder:
    """Turns the nodes that are allowed into functions on jets, and refuses the others."""

    def __init__(self, source: str, place: str, lead: int, constants: Mapping[str, float]) -> None:
        self.source, self.place, self.lead = source, place, lead
        self.constants = constants

    def build(self, node: ast.expr, depth: int) -> Node:
        # A chain of sums is as deep as it is long: the tree's depth is bound by the length.
        if depth > 2 * MAX_DEPTH:
            raise self._refused(node, f"nested deeper than {2 * MAX_DEPTH}: use brackets")
        if isinstance(node, ast.Constant):
            value = self._number(node)
            return lambda t: derivatives.constant(value, t)
        if isinstance(node, ast.Name):
            return self._named(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
            inner = self.build(node.operand, depth + 1)
            return (
                inner
                if isinstance(node.op, ast.UAdd)
                else (lambda t: derivatives.negative(inner(t)))
            )
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            return self._power(node, depth)
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
            return self._chain(node, depth)
        if isinstance(node, ast.Call):
            return self._call(node, depth)
        raise self._refused(node, f"is not allowed: {_LANGUAGE}")

    def _chain(self, node: ast.BinOp, depth: int) -> Node:
        """Build a chain of operators of one kind, a + b - c .., without recursion."""
        parts: list[tuple[Callable[[Jet, Jet], Jet], ast.expr]] = []
        left: ast.expr = node
        while isinstance(left, ast.BinOp) and type(left.op) in _OPERATIONS:
            parts.append((_OPERATIONS[type(left.op)], left.right))
            left = left.left
        first = self.build(left, depth + 1)
        rest = [(operation, self.build(part, depth + 1)) for operation, part in reversed(parts)]

        def evaluate(t: Vector) -> Jet:
            value = first(t)
            for operation, part in rest:
                value = operation(value, part(t))
            return value

        return evaluate

    def _number(self, node: ast.Constant) -> float:
        written = ast.get_source_segment(self.source, node) or ""
        if not _NUMBER.fullmatch(written):
            raise self._refused(node, f"is not allowed: {_LANGUAGE}")
        value = float(written)
        if not math.isfinite(value):
            raise self._refused(node, "is no finite number")
        return value

    def _named(self, node: ast.Name) -> Node:
        if node.id == TIME:
            return derivatives.variable
        if node.id in derivatives.FUNCTIONS:
            raise self._refused(node, f"is a function: {node.id}(..) is needed")
        if node.id not in self.constants:
            names = [TIME, *self.constants, *derivatives.FUNCTIONS]
            raise unknown_name(f"{self.place}, position {self._position(node)}", node.id, names)
        value = self.constants[node.id]
        return lambda t: derivatives.constant(value, t)

    def _call(self, node: ast.Call, depth: int) -> Node:
        if not isinstance(node.func, ast.Name):
            raise self._refused(node, f"is not allowed: {_LANGUAGE}")
        function = derivatives.FUNCTIONS.get(node.func.id)
        if function is None:
            where = f"{self.place}, position {self._position(node)}"
            raise unknown_name(where, node.func.id, derivatives.FUNCTIONS)
        if len(node.args) != 1 or node.keywords or isinstance(node.args[0], ast.Starred):
            raise self._refused(node, "takes one argument")
        inner = self.build(node.args[0], depth + 1)
        return lambda t: function(inner(t))

    def _power(self, node: ast.BinOp, depth: int) -> Node:
        base = self.build(node.left, depth + 1)
        exponent = self.build(node.right, depth + 1)
        with np.errstate(all="ignore"):
            samples = exponent(np.array([0.0, 1.0]))
        number = float(samples.value[0])
        if any(isinstance(part, ast.Name) and part.id == TIME for part in ast.walk(node.right)):
            raise self._refused(
                node.right, "is no constant: an exponent has to be; use exp(.. * log(..))"
            )
        if not abs(number) <= MAX_EXPONENT:
            raise self._refused(
                node.right, f"is {number:g}: an exponent is at most {MAX_EXPONENT} in size"
            )
        return lambda t: derivatives.power(base(t), number)

    def _position(self, node: ast.expr) -> int:
        return self.lead + node.col_offset + 1

    def _refused(self, node: ast.expr, why: str) -> InputError:
        segment = ast.get_source_segment(self.source, node) or ""
        shown = segment if len(segment) <= 40 else f"{segment[:37]}.."
        return InputError(f"{self.place}, position {self._position(node)}: {shown!r} {why}")
