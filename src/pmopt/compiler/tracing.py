"""Expression graphs of kernel functions, and the tapes they are evaluated from.

A kernel is plain Python on floats. :func:`trace` runs a copy of its source on expressions instead
of numbers: what is proven is about the very kernel that is sampled. In the copy a conditional
expression that selects the lesser or greater of two values becomes a call; other conditions are
refused.
"""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmopt.compiler import records
from pmopt.kernels.trigonometry import sin_cos

#: Operations of a tape. INPUT and CONSTANT take the number of an input or constant.
INPUT, CONSTANT, LITERAL, ADD, SUB, SCALE, MUL, SQUARE, SQRT, INVERSE, SINE, COSINE, POSITIVE = (
    range(13)
)


class Untraceable(Exception):
    """A kernel does what an expression cannot follow."""


class Expression:
    """A node of the graph; equal nodes are one object within a :class:`Graph`."""

    __slots__ = ("first", "graph", "index", "operation", "second", "value")

    def __init__(self, graph: Graph, index: int, key: tuple[int, int, int, float]) -> None:
        self.graph = graph
        self.index = index
        self.operation, self.first, self.second, self.value = key

    def __add__(self, other: Any) -> Expression:
        return self.graph.add(self, self.graph.lift(other))

    def __radd__(self, other: Any) -> Expression:
        return self.graph.add(self.graph.lift(other), self)

    def __sub__(self, other: Any) -> Expression:
        return self.graph.sub(self, self.graph.lift(other))

    def __rsub__(self, other: Any) -> Expression:
        return self.graph.sub(self.graph.lift(other), self)

    def __mul__(self, other: Any) -> Expression:
        return self.graph.mul(self, self.graph.lift(other))

    def __rmul__(self, other: Any) -> Expression:
        return self.graph.mul(self, self.graph.lift(other))

    def __truediv__(self, other: Any) -> Expression:
        return self.graph.mul(self, self.graph.inverse(self.graph.lift(other)))

    def __rtruediv__(self, other: Any) -> Expression:
        return self.graph.mul(self.graph.lift(other), self.graph.inverse(self))

    def __neg__(self) -> Expression:
        return self.graph.scale(self, -1.0)

    def __abs__(self) -> Expression:
        return self.graph.scale(self.graph.positive(self), 2.0) - self

    def __pow__(self, power: int) -> Expression:
        if power != 2:
            raise Untraceable(f"power {power}")
        return self.graph.mul(self, self)

    def __bool__(self) -> bool:
        raise Untraceable("a condition on an expression")


