"""Pin boxes, and strokes at the ends of joint ranges."""

from __future__ import annotations

from dataclasses import replace

import pytest
from numpy.testing import assert_allclose

from armdesign import Machine, Requirements, Workspace
from armdesign.design.catalogue.sizes import BUILDABLE, FINE, DrawingGrid
from armdesign.design.requirements.candidate import spare_shares
from armdesign.design.requirements.check import check
from armdesign.design.search.file_changes import pin_changes
from armdesign.mechanism.joint_ranges import sweep
from armdesign.units import mm
from tests.design.designs import MACHINES, as_machine, problem_of, some_x, workspace_of
from tests.design.requirements.shared import by_name, shipped_reference
from tests.machines import named


def test_default_pin_box() -> None:
    """2.5 % of the largest distance from the first joint to the tool (DESIGN.md), by the
    independent reference.
    """
    machine = named("excavator_20t")
    box = Requirements().box(machine, workspace_of("excavator"))
    # it scans other poses
    assert_allclose(1000 * box, shipped_reference(machine).default_pin_box_mm(), rtol=0.01)


def ends_of_lift(machine: Machine, today: Machine) -> tuple[float, float]:
    """Least and greatest length of the first cylinder over today's range of its joint [m]."""
    lengths = machine.linkages[0].length(sweep(today.arm, 0, today.ranges[0]))
    return float(lengths.min()), float(lengths.max())


def test_what_today_keeps_free_at_the_ends_of_a_range() -> None:
    """What the cylinder has beyond a joint's limit, at most what is asked; nothing where its
    stroke ends the range.
    """
    today = MACHINES["double"]()
    assert_allclose(spare_shares(today, 0.02), 0.02)
    assert_allclose(spare_shares(today, 0.0), 0.0)
    least, most = ends_of_lift(today, today)
    stroke = (most - least) / 0.985
    lengths = {"closed_length_mm": (least - 0.01 * stroke) / mm, "stroke_mm": stroke / mm}
    near = today.replace({f"cylinder.lift.{key}": value for key, value in lengths.items()})
    assert_allclose(spare_shares(near, 0.02), [[0.01, 0.005], [0.02, 0.02]], rtol=1e-6)
    ended = near.replace({"cylinder.lift.stroke_mm": 0.9 * stroke / mm})
    assert spare_shares(ended, 0.02)[0, 1] == 0.0
    assert not spare_shares(named("excavator_20t"), 0.02).any()


@pytest.mark.parametrize("grid", [FINE, BUILDABLE])
def test_new_strokes_keep_the_end_margin_at_joint_limits(grid: DrawingGrid) -> None:
    """Just as much as asked at x, no less as written."""
    problem = replace(problem_of("double"), grid=grid)
    today, x = problem.machine, some_x(problem, 1)
    new = as_machine(problem, x)
    least, most = ends_of_lift(new, today)
    lift = new.cylinders[0]
    free = [least - lift.closed_length, lift.open_length - most]
    assert_allclose(free, 0.02 * lift.stroke, rtol=1e-9)
    written = today.replace(pin_changes(problem, x))
    least, most = ends_of_lift(written, today)
    lift = written.cylinders[0]
    step = max(grid.strokes, 0.1) * mm
    for left in (least - lift.closed_length, lift.open_length - most):
        assert 0.02 * lift.stroke - 1e-9 <= left <= 0.02 * lift.stroke + 1.1 * step


def test_less_than_that_is_missed() -> None:
    """A cylinder that ends with the joint's limit leaves nothing free."""
    problem = problem_of("double")
    today = problem.machine
    least, most = ends_of_lift(today, today)
    keys = {"closed_length_mm": least / mm, "stroke_mm": (most - least) / mm / 0.98}
    new = today.replace({f"cylinder.lift.{key}": value for key, value in keys.items()})
    checks = by_name(check(new, today, problem.workspace, problem.requirements))
    closed, opened = (checks[f"range.{end}.lift"] for end in ("closed", "open"))
    assert closed.limit == pytest.approx(least - 0.02 * new.cylinders[0].stroke)
    assert closed.slack < 0 <= opened.slack + 1e-9
    assert closed.words == "stroke covers boom with 2 % of it free"


def test_the_default_box_does_not_depend_on_the_order_of_the_joints() -> None:
    """It is of the joint next to the root, however the coordinates are numbered."""
    boxes = []
    for order in (["boom", "stick", "bucket"], ["stick", "bucket", "boom"]):
        machine = named("excavator_20t").replace({"joints": order})
        boxes.append(Requirements().box(machine, Workspace.grid(machine, points=4)))
    assert boxes[0] == pytest.approx(boxes[1], rel=1e-12)
