"""Properties of a machine: ranges, reach, moment arms, pressures, and implausible values.

``inspect`` looks at a machine as a designer would. Findings are not errors but numbers that should
be checked. Faults that make a file unusable are in ``file_faults``.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arrays import Array, mesh, weighted_share
from armdesign.frequency.cases import CasePoses, load_cases
from armdesign.frequency.joint_grid import joint_axes
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.oil_spring import holding_force
from armdesign.inspection.implausible_values import suspicions
from armdesign.inspection.oddities import oddities
from armdesign.inspection.yardstick import Finding
from armdesign.machine.machine import Machine
from armdesign.mechanism.joint_ranges import ENDED, over, sweep
from armdesign.mechanism.linkage.base import follows
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.spring import least_stiffness_factors
from armdesign.units import WORKSHOP, Units

SWEEP = 361  # poses over a joint's range at which moment arms are looked at
TOLERANCE = 1e-9  # of a stroke, by which a pose may lie beyond its end


@dataclass(frozen=True)
class Lever:
    """Least and largest size of a cylinder's moment arm about one joint [m/rad], and where.

    Attributes:
        turns: whether the moment arm changes sign between them.
        follows: whether another actuator moves the joint alone.
    """

    cylinder: int
    joint: int
    least: float
    least_at: float  # joint position [rad, m]
    most: float
    most_at: float
    turns: bool
    follows: bool


@dataclass(frozen=True, kw_only=True)
class StaticLoad:
    """Static pressure of an actuator's loaded chamber at its largest load under a load case.

    The other chamber is at return pressure, or at the preload of its valve: a simulation starts
    so.
    """

    cylinder: int  # index of the actuator
    payload: str  # name of the load case
    pressure: float  # of the loaded chamber [Pa]
    share: float  # static force over what its available pressure holds; inf if nothing
    cap: bool  # whether the cap side holds
    largest: tuple[float, float]  # largest pressures of cap and annulus over all poses [Pa]


@dataclass(frozen=True, eq=False)
class Inspection:
    """A machine over its workspace, in the numbers that a designer looks at first."""

    machine: Machine
    workspace: Workspace

    @cached_property
    def masses(self) -> dict[str, float]:
        """Mass of every link that has one [kg], frozen ones included."""
        masses = {}
        for link in ET.fromstring(self.machine.urdf_text).findall("link"):
            mass = link.find("inertial/mass")
            if mass is not None and float(mass.get("value", "0")) > 0:
                masses[str(link.get("name"))] = float(mass.get("value", "0"))
        return masses

    @cached_property
    def tool(self) -> Array:
        """Reach (forward positive) and height of the tool (n, 2) [m] in the root link's frame."""
        machine = self.machine
        at = machine.arm.point(self.workspace.rigid, machine.tool.link, np.array(machine.tool.at))
        return np.stack([machine.heading.reach(self.workspace.q, at), at[:, 2]], axis=1)

    def ended_by(self, joint: int, end: int) -> str:
        """End of a joint's range below (0) or above (1) in words: a stroke, the URDF, one turn."""
        machine = self.machine
        pose = sweep(machine.arm, joint, machine.ranges[joint, end : end + 1])
        for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
            if linkage.joints == (joint,):
                length, near = float(linkage.length(pose)[0]), ENDED * cylinder.stroke
                if abs(length - cylinder.closed_length) < near:
                    return f"{cylinder.name} in"
                if abs(length - cylinder.open_length) < near:
                    return f"{cylinder.name} out"
        return "one turn" if machine.arm.joints[joint].without_ends else "joint limit"

    def poses_of(self, cylinder: int) -> RigidPoses:
        """Poses along the range of a cylinder's joint; of all joints if it spans several."""
        machine, joints = self.machine, self.machine.linkages[cylinder].joints
        if len(joints) == 1:
            return sweep(machine.arm, joints[0], over(machine.ranges[joints[0]], SWEEP))
        return self._poses_of_all(range(len(machine.cylinders)))

    def _poses_of_all(self, cylinders: Iterable[int]) -> RigidPoses:
        """Poses over all joint ranges at which some cylinders keep to their strokes.

        On the usual grid, whatever the workspace's; the workspace where none of that is one.
        """
        machine = self.machine
        q = mesh(joint_axes(machine, None, 0.0))
        margins = machine.margins(q)[:, list(cylinders)].min(axis=1, initial=np.inf)
        kept = q[margins >= -TOLERANCE]
        return machine.arm.kinematics(kept) if len(kept) else self.workspace.rigid

    @cached_property
    def levers(self) -> list[Lever]:
        """Moment arms of every cylinder about every joint that it spans."""
        levers = []
        for i, linkage in enumerate(self.machine.linkages):
            poses = self.poses_of(i)
            for j in linkage.joints:
                signed = linkage.actuation(poses).moment_arm[:, j]
                arm, turns = np.abs(signed), bool(signed.min() < 0 < signed.max())
                low, high = int(arm.argmin()), int(arm.argmax())
                levers.append(
                    Lever(
                        cylinder=i,
                        joint=j,
                        least=float(arm[low]),
                        least_at=float(poses.q[low, j]),
                        most=float(arm[high]),
                        most_at=float(poses.q[high, j]),
                        turns=turns,
                        follows=follows(self.machine.drives, i, j),
                    )
                )
        return levers

    def stroke_used(self, cylinder: int) -> float:
        """Share of its stroke that a cylinder passes over the joint ranges.

        One across several joints ends their motion itself where they would take it further.
        """
        machine, stroke = self.machine, self.machine.cylinders[cylinder].stroke
        linkage, closed = machine.linkages[cylinder], machine.cylinders[cylinder].closed_length
        if len(linkage.joints) > 1:
            others = (k for k in range(len(machine.cylinders)) if k != cylinder)
            poses = self._poses_of_all(others)
        else:
            poses = self.poses_of(cylinder)
        return float(np.ptp(np.clip(linkage.length(poses), closed, closed + stroke)) / stroke)

    def share_held(self, payload: str) -> float:
        """Share of joint space within the workspace in which a load case exists."""
        return weighted_share(self.cases[payload].exists, self.workspace.weights)

    @cached_property
    def cases(self) -> dict[str, CasePoses]:
        """Every load case by its name, with the poses at which it exists."""
        return {case.name: case for case in load_cases(self.machine, self.workspace)}

    @cached_property
    def least_stiffness(self) -> Array:
        """Stiffness that each spring alone needs, at every pose and load (ns,) [N m/rad, N/m]."""
        springs = self.machine.spring_stiffness
        matrices = (case.evaluate().stiffness_matrix for case in self.cases.values())
        factors = np.concatenate([least_stiffness_factors(k, springs)[:, :-1] for k in matrices])
        finite = np.where(np.isinf(factors), 0.0, factors)
        return np.asarray(springs * finite.max(axis=0, initial=0.0))

    @cached_property
    def loads(self) -> list[StaticLoad]:
        """Largest static load of every cylinder and motor under every load case."""
        return [
            self._load(i, name, forces)
            for name, case in self.cases.items()
            for i, forces in enumerate(case.evaluate().cylinder_forces.T)
            if len(forces)
        ]

    def _load(self, i: int, payload: str, forces: Array) -> StaticLoad:
        actuator, supply = self.machine.actuators[i], self.machine.supply
        pressures = actuator.available_pressure(supply), supply.return_pressure
        held = holding_force(actuator.bore_area, actuator.annulus_area, *pressures, forces >= 0)
        share = np.divide(
            np.abs(forces), held, out=np.where(forces == 0, 0.0, np.inf), where=held > 0
        )
        worst = int(share.argmax())
        cap, annulus = actuator.static_pressures(forces, supply)
        return StaticLoad(
            cylinder=i,
            payload=payload,
            pressure=float(max(cap[worst], annulus[worst])),
            share=float(share[worst]),
            cap=bool(cap[worst] > annulus[worst]),
            largest=(float(cap.max()), float(annulus.max())),
        )

    @cached_property
    def suspicions(self) -> list[Finding]:
        """Numbers most likely in another unit, and reversed axes: others may follow from them."""
        shares: dict[str, float] = {}
        for load in self.loads:
            name = self.machine.actuators[load.cylinder].name
            shares[name] = max(shares.get(name, 0.0), load.share)
        return suspicions(self.machine, shares)

    def findings(self, units: Units = WORKSHOP) -> list[Finding]:
        """Findings in the units asked for: suspicions first, as the others may follow."""
        return [*self.suspicions, *oddities(self, units)]


def inspect(machine: Machine, workspace: Workspace) -> Inspection:
    """Look at a machine over its workspace."""
    return Inspection(machine, workspace.on(machine))
