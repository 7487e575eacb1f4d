"""What a person reads: sheets of a map, a design, a validation in workshop units (mm, bar, l, kN, deg).

A ``Sheet`` is a table of words. The terminal and the HTML report show the same sheets.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armdesign.cylinder import static_pressures
from armdesign.units import bar, deg, kN, litre, mm

if TYPE_CHECKING:
    from rich.table import Table

    from armdesign.design.optimum import Design
    from armdesign.design.requirements import Check
    from armdesign.machine import Machine
    from armdesign.maps import FrequencyMap, WorstPose
    from armdesign.simulation.validation import Validation

# how a check's SI unit is shown: factor and unit of the workshop
_WORKSHOP = {"m³": (litre, "l"), "N": (kN, "kN"), "N m": (kN, "kN m"), "m": (mm, "mm"), "rad": (deg, "deg")}
_WORKSHOP |= {"m/rad": (mm, "mm"), "": (1.0, "")}
UNSTABLE = ": unstable, gravity overcomes the trapped oil; is the bulk modulus or the payload right?"


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A titled table of words; the first column is text, the others are numbers. ``bold`` rows stand out."""

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    bold: tuple[int, ...] = ()


def pose_text(machine: Machine, worst: WorstPose) -> str:
    """The worst pose in words: every joint, the load case."""
    parts = [
        f"{joint.name} {value / deg:.1f}°" if joint.revolute else f"{joint.name} {value / mm:.0f} mm"
        for joint, value in zip(machine.arm.joints, worst.q, strict=True)
    ]
    return f"{', '.join(parts)}, payload {worst.payload}"


# ------------------------------------------------------------------------------------------------------------- maps


def map_sheets(frequencies: FrequencyMap) -> list[Sheet]:
    """Worst pose, percentiles and the cylinder that limits, of one map."""
    machine, worst = frequencies.machine, frequencies.worst
    head = Sheet(
        title=f"{machine.section.title or machine.name}: lowest natural frequency",
        rows=(
            ("worst frequency", f"{worst.frequency:.3f} Hz" + (UNSTABLE if worst.frequency == 0 else "")),
            ("at", pose_text(machine, worst)),
            ("tool at", f"reach {worst.tool[0]:.2f} m, height {worst.tool[2]:.2f} m"),
            ("limited by", f"{worst.cylinder} cylinder"),
        ),
        bold=(0,),
    )
    return [head, _spread({"": frequencies}), _limiting_sheet(frequencies)]


def _spread(maps: dict[str, FrequencyMap]) -> Sheet:
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
    for cylinder in frequencies.machine.cylinders:
        limits = frequencies.limiting == cylinder.name
        ratios = []
        for kind in ("locked", "rigid"):
            ratio = (frame[f"{kind}_{cylinder.name}_hz"] / frame["f1_hz"])[limits]
            ratios.append(f"{ratio.median():.2f}" if limits.any() else "–")
        rows.append((cylinder.name, f"{100 * limits.mean():.1f} %", *ratios))
    return Sheet(
        title="Which cylinder limits, and what simpler formulas say there",
        columns=("cylinder", "limits poses", "locked / coupled", "rigid load / coupled"),
        rows=tuple(rows),
        note="medians over the poses that the cylinder limits; 1.00 would be right",
    )


# ---------------------------------------------------------------------------------------------------------- designs


def design_sheets(design: Design) -> list[Sheet]:
    """Gain, sizes and pins, what binds, forces and oil, percentiles, of one design."""
    spread = _spread({"today": design.before, "new": design.after})
    return [_gain(design), _sizes(design), _binding(design), _loads(design), spread]


def _gain(design: Design) -> Sheet:
    before, after = design.before.worst, design.after.worst
    rows = [
        ("today", f"{before.frequency:.3f} Hz", before.cylinder, pose_text(design.today, before)),
        ("new", f"{after.frequency:.3f} Hz", after.cylinder, pose_text(design.machine, after)),
        ("gain", f"{100 * (after.frequency / before.frequency - 1):+.1f} %", "", ""),
    ]
    note = f"optimum before rounding {design.unrounded:.3f} Hz"
    if design.bound is not None:
        note += f"; no sizes with these pins exceed {design.bound:.3f} Hz"
    if len(design.starts) > 1:
        note += f"; starts reached {', '.join(f'{f:.3f}' for f in design.starts)} Hz"
    return Sheet(
        title=f"{design.today.section.title or design.today.name}: worst natural frequency in today's workspace",
        columns=("", "frequency", "cylinder", "where"),
        rows=tuple(rows),
        note=note,
        bold=(2,),
    )


