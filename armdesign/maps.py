"""Frequency maps: natural frequencies over a workspace and all load cases, and the worst pose of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.cylinder import Actuator, Motor, static_pressures
from armdesign.errors import PoseError
from armdesign.machine import Machine
from armdesign.modes import Modes, energy_shares, lowest_frequency, natural_modes
from armdesign.poses import Poses
from armdesign.workspace import Workspace, nearest, onto_pitch_limit, tipping_joints

if TYPE_CHECKING:
    import pandas as pd

STARTS = 4  # local searches per load case
STIFFNESS = ("hydraulic", "gravity", "geometric")  # the parts of K
PERCENTILES = (1, 5, 25, 50, 75, 95)


@dataclass(frozen=True, eq=False)
class WorstPose:
    """Where the lowest coupled natural frequency [Hz] of a map is, off the grid.

    Attributes:
        q: joint positions (nq,) [rad, m].
        payload: name of the load case.
        frequency: lowest coupled natural frequency there [Hz].
        cylinder: the cylinder or motor with the largest share of that mode's oil-spring energy.
        tool: position of the tool (3,) [m].
        joints: names of the coordinates.
    """

    q: Array
    payload: str
    frequency: float
    cylinder: str
    tool: Array
    joints: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ReachMap:
    """What a machine's user sees: the lowest frequency at each place of the tool, whatever pose brings it there.

    Attributes:
        reach: middles of the cells, from the root's z axis, forward positive (nx,) [m].
        height: middles of the cells (nz,) [m].
        frequency: least over all poses and load cases (nx, nz) [Hz]; NaN where no pose brings the tool.
    """

    reach: Array
    height: Array
    frequency: Array


@dataclass(frozen=True, eq=False)
class FrequencyMap:
    """Natural frequencies of a machine over a workspace, every load case at the poses where it exists.

    Attributes:
        frame: one row per pose and load case; columns: each joint [rad, m], ``payload``, ``tool_x_m`` …,
            ``f1_hz`` … (coupled), ``locked_<cylinder>_hz``, ``rigid_<cylinder>_hz``, ``<cylinder>_force_n``,
            ``<cylinder>_extension``; of a motor ``<motor>_torque_n_m`` and no extension.
        worst: the worst pose, refined off the grid.
        worst_of: the worst pose of every load case, by its name.
        limiting: for each row, the cylinder with the largest share in the lowest mode.
        stiffness_parts: for each row (n, 3) [rad²/s²], what oil, gravity and the moment arms' change under load
            (``STIFFNESS``) give to ω² of the lowest mode.
        machine: the machine.
        workspace: the poses.
    """

    frame: pd.DataFrame
    worst: WorstPose
    worst_of: dict[str, WorstPose]
    limiting: Array
    stiffness_parts: Array
    machine: Machine
    workspace: Workspace

    def __post_init__(self) -> None:
        for value in (self.limiting, self.stiffness_parts):
            value.setflags(write=False)

    def percentiles(self, percents: Sequence[float] = PERCENTILES) -> pd.DataFrame:
        """Percentiles [Hz] of the lowest coupled frequency: a row for each load case and one for ``all``."""
        import pandas as pd

        lowest = self.frame["f1_hz"].to_numpy()
        cases = {name: (self.frame["payload"] == name).to_numpy() for name in self.worst_of}
        rows = {name: np.percentile(lowest[rows], percents) for name, rows in cases.items()}
        rows["all"] = np.percentile(lowest, percents)
        return pd.DataFrame.from_dict(rows, orient="index", columns=[f"{percent:g} %" for percent in percents])

    @property
    def limiting_shares(self) -> pd.Series[float]:
        """Share of the poses that each function limits, all load cases together; they sum to one."""
        import pandas as pd

        names = [function.name for function in self.machine.functions]
        return pd.Series({name: float(np.mean(self.limiting == name)) for name in names}, name="share")

    @property
    def formula_ratios(self) -> pd.DataFrame:
        """What simpler formulas say over the lowest coupled frequency of the same pose: least, median and greatest.

        A row per cylinder and formula: ``locked`` with all other cylinders locked (optimistic, never below one),
        ``rigid`` with the static load as a mass (up to inf, where that load vanishes). Unstable poses are left out;
        inf where all are.
        """
        import pandas as pd

        lowest = self.frame["f1_hz"].to_numpy()
        stable = lowest > 0
        rows = {}
        for cylinder in self.machine.functions:
            for formula in ("locked", "rigid"):
                ratio = self.frame[f"{formula}_{cylinder.name}_hz"].to_numpy()[stable] / lowest[stable]
                some = stable.any()
                rows[cylinder.name, formula] = (ratio.min(), np.median(ratio), ratio.max()) if some else 3 * (np.inf,)
        index = pd.MultiIndex.from_tuples(rows, names=["cylinder", "formula"])
        return pd.DataFrame(list(rows.values()), index=index, columns=["least", "median", "greatest"])

    @property
    def stiffness_shares(self) -> pd.DataFrame:
        """Shares of oil, gravity and moment arms in the lowest mode's stiffness vᵀKv, row by row; they sum to one.

        Beyond one or below zero where a part holds against another; of no meaning where the pose is unstable.
        """
        import pandas as pd

        return pd.DataFrame(self.stiffness_parts / self.stiffness_parts.sum(axis=1, keepdims=True), columns=STIFFNESS)

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
        """Larger static chamber pressure of each cylinder over the supply's (n, nc), row by row; above one it sinks."""
        supply, shares = self.machine.supply, []
        for c in self.machine.functions:
            force = self.frame[_force_column(c)].to_numpy()
            pressures = static_pressures(force, c.bore_area, c.annulus_area, supply.return_pressure)
            shares.append(np.maximum(*pressures) / supply.pressure)
        return np.stack(shares, axis=1)

    def reach_map(self, cells: int | None = None) -> ReachMap:
        """Least frequency over all poses that bring the tool to a cell of the reach/height plane.

        Between the poses of a joint grid tool place and frequency are interpolated, so that no cell inside is blank.
        A reach-plane workspace brings its own cells.

        Args:
            cells: number of cells along the longer side; default 90, fewer where scattered poses would leave gaps.
        """
        q = self.frame[list(self.machine.joints)].to_numpy()
        tool = self.frame[["tool_x_m", "tool_y_m", "tool_z_m"]].to_numpy()
        reach = self.machine.arm.reach(q, tool)
        points = [np.stack([reach, tool[:, 2], self.frame["f1_hz"].to_numpy()], axis=1)]
        if self.workspace.cells is not None:
            x, z = self.workspace.cells
        else:
            points += [_between(self, payload, points[0]) for payload in self.worst_of]
            cells = cells or min(90, max(5, int((sum(len(found) for found in points) / 10) ** 0.5)))
            size = max(0.01, *np.ptp(points[0][:, :2], axis=0)) / cells  # where the tool does not move, too
            x, z = (np.arange(axis.min(), axis.max() + size, size) for axis in points[0].T[:2])
        reach, height, lowest = np.concatenate(points).T
        values = np.full((len(x), len(z)), np.inf)
        np.minimum.at(values, (nearest(x, reach), nearest(z, height)), lowest)
        return ReachMap(x, z, np.where(np.isinf(values), np.nan, values))

    def plot(self, ax: Any = None, plane: str = "joints", **limits: float) -> Any:
        """Heatmap of the lowest coupled frequency over two joints or over reach and height; returns the axes."""
        from armdesign import plots

        return plots.frequency_map(self, ax, plane, **limits)


