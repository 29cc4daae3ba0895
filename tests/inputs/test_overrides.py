"""Keys of a configuration on the command line, and ranges of values."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.cli_runner import CONFIGS, here

from pmopt.analysis.motion.config import load_motion
from pmopt.errors import InputError, InputErrors
from pmopt.inputs.overrides import overridden, range_values, sweep_values, toml_value
from pmopt.reporting.batch.plan import plan_runs
from pmopt.synthesis.config import load_config

QUICK = CONFIGS / "quickstart.toml"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("50", 50), ("0.5", 0.5), ("true", True), ("[0.5, 1.5]", [0.5, 1.5]), ('"50"', "50"),
        ("650mm", "650mm"), ("in-in", "in-in"), ("{min = 0.1}", {"min": 0.1}), ("a = b", "a = b"),
        ("1\nx = 2", "1\nx = 2"),
    ],
)  # fmt: skip
def test_values(text, value):
    assert toml_value(text) == value
    assert type(toml_value(text)) is type(value)


def test_keys_take_the_place_of_what_stands_there():
    data = {"a": {"b": 1, "c": 2}, "d": 3}
    changed = overridden(data, ["a.b=5", "e.f=x", "d = [1, 2]"])
    assert changed == {"a": {"b": 5, "c": 2}, "d": [1, 2], "e": {"f": "x"}}
    assert data == {"a": {"b": 1, "c": 2}, "d": 3}


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        (["a"], "--set: 'a' is not KEY=VALUE"),
        (["a="], "is not KEY=VALUE"),
        (["a..b=1"], "is not KEY=VALUE"),
        (["a=1", "a=2"], "--set: a is given twice"),
        (["d.x=1"], "--set: d.x: d is not a table"),
    ],
)
def test_what_sets_no_key(texts, says):
    with pytest.raises(InputError) as error:
        overridden({"d": 3}, texts)
    assert says in str(error.value)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.8:1.4:0.3", [0.8, 1.1, 1.4]),
        ("0.5:1.0:0.1", [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("1:10:4", [1, 5, 9]),
        ("1:0:-0.5", [1.0, 0.5, 0.0]),
        ("0.8,1.1, 1.4", [0.8, 1.1, 1.4]),
        ("out-out,in-in", ["out-out", "in-in"]),
        ("800mm,0.9", ["800mm", 0.9]),
        ("[0.5, 1.5]", None),
        ("0.8", None),
        ("a:b:c", None),
    ],
)
def test_values_of_a_sweep(text, values):
    assert sweep_values(text) == values
    assert list(map(type, sweep_values(text) or [])) == list(map(type, values or []))


@pytest.mark.parametrize("text", ["1:2:0", "1:2:-1", "0:1:1e-9"])
def test_no_range(text):
    with pytest.raises(InputError):
        range_values(text)


@given(st.integers(-50, 50), st.integers(1, 40), st.integers(1, 30))
def test_a_range_has_both_ends(low, steps, step):
    high = low + steps * step
    found = range_values(f"{low / 10}:{high / 10}:{step / 10}")
    assert found == [(low + k * step) / 10 for k in range(steps + 1)]


def test_a_search_and_a_motion(tmp_path):
    config = load_config(
        QUICK, ["algorithm.population=8", "parameters.l1=650mm", "final.target_error=1%"]
    )
    assert config.algorithm.population == 8
    assert config.parameters["l1"] == 0.65
    assert config.final.target_error == 0.01
    with pytest.raises(
        InputError, match=r"quickstart.toml: unknown key algorithm.popu, .* nearest: population"
    ):
        load_config(QUICK, ["algorithm.popu=8"])
    motion = load_motion(
        CONFIGS / "motion/2uu-upu-t1.toml", ["trajectory.step=20ms", "payload.mass=2kg"]
    )
    assert motion.config.trajectory.step == 0.02
    assert motion.payload.mass == 2.0


def test_a_manifest_records_what_was_set(tmp_path):
    small = ["--set", "algorithm.population=8", "--set", "algorithm.generations=2",
             "--set", "workspace.samples=256", "--set", "final.target_error=0.1"]  # fmt: skip
    result = here("pareto", QUICK, *small, "--out", "run", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    config = json.loads((tmp_path / "run/manifest.json").read_text())["config"]
    assert config["algorithm"]["population"] == 8
    assert config["workspace"]["samples"] == 256
    again = here("pareto", QUICK, *small, "--out", "run", "--resume", cwd=tmp_path)
    assert "finished: nothing to do" in again.stderr


def test_sweeps(tmp_path):
    base = 'command = "workspace"\nmechanism = "2pauu-ppap"\n[workspace]\nsamples = 1000\n'
    wanted = [0.5, 0.6, 0.7, 0.8, 0.9, 1.0]
    for sweep in ('"0.5:1.0:0.1"', "{start = 0.5, stop = 1.0, num = 6}", json.dumps(wanted)):
        path = tmp_path / "a.toml"
        path.write_text(f'{base}[sweep]\n"parameters.l1" = {sweep}\n')
        runs = plan_runs([str(path)])
        assert [run.swept["parameters.l1"] for run in runs] == wanted
    path.write_text(base)
    runs = plan_runs([str(path)], ["parameters.l1=0.8,1.1", "seed=1:3:1", "parameters.l2=900mm"])
    assert [tuple(run.swept.values()) for run in runs] == [
        (a, b) for a in (0.8, 1.1) for b in (1, 2, 3)
    ]
    assert {run.runner.task.parameters["l2"] for run in runs} == {0.9}
    with pytest.raises(InputErrors, match="STEP from FROM to TO"):
        plan_runs([str(path)], ["seed=3:1:1"])
    path.write_text(f'{base}[sweep]\n"parameters.l1" = "some"\n')
    with pytest.raises(InputErrors, match="a list, a range"):
        plan_runs([str(path)])
