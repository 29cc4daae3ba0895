"""The commands that documents print: each is run as printed, or the reason why not is given."""

from __future__ import annotations

import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from making.pages import IMAGES, ROOT, Finding, Page, documents
from making.registry import add

#: What is not run, and why; its options are checked where it is a command of ours.
NOT_RUN = {
    r"-m venv |pip install|-m pytest|^pytest|^ruff|^mypy": "sets up, or is run by .ci/run",
    r"^dask |--scheduler|^export DASK|--merge|--shard": "needs other machines",
    r"mujoco\.viewer": "opens a window",
    r"studies/|my-design\.toml --set|strokes\.gif": "takes files of the reader, or long",
    r"^python (benchmarks|tests)/": "measures times",
    r"docs/make\.py|^bash ": "is what runs this",
}
#: What is shortened, and by what.
SHORTER = {"--samples 1e9": "--samples 1e6"}
#: What runs in the full run alone.
SLOW = r"pmopt batch configs|pmopt warmup|pmopt pareto configs/2pauu-ppap"
#: What ends with another exit code than 0, and which.
EXITS = {r"4-ups-rps-paper|2uu-upu-eq16": 2}
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_SPAN = re.compile(r"`(pmopt [^`]*)`")
#: A placeholder, or what is left out.
_OPEN = re.compile(r"[ /][A-Z]+\b|\.\.(?![\w/])|[\[{|]")
_INDENTED = re.compile(r"^ {4}(pmopt (?:[^\n]*\\\n)*[^\n]*)$", re.MULTILINE)
_INTERPRETERS = {"sh": ("bash", "-c"), "python": (sys.executable, "-c")}
_TIMEOUT = 900


@dataclass(frozen=True)
class Printed:
    """A command of a document, or a program in Python."""

    page: str
    line: int
    text: str
    language: str = "sh"


def printed_commands(page: Page) -> list[Printed]:
    """Return the commands of a document, in order: of fences, of indented blocks, of sentences."""
    found: list[tuple[int, str]] = []
    for fence in _FENCE.finditer(page.text):
        if fence[1] == "sh":
            found += _lines(fence[2], fence.start(2))
        elif fence[2].startswith("$ "):
            found += [(fence.start(2), fence[2].split("\n")[0][2:])]
    prose = _FENCE.sub(lambda f: re.sub(r"[^\n]", " ", f[0]), page.text)
    found += [(m.start(), _joined(m[1])) for m in _INDENTED.finditer(prose)]
    programs = [
        Printed(page.path, page.text.count("\n", 0, fence.start(2)) + 1, fence[2], fence[1])
        for fence in _FENCE.finditer(page.text)
        if fence[1] == "python" and not fence[2].startswith(">>>")
    ]
    known = {_bare(text) for _, text in found}
    for span in _SPAN.finditer(prose):
        text = " ".join(span[1].split())
        if not _OPEN.search(text) and len(text.split()) > 2 and text not in known:
            known.add(text)
            found.append((span.start(), text))
    lines = [Printed(page.path, page.text.count("\n", 0, at) + 1, text) for at, text in found]
    return lines + programs


def _lines(block: str, start: int) -> Iterator[tuple[int, str]]:
    """Yield the commands of a block; one goes on where a quote or a backslash leaves it open."""
    lines, at = block.split("\n"), start
    while lines:
        text = lines.pop(0)
        while lines and (text.endswith("\\") or _bare(text).count('"') % 2):
            text += f"\n{lines.pop(0)}"
        if _bare(text):
            yield at, _joined(text)
        at += len(text) + 1


def _joined(text: str) -> str:
    return re.sub(r"\\\n\s*", "", text).strip()


def _bare(text: str) -> str:
    """Return a command without its remark."""
    return re.sub(r"\s+#.*$", "", text, flags=re.MULTILINE).strip()


def _reason(text: str) -> str | None:
    """Return why a command is not run, None where it is."""
    return next((why for what, why in NOT_RUN.items() if re.search(what, _bare(text))), None)


def _slow(text: str) -> bool:
    return bool(re.search(SLOW, _bare(text)))


def _run_page(path: str, slow: bool) -> Iterator[Finding]:
    """Run the commands of a document one after the other in a folder of their own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("configs", "notebooks", "docs"):
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("*.png"))
        (folder / "outputs").mkdir()
        environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "COLUMNS": "120",
        }
        for command in all_commands()[path]:
            if _reason(command.text) is not None:
                yield from _check_options(command, folder)
            elif _slow(command.text) == slow:
                yield from _run_command(command, folder, environment)


def _run_command(command: Printed, folder: Path, env: dict[str, str]) -> Iterator[Finding]:
    text = functools.reduce(lambda t, k: t.replace(k, SHORTER[k]), SHORTER, command.text)
    wanted = next((code for what, code in EXITS.items() if re.search(what, text)), 0)
    try:
        result = subprocess.run(
            [*_INTERPRETERS[command.language], text], cwd=folder, env=env, timeout=_TIMEOUT,
            capture_output=True, text=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        yield Finding(command.page, command.line, command.text, f"takes more than {_TIMEOUT} s")
        return
    if result.returncode != wanted:
        said = (result.stderr.strip() or result.stdout.strip()).split("\n")[-1]
        now = f"exit code {result.returncode}: {said}"
        first = _bare(command.text).split("\n")[0]
        yield Finding(command.page, command.line, first, now)


def _check_options(command: Printed, folder: Path) -> Iterator[Finding]:
    """Check the options of a command of ours that is not run."""
    import shlex

    import click

    from pmopt.cli.commands import COMMANDS, LazyGroup

    words = shlex.split(_bare(command.text))
    if words[0] != "pmopt":
        return
    if words[1] not in COMMANDS:
        yield Finding(command.page, command.line, command.text, f"no command {words[1]}")
        return
    found = LazyGroup().get_command(click.Context(LazyGroup()), words[1])
    known = {o for p in (found.params if found else []) for o in (*p.opts, *p.secondary_opts)}
    for word in words[2:]:
        option = word.partition("=")[0]
        if option.startswith("--") and option not in known:
            yield Finding(command.page, command.line, command.text, f"no option {option}")


def all_commands() -> dict[str, list[Printed]]:
    """Return the commands of each document; one that stands in two is run where it comes first."""
    found: dict[str, list[Printed]] = {}
    known: set[str] = set()
    for path in documents():
        if path.startswith(IMAGES):
            continue  # made by pictures.py, which runs them
        found[path] = []
        for command in printed_commands(Page.read(path)):
            text = re.sub(r" --out \S+| --force", "", _bare(command.text))
            if text not in known or "--resume" in text:
                known.add(text)
                found[path].append(command)
    return found


def add_commands() -> None:
    """Register a maker for the commands of each document."""
    for path, printed in all_commands().items():
        runs = [c.text for c in printed if _reason(c.text) is None]
        name = Path(path).stem if "mechanisms" in path or path == "README.md" else path[5:-3]
        for slow in (False, True):
            of = [text for text in runs if _slow(text) == slow]
            if of or (printed and not slow):
                add(
                    f"commands-{name}{'-slow' if slow else ''}",
                    functools.partial(_run_page, path, slow),
                    f"{path}: {len(of)} commands run",
                    slow,
                )
