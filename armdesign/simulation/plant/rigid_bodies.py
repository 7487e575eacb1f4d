"""Forces and energy of rigid bodies in motion: Pinocchio's, with bars that are no links."""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.arm import LoadedArm
from armdesign.mechanism.jets import VectorJet
from armdesign.transaction import undisturbed
from armdesign.units import GRAVITY

COMPLEX_STEP = 1e-30


class RigidBodies:
    """Links, payload and bars of an arm."""

    def __init__(self, loaded: LoadedArm) -> None:
        with undisturbed():
            import pinocchio

        self._library, self._arm, self._model = pinocchio, loaded, loaded.model()
        self._data, self._order = self._model.createData(), loaded.arm.model_order

    def resistance(self, q: Array, velocity: Array) -> Array:
        """Coriolis, centrifugal and gravity forces h (n, k)."""
        model, data, force = self._model, self._data, np.empty(q.shape)
        states = zip(self._ordered(q), self._ordered(velocity), strict=True)
        for row, (at, speed) in enumerate(states):
            force[row] = self._library.nonLinearEffects(model, data, at, speed)
        bars = self._bars(q)
        return force[:, self._order] + sum(_held(m, p, velocity) for m, p in bars)

    def resistance_slopes(self, q: Array, velocity: Array) -> tuple[Array, Array]:
        """∂h/∂q and ∂h/∂q̇ (n, k, k).

        Of the links by Pinocchio, of the bars by a complex step, exact to rounding.
        """
        model, data, (n, k) = self._model, self._data, q.shape
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
        """Kinetic and potential energy (m,) [J] of links, payload and bars."""
        model, data, library = self._model, self._data, self._library
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
