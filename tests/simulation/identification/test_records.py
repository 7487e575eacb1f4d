"""What recordings have to be, and the examples of the documentation."""

from __future__ import annotations

import doctest
import importlib
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.errors import SimulationError

TIME = np.arange(0, 12, 1 / 60)
WAVE = np.sin(2 * np.pi * TIME)


@pytest.mark.parametrize("module", ["ringdown", "modal_fit", "frequency_response"])
def test_examples(module: str) -> None:
    """Every example of a docstring prints what it says."""
    home = importlib.import_module(f"armdesign.simulation.identification.{module}")
    result = doctest.testmod(home)
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize(
    ("time", "wave", "message"),
    [
        (TIME**1.1, WAVE, "not evenly spaced"),
        (TIME[::-1], WAVE, "not evenly spaced"),
        (TIME[:1], WAVE[:1], "time has shape"),
        (TIME, WAVE[:-1], "does not fit 720 instants"),
        (TIME, np.where(TIME > 1, np.nan, WAVE), "no finite number"),
        (TIME, ["a"] * len(TIME), "no finite number"),
    ],
)
def test_faults(time: np.ndarray, wave: np.ndarray, message: str) -> None:
    for identify in (
        lambda: ad.identify_ringdown(time, wave),
        lambda: ad.identify_forced_response(time, wave, wave, (0.5, 1.6)),
        lambda: ad.frequency_response(time, wave, wave, (0.5, 1.6), 2.0),
    ):
        with pytest.raises(SimulationError, match=message):
            identify()


def test_rounded_time_stamps_do_no_harm() -> None:
    """Stamps to 1 ms at 60 Hz are up to 3 % of an interval off; the mean interval counts."""
    decay = np.exp(-0.02 * 2 * np.pi * TIME) * WAVE
    exact, rounded = (ad.identify_ringdown(time, decay) for time in (TIME, TIME.round(3)))
    assert rounded.natural_frequencies == pytest.approx(exact.natural_frequencies, rel=1e-4)


def test_faults_of_responses() -> None:
    lines = np.linspace(0.6, 1.6, 40)
    response = 1 / (1 - lines**2 + 0.1j * lines)
    for arguments, message in (
        ((lines[:5], response[:5]), "5 lines are too few"),
        ((lines, response[:5]), "give one response and deviation per line"),
        ((lines - 0.6, response), "lines without a response"),
        ((lines, response, 1, 0 * lines), "lines without a response"),
    ):
        with pytest.raises(SimulationError, match=message):
            ad.identify_frequency_response(*arguments)


def test_columns_without_numbers_are_named() -> None:
    """Words, values that NumPy masks, and a table whose columns have no names."""
    time = np.arange(0, 5, 0.01)
    pressure = 80 + 3 * np.exp(-0.25 * time) * np.cos(4 * np.pi * time)
    columns: dict[Any, Any] = {"t": time, "boom_cap_bar": pressure}
    words = ["free"] * len(time)
    with pytest.raises(SimulationError, match="recording: event holds no numbers"):
        ad.identify(columns | {"event": words}, [(0, 4)])
    faulty = np.ma.masked_where(np.abs(time - 1.5) < 0.1, pressure)
    with pytest.raises(SimulationError, match=r"boom_cap_bar is blank at 1\.4"):
        ad.identify(columns | {"boom_cap_bar": faulty}, [(0, 4)])
    with pytest.raises(SimulationError, match="holds what is no finite number"):
        ad.identify_ringdown(time, faulty - 80)
    with pytest.raises(SimulationError, match="table: values"):
        ad.Table(time.tolist(), faulty)  # type: ignore[arg-type]
    with pytest.raises(SimulationError, match=r"recording: has no time \(0, 1\)"):
        ad.identify(dict(enumerate(columns.values())))
