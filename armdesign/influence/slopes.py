"""Derivatives of the lowest natural frequency of a rival by numbers of the machine file.

    ∂ω²/∂p = vᵀ (∂K/∂p − ω² ∂M/∂p) v,  vᵀ M v = 1,  ∂f/∂p = ∂ω²/∂p / (8 π² f)

∂K and ∂M come by a complex step along each number: exact. Where the lowest modes coincide, V holds
all of them, and upwards the lowest, downwards the greatest eigenvalue of Vᵀ (∂K − ω² ∂M) V counts
(Seyranian, Lund and Olhoff 1994). To it comes by what the pose follows its ends (``ends.py``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.modes import inverse_cholesky
from armdesign.influence.family import Family, can_matter, moves_the_arm, rebuilt
from armdesign.influence.rivals import Rival
from armdesign.influence.turns import at_worst_turn
from armdesign.machine.file.key_paths import Location
from armdesign.machine.file.numbers import Number
from armdesign.machine.machine import Machine

STEP = 1e-30  # complex step, in the file's unit over the number's size
CLUSTER = 1e-7  # eigenvalues this near, relative, are one
DIFFERENCE = 1e-3  # step of differences for numbers that move links, in the file's unit
STEPS, WEIGHTS = (0, 1, 2, 3, 4), (-25, 48, -36, 16, -3)  # over 12: a one-sided difference


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
    """Derivatives (2,) by a number with which links are others, upwards and downwards.

    Each to its own side, as another turn of a slew may be the worst there, and loads that are
    none until the number tilts the machine have a kink; to the other where the file may not have
    the values.
    """
    far = STEPS[-1] * DIFFERENCE
    ways = [way for way in (1, -1) if number.low <= number.value + way * far <= number.high]
    steps = ({number.location: (number.value, way * DIFFERENCE)} for way in ways)
    changes = [_one_sided(machine, rival, step) for step in steps]
    found = [way * change / DIFFERENCE for way, change in zip(ways, changes, strict=True)]
    return np.array([found[0], found[-1]])


def _one_sided(
    machine: Machine, rival: Rival, steps: Mapping[Location, tuple[float, float]]
) -> float:
    """Change of a rival's frequency [Hz] by steps from values of numbers, to first order."""
    total = 0.0
    for count, weight in zip(STEPS, WEIGHTS, strict=True):
        values = {at: value + count * step for at, (value, step) in steps.items()}
        other = rebuilt(machine, values) if count else machine
        total += weight * at_worst_turn(machine, rival.of(other))[0]
    return total / 12


def change_along(machine: Machine, rival: Rival, steps: Mapping[Number, float]) -> float:
    """Change of a rival's frequency [Hz] by steps of numbers, all at once, to first order.

    Where numbers tilt a slew, or the lowest modes coincide, changes by each do not add up.
    """
    ends, change = rival.ends, 0.0
    for number, step in steps.items():
        change -= float(ends.multipliers @ ends.by_other_keys(number.location)) * step
    along = {
        n.location: np.array([n.value + 1j * STEP * step])
        for n, step in steps.items()
        if can_matter(n.location)
    }
    if along:
        change += float(_of_family(rival, Family.of(machine, along, 1))[0, 0]) / STEP
    moving = {n: step for n, step in steps.items() if moves_the_arm(n.location)}
    if moving:
        part = min(DIFFERENCE / max(map(abs, moving.values())), 1 / STEPS[-1])
        parts = {n.location: (n.value, part * step) for n, step in moving.items()}
        change += _one_sided(machine, rival, parts) / part
    return change
