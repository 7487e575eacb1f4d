"""Recordings of machines, identified: frequency and damping of every window that rings.

Each window holds a ring-down over a polynomial (``identification/ringdown.py``), or the answer to
a recorded excitation (``identification/modal_fit.py``). Beside them stand what the pose was, how
frequency and damping depend on the swing, and whether both chambers swing as trapped oil must.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import ArmDesignError, SimulationError, raise_together
from armdesign.machine.machine import Machine
from armdesign.machine.measured_lengths import at_lengths
from armdesign.simulation.identification.column_names import (
    KINDS,
    PRESSURES,
    inclined,
    means_of,
    sides_of,
    strongest_column,
    unit_of,
)
from armdesign.simulation.identification.decaying_modes import detrended
from armdesign.simulation.identification.modal_fit import ModalFit, identify_forced_response
from armdesign.simulation.identification.pressure_ratio import PressureRatio, pressure_ratio
from armdesign.simulation.identification.recording import Recording, read_recording, recording_of
from armdesign.simulation.identification.ringdown import Ringdown, identify_ringdown
from armdesign.simulation.identification.swings import Swings, swings
from armdesign.simulation.identification.windows import found_windows, stated_windows, strongest
from armdesign.units import bar, mm

if TYPE_CHECKING:
    import pandas as pd

SHORT, TRENDS = 4.0, (2, 4)  # periods below which a trend has the lower degree
DOMINATES = 3.0  # ratio of spectral lines
PRESSURE_COLUMNS = [
    "begin_s",
    "end_s",
    "cylinder",
    "cap_bar",
    "annulus_bar",
    "ratio",
    "deviation",
    "phase_deg",
    "trapped_ratio",
    "verdict",
]

NOTABLE = 0.2  # of the largest pressure swing
PERIODS = 2.0  # fewest in a window
PER_PERIOD = 40  # samples that are enough; more are averaged
BAND = 1.6  # default ends of a band, relative to the strongest frequency
INCLINOMETER = (
    "feels acceleration as if it were tilt, on a measured crane nine times the true swing: take"
    " frequencies from pressures or rates, poses from pin-to-pin lengths or encoders"
)


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedWindow:
    """What one window of a recording holds; arrays are read-only.

    Attributes:
        begin: its first instant [s].
        end: its last instant [s].
        fit: modes with their deviations.
        time: instants of the samples fitted (n,) [s]; of a fine signal, means of neighbours.
        signal: (n,).
        fitted: modes and trend (n,); None of a forced response.
        swings: frequency and damping against amplitude; None of a forced response.
        ratios: of the pressure swings of each cylinder of which both were recorded.
        means: means of the columns that tell pose and pressures, by the name of a column in a
            file of measurements.
        pose: of the machine (nq,) [rad, m]; None without a machine.
    """

    begin: float
    end: float
    fit: Ringdown | ModalFit
    time: Array
    signal: Array
    fitted: Array | None
    swings: Swings | None
    ratios: tuple[PressureRatio, ...]
    means: Mapping[str, float]
    pose: Array | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Identified:
    """What a recording holds.

    Attributes:
        recording: the whole of it.
        signal: name of the column that was fitted.
        windows: what was fitted, in the order of time.
        refused: windows that were not, each with its reason in one line.
        warnings: what a reader should know of the recording.
        machine: whose poses are given; None without one.
    """

    recording: Recording
    signal: str
    windows: tuple[IdentifiedWindow, ...]
    refused: tuple[str, ...]
    warnings: tuple[str, ...]
    machine: Machine | None = None

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each mode of each window; ``armdesign calibrate`` reads it.

        Columns: begin_s, end_s, signal, frequency_hz, deviation_hz, damping_ratio,
        damping_deviation, amplitude (of the signal at the window's begin), and the means of the
        columns that tell pose and pressures.
        """
        import pandas as pd

        rows = []
        for window in self.windows:
            fit = window.fit
            sizes = fit.amplitudes[:, 0] if isinstance(fit, Ringdown) else None
            for k, frequency in enumerate(fit.natural_frequencies):
                row = {"begin_s": window.begin, "end_s": window.end, "signal": self.signal}
                row |= {"frequency_hz": frequency, "deviation_hz": fit.frequency_deviations[k]}
                row |= {"damping_ratio": fit.damping_ratios[k]}
                row |= {"damping_deviation": fit.damping_deviations[k]}
                row |= {"amplitude": math.nan if sizes is None else sizes[k], **window.means}
                rows.append(row)
        return pd.DataFrame(rows)

    @cached_property
    def swings(self) -> pd.DataFrame:
        """Frequency and damping against amplitude, a row for each piece of each window."""
        import pandas as pd

        columns = {
            "time_s": "time",
            "amplitude": "amplitudes",
            "frequency_hz": "frequencies",
            "deviation_hz": "frequency_deviations",
            "damping_ratio": "damping_ratios",
            "damping_deviation": "damping_deviations",
        }
        parts = [
            pd.DataFrame(
                {"begin_s": w.begin, "end_s": w.end}, index=range(len(w.swings.time))
            ).assign(**{name: getattr(w.swings, field) for name, field in columns.items()})
            for w in self.windows
            if w.swings is not None
        ]
        filled = [part for part in parts if len(part)]
        names = ["begin_s", "end_s", *columns]
        return pd.concat(filled, ignore_index=True) if filled else pd.DataFrame(columns=names)

    @cached_property
    def pressures(self) -> pd.DataFrame:
        """Pressure swings of each window and cylinder, beside what trapped oil would show."""
        import pandas as pd

        rows = [
            {
                "begin_s": window.begin,
                "end_s": window.end,
                "cylinder": one.cylinder,
                "cap_bar": one.cap,
                "annulus_bar": one.annulus,
                "ratio": one.ratio,
                "deviation": one.deviation,
                "phase_deg": one.phase,
                "trapped_ratio": math.nan if one.expected is None else one.expected,
                "verdict": one.verdict,
            }
            for window in self.windows
            for one in window.ratios
        ]
        return pd.DataFrame(rows, columns=PRESSURE_COLUMNS)

    @property
    def findings(self) -> list[str]:
        """What a reader should know: effects of the swing, pressures, what was not fitted."""
        found = []
        for window in self.windows:
            change = None if window.swings is None else window.swings.change
            if change:
                first, second, big, small = change
                found.append(
                    f"{window.begin:g}–{window.end:g} s: large swings ring"
                    f" {'lower' if first < second else 'higher'}: {first:.3f} Hz at ±{big:.3g},"
                    f" {second:.3f} Hz at ±{small:.3g}"
                )
        for (cylinder, verdict), rows in self.pressures.groupby(
            ["cylinder", "verdict"], sort=False
        ):
            text = f"{cylinder}: {verdict} ({len(rows)} of {len(self.windows)} windows"
            if "ratio" in str(verdict):
                ratios, trapped = rows["ratio"], rows["trapped_ratio"]
                text += f"; {ratios.min():.3g} to {ratios.max():.3g}, of trapped oil"
                text += f" {trapped.min():.3g} to {trapped.max():.3g}"
            found.append(f"{text})")
        return [*found, *(f"not fitted: {line}" for line in self.refused), *self.warnings]

    def plot(self) -> Any:
        """Figure of signal, fit and residual, and of frequency against amplitude."""
        from armdesign.plots.recordings import identified_figure

        return identified_figure(self)


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
    name = signal or strongest_column(whole)
    whole.column(name)
    if modes < 1:
        raise SimulationError(whole.source, f"{modes} modes", "ask for 1 or more modes")
    if band and not excitation:
        remedy = "name the column of the input too, or leave the band out"
        raise SimulationError(whole.source, "a band is of the answer to an excitation", remedy)
    if band and not 0 < band[0] < band[1] < math.inf:
        problem = f"{band[0]:g}:{band[1]:g} is no band"
        raise SimulationError(whole.source, problem, "give 0 < lowest < highest [Hz]")
    found, refused = list[IdentifiedWindow](), list[ArmDesignError]()
    for begin, end in _windows_of(whole, name, windows, excitation):
        part = whole.between(begin, end)
        try:
            one = _forced(part, name, modes, excitation, band) if excitation else None
            one = one or _rung(part, name, modes)
            found.append(_with_pose(one, part, machine))
        except SimulationError as error:
            refused.append(error)
    if not found:
        raise_together(refused)
    return Identified(
        recording=whole,
        signal=name,
        windows=tuple(found),
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
    try:
        return found_windows(whole.source, whole.time, whole.sampled(name))
    except SimulationError:
        whole.signal(name)  # says what spoils it
        raise


def _recording(given: str | Path | Recording | Mapping[str, Any]) -> Recording:
    if isinstance(given, Recording):
        return given
    if isinstance(given, (str, Path)):
        return read_recording(given)
    return recording_of({name: np.asarray(values, float) for name, values in given.items()})


def _rung(part: Recording, name: str, modes: int) -> IdentifiedWindow:
    """A free decay about a trend."""
    values = part.signal(name)
    length = float(part.time[-1] - part.time[0])
    step = length / (len(part.time) - 1)
    level = detrended(values[:, None], TRENDS[0])[:, 0]
    slow, (frequency, height) = strongest(step, level), strongest(step, level, PERIODS / length)
    too_short = "choose a longer window"
    if height == 0 or (slow[0] < PERIODS / length and slow[1] > DOMINATES * height):
        problem = f"shorter than two periods of {name} (about {slow[0]:.2g} Hz)"
        raise SimulationError(part.source, problem, too_short)
    time, signal = _thinned(part.time, values, round(1 / (PER_PERIOD * frequency * step)))
    trend = TRENDS[frequency * length > SHORT]
    fit = identify_ringdown(time, signal, modes, f"{part.source}, {name}", trend=trend)
    first, damping = float(fit.natural_frequencies[0]), float(fit.damping_ratios[0])
    if first * length < PERIODS:
        problem = f"shorter than two periods of {name} ({first:.2g} Hz)"
        raise SimulationError(part.source, problem, too_short)
    fitted = fit.fitted[:, 0]
    return IdentifiedWindow(
        begin=float(part.time[0]),
        end=float(part.time[-1]),
        fit=fit,
        time=time,
        signal=signal,
        fitted=fitted,
        swings=swings(time, signal, signal - fitted, first, damping) if modes == 1 else None,
        ratios=tuple(_ratios(part, step, first, damping)),
        means=means_of(part),
    )


def _forced(
    part: Recording, name: str, modes: int, excitation: str, band: tuple[float, float] | None
) -> IdentifiedWindow:
    """The answer to a recorded excitation."""
    values, driven = part.signal(name), part.signal(excitation)
    step = float((part.time[-1] - part.time[0]) / (len(part.time) - 1))
    frequency, _ = strongest(step, values)
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
            names = [sides[cylinder, each] for each in ("cap", "annulus")]
            both = np.stack([part.columns[name] for name in names], axis=1)
            scale = np.array([PRESSURES[unit_of(name, KINDS[0])] / bar for name in names])
            if np.all(np.isfinite(both)) and np.all(np.ptp(both, axis=0) > 0):
                ratios.append(pressure_ratio(cylinder, step, both * scale, frequency, damping))
    ratios = [ratio for ratio in ratios if any(ratio.swings)]
    largest = max((max(ratio.cap, ratio.annulus) for ratio in ratios), default=0.0)
    return [one for one in ratios if max(one.cap, one.annulus) > NOTABLE * largest]


def _with_pose(
    window: IdentifiedWindow, part: Recording, machine: Machine | None
) -> IdentifiedWindow:
    """The window with its pose and what trapped oil would show there."""
    if machine is None:
        return window
    q = np.zeros(len(machine.joints))
    for j, joint in enumerate(machine.arm.joints):
        unit, factor = ("deg", math.radians(1)) if joint.revolute else ("mm", mm)
        own = [
            (i, f"{cylinder.name}_length_mm")
            for i, (cylinder, linkage) in enumerate(
                zip(machine.cylinders, machine.linkages, strict=True)
            )
            if linkage.joints == (j,)
        ]
        lengths = [(i, window.means[name]) for i, name in own if name in window.means]
        if lengths:
            i, length = lengths[0]
            q[j] = at_lengths(machine, i, np.array([length]) * mm, [part.source])[0]
        elif f"{joint.name}_{unit}" in window.means:
            q[j] = window.means[f"{joint.name}_{unit}"] * factor
        elif not machine.ranges[j][0] <= 0 <= machine.ranges[j][1]:
            problem = f"nothing says where joint {joint.name} stands"
            names = " or ".join([f"{joint.name}_{unit}", *(name for _, name in own)])
            raise SimulationError(part.source, problem, f"give a column {names}")
    ratios = tuple(_expected(ratio, window.means, machine, q) for ratio in window.ratios)
    return replace(window, pose=q, ratios=ratios)


def _expected(
    ratio: PressureRatio, means: Mapping[str, float], machine: Machine, q: Array
) -> PressureRatio:
    """The ratio with what oil trapped on both sides would show."""
    names = [actuator.name for actuator in machine.actuators]
    if ratio.cylinder not in names:
        return ratio
    i = names.index(ratio.cylinder)
    actuator = machine.actuators[i]
    length = machine.evaluate(machine.rigid_poses(q[None])).lengths[0, i]
    pressures = [means[f"{ratio.cylinder}_{side}_bar"] * bar for side in ("cap", "annulus")]
    cap, annulus = actuator.capacities(
        length - actuator.closed_length, (pressures[0], pressures[1]), machine.fluid
    )
    stiffness = actuator.bore_area / cap, actuator.annulus_area / annulus
    return replace(ratio, expected=float(stiffness[0] / stiffness[1]))


def _warnings(recording: Recording) -> list[str]:
    return [
        f'column "{name}": an inclinometer on a moving machine {INCLINOMETER}'
        for name in recording.columns
        if inclined(name)
    ]
