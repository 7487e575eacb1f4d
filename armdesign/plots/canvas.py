"""The door to matplotlib: figures without a display, colours, joints as axes, saving."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

import numpy as np

from armdesign import user_folders
from armdesign.arrays import Array
from armdesign.drawing.colours import ACTUATORS
from armdesign.errors import ArmDesignError, printable
from armdesign.plots.palette import in_few_colours
from armdesign.transaction import undisturbed
from armdesign.units import deg, mm

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure

    from armdesign.machine.machine import Machine
    from armdesign.mechanism.urdf import Joint

P = ParamSpec("P")
T = TypeVar("T")
Style: TypeAlias = dict[str, Any]  # of a line, a patch or words: keywords of matplotlib

COLOURS = "viridis"
INK = "#20262e"
MARK = "#e5484d"
COMPUTED = "#3b82c4"
CYLINDER = "#f5a524"
STYLES = (("--", INK), ("-", MARK), ("-.", COMPUTED), (":", CYLINDER))  # one machine each


WIDTH = 10.0  # [in] of every figure, so that words are of one size wherever two stand together
FORMATS = ("png", "svg", "pdf")
_too = ContextVar("format in which a PNG is written, too", default="png")
DOTS = 150  # per inch of a picture
POINTS = 72  # per inch, of sizes of letters
HELD = "\u00a0"  # a blank at which no line breaks
PAPER = 0.88  # of the width of a part of a figure, for its title
STYLE = {
    "font.family": "sans-serif",
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titley": 1.0,  # no search for ticks above the axes: there are none
    "axes.labelsize": 9,
    "axes.axisbelow": True,
    "axes.edgecolor": "#4b5563",
    "axes.linewidth": 0.7,
    "axes.unicode_minus": True,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "figure.titlesize": 11,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "hatch.linewidth": 0.7,
    "svg.fonttype": "none",  # words stay words, which can be searched and copied
    "svg.hashsalt": "armdesign",
    "pdf.fonttype": 42,
}


def figure(
    columns: int = 1, width: float = 7.0, height: float = 4.4, rows: int = 1
) -> tuple[Figure, Any]:
    """Figure drawn without a display, and its axes, row by row.

    It is ``WIDTH`` wide, whatever it holds; ``width`` and ``height`` are the proportions of one
    of its parts.

    Raises:
        ArmDesignError: no folder can be written, and matplotlib needs one for its fonts.
    """
    choose_font_cache()
    with undisturbed():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        from armdesign.plots.layout import Places

    size = WIDTH, height * rows * WIDTH / (width * columns)
    with style():
        fig = Figure(figsize=size, layout=Places())
        FigureCanvasAgg(fig)
        axes = fig.subplots(rows, columns, squeeze=False).ravel()
    show_in_notebooks(fig, axes)
    return fig, axes


def show_in_notebooks(fig: Any, axes: Iterable[Any]) -> None:
    """Let a notebook show the figure where the value of a cell is the figure or axes of it."""
    for shown in (fig, *axes):
        shown._repr_png_ = partial(_png, fig)


def _png(fig: Figure) -> bytes:
    """A figure as PNG."""
    stream = io.BytesIO()
    with style():
        fig.savefig(stream, format="png", dpi=DOTS)
    return stream.getvalue()


@contextmanager
def style() -> Iterator[None]:
    """Context in which all that is drawn has the one style of the package.

    Else it is drawn as matplotlib does by itself, whatever a ``matplotlibrc`` says: pictures are
    the same everywhere, and no words are handed to TeX.
    """
    import matplotlib
    from cycler import cycler

    usual = {k: v for k, v in matplotlib.rcParamsDefault.items() if not k.startswith("backend")}
    chosen: Any = {**usual, **STYLE, "axes.prop_cycle": cycler(color=ACTUATORS)}
    with matplotlib.rc_context(chosen), _any_script():
        yield


@contextmanager
def _any_script() -> Iterator[None]:
    """Context without warnings of names in a script that the font lacks."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")
        yield


