"""An upper bound on the worst frequency that no pins and areas can exceed, by Lagrangian duality.

For any Z_j ⪰ 0 with Σ tr Z_j = 1 and prices μ ≥ 0 of the shared oil the lowest ω² over all rows (poses and load cases) is
at most, for every design x that the requirements allow,

    Σ_j ⟨Z_j, L_j⁻¹ K_j(x) L_j⁻ᵀ⟩ + μ·(budget − Σ_i v_i(x)),    M_j = L_j L_jᵀ.

Where every cylinder drives a joint of its own, K_j is gravity's part, which no design changes, plus a diagonal whose
entry k r² − g H/r hangs on that joint's cylinder alone. So the maximum over x falls apart into one small problem per
cylinder under its own requirements, each enclosed from above by branch and bound (``branching``). A subset of the rows and
of the joints (the others held, which only stiffens) keeps all this valid.

Z and μ come from semidefinite programmes over mixtures of known designs, to which the best answers of the small
problems are added until nothing is gained (Dantzig and Wolfe 1960). Whatever the solver does, each round gives a bound.
What remains of the gap is duality's: mixtures are more than designs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.branching import Maximum, Share, maximum
from armdesign.design.own_limits import SLACK, OwnLimits, own_limits
from armdesign.design.problem import Problem
from armdesign.design.shapes import Shape, coordinates, shape_of
from armdesign.design.sizing import Step, programme
from armdesign.errors import InfeasibleError

ROUNDING = 1e-9  # relative, for what floating point may lose
ROWS, COLUMNS = 36, 72  # of every programme, so that it is set up once
SAMPLES = 4000  # designs tried per cylinder before any branching
ROUNDS = 30  # of programmes without branching,
BRANCHED = 5  # and with it
CLOSE = 4e-3  # of ω² where rounds end
BOXES = 12_000  # per cylinder and round
NEGLIGIBLE = 1e-5  # of the weight of all rows


@dataclass(frozen=True, eq=False, kw_only=True)
class Bound:
    """No design exceeds ``frequency`` [Hz] under the ``assumptions``; ``held`` are cylinders taken as rigid."""

    frequency: float
    held: tuple[str, ...]
    assumptions: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Actor:
    """A cylinder in the bound: its joint, its shape at all angles of the workspace, the angle of each row, limits."""

    cylinder: int
    joint: int
    shape: Shape
    angle: Array  # (rows,) index among the shape's angles after its two ends
    limits: OwnLimits
    dead: Array  # (2,) dead volumes, hoses as oil [m³]
    beta: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """Designs of single cylinders: which actor (c,), b and scale (c, 3), swept volumes (c, 2)."""

    actor: Array
    design: Array
    volume: Array

    def __getitem__(self, rows: Array) -> Columns:
        return Columns(actor=self.actor[rows], design=self.design[rows], volume=self.volume[rows])

    def __add__(self, other: Columns) -> Columns:
        return Columns(
            actor=np.concatenate([self.actor, other.actor]),
            design=np.concatenate([self.design, other.design]),
            volume=np.concatenate([self.volume, other.volume]),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Prices:
    """What a programme says: weight of every row at each actor's joint (n, na), prices of oil (2,) [1/m³], the rest.

    ``constant`` is the bound's part that no design changes, ``mixed`` the best of mixtures, ``shares`` (c,) how they mix
    the columns, ``trace`` (n,) the weight of each row. ω² in units of the reference.
    """

    weight: Array
    oil: Array
    constant: float
    mixed: float
    shares: Array
    trace: Array


@dataclass(eq=False)
class Dual:
    """The search for good prices: chosen rows and columns, and the actors."""

    problem: Problem
    actors: tuple[Actor, ...]
    watched: Array
    reference: float
    rows: Array
    columns: Columns
    pool: Columns = field(init=False)

    def __post_init__(self) -> None:
        self.joints = np.array([a.joint for a in self.actors])
        machine = self.problem.machine
        self.today = (self.problem.areas_today * np.array([c.stroke for c in machine.cylinders])[:, None]).sum(axis=0)
        self.budget = self.problem.requirements.oil_total_share * (1 + SLACK)
        self.pool = self._sampled()

    # frames
    def frames(self, rows: Array) -> tuple[Array, Array]:
        """L⁻¹ (n, na, na) of rows over the actors' joints, and gravity's L⁻¹ ∂g/∂q L⁻ᵀ."""
        pick = np.ix_(rows, self.joints, self.joints)
        inverse = np.linalg.inv(np.linalg.cholesky(self.problem.rows.mass[pick]))
        base = inverse @ self.problem.rows.slope[pick] @ np.swapaxes(inverse, 1, 2)
        return inverse, base / self.reference

    def diagonals(self, columns: Columns, rows: Array) -> Array:
        """Diagonal entry of K (c, n) that every column makes at rows, over the reference."""
        found = np.empty((len(columns.actor), len(rows)))
        for k, a in enumerate(self.actors):
            mine = np.flatnonzero(columns.actor == k)
            angles, back = np.unique(a.angle[rows], return_inverse=True)
            b = columns.design[mine, :2]
            e = a.shape.at(angles).enclose(b, b)
            place, rate, bend = (part.low[:, 2:][:, back] for part in (e.place, e.rate, e.bend))
            cap, annulus = columns.volume[mine, :1], columns.volume[mine, 1:]
            oil = cap**2 / (cap * place + a.dead[0]) + annulus**2 / (annulus * (1 - place) + a.dead[1])
            found[mine] = a.beta * rate**2 * oil - self.problem.rows.gravity[rows, a.joint] * bend
        return found / self.reference

    def prices(self) -> Prices:
        inverse, base = self.frames(self.rows)
        step, slopes = self._step(inverse, base)
        size, vectors = np.linalg.eigh((step.weights + np.swapaxes(step.weights, 1, 2)) / 2)
        z = vectors @ (np.maximum(size, 0.0)[:, :, None] * np.swapaxes(vectors, 1, 2))
        trace = np.trace(z, axis1=1, axis2=2)
        z[trace < NEGLIGIBLE * trace.sum()] = 0.0
        total = np.trace(z, axis1=1, axis2=2).sum()
        oil = step.multipliers[:2] / total
        z = z / total
        return Prices(
            weight=np.einsum("nik,nij,njk->nk", inverse, z, inverse) / self.reference,
            oil=oil / self.today,
            constant=float(np.einsum("nij,nij->", z, base) + oil.sum() * self.budget),
            mixed=step.value - step.violation,
            shares=step.change[: len(self.columns.actor)],
            trace=trace / total,
        )
    def _step(self, inverse, base):
        c, na = len(self.columns.actor), len(self.actors)
        across = inverse[:, :, self.columns.actor]
        slopes = np.zeros((COLUMNS, *base.shape))
        slopes[:c] = np.einsum("cn,nic,njc->cnij", self.diagonals(self.columns, self.rows), across, across)
        one = np.zeros((na, COLUMNS)); one[self.columns.actor, np.arange(c)] = 1.0
        oil = np.zeros((2, COLUMNS)); oil[:, :c] = -(self.columns.volume / self.today).T
        value = np.concatenate([[self.budget, self.budget], np.ones(na), -np.ones(na)])
        high = np.zeros(COLUMNS); high[:c] = 1.0
        shape = (len(self.rows), na, len(value), COLUMNS)
        return programme(*shape).solve(base, slopes, value, np.concatenate([oil, -one, one]), np.zeros(COLUMNS), high), slopes

    def refresh_rows(self, prices):
        inverse, base = self.frames(self.watched)
        across = inverse[:, :, self.columns.actor]
        d = self.diagonals(self.columns, self.watched) * prices.shares[:, None]
        mixed = base + np.einsum("cn,nic,njc->nij", d, across, across, optimize=True)
        lowest = np.linalg.eigvalsh(mixed)[:, 0]
        self.lowest = lowest.min()
        order = self.watched[np.argsort(lowest)[:ROWS]]
        worse = [r for r in order if r not in self.rows][:8]
        worse = [r for r in worse if lowest[np.searchsorted(self.watched, r)] < prices.mixed - 1e-5]
        keep = self.rows[np.argsort(-prices.trace)][: ROWS - len(worse)]
        self.rows = np.concatenate([keep, np.array(worse, dtype=int)])

    def trim_columns(self, prices, new):
        order = np.argsort(-prices.shares, kind="stable")
        used = prices.shares > 1e-7
        idle = np.flatnonzero(~used)
        keep = np.sort(np.concatenate([np.flatnonzero(used), idle[-(COLUMNS - used.sum() - len(new.actor)):] if COLUMNS - used.sum() - len(new.actor) > 0 else idle[:0]]))
        self.columns = self.columns[keep] + new

    def _sampled(self):
        rng = np.random.default_rng(0)
        parts = []
        for k, a in enumerate(self.actors):
            low, high = np.append(a.shape.low, a.shape.scale[0]), np.append(a.shape.high, a.shape.scale[1])
            x = rng.uniform(low, high, (SAMPLES, 3))
            kept, scale, v = a.limits.allowed(x, x)
            kept, v = kept[:400], v[:400]
            parts.append(Columns(actor=np.full(5 * len(kept), k), design=np.repeat(x[kept], 5, axis=0), volume=v.reshape(-1, 2)))
        whole = parts[0]
        for p in parts[1:]:
            whole = whole + p
        return whole

    def best_of_pool(self, prices, few=2):
        d = self.diagonals(self.pool, self.rows) * self.reference
        value = np.einsum("cn,nc->c", d, prices.weight[:, self.pool.actor]) - self.pool.volume @ prices.oil
        chosen = []
        best = 0
        for k in range(len(self.actors)):
            mine = np.flatnonzero(self.pool.actor == k)
            if len(mine):
                o = mine[np.argsort(-value[mine])]
                best += value[o[0]]
                chosen += list(o[:few])
        return prices.constant + best, self.pool[np.array(chosen)]

    def branch(self, prices, tolerance, boxes):
        out = []
        for k, a in enumerate(self.actors):
            rows = np.flatnonzero(prices.weight[:, k] > 0)
            angles, back = np.unique(a.angle[self.rows[rows]], return_inverse=True)
            weight, bend = np.zeros(len(angles) + 2), np.zeros(len(angles) + 2)
            np.add.at(weight, back + 2, a.beta * prices.weight[rows, k])
            np.add.at(bend, back + 2, prices.weight[rows, k] * self.problem.rows.gravity[self.rows[rows], a.joint])
            sh = Share(shape=a.shape.at(angles), limits=a.limits, weight=weight, bend=bend, price=prices.oil, dead=a.dead)
            out.append(maximum(sh, tolerance, boxes))
        return out


def actor(problem: Problem, i: int) -> Actor | None:
    limits = own_limits(problem, i)
    if limits is None: return None
    linkage, machine, cylinder = problem.machine.linkages[i], problem.machine, problem.machine.cylinders[i]
    joint = linkage.joints[0]
    angles, index = np.unique(problem.workspace.q[problem.rows.pose, joint], return_inverse=True)
    shape = shape_of(problem, i, angles)
    hoses = np.array([cylinder.cap_hose_volume, cylinder.annulus_hose_volume])
    dead = np.array([cylinder.cap_dead_volume, cylinder.annulus_dead_volume])
    return Actor(cylinder=i, joint=joint, shape=shape, angle=index + 2, limits=limits,
                 dead=dead + hoses * machine.fluid.bulk_modulus / cylinder.hose_modulus, beta=machine.fluid.bulk_modulus)
