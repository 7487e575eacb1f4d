"""Sweeps: the same frame in this process and in several, whatever ends them."""

from __future__ import annotations

import importlib.util
import itertools
import linecache
import os
import re
import signal
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.errors import Stopped
from armdesign.journal.finished import keeping
from armdesign.journal.journal import Journal
from armdesign.journal.keys import version_of_sources
from armdesign.sweeps.cases import csv_changes, grid_changes, sobol_changes
from armdesign.sweeps.sweep import files_of

MODULI = {"fluid.bulk_modulus_MPa": [900.0, 1000.0, 1200.0, 1400.0]}
POSES = ad.Workspace.grid(ad.load("paper_1dof"), 2)
WRONG = {**MODULI, "cylinder.lift.stroke_mm": [200.0, -5.0]}


def modulus(machine: ad.Machine, _: ad.Workspace) -> Mapping[str, Any]:
    """A quick task."""
    return {"modulus": machine.fluid.bulk_modulus, "pid": "same"}


def scaled(
    machine: ad.Machine, _: ad.Workspace, factor: float, word: tuple[str, ...] = ()
) -> Mapping[str, Any]:
    """A quick task with options."""
    return {"scaled": factor * machine.section.fluid.bulk_modulus_MPa}


def any_options(machine: ad.Machine, _: ad.Workspace, **more: Any) -> Mapping[str, Any]:
    """A quick task with options of any name."""
    return {"count": len(more)}


def kills_once(machine: ad.Machine, _: ad.Workspace, place: str = "") -> Mapping[str, Any]:
    """A task whose worker dies at one case: the first time, or always where ``place`` is empty."""
    if machine.section.fluid.bulk_modulus_MPa == 1000.0:
        mark = Path(place) / "died"
        if not place or not mark.exists():
            if place:
                mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return {"modulus": machine.fluid.bulk_modulus}


def without_seconds(sweep: ad.Sweep) -> pd.DataFrame:
    return sweep.frame.drop(columns="seconds")


def test_a_sweep_answers_as_the_map_of_each_machine() -> None:
    sweep = ad.sweep("paper_1dof", WRONG, points=5)
    assert len(sweep.frame) == 8
    for row in sweep.frame.to_dict("records"):
        if row["cylinder.lift.stroke_mm"] < 0:
            assert "-5.0 is not allowed" in row["error"]
            continue
        path = "fluid.bulk_modulus_MPa"
        machine = ad.load("paper_1dof").replace({path: row[path]})
        frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 5))
        assert row["worst_hz"] == frequencies.worst.frequency
        assert row["error"] == ""


@pytest.mark.slow
def test_two_processes_and_a_journal_answer_to_the_last_digit(tmp_path: Path) -> None:
    journal = tmp_path / "j.sqlite"
    alone = ad.sweep("paper_1dof", WRONG, points=5)
    both = ad.sweep("paper_1dof", WRONG, points=5, workers=2, journal=journal)
    again = ad.sweep("paper_1dof", WRONG, points=5, journal=journal)
    assert (both.kept, again.kept) == (0, 8)
    pd.testing.assert_frame_equal(without_seconds(both), without_seconds(alone), check_exact=True)
    pd.testing.assert_frame_equal(again.frame, both.frame, check_exact=True)
    more = {"fluid.bulk_modulus_MPa": [900.0, 1100.0]}
    assert ad.sweep("paper_1dof", more, points=7, journal=journal).kept == 0  # other poses


@pytest.mark.slow
def test_a_case_that_kills_its_worker_is_tried_again_by_name(tmp_path: Path) -> None:
    path = "fluid.bulk_modulus_MPa"
    once = ad.sweep("paper_1dof", MODULI, kills_once, options={"place": str(tmp_path)}, workers=2)
    assert once.frame["error"].tolist() == [""] * 4
    assert f"paper_1dof, {path}=1000.0" in once.retried
    always = ad.sweep("paper_1dof", MODULI, kills_once, workers=2, journal=tmp_path / "j")
    assert always.failures == {f"paper_1dof, {path}=1000.0": "its worker died 3 times"}
    assert always.frame["modulus"].notna().tolist() == [True, False, True, True]
    with Journal(
        tmp_path / "j", files_of([ad.load("paper_1dof")]), version_of_sources(), False
    ) as journal:
        assert len(journal.entries()) == 3  # the next run tries it again


