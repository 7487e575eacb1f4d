"""Wrong arguments of a machine's methods: poses, payloads, grids, margins; one clear line each."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import armdesign as ad
from armdesign.errors import PoseError
from armdesign.machine.changes import changed_machine
from tests import machines
from tests.machine.file.bad_files import EXCAVATOR, assert_clear

# --------------------------------------------------------------------------------- wrong arguments

MIDDLE = EXCAVATOR.ranges.mean(axis=1)


BAD_POSES = [
    MIDDLE[:2],
    [[1]],
    [],
    [[]],
    0,
    None,
    "a",
    [["a", "b", "c"]],
    np.zeros((2, 2, 3)),
    [MIDDLE, MIDDLE[:2]],
]


BAD_POSES += [MIDDLE + 1j, {}, [[1, 2, 3, 4]], [np.inf, 0, 0], [np.nan] * 3, [None] * 3]


@pytest.mark.parametrize("q", BAD_POSES, ids=[str(index) for index in range(len(BAD_POSES))])
@pytest.mark.parametrize("question", ["at", "margins", "holds", "rigid_poses"])
def test_poses_of_a_wrong_shape_or_not_finite(question: str, q: Any) -> None:
    with pytest.raises(ad.ArmDesignError, match="excavator_20t: q: ") as caught:
        getattr(EXCAVATOR, question)(q)
    assert_clear(str(caught.value))


def test_no_pose_is_a_question_too() -> None:
    assert len(EXCAVATOR.at(np.zeros((0, 3)))) == 0


def test_a_pose_out_of_stroke_says_how_far_and_where_to_stay() -> None:
    q = MIDDLE.copy()
    q[1] = 0.0
    message = (
        r"stick cylinder: length 1\.\d{4} m is outside its stroke \[1\.8000, 3\.3040\] m at boom"
        r" .*°, stick 0\.0°, .*; stay in the range of joint "
        r'"stick" \[-15\d\.\d, -3\d\.\d\]°'
    )
    with pytest.raises(ad.ArmDesignError, match=message):
        EXCAVATOR.at(q)


def test_a_stroke_over_two_joints_says_where_one_may_be_while_the_other_stands() -> None:
    """Each of the joints is in its own range; where it says to stay every pose can be taken."""
    strokes = {"cylinder.long.closed_length_mm": 1800, "cylinder.long.stroke_mm": 1500}
    machine = machines.named("crossing").replace(strokes)
    corners = np.array(list(itertools.product(*machine.ranges)))
    out = corners[(machine.margins(corners) < 0).any(axis=1)]
    assert len(out) == 2
    message = r'in the range of joint "(\w+)" \[(\S+), (\S+)\]° at (\w+) \S+° or change'
    for q in out:
        with pytest.raises(PoseError) as caught:
            machine.at(q)
        assert_clear(str(caught.value))
        found = re.search(message, str(caught.value))
        assert found
        moved, *ends, stands = found.groups()
        j = machine.joints.index(moved)
        assert {moved, stands} == {"boom", "stick"}
        near = np.tile(q, (5, 1))
        near[:, j] = np.radians(np.linspace(*map(float, ends), 5))
        machine.at(near)
        step = np.radians(0.1) * np.sign(q[j] - near[:, j].mean())
        beyond = near[np.abs(near[:, j] - q[j]).argmin()] + step * (np.arange(2) == j)
        with pytest.raises(PoseError):
            machine.at(beyond)


def test_a_singular_pose_says_which_one_near_it_is_not() -> None:
    """At the dead centre, where the length of the cylinder is least, on either side of it."""
    strokes = {"cylinder.lift.closed_length_mm": 740, "cylinder.lift.stroke_mm": 600}
    machine = ad.load("patu_boom").replace(strokes)

    def arm(q: float) -> float:
        return float(machine.evaluate(machine.rigid_poses([[q]])).moment_arms[0, 0, 0])

    dead = brentq(arm, -1.2, -0.9, xtol=1e-15)
    message = r"singular at boom .* cylinder of boom .*; the nearest pose that is not: boom (\S+)°"
    with pytest.raises(PoseError, match=message) as caught:
        machine.at([dead])
    assert_clear(str(caught.value))
    near = math.radians(float(re.search(message, str(caught.value))[1]))
    assert 0 < abs(near - dead) < 0.01 * np.ptp(machine.ranges)
    assert abs(machine.at([near]).moment_arms[0, 0, 0]) > 1e-6


def test_an_open_four_bar_says_so() -> None:
    """The lug of this machine goes round its joint further from the pivot than rocker + coupler
    can reach.
    """
    machine = machines.named("four_bar_left")
    q = np.zeros((400, 3))
    q[:, 2] = np.linspace(-np.pi, np.pi, 400)
    open_ = machine.margins(q)[:, 2] == -np.inf
    assert 0 < open_.sum() < 400
    q = q[open_][:1]
    with pytest.raises(
        ad.ArmDesignError,
        match=r"tilt cylinder: its four-bar does not close at .*; stay in the range",
    ):
        machine.at(q)


@pytest.mark.parametrize(
    "name", ["excavator_20t", "paper_1dof", "spatial", "four_bar_right", "branched", "redundant"]
)
def test_margins_never_raise_for_a_pose(name: str) -> None:
    """Any finite joint positions, near and absurd: a number or −∞, never NaN."""
    machine = machines.named(name)
    chance = np.random.default_rng(0)
    for scale in (1e-300, 1.0, 10.0, 1e6, 1e100):
        margins = machine.margins(chance.uniform(-scale, scale, (300, len(machine.joints))))
        assert margins.shape == (300, len(machine.cylinders))
        assert not np.isnan(margins).any()
        assert margins.max() <= 0.5


@pytest.mark.parametrize(
    "payload", ["ful", "", "800", None, -1, math.nan, math.inf, True, [1], {}, 1j, b"full"]
)
def test_payloads_that_cannot_be(payload: Any) -> None:
    with pytest.raises(ad.ArmDesignError, match=r"excavator_20t: payload") as caught:
        EXCAVATOR.with_payload(payload)
    assert_clear(str(caught.value))


BAD_POINTS = [
    0,
    1,
    -3,
    "5",
    "x",
    3.0,
    2.7,
    [3, 3],
    [3, 3, 1],
    [3, 3, 3.5],
    10**9,
    [10**6] * 3,
    [],
    True,
    {},
]


BAD_POINTS += [
    [None] * 3,
    math.nan,
    math.inf,
    "3,3,3",
    ["3"] * 3,
    [[3] * 3],
    2**62,
    [3, 3, 3, 3],
    [True] * 3,
]


@pytest.mark.parametrize("points", BAD_POINTS, ids=str)
def test_grids_that_cannot_be(points: Any) -> None:
    with pytest.raises(
        ad.ArmDesignError, match=r"points: .*; give (one number ≥ 2, or 3|at most 5 million)"
    ):
        ad.Workspace.grid(EXCAVATOR, points=points)


@pytest.mark.parametrize("margin", [0.5, -1, math.nan, math.inf, "x", [0.1], True])
def test_end_margins_that_cannot_be(margin: Any) -> None:
    with pytest.raises(
        ad.ArmDesignError,
        match=r"end_margin: .* is not allowed; give a share of the stroke in \[0, 0",
    ):
        ad.Workspace.grid(EXCAVATOR, points=3, end_margin=margin)


CHANGED_IN_MEMORY = {
    "fluid": {"fluid": replace(EXCAVATOR.fluid, bulk_modulus=5e8)},
    "supply": {"supply": replace(EXCAVATOR.supply, flow=1.0)},
    "tool": {"tool": replace(EXCAVATOR.tool, at=(0.0, 0.0, 0.0))},
    "cylinder": {
        "cylinders": (replace(EXCAVATOR.cylinders[0], bore=0.2), *EXCAVATOR.cylinders[1:])
    },
    "name": {"name": "other"},
    "payload.full": {"payload": replace(EXCAVATOR.with_payload("full").payload, mass=1.0)},
}


@pytest.mark.parametrize("path", CHANGED_IN_MEMORY)
def test_a_part_changed_in_memory_is_not_lost_by_a_change_of_the_file(path: str) -> None:
    """By ``dataclasses.replace``: the text does not have it."""
    other = replace(EXCAVATOR, **CHANGED_IN_MEMORY[path])  # type: ignore[arg-type]
    bore = {"cylinder.boom.bore_mm": EXCAVATOR.section.cylinder["boom"].bore_mm}
    said = rf"{EXCAVATOR.source.name}: {re.escape(path)}: was changed in memory.*by key path"
    for change in (other.replace, lambda one: changed_machine(other, one, check=False)):
        with pytest.raises(ad.ArmDesignError, match=said):
            change(bore)
    for write in (other.files, other.save):
        with pytest.raises(ad.ArmDesignError, match=said):
            write("never.toml")
    with pytest.raises(ad.ArmDesignError, match=said):
        ad.sweep(other, {path: [value] for path, value in bore.items()}, points=2)
    loaded = EXCAVATOR.with_payload(123.0)
    assert loaded.replace(bore).payload == loaded.payload