class Graph:
    """Expressions of inputs and constants, each once."""

    def __init__(self) -> None:
        self.nodes: list[Expression] = []
        self._known: dict[tuple[int, int, int, float], Expression] = {}
        #: Minima that were taken, by node: what a margin is the least of.
        self._minima: dict[int, tuple[Expression, Expression]] = {}

    def _node(
        self, operation: int, first: int = -1, second: int = -1, value: float = 0.0
    ) -> Expression:
        key = (operation, first, second, value)
        if key not in self._known:
            self._known[key] = Expression(self, len(self.nodes), key)
            self.nodes.append(self._known[key])
        return self._known[key]

    def input(self, number: int) -> Expression:
        """Return an input."""
        return self._node(INPUT, number)

    def constant(self, number: int) -> Expression:
        """Return a constant."""
        return self._node(CONSTANT, number)

    def lift(self, value: Any) -> Expression:
        """Return an expression of a number; expressions are returned as they are."""
        if isinstance(value, Expression):
            return value
        return self._node(LITERAL, value=float(value))

    def _literal(self, node: Expression) -> float | None:
        return node.value if node.operation == LITERAL else None

    def add(self, a: Expression, b: Expression) -> Expression:
        """Return a + b."""
        if self._literal(a) == 0.0:
            return b
        if self._literal(b) == 0.0:
            return a
        return self._node(ADD, *sorted((a.index, b.index)))

    def sub(self, a: Expression, b: Expression) -> Expression:
        """Return a - b."""
        if self._literal(b) == 0.0:
            return a
        if self._literal(a) == 0.0:
            return self.scale(b, -1.0)
        if a is b:
            return self.lift(0.0)
        return self._node(SUB, a.index, b.index)

    def scale(self, a: Expression, factor: float) -> Expression:
        """Return a times a number."""
        if factor == 0.0:
            return self.lift(0.0)
        if factor == 1.0:
            return a
        return self._node(SCALE, a.index, value=factor)

    def mul(self, a: Expression, b: Expression) -> Expression:
        """Return a b."""
        if a is b:
            return self._node(SQUARE, a.index)
        for one, other in ((a, b), (b, a)):
            if one.operation == LITERAL:
                return self.scale(other, one.value)
        return self._node(MUL, *sorted((a.index, b.index)))

    def sqrt(self, a: Expression) -> Expression:
        """Return the root of a's positive part."""
        return self._node(SQRT, a.index)

    def inverse(self, a: Expression) -> Expression:
        """Return 1 / a."""
        return self._node(INVERSE, a.index)

    def sin_cos(self, a: Expression) -> tuple[Expression, Expression]:
        """Return sine and cosine."""
        return self._node(SINE, a.index), self._node(COSINE, a.index)

    def positive(self, a: Expression) -> Expression:
        """Return max(a, 0)."""
        return self._node(POSITIVE, a.index)

    def least(self, a: Any, b: Any) -> Expression:
        """Return the lesser of two; :meth:`parts` tells of what."""
        a, b = self.lift(a), self.lift(b)
        found = self.sub(a, self.positive(self.sub(a, b)))
        self._minima[found.index] = (a, b)
        return found

    def greatest(self, a: Any, b: Any) -> Expression:
        """Return the greater of two."""
        a, b = self.lift(a), self.lift(b)
        return self.add(b, self.positive(self.sub(a, b)))

    def parts(self, a: Expression) -> tuple[list[Expression], set[int]]:
        """Return the expressions that a minimum was taken of, in order of their making.

        Numbers >= 0 are left out. A minimum times a constant is that of its parts where the
        constant is > 0: the numbers of such constants come with them.
        """
        found: dict[int, Expression] = {}
        factors: set[int] = set()

        def collect(node: Expression) -> None:
            for part in self._minima.get(node.index, ()):
                collect(part)
            if node.index in self._minima:
                return
            if node.operation == MUL:
                one, other = self.nodes[node.first], self.nodes[node.second]
                for factor, inner in ((one, other), (other, one)):
                    if factor.operation == CONSTANT and inner.index in self._minima:
                        factors.add(factor.first)
                        collect(inner)
                        return
            if not (node.operation == LITERAL and node.value >= 0.0):
                found.setdefault(node.index, node)

        collect(a)
        return [found[i] for i in sorted(found)], factors

    def inputs_of(self, a: Expression) -> set[int]:
        """Return the numbers of the inputs that an expression depends on."""
        steps = self.tape([a]).steps
        return set(steps[steps[:, 0] == INPUT, 1].tolist())

    def even(self, found: Sequence[Expression], by: Expression) -> bool:
        """Return whether expressions are the same for an input and its negative, by their form."""
        parity: dict[int, int] = {}
        for i in range(max((a.index for a in found), default=-1) + 1):
            node = self.nodes[i]
            inner = node.operation > LITERAL
            x = parity[node.first] if inner else 1
            y = parity[node.second] if inner and node.second >= 0 else x
            if not inner:
                sign = -1 if node is by else 1
            elif node.operation in (ADD, SUB):
                sign = x if x == y else 0
            elif node.operation == MUL:
                sign = x * y
            elif node.operation in (SQUARE, COSINE):
                sign = abs(x)
            elif node.operation in (SCALE, INVERSE, SINE):
                sign = x
            else:  # SQRT, POSITIVE
                sign = max(x, 0)
            parity[i] = sign
        return all(parity[a.index] == 1 for a in found)

    def derivative(self, a: Expression, by: Expression) -> Expression:
        """Return the partial derivative of an expression without minima by an input."""
        rates: dict[int, Expression] = {}
        zero, one = self.lift(0.0), self.lift(1.0)
        for i in range(a.index + 1):
            node = self.nodes[i]
            x = self.nodes[node.first] if node.operation > LITERAL else None
            dx = rates[x.index] if x is not None else zero
            rate = zero
            if node is by:
                rate = one
            elif x is None:
                rate = zero
            elif node.operation in (ADD, SUB):
                sign = 1.0 if node.operation == ADD else -1.0
                rate = dx + self.scale(rates[node.second], sign)
            elif node.operation == SCALE:
                rate = self.scale(dx, node.value)
            elif node.operation == MUL:
                y = self.nodes[node.second]
                rate = dx * y + rates[y.index] * x
            elif dx is zero:
                rate = zero
            elif node.operation == SQUARE:
                rate = self.scale(dx * x, 2.0)
            elif node.operation == SQRT:
                rate = self.scale(dx * self.inverse(node), 0.5)
            elif node.operation == INVERSE:
                rate = -(dx * (node * node))
            elif node.operation == SINE:
                rate = dx * self._node(COSINE, x.index)
            elif node.operation == COSINE:
                rate = -(dx * self._node(SINE, x.index))
            else:
                raise Untraceable("a minimum has no derivative")
            rates[i] = rate
        return rates[a.index]

    def tape(self, results: Sequence[Expression]) -> Tape:
        """Return what evaluates the results and no more."""
        needed: set[int] = set()
        stack = [r.index for r in results]
        while stack:
            i = stack.pop()
            if i in needed:
                continue
            needed.add(i)
            node = self.nodes[i]
            if node.operation > LITERAL:
                stack += [k for k in (node.first, node.second) if k >= 0]
        order = sorted(needed)
        place = {i: k for k, i in enumerate(order)}
        steps = np.zeros((len(order), 3), dtype=np.int64)
        values = np.zeros(len(order))
        for k, i in enumerate(order):
            node = self.nodes[i]
            inner = node.operation > LITERAL
            first = place[node.first] if inner else max(node.first, 0)
            second = place[node.second] if inner and node.second >= 0 else -1
            steps[k] = node.operation, first, second
            values[k] = node.value
        return Tape(steps, values, np.array([place[r.index] for r in results], dtype=np.int64))


