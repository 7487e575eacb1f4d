"""Length and moment arm of a cylinder at one pose, in plain numbers: the lean path of a simulation.

``Linkage.actuation`` does n poses with second derivatives; here one pose costs a few microseconds. The length is the
distance of the pins, the moment arms follow from virtual work: what torque a unit force along the cylinder makes in
every joint between the links that feel it. In a four-bar the unit force at the knee splits along rocker and coupler;
the rocker pushes on its pivot, the coupler on the lug.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from armdesign.arm import Arm, Frame
from armdesign.linkage import FourBar, Gear, Linkage, Pin

Vector: TypeAlias = tuple[float, float, float]
Moments: TypeAlias = list[tuple[int, float]]  # (joint, moment arm [m/rad])


@dataclass(frozen=True)
class Point:
    """A pin on the joint frame that carries its link (−1: the world); the joints on the way to it from an observer."""

    joint: int
    at: Vector
    path: tuple[tuple[int, float, bool, Vector], ...]  # joint, sign, revolute, axis in its frame

    @classmethod
    def of(cls, arm: Arm, pin: Pin, observer: str) -> Point:
        """The pin as an observer on a link sees it."""
        body = arm.links[pin.link]
        place = body.translation + body.rotation @ np.array(pin.at)
        path = [
            (j, float(sign), arm.joints[j].revolute, _vector(arm.joints[j].axis))
            for j, sign in arm.path(observer, pin.link)
        ]
        return cls(body.joint, _vector(place), tuple(path))

    def position(self, frames: list[Frame]) -> Vector:
        """Where it is in the world [m]."""
        if self.joint < 0:
            return self.at
        rotation, (x, y, z) = frames[self.joint]
        u, v, w = _turned(rotation, self.at)
        return x + u, y + v, z + w

    def moments(self, frames: list[Frame], position: Vector, force: Vector) -> Moments:
        """Generalised forces of a force on it: f·(axis × lever) in a revolute joint, f·axis in a prismatic one."""
        found = []
        for j, sign, revolute, local in self.path:
            rotation, origin = frames[j]
            axis = _turned(rotation, local)
            motion = _cross(axis, _minus(position, origin)) if revolute else axis
            found.append((j, sign * _dot(force, motion)))
        return found


class Reach:
    """Length and moment arms of one cylinder."""

    def __init__(self, linkage: Linkage) -> None:
        arm, bars = linkage.arm, linkage.four_bar
        observer = bars.pivot.link if bars else linkage.base.link
        self._base = Point.of(arm, linkage.base, observer)
        far = bars.lug if bars else linkage.rod_end
        assert far is not None
        self._far = Point.of(arm, far, observer)
        self._knee = _Knee(arm, bars) if bars else None

    def __call__(self, q: Sequence[float], frames: list[Frame]) -> tuple[float, Moments]:
        """Pin-to-pin length [m] and moment arms [m/rad] of the joints that change it.

        Raises:
            ValueError: the four-bar does not close.
        """
        base, far = self._base.position(frames), self._far.position(frames)
        end, bar = self._knee(frames, far) if self._knee else (far, None)
        span = _minus(end, base)
        length = math.sqrt(_dot(span, span))
        push = (span[0] / length, span[1] / length, span[2] / length)
        force = bar(push) if bar else push
        moments = self._far.moments(frames, far, force)
        return length, moments + self._base.moments(frames, base, (-push[0], -push[1], -push[2]))


def reach(drive: Linkage | Gear) -> Callable[[Sequence[float], list[Frame]], tuple[float, Moments]]:
    """Length and moment arms of a drive by the joints' positions and frames; of a gear the joint's angle, and 1."""
    return Reach(drive) if isinstance(drive, Linkage) else lambda q, _: (q[drive.joint], [(drive.joint, 1.0)])


class _Knee:
    """Where rocker and coupler meet (see ``linkage.knee``), and what a force there does to the lug."""

    def __init__(self, arm: Arm, bars: FourBar) -> None:
        self._bars, self._pivot = bars, Point.of(arm, bars.pivot, bars.pivot.link)
        rotation = arm.links[bars.pivot.link].rotation
        self._right, self._up = _vector(rotation[:, 0]), _vector(rotation[:, 2])

    def __call__(self, frames: list[Frame], lug: Vector) -> tuple[Vector, _Coupler]:
        """Position of the knee [m], and the coupler at work."""
        right, up = self._right, self._up
        if self._pivot.joint >= 0:
            rotation = frames[self._pivot.joint][0]
            right, up = _turned(rotation, right), _turned(rotation, up)
        pivot, bars = self._pivot.position(frames), self._bars
        u = _minus(lug, pivot)
        ux, uz = _dot(u, right), _dot(u, up)
        e = ux * ux + uz * uz
        x = 0.5 + (bars.rocker**2 - bars.coupler**2) / (2 * e)
        y = bars.side * math.sqrt(bars.rocker**2 / e - x * x)
        kx, kz = x * ux - y * uz, x * uz + y * ux
        knee = (
            pivot[0] + kx * right[0] + kz * up[0],
            pivot[1] + kx * right[1] + kz * up[1],
            pivot[2] + kx * right[2] + kz * up[2],
        )
        return knee, _Coupler(right, up, (kx, kz), (ux - kx, uz - kz))


@dataclass(frozen=True)
class _Coupler:
    """Rocker a and coupler c, both in the plane of the four-bar; a force n at the knee is α a + γ c: γ = a×n/(a×c)."""

    right: Vector
    up: Vector
    rocker: tuple[float, float]
    coupler: tuple[float, float]

    def __call__(self, push: Vector) -> Vector:
        """The force γ c on the lug of a force on the knee."""
        (ax, az), (cx, cz) = self.rocker, self.coupler
        nx, nz = _dot(push, self.right), _dot(push, self.up)
        share = (ax * nz - az * nx) / (ax * cz - az * cx)
        fx, fz = share * cx, share * cz
        r, u = self.right, self.up
        return fx * r[0] + fz * u[0], fx * r[1] + fz * u[1], fx * r[2] + fz * u[2]


def _vector(values: object) -> Vector:
    x, y, z = (float(v) for v in np.asarray(values))
    return x, y, z


def _turned(rotation: list[list[float]], v: Vector) -> Vector:
    (a, b, c), (d, e, f), (g, h, i) = rotation
    x, y, z = v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def _minus(a: Vector, b: Vector | list[float]) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