def frequency_map(machine: Machine, workspace: Workspace) -> FrequencyMap:
    """Coupled, locked and rigid-load frequencies at every pose of the workspace under every load case.

    Poses are taken in chunks, so that beside the map itself even a million of them need little memory.

    Raises:
        PoseError: a pose that this machine cannot take, or a load case that exists at none of them.
    """
    cases = [machine.with_payload(payload.name) for payload in machine.payloads]
    held = [workspace.holds(case.payload) for case in cases]
    for case, flags in zip(cases, held, strict=True):
        if not flags.any():
            path = f"payload.{case.payload.name}.pitch_deg"
            raise PoseError(
                f"{machine.source.name}: {path}",
                f"link {case.payload.link} has that pitch at no pose of the workspace",
                "widen it, or remove the load case",
                machine.line_of(path),
            )
    ends = np.cumsum([0, *(flags.sum() for flags in held)])
    names = _columns(machine)
    values = np.empty((len(names), ends[-1]))  # a row per column: pandas takes it as it is
    parts, limiting = np.empty((len(STIFFNESS), ends[-1])), np.empty(ends[-1], dtype=int)
    filled = ends[:-1].copy()
    for rows, rigid in workspace.parts(f"{machine.name}: frequencies"):
        for k, case in enumerate(cases):
            poses = case.at(rigid[held[k][rows]])
            modes = _modes(case, poses)
            to = slice(filled[k], filled[k] + len(poses))
            values[:, to] = _values(case, poses, modes)
            parts[:, to] = _stiffness_parts(poses, modes)
            limiting[to] = energy_shares(poses, modes)[:, 0].argmax(axis=1)
            filled[k] = to.stop
    nq = len(machine.joints)
    worst = [
        _worst(case, workspace, values[:nq, start:end].T, values[names.index("f1_hz"), start:end])
        for case, start, end in zip(cases, ends[:-1], ends[1:], strict=True)
    ]
    functions = np.array([function.name for function in machine.functions])
    payloads = np.repeat([case.payload.name for case in cases], np.diff(ends))
    return FrequencyMap(
        frame=_frame(names, values, payloads, nq),
        worst=min(worst, key=lambda pose: pose.frequency),
        worst_of={case.payload.name: pose for case, pose in zip(cases, worst, strict=True)},
        limiting=functions[limiting],
        stiffness_parts=parts.T,
        machine=machine,
        workspace=workspace,
    )


