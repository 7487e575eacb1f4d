"""What a person reads: sheets of a map, a design, a validation, a comparison, an inspected file.

A ``Sheet`` is a table of words. The terminal and the HTML report show the same sheets. Numbers are printed in workshop
units (mm, bar, l, kN, deg) or in SI.
"""

from __future__ import annotations

import base64
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armdesign.bands import Bands
from armdesign.cylinder import Cylinder, kind, static_pressures
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

    from armdesign.design.optimum import Design
    from armdesign.design.pareto import Pareto
    from armdesign.inspection import Inspection
    from armdesign.linkage import Pin
    from armdesign.machine import Machine
    from armdesign.maps import FrequencyMap, WorstPose
    from armdesign.paper import Erratum, Reproduction
    from armdesign.simulation.validation import Validation
    from armdesign.urdf import Joint
    from armdesign.workspace import Workspace

SLIPPERY = "*"  # marks runs without dry friction
MANY = 9  # columns stand closer together
UNSTABLE = ": unstable, gravity overcomes the trapped oil; is the bulk modulus or the payload right?"


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A titled table of words; the first column is text, the others are numbers. ``bold`` rows stand out."""

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    bold: tuple[int, ...] = ()


def pose_text(machine: Machine, worst: WorstPose, units: Units = WORKSHOP) -> str:
    """The worst pose in words: every joint, the load case."""
    parts = [
        f"{joint.name} {units.text(value, unit_of(joint))}"
        for joint, value in zip(machine.arm.joints, worst.q, strict=True)
    ]
    return f"{', '.join(parts)}, payload {worst.payload}"


def unit_of(joint: Joint) -> str:
    """SI unit of a joint's position."""
    return "rad" if joint.revolute else "m"


# ------------------------------------------------------------------------------------------------------------- maps


def map_sheets(frequencies: FrequencyMap, units: Units = WORKSHOP) -> list[Sheet]:
    """Worst pose, percentiles and the cylinder that limits, of one map."""
    machine, worst = frequencies.machine, frequencies.worst
    reach = float(machine.arm.reach(worst.q[None], worst.tool[None])[0])
    limiting = next(function for function in machine.functions if function.name == worst.cylinder)
    head = Sheet(
        title=f"{machine.section.title or machine.name}: lowest natural frequency",
        rows=(
            ("worst frequency", f"{worst.frequency:.3f} Hz" + (UNSTABLE if worst.frequency == 0 else "")),
            ("at", pose_text(machine, worst, units)),
            ("tool at", f"reach {reach:.2f} m, height {worst.tool[2]:.2f} m"),
            ("limited by", f"{worst.cylinder} {kind(limiting)}"),
        ),
        bold=(0,),
    )
    return [head, spread_sheet({"": frequencies}), _limiting_sheet(frequencies), _stiffness_sheet(frequencies)]


def spread_sheet(maps: dict[str, FrequencyMap]) -> Sheet:
    """Percentiles of the lowest frequency per load case, of one or more maps."""
    rows = []
    for label, frequencies in maps.items():
        for payload, part in frequencies.frame.groupby("payload", sort=False):
            f = part["f1_hz"].to_numpy()
            spread = (f"{value:.3f}" for value in (f.min(), *np.percentile(f, [5, 50, 95])))
            rows.append((f"{label}, {payload}" if label else str(payload), f"{len(f)}", *spread))
    columns = ("payload", "poses", "min", "5 %", "50 %", "95 %")
    return Sheet(title="Lowest coupled frequency over the workspace [Hz]", columns=columns, rows=tuple(rows))


def _limiting_sheet(frequencies: FrequencyMap) -> Sheet:
    frame, rows = frequencies.frame, []
    for cylinder in frequencies.machine.functions:
        limits = frequencies.limiting == cylinder.name
        ratios = []
        for formula in ("locked", "rigid"):
            ratio = (frame[f"{formula}_{cylinder.name}_hz"] / frame["f1_hz"])[limits]
            ratios.append(f"{ratio.median():.2f}" if limits.any() else "–")
        rows.append((cylinder.name, f"{100 * limits.mean():.1f} %", *ratios))
    return Sheet(
        title="Which cylinder limits, and what simpler formulas say there",
        columns=("cylinder", "limits poses", "locked / coupled", "rigid load / coupled"),
        rows=tuple(rows),
        note="medians over the poses that the cylinder limits; 1.00 would be right",
    )


