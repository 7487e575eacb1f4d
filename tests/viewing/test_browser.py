"""The viewer and its film as a reader sees them, in the system's Chromium without a display."""

from __future__ import annotations

import base64
import html
import io
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.frequency.modes import natural_modes
from armdesign.viewing import player
from armdesign.viewing.live import Viewer
from armdesign.viewing.reading import rows
from armdesign.viewing.view import view_of
from tests.chromium import SOFTWARE, launched
from tests.machines import named

pytestmark = pytest.mark.slow

PATIENCE = 120  # [s] for a scene drawn without a graphics card


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    yield from launched(*SOFTWARE)


def opened(browser: Any, address: str) -> tuple[Any, list[str]]:
    """A tab with a page, and what it said and asked for that it should not."""
    tab = browser.new_page(viewport={"width": 800, "height": 480})
    tab.set_default_timeout(1000 * PATIENCE)
    wrong: list[str] = []
    tab.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    allowed = (address, address.replace("http", "ws"), "data:", "blob:")
    tab.on(
        "request", lambda r: None if r.url.startswith(allowed) else wrong.append(f"asks {r.url}")
    )
    tab.on(
        "websocket", lambda s: None if s.url.startswith(allowed) else wrong.append(f"asks {s.url}")
    )
    tab.goto(address)
    tab.wait_for_selector("canvas")
    return tab, wrong


def picture(tab: Any, part: str = "canvas") -> np.ndarray:
    """Pixels of a part of the page (height, width, 3)."""
    from PIL import Image

    data = tab.locator(part).first.screenshot(timeout=1000 * PATIENCE)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)


def blue(pixels: np.ndarray) -> int:
    """Pixels in the colour of the first actuator's barrel (#0072B2), in light or shade."""
    red, green, blue = np.moveaxis(pixels, 2, 0)
    return int(((blue - red > 70) & (blue > green + 25)).sum())


def red(pixels: np.ndarray) -> int:
    """Pixels in the colour of what is new, seen through (#E5484D): no part of today's has it."""
    red, green, blue = np.moveaxis(pixels, 2, 0)
    return int(((red - green > 50) & (abs(green - blue) < 40)).sum())


def until(condition: Callable[[], bool]) -> bool:
    """Whether a condition comes true in time."""
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.5)
    return condition()


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    machine = named("paper_1dof")
    viewer = Viewer(view_of(machine, workspace=ad.Workspace.grid(machine, 3), damping=0.02))
    viewer.region.value = False
    yield viewer
    viewer.stop()


def test_geometry_is_in_the_scene_and_a_slider_changes_the_reading(
    browser: Any, viewer: Viewer
) -> None:
    tab, wrong = opened(browser, viewer.address)
    assert until(lambda: blue(picture(tab)) > 50)
    viewer.stage.shown["today"].top.visible = False
    assert until(lambda: blue(picture(tab)) == 0)
    viewer.stage.shown["today"].top.visible = True
    assert until(lambda: blue(picture(tab)) > 50)
    before, slider = tab.inner_text("#armdesign"), viewer.joints[0]
    end = pytest.approx(slider.value + 4.0)  # over less, no number of three digits need change
    thumb = tab.locator("[role=slider]").first
    thumb.focus()
    for _ in range(40):
        thumb.press("ArrowRight")
    assert until(lambda: slider.value == end)
    assert until(lambda: tab.inner_text("#armdesign") != before)
    lowest = natural_modes(viewer.view.machine.at(viewer.q)).frequencies[0, 0]

    def is_read() -> bool:
        text = tab.inner_text("#armdesign")
        words = [word for row in rows(viewer.readings["today"]) for word in row]
        return all(word in text for word in (f"{lowest:.3g} Hz", *words))

    assert until(is_read)
    assert not wrong
    tab.close()


@pytest.fixture
def compared() -> Iterator[Viewer]:
    """A machine, and one whose cylinder is thicker and has its base pin 60 mm further forward."""
    machine = named("paper_1dof")
    x, y, z = machine.section.cylinder["lift"].base.at_mm
    changes = {"cylinder.lift.base.at_mm": [x + 60, y, z], "cylinder.lift.bore_mm": 90}
    new = machine.replace(changes)
    viewer = Viewer(view_of(machine, new, workspace=ad.Workspace.grid(machine, 3), damping=0.02))
    viewer.region.value = False
    yield viewer
    viewer.stop()


