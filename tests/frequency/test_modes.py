"""Natural frequencies of every machine, each checked by a method of other formulas.

Sources: a general eigenvalue solver, the definition of a locked cylinder, theorems (interlacing,
Dunkerley), scaling laws, symmetries.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.linalg import eigh, null_space

import armdesign as ad
from armdesign.errors import PoseError
from armdesign.frequency.modes import inverse_cholesky
from armdesign.units import GRAVITY
from tests.checks import assert_same
from tests.machines import (
    BOOM,
    FOLD,
    LIFT,
    ODD,
    STICK,
    CylinderSpec,
    build,
    inner_poses,
    named,
    random_machine,
    redundant,
)
from tests.scaled_machines import scaled


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
    """Of cylinders k/(|F|/g); of motors inf."""
    mass = np.abs(poses.cylinder_forces) / GRAVITY
    mass[:, len(poses.machine.cylinders) :] = 0.0
    return np.sqrt(
        np.divide(poses.oil_stiffness, mass, out=np.full_like(mass, np.inf), where=mass > 0)
    ) / (2 * np.pi)


def locked_by_definition(poses: ad.Poses) -> np.ndarray:
    """Lowest frequency with all cylinders but i, and those with rows parallel to its own, on stiff
    springs.

    Springs 1e6 and 2e6 times as stiff, extrapolated: the error falls as one over their stiffness.
    Infinite where these others hold every joint (rank by ``matrix_rank``).
    """
    locked = np.full(poses.cylinder_forces.shape, np.inf)
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
            locked[row, i] = np.sqrt(max(2 * twice - once, 0)) / (2 * np.pi)
    return locked


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


# with air β depends on the pressure itself
# no air, nothing in series: those depend on the load
RIGID = "paper_1dof", "rigid_excavator_20t", "four_bar_right", "branched"


def oil_frequencies(machine: ad.Machine, q: np.ndarray) -> np.ndarray:
    """Frequencies of oil spring and inertia alone [Hz], without what gravity adds to K."""
    poses = machine.at(q)
    return np.sqrt(squared_frequencies(poses.hydraulic_stiffness, poses.mass_matrix)) / (2 * np.pi)


@pytest.mark.parametrize("name", RIGID)
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
            build([BOOM, STICK], [CylinderSpec(name, *long) for name in names])


@pytest.mark.parametrize("k", [1, 2, 3, 7])
def test_in_the_frame_of_modes_the_inertia_is_one(k: int) -> None:
    """Within what rounding leaves of inertias that differ by 1e10 (1e10 × 2e-16, some times)."""
    root = np.random.default_rng(k).normal(size=(50, k, k)) * np.logspace(0, -4.5, k)
    mass = root @ np.swapaxes(root, 1, 2) + 1e-10 * np.eye(k)
    inverse = inverse_cholesky(mass)
    assert np.array_equal(inverse, np.tril(inverse))
    one = np.broadcast_to(np.eye(k), mass.shape)
    assert_allclose(inverse @ mass @ np.swapaxes(inverse, 1, 2), one, atol=2e-5)


@pytest.mark.parametrize(
    "mass", [[[1.0, 1.0], [1.0, 1.0]], [[1.0, 0.0], [0.0, -1.0]], [[0.0]], [[1e-320]]]
)
def test_one_pose_without_inertia_is_refused(mass: list[list[float]]) -> None:
    one = np.array(mass)
    with pytest.raises(PoseError, match="not positive definite"):
        inverse_cholesky(np.stack([np.eye(len(one)), one]))
