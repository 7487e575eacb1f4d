"""Cases that fail: each alone, in words, and for good only where the case itself is at fault."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pickle
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from enum import IntEnum, StrEnum
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.errors import MachineFileError, raise_together
from armdesign.sweeps import processes, tasks

MODULI = {"fluid.bulk_modulus_MPa": [900.0, 1000.0, 1200.0]}


class SilentError(Exception):
    """An error that cannot say what it is."""

    def __str__(self) -> str:
        raise RuntimeError("no words")


ENDS: dict[str, Callable[[], BaseException]] = {
    "CancelledError: x": lambda: asyncio.CancelledError("x"),
    "GeneratorExit: ": GeneratorExit,
    "SystemExit: 3": lambda: SystemExit(3),
    "SilentError": SilentError,
}


def ends(machine: ad.Machine, _: ad.Workspace, words: str) -> Mapping[str, Any]:
    """A task that is ended at one case."""
    if machine.section.fluid.bulk_modulus_MPa == 1000.0:
        raise ENDS[words]()
    return {"x": 1}


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_whatever_ends_a_case_ends_no_other(workers: int) -> None:
    sets = [{"words": words} for words in ENDS]
    frame = ad.sweep("paper_1dof", MODULI, ends, options=sets, points=2, workers=workers).frame
    middle = frame["fluid.bulk_modulus_MPa"] == 1000.0
    assert frame["error"][middle].tolist() == list(ENDS)
    assert frame["x"][~middle].tolist() == [1] * 8


def saves(machine: ad.Machine, _: ad.Workspace, place: str) -> Mapping[str, Any]:
    """A task that writes a file of ours."""
    machine.save(Path(place) / "new.toml")
    return {"x": 1}


def test_what_the_surroundings_keep_from_an_answer_is_asked_again(tmp_path: Path) -> None:
    """A folder that is in the way, and is not any more."""
    place, journal = tmp_path / "later", tmp_path / "j.sqlite"
    place.write_text("a file in the way")

    def answers() -> ad.Sweep:
        how: dict[str, Any] = {"options": {"place": str(place)}, "points": 2}
        return ad.sweep("paper_1dof", task=saves, journal=journal, **how)

    assert "cannot be written" in answers().frame["error"][0]
    place.unlink()
    again = answers()
    assert (again.kept, again.failures) == (0, {})
    assert answers().kept == 1


def fails(machine: ad.Machine, _: ad.Workspace, how: str) -> Mapping[str, Any]:
    """A task of the user's whose errors are none of ours."""
    try:
        if how == "of the disk":
            raise OSError("no room")
        raise ValueError("no answer")
    except OSError as error:
        raise ValueError("no file") from error
    except ValueError as error:
        if how == "hidden":
            raise KeyError("no name") from None
        if how == "of a process":
            raise BrokenProcessPool("a worker died") from error
        if how == "stopped":
            raise SystemExit from error
        raise


@pytest.mark.parametrize(
    ("how", "kept"),
    [("", 1), ("hidden", 1), ("of the disk", 0), ("of a process", 0), ("stopped", 0)],
)
def test_an_error_of_the_function_is_its_answer(how: str, kept: int, tmp_path: Path) -> None:
    """Of any kind, unless the surroundings may be what it was raised for."""
    options: dict[str, Any] = {"options": {"how": how}, "points": 2}
    first, again = (
        ad.sweep("paper_1dof", task=fails, journal=tmp_path / "j.sqlite", **options)
        for _ in range(2)
    )
    assert (first.kept, again.kept) == (0, kept)
    assert len(again.failures) == 1
    assert again.frame["error"].equals(first.frame["error"])


