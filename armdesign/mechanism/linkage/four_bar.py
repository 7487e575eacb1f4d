"""A four-bar: the rod end pushes the knee, where a rocker and a coupler meet.

It lies in the x–z plane of its pivot's link. With u from pivot to lug, v = u turned left,
i = 1/(u·u), rocker a and coupler b:  knee = pivot + x u + y v,  x = ½ + (a² − b²) i/2,
y = ± sqrt(a² i − x²).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal, Self

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.errors import MachineFileError
from armdesign.mechanism.arm import RigidPoses
from armdesign.mechanism.jets import ScalarJet, VectorJet
from armdesign.mechanism.linkage.base import Linkage, Move, Pin, RodEnd


@dataclass(frozen=True, kw_only=True)
class FourBar(Linkage):
    """A rocker from ``pivot`` to the knee and a coupler from the knee to ``lug``, lengths in [m].

    The knee lies ``left`` or ``right`` of the line pivot → lug, seen with x right and z up in the
    pivot's link.
    """

    key = "four_bar"
    title = "four-bar"
    pin_names = ("base", "pivot", "lug")
    bar_names = ("rocker", "coupler")
    legs = (("rocker", "pivot"), ("coupler", "lug"))
    rod_end_name = "knee"
    rod_end_words = "on the knee"
    transmission_words = "rocker–coupler angle"
    closing_words = (
        "rocker + coupler must exceed the distance pivot–lug and |rocker − coupler| stay below it"
    )

    pivot: Pin
    lug: Pin
    rocker: float
    coupler: float
    knee: Literal["left", "right"]

    @property
    def side(self) -> int:
        """+1 if the knee is on the left, else −1."""
        return 1 if self.knee == "left" else -1

    @property
    def mirrored(self) -> tuple[str, str, str, Self]:
        """The four-bar with its knee on the other side of pivot and lug."""
        other: Literal["left", "right"] = "right" if self.knee == "left" else "left"
        return "knee", self.knee, other, replace(self, knee=other)

    @property
    def observer(self) -> str:
        """The pivot's link."""
        return self.pivot.link

    def rod_end_from(self, poses: RigidPoses, link: str, joints: tuple[int, ...]) -> RodEnd:
        """The knee seen from a link, with derivatives by some joints."""
        knee = _Knee(self, poses, link, joints)
        return RodEnd(knee.position, knee.derivative)

    def closes(self, poses: RigidPoses) -> Flags:
        """Whether rocker and coupler reach each other (n,): whether y² > 0."""
        u = self._pivot_to_lug(poses)
        e = np.einsum("ni,ni->n", u, u)
        x = 0.5 + (self.rocker**2 - self.coupler**2) / (2 * e)
        return np.asarray(self.rocker**2 / e - x**2 > 0)

    def transmission(
        self, poses: RigidPoses, moves: Sequence[Move] = ()
    ) -> tuple[Array, list[Array]]:
        """Cosine of the angle at the knee (n,), and its derivatives by coordinates of places.

        cos = (a² + b² − e)/(2ab) with e = u·u; beyond ±1 where the bars do not meet.
        """
        a, b, u = self.rocker, self.coupler, self._pivot_to_lug(poses)
        e = np.einsum("ni,ni->n", u, u)
        slopes = []
        for name, axis in moves:
            if name in self.bar_names:
                bar, other = (a, b) if name == "rocker" else (b, a)
                slopes.append((bar**2 - other**2 + e) / (2 * bar**2 * other))
            elif name == "base":
                slopes.append(np.zeros(len(e)))
            else:
                direction = self.arm.link_rotation(poses, getattr(self, name).link)[:, :, axis]
                sign = 1.0 if name == "pivot" else -1.0
                slopes.append(np.einsum("ni,ni->n", u, direction) * (sign / (a * b)))
        return (a**2 + b**2 - e) / (2 * a * b), slopes

    def fault(self, where: str) -> MachineFileError | None:
        """A pivot and lug that no revolute joint about the pivot link's y axis turns."""
        arm, ends = self.arm, [self.pivot.link, self.lug.link]
        path = arm.path(*ends)
        if not path and arm.frozen_between(ends):
            return None  # it stands still: its knee is a pin of the pivot's link
        where = f"{where}.{self.key}"
        if len(path) != 1 or not arm.coordinates[path[0][0]].revolute:
            fault = "pivot and lug are not on the two links of one revolute joint"
            return MachineFileError(where, fault, "place them so")
        j = path[0][0]
        zero = arm.kinematics(np.zeros((1, len(arm.joints))))
        normal = arm.link_rotation(zero, self.pivot.link)[0, :, 1]
        if abs(abs(float(normal @ zero.axis[0, j])) - 1) > 1e-6:
            name = arm.coordinates[j].name
            fault = f'joint "{name}" does not turn about the y axis of the pivot\'s link'
            return MachineFileError(where, fault, "a four-bar lies in its link's x–z plane")
        return None

    def rod_end_record(self) -> dict[str, Any]:
        """Record of the knee for compiled code: ``right`` and ``up`` span its plane."""
        rotation = self.arm.links[self.pivot.link].rotation
        return {
            **{"far": self.lug, "pivot": self.pivot},
            **{"right": rotation[:, 0], "up": rotation[:, 2]},
            **{"rocker": self.rocker, "coupler": self.coupler, "side": self.side},
        }

    def _pivot_to_lug(self, poses: RigidPoses) -> Array:
        """The vector from pivot to lug in the plane of the four-bar (n, 3) [m]."""
        u = self.point(poses, self.lug) - self.point(poses, self.pivot)
        normal = self.arm.link_rotation(poses, self.pivot.link)[:, :, 1]
        return np.asarray(u - np.einsum("ni,ni->n", u, normal)[:, None] * normal)


