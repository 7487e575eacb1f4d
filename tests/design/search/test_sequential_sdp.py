"""Areas and pins together: never worse than a global method, no better neighbour, DESIGN.md's
figures, odd machines.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cma
import numpy as np
import pytest
from scipy.optimize import differential_evolution

import armdesign as ad
from armdesign import ArmDesignError, Requirements, Workspace
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.holding import Lift
from armdesign.design.requirements.speeds import Speed
from armdesign.design.search.prices import prices
from armdesign.design.search.sequential_sdp import Search
from armdesign.errors import InfeasibleError
from tests.design.by_machine import true_frequencies
from tests.design.designs import MACHINES, as_machine, double, problem_of, solved, workspace_of
from tests.design.search.excavator_designs import POINTS, excavator_design
from tests.machines import named
from tests.reference_planar import Reference

# -------------------------------------------------------------------------- is it really the best?


def cost_of(problem: Problem) -> Callable[[np.ndarray], float]:
    """What the global methods make least: −ω² over the scale, and an exact penalty."""

    def cost(x: np.ndarray) -> float:
        missed = np.maximum(-constraints_at(problem, x).values, 0.0).sum()
        return float(
            -problem.dynamics.omega_squared(x).min() / problem.dynamics.omega_squared_scale
            + 30 * missed
        )

    return cost


def by_evolution(problem: Problem, low: np.ndarray, high: np.ndarray, generations: int) -> float:
    box = list(zip(low, high, strict=True))
    evolution = differential_evolution(
        cost_of(problem), box, maxiter=generations, popsize=6, seed=1, polish=False, tol=0
    )  # fmt: skip
    return float(evolution.fun)


def by_adaptation(problem: Problem, low: np.ndarray, high: np.ndarray, generations: int) -> float:
    settings = {"bounds": [low, high], "seed": 1, "maxiter": 4 * generations, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(problem.vector.start, 0.1, settings).optimize(
        cost_of(problem)
    )
    return float(strategy.result.fbest)


@pytest.mark.slow
@pytest.mark.parametrize("method", [by_evolution, by_adaptation])
@pytest.mark.parametrize(("name", "generations"), [("single", 40), ("double", 20)])
def test_never_worse_than_a_global_method(
    name: str, generations: int, method: Callable[..., float]
) -> None:
    """Differential evolution and CMA-ES, which know no gradients, on the same problem with a
    penalty.
    """
    problem = problem_of(name)
    areas = np.array([v.pin is None for v in problem.vector.variables])
    low, high = problem.bounds
    # no wider than any good design needs
    low, high = np.where(areas, 0.5, low), np.where(areas, 1.5, high)
    globally = method(problem, low, high, generations)
    search = solved(problem, 1e-6)
    assert search.violation < 1e-7
    assert search.squared / problem.dynamics.omega_squared_scale > -globally * (1 - 1e-5)
    assert -globally > 1.1  # it did find something


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "vary"),
    [
        ("single", ("areas", "pins")),
        ("double", ("areas", "pins")),
        ("excavator", ("areas", "pins")),
        ("excavator", ("areas", "linkages")),
        ("excavator", ("cylinder.bucket", "cylinder.boom.bore_mm")),
    ],
)
def test_no_better_neighbour(name: str, vary: tuple[str, ...]) -> None:
    """Moves in every direction, and along the gradient, that keep all requirements gain less than
    1e-4.
    """
    problem = problem_of(name, vary)
    search = solved(problem, 1e-6)
    random = np.random.default_rng(5)
    low, high = problem.bounds
    worst = np.argsort(problem.dynamics.omega_squared(search.x))[:6]
    base, slopes = problem.dynamics.scaled_stiffness_and_gradient(search.x, worst)
    gradients = [
        np.einsum("i,vij,j->v", v[:, 0], slopes[:, k], v[:, 0])
        for k, v in enumerate(np.linalg.eigh(base)[1])
    ]  # fmt: skip
    directions = [*random.normal(size=(150, len(low))), *gradients, sum(gradients)]
    tried = 0
    for direction in directions:
        for size in (1e-3, 1e-2, 0.05):
            x = np.clip(search.x + size * direction / np.abs(direction).max(), low, high)
            if problem.vector.closes(x) and problem.dynamics.omega_squared(
                x, search.rows
            ).min() > search.squared * (1 + 1e-4):
                assert constraints_at(problem, x).values.min() < -1e-7
            tried += 1
    assert tried > 400


# ----------------------------------------------------------------------------------- the excavator


@pytest.mark.slow
def test_excavator_gains_a_third() -> None:
    """DESIGN.md: an independent prototype of this problem found +36 % from every start; the issue
    asks for +35 %.
    """
    design = excavator_design()
    today = design.before.frame["f1_hz"].min()
    assert design.unrounded > 1.35 * today
    assert design.after.frame["f1_hz"].min() > 0.995 * design.unrounded
    assert design.after.worst.frequency > 1.34 * design.before.worst.frequency
    assert min(design.slacks.values()) >= 0
    assert max(design.starts) / min(design.starts) < 1.002
    assert len(design.starts) == 3


@pytest.mark.slow
def test_excavator_by_the_independent_reference(tmp_path: Path) -> None:
    """tests/reference_planar.py reads the saved files itself: worst frequency to 1e-5, every
    requirement it knows.

    Its digging force at the tool (the bucket standing where it digs best) is not the torque that
    binds here.
    """
    design = excavator_design()
    new = Reference.load(design.machine.save(tmp_path / "new.toml"))
    old = Reference.load(Path(design.today.source))
    frequency, _, _ = new.worst(points=POINTS, workspace_of=old)
    assert design.after.worst.frequency == pytest.approx(frequency, rel=1e-5)
    judged = new.requirements(old, points=(7, 7, 9))
    assert len(judged) > 30
    assert [
        name for name, (_, _, met) in judged.items() if not met and not name.startswith("digging ")
    ] == []
    # the force at the tooth depends on where the bucket stands: within 2 %
    for name in ("stick", "bucket"):
        value, limit, _ = judged[f"digging {name}"]
        assert value > limit - 0.02


@pytest.mark.slow
def test_same_seed_same_machine() -> None:
    machine = named("rigid_excavator_20t")
    again = ad.optimize(machine, Workspace.grid(machine, points=POINTS))
    assert again.machine.text == excavator_design().machine.text


@pytest.mark.slow
def test_gain_of_more_oil_is_its_worth() -> None:
    """Envelope theorem, against solving again with 0.2 % more oil (times five).

    15 %: the search stops at 1e-6 of ω² here, the gain is 1e-3 of it, and limits come and go on
    the way.
    """
    problem = problem_of("excavator")
    search, more = (
        solved(problem_of("excavator", oil_total_share=share), 1e-7) for share in (1.0, 1.002)
    )
    worth = prices(search)
    gain = 5 * (math.sqrt(more.squared / search.squared) - 1)
    assert gain > 0
    priced = worth["oil.cap.total"].at_margin + worth["oil.annulus.total"].at_margin
    assert priced == pytest.approx(gain, rel=0.15)
    assert set(worth) >= set(constraints_at(problem, problem.vector.start).names)


def _lift(k: float) -> dict[str, Any]:
    pose = {"boom": 0.0, "stick": -1.5, "bucket": -0.5}
    return {"lifts": (Lift(name="front", mass=7700 * (2 - k), joints=pose),)}


def _speed(k: float) -> dict[str, Any]:
    return {"speeds": (Speed(name="up", joints={"boom": 0.362 / k, "stick": -0.362 / k}),)}


RELAXED: dict[
    str, Callable[[float], dict[str, Any]]
] = {  # settings with a limit relaxed by a factor k − 1
    "lift.front": _lift,
    "speed.up": _speed,
    "oil.": lambda k: {"oil_each_share": 1.03 * k},
    "oil.cap.total oil.annulus.total": lambda k: {"oil_total_share": k},
    "thrust.": lambda k: {"thrust_share": 1.02 * k},
    "holding.": lambda k: {"holding_share": 0.667 * k},
    "buckling.": lambda k: {"buckling_share": 1.1 * (2 - k)},
    "digging.": lambda k: {"digging_share": 0.98 * (2 - k)},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RELAXED)
def test_worth_is_what_solving_again_says(name: str) -> None:
    """Sizes and pins: the whole 1 %, 5 %; pins far apart are nearly as good, so the optimum moves
    far for little.
    """
    search = solved(problem_of("excavator", **RELAXED[name](1.0)))
    eased = problem_of("excavator", **RELAXED[name](1.01))
    again = Search(problem=eased, x=eased.like(search.x, search.problem)).run(0.1, 1e-8)
    gain = math.sqrt(again.squared / search.squared) - 1
    assert gain > 1e-4
    kept = () if " " in name else ("oil.cap.total", "oil.annulus.total")  # another setting's
    names = tuple(name.split())
    worth = sum(
        w.gain
        for label, w in prices(search).items()
        if label.startswith(names) and label not in kept
    )
    assert worth == pytest.approx(gain, rel=0.05)


# --------------------------------------------------------------------------------- sets of designs


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"oil_total_share": 0.95},
        {"thrust_share": 1.0},
        {"pin_box": 0.1},
        {"moment_arm_share": 1.0},
        {"digging_share": 1.0},
    ],
    ids=lambda c: next(iter(c)),
)
def test_tighter_never_helps_and_looser_never_hurts(changes: dict[str, float]) -> None:
    """Fewer designs allowed, no better best one. 1e-3: what starts differ by."""
    tight, default = (
        solved(problem_of("excavator", **changes), 1e-5),
        solved(problem_of("excavator"), 1e-5),
    )
    assert max(tight.violation, default.violation) < 1e-6
    assert tight.squared <= default.squared * (1 + 1e-3)


def test_order_of_cylinders_does_not_matter() -> None:
    """The same machine with its cylinders written the other way round, from today's pins."""
    reached = []
    for reverse in (False, True):
        machine = double(reverse)
        space = Workspace.grid(machine, points=5)
        problem = Problem.of(
            machine=machine, workspace=space, requirements=Requirements(), vary=("areas", "pins")
        )
        reached.append(solved(problem, 1e-6).squared)
    assert reached[0] == pytest.approx(reached[1], rel=1e-4)


