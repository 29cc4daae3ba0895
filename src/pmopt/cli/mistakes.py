"""What a command line that click refuses may have meant, in one line."""

from __future__ import annotations

from collections.abc import Sequence

import click

from pmopt.cli.commands import COMMANDS, cli
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism, find, names


def explain(error: click.ClickException, words: Sequence[str]) -> str:
    """Return click's message, or a better one where it is clear what was meant."""
    found = None
    if isinstance(error, click.NoSuchOption):
        found = _option(error, words)
    elif isinstance(error, click.MissingParameter) and error.param is not None:
        found = _missing(error.param)
    elif isinstance(error, click.UsageError) and "unexpected extra argument" in error.message:
        found = _argument(error, words)
    return found or error.format_message()


def _mechanism(words: Sequence[str]) -> Mechanism | None:
    for word in words[1:]:
        try:
            return find(word)
        except InputError:
            continue
    return None


def _options(name: str) -> set[str]:
    command = cli.get_command(click.Context(cli), name)
    return {o for p in command.params for o in p.opts} if command else set()


def _place(mechanism: Mechanism, name: str, options: set[str]) -> str | None:
    """Return the option that takes a name's value."""
    base = name.removesuffix("_deg")
    groups = (
        ("--params", [p.name for p in mechanism.parameters]),
        ("--pose", [c.name for c in mechanism.pose]),
        ("--joints", [c.name for c in mechanism.joints]),
        ("--domain", [c.name for c in mechanism.pose]),
        ("--limits", [c.name for c in mechanism.limited]),
    )
    return next((o for o, known in groups if base in known and o in options), None)


def _option(error: click.NoSuchOption, words: Sequence[str]) -> str | None:
    """Explain ``--l1 0.8``, and an option of another command."""
    name = error.option_name.lstrip("-").replace("-", "_").partition("=")[0]
    command = words[0] if words else ""
    mechanism = _mechanism(words)
    if mechanism is not None:
        place = _place(mechanism, name, _options(command))
        if place is not None:
            span = "LOWER:UPPER" if place in ("--domain", "--limits") else "VALUE"
            return f"{error.option_name} is not an option: {place} {name}={span} is"
    having = [other for other in COMMANDS if error.option_name in _options(other)]
    if having and command in COMMANDS:
        return (
            f"{error.option_name} is not an option of pmopt {command}, but of "
            f"{', '.join(having)}; pmopt {command} --help lists its own"
        )
    return None


def _argument(error: click.UsageError, words: Sequence[str]) -> str | None:
    """Explain pairs without their option, or with a space between them."""
    command = words[0] if words else ""
    mechanism = _mechanism(words)
    pairs = [word for word in words[1:] if "=" in word and not word.startswith("-")]
    if mechanism is None or not pairs:
        return None
    places: dict[str, list[str]] = {}
    for pair in ",".join(pairs).split(","):
        name = pair.partition("=")[0].strip()
        place = _place(mechanism, name, _options(command))
        if place is None:
            return None
        places.setdefault(place, []).append(pair)
    meant = " ".join(f"{place} {','.join(given)}" for place, given in places.items())
    return f"pairs are joined by commas, without spaces, behind their option: {meant}"


def _missing(param: click.Parameter) -> str | None:
    if param.name == "mechanism":
        return f"MECH is missing: one of {', '.join(names())}"
    if param.name == "config":
        return "CONFIG.toml is missing: pmopt init MECH writes one"
    return None
