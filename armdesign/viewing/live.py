"""The viewer: a machine with sliders for joints and payload, and what it oscillates with there."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.units import deg, mm
from armdesign.viewing.page_words import reading_words
from armdesign.viewing.reading import Reading, reading, swing_words
from armdesign.viewing.stage import Stage

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.urdf import Joint
    from armdesign.viewing.view import View

SMOOTH = 30  # pictures a second of a swinging machine
HEAVIER = 1.5  # most of the payload's slider over the largest mass of the file


class Viewer:
    """A view with its controls on a server.

    Args:
        view: what is looked at.
        port: of the server; None: the first free one from 8080.

    Raises:
        ArmDesignError: viser is not installed, or the port cannot be used.
    """

    def __init__(self, view: View, port: int | None = None) -> None:
        self.view, self.stage = view, Stage(view, port)
        self.server = self.stage.server
        self.lock = threading.RLock()
        self.ended = threading.Event()
        self.changed = threading.Event()
        self.readings: dict[str, Reading] = {}
        self.period: dict[str, dict[str, tuple[Array, Array]]] = {}
        self.rate = 1.0
        self._add_controls()
        self.update()
        self.following = threading.Thread(target=self._follow, daemon=True)
        self.following.start()

    @property
    def address(self) -> str:
        """Address in a browser."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def wait(self) -> None:
        """Wait until it is ended; Ctrl-C does."""
        while not self.ended.wait(0.5):
            pass

    def stop(self) -> None:
        """End the server."""
        self.ended.set()
        self.following.join(timeout=2.0)
        self.stage.stop()

    # ---------------------------------------------------------------------------------- controls

    def _add_controls(self) -> None:
        gui, machine = self.server.gui, self.view.machine
        self.words = gui.add_html("")
        with gui.add_folder("Pose"):
            self.joints = [
                self._joint_slider(joint, *ends)
                for joint, ends in zip(
                    machine.arm.joints, machine.known_ranges.tolist(), strict=True
                )
            ]
            self.to_worst = gui.add_button("Worst pose")
        with gui.add_folder("Load"):
            names = [case.name for case in machine.payloads]
            self.case = gui.add_dropdown("Load case", names, initial_value=machine.payload.name)
            masses = [case.mass for case in machine.payloads]
            placed = any(case.link is not None for case in machine.payloads)
            most = HEAVIER * max(masses) or 1.0
            digits = 10 ** np.floor(np.log10(most) - 2)
            most = float(np.ceil(most / digits) * digits)
            self.mass = gui.add_slider(
                "Payload [kg]", 0.0, most, float(digits), machine.payload.mass, disabled=not placed
            )
        with gui.add_folder("Show"):
            self.swing = gui.add_checkbox("Swing in a mode", False)
            count = len(machine.arm.coordinates)
            modes = [str(k + 1) for k in range(count)]
            self.mode = gui.add_dropdown("Mode", modes, initial_value="1")
            self.region = gui.add_checkbox("Swept region", True)
            self.names = gui.add_checkbox("Names of pins", False)
            self.over = gui.add_checkbox("New machine", True, visible="new" in self.stage.shown)
        self.labels = self.stage.shown["today"].label(False)
        self._set_pose(self.view.q)
        self._connect()

    def _joint_slider(self, joint: Joint, low: float, high: float) -> Any:
        unit, factor, step = ("°", deg, 0.1) if joint.revolute else ("mm", mm, 1.0)
        least, most = np.ceil(low / factor / step) * step, np.floor(high / factor / step) * step
        if most - least < step:  # hardly any range
            least, most, step = low / factor, high / factor, (high - low) / factor / 10
        ends = round(float(least), 6), round(float(most), 6)
        return self.server.gui.add_slider(f"{joint.name} [{unit}]", *ends, step, ends[0])

    def _connect(self) -> None:
        for control in (*self.joints, self.mass, self.mode, self.swing):
            control.on_update(lambda _: self.changed.set())
        self.case.on_update(lambda _: self._case_chosen())
        self.to_worst.on_click(lambda _: self.to_worst_pose())
        for box in (self.region, self.names, self.over):
            box.on_update(lambda _: self._show())

    def _case_chosen(self) -> None:
        masses = {case.name: case.mass for case in self.view.machine.payloads}
        self.mass.value = masses[self.case.value]
        self.changed.set()

    def to_worst_pose(self) -> None:
        """Bring the sliders to the worst pose and its load case."""
        self.case.value = self.view.worst.payload
        self._set_pose(self.view.worst.q)
        self._case_chosen()

    def _set_pose(self, q: Array) -> None:
        """Bring the sliders as near to a pose as their steps are, which is kept exactly.

        A worst pose often lies on a limit, and next to it the machine holds no load.
        """
        for slider, value in zip(self.joints, q / self._factors, strict=True):
            slider.value = float(np.clip(round(value, 1), slider.min, slider.max))
        self.exact = [slider.value for slider in self.joints], np.array(q)

    def _show(self) -> None:
        self.stage.swept.visible = self.region.value
        for label in self.labels:
            label.visible = self.names.value
        if "new" in self.stage.shown:
            self.stage.shown["new"].top.visible = self.over.value

    # ------------------------------------------------------------------------------------- what is

    @property
    def q(self) -> Array:
        """The pose of the sliders (nq,) [rad, m], or the exact one that they were brought to."""
        values = [slider.value for slider in self.joints]
        return self.exact[1] if values == self.exact[0] else np.array(values) * self._factors

    @property
    def _factors(self) -> Array:
        """Units of the sliders [rad, m]."""
        joints = self.view.machine.arm.joints
        return np.array([deg if joint.revolute else mm for joint in joints])

    def loaded(self, machine: Machine) -> Machine:
        """A machine under the chosen load case, with the slider's mass."""
        names = [case.name for case in machine.payloads]
        chosen = machine.with_payload(self.case.value) if self.case.value in names else machine
        if abs(self.mass.value - chosen.payload.mass) < 1e-9:
            return chosen
        return chosen.with_payload(float(self.mass.value))

    def _reading(self, machine: Machine, q: Array) -> Reading:
        try:
            return reading(self.loaded(machine), q, self.view.damping)
        except ArmDesignError as error:  # no load case says where a mass sits
            return Reading(machine=machine, q=q, fault=str(error))

    def update(self) -> None:
        """Read the controls, and show pose and numbers; a mode as a period to be swung through."""
        with self.lock:
            q = self.q
            machines = self.view.machines.items()
            self.readings = {name: self._reading(one, q) for name, one in machines}
            self.stage.place(q)
            self.stage.shown["today"].bear(self.readings["today"].machine.payload)
            self.words.content = self._words()
            self.period = self._period() if self._swings else {}

    @property
    def _swings(self) -> bool:
        return bool(self.swing.value and self.readings["today"].modes is not None)

    def _words(self) -> str:
        """The read-out as HTML; everything that files say is escaped."""
        swing = ""
        if self._swings:
            today = self.readings["today"]
            _, tool = today.swing(self._mode, self.stage.scene.swings)
            swing, self.rate = swing_words(today, self._mode, tool)
        return reading_words(self.readings, swing, self.view.region)

    @property
    def _mode(self) -> int:
        return int(self.mode.value) - 1

    def _period(self) -> dict[str, dict[str, tuple[Array, Array]]]:
        """Places of all frames over one period of the mode, by machine."""
        scenes = {name: self.stage.shown[name].scene for name in self.readings}
        return {
            name: scenes[name].placements(one.swing(self._mode, scenes[name].swings)[0])
            for name, one in self.readings.items()
        }

    def _follow(self) -> None:
        """Follow the controls, and swing the machines while that is asked for.

        However fast a slider moves, only where it has come to is computed.
        """
        while not self.ended.is_set():
            if self.changed.wait(1 / SMOOTH if self.period else 0.1):
                self.changed.clear()
                self.update()
            with self.lock, self.server.atomic():
                for name, frames in self.period.items():
                    self.stage.shown[name].move(self._at(frames, time.monotonic() * self.rate))

    @staticmethod
    def _at(
        frames: dict[str, tuple[Array, Array]], periods: float
    ) -> dict[str, tuple[Array, Array]]:
        """Places of the frames after so many periods."""
        return {
            frame: (
                turn[int(periods * len(turn)) % len(turn)],
                at[int(periods * len(at)) % len(at)],
            )
            for frame, (turn, at) in frames.items()
        }
