"""A pin-to-pin cylinder: its rod end is a pin of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.rigid_poses import RigidPoses


@dataclass(frozen=True, kw_only=True)
class Direct(Linkage):
    """A rod end pinned to a link."""

    key = "rod_end"
    title = "pin-to-pin cylinder"
    pin_names = ("base", "rod_end")

    rod_end: Pin

    def rod_end_from(self, poses: RigidPoses, link: str, joints: tuple[int, ...]) -> VectorJet:
        """The rod end seen from a link, with derivatives by some joints."""
        return self._motion(poses, self.rod_end, link, joints)

    def rod_end_record(self) -> dict[str, Any]:
        """Record of the rod end for compiled code."""
        return {"far": self.rod_end}
