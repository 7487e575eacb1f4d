"""Static equilibrium of a plant: pressures and spools that hold a pose's load, leaking or not.

The valves are closed, but for what makes up for leakage and underlap. A closed valve leaves a load
to one chamber. A valve that leaks, or with an underlap, holds nothing by itself: its spool stands
where both chambers gain as much as they lose, and the flow fixes both pressures.
What cannot be held starts from there, too, and is said in words.

Along the line A1 p1 − A2 p2 = F both pressures rise from those behind a closed valve to the
supply's. At each point the oil that a chamber gains rises with the spool on its way, so that it
gains nothing at one position, or within an interval where its edges are closed or have no pressure
drop, or nowhere in reach. The load stands where cap and annulus have a position in common: at an
end of the line, or where the position of one passes the position of the other. (Where they only
touch, as at p1 = p2 under leakage across the piston alone, counts where they pass nowhere: it is
found as a line without length.)
The law is ``hydraulics.port``: edges, leakage, reliefs and load-holding valves are all in it.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, Numbers
from armdesign.errors import PoseError, SimulationError
from armdesign.hydraulics.actuator import Actuator, Motor
from armdesign.hydraulics.fluid import Supply
from armdesign.hydraulics.oil_spring import BELOW_RELIEF, preloaded_pressures
from armdesign.machine.poses import Poses
from armdesign.simulation.plant.compiled import Record, compiled
from armdesign.simulation.plant.hydraulics import port, pump_flow
from armdesign.simulation.plant.plant import Plant
from armdesign.units import bar, kN

POINTS = 200  # of the line, between which there is at most one balance
HALVINGS = 60
OUT_OF_REACH = 2.0  # a spool position beyond its ends
NEGLIGIBLE = 1e-9  # of what an edge of rated size passes under a bar

# First and last spool position at which the cap gains nothing, and the annulus.
Intervals: TypeAlias = tuple[float, float, float, float]


class PortLaw(NamedTuple):
    """Data of the flows of an actuator's ports, but for chamber pressures and spool."""

    actuator: Record  # record ``ACTUATOR``
    system: Record  # record ``SYSTEM``
    supply: float  # pressure at the valve [Pa]


@compiled
def balance(law: PortLaw, low: Array, high: Array) -> tuple[float, float, float, bool]:
    """The balance of lowest pressures at which the positions of cap and annulus pass each other.

    Pressures of cap and annulus [Pa], spool, and whether there is such a balance.

    Args:
        law: of the ports.
        low: pressures of cap and annulus (2,) [Pa] that hold the load behind a closed valve.
        high: the same under the largest pressure that is looked at.
    """
    start, end = _bracket(law, low, high)
    side = _apart(_positions(law, low, high, start))
    for _ in range(HALVINGS):
        middle = (start + end) / 2
        if _apart(_positions(law, low, high, middle)) * side > 0:
            start = middle
        else:
            end = middle
    one, other = _positions(law, low, high, start), _positions(law, low, high, end)
    least = max(min(one[0], other[0]), min(one[2], other[2]))
    most = min(max(one[1], other[1]), max(one[3], other[3]))
    spool = min(max(0.0, least), most)
    cap, annulus = _on_line(low, high, end)
    left = max(abs(_gain(law, 0, cap, annulus, spool)), abs(_gain(law, 1, annulus, cap, spool)))
    negligible = NEGLIGIBLE * law.actuator.gain * np.sqrt(bar)
    return cap, annulus, spool, left < negligible and abs(spool) < 1


@compiled
def _bracket(law: PortLaw, low: Array, high: Array) -> tuple[float, float]:
    """Shares of the line between which cap and annulus first get a position in common."""
    start, end, last = 0.0, 0.0, _apart(_positions(law, low, high, 0.0))
    points = POINTS if high[0] > low[0] else 0
    for k in range(1, points + 1):
        if last == 0.0:
            break
        end = k / points
        side = _apart(_positions(law, low, high, end))
        if side * last < 0:
            break
        if side == 0.0:
            start = start if abs(last) == 1.0 else end
            break
        start, last = end, side
    return start, end


