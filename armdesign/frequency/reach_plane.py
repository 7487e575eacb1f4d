"""Poses that bring the tool exactly to the middles of square cells of the reach/height plane.

Reach is the distance of the tool from the root's z axis, forward positive; a posture is one of the
joint positions that bring the tool to a cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array, chunks
from armdesign.errors import ArmDesignError
from armdesign.frequency.joint_grid import Axes, steps_along
from armdesign.frequency.spread import edge_poses
from armdesign.machine import reaching
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine
from armdesign.mechanism.rigid_poses import RigidPoses

STARTS = 6  # per cell on each edge of the joint ranges


@dataclass(frozen=True, eq=False)
class _Squares:
    """Square cells of the plane: their lower left corner (2,) and size [m]."""

    origin: Array
    size: float

    def of(self, places: Array) -> Array:
        """Column and row (n, 2) of the cells in which places (n, 2) lie."""
        return np.floor((places - self.origin) / self.size)

    def middles(self, cell: Array) -> Array:
        """Middles (n, 2) of cells (n, 2)."""
        return self.origin + (cell + 0.5) * self.size


def poses_on_cells(
    machine: Machine, axes: Axes, grid: Array, weights: Array, count: int
) -> tuple[Array, Array, tuple[Array, Array]]:
    """Poses with the tool on a cell's middle: q (n, nq), weights (n,), and the cells' middles.

    Args:
        machine: today's machine.
        axes: of the joint grid.
        grid: poses of the joint grid (m, nq), from which the joints start.
        weights: how much of joint space each pose of the grid stands for (m,).
        count: number of cells along the longer side of the tool's reach.

    Raises:
        ArmDesignError: no pose brings the tool to a cell's middle.
    """
    ranges = np.array([[axis[0], axis[-1]] for axis in axes])
    places = reach_and_height(machine, grid)
    cells = _Squares(places.min(axis=0), np.ptp(places, axis=0).max() / count)
    starts, everywhere = cells.of(places), np.ones_like(grid)
    q, cell, which = _onto_middles(machine, ranges, cells, grid, starts, everywhere)
    if len(q) == 0:
        many = len(machine.joints) > 1
        remedy = "give more points or fewer cells" if many else "take a grid for one joint"
        fault = "no pose brings the tool to a cell's middle"
        raise ArmDesignError(f"{machine.name}: workspace", fault, remedy)
    first, posture = _postures(axes, q, cell)
    weights = np.bincount(posture, weights=weights[which])
    parts = [(q[first], cell[first])]
    for edge, payload in edge_poses(machine, ranges, STARTS * len(np.unique(cell, axis=0))):
        starts = cells.of(reach_and_height(machine, edge))
        chosen = np.sort(_postures(axes, edge, starts)[0])
        edge, starts = edge[chosen], starts[chosen]
        between_ends = ((edge > ranges[:, 0]) & (edge < ranges[:, 1])).astype(float)
        q, cell, _ = _onto_middles(machine, ranges, cells, edge, starts, between_ends, payload)
        first, _ = _postures(axes, q, cell)
        parts.append((q[first], cell[first]))
    q, cell = (np.concatenate(part) for part in zip(*parts, strict=True))
    weights = np.concatenate([weights, np.zeros(len(q) - len(weights))])
    numbers = (np.arange(count) + 0.5 for count in cell.max(axis=0) + 1)
    reach, height = (low + n * cells.size for low, n in zip(cells.origin, numbers, strict=True))
    return q, weights, (reach, height)


def reach_and_height(machine: Machine, q: Array) -> Array:
    """Reach and height of the tool (n, 2) [m]."""
    parts = [places(machine, machine.arm.kinematics(q[rows])) for rows in chunks(len(q))]
    return np.concatenate(parts)


def places(machine: Machine, rigid: RigidPoses) -> Array:
    """Reach and height of the tool (n, 2) [m] at poses with known kinematics."""
    tool = machine.arm.point(rigid, machine.tool.link, np.array(machine.tool.at))
    return np.stack([machine.heading.reach(rigid.q, tool), tool[:, 2]], axis=1)


def _postures(axes: Axes, q: Array, cell: Array) -> tuple[Array, Array]:
    """First pose of each posture, and the posture of each pose (n,).

    Postures differ in their cell or by half a step of the grid in some joint.
    """
    half_steps = np.rint(2 * steps_along(axes, q).T)
    _, first, posture = np.unique(
        np.concatenate([cell, half_steps], axis=1), axis=0, return_index=True, return_inverse=True
    )
    return first, posture.reshape(-1)


def _onto_middles(
    machine: Machine,
    ranges: Array,
    cells: _Squares,
    starts: Array,
    cell: Array,
    free: Array,
    payload: LoadCase | None = None,
) -> tuple[Array, Array, Array]:
    """Poses moved onto the middles of their cells: q (m, nq), cell (m, 2), index of start (m,).

    Joints take the smallest motion relative to their ranges (Gauss–Newton). Where ``free`` (n, nq)
    is 0 a joint stays, and with a ``payload`` the pitch of its link stays what it is.
    """
    low, high = ranges.T
    q = starts.copy()
    goal = place_and_pitch(machine, q, payload)[0]
    goal[:, :2] = cells.middles(cell)
    left = np.arange(len(q))
    for _ in range(12):
        value, slope = place_and_pitch(machine, q[left], payload)
        error = goal[left] - value
        room = ((high - low) * free[left])[:, None, :]
        motion = np.linalg.pinv(slope * room, rcond=1e-6) @ error[..., None]
        q[left] += room[:, 0] * motion[..., 0]
        left = left[np.abs(error).max(axis=1) > 1e-12]
    met = np.abs(place_and_pitch(machine, q, payload)[0] - goal).max(axis=1) < 1e-9
    met &= np.all((q >= low) & (q <= high), axis=1) & np.all(cell >= 0, axis=1)
    return q[met], cell[met], np.flatnonzero(met)


def place_and_pitch(machine: Machine, q: Array, payload: LoadCase | None) -> tuple[Array, Array]:
    """Reach, height [m] and with a payload its link's pitch [rad] (n, 2 or 3), and their slopes.

    The slopes by the joints are (n, 2 or 3, nq).
    """
    place, slope = place_and_slopes(machine, q)
    if payload is None or payload.link is None:
        return place, slope
    heading, rigid = machine.heading, machine.arm.kinematics(q)
    pitch = payload.limited_angle(heading, rigid)
    pitching = heading.pitch_slopes(rigid, payload.link, tuple(range(q.shape[1])))
    return np.column_stack([place, pitch]), np.concatenate([slope, pitching[:, None]], axis=1)


def place_and_slopes(machine: Machine, q: Array) -> tuple[Array, Array]:
    """Reach and height of the tool (n, 2) [m] and their slopes by the joints (n, 2, nq)."""
    return reaching.place_and_slopes(machine, machine.tool, tuple(range(q.shape[1])), q)
