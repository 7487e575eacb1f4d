"""Reports as a reader sees them, in the system's Chromium without a display: screen, phone, paper.

A machine without Chromium skips these tests; continuous integration has it, and fails without.
"""

from __future__ import annotations

import io
import json
import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import pytest

import armdesign as ad
from armdesign.frequency.maps import FrequencyMap
from armdesign.machine.poses import pose_text
from armdesign.report.contents import Picture, Report, ReportSection
from armdesign.report.lift_charts import lift_charts, lift_sheet
from armdesign.report.map_reports import map_report
from armdesign.report.maps import map_sheets
from armdesign.report.page import page
from armdesign.report.provenance import Origin
from armdesign.report.scene import scene_of
from armdesign.report.sheet import Sheet
from armdesign.units import SI, WORKSHOP, Units
from tests.chromium import cell_at, launched, opened, shown

pytestmark = pytest.mark.slow

LONG = Sheet(
    title="Pins",
    columns=("cylinder", *(f"coordinate {k} [mm]" for k in range(9)), "remark"),
    rows=tuple(
        (name, *(f"{1000.5 + 7 * k + n:.1f}, -{602.5 + k:.1f}" for k in range(9)), "last" + name)
        for n, name in enumerate(("boom", "stick", "bucket"))
    ),
)


def maps() -> dict[str, FrequencyMap]:
    """Of the 20 t machine and one with moved pins, on a coarse grid."""
    today = ad.load("excavator_20t")
    space = ad.Workspace.grid(today, [6, 5, 6])
    pin, sizes = "cylinder.boom.rod_end.at_mm", {"stroke_mm": 1320, "closed_length_mm": 1795}
    changes = {f"cylinder.boom.{key}": value for key, value in sizes.items()}
    new = today.replace({pin: [2233.7, 0, 900.5], **changes})
    return {"today": ad.frequency_map(today, space), "new": ad.frequency_map(new, space)}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with everything that pages can have."""
    both = maps()
    origin = Origin.begin("armdesign map excavator_20t", {"points": "6,5,6"})
    today = both["today"]
    one = map_report(today, map_sheets(today), (), origin.sheet({"": today.machine}))
    machines = {label: single.machine for label, single in both.items()}
    folder = tmp_path_factory.mktemp("report")
    picture = Picture(caption="static map", file="map_joints.png")
    both["today"].plot().figure.savefig(folder / picture.file)
    sections = (
        ReportSection(title="Numbers", sheets=one.sections[1].sheets),
        ReportSection(title="The machine", shows="drawing"),
        ReportSection(title="Maps", shows="maps", pictures=(picture,)),
        ReportSection(title="Tables", sheets=(LONG, lift_sheet(lift_charts(machines)))),
        one.sections[-1],
    )
    report = Report(
        title=one.title,
        lead=one.lead,
        headline=one.headline,
        sections=sections,
        scene=scene_of(both),
    )
    path = folder / "report.html"
    path.write_text(page(report, folder), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from launched()


def test_hover_and_click_show_what_the_map_says(browser: Any, written: Path) -> None:
    tab, wrong = opened(browser, written)
    before, words = tab.inner_html("#drawing"), tab.inner_text("#pose")
    assert words.startswith("new: boom")
    x, y = cell_at(tab, 0, 3)
    tab.mouse.move(x, y)
    tab.wait_for_function("!!document.querySelector('.map:nth-of-type(1)')")
    tab.wait_for_timeout(400)
    find = "Bokeh.documents.map((d) => d.get_model_by_name('cells-0')).find((x) => x).data"
    data = {k: tab.evaluate(f"{find}.{k}[3]") for k in ("words", "pose", "load", "part")}
    words = shown(tab)
    for text in data.values():
        assert text in words
    tab.mouse.click(x, y)
    tab.wait_for_function("document.getElementById('pose').textContent.startsWith('today')")
    said = tab.inner_text("#pose")
    assert data["pose"] in said
    assert f"load case {data['load']}" in said
    assert f"limited by {data['part']}" in said
    assert data["words"].split(" Hz")[0] in said
    assert tab.inner_html("#drawing") != before
    assert not wrong


@pytest.mark.parametrize("units", [WORKSHOP, SI], ids=["workshop", "si"])
def test_drawing_and_maps_have_the_units_of_the_tables(
    units: Units, browser: Any, tmp_path: Path
) -> None:
    """An angle and a slide: of the pose, the axes, what hovers, and the tool's way."""
    machine = ad.load("loader_crane")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, [2, 2, 3]))
    shows: tuple[Literal["drawing", "maps"], ...] = ("drawing", "maps")
    sections = tuple(ReportSection(title=one, shows=one) for one in shows)
    scene = scene_of({machine.name: frequencies}, units)
    path = tmp_path / "report.html"
    report = Report(title="", lead="", sections=sections, scene=scene)
    path.write_text(page(report, tmp_path), encoding="utf-8")
    tab, wrong = opened(browser, path)
    said, (angle, length) = tab.inner_text("#pose"), (units.name(one) for one in ("rad", "m"))
    assert pose_text(machine, frequencies.worst.q, units) in said
    assert re.search(rf" [0-9.]+ {length} at the tool", said)
    tab.select_option("#plane", "1")  # lift_boom, extension
    find = "Bokeh.documents.map((d) => d.get_model_by_name('map-0')).find((x) => x)"
    labels = [tab.evaluate(f"{find}.{side}[0].axis_label") for side in ("below", "left")]
    shown_angle = "deg" if angle == "°" else angle
    assert labels == [f"lift_boom [{shown_angle}]", f"extension [{length}]"]
    extension = machine.ranges[2] / units.table["m"][0]
    ends = [tab.evaluate(f"{find}.y_range.{end}") for end in ("start", "end")]
    assert extension[0] <= ends[0] < ends[1] <= extension[1]
    pins = tab.evaluate(
        "[...document.querySelectorAll('#drawing .pin')].map((p) => p.textContent)"
    )
    assert all(pin.endswith(f" {length}") for pin in pins if ": x " in pin)
    assert not wrong


