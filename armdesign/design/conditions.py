"""What each requirement means for a design: written once, for the check of a machine and for the optimiser.

A candidate is a design seen by the requirements. Its arrays have a variant on axis 0: one for a machine (``Built``), or
for the optimiser one per design variable, each with a complex step along it (``limits.Stepped``). So every formula here
is complex-safe, and its imaginary part is its exact derivative.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np

from armdesign.arm import Arm, RigidPoses
from armdesign.arrays import Array
from armdesign.column import euler_load, second_moment, stepped_load
from armdesign.cylinder import STEEL_MODULUS, barrel_outer, estimated_mass, holding_force
from armdesign.design.lifting import LiftPose, lift_pose, liftable, unloaded
from armdesign.design.outlines import clearance, depth
from armdesign.design.requirements import Clearance, Requirements, Speed
from armdesign.errors import ArmDesignError
from armdesign.linkage import Linkage
from armdesign.machine import Machine
from armdesign.poses import static_forces
from armdesign.ranges import over, sweep

PINS = ("base", "rod_end")
MESH = {1: 121, 2: 25, 3: 11}  # values of each joint between a barrel and the link it keeps clear of, by their number
NEAREST = 12  # poses of least clearance that count
ROUNDING_LENGTH = 3e-4  # [m] that rounding to 0.1 mm may cost the dead length
ROUNDING = 7.1e-5  # [m] that a pin on the 0.1 mm grid may lie beside its place


@dataclass(frozen=True, eq=False, kw_only=True)
class Condition:
    """One requirement on b variants of a design at k places.

    Attributes:
        name: of the requirement.
        words: what it is about.
        unit: SI, of value and limit.
        value: what the design has (b, k).
        limit: what it may have, broadcast to (b, k).
        at_least: whether the limit is a lower one.
        slack_scale: what a slack is a share of; None: the limit.
        room: as the optimiser sees it (b, k), dimensionless, ≥ 0 where met.
        easing: room per 100 % of the limit (b, k).
        care: how many times its share rounding may cost of the limit.
        rounding: room that rounding of pins to the grid may cost besides.
    """

    name: str
    words: str
    unit: str
    value: Array
    limit: Array
    at_least: bool
    slack_scale: float | None
    room: Array
    easing: Array
    care: float = 1.0
    rounding: float = 0.0

    @property
    def slack(self) -> Array:
        """Room (k,) of the first variant as a share of the limit, or of ``slack_scale``; ≥ 0 where met."""
        limit = np.broadcast_to(self.limit, self.value.shape)[0].real
        room = (self.value[0].real - limit) * (1 if self.at_least else -1)
        slack = room / np.where(limit == 0, 1.0, np.abs(limit)) if self.slack_scale is None else room / self.slack_scale
        return np.where(np.abs(slack) < 1e-12, 0.0, slack)  # nothing but the rounding of the arithmetic is left


def _bounded(
    name: str,
    words: str,
    unit: str,
    value: Array,
    limit: Any,
    *,
    at_least: bool = False,
    scale: float | None = None,
    slack_scale: float | None = None,
    room: Array | None = None,
    easing: Array | None = None,
    care: float = 1.0,
    rounding: float = 0.0,
) -> Condition:
    """A condition whose room is the distance to the limit over ``scale`` (its size if None)."""
    value = value[:, None] if value.ndim == 1 else value
    limit = np.asarray(limit)
    scale = scale or slack_scale or abs(float(limit)) or 1.0
    if room is None:
        room = (value - limit if at_least else limit - value) / scale
    return Condition(
        name=name,
        words=words,
        unit=unit,
        value=value,
        limit=limit,
        at_least=at_least,
        slack_scale=slack_scale,
        room=room,
        easing=np.broadcast_to(np.abs(limit) / scale, room.shape) if easing is None else easing,
        care=care,
        rounding=rounding,
    )


class Candidate(Protocol):
    """A design as the requirements see it."""

    @property
    def machine(self) -> Machine:
        """What the design leaves as it is: counts, walls, masses, supply."""

    @property
    def areas(self) -> Array:
        """Bore and annulus areas of all parallel cylinders together (b, nc, 2) [m²]."""

    @property
    def closed(self) -> Array:
        """Closed lengths (b, nc) [m]."""

    @property
    def stroke(self) -> Array:
        """Strokes (b, nc) [m]."""

    @property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """Length and moment arm of each cylinder over the range of its joint (b, k); None across several joints."""

    def pin(self, i: int, pin: str) -> Array | None:
        """Place of a cylinder's pin in its link (b, 3) [m]; None where there is none."""

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (b, n, nc, nq)."""

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """Base pin and rod end of a cylinder in the world (b, n, 3) [m]."""


@dataclass(frozen=True, eq=False)
class Frame:
    """What the requirements refer to: today's machine, its joint ranges at ``samples`` poses, the limits.

    ``today`` has today's cylinders under the supply of the machine that is judged.
    """

    today: Machine
    requirements: Requirements
    samples: int

    @cached_property
    def old(self) -> Built:
        """Today's machine as a candidate."""
        return Built(self.today, self)

    @cached_property
    def lifts(self) -> list[LiftPose]:
        """Every lift at its pose."""
        return [lift_pose(self.today, lift, self.requirements.holding_share) for lift in self.requirements.lifts]


