"""Prices of requirements: the relative gain in the worst frequency from relaxing each by 1 %.

At the margin a price is a multiplier; the price of the whole 1 % is found by solving again from
the optimum: another limit may soon be met, and designs of nearly the same frequency may lie far
apart, so that no box around this one holds the answer. Not where it buys next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.design.program.constraints import evaluations_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.sequential_sdp import Search
from armdesign.design.search.slsqp import improve_by_slsqp
from armdesign.design.search.trust_region import box_around
from armdesign.errors import InfeasibleError

RELAXED = 0.01  # share by which a requirement is relaxed to price it
TRUST, LOOKS = 0.05, 2  # with which that is solved again,
# until a step promises less than this of ω², or than this share of what is expected
FINE, ENOUGH = 1e-7, 0.01
LEAST_PRICE = 1e-6  # gain in frequency below which a requirement has no price,
# and below which its multiplier is the price: it is printed as 0.00 %, solved again or not
BY_MULTIPLIER = 1e-5


@dataclass(frozen=True)
class Price:
    """Relative gain in the worst frequency from relaxing a requirement by 1 %."""

    at_margin: float  # gain per 1 % for a small relaxation
    gain: float  # of the whole 1 %


@np.errstate(invalid="ignore", divide="ignore")  # a dead centre on the way is no better
def prices(search: Search) -> dict[str, Price]:
    """Price of each requirement at an optimum.

    Requirements that one setting states are relaxed together, as a designer relaxes them, and
    share the gain by their multipliers.
    """
    optimum = replace(search).run(TRUST, 10 * FINE, LOOKS)
    problem, margins = optimum.problem, marginal_prices(optimum)
    settings = {
        c.name: problem.requirements.stated_at(c.setting)
        for c in evaluations_at(problem, search.x, search.holding)
        if c.setting
    }
    together: dict[str, list[str]] = {}
    for name in margins:
        together.setdefault(settings.get(name) or name, []).append(name)
    priced: dict[str, Price] = {}
    for names in together.values():
        expected = sum(margins[name] for name in names)
        share = _gain(optimum, names, expected) / expected if expected > BY_MULTIPLIER else 1.0
        priced |= {name: Price(margins[name], share * margins[name]) for name in names}
    return priced


def marginal_prices(search: Search) -> dict[str, float]:
    """Relative gain in the worst frequency per 1 % of each requirement, by its multiplier."""
    trial, bounds, at = search.trial(), search.bounds, search.limits
    box = box_around(search.x, bounds, TRUST)
    model = search.linearised(trial, search.active(trial.squared), box)
    try:
        step = model.solve(box)
    except InfeasibleError:  # the solver gave up: nothing is known
        return {}
    scale = 0.5 * search.reference / float(trial.squared.min())  # f ~ sqrt(λ)
    multipliers = np.zeros(len(at.values))
    multipliers[model.kept] = search.strictness * step.multipliers[: len(model.kept)]
    # a limit that no variable moves has no price, whatever the solver's multiplier says
    multipliers[~np.any(at.jacobian[:, bounds[1] > bounds[0]] != 0, axis=1)] = 0.0
    # of the ends of x; the trust region's are left out
    at_end = np.where(box[1] < TRUST, step.high_multipliers, 0)
    at_end = at_end + np.where(box[0] > -TRUST, step.low_multipliers, 0)
    names = (*at.names, *_pin_boxes(search.problem))
    of_boxes = RELAXED * bounds[1] * at_end * scale
    all_gains = np.concatenate([multipliers * at.per_percent * scale, of_boxes])
    gains: dict[str, float] = {}
    for name, gain in zip(names, all_gains.tolist(), strict=True):
        gains[name] = gains.get(name, 0.0) + gain
    gains.pop("", None)
    return gains


def _pin_boxes(problem: Problem) -> list[str]:
    """Name of the pin box that bounds each entry of x; empty for areas."""
    cylinders = problem.machine.cylinders
    return [
        f"pin_box.{cylinders[v.cylinder].name}.{v.pin}" if v.pin else ""
        for v in problem.vector.variables
    ]


def _gain(optimum: Search, names: Sequence[str], expected: float) -> float:
    """Relative gain in frequency from an optimum with requirements relaxed by 1 %.

    What the optimum has seen of the workspace holds for it too: frequencies have not changed.
    """
    low, high = optimum.bounds
    more = RELAXED * high * np.isin(_pin_boxes(optimum.problem), names)
    problem = optimum.problem.relaxed(dict.fromkeys(names, RELAXED))
    eased = optimum.of(problem, optimum.x, (low - more, high + more))
    if problem.vector.moves_within:  # steps would zigzag
        eased = improve_by_slsqp(eased.look())
    eased.run_on(TRUST, max(FINE, ENOUGH * expected), LOOKS)
    return math.sqrt(max(eased.squared / optimum.squared, 1.0)) - 1
