"""Conflicts: by hand where areas alone vary, by solving again where pins do."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine, Requirements
from armdesign.design.program.constraints import holding_rows
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check, cylinder_mass
from armdesign.design.requirements.holding import Lift
from armdesign.design.requirements.oil import Speed
from armdesign.design.requirements.places import Clearance
from armdesign.design.requirements.record import Concession
from armdesign.design.search.infeasibility.concessions import (
    conflict_error,
    conflict_rows,
    nearest_error,
)
from armdesign.design.search.infeasibility.irreducible_subset import ConflictSearch
from armdesign.design.search.infeasibility.refusal import GRANTS, design_or_proof
from armdesign.design.search.multistart import formulate
from armdesign.errors import InfeasibleError
from armdesign.machine.file.key_paths import bounds
from armdesign.units import outward
from tests.design.designs import MACHINES, problem_of, workspace_of
from tests.machines import ANY_LIFT_AND_TORQUE, four_bar


def refused(name: str, vary: tuple[str, ...], **settings: Any) -> InfeasibleError:
    machine = MACHINES[name]()
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(
            machine,
            workspace_of(name),
            replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE | settings),
            vary=vary,
            starts=1,
        )
    return error.value


def allowed(name: str, vary: tuple[str, ...], **settings: Any) -> None:
    """A design meets them: does not raise."""
    machine = MACHINES[name]()
    ad.optimize(
        machine,
        workspace_of(name),
        replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE | settings),
        vary=vary,
        starts=1,
    )


def test_one_against_the_box() -> None:
    """Pins that stay: today's moment arm is what there is, 1/1.2 of what is asked."""
    error = refused("single", ("areas",), moment_arm_share=1.2)
    (only,) = error.conflict
    assert (only.name, only.at_least, only.unit) == ("moment_arm.lift", True, "m/rad")
    assert only.together == pytest.approx(only.limit * (1 - 1 / 1.2), rel=1e-6)
    assert only.alone == only.together
    assert "no design meets moment_arm.lift" in str(error)
    assert "relax it by 137.6 mm (17 %)" in str(error)
    assert str(error).endswith(", which is enough but not proved least")
    assert error.table == ""
    assert "besides" not in str(error)


def test_one_against_the_pin_box() -> None:
    """Pins within 20 mm: what it must give is what the best of a grid over the box still lacks."""
    settings = {
        "moment_arm_share": 1.2,
        "pin_box": 0.02,
        "oil_total_share": 9.0,
        "oil_each_share": 9.0,
    }
    (only,) = refused("single", ("pins",), **settings).conflict
    problem = problem_of("single", ("pins",), **settings)
    most = 0.0
    for corner in np.ndindex(*[3] * 4):
        x = problem.vector.start.copy()
        x[2:] = np.array(corner) - 1.0
        (linkage,), (poses,) = problem.vector.linkages(x), problem.vector.range_poses
        assert poses is not None
        most = max(most, float(np.abs(linkage.actuation(poses).moment_arm[:, 0]).min()))
    assert only.name == "moment_arm.lift"
    # the dead length may hold it back
    assert only.together == pytest.approx(only.limit - most, rel=0.02)
    assert only.together >= (only.limit - most) * (1 - 1e-6)


TWO = {"thrust_share": 0.9, "digging": ("lift",), "digging_share": 0.99}


def test_two_by_hand() -> None:
    """A ≤ 0.9 and A ≥ 0.99 of today's: both give t with 0.9 (1 + t) = 0.99 (1 − t), one alone 0.09
    of today's.

    t is 0.0476, that is a bore of 97.1008 mm: of the grid 97.1 is nearest. The digging torque
    alone asks for at most 94.8683 mm, so 94.8; the thrust alone for at least 99.4987, so 99.5.
    """
    error = refused("single", ("areas",), **TWO)
    thrust, digging = error.conflict
    assert (thrust.name, digging.name) == ("thrust.lift", "digging.lift")
    # six digits of a setting
    assert thrust.together / thrust.limit == pytest.approx(0.971**2 / 0.9 - 1, rel=1e-4)
    assert digging.together / digging.limit == pytest.approx(1 - 0.971**2 / 0.99, rel=1e-4)
    assert thrust.alone == pytest.approx(thrust.limit * (0.995**2 / 0.9 - 1), rel=1e-4)
    assert digging.alone == pytest.approx(digging.limit * (1 - 0.948**2 / 0.99), rel=1e-4)
    assert (thrust.setting, digging.setting) == ("thrust_share.lift", "digging.share")
    assert thrust.value == pytest.approx(0.971**2, rel=1e-6)
    assert digging.value == pytest.approx(0.971**2, rel=1e-6)
    text = str(error)
    assert "no design meets thrust.lift together with digging.lift; relax them: " in text
    heads, *rows = error.table.splitlines()
    assert heads.split("  ")[0] == "requirement"
    assert heads.endswith("or it alone by")
    assert rows[0].startswith("thrust.lift   thrust of the lift cylinder")
    assert "at most" in rows[0]
    assert "at least" in rows[1]
    assert rows[0].endswith("(11 %)")


