"""Numbers with errors as text, tables at any width, and CSV that is read back as numbers.

Every command is run once for each mechanism on a real terminal; what it printed is checked by
machine at 60, 80 and 140 columns.
"""

import contextlib
import fcntl
import io
import math
import os
import pty
import re
import struct
import termios
import threading
from decimal import Decimal

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.cli_runner import (
    CONFIGS,
    Terminal,
    answer,
    csv_rows,
    here,
    is_float,
    json_answer,
    shows_pace,
)

from pmopt.cli import output
from pmopt.cli.output import Pace, fitted
from pmopt.mechanisms import find, names
from pmopt.quantity import uncertain
from pmopt.reporting.runs import singularity_run
from pmopt.reporting.tables.layout import Style, lay_out, width_of, wrap
from pmopt.reporting.tables.table import (
    Shown,
    Table,
    Uncertain,
    estimated,
    shown,
    to_csv,
)

WIDTHS = (60, 80, 140)

# --- uncertain numbers --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (12.3451, 0.01234, "12.345 ± 0.012"),
        (215044309.0, 1.7e7, "(2.15 ± 0.17)e8"),
        (9.9996, 0.0996, "10.00 ± 0.10"),
        (123.4, 9.96, "123 ± 10"),
        (123456.0, 99.4, "123456 ± 99"),
        (123456.0, 99.6, "(1.2346 ± 0.0010)e5"),
        (1663.6, 425.7, "(1.66 ± 0.43)e3"),
        (-3.2, 0.05, "-3.200 ± 0.050"),
        (-1e-9, 0.02, "0.000 ± 0.020"),
        (0.0, 3600.0, "(0.0 ± 3.6)e3"),
        (0.1, 1.0, "0.1 ± 1.0"),
        (0.00012, 0.0001, "0.00012 ± 0.00010"),
        (1e-7, 3e-9, "(1.000 ± 0.030)e-7"),
        (9.99996e-5, 1e-9, "(9.99996 ± 0.00010)e-5"),
        (5e-324, 5e-324, "(5.0 ± 5.0)e-324"),
        (0.38, 1e-18, "0.380000000000000000 ± 0.000000000000000084"),
        (1.0, 0.0, "1 ± 0"),
        (0.3333333333, 0.0, "0.333333 ± 0"),
        (-0.0, 0.0, "0 ± 0"),
        (1.5, math.nan, "1.5 ± ?"),
        (1.5, math.inf, "1.5 ± ?"),
        (math.nan, 1.0, "-"),
    ],
)
def test_an_uncertain_number(value, error, text):
    assert uncertain(value, error) == text
    assert uncertain(value, error, "m^3") == f"{text} m^3"
    assert uncertain(np.float64(value), np.float64(error)) == text


def test_a_bound_is_called_one():
    assert uncertain(12.3451, 0.01234, "m^3", bound=True) == "12.345 ± 0.012 m^3 (bound)"


WRITTEN = re.compile(r"\(?(-?[\d.]+) ± ([\d.]+)(?:\)e(-?\d+))?")


@given(
    st.floats(-1e12, 1e12, allow_nan=False),
    st.floats(1e-12, 1e12),
    st.integers(-40, 40),
)
def test_the_error_has_two_digits_and_the_value_ends_at_its_place(value, error, power):
    value, error = value * 10.0**power, error * 10.0**power
    match = WRITTEN.fullmatch(uncertain(value, error))
    texts, exponent = match.groups()[:2], int(match[3] or 0)
    places = {len(text.partition(".")[2]) for text in texts}
    assert len(places) == 1
    assert len(texts[1].replace(".", "").lstrip("0")) == 2
    unit = Decimal(10) ** (exponent - places.pop())
    for text, number in zip(texts, (value, max(error, 2.0**-52 * abs(value))), strict=True):
        written = Decimal(text) * Decimal(10) ** exponent
        assert abs(written - Decimal(repr(number))) <= unit * Decimal("0.5000001")


