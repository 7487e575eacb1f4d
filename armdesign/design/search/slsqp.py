"""Second order: from a roughly good design to the optimum near it, along what bends.

Where fewer limits bind than there are variables, as with four-bars, steps of linearised programmes
zigzag: how far to go is then a question of curvature. SLSQP learns the curvature on its way, with
exact derivatives of the two lowest ω² of the lowest rows. It knows no matrix inequalities, so
where modes cross it may fail: what it finds counts only if it is better on the whole workspace,
and linearised programmes have the last word.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.constraints import constraints_at
from armdesign.design.search.sequential_sdp import ACTIVE, Search
from armdesign.threads import one_blas_thread

ROUNDS = 8
MODES = 2  # of each row that are kept above the bound: they may come to cross
ITERATIONS = 100
TOLERANCE = 1e-5  # of the merit, between rounds
FAILED = -10.0  # value of every constraint at a design that cannot be built


@np.errstate(invalid="ignore", divide="ignore")  # a dead centre on the way is no better
def improve_by_slsqp(search: Search) -> Search:
    """The search at the better design that lies near; itself if none is found.

    With the rows that are lowest there it goes on from where a round led, as long as others come
    to be lowest.
    """
    rows = np.empty(0, dtype=int)
    best = trial = search
    for _ in range(ROUNDS):
        known, rows = rows, np.union1d(rows, _lowest(trial))
        if len(rows) == len(known):
            break
        x = _climbed(trial, rows)
        if not search.problem.vector.closes(x):
            break
        before, trial = trial.merit, trial.at(x)
        best = max(best, trial, key=lambda s: s.merit)
        if before <= trial.merit < before + TOLERANCE:
            break
    return best


def _lowest(search: Search) -> Array:
    """Of the rows watched the lowest, and the lowest that do not nearly coincide."""
    squared = search.problem.dynamics.omega_squared(search.x, search.rows)
    return np.union1d(search.rows[np.argsort(squared)[:ACTIVE]], search.active(squared))


@one_blas_thread()
def _climbed(search: Search, rows: Array) -> Array:
    """End of SLSQP: the highest t below the lowest ω² of some rows, under all limits."""
    from scipy.optimize import minimize

    programme = _Programme(search, rows)
    t = search.squared / search.problem.dynamics.omega_squared_scale
    ends = zip(*(end[programme.free] for end in programme.bounds), strict=True)
    answer = minimize(
        lambda z: -z[-1],
        np.append(search.x[programme.free], t),
        jac=lambda z: np.append(np.zeros(len(z) - 1), -1.0),
        bounds=[*ends, (None, None)],
        constraints={
            "type": "ineq",
            "fun": lambda z: programme.constraints(z)[0],
            "jac": lambda z: programme.constraints(z)[1],
        },
        method="SLSQP",
        options={"maxiter": ITERATIONS, "ftol": 1e-7},
    )
    return programme.design(answer.x)


class _Programme:
    """Maximise t below the lowest ω² of some rows: constraints of z = (free entries of x, t)."""

    def __init__(self, search: Search, rows: Array) -> None:
        self._search, self._rows = search, rows
        self.bounds = search.bounds
        self.free = self.bounds[1] > self.bounds[0]
        self._last: tuple[bytes, Array, Array] | None = None

    def design(self, z: Array) -> Array:
        """The design vector of z."""
        x = self._search.x.copy()
        x[self.free] = np.clip(z[:-1], *(end[self.free] for end in self.bounds))
        return x

    def constraints(self, z: Array) -> tuple[Array, Array]:
        """Values ≥ 0 and their derivatives by z."""
        x = self.design(z)
        if self._last and not self._search.problem.vector.closes(x):  # a line search went too far
            return np.full_like(self._last[1], FAILED), self._last[2]
        if self._last is None or self._last[0] != z.tobytes():
            self._last = z.tobytes(), *self._constraints_at(x, float(z[-1]))
        return self._last[1:]

    def _constraints_at(self, x: Array, t: float) -> tuple[Array, Array]:
        problem, dynamics = self._search.problem, self._search.problem.dynamics
        at, scale = constraints_at(problem, x, self._search.holding), dynamics.omega_squared_scale
        # where masses depend on x, slopes are exact for the ω² that bind
        matrices = dynamics.scaled_stiffness_and_gradient(x, self._rows, t * scale)
        base, slopes = (part / scale for part in matrices)
        squared, vectors = np.linalg.eigh(base)
        slope = np.einsum("nik,vnij,njk->nkv", vectors, slopes, vectors)[:, :MODES]
        slope = slope.reshape(-1, len(x))
        value = np.concatenate([squared[:, :MODES].ravel() - t, at.values])
        by_t = np.concatenate([-np.ones(len(slope)), np.zeros(len(at.values))])
        by_x = np.concatenate([slope, at.jacobian])[:, self.free]
        return value, np.column_stack([by_x, by_t])
