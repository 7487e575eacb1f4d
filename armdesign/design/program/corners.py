"""Corners of the bands at which a design counts: how much each weighs, and its oil's stiffness.

For the worst frequency within the bands these are the corners of the softest oil and structure,
all alike. For the least gain over today's machine all corners count, and ω² is measured at each
corner by what today's machine has there: K − λ w M ⪰ 0 with w = ω²_today there over ω²_today at
the values of the file. The lowest λ is the square of the least gain times the latter: the same
programme for both objectives.

Where frequencies count with an emphasis of their own at every pose and load case, ω² times its
square takes the place of ω²: M is divided by that, and K multiplied by how it grows with x.

Masses count at the ends of their bands; between them, where oil carries air, only those at which a
design that was found is worse than that: ``missed``.

Structure in series with an actuator stays as it is in m/N, whatever cylinder is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.frequency.bands import Bands, Corner, End
from armdesign.frequency.cases import CasePoses
from armdesign.frequency.frequency_band import FrequencyBand, at_corners, frequency_band
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import areas_of
from armdesign.machine.machine import Machine

ALIKE = 1e-4  # relative, of frequencies: where searches stop


@dataclass(frozen=True, eq=False, kw_only=True)
class Emphasis:
    """By how much frequencies count: ``ratio`` · exp(``growth`` · (x − ``about``)).

    Attributes:
        ratio: under each load case at every pose of the workspace (n,), > 0.
        growth: of its logarithm with the entries of the design vector (n, nx).
        about: the design vector at which the ratio was found (nx,).
        ends: least and largest design vector for which both are believed (nx,).
        judge: the value [Hz] of a machine that has been written, which shall be large.
    """

    ratio: Mapping[str, Array]
    growth: Mapping[str, Array]
    about: Array
    ends: tuple[Array, Array]
    judge: Callable[[Machine], float]

    @property
    def identity(self) -> list[Any]:
        """Everything in which two can differ, for keys."""
        both = ({k: v.tolist() for k, v in each.items()} for each in (self.ratio, self.growth))
        return [*both, self.about.tolist(), *(end.tolist() for end in self.ends)]


class Pistons(NamedTuple):
    """Places of the pistons in n rows, their loads and sizes."""

    extension: Array  # (…, n, nc) [m]
    stroke: Array  # (…, nc) [m], broadcast
    areas: Array  # of cap and annulus (…, nc, 2) [m²], broadcast
    force: Array  # static (…, n, nc) [N, + pushes], broadcast

    def of_rows(self, rows: Array) -> Pistons:
        """Some of the rows."""
        extension, force = np.broadcast_arrays(self.extension, self.force)
        return self._replace(extension=extension[..., rows, :], force=force[..., rows, :])


@dataclass(frozen=True, eq=False, kw_only=True)
class Corners:
    """The corners of a machine's bands that count.

    Attributes:
        today: the machine with the file's values.
        workspace: poses that count.
        bands: what is not known exactly.
        gain: whether the least gain over today's machine counts; else the worst frequency.
        proportional: whether dead volumes grow with the areas.
        emphasis: by how much frequencies count at poses and load cases; None: all alike.
        between: corners that count with masses between the ends of their bands, see ``missed``.
    """

    today: Machine
    workspace: Workspace
    bands: Bands = field(default_factory=Bands)
    gain: bool = False
    proportional: bool = False
    emphasis: Emphasis | None = None
    between: tuple[Corner, ...] = ()

    @cached_property
    def all(self) -> list[Corner]:
        """The corners: ends of oil, structure and springs with all ends of masses, and others."""
        masses = self.bands.mass_ends
        return [*(Corner(soft, *some) for soft in self.ends for some in masses), *self.between]

    def counting(self, between: tuple[Corner, ...]) -> Corners:
        """The same with these corners between the ends; today's band is found once."""
        other = replace(self, between=between)
        if self.gain:
            other.__dict__["band"] = self.band
        return other

    @cached_property
    def band(self) -> FrequencyBand:
        """Today's worst frequency at all corners of the bands, and with the file's values."""
        return frequency_band(self.today, self.workspace, self.bands)

    @property
    def nominal(self) -> float:
        """Today's worst frequency with the file's values [Hz]."""
        return self.band.nominal

    @cached_property
    def weights(self) -> Array:
        """By how much inertia counts at each corner."""
        return np.array([self._weight(corner) for corner in self.all])

    def _weight(self, corner: Corner) -> float:
        """By how much inertia counts at a corner, whether it counts or not."""
        return (self._today[corner] / self.nominal) ** 2 if self.gain else 1.0

    @cached_property
    def _today(self) -> dict[Corner, float]:
        """Today's worst frequency at all corners of the bands [Hz].

        Raises:
            ArmDesignError: today's machine is unstable there, so that there is no gain over it.
        """
        today = {one.corner: one.frequency for one in self.band.scenarios}
        if min(*today.values(), self.nominal) <= 0:
            raise ArmDesignError(
                f"bands of {self.today.name}",
                "today's machine is unstable at one of their corners: there is no gain over it",
                "narrow them, or design for the worst frequency: --objective worst, in Python"
                ' objective="worst"',
            )
        return today

    def weight_at(self, corner: int, case: CasePoses) -> Array:
        """By how much inertia counts at a corner at the poses of a load case (m,)."""
        ratio = 1.0 if self.emphasis is None else self.emphasis.ratio[case.name][case.exists]
        return np.broadcast_to(self.weights[corner] / ratio**2, case.exists.sum())

    def judged(self, machine: Machine) -> float:
        """The objective of a machine on the workspace's poses [Hz].

        Its worst frequency within the bands; or its least gain times today's worst frequency; or
        what its emphasis judges.
        """
        if self.emphasis is not None:
            return self.emphasis.judge(machine)
        if self.gain and machine is self.today:
            return self.objective({one.corner: one.frequency for one in self.band.scenarios})
        return self.objective(self._frequencies(machine, self.all))

    @property
    def not_counted(self) -> list[Corner]:
        """Corners with masses that the bands try and that do not count, without emphasis."""
        known, tried = {*self.all}, self.bands.corners(self.today, self.ends)
        return [one for one in tried if one not in known and self.emphasis is None]

    def missed(self, machine: Machine, judged: float) -> tuple[Corner, ...]:
        """Corners that do not count and at which a machine is worse than ``judged`` [Hz]."""
        frequencies = self._frequencies(machine, self.not_counted)
        return tuple(
            corner
            for corner, frequency in frequencies.items()
            if frequency / math.sqrt(self._weight(corner)) < judged * (1 - ALIKE)
        )

    def _frequencies(self, machine: Machine, corners: list[Corner]) -> dict[Corner, float]:
        """Worst frequencies [Hz] of a machine at some corners."""
        lowest, _ = at_corners(machine, self.workspace, self.bands, corners, self.today)
        return {corner: of.worst.frequency for corner, of in lowest.items()}

    def objective(self, frequencies: Mapping[Corner, float]) -> float:
        """The objective [Hz] of a machine without emphasis, of its worst frequencies [Hz]."""
        known = [frequencies[corner] for corner in self.all]
        return float((known / np.sqrt(self.weights)).min())

    @property
    def ends(self) -> tuple[End, ...]:
        """The ends of oil, structure and springs that count, the softest first."""
        return self.bands.ends if self.gain else self.bands.ends[:1]

    @cached_property
    def machines(self) -> tuple[Machine, ...]:
        """Today's machine at each of the ends."""
        return tuple(self.bands.at_end(self.today, soft) for soft in self.ends)

    @cached_property
    def end(self) -> Array:
        """Index into ``ends`` of each corner."""
        return np.array([self.ends.index(corner.soft) for corner in self.all])

    def stiffness(self, corner: Array, pistons: Pistons) -> Array:
        """Stiffness of oil and structure (…, n, nc) [N/m, N m/rad] of rows at the corners (n,)."""
        if len(self.machines) == 1:
            return self._at(self.machines[0], pistons)
        stiffness, end = np.empty_like(pistons.extension), self.end[corner]
        for k, machine in enumerate(self.machines):
            rows = np.flatnonzero(end == k)
            stiffness[..., rows, :] = self._at(machine, pistons.of_rows(rows))
        return stiffness

    def _at(self, machine: Machine, pistons: Pistons) -> Array:
        """As ``stiffness``, of rows at one end."""
        springs, areas_today = [], areas_of(machine.actuators)
        for i, actuator in enumerate(machine.actuators):
            a1, a2 = pistons.areas[..., i, 0], pistons.areas[..., i, 1]
            if self.proportional:
                actuator = replace(
                    actuator,
                    cap_dead_volume=actuator.cap_dead_volume * a1 / areas_today[i, 0],
                    annulus_dead_volume=actuator.annulus_dead_volume * a2 / areas_today[i, 1],
                )
            springs.append(
                actuator.stiffness(
                    pistons.extension[..., i],
                    pistons.force[..., i],
                    machine.fluid,
                    machine.supply,
                    areas=(a1, a2),
                    stroke=pistons.stroke[..., i],
                )
            )
        return np.stack(springs, axis=-1)