@lru_cache(maxsize=8)
def frame(today: Machine, requirements: Requirements, samples: int) -> Frame:
    """The frame of today's machine; remembered, because many designs are judged in it.

    Raises:
        ArmDesignError: a requirement that names what the machine does not have, or asks what cannot be.
    """
    requirements.refuse_unknown(today)
    return Frame(today, requirements, samples)


@dataclass(frozen=True, eq=False)
class Built:
    """A machine as a candidate: one variant, in real numbers."""

    machine: Machine
    frame: Frame

    @cached_property
    def areas(self) -> Array:
        """See ``Candidate``."""
        return np.array([[[c.bore_area, c.annulus_area] for c in self.machine.cylinders]])

    @cached_property
    def closed(self) -> Array:
        """See ``Candidate``."""
        return np.array([[c.closed_length for c in self.machine.cylinders]])

    @cached_property
    def stroke(self) -> Array:
        """See ``Candidate``."""
        return np.array([[c.stroke for c in self.machine.cylinders]])

    @cached_property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """See ``Candidate``; over today's joint ranges."""
        today = self.frame.today
        found: list[tuple[Array, Array] | None] = []
        for linkage in self.machine.linkages:
            ends = tuple(float(end) for end in today.ranges[linkage.joints[0]])
            one = len(linkage.joints) == 1
            found.append(_swept(linkage, today.arm, ends, self.frame.samples) if one else None)
        return found

    def pin(self, i: int, pin: str) -> Array | None:
        """See ``Candidate``."""
        place = getattr(self.machine.linkages[i], pin)
        return None if place is None else np.array([place.at])

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """See ``Candidate``."""
        return np.stack([linkage.actuation(rigid).moment_arm for linkage in self.machine.linkages], axis=1)[None]

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """See ``Candidate``."""
        base, end, *_ = self.machine.linkages[i].pins(rigid)
        return base[None], end[None]


@lru_cache(maxsize=64)
def _swept(linkage: Linkage, arm: Arm, ends: tuple[float, ...], samples: int) -> tuple[Array, Array]:
    """Length and moment arm over its joint's range (1, k); remembered: many sizes are tried on the same pins."""
    joint = linkage.joints[0]
    actuation = linkage.actuation(sweep(arm, joint, over(np.array(ends), samples)))
    return actuation.length[None], actuation.moment_arm[None, :, joint]


# ------------------------------------------------------------------------------------------------------ requirements


