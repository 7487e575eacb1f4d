"""Uncertainty bands of oil, structure, load and mass, and the worst frequency within them.

Structure (pins, brackets, links, pillar) yields in series with each actuator: 1/k = 1/k_oil + c.
Its c is stated as a share of today's oil's own compliance at mid stroke, 0 rigid and 1 as soft as
the oil. A new cylinder leaves c in m/N as it was: the structure around it is today's.

Without air K − λM is affine in bulk modulus, payload and link masses, so the lowest λ of a pose is
quasi-concave in them and least at a corner of the bands (THEORY §6). Softer oil, more air, more
dead volume and softer structure lower the stiffness and nothing else, but for the few mm by which
a structure that gives way lets the piston stand elsewhere, so for them the corner is known; masses
add inertia but also static load, and both of their ends are tried. With air the static pressure
stiffens the oil, λ is no longer quasi-concave in the masses, and values between their ends are
tried too: a sample, no proof.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple, TypeVar

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import worst_frequency
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine

SAMPLES = 5  # of a mass, ends included, where the oil carries air
EXACT = (1.0, 1.0)
ENDS = {"air": (0.0, 0.5), "structure": (0.0, 10.0)}  # allowed, of bands that may begin at zero
VOLUMES = ("cap_dead_volume", "annulus_dead_volume", "cap_hose_volume", "annulus_hose_volume")
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
        structure: compliance in series with each actuator, over that of its oil at mid stroke,
            0 where the structure is rigid; None: the machine's own.
        spring_stiffness: of all springs, on which the machine's passive joints yield.
    """

    bulk_modulus: tuple[float, float] = EXACT
    dead_volume: tuple[float, float] = EXACT
    payload: tuple[float, float] = EXACT
    link_mass: tuple[float, float] = EXACT
    air: tuple[float, float] | None = None
    structure: tuple[float, float] | None = None
    spring_stiffness: tuple[float, float] = EXACT

    def __repr__(self) -> str:
        """The bands that are stated, as they are written in Python."""
        stated = [f for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Bands({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in stated)})"

    def __post_init__(self) -> None:
        for field in fields(self):
            band = getattr(self, field.name)
            least, most = ENDS.get(field.name, (0.1, 10.0))
            if band is None:
                continue
            numbers = (
                isinstance(band, Sequence | np.ndarray)
                and len(band) == 2
                and all(isinstance(x, int | float | np.number) and math.isfinite(x) for x in band)
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
            structure=_pair(section.structure) if section.structure else None,
            spring_stiffness=_pair(section.spring_stiffness_share),
        )

    def at_end(self, machine: Machine, softest: bool, today: Machine | None = None) -> Machine:
        """The machine with oil, dead volumes, structure and springs at their soft or stiff ends.

        Shares of structure are of the oil of ``today``'s machine; of its own if None.
        """
        fluid, today = machine.fluid, today or machine
        modulus = self.bulk_modulus[not softest] * fluid.bulk_modulus
        air = fluid.air if self.air is None else self.air[softest]
        return replace(
            machine,
            fluid=replace(fluid, bulk_modulus=modulus, air=air),
            cylinders=self.actuators_at_end(machine.cylinders, softest, today),
            motors=self.actuators_at_end(machine.motors, softest, today),
            springs=tuple(
                replace(one, stiffness=self.spring_stiffness[not softest] * one.stiffness)
                for one in machine.springs
            ),
        )

    def actuators_at_end(
        self, actuators: Iterable[F], softest: bool, today: Machine
    ) -> tuple[F, ...]:
        """Actuators that are or could be a machine's, with dead volumes and structure of an end.

        Those of one name have the structure that ``today``'s machine has there.
        """
        volume, yielding = self.dead_volume[softest], {}
        if self.structure is not None:
            yielding = {
                one.name: self.structure[softest] * one.oil_compliance(today.fluid, today.supply)
                for one in (*today.cylinders, *today.motors)
            }

        if volume == 1.0 and not yielding:
            return tuple(actuators)

        def at_end(actuator: F) -> F:
            volumes = {name: volume * getattr(actuator, name) for name in VOLUMES}
            compliance = yielding.get(actuator.name, actuator.compliance)
            return replace(actuator, **volumes, compliance=compliance)

        return tuple(map(at_end, actuators))

    @property
    def ends(self) -> tuple[bool, ...]:
        """The ends of oil and structure as ``softest``: soft and stiff, or one if they are one."""
        bands = (
            self.bulk_modulus,
            self.dead_volume,
            self.air,
            self.structure,
            self.spring_stiffness,
        )
        return (True, False) if any(band and band[0] < band[1] for band in bands) else (True,)

    def corners(self, machine: Machine, ends: Sequence[bool]) -> list[Corner]:
        """All corners of the bands at some ends of oil and structure."""
        shares = self.mass_shares(machine)
        return [Corner(softest, *masses) for softest in ends for masses in shares]

    def mass_shares(self, machine: Machine) -> list[tuple[float, float]]:
        """Shares of payload and of link mass to try: the corners, with air also between them."""
        air = machine.fluid.air > 0 or (self.air is not None and self.air[1] > 0)
        count = SAMPLES if air else 2
        values = (np.linspace(*band, count).tolist() for band in (self.payload, self.link_mass))
        return list(dict.fromkeys(itertools.product(*values)))


