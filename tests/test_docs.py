"""What holds documents to the product: figures within their errors, pages, keys with meanings."""

import io
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "docs"))

from making import commands, configuration, pictures, registry  # noqa: E402
from making.figures import ANYTHING, Figure, rounded, sampled  # noqa: E402
from making.pages import Block, Page, Says, documents, table  # noqa: E402

from pmopt.analysis.motion.config import EngineSettings, FitSettings  # noqa: E402
from pmopt.analysis.validation import validated  # noqa: E402
from pmopt.errors import InputError  # noqa: E402
from pmopt.inputs.identify import kind_of_config  # noqa: E402
from pmopt.mechanisms import find  # noqa: E402
from pmopt.reporting.batch.plan import SWEEP, BatchKeys  # noqa: E402

# --- figures ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("printed", "holds"),
    [
        ("0.281537 ± 0.000061 m rad^2", True),
        ("0.28140 ± 0.00006 m rad^2", True),  # two combined errors away
        ("0.2821 ± 0.0001 m rad^2", False),  # more than three
        ("0.2815 ± 0.0001 m rad^2", True),
        ("0.281537 ± 0.000200 m rad^2", False),  # another error
        ("0.281537 ± 0.000020 m rad^2", False),
        ("0.281537 ± 0.000061 m^3", False),
        ("0.281537 m rad^2", False),
    ],
)
def test_a_sampled_figure_holds_within_both_errors(printed, holds):
    assert sampled(0.281537, 0.000061, "m rad^2").holds(printed) == holds


@pytest.mark.parametrize(
    ("figure", "printed", "holds"),
    [
        (rounded(2.0 / 3, ".3f"), "0.667", True),
        (rounded(2.0 / 3, ".3f"), "0.668", False),
        (rounded(2.0 / 3, ".3f"), "0.67", True),  # fewer digits, and right
        (rounded(39.4, ".0f", error=0.3), "40", True),
        (rounded(39.4, ".0f", error=0.1), "42", False),
        (rounded(1.115, ".2f", within=0.02), "1.13", True),
        (rounded(12345.0, ",.0f"), "12,345", True),
        (rounded(12345.0, ",.0f"), "12,346", False),
        (Figure("two"), "two", True),
        (Figure("two"), "three", False),
    ],
)
def test_a_figure_holds_to_its_last_digit(figure, printed, holds):
    assert figure.holds(printed) == holds


# --- pages --------------------------------------------------------------------------------


def compared(text, *statements):
    page = Page("page.md", text)
    for statement in statements:
        page.compare(statement)
    return page


def test_a_sentence_is_found_across_lines_and_rewritten():
    page = compared(
        "The volume\nis 1.25 m^3, and\nmore.\n",
        Says("page.md", "volume is {} m^3, and more", (rounded(1.5, ".2f"),)),
    )
    (finding,) = page.findings
    assert str(finding) == "page.md:2: printed 1.25, now 1.50"
    assert page.rewritten == "The volume\nis 1.50 m^3, and\nmore.\n"


def test_a_figure_that_holds_is_no_finding_and_is_refreshed():
    page = compared("It is 1.30 ± 0.10 m.", Says("page.md", "It is {}.", (sampled(1.2, 0.1, "m"),)))
    assert page.findings == []
    assert page.rewritten == "It is 1.20 ± 0.10 m."


def test_what_is_measured_elsewhere_stays():
    page = compared("| a | 5 s | 2 |", Says("page.md", "| a | {} s | {} |", (ANYTHING, "3")))
    assert page.rewritten == "| a | 5 s | 3 |"


@pytest.mark.parametrize("text", ["Nothing of it.", "It is 1 m. It is 1 m."])
def test_a_sentence_that_is_not_there_once_is_a_finding(text):
    page = compared(text, Says("page.md", "It is {} m.", (rounded(1.0, ".0f"),)))
    (finding,) = page.findings
    assert not finding.mended
    assert "It is 1 m." in finding.now
    assert page.rewritten == text


def test_a_table_is_compared_cell_by_cell():
    made = table("page.md", "sizes", ("", "a"), [("x", rounded(1.0, ".2f")), ("y", "5 s")])
    rows = "| | a |\n|---|---|\n| x | 1.01 |\n| y | 5 s |\n"
    page = compared(f"A\n\n<!-- make: sizes -->\n{rows}<!-- end -->\nB\n", made)
    assert [str(f) for f in page.findings] == ["page.md:6: printed 1.01, now 1.00"]
    assert "| x | 1.00 |" in page.rewritten
    assert page.rewritten.endswith("<!-- end -->\nB\n")


def test_a_block_that_is_gone_is_a_finding():
    page = compared("Nothing.", Block("page.md", "sizes", (("a",),)))
    assert [f.mended for f in page.findings] == [False]


