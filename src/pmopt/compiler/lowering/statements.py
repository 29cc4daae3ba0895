"""Statements of kernels, function by function, and the whole of a text."""

from __future__ import annotations

import ast
import collections
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from pmopt.compiler.lowering.expressions import Again, Expressions
from pmopt.compiler.lowering.values import (
    ELEMENTS,
    PIECE,
    REGISTERS,
    Array,
    Function,
    Items,
    Kind,
    Number,
    Piece,
    Static,
    Unsupported,
    assembled,
    integer_of,
    kind_of,
    parts,
    registers,
    result_of,
    unified,
)

_MODULES = {"math": math, "np": np, "numpy": np}
#: Passes over a function until the kinds of its variables are settled.
_MOST_PASSES = 40
#: Of a tuple that is gone through.
_MOST_ITEMS = 16


class Program:
    """The functions of a text, each written for the kinds of arguments that it is called with."""

    def __init__(self, text: str) -> None:
        self.scope: dict[str, Any] = {}
        self.written: dict[Any, tuple[str, Kind]] = {}
        self.functions: list[str] = []
        self.intrinsics: set[str] = set()
        self.open: list[Any] = []
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef):
                decorators = " ".join(ast.unparse(d) for d in node.decorator_list)
                inlined = "forceinline=True" in decorators or "inline='always'" in decorators
                self.scope[node.name] = Function(node, inlined)
            elif isinstance(node, ast.Import | ast.ImportFrom):
                self._import(node)
            else:
                code = compile(ast.Module([node], []), "kernels", "exec")
                exec(code, self.scope)

    def _import(self, node: ast.Import | ast.ImportFrom) -> None:
        for alias in node.names:
            name = alias.asname or alias.name
            if isinstance(node, ast.Import) and alias.name in _MODULES:
                self.scope[name] = _MODULES[alias.name]
            elif isinstance(node, ast.ImportFrom) and node.module == "collections":
                self.scope[name] = getattr(collections, alias.name)
            elif not ast.unparse(node).startswith(("import numba", "from numba import ")):
                raise Unsupported(ast.unparse(node))

    def call(self, function: Function, arguments: Sequence[Kind]) -> tuple[str, Kind]:
        """Return the name of a function for some kinds of arguments, and what it returns."""
        key = function.node.name, tuple(arguments)
        if key not in self.written:
            if key in self.open:
                raise Unsupported("recursion")
            self.open.append(key)
            name = f"f{len(self.open)}_{len(self.written)}_{function.node.name}"
            self.written[key] = name, Writer(self, function, name, arguments).write()
            self.open.pop()
        return self.written[key]

    def entry(self, name: str, arguments: Sequence[str], symbol: str) -> str:
        """Return the text of a module with an entry that takes pointers, lengths and numbers."""
        declared: list[str] = []
        given: list[Any] = []
        for k, argument in enumerate(arguments):
            if argument.startswith(PIECE):
                declared.append(f"ptr %a{k}")
                given.append(Piece(f"%a{k}", argument.removeprefix(PIECE)))
                continue
            kind, _, axes = argument.partition("[")
            if not axes:
                declared.append(f"{REGISTERS[kind]} %a{k}")
                given.append(Number(kind, f"%a{k}"))
                continue
            lengths = axes.rstrip("]").split(",")
            declared += [f"ptr %a{k}", *(f"i64 %n{k}_{a}" for a in range(len(lengths)))]
            shape = (
                Number("int64", f"%n{k}_{a}") if n == ":" else integer_of(int(n))
                for a, n in enumerate(lengths)
            )
            given.append(Array(f"%a{k}", kind, tuple(shape)))
        called, _ = self.call(self.scope[name], [kind_of(v) for v in given])
        passed = ", ".join(
            f"{t} {p}" for v in given for t, p in zip(registers(kind_of(v)), parts(v), strict=True)
        )
        main = (
            f"define void @{symbol}({', '.join(declared)}) nounwind {{\n"
            f"  call void @{called}({passed})\n  ret void\n}}\n"
        )
        return "\n".join([*sorted(self.intrinsics), *self.functions, main])