def test_rough_numbers():
    assert [estimated(v) for v in (0.0343, 1234.0, 5e5)] == ["0.034", "1200", "500000"]
    assert estimated(4194304.0, 4) == "4194304"


# --- tables of any width ------------------------------------------------------------------------


def made(rows=3, **more):
    columns = ("name", "volume", "x", "y", "note")
    return Table(
        "A title",
        columns,
        tuple(
            (f"row {k}", Uncertain(12.3451 + k, 0.01234), 1.23456789, -0.00123456,
             "a text of many words that may be broken at 12.5 m or so")
            for k in range(rows)
        ),
        {"volume": "m^3", "x": "m", "y": "rad"},
        errors={"volume": ("volume_error",)}, prose=("note",), **more,
    )  # fmt: skip


def test_as_wide_as_needed_without_a_terminal():
    lines = lay_out(made(), None, Style(framed=True))
    assert lines[1] == (
        "| name  | volume ± error (m^3) |   x (m) |     y (rad) | "
        "note                                                    |"
    )
    assert "| row 0 |       12.345 ± 0.012 | 1.23457 | -0.00123456 | a text of many" in lines[3]


@pytest.mark.parametrize("width", range(28, 121, 4))
@pytest.mark.parametrize("rows", [1, 3, 40])
def test_nothing_is_split_at_any_width(width, rows):
    lines = lay_out(made(rows), width)
    text = "\n".join(lines)
    assert all(width_of(line) <= width for line in lines)
    assert all(f"row {k}" in text for k in range(rows))
    left = re.search(r"no room for (.*?): a wider", " ".join(text.split()))
    dropped = left[1].split(", ") if left else []
    assert not dropped or rows == 40
    assert text.count("12.345 ± 0.012") == ("volume" not in dropped)
    assert text.count("12.5 m") == rows * ("note" not in dropped)
    assert text.count("-0.00123") == rows * ("y" not in dropped)


def test_what_gives_way_first():
    """Prose, digits, then the table stands on end; of many rows columns go, and are named."""

    def drawn(width, rows=3, **more):
        return "\n".join(lay_out(made(rows, **more), width))

    assert "-0.00123456" in drawn(64)
    assert "-0.0012346 " in drawn(60)
    assert drawn(50).startswith("row 0\n  volume ± error (m^3)  12.345 ± 0.012\n  x (m) ")
    assert drawn(52, 40, yielding=("x",)).endswith(
        "no room for x: a wider terminal or --format json\n  shows them"
    )
    assert "no room for note: " in drawn(52, 40)
    assert "no room" not in drawn(56, 40)


def test_few_rows_of_many_columns_are_turned():
    table = Table("", ("place", *"abcdefgh"), tuple((p, *[0.123456] * 8) for p in ("end", "knee")),
                  {"a": "m"})  # fmt: skip
    lines = lay_out(table, 40)
    assert lines[0].split() == ["place", "end", "knee"]
    assert lines[2].split() == ["a", "(m)", "0.123456", "0.123456"]
    assert len(lines) == 10


def test_columns_of_nothing_and_tables_without_rows_are_not_shown():
    table = Table("", ("a", "b"), ((1, None), (2, Shown(3, None))), {})
    assert lay_out(table, 60)[0].split() == ["a"]
    assert to_csv([table]) == "a,b\n1,\n2,3"
    assert lay_out(Table("", ("a", "b"), (), {}), 60) == []
    assert lay_out(Table("", ("a",), ((None,),), {}), 60) == []


def test_signs_stand_below_each_other():
    rows = tuple((n, Uncertain(v, e)) for n, v, e in (("a", 10.2, 0.011), ("b", 0.5, 0.0012)))
    lines = lay_out(Table("", ("n", "v"), rows, {}, errors={"v": ("v_error",)}), 60)
    assert lines[2].index("±") == lines[3].index("±")


