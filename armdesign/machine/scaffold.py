"""A starting machine file and URDF for a boom with one to six links, with plausible numbers.

Every number is to be replaced.

The links form a chain that folds downwards; each joint has one pin-to-pin cylinder, whose stroke
covers the joint's range. The proportions are of small loader booms: the arms of the triangle
joint, base pin, rod-end pin scale with the length of the link that carries the base. Booms of more
than four links have larger ones before the boom of four, as concrete pumps do.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from armdesign.errors import ArmDesignError
from armdesign.machine.file.schema import NAME_LENGTH, NAME_PATTERN
from armdesign.units import deg, mm

NAMES = {
    1: ("boom",),
    2: ("boom", "stick"),
    3: ("boom", "stick", "bucket"),
    4: ("boom", "jib", "stick", "bucket"),
}
LENGTHS = {1: (3.0,), 2: (3.0, 2.0), 3: (3.0, 2.0, 1.0), 4: (3.0, 2.0, 1.5, 1.0)}  # [m]
MASS_PER_LENGTH = (100.0, 75.0, 55.0, 40.0)  # [kg/m]
SIZES = ((100, 56), (80, 45), (50, 28), (40, 22))  # bore, rod [mm]
SECTION = (0.22, 0.17, 0.13, 0.10)  # height of a link's box [m]
# links before the longest boom's own: length [m], mass per length [kg/m], bore, rod [mm],
# height [m]
LARGER = ((3.5, 130.0, 120, 70, 0.26), (4.0, 160.0, 135, 80, 0.30))
MOST = 4 + len(LARGER)
FOOT = 1.0  # height of the boom-foot pin [m]
PAYLOADS = {1: 1500, 2: 500, 3: 250, 4: 150}  # [kg]
LIGHT = 100  # payload of a boom with more links [kg]
WHAT_DESIGNS_KEEP = """\
[requirements]                          # what a new design must keep; all optional, see README
end_margin = 0.02                       # share of the stroke that stays free at both ends
holding_share = 0.87                    # static load over what the supply holds

[bands]                                 # what is not known exactly; a design is made for all of it
structure = [0.0, 1.0]                  \
# estimate: what the structure yields, over what the oil does

# [spring.carriage]                     # a joint of the URDF, not one of joints, that yields
# joint = "rocking"                     # of carriage, outriggers, pillar, slew gear …
# stiffness_N_m_per_rad = 2.5e7         # of a joint that slides: stiffness_N_per_m
# damping_ratio = 0.05
"""
OIL_AND_PUMP = """\
[fluid]
bulk_modulus_MPa = 1200                 # replace: effective; 700 (hoses) to 1500 (steel lines)
entrained_air_percent = 0.0
density_kg_per_m3 = 870

[supply]
pressure_bar = 250                      # replace: relief pressure
return_pressure_bar = 5
flow_l_per_min = 60                     # replace: pump flow at working speed
"""


@dataclass(frozen=True)
class _BoomStage:
    """A link with its joint and cylinder; angles [rad], pins [mm] in carrier and link."""

    name: str
    carrier: str
    at: float  # place of the joint along the carrier [m]
    length: float
    mass: float
    height: float
    lower: float
    upper: float
    bore: int
    rod: int
    base: tuple[int, int]
    rod_end: tuple[int, int]

    def distance(self, q: float) -> float:
        """Length of the cylinder [mm] at a joint position."""
        x, z = self.rod_end
        at = (x * math.cos(q) - z * math.sin(q) + self.at / mm, x * math.sin(q) + z * math.cos(q))
        return math.dist(self.base, at)

    @property
    def ends(self) -> tuple[int, int]:
        """Closed and open length [mm] that cover the joint's range."""
        lengths = (self.distance(self.lower), self.distance(self.upper))
        return math.floor(min(lengths)), math.ceil(max(lengths))


