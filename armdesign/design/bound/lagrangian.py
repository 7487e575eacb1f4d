"""Prices that split the design problem into one small problem per cylinder, and what those say.

For any Z_j ⪰ 0 with Σ tr Z_j = 1 and prices μ ≥ 0 of the shared oil the lowest ω² over all rows
(poses and load cases) is at most, for every design x that the requirements allow,

    Σ_j ⟨Z_j, L_j⁻¹ K_j(x) L_j⁻ᵀ⟩ + μ·(budget − Σ_i v_i(x)),    M_j = L_j L_jᵀ.

Where a joint has a cylinder of its own, K_j is gravity's part, which no design changes, plus a
diagonal whose entry there, k r² − g H/r, depends on that cylinder alone. So the maximum over x
falls apart.

Own masses that depend on x: let λ0 ≥ 0 and M_j0 be inertia without them, Y_j = L_j⁻ᵀ Z_j L_j⁻¹.
Where λ(x) ≥ λ0,

    0 ≤ Σ_j ⟨Y_j, K_j(x) − λ M_j(x)⟩ ≤ Σ_j ⟨Y_j, K_j(x) − λ0 (M_j(x) − M_j0)⟩ − λ Σ_j ⟨Y_j, M_j0⟩,

so λ is at most λ0, or the largest first sum over the last. In it a cylinder's bars are worth so
much per area, like oil (``own_bounds``), but for their gravity in g H/r of the others, which is an
interval. Prices are sought with the masses of the design at hand.

Good Z and μ are the multipliers of a semidefinite programme that mixes known designs of each
cylinder; designs that are worth more at its prices join, until none is left (Dantzig and Wolfe,
Oper. Res. 8, 1960).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.branch_and_bound import Air, Maximum, Share, Stiffening, maximum
from armdesign.design.bound.cylinder_constraints import CylinderConstraints, cylinder_constraints
from armdesign.design.bound.cylinder_shape import Shape, coordinates, shape_of
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.program.constraints import CONSTRAINT_TOLERANCE
from armdesign.design.program.dynamics import Rows
from armdesign.design.program.problem import Problem
from armdesign.design.search.semidefinite import Step, programme

ROWS, COLUMNS = 36, 72  # of every programme, so that it is set up once
ENTERING = 8  # rows that join at a time
SAMPLES = 4000  # designs of each cylinder drawn at first, of which
KEPT = 400  # allowed ones at most are kept
NEAR, SPREAD = 80, 0.03  # designs around a good one, within a share of the region
ROUNDS = 15  # of programmes before branching
AGREED = 2e-3  # of ω² where they end
NEGLIGIBLE = 1e-5  # of the weight of all rows
BOXES, AIRY = 100_000, 20_000  # branched per cylinder, without and with air in the oil


@dataclass(frozen=True, eq=False, kw_only=True)
class Drive:
    """A cylinder with the joint that it alone drives: shape at all angles of the workspace, that of each row."""

    cylinder: int
    joint: int
    shape: Shape
    angle: Array  # (rows,) index into the shape's angles
    limits: CylinderConstraints
    dead: Array  # (2,) dead volumes of oil [m³]
    hoses: Array  # (2,) what hoses add, as oil without air [m³]


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Designs of single cylinders: index of the drive (c,), b and scale (c, 3), swept volumes (c, 2) [m³]."""

    drive: Array
    design: Array
    volume: Array

    def __getitem__(self, rows: Array) -> Columns:
        return Columns(drive=self.drive[rows], design=self.design[rows], volume=self.volume[rows])

    def __len__(self) -> int:
        return len(self.drive)


@dataclass(frozen=True, eq=False, kw_only=True)
class Prices:
    """Multipliers of one programme, ω² in units of the reference.

    Attributes:
        rows: the rows that it had (n,).
        weight: L⁻ᵀ Z L⁻¹ (n, nd, nd) over the drives' joints and the reference.
        trace: of each Z (n,).
        oil: μ of both sides (2,) [1/m³].
        constant: the part of the upper bound that no design changes.
        light: Σ ⟨Z, L⁻¹M0 L⁻ᵀ⟩ of the inertia that no design changes, 1 where that is all.
        mixed: the best of mixtures.
        shares: how much of each column it takes (c,).
    """

    rows: Array
    weight: Array
    trace: Array
    oil: Array
    constant: float
    light: float
    mixed: float
    shares: Array


