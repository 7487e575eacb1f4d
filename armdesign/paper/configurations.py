"""The paper's 40 configurations in closed form: eight load masses m2 times five link lengths l2.

The paper gives no number of any of them; machine ``paper_1dof`` and the constants
below stand in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from armdesign.arrays import Array, Numbers
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.paper import formulas

MACHINE = "paper_1dof"
MASSES = (50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0)  # [kg]
LENGTHS = (0.5, 0.75, 1.0, 1.25, 1.5)  # [m]
# [rad/s], root mean square error of (11) in the paper; the error of (42) is missing in our copy
PUBLISHED = 23.49

FORMULAS = {
    "static_11": "rigid load, static mass: (11), bore area",
    "static_12_as_printed": "rigid load, static mass: (12) as printed",
    "static_12": "rigid load, static mass: (12) corrected",
    "reflected_12": "rigid load, reflected mass J/r²: (12) corrected",
    "joint_42_as_printed": "joint-coupled: (42) as printed, bore area",
    "joint_42_mean_area": "joint-coupled: (42) as printed, mean area",
    "joint_exact": "joint-coupled, exact, both areas",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class Mechanism:
    """The paper's mechanism at θ0 = π/2 with an asymmetric cylinder.

    SI, numbers or arrays that broadcast together.
    """

    load_mass: Numbers  # m2
    link_length: Numbers  # l2
    link_pin_distance: Numbers  # a1
    base_pin_distance: Numbers  # d1
    bore_area: Numbers  # A1
    annulus_area: Numbers  # A2
    cap_volume: Numbers  # V1, dead volume included
    annulus_volume: Numbers  # V2, dead volume included
    stroke: Numbers  # of the piston
    bulk_modulus: Numbers  # β

    @classmethod
    def of(cls, machine: Machine, load_mass: Numbers, link_length: Numbers) -> Mechanism:
        """The mechanism of a machine like ``paper_1dof``, under loads other than its own."""
        cylinder, linkage = machine.cylinders[0], machine.linkages[0]
        base, rod_end = (np.array(linkage.place(pin)) for pin in ("base", "rod_end"))
        extension = machine.at(np.zeros(1)).lengths[0, 0] - cylinder.closed_length
        cap, annulus = cylinder.volumes(extension)
        return cls(
            load_mass=load_mass,
            link_length=link_length,
            link_pin_distance=float(np.linalg.norm(rod_end)),
            base_pin_distance=float(np.linalg.norm(base)),
            bore_area=cylinder.bore_area,
            annulus_area=cylinder.annulus_area,
            cap_volume=cap,
            annulus_volume=annulus,
            stroke=cylinder.stroke,
            bulk_modulus=machine.fluid.bulk_modulus,
        )

    def _arguments(self, *names: str) -> dict[str, Numbers]:
        """Some of its numbers, as ``formulas`` take them."""
        return {name: getattr(self, name) for name in names}

    @property
    def pins(self) -> dict[str, Numbers]:
        """a1 and d1, as ``formulas`` take them."""
        return self._arguments("link_pin_distance", "base_pin_distance")

    @property
    def loaded(self) -> dict[str, Numbers]:
        """Load and pins, as ``formulas`` take them."""
        return self._arguments("load_mass", "link_length") | self.pins

    @property
    def chambers(self) -> dict[str, Numbers]:
        """Areas, volumes and oil, as ``formulas`` take them."""
        areas, volumes = ("bore_area", "annulus_area"), ("cap_volume", "annulus_volume")
        return self._arguments(*areas, *volumes, "bulk_modulus")

    @property
    def stiffness(self) -> Numbers:
        """k_h of both chambers [N/m]: β (A1²/V1 + A2²/V2)."""
        return self.bulk_modulus * (
            self.bore_area**2 / self.cap_volume + self.annulus_area**2 / self.annulus_volume
        )

    @property
    def symmetric(self) -> dict[str, Numbers]:
        """The paper's A and V0 from the bore side; it does not say what they are if asymmetric."""
        oil = self._arguments("bulk_modulus")
        return {"area": self.bore_area, "chamber_volume": self.cap_volume, **oil}

    @property
    def symmetric_mean(self) -> dict[str, Numbers]:
        """The paper's A and V0 as means of both sides."""
        area, volume = self.bore_area + self.annulus_area, self.cap_volume + self.annulus_volume
        return {**self.symmetric, "area": area / 2, "chamber_volume": volume / 2}

    @property
    def static_mass(self) -> Numbers:
        """Mass that the paper puts into (11) [kg]: its weight is the static force at θ0."""
        return formulas.equivalent_mass(static_force=formulas.static_force(**self.loaded))

    @property
    def frequencies(self) -> dict[str, Numbers]:
        """Natural frequency [Hz] by each of ``FORMULAS``."""
        load = self._arguments("load_mass", "link_pin_distance", "link_length")
        inertia, arm = formulas.joint_inertia(**load), formulas.moment_arm(**self.pins)
        reflected = {"mass": formulas.reflected_mass(joint_inertia=inertia, moment_arm=arm)}
        static, chambers, loaded = {"mass": self.static_mass}, self.chambers, self.loaded
        printed_12 = formulas.rigid_load_asymmetric_as_printed
        printed_42 = formulas.joint_coupled_as_printed
        return {
            "static_11": formulas.rigid_load(**static, **self.symmetric),
            "static_12_as_printed": printed_12(**static, **chambers),
            "static_12": formulas.rigid_load_asymmetric(**static, **chambers),
            "reflected_12": formulas.rigid_load_asymmetric(**reflected, **chambers),
            "joint_42_as_printed": printed_42(**loaded, **self.symmetric),
            "joint_42_mean_area": printed_42(**loaded, **self.symmetric_mean),
            "joint_exact": formulas.joint_coupled(**loaded, stiffness=self.stiffness),
        }

    def with_gravity(self, stiffness: Numbers, inertia: Numbers = 0.0) -> Numbers:
        """Frequency [Hz] if gravity took ``stiffness`` [N m/rad], ``inertia`` [kg m²] added."""
        arm = formulas.moment_arm(**self.pins)
        total = self.load_mass * (self.link_pin_distance**2 + self.link_length**2) + inertia
        net = np.maximum(self.stiffness * arm**2 - stiffness, 0.0)
        return np.sqrt(net / total) / (2 * math.pi)


