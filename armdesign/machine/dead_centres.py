"""Dead centres: poses at which cylinders hold a joint by next to no moment arm.

Force grows without bound towards one (g = RᵀF), and with it what moves the arm away, −Σ F H. A
cylinder on one joint may have none in its range (``joint_ranges``); cylinders over several joints
may, at some positions of the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over
from armdesign.mechanism.linkage.base import moment_arms

OVERCOME = "gravity overcomes the trapped oil"  # where no dead centre explains an unstable pose
QUESTION = "is the bulk modulus or the payload right?"
SMALL_MOMENT_ARM = 0.15  # of the largest over a joint's range, the other joints as they are
SAMPLES = 91  # of that range


class DeadCentre(NamedTuple):
    """A cylinder that is next to its dead centre, and the joint that it cannot hold there."""

    cylinder: str
    joint: str

    @property
    def fault(self) -> str:
        """What is wrong at the pose."""
        return (
            f"the {self.cylinder} cylinder is at its dead centre about {self.joint}, or next to it"
        )

    @property
    def remedy(self) -> str:
        """What can be done."""
        return f"move its pins or narrow the range of joint {self.joint}"


def dead_centre(machine: Machine, q: Array) -> DeadCentre | None:
    """The dead centre that a pose (nq,) is next to; None if there is none.

    A pose is where the motion with the least moment arm, joints measured by their ranges, has
    little of what the same joint's motion has elsewhere.
    """
    spans = np.ptp(machine.ranges, axis=1)
    arms = _moment_arms(machine, q[None])[0] * spans
    if not np.isfinite(arms).all():
        return None
    j = int(np.abs(np.linalg.svd(arms)[2][-1]).argmax())
    along = np.tile(q, (SAMPLES, 1))
    along[:, j] = over(machine.ranges[j], SAMPLES)
    there = _moment_arms(machine, along) * spans
    there = there[np.isfinite(there).all(axis=(1, 2))]
    least = np.linalg.svd(np.concatenate([arms[None], there]), compute_uv=False)[:, -1]
    if least[0] > SMALL_MOMENT_ARM * least.max():
        return None
    i = int(np.abs(there[:, :, j]).max(axis=0, initial=0.0).argmax())
    return DeadCentre(machine.actuators[i].name, machine.joints[j])


def _moment_arms(machine: Machine, q: Array) -> Array:
    """Moment arms of all actuators about the joints (n, nc, nq), NaN where a four-bar is open."""
    rigid = machine.arm.kinematics(q)
    with np.errstate(invalid="ignore", divide="ignore"):
        return moment_arms(machine.drives, rigid)[..., : len(machine.joints)]
