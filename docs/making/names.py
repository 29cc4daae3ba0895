"""What documents mention of the program itself: names of tests and files, and its constants."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator

from making.pages import ROOT, Finding, Page, Says, Statement, documents
from making.registry import maker

_TEST = re.compile(r"`(?:(test_\w+\.py))?::(test_\w+)`")
_TOML = re.compile(r"^```toml\n(.*?)^```", re.DOTALL | re.MULTILINE)
_FILE = re.compile(r"`((?:tests|benchmarks|configs|docs|src|notebooks)/[\w/.-]+\.\w+)`")


@maker("tests-of-promises")
def tests() -> Iterator[Finding]:
    """Check that every test named in the page of reliability is there."""
    page = Page.read("docs/reliability.md")
    text = ""
    for number, line in enumerate(page.text.split("\n"), start=1):
        for found in _TEST.finditer(line):
            if found[1] is not None:
                (path,) = [*(ROOT / "tests").rglob(found[1]), None][:1]
                text = path.read_text() if path is not None else ""
            if f"def {found[2]}(" not in text:
                yield Finding(page.path, number, found[0], "no such test")


@maker("files")
def files() -> Iterator[Finding]:
    """Check that every file that a document names is there."""
    for path in documents():
        page = Page.read(path)
        for found in _FILE.finditer(page.text):
            if not (ROOT / found[1]).exists():
                line = page.text.count("\n", 0, found.start()) + 1
                yield Finding(path, line, found[1], "no such file")


@maker("toml")
def toml() -> Iterator[Finding]:
    """Check that every TOML text of a document can be read."""
    for path in documents():
        page = Page.read(path)
        for found in _TOML.finditer(page.text):
            try:
                tomllib.loads(found[1])
            except tomllib.TOMLDecodeError as error:
                line = page.text.count("\n", 0, found.start()) + 1
                yield Finding(path, line, "a text in TOML", str(error))


@maker("constants")
def constants() -> Iterator[Statement]:
    """Yield sizes that the program chooses: grids, first samples, blocks, times to wait."""
    from pmopt.analysis.certification.bisection import MAX_OPEN
    from pmopt.analysis.sampling.aspects import CELLS
    from pmopt.analysis.sampling.tallies import BLOCK_CHUNKS, CHUNK
    from pmopt.analysis.settings import DEFAULT_REPLICATES
    from pmopt.analysis.workspace.shape import DEFAULT_GRIDS
    from pmopt.execution.scheduler import PATIENCE
    from pmopt.kernels.sweep import BLOCK
    from pmopt.mechanisms.bodies import STEEL
    from pmopt.reporting.runs.workspace_checkpoint import EVERY
    from pmopt.synthesis.config import FinalSettings
    from pmopt.synthesis.problem import FINAL_SAMPLES, FIRST_ON_LINES, FIRST_SAMPLES
    from pmopt.synthesis.reference import CORNERS, DESIGNS

    def power(value: int) -> str:
        return f"2^{value.bit_length() - 1}"

    final = FinalSettings().target_error
    for page, text, *figures in (
        ("method", "divided over about {} independent", str(DEFAULT_REPLICATES)),
        ("method", "on coarser grids ({} and {} cells an axis)", *map(DEFAULT_GRIDS.get, (4, 5))),
        ("method", "separated on a grid ({} cells an axis in three dimensions, {} in four, {} in "
         "five)", CELLS[3], CELLS[4], CELLS[5]),
        ("method", "search starts with {} ({} on lines)", f"{FIRST_SAMPLES:,}",
         f"{FIRST_ON_LINES:,}"),
        ("method", "of `[final]` ({} % unless set; at most {} samples a design)",
         f"{100 * final:g}", power(FINAL_SAMPLES)),
        ("method", "over a fixed sample of {} quasi-random designs of the bounds and up to {} of "
         "their corners", f"{DESIGNS:,}", CORNERS),
        ("method", "Points are taken in blocks of {}:", BLOCK),
        ("reliability", "in blocks of {} chunks (of {} points, all", BLOCK_CHUNKS, power(CHUNK)),
        ("reliability", "a scheduler without workers at the beginning | {} s |", f"{PATIENCE:g}"),
        ("reliability", "the sums so far are written every {} seconds",
         {2.0: "two"}.get(EVERY, f"{EVERY:g}")),
        ("motion", "with `density` (kg/m^3, default {})", f"{STEEL:g}"),
        ("certificates", "a budget is spent or {} million boxes",
         {4: "four"}.get(MAX_OPEN >> 20, str(MAX_OPEN >> 20))),
    ):  # fmt: skip
        yield Says(f"docs/{page}.md", text, tuple(map(str, figures)))
