"""The hydraulic cylinder, and the motor: areas, oil spring, static pressures, buckling, mass.

All formulas are elementwise on arrays; areas and volumes are those of all parallel cylinders of a
actuator together. They accept complex numbers, so that a complex step gives their exact
derivative.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.hydraulics.valve import RELIEF_SHARE, Friction, LoadHolding, Valve
from armdesign.units import MPa

STEEL_MODULUS = 210e9  # [Pa] Young's modulus of the rod
STEEL_DENSITY = 7850.0  # [kg/m³]
BARREL_STRESS = 355e6 / 1.5  # [Pa] yield strength of E355 tube (EN 10305-1) over a safety of 1.5
NO_FRICTION = Friction()
BELOW_RELIEF = 0.95  # of the relief: a preload presses the loaded chamber no further


@dataclass(frozen=True, kw_only=True)
class Fluid:
    """Oil: bulk modulus without air [Pa], entrained air (volume share at atmospheric pressure), density [kg/m³]."""

    bulk_modulus: float
    air: float = 0.0
    density: float = 870.0


@dataclass(frozen=True, kw_only=True)
class Supply:
    """Pump pressure and return pressure [Pa], flow [m³/s].

    The pump holds its pressure whatever the actuators take, or, ``flow_limited``, gives no more
    than its flow: it cuts off linearly within the last share ``cut_off`` of its pressure and fills
    a line of ``line_volume`` [m³].
    """

    pressure: float
    return_pressure: float
    flow: float
    flow_limited: bool = False
    cut_off: float = 0.05
    line_volume: float = 5e-3


@dataclass(frozen=True, kw_only=True)
class Actuator(ABC):
    """A hydraulic actuator with two chambers of oil, hoses, valve and friction: a cylinder or a motor.

    The chamber that drives in the positive direction is called cap, the other annulus. Volumes
    [m³] are those of all ``count`` together. A motor turns where a cylinder is pushed: its lengths
    are angles [rad], its forces torques [N m] and its areas oil per angle [m³/rad].
    """

    name: str
    count: int = 1
    stroke: float
    closed_length: float
    cap_dead_volume: float
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
    def chambers(
        self, bore_area: Any, annulus_area: Any, extension: Any, stroke: Any
    ) -> tuple[Any, Any]:
        """Volumes of cap and annulus [m³] with other areas [m²] and stroke [m]."""

    def volumes(self, extension: Any) -> tuple[Any, Any]:
        """Oil in cap and annulus chamber [m³] at an extension [m]."""
        return self.chambers(self.bore_area, self.annulus_area, extension, self.stroke)

    def relief(self, supply: Supply) -> float:
        """Where its port reliefs open [Pa]; inf without a valve."""
        if self.valve is None:
            return math.inf
        return RELIEF_SHARE * supply.pressure if self.valve.relief is None else self.valve.relief

    def preload(self, return_pressure: float) -> float:
        """Pressure of the chamber without load behind a shut valve [Pa]: what its file asks for, else the return's."""
        asked = None if self.valve is None else self.valve.preload
        return return_pressure if asked is None else asked

    def static_pressures(self, force: Any, supply: Supply) -> tuple[Any, Any]:
        """Pressures of cap and annulus [Pa] behind a shut valve under a static force [N, + pushes].

        Simulations start at them, ``check`` and maps name them, and oil with air is as stiff as
        they make it.
        """
        back = supply.return_pressure
        at, relief = self.preload(back), self.relief(supply)
        return preloaded_pressures(force, self.bore_area, self.annulus_area, at, back, relief)

    def stiffness(
        self,
        extension: Any,
        force: Any,
        fluid: Fluid,
        return_pressure: float,
        relief: float = math.inf,
    ) -> Any:
        """Oil stiffness [N/m] at an extension [m] under a static force [N, + pushes], valve closed; see ``relief``."""
        a1, a2 = self.bore_area, self.annulus_area
        return stiffness(
            self, a1, a2, extension, self.stroke, force, fluid, return_pressure, relief
        )