@pytest.mark.slow
def test_two_without_either() -> None:
    """Irreducible, and the amounts suffice: without one, or with what it gives, there is a design;
    a bit less, none.
    """
    allowed("single", ("areas",), **TWO | {"digging": ()})
    allowed("single", ("areas",), **TWO | {"thrust_share": 1.1})
    allowed("single", ("areas",), **TWO | {"thrust_share": 0.9 * 1.1005})
    refused("single", ("areas",), **TWO | {"thrust_share": 0.9 * 1.0995})


def test_three_by_hand() -> None:
    """Both bores at least 0.99 of today's, their oil together at most 0.9: no two of the three
    conflict.

    All give t with 0.99 (1 − t) = 0.9 (1 + t); the oil alone 0.09 of today's.
    """
    settings = {"oil_total_share": 0.9, "digging": ("lift", "fold"), "digging_share": 0.99}
    conflict = refused("double", ("areas",), **settings).conflict
    found = {c.name: c for c in conflict}
    assert list(found) == ["oil.cap.total", "digging.lift", "digging.fold"]
    for c in conflict:  # what rounding takes: a grid step of a bore is 0.2 % of its area
        assert c.together / c.limit == pytest.approx(0.09 / 1.89, rel=0.02)
    assert found["oil.cap.total"].alone == pytest.approx(
        found["oil.cap.total"].limit * 0.1, rel=0.02
    )
    swept = np.array([c.bore_area * c.stroke for c in MACHINES["double"]().cylinders])
    for name, own in zip(("digging.lift", "digging.fold"), swept, strict=True):
        # of its limit: all of the oil that lacks, from one bore
        share = 0.09 * swept.sum() / own / 0.99
        assert found[name].alone == pytest.approx(share * found[name].limit, rel=0.02)


@pytest.mark.slow
def test_pins_in_a_conflict() -> None:
    """Areas and pins: with 2 % more than the oil alone must give there is a design, with 2 % less
    none.
    """
    settings = {
        "oil_total_share": 0.4,
        "digging": ("lift",),
        "digging_share": 1.3,
        "pin_box": 0.05,
        "thrust_share": 2.0,
    }
    vary = ("areas", "pins")
    error = refused("single", vary, **settings)
    names = [c.name for c in error.conflict]
    assert 2 <= len(names) <= 3
    assert "oil.cap.total" in names
    (oil,) = (c for c in error.conflict if c.name == "oil.cap.total")
    assert oil.alone is not None
    needed = 0.4 * oil.alone / oil.limit
    allowed("single", vary, **settings | {"oil_total_share": 0.4 + 1.02 * needed})
    refused("single", vary, **settings | {"oil_total_share": 0.4 + 0.98 * needed})


def test_two_conflicts_at_once() -> None:
    """Two requirements that cannot be by themselves, beside three that conflict: each part gives
    its own.

    Pins that stay: each cylinder's moment arm is today's, 1/1.1 of what is asked.
    """
    settings = {
        "oil_total_share": 0.9,
        "digging": ("lift", "fold"),
        "digging_share": 0.99,
        "moment_arm_share": 1.1,
    }
    error = refused("double", ("areas",), **settings)
    parts = [{c.name for c in error.conflict if c.part == part} for part in range(3)]
    assert parts == [
        {"moment_arm.lift"},
        {"moment_arm.fold"},
        {"oil.cap.total", "digging.lift", "digging.fold"},
    ]
    for c in error.conflict:
        share = 1 - 1 / 1.1 if c.name.startswith("moment_arm") else 0.09 / 1.89
        # what rounding takes: 0.1 % of an area
        assert c.together / c.limit == pytest.approx(share, rel=0.02)
    assert "no design meets moment_arm.lift" in str(error)
    assert ", nor moment_arm.fold" in str(error)
    assert "besides" not in str(error)


