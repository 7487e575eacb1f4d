"""Semidefinite programmes of the design: the only door to Clarabel.

Both forms maximise λ subject to  A_j + Σ x_v B_jv − λ I ⪰ 0  for some poses j and  c + C x ≥ 0,
low ≤ x ≤ high, where A and B are L⁻¹K L⁻ᵀ and its slopes, so that λ is the lowest ω² over a
reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import InfeasibleError

PENALTY = 100.0  # of λ per unit of violated constraint, in a step from an infeasible x
# share by which a bound may lie below a design that misses requirements by as little as is allowed
MISSED_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class ProgrammeStep:
    """Answer of one programme: change of x, λ foreseen, and multipliers."""

    change: Array  # (nx,)
    value: float
    violation: float  # sum of what had to be given up on the constraints
    multipliers: Array  # (m,) of c + C x ≥ 0
    low_multipliers: Array  # (nx,)
    high_multipliers: Array  # (nx,)
    weights: Array  # (n, nq, nq) of the matrix inequalities


def best_step(
    base: Array, slopes: Array, value: Array, jacobian: Array, low: Array, high: Array
) -> ProgrammeStep:
    """The programme with matrices ``base`` (n, nq, nq) and ``slopes`` (nx, n, nq, nq), solved.

    Constraints may be violated at a price, so that a step from an infeasible x exists. Entries of
    x whose ends are one are no variables of the programme.

    Raises:
        InfeasibleError: data that are not finite, as at a dead centre; the solver gave up.
    """
    if not all(np.isfinite(part).all() for part in (base, slopes, value, jacobian)):
        fault = "stiffness or a requirement is not finite here"
        raise InfeasibleError("design step", fault, "start elsewhere")
    free, change = high > low, low.astype(float)
    held = np.where(free, 0.0, low)
    level = _levelled(base)
    turned, nq = np.swapaxes(level, 1, 2), base.shape[1]
    base_here = base + np.einsum("v,vnij->nij", held, slopes)
    parts = (base_here, np.eye(nq), slopes[free])
    triangles = (_triangles(level @ matrices @ turned) for matrices in parts)
    cone = Cone(nq, *triangles)
    room = value + jacobian @ held
    x, price, dual = cone.solve(room, jacobian[:, free], low[free], high[free])
    k, m = int(free.sum()), len(value)
    change[free] = np.clip(x[:k], low[free], high[free])
    of_limits, _, of_low, of_high = np.split(dual, [m, 2 * m, 2 * m + k])
    multipliers = np.maximum(of_limits, 0.0)
    weights = turned @ _matrices(price, nq) @ level
    pull = np.einsum("nij,vnij->v", weights, slopes) + multipliers @ jacobian
    ends = np.maximum(-pull, 0.0), np.maximum(pull, 0.0)  # of entries that are held
    ends[0][free], ends[1][free] = of_low, of_high
    return ProgrammeStep(
        change=change,
        value=float(x[k]),
        violation=float(x[k + 1 :].sum()),
        multipliers=multipliers,
        low_multipliers=ends[0],
        high_multipliers=ends[1],
        weights=weights,
    )


@dataclass(frozen=True, eq=False)
class Cone:
    """Matrix inequalities base + slopes·x − λ unit ⪰ 0 of nq rows each, as Clarabel takes them.

    Triangles lie one after the other, off-diagonal entries times √2: (e,), (e,), (e, k).
    """

    nq: int
    base: Array
    unit: Array
    slopes: Array

    def solve(
        self, value: Array, jacobian: Array, low: Array, high: Array
    ) -> tuple[Array, Array, Array]:
        """Maximise λ less the price of excess e ≥ 0, value + jacobian·x + e ≥ 0, low ≤ x ≤ high.

        Returns:
            x, λ and e in a row; multipliers of the triangles, and of the rest.
        """
        import clarabel
        from scipy.sparse import block_array, csc_array, eye_array

        m, k = jacobian.shape
        excess, box = -eye_array(m), eye_array(k)
        rows = [
            [csc_array(-self.slopes), csc_array(self.unit[:, None]), None],
            [csc_array(-jacobian), None, excess],
            [None, None, excess],
            [-box, None, None],
            [box, None, None],
        ]
        right = np.concatenate([self.base, value, np.zeros(m), -low, high])
        cost = np.concatenate([np.zeros(k), [-1.0], np.full(m, PENALTY)])
        count, entries = len(self.base) // len(_pairs(self.nq)[0]), len(self.base)
        cones = [clarabel.PSDTriangleConeT(self.nq)] * count
        cones.append(clarabel.NonnegativeConeT(len(right) - entries))
        settings = clarabel.DefaultSettings()
        settings.verbose = settings.chordal_decomposition_enable = False
        nothing = csc_array((len(cost), len(cost)))
        whole = block_array(rows, format="csc")
        answer = clarabel.DefaultSolver(nothing, cost, whole, right, cones, settings).solve()
        if str(answer.status) not in ("Solved", "AlmostSolved"):
            # "almost": every step is judged by its true objective
            fault = f"the solver gave up ({answer.status})"
            raise InfeasibleError("design step", fault, "loosen the requirements")
        dual = np.array(answer.z)
        return np.array(answer.x), dual[:entries], dual[entries:]


@lru_cache(maxsize=8)
def _pairs(nq: int) -> tuple[Array, Array, Array]:
    """Rows and columns of a triangle's entries, column by column, and the factor of each."""
    columns, rows = np.tril_indices(nq)
    return rows, columns, np.where(rows == columns, 1.0, math.sqrt(2))


