"""The player: one HTML file without a network that shows a machine moving and what it reads.

A film of viser, with its own client in the file: every joint through its range and back, all
others standing, then every mode. Beside the machine stands what it oscillates with at that moment.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import printable
from armdesign.machine.poses import pose_text
from armdesign.units import WORKSHOP
from armdesign.viewing.page_words import escaped, scale_words
from armdesign.viewing.reading import (
    ALONE,
    DAMPED,
    FAULT,
    LIMITING,
    LOWEST,
    PHASES,
    Reading,
    reading,
    rows,
    swing_words,
)
from armdesign.viewing.stage import Stage

if TYPE_CHECKING:
    from armdesign.viewing.view import View

FRAME = 0.1  # [s] between two poses of a sweep
THERE_AND_BACK = 6.0  # [s] of each joint through its range
PERIODS = 3  # of each mode
LARGEST = 1_500_000  # bytes
FILMED = ((FAULT, LOWEST, LIMITING), (ALONE, DAMPED))  # rows of a reading, line by line
LINE = 72  # letters
CORNER = """
#legend { position: fixed; left: 12px; top: 8px; z-index: 9; font: 13px/1.5 sans-serif;
  color: #20262e; background: #ffffffcc; padding: 4px 8px; pointer-events: none }
@media (max-width: 60rem) { #legend { left: 0; top: auto; bottom: 52px } }
@media (max-aspect-ratio: 5/8) {
  #root { height: 140vw !important }
  #legend { top: 140vw; bottom: auto }
}
"""  # on a narrow screen what is read stands above, and this over the film's controls; on a tall
# one the film is lower: the camera sees the same height on all screens, and less of the width


def player(view: View) -> tuple[str, str]:
    """The text of the HTML file, and a remark where links had to be simplified; else none.

    A film with large meshes is made once more with links as plates of their outlines.
    """
    page = _filmed(view)
    if len(page.encode()) <= LARGEST:
        return page, ""
    megabytes = len(page.encode()) / 1e6
    remark = f"links are shown as plates: with their meshes the file would have {megabytes:.1f} MB"
    return _filmed(view, plates=True), remark


def _filmed(view: View, plates: bool = False) -> str:
    stage = Stage(view, plates=plates)
    try:
        film = _Film(stage, view)
        for j in range(len(view.machine.joints)):
            film.sweep(j)
        for mode in range(len(view.machine.arm.coordinates)):
            film.swing(mode)
        page = film.page()
    finally:
        stage.stop()
    end = page.rindex("</body>")
    return page[:end] + legend(view) + page[end:]


class _Film:
    """Poses of a view, one after the other."""

    def __init__(self, stage: Stage, view: View) -> None:
        self.stage, self.view = stage, view
        self.words: Any = stage.server.scene.add_label(
            "/reading", "", position=stage.above, anchor="bottom-center", font_screen_scale=0.9
        )
        self.stage.place(view.q)
        self._read(view.q)
        self.film = stage.server.get_scene_serializer()

    def sweep(self, joint: int) -> None:
        """Take one joint from the view's pose to both ends of its range and back."""
        low, high = self.view.machine.known_ranges[joint]
        begin, count = self.view.q[joint], round(THERE_AND_BACK / FRAME)
        ways = np.array([begin, low, high, begin])
        gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(ways)))])
        for value in np.interp(np.linspace(0, gone[-1], count), gone, ways):
            q = self.view.q.copy()
            q[joint] = value
            self.stage.place(q)
            self._read(q)
            self.film.insert_sleep(FRAME)

    def swing(self, mode: int) -> None:
        """Some periods of a mode at the view's pose."""
        q = self.view.q
        readings = self._read(q)
        lines = [one for one in readings.values() if one.modes is not None]
        if not lines:
            return
        shown = self.stage.shown
        periods = {k: one.swing(mode, shown[k].scene.swings) for k, one in readings.items()}
        tool = next(tool for k, (_, tool) in periods.items() if readings[k].modes is not None)
        words, rate = swing_words(lines[0], mode, tool)
        self.words.text = f"{self.words.text}\n{words}"
        for phase in [*range(PHASES)] * PERIODS:
            for name, (z, _) in periods.items():
                shown[name].place(z[phase % len(z)])
            self.film.insert_sleep(1 / (rate * PHASES))

    def page(self) -> str:
        """The page of viser with the film in it."""
        return str(self.film.as_html())

    def _read(self, q: Array) -> dict[str, Reading]:
        readings = {
            name: reading(machine, q, self.view.damping)
            for name, machine in self.view.machines.items()
        }
        lines = [printable(pose_text(self.view.machine, q, WORKSHOP))]
        for name, one in readings.items():
            before = f"{name}: " if len(readings) > 1 else ""
            values = dict(rows(one))
            for whats in FILMED:
                words = ", ".join(f"{what} {values[what]}" for what in whats if what in values)
                lines += textwrap.wrap(printable(before + words), LINE) if words else []
        text = "\n".join(lines)
        if text != self.words.text:
            self.words.text = text
        return readings


def legend(view: View) -> str:
    """Words of what is seen, in a corner of the page."""
    machine = view.machine
    title = escaped(machine.section.title or machine.name)
    load = escaped(f"load case {machine.payload.name}")
    over = f"<br>today, and new see-through: {escaped(view.new.name)}" if view.new else ""
    return (
        f'<style>{CORNER}</style><div id="legend"><b>{title}</b>, {load}{over}<br>'
        f"{scale_words(view.region)}</div>"
    )
