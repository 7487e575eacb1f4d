"""Shapers: what they leave, beside published ones and beside oscillators that are struck."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import linprog

import armdesign as ad
from armdesign import Shaper


def rung(shaper: Shaper, frequency: float, damping: float) -> float:
    """Amplitude of an oscillator after all impulses over that after the last one's size at once.

    By its state: every impulse adds to its speed, between them it turns and decays.
    """
    omega = 2 * math.pi * frequency
    pole = complex(-damping, math.sqrt(1 - damping**2)) * omega
    state, last = 0j, 0.0
    for time, size in zip(shaper.times, shaper.amplitudes, strict=True):
        state = state * np.exp(pole * (time - last)) + size
        last = time
    return abs(state)


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.2])
@pytest.mark.parametrize("kind", [Shaper.zv, Shaper.zvd, Shaper.ei])
def test_residual_is_what_an_oscillator_rings_with(
    kind: Callable[..., Shaper], damping: float
) -> None:
    shaper = kind(1.3, damping)
    for frequency in (0.4, 1.0, 1.3, 1.9, 5.0):
        for ratio in (0.0, damping, 0.1):
            expected = rung(shaper, frequency, ratio)
            assert float(shaper.residual(frequency, ratio)) == pytest.approx(expected, abs=1e-12)
    assert shaper.amplitudes.sum() == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.2])
def test_formulas_of_the_theory(damping: float) -> None:
    """K = exp(−ζπ/√(1 − ζ²)): ZV [1, K]/(1 + K) at [0, T_d/2], ZVD [1, 2K, K²]/(1 + K)²; delays of
    a half, one and one period; ZVD's derivative vanishes, too.
    """
    decay = math.exp(-damping * math.pi / math.sqrt(1 - damping**2))
    period = 1 / (1.3 * math.sqrt(1 - damping**2))
    zv, zvd, ei = (kind(1.3, damping) for kind in (Shaper.zv, Shaper.zvd, Shaper.ei))
    np.testing.assert_allclose(zv.amplitudes, np.array([1, decay]) / (1 + decay), rtol=1e-14)
    squared = np.array([1, 2 * decay, decay**2]) / (1 + decay) ** 2
    np.testing.assert_allclose(zvd.amplitudes, squared, rtol=1e-14)
    np.testing.assert_allclose(zvd.times, [0, period / 2, period], rtol=1e-14)
    assert [zv.delay, ei.delay] == pytest.approx([period / 2, period], rel=1e-14)
    assert zv.residual(1.3) < 1e-14
    slope = (zvd.residual(1.3 * (1 + 1e-5)) - zvd.residual(1.3)) / 1e-5
    assert slope < 1e-3 < (zv.residual(1.3 * (1 + 1e-5)) - zv.residual(1.3)) / 1e-5
    assert float(ei.residual(1.3)) == pytest.approx(0.05, abs=1e-13)


def test_ei_without_tolerance_is_zvd() -> None:
    zvd, ei = Shaper.zvd(1.3, 0.1), Shaper.ei(1.3, 0.1, residual=0.0)
    np.testing.assert_allclose(ei.amplitudes, zvd.amplitudes, rtol=1e-14)
    np.testing.assert_allclose(ei.times, zvd.times, rtol=1e-14)


def test_published_widths_and_amplitudes() -> None:
    """Insensitivity at 5 % without damping 0.06, 0.29 and 0.40 (Singhose 2009, table of command
    shapers); EI [(1 + V)/4, (1 − V)/2, (1 + V)/4] (Singhose, Seering and Singer 1994).
    """
    zv, zvd, ei = (kind(2.0) for kind in (Shaper.zv, Shaper.zvd, Shaper.ei))
    widths = [shaper.insensitivity() for shaper in (zv, zvd, ei)]
    assert widths == pytest.approx([0.06, 0.29, 0.40], abs=0.005)  # the printed digits
    np.testing.assert_allclose(ei.amplitudes, [1.05 / 4, 0.95 / 2, 1.05 / 4], rtol=1e-14)
    assert zvd.insensitivity(0.01) < zvd.insensitivity(0.05) < zvd.insensitivity(0.2)
    assert ei.insensitivity(0.01) == 0.0


def test_the_width_goes_with_damping_without_leaps() -> None:
    """The hump beside an EI's frequency grows over its residual as damping does, by 0.4 % at 0.2;
    it leapt by half where that counted as too much.
    """
    widths = [Shaper.ei(2.0, zeta).insensitivity() for zeta in np.linspace(0.0, 0.2, 21)]
    assert np.abs(np.diff(widths)).max() < 0.02
    assert 0.4 < min(widths) < max(widths) < 0.6


def test_humps_are_the_published_ones() -> None:
    """Two humps: X = ∛(V²(√(1 − V²) + 1)), A1 = (3X² + 2X + 3V²)/16X, A2 = ½ − A1; three humps:
    A1 = (1 + 3V + 2√(2V(V + 1)))/16, A2 = (1 − V)/4 (Singhose, Porter, Tuttle and Singer 1997).
    """
    v = 0.05
    x = (v**2 * (math.sqrt(1 - v**2) + 1)) ** (1 / 3)
    first = (3 * x**2 + 2 * x + 3 * v**2) / (16 * x)
    two = Shaper.band(1.0, 1.9, residual=v)
    np.testing.assert_allclose(two.amplitudes[:2], [first, 0.5 - first], rtol=1e-12)
    first, second = (1 + 3 * v + 2 * math.sqrt(2 * v * (v + 1))) / 16, (1 - v) / 4
    three = Shaper.band(1.0, 2.4, residual=v)
    assert len(three.times) == 5
    np.testing.assert_allclose(three.amplitudes[:2], [first, second], rtol=1e-12)
    assert Shaper.band(1.0, 1.4).words.startswith("band of 3 impulses for 1 to 1.4 Hz: delay 0.8")


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.05, 0.1, 0.3])
@pytest.mark.parametrize("high", [1.0, 1.3, 2.0, 4.0, 10.0, 30.0])
def test_a_band_keeps_its_limit(high: float, damping: float) -> None:
    shaper = Shaper.band(1.0, high, damping, residual=0.03)
    frequency = np.linspace(1.0, high, 997)
    assert shaper.residual(frequency).max() <= 0.03 * (1 + 1e-4)
    assert shaper.worst_residual() <= 0.03 * (1 + 1e-9)
    assert shaper.amplitudes.min() > 0
    assert np.all(np.diff(shaper.times) > 0)


def test_however_wide_a_band_it_costs_little_more_than_a_period() -> None:
    """arcosh(1/V)/π periods of the lowest frequency, 1.174 for V = 5 % (Dolph's limit)."""
    limit = math.acosh(1 / 0.05) / math.pi
    delays = [Shaper.band(1.0, high).delay for high in (1.2, 2.0, 5.0, 20.0, 80.0)]
    assert delays == sorted(delays)
    assert delays[-1] < limit < 1.02 * delays[-1]
    assert limit == pytest.approx(1.174, abs=5e-4)


@pytest.mark.parametrize("damping", [0.01, 0.03, 0.1, 0.2, 0.5])
@pytest.mark.parametrize("high", [2.0, 10.0, 30.0])
def test_with_damping_a_band_costs_no_more_damped_periods(high: float, damping: float) -> None:
    """Weighted for the band's middle they cost up to twice as many, or kept no 5 % at all."""
    free, damped = Shaper.band(1.0, high), Shaper.band(1.0, high, damping)
    assert damped.delay * math.sqrt(1 - damping**2) <= 1.01 * free.delay
    limit = math.acosh(1 / 0.05) / math.pi
    assert damped.delay * math.sqrt(1 - damping**2) < 1.01 * limit


def test_no_other_shaper_of_the_same_delay_leaves_much_less() -> None:
    """A linear programme over impulses ≥ 0 on a grid ten times as fine; |V| by 48 directions,
    which are blind to 0.2 %.
    """
    shaper = Shaper.band(1.0, 1.8)
    top = 1 / shaper.times[1] - 1.0  # its band may be wider than asked for
    times = np.linspace(0, shaper.delay, 31)
    frequency = np.linspace(1.0, top, 60)
    turned = np.exp(2j * math.pi * frequency[:, None] * times)
    directions = np.exp(2j * math.pi * np.arange(48) / 48)
    rows = (turned[:, None, :] * directions[:, None]).real.reshape(-1, len(times))
    upper = np.hstack([rows, -np.ones((len(rows), 1))])
    sums = np.append(np.ones(len(times)), 0.0)[None]
    cost = np.append(np.zeros(len(times)), 1.0)
    best = linprog(cost, A_ub=upper, b_ub=np.zeros(len(rows)), A_eq=sums, b_eq=[1.0])
    assert best.success
    assert shaper.worst_residual(1.0, top) == pytest.approx(0.05, rel=1e-6)
    assert 0.85 * 0.05 < best.fun < 0.05


def test_two_modes_multiply() -> None:
    one, two = Shaper.zvd(1.0, 0.02), Shaper.zv(2.7, 0.05)
    both = one * two
    frequency = np.linspace(0.2, 6, 50)
    product = one.residual(frequency, 0.03) * two.residual(frequency, 0.03)
    np.testing.assert_allclose(both.residual(frequency, 0.03), product, atol=1e-13)
    assert both.delay == pytest.approx(one.delay + two.delay, rel=1e-14)
    assert both.name == "zvd × zv"
    assert (both.low, both.high) == (1.0, 2.7)
    assert "1 Hz and 2.7 Hz" in both.words


def test_the_width_for_two_modes_is_that_of_oscillators_that_err_alike() -> None:
    """Two oscillators that are struck, both slower or faster by one share, leave 5 % at most.

    No narrower than either alone: what the one leaves the other does not add to.
    """
    for kinds in ((Shaper.zvd, Shaper.zvd), (Shaper.zv, Shaper.ei)):
        one, two = (kind(f, 0.02) for kind, f in zip(kinds, (1.0, 1.35), strict=True))
        both, width = one * two, (one * two).insensitivity()
        share, ends = 1e-3, []
        for sign in (1, -1):
            errors = sign * np.arange(0.0, 1.0, share)
            left = [max(rung(both, f * (1 + e), 0.02) for f in (1.0, 1.35)) for e in errors]
            ends.append(abs(errors[int(np.argmax(np.array(left) > 0.05))]))
        assert width == pytest.approx(sum(ends), abs=2 * share)
        assert width > min(one.insensitivity(), two.insensitivity())


@pytest.mark.parametrize("ratios", [(0.3, 0.02), (0.02, 0.3)])
def test_every_mode_of_two_has_its_own_damping(ratios: tuple[float, float]) -> None:
    """Two oscillators, one well damped: neither rings on, and both may err a little.

    Judged by the damping of the other one, the first would have been left to ring with 11 %.
    """
    modes = (1.0, 2.5)
    both = Shaper.zvd(modes[0], ratios[0]) * Shaper.zvd(modes[1], ratios[1])
    pairs = list(zip(modes, ratios, strict=True))
    np.testing.assert_allclose(both.residual(modes, ratios), 0.0, atol=1e-12)
    for sign in (1, -1):
        left = [rung(both, f * (1 + 0.05 * sign), zeta) for f, zeta in pairs]
        assert max(left) < 0.05
    assert both.insensitivity() > 0.1
    assert both.of_lowest.damping == ratios[0]
    periods = both.delay * modes[0] * np.sqrt(1 - ratios[0] ** 2)
    assert f"{periods:.3g} periods" in both.words


def test_a_curve_has_the_damping_of_the_nearest_mode() -> None:
    """What is read off the picture about either mode is what is left to ring there; by the least
    damping of all, the curve stood at 11 % where nothing is left.
    """
    modes, ratios = (1.0, 2.5), (0.3, 0.02)
    both = Shaper.zvd(modes[1], ratios[1]) * Shaper.zvd(modes[0], ratios[0])
    ax = both.plot()
    frequency, left = np.array(ax.get_lines()[0].get_data())
    for mode, ratio in zip(modes, ratios, strict=True):
        for f in (0.9 * mode, mode, 1.1 * mode):
            expected = 100 * rung(both, f, ratio)
            assert np.interp(f, frequency, left) == pytest.approx(expected, abs=0.05)
    words = ax.get_legend_handles_labels()[1]
    assert "damping of the nearest mode" in words[0]
    alike = (Shaper.zv(1.0, 0.02) * Shaper.zv(2.5, 0.02)).plot()
    assert "nearest" not in alike.get_legend_handles_labels()[1][0]


def test_a_shaped_command_is_a_convolution() -> None:
    """A ramp after ZV is the mean of two ramps; both ends are kept."""
    shaper = Shaper.zv(1.0)
    times = np.array([0.0, 1.0])
    at = np.linspace(-0.5, 2.5, 301)
    shaped = shaper.shaped(times, np.array([[0.0], [2.0]]), at)[:, 0]
    expected = np.clip(at, 0, 1) + np.clip(at - 0.5, 0, 1)
    np.testing.assert_allclose(shaped, expected, atol=1e-14)
    assert Shaper.none().words == "none"
    assert Shaper.none().residual(3.0) == 1.0
    assert Shaper.none().insensitivity() == 0.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Shaper.zv(0.0), "shaper zv: 0 Hz is no frequency; give a positive one"),
        (lambda: Shaper.zvd(math.nan), "shaper zvd: nan Hz is no frequency"),
        (lambda: Shaper.zvd(1.0, 1.0), r"damping ratio 1 is not in \[0, 1\); give 0.02"),
        (lambda: Shaper.ei(1.0, 0.02, 1.5), r"shaper ei: residual 1.5 is not in \[0, 1\)"),
        (lambda: Shaper.ei(1.0, 0.6), "shaper ei: damping 0.6 leaves no 5 % to tolerate"),
        (lambda: Shaper.zvd(1.0).residual(1.0, 2.0), r"zvd: damping ratio 2 is not in \[0, 1\)"),
        (lambda: Shaper.band(2.0, 1.0), "shaper band: 1 Hz is below 2 Hz; swap them"),
        (lambda: Shaper.band(1.0, 1e4), "more than 200 impulses; narrow the band"),
        (
            lambda: Shaper.band(1.0, 35.0, 0.01, 1e-4),
            "none keeps 0.01 % from 1 to 35 Hz at ζ = 0.0",
        ),
    ],
)
def test_faults(make: Callable[[], Shaper], message: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=message):
        make()


