"""Bandwidth maps: how fast position loops can be, at every pose and under every load case.

Four controllers are compared at each pose. Positions are measured at the joints. All loops of each
keep the asked disk margin together:

* ``proportional``: one position gain for all joints, nothing else;
* ``individual``: a position gain of its own for each joint, nothing else;
* ``damped``: with feedback of the load pressures, one gain and one loss factor for all;
* ``own``: with it and gains of their own for each loop, which are searched: a lower bound.

Velocity feed-forward changes no margin; it divides the error of a constant-speed move by the error
of the valves' gain. Beside them stand what single-loop formulas would promise: Merritt's bound
K_v < 2ζω (1967, section 6-4), a bandwidth of 2ζf, and the rule f/3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.control.controller import Controller, Filter
from armdesign.control.critical_gain import critical_factor
from armdesign.control.loop_plant import LoopPlant, refuse_long
from armdesign.control.map_parts import ControlOptions, MapPart, map_parts
from armdesign.control.margins import GAIN_MARGIN_DB, PHASE_MARGIN
from armdesign.control.most_margin import no_gains_keep
from armdesign.control.own_bandwidths import Schemes, schemes
from armdesign.control.settling import settling_time, tracking_error
from armdesign.control.tuning import Tuned
from armdesign.control.uneven_spools import least_damping
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import natural_modes
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import Actuator, Motor
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr
from armdesign.threads import in_threads

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

SCHEMES = ("proportional", "individual", "damped", "own")
GAIN_ERROR = 0.15  # of the valve's gain, as a controller knows it: what feed-forward leaves
RULE = 3.0  # usual practice: a bandwidth of a third of the lowest natural frequency


@dataclass(frozen=True, eq=False, kw_only=True)
class BandwidthMap(ReadOnly):
    """Bandwidths of a machine over a workspace and all its load cases.

    Attributes:
        frame: one row per load case and pose at which it exists; columns: joints [rad, m],
            ``payload``, ``tool_x_m`` …, ``works``: whether a controller can work there, ``f1_hz``,
            ``damping``, ``bounding_hz`` and ``bounding_damping`` of the mode that decays most
            slowly (least ζω, which bounds position gains), ``merritt_hz``, ``rule_hz``, and of
            each scheme ``<scheme>_hz`` (its narrowest loop), ``<scheme>_<joint>_hz``,
            ``<scheme>_command_hz`` (up to which commands are followed with feed-forward),
            ``<scheme>_margin``, ``<scheme>_peak`` of S, ``<scheme>_settling_s`` after a step,
            ``<scheme>_tracking_s``: error of a constant-speed move over the speed, without
            feed-forward. Of ``own`` also ``own_critical``: factor on its gains at which the loops
            become unstable, and without a delay ``own_damping``: ratio of the least damped mode
            with the loops closed. All 0 where no controller works. ``f1_hz`` and ``rule_hz`` are
            as in a frequency map; all else is of the pressures at rest, which are other ones
            where valves leak: with air in the oil that mode may be another, too.
        gains: one row for each row of ``frame``: ``<scheme>_<joint>_gain_per_s``,
            ``<scheme>_<actuator>_pressure_gain_m_per_s_bar`` (of a motor ``…_rad_per_s_bar``)
            and ``corner_rad_per_s``.
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

    @property
    def q(self) -> Array:
        """Joint positions, row by row (n, nq) [rad, m]."""
        return self.frame[list(self.machine.joints)].to_numpy()

    @property
    def headline(self) -> str:
        """Machine, and its least bandwidth with pressure feedback and without."""
        if not self.frame["works"].any():
            return f"of {self.machine.name}: no controller works at any pose"
        own, alone = (self.worst(s)[f"{s}_hz"] for s in ("own", "proportional"))
        return f"of {self.machine.name}: worst {own:.4g} Hz, {alone:.4g} by position loops alone"

    def worst(self, scheme: str = "own") -> pd.Series[Any]:
        """The row with the least bandwidth of a scheme, of those at which a controller works.

        Raises:
            ArmDesignError: there is no such scheme.
        """
        if scheme not in SCHEMES:
            raise ArmDesignError("scheme", f'"{scheme}" is none', choose(scheme, SCHEMES))
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

        Of ``own`` gains, and beside them position gains for loops without pressure feedback
        (``individual``); one row per pose and load case at which a controller works. Where no
        delay is stated, with the damping of the closed loops.
        """
        own = [name for name in map(str, self.gains.columns) if name.startswith("own_")]
        named = {name: name.removeprefix("own_") for name in [*own, "corner_rad_per_s"]}
        for joint in self.machine.joints:
            alone = f"individual_{joint}_gain_per_s"
            named[alone] = f"{joint}_gain_without_feedback_per_s"
        works = self.frame["works"]
        head = self.frame.loc[works, [*self.machine.joints, "payload", "f1_hz", "damping"]]
        gains = self.gains.loc[works, list(named)].rename(columns=named)
        first = gains[f"{self.machine.joints[0]}_gain_per_s"]
        critical = self.frame.loc[works, "own_critical"] * first
        head = head.assign(critical_gain_per_s=critical)
        if "own_damping" in self.frame:
            head = head.assign(closed_damping=self.frame.loc[works, "own_damping"])
        return head.join(gains).assign(filter=self.options.filter).reset_index(drop=True)

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
        """Heatmap of a scheme's narrowest bandwidth over two joints.

        Raises:
            ArmDesignError: there is no such scheme.
        """
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
        ArmDesignError: damping that is none, numbers that cannot be, a delay of many periods of
            the lowest mode, or a margin that no gains keep; with the largest that some keep.
        PoseError: a pose that this machine cannot take, or no pose at which a controller works.
        SimulationError: an actuator has no valve.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> bandwidths = ad.bandwidth_map(machine, workspace, damping=0.02)
        >>> columns = ["boom", "f1_hz", "merritt_hz", "damped_hz"]
        >>> print(bandwidths.frame[columns].round(2).to_string(index=False))
         boom  f1_hz  merritt_hz  damped_hz
        -0.82   7.45        0.30       5.85
        -0.08  10.40        0.42       8.10
         0.65  16.63        0.67      12.84
    """
    options = ControlOptions(
        damping=damping,
        delay=delay,
        gain_margin_db=gain_margin_db,
        phase_margin=phase_margin,
        filter=filter,
        corner=corner,
    )
    workspace = workspace or Workspace.grid(machine, points=default_points(machine))
    parts = map_parts(list(load_cases(machine, workspace)), machine)
    if delay:
        refuse_long(delay, min(part.lowest for part in parts), machine)
    found = schemes(parts, options)
    pairs = zip(parts, found, strict=True)
    tables = in_threads(lambda pair: _tabled(pair[0], options, pair[1]), pairs)
    bandwidths = _assembled(machine, workspace, options, list(tables))
    if not bandwidths.frame["own_hz"].any():
        raise no_gains_keep(machine, parts, options)
    return bandwidths


