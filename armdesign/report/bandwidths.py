"""Sheets and report of bandwidth maps: what controllers reach, and what formulas promise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.control.bandwidth_map import GAIN_ERROR, BandwidthMap
from armdesign.control.margins import gain_margin_db, phase_margin
from armdesign.machine.poses import pose_text
from armdesign.report.contents import HeadlineNumber, Picture, Report, ReportSection
from armdesign.report.scene import bandwidth_scene
from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units, deg

if TYPE_CHECKING:
    import pandas as pd

NAMES = {
    "proportional": "position loops alone",
    "individual": "position loops alone, own gains",
    "damped": "+ pressure feedback, common gains",
    "own": "+ pressure feedback, own gains",
}
SEARCHED = "; own gains with pressure feedback are searched: a lower bound"


def bandwidth_report(
    maps: Mapping[str, BandwidthMap],
    sheets: Sequence[Sheet],
    pictures: Sequence[Picture],
    provenance: Sheet,
    units: Units = WORKSHOP,
) -> Report:
    """Report of bandwidth maps.

    Args:
        maps: of one machine, or of several by their labels.
        sheets: their tables, of ``bandwidth_sheets``.
        pictures: of the maps.
        provenance: table of how it was made.
        units: of the poses.
    """
    first = next(iter(maps.values())).machine
    title = f"{first.section.title or first.name}: bandwidth of position loops"
    if len(maps) > 1:
        title = f"Bandwidth of position loops: {_machines(maps)}"
    named = {label or first.name: one for label, one in maps.items()}
    return Report(
        title=title,
        lead=bandwidth_sentence(maps),
        headline=_bandwidth_headline(list(maps.values()), units),
        sections=(
            ReportSection(title="What controllers reach", sheets=tuple(sheets)),
            ReportSection(title="The machine in its worst pose", shows="drawing"),
            ReportSection(
                title="Map of bandwidths, with pressure feedback and own gains",
                shows="maps",
                pictures=tuple(pictures),
            ),
            ReportSection(title="Provenance", sheets=(provenance,)),
        ),
        scene=bandwidth_scene(named, units),
    )


def _bandwidth_headline(maps: Sequence[BandwidthMap], units: Units) -> tuple[HeadlineNumber, ...]:
    """The worst bandwidth without and with pressure feedback, and the lowest frequency."""
    kinds = {
        "bandwidth of position loops alone": ("proportional_hz", "proportional"),
        "with pressure feedback and own gains": ("own_hz", "own"),
        "lowest natural frequency": ("f1_hz", ""),
    }
    numbers = []
    for name, (column, scheme) in kinds.items():
        rows = [one.worst(scheme) if scheme else one.softest for one in maps]
        machine, row = maps[-1].machine, rows[-1]
        at = pose_text(machine, row[list(machine.joints)].to_numpy(dtype=float), units)
        value = " → ".join(f"{float(one[column]):.3g}" for one in rows)
        words = f"{'new: ' if len(maps) > 1 else ''}{at}, payload {row['payload']}"
        numbers.append(HeadlineNumber(name=name, value=f"{value}\u00a0Hz", words=words))
    return tuple(numbers)


def bandwidth_sheets(maps: Mapping[str, BandwidthMap], units: Units = WORKSHOP) -> list[Sheet]:
    """Bandwidths of the controllers, their worst poses, and promises of formulas.

    Args:
        maps: of one machine, or of several by their labels.
        units: of the tables.
    """
    first = next(iter(maps.values()))
    title = f"{first.machine.section.title or first.machine.name}: bandwidth of the narrowest loop"
    if len(maps) > 1:
        title = f"Bandwidth of the narrowest loop: {_machines(maps)}"
    sheets = [_schemes_sheet(maps, f"{title} [Hz]")]
    for label, bandwidths in maps.items():
        sheets += [_worst_sheet(label if len(maps) > 1 else "", bandwidths, units)]
    return [*sheets, _promises_sheet(maps)]


def bandwidth_sentence(maps: Mapping[str, BandwidthMap]) -> str:
    """Sentence on bandwidths at the worst poses of one machine or two, and lowest frequencies."""
    both = list(maps.values())
    alone, fed_back = (
        " and ".join(f"{float(one.worst(scheme)[f'{scheme}_hz']):.2g}" for one in both)
        for scheme in ("proportional", "own")
    )
    lowest = " and ".join(f"{float(one.softest['f1_hz']):.3g}" for one in both)
    if len(both) == 1:
        return (
            f"Position loops alone reach {alone} Hz at the worst pose of"
            f" {both[0].machine.name}, with pressure feedback {fed_back} Hz; the lowest natural"
            f" frequency at these poses is {lowest} Hz."
        )
    return (
        f"Each at its worst pose, position loops alone of today's and of the new machine reach"
        f" {alone} Hz, with pressure feedback {fed_back} Hz; their lowest natural frequencies at"
        f" these poses are {lowest} Hz."
    )


def _machines(maps: Mapping[str, BandwidthMap]) -> str:
    """Labels of machines with their files, which tell machines of one name apart."""
    files = {label: one.machine.source.name for label, one in maps.items()}
    if len({*files.values()}) == 1:
        return " and ".join(files)
    return ", ".join(f"{label} {file}" for label, file in files.items())


def _schemes_sheet(maps: Mapping[str, BandwidthMap], title: str) -> Sheet:
    """What every controller reaches, with and without feed-forward."""
    rows = []
    for label, bandwidths in maps.items():
        for scheme, name in NAMES.items():
            case = f"{label}: {name}" if len(maps) > 1 else name
            rows += [(case, *_reached(bandwidths, scheme)), _with_feed_forward(bandwidths, scheme)]
    options = next(iter(maps.values())).options
    margin, damping = options.aim.margin, options.damping
    source = "the file's" if damping is None else f"stated, {damping:g} in every mode"
    delay = f", delay {1e3 * options.delay:g} ms" if options.delay else ""
    return Sheet(
        title=title,
        columns=(
            "controller",
            "worst",
            "median",
            "at lowest f",
            "widest loop",
            "error of a move [s]",
            "settles [s]",
            "peak of S",
        ),
        rows=tuple(rows),
        note=(
            f"all loops closed at once, balanced disk margin {margin:.3f} of all together:"
            f" {float(gain_margin_db(margin)):.1f} dB,"
            f" {float(phase_margin(margin)) / deg:.0f} deg; damping: {source}{delay}; widest loop:"
            " bandwidth at the median pose; error of a move at constant speed is that speed times"
            " the seconds, settles: within 2 % of a step at the latest; these and the peak of S,"
            " each at its worst pose;"
            f" with feed-forward: bandwidth of commands, the valve's gain known within"
            f" {100 * GAIN_ERROR:.0f} %, the rest of the loop as without{_note(maps)}"
        ),
    )


def _reached(bandwidths: BandwidthMap, scheme: str) -> tuple[str, ...]:
    """Bandwidths of a controller, its error of a move, time to settle and peak of S."""
    works, worst = bandwidths.frame[bandwidths.frame["works"]], bandwidths.worst(scheme)
    loops = works[[f"{scheme}_{joint}_hz" for joint in bandwidths.machine.joints]]
    peak = f"{works[f'{scheme}_peak'].max():.2f}" if worst[f"{scheme}_hz"] else "–"
    return (
        *_least_and_median(bandwidths, f"{scheme}_hz"),
        f"{loops.max(axis=1).median():.3g}",
        _seconds(works[f"{scheme}_tracking_s"].max()),
        _seconds(works[f"{scheme}_settling_s"].max()),
        peak,
    )


def _with_feed_forward(bandwidths: BandwidthMap, scheme: str) -> tuple[str, ...]:
    """The row of a controller with feed-forward: bandwidth of commands, error of a move."""
    error = GAIN_ERROR * bandwidths.frame.loc[bandwidths.frame["works"], f"{scheme}_tracking_s"]
    commands = _least_and_median(bandwidths, f"{scheme}_command_hz")
    return ("    with feed-forward", *commands, "", _seconds(error.max()), "″", "″")


def _least_and_median(bandwidths: BandwidthMap, column: str) -> list[str]:
    """A bandwidth at its worst pose, at the median one and at that of the lowest frequency."""
    hertz = bandwidths.frame.loc[bandwidths.frame["works"], column]
    values = hertz.min(), hertz.median(), bandwidths.softest[column]
    return [f"{value:.3g}" for value in values]


def _note(maps: Mapping[str, BandwidthMap]) -> str:
    """That own gains are lower bounds, and valves that are slower than what they are to damp."""
    alike = SEARCHED + _poses(maps)
    words = [
        f"{label + ' ' if len(maps) > 1 else ''}{name} ({100 * share:.3g} % of the poses)"
        for label, bandwidths in maps.items()
        for name, share in bandwidths.slow_valves.items()
    ]
    if not words:
        return alike
    said = "; valves slower than the lowest mode, which they cannot damp well: "
    return alike + said + ", ".join(words)


def _poses(maps: Mapping[str, BandwidthMap]) -> str:
    """Whether machines are compared at the same poses; empty for one machine."""
    if len(maps) < 2:
        return ""
    one, *others = (each.workspace.q for each in maps.values())
    if all(np.array_equal(one, other) for other in others):
        return "; both machines at the same poses"
    return "; each machine over its own joint ranges, as links or strokes differ: other poses"


def _worst_sheet(label: str, bandwidths: BandwidthMap, units: Units) -> Sheet:
    """The worst pose of bandwidth beside the worst pose of frequency."""
    rows = [("lowest frequency", *_row_of(bandwidths, bandwidths.softest, units))]
    for scheme, name in NAMES.items():
        rows.append((f"worst, {name}", *_row_of(bandwidths, bandwidths.worst(scheme), units)))
    note = (
        "f: lowest natural frequency; ζ: its damping; own, settles: with pressure feedback and own"
        " gains"
    )
    note += _hardly_damped(bandwidths)
    note += _left_out(bandwidths)
    return Sheet(
        title=f"{label}: worst poses" if label else "Worst poses",
        columns=("pose", "f [Hz]", "ζ", "own [Hz]", "settles [s]", "where"),
        rows=tuple(rows),
        note=note,
    )


def _left_out(bandwidths: BandwidthMap) -> str:
    """Poses at which no controller works, and load cases of which all poses are such."""
    works, cases = bandwidths.frame["works"], bandwidths.frame["payload"]
    if works.all():
        return ""
    words = (
        f"; {int((~works).sum())} of {len(works)} poses left out: unstable on trapped oil, or a"
        " load above the supply's pressure or a relief"
    )
    lost = [name for name in cases.unique() if not works[cases == name].any()]
    return words + (f"; all of payload {' and '.join(lost)}" if lost else "")


def _hardly_damped(bandwidths: BandwidthMap) -> str:
    """Modes above the lowest that bound gains, and poses at which no gains keep the margin."""
    frame, words = bandwidths.frame, ""
    worst = bandwidths.worst("proportional")
    if worst["bounding_damping"] < worst["damping"]:
        words = f"; what bounds position loops at their worst pose is {_bounding(worst)}"
    for scheme, name in NAMES.items():
        if scheme == "individual":  # lost with the common gain
            continue
        lost = frame[frame["works"] & (frame[f"{scheme}_hz"] == 0)]
        if len(lost):
            decay = lost["bounding_hz"] * lost["bounding_damping"]
            row = lost.iloc[int(decay.to_numpy().argmin())]
            words += (
                f"; {name.removeprefix('+ ')}: no gains keep the margin at {len(lost)} of"
                f" {len(frame)} poses, as at one with {_bounding(row)}: give friction or"
                " leakage, or ask for less"
            )
    return words


def _bounding(row: pd.Series[Any]) -> str:
    return f"the mode at {row['bounding_hz']:.3g} Hz with ζ {row['bounding_damping']:.2g}"


def _row_of(bandwidths: BandwidthMap, row: pd.Series[Any], units: Units) -> tuple[str, ...]:
    machine = bandwidths.machine
    at = pose_text(machine, row[list(machine.joints)].to_numpy(dtype=float), units)
    return (
        f"{row['f1_hz']:.3f}",
        f"{row['damping']:.4f}",
        f"{row['own_hz']:.3f}",
        _seconds(row["own_settling_s"]),
        f"{at}, payload {row['payload']}",
    )


def _promises_sheet(maps: Mapping[str, BandwidthMap]) -> Sheet:
    """Promises of formulas for a single loop, over what is reached."""
    rows = []
    for label, bandwidths in maps.items():
        works = bandwidths.frame[bandwidths.frame["works"]]
        worst = bandwidths.worst("proportional")
        for column, name in (("merritt_hz", "Merritt, K < 2ζω"), ("rule_hz", "rule f/3")):
            reached = works["proportional_hz"].where(works["proportional_hz"] > 0)
            ratios = works[column] / reached
            there = worst[column] / (worst["proportional_hz"] or np.nan)
            case = f"{label}: {name}" if len(maps) > 1 else name
            rows.append(
                (
                    case,
                    f"{worst[column]:.3g}",
                    _times(there),
                    f"{works[column].median():.3g}",
                    _times(ratios.median()),
                )
            )
    return Sheet(
        title="What formulas of a single loop promise [Hz]",
        columns=("formula", "at the worst pose", "too much", "median", "too much, median"),
        rows=tuple(rows),
        note=(
            "too much: times what position loops alone reach; Merritt's bound is where a single"
            " loop on the lowest mode, behind a fast valve, becomes unstable, without any margin"
        ),
    )


def _times(ratio: float) -> str:
    return f"{ratio:.1f} ×" if math.isfinite(ratio) else "–"


def _seconds(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) and value > 0 else "–"
