"""Closed loops in the nonlinear plant: does a mode decay as the linear loops say, or grow?

The plant starts at rest but for a small swing in one mode λ of the linear closed loop, with right
eigenvector v, left w and w·v = 1. The modal coordinate a = w·(x − x₀) of the nonlinear run then
follows e^{λt} as far as the linear model holds, which gives frequency and damping. What spools of
uneven sides make of λ is in ``uneven_spools``; while the swing lasts, position loops answer the
mean speed of the pistons, so that λ changes on the way: frequency and damping of the predicted
swing are found as those of the nonlinear one, so that the same times weigh alike. Dry friction,
which has no derivative at standstill, is left out, as in the linear model, and so are leaks of
seals in good order, which damp by less than 10⁻³ but let the arm creep past so small a swing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from armdesign.arrays import Array, ReadOnly
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.loop_plant import LoopPlant, loop_plant
from armdesign.control.stated_damping import controllable
from armdesign.control.uneven_spools import lasts, passed
from armdesign.errors import SimulationError
from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine
from armdesign.simulation.excitation import SymmetricValve
from armdesign.simulation.integrator import Breaks, GaveUpError, Pace, Span, integrate
from armdesign.simulation.linearization import without_dry_friction
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from armdesign.simulation.plant.springs import settled

SWING = 1e-3  # [bar] of the load pressures in the mode at the start
LEAST_PERIODS, PERIODS = 1.5, 6.0  # of the run, which ends when the swing has changed
CHANGE = 30.0  # by this factor
# 1/ζω of the slowest spool before it: by then spools swing evenly about their mean. Nothing comes
# before a swing that would be over then, e^−DECAYED of it left.
SPOOLS, DECAYED = 4.0, 0.5
RATE, MOST_STEPS = 60.0, 200_000  # records per period, and steps
TOLERANCE = 1e-10
SMALL = 1e-6  # opening
CREEP = 1e-3  # [ω_1] what swings slower is drift

F = TypeVar("F", Cylinder, Motor)


@dataclass(frozen=True, eq=False, kw_only=True)
class ClosedLoopRun(ReadOnly):
    """A mode of a closed loop in the nonlinear plant.

    Attributes:
        time: (n,) [s].
        amplitude: modal coordinate over that at the start (n,), complex.
        predicted: the same as uneven spools are predicted to make it (n,), complex.
        pole: of the linear closed loop [rad/s].
    """

    time: Array
    amplitude: Array
    predicted: Array
    pole: complex

    @cached_property
    def nonlinear_pole(self) -> complex:
        """λ of the nonlinear run [rad/s]."""
        return self._fitted(self.amplitude)

    @cached_property
    def damping_ratios(self) -> tuple[float, float]:
        """Of the nonlinear run, and as predicted."""
        poles = self.nonlinear_pole, self._fitted(self.predicted)
        first, second = (-pole.real / abs(pole) for pole in poles)
        return first, second

    def _fitted(self, amplitude: Array) -> complex:
        """λ of A e^{λt} + B + C t, fitted to a modal coordinate (n,) [rad/s].

        The line is the drift of pressures that valves open to one side leave behind.
        """
        from scipy.optimize import least_squares

        def residual(x: Array) -> Array:
            swing = np.exp((x[0] + 1j * x[1]) * self.time)
            basis = np.stack([swing, np.ones_like(swing), self.time + 0j], axis=1)
            terms = np.linalg.lstsq(basis, amplitude, rcond=None)[0]
            return (amplitude - basis @ terms).view(float)

        return complex(*least_squares(residual, [self.pole.real, self.pole.imag]).x)


@dataclass(frozen=True, eq=False)
class _ControlledArm:
    """The nonlinear plant of one machine with its controller; states of high-passes after its own.

    Moment arms in the controller are taken at the pose, as swings are small.
    """

    plant: Plant
    loops: LoopPlant
    controller: Controller
    valves: list[SymmetricValve]
    target: Array  # joint positions (nq,)
    equilibrium: Array  # state of plant and filters (size + nc,)

    @cached_property
    def opening(self) -> Array:
        """Openings of the valves at rest (nc,)."""
        spools = self.plant.split(self.equilibrium[: self.plant.size])[4]
        pairs = zip(self.valves, spools, strict=True)
        return np.array([float(valve.opening(spool)) for valve, spool in pairs])

    @property
    def filtered(self) -> bool:
        """Whether pressures are fed back at all: without, the linear loop has no filters."""
        return bool(self.controller.pressure.any())

    @property
    def speeds(self) -> Array:
        """Piston speed by opening (nc,) [m/s]."""
        return np.array([valve.speed for valve in self.valves])

    def spools(self, speed: Array) -> Array:
        """Spool positions (n, nc) for demanded piston speeds (n, nc) [m/s]."""
        opened = self.opening + speed / self.speeds
        pairs = [zip(self.valves, row, strict=True) for row in opened]
        return np.array([[valve.spool(share) for valve, share in row] for row in pairs])

    def from_linear(self, swing: Array) -> Array:
        """States (size + nc,) of a small swing of the linear closed loop (m,)."""
        nc, size = self.plant.nc, self.plant.size
        ns = size - 2 * nc
        speed, rate = swing[ns : ns + nc], swing[ns + nc : ns + 2 * nc]
        spools, slope = self.spools(speed[None])[0], self._slope(speed)
        state = self.equilibrium.copy()
        state[:ns] += swing[:ns]
        state[ns:size] = np.concatenate([spools, rate * slope])
        state[size:] += swing[ns + 2 * nc :] if self.filtered else 0.0
        return state

    def to_linear(self, states: Array) -> Array:
        """States (n, m) of the linear closed loop from small swings (n, size + nc)."""
        nc, size = self.plant.nc, self.plant.size
        ns, away = size - 2 * nc, states - self.equilibrium
        opened = np.array(
            [
                valve.opening(x)
                for valve, x in zip(self.valves, states[:, ns : -2 * nc].T, strict=True)
            ]
        )
        speed = (opened.T - self.opening) * self.speeds
        slopes = np.array([self._slope(row) for row in speed])
        parts = [away[:, :ns], speed, states[:, ns + nc : size] / slopes, away[:, size:]]
        return np.concatenate(parts if self.filtered else parts[:3], axis=1)

    def _slope(self, speed: Array) -> Array:
        """Spool position by piston speed on the side to which the pistons move (nc,) [s/m]."""
        step = np.where(speed >= 0, SMALL, -SMALL) * self.speeds
        return (self.spools(step[None]) - self.spools(0 * step[None]))[0] / step

    def picked(self, cases: object) -> _ControlledArm:
        """This system itself: all cases are alike."""
        return self

    def rates(self, time: Array, state: Array) -> Array:
        """Rates (n, size + nc) of the plant's states and of the filters'."""
        size, nq = self.plant.size, len(self.target)
        pressures = (state[:, : size - 2 * self.plant.nc] @ self.loops.load.T) - state[:, size:]
        demand = (self.target - state[:, :nq]) * self.controller.position
        speed = demand @ self.loops.moment_arms[0].T - self.controller.pressure * pressures
        command = self.spools(speed)
        evaluated = self.plant.evaluate(state[:, :size], command)
        return np.hstack([evaluated.rates, self.controller.corner[:, None] * pressures])


def closed_loop_run(
    machine: Machine,
    q: ArrayLike,
    controller: Controller,
    *,
    least_damped: bool = True,
    periods: float = PERIODS,
    change: float = CHANGE,
    swing: float = SWING,
) -> ClosedLoopRun:
    """A small swing of the nonlinear plant in the least damped mode of its closed loops.

    Args:
        machine: with its load case at work; its own damping counts.
        q: the pose (nq,) [rad, m].
        controller: of this one pose, with high-passes.
        least_damped: whether the mode with the smallest damping ratio swings, else the slowest.
        periods: of the run at most.
        change: of the linear swing, after which the run ends.
        swing: of the load pressures at the start [bar].

    Raises:
        SimulationError: the closed loops do not swing, or the integration gives up.
    """
    loops = loop_plant(machine, machine.at(q))
    pole, right, left = _mode(machine, loops, controller, least_damped)
    arm = _arm(machine, q, loops, controller)
    scale = swing / np.abs(loops.load @ right[: loops.A.shape[1]]).max()
    start = arm.from_linear((right * scale).real)
    cycle = 2 * math.pi / pole.imag
    changed = math.log(change) / max(abs(pole.real) * cycle, 1e-9)
    periods = min(max(changed, LEAST_PERIODS), periods)
    fastest = max(abs(pole), loops.valve_omega.max(), 2 * math.pi * loops.frequencies.max())
    pace = Pace(np.array([fastest]), np.array([fastest]))
    first = SPOOLS / float((loops.valve_omega * loops.valve_damping).min())
    first *= abs(pole.real) * first < DECAYED
    span = Span.of([first + periods * cycle], [RATE / cycle])
    run = integrate(arm, start[None], span, pace, [Breaks((), True)], TOLERANCE, MOST_STEPS)[0]
    if isinstance(run, GaveUpError):
        fault = f"gave up at {run.time:.4g} s ({run})"
        raise SimulationError(f"{machine.name}: closed loops", fault, "give smaller gains")
    time = np.linspace(0.0, first + periods * cycle, len(run))
    counts = time >= first
    amplitude = (arm.to_linear(run) @ left)[counts]
    return ClosedLoopRun(
        time=time[counts] - time[counts][0],
        amplitude=amplitude / amplitude[0],
        predicted=_predicted(loops, controller, (pole, right, left), time[counts]),
        pole=pole,
    )


def _predicted(
    loops: LoopPlant, controller: Controller, mode: tuple[complex, Array, Array], time: Array
) -> Array:
    """A swing with uneven spools that begins at 0, at later times (n,) [s], over the first there.

    A swing a with demands |v_i| |a| moves the pistons by w = |v| |a| W(b) in the mean, b_i = d_i/
    (|v_i| |a|); joints drift by R⁻¹ w, and position loops demand d = −R K R⁻¹ ∫ w dt. So

        ȧ = λ(b) a,     ḃ = −R K R⁻¹ |v| W(b)/|v| − Re λ(b) b

    as if spools followed that at once: K is small against their natural frequencies. What is
    over before it has swung keeps its pole.
    """
    pole, right, left = mode
    if not lasts(np.array(pole)):
        return np.exp(pole * (time - time[0]))
    ns, nc = loops.B.shape[1:]
    omega, spools = np.array([[abs(pole.imag)]]), right[ns : ns + nc]
    size = np.abs(spools / loops.spool(1j * omega)[0, 0])
    size = np.maximum(size, 1e-9 * size.max())
    moves = (left[:ns] @ loops.B[0]) * spools
    arms = loops.moment_arms[0]
    answer = (arms * controller.position[0]) @ np.linalg.pinv(arms)

    def rates(_: float, x: Array) -> Array:
        share, speed = (each[0, 0] for each in passed(loops, omega, x[:nc]))
        now = pole + moves @ (share - 1)
        return np.array(
            [*(-answer @ (size * speed) / size - now.real * x[:nc]), now.real, now.imag]
        )

    begin, end = np.zeros(nc + 2), time[-1]
    run = solve_ivp(rates, (0.0, end), begin, t_eval=time, rtol=1e-5, atol=1e-8).y[nc:]
    return np.exp(run[0] - run[0, 0] + 1j * (run[1] - run[1, 0]))


def _arm(
    machine: Machine, q: ArrayLike, loops: LoopPlant, controller: Controller
) -> _ControlledArm:
    """The arm at rest at a pose, with its filters settled."""
    plant = Plant(_sealed(without_dry_friction(settled(controllable(machine, stated=False), q))))
    start = find_equilibrium(plant, q).state
    load = loops.load @ start[: plant.size - 2 * plant.nc]
    target = np.asarray(q, dtype=float).reshape(-1)
    valves = SymmetricValve.all(plant, start)
    return _ControlledArm(plant, loops, controller, valves, target, np.concatenate([start, load]))


def _sealed(machine: Machine) -> Machine:
    """The machine without leaks that count as none at rest, see ``Valve.leaks``."""

    def tight(actuator: F) -> F:
        valve = actuator.valve
        if valve is None or valve.leaks:
            return actuator
        return replace(actuator, valve=replace(valve, leakage=0.0, tank_leakage=0.0))

    cylinders, motors = map(tight, machine.cylinders), map(tight, machine.motors)
    return replace(machine, cylinders=tuple(cylinders), motors=tuple(motors))


def _mode(
    machine: Machine, loops: LoopPlant, controller: Controller, least_damped: bool
) -> tuple[complex, Array, Array]:
    """A swinging pole of the linear closed loop, its right and left eigenvector (m,)."""
    poles, right = np.linalg.eig(closed_loop(loops, controller)[0][0])
    swings = np.flatnonzero(poles.imag > CREEP * loops.omega[0])
    if len(swings) == 0:
        fault, remedy = "no mode swings: all are overdamped", "give smaller pressure gains"
        raise SimulationError(f"{machine.name}: closed loops", fault, remedy)
    ratio, size = -poles[swings].real / np.abs(poles[swings]), np.abs(poles[swings])
    chosen = swings[(ratio if least_damped else size).argmin()]
    left = np.linalg.inv(right)[chosen]
    return complex(poles[chosen]), right[:, chosen], left
