"""The build of a cylinder from its sizes: wall of the barrel, buckling, mass.

Complex-safe. Columns are ideal and elastic with pinned ends (Euler); friction of the pins, which
holds, and play of the piston, which bends, are left out.
"""

from __future__ import annotations

import math

import numpy as np

from armdesign.arrays import Numbers
from armdesign.errors import ArmDesignError
from armdesign.units import bar

BARREL_STRESS = 355e6 / 1.5  # [Pa] yield strength of E355 tube (EN 10305-1) over a safety of 1.5


def barrel_ratio(pressure: Numbers) -> Numbers:
    """Outer over inner diameter of a barrel that just carries a pressure [Pa].

    Lamé's thick wall yields inside first, where σ_θ − σ_r = 2 p k²/(k² − 1); equal to σ =
    ``BARREL_STRESS`` (Tresca) that gives k² = σ/(σ − 2 p). For a thin wall it is Barlow's t = p
    D/(2 σ). Complex-safe.

    Raises:
        ArmDesignError: no wall carries the pressure, 2 p ≥ σ.
    """
    if np.any(np.real(pressure) < 0) or np.any(2 * np.real(pressure) >= BARREL_STRESS):
        raise ArmDesignError(
            "supply.pressure_bar",
            f"no steel barrel carries {np.max(np.real(pressure)) / bar:.5g} bar",
            f"give less than {BARREL_STRESS / 2 / bar:.0f} bar",
        )
    return (BARREL_STRESS / (BARREL_STRESS - 2 * pressure)) ** 0.5


def barrel_outer(bore: Numbers, wall: float | None, pressure: Numbers) -> Numbers:
    """Outer diameter of a barrel [m] with its wall [m]; None: what the pressure [Pa] needs."""
    return bore + 2 * wall if wall is not None else barrel_ratio(pressure) * bore


STEEL_DENSITY = 7850.0  # [kg/m³]


def estimated_mass(
    bore: Numbers, rod: Numbers, stroke: Numbers, wall: float | None, pressure: Numbers
) -> Numbers:
    """Mass of one cylinder [kg]: its steel, without oil, ports and eyes.

    The steel is barrel, bottom, gland, piston and rod. Piston, gland and bottom are each half a
    bore long, the usual proportion; the rod passes through piston and gland. Complex-safe.

    Args:
        bore: inner diameter D [m].
        rod: its diameter d [m].
        stroke: S [m].
        wall: of the barrel [m]; None: what the pressure needs, see ``barrel_ratio``.
        pressure: that the barrel is made for [Pa]; the supply's.
    """
    part = bore / 2
    outer = barrel_outer(bore, wall, pressure) ** 2
    barrel, bottom = (outer - bore**2) * (stroke + 2 * part), outer * part
    rings, bar = (bore**2 - rod**2) * 2 * part, rod**2 * (stroke + 2 * part)
    return STEEL_DENSITY * math.pi / 4 * (barrel + bottom + rings + bar)


STEEL_MODULUS = 210e9  # [Pa] Young's modulus


def second_moment(outer: Numbers, inner: Numbers = 0.0) -> Numbers:
    """Second moment of area of a round bar or tube [m⁴]: π (D⁴ − d⁴)/64."""
    return math.pi * (outer**4 - inner**4) / 64


def euler_load(inertia: Numbers, length: Numbers) -> Numbers:
    """Buckling load of a uniform column [N]: π² E I/L²."""
    return math.pi**2 * STEEL_MODULUS * inertia / length**2


def euler_safety(bore: Numbers, rod: Numbers, open_length: Numbers, pressure: float) -> Numbers:
    """Euler buckling load over the thrust p π D²/4 of one cylinder, all as thick as its rod.

    Args:
        bore: inner diameter D [m].
        rod: its diameter [m].
        open_length: L, pin to pin with the rod out [m].
        pressure: p in the cap chamber [Pa].
    """
    thrust = pressure * math.pi / 4 * bore**2
    return euler_load(second_moment(rod), open_length) / thrust


def stepped_load(
    barrel_inertia: Numbers, rod_inertia: Numbers, barrel_length: Numbers, rod_length: Numbers
) -> Numbers:
    """Buckling load of a column of two parts in a row [N].

    The smallest P with k1 cot(k1 L1) + k2 cot(k2 L2) = 0, k_i = √(P/(E I_i)): the deflections
    sin(k1 x) and sin(k2 x') from either pin meet with one slope (Timoshenko and Gere, Theory of
    Elastic Stability, 2.14). Up to the first pole the left side falls from 1/L1 + 1/L2 to −∞, so
    halving finds the root; a Newton step from it carries complex parts.
    """
    parts = np.broadcast_arrays(barrel_inertia, rod_inertia, barrel_length, rod_length)
    i1, i2, l1, l2 = (np.real(part).astype(float) for part in parts)
    low, high = np.zeros(i1.shape), np.minimum(euler_load(i1, l1), euler_load(i2, l2))
    for _ in range(100):
        middle = (low + high) / 2
        below = _junction(middle, i1, i2, l1, l2) > 0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    load = (low + high) / 2
    if not any(np.iscomplexobj(part) for part in parts):
        return load
    step = 1e-30 * load
    slope = np.imag(_junction(load + 1j * step, i1, i2, l1, l2)) / step
    return load - _junction(load, *parts) / slope


def _junction(load: Numbers, i1: Numbers, i2: Numbers, l1: Numbers, l2: Numbers) -> Numbers:
    """Difference of the slopes of both parts where they meet, over the deflection there."""
    k1, k2 = (np.sqrt(load / (STEEL_MODULUS * inertia)) for inertia in (i1, i2))
    return k1 / np.tan(k1 * l1) + k2 / np.tan(k2 * l2)
