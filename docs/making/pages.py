"""What is stated of the documents, and the documents with what is stated put in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from making.figures import ANYTHING, Figure, plain

ROOT = Path(__file__).resolve().parents[2]
IMAGES = "docs/images"
_SLOT = "{}"
#: Longest text that stands for a slot.
_LONGEST = 90


@dataclass(frozen=True)
class Says:
    """A page says something, with figures where the braces are.

    Attributes
    ----------
    page : str
        Its path from the top of the checkout.
    text : str
        As the page has it, up to spaces and line ends; once in the page.
    figures : tuple of Figure or str
        What stands for each ``{}``; a text has to agree letter by letter.
    """

    page: str
    text: str
    figures: tuple[Figure | str, ...] = ()

    def __post_init__(self) -> None:
        if self.text.startswith(_SLOT) or self.text.endswith(_SLOT):
            raise ValueError(f"{self.text!r}: words are needed on either side of a figure")
        if self.text.count(_SLOT) != len(self.figures):
            raise ValueError(f"{self.text!r}: {len(self.figures)} figures are given")


@dataclass(frozen=True)
class Block:
    """What stands between ``<!-- make: NAME -->`` and ``<!-- end -->``: lines of cells."""

    page: str
    name: str
    lines: tuple[tuple[Figure | str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A picture of ``docs/images``."""

    name: str
    data: bytes


Statement = Says | Block | Picture


def table(
    page: str, name: str, head: Sequence[str], rows: Iterable[Sequence[Figure | str]]
) -> Block:
    """Return a Markdown table as a block."""
    return Block(page, name, (tuple(head), ("---",) * len(head), *map(tuple, rows)))


def verbatim(page: str, name: str, text: str, language: str = "") -> Block:
    """Return text in a fence as a block."""
    lines = [f"```{language}", *text.splitlines(), "```"]
    return Block(page, name, tuple((line,) for line in lines))


@dataclass(frozen=True)
class Finding:
    """Something of a document that no longer holds; ``mended`` where rewriting mends it."""

    page: str
    line: int
    printed: str
    now: str
    mended: bool = False

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: printed {self.printed}, now {self.now}"


@dataclass
class Page:
    """A document that is compared with what is stated of it."""

    path: str
    text: str
    findings: list[Finding] = field(default_factory=list)
    _changes: list[tuple[int, int, str]] = field(default_factory=list)

    @classmethod
    def read(cls, path: str) -> Page:
        """Return a document of the checkout."""
        return cls(path, (ROOT / path).read_text(encoding="utf-8"))

    @property
    def rewritten(self) -> str:
        """The document with every figure as it is now."""
        text = self.text
        for begin, end, new in sorted(self._changes, reverse=True):
            text = text[:begin] + new + text[end:]
        return text

    def compare(self, statement: Says | Block) -> None:
        """Note what of a statement does not hold, and what would stand there."""
        if isinstance(statement, Says):
            self._compare_text(statement)
        else:
            self._compare_block(statement)

    def _compare_text(self, says: Says) -> None:
        found = list(_pattern(says.text).finditer(self.text))
        if len(found) != 1:
            how = "nowhere" if not found else f"{len(found)} times"
            said = says.text.format(*_texts(says.figures))
            self.findings.append(Finding(self.path, 1, how, said))
            return
        for k, figure in enumerate(says.figures, start=1):
            self._compare_figure(figure, found[0][k], found[0].start(k), found[0].end(k))

    def _compare_figure(self, figure: Figure | str, printed: str, begin: int, end: int) -> None:
        if figure == ANYTHING:
            return
        now = figure.text if isinstance(figure, Figure) else figure
        holds = figure.holds(printed) if isinstance(figure, Figure) else plain(printed) == now
        if not holds:
            line = self.text.count("\n", 0, begin) + 1
            self.findings.append(Finding(self.path, line, plain(printed), now, mended=True))
        if plain(printed) != plain(now):
            self._changes.append((begin, end, now))

    def _compare_block(self, block: Block) -> None:
        pattern = rf"<!-- make: {re.escape(block.name)} -->\n(.*?)<!-- end -->"
        found = list(re.finditer(pattern, self.text, re.DOTALL))
        if len(found) != 1:
            self.findings.append(
                Finding(self.path, 1, f"{len(found)} times", f"<!-- make: {block.name} -->")
            )
            return
        begin, end = found[0].span(1)
        text = "".join(f"{_line(cells)}\n" for cells in block.lines)
        if text != self.text[begin:end]:
            self._changes.append((begin, end, text))
        first = self.text.count("\n", 0, begin) + 1
        printed = found[0][1].removesuffix("\n").split("\n")
        if len(printed) != len(block.lines):
            sizes = (f"{len(printed)} lines", f"{len(block.lines)} of {block.name}")
            self.findings.append(Finding(self.path, first - 1, *sizes, mended=True))
            return
        for k, (line, cells) in enumerate(zip(printed, block.lines, strict=True)):
            parts = _cells(line) if len(cells) > 1 else [line]
            if len(parts) != len(cells):
                now = _line(cells)
                self.findings.append(Finding(self.path, first + k, line, now, mended=True))
                continue
            for part, cell in zip(parts, cells, strict=True):
                now = cell.text if isinstance(cell, Figure) else cell
                holds = cell.holds(part) if isinstance(cell, Figure) else plain(part) == plain(now)
                if not holds:
                    place = first + k
                    self.findings.append(Finding(self.path, place, plain(part), now, mended=True))


def _texts(figures: Sequence[Figure | str]) -> tuple[str, ...]:
    return tuple(f.text if isinstance(f, Figure) else f for f in figures)


def _line(cells: Sequence[Figure | str]) -> str:
    texts = _texts(cells)
    if len(texts) == 1:
        return texts[0]
    if set(texts) == {"---"}:
        return "|---" * len(texts) + "|"
    return re.sub(r"\|  (?=\|)", "| ", f"| {' | '.join(texts)} |")


def _cells(line: str) -> list[str]:
    """Return the cells of a row of a table."""
    return re.split(r"(?<!\\)\|", line.strip())[1:-1]


def _pattern(text: str) -> re.Pattern[str]:
    """Return what finds a text with braces, whatever its line ends."""
    parts = [r"\s+".join(map(re.escape, p.split(" "))) for p in text.split(_SLOT)]
    # A point or comma behind a figure is none within it.
    parts = [re.sub(r"^(\\\.|,)", r"\1(?!\\d)", part) for part in parts]
    return re.compile(rf"([^|`]{{1,{_LONGEST}}}?)".join(parts))


def documents() -> list[str]:
    """Return the paths of all documents, from the top of the checkout."""
    paths = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "benchmarks" / "README.md"]
    paths += sorted((ROOT / "docs").rglob("*.md"))
    return [path.relative_to(ROOT).as_posix() for path in paths]


def links(page: Page) -> Iterator[tuple[int, str]]:
    """Yield line and target of every link and picture of a document that are in the checkout."""
    for found in re.finditer(r"\]\(([^)#\s]+)(#[^)\s]*)?\)", page.text):
        if "://" not in found[1]:
            yield page.text.count("\n", 0, found.start()) + 1, found[1]