class Writer(Expressions):
    """Writes one function for one list of kinds of arguments."""

    program: Program

    def __init__(
        self, program: Program, function: Function, name: str, arguments: Sequence[Kind]
    ) -> None:
        super().__init__(program, function.node.name)
        self.function = function
        self.name = name
        self.arguments = arguments
        self.returned: Kind = None
        self.loops: list[tuple[str, str]] = []

    def write(self) -> Kind:
        """Write the function; return the kind of what it returns."""
        for _ in range(_MOST_PASSES):
            self.clear()
            self.places = {}
            self.loops = []
            try:
                self._whole()
            except Again:
                continue
            self.program.intrinsics |= self.intrinsics
            return self.returned
        raise Unsupported("kinds that do not settle")

    def _whole(self) -> None:
        node = self.function.node
        names = [a.arg for a in node.args.args]
        if node.args.vararg or node.args.kwarg or node.args.kwonlyargs or node.args.posonlyargs:
            raise Unsupported("arguments that are not plain")
        if len(names) != len(self.arguments):
            raise Unsupported("arguments that are left out")
        declared = []
        for name, kind in zip(names, self.arguments, strict=True):
            given = [f"%{name}.{k}" for k in range(len(registers(kind)))]
            declared += [f"{t} {g}" for t, g in zip(registers(kind), given, strict=True)]
            self.assign(name, assembled(kind, iter(given)))
        self.block(node.body)
        if not self.ended:
            self.finish(Static(None))
        kind = self.returned
        inline = " alwaysinline" if self.function.inlined else ""
        self.program.functions.append(
            f"define internal {result_of(kind)} @{self.name}({', '.join(declared)})"
            f" nounwind{inline} {{\n" + "\n".join([*self.slots, *self.lines]) + "\n}\n"
        )

    # --- statements -----------------------------------------------------------------------

    def block(self, body: Iterable[ast.stmt]) -> None:
        """Write statements up to one that leaves them."""
        for node in body:
            if self.ended:
                return
            method = getattr(self, f"_do_{type(node).__name__}", None)
            if method is None:
                raise Unsupported(type(node).__name__)
            method(node)

    def _do_Pass(self, node: ast.Pass) -> None:
        pass

    def _do_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.expression(node.value)

    def _do_Raise(self, node: ast.Raise) -> None:
        self.emit("unreachable")
        self.ended = True

    def _do_Return(self, node: ast.Return) -> None:
        self.finish(Static(None) if node.value is None else self.expression(node.value))

    def finish(self, value: Any) -> None:
        """Return a value."""
        kind = kind_of(value)
        if isinstance(value, Array) or (kind[0] == "static" and kind[1] is not None):
            raise Unsupported("what is returned")
        if self.returned is None:
            self.returned = kind
        elif self.returned != kind:
            wider = unified(self.returned, kind)
            if wider != self.returned:
                self.returned = wider
                raise Again
            value, kind = self.cast(value, wider), wider
        kept, held = registers(kind), parts(value)
        if not kept:
            self.emit("ret void")
        elif len(kept) == 1:
            self.emit(f"ret {kept[0]} {held[0]}")
        else:
            stated, whole = result_of(kind), "undef"
            for k, (t, p) in enumerate(zip(kept, held, strict=True)):
                whole = self.made(f"insertvalue {stated} {whole}, {t} {p}, {k}")
            self.emit(f"ret {stated} {whole}")
        self.ended = True

    def _do_Assign(self, node: ast.Assign) -> None:
        value = self.expression(node.value)
        for target in node.targets:
            self.target(target, value)

    def _do_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.target(node.target, self.expression(node.value))

    def target(self, node: ast.expr, value: Any) -> None:
        """Assign a value."""
        if isinstance(node, ast.Name):
            self.assign(node.id, value)
        elif isinstance(node, ast.Tuple):
            if not isinstance(value, Items) or len(value.values) != len(node.elts):
                raise Unsupported("what is taken apart")
            for one, part in zip(node.elts, value.values, strict=True):
                self.target(one, part)
        elif isinstance(node, ast.Subscript):
            held = self.expression(node.value)
            if not isinstance(held, Array):
                raise Unsupported("an index of what is no array")
            place = self.element(held, node.slice)
            if not place.shape:
                self.store(place, value)
            elif len(place.shape) == 1 and isinstance(value, Number):
                self.repeat(
                    integer_of(0), place.shape[0], 1,
                    lambda i: self.store(self.at(place, i), value),
                )  # fmt: skip
            else:
                raise Unsupported("an assignment to a part of an array")
        else:
            raise Unsupported("a target")

    def at(self, row: Array, index: Number) -> Array:
        """Return an element of a row."""
        kept = ELEMENTS[row.element][0]
        text = f"getelementptr inbounds {kept}, ptr {row.pointer}, i64 {index.text}"
        return Array(self.made(text), row.element, ())

    def _do_AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Name):
            before = self.value_of(node.target.id)
            self.assign(
                node.target.id, self.arithmetic(node.op, before, self.expression(node.value))
            )
        elif isinstance(node.target, ast.Subscript):
            held = self.expression(node.target.value)
            if not isinstance(held, Array):
                raise Unsupported("an index of what is no array")
            place = self.element(held, node.target.slice)
            if place.shape:
                raise Unsupported("a change of a part of an array")
            before = self.load(place)
            self.store(place, self.arithmetic(node.op, before, self.expression(node.value)))
        else:
            raise Unsupported("a target")

    def _do_If(self, node: ast.If) -> None:
        condition = self.truth(node.test)
        if condition.known is not None:
            self.block(node.body if condition.known else node.orelse)
            return
        yes, after = self.label(), self.label()
        no = self.label() if node.orelse else after
        self.emit(f"br i1 {condition.text}, label %{yes}, label %{no}")
        self.ended = True
        self.begin(yes)
        self.block(node.body)
        goes_on = not self.ended
        self.go(after)
        if node.orelse:
            self.begin(no)
            self.block(node.orelse)
            goes_on = goes_on or not self.ended
            self.go(after)
        else:
            goes_on = True
        if goes_on:
            self.begin(after)

    def _do_While(self, node: ast.While) -> None:
        if node.orelse:
            raise Unsupported("else of a loop")
        head, body, after = self.label(), self.label(), self.label()
        self.begin(head)
        condition = self.truth(node.test)
        self.emit(f"br i1 {condition.text}, label %{body}, label %{after}")
        self.ended = True
        self.begin(body)
        self.loops.append((head, after))
        self.block(node.body)
        self.loops.pop()
        self.go(head)
        self.begin(after)

    def _do_For(self, node: ast.For) -> None:
        call = node.iter
        if node.orelse:
            raise Unsupported("else of a loop")
        if not isinstance(call, ast.Call):
            self.one_by_one(node)
            return
        if not isinstance(node.target, ast.Name):
            raise Unsupported("a loop over what is no range")
        if self.expression(call.func) != Static("range") or call.keywords:
            raise Unsupported("a loop over what is no range")
        given = [self.to_integer(self.expression(a)) for a in call.args]
        low, high = (integer_of(0), given[0]) if len(given) == 1 else given[:2]
        step = given[2].known if len(given) == 3 else 1
        if not step:
            raise Unsupported("a step that is not known")
        name = node.target.id

        def body(index: Number) -> None:
            self.assign(name, index)
            self.block(node.body)

        self.repeat(low, high, step, body)

    def one_by_one(self, node: ast.For) -> None:
        """Write a loop over a tuple, once for each item."""
        held = self.expression(node.iter)
        if not isinstance(held, Items) or len(held.values) > _MOST_ITEMS:
            raise Unsupported("a loop over what is no range")
        after = self.label()
        for value in held.values:
            on = self.label()
            self.target(node.target, value)
            self.loops.append((on, after))
            self.block(node.body)
            self.loops.pop()
            self.begin(on)
        self.begin(after)

    def repeat(self, low: Number, high: Number, step: int, body: Callable[[Number], None]) -> None:
        """Write a loop over a range."""
        place = self.slot("i64")
        head, within, on, after = (self.label() for _ in range(4))
        self.emit(f"store i64 {low.text}, ptr {place}")
        self.begin(head)
        index = self.made(f"load i64, ptr {place}")
        word = "slt" if step > 0 else "sgt"
        more = self.made(f"icmp {word} i64 {index}, {high.text}")
        self.emit(f"br i1 {more}, label %{within}, label %{after}")
        self.ended = True
        self.begin(within)
        self.loops.append((on, after))
        body(Number("int64", index))
        self.loops.pop()
        self.begin(on)
        following = self.made(f"add nsw i64 {index}, {step}")
        self.emit(f"store i64 {following}, ptr {place}")
        self.go(head)
        self.begin(after)

    def _do_Continue(self, node: ast.Continue) -> None:
        self.go(self.loops[-1][0])

    def _do_Break(self, node: ast.Break) -> None:
        self.go(self.loops[-1][1])
