"""Linkages: how the pins of a cylinder turn joint coordinates into its length.

ℓ(q) is the distance between two pins; its derivatives are the moment arm r = ∂ℓ/∂q and the moment-arm derivative
H = ∂²ℓ/∂q². A pin-to-pin cylinder spans two links; a four-bar cylinder spans a link and the knee between a rocker and a
coupler. All of it is seen from one link, where the rest of the arm moves; any number of revolute or prismatic joints
may lie between the pins. Axis 0 is the pose.

With d = P − B between rod-end pin P and base pin B:  ℓ = |d|,  r_j = d·d_j/ℓ,  H_jk = (d_j·d_k + d·d_jk − r_j r_k)/ℓ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from armdesign.arm import Arm, PointMotion, RigidPoses, cross
from armdesign.arrays import Array, Flags


@dataclass(frozen=True, kw_only=True)
class Pin:
    """A pin of a link, at [m] in the link's frame."""

    link: str
    at: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class FourBar:
    """Rocker on ``pivot`` and coupler on ``lug`` meet at the knee, which the rod end pushes.

    ``side`` is +1 when the knee lies left of the line pivot → lug, seen with x right and z up in the pivot's link,
    else −1.
    """

    pivot: Pin
    lug: Pin
    rocker: float  # [m]
    coupler: float  # [m]
    side: int


@dataclass(frozen=True, eq=False)
class Actuation:
    """Length [m], moment arm [m/rad] and its derivative over n poses and nq joints of one cylinder."""

    length: Array  # (n,)
    moment_arm: Array  # (n, nq)
    moment_arm_derivative: Array  # (n, nq, nq)


