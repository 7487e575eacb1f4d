"""What holds of every machine, whatever its joints, linkages, motors, springs and masses.

Sources: energy by Pinocchio and differences (`tests/energy.py`), scipy's general eigensolver,
theorems (Courant–Fischer, interlacing), and changes that must not matter. Ten minutes of it by the
command in CONTRIBUTING.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from hypothesis import given, settings
from numpy.testing import assert_allclose
from scipy.linalg import eigh

import armdesign as ad
from armdesign.errors import TopplingError
from armdesign.frequency.modes import energy_shares, lowest_frequency
from tests.any_machine import AnyMachine, any_machines
from tests.checks import assert_same, difference, settled_difference
from tests.energy import Energy
from tests.machine import as_links
from tests.machine.test_stiffness import trapped_torque

SECOND = (-205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560)  # second derivative to the eighth order
STEP = 2e-3


def squared(poses: ad.Poses) -> np.ndarray:
    """ω² of each pose (n, k) by scipy."""
    pairs = zip(poses.stiffness_matrix, poses.mass_matrix, strict=True)
    return np.array([eigh((k + k.T) / 2, m, eigvals_only=True) for k, m in pairs])


def assert_not_above(lower: np.ndarray, upper: np.ndarray, scale: np.ndarray) -> None:
    assert np.all(lower <= upper + 1e-9 * scale)


def matrices_are_of_the_total_energy(case: AnyMachine) -> None:
    """Along random directions: M by kinetic energy, K by the potential one, and no force left."""
    poses, rng = case.machine.at(case.q[:1]), np.random.default_rng(0)
    mass, stiffness = poses.mass_matrix[0], poses.stiffness_matrix[0]
    assert_same(mass, mass.T, 1e-13)
    assert_same(stiffness, stiffness.T, 1e-12)
    assert np.linalg.eigvalsh(mass)[0] > 0
    energy = Energy(case.machine, case.q[0])
    for _ in range(2):
        along = rng.normal(size=len(mass))
        along /= np.linalg.norm(along)
        assert along @ mass @ along / 2 == pytest.approx(energy.kinetic(along), rel=1e-8)

        def potential(step: float, along: np.ndarray = along) -> float:
            return energy.potential(energy.equilibrium + step * STEP * along)

        parts = [c * (potential(k) + potential(-k)) for k, c in enumerate(SECOND[1:], start=1)]
        curvature = (SECOND[0] * potential(0) + sum(parts)) / STEP**2
        terms = np.abs(stiffness) + np.abs(poses.hydraulic_stiffness[0])
        size = np.abs(along) @ terms @ np.abs(along) + abs(potential(0)) * 1e-3 / STEP
        assert along @ stiffness @ along == pytest.approx(curvature, abs=1e-7 * size)


def stiffness_is_that_of_the_trapped_oil(case: AnyMachine) -> None:
    """Of the joints of q, from pressures and volumes: nothing of k_h, K_g or H."""
    nq = len(case.machine.joints)
    change = settled_difference(trapped_torque(case.machine, case.q), case.q)
    assert_same(case.machine.at(case.q).stiffness_matrix[:, :, :nq], -change, 1e-7)


def moment_arms_are_differences_of_lengths(case: AnyMachine) -> None:
    energy, nq = Energy(case.machine, case.q[0]), len(case.machine.joints)
    slope = difference(
        lambda x: np.array([energy.of_actuators(row) for row in x]), energy.equilibrium[None]
    )
    poses = case.machine.at(case.q[:1])
    assert_allclose(poses.moment_arms[0], slope[0], atol=1e-9)
    assert_allclose(poses.moment_arms[0, :, nq:], 0.0)
    assert_allclose(poses.lengths[0], energy.lengths, rtol=1e-12)


def modes_solve_the_eigenproblem(case: AnyMachine) -> None:
    poses = case.machine.at(case.q)
    modes = ad.natural_modes(poses)
    omega = 2 * math.pi * modes.frequencies
    expected = squared(poses)
    largest = np.abs(expected).max()
    assert_allclose(omega**2, np.maximum(expected, 0), rtol=1e-9, atol=1e-11 * largest)
    pull = poses.stiffness_matrix @ modes.shapes
    push = (poses.mass_matrix @ modes.shapes) * expected[:, None, :]
    assert_allclose(pull, push, atol=1e-8 * np.abs(poses.stiffness_matrix).max())
    shares = energy_shares(poses, modes)
    assert_allclose(shares.sum(axis=2), 1.0, rtol=1e-12)
    assert np.all(shares >= 0)


def coupled_is_not_above_locked(case: AnyMachine) -> None:
    """Holding others takes motions away: the lowest mode of what is left is none lower."""
    modes = ad.natural_modes(case.machine.at(case.q))
    lowest = modes.frequencies[:, :1]
    assert_not_above(lowest, modes.locked_frequencies, modes.frequencies[:, -1:])


def softer_parts_raise_no_frequency(case: AnyMachine) -> None:
    """Compliance in series, softer oil, softer springs: K falls, and so does every ω²."""
    machine = case.machine
    stiffer = squared(machine.at(case.q))
    softer: dict[str, float] = {}
    for one in machine.actuators:
        unit = "rad_per_N_m" if one.kind == "motor" else "m_per_N"
        own = 1 / float(machine.at(case.q[:1]).oil_stiffness.max())
        softer[f"{one.kind}.{one.name}.compliance_{unit}"] = one.compliance + 0.3 * own
    changes = [softer, {"fluid.bulk_modulus_MPa": 900.0}]
    changes += [
        {f"spring.{one.name}.{one.stiffness_key}": 0.97 * one.stiffness} for one in machine.springs
    ]
    for change in changes:
        other = machine.replace(change)
        poses = other.evaluate(other.rigid_poses(case.q))  # springs may be too soft now
        assert_not_above(squared(poses), stiffer, 1e-3 * np.abs(stiffer).max())


def reversed_axes_change_nothing(case: AnyMachine) -> None:
    modes = ad.natural_modes(case.machine.at(case.q))
    for index, joint in enumerate(case.draft.joints):
        other, q = case.draft.reversed(index).machine(), case.q.copy()
        if joint.name in case.draft.order:
            q[:, case.draft.order.index(joint.name)] *= -1
        assert_same_modes(ad.natural_modes(other.at(q)), modes)


def assert_same_modes(modes: ad.Modes, expected: ad.Modes, relative: float = 1e-9) -> None:
    scale = expected.frequencies.max()
    for name in ("frequencies", "locked_frequencies", "rigid_frequencies"):
        values, right = getattr(modes, name), getattr(expected, name)
        assert_allclose(values, right, rtol=relative, atol=1e-5 * relative**0.5 * scale)


def links_in_the_file_are_those_of_the_urdf(case: AnyMachine) -> None:
    """A way from one to the other that is not the package's own."""
    document = tomlkit.parse(case.machine.text)
    del document["urdf"]
    document["links"] = as_links.tables(case.machine.urdf_text)
    other = ad.Machine.from_text(tomlkit.dumps(document), "", Path("odd.toml"))
    assert_same_modes(*(ad.natural_modes(m.at(case.q)) for m in (other, case.machine)))


