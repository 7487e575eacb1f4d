"""Sheets of a design: gain, sizes and pins, binding requirements."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from armdesign.report.bands import bands_sheet, is_assumed
from armdesign.report.lift_charts import lift_charts, lift_sheet
from armdesign.report.loads import loads_sheet
from armdesign.report.maps import LOWEST, between_poses, in_hertz, spread_sheet, too_few_poses
from armdesign.report.performance import performance_sheet
from armdesign.report.sheet import Sheet, dimensions, limiting_note, worst_pose_text
from armdesign.units import WORKSHOP, Units, percent, share_text

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.mechanism.linkage.base import Pin

NEAREST = 6  # requirements shown where sizes come in steps


def design_sheets(design: Design, units: Units = WORKSHOP) -> list[Sheet]:
    """Gain, also within bands, sizes and pins, binding requirements, loads and percentiles."""
    both = {"today": (design.today, design.workspace), "new": (design.machine, design.workspace)}
    return [
        *filter(None, [bandwidth_sheet(design)]),
        gain_sheet(design, units),
        bands_of_design(design),
        sizes_sheet(design, units),
        binding_sheet(design, units),
        loads_sheet(both, design.requirements.digging, units),
        performance_sheet({"today": design.today, "new": design.machine}, units),
        lift_sheet(lift_charts({"today": design.today, "new": design.machine}), units),
        spread_sheet({"today": design.before, "new": design.after}),
    ]


def gain_sheet(design: Design, units: Units = WORKSHOP) -> Sheet:
    """Worst frequencies today and new with their poses, and the gain."""
    before, after = design.before.worst, design.after.worst
    pair = (("today", design.today, before), ("new", design.machine, after))
    rows = [
        (label, in_hertz(worst.frequency), worst.cylinder, worst_pose_text(machine, worst, units))
        for label, machine, worst in pair
    ]
    own = design.worst_in_own_workspace.frequency
    between = between_poses({"today": design.before, "new": design.after})
    made_for = {
        "nominal": "all that follows: of the poses; " if between else "",
        "worst": "all that follows: of the poses, in the worst case of the bands; ",
        "gain": "made for the least gain at the corners of the bands, of the poses: ",
        "bandwidth": "made for the least bandwidth; of it, as estimated from frequencies: ",
    }
    notes = [
        *filter(None, [between, too_few_poses(design.before, design.after)]),
        f"in its own workspace the new machine's worst is {in_hertz(own)}",
        f"{made_for[design.made_for]}before rounding {_reached(design, design.unrounded)}",
        *filter(None, [limiting_note(design.machine, after)]),
    ]
    reached = notes_on_starts(design) + _buildability(design)
    title = design.today.section.title or design.today.name
    return Sheet(
        title=f"{title}: worst natural frequency in today's workspace",
        columns=("", "frequency", "cylinder", "where"),
        rows=(*rows, ("gain", percent(design.gain), "", "")),
        note=_vanishing(design) + "; ".join(notes) + _bound(design) + reached,
        bold=(2,),
    )


def bandwidth_sheet(design: Design) -> Sheet | None:
    """Least bandwidths, where they were to be made large; None otherwise."""
    if design.bandwidths is None:
        return None
    today, of_frequency, new = design.bandwidths
    rows = (
        ("today", f"{today:.3f} Hz", ""),
        ("highest worst frequency", f"{of_frequency:.3f} Hz", f"{_percent(of_frequency, today)}"),
        ("new", f"{new:.3f} Hz", f"{_percent(new, today)}"),
    )
    none = ""
    if new == of_frequency:
        none = "; no design has more than the one of the highest worst frequency"
    if new < today:
        none = "; no design has as much as today's machine: for bandwidth, keep that"
    none += ", as far as was found" if none else ""
    return Sheet(
        title="Least bandwidth of the position loops",
        columns=("", "bandwidth", "gain"),
        rows=rows,
        note=(
            "one position gain and one gain of pressure feedback for all joints, at poses and load"
            " cases where today's machine has one; found by a local search, no bound is known"
            f"{none}"
        ),
        bold=(2,),
    )


def _percent(new: float, today: float) -> str:
    return percent(new / today - 1) if today > 0 else ""


def bound_sheet(design: Design) -> Sheet:
    """Result of the search, the upper bound on all designs of its kind, and the gap."""
    if design.certificate is None:
        bound, gap = "none is known", "–"
    elif design.bound is None:
        bound, gap = f"none is known: {design.certificate.refused}", "–"
    else:
        bound, gap = _reached(design, design.bound), f"{100 * (design.gap or 0.0):.1f} %"
    rows = [
        ("reached before rounding", _reached(design, design.unrounded)),
        ("upper bound", bound),
        ("gap", gap),
    ]
    if design.starts:
        words = "starts of the search reached"
        words += ", in real numbers" if design.catalogue else ""
        rows.insert(1, (words, _reached(design, *design.starts)))
    return Sheet(title="", rows=tuple(rows), note=_bound(design).removeprefix("; "))


def _pins_that_stay(design: Design) -> str:
    """Which cylinders keep their pins though pins vary, and why; empty if none does."""
    if not {"pins", "linkages"}.intersection(design.problem.vector.vary):
        return ""
    pairs = zip(design.today.cylinders, design.today.linkages, strict=True)
    names = [cylinder.name for cylinder, linkage in pairs if len(linkage.joints) > 1]
    many = f"; pins of {', '.join(names)} stay: strokes of cylinders across several joints do not"
    return f"{many} follow from them" if names else ""


def _bound(design: Design) -> str:
    """The upper bound, or that none is known; empty of bandwidths."""
    if design.certificate is None:
        return "" if design.made_for == "bandwidth" else "; no bound is known"
    if design.bound is None:
        return f"; no bound is known: {design.certificate.refused}"
    gap = f"gap {100 * (design.gap or 0.0):.1f} %"
    below = ""
    if design.best_sizes is not None:
        designs = "all combinations of the catalogue at these pins"
        gap = "proved optimal" if (design.gap or 0.0) < 1e-9 else gap
        below = _least(design.best_sizes.below)
    elif design.catalogue:
        designs = "all pins and sizes of the catalogue"
    elif design.problem.vector.moving:
        designs = "all sizes and pins"
    else:
        designs = "all sizes at these pins"
    rigid = "".join(f", the {name} cylinder taken as rigid" for name in design.certificate.held)
    bound = _reached(design, design.bound)
    return f"; upper bound for {designs} {bound} ({gap}){below}{rigid}"


def _least(below: float | None) -> str:
    """Note that no smaller amount is enough; empty if not asked for or not proved."""
    if below is None or math.isinf(below):
        return ""
    if below > 0:
        return f"; no smaller amount exceeds {below:.3f} Hz"
    return "; no smaller amount is feasible"


def notes_on_starts(design: Design) -> str:
    """Frequencies that the starts of the search reached, and failures; empty for one start."""
    count = len(design.starts) + len(design.failed_starts)
    if count < 2:
        return ""
    text = ""
    if design.starts:
        free = " in real numbers" if design.catalogue else ""
        text = f"; starts reached {_reached(design, *design.starts)}{free}"
    if design.failed_starts:
        causes = "; ".join(dict.fromkeys(design.failed_starts))
        text += f"; {len(design.failed_starts)} of {count} starts failed: {causes}"
    return text


def _buildability(design: Design) -> str:
    """Words on the gain that a catalogue leaves of that in real numbers; empty without one."""
    both = design.catalogue and design.best_sizes is None and design.starts
    if design.made_for != "gain" or not both:
        return ""
    built, real = (_reached(design, one) for one in (design.judged, max(design.starts)))
    cost = "alike" if built == real else "the difference is what buildability costs"
    return f"; buildable {built}, in real numbers {real}: {cost}"


def _reached(design: Design, *frequencies: float) -> str:
    """Worst frequencies, or the least gains that they stand for where gains were to be large."""
    if design.made_for != "gain":
        return f"{', '.join(f'{f:.3f}' for f in frequencies)} Hz"
    today = design.problem.dynamics.corners.nominal
    gains = [percent(f / today - 1).removesuffix(" %") for f in frequencies]
    return f"{', '.join(gains)} %"


def bands_of_design(design: Design) -> Sheet:
    """Lowest frequencies today and new within the bands of what is not known exactly."""
    made_for = {
        "worst": "; the new machine was designed for the lowest",
        "gain": "; the new machine was designed for the least gain",
        "nominal": "; the new machine was designed for the file's values alone",
        "bandwidth": "; the new machine was designed for the bandwidth with the file's values",
    }
    rows = {"today": design.band_before, "new": design.band_after}
    least = f"; least gain within the bands {percent(design.least_gain)}"
    if math.isinf(design.least_gain):
        least = "; today's machine is unstable throughout: there is no gain over it"
    where = _where_it_is_least(design)
    return bands_sheet(
        design.today, design.bands, rows, f"{made_for[design.made_for]}{least}{where}"
    )


def _where_it_is_least(design: Design) -> str:
    """Where the least gain lies, if not at the corners that the search knew; else empty."""
    if design.made_for != "gain":
        return ""
    ends = _reached(design, design.judged)
    if ends == percent(design.least_gain):
        return ""
    where = "elsewhere than at the corners that it was designed for"
    if percent(design.gain) == percent(design.least_gain):
        where = "at the file's values"
    return f", {where}; at the corners {ends}"


def _vanishing(design: Design) -> str:
    """Loss of a new machine that gains with the file's values; empty without one."""
    if design.least_gain > 0 or design.gain <= 0:
        return ""
    return f"the gain vanishes within the bands: {percent(design.least_gain)} there; "


