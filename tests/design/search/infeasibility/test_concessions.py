"""Concessions: their table, their settings by key, their numbers on the granting side."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import pytest

from armdesign import Requirements
from armdesign.design.requirements.holding import Lift
from armdesign.design.requirements.places import Clearance
from armdesign.design.requirements.record import Concession
from armdesign.design.requirements.speeds import Speed
from armdesign.design.search.infeasibility.concessions import (
    conflict_error,
    conflict_rows,
    in_a_line,
    nearest_error,
)
from armdesign.units import outward
from tests.design.search.infeasibility.conflicts import TWO, refused


def test_the_error_travels_between_processes() -> None:
    error = refused("single", ("areas",), **TWO)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.conflict) == (str(error), error.conflict)
    assert again.table == error.table


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


def test_many_settings_stand_below_the_table() -> None:
    """As options of a command, factors in words; the line says how many. What is in conflict and
    not relaxed is named below, not among the rows.
    """
    parts: dict[str, Any] = {"words": "oil", "unit": "m³", "limit": 0.05, "alone": None}
    settings = ["a_share", "b_share.boom", "c_share", "speed.go"]
    conflict = [
        Concession(name=name, setting=setting, together=0.002, value=1.04, **parts)
        for name, setting in zip("abcd", settings, strict=True)
    ]
    conflict.append(Concession(name="e", together=0.0, **parts))
    error = conflict_error("crane", conflict, least=False)
    line = (
        "crane: no design meets a together with b, c, d and e; relax them by the 4 settings below"
    )
    assert str(error) == f"{line} the table, which is enough but not proved least"
    *rows, empty, stays, _, options, factor = error.table.splitlines()
    assert [row[0] for row in rows] == ["r", "a", "b", "c", "d"]
    assert (empty, stays) == ("", "not relaxed: e")
    given = "--set requirements.a_share=1.04 --set requirements.b_share.boom=1.04"
    assert options == f"{given} --set requirements.c_share=1.04"
    assert factor == "and in the file every speed of [requirements.speed.go] × 1.04"
    assert in_a_line(error) == (
        "crane: no design meets a together with b, c, d and e; relax them:"
        " requirements.a_share = 1.04, requirements.b_share.boom = 1.04,"
        " requirements.c_share = 1.04, speed.go × 1.04, which is enough but not proved least"
    )
    error = conflict_error("crane", conflict[:2])
    assert in_a_line(error) == str(error)
    assert str(error).endswith(
        "b; relax them: requirements.a_share = 1.04, requirements.b_share.boom = 1.04"
    )
    assert "--set" not in error.table
