"""A scheduler and two workers, each a process of its own, on loopback."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import armdesign as ad
from armdesign.sweeps import cluster
from armdesign.sweeps.cluster import _client, _is_taken
from armdesign.sweeps.sweep import sweep
from armdesign.sweeps.worker import Study

QUIET = [  # what the scheduler's client leaves open
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
pytestmark = [pytest.mark.slow, *QUIET]
MODULI = {"fluid.bulk_modulus_MPa": [900.0 + 10 * n for n in range(30)]}
Start = Callable[..., "subprocess.Popen[bytes]"]


@contextmanager
def dask(folder: Path) -> Iterator[tuple[str, Start, subprocess.Popen[bytes]]]:
    """Address of a scheduler, a function that starts a worker, and the scheduler's process."""
    with socket.socket() as free, ExitStack() as stack:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
        address = f"tcp://127.0.0.1:{port}"

        def start(*words: str) -> subprocess.Popen[bytes]:
            command = [sys.executable, "-m", "distributed.cli." + words[0], *words[1:]]
            log = stack.enter_context((folder / f"{words[0]}-{time.time_ns()}.log").open("wb"))
            process = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder)
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        def worker(nanny: str = "--no-nanny") -> subprocess.Popen[bytes]:
            loopback = ("--host", "127.0.0.1", "--no-dashboard", nanny)
            return start("dask_worker", address, *loopback, "--nthreads", "1")

        free.close()
        loopback = ("--host", "127.0.0.1", "--port", str(port))
        scheduler = start("dask_scheduler", *loopback, "--no-dashboard", "--no-show")
        yield address, worker, scheduler


def test_a_worker_killed_and_one_started_late_lose_and_double_nothing(tmp_path: Path) -> None:
    journal = tmp_path / "j.sqlite"
    with dask(tmp_path) as (address, worker, _):
        first, messages = worker(), list[str]()
        worker()

        def say(text: str) -> None:
            messages.append(text)
            if len(messages) == 6:
                os.kill(first.pid, signal.SIGKILL)
                worker()

        on_cluster = sweep(
            "paper_1dof", MODULI, points=5, scheduler=address, journal=journal, say=say
        )
    again = [text for text in messages if text.startswith("a worker died; again: ")]
    done = [f"{n} of 30 cases" for n in range(1, 31)]
    assert [text for text in messages if text in done] == done
    others = {text.partition(";")[0] for text in messages if text not in [*done, *again]}
    assert others <= {"waits for a worker", "a worker has come"}  # as late as workers begin
    assert again == [f"a worker died; again: {name}" for name in on_cluster.retried]
    assert again
    local = ad.sweep("paper_1dof", MODULI, points=5)
    kept = ad.sweep("paper_1dof", MODULI, points=5, journal=journal)
    assert kept.kept == 30
    one, other = (each.frame.drop(columns="seconds") for each in (on_cluster, local))
    pd.testing.assert_frame_equal(one, other, check_exact=True)


def test_a_scheduler_that_is_not_there_is_named() -> None:
    with pytest.raises(ad.ArmDesignError, match=r"tcp://127\.0\.0\.1:9 cannot be reached"):
        ad.sweep("paper_1dof", MODULI, scheduler="tcp://127.0.0.1:9")


UNREACHED = """
import socket, sys
import armdesign as ad
from armdesign.sweeps import cluster
cluster.PATIENCE = 1.0
with socket.socket() as server:
    server.bind(("127.0.0.1", 0))
    if sys.argv[1] == "silent":
        server.listen()
    try:
        ad.sweep("paper_1dof", points=2, scheduler=f"tcp://127.0.0.1:{server.getsockname()[1]}")
    except ad.ArmDesignError as error:
        print(error)
"""


@pytest.mark.parametrize("kind", ["silent", "absent"])
def test_a_server_that_does_not_greet_is_no_scheduler(kind: str) -> None:
    """It was waited for for ever; and of one that is not there dask complained at the end."""
    words = [sys.executable, "-c", UNREACHED, kind]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert "cannot be reached or is no scheduler of dask (TimeoutError)" in done.stdout
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "x"])
def test_a_journal_is_not_set_aside_for_a_scheduler_that_is_not_there(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 1.0)
    how: dict[str, Any] = {"points": 2, "journal": tmp_path / "j.sqlite"}
    ad.sweep("paper_1dof", MODULI, **how)
    before = (tmp_path / "j.sqlite").read_bytes()
    with pytest.raises(ad.ArmDesignError, match=f"--scheduler: {address} cannot be reached"):
        ad.sweep("paper_1dof", MODULI, scheduler=address, new=True, **how)
    assert [path.name for path in tmp_path.iterdir()] == ["j.sqlite"]
    assert (tmp_path / "j.sqlite").read_bytes() == before
    assert ad.sweep("paper_1dof", MODULI, **how).kept == 30