def _stiffness_sheet(frequencies: FrequencyMap) -> Sheet:
    stable = frequencies.frame["f1_hz"].to_numpy() > 0
    shares = 100 * frequencies.stiffness_shares[stable]
    origins = {"hydraulic": "oil", "gravity": "gravity", "geometric": "moment arms under load"}
    rows = [
        (origins[str(part)], *(f"{round(value, 1) + 0.0:+.1f} %" for value in share.quantile((0, 0.5, 1))))
        for part, share in shares.items()
        if len(share)
    ]
    return Sheet(
        title="What the stiffness of the lowest mode is made of",
        columns=("part", "least", "median", "greatest"),
        rows=tuple(rows),
        note="shares of each pose's stiffness, all load cases; negative: it softens; every pose is in stiffness.csv",
    )


# ---------------------------------------------------------------------------------------------------------- designs


def design_sheets(design: Design, units: Units = WORKSHOP) -> list[Sheet]:
    """Gain, sizes and pins, what binds, forces and oil, percentiles, of one design."""
    spread = spread_sheet({"today": design.before, "new": design.after})
    sheets = [_gain(design, units), _sizes(design, units), _binding(design, units), _loads(design, units), spread]
    return [*sheets, *([] if design.bands == Bands() else [_bands(design)])]


def _gain(design: Design, units: Units) -> Sheet:
    before, after = design.before.worst, design.after.worst
    rows = [
        ("today", f"{before.frequency:.3f} Hz", before.cylinder, pose_text(design.today, before, units)),
        ("new", f"{after.frequency:.3f} Hz", after.cylinder, pose_text(design.machine, after, units)),
        ("gain", f"{100 * (after.frequency / before.frequency - 1):+.1f} %", "", ""),
    ]
    own = design.in_own_workspace.worst.frequency
    note = f"within the end margins of its own strokes the new machine's worst is {own:.3f} Hz"
    note += "" if design.problem.bands == Bands() else "; in the worst of the bands"
    note += f"; optimum before rounding {design.unrounded:.3f} Hz"
    note += _bound(design)
    if len(design.starts) > 1:
        note += f"; starts reached {', '.join(f'{f:.3f}' for f in design.starts)} Hz"
    return Sheet(
        title=f"{design.today.section.title or design.today.name}: worst natural frequency in today's workspace",
        columns=("", "frequency", "cylinder", "where"),
        rows=tuple(rows),
        note=note,
        bold=(2,),
    )


def _bands(design: Design) -> Sheet:
    rows = [
        (label, *(f"{frequency:.3f} Hz" for frequency in (band.low.frequency, band.nominal, band.high.frequency)))
        for label, band in (("today", design.band_before), ("new", design.band_after))
    ]
    shares = {"oil": "bulk_modulus", "dead volume": "dead_volume", "payload": "payload", "links": "link_mass"}
    words = [
        f"{word} {low:g} to {high:g} ×" for word, name in shares.items() for low, high in [getattr(design.bands, name)]
    ]
    if design.bands.air:
        words.append("entrained air {:g} to {:g} %".format(*(100 * air for air in design.bands.air)))
    made_for = "" if design.problem.bands == Bands() else "; the new machine was made for the least"
    return Sheet(
        title="Worst frequency within the bands of what is not known exactly",
        columns=("", "least", "as in the file", "greatest"),
        rows=tuple(rows),
        note=f"{', '.join(words)}; on the workspace's poses{made_for}",
        bold=(1,),
    )


def _bound(design: Design) -> str:
    """What no other design exceeds, in words; nothing where no bound is known."""
    if design.certificate is None:
        return ""
    none = "no sizes and pins exceed" if design.problem.moving else "no sizes with these pins exceed"
    gap = f"gap {100 * (design.gap or 0.0):.1f} %"
    if design.selection is not None:
        none = "no combination of the catalogue with these pins exceeds"
        gap = "proved: the best" if (design.gap or 0.0) < 1e-9 else gap
    elif design.catalogue:
        none = "no sizes, of the catalogue or not, and pins exceed"
    rigid = "".join(f", the {name} cylinder taken as rigid" for name in design.certificate.held)
    return f"; {none} {design.bound:.3f} Hz ({gap}){rigid}"


