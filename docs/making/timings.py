"""What is not made here: times, measured by benchmarks, and studies of many runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from making.pages import ROOT, Finding, Page
from making.registry import maker


@dataclass(frozen=True)
class Elsewhere:
    """Figures of a section that another program measures, or a study did.

    ``by`` is what measures them again; where it begins with a path that path has to be there.
    """

    page: str
    section: str
    by: str


PERFORMANCE, SCALING, RELIABILITY = (
    f"docs/{name}.md" for name in ("performance", "scaling", "reliability")
)
#: Times, and counts of killed processes: of the machine.
MEASURED = (
    Elsewhere("README.md", "## Speed", "benchmarks/accuracy.py, kernels.py and commands.py"),
    Elsewhere(PERFORMANCE, "## Kernels against C", "benchmarks/kernels.py"),
    Elsewhere(PERFORMANCE, "## Time to 0.1 %", "benchmarks/accuracy.py"),
    Elsewhere(PERFORMANCE, "## A guaranteed volume", "the times: pmopt workspace MECH --certify"),
    Elsewhere(PERFORMANCE, "## The search", "benchmarks/fidelity.py"),
    Elsewhere(PERFORMANCE, "## Whole commands", "benchmarks/commands.py"),
    Elsewhere(PERFORMANCE, "## Scale", "benchmarks/scaling.py --out docs/images"),
    Elsewhere(PERFORMANCE, "## What helped", "benchmarks/kernels.py, before and after"),
    Elsewhere("docs/certificates.md", "## Figures", "the times: pmopt workspace MECH --certify"),
    Elsewhere("docs/dynamics.md", "## Inverse dynamics", "benchmarks/dynamics.py"),
    Elsewhere(SCALING, "## What it costs, and where it ends", "benchmarks/cluster.py"),
    Elsewhere(RELIABILITY, "## No run is lost", "tests/support/campaign.py"),
    Elsewhere(RELIABILITY, "## Bad input is one line", "tests/support/campaign.py"),
)
#: Studies of many designs, seeds or poses, repeated in the small by tests.
STUDIES = (
    Elsewhere(
        "docs/method.md", "## Poses of mixed freedom", "tests/analysis/workspace/test_positions.py"
    ),
    Elsewhere(
        "docs/method.md",
        "## Inverse and forward kinematics",
        "tests/analysis/kinematics/test_forward.py",
    ),
    Elsewhere("docs/method.md", "## Speed", "tests/kernels/test_kernel_functions.py"),
    Elsewhere("docs/mechanisms/3-cur.md", "## Equations", "tests/mechanisms/catalogue/test_cur.py"),
    Elsewhere("docs/certificates.md", "## Figures", "tests/analysis/certification/test_certify.py"),
)


def summary() -> str:
    """Return a line for each section that is measured elsewhere."""
    lines = [f"measured: {e.page}, {e.section.lstrip('# ')}: {e.by}" for e in MEASURED]
    lines += [f"study: {e.page}, {e.section.lstrip('# ')}: {e.by} repeats it" for e in STUDIES]
    return "\n".join(lines)


@maker("measured-elsewhere")
def sections() -> Iterator[Finding]:
    """Check that sections measured elsewhere exist, and the scripts that measure them."""
    for each in (*MEASURED, *STUDIES):
        lines = Page.read(each.page).text.split("\n")
        if each.section not in lines:
            yield Finding(each.page, 1, each.section, "no such section")
        path = each.by.partition(" ")[0].rstrip(",")
        if "/" in path and not (ROOT / path).is_file():
            yield Finding(each.page, 1, path, "no such file")