def default_points(machine: Machine) -> int:
    """Values per joint of a grid of about 500 poses."""
    moving = max(len(machine.joints) - len(machine.joints_without_effect), 1)
    return max(2, round(500 ** (1 / moving)))


def _tabled(
    part: MapPart, options: ControlOptions, found: Schemes | None
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
    if found is None:
        return frame, gains
    plant = part.plant(options)
    figures, numbers = _single_loop(plant), dict[str, Array]()
    figures["rule_hz"] = columns["f1_hz"][part.works] / RULE
    for scheme in SCHEMES:
        tuned = getattr(found, scheme)
        figures |= _figures(machine, scheme, tuned)
        figures |= _in_time(plant, scheme, tuned.controller)
        numbers |= _numbers(machine, scheme, tuned.controller)
    own = found.own.controller
    figures["own_critical"] = critical_factor(plant, own)
    if not options.delay:  # which has no finite number of poles
        closed = own.position.any(axis=1)
        figures["own_damping"] = np.where(closed, least_damping(plant, own), 0.0)
    numbers["corner_rad_per_s"] = own.corner
    for table, new in ((frame, figures), (gains, numbers)):
        for name, values in new.items():
            spread = np.zeros(len(poses))
            spread[part.works] = values
            table[name] = spread
    return frame, gains


def _single_loop(plant: LoopPlant) -> dict[str, Array]:
    """Damping, and the bandwidth that Merritt's formula of a single loop promises [Hz]."""
    lowest, ratio = plant.frequencies[:, 0], plant.damping[:, 0]
    each, slow = np.arange(len(plant)), (plant.damping * plant.frequencies).argmin(axis=1)
    return {
        "damping": ratio,
        "bounding_hz": plant.frequencies[each, slow],
        "bounding_damping": plant.damping[each, slow],
        "merritt_hz": 2 * ratio * lowest,
    }


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


def _in_time(plant: LoopPlant, scheme: str, controller: Controller) -> dict[str, Array]:
    """Settling time and error of a move at constant speed; 0 where there are no gains."""
    error, works = tracking_error(plant, controller).max(axis=1), controller.position.all(axis=1)
    return {
        f"{scheme}_settling_s": np.where(works, settling_time(plant, controller), 0.0),
        f"{scheme}_tracking_s": np.where(np.isfinite(error), error, 0.0),
    }


def _numbers(machine: Machine, scheme: str, controller: Controller) -> dict[str, Array]:
    position = zip(machine.joints, controller.position.T, strict=True)
    pressure = zip(machine.actuators, controller.pressure.T, strict=True)
    return {
        **{f"{scheme}_{name}_gain_per_s": gain for name, gain in position},
        **{f"{scheme}_{pressure_gain_column(one)}": gain for one, gain in pressure},
    }


def pressure_gain_column(actuator: Actuator) -> str:
    """Name of the column of pressure gains [m/s/bar], of a motor [rad/s/bar]."""
    unit = "rad" if isinstance(actuator, Motor) else "m"
    return f"{actuator.name}_pressure_gain_{unit}_per_s_bar"


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