def _between(frequencies: FrequencyMap, payload: str, points: Array) -> Array:
    """Points (reach, height, frequency) of one load case on a finer joint grid, where all corners exist."""
    from scipy.ndimage import map_coordinates

    workspace, rows = frequencies.workspace, (frequencies.frame["payload"] == payload).to_numpy()
    shape = tuple(len(axis) for axis in workspace.axes)
    q = frequencies.frame.loc[rows, list(frequencies.machine.joints)].to_numpy()
    index = [nearest(axis, q[:, j]) for j, axis in enumerate(workspace.axes)]
    off = [np.abs(axis[i] - q[:, j]) for j, (axis, i) in enumerate(zip(workspace.axes, index, strict=True))]
    on_grid = np.max(off, axis=0) < 1e-9
    if on_grid.sum() < 2 ** len(shape):  # not a grid
        return np.empty((0, 3))
    grid = np.full((3, *shape), np.nan)
    cells = np.ravel_multi_index([i[on_grid] for i in index], shape)
    grid.reshape(3, -1)[:, cells] = points[rows][on_grid].T
    budget = 600_000 ** (1 / len(shape))
    fine = [np.linspace(0, count - 1, max(count, int(budget))) for count in shape]
    coordinates = np.stack(np.meshgrid(*fine, indexing="ij")).reshape(len(shape), -1)
    values = np.stack([map_coordinates(layer, coordinates, order=1, mode="nearest") for layer in grid], axis=1)
    return np.asarray(values[np.isfinite(values).all(axis=1)])


def _modes(case: Machine, poses: Poses) -> Modes:
    """The modes; what the inertia lacks is said of the load case."""
    try:
        return natural_modes(poses)
    except PoseError as error:
        path = f"payload.{case.payload.name}"
        words = f"the {error.part} {error.problem}"
        raise PoseError(f"{case.source.name}: {path}", words, error.remedy, case.line_of(path)) from None


def _columns(machine: Machine) -> list[str]:
    """Names of the numbers in a map's frame."""
    names = [function.name for function in machine.functions]
    return [
        *machine.joints,
        *(f"tool_{axis}_m" for axis in "xyz"),
        *(f"f{i + 1}_hz" for i in range(len(machine.joints))),
        *(f"locked_{name}_hz" for name in names),
        *(f"rigid_{name}_hz" for name in names),
        *(_force_column(function) for function in machine.functions),
        *(f"{cylinder.name}_extension" for cylinder in machine.cylinders),
    ]


def _force_column(function: Actuator) -> str:
    """Of the static force [N] of a cylinder, torque [N m] of a motor."""
    return f"{function.name}_torque_n_m" if isinstance(function, Motor) else f"{function.name}_force_n"


def _values(machine: Machine, poses: Poses, modes: Modes) -> Array:
    """The numbers of ``_columns`` (columns, n)."""
    found = (poses.q, poses.tool, modes.frequencies, modes.locked_frequencies, modes.rigid_frequencies)
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


