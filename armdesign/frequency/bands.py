"""What is not known exactly: bands of oil, air, load and mass, and the worst frequency within them.

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
    """Lower and upper end of what is not known exactly, as shares of the machine's values.

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
            band, limits = (
                getattr(self, field.name),
                (0.0, 0.5) if field.name == "air" else (0.1, 10.0),
            )
            if band is None:
                continue
            numbers = len(band) == 2 and all(
                isinstance(x, int | float | np.number) and math.isfinite(x) for x in band
            )
            if not (numbers and limits[0] <= band[0] <= band[1] <= limits[1]):
                remedy = f"give (lower, upper) within [{limits[0]:g}, {limits[1]:g}]"
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

    def oil(self, machine: Machine, softest: bool) -> Machine:
        """The machine with the softest or the stiffest oil: bulk modulus, air and dead volumes at one end."""
        end = 0 if softest else 1
        air = machine.fluid.air if self.air is None else self.air[1 - end]
        modulus, volume = (
            self.bulk_modulus[end] * machine.fluid.bulk_modulus,
            self.dead_volume[1 - end],
        )
        return replace(
            machine,
            fluid=replace(machine.fluid, bulk_modulus=modulus, air=air),
            cylinders=tuple(_with_oil(cylinder, volume) for cylinder in machine.cylinders),
            motors=tuple(_with_oil(motor, volume) for motor in machine.motors),
        )

    def softest(self, cylinder: Cylinder) -> Cylinder:
        """The cylinder with the largest dead volumes: as ``oil`` has it at the soft end."""
        return _with_oil(cylinder, self.dead_volume[1])

    def masses(self, machine: Machine) -> list[tuple[float, float]]:
        """Shares of payload and of link mass to try: the corners, and values between them where there is air."""
        air = machine.fluid.air > 0 or (self.air is not None and self.air[1] > 0)
        ends = (
            np.linspace(*band, SAMPLES if air else 2).tolist()
            for band in (self.payload, self.link_mass)
        )
        return list(dict.fromkeys(itertools.product(*ends)))


@dataclass(frozen=True, kw_only=True)
class Extreme:
    """One set of values within the bands and the worst frequency there, over all poses and load cases.

    Attributes:
        frequency: worst coupled natural frequency [Hz].
        payload: name of the load case.
        q: pose (nq,) [rad, m].
        softest: whether the oil is at its soft end; else at its stiff one.
        payload_share: of the load case's mass.
        link_share: of the links' masses.
    """

    frequency: float
    payload: str
    q: Array
    softest: bool
    payload_share: float
    link_share: float


@dataclass(frozen=True, kw_only=True)
class FrequencyBand:
    """The worst frequency at the bad and at the good end of what is not known exactly, and as the file has it [Hz]."""

    low: Extreme
    nominal: float
    high: Extreme


def frequency_band(
    machine: Machine, workspace: Workspace, bands: Bands | None = None
) -> FrequencyBand:
    """Worst coupled frequency over poses and load cases, least and greatest within the bands.

    Args:
        machine: the machine.
        workspace: poses that count; the worst is taken among them, not between them.
        bands: what is not known exactly; those of the machine's file if None.
    """
    bands = bands or Bands.of(machine)
    stiffest = [
        _worst(machine, workspace, bands, False, *shares) for shares in bands.masses(machine)
    ]
    return FrequencyBand(
        low=worst_within(machine, workspace, bands),
        nominal=_worst(machine, workspace, Bands(), True, 1.0, 1.0).frequency,
        high=max(stiffest, key=lambda case: case.frequency),
    )


def worst_within(machine: Machine, workspace: Workspace, bands: Bands) -> Extreme:
    """The lower end of ``frequency_band``: the worst that bands allow."""
    softest = [
        _worst(machine, workspace, bands, True, *shares) for shares in bands.masses(machine)
    ]
    return min(softest, key=lambda case: case.frequency)


def _worst(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    softest: bool,
    payload_share: float,
    link_share: float,
) -> Extreme:
    worst = worst_frequency(bands.oil(machine, softest), workspace, payload_share, link_share)
    return Extreme(
        frequency=worst.frequency,
        payload=worst.payload,
        q=worst.q,
        softest=softest,
        payload_share=payload_share,
        link_share=link_share,
    )


def _pair(band: list[float] | None) -> tuple[float, float]:
    return (band[0], band[1]) if band else EXACT


def _with_oil(actuator: F, volume: float) -> F:
    names = ("cap_dead_volume", "annulus_dead_volume", "cap_hose_volume", "annulus_hose_volume")
    return replace(actuator, **{name: volume * getattr(actuator, name) for name in names})
