"""Workspaces: sets of poses at which a machine is asked questions.

The edges belong to it, because there the worst poses lie: joint ranges end exactly where a
cylinder keeps its end margin, and poses exactly on the pitch limits of the load cases are added to
the grid.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from armdesign.arrays import Array, Flags, chunks, shown
from armdesign.errors import ArmDesignError
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.joint_ranges import over

POSES = 20_000  # of the default grid
KEPT = 200_000  # up to so many poses inertia and placements stay in memory: 120 MB
MOST = 5_000_000
MARGIN_TOLERANCE = 1e-9
# poses that `spread` takes on an edge of the joint box, and on its cuts with pitch limits
ON_EDGE = 4000
WAYS = 6  # starts per cell on each edge of the joint ranges


@dataclass(frozen=True, eq=False)
class Workspace:
    """Poses of a machine; make one with ``Workspace.grid``, ``sobol`` or ``reach_plane``.

    Attributes:
        q: joint positions (n, nq) [rad, m]; of a grid: last joint fastest, then the poses on pitch
            limits.
        axes: even values of each joint [rad, m]: the grid, or the cells of pictures.
        end_margin: share of its stroke that every cylinder keeps free at both ends.
        machine: the machine that the workspace was made for: today's.
        cells: of a reach plane: middles of its cells, reach and height [m].
        boxes: how much of joint space each pose stands for (n,), in boxes of its grid; zero for
            poses that were added because the worst lie there. One each if None.
    """

    q: Array
    axes: tuple[Array, ...]
    end_margin: float
    machine: Machine
    cells: tuple[Array, Array] | None = None
    boxes: Array | None = None

    @classmethod
    def grid(
        cls,
        machine: Machine,
        points: int | Sequence[int] | None = None,
        end_margin: float | None = None,
    ) -> Workspace:
        """Joint grid, ends included, with the poses on the load cases' pitch limits added.

        Args:
            machine: today's machine.
            points: number of values per joint, one for all or one each (≥ 2); default about 20 000
                poses, the last joint finest; of an idle joint (slewing that no cylinder spans)
                only middle and end.
            end_margin: share of the stroke, 0 ≤ … < 0.5; default: the machine's requirement.

        Raises:
            ArmDesignError: counts or margin that cannot be, or nothing left.
        """
        counts, margin = _counts(machine, points), _margin(machine, end_margin)
        ranges = machine.range_within(margin)
        if points is None:
            for j in machine.idle_joints:
                ranges[j, 0] = ranges[j].mean()
        axes = tuple(over(ends, count) for ends, count in zip(ranges, counts, strict=True))
        q = _mesh(axes)
        boxes = np.prod(_mesh(tuple(_widths(axis) for axis in axes)), axis=1)
        for payload in machine.payloads:
            for joint in tipping_joints(machine, payload):
                others = _mesh(
                    tuple(
                        axis if j != joint else axis[[len(axis) // 2]]
                        for j, axis in enumerate(axes)
                    )
                )
                q = np.concatenate([q, _on_pitch_limits(machine, payload, others, joint, axes)])
        return _of(machine, q, axes, margin, boxes)

    @classmethod
    def sobol(
        cls, machine: Machine, count: int, seed: int = 0, end_margin: float | None = None
    ) -> Workspace:
        """Quasi-random poses, which fill joint space more evenly per pose than a grid when there are many joints.

        To ``count`` poses inside come those on the edges, where the worst ones lie: the corners of
        the joint ranges, a sixteenth of ``count`` shared by their faces, and up to an eighth
        turned onto each pitch limit by each joint that can. The axes, cells of pictures only, are
        even.

        Args:
            machine: today's machine.
            count: number of poses inside, 1 to 5 million.
            seed: of the scrambling; equal seeds give equal poses.
            end_margin: share of the stroke, 0 ≤ … < 0.5; default: the machine's requirement.

        Raises:
            ArmDesignError: count, seed or margin that cannot be, or nothing left.
        """
        from scipy.stats import qmc

        if (
            isinstance(count, bool)
            or not isinstance(count, int | np.integer)
            or not 1 <= count <= MOST
        ):
            raise ArmDesignError(
                "count", f"{count!r} is not allowed", f"give a whole number from 1 to {MOST:,}"
            )
        if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
            raise ArmDesignError("seed", f"{seed!r} is not allowed", "give a whole number ≥ 0")
        margin, nq = _margin(machine, end_margin), len(machine.joints)
        low, high = machine.range_within(margin).T
        unit = qmc.Sobol(nq, rng=np.random.default_rng(seed)).random_base2(
            math.ceil(math.log2(count))
        )
        inside = low + unit[:count] * (high - low)
        bins = max(2, min(int((count / 16) ** (1 / min(nq, 2))), 60))
        axes = tuple(over(ends, bins) for ends in machine.range_within(margin))
        corners = _mesh(tuple(axis[[0, -1]] for axis in axes))
        share = -(-count // 16)
        faces = inside[:share].copy()
        which = np.arange(share) % (2 * nq)
        faces[np.arange(share), which // 2] = np.where(
            which % 2 == 0, low[which // 2], high[which // 2]
        )
        q = np.concatenate([inside, corners, faces])
        others = np.concatenate([inside[:share], corners, faces])
        for payload in machine.payloads:
            for joint in tipping_joints(machine, payload):
                q = np.concatenate([q, _on_pitch_limits(machine, payload, others, joint, axes)])
        return _of(machine, q, axes, margin, np.ones(count))

    @classmethod
    def reach_plane(
        cls,
        machine: Machine,
        cells: int = 40,
        points: int | Sequence[int] | None = None,
        end_margin: float | None = None,
    ) -> Workspace:
        """Poses that bring the tool exactly to the middles of square cells of the reach/height plane.

        Every pose of a joint grid is moved by the smallest joint motion (relative to the ranges)
        that puts the tool on the middle of its cell (Gauss–Newton); what is left are, for each
        cell, the ways to reach it that differ by more than half a step of the grid. Where more
        than two joints move the tool, those with joints at the ends of their ranges and with a
        load case on its pitch limits are added, for there the worst poses lie.

        Args:
            machine: today's machine, with two joints or more that move the tool in that plane.
            cells: number of cells along the longer side of the tool's reach, at least 2.
            points: of the joint grid, as in ``grid``.
            end_margin: share of the stroke, 0 ≤ … < 0.5; default: the machine's requirement.

        Raises:
            ArmDesignError: numbers that cannot be, or no pose that does.
        """
        if isinstance(cells, bool) or not isinstance(cells, int | np.integer) or cells < 2:
            raise ArmDesignError("cells", f"{cells!r} is not allowed", "give a whole number ≥ 2")
        grid = cls.grid(machine, points, end_margin)
        place, _ = _reach(machine, grid.q)
        origin, size = place.min(axis=0), np.ptp(place, axis=0).max() / cells
        q, cell, which = _onto_middles(grid, grid.q, origin, size)
        if len(q) == 0:
            remedy = (
                "give more points or fewer cells"
                if len(machine.joints) > 1
                else "take a grid for one joint"
            )
            raise ArmDesignError(
                f"{machine.name}: workspace", "no pose brings the tool to a cell's middle", remedy
            )
        first, way = _ways(grid, q, cell)
        boxes = np.bincount(way, weights=grid.weights[which])
        found = [(q[first], cell[first])]
        for starts, payload in _edges(grid, WAYS * len(np.unique(cell, axis=0))):
            q, cell, _ = _onto_middles(grid, starts, origin, size, payload)
            first, _ = _ways(grid, q, cell)
            found.append((q[first], cell[first]))
        q, cell = (np.concatenate(parts) for parts in zip(*found, strict=True))
        reach, height = (
            origin[i] + (np.arange(cell[:, i].max() + 1) + 0.5) * size for i in (0, 1)
        )
        return _of(machine, q, grid.axes, grid.end_margin, boxes, (reach, height))

    def __len__(self) -> int:
        return len(self.q)

    @property
    def weights(self) -> Array:
        """What each pose counts in percentiles and shares (n,): the joint boxes that it stands for."""
        return np.ones(len(self)) if self.boxes is None else self.boxes

    def index(self, q: Array) -> Array:
        """Where poses (n, nq) lie on the axes, in steps from their first values (nq, n)."""
        steps = [(axis[-1] - axis[0]) / (len(axis) - 1) or 1.0 for axis in self.axes]
        return np.stack([(q[:, j] - axis[0]) / steps[j] for j, axis in enumerate(self.axes)])

    def on_ends(self, q: Array) -> Flags:
        """Whether a joint that moves the tool in its plane is at an end of its range, at poses (n, nq): (n,)."""
        moving = [j for j in range(q.shape[1]) if j not in _still(self.machine)]
        low, high = self.ranges[moving].T
        return np.any((q[:, moving] == low) | (q[:, moving] == high), axis=1)

    def in_stroke(self, q: Array) -> Flags:
        """Whether every cylinder keeps the end margin at poses (n, nq) within the joint ranges (n,)."""
        if all(len(drive.joints) == 1 for drive in self.machine.drives):
            return np.ones(len(q), dtype=bool)
        least = [self.machine.margins(q[rows]).min(axis=1) for rows in chunks(len(q))]
        return np.concatenate(least) >= self.end_margin - MARGIN_TOLERANCE

    def allows(self, case: Machine, q: Array) -> Flags:
        """Whether poses (n, nq) within the joint ranges are in stroke and hold the load case at work (n,)."""
        held = [case.holds(case.arm.kinematics(q[rows])) for rows in chunks(len(q))]
        return np.concatenate(held) & self.in_stroke(q)

    @property
    def ranges(self) -> Array:
        """Ends of the grid (nq, 2) [rad, m]."""
        return np.array([[axis[0], axis[-1]] for axis in self.axes])

    @cached_property
    def rigid(self) -> RigidPoses:
        """The bare links at all poses: computed once, used for every design and payload."""
        return self.machine.rigid_poses(self.q)

    def parts(self, what: str = "poses") -> Iterator[tuple[slice, RigidPoses]]:
        """Chunks of the poses; ``what`` names them to those who wait.

        Of a large workspace none is kept in memory.
        """
        for rows in shown(chunks(len(self)), len(self), what):
            yield (
                rows,
                self.rigid[rows] if len(self) <= KEPT else self.machine.rigid_poses(self.q[rows]),
            )

    def holds(self, payload: LoadCase) -> Flags:
        """Whether a load case exists at each pose (n,)."""
        arm, machine = self.machine.arm, self.machine
        if payload.pitch is None:
            return np.ones(len(self), dtype=bool)
        if len(self) <= KEPT:
            return machine.holds(self.rigid, payload)
        return np.concatenate(
            [machine.holds(arm.kinematics(self.q[rows]), payload) for rows in chunks(len(self))]
        )


def _of(
    machine: Machine,
    q: Array,
    axes: tuple[Array, ...],
    end_margin: float,
    boxes: Array,
    cells: tuple[Array, Array] | None = None,
) -> Workspace:
    """Those of the poses at which every cylinder keeps its end margin.

    Poses after the ``boxes`` stand for none.
    """
    least = [machine.margins(q[rows]).min(axis=1) for rows in chunks(len(q))]
    inside = np.concatenate(least) >= end_margin - MARGIN_TOLERANCE
    boxes = np.concatenate([boxes, np.zeros(len(q) - len(boxes))])[inside]
    q = q[inside]
    if len(q) == 0:
        raise ArmDesignError(
            f"{machine.name}: workspace", "no pose of it is in stroke", "give more points"
        )
    for values in (q, boxes):
        values.setflags(write=False)
    return Workspace(q, axes, end_margin, machine, cells, boxes)


def _widths(axis: Array) -> Array:
    """How much of its range each of even values stands for, in steps: one, half a step at the ends."""
    return np.where((np.arange(len(axis)) % (len(axis) - 1)) == 0, 0.5, 1.0)


def _mesh(axes: tuple[Array, ...]) -> Array:
    """All combinations of the axes' values (n, nq), last axis fastest."""
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _margin(machine: Machine, end_margin: float | None) -> float:
    margin = machine.section.requirements.end_margin if end_margin is None else end_margin
    if (
        isinstance(margin, bool)
        or not isinstance(margin, int | float | np.number)
        or not 0 <= margin < 0.5
    ):
        raise ArmDesignError(
            "end_margin", f"{margin!r} is not allowed", "give a share of the stroke in [0, 0.5)"
        )
    return margin