def drives(problem: Problem, bars: Sequence[BarEnclosure] = ()) -> tuple[Drive, ...]:
    """The cylinders that drive one joint alone and whose pins vary in a way that ``shapes`` knows."""
    machine, found = problem.machine, []
    for i, (linkage, cylinder) in enumerate(zip(machine.linkages, machine.cylinders, strict=True)):
        shared = any(
            set(linkage.joints) & set(other.joints)
            for other in machine.drives
            if other is not linkage
        )
        limits = (
            None if shared or cylinder.compliance > 0 else cylinder_constraints(problem, i, bars)
        )
        if limits is None:
            continue
        joint = linkage.joints[0]
        angles, index = np.unique(
            problem.workspace.q[problem.dynamics.rows.pose, joint], return_inverse=True
        )
        shape = shape_of(problem, i, angles)
        assert shape is not None
        hoses = (
            np.array([cylinder.cap_hose_volume, cylinder.annulus_hose_volume])
            / cylinder.hose_modulus
        )
        dead = np.array([cylinder.cap_dead_volume, cylinder.annulus_dead_volume])
        hoses = hoses * machine.fluid.bulk_modulus
        found.append(
            Drive(
                cylinder=i,
                joint=joint,
                shape=shape,
                angle=index,
                limits=limits,
                dead=dead,
                hoses=hoses,
            )
        )
    return tuple(found)


