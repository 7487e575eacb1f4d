"""The same inputs give the same numbers, however many threads, processes or computers share them.

To the last bit, but for the frequency of a design before rounding: two threads of BLAS add up the
search's programmes in another order, and its optimum differs in the last digits.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import armdesign as ad
from armdesign.machine import template
from armdesign.sweeps.worker import ONE_THREAD
from tests.sweeps.test_cluster import QUIET, dask

pytestmark = [pytest.mark.slow, *QUIET]
OPTIONS: dict[str, dict[str, Any]] = {
    "map": {},
    "design": {"starts": 1},
    "validate": {},
    "control": {"damping": 0.02},
    "simulate": {},
}
ALL_TASKS = """
import json, sys
import threadpoolctl
import armdesign as ad
from armdesign.sweeps.tasks import TASKS

machine = ad.load(sys.argv[1])
workspace = ad.Workspace.grid(machine, 3)
options = json.loads(sys.argv[2])
numbers = {task: TASKS[task](machine, workspace, **options[task]) for task in options}
threads = {pool["num_threads"] for pool in threadpoolctl.threadpool_info()}
print(json.dumps([numbers, sorted(threads)]))
"""


@pytest.fixture(scope="module")
def two_joints(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("machine") / "arm.toml"
    path.write_text(template.new("arm", links=2), encoding="utf-8")
    return path


def by_threads(machine: Path, count: int) -> Any:
    """Numbers of all tasks in a process whose libraries use so many threads."""
    environment = os.environ | dict.fromkeys(ONE_THREAD, str(count))
    words = [sys.executable, "-c", ALL_TASKS, str(machine), json.dumps(OPTIONS)]
    run = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    numbers, threads = json.loads(run.stdout)
    assert threads[-1] == min(count, os.cpu_count() or 1)
    return numbers


def test_one_and_two_threads_of_the_libraries(two_joints: Path) -> None:
    one, two = by_threads(two_joints, 1), by_threads(two_joints, 2)
    unrounded = [numbers["design"].pop("unrounded_hz") for numbers in (one, two)]
    assert two == one
    assert unrounded[1] == pytest.approx(unrounded[0], rel=1e-10)  # measured: 6e-15


@pytest.mark.parametrize("task", ["design", "validate", "control", "simulate"])
def test_one_and_two_workers_here_and_of_a_cluster(
    task: str, two_joints: Path, tmp_path: Path
) -> None:
    """Of maps: `tests/sweeps/`."""
    moduli = {"fluid.bulk_modulus_MPa": [900.0, 1300.0]}
    options = {"vary": ("areas",)} if task == "design" else OPTIONS[task]

    def frame(**how: Any) -> pd.DataFrame:
        answer = ad.sweep(str(two_joints), moduli, task, options=options, points=3, **how).frame
        assert answer["error"].tolist() == [""] * 2
        return answer.drop(columns="seconds")

    alone = frame(workers=1)
    pd.testing.assert_frame_equal(frame(workers=2), alone, check_exact=True)
    with dask(tmp_path) as (address, worker, _):
        worker(), worker()
        pd.testing.assert_frame_equal(frame(scheduler=address), alone, check_exact=True)
