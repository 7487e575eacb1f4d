"""Tables of a machine file for arms that slew: the motor of a column, what stands still."""

from __future__ import annotations

MOTOR = """
[motor.column]
displacement_cm3 = 250
gear_ratio = 28
trapped_volume_l = { a = 0.6, b = 0.6 }
"""


def stability(mass_kg: float, at_mm: list[float], front_mm: float, rear_mm: float) -> str:
    """What stands still, and the tipping lines."""
    return f"""
[stability]
mass_kg = {mass_kg}
at_mm = {at_mm}
front_mm = {front_mm}
rear_mm = {rear_mm}
"""
