"""What all pictures share: style, text and the way to bytes.

Matplotlib is imported when something is drawn, and used without pyplot's state: no window opens,
no setting is left changed, and the reader's own matplotlibrc has no say.
"""

from __future__ import annotations

import importlib
import io
import logging
import math
import os
import re
import sys
import tempfile
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from threading import RLock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pmopt.analysis.workspace.compute import WorkspaceResult
from pmopt.errors import InputError
from pmopt.quantity import uncertain
from pmopt.units import ONE, exact, pretty

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

_DPI = 150
#: Matplotlib's own font, by its file.
_FONT = "DejaVuSans*"
FORMS = ("png", "svg", "pdf")
#: What each form would say of time and program.
_METADATA = {"png": ("Software",), "svg": ("Date",), "pdf": ("Creator", "Producer", "CreationDate")}
_FORM: ContextVar[str] = ContextVar("form", default="png")
#: Where figures go that are wanted as figures, not as bytes.
_KEPT: ContextVar[list[Figure] | None] = ContextVar("kept", default=None)
COLOURS = "viridis"
INK, FAINT, LINE = "#222222", "#808080", "#0072B2"
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
#: A number of a text with more digits than are read.
_LONG = re.compile(r"-?\d+\.\d{6,}(?:e[-+]?\d+)?")
#: Numbers from the first to the second are written without a power of ten.
_PLAIN = (1e-4, 1e7)
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
#: Colours end at this quantile of what is shown, unless the largest value is hardly above it.
_SHOWN, _TAIL = 0.95, 1.25
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
        if _KEPT.get() is None:
            figure = Figure((width, height), dpi=_DPI, facecolor="white")
            FigureCanvasAgg(figure)
        else:
            from matplotlib import pyplot

            figure = pyplot.figure(figsize=(width, height), dpi=_DPI, facecolor="white")
        yield figure


def _import_matplotlib() -> None:
    """Import matplotlib, also where settings made for other programs keep it from that."""
    with _silence():
        try:
            importlib.import_module("matplotlib")
        except ModuleNotFoundError:
            raise
        except Exception:
            for name in [n for n in sys.modules if n.partition(".")[0] == "matplotlib"]:
                del sys.modules[name]  # half imported
            with _without_settings():
                importlib.import_module("matplotlib")
        # What draws looks for fonts when it is imported, and speaks of it.
        from matplotlib import font_manager, get_data_path
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
    """Return the picture without the metadata that differs from machine to machine.

    It is a PNG, or what :func:`drawn_as` says.
    """
    kept = _KEPT.get()
    if kept is not None:
        figure.draw_without_rendering()  # while the style holds
        kept.append(figure)
        return b""
    buffer = io.BytesIO()
    form = _FORM.get()
    figure.savefig(buffer, format=form, metadata=dict.fromkeys(_METADATA[form]))
    return buffer.getvalue()


@contextmanager
def kept_figures() -> Iterator[list[Figure]]:
    """Within a block pictures stay figures, known to pyplot, and no bytes are made of them.

    For those who look at them in a notebook and go on with their axes.
    """
    figures: list[Figure] = []
    token = _KEPT.set(figures)
    try:
        yield figures
    finally:
        _KEPT.reset(token)


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


def caption_parts(result: WorkspaceResult, remarks: Sequence[str] = ()) -> tuple[str, list[str]]:
    """Return mechanism and dimensions, and what else stands below them."""
    params = {name: value for name, value in result.params.items() if value is not None}
    volume, gci = result.volume, result.gci
    parts = [f"volume {estimate_text(volume.value, volume.error, volume.unit)}"]
    if result.reachable:
        parts.append(f"GCI {estimate_text(gci.value, gci.error)}")
    if result.grid:
        parts.append("± are error bounds")
    parts += [f"{name} in [{exact(low)}, {exact(high)}] {result.units[name]}"
              for name, (low, high) in result.settings.limits.items()]  # fmt: skip
    if result.settings.min_lci > 0:
        parts.append(f"LCI ≥ {exact(result.settings.min_lci)}")
    parts += [f"working mode {result.working_mode}", *remarks]
    return f"{result.mechanism}: {parameter_text(params, result.units)}", parts


def write_note(figure: Figure, result: WorkspaceResult) -> None:
    """Write below what the index is of."""
    width, height = figure.get_size_inches()
    text = f"LCI: {rounded(result.index_note)}"
    note = textwrap.wrap(text, int((width - 0.3) / (CHARACTER * 7 / 8)))
    figure.text(0.15 / width, 0.1 / height, "\n".join(note), fontsize=7, color="#555555")


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


def rounded_up(value: float) -> float:
    """Return the next number above that is 1, 1.5, 2, 3, 4, 5, 6 or 8 times a power of ten."""
    power = math.floor(math.log10(value))
    # Powers of ten are exact as text, not as products.
    steps = (float(f"{step}e{power}") for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10))
    return next((end for end in steps if end >= value), value)


class IndexScale(NamedTuple):
    """Colours of LCI from 0 on.

    Attributes
    ----------
    mappable : ScalarMappable
    end : float
        Where the colours end.
    beyond : float
        Share of what is shown that has a larger index.
    """

    mappable: ScalarMappable
    end: float
    beyond: float


def index_scale(values: ArrayLike) -> IndexScale:
    """Return colours of LCI that fit what is shown: few large values leave the rest its colours.

    They begin at 0, a singularity.

    Parameters
    ----------
    values : array_like
        All that is shown; NaN is nothing.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    shown = np.asarray(values, dtype=float)
    shown = shown[np.isfinite(shown)]
    most = float(shown.max()) if shown.size else 0.0
    end = 1.0
    if most > 0:
        high = float(np.quantile(shown, _SHOWN))
        end = rounded_up(most if most <= _TAIL * high or high <= 0 else high)
    beyond = float((shown > end).mean()) if shown.size else 0.0
    return IndexScale(ScalarMappable(Normalize(0.0, end), COLOURS), end, beyond)


def draw_index_bar(figure: Figure, beside: Axes, scale: IndexScale, result: WorkspaceResult) -> Any:
    """Draw the colours of LCI, and say what share of the values lies beyond them."""
    bar = figure.colorbar(scale.mappable, cax=beside, extend="max" if scale.beyond else "neither")
    text = index_label(result)
    bar.set_label(f"{text}, {100 * scale.beyond:.1g} % larger" if scale.beyond else text)
    return bar


def estimate_text(value: float, error: float, unit: str = ONE) -> str:
    """Return an uncertain number as pictures show it, with its unit.

    Without a known error, 0 or NaN, it is the value alone; very large and very small ones go with
    a power of ten, ``(1.50 ± 0.45)·10⁹ mm³``.
    """
    known = math.isfinite(error) and error > 0
    size = max(abs(value), error if known else 0.0)
    most = _PLAIN[1] if known else _PLAIN[1] / 10
    if size > 0 and not _PLAIN[0] <= size < most and math.isfinite(size):
        power = math.floor(math.log10(size))
        scaled = estimate_text(value / 10.0**power, error / 10.0**power)
        text = f"({scaled})" if known else scaled
        return with_unit(f"{text}·10{str(power).translate(RAISED)}", unit)
    if not known:
        return with_unit(f"{value:.6g}", unit)
    return uncertain(value, error, pretty(unit))


def rounded(text: str) -> str:
    """Return a text whose numbers have six digits at most."""
    return _LONG.sub(lambda found: f"{float(found[0]):.6g}", text)
