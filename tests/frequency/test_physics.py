"""What must hold at every pose of every machine, each checked by a method that shares no formula
with the code.

Sources: derivatives of the definition (finite differences), Pinocchio's own answer, or a theorem.
The machines are the shipped ones and those of `machines.py`: four-bars of either knee, spatial
arms, telescopes, cylinders across joints, more cylinders than joints, air, hoses, compliance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import eigh, null_space

import armdesign as ad
from armdesign.hydraulics.chamber_pressures import static_pressures
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.mechanism.linkage.four_bar import FourBar
from armdesign.units import GRAVITY
from tests.checks import assert_same, difference
from tests.machines import (
    BOOM,
    FOLD,
    LIFT,
    ODD,
    STICK,
    Function,
    build,
    inner_poses,
    named,
    random_machine,
    redundant,
    scaled,
)

FOUR_BAR = ("base", "pivot", "lug", "rocker", "coupler")  # its places

# ---------------------------------------------------------------------------------------- geometry


def test_moment_arms_are_derivatives_of_lengths(machine: ad.Machine) -> None:
    """Virtual work, τ = Rᵀ F, asks for R = ∂ℓ/∂q and nothing else; H = ∂R/∂q (finite
    differences).
    """
    q = inner_poses(machine, 4)
    for linkage in machine.drives:
        here = linkage.actuation(machine.arm.kinematics(q))
        arms = difference(lambda x, k=linkage: k.length(machine.arm.kinematics(x)), q)
        curves = difference(
            lambda x, k=linkage: k.actuation(machine.arm.kinematics(x)).moment_arm, q
        )
        assert_same(here.moment_arm, arms, 1e-9)
        assert_same(here.moment_arm_derivative, curves, 1e-8)
        assert np.all(np.delete(here.moment_arm, linkage.joints, axis=1) == 0)


@pytest.mark.parametrize("place", ["rod_end", *FOUR_BAR])
def test_sensitivities_are_derivatives_by_every_pin_and_bar(
    machine: ad.Machine, place: str
) -> None:
    """ℓ, r, H and the cosine at the knee against a linkage with one coordinate complex: its step
    is exact (1e-12).
    """
    poses, step = machine.arm.kinematics(inner_poses(machine, 3)), 1e-30
    for linkage in machine.linkages:
        at = linkage.place(place)
        if at is None:
            with pytest.raises(ValueError, match=place):
                linkage.sensitivities(poses, [(place, 0)])
            with pytest.raises(ValueError, match=place):
                linkage.with_place(place, (0.0, 0.0, 0.0))
            continue
        for axis in range(len(at)):
            stepped = linkage.with_place(place, np.array(at) + 1j * step * np.eye(len(at))[axis])
            length = stepped.span(poses).dot(stepped.span(poses)).sqrt()
            own = np.array(linkage.joints)
            (exact,) = linkage.sensitivities(poses, [(place, axis)])
            assert_same(exact.length, length.value.imag / step, 1e-12)
            assert_same(exact.moment_arm[:, own], length.first.imag / step, 1e-12)
            assert_same(
                exact.moment_arm_derivative[:, own][:, :, own], length.second.imag / step, 1e-12
            )
            assert np.all(np.delete(exact.moment_arm, own, axis=1) == 0)
            if linkage.transmission_words:
                slope = linkage.transmission(poses, [(place, axis)])[1][0]
                assert_same(slope, stepped.transmission(poses)[0].imag / step, 1e-12)


def test_a_moved_pin_is_where_it_was_put() -> None:
    """`with_place` changes one place and nothing else, and gives back what it was given."""
    linkage = named("excavator_20t").linkages[2]
    for place in FOUR_BAR:
        at = linkage.place(place)
        assert at is not None
        moved = linkage.with_place(place, tuple(value + 0.01 for value in at))
        assert_allclose(moved.place(place), np.array(at) + 0.01, rtol=1e-15)
        assert moved.with_place(place, at) == linkage


def test_the_knee_is_on_its_side_and_at_both_bars() -> None:
    """By definition: rocker from the pivot, coupler from the lug, left or right seen with x right
    and z up.
    """
    for name, side in (("four_bar_left", 1), ("four_bar_right", -1), ("excavator_20t", 1)):
        machine = named(name)
        poses = machine.arm.kinematics(inner_poses(machine, 5))
        bars = machine.linkages[2]
        assert isinstance(bars, FourBar)
        to_local = np.swapaxes(machine.arm.link_rotation(poses, bars.pivot.link), 1, 2)
        pivot = machine.arm.point(poses, bars.pivot.link, np.array(bars.pivot.at))
        lug = machine.arm.point(poses, bars.lug.link, np.array(bars.lug.at))
        knee = bars.ends(poses)[1]
        rocker, to_lug = (
            np.einsum("nij,nj->ni", to_local, x - pivot)[:, [0, 2]] for x in (knee, lug)
        )
        assert_allclose(np.linalg.norm(rocker, axis=1), bars.rocker, rtol=1e-12)
        assert_allclose(np.linalg.norm(rocker - to_lug, axis=1), bars.coupler, rtol=1e-12)
        turn = to_lug[:, 0] * rocker[:, 1] - to_lug[:, 1] * rocker[:, 0]
        assert np.all(np.sign(turn) == side)
        u, v = -rocker, to_lug - rocker
        angle = np.arccos(np.sum(u * v, axis=1) / bars.rocker / bars.coupler)
        assert_allclose(np.arccos(bars.transmission(poses)[0]), angle, rtol=1e-9)


# ---------------------------------------------------------- inertia and gravity, against Pinocchio


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
            along = (
                (end - base) / np.linalg.norm(end - base, axis=1)[:, None] * cylinder.closed_length
            )
            found = [
                (base, base + along, cylinder.count * 110),
                (end - along, end, cylinder.count * 85),
            ]
            if isinstance(linkage, FourBar):
                pivot, lug = (linkage.point(poses, pin) for pin in (linkage.pivot, linkage.lug))
                found += [(pivot, end, 95), (end, lug, 130)]
            for start, stop, mass in found:
                places = start[:, None] + shares[None, :, None] * (stop - start)[:, None]
                rows.append(places * np.sqrt(mass / 400))
        return np.concatenate(rows, axis=1)

    def torque(at: np.ndarray) -> np.ndarray:
        weights = np.concatenate(
            [
                np.full(400, np.sqrt(m / 400))
                for c in machine.cylinders
                for m in c.moving_masses.values()
            ]
        )
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


# --------------------------------------------------------------------------------------- stiffness


def trapped_torque(machine: ad.Machine, q0: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Net static torque Rᵀ F − g at q when the oil was shut in at q0: the pressures follow the
    volumes.

    Each chamber's pressure rises by what its volume lost over its capacity V/β(p0) +
    V_hose/β_hose; where the mounting yields, the piston moves by ℓ + cF. Neither A²/C nor K_g is
    written down.
    """
    start = machine.at(q0)
    force = start.cylinder_forces  # (n, nc), as all that follows; the chamber is the first axis
    area = np.array([(c.bore_area, c.annulus_area) for c in machine.actuators]).T[:, None]
    pressure = np.array(static_pressures(force, area[0], area[1], machine.supply.return_pressure))
    piston = [
        start.lengths[:, i] - c.closed_length + c.compliance * force[:, i]
        for i, c in enumerate(machine.actuators)
    ]
    volume = np.stack(
        [c.volumes(x) for c, x in zip(machine.actuators, piston, strict=True)], axis=-1
    )
    hoses = np.array(
        [
            (c.cap_hose_volume, c.annulus_hose_volume) / np.array(c.hose_modulus)
            for c in machine.actuators
        ]
    )
    capacity = (
        volume / bulk_modulus(pressure, machine.fluid.bulk_modulus, machine.fluid.air)
        + hoses.T[:, None]
    )
    yielding = np.array([c.compliance for c in machine.actuators])

    def torque(q: np.ndarray) -> np.ndarray:
        there = machine.evaluate(machine.rigid_poses(q))

        def excess(rise: float) -> np.ndarray:
            """Oil force less the force on the mounting when that has risen: zero where the piston
            finds its place.
            """
            piston = there.lengths - start.lengths + yielding * rise
            rises = np.array([-area[0], area[1]]) * piston / capacity
            return area[0] * (pressure + rises)[0] - area[1] * (pressure + rises)[1] - force - rise

        # the excess is linear in the rise
        found = force + excess(0.0) / (excess(0.0) - excess(1.0))
        return np.einsum("ncj,nc->nj", there.moment_arms, found) - there.gravity_torque

    return torque


