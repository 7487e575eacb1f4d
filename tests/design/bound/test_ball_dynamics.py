"""Inertia and gravity of the links, which the bound's proof takes to within ``LOST``, against
balls: Arb's arithmetic of python-flint from the numbers of the URDF on, by Jacobians.

M = Σ m Jᵀ J + Wᵀ I W over the links, g_i = m g ẑ·J_i, and ∂g_i/∂q_j by ∂J_i/∂q_j = ω_a × J_b with
a the one nearer to the root, zero where a slides.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import flint
import numpy as np
import pytest

import armdesign as ad
from armdesign.design.bound.outward import LOST, lost
from armdesign.design.search.semidefinite import exactly
from armdesign.units import GRAVITY
from tests import machines

BITS = 200
Balls = Any  # arrays of flint.arb, dtype object
balls = np.frompyfunc(flint.arb, 1, 1)
NOTHING = balls(np.zeros(3))


def cross(a: Balls, b: Balls) -> Balls:
    return np.array([a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)])


def about(axis: Balls, angle: flint.arb) -> Balls:
    """Rotation by an angle about an axis (Rodrigues)."""
    axis = axis / (axis @ axis).sqrt()
    across = np.array([cross(axis, e) for e in balls(np.eye(3))]).T
    return balls(np.eye(3)) + across * angle.sin() + across @ across * (1 - angle.cos())


def vector(element: ET.Element | None, name: str, default: str = "0 0 0") -> Balls:
    words = (default if element is None else element.get(name, default)).split()
    return balls(np.array([float(word) for word in words]))


def placed(element: ET.Element | None) -> tuple[Balls, Balls]:
    """Rotation and translation of an origin."""
    roll, pitch, yaw = vector(element, "rpy")
    x, y, z = balls(np.eye(3))
    return about(z, yaw) @ about(y, pitch) @ about(x, roll), vector(element, "xyz")


def frames(machine: ad.Machine, q: list[float]) -> dict[str, tuple[Balls, Balls, list[Any]]]:
    """Of each link rotation, translation, and the coordinates that move it, the nearest last.

    Each as its number, whether it slides, its axis and a point of that.
    """
    root = ET.fromstring(machine.urdf_text)
    values = {**machine.section.frozen, **dict(zip(machine.joints, q, strict=True))}
    joints = {of(joint, "child"): joint for joint in root.findall("joint")}
    names = (str(link.get("name")) for link in root.findall("link"))
    placed_links = {n: (balls(np.eye(3)), NOTHING, list[Any]()) for n in names if n not in joints}
    while len(placed_links) <= len(joints):
        for child, joint in joints.items():
            if child in placed_links or of(joint, "parent") not in placed_links:
                continue
            R, p, above = placed_links[of(joint, "parent")]
            turn, way = placed(joint.find("origin"))
            R, p, name = R @ turn, p + R @ way, str(joint.get("name"))
            axis, value = (
                vector(joint.find("axis"), "xyz", "1 0 0"),
                flint.arb(values.get(name, 0)),
            )
            axis, slides = axis / (axis @ axis).sqrt(), joint.get("type") == "prismatic"
            if name in machine.joints:
                above = [*above, (machine.joints.index(name), slides, R @ axis, p)]
            if joint.get("type") != "fixed":
                R, p = (R, p + R @ axis * value) if slides else (R @ about(axis, value), p)
            placed_links[child] = R, p, above
    return placed_links


def of(joint: ET.Element, end: str) -> str:
    """The link at an end of a joint."""
    return next(str(element.get("link")) for element in joint.findall(end))


def dynamics(machine: ad.Machine, q: list[float]) -> tuple[Balls, Balls, Balls]:
    """M, g and ∂g/∂q of the links at a pose."""
    n, placed_links = len(machine.joints), frames(machine, q)
    M, g, slope = balls(np.zeros((n, n))), balls(np.zeros(n)), balls(np.zeros((n, n)))
    for link in ET.fromstring(machine.urdf_text).findall("link"):
        R, p, above = placed_links[str(link.get("name"))]
        for inertial in link.findall("inertial"):
            mass = flint.arb(float(inertial.findall("mass")[0].get("value", "0")))
            turn, way = placed(inertial.find("origin"))
            centre, about_it = p + R @ way, inertia(inertial, R @ turn)
            J = {i: axis if slides else cross(axis, centre - at) for i, slides, axis, at in above}
            W = {i: NOTHING if slides else axis for i, slides, axis, _ in above}
            for place, i in enumerate(J):
                g[i] += mass * flint.arb(GRAVITY) * J[i][2]
                for j in J:
                    M[i, j] += mass * (J[i] @ J[j]) + W[i] @ about_it @ W[j]
                for j in list(J)[place:]:
                    more = mass * flint.arb(GRAVITY) * cross(W[i], J[j])[2]
                    slope[i, j] += more
                    slope[j, i] += more if i != j else 0
    return M, g, slope


def inertia(inertial: ET.Element, turn: Balls) -> Balls:
    """About the centre of mass, in the world's directions."""
    (element,) = inertial.findall("inertia")
    names = ("ixx", "ixy", "ixz", "ixy", "iyy", "iyz", "ixz", "iyz", "izz")
    own = balls(np.array([float(element.get(name, "0")) for name in names]).reshape(3, 3))
    return turn @ own @ turn.T


def off(ours: np.ndarray, exact: Balls) -> np.ndarray:
    """Most that floats can be off the balls."""
    return np.frompyfunc(lambda x, ball: float(abs(ball - flint.arb(x)).upper()), 2, 1)(
        ours, exact
    ).astype(float)


@pytest.mark.parametrize(
    "name", ["excavator_20t", "loader_crane", "mini_excavator_2t", "patu_boom"]
)
def test_links_within_a_thousandth_of_what_the_proof_allows(name: str) -> None:
    machine = machines.named(name)
    q = ad.Workspace.grid(machine, 3).q[::4]
    ours = machine.arm.rigid_poses(q)
    heaviest, steepest = (np.abs(x).max() for x in (ours.gravity_torque, ours.gravity_stiffness))
    assert heaviest > 0
    with flint.ctx.workprec(BITS):
        for k, pose in enumerate(q.tolist()):
            M, g, slope = dynamics(machine, pose)
            root = np.sqrt(np.diag(ours.mass_matrix[k]))
            least = 1e-3 * LOST
            assert (off(ours.mass_matrix[k], M) <= least * np.outer(root, root)).all()
            assert (off(ours.gravity_torque[k], g) <= least * heaviest).all()
            assert (off(ours.gravity_stiffness[k], slope) <= least * steepest).all()


def test_entries_may_be_wrong_and_the_sums_hold() -> None:
    """What is taken from inertia and added to slopes, against drawn errors of every entry."""
    random = np.random.default_rng(0)
    factor = random.normal(size=(2, 5, 3, 3))
    weight, mass = (np.einsum("nij,nkj->nik", part, part) for part in factor)
    slope = random.normal(size=(5, 3, 3))
    lighter, steeper = (float(x) for x in lost(exactly(weight), mass, slope))
    root = np.sqrt(np.diagonal(mass, axis1=1, axis2=2))
    for _ in range(100):
        sign = random.choice([-1.0, 1.0], size=mass.shape)
        wrong = LOST * sign * root[:, :, None] * root[:, None]
        assert abs((weight * wrong).sum()) <= lighter * (1 + 1e-9)
        assert abs((weight * LOST * sign * np.abs(slope)).sum()) <= steeper * (1 + 1e-9)
    assert (LOST * np.abs(weight) * root[:, :, None] * root[:, None]).sum() >= lighter * (1 - 1e-9)
