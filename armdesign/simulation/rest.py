"""Static equilibrium of a cylinder: the chamber pressures that hold a force, and where the spool then stands."""

from __future__ import annotations

from collections.abc import Callable

from armdesign.cylinder import Actuator, Supply, static_pressures
from armdesign.valve import Valve, edge_opening, orifice_flow


def holding_pressures(
    cylinder: Actuator, supply: Supply, force: float, preloaded: bool, creeps: bool = False
) -> tuple[float, float, float]:
    """Pressures of cap and annulus [Pa] that hold a static force [N, + pushes], and the spool position that keeps them.

    Shut tight, one more condition is needed. ``preloaded``: p1 + p2 = supply + return, what a matched symmetric valve
    leaves when it moves about its middle (Merritt 1967, ch. 5), with neither chamber below return pressure. Else the
    chamber without load is at return pressure.

    A valve that leaks, or with an underlap, holds nothing by itself: its spool stands where both chambers get as much
    as they lose, and the flow fixes both pressures, whatever ``preloaded``. If there are no such pressures, or if it
    ``creeps``, it is taken as shut.
    """
    shut = _shut(cylinder, supply, force, preloaded)
    valve = cylinder.valve
    if creeps or valve is None or not valve.leaks:
        return (*shut, 0.0)
    return _balanced(cylinder, valve, supply, force) or (*shut, 0.0)


def _shut(cylinder: Actuator, supply: Supply, force: float, preloaded: bool) -> tuple[float, float]:
    bore, ring = cylinder.bore_area, cylinder.annulus_area
    cap, annulus = (float(p) for p in static_pressures(force, bore, ring, supply.return_pressure))
    if not preloaded:
        return cap, annulus
    total = supply.pressure + supply.return_pressure
    middle = (force + ring * total) / (bore + ring)
    return (middle, total - middle) if middle > cap and total - middle > annulus else (cap, annulus)


def _balanced(cylinder: Actuator, valve: Valve, supply: Supply, force: float) -> tuple[float, float, float] | None:
    """Pressures and spool at which neither chamber gains oil while they hold a force; None if there are none.

    The spool that balances the cap moves out as both pressures rise, the one that balances the annulus moves in: there
    is at most one pair of pressures at which they are the same.
    """
    from scipy.optimize import brentq

    bore, ring, low, high = cylinder.bore_area, cylinder.annulus_area, supply.return_pressure, supply.pressure

    def annulus(cap: float) -> float:
        return (bore * cap - force) / ring

    def spools(cap: float) -> list[float]:
        return [_zero(gain) for gain in _gains(valve, supply, cap, annulus(cap))]

    def apart(cap: float) -> float:
        first, second = spools(cap)
        return first - second

    least, most = max(low, (force + ring * low) / bore), min(high, (force + ring * high) / bore)
    room = 1e-6 * (high - low)  # an edge without a pressure drop passes nothing
    if least + room >= most - room or apart(least + room) * apart(most - room) > 0:
        return None
    cap = float(brentq(apart, least + room, most - room, xtol=1e-9 * high))
    spool = spools(cap)[0]
    return (cap, annulus(cap), spool) if abs(spool) < 1 else None


def _zero(gain: Callable[[float], float]) -> float:
    """Spool position −1…1 at which a chamber gains nothing, or the end that comes nearest to it."""
    from scipy.optimize import brentq

    ends = gain(-1.0), gain(1.0)
    if ends[0] * ends[1] > 0:
        return -1.0 if abs(ends[0]) < abs(ends[1]) else 1.0
    return float(brentq(gain, -1.0, 1.0, xtol=1e-15))


def _gains(valve: Valve, supply: Supply, cap: float, annulus: float) -> tuple[Callable[[float], float], ...]:
    """Oil that cap and annulus gain [m³/s] at their pressures [Pa], as functions of the spool's position."""
    edges, across = valve.edges, valve.leakage * (cap - annulus)

    def port(into: float, out: float, pressure: float, spool: float) -> float:
        flow = into * edge_opening(spool, valve.overlap) * orifice_flow(valve.gain, supply.pressure - pressure)
        drop = pressure - supply.return_pressure
        back = out * edge_opening(-spool, valve.overlap) * orifice_flow(valve.gain, drop)
        return float(flow - back - valve.tank_leakage * drop)

    return (
        lambda spool: port(edges.supply_to_cap, edges.cap_to_return, cap, spool) - across,
        lambda spool: port(edges.supply_to_annulus, edges.annulus_to_return, annulus, -spool) + across,
    )
