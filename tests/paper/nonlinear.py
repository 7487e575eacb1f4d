"""The nonlinear mechanism of the paper, with stand-ins for the numbers that it does not print."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from armdesign.units import GRAVITY, MPa
from tests.checks import difference

MASSES = np.arange(50.0, 401.0, 50.0)  # [kg], the paper's eight; the numbers are stand-ins


LENGTHS = np.array([0.5, 0.75, 1.0, 1.25, 1.5])  # [m], the paper's five


PINS = {"link_pin_distance": 0.15, "base_pin_distance": 0.5}


GRID = {"load_mass": MASSES[:, None], "link_length": LENGTHS, **PINS}


SYMMETRIC = {"area": 2e-3, "chamber_volume": 3e-4, "bulk_modulus": 1200 * MPa}


ASYMMETRIC = {"bore_area": 3e-3, "annulus_area": 2e-3, "cap_volume": 4e-4, "annulus_volume": 3e-4}


VALVE = {"leakage": 2e-12, "valve_gain": 3e-6, "supply_pressure": 21 * MPa, "density": 870.0}


class Nonlinear:
    """Eq.

    (22) and (34) before linearisation, from coordinates: rod pin at a1 (cos θ, sin θ), base pin at
    (d1, 0).
    """

    def __init__(self, mass: float, length: float) -> None:
        self.a1, self.d1, self.m2, self.l2 = *PINS.values(), mass, length
        self.A, self.V0, self.beta = SYMMETRIC.values()
        self.C_L, self.K_v, self.p_p, self.rho = VALVE.values()

    # every quantity is a column (n, 1)

    def length(self, angle: np.ndarray) -> np.ndarray:
        return np.hypot(self.a1 * np.cos(angle) - self.d1, self.a1 * np.sin(angle))

    def height(self, angle: np.ndarray) -> np.ndarray:
        return self.a1 * np.sin(angle) + self.l2 * np.cos(angle)

    def net_torque(self, angle: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        weight = self.m2 * GRAVITY * slope(self.height, angle)
        return slope(self.length, angle) * self.A * pressure - weight

    @property
    def inertia(self) -> float:
        return self.m2 * (self.a1**2 + self.l2**2)

    @property
    def static_pressure(self) -> float:
        """The pressure difference at which the torque, linear in it, vanishes at θ = π/2."""
        at_0, at_1 = (self.net_torque(REST, np.array([[p]])).item() for p in (0.0, 1.0))
        return at_0 / (at_0 - at_1)

    def trapped_torque(self, angle: np.ndarray) -> np.ndarray:
        """Net torque when the oil was shut in at θ = π/2: both chambers, of V0 each, change by A(ℓ
        − ℓ0).
        """
        travel = self.length(angle) - self.length(REST)
        return self.net_torque(
            angle, self.static_pressure - 2 * self.beta * self.A / self.V0 * travel
        )

    def rate(self, state: np.ndarray) -> np.ndarray:
        """d/dt of θ, θ̇ and Δp; the fourth column of the state (n, 4) is the valve signal."""
        angle, speed, pressure, signal = (state[:, [i]] for i in range(4))
        flow = self.K_v * signal * math.sqrt(self.p_p / self.rho) - 2 * self.C_L * pressure
        flow = flow - 2 * self.A * slope(self.length, angle) * speed
        return np.hstack(
            [speed, self.net_torque(angle, pressure) / self.inertia, self.beta / self.V0 * flow]
        )


REST = np.array([[math.pi / 2]])


def slope(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """dfunction/dx of a column (n, 1)."""
    return difference(function, x)[..., 0]
