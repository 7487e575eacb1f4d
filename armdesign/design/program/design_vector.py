"""The design space: what the numbers of a design vector mean for a machine's cylinders and linkages.

The vector x holds for every cylinder its bore and annulus area (relative to today's) and the moves
of its pins and four-bars (relative to the pin box), 1 and 0 for today's machine. Where a bore
varies and its rod does not, the annulus follows the bore. Links do not depend on x; the cylinders'
own masses, where given, do (``own_masses``). Places have the analytic sensitivities of the
linkage; what is computed from them goes on by a complex step.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags, remembered
from armdesign.design.catalogue.sizes import relative_areas
from armdesign.design.program.moving_masses import OwnMasses, masses, with_masses
from armdesign.design.program.variables import Variable, variables
from armdesign.design.requirements.settings import Requirements
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.joint_ranges import over, sweep
from armdesign.mechanism.linkage.base import Actuation, Linkage, Move

STEP = 1e-30  # complex step: no subtraction, so no cancellation
RANGE_POSES = 61  # over a joint range, where strokes and moment arms are constrained


@dataclass(frozen=True, eq=False)
class Geometry:
    """Lengths, moment arms and their derivatives over some poses, with their derivatives by x.

    length (n, nc), arm (n, nc, nq), curve (n, nc, nq, nq); the d-arrays have x in front: (nx, n,
    nc, …), or are None.
    """

    length: Array
    arm: Array
    curve: Array
    d_length: Array | None = None
    d_arm: Array | None = None
    d_curve: Array | None = None

    def __getitem__(self, poses: Array) -> Geometry:
        """At some of the poses, without derivatives."""
        return Geometry(self.length[poses], self.arm[poses], self.curve[poses])

    def stepped(self) -> tuple[Array, Array, Array]:
        """The three arrays with a complex step along each entry of x (nx, n, nc, …)."""
        assert self.d_length is not None
        assert self.d_arm is not None
        assert self.d_curve is not None
        return (
            self.length + 1j * STEP * self.d_length,
            self.arm + 1j * STEP * self.d_arm,
            self.curve + 1j * STEP * self.d_curve,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignSpace:
    """All that x can make of ``machine``.

    ``vary`` are the words and key paths of ``variables.py``; ``requirements`` and ``workspace``
    give the pin boxes.
    """

    machine: Machine
    workspace: Workspace
    requirements: Requirements
    vary: tuple[str, ...]
    proportional: bool = False  # dead volumes grow with the areas
    sizes: tuple[
        tuple[float, float] | None, ...
    ] = ()  # bore and rod of cylinders for which they are chosen [m]

    # ----------------------------------------------------------------------------------- variables

    @cached_property
    def box(self) -> float:
        """How far any pin coordinate may move [m]."""
        common = self.requirements.box(self.machine, self.workspace)
        names = [cylinder.name for cylinder in self.machine.cylinders]
        return max(
            self.requirements.box_of(name, pin, common)
            for name in names
            for pin in ("base", "rod_end")
        )

    @cached_property
    def variables(self) -> list[Variable]:
        """Entries of x: all areas (fixed unless they vary), then the coordinates of pins and bars that move."""
        return [self._as_chosen(v) for v in self._asked]

    @cached_property
    def _asked(self) -> list[Variable]:
        return variables(self.machine, self.vary, self.box, self.requirements.thrust_share)

    def _as_chosen(self, v: Variable) -> Variable:
        """A variable, fixed if it is an area of a cylinder whose size is chosen."""
        size = self.sizes[v.cylinder] if v.pin is None and v.cylinder < len(self.sizes) else None
        if size is None:
            return v
        area = relative_areas(self.machine.cylinders[v.cylinder], *size)[v.axis]
        return dataclasses.replace(v, lower=area, upper=area)

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
    def bends(self) -> bool:
        """Whether a rod end moves by more than a pin of its link: by places of the linkage's own."""
        return any(self.moved_within(i) for i in self.moving)

    def moved_within(self, i: int) -> bool:
        """Whether something of cylinder ``i``'s linkage moves beside its base and rod-end pins."""
        own = self.machine.linkages[i].own_places
        return any(place in own for place, _ in self.moves(i).values())

    @cached_property
    def resized(self) -> tuple[tuple[bool, bool], ...]:
        """For each actuator, whether its bore and whether its rod may change, in ``sizes`` too."""
        free = [v.upper > v.lower for v in self._asked[: 2 * len(self.machine.actuators)]]
        return tuple(zip(free[::2], free[1::2], strict=True))

    @cached_property
    def start(self) -> Array:
        """Today's machine as x."""
        return np.array([1.0 if v.pin is None else 0.0 for v in self.variables])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper end of every entry of x.

        A pin with a smaller box of its own keeps to that.
        """
        common, ends = self.requirements.box(self.machine, self.workspace), []
        for v in self.variables:
            share = 1.0
            if v.pin is not None:
                share = (
                    self.requirements.box_of(
                        self.machine.cylinders[v.cylinder].name, v.pin, common
                    )
                    / self.box
                )
            ends.append((v.lower * share, v.upper * share))
        low, high = np.array(ends).T
        return low, high

    def like(self, x: Array, other: DesignSpace) -> Array:
        """The design ``x`` of another problem of this machine as one of this problem, as far as it varies here."""
        pins = zip(x, other.variables, strict=True)
        moved = {
            (v.cylinder, v.pin, v.axis): float(value) * other.box
            for value, v in pins
            if v.pin is not None
        }
        here = [
            moved.get((v.cylinder, v.pin, v.axis), 0.0) / self.box
            for v in self.variables
            if v.pin is not None
        ]
        return np.clip(
            np.concatenate([(other.areas(x) / self.areas_today).ravel(), here]), *self.bounds
        )

    # ------------------------------------------------------------------------------------ machines

    def placed(self, x: Array) -> Machine:
        """Today's machine with pins, bars, closed lengths, strokes and own masses of x.

        Bores and rods are today's.
        """
        places = zip(self.machine.cylinders, *self.strokes(x), strict=False)  # motors stay
        cylinders = [
            dataclasses.replace(c, closed_length=float(closed), stroke=float(stroke))
            for c, closed, stroke in places
        ]
        linkages = self.linkages(x)
        if self.own is not None:
            closed = np.array([c.closed_length for c in cylinders])
            for i in self.own.bars:
                own = masses(
                    self.machine.cylinders[i],
                    self.machine.linkages[i],
                    self.areas(x)[i],
                    closed[i],
                    linkages[i],
                )
                cylinders[i] = with_masses(cylinders[i], own)
        return dataclasses.replace(self.machine, cylinders=tuple(cylinders), linkages=linkages)

    @cached_property
    def own(self) -> OwnMasses | None:
        """The bars that weigh and depend on x; None where none does."""
        bars = {}
        for i, cylinder in enumerate(self.machine.cylinders):
            sized, within = bool(self.moves(i)) or any(self.resized[i]), self.moved_within(i)
            of_linkage = self.machine.linkages[i].bar_names
            if names := [
                name
                for name in cylinder.moving_masses
                if (within if name in of_linkage else sized)
            ]:
                bars[i] = names
        return OwnMasses(self.machine, bars) if bars else None

    @cached_property
    def areas_today(self) -> Array:
        """Areas of today's machine (nc, 2) [m², of a motor m³/rad]."""
        return np.array([[f.bore_area, f.annulus_area] for f in self.machine.actuators])

    def areas(self, x: Array) -> Array:
        """Both areas of every actuator, all parallel cylinders together (nc, 2) [m², of a motor m³/rad]."""
        areas = x[: 2 * len(self.machine.actuators)].reshape(-1, 2) * self.areas_today
        return np.asarray(
            np.where(self._rod_stays, (areas[:, 0] - self._rod_areas)[:, None], areas)
        )

    @cached_property
    def _rod_stays(self) -> Flags:
        """Which areas are the bore's less today's rod (nc, 2): annuli of cylinders whose bore alone varies."""
        return np.array([[False, bore and not rod] for bore, rod in self.resized])

    @cached_property
    def _rod_areas(self) -> Array:
        """Today's rods (nc,) [m²]."""
        return np.asarray(self.areas_today[:, 0] - self.areas_today[:, 1])

    def stepped_areas(self, x: Array) -> Array:
        """Areas with a complex step along each entry of x (nx, nc, 2)."""
        areas = np.tile(self.areas(x).astype(complex), (len(x), 1, 1))
        for index, v in enumerate(self.variables):
            if v.pin is None and not self._rod_stays[v.cylinder, v.axis]:
                areas[index, v.cylinder, v.axis] += (
                    1j * STEP * self.areas_today[v.cylinder, v.axis]
                )
                if v.axis == 0 and self._rod_stays[v.cylinder, 1]:
                    areas[index, v.cylinder, 1] += 1j * STEP * self.areas_today[v.cylinder, 0]
        return areas

    @remembered
    def linkages(self, x: Array) -> tuple[Linkage, ...]:
        """Every cylinder's pins and bars at x."""
        made = list(self.machine.linkages)
        for value, v in zip(x, self.variables, strict=True):
            if v.pin is not None:
                at = list(made[v.cylinder].place(v.pin) or ())
                at[v.axis] += float(value) * self.box
                made[v.cylinder] = made[v.cylinder].with_place(v.pin, at)
        return tuple(made)

    def variant(self, linkage: Linkage, index: int) -> Linkage:
        """A linkage with a complex step along the entry of x that moves one of its places."""
        v = self.variables[index]
        at = [complex(value) for value in linkage.place(v.pin or "") or ()]
        at[v.axis] += 1j * STEP * self.box
        return linkage.with_place(v.pin or "", at)  # type: ignore[arg-type]

    def closes(self, x: Array) -> bool:
        """Whether every four-bar closes over its joint's range."""
        pairs = zip(self.linkages(x), self.ranges, strict=True)
        return all(poses is None or bool(linkage.closes(poses).all()) for linkage, poses in pairs)

    # ------------------------------------------------------------------------------------ geometry

    def geometry(self, x: Array, poses: RigidPoses, derivatives: bool = False) -> Geometry:
        """Every linkage at some poses, with derivatives by x when asked."""
        linkages = self.linkages(x)
        parts = [
            drive.actuation(poses) for drive in (*linkages, *self.machine.drives[len(linkages) :])
        ]
        length = np.stack([p.length for p in parts], axis=1)
        arm = np.stack([p.moment_arm for p in parts], axis=1)
        curve = np.stack([p.moment_arm_derivative for p in parts], axis=1)
        if not derivatives:
            return Geometry(length, arm, curve)
        changes = [np.zeros((len(x), *value.shape)) for value in (length, arm, curve)]
        for i, linkage in enumerate(linkages):
            for index, moved in self.sensitivities(i, linkage, poses):
                parts_moved = (moved.length, moved.moment_arm, moved.moment_arm_derivative)
                for change, part in zip(changes, parts_moved, strict=True):
                    change[index][:, i] = part * self.box
        return Geometry(length, arm, curve, *changes)

    def sensitivities(
        self, i: int, linkage: Linkage, poses: RigidPoses
    ) -> list[tuple[int, Actuation]]:
        """Entries of x that move places of cylinder ``i``, each with its actuation's derivative by that coordinate."""
        entries = self.moves(i)
        return list(
            zip(entries, linkage.sensitivities(poses, list(entries.values())), strict=True)
        )

    @cached_property
    def ranges(self) -> list[RigidPoses | None]:
        """For every cylinder that moves one joint alone, poses over that joint's range, ends included."""
        arm, ranges = self.machine.arm, self.machine.ranges
        return [
            (
                sweep(arm, k.joints[0], over(ranges[k.joints[0]], RANGE_POSES))
                if len(k.joints) == 1
                else None
            )
            for k in self.machine.linkages
        ]

    @cached_property
    def arms_today(self) -> list[Array]:
        """Today's moment arm of each cylinder over its joint's range [m/rad].

        Empty across several joints.
        """
        return [
            k.actuation(p).moment_arm[:, k.joints[0]] if p is not None else np.empty(0)
            for k, p in zip(self.machine.linkages, self.ranges, strict=True)
        ]

    @remembered
    def strokes(self, x: Array) -> tuple[Array, Array]:
        """Closed length and stroke of each actuator (nc,) [m]: least length and span over its joint's range.

        Today's for a motor and for a cylinder whose pins stay.
        """
        actuators = self.machine.actuators
        closed, stroke = (
            np.array([getattr(f, key) for f in actuators]) for key in ("closed_length", "stroke")
        )
        linkages = self.linkages(x)
        for i in self.moving:
            if (poses := self.ranges[i]) is not None:
                with np.errstate(invalid="ignore"):
                    length = linkages[i].length(poses)
                closed[i], stroke[i] = length.min(), np.ptp(length)
        return closed, stroke

    @remembered
    def stepped_sweeps(self, x: Array) -> list[tuple[Array, Array] | None]:
        """Length and moment arm over each cylinder's range with a complex step along each entry of x (nx, n).

        None across several joints.
        """
        found: list[tuple[Array, Array] | None] = []
        for i, (linkage, poses) in enumerate(zip(self.linkages(x), self.ranges, strict=True)):
            if poses is None:
                found.append(None)
                continue
            actuation, joint = linkage.actuation(poses), linkage.joints[0]
            length, arm = (
                np.tile(value.astype(complex), (len(x), 1))
                for value in (actuation.length, actuation.moment_arm[:, joint])
            )
            for index, moved in self.sensitivities(i, linkage, poses):
                length[index] += 1j * STEP * moved.length * self.box
                arm[index] += 1j * STEP * moved.moment_arm[:, joint] * self.box
            found.append((length, arm))
        return found

    def stepped_strokes(self, x: Array) -> tuple[Array, Array]:
        """Closed lengths and strokes with a complex step along each entry of x (nx, nc)."""
        closed, stroke = (np.tile(value.astype(complex), (len(x), 1)) for value in self.strokes(x))
        sweeps = self.stepped_sweeps(x)
        for i in self.moving:
            if (swept := sweeps[i]) is not None:
                length = swept[0]
                closed[:, i] = length[:, length[0].real.argmin()]
                stroke[:, i] = length[:, length[0].real.argmax()] - closed[:, i]
        return closed, stroke
