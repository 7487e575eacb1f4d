"""The oil: its bulk modulus with entrained air."""

from __future__ import annotations

from typing import Any

import numpy as np

from armdesign.units import ATMOSPHERE

ADIABATIC = 1.4  # polytropic exponent of air that is squeezed too fast to exchange heat


def bulk_modulus(
    pressure: Any, oil_modulus: float, air: float, exponent: float = ADIABATIC
) -> Any:
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
    absolute = np.maximum(
        pressure + ATMOSPHERE, 0.01 * ATMOSPHERE
    )  # of complex numbers, too: by their real parts
    ratio = (ATMOSPHERE / absolute) ** (1 / exponent)
    return (
        oil_modulus * (1 + air * ratio) / (1 + air * oil_modulus * ratio / (exponent * absolute))
    )
