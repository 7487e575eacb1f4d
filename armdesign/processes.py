"""Processes that are begun: they leave Ctrl-C to the one that began them."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Context in which pools of loky and their processes begin, which Ctrl-C then never reaches.

    It waits meanwhile. Processes that ignored it once they run would end in a traceback while
    they are loaded. Those that clean up, one of loky and one of Python, begin before: they must
    outlive all others, also a closed terminal, or they are begun anew and complain.
    """
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


def in_processes(tasks: Iterable[Any], workers: int, *, ordered: bool = False) -> Iterator[Any]:
    """Results of joblib's tasks as they come, or in their order, by as many processes.

    All of these begin before this returns.
    """
    from joblib import Parallel

    kind = "generator" if ordered else "generator_unordered"
    with without_interrupts():
        results: Iterator[Any] = Parallel(workers, return_as=kind)(tasks)
    return results
