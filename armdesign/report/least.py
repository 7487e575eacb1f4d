"""The least amount that a frequency needs, in words."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armdesign.design.least import amounts
from armdesign.report.maps import LOWEST
from armdesign.units import WORKSHOP, Units, litre, percent

if TYPE_CHECKING:
    from armdesign.design.design import Design

MORE = 1.01  # times what was asked for: other requirements, or steps of sizes, need the amount
NAMES = {"oil": "Oil of all cap sides", "flow": "Pump flow", "mass": "Mass of all cylinders"}


def least_sentence(design: Design, of: str, frequency: float, units: Units = WORKSHOP) -> str:
    """The answer of ``least``: the amount today and new, and the frequency that it allows.

    The worst is sought between the poses too; what was asked for, ``frequency`` [Hz], counts at
    the poses alone. Where they have more, less of it would not make the amount less.
    """
    before, after = amounts(design, of)
    unit = {"oil": "m³", "flow": "m³/s", "mass": "kg"}[of]
    decimals = None
    if of == "mass" or (of == "oil" and units is WORKSHOP):  # three digits that count
        shown = before if of == "mass" else before / litre
        decimals = max(2 - math.floor(math.log10(shown)), 0)
    one, other = (units.number(amount, unit, decimals) for amount in (before, after))
    change = percent(after / before - 1)
    today, new = (f"{m.worst.frequency:.3f}" for m in (design.before, design.after))
    within = "" if design.made_for == "nominal" else " within the bands"
    judged = f"{design.judged:.3f}"
    asked = f"; {LOWEST}{within}: {judged} Hz" if within or judged != new else ""
    asked += f", {frequency:.4g} Hz asked for"
    if design.judged > MORE * frequency:
        asked += ": other requirements, or rounding to steps of sizes, ask for that much"
    return (
        f"{NAMES[of]}: {one} → {other} {units.name(unit)} ({change}); worst natural frequency"
        f" {today} → {new} Hz{asked}."
    )
