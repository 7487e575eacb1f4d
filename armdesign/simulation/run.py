"""A run: what is recorded of a machine's motion, and what the machine then rings with."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import SimulationError
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.actuator import SIDES
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr
from armdesign.simulation.controlled_plant import ENERGY
from armdesign.simulation.identification.decaying_modes import OVERDAMPED
from armdesign.simulation.identification.ringdown import Ringdown, identify_ringdown
from armdesign.simulation.plant.hydraulics import VAPOUR_PRESSURE
from armdesign.units import bar, mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure

ROUNDING = 1e-8  # of the energies of a machine at rest
HELD = 1e-3  # of the largest swing of a speed: its noise would count as much
STILL = 1e-5  # [rad/s, m/s] peak to peak: within some 10 µm at the tool, as creep and rounding
LEFT = 0.2  # share of the motion that the modes found leave, above which it is said
SETTLED = 1e-4  # of a spool's travel: what it still moves when it rests


@dataclass(frozen=True, eq=False, kw_only=True)
class Ring(ReadOnly):
    """Ring of a run while its spools rest; arrays are read-only.

    Attributes:
        begin: first instant of the window [s].
        end: its last instant [s].
        fit: modes there of the speeds of joints, then springs, but of those that friction holds.
        linear_frequencies: on trapped oil, as a map has them, at the mean pose of the window [Hz].
        cavitated: chambers that ran empty in the window, and when, in words. Vapour is no spring:
            such a ring is lower than the linear answer, the more the larger the swing.
    """

    begin: float
    end: float
    fit: Ringdown
    linear_frequencies: Array
    cavitated: tuple[str, ...]

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the answer may be off by more than its deviations, in words."""
        fit, doubts = self.fit, list[str]()
        remedy = "ask for more modes or a longer window"
        if fit.residual > LEFT:
            left = f"{100 * fit.residual:.0f} % of the motion is none of the modes found"
            doubts.append(f"{left}, deviations do not count it: {remedy}")
        if (fit.damping_ratios < -2 * fit.damping_deviations).any():
            least = fit.damping_ratios.min()
            doubts.append(f"a damping ratio of {least:.2g} is of modes not told apart: {remedy}")
        return tuple(doubts)

    @property
    def words(self) -> str:
        """The answer in one line."""
        modes = ", ".join(f"{frequency:.3f} Hz" for frequency in self.fit.natural_frequencies)
        empty = "".join(f"; {words}" for words in (*self.cavitated, *self.doubts))
        linear = f"{self.linear_frequencies[0]:.3f} Hz"
        return f"{self.begin:.3g}…{self.end:.3g} s: {modes}, lowest linear {linear}{empty}"


