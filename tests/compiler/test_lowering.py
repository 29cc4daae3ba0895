"""Kernel text goes to machine code without numba, and means what it means to Python."""

import inspect
import math
import sys
from collections import namedtuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler import machine_code, programs
from pmopt.compiler.lowering import Unsupported, lowered
from pmopt.compiler.machine_code import Compiled, Entry
from pmopt.compiler.program_text import Checks, common_text, conditions_text

OPTIONS = (
    {}, {"norm": "fro"}, {"sampler": "lines"},
    {"link_diameter": 0.1, "cone_angle": 1.0, "tool": (0.0, 0.0, 0.1)},
)  # fmt: skip


def sent(compiled, name):
    """Return LLVM's text of an entry."""
    return lowered(compiled.text, name, compiled._by_name[name].arguments, "entry")


def test_all_of_the_catalogue_goes_without_numba(mechanism):
    """An entry left to numba would take ten times as long, and nobody would see it."""
    parts = set()
    for option in OPTIONS:
        if option.get("sampler") == "lines" and mechanism.line is None:
            continue
        if not mechanism.cones:
            option = {k: v for k, v in option.items() if k != "cone_angle"}
        for program, names in make_sampler(
            mechanism, WorkspaceSettings(**option)
        ).evaluator.kernels.items():
            parts.update(part for name in names for part in program.parts(name))
    mover = Mover(mechanism, mechanism.resolve({}), mechanism.working_modes[0])
    parts.update(mover._kernel.parts("move_all"))
    shared = [programs.counting(), programs.searching(), programs.enclosing()]
    for found in (mechanism.assembler, mechanism.inverter):
        if found is not None:
            shared.append(programs.assembling(found))
    parts.update((compiled, e.name) for compiled in shared for e in compiled.entries)
    for compiled, name in parts:
        assert "define void @entry(" in sent(compiled, name)


def test_what_is_common_has_nothing_of_a_mechanism(mechanism):
    """Two mechanisms, norms or checks: the same texts of points and sums."""
    texts = [common_text("sweep"), conditions_text(4, "2")]
    assert not any(mechanism.kernel.__name__ + "(" in text for text in texts)
    assert Checks.__name__ not in texts[0]


@pytest.mark.parametrize(("option", "again"), [
    ({"norm": "fro"}, {"indices", "conditions"}), ({"sampler": "sobol"}, set()),
    ({"regions": (0.0, 0.5, 1.0)}, set()), ({"min_lci": 0.1}, set()),
    ({"link_diameter": 0.1}, {"margins", "evaluations", "placed", "probe", "indices", "skeletons"}),
])  # fmt: skip
def test_a_changed_option_compiles_what_has_changed(mechanism, option, again):
    def parts(**changed):
        kernels = make_sampler(mechanism, WorkspaceSettings(**changed)).evaluator.kernels
        return {
            (c.folder.name, part)
            for program, names in kernels.items()
            for name in names
            for c, part in program.parts(name)
        }

    assert {part for _, part in parts(**option) - parts()} <= again


# --- meaning ------------------------------------------------------------------------------------

Pair = namedtuple("Pair", ("left", "right"))
HEAD = """
import math
import numpy as np
from collections import namedtuple
from numba import njit

Pair = namedtuple("Pair", ("left", "right"))
LIMIT = 3


"""


def branches(x, n, out):
    a, b = x[0], x[1]
    low = a if a < b else b
    out[0] = low if not low > 0.5 else math.sqrt(abs(low))
    out[1] = min(a, b, 0.25)
    out[2] = max(a, -b)
    out[3] = 1.0 if a < b < 0.5 or (b > 0.0 and a <= x[n % 2]) else -0.0
    for k in range(n - 1, -2, -1):
        if k == 2:
            continue
        if k in (5, LIMIT + 3):  # noqa: F821
            break
        out[4] += a * k
    out[5] = n // 3 + n % 3 + (-n) // 3 + (-n) % 3
    out[6] = math.copysign(a, b) / (1.0 + np.floor(abs(a)))


