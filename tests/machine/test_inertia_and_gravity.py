"""Inertia, gravity and placements at every pose, against Pinocchio's own answer.

The payload is a body of Pinocchio's there, and bars are many small masses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.mechanism.linkage.four_bar import FourBar
from armdesign.units import GRAVITY
from tests.checks import assert_same, difference
from tests.machines import inner_poses, named


class Reference:
    """Pinocchio on the URDF itself, all its joints (frozen ones at their zero), the payload
    appended as a body.
    """

    def __init__(self, machine: ad.Machine) -> None:
        self.model = pinocchio.buildModelFromXML(machine.urdf_text)
        self.payload = machine.payload
        if self.payload.link is not None:
            frame = self.model.frames[self.frame(self.payload.link)]
            body = pinocchio.Inertia(
                self.payload.mass, np.array(self.payload.at), np.zeros((3, 3))
            )
            self.model.appendBodyToJoint(frame.parentJoint, body, frame.placement)
        self.data = self.model.createData()
        self._joints = [self.model.joints[self.model.getJointId(name)] for name in machine.joints]
        self.rows = [joint.idx_v for joint in self._joints]

    def frame(self, link: str) -> int:
        return self.model.getFrameId(link, pinocchio.FrameType.BODY)

    def configuration(self, q: np.ndarray) -> np.ndarray:
        full = pinocchio.neutral(self.model)
        # a continuous one has cosine and sine
        for joint, value in zip(self._joints, q, strict=True):
            full[joint.idx_q : joint.idx_q + joint.nq] = (
                value if joint.nq == 1 else (np.cos(value), np.sin(value))
            )
        return full


def test_inertia_and_gravity_are_pinocchios_with_the_payload_as_a_body(
    machine: ad.Machine,
) -> None:
    """Bars that are no links have a test of their own."""
    bare = [
        replace(c, barrel_mass=0.0, rod_mass=0.0, linkage_masses=()) for c in machine.cylinders
    ]
    machine = replace(machine, cylinders=tuple(bare))
    other = Reference(machine)
    poses = machine.at(inner_poses(machine, 4))
    pick = np.ix_(other.rows, other.rows)
    for row, q in enumerate(poses.q):
        arguments = other.model, other.data, other.configuration(q)
        mass = np.triu(pinocchio.crba(*arguments))
        assert_same(poses.mass_matrix[row], (mass + np.triu(mass, 1).T)[pick], 1e-12)
        assert_same(
            poses.gravity_torque[row],
            pinocchio.computeGeneralizedGravity(*arguments)[other.rows],
            1e-12,
        )
        assert_same(
            poses.gravity_stiffness[row],
            pinocchio.computeGeneralizedGravityDerivatives(*arguments)[pick],
            1e-12,
        )


def test_bars_weigh_and_move_like_many_small_masses() -> None:
    """By brute force: each bar cut into 400 pieces, their places differenced for kinetic and
    potential energy.
    """
    machine = named("heavy_bars").with_payload("empty")
    light = named("excavator_20t").with_payload("empty")
    q = inner_poses(machine, 3)
    shares = (np.arange(400) + 0.5) / 400

    def pieces(at: np.ndarray) -> np.ndarray:
        """Places (n, pieces, 3) times the square root of their masses; of all bars in a row."""
        poses = machine.arm.kinematics(at)
        rows = []
        for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
            base, end = linkage.ends(poses)
            direction = (end - base) / np.linalg.norm(end - base, axis=1)[:, None]
            along = direction * cylinder.closed_length
            bars = [(base, base + along, cylinder.count * 110)]
            bars += [(end - along, end, cylinder.count * 85)]
            if isinstance(linkage, FourBar):
                pivot, lug = (linkage.point(poses, pin) for pin in (linkage.pivot, linkage.lug))
                bars += [(pivot, end, 95), (end, lug, 130)]
            for start, stop, mass in bars:
                places = start[:, None] + shares[None, :, None] * (stop - start)[:, None]
                rows.append(places * np.sqrt(mass / 400))
        return np.concatenate(rows, axis=1)

    def torque(at: np.ndarray) -> np.ndarray:
        masses = [m for c in machine.cylinders for m in c.moving_masses.values()]
        weights = np.repeat(np.sqrt(np.array(masses) / 400), 400)
        return GRAVITY * np.einsum("p,npj->nj", weights, difference(pieces, at)[:, :, 2])

    jacobian = difference(pieces, q)  # (n, pieces, 3, nq)
    mass = np.einsum("npij,npik->njk", jacobian, jacobian)
    heavy, bare = machine.at(q), light.at(q)
    # 400 pieces miss 1/400² of a bar's turning inertia
    assert_same(heavy.mass_matrix - bare.mass_matrix, mass, 1e-5)
    assert_same(heavy.gravity_torque - bare.gravity_torque, torque(q), 1e-7)
    assert_same(
        heavy.gravity_stiffness, difference(lambda at: machine.at(at).gravity_torque, q), 1e-7
    )


def test_placements_are_pinocchios(machine: ad.Machine) -> None:
    """Position and orientation of every link against `framesForwardKinematics` on the URDF as it
    is.
    """
    other = Reference(machine)
    poses = machine.rigid_poses(inner_poses(machine, 3))
    local = np.array([0.3, -0.2, 0.7])
    for row, q in enumerate(poses.q):
        pinocchio.framesForwardKinematics(other.model, other.data, other.configuration(q))
        for link in machine.arm.links:
            place = other.data.oMf[other.frame(link)]
            assert_allclose(
                machine.arm.link_rotation(poses, link)[row], place.rotation, atol=1e-12
            )
            assert_allclose(
                machine.arm.point(poses, link, local)[row], place.act(local), atol=1e-12
            )