def test_nothing_conflicts() -> None:
    problem = problem_of("double")
    conflict = ConflictSearch(
        problem, problem.vector.start, holding_rows(problem, problem.vector.start)
    )
    assert conflict.irreducible_subset() == ()


def test_the_error_travels_between_processes() -> None:
    error = refused("single", ("areas",), **TWO)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.conflict) == (str(error), error.conflict)
    assert again.table == error.table


# --------------------------------------------------------------------------- granting what is said

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
RANDOM = [  # those of the first seeds that are in conflict
    *(("single", ("areas",), seed) for seed in (0, 2, 3, 5, 6)),
    *(("double", ("areas",), seed) for seed in (0, 1, 2, 3, 4, 5)),
    *(("twins", ("areas",), seed) for seed in (0,)),
    *(("single", ("areas", "pins"), seed) for seed in (0, 2, 3, 5, 8)),
    *(("double", ("areas", "pins"), seed) for seed in (2, 3, 4)),
]


OF_A_CATALOGUE = [  # those of the first seeds that are in conflict
    *(("double", ("areas",), "iso", seed) for seed in (0, 1, 2, 3, 4)),
    *(("double", ("areas", "pins"), "iso", seed) for seed in (1, 2, 4)),
    *(("single", ("areas", "pins"), "5mm", seed) for seed in (0, 2)),
]


def asked_at_random(machine: Machine, seed: int) -> Requirements:
    """Two to five kinds of requirements, tightened at random."""
    random = np.random.default_rng(seed)
    found: dict[str, Any] = {}
    for kind in random.choice(sorted(ASKED), size=random.integers(2, 6), replace=False):
        found |= ASKED[kind](machine, random)
    return replace(Requirements.of(machine), **found)


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
    """What pins with free sizes must give is not enough for a catalogue: its own sizes are asked
    at once.
    """
    machine, workspace = MACHINES["single"](), workspace_of("single")
    requirements = replace(
        Requirements.of(machine),
        **ANY_LIFT_AND_TORQUE | TWO | {"oil_total_share": 0.6, "pin_box": 0.01},
    )
    with pytest.raises(InfeasibleError, match="sizes of the catalogue") as error:
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
    problem, asked = problem_of("single", ("areas",)), []

    def never(given: Problem) -> None:
        asked.append(given.requirements.setting("thrust_share.lift") + 0.01)
        checks = check(given.machine, given.machine, given.workspace, given.requirements)
        (thrust,) = (c for c in checks if c.name == "thrust.lift")
        identity, amount = thrust.identity, 0.01 * thrust.limit
        one = Concession(**identity, together=amount, alone=None, value=asked[-1])
        raise conflict_error("odd", [one])

    with pytest.raises(InfeasibleError, match=r"when all before was granted, thrust\.lift"):
        design_or_proof(problem, never, catalogue=False)
    assert len(asked) == GRANTS


def test_digging_that_counts_only_under_less_torque_joins_a_conflict() -> None:
    """Digging says nothing until the torque gives way: its refusal ended in a KeyError before."""
    settings: dict[str, Any] = {"torque_share": 0.99, "digging_share": 0.97, "digging": ("lift",)}
    problem = problem_of("single", ("areas",), **settings)
    machine, space = problem.machine, problem.workspace
    wanted = [("torque.extending.lift", 0.9), ("digging.lift", 0.91)]

    def design(problem: Problem) -> str:
        checks = {c.name: c for c in check(machine, machine, space, problem.requirements)}
        if not wanted:
            return "a design"
        name, value = wanted.pop(0)
        one = Concession(**checks[name].identity, together=0.05, alone=None, value=value)
        raise conflict_error("odd", [one])

    with pytest.raises(InfeasibleError) as error:
        design_or_proof(problem, design, catalogue=False)
    torque, digging = error.value.conflict
    assert (torque.value, digging.value) == (0.9, 0.91)
    assert torque.together / torque.limit == pytest.approx(1 - 0.9 / 0.99)
    assert digging.together / digging.limit == pytest.approx(1 - 0.91 / 0.97)


