"""Sheets of a frequency map: worst pose, bands, percentiles, limiting cylinders, stiffness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from armdesign.arrays import percentiles, weighted_share
from armdesign.errors import PoseError, SimulationError
from armdesign.frequency.bands import Bands
from armdesign.machine.dead_centres import OVERCOME, QUESTION
from armdesign.report.bands import BANDS_TITLE, bands_sheet
from armdesign.report.lift_charts import lift_charts, lift_sheet
from armdesign.report.sheet import Sheet, limiting_note, worst_pose_text
from armdesign.units import WORKSHOP, Units, percent, share_text

if TYPE_CHECKING:
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.frequency.worst_frequency import WorstPose

NOTABLE = 0.005  # change of the worst frequency
ORIGINS = "oil", "gravity", "moment arms under load", "springs of the structure"
LOWEST = "lowest of the poses"  # of a workspace alone; the worst is sought between them too


def in_hertz(frequency: float) -> str:
    """A worst frequency, or that there is none: the pose is unstable."""
    return f"{frequency:.3f} Hz{' (unstable)' if frequency == 0 else ''}"


def map_sheets(frequencies: FrequencyMap, units: Units = WORKSHOP) -> list[Sheet]:
    """Worst pose, bands, percentiles, limiting cylinders and origin of the stiffness."""
    machine = frequencies.machine
    tables = _bands_sheet(frequencies), spread_sheet({"": frequencies})
    shares = _limiting_sheet(frequencies), _stiffness_sheet(frequencies)
    lift = lift_sheet(lift_charts({machine.name: machine}), units)
    return [map_head(frequencies, units), *tables, *shares, lift]


def map_head(frequencies: FrequencyMap, units: Units = WORKSHOP) -> Sheet:
    """The worst frequency, where it is, and what limits it."""
    machine, worst = frequencies.machine, frequencies.worst
    reach = float(machine.heading.reach(worst.q[None], worst.tool[None])[0])
    dead = "" if worst.dead_centre is None else ", at its dead centre"
    limiting = next(part for part in machine.yielding if part.name == worst.cylinder)
    springs, reliefs = limiting_note(machine, worst), _relief_note(frequencies, units)
    notes = between_poses({"": frequencies}), springs, reliefs, _rest_note(frequencies)
    return Sheet(
        title=f"{machine.section.title or machine.name}: lowest natural frequency",
        rows=(
            ("worst frequency", _frequency_and_why(worst)),
            ("at", worst_pose_text(machine, worst, units)),
            ("tool at", f"reach {reach:.2f} m, height {worst.tool[2]:.2f} m"),
            ("limited by", f"{worst.cylinder} {limiting.kind}{dead}"),
        ),
        note="; ".join(filter(None, notes)),
        bold=(0,),
    )


def _frequency_and_why(worst: WorstPose) -> str:
    if worst.frequency > 0:
        return f"{worst.frequency:.3f} Hz"
    why = dead.fault if (dead := worst.dead_centre) else f"{OVERCOME}; {QUESTION}"
    return f"{worst.frequency:.3f} Hz: unstable, {why}"


def between_poses(maps: Mapping[str, FrequencyMap]) -> str:
    """Note on the lowest poses of maps by label, where a worst one between them is lower."""
    both = {name: (one.worst.frequency, one.lowest.min()) for name, one in maps.items()}
    if all(f"{worst:.3f}" == f"{lowest:.3f}" for worst, lowest in both.values()):
        return ""
    words = ", ".join(f"{name} {lowest:.3f} Hz".strip() for name, (_, lowest) in both.items())
    return f"the worst is sought between the poses too; {LOWEST}: {words}"


def too_few_poses(before: FrequencyMap, after: FrequencyMap) -> str:
    """Note on a design of which the worst poses between those of the workspace take half."""
    if before.worst.frequency == 0:
        return ""
    gain = after.worst.frequency / before.worst.frequency - 1
    at_poses = after.lowest.min() / before.lowest.min() - 1
    if at_poses < NOTABLE or gain > at_poses / 2:
        return ""
    gained = f"the search looks at the poses alone, where it gained {percent(at_poses)}"
    return f"{gained}: with more --points it sees more of what is between them"


def _bands_sheet(frequencies: FrequencyMap) -> Sheet:
    """The lowest frequency within the file's bands, or why there is none at their soft end."""
    machine, bands = frequencies.machine, Bands.shown(frequencies.machine)
    try:
        return bands_sheet(machine, bands, {LOWEST: frequencies.band})
    except PoseError as error:
        return Sheet(title=BANDS_TITLE, rows=(("softest", "unstable"),), note=str(error))


