"""Modes along a move: the oil that a slow move leaves, and what it makes of frequencies."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.motion.time_law import TimeLaw
from armdesign.motion.trajectory import Leg
from armdesign.motion.trapped_oil import pressures_along
from armdesign.motion.way import way_modes
from armdesign.report.moves import move_sheets
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.units import bar

# a boom-up with the stick far out: its load turns from pushing to pulling
EMPTIED = np.radians([[-40.0, -60.0, -60.0], [0.0, -60.0, -60.0]])
FULL = np.radians([[-20.0, -90.0, -90.0], [20.0, -90.0, -90.0]])


def standing(machine: ad.Machine, line: ad.Poses, start: np.ndarray) -> np.ndarray:
    """Pressures while the boom alone moves, up or down as the line goes."""
    up = np.sign(line.lengths[-1, 0] - line.lengths[0, 0])
    speeds = np.tile([0.1 * up, 0.0, 0.0], (len(line), 1))
    return pressures_along(Plant(machine), line, speeds, start)


def line_of(machine: ad.Machine, ends: np.ndarray) -> ad.Poses:
    return machine.at(ends[0] + np.linspace(0, 1, 21)[:, None] * (ends[1] - ends[0]))


def at_rest(machine: ad.Machine, q: np.ndarray) -> np.ndarray:
    plant = Plant(machine)
    return plant.pressures(find_equilibrium(plant, q).state[None])[0]


@pytest.mark.parametrize("ends", [EMPTIED, FULL])
def test_trapped_oil_holds_the_load_and_stays(ends: np.ndarray) -> None:
    """Static balance of every standing piston; there and back again nothing has changed."""
    machine = ad.load("excavator_20t").with_payload("full")
    line, start = line_of(machine, ends), at_rest(machine, ends[0])
    along = standing(machine, line, start)
    bore, annulus = (
        np.array([getattr(cylinder, f"{side}_area") for cylinder in machine.cylinders])
        for side in ("bore", "annulus")
    )
    force = (bore * along[:, 0] - annulus * along[:, 1])[:, 1:]
    np.testing.assert_allclose(force, line.cylinder_forces[:, 1:], atol=100.0)
    back = standing(machine, line[::-1], along[-1])[-1]
    np.testing.assert_allclose(back[:, 1:], start[:, 1:], atol=0.5 * bar)


def test_both_chambers_yield_alike() -> None:
    """Without vapour: Δp1 C1/A1 = −Δp2 C2/A2, C = V/β, the oil of one piston displacement."""
    machine = ad.load("excavator_20t").with_payload("full")
    line, start = line_of(machine, FULL), at_rest(machine, FULL[0])
    rise = (standing(machine, line, start)[-1] - start)[:, 1]
    stick = machine.cylinders[1]
    extension = line.lengths[0, 1] - stick.closed_length
    volumes = (
        stick.cap_dead_volume + stick.bore_area * extension,
        stick.annulus_dead_volume + stick.annulus_area * (stick.stroke - extension),
    )
    moved = rise * volumes / np.array([stick.bore_area, stick.annulus_area])
    assert abs(rise).max() > 1 * bar
    assert moved[0] == pytest.approx(-moved[1], rel=0.01)


def legs(ends: np.ndarray) -> list[Leg]:
    law = TimeLaw(np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 0.0]))
    return [Leg(ends[0], ends[1], law, np.zeros(2))]


def test_with_full_chambers_it_is_the_mode_at_rest() -> None:
    """On the way within 1 %, as the parabola goes, with oil that is as stiff at any pressure."""
    machine = ad.load("excavator_20t").with_payload("full")
    way, rest = way_modes(machine, legs(FULL)), ad.linearize(machine, FULL[1])
    np.testing.assert_allclose(way.end, rest.natural_frequencies, rtol=1e-3)
    np.testing.assert_allclose(way.damping, rest.damping_ratios, rtol=0.02)
    exact = ad.natural_modes(line_of(machine, FULL)).frequencies[:, 0]
    np.testing.assert_allclose(way.frequencies[0, :, 0], exact, rtol=0.01)
    assert way.empty == ()
    np.testing.assert_allclose(way.paces(2)[0, :, -1], 1.0)


@pytest.mark.slow
def test_an_empty_chamber_makes_the_arm_softer_as_in_the_nonlinear_run() -> None:
    """The lowest mode after the stop, by the spectrum of what rings without a shaper."""
    machine = ad.load("excavator_20t")
    move = ad.plan_move(machine, *EMPTIED, payload="full", spread=0.0)
    assert move.empty == ("stick's cap",)
    rest = ad.linearize(move.machine, EMPTIED[1]).natural_frequencies[0]
    frequency, size = move.unshaped.spectrum
    assert move.frequencies[0] < 0.9 * rest
    assert frequency[np.argmax(size)] == pytest.approx(move.frequencies[0], rel=0.05)
    pressures = move.shaped.simulation.pressures[-1] / bar
    assert pressures.ravel()[2:].min() < -0.7
    assert any("stick's cap is empty" in str(sheet) for sheet in move_sheets(move))
