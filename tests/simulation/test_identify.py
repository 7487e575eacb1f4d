"""Identified recordings: known rings under coloured noise, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter, lsim
from scipy.special import ellipk

import armdesign as ad
from armdesign.errors import SimulationError
from armdesign.report.recordings import identified_sheets
from armdesign.simulation.identification.windows import fast_line
from armdesign.simulation.simulate import simulate
from tests import machines
from tests.commands import assert_one_line, main
from tests.simulation.identification.test_coverage import swept

STEP = 0.01
CRANE = Path(__file__).parents[1] / "data" / "loader_crane_lift.csv"


def ring(
    duration: float = 4.0, frequency: float = 2.0, zeta: float = 0.02, size: float = 3.0
) -> tuple[np.ndarray, np.ndarray]:
    """Time [s] and a pressure [bar] that rings about a falling mean, in closed form."""
    time = np.arange(0, duration, STEP)
    omega = 2 * math.pi * frequency
    decay = np.exp(-zeta * omega * time) * np.cos(omega * math.sqrt(1 - zeta**2) * time + 0.5)
    return time, 70 - 0.8 * time + size * decay


def coloured(random: np.random.Generator, count: int, colour: float | str) -> np.ndarray:
    """Noise e_k = colour e_{k−1} + white, or with a spectrum in proportion to 1/f, of unit
    variance.
    """
    if colour == "1/f":
        lines = np.fft.rfftfreq(8 * count)
        lines[0] = math.inf
        spectrum = np.fft.rfft(random.normal(size=8 * count)) / np.sqrt(lines)
        noise = np.fft.irfft(spectrum)[:count]
        return np.asarray(noise / np.std(noise))
    colour, white = float(colour), random.normal(size=count + 200)
    return np.asarray(lfilter([math.sqrt(1 - colour**2)], [1, -colour], white)[200:])


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.05, 0.1])
@pytest.mark.parametrize("colour", [0.5, 0.9, 0.98, "1/f"])
def test_deviations_hold_under_coloured_noise(noise: float, colour: float | str) -> None:
    """100 recordings each, two deviations; the noise is a share of the ring's root mean square."""
    random, (time, clean) = np.random.default_rng(1), ring()
    size = noise * float(np.std(clean - np.polyval(np.polyfit(time, clean, 1), time)))
    held, ratios = np.zeros(2), []
    for _ in range(100):
        noisy = clean + size * coloured(random, len(time), colour)
        fit = ad.identify({"time_s": time, "boom_cap_bar": noisy}, [(0, 4)]).windows[0].fit
        errors = [fit.natural_frequencies[0] - 2, fit.damping_ratios[0] - 0.02]
        deviations = np.array([fit.frequency_deviations[0], fit.damping_deviations[0]])
        held += np.abs(errors) <= 2 * deviations
        ratios.append(np.abs(errors) / deviations)
    assert np.all(held >= 90)
    # not by being too large: the median error of a normal law is 0.67 deviations
    assert np.all(np.median(ratios, axis=0) > 0.3)


def test_a_recording_that_rings_from_begin_to_end() -> None:
    """Nothing in it is quiet, and its envelope is highest where it begins."""
    time, clean = ring(duration=6.0)
    identified = ad.identify({"time_s": time, "boom_cap_bar": clean})
    (begin, end) = identified.windows[0].begin, identified.windows[-1].end
    assert begin < 1.0
    assert end > 5.0
    assert identified.frame["frequency_hz"].to_numpy() == pytest.approx(2.0, rel=1e-3)
    with pytest.raises(SimulationError, match="holds 1 sample; give a row per instant"):
        ad.identify({"time_s": time[:1], "boom_cap_bar": clean[:1]})
    with pytest.raises(SimulationError, match="boom_cap_bar is constant"):
        ad.identify({"time_s": time, "boom_cap_bar": 0 * clean + 3})