def below(ax: Axes, inches: float) -> Any:
    """Transform of points that are told in shares of axes, moved down by some inches."""
    from matplotlib.transforms import ScaledTranslation

    return ax.transAxes + ScaledTranslation(0, -inches, ax.figure.dpi_scale_trans)


def legend_below(ax: Axes, **style: Any) -> None:
    """Legend below axes and the label of their lower one, where it hides no curve."""
    place = {"bbox_transform": below(ax, 0.45), "bbox_to_anchor": (0.5, 0.0)}
    ax.legend(loc="upper center", **place, **style)


def colours_between(values: Array, least: float, most: float) -> Array:
    """Red, green and blue (n, 3) of numbers on the scale of maps, from 0 to 1."""
    choose_font_cache()
    with undisturbed():
        from matplotlib import colormaps

    share = np.clip((np.asarray(values) - least) / (most - least), 0.0, 1.0)
    return np.asarray(colormaps[COLOURS](share)[:, :3])


def choose_font_cache() -> None:
    """Give matplotlib a lasting folder where the user's home cannot be written.

    Raises:
        ArmDesignError: no folder can be written.
    """
    home = Path(os.path.expanduser(os.environ.get("XDG_CONFIG_HOME") or "~/.config"))
    existing = next((folder for folder in (home, *home.parents) if folder.is_dir()), home)
    chosen = "matplotlib" in sys.modules or "MPLCONFIGDIR" in os.environ
    if chosen or (home.is_absolute() and user_folders.writable(existing)):
        return
    for folder in user_folders.temporary():
        cache = folder / "matplotlib"
        with contextlib.suppress(OSError):
            if user_folders.made_private(cache) and user_folders.writable(cache):
                os.environ["MPLCONFIGDIR"] = str(cache)
                return
    try:
        tempfile.gettempdir()  # the last place where matplotlib looks itself
    except FileNotFoundError:
        fault = "no folder can be written for its list of fonts"
        remedy = "set MPLCONFIGDIR to a folder that can"
        raise ArmDesignError("matplotlib", fault, remedy) from None


@contextmanager
def saving_as(format: str) -> Iterator[None]:
    """Context in which ``save`` writes a PNG in that format, too."""
    before = _too.set(format)
    try:
        yield
    finally:
        _too.reset(before)


def save(fig: Any, path: Path) -> Path:
    """Write a figure as PNG, SVG or PDF, as the suffix says; the same figure, the same file.

    Raises:
        ArmDesignError: another suffix.
    """
    if path.suffix == ".png" and _too.get() != "png":
        save(fig, path.with_suffix(f".{_too.get()}"))
    kind = path.suffix.removeprefix(".").lower()
    if kind not in FORMATS:
        fault = f'"{path.suffix}" is no format of pictures'
        raise ArmDesignError(path.name, fault, f"end it with .{', .'.join(FORMATS)}")
    _make_literal(fig)
    with style():
        if kind == "png" and hasattr(fig.canvas, "buffer_rgba"):
            fig.set_dpi(DOTS)
            fig.canvas.draw()
            dots = np.asarray(fig.canvas.buffer_rgba())
            in_few_colours(dots).save(path, dpi=(DOTS, DOTS))
        else:
            dates = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
            fig.savefig(path, dpi=DOTS, metadata=dates.get(kind))
    return path


def literal(draw: Callable[P, T]) -> Callable[P, T]:
    """Decorator: the package's style, names as they are, without controls, titles that wrap."""

    @wraps(draw)
    def literally(*args: P.args, **kwargs: P.kwargs) -> T:
        choose_font_cache()
        with style():
            drawn = draw(*args, **kwargs)
        _make_literal(drawn)
        _wrap_titles(drawn)
        return drawn

    return literally


