"""Units of the keys of configurations."""

import math
from pathlib import Path

import pytest

from pmopt.analysis.motion.config import resolve_motion
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.validation import validated
from pmopt.errors import InputError
from pmopt.mechanisms import find, names
from pmopt.synthesis.config import resolve_config


def test_settings_of_a_workspace():
    found = validated(
        WorkspaceSettings,
        {
            "domain": {"phi_deg": [-10, 10], "l4": ["5cm", "0.07m"]},
            "limits": {"l1": ["2in", "inf"]},
            "link_diameter": "1cm",
            "cone_angle_deg": 40,
            "tool": ["1mm", 2, "3"],
            "characteristic_length": "0.02 m",
            "target_error": "1%",
        },
        "here",
        find("3-ups-sp").units,
    )
    assert found.domain == {"phi": (math.radians(-10), math.radians(10)), "l4": (50.0, 70.0)}
    assert found.limits == {"l1": (50.8, math.inf)}
    assert (found.link_diameter, found.characteristic_length) == (10.0, 20.0)
    assert (found.tool, found.cone_angle) == ((1.0, 2.0, 3.0), math.radians(40))
    assert found.target_error == 0.01


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"link_diameter": "1kg"}, "link_diameter='1kg' is not allowed: the unit kg does not fit"),
        ({"domain": {"phi": ["1mm", 2]}}, "domain.phi='1mm' is not allowed"),
        ({"cone_angle": 1, "cone_angle_deg": 3}, "cone_angle is given twice"),
        ({"domain": {"phi": [0, 1], "phi_deg": [0, 1]}}, "domain.phi is given twice"),
        ({"min_lci": "0.1m"}, "a plain number is needed"),
    ],
)
def test_what_does_not_fit(wrong, says):
    with pytest.raises(InputError) as error:
        validated(WorkspaceSettings, wrong, "here", find("3-ups-sp").units)
    assert str(error.value).startswith("here: ")
    assert says in str(error.value)


def test_a_motion_in_units_is_the_same_motion():
    trajectory = {"x": 0.0, "y": 0.0, "z": "1.4 + 0.1*t"}
    plain = {
        "mechanism": "2pauu-ppap",
        "parameters": {"l1": 0.8},
        "trajectory": {"duration": 0.5, "step": 0.01} | trajectory,
        "payload": {"mass": 0.5, "centre": [0.01, 0.0, 0.02], "inertia": [2e-6, 2e-6, 2e-6]},
        "bodies": {"limb 3 carriage": {"mass": 2.0, "centre": [0.0, 0.0, 0.05]}},
        "limits": {"theta1_rate": [-1.0, math.radians(90)], "theta1_effort": [-2000.0, 2000.0]},
        "controller": {"feedforward": True, "hold": 0.001},
        "gravity": [0.0, 0.0, -9.81],
    }
    given = plain | {
        "parameters": {"l1": "800mm"},
        "trajectory": {"duration": "500 ms", "step": "10ms"} | trajectory,
        "payload": {
            "mass": "500g", "centre": ["10mm", 0.0, "2 cm"],
            "inertia": ["2 kg mm^2", 2e-6, 2e-6],
        },
        "bodies": {"limb 3 carriage": {"mass": "2kg", "centre": [0.0, 0.0, "50mm"]}},
        "limits": {"theta1_rate": [-1.0, "90deg/s"], "theta1_effort": ["-2kNm", "2000 Nm"]},
        "controller": {"feedforward": True, "hold": "1ms"},
        "gravity": [0.0, 0.0, "-9.81m/s^2"],
    }  # fmt: skip
    assert (
        resolve_motion(given, "c", Path()).to_dict() == resolve_motion(plain, "c", Path()).to_dict()
    )


def test_a_search_in_units_is_the_same_search():
    plain = {
        "mechanism": "2pauu-ppap",
        "parameters": {"l1": [0.5, 1.5], "l2": 0.9, "m": 0.7, "n": 0.7, "c": 0.1},
        "workspace": {"domain": {"x": [-0.5, 0.5]}},
        "final": {"target_error": 0.01},
    }
    given = plain | {
        "parameters": {"l1": ["500mm", "1.5m"], "l2": "90 cm", "m": "0.7", "n": 0.7, "c": "1dm"},
        "workspace": {"domain": {"x": ["-500mm", 0.5]}},
        "final": {"target_error": "1%"},
    }
    assert resolve_config(given, "c") == resolve_config(plain, "c")


@pytest.mark.parametrize("name", names())
def test_every_coordinate_has_a_unit_by_its_name(name):
    mechanism = find(name)
    for c in (*mechanism.pose, *mechanism.joints, *mechanism.passive, *mechanism.parasitic):
        assert mechanism.unit_named(c.name) == mechanism.unit(c)
        assert mechanism.unit_named(f"{c.name}_rate") == f"{mechanism.unit(c)}/s"
    assert mechanism.unit_named("nothing") is None
