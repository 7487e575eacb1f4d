"""Time laws: how fast a path is run through, as fast as limits of speed and acceleration allow.

With b = σ̇² and σ̈ = a constant between points of the path, b is piecewise linear in σ: b_{k+1} =
b_k + 2 a_k Δσ. Limits that are affine in (a, b) make the fastest law a linear programme: of all
laws that keep them the one with the largest Σ b (Verscheure et al. 2009; Pham and Pham 2018).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import ArmDesignError
from armdesign.motion.path_limits import PathLimits


@dataclass(frozen=True, eq=False)
class TimeLaw(ReadOnly):
    """Share σ of a path by time; arrays are read-only.

    Attributes:
        times: at which the acceleration changes (n,) [s], from 0.
        sigma: share of the path there (n,), from 0 to 1.
        speed: σ̇ there (n,) [1/s], 0 at both ends.
    """

    times: Array
    sigma: Array
    speed: Array

    @property
    def duration(self) -> float:
        """From rest to rest [s]."""
        return float(self.times[-1])

    def stretched(self, factor: float) -> TimeLaw:
        """The law with all times multiplied: every acceleration falls with its square."""
        return replace(self, times=factor * self.times, speed=self.speed / factor)

    def at(self, time: Array) -> tuple[Array, Array, Array]:
        """σ, σ̇ and σ̈ at times (m,) [s]; at rest before and after."""
        inside = np.clip(time, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.times, inside, side="right") - 1, 0, len(self.times) - 2)
        slope = (np.diff(self.speed) / np.diff(self.times))[k]
        since = inside - self.times[k]
        sigma = self.sigma[k] + since * (self.speed[k] + slope * since / 2)
        moves = (time >= 0) & (time < self.duration)
        return sigma, np.where(moves, self.speed[k] + slope * since, 0.0), slope * moves


def fastest(limits: PathLimits, part: str) -> TimeLaw:
    """The fastest law from rest to rest within limits at the points of a path.

    Raises:
        ArmDesignError: nothing but rest keeps them; ``part`` names what in the message.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_array, diags_array, vstack

    n = len(limits.most)
    step = 1 / (n - 1)
    rise = diags_array([-np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1], shape=(n - 1, n))
    rise = csr_array(rise / (2 * step))  # a of every interval, from b
    matrices, bounds = [], []
    scale = float(np.min(limits.most[np.isfinite(limits.most)]))
    for column in range(limits.a.shape[1]):
        for first in (0, 1):  # an interval's a with b at either of its ends
            rows = np.arange(n - 1) + first
            a, b, c = (part_[rows, column] for part_ in limits[1:])
            size = np.maximum(np.abs(a) / step, np.abs(b)) * scale
            kept = np.isfinite(c) & (size > 1e-9 * c)
            if kept.any():
                at_b = csr_array((b, (np.arange(n - 1), rows)), shape=(n - 1, n))
                both = diags_array(a) @ rise + at_b
                matrices.append((diags_array(1 / c[kept]) @ both[kept]) * scale)
                bounds.append(np.ones(kept.sum()))
    most = limits.most / scale
    most[[0, -1]] = 0.0
    constraints = {"A_ub": vstack(matrices), "b_ub": np.concatenate(bounds)} if matrices else {}
    answer = linprog(-np.ones(n), bounds=[(0.0, float(top)) for top in most], **constraints)
    speed = np.sqrt(np.maximum(scale * answer.x, 0.0)) if answer.success else np.zeros(n)
    if np.any(speed[1:-1] <= 0):
        fault = "nothing but rest keeps the limits of force"
        raise ArmDesignError(part, fault, "give a lighter payload, other poses or a larger share")
    intervals = 2 * step / (speed[1:] + speed[:-1])
    times = np.concatenate([[0.0], np.cumsum(intervals)])
    return TimeLaw(times, np.linspace(0.0, 1.0, n), speed)
