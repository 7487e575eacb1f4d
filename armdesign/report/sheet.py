"""A table as text, shown in the terminal and in the HTML report.

Numbers are printed in workshop units (mm, bar, l, kN, deg) or in SI.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from armdesign.errors import printable
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.poses import pose_text
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.frequency.worst_frequency import WorstPose
    from armdesign.machine.machine import Machine


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A titled table of printable text; the first column holds words, the others numbers.

    Attributes:
        title: of the table.
        columns: heads; none for a list of names and values.
        rows: cells.
        note: what to know below the table.
        bold: indices of rows that stand out.
        words: heads of further columns with words, which are aligned left and wrapped.
    """

    title: str
    columns: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    bold: tuple[int, ...] = ()
    words: tuple[str, ...] = ("where",)

    def __post_init__(self) -> None:
        """Make all text printable: names in a machine file may hold control characters.

        Raises:
            ValueError: a row has more or fewer cells than there are heads.
        """
        if self.columns and any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError("a row has more or fewer cells than there are heads")
        for name in ("title", "note"):
            object.__setattr__(self, name, printable(getattr(self, name)))
        object.__setattr__(self, "columns", tuple(map(printable, self.columns)))
        rows = tuple(tuple(map(printable, row)) for row in self.rows)
        object.__setattr__(self, "rows", rows)


def worst_pose_text(machine: Machine, worst: WorstPose, units: Units = WORKSHOP) -> str:
    """The worst pose in words: every joint, the load case."""
    return f"{pose_text(machine, worst.q, units)}, payload {worst.payload}"


def limiting_note(machine: Machine, worst: WorstPose) -> str:
    """Note that a spring, motor or dead centre limits; empty where a cylinder's oil does."""
    if dead := worst.dead_centre:
        limits = f"the dead centre of the {dead.cylinder} cylinder limits there"
        return f"{limits}, which no size changes: {dead.remedy}"
    for kind, parts in (("motor", machine.motors), ("spring", machine.springs)):
        if worst.cylinder in [part.name for part in parts]:
            return f"the {worst.cylinder} {kind} limits there, which no search changes"
    return ""


def dimensions(cylinder: Cylinder, units: Units) -> tuple[str, ...]:
    """Bore, rod, stroke and closed length."""
    count = f"{cylinder.count} × " if cylinder.count > 1 else ""
    lengths = (cylinder.bore, cylinder.rod, cylinder.stroke, cylinder.closed_length)
    bore, *others = (units.number(length, "m") for length in lengths)
    return (count + bore, *others)
