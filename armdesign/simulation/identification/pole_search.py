"""Search for the poles of a fit, compiled: Levenberg and Marquardt's method on ω and ζ.

The numerators are eliminated (Golub & Pereyra 1973): with the QR decomposition of their whitened
columns, Φ = Q R, a fit leaves the part of the output beyond the first rows of Qᵀ y, and a change
of the poles counts by the same part of its slopes. So Q is never formed: reflections are applied
one by one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.plant.compiled import borrowing, resolved, within

TRIALS = 6  # of a step in a round
CONVERGED = 1e-6  # relative change of what is left
LARGEST_STEP = (0.2, 0.15)  # of ω and ζ in a round
FIRST_DAMPING = 1e-3  # of the steps
TINY = 1e-300
COINCIDE = 1e-13  # diagonal of R of a column that others make up for


class Problem(NamedTuple):
    """Least squares of whitened spectra at k lines; c factors of a numerator, m poles."""

    omega: Array  # of the lines, relative to the band's middle (k,)
    inputs: Array  # factors of a numerator, real above imaginary parts (2k, c)
    white: Array  # symmetric matrix that whitens (2k, 2k)
    observed: Array  # whitened output (2k,)
    least: Array  # bounds of ω and ζ (m, 2)
    most: Array  # (m, 2)


class Scratch(NamedTuple):
    """Arrays for intermediate values; n = m c columns."""

    columns: Array  # of the numerators, of size one, as rows (n, 2k)
    reflected: Array  # the same whitened and reflected, and the output (n + 1, 2k)
    diagonal: Array  # of R (n,)
    scales: Array  # of reflections (n,)
    slopes: Array  # by ω and ζ of every pole (2m, 2k)
    white_slopes: Array  # whitened and reflected (2m, 2k)
    numerators: Array  # (n,)
    normal: Array  # equations of a step, and their right-hand side (2m, 2m + 1)
    factors: Array  # of these (2m, 2m + 1)
    there: Array  # poles after a step (m, 2)

    @classmethod
    def of(cls, rows: int, poles: int, each: int) -> Scratch:
        """Scratch for 2k rows, m poles and c factors of each numerator."""
        n, both = poles * each, 2 * poles
        shapes = (n, rows), (n + 1, rows), (n,), (n,), (both, rows), (both, rows), (n,)
        equations = (both, both + 1)
        return cls(*map(np.empty, (*shapes, equations, equations, (poles, 2))))


def best_poles(problem: Problem, poles: Array, rounds: int) -> Array:
    """Poles (m, 2) within their bounds that leave least of the output, from some ``poles``.

    ``rounds`` is how many the search takes at most.
    """
    found = np.ascontiguousarray(np.clip(poles, problem.least, problem.most))
    _run(problem, found, rounds)
    return found


def left_over(problem: Problem, poles: Array) -> float:
    """Sum of the squares that poles (m, 2) leave."""
    return _run(problem, np.ascontiguousarray(poles), 0)


def _run(problem: Problem, poles: Array, rounds: int) -> float:
    scratch = Scratch.of(len(problem.observed), len(poles), problem.inputs.shape[1])
    return float(_kernel()(problem, poles, rounds, scratch))


@cache
def _kernel() -> Callable[..., float]:
    """The compiled search, for the types that all calls here have."""
    vector, matrix = np.empty(1), np.empty((1, 1))
    problem = Problem(vector, matrix, matrix, vector, matrix, matrix)
    return resolved(_search, problem, matrix, 1, Scratch.of(1, 1, 1))


@borrowing
def _search(problem: Problem, poles: Array, rounds: int, scratch: Scratch) -> float:
    """Move poles (m, 2) to where they leave least of the output: the squares that they leave."""
    damping, there = FIRST_DAMPING, scratch.there
    cost = _left_over(problem, poles, scratch)
    for _ in range(rounds):
        before = cost
        _set_normal_equations(problem, poles, scratch)
        for _ in range(TRIALS):
            if _solve(scratch.normal, damping, scratch.factors) < CONVERGED * before:
                return before
            _step(problem, poles, scratch)
            cost = _left_over(problem, there, scratch)
            if cost < before:
                break
            damping *= 5
        if not cost < before:
            return before
        damping /= 10
        for p in range(len(poles)):
            poles[p, 0], poles[p, 1] = there[p, 0], there[p, 1]
        if before - cost < CONVERGED * before:
            break
    return cost


@within
def _left_over(problem: Problem, poles: Array, scratch: Scratch) -> float:
    """Sum of the squares that poles (m, 2) leave; columns and reflections are written."""
    omega, inputs, columns = problem.omega, problem.inputs, scratch.columns
    k, each = len(omega), inputs.shape[1]
    for p in range(len(poles)):
        for i in range(k):
            own, across = _fraction(poles[p, 0], poles[p, 1], omega[i])
            for j in range(each):
                columns[p * each + j, i] = own * inputs[i, j] - across * inputs[k + i, j]
                columns[p * each + j, k + i] = own * inputs[k + i, j] + across * inputs[i, j]
    for j in range(len(columns)):
        total = 0.0
        for i in range(2 * k):
            total += columns[j, i] ** 2
        for i in range(2 * k):
            columns[j, i] /= math.sqrt(total)
    return _reflect(problem, scratch)


@within
def _fraction(omega: float, zeta: float, line: float) -> tuple[float, float]:
    """Real and imaginary part of 1/(s² + 2ζω s + ω²) at s = j ``line``."""
    real, imaginary = omega * omega - line * line, 2 * zeta * omega * line
    size = real * real + imaginary * imaginary
    return real / size, -imaginary / size


@within
def _whiten(white: Array, values: Array, out: Array) -> None:
    """Write the products of a symmetric matrix with rows (n, 2k) into the first n of ``out``."""
    for j in range(len(values)):
        for i in range(len(white)):
            out[j, i] = 0.0
        for row in range(len(white)):
            own = values[j, row]
            for i in range(len(white)):
                out[j, i] += own * white[row, i]


@within
def _reflect(problem: Problem, scratch: Scratch) -> float:
    """Householder's QR decomposition of the whitened columns: squares left of the output."""
    work, n = scratch.reflected, len(scratch.columns)
    _whiten(problem.white, scratch.columns, work)
    rows = work.shape[1]
    for i in range(rows):
        work[n, i] = problem.observed[i]
    for c in range(n):
        total = 0.0
        for i in range(c, rows):
            total += work[c, i] ** 2
        corner, size = work[c, c], math.sqrt(total)
        scratch.diagonal[c] = -size if corner > 0 else size
        work[c, c] = corner - scratch.diagonal[c]
        scratch.scales[c] = 1 / max(size * (size + abs(corner)), TINY)
        _reflect_rows(work, c, scratch.scales[c], work, c + 1)
    left = 0.0
    for i in range(n, rows):
        left += work[n, i] ** 2
    return left


