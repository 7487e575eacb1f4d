"""The 4/3 proportional valve and the load-holding valve: their data and their laws.

The laws are elementwise: they take numbers, or arrays of one shape, as do the fields of the data
they are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from armdesign.arrays import Array, Numbers

LAMINAR_DROP = 0.5e5  # [Pa] below about this drop the flow through a metering edge is laminar
RELIEF_SHARE = 1.1  # of the supply pressure, where port reliefs open
TIGHT = 1e-5  # leakage of a valve that still counts as shut, over the rated flow at the same drop


@dataclass(frozen=True, kw_only=True)
class Edges:
    """Gains of the four metering edges relative to the rated one."""

    supply_to_cap: float = 1.0
    supply_to_annulus: float = 1.0
    cap_to_return: float = 1.0
    annulus_to_return: float = 1.0


EQUAL_EDGES = Edges()


@dataclass(frozen=True, kw_only=True)
class Valve:
    """A 4/3 valve for all parallel cylinders of an actuator together.

    ``rated_flow`` [m³/s] passes one fully open metering edge at ``rated_drop`` [Pa], times the
    gain of that edge in ``edges``; the spool answers its command as a second-order lag
    (``natural_frequency`` [Hz], ``damping_ratio``) and moves at ``fastest`` [1/s] at most;
    ``overlap`` is the share of the spool's travel without flow (negative: underlap, both edges of
    a port open about the middle); ``leakage`` [m³/s/Pa] passes the piston, ``tank_leakage`` leaves
    each chamber; port reliefs open at ``relief`` [Pa], None: 1.1 × supply pressure. Shut, it
    leaves the chamber without load at ``preload`` [Pa], None: return pressure.
    """

    rated_flow: float
    rated_drop: float
    natural_frequency: float
    damping_ratio: float
    overlap: float = 0.0
    leakage: float = 0.0
    tank_leakage: float = 0.0
    fastest: float = math.inf
    relief: float | None = None
    preload: float | None = None
    edges: Edges = EQUAL_EDGES

    @property
    def gain(self) -> float:
        """Flow over the root of the pressure drop of an open edge of rated size [m³/s/√Pa]."""
        return self.rated_flow / math.sqrt(self.rated_drop)

    @property
    def gains(self) -> tuple[Array, Array]:
        """Of its open edges [m³/s/√Pa]: from the supply to cap and annulus (2,), and back (2,)."""
        edges = self.edges
        into = np.array([edges.supply_to_cap, edges.supply_to_annulus])
        out = np.array([edges.cap_to_return, edges.annulus_to_return])
        return self.gain * into, self.gain * out

    @property
    def without_overlap(self) -> Self:
        """The valve whose edges open at once; of an underlap all stays."""
        return replace(self, overlap=min(self.overlap, 0.0))

    @property
    def leaks(self) -> bool:
        """Whether so much oil flows at rest that flow makes the pressures: leaks, an underlap.

        Leakage below ``TIGHT``, as seals in good order have, does not: for minutes pressures
        stay what a shut valve left, while the load creeps by millimetres.
        """
        leakage = (self.leakage + self.tank_leakage) * self.rated_drop
        return leakage > TIGHT * self.rated_flow or self.overlap < 0


@dataclass(frozen=True, kw_only=True)
class LoadHolding:
    """A counterbalance or pilot-operated check valve between a 4/3 valve and one chamber.

    Oil enters the chamber freely; it leaves only as far as p + pilot_ratio × (pressure of the
    other chamber) exceeds ``setting`` [Pa], and all of it is open ``opening_range`` [Pa] above.
    Open, it passes ``rated_flow`` [m³/s] at ``rated_drop`` [Pa].
    """

    side: Literal["cap", "annulus"]
    setting: float
    pilot_ratio: float
    opening_range: float
    rated_flow: float
    rated_drop: float


def edge_opening(spool: Numbers, overlap: Numbers) -> Numbers:
    """Opening 0…1 of an edge that a positive spool position uncovers."""
    return np.minimum(np.maximum((spool - overlap) / (1 - overlap), 0.0), 1.0)


def edge_opening_slope(spool: Numbers, overlap: Numbers) -> Numbers:
    """Derivative of ``edge_opening`` by the spool position; at a corner the mean of both sides."""
    share = (spool - overlap) / (1 - overlap)
    return np.heaviside(share, 0.5) * np.heaviside(1 - share, 0.5) / (1 - overlap)


def opening(valve: Valve, spool: Numbers) -> Numbers:
    """Net opening −1…1 of a port: to supply less to return; 0 within the overlap."""
    return edge_opening(spool, valve.overlap) - edge_opening(-spool, valve.overlap)


def spool_position(valve: Valve, share: Numbers) -> Numbers:
    """Spool position that opens a share −1…1, the inverse of ``opening``.

    It leaps over an overlap. Within an underlap o both edges of a port are open, so the net
    opening grows twice as fast: a = |share| (1 − o), and the spool stands at max(a + o, a/2). In
    plain operators, fast for a single number too.
    """
    way = abs(share) * (1 - valve.overlap)
    size = 0.75 * way + valve.overlap / 2 + abs(way / 2 + valve.overlap) / 2
    return ((share > 0) * 1.0 - (share < 0) * 1.0) * size


def orifice_flow(gain: Numbers, drop: Numbers) -> Numbers:
    """Flow [m³/s] through an orifice under a pressure drop [Pa] of either sign.

    Q = K Δp/(Δp² + Δp_lam²)^¼ with the gain K [m³/s/√Pa]: K √|Δp| sign Δp (Merritt 1967, ch. 3),
    but laminar, proportional to Δp, near Δp = 0 where the root has no derivative.
    """
    return gain * drop / np.sqrt(np.sqrt(drop * drop + LAMINAR_DROP * LAMINAR_DROP))


def orifice_slope(drop: Numbers) -> Numbers:
    """Derivative of ``orifice_flow`` by the pressure drop, for a gain of 1 [√Pa/Pa]."""
    squared = drop * drop + LAMINAR_DROP * LAMINAR_DROP
    return (1 - drop * drop / (2 * squared)) / np.sqrt(np.sqrt(squared))


def in_series(gain: Numbers, other: Numbers) -> Numbers:
    """Gain of two orifices in series: 1/K² = 1/K1² + 1/K2²; ``other`` may be inf."""
    return gain / np.sqrt(1 + (gain / np.maximum(other, 1e-30)) ** 2)


def in_series_slopes(gain: Numbers, other: Numbers) -> tuple[Numbers, Numbers]:
    """Derivatives of ``in_series`` by both gains."""
    ratio = gain / np.maximum(other, 1e-30)
    least = (1 + ratio**2) ** -1.5
    return least, np.where(other > 1e-30, (ratio / np.sqrt(1 + ratio**2)) ** 3, 0.0)


def spool_acceleration(
    valve: Valve, position: Numbers, speed: Numbers, command: Numbers
) -> Numbers:
    """Acceleration [1/s²] of a spool towards its command: ω² (u − x) − 2 ζ ω ẋ.

    Written as 2 ζ ω (w − ẋ), the spool follows the speed w = ω (u − x)/(2 ζ) with a lag, and w is
    limited to ``fastest``.
    """
    omega = 2 * math.pi * valve.natural_frequency
    way = np.minimum(np.maximum(command, -1.0), 1.0) - position
    wanted = omega / (2 * valve.damping_ratio) * way
    limited = np.minimum(np.maximum(wanted, -valve.fastest), valve.fastest)
    return 2 * valve.damping_ratio * omega * (limited - speed)