def test_stiffness_is_the_derivative_of_the_torque_on_trapped_oil(machine: ad.Machine) -> None:
    q = inner_poses(machine, 3)
    torque = trapped_torque(machine, q)
    gravity = machine.at(q).gravity_torque
    assert_allclose(
        torque(q), 0, atol=1e-9 * np.abs(gravity).max(), err_msg="equilibrium: g = Rᵀ F"
    )
    assert_same(machine.at(q).stiffness_matrix, -difference(torque, q), 1e-8)


# ------------------------------------------------------------------------------------- frequencies


def squared_frequencies(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    """ω² by scipy's generalised eigensolver, pose by pose."""
    return np.array([eigh(k, m, eigvals_only=True) for k, m in zip(stiffness, mass, strict=True)])


def test_modes_solve_the_generalised_eigenproblem(machine: ad.Machine) -> None:
    poses = machine.at(inner_poses(machine, 4))
    modes = ad.natural_modes(poses)
    squared = squared_frequencies(poses.stiffness_matrix, poses.mass_matrix)
    assert_allclose(
        modes.frequencies, np.sqrt(np.maximum(squared, 0)) / (2 * np.pi), rtol=1e-9, atol=1e-6
    )
    shapes = modes.shapes
    identity = np.swapaxes(shapes, 1, 2) @ poses.mass_matrix @ shapes
    assert_allclose(
        identity, np.broadcast_to(np.eye(len(machine.joints)), identity.shape), atol=1e-9
    )
    diagonal = np.swapaxes(shapes, 1, 2) @ poses.stiffness_matrix @ shapes
    assert_allclose(np.einsum("njj->nj", diagonal), squared, rtol=1e-7, atol=1e-6)
    assert_allclose(modes.rigid_frequencies, _rigid(poses), rtol=1e-12)


def _rigid(poses: ad.Poses) -> np.ndarray:
    mass = np.abs(poses.cylinder_forces) / GRAVITY
    return np.sqrt(
        np.divide(poses.oil_stiffness, mass, out=np.full_like(mass, np.inf), where=mass > 0)
    ) / (2 * np.pi)


def locked_by_definition(poses: ad.Poses) -> np.ndarray:
    """Lowest frequency with all cylinders but i, and those with rows parallel to its own, on stiff
    springs.

    Springs 1e6 and 2e6 times as stiff, extrapolated: the error falls as one over their stiffness.
    Infinite where these others hold every joint (rank by ``matrix_rank``).
    """
    found = np.full(poses.cylinder_forces.shape, np.inf)
    for row, arms in enumerate(poses.moment_arms):
        for i in range(len(arms)):
            held = [
                k for k in range(len(arms)) if np.linalg.matrix_rank(arms[[i, k]], tol=1e-8) > 1
            ]
            if len(held) > 0 and np.linalg.matrix_rank(arms[held], tol=1e-8) == arms.shape[1]:
                continue
            clamps = 1e6 * arms[held].T @ np.diag(poses.oil_stiffness[row, held]) @ arms[held]
            stiffness, mass = poses.stiffness_matrix[row], poses.mass_matrix[[row, row]]
            once, twice = squared_frequencies(
                np.stack([stiffness + clamps, stiffness + 2 * clamps]), mass
            )[:, 0]
            found[row, i] = np.sqrt(max(2 * twice - once, 0)) / (2 * np.pi)
    return found


def test_locked_frequencies_are_those_with_all_other_cylinders_clamped(
    machine: ad.Machine,
) -> None:
    poses = machine.at(inner_poses(machine, 4))
    assert_allclose(
        ad.natural_modes(poses).locked_frequencies,
        locked_by_definition(poses),
        rtol=1e-4,
        atol=1e-4,
    )


def test_a_cylinder_that_shares_a_joint_is_locked_with_the_others() -> None:
    """By hand: with the other's row (a, b) held only v = (b, −a) remains, ω² = vᵀKv / vᵀMv."""
    poses = named("crossing").at([0.05, -0.1])
    expected = []
    for a, b in poses.moment_arms[0, ::-1]:
        v = np.array([b, -a])
        expected.append(
            np.sqrt(v @ poses.stiffness_matrix[0] @ v / (v @ poses.mass_matrix[0] @ v))
            / (2 * np.pi)
        )
    assert expected[0] != pytest.approx(expected[1], rel=0.1)
    assert_allclose(ad.natural_modes(poses).locked_frequencies[0], expected, rtol=1e-9)


def test_cylinders_beside_each_other_are_locked_as_one() -> None:
    """Two cylinders on one joint move together: K_ii/M_ii of their joint for both; a third holds
    the other joint.
    """
    twin = replace(LIFT, name="twin", base=("root", (0.4, 0, -0.1)), bore_mm=63, rod_mm=36)
    poses = build([BOOM, STICK], [LIFT, FOLD, twin]).at([0.1, -0.1])
    own = np.sqrt(poses.stiffness_matrix[0].diagonal() / poses.mass_matrix[0].diagonal()) / (
        2 * np.pi
    )
    assert_allclose(ad.natural_modes(poses).locked_frequencies[0], own[[0, 1, 0]], rtol=1e-9)


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000))
def test_coupled_below_locked_below_free(seed: int) -> None:
    """Interlacing (Courant–Fischer): holding others raises the lowest mode; letting them swing
    lowers the inertia.
    """
    machine = random_machine(seed)
    poses = machine.at(inner_poses(machine, 2))
    modes = ad.natural_modes(poses)
    assert np.all(modes.frequencies[:, :1] <= modes.locked_frequencies * (1 + 1e-9) + 1e-9)
    if all(len(linkage.joints) == 1 for linkage in machine.linkages):
        stiffness = np.einsum("njj->nj", poses.stiffness_matrix)
        # 1/inertia with the other chambers vented
        free = np.einsum("njj->nj", np.linalg.inv(poses.mass_matrix))
        index = [linkage.joints[0] for linkage in machine.linkages]
        limit = np.sqrt(np.maximum(stiffness * free, 0))[:, index] / (2 * np.pi)
        assert np.all(modes.locked_frequencies <= limit * (1 + 1e-9) + 1e-9)


