"""Buckling of an open cylinder between its two pins: the rod alone, or barrel and rod in a row.

Ideal elastic columns with pinned ends (Euler); friction of the pins, which holds, and play of the
piston, which bends, are left out. Elementwise and complex-safe.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

STEEL_MODULUS = 210e9  # [Pa] Young's modulus


def second_moment(outer: Any, inner: Any = 0.0) -> Any:
    """Second moment of area of a round bar or tube [m⁴]: π (D⁴ − d⁴)/64."""
    return math.pi * (outer**4 - inner**4) / 64


def euler_load(inertia: Any, length: Any) -> Any:
    """Buckling load of a uniform column [N]: π² E I/L²."""
    return math.pi**2 * STEEL_MODULUS * inertia / length**2


def euler_safety(bore: Any, rod: Any, open_length: Any, supply_pressure: float) -> Any:
    """Euler buckling load of the rod, L pin to pin with the rod out, over the supply's thrust."""
    thrust = supply_pressure * math.pi / 4 * bore**2
    return math.pi**2 * STEEL_MODULUS * second_moment(rod) / (open_length**2 * thrust)


def stepped_load(
    barrel_inertia: Any, rod_inertia: Any, barrel_length: Any, rod_length: Any
) -> Any:
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


def _junction(load: Any, i1: Any, i2: Any, l1: Any, l2: Any) -> Any:
    """Difference of the slopes of both parts where they meet, over the deflection there."""
    k1, k2 = (np.sqrt(load / (STEEL_MODULUS * inertia)) for inertia in (i1, i2))
    return k1 / np.tan(k1 * l1) + k2 / np.tan(k2 * l2)