def test_switches_change_the_maps(browser: Any, written: Path) -> None:
    tab, wrong = opened(browser, written)
    find = "Bokeh.documents.map((d) => d.get_model_by_name('cells-1')).find((x) => x).data"
    values = {"all": tab.evaluate(f"{find}.value")}
    loads = set(tab.evaluate(f"{find}.load"))
    tab.select_option("#case", "1")
    values["empty"] = tab.evaluate(f"{find}.value")
    assert set(tab.evaluate(f"{find}.load")) == {"empty"} < loads
    tab.select_option("#case", "0")
    tab.select_option("#statistic", "2")
    values["median"] = tab.evaluate(f"{find}.value")
    assert all(a >= b for a, b in zip(values["median"], values["all"], strict=True))
    tab.select_option("#statistic", "0")
    tab.select_option("#plane", "2")
    assert len(tab.evaluate(f"{find}.value")) == 5 * 6  # stick and bucket
    both = [json.dumps(one) for one in values.values()]
    assert len(set(both)) == 3
    tab.click("#swing")
    first = tab.inner_html("#drawing")
    tab.wait_for_timeout(200)
    assert tab.inner_html("#drawing") != first
    tab.click("#swing")
    of_modes = {}
    for mode, words in enumerate(("the lowest mode", "the second mode", "the third mode")):
        tab.select_option("#mode", str(mode))
        assert f"dashed red: {words}" in tab.inner_text("#pose")
        frequency = float(tab.inner_text("#pose").partition(" Hz")[0].split()[-1])
        of_modes[frequency] = tab.inner_html("#drawing")
    assert list(of_modes) == sorted(of_modes)
    assert len(set(of_modes.values())) == 3
    assert "boom.rod_end 50 mm" in tab.text_content("#drawing")
    assert not wrong


