"""Frequency maps: natural frequencies over a workspace and all load cases, and the worst pose of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array, Flags, chunks, percentiles, weighted_share
from armdesign.errors import PoseError
from armdesign.frequency.cases import in_chunks, load_cases
from armdesign.frequency.modes import Modes, energy_shares, lowest_frequency, natural_modes
from armdesign.frequency.workspace import Workspace, nearest, place, spread, tipped
from armdesign.frequency.worst_frequency import WorstPose, refined
from armdesign.hydraulics.actuator import Actuator, Motor
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses

if TYPE_CHECKING:
    import pandas as pd

STIFFNESS = ("hydraulic", "gravity", "geometric")  # the parts of K
SPREAD = 100_000  # poses of a reach map inside the joint box
NEAR = 24  # more of them about the lowest of each cell, twice
EXACT = 20_000  # of them at most where nothing can be interpolated
PERCENTILES = (1, 5, 25, 50, 75, 95)


@dataclass(frozen=True, eq=False)
class ReachMap:
    """What a machine's user sees: the lowest frequency at each place of the tool, whatever pose brings it there.

    Attributes:
        reach: middles of the cells, from the root's z axis, forward positive (nx,) [m].
        height: middles of the cells (nz,) [m].
        frequency: least over all poses and load cases (nx, nz) [Hz]; NaN where no pose brings the
            tool.
    """

    reach: Array
    height: Array
    frequency: Array


@dataclass(frozen=True, eq=False)
class FrequencyMap:
    """Natural frequencies of a machine over a workspace, every load case at the poses where it exists.

    Attributes:
        frame: one row per pose and load case; columns: each joint [rad, m], ``payload``,
            ``tool_x_m`` …, ``f1_hz`` … (coupled), ``locked_<cylinder>_hz``,
            ``rigid_<cylinder>_hz``, ``<cylinder>_force_n``, ``<cylinder>_extension``; of a motor
            ``<motor>_torque_n_m`` and no extension.
        worst: the worst pose, refined off the grid.
        worst_of: the worst pose of every load case, by its name.
        limiting: for each row, the cylinder with the largest share in the lowest mode.
        stiffness_parts: for each row (n, 3) [rad²/s²], what oil, gravity and the moment arms'
            change under load (``STIFFNESS``) give to ω² of the lowest mode.
        weights: what each row counts in percentiles and shares (n,): the joint boxes that its pose
            stands for.
        machine: the machine.
        workspace: the poses.
    """

    frame: pd.DataFrame
    worst: WorstPose
    worst_of: dict[str, WorstPose]
    limiting: Array
    stiffness_parts: Array
    weights: Array
    machine: Machine
    workspace: Workspace

    def __post_init__(self) -> None:
        for value in (self.limiting, self.stiffness_parts, self.weights):
            value.setflags(write=False)

    def percentiles(self, percents: Sequence[float] = PERCENTILES) -> pd.DataFrame:
        """Percentiles [Hz] of the lowest coupled frequency: a row for each load case and one for ``all``.

        Of joint space, not of rows: each pose counts as the joint box that it stands for.
        """
        import pandas as pd

        lowest = self.frame["f1_hz"].to_numpy()
        cases = {name: (self.frame["payload"] == name).to_numpy() for name in self.worst_of}
        cases["all"] = np.ones(len(lowest), dtype=bool)
        rows = {
            name: percentiles(lowest[rows], self.weights[rows], percents)
            for name, rows in cases.items()
        }
        return pd.DataFrame.from_dict(
            rows, orient="index", columns=[f"{percent:g} %" for percent in percents]
        )

    @property
    def limiting_shares(self) -> pd.Series[float]:
        """Share of joint space that each actuator limits, all load cases together.

        They sum to one.
        """
        import pandas as pd

        names = [actuator.name for actuator in self.machine.actuators]
        shares = {name: weighted_share(self.limiting == name, self.weights) for name in names}
        return pd.Series(shares, name="share")

    @property
    def formula_ratios(self) -> pd.DataFrame:
        """What simpler formulas say over the lowest coupled frequency of the same pose: least, median and greatest.

        A row per cylinder and formula: ``locked`` with all other cylinders locked (optimistic,
        never below one; up to inf, where these leave no motion), ``rigid`` with the static load as
        a mass (up to inf, where that load vanishes). Unstable poses are left out; inf where all
        are.
        """
        import pandas as pd

        lowest = self.frame["f1_hz"].to_numpy()
        stable = lowest > 0
        rows = {}
        for cylinder in self.machine.actuators:
            for formula in ("locked", "rigid"):
                ratio = (
                    self.frame[f"{formula}_{cylinder.name}_hz"].to_numpy()[stable] / lowest[stable]
                )
                spread = (
                    percentiles(ratio, self.weights[stable], [0, 50, 100])
                    if stable.any()
                    else 3 * (np.inf,)
                )
                rows[cylinder.name, formula] = tuple(spread)
        index = pd.MultiIndex.from_tuples(rows, names=["cylinder", "formula"])
        return pd.DataFrame(
            list(rows.values()), index=index, columns=["least", "median", "greatest"]
        )

    @property
    def stiffness_shares(self) -> pd.DataFrame:
        """Shares of oil, gravity and moment arms in the lowest mode's stiffness vᵀKv, row by row.

        They sum to one.

        Beyond one or below zero where a part holds against another; of no meaning where the pose
        is unstable.
        """
        import pandas as pd

        return pd.DataFrame(
            self.stiffness_parts / self.stiffness_parts.sum(axis=1, keepdims=True),
            columns=STIFFNESS,
        )

    @property
    def stiffness(self) -> pd.DataFrame:
        """Bookkeeping of the lowest mode row by row: pose, load case, ω² and what each part gives to it [rad²/s²]."""
        frame = self.frame[[*self.machine.joints, "payload", "f1_hz"]].copy()
        frame["omega_squared"] = self.stiffness_parts.sum(axis=1)
        for name, values in zip(STIFFNESS, self.stiffness_parts.T, strict=True):
            frame[name] = values
        return frame

    @property
    def holding_pressures(self) -> Array:
        """Static pressure of each cylinder's loaded chamber over the supply's (n, nc), row by row.

        Above one it sinks.

        The other chamber is at return pressure, or at the preload of its valve: a simulation
        starts so.
        """
        return self.static_pressures / self.machine.supply.pressure

    @property
    def static_pressures(self) -> Array:
        """Static pressure of each actuator's loaded chamber (n, nc) [Pa], row by row."""
        supply, actuators = self.machine.supply, self.machine.actuators
        forces = [self.frame[_force_column(actuator)].to_numpy() for actuator in actuators]
        pairs = zip(actuators, forces, strict=True)
        return np.stack(
            [np.maximum(*actuator.static_pressures(force, supply)) for actuator, force in pairs],
            axis=1,
        )

    @property
    def beyond_reliefs(self) -> dict[str, tuple[float, float]]:
        """Functions whose port relief some load presses open: share of joint space, and largest static pressure [Pa].

        It cannot be held there, whatever the supply: the actuator gives way.
        """
        actuators, supply = self.machine.actuators, self.machine.supply
        found = {}
        for actuator, pressure in zip(actuators, self.static_pressures.T, strict=True):
            open_ = pressure > actuator.relief(supply)
            if open_.any():
                found[actuator.name] = weighted_share(open_, self.weights), float(pressure.max())
        return found

    def reach_map(self, cells: int | None = None) -> ReachMap:
        """Least frequency over all poses that bring the tool to a cell of the reach/height plane.

        Between the poses of a joint grid tool place and frequency are interpolated, so that no
        cell inside is blank; up to the ends of the joint ranges and to the pitch limits of the
        load cases, where the lowest often are. A reach-plane workspace brings its own cells.

        Args:
            cells: number of cells along the longer side; default 90, fewer where scattered poses
                would leave gaps.
        """
        q = self.frame[list(self.machine.joints)].to_numpy()
        tool = self.frame[["tool_x_m", "tool_y_m", "tool_z_m"]].to_numpy()
        places = np.stack(
            [self.machine.arm.reach(q, tool), tool[:, 2], self.frame["f1_hz"].to_numpy()], axis=1
        )
        points = [places]
        if self.workspace.cells is not None:
            x, z = self.workspace.cells
        else:
            nodes = {
                name: found
                for name in self.worst_of
                if (found := _nodes(self, name, places)) is not None
            }
            cells = cells or min(
                90, max(5, int((len(places) / 10) ** 0.5)) if len(nodes) == 0 else 90
            )
            size = (
                max(0.01, *np.ptp(places[:, :2], axis=0)) / cells
            )  # where the tool does not move, too
            x, z = (np.arange(axis.min(), axis.max() + size, size) for axis in places.T[:2])
            points += [
                _between(self, name, known, (x, z), places) for name, known in nodes.items()
            ]
        reach, height, lowest = np.concatenate(points).T
        values = np.full((len(x), len(z)), np.inf)
        np.minimum.at(values, (nearest(x, reach), nearest(z, height)), lowest)
        return ReachMap(x, z, np.where(np.isinf(values), np.nan, values))

    def plot(self, ax: Any = None, plane: str = "joints", **limits: float) -> Any:
        """Heatmap of the lowest coupled frequency over two joints or over reach and height.

        Returns the axes.
        """
        from armdesign import plots

        return plots.frequency_map(self, ax, plane, **limits)


