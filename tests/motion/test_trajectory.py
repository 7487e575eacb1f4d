"""Shaping in the phase of a mode whose frequency changes along the way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armdesign as ad
from armdesign.motion.time_law import TimeLaw
from armdesign.motion.trajectory import Leg, Trajectory, trajectory


def trapezium(rise: float, hold: float) -> TimeLaw:
    """Speed up, go on, slow down."""
    top = 1 / (rise + hold)
    sigma = [0.0, top * rise / 2, 1 - top * rise / 2, 1.0]
    times = [0.0, rise, rise + hold, 2 * rise + hold]
    return TimeLaw(np.array(times), np.array(sigma), np.array([0.0, top, top, 0.0]))


def unit_leg(law: TimeLaw) -> Leg:
    """One joint from 0 to 1, which asks for no oil."""
    return Leg(np.zeros(1), np.ones(1), law, np.zeros(2))


def left(planned: Trajectory, frequency: np.ndarray) -> float:
    """Amplitude of z after z̈ = ω²(σ) (σ − z), ω by the frequency at even shares of the way."""
    shares = np.linspace(0, 1, len(frequency))

    def rates(time: float, state: np.ndarray) -> list[float]:
        sigma = float(np.interp(time, planned.time, planned.q[:, 0]))
        omega = 2 * np.pi * np.interp(sigma, shares, frequency)
        return [state[1], omega**2 * (sigma - state[0])]

    span = (0.0, planned.duration)
    end = solve_ivp(rates, span, [0.0, 0.0], rtol=1e-9, atol=1e-11, max_step=0.01).y[:, -1]
    return float(np.hypot(end[0] - 1, end[1] / (2 * np.pi * frequency[-1])))


@pytest.mark.parametrize(("kind", "most"), [("zv", 0.06), ("zvd", 0.025)])
@pytest.mark.parametrize("start", [1.36, 0.75])
def test_a_mode_that_changes_on_the_way(kind: str, most: float, start: float) -> None:
    """By integrating an oscillator: in its phase far less is left than in time.

    Of what a step of its acceleration would leave, a/ω². First-order changes of amplitude along
    the way remain of ZV (4 and 6 %), second-order ones of ZVD (1 and 2 %).
    """
    frequency, law = 1.34 * np.array([start, 1.0]), trapezium(0.3, 1.4)
    leg = unit_leg(law)
    shaper = getattr(ad.Shaper, kind)(frequency[-1])
    step = law.speed.max() / 0.3 / (2 * np.pi * frequency[-1]) ** 2
    in_time = left(trajectory([leg], shaper), frequency)
    in_phase = left(trajectory([leg], shaper, [frequency[None] / frequency[-1]]), frequency)
    assert in_phase < most * step
    assert in_phase < 0.1 * in_time


def test_two_modes_each_in_its_phase() -> None:
    """The lowest mode, shaped last, is as well served as alone; the other one not much worse."""
    frequencies = np.array([[1.82, 1.34], [3.9, 2.6]])
    leg = unit_leg(trapezium(0.3, 1.4))
    shaper = ad.Shaper.zvd(1.34) * ad.Shaper.zvd(2.6)
    planned = trajectory([leg], shaper, [frequencies / frequencies[:, -1:]])
    unshaped = trajectory([leg], ad.Shaper.none())
    for frequency, most in zip(frequencies, (0.003, 0.02), strict=True):
        assert left(planned, frequency) < most * left(unshaped, frequency)


def test_a_pace_of_one_shapes_in_time() -> None:
    """Position and speed are those of the convolution; the delay is the shaper's."""
    leg, shaper = unit_leg(trapezium(0.3, 0.9)), ad.Shaper.ei(1.5, 0.03)
    planned = trajectory([leg], shaper, [np.ones((1, 2))])
    assert planned.duration == pytest.approx(leg.law.duration + shaper.delay)
    late = np.maximum(planned.time[:, None] - shaper.times, 0)
    expected = [
        (leg.law.at(t)[0] @ shaper.amplitudes, leg.law.at(t)[1] @ shaper.amplitudes) for t in late
    ]
    np.testing.assert_allclose(planned.q[:, 0], np.array(expected)[:, 0], atol=2e-5)
    np.testing.assert_allclose(planned.velocity[:, 0], np.array(expected)[:, 1], atol=3e-3)


def test_a_slower_mode_takes_longer() -> None:
    """A pace of a half all the way doubles the delay."""
    leg, shaper = unit_leg(trapezium(0.3, 0.9)), ad.Shaper.zvd(1.5)
    planned = trajectory([leg], shaper, [np.full((1, 2), 0.5)])
    assert planned.duration == pytest.approx(leg.law.duration + 2 * shaper.delay)
