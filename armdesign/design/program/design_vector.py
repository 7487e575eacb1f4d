"""The design vector: what the entries of x mean for a machine's cylinders and linkages.

The vector x holds for every actuator its bore and annulus area (relative to today's) and the moves
of cylinder pins and four-bars (relative to the pin box): 1 and 0 for today's machine. Where a bore
varies and its rod does not, the annulus follows the bore. Links do not depend on x; the masses of
cylinders and four-bars, where the file gives them, do (``moving_masses.py``). Derivatives by x are
in ``gradient.py``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array, Flags, remembered
from armdesign.design.program.moving_masses import MovingMasses, masses, with_masses
from armdesign.design.program.variables import Variable, variables
from armdesign.design.requirements.candidate import spare_shares
from armdesign.design.requirements.settings import Requirements
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import areas_of
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over, sweep
from armdesign.mechanism.linkage.base import Drive, Linkage, Move
from armdesign.mechanism.rigid_poses import RigidPoses

PROGRAMME_POSES = 61  # over a joint range, where strokes and moment arms are constrained

# closed length and stroke of every cylinder [m]; None where they follow its pins
ChosenLengths: TypeAlias = tuple[tuple[float, float] | None, ...]


@dataclass(frozen=True, eq=False)
class Geometry:
    """Lengths (…, n, nc), moment arms (…, n, nc, nq) and their derivatives (…, n, nc, nq, nq).

    Of every actuator at n poses; ``gradient.py`` has a variant for each entry of x in front.
    """

    length: Array
    arm: Array
    curve: Array

    def __getitem__(self, poses: Array) -> Geometry:
        """At some of the poses."""
        return Geometry(self.length[poses], self.arm[poses], self.curve[poses])


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignVector:
    """All that x can make of a machine.

    Attributes:
        machine: today's machine, x = ``start``.
        vary: words and key paths of ``variables.py``.
        boxes: for each cylinder how far the coordinates of a place of its linkage may move [m].
        spare: share of the stroke that each cylinder keeps free at the closed and the open end of
            its joint's range (nc, 2).
        chosen_lengths: closed length and stroke [m] of cylinders for which they are chosen; None,
            or no entry, where they are what the joint's range takes.
    """

    machine: Machine
    vary: tuple[str, ...]
    boxes: tuple[Mapping[str, float], ...]
    spare: Array
    chosen_lengths: ChosenLengths = ()

    @classmethod
    def of(
        cls,
        machine: Machine,
        workspace: Workspace,
        requirements: Requirements,
        vary: tuple[str, ...],
    ) -> DesignVector:
        """With the pin boxes that requirements give on today's workspace."""
        common = requirements.box(machine, workspace)
        boxes = tuple(
            {
                place: requirements.box_of(c.name, place, common)
                for place in ("base", "rod_end", *k.places)
            }
            for c, k in zip(machine.cylinders, machine.linkages, strict=True)
        )
        spare = spare_shares(machine, requirements.end_margin)
        return cls(machine=machine, vary=vary, boxes=boxes, spare=spare)

    # ----------------------------------------------------------------------------------- variables

    @cached_property
    def pin_box(self) -> float:
        """Half side of the pin boxes [m]: the unit of pin coordinates in x."""
        return max(box[pin] for box in self.boxes for pin in ("base", "rod_end"))

    @cached_property
    def variables(self) -> tuple[Variable, ...]:
        """Entries of x: all areas, then the coordinates of pins and bars that move."""
        return variables(self.machine, self.vary, self.pin_box > 0)

    @cached_property
    def is_coordinate(self) -> Flags:
        """Flags of the entries of x that are coordinates of pins and bars (nx,)."""
        return np.array([v.pin is not None for v in self.variables])

    @cached_property
    def moving(self) -> list[int]:
        """Cylinders of whose linkage something moves."""
        return sorted({v.cylinder for v in self.variables if v.pin is not None})

    def moves(self, i: int) -> dict[int, Move]:
        """Entries of x that move places of cylinder ``i``, each with its place and coordinate."""
        return {
            index: (v.pin, v.axis)
            for index, v in enumerate(self.variables)
            if v.cylinder == i and v.pin
        }

    @cached_property
    def moves_within(self) -> bool:
        """Whether a linkage moves by more than its base and rod-end pins."""
        return any(self.moved_within(i) for i in self.moving)

    def moved_within(self, i: int) -> bool:
        """Whether something of cylinder ``i``'s linkage moves beside its base and rod-end pins."""
        own = self.machine.linkages[i].own_places
        return any(place in own for place, _ in self.moves(i).values())

    @cached_property
    def resized(self) -> tuple[tuple[bool, bool], ...]:
        """For each actuator, whether its bore and whether its rod may change."""
        free = [v.free for v in self.variables[: 2 * len(self.machine.actuators)]]
        return tuple(zip(free[::2], free[1::2], strict=True))

    @property
    def any_size_varies(self) -> bool:
        """Whether a bore or rod may change."""
        return any(bore or rod for bore, rod in self.resized)

    @cached_property
    def start(self) -> Array:
        """Today's machine as x."""
        return np.where(self.is_coordinate, 0.0, 1.0)

    # --------------------------------------------------------------------------------------- areas

    @cached_property
    def areas_today(self) -> Array:
        """Areas of today's machine (nc, 2) [m², of a motor m³/rad]."""
        return areas_of(self.machine.actuators)

    def areas(self, x: Array) -> Array:
        """Bore and annulus area of all parallel actuators (nc, 2) [m², of a motor m³/rad]."""
        areas = x[: 2 * len(self.machine.actuators)].reshape(-1, 2) * self.areas_today
        rod_areas = self.areas_today[:, 0] - self.areas_today[:, 1]
        return np.asarray(np.where(self.rod_stays, (areas[:, 0] - rod_areas)[:, None], areas))

    @cached_property
    def rod_stays(self) -> Flags:
        """Flags of areas that are the bore's less today's rod (nc, 2): annuli whose bores vary."""
        return np.array([[False, bore and not rod] for bore, rod in self.resized])

    # ------------------------------------------------------------------------------------ linkages

    @remembered
    def linkages(self, x: Array) -> tuple[Linkage, ...]:
        """Every cylinder's pins and bars at x."""
        linkages = list(self.machine.linkages)
        for value, v in zip(x, self.variables, strict=True):
            if v.pin is not None:
                at = list(linkages[v.cylinder].place(v.pin) or ())
                at[v.axis] += float(value) * self.pin_box
                linkages[v.cylinder] = linkages[v.cylinder].with_places({v.pin: at})
        return tuple(linkages)

    def drives(self, x: Array) -> tuple[Drive, ...]:
        """Linkages at x, then motors, which stay."""
        linkages = self.linkages(x)
        return (*linkages, *self.machine.drives[len(linkages) :])

    def closes(self, x: Array) -> bool:
        """Whether every four-bar closes over its joint's range."""
        pairs = zip(self.linkages(x), self.range_poses, strict=True)
        return all(poses is None or bool(linkage.closes(poses).all()) for linkage, poses in pairs)

    def geometry(self, x: Array, poses: RigidPoses) -> Geometry:
        """Every linkage at some poses."""
        parts = [drive.actuation(poses) for drive in self.drives(x)]
        return Geometry(
            np.stack([p.length for p in parts], axis=1),
            np.stack([p.moment_arm for p in parts], axis=1),
            np.stack([p.moment_arm_derivative for p in parts], axis=1),
        )

    @cached_property
    def own_joints(self) -> Array | None:
        """The joint of each actuator where each coordinate has one actuator alone; else None."""
        joints = [drive.joints for drive in self.machine.drives]
        alone = sorted(joints) == [(j,) for j in range(len(self.machine.arm.coordinates))]
        return np.array(joints)[:, 0] if alone else None

    def own_geometry(self, x: Array, poses: RigidPoses) -> Geometry:
        """Lengths, arms and their derivatives (n, nc) of actuators, each by its ``own_joints``."""
        parts = [(drive.joints[0], drive.actuation(poses)) for drive in self.drives(x)]
        return Geometry(
            np.stack([p.length for _, p in parts], axis=1),
            np.stack([p.moment_arm[:, j] for j, p in parts], axis=1),
            np.stack([p.moment_arm_derivative[:, j, j] for j, p in parts], axis=1),
        )

    @cached_property
    def range_poses(self) -> list[RigidPoses | None]:
        """For every cylinder that moves one joint alone, poses over its range, ends included."""
        arm, ranges = self.machine.arm, self.machine.ranges
        return [
            (
                sweep(arm, k.joints[0], over(ranges[k.joints[0]], PROGRAMME_POSES))
                if len(k.joints) == 1
                else None
            )
            for k in self.machine.linkages
        ]

    @cached_property
    def arms_today(self) -> list[Array]:
        """Today's moment arms over each joint's range [m/rad]; empty across several joints."""
        return [
            k.actuation(p).moment_arm[:, k.joints[0]] if p is not None else np.empty(0)
            for k, p in zip(self.machine.linkages, self.range_poses, strict=True)
        ]

    @property
    def strokes_today(self) -> tuple[Array, Array]:
        """Today's closed length and stroke (nc,) [m], which the caller may change."""
        return self.machine.closed_lengths.copy(), self.machine.strokes.copy()

    def covering(self, i: int, least: Any, most: Any) -> tuple[Any, Any]:
        """Closed length and stroke [m] of cylinder ``i`` that cover lengths, and no more.

        Numbers or arrays, which may be complex.
        """
        travel = most - least
        return least - self.beyond(i) * travel, travel / (1 - self.spare[i].sum())

    def beyond(self, i: int) -> float:
        """Travel of cylinder ``i`` before its closed end, over that within its joint's range."""
        return float(self.spare[i, 0] / (1 - self.spare[i].sum()))

    @remembered
    def strokes(self, x: Array) -> tuple[Array, Array]:
        """Closed length and stroke (nc,) [m]: today's if pins stay, as chosen, or just enough."""
        closed, stroke = self.strokes_today
        linkages = self.linkages(x)
        for i in self.moving:
            if (poses := self.range_poses[i]) is not None:
                with np.errstate(invalid="ignore"):
                    length = linkages[i].length(poses)
                closed[i], stroke[i] = self.covering(i, length.min(), length.max())
        for i, chosen in enumerate(self.chosen_lengths):
            closed[i], stroke[i] = chosen or (closed[i], stroke[i])
        return closed, stroke

    # -------------------------------------------------------------------------------------- masses

    @cached_property
    def moving_masses(self) -> MovingMasses | None:
        """The bars that weigh and depend on x; None where none does."""
        bars = {}
        for i, cylinder in enumerate(self.machine.cylinders):
            sized, within = bool(self.moves(i)) or any(self.resized[i]), self.moved_within(i)
            of_linkage = self.machine.linkages[i].bar_names
            names = [
                name
                for name in cylinder.moving_masses
                if (within if name in of_linkage else sized)
            ]
            if names:
                bars[i] = names
        return MovingMasses(self.machine, bars) if bars else None

    @cached_property
    def bare(self) -> Machine:
        """Today's machine without the masses that depend on x."""
        return self.machine if self.moving_masses is None else self.moving_masses.without_bars

    def with_pins(self, x: Array) -> Machine:
        """Today's machine and sizes with pins, bars, lengths, strokes and masses of x."""
        lengths = zip(self.machine.cylinders, *self.strokes(x), strict=False)  # motors stay
        cylinders = [
            dataclasses.replace(c, closed_length=float(closed), stroke=float(stroke))
            for c, closed, stroke in lengths
        ]
        linkages = self.linkages(x)
        for i in self.moving_masses.bars if self.moving_masses else ():
            today = self.machine.cylinders[i], self.machine.linkages[i]
            closed_length = np.float64(cylinders[i].closed_length)
            new = masses(*today, self.areas(x)[i], closed_length, linkages[i])
            cylinders[i] = with_masses(cylinders[i], new)
        return dataclasses.replace(self.machine, cylinders=tuple(cylinders), linkages=linkages)
