"""Reach maps: the lowest frequency at each place of the tool, whatever pose brings it there.

Between the poses of a joint grid, places and frequencies are interpolated; the lowest pose of each
cell is then computed. Poses are spread up to the ends of the joint ranges and to the pitch limits,
and once more about the lowest of each cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, Flags, chunks
from armdesign.frequency.joint_grid import nearest, steps_along
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.pitch_limits import tipping_joints, turned_onto_pitch_limits
from armdesign.frequency.reach_plane import reach_and_height
from armdesign.frequency.spread import joints_without_effect, spread
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine

CELLS = 90  # along the longer side
SPREAD = 100_000  # poses inside the joint box
NEAR = 24  # more of them about the lowest of each cell, twice
EXACT = 20_000  # of them at most where nothing can be interpolated


@dataclass(frozen=True, eq=False)
class ReachMap:
    """What the user of a machine sees: the lowest frequency at each place of the tool.

    Attributes:
        reach: middles of the cells, from the root's z axis, forward positive (nx,) [m].
        height: middles of the cells (nz,) [m].
        frequency: least over all poses and load cases (nx, nz) [Hz]; NaN where no pose brings the
            tool.
    """

    reach: Array
    height: Array
    frequency: Array


def reach_map(
    machine: Machine,
    workspace: Workspace,
    rows: Mapping[str, tuple[Array, Array]],
    cells: int | None = None,
) -> ReachMap:
    """The reach map of a machine, see ``FrequencyMap.reach_map``.

    Args:
        machine: the machine.
        workspace: the poses.
        rows: by load case its poses q (n, nq) and their points: reach, height, lowest frequency
            (n, 3).
        cells: number of cells along the longer side.
    """
    points = [of_case for _, of_case in rows.values()]
    known = np.concatenate(points)
    if workspace.cells is not None:
        reach, height = workspace.cells
    else:
        grids = {
            name: grid
            for name, of_case in rows.items()
            if (grid := _on_grid(workspace, *of_case)) is not None
        }
        few = CELLS if grids else max(5, int((len(known) / 10) ** 0.5))
        # a size even where the tool does not move
        size = max(0.01, *np.ptp(known[:, :2], axis=0)) / (cells or min(CELLS, few))
        reach, height = (np.arange(x.min(), x.max() + size, size) for x in known.T[:2])
        for name, grid in grids.items():
            between = _Between(machine.with_payload(name), workspace, grid)
            lowest = between.lowest(reach, height)
            lowest[:, 2] = np.maximum(lowest[:, 2], known[:, 2].min())
            points.append(lowest)
    x, z, frequency = np.concatenate(points).T
    least = np.full((len(reach), len(height)), np.inf)
    np.minimum.at(least, (nearest(reach, x), nearest(height, z)), frequency)
    return ReachMap(reach, height, np.where(np.isinf(least), np.nan, least))


def _on_grid(workspace: Workspace, q: Array, points: Array) -> Array | None:
    """The points of poses that are nodes of the joint grid (3, …), NaN at all other nodes.

    None if the poses are no grid.
    """
    steps = steps_along(workspace.axes, q)
    is_node = np.abs(steps - np.rint(steps)).max(axis=0) < 1e-6
    if is_node.sum() < 2 ** len(workspace.axes):
        return None
    nodes = np.full((3, *(len(axis) for axis in workspace.axes)), np.nan)
    nodes[:, *np.rint(steps[:, is_node]).astype(int)] = points[is_node].T
    return nodes


class _Between:
    """A load case between the nodes of a joint grid.

    Args:
        case: the machine with the load case at work.
        workspace: the joint grid.
        nodes: reach, height and frequency (3, …) at its nodes; NaN where the load case does not
            exist.
    """

    def __init__(self, case: Machine, workspace: Workspace, nodes: Array) -> None:
        self.case, self.workspace = case, workspace
        self.exists = np.isfinite(nodes[2])
        self.nodes = self._beyond_limits(nodes)

    def lowest(self, reach: Array, height: Array) -> Array:
        """Reach, height and frequency (n, 3) of the lowest pose of each cell that has any.

        Sought on interpolated values, most densely about the lowest; its frequency is computed.
        """
        low, high = self.workspace.ranges.T
        q, points, _ = self.at(spread(self.case, self.workspace.ranges, SPREAD))
        random = np.random.default_rng(0)
        for width in SPREAD ** (-1 / len(low)) * np.array([1.0, 0.4]):
            best = q[_lowest_of_cells(points, reach, height)]
            around = best + width * (high - low) * random.uniform(-1, 1, (NEAR, *best.shape))
            near, found, beyond = self.at(np.clip(around.reshape(-1, len(low)), low, high))
            turned, more, _ = self.at(self._turned_back(beyond))
            q, points = np.concatenate([q, near, turned]), np.concatenate([points, found, more])
        best = _lowest_of_cells(points, reach, height)
        return np.column_stack([points[best, :2], self._computed(q[best])[:, 2]])

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """The poses (n, nq) at which the load case exists, their points (m, 3), the poses beyond.

        Points are linear between the nodes, and computed where a box of the grid has corners out
        of stroke.
        """
        from scipy.ndimage import map_coordinates

        def linear(layer: Array, q: Array) -> Array:
            steps = steps_along(self.workspace.axes, q)
            return np.asarray(map_coordinates(layer, steps, order=1, mode="nearest"))

        inside = linear(self.exists.astype(float), q)
        cut = np.flatnonzero((inside > 0) & (inside < 1 - 1e-9))
        inside[cut] = self._allowed(q[cut])
        beyond, q = q[cut[inside[cut] == 0]], q[inside > 0]
        points = np.stack([linear(layer, q) for layer in self.nodes], axis=1)
        on_end = self._on_joint_end(q)  # whose arcs, not their chords, are the rim of the reach
        points[on_end, :2] = reach_and_height(self.case, q[on_end])
        unknown = np.flatnonzero(np.isnan(points[:, 2]))
        unknown = unknown[:: 1 + len(unknown) // EXACT]
        points[unknown] = self._computed(q[unknown])
        known = np.isfinite(points).all(axis=1)
        return q[known], points[known], beyond

    def _beyond_limits(self, nodes: Array) -> Array:
        """The nodes, also just beyond pitch limits, so that boxes which a limit cuts are whole."""
        from scipy.ndimage import binary_dilation

        beside = binary_dilation(self.exists, np.ones((3,) * self.exists.ndim)) & ~self.exists
        axes, index = self.workspace.axes, np.nonzero(beside)
        q = np.stack([axis[i] for axis, i in zip(axes, index, strict=True)], axis=1)
        points = np.full((len(q), 3), np.nan)
        free = self.workspace.in_stroke(q)
        points[free] = self._computed(q[free])
        nodes = nodes.copy()
        nodes[:, beside] = points.T
        return nodes

    def _allowed(self, q: Array) -> Flags:
        """Whether the load case exists and all cylinders are in stroke, at poses (n, nq): (n,)."""
        case = self.case
        holds = [case.holds(case.arm.kinematics(q[rows])) for rows in chunks(len(q))]
        return np.concatenate(holds) & self.workspace.in_stroke(q)

    def _on_joint_end(self, q: Array) -> Flags:
        """Whether a joint that moves the tool in its plane is at an end of its range (n,)."""
        fixed = joints_without_effect(self.workspace.machine)
        moving = [j for j in range(q.shape[1]) if j not in fixed]
        low, high = self.workspace.ranges[moving].T
        return np.any((q[:, moving] == low) | (q[:, moving] == high), axis=1)

    def _turned_back(self, q: Array) -> Array:
        """Poses turned onto the pitch limits by the joint next to the load case's link."""
        payload = self.case.payload
        joints = tipping_joints(self.case, payload)
        if not joints:
            return q[:0]
        return turned_onto_pitch_limits(self.case, payload, q, joints[-1], self.workspace.ranges)

    def _computed(self, q: Array) -> Array:
        """Reach, height and lowest frequency (n, 3) at poses in stroke, beyond limits too."""
        parts = [np.empty((0, 3))]
        for rows in chunks(len(q)):
            poses = self.case.evaluate(self.case.rigid_poses(q[rows]))
            reach = self.case.arm.reach(poses.q, poses.tool)
            parts.append(np.stack([reach, poses.tool[:, 2], lowest_frequency(poses)], axis=1))
        return np.concatenate(parts)


def _lowest_of_cells(points: Array, reach: Array, height: Array) -> Array:
    """Which of the points (reach, height, frequency) is the lowest of each cell that has any."""
    cell = nearest(reach, points[:, 0]) * len(height) + nearest(height, points[:, 1])
    order = np.lexsort((points[:, 2], cell))
    return np.asarray(order[np.unique(cell[order], return_index=True)[1]])
