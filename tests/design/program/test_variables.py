"""What may vary: words and key paths; one number alone; starts, order, turning do not matter."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import ArmDesignError, Requirements, Workspace
from armdesign.design.bound.certificate import areas_bound
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.variables import chosen
from armdesign.design.requirements.check import check
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.modes import hertz
from armdesign.mechanism.linkage.direct import Direct
from armdesign.mechanism.linkage.four_bar import FourBar
from tests.design.by_machine import slopes, true_frequencies
from tests.design.designs import as_machine, double, problem_of, solved, some_x
from tests.machines import ANY_LIFT_AND_TORQUE, named

SIZES = {
    f"cylinder.{name}.{key}"
    for name in ("boom", "stick", "bucket")
    for key in ("bore_mm", "rod_mm")
}
FOUR_BAR = {
    f"cylinder.bucket.four_bar.{key}"
    for key in (
        "pivot.at_mm.0",
        "pivot.at_mm.2",
        "lug.at_mm.0",
        "lug.at_mm.2",
        "rocker_mm",
        "coupler_mm",
    )
}


def at(*names: str) -> set[str]:
    return {f"cylinder.{name}.at_mm.{axis}" for name in names for axis in (0, 2)}


PIN_PATHS = at("boom.base", "boom.rod_end", "stick.base", "stick.rod_end", "bucket.base")


# ----------------------------------------------------------------------------- words and key paths


@pytest.mark.parametrize(
    ("vary", "expected"),
    [
        (["areas"], SIZES),
        (["pins"], PIN_PATHS),  # DESIGN.md: of the four-bar the base pin alone, unless asked
        (["areas", "pins"], SIZES | PIN_PATHS),
        (["linkages"], PIN_PATHS | FOUR_BAR),
        (
            ["cylinder.boom.base.at_mm", "cylinder.boom.bore_mm"],
            at("boom.base") | {"cylinder.boom.bore_mm"},
        ),
        (["cylinder.boom.base"], at("boom.base")),
        (["cylinder.stick.base.at_mm.0"], {"cylinder.stick.base.at_mm.0"}),
        (["cylinder.stick.base.at_mm.1"], {"cylinder.stick.base.at_mm.1"}),
        (["cylinder.bucket.four_bar"], FOUR_BAR),
        (["cylinder.bucket.four_bar.rocker_mm"], {"cylinder.bucket.four_bar.rocker_mm"}),
        (["cylinder.bucket"], at("bucket.base") | FOUR_BAR | {p for p in SIZES if "bucket" in p}),
    ],
    ids=lambda v: ",".join(v) if isinstance(v, list) else "",
)
def test_words_and_paths(vary: list[str], expected: set[str]) -> None:
    """By hand, from the file of the 20 t machine."""
    assert chosen(named("excavator_20t"), vary) == expected


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ((), ["areas", "pins", "linkages"]),
        ("areas", ["areas", "pins", "linkages"]),
        (("links",), ["linkages"]),
        (("cylinder.boom.bore",), ['did you mean "cylinder.boom.bore_mm"']),
        (("cylinder.boom.rocker_mm",), ["cylinder.boom"]),
        (("cylinder.boom.base.at_mm.3",), ['did you mean "cylinder.boom.base.at_mm']),
        (("payload.full.mass_kg",), ["choose from", "cylinder.stick.rod_mm"]),
    ],
)
def test_unknown_words_are_answered_with_what_there_is(
    vary: tuple[str, ...], words: list[str]
) -> None:
    machine = named("excavator_20t")
    with pytest.raises(ArmDesignError, match="vary") as error:
        ad.optimize(machine, vary=vary)
    assert "\n" not in str(error.value)
    assert all(word in str(error.value) for word in words), str(error.value)


@pytest.mark.parametrize("path", ["cylinder.long.base", "cylinder.long.rod_end.at_mm.0"])
def test_pins_of_a_cylinder_across_two_joints_are_refused(path: str) -> None:
    with pytest.raises(ArmDesignError, match=r'moves "stick" and "boom".*bore_mm') as error:
        chosen(named("crossing"), [path])
    assert "\n" not in str(error.value)
    assert chosen(named("crossing"), ["cylinder.long"]) == {
        "cylinder.long.bore_mm",
        "cylinder.long.rod_mm",
    }


# -------------------------------------------------------------------------------- one number alone


@pytest.mark.slow
def test_bore_alone_leaves_the_rod() -> None:
    """A rod that stays in mm takes a fixed area off the annulus; the rest of the machine file does
    not change.
    """
    machine = named("excavator_20t")
    vary = ["cylinder.boom.bore_mm", "cylinder.boom.base.at_mm"]
    space = Workspace.grid(machine, points=(5, 5, 9))
    any_size = replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE)
    design = ad.optimize(machine, space, any_size, vary=vary, catalogue="free")
    old, new = ({c.name: c for c in m.cylinders} for m in (machine, design.machine))
    assert new["boom"].bore != old["boom"].bore
    assert new["boom"].rod == old["boom"].rod
    kept = ("bore", "stroke", "closed_length")
    assert replace(new["boom"], **{key: getattr(old["boom"], key) for key in kept}) == old["boom"]
    assert [new[n] for n in ("stick", "bucket")] == [old[n] for n in ("stick", "bucket")]
    pins = [[k.pin("rod_end") for k in m.linkages] for m in (design.machine, machine)]
    assert pins[0] == pins[1]
    assert design.unrounded > 1.02 * design.before.frame["f1_hz"].min()


@pytest.mark.slow
def test_a_bore_and_a_coordinate_by_scan() -> None:
    """Brute force: no bore and base pin on a fine scan that meet all requirements are better.

    (A bore alone may not grow: the rod must stand its thrust.)
    """
    vary = ("cylinder.lift.bore_mm", "cylinder.lift.base.at_mm.0")
    problem = problem_of("double", vary, **ANY_LIFT_AND_TORQUE)
    search, best = solved(problem), 0.0
    for value in np.linspace(0.9, 1.1, 101):
        for move in np.linspace(-1, 1, 81):
            x = problem.vector.start.copy()
            x[0], x[4] = value, move
            if constraints_at(problem, x, search.holding).values.min() >= -1e-9:
                best = max(best, problem.dynamics.omega_squared(x).min())
    rods = problem.vector.areas(search.x)[:, 0] - problem.vector.areas(search.x)[:, 1]
    assert_allclose(
        rods, problem.vector.areas_today[:, 0] - problem.vector.areas_today[:, 1], rtol=1e-12
    )
    assert len(problem.vector.start) == 5
    assert best > 1.02 * problem.dynamics.omega_squared(problem.vector.start).min()
    assert search.squared > best * (1 - 1e-6)
    # the scan's steps are 0.2 % of the area, 2.5 % of the box
    assert search.squared == pytest.approx(best, rel=0.01)


@pytest.mark.slow
def test_bound_of_a_bore_alone() -> None:
    """Areas alone, some of them: the chord's bound holds, and any bore in the box stays below
    it.
    """
    problem = problem_of("double", ("cylinder.lift.bore_mm", "cylinder.fold.rod_mm"))
    search = solved(problem)
    bound = areas_bound(search)
    assert bound is not None
    assert bound >= hertz(search.squared) * (1 - 1e-9)
    random = np.random.default_rng(0)
    low, high = problem.bounds
    for x in random.uniform(np.maximum(low, 0.7), np.minimum(high, 1.3), (300, len(low))):
        if constraints_at(problem, x, search.holding).values.min() >= -1e-9:
            assert hertz(problem.dynamics.omega_squared(x).min()) <= bound * (1 + 1e-9)


@pytest.mark.parametrize(
    "path",
    [
        "cylinder.boom.rod_mm",
        pytest.param("cylinder.stick.base.at_mm.0", marks=pytest.mark.slow),
        pytest.param("cylinder.bucket.four_bar.lug", marks=pytest.mark.slow),
    ],
)
def test_only_what_is_named_changes(path: str) -> None:
    machine = named("excavator_20t")
    space = Workspace.grid(machine, points=(5, 5, 9))
    design = ad.optimize(machine, space, vary=[path], starts=1, catalogue="free")
    old, new = ({**m.section.model_dump()["cylinder"]} for m in (machine, design.machine))
    name = path.split(".")[1]
    changed = {key for key in old[name] if old[name][key] != new[name][key]}
    key = path.split(".")[2]
    assert changed <= {key, "stroke_mm", "closed_length_mm"}
    assert all(old[other] == new[other] for other in old if other != name)
    if path.endswith(".0"):
        assert old[name]["base"]["at_mm"][1:] == new[name]["base"]["at_mm"][1:]
    if "lug" in path:
        assert changed
        assert {
            k
            for k in old[name]["four_bar"]
            if old[name]["four_bar"][k] != new[name]["four_bar"][k]
        } == {"lug"}
    assert min(design.slacks.values()) >= 0


# --------------------------------------------------------------------------------------- four-bars

EVERYTHING = ("areas", "linkages")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["odd", "excavator"])
def test_derivatives_by_every_variable(name: str) -> None:
    """Stiffness and limits by areas, pins, rocker, coupler and lug, against central differences of
    the value.
    """
    digging = {"odd": ("fold", "tilt"), "excavator": ("stick", "bucket")}[name]
    problem = problem_of(name, EVERYTHING, digging=digging)
    assert {v.pin for v in problem.vector.variables} == {
        None,
        "rod_end",
        "base",
        "pivot",
        "lug",
        "rocker",
        "coupler",
    }
    x, rows, holding = (
        some_x(problem, 3, 0.03),
        np.arange(0, len(problem.dynamics.rows), 37),
        np.arange(0, len(problem.dynamics.rows), 11),
    )
    expected = slopes(lambda y: problem.dynamics.scaled_stiffness_and_gradient(y, rows)[0], x)
    gradient = problem.dynamics.scaled_stiffness_and_gradient(x, rows)[1]
    for v in range(len(x)):
        assert_allclose(gradient[v], expected[v], rtol=0, atol=1e-7 * np.abs(expected[v]).max())
    by_difference = slopes(lambda y: constraints_at(problem, y, holding).values, x)
    jacobian = constraints_at(problem, x, holding).jacobian.T
    assert_allclose(jacobian, by_difference, rtol=0, atol=1e-8 * np.abs(by_difference).max())


@pytest.mark.parametrize("seed", range(4))
def test_transmission_limit_is_the_requirement(seed: int) -> None:
    """Same sign as ``check`` judges the machine by, and the same room to first order near the
    limit (0.1 %).
    """
    problem = problem_of("excavator", ("cylinder.bucket.four_bar",), transmission=math.radians(60))
    x = some_x(problem, seed, 0.3)
    at_x, machine = constraints_at(problem, x), as_machine(problem, x)
    judged = {
        c.name: c for c in check(machine, problem.machine, problem.workspace, problem.requirements)
    }
    own_rows = np.array([name == "transmission.bucket" for name in at_x.names])
    assert own_rows.sum() > 10
    slack, value = judged["transmission.bucket"].slack, at_x.values[own_rows].min()
    assert slack == pytest.approx(value, abs=2e-3 + 2 * slack**2)


def test_frequencies_with_a_moved_four_bar_are_those_of_the_machine() -> None:
    """By the package's front door, 1e-9."""
    problem = problem_of("excavator", EVERYTHING)
    for seed in (1, 2):
        x = some_x(problem, seed, 0.1)
        assert_allclose(
            hertz_of(problem.dynamics.omega_squared(x)), true_frequencies(problem, x), rtol=1e-9
        )