# ------------------------------------------------------------------------------------------------- the worst pose


def _worst(machine: Machine, workspace: Workspace, q: Array, frequency: Array) -> WorstPose:
    """Refine the lowest grid poses of one load case by a local method and take the lowest of all."""
    best_q, best = q[frequency.argmin()], float(frequency.min())
    for start in _distinct_minima(workspace, q, frequency):
        refined = _descend(machine, workspace, start)
        if refined is not None:
            value = float(lowest_frequency(machine.at(refined))[0])
            if value < best:
                best_q, best = refined, value
    poses = machine.at(best_q)
    share = energy_shares(poses, natural_modes(poses))[0, 0]
    return WorstPose(
        q=best_q,
        payload=machine.payload.name,
        frequency=best,
        cylinder=machine.functions[int(share.argmax())].name,
        tool=poses.tool[0],
        joints=machine.joints,
    )


def _distinct_minima(workspace: Workspace, q: Array, frequency: Array) -> list[Array]:
    """Up to ``STARTS`` of the lowest poses that are a fifth of a joint range or more apart."""
    span = np.ptp(workspace.ranges, axis=1)
    lowest = q[np.argsort(frequency)[: max(200, len(q) // 20)]]
    chosen: list[Array] = []
    while len(lowest) > 0 and len(chosen) < STARTS:
        chosen.append(lowest[0])
        lowest = lowest[np.abs((lowest - lowest[0]) / span).max(axis=1) > 0.2]
    return chosen


def _descend(machine: Machine, workspace: Workspace, start: Array) -> Array | None:
    """Local minimum of the lowest frequency inside the workspace (SLSQP), or None where it leaves the workspace."""
    from scipy.optimize import minimize

    low, high = workspace.ranges.T
    span = high - low
    payload, nq = machine.payload, len(low)

    def value(x: Array) -> float:
        return float(lowest_frequency(machine.evaluate(machine.rigid_poses(low + x * span)))[0])

    def gradient(x: Array) -> Array:
        ends = np.clip(x + 1e-6 * np.concatenate([np.eye(nq), -np.eye(nq)]), 0.0, 1.0)
        f = lowest_frequency(machine.evaluate(machine.rigid_poses(low + ends * span)))
        return (f[:nq] - f[nq:]) / (ends[:nq] - ends[nq:]).diagonal()

    def room(x: Array) -> Array:
        rigid = machine.arm.kinematics((low + x * span)[None])
        stroke = workspace.machine.margins(rigid)[0] - workspace.end_margin
        tip = -machine.pitch_excess(rigid, payload) if payload.pitch else np.empty(0)
        return np.concatenate([stroke[[len(k.joints) > 1 for k in machine.drives]], tip])

    constrained = payload.pitch is not None or any(len(k.joints) > 1 for k in machine.linkages)
    result = minimize(
        value,
        (start - low) / span,
        jac=gradient,
        bounds=[(0.0, 1.0)] * nq,
        constraints=[{"type": "ineq", "fun": room}] if constrained else [],
        method="SLSQP",
        options={"maxiter": 60, "ftol": 1e-10},
    )
    return _inside(machine, workspace, np.clip(low + result.x * span, low, high))


def _inside(machine: Machine, workspace: Workspace, q: Array) -> Array | None:
    """The pose, put back exactly onto a pitch limit that it oversteps by a hair; None if it is not in the workspace."""
    rigid = machine.arm.kinematics(q[None])
    payload = machine.payload
    if not machine.holds(rigid)[0] and machine.pitch_excess(rigid, payload)[0] < 1e-3:
        moved = [
            onto_pitch_limit(machine, payload, q[None], joint, limit)
            for joint in tipping_joints(machine, payload)
            for limit in payload.pitch or ()
        ]
        near = [p for p in np.concatenate(moved) if np.abs(p - q).max() < 2e-3 and _in_box(p, workspace)]
        q = near[0] if near else q
    within = _in_box(q, workspace) and bool(machine.holds(q)[0])
    # ends of stroke are those of the machine whose workspace it is
    return q if within and workspace.machine.margins(q).min() >= workspace.end_margin - 1e-9 else None


def _in_box(q: Array, workspace: Workspace) -> bool:
    low, high = workspace.ranges.T
    return bool(np.all((q >= low) & (q <= high)))
