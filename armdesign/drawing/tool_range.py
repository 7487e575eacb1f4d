"""The range of the tool: all places of the picture that it can be brought to.

From the tool inwards, what it reaches is swept by one joint after the other: a point becomes a
line, a line an area, and an area grows by what its boundary sweeps. Each joint has its whole
range, whatever the others do. Arcs are chords of 3°, so that 10 m of reach are 3 mm short.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.joint_arcs import in_picture
from armdesign.drawing.outlines import area_between, lines_of, simplified
from armdesign.drawing.plane import PicturePlane, placed

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

CHORD = math.radians(3.0)  # of a hinge's range
STEPS = 12  # of a slide's range
SLIVER = 0.01  # of the reach: side of the smallest hole that is kept
FINE = 2e-4  # of the reach: what the lines between two sweeps leave out


def tool_range(machine: Machine) -> tuple[Array, ...]:
    """Lines (m, 2) [m] about the range of the tool, closed ones twice through their first point.

    With one joint the way of the tool; with none that moves in the picture its place.
    """
    arm, plane = machine.arm, PicturePlane(machine.heading)
    at = plane.project(arm.point(plane.zero, machine.tool.link, np.array(machine.tool.at)))
    size = max(float(np.abs(at).max()), 1e-3)
    lines, area = [at], None
    ranges = machine.known_ranges
    for j in reversed(arm.chain(machine.tool.link)):
        if j >= len(arm.joints) or not in_picture(machine, plane, j):
            continue
        turns = _motions(plane, j, *ranges[j].tolist())
        moved = [[placed(turn, line) for turn in turns] for line in lines]
        if len(lines) == 1 and len(lines[0]) == 1:
            lines = [np.concatenate(moved[0])]
            continue
        first: Any = None if area is None else [placed(turns[0], line) for line in lines]
        area = simplified(area_between(moved, first), FINE * size)
        lines = lines_of(area, (SLIVER * size) ** 2)
    return tuple(lines)


def _motions(plane: PicturePlane, j: int, lower: float, upper: float) -> Array:
    """Motion of one joint over its range, in the picture with all joints at 0 (m, 2, 3)."""
    arm = plane.arm
    turning = arm.coordinates[j].revolute
    count = math.ceil((upper - lower) / CHORD) + 1 if turning else STEPS
    q = np.zeros((max(count, 2), len(arm.joints)))
    q[:, j] = np.linspace(lower, upper, len(q))
    link = next(name for name, body in arm.links.items() if body.joint == j)
    moved, at_zero = plane.placements(plane.poses(q), link), plane.placements(plane.zero, link)[0]
    turn = moved[:, :, :2] @ np.linalg.inv(at_zero[:, :2])
    shift = moved[:, :, 2] - turn @ at_zero[:, 2]
    return np.concatenate([turn, shift[:, :, None]], axis=2)
