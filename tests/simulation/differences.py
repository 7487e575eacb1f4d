"""Central differences of order 8 of the plant: the linear model without any derivative."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armdesign import Machine
from armdesign.arrays import Array
from armdesign.simulation.linear_model import LinearModel
from armdesign.simulation.linearization import without_dry_friction
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled

# Factors of f(x + k h) − f(x − k h), k = 1…4 (Fornberg 1988).
WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
# Of q, q̇, p1, p2, supply [bar], spool, spool speed.
STEPS = (1e-3, 1e-2, 0.05, 0.05, 2e-3, 1e-6, 1e-2)
COMMAND_STEP = 1e-2


def plant_of(machine: Machine, q: Array) -> Plant:
    """The plant that a linear model at a pose (nq,) is of."""
    return Plant(without_dry_friction(settled(machine, q)))


def carrying(plant: Plant, state: Array) -> Plant:
    """The plant whose springs carry what they do at a state in SI (ns,), moving or not."""
    machine, k = plant.machine, plant.nq
    if not machine.springs:
        return plant
    q, velocity = state[None, :k], state[None, k : 2 * k]
    held = plant.rigid_bodies.resistance(q, velocity)[0, len(machine.joints) :]
    springs = zip(machine.springs, held.tolist(), strict=True)
    carried = tuple(replace(spring, preload=preload) for spring, preload in springs)
    return Plant(replace(machine, springs=carried))


def tool_acceleration_jacobians(plant: Plant, state: Array) -> Array:
    """∂a/∂y (3, ns) of the tool's acceleration in SI: a = J q̈ + Σ ∂²P/∂q_j∂q_k q̇_j q̇_k."""
    unit, k, arm, tool = plant.units, plant.nq, plant.machine.arm, plant.machine.tool
    command = state[-2 * plant.nc : -plant.nc]

    def accelerations(states: Array) -> Array:
        rates = plant.derivative(states, np.tile(command, (len(states), 1)))
        q, velocity = states[:, :k], states[:, k : 2 * k]
        at, joints = np.array(tool.at), tuple(range(k))
        point = arm.motion(arm.kinematics(q), tool.link, at, arm.root, joints)
        pushed = np.einsum("nki,nk->ni", point.first, rates[:, k : 2 * k])
        return pushed + np.einsum("njki,nj,nk->ni", point.second, velocity, velocity)

    return jacobian(accelerations, state / unit, plant.spread(STEPS)) / unit


def state_and_command_jacobians(plant: Plant, state: Array, command: Array) -> tuple[Array, Array]:
    """∂ẏ/∂y (ns, ns) and ∂ẏ/∂u (ns, nc) in SI at a state in SI."""
    unit = plant.units
    y = state / unit

    def rates(states: Array) -> Array:
        return plant.derivative(states, np.tile(command, (len(states), 1)))

    a = jacobian(rates, y, plant.spread(STEPS))
    steps = np.full(plant.nc, COMMAND_STEP)
    b = jacobian(lambda u: plant.derivative(np.tile(y, (len(u), 1)), u), command, steps)
    return a * unit[:, None] / unit, b * unit[:, None]


def piston_jacobians(plant: Plant, state: Array) -> Array:
    """∂s/∂y (nc, ns) of the piston positions in SI."""
    unit, y = plant.units, state / plant.units

    def places(states: Array) -> Array:
        return plant.evaluate(states, np.zeros((len(states), plant.nc))).extensions

    return jacobian(places, y, plant.spread(STEPS)) / unit


def jacobian(f: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    """Jacobian ∂f/∂x (outputs, inputs) with a step per input; f takes all shifted x at once."""
    shifts = np.diag(steps)
    points = [x + sign * k * shifts for k in range(1, len(WEIGHTS) + 1) for sign in (1, -1)]
    values = f(np.concatenate(points)).reshape(len(WEIGHTS), 2, len(steps), -1)
    differences = np.tensordot(WEIGHTS, values[:, 0] - values[:, 1], 1)
    return np.asarray((differences / steps[:, None]).T)


def assert_same(plant: Plant, model: LinearModel, tolerance: float = 1e-7) -> None:
    """A, B and rows of C (pistons, tool) equal differences: every entry, in scaled units.

    A row is measured by its largest entry, each state by a size of its own.
    """
    size = plant.spread((1.0, 1.0, 10.0, 10.0, 10.0, 1.0, 10.0)) * plant.units
    command = model.equilibrium[model.state_groups["spools"]]
    a, b = state_and_command_jacobians(plant, model.equilibrium, command)
    c = piston_jacobians(plant, model.equilibrium)
    e = tool_acceleration_jacobians(plant, model.equilibrium)
    for own, theirs, scale in (
        (model.A, a, size),
        (model.select("commands").B, b, np.ones(plant.nc)),
        (model.select(outputs="piston positions").C, c, size),
        (model.select(outputs="tool acceleration").C, e, size),
    ):
        rows = np.abs(theirs * scale).max(axis=1, keepdims=True)
        error = np.abs(own - theirs) * scale / np.where(rows > 0, rows, 1.0)
        row, column = np.unravel_index(error.argmax(), error.shape)
        where = f"{error.max():.2g} at {row}, {column}: {own[row, column]}, {theirs[row, column]}"
        assert error.max() < tolerance, where
