"""The 4/3 proportional valve and the friction of a cylinder: their data."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Valve:
    """A 4/3 valve for all parallel cylinders of a function together.

    ``rated_flow`` [m³/s] passes one fully open metering edge at ``rated_drop`` [Pa]; the spool answers its command as a
    second-order lag (``natural_frequency`` [Hz], ``damping_ratio``); ``overlap`` is the share of the spool's travel without
    flow; ``leakage`` [m³/s/Pa] passes the piston.
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
