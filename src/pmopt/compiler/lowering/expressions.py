"""Expressions of kernels, in the order in which Python takes them."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import numpy as np

from pmopt.compiler.lowering.operations import Operations
from pmopt.compiler.lowering.values import (
    AND,
    BYTES,
    ELEMENTS,
    REGISTERS,
    Array,
    Complex,
    Function,
    Items,
    Kind,
    Number,
    Piece,
    Static,
    Unsupported,
    assembled,
    boolean_of,
    constant_of,
    fixed_parts,
    float_of,
    integer_of,
    kind_of,
    parts,
    registers,
    result_of,
    unified,
)

_COMPARISONS = {
    ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne",
}  # fmt: skip


class Again(Exception):
    """A variable has turned out to be of a wider kind."""


#: What Python itself brings.
_BUILTINS = {"min", "max", "abs", "range", "float", "int", "bool", "complex", "len"}


class Functions(Protocol):
    """The functions of a text, and what else its names stand for."""

    scope: dict[str, Any]

    def call(self, function: Function, arguments: Sequence[Kind]) -> tuple[str, Kind]:
        """Return the name of a function for some kinds of arguments, and what it returns."""


class Expressions(Operations):
    """Expressions of one function, and its variables."""

    def __init__(self, program: Functions, name: str) -> None:
        super().__init__()
        self.program = program
        self.own_name = name
        self.kinds: dict[str, Kind] = {}  # of variables, as far as they are known
        self.places: dict[str, list[str]] = {}

    # --- variables ------------------------------------------------------------------------

    def assign(self, name: str, value: Any) -> None:
        """Give a variable a value."""
        kind = kind_of(value)
        if name not in self.kinds:
            self.kinds[name] = kind
        elif self.kinds[name] != kind:
            wider = unified(self.kinds[name], kind)
            if wider != self.kinds[name]:
                self.kinds[name] = wider
                raise Again
            value = self.cast(value, wider)
        kind = self.kinds[name]
        if name not in self.places:
            self.places[name] = [self.slot(t) for t in registers(kind)]
        self.store_parts(value, kind, self.places[name])

    def store_parts(self, value: Any, kind: Kind, places: Sequence[str]) -> None:
        """Store what a value is made of."""
        held = fixed_parts(value, kind)
        for kept, part, place in zip(registers(kind), held, places, strict=True):
            self.emit(f"store {kept} {part}, ptr {place}")

    def value_of(self, name: str) -> Any:
        """Return what a name stands for."""
        if name in self.places:
            kind = self.kinds[name]
            return self.loaded(kind, self.places[name])
        if name in self.kinds:
            raise Unsupported(f"{name} before it is assigned")
        if name in self.program.scope:
            held = self.program.scope[name]
            return held if isinstance(held, Function) else constant_of(held)
        if name in _BUILTINS:
            return Static(name)
        raise Unsupported(name)

    def loaded(self, kind: Kind, places: Sequence[str]) -> Any:
        """Return a value that is stored."""
        pairs = zip(registers(kind), places, strict=True)
        return assembled(kind, iter([self.made(f"load {t}, ptr {p}") for t, p in pairs]))

    # --- expressions ----------------------------------------------------------------------

    def expression(self, node: ast.expr) -> Any:
        """Return the value of an expression."""
        method = getattr(self, f"_{type(node).__name__}", None)
        if method is None:
            raise Unsupported(f"{type(node).__name__} in {self.own_name}")
        return method(node)

    def _Constant(self, node: ast.Constant) -> Any:
        return constant_of(node.value)

    def _Name(self, node: ast.Name) -> Any:
        return self.value_of(node.id)

    def _Tuple(self, node: ast.Tuple) -> Items:
        return Items(tuple(self.many(node.elts)))

    def many(self, nodes: Iterable[ast.expr]) -> list[Any]:
        """Return the values of expressions, of a starred one all that it holds."""
        found: list[Any] = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                held = self.expression(node.value)
                if not isinstance(held, Items):
                    raise Unsupported("a starred value that is no tuple")
                found += held.values
            else:
                found.append(self.expression(node))
        return found

    def _Attribute(self, node: ast.Attribute) -> Any:
        held = self.expression(node.value)
        if isinstance(held, Items) and held.record is not None:
            return held.values[held.record._fields.index(node.attr)]
        if isinstance(held, Array) and node.attr == "shape":
            return Items(held.shape)
        if isinstance(held, Array) and node.attr == "view":
            return Static(("view", held))
        if isinstance(held, Complex) and node.attr in ("real", "imag"):
            return getattr(held, node.attr)
        if isinstance(held, Static) and held.held in (math, np):
            found = getattr(held.held, node.attr, None)
            if isinstance(found, float | int):
                return constant_of(found)
            return Static(f"{held.held.__name__}.{node.attr}")
        raise Unsupported(f".{node.attr}")

    def _BinOp(self, node: ast.BinOp) -> Any:
        a, b = self.expression(node.left), self.expression(node.right)
        return self.arithmetic(node.op, a, b)

    def _UnaryOp(self, node: ast.UnaryOp) -> Any:
        value = self.expression(node.operand)
        if isinstance(node.op, ast.USub):
            return self.negative(value)
        if isinstance(node.op, ast.UAdd):
            return value
        if isinstance(node.op, ast.Not):
            return self.opposite(self.to_boolean(value))
        raise Unsupported("an operation on one number")

    def opposite(self, value: Number) -> Number:
        """Return what is true where a value is not."""
        if value.known is not None:
            return boolean_of(not value.known)
        return Number("bool", self.made(f"xor i1 {value.text}, true"))

    def _Compare(self, node: ast.Compare) -> Number:
        left = self.expression(node.left)
        found = None
        for operation, other in zip(node.ops, node.comparators, strict=True):
            right = self.expression(other)
            if isinstance(operation, ast.In | ast.NotIn):
                one = boolean_of(False)
                if not isinstance(right, Items):
                    raise Unsupported("in")
                for value in right.values:
                    one = self.both("or", one, self.compared("eq", left, value))
                one = one if isinstance(operation, ast.In) else self.opposite(one)
            elif type(operation) in _COMPARISONS:
                one = self.compared(_COMPARISONS[type(operation)], left, right)
            else:
                raise Unsupported("is")
            found = one if found is None else self.both("and", found, one)
            left = right
        assert found is not None
        return found

    def both(self, word: str, a: Number, b: Number) -> Number:
        """Return both, or one, of two values that are true or not."""
        for one, other in ((a, b), (b, a)):
            if one.known is not None:
                return other if one.known == (word == "and") else one
        return Number("bool", self.made(f"{word} i1 {a.text}, {b.text}"))

    def _BoolOp(self, node: ast.BoolOp) -> Number:
        word = "and" if isinstance(node.op, ast.And) else "or"
        found = self.truth(node.values[0])
        for other in node.values[1:]:
            if found.known is not None:
                if found.known != (word == "and"):
                    return found
                found = self.truth(other)
            elif is_light(other):
                found = self.both(word, found, self.truth(other))
            else:
                place, on, after = self.slot("i1"), self.label(), self.label()
                self.emit(f"store i1 {found.text}, ptr {place}")
                yes, no = (on, after) if word == "and" else (after, on)
                self.emit(f"br i1 {found.text}, label %{yes}, label %{no}")
                self.ended = True
                self.begin(on)
                self.emit(f"store i1 {self.truth(other).text}, ptr {place}")
                self.begin(after)
                found = Number("bool", self.made(f"load i1, ptr {place}"))
        return found

    def truth(self, node: ast.expr) -> Number:
        """Return whether an expression is true."""
        return self.to_boolean(self.expression(node))

    def _IfExp(self, node: ast.IfExp) -> Any:
        condition = self.truth(node.test)
        if condition.known is not None:
            return self.expression(node.body if condition.known else node.orelse)
        if is_light(node.body) and is_light(node.orelse):
            return self.chosen(condition, self.expression(node.body), self.expression(node.orelse))
        yes, no, after = self.label(), self.label(), self.label()
        self.emit(f"br i1 {condition.text}, label %{yes}, label %{no}")
        self.ended = True
        whole, written = self.lines, []
        for label, part in ((yes, node.body), (no, node.orelse)):
            self.lines = []
            self.begin(label)
            value = self.expression(part)
            written.append((self.lines, value))
            self.ended = True
        kind = unified(*(kind_of(value) for _, value in written))
        places = [self.slot(t) for t in registers(kind)]
        self.lines = whole
        for lines, value in written:
            self.lines += lines
            self.ended = False
            self.store_parts(self.cast(value, kind), kind, places)
            self.go(after)
        self.begin(after)
        return self.loaded(kind, places)

    def _Subscript(self, node: ast.Subscript) -> Any:
        held = self.expression(node.value)
        if isinstance(held, Items):
            return self.item(held, node.slice)
        if not isinstance(held, Array):
            raise Unsupported("an index of what is no array")
        found = self.element(held, node.slice)
        return found if found.shape else self.load(found)

    def item(self, held: Items, at: ast.expr) -> Any:
        """Return an item of a tuple, or some."""
        if isinstance(at, ast.Slice):
            ends = [None if e is None else self.expression(e).known
                    for e in (at.lower, at.upper, at.step)]  # fmt: skip
            if any(e is not None and x is None for e, x in
                   zip((at.lower, at.upper, at.step), ends, strict=True)):  # fmt: skip
                raise Unsupported("a part of a tuple")
            return Items(held.values[slice(*ends)])
        index = self.number(self.expression(at))
        if index.known is not None:
            return held.values[index.known]
        if may_be_negative(at):
            index = self.wrapped(index, integer_of(len(held.values)))
        kind = kind_of(held.values[0])
        for value in held.values:
            kind = unified(kind, kind_of(value))
        held_parts = [fixed_parts(self.cast(value, kind), kind) for value in held.values]
        texts = []
        for number, stored in enumerate(registers(kind)):
            place = self.slot(f"[{len(held_parts)} x {stored}]")
            for k, texts_of in enumerate(held_parts):
                at_k = self.made(f"getelementptr inbounds {stored}, ptr {place}, i64 {k}")
                self.emit(f"store {stored} {texts_of[number]}, ptr {at_k}")
            found = self.made(f"getelementptr inbounds {stored}, ptr {place}, i64 {index.text}")
            texts.append(self.made(f"load {stored}, ptr {found}"))
        return assembled(kind, iter(texts))

    def element(self, array: Array, at: ast.expr) -> Array:
        """Return the part of an array at an index: an element is one without lengths."""
        given = at.elts if isinstance(at, ast.Tuple) else [at]
        shape = array.shape
        if len(given) > len(shape):
            raise Unsupported("too many indices")
        offset: Number = integer_of(0)
        rest = shape[len(given) :]
        add, mul = ast.Add(), ast.Mult()
        for k, one in enumerate(given):
            if isinstance(one, ast.Slice):
                if k > 0 or len(given) > 1 or one.step is not None:
                    raise Unsupported("a part of an array")
                low = (
                    integer_of(0) if one.lower is None else self.number(self.expression(one.lower))
                )
                high = shape[0] if one.upper is None else self.number(self.expression(one.upper))
                rest = (self.arithmetic(ast.Sub(), high, low), *shape[1:])
                index = low
            else:
                index = self.to_integer(self.expression(one))
                if index.known is not None and index.known < 0:
                    index = self.arithmetic(add, shape[k], index)
                elif may_be_negative(one):
                    index = self.wrapped(index, shape[k])
            offset = index if k == 0 else self.arithmetic(
                add, self.arithmetic(mul, offset, shape[k]), index
            )  # fmt: skip
        for length in shape[len(given) :]:
            offset = self.arithmetic(mul, offset, length)
        kept = ELEMENTS[array.element][0]
        if offset.known == 0:
            return Array(array.pointer, array.element, rest)
        pointer = self.made(
            f"getelementptr inbounds {kept}, ptr {array.pointer}, i64 {offset.text}"
        )
        return Array(pointer, array.element, rest)

    def wrapped(self, index: Number, length: Number) -> Number:
        """Return an index that counts from the end where it is negative."""
        less = self.compared("lt", index, integer_of(0))
        if less.known is not None:
            return index
        found: Number = self.chosen(less, self.arithmetic(ast.Add(), index, length), index)
        return found

    def load(self, at: Array) -> Number:
        """Return an element of an array."""
        kept, kind = ELEMENTS[at.element]
        text = self.made(f"load {kept}, ptr {at.pointer}, align {BYTES[at.element]}")
        if at.element == "uint8":
            text = self.made(f"zext i8 {text} to i64")
        elif at.element == "int32":
            text = self.made(f"sext i32 {text} to i64")
        return Number(kind, text)

    def store(self, at: Array, value: Any) -> None:
        """Store an element of an array."""
        kept, kind = ELEMENTS[at.element]
        value = self.number(value)
        if kind == "float64":
            text = self.to_float(value).text
        else:
            text = self.to_integer(value, kind).text
            if kept != "i64":
                text = self.made(f"trunc i64 {text} to {kept}")
        self.emit(f"store {kept} {text}, ptr {at.pointer}, align {BYTES[at.element]}")

    # --- calls ----------------------------------------------------------------------------

    def _Call(self, node: ast.Call) -> Any:
        called = self.expression(node.func)
        given = self.many(node.args)
        named = {k.arg: self.expression(k.value) for k in node.keywords if k.arg is not None}
        if len(named) != len(node.keywords):
            raise Unsupported("two stars")
        if isinstance(called, Function):
            return self.called(called, given, named)
        if isinstance(called, Piece) and not named:
            return self.elsewhere(called, given)
        held = called.held if isinstance(called, Static) else None
        if isinstance(held, type) and hasattr(held, "_fields"):
            fields = held._fields[len(given) :]
            if set(fields) != set(named):
                raise Unsupported(f"{held.__name__} with other fields")
            return Items((*given, *(named[f] for f in fields)), held)
        if named:
            raise Unsupported("named arguments")
        if isinstance(held, tuple) and held[0] == "view":
            (kind,) = given
            element = str(kind.held).removeprefix("numpy.")
            if BYTES.get(element) != BYTES[held[1].element]:
                raise Unsupported("a view of another size")
            return held[1]._replace(element=element)
        return self.known_function(held, given)

    def called(self, function: Function, given: list[Any], named: dict[str, Any]) -> Any:
        """Call a function of the text."""
        names = [a.arg for a in function.node.args.args]
        given = given + [named.pop(n) for n in names[len(given) :] if n in named]
        if named:
            raise Unsupported("unknown arguments")
        kinds = [kind_of(v) for v in given]
        name, kind = self.program.call(function, kinds)
        passed = ", ".join(
            f"{t} {p}" for v, k in zip(given, kinds, strict=True)
            for t, p in zip(registers(k), parts(v), strict=True)
        )  # fmt: skip
        stated = result_of(kind)
        if stated == "void":
            self.emit(f"call void @{name}({passed})")
            return assembled(kind, iter(()))
        found = self.made(f"call {stated} @{name}({passed})")
        kept = registers(kind)
        if len(kept) == 1:
            return assembled(kind, iter([found]))
        texts = [self.made(f"extractvalue {stated} {found}, {k}") for k in range(len(kept))]
        return assembled(kind, iter(texts))

    def elsewhere(self, piece: Piece, given: list[Any]) -> Static:
        """Call the entry of another text: of arrays it takes all lengths."""
        passed: list[str] = []
        for value, argument in zip(given, piece.arguments.split(AND), strict=True):
            kind, _, axes = argument.partition("[")
            if axes:
                if not isinstance(value, Array) or value.element != kind:
                    raise Unsupported(f"{kind_of(value)} as {argument}")
                if len(value.shape) != len(axes.split(",")):
                    raise Unsupported(f"{kind_of(value)} as {argument}")
                passed += [f"ptr {value.pointer}", *(f"i64 {n.text}" for n in value.shape)]
            else:
                passed.append(f"{REGISTERS[kind]} {self.cast(value, kind).text}")
        self.emit(f"call void {piece.pointer}({', '.join(passed)})")
        return Static(None)

    def known_function(self, name: Any, given: list[Any]) -> Any:
        """Return what a function of Python, ``math`` or NumPy gives."""
        if name in ("min", "max") and len(given) > 1:
            found = given[0]
            for value in given[1:]:
                a, b = self.alike(value, found)
                condition = self.compared("lt" if name == "min" else "gt", a, b)
                if condition.known is not None:
                    found = a if condition.known else b
                else:
                    found = self.chosen(condition, a, b)
            return found
        if name == "complex":
            real, imag = given if len(given) == 2 else (*given, float_of(0.0))
            return Complex(self.to_float(real), self.to_float(imag))
        if name == "math.copysign":
            a, b = map(self.to_float, given)
            call = f"{self.intrinsic('copysign', 2)}(double {a.text}, double {b.text})"
            return Number("float64", self.made(f"call double {call}"))
        if len(given) != 1:
            raise Unsupported(str(name))
        (value,) = given
        if name in ("float", "numpy.float64"):
            return self.to_float(value)
        if name in ("int", "numpy.int64"):
            return self.to_integer(value)
        if name == "numpy.uint64":
            return self.to_integer(value, "uint64")
        if name == "bool":
            return self.to_boolean(value)
        if name == "len" and isinstance(value, Items | Array):
            return integer_of(len(value.values)) if isinstance(value, Items) else value.shape[0]
        if name == "abs" and self.number(value).kind == "int64":
            less = self.compared("lt", value, integer_of(0))
            if less.known is not None:
                return integer_of(abs(value.known))
            return self.chosen(less, self.negative(value), value)
        words = {"math.sqrt": "sqrt", "math.floor": "floor", "numpy.floor": "floor",
                 "numpy.sqrt": "sqrt", "abs": "fabs", "math.fabs": "fabs"}  # fmt: skip
        if name not in words:
            raise Unsupported(str(name))
        text = f"call double {self.intrinsic(words[name])}(double {self.to_float(value).text})"
        found = Number("float64", self.made(text))
        return self.to_integer(found) if name == "math.floor" else found


def may_be_negative(index: ast.expr) -> bool:
    """Return whether an index that is not known has a difference or a sign in it.

    What is but a name counts from the beginning: loops do.
    """
    return any(isinstance(node, ast.Sub | ast.USub) for node in ast.walk(index))


#: What can be computed whether it is wanted or not.
_LIGHT = (
    ast.Name, ast.Constant, ast.UnaryOp, ast.Compare, ast.BinOp, ast.IfExp, ast.BoolOp, ast.Tuple,
    ast.Attribute, ast.operator, ast.unaryop, ast.cmpop, ast.boolop, ast.expr_context,
)  # fmt: skip
_MOST_LIGHT = 12


def is_light(node: ast.expr) -> bool:
    """Return whether an expression may be computed before it is known to be wanted.

    It then neither reads arrays nor calls functions, and takes a few operations.
    """
    nodes = list(ast.walk(node))
    if len(nodes) > 4 * _MOST_LIGHT or not all(isinstance(n, _LIGHT) for n in nodes):
        return False
    heavy = (ast.Div, ast.FloorDiv, ast.Mod)
    return sum(isinstance(n, ast.BinOp) for n in nodes) <= 2 and not any(
        isinstance(n, heavy) for n in nodes
    )