@pytest.mark.parametrize(
    ("times", "amplitudes", "message"),
    [
        ([0.0, 0.5], [1.0], "shaper own: times and amplitudes are not of one length"),
        ([0.5, 0.0], [0.5, 0.5], "shaper own: times do not ascend from 0; sort them"),
        ([0.0, 0.5], [1.0, 1.0], "amplitudes of sum 2 are not positive ones of sum 1; divide"),
        ([0.0, 0.5], [1.5, -0.5], "amplitudes of sum 1 are not positive ones"),
    ],
)
def test_a_shaper_of_ones_own(times: list[float], amplitudes: list[float], message: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=message):
        Shaper(times=times, amplitudes=amplitudes, name="own", low=1.0, high=1.0)
    own = Shaper(times=[0.0, 0.5], amplitudes=[0.5, 0.5], name="own", low=1.0, high=1.0)
    assert own.residual(1.0) < 1e-15
    with pytest.raises(ValueError, match="read-only"):
        own.amplitudes[0] = 1.0


def test_a_map_makes_a_shaper_for_all_its_poses_and_loads() -> None:
    machine = ad.load("mini_excavator_2t")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=5))
    shaper = ad.workspace_shaper(frequencies, damping=0.02)
    left = shaper.residual(frequencies.frame["f1_hz"].to_numpy())
    assert left.max() <= 0.05
    assert shaper.residual(frequencies.worst.frequency) <= 0.05
    both = ad.workspace_shaper(frequencies, damping=0.02, modes=2)
    assert both.residual(frequencies.frame[["f1_hz", "f2_hz"]].to_numpy()).max() <= 0.05
    assert shaper.delay < both.delay < 1.5 / frequencies.worst.frequency


def test_none_is_the_one_of_products() -> None:
    one, none = Shaper.zv(1.0, 0.02), Shaper.none()
    assert (none * one).words == (one * none).words == one.words
    assert (none * none).words == "none"
