"""Frequency maps: natural frequencies over a workspace and all load cases, with the worst pose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, Flags, ReadOnly, congruent, percentiles, weighted_share
from armdesign.errors import PoseError
from armdesign.frequency.bands import Bands
from armdesign.frequency.cases import CasePoses, in_chunks, load_cases, poses_of, refuse_missing
from armdesign.frequency.frequency_band import FrequencyBand, band_about
from armdesign.frequency.modes import Modes, energy_shares, natural_modes
from armdesign.frequency.reach_map import ReachMap, reach_map
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import WorstPose, refined
from armdesign.hydraulics.actuator import Actuator, Motor
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses, pose_text
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

STIFFNESS = "hydraulic", "gravity", "geometric", "springs"  # parts of K; the last if there are any
PERCENTILES = (1, 5, 25, 50, 75, 95)


@dataclass(frozen=True, eq=False)
class FrequencyMap(ReadOnly):
    """Natural frequencies of a machine over a workspace and all its load cases.

    Attributes:
        columns: by name, a value for each load case and pose at which it exists (n,): each joint
            [rad, m], ``payload``, ``tool_x_m`` …, ``f1_hz`` … (coupled), ``locked_<cylinder>_hz``,
            ``rigid_<cylinder>_hz``, ``<cylinder>_force_n``, ``<cylinder>_extension`` (share of the
            stroke); of a motor ``<motor>_torque_n_m``, no extension and inf for the rigid load.
            Each spring has a coupled frequency more.
        worst: the worst pose, refined off the grid.
        worst_of: the worst pose of every load case, by its name.
        limiting: for each row, the actuator or spring with the largest share in the lowest mode.
        stiffness_parts: for each row (n, 3) [rad²/s²], what oil, gravity and the moment arms'
            change under load (``STIFFNESS``) give to ω² of the lowest mode; (n, 4) with springs.
        weights: what each row counts in percentiles and shares (n,): the joint boxes that its pose
            stands for.
        machine: the machine.
        workspace: the poses.
    """

    __repr__ = short_repr

    columns: Mapping[str, Array]
    worst: WorstPose
    worst_of: dict[str, WorstPose]
    limiting: Array
    stiffness_parts: Array
    weights: Array
    machine: Machine
    workspace: Workspace

    @property
    def headline(self) -> str:
        """Machine, its worst frequency, at which pose and load case, and what limits it there."""
        at, pose = self.worst, pose_text(self.machine, self.worst.q)
        where = f"{pose}, load case {at.payload}, limited by {at.cylinder}"
        return f"of {self.machine.name}: worst {at.frequency:.4g} Hz at {where}"

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The columns as a frame of pandas, one row per load case and pose at which it exists."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))

    @property
    def q(self) -> Array:
        """Joint positions, row by row (n, nq) [rad, m]."""
        return np.stack([self.columns[name] for name in self.machine.joints], axis=1)

    @property
    def lowest(self) -> Array:
        """The lowest coupled frequency, row by row (n,) [Hz]."""
        return self.columns["f1_hz"]

    def rows_of(self, payload: str) -> Flags:
        """Which rows are those of a load case (n,)."""
        return np.asarray(self.columns["payload"] == payload)

    def spread(self, payload: str, percents: Sequence[float]) -> Array:
        """Percentiles [Hz] of a load case, as in ``percentiles``."""
        rows = self.rows_of(payload)
        return percentiles(self.lowest[rows], self.weights[rows], percents)

    def percentiles(self, percents: Sequence[float] = PERCENTILES) -> pd.DataFrame:
        """Percentiles [Hz] of the lowest coupled frequency: a row per load case and ``all``.

        Of joint space, not of rows: each pose counts as the joint box that it stands for.
        """
        import pandas as pd

        rows = {name: self.spread(name, percents) for name in self.worst_of}
        rows["all"] = percentiles(self.lowest, self.weights, percents)
        heads = [f"{percent:g} %" for percent in percents]
        return pd.DataFrame(rows.values(), index=list(rows), columns=heads)

    @property
    def limiting_shares(self) -> pd.Series[float]:
        """Share of joint space that each actuator or spring limits, over all load cases.

        They sum to one. Where a spring limits, cylinders yield less.
        """
        import pandas as pd

        names = [part.name for part in self.machine.yielding]
        shares = {name: weighted_share(self.limiting == name, self.weights) for name in names}
        return pd.Series(shares, name="share")

    @property
    def part_shares(self) -> Array:
        """Shares of oil, gravity, moment arms and springs in the lowest mode's vᵀKv, row by row.

        An array (n, 3), or (n, 4) with springs. They sum to one; beyond one or below zero where
        one part acts against another, and of no meaning where the pose is unstable.
        """
        return self.stiffness_parts / self.stiffness_parts.sum(axis=1, keepdims=True)

    @property
    def stiffness_columns(self) -> dict[str, Array]:
        """Pose, load case, ω² of the lowest mode and each part's contribution to it [rad²/s²]."""
        known = {name: self.columns[name] for name in (*self.machine.joints, "payload", "f1_hz")}
        parts = dict(zip(STIFFNESS, self.stiffness_parts.T, strict=False))
        return {**known, "omega_squared": self.stiffness_parts.sum(axis=1), **parts}

    @property
    def stiffness(self) -> pd.DataFrame:
        """The ``stiffness_columns`` as a frame of pandas."""
        import pandas as pd

        return pd.DataFrame(self.stiffness_columns)

    @cached_property
    def band(self) -> FrequencyBand:
        """Lowest frequency of the poses within the file's bands, or assumed ones if it has none.

        Raises:
            PoseError: at the soft end gravity overcomes the trapped oil.
        """
        bands, nominal = Bands.shown(self.machine), float(self.lowest.min())
        return band_about(self.machine, self.workspace, bands, nominal=nominal)

    @property
    def holding_pressures(self) -> Array:
        """Static pressure of each loaded chamber over the supply's (n, nc), row by row.

        Above one the actuator sinks. The other chamber is at return pressure, or at the preload of
        its valve, as at the start of a simulation where that valve does not leak at rest.
        """
        return self.static_pressures / self.machine.supply.pressure

    @property
    def static_pressures(self) -> Array:
        """Static pressure of each actuator's loaded chamber (n, nc) [Pa], row by row."""
        pressures = []
        for actuator in self.machine.actuators:
            force = self.columns[_force_column(actuator)]
            pressures.append(np.maximum(*actuator.static_pressures(force, self.machine.supply)))
        return np.stack(pressures, axis=1)

    @property
    def beyond_reliefs(self) -> dict[str, tuple[float, float]]:
        """Actuators whose port relief a load opens: share of joint space, largest pressure [Pa].

        The load cannot be held there, whatever the supply: the actuator gives way.
        """
        beyond = {}
        pairs = zip(self.machine.actuators, self.static_pressures.T, strict=True)
        for actuator, pressure in pairs:
            opens = pressure > actuator.relief(self.machine.supply)
            if opens.any():
                share = weighted_share(opens, self.weights)
                beyond[actuator.name] = share, float(pressure.max())
        return beyond

    def reach_map(self, cells: int | None = None) -> ReachMap:
        """Lowest frequency over all poses that bring the tool to a cell of the reach/height plane.

        Between the poses of a joint grid, tool place and frequency are interpolated, so that no
        cell inside is blank; up to the ends of the joint ranges and to the pitch limits of the
        load cases, where the lowest often are. A reach-plane workspace brings its own cells.

        Values are sought, not proved: within 2 % of brute force in tests. A cell may be blank into
        which the tool reaches less than 1/500 of its size deep (none to two of some 3000 cells).

        Args:
            cells: number of cells along the longer side; default 90, fewer where scattered poses
                would leave gaps.
        """
        tool = np.stack([self.columns[f"tool_{axis}_m"] for axis in "xyz"], axis=1)
        reach = self.machine.heading.reach(self.q, tool)
        points = np.stack([reach, tool[:, 2], self.lowest], axis=1)
        return reach_map(list(load_cases(self.machine, self.workspace)), points, cells)

    def plot(self, ax: Axes | None = None, plane: str = "joints", **limits: float) -> Axes:
        """Heatmap of the lowest coupled frequency over two joints or over reach and height."""
        from armdesign import plots

        return plots.frequency_map(self, ax, plane, **limits)

    def _repr_html_(self) -> str:
        from armdesign.report import notebook

        return notebook.of_map(self)


