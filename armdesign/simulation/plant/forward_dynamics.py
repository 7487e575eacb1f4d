"""Forward dynamics of rigid bodies, stacked: Pinocchio's, with bars that are no links."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.arm import LoadedArm
from armdesign.mechanism.jets import VectorJet
from armdesign.simulation.plant.compiled import compiled
from armdesign.simulation.plant.kinematics import BarLoads
from armdesign.transaction import undisturbed
from armdesign.units import GRAVITY

COMPLEX_STEP = 1e-30


class ForwardDynamics:
    """Loaded arms of one shape: axis 0 is the case; one arm alone serves any number of cases.

    Args:
        arms: one per case, or one for all; the order of the joints is the same in all of them.
    """

    def __init__(self, arms: Sequence[LoadedArm]) -> None:
        with undisturbed():
            import pinocchio

        self._library, self._arm = pinocchio, arms[0]
        models = [loaded.model() for loaded in arms]
        self._pairs = [(model, model.createData()) for model in models]
        self._order = arms[0].arm.model_order
        self._same = bool(np.all(self._order == np.arange(len(self._order))))

    def acceleration(
        self, q: Array, velocity: Array, torque: Array, bars: BarLoads | None = None
    ) -> Array:
        """Joint accelerations M⁻¹(τ − h) (n, nq), h: Coriolis, centrifugal and gravity terms.

        By the articulated-body algorithm. With what bars add to M (n, nq, nq) and to h (n, nq), M
        is computed by composite bodies and h by Newton and Euler's recursion, and the sums are
        solved.
        """
        if not self._same:
            q, velocity = self._ordered(q), self._ordered(velocity)
        pairs, acceleration = cycle(self._pairs), np.empty(q.shape)
        if bars is None:
            aba, pushes = self._library.aba, torque if self._same else self._ordered(torque)
            for row, ((model, data), at, speed, push) in enumerate(
                zip(pairs, q, velocity, pushes, strict=False)
            ):
                acceleration[row] = aba(model, data, at, speed, push)
            return acceleration if self._same else acceleration[:, self._order]
        mass, force = np.empty(bars.mass.shape), np.empty(q.shape)
        for row, ((model, data), at, speed) in enumerate(zip(pairs, q, velocity, strict=False)):
            mass[row] = self._library.crba(model, data, at)
            force[row] = self._library.nonLinearEffects(model, data, at, speed)
        _solve(mass, force, self._order, bars, torque, acceleration)
        return acceleration

    def resistance(self, q: Array, velocity: Array) -> Array:
        """Coriolis, centrifugal and gravity forces h (n, k) of one arm and its bars."""
        (model, data), force = self._pairs[0], np.empty(q.shape)
        states = zip(self._ordered(q), self._ordered(velocity), strict=True)
        for row, (at, speed) in enumerate(states):
            force[row] = self._library.nonLinearEffects(model, data, at, speed)
        bars = self._bars(q)
        return force[:, self._order] + sum(_held(m, p, velocity) for m, p in bars)

    def resistance_slopes(self, q: Array, velocity: Array) -> tuple[Array, Array]:
        """∂h/∂q and ∂h/∂q̇ (n, k, k) of one arm and its bars.

        Of the links by Pinocchio, of the bars by a complex step, exact to rounding.
        """
        (model, data), (n, k) = self._pairs[0], q.shape
        by_place, by_speed, no_acceleration = np.empty((n, k, k)), np.empty((n, k, k)), np.zeros(k)
        states = zip(self._ordered(q), self._ordered(velocity), strict=True)
        for row, (at, speed) in enumerate(states):
            self._library.computeRNEADerivatives(model, data, at, speed, no_acceleration)
            by_place[row], by_speed[row] = data.dtau_dq, data.dtau_dv
        pick = np.ix_(np.arange(n), self._order, self._order)
        by_place, by_speed = by_place[pick], by_speed[pick]
        for m, point in self._bars(q):
            rates = np.einsum("nkli,nl->nki", point.second, velocity)
            by_speed += 2 * m * (point.first @ np.swapaxes(rates, 1, 2))
        for j in range(k if self._arm.points else 0):
            stepped = q + COMPLEX_STEP * 1j * np.eye(k)[j]
            for m, point in self._bars(stepped):
                by_place[:, :, j] += np.imag(_held(m, point, velocity)) / COMPLEX_STEP
        return by_place, by_speed

    def _bars(self, q: Array) -> list[tuple[float, VectorJet]]:
        """Point masses [kg] in place of the bars."""
        return self._arm.points(self._arm.arm.kinematics(q)) if self._arm.points else []

    def energy(self, q: Array, velocity: Array) -> Array:
        """Kinetic and potential energy (m,) [J] of links, payload and bars of one arm."""
        (model, data), library = self._pairs[0], self._library
        total = np.zeros(len(q))
        for row, (at, speed) in enumerate(
            zip(self._ordered(q), self._ordered(velocity), strict=True)
        ):
            total[row] = library.computeMechanicalEnergy(model, data, at, speed)
        for m, point in self._bars(q):
            moved = np.einsum("nji,nj->ni", point.first, velocity)
            total += m * (0.5 * np.einsum("ni,ni->n", moved, moved) + GRAVITY * point.value[:, 2])
        return total

    def _ordered(self, values: Array) -> Array:
        """Rows in the order of the model."""
        ordered = np.empty_like(values)
        ordered[:, self._order] = values
        return ordered


def _held(mass: float, point: VectorJet, velocity: Array) -> Array:
    """Joint torques of a point mass [kg] that moves at constant joint speeds (n, k)."""
    pull = curvature(point, velocity)
    pull[:, 2] += GRAVITY
    return np.asarray(mass * (point.first @ pull[:, :, None])[..., 0])


def curvature(point: VectorJet, velocity: Array) -> Array:
    """Acceleration of a point (n, 3) at constant joint speeds (n, k)."""
    return np.einsum("nkli,nk,nl->ni", point.second, velocity, velocity)


@compiled
def _solve(
    mass: Array, force: Array, order: Array, bars: BarLoads, torque: Array, acceleration: Array
) -> None:
    """Write (M + M_bars)⁻¹(τ − h − h_bars) of every case; Pinocchio fills M's upper triangle."""
    for case in range(len(acceleration)):
        whole, net = bars.mass[case].copy(), torque[case] - bars.force[case]
        for j in range(len(order)):
            net[j] -= force[case, order[j]]
            for k in range(len(order)):
                whole[j, k] += mass[case, min(order[j], order[k]), max(order[j], order[k])]
        finite = math.isfinite(whole.sum() + net.sum())
        acceleration[case] = np.linalg.solve(whole, net) if finite else np.full(len(order), np.nan)