def test_a_machine_may_be_given_by_its_path() -> None:
    source = ad.load("paper_1dof").source
    three = np.int64(3)  # as scripts may have it
    frames = [ad.sweep(one, points=three).frame for one in (source, str(source), [source])]
    for frame in frames:
        assert frame["worst_hz"].tolist() == frames[0]["worst_hz"].tolist()


def test_values_may_be_made_one_by_one() -> None:
    values = {"fluid.bulk_modulus_MPa": (900.0 + k for k in range(3))}
    frame = ad.sweep("paper_1dof", values, modulus, points=2).frame
    assert frame["modulus"].tolist() == [9.00e8, 9.01e8, 9.02e8]


def test_load_cases_and_requirements_multiply() -> None:
    rules = [{"lift_share": 0.9}, {"lift_share": 0.5}]
    frame = ad.sweep("paper_1dof", MODULI, modulus, payloads=["load"], requirements=rules).frame
    assert len(frame) == 8
    assert set(frame["requirements.lift_share"]) == {0.9, 0.5}
    assert set(frame["payload"]) == {"load"}


def test_sets_of_options_are_cases_which_index_the_answers() -> None:
    sets = [{"factor": 1.0}, {"factor": 3.0, "word": ("a", "b")}]
    sweep = ad.sweep("paper_1dof", MODULI, scaled, options=sets, points=2)
    path = "fluid.bulk_modulus_MPa"
    assert sweep.frame["word"].tolist() == [None, ("a", "b")] * 4
    assert sweep.answers.index.names == [path, "factor", "word"]
    assert list(sweep.answers) == ["scaled"]
    assert sweep.answers["scaled"].to_list() == [
        factor * modulus for modulus in MODULI[path] for factor in (1.0, 3.0)
    ]
    shared = ad.sweep("paper_1dof", task=scaled, options=sets[1], points=2)
    assert shared.answers.index.to_list() == ["paper_1dof"]
    assert "factor" not in shared.frame


def stops(machine: ad.Machine, _: ad.Workspace, at: float) -> Mapping[str, Any]:
    """A quick task, interrupted at one modulus."""
    modulus = machine.section.fluid.bulk_modulus_MPa
    if modulus == at:
        raise KeyboardInterrupt
    if modulus < 950.0:
        raise ad.ArmDesignError("modulus", "is too low")
    return {"modulus": modulus}


def test_ctrl_c_leaves_the_finished_cases_in_hand() -> None:
    with pytest.raises(Stopped) as stop:
        ad.sweep("paper_1dof", MODULI, stops, options={"at": 1200.0}, points=2)
    assert stop.value.finished.frame["modulus"].dropna().to_list() == [1000.0]
    assert list(stop.value.finished.failures.values()) == ["modulus: is too low"]


def test_a_command_that_keeps_what_is_finished_keeps_cases(tmp_path: Path) -> None:
    """Of a sweep without a journal of its own: those that failed for good, too."""

    def answers() -> ad.Sweep:
        how: dict[str, Any] = {"options": {"at": 0.0}, "points": 2}
        return ad.sweep("paper_1dof", MODULI, stops, **how)

    def interrupted() -> None:
        with keeping(tmp_path / "j.sqlite"):
            answers()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with keeping(tmp_path / "j.sqlite") as pieces:
        again = answers()
        assert (again.kept, pieces.answered) == (4, 4)
    pd.testing.assert_frame_equal(without_seconds(again), without_seconds(answers()))


def test_requirements_and_bands_are_options() -> None:
    """By what they state: another state is another case."""
    chosen = [ad.Requirements(lift_share=share) for share in (0.9, 0.9, 0.8)]
    sets = [{"requirements": one, "bands": ad.Bands(structure=(0.0, 1.0))} for one in chosen]
    sweep = ad.sweep("paper_1dof", task=share_of_lift, options=sets, points=2)
    assert sweep.answers["share"].to_list() == [0.9, 0.9, 0.8]
    assert len({case.key for case in sweep.cases}) == 2
    assert [case.name for case in sweep.cases] == ["paper_1dof"] * 3


