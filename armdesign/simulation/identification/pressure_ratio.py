"""Ratio of the pressure swings in the two chambers of a cylinder: a check of any recording.

Oil that is trapped on both sides of a piston answers its motion δs with δp1 = −A1 δs/C1 and
δp2 = +A2 δs/C2, C = V/β the capacity of each chamber. So the pressures swing against each other,
and |δp1/δp2| = (A1/C1)/(A2/C2): a check that needs no mass. A chamber that is open to the tank, or
runs empty, does not swing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.hydraulics.actuator import SIDES
from armdesign.simulation.identification.decaying_modes import (
    Noise,
    autoregression,
    best_shapes,
    detrended,
)

SURE = 3.0  # deviations by which a swing stands out
TREND = 2  # degree
TINY = 1e-300
OPPOSITE = 30.0  # [°] from 180, within which pressures swing against each other
ALIKE = 0.25  # relative difference from the expected ratio that measured volumes and β may explain


@dataclass(frozen=True, kw_only=True)
class PressureRatio:
    """Pressure swings of one cylinder in one window.

    Attributes:
        cylinder: name.
        cap: swing of the cap pressure at the window's begin, in the recording's unit.
        annulus: swing of the annulus pressure.
        swings: which of the two swing more than their noise.
        deviation: standard deviation of the ratio cap/annulus.
        phase: of cap against annulus [°], 0…360.
        expected: ratio of trapped oil by a machine's areas and volumes; None without a machine.
    """

    cylinder: str
    cap: float
    annulus: float
    swings: tuple[bool, bool]
    deviation: float
    phase: float
    expected: float | None = None

    @property
    def ratio(self) -> float:
        """Swing of the cap pressure over the swing of the annulus pressure."""
        return self.cap / self.annulus if self.annulus > 0 else math.inf

    @property
    def verdict(self) -> str:
        """State of the oil by the swings, in words."""
        if not all(self.swings):
            constant, other = SIDES[::-1] if self.swings[0] else SIDES
            return (
                f"the {constant} pressure does not swing with the {other} pressure: that chamber"
                " is open or runs empty, so its oil is no spring"
            )
        if abs(self.phase - 180) > OPPOSITE:
            return "cap and annulus pressure do not swing against each other: trapped oil would"
        against = "cap and annulus pressure swing against each other"
        if self.expected is None:
            return f"{against}, as trapped oil does"
        near = max(SURE * self.deviation, ALIKE * self.expected)
        if abs(self.ratio - self.expected) <= near:
            return f"{against} in the ratio of trapped oil"
        return f"{against}, but not in the ratio of trapped oil"


def pressure_ratio(
    cylinder: str, step: float, pressures: Array, frequency: float, damping: float
) -> PressureRatio:
    """Swings of both chambers at a frequency and damping found.

    Args:
        cylinder: its name.
        step: between samples [s].
        pressures: of cap and annulus (n, 2), in one unit.
        frequency: natural frequency [Hz].
        damping: damping ratio, below 1.
    """
    omega, length = 2 * math.pi * frequency * step, len(pressures)
    roots = np.array([omega * (-damping + 1j * math.sqrt(1 - damping**2))])
    sizes, deviations = [], []
    for one in pressures.T:
        values = detrended(one[:, None], TREND)
        plain = Noise(length, np.zeros(0), trend_degree=TREND)
        left = best_shapes(plain.whitened(values), roots, plain).residual
        noise = (
            Noise(length, autoregression(left, 2), trend_degree=TREND)
            if np.ptp(left) > 0
            else plain
        )
        best = best_shapes(noise.whitened(values), roots, noise)
        sizes.append(best.shapes[0, 0])
        spare = max(length - 2 - TREND, 1)
        deviations.append(math.sqrt(best.cost / spare / 2 * np.trace(best.unit_covariance)))
    cap, annulus = np.abs(sizes)
    share = math.hypot(deviations[0] / max(cap, TINY), deviations[1] / max(annulus, TINY))
    return PressureRatio(
        cylinder=cylinder,
        cap=float(cap),
        annulus=float(annulus),
        swings=(bool(cap > SURE * deviations[0]), bool(annulus > SURE * deviations[1])),
        deviation=float(cap / max(annulus, TINY) * share),
        phase=math.degrees(float(np.angle(sizes[0] * np.conj(sizes[1])))) % 360,
    )
