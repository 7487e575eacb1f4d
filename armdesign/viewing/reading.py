"""Frequencies of a machine at one pose and the bandwidth of its control, in words too.

All of it is computed anew for each pose by the functions that make maps: some hundredths of a
second. A pose that cannot be is said in words.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.control.map_parts import ControlOptions
from armdesign.control.pose_bandwidth import PoseBandwidth, pose_bandwidth
from armdesign.drawing.swing import Swings
from armdesign.errors import ArmDesignError
from armdesign.frequency.modes import Modes, energy_shares, natural_modes
from armdesign.machine.dead_centres import OVERCOME, dead_centre
from armdesign.machine.poses import Poses, refuse_unheld
from armdesign.units import mm

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

FAULT, LOWEST, LIMITING = "no frequency", "lowest frequency", "limited by"  # names of rows
ALONE, DAMPED = "bandwidth, position loops", "with pressure feedback"
NO_BANDWIDTH = "no bandwidth"
PHASES = 24  # of one period of an animated mode
SLOWED = 1.5  # [Hz]: faster modes are shown swinging as fast as this


@dataclass(frozen=True, eq=False, kw_only=True)
class Reading:
    """A machine under its load case at one pose.

    Attributes:
        machine: the machine.
        q: joint positions (nq,) [rad, m].
        damping: ratio to assume for the bandwidth; None: what the file gives.
        fault: why the pose cannot be; empty where it can.
        poses: everything at the pose; None where it cannot be.
        modes: its natural modes; None where it cannot be.
    """

    machine: Machine
    q: Array
    damping: float | None = None
    fault: str = ""
    poses: Poses | None = None
    modes: Modes | None = None

    @property
    def frequencies(self) -> Array:
        """Coupled natural frequencies [Hz], ascending; none where the pose cannot be."""
        return np.zeros(0) if self.modes is None else self.modes.frequencies[0]

    @cached_property
    def limiting(self) -> tuple[str, float]:
        """Part with the largest share in the energy of the lowest mode, and that share."""
        if self.poses is None or self.modes is None:
            return "", 0.0
        shares = energy_shares(self.poses, self.modes)[0, 0]
        most = int(shares.argmax())
        return self.machine.yielding[most].name, float(shares[most])

    @cached_property
    def bandwidth(self) -> PoseBandwidth | str:
        """Bandwidth of position loops at the pose; in words where they cannot be closed."""
        if self.poses is None:
            return self.fault
        try:
            options = ControlOptions(damping=self.damping)
            return pose_bandwidth(self.machine, self.poses, options)
        except ArmDesignError as error:
            return str(error)

    def swing(self, mode: int, swings: Swings) -> tuple[Array, float]:
        """Coordinates (n, k) over one period of a mode, at rest first; way of the tool [m]."""
        equilibrium = self.machine.arm.with_springs(self.q[None])
        if self.modes is None or mode >= len(self.frequencies):
            return np.asarray(equilibrium), 0.0
        swing = swings.of(self.q[None], self.modes.shapes[:, :, mode])
        phase = np.sin(2 * np.pi * np.arange(PHASES) / PHASES)[:, None]
        return np.asarray(equilibrium + phase * swing.steps), float(swing.tool[0])


def reading(machine: Machine, q: Array, damping: float | None = None) -> Reading:
    """Reading of a machine at a pose q (nq,) [rad, m] under its load case at work."""
    inputs: dict[str, Any] = {"machine": machine, "q": q, "damping": damping}
    try:
        refuse_unheld(machine, q)
        poses = machine.at(q[None])
        modes = natural_modes(poses)
        if modes.frequencies[0, 0] <= 0:
            dead = dead_centre(machine, q)
            why = dead.fault if dead else OVERCOME
            return Reading(**inputs, fault=f"{why}: the pose is unstable")
    except ArmDesignError as error:
        return Reading(**inputs, fault=str(error))
    return Reading(**inputs, poses=poses, modes=modes)


def rows(one: Reading) -> list[tuple[str, str]]:
    """A reading as rows of a table: what, and its value with unit."""
    if one.fault:
        return [(FAULT, one.fault)]
    name, share = one.limiting
    lowest, *higher = (f"{f:.3g} Hz" for f in one.frequencies)
    lines = [(LOWEST, lowest), (LIMITING, f"{name} ({100 * share:.0f} %)")]
    if higher:
        lines.append(("higher modes", ", ".join(higher)))
    width = one.bandwidth
    if isinstance(width, str):
        return [*lines, (NO_BANDWIDTH, width)]
    return [
        *lines,
        (ALONE, f"{width.proportional:.2g} Hz"),
        (DAMPED, f"{width.damped:.2g} Hz"),
        ("damping ratio", f"{width.damping:.2g}"),
    ]


def swing_words(one: Reading, mode: int, tool: float) -> tuple[str, float]:
    """An animated mode with the way of the tool [m] in words, and how fast it is shown [Hz]."""
    frequency = float(one.frequencies[mode])
    if frequency == 0:
        return f"mode {mode + 1}: unstable on trapped oil", 0.0
    shown = min(frequency, SLOWED)
    slower = f", slowed {frequency / shown:.2g} times" if frequency > shown else ""
    return f"mode {mode + 1}: {frequency:.3g} Hz{slower}, ±{tool / mm:.0f} mm at the tool", shown
