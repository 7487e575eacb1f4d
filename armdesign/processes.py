"""Processes that are begun: Ctrl-C and the current folder are the business of who began them.

They end with it, too, however it ends.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from armdesign.errors import ArmDesignError

T = TypeVar("T")
WATCH = 1.0  # [s] between two looks at whether the parent lives
SAFE_PATH = "PYTHONSAFEPATH"  # with it Python looks for no modules in the current folder


@contextmanager
def begun_apart() -> Iterator[None]:
    """Context in which pools of loky and their processes begin, apart from what surrounds them.

    They import nothing from the current folder: a machine's holds data, whatever its files are
    called. What this process imports from elsewhere, they find there.

    Ctrl-C never reaches them; it waits meanwhile. Processes that ignored it once they run would
    end in a traceback while they are loaded. Those that clean up, one of loky and one of Python,
    begin before: they must outlive all others, also a closed terminal, or they are begun anew and
    complain.

    Raises:
        ArmDesignError: the system lets none begin.
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        with _without_interrupts():
            yield
    except OSError as error:
        fault = f"cannot begin ({error.strerror or error})"
        remedy = "take one worker, or begin in a folder that is there, with more files allowed"
        raise ArmDesignError("worker processes", fault, remedy) from None
    finally:
        if before is None:
            del os.environ[SAFE_PATH]
        else:
            os.environ[SAFE_PATH] = before


@contextmanager
def _without_interrupts() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as of_loky

    with _without("SIGHUP"):
        for tracker in (resource_tracker, of_loky):
            tracker.ensure_running()  # which lets Ctrl-C pass again
    with _without("SIGINT"):
        yield


@contextmanager
def _without(name: str) -> Iterator[None]:
    """Context that a signal waits for, and that processes begun in it never receive."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.Signals[name]})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def belong_to(parent: int) -> None:
    """Make this process leave Ctrl-C to its parent and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent has ended, which a killed one cannot ask for."""
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)


def may_begin() -> bool:
    """Whether Python lets this process begin others, as a worker of a pool or of dask may not."""
    multiprocessing = sys.modules.get("multiprocessing")
    return multiprocessing is None or not multiprocessing.current_process().daemon


def in_processes(
    tasks: Iterable[Callable[[], T]], workers: int, *, ordered: bool = False
) -> Iterator[T]:
    """Results of tasks as they come, or in their order, by as many processes.

    All of these begin before this returns. One worker, or a single task, is this process, which
    does each task when its result is asked for; so is one that ``may_begin`` none.

    Raises:
        ArmDesignError: the system lets no processes begin.
    """
    some = list(tasks)
    if workers <= 1 or len(some) < 2 or not may_begin():
        return (task() for task in some)
    from joblib import Parallel, delayed

    kind = "generator" if ordered else "generator_unordered"
    each = {"initializer": belong_to, "initargs": (os.getpid(),)}  # of the processes
    with begun_apart():
        results: Iterator[T] = Parallel(workers, return_as=kind, **each)(
            delayed(task)() for task in some
        )
    return results