def cancels(machine: ad.Machine, _: ad.Workspace, k: int) -> Mapping[str, Any]:
    """A task that is ended at two cases by what ends dask's workers or hangs its clients."""
    if k:
        raise [asyncio.CancelledError, GeneratorExit][k - 1]
    return {"x": 1}


def test_what_ends_a_case_ends_no_other_on_a_cluster(tmp_path: Path) -> None:
    how: dict[str, Any] = {"options": [{"k": k} for k in range(3)], "points": 2}
    with dask(tmp_path) as (address, worker, _):
        worker()
        frame = ad.sweep("paper_1dof", task=cancels, scheduler=address, **how).frame
        lock = threading.Lock()
        with pytest.raises(ad.ArmDesignError, match="task or options: cannot be sent"):
            ad.sweep("paper_1dof", task=lambda m, w, k: {"x": lock}, scheduler=address, **how)
    assert frame["error"].tolist() == ["", "CancelledError: ", "GeneratorExit: "]


def test_a_scheduler_that_is_killed_is_gone(tmp_path: Path) -> None:
    """While cases come, and while a client asks who has the study, once and again; in a line."""
    logged = list[logging.LogRecord]()
    handler = logging.Handler()
    handler.emit = logged.append  # type: ignore[method-assign]
    logging.getLogger("distributed.client").addHandler(handler)
    with dask(tmp_path) as (address, worker, scheduler):
        worker()
        client = _client(address)

        def say(text: str) -> None:
            if text.startswith("3 of"):
                scheduler.kill()

        with pytest.raises(ad.ArmDesignError, match=f"{address} is gone; start it"):
            sweep("paper_1dof", MODULI, points=40, scheduler=address, say=say)
        assert not logged
        nothing = {"machines": {}, "task": "map", "options": {}, "workspace": None, "points": 3}
        study = Study(identity="one", version="0", **nothing)
        for _ in range(2):
            with pytest.raises(ad.ArmDesignError, match=f"{address} is gone; start it"):
                _is_taken(client, study.name, address)
        client.close(timeout=1)


def sweeps_itself(machine: ad.Machine, _: ad.Workspace) -> Mapping[str, Any]:
    """A task that asks for processes of its own."""
    inner = ad.sweep(machine, {"fluid.bulk_modulus_MPa": [900.0, 1000.0]}, points=3, workers=2)
    return {"sum": float(inner.answers["worst_hz"].sum())}


def test_a_task_that_sweeps_needs_no_processes_of_a_worker_that_may_begin_none(
    tmp_path: Path,
) -> None:
    """As one with a nanny, which is how dask begins several."""
    with dask(tmp_path) as (address, worker, _):
        worker("--nanny")
        there = ad.sweep("paper_1dof", task=sweeps_itself, points=3, scheduler=address)
    here = ad.sweep("paper_1dof", task=sweeps_itself, points=3)
    assert there.answers["sum"].tolist() == here.answers["sum"].tolist()


def test_two_sweeps_of_one_study_on_one_scheduler(tmp_path: Path) -> None:
    """The one that ends first leaves the other its workers; both have cases in common."""
    few, many = ({"fluid.bulk_modulus_MPa": [900.0 + n for n in range(k)]} for k in (8, 40))
    with dask(tmp_path) as (address, worker, _):
        worker()
        with ThreadPoolExecutor(2) as pool:
            frames = list(
                pool.map(
                    lambda changes: (
                        sweep("paper_1dof", changes, points=5, scheduler=address).frame
                    ),
                    (few, many),
                )
            )
    assert [len(frame) for frame in frames] == [8, 40]
    assert all((frame["error"] == "").all() for frame in frames)


def test_a_late_worker_of_another_version_gets_no_case(tmp_path: Path) -> None:
    """It has no study, as its log says, and passes its cases on."""
    shim = "import importlib.metadata as m\nold = m.version\n"
    shim += "m.version = lambda name: '0.0.9' if name == 'armdesign' else old(name)\n"
    (tmp_path / "sitecustomize.py").write_text(shim)
    with dask(tmp_path) as (address, worker, _):
        worker()

        def say(text: str) -> None:
            if text.startswith("2 of"):
                os.environ["PYTHONPATH"] = f"{tmp_path}:{before}"
                worker()

        before = os.environ.get("PYTHONPATH", "")
        try:
            many = {"fluid.bulk_modulus_MPa": [900.0 + n for n in range(300)]}
            frame = sweep("paper_1dof", many, points=40, scheduler=address, say=say).frame
        finally:
            os.environ["PYTHONPATH"] = before
    assert (frame["error"] == "").all()
    logs = "".join(path.read_text() for path in tmp_path.glob("dask_worker-*.log"))
    assert "has armdesign 0.0.9" in logs
