"""Figures of loops between the frequencies of a grid: against a grid a dozen times as fine."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest

import armdesign as ad
from armdesign.control.bandwidth_map import SCHEMES
from armdesign.control.controller import Controller
from armdesign.control.loop_plant import loop_plant
from armdesign.control.loop_sight import Sight
from armdesign.control.loops import Loops
from armdesign.control.map_parts import ControlOptions
from armdesign.control.refined_loops import refined
from armdesign.control.stability import stability
from armdesign.control.tuning import Task
from tests.control.machines import worst_plant

MARGIN = ControlOptions().aim.margin
DENSE = (60, 1500, 81)


def gains_of(bandwidths: ad.BandwidthMap, scheme: str) -> Controller:
    """The controllers of all rows of a map."""
    machine, gains = bandwidths.machine, bandwidths.gains
    position = [f"{scheme}_{joint}_gain_per_s" for joint in machine.joints]
    pressure = [f"{scheme}_{one.name}_pressure_gain_m_per_s_bar" for one in machine.actuators]
    return Controller(
        position=gains[position].to_numpy(),
        pressure=gains[pressure].to_numpy(),
        corner=gains["corner_rad_per_s"].to_numpy(),
    )


@pytest.mark.parametrize(
    ("name", "points"),
    [
        ("paper_1dof", 30),
        ("mini_excavator_2t", 3),
        pytest.param("excavator_20t", 4, marks=pytest.mark.slow),
    ],
)
def test_no_figure_is_better_than_on_a_dense_grid(name: str, points: int) -> None:
    """Bandwidths were up to twice, where a response dips below −3 dB, margins 12 % too large.

    And the margin that is asked for is kept; 2 % of it was missing.
    """
    machine = ad.load(name)
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, points), damping=0.02)
    frame, loaded = bandwidths.frame, machine.with_payload(machine.payloads[-1].name)
    rows = np.flatnonzero(frame["works"] & (frame["payload"] == loaded.payload.name))
    dense = Loops.of(loop_plant(loaded, loaded.at(bandwidths.q[rows]), 0.02), DENSE)
    for scheme in SCHEMES:
        figures, stated = dense.figures(gains_of(bandwidths, scheme)[rows]), frame.iloc[rows]
        widths = figures.narrowest / (2 * math.pi)
        assert (stated[f"{scheme}_hz"] <= 1.002 * widths).all()
        commands = figures.command_bandwidth.min(axis=1) / (2 * math.pi)
        assert (stated[f"{scheme}_command_hz"] <= 1.002 * commands).all()
        assert (stated[f"{scheme}_margin"] <= 1.002 * figures.margin).all()
        assert (stated[f"{scheme}_peak"] >= figures.peak / 1.002).all()
        assert (figures.margin >= 0.999 * MARGIN).all()


def test_loops_on_all_grids_are_compiled_once() -> None:
    """What looks at them takes seconds to compile for each layout of its arrays."""
    seen = set()
    for delay in (0.0, 0.02):
        plant = worst_plant(0.02, delay)
        task = Task(plant, Loops.of(plant), ControlOptions().aim)
        controller = task.common(np.full(1, 0.1), np.zeros(1))
        grid = refined(plant, task.fine, controller, stability(plant, controller).ringing)
        for loops in (task.loops, task.fine, task.fine[np.array([0])], grid.joined):
            seen.add(str(numba.typeof(Sight.of(loops, controller, 1.0, 1.0))))
    assert len(seen) == 1


def test_a_valve_far_slower_than_all_modes() -> None:
    """The plant is then an integrator behind the valve: gains, margins and bandwidths are of the
    valve alone, and hold on a grid that begins a thousand times below it.
    """
    valve_hz = 0.02
    machine = ad.load("paper_1dof").replace({"cylinder.lift.valve.natural_frequency_hz": valve_hz})
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, 3), damping=0.9)
    plant = loop_plant(machine, machine.at(bandwidths.q), 0.9)
    s = 1j * np.geomspace(1e-3, 1e3, 20_000)  # over the valve's
    valve = 1 / (1 + 1.6 * s + s**2)  # its damping ratio is 0.8
    wide = Loops.at(plant, np.tile(2 * math.pi * valve_hz * s.imag, (len(plant), 1)))
    for scheme in ("proportional", "own"):
        controller = gains_of(bandwidths, scheme)
        stated, figures = bandwidths.frame, wide.figures(controller)
        gain = controller.position[:, :1] / (2 * math.pi * valve_hz)
        T = gain * valve / (s + gain * valve)
        margin = 1 / np.abs(T - 0.5).max(axis=1)
        assert stated[f"{scheme}_margin"].to_numpy() == pytest.approx(margin, rel=0.01)
        assert figures.margin == pytest.approx(margin, rel=0.01)
        width = valve_hz * s.imag[(np.abs(T) < math.sqrt(0.5)).argmax(axis=1)]
        assert stated[f"{scheme}_hz"].to_numpy() == pytest.approx(width, rel=0.01)
        assert (figures.margin >= 0.999 * MARGIN).all()
