"""Reach maps: the lowest frequency at each place of the tool, whatever pose brings it there.

Between the poses of a joint grid, places and frequencies are interpolated; the lowest pose of each
cell is then computed. Were the frequency linear in the joints, its least over all poses with the
tool in a cell would be at a vertex: all joints but two at a limit, the tool on the cell's border.
So poses are taken where the surfaces of limits cross borders, the best of each cell is moved to
the cell's corners, and poses inside the joint box and about the best are tried as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, Flags, chunks
from armdesign.frequency.joint_grid import nearest, steps_along
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.reach_plane import place_and_pitch, reach_and_height
from armdesign.frequency.spread import (
    box_poses,
    joints_without_effect,
    surfaces,
    tipping_joints,
    turned_onto_pitch_limits,
)
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine

CELLS = 90  # along the longer side
INSIDE = 40_000  # poses inside the joint box, half as many on its faces, edges and so on
VALUES = 40  # of both joints on a surface of limits
NEAR = 12  # random poses about the lowest of each cell,
WIDTHS = 0.6, 0.3  # and how far from it, in steps between the poses inside
CORNERS = (-1, -1), (-1, 1), (1, -1), (1, 1)
ASIDE = 0.01  # of a cell, distance of poses from its border
EXACT = 20_000  # poses computed at most where nothing can be interpolated


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

        Sought on interpolated values; its frequency is computed.
        """
        cells, ranges = (reach, height), self.workspace.ranges
        fixed = joints_without_effect(self.case)
        inside = box_poses(ranges, fixed, INSIDE, INSIDE // 2)
        q, points = self._lowest(cells, np.concatenate([inside, self._on_borders(cells)]))
        for width in WIDTHS:
            q, points = self._lowest(cells, self._around(q, width), q, points)
            q, points = self._lowest(cells, self._to_corners(q, cells), q, points)
        return np.column_stack([points[:, :2], self._computed(q)[:, 2]])

    def _lowest(
        self, cells: tuple[Array, Array], poses: Array, *known: Array
    ) -> tuple[Array, Array]:
        """The lowest pose of each cell and its point, among some poses and the known ones."""
        q, points, beyond = self.at(poses)
        turned, more, _ = self.at(self._turned_back(beyond))
        q = np.concatenate([*known[:1], q, turned])
        points = np.concatenate([*known[1:], points, more])
        best = _lowest_of_cells(points, *cells)
        return q[best], points[best]

    def _around(self, q: Array, width: float) -> Array:
        """Random poses about the poses (n, nq), within the joint ranges."""
        low, high = self.workspace.ranges.T
        share = width * INSIDE ** (-1 / len(low))
        random = np.random.default_rng(0).uniform(-1, 1, (NEAR, *q.shape))
        return np.clip(q + share * (high - low) * random, low, high).reshape(-1, len(low))

    def _to_corners(self, q: Array, cells: tuple[Array, Array]) -> Array:
        """Poses moved so that the tool is at the corners of its cell (linearised).

        Joints at an end stay there, and poses on a pitch limit stay on it.
        """
        low, high = self.workspace.ranges.T
        payload = self.case.payload
        on_limit = np.abs(self.case.pitch_excess(self.case.arm.kinematics(q), payload)) < 1e-6
        moved = []
        for rows, held in ((~on_limit, None), (on_limit, payload)):
            start = q[rows]
            value, slope = place_and_pitch(self.case, start, held)
            cell = steps_along(cells, value[:, :2]).T[:, None]
            step = [axis[1] - axis[0] if len(axis) > 1 else 0.0 for axis in cells]
            way = np.zeros((len(start), len(CORNERS), value.shape[1]))
            way[..., :2] = (np.rint(cell) + (0.5 - ASIDE) * np.array(CORNERS) - cell) * step
            room = ((high - low) * ((start > low) & (start < high)))[:, None]
            motion = np.linalg.pinv(slope * room, rcond=1e-6).swapaxes(1, 2) * room
            moved.append(np.clip(start[:, None] + way @ motion, low, high).reshape(-1, len(low)))
        return np.concatenate(moved)

    def _on_borders(self, cells: tuple[Array, Array]) -> Array:
        """Poses (n, nq) on the surfaces of limits, the tool on either side of a cell's border.

        A cell of which such a surface cuts but a sliver off has a corner of the sliver among them.
        """
        parts = [np.empty((0, len(self.workspace.axes)))]
        for q in surfaces(self.case, self.workspace.ranges, VALUES):
            place = reach_and_height(self.case, q.reshape(-1, q.shape[2]))
            for number in steps_along(cells, place).reshape(2, VALUES, VALUES) + 0.5:
                for at, of_cell in ((q, number), (q.swapaxes(0, 1), number.T)):
                    parts.append(_crossings(at[:-1], at[1:], of_cell[:-1], of_cell[1:]))
        return np.concatenate(parts)

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


def _crossings(start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
    """Poses a little before and after a coordinate crosses a whole number, from start to end.

    Linear between poses (…, nq) with the coordinate (…); none where it is NaN.
    """
    known = np.isfinite(at_start) & np.isfinite(at_end)
    start, end, at_start, at_end = start[known], end[known], at_start[known], at_end[known]
    first = np.ceil(np.minimum(at_start, at_end))
    count = (np.floor(np.maximum(at_start, at_end)) - first + 1).astype(int)
    edge = np.repeat(np.arange(len(count)), count)
    whole = first[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    run = (at_end - at_start)[edge]
    share = (whole + ASIDE * np.array([[-1], [1]]) - at_start[edge]) / np.where(run == 0, 1, run)
    share = np.clip(share, 0, 1).ravel()[:, None]
    edge = np.tile(edge, 2)
    return np.asarray(start[edge] + share * (end - start)[edge])
