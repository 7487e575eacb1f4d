"""Requirements: what a new design must keep of today's machine, and what else its designer asks of it.

The settings alone, in SI; ``conditions.py`` says what each means for a design, ``check.py`` judges
machines by them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from armdesign.errors import ArmDesignError, Concession, MachineFileError, choose
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.machine.requirements_schema import (
    ClearanceSection,
    LiftSection,
    OutlineSection,
    RequirementsSection,
    SpeedSection,
)
from armdesign.units import deg, kN, mm

Outlined = tuple[tuple[float, float], ...]

_NUMBERS = {  # keys of a machine file that state one number: attribute and unit
    **{
        f"{name}_share": (f"{name}_share", 1.0)
        for name in ("holding", "thrust", "moment_arm", "buckling")
    },
    **{f"oil_{name}_share": (f"oil_{name}_share", 1.0) for name in ("total", "each")},
    "digging.share": ("digging_share", 1.0),
    "buckling_factor": ("buckling_factor", 1.0),
    "transmission_deg": ("transmission", deg),
    "cylinder_mass_kg": ("cylinder_mass", 1.0),
}
_LISTS = {  # tables of a machine file, one for each name: attribute; key in it, attribute and unit
    "lift": ("lifts", "mass_kg", "mass", 1.0),
    "outline": ("outlines", "pin_radius_mm", "pin_radius", mm),
    "clearance": ("clearances", "distance_mm", "distance", mm),
}
_NAMED = {"outlines": "link"}  # by what the entries of a list are told apart, if not by their name


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Functions that move together at pump flow, at least this fast.

    Attributes:
        name: of the motion.
        joints: speed of joints [rad/s, m/s]; positive in the joint's own direction, negative
            against it.
        cylinders: speed of cylinders [m/s]; positive extends.
        at: "mean": over the joint's range, so that the whole range takes range/speed, the stroke
            time that data sheets and cycle times speak of; "every": at every pose of the range.
    """

    name: str
    joints: Mapping[str, float] = field(default_factory=dict)
    cylinders: Mapping[str, float] = field(default_factory=dict)
    at: Literal["mean", "every"] = "mean"

    def times(self, factor: float) -> Speed:
        """The same motion at a multiple of its speed."""
        joints, cylinders = (
            {k: factor * v for k, v in part.items()} for part in (self.joints, self.cylinders)
        )
        return replace(self, joints=joints, cylinders=cylinders)


@dataclass(frozen=True, kw_only=True)
class Lift:
    """A mass that every cylinder must hold within ``holding_share`` of what the supply gives, at one pose.

    Attributes:
        name: of the lift.
        mass: [kg], in place of any load case; hook and sling included.
        link: that carries it; None: the tool's.
        at: its place in the link [m]; None: the tool.
        joints: where the joints stand [rad, m]. All of them; or all but two, which then bring the
            mass to ``reach`` and ``height``, of several ways in that in which today's machine
            lifts most.
        reach: of the mass from the root's vertical axis [m].
        height: of the mass over the root [m].
    """

    name: str
    mass: float
    link: str | None = None
    at: tuple[float, float, float] | None = None
    joints: Mapping[str, float] = field(default_factory=dict)
    reach: float | None = None
    height: float | None = None