def _sizes(design: Design) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for i, new in enumerate(design.machine.cylinders):
        for label, cylinder, machine in (
            (new.name, design.today.cylinders[i], design.today),
            ("→ new", new, design.machine),
        ):
            linkage = machine.linkages[i]
            pins = [
                f"{pin.at[0] / mm:.1f}, {pin.at[2] / mm:.1f}" if pin else "on the knee"
                for pin in (linkage.base, linkage.rod_end)
            ]
            count = f"{cylinder.count} × " if cylinder.count > 1 else ""
            bore, rod = (f"{length / mm:.1f}" for length in (cylinder.bore, cylinder.rod))
            ends = (f"{length / mm:.1f}" for length in (cylinder.stroke, cylinder.closed_length))
            rows.append((label, count + bore, rod, *ends, *pins))
    return Sheet(
        title="Cylinders [mm]",
        columns=("cylinder", "bore", "rod", "stroke", "closed", "base pin x, z", "rod-end pin x, z"),
        rows=tuple(rows),
        note="pins in the frames of their links",
        bold=tuple(range(1, len(rows), 2)),
    )


def _shown(check: Check, value: float) -> str:
    factor, unit = _WORKSHOP[check.unit]
    return f"{value / factor:.4g} {unit}".rstrip()


def _binding(design: Design) -> Sheet:
    rows = [
        (c.words, _shown(c, c.value), _shown(c, c.limit), f"{100 * design.worth[c.name]:+.2f} %")
        for c in design.binding
    ]
    return Sheet(
        title="What binds, and the frequency that relaxing it by 1 % would buy",
        columns=("requirement", "new machine", "limit", "frequency"),
        rows=tuple(rows) or (("nothing", "", "", ""),),
        note=f"all {len(design.checks)} requirements hold on the machine file, saved and read again",
    )


def _loads(design: Design) -> Sheet:
    from armdesign.design.requirements import digging_forces, static_loads

    rows: list[tuple[str, ...]] = []
    machines = {"today": design.today, "new": design.machine}
    loads = {label: static_loads(machine, design.workspace) for label, machine in machines.items()}
    digging = {label: digging_forces(machine) for label, machine in machines.items()}
    for i, cylinder in enumerate(design.machine.cylinders):
        for label, machine in machines.items():
            c, returned = machine.cylinders[i], machine.supply.return_pressure
            pressures = [
                static_pressures(force[i] * sign, c.bore_area, c.annulus_area, returned)[side]
                for force, sign, side in zip(loads[label], (1, -1), (0, 1), strict=True)
            ]
            force = digging[label].get(c.name)
            rows.append(
                (
                    cylinder.name if label == "today" else "→ new",
                    f"{c.bore_area * c.stroke / litre:.2f}",
                    f"{c.annulus_area * c.stroke / litre:.2f}",
                    f"{machine.supply.pressure * c.bore_area / kN:.0f}",
                    f"{pressures[0] / bar:.0f}",
                    f"{pressures[1] / bar:.0f}",
                    "–" if force is None or c.name not in design.requirements.digging else f"{force / kN:.1f}",
                )
            )
    totals = [
        [sum(getattr(c, side) * c.stroke for c in machine.cylinders) / litre for machine in machines.values()]
        for side in ("bore_area", "annulus_area")
    ]
    cap, annulus = (f"{old:.2f} → {new:.2f}" for old, new in totals)
    return Sheet(
        title="Oil, thrust, holding, digging",
        columns=("cylinder", "cap oil [l]", "rod oil [l]", "thrust [kN]", "cap [bar]", "rod [bar]", "digging [kN]"),
        rows=tuple(rows),
        note=f"oil in all: cap {cap} l, rod {annulus} l; bar: largest static pressure of the loaded chamber",
        bold=tuple(range(1, len(rows), 2)),
    )


# ------------------------------------------------------------------------------------------------------ validations


def validation_sheet(validations: dict[str, Validation]) -> Sheet:
    """Linear against identified frequencies; one validation per label."""
    rows = []
    for label, validation in validations.items():
        for run in validation.runs:
            rows.append(
                (
                    f"{label}, payload {run.payload}",
                    run.cylinder,
                    f"{100 * run.amplitude:.2g} %",
                    f"{run.linear_frequency:.4f}",
                    f"{run.identified_frequency:.4f}",
                    f"{100 * run.deviation:+.2f} %",
                    f"{run.linear_damping:.4f}",
                    f"{run.identified_damping:.4f}",
                )
            )
    columns = ("pose", "cylinder", "valve", "linear", "identified", "deviation", "linear ζ", "ζ")
    return Sheet(
        title="Nonlinear simulation: frequency [Hz] and damping fitted to a small slow sweep",
        columns=columns,
        rows=tuple(rows),
        note="valve: mean opening in the sweep; an open valve adds damping, so ζ falls with it",
    )


# -------------------------------------------------------------------------------------------------------- rendering


def rich_table(sheet: Sheet) -> Table:
    """A sheet for the terminal."""
    from rich import box
    from rich.table import Table

    table = Table(
        title=sheet.title,
        caption=sheet.note or None,
        box=box.SIMPLE_HEAD,
        title_justify="left",
        caption_justify="left",
        title_style="bold",
        pad_edge=False,
        show_header=bool(sheet.columns),
    )
    for index, column in enumerate(sheet.columns or ("", "")):
        words = index == 0 or not sheet.columns or column == "where"
        table.add_column(
            column, justify="left" if words else "right", no_wrap=column != "where" and bool(sheet.columns)
        )
    for index, row in enumerate(sheet.rows):
        table.add_row(*row, style="bold" if index in sheet.bold else None)
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
