"""Poses of the windows of a recording, and the ratio of pressures that trapped oil shows there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.actuator import SIDES
from armdesign.machine.machine import Machine
from armdesign.machine.measured_poses import JointColumns, at_lengths, joint_columns
from armdesign.simulation.identification.pressure_ratio import PressureRatio
from armdesign.simulation.identified import IdentifiedWindow
from armdesign.units import bar, mm


def with_pose(window: IdentifiedWindow, machine: Machine) -> IdentifiedWindow:
    """The window with its pose and what trapped oil would show there.

    Without a pose, and with the reason, if the recording tells none that the machine can take.
    Where a length tells a joint's position, its mean is the one that stays.
    """
    columns = joint_columns(machine)
    twice = {column.own for column in columns if window.means.keys() & column.lengths.keys()}
    means = {name: mean for name, mean in window.means.items() if name not in twice}
    window = replace(window, means=means)
    places = {column.name: _place(column, window.means, machine) for column in columns}
    remarks = {name: words for name, (_, words) in places.items() if words}
    positions = [position for position, _ in places.values() if position is not None]
    window = replace(window, pose_remarks=remarks)
    if len(positions) < len(columns):
        return window
    q = np.array(positions)
    try:
        lengths = machine.evaluate(machine.rigid_poses(q[None])).lengths[0]
    except ArmDesignError as error:
        return replace(window, pose_remarks={**remarks, "": f"{error}; the pose is left out"})
    ratios = tuple(_expected(ratio, window.means, machine, lengths) for ratio in window.ratios)
    return replace(window, pose=q, ratios=ratios)


def _place(
    column: JointColumns, means: Mapping[str, float], machine: Machine
) -> tuple[float | None, str]:
    """Where a joint stands [rad, m], None if nothing tells it, and what to know of that."""
    for name, cylinder in column.lengths.items():
        if name in means:
            try:
                lengths = np.array([means[name]]) * mm
                return float(at_lengths(machine, cylinder, lengths, [""])[0]), ""
            except ArmDesignError as error:
                return None, f"{error}; the pose is left out"
    if column.own in means:
        position = means[column.own] * column.factor
        outside = column.outside(machine, position)
        return position, f"{column.own}: {outside}" if outside else ""
    fault = f"no column tells where joint {column.name} stands"
    remedy = f"give {' or '.join(column.all)}"
    if column.outside(machine, 0.0):
        return None, f"{fault}: the pose is left out; {remedy}"
    return 0.0, f"{fault}: taken as 0 {column.unit}; {remedy}"


def _expected(
    ratio: PressureRatio, means: Mapping[str, float], machine: Machine, lengths: Array
) -> PressureRatio:
    """The ratio with what oil trapped on both sides would show."""
    names = [actuator.name for actuator in machine.actuators]
    if ratio.cylinder not in names:
        return ratio
    i = names.index(ratio.cylinder)
    actuator = machine.actuators[i]
    cap, annulus = (means[f"{ratio.cylinder}_{side}_bar"] * bar for side in SIDES)
    capacities = actuator.capacities(
        lengths[i] - actuator.closed_length, (cap, annulus), machine.fluid
    )
    stiffness = actuator.bore_area / capacities[0], actuator.annulus_area / capacities[1]
    return replace(ratio, expected=float(stiffness[0] / stiffness[1]))
