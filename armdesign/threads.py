"""Threads at work on chunks of poses, as many as BLAS may use; one in a worker of a sweep."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from contextvars import copy_context
from itertools import chain, islice
from typing import TypeVar

T = TypeVar("T")

MOST = 4  # threads: with more, they wait for each other's Python


def in_threads(work: Callable[[slice], T], slices: Iterable[slice]) -> Iterator[T]:
    """Results of work on each slice, in order, by as many threads as BLAS may use.

    NumPy's linear algebra lets other threads go on meanwhile. A slice is begun when few results
    before it wait to be taken, so that memory stays flat. The numbers are those of one thread, to
    the last bit.
    """
    slices = iter(slices)
    ahead = list(islice(slices, 2))
    threads = 1 if len(ahead) < 2 else min(_of_blas(), MOST)
    if threads == 1:
        yield from map(work, chain(ahead, slices))
        return
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[T]] = deque()
        for rows in chain(ahead, slices):
            waiting.append(pool.submit(copy_context().run, work, rows))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def one_thread() -> AbstractContextManager[object]:
    """A context in which BLAS, and so ``in_threads``, has one thread."""
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1)
    return limits


def _of_blas() -> int:
    from threadpoolctl import threadpool_info

    pools = (pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
    return max(pools, default=1)
