"""Static equilibrium of a plant: chamber pressures and spools that hold a pose's load.

The valves are closed, but for what makes up for leakage and underlap. A closed valve leaves a load
to one chamber. A valve that leaks, or with an underlap, holds nothing by itself: its spool stands
where both chambers gain as much as they lose, and the flow fixes both pressures: see ``balance``.
What cannot be held starts from there, too, and is said in words.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.errors import PoseError, SimulationError
from armdesign.hydraulics.actuator import Actuator, Motor
from armdesign.hydraulics.chamber_pressures import BELOW_RELIEF, preloaded_pressures
from armdesign.hydraulics.supply import Supply
from armdesign.machine.poses import Poses
from armdesign.simulation.plant.balance import PortLaw, balance
from armdesign.simulation.plant.hydraulics import pump_flow
from armdesign.simulation.plant.plant import Plant
from armdesign.units import bar, kN


class Holding(NamedTuple):
    """How an actuator holds its load.

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


class Equilibrium(NamedTuple):
    """A state of equilibrium, and how every actuator holds its load there, or why it does not.

    Attributes:
        state: (size,).
        holdings: of the actuators, in order.
    """

    state: Array
    holdings: tuple[Holding, ...]


def find_equilibrium(plant: Plant, q: ArrayLike, preloaded: bool | None = None) -> Equilibrium:
    """Equilibrium of the plant of one machine at a pose (nq,).

    Where a flow-limited pump has to make up for leaks, its pressure falls until it gives as much.

    Args:
        plant: of one machine.
        q: joint positions [rad, m].
        preloaded: what fixes the pressures that closed valves leave. None: the loaded chamber
            carries the load, the other is at return pressure or at the preload that the machine
            file asks for; so ``check``, maps and ``Machine.at`` have it. True: p1 + p2 = supply +
            return, which keeps both chambers far from cavitation, for measurements; less where a
            relief would open. False: the chamber without load at return pressure whatever the
            file asks for, and valves closed even if they leak: then the load creeps.

    Raises:
        PoseError: the pose cannot be taken.
    """
    from scipy.optimize import brentq

    poses, pump = plant.machine.at(q), plant.parameters.systems[0]
    if len(poses) != 1:
        raise PoseError(f"{plant.machine.name}: q", f"holds {len(poses)} poses", "give one")

    def excess(line: float) -> float:
        state = _under_pressure(plant, poses, preloaded, line).state
        outputs = plant.evaluate(state[None], plant.split(state)[4][None]).outputs
        return float(pump_flow(pump, line) - outputs["supplied"].sum())

    line = float(pump["pressure"])
    full = _under_pressure(plant, poses, preloaded, line)
    if preloaded is False or not plant.has_line or excess(line) >= 0:
        return full
    closed = _under_pressure(plant, poses, False, line).holdings
    least = max(max(one.cap, one.annulus) for one in closed)
    if least < line and excess(least) > 0:
        balanced = float(brentq(excess, least, line, xtol=1e-6))
        return _under_pressure(plant, poses, preloaded, balanced)
    words = "the pump gives less than what the valves let through at rest: its pressure falls"
    return Equilibrium(full.state, (full.holdings[0]._replace(creeps=words), *full.holdings[1:]))


def refuse_overcome(plant: Plant, q: ArrayLike) -> None:
    """Refuse a pose (nq,) of one machine at which a load presses a relief open.

    Raises:
        SimulationError: names all such actuators.
    """
    holdings = find_equilibrium(plant, q, False).holdings
    if words := "; ".join(one.overcome for one in holdings if one.overcome):
        remedy = "raise relief_bar, or choose a lighter load, a larger cylinder or another pose"
        raise SimulationError(f"{plant.machine.name}: rest", words, remedy)


def _under_pressure(
    plant: Plant, poses: Poses, preloaded: bool | None, line: float
) -> Equilibrium:
    """Equilibrium at one pose under a supply pressure [Pa]."""
    actuators, forces = plant.machine.actuators, poses.cylinder_forces[0].tolist()
    rows, system = plant.parameters.actuators[0], plant.parameters.systems[0]
    holdings = tuple(
        holding(actuator, plant.machine.supply, force, preloaded, PortLaw(row, system, line))
        for actuator, row, force in zip(actuators, rows, forces, strict=True)
    )
    pressures = np.array([[one.cap for one in holdings], [one.annulus for one in holdings]])
    spools = [one.spool for one in holdings]
    return Equilibrium(plant.state_at(poses.q[0], pressures, line, spools), holdings)


