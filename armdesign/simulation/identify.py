"""Recordings of machines, identified: frequency and damping of every window that rings.

Each window holds a ring-down over a polynomial (``identification/ringdown.py``), or the answer to
a recorded excitation (``identification/modal_fit.py``). Beside them stand what the pose was, how
frequency and damping depend on the swing, and whether both chambers swing as trapped oil must.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array
from armdesign.errors import ArmDesignError, SimulationError, raise_together
from armdesign.hydraulics.actuator import SIDES
from armdesign.machine.machine import Machine
from armdesign.machine.measured_poses import INCLINOMETER, inclined
from armdesign.simulation.identification.column_names import (
    KINDS,
    PRESSURES,
    means_of,
    sides_of,
    strongest_column,
    unit_of,
)
from armdesign.simulation.identification.decaying_modes import detrended
from armdesign.simulation.identification.modal_fit import identify_forced_response
from armdesign.simulation.identification.pressure_ratio import PressureRatio, pressure_ratio
from armdesign.simulation.identification.recording import Recording, read_recording, recording_of
from armdesign.simulation.identification.ringdown import Ringdown, identify_ringdown
from armdesign.simulation.identification.swings import Swings, swings
from armdesign.simulation.identification.windows import (
    HIGHEST,
    fast_line,
    found_windows,
    refuse_slow_sampling,
    stated_windows,
    strongest,
    strongest_beyond,
)
from armdesign.simulation.identification.windows import PER_PERIOD as FEWEST_SAMPLES
from armdesign.simulation.identified import Identified, IdentifiedWindow
from armdesign.simulation.recorded_poses import with_pose
from armdesign.units import bar

SHORT, TRENDS = 4.0, (2, 4)  # periods below which a trend has the lower degree
DOMINATES = 3.0  # ratio of spectral lines

NOTABLE = 0.2  # of the largest pressure swing
PERIODS = 2.0  # fewest in a window
ROUNDING = 1e-9  # of the largest value: less than any instrument resolves
PER_PERIOD = 40  # samples that are enough; more are averaged
SURE = 2.0  # deviations by which a ring grows
BEYOND = 1.3  # of the largest swing: no mode that decays alone has so much
LEFT = 0.3  # of the root mean square about the trend: a large residual
BAND = 1.6  # default ends of a band, relative to the strongest frequency


@checked
def identify(
    recording: str | Path | Recording | Mapping[str, Any],
    windows: Sequence[tuple[float, float]] = (),
    *,
    signal: str = "",
    modes: int = 1,
    excitation: str = "",
    band: tuple[float, float] | None = None,
    machine: Machine | None = None,
) -> Identified:
    """Frequencies and damping ratios, with deviations, of what a recorded machine rings with.

    Deviations hold noise, white or coloured, what noise may hide, and what likely fits differ by
    (``identify_ringdown``); errors by nonlinearity are not in them, but ``swings`` shows them.

    Args:
        recording: a CSV file (see ``Recording``'s module), or columns by name, time among them.
        windows: begin and end [s] of each; none: they are found.
        signal: column to fit: a pressure, speed or acceleration; none: the pressure that rings
            most, or if there is none the speed, or the acceleration.
        modes: how many modes a window holds.
        excitation: column of a recorded input, to which the signal is the answer; none: windows
            hold free decays.
        band: lowest and highest frequency [Hz] of a forced response; None: about the strongest.
        machine: whose pin-to-pin lengths and pressures the columns name, to tell poses and the
            expected ratio of pressures.

    Raises:
        SimulationError: a file or column that cannot be used, or no window that can be fitted.

    Example:
        >>> import numpy as np, armdesign as ad
        >>> time = np.arange(0, 5, 0.01)
        >>> pressure = 80 - time + 3 * np.exp(-0.25 * time) * np.cos(2 * np.pi * 2 * time)
        >>> found = ad.identify({"time_s": time, "boom_cap_bar": pressure}, [(0, 4)])
        >>> print(found.frame[["frequency_hz", "damping_ratio"]].round(3).to_string(index=False))
         frequency_hz  damping_ratio
                  2.0           0.02
    """
    whole = _recording(recording)
    name = signal or strongest_column(whole, excitation)
    whole.column(name)
    if name == excitation:
        fault = f"{name} is both the signal and its excitation"
        raise SimulationError(whole.source, fault, "name the column that answers as the signal")
    if modes < 1:
        raise SimulationError(whole.source, f"{modes} modes", "ask for 1 or more modes")
    if band and not excitation:
        remedy = "name the column of the input too, or leave the band out"
        raise SimulationError(whole.source, "a band is of the answer to an excitation", remedy)
    if band and not 0 < band[0] < band[1] < math.inf:
        fault = f"{band[0]:g}:{band[1]:g} is no band"
        raise SimulationError(whole.source, fault, "give 0 < lowest < highest [Hz]")
    fitted, refused = list[IdentifiedWindow](), list[ArmDesignError]()
    for begin, end in _windows_of(whole, name, windows, excitation):
        part = whole.between(begin, end)
        try:
            if excitation:
                one = _forced(part, name, modes, excitation, band)
            else:
                one = _rung(part, name, modes)
            one = replace(one, remarks={**one.remarks, **_missing(whole, begin, end)})
            fitted.append(with_pose(one, machine) if machine else one)
        except SimulationError as error:
            refused.append(error)
    if not fitted:
        raise_together(refused)
    return Identified(
        recording=whole,
        signal=name,
        windows=tuple(fitted),
        refused=tuple(map(str, refused)),
        warnings=tuple(_warnings(whole)),
        machine=machine,
    )


def _windows_of(
    whole: Recording, name: str, windows: Sequence[tuple[float, float]], excitation: str
) -> Sequence[tuple[float, float]]:
    """Windows as given; if none, of a response the whole recording, else where it rings."""
    given = stated_windows(whole.source, windows)
    if given or excitation:
        return given or [(whole.time[0], whole.time[-1])]
    values = whole.sampled(name)
    step = whole.step
    refuse_slow_sampling(whole.source, step)
    try:
        return found_windows(whole.source, whole.time, values)
    except SimulationError:
        values = whole.signal(name)  # says what spoils it
        level = detrended(values[:, None], TRENDS[0])[:, 0]
        _refuse_coarse(whole, name, step, level)
        _refuse_fast(whole, name, step, level)
        raise


def _missing(whole: Recording, begin: float, end: float) -> dict[str, str]:
    """That a window reaches beyond the recording, if it does."""
    first, last = float(whole.time[0]), float(whole.time[-1])
    if begin >= first - whole.step and end <= last + whole.step:
        return {}
    held, asked = whole.span_text(first, last), whole.span_text(begin, end)
    return {"cut": f"the recording holds {held} s, not all of {asked} s"}


def _recording(given: str | Path | Recording | Mapping[str, Any]) -> Recording:
    if isinstance(given, Recording):
        return given
    if isinstance(given, (str, Path)):
        return read_recording(given)
    return recording_of({str(name): values for name, values in given.items()})


def _rung(part: Recording, name: str, modes: int) -> IdentifiedWindow:
    """A free decay about a trend."""
    values = part.signal(name)
    length = float(part.time[-1] - part.time[0])
    step = part.step
    level = detrended(values[:, None], TRENDS[0])[:, 0]
    slow, (frequency, height) = strongest(step, level), strongest(step, level, PERIODS / length)
    _refuse_trend(part, name, level)
    _refuse_coarse(part, name, step, level)
    too_short = "choose a longer window"
    if height == 0 or (slow[0] < PERIODS / length and slow[1] > DOMINATES * height):
        fault = f"shorter than two periods of {name} (about {slow[0]:.2g} Hz)"
        raise SimulationError(part.source, fault, too_short)
    time, signal = _thinned(part.time, values, round(1 / (PER_PERIOD * frequency * step)))
    trend = TRENDS[frequency * length > SHORT]
    fit = identify_ringdown(time, signal, modes, f"{part.source}, {name}", trend=trend)
    first, damping = float(fit.natural_frequencies[0]), float(fit.damping_ratios[0])
    if first * length < PERIODS:
        fault = f"shorter than two periods of {name} ({first:.2g} Hz)"
        raise SimulationError(part.source, fault, too_short)
    _refuse_few_samples(part, name, step, first)
    fitted = fit.fitted[:, 0]
    pieces = swings(time, signal, signal - fitted, first, damping) if modes == 1 else None
    return IdentifiedWindow(
        begin=float(part.time[0]),
        end=float(part.time[-1]),
        fit=fit,
        time=time,
        signal=signal,
        fitted=fitted,
        swings=pieces,
        ratios=tuple(_ratios(part, step, first, damping)),
        means=means_of(part),
        remarks=_remarks(part, fit, pieces, float(np.abs(level).max())),
    )


def _refuse_trend(part: Recording, name: str, level: Array) -> None:
    """Raise where nothing but rounding is left about a trend."""
    if np.abs(level).max() <= ROUNDING * np.abs(part.columns[name]).max():
        fault = f"{name} is a smooth trend, on which nothing rings"
        raise SimulationError(part.source, fault, "choose another window or column")


def _refuse_coarse(part: Recording, name: str, step: float, level: Array) -> None:
    """Raise where a line with too few samples in a period is far above those with enough."""
    fast, height = strongest_beyond(step, level)
    if height > DOMINATES * strongest(step, level)[1]:
        _refuse_few_samples(part, name, step, fast)


def _refuse_few_samples(part: Recording, name: str, step: float, frequency: float) -> None:
    """Raise where a period has too few samples."""
    if frequency * step * FEWEST_SAMPLES > 1:
        fault = f"{1 / (frequency * step):.2g} samples in a period of {name}"
        fault = f"has only {fault} (about {frequency:.2g} Hz)"
        rate = math.ceil(FEWEST_SAMPLES * frequency)
        remedy = f"record {FEWEST_SAMPLES} in a period, at {rate} Hz"
        raise SimulationError(part.source, fault, remedy)


def _refuse_fast(part: Recording, name: str, step: float, level: Array) -> None:
    """Raise where it rings above the frequencies among which windows are found."""
    fast = fast_line(step, level)
    if fast is not None:
        fault = f"windows are found up to {HIGHEST:g} Hz; {name} rings at about {fast:.3g} Hz"
        rate = math.ceil(FEWEST_SAMPLES * fast)
        remedy = "give windows" if rate * step <= 1 else f"record at {rate} Hz, give windows"
        raise SimulationError(part.source, fault, remedy)


def _remarks(
    part: Recording, fit: Ringdown, pieces: Swings | None, largest: float
) -> dict[str, str]:
    """Doubts about a free decay, by its largest swing too: a word, and why."""
    remarks = {}
    grows = fit.damping_ratios < 0
    if np.any(fit.damping_ratios < -SURE * fit.damping_deviations):
        remarks["grows"] = "it grows, as no free decay does: something still excites it"
    elif grows.any():
        remarks["undamped"] = "its damping is too small to be told from none"
    if fit.residual > LEFT:
        remarks["large residual"] = (
            f"the fit leaves {fit.residual:.0%} of it: it is no free decay, or holds more modes"
        )
    # what a mode that decays alone swings by at least, half a period later
    swing = float((fit.amplitudes[:, 0] * np.exp(-math.pi * fit.damping_ratios.clip(0))).max())
    if swing > BEYOND * largest:
        remarks["modes cancel"] = (
            f"a mode swings by {swing:.3g}, the signal by {largest:.3g} at most: two modes beat,"
            " or friction brakes it, to no exponential decay; look at its damping by swing"
        )
    again = pieces.rise if pieces else None
    if again is not None:
        remarks["excited again"] = (
            f"its swing rises again about {part.time_text(again)} s: it is excited again, or two"
            " modes beat; choose a window of one decay"
        )
    return remarks


def _forced(
    part: Recording, name: str, modes: int, excitation: str, band: tuple[float, float] | None
) -> IdentifiedWindow:
    """The answer to a recorded excitation."""
    values, driven = part.signal(name), part.excitation(excitation)
    frequency, _ = strongest(part.step, values)
    about = band or (frequency / BAND, frequency * BAND)
    fit = identify_forced_response(
        part.time, driven, values, about, modes, f"{part.source}, {name}"
    )
    return IdentifiedWindow(
        begin=float(part.time[0]),
        end=float(part.time[-1]),
        fit=fit,
        time=part.time,
        signal=values,
        fitted=None,
        swings=None,
        ratios=(),
        means=means_of(part),
    )


def _thinned(time: Array, values: Array, count: int) -> tuple[Array, Array]:
    """Means of so many neighbours each: they ring with the same modes as the samples."""
    if count < 2:
        return time.copy(), values.copy()
    used = len(time) // count * count
    first, second = (one[:used].reshape(-1, count).mean(axis=1) for one in (time, values))
    return first, second


def _ratios(part: Recording, step: float, frequency: float, damping: float) -> list[PressureRatio]:
    """Pressure swings of all cylinders that swing notably, of which both were recorded."""
    sides, ratios = sides_of(part), []
    for cylinder, side in sides:
        if side == "cap" and (cylinder, "annulus") in sides and abs(damping) < 1:
            names = [sides[cylinder, each] for each in SIDES]
            both = np.stack([part.columns[name] for name in names], axis=1)
            scale = np.array([PRESSURES[unit_of(name, KINDS[0])] / bar for name in names])
            if np.all(np.isfinite(both)) and np.all(np.ptp(both, axis=0) > 0):
                ratios.append(pressure_ratio(cylinder, step, both * scale, frequency, damping))
    ratios = [ratio for ratio in ratios if any(ratio.swings)]
    largest = max((max(ratio.cap, ratio.annulus) for ratio in ratios), default=0.0)
    return [one for one in ratios if max(one.cap, one.annulus) > NOTABLE * largest]


def _warnings(recording: Recording) -> list[str]:
    return [f'column "{name}": {INCLINOMETER}' for name in recording.columns if inclined(name)]