def keeps(machine: ad.Machine, _: ad.Workspace, place: str, how: str) -> Mapping[str, Any]:
    """A task of the user's that writes into a database of its own."""
    absent = f"{place}/absent"
    with contextlib.ExitStack() as stack:

        def opened(name: str, more: str = "") -> sqlite3.Connection:
            return stack.enter_context(
                contextlib.closing(sqlite3.connect(f"file:{name}{more}", timeout=0, uri=True))
            )

        database = opened(absent if how == "absent" else place)
        database.execute("CREATE TABLE IF NOT EXISTS t (x UNIQUE)")
        if how == "full":
            database.execute("PRAGMA max_page_count = 1")
        if how == "busy":
            opened(place).execute("BEGIN EXCLUSIVE")
        if how == "protected":
            database = opened(place, "?mode=ro")
        row = ["x" * 10_000]
        database.executemany("INSERT INTO t VALUES (?)", [row, row] if how == "twice" else [row])
    return {"x": 1}


@pytest.mark.parametrize(
    ("how", "kept", "said"),
    [
        ("full", 0, "database or disk is full"),
        ("busy", 0, "database is locked"),
        ("protected", 0, "attempt to write a readonly database"),
        ("absent", 0, "unable to open database file"),
        ("twice", 1, "UNIQUE constraint failed: t.x"),
    ],
)
def test_what_sqlite_says_of_the_surroundings_is_asked_again(
    how: str, kept: int, said: str, tmp_path: Path
) -> None:
    more = {"options": {"place": str(tmp_path / "own"), "how": how}, "points": 2}
    runs = [
        ad.sweep("paper_1dof", task=keeps, journal=tmp_path / "j.sqlite", **more) for _ in "12"
    ]
    assert [run.kept for run in runs] == [0, kept]
    assert all(run.frame["error"][0].endswith(said) for run in runs)


WITHIN = """
import os, resource, signal, sys
import armdesign as ad
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

def sums(machine, workspace):
    masses = {"payload.load.mass_kg": [float(mass) for mass in range(100, 130)]}
    size = int(os.environ["MOST"])
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    try:
        return {"n": len(ad.sweep(machine, masses, points=3, journal="inner.sqlite").answers)}
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, 2 * (resource.RLIM_INFINITY,))

def answers(most):
    os.environ["MOST"] = str(most)
    return ad.sweep("paper_1dof", task=sums, points=3, journal="outer.sqlite")

limited = answers(sys.argv[1]).failures.values()
again = answers(resource.RLIM_INFINITY)
print(*limited, again.kept, again.frame["n"][0])
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows limits no sizes of files")
@pytest.mark.parametrize("size", [4096, pytest.param(40_000, marks=pytest.mark.slow)])
def test_a_full_disk_of_a_sweep_within_a_task_is_asked_again(size: int, tmp_path: Path) -> None:
    """That the inner journal could not be written stayed in the outer one."""
    (tmp_path / "run.py").write_text(WITHIN)
    done = subprocess.run(
        [sys.executable, "run.py", str(size)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("inner.sqlite: cannot be written, the disk may be full;")
    assert done.stdout.endswith(" run it again 0 30\n")


def test_a_switched_off_compiler_is_asked_again(tmp_path: Path) -> None:
    code = "import armdesign as ad, sys\nanswers = ad.sweep('paper_1dof', task='validate',"
    code += " points=2, journal='j.sqlite')\nprint(answers.kept, *answers.failures.values())"
    said = [
        subprocess.run(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env=os.environ | variables,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for variables in ({"NUMBA_DISABLE_JIT": "1"}, {}, {"NUMBA_DISABLE_JIT": "1"})
    ]
    assert said[0].endswith("which it switches off; unset it\n")
    assert said[1:] == ["0\n", "1\n"]


def test_errors_tell_whether_they_may_pass() -> None:
    """Where one of ours is raised as Python's own is handled, and in other processes, too."""

    def raised(cause: Exception) -> ad.ArmDesignError:
        try:
            try:
                raise cause
            except type(cause):
                raise MachineFileError("file", "cannot be read") from None
        except ad.ArmDesignError as error:
            return error

    for cause in (FileNotFoundError(), ModuleNotFoundError(), MemoryError()):
        assert raised(cause).passing
        assert pickle.loads(pickle.dumps(raised(cause))).passing
    assert raised(raised(OSError())).passing
    own = ValueError()
    own.__cause__ = own
    assert not raised(own).passing
    with pytest.raises(MachineFileError, match="also: b: is wrong") as caught:
        raise_together([raised(OSError()), ad.ArmDesignError("b", "is wrong")])
    assert caught.value.passing


