"""Finished pieces: those that a journal has are not computed again, and it goes when it served."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import pytest

import armdesign
from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.journal.finished import Form, all_finished, finished, keeping
from armdesign.journal.journal import MAGIC
from armdesign.journal.keys import version_of_sources

FORM: Form[float] = Form(write=lambda _, x: {"x": x}, read=lambda _, answer: answer["x"])
HOLD = """
import sys, time
from pathlib import Path
from armdesign.journal.finished import keeping
with keeping(Path(sys.argv[1])):
    print("open", flush=True)
    time.sleep(60)
"""


class Roots:
    """Square roots, and which were computed."""

    def __init__(self) -> None:
        self.computed: list[int] = []

    def of(self, numbers: list[int], interrupted_at: int = -1) -> list[float]:
        def compute(missing: list[int]) -> Iterator[tuple[int, float]]:
            for k in reversed(missing):
                if numbers[k] == interrupted_at:
                    raise KeyboardInterrupt
                self.computed.append(numbers[k])
                yield k, math.sqrt(numbers[k])

        return all_finished("root", len(numbers), lambda k: numbers[k], compute, FORM)


def test_without_a_journal_all_are_computed() -> None:
    roots = Roots()
    assert roots.of([1, 4, 9]) == roots.of([1, 4, 9]) == [1, 2, 3]
    assert roots.computed == [9, 4, 1, 9, 4, 1]


def test_only_what_is_missing_is_computed(tmp_path: Path) -> None:
    """After an interruption; the journal and the folders made for it go in the end."""
    path, roots = tmp_path / "new" / "folder" / "j.sqlite", Roots()
    with pytest.raises(KeyboardInterrupt), keeping(path):
        roots.of([2, 3, 5, 7], interrupted_at=3)
    assert (roots.computed, path.exists()) == ([7, 5], True)
    with keeping(path) as pieces:
        assert roots.of([2, 3, 5, 7]) == [math.sqrt(x) for x in (2, 3, 5, 7)]
        assert roots.of([7, 11]) == [math.sqrt(7), math.sqrt(11)]
        assert pieces.answered == 3
    assert roots.computed == [7, 5, 3, 2, 11]
    assert [path.name for path in path.parent.iterdir()] == []


def test_pieces_of_another_interrupted_run_stay(tmp_path: Path) -> None:
    """Of runs with other inputs in one folder: each takes along what it went on with."""
    path, roots = tmp_path / "j.sqlite", Roots()
    for numbers, at in (([2, 3, 5], 2), ([7, 8, 9], 8), ([2, 3, 5], 2)):
        with pytest.raises(KeyboardInterrupt), keeping(path):
            roots.of(numbers, interrupted_at=at)
    with keeping(path) as other:
        roots.of([10, 11])
    assert (other.answered, other.left) == (0, 3)
    with keeping(path) as pieces:
        roots.of([2, 3])
    assert (pieces.answered, pieces.left) == (1, 1)
    assert path.exists()
    with keeping(path) as last:
        roots.of([7, 8, 9])
    assert (last.answered, last.left, path.exists()) == (1, 0, False)
    assert roots.computed == [5, 3, 9, 11, 10, 2, 8, 7]


def test_what_is_not_written_is_computed_again(tmp_path: Path) -> None:
    form: Form[float] = Form(write=lambda *_: None, read=FORM.read)
    with keeping(tmp_path / "j.sqlite") as pieces:
        assert [finished("x", lambda: 1, lambda: 2.0, form) for _ in range(2)] == [2, 2]
        assert not pieces.entries


def test_pieces_of_the_run_itself_were_not_finished_before(tmp_path: Path) -> None:
    with keeping(tmp_path / "j.sqlite") as pieces:
        Roots().of([2, 3])
        Roots().of([2, 3])
        assert pieces.answered == 0


@pytest.mark.parametrize(
    ("error", "stays"),
    [
        (KeyboardInterrupt(), True),
        (ArmDesignError("disk", "is full", "make room"), True),
        (InfeasibleError("machine", "cannot be", "ask for less"), False),
    ],
)
def test_it_stays_where_there_is_no_answer(
    error: BaseException, stays: bool, tmp_path: Path
) -> None:
    path = tmp_path / "new" / "j.sqlite"

    def ended(numbers: list[int]) -> None:
        with keeping(path):
            Roots().of(numbers)
            raise error

    with pytest.raises(type(error)):
        ended([])
    assert not path.parent.exists()
    with pytest.raises(type(error)):
        ended([2])
    assert path.exists() == stays


def test_a_journal_that_cannot_be_used(tmp_path: Path) -> None:
    """Of another run, damaged or of another version: one line, with a remedy that there is."""
    path = tmp_path / "j.sqlite"
    words = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        with pytest.raises(ArmDesignError, match="another run writes it; wait for that"):
            keeping(path).__enter__()
        other.kill()
    with keeping(path):
        pass
    path.write_bytes(MAGIC + bytes(5000))
    with pytest.raises(ArmDesignError, match=r"is damaged; restore a copy .*, or delete it"):
        keeping(path).__enter__()
    assert path.exists()


def test_other_sources_are_another_version(tmp_path: Path) -> None:
    """A copy of the package with one line more: its journals do not answer for this one."""
    here = Path(armdesign.__file__).parent
    shutil.copytree(here, tmp_path / "armdesign", ignore=shutil.ignore_patterns("__pycache__"))
    surroundings = {**os.environ, "PYTHONPATH": str(tmp_path)}
    words = "from armdesign.journal.keys import version_of_sources as v; print(v())"

    def said() -> str:
        run = [sys.executable, "-B", "-c", words]
        return subprocess.check_output(run, cwd=tmp_path, env=surroundings, text=True)

    assert said().strip() == version_of_sources()
    with (tmp_path / "armdesign" / "sweeps" / "numbers.py").open("a") as file:
        file.write("TWO = 2\n")
    other = said().strip()
    assert other != version_of_sources()
    assert other.partition("+")[0] == version("armdesign")
