"""The oil, its bulk modulus with entrained air, and the pump that feeds it to the valves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Numbers
from armdesign.units import ATMOSPHERE

ADIABATIC = 1.4  # polytropic exponent of air that is squeezed too fast to exchange heat


@dataclass(frozen=True, kw_only=True)
class Fluid:
    """Oil: bulk modulus without air [Pa], entrained air, density [kg/m³], told and not used.

    The air is given by its volume at atmospheric pressure over the volume of the oil.
    """

    bulk_modulus: float
    air: float = 0.0
    density: float = 870.0

    @property
    def aerated(self) -> bool:
        """Whether it carries air, so that its stiffness depends on pressure."""
        return bool(np.any(self.air != 0))


def bulk_modulus(
    pressure: Numbers, oil_modulus: float, air: float, exponent: float = ADIABATIC
) -> Numbers:
    """Effective bulk modulus [Pa] of oil with free air at gauge ``pressure`` [Pa].

    β = E (1 + a (p_atm/P)^(1/n)) / (1 + a E p_atm^(1/n) / (n P^((n+1)/n))), P absolute (mixture
    law, as in Simscape's hydraulic fluid). P is taken as at least 1 % of an atmosphere: the law
    has no meaning in a vacuum.

    Args:
        pressure: gauge pressure, any shape [Pa].
        oil_modulus: E, bulk modulus of the oil alone [Pa].
        air: a, gas volume per liquid volume at atmospheric pressure.
        exponent: n, 1 isothermal, 1.4 adiabatic.
    """
    # of complex numbers np.maximum compares the real parts
    absolute = np.maximum(pressure + ATMOSPHERE, 0.01 * ATMOSPHERE)
    ratio = (ATMOSPHERE / absolute) ** (1 / exponent)
    squeezed = 1 + air * oil_modulus * ratio / (exponent * absolute)
    return oil_modulus * (1 + air * ratio) / squeezed


def bulk_modulus_slope(
    pressure: Numbers, oil_modulus: float, air: float, exponent: float = ADIABATIC
) -> Numbers:
    """Derivative of ``bulk_modulus`` by the pressure, of the same arguments.

    With x = (p_atm/P)^(1/n), dx/dP = −x/(nP): of numerator 1 + a x and denominator 1 + a E x/(nP).
    """
    absolute = np.maximum(pressure + ATMOSPHERE, 0.01 * ATMOSPHERE)
    share = air * (ATMOSPHERE / absolute) ** (1 / exponent)
    softer = oil_modulus * share / (exponent * absolute)
    falls = share / (exponent * absolute)
    steeper = softer * (1 + 1 / exponent) / absolute
    slope = oil_modulus * ((1 + share) * steeper - falls * (1 + softer)) / (1 + softer) ** 2
    return np.where(pressure + ATMOSPHERE > 0.01 * ATMOSPHERE, slope, 0.0)


@dataclass(frozen=True, kw_only=True)
class Supply:
    """Pump pressure and return pressure [Pa], flow [m³/s].

    The pump gives no more than its flow: it cuts off linearly within the last share ``cut_off`` of
    its pressure and fills a line of ``line_volume`` [m³]. An ideal one, not ``flow_limited``,
    holds its pressure whatever the actuators take.
    """

    pressure: float
    return_pressure: float
    flow: float
    flow_limited: bool = True
    cut_off: float = 0.05
    line_volume: float = 5e-3
