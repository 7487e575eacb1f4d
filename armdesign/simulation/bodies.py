"""Rigid bodies under joint torques, stacked: Pinocchio's forward dynamics, with bars that are no links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import repeat
from typing import Any

import numpy as np

from armdesign.arm import LoadedArm
from armdesign.arrays import Array
from armdesign.units import GRAVITY


class Bodies:
    """Loaded arms of one shape: axis 0 is the case; one arm alone serves any number of cases.

    Args:
        arms: one per case, or one for all; the order of the joints is the same in all of them.
    """

    def __init__(self, arms: Sequence[LoadedArm]) -> None:
        import pinocchio

        self._library, self._arm = pinocchio, arms[0]
        self._models = [loaded.model() for loaded in arms]
        self._data = [model.createData() for model in self._models]
        self._order = arms[0].arm.model_order
        self._same = bool(np.all(self._order == np.arange(len(self._order))))

    def acceleration(self, q: Array, velocity: Array, torque: Array) -> Array:
        """q̈ = M⁻¹(τ − h) (n, nq) by the articulated-body algorithm, h: Coriolis, centrifugal and gravity terms."""
        aba, rows = self._library.aba, zip(*(self._ordered(x) for x in (q, velocity, torque)), strict=True)
        found = np.array([aba(model, data, *row) for (model, data), row in zip(self._pairs(q), rows, strict=True)])
        return found if self._same else found[:, self._order]

    def with_bars(self, q: Array, velocity: Array, torque: Array, bar_mass: Array, bar_force: Array) -> Array:
        """The same with what bars add to M (n, nq, nq) and to h (n, nq): M by composite bodies, h by Newton–Euler."""
        mass, force = np.empty(bar_mass.shape), np.empty(bar_force.shape)
        rows = zip(self._pairs(q), self._ordered(q), self._ordered(velocity), strict=True)
        for row, ((model, data), at, speed) in enumerate(rows):
            mass[row] = self._library.crba(model, data, at)
            force[row] = self._library.nonLinearEffects(model, data, at, speed)
        mass = np.triu(mass) + np.swapaxes(np.triu(mass, 1), 1, 2)  # crba fills the upper triangle only
        if not self._same:
            mass, force = mass[np.ix_(np.arange(len(q)), self._order, self._order)], force[:, self._order]
        return np.asarray(np.linalg.solve(mass + bar_mass, (torque - force - bar_force)[:, :, None])[:, :, 0])

    def energy(self, q: Array, velocity: Array) -> Array:
        """Kinetic and potential energy [J] of links, payload and bars of one loaded arm at states (m, nq)."""
        model, data, library = self._models[0], self._data[0], self._library
        total = np.zeros(len(q))
        for row, (at, speed) in enumerate(zip(self._ordered(q), self._ordered(velocity), strict=True)):
            total[row] = library.computeKineticEnergy(model, data, at, speed)
            total[row] += library.computePotentialEnergy(model, data, at)
        points = self._arm.points(self._arm.arm.kinematics(q)) if self._arm.points else []
        for m, point in points:
            moved = np.einsum("nji,nj->ni", point.first, velocity)
            total += m * (0.5 * np.einsum("ni,ni->n", moved, moved) + GRAVITY * point.value[:, 2])
        return total

    def _pairs(self, q: Array) -> Iterable[tuple[Any, Any]]:
        """Model and scratch data of each case."""
        pairs = zip(self._models, self._data, strict=True)
        return repeat(next(pairs), len(q)) if len(self._models) == 1 else pairs

    def _ordered(self, values: Array) -> Array:
        """Rows in the order of the model."""
        if self._same:
            return values
        ordered = np.empty_like(values)
        ordered[:, self._order] = values
        return ordered