@dataclass(frozen=True, kw_only=True)
class Outline:
    """The outline (x, z) [m] of a link, within which cylinder pins on it must lie by their radius [m]."""

    link: str
    points: Outlined
    pin_radius: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Clearance:
    """A distance [m] that the barrels of some cylinders keep from a part of a link, outlined by (x, z) [m] in it."""

    name: str
    cylinders: tuple[str, ...]
    link: str
    points: Outlined
    distance: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Limits of a new design, shares of what today's machine has, and absolute ones where they are given.

    Attributes:
        end_margin: share of the stroke that every cylinder keeps free at both ends, in today's
            workspace.
        holding_share: static force over what supply against return pressure gives, at most.
        oil_total_share: swept volume summed over the cylinders, bore sides and annulus sides, at
            most.
        oil_each_share: swept volume of each cylinder and side, at most.
        thrust_share: supply pressure × bore area of each cylinder, at most.
        moment_arm_share: smallest moment arm over the joint range, at least.
        transmission: angle between rocker and coupler [rad], at least; or today's smallest, if
            that is lower.
        digging: names of the cylinders whose digging force counts, extending.
        digging_share: their digging torque, at least.
        digging_force: force of cylinders at the tool [N], at least: one alone, extending, supply
            pressure, best angle (ISO 6015).
        buckling_share: Euler safety of each rod, at least.
        buckling_factor: buckling load over the thrust of one cylinder, at least; None: no such
            limit.
        buckling_column: what buckles then: "rod", all of the open cylinder as thick as the rod
            (Euler); "stepped", barrel and rod.
        pin_box: how far each pin coordinate may move in its link [m]; None: 2.5 % of the largest
            distance from the first joint to the tool.
        pin_boxes: other boxes [m] for pins, by cylinder and pin (``base``, ``rod_end``).
        cylinder_mass: estimated mass of all cylinders together [kg], at most; None: no such limit.
        speeds: motions at pump flow.
        lifts: masses to hold at given poses or places.
        outlines: of links, for the pins on them.
        clearances: of barrels from links.
    """

    end_margin: float = 0.02
    holding_share: float = 0.87
    oil_total_share: float = 1.0
    oil_each_share: float = 1.1
    thrust_share: float = 1.1
    moment_arm_share: float = 0.8
    transmission: float = 20 * deg
    digging: tuple[str, ...] = ()
    digging_share: float = 0.95
    digging_force: Mapping[str, float] = field(default_factory=dict)
    buckling_share: float = 1.0
    buckling_factor: float | None = None
    buckling_column: Literal["rod", "stepped"] = "rod"
    pin_box: float | None = None
    pin_boxes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    cylinder_mass: float | None = None
    speeds: tuple[Speed, ...] = ()
    lifts: tuple[Lift, ...] = ()
    outlines: tuple[Outline, ...] = ()
    clearances: tuple[Clearance, ...] = ()

    def __post_init__(self) -> None:
        for path, value in _numbers("requirements", vars(self)):
            if not np.isfinite(value):
                raise ArmDesignError(path, f"{value!r} is not allowed", "give a finite number")
        for name, value in vars(self).items():
            if isinstance(value, float | int) and value < 0:
                raise ArmDesignError(
                    f"requirements.{name}", f"{value!r} is not allowed", "give a number ≥ 0"
                )
        _one_of("buckling_column", self.buckling_column, ("rod", "stepped"))
        for speed in self.speeds:
            _one_of(f"speed.{speed.name}.at", speed.at, ("mean", "every"))
        for link, points in (
            *((outline.link, outline.points) for outline in self.outlines),
            *((clearance.link, clearance.points) for clearance in self.clearances),
        ):
            if len(points) < 3:
                raise ArmDesignError(
                    f"requirements: outline on {link}",
                    f"has {len(points)} points",
                    "give at least 3",
                )

    def __hash__(self) -> int:
        return hash(repr(self))

    @classmethod
    def of(cls, machine: Machine) -> Requirements:
        """The requirements that the machine's file states; of cylinders that stand still none."""
        section, at_work = machine.section.requirements, _at_work(machine)
        speeds = [_speed(machine, name, speed) for name, speed in section.speed.items()]
        clearances = [
            _clearance(name, clearance, at_work) for name, clearance in section.clearance.items()
        ]
        return cls(
            end_margin=section.end_margin,
            holding_share=section.holding_share,
            oil_total_share=section.oil_total_share,
            oil_each_share=section.oil_each_share,
            thrust_share=section.thrust_share,
            moment_arm_share=section.moment_arm_share,
            transmission=section.transmission_deg * deg,
            digging=tuple(filter(at_work, section.digging.cylinders)) if section.digging else (),
            digging_share=section.digging.share if section.digging else 0.95,
            digging_force={
                name: force * kN for name, force in section.digging_kN.items() if at_work(name)
            },
            buckling_share=section.buckling_share,
            buckling_factor=section.buckling_factor,
            buckling_column=section.buckling_column,
            pin_box=None if section.pin_box_mm is None else section.pin_box_mm * mm,
            pin_boxes={
                name: boxes for name, boxes in _pin_boxes(section).items() if at_work(name)
            },
            cylinder_mass=section.cylinder_mass_kg,
            speeds=tuple(speed for speed in speeds if speed.joints or speed.cylinders),
            lifts=tuple(_lift(machine, name, lift) for name, lift in section.lift.items()),
            outlines=tuple(_outline(link, outline) for link, outline in section.outline.items()),
            clearances=tuple(clearance for clearance in clearances if clearance.cylinders),
        )

    def setting(self, path: str) -> float:
        """A number by its key under ``[requirements]`` of a machine file, in that key's unit.

        See ``with_setting``.
        """
        head, *rest = path.split(".", 1)
        if head == "speed":
            return 1.0
        if head in _LISTS:
            own, key, attribute, unit = _LISTS[head]
            name = rest[0].removesuffix(f".{key}")
            found = next(
                one for one in getattr(self, own) if getattr(one, _NAMED.get(own, "name")) == name
            )
            return float(getattr(found, attribute) / unit)
        if head == "digging_kN":
            return float(self.digging_force[rest[0]] / kN)
        attribute, unit = _NUMBERS[path]
        return float(getattr(self, attribute) / unit)

    def with_setting(self, path: str, value: float) -> Requirements:
        """The requirements with a number changed by its key under ``[requirements]``, in that key's unit.

        ``speed.NAME`` stands for all speeds of a motion; ``value`` is then a factor on them.
        """
        head, *rest = path.split(".", 1)
        if head == "speed":
            return replace(
                self, speeds=tuple(s.times(value) if s.name == rest[0] else s for s in self.speeds)
            )
        if head in _LISTS:
            own, key, attribute, unit = _LISTS[head]
            name, named = rest[0].removesuffix(f".{key}"), _NAMED.get(own, "name")
            ones = (
                replace(one, **{attribute: value * unit}) if getattr(one, named) == name else one
                for one in getattr(self, own)
            )
            listed: dict[str, Any] = {own: tuple(ones)}
            return replace(self, **listed)
        if head == "digging_kN":
            return replace(self, digging_force={**self.digging_force, rest[0]: value * kN})
        attribute, unit = _NUMBERS[path]
        changes: dict[str, Any] = {attribute: value * unit}
        return replace(self, **changes)

    def granting(self, conflict: Iterable[Concession]) -> Requirements:
        """The requirements that give what a conflict says, all of it: settings as ``Concession.value`` has them."""
        changed = self
        for concession in conflict:
            if concession.value is not None:
                changed = changed.with_setting(concession.setting, concession.value)
        return changed

    def box(self, machine: Machine, workspace: Workspace) -> float:
        """How far pin coordinates may move where no box of their own is given [m]."""
        if self.pin_box is not None:
            return self.pin_box
        tool = machine.arm.point(workspace.rigid, machine.tool.link, np.array(machine.tool.at))
        return float(
            0.025 * np.linalg.norm(tool - workspace.rigid.translation[:, 0], axis=1).max()
        )

    def box_of(self, cylinder: str, pin: str, common: float) -> float:
        """How far the coordinates of one pin may move [m].

        ``common`` where no box of its own is given.
        """
        return self.pin_boxes.get(cylinder, {}).get(pin, common)

    def refuse_unknown(self, machine: Machine) -> None:
        """Raise where a requirement names a cylinder, joint or link that the machine does not have.

        Raises:
            ArmDesignError: such a name.
        """
        cylinders = [cylinder.name for cylinder in machine.cylinders]
        named: list[tuple[str, str, Collection[str], Collection[str]]] = [
            ("digging", "cylinder", self.digging, cylinders),
            ("digging_force", "cylinder", self.digging_force, cylinders),
            ("pin_boxes", "cylinder", self.pin_boxes, cylinders),
            *(
                (f"pin_boxes.{name}", "pin", box, ("base", "rod_end"))
                for name, box in self.pin_boxes.items()
            ),
            ("outline", "link", [outline.link for outline in self.outlines], machine.arm.links),
        ]
        for speed in self.speeds:
            named += [(f"speed.{speed.name}", "joint", speed.joints, machine.joints)]
            named += [(f"speed.{speed.name}", "cylinder", speed.cylinders, cylinders)]
        for lift in self.lifts:
            named += [(f"lift.{lift.name}", "joint", lift.joints, machine.joints)]
            named += [
                (f"lift.{lift.name}", "link", [lift.link] if lift.link else [], machine.arm.links)
            ]
        for clearance in self.clearances:
            named += [(f"clearance.{clearance.name}", "cylinder", clearance.cylinders, cylinders)]
            named += [(f"clearance.{clearance.name}", "link", [clearance.link], machine.arm.links)]
        for path, kind, names, known in named:
            for name in names:
                if name not in known:
                    raise ArmDesignError(
                        f"requirements.{path}", f'no {kind} "{name}"', choose(name, known)
                    )


