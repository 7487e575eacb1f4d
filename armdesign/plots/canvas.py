"""The only door to matplotlib: figures without a display, colours, joints as axes, saving."""

from __future__ import annotations

import contextlib
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from armdesign import user_folders
from armdesign.arrays import Array
from armdesign.errors import ArmDesignError, printable

if TYPE_CHECKING:
    from armdesign.mechanism.urdf import Joint

P = ParamSpec("P")
T = TypeVar("T")

COLOURS = "viridis"
INK = "#20262e"
MARK = "#e5484d"
COMPUTED = "#3b82c4"
CYLINDER = "#f5a524"
STYLES = (("--", INK), ("-", MARK), ("-.", COMPUTED), (":", CYLINDER))  # one machine each


def figure(
    columns: int = 1, width: float = 7.0, height: float = 5.2, rows: int = 1
) -> tuple[Any, Any]:
    """Figure drawn without a display, and its axes, row by row; ``width``, ``height`` are of one.

    Raises:
        ArmDesignError: no folder can be written, and matplotlib needs one for its fonts.
    """
    choose_font_cache()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    fig = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(fig)
    return fig, fig.subplots(rows, columns, squeeze=False).ravel()


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


def save(fig: Any, path: Path) -> Path:
    """Write a figure as PNG."""
    _make_literal(fig)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # a name in a script that the font lacks
        fig.savefig(path, dpi=150)
    return path


def literal(draw: Callable[P, T]) -> Callable[P, T]:
    """Decorator: names in the returned axes or figure stand as they are, no controls."""

    @wraps(draw)
    def literally(*args: P.args, **kwargs: P.kwargs) -> T:
        drawn = draw(*args, **kwargs)
        _make_literal(drawn)
        return drawn

    return literally


def _make_literal(drawn: Any) -> None:
    """Make all texts literal except tick labels, whose powers of ten are formulas."""
    texts = list(drawn.texts)
    for ax in drawn.axes if hasattr(drawn, "savefig") else [drawn]:
        texts += [ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts]
        if legend := ax.get_legend():
            texts += legend.get_texts()
    for text in texts:
        text.set_text(printable(text.get_text()))
        text.set_parse_math(False)


def joint_values(joint: Joint, q: Array) -> Array:
    """Positions of a joint [rad, m] in the unit of its axis, degrees or metres."""
    return q * (math.degrees(1) if joint.revolute else 1.0)


def joint_label(joint: Joint) -> str:
    """Label of a joint's axis: its name and unit."""
    return f"{joint.name} [{'deg' if joint.revolute else 'm'}]"
