"""Actuators: hydraulic cylinders and motors, their areas, chambers, pressures and stiffness.

Areas and volumes are sums over all parallel cylinders of an actuator. The formulas are elementwise
on arrays and accept complex numbers, so that a complex step gives their exact derivative.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from armdesign.arrays import Array, Numbers
from armdesign.hydraulics.fluid import Fluid, Supply, bulk_modulus
from armdesign.hydraulics.friction import NO_FRICTION, Friction
from armdesign.hydraulics.oil_spring import oil_stiffness, preloaded_pressures
from armdesign.hydraulics.valve import RELIEF_SHARE, LoadHolding, Valve

SIDES = ("cap", "annulus")  # chambers, in this order wherever both stand in one array


@dataclass(frozen=True, kw_only=True)
class Actuator(ABC):
    """A hydraulic actuator with two chambers of oil, hoses, valve and friction.

    It is a cylinder or a motor. The chamber that drives in the positive direction is called cap,
    the other annulus. A motor turns where a cylinder is pushed: its lengths are angles [rad], its
    forces torques [N m] and its areas oil per angle [m³/rad].

    Where other ``areas`` (A1, A2) [m²] or another ``stroke`` [m] are given, they stand in for the
    actuator's own.
    """

    kind: ClassVar[str]  # "cylinder" or "motor"
    chambers: ClassVar[tuple[str, str]] = SIDES  # in words

    name: str
    count: int = 1
    stroke: float
    closed_length: float
    cap_dead_volume: float  # [m³], as the other volumes of all ``count`` together
    annulus_dead_volume: float
    cap_hose_volume: float = 0.0
    annulus_hose_volume: float = 0.0
    hose_modulus: float = 700e6
    compliance: float = 0.0  # [m/N], of a motor [rad/(N m)], in series with the oil, all together
    valve: Valve | None = None
    load_holding: LoadHolding | None = None
    friction: Friction = NO_FRICTION

    @property
    @abstractmethod
    def bore_area(self) -> float:
        """A1, all together [m²]."""

    @property
    @abstractmethod
    def annulus_area(self) -> float:
        """A2, all together [m²]."""

    @abstractmethod
    def volumes(
        self,
        extension: Numbers,
        areas: tuple[Numbers, Numbers] | None = None,
        stroke: Numbers = None,
    ) -> tuple[Numbers, Numbers]:
        """Oil in cap and annulus chamber [m³] at an extension [m]."""

    def chamber(self, side: int) -> str:
        """One of its two chambers in words: "boom's cap"."""
        return f"{self.name}'s {self.chambers[side]}"

    def relief(self, supply: Supply) -> float:
        """Pressure at which its port reliefs open [Pa]; inf without a valve."""
        if self.valve is None:
            return math.inf
        return RELIEF_SHARE * supply.pressure if self.valve.relief is None else self.valve.relief

    def available_pressure(self, supply: Supply) -> float:
        """Largest pressure of a working chamber [Pa]: the supply's, or a lower relief's."""
        return min(supply.pressure, self.relief(supply))

    def preload(self, return_pressure: float) -> float:
        """Pressure of the chamber without load behind a shut valve [Pa]."""
        own = None if self.valve is None else self.valve.preload
        return return_pressure if own is None else own

    def static_pressures(
        self, force: Numbers, supply: Supply, areas: tuple[Numbers, Numbers] | None = None
    ) -> tuple[Numbers, Numbers]:
        """Pressures of cap and annulus [Pa] behind a shut valve under a force [N, + pushes].

        Simulations start at them, ``check`` and maps name them, and the stiffness of oil with air
        depends on them.
        """
        bore_area, annulus_area = areas or (self.bore_area, self.annulus_area)
        back = supply.return_pressure
        return preloaded_pressures(
            force, bore_area, annulus_area, self.preload(back), back, self.relief(supply)
        )

    def stiffness(
        self,
        extension: Numbers,
        force: Numbers,
        fluid: Fluid,
        supply: Supply,
        *,
        areas: tuple[Numbers, Numbers] | None = None,
        stroke: Numbers = None,
    ) -> Numbers:
        """Stiffness [N/m] of oil and compliance at an extension [m] with the valve shut.

        The static force [N, + pushes] counts where the oil carries air: each chamber has the bulk
        modulus of its own static pressure; and where there is a series compliance: it gives way,
        so that the piston stands further out than the pins say.
        """
        areas = areas or (self.bore_area, self.annulus_area)
        if np.any(self.compliance != 0):
            extension = extension + self.compliance * force
        pressures = self.static_pressures(force, supply, areas) if fluid.aerated else (0.0, 0.0)
        cap, annulus = self.capacities(extension, pressures, fluid, areas=areas, stroke=stroke)
        return oil_stiffness(areas[0], areas[1], cap, annulus, self.compliance)

    def capacities(
        self,
        extension: Numbers,
        pressures: tuple[Numbers, Numbers],
        fluid: Fluid,
        *,
        areas: tuple[Numbers, Numbers] | None = None,
        stroke: Numbers = None,
    ) -> tuple[Numbers, Numbers]:
        """Capacities V/β + V_hose/β_hose of cap and annulus [m³/Pa] with the piston at a place.

        Args:
            extension: of the piston itself [m].
            pressures: of cap and annulus [Pa]; they count where the oil carries air.
            fluid: the oil.
            areas: see the class.
            stroke: see the class.
        """
        cap, annulus = self.volumes(extension, areas, stroke)
        beta: tuple[Numbers, Numbers] = (fluid.bulk_modulus, fluid.bulk_modulus)
        if fluid.aerated:
            at_cap, at_annulus = (
                bulk_modulus(pressure, fluid.bulk_modulus, fluid.air) for pressure in pressures
            )
            beta = at_cap, at_annulus
        return (
            cap / beta[0] + self.cap_hose_volume / self.hose_modulus,
            annulus / beta[1] + self.annulus_hose_volume / self.hose_modulus,
        )

    def oil_compliance(self, fluid: Fluid, supply: Supply) -> float:
        """Compliance [m/N] of its oil alone at mid stroke, without air and load.

        What structure in series yields is measured by it.
        """
        middle = self.stroke / 2 if math.isfinite(self.stroke) else 0.0  # a motor has no stroke
        rigid = dataclasses.replace(self, compliance=0.0)
        return float(1 / rigid.stiffness(middle, 0.0, dataclasses.replace(fluid, air=0.0), supply))


@dataclass(frozen=True, kw_only=True)
class Cylinder(Actuator):
    """``count`` equal double-acting cylinders that share pins, valve and hoses.

    Bore, rod, stroke, closed length [m], masses and friction are values of one cylinder.
    """

    kind: ClassVar[str] = "cylinder"

    bore: float
    rod: float
    barrel_mass: float = 0.0  # [kg] of each of the parallel cylinders
    rod_mass: float = 0.0
    barrel_wall: float | None = None  # [m]; None: what the supply pressure needs
    linkage_masses: tuple[tuple[str, float], ...] = ()  # [kg] of its linkage's bars, by name

    @property
    def bore_area(self) -> float:
        """A1, all together [m²]."""
        return self.count * math.pi / 4 * self.bore**2

    @property
    def annulus_area(self) -> float:
        """A2, all together [m²]."""
        return self.count * math.pi / 4 * (self.bore**2 - self.rod**2)

    @property
    def open_length(self) -> float:
        """Pin-to-pin length with the rod out [m]."""
        return self.closed_length + self.stroke

    @property
    def dead_length(self) -> float:
        """Length that head, piston and eyes take: closed length − stroke [m]."""
        return self.closed_length - self.stroke

    @property
    def masses(self) -> dict[str, float]:
        """Mass of one barrel, of one rod and of every bar of the linkage [kg]."""
        return {"barrel": self.barrel_mass, "rod": self.rod_mass, **dict(self.linkage_masses)}

    @property
    def moving_masses(self) -> dict[str, float]:
        """Mass of each moving bar that has one [kg], all parallel cylinders together."""
        counts = {"barrel": self.count, "rod": self.count}
        masses = {name: counts.get(name, 1) * mass for name, mass in self.masses.items()}
        return {name: mass for name, mass in masses.items() if np.any(mass != 0)}

    def volumes(
        self,
        extension: Numbers,
        areas: tuple[Numbers, Numbers] | None = None,
        stroke: Numbers = None,
    ) -> tuple[Numbers, Numbers]:
        """A1 s + Vd1, A2 (S − s) + Vd2 [m³] at an extension s [m]."""
        bore_area, annulus_area = areas or (self.bore_area, self.annulus_area)
        stroke = self.stroke if stroke is None else stroke
        return (
            bore_area * extension + self.cap_dead_volume,
            annulus_area * (stroke - extension) + self.annulus_dead_volume,
        )


@dataclass(frozen=True, kw_only=True)
class Motor(Actuator):
    """``count`` equal hydraulic motors that turn a joint through a gear, without end.

    The oil between valve and pistons is trapped in constant volumes; all of it counts as dead
    volume.

    Attributes:
        joint: name of the joint.
        displacement: oil per turn of one motor [m³].
        gear_ratio: turns of a motor per turn of the joint.
    """

    kind: ClassVar[str] = "motor"
    chambers: ClassVar[tuple[str, str]] = ("side a", "side b")

    joint: str
    displacement: float
    gear_ratio: float
    stroke: float = math.inf
    closed_length: float = 0.0

    @property
    def bore_area(self) -> float:
        """Oil per angle of the joint, all together [m³/rad]."""
        return self.count * self.displacement * self.gear_ratio / (2 * math.pi)

    @property
    def annulus_area(self) -> float:
        """Oil per angle of the joint, all together [m³/rad]: as much as on the other side."""
        return self.bore_area

    def volumes(
        self,
        extension: Numbers,
        areas: tuple[Numbers, Numbers] | None = None,
        stroke: Numbers = None,
    ) -> tuple[Numbers, Numbers]:
        """Oil trapped on either side [m³], the same at every angle."""
        any_angle = np.zeros_like(extension)
        return self.cap_dead_volume + any_angle, self.annulus_dead_volume + any_angle


def areas_of(actuators: Iterable[Actuator]) -> Array:
    """Bore and annulus area of each actuator, all in parallel together (nc, 2) [m², m³/rad]."""
    return np.array([[one.bore_area, one.annulus_area] for one in actuators])


def available_pressures(actuators: Iterable[Actuator], supply: Supply) -> Array:
    """Largest pressure of a working chamber of each actuator (nc,) [Pa]."""
    return np.array([one.available_pressure(supply) for one in actuators])
