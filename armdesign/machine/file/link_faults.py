"""Faults of ``[links]``, each at its key: those that a URDF can have, in the file's own units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from armdesign.errors import choose
from armdesign.machine.file.links import LinkSection
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.links import inertia, joint_of, limits_of
from armdesign.mechanism.urdf_faults import MOVABLE, fault_of_inertia, fault_of_roots, rings
from armdesign.units import deg

Fault = tuple[str, str, str]  # key path, words, remedy
JOINT_KEYS = ("type", "joint", "at_mm", "turn_deg", "axis", "limits_deg", "limits_mm")
LIMITS = {"revolute": "limits_deg", "prismatic": "limits_mm"}


def link_faults(machine: MachineSection) -> Iterator[Fault]:
    """Every fault of the links, and of the joints that the file names, where it has ``[links]``.

    A file gives them or names a URDF, not both: no number has two places.
    """
    links = machine.links
    if (machine.urdf is None) == (not links):
        words, path = ("both", "urdf") if links else ("neither", "links")
        fault = f"{words} urdf {'and' if links else 'nor'} [links] given"
        yield path, fault, "give exactly one of them: the name of a URDF, or the links themselves"
        return
    for name, link in links.items():
        path = f"links.{name}"
        yield from _of_mass(path, link)
        yield from (_of_root(path, link) if link.parent is None else _of_joint(path, link))
    yield from _of_tree(links)
    yield from _of_joint_names(links)
    if links:
        yield from _of_named_joints(machine)


def _of_mass(path: str, link: LinkSection) -> Iterator[Fault]:
    """A mass with a place and an inertia, of a body that can be."""
    given = link.inertia_kg_m2
    if link.mass_kg == 0:
        for key in ("centre_mm", "inertia_kg_m2"):
            if getattr(link, key) is not None:
                yield f"{path}.{key}", "is of a link without mass", "add mass_kg"
        return
    if link.length_mm is None and link.centre_mm is None:
        remedy = "add centre_mm, or length_mm where it is in the middle"
        yield f"{path}.centre_mm", "missing: a mass has a centre", remedy
    if given is not None and link.box_mm is not None:
        fault = "both inertia_kg_m2 and box_mm given"
        yield f"{path}.box_mm", fault, "give one of them"
    elif given is not None and len(given) not in (3, 6):
        fault, remedy = f"{len(given)} values are not allowed", "give xx, yy, zz, or those and"
        yield f"{path}.inertia_kg_m2", fault, f"{remedy} xy, xz, yz"
    elif given is not None and (wrong := fault_of_inertia(inertia(link))):
        yield f"{path}.inertia_kg_m2", *wrong
    elif given is None and link.box_mm is None and link.length_mm is None:
        remedy = "add inertia_kg_m2, box_mm, or length_mm for a slender bar"
        yield f"{path}.inertia_kg_m2", "missing: a mass has an inertia", remedy


def _of_root(path: str, link: LinkSection) -> Iterator[Fault]:
    for key in JOINT_KEYS:
        if getattr(link, key) is not None:
            fault = "is of a joint, but the link has no parent"
            yield f"{path}.{key}", fault, "add parent, or leave it out"


def _of_joint(path: str, link: LinkSection) -> Iterator[Fault]:
    """An axis with a length, and limits of the joint's own type, in order."""
    if link.axis is not None and math.hypot(*link.axis) < 1e-6:
        yield f"{path}.axis", "the axis has no length", "give a direction such as [0, -1, 0]"
    if link.axis is not None and link.kind == "fixed":
        yield f"{path}.axis", "is of a joint that moves, but this one is fixed", "leave it out"
    own = LIMITS.get(link.kind)
    for key in LIMITS.values():
        limits = getattr(link, key)
        if limits is not None and key != own:
            remedy = f"give {own}" if own else "leave them out"
            yield f"{path}.{key}", f"are not of a {link.kind} joint", remedy
        elif limits is not None and limits[0] >= limits[1]:
            fault = f"limits [{limits[0]:g}, {limits[1]:g}] are empty"
            yield f"{path}.{key}", fault, "lower must be below upper"


def _of_tree(links: Mapping[str, LinkSection]) -> Iterator[Fault]:
    """Parents that do not exist; else several roots, or links that carry each other."""
    parents = {name: link.parent for name, link in links.items() if link.parent is not None}
    missing = [name for name, parent in parents.items() if parent not in links]
    for name in missing:
        fault = f'no link "{parents[name]}" in [links]'
        yield f"links.{name}.parent", fault, choose(parents[name], links)
    if missing or not links:
        return
    for ring in rings(list(links), parents):
        fault = f"links {', '.join(ring)} are not connected to the root"
        yield f"links.{ring[0]}.parent", fault, "links form one tree: none may carry itself"
        return
    if wrong := fault_of_roots(list(links), parents):
        yield "links", *wrong


def _of_joint_names(links: Mapping[str, LinkSection]) -> Iterator[Fault]:
    carriers: dict[str, str] = {}
    for name, link in links.items():
        if link.parent is None:
            continue
        joint = joint_of(name, link)
        if joint in carriers:
            other = carriers[joint]
            remedy = "give joint another name: default is the name of its link"
            yield f"links.{name}.joint", f'"{joint}" carries "{other}" already', remedy
        carriers.setdefault(joint, name)


def _of_named_joints(machine: MachineSection) -> Iterator[Fault]:
    """Joints of poses, springs and frozen joints: of a type that moves, with limits around it."""
    joints = {joint_of(n, link): (n, link) for n, link in machine.links.items() if link.parent}
    movable = [joint for joint, (_, link) in joints.items() if link.kind in MOVABLE]
    moving = {f"joints.{i}": joint for i, joint in enumerate(machine.joints)}
    moving |= {f"spring.{name}.joint": spring.joint for name, spring in machine.spring.items()}
    for path, joint in (moving | {f"frozen.{name}": name for name in machine.frozen}).items():
        if joint not in joints:
            yield path, f'no joint "{joint}" in [links]', choose(joint, movable)
            continue
        name, link = joints[joint]
        if link.kind not in MOVABLE:
            remedy = f"take it out, or give links.{name} another type"
            yield path, f'joint "{joint}" is fixed', remedy
        elif path in moving and link.kind in LIMITS and limits_of(link) is None:
            remedy = f'add {LIMITS[link.kind]} = [lower, upper], or type = "continuous"'
            remedy = remedy if link.kind == "revolute" else remedy.partition(",")[0]
            yield f"links.{name}.{LIMITS[link.kind]}", "missing: the joint moves", remedy
    for joint, value in machine.frozen.items():
        if joint in joints and joint not in moving.values():
            yield from _of_frozen(joint, value, joints[joint][1])


def _of_frozen(joint: str, value: float, link: LinkSection) -> Iterator[Fault]:
    """A frozen joint [rad or m] stands within its limits."""
    limits = limits_of(link)
    if limits is None or limits[0] <= value <= limits[1]:
        return
    low, high = limits
    unit = "m" if link.kind == "prismatic" else "rad"
    remedy = f"give {unit} within them"
    if unit == "rad" and low <= value * deg <= high:
        remedy = f"it looks like degrees: write {value * deg:.6g}"
    fault = f"{value:g} {unit} is outside the limits [{low:.5g}, {high:.5g}] {unit} of its joint"
    yield f"frozen.{joint}", fault, remedy
