"""Named numbers of kernels: rows, records and the text that makes the one of the other."""

import math
from collections import namedtuple
from typing import NamedTuple

import pytest

from pmopt.compiler import program_text, records
from pmopt.compiler.apart import apart
from pmopt.compiler.tracing import trace
from pmopt.kernels.vectors import Vec3
from pmopt.mechanisms import find, names


class Stroke(NamedTuple):
    low: float
    high: float


class Design(NamedTuple):
    length: float
    stroke: Stroke
    axis: Vec3


DESIGN = Design(1.0, Stroke(2.0, 3.0), Vec3(4.0, 5.0, 6.0))
ROW = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
#: A module's number that is a record.
ACROSS = Vec3(0.0, 1.0, 0.0)


def kernel(x, y, z, k):
    """Return a margin, an entry and seven numbers."""
    low = x - k.stroke.low
    high = k.stroke.high - x
    margin = low if low < high else high
    return margin, k.axis.y * ACROSS.y, k.length, *(0.0,) * 7


def still(x, y, z, k):
    """Return a platform that stays."""
    return (0.0,) * 12


def test_rows_and_records():
    assert records.size(Design) == 6
    assert records.flat(DESIGN) == ROW
    assert records.named(Design, [*ROW, 7.0]) == DESIGN
    assert isinstance(records.named(Design, ROW).stroke, Stroke)


def test_text_makes_the_record():
    blocks = {}
    records.declare(Design, blocks)
    scope = {}
    exec("\n".join(blocks.values()), scope)
    made = eval(records.call(Design, map(repr, ROW)), scope)
    assert made == DESIGN
    assert made.axis.z == 6.0


def test_two_records_of_one_name():
    blocks = {}
    records.declare(Stroke, blocks)
    records.declare(Stroke, blocks)
    with pytest.raises(TypeError, match="Stroke"):
        records.declare(namedtuple("Stroke", "start end"), blocks)


@pytest.mark.parametrize("checks", [(), ("tool",)])
def test_module_text(checks):
    """A module stands alone, and what it unpacks has the names that its kernel reads."""
    recipe = program_text.Recipe(kernel, still, 3, Design, 3, "2", (), (), 0, checks)
    text = program_text.module_text(recipe)
    scope = {}
    exec(text, scope)
    row = [*ROW, *map(float, range(10, 22))]
    made = scope["unpack"].py_func(row)
    made, limits = made if checks else (made, None)
    assert made == DESIGN
    assert scope[apart("ACROSS", kernel)] == ACROSS
    assert limits is None or (limits.cosine, limits.tool, limits.high.z) == (12, (13, 14, 15), 21)


def test_traced_by_name():
    traced = trace(kernel, 3, Design)
    assert len(traced.slacks) == 2
    assert traced.entries[1] is traced.graph.constant(0)


@pytest.mark.parametrize("name", names())
def test_constants_of_mechanisms_have_names(name):
    """As many numbers as are counted, and no two of them in one place."""
    mechanism = find(name)
    assert mechanism.constants is not None
    parameters = mechanism.resolve({})
    limits = mechanism.default_limits(parameters)
    made = mechanism.kernel_constants(parameters, mechanism.working_modes[0], 1.0, limits)
    assert isinstance(made, mechanism.constants)
    row = records.flat(made)
    assert len(row) == records.size(mechanism.constants)
    assert not any(math.isnan(v) for v in row)
    assert records.named(mechanism.constants, row) == made