class Corner(NamedTuple):
    """A corner of the bands.

    Attributes:
        softest: whether oil and structure are at their soft ends; else at their stiff ends.
        payload_share: factor on the mass of every load case.
        link_share: factor on all masses and inertias of the bare links.
    """

    softest: bool
    payload_share: float
    link_share: float


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """One set of values within the bands, and the worst frequency over poses and load cases there.

    Attributes:
        frequency: worst coupled natural frequency [Hz].
        payload: name of its load case.
        q: its pose (nq,) [rad, m].
        corner: the values.
    """

    frequency: float
    payload: str
    q: Array
    corner: Corner


@dataclass(frozen=True, kw_only=True)
class FrequencyBand:
    """The worst frequency [Hz] over poses and load cases within the bands.

    Attributes:
        scenarios: at all corners of the bands, in one order for all machines.
        nominal: with the file's values [Hz].
    """

    scenarios: tuple[Scenario, ...]
    nominal: float

    @property
    def low(self) -> Scenario:
        """The worst scenario."""
        return min(self.scenarios, key=_frequency)

    @property
    def high(self) -> Scenario:
        """The scenario with the highest worst frequency: structure rigid, oil stiff."""
        return max(self.scenarios, key=_frequency)

    def least_gain(self, today: FrequencyBand) -> float:
        """Least relative gain over today's machine, at the corners and with the file's values."""
        pairs = zip(self.scenarios, today.scenarios, strict=True)
        gains = [new.frequency / old.frequency for new, old in pairs if old.frequency > 0]
        if today.nominal > 0:
            gains.append(self.nominal / today.nominal)
        return min(gains, default=math.inf) - 1


def frequency_band(
    machine: Machine,
    workspace: Workspace,
    bands: Bands | None = None,
    *,
    today: Machine | None = None,
) -> FrequencyBand:
    """Worst coupled frequency over poses and load cases, at all corners of the bands.

    Args:
        machine: the machine.
        workspace: poses that count; the worst is taken among them, not between them.
        bands: what is not known exactly; None: the machine's file states them.
        today: the machine that this one was made from, whose structure it keeps; None: itself.
    """
    bands = bands or Bands.of(machine)
    return FrequencyBand(
        scenarios=tuple(
            scenario(machine, workspace, bands, corner, today)
            for corner in bands.corners(machine, bands.ends)
        ),
        nominal=worst_frequency(machine, workspace).frequency,
    )


def worst_within(
    machine: Machine, workspace: Workspace, bands: Bands, today: Machine | None = None
) -> Scenario:
    """The worst scenario within the bands, the lower end of ``frequency_band``."""
    corners = bands.corners(machine, (True,))
    return min(
        (scenario(machine, workspace, bands, corner, today) for corner in corners), key=_frequency
    )


def scenario(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    corner: Corner,
    today: Machine | None = None,
) -> Scenario:
    """The worst frequency of a machine at one corner of the bands; as in ``frequency_band``."""
    at_end = bands.at_end(machine, corner.softest, today)
    worst = worst_frequency(at_end, workspace, corner.payload_share, corner.link_share)
    return Scenario(frequency=worst.frequency, payload=worst.payload, q=worst.q, corner=corner)


def _frequency(scenario: Scenario) -> float:
    return scenario.frequency


def _pair(band: list[float] | None) -> tuple[float, float]:
    return (band[0], band[1]) if band else EXACT
