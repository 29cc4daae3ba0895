"""CSV files as Windows, Excel and PowerShell write them."""

import codecs
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmopt.errors import InputError
from pmopt.inputs.tables import parse_table, read_table
from pmopt.inputs.text import decode

ROWS = (("0.5", "-1.25e-3"), ("1", "2.0"))
PLAIN = "t,x\n0.5,-1.25e-3\n1,2.0\n"
VARIANTS = {
    "plain": PLAIN,
    "crlf": PLAIN.replace("\n", "\r\n"),
    "cr": PLAIN.replace("\n", "\r"),
    "semicolon": PLAIN.replace(",", ";"),
    "tab": PLAIN.replace(",", "\t"),
    "decimal comma": "t;x\n0,5;-1,25e-3\n1;2,0\n",
    "decimal comma, tab": "t\tx\n0,5\t-1,25e-3\n1\t2,0\n",
    "quoted": '"t","x"\n"0.5","-1.25e-3"\n"1","2.0"\n',
    "sep": "sep=,\n" + PLAIN,
    "sep semicolon": "sep=;\r\nt;x\r\n0,5;-1,25e-3\r\n1;2,0\r\n",
    "comments": "# recorded, today; at noon\n" + PLAIN.replace("\n1", "\n# pause\n\n1"),
    "spaces": "t , x\n 0.5 , -1.25e-3\n1,2.0\n",
    "end of line": "t,x,\n0.5,-1.25e-3,\n1,2.0,\n",
    "no last line break": PLAIN.rstrip(),
}


@pytest.mark.parametrize("text", VARIANTS.values(), ids=VARIANTS)
def test_variants_are_the_same_table(text):
    table = parse_table(text, "a.csv")
    assert table.names == ("t", "x")
    assert table.cells == ROWS
    assert [text.splitlines()[n - 1].lstrip(' "')[0] for n in table.lines] == ["0", "1"]


@pytest.mark.parametrize(
    ("mark", "encoding"),
    [
        (codecs.BOM_UTF8, "utf-8"),
        (codecs.BOM_UTF16_LE, "utf-16-le"),
        (codecs.BOM_UTF16_BE, "utf-16-be"),
        (b"", "utf-8"),
        (b"", "utf-16-le"),
        (b"", "utf-16-be"),
        (b"", "cp1252"),
    ],
)
def test_encodings(mark, encoding, tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(mark + ("t;x;Länge\r\n0,5;-1,25e-3;1\r\n1;2,0;1\r\n").encode(encoding))
    table = read_table(path, "a.csv")
    assert table.names == ("t", "x", "Länge")
    assert tuple(row[:2] for row in table.cells) == ROWS


def test_units_of_heads():
    table = parse_table("t [ms];x (mm);theta1 / °;phi_deg;a b\n1;2;3;4;5\n", "a.csv")
    assert table.names == ("t", "x", "theta1", "phi_deg", "a b")
    assert table.units == ("ms", "mm", "°", None, None)
    assert table.column("theta1") == ("3",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no rows; columns needed: t, x"),
        ("t,x\n", "has no rows"),
        ("# t,x\n", "has no rows"),
        ("t,x,t\n1,2,3\n", "column t is given twice"),
        ("t,x\n1,2\n1,2,3\n", "line 3: 3 cells, the header has 2 (separated by comma)"),
        ("t;x\n0,5;1\n1;1.5\n", "line 3: 1.5: other cells of the file have a decimal comma"),
        ("t x y\n1 2 3\n", "columns are separated by comma, semicolon or tab"),
    ],
)
def test_what_is_no_table(text, says):
    with pytest.raises(InputError) as error:
        parse_table(text, "a.csv", ["t", "x"])
    assert says in str(error.value)


def test_no_text(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\x00\x00")
    with pytest.raises(InputError, match="is not a CSV file"):
        read_table(path, "a.csv")


@given(st.text(max_size=50))
def test_any_text_is_a_table_or_an_error(text):
    with contextlib.suppress(InputError):
        parse_table(text, "a.csv")


@given(st.binary(max_size=60))
def test_any_bytes_are_text_or_an_error(data):
    with contextlib.suppress(ValueError):
        decode(data, legacy=True)