def random_ring(random: np.random.Generator, periods: float) -> tuple[float, float, Any]:
    """Frequency, damping ratio and recording of a ring about a slope; noise of 0, 0.3 or 3 %."""
    frequency, zeta = np.exp(random.uniform(np.log([0.3, 0.005]), np.log([10, 0.3])))
    rate = max(100, 40 * frequency)
    time = np.arange(0, periods / frequency, 1 / rate)
    omega, phase = 2 * math.pi * frequency, random.uniform(0, 2 * math.pi)
    swing = np.cos(omega * math.sqrt(1 - zeta**2) * time + phase)
    clean = 3 * np.exp(-zeta * omega * time) * swing
    noise = random.choice([0, 0.003, 0.03]) * np.std(clean) * random.normal(size=len(time))
    slope = random.uniform(-3, 3) * time * frequency / periods
    return frequency, zeta, {"time_s": time, "boom_cap_bar": 70 + slope + clean + noise}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_window_of_less_than_two_periods_is_not_answered_wrongly(seed: int) -> None:
    """Its trend swallows the ring: before, one of five answered with a frequency of the noise.

    Where one is answered, it is right within its deviations; windows of 3 to 7 periods all are.
    """
    random = np.random.default_rng(seed)
    for periods in random.uniform(0.3, 1.9, size=15):
        frequency, zeta, columns = random_ring(random, periods)
        window = [(0.0, float(columns["time_s"][-1]))]
        try:
            fit = ad.identify(columns, window).windows[0].fit
        except SimulationError:
            continue
        assert abs(fit.natural_frequencies[0] - frequency) < 3 * fit.frequency_deviations[0]
        assert abs(fit.damping_ratios[0] - zeta) < 3 * fit.damping_deviations[0]
    for periods in random.uniform(3, 7, size=5):
        frequency, zeta, columns = random_ring(random, periods)
        fit = ad.identify(columns, [(0.0, float(columns["time_s"][-1]))]).windows[0].fit
        most = 4 * fit.frequency_deviations[0] + 1e-4 * frequency
        assert abs(fit.natural_frequencies[0] - frequency) < most


def test_what_is_no_free_decay_is_said() -> None:
    """A start, a motion and a stop in one window; a ring that grows; one beneath much noise."""
    time, first = ring(8.0, zeta=0.05)
    stop = np.where(time >= 4, ring(4.0, zeta=0.05)[1][np.arange(len(time)) % 400], 70)
    noise = np.random.default_rng(4).normal(size=len(time))
    omega = 2 * math.pi * 2
    for pressure, word, message in (
        (first + stop, "excited again", "its swing rises again about "),
        (70 + np.exp(0.02 * omega * time) * np.cos(omega * time), "grows", "it grows, as no free"),
        (first + 1.0 * noise, "large residual", "the fit leaves "),
    ):
        identified = ad.identify({"time_s": time, "boom_cap_bar": pressure}, [(0, 7.99)])
        assert word in identified.frame["remark"][0]
        assert any(message in line for line in identified.findings if line[:9] == "0–7.99 s:")
        assert word in identified_sheets(identified)[0].rows[0][4]
    decay = ad.identify({"time_s": time, "boom_cap_bar": first}, [(0, 7.99)])
    assert decay.frame["remark"].to_list() == [""]
    assert decay.findings == []


def test_a_window_beyond_the_recording_is_said() -> None:
    time, pressure = ring()
    identified = ad.identify({"time_s": time, "boom_cap_bar": pressure}, [(-5, 4)])
    assert "cut" in identified.frame["remark"][0]
    assert "the recording holds 0–3.99 s, not all of -5–4 s" in identified.findings[0]


def of(frequency: float, rate: float, duration: float, noise: float = 0.05) -> dict[str, Any]:
    """A free decay of 5 bar with ζ = 0.03."""
    time, random = np.arange(0, duration, 1 / rate), np.random.default_rng(0)
    omega = 2 * math.pi * frequency
    swing = 5 * np.exp(-0.03 * omega * time) * np.cos(omega * time)
    return {"time_s": time, "boom_cap_bar": 100 + swing + noise * random.normal(size=len(time))}


