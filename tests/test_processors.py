"""The same bytes on every x86-64: nothing is left to what a library or a compiler chooses."""

import ast
import math
import random
import re
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy._core._multiarray_umath import __cpu_dispatch__
from support import processors
from support.cli_runner import COMMAND, environment, error_line, pmopt

import pmopt as package
from pmopt.analysis.motion.dynamics import Mover
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler.programs import assembling
from pmopt.mechanisms import find, names
from pmopt.numerics import elementary, matrices

SOURCE = Path(package.__file__).parent

# --- runs as other processors would have them ---------------------------------------------

WIDE = [name for name in __cpu_dispatch__ if "AVX512" in name or name == "X86_V4"]
SWITCHES = {
    "without AVX-512": {
        "NPY_DISABLE_CPU_FEATURES": " ".join(WIDE),
        "OPENBLAS_CORETYPE": "Haswell",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F",
    },
    "libraries without AVX2 and FMA": {
        "NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__),
        "OPENBLAS_CORETYPE": "Nehalem",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F",
    },
    "code for another processor": {"PMOPT_TARGET": "haswell", "OPENBLAS_CORETYPE": "Zen"},
}
OURS = ("NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE", "GLIBC_TUNABLES", "PMOPT_TARGET")


def written(folder, name, changes):
    """Run everything on one mechanism in a process with other switches; return what it wrote."""
    env = {k: v for k, v in environment().items() if k not in OURS} | changes
    subprocess.run(
        [sys.executable, processors.__file__, folder, name], check=True, env=env,
        stdout=subprocess.DEVNULL,
    )  # fmt: skip
    return processors.contents(folder / name)


@pytest.mark.slow
@pytest.mark.parametrize("name", processors.MECHANISMS)
def test_bytes_are_the_same_on_other_processors(name, tmp_path):
    plain = written(tmp_path / "plain", name, {})
    assert len(plain) > 60
    # Of the first mechanism all; of the others what changes libraries most, and a sweep below.
    several = SWITCHES if name == processors.MECHANISMS[0] else ["libraries without AVX2 and FMA"]
    for switch in several:
        others = written(tmp_path / switch, name, SWITCHES[switch])
        assert others.keys() == plain.keys()
        assert [k for k in plain if others[k] != plain[k]] == [], switch


@pytest.mark.slow
@pytest.mark.parametrize("name", processors.MECHANISMS[1:])
def test_code_for_another_processor_gives_the_same_bits(name, tmp_path):
    """Its vectors are half as long and its registers fewer."""
    command = [*COMMAND, "workspace", name, "--samples", "40000", "--shape-grid", "0",
               "--format", "csv", "--quiet"]  # fmt: skip
    plain, other = (
        subprocess.run(command, cwd=tmp_path, env=environment(PMOPT_TARGET=target), check=True,
                       capture_output=True).stdout
        for target in ("host", "haswell")
    )  # fmt: skip
    assert len(plain) > 500
    assert plain == other


#: What depends on the processor, as a process with all switches has it: NumPy's powers, BLAS.
PROBE = """
import math, numpy as np
r = np.random.default_rng(1)
x, y, a = r.random(9999), r.normal(size=9999), r.random((40, 40))
print(hash((np.power(x, 0.3) * 7).tobytes()), hash((a @ a).tobytes()))
print(hash(tuple(map(math.sin, y.tolist()))), hash(tuple(map(math.pow, x.tolist(), y.tolist()))))
"""


@pytest.mark.slow
def test_switches_switch():
    """What is compared would differ: the libraries' own results do."""

    def said(changes):
        env = environment(PYTHONHASHSEED="0") | changes
        done = subprocess.run(
            [sys.executable, "-c", PROBE], env=env, capture_output=True, check=True
        )
        return done.stdout.split()

    plain, other = said({}), said(SWITCHES["libraries without AVX2 and FMA"])
    if "X86_V3" in __cpu_dispatch__ and Path("/proc/cpuinfo").read_text().count("avx2"):
        assert plain != other


# --- what could differ is not used --------------------------------------------------------

#: Modules behind ik, fk, jacobian, workspace, singularities, capability, pareto and batch.
COMPUTING = [
    path
    for room in ("kernels", "numerics", "compiler", "mechanisms", "synthesis", "analysis")
    for path in SOURCE.glob(f"{room}/**/*.py")
]
#: Motions, engines, mobility and recordings agree to rounding; derivatives are theirs.
ELSEWHERE = (
    "analysis/mobility/*", "analysis/multibody/*",
    *(f"analysis/motion/{name}.py" for name in (
        "config", "joint_space", "recordings", "singularities", "trajectories", "waypoint_laws",
    )),
    "analysis/singularities/touching.py", "numerics/derivatives.py",
)  # fmt: skip
LIBRARY = re.compile(
    r"(math|np)\.(a?(sin|cos|tan)h?|arc\w+|atan2|exp\w*|log\w*|pow|power|float_power|cbrt|hypot|"
    r"dot|vdot|inner|matmul|tensordot|linalg\.\w+)"
)
#: Whole numbers come of these, or what decides nothing.
ALLOWED = {
    "kernels/octics.py": {"math.cos"},  # nodes, rounded to 10 bits
    "numerics/elementary.py": {"math.log"},  # raises as that does
    "analysis/certification/volume.py": {"math.log"},  # of 2
    "analysis/regions/sections.py": {"math.log10"},  # rounded down
    "analysis/sampling/cells.py": {"@"},  # of whole numbers
    "analysis/sampling/measuring.py": {"math.log2"},  # of a whole number, rounded up
}


