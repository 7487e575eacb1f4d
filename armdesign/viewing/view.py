"""Contents of the view: a machine, another one over it, a pose, and the region it sweeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.control.stated_damping import checked_damping
from armdesign.drawing.joint_arcs import middle_pose, refuse_other_joints
from armdesign.frequency.maps import frequency_map
from armdesign.viewing.region import ReachRegion, region_of

if TYPE_CHECKING:
    from armdesign.frequency.workspace import Workspace
    from armdesign.frequency.worst_frequency import WorstPose
    from armdesign.machine.machine import Machine


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """Contents of the view.

    Attributes:
        machine: today's machine, under the load case to begin with.
        new: another one over it, with the same joints; None: none.
        q: the pose to begin with (nq,) [rad, m].
        region: what the tool of today's machine sweeps.
        worst: the worst pose of today's machine over all load cases.
        damping: ratio to assume for bandwidths; None: what the file gives.
    """

    machine: Machine
    new: Machine | None
    q: Array
    region: ReachRegion
    worst: WorstPose
    damping: float | None = None

    @property
    def machines(self) -> dict[str, Machine]:
        """The machines by what they are called."""
        return {"today": self.machine} | ({} if self.new is None else {"new": self.new})


def view_of(
    machine: Machine,
    new: Machine | None = None,
    q: Array | None = None,
    workspace: Workspace | None = None,
    damping: float | None = None,
) -> View:
    """A view of a machine.

    Args:
        machine: under the load case to begin with.
        new: another one over it; None: none.
        q: the pose to begin with (nq,) [rad, m]; None: the middle of the joint ranges.
        workspace: poses that the region is coloured by; None: a joint grid.
        damping: ratio to assume for bandwidths; None: what the file gives.

    Raises:
        ArmDesignError: the other machine has other joints, or damping that is none.
        PoseError: a load case exists at no pose.
    """
    if new is not None:
        refuse_other_joints(machine, new)
    checked_damping(damping)
    frequencies = frequency_map(machine, workspace)
    return View(
        machine=machine,
        new=None if new is None else _loaded_like(new, machine),
        q=np.asarray(middle_pose(machine) if q is None else q, dtype=float),
        region=region_of(frequencies),
        worst=frequencies.worst,
        damping=damping,
    )


def _loaded_like(new: Machine, machine: Machine) -> Machine:
    """The new machine under the load case of another, where it has one of that name or mass."""
    case = machine.payload
    if case.name in [one.name for one in new.payloads]:
        return new.with_payload(case.name)
    return new.with_payload(case.mass)