def _counts(machine: Machine, points: int | Sequence[int] | None) -> list[int]:
    nq, idle = len(machine.joints), machine.idle_joints
    if points is None:
        base = max(min(int((POSES / 1.5) ** (1 / max(nq - len(idle), 1))), 240), 5)
        return [2 if j in idle else base for j in range(nq - 1)] + [3 * base // 2]
    each = (
        list(points)
        if isinstance(points, Sequence | np.ndarray) and not isinstance(points, str)
        else [points] * nq
    )
    whole = all(isinstance(n, int | np.integer) and not isinstance(n, bool) for n in each)
    counts = [int(n) for n in each] if whole else []
    if len(counts) != nq or min(counts) < 2:
        raise ArmDesignError(
            "points", f"{points} is not allowed", f"give one number ≥ 2, or {nq} (one per joint)"
        )
    if math.prod(counts) > MOST:
        raise ArmDesignError(
            "points",
            f"{math.prod(counts):,} poses are too many",
            f"give at most {MOST // 10**6} million in all",
        )
    return counts


def _on_pitch_limits(
    machine: Machine, payload: LoadCase, others: Array, joint: int, axes: tuple[Array, ...]
) -> Array:
    """Poses with a joint turned until a load case's link is on its pitch limits, the other joints as given.

    So the corners, where a pitch limit meets the ends of all other joints, are among them if they
    are among those.
    """
    found = [np.empty((0, len(axes)))]
    for limit in payload.pitch or ():
        for rows in chunks(len(others)):
            q = onto_pitch_limit(machine, payload, others[rows], joint, limit)
            found.append(q[(q[:, joint] >= axes[joint][0]) & (q[:, joint] <= axes[joint][-1])])
    return np.concatenate(found)


def spread(case: Machine, workspace: Workspace, count: int) -> Array:
    """Poses (n, nq) spread over the joint box, denser on its faces and edges, and over the pitch limits within it.

    ``count`` of them inside. Of joints that change neither frequency nor reach one value is taken.
    """
    ranges, still = workspace.ranges, _still(case)
    parts = [_spread(ranges, still, count, count * 3 // 4, ON_EDGE)]
    joints = tipping_joints(case, case.payload) if case.payload.pitch else []
    for joint in joints:
        inside = count // 10 if joint == joints[-1] else 0
        others = _spread(ranges, still | {joint}, inside, count // 6, ON_EDGE)
        parts.append(_on_pitch_limits(case, case.payload, others, joint, workspace.axes))
    return np.concatenate(parts)


def _still(machine: Machine) -> set[int]:
    """Joints that change neither a frequency nor the tool's reach: idle ones about the root's z axis."""
    feet = machine.arm.kinematics(np.zeros((1, len(machine.joints)))).translation[0, :, :2]
    return {j for j in machine.idle_joints if np.hypot(*feet[j]) < 1e-9}


def tipped(case: Machine, workspace: Workspace, q: Array) -> Array:
    """Poses (n, nq) turned onto the pitch limits of the load case at work by the joint next to its link."""
    joints = tipping_joints(case, case.payload) if case.payload.pitch else []
    return _on_pitch_limits(case, case.payload, q, joints[-1], workspace.axes) if joints else q[:0]


def _spread(
    ranges: Array, still: Collection[int], inside: int, faces: int, on_edge: int = 1000
) -> Array:
    """Poses inside the joint box, and ``faces`` on its faces, as many on its edges, and so on.

    ``still`` at one end.

    An edge has up to ``on_edge``.
    """
    parts, moving = [np.empty((0, len(ranges)))], len(ranges) - len(still)
    for ends in product(*((0,) if j in still else (0, 1, None) for j in range(len(ranges)))):
        inner = ends.count(None)
        alike = math.comb(moving, inner) * 2 ** (moving - inner)
        each = inside if inner == moving else min(faces / alike, on_edge**inner)
        values = max(int(each ** (1 / max(inner, 1))), 2)
        if each > 0:
            lines = (
                over(r, values) if end is None else r[[end]]
                for r, end in zip(ranges, ends, strict=True)
            )
            parts.append(_mesh(tuple(lines)))
    return np.concatenate(parts)


def _edges(grid: Workspace, count: int) -> Iterator[tuple[Array, LoadCase | None]]:
    """Poses on the ends of joint ranges, and those turned onto pitch limits with the load case whose limits they are.

    ``count`` for each combination of ends; none where two joints or fewer move the tool.
    """
    machine, ranges = grid.machine, grid.ranges
    still = _still(machine)
    moving = len(ranges) - len(still)
    if moving < 3:
        return
    alike = max(math.comb(moving, inner) * 2 ** (moving - inner) for inner in range(2, moving))
    yield _spread(ranges, still, 0, count * alike), None
    for payload in machine.payloads:
        joints = tipping_joints(machine, payload) if payload.pitch else []
        for joint in joints if moving > 3 else joints[-1:]:
            others = _spread(
                ranges, still | {joint}, count if joint == joints[-1] else 0, count * (moving > 3)
            )
            yield _on_pitch_limits(machine, payload, others, joint, grid.axes), payload


def _ways(grid: Workspace, q: Array, cell: Array) -> tuple[Array, Array]:
    """First pose of each way to reach a cell, ways half a step of the grid apart.

    And the way of each pose.
    """
    where = np.rint(2 * grid.index(q).T)
    _, first, way = np.unique(
        np.concatenate([cell, where], axis=1), axis=0, return_index=True, return_inverse=True
    )
    return first, way.reshape(-1)


def _onto_middles(
    grid: Workspace, starts: Array, origin: Array, size: float, payload: LoadCase | None = None
) -> tuple[Array, Array, Array]:
    """Poses moved so that the tool is on the middle of its cell: q (n, nq), cell (n, 2), and which of ``starts``.

    By the smallest joint motion, relative to the ranges (Gauss–Newton). Joints at an end of their
    range stay there, and with a ``payload`` the pitch of its link stays what it is. Starts but for
    the grid's own, one for each way.
    """
    machine, (low, high) = grid.machine, grid.ranges.T
    cell = np.floor((_reach(machine, starts)[0] - origin) / size)
    own = starts is grid.q
    which = np.arange(len(starts)) if own else np.sort(_ways(grid, starts, cell)[0])
    q, cell = starts[which].copy(), cell[which]
    free = np.ones_like(q) if own else ((q > low) & (q < high)).astype(float)
    goal = _place(machine, q, payload)[0]
    goal[:, :2] = origin + (cell + 0.5) * size
    left = np.arange(len(q))
    for _ in range(12):
        place, slope = _place(machine, q[left], payload)
        error = goal[left] - place
        room = ((high - low) * free[left])[:, None, :]
        q[left] += (
            room[:, 0] * (np.linalg.pinv(slope * room, rcond=1e-6) @ error[..., None])[..., 0]
        )
        left = left[np.abs(error).max(axis=1) > 1e-12]
    met = np.abs(_place(machine, q, payload)[0] - goal).max(axis=1) < 1e-9
    met &= np.all((q >= low) & (q <= high), axis=1) & np.all(cell >= 0, axis=1)
    return q[met], cell[met], which[met]


def place(machine: Machine, q: Array) -> Array:
    """Reach and height of the tool (n, 2) [m]."""
    arm, found = machine.arm, [np.empty((0, 2))]
    for rows in chunks(len(q)):
        tool = arm.point(arm.kinematics(q[rows]), machine.tool.link, np.array(machine.tool.at))
        found.append(np.stack([arm.reach(q[rows], tool), tool[:, 2]], axis=1))
    return np.concatenate(found)


def _place(machine: Machine, q: Array, payload: LoadCase | None) -> tuple[Array, Array]:
    """Reach, height [m] and with a payload pitch [rad] of its link (n, 2 or 3), and the derivatives (n, 2 or 3, nq)."""
    place, slope = _reach(machine, q)
    if payload is None or payload.link is None:
        return place, slope
    arm, link, step = machine.arm, payload.link, 1e-6
    pitch = arm.pitch(arm.kinematics(q), link)
    ahead = [arm.pitch(arm.kinematics(q + step * one), link) for one in np.eye(q.shape[1])]
    slopes = np.stack([_wrapped(turned - pitch) / step for turned in ahead], axis=1)
    return np.concatenate([place, pitch[:, None]], axis=1), np.concatenate(
        [slope, slopes[:, None]], axis=1
    )


def _reach(machine: Machine, q: Array) -> tuple[Array, Array]:
    """Reach and height of the tool (n, 2) [m] and their derivatives by the joints (n, 2, nq)."""
    arm, joints = machine.arm, tuple(range(q.shape[1]))
    parts = []
    for rows in chunks(len(q)):
        tool = arm.motion(
            arm.kinematics(q[rows]), machine.tool.link, np.array(machine.tool.at), arm.root, joints
        )
        parts.append(arm.reach_and_height(q[rows], tool))
    return np.concatenate([place for place, _ in parts]), np.concatenate(
        [slope for _, slope in parts]
    )


def tipping_joints(machine: Machine, payload: LoadCase) -> list[int]:
    """Revolute joints between the root and a load case's link, root first."""
    chain = machine.arm.chain(payload.link) if payload.link else ()
    return [j for j in chain if machine.arm.joints[j].revolute and j not in machine.arm.slewing]


def onto_pitch_limit(
    machine: Machine, payload: LoadCase, q: Array, joint: int, limit: float
) -> Array:
    """The poses with ``joint`` turned until the link's pitch is ``limit`` [rad] (Newton).

    Those that can be.
    """
    assert payload.link is not None
    q = q.copy()
    step = np.zeros(q.shape[1])
    step[joint] = 0.1
    turns = np.ones(len(q), dtype=bool)
    for _ in range(8):
        pitch = machine.arm.pitch(machine.arm.kinematics(q), payload.link)
        error = _wrapped(limit - pitch)
        if np.abs(error[turns]).max(initial=0.0) < 1e-13:
            break
        slope = (
            _wrapped(machine.arm.pitch(machine.arm.kinematics(q + step), payload.link) - pitch)
            / 0.1
        )
        turns = np.abs(slope) > 0.1
        q[:, joint] += error / np.where(turns, slope, np.inf)
    return q[np.abs(error) < 1e-10]


def nearest(axis: Array, values: Array) -> Array:
    """Index of the even axis value next to each value."""
    step = (axis[-1] - axis[0]) / max(len(axis) - 1, 1) or 1.0
    return np.clip(np.rint((values - axis[0]) / step).astype(int), 0, len(axis) - 1)


def _wrapped(angle: Array) -> Array:
    return np.asarray(np.arctan2(np.sin(angle), np.cos(angle)))
