"""Bars that move in the link that carries them: their M, g and ∂g/∂q over all coordinates.

A point p of a bar, seen from that link, depends on few joints, its own; those between root and
link, the outer ones, carry the whole. With h = (1, p) an outer joint k moves the point by T_k h,
where T_k (3, 4) does not depend on the bar, and an own joint a by ∂p/∂q_a, all in the frame of the
link. So what bars do at any pose follows from a few sums over their mass at the positions of their
own joints alone:

    M_kl = tr(T_k H T_lᵀ),  M_ka = tr(T_k G_aᵀ),  M_ab = Σ m ∂p/∂q_a · ∂p/∂q_b

with H = Σ m h hᵀ and G_a = Σ m ∂p/∂q_a hᵀ. A joint may be outer and own; then both parts count.
Gravity torque depends on the first moments Σ m h and Σ m ∂p/∂q_a alone.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from armdesign.arrays import Array, side_by_side
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.jets import VectorJet, cross
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.urdf import turned
from armdesign.units import GRAVITY


class Moments(NamedTuple):
    """Sums over the mass of bars at m positions of their a own joints, in the link's frame."""

    position: Array  # H (…, m, 4, 4)
    velocity: Array  # G (…, m, a, 3, 4)
    square: Array  # Σ m ∂p/∂q_a · ∂p/∂q_b (…, m, a, a)
    bend: Array  # Σ m ∂²p/∂q_a∂q_b (…, m, a, a, 3)

    def at(self, rows: Array | slice) -> Moments:
        """At some of the positions."""
        return Moments(*_at(self, (2, 3, 2, 3), rows))


class FirstMoments(NamedTuple):
    """The sums of ``Moments`` that gravity torque depends on."""

    position: Array  # Σ m h (…, m, 4)
    velocity: Array  # Σ m ∂p/∂q_a (…, m, a, 3)

    def at(self, rows: Array | slice) -> FirstMoments:
        """At some of the positions."""
        return FirstMoments(*_at(self, (1, 2), rows))


M = TypeVar("M", Moments, FirstMoments)
# moments of a kilogram of a bar: ``of_bar`` or ``first_of_bar``
MomentsOf: TypeAlias = Callable[[tuple[VectorJet, VectorJet], Array, Array], M]


def _at(parts: Sequence[Array], behind: Sequence[int], rows: Array | slice) -> list[Array]:
    """Parts with so many axes behind that of positions, at some of those."""
    every = slice(None)
    return [part[(..., rows, *n * [every])] for part, n in zip(parts, behind, strict=True)]


def of_bar(ends: tuple[VectorJet, VectorJet], rotation: Array, origin: Array) -> Moments:
    """Moments of a kilogram in a uniform slender bar between two points.

    A sixth of the mass at either end, the rest in the middle (Simpson, exact): all sums are
    quadratic along the bar.

    Args:
        ends: in the world, with derivatives by the own joints seen from the link.
        rotation: of the link in the world (m, 3, 3).
        origin: of the link in the world (m, 3) [m].
    """
    places, slopes = _seen(ends, rotation, origin)
    places.append(places[0] + places[1])
    slopes.append(slopes[0] + slopes[1])
    pairs = list(zip(places, slopes, strict=True))
    return Moments(
        sum(h[:, :, None] * h[:, None] for h, _ in pairs) / 6,
        sum(d[..., None] * h[:, None, None] for h, d in pairs) / 6,
        sum(d @ np.swapaxes(d, 1, 2) for _, d in pairs) / 6,
        np.ascontiguousarray(ends[0].second + ends[1].second) / 2 @ rotation[:, None],
    )


def first_of_bar(
    ends: tuple[VectorJet, VectorJet], rotation: Array, origin: Array
) -> FirstMoments:
    """First moments of a kilogram in a uniform slender bar; arguments as in ``of_bar``."""
    places, slopes = _seen(ends, rotation, origin)
    return FirstMoments((places[0] + places[1]) / 2, (slopes[0] + slopes[1]) / 2)


def _seen(
    ends: tuple[VectorJet, VectorJet], rotation: Array, origin: Array
) -> tuple[list[Any], list[Any]]:
    """Ends of a bar in the frame of a link: h (m, 4) and ∂p/∂q_a (m, a, 3) of each."""
    # pose after pose in memory: else products add up in another order for one pose than for more
    places = [np.ascontiguousarray(end.value - origin)[:, None] @ rotation for end in ends]
    places = [np.concatenate([np.ones((len(at), 1)), at[:, 0]], axis=1) for at in places]
    return places, [np.ascontiguousarray(end.first) @ rotation for end in ends]


def weighed(masses: Array, units: Sequence[M]) -> M:
    """Moments of bars (…, m, …) of masses (…, k) [kg] from those of a kilogram of each of k."""
    own = np.moveaxis(masses, -1, 0)
    parts = (map(np.multiply.outer, own, part) for part in zip(*units, strict=True))
    return type(units[0])(*(sum(each, np.zeros(())) for each in parts))


def weighed_by_row(masses: Array, units: Sequence[M]) -> M:
    """``weighed`` where masses (m, k) differ with the position."""
    parts = map(np.stack, zip(*units, strict=True))
    return type(units[0])(*(np.einsum("mk,km...->m...", masses, part) for part in parts))