def test_swung_bodies_and_bars_keep_their_size(browser: Any, written: Path) -> None:
    """Sides of all outlines and lengths of the four-bar's bars, at rest and in every mode."""
    tab, wrong = opened(browser, written)
    read = """(kind) => {
      const sides = (path) => path.getAttribute('d').split('Z').filter(Boolean).flatMap((ring) => {
        const at = ring.slice(1).split('L').map((one) => one.split(',').map(Number));
        return at.slice(1).map(([x, y], k) => Math.hypot(x - at[k][0], y - at[k][1]));
      });
      const bars = [...document.querySelectorAll(`#drawing line[data-bar].${kind}`)];
      const ends = (one) => ['x1', 'y1', 'x2', 'y2'].map((key) => Number(one.getAttribute(key)));
      const long = bars.map(ends).map(([x, y, u, v]) => Math.hypot(u - x, v - y));
      const name = kind === 'bar' ? 'body' : kind;
      const bodies = [...document.querySelectorAll(`#drawing path.${name}`)];
      return [bodies.map(sides), long];
    }"""
    for mode in range(3):
        tab.select_option("#mode", str(mode))
        bodies, bars = tab.evaluate(read, "bar")
        swung, swung_bars = tab.evaluate(read, "swung")
        assert len(bars) == len(swung_bars) == 2
        assert swung_bars == pytest.approx(bars, abs=2e-3)
        moving = bodies[1:]
        for rest, gone in zip(moving, swung[: len(moving)], strict=True):
            assert gone == pytest.approx(rest, abs=2e-3)
    assert not wrong


def test_tables_are_sorted_by_numbers(browser: Any, written: Path) -> None:
    tab, wrong = opened(browser, written)
    column = "[...document.querySelectorAll('table.sortable')].at(-1)"
    column += ".querySelectorAll('tbody td:nth-child(3)')"
    head = tab.locator("table.sortable").last.locator("th").nth(2)
    numbers = [float(t) for t in tab.evaluate(f"[...{column}].map((c) => c.textContent)") if t]
    head.click()
    rising = [float(t) for t in tab.evaluate(f"[...{column}].map((c) => c.textContent)") if t]
    head.click()
    falling = [float(t) for t in tab.evaluate(f"[...{column}].map((c) => c.textContent)") if t]
    assert rising == sorted(numbers) != numbers
    assert falling == rising[::-1]
    assert not wrong


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_light_and_dark(scheme: str, browser: Any, written: Path) -> None:
    tab, wrong = opened(browser, written, scheme=scheme)

    def look() -> tuple[bool, bool]:
        """Whether the page's ground is dark, and the titles of the maps are bright."""
        title = "Bokeh.documents.map((d) => d.get_model_by_name('map-0')).find((x) => x).title"
        ground = tab.evaluate("getComputedStyle(document.body).backgroundColor")
        ink = tab.evaluate(f"{title}.text_color")
        grey = [int(part) for part in re.findall(r"\d+", ground)[:3]]
        return sum(grey) < 200, int(ink[1:3], 16) > 128

    assert look() == (scheme == "dark",) * 2
    tab.click("#theme")
    assert look() == (scheme == "light",) * 2
    assert not wrong


@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_wider_than_the_screen(width: int, browser: Any, written: Path) -> None:
    tab, wrong = opened(browser, written, width)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    tables = tab.evaluate(
        """[...document.querySelectorAll('.scroll')].map((one) =>
          [one.scrollWidth > one.clientWidth + 1, one.classList.contains('wide')])"""
    )
    assert all(scrolls == scrollable for scrolls, scrollable in tables)
    assert any(scrolls for scrolls, _ in tables) or width > 390
    maps_width = tab.evaluate("document.querySelector('.map').getBoundingClientRect().width")
    assert maps_width > 0.8 * min(width, 500)
    assert not wrong


@pytest.fixture(scope="module")
def tall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map's page of a machine that stands upright in its worst pose."""
    machine = ad.load("patu_boom")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 4))
    provenance = Origin.begin("armdesign map patu_boom", {}).sheet({"": machine})
    report = map_report(frequencies, map_sheets(frequencies), (), provenance)
    path = tmp_path_factory.mktemp("tall") / "report.html"
    path.write_text(page(report, path.parent), encoding="utf-8")
    return path


DRAWN = """() => {
  const parts = [...document.querySelectorAll('#drawing .body, #drawing .pin')];
  const boxes = parts.map((one) => one.getBoundingClientRect());
  const of = (side) => boxes.map((box) => box[side]);
  const ends = (low, high) => Math.max(...of(high)) - Math.min(...of(low));
  return [ends('left', 'right'), ends('top', 'bottom')];
}"""