def frequency_map(machine: Machine, workspace: Workspace | None = None) -> FrequencyMap:
    """Coupled, locked and rigid-load frequencies at every pose of the workspace under every load case.

    Poses are taken in chunks, so that beside the map itself even a million of them need little
    memory.

    Args:
        machine: the machine.
        workspace: the poses; default: ``Workspace.grid(machine)``.

    Raises:
        PoseError: a pose that this machine cannot take, or a load case that exists at none of
            them.
    """
    workspace = workspace or Workspace.grid(machine)
    cases = list(load_cases(machine, workspace))
    for case in cases:
        if not case.exists.any():
            path = f"payload.{case.name}.pitch_deg"
            raise PoseError(
                f"{machine.source.name}: {path}",
                f"link {case.machine.payload.link} has that pitch at no pose of the workspace",
                "widen it, or remove the load case",
                machine.line_of(path),
            )
    ends = np.cumsum([0, *(case.exists.sum() for case in cases)])
    names = _columns(machine)
    values = np.empty((len(names), ends[-1]))  # a row per column: pandas takes it as it is
    parts, limiting = np.empty((len(STIFFNESS), ends[-1])), np.empty(ends[-1], dtype=int)
    filled = dict(zip(cases, ends[:-1], strict=True))
    for case, _, rigid in in_chunks(cases, f"{machine.name}: frequencies"):
        poses = case.machine.at(rigid)
        modes = _modes(case.machine, poses)
        to = slice(filled[case], filled[case] + len(poses))
        values[:, to] = _values(machine, poses, modes)
        parts[:, to] = _stiffness_parts(poses, modes)
        limiting[to] = energy_shares(poses, modes)[:, 0].argmax(axis=1)
        filled[case] = to.stop
    lowest = values[names.index("f1_hz")]
    worst = [
        refined(case, lowest[start:end])
        for case, start, end in zip(cases, ends[:-1], ends[1:], strict=True)
    ]
    actuators = np.array([actuator.name for actuator in machine.actuators])
    payloads = np.repeat([case.name for case in cases], np.diff(ends))
    return FrequencyMap(
        frame=_frame(names, values, payloads, len(machine.joints)),
        worst=min(worst, key=lambda pose: pose.frequency),
        worst_of={pose.payload: pose for pose in worst},
        limiting=actuators[limiting],
        stiffness_parts=parts.T,
        weights=np.concatenate([workspace.weights[case.exists] for case in cases]),
        machine=machine,
        workspace=workspace,
    )


