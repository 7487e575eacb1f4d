"""Triangles of joint, base pin and rod pin that are possible with each pin in its box."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.bound.intervals import Interval

TOUCH = 1e-9  # [m] by which pins may leave their boxes here: rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class TriangleBoxes:
    """Corners (2, 2: ends, x and z) [m] of both pins' boxes, seen from the joint.

    The triangle is drawn with the rod pin at (scale, 0) and the base pin at scale·b: its direction
    is the base pin's less the rod pin's.
    """

    base: Array
    rod_end: Array

    @cached_property
    def _boxes(self) -> tuple[_Box, _Box]:
        return _Box(self.base), _Box(self.rod_end)

    def region(self) -> tuple[Array, Array, tuple[float, float]]:
        """Lowest and highest b (2,), and the scales, that hold every triangle."""
        (near, far), scale = (box.distances for box in self._boxes)
        ratios = near / scale[1], far / max(scale[0], TOUCH)
        centre, low, high = self._between(np.array([[near, far]]).T, np.array([scale]).T)
        angles = np.linspace(low[0], high[0], 721) + centre
        points = (
            np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(ratios)[:, None, None]
        )
        # how far an arc rises over its chords
        margin = ratios[1] * (1 - np.cos((high[0] - low[0]) / 1440))
        return points.min(axis=(0, 1)) - margin, points.max(axis=(0, 1)) + margin, scale

    def scales(self, low: Array, high: Array, scale: Interval) -> Interval:
        """Scales (m,) at which b in the box (m, 2) may be possible; empty where low > high."""
        nearest = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0), axis=1)
        farthest = np.linalg.norm(np.maximum(np.abs(low), np.abs(high)), axis=1)
        near, far = self._boxes[0].distances
        with np.errstate(divide="ignore", invalid="ignore"):  # 0/0 says nothing
            left = Interval(
                np.fmax(scale.low, near / farthest), np.minimum(scale.high, far / nearest)
            )
        base = np.stack(
            [np.maximum(near, left.low * nearest), np.minimum(far, left.high * farthest)]
        )
        centre, first, last = self._between(base, np.stack([left.low, left.high]))
        possible = (left.low <= left.high) & _directions_meet(low, high, centre, first, last)
        return Interval(left.low, np.where(possible, left.high, -np.inf))

    def _between(self, base: Array, rod_end: Array) -> tuple[float, Array, Array]:
        """A direction, and the extremes of b's from it, for distances (2, m) of both pins."""
        parts = (
            box.directions(*ends) for box, ends in zip(self._boxes, (base, rod_end), strict=True)
        )
        (c0, low0, high0), (c1, low1, high1) = parts
        return c0 - c1, low0 - high1, high0 - low1


@dataclass(frozen=True, eq=False)
class _Box:
    """A box of points by its corners (2, 2: ends, x and z) [m]."""

    ends: Array

    @cached_property
    def distances(self) -> tuple[float, float]:
        """Least and greatest distance from the joint."""
        low, high = self.ends
        nearest = float(np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)))
        farthest = float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high))))
        return max(nearest - TOUCH, 0.0), farthest + TOUCH

    @cached_property
    def centre(self) -> float:
        """Direction of its middle."""
        x, z = self.ends.mean(axis=0)
        return float(np.arctan2(z, x))

    @cached_property
    def _corners(self) -> tuple[Array, Array]:
        """Distances and angles of its corners (4, 1)."""
        x, z = np.repeat(self.ends[:, :1], 2, axis=0), np.tile(self.ends[:, 1:], (2, 1))
        return np.linalg.norm([x, z], axis=0), _angle(x, z, self.centre)

    def directions(self, near: Array, far: Array) -> tuple[float, Array, Array]:
        """Its ``centre``, and the range of angles about it of points in [near, far] (m,).

        An edge is straight, so directions along it run one way: extremes lie at corners or where
        an edge meets a circle. Empty ranges come as (∞, −∞).
        """
        low, high = self.ends
        if np.all(low <= TOUCH) and np.all(high >= -TOUCH):
            return self.centre, np.full(len(near), -2 * np.pi), np.full(len(near), 2 * np.pi)
        # angles and whether they count (·, m): of corners, and where edges of either axis meet
        # circles
        size, angle = self._corners
        angles = [np.broadcast_to(angle, (4, len(near)))]
        allowed = [(size >= near - TOUCH) & (size <= far + TOUCH)]
        distance = np.stack([near, far])[:, None]
        for axis in (0, 1):
            edge = self.ends[:, axis, None]
            half = np.sqrt(np.maximum(distance**2 - edge**2, 0.0))
            along = np.stack([-half, half])
            inside = (along >= low[1 - axis] - TOUCH) & (along <= high[1 - axis] + TOUCH)
            x, z = (edge, along) if axis == 0 else (along, edge)
            angles.append(_angle(x, z, self.centre).reshape(8, -1))
            allowed.append((inside & (distance >= np.abs(edge) - TOUCH)).reshape(8, -1))
        all_angles, counts = np.concatenate(angles), np.concatenate(allowed)
        margin = TOUCH / max(self.distances[0], TOUCH)
        least = np.where(counts, all_angles, np.inf).min(axis=0) - margin
        return self.centre, least, np.where(counts, all_angles, -np.inf).max(axis=0) + margin


def _angle(x: Array, z: Array, centre: float) -> Array:
    """Angles of points from a direction, between −π and π."""
    return np.asarray((np.arctan2(z, x) - centre + np.pi) % (2 * np.pi) - np.pi)


def _directions_meet(low: Array, high: Array, centre: float, first: Array, last: Array) -> Flags:
    """Whether boxes (m, 2) have a point in a direction from ``first`` to ``last`` (m,)."""
    (x0, z0), (x1, z1) = low.T, high.T
    angle = _angle(np.stack([x0, x0, x1, x1]), np.stack([z0, z1, z0, z1]), centre)
    least, most = angle.min(axis=0), angle.max(axis=0)
    # at the joint, or on both sides of ±π
    everywhere = np.all((low <= 0) & (high >= 0), axis=1) | (most - least > np.pi)
    everywhere |= (first < -np.pi) | (last > np.pi)
    return np.asarray((first <= last) & (everywhere | ((least <= last) & (most >= first))))
