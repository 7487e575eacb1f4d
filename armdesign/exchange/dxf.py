"""A machine as DXF in mm: the side view at one pose, and beside it a sheet of pins for each link.

In the model space the machine stands at its pose, forward to the right. Every link with pins is a
block ``link_<name>`` in its own frame, x to the right and z up, inserted below: what a drawing of
the link begins with. Characters that no block may have in its name are "_" there. The only door to
ezdxf.
"""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array
from armdesign.drawing.joint_arcs import middle_pose
from armdesign.drawing.side_view import SideView, side_view
from armdesign.errors import ArmDesignError, printable
from armdesign.exchange.pin_table import pin_table
from armdesign.machine.poses import joint_positions
from armdesign.units import deg, mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.machine.machine import Machine

LAYERS = {  # name: colour of the DXF palette, linetype
    "LINKS": (8, "CONTINUOUS"),
    "CYLINDERS": (5, "CONTINUOUS"),
    "BARS": (3, "CONTINUOUS"),
    "PINS": (1, "CONTINUOUS"),
    "CENTRE_LINES": (6, "CENTER"),
    "NAMES": (7, "CONTINUOUS"),
    "FRAMES": (9, "CONTINUOUS"),
}
TEXT, MARK = 1 / 110, 1 / 160  # height of texts and radius of circles, over the drawn size
WIDTH = 1.4  # of a row of sheets, over the drawn size
CROWD = np.array([14, 4.5])  # text heights along x and z within which texts of two pins meet
STEEP = 0.3  # of a cylinder that words beside its pin do not meet: across over along
FORBIDDEN = re.compile(r'[<>/\\":;?*|,=`]')  # in names of blocks, which are equal in any case
REMARK = "circles mark places of pins, not their sizes; mm"


def write_dxf(machine: Machine, path: Path, pose: ArrayLike | None = None) -> Path:
    """Write a machine at a pose q (nq,) [rad, m] as DXF; default: the middle of the ranges.

    Raises:
        ArmDesignError: ezdxf is not installed, or not one number per joint.
    """
    try:
        from ezdxf.filemanagement import new
    except ImportError:
        remedy = "install armdesign[dxf]"
        raise ArmDesignError("DXF", "needs the package ezdxf", remedy) from None
    q = joint_positions(machine, middle_pose(machine) if pose is None else pose)[:1]
    document = new("R2010", setup=["linetypes"], units=4)  # 4: millimetres
    for name, (colour, line) in LAYERS.items():
        document.layers.add(name, color=colour, linetype=line)
    table, view = pin_table(machine, q[0]), side_view(machine, q)
    sheet = _ScaledSpace(document.modelspace(), view.size / mm)
    document.header["$LTSCALE"] = sheet.text
    _draw_machine(sheet, f"{machine.section.title or machine.name}: {_pose(machine, q[0])}", view)
    _draw_links(sheet, document, table, _corners(view)[0])
    document.saveas(path)
    return path


class _ScaledSpace:
    """A layout or block to draw in, with heights of texts and radii of circles [mm]."""

    def __init__(self, space: Any, size: float) -> None:
        self.space, self.size = space, size
        self.text, self.mark = size * TEXT, size * MARK

    def on(self, space: Any) -> _ScaledSpace:
        """Another space with the same heights and radii."""
        return _ScaledSpace(space, self.size)

    def line(self, points: ArrayLike, layer: str, close: bool = False) -> None:
        """A line through points (m, 2) [mm]."""
        corners = np.asarray(points, dtype=float)
        if np.all(np.isfinite(corners)):
            self.space.add_lwpolyline(corners.tolist(), close=close, dxfattribs={"layer": layer})

    def pin(self, at: Array, texts: list[str], shift: float = 0.0, side: int = 1) -> None:
        """A pin at a place (2,) [mm]: circle, centre lines, texts, shifted by so many lines.

        They are to its right, or to its left (``side`` −1).
        """
        x, y = at.tolist()
        self.space.add_circle((x, y), self.mark, dxfattribs={"layer": "PINS"})
        long = 2 * self.mark
        self.line([(x - long, y), (x + long, y)], "CENTRE_LINES")
        self.line([(x, y - long), (x, y + long)], "CENTRE_LINES")
        for row, text in enumerate(texts):
            up = self.mark + 1.5 * (shift - row) * self.text
            self.words(text, (x + side * long, y + up), ends=side < 0)

    def words(
        self, text: str, at: tuple[float, float], height: float = 1.0, ends: bool = False
    ) -> None:
        """A text that begins or ``ends`` at a place [mm], as high as a share of the usual."""
        attributes: dict[str, Any] = {"layer": "NAMES", "height": height * self.text, "insert": at}
        if ends:
            attributes |= {"halign": 2, "align_point": at}
        self.space.add_text(text, dxfattribs=attributes)


