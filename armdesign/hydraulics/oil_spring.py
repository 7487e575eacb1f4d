"""The oil spring: stiffness of the oil that a shut valve traps on both sides of a piston."""

from __future__ import annotations

from typing import Any


def oil_stiffness(
    bore_area: Any,
    annulus_area: Any,
    cap_capacity: Any,
    annulus_capacity: Any,
    compliance: float = 0.0,
) -> Any:
    """Stiffness of two trapped chambers [N/m]: k = A1²/C1 + A2²/C2, in series with a compliance.

    Without hoses C = V/β, which gives k_h = β (A1²/V1 + A2²/V2) (Pencelli et al. 2019, eq. 12
    without its factor 2). Elementwise on arrays, and complex-safe.

    Args:
        bore_area: A1 [m²].
        annulus_area: A2 [m²].
        cap_capacity: C1 = V1/β1 + V_hose/β_hose [m³/Pa].
        annulus_capacity: C2 [m³/Pa].
        compliance: of pins, brackets and links in series [m/N].
    """
    oil = bore_area**2 / cap_capacity + annulus_area**2 / annulus_capacity
    return oil / (1 + compliance * oil)