def sizes_sheet(design: Design, units: Units = WORKSHOP) -> Sheet:
    """Sizes and pins of every cylinder, today and new."""
    rows: list[tuple[str, ...]] = []
    for i, new in enumerate(design.machine.cylinders):
        for label, cylinder, machine in (
            (new.name, design.today.cylinders[i], design.today),
            ("→ new", new, design.machine),
        ):
            linkage = machine.linkages[i]
            base, rod_end = _pin(linkage.base, units), _pin(linkage.pin("rod_end"), units)
            pins = base, rod_end or linkage.rod_end_words
            rows.append((label, *dimensions(cylinder, units), *pins))
    pin_heads = ("base pin x, z", "rod-end pin x, z")
    return Sheet(
        title=f"Cylinders [{units.name('m')}]",
        columns=("cylinder", "bore", "rod", "stroke", "closed", *pin_heads),
        rows=tuple(rows),
        note=f"coordinates of pins in the frames of their links{_pins_that_stay(design)}",
        bold=tuple(range(1, len(rows), 2)),
    )


def _pin(pin: Pin | None, units: Units) -> str:
    """Coordinates x and z of a pin; empty if there is none."""
    return f"{units.number(pin.at[0], 'm')}, {units.number(pin.at[2], 'm')}" if pin else ""


