"""Data of a starting machine file for a boom with one to six links, with plausible numbers.

Every number is to be replaced.

The links form a chain that folds downwards; each joint has one pin-to-pin cylinder, whose stroke
covers the joint's range. The proportions are of small loader booms: the arms of the triangle
joint, base pin, rod-end pin scale with the length of the link that carries the base. Booms of more
than four links have larger ones before the boom of four, as concrete pumps do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from armdesign.errors import ArmDesignError
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
FLUID = {"bulk_modulus_MPa": 1200, "entrained_air_percent": 0.0, "density_kg_per_m3": 870}
SUPPLY = {"pressure_bar": 250, "return_pressure_bar": 5, "flow_l_per_min": 60}
VALVE = {
    "rated_flow_l_per_min": 60,
    "rated_drop_bar": 14,
    "natural_frequency_hz": 10,
    "damping_ratio": 0.8,
}
REQUIREMENTS = {
    "end_margin": 0.02,
    "holding_share": 0.87,
    "lift_share": 0.9,
    "torque_share": 0.95,
    "end_torque_share": 0.8,
    "catalogue": "5mm",
}


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


def data_of(name: str, links: int) -> dict[str, Any]:
    """Data of a starting machine file, by the keys of its tables.

    Args:
        name: of the machine.
        links: 1 to 6.

    Raises:
        ArmDesignError: another number of links.
    """
    if not 1 <= links <= MOST:
        remedy = f"give a whole number from 1 to {MOST}"
        raise ArmDesignError("--links", f"{links} is not allowed", remedy)
    stages = _stages(links)
    last, tip = stages[-1].name, [round(stages[-1].length / mm), 0, 0]
    load = {"mass_kg": PAYLOADS.get(links, LIGHT), "link": last, "at_mm": tip}
    return {
        "name": name,
        "title": name,
        "joints": [stage.name for stage in stages],
        "tool": {"link": last, "at_mm": tip},
        "payload": {"empty": {"mass_kg": 0}, "full": load},
        "fluid": dict(FLUID),
        "supply": dict(SUPPLY),
        "links": {
            "ground": {},
            "base": {"parent": "ground", "type": "fixed", "at_mm": [0, 0, round(FOOT / mm)]},
            **{stage.name: _link(stage) for stage in stages},
        },
        "cylinder": {stage.name: _cylinder(stage) for stage in stages},
        "requirements": dict(REQUIREMENTS),
        "bands": {"structure": [0.0, 1.0]},
    }


def _link(stage: _BoomStage) -> dict[str, Any]:
    length, height = round(stage.length / mm), round(stage.height / mm)
    return {
        "parent": stage.carrier,
        "limits_deg": [round(stage.lower / deg, 6), round(stage.upper / deg, 6)],
        "length_mm": length,
        "mass_kg": round(stage.mass, 6),
        "box_mm": [length, height, height],
    }


def _cylinder(stage: _BoomStage) -> dict[str, Any]:
    closed, opened = stage.ends
    litres = 0.1 * math.pi / 4 * stage.bore**2 * (opened - closed) / 1e6  # a tenth of the cap side
    pins = {"base": (stage.carrier, stage.base), "rod_end": (stage.name, stage.rod_end)}
    return {
        "count": 1,
        "bore_mm": stage.bore,
        "rod_mm": stage.rod,
        "stroke_mm": opened - closed,
        "closed_length_mm": closed,
        "dead_volume_l": {"cap": round(litres, 2), "annulus": round(litres, 2)},
        **{key: {"link": link, "at_mm": [x, 0, z]} for key, (link, (x, z)) in pins.items()},
        "barrel_kg": 0,
        "rod_kg": 0,
        "compliance_m_per_N": 0.0,
        "valve": dict(VALVE),
    }
