"""Holding: static forces over the workspace within a share of what the supply gives."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import number
from armdesign.hydraulics.chamber_pressures import holding_force


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Settings: static loads.

    Attributes:
        end_margin: share of the stroke that every cylinder keeps free at both ends, in today's
            workspace.
        holding_share: static force over what supply against return pressure gives, at most.
    """

    end_margin: float = number("end_margin")
    holding_share: float = number("holding_share")


def holding(new: Candidate, reference: Reference, forces: Array) -> Iterator[Evaluation]:
    """Static forces (b, k, nc) [N, + pushes] within a share of what the supply holds.

    The share used is infinite where the supply holds nothing: pulling on a rod so thick that the
    return pressure on the bore outdoes the supply's on the annulus. The bound states it again for
    one cylinder alone: ``bound/cylinder_constraints.py``;
    ``test_branching_against_dense_sampling`` ties them.
    """
    share, supply = reference.requirements.holding_share, new.machine.supply
    for i, actuator in enumerate(reference.today.actuators):
        pushes = forces[0, :, i].real > 0
        held = holding_force(new.areas[:, i, None, 0], new.areas[:, i, None, 1], supply, pushes)
        used = forces[:, :, i] * np.where(pushes, 1.0, -1.0)
        holds, loaded = held.real > 0, used.real > 0
        ratio = np.where(holds, used / np.where(holds, held, 1.0), np.where(loaded, np.inf, 0.0))
        scale = supply.pressure * float(reference.old.areas[0, i, 0])
        yield Evaluation(
            name=f"holding.{actuator.name}",
            words=f"static load of the {actuator.name} {actuator.kind} over what the supply gives",
            unit="",
            value=ratio,
            limit=share,
            reformulated=((share * held - used) / scale, share * held / scale),
            setting="holding_share",
        )
