"""A table of words, shown alike in the terminal and in the HTML report.

Numbers are printed in workshop units (mm, bar, l, kN, deg) or in SI.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from armdesign.errors import printable
from armdesign.hydraulics.actuator import Cylinder
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from rich.table import Table

    from armdesign.frequency.worst_frequency import WorstPose
    from armdesign.machine.machine import Machine
    from armdesign.mechanism.urdf import Joint

MANY = 9  # columns stand closer together


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A titled table of words, made printable; the first column is text, the others are numbers.

    ``bold`` rows stand out.
    """

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    bold: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Words of a machine file may hold control characters.

        No reader shall take them for commands.
        """
        words = {name: printable(getattr(self, name)) for name in ("title", "note")}
        columns, rows = (
            tuple(map(printable, self.columns)),
            tuple(tuple(map(printable, row)) for row in self.rows),
        )
        for name, value in {**words, "columns": columns, "rows": rows}.items():
            object.__setattr__(self, name, value)


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


def dimensions(cylinder: Cylinder, units: Units) -> tuple[str, ...]:
    """Bore, rod, stroke and closed length."""
    count = f"{cylinder.count} × " if cylinder.count > 1 else ""
    lengths = (cylinder.bore, cylinder.rod, cylinder.stroke, cylinder.closed_length)
    bore, *others = (units.number(length, "m") for length in lengths)
    return (count + bore, *others)


def rich_table(sheet: Sheet) -> Table:
    """A sheet for the terminal, but for its title and note, which are wider than some tables."""
    from rich import box
    from rich.table import Table
    from rich.text import Text  # a unit in brackets looks like markup

    table = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1) if len(sheet.columns) < MANY else (0, 1, 0, 0),
        show_header=bool(sheet.columns),
    )
    for index, column in enumerate(sheet.columns or ("", "")):
        words = index == 0 or not sheet.columns or column == "where"
        table.add_column(
            Text(column.replace(" [", "\n[")),
            justify="left" if words else "right",
            no_wrap=column != "where" and bool(sheet.columns),
        )
    for index, row in enumerate(sheet.rows):
        table.add_row(*map(Text, row), style="bold" if index in sheet.bold else None)
    return table


def html(
    title: str, lead: str, sheets: Sequence[Sheet], pictures: Sequence[tuple[str, Path]]
) -> str:
    """One self-contained page: sheets as tables, pictures (caption, PNG file) inside it."""
    import jinja2

    template = Path(__file__).with_name("page.html.j2").read_text(encoding="utf-8")
    images = [
        (caption, base64.b64encode(path.read_bytes()).decode("ascii"))
        for caption, path in pictures
    ]
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    return environment.from_string(template).render(
        title=printable(title), lead=printable(lead), sheets=sheets, images=images
    )
