"""Second order: from a roughly good design to the optimum near it, along what bends.

Where fewer limits bind than there are variables, as with four-bars, steps of linearised programmes
zigzag: how far to go is then a question of curvature. SLSQP learns the curvature on its way, with
exact derivatives of the two lowest ω² of the lowest rows. It knows no matrix inequalities, so
where modes cross it may fail: what it finds counts only if it is better on the whole workspace,
and linearised programmes have the last word.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.constraints import constraints_at
from armdesign.design.search.sequential_sdp import ACTIVE, Search

NEARBY = 0.3  # how far any entry of x may go in one round
ROUNDS = 8
MODES = 2  # of each row that are kept above the bound: they may come to cross
ITERATIONS = 100
FAILED = -10.0  # value of every constraint at a design that cannot be built


@np.errstate(invalid="ignore", divide="ignore")  # a dead centre on the way is no better
def polish(search: Search, tolerance: float = 1e-5) -> None:
    """Take a search to the better design that lies near, if one is found.

    With the rows that are lowest there it goes on from where a round led, as long as others come
    to be lowest. Where four-bars move, which bend most, also as long as a round ends only because
    it may go no farther.
    """
    rows = np.empty(0, dtype=int)
    best = trial = search
    stopped = False
    for _ in range(ROUNDS):
        known, rows = rows, np.union1d(rows, _lowest(trial))
        if len(rows) == len(known) and not stopped:
            break
        x = _climbed(trial, rows)
        if not search.problem.vector.closes(x):
            break
        stopped = search.problem.vector.moves_within and bool(
            np.abs(x - trial.x).max() > NEARBY * (1 - 1e-6)
        )
        before, trial = trial.merit, replace(trial, x=x)
        trial.look()
        best = max(best, trial, key=lambda s: s.merit)
        if before <= trial.merit < before + tolerance:
            break
    search.x, search.rows, search.holding = best.x, best.rows, best.holding
    search.squared, search.limits = best.squared, best.limits


def _lowest(search: Search) -> Array:
    """Of the rows watched the lowest, and the lowest that do not nearly coincide."""
    squared = search.problem.dynamics.omega_squared(search.x, search.rows)
    return np.union1d(search.rows[np.argsort(squared)[:ACTIVE]], search.active(squared))


def _climbed(search: Search, rows: Array) -> Array:
    """Where SLSQP leads: t as high as can be below the lowest ω² of some rows, under all limits."""
    from scipy.optimize import minimize

    problem, start = search.problem, search.x
    low, high = (
        np.maximum(search.bounds[0], start - NEARBY),
        np.minimum(search.bounds[1], start + NEARBY),
    )
    free = high > low
    known: dict[bytes, tuple[Array, Array]] = {}

    def design(z: Array) -> Array:
        x = start.copy()
        x[free] = np.clip(z[:-1], low[free], high[free])
        return x

    def constraints(z: Array) -> tuple[Array, Array]:
        """Values ≥ 0 and their derivatives by the free entries of x and by t."""
        x = design(z)
        if known and not problem.vector.closes(x):  # a line search went too far
            value, jacobian = next(iter(known.values()))
            return np.full_like(value, FAILED), jacobian
        if z.tobytes() not in known:
            at = constraints_at(problem, x, search.holding)
            met = (
                z[-1] * problem.dynamics.omega_squared_scale
            )  # where masses depend on x, slopes are exact for the ω² that bind
            base, slopes = (
                part / problem.dynamics.omega_squared_scale
                for part in problem.dynamics.scaled_stiffness_and_gradient(x, rows, met)
            )
            squared, vectors = np.linalg.eigh(base)
            slope = np.einsum("nik,vnij,njk->nkv", vectors, slopes, vectors)[:, :MODES].reshape(
                -1, len(x)
            )
            value = np.concatenate([squared[:, :MODES].ravel() - z[-1], at.values])
            by_t = np.concatenate([-np.ones(len(slope)), np.zeros(len(at.values))])
            known.clear()
            known[z.tobytes()] = (
                value,
                np.column_stack([np.concatenate([slope, at.jacobian])[:, free], by_t]),
            )
        return known[z.tobytes()]

    found = minimize(
        lambda z: -z[-1],
        np.append(start[free], search.squared / problem.dynamics.omega_squared_scale),
        jac=lambda z: np.append(np.zeros(len(z) - 1), -1.0),
        bounds=[*zip(low[free], high[free], strict=True), (None, None)],
        constraints={
            "type": "ineq",
            "fun": lambda z: constraints(z)[0],
            "jac": lambda z: constraints(z)[1],
        },
        method="SLSQP",
        options={"maxiter": ITERATIONS, "ftol": 1e-7},
    )
    return design(found.x)
