"""Rigid poses: inertia, gravity and placements of the bare links, and values that come twice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armdesign.arrays import Array, ReadOnly


@dataclass(frozen=True, eq=False)
class RigidPoses(ReadOnly):
    """Inertia, gravity and placements of the bare links, without cylinders and payload.

    Over k coordinates: the nq joints of q, then springs, which stand where they rest.
    """

    q: Array  # (n, nq) [rad, m]
    mass_matrix: Array  # (n, k, k)
    gravity_torque: Array  # (n, k)
    gravity_stiffness: Array  # (n, k, k), ∂g/∂q
    rotation: Array  # (n, k, 3, 3) joint frames in the world
    translation: Array  # (n, k, 3) [m]
    axis: Array  # (n, k, 3) joint axes in the world

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: Any) -> RigidPoses:
        """The poses ``rows`` selects (slice, mask or indices)."""
        return RigidPoses(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def distinct(self, *joints: int) -> tuple[RigidPoses, Array | slice]:
        """Poses with all values of some joints once, and for every pose the index of its values.

        The poses themselves where few values occur twice. Worked out once for the same joints.
        """
        if joints not in self._distinct:
            number = self.q[:, joints[0]]
            for joint in joints[1:]:
                _, before = np.unique(number, return_inverse=True)
                values, own = np.unique(self.q[:, joint], return_inverse=True)
                number = before * len(values) + own
            _, first, back = np.unique(number, return_index=True, return_inverse=True)
            few = 2 * len(first) < len(self)
            # not the poses themselves: they would wait for the collector of cycles
            self._distinct[joints] = (self[first], back) if few else None
        return self._distinct[joints] or (self, slice(None))

    def alone(
        self, joint: int, placed: Callable[[int, Array], RigidPoses]
    ) -> tuple[RigidPoses, Array | slice]:
        """A joint ``placed`` at each of its values, and for every pose the index of its value.

        At all poses' where few values occur twice. Worked out once for the same joint. What is
        computed there is the same to the last bit, whatever the other poses are.
        """
        if joint not in self._alone:
            values, back = np.unique(self.q[:, joint], return_inverse=True)
            if 2 * len(values) < len(self):
                self._alone[joint] = placed(joint, values), back
            else:
                self._alone[joint] = placed(joint, self.q[:, joint]), slice(None)
        return self._alone[joint]

    def repeated(self, times: int) -> RigidPoses:
        """All poses so many times, one after the other. Worked out once for the same number."""
        if times not in self._repeated:
            self._repeated[times] = self[np.tile(np.arange(len(self)), times)]
        return self._repeated[times]

    @cached_property
    def _distinct(self) -> dict[tuple[int, ...], tuple[RigidPoses, Array] | None]:
        return {}

    @cached_property
    def _alone(self) -> dict[int, tuple[RigidPoses, Array | slice]]:
        return {}

    @cached_property
    def _repeated(self) -> dict[int, RigidPoses]:
        return {}
