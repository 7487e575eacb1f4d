"""Sheets of what data sheets state: torques, stroke times and joint speeds; reach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.mechanism.linkage.base import follows
from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.design.requirements.performance import Performance
    from armdesign.machine.machine import Machine


TOOL = "tool"  # part of the figures of reach, which come last
TOOL_FORCE = "force at the tool, extending (ISO 6015)"
AT_TOOL = (  # to a note where there is one
    "; force at the tool: of one cylinder alone at its best angle, joints further out where their"
    " own cylinders dig best, those without at the middle of their ranges"
)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Numbers [unit, SI] that stand in one row of a data sheet, or none of them."""

    part: str
    words: str
    keys: tuple[str, ...]  # of the numbers, in a CSV file
    unit: str
    values: tuple[float, ...] | None


def figures(machine: Machine) -> list[Figure]:
    """Torques, stroke times, joint speeds and tool force of every actuator, and the reach."""
    from armdesign.design.requirements.check import digging_forces
    from armdesign.design.requirements.performance import performances

    forces, rows = digging_forces(machine), []
    for performance in performances(machine):
        rows += _of_actuator(machine, performance)
        name = machine.actuators[performance.actuator].name
        if name in forces:
            keys = ("tool_force",)
            rows.append(
                Figure(part=name, words=TOOL_FORCE, keys=keys, unit="N", values=(forces[name],))
            )
    return rows + _of_reach(machine)


def _of_actuator(machine: Machine, at: Performance) -> list[Figure]:
    joint, drive = machine.arm.joints[at.joint], machine.drives[at.actuator]
    name = machine.actuators[at.actuator].name
    part = f"{name}.{joint.name}" if len(drive.joints) > 1 else name
    word, unit = ("torque", "N m") if joint.revolute else ("force", "N")
    speed_unit = "rad/s" if joint.revolute else "m/s"
    both = ("extending", "retracting")
    numbers: list[tuple[str, str, str, Array]] = [
        (f"largest {word}", f"{word}_largest", unit, at.largest),
        (f"{word} at the lower end", f"{word}_lower_end", unit, at.torque[:, 0]),
        (f"{word} at the upper end", f"{word}_upper_end", unit, at.torque[:, -1]),
        ("stroke time", "stroke_time", "s", at.stroke_time),
        ("least joint speed", "joint_speed_least", speed_unit, at.speed.min(axis=1)),
        ("largest joint speed", "joint_speed_largest", speed_unit, at.speed.max(axis=1)),
    ]
    if follows(machine.drives, at.actuator, at.joint):  # another's flow moves the joint
        del numbers[4:]
    return [
        Figure(
            part=part,
            words=words,
            keys=tuple(f"{key}_{direction}" for direction in both),
            unit=unit,
            values=(float(values[0]), float(values[1])),
        )
        for words, key, unit, values in numbers
    ]


def _of_reach(machine: Machine) -> list[Figure]:
    from armdesign.inspection.reach_figures import reach_figures

    words = {
        "reach": "largest reach",
        "reach_at_ground": "largest reach at height 0",
        "depth": "largest depth below height 0",
        "height": "largest height",
        "dump_height": "dump height",
    }
    return [
        Figure(
            part=TOOL,
            words=words[key],
            keys=(key,),
            unit="m",
            values=None if value is None or (key == "depth" and value < 0) else (value,),
        )
        for key, value in vars(reach_figures(machine)).items()
    ]


def performance_sheet(machines: Mapping[str, Machine], units: Units = WORKSHOP) -> Sheet:
    """Figures of machines side by side, of two with the ratio of the second to the first."""
    rows: dict[tuple[str, str], list[Figure | None]] = {}
    for index, machine in enumerate(machines.values()):
        for figure in figures(machine):
            row = rows.setdefault((figure.part, figure.words), [None] * len(machines))
            row[index] = figure
    cells, last = [], ""
    for (part, words), row in sorted(rows.items(), key=lambda row: row[0][0] == TOOL):
        numbers = [_cell(figure, units) for figure in row]
        known = next(figure for figure in row if figure is not None)
        head = words + (f" [{units.name(known.unit)}]" if units.name(known.unit) else "")
        ratio = [_ratio(row)] if len(row) == 2 else []
        cells.append((part if part != last else "", head, *numbers, *ratio))
        last = part
    return Sheet(
        title="Torques, stroke times and reach",
        columns=("part", "figure", *machines, *(["ratio"] if len(machines) == 2 else [])),
        rows=tuple(cells),
        words=("figure",),
        note=(
            "pairs: extending, retracting; at supply pressure (or a lower relief's), and with all"
            " of the pump's flow for one actuator; stroke times of whole strokes, also where joint"
            " limits leave less; reach over the full strokes, heights over the root's origin; dump"
            " height: of the tool straight below the last joint that turns it"
            f"{AT_TOOL if any(TOOL_FORCE in row[1] for row in cells) else ''}"
        ),
    )


def _cell(figure: Figure | None, units: Units) -> str:
    if figure is None or figure.values is None:
        return "–"
    return ", ".join(units.numbers(figure.values, figure.unit))


def _ratio(row: Sequence[Figure | None]) -> str:
    first, second = (figure and figure.values for figure in row)
    if not first or not second:
        return "–"
    pairs = zip(second, first, strict=True)
    return ", ".join(f"{b / a:.3f}" if a and np.isfinite(a) else "–" for b, a in pairs)
