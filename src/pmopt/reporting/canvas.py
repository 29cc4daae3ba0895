"""What all pictures share: style, text and the way to bytes.

Matplotlib is imported when something is drawn, and used without pyplot's state: no window opens,
no setting is left changed, and the reader's own matplotlibrc has no say.
"""

from __future__ import annotations

import io
import logging
import math
import os
import sys
import tempfile
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any

import numpy as np

from pmopt.analysis.estimates import Estimate
from pmopt.analysis.workspace import WorkspaceResult
from pmopt.errors import InputError
from pmopt.units import ONE, exact, pretty

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

_DPI = 150
#: Matplotlib's own font, by its file.
_FONT = "DejaVuSans*"
FORMS = ("png", "svg", "pdf")
#: What each form would say of time and program.
_METADATA = {"png": ("Software",), "svg": ("Date",), "pdf": ("Creator", "Producer", "CreationDate")}
_FORM: ContextVar[str] = ContextVar("form", default="png")
COLOURS = "viridis"
INK, FAINT, LINE = "#222222", "#808080", "#2f5d8a"
_STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "svg.hashsalt": "pmopt",
    "svg.fonttype": "none",
    "pdf.fonttype": 42,
    "axes.labelcolor": INK,
    "text.color": INK,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
}
#: Width of a character of the smaller text, in inches.
CHARACTER = 0.066
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Where the largest index is smaller than this, axes and colours end there.
SMALL_INDEX = 0.1
NAMES = {"gci": "GCI", "lci": "LCI"}


#: Matplotlib's settings are the process's: one picture at a time.
_SETTINGS = RLock()


@contextmanager
def new_figure(width: float, height: float) -> Iterator[Figure]:
    """Give a figure that is styled alike whatever the reader's own settings are."""
    with _SETTINGS:
        _import_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with _SETTINGS, _silence(), matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure((width, height), dpi=_DPI, facecolor="white")
        FigureCanvasAgg(figure)
        yield figure


def _import_matplotlib() -> None:
    """Import matplotlib, also where settings made for other programs keep it from that."""
    with _silence():
        try:
            import matplotlib  # noqa: F401
        except ModuleNotFoundError:
            raise
        except Exception:
            for name in [n for n in sys.modules if n.partition(".")[0] == "matplotlib"]:
                del sys.modules[name]  # half imported
            with _without_settings():
                import matplotlib  # noqa: F401
        # What draws looks for fonts when it is imported, and speaks of it.
        from matplotlib import font_manager, get_data_path
        from matplotlib.backends import backend_agg  # noqa: F401
    fonts = Path(get_data_path(), "fonts", "ttf")
    known = {Path(font.fname) for font in font_manager.fontManager.ttflist}
    for path in fonts.glob(f"{_FONT}.ttf"):  # a list left from elsewhere may lack even its own
        if path not in known:
            font_manager.fontManager.addfont(path)


@contextmanager
def _silence() -> Iterator[None]:
    """Keep matplotlib's news of the machine to itself: no home, odd settings, fonts it lacks."""
    log = logging.getLogger("matplotlib")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


@contextmanager
def _without_settings() -> Iterator[None]:
    """Hide the reader's settings: variables of the environment and ``matplotlibrc`` files.

    One in the working folder is read before all others, so another folder is worked in meanwhile.
    """
    names = ("MPLBACKEND", "MATPLOTLIBRC", "MPLCONFIGDIR")
    kept = {name: os.environ.pop(name) for name in names if name in os.environ}
    here = os.open(".", os.O_RDONLY)
    try:
        with tempfile.TemporaryDirectory() as empty:
            os.environ["MPLCONFIGDIR"] = empty
            os.chdir(empty)
            yield
            os.fchdir(here)
    finally:
        os.fchdir(here)
        os.close(here)
        del os.environ["MPLCONFIGDIR"]
        os.environ.update(kept)


def to_picture(figure: Figure) -> bytes:
    """Return the picture without the metadata that would tell one machine from another.

    It is a PNG, or what :func:`drawn_as` says.
    """
    buffer = io.BytesIO()
    form = _FORM.get()
    figure.savefig(buffer, format=form, metadata=dict.fromkeys(_METADATA[form]))
    return buffer.getvalue()


@contextmanager
def drawn_as(form: str) -> Iterator[None]:
    """Draw pictures as ``png``, ``svg`` or ``pdf`` within a block."""
    token = _FORM.set(form)
    try:
        yield
    finally:
        _FORM.reset(token)


def form_of(path: Path, where: str) -> str:
    """Return the form of a picture by its suffix.

    Raises
    ------
    InputError
    """
    form = path.suffix.lower().removeprefix(".")
    if form not in FORMS:
        raise InputError(
            f"{where}: {path}: {path.suffix or 'no suffix'} is not offered, "
            f"allowed: {', '.join(f'.{f}' for f in FORMS)}"
        )
    return form


