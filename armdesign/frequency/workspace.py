"""Workspaces: the poses of a machine over which frequencies are asked for.

The edges belong to it, because there the worst poses lie: joint ranges end exactly where a
cylinder keeps its end margin, and poses exactly on the pitch limits of the load cases are added to
the grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np

from armdesign.arguments import checked, refuse_unless_seed
from armdesign.arrays import Array, Flags, ReadOnly, chunks, mesh, sobol
from armdesign.errors import ArmDesignError
from armdesign.frequency.joint_grid import MOST, Axes, box_shares, joint_axes
from armdesign.frequency.reach_plane import poses_on_cells
from armdesign.frequency.spread import tipping_joints, turned_onto_pitch_limits
from armdesign.journal.keys import digest
from armdesign.machine.load_case import LoadCase
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import never_within, over
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.progress import with_bar
from armdesign.short_repr import short_repr
from armdesign.threads import in_threads, thread_chunks

KEPT = 200_000  # up to so many poses inertia and placements stay in memory: 120 MB
REFUSED = 2_000  # poses that a refusal looks at
MARGIN_TOLERANCE = 1e-9

T = TypeVar("T")
Kind = Literal["grid", "sobol", "reach plane", "poses"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Workspace(ReadOnly):
    """Poses of a machine; make one with ``Workspace.grid``, ``sobol`` or ``reach_plane``.

    Attributes:
        q: joint positions (n, nq) [rad, m]; of a grid: last joint fastest, then the poses on pitch
            limits.
        weights: how much of joint space each pose stands for (n,), in boxes of its grid; what it
            counts in percentiles and shares. Zero for poses that were added because the worst lie
            there.
        axes: even values of each joint [rad, m]: the grid, or the cells of pictures.
        end_margin: share of its stroke that every cylinder keeps free at both ends.
        machine: the machine that the workspace was made for: today's. Its links and end stops
            are those of the poses; see ``on`` for machines with other links.
        kind: how its poses were chosen; "poses": one by one.
        cells: of a reach plane: middles of its cells, reach and height [m].
    """

    __repr__ = short_repr

    q: Array
    weights: Array
    axes: Axes
    end_margin: float
    machine: Machine
    kind: Kind = "poses"
    cells: tuple[Array, Array] | None = None

    @classmethod
    @checked
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
                poses, the last joint finest; of one without effect (slewing that no cylinder
                spans) only middle and end.
            end_margin: share of the stroke, 0 ≤ … < 0.5; default: the machine's requirement.

        Raises:
            ArmDesignError: counts or margin that cannot be, or nothing left.

        Example:
            >>> import armdesign as ad
            >>> machine = ad.load("paper_1dof")
            >>> workspace = ad.Workspace.grid(machine, points=5)
            >>> print(workspace.q.shape, (workspace.q[:, 0] / ad.units.deg).round())
            (5, 1) [-47. -26.  -5.  16.  37.]
        """
        margin = _checked_margin(machine, end_margin)
        axes = joint_axes(machine, points, margin)
        ranges = np.array([axis[[0, -1]] for axis in axes])

        def others(joint: int) -> Array:
            """All combinations of the other joints' values."""
            one_value = axes[joint][[len(axes[joint]) // 2]]
            return mesh((*axes[:joint], one_value, *axes[joint + 1 :]))

        parts = [mesh(axes), *_on_pitch_limits(machine, ranges, others)]
        return _in_stroke(machine, np.concatenate(parts), box_shares(axes), axes, margin, "grid")

    @classmethod
    def sobol(
        cls, machine: Machine, count: int, seed: int = 0, end_margin: float | None = None
    ) -> Workspace:
        """Quasi-random poses, which fill the space of many joints more evenly than a grid.

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
        _check_sobol(count, seed)
        margin, nq = _checked_margin(machine, end_margin), len(machine.joints)
        ranges = machine.range_within(margin)
        low, high = ranges.T
        inside = low + sobol(nq, count, seed) * (high - low)
        share = -(-count // 16)
        faces, row = inside[:share].copy(), np.arange(share)
        ended = row % (2 * nq) // 2  # the joint that is at an end
        faces[row, ended] = ranges[ended, row % 2]
        edges = np.concatenate([mesh(ranges), faces])
        others = np.concatenate([inside[:share], edges])
        parts = [inside, edges, *_on_pitch_limits(machine, ranges, lambda _: others)]
        bins = max(2, min(int((count / 16) ** (1 / min(nq, 2))), 60))
        axes = tuple(over(ends, bins) for ends in ranges)
        return _in_stroke(machine, np.concatenate(parts), np.ones(count), axes, margin, "sobol")

    @classmethod
    def reach_plane(
        cls,
        machine: Machine,
        cells: int = 40,
        points: int | Sequence[int] | None = None,
        end_margin: float | None = None,
    ) -> Workspace:
        """Poses that bring the tool to the middles of square cells of the reach/height plane.

        Every pose of a joint grid is moved by the smallest joint motion (relative to the ranges)
        that puts the tool on the middle of its cell (Gauss–Newton); of each cell the postures are
        kept that differ by half a step of the grid. Where more than two joints move the tool,
        poses with joints at the ends of their ranges and with a load case on its pitch limits are
        added, because the worst poses lie there.

        Args:
            machine: today's machine, with two joints or more that move the tool in that plane.
            cells: number of cells along the longer side of the tool's reach, at least 2.
            points: of the joint grid, as in ``grid``.
            end_margin: share of the stroke, 0 ≤ … < 0.5; default: the machine's requirement.

        Raises:
            ArmDesignError: numbers that cannot be, or no pose that does.
        """
        if not (_whole(cells) and cells >= 2):
            raise ArmDesignError("cells", f"{cells!r} is not allowed", "give a whole number ≥ 2")
        grid = cls.grid(machine, points, end_margin)
        q, weights, middles = poses_on_cells(machine, grid.axes, grid.q, grid.weights, cells)
        return _in_stroke(machine, q, weights, grid.axes, grid.end_margin, "reach plane", middles)

    def __len__(self) -> int:
        return len(self.q)

    def refuse_other_joints(self, machine: Machine) -> None:
        """Raise for a machine that has not the joints of the poses.

        Raises:
            ArmDesignError: with the joints of both.
        """
        if machine.joints != self.machine.joints:
            own, others = (", ".join(one.joints) for one in (machine, self.machine))
            fault = f"its poses are of {others} of {self.machine.name}, {machine.name} has {own}"
            raise ArmDesignError("workspace", fault, "make one of this machine")

    def on(self, machine: Machine) -> Workspace:
        """The poses with the links of a machine: this workspace where its own are the same.

        With other links joint positions, weights and axes stay; inertia, placements and end stops
        are those of the machine. The last one made is remembered, for all machines of its links.

        Raises:
            ArmDesignError: the machine has other joints.
        """
        last: Workspace | None = vars(self).get("_last_other")
        for known in (self, last):
            if known is not None and known.machine.arm.moves_like(machine.arm):
                return known
        self.refuse_other_joints(machine)
        other = vars(self)["_last_other"] = replace(self, machine=machine)
        return other

    def suits(self, other: Machine) -> bool:
        """Whether another machine has the same links and can take all the poses."""
        same = self.machine.arm.moves_like(other.arm)
        return same and bool(_least_margin(other, self.q).min() >= 0)

    def subset(self, rows: Array) -> Workspace:
        """Some of the poses, each of weight one."""
        q, weights = self.q[rows], np.ones(len(rows))
        return replace(self, q=q, weights=weights, kind="poses", cells=None)

    def in_stroke(self, q: Array) -> Flags:
        """Whether every cylinder keeps the end margin (n,), at poses (n, nq) within the ranges."""
        if all(len(drive.joints) == 1 for drive in self.machine.drives):
            return np.ones(len(q), dtype=bool)
        return _least_margin(self.machine, q) >= self.end_margin - MARGIN_TOLERANCE

    @property
    def ranges(self) -> Array:
        """Ends of the grid (nq, 2) [rad, m]."""
        return np.array([[axis[0], axis[-1]] for axis in self.axes])

    @cached_property
    def identity(self) -> str:
        """A digest of everything in which two workspaces can differ."""
        arrays = [self.q, self.weights, *self.axes, *(self.cells or ())]
        both = [array.tobytes().hex() for array in arrays]
        return digest([both, self.q.shape, self.end_margin, self.kind, self.machine.identity])

    @cached_property
    def rigid(self) -> RigidPoses:
        """The bare links at all poses: computed once, used for every design and payload."""
        return self.machine.rigid_poses(self.q)

    def parts(self, work: Callable[[slice, RigidPoses], T], what: str) -> Iterator[T]:
        """Results of work on the bare links, chunk by chunk, by threads; see ``in_threads``.

        Those of a large workspace are not kept in memory. ``what`` names the work in the progress
        bar.
        """
        self.machine.arm.load()
        known = self.rigid if len(self) <= KEPT else None

        def part(rows: slice) -> T:
            links = self.machine.rigid_poses(self.q[rows]) if known is None else known[rows]
            return work(rows, links)

        return in_threads(part, with_bar(self._thread_chunks(), len(self), what))

    def _thread_chunks(self) -> Iterator[slice]:
        return thread_chunks(len(self), len(self.machine.arm.coordinates))

    def holds(self, payload: LoadCase) -> Flags:
        """Whether a load case exists at each pose (n,)."""
        if not payload.limits:
            return np.ones(len(self), dtype=bool)
        if len(self) <= KEPT:
            return self.machine.holds(self.rigid, payload)
        parts = in_threads(
            lambda rows: self.machine.holds(self.q[rows], payload), self._thread_chunks()
        )
        return np.concatenate(list(parts))


def _on_pitch_limits(
    machine: Machine, ranges: Array, others: Callable[[int], Array]
) -> list[Array]:
    """Poses on the pitch limits of all load cases, ``others`` turned by a joint that tips them."""
    return [
        turned_onto_pitch_limits(machine, payload, others(joint), joint, ranges)
        for payload in machine.payloads
        for joint in tipping_joints(machine, payload)
    ]


def _in_stroke(
    machine: Machine,
    q: Array,
    weights: Array,
    axes: Axes,
    end_margin: float,
    kind: Kind,
    cells: tuple[Array, Array] | None = None,
) -> Workspace:
    """The workspace of those poses at which every cylinder keeps its end margin.

    Poses after those that have ``weights`` stand for no share of joint space.
    """
    inside = _least_margin(machine, q) >= end_margin - MARGIN_TOLERANCE
    if not inside.any():
        _refuse_out_of_stroke(machine, q, end_margin)
    poses = {"q": q[inside], "weights": np.pad(weights, (0, len(q) - len(weights)))[inside]}
    made_for = {"end_margin": end_margin, "machine": machine, "kind": kind}
    return Workspace(**poses, **made_for, axes=axes, cells=cells)  # type: ignore[arg-type]


def _refuse_out_of_stroke(machine: Machine, q: Array, end_margin: float) -> None:
    """Raise for poses all out of stroke, with the cylinder that none of them fits, if there is."""
    few = q[:: 1 + len(q) // REFUSED]
    margins = machine.margins(few).max(axis=0)
    worst = int(margins.argmin())
    if margins[worst] >= end_margin - MARGIN_TOLERANCE:
        fault = "no pose of it is in stroke"
        raise ArmDesignError(f"{machine.name}: workspace", fault, "give more points")
    linkage, cylinder = machine.linkages[worst], machine.cylinders[worst]
    part = f"{machine.name}: cylinder.{cylinder.name}"
    if margins[worst] == -np.inf:
        fault = "closes at no pose of the workspace"
        raise ArmDesignError(f"{part}.{linkage.key}", fault, linkage.closing_words)
    with np.errstate(invalid="ignore"):
        fault, remedy = never_within(
            linkage.length(machine.arm.kinematics(few)), cylinder, end_margin
        )
    fault, remedy = f"over the workspace {fault}", f"{remedy}, or give more points"
    raise ArmDesignError(f"{part}.stroke_mm", fault, remedy)


def _least_margin(machine: Machine, q: Array) -> Array:
    """Share of the stroke that the cylinder nearest to an end has left, at poses (n, nq): (n,)."""
    return np.concatenate([machine.margins(q[rows]).min(axis=1) for rows in chunks(len(q))])


def _checked_margin(machine: Machine, end_margin: float | None) -> float:
    margin = machine.section.requirements.end_margin if end_margin is None else end_margin
    number = isinstance(margin, int | float | np.number) and not isinstance(margin, bool)
    if not (number and 0 <= margin < 0.5):
        remedy = "give a share of the stroke in [0, 0.5)"
        raise ArmDesignError("end_margin", f"{margin!r} is not allowed", remedy)
    return margin


def _check_sobol(count: int, seed: int) -> None:
    if not (_whole(count) and 1 <= count <= MOST):
        remedy = f"give a whole number from 1 to {MOST:,}"
        raise ArmDesignError("count", f"{count!r} is not allowed", remedy)
    refuse_unless_seed(seed)


def _whole(number: object) -> bool:
    return isinstance(number, int | np.integer) and not isinstance(number, bool)
