"""Semidefinite programmes of the design: the only door to Clarabel.

Both forms maximise λ subject to  A_j + Σ x_v B_jv − λ I ⪰ 0  for some poses j and  c + C x ≥ 0,
low ≤ x ≤ high, where A and B are L⁻¹K L⁻ᵀ and its slopes, so that λ is the lowest ω² over a
reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np

from armdesign.arrays import Array, congruent
from armdesign.errors import InfeasibleError
from armdesign.transaction import undisturbed

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


class StepProgramme:
    """The programme with n poses, m constraints and nx variables, set up once for many data.

    Constraints may be violated at a price, so that a step from an infeasible x exists. The solver
    has it as: least q·z with b − A z in a cone, where z is x, λ and the violations; below the
    rows of the constraints stand the violations, both bounds of x, and of every matrix the upper
    triangle, column by column, off the diagonal times √2.
    """

    def __init__(self, n: int, nq: int, m: int, nx: int) -> None:
        self.shape = (n, nq, m, nx)
        self._pairs = np.tril_indices(nq)
        self._root = np.where(self._pairs[0] == self._pairs[1], 1.0, math.sqrt(2))
        matrices = 2 * (m + nx) + np.arange(n * len(self._root))
        of_x = [[*range(m), 2 * m + v, 2 * m + nx + v, *matrices] for v in range(nx)]
        columns = [*of_x, [*matrices], *([k, m + k] for k in range(m))]
        self._rows = np.concatenate(columns).astype(int)
        self._ends = np.cumsum([0, *map(len, columns)])
        self._cost = np.concatenate([np.zeros(nx), [-1.0], np.full(m, PENALTY)])

    def solve(
        self, base: Array, slopes: Array, value: Array, jacobian: Array, low: Array, high: Array
    ) -> ProgrammeStep:
        """Solve with matrices ``base`` (n, nq, nq) and ``slopes`` (nx, n, nq, nq).

        Raises:
            InfeasibleError: data that are not finite, as at a dead centre; the solver gave up.
        """
        if not all(np.isfinite(part).all() for part in (base, slopes, value, jacobian)):
            fault = "stiffness or a requirement is not finite here"
            raise InfeasibleError("design step", fault, "start elsewhere")
        n, nq, m, nx = self.shape
        level = _levelled(base)
        of_base, of_unit = (self._triangles(level, part) for part in (base, np.eye(nq)))
        of_x = [-jacobian, -np.ones((1, nx)), np.ones((1, nx)), -self._triangles(level, slopes).T]
        entries = [np.concatenate(of_x).ravel("F"), of_unit, np.full(2 * m, -1.0)]
        right = np.concatenate([value, np.zeros(m), -low, high, of_base])
        z, multipliers = self._solved(np.concatenate(entries), right)
        ends = np.cumsum([m, m, nx, nx])
        of_limits, _, of_low, of_high, of_matrices = np.split(multipliers, ends)
        dual = np.empty(base.shape)
        a, b = self._pairs
        dual[:, a, b] = dual[:, b, a] = of_matrices.reshape(n, -1) / self._root
        return ProgrammeStep(
            change=np.clip(z[:nx], low, high),
            value=float(z[nx]),
            violation=float(z[nx + 1 :].sum()),
            multipliers=np.maximum(of_limits, 0.0),
            low_multipliers=of_low,
            high_multipliers=of_high,
            weights=congruent(np.swapaxes(level, 1, 2), dual),
        )

    def _triangles(self, level: Array, matrices: Array) -> Array:
        """Levelled matrices (…, n, nq, nq) as the solver has them (…, n · nq (nq + 1) / 2)."""
        a, b = self._pairs
        entries = congruent(level, matrices)[..., a, b] * self._root
        return np.asarray(entries.reshape(*entries.shape[:-2], -1))

    def _solved(self, entries: Array, right: Array) -> tuple[Array, Array]:
        """The best z and the multipliers of all rows.

        Raises:
            InfeasibleError: the solver gave up.
        """
        with undisturbed():
            import clarabel
        from scipy.sparse import csc_array

        n, nq, m, nx = self.shape
        size = len(right), len(self._cost)
        matrix = csc_array((entries, self._rows, self._ends), shape=size)
        cones = [clarabel.NonnegativeConeT(2 * (m + nx)), *[clarabel.PSDTriangleConeT(nq)] * n]
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        none = csc_array((size[1], size[1]))
        answer = clarabel.DefaultSolver(none, self._cost, matrix, right, cones, settings).solve()
        # of a solution that is not quite exact every step is judged by its true objective
        if str(answer.status) not in ("Solved", "AlmostSolved"):
            fault = f"the solver says {answer.status}"
            raise InfeasibleError("design step", fault, "loosen the requirements")
        return np.array(answer.x), np.array(answer.z)


@lru_cache(maxsize=64)
def programme(n: int, nq: int, m: int, nx: int) -> StepProgramme:
    """The programme of this shape, set up once in a process."""
    return StepProgramme(n, nq, m, nx)


def _levelled(base: Array) -> Array:
    """A congruence T for each A, so that T A Tᵀ has no large entries (stiff modes: 10⁵ ×)."""
    size, vectors = np.linalg.eigh(base)
    scaled = vectors / np.sqrt(np.maximum(np.abs(size), 1.0))[:, None, :]
    return np.asarray(np.swapaxes(scaled, 1, 2))


def padded(value: Array, jacobian: Array) -> tuple[Array, Array]:
    """Constraints filled up to a multiple of 40, so that one programme serves many times."""
    more = -len(value) % 40
    return np.pad(value, (0, more), constant_values=1.0), np.pad(jacobian, ((0, more), (0, 0)))


def positive_part(weights: Array) -> Array:
    """Multipliers of the matrix inequalities without what the solver's tolerance left negative."""
    size, vectors = np.linalg.eigh((weights + np.swapaxes(weights, 1, 2)) / 2)
    return np.asarray(vectors @ (np.maximum(size, 0.0)[:, :, None] * np.swapaxes(vectors, 1, 2)))