def units_of(
    linkage: Linkage, length: Any, positions: RigidPoses, names: Collection[str], of: MomentsOf[M]
) -> list[M]:
    """Moments of a kilogram of some bars of a cylinder of closed ``length`` [m].

    At positions of its own joints, in its linkage's observer.
    """
    arm, link = linkage.arm, linkage.observer
    ends = linkage.bars(positions, length, link, linkage.joints, names)
    rotation = arm.link_rotation(positions, link)
    origin = arm.point(positions, link, np.zeros(3))
    return [of(ends[name], rotation, origin) for name in names]


def of_linkage(
    linkage: Linkage, masses: Mapping[str, Any], length: Any, poses: RigidPoses
) -> tuple[Array, Array, Array]:
    """M, g and ∂g/∂q (n, k, …) of bars of a cylinder of closed ``length`` [m].

    Each of its masses [kg] is one number, or one for each pose.
    """
    units = units_of(linkage, length, poses, masses, of_bar)
    each = side_by_side(masses.values())
    moments = (weighed if each.ndim == 1 else weighed_by_row)(each, units)
    return inertia_and_gravity(linkage.arm, linkage.observer, linkage.joints, poses, moments)


def gravity(
    arm: Arm, link: str, own: Sequence[int], poses: RigidPoses, moments: FirstMoments
) -> Array:
    """Gravity torque g (…, n, k) [N m], at n poses, of bars with first moments (…, n, …)."""
    outer = [j for j, _ in arm.path(arm.root, link)]
    carried, rotation = _carried(arm, link, poses)
    down = rotation[:, 2]  # the vertical in the link's frame
    lifting = (down[:, None, None] @ carried)[:, :, 0]  # (n, outer, 4)
    torque = np.zeros((*moments.position.shape[:-1], len(arm.coordinates)), moments.position.dtype)
    torque[..., outer] += (lifting @ moments.position[..., None])[..., 0]
    torque[..., list(own)] += (moments.velocity @ down[:, :, None])[..., 0]
    return GRAVITY * torque


def inertia_and_gravity(
    arm: Arm, link: str, own: Sequence[int], poses: RigidPoses, moments: Moments
) -> tuple[Array, Array, Array]:
    """M, g and ∂g/∂q (…, n, k, …) of bars with moments (…, n, …) in a link, at n poses."""
    outer = np.array([j for j, _ in arm.path(arm.root, link)], dtype=int)
    inner, n = np.array(own, dtype=int), len(poses)
    carried, rotation = _carried(arm, link, poses)
    down = rotation[:, 2]  # the vertical in the link's frame
    wide = carried.reshape(n, len(outer), 12)
    moved = carried.reshape(n, 3 * len(outer), 4) @ moments.position
    front = moved.shape[:-2]
    whole = moved.reshape(*front, len(outer), 12)
    flat = moments.velocity.reshape(*front, len(inner), 12)
    # what each joint moves Σ m p by, and how outer joints turn the vertical
    lifted, swept = whole[..., ::4], moments.velocity[..., 0]
    turning = np.ascontiguousarray(cross(down[:, None], _spins(carried)))
    between = np.triu(turning @ np.swapaxes(lifted, -1, -2))  # the nearer to the root turns
    k = len(arm.coordinates)
    mass, gravity, slope = (np.zeros((*front, *rank * (k,)), moved.dtype) for rank in (2, 1, 2))
    gravity[..., outer] += (lifted @ down[:, :, None])[..., 0]
    gravity[..., inner] += (swept @ down[:, :, None])[..., 0]
    mass[..., outer[:, None], outer] += whole @ np.swapaxes(wide, -1, -2)
    slope[..., outer[:, None], outer] += between + np.swapaxes(np.triu(between, 1), -1, -2)
    mass[..., inner[:, None], inner] += moments.square
    slope[..., inner[:, None], inner] += (moments.bend @ down[:, None, :, None])[..., 0]
    mixed = wide @ np.swapaxes(flat, -1, -2), turning @ np.swapaxes(swept, -1, -2)
    for part, both in zip((mass, slope), mixed, strict=True):
        part[..., outer[:, None], inner] += both
        part[..., inner[:, None], outer] += np.swapaxes(both, -1, -2)
    return mass, GRAVITY * gravity, GRAVITY * slope


def _carried(arm: Arm, link: str, poses: RigidPoses) -> tuple[Array, Array]:
    """T (n, outer, 3, 4) of the joints between root and a link, and the link's rotation."""
    rotation, origin = arm.link_rotation(poses, link), arm.point(poses, link, np.zeros(3))
    path = arm.path(arm.root, link)
    carried = np.zeros((len(poses), len(path), 3, 4), poses.translation.dtype)
    into = np.swapaxes(rotation, 1, 2)
    for place, (j, sign) in enumerate(path):
        axis = sign * poses.axis[:, j]
        if not arm.coordinates[j].revolute:
            carried[:, place, :, 0] = turned(into, axis)
            continue
        carried[:, place, :, 0] = turned(into, cross(axis, origin - poses.translation[:, j]))
        x, y, z = turned(into, axis).T
        carried[:, place, [2, 0, 1], [2, 3, 1]] = np.stack([x, y, z], axis=1)
        carried[:, place, [1, 2, 0], [3, 1, 2]] = -np.stack([x, y, z], axis=1)
    return carried, rotation


def _spins(carried: Array) -> Array:
    """The angular velocities (n, outer, 3) in T."""
    return carried[:, :, [2, 0, 1], [2, 3, 1]]
