"""The mass of a cylinder, estimated from its sizes."""

from __future__ import annotations

import math
from typing import Any

from armdesign.hydraulics.barrel import barrel_ratio

STEEL_DENSITY = 7850.0  # [kg/m³]


def estimated_mass(bore: Any, rod: Any, stroke: Any, pressure: Any) -> Any:
    """Mass of one cylinder [kg]: its steel, without oil, ports and eyes.

    The steel is barrel, bottom, gland, piston and rod. Piston, gland and bottom are each half a
    bore long, the usual proportion; the rod passes through piston and gland. The barrel's wall is
    ``barrel_ratio`` of the pressure. Complex-safe.

    Args:
        bore: inner diameter D [m].
        rod: its diameter d [m].
        stroke: S [m].
        pressure: that the barrel is made for [Pa]; the supply's.
    """
    part = bore / 2
    outer = (barrel_ratio(pressure) * bore) ** 2
    barrel, bottom = (outer - bore**2) * (stroke + 2 * part), outer * part
    rings, bar = (bore**2 - rod**2) * 2 * part, rod**2 * (stroke + 2 * part)
    return STEEL_DENSITY * math.pi / 4 * (barrel + bottom + rings + bar)
