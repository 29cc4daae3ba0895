"""Names that documents mention: tests, and texts that the catalogue has."""

from __future__ import annotations

import re
from collections.abc import Iterator

from making.pages import ROOT, Finding, Page
from making.registry import maker

_TEST = re.compile(r"`(?:(test_\w+\.py))?::(test_\w+)`")
_FILE = re.compile(r"`((?:tests|benchmarks|configs|docs|src|notebooks)/[\w/.-]+\.\w+)`")


@maker("tests-of-promises")
def tests() -> Iterator[Finding]:
    """Check that every test named in the page of reliability is there."""
    page = Page.read("docs/reliability.md")
    text = ""
    for number, line in enumerate(page.text.split("\n"), start=1):
        for found in _TEST.finditer(line):
            if found[1] is not None:
                path = ROOT / "tests" / found[1]
                text = path.read_text() if path.is_file() else ""
            if f"def {found[2]}(" not in text:
                yield Finding(page.path, number, found[0], "no such test")


@maker("files")
def files() -> Iterator[Finding]:
    """Check that every file that a document names is there."""
    from making.pages import documents

    for path in documents():
        page = Page.read(path)
        for found in _FILE.finditer(page.text):
            if not (ROOT / found[1]).exists():
                line = page.text.count("\n", 0, found.start()) + 1
                yield Finding(path, line, found[1], "no such file")
