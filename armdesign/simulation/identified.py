"""Frequencies and damping identified in a recording: windows; tables, sentences and a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr
from armdesign.simulation.identification.column_names import tells_pose
from armdesign.simulation.identification.modal_fit import ModalFit
from armdesign.simulation.identification.pressure_ratio import PressureRatio
from armdesign.simulation.identification.recording import Recording
from armdesign.simulation.identification.ringdown import Ringdown
from armdesign.simulation.identification.swings import Swings

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure

MOVES = {"mm": 5.0, "deg": 1.0}  # by more than a ring does
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


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedWindow(ReadOnly):
    """Frequencies and damping of one window of a recording; arrays are read-only.

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
        remarks: what makes the answer doubtful: a word for the table, and why.
        pose: of the machine (nq,) [rad, m]; None without a machine, or where none can be told.
        pose_remarks: what to know of the pose, in words by joint.
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
    remarks: Mapping[str, str] = field(default_factory=dict)
    pose: Array | None = None
    pose_remarks: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Identified:
    """Frequencies and damping of a recording, window by window.

    Attributes:
        recording: the whole of it.
        signal: name of the column that was fitted.
        windows: what was fitted, in the order of time.
        refused: windows that were not, each with its reason in one line.
        warnings: what a reader should know of the recording.
        machine: whose poses are given; None without one.
    """

    __repr__ = short_repr

    recording: Recording
    signal: str
    windows: tuple[IdentifiedWindow, ...]
    refused: tuple[str, ...]
    warnings: tuple[str, ...]
    machine: Machine | None = None

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each mode of each window; ``armdesign calibrate`` reads it.

        Columns: begin_s, end_s, signal, mode (1 is the window's lowest), frequency_hz,
        deviation_hz, damping_ratio, damping_deviation, amplitude (of the signal at the window's
        begin), remark, and the means of the columns that tell pose and pressures.
        """
        import pandas as pd

        rows = []
        for window in self.windows:
            fit = window.fit
            sizes = fit.amplitudes[:, 0] if isinstance(fit, Ringdown) else None
            for k, frequency in enumerate(fit.natural_frequencies):
                row = {"begin_s": window.begin, "end_s": window.end, "signal": self.signal}
                row |= {"mode": k + 1, "frequency_hz": frequency}
                row |= {"deviation_hz": fit.frequency_deviations[k]}
                row |= {"damping_ratio": fit.damping_ratios[k]}
                row |= {"damping_deviation": fit.damping_deviations[k]}
                row |= {"amplitude": math.nan if sizes is None else sizes[k]}
                rows.append({**row, "remark": ", ".join(window.remarks), **window.means})
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

    def span(self, window: IdentifiedWindow) -> str:
        """Begin and end [s] of a window in words, which tell it from all others."""
        return self.recording.span_text(window.begin, window.end)

    @property
    def findings(self) -> list[str]:
        """Sentences: doubts, effects of the swing, verdicts on pressures, what is missing."""
        return [
            *self._doubts(),
            *self._changes(),
            *self._verdicts(),
            *self._poses(),
            *(f"not fitted: {line}" for line in self.refused),
            *self.warnings,
        ]

    def _doubts(self) -> Iterator[str]:
        """Remarks that make the answers of windows doubtful."""
        for window in self.windows:
            if window.remarks:
                words = "; ".join(window.remarks.values())
                yield f"{self.span(window)} s: {words}"

    def _changes(self) -> Iterator[str]:
        """Frequencies that depend on the swing."""
        for window in self.windows:
            change = None if window.swings is None else window.swings.change
            if change:
                first, second, big, small = change
                yield (
                    f"{self.span(window)} s: large swings ring"
                    f" {'lower' if first < second else 'higher'}: {first:.3f} Hz at ±{big:.3g},"
                    f" {second:.3f} Hz at ±{small:.3g}"
                    f"{self.motion(window) and f'; but {self.motion(window)}'}"
                )

    def motion(self, *windows: IdentifiedWindow) -> str:
        """In words that and how far the machine moves in windows; empty if it does not."""
        columns, ends = self.recording.columns, []
        for name in filter(tells_pose, columns):
            parts = [
                columns[name][(self.recording.time >= w.begin) & (self.recording.time <= w.end)]
                for w in windows
            ]
            values = np.concatenate(parts)
            values = values[np.isfinite(values)]
            if len(values) and np.ptp(values) > MOVES[name.rpartition("_")[2]]:
                ends.append(f"{name} {values.min():.4g} to {values.max():.4g}")
        return (
            f"the machine moves ({', '.join(ends)}): its pose changes the frequency"
            if ends
            else ""
        )

    def _verdicts(self) -> Iterator[str]:
        """Verdicts of the pressure swings on the oil."""
        for (cylinder, verdict), rows in self.pressures.groupby(
            ["cylinder", "verdict"], sort=False
        ):
            text = f"{cylinder}: {verdict} ({len(rows)} of {len(self.windows)} windows"
            if "ratio" in str(verdict):
                ratios, trapped = rows["ratio"], rows["trapped_ratio"]
                text += f"; {ratios.min():.3g} to {ratios.max():.3g}, of trapped oil"
                text += f" {trapped.min():.3g} to {trapped.max():.3g}"
            yield f"{text})"

    def _poses(self) -> Iterator[str]:
        """Joints whose pose the recording does not tell, once for all windows."""
        words: dict[str, list[str]] = {}
        for window in self.windows:
            for joint, remark in window.pose_remarks.items():
                words.setdefault(joint, []).append(remark)
        for remarks in words.values():
            yield f"{remarks[0]} ({len(remarks)} of {len(self.windows)} windows)"

    def plot(self) -> Figure:
        """Figure of signal, fit and residual, and of frequency against amplitude."""
        from armdesign.plots.recordings import identified_figure

        return identified_figure(self)
