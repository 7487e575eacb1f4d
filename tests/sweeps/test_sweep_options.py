"""Options of a sweep's task: one key is one input, and no case changes what another is given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.journal.keys import digest, exact
from armdesign.sweeps.study_file import read_study
from tests.sweeps.test_failures import Colour

MODULI = {"fluid.bulk_modulus_MPa": [900.0, 1000.0, 1200.0]}


def shows(machine: ad.Machine, _: ad.Workspace, **options: Any) -> dict[str, str]:
    """A task that answers with what it was given."""
    return {"given": repr(options)}


def test_sets_of_options_with_one_key_are_one_input() -> None:
    """Each alone, without other sets, answers as beside them."""
    values = [(1, 2), [1, 2], {"b": 1, "a": 2}, {"a": 2, "b": 1}, Colour.RED, "r", [(1,)], [[1]]]
    values += [1, 1.0, True, {"x": (1,)}, {"x": [1]}]
    sets: list[dict[str, Any]] = [{"x": value} for value in values]
    sets += [{"x": 1, "y": 2}, {"y": 2, "x": 1}]
    sweep = ad.sweep("paper_1dof", None, shows, options=sets, points=2)
    given = sweep.frame["given"].tolist()
    alone = [ad.sweep("paper_1dof", None, shows, options=[one], points=2) for one in sets]
    assert given == [one.frame["given"][0] for one in alone]
    assert len({case.key for case in sweep.cases}) == len(set(given)) == len(sets) - 2
    shared = [ad.sweep("paper_1dof", None, shows, options=one, points=2) for one in sets]
    assert given == [one.frame["given"][0] for one in shared]


def test_keys_of_ordinary_options_are_as_before() -> None:
    """So that journals go on."""
    ordinary = {"a": [1, 2.5, "x", None, True], "b": {"c": []}}
    assert exact(ordinary) is ordinary
    assert digest(exact({"a": (1, 2)})) != digest({"a": [1, 2]})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"x": {1: "a"}}, "options.x: the key 1 is no text; give texts as keys"),
        ({"x": [{"y": {None: "a"}}]}, "options.x.y: the key None is no text; give texts as keys"),
        ({1: "a"}, "options: the name 1 is no text; give texts as names"),
        ({"x": (within := [])}, "options: has values within values without end; give"),
    ],
)
def test_options_that_no_key_can_tell_apart_are_refused(
    options: dict[Any, Any], message: str
) -> None:
    within.append(within) if not within else None
    for some in (options, [options]):
        with pytest.raises(ad.ArmDesignError) as caught:
            ad.sweep("paper_1dof", None, shows, options=some, points=2)
        assert str(caught.value).startswith(message)


def appends(machine: ad.Machine, _: ad.Workspace, some: dict[str, list[int]]) -> dict[str, int]:
    """A task that changes what it is given."""
    some["row"].append(1)
    return {"count": len(some["row"])}


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_task_that_changes_its_options_changes_them_for_no_other_case(workers: int) -> None:
    some: dict[str, Any] = {"some": {"row": [1]}}
    for options in (some, [some]):
        sweep = ad.sweep("paper_1dof", MODULI, appends, options=options, workers=workers)
        assert sweep.frame["count"].tolist() == [2, 2, 2]
    assert some == {"some": {"row": [1]}}


def test_what_no_design_changed_is_an_empty_column(tmp_path: Path) -> None:
    """A misspelt name is still refused."""
    text = (
        'machine = "paper_1dof"\ntask = "design"\npoints = 3\n'
        'outputs = ["after_hz", "new.cylinder.lift.bore_mm", "bandwidth_after_hz"]\n'
        '[options]\nvary = "cylinder.lift.base.at_mm.0"\n'
    )
    study = tmp_path / "study.toml"
    study.write_text(text)
    frame = ad.sweep(**read_study(study, ad.load)).frame
    assert frame["after_hz"].notna().all()
    assert frame[["new.cylinder.lift.bore_mm", "bandwidth_after_hz"]].isna().all(axis=None)
    for right, wrong in (("lift.bore", "lift.boer"), ("bandwidth_after", "bandwidth_aftr")):
        study.write_text(text.replace(right, wrong))
        with pytest.raises(ad.ArmDesignError, match=f'no case has .*{wrong}.*mean ".*{right}'):
            ad.sweep(**read_study(study, ad.load))


def test_a_misspelt_answer_of_a_function_loses_none() -> None:
    """Which names a function gives, only all cases know; they are with the error."""

    def twice(machine: ad.Machine, workspace: ad.Workspace, k: int) -> dict[str, float]:
        return {"double": 2.0 * k}

    options = [{"k": k} for k in range(3)]
    with pytest.raises(ad.ArmDesignError, match="no case has 'duoble'; did you mean") as caught:
        ad.sweep("paper_1dof", None, twice, options=options, points=2, outputs=["duoble"])
    assert list(caught.value.finished.frame["double"]) == [0.0, 2.0, 4.0]
