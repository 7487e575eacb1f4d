"""Predictions for measurements: frequencies and static pressures of a machine at their poses.

Oil with air has β(p) at the measured pressures where there are some. An open chamber has infinite
capacity, and a stuck piston leaves 1/c of what lies in series with it.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.calibration.measured import Measured
from armdesign.errors import ArmDesignError
from armdesign.frequency.cases import groups_by_case
from armdesign.frequency.modes import natural_modes
from armdesign.hydraulics.actuator import Actuator, areas_of
from armdesign.hydraulics.oil_spring import oil_stiffness
from armdesign.machine.machine import Machine
from armdesign.machine.measured_poses import at_lengths, joint_columns
from armdesign.machine.poses import Poses
from armdesign.mechanism.rigid_poses import RigidPoses

RIGID = 1e-12  # [m/N] least compliance of what holds a stuck piston


def positions(machine: Machine, measured: Measured) -> Array:
    """Joint positions of the measurements (n, nq) [rad, m].

    Raises:
        ArmDesignError: a length outside the stroke, or a joint outside its range.
    """
    q = measured.joints.copy()
    for i, linkage in enumerate(machine.linkages):
        lengths, known = measured.lengths[:, i], np.isfinite(measured.lengths[:, i])
        if known.any():
            parts = [f"{measured.source}: row {n + 1}" for n in np.flatnonzero(known)]
            q[known, linkage.joints[0]] = at_lengths(machine, i, lengths[known], parts)
    _refuse_outside(machine, measured, q)
    return q


def _refuse_outside(machine: Machine, measured: Measured, q: Array) -> None:
    for column in joint_columns(machine):
        for n, position in enumerate(q[:, column.joint], 1):
            fault = column.outside(machine, position)
            if fault:
                part = f"{measured.source}: row {n}, {column.own}"
                remedy = "strokes and limits end there: correct the pose or the machine file"
                raise ArmDesignError(part, fault, remedy)


@dataclasses.dataclass(frozen=True, eq=False)
class Prediction:
    """Frequencies (n,) [Hz] and load pressures (n, nc) [Pa] of a machine at n measurements."""

    frequencies: Array
    load_pressures: Array


@dataclasses.dataclass(frozen=True, eq=False)
class Predictor:
    """Predictions of a machine and its variants at measurements.

    Attributes:
        machine: the machine whose pins and strokes tell the poses.
        measured: the measurements.
    """

    machine: Machine
    measured: Measured

    @cached_property
    def rigid(self) -> RigidPoses:
        """Inertia and gravity of the bare links at the poses."""
        return self.machine.rigid_poses(positions(self.machine, self.measured))

    def __call__(self, machine: Machine) -> Prediction:
        """Predictions of a variant of the machine for every measurement.

        The load pressure of an actuator is its static force over its bore area, p1 − p2 A2/A1.

        Raises:
            ArmDesignError: poses that the machine cannot take.
        """
        measured, rigid = self.measured, self.rigid
        if not _pose_alike(machine, self.machine):
            rigid = Predictor(machine, measured).rigid
        frequencies = np.zeros(len(measured))
        loads = np.zeros((len(measured), len(machine.actuators)))
        for loaded, rows in groups_by_case(machine, measured.payloads):
            poses = loaded.evaluate(rigid[rows])
            held = _stiffness(machine, measured, rows, poses)
            modes = natural_modes(dataclasses.replace(poses, oil_stiffness=held)).frequencies
            frequencies[rows] = modes[np.arange(len(modes)), measured.modes[rows]]
            loads[rows] = poses.cylinder_forces / machine.bore_areas
        return Prediction(frequencies, loads)


def _pose_alike(machine: Machine, other: Machine) -> bool:
    """Whether two machines have the same poses by the measurements, and bare links there."""
    ends, others = ([(c.closed_length, c.stroke) for c in m.cylinders] for m in (machine, other))
    same = machine.linkages == other.linkages and ends == others
    return same and machine.arm.moves_like(other.arm)


def measured_loads(machine: Machine, measured: Measured) -> Array:
    """Load pressures p1 − p2 A2/A1 of the measured chamber pressures (n, nc) [Pa]."""
    return np.asarray(
        measured.pressures[:, :, 0] - area_ratios(machine) * measured.pressures[:, :, 1]
    )


def area_ratios(machine: Machine) -> Array:
    """A2/A1 of every actuator (nc,)."""
    bore, annulus = areas_of(machine.actuators).T
    return np.asarray(annulus / bore)


def _stiffness(machine: Machine, measured: Measured, rows: Array, poses: Poses) -> Array:
    """Stiffness of every actuator (n, nc) [N/m] with what is measured of its chambers."""
    stiffness = []
    for i, actuator in enumerate(machine.actuators):
        force = poses.cylinder_forces[:, i]
        both = actuator.static_pressures(force, machine.supply)
        own = [
            np.where(np.isfinite(pressure), pressure, static)
            for pressure, static in zip(measured.pressures[rows, i].T, both, strict=True)
        ]
        extension = poses.lengths[:, i] - actuator.closed_length + actuator.compliance * force
        cap, annulus = actuator.capacities(extension, (own[0], own[1]), machine.fluid)
        held = measured.chambers[rows, i]
        oil = oil_stiffness(
            actuator.bore_area,
            actuator.annulus_area,
            np.where(held == "annulus", np.inf, cap),
            np.where(held == "cap", np.inf, annulus),
            actuator.compliance,
        )
        stiffness.append(np.where(held == "stuck", _stuck(actuator), oil))
    return np.stack(stiffness, axis=1)


def _stuck(actuator: Actuator) -> float:
    """Stiffness of what lies in series with a piston that friction holds [N/m]."""
    return 1 / max(actuator.compliance, RIGID)
