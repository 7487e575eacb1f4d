"""Frequencies, stiffness and static forces at a design vector x, with derivatives by x.

What x means is in ``design_vector.py``; here it meets poses and load cases. Nothing here depends
on the requirements. Derivatives are exact, see ``gradient.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, congruent, remembered
from armdesign.design.program.corners import Corners, Pistons
from armdesign.design.program.design_vector import ChosenLengths, DesignVector, Geometry
from armdesign.design.program.fixed_terms import FixedPins, OwnJoints
from armdesign.design.program.gradient import STEP, SteppedDesign
from armdesign.design.program.lowest_eigenvalues import lowest
from armdesign.design.program.moving_masses import InertiaAndGravity, MovingMasses
from armdesign.frequency.bands import Corner
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import inverse_cholesky
from armdesign.frequency.workspace import Workspace
from armdesign.machine.poses import own_forces, static_forces
from armdesign.mechanism.carried_bars import M, MomentsOf, first_of_bar, of_bar, units_of, weighed
from armdesign.mechanism.rigid_poses import RigidPoses


@dataclass(frozen=True, eq=False)
class Rows:
    """Pairs of a pose and a load case: indices of both (n,), inertia M, gravity g and ∂g/∂q.

    With the load, without masses that depend on x; ∂g/∂q holds springs too, which no x changes.
    A load case at another corner of the bands is another one: ``payload`` counts on, and
    ``corner`` (n,) is its index. M is ``weight`` (n,) times what it is; ``growth`` (n, nx) is
    the growth of the emphasis with x, (n, 0) where there is none: see ``corners.py``.
    """

    pose: Array
    payload: Array
    corner: Array
    weight: Array
    mass: Array
    gravity: Array
    slope: Array
    growth: Array

    def __len__(self) -> int:
        return len(self.pose)


@dataclass(frozen=True, eq=False, kw_only=True)
class Dynamics:
    """Frequencies and static forces of the designs x, over all poses and load cases.

    Attributes:
        vector: what x means.
        corners: corners of the bands that count, of the vector's machine.
        origin: the same where lengths of cylinders follow their pins; None where they do here. It
            has the rows, and today's frequencies, which no chosen length changes.
    """

    vector: DesignVector
    corners: Corners
    origin: Dynamics | None = None

    def with_lengths(self, lengths: ChosenLengths) -> Dynamics:
        """The same with closed lengths and strokes that are chosen."""
        vector = replace(self.vector, chosen_lengths=lengths)
        return replace(self, vector=vector, origin=self.origin or self)

    # ---------------------------------------------------------------------------------------- rows

    @property
    def workspace(self) -> Workspace:
        """Poses that count."""
        return self.corners.workspace

    @cached_property
    def rows(self) -> Rows:
        """Every pose with every load case that exists there, at all corners of the bands."""
        if self.origin is not None:
            return self.origin.rows
        return self._rows(self.corners.all, weighted=True)

    @cached_property
    def nominal_rows(self) -> Rows:
        """Every pose with every load case at the masses of the file, which requirements count."""
        if self.origin is not None:
            return self.origin.nominal_rows
        as_in_file = Corner(self.corners.ends[0], 1.0, 1.0)
        return self.rows if self.corners.all == [as_in_file] else self._rows([as_in_file])

    def _rows(self, corners: Sequence[Corner], weighted: bool = False) -> Rows:
        """Pairs of a pose and a load case at corners of the bands, weighted if these count."""
        parts: list[tuple[Array, ...]] = []
        for corner, one in enumerate(corners):
            shares = one.payload_share, one.link_share
            springs = self.corners.bands.at_end(self.vector.machine, one.soft).spring_stiffness
            added = np.diag(np.concatenate([np.zeros(len(self.vector.machine.joints)), springs]))
            for case in load_cases(self.vector.bare, self.workspace, *shares):
                mass, gravity, slope = case.machine.loaded(case.rigid)
                numbers = [np.full(len(mass), x) for x in (len(parts), corner, 1.0)]
                growth = np.zeros((len(mass), 0))
                if weighted and self.corners.emphasis is not None:
                    growth = self.corners.emphasis.growth[case.name][case.exists]
                if weighted:
                    numbers[-1] = self.corners.weight_at(corner, case)
                    mass = numbers[-1][:, None, None] * mass
                parts.append((case.indices, *numbers, mass, gravity, slope + added, growth))
        return Rows(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def forces_of_nominal(self, forces: Array) -> Array | None:
        """Static forces (·, nc) of ``nominal_rows`` out of all (n, nc); None if not known."""
        masses = {corner[1:] for corner in self.corners.all}
        return forces[: len(self.nominal_rows)] if masses == {(1.0, 1.0)} else None

    def row_coordinates(self, rows: Array) -> Array:
        """Load case and joint positions, each over its range, of rows: to tell rows apart."""
        low, high = self.workspace.ranges.T
        scaled = (self.workspace.q[self.rows.pose[rows]] - low) / (high - low)
        return np.concatenate([self.rows.payload[rows, None].astype(float), scaled], axis=1)

    # ------------------------------------------------------------------------- inertia and gravity

    @remembered
    def stepped(self, x: Array) -> SteppedDesign:
        """The design at x with a complex step along each entry."""
        return SteppedDesign(self.vector, x.copy())

    def inertia_and_gravity(
        self, x: Array, rows: Rows, chosen: Array | slice
    ) -> InertiaAndGravity:
        """M, g and ∂g/∂q of some rows at x, with masses that depend on x."""
        known = rows.mass[chosen], rows.gravity[chosen], rows.slope[chosen]
        moving = self.vector.moving_masses
        if moving is None:
            return known
        watched, back = self._watched(rows.pose[chosen])
        added = moving.inertia_and_gravity(watched, self._moments(x, moving, of_bar))
        mass = rows.weight[chosen, None, None] * added[0][back]
        return known[0] + mass, known[1] + added[1][back], known[2] + added[2][back]

    def _moments(
        self, x: Array, moving: MovingMasses, of: MomentsOf[M]
    ) -> Callable[[int, RigidPoses], M]:
        """Function that gives the moments of a cylinder's bars at x at positions of its joints."""
        areas, closed = self.vector.areas(x), self.vector.strokes(x)[0]
        linkages = self.vector.linkages(x)

        def moments(i: int, positions: RigidPoses) -> M:
            masses = moving.masses_of(i, areas[i], closed[i], linkages[i])
            units = units_of(linkages[i], closed[i], positions, moving.bars[i], of)
            return weighed(masses, units)

        return moments

    def stepped_nominal_gravity(self, x: Array, rows: Array) -> Array:
        """Gravity torque (nx, k, …) of some ``nominal_rows``, stepped along each entry of x.

        Or (1, k, …) where x does not matter.
        """
        known = self.nominal_rows.gravity[rows][None]
        if self.vector.moving_masses is None:
            return known
        return known + self.stepped(x).moving_gravity(self.loaded(rows))

    def stepped_inertia_and_gravity(
        self, x: Array, rows: Rows, chosen: Array
    ) -> InertiaAndGravity:
        """M, g, ∂g/∂q of rows, a complex step along each entry of x (nx, n, …), or (1, n, …)."""
        mass, gravity, slope = rows.mass[chosen], rows.gravity[chosen], rows.slope[chosen]
        if self.vector.moving_masses is None:
            return mass[None], gravity[None], slope[None]
        added = self.stepped(x).mass_terms(self.workspace.rigid[rows.pose[chosen]])
        weight = rows.weight[chosen, None, None]
        return mass + weight * added[0], gravity + added[1], slope + added[2]

    def scaled_fixed_mass(self, x: Array, rows: Array) -> Array:
        """L⁻¹M₀L⁻ᵀ (n, nq, nq) of rows: M₀ without masses that depend on x, M = L Lᵀ with them."""
        lower = inverse_cholesky(self.inertia_and_gravity(x, self.rows, rows)[0])
        return congruent(lower, self.rows.mass[rows])

    def nominal_forces(self, x: Array) -> Array:
        """Static forces (n, nc) [N] of ``nominal_rows`` at x."""
        arm = self._geometry(x, self.nominal_rows.pose).arm
        gravity, moving = self.nominal_rows.gravity, self.vector.moving_masses
        if moving is not None:
            moments = self._moments(x, moving, first_of_bar)
            known = moving.gravity(self.workspace.rigid, moments)
            gravity = gravity + known[self.nominal_rows.pose]
        return self.static_forces(arm, gravity, self.vector.areas(x))

    def static_forces(self, arm: Array, gravity: Array, areas: Array) -> Array:
        """Forces (…, nc) [N] that hold gravity (…, k) at areas (…, nc, 2)."""
        return static_forces(arm, gravity, areas[..., 0], len(self.vector.machine.joints))

    # --------------------------------------------------------------------------------- frequencies

    def omega_squared(self, x: Array, rows: Array | None = None) -> Array:
        """Lowest coupled ω² of rows [rad²/s²] at x (all rows if None)."""
        return self.omega_squared_and_forces(x, rows)[0]

    def omega_squared_and_forces(self, x: Array, rows: Array | None = None) -> tuple[Array, Array]:
        """Lowest coupled ω² (n,) [rad²/s²] and static forces (n, nc) [N] of rows at x, or all."""
        return self._of_all_rows(x) if rows is None else self._of_rows(x, rows)

    @remembered
    def _of_all_rows(self, x: Array) -> tuple[Array, Array]:
        return self._of_rows(x, slice(None))

    def _of_rows(self, x: Array, rows: Array | slice) -> tuple[Array, Array]:
        if (fixed := self._fixed_pins) is not None:
            length, forces = fixed.length[rows], fixed.forces[rows]
            pistons = self._pistons(x, length, forces)
            oil = self.corners.stiffness(self.rows.corner[rows], pistons)
            return fixed.omega_squared(rows, oil), forces
        if (joints := self._fixed_joints) is not None:
            diagonal, forces = self._own_diagonal(x, rows, self.rows.gravity[rows])
            return joints.omega_squared(rows, diagonal), forces
        matrix, mass, forces = self._stiffness_and_mass(x, rows)
        lower = self.inverse_cholesky_of(mass, rows)
        return lowest(congruent(lower, matrix)), forces

    @cached_property
    def omega_squared_scale(self) -> float:
        """The ω² that others are measured by [rad²/s²]: today's lowest, or 1 % of today's median.

        The latter where it is larger, for a machine that is next to unstable, or is unstable, at
        its worst pose.
        """
        if self.origin is not None:
            return self.origin.omega_squared_scale
        today = self.omega_squared(self.vector.start)
        return float(max(today.min(), 0.01 * np.median(np.abs(today))))

    @cached_property
    def omega_squared_today(self) -> float:
        """Today's lowest ω² [rad²/s²]."""
        if self.origin is not None:
            return self.origin.omega_squared_today
        return float(self.omega_squared(self.vector.start).min())

    def inverse_cholesky_of(self, mass: Array, rows: Array | slice) -> Array:
        """L⁻¹ of M = L Lᵀ of rows: scales each matrix inequality."""
        if self.vector.moving_masses is None:
            return np.asarray(self._fixed_inverse_cholesky[rows])
        return inverse_cholesky(mass)

    @cached_property
    def _fixed_inverse_cholesky(self) -> Array:
        """L⁻¹ of M = L Lᵀ for every row, where M does not depend on x."""
        if self.origin is not None:
            return self.origin._fixed_inverse_cholesky
        return inverse_cholesky(self.rows.mass)

    @cached_property
    def _fixed_geometry(self) -> Geometry | None:
        """Today's geometry at all poses where no pin varies."""
        if self.vector.moving:
            return None
        return self.vector.geometry(self.vector.start, self.workspace.rigid)

    @cached_property
    def _fixed_pins(self) -> FixedPins | None:
        """Terms that areas leave alone; None where pins vary, or forces, masses or emphasis."""
        machine, g, pose = self.vector.machine, self._fixed_geometry, self.rows.pose
        redundant = len(machine.actuators) != len(machine.joints)
        if (
            g is None
            or redundant
            or self.vector.moving_masses is not None
            or self.corners.emphasis is not None
        ):
            return None
        lower = self._fixed_inverse_cholesky
        arm, turned = g.arm[pose], np.swapaxes(lower, 1, 2)
        forces = self.static_forces(arm, self.rows.gravity, self.vector.areas_today)
        fixed_stiffness = self.rows.slope - np.einsum("nc,ncij->nij", forces, g.curve[pose])
        return FixedPins(g.length[pose], forces, arm @ turned, congruent(lower, fixed_stiffness))

    @cached_property
    def _fixed_joints(self) -> OwnJoints | None:
        """Terms that pins leave alone too; None where masses vary, or joints share actuators."""
        if self.origin is not None:
            return self.origin._fixed_joints
        moved = self.vector.moving_masses is not None or self.corners.emphasis is not None
        if moved or self.vector.own_joints is None:
            return None
        return OwnJoints.of(self._fixed_inverse_cholesky, self.rows.slope)

    def _geometry(self, x: Array, poses: Array) -> Geometry:
        """Geometry at some of the workspace's poses."""
        if self._fixed_geometry is not None:
            return self._fixed_geometry[poses]
        return self._at(self.vector.geometry, x, poses)

    def _at(
        self, geometry: Callable[[Array, RigidPoses], Geometry], x: Array, poses: Array
    ) -> Geometry:
        """A geometry at some of the workspace's poses."""
        watched, back = self._watched(poses)
        with np.errstate(invalid="ignore", divide="ignore"):
            return geometry(x, watched)[back]

    @remembered
    def _watched(self, poses: Array) -> tuple[RigidPoses, Array]:
        """Some of the workspace's poses, each once, and which of them every one is.

        Many designs are looked at there in a row. Instead of many, all that the workspace has.
        """
        rigid = self.workspace.rigid
        if len(poses) >= len(rigid):
            return rigid, poses
        few, back = np.unique(poses, return_inverse=True)
        return rigid[few], back

    @remembered
    def loaded(self, rows: Array) -> RigidPoses:
        """The poses of some of the ``nominal_rows``, at which static forces are watched."""
        return self.workspace.rigid[self.nominal_rows.pose[rows]]

    # ----------------------------------------------------------------------------------- stiffness

    def scaled_stiffness_and_gradient(
        self, x: Array, rows: Array, squared: float = 0.0
    ) -> tuple[Array, Array]:
        """L⁻¹K L⁻ᵀ of rows (n, nq, nq) and its derivatives by x (nx, n, nq, nq).

        Where M depends on x, L stays and the derivatives are of K − M·``squared``: the change of
        K x = ω² M x that counts near an ω² of ``squared`` [rad²/s²].
        """
        at = self.stepped(x)
        g = at.geometry(self.workspace.rigid[self.rows.pose[rows]])
        mass, gravity, slope = self.stepped_inertia_and_gravity(x, self.rows, rows)
        forces = self.static_forces(g.arm, gravity, at.areas[:, None])
        extension = g.length - at.closed[:, None]
        pistons = Pistons(extension, at.stroke[:, None], at.areas[:, None], forces)
        emphasis = self._stepped_emphasis(x, rows)
        pull = emphasis * slope - 1j * squared * mass.imag
        stiffness = emphasis * self.actuator_stiffness(self.rows.corner[rows], g, pistons) + pull
        lower = self.inverse_cholesky_of(mass[0].real, rows)
        return congruent(lower, stiffness[0].real), congruent(lower, stiffness.imag / STEP)

    def scaled_stiffness(
        self, x: Array, rows: Array, about: Array | None = None, squared: float = 0.0
    ) -> Array:
        """L⁻¹K L⁻ᵀ of rows (n, nq, nq).

        Where M depends on x: L⁻¹(K − ω²(M − M0))L⁻ᵀ with M0 = L Lᵀ at ``about`` (x itself if None)
        and an ω² of ``squared`` [rad²/s²]. Its lowest eigenvalue is above, at or below ω² where
        the lowest of K v = λ M v is.
        """
        matrix, mass, _ = self._stiffness_and_mass(x, rows)
        if about is None or self.vector.moving_masses is None:
            before = mass
        else:
            before = self.inertia_and_gravity(about, self.rows, rows)[0]
        if self.vector.moving_masses is not None:
            matrix = matrix - squared * (mass - before)
        lower = self.inverse_cholesky_of(before, rows)
        return congruent(lower, matrix)

    def scaled_stiffness_chords(
        self,
        low: Array,
        high: Array,
        rows: Array,
        about: Array | None = None,
        squared: float = 0.0,
    ) -> tuple[Array, Array]:
        """L⁻¹K L⁻ᵀ at areas ``low`` and slopes by x of its chords up to areas ``high``.

        A chamber's stiffness A²/(A s + V) is convex in A, so the chord lies above it: no areas
        between are stiffer than this says. Masses are affine in the areas; ``about`` and
        ``squared`` as in ``scaled_stiffness``.
        """
        about = low if about is None else about
        base, slopes = self.scaled_stiffness(low, rows, about, squared), []
        for v, width in enumerate(np.where(high > low, high - low, 1.0)):
            end = low.copy()
            end[v] = high[v]
            slopes.append((self.scaled_stiffness(end, rows, about, squared) - base) / width)
        return base, np.stack(slopes)

    def _stiffness_and_mass(self, x: Array, rows: Array | slice) -> tuple[Array, Array, Array]:
        """K and M (n, nq, nq) and static forces (n, nc) [N] of rows."""
        mass, gravity, slope = self.inertia_and_gravity(x, self.rows, rows)
        if self.vector.own_joints is not None and self.vector.moving:
            diagonal, forces = self._own_diagonal(x, rows, gravity)
            stiffness = np.einsum("nj,jk->njk", diagonal, np.eye(diagonal.shape[1]))
            return self._emphasis(x, rows) * (stiffness + slope), mass, forces
        g = self._geometry(x, self.rows.pose[rows])
        forces = self.static_forces(g.arm, gravity, self.vector.areas(x))
        pistons = self._pistons(x, g.length, forces)
        stiffness = self.actuator_stiffness(self.rows.corner[rows], g, pistons)
        return self._emphasis(x, rows) * (stiffness + slope), mass, forces

    def _own_diagonal(self, x: Array, rows: Array | slice, gravity: Array) -> tuple[Array, Array]:
        """Diagonal (n, nq) of K without gravity's share, and static forces, by ``own_joints``."""
        own, corner = self.vector.own_joints, self.rows.corner[rows]
        g = self._at(self.vector.own_geometry, x, self.rows.pose[rows])
        forces = own_forces(g.arm, gravity[:, own])
        oil = self.corners.stiffness(corner, self._pistons(x, g.length, forces))
        diagonal = np.empty_like(forces)
        diagonal[:, own] = g.arm * (g.arm * oil) - forces * g.curve
        return diagonal, forces

    def _emphasis(self, x: Array, rows: Array | slice) -> Array | float:
        """By how much more stiffness counts at x than where the emphasis was found (n, 1, 1)."""
        if self.corners.emphasis is None:
            return 1.0
        moved = x - self.corners.emphasis.about
        return np.asarray(np.exp(2 * self.rows.growth[rows] @ moved)[:, None, None])

    def _stepped_emphasis(self, x: Array, rows: Array) -> Array | float:
        """``_emphasis`` with a complex step along each entry of x (nx, n, 1, 1)."""
        if self.corners.emphasis is None:
            return 1.0
        steps = 1 + 2j * STEP * self.rows.growth[rows].T[:, :, None, None]
        return np.asarray(steps * self._emphasis(x, rows))

    def _pistons(self, x: Array, length: Array, forces: Array) -> Pistons:
        """Pistons of rows at x with lengths [m] and static forces [N] (n, nc)."""
        closed, stroke = self.vector.strokes(x)
        return Pistons(length - closed, stroke, self.vector.areas(x), forces)

    def actuator_stiffness(self, corner: Array, g: Geometry, pistons: Pistons) -> Array:
        """Oil's and geometric stiffness (…, n, nq, nq), without gravity's; complex-safe.

        Axes in front as in ``Pistons``.
        """
        oil = self.corners.stiffness(corner, pistons)[..., None]
        geometric = np.einsum("...c,...cij->...ij", pistons.force, g.curve)
        return np.asarray(np.swapaxes(g.arm, -1, -2) @ (g.arm * oil) - geometric)
