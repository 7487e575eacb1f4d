"""The critical gain: the factor on all position gains at which closed loops become unstable.

With the pressure feedback closed the loops see L_p(jω), whose eigenvalues μ(jω) are the
characteristic loci (MacFarlane). With all position gains times κ a locus passes −1, and a pole the
imaginary axis, where κ = −1/μ(jω) is a real number: a zero of Im κ(jω), which is a smooth function
even where μ has the resonance of a mode that is hardly damped. It holds behind a delay as well.
Bisection of what ``stable`` tells says near which κ to look, and the least stable pole, or the
frequency at which I + L_c is most nearly singular, near which ω.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loops import Loops
from armdesign.control.stability import stability, stable
from armdesign.control.uneven_spools import CREEP

MOST_CRITICAL, BISECTIONS = 8.0, 6
STEPS, SMALL = 6, 1e-6  # of Newton's method, and the frequency's step for its slope
NEAR = 0.2  # share by which a crossing may lie off what bisection has found, or it is another


def critical_factor(plant: LoopPlant, controller: Controller) -> Array:
    """Factor on all position gains at which each loop becomes unstable (n,).

    At most ``MOST_CRITICAL``; 0 where the gains are 0.
    """
    n = len(plant)
    low, high = np.ones(n), np.full(n, MOST_CRITICAL)
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        holds = stable(plant, _raised(controller, middle))
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    about = np.sqrt(low * high)
    found = np.flatnonzero((high < MOST_CRITICAL) & controller.position.any(axis=1))
    about[high == MOST_CRITICAL] = MOST_CRITICAL
    about[found] = _exact(plant[found], controller[found], about[found])
    return np.where(controller.position.any(axis=1), about, 0.0)


def _raised(controller: Controller, factor: Array) -> Controller:
    return replace(controller, position=controller.position * factor[:, None])


def _exact(plant: LoopPlant, controller: Controller, about: Array) -> Array:
    """The least factor (n,) at which a locus passes −1, near the one that bisection has found."""
    starts = _ringing(plant, _raised(controller, about))
    found = [_passing(plant, controller, about, omega) for omega in starts.T]
    least = np.min(found, axis=0)
    return np.where(np.isfinite(least), least, about)


def _passing(plant: LoopPlant, controller: Controller, about: Array, omega: Array) -> Array:
    """A factor (n,) at which a locus passes −1, from frequencies (n,) on; inf: none is near."""
    factor = about + 0j
    for _ in range(STEPS):
        factor, further = (
            _factor(plant, controller, omega * step, factor) for step in (1.0, 1.0 + SMALL)
        )
        slope = (further - factor).imag
        share = np.where(slope != 0, SMALL * factor.imag / np.where(slope != 0, slope, 1.0), 0.0)
        omega = omega * (1 - np.clip(share, -0.1, 0.1))
    passes = (np.abs(factor.imag) < SMALL * about) & (np.abs(factor / about - 1) < NEAR)
    return np.where(passes, factor.real, np.inf)


def _ringing(plant: LoopPlant, controller: Controller) -> Array:
    """Frequencies (n, m) [rad/s] at which loops that are hardly stable ring most."""
    m = plant.joints
    if not plant.delay:
        poles = np.linalg.eigvals(closed_loop(plant, controller)[0])
        swinging = poles.imag > CREEP * plant.omega[:, None]
        least = np.argsort(np.where(swinging, -poles.real, np.inf), axis=1)[:, :m]
        return np.maximum(np.take_along_axis(poles.imag, least, axis=1), CREEP)
    omega = stability(plant, controller).ringing
    singular = np.abs(np.linalg.det(Loops.at(plant, omega).returned(controller)))
    return np.take_along_axis(omega, np.argsort(singular, axis=1)[:, :m], axis=1)


def _factor(plant: LoopPlant, controller: Controller, omega: Array, near: Array) -> Array:
    """−1/μ (n,) at frequencies (n,) [rad/s], of the locus for which it is nearest to a factor."""
    loops = Loops.at(plant, omega[:, None])
    damped = replace(controller, position=0 * controller.position)
    wanted = plant.moment_arms * controller.position[:, None]
    closed = loops.positions[:, 0] @ np.linalg.solve(loops.returned(damped)[:, 0], wanted + 0j)
    with np.errstate(divide="ignore"):
        factors = -1 / np.linalg.eigvals(closed)
    nearest = np.abs(factors - near[:, None]).argmin(axis=1)
    return np.asarray(np.take_along_axis(factors, nearest[:, None], axis=1)[:, 0])
