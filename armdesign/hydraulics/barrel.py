"""The barrel: the wall that it needs under pressure (Lamé)."""

from __future__ import annotations

from typing import Any

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.units import MPa

BARREL_STRESS = 355e6 / 1.5  # [Pa] yield strength of E355 tube (EN 10305-1) over a safety of 1.5


def barrel_ratio(pressure: Any) -> Any:
    """Outer over inner diameter of a barrel that just carries a pressure [Pa].

    Lamé's thick wall yields inside first, where σ_θ − σ_r = 2 p k²/(k² − 1); equal to σ =
    ``BARREL_STRESS`` (Tresca) that gives k² = σ/(σ − 2 p). For a thin wall it is Barlow's t = p
    D/(2 σ). Complex-safe.

    Raises:
        ArmDesignError: no wall carries the pressure, 2 p ≥ σ.
    """
    if np.any(np.real(pressure) < 0) or np.any(2 * np.real(pressure) >= BARREL_STRESS):
        raise ArmDesignError(
            "supply.pressure",
            f"no steel barrel carries {np.max(np.real(pressure)) / MPa:.4g} MPa",
            f"give 0 to {BARREL_STRESS / 2 / MPa:.4g} MPa",
        )
    return (BARREL_STRESS / (BARREL_STRESS - 2 * pressure)) ** 0.5


def barrel_outer(bore: Any, wall: float | None, pressure: Any) -> Any:
    """Outer diameter of a barrel [m] with its wall [m]; None: what the pressure [Pa] needs."""
    return bore + 2 * wall if wall is not None else barrel_ratio(pressure) * bore