@checked
def frequency_map(machine: Machine, workspace: Workspace | None = None) -> FrequencyMap:
    """Natural frequencies of every load case at every pose of a workspace, and the worst pose.

    Poses are taken in chunks, so that beside the map itself even a million of them need little
    memory.

    Args:
        machine: the machine.
        workspace: the poses; default: ``Workspace.grid(machine)``.

    Raises:
        PoseError: a pose that this machine cannot take, or a load case that exists at none of
            them.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> worst = ad.frequency_map(machine, workspace).worst
        >>> print(f"{worst.frequency:.2f} Hz, {worst.cylinder}")
        7.45 Hz, lift
    """
    workspace = workspace or Workspace.grid(machine)
    cases = list(load_cases(machine, workspace))
    refuse_missing(cases)
    ends = np.cumsum([0, *(case.exists.sum() for case in cases)])
    columns = _columns(machine)
    values = np.empty((len(columns), ends[-1]))
    parts = np.empty((3 + bool(machine.springs), ends[-1]))
    limiting = np.empty(ends[-1], dtype=int)
    filled = dict(zip(cases, ends[:-1], strict=True))

    def at_some(case: CasePoses, rigid: RigidPoses) -> tuple[Array, Array, Array]:
        poses = poses_of(cases, case, rigid)
        modes = _modes(case.machine, poses)
        largest = energy_shares(poses, modes)[:, 0].argmax(axis=1)
        return _values(machine, poses, modes), _stiffness_parts(poses, modes), largest

    for case, of_some in in_chunks(cases, at_some, f"{machine.name}: frequencies"):
        rows = slice(filled[case], filled[case] + len(of_some[2]))
        values[:, rows], parts[:, rows], limiting[rows] = of_some
        filled[case] = rows.stop
    lowest = np.split(values[columns.index("f1_hz")], ends[1:-1])
    worst = [refined(case, of_case) for case, of_case in zip(cases, lowest, strict=True)]
    names = np.array([case.name for case in cases], dtype=object)
    named = dict(zip(columns, values, strict=True)) | {"payload": np.repeat(names, np.diff(ends))}
    return FrequencyMap(
        columns={name: named[name] for name in (*machine.joints, "payload", *columns)},
        worst=min(worst, key=lambda pose: pose.frequency),
        worst_of={pose.payload: pose for pose in worst},
        limiting=np.array([part.name for part in machine.yielding])[limiting],
        stiffness_parts=parts.T,
        weights=np.concatenate([workspace.weights[case.exists] for case in cases]),
        machine=machine,
        workspace=workspace,
    )


