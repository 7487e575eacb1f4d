"""What notebooks show: the numbers of the sheets, escaped, with a picture, in little room."""

from __future__ import annotations

import base64
import re
from functools import cache
from typing import Any

import numpy as np
import pytest

import armdesign as ad

MOST = 300_000  # letters of what a notebook keeps
PNG = b"\x89PNG\r\n"


@cache
def machine() -> ad.Machine:
    return ad.load("paper_1dof").replace({"title": "<script>alert(1)</script>"})


@cache
def workspace() -> ad.Workspace:
    return ad.Workspace.grid(machine(), 5)


@cache
def simulation() -> ad.Simulation:
    command = {"lift": ad.Step(size=0.2, end=0.2)}
    return ad.simulate(machine(), [-0.3], command=command, duration=0.4)


RESULTS = {
    "machine": machine,
    "map": lambda: ad.frequency_map(machine(), workspace()),
    "design": lambda: ad.size_cylinders(machine(), workspace()),
    "validation": lambda: ad.validate(machine(), q=[-0.3]),
    "simulation": simulation,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RESULTS)
def test_results_are_shown_escaped_with_a_picture(name: str) -> None:
    shown = RESULTS[name]()._repr_html_()  # type: ignore[operator]
    assert len(shown) < MOST
    assert "<script" not in shown
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', shown)
    assert base64.b64decode(picture).startswith(PNG)


@pytest.mark.slow
def test_numbers_are_those_of_the_results() -> None:
    frequencies = ad.frequency_map(machine(), workspace())
    assert f"{frequencies.worst.frequency:.3f} Hz" in frequencies._repr_html_()
    validation = ad.validate(machine(), q=[-0.3])
    for run in validation.runs:
        assert f"{run.identified_frequency:.4f}" in validation._repr_html_()


def test_a_simulation_is_drawn() -> None:
    run = simulation()
    joints, spools, pressures, path = run.plot().axes
    lines: dict[str, Any] = {line.get_label(): line for line in pressures.lines}
    np.testing.assert_allclose(lines["lift's cap"].get_ydata(), run.pressures[:, 0, 0] / 1e5)
    np.testing.assert_allclose(lines["lift's annulus"].get_ydata(), run.pressures[:, 0, 1] / 1e5)
    np.testing.assert_allclose(spools.lines[0].get_ydata(), 100 * run.spool[:, 0])
    moved = np.degrees(run.q[:, 0] - run.q[0, 0])
    np.testing.assert_allclose(joints.lines[0].get_ydata(), moved)
    assert joints.lines[0].get_label() == "boom [deg]"
    reach = np.hypot(run.tool[:, 0], run.tool[:, 1])
    np.testing.assert_allclose(path.lines[0].get_xdata(), reach, atol=1e-9)
    np.testing.assert_allclose(path.lines[0].get_ydata(), run.tool[:, 2])
    for ax in (spools, pressures, path):
        assert re.search(r"\[(%|bar|m)\]", ax.get_ylabel())


def test_a_notebook_shows_axes_and_figures() -> None:
    """Pictures without a display have no other way to be shown."""
    drawn = machine().plot()
    for shown in (drawn, drawn.figure):
        assert shown._repr_png_().startswith(PNG)
