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
from armdesign.design.bound.certificate import certificate_of
from armdesign.design.bound.intervals import Interval, Outward
from armdesign.design.bound.outward import Proof, certified, most_of
from armdesign.design.bound.shape_of_pins import coordinates
from armdesign.design.catalogue.alternation import with_sizes
from armdesign.design.catalogue.sizes import BUILDABLE
from armdesign.design.program.constraints import constraints_at
from armdesign.frequency.modes import hertz
from tests.design.bound.library_intervals import ByLibrary
from tests.design.bound.test_catalogue_sizes import drawn_designs, two_cylinders
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
    """What the bound of a small problem, or of a shipped machine, rests on: pins and any areas,
    or areas of a catalogue.
    """
    kept: list[Proof] = []

    def noted(proof: Proof) -> float:
        kept.append(proof)
        return certified(proof)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regions, "certified", noted)
        if name == "catalogue":
            problem, sizes = two_cylinders()
            free = solved(replace(problem, grid=replace(BUILDABLE, sizes=())), 1e-5)
            search = with_sizes(free, sizes)
            bound = certificate_of(problem, search.x, search.rows)
        elif name in ("double", "yielding", "sprung"):
            search = solved(problem_of(name), 1e-6)
            bound = certificate_of(search.problem, search.x, search.rows)
        else:
            bound = ad.optimize(ad.load(name), starts=1).certificate
    assert bound is not None
    assert kept
    best = max(certified(proof) for proof in kept)
    assert bound.frequency >= hertz(best * kept[0].dual.reference)
    return tuple(kept)


SLOW = ("double", "sprung", "catalogue", "excavator_20t", "loader_crane", "paper_1dof")


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
        order = np.argsort(-most.leaves.bound)
        some = most.leaves[np.concatenate([order[:4], order[4 :: 1 + len(order) // 2]])]
        kept, ours = outward._upper(term, some)
        monkeypatch.setattr(outward, "Outward", ByLibrary)
        again, library = outward._upper(term, some)
        monkeypatch.undo()
        assert np.array_equal(kept, again)
        assert np.all(library <= ours)
        scale = max(1.0, abs(most.upper))
        finite = np.isfinite(library)
        assert np.all(ours[finite] - library[finite] <= 1e-9 * scale)
        assert most_of(term, most) <= most.upper + 1e-9 * scale


@pytest.mark.slow
def test_cells_cover_every_allowed_design_of_a_catalogue() -> None:
    """What meets its own requirements, with areas of one pair, lies in a cell of every drive."""
    problem, sizes = two_cylinders()
    proofs, count = proofs_of("catalogue"), 0
    for x in drawn_designs(problem, sizes, 150, 2):
        at = constraints_at(problem, x)
        for k, drive in enumerate(proofs[0].dual.drives):
            i = drive.cylinder
            name = problem.machine.cylinders[i].name
            own = np.array([one.endswith(f".{name}") for one in at.names])
            if at.values[own].min() < 0:
                continue
            here = coordinates(problem, i, drive.shape, x)
            place = np.append(here, problem.vector.areas(x)[i])
            leaves = [proof.maxima[k].cover for proof in proofs]
            slack = 1e-9 * np.abs(place)
            inside = [
                np.all((a - slack <= place) & (place <= b + slack), axis=1).any()
                for a, b in leaves
            ]
            assert any(inside)
            count += 1
    assert count > 20


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
