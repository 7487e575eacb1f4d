"""Figures of the page, written as data, are what bokeh itself reads."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

import armdesign as ad
from armdesign.drawing.side_view import side_view
from armdesign.plots.charts import Chart, Curve
from armdesign.report.interactive import COLUMNS, document, interactive
from armdesign.report.scene import MapScene, scene_of
from tests import machines


def scene(name: str, points: int) -> MapScene:
    machine = ad.load(name)
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points))
    return scene_of({"today </script>": frequencies, "new": frequencies})


@pytest.mark.parametrize(("name", "glyph"), [("paper_1dof", "Scatter"), ("excavator_20t", "Rect")])
def test_bokeh_reads_the_figures(name: str, glyph: str) -> None:
    """Its own reader refuses kinds, attributes and values that it does not know."""
    from bokeh.document import Document

    drawn = scene(name, 4)
    empty: Any = Document().to_json(deferred=False)
    read: Any = Document.from_json({**empty, **document(drawn)})
    read.validate()
    assert [figure.name for figure in read.roots] == ["map-0", "map-1"]
    assert read.roots[0].title.text == "today </script>\n "  # room for a second line
    for k, figure in enumerate(read.roots):
        cells, marks = figure.renderers
        assert cells.data_source is read.get_model_by_name(f"cells-{k}")
        assert marks.data_source is read.get_model_by_name(f"marks-{k}")
        assert set(cells.data_source.data) == set(COLUMNS)
        assert type(cells.glyph).__name__ == type(cells.nonselection_glyph).__name__ == glyph
        colours = read.get_model_by_name(f"colours-{k}")
        assert cells.glyph.fill_color["transform"] is colours
        assert cells.nonselection_glyph.line_color["transform"] is colours
        first, last = drawn.planes[0].x.middles[0], drawn.planes[0].x.middles[-1]
        assert (figure.x_range.start, figure.x_range.end) == (first, last)
        assert [line.axis for line in figure.center] == [*figure.below, *figure.left]


def test_the_colours_are_those_of_bokeh() -> None:
    """Within one step of 256: the two libraries round the same table differently."""
    from bokeh.palettes import Viridis256

    figure = document(scene("paper_1dof", 3))["roots"][0]["attributes"]
    palette = figure["renderers"][0]["attributes"]["glyph"]["attributes"]["line_color"]
    colours = palette["transform"]["attributes"]["palette"]
    for ours, theirs in zip(colours, Viridis256, strict=True):
        pairs = zip(bytes.fromhex(ours[1:]), bytes.fromhex(theirs[1:]), strict=True)
        assert max(abs(one - other) for one, other in pairs) <= 1


@pytest.mark.parametrize("name", ["rocking", "crossing", "branched"])
def test_the_tool_is_on_the_body_of_its_link(name: str) -> None:
    """Not on the last one: springs follow the joints, and so does another arm."""
    machine = machines.named(name)
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 2))
    (drawn,) = scene_of({"today": frequencies}).machines
    tool = next(point for point in drawn.points if point["name"] == "tool")
    assert machine.tool.link in side_view(machine, frequencies.worst.q).bodies[tool["body"]].links
    assert tool["at"] is not None


def test_a_name_cannot_end_the_script_and_pages_are_the_same_again() -> None:
    drawn = scene("paper_1dof", 3)
    parts = interactive(drawn)
    assert "</script" not in parts.script
    assert json.dumps("today </script>\n ").replace("<", "\\u003c") in parts.script
    assert parts == interactive(drawn)
    assert len(set(parts.places)) == 2


def test_bokeh_reads_charts() -> None:
    from bokeh.document import Document

    dots = Curve(name="<b>", colour="#0072B2", x=(1.0, 2.0), y=(3.0, 4.0), words=(("a",), ("b",)))
    rings = replace(dots, kind="rings")
    line = Curve(name="line", colour="#7b8794", x=(1.0, 2.0), y=(0.0, 0.0), kind="line")
    chart = Chart(title="T", x="x [m]", y="y [%]", heads=("which",), curves=(dots, rings, line))
    empty: Any = Document().to_json(deferred=False)
    read: Any = Document.from_json({**empty, **document(None, [chart])})
    read.validate()
    (figure,) = read.roots
    assert [type(one.glyph).__name__ for one in figure.renderers] == ["Scatter", "Scatter", "Line"]
    assert list(figure.renderers[0].data_source.data["words_0"]) == ["a", "b"]
    (legend,) = figure.legend
    assert [(item.label.value, len(item.renderers)) for item in legend.items] == [
        ("<b>", 2),
        ("line", 1),
    ]
    (hover,) = (tool for tool in figure.toolbar.tools if type(tool).__name__ == "HoverTool")
    assert hover.renderers == figure.renderers[:2]
    assert interactive(None, [chart]).charts[chart]