LARGE = {
    name: values * (1 if name == "time_s" else 1e200) for name, values in of(2, 50, 10).items()
}


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (of(20, 50, 10), r"no free decay of 3 periods between 0.3 and 6.2 Hz, where 50 samples"),
        (of(20, 50, 1), r"only 2.5 samples in a period .*about 20 Hz.*; record 8 .*, at 160 Hz"),
        (of(2, 50, 0.8), r"in 6 periods or more; 0.78 s hold 1.2 of .*; record longer"),
        (of(25, 200, 4), r"found up to 20 Hz; boom_cap_bar rings at about 24.8 Hz; give windows$"),
        (of(24, 50, 2), r"rings at about 24.1 Hz; record at 193 Hz, give windows$"),
        (of(2, 50, 10) | {"boom_cap_bar": np.full(500, np.nan)}, r"boom_cap_bar: fewer than two"),
        (of(2, 50, 10) | {"boom_cap_bar": np.r_[np.inf, np.arange(499)]}, "infinite at 0 s"),
        ({"time_s": [0.0], "boom_cap_bar": [80.0]}, "holds 1 sample; give a row per instant"),
        (of(2, 50, 10) | {"time_s": np.arange(500) * 20}, r"a sample every 20 s .*; .*time_ms"),
        (of(2, 50, 10) | {"time_s": np.arange(499) / 50}, r"bar holds 500 values, time_s 499;"),
        (LARGE, r"boom_cap_bar holds 1.*e\+202; give values in the unit of its name"),
    ],
)
def test_what_cannot_ring_is_told_with_its_cause(columns: dict[str, Any], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        ad.identify(columns)


@pytest.mark.parametrize("rate", [60, 200, 1000])
def test_noise_is_not_called_a_fast_ring(rate: int) -> None:
    """Its highest line lies anywhere."""
    for colour in (0.0, 0.9, -0.6):
        noise = coloured(np.random.default_rng(rate), 4 * rate, colour)
        assert fast_line(1 / rate, noise) is None


def test_the_motion_of_a_machine_is_told_beside_its_swings() -> None:
    time, pressure = ring(8.0)
    columns = {"time_s": time, "boom_cap_bar": pressure, "boom_length_mm": 900 + 10 * time}
    moving = ad.identify(columns, [(0, 7.99)])
    of_length = ad.identify({**columns, "boom_length_mm": 900 + 0.5 * time}, [(0, 7.99)])
    words = "the machine moves (boom_length_mm 900 to 979.9): its pose changes the frequency"
    assert moving.motion(*moving.windows) == words
    assert moving.plot().axes[2].get_title() == f"{words}, too"
    assert of_length.plot().axes[2].get_title() == ""


def test_found_windows_and_swings() -> None:
    pressure = ring(12.0, zeta=0.03)[1]
    before = np.full(200, pressure[0])
    columns = {"time_s": np.arange(1400) * STEP, "boom_cap_bar": np.append(before, pressure)}
    noisy = columns["boom_cap_bar"] + 0.01 * np.random.default_rng(2).normal(size=1400)
    identified = ad.identify({**columns, "boom_cap_bar": noisy})
    assert len(identified.windows) >= 2
    assert identified.windows[0].begin > 2.0
    ends = [end for window in identified.windows for end in (window.begin, window.end)]
    assert ends == pytest.approx(np.round(ends, 2), abs=1e-9)
    assert identified.frame["frequency_hz"].to_numpy() == pytest.approx(2.0, rel=0.01)
    assert identified.swings["amplitude"].is_monotonic_decreasing
    assert len(identified.plot().axes) == 3


def test_a_coarse_sensor_is_not_clipped() -> None:
    """Steps of 0.1 bar make flat peaks in closed form; they are no limit of the sensor."""
    time, pressure = ring()
    coarse = np.round(pressure / 0.1) * 0.1
    identified = ad.identify({"time_s": time, "boom_cap_bar": coarse}, [(0, 4)])
    assert identified.frame["frequency_hz"].to_numpy() == pytest.approx([2.0], rel=1e-3)
    assert identified.frame["damping_ratio"].to_numpy() == pytest.approx([0.02], rel=0.05)


def test_faults_of_recordings() -> None:
    time, pressure = ring()
    columns = {"time_s": time, "boom_cap_bar": pressure}

    def spoilt(**changes: np.ndarray) -> dict[str, np.ndarray]:
        return {**columns, **changes}

    gap, twice, back = time.copy(), time.copy(), time.copy()
    gap[150:] += 0.5
    twice[150:] -= STEP
    back[150] -= 5 * STEP
    blank = pressure.copy()
    blank[7] = np.nan
    for given, windows, message in (
        (spoilt(time_s=gap), [(0, 5)], "a gap of 0.51 s at 1.49 s"),
        (spoilt(time_s=twice), [(0, 4)], "the same time stamp twice, at 1.49 s"),
        (spoilt(time_s=back), [(0, 4)], "time steps back after 1.49 s"),
        (spoilt(boom_cap_bar=blank), [(0, 4)], "blank at 0.07 s"),
        (spoilt(boom_cap_bar=0 * time + 5), [(0, 4)], "constant"),
        (spoilt(boom_cap_bar=np.minimum(pressure, 71)), [(0, 4)], "clipped at 71"),
        (
            spoilt(boom_cap_bar=np.where(time < 1, pressure, pressure[100])),
            [(0, 4)],
            f"boom_cap_bar is stuck at {pressure[100]:g} from 1 s; choose another",
        ),
        (columns, [(0, 0.7)], "two periods"),
        (columns, [(9, 11)], "holds no samples"),
        (columns, [(3, 2)], "3:2 is no window"),
        (columns, [(0, 2, 4)], r"\(0, 2, 4\) is no window"),
        (columns, [2.0], "2.0 is no window"),
        (columns, [(0, 4), (0.0, 4.0)], "the window 0:4 is there twice; leave one out"),
        ({"time_s": time, "boom": pressure}, [(0, 4)], "no column is a pressure"),
        ({"boom_cap_bar": pressure}, [(0, 4)], "has no time"),
    ):
        with pytest.raises(SimulationError, match=message):
            ad.identify(given, windows)  # type: ignore[arg-type]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("rate", [100.0, 200.0, 1000.0])
def test_nothing_rings_on_a_trend(rate: float, degree: int) -> None:
    """Rounding of its numbers, 1e-14 of them, was answered as a ring of 2 to 150 Hz."""
    time = np.arange(0, 6, 1 / rate)
    with pytest.raises(SimulationError, match="a smooth trend, on which nothing rings"):
        ad.identify({"time_s": time, "boom_cap_bar": 100 + 3 * time**degree}, [(0.5, 1.5)])


def test_a_signal_that_cannot_be() -> None:
    time, pressure = ring()
    columns = {"time_s": time, "boom_cap_bar": pressure}
    with pytest.raises(SimulationError, match="boom_cap_bar is both the signal and its exc"):
        ad.identify(columns, signal="boom_cap_bar", excitation="boom_cap_bar")
    with pytest.raises(SimulationError, match='has no column "boom_cap"; did you mean'):
        ad.identify(columns, [(0, 4)], signal="boom_cap")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,a_bar\n0,1\n1,x\n", '"x" in line 3 is no number'),
        ("time_s,a_bar\n0,1,2\n", "3 fields in line 2"),
        ("time_s,a_bar\n", "holds no samples"),
        ("time_s,a_bar,a_bar\n0,1,2\n", "there twice"),
    ],
)
def test_faults_of_a_file(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "r.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SimulationError, match=message):
        ad.identify(file)
    with pytest.raises(SimulationError, match="cannot be read"):
        ad.identify(tmp_path / "none.csv")


# ------------------------------------------------------------------------------------ of machines


READ_OUT = {  # window [s]: frequency [Hz] by an independent fit, systematic error perhaps 0.5 %
    (1.9, 4.5): 2.195,
    (4, 7): 2.154,
    (6, 9): 2.120,
    (8, 11): 2.071,
    (10, 13): 2.007,
    (12, 15): 1.963,
}


def test_the_measured_crane() -> None:
    """PATU 655, figures read from published curves; ζ was read out as 0.017 to 0.020."""
    identified = ad.identify(CRANE, list(READ_OUT))
    frequencies = identified.frame["frequency_hz"].to_numpy()
    assert frequencies == pytest.approx(list(READ_OUT.values()), rel=0.005)
    assert identified.frame["damping_ratio"].between(0.015, 0.022).all()
    assert identified.frame["lift_length_mm"].iloc[0] == pytest.approx(958.5, abs=0.1)
    assert identified.warnings == (identified.warnings[0],)
    assert "lift_inclinometer_deg" in identified.warnings[0]
    # the rod side is open while the cylinder moves
    assert set(identified.pressures["verdict"].str[:40]) == {
        "the annulus pressure does not swing with"
    }


def test_a_simulated_ring_has_the_linear_frequency_and_the_ratio_of_trapped_oil() -> None:
    """Struck behind shut valves; the ratio in closed form, (A1/C1)/(A2/C2), within 1 %."""
    machine = machines.rigid("excavator_20t").replace({"damped": False})
    pose = np.array([0.3, -1.2, -0.5])
    modes = ad.natural_modes(machine.at(pose[None]))
    velocity = modes.shapes[0][:, 0] / np.abs(modes.shapes[0][:, 0]).max() * 1e-3
    run = simulate(machine, pose, {}, velocity=velocity, duration=6.0, rate=100.0)
    lengths = run.extensions + machine.closed_lengths
    columns = {"time_s": run.time}
    for i, name in enumerate(run.cylinders):
        columns[f"{name}_length_mm"] = 1e3 * lengths[:, i]
        columns[f"{name}_cap_bar"] = run.pressures[:, i, 0] / 1e5
        columns[f"{name}_rod_bar"] = run.pressures[:, i, 1] / 1e5
    identified = ad.identify(columns, [(0, 6)], machine=machine)
    assert identified.frame["frequency_hz"][0] == pytest.approx(modes.frequencies[0, 0], rel=1e-3)
    assert identified.windows[0].pose == pytest.approx(pose, abs=1e-4)
    assert len(identified.pressures) >= 1
    assert identified.pressures["ratio"].to_numpy() == pytest.approx(
        identified.pressures["trapped_ratio"].to_numpy(), rel=0.01
    )
    assert identified.pressures["phase_deg"].to_numpy() == pytest.approx(180, abs=1)
    assert identified.pressures["verdict"].str.endswith("in the ratio of trapped oil").all()


def test_large_swings_of_a_pendulum_ring_lower() -> None:
    """f(A) = f0 π/(2 K(sin A/2)), K the complete elliptic integral, for swings of 1.5 rad."""
    time, zeta, omega = np.arange(0, 12, STEP), 0.02, 2 * math.pi

    def rates(_t: float, y: np.ndarray) -> list[float]:
        return [y[1], -2 * zeta * omega * y[1] - omega**2 * math.sin(y[0])]

    motion = solve_ivp(rates, (0, 12), [1.5, 0.0], t_eval=time, rtol=1e-9, atol=1e-9).y
    noise = 1e-3 * np.random.default_rng(3).normal(size=len(time))
    identified = ad.identify(
        {"time_s": time, "swing": motion[0] + noise}, [(0, 12)], signal="swing"
    )
    pieces = identified.windows[0].swings
    assert pieces is not None
    exact = 1 / (2 / math.pi * ellipk(np.sin(pieces.amplitudes / 2) ** 2))
    assert pieces.frequencies == pytest.approx(exact, rel=0.01)
    assert pieces.frequencies[0] < 0.92 * pieces.frequencies[-1]
    assert pieces.change is not None
    assert "large swings ring lower" in identified.findings[0]


def test_the_answer_to_a_recorded_input() -> None:
    """An oscillator of 2 Hz and ζ = 0.05 under a sweep, exact for a linear input."""
    time, u, y = swept([(2.0, 0.05, 1.0)], band=(1.0, 3.0))
    columns = {"time_s": time, "spool": u, "boom_mm_per_s": y}
    identified = ad.identify(columns, excitation="spool", band=(1.0, 3.0))
    assert identified.signal == "boom_mm_per_s"
    assert identified.frame["frequency_hz"].to_numpy() == pytest.approx([2.0], rel=1e-3)
    assert identified.frame["damping_ratio"].to_numpy() == pytest.approx([0.05], rel=0.02)
    assert len(identified.plot().axes) == 1


@pytest.mark.parametrize("period", [math.inf, 1.7])
def test_an_input_may_stand_still_or_at_a_limit(period: float) -> None:
    """An oscillator of 2 Hz and ζ = 0.03 struck by the spool, once or again and again."""
    time = np.arange(0, 24, 0.01)
    spool = np.interp(np.fmod(time, period), [0, 0.1, 0.6, 0.7], [0, 0.05, 0.05, 0])
    omega = 2 * math.pi * 2.0
    speed = lsim(([omega**2], [1, 2 * 0.03 * omega, omega**2]), spool, time)[1]
    columns = {"time_s": time, "spool": spool, "boom_mm_per_s": speed}
    identified = ad.identify(columns, excitation="spool")
    assert identified.frame["frequency_hz"].to_numpy() == pytest.approx([2.0], rel=1e-3)
    assert identified.frame["damping_ratio"].to_numpy() == pytest.approx([0.03], rel=0.02)
    with pytest.raises(ad.ArmDesignError, match="spool is constant"):
        ad.identify(columns | {"spool": 0 * time}, excitation="spool")


def test_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, words = tmp_path / "out", ["identify", str(CRANE), "--windows", "1.9:4.5,14.9:15"]
    assert main([*words, "--out", str(out)], monkeypatch) == 0
    shown = capsys.readouterr().out
    assert "2.19" in shown
    assert "not fitted" in shown
    assert {path.name for path in out.iterdir()} == {
        "identified.csv",
        "swings.csv",
        "pressures.csv",
        "identified.png",
    }
    for wrong, message in (
        (["--windows", "3"], '"3" is no span'),
        (["--signal", "lift_cap"], 'did you mean "lift_cap_bar"?'),
        (["--machine", "nothing"], "nothing"),
        (["--windows", "100:101"], "holds no samples"),
        (["--modes", "0"], "modes"),
        (["--band", "1:3"], "a band is of the answer to an excitation; name the column"),
        (["--band", "3:1", "--excitation", "lift_cap_bar"], "3:1 is no band; give 0 < lowest"),
    ):
        none = tmp_path / "none"
        assert main(["identify", str(CRANE), *wrong, "--out", str(none)], monkeypatch) == 2
        assert_one_line(capsys.readouterr().err, message)
        assert not none.exists()


@pytest.mark.parametrize(("frequency", "answered"), [(6.0, True), (8.0, False), (14.0, False)])
def test_too_few_samples_in_a_period_are_named(frequency: float, answered: bool) -> None:
    """At 50 Hz, eight in a period up to 6.25 Hz: no longer window would help."""
    t, w = np.arange(0, 4, 0.02), 2 * math.pi * frequency
    noise = 0.1 * np.random.default_rng(0).standard_normal(len(t))
    recording = {"time_s": t, "p_bar": 100 + 5 * np.exp(-0.02 * w * t) * np.cos(w * t) + noise}
    if answered:
        window = ad.identify(recording, [(0.0, 4.0)]).windows[0]
        assert window.fit.natural_frequencies[0] == pytest.approx(frequency, rel=2e-3)
        return
    for windows in ([(0.0, 4.0)], []):
        with pytest.raises(
            SimulationError, match=f"samples in a period of p_bar .about {frequency:g}"
        ):
            ad.identify(recording, windows)