def library_calls(path):
    """Return calls of library functions whose last bits depend on the processor, with lines."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            found.append(("@", node.lineno))
        # Python's floats are raised by the C library; arrays are squared by products.
        power = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)
        if power and "mechanisms" in path.parts:
            found.append(("**", node.lineno))
        if not isinstance(node, ast.Call):
            continue
        name = ast.unparse(node.func)
        by_axis = any(k.arg == "axis" for k in node.keywords)
        if name == "np.linalg.norm" and by_axis and not any(k.arg == "ord" for k in node.keywords):
            continue  # a root of a sum of products
        if name == "math.hypot":
            continue  # Python's own, of additions, products and roots
        if LIBRARY.fullmatch(name):
            found.append((name, node.lineno))
    return found


def test_library_functions_are_not_used():
    calls = {}
    for path in COMPUTING:
        place = str(path.relative_to(SOURCE))
        if not any(fnmatch(place, pattern) for pattern in ELSEWHERE):
            found = [c for c in library_calls(path) if c[0] not in ALLOWED.get(place, ())]
            calls |= {place: found} if found else {}
    assert calls == {}


#: What kernels may call: correctly rounded, or no function at all.
EXACT = {
    "math.sqrt", "math.copysign", "math.floor", "math.fabs", "math.inf", "math.nan", "math.pi",
    "np.floor", "np.inf", "np.nan", "np.pi", "np.int64", "np.uint64",
}  # fmt: skip


def test_kernels_call_no_library_function():
    texts = set()
    for name in names():
        mechanism = find(name)
        texts.add(assembling(mechanism.assembler).text)
        users = [Mover(mechanism, mechanism.resolve({}), mechanism.check_mode(None))]
        users += [
            make_sampler(mechanism, WorkspaceSettings(norm=norm)).evaluator for norm in ("2", "fro")
        ]
        for user in users:
            for program, entries in user.kernels.items():
                texts |= {c.text for entry in entries for c, _ in program.parts(entry)}
    assert len(texts) > 15
    for text in texts:
        found = set(re.findall(r"\b(?:math|np)\.\w+", text))
        assert found <= EXACT, found
        assert "fastmath" not in text


# --- elementary functions -----------------------------------------------------------------

DRAW = random.Random(1)


def drawn(low, high, count=2000):
    return [DRAW.uniform(low, high) for _ in range(count)]


CASES = {
    "sin": (1, [*drawn(-10, 10), *drawn(-1e5, 1e5), *drawn(-1e300, 1e300, 50)]),
    "cos": (1, [*drawn(-10, 10), *drawn(-1e5, 1e5), *drawn(-1e300, 1e300, 50)]),
    "tan": (3, drawn(-10, 10)),
    "asin": (2, [*drawn(-1, 1), -1.0, 0.0, 1.0]),
    "acos": (2, [*drawn(-1, 1), -1.0, 0.0, 1.0]),
    "exp": (1, [*drawn(-700, 700), *drawn(-1, 1), 0.0, 709.7, -745.0, -746.0]),
    "log": (1, [*drawn(0.1, 3), *(10**x for x in drawn(-300, 300)), 5e-324]),
}


def off(found, right):
    """Return an error in units in the last place."""
    return abs(found - right) / math.ulp(right)


@pytest.mark.parametrize("name", CASES)
def test_elementary_functions(name):
    """The C library's are in error by less than one unit themselves."""
    most, places = CASES[name]
    for x in places:
        assert off(getattr(elementary, name)(x), getattr(math, name)(x)) <= most, x


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300))
def test_angle_of_a_point(y, x):
    found, right = elementary.atan2(y, x), math.atan2(y, x)
    assert math.copysign(1.0, found) == math.copysign(1.0, right)
    assert abs(found - right) <= 3 * math.ulp(right) + 1e-300


def test_quarter_turns_of_whole_numbers():
    half = math.pi / 2
    for k in range(-40, 41):
        assert off(elementary.sin(k * half), math.sin(k * half)) <= 1
        assert off(elementary.cos(k * half), math.cos(k * half)) <= 1


