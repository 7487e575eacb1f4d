"""Shortest times of some runs: what delays a run is the machine's, not the program's."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

Result = TypeVar("Result")


class Best(NamedTuple, Generic[Result]):
    """Shortest wall and processor times of some runs [s], and what the last one returned.

    They are the same on an idle machine and one core; a busy machine spoils wall time.
    """

    wall: float
    processor: float
    result: Result


def best_of(action: Callable[[], Result], times: int = 3) -> Best[Result]:
    """The best of some runs of an action."""
    return in_turn(action, times=times)[0]


def in_turn(*actions: Callable[[], Result], times: int = 3) -> list[Best[Result]]:
    """The best of some runs of each action; they take turns, so that a slow hour slows all."""
    best: list[Best[Result]] = []
    for _ in range(times):
        runs = [_run(action) for action in actions]
        best = [_better(*pair) for pair in zip(best, runs, strict=True)] if best else runs
    return best


def _run(action: Callable[[], Result]) -> Best[Result]:
    wall, processor = time.perf_counter(), time.process_time()
    result = action()
    return Best(time.perf_counter() - wall, time.process_time() - processor, result)


def _better(before: Best[Result], now: Best[Result]) -> Best[Result]:
    wall, processor = min(before.wall, now.wall), min(before.processor, now.processor)
    return Best(wall, processor, now.result)
