"""Linkages: how the pins of a cylinder turn joint coordinates into its length.

ℓ(q) is the distance between two pins; its derivatives are the moment arm r = ∂ℓ/∂q and the moment-arm derivative
H = ∂²ℓ/∂q². A pin-to-pin cylinder spans two links; a four-bar cylinder spans a link and the knee between a rocker and a
coupler. All of it is seen from one link, where the rest of the arm moves; any number of revolute or prismatic joints
may lie between the pins. Axis 0 is the pose.

The formulas are written on jets, so ℓ = |P − B| between base pin B and rod-end pin P carries r and H with it:
r_j = d·d_j/ℓ,  H_jk = (d_j·d_k + d·d_jk − r_j r_k)/ℓ  with d = P − B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from armdesign.arm import Arm, RigidPoses
from armdesign.arrays import Array, Flags
from armdesign.jets import ScalarJet, VectorJet


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

    def _rod_end(self, poses: RigidPoses) -> VectorJet:
        if self.four_bar is not None:
            return knee(self.arm, poses, self.four_bar, self._observer, self.joints)
        assert self.rod_end is not None
        return self.arm.motion(poses, self.rod_end.link, np.array(self.rod_end.at), self._observer, self.joints)

    def _span(self, poses: RigidPoses) -> VectorJet:
        """The vector from base pin to rod end."""
        base = self.arm.motion(poses, self.base.link, np.array(self.base.at), self._observer, self.joints)
        return self._rod_end(poses) - base

    def with_pin(self, pin: str, at: tuple[float, float, float]) -> Linkage:
        """The same linkage with the pin ``base`` or ``rod_end`` elsewhere [m] in its link."""
        if pin == "base":
            return replace(self, base=replace(self.base, at=at))
        if self.rod_end is None:
            raise ValueError("a four-bar cylinder has no rod_end pin on a link")
        return replace(self, rod_end=replace(self.rod_end, at=at))

    def pins(self, poses: RigidPoses) -> list[Array]:
        """World positions (n, 3) [m] of base pin and rod end; with a four-bar also of pivot, knee and lug in a row."""
        end = self._rod_end(poses).value
        found = [self.arm.point(poses, self.base.link, np.array(self.base.at)), end]
        if self.four_bar is not None:
            pivot, lug = self.four_bar.pivot, self.four_bar.lug
            found += [self.arm.point(poses, pivot.link, np.array(pivot.at)), end]
            found += [self.arm.point(poses, lug.link, np.array(lug.at))]
        return found

    def bars(self, poses: RigidPoses, length: float) -> dict[str, tuple[VectorJet, VectorJet]]:
        """Both ends of every moving bar as seen from the root, with derivatives by all joints.

        Barrel and rod are as long as the closed cylinder, ``length`` [m]: one from the base pin, one up to the rod end.
        """
        arm, joints = self.arm, tuple(range(len(self.arm.joints)))

        def seen(pin: Pin) -> VectorJet:
            return arm.motion(poses, pin.link, np.array(pin.at), arm.root, joints)

        found: dict[str, tuple[VectorJet, VectorJet]] = {}
        if self.four_bar is not None:
            end = knee(arm, poses, self.four_bar, arm.root, joints)
            found = {"rocker": (seen(self.four_bar.pivot), end), "coupler": (end, seen(self.four_bar.lug))}
        else:
            assert self.rod_end is not None
            end = seen(self.rod_end)
        base = seen(self.base)
        span = end - base
        along = span * (span.dot(span).sqrt().reciprocal() * length)
        return {"barrel": (base, base + along), "rod": (end - along, end), **found}

    def length(self, poses: RigidPoses) -> Array:
        """Pin-to-pin length (n,) [m]; NaN where the four-bar does not close."""
        return np.asarray(np.linalg.norm(self._span(poses).value, axis=1))

    def actuation(self, poses: RigidPoses) -> Actuation:
        """Length, moment arm and its derivative at the poses."""
        span = self._span(poses)
        return self._scatter(span.dot(span).sqrt())

    def sensitivity(self, poses: RigidPoses, pin: str, axis: int) -> Actuation:
        """Exact derivative of the actuation by coordinate ``axis`` of the pin ``base`` or ``rod_end`` in its link."""
        return self.sensitivities(poses, [(pin, axis)])[0]

    def sensitivities(self, poses: RigidPoses, moves: Sequence[tuple[str, int]]) -> list[Actuation]:
        """Exact derivatives of the actuation by several pin coordinates (pin, axis).

        d moves by ∂d = ± the link's axis, which turns with the link; then ∂ℓ = d·∂d/ℓ, on jets.
        """
        span = self._span(poses)
        inverse = span.dot(span).sqrt().reciprocal()
        return [self._scatter(span.dot(self._shift(poses, *move)) * inverse) for move in moves]

    def _shift(self, poses: RigidPoses, pin: str, axis: int) -> VectorJet:
        """How the span moves when a pin moves along an axis of its link."""
        place = self.base if pin == "base" else self.rod_end
        if place is None:
            raise ValueError(f"this cylinder has no pin {pin!r} on a link")
        sign = -1.0 if pin == "base" else 1.0
        return self.arm.direction(poses, place.link, sign * np.eye(3)[axis], self._observer, self.joints)

    def _scatter(self, jet: ScalarJet) -> Actuation:
        """From this cylinder's joints to all joints of the arm."""
        n, nq, own = len(jet.value), len(self.arm.joints), np.array(self.joints)
        arm, curve = np.zeros((n, nq)), np.zeros((n, nq, nq))
        arm[:, own] = jet.first
        curve[np.ix_(np.arange(n), own, own)] = jet.second
        return Actuation(jet.value, arm, curve)

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
        normal = self.arm.link_rotation(poses, pivot.link)[:, :, 1]
        return np.asarray(u - np.einsum("ni,ni->n", u, normal)[:, None] * normal)


