"""Bandwidth maps: how fast position loops can be, at every pose and under every load case.

Three controllers are compared at each pose. All loops of each keep the asked disk margin
together:

* ``proportional``: one position gain for all joints, nothing else;
* ``damped``: with feedback of the load pressures, one gain and one loss factor for all;
* ``own``: gains of their own for each loop.

Velocity feed-forward changes no margin; it divides the error of a constant-speed move by the error
of the valves' gain. Beside them stand what single-loop formulas would promise: Merritt's bound
K_v < 2ζω (1967, section 6-4), a bandwidth of 2ζf, and the rule f/3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.control.controller import Controller, Filter
from armdesign.control.loop_plant import LoopPlant, loop_plant, workable
from armdesign.control.loops import Loops
from armdesign.control.margins import GAIN_MARGIN_DB, PHASE_MARGIN, disk_margin_for
from armdesign.control.settling import settling_time, tracking_error
from armdesign.control.tuning import (
    Aim,
    Gains,
    Task,
    Tuned,
    best_of,
    critical_factor,
    damped,
    proportional,
    searched,
)
from armdesign.errors import ArmDesignError, PoseError
from armdesign.frequency.cases import CasePoses, in_chunks, load_cases, poses_of
from armdesign.frequency.modes import natural_modes
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.short_repr import short_repr
from armdesign.units import deg

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

SCHEMES = ("proportional", "damped", "own")
GAIN_ERROR = 0.15  # of the valve's gain, as a controller knows it: what feed-forward leaves
RULE = 3.0  # usual practice: a bandwidth of a third of the lowest natural frequency
SAMPLES = (0.0, 0.15, 0.7)  # ranks by frequency of poses whose gains are searched, per load case
CHUNK = 1_000  # poses whose frequency responses are in memory


@dataclass(frozen=True, kw_only=True)
class ControlOptions:
    """Requirements on the controllers.

    Attributes:
        damping: ratio of all modes in place of the file's damping; None: the file's.
        delay: between demand and spool [s].
        gain_margin_db: that all loops keep together [dB].
        phase_margin: that all loops keep together [rad].
        filter: of load pressures.
        corner: of that filter [rad/s]; None: follows the lowest natural frequency.
    """

    damping: float | None = None
    delay: float = 0.0
    gain_margin_db: float = GAIN_MARGIN_DB
    phase_margin: float = PHASE_MARGIN
    filter: Filter = "high-pass"
    corner: float | None = None

    @property
    def aim(self) -> Aim:
        """Disk margin and filter."""
        margin = disk_margin_for(self.gain_margin_db, self.phase_margin)
        if self.corner is not None and not 0 < self.corner < math.inf:
            fault = f"{self.corner:g} rad/s is not allowed"
            raise ArmDesignError("corner", fault, "give a positive number")
        if self.filter not in ("high-pass", "band-pass"):
            fault, remedy = f"{self.filter!r} is none", "give high-pass or band-pass"
            raise ArmDesignError("filter", fault, remedy)
        return Aim(margin=margin, filter=self.filter, corner=self.corner)


@dataclass(frozen=True, eq=False, kw_only=True)
class BandwidthMap(ReadOnly):
    """Bandwidths of a machine over a workspace and all its load cases.

    Attributes:
        frame: one row per load case and pose at which it exists; columns: joints [rad, m],
            ``payload``, ``tool_x_m`` …, ``works``: whether a controller can work there, ``f1_hz``,
            ``damping``, ``merritt_hz``, ``rule_hz``, and of each scheme ``<scheme>_hz`` (its
            narrowest loop), ``<scheme>_<joint>_hz``, ``<scheme>_command_hz`` (up to which commands
            are followed with feed-forward), ``<scheme>_margin``, ``<scheme>_peak`` of S,
            ``<scheme>_tracking_s``: error of a constant-speed move over the speed, without
            feed-forward. Of ``own`` also ``own_settling_s`` and ``own_critical``: factor on its
            gains at which the loops become unstable. All 0 where no controller works.
        gains: one row for each row of ``frame``: ``<scheme>_<joint>_gain_per_s``,
            ``<scheme>_<actuator>_pressure_gain_m_per_s_bar`` and ``corner_rad_per_s``.
        machine: the machine.
        workspace: the poses.
        options: what was asked of the controllers.
    """

    __repr__ = short_repr

    frame: pd.DataFrame
    gains: pd.DataFrame
    machine: Machine
    workspace: Workspace
    options: ControlOptions

    def worst(self, scheme: str = "own") -> pd.Series[Any]:
        """The row with the least bandwidth of a scheme, of those at which a controller works."""
        return self._least(f"{scheme}_hz")

    @property
    def softest(self) -> pd.Series[Any]:
        """The row with the lowest natural frequency, of those at which a controller works."""
        return self._least("f1_hz")

    def _least(self, column: str) -> pd.Series[Any]:
        works = self.frame[self.frame["works"]]
        return works.iloc[int(works[column].to_numpy().argmin())]

    @property
    def schedule(self) -> pd.DataFrame:
        """For drive and controller makers: frequency, damping, critical gain, gains, filter.

        Of ``own`` gains, one row per pose and load case at which a controller works.
        """
        own = [name for name in map(str, self.gains.columns) if name.startswith("own_")]
        named = {name: name.removeprefix("own_") for name in own}
        works = self.frame["works"]
        head = self.frame.loc[works, [*self.machine.joints, "payload", "f1_hz", "damping"]]
        gains = self.gains.loc[works, [*own, "corner_rad_per_s"]].rename(columns=named)
        first = gains[f"{self.machine.joints[0]}_gain_per_s"]
        critical = self.frame.loc[works, "own_critical"] * first
        head = head.assign(critical_gain_per_s=critical)
        return head.join(gains).reset_index(drop=True)

    @property
    def slow_valves(self) -> dict[str, float]:
        """Actuators whose valve is slower than the lowest mode somewhere: share of rows."""
        works = self.frame[self.frame["works"]]
        shares = {}
        for actuator in self.machine.actuators:
            assert actuator.valve is not None
            slower = float((works["f1_hz"] > actuator.valve.natural_frequency).mean())
            if slower > 0:
                shares[actuator.name] = slower
        return shares

    def plot(self, ax: Axes | None = None, scheme: str = "own", **limits: float) -> Axes:
        """Heatmap of a scheme's narrowest bandwidth over two joints."""
        from armdesign import plots

        return plots.bandwidth_map(self, ax, scheme, **limits)


