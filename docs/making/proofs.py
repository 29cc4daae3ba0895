"""Figures of guaranteed bounds: the pages of certificates and of performance."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

import pmopt.api
from making.figures import ANYTHING
from making.pages import Says, Statement
from making.registry import add
from pmopt.analysis.certification.volume import CertifiedVolume
from pmopt.mechanisms import find

PAGE, SPEED = "docs/certificates.md", "docs/performance.md"
#: Mechanism, gap, digits of the bounds in the page of performance (None: not there), slow.
CASES = (
    ("2pauu-ppap", "1e-3", ".4f", False),
    ("2pauu-ppap", "1e-4", ".5f", False),
    ("3-cur", "1e-2", ".5f", False),
    ("3-cur", "1e-3", None, False),
    ("2uu-upu", "1e-1", None, False),
    ("2uu-upu", "1e-2", ".5f", False),
    ("2uu-upu", "6e-3", None, True),
    ("3-ups-sp", "2e-2", ".1f", True),
    ("3-ups-sp", "1e-2", None, True),
    ("4-ups-rps", "5e-2", ".3e", True),
    ("4-ups-rps", "2.7e-2", None, True),
)


def _bounds(found: CertifiedVolume, form: str) -> tuple[str, str]:
    """Return both bounds, rounded outwards."""
    texts = []
    for value, away in ((found.lower, math.floor), (found.upper, math.ceil)):
        digits = int(form[1:-1])
        exponent = math.floor(math.log10(value)) if form.endswith("e") else 0
        scale = 10.0 ** (digits - exponent)
        texts.append(format(away(value * scale) / scale, form).replace("e+0", "e"))
    return texts[0], texts[1]


def _case(name: str, gap: str, form: str | None) -> Iterator[Statement]:
    found = pmopt.api.certify_volume(name, gap=float(gap))
    title = find(name).title.partition(":")[0].partition(" (")[0]
    boxes = f"{found.boxes:.1e}".replace("e+0", "e")
    yield Says(PAGE, f"| {title} | {gap} | {{}} s | {{}} |", (ANYTHING, boxes))
    if form is not None:
        yield Says(SPEED, f"| {title} | {gap} | {{}} to {{}} {found.volume_unit} |",
                   _bounds(found, form))  # fmt: skip


for _name, _gap, _form, _slow in CASES:
    add(
        f"bounds-{_name}-{_gap}",
        functools.partial(_case, _name, _gap, _form),
        f"guaranteed bounds of {_name} to {_gap}, and boxes",
        _slow,
    )