def _one_of(name: str, word: str, known: tuple[str, ...]) -> None:
    if word not in known:
        raise ArmDesignError(
            f"requirements.{name}",
            f"{word!r} is not allowed",
            f"give {' or '.join(map(repr, known))}",
        )


def _at_work(machine: Machine) -> Callable[[str], bool]:
    """Whether a cylinder of the file moves a joint.

    True of a name that the file does not have, which is a fault.
    """
    return lambda name: name not in machine.idle


def _numbers(path: str, value: Any) -> Iterator[tuple[str, float]]:
    """Every number within settings, with its path."""
    if isinstance(value, float | int) and not isinstance(value, bool):
        yield path, value
    elif isinstance(value, Mapping):
        for name, part in value.items():
            yield from _numbers(f"{path}.{name}", part)
    elif isinstance(value, tuple):
        for part in value:
            yield from _numbers(path, part)
    elif isinstance(value, Speed | Lift | Outline | Clearance):
        yield from _numbers(path, vars(value))


def _pin_boxes(section: RequirementsSection) -> dict[str, dict[str, float]]:
    return {
        name: {pin: box * mm for pin, box in boxes.model_dump().items() if box is not None}
        for name, boxes in section.pin_boxes_mm.items()
    }


def _joints(
    machine: Machine, path: str, turning: Mapping[str, float], sliding: Mapping[str, float]
) -> dict[str, float]:
    """Numbers by joint [rad, m], from those in degrees and those in millimetres."""
    for key, given, revolute in (("deg", turning, True), ("mm", sliding, False)):
        for name in given:
            if machine.arm.joints[machine.joints.index(name)].revolute != revolute:
                kind, other = ("slides", "mm") if revolute else ("turns", "deg")
                raise MachineFileError(
                    f"{machine.source.name}: requirements.{path}",
                    f'"{name}" {kind}, so nothing of it is in {key}',
                    f"give it in {other}",
                    machine.line_of(f"requirements.{path}"),
                )
    return {name: value * deg for name, value in turning.items()} | {
        n: value * mm for n, value in sliding.items()
    }


