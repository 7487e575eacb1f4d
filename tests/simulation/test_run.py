"""What a run rings with after its commands, and its columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign.errors import SimulationError
from armdesign.simulation.run import Ring
from armdesign.simulation.simulate import simulate
from armdesign.units import bar
from tests.sprung import rocking

SPREAD, HARD = (0.42, -1.79, -0.63), (0.3, -1.2, -1.0)


def stopped(pose: tuple[float, float, float], size: float) -> ad.Simulation:
    """The 20 t machine as shipped, empty, after a boom-up of a second and a stop."""
    up = {"boom": ad.Step(size=size, begin=0.1, end=1.1)}
    machine = ad.load("excavator_20t")
    return simulate(machine, pose, up, payload="empty", duration=7.0, tolerance=1e-7)


@pytest.mark.slow
def test_a_stop_rings_at_the_linear_frequency_or_says_what_cavitated() -> None:
    """Issue 13: within 1 % of the linear frequency of the pose, which is the arm's where it
    stands in the end; else the chambers are named that ran empty, by their pressures.
    """
    soft, hard = (stopped(*case).ring() for case in ((SPREAD, 0.02), (HARD, 0.3)))
    assert soft.cavitated == ()
    assert soft.fit.natural_frequencies[0] == pytest.approx(soft.linear_frequencies[0], rel=0.01)
    assert hard.fit.natural_frequencies[0] < 0.9 * hard.linear_frequencies[0]
    assert any(words.startswith("boom's annulus cavitated between") for words in hard.cavitated)
    assert all(words in hard.words for words in hard.cavitated)


@pytest.mark.slow
def test_the_window_begins_when_the_spools_rest() -> None:
    """The valve is shut at 1.1 s; its spool, 10 Hz with ζ 0.8, lags by some 0.1 s. The linear
    answer belongs to the mean pose in the window.
    """
    run = stopped(SPREAD, 0.02)
    ring = run.ring()
    assert 1.1 < ring.begin < 1.25
    assert ring.end == run.time[-1] == 7.0
    later = run.time >= ring.begin
    poses = ad.load("excavator_20t").at(run.q[later].mean(axis=0))
    np.testing.assert_allclose(
        ring.linear_frequencies, ad.natural_modes(poses).frequencies[0], rtol=1e-12
    )
    given = run.ring(2.0, 6.0, modes=1)
    assert (given.begin, given.end) == (2.0, 6.0)
    frame = run.frame
    assert list(frame.columns[:6]) == [
        "time_s", "boom_deg", "stick_deg", "bucket_deg", "boom_cap_bar", "boom_annulus_bar",
    ]  # fmt: skip
    np.testing.assert_allclose(np.radians(frame["stick_deg"]), run.q[:, 1], rtol=1e-14)
    np.testing.assert_array_equal(frame["boom_cap_bar"], run.pressures[:, 0, 0] / bar)
    boom = run.machine.cylinders[0]
    force = run.pressures[:, 0] @ (boom.bore_area, -boom.annulus_area)
    length = 1e-3 * frame["boom_pin_to_pin_mm"].to_numpy()
    yields = boom.closed_length + run.extensions[:, 0] - boom.compliance * force
    np.testing.assert_allclose(length, yields, atol=1e-4)  # dry friction: 1e-5 m


def test_a_ring_is_heard_in_springs_too() -> None:
    """A carriage's rocking can be most of it: the joints alone fitted another mode elsewhere."""
    up = {"boom": ad.Step(size=0.1, end=0.5)}
    run = ad.simulate(rocking().with_payload("full"), (0.5, -1.8, -0.6), up, duration=8)
    ring = run.ring()
    assert ring.fit.amplitudes.shape == (1, run.velocity.shape[1] + run.spring_speeds.shape[1])
    assert ring.fit.natural_frequencies[0] == pytest.approx(ring.linear_frequencies[0], rel=0.03)


@pytest.mark.slow
def test_a_joint_that_friction_holds_does_not_count_in_a_ring() -> None:
    """What creeps without noise explains itself alone: it fitted 2.93 Hz in place of the swing."""
    run = stopped(SPREAD, 0.02)
    velocity = run.velocity.copy()
    velocity[:, 2] = -1.8e-4 * (1 + 5e-3 * np.exp(-run.time / 1.1))
    ring = replace(run, velocity=velocity).ring()
    assert ring.fit.natural_frequencies[0] == pytest.approx(ring.linear_frequencies[0], rel=0.05)
    assert ring.doubts == ()


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane"])
def test_a_machine_at_rest_rings_with_nothing(name: str) -> None:
    """Before, it answered with 0.978 and 36.2 Hz from creep and rounding."""
    machine = ad.load(name)
    run = simulate(machine, machine.ranges.mean(axis=1), {}, duration=2.0)
    with pytest.raises(SimulationError, match=r"ring: nothing rings: speeds swing by .*; move"):
        run.ring()


def test_faults_of_rings() -> None:
    machine = ad.load("paper_1dof")
    run = simulate(machine, [0.0], {"lift": lambda _: 0.01}, duration=2e-3, rate=5000)
    with pytest.raises(SimulationError, match="ring: a spool moves to the end; end its command"):
        run.ring()
    with pytest.raises(SimulationError, match=r"ring: 3…4 s holds no two .*; stay in 0…0\.002 s"):
        run.ring(3.0, 4.0)


def test_a_ring_says_what_its_modes_leave_and_damping_below_zero() -> None:
    """By hand: a sine that grows by ζ = −0.01 beside noise of three tenths of its size."""
    time, rng = np.arange(0, 4, 0.01), np.random.default_rng(0)
    omega = 2 * np.pi * 2.0
    grown = np.exp(0.01 * omega * time) * np.cos(omega * time)
    noisy = grown + 0.3 * grown.std() * rng.normal(size=len(time))
    fits = [ad.identify_ringdown(time, signal) for signal in (noisy, np.cos(omega * time))]
    linear = np.array([2.0])
    rings = [
        Ring(begin=0.0, end=4.0, fit=fit, linear_frequencies=linear, cavitated=()) for fit in fits
    ]
    left, below = rings[0].doubts
    assert "% of the motion is none of the modes found" in left
    assert below.startswith("a damping ratio of -0.01")
    assert "is of modes not told apart" in below
    assert left in rings[0].words
    assert rings[1].doubts == ()


def test_a_motion_that_friction_stops_is_no_ring() -> None:
    """Dry friction holds a crane struck at 0.1 mm/s: it creeps to rest, without a swing."""
    machine = ad.load("loader_crane").with_payload("full")
    q = machine.ranges.mean(axis=1)
    shape = ad.natural_modes(machine.at(q)).shapes[0][: len(q), 0]
    run = simulate(
        machine,
        q,
        {machine.cylinders[0].name: lambda time: 0.0},
        payload="full",
        duration=3.0,
        velocity=1e-4 * shape / np.abs(shape).max(),
    )
    with pytest.raises(SimulationError, match=r"no ring but a creep or a stop: .* strike harder"):
        run.ring()