@compiled
def _on_line(low: Array, high: Array, share: float) -> tuple[float, float]:
    """Pressures of cap and annulus, at both ends exactly those given."""
    return (1 - share) * low[0] + share * high[0], (1 - share) * low[1] + share * high[1]


@compiled
def _positions(law: PortLaw, low: Array, high: Array, share: float) -> Intervals:
    """Intervals of spool positions in which the cap gains nothing, and the annulus."""
    cap, annulus = _on_line(low, high, share)
    first, last = _closed_interval(law, 0, cap, annulus)
    begin, end = _closed_interval(law, 1, annulus, cap)
    return first, last, -end, -begin


@compiled
def _apart(positions: Intervals) -> float:
    """Side of the cap's interval: 1 beyond the annulus's, −1 before, 0 they meet, NaN none."""
    first, last, begin, end = positions
    if abs(first) == OUT_OF_REACH and first == begin:
        return np.nan
    return 1.0 if first > end else -1.0 if last < begin else 0.0


@compiled
def _closed_interval(law: PortLaw, side: int, own: float, other: float) -> tuple[float, float]:
    """First and last spool position on a chamber's own way at which it gains nothing."""
    way = 1.0 if side == 0 else -1.0
    ends = _gain(law, side, own, other, -way), _gain(law, side, own, other, way)
    if ends[0] > 0:
        return -OUT_OF_REACH, -OUT_OF_REACH
    if ends[1] < 0:
        return OUT_OF_REACH, OUT_OF_REACH
    first = (-1.0, -1.0) if ends[0] == 0 else (-1.0, 1.0)
    last = (1.0, 1.0) if ends[1] == 0 else (-1.0, 1.0)
    for _ in range(HALVINGS):
        middle = (first[0] + first[1]) / 2
        losing = _gain(law, side, own, other, way * middle) < 0
        first = (middle, first[1]) if losing else (first[0], middle)
        middle = (last[0] + last[1]) / 2
        gaining = _gain(law, side, own, other, way * middle) > 0
        last = (last[0], middle) if gaining else (middle, last[1])
    return first[1], last[0]


@compiled
def _gain(law: PortLaw, side: int, own: float, other: float, spool: float) -> float:
    """Oil that a chamber gains [m³/s] while its piston stands."""
    from_supply, to_return, leakage = port(
        law.actuator, law.system, side, own, other, spool, law.supply
    )
    return from_supply - to_return + leakage


class StaticHold(NamedTuple):
    """Static hold of a load by an actuator."""

    cap: float  # pressure [Pa]
    annulus: float  # pressure [Pa]
    spool: float = 0.0  # position −1…1
    overcome: str = ""  # in words, that its relief cannot hold the load; else empty
    creeps: str = ""  # in words, that oil leaks which no spool position makes up for; else empty


class Equilibrium(NamedTuple):
    """A state of equilibrium, and how every actuator holds its load there, or why it does not."""

    state: Array  # (size,)
    holdings: tuple[StaticHold, ...]  # of the actuators, in order


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
    poses = plant.machine.at(q)
    if len(poses) != 1:
        raise PoseError(f"{plant.machine.name}: q", f"holds {len(poses)} poses", "give one")
    return _equilibrium(plant, poses, preloaded)


def _equilibrium(plant: Plant, poses: Poses, preloaded: bool | None) -> Equilibrium:
    """Equilibrium at one pose."""
    from scipy.optimize import brentq

    pump = plant.parameters.systems[0]

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


def rest_states(plant: Plant, poses: Poses, preloaded: bool | None = None) -> Array:
    """States of equilibrium (n, size) of one machine at poses, as ``find_equilibrium`` has them.

    At once where all valves are tight, else pose by pose.
    """
    actuators, supply = plant.machine.actuators, plant.machine.supply
    if preloaded is not False and any(one.valve and one.valve.leaks for one in actuators):
        rows = range(len(poses))
        return np.array([_equilibrium(plant, poses[k : k + 1], preloaded).state for k in rows])
    pairs = zip(actuators, poses.cylinder_forces.T, strict=True)
    pressures = [closed_pressures(one, supply, force, preloaded) for one, force in pairs]
    line = float(plant.parameters.systems["pressure"][0])
    return plant.states_at(poses.q, np.array(pressures).transpose(2, 1, 0), line, 0.0)