def _modes(case: Machine, poses: Poses) -> Modes:
    """The modes; an inertia that is not positive definite is an error of the load case."""
    try:
        return natural_modes(poses)
    except PoseError as error:
        path = f"payload.{case.payload.name}"
        words = f"the {error.part} {error.fault}"
        place = f"{case.source.name}: {path}"
        raise PoseError(place, words, error.remedy, case.line_of(path)) from None


def _columns(machine: Machine) -> list[str]:
    """Names of a map's numbers."""
    names = [actuator.name for actuator in machine.actuators]
    return [
        *machine.joints,
        *(f"tool_{axis}_m" for axis in "xyz"),
        *(f"f{i + 1}_hz" for i in range(len(machine.arm.coordinates))),
        *(f"locked_{name}_hz" for name in names),
        *(f"rigid_{name}_hz" for name in names),
        *(_force_column(actuator) for actuator in machine.actuators),
        *(f"{cylinder.name}_extension" for cylinder in machine.cylinders),
    ]


def _force_column(actuator: Actuator) -> str:
    """Name of the column of static forces [N], of a motor static torques [N m]."""
    suffix = "torque_n_m" if isinstance(actuator, Motor) else "force_n"
    return f"{actuator.name}_{suffix}"


def _values(machine: Machine, poses: Poses, modes: Modes) -> Array:
    """The numbers of ``_columns`` (columns, n)."""
    columns = (
        *(poses.q, poses.tool),
        *(modes.frequencies, modes.locked_frequencies, modes.rigid_frequencies),
        *(poses.cylinder_forces, poses.extensions[:, : len(machine.cylinders)]),
    )
    rows = [column.T for column in columns]
    return np.concatenate(rows, out=np.empty((sum(map(len, rows)), len(poses))))


def _stiffness_parts(poses: Poses, modes: Modes) -> Array:
    """vᵀ K_x v of the lowest mode (parts, n) [rad²/s²], with vᵀ M v = 1: they sum to ω²."""
    shape, nq = modes.shapes[:, :, :1], poses.q.shape[1]
    matrices = (poses.hydraulic_stiffness, poses.gravity_stiffness, poses.geometric_stiffness)
    parts = [congruent(np.swapaxes(shape, 1, 2), matrix)[:, 0, 0] for matrix in matrices]
    if poses.spring_stiffness.size:
        parts.append((poses.spring_stiffness * shape[:, nq:, 0] ** 2).sum(axis=1))
    return np.array(parts)