@pytest.mark.parametrize(
    "kept",
    ["0.65 m", "12.345 ± 0.012 m^3", "l1 = 0.65 m", "1.2 mm^2 rad^3", "limb 2", "(type II)",
     "-1.5 .. 1.5 rad", "(2.15 ± 0.17)e8 mm^3", "5 N m", "1e-9 kg m^2"],
)  # fmt: skip
@pytest.mark.parametrize("before", range(12))
def test_a_number_keeps_its_unit_where_text_is_broken(kept, before):
    text = f"{'x' * before} {kept} and so on, {kept}"
    lines = wrap(text, 24)
    assert sum(line.count(kept) for line in lines) == 2
    assert " ".join(lines) == text


def test_no_minus_zero_and_no_nan():
    assert [shown(v) for v in (-0.0, math.nan, None, True, 3)] == ["0", "-", "-", "yes", "3"]


# --- every command on a terminal ----------------------------------------------------------------


def commands(name, folder):
    """Return the commands whose tables are looked at, small ones."""
    mechanism = find(name)
    home = mechanism.home(mechanism.resolve({}))
    pose = ",".join(f"{k}={v + 0.01!r}" for k, v in home.items())
    box = ",".join(f"{k}={v + 0.01!r}:{v + 0.011!r}" for k, v in home.items())
    (found, *_) = json_answer("ik", name, "--pose", pose, cwd=folder)["solutions"]
    joints = ",".join(f"{k}={v!r}" for k, v in found["joints"].items())
    motor = f"{mechanism.joints[0].name}_effort=50"
    (folder / "poses.csv").write_text(
        "\n".join(
            [",".join(home), *(",".join(str(v + d) for v in home.values()) for d in (0.01, 0.02))]
        )
    )
    return [
        ("info", name),
        ("ik", name, "--pose", pose),
        ("ik", name, "--poses", "poses.csv"),
        ("fk", name, "--joints", joints),
        ("jacobian", name, "--pose", pose),
        ("mobility", name, "--samples", "2"),
        ("workspace", name, "--samples", "2000", "--shape-grid", "6"),
        ("workspace", name, "--grid", "8", "--shape-grid", "0"),
        ("singularities", name, "--samples", "2000", "--grid", "6"),
        ("singularities", name, "--path", "poses.csv"),
        ("certify", name, "--domain", box, "--box-budget", "500"),
        ("capability", name, "--samples", "1024"),
        ("capability", name, "--samples", "1024", "--tool-force", "5", "--motors", motor),
        ("draw", name, "--out", "drawing.png", "--force"),
    ]


MORE = {
    "list": ("list",),
    "dry run": ("workspace", "3-cur", "--dry-run"),
    "motion": ("motion", CONFIGS / "motion" / "2uu-upu-t1.toml"),
    "fit": ("motion", CONFIGS / "motion" / "3-ups-sp-strokes.toml"),
    "infeasible": ("motion", CONFIGS / "motion" / "4-ups-rps-paper.toml"),
    "pareto": ("pareto", "search.toml", "--out", "run", "--force"),
    "plot": ("plot", "run"),
    "batch": ("batch", "sweep.toml", "search.toml", "--workers", "1", "--out", "batch", "--force"),
}
SEARCH = """
mechanism = "2pauu-ppap"
objectives = ["volume", "gci"]
[parameters]
l1 = [0.5, 1.5]
[workspace]
samples = 500
[algorithm]
population = 8
generations = 2
"""
SWEEP = """
mechanism = "2pauu-ppap"
command = "workspace"
shape_grid = 0
[workspace]
samples = 1000
[sweep]
"parameters.l2" = [1.2, 1.3]
"""


