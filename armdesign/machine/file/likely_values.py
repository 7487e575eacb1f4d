"""The unit in which a number was most likely meant, where its key's own unit is implausible.

A wrong unit is a factor: a thousand where metres stand under a key in millimetres. It is named
only where the number as it stands is implausible and the number in the key's own unit is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from armdesign.machine.file.key_paths import unit_of
from armdesign.units import MPa, bar, deg, psi

# by unit of the key: the units that stand there by mistake, and how many of the key's one of them
# is
MISTAKEN = {
    "mm": {"metres": 1e3, "centimetres": 10.0, "inches": 25.4},
    "bar": {"MPa": 10.0, "kPa": 1e-2, "Pa": 1e-5, "psi": psi / bar},
    "MPa": {"GPa": 1e3, "bar": 0.1, "kPa": 1e-3, "Pa": 1e-6, "psi": psi / MPa},
    "l": {"m³": 1e3, "cm³": 1e-3},
    "cm³": {"l": 1e3, "m³": 1e6},
    "l/min": {"m³/s": 6e4, "l/s": 60.0},
    "kg/m³": {"kg/l": 1e3},
    "kg": {"t": 1e3, "g": 1e-3},
    "deg": {"radians": 1 / deg},
    "ms": {"s": 1e3},
    "": {"per cent": 1e-2},
}
# what machines have, in the unit of the key, with room; small rigs and mining shovels included
USUAL = {
    "pressure_bar": (40.0, 700.0),
    "return_pressure_bar": (0.5, 40.0),
    "relief_bar": (40.0, 800.0),
    "setting_bar": (20.0, 800.0),
    "rated_drop_bar": (1.0, 350.0),
    "bulk_modulus_MPa": (400.0, 2200.0),
    "density_kg_per_m3": (600.0, 1400.0),
    "flow_l_per_min": (0.3, 20_000.0),
    "rated_flow_l_per_min": (0.3, 20_000.0),
    "displacement_cm3": (1.0, 50_000.0),
    "line_volume_l": (0.05, 1_000.0),
    "stroke_time_ms": (2.0, 2_000.0),
    "mass_kg": (0.0, 500_000.0),
    "damping_ratio": (0.05, 2.0),
}
# ends of keys of numbers without a unit
SHARES = "share", "end_margin", "damping_ratio", "pilot_ratio"


@dataclass(frozen=True)
class LikelyUnits:
    """Units that a number may be in by mistake, the likeliest first."""

    units: tuple[str, ...]
    values: tuple[float, ...]  # of the number in the unit of its key

    @property
    def unit(self) -> str:
        """Its name or names."""
        return " or ".join(self.units)

    @property
    def remedy(self) -> str:
        """The remedy: numbers to write."""
        return f"write {' or '.join(map(rounded, self.values))}"


def rounded(value: float) -> str:
    """A number as a person writes it, with six digits at most."""
    return f"{float(f'{value:.6g}'):.10g}"


def units_of(path: tuple[Any, ...]) -> dict[str, float]:
    """Units that a number at a key path is in by mistake, and what to multiply it by."""
    unit, key = unit_of(path).strip(), str(path[-1])
    if not unit and not key.endswith(SHARES):
        return {}
    return MISTAKEN.get(unit, {})


def likely_units(
    path: tuple[Any, ...], value: Any, plausible: Callable[[float], bool]
) -> LikelyUnits | None:
    """The units in which a number becomes ``plausible`` in its key's; None where none makes it."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e15:
        return None
    if not unit_of(path) and abs(value) <= 1:
        return None  # a share, not per cent
    converted = ((value * factor, unit) for unit, factor in units_of(path).items())
    candidates = [(new, unit) for new, unit in converted if plausible(new)]
    low, high = USUAL.get(str(path[-1]), (0.0, 0.0))
    if low > 0:  # the one that is nearer to the middle is likelier
        candidates.sort(key=lambda one: abs(math.log(one[0] / math.sqrt(low * high))))
    if not candidates:
        return None
    return LikelyUnits(tuple(unit for _, unit in candidates), tuple(new for new, _ in candidates))


def is_usual_at(path: tuple[Any, ...]) -> Callable[[float], bool]:
    """A test of numbers at a key path: whether machines have such; false if that is not known."""
    low, high = USUAL.get(str(path[-1]), (float("inf"), float("-inf")))
    return lambda value: low <= value <= high
