"""A study that goes to other processes: only where these have the same code of the user's."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from joblib.externals.loky.backend.reduction import dumps

import armdesign as ad
from armdesign.journal.keys import version_of_sources
from armdesign.sweeps import sending
from armdesign.sweeps.sending import Sent, received, sent
from armdesign.sweeps.worker import Study

HELPER = "K = 2.0\n\n\ndef scaled(x):\n    return K * x\n"
TASK = """
import threading
import functools

import sent_helper

LOCK = threading.Lock()
FACTOR = 1.0


class Law:
    def __init__(self, n):
        self.n = n

    def task(self, machine, workspace):
        return {"x": self.n}


def task(machine, workspace):
    with LOCK:
        return {"x": sent_helper.scaled(FACTOR)}


def inside(machine, workspace):
    import sent_helper as h

    return {"x": h.K}


@functools.lru_cache
def cached(machine, workspace):
    return {"x": FACTOR}
"""
MAIN = """
import enum, functools, pickle, sys, threading
from dataclasses import dataclass
import cloudpickle
import numpy as np
from pydantic import BaseModel
import armdesign as ad
import sent_task, sent_helper
from sent_task import Law
from test_sending import sent_of

class Kind(enum.Enum):
    A = 1

@dataclass
class Own:
    n: float = 2.0
    def __call__(self, machine, workspace):
        return {"x": self.n * sent_helper.K}

class Plan(BaseModel):
    n: float = 2.0

class Local(Law):
    pass

FACTORS = np.array([1.0, 2.0])

def typed(machine, workspace, kind=Kind.A):
    assert kind is Kind.A and Plan().n
    return {"x": sent_task.FACTOR * FACTORS[0] * Law(1).n}

def imports(machine, workspace):
    import sent_helper
    return {"x": sent_helper.scaled(1)}

def closure(n):
    return lambda machine, workspace: {"x": n, "y": Own().n}

tasks = [sent_task.task, sent_task.inside, sent_task.cached, Law(3).task, Local(3).task, Own()]
tasks += [typed, imports, closure(3), functools.partial(typed, kind=Kind.A), "map"]
with open("sent.pickle", "wb") as file:
    pickle.dump([tuple(sent_of(task, cloudpickle.dumps)) for task in tasks], file)
"""
OTHER = """
import pickle
from armdesign.sweeps.sending import Sent, received
for one in pickle.load(open("sent.pickle", "rb")):
    try:
        print(getattr(received(Sent(*one)), "name") == one[0])
    except Exception as error:
        print(error)
"""
Loaded = Callable[..., ModuleType]


def sent_of(task: Any, how: Callable[[Any], Any] = dumps) -> Sent:
    """A study of a task, sent."""
    nothing: dict[str, Any] = {"machines": {}, "options": {}, "workspace": None, "points": 2}
    return sent(Study(identity="one", version=version_of_sources(), task=task, **nothing), [], how)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a module of a task and its helper, where modules are looked for."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setattr(sending, "_same", set())
    for name, text in (("sent_helper", HELPER), ("sent_task", TASK)):
        (tmp_path / f"{name}.py").write_text(text)
        os.utime(tmp_path / f"{name}.py", (0, 0))
        monkeypatch.delitem(sys.modules, name, raising=False)
    importlib.invalidate_caches()
    return tmp_path


@pytest.mark.parametrize("task", ["task", "inside"])
def test_a_process_with_another_state_of_a_module_does_not_take_a_study(
    folder: Path, task: str
) -> None:
    """It would answer otherwise, by the key of what it was not asked."""
    module = importlib.import_module("sent_task")
    study = sent_of(getattr(module, task))
    assert received(study).name == study.name
    sending._same.clear()
    module.sent_helper.K = 7.0
    with pytest.raises(ad.ArmDesignError, match=r"^worker: has another K in sent_helper\.scaled"):
        received(study)


def test_what_tasks_change_in_their_modules_refuses_no_second_study(folder: Path) -> None:
    module = importlib.import_module("sent_task")
    first, second = sent_of(module.task), sent_of(module.task)
    assert received(first).name == first.name
    module.FACTOR = 3.0  # type: ignore[attr-defined]
    assert received(second).name == second.name


def test_a_process_without_a_module_says_so(folder: Path) -> None:
    study = sent_of(importlib.import_module("sent_task").task)
    del sys.modules["sent_task"]
    (folder / "sent_task.py").unlink()
    importlib.invalidate_caches()
    words = (
        r"^worker: cannot load the study \(ModuleNotFoundError: No module named 'sent_task'\); "
    )
    with pytest.raises(ad.ArmDesignError, match=words):
        received(study)


def test_another_process_takes_tasks_of_all_kinds_until_a_file_is_edited(folder: Path) -> None:
    """Of modules with locks, of programs, classes, closures; edited: all that have the helper."""
    (folder / "main.py").write_text(MAIN)

    def run(*words: str) -> list[str]:
        paths = [str(folder), str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
        done = subprocess.run(
            [sys.executable, "-B", *words],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.splitlines()

    run("main.py")
    assert run("-c", OTHER) == ["True"] * 11
    (folder / "sent_helper.py").write_text(HELPER.replace("2.0", "3.0"))
    said = [line[:19] for line in run("-c", OTHER)]
    other = "worker: has another"
    assert said == [
        other,
        other,
        "True",
        "True",
        "True",
        other,
        other,
        other,
        other,
        other,
        "True",
    ]


@pytest.mark.slow
def test_two_workers_never_answer_what_one_does_not(folder: Path) -> None:
    module = importlib.import_module("sent_task")
    how: dict[str, Any] = {"points": 2, "workers": 2}
    moduli = {"fluid.bulk_modulus_MPa": [900.0, 1000.0]}
    assert ad.sweep("paper_1dof", moduli, module.task, **how).frame["x"].tolist() == [2.0, 2.0]
    module.FACTOR = 7.0  # type: ignore[attr-defined]
    how["journal"] = folder / "j.sqlite"
    with pytest.raises(ad.ArmDesignError, match=r"another FACTOR in sent_task\.cached than"):
        ad.sweep("paper_1dof", moduli, module.cached, **how)
    one = ad.sweep("paper_1dof", moduli, module.cached, **how | {"workers": 1})
    assert one.frame["x"].tolist() == [7.0, 7.0]


def asserted(machine: ad.Machine, workspace: ad.Workspace) -> dict[str, float]:
    assert len(workspace.q)
    return {"x": machine.fluid.bulk_modulus}


def test_functions_that_pytest_rewrote_are_taken() -> None:
    """Another process has this file as it is, and other code of it."""
    moduli = {"fluid.bulk_modulus_MPa": [900.0, 1000.0]}
    sweep = ad.sweep("paper_1dof", moduli, asserted, points=2, workers=2)
    assert sweep.frame["x"].tolist() == [900e6, 1000e6]