def share_of_lift(
    machine: ad.Machine, _: ad.Workspace, requirements: ad.Requirements, bands: ad.Bands
) -> Mapping[str, Any]:
    """A quick task with options that are no numbers."""
    return {"share": requirements.lift_share, "most": bands.structure[1]}  # type: ignore[index]


def test_outputs_are_chosen_by_name_and_the_journal_keeps_all(tmp_path: Path) -> None:
    """In the order given; of another choice nothing is computed again."""
    journal, names = tmp_path / "j.sqlite", ["median_hz", "worst_hz"]
    some = ad.sweep("paper_1dof", WRONG, points=3, journal=journal, outputs=names)
    columns = ["machine", "payload", *WRONG, *names, "seconds", "error"]
    assert list(some.frame) == columns
    whole = ad.sweep("paper_1dof", WRONG, points=3, journal=journal)
    assert whole.kept == 8
    pd.testing.assert_frame_equal(whole.frame[columns], some.frame)
    assert len(list(whole.frame)) > len(columns)


def meets_columns(machine: ad.Machine, _: ad.Workspace, name: str) -> Mapping[str, Any]:
    """A task whose answer has the name of another column."""
    return {name: machine.fluid.bulk_modulus}


def test_an_answer_with_the_name_of_another_column_is_refused() -> None:
    taken = {"machine", "payload", "seconds", "error", "fluid.bulk_modulus_MPa"}
    sets = [{"name": name} for name in [*sorted(taken), "own"]]
    sweep = ad.sweep("paper_1dof", MODULI, meets_columns, options=sets)
    failed = sweep.frame[sweep.frame["error"] != ""]
    assert set(failed["name"]) == taken
    assert failed["error"].str.contains("is the name of another column").all()
    assert len(failed) == 4 * len(taken)


def test_an_answer_meets_no_column_of_another_case(tmp_path: Path) -> None:
    """Not one that the journal has of a sweep without that column either."""
    path, journal = "fluid.bulk_modulus_MPa", tmp_path / "j.sqlite"
    options = {"name": path}
    alone = ad.sweep("paper_1dof", None, meets_columns, options=options, journal=journal)
    assert alone.frame[path].tolist() == [ad.load("paper_1dof").fluid.bulk_modulus]
    cases = [{}, {path: 900}]
    both = ad.sweep("paper_1dof", cases, meets_columns, options=options, journal=journal)
    assert both.frame["error"].str.contains("is the name of another column").all()


@pytest.mark.parametrize("case", ["empty", "full"])
def test_designs_for_one_load_case_alone(case: str) -> None:
    """As of a file that has no other; with requirements and changes."""
    machine, points = ad.load("excavator_20t"), [3, 3, 4]
    other = {"empty": "full", "full": "empty"}[case]
    text = re.sub(rf"(?ms)^\[payload\.{other}\].*?(?=^\[)", "", machine.text)
    alone = ad.Machine.from_text(text, machine.urdf_text, machine.source)
    assert [one.name for one in alone.payloads] == [case]
    options = {"vary": ["areas"], "catalogue": "free"}
    more = {"task": "design", "options": options, "points": points}
    changes, rules = {"fluid.bulk_modulus_MPa": [1100]}, [{"lift_share": 0.9}, {"lift_share": 1.0}]
    one = ad.sweep(machine, changes, payloads=[case], requirements=rules, **more)
    other_one = ad.sweep(alone, changes, requirements=rules, **more)
    left_out = ["seconds", "payload"]
    pd.testing.assert_frame_equal(
        one.frame.drop(columns=left_out), other_one.frame.drop(columns=left_out)
    )
    assert not one.failures


def test_answers_do_not_hide_that_a_case_failed() -> None:
    sweep = ad.sweep("paper_1dof", WRONG, modulus, points=2)
    with pytest.raises(
        ad.ArmDesignError, match=r"stroke_mm=-5\.0: .*the frame has the other cases"
    ):
        _ = sweep.answers


