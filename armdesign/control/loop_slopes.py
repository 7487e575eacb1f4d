"""How rooms below a limit and bandwidths change with the gains: all slopes from one inverse.

A figure of the closed loops at one frequency changes by Re tr(Γᵀ dS_c) + Re tr(Γ_pᵀ dS), with S_c
and S of ``loops``. All gains enter through I + L_c alone, whose change W sees, and S has K once
more at its end:

    W = S_c (R K Γ_pᵀ P − Γᵀ) S_c,   d/dK_k = (P W R − Γ_pᵀ P S_c R)_kk,   d/dc_i = H (Y W)_ii

so that the slopes by all gains take as much as one figure (adjoint or reverse differentiation).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.control.lanes import (
    LANES,
    add_products,
    add_scaled,
    fill,
    subtract_products,
    write_product,
)
from armdesign.control.loops import LEVEL, LoopArguments, LoopRoom, Loops
from armdesign.control.margins import Room
from armdesign.simulation.plant.compiled import within

SWEEPS = 4  # of the balancing's slope, as many as of the balancing


class SlopeRoom(NamedTuple):
    """What is computed of slopes at some frequencies, which compiled code may not make anew."""

    command: Array  # Γ of S_c (nc, nc, lanes)
    position: Array  # Γ_p of S (nq, nq, lanes)
    fed: Array  # Γ_pᵀ P (nq, nc, lanes)
    between: Array  # R K Γ_pᵀ P − Γᵀ (nc, nc, lanes)
    half: Array  # that times S_c (nc, nc, lanes)
    returned: Array  # W (nc, nc, lanes)
    total: Array  # a sum (lanes,)
    shifts: Array  # of the balancing: slopes by log D², and what makes up for them (2, m, lanes)
    weights: Array  # of differences of these, with their sums on the diagonal (m, m, lanes)
    sum: Array  # (lanes,)
    by_gains: Array  # slopes by the logarithms of all gains (nq + nc, lanes)

    @classmethod
    def of(cls, loops: Loops) -> SlopeRoom:
        """For some loops."""
        nq, nc = loops.positions.shape[1:3]
        shapes = (nc, nc), (nq, nq), (nq, nc), (nc, nc), (nc, nc), (nc, nc), ()
        made = [np.empty((*shape, LANES), complex) for shape in shapes]
        m = max(nq, nc)
        real = [np.empty((*shape, LANES)) for shape in ((2, m), (m, m), (), (nq + nc,))]
        return cls._make([*made, *real])


@within
def write_room_slope(room: Room, slopes: SlopeRoom, slope: Array) -> None:
    """Write Γ (m, m, lanes): log ``room.left`` of X changes by Re tr(Γᵀ dX).

    With Z = (limit² I − Y Yᴴ)⁻¹ Y it changes by −2 Re tr(Zᴴ dY). Y changes with X and with D, of
    which a change du of log D² keeps Y balanced: Σ_j w_ij (du_i − du_j) is what dX lets columns
    have more than rows, w_ij = |Y_ij|² + |Y_ji|². A sweep of Gauss and Seidel solves that as one
    of Osborne's balances.
    """
    m, Y, Z, shifts = len(slope), room.balanced, slope, slopes.shifts
    _write_solution(room.lower, Y, Z)
    _write_shifts(Y, Z, slopes)
    for i in range(m):
        for j in range(m):
            row, column = room.squares[m, i], room.squares[m + 1, j]
            own, other, y, z = shifts[1, i], shifts[1, j], Y[i, j], Z[i, j]
            for lane in range(LANES):
                shift, twice = other[lane] - own[lane], 2 * row[lane] * column[lane]
                value, before = y[lane], z[lane]
                real, imaginary = shift * value.real, shift * value.imag
                real, imaginary = real - before.real, before.imag - imaginary
                z[lane] = complex(twice * real, twice * imaginary)


@within
def _write_solution(lower: Array, Y: Array, Z: Array) -> None:
    """Write Z = (L Lᴴ)⁻¹ Y (m, m, lanes), L with one over its diagonal."""
    m = len(Z)
    for k in range(m):
        for i in range(m):
            for lane in range(LANES):
                Z[i, k, lane] = Y[i, k, lane]
            for j in range(i):
                subtract_products(Z[i, k], lower[i, j], Z[j, k])
            _divide(Z[i, k], lower[i, i])
        for i in range(m - 1, -1, -1):
            for j in range(i + 1, m):
                z, below, known = Z[i, k], lower[j, i], Z[j, k]
                for lane in range(LANES):
                    z[lane] -= below[lane].conjugate() * known[lane]
            _divide(Z[i, k], lower[i, i])


@within
def _divide(values: Array, over: Array) -> None:
    """Multiply by one over a real number."""
    for lane in range(len(values)):
        value, factor = values[lane], over[lane].real
        values[lane] = complex(factor * value.real, factor * value.imag)


@within
def _write_shifts(Y: Array, Z: Array, slopes: SlopeRoom) -> None:
    """Write changes of log D² that make up for changes of Y, see ``write_room_slope``."""
    m, shifts, weights, total = len(Z), slopes.shifts, slopes.weights, slopes.sum
    for i in range(m):
        fill(shifts[0, i], 0.0)
        fill(shifts[1, i], 0.0)
        fill(weights[i, i], 1e-300)
        for j in range(m):
            _add_difference(shifts[0, i], Y[j, i], Z[j, i], 1.0)
            _add_difference(shifts[0, i], Y[i, j], Z[i, j], -1.0)
            if j != i:
                _write_weight(Y[i, j], Y[j, i], weights[i, j], weights[i, i])
    for _ in range(SWEEPS if m > 1 else 0):
        for i in range(m):
            for lane in range(LANES):
                total[lane] = shifts[0, i, lane]
            for j in range(m):
                if j != i:
                    add_products(total, weights[i, j], shifts[1, j])
            for lane in range(len(total)):
                shifts[1, i, lane] = total[lane] / weights[i, i, lane]


@within
def _add_difference(out: Array, y: Array, z: Array, sign: float) -> None:
    """Add or subtract Re(y z*)."""
    for lane in range(LANES):
        out[lane] += sign * (y[lane].real * z[lane].real + y[lane].imag * z[lane].imag)


@within
def _write_weight(a: Array, b: Array, weight: Array, total: Array) -> None:
    """Write |a|² + |b|², and add it to a total."""
    for lane in range(LANES):
        x, y = a[lane], b[lane]
        value = x.real * x.real + x.imag * x.imag + y.real * y.real + y.imag * y.imag
        weight[lane] = value
        total[lane] += value


@within
def clear_slopes(slopes: SlopeRoom) -> None:
    """Write 0 into Γ and Γ_p."""
    for matrix in (slopes.command, slopes.position):
        for i in range(len(matrix)):
            for j in range(len(matrix)):
                fill(matrix[i, j], 0.0)


@within
def write_size_slope(S: Array, loop: int, lane: int, slopes: SlopeRoom) -> None:
    """Write what is not 0 of Γ and Γ_p of log |T| of a loop in a lane, T = 1 − S of its own."""
    T = 1 - S[loop, loop, lane]
    slopes.position[loop, loop, lane] = -T.conjugate() / (T.real**2 + T.imag**2)


@within
def write_gain_slopes(loops: LoopArguments, pose: int, room: LoopRoom, slopes: SlopeRoom) -> None:
    """Write slopes by the logarithms of all gains (nq + nc), of what Γ and Γ_p say, see module."""
    R, c, K = loops.arms[pose], loops.pressure_gains[pose], loops.gains[pose]
    _write_returned(R, K, room, slopes)
    nq, nc, W, total = len(K), len(c), slopes.returned, slopes.total
    for k in range(nq):
        by_gain = slopes.by_gains[k]
        fill(by_gain, 0.0)
        for i in range(nc):
            fill(total, 0.0)
            for j in range(nc):
                if R[j, k] != 0.0:
                    add_scaled(total, R[j, k], W[i, j])
            _add_real_product(by_gain, room.positions[k, i], total, K[k])
        for i in range(nq):
            _add_real_product(by_gain, slopes.position[i, k], room.closed[i, k], -K[k])
    for i in range(nc):
        by_gain = slopes.by_gains[nq + i]
        fill(by_gain, 0.0)
        for j in range(nc):
            _add_real_product(by_gain, room.pressures[i, j], W[j, i], c[i])


@within
def _add_real_product(out: Array, a: Array, b: Array, factor: float) -> None:
    """Add a factor of Re(a b)."""
    for lane in range(LANES):
        out[lane] += factor * (a[lane].real * b[lane].real - a[lane].imag * b[lane].imag)


@within
def _write_returned(R: Array, K: Array, room: LoopRoom, slopes: SlopeRoom) -> None:
    """Write W of Γ and Γ_p."""
    between = slopes.between
    for k in range(len(K)):
        for j in range(len(R)):
            fill(slopes.fed[k, j], 0.0)
            for i in range(len(K)):
                add_products(slopes.fed[k, j], slopes.position[i, k], room.positions[i, j])
    for i in range(len(R)):
        for j in range(len(R)):
            fill(between[i, j], 0.0)
            add_scaled(between[i, j], -1.0, slopes.command[j, i])
            for k in range(len(K)):
                if R[i, k] != 0.0:
                    add_scaled(between[i, j], R[i, k] * K[k], slopes.fed[k, j])
    write_product(slopes.half, between, room.S_c)
    write_product(slopes.returned, room.S_c, slopes.half)


@within
def crossing_slopes(omega: Array, f: int, last: float, size: float) -> tuple[float, float]:
    """Slopes of the logarithm of ``crossing`` by the logarithms of ``last`` and ``size``."""
    if f == 0:
        return 0.0, 1 / (1 - size**2)
    span = math.log(last / size)
    share = math.log(last / LEVEL) / span
    wide = math.log(omega[f] / omega[f - 1]) / span
    return (1 - share) * wide, share * wide
