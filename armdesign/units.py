"""Units: SI inside, everything else is a factor written where a number enters or leaves.

``140 * mm`` is 0.14 m; ``pressure / bar`` prints a pressure in bar.
"""

import math

mm = 1e-3
litre = 1e-3
bar = 1e5
MPa = 1e6
kN = 1e3
deg = math.pi / 180.0
l_per_min = litre / 60.0

GRAVITY = 9.81  # [m/s²], the value of Pinocchio's default model
ATMOSPHERE = 101_325.0  # [Pa]
