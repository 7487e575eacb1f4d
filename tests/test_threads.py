"""Work on chunks by threads: results in order, little ahead, errors as without, the same bits."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

import armdesign as ad
from armdesign.errors import PoseError
from armdesign.threads import in_threads, one_thread
from tests import machines


@pytest.fixture
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine of two cores, however many this one has."""
    monkeypatch.setattr("armdesign.threads._of_blas", lambda: 2)


def slices(count: int) -> list[slice]:
    return [slice(row, row + 1) for row in range(count)]


def test_results_come_in_order_however_long_each_takes(two_threads: None) -> None:
    names = set()

    def work(rows: slice) -> int:
        names.add(threading.current_thread().name)
        time.sleep(0.02 if rows.start % 2 == 0 else 0.0)
        return int(rows.start)

    assert list(in_threads(work, slices(9))) == list(range(9))
    assert len(names) == 2
    assert threading.current_thread().name not in names


def test_little_is_begun_before_results_are_taken(two_threads: None) -> None:
    """Two at work and one waiting: a million chunks do not lie in memory."""
    begun = []
    results = in_threads(lambda rows: begun.append(rows.start), iter(slices(1000)))
    next(results)
    time.sleep(0.05)
    assert 1 <= len(begun) <= 3
    results.close()  # type: ignore[attr-defined]
    assert len(begun) <= 3


def test_the_first_error_in_order_is_raised(two_threads: None) -> None:
    def work(rows: slice) -> int:
        if rows.start in (2, 3):
            time.sleep(0.05 if rows.start == 2 else 0.0)
            raise PoseError(f"pose {rows.start}", "is out of reach", "take another")
        return int(rows.start)

    results = in_threads(work, slices(9))
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(PoseError, match="pose 2"):
        next(results)


def test_what_numpy_is_told_holds_in_threads(two_threads: None) -> None:
    def work(rows: slice) -> float:
        return float(np.float64(1.0) / np.zeros(2)[rows][0])

    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        list(in_threads(work, slices(2)))
    with np.errstate(divide="ignore"):
        assert list(in_threads(work, slices(2))) == [np.inf, np.inf]


def test_one_part_needs_no_thread(two_threads: None) -> None:
    assert names_of_threads(1) == {threading.current_thread().name}


def test_a_worker_of_a_sweep_starts_no_thread() -> None:
    with one_thread():
        assert names_of_threads(9) == {threading.current_thread().name}


def names_of_threads(count: int) -> set[str]:
    return set(in_threads(lambda _: threading.current_thread().name, slices(count)))


@pytest.mark.parametrize("name", ["excavator_20t", "crossing"])
def test_two_threads_give_the_bits_of_one(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = machines.named(name)
    monkeypatch.setattr("armdesign.arrays.CHUNK", 23)
    maps, modes = [], []
    for threads in (1, 2):
        monkeypatch.setattr("armdesign.threads._of_blas", lambda count=threads: count)
        maps.append(ad.frequency_map(machine, ad.Workspace.grid(machine, 5)))
        modes.append(ad.natural_modes(machine.at(maps[-1].workspace.q)))
    assert maps[0].frame.equals(maps[1].frame)
    assert np.array_equal(maps[0].stiffness_parts, maps[1].stiffness_parts)
    assert maps[0].worst.frequency == maps[1].worst.frequency
    assert np.array_equal(modes[0].shapes, modes[1].shapes)


def test_two_threads_give_the_gains_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    machine, found = ad.load("excavator_20t"), []
    monkeypatch.setattr("armdesign.control.map_parts.CHUNK", 5)
    for threads in (1, 2):
        monkeypatch.setattr("armdesign.threads._of_blas", lambda count=threads: count)
        found.append(ad.bandwidth_map(machine, ad.Workspace.grid(machine, 3)))
    assert len(found[0].frame) > 10
    assert found[0].frame.equals(found[1].frame)
    assert found[0].gains.equals(found[1].gains)


@pytest.mark.parametrize("name", ["excavator_20t", "crossing", "four_bar_left", "heavy_bars"])
def test_a_pose_alone_has_the_bits_that_it_has_among_others(name: str) -> None:
    machine = machines.named(name)
    poses = machine.at(ad.Workspace.grid(machine, 3).q)
    modes = ad.natural_modes(poses)
    for i in range(0, len(poses), 5):
        alone = machine.at(poses.q[i])
        own = ad.natural_modes(alone)
        for one, many in ((alone, poses), (own, modes)):
            arrays = {k: v for k, v in vars(one).items() if isinstance(v, np.ndarray)}
            for key, array in arrays.items():
                assert np.array_equal(array[0], getattr(many, key)[i]), key


def test_the_worst_pose_is_the_same_whatever_blas_has() -> None:
    """SLSQP adds up in another order with two threads of its BLAS."""
    worst = []
    for count in (1, 2):
        with threadpool_limits(count, "blas"):
            worst.append(ad.frequency_map(machines.named("rocking")).worst)
    assert worst[0].frequency == worst[1].frequency
    assert np.array_equal(worst[0].q, worst[1].q)