def test_where_pins_close_no_linkage_nothing_is_met() -> None:
    """A four-bar that cannot be assembled is far from meeting requirements, without a word on the
    way.
    """
    machine = four_bar("left")
    problem = formulate(machine, ad.Workspace.grid(machine, 3), None, ("linkages",))
    x = problem.bounds[1].copy()
    while problem.vector.closes(x):
        x[2 * len(machine.cylinders) :] *= -1.5
    conflict = ConflictSearch(problem, x, np.zeros(1, dtype=int))
    assert conflict.violated(x)


def test_granting_a_little_less_than_one_alone_must_give_does_not() -> None:
    """By hand: the thrust alone must allow a bore of 99.5 mm, because 99.4 digs 0.0020 too
    little.
    """
    thrust, _ = refused("single", ("areas",), **TWO).conflict
    assert thrust.alone is not None
    share = 0.9 * (1 + thrust.alone / thrust.limit)
    allowed("single", ("areas",), **TWO | {"thrust_share": share})
    refused("single", ("areas",), **TWO | {"thrust_share": share - 1e-4})


@pytest.mark.parametrize(
    "setting", ["lift.up.mass_kg", "speed.go", "digging_kN.lift", "clearance.a.distance_mm"]
)
def test_settings_by_their_keys(setting: str) -> None:
    """What is set by its key is read by it, and everything else stays."""
    triangle = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    before = Requirements(
        lifts=(Lift(name="up", mass=100.0), Lift(name="down", mass=100.0)),
        speeds=(Speed(name="go", joints={"boom": 0.2}),),
        digging_force={"lift": 1e5, "fold": 1e5},
        clearances=(
            Clearance(name="a", cylinders=("lift",), link="boom", points=triangle, distance=0.1),
        ),
    )
    after = before.with_setting(setting, 0.5 * before.setting(setting))
    changed = [key for key, value in vars(after).items() if value != vars(before)[key]]
    assert changed == [{"lift": "lifts", "speed": "speeds", "digging_kN": "digging_force"}.get(
        setting.split(".")[0], "clearances")]  # fmt: skip
    if setting == "speed.go":
        assert after.speeds[0].joints == {"boom": 0.1}
    else:
        assert after.setting(setting) == pytest.approx(0.5 * before.setting(setting))
    assert after.lifts[1] == before.lifts[1]
    assert after.digging_force["fold"] == 1e5


def test_numbers_are_rounded_to_the_granting_side() -> None:
    assert outward(0.0964947, 4, True) == 0.0965
    assert outward(0.0964947, 4, False) == 0.09649
    assert outward(9.649, 2, True) == 9.7
    assert outward(44.0, 2, True) == 44.0
    assert outward(0.0, 4, True) == 0.0


def test_rows_of_a_conflict() -> None:
    """Constraints in workshop units, amounts with their share, and what is left of the limits."""
    parts: dict[str, Any] = {
        "words": "oil of all cap sides",
        "unit": "m³",
        "limit": 0.05,
        "together": 0.002,
    }
    conflict = [
        Concession(name="a", at_least=False, alone=None, **parts),
        Concession(name="b", at_least=True, alone=None, **parts),
    ]
    assert conflict_rows(conflict) == [
        ("a", "oil of all cap sides", "at most 50 l", "2 l (4 %)", "52 l"),
        ("b", "oil of all cap sides", "at least 50 l", "2 l (4 %)", "48 l"),
    ]
    error = conflict_error("crane", conflict)
    assert str(error) == "crane: no design meets a together with b; relax them"
    near = nearest_error("crane", "no sizes meet all requirements", conflict)
    text = "crane: no sizes meet all requirements: the nearest misses 2 of them; relax them"
    assert (str(near), near.table) == (text, error.table)
    near = nearest_error("crane", "no sizes meet all requirements", conflict[:1])
    assert "misses a (oil of all cap sides at most 50 l) by 2 l (4 %); relax it" in str(near)
    assert not near.table
    with_alone = replace(conflict[0], alone=0.004)
    assert conflict_rows([with_alone, conflict[1]])[0][-1] == "4 l (8 %)"
    assert conflict_rows([with_alone, conflict[1]])[1][-1] == "–"
