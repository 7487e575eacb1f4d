"""Interactive maps and charts of the page. The only door to bokeh.

Maps are empty figures that the page's script fills; charts have their points.

Bokeh is a library whose output needs nothing but itself; the page carries its smallest bundle,
compressed, which browsers unpack since 2023; older ones show the pictures of paper instead. The
figures are the documents that this bundle reads, as data: bokeh's Python writes the same, and
loading it would take as long as the map itself.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.plots.canvas import MARK, colours_between
from armdesign.plots.charts import Chart, Curve
from armdesign.report.scene import BANDWIDTH, FREQUENCY, CellAxis, MapScene

TOOLTIPS = {
    FREQUENCY: [
        ("frequency", "@words"),
        ("pose", "@pose"),
        ("load case", "@load"),
        ("limited by", "@part"),
        ("all poses of the cell", "@spread"),
    ],
    BANDWIDTH: [
        ("bandwidth", "@words"),
        ("pose", "@pose"),
        ("load case", "@load"),
        ("narrowest loop", "@part"),
        ("lowest frequency", "@frequency"),
        ("other controllers", "@others"),
        ("all poses of the cell", "@spread"),
    ],
}
PLACED = ("x", "y", "width", "height", "value")
COLUMNS = (*PLACED, "words", "pose", "load", "part", "spread", "frequency", "others")
LIBRARY = "server/static/js/bokeh.min.js"
LEVEL = 4  # of its compression: 4 % larger than the default's, in half the time
SCRIPT = """{
  const documents = %s;
  documents.figures.version = Bokeh.version;
  Bokeh.embed.embed_items(documents, %s);
}"""
PLACE = '<div id="{place}" data-root-id="{figure}" style="display: contents"></div>'

Model = dict[str, Any]


class Interactive(NamedTuple):
    """Parts of a page: scripts of the library and of the figures, and a place for each figure."""

    library: str
    script: str
    places: tuple[str, ...]
    charts: dict[Chart, str]


def interactive(scene: MapScene | None, charts: Sequence[Chart] = ()) -> Interactive:
    """A figure for each machine of a scene, ``map-0`` …, filled by a script, and for each chart.

    Raises:
        ArmDesignError: bokeh is not installed as a folder.
    """
    figures = document(scene, charts)
    places = {figure["id"]: f"place-of-{figure['id']}" for figure in figures["roots"]}
    items = [{"docid": "figures", "roots": places, "root_ids": list(places)}]
    texts = (json.dumps(data, separators=(",", ":")) for data in ({"figures": figures}, items))
    script = SCRIPT % tuple(text.replace("<", "\\u003c") for text in texts)
    divisions = [PLACE.format(place=place, figure=i) for i, place in places.items()]
    of_maps = len(divisions) - len(charts)
    of_charts = dict(zip(charts, divisions[of_maps:], strict=True))
    return Interactive(_library(), script, tuple(divisions[:of_maps]), of_charts)


def document(scene: MapScene | None, charts: Sequence[Chart] = ()) -> dict[str, Any]:
    """All figures of a page as a document of bokeh, without its version."""
    model = _Models()
    indices = range(len(scene.machines) if scene else 0)
    maps = [_map(model, scene, index) for index in indices if scene]
    return {"title": "figures", "roots": [*maps, *(_chart(model, one) for one in charts)]}


class _Models:
    """Models of bokeh, each with a number."""

    def __init__(self) -> None:
        self._numbers = count()

    def __call__(self, kind: str, **attributes: Any) -> Model:
        number = f"p{next(self._numbers)}"
        return {"type": "object", "name": kind, "id": number, "attributes": attributes}


def _library() -> str:
    """The script of bokeh that pages need, deflated, as base64: a third of its size."""
    package = find_spec("bokeh")
    home = Path(package.origin).parent if package and package.origin else Path()
    try:
        text = (home / LIBRARY).read_bytes()
    except OSError as error:
        fault = f"its {LIBRARY} cannot be read ({error.strerror})"
        raise ArmDesignError("bokeh", fault, "install bokeh again") from None
    return base64.b64encode(zlib.compress(text, LEVEL)).decode("ascii")


def _map(model: _Models, scene: MapScene, index: int) -> Model:
    """The map of one machine of a scene."""
    x, y = scene.planes[0].x, scene.planes[0].y
    cells, marks = _cells(model, index, bars=y is not None), _marks(model, index)
    labels = _label(x), _label(y) if y else scene.quantity
    hover = model("HoverTool", renderers=[_same(cells)], tooltips=TOOLTIPS[scene.quantity])
    return _figure(
        model,
        labels,
        [model("TapTool"), hover],
        name=f"map-{index}",
        x_range=model("Range1d", **_ends(x)),
        y_range=model("Range1d", **(_ends(y) if y else {"start": 0, "end": 1})),
        title=model("Title", text=f"{scene.machines[index].label}\n "),  # room for two lines
        renderers=[cells, marks],
    )


def _chart(model: _Models, chart: Chart) -> Model:
    """Points and curves with their words and a legend."""
    renderers = [_curve(model, curve) for curve in chart.curves]
    hovered = [r for r, curve in zip(renderers, chart.curves, strict=True) if curve.words]
    words = [(head, f"@words_{k}") for k, head in enumerate(chart.heads)]
    hover = model("HoverTool", renderers=[_same(one) for one in hovered], tooltips=words)
    entries: dict[str, list[Model]] = {}
    for curve, renderer in zip(chart.curves, renderers, strict=True):
        entries.setdefault(curve.name, []).append(_same(renderer))
    items = [model("LegendItem", label=_value(name), renderers=of) for name, of in entries.items()]
    legend = model(
        "Legend",
        items=items,
        location="left",
        click_policy="hide",
        background_fill_color=None,
        border_line_color=None,
    )
    return _figure(
        model,
        (chart.x, chart.y),
        [hover],
        legend,
        x_range=model("DataRange1d"),
        y_range=model("DataRange1d"),
        title=model("Title"),
        renderers=renderers,
    )


def _curve(model: _Models, curve: Curve) -> Model:
    columns = {"x": curve.x, "y": curve.y}
    columns |= {f"words_{k}": texts for k, texts in enumerate(zip(*curve.words, strict=True))}
    entries = [[name, list(values)] for name, values in columns.items()]
    source = model("ColumnDataSource", data={"type": "map", "entries": entries})
    colour, places = curve.colour, {"x": _field("x"), "y": _field("y")}
    if curve.kind == "line":
        glyph = model("Line", **places, line_color=colour, line_width=1.5)
    else:
        rings = curve.kind == "rings"
        filled = None if rings else colour
        style = {"size": 13 if rings else 8, "line_color": colour, "fill_color": filled}
        glyph = model("Scatter", **places, **{key: _value(one) for key, one in style.items()})
    return model("GlyphRenderer", data_source=source, glyph=glyph)


def _figure(
    model: _Models,
    labels: tuple[str, str],
    tools: list[Model],
    legend: Model | None = None,
    **attributes: Any,
) -> Model:
    """A figure with axes, tools and perhaps a legend; a chart's grid shows, a map's does not."""
    below, left = (model("LinearAxis", axis_label=label) for label in labels)
    shown = {"visible": legend is not None}
    grids = [
        model("Grid", dimension=k, axis=_same(of), **shown) for k, of in enumerate((below, left))
    ]
    tools = [*(model(f"{kind}Tool") for kind in ("Reset", "Pan", "BoxZoom")), *tools]
    return model(
        "Figure",
        **attributes,  # first: what others refer to
        height=360 if legend is None else 460,
        sizing_mode="stretch_width",
        toolbar=model("Toolbar", tools=tools, logo=None),
        toolbar_location="below",
        left=[left],
        below=[below, *([legend] if legend else [])],
        center=grids,
        background_fill_color=None,
        border_fill_color=None,
        min_border_left=66,
    )


def _same(model: Model) -> Model:
    """A reference to a model that stands elsewhere."""
    return {"id": model["id"]}


def _cells(model: _Models, index: int, *, bars: bool) -> Model:
    """Cells of a map, coloured by their values; a point for each where there is one joint."""
    scale = np.round(255 * colours_between(np.arange(256), 0, 255)).astype(int)
    palette = [f"#{red:02X}{green:02X}{blue:02X}" for red, green, blue in scale]
    picked = model("CustomJS", code=f"window.armdesignPick({index}, cb_obj.indices)")
    callbacks = {"type": "map", "entries": [["change:indices", [picked]]]}
    selected = model("Selection", js_property_callbacks=callbacks)
    source = _source(model, f"cells-{index}", COLUMNS, selected=selected)
    mapper = model("LinearColorMapper", palette=palette, low=0, high=1, name=f"colours-{index}")
    colour = {"type": "field", "field": "value", "transform": mapper}
    again = {**colour, "transform": {"id": mapper["id"]}}
    places = {name: _field(name) for name in (COLUMNS[:4] if bars else ("x",))}
    if not bars:
        places |= {"y": _field("value"), "size": _value(9)}
    kind = "Rect" if bars else "Scatter"
    return model(
        "GlyphRenderer",
        data_source=source,
        glyph=model(kind, **places, line_color=colour, fill_color=again),
        nonselection_glyph=model(kind, **places, line_color=again, fill_color=again),
    )


def _marks(model: _Models, index: int) -> Model:
    """The ring about the picked cell."""
    ring = {"line_color": _value(MARK), "line_width": _value(2.5), "fill_color": _value(None)}
    places = {"x": _field("x"), "y": _field("y"), "size": _value(15)}
    source = _source(model, f"marks-{index}", ("x", "y"))
    return model("GlyphRenderer", data_source=source, glyph=model("Scatter", **places, **ring))


def _source(model: _Models, name: str, columns: tuple[str, ...], **more: Model) -> Model:
    data = {"type": "map", "entries": [[column, []] for column in columns]}
    return model("ColumnDataSource", name=name, data=data, **more)


def _field(name: str) -> Model:
    return {"type": "field", "field": name}


def _value(value: object) -> Model:
    return {"type": "value", "value": value}


def _label(axis: CellAxis) -> str:
    return f"{axis.name} [{axis.unit}]"


def _ends(axis: CellAxis) -> dict[str, float]:
    """The range of all cells along an axis."""
    return {"start": axis.edges[0], "end": axis.edges[-1]}
