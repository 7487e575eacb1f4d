"""Which change first: the best designs with no pin moved, with one, up to all."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.design.search.multistart import ROUGHLY, follow_all
from armdesign.design.steps import _best_built, _rising
from armdesign.errors import InfeasibleError
from armdesign.report.trade_offs import steps_sheet
from tests.design.designs import double, workspace_of
from tests.machines import named

PINS = (
    "cylinder.lift.base",
    "cylinder.lift.rod_end",
    "cylinder.fold.base",
    "cylinder.fold.rod_end",
)


@pytest.mark.slow
def test_each_step_is_the_best_of_all_sets_of_as_many_pins() -> None:
    """Every set by ``optimize`` from three starts of its own: none reaches more."""
    machine, space = double(), workspace_of("double")
    answer = ad.steps(machine, space)
    for step in answer.steps:
        count = len(step.pins)
        assert step.searched == step.sets == math.comb(len(PINS), count)
        others = {
            some: ad.optimize(machine, space, vary=("areas", *some)).unrounded
            for some in itertools.combinations(PINS, count)
        }
        assert step.pins in others
        assert step.design.unrounded >= max(others.values()) * (1 - 1e-4)


def test_gains_are_of_what_the_designs_were_made_for() -> None:
    """Without bands the ratio of worst frequencies at the file's values, as the sheet says, and of
    several built sets the best by it; with bands the least gain within them.
    """
    machine, space = named("paper_1dof"), ad.Workspace.grid(named("paper_1dof"), points=2)
    answer = ad.steps(machine, space)
    sheet = steps_sheet(answer)
    assert sheet.columns[2] == "gain"
    assert "at the file's values, for which alone the designs were made" in (sheet.note or "")
    for step, row in zip(answer.steps, sheet.rows[1:], strict=True):
        before, after = step.design.before.worst.frequency, step.design.after.worst.frequency
        assert step.gain == pytest.approx(after / before - 1, rel=1e-12)
        assert row[2] == f"{100 * step.gain:+.1f} %"
    bands = ad.Bands(structure=(0.0, 1.0))
    robust = ad.steps(machine, space, bands=bands)
    assert steps_sheet(robust).columns[2] == "least gain"
    for step in robust.steps:
        assert step.gain == step.design.least_gain
        assert step.design.bands == bands


def test_every_set_has_drawn_starts_where_they_are_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Today's pins and the best of one pin less by themselves; the others by their seed alone."""
    machine, space = named("paper_1dof"), ad.Workspace.grid(named("paper_1dof"), points=2)
    begun: list[list[tuple[int, list[float]]]] = []

    def noted(searches: Any, workers: int, **settings: Any) -> Any:
        if settings == ROUGHLY:
            begun.append([(len(s.problem.vector.vary) - 1, s.x.tolist()) for s in searches])
        return follow_all(searches, workers, **settings)

    monkeypatch.setattr("armdesign.design.steps.follow_all", noted)
    gains = {}
    for starts, seed in ((None, 0), (1, 0), (4, 0), (4, 0), (4, 1)):
        begun.clear()
        answer = ad.steps(machine, space, starts=starts, seed=seed)
        gains[starts, seed] = [step.gain for step in answer.steps]
        counts = [len(of_count) for of_count in begun]
        assert counts == ([1, 8, 4] if starts == 4 else [1, 4, 2])  # of 1, 2 and 1 sets
        of_both = [x for _, x in begun[2]]
        assert len({tuple(x) for x in of_both}) == len(of_both)
        drawn = of_both[2:]
        if seed == 0 and starts == 4:
            first = drawn
    assert drawn != first
    np.testing.assert_allclose(gains[1, 0], gains[None, 0], rtol=1e-12)
    assert "starts=4, seed=1" in answer.steps[-1].design.machine.text


