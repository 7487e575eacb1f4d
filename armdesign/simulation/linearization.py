"""The plant linearised about a pose: ẋ = A x + B u, y = C x + D u, its poles and damping ratios.

A and B are central differences of order 8 of the nonlinear right-hand side itself, so nothing here
knows a formula of stiffness. The operating point is equilibrium with all valves closed, or open
just enough to make up for leakage. Closed, a lapped valve passes no flow whatever the pressures,
so it adds no damping: what damps is leakage and viscous friction. Dry friction, which has no
derivative at standstill, is left out. The flow that a spool opens is larger to one side than to
the other; A holds the mean of both, and 0 within an overlap.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import SimulationError
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine
from armdesign.simulation.plant.equilibrium import find_equilibrium, refuse_overcome
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled
from armdesign.units import bar

# Central difference of order 8: factors of f(x + k h) − f(x − k h), k = 1…4 (Fornberg 1988).
WEIGHTS = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
# Of q, q̇, p1, p2, supply [bar], spool, spool speed.
STEPS = (1e-4, 1e-3, 0.05, 0.05, 0.05, 1e-6, 1e-2)
COMMAND_STEP = 1e-2
ROUNDING = 1e-10  # of a damping ratio
# Of the fastest pole: slower ones are the trapped oil's zeros with their rounding.
NEGLIGIBLE = 1e-5
F = TypeVar("F", Cylinder, Motor)


@dataclass(frozen=True, eq=False)
class LinearModel(ReadOnly):
    """State space about the equilibrium at one pose; arrays are read-only, SI.

    Attributes:
        A: (n, n) over the states.
        B: (n, nc) by the spool commands −1…1.
        C: (nc, n), to the piston positions [m].
        D: (nc, nc), zero.
        states: names of the states; the last 2 nc are of the spools.
        inputs: names of the cylinders.
        equilibrium: the state there (n,): q, q̇, p1, p2 [Pa], spool, spool speed.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    equilibrium: Array

    @cached_property
    def poles(self) -> Array:
        """All eigenvalues of A (n,) [rad/s], slow ones first."""
        return _by_size(np.linalg.eigvals(self.A))

    @cached_property
    def modes(self) -> Array:
        """Oscillatory poles of arm and oil above the real axis [rad/s], slow ones first.

        The spools' own are left out: spools drive the other states and feel nothing of them, so
        the poles are the eigenvalues of these states' block of A. At most one pair per joint
        and spring: slower pairs are creep under leakage.
        """
        size = len(self.A) - 2 * len(self.inputs)
        joints = (size - 2 * len(self.inputs)) // 2
        poles = _by_size(np.linalg.eigvals(self.A[:size, :size]))
        oscillating = poles[(poles.imag > 0) & (np.abs(poles) > NEGLIGIBLE * np.abs(poles).max())]
        return oscillating[-joints:]

    @property
    def natural_frequencies(self) -> Array:
        """|λ|/2π of ``modes`` [Hz]."""
        return np.abs(self.modes) / (2 * math.pi)

    @property
    def damping_ratios(self) -> Array:
        """ζ = −Re λ/|λ| of ``modes``."""
        ratios = -self.modes.real / np.abs(self.modes)
        return np.asarray(np.where(np.abs(ratios) < ROUNDING, 0.0, ratios))

    def to_control(self) -> Any:
        """The model as a ``StateSpace`` of python-control, with names of states, inputs, outputs.

        Pressures are in bar there, all else SI: numbers of one order, which need no balancing by
        slycot.

        Raises:
            SimulationError: python-control is not installed.
        """
        try:
            import control
        except ImportError:
            fault, remedy = "needs the package python-control", "pip install 'armdesign[control]'"
            raise SimulationError("to_control", fault, remedy) from None
        unit = np.array([bar if name.endswith("pressure") else 1.0 for name in self.states])
        return control.ss(
            self.A * unit / unit[:, None],
            self.B / unit[:, None],
            self.C * unit,
            self.D,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=[f"{name} position" for name in self.inputs],
        )


def linearize(machine: Machine, q: ArrayLike, *, preloaded: bool | None = None) -> LinearModel:
    """State space of the machine under its payload about its equilibrium at a pose q (nq,).

    Args:
        machine: the machine.
        q: joint positions [rad, m].
        preloaded: chamber pressures at equilibrium, see ``find_equilibrium``.

    Raises:
        PoseError: the pose cannot be taken.
        SimulationError: a cylinder has no valve, or a relief cannot hold its load: there is no
            equilibrium.
    """
    plant = Plant(without_dry_friction(settled(machine, q)))
    refuse_overcome(plant, q)
    equilibrium = find_equilibrium(plant, q, preloaded).state
    spool, steps = plant.split(equilibrium)[4], plant.spread(STEPS)
    commands = np.full(plant.nc, COMMAND_STEP)
    a = _jacobian(lambda y: plant.derivative(y, _rows(spool, y)), equilibrium, steps)
    b = _jacobian(lambda u: plant.derivative(_rows(equilibrium, u), u), spool, commands)
    c = _jacobian(lambda y: plant.evaluate(y, _rows(spool, y)).extensions, equilibrium, steps)
    unit = plant.units
    return LinearModel(
        A=a * unit[:, None] / unit,
        B=b * unit[:, None],
        C=c / unit,
        D=np.zeros((plant.nc, plant.nc)),
        states=plant.state_names,
        inputs=tuple(actuator.name for actuator in machine.actuators),
        equilibrium=equilibrium * unit,
    )


def without_dry_friction(machine: Machine) -> Machine:
    """The machine with viscous friction alone: dry friction has no derivative at rest."""

    def smooth(actuator: F) -> F:
        return replace(actuator, friction=replace(actuator.friction, coulomb=0.0, static=0.0))

    cylinders, motors = map(smooth, machine.cylinders), map(smooth, machine.motors)
    return replace(machine, cylinders=tuple(cylinders), motors=tuple(motors))


def _rows(values: Array, like: Array) -> Array:
    return np.tile(values, (len(like), 1))


def _jacobian(f: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    """Jacobian ∂f/∂x (outputs, inputs) with a step per input; f takes all shifted x at once."""
    shifts = np.diag(steps)
    points = [x + sign * k * shifts for k in range(1, len(WEIGHTS) + 1) for sign in (1, -1)]
    values = f(np.concatenate(points)).reshape(len(WEIGHTS), 2, len(steps), -1)
    differences = np.tensordot(WEIGHTS, values[:, 0] - values[:, 1], 1)
    return np.asarray((differences / steps[:, None]).T)


def _by_size(poles: Array) -> Array:
    return np.asarray(poles[np.argsort(np.abs(poles), kind="stable")])