def _nodes(frequencies: FrequencyMap, payload: str, points: Array) -> Array | None:
    """Rows ``points`` (reach, height, frequency) of a load case on the grid (3, …), NaN elsewhere.

    None if no grid.
    """
    workspace, rows = frequencies.workspace, (frequencies.frame["payload"] == payload).to_numpy()
    index = workspace.index(
        frequencies.frame.loc[rows, list(frequencies.machine.joints)].to_numpy()
    )
    on_grid = np.abs(index - np.rint(index)).max(axis=0) < 1e-6
    if on_grid.sum() < 2 ** len(workspace.axes):
        return None
    nodes = np.full((3, *(len(axis) for axis in workspace.axes)), np.nan)
    nodes[:, *np.rint(index[:, on_grid]).astype(int)] = points[rows][on_grid].T
    return nodes


def _between(
    frequencies: FrequencyMap, payload: str, nodes: Array, cells: tuple[Array, Array], rows: Array
) -> Array:
    """Lowest point (reach, height, frequency) of one load case in each cell, between the ``nodes`` of a joint grid.

    Sought on interpolated values up to all edges, most densely about the lowest, and then
    computed; none is below the least of the map's ``rows``.
    """
    workspace, case = frequencies.workspace, frequencies.machine.with_payload(payload)
    held = np.isfinite(nodes[2])
    _complete(case, workspace, nodes)
    q, points, _ = _interpolated(case, workspace, nodes, held, spread(case, workspace, SPREAD))
    low, high = workspace.ranges.T
    chance = np.random.default_rng(0)
    for width in SPREAD ** (-1 / len(low)) * np.array([1.0, 0.4]):
        lowest = q[_lowest(points, cells)]
        around = lowest + width * (high - low) * chance.uniform(-1, 1, (NEAR, *lowest.shape))
        around = np.clip(around.reshape(-1, len(low)), low, high)
        near, found, beyond = _interpolated(case, workspace, nodes, held, around)
        turned, more, _ = _interpolated(
            case, workspace, nodes, held, tipped(case, workspace, beyond)
        )
        q, points = np.concatenate([q, near, turned]), np.concatenate([points, found, more])
    best = _lowest(points, cells)
    exact = _points(case, q[best])[:, 2]
    return np.column_stack([points[best, :2], np.maximum(exact, rows[:, 2].min())])


