"""Interactive maps of the page: empty figures that its script fills. The only door to bokeh.

Bokeh is a library whose output needs nothing but itself; the page carries its smallest bundle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from armdesign.report.scene import CellAxis, Scene

TOOLTIPS = [
    ("frequency", "@words"),
    ("pose", "@pose"),
    ("load case", "@load"),
    ("limited by", "@part"),
    ("all poses of the cell", "@spread"),
]
MARK = "#e5484d"


class Interactive(NamedTuple):
    """Parts of a page: scripts of the library and of the figures, and a place for each figure."""

    library: str
    script: str
    places: tuple[str, ...]


def interactive(scene: Scene) -> Interactive:
    """A figure for each machine of a scene, ``map-0`` …, with its sources, filled by a script."""
    from bokeh.embed import components
    from bokeh.resources import Resources

    figures = tuple(_figure(scene, index) for index in range(len(scene.machines)))
    script, places = components(figures, wrap_script=False)
    library = "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)
    return Interactive(library, script, tuple(places))


def _figure(scene: Scene, index: int) -> Any:
    from bokeh.models import ColumnDataSource, CustomJS, HoverTool, LinearColorMapper, Range1d
    from bokeh.palettes import Viridis256
    from bokeh.plotting import figure

    names = ("x", "y", "width", "height", "value", "words", "pose", "load", "part", "spread")
    cells = ColumnDataSource({name: [] for name in names}, name=f"cells-{index}")
    marks = ColumnDataSource({"x": [], "y": []}, name=f"marks-{index}")
    x, y = scene.planes[0].x, scene.planes[0].y
    plot = figure(
        name=f"map-{index}",
        height=360,
        sizing_mode="stretch_width",
        tools="tap,reset,pan,box_zoom",
        x_range=_range(x),
        y_range=_range(y) if y else Range1d(0, 1),
        x_axis_label=f"{x.name} [{x.unit}]",
        y_axis_label=f"{y.name} [{y.unit}]" if y else "frequency [Hz]",
        min_border_left=66,
        toolbar_location="below",
        title=scene.machines[index].label,
    )
    colours = LinearColorMapper(palette=Viridis256, low=0, high=1, name=f"colours-{index}")
    fill = {"field": "value", "transform": colours}
    style = {"fill_color": fill, "line_color": fill, "nonselection_alpha": 1.0}
    if y is None:
        drawn = plot.scatter("x", "value", size=9, source=cells, **style)
    else:
        drawn = plot.rect("x", "y", "width", "height", source=cells, **style)
    plot.scatter("x", "y", size=15, source=marks, fill_color=None, line_color=MARK, line_width=2.5)
    plot.add_tools(HoverTool(renderers=[drawn], tooltips=TOOLTIPS))
    plot.toolbar.logo = None
    plot.xgrid.visible = plot.ygrid.visible = False
    plot.background_fill_color = plot.border_fill_color = None
    picked = CustomJS(code=f"window.armdesignPick({index}, cb_obj.indices)")
    cells.selected.js_on_change("indices", picked)
    return plot


def _range(axis: CellAxis) -> Any:
    """The range of all cells along an axis."""
    from bokeh.models import Range1d

    half = axis.width / 2
    return Range1d(min(axis.middles) - half, max(axis.middles) + half)