def binding_sheet(design: Design, units: Units = WORKSHOP) -> Sheet:
    """Requirements that bind, with prices; where sizes come in steps those nearest to a limit."""
    if design.best_sizes is None:
        title, head = "Binding requirements; frequency gain per 1 % relaxation", "gain"
        last = [(c, percent(design.prices[c.name], 2)) for c in design.binding]
        fixed = ", with the sizes fixed" if design.catalogue else ""
        why = f"requirements with a common setting are relaxed together and share the gain{fixed}"
    else:
        title, head = "Requirements nearest to their limits", "margin"
        last = [(c, share_text(c.slack)) for c in design.tightest[:NEAREST]]
        why = (
            "sizes of a catalogue come in steps, so relaxing a limit by 1 % permits the next size"
            " or changes nothing"
        )
    rows = [
        (c.words, *(units.short(number, c.unit) for number in (c.value, c.limit)), cell)
        for c, cell in last
    ]
    met = f"all {len(design.checks)} requirements are met by the new machine as read from its file"
    return Sheet(
        title=title,
        columns=("requirement", "new machine", "limit", head),
        rows=tuple(rows) or (("none", "", "", ""),),
        note=f"{met}; {why}",
    )


def summary(design: Design) -> str:
    """The result in one sentence."""
    before, after = design.before.worst, design.after.worst
    limiting = f"; most limiting: {design.binding[0].words}" if design.binding else ""
    if stuck := limiting_note(design.machine, after):
        limiting += f"; {stuck}"
    gain = f" ({percent(design.gain)})" if before.frequency > 0 else ""
    return (
        f"The worst natural frequency in the workspace goes from {in_hertz(before.frequency)} to"
        f" {in_hertz(after.frequency)}{gain} with the same joint ranges, oil and thrust limits;"
        f" {_torques(design)}{_lift(design)}{limiting}.{_throughout(design)}"
    )


def _torques(design: Design) -> str:
    """Largest torques of all actuators, both ways, over today's."""
    from armdesign.design.requirements.performance import torque_shares

    shares = [100 * share for share in torque_shares(design.machine, design.today).values()]
    low, high = np.min(shares), np.max(shares)
    ends = dict.fromkeys(f"{share:.0f}" for share in (low, high))
    return f"the actuators' largest torques are {' to '.join(ends)} % of today's"


def _lift(design: Design) -> str:
    """Least lift of all points of the lift chart over today's, or that none is held."""
    if math.isnan(design.lift_share):
        return ", its lift is held nowhere, as the lift chart has no place"
    return f", its lift is at least {100 * design.lift_share:.0f} % of today's (lift chart)"


def _throughout(design: Design) -> str:
    """Least gain of the new machine within the bands."""
    least = design.least_gain
    low, high = design.band_after.low.frequency, design.band_after.high.frequency
    what = "a gain of at least"
    if least <= 0:
        what = "the gain vanishes there:" if design.gain > 0 else "in the worst case"
    gain = f", {what} {percent(least)}" if math.isfinite(least) else ""
    assumed = ", assumed" if is_assumed(design.today, design.bands) else ""
    return (
        f" Within the bands of what is not known exactly{assumed}, the {LOWEST} has {low:.3f} to"
        f" {high:.3f} Hz{gain}."
    )