def _speed(machine: Machine, name: str, section: SpeedSection) -> Speed:
    return Speed(
        name=name,
        joints=_joints(machine, f"speed.{name}", section.joint_deg_per_s, section.joint_mm_per_s),
        cylinders={
            name: value * mm
            for name, value in section.cylinder_mm_per_s.items()
            if _at_work(machine)(name)
        },
        at=section.at,
    )


def _lift(machine: Machine, name: str, section: LiftSection) -> Lift:
    x, y, z = (value * mm for value in section.at_mm or (0.0, 0.0, 0.0))
    return Lift(
        name=name,
        mass=section.mass_kg,
        link=section.link,
        at=None if section.at_mm is None else (x, y, z),
        joints=_joints(machine, f"lift.{name}", section.joint_deg, section.joint_mm),
        reach=None if section.reach_mm is None else section.reach_mm * mm,
        height=None if section.height_mm is None else section.height_mm * mm,
    )


def _outlined(points: list[list[float]]) -> Outlined:
    return tuple((x * mm, z * mm) for x, z in points)


def _outline(link: str, section: OutlineSection) -> Outline:
    return Outline(
        link=link, points=_outlined(section.points_mm), pin_radius=section.pin_radius_mm * mm
    )


def _clearance(name: str, section: ClearanceSection, at_work: Callable[[str], bool]) -> Clearance:
    return Clearance(
        name=name,
        cylinders=tuple(filter(at_work, section.cylinders)),
        link=section.link,
        points=_outlined(section.points_mm),
        distance=section.distance_mm * mm,
    )