@dataclass(frozen=True, kw_only=True)
class Gear:
    """What a motor is to its joint: its "length" is the joint's own coordinate, so r = 1 and H = 0."""

    joint: int

    @property
    def joints(self) -> tuple[int, ...]:
        """The coordinate that it turns."""
        return (self.joint,)

    def length(self, poses: RigidPoses) -> Array:
        """Angle of the joint (n,) [rad]."""
        return np.asarray(poses.q[:, self.joint])

    def actuation(self, poses: RigidPoses) -> Actuation:
        """Angle, and the unit moment arm."""
        n, nq = poses.q.shape
        arm = np.zeros((n, nq))
        arm[:, self.joint] = 1.0
        return Actuation(poses.q[:, self.joint], arm, np.zeros((n, nq, nq)))


def knee(arm: Arm, poses: RigidPoses, four_bar: FourBar, seen_from: str, joints: tuple[int, ...]) -> VectorJet:
    """Where rocker and coupler meet, seen from a link.

    With u from pivot to lug, v = u turned left, e = u·u, rocker a and coupler b:
    knee = pivot + x u + y v,  x = ½ + (a² − b²)/(2e),  y = ± sqrt(a²/e − x²).
    NaN where the two bars cannot reach each other.
    """
    a, b, plane = four_bar.rocker, four_bar.coupler, four_bar.pivot.link
    pivot, lug = (arm.motion(poses, p.link, np.array(p.at), seen_from, joints) for p in (four_bar.pivot, four_bar.lug))
    normal = arm.direction(poses, plane, np.array([0.0, -1.0, 0.0]), seen_from, joints)
    u = lug - pivot
    u = u - normal * normal.dot(u)  # pins of one plane may be given at different y
    inverse = u.dot(u).reciprocal()
    x = inverse * ((a**2 - b**2) / 2) + 0.5
    y = (inverse * a**2 - x * x).sqrt() * four_bar.side
    return pivot + u * x + normal.cross(u) * y


def _squared_height(u: Array, four_bar: FourBar) -> Array:
    """(height of the knee over the line pivot–lug / their distance)²; negative where the bars do not meet."""
    e = np.einsum("ni,ni->n", u, u)
    x = 0.5 + (four_bar.rocker**2 - four_bar.coupler**2) / (2 * e)
    return np.asarray(four_bar.rocker**2 / e - x**2)
