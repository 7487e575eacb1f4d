"""Uncertainty bands of oil, structure, load and mass, and the lowest frequency within them.

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

The gain of one machine over another has no such law: it may be least amid the bands. Designs are
made for all soft and all stiff, and judged at mixed corners and at places between them too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.cases import load_cases, refuse_toppling_anywhere
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import Lowest, Starts, lowest_of_poses, worst_frequency
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes

SAMPLES = 5  # of a mass, ends included, where the oil carries air
BETWEEN = 15  # places between the corners at which gains are judged: one band's sixteenths
EXACT = (1.0, 1.0)
ASSUMED = (0.0, 1.0)  # structure of a file that states none: rigid, and as soft as the oil
# allowed, of bands that may begin at zero; a share of a new cylinder's oil may be any
ENDS = {"air": (0.0, 0.5), "structure": (0.0, 10.0), "structures": (0.0, 100.0)}
MASSES = ("payload", "link_mass")
SOFT_UP = ("dead_volume", "air", "structure", "structures")  # whose upper end is the soft one
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

        Actuators of one name have the structure that ``today``'s machine has there.
        """
        volume, named = self.dead_volume[softest], {one.name: one for one in today.actuators}
        for name in self.structures or ():
            if name not in named and name not in today.idle:
                fault = f"{today.name} has no such actuator"
                raise ArmDesignError(f"bands.structures.{name}", fault, choose(name, named))
        yielding = {
            name: shares[softest] * one.oil_compliance(today.fluid, today.supply)
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
    def ends(self) -> tuple[bool, ...]:
        """The ends of oil and structure as ``softest``: soft and stiff, or one if they are one."""
        wide = any(path not in MASSES and low < high for path, (low, high) in self._stated)
        return (True, False) if wide else (True,)

    @property
    def between(self) -> list[Bands]:
        """Values between the corners (Sobol), and with some soft and others stiff; of no width."""
        from scipy.stats import qmc

        wide = [*dict.fromkeys(p.split(".")[0] for p, (low, high) in self._stated if low < high)]
        if not wide:
            return []
        sobol = qmc.Sobol(len(wide), scramble=False).fast_forward(1).random(BETWEEN).tolist()
        springy = [(k, name in SOFT_UP) for k, name in enumerate(wide) if name not in MASSES]
        ends = itertools.product((0.0, 1.0), repeat=len(wide))
        mixed = [place for place in ends if len({place[k] == up for k, up in springy}) > 1]
        exact = (
            {name: _exactly(getattr(self, name), at) for name, at in zip(wide, place, strict=True)}
            for place in [*sobol, *mixed]
        )
        return sorted((replace(self, **values) for values in exact), key=_only_masses)

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
class Scenario(ReadOnly):
    """One set of values within the bands, and the lowest frequency of the poses there.

    Attributes:
        frequency: lowest coupled natural frequency of the poses, all load cases [Hz].
        payload: name of its load case.
        q: its pose (nq,) [rad, m].
        corner: the values.
        starts: as in ``Lowest``, at corners.
    """

    frequency: float
    payload: str
    q: Array
    corner: Corner
    starts: Starts = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class FrequencyBand:
    """The lowest frequency [Hz] of the poses, all load cases, within the bands.

    Attributes:
        scenarios: at all corners of the bands, in one order for all machines.
        nominal: with the file's values [Hz].
        sample: what finds ``between``, which gains need and single machines do not.
    """

    __repr__ = short_repr

    scenarios: tuple[Scenario, ...]
    nominal: float
    sample: Callable[[], tuple[float, ...]] = field(repr=False)

    @property
    def headline(self) -> str:
        """Frequencies at the soft end, with the file's values, at the stiff end."""
        low, high = self.low.frequency, self.high.frequency
        return f"from {low:.4g} to {high:.4g} Hz, {self.nominal:.4g} Hz at the file's values"

    @cached_property
    def between(self) -> tuple[float, ...]:
        """Lowest frequency at places between the corners [Hz], the same for all machines."""
        return self.sample()

    @property
    def low(self) -> Scenario:
        """The scenario with the lowest frequency."""
        return min(self.scenarios, key=attrgetter("frequency"))

    @property
    def high(self) -> Scenario:
        """The scenario whose lowest frequency is the highest: structure rigid, oil stiff."""
        return max(self.scenarios, key=attrgetter("frequency"))

    def least_gain(self, today: FrequencyBand) -> float:
        """Least relative gain over today's machine: corners, between them, the file's values."""
        pairs = zip(self._frequencies, today._frequencies, strict=True)
        return min((new / old for new, old in pairs if old > 0), default=math.inf) - 1

    def plot(self, ax: Axes | None = None) -> Axes:
        """Axes with the lowest frequency at every corner of the bands."""
        from armdesign import plots

        return plots.corners_of_bands(self, ax)

    @property
    def _frequencies(self) -> list[float]:
        return [*(one.frequency for one in self.scenarios), *self.between, self.nominal]


@checked
def frequency_band(
    machine: Machine,
    workspace: Workspace,
    bands: Bands | None = None,
    *,
    today: Machine | None = None,
) -> FrequencyBand:
    """Lowest coupled frequency of the poses, all load cases, at all corners of the bands.

    Args:
        machine: the machine.
        workspace: poses that count, and not what lies between them.
        bands: what is not known exactly; None: the machine's file states them.
        today: the machine that this one was made from, whose structure it keeps; None: itself.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> bands = ad.Bands(structure=(0.0, 1.0))
        >>> band = ad.frequency_band(machine, workspace, bands)
        >>> print(f"{band.low.frequency:.2f} to {band.high.frequency:.2f} Hz")
        4.76 to 7.45 Hz
    """
    return band_about(machine, workspace, bands or Bands.of(machine), today)


def band_about(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    today: Machine | None = None,
    nominal: float | None = None,
) -> FrequencyBand:
    """As ``frequency_band``; ``nominal``: the lowest frequency [Hz] as the file says, if known."""
    stated = [machine] if nominal is None else []
    corners, as_stated = at_corners(machine, workspace, bands, bands.ends, today, stated)
    if nominal is None:
        nominal = (
            as_stated[0].worst if as_stated else worst_frequency(machine, workspace)
        ).frequency
    floor = np.min([lowest.frequency for lowest in corners.values()], axis=0)
    seeds = np.unique([lowest.frequency.argmin() for lowest in corners.values()])
    return FrequencyBand(
        scenarios=tuple(
            Scenario(**of.worst._asdict(), corner=corner, starts=of.starts)
            for corner, of in corners.items()
        ),
        nominal=nominal,
        sample=partial(_between, machine, workspace, bands, (floor, seeds), today),
    )


def at_corners(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    ends: Sequence[bool],
    today: Machine | None = None,
    stated: Sequence[Machine] = (),
) -> tuple[dict[Corner, Lowest], list[Lowest]]:
    """What is lowest at the corners of the bands at some ends, others as in ``frequency_band``.

    Then of ``stated`` machines with the values of their files, if its masses are at a corner.
    """
    at_ends = [bands.at_end(machine, softest, today) for softest in ends]
    known, as_stated = dict[Corner, Lowest](), list[Lowest]()
    for shares in bands.mass_shares(machine):
        more = stated if shares == (1.0, 1.0) else ()
        lowest = lowest_of_poses([*at_ends, *more], workspace, *shares)
        known |= {Corner(end, *shares): lowest[k] for k, end in enumerate(ends)}
        as_stated += lowest[len(ends) :]
    return {corner: known[corner] for corner in bands.corners(machine, ends)}, as_stated


def _between(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    known: tuple[Array, Array],
    today: Machine | None,
) -> tuple[float, ...]:
    """The worst frequency [Hz] at each place between the corners of the bands.

    No pose is lower there than at all corners; so it is looked for among the poses that are lower
    at one of them than some chosen poses are at such a place. Places with the same masses are
    looked at together.

    Args:
        machine: the machine.
        workspace: poses that count.
        bands: what is not known exactly.
        known: the lowest frequency of each pose over the corners (n,) [Hz]; rows that are chosen.
        today: as in ``frequency_band``.
    """
    (floor, seeds), found = known, list[float]()
    for shares, places in itertools.groupby(bands.between, key=_only_masses):
        machines = [exact.at_end(machine, True, today) for exact in places]
        chosen = lowest_of_poses(machines, workspace.subset(seeds), *shares)
        rows = np.flatnonzero(floor <= max(lowest.worst.frequency for lowest in chosen))
        lowest = lowest_of_poses(machines, workspace.subset(rows), *shares)
        found += [of.worst.frequency for of in lowest]
    return tuple(found)


def _only_masses(exact: Bands) -> tuple[float, float]:
    """Shares of payload and of link mass within bands of no width."""
    return exact.payload[0], exact.link_mass[0]


def refuse_toppling_within(machine: Machine, workspace: Workspace) -> None:
    """Raise for the pose that asks most of the springs: as in the file, and at its soft ends.

    Raises:
        PoseError: as ``Machine.at`` does.
    """
    refuse_toppling_anywhere(list(load_cases(machine, workspace)))
    bands = Bands.of(machine)
    for corner in bands.corners(machine, (True,)):
        at_end, shares = bands.at_end(machine, True), (corner.payload_share, corner.link_share)
        refuse_toppling_anywhere(list(load_cases(at_end, workspace, *shares)))


def _pair(band: list[float] | None) -> tuple[float, float]:
    return (band[0], band[1]) if band else EXACT


def _exactly(band: Any, share: float) -> Any:
    """A band, or several by name, at one place between their ends, which then are alike."""
    if isinstance(band, Mapping):
        return {name: _exactly(one, share) for name, one in band.items()}
    value = band[0] + share * (band[1] - band[0])
    return value, value
