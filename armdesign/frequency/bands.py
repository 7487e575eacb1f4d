"""Uncertainty bands of oil, air, load and mass, and the worst frequency within them.

Without air K − λM is affine in bulk modulus, payload and link masses, so the lowest λ of a pose is
quasi-concave in them and least at a corner of the bands (THEORY §6). Softer oil, more air and more
dead volume lower the oil stiffness and nothing else, so for them the corner is known; masses add
inertia but also static load, and both of their ends are tried. With air the static pressure
stiffens the oil, λ is no longer quasi-concave in the masses, and values between their ends are
tried too: a sample, no proof.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import worst_frequency
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine

SAMPLES = 5  # of a mass, ends included, where the oil carries air
EXACT = (1.0, 1.0)
F = TypeVar("F", Cylinder, Motor)


@dataclass(frozen=True, kw_only=True)
class Bands:
    """Lower and upper end of uncertain data, as shares of the machine's values.

    Attributes:
        bulk_modulus: of the oil.
        dead_volume: of all chambers, hoses with it.
        payload: of every load case's mass.
        link_mass: of every link's mass and inertia; bars of cylinders and four-bars stay as they
            are.
        air: entrained air itself, volume share at atmospheric pressure; None: the machine's.
    """

    bulk_modulus: tuple[float, float] = EXACT
    dead_volume: tuple[float, float] = EXACT
    payload: tuple[float, float] = EXACT
    link_mass: tuple[float, float] = EXACT
    air: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            band = getattr(self, field.name)
            least, most = (0.0, 0.5) if field.name == "air" else (0.1, 10.0)
            if band is None:
                continue
            numbers = len(band) == 2 and all(
                isinstance(x, int | float | np.number) and math.isfinite(x) for x in band
            )
            if not (numbers and least <= band[0] <= band[1] <= most):
                remedy = f"give (lower, upper) within [{least:g}, {most:g}]"
                raise ArmDesignError(f"bands.{field.name}", f"{band!r} is not allowed", remedy)

    @classmethod
    def of(cls, machine: Machine) -> Bands:
        """The bands that the machine's file states; exact where it states none."""
        section = machine.section.bands
        air = section.entrained_air_percent
        return cls(
            bulk_modulus=_pair(section.bulk_modulus_share),
            dead_volume=_pair(section.dead_volume_share),
            payload=_pair(section.payload_share),
            link_mass=_pair(section.link_mass_share),
            air=(air[0] / 100, air[1] / 100) if air else None,
        )

    def with_oil(self, machine: Machine, softest: bool) -> Machine:
        """The machine with bulk modulus, air and dead volumes at their soft or stiff ends."""
        end = 0 if softest else 1
        modulus, volume = self.bulk_modulus[end], self.dead_volume[1 - end]
        air = machine.fluid.air if self.air is None else self.air[1 - end]
        fluid = replace(machine.fluid, bulk_modulus=modulus * machine.fluid.bulk_modulus, air=air)
        return replace(
            machine,
            fluid=fluid,
            cylinders=tuple(_with_volumes(cylinder, volume) for cylinder in machine.cylinders),
            motors=tuple(_with_volumes(motor, volume) for motor in machine.motors),
        )

    def with_largest_volumes(self, cylinder: Cylinder) -> Cylinder:
        """The cylinder with the largest dead volumes, as it is with the softest oil."""
        return _with_volumes(cylinder, self.dead_volume[1])

    def mass_shares(self, machine: Machine) -> list[tuple[float, float]]:
        """Shares of payload and of link mass to try: the corners, with air also between them."""
        air = machine.fluid.air > 0 or (self.air is not None and self.air[1] > 0)
        count = SAMPLES if air else 2
        values = (np.linspace(*band, count).tolist() for band in (self.payload, self.link_mass))
        return list(dict.fromkeys(itertools.product(*values)))


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One set of values within the bands, and the worst frequency over poses and load cases there.

    Attributes:
        frequency: worst coupled natural frequency [Hz].
        payload: name of its load case.
        q: its pose (nq,) [rad, m].
        softest: whether the oil is at its soft ends; else at its stiff ends.
        payload_share: factor on the mass of every load case.
        link_share: factor on all masses and inertias of the bare links.
    """

    frequency: float
    payload: str
    q: Array
    softest: bool
    payload_share: float
    link_share: float


@dataclass(frozen=True, kw_only=True)
class FrequencyBand:
    """The worst frequency [Hz] in the worst and the best scenario, and with the file's values."""

    low: Scenario
    nominal: float
    high: Scenario


def frequency_band(
    machine: Machine, workspace: Workspace, bands: Bands | None = None
) -> FrequencyBand:
    """Worst coupled frequency over poses and load cases, least and greatest within the bands.

    Args:
        machine: the machine.
        workspace: poses that count; the worst is taken among them, not between them.
        bands: what is not known exactly; None: the machine's file states them.
    """
    bands = bands or Bands.of(machine)
    return FrequencyBand(
        low=worst_within(machine, workspace, bands),
        nominal=worst_frequency(machine, workspace).frequency,
        high=max(_scenarios(machine, workspace, bands, softest=False), key=_frequency),
    )


def worst_within(machine: Machine, workspace: Workspace, bands: Bands) -> Scenario:
    """The worst scenario within the bands, the lower end of ``frequency_band``."""
    return min(_scenarios(machine, workspace, bands, softest=True), key=_frequency)


def _scenarios(
    machine: Machine, workspace: Workspace, bands: Bands, softest: bool
) -> Iterator[Scenario]:
    with_oil = bands.with_oil(machine, softest)
    for shares in bands.mass_shares(machine):
        frequency, payload, q = worst_frequency(with_oil, workspace, *shares)
        yield Scenario(
            frequency=frequency,
            payload=payload,
            q=q,
            softest=softest,
            payload_share=shares[0],
            link_share=shares[1],
        )


def _frequency(scenario: Scenario) -> float:
    return scenario.frequency


def _with_volumes(actuator: F, share: float) -> F:
    names = ("cap_dead_volume", "annulus_dead_volume", "cap_hose_volume", "annulus_hose_volume")
    return replace(actuator, **{name: share * getattr(actuator, name) for name in names})


def _pair(band: list[float] | None) -> tuple[float, float]:
    return (band[0], band[1]) if band else EXACT
