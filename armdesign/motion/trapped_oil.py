"""Pressures along a slow move: of pistons that move by their valves, of others by trapped oil.

A piston that stands keeps its oil behind closed valves. As the arm moves, gravity changes its
load, and both chambers share the change as springs do, dp_i = a_i dF/(C_i k), k = Σ a_i²/C_i,
until one is empty: then vapour fills it, the other bears the load alone, and the arm is softer
than at rest at the same pose, where the side without load is at return pressure. Leakage, which
would take minutes, is left out.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.poses import Poses
from armdesign.motion.feed_forward import SLOW, steady_motion
from armdesign.simulation.plant import slopes
from armdesign.simulation.plant.plant import Plant

EXACT, LEAST = 1e-6, 100.0  # relative, and [Pa]: errors of the pressures


def pressures_along(plant: Plant, line: Poses, speeds: Array, start: Array) -> Array:
    """Pressures of cap and annulus (n, 2, nc) [Pa] along a line.

    Args:
        plant: of one machine, under its load.
        line: n poses in even steps on a straight line of joint space.
        speeds: of the pistons there (n, nc) [m/s]; all but their sign counts little.
        start: pressures at the first pose (2, nc) [Pa].
    """
    steady = steady_motion(plant, line, speeds)
    moving = np.stack([steady.cap, steady.annulus], axis=1)
    moves = (np.abs(speeds) > SLOW).any(axis=0)
    return np.where(moves, moving, _trapped(plant, line, start))


def _trapped(plant: Plant, line: Poses, start: Array) -> Array:
    """Pressures (n, 2, nc) [Pa] of pistons that stand."""
    from scipy.integrate import solve_ivp

    actuators, system = plant.parameters.actuators[0], plant.parameters.systems[0]
    areas, shares = actuators["areas"].T, np.linspace(0.0, 1.0, len(line))
    loads = np.gradient(line.cylinder_forces, shares, axis=0)

    def rates(share: float, pressures: Array) -> Array:
        numbers = np.zeros((1, len(actuators), slopes.NUMBERS))
        numbers[0, :, slopes.LENGTH] = _at(share, shares, line.lengths)
        numbers[0, :, [slopes.CAP, slopes.ANNULUS]] = pressures.reshape(areas.shape)
        capacities = slopes.actuate(actuators, system, numbers).capacities[0]
        stiffness = (areas**2 / capacities).sum(axis=0)
        rises = areas / capacities / stiffness * _at(share, shares, loads)
        return np.asarray(rises).ravel()

    run = solve_ivp(
        rates, (0.0, 1.0), start.ravel(), method="LSODA", t_eval=shares, rtol=EXACT, atol=LEAST
    )
    return np.asarray(run.y.T.reshape(len(line), *areas.shape))


def _at(share: float, shares: Array, values: Array) -> Array:
    """Values (nc,) at a share of the way."""
    return np.array([np.interp(share, shares, column) for column in values.T])
