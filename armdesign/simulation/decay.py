"""Modes of an arm that rings by itself: the eigensystem realisation algorithm (Juang & Pappa 1985).

Samples y_k = C A^k x_0 of a free decay fill a Hankel matrix H_0 of y_{i+j} and its neighbour H_1 of y_{i+j+1}. With the
singular values H_0 = U S Vᵀ cut at two per mode, A = S^(−½) Uᵀ H_1 V S^(−½) has the eigenvalues z = exp(λ Δt).

Noise in the samples changes H_0 and H_1, and with the eigenvectors l A = z l, A w = z w, l w = 1, to first order

    δz = l S^(−½) Uᵀ (δH_1 − z δH_0) V S^(−½) w

(U and V change, too, but that cancels where the cut singular values vanish). It is
linear in the samples: each weighs as the convolution of the two vectors about the bracket says. The noise is taken as
independent from sample to sample, as large as what the modes leave of each answer.
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
        frequency_deviations: standard deviation of the frequencies by noise as large as what the modes leave (m,) [Hz].
            It holds noise, not what a swing too large, or a mode too many, makes wrong.
        damping_deviations: that of the damping ratios (m,).
        amplitudes: of every mode in every answer at the record's start (m, outputs).
        singular_values: of the Hankel matrix, largest first: a gap shows how many modes it holds.
        residual: root mean square of what the modes leave of the answers, relative.
    """

    natural_frequencies: Array
    damping_ratios: Array
    frequency_deviations: Array
    damping_deviations: Array
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
    scale = np.abs(signals).max(axis=0)
    if not (np.all(np.isfinite(signals)) and scale.max() > 0):
        raise SimulationError(part, "nothing moves", "raise the amplitude")
    signals = signals / np.where(scale > 0, scale, 1.0)
    order, rows = 2 * modes, min(len(time) // 2, MOST_ROWS)
    if rows < 2 * order:
        raise SimulationError(part, f"{len(time)} records are too few", f"record {4 * order} or more")
    factors, singular, weights = _realised(signals, order, rows)
    roots = np.log(factors.astype(complex)) / step
    shapes, left = _shapes(factors, signals)
    above = np.flatnonzero(roots.imag > 1e-9 / step)
    if len(above) < modes:
        raise SimulationError(part, f"holds {len(above)} modes, not {modes}", "ask for fewer, or record longer")
    above = above[np.argsort(np.abs(roots[above]))]
    noise = np.sqrt((left**2).sum(axis=0) / max(len(left) - order, 1))
    changes = weights[above] * noise / (factors[above] * step)[:, None, None]  # of the roots by every sample
    size = np.abs(roots[above])
    zeta = -roots[above].real / size
    d_size = (changes * (roots[above].conj() / size)[:, None, None]).real
    d_zeta = -(changes.real + zeta[:, None, None] * d_size) / size[:, None, None]
    return Decay(
        natural_frequencies=size / (2 * math.pi),
        damping_ratios=zeta,
        frequency_deviations=np.linalg.norm(d_size, axis=(1, 2)) / (2 * math.pi),
        damping_deviations=np.linalg.norm(d_zeta, axis=(1, 2)),
        amplitudes=2 * np.abs(shapes[above]) * scale,
        singular_values=singular,
        residual=float(np.linalg.norm(left) / np.linalg.norm(signals)),
    )


def _realised(signals: Array, order: int, rows: int) -> tuple[Array, Array, Array]:
    """Factors z by which the modes grow per sample (order,), complex; all singular values; ∂z by every sample.

    The last is (order, n, outputs), complex.
    """
    windows = np.lib.stride_tricks.sliding_window_view(signals, len(signals) - rows, axis=0)  # (rows + 1, outputs, ·)
    first, second = (part.reshape(-1, windows.shape[-1]) for part in (windows[:-1], windows[1:]))
    u, singular, v = np.linalg.svd(first, full_matrices=False)
    root = np.sqrt(np.maximum(singular[:order], 1e-14 * singular[0]))
    factors, right = np.linalg.eig((u[:, :order].T @ second @ v[:order].T) / root[:, None] / root)
    before = (np.linalg.inv(right) / root @ u[:, :order].T).reshape(order, rows, -1)
    after = (right.T / root) @ v[:order]
    weights = np.zeros((order, *signals.shape), dtype=complex)
    for k, (left, tail) in enumerate(zip(before, after, strict=True)):
        for output in range(signals.shape[1]):
            each = np.convolve(left[:, output], tail)
            weights[k, 1:, output] += each
            weights[k, :-1, output] -= factors[k] * each
    return factors, singular, weights


def _shapes(factors: Array, signals: Array) -> tuple[Array, Array]:
    """Share of each factor in each answer (order, outputs), complex, and what they leave (n, outputs)."""
    powers = factors.astype(complex) ** np.arange(len(signals))[:, None]
    shapes = np.linalg.lstsq(powers, signals.astype(complex), rcond=None)[0]
    return shapes, np.abs(signals - powers @ shapes)
