"""Makes docs/licences.md: the licence of everything that pmopt installs.

Run it with: python docs/licences.py
"""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path

from packaging.requirements import Requirement

HERE = Path(__file__).parent
#: Extras that only the development of pmopt needs.
DEVELOPMENT = {"test", "docs", "all"}
#: Of packages whose metadata names no licence; their licence files do.
NAMED = {
    "cmeel-qhull": "Qhull licence",
    "graphemeu": "MIT",
    "matplotlib": "PSF-based (Matplotlib licence)",
    "scipy": "BSD-3-Clause",
}

HEAD = """\
# Licences

pmopt is under the [MIT licence](../LICENSE). It contains no code of other packages and installs
those below; each stays under its own licence. Names are as the packages' own metadata has them,
in the versions of [constraints.txt](../constraints.txt); `python docs/licences.py` makes this
page.

All but one are permissive. **moocore** (hypervolumes), which pymoo needs too, is under the LGPL,
version 2.1 or later. pmopt imports it unchanged, as a library that can be replaced, so that pmopt
and what you compute or write with it are free of the LGPL's terms. Who passes moocore on, within
a container or a bundled program, passes on its licence and the offer of its source, and leaves it
replaceable, as an ordinary installation of Python packages does.

Wheels may carry further libraries (NumPy and SciPy an OpenBLAS and the GCC runtime, pin and
MuJoCo their own); the licence files in a package's `*.dist-info` folder name them.
"""


def canonical(name: str) -> str:
    """Return a package's name as indices have it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def licence(name: str) -> str:
    """Return the licence that a package names."""
    found = metadata(name)
    classes = [
        value.rpartition(" :: ")[2]
        for value in found.get_all("Classifier") or []
        if value.startswith("License :: OSI")
    ]
    text = found.get("License-Expression") or found.get("License") or ""
    given = text if "\n" not in text and 0 < len(text) < 80 else ", ".join(classes)
    return NAMED.get(canonical(name), given or "not named")


def needed(requirements: list[str]) -> list[Requirement]:
    """Return the requirements that hold here."""
    found = [Requirement(text) for text in requirements]
    return [r for r in found if r.marker is None or r.marker.evaluate({"extra": ""})]


def brought(names: list[str], known: set[str]) -> list[str]:
    """Return what packages bring, and what that brings, beside what is known."""
    new: set[str] = set()
    waiting = list(names)
    while waiting:
        try:
            found = needed(requires(waiting.pop()) or [])
        except PackageNotFoundError:  # a system's own, such as a toolkit for windows
            continue
        for name in (canonical(r.name) for r in found):
            if name not in known | new:
                new.add(name)
                waiting.append(name)
    return sorted(new)


def table(names: list[str]) -> list[str]:
    """Return the rows of a table."""
    return ["| package | licence |", "|---|---|", *(f"| {n} | {licence(n)} |" for n in names)]


def page() -> str:
    """Return the page's text."""
    project = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]
    names = sorted(canonical(r.name) for r in needed(project["dependencies"]))
    known = set(names)
    lines = [HEAD, "## What pmopt needs", "", *table(names)]
    more = brought(names, known)
    known |= set(more)
    lines += ["", "## What these bring", "", *table(more)]
    for extra, requirements in project["optional-dependencies"].items():
        if extra in DEVELOPMENT:
            continue
        own = [canonical(r.name) for r in needed(requirements)]
        own = [name for name in own if name != "pmopt" and name not in known]
        more = brought(own, known | set(own))
        lines += ["", f"## Extra `{extra}`", "", *table(sorted([*own, *more]))]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    (HERE / "licences.md").write_text(page(), encoding="utf-8")