def fit_axes(figure: Figure, axes: Any, place: tuple[float, float, float, float]) -> None:
    """Move and scale 3-D axes so that they fill a part of the figure, labels included."""
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d import proj3d

    scale = np.tile(figure.bbox.size, 2)
    target = np.array(place) * scale
    renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    limits = np.reshape(axes.get_w_lims(), (3, 2))
    corners = [m.ravel() for m in np.meshgrid(*limits)]
    for _ in range(3):  # labels keep their size
        axes.apply_aspect()
        flat = np.stack(proj3d.proj_transform(*corners, axes.get_proj())[:2], axis=1)
        drawn = axes.transData.transform(flat)
        cube = np.stack([drawn.min(axis=0), drawn.max(axis=0)])
        parts = [axis.get_tightbbox(renderer) for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
        box = Bbox.union([*parts, Bbox(cube)])
        now = np.array(axes.get_position(original=True).bounds) * scale
        factor = min(target[2] / box.width, target[3] / box.height)
        corner = target[:2] + target[2:] / 2 + factor * (now[:2] - np.add(box.min, box.max) / 2)
        axes.set_position(np.concatenate([corner, factor * now[2:]]) / scale)


def write_caption(figure: Figure, result: WorkspaceResult, remarks: Sequence[str] = ()) -> None:
    """Write mechanism, dimensions and volume above, what the index is of below."""
    width, height = figure.get_size_inches()

    def wrap(text: str, size: float) -> list[str]:
        return textwrap.wrap(text, int((width - 0.3) / (CHARACTER * size / 8)))

    params = {name: value for name, value in result.params.items() if value is not None}
    head = wrap(f"{result.mechanism}: {parameter_text(params, result.units)}", 10.5)
    parts = [f"volume {with_unit(format_estimate(result.volume), result.volume_unit)}"]
    if result.reachable:
        parts.append(f"GCI {format_estimate(result.gci)}")
    if result.grid:
        parts.append("± are error bounds")
    parts += [f"{name} in [{exact(low)}, {exact(high)}] {result.units[name]}"
              for name, (low, high) in result.settings.limits.items()]  # fmt: skip
    if result.settings.min_lci > 0:
        parts.append(f"LCI ≥ {exact(result.settings.min_lci)}")
    parts += [f"working mode {result.working_mode}", *remarks]
    body = wrap(", ".join(part.replace(" ", "\u00a0") for part in parts), 8.5)
    note = wrap(f"LCI: {result.index_note}", 7)
    x, top = 0.15 / width, 1 - 0.12 / height
    figure.text(x, top, "\n".join(head), va="top", fontsize=10.5)
    top -= 0.21 * len(head) / height
    figure.text(x, top, "\n".join(body), va="top", fontsize=8.5, color="#555555")
    figure.text(x, 0.1 / height, "\n".join(note), fontsize=7, color="#555555")


def draw_nothing(result: WorkspaceResult) -> bytes:
    """Draw what stands for a picture of an empty workspace."""
    with new_figure(6.0, 2.2) as figure:
        found = "nothing reachable" if result.reachable == 0 else (
            "the reachable set is too small for the grid of this picture"
        )  # fmt: skip
        figure.text(0.5, 0.42, found, ha="center", va="center", fontsize=13, color=FAINT)
        write_caption(figure, result)
        return to_picture(figure)


def label(name: str, unit: str) -> str:
    """Return the label of an axis."""
    return name if unit == ONE else f"{name} ({pretty(unit)})"


def with_unit(text: str, unit: str) -> str:
    """Return a number with its unit."""
    return text if unit == ONE else f"{text}\u00a0{pretty(unit)}"


def index_label(result: WorkspaceResult) -> str:
    """Return what axes and colour bars call the index."""
    norm = "Frobenius norm" if result.norm == "fro" else f"{result.norm}-norm"
    return f"LCI ({result.jacobian}, {norm})"


def parameter_text(values: Mapping[str, Any], units: Mapping[str, str]) -> str:
    """Return the parameters in words; a unit that all share stands once, at the end."""
    shared = {units[name] for name in values}
    one = shared.pop() if len(shared) == 1 else None
    parts = [f"{name} = {with_unit(f'{value:.4g}', units[name] if one is None else ONE)}"
             for name, value in values.items()]  # fmt: skip
    text = ", ".join(part.replace(" ", "\u00a0") for part in parts)
    return text if one is None else with_unit(text, one)


def largest_colour(result: WorkspaceResult) -> float:
    """Return where the colours of LCI end, the same in every picture of a workspace."""
    largest = result.largest.value
    if math.isnan(largest) or largest <= 0:
        return 1.0
    if largest < SMALL_INDEX:
        return rounded_up(largest)
    return min(1.0, max(0.1, math.ceil(10 * largest) / 10))


def rounded_up(value: float) -> float:
    """Return the next number above that is 1, 1.5, 2, 3, 4, 5, 6 or 8 times a power of ten."""
    power = math.floor(math.log10(value))
    # Powers of ten are exact as text, not as products.
    steps = (float(f"{step}e{power}") for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10))
    return next((end for end in steps if end >= value), value)


def colour_scale(result: WorkspaceResult) -> ScalarMappable:
    """Return the colours of LCI."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(0.0, largest_colour(result)), COLOURS)


def format_estimate(estimate: Estimate) -> str:
    """Return value and error to the error's first digit, e.g. ``10.206 ± 0.001``."""
    value, error = estimate
    if not math.isfinite(error) or error <= 0:
        return f"{value:.6g}"
    size = max(abs(value), error)
    if not 1e-4 <= size < 1e7:
        power = math.floor(math.log10(size))
        scaled = format_estimate(Estimate(value / 10.0**power, error / 10.0**power))
        return f"({scaled})·10{str(power).translate(_RAISED)}"
    digits = max(0, -math.floor(math.log10(float(f"{error:.0e}"))))
    return f"{value:.{digits}f} ± {error:.{digits}f}"
