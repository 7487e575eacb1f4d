"""Cases on processes of this computer, by joblib's loky.

When a worker dies, loky gives up the whole pool. The cases that were under way are then tried
again in a new one, one by one, so that the one that kills its worker is known by name.
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from armdesign.processes import begun_apart
from armdesign.sweeps.cases import Case
from armdesign.sweeps.sending import Sent, sent
from armdesign.sweeps.worker import ONE_THREAD, Outcome, Study, answer, died, prepare_process
from armdesign.transaction import undisturbed

TRIES = 3  # of a case whose worker dies
TAKEN = 5.0  # [s] within which a pool's thread takes the cases that it was given

Running = dict["Future[Outcome]", Case]


def on_processes(
    study: Study, cases: Sequence[Case], workers: int, died_at: Callable[[Case], None]
) -> Iterator[tuple[Case, Outcome]]:
    """Cases with their outcomes, as they come.

    Args:
        study: what the cases share.
        cases: the cases.
        workers: number of processes, of which no more begin than there are cases.
        died_at: told each case that is tried again because its worker died.

    Raises:
        ArmDesignError: a task or its options cannot be sent to processes, or it is of a module
            that was changed since it was loaded.
    """
    from joblib.externals.loky.backend.reduction import dumps

    parcel = sent(study, cases, dumps)
    workers = min(workers, len(cases))
    waiting, deaths = deque(cases), Counter[str]()
    running: Running = {}
    pool = _pool(parcel, workers)
    try:
        while waiting or running:
            _fill(pool, study, waiting, running, workers, deaths)
            outcomes, lost = _completed(running)
            yield from outcomes
            if not lost:
                continue
            _end(pool, running)
            for case in lost:
                deaths[case.key] += 1
                if deaths[case.key] == TRIES:
                    yield case, died(TRIES)
                else:
                    died_at(case)
                    waiting.appendleft(case)
            pool = _pool(parcel, workers)
    finally:
        with undisturbed():
            _end(pool, running)


def _fill(
    pool: Any,
    study: Study,
    waiting: deque[Case],
    running: Running,
    workers: int,
    deaths: Counter[str],
) -> None:
    """Give every worker a case; a case at which one died has the pool for itself."""
    while waiting and len(running) < workers:
        suspect = any(deaths[case.key] for case in (waiting[0], *running.values()))
        if suspect and running:
            return
        case = waiting.popleft()
        try:
            with begun_apart():  # the first case begins all processes
                running[pool.submit(answer, study.name, case)] = case
        except BrokenProcessPool as error:  # a worker died since the last case came back
            future: Future[Outcome] = Future()
            future.set_exception(error)
            running[future] = case
            return


def _completed(running: Running) -> tuple[list[tuple[Case, Outcome]], list[Case]]:
    """Outcomes that have come, and the cases that were under way when a worker died."""
    completed, _ = wait(running, return_when=FIRST_COMPLETED)
    if any(isinstance(future.exception(), BrokenProcessPool) for future in completed):
        completed, _ = wait(running)
    outcomes, lost = [], []
    for future in completed:
        case = running.pop(future)
        if isinstance(future.exception(), BrokenProcessPool):
            lost.append(case)
        else:
            outcomes.append((case, future.result()))
    return outcomes, lost


def _pool(parcel: Sent, workers: int) -> Any:
    from joblib.externals.loky import ProcessPoolExecutor

    with begun_apart():
        return ProcessPoolExecutor(
            workers, initializer=prepare_process, initargs=(parcel, os.getpid()), env=ONE_THREAD
        )


def _end(pool: Any, running: Running) -> None:
    """End the pool's processes, whatever they do.

    First its thread must have taken all cases: one that was given to it just before would end the
    thread in a ``KeyError``, whose traceback Python prints.
    """
    until = time.monotonic() + TAKEN
    while any(_waits(future) for future in running) and time.monotonic() < until:
        time.sleep(1e-3)
    pool.shutdown(wait=True, kill_workers=True)


def _waits(future: Future[Outcome]) -> bool:
    return not (future.running() or future.done())
