"""What a conflict says is enough: granted at once, there is a design, and the check agrees."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine, Requirements
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check, cylinder_mass
from armdesign.design.requirements.holding import Lift
from armdesign.design.requirements.record import BESIDES, Concession
from armdesign.design.requirements.speeds import Speed
from armdesign.design.search.infeasibility.concessions import conflict_error
from armdesign.design.search.infeasibility.explanation import GRANTS, design_or_proof
from armdesign.errors import InfeasibleError
from armdesign.machine.file.key_paths import bounds
from tests.design.designs import MACHINES, problem_of, workspace_of
from tests.design.search.infeasibility.conflicts import TWO, allowed, refused
from tests.machines import ANY_LIFT_AND_TORQUE

ASKED: dict[str, Callable[[Machine, np.random.Generator], dict[str, Any]]] = {
    "oil": lambda m, random: {"oil_total_share": random.uniform(0.6, 0.9)},
    "each oil": lambda m, random: {"oil_each_share": random.uniform(0.6, 0.9)},
    "thrust": lambda m, random: {"thrust_share": random.uniform(0.6, 0.95)},
    "holding": lambda m, random: {"holding_share": random.uniform(0.2, 0.6)},
    "arms": lambda m, random: {"moment_arm_share": random.uniform(1.0, 1.2)},
    "digging": lambda m, random: {
        "digging": tuple(c.name for c in m.cylinders), "digging_share": random.uniform(1.0, 1.2)
    },
    "rods": lambda m, random: {"buckling_share": random.uniform(1.0, 1.6)},
    "mass": lambda m, random: {"cylinder_mass": cylinder_mass(m) * random.uniform(0.6, 0.9)},
    "speed": lambda m, random: {
        "speeds": (Speed(name="go", cylinders={m.cylinders[0].name: random.uniform(0.5, 0.6)}),)
    },
    "lift": lambda m, random: {
        "lifts": (Lift(name="up", mass=random.uniform(3e3, 6e3),
                       joints=dict.fromkeys(m.joints, 0.0)),)
    },
}  # fmt: skip
RANDOM = [  # the first seeds that are in conflict
    *(("single", ("areas",), seed) for seed in (0, 2, 3, 5, 6)),
    *(("double", ("areas",), seed) for seed in (0, 1, 2, 3, 4, 5)),
    *(("twins", ("areas",), seed) for seed in (0,)),
    *(("single", ("areas", "pins"), seed) for seed in (0, 2, 3, 5, 8)),
    *(("double", ("areas", "pins"), seed) for seed in (2, 3, 4)),
]


OF_A_CATALOGUE = [  # the first seeds that are in conflict
    *(("double", ("areas",), "iso", seed) for seed in (0, 1, 2, 3, 4)),
    *(("double", ("areas", "pins"), "iso", seed) for seed in (1, 2, 4)),
    *(("single", ("areas", "pins"), "5mm", seed) for seed in (0, 2)),
]


def asked_at_random(machine: Machine, seed: int) -> Requirements:
    """Two to five kinds of requirements, tightened at random."""
    random = np.random.default_rng(seed)
    settings: dict[str, Any] = {}
    for kind in random.choice(sorted(ASKED), size=random.integers(2, 6), replace=False):
        settings |= ASKED[kind](machine, random)
    return replace(Requirements.of(machine), **settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "vary", "catalogue", "seed"),
    [*((name, vary, None, seed) for name, vary, seed in RANDOM), *OF_A_CATALOGUE],
)
def test_granting_what_a_conflict_says_gives_a_design(
    name: str, vary: tuple[str, ...], catalogue: str | None, seed: int
) -> None:
    """Random conflicts: with all that is said to be given at once a design is found, and the check
    agrees.
    """
    machine, workspace = MACHINES[name](), workspace_of(name)
    requirements = asked_at_random(machine, seed)
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine, workspace, requirements, vary=vary, starts=1, catalogue=catalogue)
    conflict = error.value.conflict
    refuse_beyond_the_schema(conflict)
    assert any(c.together > 0 for c in conflict)
    granted = requirements.granting(conflict)
    design = ad.optimize(machine, workspace, granted, vary=vary, starts=1, catalogue=catalogue)
    box = granted.box(machine, workspace)
    assert (
        min(
            c.slack
            for c in check(design.machine, machine, workspace, replace(granted, pin_box=box))
        )
        >= -1e-9
    )


@pytest.mark.slow
def test_granting_a_conflict_of_a_catalogue_gives_a_design_of_it() -> None:
    """What pins with free sizes must give is not enough for a catalogue: no sizes meet what
    conflicts, and what it gives is enough for those of the catalogue.
    """
    machine, workspace = MACHINES["single"](), workspace_of("single")
    requirements = replace(
        Requirements.of(machine),
        **ANY_LIFT_AND_TORQUE | TWO | {"oil_total_share": 0.6, "pin_box": 0.01},
    )
    with pytest.raises(InfeasibleError, match=r"^odd: no design meets thrust") as error:
        ad.optimize(machine, workspace, requirements, starts=1, catalogue="iso")
    granted = requirements.granting(error.value.conflict)
    design = ad.optimize(machine, workspace, granted, starts=1, catalogue="iso")
    assert min(c.slack for c in design.checks) >= -1e-9


@pytest.mark.slow
@pytest.mark.parametrize("catalogue", [None, "iso"])
def test_granting_what_the_20_t_machine_asks_for_gives_a_design_of_it(
    catalogue: str | None,
) -> None:
    """With a catalogue and 70 % of the oil, what was stated first was refused once more."""
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    requirements = replace(Requirements.of(machine), oil_total_share=0.7)
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine, workspace, requirements, starts=1, catalogue=catalogue)
    conflict = error.value.conflict
    refuse_beyond_the_schema(conflict)
    granted = requirements.granting(conflict)
    design = ad.optimize(machine, workspace, granted, starts=1, catalogue=catalogue)
    assert min(c.slack for c in design.checks) >= -1e-9


SHIPPED = [
    ("patu_boom", {"oil_total_share": 0.8}),
    ("loader_crane", {"torque_share.default": 1.2}),
    ("mini_excavator_2t", {"lift_share": 1.5}),
    ("excavator_12t", {"oil_each_share": 0.75}),  # digging counts under less torque only
    ("excavator_20t", {"torque_share": 1.2}),
    ("excavator_20t", {"oil_total_share": 0.7}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "asked"), SHIPPED)
def test_settings_as_printed_give_a_design_of_a_shipped_machine(
    name: str, asked: dict[str, float]
) -> None:
    """With what is printed, to its digits, at the paths of the file: the catalogue has a design.

    Conflicts are small, and every row of their table is relaxed.
    """
    machine = ad.load(name).replace({f"requirements.{key}": x for key, x in asked.items()})
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine)
    refuse_beyond_the_schema(error.value.conflict)
    parts = Counter(c.part for c in error.value.conflict)
    assert max(parts.values()) <= 8
    line, table = str(error.value), error.value.table
    options = re.findall(r"--set (\S+)=([\d.e-]+)", table)
    options += re.findall(r"(requirements\.[\w.]+) = ([\d.]+)", line)
    assert options
    granted = machine
    for path, value in options:
        granted = granted.replace({path: float(value)})
    design = ad.optimize(granted)
    assert min(c.slack for c in design.checks) >= -1e-9


def refuse_beyond_the_schema(conflict: tuple[Concession, ...]) -> None:
    """Every setting that is said is a number that a machine file may state."""
    for c in conflict:
        if c.value is not None and not c.inverse:
            low, high = bounds(("requirements", *c.setting.split(".")))
            assert low <= c.value <= high, c


def held_eight_tenths() -> Machine:
    """The machine "single" with such a payload that its cylinder carries about 0.8 of what it
    holds.
    """
    light = MACHINES["single"]()
    path = f"payload.{light.payload.name}.mass_kg"
    heavy = light.replace({path: light.payload.mass + 1000.0})
    per_kg = (held(heavy) - held(light)) / 1000.0
    return light.replace({path: light.payload.mass + (0.8 - held(light)) / per_kg})


def held(machine: Machine) -> float:
    """Largest static load of the cylinder over what the supply gives."""
    checks = check(machine, machine, workspace_of("single"), Requirements.of(machine))
    return next(c.value for c in checks if c.name == "holding.lift")


@pytest.mark.slow
def test_no_holding_share_above_one_is_asked_for() -> None:
    """By hand: a load of 0.8 of what the cylinder holds, and a thrust of 0.6 of today's.

    Equal shares would be √(0.8/(0.6 · 0.87)) = 1.24 of both limits, that is 1.08 of holding; a
    file may state 1 at most, so the thrust gives the rest: 0.8, not 0.6 · 1.24 = 0.74. A step of
    0.1 mm of the bore is 0.2 % of the area, and amounts are tried in steps of 1 % of a limit.
    """
    machine, workspace = held_eight_tenths(), workspace_of("single")
    requirements = replace(Requirements.of(machine), thrust_share=0.6, **ANY_LIFT_AND_TORQUE)
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine, workspace, requirements, ("areas",), starts=1)
    refuse_beyond_the_schema(error.value.conflict)
    values = {c.setting: c.value for c in error.value.conflict}
    assert values["holding_share.lift"] == pytest.approx(1, rel=4e-3)
    assert 0.8 <= values["thrust_share.lift"] <= 0.8 + 0.012 * 0.8
    granted = requirements.granting(error.value.conflict)
    ad.optimize(machine, workspace, granted, ("areas",), starts=1)


@pytest.mark.slow
def test_no_holding_share_above_one_is_asked_for_with_a_catalogue() -> None:
    """By enumeration: of bores in steps of 0.1 mm the least that holds the load at all.

    Smaller ones need equal shares of thrust and holding, which no file may state; they made the
    answer go on to another round, which took 2.7 % more thrust than is needed.
    """
    machine, workspace = held_eight_tenths(), workspace_of("single")
    requirements = replace(Requirements.of(machine), thrust_share=0.6, **ANY_LIFT_AND_TORQUE)
    (cylinder,), bores = machine.cylinders, [bore / 1e4 for bore in range(700, 1001)]
    enough = min(
        bore
        for bore in bores
        if held(replace(machine, cylinders=(replace(cylinder, bore=bore),))) <= 1
    )
    catalogue = [(bore, cylinder.rod) for bore in bores]
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine, workspace, requirements, ("areas",), catalogue=catalogue)
    refuse_beyond_the_schema(error.value.conflict)
    values = {c.setting: c.value for c in error.value.conflict}
    assert values["thrust_share.lift"] == pytest.approx((enough / cylinder.bore) ** 2, rel=1e-5)
    granted = requirements.granting(error.value.conflict)
    ad.optimize(machine, workspace, granted, ("areas",), catalogue=catalogue)


def test_what_conflicts_still_after_all_grants_is_named() -> None:
    """Refusals that go on, each of what was granted before: the last is told by name."""
    problem, looked_at = problem_of("single", ("areas",)), []

    def never(given: Problem, any_will_do: bool) -> None:
        looked_at.append(given.requirements.setting("thrust_share.lift") + 0.01)
        checks = check(given.machine, given.machine, given.workspace, given.requirements)
        (thrust,) = (c for c in checks if c.name == "thrust.lift")
        identity, amount = thrust.identity, 0.01 * thrust.limit
        one = Concession(**identity, together=amount, alone=None, value=looked_at[-1])
        raise conflict_error("odd", [one])

    with pytest.raises(InfeasibleError, match=r"when all before was granted, thrust\.lift"):
        design_or_proof(problem, never, catalogue=False)
    assert len(looked_at) == GRANTS


def refused_in_turn(
    asked: Sequence[tuple[str, float]], amount: float, drawn: bool = False
) -> Callable[[Problem, bool], str]:
    """A search that is refused for each of some requirements, which ask for a value, then ends."""
    wanted = list(asked)

    def design(problem: Problem, any_will_do: bool) -> str:
        machine, space = problem.machine, problem.workspace
        checks = {c.name: c for c in check(machine, machine, space, problem.requirements)}
        if not wanted:
            return "a design"
        name, value = wanted.pop(0)
        one = Concession(**checks[name].identity, together=amount, alone=None, value=value)
        refusal = conflict_error("odd", [one])
        refusal.drawn = drawn
        raise refusal

    return design


def test_digging_that_counts_only_under_less_torque_joins_a_conflict() -> None:
    """Digging says nothing until the torque gives way: its refusal ended in a KeyError before."""
    settings: dict[str, Any] = {"torque_share": 0.99, "digging_share": 0.97, "digging": ("lift",)}
    problem = problem_of("single", ("areas",), **settings)
    design = refused_in_turn([("torque.extending.lift", 0.9), ("digging.lift", 0.91)], 0.05)

    with pytest.raises(InfeasibleError) as error:
        design_or_proof(problem, design, catalogue=False)
    torque, digging = error.value.conflict
    assert (torque.value, digging.value) == (0.9, 0.91)
    assert torque.together / torque.limit == pytest.approx(1 - 0.9 / 0.99)
    assert digging.together / digging.limit == pytest.approx(1 - 0.91 / 0.97)


def test_granting_a_little_less_than_one_alone_must_give_does_not() -> None:
    """By hand: the thrust alone must allow a bore of 99.5 mm, because 99.4 digs 0.0020 too
    little.
    """
    thrust, _ = refused("single", ("areas",), **TWO).conflict
    assert thrust.alone is not None
    share = 0.9 * (1 + thrust.alone / thrust.limit)
    allowed("single", ("areas",), **TWO | {"thrust_share": share})
    refused("single", ("areas",), **TWO | {"thrust_share": share - 1e-4})


def test_what_gives_besides_is_said_to_be_in_no_conflict() -> None:
    """At a supply that bears a load of 1.3 of what it can hold, today's machine meets all other
    requirements, so that none of them conflict without it. Less than all of its oil and thrust
    cannot give enough, as no share of holding above 1 is allowed.
    """
    machine, space = MACHINES["single"](), workspace_of("single")
    today = {c.name: c for c in check(machine, machine, space, Requirements.of(machine))}
    supply = machine.supply.pressure * today["holding.lift"].value / 1.3
    weak = machine.replace({"supply.pressure_bar": supply / 1e5})
    missed = [c.name for c in check(weak, weak, space, Requirements.of(weak)) if c.slack < 0]
    assert missed == ["holding.lift"]
    with pytest.raises(InfeasibleError, match=r"as these alone gave no design, oil") as error:
        ad.optimize(weak, space, None, ("areas",))
    parts = {c.name: c.part for c in error.value.conflict}
    in_conflict = {name for name, part in parts.items() if part != BESIDES}
    assert "holding.lift" in in_conflict
    assert {parts[name] for name in in_conflict} == {0}
    assert {"oil.cap.total", "oil.cap.lift"} <= set(parts) - in_conflict
    assert ", nor" not in str(error.value)
    granted = Requirements.of(weak).granting(error.value.conflict)
    ad.optimize(weak, space, granted, ("areas",))


def test_few_give_where_a_conflict_alone_cannot_give_enough() -> None:
    """At a supply that bears a load of 1.6 of what it can hold: shares as equal as can be asked
    for 15 and 28 % of two torques, besides.
    """
    machine, space = MACHINES["single"](), workspace_of("single")
    today = {c.name: c for c in check(machine, machine, space, Requirements.of(machine))}
    supply = machine.supply.pressure * today["holding.lift"].value / 1.6
    weak = machine.replace({"supply.pressure_bar": supply / 1e5})
    with pytest.raises(InfeasibleError, match="besides") as error:
        ad.optimize(weak, space, None, starts=1)
    given = {c.name: c.together / c.limit for c in error.value.conflict if c.together > 0}
    assert set(given) == {"holding.lift", "thrust.lift"}
    assert given["thrust.lift"] < 0.67 + 0.15 + 0.28
    granted = Requirements.of(weak).granting(error.value.conflict)
    ad.optimize(weak, space, granted, starts=1)


def test_what_no_setting_can_give_is_said() -> None:
    """A load that is far too heavy: the setting to relax was one that it has already."""
    heavy = ad.load("paper_1dof").replace({"payload.load.mass_kg": 5000})
    space = ad.Workspace.grid(heavy, points=3)
    with pytest.raises(InfeasibleError, match=r"which no setting of a file allows$") as error:
        ad.optimize(heavy, space, starts=1)
    (holding,) = error.value.conflict
    assert (holding.name, holding.value) == ("holding.lift", None)
    assert holding.together > 5


@pytest.mark.parametrize("needed", [True, False])
def test_conflicts_with_a_common_requirement_are_one(needed: bool) -> None:
    """A later refusal may conflict with what an earlier one names: by itself the rest of it may
    not. What gives besides is asked for where there is no design without it; it always was.
    """
    problem = problem_of("single", ("areas",))
    checks = check(problem.machine, problem.machine, problem.workspace, problem.requirements)
    known = {c.name: c for c in checks}
    asked = [{"thrust.lift": 0, "buckling.lift": 0, "oil.cap.lift": BESIDES},
             {"buckling.lift": 0, "oil.cap.total": 0}, {"holding.lift": 0}]  # fmt: skip

    oil = known["oil.cap.lift"].setting
    today = problem.requirements.setting(oil)

    def design(problem: Problem, any_will_do: bool) -> str:
        if not asked and (problem.requirements.setting(oil) > today or not needed):
            return "a design"
        conflict = []
        for name, part in (asked.pop(0) if asked else {"thrust.lift": 0}).items():
            c = known[name]
            value = problem.requirements.setting(c.setting) * (0.99 if c.at_least else 1.01)
            amount = 0.01 * c.limit
            conflict.append(
                Concession(**c.identity, together=amount, alone=None, part=part, value=value)
            )
        raise conflict_error("odd", conflict)

    with pytest.raises(InfeasibleError) as error:
        design_or_proof(problem, design, catalogue=False)
    one = "thrust.lift together with buckling.lift and oil.cap.total"
    alone = "as these alone gave no design, oil.cap.lift gives besides; " if needed else ""
    assert f"no design meets {one}, nor holding.lift; {alone}relax" in str(error.value)
    assert [c.part for c in error.value.conflict] == [0, 0, 0, 1, *([BESIDES] if needed else [])]


@pytest.mark.parametrize(("catalogue", "count"), [(True, 2), (False, 1)])
def test_what_a_search_of_a_catalogue_refuses_again_is_asked_for_at_once(
    catalogue: bool, count: int
) -> None:
    """A machine had been drawn with sizes that the search does not choose under what it asked
    for: "which is enough" stood there, and granted it was refused.
    """
    problem = problem_of("single", ("areas",))
    design = refused_in_turn([("thrust.lift", 1.2), ("buckling.lift", 0.9)], 0.1, drawn=True)

    with pytest.raises(InfeasibleError) as error:
        design_or_proof(problem, design, catalogue=catalogue)
    assert [c.value for c in error.value.conflict] == [1.2, 0.9][:count]
