"""Cylinders of shipped machines, and boxes of their pins, for the tests of what encloses them."""

from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import strategies as st

from armdesign import Requirements, Workspace
from armdesign.design.bound.cylinder_shape import Shape
from armdesign.design.bound.shape_of_pins import shape_of
from armdesign.design.program.problem import Problem
from tests.machines import named

ROUNDING = 1e-9  # what bound.py allows for
shares = st.floats(0, 1)


def shipped_problem(name: str, vary: tuple[str, ...] = ("areas", "pins")) -> Problem:
    """Areas and pins of a machine, in oil without air."""
    machine = named(name).replace({"fluid.entrained_air_percent": 0.0})
    workspace = Workspace.grid(machine, points=[3] * len(machine.joints))
    return Problem.of(
        machine=machine, workspace=workspace, requirements=Requirements.of(machine), vary=vary
    )


CYLINDERS = {
    "boom rod": ("rigid_excavator_20t", 0),  # its rod pin alone
    "boom": ("rigid_excavator_20t", 0),
    "stick": ("rigid_excavator_20t", 1),
    "bucket": ("rigid_excavator_20t", 2),  # four-bar: its base pin moves
    "telescope": ("rigid_loader_crane", 2),  # along its slide
    "lift": ("patu_boom", 0),
    "limited lift": ("four_bar_left", 0),  # joint limits end ranges before strokes
    "limited tilt": ("four_bar_left", 2),
}


@cache
def cylinder(name: str) -> tuple[Problem, int, np.ndarray, Shape]:
    machine, i = CYLINDERS[name]
    vary = ("areas", "cylinder.boom.rod_end") if name == "boom rod" else ("areas", "pins")
    problem = shipped_problem(machine, vary)
    angles = np.linspace(*problem.machine.ranges[problem.machine.linkages[i].joints[0]], 6)
    shape = shape_of(problem, i, angles)
    assert shape is not None
    return problem, i, angles, shape


def box_around(
    point: np.ndarray, shape: Shape, width: np.ndarray, place: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A box (1, 3) of shares ``width`` of the region, with the point at shares ``place`` of it."""
    low, high = shape.region
    size = width * (high - low)
    return (point - place * size)[None], (point + (1 - place) * size)[None]


box_shares = st.lists(shares, min_size=3, max_size=3)
designs = st.integers(0, 10**6)


def some_design(problem: Problem, seed: int) -> np.ndarray:
    """Any pins in their boxes, often at corners; any areas."""
    random = np.random.default_rng(seed)
    low, high = problem.bounds
    x = random.uniform(low, high)
    pins = np.array([v.pin is not None for v in problem.vector.variables])
    return np.where(
        pins & (random.uniform(size=len(x)) < 0.3),
        np.sign(x),
        np.where(pins, x, random.uniform(0.5, 1.1)),
    )
