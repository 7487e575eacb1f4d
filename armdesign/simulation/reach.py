"""Lengths and moment arms of stacked cylinders, lean enough to be asked for ten thousand times.

The same geometry as ``linkage.py`` by another way, which needs no second derivatives: virtual work. A unit force along
the cylinder and its reaction act on the pins, and r_j is the work they do per unit of joint j, for each joint between
the links that feel it. In a four-bar the unit force at the knee splits along rocker and coupler; the rocker pushes on
its pivot, the coupler on the lug.

The plane of a four-bar is the complex plane: right is 1, up is i.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from armdesign.arm import Arm
from armdesign.arrays import Array
from armdesign.linkage import Linkage, Pin


class Reach:
    """Lengths and moment arms of nc cylinders in machines of one ``shape``: axis 0 is the case.

    Args:
        linkages: those of each case, or of one that serves all cases.
    """

    def __init__(self, linkages: Sequence[Sequence[Linkage]]) -> None:
        first, self._bars = linkages[0], [i for i, linkage in enumerate(linkages[0]) if linkage.four_bar]
        self.count = len(first)
        self._revolute = np.array([joint.revolute for joint in first[0].arm.joints])
        self._slides = ~self._revolute
        axes = np.array([[joint.axis for joint in row[0].arm.joints] for row in linkages])
        pins = [_pins(row) for row in linkages]
        places = [[_place(row[0].arm, pin)[1] for pin in own] for row, own in zip(linkages, pins, strict=True)]
        planes = [_planes(row) for row in linkages]
        at = np.concatenate([np.array(places), np.array(planes), axes], axis=1)
        bound = np.repeat([1.0, 0.0], [len(pins[0]), at.shape[1] - len(pins[0])])
        self._vectors = np.concatenate([at, np.broadcast_to(bound[:, None], (*at.shape[:2], 1))], axis=2)[..., None]
        frames = [_place(first[0].arm, pin)[0] for pin in pins[0]]
        pivots = frames[2 * self.count :]
        self._frames = np.array([*frames, *pivots, *pivots, *range(len(self._revolute))])
        self._signs = np.array([_signs(first, end) for end in (0, 1)])  # (2, nc, nq)
        if self._bars:
            bars = [[row[i].four_bar for i in self._bars] for row in linkages]
            self._rocker, self._coupler, self._side = (
                np.array([[float(getattr(b, name)) for b in row] for row in bars])
                for name in ("rocker", "coupler", "side")
            )

    def __call__(self, frames: Array) -> tuple[Array, Array]:
        """Pin-to-pin lengths (n, nc) [m] and moment arms (n, nc, nq) in joint frames; NaN where a four-bar is open."""
        nc, joints, bars = self.count, len(self._revolute), self._bars
        vectors = (frames.take(self._frames, axis=1) @ self._vectors)[:, :, :3, 0]
        end = vectors[:, nc : 2 * nc]
        if bars:
            pivot, right, up = vectors[:, 2 * nc : -joints].reshape(len(frames), 3, -1, 3).transpose(1, 0, 2, 3)
            plane = right + 1j * up
            lug = _dot(end[:, bars] - pivot, plane)
            knee = self._knee(lug)
            end = end.copy()
            end[:, bars] = pivot + (knee[..., None] * plane.conj()).real
        span = end - vectors[:, :nc]
        length = np.sqrt(_dot(span, span))
        forces = np.empty((len(frames), 2 * nc + joints, 3))
        forces[:, :nc], forces[:, 2 * nc :] = span / -length[:, :, None], vectors[:, -joints:]
        forces[:, nc : 2 * nc] = -forces[:, :nc]
        if bars:
            at_knee, coupler = _dot(-forces[:, bars], plane), lug - knee
            share = (knee.conj() * at_knee).imag / (knee.conj() * coupler).imag
            forces[:, [nc + i for i in bars]] = ((share * coupler)[..., None] * plane.conj()).real
        work = self._work(frames, vectors[:, : 2 * nc], forces)
        return length, (work.reshape(-1, 2, nc, joints) * self._signs).sum(axis=1)

    def _work(self, frames: Array, points: Array, forces: Array) -> Array:
        """What forces f at points P do per unit of each joint (n, 2 nc, nq); the last of ``forces`` are the axes a.

        f·(a × (P − o)) = (f, P × f)·(o × a, a) for a joint that turns at o, f·a for one that slides.
        """
        count = points.shape[1]
        places = np.concatenate([points, frames[:, :-1, :3, 3]], axis=1)
        moments, axes = _cross(places, forces), forces[:, count:]
        screws = np.empty((len(frames), self._revolute.size, 6))
        screws[:, :, :3], screws[:, :, 3:] = moments[:, count:], axes
        if self._slides.any():
            screws[:, self._slides, :3], screws[:, self._slides, 3:] = axes[:, self._slides], 0.0
        wrenches = np.concatenate([forces[:, :count], moments[:, :count]], axis=2)
        return wrenches @ screws.transpose(0, 2, 1)

    def _knee(self, lug: Array) -> Array:
        """Knee from the pivot, as ``linkage.knee``: u (½ + (a² − b²)/2e ± i √(a²/e − …²)), e = |u|²."""
        e = lug.real**2 + lug.imag**2
        x = 0.5 + (self._rocker**2 - self._coupler**2) / (2 * e)
        return np.asarray(lug * (x + 1j * self._side * np.sqrt(self._rocker**2 / e - x * x)))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=2))


_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


def _cross(a: Array, b: Array) -> Array:
    return a.take(_NEXT, axis=2) * b.take(_AFTER, axis=2) - a.take(_AFTER, axis=2) * b.take(_NEXT, axis=2)


def shape(linkages: Sequence[Linkage]) -> Hashable:
    """What cylinders must have in common to be stacked: their joints, and whether a four-bar lies between."""
    frames = tuple(_place(linkages[0].arm, pin)[0] for pin in _pins(linkages))
    signs = tuple(_signs(linkages, end).tobytes() for end in (0, 1))
    return frames, signs, tuple(linkage.four_bar is not None for linkage in linkages)


def _far(linkage: Linkage) -> Pin:
    pin = linkage.four_bar.lug if linkage.four_bar else linkage.rod_end
    assert pin is not None
    return pin


def _pins(linkages: Sequence[Linkage]) -> list[Pin]:
    """All bases, then all rod ends or lugs, then the pivots of the four-bars."""
    pivots = [linkage.four_bar.pivot for linkage in linkages if linkage.four_bar]
    return [*(linkage.base for linkage in linkages), *(_far(linkage) for linkage in linkages), *pivots]


def _place(arm: Arm, pin: Pin) -> tuple[int, Array]:
    """Joint whose frame carries the pin (−1: the world), and its place there [m]."""
    body = arm.links[pin.link]
    return body.joint, np.asarray(body.translation + body.rotation @ np.array(pin.at))


def _planes(linkages: Sequence[Linkage]) -> Array:
    """Right, then up, of every four-bar in the joint frame of its pivot."""
    pivots = [linkage.four_bar.pivot for linkage in linkages if linkage.four_bar]
    rotations = [linkages[0].arm.links[pivot.link].rotation for pivot in pivots]
    return np.array([rotation[:, column] for column in (0, 2) for rotation in rotations]).reshape(-1, 3)


def _signs(linkages: Sequence[Linkage], end: int) -> Array:
    """Sign (nc, nq) with which each joint moves a pin (end 0: base, 1: far), as seen from the observer; 0: not."""
    signs = np.zeros((len(linkages), len(linkages[0].arm.joints)))
    for row, linkage in zip(signs, linkages, strict=True):
        observer = linkage.four_bar.pivot.link if linkage.four_bar else linkage.base.link
        for joint, sign in linkage.arm.path(observer, (linkage.base, _far(linkage))[end].link):
            row[joint] = sign
    return signs
