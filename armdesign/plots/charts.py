"""Charts: points and curves as data, which a page shows with words at each point, and drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from armdesign.plots.canvas import figure, literal

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

GREY = "#7b8794"  # seen on light and on dark ground


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Points of one kind.

    Attributes:
        name: in the legend; curves of one name share their entry.
        colour: as "#rrggbb".
        x: along the abscissa.
        y: along the ordinate.
        kind: dots, rings about the dots of another curve, or a line.
        words: of each point, a text for each of the chart's ``heads``; empty for none.
    """

    name: str
    colour: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    kind: Literal["dots", "rings", "line"] = "dots"
    words: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        """Have an ordinate for each point, and for each as many words, or none for all.

        Raises:
            ValueError: there are more or fewer.
        """
        words = self.words or len(self.x) * ((),)
        if not len(self.x) == len(self.y) == len(words) or len(set(map(len, words))) > 1:
            raise ValueError("points differ in how many values or words they have")


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Curves on common axes.

    Attributes:
        title: above it.
        x: label of the abscissa, with its unit.
        y: label of the ordinate, with its unit.
        heads: what the words at a point are.
        curves: the points.
    """

    title: str
    x: str
    y: str
    heads: tuple[str, ...]
    curves: tuple[Curve, ...]


@literal
def chart_figure(chart: Chart) -> Figure:
    """Figure of a chart, for paper."""
    fig, (ax,) = figure()
    named = set[str]()
    for curve in chart.curves:
        label = "_nolegend_" if curve.name in named else curve.name
        named.add(curve.name)
        dots: dict[str, Any] = {"ls": "", "marker": "o", "ms": 4}
        rings = {**dots, "ms": 7, "mfc": "none"}
        drawn = {"dots": dots, "rings": rings, "line": {"ls": "-"}}[curve.kind]
        ax.plot(curve.x, curve.y, color=curve.colour, label=label, **drawn)
    ax.set(title=chart.title, xlabel=chart.x, ylabel=chart.y)
    ax.grid(alpha=0.3)
    ax.legend(frameon=False)
    return fig