def _draw_machine(sheet: _ScaledSpace, title: str, view: SideView) -> None:
    """Title, outlines, cylinders between their pins, bars, pins and joints at the pose."""
    for body in view.polygons():
        for corners in body:
            sheet.line(corners / mm, "LINKS", close=True)
    for shape, (barrel, rod) in zip(view.cylinders, view.barrel_and_rod(), strict=True):
        sheet.line(view.points[0, list(shape.ends)] / mm, "CENTRE_LINES")
        for corners in (barrel, rod):
            sheet.line(corners / mm, "CYLINDERS", close=True)
    for bar in view.bars:
        sheet.line(view.points[0, list(bar.ends)] / mm, "BARS")
    places: dict[tuple[float, float], tuple[Array, list[str]]] = {}  # by 0.1 mm
    named = [pin.name for pin in view.pins], view.joints
    for names, points in zip(named, (view.points[0], view.pivots[0]), strict=True):
        for name, at in zip(names, points / mm, strict=True):
            if np.all(np.isfinite(at)):
                places.setdefault((round(at[0], 1), round(at[1], 1)), (at, []))[1].append(name)
    ways = _ways(view)
    for place, texts in places.values():
        sheet.pin(place, [", ".join(texts)], side=-1 if ways & set(texts) else 1)
    left, top = _corners(view)[0][0], _corners(view)[1][1]
    sheet.words(title, (left, top + 6 * sheet.text), 1.6)
    sheet.words(REMARK, (left, top + 4 * sheet.text))


def _ways(view: SideView) -> set[str]:
    """Names of pins from which a cylinder leads to the right, where their words would be."""
    names = set[str]()
    for shape in view.cylinders:
        along = np.diff(view.points[0, list(shape.ends)], axis=0)[0]
        if abs(along[0]) > STEEP * abs(along[1]):
            names.add(view.pins[shape.ends[int(along[0] < 0)]].name)
    return names


def _pose(machine: Machine, q: Array) -> str:
    """A pose (nq,) in words, in deg and mm."""
    return ", ".join(
        f"{joint.name} {x / deg:.1f} deg" if joint.revolute else f"{joint.name} {x / mm:.0f} mm"
        for joint, x in zip(machine.arm.joints, q, strict=True)
    )


def _corners(view: SideView) -> tuple[Array, Array]:
    """Lower left and upper right corner (2,) of what is drawn [mm]."""
    drawn = [corners for body in view.polygons() for corners in body]
    points = np.concatenate([*drawn, view.points[0], view.pivots[0], view.tool[:1]]) / mm
    return np.nanmin(points, axis=0), np.nanmax(points, axis=0)


def _draw_links(sheet: _ScaledSpace, document: Any, table: pd.DataFrame, corner: Array) -> None:
    """A block of pins in its own frame for each link, inserted in rows below a corner (2,)."""
    (left, top), lowest = corner, corner[1]
    names = set[str]()
    for link, rows in table[table["link"] != ""].groupby("link", sort=False):
        places = rows[["x_mm", "z_mm"]].to_numpy(dtype=float)
        if len(np.unique(places, axis=0)) < 2:
            continue
        low, high = places.min(axis=0), places.max(axis=0)
        width = max(high[0] - low[0], 30 * sheet.text) + 25 * sheet.text
        if left > corner[0] and left + width > corner[0] + WIDTH * sheet.size:
            left, top = corner[0], lowest
        name = _block_name(str(link), names)
        _draw_link(sheet.on(document.blocks.new(name)), str(link), rows, (low, high))
        insert = (left - low[0], top - high[1] - 10 * sheet.text)
        sheet.space.add_blockref(name, insert, dxfattribs={"layer": "LINKS"})
        left += width
        lowest = min(lowest, insert[1] + low[1] - 8 * sheet.text)


def _block_name(link: str, taken: set[str]) -> str:
    """Name of a link's block, numbered where another's is like it; taken from then on."""
    name = FORBIDDEN.sub("_", printable(f"link_{link}"))
    numbered = (f"{name}_{number}" if number > 1 else name for number in count(1))
    free = next(one for one in numbered if one.lower() not in taken)
    taken.add(free.lower())
    return free


def _draw_link(
    sheet: _ScaledSpace, link: str, rows: pd.DataFrame, corners: tuple[Array, Array]
) -> None:
    """Pins of a link in its frame, with their coordinates, and the axes of the frame."""
    axes, places = 6 * sheet.mark, rows[["x_mm", "z_mm"]].to_numpy(dtype=float)
    sheet.line([(0, axes), (0, 0), (axes, 0)], "FRAMES")
    for place, same in rows.groupby(["x_mm", "z_mm"], sort=False):
        at = np.array(place, dtype=float)
        others = (place for place in places if np.any(place != at))
        ahead = [at - other for other in others if np.all(np.abs(at - other) < CROWD * sheet.text)]
        # texts run to the right: of two pins side by side the left one's go up, the other's down
        names = ", ".join(dict.fromkeys(same["pin"]))
        named = zip(same["pin"], same["y_mm"], strict=True)
        texts = [names, f"x {at[0]:g}  z {at[1]:g}"]
        texts += [f"{name}: y {y:g}" for name, y in named if y]
        below = any(x > 0 for x, _ in ahead)
        sheet.pin(at, texts, -1.5 if below else len(texts) - 1)  # above: clear of all lines
    low, high = corners
    title = f"link {link}: x and z in its frame"
    sheet.words(title, (low[0], high[1] + 6.5 * sheet.text), 1.4)
