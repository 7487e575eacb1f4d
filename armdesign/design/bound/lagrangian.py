"""Lagrangian bound: multipliers split the design problem into one small problem per cylinder.

For any Z_j ⪰ 0 with Σ tr Z_j = 1 and multipliers μ ≥ 0 of the shared oil the lowest ω² over all
rows (poses and load cases) is at most, for every design x that the requirements allow,

    Σ_j ⟨Z_j, L_j⁻¹ K_j(x) L_j⁻ᵀ⟩ + μ·(budget − Σ_i v_i(x)),    M_j = L_j L_jᵀ.

Where a joint has a cylinder of its own, K_j is the part of gravity, springs and motors, which no
design changes, plus a diagonal whose entry there, k r² − g H/r, depends on that cylinder alone and
is zero for the others. So the maximum over x falls apart. Where several cylinders move a joint and
no other, their entries add, each with a part of g between nothing and the whole.

The budget is what ``requirements/oil.py`` allows of all cylinders;
``test_no_random_design_exceeds_the_bound`` ties the two.

Own masses that depend on x: let λ0 ≥ 0 and M_j0 be inertia without them, Y_j = L_j⁻ᵀ Z_j L_j⁻¹.
Where λ(x) ≥ λ0,

    0 ≤ Σ_j ⟨Y_j, K_j(x) − λ M_j(x)⟩ ≤ Σ_j ⟨Y_j, K_j(x) − λ0 (M_j(x) − M_j0)⟩ − λ Σ_j ⟨Y_j, M_j0⟩,

so λ is at most λ0, or the largest first sum over the last. In it a cylinder's bars add so much
per area, like oil (``mass_enclosure``), but for their gravity in g H/r of the others, which is an
interval. Multipliers are sought with the masses of the design at hand.

Good Z and μ are the multipliers of a semidefinite programme that mixes known designs of each
cylinder; designs of a larger term at its multipliers join, until none is left (Dantzig and Wolfe,
Oper. Res. 8, 1960).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, congruent
from armdesign.design.bound.branching import Cover, Maximum, first_look, nearer, part_of
from armdesign.design.bound.columns import (
    Columns,
    JointDrive,
    allowed_first,
    column,
    columns_around,
    joined,
    known_columns,
    random_columns,
)
from armdesign.design.bound.cylinder_spring import Stiffening, Structure
from armdesign.design.bound.cylinder_term import CylinderTerm
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.bound.motors import motor_joints, motor_stiffness
from armdesign.design.program.constraints import CONSTRAINT_TOLERANCE
from armdesign.design.program.dynamics import Rows
from armdesign.design.program.problem import Problem
from armdesign.design.search.semidefinite import PENALTY, ProgrammeStep, positive_part, programme
from armdesign.frequency.modes import inverse_cholesky

ROWS, COLUMNS = 24, 48  # of every programme, so that it is set up once
ENTERING = 8  # rows that join at a time
ROUNDS = 15  # of programmes before branching
AGREED = 2e-3  # of ω² where they end
NEGLIGIBLE = 1e-5  # of the weight of all rows, or of a mixture
RIGID = 1e-22  # [m/N] softens no oil by more than floating point loses
CELLS, DRAWN_CELLS = 20_000, 6_000  # branched per cylinder; steps of a drawing hold cells up
COVER = 800  # cells with which the next branching of a cylinder begins, at most
TRIED = 50  # known designs of a cylinder, the best, that branching begins with


@dataclass(frozen=True, eq=False, kw_only=True)
class Multipliers:
    """Multipliers of one programme, ω² in units of the reference."""

    rows: Array  # the rows that it had (n,)
    columns: Columns  # and the designs
    weight: Array  # L⁻ᵀ Z L⁻¹ (n, k, k) over the free coordinates and the reference
    trace: Array  # of each Z (n,)
    oil: Array  # μ of both sides (2,) [1/m³]
    constant: float  # the part of the upper bound that no design changes
    light: float  # Σ ⟨Z, L⁻¹M0 L⁻ᵀ⟩ of the inertia that no design changes, 1 where that is all
    mixed: float  # the best of mixtures, less the penalty of what they exceed the oil by
    mixture: Array  # how much of each column it takes (c,)


@dataclass(eq=False)
class LagrangianDual:
    """The search for multipliers: rows and columns of the programme, a pool of more columns."""

    problem: Problem
    drives: tuple[JointDrive, ...]
    bars: Sequence[BarEnclosure]  # own masses that depend on x
    fixed: Rows  # all rows, without own masses that depend on x; ∂g/∂q with motors' stiffness
    loads: Rows  # the same with the own masses of one design
    reached: float  # that design's lowest ω² over the reference
    watched: Array  # rows that may enter
    reference: float  # [rad²/s²]
    rows: Array
    columns: Columns
    pool: Columns
    covers: list[Cover | None]  # of each drive: cells that hold all its allowed designs,
    efforts: Array  # and how many its last branching took

    @classmethod
    def start(
        cls,
        problem: Problem,
        some: tuple[JointDrive, ...],
        x: Array,
        watched: Array,
        bars: Sequence[BarEnclosure] = (),
    ) -> LagrangianDual:
        """From the design x, its lowest rows, today's design, and random ones."""
        random = np.random.default_rng(0)
        squared = problem.dynamics.omega_squared(x, watched)
        designs = x, problem.vector.start
        known = [known_columns(d, k, problem, designs) for k, d in enumerate(some)]
        pool = [columns_around(d, k, known[k].place[0], random) for k, d in enumerate(some)]
        pool += [random_columns(d, k, random) for k, d in enumerate(some)]
        known = [allowed_first(d, known[k], *pool[k :: len(some)]) for k, d in enumerate(some)]
        reference = max(float(squared.min()), problem.dynamics.omega_squared_scale)
        rows, all_rows = problem.dynamics.rows, np.arange(len(problem.dynamics.rows))
        fixed = replace(rows, slope=rows.slope + motor_stiffness(problem, bool(bars)))
        mass, gravity, slope = problem.dynamics.inertia_and_gravity(x, fixed, all_rows)
        return cls(
            problem=problem,
            drives=some,
            bars=bars,
            fixed=fixed,
            loads=replace(rows, mass=mass, gravity=gravity, slope=slope),
            reached=float(squared.min()) / reference,
            watched=watched,
            reference=reference,
            rows=watched[np.argsort(squared)[:ROWS]],
            columns=joined(*known),
            pool=joined(*pool),
            covers=[None] * len(some),
            efforts=np.ones(len(some)),
        )

    def within(self, k: int, drive: JointDrive, multipliers: Multipliers) -> LagrangianDual:
        """The search with drive ``k`` in a part of its region, ``drive``'s, from multipliers on.

        ``join`` gives it a column of that drive.
        """
        drives = (*self.drives[:k], drive, *self.drives[k + 1 :])
        order = np.argsort(-multipliers.mixture, kind="stable")[: COLUMNS - 1]
        columns = multipliers.columns[order].within(k, drive)
        pool, covers, known = self.pool.within(k, drive), [*self.covers], self.covers[k]
        covers[k] = known and part_of(known, drive.region)
        return replace(
            self, drives=drives, columns=columns, pool=pool, covers=covers,
            efforts=self.efforts.copy(),
        )  # fmt: skip

    def join(self, k: int, most: Maximum) -> None:
        """Take the design of drive ``k`` that branching found, and others around it."""
        random = np.random.default_rng(len(self.pool))
        self.columns = joined(self.columns, column(k, self.drives[k], most.place))
        around = columns_around(self.drives[k], k, most.place, random)
        self.pool = joined(self.pool, around)

    @property
    def near(self) -> float:
        """λ0: what the design at hand reaches where own masses depend on x, else 0."""
        return max(self.reached, 0.0) if self.bars else 0.0

    @cached_property
    def budget(self) -> tuple[float, Array]:
        """Oil that may be swept, over today's; and today's (2,) [m³]."""
        strokes = np.array([c.stroke for c in self.problem.machine.cylinders])
        swept = strokes @ self.problem.vector.areas_today[: len(strokes)]
        return self.problem.requirements.oil_total_share * (1 + CONSTRAINT_TOLERANCE), swept

    # ---------------------------------------------------------------------------------- programmes

    def converged(self) -> Multipliers:
        """Multipliers at which no design of the pool and no watched row would change much."""
        for _ in range(ROUNDS):
            multipliers = self.multipliers()
            of_pool, best = self._best_of_pool(multipliers)
            lowest = self._take_rows(multipliers)
            if of_pool < multipliers.mixed + AGREED and lowest > multipliers.mixed - AGREED:
                break
            self._take(multipliers, best)
        return multipliers

    def multipliers(self) -> Multipliers:
        """Solve the programme over the rows and columns at hand."""
        inverse, base = self.scaled_bases(self.rows)
        step = self._step(inverse, base)
        z = positive_part(step.weights)
        trace = np.trace(z, axis1=1, axis2=2)
        z[trace < NEGLIGIBLE * trace.sum()] = 0.0
        total = np.trace(z, axis1=1, axis2=2).sum()
        z, oil = z / total, step.multipliers[:2] / total
        budget, today = self.budget
        weight = congruent(np.swapaxes(inverse, 1, 2), z) / self.reference
        pick = self._pick(self.rows)
        return Multipliers(
            rows=self.rows,
            columns=self.columns,
            weight=weight,
            trace=trace / total,
            oil=oil / today,
            constant=float(
                np.einsum("nij,nij->", weight, self.fixed.slope[pick]) + oil.sum() * budget
            ),
            light=self.reference * float(np.einsum("nij,nij->", weight, self.fixed.mass[pick])),
            mixed=step.value - PENALTY * step.violation,
            mixture=step.change[: len(self.columns)],
        )

    def _step(self, inverse: Array, base: Array) -> ProgrammeStep:
        """The mixture of columns within the oil that has the greatest lowest ω².

        Shares ≥ 0 sum to one for each drive.
        """
        count, nd, (budget, today) = len(self.columns), len(self.drives), self.budget
        shapes = (COLUMNS, *base.shape), (nd, COLUMNS), (2, COLUMNS)
        slopes, whole, oil = (np.zeros(shape) for shape in shapes)
        across = inverse[:, :, self._place[self.columns.drive]]
        entries = self.diagonals(self.columns, self.rows)
        slopes[:count] = np.einsum("cn,nic,njc->cnij", entries, across, across)
        whole[self.columns.drive, np.arange(count)] = 1.0
        oil[:, :count] = -(self.columns.oil / today).T
        value = np.concatenate([[budget, budget], np.ones(nd), -np.ones(nd)])
        high = (np.arange(COLUMNS) < count).astype(float)
        one = programme(len(self.rows), base.shape[1], len(value), COLUMNS)
        return one.solve(
            base, slopes, value, np.concatenate([oil, -whole, whole]), np.zeros(COLUMNS), high
        )

    def _pick(self, rows: Array) -> tuple[Array, ...]:
        """Index of rows over the free coordinates, the others held."""
        return np.ix_(rows, np.array(self.free), np.array(self.free))

    @cached_property
    def free(self) -> list[int]:
        """Coordinates that are not held: of the drives, of motors, and the springs."""
        machine = self.problem.machine
        springs = range(len(machine.arm.joints), len(machine.arm.coordinates))
        driven = {d.joint for d in self.drives} | {joint for _, joint in motor_joints(machine)}
        return [*sorted(driven), *springs]

    @cached_property
    def _place(self) -> Array:
        """Place of each drive's joint among the free coordinates."""
        return np.array([self.free.index(d.joint) for d in self.drives])

    def scaled_bases(self, rows: Array) -> tuple[Array, Array]:
        """L⁻¹ over free coordinates (n, k, k) and L⁻¹ ∂g/∂q L⁻ᵀ over the reference."""
        pick = self._pick(rows)
        inverse = inverse_cholesky(self.loads.mass[pick])
        return inverse, congruent(inverse, self.loads.slope[pick]) / self.reference

    @cached_property
    def _watched_bases(self) -> tuple[Array, Array]:
        return self.scaled_bases(self.watched)

    def diagonals(self, columns: Columns, rows: Array) -> Array:
        """Entry k r² − g H/r of K (c, n) that each column makes at rows, over the reference."""
        entries = np.empty((len(columns), len(rows)))
        for k, d in enumerate(self.drives):
            own = np.flatnonzero(columns.drive == k)
            if len(own) == 0:
                continue
            angles, back = np.unique(d.angle[rows], return_inverse=True)
            b, (cap, annulus) = columns.place[own, :2], (both := columns.volume[own].T)
            e = d.shape.at(angles).enclose(b, b).centre
            place, rate, bend = (part.low[2 + back] for part in (e.place, e.rate, e.bend))
            beta = self.problem.machine.fluid.bulk_modulus
            gravity = self.loads.gravity[rows, d.joint] / d.partners
            stiff: Stiffening = (1.0, 1.0)
            if air := d.air(self.problem.machine, interval(gravity)):
                stiff = air.stiffening(interval(rate), both, both)
            dead = d.dead[0] + d.hoses[0] * stiff[0], d.dead[1] + d.hoses[1] * stiff[1]
            stroke = e.stroke * columns.place[own, 2]
            if structure := self._structure(d, interval(gravity), rows):
                place = place + structure.shift(interval(rate), stroke).low
            filled = cap * place + dead[0], annulus * (1 - place) + dead[1]
            oil = stiff[0] * cap**2 / filled[0] + stiff[1] * annulus**2 / filled[1]
            if structure:
                oil = oil * (1 - structure.yielding(oil, stroke.low))
            entries[own] = (beta * rate**2 * oil - gravity[:, None] * bend).T
        return entries / self.reference

    def _structure(self, drive: JointDrive, gravity: Interval, rows: Array) -> Structure | None:
        """Structure in series with a drive at rows under torques (n,) [N m]; None: rigid at all.

        Torques may begin with some that belong to no row.
        """
        if drive.compliance.max() == 0:
            return None
        each = np.maximum(drive.compliance[self.problem.dynamics.rows.corner[rows]], RIGID)
        each = np.pad(each, (len(gravity.low) - len(rows), 0), constant_values=RIGID)
        beta = self.problem.machine.fluid.bulk_modulus
        return Structure(each, beta, gravity * drive.shape.sign)

    # ---------------------------------------------------------------------------- rows and columns

    def _best_of_pool(self, multipliers: Multipliers) -> tuple[float, Columns]:
        """The bound by the pool's best designs, and the two best of each drive."""
        value = self.values(self.pool, multipliers)
        order = np.argsort(-value)
        best = [order[self.pool.drive[order] == k][:2] for k in range(len(self.drives))]
        return (
            multipliers.constant + float(sum(value[b[0]] for b in best if len(b) > 0)),
            self.pool[np.concatenate(best)],
        )

    def values(self, columns: Columns, multipliers: Multipliers) -> Array:
        """Each column's part (c,) of the upper bound."""
        used = np.flatnonzero(multipliers.trace > 0)
        weight, entries = multipliers.weight[used], self.diagonals(columns, multipliers.rows[used])
        own = np.diagonal(weight, axis1=1, axis2=2)[:, self._place[columns.drive]]
        stiff = self.reference * np.einsum("cn,nc->c", entries, own)
        return np.asarray(stiff - columns.oil @ multipliers.oil)

    def _take_rows(self, multipliers: Multipliers) -> float:
        """Replace rows of least weight by the mixture's lowest; returns its lowest ω²."""
        inverse, base = self._watched_bases
        columns = self.columns[counts := multipliers.mixture > NEGLIGIBLE]
        shared = multipliers.mixture[counts, None] * self.diagonals(columns, self.watched)
        of_drives = [shared[columns.drive == k].sum(axis=0) for k in range(len(self.drives))]
        across = inverse[:, :, self._place]
        mixed = base + (across * np.stack(of_drives, axis=1)[:, None]) @ across.swapaxes(1, 2)
        lowest = np.linalg.eigvalsh(mixed)[:, 0]
        worst = np.argsort(lowest)[:ENTERING]
        new = np.setdiff1d(self.watched[worst[lowest[worst] < multipliers.mixed]], self.rows)
        heaviest = self.rows[np.argsort(-multipliers.trace)]
        self.rows = np.concatenate([new, heaviest])[: len(self.rows)]
        return float(lowest.min())

    def _take(self, multipliers: Multipliers, new: Columns) -> None:
        """Add columns; where there are too many, the ones of least share go."""
        kept = np.argsort(-multipliers.mixture, kind="stable")[: COLUMNS - len(new)]
        self.columns = joined(self.columns[kept], new)

    def learn(self, multipliers: Multipliers, maxima: Sequence[Maximum]) -> None:
        """Take the best designs that branching found, and those around them into the pool."""
        random = np.random.default_rng(len(self.pool))
        self._take(
            multipliers,
            joined(*(column(k, self.drives[k], most.place) for k, most in enumerate(maxima))),
        )
        around = (columns_around(d, k, maxima[k].place, random) for k, d in enumerate(self.drives))
        self.pool = joined(self.pool, *around)

    # ----------------------------------------------------------------------------------- branching

    def terms(self, multipliers: Multipliers) -> list[CylinderTerm]:
        """Each drive's part of the upper bound at these multipliers."""
        return [self._term(multipliers, k) for k in range(len(self.drives))]

    def _term(self, multipliers: Multipliers, index: int) -> CylinderTerm:
        beta = self.problem.machine.fluid.bulk_modulus
        d, k = self.drives[index], self._place[index]
        own = np.flatnonzero(multipliers.weight[:, k, k] > 0)
        rows, given = multipliers.rows[own], multipliers.weight[own, k, k]
        torque = d.torque(self._gravity(rows)[:, d.joint])
        padded = torque.each(lambda end: np.pad(end, (2, 0)))
        air, structure = d.air(self.problem.machine, padded), self._structure(d, padded, rows)
        angles, back = np.unique(d.angle[rows], return_inverse=True)
        if air or structure:  # of one angle, other loads
            angles, back = d.angle[rows], np.arange(len(own))

        def summed(values: Array) -> Array:
            return np.bincount(back + 2, values, len(angles) + 2)

        return CylinderTerm(
            shape=d.shape.at(angles),
            limits=d.limits,
            weight=summed(beta * given),
            bend=torque.each(lambda end: summed(given * end)),
            price=multipliers.oil,
            dead=d.dead,
            hoses=d.hoses,
            air=air,
            structure=structure,
            own=dict(self._mass_terms(multipliers)).get(d.cylinder, (0.0, 0.0))[:2],
        )

    def _gravity(self, rows: Array) -> Interval:
        """Gravity torques (n, k) at rows, whatever the design [N m]."""
        total = interval(self.problem.dynamics.rows.gravity[rows])
        for bar in self.bars:
            total = total + bar.gravity(
                self.problem.workspace.rigid[self.problem.dynamics.rows.pose[rows]]
            )
        return total

    def _mass_terms(self, multipliers: Multipliers) -> list[tuple[int, tuple[float, ...]]]:
        """Most that own masses add to the upper bound [1/m²]."""
        size = len(self.problem.machine.arm.coordinates)
        weights = np.zeros((len(multipliers.rows), size, size))
        weights[:, np.array(self.free)[:, None], self.free] = multipliers.weight
        used = np.flatnonzero(multipliers.trace > 0)
        rigid = self.problem.workspace.rigid[
            self.problem.dynamics.rows.pose[multipliers.rows[used]]
        ]
        squared = self.near * self.reference
        return [(bar.cylinder, bar.most_added(rigid, weights[used], squared)) for bar in self.bars]

    def bound(self, multipliers: Multipliers, maxima: Sequence[Maximum]) -> float:
        """The upper bound on ω² over the reference by the maxima of all terms.

        Infinite where a maximum is not finite. That no design of a cylinder is allowed (−∞) counts
        as unknown too, since one allowed design is at hand.
        """
        driven = {d.cylinder for d in self.drives}
        mass_terms = [(i, added) for i, added in self._mass_terms(multipliers) if i not in driven]
        held = sum(
            bar.with_any_areas(added)
            for bar in self.bars
            for i, added in mass_terms
            if i == bar.cylinder
        )
        squared = (multipliers.constant + held + sum(m.upper for m in maxima)) / multipliers.light
        return max(self.near, squared) if math.isfinite(squared) else math.inf

    def maxima(self, multipliers: Multipliers, tolerance: float) -> list[Maximum]:
        """The most that each term can be, all together to within a tolerance."""
        return [self.maximum(multipliers, k, tolerance) for k in range(len(self.drives))]

    def maximum(
        self, multipliers: Multipliers, k: int, tolerance: float, begun: Maximum | None = None
    ) -> Maximum:
        """The most that the term of drive ``k`` can be, to within its part of a tolerance.

        From what has been ``begun`` at these multipliers, if anything. Of the tolerance a drive
        has the more, the more cells it took: their number is about the inverse of its part, so
        that parts as the roots of the numbers take least.
        """
        term, share = self._term(multipliers, k), np.sqrt(self.efforts)
        tolerance *= float(share[k] / share.sum())
        cells = CELLS if term.limits.drawn is None else DRAWN_CELLS
        if begun is None:
            known = joined(self.columns, self.pool)
            known = known[known.drive == k]
            best = np.argsort(-self.values(known, multipliers))[:TRIED]
            begun = first_look(term, known.place[best], self.covers[k])
        most = nearer(term, begun, tolerance, cells)
        self.efforts[k] = most.cells
        if len(most.leaves.bound) <= COVER:
            self.covers[k] = most.cover
        return most
