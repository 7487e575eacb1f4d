"""Inertia, compiled: M and h of links, payload and bars at one pose, and the accelerations.

A rigid body is its mass m at the centre C and second moments σ = ∫ x² dm along its principal
directions e. So with the slopes by the joints

    M = Σ m ∂C/∂q ∂C/∂qᵀ + Σ σ ∂e/∂q ∂e/∂qᵀ,    h = Σ m ∂C/∂q · (c̈ + g) + Σ σ ∂e/∂q · ë,

c̈ and ë without joint acceleration (``moved``). Bars, which are no links, come to it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.arm import LoadedArm
from armdesign.mechanism.composite_bodies import Bodies
from armdesign.simulation.plant.compiled import Record, Records, new_records, within
from armdesign.simulation.plant.kinematics import (
    BARREL,
    BASE,
    END,
    FAR,
    PIVOT,
    ROD,
    Frames,
    PinMotion,
    direction,
    moved,
    times,
    vector_of,
    write,
)
from armdesign.simulation.plant.vectors import ZERO, Vector, dot, plus, scaled
from armdesign.units import GRAVITY

CENTRE = 3
BODY = np.dtype(  # what a joint moves before the next one
    [
        ("vectors", "f8", (4, 3)),  # principal directions e and centre C in the joint's frame
        ("weights", "f8", 4),  # second moments σ along e [kg m²] and mass m [kg]
    ],
    align=True,
)
ROUNDING = 1e-14  # of the largest second moment: none
UPWARDS = (0.0, 0.0, GRAVITY)


class Inertia(NamedTuple):
    """Terms of M(q) q̈ = τ − h(q, q̇) at one pose."""

    mass: Array  # M (nq, nq)
    force: Array  # h, gravity's included (nq,)
    torque: Array  # τ (nq,)
    slope: Array  # of a point of a body by each joint (nq, 3)


def new_inertia(nq: int) -> Inertia:
    """Terms to be written."""
    return Inertia(np.empty((nq, nq)), np.empty(nq), np.empty(nq), np.empty((nq, 3)))


def bodies_of(loaded: LoadedArm) -> Records:
    """Bodies (nq,) of links and payload, those behind springs last, as records ``BODY``."""
    bodies = Bodies.of(loaded.model(), loaded.arm.coordinates)
    records = new_records(len(bodies.mass), BODY)
    for row, mass, centre, second_moments in zip(records, *bodies, strict=True):
        moments, along = np.linalg.eigh(second_moments)
        moments[np.abs(moments) <= ROUNDING * moments.max()] = 0.0
        row["vectors"], row["weights"] = [*along.T, centre], [*moments, mass]
    return records


@within
def add_bodies(
    bodies: Records, joints: Records, frames: Frames, speed: Array, inertia: Inertia
) -> None:
    """Add what all bodies have in M and h at joint speeds (nq,)."""
    for i in range(len(bodies)):
        body = bodies[i]
        for part in range(4):
            weight, at_centre = body.weights[part], part == CENTRE
            if weight != 0.0:
                vector = direction(i, body.vectors[part], frames)
                if at_centre:
                    vector = plus(vector, vector_of(frames.origin, i), 1.0)
                pull = moved(joints, frames, speed, i, vector, at_centre, inertia.slope)[2]
                if at_centre:
                    pull = plus(pull, UPWARDS, 1.0)
                _add(weight, pull, i, joints, inertia)


@within
def _add(weight: float, pull: Vector, frame: int, joints: Records, inertia: Inertia) -> None:
    """Add w ∂x/∂q ∂x/∂qᵀ and w ∂x/∂q · ẍ of a vector of a joint's frame; of M what is below."""
    j = frame
    while j >= 0:
        own = scaled(vector_of(inertia.slope, j), weight)
        inertia.force[j] += dot(own, pull)
        k = j
        while k >= 0:
            at = (j, k) if j > k else (k, j)
            inertia.mass[at] += dot(own, vector_of(inertia.slope, k))
            k = joints[k].parent
        j = joints[j].parent


