"""Reach maps: the lowest frequency at each place of the tool, whatever pose brings it there.

Between the poses of a joint grid, places and frequencies are interpolated; the lowest pose of each
cell is then computed. Were the frequency linear in the joints, its least over all poses with the
tool in a cell would be at a vertex: all joints but two at a limit, the tool on the cell's border.
So poses are taken where the surfaces of limits cross borders, the best of each cell is moved to
the cell's corners, poses inside the joint box and about the best are tried as well, and the tool
is led over the rim into cells of which it reaches but a corner. Where oil carries air, poses in
which it is softest are tried too, and all frequencies are computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, Flags, ReadOnly, chunks
from armdesign.frequency.cases import CasePoses, load_cases
from armdesign.frequency.joint_grid import default_counts, nearest, steps_along
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.reach_plane import place_and_pitch, places, reach_and_height
from armdesign.frequency.reach_rim import least_motion, led_into_cells, poses_over_rim
from armdesign.frequency.softest_poses import softest_poses
from armdesign.frequency.spread import (
    box_poses,
    joints_that_change_nothing,
    surfaces,
    tipping_joints,
    turned_onto_pitch_limits,
)
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes

CELLS = 90  # along the longer side
INSIDE = 20_000  # poses inside the joint box, half as many on its faces, edges and so on
VALUES = 40  # of both joints on a surface of limits
NEAR = 12  # random poses about the lowest of each cell,
WIDTHS = 0.6, 0.3, 0.15  # and how far from it, in steps between the poses inside
FEW = 5  # poses tried in a cell that is but a sliver,
ASTRAY = 4.0, 1.0, 0.3  # and how far astray from its lowest others are led back, in such steps
INEXACT = 0.01  # relative error of an interpolated frequency about which poses are computed
FAR = 1.15  # times a known frequency: what is found first is hardly 7 % above the lowest
CORNERS = (-1, -1), (-1, 1), (1, -1), (1, 1)
ASIDE = 0.01  # of a cell, distance of poses from its border
CORRECTIONS = 2  # on the way to a corner
SOFTEST = 4000  # of the poses inside from which those are sought where oil with air is softest,
BESIDE = 0.1  # and how far from the lowest of each cell, of the joints' ranges
DAMPING = 1e-12  # there, of squared slopes, or in m²
WHOLE = 1 - 1e-9  # of a cell: the longer side has one more than their number, however rounded
FINER = 2  # times as many poses in the default joint grid, from which it replaces a coarse one
EXACT = 20_000  # poses computed at most where nothing can be interpolated


@dataclass(frozen=True, eq=False)
class ReachMap(ReadOnly):
    """Lowest frequency at each place of the tool, as the user of a machine sees it.

    Attributes:
        reach: middles of the cells, from the root's z axis, forward positive (nx,) [m].
        height: middles of the cells (nz,) [m].
        frequency: least over all poses and load cases (nx, nz) [Hz]; NaN where no pose brings the
            tool.
    """

    __repr__ = short_repr

    reach: Array
    height: Array
    frequency: Array

    def plot(self, ax: Axes | None = None) -> Axes:
        """Lowest frequency by reach and height; returns the axes."""
        from armdesign import plots

        return plots.reach_map(self, ax)


def reach_map(cases: Sequence[CasePoses], points: Array, count: int | None = None) -> ReachMap:
    """The reach map of a machine, see ``FrequencyMap.reach_map``.

    Args:
        cases: the load cases over a workspace.
        points: reach, height, lowest frequency (n, 3) of their poses, one case after the other.
        count: number of cells along the longer side.
    """
    workspace = cases[0].workspace
    of_case = np.split(points, np.cumsum([case.exists.sum() for case in cases])[:-1])
    if workspace.kind == "sobol" or _coarse(workspace):  # a joint grid of its own
        grid = Workspace.grid(workspace.machine, end_margin=workspace.end_margin)
        cases = list(load_cases(cases[0].machine, grid))
        of_case = [_computed(case.machine, grid.q[case.exists]) for case in cases]
    known, between = np.concatenate([points, *of_case]), workspace.kind != "poses"
    if workspace.cells is not None:
        cells, between = workspace.cells, False
    else:
        few = CELLS if between else max(5, int((len(known) / 10) ** 0.5))
        # a size even where the tool does not move
        size = max(0.01, *np.ptp(known[:, :2], axis=0)) / (count or min(CELLS, few))
        reach, height = (np.arange(x.min(), x.max() + WHOLE * size, size) for x in known.T[:2])
        cells = reach, height
    least = np.full([len(axis) for axis in cells], np.inf)
    _lower(least, known, cells)
    pairs = zip(cases, of_case, strict=True)
    between = between and least.size > 1  # else the tool does not move
    for case, of_one in sorted(pairs, key=lambda pair: pair[1][:, 2].min()) if between else ():
        if (of_one[:, 2] < FAR * least.reshape(-1)[_cell(of_one, *cells)]).any():
            _lower(least, _Between(case, of_one).lowest(cells, least), cells)
    return ReachMap(*cells, np.where(np.isinf(least), np.nan, least))


def _coarse(workspace: Workspace) -> bool:
    """Whether it is a joint grid too coarse to interpolate on: the default one is finer by far."""
    nodes, default = math.prod(map(len, workspace.axes)), default_counts(workspace.machine)
    return workspace.kind == "grid" and FINER * nodes < math.prod(default)


def _lower(least: Array, points: Array, cells: tuple[Array, Array]) -> None:
    """Take the frequencies of points (reach, height, frequency) into those of cells (nx, nz)."""
    np.minimum.at(least.reshape(-1), _cell(points, *cells), points[:, 2])


class _Between:
    """A load case between the nodes of a joint grid.

    Args:
        case: the load case over the joint grid.
        points: reach, height and frequency (m, 3) at its poses.
    """

    def __init__(self, case: CasePoses, points: Array) -> None:
        self.case, self.machine, self.workspace = case, case.machine, case.workspace
        self.ranges = self.workspace.ranges
        self.nodes = self._at_nodes(points[:, 2])

    def lowest(self, cells: tuple[Array, Array], least: Array) -> Array:
        """Reach, height and frequency (n, 3) of the lowest pose of each cell that has any.

        Sought on interpolated frequencies; at the poses found they are computed.

        Args:
            cells: middles of the cells, along reach and along height [m].
            least: frequencies that are known in the cells (nx, nz) [Hz]: where this load case's
                are far above, no lower ones are sought.
        """
        fixed = joints_that_change_nothing(self.machine)
        inside = box_poses(self.ranges, fixed, INSIDE, INSIDE // 2)
        first = [inside, self._on_borders(cells)]
        if self.machine.fluid.aerated:
            some = inside[:: max(1, len(inside) // SOFTEST)]
            first.append(softest_poses(self.machine, self.ranges, some))
        q, points = self._tried(np.concatenate(first))
        tried = np.bincount(_cell(points, *cells), minlength=least.size)
        over = poses_over_rim(self.machine, self.ranges, q, points[:, :2], cells)
        q, points = self._lowest(cells, over, q, points)
        matters = points[:, 2] < FAR * least.reshape(-1)[_cell(points, *cells)]
        q, points = q[matters], points[matters]
        few = tried[_cell(points, *cells)] < FEW
        led = self._led_back(q[few], points[few], cells, ASTRAY)
        q, points = self._lowest(cells, led, q, points)
        for width in WIDTHS:
            q, points = self._lowest(cells, self._around(q, width), q, points)
            q, points = self._lowest(cells, self._to_corners(q, points, cells), q, points)
            if self.machine.fluid.aerated:
                soft = softest_poses(self.machine, self.ranges, q, BESIDE)
                q, points = self._lowest(cells, soft, q, points)
        if not self.machine.fluid.aerated:
            points = self._made_exact(q, points, cells)
        return points[np.isfinite(points[:, 2])]

    def _made_exact(self, q: Array, points: Array, cells: tuple[Array, Array]) -> Array:
        """Points (n, 3) with computed frequencies.

        Where these are far from the interpolated ones, poses about are computed as well.
        """
        exact = _computed(self.machine, q)
        off = np.abs(points[:, 2] - exact[:, 2]) > INEXACT * exact[:, 2]
        q, points = q[off], exact[off]
        for width in WIDTHS:
            led = self._led_back(q, points, cells, (width,))
            near, _ = self._tried(np.concatenate([led, self._to_corners(q, points, cells)]))
            points = np.concatenate([points, _computed(self.machine, near)])
            best = _lowest_of_cells(points, *cells)
            q, points = np.concatenate([q, near])[best], points[best]
        return np.concatenate([exact, points])

    def _tried(self, poses: Array) -> tuple[Array, Array]:
        """Poses at which the load case exists and their points; some are turned back for it."""
        q, points, beyond = self.at(poses)
        if len(beyond):
            others = self.at(self._turned_back(beyond))
            q, points = np.concatenate([q, others[0]]), np.concatenate([points, others[1]])
        return q, points

    def _lowest(
        self, cells: tuple[Array, Array], poses: Array, q: Array, points: Array
    ) -> tuple[Array, Array]:
        """The lowest pose of each cell and its point, among some poses and known ones."""
        tried = self._tried(poses)
        q, points = np.concatenate([q, tried[0]]), np.concatenate([points, tried[1]])
        best = _lowest_of_cells(points, *cells)
        return q[best], points[best]

    def _around(self, q: Array, width: float) -> Array:
        """Random poses about the poses (n, nq), within the joint ranges."""
        low, high = self.ranges.T
        share = width * INSIDE ** (-1 / len(low))
        random = np.random.default_rng(0).uniform(-1, 1, (NEAR, *q.shape))
        return np.clip(q + share * (high - low) * random, low, high).reshape(-1, len(low))

    def _led_back(
        self, q: Array, points: Array, cells: tuple[Array, Array], widths: Sequence[float]
    ) -> Array:
        """Random poses about poses (n, nq), led back to the cells of their points (n, 3)."""
        at = (nearest(axis, place) for axis, place in zip(cells, points.T, strict=False))
        middles = np.stack([axis[i] for axis, i in zip(cells, at, strict=True)], axis=1)
        starts = np.concatenate([self._around(q, width) for width in widths])
        goals = np.tile(middles, (NEAR * len(widths), 1))
        return led_into_cells(self.machine, self.ranges, starts, goals, cells)

    def _to_corners(self, q: Array, points: Array, cells: tuple[Array, Array]) -> Array:
        """Poses moved so that the tool is at the corners of its cell (Newton, slopes kept).

        Joints at an end stay there, and poses on a pitch limit stay on it. Where too few are left
        to bring the tool to a corner, one of those at an end leaves it, each in turn.
        """
        low, high = self.ranges.T
        size = np.array([axis[1] - axis[0] if len(axis) > 1 else 0.0 for axis in cells])
        middles = np.stack(
            [axis[nearest(axis, at)] for axis, at in zip(cells, points.T, strict=False)], axis=1
        )
        corners = middles[:, None] + (0.5 - ASIDE) * size * np.array(CORNERS)
        on_limit = np.abs(self._tip(q)) < 1e-6
        which, free = _freed((q > low) & (q < high), 2 + on_limit)
        q, corners, on_limit = q[which], corners[which], on_limit[which]
        moved = []
        for rows, held in ((~on_limit, None), (on_limit, self.machine.payload)):
            value, slope = place_and_pitch(self.machine, q[rows], held)
            room = ((high - low) * free[rows])[:, None]
            by_shares = slope * room
            damping = DAMPING * np.maximum(1.0, (by_shares**2).sum(axis=(1, 2)))
            each = np.eye(slope.shape[1])
            motion = room.swapaxes(1, 2) * least_motion(by_shares, each, damping)
            motion = np.repeat(motion, len(CORNERS), axis=0)
            goal, at = (np.repeat(each, len(CORNERS), axis=0) for each in (value, value))
            goal[:, :2] = corners[rows].reshape(-1, 2)
            there = np.repeat(q[rows], len(CORNERS), axis=0)
            for _ in range(CORRECTIONS):
                way = (motion @ (goal - at)[..., None])[..., 0]
                there = np.clip(there + way, low, high)
                at[:, :2] = reach_and_height(self.machine, there)
            moved.append(there)
        return np.concatenate(moved)

    def _on_borders(self, cells: tuple[Array, Array]) -> Array:
        """Poses (n, nq) on the surfaces of limits, the tool on either side of a cell's border.

        A cell of which such a surface cuts but a sliver off has a corner of the sliver among them.
        """
        parts = [np.empty((0, len(self.workspace.axes)))]
        for q in surfaces(self.machine, self.ranges, VALUES):
            place = reach_and_height(self.machine, q.reshape(-1, q.shape[2]))
            for number in steps_along(cells, place).reshape(2, VALUES, VALUES) + 0.5:
                for at, of_cell in ((q, number), (q.swapaxes(0, 1), number.T)):
                    parts.append(_crossings(at[:-1], at[1:], of_cell[:-1], of_cell[1:]))
        return np.concatenate(parts)

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """The poses (n, nq) at which the load case exists, their points (m, 3), the poses beyond.

        Frequencies are linear between the nodes, and computed where a box of the grid has corners
        out of stroke; all are where oil carries air, as nothing is linear in its valleys.
        """
        frequency = self._linear(self.nodes, q)
        near = np.isfinite(frequency)
        near[~near] = self._linear(np.isfinite(self.nodes), q[~near]) > 0
        q, frequency = q[near], frequency[near]
        place, exists = np.empty((len(q), 2)), np.empty(len(q), dtype=bool)
        for rows in chunks(len(q)):
            rigid = self.machine.arm.kinematics(q[rows])
            place[rows], exists[rows] = places(self.machine, rigid), self.case.exists_at(rigid)
        beyond = q[~exists & np.isfinite(frequency)]
        q, points = q[exists], np.column_stack([place, frequency])[exists]
        unknown = np.flatnonzero(np.isnan(points[:, 2]))
        unknown = unknown[:: 1 + len(unknown) // EXACT]
        if self.machine.fluid.aerated:
            unknown = np.arange(len(q))
        points[unknown] = _computed(self.machine, q[unknown])
        known = np.isfinite(points).all(axis=1)
        return q[known], points[known], beyond

    def _linear(self, nodes: Array | Flags, q: Array) -> Array:
        """Numbers at poses (n, nq) from those at the nodes (…): (n,); NaN beside one."""
        from scipy.ndimage import map_coordinates

        steps = steps_along(self.workspace.axes, q)
        return np.asarray(map_coordinates(nodes.astype(float), steps, order=1, mode="nearest"))

    def _at_nodes(self, known: Array) -> Array:
        """Frequencies at the nodes of the grid (…), also just beyond pitch limits.

        So boxes that a limit cuts are whole. NaN farther out, and out of stroke.
        """
        from scipy.ndimage import binary_dilation

        axes, case = self.workspace.axes, self.case
        steps = steps_along(axes, self.workspace.q[case.exists])
        is_node = np.abs(steps - np.rint(steps)).max(axis=0) < 1e-6
        nodes = np.full([len(axis) for axis in axes], np.nan)
        nodes[tuple(np.rint(steps[:, is_node]).astype(int))] = known[is_node]
        exists = np.isfinite(nodes)
        beside = np.nonzero(binary_dilation(exists, np.ones((3,) * nodes.ndim)) & ~exists)
        q = np.stack([axis[i] for axis, i in zip(axes, beside, strict=True)], axis=1)
        frequency = np.full(len(q), np.nan)
        free = self.workspace.in_stroke(q)
        frequency[free] = _computed(self.machine, q[free])[:, 2]
        nodes[beside] = frequency
        return nodes

    def _tip(self, q: Array) -> Array:
        """Angle by which the load case's link is tipped out of its pitch range (n,) [rad]."""
        return self.machine.pitch_excess(self.machine.arm.kinematics(q), self.machine.payload)

    def _turned_back(self, q: Array) -> Array:
        """Poses turned onto the pitch limits by the joint next to the load case's link."""
        payload = self.machine.payload
        joints = tipping_joints(self.machine, payload)
        if not joints:
            return q[:0]
        return turned_onto_pitch_limits(self.machine, payload, q, joints[-1], self.ranges)