def test_dunkerley_bounds_the_lowest_mode_from_below(machine: ad.Machine) -> None:
    """ω1² ≥ 1/tr(K⁻¹ M) for positive definite K: the trace is Σ 1/ω²."""
    poses = machine.at(inner_poses(machine, 6))
    stable = np.linalg.eigvalsh(poses.stiffness_matrix)[:, 0] > 0
    assert stable.any()
    trace = np.einsum(
        "njj->n", np.linalg.solve(poses.stiffness_matrix[stable], poses.mass_matrix[stable])
    )
    lowest = 2 * np.pi * ad.natural_modes(poses).frequencies[stable, 0]
    count = len(machine.joints)
    assert np.all(lowest >= trace**-0.5 * (1 - 1e-9))
    assert np.all(lowest <= np.sqrt(count) * trace**-0.5 * (1 + 1e-9))


# ------------------------------------------------------------------------------------ scaling laws

# with air β depends on the pressure itself
AIRLESS = "paper_1dof", "excavator_20t", "four_bar_right", "branched"


def oil_frequencies(machine: ad.Machine, q: np.ndarray) -> np.ndarray:
    """Frequencies of oil spring and inertia alone [Hz], without what gravity adds to K."""
    poses = machine.at(q)
    return np.sqrt(squared_frequencies(poses.hydraulic_stiffness, poses.mass_matrix)) / (2 * np.pi)