def test_more_freedom_is_never_worse() -> None:
    """Areas and pins together beat either alone."""
    both, areas, pins = (
        solved(problem_of("double", vary), 1e-6).squared
        for vary in (("areas", "pins"), ("areas",), ("pins",))
    )
    assert both > max(areas, pins) * (1 - 1e-6)


def test_optimum_is_that_of_the_machine_it_describes() -> None:
    problem = problem_of("excavator")
    search = solved(problem, 1e-4)
    assert math.sqrt(search.squared) / (2 * math.pi) == pytest.approx(
        true_frequencies(problem, search.x).min(), rel=1e-9
    )
    assert (
        as_machine(problem, search.x).cylinders[0].stroke
        < problem.machine.cylinders[0].stroke * 1.2
    )


# ------------------------------------------------------------------------------- bad and odd input


@pytest.mark.slow
def test_no_design() -> None:
    machine, space = MACHINES["excavator"](), workspace_of("excavator")
    for setting, word in (
        ({"moment_arm_share": 3.0}, "moment_arm"),
        ({"holding_share": 0.01}, "holding"),
    ):
        with pytest.raises(InfeasibleError, match=word) as error:
            ad.optimize(machine, space, replace(Requirements.of(machine), **setting), starts=1)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("vary", [(), ("links",), ("areas", "pin")])