def _sizes(design: Design, units: Units) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for i, new in enumerate(design.machine.cylinders):
        for label, cylinder, machine in (
            (new.name, design.today.cylinders[i], design.today),
            ("→ new", new, design.machine),
        ):
            linkage = machine.linkages[i]
            rows.append((label, *_dimensions(cylinder, units), _pin(linkage.base, units), _pin(linkage.rod_end, units)))
    return Sheet(
        title=f"Cylinders [{units.name('m')}]",
        columns=("cylinder", "bore", "rod", "stroke", "closed", "base pin x, z", "rod-end pin x, z"),
        rows=tuple(rows),
        note="pins in the frames of their links",
        bold=tuple(range(1, len(rows), 2)),
    )


def _dimensions(cylinder: Cylinder, units: Units) -> tuple[str, ...]:
    """Bore, rod, stroke and closed length."""
    count = f"{cylinder.count} × " if cylinder.count > 1 else ""
    lengths = (cylinder.bore, cylinder.rod, cylinder.stroke, cylinder.closed_length)
    bore, *others = (units.number(length, "m") for length in lengths)
    return (count + bore, *others)


def _pin(pin: Pin | None, units: Units) -> str:
    """Its x and z."""
    return f"{units.number(pin.at[0], 'm')}, {units.number(pin.at[2], 'm')}" if pin else "on the knee"


def _binding(design: Design, units: Units) -> Sheet:
    rows = [
        (c.words, units.short(c.value, c.unit), units.short(c.limit, c.unit), f"{100 * design.worth[c.name]:+.2f} %")
        for c in design.binding
    ]
    return Sheet(
        title="What binds, and the frequency that relaxing it by 1 % would buy",
        columns=("requirement", "new machine", "limit", "frequency"),
        rows=tuple(rows) or (("nothing", "", "", ""),),
        note=f"all {len(design.checks)} requirements hold on the machine file, saved and read again; "
        "each gain is for that requirement alone",
    )


def _loads(design: Design, units: Units) -> Sheet:
    both = {"today": (design.today, design.workspace), "new": (design.machine, design.workspace)}
    return loads_sheet(both, design.requirements.digging, units)


def loads_sheet(machines: dict[str, tuple[Machine, Workspace]], digging: Collection[str], units: Units) -> Sheet:
    """Oil, thrust, static pressures and digging force of every cylinder of two machines, on their workspaces.

    Args:
        machines: by label, the one that the other is compared with first.
        digging: cylinders whose digging force counts.
        units: of the numbers.
    """
    from armdesign.design.check import digging_forces, static_loads

    found: dict[str, list[tuple[str, ...]]] = {}
    totals = []
    for label, (machine, workspace) in machines.items():
        loads, forces = static_loads(machine, workspace), digging_forces(machine)
        for i, c in enumerate(machine.cylinders):
            first = "" if c.name in found else c.name
            name = first if label == next(iter(machines)) else f"{first} → {label}".strip()
            pressures = [
                static_pressures(force[i] * sign, c.bore_area, c.annulus_area, machine.supply.return_pressure)[side]
                for force, sign, side in zip(loads, (1, -1), (0, 1), strict=True)
            ]
            cells = (
                units.number(c.bore_area * c.stroke, "m³"),
                units.number(c.annulus_area * c.stroke, "m³"),
                units.number(machine.supply.pressure * c.bore_area, "N", 0),
                *(units.number(float(pressure), "Pa") for pressure in pressures),
                units.number(forces[c.name], "N") if c.name in digging and c.name in forces else "–",
            )
            found.setdefault(c.name, []).append((name, *cells))
        sides = ("bore_area", "annulus_area")
        totals.append([sum(getattr(c, side) * c.stroke for c in machine.cylinders) for side in sides])
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
        note=f"oil in all: cap {cap}, rod {annulus}; cap and rod [{units.name('Pa')}]: largest static pressure of the "
        "loaded chamber",
        bold=tuple(k for k, row in enumerate(rows) if "→" in row[0]),
    )