@within
def solve(inertia: Inertia, acceleration: Array) -> None:
    """Write M⁻¹(τ − h) (nq,) by M = L D Lᵀ, which takes M's place; M's lower triangle counts."""
    mass, n = inertia.mass, len(inertia.force)
    for j in range(n):
        net = inertia.torque[j] - inertia.force[j]
        for k in range(j):
            entry = mass[j, k]
            for i in range(k):
                entry -= mass[j, i] * mass[i, i] * mass[k, i]
            mass[j, k] = entry / mass[k, k]
            mass[j, j] -= mass[j, k] * entry
            net -= mass[j, k] * acceleration[k]
        acceleration[j] = net
    for j in range(n - 1, -1, -1):
        acceleration[j] /= mass[j, j]
        for k in range(j + 1, n):
            acceleration[j] -= mass[k, j] * acceleration[k]


@within
def add_bars(
    drive: Record, length: float, span: Vector, speed: Array, pins: PinMotion, inertia: Inertia
) -> None:
    """Add what barrel, rod, rocker and coupler of a placed cylinder have in M and h.

    Barrel and rod are as long as the closed cylinder: their inner ends stand at ± ℓ_closed S/ℓ
    from base pin and rod end, S from the one to the other.
    """
    slope, coriolis = pins.slope, pins.coriolis
    rate = ZERO
    for j in range(len(speed)):
        relative = plus(vector_of(slope[END], j), vector_of(slope[BASE], j), -1.0)
        rate = plus(rate, relative, speed[j])
        along = times(_share(drive, length, span, relative, ZERO), (span, relative, ZERO))
        write(slope[BARREL], j, plus(vector_of(slope[BASE], j), along[1], 1.0))
        write(slope[ROD], j, plus(vector_of(slope[END], j), along[1], -1.0))
    second = plus(vector_of(coriolis, END), vector_of(coriolis, BASE), -1.0)
    along = times(_share(drive, length, span, rate, second), (span, rate, second))
    write(coriolis, BARREL, plus(vector_of(coriolis, BASE), along[2], 1.0))
    write(coriolis, ROD, plus(vector_of(coriolis, END), along[2], -1.0))
    _add_bar(drive.barrel_mass, BASE, BARREL, pins, inertia)
    _add_bar(drive.rod_mass, ROD, END, pins, inertia)
    _add_bar(drive.rocker_mass, PIVOT, END, pins, inertia)  # of a four-bar alone
    _add_bar(drive.coupler_mass, END, FAR, pins, inertia)


@within
def _share(drive: Record, length: float, span: Vector, rate: Vector, second: Vector) -> Vector:
    """ℓ_closed/ℓ with its first and second derivative."""
    first = dot(span, rate) / length
    curve = (dot(rate, rate) + dot(span, second) - first * first) / length
    share = drive.closed_length / length
    return share, -share * first / length, share * (2 * first * first / length - curve) / length


@within
def _add_bar(weight: float, one: int, other: int, pins: PinMotion, inertia: Inertia) -> None:
    """Add a slender bar from X to Y: m/3 (XXᵀ + YYᵀ) + m/6 (XYᵀ + YXᵀ), and so to h."""
    if weight == 0.0:
        return
    slope, mass, force = pins.slope, inertia.mass, inertia.force
    pull_one = plus(vector_of(pins.coriolis, one), UPWARDS, 1.0)
    pull_other = plus(vector_of(pins.coriolis, other), UPWARDS, 1.0)
    first = plus(scaled(pull_one, weight / 3), pull_other, weight / 6)
    second = plus(scaled(pull_other, weight / 3), pull_one, weight / 6)
    for j in range(len(force)):
        x, y = vector_of(slope[one], j), vector_of(slope[other], j)
        force[j] += dot(x, first) + dot(y, second)
        near = plus(scaled(x, weight / 3), y, weight / 6)
        far = plus(scaled(y, weight / 3), x, weight / 6)
        for k in range(j + 1):
            mass[j, k] += dot(near, vector_of(slope[one], k)) + dot(
                far, vector_of(slope[other], k)
            )
