"""Functions and constants of other people's modules that are called as ours."""

import importlib
import sys

import pytest

from pmopt.compiler import program_text, programs
from pmopt.compiler.program_text import Recipe, module_text
from pmopt.kernels.vectors import X, Y, cross

MODULE = '''
import math
from typing import NamedTuple

import numpy as np

from pmopt.kernels.vectors import Vec3, cross as direction
from pmopt.kernels.trigonometry import arc_tangent

TINY = 1e-3
ORDER = 5
BLOCK = 7
careful = 0.5


def root_of(x):
    """The name TINY in a text stays."""
    return math.sqrt(x) + TINY


def cross(x):
    return 2.0 * x


class Rotation(NamedTuple):
    angle: float


STILL = Rotation(0.0)


class Constants(NamedTuple):
    length: float


def margin_of(x):
    return 3.0 * x * ORDER


def newton(x):
    return x + BLOCK


def skeleton(x, y, constants):
    turned = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    return (x, y, 0.0, *turned, newton(x), 0.0, 0.0, 0.0, 0.0, 0.0)


def kernel(x, y, constants):
    # é before a name on a line: é
    s = "é"; a, b, c = direction(Vec3(1.0, 0.0, 0.0), Vec3(x, y, 0.0)); t = root_of(x)
    parts = [cross(v) + Rotation(v).angle + STILL.angle for v in (x, y)]
    return (parts[0] + parts[1] + a + b + c + t, margin_of(x), arc_tangent(x, y), careful, np.pi)


def sweep(x, y, constants):
    return kernel(x, y, constants)


def careful_index(x, y, constants):
    return kernel(x, y, constants)


def of_a_list(x, y, constants):
    return (LIST[0], 0.0, 0.0, 0.0, 0.0)


LIST = [1.0]


def posture(x, y, constants):
    return skeleton(x, y, constants)[:12]
'''


@pytest.fixture
def theirs(tmp_path, monkeypatch):
    (tmp_path / "their_module.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("their_module")
    del sys.modules["their_module"]


def text_of(kernel, module):
    return module_text(Recipe(kernel, module.skeleton, 2, module.Constants, 2, "2", (0,), (), 0))


def plainly(text):
    """Run a text as plain Python."""
    space = {}
    text = text.replace(
        "from numba import njit", "njit = lambda **options: lambda function: function"
    )
    exec(compile(text, "text", "exec"), space)
    return space


def test_what_is_called_alike_is_kept_apart(theirs):
    text = text_of(theirs.kernel, theirs)
    space = plainly(text)
    at = (0.3, 0.4, (0.0,))
    assert space["kernel"](*at) == theirs.kernel(*at)
    assert space["skeleton"](*at) == theirs.skeleton(*at)
    assert (space["TINY"], space["TINY__their_module"]) == (1e-300, 1e-3)
    assert (space["ORDER"], space["ORDER__their_module"]) == (2, 5)
    assert space["BLOCK"] != space["BLOCK__their_module"] == 7
    assert space["cross"](X, Y) == cross(X, Y) == (0.0, 0.0, 1.0)
    assert space["Rotation__their_module"](0.5).angle == 0.5
    assert len(space["STILL__their_module"]) == 1
    assert "The name TINY in a text stays." in text
    # Ours of the same name, that is put in when a text is made.
    assert space["margin_of"] is not space["margin_of__their_module"]
    assert space["margin_of__their_module"](1.0) == 15.0


def test_two_plugins_do_not_meet(theirs, tmp_path):
    other = MODULE.replace("TINY = 1e-3", "TINY = 1e-2")
    (tmp_path / "other_module.py").write_text(other, encoding="utf-8")
    try:
        second = importlib.import_module("other_module")
        theirs.root_again = second.root_of
        blocks = {}
        program_text.collect(second.root_of, blocks, name="second")
        program_text.collect(theirs.root_of, blocks, name="first")
        space = plainly("import math\n" + "\n".join(blocks.values()).replace("@njit", "#"))
        assert space["first"](0.0) == 1e-3
        assert space["second"](0.0) == 1e-2
    finally:
        del sys.modules["other_module"]


@pytest.mark.parametrize(("name", "other"), [("sweep", "kernels.sweep"),
                                             ("careful_index", "compiler")])  # fmt: skip
def test_a_kernel_that_has_our_name_is_refused_in_one_line(theirs, name, other):
    with pytest.raises(TypeError) as caught:
        text_of(getattr(theirs, name), theirs)
    assert str(caught.value) == (
        f"two kernel functions are named {name}, of pmopt.{other} and of their_module: another "
        "name is needed"
    ).replace(" and of ", " and ")


def test_what_is_no_number_is_named(theirs):
    with pytest.raises(TypeError, match="kernel of_a_list refers to LIST, which is no number"):
        text_of(theirs.of_a_list, theirs)


def test_ours_have_their_names(mechanism):
    blocks = {}
    program_text.collect(mechanism.kernel, blocks)
    program_text.collect(mechanism.posture, blocks)
    assert not [name for name in blocks if "__" in name]


def test_texts_of_motions_keep_names_apart(theirs, monkeypatch, tmp_path):
    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path))
    made = programs.moving(programs.Moving(theirs.posture, 2, theirs.Constants, 12))
    (move, _), (posture, _) = made.parts("move_all")
    assert "newton__their_module" in posture.text
    assert "RANK = " in move.text