def pareto_sheet(found: Pareto, units: Units = WORKSHOP) -> Sheet:
    """What the worst frequency costs: a row for each limit, all else over today's."""
    box = found.against == "pin_box"
    digs, first = "digging_share" in found.frame, found.designs[0]
    banded = [f"{first.band_before.low.frequency:.3f} Hz"] if found.robust else []
    rows = [("today", f"{first.before.worst.frequency:.3f} Hz", "", *banded, *3 * ("",), *digs * ("",))]
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
    columns = ["limit", "frequency", "gain", *found.robust * ["in the bands"], "oil", "thrust", *digs * ["digging"]]
    each = "; oil of one cylinder's side at most 1.1 × the limit" if found.against == "oil" else ""
    return Sheet(
        title=f"{found.today.section.title or found.today.name}: worst natural frequency against {found.against}",
        columns=(*columns, "f² × speed"),
        rows=tuple(rows),
        note="; ".join(
            [f"oil, largest thrust, least digging torque and f² × speed over today's{each}", *found.sentences]
        ),
    )


# ------------------------------------------------------------------------------------------------------ validations


def validation_sheet(validations: dict[str, Validation]) -> Sheet:
    """Linear against identified frequencies; one validation per label. What failed is told below the table."""
    from armdesign.simulation.validation import AGREES, Failure

    rows, told = [], []
    for label, validation in validations.items():
        for one in validation.sweeps:
            place, mark = f"{label}, {one.payload}", SLIPPERY if one.dry_friction == "left out" else ""
            name = f"{one.cylinder}{mark}"
            valve = "–" if math.isnan(one.amplitude) else f"{100 * one.amplitude:.2g} %"
            linear = f"{one.linear_frequency:.4f}"
            if isinstance(one, Failure):
                rows.append((place, name, valve, linear, *4 * ("–",), "failed"))
                told.append(f"{place}, {name}: {one.error}")
                continue
            rows.append(
                (
                    place,
                    name,
                    valve,
                    linear,
                    f"{one.identified_frequency:.4f}",
                    f"{100 * one.deviation:+.2f} %",
                    f"{one.linear_damping:.4f}",
                    f"{one.identified_damping:.4f}",
                    one.remark,
                )
            )
    columns = ("pose, load", "cylinder", "valve", "linear", "identified", "deviation", "linear ζ", "ζ", "remark")
    note = (
        "valve: mean opening in the sweep; an open valve adds damping, so ζ falls with it; "
        f"remark: agrees within {100 * AGREES:g} %, or what the deviation is due to: amplitude (falls with it), "
        "friction (gone without dry friction), pressures (of oil with air, behind valves that leak), or a fault"
    )
    if any(run.dry_friction == "left out" for validation in validations.values() for run in validation.runs):
        note += f"; {SLIPPERY}: repeated without dry friction, of which the linear answer knows nothing"
    return Sheet(
        title="Nonlinear simulation: frequency [Hz] and damping fitted to a small slow sweep",
        columns=columns,
        rows=tuple(rows),
        note=". Failed: ".join([note, *told]),
    )


def verdict(validations: Sequence[Validation]) -> str:
    """How many sweeps of how many there are agree, what is said of the others, and how far off they are."""
    runs = [run for validation in validations for run in validation.runs]
    remarks = Counter(run.remark for run in runs)
    agree = remarks.pop("agrees", 0)
    remarks["failed"] = sum(len(validation.failures) for validation in validations)
    others = "".join(f", {count} {remark}" for remark, count in remarks.items() if count)
    smooth = [run for run in runs if run.dry_friction == "left out"]
    largest = [f"{100 * max(abs(run.deviation) for run in some):.2f} %" for some in (runs, smooth) if some]
    far = f"; largest deviation {', without dry friction '.join(largest)}" if largest else ""
    return (
        f"{agree} of all {agree + remarks.total()} sweeps at the worst, the median and the best poses, every cylinder, "
        f"agree{others}{far}"
    )


# ----------------------------------------------------------------------------------------------------- inspections


