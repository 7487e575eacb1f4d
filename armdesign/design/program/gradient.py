"""Gradients by areas and pins: the design at x with a complex step along each entry of x.

Places have the analytic sensitivities of their linkage; what is computed from them goes on in
complex numbers, so the imaginary part over ``STEP`` is the exact derivative: of requirements in
``constraints.py``, of stiffness and mass, and so of frequencies, in ``dynamics.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Numbers
from armdesign.design.program.design_vector import DesignVector, Geometry
from armdesign.design.program.moving_masses import InertiaAndGravity, MomentsOf
from armdesign.machine.lifting import unloaded
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.carried_bars import M, first_of_bar, of_bar, weighed, weighed_by_row
from armdesign.mechanism.linkage.base import Actuation, Linkage

STEP = 1e-30  # complex step: no subtraction, so no cancellation


@dataclass(frozen=True, eq=False)
class SteppedDesign:
    """The design at x as a ``Candidate``: a variant for each entry of x, stepped along it."""

    vector: DesignVector
    x: Array

    @property
    def machine(self) -> Machine:
        """Today's machine, of which counts, walls and supply stay."""
        return self.vector.machine

    @cached_property
    def linkages(self) -> tuple[Linkage, ...]:
        """Every cylinder's pins and bars at x, without steps."""
        return self.vector.linkages(self.x)

    @cached_property
    def areas(self) -> Array:
        """Bore and annulus of every actuator (nx, nc, 2) [m²]."""
        vector, areas = self.vector, self._variants(self.vector.areas(self.x))
        for index, v in enumerate(vector.variables):
            if v.pin is None and not vector.rod_stays[v.cylinder, v.axis]:
                today = vector.areas_today[v.cylinder]
                areas[index, v.cylinder, v.axis] += 1j * STEP * today[v.axis]
                if v.axis == 0 and vector.rod_stays[v.cylinder, 1]:
                    areas[index, v.cylinder, 1] += 1j * STEP * today[0]
        return areas

    @cached_property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """Length and moment arm over each joint's range (nx, n); None across several joints."""
        return [
            None if poses is None else self._swept(i, poses)
            for i, poses in enumerate(self.vector.range_poses)
        ]

    def _swept(self, i: int, poses: RigidPoses) -> tuple[Array, Array]:
        joint = self.linkages[i].joints[0]
        actuation, slopes = self._sensitivities(i, poses)
        length = self._variants(actuation.length)
        arm = self._variants(actuation.moment_arm[:, joint])
        for index, slope in slopes.items():
            length[index] += self._pin_step(slope.length)
            arm[index] += self._pin_step(slope.moment_arm[:, joint])
        return length, arm

    @cached_property
    def _closed_and_stroke(self) -> tuple[Array, Array]:
        closed, stroke = map(self._variants, self.vector.strokes_today)
        for i in self.vector.moving:
            if (swept := self.sweeps[i]) is not None:
                length = swept[0]
                closed[:, i] = length[:, length[0].real.argmin()]
                stroke[:, i] = length[:, length[0].real.argmax()] - closed[:, i]
        for i, chosen in enumerate(self.vector.chosen_lengths):
            closed[:, i], stroke[:, i] = chosen or (closed[:, i], stroke[:, i])
        return closed, stroke

    @property
    def closed(self) -> Array:
        """Closed lengths (nx, nc) [m]."""
        return self._closed_and_stroke[0]

    @property
    def stroke(self) -> Array:
        """Strokes (nx, nc) [m]."""
        return self._closed_and_stroke[1]

    def place(self, i: int, name: str) -> Array | None:
        """A pin of a cylinder's linkage in its link (nx, 3), or length of a bar (nx, 1) [m]."""
        place = self.linkages[i].place(name)
        if place is None:
            return None
        at = self._variants(np.array(place))
        for index, (moved, axis) in self.vector.moves(i).items():
            if moved == name:
                at[index, axis] += self._pin_step()
        return at

    def transmission(self, i: int) -> Array:
        """Cosine of the angle between rocker and coupler over the range of the joint (nx, n)."""
        poses, moves = self.vector.range_poses[i], self.vector.moves(i)
        assert poses is not None
        cosine, slopes = self.linkages[i].transmission(poses, list(moves.values()))
        stepped = self._variants(cosine)
        for index, slope in zip(moves, slopes, strict=True):
            stepped[index] += self._pin_step(slope)
        return stepped

    def geometry(self, rigid: RigidPoses) -> Geometry:
        """Lengths, moment arms and their derivatives of all actuators at some poses (nx, n, …)."""
        names = ("length", "moment_arm", "moment_arm_derivative")
        return Geometry(*self._actuations(rigid, names))

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (nx, n, nc, nq)."""
        (arms,) = self._actuations(rigid, ("moment_arm",))
        return arms

    def _actuations(self, rigid: RigidPoses, names: Sequence[str]) -> Iterator[Array]:
        """Parts of all actuations at some poses (nx, n, nc, …), by their names."""
        count = len(self.vector.machine.actuators)
        known = [self._sensitivities(i, rigid) for i in range(count)]
        for name in names:
            part = self._variants(np.stack([getattr(at, name) for at, _ in known], axis=1))
            for i, (_, slopes) in enumerate(known):
                for index, slope in slopes.items():
                    part[index][:, i] += self._pin_step(getattr(slope, name))
            yield part

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """Base pin and rod end of a cylinder in the world (nx, n, 3) [m]."""
        moves = self.vector.moves(i)
        ends, slopes = self.linkages[i].ends_and_slopes(rigid, list(moves.values()))
        base, end = map(self._variants, ends)
        for (index, (name, _)), slope in zip(moves.items(), slopes, strict=True):
            (base if name == "base" else end)[index] += self._pin_step(slope)
        return base, end

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """Gravity torque without a load [N m], (nx, n, nq), or (1, n, nq) if x does not matter."""
        known = unloaded(self.vector.bare, rigid)[None]
        return known if self.vector.moving_masses is None else known + self.moving_gravity(rigid)

    def mass_terms(self, rigid: RigidPoses) -> InertiaAndGravity:
        """M, g and ∂g/∂q of the masses that depend on x (nx, n, …)."""
        moving = self.vector.moving_masses
        assert moving is not None
        return moving.inertia_and_gravity(rigid, lambda i, at: self._moments(i, at, of_bar))

    def moving_gravity(self, rigid: RigidPoses) -> Array:
        """The g (nx, n, …) of ``mass_terms`` alone [N m]."""
        moving = self.vector.moving_masses
        assert moving is not None
        return moving.gravity(rigid, lambda i, at: self._moments(i, at, first_of_bar))

    def _moments(self, i: int, positions: RigidPoses, of: MomentsOf[M]) -> M:
        """Moments of the bars of cylinder ``i`` at positions of its joints (nx, m, …)."""
        moving, linkage, closed = self.vector.moving_masses, self.linkages[i], self.closed[:, i]
        assert moving is not None
        masses = moving.masses_of(i, self.areas[:, i], closed, linkage)
        total = weighed(masses, moving.moments_of(i, linkage, closed[0].real, positions, of))
        if entries := list(self.vector.moves(i)):
            for whole, moved in zip(
                total, self._moved_moments(i, entries, positions, of), strict=True
            ):
                whole[entries] = moved.reshape(len(entries), *whole.shape[1:])
        return total

    def _moved_moments(
        self, i: int, entries: Sequence[int], positions: RigidPoses, of: MomentsOf[M]
    ) -> M:
        """Moments of the bars of cylinder ``i``, stepped along entries that move a place.

        All entries at once: as many rows (k·m, …) as there are positions for each of k.
        """
        moving, count = self.vector.moving_masses, len(positions)
        assert moving is not None
        areas, closed = (
            np.repeat(part[entries, i], count, axis=0) for part in (self.areas, self.closed)
        )
        linkage = self._stepped_by_row(i, entries, count)
        rows = positions[np.tile(np.arange(count), len(entries))]
        masses = moving.masses_of(i, areas, closed, linkage)
        return weighed_by_row(masses, moving.moments_of(i, linkage, closed, rows, of))

    def _pin_step(self, slope: Numbers = 1.0) -> Numbers:
        """What a quantity of this slope by a coordinate of a pin gains by the complex step."""
        return 1j * STEP * self.vector.pin_box * slope

    def _variants(self, values: Array) -> Array:
        """Complex copies of values, one for each entry of x (nx, …)."""
        return np.array(np.broadcast_to(values, (len(self.x), *values.shape)), dtype=complex)

    def _sensitivities(self, i: int, poses: RigidPoses) -> tuple[Actuation, dict[int, Actuation]]:
        """Actuation of actuator ``i``, and its derivatives by the entries of x that move it."""
        drive, moves = self.vector.drives(self.x)[i], self.vector.moves(i)
        if not moves:
            return drive.actuation(poses), {}
        actuation, slopes = self.linkages[i].sensitivities(poses, list(moves.values()))
        return actuation, dict(zip(moves, slopes, strict=True))

    def _stepped_by_row(self, i: int, entries: Sequence[int], count: int) -> Linkage:
        """The linkage of cylinder ``i``, stepped along each of the entries that move its places.

        In ``count`` rows for each.
        """
        linkage, moves = self.linkages[i], self.vector.moves(i)
        for place in {place for place, _ in moves.values()}:
            at = self.place(i, place)
            assert at is not None
            linkage = linkage.with_place(place, list(np.repeat(at[entries], count, axis=0).T))
        return linkage
