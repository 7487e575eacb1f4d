"""A four-bar: the rod end pushes the knee, where a rocker and a coupler meet.

It lies in the x–z plane of its pivot's link. With u from pivot to lug, v = u turned left,
i = 1/(u·u), rocker a and coupler b:  knee = pivot + x u + y v,  x = ½ + (a² − b²) i/2,
y = ± sqrt(a² i − x²).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import MachineFileError
from armdesign.mechanism.jets import ScalarJet, VectorJet, dot
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.rigid_poses import RigidPoses


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

    def rod_end_from(self, poses: RigidPoses, link: str, joints: tuple[int, ...]) -> VectorJet:
        """The knee seen from a link; NaN where the two bars cannot reach each other."""
        pivot, lug = (self._motion(poses, pin, link, joints) for pin in (self.pivot, self.lug))
        back = np.array([0.0, -1.0, 0.0])
        normal = self.arm.direction(poses, self.pivot.link, back, link, joints)
        v = normal.cross(lug - pivot)
        u = v.cross(normal)  # in the plane of the bars; its pins may be given at different y
        x, y = self._knee(v.dot(v))
        return pivot + (u * x + v * y)

    def _knee(self, e: ScalarJet) -> tuple[ScalarJet, ScalarJet]:
        """The x and y of the knee by e = u·u; NaN where the two bars cannot reach each other."""
        square, c, i = self.rocker**2, (self.rocker**2 - self.coupler**2) / 2, 1 / e.value
        i_2 = i * i
        i_3 = i_2 * i
        x, slope, curvature = 0.5 + c * i, -c * i_2, 2 * c * i_3
        left = square * i - x * x  # y², by whose derivatives y has its own
        y = self.side * np.sqrt(np.where(np.real(left) > 0, left, np.nan))
        steep = (-square * i_2 - 2 * x * slope) / (2 * y)
        bent = (square * i_3 - slope * slope - x * curvature - steep * steep) / y
        return e.through(x, slope, curvature), e.through(y, steep, bent)

    def closure(self, poses: RigidPoses) -> Array:
        """Squared sine of the angle at the knee (n,), y² e²/(ab)² with e = u·u."""
        a, b, u = self.rocker, self.coupler, self._pivot_to_lug(poses)
        e = dot(u, u)
        x = 0.5 + (a**2 - b**2) / (2 * e)
        return np.asarray((a**2 / e - x**2) * (e / (a * b)) ** 2)

    def transmission(self, poses: RigidPoses) -> Array:
        """Cosine of the angle at the knee (n,), beyond ±1 where the bars do not meet.

        cos = (a² + b² − e)/(2ab) with e = u·u.
        """
        a, b, u = self.rocker, self.coupler, self._pivot_to_lug(poses)
        return np.asarray((a**2 + b**2 - dot(u, u)) / (2 * a * b))

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
        zero = arm.zero
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
        return np.asarray(u - dot(u, normal)[:, None] * normal)
