"""Semidefinite programmes of the design: the only door to cvxpy.

Both forms maximise λ subject to  A_j + Σ x_v B_jv − λ I ⪰ 0  for some poses j and  c + C x ≥ 0,
low ≤ x ≤ high, where A and B are L⁻¹K L⁻ᵀ and its slopes, so that λ is the lowest ω² over a
reference.
"""

from __future__ import annotations

import math
import warnings
from contextlib import suppress
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

    Constraints may be violated at a price, so that a step from an infeasible x exists.
    """

    def __init__(self, n: int, nq: int, m: int, nx: int) -> None:
        with undisturbed():
            import cvxpy as cp
        from scipy.sparse import eye_array, kron

        self.shape = (n, nq, m, nx)
        upper = np.transpose(np.triu_indices(nq))
        self._pairs = upper.T
        entries = n * len(upper)
        self._base, self._unit = cp.Parameter(entries), cp.Parameter(entries)
        self._slopes = cp.Parameter((entries, nx))
        self._value, self._jacobian = cp.Parameter(m), cp.Parameter((m, nx))
        self._low, self._high = cp.Parameter(nx), cp.Parameter(nx)
        self._change, self._lambda = cp.Variable(nx), cp.Variable()
        self._excess = cp.Variable(m, nonneg=True)
        place = np.zeros((nq * nq, len(upper)))
        for k, (a, b) in enumerate(upper):
            place[a * nq + b, k] = place[b * nq + a, k] = 1.0
        triangles = self._base + self._slopes @ self._change - self._unit * self._lambda
        whole = kron(eye_array(n), place, format="csr") @ triangles
        self._matrices = cp.reshape(whole, (n, nq, nq), order="C") >> 0
        self._limits = self._value + self._jacobian @ self._change + self._excess >= 0
        self._box = [self._change >= self._low, self._change <= self._high]
        objective = cp.Maximize(self._lambda - PENALTY * cp.sum(self._excess))
        self._problem = cp.Problem(objective, [self._matrices, self._limits, *self._box])

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
        (a, b), level = self._pairs, _levelled(base)
        pair = base, np.eye(base.shape[1])
        self._base.value, self._unit.value = (
            congruent(level, matrix)[:, a, b].ravel() for matrix in pair
        )
        self._slopes.value = congruent(level, slopes)[:, :, a, b].reshape(len(slopes), -1).T
        self._value.value, self._jacobian.value = value, jacobian
        self._low.value, self._high.value = low, high
        _solve(self._problem)
        dual = np.asarray(self._matrices.dual_value).reshape(base.shape)
        return ProgrammeStep(
            change=np.clip(np.asarray(self._change.value), low, high),
            value=float(np.sum(self._lambda.value)),
            violation=float(np.sum(self._excess.value)),
            multipliers=np.maximum(np.asarray(self._limits.dual_value), 0.0),
            low_multipliers=np.asarray(self._box[0].dual_value),
            high_multipliers=np.asarray(self._box[1].dual_value),
            weights=congruent(np.swapaxes(level, 1, 2), dual),
        )


@lru_cache(maxsize=8)
def programme(n: int, nq: int, m: int, nx: int) -> StepProgramme:
    """The programme of this shape, set up once in a process; not for several threads at a time."""
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


def _solve(problem: Any) -> None:
    """Solve to the solver's tolerances, with refined steps where it does not come there without.

    Refinement of the linear systems takes a third of the time.
    """
    import cvxpy as cp

    def solve(refined: bool) -> bool:
        with warnings.catch_warnings():
            # "solution may be inaccurate": every step is judged by its true objective
            warnings.simplefilter("ignore")
            problem.solve(cp.CLARABEL, warm_start=False, iterative_refinement_enable=refined)
        return bool(problem.status == "optimal")

    solved = False
    with suppress(cp.SolverError):
        solved = solve(refined=False)
    try:
        solved = solved or solve(refined=True)
    except cp.SolverError as error:
        fault = f"the solver gave up ({error})"
        raise InfeasibleError("design step", fault, "loosen the requirements") from None
    if problem.status not in ("optimal", "optimal_inaccurate"):
        fault = f"the solver says {problem.status}"
        raise InfeasibleError("design step", fault, "loosen the requirements")
