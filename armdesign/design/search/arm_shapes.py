"""Linkages whose moment arms differ in shape: starts from which a search finds other optima.

Optima of four-bars are separate where the way from one to the other leads through a small moment
arm: an arm that falls over the joint's range does not turn into one with a hump. So it is shapes,
r(q) over its mean, that starts have to cover, not the box of pins and bars, in most of which the
arm has a dead centre or nearly so.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.problem import Problem

LINKAGES = 4096  # linkages, evenly over their box
LEAST = 0.5  # of today's smallest arm, of linkages that count
PLACES = 10  # steps between poses of the joint's range where shapes are compared


def linkages_of_every_shape(problem: Problem, i: int, count: int) -> list[Array]:
    """Designs x, today's but for the linkage of cylinder ``i``, of at most ``count`` shapes.

    Shapes are compared by ln(r/mean); each is the one farthest from all before it, the first of
    them from today's. Fewer, or none, where not so many linkages close and keep half of today's
    smallest arm. The answer depends on the problem alone.
    """
    from scipy.stats import qmc

    entries = np.array(list(problem.vector.moves(i)))
    low, high = (end[entries] for end in problem.bounds)
    designs, arms = [problem.vector.start], [problem.vector.arms_today[i]]
    for share in qmc.Sobol(len(entries), scramble=False).random(LINKAGES):
        x = problem.vector.start.copy()
        x[entries] = low + share * (high - low)
        arm = _moment_arm(problem, i, x)
        if np.all(arm / np.sign(arms[0]) >= LEAST * np.abs(arms[0]).min()):  # NaN: does not close
            designs.append(x)
            arms.append(arm)
    shape = np.log(np.abs(np.stack(arms)[:, :: max(1, len(arms[0]) // PLACES)]))
    shape -= shape.mean(axis=1, keepdims=True)
    chosen, distance = [0], np.full(len(shape), np.inf)
    while len(chosen) <= min(count, len(shape) - 1):
        distance = np.minimum(distance, np.linalg.norm(shape - shape[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return [designs[k] for k in chosen[1:]]


@np.errstate(invalid="ignore", divide="ignore")
def _moment_arm(problem: Problem, i: int, x: Array) -> Array:
    """Moment arm over the joint's range [m/rad]; NaN where the linkage does not close."""
    linkage, poses = problem.vector.linkages(x)[i], problem.vector.range_poses[i]
    assert poses is not None
    return linkage.actuation(poses).moment_arm[:, linkage.joints[0]]