@dataclass(frozen=True, kw_only=True)
class Linkage:
    """The pins of one cylinder: ``rod_end`` on a link, or on the knee of ``four_bar``."""

    base: Pin
    rod_end: Pin | None = None
    four_bar: FourBar | None = None
    arm: Arm = field(repr=False, compare=False)

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """Coordinates that change this cylinder's length."""
        far = self.four_bar.lug if self.four_bar else self.rod_end
        assert far is not None
        ends = [far.link, self.base.link]
        return tuple(sorted({j for end in ends for j, _ in self.arm.path(self._observer, end)}))

    @property
    def _observer(self) -> str:
        """The link from which all motion is seen."""
        return self.four_bar.pivot.link if self.four_bar else self.base.link

    def _rod_end(self, poses: RigidPoses) -> PointMotion:
        if self.four_bar is not None:
            return knee(self.arm, poses, self.four_bar, self.joints)
        assert self.rod_end is not None
        return self.arm.motion(poses, self.rod_end.link, np.array(self.rod_end.at), self._observer, self.joints)

    def _span(self, poses: RigidPoses) -> PointMotion:
        """The vector from base pin to rod end, with its derivatives."""
        end = self._rod_end(poses)
        base = self.arm.motion(poses, self.base.link, np.array(self.base.at), self._observer, self.joints)
        return PointMotion(end.position - base.position, end.jacobian - base.jacobian, end.hessian - base.hessian)

    def with_pin(self, pin: str, at: tuple[float, float, float]) -> Linkage:
        """The same linkage with the pin ``base`` or ``rod_end`` elsewhere [m] in its link."""
        if pin == "base":
            return replace(self, base=replace(self.base, at=at))
        if self.rod_end is None:
            raise ValueError("a four-bar cylinder has no rod_end pin on a link")
        return replace(self, rod_end=replace(self.rod_end, at=at))

    def pins(self, poses: RigidPoses) -> list[Array]:
        """World positions (n, 3) [m] of base pin and rod end; with a four-bar also of pivot, knee and lug in a row."""
        end = self._rod_end(poses).position
        found = [self.arm.point(poses, self.base.link, np.array(self.base.at)), end]
        if self.four_bar is not None:
            pivot, lug = self.four_bar.pivot, self.four_bar.lug
            found += [self.arm.point(poses, pivot.link, np.array(pivot.at)), end]
            found += [self.arm.point(poses, lug.link, np.array(lug.at))]
        return found

    def length(self, poses: RigidPoses) -> Array:
        """Pin-to-pin length (n,) [m]; NaN where the four-bar does not close."""
        return np.asarray(np.linalg.norm(self._span(poses).position, axis=1))

    def actuation(self, poses: RigidPoses) -> Actuation:
        """Length, moment arm and its derivative at the poses."""
        span = self._span(poses)
        length = np.linalg.norm(span.position, axis=1)
        arm = np.einsum("ni,nji->nj", span.position, span.jacobian) / length[:, None]
        curve = _second(span, span) - arm[:, :, None] * arm[:, None, :]
        return self._scatter(length, arm, curve / length[:, None, None])

    def sensitivity(self, poses: RigidPoses, pin: str, axis: int) -> Actuation:
        """Exact derivative of the actuation by coordinate ``axis`` of the pin ``base`` or ``rod_end`` in its link."""
        return self.sensitivities(poses, [(pin, axis)])[0]

    def sensitivities(self, poses: RigidPoses, moves: Sequence[tuple[str, int]]) -> list[Actuation]:
        """Exact derivatives of the actuation by several pin coordinates (pin, axis).

        d moves by ∂d = ± the link's axis, which turns with the link; the rest is the chain rule on ℓ² = d·d and its
        derivatives by q.
        """
        span = self._span(poses)
        length = np.linalg.norm(span.position, axis=1)
        arm = np.einsum("ni,nji->nj", span.position, span.jacobian) / length[:, None]
        curve = (_second(span, span) - arm[:, :, None] * arm[:, None, :]) / length[:, None, None]
        return [self._sensitivity(poses, span, (length, arm, curve), *move) for move in moves]

    def _sensitivity(
        self, poses: RigidPoses, span: PointMotion, values: tuple[Array, Array, Array], pin: str, axis: int
    ) -> Actuation:
        place = self.base if pin == "base" else self.rod_end
        if place is None:
            raise ValueError(f"this cylinder has no pin {pin!r} on a link")
        sign = -1.0 if pin == "base" else 1.0
        shift = self.arm.direction(poses, place.link, sign * np.eye(3)[axis], self._observer, self.joints)
        length, arm, curve = values
        d_length = np.einsum("ni,ni->n", span.position, shift.position) / length
        d_first = np.einsum("ni,nji->nj", shift.position, span.jacobian)  # of ℓ r = d·d_j
        d_first += np.einsum("ni,nji->nj", span.position, shift.jacobian)
        d_arm = (d_first - arm * d_length[:, None]) / length[:, None]
        d_outer = d_arm[:, :, None] * arm[:, None, :]
        d_second = _second(span, shift) + _second(shift, span)  # of ℓ H + r r = d_j·d_k + d·d_jk
        d_curve = d_second - d_outer - np.swapaxes(d_outer, 1, 2) - curve * d_length[:, None, None]
        return self._scatter(d_length, d_arm, d_curve / length[:, None, None])

    def _scatter(self, length: Array, arm: Array, curve: Array) -> Actuation:
        """From this cylinder's joints to all joints of the arm."""
        n, nq, own = len(length), len(self.arm.joints), np.array(self.joints)
        all_arm, all_curve = np.zeros((n, nq)), np.zeros((n, nq, nq))
        all_arm[:, own] = arm
        all_curve[np.ix_(np.arange(n), own, own)] = curve
        return Actuation(length, all_arm, all_curve)

    def closes(self, poses: RigidPoses) -> Flags:
        """Whether rocker and coupler reach each other (n,); always true without a four-bar."""
        if self.four_bar is None:
            return np.ones(len(poses), dtype=bool)
        return np.asarray(_squared_height(self._pivot_to_lug(poses), self.four_bar) > 0)

    def transmission_angle(self, poses: RigidPoses) -> Array:
        """Angle between rocker and coupler at the knee (n,) [rad], folded into [0, π/2]."""
        assert self.four_bar is not None
        u = self._pivot_to_lug(poses)
        a, b = self.four_bar.rocker, self.four_bar.coupler
        cosine = (a**2 + b**2 - np.einsum("ni,ni->n", u, u)) / (2 * a * b)
        angle = np.arccos(np.clip(cosine, -1, 1))
        return np.minimum(angle, np.pi - angle)

    def _pivot_to_lug(self, poses: RigidPoses) -> Array:
        assert self.four_bar is not None
        pivot, lug = self.four_bar.pivot, self.four_bar.lug
        u = self.arm.point(poses, lug.link, np.array(lug.at)) - self.arm.point(poses, pivot.link, np.array(pivot.at))
        return _in_plane(u, -self.arm.link_rotation(poses, pivot.link)[:, :, 1])