@pytest.mark.parametrize("name", AIRLESS)
def test_scaling_laws(name: str) -> None:
    """Dimensional analysis. K_h ~ β L³ and K_g ~ m L g, M ~ m L² (turning); prismatic joints
    follow in their own units.

    Without gravity's part: masses × a → f/√a, β × a → f √a, lengths × a at constant density → f/a.
    With it, exactly: masses and β × a → f unchanged; lengths × a at constant density with β × a
    (Froude) → f/√a.
    """
    a = 1.7
    machine = named(name)
    machine = machine.with_payload(machine.payloads[-1].name)
    q = inner_poses(machine, 4)
    larger_q = q * np.array([1 if joint.revolute else a for joint in machine.arm.joints])

    def other(**factors: float) -> ad.Machine:
        return scaled(machine, **factors).with_payload(machine.payload.name)

    oil, full = oil_frequencies(machine, q), ad.natural_modes(machine.at(q)).frequencies
    assert_allclose(oil_frequencies(other(mass=a), q), oil / np.sqrt(a), rtol=1e-9)
    assert_allclose(oil_frequencies(other(modulus=a), q), oil * np.sqrt(a), rtol=1e-9)
    assert_allclose(oil_frequencies(other(length=a, mass=a**3), larger_q), oil / a, rtol=1e-9)
    assert np.all(full[:, 0] != oil[:, 0]), (
        "gravity's part of K must count for the next two to say anything"
    )
    heavier = ad.natural_modes(other(mass=a, modulus=a).at(q)).frequencies
    assert_allclose(heavier, full, rtol=1e-9)
    froude = ad.natural_modes(other(length=a, mass=a**3, modulus=a).at(larger_q)).frequencies
    assert_allclose(froude, full / np.sqrt(a), rtol=1e-9)


