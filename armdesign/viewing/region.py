"""The region that the tool sweeps, as squares of the reach/height plane with their frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.plots.canvas import colours_between

if TYPE_CHECKING:
    from armdesign.frequency.maps import FrequencyMap

CELLS = 60  # along the longer side


@dataclass(frozen=True, eq=False, kw_only=True)
class ReachRegion:
    """Cells that the tool reaches, each with its lowest frequency.

    Attributes:
        middles: reach and height (n, 2) [m].
        sides: of a cell along both [m].
        frequencies: lowest of each cell (n,) [Hz].
        least: at which the scale of colours begins [Hz].
        most: at which it ends [Hz].
    """

    middles: Array
    sides: tuple[float, float]
    frequencies: Array
    least: float
    most: float

    @property
    def colours(self) -> Array:
        """Red, green and blue of each cell (n, 3), from 0 to 1."""
        return colours_between(self.frequencies, self.least, self.most)

    @property
    def scale(self) -> list[tuple[str, float]]:
        """Colours as ``#RRGGBB`` with their frequencies [Hz], from the lowest."""
        values = np.linspace(self.least, self.most, 6)
        parts = np.rint(255 * colours_between(values, self.least, self.most)).astype(int)
        names = ("#{:02X}{:02X}{:02X}".format(*part) for part in parts.tolist())
        return list(zip(names, values.tolist(), strict=True))


def region_of(frequencies: FrequencyMap) -> ReachRegion:
    """The region of a frequency map; colours from its least to its 95th percentile."""
    places = frequencies.reach_map(CELLS)
    rows, columns = np.nonzero(np.isfinite(places.frequency))
    values = places.frequency[rows, columns]
    sides = tuple(
        float(axis[1] - axis[0]) if len(axis) > 1 else 0.01
        for axis in (places.reach, places.height)
    )
    least, most = float(values.min()), float(np.percentile(values, 95))
    return ReachRegion(
        middles=np.column_stack([places.reach[rows], places.height[columns]]),
        sides=(sides[0], sides[1]),
        frequencies=values,
        least=least,
        most=most if most > least else least + 1.0,
    )