def check_sheets(inspection: Inspection, units: Units = WORKSHOP) -> list[Sheet]:
    """What a machine file amounts to, and what looks odd in it."""
    return [
        _summary(inspection, units),
        _masses(inspection, units),
        _joints(inspection, units),
        _cylinders(inspection, units),
        *([_motors(inspection, units)] if inspection.machine.motors else []),
        _levers(inspection, units),
        _static_loads(inspection, units),
        _oddities(inspection, units),
    ]


def _summary(inspection: Inspection, units: Units) -> Sheet:
    machine, tool = inspection.machine, inspection.tool
    (near, low), (far, high) = tool.min(axis=0), tool.max(axis=0)
    supply, fluid = machine.supply, machine.fluid
    frozen = [name for name in machine.section.frozen if name not in machine.joints]
    air = f", {100 * fluid.air:g} % air" if fluid.air else ""
    rows = [
        ("joints", ", ".join(machine.joints) + (f"; frozen: {', '.join(frozen)}" if frozen else "")),
        ("tool", f"on {machine.tool.link}; reach {near:.2f} to {far:.2f} m, height {low:.2f} to {high:.2f} m"),
        (
            "supply",
            f"{units.text(supply.pressure, 'Pa')}, return {units.text(supply.return_pressure, 'Pa')}, "
            f"{units.text(supply.flow, 'm³/s')}",
        ),
        ("oil", f"bulk modulus {fluid.bulk_modulus / 1e6:g} MPa{air}, density {fluid.density:g} kg/m³"),
    ]
    return Sheet(title=f"{machine.section.title or machine.name} ({machine.source.name})", rows=tuple(rows))


