"""Machines on springs in motion, against closed forms, the linear answer and their energy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.frequency.modes import natural_modes
from armdesign.simulation.identification.ringdown import identify_ringdown
from armdesign.simulation.linearization import linearize
from armdesign.simulation.simulate import simulate
from armdesign.simulation.validation import validate
from tests.simulation.valves import ideally_fed
from tests.sprung import off_middle, rocking, two_masses

STILL = {"duration": 1.0, "command": {"boom": lambda t: 0.0}}


@pytest.fixture(scope="module")
def machine() -> ad.Machine:
    return ideally_fed(rocking(more="at_deg = 0.5"))


def test_at_rest_it_stays(machine: ad.Machine) -> None:
    """The preload of each load case holds the spring where the file has it."""
    for payload in ("empty", "full"):
        q = ad.Workspace.grid(machine, points=4).q
        q = q[machine.holds(q, machine.with_payload(payload).payload)][0]
        run = simulate(machine, q, payload=payload, **STILL)
        assert_allclose(run.q, np.tile(q, (len(run.q), 1)), atol=1e-7)
        assert_allclose(run.springs, math.radians(0.5), atol=1e-7)
        assert run.springs.shape == (len(run.time), 1)
        assert_allclose(run.frame["rocking_deg"], 0.5, atol=1e-5)


def test_poles_are_the_modes(machine: ad.Machine) -> None:
    """Undamped, the plant's poles solve K v = ω² M v, springs among them."""
    q = off_middle(machine)
    linear = linearize(machine, q)
    assert_allclose(
        linear.natural_frequencies, natural_modes(machine.at(q)).frequencies[0], rtol=1e-6
    )
    assert_allclose(linear.damping_ratios, 0, atol=1e-7)
    assert "rocking position" in linear.states


def test_damping_ratio_is_that_of_the_joint_alone() -> None:
    """With the cylinder a thousand times stiffer the carriage rings as if alone, mass and slide
    on κ: ζ and ω as by hand.
    """
    kappa, zeta = 3e5, 0.05
    machine = two_masses(kappa, 900.0, f"damping_ratio = {zeta}").replace(
        {
            "fluid.bulk_modulus_MPa": 10_000.0,
            "cylinder.push.dead_volume_l.cap": 0.01,
            "cylinder.push.dead_volume_l.annulus": 0.01,
            "cylinder.push.bore_mm": 500.0,
            "cylinder.push.rod_mm": 100.0,
        }
    )
    linear = linearize(machine, [0.05])
    assert linear.damping_ratios[0] == pytest.approx(zeta, rel=2e-3)
    alone = math.sqrt(kappa / 1300.0) / (2 * math.pi)
    assert linear.natural_frequencies[0] == pytest.approx(alone, rel=2e-3)


def test_nothing_damps_where_the_file_says_so() -> None:
    """`damped = false` leaves out the spring's own damping, too, and no frequency changes."""
    damped = rocking(more="damping_ratio = 0.1")
    undamped = damped.replace({"damped": False})
    q = off_middle(damped)
    assert linearize(damped, q).damping_ratios.min() > 1e-3
    linear = linearize(undamped, q)
    assert_allclose(linear.damping_ratios, 0, atol=1e-7)
    modes = natural_modes(damped.at(q)).frequencies[0]
    assert_allclose(linear.natural_frequencies, modes, rtol=1e-6)


@pytest.mark.slow
def test_two_masses_ring_as_by_hand() -> None:
    """Struck, slide and carriage ring with the two roots of the closed form, undamped."""
    machine = two_masses(3e6)
    expected = natural_modes(machine.at([0.0])).frequencies[0]  # closed form: test_springs
    run = simulate(
        machine, [0.0], {"push": lambda t: 0.0}, duration=3.0, rate=2000, velocity=[1e-3]
    )
    ringdown = identify_ringdown(run.time, run.spring_speeds[:, 0], modes=2)
    assert_allclose(np.sort(ringdown.natural_frequencies), expected, rtol=1e-4)
    assert run.energy_error < 1e-6


def test_energy_balances_with_springs_and_dampers() -> None:
    machine = rocking(more="damping_ratio = 0.1")
    run = simulate(
        machine, off_middle(machine), {"boom": ad.Step(size=0.3, begin=0.1, end=0.5)}, duration=2.0
    )
    assert run.energy_error < 1e-6
    assert np.ptp(run.springs) > 1e-4, "the carriage rocked"


def test_sweeps_find_the_modes_of_a_machine_on_springs(machine: ad.Machine) -> None:
    """The nonlinear model, swept, rings where K v = ω² M v says."""
    validation = validate(machine, off_middle(machine), cylinders=["boom"])
    assert validation.worst_deviation < 0.01


@pytest.mark.slow
def test_a_stiff_spring_moves_like_none() -> None:
    rigid = ideally_fed(ad.load("excavator_20t"))
    step = {"boom": ad.Step(size=0.3, begin=0.05, end=0.3)}
    q = off_middle(rigid)
    first, second = (
        simulate(m, q, step, duration=0.6) for m in (rigid, ideally_fed(rocking(stiffness=1e13)))
    )
    assert_allclose(second.q, first.q, atol=1e-5)
