"""Interactive maps of the page: empty figures that its script fills. The only door to bokeh.

Bokeh is a library whose output needs nothing but itself; the page carries its smallest bundle. The
figures are the documents that this bundle reads, as data: bokeh's Python writes the same, and
loading it would take as long as the map itself.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.plots.canvas import MARK, colours_between
from armdesign.report.scene import CellAxis, MapScene

TOOLTIPS = [
    ("frequency", "@words"),
    ("pose", "@pose"),
    ("load case", "@load"),
    ("limited by", "@part"),
    ("all poses of the cell", "@spread"),
]
COLUMNS = ("x", "y", "width", "height", "value", "words", "pose", "load", "part", "spread")
LIBRARY = "server/static/js/bokeh.min.js"
SCRIPT = """{
  const documents = %s;
  documents.maps.version = Bokeh.version;
  Bokeh.embed.embed_items(documents, %s);
}"""
PLACE = '<div id="{place}" data-root-id="{figure}" style="display: contents"></div>'

Model = dict[str, Any]


class Interactive(NamedTuple):
    """Parts of a page: scripts of the library and of the figures, and a place for each figure."""

    library: str
    script: str
    places: tuple[str, ...]


def interactive(scene: MapScene) -> Interactive:
    """A figure for each machine of a scene, ``map-0`` …, with its sources, filled by a script.

    Raises:
        ArmDesignError: bokeh is not installed as a folder.
    """
    figures = document(scene)
    places = {figure["id"]: f"place-of-{figure['id']}" for figure in figures["roots"]}
    items = [{"docid": "maps", "roots": places, "root_ids": list(places)}]
    texts = (json.dumps(data, separators=(",", ":")) for data in ({"maps": figures}, items))
    script = SCRIPT % tuple(text.replace("<", "\\u003c") for text in texts)
    style = 'style="display: contents"'
    divisions = [
        f'<div id="{place}" data-root-id="{i}" {style}></div>' for i, place in places.items()
    ]
    return Interactive(_library(), script, tuple(divisions))


def document(scene: MapScene) -> dict[str, Any]:
    """All figures of a scene as a document of bokeh, without its version."""
    numbers = count()
    figures = [_figure(scene, index, numbers) for index in range(len(scene.machines))]
    return {"title": "maps", "roots": figures}


def _library() -> str:
    """The script of bokeh that pages need."""
    package = find_spec("bokeh")
    home = Path(package.origin).parent if package and package.origin else Path()
    try:
        return (home / LIBRARY).read_text(encoding="utf-8")
    except OSError as error:
        fault = f"its {LIBRARY} cannot be read ({error.strerror})"
        raise ArmDesignError("bokeh", fault, "install bokeh again") from None


def _figure(scene: MapScene, index: int, numbers: Iterator[int]) -> Model:
    def model(kind: str, **attributes: Any) -> Model:
        return {
            "type": "object",
            "name": kind,
            "id": f"p{next(numbers)}",
            "attributes": attributes,
        }

    def axis(label: str) -> Model:
        return model("LinearAxis", axis_label=label)

    def grid(dimension: int, of: Model) -> Model:
        return model("Grid", visible=False, dimension=dimension, axis={"id": of["id"]})

    x, y = scene.planes[0].x, scene.planes[0].y
    cells, marks = _cells(model, index, bars=y is not None), _marks(model, index)
    hover = model("HoverTool", renderers=[{"id": cells["id"]}], tooltips=TOOLTIPS)
    tools = [model(f"{kind}Tool") for kind in ("Tap", "Reset", "Pan", "BoxZoom")]
    below, left = axis(_label(x)), axis(_label(y) if y else "frequency [Hz]")
    return model(
        "Figure",
        name=f"map-{index}",
        height=360,
        sizing_mode="stretch_width",
        x_range=model("Range1d", **_ends(x)),
        y_range=model("Range1d", **(_ends(y) if y else {"start": 0, "end": 1})),
        title=model("Title", text=scene.machines[index].label),
        renderers=[cells, marks],
        toolbar=model("Toolbar", tools=[*tools, hover], logo=None),
        toolbar_location="below",
        left=[left],
        below=[below],
        center=[grid(0, below), grid(1, left)],
        background_fill_color=None,
        border_fill_color=None,
        min_border_left=66,
    )


def _cells(model: Any, index: int, *, bars: bool) -> Model:
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


def _marks(model: Any, index: int) -> Model:
    """The ring about the picked cell."""
    ring = {"line_color": _value(MARK), "line_width": _value(2.5), "fill_color": _value(None)}
    places = {"x": _field("x"), "y": _field("y"), "size": _value(15)}
    source = _source(model, f"marks-{index}", ("x", "y"))
    return model("GlyphRenderer", data_source=source, glyph=model("Scatter", **places, **ring))


def _source(model: Any, name: str, columns: tuple[str, ...], **more: Model) -> Model:
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
    half = axis.width / 2
    return {"start": min(axis.middles) - half, "end": max(axis.middles) + half}
