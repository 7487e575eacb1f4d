"""Bandwidth of position loops at single poses, for what asks at one pose after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.control.bandwidth_map import ControlOptions
from armdesign.control.loop_plant import loop_plant, workable
from armdesign.control.loops import Loops
from armdesign.control.tuning import Task, damped, proportional
from armdesign.errors import PoseError
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses


@dataclass(frozen=True, kw_only=True)
class PoseBandwidth:
    """Bandwidths of the controllers at a pose.

    Attributes:
        damping: ratio of the lowest mode, valves closed.
        proportional: bandwidth of the narrowest loop by position gains alone [Hz].
        damped: the same with feedback of the load pressures [Hz].
    """

    damping: float
    proportional: float
    damped: float


def pose_bandwidth(
    machine: Machine, poses: Poses, options: ControlOptions | None = None
) -> PoseBandwidth:
    """Bandwidths of a machine at the first of some poses.

    As in a bandwidth map, but for gains of their own, which need a search.

    Raises:
        ArmDesignError: no valve, no damping on which a bandwidth could rest, or no margin kept.
        PoseError: a controller cannot work there.
    """
    options = options or ControlOptions()
    one = poses[np.array([0])]
    if not workable(machine, one)[0]:
        fault = "valves cannot move all loads both ways"
        raise PoseError(f"{machine.name}: control", fault, "choose another pose or load")
    plant = loop_plant(machine, one, options.damping, options.delay)
    task = Task(plant, Loops.of(plant), options.aim)
    simple = proportional(task)
    widths = [
        float(tuned.figures.bandwidth.min()) / (2 * math.pi)
        for tuned in (simple, damped(task).or_wider(simple))
    ]
    return PoseBandwidth(
        damping=float(plant.damping[0, 0]), proportional=widths[0], damped=widths[1]
    )