def loops(x, n, out):
    total = 0
    count = 0
    while count < n:
        total += x[count % 2] if count > 1 else 1
        count += 1
    pair = Pair(right=x[0], left=(x[1], total))
    inner, outer = pair
    out[0] = inner[0] + pair.left[1] * outer
    row = out[2:5]
    row[0] = row[1] = float(n)
    values = (*inner, x[0])
    for k in range(len(values)):
        out[5] += values[k]
    row[:] = 2.0
    for item in (x[0], 0.5, x[1]):
        if item > 1.0:
            continue
        if item < -20.0:
            break
        out[5] -= item
    out[6] = 1 << n
    out[6] -= -1 if n & 1 else 0
    return


def bits(x, n, out):
    key = np.uint64(n) * np.uint64(0x9E3779B97F4A7C15)
    key ^= key >> np.uint64(30)
    out[0] = float(np.int64(key >> np.uint64(12)))
    out[1] = int(x[0]) + math.floor(x[1])
    value = complex(x[0], x[1]) * 2.0 - 1.0j
    value = value * value / 3.0
    out[2] = value.real
    out[3] = value.imag
    good = n > 2
    good = x[0] > 0.0 and good
    out[4] = 5.0 if good else 4.0
    out[5] = n
    out[5] *= 1 if good else n
    chosen = (Pair(x[0], (n, 1.5)), Pair(x[1], (2 * n, 2.5)), Pair(3.0, (0, 3.5)))[n % 3]
    out[6] = chosen.left + chosen.right[0] * chosen.right[1]
    out[n - 7] += x[n % 2 - 2] + (1.0, x[0], x[1])[n % 3 - 3]


numbers = st.floats(-50, 50, allow_nan=False)


@pytest.mark.parametrize("function", [branches, loops, bits])
def test_text_means_what_it_means_to_python(function, tmp_path, monkeypatch):
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(Compiled, "_compile_by_numba", None)
    text = f"{HEAD}@njit\n{inspect.getsource(function)}"
    made = Compiled(text, [Entry(function.__name__, ("float64[:]", "int64", "float64[:]"))])
    space = function.__globals__ | {"LIMIT": 3}
    plain = type(function)(function.__code__, space)

    @settings(max_examples=60, deadline=None)
    @given(numbers, numbers, st.integers(0, 7))
    def compare(a, b, n):
        x, expected, found = np.array([a, b]), np.zeros(7), np.zeros(7)
        with np.errstate(over="ignore"):
            plain(x, n, expected)
        getattr(made, function.__name__)(x, n, found)
        assert found.tobytes() == expected.tobytes()

    compare()


def test_a_piece_is_called_by_its_address(tmp_path, monkeypatch):
    """One of 0 is not there."""
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path))
    twice = Compiled(
        "def twice(row, count):\n    for i in range(count):\n        row[i] *= 2.0\n",
        [Entry("twice", ("float64[:]", "int64"))],
    )
    outer = Compiled(
        "def outer(row, piece):\n    if piece:\n        piece(row[1:], 2)\n"
        "    else:\n        row[0] = -1.0\n",
        [Entry("outer", ("float64[:]", "*float64[:]|int64"))],
    )
    row = np.ones(4)
    outer.outer(row, twice.address("twice"))
    assert row.tolist() == [1.0, 2.0, 2.0, 1.0]
    outer.outer(row, 0)
    assert row[0] == -1.0


LEFT = {
    "a sum of a generator": "    x[0] = sum(v for v in (1.0, 2.0))\n",
    "a sine of the C library": "    x[0] = math.sin(x[0])\n",
    "kinds that do not meet": "    a = x\n    if x[0] > 0.0:\n        a = 1.0\n    x[0] = a\n",
    "an unknown name": "    x[0] = unknown\n",
    "a dictionary": "    x[0] = {1: 2.0}[1]\n",
}


@pytest.mark.parametrize("case", LEFT)
def test_what_is_not_understood_is_left_to_numba(case):
    with pytest.raises(Unsupported):
        lowered(f"import math\n\n\ndef f(x):\n{LEFT[case]}", "f", ["float64[:]"], "entry")


@pytest.mark.slow
def test_numba_takes_what_is_left(tmp_path, monkeypatch):
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path))
    text = "import math\nfrom numba import njit\n\n\n@njit\ndef f(x):\n    x[0] = math.sin(x[0])\n"
    made = Compiled(text, [Entry("f", ("float64[:]",))])
    x = np.array([0.5])
    made.f(x)
    assert x[0] == pytest.approx(math.sin(0.5), rel=1e-15)
    assert "numba" in sys.modules or machine_code._numba_target == []