# ------------------------------------------------------------------------ order, redundancy, count


def test_the_order_of_the_cylinders_does_not_matter() -> None:
    machine, mirrored = named("redundant"), redundant(reverse=True)
    q = inner_poses(machine, 5)
    modes, other = ad.natural_modes(machine.at(q)), ad.natural_modes(mirrored.at(q))
    assert_allclose(modes.frequencies, other.frequencies, rtol=1e-12)
    assert_allclose(modes.locked_frequencies, other.locked_frequencies[:, ::-1], rtol=1e-12)
    assert_allclose(
        machine.at(q).cylinder_forces,
        mirrored.at(q).cylinder_forces[:, ::-1],
        rtol=1e-9,
        atol=1e-6,
    )


def test_the_order_of_the_joints_does_not_matter(excavator: ad.Machine) -> None:
    text = excavator.text.replace(
        'joints = ["boom", "stick", "bucket"]', 'joints = ["bucket", "boom", "stick"]'
    )
    other = ad.Machine.from_text(text, excavator.urdf_text, excavator.source).with_payload("full")
    q, order = inner_poses(excavator, 5), [2, 0, 1]
    assert_allclose(
        ad.natural_modes(other.at(q[:, order])).frequencies,
        ad.natural_modes(excavator.at(q)).frequencies,
    )
    assert_same(
        other.at(q[:, order]).mass_matrix,
        excavator.at(q).mass_matrix[:, order][:, :, order],
        1e-12,
    )


def test_more_cylinders_than_joints_share_the_load_evenly() -> None:
    """Equilibrium g = Rᵀ F holds, and no self-stress lowers Σ (F/A)²: its gradient has no part
    along null(Rᵀ).
    """
    machine = named("redundant")
    poses = machine.at(inner_poses(machine, 8))
    areas = np.array([cylinder.bore_area for cylinder in machine.cylinders])
    balance = np.einsum("ncj,nc->nj", poses.moment_arms, poses.cylinder_forces)
    assert_allclose(balance, poses.gravity_torque, rtol=1e-9)
    for arms, forces in zip(poses.moment_arms, poses.cylinder_forces, strict=True):
        gradient = forces / areas**2
        assert_allclose(null_space(arms.T).T @ gradient, 0, atol=1e-9 * np.linalg.norm(gradient))


def test_two_parallel_cylinders_are_two_cylinders(excavator: ad.Machine) -> None:
    """`count = 2` equals one with bore and rod × √2, whose areas are twice as large
    (definition).
    """
    one = excavator.replace(
        {
            "cylinder.boom.count": 1,
            "cylinder.boom.bore_mm": 120 * 2**0.5,
            "cylinder.boom.rod_mm": 85 * 2**0.5,
        }
    )
    q = inner_poses(excavator, 5)
    assert_allclose(
        ad.natural_modes(one.at(q)).frequencies,
        ad.natural_modes(excavator.at(q)).frequencies,
        rtol=1e-12,
    )


@pytest.mark.parametrize("name", ODD)
def test_one_pose_alone_is_the_same_as_among_many(name: str) -> None:
    """Axis 0 is the pose: rows do not mix."""
    machine = named(name)
    q = inner_poses(machine, 4)
    together = ad.natural_modes(machine.at(q))
    for row in range(len(q)):
        alone = ad.natural_modes(machine.at(q[row]))
        assert_allclose(alone.frequencies[0], together.frequencies[row], rtol=1e-10, atol=1e-7)
        assert_allclose(
            alone.locked_frequencies[0], together.locked_frequencies[row], rtol=1e-10, atol=1e-7
        )


def test_no_poses_have_no_modes(machine: ad.Machine) -> None:
    """A load case that exists nowhere leaves an empty workspace: shapes hold, nothing raises."""
    modes = ad.natural_modes(machine.at(np.zeros((0, len(machine.joints)))))
    assert modes.frequencies.shape == (0, len(machine.joints))
    assert modes.locked_frequencies.shape == (0, len(machine.actuators))


def test_cylinders_must_hold_every_motion() -> None:
    """One cylinder across two joints, or the same one twice, leaves the arm to fold (R without
    full rank).
    """
    long = (("root", (-0.5, 0, 0.9)), ("stick", (-0.3, 0, 0.7)))
    for names in ("a", "ab"):
        with pytest.raises(ad.ArmDesignError, match="leave a direction of motion free"):
            build([BOOM, STICK], [Function(name, *long) for name in names])