@contextlib.contextmanager
def on_terminal(width):
    """Let stdout be a terminal of a width; the list holds what was written in the end."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, width, 0, 0))
    parts, text = [], []

    def read():
        with contextlib.suppress(OSError):
            while data := os.read(master, 1 << 16):
                parts.append(data)

    reader = threading.Thread(target=read)
    reader.start()
    try:
        with open(slave, "w", encoding="utf-8") as stream, contextlib.redirect_stdout(stream):
            yield text
    finally:
        reader.join()
        os.close(master)
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", b"".join(parts).decode())
    text.append(plain.replace("\r\n", "\n"))


@pytest.fixture
def spied(monkeypatch):
    """Return a function that runs a command twice, for its tables and for its CSV.

    What takes long is computed for the first.
    """
    monkeypatch.delenv("COLUMNS", raising=False)
    survey = singularity_run.find_singularities

    def run(*args, cwd):
        found, kept = [], []

        def surveyed(*given, **more):
            if not kept:
                kept.append(survey(*given, **more))
            return kept[0]

        with monkeypatch.context() as patch:
            patch.setattr(singularity_run, "find_singularities", surveyed)
            with patch.context() as spy:
                spy.setattr(output, "_print_tables", found.extend)
                first = here(*args, cwd=cwd)
            second = here(*args, "--format", "csv", cwd=cwd)
        assert found, first.stderr
        assert first.returncode == second.returncode
        return found, second.stdout.rstrip("\n")

    return run


def squeezed(text):
    return re.sub(r" +", " ", text).strip()


def check_on_terminal(tables, width):
    """Print on a terminal; every cell that is no prose must stand whole on one of its lines."""
    for table in tables:
        with on_terminal(width) as text:
            output._print_tables([table])
        lines = text[0].split("\n")
        assert max(map(width_of, lines)) <= width, "\n".join(lines)
        whole = [squeezed(line) for line in lines]
        left = re.search(r"no room for (.*?): a wider", " ".join(whole))
        dropped = left[1].split(", ") if left else []
        for k, name in enumerate(table.columns):
            if name in (*table.only_csv, *dropped):
                continue
            for row in table.rows:
                if row[k] is None or name in table.prose:
                    continue
                texts = {squeezed(shown(row[k], digits)) for digits in (6, 5, 4)}
                assert any(t in line for t in texts for line in whole), (name, texts, text[0])
        for note in (table.title, *table.notes):
            for number in re.findall(r"[-\d.]+ (?:mm|m|rad|deg|kg|N|s)\b", note):
                assert any(number in line for line in lines), (number, text[0])


def check_csv(tables, text):
    """Read CSV back: nothing of the tables is missing, numbers are numbers in csv and pandas."""
    rows = csv_rows(text)
    frame = pd.read_csv(io.StringIO(text), keep_default_na=False, na_values=[""])
    assert len(frame) == len(rows)
    cells = {cell for row in rows for cell in row.values()}
    for table in tables:
        for row in csv_rows(to_csv([table])):
            assert {cell for cell in row.values() if is_float(cell)} <= cells
    for name, column in frame.items():
        known = [cell for cell in column if not pd.isna(cell)]
        if any(isinstance(cell, float) for cell in known):
            assert column.dtype.kind in "fi", name
    for name in ("value", "default", "lower", "upper", "p90", "p90_error", "volume"):
        for row in rows:
            if row.get(name):
                assert math.isfinite(float(row[name]))


@pytest.mark.parametrize("name", names())
def test_tables_of_every_command(name, spied, tmp_path):
    for command in commands(name, tmp_path):
        tables, text = spied(*command, cwd=tmp_path)
        check_csv(tables, text)
        assert not any("nan" in "\n".join(lay_out(t, None)).lower().split() for t in tables)
        for width in WIDTHS:
            check_on_terminal(tables, width)


@pytest.mark.parametrize(
    "case", [pytest.param(c, marks=pytest.mark.slow) if c == "batch" else c for c in MORE]
)
def test_tables_of_runs(case, spied, tmp_path):
    (tmp_path / "search.toml").write_text(SEARCH)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    if case == "plot":
        answer(*MORE["pareto"], "--quiet", cwd=tmp_path)
    tables, text = spied(*MORE[case], cwd=tmp_path)
    assert csv_rows(text)
    for width in WIDTHS:
        check_on_terminal(tables, width)


def test_a_terminal_and_columns(monkeypatch, tmp_path):
    """$COLUMNS is kept to off a terminal too; without it nothing is broken there."""
    command = ("ik", "3-cur", "--pose", "z=0.35,beta=0.25,gamma=0.15")
    monkeypatch.setenv("COLUMNS", "60")
    narrow = answer(*command, cwd=tmp_path).splitlines()
    assert max(map(len, narrow)) <= 60
    monkeypatch.delenv("COLUMNS")
    wide = answer(*command, cwd=tmp_path)
    assert "no room" not in wide
    assert "within_limits" in wide
    monkeypatch.setenv("COLUMNS", "wide")
    assert answer(*command, cwd=tmp_path) == wide


def test_a_stream_of_ascii(monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    with contextlib.redirect_stdout(stream):
        output._print_tables([made()])
    stream.flush()
    assert b"12.345 +- 0.012" in stream.buffer.getvalue()


# --- CSV of several tables ----------------------------------------------------------------------


def test_csv_of_jacobians(tmp_path):
    command = ("jacobian", "3-ups-sp", "--pose", "phi=0,theta=0.2,psi=-0.1,l4=60")
    document = json_answer(*command, cwd=tmp_path)
    frame = pd.read_csv(io.StringIO(answer(*command, "--format", "csv", cwd=tmp_path)))
    pose, joints = ["phi", "theta", "psi", "l4"], ["l1", "l2", "l3", "l4"]
    assert (document["rows"]["J"], document["columns"]["J"]) == (pose, joints)
    assert (document["rows"]["J_X"], document["columns"]["J_X"]) == (joints, pose)
    for name in ("J", "J_X", "J_q"):
        found = frame[frame["quantity"] == name].pivot(index="row", columns="column")
        matrix = found["value"].loc[document["rows"][name], document["columns"][name]]
        assert matrix.to_numpy().tolist() == document[name]
    units = frame[frame["quantity"] == "J"].set_index(["row", "column"])["unit"]
    assert (units["phi", "l1"], units["l4", "l1"]) == ("rad/mm", "mm/mm")
    table = answer(*command, cwd=tmp_path)
    assert re.search(r"\| row +\| +l1 \| +l2 \| +l3 \| +l4 \|", table)


def test_csv_and_json_of_a_search(tmp_path):
    (tmp_path / "search.toml").write_text(SEARCH)
    text = answer(*MORE["pareto"], "--format", "csv", "--quiet", cwd=tmp_path)
    assert text == (tmp_path / "run/front.csv").read_text()
    document = json_answer(*MORE["pareto"], "--quiet", cwd=tmp_path)
    assert {"out", "designs", "hypervolume", "reference_point", "knee", "ends"} <= set(document)
    assert [d["volume"] for d in document["front"]] == [
        float(row["volume"]) for row in csv_rows(text)
    ]
    assert document["knee"] in document["front"]


def test_csv_of_a_mechanism_has_all_of_it(tmp_path):
    document = json_answer("info", "3-cur", cwd=tmp_path)
    frame = pd.read_csv(io.StringIO(answer("info", "3-cur", "--format", "csv", cwd=tmp_path)))
    tables = dict(list(frame.groupby("table")))
    of = {key: tables[key]["name"].tolist() for key in tables if key != "about"}
    assert of["parameter"] == [p["name"] for p in document["parameters"]]
    assert of["working mode"] == document["working_modes"]
    assert of["limb"] == [limb["name"] for limb in document["limbs"]]
    assert of["body"] == [body["name"] for body in document["bodies"]]
    assert set(of["coordinate"]) >= {"z", "h1", "theta4", "x"}
    home = tables["home"].set_index("name")["value"]
    assert home.to_dict() == document["home"]
    limits = tables["range"][tables["range"]["kind"] == "limit"].set_index("name")
    assert limits.loc["h1", ["lower", "upper"]].tolist() == [0.0, 0.3]


# --- what is not asked for ----------------------------------------------------------------------


def test_no_zeros_of_a_task_that_is_not_given(tmp_path):
    command = ("capability", "2pauu-ppap", "--samples", "1024")
    standing = answer(*command, cwd=tmp_path)
    assert not re.search(r"^\| theta1_rate", standing, re.M)
    assert "nothing is asked of theta1_rate, theta2_rate, d_rate" in standing
    assert re.search(r"^\| theta1_effort", standing, re.M)
    assert "limit" not in standing.splitlines()[2]
    moving = answer(*command, "--speed", "1", cwd=tmp_path)
    assert re.search(r"^\| theta1_rate .* ± ", moving, re.M)
    demands = [d["name"] for d in json_answer(*command, cwd=tmp_path)["demands"]]
    assert len(demands) == 6


def test_extremes_of_samples_are_bounds_from_one_side(tmp_path):
    text = answer("singularities", "2uu-upu", "--samples", "2000", "--grid", "6", cwd=tmp_path)
    assert re.search(r"\| smallest lci met +\| +<= 7\.", text)
    assert re.search(r"\| determinant, inverse \(type I\), limb 1 +\| +<= ", text)
    assert re.search(r"\| determinant, forward \(type II\), platform +\| +0 \|", text)


# --- progress -----------------------------------------------------------------------------------


@pytest.mark.parametrize("width", [60, 80])
def test_progress_has_rate_and_time_left_on_a_narrow_terminal(width, tmp_path):
    terminal = Terminal("workspace", "2pauu-ppap", "--samples", "1e12", "--format", "json",
                        cwd=tmp_path, width=width)  # fmt: skip
    terminal.read(shows_pace("points"))
    terminal.process.kill()
    terminal.close()
    lines = re.split(r"[\r\n]", re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", terminal.text))
    assert max(map(len, lines)) <= width


def test_progress_of_a_search_at_80_columns(tmp_path):
    (tmp_path / "search.toml").write_text(SEARCH)
    terminal = Terminal("pareto", "search.toml", "--set", "algorithm.generations=5000",
                        cwd=tmp_path, width=80)  # fmt: skip
    terminal.read(shows_pace("gen"))
    terminal.process.kill()
    terminal.close()
    assert "generation" in terminal.text


def test_what_of_a_progress_line_gives_way():
    text = "generation 12/200, front 34, hypervolume 12.3456 m^3"
    ending = len(" 12 % 18.7 gen/min ETA 0:12:34")
    assert fitted(text, ending, 120) == (text, 35)
    assert fitted(text, ending, 80)[0] == "generation 12/200, front 34"
    assert fitted(text, ending, 60)[0] == "generation 12/200"
    assert fitted("workspace 2pauu-ppap", 36, 60)[0] == "workspace"
    assert fitted("a" * 40, ending, 60)[0] == "a" * 18 + "…"
    for width in range(45, 140):
        found, bar = fitted(text, ending, width)
        assert width_of(found) + bar + ending + 3 <= width


def test_a_pace(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(output.time, "monotonic", lambda: clock[0])
    pace = Pace("designs")
    assert (pace.rate(), pace.left(10)) == ("", "ETA -:--:--")
    pace.note(2)
    assert (pace.rate(), pace.left(10)) == ("", "ETA -:--:--")
    clock[0] += 10
    pace.note(7)
    assert (pace.rate(), pace.left(10)) == ("30 designs/min", "ETA 0:00:06")
    clock[0] += 2
    assert pace.left(10) == "ETA 0:00:04"
    pace.note(10)
    assert pace.left(10) == "ETA 0:00:00"
    fast, slow = Pace("points"), Pace("runs")
    for one in (fast, slow):
        one.note(0)
    clock[0] += 3600
    fast.note(2.5e6 * 3600)
    slow.note(2)
    assert (fast.rate(), slow.rate()) == ("2.5 Mpoints/s", "2 runs/h")
    assert slow.left(100) == "ETA 49:00:00"
