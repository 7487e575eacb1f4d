"""Workers of a cluster that hang, lack the package, or have other code than the program."""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.errors import Stopped
from armdesign.sweeps import cluster
from armdesign.sweeps.cluster import PREFIX, _client
from armdesign.sweeps.sweep import sweep
from tests.sweeps.test_cluster import QUIET, dask

pytestmark = [pytest.mark.slow, *QUIET]
TWO = {"fluid.bulk_modulus_MPa": [900.0, 1000.0]}
BARE = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "armdesign":
            raise ModuleNotFoundError("No module named 'armdesign'", name="armdesign")
sys.meta_path.insert(0, Without())
"""
TASK = "K = 1\n\n\ndef task(machine, workspace):\n    return {'x': K}\n"


@contextmanager
def found_first(folder: Path) -> Iterator[None]:
    """Context in which processes begin that look for modules in a folder first."""
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{folder}{os.pathsep}{before}"
    try:
        yield
    finally:
        os.environ["PYTHONPATH"] = before


@pytest.fixture
def without_package(tmp_path: Path) -> Path:
    """A folder that hides the package from processes that look there first."""
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "sitecustomize.py").write_text(BARE)
    return tmp_path / "bare"


def here(address: str, count: int, asked: Callable[[Any], Any] | None = None) -> Any:
    """Answer of a client once there are as many workers."""
    client = _client(address)
    try:
        client.wait_for_workers(count, timeout=30)
        return asked and asked(client)
    finally:
        client.close(timeout=5)


def left(client: Any) -> list[str]:
    """Names of the studies that a scheduler still gives to its workers."""
    names = client.run_on_scheduler(lambda dask_scheduler: [*dask_scheduler.worker_plugins])
    return [name for name in names if name.startswith(PREFIX)]


@pytest.mark.parametrize("stopped", ["before", "at the end"])
def test_an_idle_worker_that_hangs_holds_up_no_sweep(
    tmp_path: Path, stopped: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 5.0)
    with dask(tmp_path) as (address, worker, _):
        worker()
        here(address, 1)
        hung = worker()
        here(address, 2)

        def say(text: str) -> None:
            if text == "1 of 1 cases":
                os.kill(hung.pid, signal.SIGSTOP)

        if stopped == "before":
            os.kill(hung.pid, signal.SIGSTOP)
            threading.Timer(8.0, hung.kill).start()  # a case that it was given goes elsewhere
        start = time.monotonic()
        frame = sweep("paper_1dof", points=3, scheduler=address, say=say).frame
        assert time.monotonic() - start < 25
    assert frame["error"].tolist() == [""]


def test_an_interrupted_sweep_leaves_nothing_on_the_scheduler(tmp_path: Path) -> None:
    def say(text: str) -> None:
        if text == "1 of 2 cases":
            raise KeyboardInterrupt

    with dask(tmp_path) as (address, worker, _):
        worker()
        with pytest.raises(Stopped):
            sweep("paper_1dof", TWO, points=3, scheduler=address, say=say)
        assert here(address, 1, left) == []


def test_a_worker_without_the_package_says_so_and_a_scheduler_needs_none(
    tmp_path: Path, without_package: Path
) -> None:
    """A bare worker that comes late passes its cases on."""
    with found_first(without_package), dask(tmp_path) as (address, worker, _):
        late = worker()
        here(address, 1)
        with pytest.raises(ad.ArmDesignError, match=r"^worker tcp://.*: cannot load armdesign"):
            sweep("paper_1dof", TWO, points=3, scheduler=address)
        late.kill()
        os.environ["PYTHONPATH"] = os.environ["PYTHONPATH"].partition(os.pathsep)[2]
        worker()
        here(address, 1)

        def say(text: str) -> None:
            if text.startswith("1 of"):
                os.environ["PYTHONPATH"] = f"{without_package}{os.pathsep}{before}"
                worker()
                here(address, 2)

        before = os.environ["PYTHONPATH"]
        many = {"fluid.bulk_modulus_MPa": [900.0 + n for n in range(60)]}
        frame = sweep("paper_1dof", many, points=20, scheduler=address, say=say).frame
        assert (frame["error"] == "").all()
        assert len(here(address, 2, lambda client: client.nthreads())) == 2


def test_a_worker_that_loaded_another_state_of_a_file_does_not_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    file, how = tmp_path / "cluster_task.py", {"points": 3, "journal": tmp_path / "j.sqlite"}

    def task(text: str) -> Any:
        file.write_text(text)
        sys.modules.pop("cluster_task", None)
        importlib.invalidate_caches()
        return importlib.import_module("cluster_task").task

    with found_first(tmp_path), dask(tmp_path) as (address, worker, _):
        worker()
        for _ in range(2):
            first = sweep("paper_1dof", TWO, task(TASK), scheduler=address, **how)
            assert first.frame["x"].tolist() == [1, 1]
        edited = task(TASK.replace("1", "2"))
        with pytest.raises(
            ad.ArmDesignError, match=r"^worker tcp://.*: has another K in cluster_task"
        ):
            sweep("paper_1dof", TWO, edited, scheduler=address, **how)
        file.unlink()
        nowhere = ad.sweep("paper_1dof", TWO, edited, **how)
        assert (nowhere.kept, nowhere.frame["x"].tolist()) == (0, [2, 2])


def test_a_cluster_without_workers_is_said(tmp_path: Path) -> None:
    messages = list[str]()
    with dask(tmp_path) as (address, worker, _):
        workers = list[Any]()

        def say(text: str) -> None:
            messages.append(text)
            if text.startswith("waits"):
                workers.append(worker())
            elif text.startswith("1 of"):
                time.sleep(1.0)  # [s] in which the other case is answered, and then lost
                workers[0].kill()
                workers[0].wait()

        sweep("paper_1dof", TWO, points=[200], scheduler=address, say=say)
    waits, come = f"waits for a worker; start one with: dask worker {address}", "a worker has come"
    said = [text for text in messages if not text.startswith("a worker died")]
    assert said == [waits, come, "1 of 2 cases", waits, come, "2 of 2 cases"]


def kills(machine: ad.Machine, _: ad.Workspace) -> dict[str, float]:
    """A task that ends its worker at one load case, while others wait behind it."""
    mass = machine.payloads[-1].mass
    time.sleep(0.2)
    if mass == 100:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"mass": mass}


def test_a_case_is_not_blamed_for_what_another_did_to_its_worker(tmp_path: Path) -> None:
    """The scheduler counts every case that a dead worker had, those that waited there too."""
    masses = [50.0, 100.0, 150.0, 200.0, 250.0]
    with dask(tmp_path) as (address, worker, _):
        worker("--nanny")  # which begins another worker in place of a dead one
        here(address, 1)
        changes = {"payload.load.mass_kg": masses}
        frame = sweep("paper_1dof", changes, kills, points=2, scheduler=address).frame
    blamed = frame["error"].str.startswith("its worker died")
    assert frame["payload.load.mass_kg"][blamed].tolist() == [100.0]
    assert frame["mass"][~blamed].tolist() == [50.0, 150.0, 200.0, 250.0]
