"""Closed loops in time: settling after a step, the error of a move at constant speed."""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loops import Loops

WITHIN = 0.02  # of the step
NOTABLE = 0.01  # residue, in the step, of a pole that shows
SLOW = 0.05  # s over the smallest K
SLOW_POLE = 0.2  # damping ratio: a pole that shows and is damped less peaks in |T| above
ALIKE = 6.0  # rad: delays that differ by less take as many states
HALVINGS = 40  # of the time that may pass
CREEP = 1e-6  # [ω_1] poles of pressures that move nothing


def settling_time(plant: LoopPlant, controller: Controller) -> Array:
    """Settling time (n,) [s] after which a step of any joint is within 2 %; inf if unstable.

    A pole λ shows with its residue C v w B/λ, v and w its right and left eigenvectors, and one of
    a pair with twice that. What all of them leave, each at its largest, is within 2 %: an upper
    bound. Pressures that creep apart of themselves, to the right, do not count, nor does what
    grows but hardly shows.
    """
    if not plant.delay:
        return _settling_time(plant, controller, None)
    turns, settles = _heard(plant, controller) * plant.delay, np.empty(len(plant))
    steps = np.ceil(turns / ALIKE)
    for step in np.unique(steps):  # poses whose delay takes as many states
        rows = np.flatnonzero(steps == step)
        settles[rows] = _settling_time(plant[rows], controller[rows], step * ALIKE)
    return settles


def _settling_time(plant: LoopPlant, controller: Controller, turns: float | None) -> Array:
    A, B, C = closed_loop(plant, controller, turns)
    poles, right = np.linalg.eig(A)
    try:
        left = np.linalg.solve(right, B.astype(complex))
    except np.linalg.LinAlgError:  # eigenvectors that are not independent
        left = np.linalg.pinv(right) @ B
    counts = np.abs(poles) > CREEP * plant.omega[:, None]
    residues = (C @ right)[:, :, :] * np.swapaxes(left, 1, 2)  # (n, nq, m): own response
    shown = np.abs(residues / np.where(counts, poles, 1.0)[:, None])  # (n, nq, m)
    counts &= (poles.real < 0) | (poles.real > plant.fastest_creep[:, None])
    grows = counts & (poles.real >= 0)
    unstable = (grows[:, None] & (shown > NOTABLE)).any(axis=(1, 2))
    begins = np.where(poles.imag == 0, 1.0, 2.0)[:, None] * shown
    begins *= (counts & ~grows)[:, None]
    return np.where(unstable, np.inf, _within(begins, np.maximum(-poles.real, 0.0)))


def _within(begins: Array, decay: Array) -> Array:
    """Time (n,) [s] from which Σ begins exp(−decay t) is within 2 %, of the slowest joint.

    Args:
        begins: of each joint and pole (n, nq, m).
        decay: of the poles (n, m) [1/s].
    """
    low, shares = np.zeros(len(decay)), np.maximum(begins * begins.shape[2] / WITHIN, 1.0)
    slow = np.where(decay > 0, decay, np.inf)[:, None]
    high = (np.log(shares) / slow).max(axis=(1, 2))  # each leaves its share of the 2 % at most
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        left = (begins * np.exp(-decay * middle[:, None])[:, None]).sum(axis=2).max(axis=1)
        low, high = np.where(left > WITHIN, middle, low), np.where(left > WITHIN, high, middle)
    return high


def _heard(plant: LoopPlant, controller: Controller) -> Array:
    """Frequency (n,) [rad/s] beyond which no pole shows in a step, unless it decays fast."""
    loops = Loops.of(plant)
    loud = np.abs(loops.closed(controller).followed).max(axis=1) > NOTABLE / SLOW_POLE
    return np.asarray(np.where(loud, loops.omega, 0.0).max(axis=1))


def tracking_error(plant: LoopPlant, controller: Controller) -> Array:
    """Error of a move of each joint at constant speed over that speed (n, nq) [s].

    s/(1 − T(s)) of a reference that swings with some ten time constants 1/K, so that leakage,
    which drifts for hours, does not count; its real part is K, less what gravity's stiffness and
    the filters take. Without feed-forward; inf without gains.
    """
    slowest = np.where(controller.position > 0, controller.position, np.inf).min(axis=1)
    omega = SLOW * np.where(np.isfinite(slowest), slowest, 1.0)[:, None]
    missed = 1 - Loops.at(plant, omega).closed(controller).followed[:, :, 0]
    gain = np.real(1j * omega * missed.conj()) / np.maximum(np.abs(missed) ** 2, 1e-24)
    with np.errstate(divide="ignore"):
        return np.where(controller.position > 0, 1 / np.abs(gain), np.inf)