def poles_of_the_linear_model_are_the_modes(case: AnyMachine) -> None:
    """Valves closed, nothing that damps: ±iω of every mode that is stable."""
    omega = 2 * math.pi * ad.natural_modes(case.machine.at(case.q[0])).frequencies[0]
    if omega[0] == 0:
        return  # a pose that does not stand has no linear model
    try:
        poles = np.linalg.eigvals(ad.linearize(case.machine, case.q[0]).A)
    except ad.ArmDesignError as error:
        if "cannot hold" in str(error):  # the load would open a relief valve
            return
        raise
    assert poles.real.max() < 1e-4 * omega[-1]
    assert np.abs(poles[:, None] - 1j * omega).min(axis=0).max() < 1e-4 * omega[-1]


def no_pose_is_below_the_worst(case: AnyMachine) -> None:
    """Of poses at random, a third of their joints at an end; from a grid of the ends alone.

    With air: without, no more is searched than from the lowest poses of a grid, and two values of
    each joint are too few for that (``docs/limits.md`` says what holds of four). The worst pose of
    a map is the lowest that a search meets, and steps of its last round are 0.2 % of the joint
    ranges: a tenth of a percent of the frequency is room enough.
    """
    if not case.machine.fluid.aerated:
        return
    rng = np.random.default_rng(0)
    try:
        workspace = ad.Workspace.grid(case.machine, 2)
    except ad.ArmDesignError as error:
        if "in stroke" in str(error) or "stroke_mm" in str(error):  # at no end of the ranges
            return
        raise
    try:
        worst = ad.frequency_map(case.machine, workspace).worst
    except TopplingError:
        return
    shares = rng.random((300, len(case.machine.joints)))
    shares = np.where(rng.random(shares.shape) < 1 / 3, np.round(shares), shares)
    q = workspace.ranges[:, 0] + shares * np.ptp(workspace.ranges, axis=1)
    q = q[workspace.in_stroke(q)]
    poses = case.machine.evaluate(case.machine.rigid_poses(q))
    below = lowest_frequency(poses) * 1.001 < worst.frequency  # not of NaN, at a dead centre
    assert not below.any(), poses.q[below]


INVARIANTS: tuple[Callable[[AnyMachine], None], ...] = (
    matrices_are_of_the_total_energy,
    stiffness_is_that_of_the_trapped_oil,
    moment_arms_are_differences_of_lengths,
    modes_solve_the_eigenproblem,
    coupled_is_not_above_locked,
    softer_parts_raise_no_frequency,
    reversed_axes_change_nothing,
    links_in_the_file_are_those_of_the_urdf,
    poles_of_the_linear_model_are_the_modes,
    no_pose_is_below_the_worst,
)


@settings(max_examples=3)
@given(any_machines())
def test_what_holds_of_a_few(case: AnyMachine) -> None:
    for invariant in INVARIANTS:
        invariant(case)


@pytest.mark.slow
@settings(max_examples=settings.default.max_examples // 2)
@given(any_machines())
def test_what_holds_of_many(case: AnyMachine) -> None:
    for invariant in INVARIANTS:
        invariant(case)
