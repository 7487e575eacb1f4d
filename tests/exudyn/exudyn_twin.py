"""A machine built a second time, in Exudyn, from the same data: the plant of the independent
check.

The links become an ObjectKinematicTree in minimal coordinates, springs its joints' own
controllers (of ours they get the preload), a cylinder a HydraulicActuatorSimple between two
markers. Its equations (Exudyn's documentation of that item) are ours with constant β and without
leakage, dry friction, stops, reliefs, vapour and the laminar range of the valve:

    ṗ0 = K/V0 (−A0 ṡ + a0 Qn √(ps − p0)),  V0 = Vh0 + A0 s,  force on the pins p0 A0 − p1 A1 − d ṡ

and the like for p1; the root keeps its sign, and an opening a0 < 0 leads to the tank: p0 − pt in
place of ps − p0. Four-bars and the cylinders' own bars close loops by constraints, which only
Exudyn's implicit solvers take; they need a rocker that weighs. A coupler without mass is a
constant distance.

The frequencies that Exudyn itself offers leave the pressures out, so they are found from its
motion or its right-hand side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import exudyn
import numpy as np
from exudyn.itemInterface import (
    HydraulicActuatorSimple,
    MarkerBodyPosition,
    MarkerKinematicTreeRigid,
    NodeGenericODE1,
    NodeGenericODE2,
    ObjectConnectorDistance,
    ObjectGround,
    ObjectJointSpherical,
    ObjectKinematicTree,
    SensorNode,
)

from armdesign import Machine
from armdesign.hydraulics.actuator import Cylinder
from armdesign.hydraulics.friction import NO_FRICTION
from armdesign.units import GRAVITY
from tests.exudyn.exudyn_tree import GROUND, Array, Seat, Tree

# [Pa] of the pressures in a state of first order, so that all its numbers are of one order
UNIT = 1e7
SPRING = ("at", "stiffness", "damping", "preload")
Valves = Callable[[float, Array], Iterable[tuple[float, float]]]
"""Openings −1…1 of the ports (cap, annulus) of every cylinder at time [s] and pressures [Pa]."""


@dataclass(frozen=True)
class Motion:
    """Time (n,) [s], joint positions and speeds (n, nq), pressures (n, nc, 2) [Pa]."""

    time: Array
    q: Array
    velocity: Array
    pressures: Array


def common(machine: Machine) -> Machine:
    """The machine with what an actuator of Exudyn knows: an ideal pump, no air, hoses,
    compliance, leakage, friction.
    """
    cylinders = [
        replace(
            cylinder,
            compliance=0.0,
            cap_hose_volume=0.0,
            annulus_hose_volume=0.0,
            friction=NO_FRICTION,
            valve=replace(cylinder.valve, leakage=0.0) if cylinder.valve else None,
        )
        for cylinder in machine.cylinders
    ]
    return replace(
        machine,
        cylinders=tuple(cylinders),
        fluid=replace(machine.fluid, air=0.0),
        supply=replace(machine.supply, flow_limited=False),
    )


def holding_pressures(machine: Machine, q: Array) -> Array:
    """Pressures (nc, 2) [Pa] that hold the static load at a pose with p1 + p2 = supply + return
    pressure.
    """
    total = machine.supply.pressure + machine.supply.return_pressure
    areas = np.array(
        [(cylinder.bore_area, cylinder.annulus_area) for cylinder in machine.cylinders]
    )
    cap = (machine.at(q).cylinder_forces[0] + areas[:, 1] * total) / areas.sum(axis=1)
    return np.column_stack([cap, total - cap])


class Twin:
    """The machine in Exudyn at a pose q (nq,) with chamber pressures (nc, 2) [Pa], ready to move.

    A simulation leaves the initial state as it is, so a twin can be run again.
    """

    def __init__(self, machine: Machine, q: Array, pressures: Array) -> None:
        tree = Tree(machine, q)
        self.machine, self._container = machine, exudyn.SystemContainer()
        self.system = self._container.AddSystem()
        springs = machine.springs
        names = [*machine.joints, *(spring.joint for spring in springs)]
        self._order = [tree.names.index(name) for name in names]
        q = np.concatenate([q, [spring.at for spring in springs]])
        self._add_tree(tree, q)
        self._add_cylinders(tree, pressures)
        outputs = exudyn.OutputVariableType
        wanted = [(self._joints, outputs.Coordinates), (self._joints, outputs.Coordinates_t)]
        wanted += [(node, outputs.Coordinates) for node in self._chambers]
        self._sensors = [
            self.system.AddSensor(
                SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True)
            )
            for node, kind in wanted
        ]
        self.system.Assemble()

    def _add_tree(self, tree: Tree, q: Array) -> None:
        start = np.zeros(len(tree.bodies))
        start[self._order] = q
        zero = np.zeros(len(start))
        at, stiffness, damping, preload = (self._of_springs(tree, name) for name in SPRING)
        self._joints = self.system.AddNode(
            NodeGenericODE2(
                numberOfODE2Coordinates=len(start),
                referenceCoordinates=zero,
                initialCoordinates=start,
                initialCoordinates_t=zero,
            )
        )
        self._ground = self.system.AddObject(ObjectGround())
        self._tree = self.system.AddObject(
            ObjectKinematicTree(
                nodeNumber=self._joints,
                gravity=[0, 0, -GRAVITY],
                jointTypes=[getattr(exudyn.JointType, body.kind) for body in tree.bodies],
                linkParents=[body.parent for body in tree.bodies],
                jointTransformations=exudyn.Matrix3DList(
                    [body.joint.rotation for body in tree.bodies]
                ),
                jointOffsets=exudyn.Vector3DList([body.joint.offset for body in tree.bodies]),
                linkInertiasCOM=exudyn.Matrix3DList([body.inertia for body in tree.bodies]),
                linkCOMs=exudyn.Vector3DList([body.com for body in tree.bodies]),
                linkMasses=[body.mass for body in tree.bodies],
                jointPositionOffsetVector=at,
                jointPControlVector=stiffness,
                jointVelocityOffsetVector=zero,
                jointDControlVector=damping,
                jointForceVector=preload,
            )
        )

    def _of_springs(self, tree: Tree, name: str) -> Array:
        """A number of every settled spring at its link of the tree, zero at the others."""
        values = np.zeros(len(tree.bodies))
        for spring in self.machine.springs:
            values[tree.names.index(spring.joint)] = getattr(spring, name)
        return values

    def _add_cylinders(self, tree: Tree, pressures: Array) -> None:
        machine = self.machine
        self._chambers, self._actuators = [], []
        for i, (cylinder, linkage, held) in enumerate(
            zip(machine.cylinders, machine.linkages, pressures, strict=True)
        ):
            node = self.system.AddNode(
                NodeGenericODE1(
                    numberOfODE1Coordinates=2,
                    referenceCoordinates=[0, 0],
                    initialCoordinates=list(held),
                )
            )
            markers = [self._marker(tree.seat(linkage.base)), self._marker(tree.rod_ends[i])]
            self._chambers.append(node)
            self._actuators.append(
                self.system.AddObject(_actuator(machine, cylinder, node, markers))
            )
        for ends in tree.loops:
            both = [self._marker(seat) for seat in ends]
            self.system.AddObject(
                ObjectJointSpherical(markerNumbers=both, constrainedAxes=[1, 0, 1])
            )
        for *ends, distance in tree.struts:
            both = [self._marker(seat) for seat in ends]
            self.system.AddObject(ObjectConnectorDistance(markerNumbers=both, distance=distance))

    def _marker(self, seat: Seat) -> int:
        carrier, at = seat
        if carrier == GROUND:
            return self.system.AddMarker(
                MarkerBodyPosition(bodyNumber=self._ground, localPosition=at)
            )
        return self.system.AddMarker(
            MarkerKinematicTreeRigid(objectNumber=self._tree, linkNumber=carrier, localPosition=at)
        )

    def rates(self, states: Array) -> Array:
        """Right-hand side (n, size) of the whole first-order system at states (n, size): q, q̇,
        pressures [UNIT].

        One step of the explicit Euler rule with a step of 1 s goes from y to y + f(y).
        """
        data, initial = self.system.systemData, exudyn.ConfigurationType.Initial
        settings = _settings(1.0, 1.0)
        derivatives = []
        for state in states:
            q, velocity, pressures = np.split(state, (len(self._order), 2 * len(self._order)))
            data.SetODE2Coordinates(self._from(q), initial)
            data.SetODE2Coordinates_t(self._from(velocity), initial)
            data.SetODE1Coordinates(UNIT * pressures, initial)
            self.system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.ExplicitEuler)
            end = data.GetODE2Coordinates()[self._order], data.GetODE2Coordinates_t()[self._order]
            derivatives.append(np.concatenate([*end, data.GetODE1Coordinates() / UNIT]) - state)
        return np.array(derivatives)

    def _from(self, values: Array) -> Array:
        ordered = np.zeros(len(values))
        ordered[self._order] = values
        return ordered

    def run(
        self,
        solver: str,
        step: float,
        duration: float,
        valves: Valves | None = None,
        period: float = 0.0,
    ) -> Motion:
        """Motion from rest, recorded at every step or with a period [s]; valves stand still during
        a step.

        A Runge–Kutta method has them as they are in the middle of the step, the trapezoidal rule
        as at its end, since it takes the rates at the step's beginning from the last one: so both
        keep their second order.
        """
        early = 0.0 if solver == "TrapezoidalIndex2" else step / 2

        def set_valves(system: exudyn.MainSystem, end_of_step: float) -> bool:
            pressures = system.systemData.GetODE1Coordinates().reshape(-1, 2)
            for actuator, openings in zip(
                self._actuators, valves(end_of_step - early, pressures), strict=True
            ):
                system.SetObjectParameter(actuator, "valveOpening0", openings[0])
                system.SetObjectParameter(actuator, "valveOpening1", openings[1])
            return True

        self.system.SetPreStepUserFunction(set_valves if valves else 0)
        settings = _settings(step, duration)
        settings.solution.sensors.writePeriod = max(period, step) * (1 - 1e-9)  # rounding of times
        self.system.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, solver))
        q, velocity, *chambers = (
            self.system.GetSensorStoredData(sensor) for sensor in self._sensors
        )
        return Motion(
            time=q[:, 0],
            q=q[:, 1:][:, self._order],
            velocity=velocity[:, 1:][:, self._order],
            pressures=np.stack([chamber[:, 1:] for chamber in chambers], axis=1),
        )


def _settings(step: float, duration: float) -> exudyn.SimulationSettings:
    settings = exudyn.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.verboseMode = round(duration / step), 0
    time.endTime = step * time.numberOfSteps
    time.explicit.computeEndOfStepAccelerations = False
    time.automaticStepSize, time.newton.useModifiedNewton = False, False
    # small vibrations need small residuals
    time.newton.relativeTolerance, time.newton.absoluteTolerance = 1e-10, 1e-12
    settings.solution.file.write = False
    return settings


def _actuator(
    machine: Machine, cylinder: Cylinder, node: int, markers: list[int]
) -> HydraulicActuatorSimple:
    valve = cylinder.valve
    return HydraulicActuatorSimple(
        markerNumbers=markers,
        nodeNumbers=[node],
        offsetLength=cylinder.closed_length,
        strokeLength=cylinder.stroke,
        chamberCrossSection0=cylinder.bore_area,
        chamberCrossSection1=cylinder.annulus_area,
        hoseVolume0=cylinder.cap_dead_volume,
        hoseVolume1=cylinder.annulus_dead_volume,
        actuatorDamping=cylinder.count * cylinder.friction.viscous,
        oilBulkModulus=machine.fluid.bulk_modulus,
        nominalFlow=valve.rated_flow / math.sqrt(valve.rated_drop) if valve else 1.0,
        systemPressure=machine.supply.pressure,
        tankPressure=machine.supply.return_pressure,
        useChamberVolumeChange=True,
    )
