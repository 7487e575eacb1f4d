"""The design problem: the highest lowest frequency under requirements, posed in the design vector.

Variants that differ in their limits, margins or chosen sizes share one ``Dynamics``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import FINE, DrawingGrid, relative_areas
from armdesign.design.program.corners import Corners, Emphasis
from armdesign.design.program.design_vector import ChosenLengths, DesignVector
from armdesign.design.program.dynamics import Dynamics
from armdesign.design.program.variables import Variable
from armdesign.design.requirements.settings import Requirements
from armdesign.frequency.bands import Bands, Corner
from armdesign.frequency.workspace import Workspace
from armdesign.journal.keys import digest
from armdesign.machine.file.schema import share_of
from armdesign.machine.machine import Machine

LEAST_AREA, LARGEST_AREA = 0.1, 2.0  # over today's; more where the thrust allows more

ChosenSizes = tuple[tuple[float, float] | None, ...]  # bore and rod of each cylinder [m]


@dataclass(frozen=True, eq=False, kw_only=True)
class Margins:
    """By how much constraints are moved: inwards, so that rounding has room, or outwards.

    Attributes:
        tightening: share by which all limits are drawn in.
        reserve: what named constraints keep in reserve.
        relaxed: share by which named limits are relaxed.
    """

    tightening: float = 0.0
    reserve: Mapping[str, float] = field(default_factory=dict)
    relaxed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """The lowest ω² of ``dynamics`` is to be made as high as ``requirements`` allow.

    Attributes:
        dynamics: frequencies and static forces of the designs x.
        requirements: limits of a design.
        sizes: bore and rod [m] of cylinders for which they are chosen, None of the others.
        margins: by how much constraints are moved.
        grid: what lengths are rounded to in the end.
    """

    dynamics: Dynamics
    requirements: Requirements
    sizes: ChosenSizes = ()
    margins: Margins = field(default_factory=Margins)
    grid: DrawingGrid = FINE

    @classmethod
    def of(
        cls,
        machine: Machine,
        workspace: Workspace,
        requirements: Requirements,
        vary: tuple[str, ...],
        *,
        proportional: bool = False,
        bands: Bands | None = None,
        gain: bool = False,
        emphasis: Emphasis | None = None,
    ) -> Problem:
        """The problem in which what ``vary`` names of today's machine varies on its workspace."""
        vector = DesignVector.of(machine, workspace, requirements, vary)
        corners = Corners(
            today=machine,
            workspace=workspace,
            bands=bands or Bands(),
            gain=gain,
            proportional=proportional,
            emphasis=emphasis,
        )
        dynamics = Dynamics(vector=vector, corners=corners)
        return cls(dynamics=dynamics, requirements=requirements)

    def varying(self, vary: tuple[str, ...]) -> Problem:
        """The problem in which something else of today's machine varies, with the same corners."""
        vector = DesignVector.of(self.machine, self.workspace, self.requirements, vary)
        return replace(self, dynamics=Dynamics(vector=vector, corners=self.dynamics.corners))

    def counting(self, between: tuple[Corner, ...]) -> Problem:
        """The problem where these corners between the ends of the bands of masses count, too."""
        corners = self.dynamics.corners.counting(between)
        return replace(self, dynamics=Dynamics(vector=self.vector, corners=corners))

    @property
    def vector(self) -> DesignVector:
        """Meaning of the entries of x."""
        return self.dynamics.vector

    @property
    def machine(self) -> Machine:
        """Today's machine."""
        return self.vector.machine

    @property
    def workspace(self) -> Workspace:
        """Today's workspace."""
        return self.dynamics.workspace

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Ends of every entry of x: a pin keeps to its own box, an area to its chosen size.

        And to where an emphasis is believed.
        """
        low, high = np.array([self._ends(v) for v in self.vector.variables]).T
        emphasis = self.dynamics.corners.emphasis
        if emphasis is None:
            return low, high
        least, most = (np.clip(end, low, high) for end in emphasis.ends)
        return least, most

    @cached_property
    def identity(self) -> str:
        """A digest of everything in which two problems can differ."""
        vector, corners = self.vector, self.dynamics.corners
        return digest(
            [
                [vector.machine.identity, corners.today.identity, corners.workspace.identity],
                [repr(corners.today.fluid), repr(corners.today.cylinders)],  # at ends of bands
                [vector.vary, repr(vector.boxes), repr(vector.chosen_lengths)],
                [corners.bands.identity, corners.gain, corners.proportional],
                [one.plain for one in corners.between],
                corners.emphasis and corners.emphasis.identity,
                self.requirements.identity,
                [repr(self.sizes), repr(self.margins), repr(self.grid)],
            ]
        )

    def _ends(self, v: Variable) -> tuple[float, float]:
        if v.pin is not None:
            reach = self.vector.boxes[v.cylinder][v.pin] / self.vector.pin_box
            return -reach, reach
        size = self.sizes[v.cylinder] if v.cylinder < len(self.sizes) else None
        if size is not None:
            area = relative_areas(self.machine.cylinders[v.cylinder], *size)[v.axis]
            return area, area
        if not v.free:
            return 1.0, 1.0
        least = LEAST_AREA
        if v.axis == 0 and self.vector.rod_stays[v.cylinder, 1]:  # the annulus is what is left
            cap, annulus = self.vector.areas_today[v.cylinder]
            least = 1 - (1 - LEAST_AREA) * annulus / cap
        share = share_of(self.requirements.thrust_share, self.machine.cylinders[v.cylinder].name)
        return least, max(LARGEST_AREA, share)

    def like(self, x: Array, other: Problem) -> Array:
        """The design ``x`` of another problem of this machine, as far as it varies here."""
        entries = zip(x, other.vector.variables, strict=True)
        moved = {
            (v.cylinder, v.pin, v.axis): float(value) * other.vector.pin_box
            for value, v in entries
            if v.pin is not None
        }
        coordinates = [
            moved.get((v.cylinder, v.pin, v.axis), 0.0) / self.vector.pin_box
            for v in self.vector.variables
            if v.pin is not None
        ]
        areas = other.vector.areas(x) / self.vector.areas_today
        return np.clip(np.concatenate([areas.ravel(), coordinates]), *self.bounds)

    def with_lengths(self, lengths: ChosenLengths) -> Problem:
        """The same problem with closed lengths and strokes [m] that are chosen."""
        return replace(self, dynamics=self.dynamics.with_lengths(lengths))

    def tightened(self, share: float) -> Problem:
        """The same problem with limits drawn in by a share."""
        return replace(self, margins=replace(self.margins, tightening=share))

    def with_reserve(self, reserve: Mapping[str, float]) -> Problem:
        """The same problem where named constraints keep something in reserve."""
        return replace(self, margins=replace(self.margins, reserve=reserve))

    def relaxed(self, shares: Mapping[str, float]) -> Problem:
        """The same problem with named limits relaxed by a share."""
        return replace(self, margins=replace(self.margins, relaxed=shares))

    def under(self, requirements: Requirements) -> Problem:
        """The same problem under other requirements that leave the pin boxes as they are."""
        return replace(self, requirements=requirements)

    def at_corner(self, k: int) -> Problem:
        """The problem of the worst frequency with the oil, structure and masses of corner ``k``.

        What no design exceeds there bounds the whole.
        """
        corners = self.dynamics.corners
        corner, today = corners.all[k], self.machine
        machine = corners.bands.at_end(today, corner.soft)
        payload, links = ((share, share) for share in corner.masses)
        return self._on(machine, Bands(payload=payload, link_mass=links))

    @property
    def softest(self) -> Problem:
        """The problem with the softest oil and structure: only bands of masses are left."""
        corners = self.dynamics.corners
        masses = Bands(payload=corners.bands.payload, link_mass=corners.bands.link_mass)
        (end,) = masses.ends
        between = tuple(one._replace(soft=end) for one in corners.between)
        return self._on(corners.machines[0], masses, between)

    def _on(self, machine: Machine, bands: Bands, between: tuple[Corner, ...] = ()) -> Problem:
        """The problem of the worst frequency of another machine within other bands."""
        corners = replace(
            self.dynamics.corners, today=machine, bands=bands, gain=False, between=between
        )
        vector = replace(self.vector, machine=machine)
        return replace(self, dynamics=Dynamics(vector=vector, corners=corners))