def hertz_of(squared: np.ndarray) -> np.ndarray:
    return np.sqrt(squared) / (2 * np.pi)


@cache
def free_four_bar() -> ad.design.optimum.Design:  # type: ignore[name-defined]
    machine = named("excavator_20t")
    return ad.optimize(
        machine, Workspace.grid(machine, points=(7, 7, 11)), vary=EVERYTHING, starts=2
    )


@pytest.mark.slow
def test_a_free_four_bar_is_worth_more() -> None:
    """More freedom is never worse; the saved machine keeps range, transmission and boxes, and lies
    on the grid.
    """
    design = free_four_bar()
    less = ad.optimize(design.today, design.workspace, starts=1)
    assert design.unrounded > 1.01 * less.unrounded
    assert min(design.slacks.values()) >= 0
    assert {
        f"pin_box.bucket.{place}" for place in ("base", "pivot", "lug", "rocker", "coupler")
    } <= design.slacks.keys()
    assert "transmission.bucket" in design.prices
    bars = design.machine.section.cylinder["bucket"].four_bar
    assert bars is not None
    for number in (bars.rocker_mm, bars.coupler_mm, *bars.pivot.at_mm, *bars.lug.at_mm):
        assert number == round(number, 1)
    new, old = design.machine.linkages[2], design.today.linkages[2]
    assert isinstance(new, FourBar)
    assert isinstance(old, FourBar)
    assert new != old
    assert (new.pivot.at[1], new.lug.at[1], new.knee) == (old.pivot.at[1], old.lug.at[1], old.knee)
    assert (design.machine.ranges[:, 0] <= design.today.ranges[:, 0] + 1e-9).all()
    assert (design.machine.ranges[:, 1] >= design.today.ranges[:, 1] - 1e-9).all()
    assert design.after.frame["f1_hz"].min() > 0.997 * design.unrounded