def holding(
    actuator: Actuator, supply: Supply, force: float, preloaded: bool | None, law: PortLaw
) -> Holding:
    """How one actuator holds a static force [N, + pushes].

    A valve that leaks but has no balance is taken as closed, as is every valve with ``preloaded``
    False.

    Args:
        actuator: cylinder or motor.
        supply: its pump.
        force: that it holds.
        preloaded: see ``find_equilibrium``.
        law: of its ports, at the supply pressure that they see.
    """
    unloaded = _closed_pressures(actuator, supply, force, preloaded=False)
    pressures = unloaded
    if preloaded is not False:
        pressures = _closed_pressures(actuator, supply, force, preloaded)
    if words := _overcome(actuator, supply, force, unloaded):
        return Holding(*pressures, overcome=words)
    if actuator.valve is None or not actuator.valve.leaks or preloaded is False:
        return Holding(*pressures)
    low, high = np.array(unloaded), _highest_pressures(actuator, force, law.supply)
    # Where nothing leaks across the piston the balance is at equal pressures, a single point.
    equal = np.full(2, _equal_pressure(actuator, force))
    for ends in ((low, high), (equal, equal)):
        cap, annulus, spool, balanced = balance(law, *ends)
        if balanced and ends[0].min() >= low.min():
            return Holding(cap, annulus, spool)
    words = (
        f"{actuator.name}'s valve leaks, and at no spool position does it make up for that: the"
        " load creeps"
    )
    return Holding(*pressures, creeps=words)


def _closed_pressures(
    actuator: Actuator, supply: Supply, force: float, preloaded: bool | None
) -> tuple[float, float]:
    """Pressures of cap and annulus [Pa] behind a closed valve.

    ``preloaded``: p1 + p2 = supply + return is what a matched symmetric valve leaves when it moves
    about its middle (Merritt 1967, ch. 5), with neither chamber below return pressure. Any preload
    is less where it would press the loaded chamber against its relief.
    """
    back, areas = supply.return_pressure, (actuator.bore_area, actuator.annulus_area)
    relief = actuator.relief(supply)
    common = actuator.preload(back) if preloaded is None else back
    if preloaded:
        total = supply.pressure + back
        middle = (force + areas[1] * total) / sum(areas)
        common = min(middle, total - middle, BELOW_RELIEF * relief)
    cap, annulus = preloaded_pressures(force, *areas, common, back, relief)
    return float(cap), float(annulus)


def _overcome(
    actuator: Actuator, supply: Supply, force: float, pressures: tuple[float, float]
) -> str:
    """That the relief of a chamber opens under the load alone, in words; empty if it does not."""
    relief, largest = actuator.relief(supply), max(pressures)
    if largest <= relief:
        return ""
    side = ("cap", "annulus")[int(np.argmax(pressures))]
    load = f"{abs(force) / kN:.3g} {'kN m' if isinstance(actuator, Motor) else 'kN'}"
    return (
        f"the relief of {actuator.name}'s {side} cannot hold {load}: that needs"
        f" {largest / bar:.0f} bar, it opens at {relief / bar:.0f} bar"
    )


def _equal_pressure(actuator: Actuator, force: float) -> float:
    """Pressure [Pa] that holds a force in both chambers alike; 0 where none does."""
    rod = actuator.bore_area - actuator.annulus_area
    return max(force / rod, 0.0) if rod > 0 else 0.0


def _highest_pressures(actuator: Actuator, force: float, largest: float) -> Array:
    """Pressures of cap and annulus (2,) that hold a force, one of them the largest [Pa]."""
    bore, ring = actuator.bore_area, actuator.annulus_area
    high = np.array([largest, (bore * largest - force) / ring])
    if high[1] > largest:
        high = np.array([(force + ring * largest) / bore, largest])
    return high