class Tape(NamedTuple):
    """Operations in order.

    Attributes
    ----------
    steps : (n, 3) int64
        Operation and the places of its arguments, -1 for none.
    values : (n,) float64
        Of literals, and the factors of SCALE.
    results : (m,) int64
        Places of the results.
    """

    steps: NDArray[np.int64]
    values: NDArray[np.float64]
    results: NDArray[np.int64]


class _Selections(ast.NodeTransformer):
    """Turns ``a if a < b else b`` and the like into calls."""

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        test = node.test
        if not (isinstance(test, ast.Compare) and len(test.ops) == 1):
            raise Untraceable("a condition that is no comparison")
        less = isinstance(test.ops[0], ast.Lt | ast.LtE)
        if not (less or isinstance(test.ops[0], ast.Gt | ast.GtE)):
            raise Untraceable("a condition that is no comparison by size")
        left, right = test.left, test.comparators[0]
        sides = [ast.dump(n) for n in (left, right)]
        given = [ast.dump(n) for n in (node.body, node.orelse)]
        if given == sides:
            name = "least" if less else "greatest"
        elif given == sides[::-1]:
            name = "greatest" if less else "least"
        else:
            raise Untraceable("a selection that is neither the lesser nor the greater")
        call = ast.Call(ast.Name(f"__{name}", ast.Load()), [left, right], [])
        return ast.copy_location(call, node)