def _computed(case: Machine, q: Array) -> Array:
    """Reach, height and lowest frequency (n, 3) at poses in stroke, beyond limits too.

    No frequency (NaN) where a cylinder is at its dead centre.
    """
    parts = [np.empty((0, 3))]
    for rows in chunks(len(q)) if len(q) else ():
        poses = case.evaluate(case.rigid_poses(q[rows]))
        places = case.heading.reach(poses.q, poses.tool), poses.tool[:, 2]
        frequency = np.full(len(poses.q), np.nan)
        stiff = np.isfinite(poses.stiffness_matrix).all(axis=(1, 2))
        if not stiff.all():
            poses = case.evaluate(case.rigid_poses(q[rows][stiff]))
        frequency[stiff] = lowest_frequency(poses) if stiff.any() else np.nan
        parts.append(np.column_stack([*places, frequency]))
    return np.concatenate(parts)


def _lowest_of_cells(points: Array, reach: Array, height: Array) -> Array:
    """Which of the points (reach, height, frequency) is the lowest of each cell that has any."""
    cell, count = _cell(points, reach, height), len(reach) * len(height)
    least, lowest = np.full(count, np.inf), np.full(count, -1)
    np.minimum.at(least, cell, points[:, 2])
    best = np.flatnonzero(points[:, 2] == least[cell])[::-1]
    lowest[cell[best]] = best  # of several that are as low the first remains
    return lowest[lowest >= 0]


def _cell(points: Array, reach: Array, height: Array) -> Array:
    """Number of the cell in which each of the points (reach, height, …) lies (n,)."""
    return nearest(reach, points[:, 0]) * len(height) + nearest(height, points[:, 1])


def _freed(free: Flags, needed: Array) -> tuple[Array, Flags]:
    """Indices of poses (m,) and which of their joints are free to move (m, nq).

    Every pose once with the joints that are ``free`` (n, nq); where these are fewer than
    ``needed`` (n,), again with each of its other joints.
    """
    few = free.sum(axis=1) < needed
    which, freed = [np.arange(len(free))], [free]
    for joint, own in enumerate(np.eye(free.shape[1], dtype=bool)):
        which.append(np.flatnonzero(few & ~free[:, joint]))
        freed.append(free[which[-1]] | own)
    return np.concatenate(which), np.concatenate(freed)


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
