"""Uncertainty bands of oil, structure, springs, load and mass: their ends and corners.

Structure (pins, brackets, links, pillar) yields in series with each actuator: 1/k = 1/k_oil + c.
Its c is stated as a share of today's oil's own compliance at mid stroke, 0 rigid and 1 as soft as
the oil. A new cylinder leaves c in m/N as it was: the structure around it is today's.

Without air K − λM is affine in bulk modulus, payload and link masses, so the lowest λ of a pose is
quasi-concave in them and least at a corner of the bands (docs/theory.md, masses within bands).
Softer oil, more air, more dead volume and softer structure lower the stiffness and nothing else,
but for the few mm by which a structure that gives way lets the piston stand elsewhere, so for them
the corner is known; masses add inertia but also static load, and both of their ends are tried.
With air the static pressure stiffens the oil, at first more and more with the load, so that λ need
not be quasi-concave in the masses, and values between their ends are tried too: a sample, no
proof. Designs are made for their ends, and for those between that turn out lower.

The gain of one machine over another has no such law: it may be least where some bands are soft and
others stiff, or amid them. So the ends of up to ``FEW`` bands are combined in all ways; of more,
those of oil are soft or stiff together, or those of structure, or both. Designs are made for these
corners, and judged at the other combinations and at places between too.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from armdesign.errors import ArmDesignError, choose
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine

SAMPLES = 5  # of a mass, ends included, where the oil carries air
BETWEEN = 15  # places between the corners at which gains are judged: one band's sixteenths
EXACT = (1.0, 1.0)
ASSUMED = (0.0, 1.0)  # structure of a file that states none: rigid, and as soft as the oil
# allowed, of bands that may begin at zero; a share of a new cylinder's oil may be any
ENDS = {"air": (0.0, 0.5), "structure": (0.0, 10.0), "structures": (0.0, 100.0)}
MASSES = ("payload", "link_mass")
OIL, SPRINGS = ("bulk_modulus", "dead_volume", "air"), ("spring_stiffness",)
STRUCTURE = "structure", "structures"
SOFT_UP = ("dead_volume", "air", *STRUCTURE)  # whose upper end is the soft one
FEW = 5  # bands of which all combinations of ends are corners
VOLUMES = ("cap_dead_volume", "annulus_dead_volume", "cap_hose_volume", "annulus_hose_volume")
F = TypeVar("F", Cylinder, Motor)
End: TypeAlias = frozenset[str]  # bands of stiffness that are soft, by name; the others are stiff
Masses: TypeAlias = tuple[float, float]  # shares of payload and of link mass


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
        structure: series compliance of each actuator over its oil's compliance at mid stroke,
            0 where the structure is rigid; None: the machine's own.
        structures: the same of single actuators, by name, before ``structure``.
        spring_stiffness: of all springs, on which the machine's passive joints yield.
    """

    bulk_modulus: tuple[float, float] = EXACT
    dead_volume: tuple[float, float] = EXACT
    payload: tuple[float, float] = EXACT
    link_mass: tuple[float, float] = EXACT
    air: tuple[float, float] | None = None
    structure: tuple[float, float] | None = None
    structures: Mapping[str, tuple[float, float]] | None = None
    spring_stiffness: tuple[float, float] = EXACT

    def __repr__(self) -> str:
        """The bands that are stated, as they are written in Python."""
        stated = [f for f in fields(self) if getattr(self, f.name) != f.default]
        return f"Bands({', '.join(f'{f.name}={getattr(self, f.name)!r}' for f in stated)})"

    @property
    def identity(self) -> str:
        """Everything in which two can differ."""
        return repr(self)

    def __post_init__(self) -> None:
        for path, band in self._stated:
            least, most = ENDS.get(path.split(".")[0], (0.1, 10.0))
            numbers = (
                isinstance(band, Sequence | np.ndarray)
                and len(band) == 2
                and all(isinstance(x, int | float | np.number) for x in band)
            )
            if not (numbers and least <= band[0] <= band[1] <= most):
                remedy = f"give (lower, upper) within [{least:g}, {most:g}]"
                raise ArmDesignError(f"bands.{path}", f"{band!r} is not allowed", remedy)
        for part in fields(self):  # Python's own numbers, whatever they were given as
            given: Any = getattr(self, part.name)
            if isinstance(given, Mapping):
                given = {name: tuple(map(float, one)) for name, one in given.items()}
            elif given is not None:
                given = tuple(map(float, given))
            object.__setattr__(self, part.name, given)

    @property
    def _stated(self) -> Iterator[tuple[str, tuple[float, float]]]:
        """Every band that there is, with its path."""
        for part in fields(self):
            band = getattr(self, part.name)
            if part.name == "structures":
                yield from ((f"structures.{name}", one) for name, one in (band or {}).items())
            elif band is not None:
                yield part.name, band

    @classmethod
    def of(cls, machine: Machine) -> Bands:
        """The bands that the machine's file states; exact where it states none.

        Example:
            >>> import armdesign as ad
            >>> print(ad.Bands.of(ad.load("excavator_20t")))
            Bands(structure=(0.0, 1.0))
        """
        section = machine.section.bands
        air = section.entrained_air_percent
        return cls(
            bulk_modulus=_pair(section.bulk_modulus_share),
            dead_volume=_pair(section.dead_volume_share),
            payload=_pair(section.payload_share),
            link_mass=_pair(section.link_mass_share),
            air=(air[0] / 100, air[1] / 100) if air else None,
            structure=_pair(section.structure) if section.structure else None,
            structures=({name: _pair(band) for name, band in section.structures.items()} or None),
            spring_stiffness=_pair(section.spring_stiffness_share),
        )

    @classmethod
    def shown(cls, machine: Machine) -> Bands:
        """The bands that its file states; if none, ``ASSUMED`` structure."""
        stated = cls.of(machine)
        return cls(structure=ASSUMED) if stated == cls() else stated

    def at_end(self, machine: Machine, soft: End, today: Machine | None = None) -> Machine:
        """The machine with oil, dead volumes, structure and springs at ends of their bands.

        Shares of structure are of the oil of ``today``'s machine; of its own if None.
        """
        fluid, today = machine.fluid, today or machine
        modulus = self.bulk_modulus[_upper("bulk_modulus", soft)] * fluid.bulk_modulus
        air = fluid.air if self.air is None else self.air[_upper("air", soft)]
        spring = self.spring_stiffness[_upper("spring_stiffness", soft)]
        return replace(
            machine,
            fluid=replace(fluid, bulk_modulus=modulus, air=air),
            cylinders=self.actuators_at_end(machine.cylinders, soft, today),
            motors=self.actuators_at_end(machine.motors, soft, today),
            springs=tuple(
                replace(one, stiffness=spring * one.stiffness) for one in machine.springs
            ),
        )

    def actuators_at_end(self, actuators: Iterable[F], soft: End, today: Machine) -> tuple[F, ...]:
        """Actuators that are or could be a machine's, with dead volumes and structure of an end.

        Actuators of one name have the structure that ``today``'s machine has there.
        """
        volume = self.dead_volume[_upper("dead_volume", soft)]
        named, structures = {one.name: one for one in today.actuators}, self.structures or {}
        for name in structures:
            if name not in named and name not in today.idle:
                fault = f"{today.name} has no such actuator"
                raise ArmDesignError(f"bands.structures.{name}", fault, choose(name, named))
        yielding = {
            name: shares[_upper(STRUCTURE[name in structures], soft)]
            * one.oil_compliance(today.fluid, today.supply)
            for name, one in named.items()
            if (shares := self.structure_of(name)) is not None
        }
        if volume == 1.0 and not yielding:
            return tuple(actuators)

        def at_end(actuator: F) -> F:
            volumes = {name: volume * getattr(actuator, name) for name in VOLUMES}
            compliance = yielding.get(actuator.name, actuator.compliance)
            return replace(actuator, **volumes, compliance=compliance)

        return tuple(map(at_end, actuators))

    def structure_of(self, actuator: str) -> tuple[float, float] | None:
        """Band of the compliance in series with an actuator; None: its own in the file."""
        return (self.structures or {}).get(actuator, self.structure)

    @property
    def _wide(self) -> list[str]:
        """Names of the bands that have a width."""
        return [*dict.fromkeys(p.split(".")[0] for p, (low, high) in self._stated if low < high)]

    @property
    def ends(self) -> tuple[End, ...]:
        """The ends of oil, structure and springs at corners, the softest first, the stiffest last.

        One, if none of these bands has a width.
        """
        wide = self._wide
        masses = [name for name in MASSES if name in wide]
        oils, structures = ([(name,) for name in names] for names in (OIL, STRUCTURE))
        pairs = (oils, structures), ([OIL], structures), (oils, [STRUCTURE]), ([OIL], [STRUCTURE])
        for oil, structure in pairs:
            together = (*oil, *structure, SPRINGS)
            groups = [[name for name in names if name in wide] for names in together]
            groups = [group for group in groups if group]
            if len(groups) + len(masses) <= FEW:
                break
        choices = itertools.product((True, False), repeat=len(groups))
        soft = (itertools.compress(groups, chosen) for chosen in choices)
        return tuple(frozenset(itertools.chain(*chosen)) for chosen in soft)

    @property
    def between(self) -> list[Bands]:
        """Values between the corners (Sobol), and ends that are at no corner; of no width."""
        from scipy.stats import qmc

        wide, corners = self._wide, self.ends
        if not wide:
            return []
        places = qmc.Sobol(len(wide), scramble=False).fast_forward(1).random(BETWEEN).tolist()
        for place in itertools.product((0.0, 1.0), repeat=len(wide)):
            pairs = zip(wide, place, strict=True)
            soft = {name for name, at in pairs if name not in MASSES and at == (name in SOFT_UP)}
            if soft not in corners:
                places.append(place)
        exact = (
            {name: _exactly(getattr(self, name), at) for name, at in zip(wide, place, strict=True)}
            for place in places
        )
        return sorted((replace(self, **values) for values in exact), key=only_masses)

    def corners(self, machine: Machine, ends: Sequence[End]) -> list[Corner]:
        """All corners of the bands at some ends of oil, structure and springs."""
        shares = self.mass_shares(machine)
        return [Corner(soft, *masses) for soft in ends for masses in shares]

    def mass_shares(self, machine: Machine) -> list[Masses]:
        """Masses to try: the ends of their bands, with air also between them."""
        air = machine.fluid.air > 0 or (self.air is not None and self.air[1] > 0)
        return self._masses(SAMPLES if air else 2)

    @property
    def mass_ends(self) -> list[Masses]:
        """Masses at the ends of their bands."""
        return self._masses(2)

    def _masses(self, count: int) -> list[Masses]:
        values = (np.linspace(*band, count).tolist() for band in (self.payload, self.link_mass))
        return list(dict.fromkeys(itertools.product(*values)))