class _Math:
    """Stands for the module ``math`` in a traced function."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph

    def sqrt(self, value: Any) -> Any:
        return self.graph.sqrt(value) if isinstance(value, Expression) else math.sqrt(value)


def traced(function: Callable[..., Any], graph: Graph) -> Callable[..., Any]:
    """Return a copy of a kernel function that takes and returns expressions."""
    copies: dict[Callable[..., Any], Callable[..., Any]] = {}

    def copy(original: Callable[..., Any]) -> Callable[..., Any]:
        if original is sin_cos:
            return lambda angle: graph.sin_cos(graph.lift(angle))
        if original not in copies:
            tree = ast.parse(textwrap.dedent(inspect.getsource(original)))
            names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
            tree = ast.fix_missing_locations(_Selections().visit(tree))
            scope: dict[str, Any] = {"__least": graph.least, "__greatest": graph.greatest}
            scope["min"] = lambda *values: functools.reduce(graph.least, values)
            scope["max"] = lambda *values: functools.reduce(graph.greatest, values)
            for name in names & set(original.__globals__):
                value = original.__globals__[name]
                if value is math:
                    value = _Math(graph)
                elif inspect.isfunction(value):
                    value = copy(value)
                scope[name] = value
            exec(compile(tree, original.__name__, "exec"), scope)
            copies[original] = scope[original.__name__]
        return copies[original]

    return copy(function)


class Traced(NamedTuple):
    """A kernel as expressions.

    ``factors`` are the numbers of constants that have to be > 0 for its margin to be >= 0 exactly
    where all slacks are.
    """

    graph: Graph
    slacks: list[Expression]
    entries: list[Expression]
    factors: set[int]


def trace(kernel: Callable[..., Any], pose_size: int, constants: type[Any]) -> Traced:
    """Return a kernel's slacks, of which its margin is the least, and entries as expressions.

    Raises
    ------
    Untraceable
        For a kernel that does more than arithmetic, roots, sines and selections by size.
    """
    graph = Graph()
    pose = [graph.input(k) for k in range(pose_size)]
    given = records.named(constants, map(graph.constant, itertools.count()))
    try:
        margin, *entries = traced(kernel, graph)(*pose, given)
    except (TypeError, AttributeError, NameError) as error:  # of a function that is none of these
        raise Untraceable(str(error)) from None
    slacks, factors = graph.parts(margin)
    return Traced(graph, slacks, [graph.lift(e) for e in entries], factors)


class TracedImplicit(NamedTuple):
    """Equations and what follows of their solution; the unknowns are inputs after the pose's.

    ``slopes`` are the derivatives of the residuals by the unknowns, row by row.
    """

    outcome: Traced
    residuals: list[Expression]
    slopes: list[Expression]


class TracedCurve(NamedTuple):
    """What a curve's outcome tells: the coordinate, its slope by v and that slope's.

    The inputs are those of the pose, with v in the place of input ``coordinate``.
    """

    outcome: Traced
    value: Expression
    slope: Expression
    bend: Expression


def trace_curve(
    outcome: Callable[..., Any], pose_size: int, coordinate: int, constants: type[Any]
) -> TracedCurve:
    """Return the configurations along which a kernel seeks its pose, as expressions."""
    graph = Graph()
    pose = [graph.input(k) for k in range(pose_size)]
    given = records.named(constants, map(graph.constant, itertools.count()))
    value, slope, margin, *entries = traced(outcome, graph)(*pose, given)
    slacks, factors = graph.parts(margin)
    bend = graph.derivative(slope, pose[coordinate])
    traced_outcome = Traced(graph, slacks, [graph.lift(e) for e in entries], factors)
    return TracedCurve(traced_outcome, value, slope, bend)


def trace_implicit(
    residuals: Callable[..., Any],
    outcome: Callable[..., Any],
    pose_size: int,
    unknowns: int,
    constants: type[Any],
) -> TracedImplicit:
    """Return the equations that a kernel solves, and what it makes of the solution."""
    graph = Graph()
    pose = [graph.input(k) for k in range(pose_size)]
    free = [graph.input(pose_size + k) for k in range(unknowns)]
    given = records.named(constants, map(graph.constant, itertools.count()))
    equations = [graph.lift(r) for r in traced(residuals, graph)(*pose, free, given)]
    margin, *entries = traced(outcome, graph)(*pose, free, given)
    slacks, factors = graph.parts(margin)
    slopes = [graph.derivative(r, u) for r in equations for u in free]
    return TracedImplicit(
        Traced(graph, slacks, [graph.lift(e) for e in entries], factors), equations, slopes
    )