def test_payload_worst_pose_and_the_new_machine(browser: Any, compared: Viewer) -> None:
    """By the keys and clicks of a reader; what he reads is what the machines answer."""
    tab, wrong = opened(browser, compared.address)
    view = compared.view
    assert view.new is not None
    machines = [view.machine, view.new]

    def row() -> list[str]:
        return tab.locator("#armdesign tr", has_text="lowest frequency").inner_text().split("\t")

    def agrees(mass: float) -> bool:
        poses = [one.with_payload(mass).at(compared.q) for one in machines]
        expected = [f"{natural_modes(one).frequencies[0, 0]:.3g} Hz" for one in poses]
        return bool(compared.mass.value == mass and row()[1:] == expected)

    payload = tab.locator("[role=slider]").last
    payload.focus()
    payload.press("Home")
    fault = "no frequency: mass matrix: is not positive definite"  # the lever has no mass
    assert until(lambda: fault in tab.inner_text("#armdesign"))
    for _ in range(3):
        payload.press("ArrowRight")
    assert until(lambda: agrees(3 * compared.mass.step))
    q, before = compared.q.copy(), picture(tab)
    tab.get_by_role("button", name="Worst pose").click()
    assert until(lambda: agrees(view.machine.payload.mass))
    np.testing.assert_array_equal(compared.q, view.worst.q)
    assert row()[1] == f"{view.worst.frequency:.3g} Hz"
    assert not np.allclose(compared.q, q)
    assert until(lambda: bool((picture(tab) != before).any()))
    assert until(lambda: red(picture(tab)) > 50)
    box = tab.get_by_label("New machine")
    box.click()
    assert until(lambda: red(picture(tab)) == 0)
    box.click()
    assert until(lambda: red(picture(tab)) > 50)
    assert not wrong
    tab.close()


def test_the_film_moves_and_needs_no_network(browser: Any, tmp_path: Path) -> None:
    machine = named("paper_1dof")
    view = view_of(machine, workspace=ad.Workspace.grid(machine, 3), damping=0.02)
    text, remark = player.player(view)
    assert not remark
    path = tmp_path / "view.html"
    path.write_text(text, encoding="utf-8")
    tab, wrong = opened(browser, path.as_uri())
    clock = tab.locator("input").first
    pictures = []
    for moment in (1.0, 3.0):
        clock.fill(str(moment))
        clock.press("Enter")
        assert until(lambda: blue(picture(tab)) > 50)
        pictures.append(picture(tab))
    above, below = (pictures[0][part] != pictures[1][part] for part in _halves(pictures[0]))
    assert above.any()  # words
    assert below.any()  # the machine
    assert html.escape(str(machine.section.title)) in tab.inner_html("#legend")
    tab.set_viewport_size({"width": 390, "height": 844})  # a phone: nothing is cut at its sides
    film = tab.locator("canvas").first
    assert until(lambda: film.bounding_box()["height"] < 1.4 * film.bounding_box()["width"])
    legend = tab.locator("#legend").bounding_box()
    assert film.bounding_box()["height"] < legend["y"] < 844 - legend["height"]
    assert not wrong
    tab.close()


def _halves(pixels: np.ndarray) -> tuple[slice, slice]:
    third = len(pixels) // 3
    return slice(0, third), slice(third, None)


def test_the_film_of_the_20_t_machine_says_what_the_machine_does() -> None:
    """Words and places of the film itself, decoded as its own page does; at most 1.5 MB."""
    machine = named("excavator_20t")
    view = view_of(machine, workspace=ad.Workspace.grid(machine, 4))
    text, remark = player.player(view)
    assert not remark
    assert len(text.encode()) <= 1_500_000
    said = [message["updates"]["text"] for message in recorded(text) if _is_label(message)]
    expected = natural_modes(machine.at(view.q)).frequencies[0]
    assert said[0].splitlines()[1].startswith(f"lowest frequency {expected[0]:.3g} Hz")
    assert len(set(said)) > 100
    for mode, frequency in enumerate(expected):
        assert any(f"mode {mode + 1}: {frequency:.3g} Hz" in words for words in said)
    rods = [m for m in recorded(text) if m.get("name", "").endswith("boom.rod/boom.rod")]
    assert rods


def test_large_meshes_become_plates(monkeypatch: pytest.MonkeyPatch) -> None:
    machine = named("paper_1dof")
    view = view_of(machine, workspace=ad.Workspace.grid(machine, 3))
    whole, _ = player.player(view)
    monkeypatch.setattr(player, "LARGEST", len(whole.encode()) - 1)
    simple, remark = player.player(view)
    assert "plates" in remark
    assert len(simple) < len(whole)


def recorded(page: str) -> list[dict[str, Any]]:
    """Messages of a film."""
    import msgspec
    import zstandard

    match = re.search(r'__VISER_EMBED_DATA__="([^"]+)"', page)
    assert match
    data = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(match[1])[8:])
    length = int.from_bytes(data[:8], "little")
    content = msgspec.msgpack.decode(data[8 : 8 + length])
    return [message for _, message in content["messages"]]


def _is_label(message: dict[str, Any]) -> bool:
    return message.get("name") == "/reading" and "text" in message.get("updates", {})
