"""A family: n machines that differ in numbers of their file, as one machine.

Its numbers are arrays (n,), and axis 0 of its poses is the machine: the formulas of the package
are elementwise, so that inertia and stiffness of ten thousand machines cost as much as for
ten thousand poses. Numbers may be complex: a complex step (Squire and Trapp 1998) gives exact
derivatives, whatever key path it goes along.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.file.key_paths import Location
from armdesign.machine.file.numbers import with_values
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.mechanism.rigid_poses import RigidPoses

# tables whose numbers can change natural frequencies at a pose, and keys that only damp or end
HEADS = {"payload", "fluid", "supply", "cylinder", "motor", "spring"}
DAMPING = {"friction", "load_holding", "edges", "pitch_deg", "damping_ratio"}
STATIC = {"preload_bar", "relief_bar"}  # what counts of a valve that is shut
RIGID = "mass_matrix", "gravity_torque", "gravity_stiffness"


class RowPoses(RigidPoses):
    """Poses of machines that differ from row to row: none has the linkage of another."""

    def alone(
        self, joint: int, placed: Callable[[int, Array], RigidPoses]
    ) -> tuple[RigidPoses, Array | slice]:
        """All poses: equal positions of a joint do not mean equal lengths."""
        return self, slice(None)

    @classmethod
    def of(cls, rigid: RigidPoses) -> RowPoses:
        """Poses, one for each machine."""
        return cls(*(getattr(rigid, name) for name in RigidPoses.__dataclass_fields__))


def moves_the_arm(location: Location) -> bool:
    """Whether links are others or stand elsewhere with another number.

    Numbers of ``[links]``, frozen joints, and springs at rest.
    """
    head, last = location[0], location[-1]
    return head in ("frozen", "links") or (head == "spring" and last in ("at_deg", "at_mm"))


def can_matter(location: Location) -> bool:
    """Whether a number can change natural frequencies at a pose, with the links where they are."""
    if location[0] not in HEADS or DAMPING & set(location) or moves_the_arm(location):
        return False
    return "valve" not in location or location[-1] in STATIC


def rebuilt(machine: Machine, values: Mapping[Location, float]) -> Machine:
    """The machine with other numbers at key paths, its links read anew; unchecked.

    For a look: its text is the old one.
    """
    section = with_values(machine.section, values)
    texts = machine.text, machine.urdf_text, machine.source
    return Machine.unchecked(*texts, section=section).loaded_like(machine)


@dataclass(frozen=True, eq=False)
class Family:
    """Members (n) of one machine's family.

    Attributes:
        machine: the machine as its file describes it.
        values: numbers of the members (n,) by key path, in the file's units.
        members: the machine whose numbers are arrays (n,), one for each member.
        count: number of members, n.
        shares: factor on mass and inertia of what each coordinate moves before the next (n, k);
            None: all as in the URDF.
    """

    machine: Machine
    values: Mapping[Location, Array]
    members: Machine
    count: int
    shares: Array | None = None

    @classmethod
    def of(
        cls,
        machine: Machine,
        values: Mapping[Location, Array],
        count: int,
        shares: Array | None = None,
    ) -> Family:
        """The family with ``values`` (n,) at key paths, in the file's units, that all can matter.

        Values are not checked against the schema.
        """
        section = with_values(machine.section, values)
        members = Machine.unchecked(
            machine.text, machine.urdf_text, machine.source, arm=machine.arm, section=section
        )
        return cls(machine, values, members.loaded_like(machine), count, shares)

    def some(self, rows: Array) -> Family:
        """Some of its members, any of them several times."""
        values = {location: of_all[rows] for location, of_all in self.values.items()}
        shares = None if self.shares is None else self.shares[rows]
        return Family.of(self.machine, values, len(rows), shares)

    def at(self, q: Array, payload: str) -> Poses:
        """Everything of each member at its pose (n, nq), or all at one (nq,), under a load case.

        Unchecked: what is impossible is inf or NaN.
        """
        case = next(case for case in self.members.payloads if case.name == payload)
        return replace(self.members, payload=case).evaluate(self._links(q))

    def extensions(self, q: Array, cylinders: Collection[int]) -> dict[int, Array]:
        """Share of the stroke (n,) that is out of some cylinders at poses (n, nq)."""
        members, rigid = self.members, RowPoses.of(self.machine.arm.kinematics(q))
        shares = {}
        for i in cylinders:
            cylinder = members.cylinders[i]
            with np.errstate(invalid="ignore", divide="ignore"):
                length = members.linkages[i].length(rigid)
            shares[i] = (length - cylinder.closed_length) / cylinder.stroke
        return shares

    def _links(self, q: Array) -> RowPoses:
        """The bare links of every member."""
        rows = np.zeros(self.count, dtype=int) if q.ndim == 1 else slice(None)
        own, arm = np.atleast_2d(q), self.machine.arm
        if self.shares is None:
            return RowPoses.of(arm.rigid_poses(own)[rows])
        parts = [RowPoses.of(body.rigid_poses(own)[rows]) for body in arm.bodies_apart]
        sums = {
            name: sum(
                np.reshape(share, (-1, *[1] * (getattr(part, name).ndim - 1)))
                * getattr(part, name)
                for part, share in zip(parts, self.shares.T, strict=True)
            )
            for name in RIGID
        }
        return replace(parts[0], **sums)
