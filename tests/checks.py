"""How tests compare: one derivative, one closeness, one worst scenario, one limit of time."""

from __future__ import annotations

import contextlib
import itertools
import signal
from collections.abc import Callable, Iterator

import numpy as np
from numpy.testing import assert_allclose

from armdesign import Bands, Machine, Workspace
from armdesign.frequency.worst_frequency import Worst, worst_frequency

# [rad, m] of the eighth-order differences: truncation and rounding both near 1e-11 relative
STEP = 2e-3
DIFFERENCE = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


def difference(
    function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, step: float = STEP
) -> np.ndarray:
    """∂function/∂x_j at each row of x (n, k) by eighth-order central differences; j becomes the
    last axis.
    """
    columns = []
    for j in range(x.shape[1]):
        unit = step * np.eye(x.shape[1])[j]
        columns.append(
            sum(
                c * (function(x + k * unit) - function(x - k * unit))
                for k, c in enumerate(DIFFERENCE, start=1)
            )
            / step
        )
    return np.stack(columns, axis=-1)


def settled_difference(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """As ``difference``, at each row of x with the step by whose eighth part it changes least.

    For what may bend sharply, as the torque of a cylinder on a four-bar that hardly closes.
    """
    finer = [difference(function, x, STEP / 8**k) for k in range(4)]
    every = tuple(range(1, finer[0].ndim))
    changes = [np.abs(one - other).max(axis=every) for one, other in itertools.pairwise(finer)]
    best = np.argmin(np.nan_to_num(changes, nan=np.inf), axis=0)  # NaN: a step to where it opens
    return np.stack([finer[k][row] for row, k in enumerate(best)])


# rounding of lengths near 1 m over STEP is 1e-13: what a derivative that is zero by nature leaves
FLOOR = 1e-12


def assert_same(actual: np.ndarray, expected: np.ndarray, relative: float) -> None:
    """Equal to a share of the largest number in `expected`: small entries of a matrix are
    differences of large ones.
    """
    assert_allclose(actual, expected, rtol=0, atol=max(relative * np.abs(expected).max(), FLOOR))


def worst_within(
    machine: Machine, workspace: Workspace, bands: Bands, today: Machine | None = None
) -> Worst:
    """The worst frequency within the bands, at every soft corner, searched one by one."""
    at_end, masses = bands.at_end(machine, bands.ends[0], today), bands.mass_shares(machine)
    worst = [worst_frequency(at_end, workspace, *shares) for shares in masses]
    return min(worst, key=lambda one: one.frequency)


@contextlib.contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Break off what takes more processor time than that."""

    def late(*_: object) -> None:
        raise AssertionError(f"takes longer than {seconds} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