def grid(
    machine: Machine, masses: Sequence[float] = MASSES, lengths: Sequence[float] = LENGTHS
) -> Mechanism:
    """All configurations: arrays (masses × lengths,) in which the length changes fastest.

    Raises:
        ArmDesignError: no mass or no length, or one that is not positive.
    """
    for name, values in (("masses", masses), ("lengths", lengths)):
        wrong = [value for value in values if not (math.isfinite(value) and value > 0)]
        if wrong or len(values) == 0:
            fault = f"{wrong[0]:g} is not allowed" if wrong else "none given"
            raise ArmDesignError(f"paper: {name}", fault, "give positive numbers in kg and m")
    pairs = np.array(list(product(masses, lengths)))
    return Mechanism.of(machine, pairs[:, 0], pairs[:, 1])


def rms_error(computed: Numbers, reference: Numbers, axis: int | tuple[int, ...] = -1) -> Numbers:
    """Root mean square [rad/s] of the difference of frequencies in Hz, the paper's measure."""
    return 2 * math.pi * np.sqrt(np.mean((np.asarray(computed) - reference) ** 2, axis=axis))


def error_of(computed: Mapping[str, Array], reference: Array) -> dict[str, float]:
    """Root mean square error [rad/s] of each formula's frequencies, (n,) [Hz] both."""
    return {name: float(rms_error(values, reference)) for name, values in computed.items()}