@dataclass(eq=False)
class Dual:
    """The search for prices: rows and columns of the programme, and a pool of designs that may become columns."""

    problem: Problem
    drives: tuple[Drive, ...]
    bars: Sequence[BarEnclosure]  # own masses that depend on x
    loads: Rows  # all rows, own masses those of one design
    # λ0: that design's lowest ω² where own masses depend on x, else 0, over the reference
    near: float
    watched: Array  # rows that may enter
    reference: float  # [rad²/s²]
    rows: Array
    columns: Columns
    pool: Columns

    @classmethod
    def begun(
        cls,
        problem: Problem,
        some: tuple[Drive, ...],
        x: Array,
        watched: Array,
        bars: Sequence[BarEnclosure] = (),
    ) -> Dual:
        """From the design x, its lowest rows, and random designs."""
        random = np.random.default_rng(0)
        squared = problem.dynamics.omega_squared(x, watched)
        stroke = problem.vector.strokes(x)[1]
        chosen = [d.cylinder for d in some]
        columns = Columns(
            drive=np.arange(len(some)),
            design=np.array([coordinates(problem, d.cylinder, d.shape, x) for d in some]),
            volume=(problem.vector.areas(x) * stroke[:, None])[chosen],
        )
        pool = _around(some, columns.design, random)
        for k, drive in enumerate(some):
            low, high = drive.shape.region
            pool = _joined(pool, _allowed(drive, k, random.uniform(low, high, (SAMPLES, 3))))
        reference = max(float(squared.min()), problem.dynamics.omega_squared_scale)
        mass, gravity, slope = problem.dynamics.inertia_and_gravity(
            x, problem.dynamics.rows, np.arange(len(problem.dynamics.rows))
        )
        loads = replace(problem.dynamics.rows, mass=mass, gravity=gravity, slope=slope)
        near = max(float(squared.min()), 0.0) / reference if bars else 0.0
        rows = watched[np.argsort(squared)[:ROWS]]
        return cls(problem, some, bars, loads, near, watched, reference, rows, columns, pool)

    @cached_property
    def _budget(self) -> tuple[float, Array]:
        """Oil that may be swept, over today's; and today's (2,) [m³]."""
        strokes = np.array([c.stroke for c in self.problem.machine.cylinders])
        swept = strokes @ self.problem.vector.areas_today[: len(strokes)]
        return self.problem.requirements.oil_total_share * (1 + CONSTRAINT_TOLERANCE), swept

    # ---------------------------------------------------------------------------------- programmes

    def settled(self) -> Prices:
        """Prices at which no design of the pool and no watched row is worth much more than the programme knows."""
        for _ in range(ROUNDS):
            prices = self.prices()
            worth, best = self._best_of_pool(prices)
            lowest = self._take_rows(prices)
            if worth < prices.mixed + AGREED and lowest > prices.mixed - AGREED:
                break
            self._take(prices, best)
        return prices

    def prices(self) -> Prices:
        """Solve the programme over the rows and columns at hand."""
        inverse, base = self._frames(self.rows)
        step = self._step(inverse, base)
        size, vectors = np.linalg.eigh((step.weights + np.swapaxes(step.weights, 1, 2)) / 2)
        z = vectors @ (np.maximum(size, 0.0)[:, :, None] * np.swapaxes(vectors, 1, 2))
        trace = np.trace(z, axis1=1, axis2=2)
        z[trace < NEGLIGIBLE * trace.sum()] = 0.0
        total = np.trace(z, axis1=1, axis2=2).sum()
        z, oil = z / total, step.multipliers[:2] / total
        budget, today = self._budget
        weight = np.swapaxes(inverse, 1, 2) @ z @ inverse / self.reference
        pick = self._pick(self.rows)
        return Prices(
            rows=self.rows,
            weight=weight,
            trace=trace / total,
            oil=oil / today,
            constant=float(
                np.einsum("nij,nij->", weight, self.problem.dynamics.rows.slope[pick])
                + oil.sum() * budget
            ),
            light=self.reference
            * float(np.einsum("nij,nij->", weight, self.problem.dynamics.rows.mass[pick])),
            mixed=step.value - step.violation,
            shares=step.change[: len(self.columns)],
        )

    def _step(self, inverse: Array, base: Array) -> Step:
        """Mixtures of columns (shares ≥ 0 that sum to one for each drive) within the oil, of the greatest lowest ω²."""
        count, nd, (budget, today) = len(self.columns), len(self.drives), self._budget
        slopes, whole, oil = (
            np.zeros((COLUMNS, *base.shape)),
            np.zeros((nd, COLUMNS)),
            np.zeros((2, COLUMNS)),
        )
        slopes[:count] = self._matrices(inverse, self.rows)
        whole[self.columns.drive, np.arange(count)] = 1.0
        oil[:, :count] = -(self.columns.volume / today).T
        value = np.concatenate([[budget, budget], np.ones(nd), -np.ones(nd)])
        high = (np.arange(COLUMNS) < count).astype(float)
        one = programme(len(self.rows), nd, len(value), COLUMNS)
        return one.solve(
            base, slopes, value, np.concatenate([oil, -whole, whole]), np.zeros(COLUMNS), high
        )

    def _pick(self, rows: Array) -> tuple[Array, ...]:
        """Index of rows over the drives' joints, the other joints held."""
        joints = np.array([d.joint for d in self.drives])
        return np.ix_(rows, joints, joints)

    def _frames(self, rows: Array) -> tuple[Array, Array]:
        """L⁻¹ over the drives' joints (n, nd, nd) and L⁻¹ ∂g/∂q L⁻ᵀ over the reference."""
        pick = self._pick(rows)
        inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(self.loads.mass[pick])))
        return (
            inverse,
            inverse @ self.loads.slope[pick] @ np.swapaxes(inverse, 1, 2) / self.reference,
        )

    def _matrices(self, inverse: Array, rows: Array) -> Array:
        """What each column adds to L⁻¹ K L⁻ᵀ at rows (c, n, nd, nd)."""
        across = inverse[:, :, self.columns.drive]
        return np.einsum("cn,nic,njc->cnij", self._diagonals(self.columns, rows), across, across)

    def _diagonals(self, columns: Columns, rows: Array) -> Array:
        """Entry k r² − g H/r of K (c, n) that each column makes at rows, over the reference."""
        found = np.empty((len(columns), len(rows)))
        for k, d in enumerate(self.drives):
            mine = np.flatnonzero(columns.drive == k)
            angles, back = np.unique(d.angle[rows], return_inverse=True)
            b, (cap, annulus) = columns.design[mine, :2], columns.volume[mine].T[:, :, None]
            e = d.shape.at(angles).enclose(b, b).centre
            place, rate, bend = (part.low[:, 2:][:, back] for part in (e.place, e.rate, e.bend))
            beta, gravity = (
                self.problem.machine.fluid.bulk_modulus,
                self.loads.gravity[rows, d.joint],
            )
            stiff: Stiffening = (1.0, 1.0)
            if air := self._air(d, interval(gravity)):
                both = columns.volume[mine]
                cap_side, annulus_side = air.stiffening(np.abs(rate), both, both)
                stiff = cap_side[:, 0], annulus_side[:, 0]
            dead = d.dead[0] + d.hoses[0] * stiff[0], d.dead[1] + d.hoses[1] * stiff[1]
            filled = cap * place + dead[0], annulus * (1 - place) + dead[1]
            oil = stiff[0] * cap**2 / filled[0] + stiff[1] * annulus**2 / filled[1]
            found[mine] = beta * rate**2 * oil - gravity * bend
        return found / self.reference

    def _air(self, drive: Drive, gravity: Interval) -> Air | None:
        """What air makes of a drive's oil under torques (n,) [N m]; None without air."""
        fluid, sign = self.problem.machine.fluid, drive.shape.sign
        if fluid.air == 0:
            return None
        machine, turned = self.problem.machine, gravity * sign
        back = machine.cylinders[drive.cylinder].preload(
            machine.supply.return_pressure
        )  # reliefs make it but less
        return Air(
            fluid=fluid,
            back=back,
            push=np.maximum(turned.high, 0.0),
            pull=np.maximum(-turned.low, 0.0),
        )

    # ---------------------------------------------------------------------------- rows and columns

    def _best_of_pool(self, prices: Prices) -> tuple[float, Columns]:
        """What the pool's best designs at these prices come to, and the two best of each drive."""
        entries = self._diagonals(self.pool, prices.rows) * self.reference
        own = np.diagonal(prices.weight, axis1=1, axis2=2)
        value = (
            np.einsum("cn,nc->c", entries, own[:, self.pool.drive]) - self.pool.volume @ prices.oil
        )
        order = np.argsort(-value)
        best = [order[self.pool.drive[order] == k][:2] for k in range(len(self.drives))]
        return (
            prices.constant + float(sum(value[b[0]] for b in best if len(b) > 0)),
            self.pool[np.concatenate(best)],
        )

    def _take_rows(self, prices: Prices) -> float:
        """Let the rows enter at which the mixture is lowest, for those of least weight.

        And how low that is.
        """
        inverse, base = self._frames(self.watched)
        mixed = base + np.einsum(
            "c,cnij->nij", prices.shares, self._matrices(inverse, self.watched)
        )
        lowest = np.linalg.eigvalsh(mixed)[:, 0]
        worst = np.argsort(lowest)[:ENTERING]
        new = np.setdiff1d(self.watched[worst[lowest[worst] < prices.mixed]], self.rows)
        self.rows = np.concatenate([new, self.rows[np.argsort(-prices.trace)]])[: len(self.rows)]
        return float(lowest.min())

    def _take(self, prices: Prices, new: Columns) -> None:
        """New columns, for those of least share where there are too many."""
        kept = np.argsort(-prices.shares, kind="stable")[: COLUMNS - len(new)]
        self.columns = _joined(self.columns[kept], new)

    def learn(self, prices: Prices, maxima: Sequence[Maximum]) -> None:
        """Take the best designs that branching found, and those around them into the pool."""
        design, volume = np.array([m.design for m in maxima]), np.array([m.volume for m in maxima])
        self._take(prices, Columns(drive=np.arange(len(maxima)), design=design, volume=volume))
        self.pool = _joined(
            self.pool, _around(self.drives, design, np.random.default_rng(len(self.pool)))
        )

    # ----------------------------------------------------------------------------------- branching

    def shares(self, prices: Prices) -> list[Share]:
        """Each drive's part of the upper bound at these prices."""
        found, beta = [], self.problem.machine.fluid.bulk_modulus
        gravity, worths = self._gravity(prices.rows), dict(self._worths(prices))
        for k, d in enumerate(self.drives):
            own = np.flatnonzero(prices.weight[:, k, k] > 0)
            given = prices.weight[own, k, k]
            torque = gravity[own, d.joint]
            angles, back = np.unique(d.angle[prices.rows[own]], return_inverse=True)
            if air := self._air(
                d, Interval(np.pad(torque.low, (2, 0)), np.pad(torque.high, (2, 0)))
            ):
                angles, back = (
                    d.angle[prices.rows[own]],
                    np.arange(len(own)),
                )  # of one angle, other loads
            weight, least, most = np.zeros((3, len(angles) + 2))
            np.add.at(weight, back + 2, beta * given)
            np.add.at(least, back + 2, given * torque.low)
            np.add.at(most, back + 2, given * torque.high)
            found.append(
                Share(
                    shape=d.shape.at(angles),
                    limits=d.limits,
                    weight=weight,
                    bend=Interval(least, most),
                    price=prices.oil,
                    dead=d.dead,
                    hoses=d.hoses,
                    air=air,
                    own=worths.get(d.cylinder, (0.0, 0.0))[:2],
                )
            )
        return found

    def _gravity(self, rows: Array) -> Interval:
        """Gravity torques (n, nq) at rows, whatever the design [N m]."""
        total = interval(self.problem.dynamics.rows.gravity[rows])
        for bar in self.bars:
            total = total + bar.gravity(
                self.problem.workspace.rigid[self.problem.dynamics.rows.pose[rows]]
            )
        return total

    def _worths(self, prices: Prices) -> list[tuple[int, tuple[float, ...]]]:
        """What own masses add to the upper bound at most, as in ``BarEnclosure.worth`` [1/m²]."""
        nq, joints = len(self.problem.machine.joints), np.array([d.joint for d in self.drives])
        weights = np.zeros((len(prices.rows), nq, nq))
        weights[:, joints[:, None], joints] = prices.weight
        used = np.flatnonzero(prices.trace > 0)
        rigid = self.problem.workspace.rigid[self.problem.dynamics.rows.pose[prices.rows[used]]]
        squared = self.near * self.reference
        return [(bar.cylinder, bar.worth(rigid, weights[used], squared)) for bar in self.bars]

    def bounded(self, prices: Prices, maxima: Sequence[Maximum]) -> float:
        """The upper bound on ω², over the reference, that prices and the most of every share give.

        Infinite where a share has none, or no design at all: one is at hand, so something is not
        known.
        """
        driven = {d.cylinder for d in self.drives}
        worths = [(i, worth) for i, worth in self._worths(prices) if i not in driven]
        held = sum(
            bar.most(worth) for bar in self.bars for i, worth in worths if i == bar.cylinder
        )
        found = (prices.constant + held + sum(m.upper for m in maxima)) / prices.light
        return max(self.near, found) if math.isfinite(found) else math.inf

    def branched(self, prices: Prices, tolerance: float) -> list[Maximum]:
        """The most that each share can be, all together to within a tolerance [of the reference]."""
        each = tolerance / len(self.drives)
        return [
            maximum(share, each, AIRY if share.air else BOXES) for share in self.shares(prices)
        ]


