"""A machine as SDF at one pose, with cylinders and four-bars whose loops are closed.

SDF allows joints that close loops, so that rods end on their pins by joints of their own. Joints
are 0 at the pose, and limits count from there. Frozen joints are fixed. Loads are left out, as
in a URDF. Springs hold the arm without them at rest at the pose. Names that SDF keeps for itself
are refused.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.visuals import Visual, visuals
from armdesign.errors import ArmDesignError
from armdesign.exchange.cylinder_bodies import CylinderBody, cylinder_bodies
from armdesign.exchange.inertials import MOMENTS, PRODUCTS, Inertial, light_mass
from armdesign.exchange.urdf import folder_of, urdf
from armdesign.machine.load_case import NO_LOAD
from armdesign.machine.poses import joint_positions
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.spring import Spring
from armdesign.mechanism.urdf import attribute, of_roll_pitch_yaw, roll_pitch_yaw
from armdesign.mechanism.urdf_faults import numbers
from armdesign.simulation.plant.springs import settled

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

VERSION = "1.7"  # the first with relative_to
RESERVED = re.compile(r"world|__.*__|.*::.*", re.DOTALL)
INERTIA = (*MOMENTS, *PRODUCTS)


def sdf(machine: Machine, pose: ArrayLike | None = None) -> str:
    """Text of the SDF at a pose q (nq,) [rad, m]; default: the middle of the joint ranges.

    Raises:
        ArmDesignError: a name that SDF keeps for itself.
        PoseError: not one number per joint, a four-bar does not close, or of a machine with
            springs a pose that it cannot take.
    """
    q = joint_positions(machine, middle_pose(machine) if pose is None else pose)[:1]
    rigid, light = machine.arm.kinematics(q), light_mass(machine)
    document = ET.Element("sdf", version=VERSION)
    model = ET.SubElement(document, "model", name=machine.name)
    _add_links(machine, model, rigid)
    _add_joints(settled(replace(machine, payload=NO_LOAD), q), model, rigid)
    for body in cylinder_bodies(machine, q, q[0]):
        _add_body(model, body, Inertial.of_bar(body, light))
    for element in model.iter():
        if RESERVED.fullmatch(name := element.get("name", "")):
            fault = f'SDF keeps the name "{name}" of a {element.tag} for itself'
            raise ArmDesignError(machine.name, fault, "rename it, or leave out the format sdf")
    ET.indent(document)
    text = ET.tostring(document, encoding="unicode")
    remark = (
        f"{machine.name}, exported by armdesign. Units: m, kg, rad; joints are 0 at this pose."
        f" Bodies of {light:.3g} kg have their mass within the links, or are frames."
    )
    return f'<?xml version="1.0"?>\n<!-- {remark} -->\n{text}\n'


# ------------------------------------------------------------------------------------------- links


def _add_links(machine: Machine, model: ET.Element, rigid: RigidPoses) -> None:
    robot = ET.fromstring(urdf(machine))
    own = {str(link.get("name")): link for link in robot.findall("link")}
    drawn = visuals(ET.tostring(robot, encoding="unicode"), folder_of(machine))
    for name in machine.arm.links:
        link = ET.SubElement(model, "link", name=name)
        place = machine.arm.point(rigid, name, np.zeros(3))[0]
        _add_pose(link, place, machine.arm.link_rotation(rigid, name)[0])
        inertial = own[name].find("inertial")
        if inertial is None:
            _add_own_inertial(link, Inertial.of_frame(machine))
        else:
            origin, inertia = inertial.find("origin"), inertial.find("inertia")
            frame = np.concatenate(
                [numbers(origin, "xyz", "0 0 0"), numbers(origin, "rpy", "0 0 0")]
            )
            moments = [float(numbers(inertia, key, "0")[0]) for key in INERTIA]
            mass = float(numbers(inertial.find("mass"), "value", "0")[0])
            _add_inertial(link, mass, frame, moments)
        for index, visual in enumerate(drawn[name]):
            _add_visual(link, f"visual_{index}", visual)


def _add_inertial(link: ET.Element, mass: float, frame: Array, moments: list[float]) -> None:
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "pose").text = attribute(frame)
    ET.SubElement(inertial, "mass").text = repr(mass)
    inertia = ET.SubElement(inertial, "inertia")
    for key, value in zip(INERTIA, moments, strict=True):
        ET.SubElement(inertia, key).text = repr(float(value))


def _add_own_inertial(link: ET.Element, own: Inertial) -> None:
    frame = np.array([own.centre, 0.0, 0.0, 0.0, 0.0, 0.0])
    _add_inertial(link, own.mass, frame, [*own.moments, 0.0, 0.0, 0.0])


def _add_visual(link: ET.Element, name: str, visual: Visual) -> None:
    element = ET.SubElement(link, "visual", name=name)
    _add_pose(element, visual.translation, visual.rotation)
    shape = ET.SubElement(ET.SubElement(element, "geometry"), visual.kind)
    if visual.kind == "box":
        ET.SubElement(shape, "size").text = attribute(visual.size)
    elif visual.kind == "mesh":
        ET.SubElement(shape, "uri").text = str(visual.mesh)
        ET.SubElement(shape, "scale").text = attribute(visual.size)
    else:
        for key, value in zip(("radius", "length"), visual.size, strict=False):
            ET.SubElement(shape, key).text = repr(float(value))
    if visual.colour:
        _add_colour(element, visual.colour)


def _add_colour(element: ET.Element, colour: tuple[float, ...]) -> None:
    material = ET.SubElement(element, "material")
    for key in ("ambient", "diffuse"):
        ET.SubElement(material, key).text = " ".join(f"{x:g}" for x in colour)


def _add_pose(element: ET.Element, place: Array, rotation: Array, relative_to: str = "") -> None:
    attributes = {"relative_to": relative_to} if relative_to else {}
    pose = ET.SubElement(element, "pose", attributes)
    pose.text = attribute([*place, *roll_pitch_yaw(rotation)])


# ------------------------------------------------------------------------------------------ joints


def _add_joints(machine: Machine, model: ET.Element, rigid: RigidPoses) -> None:
    """Joints of the arm, and one that fixes the root to the world."""
    root = _joint(model, "world", "fixed", "world", machine.arm.root)
    ET.SubElement(root, "pose").text = "0 0 0 0 0 0"
    positions = dict(
        zip(
            (joint.name for joint in machine.arm.coordinates),
            machine.arm.with_springs(rigid.q)[0],
            strict=True,
        )
    )
    coordinates = {joint.name: joint for joint in machine.arm.coordinates}
    springs = {spring.joint: spring for spring in machine.springs}
    for element in ET.fromstring(machine.arm.xml).findall("joint"):
        name = str(element.get("name"))
        ends = (element.find(tag) for tag in ("parent", "child"))
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        moving = coordinates.get(name)
        kind = "fixed" if moving is None else "revolute" if moving.revolute else "prismatic"
        joint = _joint(model, name, kind, parent, child)
        if moving is not None:
            limits = moving.lower - positions[name], moving.upper - positions[name]
            _add_axis(joint, moving.axis, limits)
        if name in springs:
            _add_spring(joint, springs[name])


def _joint(model: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    links = {link.get("name") for link in model.findall("link")}
    name = f"{name}_joint"  # links and joints share one space of names
    while name in links:
        name += "_"
    joint = ET.SubElement(model, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent").text = parent
    ET.SubElement(joint, "child").text = child
    return joint


def _add_axis(joint: ET.Element, axis: ArrayLike, limits: tuple[float, float] | None) -> None:
    """Axis of a joint in its own frame, which stands at the child's, with its limits."""
    element = ET.SubElement(joint, "axis")
    ET.SubElement(element, "xyz").text = attribute(np.asarray(axis, dtype=float))
    if limits is not None:
        limit = ET.SubElement(element, "limit")
        for key, value in zip(("lower", "upper"), limits, strict=True):
            ET.SubElement(limit, key).text = repr(float(value))


