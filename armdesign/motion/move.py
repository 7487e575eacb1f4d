"""A planned move, and what simulations leave of it."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.actuator import Motor
from armdesign.machine.machine import Machine
from armdesign.motion.feed_forward import SpoolPlan
from armdesign.motion.outcome import MoveRun
from armdesign.motion.shapers import TOLERATED, Shaper
from armdesign.motion.trajectory import INTERVAL, Trajectory
from armdesign.short_repr import short_repr
from armdesign.simulation.excitation import Table
from armdesign.units import deg, l_per_min, mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure


@dataclass(frozen=True, eq=False, kw_only=True)
class Move(ReadOnly):
    """A planned move and what simulations leave of it; arrays are read-only.

    Attributes:
        machine: under the load that was planned for.
        poses: joint positions at which it rests (k, nq) [rad, m].
        shaper: with which its course was convolved.
        frequencies: natural, at the end with the oil that is then in the chambers [Hz], all modes.
        empty: chambers that vapour fills at the end, as gravity empties them and valves stay shut.
        share: of the pump's flow and of the force that pressures leave, that is used.
        shortest: duration that flow and pressures allow, without the shaper's delay [s].
        duration: planned, without the shaper's delay [s].
        lead: before planned motion begins, in which slow spools open [s].
        planned: joints over time, shaped.
        plan: spools at steady load, piston speeds and flow at the planned instants.
        commands: of the spools by actuator, shaped.
        unshaped_commands: the same without the shaper.
        tolerance: distance within which the tool has settled [m].
        runs: nonlinear runs, unshaped and shaped: of the planned payload, then of others.
        faster: the move with a larger share that was given up, as it ``jolts``; None: no such.
    """

    __repr__ = short_repr

    machine: Machine
    poses: Array
    shaper: Shaper
    frequencies: Array
    empty: tuple[str, ...]
    share: float
    shortest: float
    duration: float
    lead: float
    planned: Trajectory
    plan: SpoolPlan
    commands: dict[str, Table]
    unshaped_commands: dict[str, Table]
    tolerance: float
    runs: tuple[MoveRun, ...]
    faster: Move | None = None

    @property
    def jolts(self) -> bool:
        """Whether chambers fill again on the shaped way, and too much is left for a shaper."""
        refilled = self.shaper.delay > 0 and self.shaped.refilled
        return bool(refilled) and max(self.reductions) > TOLERATED

    @property
    def unshaped(self) -> MoveRun:
        """The run under the planned payload without the shaper."""
        return self.runs[0]

    @property
    def shaped(self) -> MoveRun:
        """The run under the planned payload."""
        return self.runs[1]

    @property
    def shapers(self) -> list[Shaper]:
        """Its shaper, where it has a delay, and the usual ones for the lowest mode.

        But for those that its damping does not allow.
        """
        damping, shapers = self.shaper.of_lowest.damping, [self.shaper] * (self.shaper.delay > 0)
        for kind in (Shaper.zv, Shaper.zvd, Shaper.ei):
            with contextlib.suppress(ArmDesignError):
                shapers.append(kind(float(self.frequencies[0]), damping))
        return shapers

    @property
    def reductions(self) -> tuple[float, ...]:
        """Residual of shaped over unshaped run, payload by payload."""
        pairs = zip(self.runs[::2], self.runs[1::2], strict=True)
        return tuple(after.residual / before.residual for before, after in pairs)

    @property
    def stop_time(self) -> float:
        """Time at which the commands of the shaped move end [s]."""
        return self.lead + self.planned.duration

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The plan, one row per instant: joints, piston speeds, pump flow and spool commands.

        From 0 on: the arm rests until ``lead``, but slow spools are commanded before.
        """
        import pandas as pd

        count = math.ceil(self.lead / INTERVAL)
        before = np.linspace(0.0, self.lead, count, endpoint=False)

        def from_rest(planned: Array) -> Array:
            return np.concatenate([np.repeat(planned[:1], count), planned])

        columns = {"time_s": np.concatenate([before, self.lead + self.planned.time])}
        for joint, position in zip(self.machine.arm.joints, self.planned.q.T, strict=True):
            unit, factor = joint.file_unit
            columns[f"{joint.name}_{unit}"] = from_rest(position / factor)
        for i, (name, table) in enumerate(self.commands.items()):
            turns = isinstance(self.machine.actuators[i], Motor)
            unit, factor = ("deg_per_s", deg) if turns else ("mm_per_s", mm)
            columns[f"{name}_{unit}"] = from_rest(self.plan.speeds[:, i] / factor)
            columns[f"{name}_spool"] = np.array([table(t) for t in columns["time_s"]])
        columns["pump_l_per_min"] = from_rest(self.plan.flow / l_per_min)
        return pd.DataFrame(columns)

    @property
    def residuals(self) -> pd.DataFrame:
        """One row per run: payload, shaper, end of commands, residual, settling, drift, miss."""
        import pandas as pd

        rows = []
        for run in self.runs:
            row: dict[str, Any] = {
                "payload_kg": run.mass,
                "shaper": self.shaper.name if run.shaped else "none",
                "stop_s": run.end,
                "residual_mm": run.residual / mm,
                "settled_s": run.settled,
                "drift_mm_per_s": run.drift / mm,
            }
            for joint, miss in zip(self.machine.arm.joints, run.miss, strict=True):
                unit, factor = joint.file_unit
                row[f"{joint.name}_miss_{unit}"] = miss / factor
            rows.append(row)
        return pd.DataFrame(rows)

    def plot(self) -> Figure:
        """Draw commands, flow, pressures, tool path, what is left, and its spectrum."""
        from armdesign import plots

        return plots.move_figure(self)