def knee(arm: Arm, poses: RigidPoses, four_bar: FourBar, joints: tuple[int, ...]) -> PointMotion:
    """Where rocker and coupler meet, seen from the pivot's link.

    With u from pivot to lug, v = u turned left, e = u·u, rocker a and coupler b:
    knee = pivot + x u + y v,  x = ½ + (a² − b²)/(2e),  y = ± sqrt(a²/e − x²).
    NaN where the two bars cannot reach each other.
    """
    pivot = np.array(four_bar.pivot.at)
    lug = arm.motion(poses, four_bar.lug.link, np.array(four_bar.lug.at), four_bar.pivot.link, joints)
    normal = -arm.link_rotation(poses, four_bar.pivot.link)[:, :, 1]
    start = arm.point(poses, four_bar.pivot.link, pivot)
    u = _in_plane(lug.position - start, normal)
    v = cross(normal, u)
    v1 = cross(normal[:, None], lug.jacobian)
    v2 = cross(normal[:, None, None], lug.hessian)
    e1 = 2 * np.einsum("ni,nji->nj", u, lug.jacobian)
    e2 = 2 * _second(PointMotion(u, lug.jacobian, lug.hessian), PointMotion(u, lug.jacobian, lug.hessian))
    e = np.einsum("ni,ni->n", u, u)
    difference = four_bar.rocker**2 - four_bar.coupler**2
    x, dx, ddx = 0.5 + difference / (2 * e), -difference / (2 * e**2), difference / e**3
    w = _squared_height(u, four_bar)
    dw = -(four_bar.rocker**2) / e**2 - 2 * x * dx
    ddw = 2 * four_bar.rocker**2 / e**3 - 2 * dx**2 - 2 * x * ddx
    y = four_bar.side * np.sqrt(np.where(w > 0, w, np.nan))
    dy, ddy = dw / (2 * y), ddw / (2 * y) - dw**2 / (4 * y**3)
    position, jacobian, hessian = start, np.zeros_like(lug.jacobian), np.zeros_like(lug.hessian)
    for (s, ds, dds), (d0, d1, d2) in (
        ((x, dx, ddx), (u, lug.jacobian, lug.hessian)),
        ((y, dy, ddy), (v, v1, v2)),
    ):
        s1 = ds[:, None] * e1
        s2 = dds[:, None, None] * e1[:, :, None] * e1[:, None, :] + ds[:, None, None] * e2
        mixed = s1[:, :, None, None] * d1[:, None, :, :]
        position = position + s[:, None] * d0
        jacobian = jacobian + s1[:, :, None] * d0[:, None] + s[:, None, None] * d1
        hessian = hessian + s2[..., None] * d0[:, None, None] + mixed + np.swapaxes(mixed, 1, 2)
        hessian = hessian + s[:, None, None, None] * d2
    return PointMotion(position, jacobian, hessian)


def _squared_height(u: Array, four_bar: FourBar) -> Array:
    """(height of the knee over the line pivot–lug / their distance)²; negative where the bars do not meet."""
    e = np.einsum("ni,ni->n", u, u)
    x = 0.5 + (four_bar.rocker**2 - four_bar.coupler**2) / (2 * e)
    return np.asarray(four_bar.rocker**2 / e - x**2)


def _in_plane(u: Array, normal: Array) -> Array:
    return np.asarray(u - np.einsum("ni,ni->n", u, normal)[:, None] * normal)


def _second(a: PointMotion, b: PointMotion) -> Array:
    """a_j·b_k + a·b_jk."""
    return np.asarray(
        np.einsum("nji,nki->njk", a.jacobian, b.jacobian) + np.einsum("ni,njki->njk", a.position, b.hessian)
    )
