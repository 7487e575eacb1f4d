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
from armdesign.control.loops import HALF, LoopArguments, LoopRoom, Loops
from armdesign.control.margins import Room
from armdesign.simulation.plant.compiled import within

SWEEPS = 4  # of the balancing's slope, as many as of the balancing


class SlopeRoom(NamedTuple):
    """What is computed of slopes at one frequency, which compiled code may not make anew."""

    command: Array  # Γ of S_c (nc, nc)
    position: Array  # Γ_p of S (nq, nq)
    fed: Array  # K Γ_pᵀ P (nq, nc)
    between: Array  # R K Γ_pᵀ P − Γᵀ (nc, nc)
    half: Array  # that times S_c (nc, nc)
    returned: Array  # W (nc, nc)
    shifts: Array  # of the balancing: slopes by log D², and what makes up for them (2, m)

    @classmethod
    def of(cls, loops: Loops) -> SlopeRoom:
        """For some loops."""
        nq, nc = loops.positions.shape[2:]
        shapes = (nc, nc), (nq, nq), (nq, nc), (nc, nc), (nc, nc), (nc, nc)
        made = [np.empty(shape, complex) for shape in shapes]
        return cls._make([*made, np.empty((2, max(nq, nc)))])


@within
def write_room_slope(room: Room, shifts: Array, slope: Array) -> None:
    """Write Γ (m, m): ``log_room`` of X, which it has left in its room, changes by Re tr(Γᵀ dX).

    With Z = (limit² I − Y Yᴴ)⁻¹ Y it changes by −2 Re tr(Zᴴ dY). Y changes with X and with D, of
    which a change du of log D² keeps Y balanced: Σ_j w_ij (du_i − du_j) is what dX lets columns
    have more than rows, w_ij = |Y_ij|² + |Y_ji|². A sweep of Gauss and Seidel solves that as one
    of Osborne's balances.
    """
    m, lower, Y, Z = len(slope), room.lower, room.balanced, slope
    for k in range(m):
        for i in range(m):
            total = Y[i, k]
            for j in range(i):
                total -= lower[i, j] * Z[j, k]
            Z[i, k] = total * lower[i, i].real
        for i in range(m - 1, -1, -1):
            total = Z[i, k]
            for j in range(i + 1, m):
                total -= lower[j, i].conjugate() * Z[j, k]
            Z[i, k] = total * lower[i, i].real
    for i in range(m):
        shifts[0, i] = shifts[1, i] = 0.0
        for j in range(m):
            shifts[0, i] += (Y[j, i] * Z[j, i].conjugate() - Y[i, j] * Z[i, j].conjugate()).real
    for _ in range(SWEEPS if m > 1 else 0):
        for i in range(m):
            weights, total = 1e-300, shifts[0, i]
            for j in range(m):
                if j != i:
                    weight = (Y[i, j] * Y[i, j].conjugate()).real
                    weight += (Y[j, i] * Y[j, i].conjugate()).real
                    weights += weight
                    total += weight * shifts[1, j]
            shifts[1, i] = total / weights
    for i in range(m):
        for j in range(m):
            moved = (shifts[1, j] - shifts[1, i]) * Y[i, j] - Z[i, j]
            ratio = room.squares[m, i] * room.squares[m + 1, j]
            slope[i, j] = 2 * ratio * moved.conjugate()


@within
def write_size_slope(S: Array, loop: int, slopes: SlopeRoom) -> None:
    """Write Γ and Γ_p of log |T| of a loop, T = 1 − S of its own."""
    T = 1 - S[loop, loop]
    inverse = T.conjugate() / (T.real**2 + T.imag**2)
    for i in range(len(slopes.command)):
        for j in range(len(slopes.command)):
            slopes.command[i, j] = 0.0
    for i in range(len(slopes.position)):
        for j in range(len(slopes.position)):
            slopes.position[i, j] = -inverse if i == j == loop else 0.0


@within
def write_gain_slopes(
    loops: LoopArguments, pose: int, f: int, room: LoopRoom, slopes: SlopeRoom, by_gains: Array
) -> None:
    """Write slopes by the logarithms of all gains (nq + nc), of what Γ and Γ_p say, see module."""
    P, Y, R = loops.positions[pose, f], loops.pressures[pose, f], loops.arms[pose]
    H, c, K = loops.filters[pose, f], loops.pressure_gains[pose], loops.gains[pose]
    _write_returned(P, R, K, room.S_c, slopes)
    nq, nc, W, position = len(K), len(c), slopes.returned, slopes.position
    for k in range(nq):
        total = 0j
        for i in range(nc):
            seen = 0j
            for j in range(nc):
                seen += W[i, j] * R[j, k]
            total += P[k, i] * seen
        for i in range(nq):
            total -= position[i, k] * room.closed[i, k]
        by_gains[k] = K[k] * total.real
    for i in range(nc):
        total = 0j
        for j in range(nc):
            total += Y[i, j] * W[j, i]
        by_gains[nq + i] = c[i] * (H * total).real


@within
def _write_returned(P: Array, R: Array, K: Array, S_c: Array, slopes: SlopeRoom) -> None:
    """Write W of Γ and Γ_p."""
    nq, nc = P.shape
    fed, between, half = slopes.fed, slopes.between, slopes.half
    for k in range(nq):
        for j in range(nc):
            fed[k, j] = 0.0
            for i in range(nq):
                fed[k, j] += K[k] * slopes.position[i, k] * P[i, j]
    for i in range(nc):
        for j in range(nc):
            between[i, j] = -slopes.command[j, i]
            for k in range(nq):
                between[i, j] += R[i, k] * fed[k, j]
    for i in range(nc):
        for j in range(nc):
            half[i, j] = 0.0
            for k in range(nc):
                half[i, j] += between[i, k] * S_c[k, j]
    for i in range(nc):
        for j in range(nc):
            slopes.returned[i, j] = 0.0
            for k in range(nc):
                slopes.returned[i, j] += S_c[i, k] * half[k, j]


@within
def crossing_slopes(omega: Array, f: int, last: float, size: float) -> tuple[float, float]:
    """Slopes of the logarithm of ``crossing`` by the logarithms of ``last`` and ``size``."""
    if f == 0:
        return 0.0, 1 / (1 - size**2)
    span = math.log(last / size)
    share = math.log(last / HALF) / span
    wide = math.log(omega[f] / omega[f - 1]) / span
    return (1 - share) * wide, share * wide
