"""Triangles of joint, base pin and rod pin that are possible with each pin in its box."""

from __future__ import annotations

import math
from dataclasses import dataclass

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

    def region(self) -> tuple[Array, Array, tuple[float, float]]:
        """Lowest and highest b (2,), and the scales, that hold every triangle."""
        (near, far), scale = _distances(self.base), _distances(self.rod_end)
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
        near, far = _distances(self.base)
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
        parts = [
            _directions(box, *ends) for box, ends in ((self.base, base), (self.rod_end, rod_end))
        ]
        (c0, low0, high0), (c1, low1, high1) = parts
        return c0 - c1, low0 - high1, high0 - low1


def _distances(box: Array) -> tuple[float, float]:
    """Least and greatest distance of a box from the joint."""
    low, high = box
    nearest = float(np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0)))
    return (
        max(nearest - TOUCH, 0.0),
        float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high)))) + TOUCH,
    )


def _directions(box: Array, near: Array, far: Array) -> tuple[float, Array, Array]:
    """Direction of a box's middle, and the range about it of points in [near, far] (m,).

    An edge is straight, so directions along it run one way: extremes lie at corners or where an
    edge meets a circle. Empty ranges come as (∞, −∞).
    """
    low, high = box
    middle = (low + high) / 2
    centre = float(np.arctan2(middle[1], middle[0]))
    if np.all(low <= TOUCH) and np.all(high >= -TOUCH):
        return centre, np.full(len(near), -2 * np.pi), np.full(len(near), 2 * np.pi)
    corners = np.array([[x, z] for x in box[:, 0] for z in box[:, 1]])
    sizes = np.linalg.norm(corners, axis=1)
    # x, z and whether they count (m, ·): corners, and meetings of edges of either axis
    x, z = (np.broadcast_to(axis, (len(near), 4)) for axis in corners.T)
    parts = [(x, z, (sizes >= near[:, None] - TOUCH) & (sizes <= far[:, None] + TOUCH))]
    distance = np.stack([near, far], axis=1)[:, :, None, None]
    for axis in (0, 1):
        edge = box[:, axis, None]
        along = np.sqrt(np.maximum(distance**2 - edge**2, 0.0)) * [-1.0, 1.0]
        inside = (along >= low[1 - axis] - TOUCH) & (along <= high[1 - axis] + TOUCH)
        met = inside & (distance >= np.abs(edge) - TOUCH)
        across = np.broadcast_to(edge, along.shape)
        parts.append((across, along, met) if axis == 0 else (along, across, met))
    x, z, allowed = (
        np.concatenate(
            [part.reshape(len(near), math.prod(part.shape[1:])) for part in each], axis=1
        )
        for each in zip(*parts, strict=True)
    )
    angle = _wrapped(np.arctan2(z, x) - centre)
    margin = TOUCH / max(_distances(box)[0], TOUCH)
    least = np.where(allowed, angle, np.inf).min(axis=1) - margin
    return centre, least, np.where(allowed, angle, -np.inf).max(axis=1) + margin


def _directions_meet(low: Array, high: Array, centre: float, first: Array, last: Array) -> Flags:
    """Whether boxes (m, 2) have a point in a direction from ``first`` to ``last`` (m,)."""
    corners = np.stack(
        [
            np.stack([x, z], axis=1)
            for x in (low[:, 0], high[:, 0])
            for z in (low[:, 1], high[:, 1])
        ]
    )
    angle = _wrapped(np.arctan2(corners[..., 1], corners[..., 0]) - centre)
    least, most = angle.min(axis=0), angle.max(axis=0)
    # at the joint, or on both sides of ±π
    everywhere = np.all((low <= 0) & (high >= 0), axis=1) | (most - least > np.pi)
    everywhere |= (first < -np.pi) | (last > np.pi)
    return np.asarray((first <= last) & (everywhere | ((least <= last) & (most >= first))))


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
