"""Threads at work on chunks of poses; one in a worker of a sweep.

As many as BLAS may use, or in a command, whose BLAS has one, as there are processors.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar, copy_context
from functools import cache
from itertools import chain, islice
from threading import Lock
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from concurrent.futures import Future

    from threadpoolctl import ThreadpoolController

Part = TypeVar("Part")
T = TypeVar("T")

MOST = 4  # threads: with more, they wait for each other's Python
# poses times coordinates of each of several threads: between small chunks they wait, too
LARGE_CHUNK = 60_000
_beside = 1  # of them, whatever BLAS may use
_ones, _entering, _limited = 0, Lock(), ExitStack()  # contexts of one thread
_at_work = ContextVar("_at_work", default=False)  # whether this is one of several threads


def in_threads(work: Callable[[Part], T], parts: Iterable[Part]) -> Iterator[T]:
    """Results of work on each part, in order, by threads.

    NumPy's linear algebra and compiled code let other threads go on meanwhile. A part is begun
    when few results before it wait to be taken, so that memory stays flat; after an error only
    those under way are ended. The numbers are those of one thread, to the last bit.
    """
    parts = iter(parts)
    ahead = list(islice(parts, 2))
    count = 1 if len(ahead) < 2 else threads()
    if count <= 1:
        yield from map(work, chain(ahead, parts))
        return
    from concurrent.futures import ThreadPoolExecutor

    pool = ThreadPoolExecutor(count)
    try:
        waiting: deque[Future[T]] = deque()
        for part in chain(ahead, parts):
            context = copy_context()
            context.run(_at_work.set, True)
            waiting.append(pool.submit(context.run, work, part))
            if len(waiting) > count:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)


def thread_chunks(count: int, coordinates: int) -> Iterator[slice]:
    """Slices of ``count`` rows for ``in_threads``: chunks of one thread, large ones of several.

    Of an arm of so many ``coordinates``; one slice where this is such a thread itself.
    """
    from armdesign.arrays import CHUNK, chunks  # not before the threads of BLAS are set

    several = threads() if count > CHUNK else 1
    if several > 1:
        return chunks(count, max(min(-(-count // several), LARGE_CHUNK // coordinates), CHUNK))
    return chunks(count, CHUNK if several else count)


def allow(count: int) -> None:
    """Let ``in_threads`` have so many threads, though BLAS has fewer."""
    global _beside
    _beside = count


@contextmanager
def one_thread() -> Iterator[None]:
    """A context in which BLAS and ``in_threads`` have one thread.

    They have theirs again when all such contexts have ended, of whatever threads.
    """
    global _ones
    with _entering:
        if _ones == 0:
            _limited.enter_context(_limits())
        _ones += 1
    try:
        yield
    finally:
        with _entering:
            _ones -= 1
            if _ones == 0:
                _limited.close()


@contextmanager
def _limits() -> Iterator[None]:
    from threadpoolctl import threadpool_limits

    before = _beside
    with threadpool_limits(1):
        allow(1)
        try:
            yield
        finally:
            allow(before)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """A context in which BLAS has one thread: with more, libraries' searches end elsewhere."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield


def threads() -> int:
    """Threads of ``in_threads`` where there is work for them; none in one of its own."""
    return 0 if _at_work.get() else min(max(_beside, _of_blas()), MOST)


def processors() -> int:
    """Processors that this process may use."""
    counted = getattr(os, "sched_getaffinity", None)
    return len(counted(0)) if counted else os.cpu_count() or 1


def _of_blas() -> int:
    return max((pool["num_threads"] for pool in _pools_of_blas().info()), default=1)


@cache
def _pools_of_blas() -> ThreadpoolController:
    """NumPy's: to look for them takes milliseconds."""
    import numpy  # noqa: F401
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api="blas")