class Corner(NamedTuple):
    """A corner of the bands.

    Attributes:
        soft: bands of oil, structure and springs at their soft ends; the others are at the stiff.
        payload_share: factor on the mass of every load case.
        link_share: factor on all masses and inertias of the bare links.
    """

    soft: End
    payload_share: float
    link_share: float

    @property
    def masses(self) -> Masses:
        """Both shares of masses."""
        return self.payload_share, self.link_share

    @property
    def plain(self) -> list[object]:
        """As a list of names and numbers that JSON has."""
        return [sorted(self.soft), *self.masses]


def only_masses(exact: Bands) -> Masses:
    """Shares of payload and of link mass within bands of no width."""
    return exact.payload[0], exact.link_mass[0]


def _pair(band: list[float] | None) -> tuple[float, float]:
    return (band[0], band[1]) if band else EXACT


def _exactly(band: Any, share: float) -> Any:
    """A band, or several by name, at one place between their ends, which then are alike."""
    if isinstance(band, Mapping):
        return {name: _exactly(one, share) for name, one in band.items()}
    value = band[0] + share * (band[1] - band[0])
    return value, value


def _upper(name: str, soft: End) -> bool:
    """Whether a band of stiffness is at its upper end."""
    return (name in soft) == (name in SOFT_UP)
