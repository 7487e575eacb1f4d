"""Conflicts: by hand where areas alone vary, by solving again where pins do."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from designs import MACHINES, problem_of, workspace_of

import armdesign as ad
from armdesign import Requirements
from armdesign.design.conflict import Conflict, sentence
from armdesign.design.limits import holding_rows
from armdesign.errors import Concession, InfeasibleError


def refused(name: str, vary: tuple[str, ...], **settings: Any) -> InfeasibleError:
    machine = MACHINES[name]()
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine, workspace_of(name), replace(Requirements.of(machine), **settings), vary=vary, starts=1)
    return error.value


def allowed(name: str, vary: tuple[str, ...], **settings: Any) -> None:
    """A design meets them: does not raise."""
    machine = MACHINES[name]()
    ad.optimize(machine, workspace_of(name), replace(Requirements.of(machine), **settings), vary=vary, starts=1)


def test_one_against_the_box() -> None:
    """Pins that stay: today's moment arm is what there is, 1/1.2 of what is asked."""
    error = refused("single", ("areas",), moment_arm_share=1.2)
    (only,) = error.conflict
    assert (only.name, only.at_least, only.unit) == ("moment_arm.lift", True, "m/rad")
    assert only.together == pytest.approx(only.limit * (1 - 1 / 1.2), rel=1e-6)
    assert only.alone == only.together
    assert "no design meets moment_arm.lift" in str(error)
    assert "it must give" in str(error)
    assert "(17 %)" in str(error)
    assert "besides" not in str(error)


def test_one_against_the_pin_box() -> None:
    """Pins within 20 mm: what it must give is what the best of a grid over the box still lacks."""
    settings = {"moment_arm_share": 1.2, "pin_box": 0.02, "oil_total_share": 9.0, "oil_each_share": 9.0}
    (only,) = refused("single", ("pins",), **settings).conflict
    problem = problem_of("single", ("pins",), **settings)
    most = 0.0
    for corner in np.ndindex(*[3] * 4):
        x = problem.start.copy()
        x[2:] = np.array(corner) - 1.0
        (linkage,), (poses,) = problem.linkages(x), problem.ranges
        assert poses is not None
        most = max(most, float(np.abs(linkage.actuation(poses).moment_arm[:, 0]).min()))
    assert only.name == "moment_arm.lift"
    assert only.together == pytest.approx(only.limit - most, rel=0.02)  # the dead length may hold it back
    assert only.together >= (only.limit - most) * (1 - 1e-6)


TWO = {"thrust_share": 0.9, "digging": ("lift",), "digging_share": 0.99}


def test_two_by_hand() -> None:
    """A ≤ 0.9 and A ≥ 0.99 of today's: both give t with 0.9 (1 + t) = 0.99 (1 − t), one alone 0.09 of today's."""
    error = refused("single", ("areas",), **TWO)
    thrust, digging = error.conflict
    assert (thrust.name, digging.name) == ("thrust.lift", "digging.lift")
    assert thrust.together / thrust.limit == pytest.approx(0.09 / 1.89, rel=1e-5)
    assert digging.together / digging.limit == pytest.approx(0.09 / 1.89, rel=1e-5)
    assert thrust.alone == pytest.approx(thrust.limit * 0.09 / 0.9, rel=1e-5)
    assert digging.alone == pytest.approx(digging.limit * 0.09 / 0.99, rel=1e-5)
    text = str(error)
    assert "thrust.lift (thrust of the lift cylinder at most" in text
    assert "together with digging.lift (digging torque of the lift cylinder at least" in text
    assert "they must give" in text
    assert "or one alone" in text


def test_two_without_either() -> None:
    """Irreducible, and the amounts suffice: without one, or with what it gives, there is a design."""
    allowed("single", ("areas",), **TWO | {"digging": ()})
    allowed("single", ("areas",), **TWO | {"thrust_share": 1.1})
    allowed("single", ("areas",), **TWO | {"thrust_share": 0.9 * 1.1005})
    refused("single", ("areas",), **TWO | {"thrust_share": 0.9 * 1.0995})


def test_three_by_hand() -> None:
    """Both bores at least 0.99 of today's, their oil together at most 0.9: no two of the three conflict.

    All give t with 0.99 (1 − t) = 0.9 (1 + t); the oil alone 0.09 of today's.
    """
    settings = {"oil_total_share": 0.9, "digging": ("lift", "fold"), "digging_share": 0.99}
    conflict = refused("double", ("areas",), **settings).conflict
    found = {c.name: c for c in conflict}
    assert list(found) == ["oil.cap.total", "digging.lift", "digging.fold"]
    for c in conflict:
        assert c.together / c.limit == pytest.approx(0.09 / 1.89, rel=1e-4)
    assert found["oil.cap.total"].alone == pytest.approx(found["oil.cap.total"].limit * 0.1, rel=1e-4)
    swept = np.array([c.bore_area * c.stroke for c in MACHINES["double"]().cylinders])
    for name, own in zip(("digging.lift", "digging.fold"), swept, strict=True):
        share = 0.09 * swept.sum() / own / 0.99  # of its limit: all of the oil that lacks, from one bore
        assert found[name].alone == pytest.approx(share * found[name].limit, rel=1e-4)


def test_pins_in_a_conflict() -> None:
    """Areas and pins: with 2 % more than the oil alone must give there is a design, with 2 % less none."""
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


def test_the_smaller_of_two_conflicts() -> None:
    """One requirement that cannot be, beside three that conflict: the one is named, and that others remain."""
    settings = {"oil_total_share": 0.9, "digging": ("lift", "fold"), "digging_share": 0.99, "moment_arm_share": 1.1}
    error = refused("double", ("areas",), **settings)
    assert [c.name for c in error.conflict] == ["moment_arm.lift"]
    assert "others conflict besides" in str(error)


def test_nothing_conflicts() -> None:
    problem = problem_of("double")
    conflict = Conflict(problem, problem.start, holding_rows(problem, problem.start))
    assert conflict.smallest() == ()


def test_the_error_travels_between_processes() -> None:
    error = refused("single", ("areas",), **TWO)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.conflict) == (str(error), error.conflict)


def test_sentence_where_no_one_alone_is_enough() -> None:
    """Limits in workshop units, amounts with their share."""
    parts: dict[str, Any] = {"words": "oil of all cap sides", "unit": "m³", "limit": 0.05, "together": 0.002}
    conflict = [
        Concession(name="a", at_least=False, alone=None, **parts),
        Concession(name="b", at_least=True, alone=None, **parts),
    ]
    assert sentence(conflict, settles=True) == (
        "no design meets a (oil of all cap sides at most 50 l) together with b (oil of all cap sides at least 50 l): "
        "they must give a 2 l (4 %), b 2 l (4 %), no one alone is enough"
    )