@pytest.mark.slow
def test_a_task_of_a_file_that_no_worker_can_import_travels_with_all_it_needs(
    tmp_path: Path,
) -> None:
    """As the studies'. Its journal knows the whole file: what the task calls may have changed."""

    def frame(factor: float) -> ad.Sweep:
        path = tmp_path / "far.py"
        path.write_text(
            f"FACTOR = {factor}\n\ndef scaled(modulus):\n    return FACTOR * modulus\n\n"
            "def task(machine, workspace):\n"
            "    return {'scaled': scaled(machine.section.fluid.bulk_modulus_MPa)}\n"
        )
        linecache.checkcache()
        spec = importlib.util.spec_from_file_location("far", path)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return ad.sweep(
            "paper_1dof", MODULI, module.task, points=2, workers=2, journal=tmp_path / "j"
        )

    first, again, other = frame(2.0), frame(2.0), frame(30.0)
    assert (first.kept, again.kept, other.kept) == (0, 4, 0)
    assert first.answers["scaled"].to_list() == [2 * x for x in MODULI["fluid.bulk_modulus_MPa"]]
    assert other.answers["scaled"].to_list() == [30 * x for x in MODULI["fluid.bulk_modulus_MPa"]]


def test_cases_of_each_kind(tmp_path: Path) -> None:
    assert grid_changes({"a": [1, 2], "b": [3, 4]}) == [
        {"a": a, "b": b} for a in (1, 2) for b in (3, 4)
    ]
    points = sobol_changes({"a": (0, 1), "b": (10, 20)}, 8, seed=3)
    assert points == sobol_changes({"a": (0, 1), "b": (10, 20)}, 8, seed=3)
    for digits in range(8):  # each eighth of both ranges has one point
        assert sum(int(8 * p["a"]) == digits for p in points) == 1
        assert sum(int(8 * (p["b"] - 10) / 10) == digits for p in points) == 1
    (tmp_path / "c.csv").write_text('a;b;c\n1,5;x;true\n2;;false\n3;[1, 2.5];"""3"""\n')
    assert csv_changes(tmp_path / "c.csv") == [
        {"a": 1.5, "b": "x", "c": True},
        {"a": 2, "c": False},
        {"a": 3, "b": [1, 2.5], "c": "3"},
    ]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "maps"}, 'did you mean "map"'),
        ({"changes": {"fluid.bulk_modulus_MPa": []}}, "has no values"),
        ({"changes": {"fluid.bulk_modulus_MPa": 5}}, "no list of values"),
        ({"changes": [5]}, "is no case"),
        ({"changes": pd.DataFrame({"a": [5]})}, "is no case; of a frame"),
        ({"changes": {5: [1, 2]}}, "changes: 5 is no key path"),
        ({"changes": {5: []}}, "5: has no values"),
        ({"changes": {"payload": ["load"]}}, "changes.payload: is a column of the frame"),
        ({"changes": [{"a": 1, 5: 1}]}, "changes: 5 is no key path"),
        ({"changes": {"a": itertools.count()}}, "cases are not allowed"),
        (
            {"changes": {"a": [1, 2]}, "task": any_options, "options": [{"a": 5}]},
            "options.a: is the name of another column",
        ),
        ({"changes": {"a": (2, 1)}, "sobol": 4}, "no range"),
        ({"changes": {"a": (1, 2)}, "seed": 4}, "seed: is of no sequence"),
        ({"changes": {"a": (1, 2)}, "new": True}, "new: is of no journal; give journal too"),
        ({"changes": {"a": 5}, "sobol": 4}, "no range"),
        ({"changes": {"a": (False, True)}, "sobol": 4}, "no range"),
        ({"changes": {"a": (0, 10**400)}, "sobol": 4}, "no range"),
        ({"changes": {"a": (-1.7e308, 1.7e308)}, "sobol": 4}, "no range"),  # of no width
        ({"changes": [{"a": 10**5000}]}, "changes.a: cannot be written down: a number of thous"),
        ({"changes": [{f"a{k}": 1 for k in range(2001)}]}, "2001 key paths are not allowed"),
        ({"sobol": 4}, "has no ranges"),
        ({"payloads": ["nothing"]}, "nothing"),
        ({"payloads": "load"}, "payloads: 'load' is not allowed; give a list, each a text"),
        ({"outputs": "worst_hz"}, "outputs: 'worst_hz' is not allowed; give a list, each a text"),
        ({"task": "design", "options": {"starts": True}}, r"options.starts: True is not allowed"),
        ({"task": "control", "options": {"delay": "2"}}, r"options.delay: '2' is not allowed"),
        ({"options": {"start": 1}}, "no option of the task"),
        ({"options": [{"start": 1}]}, "no option of the task"),
        ({"options": [5]}, "is no set"),
        ({"task": lambda machine: {}}, "task: does not take a machine and a workspace; begin"),
        ({"task": lambda machine, factor=2.0: {}}, "second parameter, factor, would be given"),
        (
            {"task": lambda machine, factor=None: {}, "options": {"factor": 3}},
            "second parameter, factor, would be given the workspace; begin",
        ),
        (
            {"task": scaled, "options": [{"factor": object()}]},
            "options.factor: cannot be written down",
        ),
        ({"workers": 0}, "whole number"),
        ({"points": 3.5}, "points: 3.5 is not allowed"),
        ({"points": 3, "workspace": POSES}, "points: goes not with workspace"),
        ({"changes": {"a": (1, 2)}, "sobol": 4, "seed": -1}, "seed: -1 is not allowed"),
        ({"points": 3, "outputs": ["worst_hz", "worst"]}, "no case has 'worst'"),
        ({"machine": ["paper_1dof", "paper_1dof"]}, "one name"),
        ({"task": scaled, "options": [{"seconds": 1.0}]}, "seconds"),
        ({"changes": {"a": range(10**4)}, "requirements": [{}] * 10**3}, "10000000 cases"),
        (
            {"changes": {"requirements.lift_share": [1]}, "requirements": [{"lift_share": 1}]},
            "requirements.lift_share: is given in changes and in requirements",
        ),
    ],
)
def test_what_keeps_all_cases_from_an_answer_is_one_line(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(ad.ArmDesignError, match=message) as caught:
        ad.sweep(**{"machine": "paper_1dof", **arguments})
    assert "\n" not in str(caught.value)


def test_a_sweep_within_a_task() -> None:
    def task(machine: ad.Machine, workspace: ad.Workspace) -> Mapping[str, Any]:
        inner = ad.sweep(machine, MODULI, modulus, points=3)
        return {"most": inner.frame["modulus"].max()}

    assert ad.sweep("paper_1dof", task=task, points=3).frame["most"].tolist() == [1.4e9]


def test_a_task_that_ends_the_program_fails_its_case_alone() -> None:
    def task(machine: ad.Machine, _: ad.Workspace) -> Mapping[str, Any]:
        if machine.section.fluid.bulk_modulus_MPa == 1000.0:
            sys.exit("no licence")
        return {"x": 1}

    frame = ad.sweep("paper_1dof", MODULI, task, points=3).frame
    assert frame["error"].tolist() == ["", "SystemExit: no licence", "", ""]


def test_two_sweeps_of_one_study_at_a_time() -> None:
    """As they end, neither takes the study from the other."""
    with ThreadPoolExecutor(2) as pool:
        frames = list(pool.map(lambda _: ad.sweep("paper_1dof", MODULI, modulus).frame, range(4)))
    assert all((frame["error"] == "").all() for frame in frames)


def test_a_machine_more_or_fewer_keeps_what_a_journal_has(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    for machines, kept in ((["paper_1dof"], 0), (["paper_1dof", "patu_boom"], 1)):
        assert ad.sweep(machines, task=modulus, points=3, journal=path).kept == kept
    assert ad.sweep("patu_boom", task=modulus, points=3, journal=path).kept == 1
    changed = ad.load("paper_1dof").replace({"fluid.bulk_modulus_MPa": 900.0})
    with pytest.raises(ad.ArmDesignError, match=r"another state of paper_1dof: paper_1dof\.toml;"):
        ad.sweep(changed, task=modulus, points=3, journal=path)


def test_fields_are_numbers_as_the_machine_file_has_them(tmp_path: Path) -> None:
    """Python's ``1_000`` is none."""
    path = tmp_path / "c.csv"
    path.write_text("a\n1_000\n12\n1.5e1\nnan\ntrue\nFALSE\n")  # as spreadsheets write it
    assert [one["a"] for one in csv_changes(path)] == ["1_000", 12, 15.0, "nan", True, False]