def answers_with(machine: ad.Machine, _: ad.Workspace, which: int) -> Mapping[Any, Any]:
    """A task that answers with what may be no answer."""
    answers: list[Mapping[Any, Any]] = [
        {"z": np.array([1, 2])},
        {"z": 10**5000},
        {1: 2, "1": 3},
        {"z": 1j},
        {"z": np.array([1.5]), "y": np.float32(0.5), "x": 10**30, "w": np.bool_(True)},
    ]
    return answers[which]


@pytest.mark.parametrize("journal", [None, "j.sqlite"])
def test_what_is_no_answer_is_said_in_words_and_for_good(
    tmp_path: Path, journal: str | None
) -> None:
    sets = [{"which": k} for k in range(5)]
    place = journal and tmp_path / journal
    how: dict[str, Any] = {"options": sets, "points": 2, "journal": place}
    sweep = ad.sweep("paper_1dof", task=answers_with, **how)
    assert sweep.frame["error"].tolist() == [
        "answer z: is ndarray; give a number, a text or a truth value",
        "answer z: has more than 4000 digits; give fewer",
        "answer 1: is there twice; give every answer a name of its own",
        "answer z: is complex; give a number, a text or a truth value",
        "",
    ]
    assert sweep.frame.loc[4, ["z", "y", "x", "w"]].tolist() == [1.5, 0.5, 10**30, True]
    assert ad.sweep("paper_1dof", task=answers_with, **how).kept == (5 if journal else 0)


@pytest.mark.slow
def test_an_interruption_just_after_cases_were_given_leaves_no_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the thread that gives them to workers, which looks at them only afterwards."""
    of_threads: list[object] = []
    monkeypatch.setattr(threading, "excepthook", of_threads.append)
    waits, interval = list[object](), sys.getswitchinterval()

    def wait_once(*given: Any, **how: Any) -> Any:
        waits.append(given)
        if len(waits) == 2:
            raise KeyboardInterrupt
        completed = wait(*given, **how)
        sys.setswitchinterval(1.0)  # [s] no other thread runs until this one waits
        return completed

    monkeypatch.setattr(processes, "wait", wait_once)
    try:
        with pytest.raises(KeyboardInterrupt):
            ad.sweep("paper_1dof", MODULI, "map", points=2, workers=2)
    finally:
        sys.setswitchinterval(interval)
    assert of_threads == []


def test_no_more_processes_begin_than_there_are_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forty took four gigabytes for three cases."""
    begun = list[int]()

    def pool(_: Any, workers: int) -> None:
        begun.append(workers)
        raise ad.ArmDesignError("pool", "is none")

    monkeypatch.setattr(processes, "_pool", pool)
    with pytest.raises(ad.ArmDesignError, match="pool: is none"):
        ad.sweep("paper_1dof", MODULI, "map", points=2, workers=40)
    assert begun == [3]


class Colour(StrEnum):
    """Texts of a class of their own."""

    RED = "r"


class Level(IntEnum):
    """Numbers of a class of their own."""

    LOW = 1


class Mass(float):
    """A float that writes itself in its own way."""

    def __repr__(self) -> str:
        return "heavy"


def of_own_kinds(machine: ad.Machine, _: ad.Workspace) -> Mapping[str, Any]:
    """A task whose answers are numbers and texts of classes of their own."""
    return {"a": Colour.RED, "b": Level.LOW, "c": Mass(1.5), "d": np.bool_(True), Colour.RED: 1}


