"""What the page of 2UU-UPU says of its paper's equations is what the script finds."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_the_page_quotes_the_script():
    result = subprocess.run(
        [sys.executable, ROOT / "docs" / "claims.py"], capture_output=True, text=True, check=True
    )
    page = (ROOT / "docs" / "mechanisms" / "2uu-upu.md").read_text()
    figures = re.findall(r"\d+\.\d+ (?:mrad/s|%|mm)|\d+ of \d+ instants", result.stdout)
    assert len(figures) == 5
    for figure in figures:
        assert figure in page
