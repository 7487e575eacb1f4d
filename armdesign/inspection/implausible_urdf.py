"""Numbers of a URDF in another unit, and reversed axes."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from armdesign.inspection.finding import Finding
from armdesign.inspection.reference import Reference
from armdesign.machine.assembly_faults import place_in_urdf
from armdesign.machine.file.likely_values import rounded
from armdesign.machine.range_causes import TURN, cause_of
from armdesign.mechanism.urdf_faults import line_of, numbers
from armdesign.units import deg

STOUT = 5.0  # radius of gyration over the size of a link


def of_urdf(reference: Reference) -> Iterator[Finding]:
    """Lengths in mm, angles in degrees, masses and inertias that do not go together."""
    section, urdf = reference.machine.section, reference.urdf
    if reference.in_millimetres:
        words = "its lengths look like millimetres beside the cylinders' lengths: divide them by"
        yield Finding(part=section.urdf, words=f"{words} 1000")
    for element in (*urdf.findall("joint"), *urdf.findall("link")):
        for origin in element.iter("origin"):
            angles = numbers(origin, "rpy", "0 0 0")
            if np.any(np.abs(angles) > TURN):
                radians = " ".join(rounded(float(angle) * deg) for angle in angles)
                words = f'rpy="{origin.get("rpy")}" looks like degrees: write rpy="{radians}"'
                part = f"{element.tag} {element.get('name')}"
                yield Finding(part=part, words=f"{words} (line {line_of(origin)})")
    types = {joint.get("name"): joint.get("type") for joint in urdf.findall("joint")}
    for name, value in section.frozen.items():
        if types.get(name, "prismatic") != "prismatic" and abs(value) > TURN:
            words = f"{value:g} rad looks like degrees"
            yield reference.finding(f"frozen.{name}", words, f"write {rounded(value * deg)}")
    yield from _of_inertias(reference)


def _of_inertias(reference: Reference) -> Iterator[Finding]:
    """Radii of gyration far beyond the size of their links."""
    for link in reference.urdf.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        name = str(link.get("name"))
        size = reference.link_sizes.get(name, 0.0)
        if mass is None or inertia is None or not size:
            continue
        m = float(numbers(mass, "value", "0")[0])
        largest = max(float(numbers(inertia, key, "0")[0]) for key in ("ixx", "iyy", "izz"))
        radius = math.sqrt(largest / m) if m > 0 else 0.0
        if radius > STOUT * max(size, 0.2 * reference.largest_size):
            drawn = radius / 1e3 > 0.02 * size
            cause = "the inertia like kg mm²" if drawn else "the mass like t"
            words = (
                f"an inertia of {largest:g} kg m² at {m:g} kg fits a body of"
                f" {2 * radius:.3g} m, but the link has {size:.3g} m; {cause}"
            )
            yield Finding(part=f"link {name}", words=f"{words} (line {line_of(inertia)})")


def of_joints(reference: Reference) -> Iterator[Finding]:
    """Reversed axes, limits in another unit, lengths with which strokes would fit the limits."""
    machine = reference.machine
    for j, joint in enumerate(machine.arm.joints):
        pairs = zip(machine.linkages, machine.cylinders, strict=True)
        own = [(linkage, cylinder) for linkage, cylinder in pairs if linkage.joints == (j,)]
        if not own:
            continue
        cause = cause_of(machine.arm, j, own, faulty=False) or reference.far_limits(joint)
        if cause is None or cause.path == "urdf":
            continue
        if cause.in_urdf:
            _, line = place_in_urdf(machine, j, cause)
            words = f"{cause.words}: {cause.remedy} (line {line})"
            yield Finding(part=f"joint {joint.name}", words=words)
        else:
            yield reference.finding(cause.path, cause.words, cause.remedy)