def test_answers_of_other_kinds_are_what_a_journal_has_of_them(tmp_path: Path) -> None:
    how: dict[str, Any] = {"task": of_own_kinds, "points": 2, "journal": tmp_path / "j.sqlite"}
    first, again = ad.sweep("paper_1dof", **how), ad.sweep("paper_1dof", **how)
    assert again.kept == 1
    pd.testing.assert_frame_equal(again.frame, first.frame, check_exact=True)
    answer = first.outcomes[0].answer
    assert repr(answer) == "{'a': 'r', 'b': 1, 'c': 1.5, 'd': True, 'r': 1}"
    assert set(map(type, (*answer, *answer.values()))) == {str, int, float, bool}


def with_halves(machine: ad.Machine, _: ad.Workspace, how: str) -> Mapping[str, Any]:
    """A task with half of a surrogate pair in its answer, its name or its error."""
    if how == "error":
        raise ValueError("a\ud800")
    return {"a\ud800": 1} if how == "name" else {"text": "a\ud800"}


def test_half_of_a_surrogate_pair_spoils_no_other_case(tmp_path: Path) -> None:
    sets = [{"how": how} for how in ("answer", "name", "error", "a\ud800")]
    how: dict[str, Any] = {"options": sets, "points": 2, "journal": tmp_path / "j.sqlite"}
    sweep = ad.sweep("paper_1dof", {"title": ["x", "\udfff"]}, with_halves, **how)
    frame = sweep.frame[sweep.frame["title"] == "x"]
    assert frame["text"].dropna().tolist() == ["a\\ud800"] * 2
    assert frame["a\\ud800"].dropna().tolist() == [1]
    assert frame["error"].tolist() == ["", "", "ValueError: a\\ud800", ""]
    assert list(frame["how"])[-1] == "a\\ud800"


def large(machine: ad.Machine, _: ad.Workspace) -> Mapping[str, Any]:
    """A task with a whole number that no float has, at all but one modulus."""
    modulus = machine.section.fluid.bulk_modulus_MPa
    return {"n": 2**60 + 1} if modulus > 900.0 else {"other": 1}


def test_whole_numbers_keep_their_digits_beside_cases_without_one() -> None:
    sweep = ad.sweep("paper_1dof", MODULI, large, points=2)
    for table in (sweep.frame, sweep.answers):
        assert table["n"].tolist() == [None, 2**60 + 1, 2**60 + 1]
        assert table["other"].dtype == float


def locked() -> Callable[..., Mapping[str, Any]]:
    lock = threading.Lock()
    return lambda machine, workspace: {"x": 1 if lock else 0}


@pytest.mark.parametrize("task", [locked(), lru_cache(lambda m, w: {"x": 1})])
def test_a_task_that_cannot_travel_is_refused_in_words(task: Any) -> None:
    with pytest.raises(
        ad.ArmDesignError, match=r"task or options: cannot .*; take workers=1"
    ) as e:
        ad.sweep("paper_1dof", MODULI, task, points=2, workers=2)
    assert "\n" not in str(e.value)
    assert ad.sweep("paper_1dof", MODULI, task, points=2).frame["x"].tolist() == [1, 1, 1]


@pytest.mark.parametrize("task", [dict, type])
def test_a_task_without_a_signature_is_refused(task: Any) -> None:
    with pytest.raises(ad.ArmDesignError, match=r"^task: .*give a function of machine and"):
        ad.sweep("paper_1dof", task=task, options={"a": 1}, points=2)


def test_a_missing_valve_is_said_before_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "frequency_map", lambda *_: pytest.fail("it maps"))
    machine = ad.load("paper_1dof")
    bare = replace(machine, cylinders=(replace(machine.cylinders[0], valve=None),))
    with pytest.raises(ad.ArmDesignError, match="cylinder lift has no valve"):
        tasks.simulate(bare, ad.Workspace.grid(machine, points=2))


@pytest.mark.parametrize("pulse", [0.0, -1.0, float("nan")])
def test_a_pulse_that_never_begins_is_said_by_its_name(
    pulse: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "frequency_map", lambda *_: pytest.fail("it maps"))
    machine = ad.load("paper_1dof")
    with pytest.raises(ad.ArmDesignError, match=r"^pulse: .* s is not allowed; give a positive"):
        tasks.simulate(machine, ad.Workspace.grid(machine, points=2), pulse=pulse)