def test_an_open_four_bar_is_no_step() -> None:
    """A rocker half as long does not reach: such a design is told apart before anything is made of
    it.
    """
    problem = problem_of("excavator", ("cylinder.bucket.four_bar.rocker_mm",), pin_box=0.5)
    short = problem.vector.start.copy()
    short[-1] = -1.0
    assert problem.vector.closes(problem.vector.start)
    assert not problem.vector.closes(short)
    search = Search(problem=problem, x=problem.vector.start).run(trust=1.0, tolerance=1e-4)
    assert problem.vector.closes(search.x)
    assert search.violation < 1e-5


def test_keys_of_places() -> None:
    assert [FourBar.key_of(p) for p in ("base", "lug", "rocker")] == [
        "base.at_mm",
        "four_bar.lug.at_mm",
        "four_bar.rocker_mm",
    ]
    assert Direct.key_of("rod_end") == "rod_end.at_mm"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double", "excavator_20t"])
def test_workers_do_not_change_the_answer(name: str) -> None:
    """Same seed, same machine to the last digit, in one process or in two; what starts reach but
    for rounding errors.

    Arrays that went to another process lie elsewhere in memory, where numpy may add in another
    order.
    """
    machine = double() if name == "double" else ad.load(name)
    space = Workspace.grid(machine, points=4)
    alone, shared = (ad.optimize(machine, space, starts=3, seed=4, workers=n) for n in (1, 2))
    assert alone.machine.text == shared.machine.text
    assert alone.starts == pytest.approx(shared.starts, rel=1e-12)
    assert len(alone.starts) == 3
