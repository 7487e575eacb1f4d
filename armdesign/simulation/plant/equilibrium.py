"""Static equilibrium of a cylinder: the chamber pressures that hold a force, and where the spool then stands."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import Actuator, Motor
from armdesign.hydraulics.chamber_pressures import BELOW_RELIEF, preloaded_pressures
from armdesign.hydraulics.supply import Supply
from armdesign.simulation.plant.balance import balance
from armdesign.units import bar, kN


class Holding(NamedTuple):
    """How an actuator holds its load at rest.

    Attributes:
        cap: pressure [Pa].
        annulus: pressure [Pa].
        spool: position −1…1.
        overcome: in words, that its relief cannot hold the load; else empty.
        creeps: in words, that oil leaks which no spool position makes up for; else empty.
    """

    cap: float
    annulus: float
    spool: float = 0.0
    overcome: str = ""
    creeps: str = ""


def holding_pressures(
    actuator: Actuator,
    supply: Supply,
    force: float,
    preloaded: bool | None,
    law: tuple[Any, Any, float],
) -> Holding:
    """Pressures of cap and annulus that hold a static force [N, + pushes], and the spool position that keeps them.

    Shut tight, a valve leaves the load to one chamber, and the other at return pressure or at its
    preload: None. ``preloaded``: p1 + p2 = supply + return, what a matched symmetric valve leaves
    when it moves about its middle (Merritt 1967, ch. 5), with neither chamber below return
    pressure. Either is less where it would press the loaded chamber against its relief. Not
    preloaded, False: return pressure.

    A valve that leaks, or with an underlap, holds nothing by itself: its spool stands where both
    chambers get as much as they lose, and the flow fixes both pressures, whatever ``preloaded``:
    see ``balance``. If there are none, it is taken as shut, as it is where False asks for it.

    Args:
        actuator: cylinder or motor.
        supply: its pump.
        force: that it holds.
        preloaded: None, True or False as above.
        law: records of actuator and system, as ``hydraulics`` makes them, and the supply pressure
            at the valve [Pa].
    """
    cap, annulus = _shut(actuator, supply, force, preloaded)
    if words := _overcome(actuator, supply, force):
        return Holding(cap, annulus, overcome=words)
    if actuator.valve is None or not actuator.valve.leaks or preloaded is False:
        return Holding(cap, annulus)
    low, high = _line(actuator, supply, force, law[2])
    even = np.full(2, _even(actuator, force))  # where nothing leaks across the piston
    for ends in ((low, high), (even, even)):
        *stands, found = balance(law, *ends)
        if found and ends[0].min() >= low.min():
            return Holding(*stands)
    words = (
        f"{actuator.name}'s valve leaks, and at no spool position does it make up for that: the"
        " load creeps"
    )
    return Holding(cap, annulus, creeps=words)


def _shut(
    actuator: Actuator, supply: Supply, force: float, preloaded: bool | None
) -> tuple[float, float]:
    """Pressures of cap and annulus [Pa] behind a tight valve."""
    back, areas = supply.return_pressure, (actuator.bore_area, actuator.annulus_area)
    relief = actuator.relief(supply)
    common = actuator.preload(back) if preloaded is None else back
    if preloaded:
        total = supply.pressure + back
        middle = (force + areas[1] * total) / sum(areas)
        common = min(middle, total - middle, BELOW_RELIEF * relief)
    cap, annulus = preloaded_pressures(force, *areas, common, back, relief)
    return float(cap), float(annulus)


def _overcome(actuator: Actuator, supply: Supply, force: float) -> str:
    """That the relief of a chamber opens under the load alone, in words; empty if it does not."""
    relief = actuator.relief(supply)
    pressures = _shut(actuator, supply, force, preloaded=False)
    if max(pressures) <= relief:
        return ""
    side = ("cap", "annulus")[int(np.argmax(pressures))]
    load = f"{abs(force) / kN:.3g} {'kN m' if isinstance(actuator, Motor) else 'kN'}"
    return (
        f"the relief of {actuator.name}'s {side} cannot hold {load}: that needs"
        f" {max(pressures) / bar:.0f} bar, it opens at {relief / bar:.0f} bar"
    )


def _even(actuator: Actuator, force: float) -> float:
    """Pressure [Pa] that holds a force in both chambers alike; 0 where none does."""
    rod = actuator.bore_area - actuator.annulus_area
    return max(force / rod, 0.0) if rod > 0 else 0.0


def _line(actuator: Actuator, supply: Supply, force: float, most: float) -> tuple[Array, Array]:
    """Pressures of cap and annulus (2,) that hold a force: one chamber at return pressure.

    One at the ``most``.
    """
    bore, ring = actuator.bore_area, actuator.annulus_area
    high = np.array([most, (bore * most - force) / ring])
    if high[1] > most:
        high = np.array([(force + ring * most) / bore, most])
    return np.array(_shut(actuator, supply, force, preloaded=False)), high
