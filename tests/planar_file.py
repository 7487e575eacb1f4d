"""The machine file and URDF of a planar arm, read without `armdesign`: see `reference_planar`."""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np

DEFAULTS = dict(
    end_margin=0.02,
    holding_share=0.87,
    oil_total_share=1.0,
    oil_each_share=1.1,
    thrust_share=1.1,
    moment_arm_share=0.8,
    transmission_deg=20.0,
)


@dataclass(frozen=True)
class Frame:
    """Where a link hangs: on `parent`, at (x, z), turned by `angle`, and by q[joint] if `joint` is
    not None.
    """

    parent: str
    x: float
    z: float
    angle: float
    joint: int | None


@dataclass(frozen=True)
class Body:
    """A rigid mass on a link: centre of mass (x, z) in the link's frame, inertia about it."""

    link: str
    mass: float
    x: float
    z: float
    inertia: float


@dataclass(frozen=True)
class Pin:
    link: str
    x: float
    z: float


@dataclass(frozen=True)
class FourBar:
    pivot: Pin
    lug: Pin
    rocker: float
    coupler: float
    side: int  # +1: the knee lies left of pivot → lug


@dataclass(frozen=True)
class Cylinder:
    name: str
    count: int
    bore: float
    rod: float
    stroke: float
    closed: float
    dead_cap: float
    dead_annulus: float
    compliance: float  # in series [m/N]
    base: Pin
    rod_end: Pin | None
    four_bar: FourBar | None

    @property
    def bore_area(self):
        """Bore side of all parallel cylinders together [m²]."""
        return self.count * np.pi / 4 * self.bore**2

    @property
    def annulus_area(self):
        return self.count * np.pi / 4 * (self.bore**2 - self.rod**2)


@dataclass(frozen=True)
class Payload:
    name: str
    body: Body | None  # None: nothing there
    pitch: tuple[float, float] | None  # [rad], of the link's x axis; None: always held


def read_pin(table):
    x, _, z = table["at_mm"]
    return Pin(table["link"], x / 1000, z / 1000)


def read_payload(name, table):
    mass = table.get("mass_kg", 0)
    pitch = table.get("pitch_deg")
    body = None
    if "link" in table:
        pin = read_pin({"at_mm": (0, 0, 0)} | table)
        body = Body(pin.link, mass, pin.x, pin.z, 0.0)
    elif mass or pitch:
        raise ValueError(f"payload {name} needs a link")
    return Payload(name, body, None if pitch is None else tuple(np.radians(pitch)))


def read_cylinder(name, table):
    bar = table.get("four_bar")
    odd = {key: table.get(key) for key in ("barrel_kg", "rod_kg") if table.get(key)}
    odd |= {key: bar.get(key) for key in ("rocker_kg", "coupler_kg") if bar and bar.get(key)}
    if any(table.get("hose", {}).get(key) for key in ("cap_l", "annulus_l")):
        odd["hose"] = table["hose"]
    if odd:
        raise NotImplementedError(f"{name} cylinder: {odd}")
    dead = table.get("dead_volume_l", {})
    return Cylinder(
        name=name,
        count=table.get("count", 1),
        bore=table["bore_mm"] / 1000,
        rod=table["rod_mm"] / 1000,
        stroke=table["stroke_mm"] / 1000,
        closed=table["closed_length_mm"] / 1000,
        dead_cap=dead.get("cap", 0) / 1000,
        dead_annulus=dead.get("annulus", 0) / 1000,
        compliance=table.get("compliance_m_per_N", 0.0),
        base=read_pin(table["base"]),
        rod_end=None if bar else read_pin(table["rod_end"]),
        four_bar=bar
        and FourBar(
            pivot=read_pin(bar["pivot"]),
            lug=read_pin(bar["lug"]),
            rocker=bar["rocker_mm"] / 1000,
            coupler=bar["coupler_mm"] / 1000,
            side={"left": 1, "right": -1}[bar["knee"]],
        ),
    )


def _limits(joint):
    if joint.get("type") == "continuous":
        return -np.pi, np.pi
    limit = joint.find("limit")
    return float(limit.get("lower")), float(limit.get("upper"))


def read_urdf(text, joints, frozen):
    """Links by name, bodies, and the limits of `joints`, from a URDF whose moving joints turn
    about −y.
    """
    root = ElementTree.fromstring(text)
    links, limits = {}, [None] * len(joints)
    for joint in root.iter("joint"):
        if joint.find("parent") is None:  # e.g. inside a <transmission>
            continue
        name, kind = joint.get("name"), joint.get("type")
        x, z, angle = _planar_origin(joint)
        planar = kind in ("revolute", "continuous") and _vector(
            joint.find("axis"), "xyz", "1 0 0"
        ) == [0, -1, 0]
        if name in joints:
            if not planar:
                raise NotImplementedError(f"joint {name} does not turn about -y")
            limits[joints.index(name)] = _limits(joint)
        elif kind != "fixed":
            value = frozen[name]
            if planar:
                angle += value
            elif value:
                raise NotImplementedError(f"joint {name} frozen at {value}: out of the plane")
        moving = joints.index(name) if name in joints else None
        links[joint.find("child").get("link")] = Frame(
            joint.find("parent").get("link"), x, z, angle, moving
        )
    bodies = []
    for link in root.findall("link"):
        if (inertial := link.find("inertial")) is not None:
            x, z, _ = _planar_origin(inertial)
            mass, inertia = (
                float(inertial.find("mass").get("value")),
                float(inertial.find("inertia").get("iyy")),
            )
            bodies.append(Body(link.get("name"), mass, x, z, inertia))
    return links, bodies, limits


def _planar_origin(element):
    """x, z and the counter-clockwise turn in the plane (minus the URDF's pitch, which is about
    +y).
    """
    origin = element.find("origin")
    x, _, z = _vector(origin, "xyz", "0 0 0")
    roll, pitch, yaw = _vector(origin, "rpy", "0 0 0")
    if roll or yaw:
        raise NotImplementedError("frames turned out of the plane")
    return x, z, -pitch


def _vector(element, key, default):
    return [
        float(value)
        for value in (default if element is None else element.get(key, default)).split()
    ]
