"""The status line: rounds of loops, one inside the other, and the time that is left."""

from __future__ import annotations

import re
import time

import pytest

import armdesign as ad
from armdesign import progress
from armdesign.progress import Loop, Work, counted


def test_rounds_and_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two values of three starts each, 10 s a start: by hand 50, 40, … 10 s are left."""
    now, said = [0.0], []
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    work = Work("searching", said.append)
    monkeypatch.setattr(progress, "_at_work", [work])
    for _ in counted("ab", "value"):
        for _ in counted("xyz", "start"):
            now[0] += 10
    assert said[1] == "searching, value 1 of 2, start 1 of 3"
    assert "searching, value 1 of 2, start 2 of 3, 50 s left" in said
    assert "searching, value 2 of 2, start 3 of 3, 10 s left" in said
    assert work.loops == []


def test_longer_times_are_minutes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress.time, "monotonic", lambda: 100.0)
    work = Work("sweeping", lambda _: None, [Loop("sweep", 36, 9, 0.0)])
    assert (work.rounds, work.left) == (["sweep 10 of 36"], "5 min left")


def test_what_was_over_before_takes_no_time() -> None:
    began = time.monotonic() - 30.0
    work = Work("sweeping", lambda _: None, [Loop("case", 40, 20, began, before=10)])
    assert (work.rounds, work.left) == (["case 21 of 40"], "60 s left")


def test_an_interruption_says_where() -> None:
    def work() -> None:
        with progress.progress("searching", silent=True):
            for number in counted(range(3), "start"):
                if number == 1:
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        work()
    assert caught.value.__notes__ == ["at start 2 of 3"]


def test_loops_outside_of_commands_are_as_they_were() -> None:
    assert list(counted(iter("abc"), "start")) == ["a", "b", "c"]


@pytest.mark.slow
def test_simulations_say_how_many_runs_are_over(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(progress, "_at_work", [Work("simulating", said.append)])
    machine = ad.load("paper_1dof")
    validation = ad.validate(machine, workspace=ad.Workspace.grid(machine, 3))
    assert said.pop() == "simulating"
    parts = [re.match(r"simulating, pose (\d) of 3(?:, run (\d) of (\d))?", one) for one in said]
    rounds = [(int(part[1]), int(part[2] or 0)) for part in parts if part]
    assert len(rounds) == len(said)
    assert sum(int(part[3]) for part in parts if part and part[2] == "1") == len(validation.runs)
    poses = [pose for pose, _ in rounds]
    assert poses == sorted(poses)
    for pose in (1, 2, 3):
        runs = [run for at, run in rounds if at == pose and run]
        assert runs == list(range(1, 1 + len(runs))) != []
