"""Oil and structure of one cylinder in the upper bound: what they are at most over cells.

Air softens each chamber to β(p) at its static pressure; over a cell and all volumes allowed in it
β is taken at the greatest pressure that there can be.

Structure of compliance c in series leaves k/(1 + c k), concave in k, so its tangents lie above it:

    k/(1 + c k) ≤ (1 − t)² k + t²/c    for any t, equal at t = c k/(1 + c k)

(the difference is (k − t (1 + c k)/c)² c/(1 + c k)). Every cell and angle has a t of its own.
Under the static load structure gives way too, so that the piston stands further out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array, Numbers
from armdesign.design.bound.intervals import Interval, interval
from armdesign.hydraulics.fluid import Fluid, bulk_modulus

Stiffening: TypeAlias = tuple[Numbers, Numbers]  # of cap and annulus (n, m)


@dataclass(frozen=True, eq=False, kw_only=True)
class CylinderSpring:
    """Upper bounds on oil and structure over cells.

    Attributes:
        stiffening: bulk moduli of cap and annulus over the modulus of oil alone (n, m).
        shift: what structure under the static load adds to the piston's place (n, m).
        oil: share (n, m) of the oil's stiffness, (1 − t)².
        structure: t² scale²/(c β) (n, m) [m], times the weight what r² at scale 1 counts.
    """

    stiffening: Stiffening = (1.0, 1.0)
    shift: Interval = field(default_factory=lambda: interval(np.zeros((1, 1))))
    oil: Numbers = field(default_factory=lambda: np.ones((1, 1)))
    structure: Numbers = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Air:
    """Oil with air, and the static torques (n,) [N m, + pushes]."""

    fluid: Fluid
    back: float  # pressure of the chamber without load, at most [Pa]
    torque: Interval

    def stiffening(self, rate: Interval, least: Array, most: Array) -> tuple[Array, Array]:
        """Largest bulk moduli of cap and annulus over the modulus of oil alone (n, m).

        For |ρ| (n, m) and swept volumes between ``least`` and ``most`` (2, m): p0, or p1 = (F + A2
        p0)/A1 where that is more, with F = torque/(|ρ| S); in the annulus likewise with −F.
        """
        ratios = []
        for torque, own, other in ((self.torque.high, 0, 1), (-self.torque.low, 1, 0)):
            needed_by = torque[:, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                needed = self.back * most[other] + needed_by / np.where(
                    needed_by > 0, rate.low, rate.high
                )
                pressure = np.maximum(self.back, needed / least[own])
            beta = (
                bulk_modulus(pressure, self.fluid.bulk_modulus, self.fluid.air)
                / self.fluid.bulk_modulus
            )
            ratios.append(beta)
        return ratios[0], ratios[1]


@dataclass(frozen=True, eq=False)
class Structure:
    """Structure in series with the oil, and the static torques (n,) [N m, + pushes]."""

    compliance: Array  # c (n,) [m/N], > 0
    modulus: float  # β of oil alone [Pa]
    torque: Interval

    def shift(self, rate: Interval, stroke: Interval) -> Interval:
        """Its share of the piston's place (n, m): c F/S with F = torque/(|ρ| S), S (m,) [m]."""
        per_torque = rate.reciprocal() * stroke.square().reciprocal()
        return self.torque[:, None] * per_torque * self.compliance[:, None]

    def yielding(self, oil: Array, stroke: Array) -> Array:
        """The t = c k/(1 + c k) of oil k S²/β (…, n, m) [m³] and strokes (m,) [m]."""
        soft = stroke**2 / (self.compliance * self.modulus)[:, None]
        with np.errstate(divide="ignore"):
            return np.asarray(1 / (1 + soft / oil))
