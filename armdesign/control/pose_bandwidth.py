"""Bandwidths of position loops with gains common to all joints, which need no search.

For what asks of one machine after the other: at one pose, or at many at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.control.loop_plant import LoopPlant, loop_plant, refuse_long, workable
from armdesign.control.loops import Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.tuning import CLOSE, Task, damped, proportional
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


class CommonGains(NamedTuple):
    """Bandwidths of the narrowest loop at n poses, with gains common to all joints.

    Attributes:
        plant: what the loops act on.
        proportional: by position gains alone (n,) [Hz].
        damped: with feedback of the load pressures (n,) [Hz].
    """

    plant: LoopPlant
    proportional: Array
    damped: Array


def common_gains(
    machine: Machine, poses: Poses, options: ControlOptions, close: float = CLOSE
) -> CommonGains:
    """Bandwidths at poses at which the machine can work, see ``workable``.

    ``close`` is the factor within which gains are found.

    Raises:
        ArmDesignError: no valve, no damping on which a bandwidth could rest, or no margin kept.
    """
    plant = loop_plant(machine, poses, options.damping, options.delay)
    refuse_long(options.delay, float(plant.frequencies.min(initial=math.inf)), machine)
    task = Task(plant, Loops.of(plant), options.aim, close)
    simple = proportional(task)
    tuned = (simple, damped(task).or_wider(simple))
    widths = (each.figures.narrowest / (2 * math.pi) for each in tuned)
    return CommonGains(plant, *widths)


def pose_bandwidth(
    machine: Machine, poses: Poses, options: ControlOptions | None = None, close: float = CLOSE
) -> PoseBandwidth:
    """Bandwidths of a machine at the first of some poses.

    As in a bandwidth map, but for gains of their own, which need a search. ``close`` is the factor
    within which gains are found.

    Raises:
        ArmDesignError: no valve, no damping on which a bandwidth could rest, or no margin kept.
        PoseError: a controller cannot work there.
    """
    options = options or ControlOptions()
    one = poses[np.array([0])]
    if not workable(machine, one)[0]:
        fault = "valves cannot move all loads both ways"
        raise PoseError(f"{machine.name}: control", fault, "choose another pose or load")
    reached = common_gains(machine, one, options, close)
    return PoseBandwidth(
        damping=float(reached.plant.damping[0, 0]),
        proportional=float(reached.proportional[0]),
        damped=float(reached.damped[0]),
    )