def _masses(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for link, mass in inspection.masses.items():
        carrier = machine.arm.links[link].joint
        rows.append((f"link {link}", f"{mass:.1f}", machine.joints[carrier] if carrier >= 0 else "stands still"))
    for cylinder in machine.cylinders:
        rows += [(f"{cylinder.name} {bar}", f"{mass:.1f}", "") for bar, mass in cylinder.moving_masses.items()]
    for payload in machine.payloads:
        where = f"on {payload.link}" if payload.link else ""
        if payload.pitch:
            held = 100 * inspection.share_held(payload.name)
            where += f", pitch {units.span(*payload.pitch, 'rad')}: {held:.0f} % of the poses"
        rows.append((f"payload {payload.name}", f"{payload.mass:.1f}", where))
    bare = [c.name for c in machine.cylinders if not c.moving_masses]
    note = f"no mass given for cylinder{'s' if len(bare) > 1 else ''} {', '.join(bare)}" if bare else ""
    return Sheet(title="Masses", columns=("what", "mass [kg]", "where"), rows=tuple(rows), note=note)


def _joints(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for j, joint in enumerate(machine.arm.joints):
        unit = unit_of(joint)
        low, high = machine.ranges[j]
        ends = [inspection.ended_by(j, end) for end in (0, 1)]
        rows.append((joint.name, units.text(low, unit), ends[0], units.text(high, unit), ends[1]))
    return Sheet(
        title="Joint ranges",
        columns=("joint", "from", "ended by", "to", "ended by"),
        rows=tuple(rows),
        note="in, out: that cylinder is at its end stop",
    )


def _cylinders(inspection: Inspection, units: Units) -> Sheet:
    rows = []
    for i, cylinder in enumerate(inspection.machine.cylinders):
        dead, used = units.number(cylinder.dead_length, "m"), f"{100 * inspection.stroke_used(i):.0f} %"
        rows.append((cylinder.name, *_dimensions(cylinder, units), dead, used))
    return Sheet(
        title=f"Cylinders [{units.name('m')}]",
        columns=("cylinder", "bore", "rod", "stroke", "closed", "dead length", "stroke used"),
        rows=tuple(rows),
        note="dead length: closed length less stroke",
    )


def _motors(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for motor in machine.motors:
        drop = machine.supply.pressure - machine.supply.return_pressure
        speed = machine.supply.flow / motor.bore_area
        sides = [units.text(volume, "m³") for volume in (motor.cap_dead_volume, motor.annulus_dead_volume)]
        most = (units.text(motor.bore_area * drop, "N m"), units.text(speed, "rad/s"))
        rows.append((motor.name, motor.joint, f"{motor.gear_ratio:g}", *sides, *most))
    return Sheet(
        title="Motors",
        columns=("motor", "joint", "gear ratio", "oil a", "oil b", "torque at supply", "speed at all the flow"),
        rows=tuple(rows),
    )


def _levers(inspection: Inspection, units: Units) -> Sheet:
    machine, rows = inspection.machine, []
    for lever in inspection.levers:
        joint = machine.arm.joints[lever.joint]
        unit, even = ("m/rad" if joint.revolute else "m/m"), lever.most - lever.least < 1e-9
        cells = []
        for arm, at in ((lever.least, lever.least_at), (lever.most, lever.most_at)):
            where = "everywhere" if even else units.text(at, unit_of(joint))
            cells += [units.number(arm, unit), where]
        rows.append((machine.cylinders[lever.cylinder].name, joint.name, *cells))
    per = f"[{units.name('m/rad')}]"
    return Sheet(
        title="Moment arms",
        columns=("cylinder", "about joint", f"least {per}", "at", f"largest {per}", "at"),
        rows=tuple(rows),
        note="of a sliding joint: cylinder travel per joint travel" if any("everywhere" in row for row in rows) else "",
    )


def _static_loads(inspection: Inspection, units: Units) -> Sheet:
    rows = []
    for load in inspection.loads:
        name = inspection.machine.functions[load.cylinder].name
        side = "cap" if load.cap else "rod"
        share = f"{100 * load.share:.0f} %" if load.share < 10 else "> 1000 %"
        rows.append((name, load.payload, side, units.number(load.pressure, "Pa"), share))
    return Sheet(
        title="Largest static loads over the workspace",
        columns=("cylinder", "payload", "side", f"pressure [{units.name('Pa')}]", "of what holds"),
        rows=tuple(rows),
        note="of what holds: static force over that of supply against return pressure",
    )


def _oddities(inspection: Inspection, units: Units) -> Sheet:
    rows = tuple((finding.part, finding.words) for finding in inspection.findings(units))
    return Sheet(
        title="What looks odd" if rows else "Nothing looks odd",
        rows=rows,
        note="no errors: the file can be used; look at these numbers again" if rows else "",
    )


# -------------------------------------------------------------------------------------------------------- rendering


def rich_table(sheet: Sheet) -> Table:
    """A sheet for the terminal, but for its title and note, which are wider than some tables."""
    from rich import box
    from rich.markup import escape  # a unit in brackets looks like markup
    from rich.table import Table

    table = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1) if len(sheet.columns) < MANY else (0, 1, 0, 0),
        show_header=bool(sheet.columns),
    )
    for index, column in enumerate(sheet.columns or ("", "")):
        words = index == 0 or not sheet.columns or column == "where"
        table.add_column(
            escape(column.replace(" [", "\n[")),
            justify="left" if words else "right",
            no_wrap=column != "where" and bool(sheet.columns),
        )
    for index, row in enumerate(sheet.rows):
        table.add_row(*map(escape, row), style="bold" if index in sheet.bold else None)
    return table


def html(title: str, lead: str, sheets: Sequence[Sheet], pictures: Sequence[tuple[str, Path]]) -> str:
    """One self-contained page: sheets as tables, pictures (caption, PNG file) inside it."""
    import jinja2

    template = Path(__file__).with_name("report.html.j2").read_text(encoding="utf-8")
    images = [(caption, base64.b64encode(path.read_bytes()).decode("ascii")) for caption, path in pictures]
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(template).render(title=title, lead=lead, sheets=sheets, images=images)


def lead(design: Design) -> str:
    """The answer in one sentence."""
    before, after = design.before.worst, design.after.worst
    gain = 100 * (after.frequency / before.frequency - 1)
    dearest = f"; dearest requirement: {design.binding[0].words}" if design.binding else ""
    return (
        f"The worst natural frequency in the workspace goes from {before.frequency:.3f} Hz to {after.frequency:.3f} Hz "
        f"({gain:+.1f} %) with the same joint ranges, oil and thrust limits{dearest}."
    )


# ---------------------------------------------------------------------------------------------------------- the paper


def paper_sheets(found: Reproduction, errata: Sequence[Erratum], scan: pd.DataFrame, bias: pd.DataFrame) -> list[Sheet]:
    """What was chosen, the configurations, what a peak is worth, errors, errata, what gives the printed error."""
    return [
        _paper_choices(found),
        _paper_frequencies(found),
        _sweep_bias(bias),
        _paper_errors(found),
        _paper_errata(errata),
        *_paper_scan(scan),
    ]


def _paper_choices(found: Reproduction) -> Sheet:
    machine, at, sweep = found.machine, found.mechanism, found.sweep
    cylinder, valve, units = machine.cylinders[0], machine.cylinders[0].valve, WORKSHOP
    masses, lengths = np.unique(at.load_mass), np.unique(at.link_length)
    sizes = "/".join(units.number(size, "m") for size in (cylinder.bore, cylinder.rod))
    dead = " and ".join(units.text(v, "m³") for v in (cylinder.cap_dead_volume, cylinder.annulus_dead_volume))
    rows = [
        ("load masses m2", "eight", f"{len(masses)}: {masses[0]:g} to {masses[-1]:g} kg"),
        ("link lengths l2", "five", f"{len(lengths)}: {lengths[0]:g} to {lengths[-1]:g} m"),
        ("pins a1, d1", "–", ", ".join(units.text(float(v), "m") for v in at.pins.values())),
        ("pose", "θ0 = γ = 90 deg", "the same; the piston then stands at mid-stroke"),
        ("cylinder", "asymmetric", f"{sizes} mm, stroke {units.text(cylinder.stroke, 'm')}, dead {dead}"),
        ("supply", "constant", units.text(machine.supply.pressure, "Pa")),
        ("oil", "constant β", f"{machine.fluid.bulk_modulus / 1e6:g} MPa, no air"),
        ("sweep", "a sine sweep", f"{sweep.start:g} to {sweep.stop:g} Hz in {sweep.duration:g} s, open loop"),
        ("its amplitude", "–", f"{100 * sweep.amplitude:g} % of the spool's travel"),
        ("mass in (11)", "average static load", "static force at θ0 / 9.81 m/s²"),
        ("A, V0 in (11), (42)", "symmetric piston", "bore area and its chamber; also the means of both sides"),
    ]
    if valve is not None:
        flow = f"{units.text(valve.rated_flow, 'm³/s')} at {units.text(valve.rated_drop, 'Pa')} per edge"
        rows.insert(5, ("4/3 valve", "commercial", f"{flow}, {valve.natural_frequency:g} Hz"))
    return Sheet(
        title="What the paper gives, and what stands in for the rest",
        columns=("", "the paper", "where"),
        rows=tuple(rows),
        note="no curve of the paper can be reproduced in number: it gives no dimension of anything",
    )


def _paper_frequencies(found: Reproduction) -> Sheet:
    at = found.mechanism
    masses, lengths = np.unique(at.load_mass), np.unique(at.link_length)
    exact, swept = found.computed["joint_exact"], found.swept
    cells = [f"{f:.2f} {100 * (peak / f - 1):+5.1f} %" for f, peak in zip(exact, swept, strict=True)]
    by_place = {(m, n): cell for m, n, cell in zip(at.load_mass, at.link_length, cells, strict=True)}
    worst = float(np.abs(found.identified / exact - 1).max())
    return Sheet(
        title="Exact natural frequency [Hz], and how far off the sweep's highest line is",
        columns=("m2", *(f"l2 = {length:g} m" for length in lengths)),
        rows=tuple((f"{m:g} kg", *(by_place.get((m, n), "") for n in lengths)) for m in masses),
        note=f"fitted at small amplitude: at most {100 * worst:.2g} % off; the sweep made the oil cavitate in "
        f"{found.cavitated} of {len(exact)} and moved the piston by up to "
        f"{1000 * max(abs(one.drift) for one in found.measurements):.0f} mm",
    )


def _sweep_bias(bias: pd.DataFrame) -> Sheet:
    rows = [
        (f"{one.periods:g}", f"{one.damping:g}", *(f"{round(100 * one[name], 2) + 0.0:+.2f} %" for name in BIASES))
        for _, one in bias.iterrows()
    ]
    return Sheet(
        title="What a sweep alone gets wrong: an oscillator's highest point in a spectrum, and the fit",
        columns=("periods in the sweep", "ζ", *BIASES.values()),
        rows=tuple(rows),
        note="a short record ends while it still rings; the position of a long one peaks at √(1 − 2ζ²) of the natural "
        "frequency: a resonance, not a bias; lines as wide as 1/T add up to half of one",
    )


def _paper_errors(found: Reproduction) -> Sheet:
    from armdesign.paper import FORMULAS, PUBLISHED, WAYS

    errors = found.errors
    rows = [(words, *(f"{errors[way][name]:.4g}" for way in WAYS)) for name, words in FORMULAS.items()]
    return Sheet(
        title=f"Root mean square error over the {len(found.swept)} configurations [rad/s]",
        columns=("formula", *WAYS.values()),
        rows=tuple(rows),
        note=f"the paper prints {PUBLISHED:g} rad/s for (11); its value for (42) is missing in our copy",
        bold=(len(rows) - 1,),
    )


def _paper_errata(errata: Sequence[Erratum]) -> Sheet:
    rows = []
    for item in errata:
        cells = ("none", "")
        if item.change is not None:
            low, high = (f"{100 * end:+.2f}" for end in (item.change.min(), item.change.max()))
            cells = (f"{low} %" if low == high else f"{low} to {high} %", f"{item.error:.3g}")
        rows.append((item.equation, item.printed, item.right, *cells))
    return Sheet(
        title="The paper's errata, each by itself: what it does to the frequency",
        columns=("equation", "printed", "right", "change", "rms [rad/s]"),
        rows=tuple(rows),
        note="; ".join(f"{item.equation}: {item.remark}" for item in errata if item.remark) + "; x² = a1² + d1²",
    )


def _paper_scan(scan: pd.DataFrame) -> list[Sheet]:
    """What comes near the printed error, read in its unit and, as the formulas give Hz, in that."""
    from armdesign.paper import PUBLISHED

    head = f"Cylinders and grids that come near the printed {PUBLISHED:g}"
    titles = {
        f"{head} rad/s": PUBLISHED,
        f"{head} if it were Hz, {2 * np.pi * PUBLISHED:.1f} rad/s": 2 * np.pi * PUBLISHED,
    }
    return [_paper_near(scan, title, target) for title, target in titles.items()]


def _paper_near(scan: pd.DataFrame, title: str, target: float) -> Sheet:
    """The three combinations closest to an error [rad/s] by each formula with the static mass."""
    static = ["static_11", "static_12", "static_12_as_printed"]
    off = (scan[static] / target - 1).abs()
    closest = {int(row) for name in static for row in off[name].to_numpy().argsort()[:3]}
    shown = scan.loc[sorted(closest, key=lambda row: float(scan["static_11"].iloc[row]))]
    rows = [
        (
            f"{one.bore_mm:g}/{one.rod_mm:g} × {one.stroke_mm:g}",
            f"{one.dead_volume_l:g}",
            f"{one.bulk_modulus_MPa:g}",
            f"{one.mass_from_kg:g}–{one.mass_to_kg:g}",
            f"{one.length_from_m:g}–{one.length_to_m:g}",
            *(f"{one[name]:.3g}" for name in SCANNED),
        )
        for _, one in shown.iterrows()
    ]
    within = ", ".join(f"{int((off[name] < 0.05).sum())} by {SCANNED[name]}" for name in static)
    return Sheet(
        title=title,
        columns=("cylinder [mm]", "dead [l]", "β [MPa]", "m2 [kg]", "l2 [m]", *SCANNED.values()),
        rows=tuple(rows),
        note=f"root mean square errors [rad/s] against the exact frequency; of {len(scan)} combinations whose load the "
        f"supply holds, within 5 %: {within}",
    )


BIASES = {"speed_peak": "peak of speed", "position_peak": "peak of position", "speed_fit": "fit to speed"}
SCANNED = {
    "static_11": "(11)",
    "static_12": "(12)",
    "static_12_as_printed": "(12) printed",
    "reflected_12": "J/r²",
    "joint_42_as_printed": "(42)",
}
