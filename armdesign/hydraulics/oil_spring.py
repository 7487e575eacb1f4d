"""The oil spring: stiffness of the oil trapped in both chambers, and its static pressures.

Elementwise on arrays, and complex-safe.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Numbers


def oil_stiffness(
    bore_area: Numbers,
    annulus_area: Numbers,
    cap_capacity: Numbers,
    annulus_capacity: Numbers,
    compliance: float = 0.0,
) -> Numbers:
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


BELOW_RELIEF = 0.95  # of the relief pressure: no preload presses the loaded chamber beyond it


def static_pressures(
    force: Numbers, bore_area: Numbers, annulus_area: Numbers, return_pressure: Numbers
) -> tuple[Numbers, Numbers]:
    """Pressures of cap and annulus [Pa] under a static force [N, + pushes]: F = A1 p1 − A2 p2.

    One chamber carries the load, the other stands at return pressure.
    """
    cap = (force + annulus_area * return_pressure) / bore_area
    annulus = (bore_area * return_pressure - force) / annulus_area
    pushes = np.real(cap) >= np.real(return_pressure)
    return np.where(pushes, cap, return_pressure), np.where(pushes, return_pressure, annulus)


def preloaded_pressures(
    force: Numbers,
    bore_area: Numbers,
    annulus_area: Numbers,
    preload: Numbers,
    return_pressure: float,
    relief: float,
) -> tuple[Numbers, Numbers]:
    """Pressures of cap and annulus [Pa] with the chamber without load at a ``preload`` [Pa].

    Where that would press the loaded chamber against its ``relief`` [Pa], the preload is reduced
    until the loaded chamber stays a little below, at most down to return pressure.
    """
    lower = np.maximum(preload, return_pressure)
    if np.all(lower == return_pressure):
        return static_pressures(force, bore_area, annulus_area, return_pressure)
    if np.all(np.isfinite(relief)):
        limit = np.maximum(BELOW_RELIEF * relief, lower)
        pushed = (bore_area * limit - force) / annulus_area
        for largest in (pushed, (annulus_area * limit + force) / bore_area):
            lower = np.where(np.real(largest) < np.real(lower), largest, lower)
        lower = np.where(np.real(lower) < np.real(return_pressure), return_pressure, lower)
    return static_pressures(force, bore_area, annulus_area, lower)


def holding_force(
    bore_area: Numbers,
    annulus_area: Numbers,
    pressure: Numbers,
    return_pressure: float,
    pushes: Numbers,
) -> Numbers:
    """Largest static force [N] of a pressure against the return's [Pa], pushing or pulling."""
    push = pressure * bore_area - return_pressure * annulus_area
    pull = pressure * annulus_area - return_pressure * bore_area
    return np.where(pushes, push, pull)
