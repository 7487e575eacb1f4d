"""What is proved with ends rounded outward, against a library's arithmetic of balls."""

from __future__ import annotations

import operator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armdesign as ad
from armdesign.design.bound import outward, regions
from armdesign.design.bound.certificate import upper_bound
from armdesign.design.bound.intervals import Interval, Outward
from armdesign.design.bound.outward import Proof, certified, most_of
from armdesign.frequency.modes import hertz
from tests.design.bound.library_intervals import ByLibrary
from tests.design.designs import problem_of, solved

NEAR = 1e-13  # of a result or of what it is the difference of: some units in the last place
ends = st.floats(-1e30, 1e30) | st.floats(-2, 2)


@given(*[ends] * 4)
def test_ends_hold_what_the_library_says(a: float, b: float, c: float, d: float) -> None:
    """No operation is narrower than the library's, and wider but by rounding."""

    def hold(operation: object, *numbers: Interval) -> None:
        ours, exact = (operation(*(kind(n.low, n.high) for n in numbers)) for kind in kinds)
        assert isinstance(ours, Outward)
        assert ours.low <= exact.low
        assert exact.high <= ours.high
        size = max(float(n.size) for n in (*numbers, exact))
        assert ours.high - exact.high <= NEAR * size + 1e-300
        assert exact.low - ours.low <= NEAR * size + 1e-300

    kinds = Outward, ByLibrary
    x, y = (Interval(np.array(min(e)), np.array(max(e))) for e in ((a, b), (c, d)))
    for operation in (operator.add, operator.sub, operator.mul):
        hold(operation, x, y)
    hold(lambda one: one * 0.3, x)
    hold(lambda one: 1.1 - one, x)
    hold(lambda one: one.square(), x)
    hold(lambda one: one.sqrt(), x.above(0.0))
    hold(lambda one: one.reciprocal(), x.above(0.01))


def test_what_is_made_with_one_outward_is_one() -> None:
    plain, out = (kind(np.array([0.1, 0.2]), np.array([0.3, 0.4])) for kind in (Interval, Outward))
    made = [plain + out, out + plain, plain - out, plain * out, out * plain, out * 2.0, 1 - out]
    made += [out.within(plain), plain.within(out), out[:1], out.sum(0), out.above(0.2), -out]
    assert {type(one) for one in made} == {Outward}
    assert {type(one) for one in (plain + plain, plain * 0.1, plain.sqrt())} == {Interval}


@cache
def proofs_of(name: str) -> tuple[Proof, ...]:
    """What the bound of a small problem or of a shipped machine's sizes and pins rests on."""
    kept: list[Proof] = []

    def noted(proof: Proof) -> float:
        kept.append(proof)
        return certified(proof)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regions, "certified", noted)
        if name in ("double", "yielding", "sprung"):
            search = solved(problem_of(name), 1e-6)
            bound = upper_bound(search.problem, search.x, search.rows)
        else:
            bound = ad.optimize(ad.load(name), starts=1, catalogue="free").certificate
    assert bound is not None
    assert kept
    best = max(certified(proof) for proof in kept)
    assert bound.frequency >= hertz(best * kept[0].dual.reference)
    return tuple(kept)


SLOW = ("double", "sprung", "excavator_20t", "loader_crane", "paper_1dof")


@pytest.mark.parametrize(
    "name", ["yielding", *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_the_library_proves_no_more(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The highest leaves of every term, and some others: enclosed by the library's intervals no
    higher than by ours, and not much lower.
    """
    proof = max(proofs_of(name), key=certified)
    terms = proof.dual.terms(proof.multipliers)
    for term, most in zip(terms, proof.maxima, strict=True):
        low, high = most.leaves
        order = np.argsort(-term.upper(low, high).bound)
        some = np.concatenate([order[:4], order[4 :: 1 + len(order) // 2]])
        kept, ours = outward._upper(term, low[some], high[some])
        monkeypatch.setattr(outward, "Outward", ByLibrary)
        again, library = outward._upper(term, low[some], high[some])
        monkeypatch.undo()
        assert np.array_equal(kept, again)
        assert np.all(library <= ours)
        scale = max(1.0, abs(most.upper))
        finite = np.isfinite(library)
        assert np.all(ours[finite] - library[finite] <= 1e-9 * scale)
        assert most_of(term, most) <= most.upper + 1e-9 * scale


def test_a_share_that_is_stated_too_low_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong maximum, lower than its cells, is not believed."""
    monkeypatch.setattr(outward, "HALVINGS", 1)
    proof = proofs_of("yielding")[0]
    wrong = [replace(most, upper=most.upper - 0.1) for most in proof.maxima]
    assert certified(replace(proof, maxima=tuple(wrong))) >= certified(proof)


def test_multipliers_of_any_origin_prove_something() -> None:
    """Weights with a negative part are made semidefinite: no design exceeds what they prove."""
    proof = proofs_of("yielding")[0]
    weight = proof.multipliers.weight
    shifted = weight - 1e-3 * np.abs(weight).max() * np.eye(weight.shape[1])
    given = replace(proof.multipliers, weight=shifted, trace=np.ones(len(weight)))
    assert certified(replace(proof, multipliers=given)) >= proof.dual.reached