@checked
def bandwidth_map(
    machine: Machine,
    workspace: Workspace | None = None,
    *,
    damping: float | None = None,
    delay: float = 0.0,
    gain_margin_db: float = GAIN_MARGIN_DB,
    phase_margin: float = PHASE_MARGIN,
    filter: Filter = "high-pass",
    corner: float | None = None,
) -> BandwidthMap:
    """Bandwidths of position loops at every pose of a workspace, under every load case.

    Args:
        machine: the machine; every actuator needs a valve.
        workspace: the poses; default: about 500 of a joint grid.
        damping: ratio of all modes in place of the file's damping; None: the file's.
        delay: between demand and spool [s].
        gain_margin_db: that all loops keep together [dB].
        phase_margin: that all loops keep together [rad].
        filter: of the load pressures that are fed back: high-pass or band-pass.
        corner: of that filter [rad/s]; None: follows the lowest natural frequency.

    Raises:
        ArmDesignError: damping that is none, numbers that cannot be, or a margin that no gains
            keep.
        PoseError: a pose that this machine cannot take, or no pose at which a controller works.
        SimulationError: an actuator has no valve.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> bandwidths = ad.bandwidth_map(machine, workspace, damping=0.02)
        >>> print(bandwidths.frame[["boom", "f1_hz", "own_hz"]].round(2).to_string(index=False))
         boom  f1_hz  own_hz
        -0.82   7.45    5.47
        -0.08  10.40    7.57
         0.65  16.63   11.93
    """
    options = ControlOptions(
        damping=damping,
        delay=delay,
        gain_margin_db=gain_margin_db,
        phase_margin=phase_margin,
        filter=filter,
        corner=corner,
    )
    aim = options.aim
    workspace = workspace or Workspace.grid(machine, points=default_points(machine))
    cases = list(load_cases(machine, workspace))
    parts = list(_parts(cases, machine))
    candidates = _candidates(parts, options, aim)
    tables = [_tabled(part, options, aim, candidates) for part in parts]
    bandwidths = _assembled(machine, workspace, options, tables)
    if not bandwidths.frame["own_hz"].any():
        fault = (
            f"no gains keep {gain_margin_db:g} dB and {phase_margin / deg:g} deg (disk margin"
            f" {aim.margin:.3f}) at any pose"
        )
        remedy = f"ask for less, as {GAIN_MARGIN_DB:g} dB and {PHASE_MARGIN / deg:g} deg"
        raise ArmDesignError(f"{machine.name}: margin", fault, remedy)
    return bandwidths


def default_points(machine: Machine) -> int:
    """Values per joint of a grid of about 500 poses."""
    moving = max(len(machine.joints) - len(machine.idle_joints), 1)
    return max(2, round(500 ** (1 / moving)))


class _CasePart(NamedTuple):
    """Poses of a load case, and at which of them a controller can work."""

    case: CasePoses
    poses: Poses
    works: Array  # indices

    def task(self, options: ControlOptions, aim: Aim, rows: Array) -> Task:
        """Plants and loops at some of the poses at which a controller works."""
        poses = self.poses[self.works[rows]]
        plant = loop_plant(self.case.machine, poses, options.damping, options.delay)
        return Task(plant, Loops.of(plant), aim)


