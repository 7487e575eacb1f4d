"""Linkages: how the pins of a cylinder turn joint coordinates into its length.

ℓ(q) is the distance between two pins; its derivatives are the moment arm r = ∂ℓ/∂q and the
moment-arm derivative H = ∂²ℓ/∂q². A pin-to-pin cylinder spans two links; a four-bar cylinder spans
a link and the knee between a rocker and a coupler. All of it is seen from one link, where the rest
of the arm moves; any number of revolute or prismatic joints may lie between the pins. Axis 0 is
the pose.

The formulas are written on jets, so ℓ = |P − B| between base pin B and rod-end pin P carries r and
H with it: r_j = d·d_j/ℓ,  H_jk = (d_j·d_k + d·d_jk − r_j r_k)/ℓ  with d = P − B.

What a design may move is named by a place: a pin (``base``, ``rod_end``; ``pivot``, ``lug`` of a
four-bar) with three coordinates in its link, or a bar (``rocker``, ``coupler``) with one, its
length.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeAlias

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.mechanism.arm import Arm, RigidPoses
from armdesign.mechanism.jets import ScalarJet, VectorJet

PINS, BARS = ("base", "rod_end", "pivot", "lug"), ("rocker", "coupler")
OF_FOUR_BAR = ("pivot", "lug", *BARS)
Move: TypeAlias = tuple[str, int]  # a place and which of its coordinates


def key_of(place: str) -> str:
    """Key of a linkage's place in its cylinder's table of the machine file."""
    key = f"{place}_mm" if place in BARS else f"{place}.at_mm"
    return f"four_bar.{key}" if place in OF_FOUR_BAR else key


@dataclass(frozen=True, kw_only=True)
class Pin:
    """A pin of a link, at [m] in the link's frame."""

    link: str
    at: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class FourBar:
    """Rocker on ``pivot`` and coupler on ``lug`` meet at the knee, which the rod end pushes.

    ``side`` is +1 when the knee lies left of the line pivot → lug, seen with x right and z up in
    the pivot's link, else −1.
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
    def all_pins(self) -> list[Pin]:
        """Every pin on a link: the base, and the rod end or both ends of the four-bar."""
        return [pin for pin in map(self.pin, PINS) if pin is not None]

    @property
    def _observer(self) -> str:
        """The link from which all motion is seen."""
        return self.four_bar.pivot.link if self.four_bar else self.base.link

    def _rod_end(self, poses: RigidPoses) -> VectorJet:
        if self.four_bar is not None:
            return Knee(self.arm, poses, self.four_bar, self._observer, self.joints).at
        assert self.rod_end is not None
        return self.arm.motion(
            poses, self.rod_end.link, np.array(self.rod_end.at), self._observer, self.joints
        )

    def _span(self, poses: RigidPoses) -> VectorJet:
        """The vector from base pin to rod end."""
        base = self.arm.motion(
            poses, self.base.link, np.array(self.base.at), self._observer, self.joints
        )
        return self._rod_end(poses) - base

    def place(self, name: str) -> tuple[float, ...] | None:
        """Coordinates of a pin in its link (3) or length of a bar (1) [m].

        None where the linkage has no such place.
        """
        pin = self.pin(name)
        if pin is not None:
            return pin.at
        return (
            (getattr(self.four_bar, name),) if name in BARS and self.four_bar is not None else None
        )

    def pin(self, name: str) -> Pin | None:
        """A pin by its name; None where the linkage has no such pin."""
        holder = self.four_bar if name in OF_FOUR_BAR else self
        return getattr(holder, name, None) if name in PINS else None

    def with_place(self, name: str, at: Sequence[float]) -> Linkage:
        """The same linkage with a pin elsewhere in its link, or a bar of another length [m]."""
        if self.place(name) is None:
            raise ValueError(f"this cylinder has no {name!r}")
        if name not in OF_FOUR_BAR:
            return replace(self, **{name: replace(getattr(self, name), at=tuple(at))})
        old = getattr(self.four_bar, name)
        change: dict[str, Any] = {name: replace(old, at=tuple(at)) if name in PINS else at[0]}
        assert self.four_bar is not None
        return replace(self, four_bar=replace(self.four_bar, **change))

    def pins(self, poses: RigidPoses) -> list[Array]:
        """World positions (n, 3) [m] of base pin and rod end.

        With a four-bar also of pivot, knee and lug in a row.
        """
        end = self._rod_end(poses).value
        found = [self.arm.point(poses, self.base.link, np.array(self.base.at)), end]
        if self.four_bar is not None:
            pivot, lug = self.four_bar.pivot, self.four_bar.lug
            found += [self.arm.point(poses, pivot.link, np.array(pivot.at)), end]
            found += [self.arm.point(poses, lug.link, np.array(lug.at))]
        return found

    def bars(self, poses: RigidPoses, length: float) -> dict[str, tuple[VectorJet, VectorJet]]:
        """Both ends of every moving bar as seen from the root, with derivatives by all joints.

        Barrel and rod are as long as the closed cylinder, ``length`` [m]: one from the base pin,
        one up to the rod end.
        """
        arm, joints = self.arm, tuple(range(len(self.arm.joints)))

        def seen(pin: Pin) -> VectorJet:
            return arm.motion(poses, pin.link, np.array(pin.at), arm.root, joints)

        found: dict[str, tuple[VectorJet, VectorJet]] = {}
        if self.four_bar is not None:
            end = Knee(arm, poses, self.four_bar, arm.root, joints).at
            found = {
                "rocker": (seen(self.four_bar.pivot), end),
                "coupler": (end, seen(self.four_bar.lug)),
            }
        else:
            assert self.rod_end is not None
            end = seen(self.rod_end)
        base = seen(self.base)
        span = end - base
        along = span * (span.dot(span).sqrt().reciprocal() * length)
        return {"barrel": (base, base + along), "rod": (end - along, end), **found}

    def _distinct(self, poses: RigidPoses) -> tuple[RigidPoses, Array | slice]:
        """Poses at which this cylinder is somewhere else, and which of them each pose is to it."""
        return poses.distinct(self.joints[0]) if len(self.joints) == 1 else (poses, slice(None))

    def length(self, poses: RigidPoses) -> Array:
        """Pin-to-pin length (n,) [m]; NaN where the four-bar does not close."""
        few, back = self._distinct(poses)
        return np.asarray(np.linalg.norm(self._span(few).value, axis=1)[back])

    def actuation(self, poses: RigidPoses) -> Actuation:
        """Length, moment arm and its derivative at the poses."""
        few, back = self._distinct(poses)
        span = self._span(few)
        return self._scatter(span.dot(span).sqrt(), back)

    def sensitivity(self, poses: RigidPoses, name: str, axis: int) -> Actuation:
        """Exact derivative of the actuation by one coordinate of a place."""
        return self.sensitivities(poses, [(name, axis)])[0]

    def sensitivities(self, poses: RigidPoses, moves: Sequence[Move]) -> list[Actuation]:
        """Exact derivatives of the actuation by several coordinates of places.

        d moves by ∂d: ± the link's axis, which turns with the link, or what the knee makes of it;
        ∂ℓ = d·∂d/ℓ, on jets.
        """
        few, back = self._distinct(poses)
        span = self._span(few)
        inverse = span.dot(span).sqrt().reciprocal()
        return [
            self._scatter(span.dot(shift) * inverse, back) for shift in self._shifts(few, moves)
        ]

    def _shifts(self, poses: RigidPoses, moves: Sequence[Move]) -> Iterator[VectorJet]:
        """How the span moves with each coordinate."""
        knee = None
        for name, axis in moves:
            if self.place(name) is None:
                raise ValueError(f"this cylinder has no {name!r}")
            if name in OF_FOUR_BAR:
                assert self.four_bar is not None
                knee = knee or Knee(self.arm, poses, self.four_bar, self._observer, self.joints)
                yield knee.shift(name, axis)
            else:
                sign, link = (
                    (-1.0, self.base.link) if name == "base" else (1.0, getattr(self, name).link)
                )
                yield self.arm.direction(
                    poses, link, sign * np.eye(3)[axis], self._observer, self.joints
                )

    def _scatter(self, jet: ScalarJet, back: Array | slice) -> Actuation:
        """From this cylinder's joints to all joints of the arm, and ``back`` to all poses."""
        length, nq = jet.value[back], len(self.arm.joints)
        arm, curve = np.zeros((len(length), nq)), np.zeros((len(length), nq, nq))
        for a, own in enumerate(self.joints):
            arm[:, own] = jet.first[back, a]
            for b, other in enumerate(self.joints):
                curve[:, own, other] = jet.second[back, a, b]
        return Actuation(length, arm, curve)

    def closes(self, poses: RigidPoses) -> Flags:
        """Whether rocker and coupler reach each other (n,); always true without a four-bar."""
        if self.four_bar is None:
            return np.ones(len(poses), dtype=bool)
        return np.asarray(_squared_height(self._pivot_to_lug(poses), self.four_bar) > 0)

    def transmission_angle(self, poses: RigidPoses) -> Array:
        """Angle between rocker and coupler at the knee (n,) [rad], folded into [0, π/2]."""
        return np.arccos(np.minimum(np.abs(self.transmission(poses)[0]), 1.0))

    def transmission(
        self, poses: RigidPoses, moves: Sequence[Move] = ()
    ) -> tuple[Array, list[Array]]:
        """Cosine of the angle at the knee (n,), beyond ±1 where the bars do not meet, and its derivatives by places.

        cos = (a² + b² − e)/(2ab) with e = u·u, by which only the places of the four-bar move it.
        """
        assert self.four_bar is not None
        a, b, u = self.four_bar.rocker, self.four_bar.coupler, self._pivot_to_lug(poses)
        e = np.einsum("ni,ni->n", u, u)
        slopes = []
        for name, axis in moves:
            if name in BARS:
                mine, other = (a, b) if name == "rocker" else (b, a)
                slopes.append((mine**2 - other**2 + e) / (2 * mine**2 * other))
                continue
            axes = self.arm.link_rotation(poses, getattr(self.four_bar, name).link)[:, :, axis]
            slopes.append(
                np.einsum("ni,ni->n", u, axes) * ((1.0 if name == "pivot" else -1.0) / (a * b))
            )
        return (a**2 + b**2 - e) / (2 * a * b), slopes

    def _pivot_to_lug(self, poses: RigidPoses) -> Array:
        assert self.four_bar is not None
        pivot, lug = self.four_bar.pivot, self.four_bar.lug
        u = self.arm.point(poses, lug.link, np.array(lug.at)) - self.arm.point(
            poses, pivot.link, np.array(pivot.at)
        )
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


