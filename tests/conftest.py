"""Machines shared by all tests, read once; Hypothesis without chance."""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # a core for each process, before numpy starts

import gc
import math
import signal
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.database import DirectoryBasedExampleDatabase

import armdesign as ad
from armdesign.machine.loading import shipped
from tests import machines
from tests.commands import Refused, assert_one_line, main

settings.register_profile(
    "house",
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(  # new examples every time; what fails is kept and tried first
    "ten_minutes",
    settings.get_profile("house"),
    derandomize=False,
    database=DirectoryBasedExampleDatabase(".hypothesis/examples"),
    print_blob=True,
    max_examples=2000,
)
settings.load_profile("house")
gc.set_threshold(50_000)  # by default the search for garbage takes a sixth of the collection
# a background job of a shell has it ignored
signal.signal(signal.SIGINT, signal.default_int_handler)

BEGUN = time.monotonic()
COMPILING = ("tests/simulation/test_validation.py", "tests/control/test_bandwidth_map.py")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--minutes", type=float, default=math.inf, help="begin no test after them")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """On a machine several times slower than others, a run ends with the count of what is left."""
    minutes = item.config.getoption("--minutes")
    if time.monotonic() - BEGUN > 60 * minutes:
        pytest.skip(f"not begun: {minutes:g} minutes are over")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What compiles most comes first: one process compiles, the other reads it when it needs it.

    A fresh clone has nothing compiled, which takes half a minute.
    """
    items.sort(key=lambda item: not item.nodeid.startswith(COMPILING))


SHIPPED = tuple(shipped())
EVERY = (
    *SHIPPED,
    "heavy_bars",
    "slewing",
    *machines.ODD,
    *(f"random_{seed}" for seed in (3, 8, 18, 25, 29)),
)


@pytest.fixture(params=EVERY)
def machine(request: pytest.FixtureRequest) -> ad.Machine:
    """Each machine in turn under its last load case, which is the loaded one."""
    named = machines.named(request.param)
    return named.with_payload(named.payloads[-1].name)


@pytest.fixture(scope="session")
def excavator() -> ad.Machine:
    """The 20 t excavator under its load, with rigid structure."""
    return machines.rigid("excavator_20t").with_payload("full")


@pytest.fixture(scope="session")
def rigid_excavator() -> ad.Machine:
    """The 20 t excavator as it would be with rigid structure, and with nothing uncertain."""
    return machines.rigid("excavator_20t")


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Refused:
    """Asserts that a command, run in an empty folder, says why it cannot in one line and leaves
    nothing behind.
    """

    def assert_refused(words: Sequence[str], message: str) -> None:
        monkeypatch.chdir(tmp_path)
        assert main(words, monkeypatch) == 2
        out, err = capfd.readouterr()
        assert out == ""
        assert_one_line(err, message)
        assert not list(tmp_path.iterdir())

    return assert_refused
