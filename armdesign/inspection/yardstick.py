"""Sizes of a machine by which its own numbers are judged.

A small model and a mining shovel are as plausible as a crawler excavator: lengths are judged by
other lengths of the machine.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.assembly_faults import LARGEST_ARM, TURN, Cause
from armdesign.machine.file import machine_file
from armdesign.machine.file.key_paths import unit_of
from armdesign.machine.file.likely_values import likely_units, rounded
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over, sweep
from armdesign.mechanism.urdf import Joint
from armdesign.mechanism.urdf_faults import numbers, parse
from armdesign.units import deg, mm

LEAF = 2.5  # length of an outermost link over the distance of its centre of mass


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An implausible value: its key path or part, and the reason in words."""

    part: str
    words: str


@dataclass(frozen=True, eq=False)
class Yardstick:
    """A machine that can be used, and what its numbers are judged by."""

    machine: Machine  # the machine
    shares: Mapping[str, float]  # by actuator, its largest static force over what the supply holds

    @property
    def largest_share(self) -> float:
        """Largest static force of any actuator over what the supply holds."""
        return max(self.shares.values(), default=0.0)

    @cached_property
    def urdf(self) -> ET.Element:
        """Root element of the URDF, or of the one that stands for ``[links]``."""
        return parse(self.machine.urdf_text, self.machine.section.urdf or self.machine.source.name)

    @cached_property
    def values(self) -> dict[str, Any]:
        """Every value of the machine file by its key path."""
        return machine_file.flat(self.machine.section)

    @cached_property
    def in_millimetres(self) -> bool:
        """Whether the URDF's lengths look like millimetres beside the cylinders'."""
        joints = (joint.translation for joint in self.machine.arm.joints)
        farthest = max(map(_distance, (*joints, *self.centres.values())), default=0.0)
        far = farthest > LARGEST_ARM and farthest > 100 * self.longest_cylinder
        return far and not self.machine.section.links

    @cached_property
    def longest_cylinder(self) -> float:
        """Largest open length of a cylinder [m]."""
        return max((cylinder.open_length for cylinder in self.machine.cylinders), default=0.0)

    @cached_property
    def centres(self) -> dict[str, Array]:
        """Centre of mass of every link that has one, in its frame and the URDF's unit."""
        inertials = ((link, link.find("inertial")) for link in self.urdf.findall("link"))
        return {
            str(link.get("name")): numbers(inertial.find("origin"), "xyz", "0 0 0")
            for link, inertial in inertials
            if inertial is not None
        }

    @cached_property
    def link_sizes(self) -> dict[str, float]:
        """Size of every link [m]: the farthest of its centre of mass and the joints on it.

        A link without joints on it is ``LEAF`` times as long as its centre of mass is far.
        """
        sizes = {link: _distance(at) for link, at in self.centres.items()}
        carrying = set()
        for joint in self.urdf.findall("joint"):
            parent = joint.find("parent")
            link = "" if parent is None else str(parent.get("link"))
            at = _distance(numbers(joint.find("origin"), "xyz", "0 0 0"))
            sizes[link] = max(sizes.get(link, 0.0), at)
            carrying.add(link)
        unit = mm if self.in_millimetres else 1.0
        return {
            link: unit * size * (1.0 if link in carrying else LEAF) for link, size in sizes.items()
        }

    @cached_property
    def largest_size(self) -> float:
        """Size of the largest link [m], or of the longest cylinder where no link has one."""
        return max(self.link_sizes.values(), default=0.0) or LEAF * self.longest_cylinder

    def size(self, link: str | None) -> float:
        """Size of a link [m], or of the largest if the link's own is unknown or tiny."""
        size = self.link_sizes.get(link or "", 0.0)
        return size if size > 0.05 * self.largest_size else self.largest_size

    def span(self, i: int) -> float:
        """Largest distance of a cylinder's pins [m] within joint limits, or its open length."""
        linkage, cylinder = self.machine.linkages[i], self.machine.cylinders[i]
        arm = self.machine.arm
        if len(linkage.joints) != 1 or self.far_limits(arm.joints[linkage.joints[0]]):
            return cylinder.open_length
        joint = linkage.joints[0]
        with np.errstate(invalid="ignore"):
            lengths = linkage.length(sweep(arm, joint, over(arm.limits[joint], 31)))
        return float(np.nanmax(lengths, initial=cylinder.closed_length))

    def far_limits(self, joint: Joint) -> Cause | None:
        """Limits farther apart than any cylinder moves a joint: most likely in another unit.

        Limits in ``[links]`` are in the units that people write.
        """
        if self.machine.section.links:
            return None
        most, factor, unit = 30 * self.longest_cylinder, mm, "millimetres"
        if joint.revolute:
            most, factor, unit = TURN, deg, "degrees, as no cylinder turns a joint so far"
        if max(abs(joint.lower), abs(joint.upper)) <= most:
            return None
        lower, upper = (rounded(limit * factor) for limit in (joint.lower, joint.upper))
        return Cause(
            path="limits",
            words=f"limits [{joint.lower:g}, {joint.upper:g}] {joint.unit} look like {unit}",
            remedy=f'write lower="{lower}" upper="{upper}"',
        )

    def finding(self, path: str, words: str, remedy: str) -> Finding:
        """A finding at a key path, with its line."""
        line = self.machine.line_of(path)
        return Finding(part=path, words=f"{words}: {remedy}" + (f" (line {line})" if line else ""))

    def in_other_unit(
        self, path: str, plausible: Callable[[float], bool], why: str = ""
    ) -> Iterator[Finding]:
        """A finding if the number at a key path would be plausible in another unit."""
        keys, value = tuple(path.split(".")), float(self.values[path])
        if other := likely_units(keys, value, plausible):
            words = f"{rounded(value)} {unit_of(keys).strip()} looks like {other.unit}"
            yield self.finding(path, f"{words}{why and f' ({why})'}", other.remedy)


def _distance(at: Array) -> float:
    return float(np.linalg.norm(at))
