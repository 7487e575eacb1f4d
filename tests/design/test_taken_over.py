"""A point of a trade-off that rounding leaves below its tighter neighbour is the neighbour's."""

from __future__ import annotations

from dataclasses import replace

import pytest

import armdesign as ad
from armdesign.design.design import Design
from armdesign.sweeps import trade_offs as module
from tests.design.designs import MACHINES, any_lift_and_torque, workspace_of


@pytest.mark.parametrize("against", ["oil", "pin_box"])
def test_a_looser_limit_takes_the_tighter_ones_design(
    against: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By hand: at the last limit the search answers with today's machine, which is worse. The
    point is then the design before it, judged by its own limits, and no point is below a tighter
    one.
    """
    machine, workspace, found = MACHINES["single"](), workspace_of("single"), []

    def worse_at_last(*given: object) -> Design:
        design = search(*given)  # type: ignore[arg-type]
        found.append(design)
        return replace(design, machine=machine) if len(found) == 3 else design

    search = module.best_frequency
    monkeypatch.setattr(module, "best_frequency", worse_at_last)
    values = {"oil": (1.0, 1.1, 1.2), "pin_box": (0.1, 0.2, 0.3)}[against]
    front = ad.pareto(machine, workspace, any_lift_and_torque("single"), against, values, starts=1)
    _, before, last = front.designs
    assert last.machine == before.machine != machine
    assert last.requirements == found[2].requirements != before.requirements
    assert list(front.frame["frequency_hz"]) == sorted(front.frame["frequency_hz"])
    for one in (check for check in last.checks if check.setting):
        limit = next(check.limit for check in found[2].checks if check.name == one.name)
        assert one.limit == limit
    moved = {a.name for a, b in zip(last.checks, before.checks, strict=True) if a.limit != b.limit}
    assert moved
    assert moved.isdisjoint(last.prices)
    assert last.bound is None or last.bound >= last.unrounded * (1 - 1e-6)
