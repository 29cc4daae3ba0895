"""Options are the fields of settings: each has one, with its unit, range, default and meaning."""

from typing import Annotated, Literal

import click
import pytest
from click.testing import CliRunner
from pydantic import Field
from support.cli_runner import here

from pmopt.analysis import settings
from pmopt.cli.commands import COMMANDS as EVERY_COMMAND
from pmopt.cli.fields import Sectioned, given_options, option_name, options_of
from pmopt.cli.main import cli
from pmopt.inputs.fields import LENGTH, Group, OnCommandLine, Unit
from pmopt.mechanisms import find

COMMANDS = {
    "workspace": [settings.WorkspaceSettings],
    "singularities": [settings.SingularitySettings],
    "certify": [settings.ClaimSettings],
    "capability": [settings.TaskSettings, settings.CapabilityWorkspace],
}
PAUU = find("2pauu-ppap")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_field_is_an_option(name):
    command = cli.get_command(click.Context(cli), name)
    found = {option for parameter in command.params for option in parameter.opts}
    for model in COMMANDS[name]:
        assert {option_name(model, field) for field in model.model_fields} <= found


@pytest.mark.parametrize("name", COMMANDS)
def test_no_two_options_are_passed_on_alike(name):
    command = cli.get_command(click.Context(cli), name)
    names = [parameter.name for parameter in command.params]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("width", ["60", "80", "140"])
@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_by_groups_and_fits(name, width, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", width)
    text = here(name, "--help", cwd=tmp_path).stdout
    titles = [line for line in text.splitlines() if line.endswith(":") and line[:1].strip()]
    assert titles[0] == "Design:"
    assert titles[-2:] == ["Run:", "Output:"]
    assert "Poses that count:" in titles
    assert "`" not in text
    assert not any(line.rstrip().endswith((">=", ">", "<=", "<")) for line in text.splitlines())
    written = [line for line in text.splitlines() if "pmopt " not in line]
    assert all(len(line) <= max(int(width), 66) for line in written)


@pytest.mark.parametrize("width", ["60", "80", "140"])
def test_what_keeps_lines_together_is_gone_from_every_help(width, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", width)
    for name in EVERY_COMMAND:
        text = here(name, "--help", cwd=tmp_path).stdout
        assert not {"\N{NON-BREAKING HYPHEN}", "\N{NO-BREAK SPACE}"} & set(text), name


class Tried(settings.Settings):
    """Settings that there are not: a new field is an option at once."""

    wall: Annotated[float | None, Unit(LENGTH), Group("Task")] = Field(
        default=None, gt=0, description="Thickness of a wall, as with `min_lci`"
    )
    turns: Annotated[int, Group("Task")] = Field(default=3, ge=1, le=9, description="How many")
    kind: Annotated[Literal["thin", "thick"], Group("Task")] = Field(
        default="thin", description="Which"
    )
    place: Annotated[tuple[float, float, float] | None, Unit(LENGTH), OnCommandLine("at")] = Field(
        default=None, strict=False, description="Where"
    )
    limits: settings.Limits = Field(default_factory=dict)


@click.command(cls=Sectioned)
@options_of(Tried)
def tried(**values):
    click.echo(Tried(**given_options(Tried, values, PAUU)).model_dump_json())


@pytest.mark.parametrize(("words", "part"), [
    (["--wall", "5mm"], '"wall":0.005'),
    (["--turns", "9"], '"turns":9'),
    (["--kind", "thick"], '"kind":"thick"'),
    (["--at", "1,20mm,0"], '"place":[1.0,0.02,0.0]'),
    (["--limits", "theta1_deg=-90:90"], '"limits":{"theta1":[-1.57'),
    ([], '"wall":null,"turns":3,"kind":"thin"'),
])  # fmt: skip
def test_a_new_field_is_an_option(words, part):
    result = CliRunner().invoke(tried, words)
    assert result.exit_code == 0, result.output
    assert part in result.output


def test_what_is_out_of_range_is_named_by_its_option():
    result = CliRunner().invoke(tried, ["--turns", "10"])
    assert str(result.exception) == "--turns: 10 is not allowed: a whole number 1 to 9 is needed"
    result = CliRunner().invoke(tried, ["--wall", "0"])
    assert str(result.exception) == "--wall: 0.0 is not allowed: a number > 0 is needed"


def test_help_says_unit_range_and_default():
    text = " ".join(CliRunner().invoke(tried, ["--help"]).output.split())
    assert "--wall X Thickness of a wall, as with --min-lci. [length unit; > 0]" in text
    assert "--turns N How many. [default: 3; 1 to 9]" in text
    assert "--kind [thin|thick] Which. [default: thin]" in text
    assert "--at X,Y,Z Where. [length unit]" in text
    assert "--limits JOINT=LOWER:UPPER,.. Ranges of joints by name" in text
