"""The system's Chromium without a display. A machine without it skips; in CI that is a failure."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SOFTWARE = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def launched(*options: str) -> Iterator[Any]:
    """A browser, closed after use; ``SOFTWARE`` are its options to draw in space."""
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    if program is None:
        words = "no Chromium: apt-get install chromium"
        if os.environ.get("CI"):
            pytest.fail(words)
        pytest.skip(words)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", *options]
        browser = playwright.chromium.launch(executable_path=program, args=arguments)
        yield browser
        browser.close()


def opened(browser: Any, path: Path, width: int = 1280, scheme: str = "light") -> tuple[Any, Any]:
    """A tab with the page, and what it said and asked for that it should not."""
    tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    wrong: list[str] = []
    tab.on("console", lambda m: wrong.append(m.text) if m.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    known = path.as_uri()
    allowed = (known, "data:", "blob:")
    tab.on(
        "request", lambda r: None if r.url.startswith(allowed) else wrong.append(f"asks {r.url}")
    )
    tab.goto(known)
    tab.wait_for_function("document.documentElement.dataset.ready === 'figures'")
    tab.wait_for_timeout(300)
    return tab, wrong


def cell_at(tab: Any, map_index: int, cell: int) -> tuple[float, float]:
    """Place on the screen of the middle of a cell of a map."""
    tab.evaluate("document.querySelector('.maps').scrollIntoView()")
    at = tab.evaluate(
        """([m, c]) => {
          const named = (name, one) => one.get_model_by_name(name);
          const find = (name) => Bokeh.documents.map((one) => named(name, one)).find((x) => x);
          const data = find(`cells-${m}`).data, map = find(`map-${m}`);
          const view = [...Bokeh.index].find((one) => one.model === map);
          const frame = view.frame.bbox, box = view.canvas_view.el.getBoundingClientRect();
          const part = (value, range) => (value - range.start) / (range.end - range.start);
          return [box.left + frame.left + part(data.x[c], map.x_range) * frame.width,
                  box.top + frame.bottom - part(data.y[c], map.y_range) * frame.height];
        }""",
        [map_index, cell],
    )
    return at[0], at[1]


def shown(tab: Any) -> str:
    """All text that figures show, with what hovers over them."""
    return str(
        tab.evaluate(
            """() => { const texts = [];
              const walk = (node) => { for (const one of node.querySelectorAll('*')) {
                const inside = one.shadowRoot;
                if (inside) { texts.push(inside.textContent); walk(inside); } } };
              walk(document); return texts.join('\\n'); }"""
        )
    )