def test_unknown_freedom(vary: tuple[str, ...]) -> None:
    with pytest.raises(ArmDesignError, match="vary"):
        ad.optimize(MACHINES["double"](), workspace_of("double"), vary=vary)


@pytest.mark.slow
def test_a_missed_requirement_is_repaired() -> None:
    """Today's boom cylinders carry 53 % of what the supply holds; at most 52 % is asked: that
    comes first.
    """
    machine, space = MACHINES["excavator"](), workspace_of("excavator")
    requirements = replace(Requirements.of(machine), holding_share=0.52)
    problem = Problem.of(
        machine=machine, workspace=space, requirements=requirements, vary=("areas", "pins")
    )
    assert constraints_at(problem, problem.vector.start).values.min() < -1e-3
    design = ad.optimize(machine, space, requirements, starts=1)
    assert min(design.slacks.values()) >= 0
    assert design.slacks["holding.boom"] < 0.01


@pytest.mark.slow
def test_the_most_loaded_pose_is_found_wherever_it_is() -> None:
    """3 t in the bucket: holding binds at a corner of the workspace, which a regular share of its
    poses skips.
    """
    machine = named("rigid_excavator_20t").replace({"payload.full.mass_kg": 3000.0})
    design = ad.optimize(machine, Workspace.grid(machine, points=(10, 10, 15)), starts=1)
    assert design.slacks["holding.boom"] >= 0
    assert design.unrounded > 1.25 * design.before.frame["f1_hz"].min()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "paper_1dof",
        "four_bar_right",
        "four_bar_from_boom",
        "spatial",
        "crossing",
        "branched",
        "redundant",
        "random_3",
    ],
)
@pytest.mark.parametrize("vary", [("areas", "pins"), ("areas",)])
def test_odd_machines(name: str, vary: tuple[str, ...]) -> None:
    """One joint; a four-bar across a joint; skew joints and a telescope; a cylinder across two
    joints; more cylinders
    than joints; air, hoses, compliance; nearly unstable: all requirements met, never worse than
    today's."""
    machine = named(name)
    space = Workspace.grid(machine, points=4)
    design = ad.optimize(machine, space, vary=vary, starts=1)
    assert min(design.slacks.values()) >= -1e-9
    today = design.before.frame["f1_hz"].min()
    assert design.unrounded >= today * (1 - 1e-9)
    assert design.after.frame["f1_hz"].min() >= min(today, 0.99 * design.unrounded)
    if "pins" in vary:
        assert design.unrounded > 1.05 * today


