"""Pictures: none costs a result, none depends on the reader's settings, all can be read."""

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from support.cli_runner import (
    BATCH,
    CONFIGS,
    SEARCH,
    environment,
    error_line,
    files_in,
    here,
    pmopt,
)

from pmopt.analysis.settings import WorkspaceSettings
from pmopt.analysis.workspace.compute import compute_workspace
from pmopt.cli import encoding
from pmopt.mechanisms import find
from pmopt.reporting.pictures import (
    chart_text,
    front_plots,
    motion_plots,
    simulation_plots,
    style,
    workspace_plots,
)
from pmopt.reporting.pictures.front_plots import draw_front, draw_history, influential
from pmopt.reporting.pictures.gallery import Gallery, lines_of, reason
from pmopt.reporting.runs import capability_run, run_folder

MECH = "2pauu-ppap"
T1 = (CONFIGS / "motion" / "2uu-upu-t1.toml").read_text().replace("duration = 24.0", "duration = 1")
#: Each command that draws, and a data file of its folder.
COMMANDS = {
    "workspace": (("workspace", MECH, "--samples", 1000, "--shape-grid", 0), "result.json"),
    "singularities": (("singularities", MECH, "--samples", 1000, "--grid", 6), "aspects.csv"),
    "capability": (
        ("capability", MECH, "--samples", 1000, "--motors", "theta1_effort=300"), "demands.csv",
    ),
    "pareto": (("pareto", "search.toml"), "front.csv"),
    "motion": (("motion", "t1.toml"), "motion.csv"),
    "simulate": (("simulate", "t1.toml"), "simulate.csv"),
}  # fmt: skip


@pytest.fixture
def home(tmp_path):
    for name, text in (("search", SEARCH), ("batch", BATCH), ("t1", T1)):
        (tmp_path / f"{name}.toml").write_text(text)
    return tmp_path


@pytest.fixture
def nothing_draws(monkeypatch):
    """Let every picture fail."""

    def fails():
        raise ModuleNotFoundError("No module named 'matplotlib'")

    monkeypatch.setattr(style, "_import_matplotlib", fails)


# --- a picture that fails ---------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_what_cannot_be_drawn_is_one_line_and_costs_no_file(command, home, nothing_draws):
    words, file = COMMANDS[command]
    result = here(*words, "--out", "run", "--format", "json", cwd=home)
    assert result.returncode == 0, result.stderr
    json.loads(result.stdout)
    lines = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert len(lines) == 1
    assert lines[0].endswith("not drawn: ModuleNotFoundError: No module named 'matplotlib'")
    held = files_in(home / "run")
    assert file in held
    assert not any(name.endswith(".png") for name in held)
    missing = json.loads((home / "run/manifest.json").read_text())["missing_pictures"]
    assert missing
    assert all(name in lines[0] for name in missing)
    assert set(missing.values()) == {"ModuleNotFoundError: No module named 'matplotlib'"}
    error = error_line(here("plot", "run", cwd=home), 1)
    assert "not drawn: ModuleNotFoundError" in error


def test_numbers_are_written_before_anything_is_drawn(home, monkeypatch):
    """The same in every command: what is written after the first picture is the manifest."""
    order = []
    write = run_folder.RunFolder.write

    def noted(self, name, data):
        order.append(name)
        write(self, name, data)

    monkeypatch.setattr(run_folder.RunFolder, "write", noted)
    monkeypatch.setattr(style, "_import_matplotlib", lambda: order.append("drawing") or 1 / 0)
    for command, (words, _) in COMMANDS.items():
        order.clear()
        assert here(*words, "--out", f"{command}-run", "--quiet", cwd=home).returncode == 0
        first = order.index("drawing")
        assert [name for name in order[first:] if name != "drawing"] == ["manifest.json"], command
        assert len(order[:first]) >= 2