@pytest.mark.parametrize("width", [390, 1280])
def test_a_tall_machine_fills_its_place(width: int, browser: Any, tall: Path) -> None:
    """It is as high as the screen allows, or as wide; the place stays as other poses are shown."""
    tab, wrong = opened(browser, tall, width)
    across, up = tab.evaluate(DRAWN)
    assert up > 0.6 * 900 or across > 0.8 * width
    before = tab.evaluate("document.querySelector('#drawing').getBoundingClientRect().height")
    x, y = cell_at(tab, 0, 0)
    tab.mouse.click(x, y)
    tab.wait_for_timeout(200)
    after = tab.evaluate("document.querySelector('#drawing').getBoundingClientRect().height")
    assert before == after <= 0.75 * 900
    assert not wrong


@pytest.mark.parametrize("paper", ["A4", "Letter"])
def test_a_tall_machine_stands_on_the_first_sheet(paper: str, browser: Any, tall: Path) -> None:
    """With its head, a hand's breadth high or more."""
    from pypdf import PdfReader

    tab, _ = opened(browser, tall)
    words = compact(tab.inner_text("#pose"))
    assert words in compact(PdfReader(io.BytesIO(tab.pdf(format=paper))).pages[0].extract_text())
    tab.set_viewport_size({"width": 696, "height": 900})
    tab.emulate_media(media="print")
    assert tab.evaluate(DRAWN)[1] > 100 / 25.4 * 96


def compact(text: str) -> str:
    """Text without spaces, and with letters in place of ligatures."""
    return "".join(unicodedata.normalize("NFKC", text).split())


def test_a_heading_is_not_left_with_one_row(browser: Any, written: Path) -> None:
    """However much of a sheet is filled above "Provenance", three rows stand with it or none."""
    from pypdf import PdfReader

    tab, _ = opened(browser, written)
    tab.evaluate(
        """[...document.querySelectorAll('h2')].find((h) => h.innerText === 'Provenance').before(
          Object.assign(document.createElement('div'), {id: 'above', style: 'break-before: page'})
        )"""
    )
    moved = set()
    for height in range(216, 249, 6):  # mm, of 267
        tab.evaluate(f"document.querySelector('#above').style.height = '{height}mm'")
        pages = [one.extract_text() for one in PdfReader(io.BytesIO(tab.pdf(format="A4"))).pages]
        at = next(i for i, text in enumerate(pages) if "\nProvenance\n" in f"\n{text}\n")
        assert "begun" in pages[at].partition("Provenance")[2]
        moved.add(at)
    assert len(moved) == 2


@pytest.mark.parametrize(("paper", "width"), [("A4", 210), ("Letter", 215.9)])
def test_print_cuts_nothing(paper: str, width: float, browser: Any, written: Path) -> None:
    """Every cell of every table is in the PDF's text, and no element leaves the sheet."""
    from pypdf import PdfReader

    tab, wrong = opened(browser, written)
    cells = tab.evaluate(
        "[...document.querySelectorAll('td, th, .sheet-note')].map((c) => c.innerText)"
    )
    data = tab.pdf(format=paper)
    tab.set_viewport_size({"width": int((width - 26) / 25.4 * 96), "height": 900})
    tab.emulate_media(media="print")
    beyond = tab.evaluate(
        """[...document.querySelectorAll('body *')].filter((one) => {
          const box = one.getBoundingClientRect();
          return box.width && box.right > innerWidth + 1 && !one.closest('svg');
        }).map((one) => one.outerHTML.slice(0, 80))"""
    )
    assert not beyond
    hidden = tab.evaluate("document.querySelector('.maps').getBoundingClientRect().height")
    shown = tab.evaluate("document.querySelector('.paper img').getBoundingClientRect().height")
    assert hidden == 0 < shown
    pages = PdfReader(io.BytesIO(data)).pages
    assert float(pages[0].mediabox.width) == pytest.approx(width / 25.4 * 72, abs=2)
    text = "".join(compact(one.extract_text()) for one in pages)
    for cell in set(map(compact, cells)):
        assert cell in text, cell
    assert not wrong


def test_a_browser_that_cannot_unpack_shows_the_pictures_of_paper(
    browser: Any, written: Path
) -> None:
    tab, wrong = browser.new_page(), list[str]()
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.add_init_script("delete window.DecompressionStream")
    tab.goto(written.as_uri())
    tab.wait_for_timeout(300)
    assert tab.is_visible(".paper img")
    assert not tab.is_visible(".maps")
    assert not tab.is_visible("#drawing")
    tab.click("table.sortable th")
    assert tab.query_selector("table.sortable th[aria-sort]")
    assert not wrong
