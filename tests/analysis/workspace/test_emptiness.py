"""Nothing reachable: exit code 3, and what rules it out; boxes printed as they were given."""

import pytest
from support.cli_runner import error_line, here, json_answer, strict_json

from pmopt import api
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.emptiness import explain
from pmopt.errors import InfeasibleError
from pmopt.mechanisms import find

MECH = "2pauu-ppap"
FAR = ("--domain", "x=0:0.1,y=-0.1:0.1,z=5:6")


def why(name, params=None, **settings):
    mechanism = find(name)
    return explain(mechanism, mechanism.resolve(params or {}), WorkspaceSettings(**settings))


@pytest.mark.parametrize(("name", "params", "settings", "words"), [
    (MECH, {}, {"domain": {"z": (5, 6), "x": (0, 0.1)}}, ["domain: z=5:6 m lies beyond the reach"]),
    (MECH, {}, {"domain": {"z": (5, 6), "x": (5, 6)}},
     ["together they leave nothing: domain: z=5:6 m", "and domain: x=5:6 m"]),
    (MECH, {}, {"limits": {"theta1": (3, 3.1)}}, ["limits: theta1=3:3.1 rad lies beyond"]),
    (MECH, {"m": 100}, {}, ["parameters: m=100 m", "the default 1 m does not", "up to about 2.8"]),
    (MECH, {"l1": 0.01, "l2": 0.01}, {}, ["l1=0.01 m", "l2=0.01 m"]),
    (MECH, {}, {"min_lci": 0.99}, ["min_lci=0.99 leaves nothing; the largest LCI found is 0.56"]),
    ("3-cur", {}, {"working_mode": "up-down-up"}, ["working_mode=up-down-up", "up-up-up does not"]),
    ("3-ups-sp", {}, {"domain": {"l4": (200, 300)}}, ["l4=200:300 mm lies beyond", "45 .. 89."]),
    ("3-ups-sp", {}, {"limits": {"l1": (200, 300)}}, ["limits: l1=200:300 mm lies beyond"]),
    ("4-ups-rps", {}, {"domain": {"beta": (2, 3)}}, ["domain: beta=2:3 rad lies beyond"]),
    ("2uu-upu", {}, {"domain": {"x": (1, 2), "beta": (0, 1)}}, ["domain: x=1:2 m lies beyond"]),
])  # fmt: skip
def test_what_rules_it_out(name, params, settings, words):
    text = why(name, params, **settings)
    assert all(word in text for word in words), text


def test_two_that_each_do_are_both_named():
    text = why(MECH, domain={"x": (0.9, 1.0), "z": (2.1, 2.2)})
    assert text.startswith("without one of these something is reachable: domain: x=0.9:1 m")
    assert "; or domain: z=2.1:2.2 m" in text


def test_too_few_samples_are_no_emptiness():
    assert "too few samples" in why(MECH)


@pytest.mark.parametrize("command", [
    ("workspace", "--samples", "4096"), ("workspace", "--grid", "12"),
    ("workspace", "--certify", "0.1"), ("singularities",), ("capability", "--samples", "4096"),
    ("certify", "--min-lci", "0.2"),
])  # fmt: skip
def test_every_command_ends_with_3(command, tmp_path):
    name, *words = command
    result = here(name, MECH, *words, *FAR, "--out", "run", "--quiet", cwd=tmp_path)
    line = error_line(result, code=3)
    assert "nothing is reachable: domain: z=5:6 m lies beyond the reach" in line
    # That nothing is reachable is itself what a certificate proves.
    proven = name == "certify" or "--certify" in words
    assert (tmp_path / "run/manifest.json").exists() == proven


@pytest.mark.parametrize("analysis", [
    lambda: api.workspace(MECH, domain={"z": (5, 6)}, samples=4096),
    lambda: api.singularities(MECH, domain={"z": (5, 6)}),
    lambda: api.capability(MECH, workspace={"domain": {"z": (5, 6)}}),
])  # fmt: skip
def test_from_python_it_is_an_error_with_that_code(analysis):
    with pytest.raises(InfeasibleError, match="z=5:6 m") as caught:
        analysis()
    assert caught.value.exit_code == 3


def test_min_lci_that_leaves_nothing(tmp_path):
    line = error_line(
        here("workspace", MECH, "--min-lci", "0.99", "--samples", "4096", cwd=tmp_path), code=3
    )
    assert "none of 4096 poses is reachable: min_lci=0.99 leaves nothing" in line