@pytest.mark.slow
def test_a_step_changes_what_it_says_and_no_more() -> None:
    """Pins that may not move stay; every design meets all requirements; no step reaches less."""
    machine, space = double(), workspace_of("double")
    answer = ad.steps(machine, space, catalogue="5mm")
    assert [len(step.pins) for step in answer.steps] == [0, 1, 2, 3, 4]
    assert answer.left_out == {}
    assert [step.built for step in answer.steps] == [1, 3, 3, 3, 1]
    unrounded = [step.design.unrounded for step in answer.steps]
    assert unrounded[1] > unrounded[0] * 1.01
    for step in answer.steps:
        new, today = step.design.machine, machine
        moved = {
            f"cylinder.{cylinder.name}.{place}"
            for cylinder, a, b in zip(new.cylinders, new.linkages, today.linkages, strict=True)
            for place in ("base", "rod_end")
            if a.place(place) != b.place(place)
        }
        assert moved <= set(step.pins)
        assert {
            f"{path.split('.')[1]} {path.split('.')[2].replace('_', '-')}" for path in moved
        } == {part for part in step.changed if "cylinder" not in part}
        assert min(step.design.slacks.values()) >= 0
    frame = answer.frame
    assert list(frame["pins"]) == [0, 1, 2, 3, 4]
    assert frame["gain"].to_numpy() == pytest.approx([s.design.gain for s in answer.steps])
    assert frame["gain"].is_monotonic_increasing
    sheet = steps_sheet(answer)
    assert len(sheet.rows) == 6
    assert {len(row) for row in sheet.rows} == {len(sheet.columns)}


def test_the_best_as_built_counts() -> None:
    """The drawing's grid can reverse the order of sets, and make more pins worth less: of two
    designs of one pin the better one, and none of both pins that gains less.
    """
    machine = named("paper_1dof")
    space = ad.Workspace.grid(machine, points=2)
    base, rod_end, both = (
        ad.optimize(machine, space, vary=("areas", *pins), starts=1)
        for pins in (PINS[:1], PINS[1:2], PINS[:2])
    )
    assert rod_end.gain > base.gain + 0.01
    assert _best_built([base, rod_end]) is rod_end
    worse = replace(both, machine=base.machine)
    built = {(): base, PINS[1:2]: rod_end, PINS[:2]: worse}
    answer = _rising(machine, built, {}, PINS[:2])
    assert [step.design for step in answer.steps] == [base, rod_end]
    assert answer.left_out == {2: "no better than 1"}
    assert [step.built for step in answer.steps] == [1, 1]
    assert "2 pins are left out: no better than 1" in (steps_sheet(answer).note or "")


@pytest.mark.slow
def test_many_pins_are_added_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the sets are too many, those that add a pin to the best set before."""
    monkeypatch.setattr("armdesign.design.steps.SETS", 4)
    answer = ad.steps(double(), workspace_of("double"))
    bars = [bar.get_width() for bar in answer.plot().patches]
    assert bars == pytest.approx([100 * step.gain for step in answer.steps])
    first, second = answer.steps[1], answer.steps[2]
    assert (second.searched, second.sets) == (3, 6)
    assert set(first.pins) < set(second.pins)
    assert "too many sets" in (steps_sheet(answer).note or "")


@pytest.mark.slow
def test_no_step_is_possible() -> None:
    """Requirements that no design meets: as ``optimize`` refuses them."""
    with pytest.raises(InfeasibleError, match=r"no design meets|no sizes"):
        ad.steps(double(), workspace_of("double"), ad.Requirements(cylinder_mass=1.0))


def test_lift_share_of_a_design() -> None:
    """The least ratio over the points of both charts, by hand."""
    machine = double()
    design = ad.size_cylinders(machine, workspace_of("double"))
    today, new = ad.lift_chart(machine), ad.lift_chart(design.machine)
    ratio = [
        b / a
        for x, z, a in zip(today.reach, today.height, today.capacity, strict=True)
        for u, v, b in zip(new.reach, new.height, new.capacity, strict=True)
        if np.hypot(x - u, z - v) < 1e-9 and a > 0
    ]
    assert design.lift_share == pytest.approx(min(ratio))


def test_a_machine_that_lifts_nothing_has_no_lift_share() -> None:
    """Its chart has points, all without lift: the least of none was a foreign error."""
    machine = ad.load("mini_excavator_2t").replace({"supply.pressure_bar": 40.0})
    assert not ad.lift_chart(machine).capacity.any()
    requirements = replace(ad.Requirements.of(machine), holding_share=50.0)
    workspace = ad.Workspace.grid(machine, points=2)
    assert math.isnan(ad.size_cylinders(machine, workspace, requirements).lift_share)
