"""The valve of the package as functions of time for Exudyn."""

from __future__ import annotations

import math
from collections.abc import Callable

from armdesign.hydraulics.valve import Valve


def step_response(valve: Valve) -> Callable[[float], float]:
    """Of a second-order lag with ζ < 1: 1 − e^(−ζω t)(cos ω_d t + ζω/ω_d sin ω_d t), ω_d = ω √(1 −
    ζ²).
    """
    omega, zeta = 2 * math.pi * valve.natural_frequency, valve.damping_ratio
    damped = omega * math.sqrt(1 - zeta**2)

    def response(t: float) -> float:
        swing = math.cos(damped * t) + zeta * omega / damped * math.sin(damped * t)
        return 1 - math.exp(-zeta * omega * t) * swing

    return response