def _make_literal(drawn: Any) -> None:
    """Make all texts literal except tick labels, whose powers of ten are formulas.

    Texts may have several lines: names that come from outside are put on one by ``title_of``.
    """
    texts, heading = list(drawn.texts), getattr(drawn, "_suptitle", None)
    texts += [] if heading is None else [heading]
    for ax in drawn.axes if hasattr(drawn, "savefig") else [drawn]:
        titles = (ax.title, ax._left_title, ax._right_title)
        texts += [*titles, ax.xaxis.label, ax.yaxis.label, *ax.texts]
        if legend := ax.get_legend():
            texts += legend.get_texts()
    for text in texts:
        lines = text.get_text().split("\n")
        text.set_text("\n".join(printable(line) for line in lines))
        text.set_parse_math(False)


def _wrap_titles(drawn: Any) -> None:
    """Break titles into lines that stay within their part of the figure."""
    width = float(drawn.figure.bbox.width / drawn.figure.dpi)
    if (heading := getattr(drawn, "_suptitle", None)) is not None:
        _wrap(heading, width)
    for ax in drawn.axes if hasattr(drawn, "savefig") else [drawn]:
        for title in (ax.title, ax._left_title, ax._right_title):
            _wrap(title, width * _share_of_width(ax))


def _share_of_width(ax: Axes) -> float:
    """Share of the figure's width that is for axes and what stands around them."""
    place = ax.get_subplotspec()
    if place is None:
        return float(ax.get_position().width)
    grid = place.get_gridspec()
    ratios = np.array(grid.get_width_ratios())
    return float(ratios[place.colspan.start : place.colspan.stop].sum() / ratios.sum())


def _wrap(text: Any, inches: float) -> None:
    text.set_text("\n".join(wrapped(text.get_text(), inches, text.get_fontsize())))


def wrapped(words: str, inches: float, points: float) -> list[str]:
    """Lines of words in letters of that size [pt], each within a part of a figure, less margins.

    Lines that fit stay as they are; longer ones break at spaces, words that are longer anywhere.
    """
    return [part for line in words.split("\n") for part in _parts(line, PAPER * inches, points)]


def _parts(line: str, inches: float, points: float) -> list[str]:
    width = line_width(line, points)
    if width <= inches:
        return [line]
    held = re.sub(r"(?<=\d) (?=\w)", HELD, line)  # a number and its unit
    most = min(len(line), int(1.3 * len(line) * inches / width) + 1)  # letters differ in width
    for letters in range(most, 1, -1):
        parts = [part.replace(HELD, " ") for part in textwrap.wrap(held, letters)]
        if max((line_width(part, points) for part in parts), default=0.0) <= inches:
            return parts
    return textwrap.wrap(line, 1)


def line_width(line: str, points: float) -> float:
    """Width of a line of letters of that size [in]."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(size=points)
    with _any_script():
        width, _, _ = text_to_path.get_text_width_height_descent(line, font, ismath=False)
    return float(width) / POINTS


def title_of(machine: Machine) -> str:
    """Name of a machine in pictures, on one line."""
    return printable(machine.section.title or machine.name)


def joint_values(joint: Joint, q: Array) -> Array:
    """Positions of a joint [rad, m] in the unit of its axis, degrees or millimetres."""
    return q / (deg if joint.revolute else mm)


def joint_label(joint: Joint) -> str:
    """Label of a joint's axis: its name and unit."""
    return f"{joint.name} [{'deg' if joint.revolute else 'mm'}]"


def plain_decades(ax: Axes) -> None:
    """A logarithmic axis with numbers as people write them."""
    ax.set_yscale("log")
    plain_ticks(ax.yaxis, *ax.get_ylim())


def plain_ticks(axis: Any, low: float, high: float) -> None:
    """Plain numbers on a logarithmic axis: 0.2, 0.5, 1 …, even ones where it spans no decade."""
    from matplotlib.ticker import LogLocator, MaxNLocator, StrMethodFormatter

    decades = high > 10 * low
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)) if decades else MaxNLocator(6))
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter("")
