"""Modes of an arm that rings by itself: the eigensystem realisation algorithm (Juang & Pappa 1985).

Samples y_k = C A^k x_0 of a free decay fill a Hankel matrix H_0 of y_{i+j} and its neighbour H_1 of y_{i+j+1}. With the
singular values H_0 = U S Vᵀ cut at two per mode, A = S^(−½) Uᵀ H_1 V S^(−½) has the eigenvalues exp(λ Δt).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import SimulationError

MOST_ROWS = 400  # of the Hankel matrix


@dataclass(frozen=True, eq=False)
class Decay:
    """Modes of a free decay; arrays are read-only.

    Attributes:
        natural_frequencies: (m,) ascending [Hz].
        damping_ratios: (m,).
        amplitudes: of every mode in every answer at the record's start (m, outputs).
        singular_values: of the Hankel matrix, largest first: a gap shows how many modes it holds.
        residual: root mean square of what the modes leave of the answers, relative.
    """

    natural_frequencies: Array
    damping_ratios: Array
    amplitudes: Array
    singular_values: Array
    residual: float

    def __post_init__(self) -> None:
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)


def identify_decay(time: Array, answers: Array, modes: int = 1, part: str = "decay") -> Decay:
    """Natural frequencies and damping ratios of the ``modes`` that a free decay holds.

    Args:
        time: even instants (n,) [s], after the excitation has ended.
        answers: what rings about zero, like speeds: (n,) or (n, outputs).
        modes: how many modes it holds; a constant is none and has to be taken off before.
        part: name of the record for messages.

    Raises:
        SimulationError: the record is too short, nothing moves, or fewer modes oscillate.
    """
    step, signals = float(time[1] - time[0]), np.asarray(answers, dtype=float).reshape(len(time), -1)
    size = np.abs(signals).max(axis=0)
    if not (np.all(np.isfinite(signals)) and size.max() > 0):
        raise SimulationError(part, "nothing moves", "raise the amplitude")
    signals = signals / np.where(size > 0, size, 1.0)
    order, rows = 2 * modes, min(len(time) // 2, MOST_ROWS)
    if rows < 2 * order:
        raise SimulationError(part, f"{len(time)} records are too few", f"record {4 * order} or more")
    factors, singular = _realised(signals, order, rows)
    roots = np.log(factors.astype(complex)) / step
    shapes, residual = _shapes(factors, signals)
    above = np.flatnonzero(roots.imag > 1e-9 / step)
    if len(above) < modes:
        raise SimulationError(part, f"holds {len(above)} modes, not {modes}", "ask for fewer, or record longer")
    above = above[np.argsort(np.abs(roots[above]))]
    return Decay(
        natural_frequencies=np.abs(roots[above]) / (2 * math.pi),
        damping_ratios=-roots[above].real / np.abs(roots[above]),
        amplitudes=2 * np.abs(shapes[above]) * size,
        singular_values=singular,
        residual=residual,
    )


def _realised(signals: Array, order: int, rows: int) -> tuple[Array, Array]:
    """Factors by which the modes grow per sample (order,), complex, and all singular values."""
    windows = np.lib.stride_tricks.sliding_window_view(signals, len(signals) - rows, axis=0)  # (rows + 1, outputs, ·)
    first, second = (part.reshape(-1, windows.shape[-1]) for part in (windows[:-1], windows[1:]))
    u, singular, v = np.linalg.svd(first, full_matrices=False)
    root = np.sqrt(np.maximum(singular[:order], 1e-14 * singular[0]))
    return np.linalg.eigvals((u[:, :order].T @ second @ v[:order].T) / root[:, None] / root), singular


def _shapes(factors: Array, signals: Array) -> tuple[Array, float]:
    """Share of each factor in each answer (order, outputs), complex, and what they leave, relative."""
    powers = factors.astype(complex) ** np.arange(len(signals))[:, None]
    shapes = np.linalg.lstsq(powers, signals.astype(complex), rcond=None)[0]
    left = np.abs(signals - powers @ shapes)
    return shapes, float(np.linalg.norm(left) / np.linalg.norm(signals))