def _relief_note(frequencies: FrequencyMap, units: Units) -> str:
    """Loads that open a port relief: no valve holds the oil there, which the map assumes."""
    machine, beyond, notes = frequencies.machine, frequencies.beyond_reliefs, []
    for actuator in machine.actuators:
        if actuator.name in beyond:
            share, most = beyond[actuator.name]
            where = f"{share_text(share)} of the poses and loads" if share else "single poses"
            needed, held = (units.text(p, "Pa") for p in (most, actuator.relief(machine.supply)))
            notes.append(
                f"at {where} {actuator.name} needs more than its relief holds: up to {needed}, the"
                f" relief opens at {held}; no valve holds the load there"
            )
    return "; ".join(notes)


def _rest_note(frequencies: FrequencyMap) -> str:
    """Change at the worst pose by oil with air behind leaking valves; empty if little."""
    machine, worst = frequencies.machine, frequencies.worst
    valves = {actuator.name: actuator.valve for actuator in machine.actuators}
    leaking = [name for name, valve in valves.items() if valve and valve.leaks]
    if not leaking or machine.fluid.air == 0 or not all(valves.values()) or worst.frequency == 0:
        return ""
    from armdesign.simulation.linearization import linearize

    try:
        modes = linearize(machine.with_payload(worst.payload), worst.q).natural_frequencies
    except SimulationError as error:
        return str(error)
    left = len(modes) == len(machine.arm.coordinates)
    if left and abs(modes[0] - worst.frequency) < NOTABLE * worst.frequency:
        return ""
    return (
        "the stiffness of oil with air depends on pressure, here the static pressure; flow"
        f" through valves that leak or have an underlap ({', '.join(leaking)}) changes it: the"
        " worst pose then " + (f"has {modes[0]:.3f} Hz" if left else "is overdamped")
    )


def spread_sheet(maps: dict[str, FrequencyMap]) -> Sheet:
    """Percentiles of the lowest frequency per load case, of one or more maps."""
    rows = []
    for label, frequencies in maps.items():
        for payload in frequencies.worst_of:
            spread = (f"{value:.3f}" for value in frequencies.spread(payload, [0, 5, 50, 95]))
            case, poses = f"{label}, {payload}" if label else payload, frequencies.rows_of(payload)
            rows.append((case, f"{poses.sum()}", *spread))
    title = "Lowest coupled frequency at the poses of the workspace [Hz]"
    columns = ("payload", "poses", "lowest", "5 %", "50 %", "95 %")
    note = "a pose counts in percentiles and shares as the box of joint space about it is large"
    return Sheet(title=title, columns=columns, rows=tuple(rows), note=note)


def _limiting_sheet(frequencies: FrequencyMap) -> Sheet:
    rows = []
    for cylinder in frequencies.machine.actuators:
        limits, ratios = (frequencies.limiting == cylinder.name) & (frequencies.lowest > 0), []
        for formula in ("locked", "rigid"):
            simpler = frequencies.columns[f"{formula}_{cylinder.name}_hz"]
            ratio = simpler[limits] / frequencies.lowest[limits]
            median = percentiles(ratio, frequencies.weights[limits], [50]) if limits.any() else ()
            ratios.append("".join(map(_ratio, median)) or "–")
        rows.append((cylinder.name, _limiting_share(frequencies, cylinder.name), *ratios))
    springs = [spring.name for spring in frequencies.machine.springs]
    rows += [(name, _limiting_share(frequencies, name), "–", "–") for name in springs]
    note = "share of poses that the cylinder limits, and medians over them; 1.00 would be exact"
    if springs:
        note += f"; where the spring {' or '.join(springs)} limits, cylinders yield less"
    return Sheet(
        title="Limiting cylinders, and simpler formulas there",
        columns=("cylinder", "limits", "locked / coupled", "rigid load / coupled"),
        rows=tuple(rows),
        note=note,
    )


def _ratio(value: float) -> str:
    """A ratio of frequencies; where a load has no inertia about a joint but rounding "> 1000"."""
    return f"{value:.2f}" if value <= 1000 else "> 1000"


def _limiting_share(frequencies: FrequencyMap, name: str) -> str:
    share = weighted_share(frequencies.limiting == name, frequencies.weights)
    return f"{100 * share:.1f} %"


def _stiffness_sheet(frequencies: FrequencyMap) -> Sheet:
    stable = frequencies.lowest > 0
    shares, weights = frequencies.part_shares[stable].T, frequencies.weights[stable]
    spreads = (percentiles(share, weights, (0, 50, 100)) for share in shares if len(share))
    rows = ((name, *map(percent, spread)) for name, spread in zip(ORIGINS, spreads, strict=False))
    return Sheet(
        title="Origin of the stiffness of the lowest mode",
        columns=("part", "least", "median", "greatest"),
        rows=tuple(rows),
        note=(
            "shares of the stiffness at each pose, all load cases; negative: softening; every pose"
            " is in stiffness.csv"
        ),
    )