def test_without_payload_or_box() -> None:
    """A machine that carries nothing; pins that may not move."""
    machine = named("rigid_excavator_20t").replace(
        {"payload.full.mass_kg": 0.0, "requirements.pin_box_mm": 0.0}
    )
    design = ad.optimize(machine, Workspace.grid(machine, points=(5, 5, 9)))
    assert len(design.starts) == 1
    assert [k.base for k in design.machine.linkages] == [k.base for k in machine.linkages]
    assert min(design.slacks.values()) >= 0


@pytest.mark.slow
def test_pins_alone() -> None:
    machine, space = MACHINES["excavator"](), workspace_of("excavator")
    design = ad.optimize(machine, space, vary=("pins",), starts=1)
    assert [(c.bore, c.rod) for c in design.machine.cylinders] == [
        (c.bore, c.rod) for c in machine.cylinders
    ]
    assert design.unrounded > 1.2 * design.before.frame["f1_hz"].min()
    assert min(design.slacks.values()) >= 0


def test_wide_limits_are_used() -> None:
    """Nothing but the requirements bounds the areas: with thrust and oil nine times today's, bores
    grow ninefold.
    """
    machine, space = MACHINES["single"](), workspace_of("single")
    wide = Requirements(oil_total_share=9.0, oil_each_share=9.0, thrust_share=9.0)
    problem = Problem.of(machine=machine, workspace=space, requirements=wide, vary=("areas",))
    assert Search(problem=problem, x=problem.vector.start).run(trust=1.0).x[0] == pytest.approx(
        9.0, rel=1e-6
    )
