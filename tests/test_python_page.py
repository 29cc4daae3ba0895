"""The page for Python users: what its examples print is what they print."""

import doctest
import re
from pathlib import Path

import matplotlib as mpl
import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "python.md"


def examples():
    blocks = re.findall(r"(?ms)^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"))
    assert blocks
    return "\n".join(blocks)


def test_the_page_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    test = doctest.DocTestParser().get_doctest(examples(), {}, PAGE.name, str(PAGE), 0)
    failures = []
    doctest.DocTestRunner(
        optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS, verbose=False
    ).run(test, out=failures.append)
    mpl.pyplot.close("all")
    if failures:
        pytest.fail("\n".join(failures))
    assert (tmp_path / "mechanism.png").stat().st_size > 1000
