"""Inertia and gravity of the links at many poses: M, g and ∂g/∂q from placements.

All that a joint j moves is one rigid body while the other joints stand still: of mass μ, first
moment s and second moments J = Σ m r rᵀ about the joint's foot p, in the world. When the joint
moves at unit speed along its axis a, that body has the momentum L and, about p, the angular
momentum H:

    L = a × s,  H = tr(J) a − J a     of a revolute joint,
    L = μ a,    H = s × a             of a prismatic one.

A joint i that carries j, or is j, feels M_ij = a_i·(H + (p_j − p_i) × L), or a_i·L if prismatic.
L is also what Σ m x changes by, so g_j = g L_z and ∂g_i/∂q_j = g (a_i × L)_z, of a prismatic i
nothing. (Composite rigid bodies: Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 6.)
Axis 0 is the pose. Complex-safe.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.jets import cross
from armdesign.mechanism.urdf import Joint
from armdesign.units import GRAVITY


class Bodies(NamedTuple):
    """What each of k joints moves before the next one, in the joint's frame."""

    mass: Array  # (k,) [kg]
    centre: Array  # (k, 3) [m]
    second_moments: Array  # ∫ x xᵀ dm about the centre (k, 3, 3) [kg m²]

    @classmethod
    def of(cls, model: Any, joints: Sequence[Joint]) -> Self:
        """The bodies of a Pinocchio model; second moments are ½ tr(I) 1 − I."""
        bodies = [model.inertias[index] for index in model_indices(model, joints)]
        inertia = np.array([body.inertia for body in bodies])
        half = 0.5 * np.trace(inertia, axis1=1, axis2=2)
        return cls(
            np.array([body.mass for body in bodies]),
            np.array([body.lever for body in bodies]),
            half[:, None, None] * np.eye(3) - inertia,
        )

    def alone(self, joint: int) -> Bodies:
        """One joint's body, with nothing on the others."""
        own = np.arange(len(self.mass)) == joint
        return Bodies(own * self.mass, self.centre, own[:, None, None] * self.second_moments)

    def moments_about_feet(self) -> tuple[Array, Array]:
        """First (k, 3) [kg m] and second moments (k, 3, 3) [kg m²] about the joints' feet."""
        first = self.mass[:, None] * self.centre
        return first, self.second_moments + first[:, :, None] * self.centre[:, None]


def model_indices(model: Any, joints: Sequence[Joint]) -> list[int]:
    """Index of each joint in a Pinocchio model, after the world's, whose name they may have."""
    names = list(model.names)[1:]
    return [1 + names.index(joint.name) for joint in joints]


def inertia_and_gravity(
    bodies: Bodies,
    joints: Sequence[Joint],
    chains: Sequence[tuple[int, ...]],
    placements: tuple[Array, Array, Array],
) -> tuple[Array, Array, Array]:
    """M (n, k, k), g (n, k) and ∂g/∂q (n, k, k).

    Args:
        bodies: that the joints move.
        joints: the k coordinates.
        chains: for each, those from the root to it.
        placements: rotation, translation and axis of their frames in the world (n, k, …).
    """
    one = len(placements[0]) == 1  # of which einsum takes sums in another order than of more
    placed = (np.repeat(values, 2, axis=0) if one else values for values in placements)
    rotation, foot, axis = map(_components_first, placed)  # (k, …, n)
    k, _, n = foot.shape
    inertia, slope = np.zeros((2, k, k, n), foot.dtype)
    gravity, turns = np.empty((k, n), foot.dtype), [joint.revolute for joint in joints]
    carried = _carried_alone(bodies, rotation)
    for j in sorted(range(k), key=lambda j: -len(chains[j])):
        momentum, angular = carried[j].momenta(turns[j], axis[j])
        gravity[j] = GRAVITY * momentum[2]
        for i in chains[j]:
            felt = momentum
            if turns[i]:
                felt = angular if i == j else angular + cross(foot[j] - foot[i], momentum, axis=0)
                rising = axis[i, 0] * momentum[1] - axis[i, 1] * momentum[0]
                slope[i, j] = slope[j, i] = GRAVITY * rising
            inertia[i, j] = inertia[j, i] = np.einsum("an,an->n", axis[i], felt)
        if (parent := joints[j].parent) >= 0:
            carried[parent] = carried[parent].with_body(carried[j], foot[j] - foot[parent])
    rows = slice(1 if one else n)
    inertia, gravity, slope = map(pose_by_pose, (inertia, gravity, slope))
    return inertia[rows], gravity[rows], slope[rows]


class _Carried(NamedTuple):
    """All that a joint carries, as one body, about the joint's foot and in the world."""

    mass: float  # [kg]
    first: Array  # Σ m r (3, n) [kg m]
    second: Array  # Σ m r rᵀ (3, 3, n) [kg m²]

    def with_body(self, other: _Carried, lever: Array) -> _Carried:
        """With another one, whose foot stands at a lever (3, n) [m] from here."""
        mixed = lever[:, None] * (other.first + other.mass / 2 * lever)
        return _Carried(
            self.mass + other.mass,
            self.first + other.first + other.mass * lever,
            self.second + other.second + mixed + mixed.swapaxes(0, 1),
        )

    def momenta(self, revolute: bool, axis: Array) -> tuple[Array, Array]:
        """Momentum, and angular momentum about the foot, at unit speed along an axis (3, n)."""
        if not revolute:
            return self.mass * axis, cross(self.first, axis, axis=0)
        trace = self.second[0, 0] + self.second[1, 1] + self.second[2, 2]
        return cross(axis, self.first, axis=0), trace * axis - np.einsum(
            "abn,bn->an", self.second, axis
        )


def _carried_alone(bodies: Bodies, rotation: Array) -> list[_Carried]:
    """Each joint's own body, turned by rotations of the joints' frames (k, 3, 3, n)."""
    first, second = bodies.moments_about_feet()
    half_turned = np.einsum("kajn,kji->kain", rotation, second)
    second = np.einsum("kain,kbin->kabn", half_turned, rotation)
    turned = zip(bodies.mass, np.einsum("kain,ki->kan", rotation, first), second, strict=True)
    return [_Carried(*body) for body in turned]


def _components_first(values: Array) -> Array:
    """Values (n, k, …) as an array (k, …, n) in one piece: sums over components are fast."""
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def pose_by_pose(components: Array) -> Array:
    """Components (k, …, n) as a view (n, k, …)."""
    return np.moveaxis(components, -1, 0)
