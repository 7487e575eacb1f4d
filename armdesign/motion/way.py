"""Modes along a move: natural frequencies on its legs, with the oil that is then in the chambers.

The plant is linearised along the legs under the pressures of a slow move (``trapped_oil``). Where
a chamber runs empty the arm gets softer at once, but a command whose pace jumped would itself
excite: so the frequency on a leg is a parabola, exact at both ends, least squares in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.machine import Machine
from armdesign.motion.trajectory import Leg
from armdesign.motion.trapped_oil import pressures_along
from armdesign.simulation.linearization import linearize, models_under
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.hydraulics import VAPOUR_PRESSURE
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled

POINTS = 21  # of each leg


class WayModes(NamedTuple):
    """Modes along the legs of a move, ascending."""

    machine: Machine  # under its load
    legs: Sequence[Leg]
    frequencies: Array  # (legs, POINTS, k) [Hz]
    damping: Array  # ratios at the end (k,)
    empty: tuple[str, ...]  # chambers that vapour fills at the end

    @property
    def end(self) -> Array:
        """Natural frequencies at the end (k,) [Hz]."""
        return np.asarray(self.frequencies[-1, -1])

    def paces(self, modes: int) -> Array:
        """Frequencies of some lowest modes over those at the end (legs, modes, POINTS)."""
        return np.asarray(np.swapaxes(self.frequencies / self.end, 1, 2)[:, :modes])


def way_modes(machine: Machine, legs: Sequence[Leg]) -> WayModes:
    """Modes along the legs of a move; dry friction is left out.

    Raises:
        PoseError: a pose on the way cannot be taken.
        SimulationError: trapped oil does not hold the end.
    """
    linearize(machine, legs[-1].end)  # refuses an end that is not stable
    shares = np.linspace(0.0, 1.0, POINTS)[:, None]
    plant = Plant(settled(machine, legs[0].start))
    pressures = plant.pressures(find_equilibrium(plant, legs[0].start).state[None])
    on_legs, damping = [], np.zeros(0)
    for leg in legs:
        along = leg.end - leg.start
        line = machine.at(leg.start + shares * along)
        speeds = line.moment_arms[..., : len(along)] @ along / leg.law.duration
        pressures = pressures_along(plant, line, speeds, pressures[-1])
        models = models_under(machine, line.q[:, : len(along)], pressures)
        each = [models[k].natural_frequencies for k in range(POINTS)]
        count = min(len(one) for one in each)
        on_legs.append(_smooth(shares, np.array([one[:count] for one in each])))
        damping = models[-1].damping_ratios
    count = min(len(damping), *(one.shape[1] for one in on_legs))
    frequencies = np.array([one[:, :count] for one in on_legs])
    empty = tuple(
        machine.actuators[i].chamber(side)
        for side, i in np.argwhere(pressures[-1] <= VAPOUR_PRESSURE)
    )
    return WayModes(machine, legs, frequencies, damping[:count], empty)


def _smooth(shares: Array, values: Array) -> Array:
    """Parabolas through the first and last of values (n, k), nearest to the others."""
    line = values[0] + shares * (values[-1] - values[0])
    bulge = shares * (1 - shares)
    return np.asarray(line + bulge * (bulge * (values - line)).sum(axis=0) / (bulge**2).sum())