class Knee:
    """Where rocker and coupler meet, seen from a link, and how it moves with pivot, lug and both bars.

    With u from pivot to lug, v = u turned left, i = 1/(u·u), rocker a and coupler b:
    knee = pivot + x u + y v,  x = ½ + (a² − b²) i/2,  y = ± sqrt(a² i − x²).
    NaN where the two bars cannot reach each other.
    """

    def __init__(
        self,
        arm: Arm,
        poses: RigidPoses,
        four_bar: FourBar,
        seen_from: str,
        joints: tuple[int, ...],
    ) -> None:
        self._bars = four_bar
        self._direction = partial(arm.direction, poses, seen_from=seen_from, joints=joints)
        a, b = four_bar.rocker, four_bar.coupler
        pivot, lug = (
            arm.motion(poses, p.link, np.array(p.at), seen_from, joints)
            for p in (four_bar.pivot, four_bar.lug)
        )
        self._normal = self._direction(four_bar.pivot.link, np.array([0.0, -1.0, 0.0]))
        self._u = self._flat(lug - pivot)
        self._i = self._u.dot(self._u).reciprocal()
        self._x = self._i * ((a**2 - b**2) / 2) + 0.5
        self._y = (self._i * a**2 - self._x * self._x).sqrt() * four_bar.side
        self.at = pivot + self._point(self._u, self._x, self._y)

    def shift(self, name: str, axis: int) -> VectorJet:
        """Derivative of the knee by a coordinate of ``pivot`` or ``lug`` or by the length of a bar.

        ∂i = −2 i² u·∂u,  ∂x = (a² − b²) ∂i/2 + (a ∂a − b ∂b) i,  ∂y = (a² ∂i + 2 a ∂a i − 2 x
        ∂x)/(2y).
        """
        a, b, i, x, y, u = (
            self._bars.rocker,
            self._bars.coupler,
            self._i,
            self._x,
            self._y,
            self._u,
        )
        if name in BARS:
            d_x = i * (a if name == "rocker" else -b)
            d_square = i * (2 * a if name == "rocker" else 0.0)
            return self._point(u, d_x, (d_square - x * d_x * 2.0) * y.reciprocal() * 0.5)
        step = self._direction(getattr(self._bars, name).link, np.eye(3)[axis])
        d_u = self._flat(step if name == "lug" else -step)
        d_i = i * i * u.dot(d_u) * -2.0
        d_x = d_i * ((a**2 - b**2) / 2)
        moved = self._point(d_u, x, y) + self._point(
            u, d_x, (d_i * a**2 - x * d_x * 2.0) * y.reciprocal() * 0.5
        )
        return moved if name == "lug" else step + moved

    def _flat(self, vector: VectorJet) -> VectorJet:
        """Its part in the plane of the four-bar: pins of one plane may be given at different y."""
        return vector - self._normal * self._normal.dot(vector)

    def _point(self, u: VectorJet, x: ScalarJet, y: ScalarJet) -> VectorJet:
        return u * x + self._normal.cross(u) * y


def _squared_height(u: Array, four_bar: FourBar) -> Array:
    """(height of the knee over the line pivot–lug / their distance)².

    Negative where the bars do not meet.
    """
    e = np.einsum("ni,ni->n", u, u)
    x = 0.5 + (four_bar.rocker**2 - four_bar.coupler**2) / (2 * e)
    return np.asarray(four_bar.rocker**2 / e - x**2)
