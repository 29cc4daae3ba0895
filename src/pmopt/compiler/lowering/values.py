"""Values while a kernel text is walked: numbers in registers, tuples, arrays; and their kinds."""

from __future__ import annotations

import ast
import struct
from typing import Any, NamedTuple

import numpy as np

#: What LLVM calls the kinds of numbers, in registers.
REGISTERS = {"float64": "double", "int64": "i64", "uint64": "i64", "bool": "i1"}
#: What it calls the elements of arrays, and what they are once loaded.
ELEMENTS = {
    "float64": ("double", "float64"), "int64": ("i64", "int64"), "uint64": ("i64", "uint64"),
    "uint8": ("i8", "int64"), "int32": ("i32", "int64"),
}  # fmt: skip
BYTES = {"float64": 8, "int64": 8, "uint64": 8, "uint8": 1, "int32": 4}
#: Begins the type of an argument that is the address of an entry; its own types follow, and what
#: stands between them.
PIECE, AND = "*", "|"


class Unsupported(Exception):
    """A text has what is not understood here: it is numba's."""


class Number(NamedTuple):
    """A number in a register, or one that is known."""

    kind: str
    text: str
    known: Any = None


class Complex(NamedTuple):
    """A complex number."""

    real: Number
    imag: Number


class Items(NamedTuple):
    """A tuple, of a record where it has one's names."""

    values: tuple[Any, ...]
    record: Any = None


class Array(NamedTuple):
    """A C-contiguous array: where it begins, its elements and its lengths."""

    pointer: str
    element: str
    shape: tuple[Number, ...]


class Piece(NamedTuple):
    """The address of an entry of another text, and the arguments that it takes."""

    pointer: str
    arguments: str


class Static(NamedTuple):
    """What is no number: a function, a module, a class, nothing."""

    held: Any


class Function(NamedTuple):
    """A function of the text, and whether it is compiled into its callers."""

    node: ast.FunctionDef
    inlined: bool


#: Kinds of values, hashable: the name of a number's, or a tuple that begins with a word.
Kind = Any


def float_of(value: float) -> Number:
    """Return a float that is known."""
    bits = struct.unpack("<Q", struct.pack("<d", value))[0]
    return Number("float64", f"0x{bits:016X}", value)


def integer_of(value: int) -> Number:
    """Return an integer that is known; one of 64 bits is without sign."""
    if not -(1 << 63) <= value < 1 << 64:
        raise Unsupported("a long integer")
    if value >= 1 << 63:
        return Number("uint64", str(value - (1 << 64)), value)
    return Number("int64", str(value), value)


def boolean_of(value: bool) -> Number:
    """Return what is known to be true or not."""
    return Number("bool", "true" if value else "false", value)


def constant_of(value: Any) -> Any:
    """Return a value of Python as one of a text."""
    if isinstance(value, bool | np.bool_):
        return boolean_of(bool(value))
    if isinstance(value, int):
        return integer_of(value)
    if isinstance(value, float):
        return float_of(float(value))
    if isinstance(value, complex):
        return Complex(float_of(value.real), float_of(value.imag))
    if isinstance(value, tuple):
        record = type(value) if hasattr(value, "_fields") else None
        return Items(tuple(constant_of(v) for v in value), record)
    return Static(value)


def kind_of(value: Any) -> Kind:
    """Return the kind of a value."""
    if isinstance(value, Number):
        return value.kind
    if isinstance(value, Complex):
        return ("complex",)
    if isinstance(value, Items):
        return ("items", value.record, tuple(kind_of(v) for v in value.values))
    if isinstance(value, Array):
        return ("array", value.element, tuple(n.known for n in value.shape))
    if isinstance(value, Piece):
        return ("piece", value.arguments)
    return ("static", value.held)


def unified(a: Kind, b: Kind) -> Kind:
    """Return the narrowest kind that holds both."""
    if a == b:
        return a
    if isinstance(a, str) and isinstance(b, str):
        both = {a, b}
        if both <= {"bool", "int64", "float64"}:
            return "float64" if "float64" in both else "int64"
    elif isinstance(a, tuple) and isinstance(b, tuple) and a[0] == b[0]:
        if a[0] == "items" and a[1] is b[1] and len(a[2]) == len(b[2]):
            return ("items", a[1], tuple(map(unified, a[2], b[2])))
        if a[0] == "array" and a[1] == b[1] and len(a[2]) == len(b[2]):
            lengths = (m if m == n else None for m, n in zip(a[2], b[2], strict=True))
            return ("array", a[1], tuple(lengths))
    elif ("complex",) in (a, b) and (a if isinstance(a, str) else b) in REGISTERS:
        return ("complex",)
    raise Unsupported(f"{a} or {b}")


def registers(kind: Kind) -> list[str]:
    """Return LLVM's types of what a value of a kind is made of."""
    if isinstance(kind, str):
        return [REGISTERS[kind]]
    if kind[0] == "complex":
        return ["double", "double"]
    if kind[0] == "items":
        return [t for k in kind[2] for t in registers(k)]
    if kind[0] == "array":
        return ["ptr", *("i64" for n in kind[2] if n is None)]
    return ["ptr"] if kind[0] == "piece" else []


def parts(value: Any) -> list[str]:
    """Return what a value is made of, in the order of :func:`registers`."""
    if isinstance(value, Number):
        return [value.text]
    if isinstance(value, Complex):
        return [value.real.text, value.imag.text]
    if isinstance(value, Items):
        return [t for v in value.values for t in parts(v)]
    if isinstance(value, Array):
        return [value.pointer, *(n.text for n in value.shape if n.known is None)]
    return [value.pointer] if isinstance(value, Piece) else []


def assembled(kind: Kind, texts: Any) -> Any:
    """Return the value of a kind that is made of these, an iterator."""
    if isinstance(kind, str):
        return Number(kind, next(texts))
    if kind[0] == "complex":
        return Complex(Number("float64", next(texts)), Number("float64", next(texts)))
    if kind[0] == "items":
        return Items(tuple(assembled(k, texts) for k in kind[2]), kind[1])
    if kind[0] == "array":
        pointer = next(texts)
        shape = (Number("int64", next(texts)) if n is None else integer_of(n) for n in kind[2])
        return Array(pointer, kind[1], tuple(shape))
    return Piece(next(texts), kind[1]) if kind[0] == "piece" else Static(kind[1])


def result_of(kind: Kind) -> str:
    """Return LLVM's type of what a function returns."""
    kept = registers(kind)
    if not kept:
        return "void"
    return kept[0] if len(kept) == 1 else f"{{ {', '.join(kept)} }}"


def fixed_parts(value: Any, kind: Kind) -> list[str]:
    """Return what a value is made of as one of a kind that may have given up known lengths."""
    if isinstance(value, Array):
        pairs = zip(value.shape, kind[2], strict=True)
        return [value.pointer, *(n.text for n, fixed in pairs if fixed is None)]
    if isinstance(value, Items):
        pairs = zip(value.values, kind[2], strict=True)
        return [text for held, k in pairs for text in fixed_parts(held, k)]
    return parts(value)