def conditions(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Every requirement that a design can miss, but for the static forces over the workspace: see ``holding``."""
    yield from _oil(new, frame)
    yield from _strength(new, frame)
    yield from _moment_arms(new, frame)
    yield from (_speed(new, frame, speed) for speed in frame.requirements.speeds)
    yield from (_lift(new, frame, lift) for lift in frame.lifts)
    yield from _digging_force(new, frame)
    yield from _outlines(new, frame)
    yield from _clearances(new, frame)
    if frame.requirements.cylinder_mass is not None:
        yield _mass(new, frame.requirements.cylinder_mass)


def _oil(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Swept volumes of both sides, summed and of each cylinder."""
    requirements, old = frame.requirements, frame.old
    for side, label in enumerate(("cap", "annulus")):
        volume, today = (c.areas[:, :, side] * c.stroke for c in (new, old))
        total = float(today.sum())
        limit = requirements.oil_total_share * total
        yield _bounded(f"oil.{label}.total", f"oil of all {label} sides", "m³", volume.sum(axis=1), limit, scale=total)
        for i, cylinder in enumerate(frame.today.cylinders):
            own, words = float(today[0, i]), f"oil of the {cylinder.name} cylinder's {label} side"
            limit = requirements.oil_each_share * own
            yield _bounded(f"oil.{label}.{cylinder.name}", words, "m³", volume[:, i], limit, scale=own)


def _strength(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Thrust, dead length and buckling of each cylinder."""
    requirements, pressure = frame.requirements, new.machine.supply.pressure
    for i, cylinder in enumerate(frame.today.cylinders):
        name, today = cylinder.name, float(frame.old.areas[0, i, 0])
        thrust = pressure * new.areas[:, i, 0]
        limit = requirements.thrust_share * pressure * today
        yield _bounded(f"thrust.{name}", f"thrust of the {name} cylinder", "N", thrust, limit, scale=pressure * today)
        dead = new.closed[:, i] - new.stroke[:, i]
        yield _bounded(
            f"dead_length.{name}", f"closed length less stroke, {name}", "m", dead, cylinder.dead_length,
            at_least=True, slack_scale=cylinder.stroke, care=0.0, rounding=ROUNDING_LENGTH / cylinder.stroke,
        )  # fmt: skip
        if requirements.buckling_share > 0:
            least = requirements.buckling_share * float(_buckling_safety(frame.old, i, pressure, "rod")[0])
            words = f"Euler safety of the {name} rod"
            yield _buckling(f"buckling.{name}", words, new, i, pressure, "rod", least, today)
        if requirements.buckling_factor is not None:
            column, least = requirements.buckling_column, requirements.buckling_factor
            words = f"safety of the {name} {'rod' if column == 'rod' else 'barrel and rod'} against buckling"
            yield _buckling(f"buckling_factor.{name}", words, new, i, pressure, column, least, today)


def _diameters(new: Candidate, i: int) -> tuple[Array, Array]:
    """Bore and rod of one of the parallel cylinders (b,) [m]; a rod there always is, if a thin one."""
    one = 4 / math.pi / new.machine.cylinders[i].count
    bore_area, rod_area = new.areas[:, i, 0], new.areas[:, i, 0] - new.areas[:, i, 1]
    return np.sqrt(one * bore_area), np.sqrt(one * np.where(rod_area.real > 0, rod_area, 1e-6 * bore_area))


def _buckling_safety(new: Candidate, i: int, pressure: float, column: str) -> Array:
    """Buckling load of an open cylinder over its thrust (b,).

    As a column of barrel and rod each is half of it: the dead length is shared by both ends.
    """
    bore, rod = _diameters(new, i)
    length = new.closed[:, i] + new.stroke[:, i]
    thrust = pressure * math.pi / 4 * bore**2
    if column == "rod":
        return np.asarray(euler_load(second_moment(rod), length) / thrust)
    outer = barrel_outer(bore, new.machine.cylinders[i].barrel_wall, pressure)
    return np.asarray(stepped_load(second_moment(outer, bore), second_moment(rod), length / 2, length / 2) / thrust)


def _buckling(
    name: str, words: str, new: Candidate, i: int, pressure: float, column: str, least: float, today: float
) -> Condition:
    """Buckling: as a lower limit of the rod's area, in which it is nearly linear.

    The load of a rod grows with the square of its area: it needs L √(c A1), see ``rod_area_factor``; less in a stepped
    column, by the root of what the barrel adds to the load.
    """
    safety = _buckling_safety(new, i, pressure, column)
    rod_area = new.areas[:, i, 0] - new.areas[:, i, 1]
    factor = rod_area_factor(new.machine.cylinders[i].count, pressure, least)
    needed = (new.closed[:, i] + new.stroke[:, i]) * np.sqrt(factor * new.areas[:, i, 0])
    if column == "stepped":
        needed = needed * np.sqrt(_buckling_safety(new, i, pressure, "rod") / safety)
    return _bounded(
        name, words, "", safety, least, at_least=True,
        room=((rod_area - needed) / today)[:, None], easing=(0.5 * needed / today)[:, None], care=4.0,
    )  # fmt: skip


def rod_area_factor(cylinder_count: int, pressure: float, safety: float) -> float:
    """C in rod area ≥ L √(c A1), which gives a safety: π E (A1 − A2)²/(4 n L² p A1) of all n cylinders."""
    return safety * 4 * cylinder_count * pressure / (math.pi * STEEL_MODULUS)


def _moment_arms(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Smallest moment arm over the joint range; digging torque at the best pose."""
    requirements, pressure = frame.requirements, new.machine.supply.pressure
    for i, (cylinder, now, before) in enumerate(zip(frame.today.cylinders, new.sweeps, frame.old.sweeps, strict=True)):
        if now is None or before is None:
            continue
        name, sign = cylinder.name, np.sign(before[1][0, 0])
        arm, today = sign * now[1], sign * before[1][0]
        yield _bounded(
            f"moment_arm.{name}", f"smallest moment arm of the {name} cylinder", "m/rad", arm,
            requirements.moment_arm_share * today.min(), at_least=True, scale=float(today.min()),
        )  # fmt: skip
        if name in requirements.digging:
            best = int(arm[0].real.argmax())
            own = pressure * float(frame.old.areas[0, i, 0] * today.max())
            torque = pressure * new.areas[:, i, 0] * arm[:, best]
            words, limit = f"digging torque of the {name} cylinder", requirements.digging_share * own
            yield _bounded(f"digging.{name}", words, "N m", torque, limit, at_least=True, scale=own)


def holding(new: Candidate, frame: Frame, forces: Array) -> Iterator[Condition]:
    """Static forces (b, k, nc) [N, + pushes] within a share of what the supply holds."""
    share, supply = frame.requirements.holding_share, new.machine.supply
    for i, cylinder in enumerate(frame.today.cylinders):
        pushes = forces[0, :, i].real > 0
        held = holding_force(new.areas[:, i, None, 0], new.areas[:, i, None, 1], supply, pushes)
        used = forces[:, :, i] * np.where(pushes, 1.0, -1.0)
        scale = supply.pressure * float(frame.old.areas[0, i, 0])
        yield _bounded(
            f"holding.{cylinder.name}", f"static load of the {cylinder.name} cylinder", "", used / held, share,
            room=(share * held - used) / scale, easing=share * held / scale,
        )  # fmt: skip


# ------------------------------------------------------------------------------------------ asked for in absolute terms


def flows(new: Candidate, frame: Frame, speed: Speed) -> Array:
    """Flow that the functions of a motion draw together (b,) [m³/s]: bore sides extending, annulus sides retracting.

    Over a joint's range the mean is the swept volume over the time; at every pose it is A |r| q̇ where |r| is largest.

    Raises:
        ArmDesignError: a joint that a cylinder across several joints moves.
    """
    total = np.zeros(len(new.areas))
    for i, cylinder in enumerate(frame.today.cylinders):
        rates: list[Any] = [speed.cylinders[cylinder.name]] if cylinder.name in speed.cylinders else []
        linkage, swept = frame.today.linkages[i], new.sweeps[i]
        for joint, rate in speed.joints.items():
            j = frame.today.joints.index(joint)
            if j not in linkage.joints:
                continue
            if swept is None:
                raise ArmDesignError(
                    f"requirements.speed.{speed.name}",
                    f'the {cylinder.name} cylinder moves "{joint}" and other joints',
                    "ask for the speed of the cylinder instead",
                )
            length, arm = swept
            if speed.at == "mean":
                rates.append(rate * (length[:, -1] - length[:, 0]) / np.ptp(frame.today.ranges[j]))
            else:
                worst = np.abs(arm[0].real).argmax()
                rates.append(rate * arm[:, worst])
        for rate in rates:
            extends = np.real(np.ravel(rate)[0]) > 0
            total = total + np.where(extends, rate, -np.asarray(rate)) * new.areas[:, i, 0 if extends else 1]
    return total


def _speed(new: Candidate, frame: Frame, speed: Speed) -> Condition:
    return _bounded(
        f"speed.{speed.name}", f"flow of the motion {speed.name}", "m³/s", flows(new, frame, speed),
        new.machine.supply.flow,
    )  # fmt: skip


def _lift(new: Candidate, frame: Frame, at: LiftPose) -> Condition:
    """Mass that each cylinder could hold, as the optimiser sees it by the forces at the mass that is asked."""
    share, supply = frame.requirements.holding_share, new.machine.supply
    arms = new.moment_arms(at.rigid)
    loads = unloaded(new.machine, at.rigid), at.torque
    bare, per_mass = (
        np.stack([static_forces(arms[v], load, new.areas[v, :, 0])[0] for v in range(len(arms))]) for load in loads
    )
    mass = liftable(new.machine, bare, per_mass, new.areas, share)
    loaded = np.isfinite(mass[0].real)
    steepness = per_mass * np.sign(per_mass[0].real) / (supply.pressure * frame.old.areas[0, :, 0])
    steepness = np.where(loaded, steepness, 0.0)
    room = np.where(loaded, (np.where(loaded, mass, 0.0) - at.lift.mass) * steepness, 1.0)
    return _bounded(
        f"lift.{at.lift.name}", f"mass that the lift {at.lift.name} could be", "kg", mass, at.lift.mass,
        at_least=True, room=room, easing=at.lift.mass * steepness,
    )  # fmt: skip


def digging_forces(new: Candidate, frame: Frame) -> dict[str, Array]:
    """Force of each cylinder at the tool (b,) [N]: it alone, extending, supply pressure, best angle (ISO 6015).

    The force is tangential to the tool's arc about the joint that the cylinder turns; joints further out stand where
    their own cylinders dig best. Cylinders that turn no single joint between root and tool are left out.
    """
    arm, ranges = frame.today.arm, frame.today.ranges
    best: dict[int, tuple[str, Array, Array]] = {}  # by joint: cylinder, its best position, torque there
    for i, (cylinder, swept) in enumerate(zip(frame.today.cylinders, new.sweeps, strict=True)):
        joint = frame.today.linkages[i].joints[0]
        if swept is None or not arm.joints[joint].revolute:
            continue
        where, most = _peak(over(ranges[joint], frame.samples), np.abs(swept[1].real), swept[1])
        best[joint] = cylinder.name, where, new.machine.supply.pressure * new.areas[:, i, 0] * most
    q = arm.limits.mean(axis=1)
    for joint, (_, where, _) in best.items():
        q[joint] = where[0].real
    poses, tool = arm.kinematics(q[None]), frame.today.tool
    chain, found = arm.chain(tool.link), {}
    motion = arm.motion(poses, tool.link, np.array(tool.at), arm.root, tuple(range(len(q))))
    for joint in (j for j in chain if j in best):
        axis, lever = poses.axis[0, joint], motion.value[0] - poses.translation[0, joint]
        lever = lever - axis * (axis @ lever)
        distance = float(np.linalg.norm(lever))
        if distance > 0:
            turned = sum((best[k][1] - q[k]) * float(motion.first[0, k] @ lever) for k in _beyond(chain, joint, best))
            name, _, torque = best[joint]
            found[name] = torque / (distance + turned / distance)
    return found


def _beyond(chain: tuple[int, ...], joint: int, known: dict[int, Any]) -> list[int]:
    """Joints further out than one, of those known."""
    return [k for k in chain[chain.index(joint) + 1 :] if k in known]


def _peak(values: Array, size: Array, curve: Array) -> tuple[Array, Array]:
    """Where |curve| (b, k) is largest over even values (k,), and how large: by the parabola through three samples."""
    k = int(size[0].argmax())
    middle = np.sign(curve[0, k].real) * curve[:, k]
    if k in (0, len(values) - 1):
        return np.full(len(curve), values[k]), middle
    before, after = (np.sign(curve[0, k].real) * curve[:, j] for j in (k - 1, k + 1))
    bend, slope = before - 2 * middle + after, (after - before) / 2
    if bend[0].real == 0:
        return np.full(len(curve), values[k]), middle
    return values[k] - slope / bend * (values[1] - values[0]), middle - slope**2 / bend / 2


def _digging_force(new: Candidate, frame: Frame) -> Iterator[Condition]:
    asked = frame.requirements.digging_force
    found = digging_forces(new, frame) if asked else {}
    for name, limit in asked.items():
        if name not in found:
            raise ArmDesignError(
                "requirements.digging_force",
                f"the {name} cylinder turns no single joint between root and tool",
                "leave it out",
            )
        yield _bounded(f"digging_force.{name}", f"digging force of the {name} cylinder", "N", found[name], limit,
                       at_least=True)  # fmt: skip


def _outlines(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Every pin on an outlined link, as far within the outline as its radius."""
    for outline in frame.requirements.outlines:
        polygon = np.array(outline.points)
        size = float(np.ptp(polygon, axis=0).max()) or 1.0
        for i, linkage in enumerate(frame.today.linkages):
            for pin in PINS:
                place = new.pin(i, pin)
                if place is None or getattr(linkage, pin).link != outline.link:
                    continue
                name = f"{frame.today.cylinders[i].name}.{pin}"
                words = f"{pin} pin of the {frame.today.cylinders[i].name} cylinder within the {outline.link}'s outline"
                yield _bounded(
                    f"outline.{name}", words, "m", depth(place[:, [0, 2]], polygon), outline.pin_radius,
                    at_least=True, slack_scale=size, rounding=ROUNDING / size,
                )  # fmt: skip


@lru_cache(maxsize=64)
def _poses_between(today: Machine, part: Clearance, i: int) -> RigidPoses:
    """Poses over the ranges of all joints between a cylinder and the link that it keeps clear of."""
    arm, linkage = today.arm, today.linkages[i]
    between = sorted({*linkage.joints, *(j for j, _ in arm.path(linkage.base.link, part.link))})
    count = MESH.get(len(between), 5)
    axes = [over(today.ranges[j], count) for j in between]
    q = np.tile(today.ranges.mean(axis=1), (count ** len(between), 1))
    q[:, between] = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(between))
    return arm.kinematics(q)


def _clearances(new: Candidate, frame: Frame) -> Iterator[Condition]:
    """Barrels from parts of links, over the ranges of the joints between them: the poses of least clearance.

    A barrel is a bar of its outer diameter from the base pin, as long as ``_buckling_safety`` takes it to be.
    """
    arm, pressure = frame.today.arm, new.machine.supply.pressure
    for part in frame.requirements.clearances:
        polygon = np.array(part.points)
        for name in part.cylinders:
            i = [c.name for c in frame.today.cylinders].index(name)
            poses = _poses_between(frame.today, part, i)
            base, end = new.span(i, poses)
            along = end - base
            length = np.sqrt((along**2).sum(axis=-1))[..., None]
            tip = base + along / length * ((new.closed[:, i] + new.stroke[:, i]) / 2)[:, None, None]
            turn, origin = arm.link_rotation(poses, part.link), arm.point(poses, part.link, np.zeros(3))
            bar = [np.einsum("bni,nij->bnj", p - origin, turn)[..., [0, 2]] for p in (base, tip)]
            radius = barrel_outer(_diameters(new, i)[0], new.machine.cylinders[i].barrel_wall, pressure) / 2
            free = clearance(bar[0], bar[1], polygon) - radius[:, None]
            nearest = np.argsort(free[0].real)[:NEAREST]
            yield _bounded(
                f"clearance.{part.name}.{name}", f"clearance of the {name} barrel, {part.name}", "m",
                free[:, nearest], part.distance, at_least=True, slack_scale=frame.today.cylinders[i].stroke,
                rounding=2 * ROUNDING / frame.today.cylinders[i].stroke,
            )  # fmt: skip


def _mass(new: Candidate, limit: float) -> Condition:
    total = np.zeros(len(new.areas))
    for i, cylinder in enumerate(new.machine.cylinders):
        bore, rod = _diameters(new, i)
        total = total + cylinder.count * estimated_mass(bore, rod, new.stroke[:, i], new.machine.supply.pressure)
    return _bounded("cylinder_mass", "estimated mass of all cylinders", "kg", total, limit)


# -------------------------------------------------------------------- what a design of the optimiser has by itself


def guaranteed(new: Built, frame: Frame, box: float) -> Iterator[Condition]:
    """What the optimiser keeps by how it makes designs, and a machine may miss: strokes, four-bars, pin boxes."""
    for i, cylinder in enumerate(frame.today.cylinders):
        name, swept, linkage = cylinder.name, new.sweeps[i], new.machine.linkages[i]
        if swept is not None:
            length, words = swept[0], f"stroke covers {frame.today.joints[linkage.joints[0]]}"
            open_length = new.closed[:, i] + new.stroke[:, i]
            for end, value, limit, at_least in (
                ("open", open_length, length.max(), True),
                ("closed", new.closed[:, i], length.min(), False),
            ):
                yield _bounded(
                    f"range.{end}.{name}", words, "m", value, limit, at_least=at_least, slack_scale=cylinder.stroke
                )
            if linkage.four_bar is not None:
                angle, today = (_transmission(c.machine.linkages[i], frame) for c in (new, frame.old))
                least = min(frame.requirements.transmission, today)
                words = f"rocker–coupler angle, {name}"
                yield _bounded(f"transmission.{name}", words, "rad", np.array([angle]), least, at_least=True)
        for pin in PINS:
            here, before = new.pin(i, pin), frame.old.pin(i, pin)
            if here is not None and before is not None:
                own = frame.requirements.box_of(name, pin, box)
                moved = np.abs(here - before).max(axis=1)
                words = f"move of the {name} cylinder's {pin} pin"
                yield _bounded(f"pin_box.{name}.{pin}", words, "m", moved, own, slack_scale=own or 1.0)


def _transmission(linkage: Linkage, frame: Frame) -> float:
    """Smallest angle between rocker and coupler over the joint's range [rad]."""
    return _transmission_over(linkage, tuple(frame.today.ranges[linkage.joints[0]].tolist()), frame.samples)


@lru_cache(maxsize=64)
def _transmission_over(linkage: Linkage, ends: tuple[float, ...], samples: int) -> float:
    poses = sweep(linkage.arm, linkage.joints[0], over(np.array(ends), samples))
    return float(linkage.transmission_angle(poses).min())