@within
def _reflect_rows(mirrors: Array, c: int, scale: float, values: Array, first: int) -> None:
    """Reflect rows from the ``first`` on by I − scale v vᵀ, v the entries from c on of row c."""
    for j in range(first, len(values)):
        along = 0.0
        for i in range(c, values.shape[1]):
            along += mirrors[c, i] * values[j, i]
        along *= scale
        for i in range(c, values.shape[1]):
            values[j, i] -= along * mirrors[c, i]


@within
def _set_normal_equations(problem: Problem, poles: Array, scratch: Scratch) -> None:
    """Write slopes, beyond what numerators make up for, of size one, and their equations."""
    _write_slopes(problem, poles, scratch)
    work, slopes, normal = scratch.reflected, scratch.white_slopes, scratch.normal
    n, both = len(scratch.columns), len(slopes)
    _whiten(problem.white, scratch.slopes, slopes)
    for c in range(n):
        _reflect_rows(work, c, scratch.scales[c], slopes, 0)
    for j in range(both):
        for other in range(both):
            normal[j, other] = 0.0
            for i in range(n, work.shape[1]):
                normal[j, other] += slopes[j, i] * slopes[other, i]
        normal[j, both] = 0.0
        for i in range(n, work.shape[1]):
            normal[j, both] += slopes[j, i] * work[n, i]


@within
def _write_slopes(problem: Problem, poles: Array, scratch: Scratch) -> None:
    """Write slopes of the output by ω and ζ of every pole, with the best numerators."""
    k, each, best = len(problem.omega), problem.inputs.shape[1], scratch.numerators
    work, n = scratch.reflected, len(scratch.diagonal)
    for c in range(n - 1, -1, -1):
        rest, corner = work[n, c], scratch.diagonal[c]
        for j in range(c + 1, n):
            rest -= work[j, c] * best[j]
        best[c] = rest / (corner + COINCIDE if abs(corner) < COINCIDE else corner)
    for p in range(len(poles)):
        omega, zeta = poles[p, 0], poles[p, 1]
        for i in range(k):
            line, real, imaginary = problem.omega[i], 0.0, 0.0
            for j in range(p * each, (p + 1) * each):
                real += scratch.columns[j, i] * best[j]
                imaginary += scratch.columns[j, k + i] * best[j]
            own, across = _fraction(omega, zeta, line)
            real, imaginary = real * own - imaginary * across, real * across + imaginary * own
            scratch.slopes[2 * p, i] = -2 * (omega * real - zeta * line * imaginary)
            scratch.slopes[2 * p, k + i] = -2 * (omega * imaginary + zeta * line * real)
            scratch.slopes[2 * p + 1, i] = 2 * omega * line * imaginary
            scratch.slopes[2 * p + 1, k + i] = -2 * omega * line * real


@within
def _solve(normal: Array, damping: float, factors: Array) -> float:
    """Write a step into the last column of ``factors``: the decrease that it promises."""
    n, promised = len(normal), 0.0
    for i in range(n):
        for j in range(n + 1):
            factors[i, j] = normal[i, j]
        factors[i, i] += damping * normal[i, i] + TINY
        for j in range(i):
            share = factors[i, j] / factors[j, j]
            for other in range(j, n + 1):
                factors[i, other] -= share * factors[j, other]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            factors[i, n] -= factors[i, j] * factors[j, n]
        factors[i, n] /= factors[i, i]
        promised += normal[i, n] * factors[i, n]
    return promised


@within
def _step(problem: Problem, poles: Array, scratch: Scratch) -> None:
    """Write poles after a step that is not too large, within their bounds."""
    step, longest = scratch.factors, 1.0
    last = step.shape[1] - 1
    for i in range(len(step)):
        longest = max(longest, abs(step[i, last]) / LARGEST_STEP[i % 2])
    for i in range(len(step)):
        p, kind = i // 2, i % 2
        wanted = poles[p, kind] + step[i, last] / longest
        wanted = max(wanted, problem.least[p, kind])
        scratch.there[p, kind] = min(wanted, problem.most[p, kind])
