"""Events of a run, in words: stops, limits, cavitation, reliefs, full spools, the pump."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.machine.machine import Machine
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.simulation.plant.hydraulics import VAPOUR_PRESSURE
from armdesign.units import WORKSHOP, bar, l_per_min

FULL = 0.999  # of the spool's travel
BACKWARDS = 1e-3  # of the rated flow, into the supply
BEYOND = 0.01  # [rad, m] a joint's limit: stops yield, and limits beside them are rounded


def events(
    machine: Machine,
    relief: Array,
    time: Array,
    extension: Array,
    pressure: Array,
    spool: Array,
    supplied: Array,
) -> Iterator[tuple[float, str]]:
    """First time [s] and words of everything that limits cylinders, at n instants.

    Args:
        machine: the machine.
        relief: where port reliefs open (nc,) [Pa].
        time: (n,) [s].
        extension: piston positions (n, nc) [m].
        pressure: of cap and annulus (n, 2, nc) [Pa].
        spool: (n, nc).
        supplied: flows from the supply into cap and annulus (n, nc, 2) [m³/s].
    """
    for i, cylinder in enumerate(machine.actuators):
        name, place = cylinder.name, extension[:, i]
        yield from _event(time, place > cylinder.stroke, f"{name} reached its outer stop")
        ends = np.isfinite(cylinder.stroke)
        yield from _event(time, (place < 0) & ends, f"{name} reached its inner stop")
        yield from _event(time, np.abs(spool[:, i]) >= FULL, f"{name}'s spool was fully open")
        for k, chamber in enumerate(map(cylinder.chamber, (0, 1))):
            yield from _event(time, pressure[:, k, i] < VAPOUR_PRESSURE, f"{chamber} cavitated")
            limit = relief[i]
            words = f"the relief of {chamber} was open above {limit / bar:.0f} bar"
            yield from _event(time, pressure[:, k, i] > limit, words)
        rated = cylinder.valve.rated_flow if cylinder.valve else 0.0
        back = supplied[:, i].min(axis=1) < -BACKWARDS * rated
        yield from _event(time, back, f"{name}'s load pushed oil back into the supply")


def pump_events(
    machine: Machine, time: Array, supply: Array, supplied: Array
) -> Iterator[tuple[float, str]]:
    """First time [s] and words of everything that limits the pump, at n instants.

    ``supply``: pressures of the pump (n,) [Pa]; ``supplied``: flows as in ``events``.
    """
    pump, taken = machine.supply, supplied.sum(axis=(1, 2))
    if pump.pressure <= pump.return_pressure:
        held, back = pump.pressure / bar, pump.return_pressure / bar
        words = f"the pump held {held:.0f} bar, no more than the return line's {back:.0f} bar"
        yield from _event(time, np.ones(len(time), dtype=bool), words)
    if pump.flow_limited:
        low = supply < (1 - 2 * pump.cut_off) * pump.pressure
        least, flow = supply.min() / bar, pump.flow / l_per_min
        words = f"the pump's {flow:.0f} l/min were not enough (supply down to {least:.0f} bar)"
        yield from _event(time, low, words)
        return
    most, flow = taken.max() / l_per_min, pump.flow / l_per_min
    words = (
        f"the actuators took {most:.0f} l/min, the pump gives {flow:.0f} and was taken as ideal"
    )
    yield from _event(time, taken > 1.001 * pump.flow, words)


def pose_events(machine: Machine, time: Array, poses: RigidPoses) -> Iterator[tuple[float, str]]:
    """First time [s] and words of joint limits that are passed and of loads that would fall out.

    Cylinders have stops, joints have none: the run goes on where the machine cannot.
    """
    for joint, values in zip(machine.arm.joints, poses.q.T, strict=False):  # without springs
        if joint.without_ends:
            continue
        for limit, side in ((joint.lower, -1), (joint.upper, 1)):
            passed, at = side * (values - limit) > BEYOND, WORKSHOP.text(limit, joint.unit)
            words = f"{joint.name} passed its joint limit of {at} (where a run has no stop)"
            yield from _event(time, passed, words)
    case = machine.payload
    words = f"the {case.link} was tipped beyond the pitch at which it holds payload {case.name}"
    yield from _event(time, ~machine.holds(poses), words)


def _event(time: Array, is_so: Flags, words: str) -> Iterator[tuple[float, str]]:
    if is_so.any():
        first, spell = float(time[np.argmax(is_so)]), float(is_so.mean()) * time[-1]
        to_the_end = is_so[np.argmax(is_so) :].all()
        until = "to the end" if to_the_end else f"for {spell:.3g} s in all"
        yield first, f"{words} at {first:.3g} s, {until}"
