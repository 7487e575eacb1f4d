"""Swings of modes: how far they go, against exact kinematics, and joints as a picture has them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armdesign import natural_modes
from armdesign.drawing.side_view import side_view
from armdesign.drawing.swing import SHARE, Swings, picture_joints
from tests.machines import middle, named


def swings_of(name: str) -> Swings:
    machine = named(name)
    view = side_view(machine, middle(machine))
    return Swings(machine=machine, bodies=view.bodies, size=view.size)


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "four_bar_right", "rocking"])
def test_of_all_that_is_drawn_nothing_goes_further_than_its_share(name: str) -> None:
    """Every corner, pin and the tool by exact kinematics, a thousandth of the swing away.

    The point that moves furthest is a pin, or in the box around the outlines.
    """
    swings = swings_of(name)
    machine, q = swings.machine, middle(swings.machine)[None]
    for mode in range(len(machine.arm.coordinates)):
        swing = swings.of(q, natural_modes(machine.at(q)).shapes[:, :, mode])
        z = machine.arm.with_springs(q) + 1e-3 * swing.steps
        rest, gone = side_view(machine, q), side_view(machine, z)
        both = [np.concatenate([p for b in v.polygons() for p in b]) for v in (rest, gone)]
        both = [np.concatenate([a, v.points[0]]) for a, v in zip(both, (rest, gone), strict=True)]
        furthest = 1e3 * float(np.hypot(*(both[1] - both[0]).T).max())
        assert furthest <= SHARE * swings.size * 1.001
        assert furthest >= 0.5 * SHARE * swings.size
        ends = machine.arm.with_springs(q) + np.array([[-1.0], [1.0]]) * swing.steps
        assert swing.tool[0] == pytest.approx(math.dist(*side_view(machine, ends).tool) / 2)


def test_a_tool_at_rest_does_not_throw_the_arm_about() -> None:
    """The tool on the axis of the only joint: a mode whose node it is."""
    machine = named("paper_1dof").replace({"tool.at_mm": [0, 0, 0]})
    view = side_view(machine, middle(machine))
    swings = Swings(machine=machine, bodies=view.bodies, size=view.size)
    swing = swings.of(middle(machine)[None], np.ones((1, 1)))
    assert swing.tool == pytest.approx([0.0], abs=1e-12)
    assert abs(swing.steps[0, 0]) < 2 * math.asin(SHARE)  # of the farthest corner about its axis


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "four_bar_right", "rocking"])
def test_joints_of_the_picture_move_its_bodies_as_the_machine_does(name: str) -> None:
    """Rotations and shifts in the picture against the side view of the displaced machine.

    The arms move in one plane, so that both are the same, however far the joints go.
    """
    machine = named(name)
    q = middle(machine)[None]
    joints, rest = picture_joints(machine, q), side_view(machine, q)
    step = np.linspace(0.1, 0.2, len(machine.arm.coordinates))
    gone = side_view(machine, machine.arm.with_springs(q) + step)
    moved: dict[int, np.ndarray] = {0: np.eye(3)}
    for k in machine.arm.outwards:
        x, way = joints.places[0, k], joints.turns[0, k] * step[k]
        own = np.eye(3)
        if joints.hinges[k]:
            own[:2, :2] = [[math.cos(way), -math.sin(way)], [math.sin(way), math.cos(way)]]
            own[:2, 2] = x - own[:2, :2] @ x
        else:
            own[:2, 2] = way * x
        moved[k + 1] = moved[joints.carriers[k]] @ own
    for body in range(len(rest.bodies)):
        matrix = np.vstack([rest.placements[0, body], [0, 0, 1]])
        assert (moved[body] @ matrix)[:2] == pytest.approx(gone.placements[0, body], abs=1e-9)


def test_slewing_is_not_in_the_picture() -> None:
    machine = named("slewing")
    turns = picture_joints(machine, middle(machine)[None]).turns
    assert turns[0, list(machine.arm.slewing)] == pytest.approx(0.0)
    assert np.count_nonzero(turns) == turns.size - len(machine.arm.slewing)
