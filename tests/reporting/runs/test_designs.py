"""Designs that travel from a run or a file to another command."""

import json
import tomllib

import pytest
from support.cli_runner import answer, here

from pmopt import api
from pmopt.errors import InputError
from pmopt.mechanisms import find
from pmopt.reporting.runs.designs import read_design

CONFIG = """
mechanism = "2pauu-ppap"
[parameters]
m = 0.9
n = [0.6, 0.9]
l1 = [0.5, 1.5]
l2 = [0.5, 1.5]
c = 0.1
[workspace]
sampler = "lines"
samples = 256
working_mode = "in-in"
[algorithm]
population = 8
generations = 3
[final]
target_error = 0.05
"""
MECHANISM = find("2pauu-ppap")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("designs")
    api.pareto(tomllib.loads(CONFIG), folder / "run")
    (folder / "config.toml").write_text(CONFIG)
    return folder / "run"


def rows(run):
    import pandas as pd

    return pd.read_csv(run / "front.csv").set_index("design")


def test_a_design_by_number_and_by_name(run):
    table = rows(run)
    knee = json.loads((run / "manifest.json").read_text())["result"]["knee"]
    found = read_design(f"{run}:knee", MECHANISM, "--params")
    assert MECHANISM.resolve(found.parameters) == knee["params"]
    assert found.notes[0].endswith("in working mode in-in: --working-mode in-in")
    for reference in (f"{run}", f"{run}/front.csv", f"{run}/manifest.json"):
        for number in table.index:
            found = read_design(f"{reference}:{number}", MECHANISM, "--params")
            resolved = MECHANISM.resolve(found.parameters)
            assert {k: resolved[k] for k in ("m", "n", "l1", "l2", "c")} == {
                k: table.loc[number, k] for k in ("m", "n", "l1", "l2", "c")
            }
        for name in ("volume", "gci"):
            found = read_design(f"{reference}:best-{name}", MECHANISM, "--params")
            best = table[name].idxmax()
            assert MECHANISM.resolve(found.parameters)["l1"] == table.loc[best, "l1"]


def test_a_front_from_a_spreadsheet(run, tmp_path):
    text = (run / "front.csv").read_text().replace(",", ";").replace(".", ",")
    (tmp_path / "front.csv").write_bytes(b"\xef\xbb\xbf" + text.encode())
    plain = read_design(f"{run}/front.csv:1", MECHANISM, "--params")
    assert read_design(f"{tmp_path}/front.csv:1", MECHANISM, "--params") == plain


def test_the_same_design_from_every_kind_of_file(run, tmp_path):
    pose = ["--pose", "x=0.05,y=0,z=0.9"]
    design = read_design(f"{run}:knee", MECHANISM, "").parameters
    given = {k: v for k, v in design.items() if v is not None}
    (tmp_path / "flat.toml").write_text("".join(f"{k} = {v!r}\n" for k, v in given.items()))
    table = "[parameters]\n" + "".join(f"{k} = '{1000 * v!r} mm'\n" for k, v in given.items())
    (tmp_path / "table.toml").write_text('mechanism = "2PaUU-PPaP"\n' + table)
    text = answer("jacobian", "2pauu-ppap", *pose, "--params", f"@{run}:knee",
                  "--format", "json", cwd=tmp_path)  # fmt: skip
    (tmp_path / "result.json").write_text(text)
    for name in ("flat.toml", "result.json"):
        found = read_design(str(tmp_path / name), MECHANISM, "--params").parameters
        assert {k: v for k, v in MECHANISM.resolve(found).items() if v is not None} == given
    found = MECHANISM.resolve(read_design(str(tmp_path / "table.toml"), MECHANISM, "").parameters)
    assert {k: v for k, v in found.items() if v is not None} == pytest.approx(given, rel=1e-15)


@pytest.mark.parametrize(
    ("reference", "says"),
    [
        ("{run}", "a search has many designs: :knee, :best-volume, :best-gci or the number"),
        ("{run}/front.csv", ":NUMBER or :best-volume or :best-gci is needed"),
        ("{run}:999", "no design '999': the front has 1 to"),
        ("{run}:best", "no design 'best'"),
        ("{run}:best-lci", "unknown name 'best-lci', allowed: best-volume, best-gci"),
        ("{run}/evaluations.csv:1", "is not a front of 2pauu-ppap: columns design and m, n"),
        ("{run}/front.png", "is not a TOML file"),
        ("{run}/..", "holds several runs: one of run is needed"),
        ("{run}/none", "no such file or folder"),
        ("{run}/../config.toml:knee", "holds one design"),
    ],
)
def test_what_names_no_design(run, reference, says):
    with pytest.raises(InputError) as error:
        read_design(reference.format(run=run), MECHANISM, "--params")
    assert says in str(error.value)


def test_a_design_of_another_mechanism(run):
    with pytest.raises(InputError, match="is a design of 2pauu-ppap, not of 3-cur"):
        read_design(f"{run}:knee", find("3-cur"), "--params")


def test_ranges_take_the_default(run):
    found = read_design(str(run.parent / "config.toml"), MECHANISM, "--params")
    assert found.parameters == {"m": 0.9, "c": 0.1}
    assert "n, l1, l2: a range is no design, the default is taken" in found.notes[0]


@pytest.mark.parametrize(
    ("params", "says"),
    [
        ("l1=650", "l1 = 650 m is outside its bounds 0.5 to 1.5 m; 650 mm?"),
        ("l1=1.6", "l1 = 1.6 m is outside its bounds 0.5 to 1.5 m"),
        ("l1=1.6,l2=2", "l1 = 1.6 m is outside its bounds 0.5 to 1.5 m, l2 = 2 m is outside"),
    ],
)
def test_beyond_the_bounds(params, says, tmp_path):
    command = ["mobility", "2pauu-ppap", "--params", params]
    result = here(*command, cwd=tmp_path)
    assert len(result.stderr.splitlines()) == 1
    assert result.stderr.startswith(f"--params: {says}")
    result = here(*command, "--strict", cwd=tmp_path)
    assert (result.returncode, result.stdout) == (2, "")
    assert says in result.stderr
