"""Gradients by areas and pins: the design at x with a complex step along each entry of x.

The imaginary part of all that is computed from it, over ``STEP``, is the exact derivative: of
requirements in ``constraints.py``, of stiffness and mass, and so of frequencies, in
``dynamics.py``. A linkage is evaluated once for all of its places that move, at k times as many
poses, not once for each entry of x: most move another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.design_vector import DesignVector, Geometry
from armdesign.design.program.moving_masses import InertiaAndGravity
from armdesign.machine.lifting import unloaded
from armdesign.machine.machine import Machine
from armdesign.mechanism.carried_bars import (
    M,
    MomentsOf,
    first_of_bar,
    of_bar,
    units_of,
    weighed,
    weighed_by_row,
)
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses

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
        length, arms = self._actuation(i, poses, "length", "moment_arm")
        return length, arms[:, :, self.linkages[i].joints[0]]

    @cached_property
    def _closed_and_stroke(self) -> tuple[Array, Array]:
        closed, stroke = map(self._variants, self.vector.strokes_today)
        for i in self.vector.moving:
            if (swept := self.sweeps[i]) is not None:
                length, order = swept[0], swept[0][0].real.argsort()
                both = self.vector.covering(i, length[:, order[0]], length[:, order[-1]])
                closed[:, i], stroke[:, i] = both
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
                at[index, axis] += 1j * self._step
        return at

    def transmission(self, i: int) -> Array:
        """Cosine of the angle between rocker and coupler over the range of the joint (nx, n)."""
        poses = self.vector.range_poses[i]
        assert poses is not None
        entries, linkage, rows = self._moved(i, poses)
        return self._of_entries(entries, linkage.transmission(rows))

    def geometry(self, rigid: RigidPoses) -> Geometry:
        """Lengths, moment arms and their derivatives of all actuators at some poses (nx, n, …)."""
        return Geometry(*self._actuations(rigid, "length", "moment_arm", "moment_arm_derivative"))

    def moment_arms(self, rigid: RigidPoses) -> Array:
        """∂ℓ/∂q at some poses (nx, n, nc, nq)."""
        (arms,) = self._actuations(rigid, "moment_arm")
        return arms

    def _actuations(self, rigid: RigidPoses, *names: str) -> list[Array]:
        """Parts of all actuations at some poses (nx, n, nc, …), by their names."""
        count = len(self.vector.machine.actuators)
        each = [self._actuation(i, rigid, *names) for i in range(count)]
        return [np.stack(parts, axis=2) for parts in zip(*each, strict=True)]

    def _actuation(self, i: int, poses: RigidPoses, *names: str) -> list[Array]:
        """Parts of the actuation of actuator ``i`` at some poses (nx, n, …), by their names."""
        if moves := self.vector.moves(i):
            actuation = self.linkages[i].stepped_actuation(poses, [*moves.values()], self._step)
        else:
            actuation = self.vector.drives(self.x)[i].actuation(poses)
        return [self._of_entries(list(moves), getattr(actuation, name)) for name in names]

    def span(self, i: int, rigid: RigidPoses) -> tuple[Array, Array]:
        """Base pin and rod end of a cylinder in the world (nx, n, 3) [m]."""
        entries, linkage, rows = self._moved(i, rigid)
        base, end = (self._of_entries(entries, part) for part in linkage.ends(rows))
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
        moving, areas, closed = self.vector.moving_masses, self.areas[:, i], self.closed[:, i]
        assert moving is not None
        masses = moving.masses_of(i, areas, closed, self.linkages[i])
        entries, linkage, rows = self._moved(i, positions)
        if not entries:
            return weighed(masses, units_of(linkage, closed[0].real, rows, moving.bars[i], of))
        count = len(positions)
        areas, closed = (np.repeat(part[entries], count, axis=0) for part in (areas, closed))
        units = units_of(linkage, closed, rows, moving.bars[i], of)
        total = weighed(masses, [type(one)(*(p[:count].real for p in one)) for one in units])
        moved = weighed_by_row(moving.masses_of(i, areas, closed, linkage), units)
        for whole, part in zip(total, moved, strict=True):
            whole[entries] = part.reshape(len(entries), *whole.shape[1:])
        return total

    @property
    def _step(self) -> float:
        """The complex step of a coordinate of a place [m]."""
        return STEP * self.vector.pin_box

    def _moved(self, i: int, poses: RigidPoses) -> tuple[list[int], Linkage, RigidPoses]:
        """The k entries of x that move cylinder ``i``, and its linkage stepped along each of them.

        It is at k·n poses, the n for each entry; as it stands at the n where none moves it.
        """
        moves, linkage = self.vector.moves(i), self.linkages[i]
        if not moves:
            return [], linkage, poses
        stepped = linkage.stepped([*moves.values()], self._step, len(poses))
        return list(moves), stepped, poses.repeated(len(moves))

    def _of_entries(self, entries: list[int], values: Array) -> Array:
        """Variants (nx, n, …) of values stepped along k entries of x (k·n, …), or along none."""
        if not entries:
            return self._variants(values)
        stepped = values.reshape(len(entries), -1, *values.shape[1:])
        variants = self._variants(stepped[0].real)
        variants[entries] = stepped
        return variants

    def _variants(self, values: Array) -> Array:
        """Complex copies of values, one for each entry of x (nx, …)."""
        return np.array(np.broadcast_to(values, (len(self.x), *values.shape)), dtype=complex)