def _add_spring(joint: ET.Element, spring: Spring) -> None:
    """A spring that carries its preload where the joint is 0: κ times the reference."""
    assert spring.preload is not None
    reference = spring.preload / spring.stiffness
    names = "damping", "spring_reference", "spring_stiffness"
    dynamics = ET.SubElement(joint.findall("axis")[0], "dynamics")
    for key, value in zip(names, (spring.damping, reference, spring.stiffness), strict=True):
        ET.SubElement(dynamics, key).text = repr(float(value))


# --------------------------------------------------------------------------------------- cylinders


def _add_body(model: ET.Element, body: CylinderBody, own: Inertial) -> None:
    """A body of a cylinder or four-bar, its joint, and the joint that closes its loop."""
    link = ET.SubElement(model, "link", name=body.name)
    _add_pose(link, np.array(body.place), of_roll_pitch_yaw(*body.turn), body.parent)
    _add_own_inertial(link, own)
    span = body.span[1] - body.span[0]
    for index, offset in enumerate(body.offsets if span > 0 else ()):
        shape = Visual(
            kind="cylinder",
            size=np.array([body.diameter / 2, span]),
            rotation=of_roll_pitch_yaw(0.0, np.pi / 2, 0.0),
            translation=np.array([sum(body.span) / 2, offset, 0.0]),
            colour=body.colour,
        )
        _add_visual(link, f"visual_{index}", shape)
    kind = "prismatic" if body.kind == "prismatic" else "revolute"
    _add_axis(_joint(model, body.name, kind, body.parent, body.name), body.axis, body.limits)
    if body.closes is not None:
        # a ball: the loop's hinges keep it in its plane already, one more would be redundant
        joint = _joint(model, f"{body.name}_end", "ball", body.closes, body.name)
        ET.SubElement(joint, "pose").text = attribute([*body.end, 0.0, 0.0, 0.0])
