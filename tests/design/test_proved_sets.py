"""Sets of pins that are proved to hold no better design: by bounds of theirs or of larger sets."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

import armdesign as ad
from armdesign.design import proved_sets as module
from armdesign.design.bound.certificate import Certificate
from armdesign.design.proved_sets import proved_sets
from tests.machines import named

PINS = ("a", "b", "c")


def test_a_bound_of_a_set_holds_for_its_subsets(monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: beside ab the bound of bc, 3 Hz, is low enough, which spares c beside b; a reached
    more than b. That of ac is not, and abc is the only one of its kind.
    """
    asked: list[Any] = []
    most = {"bc": 3.0, "ac": 9.0, "c": 3.5}
    reached = {"ab": 5.0, "ac": 4.0, "bc": 2.0, "a": 4.5, "b": 4.0, "c": 1.0, "abc": 6.0}

    def bounds(searches: list[Any], workers: int) -> list[Certificate]:
        asked.extend(search.name for search in searches)
        return [
            Certificate(frequency=most[search.name], held=(), assumptions=())
            for search in searches
        ]

    monkeypatch.setattr(module, "certificates_within_bands", bounds)
    searches: Any = {
        tuple(name): SimpleNamespace(name=name, squared=(2 * math.pi * hertz) ** 2)
        for name, hertz in reached.items()
    }
    best = {("b",): 4.0, ("a", "b"): 5.0, PINS: 6.0, (): 1.0}
    proved = proved_sets(PINS, searches, best, 1)
    assert proved == {("b",): 1, ("a", "b"): 1, PINS: 0, (): 0}
    assert asked == ["ac", "bc"]


@pytest.mark.slow
def test_no_proved_set_gains_more() -> None:
    """One cylinder's two pins: the better one reaches more than any search of the other; of any
    sizes that is proved, of a coarse catalogue not.
    """
    machine, space = named("paper_1dof"), ad.Workspace.grid(named("paper_1dof"), points=3)
    for catalogue in (None, [(0.063, 0.036), (0.06, 0.032), (0.066, 0.04)]):
        answer = ad.steps(machine, space, catalogue=catalogue)
        step = next(one for one in answer.steps if len(one.pins) == 1)
        (other,) = {"cylinder.lift.base", "cylinder.lift.rod_end"} - {*step.pins}
        assert step.proved == (catalogue is None)
        rival = ad.optimize(machine, space, vary=("areas", other), catalogue=catalogue, starts=3)
        assert rival.gain <= step.gain
        assert list(answer.frame["proved"]) == [one.proved for one in answer.steps]
