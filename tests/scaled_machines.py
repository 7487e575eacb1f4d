"""Machines of other lengths and masses, by the scaling laws."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from armdesign import Machine
from armdesign.machine.file import toml_writing
from tests.machines import words


def scaled(
    machine: Machine, *, length: float = 1.0, mass: float = 1.0, modulus: float = 1.0
) -> Machine:
    """The same machine with all lengths, all masses and the moduli of oil and hoses times a factor
    each.
    """
    robot = ET.fromstring(machine.urdf_text)
    for origin in robot.iter("origin"):
        origin.set(
            "xyz", words(tuple(length * float(x) for x in origin.get("xyz", "0 0 0").split()))
        )
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
    changes: dict[str, object] = {}

    def visit(table: dict[str, object], path: str) -> None:
        for key, value in table.items():
            where = f"{path}{key}"
            volume = path.endswith(("dead_volume_l.", "hose.")) and key in (
                "cap",
                "annulus",
                "cap_l",
                "annulus_l",
            )
            factor = (
                length**3
                if volume
                else mass
                if key == "mass_kg"
                else modulus
                if key == "bulk_modulus_MPa"
                else length
            )
            if isinstance(value, dict):
                visit(value, f"{where}.")
            elif key == "compliance_m_per_N" and value:
                # keeps its share of the oil's compliance
                changes[where] = value / (length * modulus)
            elif (
                volume
                or key in ("mass_kg", "bulk_modulus_MPa")
                or (key.endswith("_mm") and value is not None)
            ):
                changes[where] = (
                    [factor * x for x in value] if isinstance(value, list) else factor * value
                )

    kept = {"tool", "payload", "fluid", "cylinder"}
    visit(machine.section.model_dump(include=kept, exclude_unset=True), "")
    text = toml_writing.edit(machine.text, changes, "scaled.toml")
    return Machine.from_text(text, ET.tostring(robot, encoding="unicode"), machine.source)
