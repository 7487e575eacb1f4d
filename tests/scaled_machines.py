"""Machines of other lengths and masses, by the scaling laws."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from armdesign import Machine
from armdesign.machine.file import toml_writing
from tests.machines import words

VOLUMES = ("cap", "annulus", "cap_l", "annulus_l")


def scaled(
    machine: Machine, *, length: float = 1.0, mass: float = 1.0, modulus: float = 1.0
) -> Machine:
    """The same machine with all lengths, all masses and the moduli of oil and hoses times a factor
    each.
    """
    changes: dict[str, object] = {}

    def factor_of(key: str, path: str) -> float | None:
        """Of a number with a key in a table; None where it stays."""
        if path.endswith(("dead_volume_l.", "hose.")) and key in VOLUMES:
            return length**3
        if key == "compliance_m_per_N":  # keeps its share of the oil's compliance
            return 1 / (length * modulus)
        others = {"mass_kg": mass, "bulk_modulus_MPa": modulus}
        return others.get(key, length if key.endswith("_mm") else None)

    def visit(table: dict[str, object], path: str) -> None:
        for key, value in table.items():
            factor = factor_of(key, path)
            if isinstance(value, dict):
                visit(value, f"{path}{key}.")
            elif factor is not None and isinstance(value, list):
                changes[f"{path}{key}"] = [factor * x for x in value]
            elif factor is not None and isinstance(value, int | float):
                changes[f"{path}{key}"] = factor * value

    kept = {"tool", "payload", "fluid", "cylinder"}
    visit(machine.section.model_dump(include=kept, exclude_unset=True), "")
    text = toml_writing.edit(machine.text, changes, "scaled.toml")
    robot = _scaled_robot(machine.urdf_text, length, mass)
    return Machine.from_text(text, ET.tostring(robot, encoding="unicode"), machine.source)


def _scaled_robot(urdf: str, length: float, mass: float) -> ET.Element:
    robot = ET.fromstring(urdf)
    for origin in robot.iter("origin"):
        place = tuple(length * float(x) for x in origin.get("xyz", "0 0 0").split())
        origin.set("xyz", words(place))
    for element in robot.iter("mass"):
        element.set("value", repr(mass * float(element.get("value", "0"))))
    for element in robot.iter("inertia"):
        for key, value in element.items():
            element.set(key, repr(mass * length**2 * float(value)))
    for joint in robot.iter("joint"):
        if joint.get("type") == "prismatic":
            for limit in joint.iter("limit"):
                for key in ("lower", "upper"):
                    limit.set(key, repr(length * float(limit.get(key, "0"))))
    return robot