class _Knee:
    """The knee seen from a link; NaN where the two bars cannot reach each other."""

    def __init__(
        self, bars: FourBar, poses: RigidPoses, seen_from: str, joints: tuple[int, ...]
    ) -> None:
        self._bars, a, b = bars, bars.rocker, bars.coupler
        self._direction = partial(bars.arm.direction, poses, seen_from=seen_from, joints=joints)
        pins = (bars.pivot, bars.lug)
        pivot, lug = (bars._motion(poses, pin, seen_from, joints) for pin in pins)
        self._normal = self._direction(bars.pivot.link, np.array([0.0, -1.0, 0.0]))
        self._u = self._in_plane(lug - pivot)
        self._i = self._u.dot(self._u).reciprocal()
        self._x = self._i * ((a**2 - b**2) / 2) + 0.5
        self._y = (self._i * a**2 - self._x * self._x).sqrt() * bars.side
        self.position = pivot + self._from_pivot(self._u, self._x, self._y)

    def derivative(self, name: str, axis: int) -> VectorJet:
        """Derivative of the knee by a coordinate of ``pivot`` or ``lug`` or a bar's length.

        ∂i = −2 i² u·∂u,  ∂x = (a² − b²) ∂i/2 + (a ∂a − b ∂b) i,
        ∂y = (a² ∂i + 2 a ∂a i − 2 x ∂x)/(2y).
        """
        a, b, u = self._bars.rocker, self._bars.coupler, self._u
        i, x, y = self._i, self._x, self._y
        if name in self._bars.bar_names:
            d_x = i * (a if name == "rocker" else -b)
            d_square = i * (2 * a if name == "rocker" else 0.0)
            return self._from_pivot(u, d_x, (d_square - x * d_x * 2.0) * y.reciprocal() * 0.5)
        step = self._direction(getattr(self._bars, name).link, np.eye(3)[axis])
        d_u = self._in_plane(step if name == "lug" else -step)
        d_i = i * i * u.dot(d_u) * -2.0
        d_x = d_i * ((a**2 - b**2) / 2)
        d_y = (d_i * a**2 - x * d_x * 2.0) * y.reciprocal() * 0.5
        moved = self._from_pivot(d_u, x, y) + self._from_pivot(u, d_x, d_y)
        return moved if name == "lug" else step + moved

    def _in_plane(self, vector: VectorJet) -> VectorJet:
        """The part in the plane of the four-bar, whose pins may be given at different y."""
        return vector - self._normal * self._normal.dot(vector)

    def _from_pivot(self, u: VectorJet, x: ScalarJet, y: ScalarJet) -> VectorJet:
        """The vector x u + y v."""
        return u * x + self._normal.cross(u) * y
