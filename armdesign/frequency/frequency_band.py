"""The lowest frequency within the bands of what is not known exactly: at corners, and between.

Of the workspace's poses, not between these.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.frequency.bands import Bands, Corner, only_masses
from armdesign.frequency.cases import load_cases, refuse_toppling_anywhere
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import Lowest, Starts, lowest_of_poses, worst_frequency
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes


@dataclass(frozen=True, eq=False, kw_only=True)
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


@dataclass(frozen=True, eq=False, kw_only=True)
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
        bands: what is not known exactly; None: the machine's file states them; where it has none,
            structure between rigid and as soft as the oil is assumed, as in maps.
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
    return band_about(machine, workspace, bands or Bands.shown(machine), today)


def band_about(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    today: Machine | None = None,
    nominal: float | None = None,
) -> FrequencyBand:
    """As ``frequency_band``; ``nominal``: the lowest frequency [Hz] as the file says, if known."""
    stated = [machine] if nominal is None else []
    wanted = bands.corners(machine, bands.ends)
    corners, as_stated = at_corners(machine, workspace, bands, wanted, today, stated)
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
    corners: Sequence[Corner],
    today: Machine | None = None,
    stated: Sequence[Machine] = (),
) -> tuple[dict[Corner, Lowest], list[Lowest]]:
    """What is lowest at some corners of the bands, other arguments as in ``frequency_band``.

    Then of ``stated`` machines with the values of their files, if its masses are at a corner.
    """
    at_end = {soft: bands.at_end(machine, soft, today) for soft in {one.soft for one in corners}}
    known, as_stated = dict[Corner, Lowest](), list[Lowest]()
    for shares in dict.fromkeys(one.masses for one in corners):
        own = [one for one in corners if one.masses == shares]
        machines = [at_end[one.soft] for one in own] + [*stated] * (shares == (1.0, 1.0))
        lowest = lowest_of_poses(machines, workspace, *shares)
        known |= dict(zip(own, lowest, strict=False))
        as_stated += lowest[len(own) :]
    return {corner: known[corner] for corner in corners}, as_stated


def _between(
    machine: Machine,
    workspace: Workspace,
    bands: Bands,
    known: tuple[Array, Array],
    today: Machine | None,
) -> tuple[float, ...]:
    """The worst frequency [Hz] at each place between the corners of the bands.

    No pose is lower there than at all corners; so it is looked for among the poses that are lower
    at one of them than some chosen poses are at such a place. With air that does not hold between
    the masses that were tried, and all poses are looked at. Places with the same masses are looked
    at together.

    Args:
        machine: the machine.
        workspace: poses that count.
        bands: what is not known exactly.
        known: the lowest frequency of each pose over the corners (n,) [Hz]; rows that are chosen.
        today: as in ``frequency_band``.
    """
    (floor, seeds), found = known, list[float]()
    sampled = bands.mass_shares(machine) != bands.mass_ends
    for shares, places in itertools.groupby(bands.between, key=only_masses):
        machines = [exact.at_end(machine, frozenset(), today) for exact in places]
        poses = workspace
        if not sampled:
            chosen = lowest_of_poses(machines, workspace.subset(seeds), *shares)
            most = max(lowest.worst.frequency for lowest in chosen)
            poses = workspace.subset(np.flatnonzero(floor <= most))
        lowest = lowest_of_poses(machines, poses, *shares)
        found += [of.worst.frequency for of in lowest]
    return tuple(found)


def refuse_toppling_within(machine: Machine, workspace: Workspace) -> None:
    """Raise for the pose that asks most of the springs: as in the file, and at its soft ends.

    Raises:
        PoseError: as ``Machine.at`` does.
    """
    refuse_toppling_anywhere(list(load_cases(machine, workspace)))
    bands = Bands.of(machine)
    for soft, *shares in bands.corners(machine, bands.ends[:1]):
        at_end = bands.at_end(machine, soft)
        refuse_toppling_anywhere(list(load_cases(at_end, workspace, *shares)))