def _parts(cases: Sequence[CasePoses], machine: Machine) -> list[_CasePart]:
    """All poses in parts, load case by load case.

    Raises:
        PoseError: a controller works at none of them.
    """
    parts: dict[str, list[_CasePart]] = {case.name: [] for case in cases}
    for case, _, rigid in in_chunks(cases, f"{machine.name}: bandwidths"):
        poses = poses_of(cases, case, rigid) if len(rigid) else None
        for begin in range(0, len(rigid), CHUNK):
            assert poses is not None
            some = poses[begin : begin + CHUNK]
            works = np.flatnonzero(workable(case.machine, some))
            parts[case.name].append(_CasePart(case, some, works))
    listed = [part for of_case in parts.values() for part in of_case]
    if not any(len(part.works) for part in listed):
        fault = "at no pose of the workspace can its valves move all loads both ways"
        remedy = "raise supply.pressure_bar or reliefs, or give lighter load cases"
        raise PoseError(f"{machine.name}: control", fault, remedy)
    return listed


def _candidates(parts: Sequence[_CasePart], options: ControlOptions, aim: Aim) -> list[Gains]:
    """Gains without unit of their own for each loop, searched at a few poses of each load case."""
    candidates = list[Gains]()
    for part in parts:
        if len(part.works):
            order = natural_modes(part.poses[part.works]).frequencies[:, 0].argsort()
            rows = np.unique([order[round(rank * (len(order) - 1))] for rank in SAMPLES])
            candidates += searched(part.task(options, aim, rows))
    return candidates


def _tabled(
    part: _CasePart, options: ControlOptions, aim: Aim, candidates: Sequence[Gains]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Rows of the frame and of the gains of one part."""
    import pandas as pd

    machine, poses = part.case.machine, part.poses
    columns: dict[str, Any] = dict(zip(machine.joints, poses.q.T, strict=True))
    columns["payload"] = machine.payload.name
    columns |= {f"tool_{axis}_m": place for axis, place in zip("xyz", poses.tool.T, strict=True)}
    columns["works"] = np.isin(np.arange(len(poses)), part.works)
    columns["f1_hz"] = natural_modes(poses).frequencies[:, 0]
    frame, gains = pd.DataFrame(columns), pd.DataFrame(index=range(len(poses)))
    if len(part.works) == 0:
        return frame, gains
    task = part.task(options, aim, np.arange(len(part.works)))
    simple = proportional(task)
    common = damped(task).or_wider(simple)
    own = best_of(task, candidates).or_wider(common)
    figures, numbers = _single_loop(task.plant), dict[str, Array]()
    for scheme, tuned in zip(SCHEMES, (simple, common, own), strict=True):
        figures |= _figures(machine, scheme, tuned)
        error = tracking_error(task.plant, tuned.controller).max(axis=1)
        figures[f"{scheme}_tracking_s"] = np.where(np.isfinite(error), error, 0.0)
        numbers |= _numbers(machine, scheme, tuned.controller)
    figures["own_settling_s"] = settling_time(task.plant, own.controller)
    figures["own_critical"] = critical_factor(task.plant, own.controller)
    numbers["corner_rad_per_s"] = own.controller.corner
    for table, new in ((frame, figures), (gains, numbers)):
        for name, values in new.items():
            spread = np.zeros(len(poses))
            spread[part.works] = values
            table[name] = spread
    return frame, gains


def _single_loop(plant: LoopPlant) -> dict[str, Array]:
    """Damping, and bandwidths that formulas of a single loop promise [Hz]."""
    lowest, ratio = plant.frequencies[:, 0], plant.damping[:, 0]
    return {"damping": ratio, "merritt_hz": 2 * ratio * lowest, "rule_hz": lowest / RULE}


def _figures(machine: Machine, scheme: str, tuned: Tuned) -> dict[str, Array]:
    figures = tuned.figures
    width = figures.bandwidth / (2 * math.pi)
    each = {f"{scheme}_{joint}_hz": of for joint, of in zip(machine.joints, width.T, strict=True)}
    return {
        f"{scheme}_hz": width.min(axis=1),
        **each,
        f"{scheme}_command_hz": figures.command_bandwidth.min(axis=1) / (2 * math.pi),
        f"{scheme}_margin": figures.margin,
        f"{scheme}_peak": figures.peak,
    }


def _numbers(machine: Machine, scheme: str, controller: Controller) -> dict[str, Array]:
    joints, actuators = machine.joints, [actuator.name for actuator in machine.actuators]
    position = zip(joints, controller.position.T, strict=True)
    pressure = zip(actuators, controller.pressure.T, strict=True)
    return {
        **{f"{scheme}_{name}_gain_per_s": gain for name, gain in position},
        **{f"{scheme}_{name}_pressure_gain_m_per_s_bar": gain for name, gain in pressure},
    }


def _assembled(
    machine: Machine,
    workspace: Workspace,
    options: ControlOptions,
    tables: Sequence[tuple[pd.DataFrame, pd.DataFrame]],
) -> BandwidthMap:
    import pandas as pd

    frame, gains = (
        pd.concat(parts, ignore_index=True).fillna(0.0) for parts in zip(*tables, strict=True)
    )
    return BandwidthMap(
        frame=frame, gains=gains, machine=machine, workspace=workspace, options=options
    )
