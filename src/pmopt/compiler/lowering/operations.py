"""Single operations, written in LLVM's words: conversions, arithmetic, comparisons."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable
from typing import Any

from pmopt.compiler.lowering.values import (
    REGISTERS,
    Array,
    Complex,
    Items,
    Kind,
    Number,
    Piece,
    Unsupported,
    assembled,
    boolean_of,
    fixed_parts,
    float_of,
    integer_of,
    kind_of,
    registers,
    unified,
)

_FOLDED: dict[str, Callable[[Any, Any], Any]] = {
    "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge,
    "eq": operator.eq, "ne": operator.ne,
}  # fmt: skip
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.LShift: operator.lshift,
    ast.RShift: operator.rshift, ast.BitAnd: operator.and_, ast.BitOr: operator.or_,
    ast.BitXor: operator.xor,
}  # fmt: skip


class Operations:
    """A text of operations within one function, and what writes them.

    ``ended`` says that the last operation has left the block that is written.
    """

    def __init__(self) -> None:
        self.intrinsics: set[str] = set()
        self.clear()

    def clear(self) -> None:
        """Begin the text of the function anew."""
        self.lines: list[str] = []
        self.slots: list[str] = []
        self.count = 0
        self.ended = False

    def emit(self, text: str) -> None:
        """Write an operation."""
        self.lines.append("  " + text)

    def fresh(self, word: str = "t") -> str:
        """Return a new name."""
        self.count += 1
        return f"%{word}{self.count}"

    def made(self, text: str) -> str:
        """Write an operation; return the name of what it gives."""
        name = self.fresh()
        self.lines.append(f"  {name} = {text}")
        return name

    def label(self) -> str:
        """Return the name of a new block of operations."""
        self.count += 1
        return f"L{self.count}"

    def begin(self, label: str) -> None:
        """Begin a block of operations; what was written so far has gone elsewhere."""
        if not self.ended:
            self.emit(f"br label %{label}")
        self.lines.append(f"{label}:")
        self.ended = False

    def go(self, label: str) -> None:
        """End a block of operations; another follows it."""
        if not self.ended:
            self.emit(f"br label %{label}")
            self.ended = True

    def slot(self, kind: str) -> str:
        """Return a new place for a number, as LLVM calls it."""
        self.count += 1
        name = f"%v{self.count}"
        self.slots.append(f"  {name} = alloca {kind}")
        return name

    def intrinsic(self, name: str, arguments: int = 1) -> str:
        """Return the name of a function of LLVM's own."""
        given = ", ".join(["double"] * arguments)
        self.intrinsics.add(f"declare double @llvm.{name}.f64({given})")
        return f"@llvm.{name}.f64"

    # --- conversions ----------------------------------------------------------------------

    def cast(self, value: Any, kind: Kind) -> Any:
        """Return a value as one of another kind."""
        if kind_of(value) == kind:
            return value
        if isinstance(value, Number) and kind == ("complex",):
            return Complex(self.to_float(value), float_of(0.0))
        if isinstance(value, Number) and isinstance(kind, str):
            if kind == "float64":
                return self.to_float(value)
            if kind == "int64" and value.kind == "bool":
                return self.to_integer(value)
        elif isinstance(value, Items) and kind[0] == "items":
            held = (self.cast(v, k) for v, k in zip(value.values, kind[2], strict=True))
            return Items(tuple(held), kind[1])
        elif isinstance(value, Array) and kind[0] == "array":
            return value
        raise Unsupported(f"{kind_of(value)} as {kind}")

    def number(self, value: Any) -> Number:
        """Return a value that has to be a number."""
        if not isinstance(value, Number):
            raise Unsupported(f"{kind_of(value)} as a number")
        return value

    def to_float(self, given: Any) -> Number:
        """Return a number as a float."""
        value = self.number(given)
        if value.kind == "float64":
            return value
        if value.known is not None:
            return float_of(float(value.known))
        word = "sitofp" if value.kind == "int64" else "uitofp"
        text = self.made(f"{word} {REGISTERS[value.kind]} {value.text} to double")
        return Number("float64", text)

    def to_integer(self, given: Any, kind: str = "int64") -> Number:
        """Return a number as an integer, cut off."""
        value = self.number(given)
        if value.known is not None:
            known = int(value.known)
            if kind == "int64":
                return integer_of(known)
            known &= (1 << 64) - 1
            signed = known - (1 << 64) if known >= 1 << 63 else known
            return Number("uint64", str(signed), known)
        if value.kind == "bool":
            return Number(kind, self.made(f"zext i1 {value.text} to i64"))
        if value.kind == "float64":
            if kind != "int64":
                raise Unsupported("a float as an integer without sign")
            return Number(kind, self.made(f"fptosi double {value.text} to i64"))
        return Number(kind, value.text)

    def to_boolean(self, given: Any) -> Number:
        """Return whether a number is not 0, or a piece is there."""
        if isinstance(given, Piece):
            return Number("bool", self.made(f"icmp ne ptr {given.pointer}, null"))
        value = self.number(given)
        if value.kind == "bool":
            return value
        if value.known is not None:
            return boolean_of(bool(value.known))
        if value.kind == "float64":
            zero = float_of(0.0).text
            return Number("bool", self.made(f"fcmp une double {value.text}, {zero}"))
        return Number("bool", self.made(f"icmp ne i64 {value.text}, 0"))

    # --- arithmetic -----------------------------------------------------------------------

    def alike(self, a: Any, b: Any) -> tuple[Number, Number]:
        """Return two numbers as ones of the same kind."""
        a, b = self.number(a), self.number(b)
        if a.kind == "bool":
            a = self.to_integer(a)
        if b.kind == "bool":
            b = self.to_integer(b)
        if "float64" in (a.kind, b.kind):
            return self.to_float(a), self.to_float(b)
        if a.kind != b.kind:
            raise Unsupported("integers with and without sign")
        return a, b

    def arithmetic(self, operation: ast.operator, a: Any, b: Any) -> Any:
        """Return what an operation makes of two values."""
        if isinstance(a, Complex) or isinstance(b, Complex):
            return self.complex_arithmetic(operation, a, b)
        if isinstance(a, Items) and isinstance(b, Items) and isinstance(operation, ast.Add):
            return Items(a.values + b.values)
        if isinstance(operation, ast.Div):
            a, b = self.to_float(a), self.to_float(b)
            return Number("float64", self.made(f"fdiv double {a.text}, {b.text}"))
        a, b = self.alike(a, b)
        word = type(operation).__name__
        if a.kind == "float64":
            words = {"Add": "fadd", "Sub": "fsub", "Mult": "fmul"}
            if word not in words:
                raise Unsupported(f"{word} of floats")
            return Number("float64", self.made(f"{words[word]} double {a.text}, {b.text}"))
        known = a.known is not None and b.known is not None and type(operation) in _ARITHMETIC
        if known and not (word in ("FloorDiv", "Mod") and b.known == 0):
            return self.to_integer(
                _known(a.kind, _ARITHMETIC[type(operation)](a.known, b.known)), a.kind
            )
        signed = a.kind == "int64"
        if word in ("FloorDiv", "Mod"):
            return self.divided(word, a, b)
        plain = {"Add": "add", "Sub": "sub", "Mult": "mul", "BitAnd": "and", "BitOr": "or",
                 "BitXor": "xor", "LShift": "shl",
                 "RShift": "ashr" if signed else "lshr"}  # fmt: skip
        if word not in plain:
            raise Unsupported(word)
        exact = " nsw" if signed and word in ("Add", "Sub", "Mult") else ""
        return Number(a.kind, self.made(f"{plain[word]}{exact} i64 {a.text}, {b.text}"))

    def divided(self, word: str, a: Number, b: Number) -> Number:
        """Return quotient or remainder as Python rounds; 0 where the divisor is."""
        if a.kind != "int64":
            raise Unsupported("division of integers without sign")
        divisor = b.text
        if not b.known:
            none = self.made(f"icmp eq i64 {b.text}, 0")
            divisor = self.made(f"select i1 {none}, i64 1, i64 {b.text}")
        rest = self.made(f"srem i64 {a.text}, {divisor}")
        mixed = self.made(f"xor i64 {rest}, {divisor}")
        other = self.made(f"icmp slt i64 {mixed}, 0")
        left = self.made(f"icmp ne i64 {rest}, 0")
        off = self.made(f"and i1 {other}, {left}")
        if word == "Mod":
            moved = self.made(f"add i64 {rest}, {divisor}")
            return Number("int64", self.made(f"select i1 {off}, i64 {moved}, i64 {rest}"))
        quotient = self.made(f"sdiv i64 {a.text}, {divisor}")
        less = self.made(f"add i64 {quotient}, -1")
        return Number("int64", self.made(f"select i1 {off}, i64 {less}, i64 {quotient}"))

    def complex_arithmetic(self, operation: ast.operator, a: Any, b: Any) -> Complex:
        """Return what an operation makes of complex numbers."""
        real_divisor = isinstance(b, Number)
        x, y = self.cast(a, ("complex",)), self.cast(b, ("complex",))

        def of(kind: ast.operator, u: Number, v: Number) -> Number:
            found: Number = self.arithmetic(kind, u, v)
            return found

        add, sub, mul, div = ast.Add(), ast.Sub(), ast.Mult(), ast.Div()
        if isinstance(operation, ast.Add | ast.Sub):
            return Complex(of(operation, x.real, y.real), of(operation, x.imag, y.imag))
        if isinstance(operation, ast.Mult):
            return Complex(
                of(sub, of(mul, x.real, y.real), of(mul, x.imag, y.imag)),
                of(add, of(mul, x.real, y.imag), of(mul, x.imag, y.real)),
            )
        if isinstance(operation, ast.Div) and real_divisor:
            ratio = of(div, y.imag, y.real)
            whole = of(add, y.real, of(mul, y.imag, ratio))
            return Complex(
                of(div, of(add, x.real, of(mul, x.imag, ratio)), whole),
                of(div, of(sub, x.imag, of(mul, x.real, ratio)), whole),
            )
        raise Unsupported("complex numbers")

    def negative(self, value: Any) -> Any:
        """Return a number with the other sign."""
        if isinstance(value, Complex):
            return Complex(self.negative(value.real), self.negative(value.imag))
        value = self.number(value)
        if value.kind == "float64":
            if value.known is not None:
                return float_of(-value.known)
            return Number("float64", self.made(f"fneg double {value.text}"))
        if value.kind == "uint64":
            raise Unsupported("a negative integer without sign")
        return self.arithmetic(ast.Sub(), integer_of(0), value)

    def compared(self, word: str, a: Any, b: Any) -> Number:
        """Return whether two numbers compare so."""
        a, b = self.alike(a, b)
        if a.known is not None and b.known is not None:
            return boolean_of(_FOLDED[word](a.known, b.known))
        if a.kind == "float64":
            order = "une" if word == "ne" else f"o{word}"
            return Number("bool", self.made(f"fcmp {order} double {a.text}, {b.text}"))
        sign = "" if word in ("eq", "ne") else ("s" if a.kind == "int64" else "u")
        return Number("bool", self.made(f"icmp {sign}{word} i64 {a.text}, {b.text}"))

    def chosen(self, condition: Number, a: Any, b: Any) -> Any:
        """Return one of two values that both are known."""
        kind = unified(kind_of(a), kind_of(b))
        a, b = self.cast(a, kind), self.cast(b, kind)
        pairs = zip(registers(kind), fixed_parts(a, kind), fixed_parts(b, kind),
                    strict=True)  # fmt: skip
        texts = [
            self.made(f"select i1 {condition.text}, {t} {p}, {t} {q}") if p != q else p
            for t, p, q in pairs
        ]
        return assembled(kind, iter(texts))


def _known(kind: str, value: int) -> Number:
    return Number(kind, "", value)