@dataclass(frozen=True, kw_only=True)
class Cylinder(Actuator):
    """``count`` equal double-acting cylinders that share pins, valve and hoses.

    Bore, rod, stroke, closed length [m], masses and friction are those of one cylinder.
    """

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
        """What head, piston and eyes take: closed length − stroke [m]."""
        return self.closed_length - self.stroke

    @property
    def masses(self) -> dict[str, float]:
        """Mass of one barrel, of one rod and of every bar of the linkage [kg]."""
        return {"barrel": self.barrel_mass, "rod": self.rod_mass, **dict(self.linkage_masses)}

    @property
    def moving_masses(self) -> dict[str, float]:
        """Mass of each bar that weighs [kg], all parallel cylinders together."""
        counts = {"barrel": self.count, "rod": self.count}
        masses = {name: counts.get(name, 1) * mass for name, mass in self.masses.items()}
        return {name: mass for name, mass in masses.items() if mass > 0}

    def chambers(
        self, bore_area: Any, annulus_area: Any, extension: Any, stroke: Any
    ) -> tuple[Any, Any]:
        """A1 s + Vd1, A2 (S − s) + Vd2 [m³]."""
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
        """As much as the other side takes."""
        return self.bore_area

    def chambers(
        self, bore_area: Any, annulus_area: Any, extension: Any, stroke: Any
    ) -> tuple[Any, Any]:
        """The trapped volumes [m³], whatever the angle."""
        any_angle = 0.0 * extension
        return self.cap_dead_volume + any_angle, self.annulus_dead_volume + any_angle


def kind(actuator: Actuator) -> str:
    """What it is called in a sentence: "cylinder" or "motor"."""
    return "motor" if isinstance(actuator, Motor) else "cylinder"


def stiffness(
    actuator: Actuator,
    bore_area: Any,
    annulus_area: Any,
    extension: Any,
    stroke: Any,
    force: Any,
    fluid: Fluid,
    return_pressure: float,
    relief: float = math.inf,
) -> Any:
    """Stiffness [N/m] of an actuator like this, but with other areas [m²] and stroke [m].

    Complex-safe.

    Each chamber has its own bulk modulus at its static pressure when the oil carries air. A series
    compliance gives way under the static force, so the piston stands further out than the pins
    say.
    """
    if actuator.compliance > 0:
        extension = extension + actuator.compliance * force
    beta: tuple[Any, Any] = (fluid.bulk_modulus, fluid.bulk_modulus)
    if fluid.air > 0:
        at = actuator.preload(return_pressure)
        pressures = preloaded_pressures(
            force, bore_area, annulus_area, at, return_pressure, relief
        )
        beta = tuple(bulk_modulus(p, fluid.bulk_modulus, fluid.air) for p in pressures)
    cap, annulus = actuator.chambers(bore_area, annulus_area, extension, stroke)
    return oil_stiffness(
        bore_area,
        annulus_area,
        cap / beta[0] + actuator.cap_hose_volume / actuator.hose_modulus,
        annulus / beta[1] + actuator.annulus_hose_volume / actuator.hose_modulus,
        actuator.compliance,
    )


def oil_stiffness(
    bore_area: Any,
    annulus_area: Any,
    cap_capacity: Any,
    annulus_capacity: Any,
    compliance: float = 0.0,
) -> Any:
    """Stiffness of two trapped chambers [N/m]: k = A1²/C1 + A2²/C2, in series with a structural compliance.

    Without hoses C = V/β, which gives k_h = β (A1²/V1 + A2²/V2) (Pencelli et al. 2019, eq. 12
    without its factor 2).

    Args:
        bore_area: A1 [m²].
        annulus_area: A2 [m²].
        cap_capacity: C1 = V1/β1 + V_hose/β_hose [m³/Pa].
        annulus_capacity: C2 [m³/Pa].
        compliance: of pins, brackets and links in series [m/N].
    """
    oil = bore_area**2 / cap_capacity + annulus_area**2 / annulus_capacity
    return oil / (1 + compliance * oil)


def static_pressures(
    force: Any, bore_area: Any, annulus_area: Any, return_pressure: Any
) -> tuple[Any, Any]:
    """Pressures of cap and annulus chamber [Pa] under a static force [N, + pushes]: F = A1 p1 − A2 p2.

    The chamber that carries the load takes what the other, at return pressure, leaves to it.
    """
    cap = (force + annulus_area * return_pressure) / bore_area
    annulus = (bore_area * return_pressure - force) / annulus_area
    pushes = np.real(cap) >= np.real(return_pressure)
    return np.where(pushes, cap, return_pressure), np.where(pushes, return_pressure, annulus)