def _links(links: int) -> list[tuple[str, float, float, int, int, float]]:
    """Name, length [m], mass per length [kg/m], bore, rod [mm] and height [m] of each link."""
    known = min(links, 4)
    columns = zip(LENGTHS[known], MASS_PER_LENGTH, SIZES, SECTION, strict=False)
    chosen = [(length, mass, *size, height) for length, mass, size, height in columns]
    chosen = [*reversed(LARGER[: links - known]), *chosen]
    names = NAMES.get(links, ("boom", *(f"section_{i}" for i in range(2, links)), "bucket"))
    return [(name, *values) for name, values in zip(names, chosen, strict=True)]


def _stages(links: int) -> list[_BoomStage]:
    stages: list[_BoomStage] = []
    for name, length, mass_per_length, bore, rod, height in _links(links):
        at = stages[-1].length if stages else 0.0
        if not stages:  # from below: the cylinder pushes the boom up
            base, rod_end = _polar(0.2 * length, -50), _polar(0.4667 * length, 15)
            lower, upper = -25.0, 45.0
        else:  # from above: the cylinder folds the link down
            x, z = _polar(0.37 * at, 160)
            base, rod_end = (round(at / mm) + x, z), _polar(0.17 * at, 165)
            lower, upper = -130.0, -50.0
        carrier, mass = stages[-1].name if stages else "base", length * mass_per_length
        ends, pins = (lower * deg, upper * deg), (base, rod_end)
        stages.append(_BoomStage(name, carrier, at, length, mass, height, *ends, bore, rod, *pins))
    return stages


def _polar(radius: float, degrees: float) -> tuple[int, int]:
    """Place (x, z) [mm] at a distance [m] and angle from a joint."""
    angle = degrees * deg
    return round(radius * math.cos(angle) / mm), round(radius * math.sin(angle) / mm)


def new(name: str, links: int) -> tuple[str, str]:
    """Texts of the machine file and its URDF.

    Args:
        name: of the machine and its files.
        links: 1 to 6.

    Raises:
        ArmDesignError: a name that no machine can have, or another number of links.
    """
    if not re.match(NAME_PATTERN, name) or len(name) > NAME_LENGTH or name.endswith("\n"):
        remedy = f"start with a letter, then letters, digits, _ or -, at most {NAME_LENGTH}"
        raise ArmDesignError("name", f'"{name:.70}" is not allowed', remedy)
    if not 1 <= links <= MOST:
        remedy = f"give a whole number from 1 to {MOST}"
        raise ArmDesignError("--links", f"{links} is not allowed", remedy)
    stages = _stages(links)
    return _aligned(_machine_file(name, stages)), _urdf(name, stages)


def _aligned(text: str) -> str:
    """The text with the comments behind its values in one column."""
    return re.sub(r"(?m)^(\S.*?) {2,}(# .*)$", lambda line: f"{line[1]:<54}  {line[2]}", text)


def _machine_file(name: str, stages: list[_BoomStage]) -> str:
    last = stages[-1]
    tip = f'link = "{last.name}", at_mm = [{last.length / mm:.0f}, 0, 0]'
    joints = ", ".join(f'"{stage.name}"' for stage in stages)
    return f"""#:schema ./machine.schema.json
# {name}: a starting point, made by `armdesign new`. EVERY NUMBER IS A \
PLACEHOLDER: replace it and say where it is from.
# Units are in the keys. A link's frame is its parent joint's frame, as in the URDF: \
x along the link, z up at q = 0.
# Then: armdesign check {name}.toml    armdesign map {name}.toml    armdesign design {name}.toml

name   = "{name}"
title  = "{name}"                       # replace: the name that people read
urdf   = "{name}.urdf"
joints = [{joints}]                     # the coordinates, in this order; others are frozen
tool   = {{ {tip} }}                    # replace: the point whose reach and height are reported

# Load cases: the worst one counts.
[payload.empty]
mass_kg = 0

[payload.full]
mass_kg = {PAYLOADS.get(len(stages), LIGHT)}                 \
# replace: a point mass, where its centre hangs
link = "{last.name}"
at_mm = [{last.length / mm:.0f}, 0, 0]
# pitch_deg = [120, 240]                \
# the case exists only while the link's x axis has this pitch

{OIL_AND_PUMP}
{chr(10).join(map(_cylinder, stages))}
{WHAT_DESIGNS_KEEP}"""


