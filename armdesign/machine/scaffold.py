"""A starting machine file and URDF for a boom with one to six links, with plausible numbers.

Every number is to be replaced. The texts are in the templates ``scaffold_….txt`` beside this file.

The links form a chain that folds downwards; each joint has one pin-to-pin cylinder, whose stroke
covers the joint's range. The proportions are of small loader booms: the arms of the triangle
joint, base pin, rod-end pin scale with the length of the link that carries the base. Booms of more
than four links have larger ones before the boom of four, as concrete pumps do.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armdesign.errors import ArmDesignError
from armdesign.machine.file.section import DEVICE, NAME_LENGTH, NAME_PATTERN
from armdesign.units import deg, mm

NAMES = {
    1: ("boom",),
    2: ("boom", "stick"),
    3: ("boom", "stick", "bucket"),
    4: ("boom", "jib", "stick", "bucket"),
}
LENGTHS = {1: (3.0,), 2: (3.0, 2.0), 3: (3.0, 2.0, 1.0), 4: (3.0, 2.0, 1.5, 1.0)}  # [m]
MASS_PER_LENGTH = (100.0, 75.0, 55.0, 40.0)  # [kg/m]
SIZES = ((100, 55), (80, 45), (50, 30), (40, 25))  # bore, rod [mm]
SECTION = (0.22, 0.17, 0.13, 0.10)  # height of a link's box [m]
# links before the longest boom's own: length [m], mass per length [kg/m], bore, rod [mm],
# height [m]
LARGER = ((3.5, 130.0, 120, 70, 0.26), (4.0, 160.0, 135, 80, 0.30))
MOST = 4 + len(LARGER)
FOOT = 1.0  # height of the boom-foot pin [m]
PAYLOADS = {1: 1500, 2: 500, 3: 250, 4: 150}  # [kg]
LIGHT = 100  # payload of a boom with more links [kg]


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
    if DEVICE.fullmatch(name):
        fault = f'"{name}" is a device of Windows, not a file'
        raise ArmDesignError("name", fault, "give another name")
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


def _filled(template: str, **values: Any) -> str:
    """The text of a template beside this file, with its fields filled in."""
    path = Path(__file__).with_name(f"scaffold_{template}.txt")
    return path.read_text(encoding="utf-8").format(**values)


def _machine_file(name: str, stages: list[_BoomStage]) -> str:
    joints = ", ".join(f'"{stage.name}"' for stage in stages)
    payload, tip = PAYLOADS.get(len(stages), LIGHT), stages[-1].length / mm
    values = {"last": stages[-1], "tip": tip, "payload": payload, "joints": joints}
    return _filled(
        "machine.toml", name=name, cylinders="\n".join(map(_cylinder, stages)), **values
    )


def _cylinder(stage: _BoomStage) -> str:
    closed, opened = stage.ends
    litres = 0.1 * math.pi / 4 * stage.bore**2 * (opened - closed) / 1e6  # a tenth of the cap side
    values = {"closed": closed, "stroke": opened - closed, "litres": litres}
    return _filled("cylinder.toml", stage=stage, **values)


def _urdf(name: str, stages: list[_BoomStage]) -> str:
    links = "".join(map(_link, stages))
    return _filled("robot.urdf", name=name, foot=FOOT, middle=FOOT / 2, links=links)


def _link(stage: _BoomStage) -> str:
    m, length, side = stage.mass, stage.length, stage.height
    inertia = {"along": m * 2 * side**2 / 12, "across": m * (side**2 + length**2) / 12}
    return _filled("link.urdf", stage=stage, middle=length / 2, **inertia)
