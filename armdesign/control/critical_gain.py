"""The critical gain: the factor on all position gains at which closed loops become unstable.

With the pressure feedback closed the loops see L_p(jω), whose eigenvalues μ(jω) are the
characteristic loci (MacFarlane). With all position gains times κ a locus passes −1, and a pole the
imaginary axis, where κ = −1/μ(jω) is a real number: a zero of Im κ(jω), which is a smooth function
even where μ has the resonance of a mode that is hardly damped. It holds behind a delay as well.
Bisection of what ``stable`` tells says between which κ to look, and the least stable pole, or the
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

MOST_CRITICAL = 8.0
BISECTIONS = 6, 8  # before a crossing is sought, and more where none is found between the last two
STEPS, SMALL = 6, 1e-6  # of Newton's method, and the frequency's step for its slope
BESIDE = 0.05  # share by which a crossing may lie beside: what grows as creep does passes


def critical_factor(plant: LoopPlant, controller: Controller) -> Array:
    """Factor on all position gains at which the loops of each pose become unstable (n,).

    At most ``MOST_CRITICAL``; 0 where the gains are 0.
    """
    n = len(plant)
    low, high = _bisected(plant, controller, np.ones(n), np.full(n, MOST_CRITICAL), BISECTIONS[0])
    factor = np.where(high == MOST_CRITICAL, MOST_CRITICAL, 0.0)
    sought = np.flatnonzero((high < MOST_CRITICAL) & controller.position.any(axis=1))
    factor[sought] = _exact(plant[sought], controller[sought], low[sought], high[sought])
    return np.where(controller.position.any(axis=1), factor, 0.0)


def _bisected(
    plant: LoopPlant, controller: Controller, low: Array, high: Array, steps: int
) -> tuple[Array, Array]:
    """Factors (n,) nearer to each other between which loops become unstable."""
    for _ in range(steps):
        middle = np.sqrt(low * high)
        holds = stable(plant, _raised(controller, middle))
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return low, high


def _raised(controller: Controller, factor: Array) -> Controller:
    return replace(controller, position=controller.position * factor[:, None])


def _exact(plant: LoopPlant, controller: Controller, low: Array, high: Array) -> Array:
    """The least factor (n,) at which a locus passes −1 where bisection has found it."""
    about = np.sqrt(low * high)
    starts = _ringing(plant, _raised(controller, about))
    found = np.array([_passing(plant, controller, about, omega) for omega in starts.T])
    beside = (found < (1 - BESIDE) * low) | (found > (1 + BESIDE) * high)
    least = np.where(beside, np.inf, found).min(axis=0)
    missed = np.flatnonzero(np.isinf(least))
    low, high = _bisected(
        plant[missed], controller[missed], low[missed], high[missed], BISECTIONS[1]
    )
    least[missed] = np.sqrt(low * high)
    return np.asarray(least)


def _passing(plant: LoopPlant, controller: Controller, about: Array, omega: Array) -> Array:
    """A factor (n,) at which a locus passes −1, from frequencies (n,) on; inf: none is found."""
    factor = about + 0j
    for _ in range(STEPS):
        factor, further = (
            _factor(plant, controller, omega * step, factor) for step in (1.0, 1.0 + SMALL)
        )
        slope = (further - factor).imag
        share = np.where(slope != 0, SMALL * factor.imag / np.where(slope != 0, slope, 1.0), 0.0)
        omega = omega * (1 - np.clip(share, -0.1, 0.1))
    return np.where(np.abs(factor.imag) < SMALL * about, factor.real, np.inf)


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
    closed = loops.positions[..., 0] @ np.linalg.solve(loops.returned(damped)[:, 0], wanted + 0j)
    with np.errstate(divide="ignore"):
        factors = -1 / np.linalg.eigvals(closed)
    nearest = np.abs(factors - near[:, None]).argmin(axis=1)
    return np.asarray(np.take_along_axis(factors, nearest[:, None], axis=1)[:, 0])
