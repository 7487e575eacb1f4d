"""Units: SI inside, everything else is a factor written where a number enters or leaves.

``140 * mm`` is 0.14 m; ``pressure / bar`` prints a pressure in bar. ``WORKSHOP`` and ``SI`` are
the two habits in which tables are printed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

__all__ = [
    "ATMOSPHERE",
    "GRAVITY",
    "SI",
    "WORKSHOP",
    "MPa",
    "Units",
    "bar",
    "cm3",
    "deg",
    "kN",
    "l_per_min",
    "litre",
    "mm",
    "ms",
    "percent",
    "psi",
]

mm = 1e-3
litre = 1e-3
cm3 = 1e-6
ms = 1e-3
bar = 1e5
MPa = 1e6
psi = 6894.757
kN = 1e3
deg = math.pi / 180.0
l_per_min = litre / 60.0

SIZED = "N", "N m", "kg", "m³", "m³/s", "s"  # of which small machines have little
ALONE, LARGEST = 2, 3  # digits of these, at least: of a number alone, of the largest of several
TINY, NONE = 0.02, 1e-4  # of the last decimal, below which these are nothing
GRAVITY = 9.81  # [m/s²], the value of Pinocchio's default model
ATMOSPHERE = 101_325.0  # [Pa]


@dataclass(frozen=True)
class Units:
    """A habit of printing numbers: by SI unit a factor, the unit shown and the decimals."""

    table: Mapping[str, tuple[float, str, int]]

    def name(self, unit: str) -> str:
        """The unit that is shown for an SI unit."""
        return self.table[unit][1]

    def number(self, value: float, unit: str, decimals: int | None = None) -> str:
        """A value [unit, SI] as its number alone."""
        usual = self.table[unit][2] if decimals is None else decimals
        return self._digits(value, unit, self._decimals(value, unit, usual, ALONE, TINY))

    def numbers(
        self, values: Iterable[float], unit: str, decimals: int | None = None
    ) -> list[str]:
        """Values [unit, SI] as numbers of equal decimals, with three digits of the largest."""
        known, usual = list(values), self.table[unit][2] if decimals is None else decimals
        largest = max((abs(value) for value in known if math.isfinite(value)), default=0.0)
        digits = self._decimals(largest, unit, usual, LARGEST, NONE)
        return [self._digits(value, unit, digits) for value in known]

    def _decimals(self, value: float, unit: str, usual: int, least: int, nothing: float) -> int:
        """As many as usual, more where fewer digits than the least would be left."""
        shown = abs(value / self.table[unit][0])
        if unit not in SIZED or not nothing <= shown * 10**usual < math.inf:
            return usual
        return max(usual, least - 1 - math.floor(math.log10(shown)))

    def _digits(self, value: float, unit: str, digits: int) -> str:
        shown = float(value / self.table[unit][0])
        return f"{round(shown, digits) + 0.0:.{digits}f}"  # 0.0, never -0.0

    def text(self, value: float, unit: str, decimals: int | None = None) -> str:
        """A value [unit, SI] with its unit."""
        return _joined(self.number(value, unit, decimals), self.name(unit))

    def short(self, value: float, unit: str) -> str:
        """A value [unit, SI] with four digits and its unit."""
        return _joined(f"{value / self.table[unit][0]:.4g}", self.name(unit))

    def span(self, low: float, high: float, unit: str) -> str:
        """An interval [unit, SI] with its unit."""
        return _joined(f"[{self.number(low, unit)}, {self.number(high, unit)}]", self.name(unit))


def masses(values: Iterable[float]) -> list[str]:
    """Masses [kg] that are lifted, as numbers with three digits of the largest, or whole ones.

    A dash where there is none (NaN).

    Example:
        >>> from armdesign.units import masses
        >>> print(masses([2.334, 0.87]), masses([8961.2, 87.4]))
        ['2.33', '0.87'] ['8961', '87']
    """
    return ["–" if mass == "nan" else mass for mass in WORKSHOP.numbers(values, "kg")]


def percent(share: float, decimals: int = 1) -> str:
    """A change in per cent with its sign; what rounds to nothing is no loss.

    A dash where there is none, as over nothing (not finite).

    Example:
        >>> import armdesign as ad
        >>> print(ad.units.percent(0.068), ad.units.percent(-1e-5))
        +6.8 % +0.0 %
    """
    if not math.isfinite(share):
        return "–"
    return f"{round(100 * float(share), decimals) + 0.0:+.{decimals}f} %"


def share_text(share: float) -> str:
    """A share in per cent with two digits, more before the point if there are.

    Example:
        >>> from armdesign.units import share_text
        >>> print(share_text(0.0214), share_text(1.0), share_text(1.234))
        2.1 % 100 % 123 %
    """
    value = 100 * share
    return f"{value:.2g} %" if abs(value) < 99.5 else f"{value:.0f} %"


def _joined(number: str, unit: str) -> str:
    return f"{number}{'' if unit == '°' else ' '}{unit}".rstrip()


def outward(value: float, digits: int, up: bool) -> float:
    """A number rounded up or down to significant digits; unchanged if it has no more.

    Example:
        >>> from armdesign.units import outward
        >>> outward(1.2341, 3, up=True)
        1.24
    """
    if value == 0:
        return value
    step = 10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits)
    nearest = round(value / step)
    if abs(value / step - nearest) > 1e-6:
        nearest = math.ceil(value / step) if up else math.floor(value / step)
    return float(f"{nearest * step:.{digits + 1}g}")


WORKSHOP = Units(
    {
        "m": (mm, "mm", 1),
        "m/rad": (mm, "mm", 1),
        "m/m": (1.0, "", 3),
        "m/s": (mm, "mm/s", 0),
        "m³": (litre, "l", 2),
        "m³/s": (l_per_min, "l/min", 1),
        "Pa": (bar, "bar", 0),
        "N": (kN, "kN", 1),
        "N m": (kN, "kN m", 1),
        "kg": (1.0, "kg", 0),
        "s": (1.0, "s", 1),
        "rad": (deg, "°", 1),
        "rad/s": (deg, "°/s", 1),
        "": (1.0, "", 2),
    }
)
SI = Units(
    {
        "m": (1.0, "m", 4),
        "m/rad": (1.0, "m", 4),
        "m/m": (1.0, "", 3),
        "m/s": (1.0, "m/s", 4),
        "m³": (1.0, "m³", 5),
        "m³/s": (1.0, "m³/s", 6),
        "Pa": (1e6, "MPa", 2),  # a prefix, or a table of static pressures is zeros
        "N": (1.0, "N", 0),
        "N m": (1.0, "N m", 0),
        "kg": (1.0, "kg", 0),
        "s": (1.0, "s", 1),
        "rad": (1.0, "rad", 4),
        "rad/s": (1.0, "rad/s", 4),
        "": (1.0, "", 2),
    }
)


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
