"""What a small swing sees of a spool that passes more oil to one side than to the other.

The controller gives a demand v the spool c = s(v) v, with an s of its own for either side, and the
open spool x moves the piston with x/s(x). Between c and x lies the spool's lag G, which knows of
no sides. A slow swing is passed as by G alone. A fast one is not: c has a mean, 2/π of half of the
difference of both s, which G passes whole, while it passes little of the swing. The spool then
swings beside its middle and in the end on one side alone, where its gain is not the mean of both.
All of this is as large as the swing, so that no swing is too small for it.

    c(θ) = s(sin θ) sin θ,   x = Σ G(jkω) c_k e^{jkθ},   N = first harmonic of x/s(x) over sin θ

N(jω) is the describing function of the valve (Gelb, Vander Velde 1968). N/G is 1 up to half of
the spool's natural frequency, and falls to the mean s over the larger one, above ½; for sides of
1 : 7 with 5° of phase at most. Loops that keep 6 dB stay stable with that. Pistons drift by the
mean of x/s(x). Position loops answer that, within 1/K, by a demand that brings the mean back to 0:
then N is nearer to G.

What is over before it has swung, with a damping ratio above √½, has no describing function: its
pole is the linear one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.loop_plant import LoopPlant

POINTS = 64  # of a period
CREEP = 1e-3  # [ω_1] what swings slower is drift


class Passed(NamedTuple):
    """What valves pass of demands sin θ + mean."""

    share: Array  # N/G (n, m, nc)
    speed: Array  # mean speed of the pistons, by the amplitude of the demand (n, m, nc)


def passed(plant: LoopPlant, omega: Array, mean: Array | float = 0.0) -> Passed:
    """What the valves pass at frequencies of each pose (n, m) [rad/s].

    Args:
        plant: of n poses.
        omega: frequencies.
        mean: of the demands, by their amplitude (n, m, nc); 0 where a swing has just begun.
    """
    sine = np.sin(2 * np.pi * np.arange(POINTS) / POINTS)
    harmonics = omega[:, :, None] * np.arange(POINTS // 2 + 1)
    lags = np.swapaxes(plant.spool(1j * harmonics), 2, 3)  # (n, m, nc, k)
    extend, retract = np.moveaxis(plant.sides, 2, 0)[:, :, None, :, None]
    demand = sine + np.broadcast_to(mean, lags.shape[:3])[..., None]
    command = np.where(demand > 0, extend, retract) * demand
    spools = np.fft.irfft(np.fft.rfft(command) * lags, POINTS)
    speeds = np.fft.rfft(spools / np.where(spools > 0, extend, retract))
    first = speeds[..., 1] / np.fft.rfft(sine)[1]
    return Passed(np.asarray(first / lags[..., 1]), np.asarray(speeds[..., 0].real / POINTS))


def swings(plant: LoopPlant, controller: Controller, count: int | None = None) -> Array:
    """Poles of the closed loops (n, m) [rad/s] of small swings that begin, the least damped first.

    To first order in N/G − 1, and for each that lasts with the N of its own frequency; NaN in
    place of poles that only creep.

    Args:
        plant: of n poses.
        controller: of them.
        count: m, of the poles with the least damping ratio; None: all.
    """
    poles, right = np.linalg.eig(closed_loop(plant, controller)[0])
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:  # eigenvectors that are not independent
        left = np.linalg.pinv(right)
    swinging = poles.imag > CREEP * plant.omega[:, None]
    ratio = np.where(swinging, -poles.real / np.where(swinging, np.abs(poles), 1.0), np.inf)
    order = np.argsort(ratio, axis=1)[:, :count]
    ns, nc = plant.B.shape[1:]
    moved = np.take_along_axis(np.swapaxes(right[:, ns : ns + nc], 1, 2), order[..., None], axis=1)
    seen = np.take_along_axis(left[:, :, :ns], order[..., None], axis=1) @ plant.B
    poles, swinging = (np.take_along_axis(each, order, axis=1) for each in (poles, swinging))
    more = passed(plant, np.abs(poles.imag)).share - 1
    changed = np.where(lasts(poles), (seen * more * moved).sum(axis=2), 0.0)
    return np.where(swinging, poles + changed, np.nan)


def lasts(pole: Array) -> Flags:
    """Whether swings last for a period: at least e^−2π of their amplitude is left then."""
    return np.abs(pole.real) < np.abs(pole.imag)


def least_damping(plant: LoopPlant, controller: Controller) -> Array:
    """Damping ratio (n,) of the least damped small swing of the closed loops, once it begins.

    1 where none swings.
    """
    poles = swings(plant, controller, count=plant.frequencies.shape[1])
    ratios = np.where(np.isnan(poles), 1.0, -poles.real / np.abs(poles))
    return np.asarray(ratios.min(axis=1))
