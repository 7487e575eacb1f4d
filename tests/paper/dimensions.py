"""The dimensions of `paper_1dof` (SOURCE.md: stand-ins), written out a second time."""

from __future__ import annotations

import math

from armdesign.paper.configurations import LENGTHS, MASSES

# paper_1dof by hand: 63/36 mm, stroke 200 mm, piston in the middle, 0.1 l dead on each side, pins
# 150 and 500 mm
BETA, A1, A2 = 1.2e9, math.pi / 4 * 0.063**2, math.pi / 4 * (0.063**2 - 0.036**2)
V1, V2 = 0.1 * A1 + 1e-4, 0.1 * A2 + 1e-4
PIN, BASE, G = 0.15, 0.5, 9.81
SPAN2 = PIN**2 + BASE**2
ARM = PIN * BASE / math.sqrt(SPAN2)
MASS, LENGTH = 200.0, 1.0
INERTIA = MASS * (PIN**2 + LENGTH**2)
ALL = [(mass, length) for mass in MASSES for length in LENGTHS]
CORNERS = {"masses": (50.0, 400.0), "lengths": (0.5, 1.5)}


def hertz(stiffness: float, inertia: float) -> float:
    return math.sqrt(stiffness / inertia) / (2 * math.pi)


def spring(area: float, volume: float, other: float, other_volume: float) -> float:
    return BETA * (area**2 / volume + other**2 / other_volume)


BOTH = spring(A1, V1, A2, V2)
# what gravity takes from the stiffness [N m/rad]
RIGHT = MASS * G * PIN * (1 + LENGTH * BASE / SPAN2)
