"""Words beside a drawn machine: pins, joints, pose, faults, sizes of cylinders."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from armdesign.drawing.colours import actuator_colours
from armdesign.drawing.side_view import SideView
from armdesign.machine.poses import pose_text
from armdesign.plots.canvas import INK, MARK, below
from armdesign.plots.labels import Label
from armdesign.units import WORKSHOP, mm

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine
    from armdesign.plots.canvas import Axes

IDLE = "#9ca3af"  # colour of what is frozen


def pose_words(machine: Machine, view: SideView) -> str:
    """Positions of all joints of the first pose, in degrees and mm."""
    q = view.coordinates[0][: len(machine.arm.joints)]
    return number(pose_text(machine, q, WORKSHOP))


def faults(view: SideView) -> list[str]:
    """Faults of a drawn pose: pins out of place, cylinders out of their stroke."""
    words = [f"{name} lies outside the outline of its link" for name in view.stray_pins]
    for shape, length, wrong in zip(
        view.cylinders, view.lengths[0], view.out_of_stroke[0], strict=True
    ):
        if wrong and np.isnan(length):
            words.append(f"{shape.name}: its four-bar does not close in this pose")
        elif wrong:
            longest = shape.closed_length + shape.stroke
            short = length < shape.closed_length
            by = shape.closed_length - length if short else length - longest
            words.append(
                f"{shape.name}: pin to pin {length / mm:.0f} mm, {by / mm:.0f} mm"
                f" {'below its closed' if short else 'beyond its open'} length"
            )
    return words


def pin_labels(machine: Machine, view: SideView) -> list[Label]:
    """A label for every pin: its link and coordinates in the link's frame."""
    colours, labels = actuator_colours(machine), []
    flat = all(pin.at is None or abs(pin.at[1]) < 1e-9 for pin in view.pins)
    for pin, at in zip(view.pins, view.points[0], strict=True):
        colour = MARK if pin.name in view.stray_pins else colours[pin.name.rpartition(".")[0]]
        below = "rocker meets coupler"
        if pin.at is not None:
            shown = (pin.at[0], pin.at[2]) if flat else pin.at
            numbers = number(", ".join(f"{value / mm:.1f}" for value in shown))
            below = f"{pin.link}: {numbers} mm"
        labels.append(Label(at=at, head=pin.name, below=below, colour=colour))
    return labels


def joint_labels(machine: Machine, view: SideView) -> list[Label]:
    """A label for every joint: its range, and whether it slews or moves out of the plane."""
    lines = {arc.joint: line for arc, line in zip(view.arcs, view.arc_lines(), strict=True)}
    labels = []
    for index, (joint, span) in enumerate(
        zip(machine.arm.joints, machine.known_ranges, strict=True)
    ):
        low, high = WORKSHOP.number(span[0], joint.unit), WORKSHOP.text(span[1], joint.unit)
        line = lines.get(joint.name)
        at = view.pivots[0, index] if joint.revolute or line is None else line[-1]
        below = number(f"range {low} to {high}")
        if line is None:
            slews = index in machine.arm.slews
            below = f"{'slews' if slews else 'out of plane'}, {below}"
        labels.append(Label(at=at, head=f"joint {joint.name}", below=below, colour=INK))
    return labels


def ends(machine: Machine, view: SideView) -> list[Label]:
    """Labels of the tool, with its reach and height, and of loads."""
    arm, z = machine.arm, view.coordinates[:1]
    tool = arm.point(arm.kinematics(z), machine.tool.link, np.array(machine.tool.at))
    reach, height = float(machine.heading.reach(z, tool)[0]), tool[0, 2]
    there = {
        name: bool(np.hypot(*(places[0] - view.tool[0])) < 1e-3)
        for name, places in view.loads.items()
    }
    head = ", ".join(["tool", *(f"payload {name}" for name in there if there[name])])
    place = number(f"{reach:.3f}, {height:.3f} m")
    apart = [
        Label(at=places[0], head=f"payload {name}", below="", colour=INK)
        for name, places in view.loads.items()
        if not there[name]
    ]
    return [Label(at=view.tool[0], head=head, below=place, colour=MARK), *apart]


def sizes_legend(ax: Axes, machines: Sequence[Machine]) -> None:
    """Legend of the colours: actuators with their sizes, of each machine, and what is frozen."""
    handles, frozen = [], machines[-1].idle
    for name, colour in actuator_colours(machines[-1]).items():
        sizes = [text for machine in machines if (text := _sizes(machine, name))]
        distinct = list(dict.fromkeys(sizes))
        label = f"{name}: {' → '.join(distinct)}" if distinct else name
        label, paint = (f"{label}, frozen", IDLE) if name in frozen else (label, colour)
        handles += ax.fill([np.nan], [np.nan], fc=paint, ec=INK, lw=0.7, label=label)
    place = {"bbox_to_anchor": (0.0, 0.0), "bbox_transform": below(ax, 0.42)}
    ax.legend(handles=handles, ncols=2, loc="upper left", borderaxespad=0, **place)


def _sizes(machine: Machine, name: str) -> str:
    """Number, bore, rod and stroke of a cylinder in words; empty for what is none."""
    table = machine.section.cylinder.get(name)
    if table is None:
        return "motor" if name in machine.section.motor else ""
    count = f"{table.count} × " if table.count > 1 else ""
    return f"{count}Ø{table.bore_mm:g}/{table.rod_mm:g} × {table.stroke_mm:g} mm"


def number(text: str) -> str:
    """Numbers in words with minus signs instead of hyphens."""
    return text.replace("-", "−")
