"""Slews: joints that turn the whole arm about an axis that is upright, or nearly so.

Their axes are nearer to the vertical than to the horizontal, so that a base that is not level has
them too. The ground is level and at the height of the root.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, ReadOnly, read_only
from armdesign.mechanism.jets import cross
from armdesign.mechanism.urdf import Joint

UPRIGHT = math.sqrt(0.5)  # of a unit vector's height, nearer to the vertical than the horizontal


@dataclass(frozen=True, eq=False, kw_only=True)
class Slews(ReadOnly):
    """The slews of an arm by their coordinate, from the root out, while all stand at 0.

    Attributes:
        axes: direction of each (3,).
        places: a point of each axis (3,) [m].
    """

    axes: Mapping[int, Array]
    places: Mapping[int, Array]

    def __contains__(self, coordinate: int) -> bool:
        return coordinate in self.axes

    @cached_property
    def vertical(self) -> dict[int, float]:
        """Those about the vertical that no other carries, +1 if up else −1."""
        signs: dict[int, float] = {}
        for index, axis in self.axes.items():
            if abs(abs(float(axis[2])) - 1) >= 1e-12:
                break
            signs[index] = float(axis[2])
        return signs

    @cached_property
    @read_only
    def foot(self) -> Array:
        """Where the axis next to the root meets the ground (2,) [m]; the root without slews."""
        if not self.axes:
            return np.zeros(2)
        first, axis = next(iter(self.axes.items()))
        at = self.places[first]
        return np.asarray((at - at[2] / axis[2] * axis)[:2])

    def heading(self, z: Array) -> Array:
        """Horizontal direction (n, 2) to which they turn the root's x axis, at all coordinates."""
        forward = np.array([1.0, 0.0, 0.0])
        if self.axes:
            first = next(iter(self.axes.values()))
            forward = forward - first[0] * first
        turned = np.broadcast_to(forward, (len(z), 3))
        for index, axis in reversed(list(self.axes.items())):
            angle = z[:, index, None]
            along = (turned @ axis)[:, None] * axis
            across = turned - along
            turned = along + np.cos(angle) * across + np.sin(angle) * cross(axis[None], across)
        return np.asarray(turned[:, :2] / np.linalg.norm(turned[:, :2], axis=1, keepdims=True))


def is_upright(joint: Joint, axis: Array) -> bool:
    """Whether a joint turns about an axis (3,) nearer to the vertical than to the horizontal."""
    return joint.revolute and abs(float(axis[2])) > UPRIGHT


def slews_of(
    coordinates: Sequence[Joint], outwards: Sequence[int], axes: Array, places: Array
) -> Slews:
    """The slews among an arm's coordinates, whose axes and places are (k, 3) at 0."""
    found: list[int] = []
    for index in outwards:
        joint = coordinates[index]
        siblings = sum(other.parent == joint.parent for other in coordinates)
        carries_all = joint.parent in (-1, *found) and siblings == 1
        if carries_all and is_upright(joint, axes[index]):
            found.append(index)
    return Slews(axes={j: axes[j] for j in found}, places={j: places[j] for j in found})
