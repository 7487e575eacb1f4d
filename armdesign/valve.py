"""The 4/3 proportional valve and the friction of a cylinder: their data and their laws.

The laws take plain numbers, one at a time: a simulation calls them a hundred thousand times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LAMINAR_DROP = 0.5e5  # [Pa] below about this drop the flow through a metering edge is laminar


@dataclass(frozen=True, kw_only=True)
class Valve:
    """A 4/3 valve for all parallel cylinders of a function together.

    ``rated_flow`` [m³/s] passes one fully open metering edge at ``rated_drop`` [Pa]; the spool answers its command
    as a second-order lag (``natural_frequency`` [Hz], ``damping_ratio``); ``overlap`` is the share of the spool's
    travel without flow; ``leakage`` [m³/s/Pa] passes the piston.
    """

    rated_flow: float
    rated_drop: float
    natural_frequency: float
    damping_ratio: float
    overlap: float = 0.0
    leakage: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Friction of one cylinder: Coulomb and static [N], Stribeck velocity [m/s], viscous [N s/m]."""

    coulomb: float = 0.0
    static: float = 0.0
    stribeck_velocity: float = 5e-3
    viscous: float = 0.0


def opening(valve: Valve, spool: float) -> float:
    """Share of the metering edges that is open, −1…1, at a spool position; 0 within the overlap."""
    beyond = min(abs(spool), 1.0) - valve.overlap
    return math.copysign(beyond / (1 - valve.overlap), spool) if beyond > 0 else 0.0


def spool_position(valve: Valve, share: float) -> float:
    """Inverse of ``opening``: the spool position that opens a share −1…1; it leaps over the overlap."""
    return math.copysign(valve.overlap, share) + share * (1 - valve.overlap) if share else 0.0


def orifice_flow(valve: Valve, share: float, drop: float) -> float:
    """Flow [m³/s] through one metering edge open by ``share`` under a pressure drop [Pa] of either sign.

    Q = K x Δp/(Δp² + Δp_lam²)^¼ with K = rated flow/√(rated drop): K x √|Δp| sign Δp (Merritt 1967, ch. 3), but
    laminar, proportional to Δp, near Δp = 0 where the root has no derivative.
    """
    gain = valve.rated_flow / math.sqrt(valve.rated_drop)
    return gain * share * drop / (drop * drop + LAMINAR_DROP * LAMINAR_DROP) ** 0.25


def port_flows(
    valve: Valve, share: float, cap: float, annulus: float, supply: float, back: float
) -> tuple[float, float]:
    """Flows [m³/s] into cap and annulus chamber at their pressures [Pa], supply and return pressure.

    Open by a positive share, supply feeds the cap and the annulus drains; by a negative one, the other way round.
    """
    if share >= 0:
        return orifice_flow(valve, share, supply - cap), -orifice_flow(valve, share, annulus - back)
    return -orifice_flow(valve, -share, cap - back), orifice_flow(valve, -share, supply - annulus)


def friction_force(friction: Friction, speed: float) -> float:
    """Friction [N] of one cylinder against its piston's speed [m/s]: Stribeck curve and viscous share.

    F = (F_C + (F_S − F_C) exp(−(v/v_s)²)) tanh(10 v/v_s) + b v; the steep tanh replaces the step at rest.
    """
    ratio = speed / friction.stribeck_velocity
    fade = math.exp(-min(ratio * ratio, 100.0))
    dry = friction.coulomb + (friction.static - friction.coulomb) * fade
    return dry * math.tanh(10 * ratio) + friction.viscous * speed
