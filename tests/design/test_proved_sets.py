"""Sets of pins that are proved to hold no better design: by bounds of theirs or of larger sets."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest

import armdesign as ad
from armdesign import Design
from armdesign.design import proved_sets as module
from armdesign.design.bound.certificate import Certificate
from armdesign.design.proved_sets import NEAR, bounds_of_others, most_of, others
from armdesign.design.steps import DesignStep, _proved
from armdesign.report.trade_offs import _left_open
from armdesign.report.trade_offs import _proved as _proved_words
from tests.machines import named

PINS = ("a", "b", "c")


def test_a_bound_of_a_set_holds_for_its_subsets(monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: beside ab the bound of bc, 3 Hz, is low enough, which spares c beside b. That of ac
    is not, though it spares none: a design of it reaches 8 Hz before rounding, so that it is
    sought only until it is near that. abc is the only one of its kind. So beside b that of a is
    sought, until it is no more than what b reaches, and all are proved; beside ab ac might be 1.8
    times as good.
    """
    asked: list[Any] = []
    most = {"bc": 3.0, "ac": 9.0, "a": 3.5}

    def bounds(searches: list[Any], _: int, wanted: list[float], *_drawn: bool) -> list[Any]:
        asked.extend((search.name, w) for search, w in zip(searches, wanted, strict=True))
        return [
            Certificate(frequency=most[search.name], held=(), assumptions=())
            for search in searches
        ]

    monkeypatch.setattr(module, "certificates_within_bands", bounds)
    searches: Any = {
        tuple(name): SimpleNamespace(name=name)
        for name in ("ab", "ac", "bc", "a", "b", "c", "abc")
    }
    best = {("b",): 4.0, ("a", "b"): 5.0, PINS: 6.0, (): 1.0}
    own = {("a", "c"): 8.0, ("b", "c"): 2.9, ("a",): 3.4}
    bounds_found = bounds_of_others(PINS, searches, best, 1, own, False)
    assert asked == [("ac", 8.0 * (1 + NEAR)), ("bc", 5.0), ("a", 4.0)]
    assert bounds_of_others(PINS, searches, best, 1, own, False, bounds_found) == bounds_found
    assert len(asked) == 3
    least = {
        chosen: [most_of(some, bounds_found) for some in others(PINS, chosen)] for chosen in best
    }
    assert least == {("b",): [3.5, 3.0], ("a", "b"): [9.0, 3.0], PINS: [], (): []}

    def step(chosen: tuple[str, ...], sets: int) -> DesignStep:
        design = cast(Design, SimpleNamespace(judged=best[chosen]))
        return DesignStep(pins=chosen, design=design, searched=1, built=1, sets=sets)

    steps = {chosen: step(chosen, sets) for chosen, sets in zip(best, (3, 3, 1, 1), strict=True)}
    proved = {chosen: _proved(step, PINS, bounds_found) for chosen, step in steps.items()}
    assert {chosen: one.proved for chosen, one in proved.items()} == {
        ("b",): 2, ("a", "b"): 1, PINS: 0, (): 0
    }  # fmt: skip
    assert [proved[chosen].excess for chosen in best] == pytest.approx([0.0, 0.8, 0.0, 0.0])
    assert proved["a", "b"].open_sets == pytest.approx({("a", "c"): 0.8})


def test_a_bound_below_a_design_of_its_own_proves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The proof is wrong then."""
    low = Certificate(frequency=3.0, held=(), assumptions=())
    monkeypatch.setattr(module, "certificates_within_bands", lambda *_: [low])
    searches: Any = {("a",): None, ("b",): None}
    for own, bound in ((2.9, 3.0), (3.1, math.inf)):
        found = bounds_of_others(("a", "b"), searches, {("b",): 4.0}, 1, {("a",): own}, True)
        assert found == {("a",): bound}


@pytest.mark.slow
def test_no_proved_set_gains_more() -> None:
    """One cylinder's two pins: the better one reaches more than any search of the other, which is
    proved of any sizes, and of a coarse catalogue's.
    """
    machine, space = named("paper_1dof"), ad.Workspace.grid(named("paper_1dof"), points=3)
    for catalogue in (None, [(0.063, 0.036), (0.06, 0.032), (0.066, 0.04)]):
        answer = ad.steps(machine, space, catalogue=catalogue)
        step = next(one for one in answer.steps if len(one.pins) == 1)
        (other,) = {"cylinder.lift.base", "cylinder.lift.rod_end"} - {*step.pins}
        assert (step.proved, step.excess) == (1, 0.0)
        rival = ad.optimize(machine, space, vary=("areas", other), catalogue=catalogue, starts=3)
        assert rival.gain <= step.gain
        assert list(answer.frame["proved"]) == [one.proved for one in answer.steps]


def test_sets_left_open_are_named() -> None:
    """With the share by which each might be better."""
    left = {("cylinder.boom.base", "cylinder.stick.rod_end"): 0.00133}
    none: Any = None
    step = DesignStep(pins=PINS[:2], design=none, searched=10, built=3, sets=10, open_sets=left)
    assert (step.proved, step.excess) == (8, 0.00133)
    assert _left_open(step) == "left open of 2 pins: boom base + stick rod-end +0.13 %"
    assert _proved_words(step) == "8 of 9; +0.13 %"
