"""Balance of a valve that leaks: pressures and spool at which neither chamber gains oil.

Along the line A1 p1 − A2 p2 = F both pressures rise from those behind a closed valve to the
supply's. At each point the oil that a chamber gains rises with the spool on its way, so that it
gains nothing at one position, or within an interval where its edges are closed or have no pressure
drop, or nowhere in reach. The load stands where cap and annulus have a position in common: at an
end of the line, or where the position of one passes the position of the other. (Where they only
touch, as at p1 = p2 under leakage across the piston alone, it is found as a line without length.)
The law is ``hydraulics.port``: edges, leakage, reliefs and load-holding valves are all in it.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.plant.compiled import Record, compiled
from armdesign.simulation.plant.hydraulics import port
from armdesign.units import bar

POINTS = 200  # of the line, between which there is at most one balance
HALVINGS = 60
OUT_OF_REACH = 2.0  # a spool position beyond its ends
NEGLIGIBLE = 1e-9  # of what an edge of rated size passes under a bar

# First and last spool position at which the cap gains nothing, and the annulus.
Intervals: TypeAlias = tuple[float, float, float, float]


class PortLaw(NamedTuple):
    """What the flows of an actuator's ports depend on, but for chamber pressures and spool.

    Attributes:
        actuator: record ``ACTUATOR``.
        system: record ``SYSTEM``.
        supply: pressure at the valve [Pa].
    """

    actuator: Record
    system: Record
    supply: float


@compiled
def balance(law: PortLaw, low: Array, high: Array) -> tuple[float, float, float, bool]:
    """The balance of lowest pressures: cap and annulus [Pa], spool, and whether there is one.

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
    """Side of the cap's interval: 1 further out than the annulus's, −1 further in, 0 they meet.

    NaN if both are out of reach.
    """
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
