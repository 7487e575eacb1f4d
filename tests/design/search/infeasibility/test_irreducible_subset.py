"""Conflicts: by hand where areas alone vary, by solving again where pins do."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.design.program.constraints import holding_rows
from armdesign.design.search.infeasibility.irreducible_subset import ConflictSearch
from armdesign.design.search.multistart import formulate
from tests.design.designs import MACHINES, problem_of
from tests.design.search.infeasibility.conflicts import TWO, allowed, refused
from tests.machines import four_bar


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
    by_name = {c.name: c for c in conflict}
    assert list(by_name) == ["oil.cap.total", "digging.lift", "digging.fold"]
    for c in conflict:  # what rounding takes: a grid step of a bore is 0.2 % of its area
        assert c.together / c.limit == pytest.approx(0.09 / 1.89, rel=0.02)
    assert by_name["oil.cap.total"].alone == pytest.approx(
        by_name["oil.cap.total"].limit * 0.1, rel=0.02
    )
    swept = np.array([c.bore_area * c.stroke for c in MACHINES["double"]().cylinders])
    for name, own in zip(("digging.lift", "digging.fold"), swept, strict=True):
        # of its limit: all of the oil that lacks, from one bore
        share = 0.09 * swept.sum() / own / 0.99
        assert by_name[name].alone == pytest.approx(share * by_name[name].limit, rel=0.02)


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


def test_subsets_found_in_linear_programmes_are_irreducible() -> None:
    """A search that knows none of the designs on the way agrees: none meets a subset, and some
    meets it without any one of its requirements.
    """
    limits = {
        "oil_total_share": 0.7,
        "digging_share": 1.2,
        "moment_arm_share": 1.2,
        "pin_box": 0.03,
    }
    problem = problem_of("double", digging=("lift", "fold"), **limits)
    start = problem.vector.start
    subsets = ConflictSearch(problem, start, holding_rows(problem, start)).disjoint_subsets()
    assert len(subsets) >= 1
    assert any(len(names) > 1 for names in subsets)
    for names in subsets:
        anew = ConflictSearch(problem, start, holding_rows(problem, start))
        assert not anew.feasible(names)
        for name in names:
            assert anew.feasible([other for other in names if other != name]), name
    left = [n for n in anew.names if not any(n in names for names in subsets)]
    assert anew.feasible(left)


def test_linear_conflict_by_hand() -> None:
    """Areas alone: A ≤ 0.9 and A ≥ 0.99 of today's are linear, and conflict at any place; either
    alone does not, nor anything that is met there.
    """
    problem = problem_of("single", ("areas",), **TWO)
    x = problem.vector.start
    rooms = ConflictSearch(problem, x, holding_rows(problem, x)).rooms(x)
    assert rooms.missed == {"thrust.lift"}
    two = ["thrust.lift", "digging.lift"]
    assert rooms.conflict(two, problem.bounds) == set(two)
    assert rooms.conflict([*two, "oil.cap.total"], problem.bounds) == set(two)
    for name in two:
        assert not rooms.conflict([name], problem.bounds)
