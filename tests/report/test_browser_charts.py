"""Charts and maps of bandwidth as a reader sees them: validation, control, on phone and paper."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.drawing.colours import actuator_colours
from armdesign.plots import chart_figure
from armdesign.plots.charts import Chart
from armdesign.report.bandwidths import bandwidth_report, bandwidth_sheets
from armdesign.report.contents import Picture, ReportSection
from armdesign.report.map_reports import plain_report
from armdesign.report.page import page
from armdesign.report.sheet import Sheet
from armdesign.report.validations import validation_chart
from tests.chromium import cell_at, launched, opened, shown

pytestmark = pytest.mark.slow

NOTHING = Sheet(title="Provenance", rows=(("command", "a test"),))
POINT = """() => {
  const map = Bokeh.documents[0].roots()[0], data = map.renderers[0].data_source.data;
  const view = [...Bokeh.index].find((one) => one.model === map);
  const frame = view.frame.bbox, box = view.canvas_view.el.getBoundingClientRect();
  const part = (value, range) => (value - range.start) / (range.end - range.start);
  return [box.left + frame.left + part(data.x[0], map.x_range) * frame.width,
          box.top + frame.bottom - part(data.y[0], map.y_range) * frame.height];
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from launched()


@pytest.fixture(scope="module")
def chart() -> Chart:
    machine = ad.load("paper_1dof")
    return validation_chart(ad.validate(machine, [0.0]), actuator_colours(machine))


@pytest.fixture(scope="module")
def validated(chart: Chart, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("validated")
    chart_figure(chart).savefig(folder / "chart.png")
    picture = Picture(caption=chart.title, file="chart.png")
    section = ReportSection(title="At a glance", charts=(chart,), pictures=(picture,))
    path = folder / "report.html"
    path.write_text(page(plain_report("Sweeps", "They agree.", [section]), folder), "utf-8")
    return path


@pytest.fixture(scope="module")
def controlled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, machine = tmp_path_factory.mktemp("controlled"), ad.load("excavator_20t")
    maps = {"": ad.bandwidth_map(machine, ad.Workspace.grid(machine, [4, 3, 2]))}
    maps[""].plot().figure.savefig(folder / "bandwidth.png")
    pictures = [Picture(caption="bandwidth", file="bandwidth.png")]
    report = bandwidth_report(maps, bandwidth_sheets(maps), pictures, NOTHING)
    path = folder / "report.html"
    path.write_text(page(report, folder), "utf-8")
    return path


@pytest.mark.parametrize("width", [390, 1280])
def test_a_point_says_its_sweep(width: int, browser: Any, chart: Chart, validated: Path) -> None:
    tab, wrong = opened(browser, validated, width)
    x, y = tab.evaluate(POINT)
    assert chart.curves[0].words[0][0] not in shown(tab)
    tab.mouse.move(x - 2, y)
    tab.mouse.move(x, y)
    tab.wait_for_timeout(400)
    words = shown(tab)
    for text in (*chart.heads, *chart.curves[0].words[0]):
        assert text in words
    box = tab.locator(".bk-Tooltip").first.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= width
    tab.emulate_media(media="print")
    assert not tab.locator(".bk-Tooltip").first.is_visible()
    assert not wrong


def test_hover_and_click_show_the_bandwidth(browser: Any, controlled: Path) -> None:
    tab, wrong = opened(browser, controlled)
    before = tab.inner_html("#drawing")
    shown_first = tab.inner_text("#pose")
    assert "narrowest loop" in shown_first
    find = "Bokeh.documents[0].get_model_by_name('cells-0').data"
    poses = tab.evaluate(f"Array.from({find}.pose)")
    cell = next(k for k, pose in enumerate(poses) if pose not in shown_first)
    x, y = cell_at(tab, 0, cell)
    tab.mouse.move(x - 2, y)
    tab.mouse.move(x, y)
    tab.wait_for_timeout(400)
    columns = ("words", "pose", "load", "part", "frequency", "others", "spread")
    data = {name: tab.evaluate(f"{find}.{name}[{cell}]") for name in columns}
    words = shown(tab)
    for text in data.values():
        assert text in words
    tab.mouse.click(x, y)
    tab.wait_for_timeout(200)
    said = tab.inner_text("#pose")
    bandwidth = data["words"].split(" Hz")[0]
    assert f"{data['pose']}, load case {data['load']}: bandwidth {bandwidth} Hz" in said
    assert f"narrowest loop {data['part']}; natural frequency {data['frequency']}" in said
    assert tab.inner_html("#drawing") != before
    assert not wrong


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("which", ["validated", "controlled"])
def test_nothing_leaves_the_screen_and_paper_has_pictures(
    which: str, width: int, browser: Any, request: pytest.FixtureRequest
) -> None:
    path = request.getfixturevalue(which)
    assert path.stat().st_size < 2e6
    tab, wrong = opened(browser, path, width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    figure = tab.locator(".chart, .map").first
    assert figure.is_visible()
    assert not tab.locator(".paper img").first.is_visible()
    tab.emulate_media(media="print")
    assert not figure.is_visible()
    assert tab.locator(".paper img").first.is_visible()
    assert not wrong