def _triangles(matrices: Array) -> Array:
    """Triangles of matrices (n, nq, nq) in a row (e,); of several stacks side by side (e, k)."""
    rows, columns, factor = _pairs(matrices.shape[-1])
    entries = matrices[..., rows, columns] * factor
    if entries.ndim == 2:
        return np.asarray(entries.ravel())
    count, *size = entries.shape
    return np.asarray(entries.reshape(count, math.prod(size)).T)


def _matrices(triangles: Array, nq: int) -> Array:
    """The matrices (n, nq, nq) of triangles in a row."""
    rows, columns, factor = _pairs(nq)
    entries = triangles.reshape(-1, len(rows)) / factor
    matrices = np.empty((len(entries), nq, nq))
    matrices[:, rows, columns] = matrices[:, columns, rows] = entries
    return matrices


def _levelled(base: Array) -> Array:
    """A congruence T for each A, so that T A Tᵀ has no large entries (stiff modes: 10⁵ ×)."""
    size, vectors = np.linalg.eigh(base)
    scaled = vectors / np.sqrt(np.maximum(np.abs(size), 1.0))[:, None, :]
    return np.asarray(np.swapaxes(scaled, 1, 2))


def positive_part(weights: Array) -> Array:
    """Multipliers of the matrix inequalities without what the solver's tolerance left negative."""
    size, vectors = np.linalg.eigh((weights + np.swapaxes(weights, 1, 2)) / 2)
    return np.asarray(vectors @ (np.maximum(size, 0.0)[:, :, None] * np.swapaxes(vectors, 1, 2)))


def certificate(step: ProgrammeStep) -> Array:
    """Multipliers of the matrix inequalities for weak duality: Z_j ⪰ 0, Σ tr Z_j = 1."""
    weights = positive_part(step.weights)
    return np.asarray(weights / np.trace(weights, axis1=1, axis2=2).sum())


def dual_bound(
    step: ProgrammeStep,
    base: Array,
    slopes: Array,
    value: Array,
    jacobian: Array,
    low: Array,
    high: Array,
) -> float:
    """An upper bound on λ that holds whatever the solver did.

    For any weights Z_j ⪰ 0 with Σ tr Z_j = 1 and y ≥ 0, weak duality gives
    λ ≤ max over the box of Σ ⟨Z_j, A_j + Σ x_v B_jv⟩ + y·(c + C x), which is linear in x. The
    solver's multipliers, made to meet the signs and the trace, are such weights.
    """
    weights = certificate(step)
    constant = np.einsum("nij,nij->", weights, base) + step.multipliers @ value
    slope = np.einsum("nij,vnij->v", weights, slopes) + step.multipliers @ jacobian
    return float(constant + np.maximum(slope * low, slope * high).sum())


def bound_of_moving_mass(bound: float, reached: float, weights: Array, light: Array) -> float:
    """An upper bound on λ where M depends on x too, from one near a λ that is ``reached``.

    Let L⁻¹(K − reached·(M − M0))L⁻ᵀ in the frame of M0 = L Lᵀ stand for K, and ``bound`` ≥ Σ ⟨Z_j,
    that⟩ for all x. Where λ(x) > reached, 0 ≤ Σ ⟨Z_j, L⁻¹(K − λ M)L⁻ᵀ⟩ ≤ bound − reached − (λ −
    reached) Σ ⟨Z_j, L⁻¹M L⁻ᵀ⟩, and M is never less than without own masses: L⁻¹M L⁻ᵀ ⪰ ``light``
    (n, nq, nq), the identity where M does not depend on x.
    """
    return reached + max(bound - reached, 0.0) / float(np.einsum("nij,nij->", weights, light))


def contradicted(bound: float, reached: float) -> bool:
    """Whether a bound is NaN, or below what an allowed design reaches; both in Hz or as ω²."""
    return not bound >= reached - MISSED_SHARE * abs(reached)
