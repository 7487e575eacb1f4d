"""Processes that work for a command leave Ctrl-C to it from their first moment and end with it."""

from __future__ import annotations

import ast
import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import armdesign as ad

INTERRUPTED = """
import os, signal, sys
if any("popen_loky" in word for word in sys.orig_argv):
    os.kill(os.getpid(), signal.SIGINT)
    open("interrupted", "a").close()
"""
CASES = """
import armdesign as ad
sets = [{"damping": 0.1}, {"damping": 0.2}]
print(ad.sweep("paper_1dof", task="control", options=sets, points=2, workers=2).failures)
"""
TASKS = """
from functools import partial
from armdesign.processes import in_processes
print([*in_processes([partial(abs, -k) for k in range(3)], 2, ordered=True)])
"""
KILLED = """
import os, signal, time
from functools import partial
from armdesign.processes import in_processes
results = in_processes([partial(time.sleep, seconds) for seconds in (0, 90, 90)], 2)
next(results)
os.kill(os.getpid(), signal.SIGKILL)
"""
IN_NO_FOLDER = """
import os
os.mkdir("gone")
os.chdir("gone")
os.rmdir("../gone")
import armdesign as ad
try:
{code}
except ad.ArmDesignError as error:
    print(error)
"""
ALONE = """
import os, sys
from armdesign.processes import in_processes
for count, workers in ((3, 1), (1, 2)):
    assert [*in_processes([os.getpid] * count, workers)] == count * [os.getpid()]
print("joblib" in sys.modules, "multiprocessing" in sys.modules)
"""

IN_A_POOL = """
import multiprocessing, sys
import armdesign as ad
from armdesign.processes import in_processes

def sums(machine, workspace):
    inner = ad.sweep(machine, {{"fluid.bulk_modulus_MPa": [900, 1000]}}, points=3, workers=2)
    sums = {{"sum": float(inner.frame["worst_hz"].sum())}}
    how = {{"values": [1.0, 1.05], "vary": ["areas"], "starts": 1, "workers": 2}}
    front = ad.pareto(machine, ad.Workspace.grid(machine, 2), **how).frame["frequency_hz"]
    return sums | {{"best": float(front.max())}}

def work(_):
    frame = ad.sweep("paper_1dof", task=sums, points=3, journal="j.sqlite").frame
    answer = frame[["sum", "best"]].to_numpy(float)[0].tolist()
    return answer, frame["error"].tolist(), [*in_processes([int, int], 2)]

if __name__ == "__main__":
    with multiprocessing.get_context("{kind}").Pool(1) as pool:
        print(pool.map(work, [0])[0])
"""


def test_one_worker_begins_no_process() -> None:
    """Two that clean up after workers began for it: a fraction of a second of every design."""
    done = subprocess.run(
        [sys.executable, "-c", ALONE], capture_output=True, text=True, check=True
    )
    assert done.stdout == "False False\n"


@pytest.mark.slow
@pytest.mark.parametrize(("code", "said"), [(CASES, "{}\n"), (TASKS, "[0, 1, 2]\n")])
def test_ctrl_c_while_a_worker_is_loaded(code: str, said: str, tmp_path: Path) -> None:
    """Python itself ended in a traceback out of its own imports, and NumPy's."""
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED)
    paths = f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (tmp_path / "interrupted").exists()
    assert (done.returncode, done.stdout, done.stderr) == (0, said, "")


@pytest.mark.skipif(
    os.name == "nt", reason="a child of Windows does not know that its parent ended"
)
def test_processes_end_with_a_killed_one_that_began_them() -> None:
    """They held its output open for minutes, so that ``… | tee log`` went on."""
    done = subprocess.run(
        [sys.executable, "-c", KILLED], capture_output=True, timeout=60, check=False
    )
    assert done.returncode == -signal.SIGKILL


@pytest.mark.skipif(os.name == "nt", reason="a folder that is in use cannot go")
@pytest.mark.parametrize("code", [CASES, TASKS])
def test_processes_that_cannot_begin_are_said_in_words(code: str, tmp_path: Path) -> None:
    """None begin in a folder that is gone."""
    indented = "".join(f"    {line}\n" for line in code.splitlines())
    done = subprocess.run(
        [sys.executable, "-c", IN_NO_FOLDER.format(code=indented)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    said = "worker processes: cannot begin (No such file or directory); take one worker, or begin"
    assert done.stdout.startswith(said)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "kind", [pytest.param("spawn", marks=pytest.mark.slow), multiprocessing.get_start_method()]
)
def test_a_worker_of_a_pool_begins_no_process(kind: str, tmp_path: Path) -> None:
    """Python does not let it: cases ended in an AssertionError, in the journal for good."""
    (tmp_path / "run.py").write_text(IN_A_POOL.format(kind=kind))
    done = subprocess.run(
        [sys.executable, "run.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    (total, best), errors, tasks = ast.literal_eval(done.stdout)
    machine = ad.load("paper_1dof")
    changed = [machine.replace({"fluid.bulk_modulus_MPa": modulus}) for modulus in (900, 1000)]
    maps = [ad.frequency_map(one, ad.Workspace.grid(one, 3)) for one in changed]
    assert total == sum(one.worst.frequency for one in maps)
    front = ad.pareto(
        machine, ad.Workspace.grid(machine, 2), values=[1.05], vary=["areas"], starts=1
    )
    assert best == front.frame["frequency_hz"][0]
    assert (errors, tasks) == ([""], [0, 0])
