"""Natural frequencies of the same machines in Exudyn: from its right-hand side, and from its free
vibrations.

Geometry and inertia come from the URDF's text by ``exudyn_tree``; of ours Exudyn gets the static
cylinder forces, which its own equations must find in equilibrium. Gravity, geometric stiffness and
the pressures that hold the load are in every case.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine
from armdesign.hydraulics.friction import Friction
from armdesign.simulation.linearization import linearize
from armdesign.simulation.plant.springs import settled
from tests import machines
from tests.checks import difference
from tests.exudyn.exudyn_machines import FOUR_BARS, named
from tests.exudyn.exudyn_twin import UNIT, Motion, Twin, common, holding_pressures
from tests.simulation.valves import with_valves
from tests.sprung import random_sprung

ONE_JOINT = ("paper_1dof", "patu_boom")


DIRECT = (*ONE_JOINT, "direct_bucket", "spatial", "crossing", "branched", "random_3", "random_8")


# the last: the 20 t machine whose cylinders, rocker and coupler all weigh
LOOPS = *FOUR_BARS, "heavy_bars"


def poles(machine: Machine, pose: np.ndarray) -> np.ndarray:
    """Eigenvalues [rad/s] above the real axis of Exudyn's first-order system (q, q̇, p1, p2) at
    rest, slow first.
    """
    pressures, machine = holding_pressures(machine, pose), settled(machine, pose)
    twin, whole = Twin(machine, pose, pressures), machine.arm.with_springs(pose[None])[0]
    nq = len(whole)
    equilibrium = np.concatenate([whole, np.zeros(nq), pressures.ravel() / UNIT])[None]
    # [rad/s²]: it does hold the load
    np.testing.assert_allclose(twin.rates(equilibrium)[0, nq : 2 * nq], 0, atol=1e-10)
    eigenvalues = np.linalg.eigvals(difference(twin.rates, equilibrium)[0])
    return eigenvalues[np.argsort(eigenvalues.imag)[-nq:]]


@pytest.mark.parametrize("name", DIRECT)
def test_poles_of_the_right_hand_side(name: str) -> None:
    """Nothing is left out: pressures are states.

    Differences of order 8 are good to some 1e-12, so 1e-9 is roomy.
    """
    machine = named(name)
    for pose in machines.inner_poses(machine, 4):
        eigenvalues = poles(machine, pose)
        np.testing.assert_allclose(
            eigenvalues.imag / (2 * np.pi),
            ad.natural_modes(machine.at(pose)).frequencies[0],
            rtol=1e-9,
        )
        np.testing.assert_allclose(eigenvalues.real, 0, atol=1e-9 * np.abs(eigenvalues).max())


def on_springs(seed: int, damping_ratio: float) -> Machine:
    """A random machine on springs whose bars do not weigh: they would close loops."""
    machine = random_sprung(seed)
    bars = [f"cylinder.{c.name}.{bar}_kg" for c in machine.cylinders for bar in ("barrel", "rod")]
    light = machine.replace(dict.fromkeys(bars, 0.0))
    damped = (replace(spring, damping_ratio=damping_ratio) for spring in light.springs)
    return common(replace(light, springs=tuple(damped)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_poles_on_springs(seed: int) -> None:
    """Modes of machines on springs, undamped and damped: Exudyn's tree, its joints' controllers as
    springs, and pressures as states.
    """
    machine = on_springs(seed, 0.0)
    pose = machines.inner_poses(machine, 1)[0]
    eigenvalues = poles(machine, pose)
    frequencies = ad.natural_modes(machine.at(pose)).frequencies[0]
    np.testing.assert_allclose(eigenvalues.imag / (2 * np.pi), frequencies, rtol=1e-9)
    damped = on_springs(seed, 0.05)
    eigenvalues = poles(damped, pose)
    assert np.max(-eigenvalues.real / np.abs(eigenvalues)) > 0.005
    np.testing.assert_allclose(eigenvalues, linearize(with_valves(damped), pose).modes, rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["patu_boom", "direct_bucket"])
def test_poles_with_viscous_friction(name: str) -> None:
    """Damped poles of both plants: friction that damps one mode by a percent or so, and more."""
    machine = named(name)
    machine = replace(
        machine,
        cylinders=tuple(replace(c, friction=Friction(viscous=2e4)) for c in machine.cylinders),
    )
    for pose in machines.inner_poses(machine, 2):
        eigenvalues = poles(machine, pose)
        assert np.max(-eigenvalues.real / np.abs(eigenvalues)) > 0.005
        np.testing.assert_allclose(eigenvalues, linearize(machine, pose).modes, rtol=1e-7)


def vibration(
    machine: Machine, pose: np.ndarray, solver: str, per_period: int, push: float
) -> Motion:
    """Four periods of the lowest mode with shut valves after unlike excess pressures [Pa] in the
    caps.
    """
    frequencies = ad.natural_modes(machine.at(pose)).frequencies[0]
    excess = push * np.column_stack(
        [np.arange(1, len(machine.cylinders) + 1), np.zeros(len(machine.cylinders))]
    )
    twin = Twin(machine, pose, holding_pressures(machine, pose) + excess)
    return twin.run(solver, 1 / (per_period * frequencies[-1]), 4 / frequencies[0])


def identified(motion: Motion, every: int) -> np.ndarray:
    """Frequencies [rad/s] of undamped modes, slow ones first, from one record in ``every``.

    v(t) = Σ a_k cos(ω_k t + φ_k) makes v(t + h) + v(t − h) = C v(t), and C has the eigenvalues 2
    cos ω_k h.
    """
    v = motion.velocity[::every]
    c = np.linalg.lstsq(v[1:-1], v[2:] + v[:-2], rcond=None)[0]
    return np.sort(np.arccos(np.linalg.eigvals(c).real / 2)) / (
        motion.time[every] - motion.time[0]
    )


@pytest.mark.parametrize(
    ("name", "tolerance"), [*((name, 1e-6) for name in ONE_JOINT), ("direct_bucket", 1e-5)]
)
def test_free_vibration(name: str, tolerance: float) -> None:
    """The figures asked for; the push of 100 Pa moves the middle of the vibration by some 1e-7
    rad.
    """
    machine = named(name)
    for pose in machines.inner_poses(machine, 3):
        ringing = identified(vibration(machine, pose, "RK67", 40, 100.0), every=10) / (2 * np.pi)
        np.testing.assert_allclose(
            ringing, ad.natural_modes(machine.at(pose)).frequencies[0], rtol=tolerance
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPS)
def test_free_vibration_of_a_closed_loop(name: str) -> None:
    """Loops closed by constraints, so the implicit trapezoidal rule integrates.

    Its vibrations are exact up to a known detuning, tan(ω̃ h/2) = ω h/2 (it turns λ into (1 +
    λh/2)/(1 − λh/2)), which is taken back. What is left changes sign with the push, so two
    opposite ones are averaged.
    """
    machine = named(name)
    for pose in machines.inner_poses(machine, 2):
        ringing = []
        for push in (3000.0, -3000.0):
            motion = vibration(machine, pose, "TrapezoidalIndex2", 12, push)
            half = (motion.time[1] - motion.time[0]) / 2
            ringing.append(np.tan(identified(motion, every=3) * half) / half / (2 * np.pi))
        np.testing.assert_allclose(
            np.mean(ringing, axis=0), ad.natural_modes(machine.at(pose)).frequencies[0], rtol=1e-5
        )
