"""Derivatives of the lowest natural frequency of a rival by numbers of the machine file.

    ∂ω²/∂p = vᵀ (∂K/∂p − ω² ∂M/∂p) v,  vᵀ M v = 1,  ∂f/∂p = ∂ω²/∂p / (8 π² f)

∂K and ∂M come by a complex step along each number: exact. Where the lowest modes coincide, V holds
all of them, and upwards the lowest, downwards the greatest eigenvalue of Vᵀ (∂K − ω² ∂M) V counts
(Seyranian, Lund and Olhoff 1994). To it comes by what the pose follows its ends (``ends.py``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.modes import inverse_cholesky
from armdesign.influence.family import Family, can_matter, moves_the_arm, rebuilt
from armdesign.influence.rivals import Rival
from armdesign.machine.file.numbers import Number
from armdesign.machine.machine import Machine

STEP = 1e-30  # complex step, in the file's unit over the number's size
CLUSTER = 1e-7  # eigenvalues this near, relative, are one
DIFFERENCE = 1e-3  # step of differences for numbers that move links, in the file's unit
# steps and weights over 12 of differences of fourth order
CENTRAL = (-2, -1, 1, 2), (1, -8, 8, -1)
ONE_SIDED = (0, 1, 2, 3, 4), (-25, 48, -36, 16, -3)


def slopes(machine: Machine, rival: Rival, numbers: Sequence[Number]) -> Array:
    """Derivatives (k, 2) of a rival's frequency [Hz per unit of the file], upwards and downwards.

    By a complex step; by differences of fourth order for frozen joints, springs at rest and
    ``[links]``, which move links.
    """
    result = np.zeros((len(numbers), 2))
    stepped = [i for i, number in enumerate(numbers) if can_matter(number.location)]
    if stepped:
        result[stepped] = _by_complex_step(machine, rival, [numbers[i] for i in stepped])
    for i, number in enumerate(numbers):
        if moves_the_arm(number.location):
            result[i] = _by_differences(machine, rival, number)
        result[i] -= rival.ends.multipliers @ rival.ends.by_other_keys(number.location)
    return result


def _by_complex_step(machine: Machine, rival: Rival, numbers: Sequence[Number]) -> Array:
    """Derivatives (k, 2) by numbers that leave all links where they are."""
    sizes = np.array([max(abs(number.value), 1e-9) for number in numbers])
    steps = 1j * STEP * np.diag(sizes)
    values = {
        number.location: number.value + step for number, step in zip(numbers, steps, strict=True)
    }
    family = Family.of(machine, values, len(numbers))
    return _of_family(rival, family) / (STEP * sizes)[:, None]


def mass_slopes(machine: Machine, rival: Rival) -> Array:
    """Derivatives (k, 2) of a rival's frequency [Hz] by factors on what each coordinate carries.

    On mass and inertia of what it moves before the next.
    """
    count = len(machine.arm.coordinates)
    family = Family.of(machine, {}, count, 1.0 + 1j * STEP * np.eye(count))
    return _of_family(rival, family) / STEP


def _of_family(rival: Rival, family: Family) -> Array:
    """Imaginary parts (n, 2) of the frequencies of members with a complex step each."""
    poses = family.at(rival.pose.q, rival.pose.payload)
    mass, stiffness = poses.mass_matrix, poses.stiffness_matrix
    own = eigenvalue_slopes(mass[0].real, stiffness[0].real, np.imag(mass), np.imag(stiffness)) / (
        8 * math.pi**2 * rival.frequency
    )
    if not rival.ends.ends:
        return own
    room = rival.ends.room(family, np.tile(rival.pose.q, (family.count, 1)))
    return np.asarray(own - (np.imag(room) @ rival.ends.multipliers)[:, None])


def eigenvalue_slopes(
    mass: Array, stiffness: Array, mass_slopes: Array, stiffness_slopes: Array
) -> Array:
    """Derivatives (n, 2) of the lowest eigenvalue of K v = λ M v along n directions.

    Upwards and downwards: they differ where the lowest eigenvalues coincide.

    Args:
        mass: M (k, k).
        stiffness: K (k, k).
        mass_slopes: ∂M (n, k, k).
        stiffness_slopes: ∂K (n, k, k).
    """
    inverse = inverse_cholesky(mass[None])[0]
    values, vectors = np.linalg.eigh(inverse @ stiffness @ inverse.T)
    same = values - values[0] <= CLUSTER * np.abs(values).max()
    shapes = (inverse.T @ vectors)[:, same]
    along = shapes.T @ (stiffness_slopes - values[0] * mass_slopes) @ shapes
    return np.linalg.eigvalsh(along)[:, [0, -1]]


def _by_differences(machine: Machine, rival: Rival, number: Number) -> Array:
    """Derivative (2,), alike in both directions, of a number with which links are others.

    Central where the file may have the values on both sides, else to the side that it may have.
    """
    far = 2 * DIFFERENCE
    inside = number.low <= number.value - far, number.value + far <= number.high
    steps, weights = CENTRAL if all(inside) else ONE_SIDED
    sign = 1.0 if inside[1] else -1.0
    total = 0.0
    for step, weight in zip(steps, weights, strict=True):
        other = rebuilt(machine, {number.location: number.value + sign * step * DIFFERENCE})
        total += weight * float(rival.of(other).frequencies(Family.of(other, {}, 1))[0])
    return np.full(2, sign * total / (12 * DIFFERENCE))
