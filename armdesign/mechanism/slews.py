"""Slews: joints that turn the whole arm about an axis that is upright, or nearly so.

The arm is what moves the tool: a dozer blade or a counterweight beside it is none of it.
Their axes are nearer to the vertical than to the horizontal, so that a base that is not level has
them too, and one that rocks on a spring. The ground is level and at the height of the root.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, ReadOnly, read_only
from armdesign.mechanism.urdf import Frozen, Joint, Link, rotations, turned

UPRIGHT = math.sqrt(0.5)  # of a unit vector's height, nearer to the vertical than the horizontal


@dataclass(frozen=True, eq=False, kw_only=True)
class Slews(ReadOnly):
    """The slews of an arm, while all that move stand at 0.

    Attributes:
        axes: by the coordinate of those that move, from the root out, their direction (3,).
        places: a point of each of these axes (3,) [m].
        frozen: those that do not move, from the root out; they carry the others.
        rocking: coordinates of springs that carry the whole arm, and rock it.
        sprung: those of the slews that such a spring carries.
    """

    axes: Mapping[int, Array]
    places: Mapping[int, Array]
    frozen: tuple[Frozen, ...] = ()
    rocking: frozenset[int] = frozenset()
    sprung: frozenset[int] = frozenset()

    def __contains__(self, coordinate: int) -> bool:
        return coordinate in self.axes

    @cached_property
    def vertical(self) -> dict[int, float]:
        """Those about the vertical that nothing else carries, +1 if up else −1."""
        signs: dict[int, float] = {}
        for index, axis in self.axes.items():
            if index in self.sprung or abs(abs(float(axis[2])) - 1) >= 1e-12:
                break
            signs[index] = float(axis[2])
        return signs

    def __bool__(self) -> bool:
        """Whether there is a slew, be it frozen."""
        return self._next_to_root is not None

    @cached_property
    def _next_to_root(self) -> tuple[Array, Array] | None:
        """Direction and a point of the axis next to the root (3,); None without slews."""
        lines = [(one.axis, one.place) for one in self.frozen]
        lines += [(axis, self.places[index]) for index, axis in self.axes.items()]
        return lines[0] if lines else None

    @cached_property
    @read_only
    def axis(self) -> Array:
        """Upward direction (3,) of the axis next to the root; the vertical without slews."""
        if self._next_to_root is None:
            return np.array([0.0, 0.0, 1.0])
        axis, _ = self._next_to_root
        return np.asarray(np.copysign(1.0, axis[2]) * axis)

    @cached_property
    @read_only
    def foot(self) -> Array:
        """Where the axis next to the root meets the ground (2,) [m]; the root without slews."""
        if self._next_to_root is None:
            return np.zeros(2)
        axis, at = self._next_to_root
        return np.asarray((at - at[2] / axis[2] * axis)[:2])

    def turned(self, direction: Array, z: Array) -> Array:
        """A direction (3,) that they turn, at all coordinates z (n, k): (n, 3)."""
        there = np.broadcast_to(direction, (len(z), 3))
        for index, axis in reversed(list(self.axes.items())):
            there = turned(rotations(axis, z[:, index]), there)
        return there


def is_upright(joint: Joint | Frozen, axis: Array) -> bool:
    """Whether a joint turns about an axis (3,) nearer to the vertical than to the horizontal."""
    return joint.revolute and abs(float(axis[2])) > UPRIGHT


def slews_of(
    coordinates: Sequence[Joint],
    chain: Sequence[int],
    frames: tuple[Array, Array, Array],
    links: Sequence[Link],
    springs: Collection[int],
) -> Slews:
    """The slews of an arm.

    What carries the whole arm and is frozen about another axis is as fixed.

    Args:
        coordinates: joints that move (k).
        chain: those of these that move the tool, from the root out.
        frames: theirs, at 0: rotations (k, 3, 3), origins (k, 3) [m] and axes (k, 3).
        links: of the arm, from the root out.
        springs: which of the coordinates are springs.
    """
    rotation, places, axes = frames
    found, rocking, sprung = list[int](), set[int](), set[int]()
    for index in chain:
        if is_upright(coordinates[index], axes[index]):
            found.append(index)
            sprung |= {index} if rocking else set()
        elif index in springs:
            rocking.add(index)
        else:
            break
    moved = {*chain} - rocking
    at_root = [seen_from_root(one, rotation, places) for one in _carrying(links, moved)]
    by_axis, by_place = ({j: of[j] for j in found} for of in (axes, places))
    return Slews(
        axes=by_axis,
        places=by_place,
        frozen=tuple(one for one in at_root if is_upright(one, one.axis)),
        rocking=frozenset(rocking),
        sprung=frozenset(sprung),
    )


def _carrying(links: Sequence[Link], moved: Collection[int]) -> list[tuple[int, Frozen]]:
    """Frozen joints that carry all that some coordinates move, from the root out.

    Each after the coordinate that carries it itself, −1 for none.
    """
    frozen = [link.frozen for link in links if link.joint in moved]
    if not frozen:
        return []
    names = set[str].intersection(*({one.name for one in each} for each in frozen))
    carrier = carriers(links)
    return [(carrier[one.name], one) for one in frozen[0] if one.name in names]


def carriers(links: Sequence[Link]) -> dict[str, int]:
    """The coordinate that carries each frozen joint of links, from the root out; −1 for none."""
    ends = (link for link in reversed(links) if link.frozen)  # the first link beyond it counts
    return {link.frozen[-1].name: link.joint for link in ends}


def seen_from_root(carried: tuple[int, Frozen], rotation: Array, places: Array) -> Frozen:
    """A frozen joint in the frame of the root, not of the coordinate that carries it."""
    coordinate, one = carried
    if coordinate < 0:
        return one
    axis, place = (rotation[coordinate] @ of for of in (one.axis, one.place))
    return replace(one, axis=axis, place=place + places[coordinate])