def refuse_overcome(plant: Plant, poses: Poses) -> None:
    """Refuse the first of the poses of one machine at which a load presses a relief open.

    Raises:
        SimulationError: names all such actuators there.
    """
    actuators, supply = plant.machine.actuators, plant.machine.supply
    pairs = list(zip(actuators, poses.cylinder_forces.T, strict=True))
    largest = [np.maximum(*closed_pressures(one, supply, f, False)) for one, f in pairs]
    beyond = np.stack(largest) > np.array([[one.relief(supply)] for one in actuators])
    if not beyond.any():
        return
    row = int(beyond.any(axis=0).argmax())
    words = [_closed_hold(one, supply, float(f[row]), False).overcome for one, f in pairs]
    remedy = "raise relief_bar, or choose a lighter load, a larger cylinder or another pose"
    raise SimulationError(f"{plant.machine.name}: rest", "; ".join(filter(None, words)), remedy)


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
) -> StaticHold:
    """Hold of a static force [N, + pushes] by one actuator.

    A valve that leaks but has no balance is taken as closed, as is every valve with ``preloaded``
    (see ``find_equilibrium``) False. The law of its ports is at the supply pressure that they see.
    """
    closed = _closed_hold(actuator, supply, force, preloaded)
    if closed.overcome or actuator.valve is None or not actuator.valve.leaks or preloaded is False:
        return closed
    unloaded = _closed_hold(actuator, supply, force, False)
    low, high = np.array(unloaded[:2]), _highest_pressures(actuator, force, law.supply)
    # Where nothing leaks across the piston the balance is at equal pressures, a single point.
    equal = np.full(2, _equal_pressure(actuator, force))
    for ends in ((low, high), (equal, equal)):
        cap, annulus, spool, balanced = balance(law, *ends)
        if balanced and ends[0].min() >= low.min():
            return StaticHold(cap, annulus, spool)
    words = "valve leaks, and at no spool position does it make up for that: the load creeps"
    return closed._replace(creeps=f"{actuator.name}'s {words}")


def _closed_hold(
    actuator: Actuator, supply: Supply, force: float, preloaded: bool | None
) -> StaticHold:
    """Hold of a static force [N, + pushes] behind a closed valve."""
    cap, annulus = map(float, closed_pressures(actuator, supply, force, preloaded))
    unloaded = tuple(map(float, closed_pressures(actuator, supply, force, False)))
    return StaticHold(cap, annulus, overcome=_overcome(actuator, supply, force, unloaded))


def closed_pressures(
    actuator: Actuator, supply: Supply, force: Numbers, preloaded: bool | None
) -> tuple[Numbers, Numbers]:
    """Pressures of cap and annulus [Pa] behind a closed valve, elementwise over forces [N].

    ``preloaded``: p1 + p2 = supply + return is what a matched symmetric valve leaves when it moves
    about its middle (Merritt 1967, ch. 5), with neither chamber below return pressure. Any preload
    is less where it would press the loaded chamber against its relief.
    """
    back, areas = supply.return_pressure, (actuator.bore_area, actuator.annulus_area)
    relief = actuator.relief(supply)
    common: Numbers = actuator.preload(back) if preloaded is None else back
    if preloaded:
        total = supply.pressure + back
        middle = (force + areas[1] * total) / sum(areas)
        common = np.minimum(np.minimum(middle, total - middle), BELOW_RELIEF * relief)
    return preloaded_pressures(force, *areas, common, back, relief)


def _overcome(
    actuator: Actuator, supply: Supply, force: float, pressures: tuple[float, ...]
) -> str:
    """That the relief of a chamber opens under the load alone, in words; empty if it does not."""
    relief, largest = actuator.relief(supply), max(pressures)
    if largest <= relief:
        return ""
    chamber = actuator.chamber(int(np.argmax(pressures)))
    load = f"{abs(force) / kN:.3g} {'kN m' if isinstance(actuator, Motor) else 'kN'}"
    return (
        f"the relief of {chamber} cannot hold {load}: that needs"
        f" {largest / bar:.4g} bar, it opens at {relief / bar:.4g} bar"
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