@dataclass(frozen=True, eq=False)
class Simulation(ReadOnly):
    """A run at n instants, over nq joints, ns springs and nc cylinders; arrays are read-only.

    Attributes:
        time: (n,) [s].
        q: joint positions (n, nq) [rad, m].
        velocity: joint speeds (n, nq) [rad/s, m/s].
        springs: positions of the springs' joints (n, ns) [rad, m].
        spring_speeds: their speeds (n, ns) [rad/s, m/s].
        pressures: of cap and annulus (n, nc, 2) [Pa].
        spool: positions (n, nc), −1…1.
        command: of the spools, the slow loop included (n, nc).
        flows: into cap and annulus (n, nc, 2) [m³/s].
        extensions: piston positions (n, nc) [m].
        speeds: rates of the pin-to-pin lengths (n, nc) [m/s].
        tool: position of the tool in the root link (n, 3) [m].
        cylinders: names, in order.
        joints: names, in order.
        machine: under the load case at work.
        energy: kinetic and potential energy of links, bars and payload (n,) [J].
        supplied: energy since the start that the pump gave, less what oil took back to the tank
            (n,) [J].
        stored: growth of kinetic and potential energy and of that in springs, compliances and
            stops, and the work that has compressed oil and hoses (n,) [J]. That oil enters or
            leaves a chamber compressed, with about p²/2β in each m³ (1 % of its work p Q at 300
            bar), is left out here and in ``supplied``: see ``plant``.
        dissipated: by valves, reliefs, leakage, friction, stops and springs (n,) [J].
        supply: pressure of the pump (n,) [Pa].
        events: what limited the motion, in words and in order: loads that cannot be held or fall
            out, stops, joint limits that were passed, cavitation, reliefs, the pump.
    """

    __repr__ = short_repr

    time: Array
    q: Array
    velocity: Array
    springs: Array
    spring_speeds: Array
    pressures: Array
    spool: Array
    command: Array
    flows: Array
    extensions: Array
    speeds: Array
    tool: Array
    energy: Array
    supplied: Array
    stored: Array
    dissipated: Array
    supply: Array
    joints: tuple[str, ...]
    cylinders: tuple[str, ...]
    machine: Machine = field(repr=False)
    events: tuple[str, ...]

    @property
    def payload(self) -> str:
        """Name of the load case."""
        return self.machine.payload.name

    @property
    def energy_error(self) -> float:
        """Largest gap of the balance supplied = stored + dissipated, over its largest term.

        A closed machine without damping exchanges energy within itself: there the largest change
        of its kinetic and potential energy counts.
        """
        gap = np.abs(self.supplied - self.stored - self.dissipated).max()
        terms = [np.abs(term).max() for term in (self.supplied, self.stored, self.dissipated)]
        # At rest nothing is exchanged but by rounding.
        least = ROUNDING * (ENERGY + np.abs(self.energy).max())
        return float(gap / max(*terms, np.ptp(self.energy), least))

    def plot(self) -> Figure:
        """Figure of joints, spools and pressures over time, and of the path of the tool."""
        from armdesign import plots

        return plots.simulation_figure(self)

    def _repr_html_(self) -> str:
        from armdesign.report import notebook

        return notebook.of_simulation(self)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """One row per instant, with the columns of a recording, which ``identify`` reads.

        time_s; of every joint, springs' last, <joint>_deg, of a slide <joint>_mm; of every
        actuator <name>_cap_bar, <name>_annulus_bar and <name>_spool, of a cylinder
        <name>_pin_to_pin_mm, too.
        """
        import pandas as pd

        columns: dict[str, Array] = {"time_s": self.time}
        positions = np.concatenate([self.q, self.springs], axis=1).T
        for joint, position in zip(self.machine.arm.coordinates, positions, strict=True):
            unit, factor = joint.file_unit
            columns[f"{joint.name}_{unit}"] = position / factor
        rigid = self.machine.rigid_poses(self.q)
        for i, (name, drive) in enumerate(zip(self.cylinders, self.machine.drives, strict=True)):
            for k, side in enumerate(SIDES):
                columns[f"{name}_{side}_bar"] = self.pressures[:, i, k] / bar
            if math.isfinite(self.machine.actuators[i].stroke):
                columns[f"{name}_pin_to_pin_mm"] = drive.length(rigid) / mm
            columns[f"{name}_spool"] = self.spool[:, i]
        return pd.DataFrame(columns)

    def ring(self, begin: float | None = None, end: float | None = None, modes: int = 1) -> Ring:
        """Natural frequencies and damping that the machine rings with once its spools rest.

        Of the speeds of joints and springs together, but of those that friction holds.

        Args:
            begin: of the window [s]; None: as soon as no spool moves any more.
            end: of the window [s]; None: the end of the run.
            modes: how many are asked for, the strongest.

        Raises:
            SimulationError: spools move to the end, there is no such window, nothing rings, what
                is left is overdamped, or see ``identify_ringdown``.

        Example:
            >>> import armdesign as ad
            >>> up = {"boom": ad.Step(size=0.02, end=1.0)}
            >>> run = ad.simulate(ad.load("excavator_20t"), (0.5, -1.8, -0.6), up, duration=8.0)
            >>> print(run.ring().words)
            1.11…8 s: 1.955 Hz, lowest linear 1.906 Hz
        """
        part = f"{self.machine.name}: ring"
        if begin is None:
            away = np.abs([self.spool - self.spool[-1], self.spool - self.command])
            moves = (away > SETTLED).any(axis=(0, 2))
            last = int(np.flatnonzero(np.append(True, moves))[-1])
            if last == len(self.time):
                raise SimulationError(part, "a spool moves to the end", "end its command earlier")
            begin = float(self.time[last])
        end = float(self.time[-1]) if end is None else end
        inside = (self.time >= begin) & (self.time <= end)
        if inside.sum() < 2:
            fault = f"{begin:g}…{end:g} s holds no two of its instants"
            raise SimulationError(part, fault, f"stay in 0…{self.time[-1]:g} s")
        speeds = np.hstack([self.velocity, self.spring_speeds])[inside]
        swing = float(np.ptp(speeds, axis=0).max())
        if swing < STILL:
            fault = f"nothing rings: speeds swing by {swing:.2g} rad/s or m/s, as by rounding"
            raise SimulationError(part, fault, "move the machine first, or begin earlier")
        moved = np.ptp(speeds, axis=0) > HELD * swing
        fit = identify_ringdown(self.time[inside], speeds[:, moved], modes, part)
        if (most := float(fit.damping_ratios.max())) > OVERDAMPED:
            fault = f"no ring but a creep or a stop: damping ratio {most:.3f}, as friction gives"
            fewer = "ask for fewer modes, " if modes > 1 else ""
            raise SimulationError(part, fault, f"{fewer}strike harder, or end earlier")
        poses = self.machine.evaluate(self.machine.rigid_poses(self.q[inside].mean(axis=0)))
        return Ring(
            begin=begin,
            end=end,
            fit=fit,
            linear_frequencies=natural_modes(poses).frequencies[0].copy(),
            cavitated=tuple(self._cavitated(inside)),
        )

    def _cavitated(self, inside: Array) -> Iterator[str]:
        time, empty = self.time[inside], self.pressures[inside] < VAPOUR_PRESSURE
        for i, actuator in enumerate(self.machine.actuators):
            for side in range(2):
                when = time[empty[:, i, side]]
                if len(when):
                    between = f"between {when[0]:.3g} and {when[-1]:.3g} s"
                    yield f"{actuator.chamber(side)} cavitated {between}"
