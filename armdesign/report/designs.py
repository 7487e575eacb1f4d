"""Sheets of a design: what is gained, sizes and pins, what binds, loads; and of trade-offs."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING

from armdesign.frequency.bands import Bands
from armdesign.report.maps import spread_sheet
from armdesign.report.sheet import Sheet, dimensions, pose_text
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.design.design import Design
    from armdesign.design.pareto import Pareto
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.linkage.base import Pin

NEAREST = 6  # requirements shown where none has a price


def design_sheets(design: Design, units: Units = WORKSHOP) -> list[Sheet]:
    """Gain, sizes and pins, what binds, forces and oil, percentiles, of one design."""
    spread = spread_sheet({"today": design.before, "new": design.after})
    sheets = [
        _gain(design, units),
        _sizes(design, units),
        _binding(design, units),
        _loads(design, units),
        spread,
    ]
    return [*sheets, *([] if design.bands == Bands() else [_bands(design)])]


def _gain(design: Design, units: Units) -> Sheet:
    before, after = design.before.worst, design.after.worst
    rows = [
        (
            "today",
            f"{before.frequency:.3f} Hz",
            before.cylinder,
            pose_text(design.today, before, units),
        ),
        (
            "new",
            f"{after.frequency:.3f} Hz",
            after.cylinder,
            pose_text(design.machine, after, units),
        ),
        ("gain", f"{100 * (after.frequency / before.frequency - 1):+.1f} %", "", ""),
    ]
    own = design.in_own_workspace.worst.frequency
    note = f"within the end margins of its own strokes the new machine's worst is {own:.3f} Hz"
    note += "" if design.problem.dynamics.bands == Bands() else "; in the worst of the bands"
    note += f"; optimum before rounding {design.unrounded:.3f} Hz"
    note += _bound(design)
    note += _starts(design)
    return Sheet(
        title=(
            f"{design.today.section.title or design.today.name}: worst natural frequency in"
            " today's workspace"
        ),
        columns=("", "frequency", "cylinder", "where"),
        rows=tuple(rows),
        note=note,
        bold=(2,),
    )


def _starts(design: Design) -> str:
    """What the starts of the search reached and which failed, in words.

    Nothing where there was but one.
    """
    count = len(design.starts) + len(design.failed_starts)
    if count < 2:
        return ""
    free = " with free sizes" if design.catalogue else ""
    words = (
        f"; starts reached {', '.join(f'{f:.3f}' for f in design.starts)} Hz{free}"
        if design.starts
        else ""
    )
    if design.failed_starts:
        whys = "; ".join(dict.fromkeys(design.failed_starts))
        words += f"; {len(design.failed_starts)} of {count} starts failed: {whys}"
    return words


def _bands(design: Design) -> Sheet:
    rows = [
        (
            label,
            *(
                f"{frequency:.3f} Hz"
                for frequency in (band.low.frequency, band.nominal, band.high.frequency)
            ),
        )
        for label, band in (("today", design.band_before), ("new", design.band_after))
    ]
    shares = {
        "oil": "bulk_modulus",
        "dead volume": "dead_volume",
        "payload": "payload",
        "links": "link_mass",
    }
    words = [
        f"{word} {low:g} to {high:g} ×"
        for word, name in shares.items()
        for low, high in [getattr(design.bands, name)]
    ]
    if design.bands.air:
        words.append(
            "entrained air {:g} to {:g} %".format(*(100 * air for air in design.bands.air))
        )
    made_for = (
        ""
        if design.problem.dynamics.bands == Bands()
        else "; the new machine was made for the least"
    )
    return Sheet(
        title="Worst frequency within the bands of what is not known exactly",
        columns=("", "least", "as in the file", "greatest"),
        rows=tuple(rows),
        note=f"{', '.join(words)}; on the workspace's poses{made_for}",
        bold=(1,),
    )


def _bound(design: Design) -> str:
    """What no other design exceeds, in words.

    Nothing where no bound is known, and why where one is refused.
    """
    if design.certificate is None:
        return ""
    if design.bound is None:
        return f"; no bound is known: {design.certificate.refused}"
    none = (
        "no sizes and pins exceed"
        if design.problem.vector.moving
        else "no sizes with these pins exceed"
    )
    gap = f"gap {100 * (design.gap or 0.0):.1f} %"
    if design.selection is not None:
        none = "no combination of the catalogue with these pins exceeds"
        gap = "proved: the best" if (design.gap or 0.0) < 1e-9 else gap
    elif design.catalogue:
        none = "no sizes, of the catalogue or not, and pins exceed"
    below = "" if design.selection is None else _least(design.selection.below)
    rigid = "".join(f", the {name} cylinder taken as rigid" for name in design.certificate.held)
    return f"; {none} {design.bound:.3f} Hz ({gap}){below}{rigid}"


def _least(below: float | None) -> str:
    """That a combination of the catalogue needs least, in words.

    Nothing where that was not asked or is not proved.
    """
    if below is None or math.isinf(below):
        return ""
    return (
        "; none that needs less"
        f" {f'exceeds {below:.3f} Hz' if below > 0 else 'meets the requirements'}"
    )


def _sizes(design: Design, units: Units) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for i, new in enumerate(design.machine.cylinders):
        for label, cylinder, machine in (
            (new.name, design.today.cylinders[i], design.today),
            ("→ new", new, design.machine),
        ):
            linkage = machine.linkages[i]
            rows.append(
                (
                    label,
                    *dimensions(cylinder, units),
                    _pin(linkage.base, units),
                    _pin(linkage.pin("rod_end"), units) or linkage.rod_end_words,
                )
            )
    return Sheet(
        title=f"Cylinders [{units.name('m')}]",
        columns=(
            "cylinder",
            "bore",
            "rod",
            "stroke",
            "closed",
            "base pin x, z",
            "rod-end pin x, z",
        ),
        rows=tuple(rows),
        note="pins in the frames of their links",
        bold=tuple(range(1, len(rows), 2)),
    )


def _pin(pin: Pin | None, units: Units) -> str:
    """Its x and z; nothing where there is none."""
    return f"{units.number(pin.at[0], 'm')}, {units.number(pin.at[2], 'm')}" if pin else ""


def _binding(design: Design, units: Units) -> Sheet:
    if design.selection is not None:
        return _nearest(design, units)
    rows = [
        (
            c.words,
            units.short(c.value, c.unit),
            units.short(c.limit, c.unit),
            f"{100 * design.prices[c.name]:+.2f} %",
        )
        for c in design.binding
    ]
    as_they_are = ", with the sizes as they are" if design.catalogue else ""
    return Sheet(
        title="What binds, and the frequency that relaxing it by 1 % would buy",
        columns=("requirement", "new machine", "limit", "frequency"),
        rows=tuple(rows) or (("nothing", "", "", ""),),
        note=(
            f"all {len(design.checks)} requirements hold on the new machine as its file is read; "
            f"requirements of one setting are relaxed together and share the gain{as_they_are}"
        ),
    )


def _nearest(design: Design, units: Units) -> Sheet:
    """What is nearest to its limit: sizes in steps leave room at every limit, and its price is not known."""
    rows = [
        (
            c.words,
            units.short(c.value, c.unit),
            units.short(c.limit, c.unit),
            f"{100 * c.slack:.2g} %",
        )
        for c in design.tightest[:NEAREST]
    ]
    return Sheet(
        title="What is nearest to its limit",
        columns=("requirement", "new machine", "limit", "room"),
        rows=tuple(rows),
        note=(
            f"all {len(design.checks)} requirements hold on the new machine as its file is read;"
            " sizes of a catalogue come in steps, so 1 % more of one limit buys the next step or"
            " nothing"
        ),
    )


def _loads(design: Design, units: Units) -> Sheet:
    both = {"today": (design.today, design.workspace), "new": (design.machine, design.workspace)}
    return loads_sheet(both, design.requirements.digging, units)


def loads_sheet(
    machines: dict[str, tuple[Machine, Workspace]], digging: Collection[str], units: Units
) -> Sheet:
    """Oil, thrust, static pressures and digging force of every cylinder of two machines, on their workspaces.

    Args:
        machines: by label, the one that the other is compared with first.
        digging: cylinders whose digging force counts.
        units: of the numbers.
    """
    from armdesign.design.requirements.check import digging_forces, static_loads

    found: dict[str, list[tuple[str, ...]]] = {}
    totals = []
    for label, (machine, workspace) in machines.items():
        loads, forces = static_loads(machine, workspace), digging_forces(machine)
        for i, c in enumerate(machine.cylinders):
            first = "" if c.name in found else c.name
            name = first if label == next(iter(machines)) else f"{first} → {label}".strip()
            pressures = [
                c.static_pressures(force[i] * sign, machine.supply)[side]
                for force, sign, side in zip(loads, (1, -1), (0, 1), strict=True)
            ]
            cells = (
                units.number(c.bore_area * c.stroke, "m³"),
                units.number(c.annulus_area * c.stroke, "m³"),
                units.number(machine.supply.pressure * c.bore_area, "N", 0),
                *(units.number(float(pressure), "Pa") for pressure in pressures),
                (
                    units.number(forces[c.name], "N")
                    if c.name in digging and c.name in forces
                    else "–"
                ),
            )
            found.setdefault(c.name, []).append((name, *cells))
        sides = ("bore_area", "annulus_area")
        totals.append(
            [sum(getattr(c, side) * c.stroke for c in machine.cylinders) for side in sides]
        )
    cap, annulus = (
        f"{' → '.join(units.number(v, 'm³') for v in volumes)} {units.name('m³')}"
        for volumes in zip(*totals, strict=True)
    )
    rows = tuple(row for cells in found.values() for row in cells)
    return Sheet(
        title="Oil, thrust, holding, digging",
        columns=(
            "cylinder",
            f"cap oil [{units.name('m³')}]",
            f"rod oil [{units.name('m³')}]",
            f"thrust [{units.name('N')}]",
            f"cap [{units.name('Pa')}]",
            f"rod [{units.name('Pa')}]",
            f"digging [{units.name('N')}]",
        ),
        rows=rows,
        note=(
            f"oil in all: cap {cap}, rod {annulus}; cap and rod [{units.name('Pa')}]: largest"
            " static pressure of the loaded chamber, the other at return pressure or its valve's"
            " preload"
        ),
        bold=tuple(k for k, row in enumerate(rows) if "→" in row[0]),
    )


def pareto_sheet(found: Pareto, units: Units = WORKSHOP) -> Sheet:
    """What the worst frequency costs: a row for each limit, all else over today's."""
    box = found.against == "pin_box"
    digs, first = "digging_share" in found.frame, found.designs[0]
    banded = [f"{first.band_before.low.frequency:.3f} Hz"] if found.robust else []
    rows = [
        ("today", f"{first.before.worst.frequency:.3f} Hz", "", *banded, *3 * ("",), *digs * ("",))
    ]
    for row in found.frame.to_dict("records"):
        shares = [row["oil_share"], row["thrust_share"], *([row["digging_share"]] if digs else [])]
        rows.append(
            (
                units.text(row["limit"], "m") if box else f"{row['limit']:g}",
                f"{row['frequency_hz']:.3f} Hz",
                f"{100 * row['gain']:+.1f} %",
                *([f"{row['banded_hz']:.3f} Hz"] if found.robust else []),
                *(f"{share:.3f}" for share in shares),
                f"{row['squared_times_speed']:.2f}",
            )
        )
    columns = [
        "limit",
        "frequency",
        "gain",
        *found.robust * ["in the bands"],
        "oil",
        "thrust",
        *digs * ["digging"],
    ]
    each = "; oil of one cylinder's side at most 1.1 × the limit" if found.against == "oil" else ""
    return Sheet(
        title=(
            f"{found.today.section.title or found.today.name}: worst natural frequency against"
            f" {found.against}"
        ),
        columns=(*columns, "f² × speed"),
        rows=tuple(rows),
        note="; ".join(
            [
                f"oil, largest thrust, least digging torque and f² × speed over today's{each}",
                *found.sentences,
            ]
        ),
    )


def summary(design: Design) -> str:
    """The answer in one sentence."""
    before, after = design.before.worst, design.after.worst
    gain = 100 * (after.frequency / before.frequency - 1)
    dearest = f"; dearest requirement: {design.binding[0].words}" if design.binding else ""
    return (
        f"The worst natural frequency in the workspace goes from {before.frequency:.3f} Hz to"
        f" {after.frequency:.3f} Hz ({gain:+.1f} %) with the same joint ranges, oil and thrust"
        f" limits{dearest}."
    )