def certificate(step: ProgrammeStep) -> Array:
    """Multipliers of the matrix inequalities for weak duality: Z_j ⪰ 0, Σ tr Z_j = 1."""
    weights = positive_part(step.weights)
    return np.asarray(weights / np.trace(weights, axis1=1, axis2=2).sum())


def exact_certificate(step: ProgrammeStep) -> Any:
    """Multipliers as ``certificate``, as fractions (n, nq, nq) that meet both to the last bit.

    Z_j = R_j R_jᵀ over the sum of all their traces, where R_j is as near as floats come to a root
    of the solver's multipliers.
    """
    weights = positive_product(step.weights)
    return weights / np.trace(weights, axis1=1, axis2=2).sum()


def positive_product(matrices: Array) -> Any:
    """R Rᵀ near symmetric matrices (n, k, k), in fractions: semidefinite to the last bit."""
    size, vectors = np.linalg.eigh((matrices + np.swapaxes(matrices, 1, 2)) / 2)
    roots = exactly(vectors * np.sqrt(np.maximum(size, 0.0))[:, None, :])
    return roots @ np.swapaxes(roots, 1, 2)


def exactly(values: Array) -> Any:
    """The numbers of an array as the fractions that floats are."""
    return np.frompyfunc(Fraction, 1, 1)(values)


def rounded_up(number: Fraction) -> float:
    """A float that is no less than a fraction."""
    return math.nextafter(float(number), math.inf)


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
    solver's multipliers, made to meet the signs and the trace, are such weights. All of it is
    computed in fractions, which floats are, and rounded up at the end.
    """
    weights, multipliers = exact_certificate(step), exactly(step.multipliers)
    constant = (weights * exactly(base)).sum() + multipliers @ exactly(value)
    slope = (weights * exactly(slopes)).sum(axis=(1, 2, 3)) + multipliers @ exactly(jacobian)
    ends = np.maximum(slope * exactly(low), slope * exactly(high))
    return rounded_up(constant + ends.sum())


def bound_of_moving_mass(bound: float, reached: float, weights: Any, light: Array) -> float:
    """An upper bound on λ where M depends on x too, from one near a λ that is ``reached``.

    Let L⁻¹(K − reached·(M − M0))L⁻ᵀ in the frame of M0 = L Lᵀ stand for K, and ``bound`` ≥ Σ ⟨Z_j,
    that⟩ for all x. Where λ(x) > reached, 0 ≤ Σ ⟨Z_j, L⁻¹(K − λ M)L⁻ᵀ⟩ ≤ bound − reached − (λ −
    reached) Σ ⟨Z_j, L⁻¹M L⁻ᵀ⟩, and M is never less than without own masses: L⁻¹M L⁻ᵀ ⪰ ``light``
    (n, nq, nq), the identity where M does not depend on x. ``weights`` are fractions, and the sum
    is rounded up.
    """
    gain = max(Fraction(bound) - Fraction(reached), Fraction(0))
    return rounded_up(Fraction(reached) + gain / (weights * exactly(light)).sum())


def contradicted(bound: float, reached: float) -> bool:
    """Whether a bound is NaN, or below what an allowed design reaches; both in Hz or as ω²."""
    return not bound >= reached - MISSED_SHARE * abs(reached)
