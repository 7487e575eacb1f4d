"""Reports of one machine: of its map and of its validation; and what they assume."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from armdesign.errors import PoseError
from armdesign.frequency.bands import Bands
from armdesign.frequency.frequency_band import FrequencyBand
from armdesign.frequency.worst_frequency import WorstPose, worst_anywhere
from armdesign.machine.dead_centres import OVERCOME
from armdesign.report.bands import end_names, is_assumed, widths
from armdesign.report.contents import HeadlineNumber, Picture, Report, ReportSection
from armdesign.report.maps import LOWEST
from armdesign.report.scene import scene_of
from armdesign.report.sheet import Sheet, worst_pose_text
from armdesign.units import WORKSHOP, Units, percent

if TYPE_CHECKING:
    from armdesign.frequency.maps import FrequencyMap
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine

ENDS = ("softest", "nominal", "rigid")


def map_report(
    frequencies: FrequencyMap,
    sheets: Sequence[Sheet],
    pictures: Sequence[Picture],
    provenance: Sheet,
    units: Units = WORKSHOP,
) -> Report:
    """Report of a frequency map.

    Args:
        frequencies: the map.
        sheets: its tables, of ``map_sheets``.
        pictures: of the map, then others.
        provenance: table of how it was made.
        units: of the tables.
    """
    machine, worst = frequencies.machine, frequencies.worst
    head, of_bands, spread, *others, lift = sheets
    of_map = tuple(one for one in pictures if one.file.startswith("map_"))
    further = tuple(one for one in pictures if one not in of_map)
    bands = Bands.shown(machine)
    numbers = headline(poses_of_ends({"": frequencies}, bands), machine, bands, units)
    return Report(
        title=head.title,
        lead=(
            f"The worst natural frequency in the workspace is {worst.frequency:.3f} Hz, at"
            f" {worst_pose_text(machine, worst, units)}; the {worst.cylinder} limits it there."
        ),
        headline=numbers,
        sections=(
            ReportSection(title="The machine in its worst pose", shows="drawing"),
            ReportSection(
                title="Map of frequencies",
                shows="maps",
                pictures=of_map[:2],
                sheets=(head, of_bands, spread, *others),
            ),
            ReportSection(title="Lift chart and moment arms", pictures=further, sheets=(lift,)),
            ReportSection(title="Assumptions", words=assumptions(machine, frequencies.workspace)),
            ReportSection(title="Provenance", sheets=(provenance,)),
        ),
        scene=scene_of({machine.name: frequencies}, units),
    )


def plain_report(title: str, lead: str, sections: Sequence[ReportSection]) -> Report:
    """Report of tables, sentences, charts and pictures; sections with nothing are left out."""
    full = (one for one in sections if one.words or one.sheets or one.pictures or one.charts)
    return Report(title=title, lead=lead, sections=tuple(full))


# ------------------------------------------------------------------------------- headline


EndPoses = dict[str, list[WorstPose | None]]  # by ends of bands, of each machine


def poses_of_ends(
    maps: Mapping[str, FrequencyMap], bands: Bands, known: Sequence[FrequencyBand] = ()
) -> EndPoses:
    """Worst poses of machines at the ends of bands and with the file's values, between poses too.

    None where a machine is unstable.

    Args:
        maps: of one machine, or of today's and the new one on one workspace.
        bands: what is not known exactly.
        known: the worst frequencies within them of each machine; none: taken from the maps.
    """
    first = next(iter(maps.values()))
    pairs: EndPoses = {end: [] for end in ENDS}
    for k, frequencies in enumerate(maps.values()):
        try:
            band = known[k] if known else frequencies.band
        except PoseError:  # unstable at the soft end
            band = None
        for end, pose in _ends(frequencies, first.machine, band, bands).items():
            pairs[end].append(pose)
    return pairs


def headline(
    pairs: EndPoses, today: Machine, bands: Bands, units: Units = WORKSHOP
) -> tuple[HeadlineNumber, ...]:
    """Worst frequencies of ``poses_of_ends`` in numbers: rigid, nominal, softest."""
    names = dict(zip(ENDS, end_names(today, bands), strict=True))
    names["nominal"] = "nominal"
    return tuple(
        _number(names[end], pairs[end], today, units) for end in ("rigid", "nominal", "softest")
    )


def least_between(pairs: EndPoses, least: float) -> str:
    """Least gain of all ends as a sentence, where it is not the one that was told."""
    both = [(old, new) for old, new in pairs.values() if old and new and old.frequency > 0]
    gain = min((new.frequency / old.frequency - 1 for old, new in both), default=least)
    if percent(gain) == percent(least):
        return ""
    return f" Sought between these poses too, as the three numbers below, it is {percent(gain)}."


def _ends(
    frequencies: FrequencyMap, today: Machine, band: FrequencyBand | None, bands: Bands
) -> dict[str, WorstPose | None]:
    """The worst poses of a machine at both ends of the bands, and with the file's values."""
    poses: dict[str, WorstPose | None] = {"nominal": frequencies.worst}
    for end in ("softest", "rigid"):
        poses[end] = None
        if band is not None:
            known = band.low if end == "softest" else band.high
            soft, payload, link = known.corner
            machine = bands.at_end(frequencies.machine, soft, today)
            with suppress(PoseError):  # unstable between the poses
                workspace = frequencies.workspace
                poses[end] = worst_anywhere(machine, workspace, payload, link, known.starts)
    return poses


def _number(
    name: str, poses: Sequence[WorstPose | None], machine: Machine, units: Units
) -> HeadlineNumber:
    worst = poses[-1]
    if worst is None or any(one is None for one in poses):
        return HeadlineNumber(name=name, value="unstable", words=OVERCOME)
    values = [f"{one.frequency:.3f}" for one in poses if one]
    gain = ""
    if len(poses) == 2 and poses[0] and poses[0].frequency > 0:
        gain = f"{percent(worst.frequency / poses[0].frequency - 1)}: "
    where = f"{worst_pose_text(machine, worst, units)}; limited by {worst.cylinder}"
    return HeadlineNumber(name=name, value=f"{' → '.join(values)}\u00a0Hz", words=gain + where)


# -------------------------------------------------------------------------------- assumptions


def assumptions(machine: Machine, workspace: Workspace) -> tuple[str, ...]:
    """Assumptions behind the frequencies of a machine, as sentences."""
    fluid, bands = machine.fluid, Bands.shown(machine)
    oil = f"Oil of {fluid.bulk_modulus / 1e6:.0f} MPa trapped in both chambers"
    oil += f", with {100 * fluid.air:.2g} % entrained air" if fluid.air else ", without air"
    cases = ", ".join(payload.name for payload in machine.payloads)
    stated = "assumed, the machine file states none" if is_assumed(machine, bands) else "stated"
    yields = [one.name for one in machine.actuators if one.compliance > 0]
    yields += [spring.name for spring in machine.springs]
    structure = f"structure that yields: {', '.join(yields)}" if yields else "rigid structure"
    return (
        f"{oil}; small motions about rest, valves closed; {structure}.",
        f"Worst means: sought between the {len(workspace)} poses ({workspace.kind}) too, each"
        f" cylinder at least {100 * workspace.end_margin:.2g} % of its stroke from its ends, in"
        f" the load cases {cases}, each where it exists; the three numbers each at its own end of"
        " the bands. Maps, percentiles and the table of the bands know the poses alone; what is"
        f" lowest there is called the {LOWEST}.",
        f"Bands of what is not known exactly ({stated}): {widths(machine, bands)}.",
    )
