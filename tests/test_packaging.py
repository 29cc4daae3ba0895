"""What an installation says of itself: versions, requirements, licences."""

import re
import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location

import pytest
from support.cli_runner import CONFIGS, environment, pmopt

import pmopt as package

ROOT = CONFIGS.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
#: Extras that only development needs; their bounds are not tested.
DEVELOPMENT = {"test", "docs", "all"}


def names(requirements):
    return dict(re.fullmatch(r"([A-Za-z0-9_.-]+)>=([0-9.]+)", r).groups() for r in requirements)


def pins(name):
    lines = (ROOT / name).read_text().splitlines()
    return {
        k.lower(): v for k, v in (line.split("==") for line in lines if not line.startswith("#"))
    }


def required():
    extras = PROJECT["project"]["optional-dependencies"]
    found = names(PROJECT["project"]["dependencies"]) | names(PROJECT["build-system"]["requires"])
    for extra, requirements in extras.items():
        if extra not in DEVELOPMENT:
            found |= names(requirements)
    return found


def numbers(version):
    """Return the numbers of a version, without zeros at the end."""
    found = [int(part) for part in version.split(".")]
    while found and not found[-1]:
        found.pop()
    return found


def test_lowest_versions_are_those_that_are_tested():
    lowest = pins("constraints-lowest.txt")
    assert {k: numbers(v) for k, v in lowest.items()} == {
        k: numbers(v) for k, v in required().items()
    }


def test_every_requirement_is_pinned_within_its_bound():
    exact = pins("constraints.txt")
    for name, bound in required().items():
        assert numbers(exact[name]) >= numbers(bound), name


def test_versions(tmp_path):
    for words in (["-m", "pmopt", "--version"], ["-c", "import pmopt; print(pmopt.__version__)"]):
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment(), check=True,
                              capture_output=True, text=True)  # fmt: skip
        assert done.stdout.split()[-1] == package.__version__
    assert pmopt("--version", cwd=tmp_path).stdout == f"pmopt, version {package.__version__}\n"
    (script,) = entry_points(group="console_scripts", name="pmopt")
    assert callable(script.load())


def test_the_page_of_licences():
    """As docs/licences.py makes it of what is installed, where that is what constraints.txt has."""
    spec = spec_from_file_location("licences", ROOT / "docs" / "licences.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    page = (ROOT / "docs" / "licences.md").read_text()
    rows = dict(re.findall(r"^\| (\S+) \| (.+) \|$", page, re.MULTILINE))
    runtime = set(required()) - {"hatchling"}
    assert runtime <= set(rows)
    assert rows["moocore"].startswith("LGPL")
    assert "not named" not in rows.values()
    from importlib.metadata import PackageNotFoundError, version

    for name, pinned in pins("constraints.txt").items():
        try:
            if name in rows and version(name) != pinned:
                pytest.skip(f"{name} {version(name)} is installed, not {pinned}")
        except PackageNotFoundError as error:
            pytest.skip(f"{error.name} is not installed")
    assert module.page() == page