def test_a_stale_document_is_exit_code_1():
    """The check itself, of what is cheap: all names, links, pictures and the configuration."""
    command = [sys.executable, ROOT / "docs" / "make.py", "--check", "--jobs", "1"]
    for name in ("pictures", "measured", "tests-of", "files", "configuration", "motion-laws"):
        command += ["--only", name]
    result = subprocess.run(command, capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (0, ""), result.stdout


@pytest.mark.slow
def test_engines_agree_as_well_as_the_page_says():
    command = [sys.executable, ROOT / "docs" / "make.py", "--check", "--only", "dynamics"]
    result = subprocess.run(command, capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (0, ""), result.stdout


def test_a_maker_that_fails_is_a_finding():
    def broken():
        yield Says("page.md", "a")
        raise ValueError("nothing\nhere")

    *_, finding = registry._run(registry.Maker("broken", broken, ""))
    assert "ValueError: nothing here" in finding.now
    assert not finding.mended


# --- commands and pictures ------------------------------------------------------------------


def test_commands_are_read_out_of_documents():
    text = (
        "Text `pmopt mobility 3-cur --layout literal` and `pmopt pareto CONFIG.toml`.\n\n"
        "```sh\npmopt list   # all\npython3 -c \"\nprint(1)\n\" > a\n```\n\n"
        "    pmopt draw 3-cur \\\n      --out a.png\n"
    )  # fmt: skip
    found = commands.printed_commands(Page("page.md", text))
    assert [(c.line, c.text.split()[0:2]) for c in found] == [
        (4, ["pmopt", "list"]), (5, ["python3", "-c"]), (10, ["pmopt", "draw"]),
        (1, ["pmopt", "mobility"]),
    ]  # fmt: skip
    assert found[2].text == "pmopt draw 3-cur --out a.png"


def test_options_of_commands_that_are_not_run_are_known(tmp_path):
    printed = commands.Printed("page.md", 3, "pmopt batch a.toml --shards 1/2")
    (finding,) = commands._check_options(printed, tmp_path)
    assert finding.now == "no option --shards"


def test_pictures_that_look_alike():
    kept = (ROOT / "docs" / "images" / "3-cur.png").read_bytes()
    other = (ROOT / "docs" / "images" / "3-ups-sp.png").read_bytes()
    changed, stream = Image.open(io.BytesIO(kept)).convert("RGB"), io.BytesIO()
    changed.paste((0, 0, 0), (200, 200, 300, 260))
    changed.save(stream, "png")
    assert pictures.difference(kept, kept) == ""
    assert "shades" in pictures.difference(kept, stream.getvalue())
    assert "dots" in pictures.difference(kept, other)


# --- keys of configurations ---------------------------------------------------------------


@pytest.mark.parametrize("kind", configuration.KINDS)
def test_every_key_says_what_it_means(kind):
    for key, field in configuration.keys(configuration.KINDS[kind]):
        meaning, _ = configuration.described(field)
        assert meaning and not meaning.endswith("."), key
        assert "None" not in configuration.kind_of(field.annotation, tuple(field.metadata)), key


def test_every_model_of_a_configuration_is_on_the_page():
    """No model that reads keys is left out: all are reached from the four kinds."""
    reached = set(configuration.KINDS.values())
    for model in configuration.KINDS.values():
        for _, field in configuration.keys(model):
            reached.add(configuration.inner_model(field.annotation))
    named = {model.__name__ for model in reached if model is not None}
    written = {
        name
        for path in (ROOT / "src").rglob("*.py")
        for name in re.findall(r"^class (\w+)\((?:BaseModel|RodSettings)\)", path.read_text(), re.M)
    }
    assert written - named == {"_Named", "Settings"}  # the latter is the base of others


def test_keys_of_a_batch_are_those_that_are_read():
    assert set(BatchKeys.model_fields) == {"command", SWEEP}


def test_every_shipped_configuration_has_keys_of_the_page():
    page = (ROOT / configuration.PAGE).read_text()
    for path in (ROOT / "configs").rglob("*.toml"):
        data = tomllib.loads(path.read_text())
        assert kind_of_config(data) is not None
        for key, value in data.items():
            assert f"| `{key}` |" in page, (path, key)
            if isinstance(value, dict) and key in ("workspace", "algorithm", "final", "engine"):
                for inner in value:
                    assert f"| `{inner}` |" in page, (path, key, inner)


def test_documents_are_all_there():
    assert {"README.md", "docs/configuration.md", "docs/images/README.md"} <= set(documents())


def test_units_of_the_page_are_read():
    """A period, also by coordinate, and a tolerance may have the unit that the page gives."""
    fit = {"kind": "harmonics", "period": {"x": "800 ms", "y": "free"}}
    units = find("2pauu-ppap").units
    assert validated(FitSettings, fit, "fit", units).period == {"x": 0.8, "y": "free"}
    fit["period"] = "0.5 min"
    assert validated(FitSettings, fit, "fit", units).period == 30.0
    assert validated(EngineSettings, {"tolerance": "0.02 %"}, "engine", units).tolerance == 0.02
    with pytest.raises(InputError, match=r"fit: period.x='5 mm' is not allowed"):
        validated(FitSettings, {"kind": "harmonics", "period": {"x": "5 mm"}}, "fit", units)