def preloaded_pressures(
    force: Any,
    bore_area: Any,
    annulus_area: Any,
    preload: Any,
    return_pressure: float,
    relief: float,
) -> tuple[Any, Any]:
    """As ``static_pressures``, the chamber without load at a ``preload`` [Pa]; complex-safe.

    Where that would press the loaded chamber against its ``relief`` [Pa], the preload is as much
    less as keeps it a little below, down to return pressure.
    """
    lower = np.maximum(preload, return_pressure)
    if np.all(lower == return_pressure):
        return static_pressures(force, bore_area, annulus_area, return_pressure)
    if math.isfinite(relief):
        limit = np.maximum(BELOW_RELIEF * relief, lower)
        for most in (
            (bore_area * limit - force) / annulus_area,
            (annulus_area * limit + force) / bore_area,
        ):
            lower = np.where(np.real(most) < np.real(lower), most, lower)
        lower = np.where(np.real(lower) < return_pressure, return_pressure, lower)
    return static_pressures(force, bore_area, annulus_area, lower)


def softest_extension(bore_area: float, annulus_area: float, stroke: float) -> float:
    """Extension of least oil stiffness without dead volume [m]: s* = S √A1/(√A1 + √A2), where k = β(√A1 + √A2)²/S."""
    root_1, root_2 = math.sqrt(bore_area), math.sqrt(annulus_area)
    return stroke * root_1 / (root_1 + root_2)


def holding_force(bore_area: Any, annulus_area: Any, supply: Supply, pushes: Any) -> Any:
    """Largest static force [N] of supply pressure against return pressure, pushing or pulling."""
    push = supply.pressure * bore_area - supply.return_pressure * annulus_area
    pull = supply.pressure * annulus_area - supply.return_pressure * bore_area
    return np.where(pushes, push, pull)


def euler_safety(bore: Any, rod: Any, open_length: Any, supply_pressure: float) -> Any:
    """Euler buckling load of the rod over the supply's thrust: π² E I/(L² p A), I = π d⁴/64, L pin to pin, rod out."""
    inertia = math.pi * rod**4 / 64
    thrust = supply_pressure * math.pi / 4 * bore**2
    return math.pi**2 * STEEL_MODULUS * inertia / (open_length**2 * thrust)


def barrel_ratio(pressure: Any) -> Any:
    """Outer over inner diameter of a barrel that just carries a pressure [Pa].

    Lamé's thick wall yields inside first, where σ_θ − σ_r = 2 p k²/(k² − 1); equal to σ =
    ``BARREL_STRESS`` (Tresca) that gives k² = σ/(σ − 2 p). For a thin wall it is Barlow's t = p
    D/(2 σ).

    Raises:
        ArmDesignError: no wall carries the pressure, 2 p ≥ σ.
    """
    if np.any(np.real(pressure) < 0) or np.any(2 * np.real(pressure) >= BARREL_STRESS):
        raise ArmDesignError(
            "supply.pressure",
            f"no steel barrel carries {np.max(np.real(pressure)) / MPa:.4g} MPa",
            f"give 0 to {BARREL_STRESS / 2 / MPa:.4g} MPa",
        )
    return (BARREL_STRESS / (BARREL_STRESS - 2 * pressure)) ** 0.5


def barrel_outer(bore: Any, wall: float | None, pressure: Any) -> Any:
    """Outer diameter of a barrel [m]: with its wall [m], or as thick as ``barrel_ratio`` says a pressure [Pa] needs."""
    return bore + 2 * wall if wall is not None else barrel_ratio(pressure) * bore


def estimated_mass(bore: Any, rod: Any, stroke: Any, pressure: Any) -> Any:
    """Mass of one cylinder [kg]: barrel, bottom, gland, piston and rod of steel, without oil, ports and eyes.

    Piston, gland and bottom are each half a bore long, the usual proportion; the rod passes
    through piston and gland. The barrel's wall is ``barrel_ratio`` of the pressure. Complex-safe.

    Args:
        bore: inner diameter D [m].
        rod: its diameter d [m].
        stroke: S [m].
        pressure: that the barrel is made for [Pa]; the supply's.
    """
    part = bore / 2
    outer = (barrel_ratio(pressure) * bore) ** 2
    barrel, bottom = (outer - bore**2) * (stroke + 2 * part), outer * part
    rings, bar = (bore**2 - rod**2) * 2 * part, rod**2 * (stroke + 2 * part)
    return STEEL_DENSITY * math.pi / 4 * (barrel + bottom + rings + bar)
