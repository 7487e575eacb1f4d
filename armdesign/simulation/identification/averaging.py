"""Modes averaged over likely answers, with their deviations.

A mode that the output hardly shows may lie below its neighbour in one answer and above it in
another; the neighbour is the second mode of the first answer and the first of the second. So the
modes of each answer are paired with the likeliest answer's, in the order that is likeliest by the
normal laws of both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.simulation.identification.residual_terms import Answer

LEAST_VARIANCE = 1e-24  # of ω and ζ: rounding


class Averaged(NamedTuple):
    """ω and ζ of modes (m, 2), ascending, ω relative to the band's middle."""

    mean: Array
    deviations: Array  # standard deviations
    remainders: Array  # part of them that noise does not cause


def averaged(fits: list[Answer], weights: Array) -> Averaged:
    """The modes in the mean of answers of some weights (i,), and how far they may be off.

    Their variance is that of every answer, and that among the answers.
    """
    modes = fits[0].modes
    poles = np.array([one.poles[:modes] for one in fits])
    within, noise = (
        np.array([np.diag(each).reshape(-1, 2) for each in parts])
        for parts in ([one.covariance for one in fits], [one.noise for one in fits])
    )
    order = _pairs(poles, within, int(np.argmax(weights)))
    poles, within, noise = (
        np.take_along_axis(each, order[:, :, None], axis=1) for each in (poles, within, noise)
    )
    mean = np.einsum("i,ijk->jk", weights, poles)
    variance, of_noise = (
        np.einsum("i,ijk->jk", weights, each) for each in (within + (poles - mean) ** 2, noise)
    )
    ascending = np.argsort(mean[:, 0])
    left = np.sqrt(np.maximum(variance - of_noise, 0))
    return Averaged(mean[ascending], np.sqrt(variance)[ascending], left[ascending])


def _pairs(poles: Array, variances: Array, likeliest: int) -> Array:
    """Order of each answer's modes (i, m) that pairs them with those of the likeliest one."""
    from scipy.optimize import linear_sum_assignment

    apart = poles[:, None] - poles[likeliest][:, None]  # (i, of the likeliest, of the answer, 2)
    both = variances[:, None] + variances[likeliest][:, None] + LEAST_VARIANCE
    unlikely = np.sum(apart**2 / both + np.log(both), axis=3)
    return np.array([linear_sum_assignment(costs)[1] for costs in unlikely])
