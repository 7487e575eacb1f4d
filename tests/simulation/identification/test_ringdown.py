"""Modes of free decays: closed forms, Monte Carlo, struck machines against linear modes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import armdesign as ad
from armdesign import identify_ringdown
from armdesign.errors import SimulationError
from armdesign.simulation.experiment import Experiment
from armdesign.simulation.identification.decaying_modes import Noise, fit_modes
from armdesign.simulation.linearization import linearize
from armdesign.simulation.run import Simulation
from armdesign.simulation.simulate import simulate
from tests import machines

WORST = (1.154, -1.199, -2.191)


def decay(time: np.ndarray, modes: list[tuple[float, float, float]]) -> np.ndarray:
    """Σ g exp(−ζωt) cos(ω√(1 − ζ²) t): the closed form."""
    total = np.zeros_like(time)
    for frequency, zeta, gain in modes:
        omega = 2 * math.pi * frequency
        total += (
            gain * np.exp(-zeta * omega * time) * np.cos(omega * math.sqrt(1 - zeta**2) * time)
        )
    return total


@pytest.mark.parametrize(("stands", "trend"), [(0.0, -1), (5.3, 0), (0.0, 2)])
def test_an_output_that_stands_changes_no_answer(stands: float, trend: int) -> None:
    """As of a joint that friction holds."""
    time = np.arange(0, 8, 1 / 50)
    rings = decay(time, [(1.5, 0.02, 1.0)]) + np.random.default_rng(1).normal(size=400) / 100
    both = np.stack([rings, np.full(400, stands)], axis=1)
    alone, found = (identify_ringdown(time, one, trend=trend) for one in (rings, both))
    for name in ("natural_frequencies", "damping_ratios", "frequency_deviations", "residual"):
        assert getattr(found, name) == pytest.approx(getattr(alone, name), rel=1e-6)
    assert found.amplitudes[0] == pytest.approx([*alone.amplitudes[0], 0.0])
    assert found.fitted[:, 1] == pytest.approx(stands)
    with pytest.raises(SimulationError, match="nothing moves"):
        identify_ringdown(time, both[:, 1], trend=trend)


def test_decay_of_known_modes() -> None:
    time = np.arange(0, 12, 1 / 60)
    modes = [(0.9, 0.01, 1.0), (1.3, 0.05, 0.4), (6.0, 0.0, 0.1)]
    ringdown = identify_ringdown(
        time, np.stack([decay(time, modes), decay(time, modes[:2])], axis=1), modes=3
    )
    assert ringdown.natural_frequencies == pytest.approx([0.9, 1.3, 6.0], rel=1e-9)
    assert ringdown.damping_ratios == pytest.approx([0.01, 0.05, 0.0], abs=1e-9)
    np.testing.assert_allclose(ringdown.amplitudes, [[1, 1], [0.4, 0.4], [0.1, 0]], atol=1e-9)
    assert ringdown.singular_values[6] < 1e-9 * ringdown.singular_values[5]
    noisy = decay(time, modes[:2]) + 0.01 * np.random.default_rng(2).normal(size=len(time))
    ringdown = identify_ringdown(time, noisy, modes=2)
    assert ringdown.natural_frequencies == pytest.approx([0.9, 1.3], rel=2e-3)
    assert ringdown.residual < 0.05


@pytest.mark.parametrize("asked", [1, 2, 3])
def test_two_modes_near_each_other_are_told_apart_however_many_are_asked_for(asked: int) -> None:
    """Six modes in six outputs, the lowest two 6 % apart, in four seconds: the closed form, which
    a little noise keeps from being exact. Tried one by one, no mode more makes it likelier.
    """
    time, rng = np.arange(0, 4, 0.005), np.random.default_rng(1)
    known = [(2.197, 0.0016, 1.0), (2.326, 0.0088, 0.7), (4.05, 0.011, 0.5), (12.7, 0.007, 0.2)]
    known += [(20.9, 0.005, 0.2), (31.9, 0.004, 0.1)]
    gains = rng.normal(size=(len(known), 6))
    signals = sum(np.outer(decay(time, [one]), row) for one, row in zip(known, gains, strict=True))
    found = identify_ringdown(time, signals + 1e-4 * rng.normal(size=(len(time), 6)), modes=asked)
    truth = np.array([[frequency, zeta] for frequency, zeta, _ in known])
    own = np.abs(truth[:, 0] - found.natural_frequencies[:, None]).argmin(axis=1)
    assert len(set(own)) == asked
    assert found.natural_frequencies == pytest.approx(truth[own, 0], rel=1e-4)
    assert found.damping_ratios == pytest.approx(truth[own, 1], abs=1e-4)
    assert found.residual < 0.01


def test_faults_of_decays() -> None:
    time = np.arange(0, 12, 1 / 60)
    with pytest.raises(SimulationError, match="nothing moves"):
        identify_ringdown(time, 0 * time)
    with pytest.raises(SimulationError, match="7 records are too few"):
        identify_ringdown(time[:7], time[:7])
    with pytest.raises(SimulationError, match="holds no mode, not 1; choose a longer"):
        identify_ringdown(time, np.exp(-time) + 0.2 * np.exp(-3 * time))
    swing = decay(time, [(2.0, 0.01, 1.0)])
    with pytest.raises(SimulationError, match="holds no mode, not 1; give trend=0"):
        identify_ringdown(time, 50 + swing)
    assert identify_ringdown(time, 50 + swing, trend=0).natural_frequencies == pytest.approx(2.0)


def test_what_hardly_turns_is_no_mode() -> None:
    """An offset from zero, ten times as large as what rings."""
    time, ring, still = np.arange(800), 0.1 * (1j - 0.001), 1e-6 * (1j - 1)
    signals = (np.exp(ring * time).real + 10)[:, None]
    fit = fit_modes(signals, np.array([still, ring]), Noise(len(time), np.zeros(0)))
    assert fit.rings.tolist() == [False, True]
    assert fit.strongest(1).tolist() == [1]


@pytest.mark.slow
def test_one_sigma_of_a_decay_holds_68_percent() -> None:
    """Monte Carlo, 300 records of two modes in two answers: the normal law's shares, ± 3 binomial
    deviations.
    """
    random, count = np.random.default_rng(5), 300
    time, mix = np.arange(0, 12, 1 / 40), np.array([[1.0, 0.5], [0.6, -0.7]])
    clean = (
        np.stack([decay(time, [mode]) for mode in ((0.9, 0.01, 1.0), (1.3, 0.02, 1.0))], axis=1)
        @ mix
    )
    inside = np.zeros((2, 4))
    for _ in range(count):
        ringdown = identify_ringdown(time, clean + 0.03 * random.normal(size=clean.shape), modes=2)
        errors = np.abs(
            [
                *(ringdown.natural_frequencies - [0.9, 1.3]),
                *(ringdown.damping_ratios - [0.01, 0.02]),
            ]
        )
        deviations = np.array([*ringdown.frequency_deviations, *ringdown.damping_deviations])
        inside += errors < deviations * np.array([[1.0], [2.0]])
    for share, row in zip((0.683, 0.954), inside / count, strict=True):
        assert row == pytest.approx(
            np.full(4, share), abs=3 * math.sqrt(share * (1 - share) / count)
        )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "modes"), [("paper_1dof", 1), ("excavator_20t", 3), ("slewing", 4)]
)
def test_struck_the_arm_rings_in_its_linear_modes(name: str, modes: int) -> None:
    """Shut in, from a speed of every mode: frequencies of the linear plant, energy kept, the mean
    pose, too.

    The strike of mode i has the largest joint swing of 1e-4 rad, so that geometry hardly changes.
    """
    machine = machines.named(name).replace({"damped": False})
    pose = np.array(
        {"paper_1dof": [0.0], "excavator_20t": WORST}.get(name, [0.3, 0.2, -1.2, -0.5])
    )
    natural = ad.natural_modes(machine.at(pose))
    shapes = natural.shapes[0] / np.abs(natural.shapes[0]).max(axis=0)
    velocity = shapes @ (1e-4 * 2 * math.pi * natural.frequencies[0])
    rate, duration = 16 * natural.frequencies[0, -1], 8 / natural.frequencies[0, 0]
    run = simulate(
        machine, pose, {}, velocity=velocity, duration=duration, rate=rate, tolerance=1e-9
    )
    np.testing.assert_array_equal(run.velocity[0], velocity)
    assert run.energy_error < 1e-4
    assert np.ptp(run.supplied) == np.ptp(run.dissipated) == 0
    decayed = identify_ringdown(run.time, run.velocity, modes=modes)
    assert decayed.natural_frequencies == pytest.approx(natural.frequencies[0], rel=1e-3)
    assert decayed.damping_ratios == pytest.approx(np.zeros(modes), abs=1e-3)


class RaisedCosine:
    """A pulse of a height within a duration [s], then 0: oil shut in, the arm rings freely."""

    def __init__(self, height: float, duration: float) -> None:
        self.height, self.breakpoints = height, (0.0, duration)

    def __call__(self, time: float) -> float:
        share = time / self.breakpoints[1]
        return self.height * (0.5 - 0.5 * math.cos(2 * math.pi * share)) if 0 < share < 1 else 0.0


@pytest.fixture(scope="module")
def rung() -> dict[str, tuple[Experiment, Simulation]]:
    """Both machines after a short pulse of one valve."""
    fits = {}
    for name, pose in (("paper_1dof", [0.0]), ("excavator_20t", WORST)):
        machine = ad.load(name).replace({"damped": False})
        machine = machine.with_payload("full") if name == "excavator_20t" else machine
        one = Experiment.of(machine, np.array(pose), 0, 0)
        pulse = RaisedCosine(one.default_amplitude() / 4, 0.2 / one.rest.frequencies.max())
        run = simulate(
            machine,
            pose,
            one.commands(pulse),
            duration=8 / one.target,
            rate=one.rate,
            tolerance=1e-9,
        )
        fits[name] = one, run
    return fits


@pytest.mark.slow
@pytest.mark.parametrize(("name", "modes"), [("paper_1dof", 1), ("excavator_20t", 3)])
def test_plant_rings_in_its_linear_modes(
    rung: dict[str, tuple[Experiment, Simulation]], name: str, modes: int
) -> None:
    """All modes from one pulse of one valve, without damping: oil shut in."""
    one, run = rung[name]
    # the spools are shut again: 10 Hz, ζ = 0.8
    late = run.time > 2 / 10 + 0.2 / one.rest.frequencies.max()
    ringdown = identify_ringdown(run.time[late], run.speeds[late], modes=modes)
    linear = linearize(one.rest.machine, one.rest.pose)
    assert ringdown.natural_frequencies == pytest.approx(linear.natural_frequencies, rel=2e-3)
    assert ringdown.damping_ratios == pytest.approx(linear.damping_ratios, abs=2e-3)
