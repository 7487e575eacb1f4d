"""The design problem in arrays: frequencies, stiffness and static forces with exact derivatives at a design vector x.

What x means is in ``space.py``; here it meets poses and load cases. Derivatives are exact: places
by the analytic sensitivities of the linkage, everything after them (oil, statics, sums, own
masses) by a complex step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, remembered
from armdesign.design.program.design_vector import STEP, DesignSpace, Geometry
from armdesign.design.program.fixed_pins import Still, lowest
from armdesign.design.program.moving_masses import Loads, summed
from armdesign.design.requirements.settings import Requirements
from armdesign.frequency.bands import Bands
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import inverse_cholesky
from armdesign.machine.machine import Machine
from armdesign.machine.poses import static_forces
from armdesign.mechanism.arm import RigidPoses


@dataclass(frozen=True, eq=False)
class Rows:
    """Pairs of a pose and a load case: indices of both (n,), inertia M, gravity g and ∂g/∂q with the load.

    Own masses that depend on x are not in them. Where masses have bands, a load case at other
    masses is another one: ``payload`` counts on.
    """

    pose: Array
    payload: Array
    mass: Array
    gravity: Array
    slope: Array


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem(DesignSpace):
    """Cylinders and linkages of ``machine`` over ``workspace`` under ``requirements``.

    Rows are pairs of a pose and a load case of that pose.
    """

    tightening: float = 0.0  # share by which limits are drawn in, to leave room for rounding
    reserve: Mapping[str, float] = field(
        default_factory=dict
    )  # room that named limits keep, for rounding too
    ease: Mapping[str, float] = field(
        default_factory=dict
    )  # share by which named limits are relaxed
    bands: Bands = field(
        default_factory=Bands
    )  # the worst within them counts; requirements are judged without

    # ---------------------------------------------------------------------------------------- rows

    @cached_property
    def rows(self) -> Rows:
        """Every pair of a pose and a load case that exists there, at all masses that the bands ask to try."""
        return self._rows(self.bands.mass_shares(self.machine))

    @cached_property
    def held(self) -> Rows:
        """Those at the masses of the file, which requirements are judged at."""
        masses = self.bands.mass_shares(self.machine)
        return self.rows if masses == [(1.0, 1.0)] else self._rows([(1.0, 1.0)])

    def _rows(self, masses: Sequence[tuple[float, float]]) -> Rows:
        """Pairs of a pose and a load case at shares of the payload's and of the links' masses."""
        cases = [
            case
            for payload_share, link_share in masses
            for case in load_cases(self.bare, self.workspace, payload_share, link_share)
        ]
        parts = [
            (case.indices, np.full(case.exists.sum(), k), *case.machine.loaded(case.rigid))
            for k, case in enumerate(cases)
        ]
        return Rows(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def __len__(self) -> int:
        return len(self.rows.pose)

    def pose_of(self, rows: Array) -> Array:
        """Joint positions of rows, each joint scaled to its range, the load case in front (for telling rows apart)."""
        low, high = self.workspace.ranges.T
        scaled = (self.workspace.q[self.rows.pose[rows]] - low) / (high - low)
        return np.concatenate([self.rows.payload[rows, None].astype(float), scaled], axis=1)

    def tightened(self, share: float) -> Problem:
        """The same problem with limits drawn in by a share."""
        return self._like(dataclasses.replace(self, tightening=share))

    def with_reserve(self, reserve: Mapping[str, float]) -> Problem:
        """The same problem with room kept at named limits."""
        return self._like(dataclasses.replace(self, reserve=reserve))

    def under(self, requirements: Requirements) -> Problem:
        """The same problem under other requirements that leave the pin boxes as they are."""
        other = self._like(dataclasses.replace(self, requirements=requirements))
        for name in ("_asked", "variables"):  # the areas' ends depend on the thrust
            vars(other).pop(name, None)
        return other

    def eased(self, ease: Mapping[str, float]) -> Problem:
        """The same problem with named limits relaxed by a share."""
        return self._like(dataclasses.replace(self, ease=ease))

    @property
    def softened(self) -> Problem:
        """The same problem of a machine that has the softest oil of the bands: only bands of masses are left."""
        masses = Bands(payload=self.bands.payload, link_mass=self.bands.link_mass)
        return dataclasses.replace(self, machine=self._soft, bands=masses)

    def _like(self, other: Problem) -> Problem:
        """A problem that differs in its limits alone: what does not depend on them is not computed again."""
        fields = {f.name for f in dataclasses.fields(self)}
        vars(other).update(
            {name: value for name, value in vars(self).items() if name not in fields}
        )
        return other

    @cached_property
    def _soft(self) -> Machine:
        """Today's machine with the softest oil of the bands."""
        return self.bands.with_oil(self.machine, softest=True)

    @cached_property
    def bare(self) -> Machine:
        """Today's machine without the own masses that depend on x."""
        return self.machine if self.own is None else self.own.rest

    # --------------------------------------------------------------------------------------- loads

    def loads(self, x: Array, rows: Rows, chosen: Array | slice) -> Loads:
        """M, g and ∂g/∂q of some rows at x, own masses included."""
        known = rows.mass[chosen], rows.gravity[chosen], rows.slope[chosen]
        if self.own is None:
            return known
        poses, back = np.unique(rows.pose[chosen], return_inverse=True)
        linkages, closed = self.linkages(x), self.strokes(x)[0]
        if self.moving:
            units = self.own.units(linkages, closed, self.workspace.rigid[poses])
        else:
            units = (
                self._own_today[0][:, poses],
                self._own_today[1][:, poses],
                self._own_today[2][:, poses],
            )
        added = summed(self.own.masses(self.areas(x), closed, linkages), units)
        return known[0] + added[0][back], known[1] + added[1][back], known[2] + added[2][back]

    @cached_property
    def _own_today(self) -> Loads:
        """M, g and ∂g/∂q of a kilogram of each own mass at every pose, for pins that stay."""
        assert self.own is not None
        closed = np.array([actuator.closed_length for actuator in self.machine.actuators])
        return self.own.units(self.machine.linkages, closed, self.workspace.rigid)

    def stepped_loads(self, x: Array, rows: Rows, chosen: Array) -> Loads:
        """Those of some rows with a complex step along each entry of x (nx, n, …), or (1, n, …) if they know no x."""
        mass, gravity, slope = rows.mass[chosen], rows.gravity[chosen], rows.slope[chosen]
        if self.own is None:
            return mass[None], gravity[None], slope[None]
        added = self.stepped_own(x, self.workspace.rigid[rows.pose[chosen]])
        return mass + added[0], gravity + added[1], slope + added[2]

    def stepped_own(self, x: Array, rigid: RigidPoses) -> Loads:
        """M, g and ∂g/∂q of own masses that depend on x, with a complex step along each of its entries (nx, n, …)."""
        assert self.own is not None
        linkages, areas, closed = (
            self.linkages(x),
            self.stepped_areas(x),
            self.stepped_strokes(x)[0],
        )
        own, units = (
            self.own.masses(areas, closed, linkages),
            self.own.units(linkages, closed[0].real, rigid),
        )
        total = summed(own, units)
        for i in self.own.bars:
            mine = self.own.rows(i)
            for index in self.moves(i):
                linkage = self.variant(linkages[i], index)
                moved = self.own.masses_of(i, areas[index, i], closed[index, i], linkage)
                after = summed(moved, self.own.units_of(i, linkage, closed[index, i], rigid))
                before = summed(own[index, mine], (units[0][mine], units[1][mine], units[2][mine]))
                for part, new, old in zip(total, after, before, strict=True):
                    part[index] += new - old
        return total

    def lightness(self, x: Array, rows: Array) -> Array:
        """L⁻¹M L⁻ᵀ (n, nq, nq) of rows without the own masses that depend on x, in the frame of M = L Lᵀ at x."""
        lower = inverse_cholesky(self.loads(x, self.rows, rows)[0])
        return np.asarray(lower @ self.rows.mass[rows] @ np.swapaxes(lower, 1, 2))

    def held_forces(self, x: Array) -> Array:
        """Static forces (n, nc) [N] of the rows ``held`` at x."""
        arm = self._geometry_of(x, self.held.pose).arm
        gravity = self.loads(x, self.held, slice(None))[1]
        return static_forces(arm, gravity, self.areas(x)[:, 0])

    # --------------------------------------------------------------------------------- frequencies

    def frequencies(self, x: Array, rows: Array | None = None) -> Array:
        """Lowest coupled ω² of rows [rad²/s²] at x (all rows if None)."""
        return self.look(x, rows)[0]

    def look(self, x: Array, rows: Array | None = None) -> tuple[Array, Array]:
        """Lowest coupled ω² (n,) [rad²/s²] and static forces (n, nc) [N] of rows at x (all rows if None)."""
        return self._look_everywhere(x) if rows is None else self._look(x, rows)

    @remembered
    def _look_everywhere(self, x: Array) -> tuple[Array, Array]:
        return self._look(x, slice(None))

    def _look(self, x: Array, rows: Array | slice) -> tuple[Array, Array]:
        if self._still is not None:
            length, forces = self._still.length[rows], self._still.forces[rows]
            return (
                self._still.squared(
                    rows, self._oil(length, *self.strokes(x), self.areas(x), forces)
                ),
                forces,
            )
        matrix, mass, forces = self._assembled(x, rows)
        lower = self._inverse_cholesky[rows] if self.own is None else inverse_cholesky(mass)
        return lowest(lower @ matrix @ np.swapaxes(lower, 1, 2)), forces

    @cached_property
    def scale(self) -> float:
        """The ω² that others are measured by [rad²/s²]: today's lowest, or 1 % of today's median if that is larger.

        The latter is for a machine that is next to unstable, or is unstable, at its worst pose.
        """
        return float(max(self.lowest_today, 0.01 * np.median(np.abs(self._squared_today))))

    @property
    def lowest_today(self) -> float:
        """Today's lowest ω² [rad²/s²]."""
        return float(self._squared_today.min())

    @cached_property
    def _squared_today(self) -> Array:
        return self.frequencies(self.start)

    @cached_property
    def _inverse_cholesky(self) -> Array:
        """L⁻¹ of M = L Lᵀ for every row, where no x moves M: scales each matrix inequality."""
        return inverse_cholesky(self.rows.mass)

    @cached_property
    def _fixed(self) -> Geometry | None:
        """Today's geometry at all poses where no pin varies."""
        if self.moving:
            return None
        return self.geometry(self.start, self.workspace.rigid)

    @cached_property
    def _still(self) -> Still | None:
        """What areas leave alone, where no pin varies and neither static forces nor masses depend on the areas."""
        if (
            self._fixed is None
            or self.own is not None
            or len(self.machine.actuators) != len(self.machine.joints)
        ):
            return None
        g, pose, lower = self._fixed, self.rows.pose, self._inverse_cholesky
        arm, turned = g.arm[pose], np.swapaxes(lower, 1, 2)
        forces = static_forces(arm, self.rows.gravity, self.areas_today[:, 0])
        rest = self.rows.slope - np.einsum("nc,ncij->nij", forces, g.curve[pose])
        return Still(g.length[pose], forces, arm @ turned, lower @ rest @ turned)

    def _geometry_of(self, x: Array, poses: Array) -> Geometry:
        """Geometry at some of the workspace's poses."""
        if self._fixed is not None:
            return self._fixed[poses]
        rigid = self.workspace.rigid
        with np.errstate(invalid="ignore", divide="ignore"):
            return (
                self.geometry(x, rigid)[poses]
                if len(poses) >= len(rigid)
                else self.geometry(x, rigid[poses])
            )

    # ----------------------------------------------------------------------------------- stiffness

    def matrices(self, x: Array, rows: Array, squared: float = 0.0) -> tuple[Array, Array]:
        """L⁻¹K L⁻ᵀ of rows (n, nq, nq) and its derivatives by x (nx, n, nq, nq).

        Where M depends on x, L stays and the derivatives are those of K − M·``squared``: the
        change of K x = ω² M x that counts near an ω² of ``squared`` [rad²/s²].
        """
        length, arm, curve = self.geometry(
            x, self.workspace.rigid[self.rows.pose[rows]], derivatives=True
        ).stepped()
        (closed, stroke), areas = self.stepped_strokes(x), self.stepped_areas(x)
        mass, gravity, slope = self.stepped_loads(x, self.rows, rows)
        pull = slope - 1j * squared * mass.imag
        forces = static_forces(arm, gravity, areas[:, None, :, 0])
        ends = closed[:, None], stroke[:, None]
        stepped = self._stiffness(length, arm, curve, *ends, areas[:, None], forces) + pull
        lower = (
            self._inverse_cholesky[rows] if self.own is None else inverse_cholesky(mass[0].real)
        )
        turned = np.swapaxes(lower, 1, 2)
        return lower @ stepped[0].real @ turned, lower @ (stepped.imag / STEP) @ turned

    def scaled(
        self, x: Array, rows: Array, about: Array | None = None, squared: float = 0.0
    ) -> Array:
        """L⁻¹K L⁻ᵀ of rows (n, nq, nq).

        Where M depends on x: L⁻¹(K − ω²(M − M0))L⁻ᵀ in the frame of M0 = L Lᵀ at ``about`` (x
        itself if None) with an ω² of ``squared`` [rad²/s²]. Its lowest eigenvalue is above, at or
        below ω² where that of K v = λ M v is.
        """
        matrix, mass, _ = self._assembled(x, rows)
        if self.own is None:
            lower = self._inverse_cholesky[rows]
        else:
            there = mass if about is None else self.loads(about, self.rows, rows)[0]
            matrix, lower = matrix - squared * (mass - there), inverse_cholesky(there)
        return np.asarray(lower @ matrix @ np.swapaxes(lower, 1, 2))

    def chord_matrices(
        self,
        low: Array,
        high: Array,
        rows: Array,
        about: Array | None = None,
        squared: float = 0.0,
    ) -> tuple[Array, Array]:
        """L⁻¹K L⁻ᵀ at areas ``low`` and its slopes by x, each chamber's stiffness replaced by its chord over the box.

        A²/(A s + V) is convex in A, so the chord lies above it: no areas in the box are stiffer
        than this says. Own masses are affine in the areas; ``about`` and ``squared`` as in
        ``scaled``.
        """
        about = low if about is None else about
        ends = []
        for v in range(len(low)):
            moved = low.copy()
            moved[v] = high[v]
            ends.append(moved)
        base = self.scaled(low, rows, about, squared)
        width = np.where(high > low, high - low, 1.0)
        slopes = [
            (self.scaled(end, rows, about, squared) - base) / w
            for end, w in zip(ends, width, strict=True)
        ]
        return base, np.stack(slopes)

    def _assembled(self, x: Array, rows: Array | slice) -> tuple[Array, Array, Array]:
        """K and M (n, nq, nq) and static forces (n, nc) [N] of rows."""
        g, areas, (mass, gravity, slope) = (
            self._geometry_of(x, self.rows.pose[rows]), self.areas(x), self.loads(x, self.rows, rows)
        )  # fmt: skip
        forces = static_forces(g.arm, gravity, areas[:, 0])
        return (
            self._stiffness(g.length, g.arm, g.curve, *self.strokes(x), areas, forces) + slope,
            mass,
            forces,
        )

    def _stiffness(
        self,
        length: Array,
        arm: Array,
        curve: Array,
        closed: Array,
        stroke: Array,
        areas: Array,
        forces: Array,
    ) -> Array:
        """K less gravity's slope: hydraulic + geometric (…, n, nq, nq); complex-safe.

        Axes in front as in ``_oil``.
        """
        weighted = arm * self._oil(length, closed, stroke, areas, forces)[..., None]
        return np.swapaxes(arm, -1, -2) @ weighted - np.einsum("...c,...cij->...ij", forces, curve)

    def _oil(
        self, length: Array, closed: Array, stroke: Array, areas: Array, forces: Array
    ) -> Array:
        """Oil stiffness of every actuator (…, n, nc) [N/m, N m/rad] at its lengths and static forces (…, n, nc).

        Closed lengths and strokes (…, nc) and areas (…, nc, 2) are broadcast.
        """
        fluid, supply = self._soft.fluid, self._soft.supply
        oil = []
        for i, actuator in enumerate(self._soft.actuators):
            a1, a2 = areas[..., i, 0], areas[..., i, 1]
            if self.proportional:
                old = self.areas_today[i]
                actuator = dataclasses.replace(
                    actuator,
                    cap_dead_volume=actuator.cap_dead_volume * a1 / old[0],
                    annulus_dead_volume=actuator.annulus_dead_volume * a2 / old[1],
                )
            oil.append(
                actuator.stiffness(
                    length[..., i] - closed[..., i],
                    forces[..., i],
                    fluid,
                    supply,
                    areas=(a1, a2),
                    stroke=stroke[..., i],
                )
            )
        return np.stack(oil, axis=-1)
