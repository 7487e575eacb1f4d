"""Brute force: the best point of a grid that zooms in, and the areas that requirements allow."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from armdesign.design.program.problem import Problem

ROUNDING = 1e-12
Values = Callable[[np.ndarray], np.ndarray]


def zoomed_best(
    value: Values, low: np.ndarray, high: np.ndarray, *, points: int, levels: int, shrink: float
) -> tuple[float, float]:
    """Largest value over a grid on low ≤ x ≤ high that shrinks about its best point.

    Args:
        value: of points x (n, nx): (n,), −inf where a point is not allowed.
        low: lower ends (nx,).
        high: upper ends.
        points: of the grid along each axis.
        levels: number of grids.
        shrink: size of a grid over the size of the one before.

    Returns:
        The value, and the largest step of the last grid.
    """
    ends, best, centre = (low, high), -math.inf, (low + high) / 2
    for _ in range(levels):
        axes = [np.linspace(a, b, points) for a, b in zip(*ends, strict=True)]
        x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
        values = np.concatenate([value(part) for part in np.array_split(x, 1 + len(x) // 4000)])
        if values.max() > best:
            best, centre = float(values.max()), x[values.argmax()]
        reach = shrink * (ends[1] - ends[0]) / 2
        ends = (np.maximum(centre - reach, low), np.minimum(centre + reach, high))
    return best, float((ends[1] - ends[0]).max() / (points - 1))


def where_allowed(problem: Problem, worst: Values) -> Values:
    """The worst ω² of areas over today's (n, 2 nc); −inf beyond oil, thrust, Euler's limits."""
    cylinders, r = problem.machine.cylinders, problem.requirements
    today = np.array([[c.bore_area, c.annulus_area] for c in cylinders])
    strokes = np.array([c.stroke for c in cylinders])

    def value(x: np.ndarray) -> np.ndarray:
        areas = x.reshape(-1, *today.shape) * today
        volume, before = areas * strokes[:, None], today * strokes[:, None]
        more, less = 1 + ROUNDING, 1 - ROUNDING
        good = np.all(volume <= r.oil_each_share * before * more, axis=(1, 2))
        total = r.oil_total_share * before.sum(axis=0) * more
        good &= np.all(volume.sum(axis=1) <= total, axis=1)
        good &= np.all(areas[:, :, 0] <= r.thrust_share * today[:, 0] * more, axis=1)
        rod, rod_today = areas[:, :, 0] - areas[:, :, 1], today[:, 0] - today[:, 1]
        euler = rod_today**2 / today[:, 0] * less
        good &= np.all((rod**2 / areas[:, :, 0] >= euler) & (rod > 0), axis=1)
        values = np.full(len(x), -math.inf)
        values[good] = worst(x[good])
        return values

    return value
