"""Kinetic and potential energy of a machine over all its coordinates, by none of its formulas."""

from __future__ import annotations

import math

import numpy as np
import pinocchio

import armdesign as ad
from armdesign.mechanism.linkage.base import Linkage
from armdesign.mechanism.linkage.four_bar import FourBar
from armdesign.units import GRAVITY
from tests.checks import difference


class Energy:
    """Energy near one pose with the oil trapped there.

    Links and places are Pinocchio's of the whole URDF, masses of bars lumps along them, knees by
    the law of cosines, trapped oil a spring of its stiffness under its static force, springs as
    their file says. The preload is what keeps gravity from moving the spring, by difference.
    """

    def __init__(self, machine: ad.Machine, q: np.ndarray) -> None:
        self.machine, self.poses = machine, machine.at(q)
        self.model = pinocchio.buildModelFromXML(machine.urdf_text)
        self.data = self.model.createData()
        names = [*machine.joints, *(spring.joint for spring in machine.springs)]
        self.joints = [self.model.joints[self.model.getJointId(n)] for n in names]
        self.equilibrium = np.concatenate([q, [spring.at for spring in machine.springs]])
        self.lengths = self.of_actuators(self.equilibrium)
        slope = difference(
            lambda x: np.array([self.weight(row) for row in x]), self.equilibrium[None]
        )
        self.preload = slope[0, len(q) :]

    def positions(self, x: np.ndarray) -> np.ndarray:
        """In Pinocchio's order; a joint that turns without end is a point of the unit circle."""
        values = np.empty(self.model.nq)
        for joint, value in zip(self.joints, x, strict=True):
            turns = joint.nq == 2
            values[joint.idx_q : joint.idx_q + joint.nq] = (
                (math.cos(value), math.sin(value)) if turns else value
            )
        return values

    def place(self, link: str, at: tuple[float, ...]) -> np.ndarray:
        """Of a point, at the positions of the last `moved_to`."""
        frame = self.model.getFrameId(link, pinocchio.FrameType.BODY)
        return np.asarray(self.data.oMf[frame].act(np.array(at)))

    def moved_to(self, x: np.ndarray) -> None:
        pinocchio.framesForwardKinematics(self.model, self.data, self.positions(x))

    def rod_end(self, linkage: Linkage) -> np.ndarray:
        if not isinstance(linkage, FourBar):
            return self.place(linkage.rod_end.link, linkage.rod_end.at)
        frame = self.data.oMf[self.model.getFrameId(linkage.pivot.link, pinocchio.FrameType.BODY)]
        lug = frame.actInv(self.place(linkage.lug.link, linkage.lug.at)) - linkage.pivot.at
        across, up = float(lug[0]), float(lug[2])  # in the plane of the four-bar
        apart, a, b = math.hypot(across, up), linkage.rocker, linkage.coupler
        corner = math.acos((a * a + apart * apart - b * b) / (2 * a * apart))
        turn = math.atan2(up, across) + (corner if linkage.knee == "left" else -corner)
        knee = np.array([a * math.cos(turn), 0.0, a * math.sin(turn)])
        return np.asarray(frame.act(knee + linkage.pivot.at))

    def lumps(self, x: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Payload and bars as masses and places: Gauss points, exact for even bars."""
        self.moved_to(x)
        payload = self.machine.payload
        every = [(payload.mass, self.place(payload.link, payload.at))]
        for cylinder, linkage in zip(self.machine.cylinders, self.machine.linkages, strict=True):
            base = self.place(linkage.base.link, linkage.base.at)
            end = self.rod_end(linkage)
            along = (end - base) / np.linalg.norm(end - base) * cylinder.closed_length
            bars = [(cylinder.count * cylinder.barrel_mass, base, base + along)]
            bars.append((cylinder.count * cylinder.rod_mass, end - along, end))
            for bar, mass in cylinder.linkage_masses:
                foot = linkage.pivot if bar == "rocker" else linkage.lug
                bars.append((mass, self.place(foot.link, foot.at), end))
            nodes, weights = np.polynomial.legendre.leggauss(4)
            for mass, start, stop in bars:
                for node, weight in zip((nodes + 1) / 2, weights / 2, strict=True):
                    every.append((weight * mass, start + node * (stop - start)))
        return every

    def of_actuators(self, x: np.ndarray) -> np.ndarray:
        """Lengths of cylinders, angles of motors."""
        self.moved_to(x)
        spans = [
            np.linalg.norm(self.rod_end(k) - self.place(k.base.link, k.base.at))
            for k in self.machine.linkages
        ]
        gears = self.machine.drives[len(spans) :]
        return np.array([*spans, *(x[gear.joint] for gear in gears)])

    def weight(self, x: np.ndarray) -> float:
        links = pinocchio.computePotentialEnergy(self.model, self.data, self.positions(x))
        return float(links + sum(m * GRAVITY * at[2] for m, at in self.lumps(x)))

    def potential(self, x: np.ndarray) -> float:
        stretch, springs = self.of_actuators(x) - self.lengths, self.machine.springs
        oil = 0.5 * self.poses.oil_stiffness[0] * stretch**2
        oil = oil - self.poses.cylinder_forces[0] * stretch
        moved = (x - self.equilibrium)[len(self.machine.joints) :]
        stiffness = np.array([spring.stiffness for spring in springs])
        return self.weight(x) + float(
            oil.sum() + (0.5 * stiffness * moved**2 - self.preload * moved).sum()
        )

    def kinetic(self, velocity: np.ndarray) -> float:
        speeds = np.empty(self.model.nv)
        speeds[[joint.idx_v for joint in self.joints]] = velocity
        at = self.positions(self.equilibrium)
        links = pinocchio.computeKineticEnergy(self.model, self.data, at, speeds)
        step = 1e-5

        def moved(sign: float) -> np.ndarray:
            return np.array(
                [at for _, at in self.lumps(self.equilibrium + sign * step * velocity)]
            )

        speed = (8 * (moved(1) - moved(-1)) - (moved(2) - moved(-2))) / (12 * step)
        masses = np.array([m for m, _ in self.lumps(self.equilibrium)])
        return float(links + 0.5 * (masses * (speed**2).sum(axis=1)).sum())
