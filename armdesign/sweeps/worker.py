"""Work of a worker: it is given a study once, then answers its cases one by one."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Mapping
from concurrent.futures import BrokenExecutor
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import uuid4

import numpy as np

from armdesign.errors import ArmDesignError, may_pass
from armdesign.frequency.workspace import Workspace
from armdesign.journal.journal import Entry
from armdesign.machine.changes import changed_machine
from armdesign.machine.machine import Machine
from armdesign.processes import belong_to
from armdesign.sweeps.answers import writable
from armdesign.sweeps.cases import Case
from armdesign.sweeps.sending import Sent, received, words_of
from armdesign.sweeps.tasks import Task, task_named
from armdesign.threads import one_thread

ONE_THREAD = {  # environment of processes whose libraries shall not share out the processors
    name: "1"
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
}
DIGITS = 4000  # of a whole number that is answered: Python writes no more than 4300
LARGEST = 10**DIGITS


@dataclass(frozen=True, eq=False, kw_only=True)
class Study:
    """Data that all cases of a sweep share; it travels once to each worker.

    Attributes:
        identity: digest of all that decides answers but machines, changes and load cases.
        version: of the package that made it.
        machines: machines that are changed, by name.
        task: name of a task, or a function of machine, workspace and options.
        options: of the task, in all cases.
        workspace: the poses; None: a joint grid of every changed machine.
        points: of that grid.
        name: by which workers know it; of its run alone.
    """

    identity: str
    version: str
    machines: Mapping[str, Machine]
    task: str | Task
    options: Mapping[str, Any]
    workspace: Workspace | None
    points: Any
    name: str = field(default_factory=lambda: uuid4().hex)


@dataclass(frozen=True, kw_only=True)
class Outcome(Entry):
    """Outcome of a case.

    Attributes:
        final: whether the same would come out again.
    """

    final: bool = True


# with the lock of the threads of one process, which answer one case at a time; a task may sweep
# itself, also in threads of its own
_studies: dict[str, tuple[Study, threading.Lock]] = {}
_refused: dict[str, ArmDesignError] = {}  # why this process did not take a study, by its name


def prepare(study: Study) -> None:
    """Keep a study for the cases to come."""
    _studies[study.name] = study, threading.Lock()


def prepare_process(sent: Sent, parent: int) -> None:
    """Take a study in a process that leaves Ctrl-C to its parent and ends with it.

    What keeps it from that is said by the first case.
    """
    belong_to(parent)
    try:
        prepare(received(sent))
    except ArmDesignError as error:
        _refused[sent.name] = error


def is_prepared(name: str) -> bool:
    """Whether this process has the study of a name."""
    return name in _studies


def forget(name: str) -> None:
    """Drop the study of a name."""
    _studies.pop(name, None)


def answer(name: str, case: Case) -> Outcome:
    """The outcome of a case of the study of a name.

    Whatever goes wrong in the case is in the outcome: one case does not end the others. Only
    Ctrl-C does.

    Raises:
        ArmDesignError: this process could not take the study.
    """
    if name in _refused:
        raise _refused[name]
    study, one_at_a_time = _studies[name]
    with one_at_a_time, one_thread():
        start = time.perf_counter()
        try:
            numbers = _answer(study, case)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            seconds = time.perf_counter() - start
            words = writable(words_of(error))
            return Outcome(answer={}, seconds=seconds, error=words, final=_is_final(error))
        return Outcome(answer=numbers, seconds=time.perf_counter() - start)


def _is_final(error: BaseException) -> bool:
    """Whether the same case ends in it again: neither the surroundings nor another ended it."""
    return isinstance(error, Exception) and not (
        isinstance(error, BrokenExecutor) or may_pass(error)
    )


def _answer(study: Study, case: Case) -> dict[str, Any]:
    machine = study.machines[case.machine]
    if case.changes:
        machine = changed_machine(machine, case.changes, "sweep").loaded_like(machine)
    if case.payload is not None:
        machine = machine.with_payload(case.payload)
        machine = replace(machine, payloads=(machine.payload,))
    known = study.workspace
    workspace = known.on(machine) if known else Workspace.grid(machine, study.points)
    task = task_named(study.task) if isinstance(study.task, str) else study.task
    # a copy for each case, as other processes have one, in an order that the key knows
    options = deepcopy(dict(sorted({**study.options, **case.options}.items())))
    return _plain(task(machine, workspace, **options))


def _plain(answer: Any) -> dict[str, Any]:
    """The answer as Python's own numbers, words and truth values."""
    if not isinstance(answer, Mapping):
        fault = f"answers with {type(answer).__name__}"
        raise ArmDesignError("task", fault, "return numbers and words by name, in a dict")
    plain: dict[str, Any] = {}
    for key, given in answer.items():
        name, value = writable(_exact(key if isinstance(key, str) else str(key))), _scalar(given)
        part = f"answer {name}"
        if name in plain:
            raise ArmDesignError(part, "is there twice", "give every answer a name of its own")
        if value is not None and not isinstance(value, str | int | float | bool):
            fault = f"is {type(value).__name__}"
            raise ArmDesignError(part, fault, "give a number, a text or a truth value")
        if isinstance(value, int) and abs(value) >= LARGEST:
            raise ArmDesignError(part, f"has more than {DIGITS} digits", "give fewer")
        plain[name] = writable(value) if isinstance(value, str) else value
    return plain


def _scalar(value: Any) -> Any:
    """What stands alone in an array or is a number of NumPy, as Python's own; others as given."""
    if np.ma.is_masked(value):  # which is no number, though NumPy has one beneath the mask
        return value
    try:
        return _exact(value.item())
    except (AttributeError, TypeError, ValueError):  # it has no such method, or several numbers
        return _exact(value)


def _exact(value: Any) -> Any:
    """A number or text of a class of its own, such as an enumeration's, as a journal has it."""
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, int):
        return value if isinstance(value, bool) else int.__int__(value)
    return float.__float__(value) if isinstance(value, float) else value


def died(times: int) -> Outcome:
    """The outcome of a case whose worker died again and again."""
    return Outcome(
        answer={}, seconds=math.nan, error=f"its worker died {times} times", final=False
    )