def _lowest(points: Array, cells: tuple[Array, Array]) -> Array:
    """Which of the points (reach, height, frequency) is the lowest of each cell that has any."""
    cell = nearest(cells[0], points[:, 0]) * len(cells[1]) + nearest(cells[1], points[:, 1])
    order = np.lexsort((points[:, 2], cell))
    return np.asarray(order[np.unique(cell[order], return_index=True)[1]])


def _interpolated(
    case: Machine, workspace: Workspace, nodes: Array, held: Flags, q: Array
) -> tuple[Array, Array, Array]:
    """Those of the poses q (n, nq) at which a load case exists, their reach, height and frequency (n, 3), poses beyond.

    Linear between ``nodes``; exact where a box of the grid has corners out of stroke. ``held``:
    nodes with the load.
    """
    from scipy.ndimage import map_coordinates

    inside = map_coordinates(held.astype(float), workspace.index(q), order=1, mode="nearest")
    cut = np.flatnonzero((inside > 0) & (inside < 1 - 1e-9))
    inside[cut] = workspace.allows(case, q[cut])
    beyond, q = q[cut[inside[cut] == 0]], q[inside > 0]
    points = np.stack(
        [map_coordinates(layer, workspace.index(q), order=1, mode="nearest") for layer in nodes],
        axis=1,
    )
    edge = workspace.on_ends(q)  # whose arcs, not their chords, are the rim of the reach
    points[edge, :2] = place(case, q[edge])
    unknown = np.flatnonzero(np.isnan(points[:, 2]))
    unknown = unknown[:: 1 + len(unknown) // EXACT]
    points[unknown] = _points(case, q[unknown])
    known = np.isfinite(points).all(axis=1)
    return q[known], points[known], beyond


def _complete(case: Machine, workspace: Workspace, nodes: Array) -> None:
    """Fill in what a load case would have (reach, height, frequency) at nodes of the grid beyond its pitch limits.

    Only those next to nodes where it exists, so that boxes which a limit cuts have all their
    corners.
    """
    from scipy.ndimage import binary_dilation

    known = np.isfinite(nodes[2])
    beside = binary_dilation(known, np.ones((3,) * known.ndim)) & ~known
    if not beside.any():
        return
    q = np.stack(
        [axis[i] for axis, i in zip(workspace.axes, np.nonzero(beside), strict=True)], axis=1
    )
    found = np.full((len(q), 3), np.nan)
    free = workspace.in_stroke(q)
    found[free] = _points(case, q[free])
    nodes[:, beside] = found.T


def _points(case: Machine, q: Array) -> Array:
    """Reach, height and lowest frequency (n, 3) at poses in stroke, whether they hold the load case or not."""
    found = [np.empty((0, 3))]
    for rows in chunks(len(q)):
        poses = case.evaluate(case.rigid_poses(q[rows]))
        reach = case.arm.reach(poses.q, poses.tool)
        found.append(np.stack([reach, poses.tool[:, 2], lowest_frequency(poses)], axis=1))
    return np.concatenate(found)


def _modes(case: Machine, poses: Poses) -> Modes:
    """The modes; what the inertia lacks is said of the load case."""
    try:
        return natural_modes(poses)
    except PoseError as error:
        path = f"payload.{case.payload.name}"
        words = f"the {error.part} {error.problem}"
        raise PoseError(
            f"{case.source.name}: {path}", words, error.remedy, case.line_of(path)
        ) from None


def _columns(machine: Machine) -> list[str]:
    """Names of the numbers in a map's frame."""
    names = [actuator.name for actuator in machine.actuators]
    return [
        *machine.joints,
        *(f"tool_{axis}_m" for axis in "xyz"),
        *(f"f{i + 1}_hz" for i in range(len(machine.joints))),
        *(f"locked_{name}_hz" for name in names),
        *(f"rigid_{name}_hz" for name in names),
        *(_force_column(actuator) for actuator in machine.actuators),
        *(f"{cylinder.name}_extension" for cylinder in machine.cylinders),
    ]


def _force_column(actuator: Actuator) -> str:
    """Of the static force [N] of a cylinder, torque [N m] of a motor."""
    return (
        f"{actuator.name}_torque_n_m"
        if isinstance(actuator, Motor)
        else f"{actuator.name}_force_n"
    )


def _values(machine: Machine, poses: Poses, modes: Modes) -> Array:
    """The numbers of ``_columns`` (columns, n)."""
    found = (
        poses.q,
        poses.tool,
        modes.frequencies,
        modes.locked_frequencies,
        modes.rigid_frequencies,
    )
    extensions = poses.extensions[:, : len(machine.cylinders)]
    return np.concatenate([*found, poses.cylinder_forces, extensions], axis=1).T


def _stiffness_parts(poses: Poses, modes: Modes) -> Array:
    """vᵀ K_x v of the lowest mode (parts, n) [rad²/s²], with vᵀ M v = 1: they sum to ω²."""
    shape = modes.shapes[:, :, :1]
    matrices = (poses.hydraulic_stiffness, poses.gravity_stiffness, poses.geometric_stiffness)
    return np.array([(np.swapaxes(shape, 1, 2) @ matrix @ shape)[:, 0, 0] for matrix in matrices])


def _frame(names: list[str], values: Array, payloads: Array, nq: int) -> pd.DataFrame:
    import pandas as pd

    frame = pd.DataFrame(values.T, columns=names, copy=False)
    frame.insert(nq, "payload", payloads)
    return frame
