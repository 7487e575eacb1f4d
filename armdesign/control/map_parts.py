"""Poses of a bandwidth map in parts, and what is asked of the controllers there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.control.controller import Filter
from armdesign.control.loop_plant import LoopPlant, loop_plant, workable
from armdesign.control.loops import Loops
from armdesign.control.margins import GAIN_MARGIN_DB, PHASE_MARGIN, disk_margin_for
from armdesign.control.tuning import Aim, Task
from armdesign.errors import ArmDesignError, PoseError
from armdesign.frequency.cases import CasePoses, in_chunks, poses_of
from armdesign.frequency.modes import natural_modes
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses
from armdesign.mechanism.rigid_poses import RigidPoses

CHUNK = 500  # poses whose frequency responses a thread has in memory


@dataclass(frozen=True, kw_only=True)
class ControlOptions:
    """Requirements on the controllers.

    Attributes:
        damping: ratio of all modes in place of the file's damping; None: the file's.
        delay: between demand and spool [s].
        gain_margin_db: that all loops keep together [dB].
        phase_margin: that all loops keep together [rad].
        filter: of load pressures.
        corner: of that filter [rad/s]; None: follows the lowest natural frequency.
    """

    damping: float | None = None
    delay: float = 0.0
    gain_margin_db: float = GAIN_MARGIN_DB
    phase_margin: float = PHASE_MARGIN
    filter: Filter = "high-pass"
    corner: float | None = None

    @property
    def aim(self) -> Aim:
        """Disk margin and filter."""
        margin = disk_margin_for(self.gain_margin_db, self.phase_margin)
        if self.corner is not None and not 0 < self.corner < math.inf:
            hertz = self.corner / (2 * math.pi)
            fault = f"{hertz:g} Hz ({self.corner:g} rad/s) is not allowed"
            remedy = "give one above 0, or none: it then follows the mode of each pose"
            raise ArmDesignError("corner", fault, remedy)
        if self.filter not in ("high-pass", "band-pass"):
            fault, remedy = f"{self.filter!r} is none", "give high-pass or band-pass"
            raise ArmDesignError("filter", fault, remedy)
        return Aim(margin=margin, filter=self.filter, corner=self.corner)


class MapPart(NamedTuple):
    """Poses of a load case, and at which of them a controller can work."""

    case: CasePoses
    poses: Poses
    works: Array  # indices

    @property
    def lowest(self) -> float:
        """Lowest natural frequency at which a controller works [Hz]; inf where none does."""
        return float(natural_modes(self.poses[self.works]).frequencies.min(initial=math.inf))

    def plant(self, options: ControlOptions, rows: Array | None = None) -> LoopPlant:
        """The plants at the poses at which a controller works, or at some of these."""
        works = self.works if rows is None else self.works[rows]
        return loop_plant(self.case.machine, self.poses[works], options.damping, options.delay)

    def task(self, options: ControlOptions, rows: Array | None = None) -> Task:
        """These plants with their loops."""
        plant = self.plant(options, rows)
        return Task(plant, Loops.of(plant), options.aim)


def map_parts(cases: Sequence[CasePoses], machine: Machine) -> list[MapPart]:
    """All poses in parts, load case by load case.

    Raises:
        PoseError: a controller works at none of them.
    """
    parts: dict[str, list[MapPart]] = {case.name: [] for case in cases}

    def some_poses(case: CasePoses, rigid: RigidPoses) -> list[MapPart]:
        poses = poses_of(cases, case, rigid)
        chosen = (poses[begin : begin + CHUNK] for begin in range(0, len(poses), CHUNK))
        return [
            MapPart(case, some, np.flatnonzero(workable(case.machine, some))) for some in chosen
        ]

    for case, of_case in in_chunks(cases, some_poses, f"{machine.name}: bandwidths"):
        parts[case.name].extend(of_case)
    listed = [part for of_case in parts.values() for part in of_case]
    if not any(len(part.works) for part in listed):
        fault = "at no pose of the workspace can its valves move all loads both ways"
        remedy = "raise supply.pressure_bar or reliefs, or give lighter load cases"
        raise PoseError(f"{machine.name}: control", fault, remedy)
    return listed
