"""``pmopt check``: what it prints and how it ends."""

import pytest
from support.cli_runner import answer, csv_answer, error_line, here, json_answer, strict_json

from pmopt.mechanisms import registry
from pmopt.mechanisms.catalogue.pauu_ppap import PauuPpap


@pytest.fixture
def broken(monkeypatch):
    """Have one name find a mechanism with a role too few."""
    made = type("Broken", (PauuPpap,), {"name": "broken", "roles": ("x", "y")})()
    found = registry.find
    monkeypatch.setattr(
        "pmopt.cli.options.find",
        lambda name, **given: made if name == "broken" else found(name, **given),
    )


def test_a_table_of_what_was_compared(tmp_path):
    text = answer("check", "2pauu-ppap", cwd=tmp_path)
    assert "jacobian-differences" in text
    assert "kernel_constants" in text
    document = json_answer("check", "2pauu-ppap", cwd=tmp_path)
    assert (document["held"], document["findings"]) == (True, [])
    assert all(c["held"] and c["count"] > 0 for c in document["checks"])
    rows = csv_answer("check", "2pauu-ppap", cwd=tmp_path)
    assert [r["check"] for r in rows if r["table"] == "checks"] == [
        c["check"] for c in document["checks"]
    ]


@pytest.mark.parametrize("form", ["table", "json", "csv"])
def test_what_is_wrong_is_one_line_and_exit_code_4(broken, form, tmp_path):
    result = here("check", "broken", "--format", form, cwd=tmp_path)
    line = error_line(result, 4)
    assert line == "error: broken: roles: 2 roles for 3 coordinates [counts]"
    assert "2 roles for 3 coordinates" in result.stdout
    if form == "json":
        (finding,) = strict_json(result.stdout)["findings"]
        assert finding == {"check": "counts", "part": "roles", "text": "2 roles for 3 coordinates"}
