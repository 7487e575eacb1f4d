"""Performance of a machine's actuators as data sheets state it: torques, stroke times, speeds.

Each over the range of its joint, at available pressure (the supply's, or a lower relief's) and
with all of the pump's flow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import CHECKED_POSES, reference_of
from armdesign.design.requirements.settings import Requirements
from armdesign.design.requirements.torque import leverages
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import over


@dataclass(frozen=True, eq=False, kw_only=True)
class Performance:
    """Performance of one actuator about one joint; pairs are extending and retracting.

    Attributes:
        actuator: its index.
        joint: its index.
        q: positions of the joint over its range (k,) [rad, m].
        arm: size of the moment arm there (k,) [m/rad].
        torque: available pressure × area × moment arm there (2, k) [N m, N].
        largest: largest torque over the range (2,), by a parabola.
        stroke_time: volume of the whole stroke, of a motor over the joint's range, over the pump's
            flow (2,) [s].
        speed: of the joint at the pump's flow (2, k) [rad/s, m/s]; inf at a dead centre.
    """

    actuator: int
    joint: int
    q: Array
    arm: Array
    torque: Array
    largest: Array
    stroke_time: Array
    speed: Array


def performances(machine: Machine) -> list[Performance]:
    """Every actuator about every joint that it moves, others in the middle of their ranges."""
    reference = reference_of(machine, Requirements(), CHECKED_POSES)
    now, flow = reference.old, machine.supply.flow
    rows = []
    for leverage in leverages(now, reference):
        ends, areas = machine.ranges[leverage.joint], now.areas[0, leverage.actuator]
        arm, stroke = leverage.arm[0], now.stroke[0, leverage.actuator]
        travel = stroke if np.isfinite(stroke) else float(np.ptp(ends))
        with np.errstate(divide="ignore"):
            speed = flow / (areas[:, None] * arm)
        rows.append(
            Performance(
                actuator=leverage.actuator,
                joint=leverage.joint,
                q=over(ends, CHECKED_POSES),
                arm=arm,
                torque=leverage.torque(now)[0],
                largest=leverage.largest(now)[0],
                stroke_time=areas * travel / flow,
                speed=speed,
            )
        )
    return rows


def torque_shares(new: Machine, today: Machine) -> dict[str, Array]:
    """Largest torque of every actuator over today's (2,), extending and retracting.

    Of an actuator that moves several joints the least.
    """
    shares: dict[str, Array] = {}
    for now, before in zip(performances(new), performances(today), strict=True):
        name = today.actuators[now.actuator].name
        share = np.asarray(now.largest) / before.largest
        shares[name] = np.minimum(share, shares.get(name, share))
    return shares