def test_powers():
    for x, n in zip(drawn(0.01, 3), drawn(-3, 3), strict=True):
        assert elementary.power(x, n) == pytest.approx(x**n, rel=1e-14)
    assert [elementary.power(-2.0, n) for n in (-2, -1, 0, 3, 7)] == [0.25, -0.5, 1, -8, -128]
    places = np.array([0.0, *drawn(0, 1)])
    np.testing.assert_allclose(
        elementary.power_of(places, 21.0), places**21, rtol=1e-14, atol=1e-20
    )


def test_functions_of_arrays_are_those_of_their_elements():
    angles = np.array(drawn(-30, 30))
    for found, one in zip(elementary.sin_cos_of(angles), ("sin", "cos"), strict=True):
        assert (found == elementary.each(getattr(elementary, one), angles)).all()
    assert (elementary.exp_of(angles) == elementary.each(elementary.exp, angles)).all()
    size = np.abs(angles)
    assert (elementary.log_of(size) == elementary.each(elementary.log, size)).all()
    table = elementary.each(elementary.atan2, angles[:6].reshape(2, 3), [1.0, 2.0, 3.0])
    assert table.shape == (2, 3)


# --- small matrices -----------------------------------------------------------------------


@pytest.mark.parametrize("size", range(1, 7))
def test_small_matrices(size):
    rng = np.random.default_rng(size)
    a, b = rng.normal(size=(60, size, size)), rng.normal(size=(60, size, 2))
    eye = np.eye(size)
    close = {"rtol": 1e-10, "atol": 1e-12}
    np.testing.assert_allclose(matrices.product(a, b), a @ b, **close)
    np.testing.assert_allclose(matrices.product(a[0], b[0, :, 0]), a[0] @ b[0, :, 0], **close)
    np.testing.assert_allclose(matrices.product(b[0, :, 0], a[0]), b[0, :, 0] @ a[0], **close)
    np.testing.assert_allclose(matrices.determinant(a), np.linalg.det(a), **close)
    np.testing.assert_allclose(matrices.product(a, matrices.solve(a, b)), b, atol=1e-10)
    np.testing.assert_allclose(matrices.product(matrices.inverse(a), a), eye + 0 * a, atol=1e-9)
    left, values, right = matrices.decomposed(a)
    np.testing.assert_allclose(values, np.linalg.svd(a, compute_uv=False), **close)
    np.testing.assert_allclose((left * values[:, None]) @ right, a, **close)
    for factor in (left, right):
        np.testing.assert_allclose(np.swapaxes(factor, 1, 2) @ factor, eye + 0 * a, atol=1e-14)
    form = a + np.swapaxes(a, 1, 2)
    values, vectors = matrices.eigen(form)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(form), **close)
    np.testing.assert_allclose(
        (vectors * values[:, None]) @ np.swapaxes(vectors, 1, 2), form, **close
    )


@pytest.mark.parametrize("shape", [(3, 5), (6, 3), (4, 4)])
def test_what_else_is_in_a_stack_changes_nothing(shape):
    rng = np.random.default_rng(3)
    stack = rng.normal(size=(30, *shape)) * 10.0 ** rng.integers(-8, 8, size=(30, 1, 1))
    stack[3] = 0.0
    together = matrices.decomposed(stack)
    for k in range(len(stack)):
        for whole, part in zip(together, matrices.decomposed(stack[k : k + 1]), strict=True):
            assert (whole[k] == part[0]).all()


def test_stacks_of_none():
    none = np.empty((0, 2, 3, 3))
    assert matrices.determinant(none).shape == (0, 2)
    assert matrices.singular_values(none).shape == (0, 2, 3)
    assert [part.shape for part in matrices.eigen(none)] == [(0, 2, 3), none.shape]
    for function in (matrices.inverse, lambda m: matrices.product(m, m)):
        assert function(none).shape == none.shape


def test_sizes_do_not_matter():
    """No square overflows or vanishes."""
    form = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 1.0], [0.0, 1.0, 4.0]])
    for power in (-200, 200):
        size = 10.0**power
        for function in (matrices.singular_values, lambda m: matrices.eigen(m)[0]):
            np.testing.assert_allclose(function(size * form) / size, function(form), rtol=1e-13)


def test_singular_matrices():
    flat = np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [1.0, 1.0, 1.0]])
    assert matrices.determinant(flat) == 0.0
    assert not np.isfinite(matrices.inverse(flat)).all()
    left, values, right = matrices.decomposed(np.stack([flat, 0 * flat, np.diag([0.0, 2.0, 0.0])]))
    assert values[1].tolist() == [0.0, 0.0, 0.0]
    assert values[2].tolist() == [2.0, 0.0, 0.0]
    for factor in (left, right):
        np.testing.assert_allclose(
            np.swapaxes(factor, 1, 2) @ factor, np.broadcast_to(np.eye(3), (3, 3, 3)), atol=1e-14
        )


def test_an_unknown_target_is_one_line(tmp_path):
    result = pmopt("list", cwd=tmp_path, env={"PMOPT_TARGET": "pentium"})
    assert error_line(result) == (
        "error: PMOPT_TARGET: 'pentium' is not allowed, allowed: host, haswell"
    )