def _cylinder(stage: _BoomStage) -> str:
    closed, opened = stage.ends
    return f"""[cylinder.{stage.name}]
count = 1                               # replace: equal cylinders in parallel, sharing pins
bore_mm = {stage.bore}                  # replace
rod_mm = {stage.rod}                    # replace
stroke_mm = {opened - closed}           # replace
closed_length_mm = {closed}             # replace: pin to pin, rod in
dead_volume_l = {{ cap = {_litres(stage)}, annulus = {_litres(stage)} }}  \
# replace: oil in hoses and ports, each side
base    = {{ link = "{stage.carrier}", at_mm = [{stage.base[0]}, 0, {stage.base[1]}] }}  # replace
rod_end = {{ link = "{stage.name}", at_mm = [{stage.rod_end[0]}, 0, \
{stage.rod_end[1]}] }}  # replace
barrel_kg = 0                           # replace: of each cylinder, it moves with its pins
rod_kg = 0

[cylinder.{stage.name}.valve]           # used by validate and design only
rated_flow_l_per_min = 60               # replace: data sheet of the valve
rated_drop_bar = 14                     # replace: per metering edge
natural_frequency_hz = 10               # replace: of the spool
damping_ratio = 0.8
# relief_bar = 275                      # where its port reliefs open; default: 1.1 × supply
# preload_bar = 30                      \
# shut, the chamber without load stands at it; default: return
"""


def _litres(stage: _BoomStage) -> str:
    """A tenth of what the cap side sweeps."""
    closed, opened = stage.ends
    return f"{0.1 * math.pi / 4 * stage.bore**2 * (opened - closed) / 1e6:.2f}"


def _urdf(name: str, stages: list[_BoomStage]) -> str:
    return f"""<?xml version="1.0"?>
<!-- {name}: a starting point, made by `armdesign new`. EVERY NUMBER IS A \
PLACEHOLDER: replace masses, centres of mass,
     inertias, lengths and limits. Units: m, kg, rad. \
x forward, y to the left, z up; positive joint values raise.
     Visuals are plain boxes. -->
<robot name="{name}">
  <material name="paint"><color rgba="0.95 0.70 0.10 1"/></material>
  <material name="steel"><color rgba="0.35 0.37 0.40 1"/></material>

  <!-- what stands still -->
  <link name="ground">
    <visual>
      <origin xyz="0 0 {FOOT / 2:g}"/>
      <geometry><box size="0.5 0.5 {FOOT:g}"/></geometry>
      <material name="steel"/>
    </visual>
  </link>

  <joint name="foot" type="fixed">
    <parent link="ground"/>
    <child link="base"/>
    <origin xyz="0 0 {FOOT:g}" rpy="0 0 0"/>
  </joint>

  <!-- frame at the first joint -->
  <link name="base"/>
{"".join(map(_link, stages))}</robot>
"""


def _link(stage: _BoomStage) -> str:
    m, length, side = stage.mass, stage.length, stage.height
    along, across = m * 2 * side**2 / 12, m * (side**2 + length**2) / 12
    return f"""
  <joint name="{stage.name}" type="revolute">
    <parent link="{stage.carrier}"/>
    <child link="{stage.name}"/>
    <origin xyz="{stage.at:g} 0 0" rpy="0 0 0"/>
    <axis xyz="0 -1 0"/>
    <limit lower="{stage.lower:.4f}" upper="{stage.upper:.4f}" effort="100000" velocity="0.5"/>
  </joint>

  <!-- replace: a box of {length:g} m and {m:g} kg stands for the link -->
  <link name="{stage.name}">
    <inertial>
      <origin xyz="{length / 2:g} 0 0"/>
      <mass value="{m:g}"/>
      <inertia ixx="{along:.4g}" iyy="{across:.4g}" izz="{across:.4g}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>
      <origin xyz="{length / 2:g} 0 0"/>
      <geometry><box size="{length:g} {side:g} {side:g}"/></geometry>
      <material name="paint"/>
    </visual>
  </link>
"""
