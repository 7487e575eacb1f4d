"""The design of the 20 t excavator on a coarse grid, made once."""

from __future__ import annotations

from functools import cache

import armdesign as ad
from armdesign import Workspace
from armdesign.design.design import Design
from tests.machines import named

POINTS = (9, 9, 15)


@cache
def excavator_design() -> Design:
    machine = named("rigid_excavator_20t")
    return ad.optimize(machine, Workspace.grid(machine, points=POINTS))