def _joined(some: Columns, more: Columns) -> Columns:
    return Columns(
        drive=np.concatenate([some.drive, more.drive]),
        design=np.concatenate([some.design, more.design]),
        volume=np.concatenate([some.volume, more.volume]),
    )


def _allowed(drive: Drive, k: int, designs: Array) -> Columns:
    """Columns of the designs (m, 3) that are allowed, each with some choices of swept volumes."""
    kept, _, volume = drive.limits.allowed(designs, designs)
    kept, volume = kept[:KEPT], volume[:KEPT]
    choices = volume.shape[1]
    return Columns(
        drive=np.full(choices * len(kept), k),
        design=np.repeat(designs[kept], choices, axis=0),
        volume=volume.reshape(-1, 2),
    )


def _around(some: tuple[Drive, ...], designs: Array, random: np.random.Generator) -> Columns:
    """Columns at and around one design (nd, 3) of each drive."""
    found = Columns(drive=np.empty(0, dtype=int), design=np.empty((0, 3)), volume=np.empty((0, 2)))
    for k, drive in enumerate(some):
        low, high = drive.shape.region
        steps = random.normal(size=(NEAR, 3)) * random.uniform(0, SPREAD, (NEAR, 1)) * (high - low)
        near = np.clip(designs[k] + np.vstack([np.zeros(3), steps]), low, high)
        found = _joined(found, _allowed(drive, k, near))
    return found