def test_others_are_drawn_beside_one_that_fails(home, monkeypatch):
    def fails(*_):
        raise MemoryError

    monkeypatch.setattr(workspace_plots, "draw_sections", fails)
    words, _ = COMMANDS["workspace"]
    result = here(*words, "--out", "run", cwd=home)
    assert result.returncode == 0
    assert "warning: sections.png: not drawn: out of memory\n" in result.stderr
    held = files_in(home / "run")
    assert {"workspace.png", "lci_histogram.png", "mechanism.png"} <= set(held)
    assert "sections.png" not in held
    manifest = json.loads((home / "run/manifest.json").read_text())
    assert manifest["missing_pictures"] == {"sections.png": "out of memory"}
    plotted = here("plot", "run", "--out", "again", cwd=home)
    assert plotted.returncode == 1
    assert "workspace.png" in plotted.stdout
    assert plotted.stderr == "error: sections.png: not drawn: out of memory\n"


def test_a_batch_says_what_its_runs_lack(home):
    """Its runs are processes of their own: a matplotlib that is broken stands before the other."""
    (home / "broken").mkdir()
    (home / "broken/matplotlib.py").write_text("raise ImportError('libfreetype.so.6: not found')")
    result = pmopt("batch", "batch.toml", "--workers", 1, "--out", "all", cwd=home,
                   env={"PYTHONPATH": str(home / "broken")})  # fmt: skip
    assert result.returncode == 0, result.stderr
    lines = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert len(lines) == 2
    assert all("not drawn: ImportError: libfreetype.so.6: not found" in line for line in lines)
    assert json.loads(next(home.glob("all/runs/*/manifest.json")).read_text())["missing_pictures"]


def test_a_picture_that_was_asked_for_is_an_error(home, nothing_draws):
    error = error_line(here("draw", MECH, "--out", "a.png", cwd=home), 1)
    assert error.startswith("error: a.png: not drawn: ModuleNotFoundError")
    moved = here("motion", "t1.toml", "--animate", "a.gif", "--format", "json", cwd=home)
    assert moved.returncode == 1
    json.loads(moved.stdout)  # the numbers are there
    assert "a.gif: not drawn" in moved.stderr


def test_lines_join_pictures_of_one_reason():
    gallery = Gallery()
    gallery.add("a.png", lambda: b"drawn")
    for name in ("b.png", "c.png"):
        gallery.add(name, lambda: 1 / 0)
    gallery.add("d.png", lambda: (_ for _ in ()).throw(ValueError("two\nlines")))
    assert dict(gallery) == {"a.png": b"drawn"}
    assert lines_of(gallery.missing) == [
        "b.png, c.png: not drawn: ZeroDivisionError: division by zero",
        "d.png: not drawn: ValueError: two lines",
    ]
    assert len(reason(ValueError("x" * 9999))) < 300
    with pytest.raises(KeyboardInterrupt):
        gallery.add("e.png", lambda: (_ for _ in ()).throw(KeyboardInterrupt))


# --- settings of others -----------------------------------------------------------------------

PICTURE = """
import hashlib, sys
import numpy as np
from pmopt.reporting.pictures.style import new_figure, to_picture
with new_figure(4, 3) as figure:
    axes = figure.subplots()
    axes.plot([1, 2, 3], [1e8, 3e8, 2e8], label="±")
    axes.legend()
    figure.text(0.1, 0.02, "volume (10⁶ mm³) ≥ 1")
    print(hashlib.sha256(to_picture(figure)).hexdigest())
"""
ODD = """
font.size: 40
font.family: Comic Sans MS
figure.figsize: 1, 1
axes.facecolor: red
savefig.dpi: 17
savefig.transparent: True
text.usetex: True
"""
#: Several things that have nothing to do with each other are set at a time.
SETTINGS = {
    "backends, warnings": {"MPLBACKEND": "nonsense", "PYTHONWARNINGS": "error",
                           "PYTHONHASHSEED": "7", "TERM": "dumb"},
    "windows, Turkish": {"MPLBACKEND": "TkAgg", "DISPLAY": ":99", "QT_QPA_PLATFORM": "none",
                         "LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"},
    "notebooks, no folder": {"MPLBACKEND": "module://matplotlib_inline.backend_inline",
                             "MPLCONFIGDIR": "/proc/none"},
    "style, C": {"MATPLOTLIBRC": "odd", "LC_ALL": "C", "PYTHONUTF8": "0",
                 "PYTHONCOERCECLOCALE": "0"},
    "broken": {"MATPLOTLIBRC": "broken"},
    "no fonts": {"MPLCONFIGDIR": "fonts"},
}  # fmt: skip