def test_a_search_names_it(tmp_path):
    text = (f'mechanism = "{MECH}"\n[parameters]\nm = [0.5, 1.5]\n[workspace]\nsamples = 512\n'
            "[workspace.domain]\nz = [50, 60]\n[algorithm]\npopulation = 8\ngenerations = 2\n"
            )  # fmt: skip
    (tmp_path / "a.toml").write_text(text)
    line = error_line(here("pareto", "a.toml", "--out", "run", "--quiet", cwd=tmp_path), code=3)
    assert "domain: z=50:60 m lies beyond the reach" in line
    # A batch of nothing but such runs ends alike.
    (tmp_path / "b.toml").write_text(
        f'command = "workspace"\nmechanism = "{MECH}"\n[workspace]\nsamples = 4096\n'
        "[workspace.domain]\nz = [50, 60]\n"
    )
    result = here("batch", "a.toml", "b.toml", "--out", "all", "--format", "json", cwd=tmp_path)
    assert result.returncode == 3
    runs = strict_json(result.stdout)["runs"]
    assert [r["status"] for r in runs] == ["infeasible"] * 2
    assert all("z=50:60 m" in r["message"] for r in runs)


# --- claims -------------------------------------------------------------------------------


def test_a_claim_about_nothing_is_empty(tmp_path):
    result = here("certify", MECH, *FAR, "--min-lci", "0.2", "--format", "json", cwd=tmp_path)
    assert result.returncode == 3
    document = strict_json(result.stdout)
    assert (document["verdict"], document["reachable"], document["witness"]) == (
        "empty", "none", None
    )  # fmt: skip
    assert document["domain"] == {"x": [0.0, 0.1], "y": [-0.1, 0.1], "z": [5.0, 6.0]}
    assert "z=5:6 m" in document["reason"]
    table = here("certify", MECH, *FAR, "--min-lci", "0.2", cwd=tmp_path).stdout
    assert "domain: x = 0 .. 0.1 m, y = -0.1 .. 0.1 m, z = 5 .. 6 m" in table


@pytest.mark.parametrize(("name", "given"), [
    (MECH, {"domain": {"x": (0.9, 1.0), "z": (2.1, 2.2)}}),  # within the box around the reach
    ("4-ups-rps", {"domain": {"x": (400, 420), "y": (300, 400)}}),
    ("3-cur", {"working_mode": "up-down-up"}),
])  # fmt: skip
def test_emptiness_is_proven_by_bisection(name, given):
    claim = api.certify(name, **given)
    assert (claim.verdict, claim.reachable, claim.stopped) == ("empty", "none", "proven")


def test_what_only_touches_the_reach_is_undecided():
    claim = api.certify("3-ups-sp", domain={"l4": (90, 95)}, min_lci=0.01)
    assert (claim.verdict, claim.reachable, claim.stopped) == ("undecided", "unknown", "edge")
    assert claim.open_share == 1


def test_out_of_time_is_not_empty():
    claim = api.certify("4-ups-rps", domain={"x": (400, 420), "y": (300, 400)}, time_budget=1e-9)
    assert claim.verdict == "undecided"


def test_proven_is_about_some_pose():
    """A box that holds its claim, with reachable poses in a corner only: one is found."""
    claim = api.certify(MECH, domain={"x": (0.0, 0.1), "y": (-0.1, 0.1), "z": (1.3, 1.5)})
    assert (claim.verdict, claim.reachable) == ("proven", "all")
    claim = api.certify("3-cur", limits={"h1": (0.25, 0.3)})
    assert (claim.verdict, claim.reachable) == ("proven", "some")


# --- boxes --------------------------------------------------------------------------------


def test_boxes_are_printed_as_given(tmp_path):
    box = "x=-9.87654321:0.30000000000000004,y=-0.1:0.7,z=1.23456789:inf"
    words = ("--domain", box, "--limits", "d=-0.123456789:0.987654321")
    found = json_answer("workspace", MECH, *words, "--samples", 4096, cwd=tmp_path)
    assert found["domain"]["x"] == [-9.87654321, 0.30000000000000004]
    assert found["domain"]["y"] == [-0.1, 0.7]
    assert found["domain"]["z"][0] == 1.23456789 and found["domain"]["z"][1] < 3
    assert found["limits"] == {"d": [-0.123456789, 0.987654321]}
    result = here("certify", MECH, *words, "--time-budget", "0.1", cwd=tmp_path)
    assert "x = -9.87654321 .. 0.30000000000000004 m, y = -0.1 .. 0.7 m" in result.stdout
    motors = here("capability", MECH, "--motors", "d_rate=1.23456789", "--samples", 4096,
                  cwd=tmp_path).stdout  # fmt: skip
    assert "1.23456789" in motors


@pytest.mark.parametrize("box", ["z=1:1", "z=2:1", "z=nan:1"])
@pytest.mark.parametrize("command", ["certify", "workspace", "capability", "singularities"])
def test_boxes_without_width_are_bad_input(command, box, tmp_path):
    assert "--domain: z=" in error_line(here(command, MECH, "--domain", box, cwd=tmp_path))
