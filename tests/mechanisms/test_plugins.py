"""Mechanisms of other packages: found, checked once, and left out alone where they are broken."""

import json
import sys

import pytest
from support import plugins
from support.cli_runner import error_line, here, pmopt

from pmopt.mechanisms import find, left_out, names, registry
from pmopt.mechanisms.registry import PluginWarning
from pmopt.testing import MechanismError, kept

GOOD = """
from pmopt.mechanisms.catalogue.pauu_ppap import PauuPpap


class Other(PauuPpap):
    name = "other"


MECHANISM = Other()
"""
#: A structure with a name that no point has.
ASTRAY = """name = "astray"
    from dataclasses import replace

    one, *others = PauuPpap.structure.chains
    structure = replace(
        PauuPpap.structure, chains=(replace(one, bars=("a1", "c3", "d1")), *others)
    )
"""
BROKEN = {
    "lost": ("no_such_module:MECHANISM", None),
    "raises": ("plugged_raises:MECHANISM", "raise KeyError('a\\nb')\n"),
    "exits": ("plugged_exits:MECHANISM", "import sys\nsys.exit('bye')\n"),
    "empty": ("plugged_empty:MECHANISM", "x = 1\n"),
    "number": ("plugged_number:MECHANISM", "MECHANISM = 7\n"),
    "class": ("plugged_class:Other", GOOD),
    "double": ("plugged_double:MECHANISM", GOOD.replace('"other"', '"3-CUR"')),
    "nameless": ("plugged_nameless:MECHANISM", GOOD.replace('"other"', '"-"')),
    "old": (
        "plugged_old:MECHANISM",
        GOOD.replace('name = "other"', 'name = "old"\n    structure = None'),
    ),
    "astray": ("plugged_astray:MECHANISM", GOOD.replace('name = "other"', ASTRAY)),
    "unnamed": ("plugged_unnamed:MECHANISM", GOOD.replace('"other"', "None")),
}
#: What stands in the line of each.
REASONS = {
    "lost": "ModuleNotFoundError: No module named 'no_such_module'",
    "raises": "KeyError: 'a\\nb'",
    "exits": "SystemExit: bye",
    "empty": "AttributeError: module 'plugged_empty' has no attribute 'MECHANISM'",
    "number": "it is no Mechanism",
    "class": "it is a class: the entry point has to name an instance",
    "double": "there is a mechanism '3-CUR' already, of pmopt.mechanisms.catalogue.cur",
    "nameless": "its name '-' has no letter or digit",
    "old": "it declares no structure, from which layout, skeleton and posture come",
    "astray": "InputError: structure: point or vector: unknown name 'c3', allowed: a1, a2, c1, c2, "
    "d1, d2, p, foot; nearest: c2",
    "unnamed": "AttributeError: 'NoneType' object has no attribute 'casefold'",
}


@pytest.fixture
def plugged(monkeypatch, tmp_path):
    """Return a function that installs plug-ins for this test."""
    before = set(sys.modules)

    def install(entries):
        plugins.install(tmp_path / "site", entries)
        monkeypatch.syspath_prepend(tmp_path / "site")
        registry._registry.cache_clear()
        return tmp_path / "site"

    monkeypatch.setenv("PMOPT_CACHE_DIR", str(tmp_path / "cache"))
    yield install
    registry._registry.cache_clear()
    kept.require_checked.cache_clear()
    for name in set(sys.modules) - before:
        if name.startswith("plugged"):
            del sys.modules[name]


def test_a_broken_plugin_leaves_the_others_alone(plugged):
    before = names()
    plugged({"good": ("plugged_good:MECHANISM", GOOD), **BROKEN})
    with pytest.warns(PluginWarning) as caught:
        found = names()
    assert set(found) == {*before, "other"}
    lines = [str(w.message) for w in caught]
    assert len(lines) == len(BROKEN) == len(left_out())
    for name, (value, _) in BROKEN.items():
        assert f"plug-in {name!r} ({value}) is left out: {REASONS[name]}" in lines
    assert find("other").name == "other"
    assert find("3-cur") is registry._registry().found["3cur"]


def test_one_line_each_on_the_command_line(plugged, tmp_path):
    site = plugged({"good": ("plugged_good:MECHANISM", GOOD), "raises": BROKEN["raises"]})
    env = {"PYTHONPATH": str(site)}
    line = f"plug-in 'raises' (plugged_raises:MECHANISM) is left out: {REASONS['raises']}"
    result = pmopt("list", cwd=tmp_path, env=env)
    assert result.returncode == 0
    assert result.stderr == f"warning: {line}\n"
    assert line in result.stdout.replace("\n  ", " ")
    assert "other" in result.stdout
    document = json.loads(pmopt("list", "--format", "json", cwd=tmp_path, env=env).stdout)
    assert [p["plugin"] for p in document["left_out"]] == ["raises"]
    result = pmopt("info", "2pauu-ppap", "--quiet", cwd=tmp_path, env=env)
    assert (result.returncode, result.stderr) == (0, "")
    result = pmopt("ik", "raises", "--pose", "x=0", "--quiet", cwd=tmp_path, env=env)
    assert line in error_line(result)


def test_checked_once_before_it_is_used(plugged, monkeypatch, tmp_path):
    site = plugged({"good": ("plugged_good:MECHANISM", GOOD)})
    calls = []
    real = kept.check_mechanism
    monkeypatch.setattr(kept, "check_mechanism", lambda m: calls.append(m.name) or real(m))
    find("2pauu-ppap")
    find("other", checked=False)
    assert calls == []
    find("other")
    find("other")
    assert calls == ["other"]
    kept.require_checked.cache_clear()  # as in another process
    find("other")
    assert calls == ["other"]
    assert [p.name[:8] for p in (tmp_path / "cache").iterdir()] == ["checked-"]
    kept.require_checked.cache_clear()
    text = site / "plugged_good.py"
    text.write_text(text.read_text() + "# changed\n")
    find("other")
    assert calls == ["other", "other"]


def test_a_cache_that_cannot_be_written_costs_time_only(plugged, monkeypatch, tmp_path):
    plugged({"good": ("plugged_good:MECHANISM", GOOD)})
    (tmp_path / "cache").write_text("a file where the folder should be")
    monkeypatch.setattr("pmopt.compiler.machine_code.own_root", lambda: tmp_path / "cache")
    assert find("other").name == "other"
    kept.require_checked.cache_clear()
    assert find("other").name == "other"


def test_what_contradicts_itself_is_not_computed_with(plugged, tmp_path):
    text = GOOD.replace('name = "other"', 'name = "other"\n    roles = ("x", "z", "y")')
    plugged({"good": ("plugged_good:MECHANISM", text)})
    for _ in range(2):
        with pytest.raises(MechanismError, match=r"other: platform: z is .* \[platform\]"):
            find("other")
    result = here("jacobian", "other", "--pose", "x=0,y=0.1,z=1.2", cwd=tmp_path)
    assert error_line(result, 4).startswith("error: other: platform: z is ")
    assert here("info", "other", cwd=tmp_path).returncode == 0
    assert here("list", cwd=tmp_path).returncode == 0
    assert here("check", "other", cwd=tmp_path).returncode == 4