def drawn_hash(folder, **changes):
    done = subprocess.run(
        [sys.executable, "-X", "utf8", "-c", PICTURE], cwd=folder, env=environment(**changes),
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_pictures_are_the_same_whatever_is_set_for_others(tmp_path):
    for name, data in (("odd", ODD.encode()), ("broken", b"font.size: \xff\xfe\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "matplotlibrc").write_bytes(data)
    (tmp_path / "fonts").mkdir()
    plain = drawn_hash(tmp_path)
    from matplotlib.font_manager import FontManager

    emptied = {"_version": FontManager.__version__, "__class__": "FontManager", "ttflist": [],
               "_FontManager__default_weight": "normal", "default_size": None,
               "defaultFamily": {"ttf": "DejaVu Sans", "afm": "Helvetica"},
               "afmlist": []}  # fmt: skip
    version = str(FontManager.__version__).removeprefix("v")
    (tmp_path / "fonts" / f"fontlist-v{version}.json").write_text(json.dumps(emptied))
    for name, changes in SETTINGS.items():
        assert drawn_hash(tmp_path, **changes) == plain, name
    for folder in ("odd", "broken"):  # where pmopt is run
        assert drawn_hash(tmp_path / folder) == plain


def test_a_reader_keeps_settings_and_backend():
    import matplotlib

    with matplotlib.rc_context({"font.size": 33.0, "lines.linewidth": 7.0}):
        with style.new_figure(2, 2) as figure:
            assert matplotlib.rcParams["font.size"] == 9
            style.to_picture(figure)
        assert matplotlib.rcParams["font.size"] == 33.0


@pytest.mark.parametrize("name", ["ascii", "latin-1", "utf-8"])
def test_what_an_encoding_lacks_is_written_plainly(name):
    text = "12.3 ± 0.1 m², LCI ≥ 0.2, 10⁻³ \u4e00"
    raw = text.encode(name, encoding.HANDLER)
    if name == "ascii":
        assert raw == b"12.3 +- 0.1 m^2, LCI >= 0.2, 10^-^3 ?"
    elif name == "utf-8":
        assert raw.decode() == text
    odd = b"a\xff".decode("utf-8", "surrogateescape")
    assert odd.encode("utf-8", encoding.HANDLER) == b"a\\xff"  # what is printed is text


def test_a_result_is_printed_in_any_encoding_and_locale(tmp_path):
    words = ("ik", MECH, "--pose", "x=0.1,y=0.1,z=1.2")
    plain = pmopt(*words, cwd=tmp_path)
    for changes in (
        {"PYTHONIOENCODING": "ascii", "LANG": "C"}, {"LC_ALL": "xx_YY", "COLUMNS": "garbage"},
        {"NUMBA_DISABLE_JIT": "1", "NUMBA_NUM_THREADS": "two", "NO_COLOR": "1", "TERM": "dumb"},
    ):  # fmt: skip
        found = pmopt(*words, cwd=tmp_path, env=changes)
        assert (found.returncode, found.stdout) == (0, plain.stdout), found.stderr
    search = ("pareto", "search.toml", "--out", "run", "--force")
    (tmp_path / "search.toml").write_text(SEARCH)
    done = pmopt(*search, cwd=tmp_path, env={"PYTHONIOENCODING": "ascii", "LANG": "C"})
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()


# --- colours ----------------------------------------------------------------------------------

#: Machado, Oliveira and Fernandes (2009), severity 1, for linear RGB.
SEEN = {
    "everybody": np.eye(3),
    "deuteranopia": np.array([
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]),
    "protanopia": np.array([
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ]),
}  # fmt: skip
XYZ = np.array([
    [0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
    [0.0193339, 0.1191920, 0.9503041],
])  # fmt: skip
#: Every set of colours that are drawn together.
TOGETHER = {
    "curves": chart_text.LINES,
    "efforts": (simulation_plots.LINE, simulation_plots._ENGINE),
    "front": (style.LINE, style.FAINT, style.INK),
}


def lab(colour, seen):
    """Return CIELAB (D65) of a colour as someone sees it."""
    rgb = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    xyz = XYZ @ np.clip(seen @ linear, 0, 1) / np.array([0.95047, 1.0, 1.08883])
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("group", TOGETHER)
@pytest.mark.parametrize("who", SEEN)
def test_colours_drawn_together_are_told_apart(who, group):
    for first, second in itertools.combinations(TOGETHER[group], 2):
        apart = np.linalg.norm(lab(first, SEEN[who]) - lab(second, SEEN[who]))
        assert apart >= 12, (first, second)


@pytest.mark.parametrize("who", SEEN)
def test_colours_of_capability_say_which_side_of_enough(who):
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    less, enough, more = (
        lab(to_hex(colormaps[capability_run._COLOURS](v)), SEEN[who]) for v in (0.25, 0.5, 0.75)
    )
    for one, other in ((less, enough), (enough, more), (less, more)):
        assert np.linalg.norm(one - other) >= 20


def test_curves_differ_without_colour_too():
    styles = [chart_text.line_style(k) for k in range(35)]
    assert len({(s["color"], str(s["linestyle"])) for s in styles}) == 35
    for first, second in itertools.pairwise(styles):
        assert first["linestyle"] != second["linestyle"]


# --- text -------------------------------------------------------------------------------------


def texts_of(figure):
    """Return every text that is drawn, with its box in pixels."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    found = list(figure.texts)
    for legend in [*figure.legends, *(a.get_legend() for a in figure.axes if a.get_legend())]:
        found += legend.get_texts()
    for axes in figure.axes:
        found += [axes.title, *axes.texts]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            found += [axis.label, axis.get_offset_text()]
            found += [
                text
                for tick in axis.get_major_ticks()
                if low <= tick.get_loc() <= high
                for text in (tick.label1, tick.label2)
            ]
    return [
        (text.get_text(), text.get_window_extent(renderer))
        for text in found
        if text.get_visible() and text.get_text().strip()
    ]


@pytest.fixture
def figures(monkeypatch):
    """Return all figures that are drawn; each is checked: nothing cut off, nothing overlaps."""
    seen = []

    def kept(figure):
        boxes = texts_of(figure)
        for text, box in boxes:
            assert box.x0 >= 0 and box.y0 >= 0, text
            assert box.x1 <= figure.bbox.width and box.y1 <= figure.bbox.height, text
        for (one, box), (other, beside) in itertools.combinations(boxes, 2):
            wide = min(box.x1, beside.x1) - max(box.x0, beside.x0)
            high = min(box.y1, beside.y1) - max(box.y0, beside.y0)
            assert wide < 1.5 or high < 1.5, (one, other)
        seen.append(figure)
        return b"drawn"

    for module in (front_plots, motion_plots, simulation_plots, workspace_plots, capability_run):
        monkeypatch.setattr(module, "to_picture", kept)
    return seen


def labels_of(figure):
    return [t for axes in figure.axes for t in (axes.get_xlabel(), axes.get_ylabel()) if t]


NAMES = ("volume", "gci", "footprint", "projected_volume")
UNITS = {"volume": "mm^2 rad^3", "gci": "1", "footprint": "mm^2", "projected_volume": "mm^3",
         "R1": "mm", "R": "mm", "r": "mm", "twist": "rad"}  # fmt: skip


def front(count, objectives, scale=1.0):
    """Return the columns of a front."""
    rng = np.random.default_rng(count)
    t = np.linspace(0.0, 1.0, count)
    columns = {"R1": 500 + 450 * t, "R": 450 + 400 * rng.random(count), "r": 120 + 0 * t,
               "twist": 0.1 + 1e-5 * t}  # fmt: skip
    values = {"volume": 3e6 * scale * t + 1, "gci": 0.1 * scale * (1 - t**2) + 1e-6,
              "footprint": 1.2e6 + 1e5 * rng.random(count),
              "projected_volume": 4e8 * rng.random(count)}  # fmt: skip
    for name in objectives:
        columns |= {name: values[name], f"{name}_error": 0.03 * values[name]}
    return columns


@pytest.mark.parametrize(
    ("count", "scale"), [(1, 1.0), (2, 1.0), (5, 1.0), (60, 1.0), (5, 1e-7), (60, 1e9)]
)
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_fronts_can_be_read(number, count, scale, figures):
    objectives = NAMES[:number]
    columns = front(count, objectives, scale)
    draw_front(
        columns, UNITS, ["R1", "R", "r", "twist"], objectives, title="4-ups-rps: Pareto front",
        notes=["hypervolume 1.2·10⁶ mm² rad³ from volume 0 mm² rad³ and GCI 0"], knee=count // 2,
        colour_by="R1" if count > 1 else None,
    )  # fmt: skip
    labels = " ".join(labels_of(figures[0]))
    for name in objectives:
        assert style.NAMES.get(name, name.replace("_", " ")) in labels
    panels = {1: 1, 2: 1, 3: 3, 4: 6}[number]
    shaded = count > 1 or number == 3
    assert len(figures[0].axes) == panels * (2 if shaded else 1)
    if number == 3:  # what is not on its axes colours a panel
        for k in range(0, 6, 2):
            axes, bar = figures[0].axes[k : k + 2]
            shown = f"{axes.get_xlabel()} {axes.get_ylabel()} {bar.get_ylabel()}"
            assert all(name in shown for name in ("volume", "GCI", "footprint, minimised"))


@pytest.mark.parametrize(("count", "size"), [(1, 3e-9), (8, 0.2), (200, 4.8e11)])
def test_courses_can_be_read(count, size, figures):
    columns = {"generation": np.arange(1, count + 1), "hypervolume": size * np.ones(count)}
    draw_history(columns, UNITS, ("volume", "gci", "footprint"), title="x", notes=["y"])
    assert "mm⁴ rad³" in labels_of(figures[0])[1]


def test_the_colour_says_where_on_the_front():
    columns = {"volume": np.arange(9.0), "gci": -np.arange(9.0), "c": np.arange(9.0),
               "m": np.arange(9.0), "l": np.arange(9.0) ** 2, "n": np.arange(9.0) % 2,
               "s": 1e-3 * np.arange(9.0)}  # fmt: skip
    ranges = {"c": (0, 8), "m": (0, 8), "l": (0, 100), "n": (0, 1), "s": (0, 1), "fixed": 3.0}
    objectives = ("volume", "gci")
    assert influential(columns, ranges, (), objectives) in ("c", "m")
    assert influential(columns, ranges, [{"c": 1.0}], objectives) == "m"
    assert influential(columns, ranges, [{"c": 1.0}, {"m": 1.0, "n": 1.0}], objectives) == "l"
    both = [{"c": 1.0}, {"m": 1.0, "n": 1.0}]
    assert influential(columns, {k: ranges[k] for k in "cmn"}, both, objectives) == "m"
    assert influential(columns, {"c": ranges["c"]}, both, objectives) is None
    assert influential({k: v[:1] for k, v in columns.items()}, ranges, (), objectives) is None


def test_motions_can_be_read(home, figures):
    assert here("motion", "t1.toml", "--out", "run", cwd=home).returncode == 0
    manifest = json.loads((home / "run/manifest.json").read_text())
    assert manifest["missing_pictures"] == {}
    labels = [label for figure in figures for label in labels_of(figure)]
    assert "effort of theta1, phi, delta3 (N m)" in labels
    assert "rate of theta1, phi, delta3 (rad/s)" in labels
    for figure in figures:
        dashes = [str(line.get_linestyle()) + str(line._dash_pattern)
                  for line in figure.axes[0].lines]  # fmt: skip
        assert len(set(dashes)) == min(len(dashes), len(chart_text.DASHES))


def test_simulations_can_be_read(home, figures):
    assert here("simulate", "t1.toml", "--out", "run", cwd=home).returncode == 0
    assert json.loads((home / "run/manifest.json").read_text())["missing_pictures"] == {}
    labels = labels_of(figures[0])
    assert "effort of theta1 (N m)" in labels
    assert any(label.startswith("error\n(") and "% of peak" in label for label in labels)


def test_capabilities_can_be_read(home, figures):
    words = ("capability", MECH, "--samples", 1000, "--speed", 1, "--payload", 2, "--tool-force", 3,
             "--acceleration", 4, "--motors", "theta1_effort=300,theta2_effort=300,d_effort=200,"
             "theta1_rate=6,theta2_rate=6,d_rate=9", "--out", "run")  # fmt: skip
    assert here(*words, cwd=home).returncode == 0
    assert json.loads((home / "run/manifest.json").read_text())["missing_pictures"] == {}
    assert "needed / available" in " ".join(labels_of(figures[0]))


@pytest.mark.parametrize(
    "text", ["a" * 300, ", ".join(f"parameter_{k} = 1.234" for k in range(40))]
)
@pytest.mark.parametrize("width", [3.0, 6.4, 12.0])
def test_headings_stay_within_their_figure(width, text):
    above = chart_text.heading(width, text, text.split(", "))
    with style.new_figure(width, above.height + 1) as figure:
        above.write(figure)
        boxes = texts_of(figure)
        assert all(box.x1 <= figure.bbox.width for _, box in boxes)
        assert min(box.y0 for _, box in boxes) >= figure.dpi
        assert boxes[0][1].y0 >= boxes[1][1].y1


@pytest.mark.parametrize(
    ("values", "name"),
    [([0.0, 4e8], "volume (10⁶ mm³)"), ([0, 3e-4], "volume (10⁻⁶ mm³)"), ([0, 0.5], "volume (mm³)"),
     ([-2e5, 1.0], "volume (10³ mm³)"), ([0.0, 0.0], "volume (mm³)")],
)  # fmt: skip
def test_large_and_small_numbers_go_with_a_power_of_ten(values, name):
    with style.new_figure(4, 3) as figure:
        axes = figure.subplots()
        axes.plot(values)
        chart_text.name_axis(axes.yaxis, "volume", "mm^3", values)
        assert axes.get_ylabel() == name
        assert max(len(t.get_text()) for t in axes.get_yticklabels()) <= 6


# --- scales -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["3-ups-sp", "4-ups-rps", "2uu-upu", "3-cur", MECH])
def test_colours_of_an_index_are_used(name):
    """Half of what is shown is not in the lowest colours, and few values are beyond the last."""
    result = compute_workspace(find(name), {}, WorkspaceSettings(samples=4096), shape_grid=0)
    edges = result.histogram_edges
    middles = (edges[1:] + edges[:-1]) / 2
    shown = np.repeat(middles, np.array(result.histogram, dtype=int))
    scale = style.index_scale(shown)
    assert np.quantile(shown, 0.5) > 0.15 * scale.end
    assert np.quantile(shown, 0.9) > 0.5 * scale.end
    assert 0 <= scale.beyond <= 0.05


def test_the_bar_of_an_index_says_what_is_beyond(figures):
    result = compute_workspace(find(MECH), {}, WorkspaceSettings(samples=1000), shape_grid=0)
    shown = np.concatenate([np.linspace(0, 0.02, 990), np.full(10, 0.9)])
    scale = style.index_scale(shown)
    assert scale.end == pytest.approx(0.02)
    with style.new_figure(3, 3) as figure:
        style.draw_index_bar(figure, figure.add_axes((0.1, 0.1, 0.1, 0.8)), scale, result)
        assert labels_of(figure) == ["LCI (raw, 2-norm), 1 % larger"]
    assert style.index_scale([np.nan]).end == 1.0
    assert style.index_scale([0.0, 0.0]).end == 1.0


@pytest.mark.parametrize("name", ["3-ups-sp", "4-ups-rps", MECH])
def test_histograms_can_be_read(name, figures):
    settings = WorkspaceSettings(samples=4096, regions=(0, 0.02, 0.05, 0.1, 0.3, 0.5, 1.0))
    result = compute_workspace(find(name), {}, settings, shape_grid=0)
    workspace_plots.draw_histogram(result)
    low, high = figures[0].axes[0].get_xlim()
    assert low == 0
    assert result.quantiles[-1].value < high <= max(2.01 * result.largest.value, 0.01)
