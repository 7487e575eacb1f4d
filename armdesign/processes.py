"""Processes that are begun: Ctrl-C and the current folder are the business of who began them."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")
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
    """
    before = os.environ.get(SAFE_PATH)
    os.environ[SAFE_PATH] = "1"
    try:
        with _without_interrupts():
            yield
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


def in_processes(
    tasks: Iterable[Callable[[], T]], workers: int, *, ordered: bool = False
) -> Iterator[T]:
    """Results of tasks as they come, or in their order, by as many processes.

    All of these begin before this returns. One worker, or a single task, is this process, which
    does each task when its result is asked for.
    """
    some = list(tasks)
    if workers <= 1 or len(some) < 2:
        return (task() for task in some)
    from joblib import Parallel, delayed

    kind = "generator" if ordered else "generator_unordered"
    with begun_apart():
        results: Iterator[T] = Parallel(workers, return_as=kind)(delayed(task)() for task in some)
    return results
