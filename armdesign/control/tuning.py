"""Gains of controllers: the largest whose loops, all closed at once, keep a disk margin.

Gains are found in numbers without unit, which differ little from pose to pose: position gains
κ = K/ω_1, and pressure gains η = c k/(A_1 ω_1), the loss factor that pressure feedback gives an
oil spring k. Three controllers are compared: position loops alone with one gain; with one η too;
and with gains of their own for each loop. The last are searched thoroughly at a few poses and
tried at all, since a search of six gains at thousands of poses would take hours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.control.controller import CORNER, Controller, Filter, closed_loop
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loops import FINE, LoopFigures, Loops
from armdesign.units import bar

LOSS_FACTORS = (
    0.7,
    0.5,
    1.0,
    0.35,
    1.4,
    0.2,
    0.1,
    0.04,
)  # η of one gain for all, the likeliest first
LARGEST, SMALLEST = 1.5, 1e-4  # κ, and of that
BOUND = 2.5  # ζ, of κ without pressure feedback; Merritt's is 2 ζ
CLOSE, WIDER = 1.03, 1.03  # factors within which gains are found, and by which others are better
FACTORS = (1.3, 1.15, 1.05, 0.97, 0.9, 0.8, 0.7, 0.55)  # on searched gains
RAISED = 1.4  # loss factors at the start of a search, over the common one
SEARCHED = 300  # evaluations of a search for gains of their own
ALMOST = 0.2  # share of the margin that may be missing where stability counts
# Shares of gains, of which a finer grid allows one.
RETREATS = (1.0, 0.985, 0.96, 0.93, 0.86, 0.75, 0.6, 0.4, 0.2)
MOST_CRITICAL, BISECTIONS = 8.0, 6
CREEP = 1e-4  # [ω_1] of leaking oil, whose pressures drift within hours: no loop's doing
CREEPING = 2.0  # times the rate at which pressures creep apart with no loop closed


@dataclass(frozen=True, kw_only=True)
class Aim:
    """Margins that controllers must keep, and their filter.

    Attributes:
        margin: balanced disk margin of all loops.
        filter: of load pressures.
        corner: of that filter [rad/s]; None: follows the lowest natural frequency.
    """

    margin: float
    filter: Filter = "high-pass"
    corner: float | None = None


class Gains(NamedTuple):
    """Gains of a controller, without unit, that are tried at many poses."""

    kappa: Array | float  # of the position loops (nq,), or of all
    eta: Array | float  # of the pressure feedbacks (nc,), or of all
    width: float = 1.0  # its narrowest bandwidth where it was made, or what goes with it
    searched: bool = False  # whether all its gains were searched together


@dataclass(frozen=True, eq=False)
class Task:
    """Plants whose controllers are searched, their loops, and the aim."""

    plant: LoopPlant
    loops: Loops
    aim: Aim

    def controller(self, kappa: Array, eta: Array) -> Controller:
        """The controllers (n,) of gains without unit (n, nq), (n, nc)."""
        omega, plant = self.plant.omega[:, None], self.plant
        corner = CORNER[self.aim.filter] * omega[:, 0]
        if self.aim.corner is not None:
            corner = np.full(len(omega), self.aim.corner)
        pressure = eta * plant.areas * omega / plant.oil_stiffness * bar
        return Controller(
            position=kappa * omega, pressure=pressure, corner=corner, filter=self.aim.filter
        )

    def without_units(self, controller: Controller) -> tuple[Array, Array]:
        """Gains κ (n, nq) and η (n, nc) of controllers."""
        unit = self.controller(*_unit_gains(self, 1.0))
        return controller.position / unit.position, controller.pressure / unit.pressure

    def tried(self, candidate: Gains, factor: Array) -> Controller:
        """The controllers of a candidate with factors (n,) on its position gains."""
        kappa, eta = _unit_gains(self)
        return self.controller(kappa * candidate.kappa * factor[:, None], eta + candidate.eta)

    def largest(self, candidate: Gains, least: Array) -> Array:
        """Largest factor on the gains κ of a candidate that keeps the margin (n,).

        0 where it is not larger than the ``least`` that is of interest (n,).
        """
        if candidate.searched:
            return self._first(candidate, least)
        n, highest = len(least), np.full(len(least), LARGEST)
        if not np.any(candidate.eta):  # beyond Merritt's bound another band may seem to be stable
            highest = np.minimum(highest, BOUND * self.plant.damping[:, 0])
        low, high = np.clip(least, SMALLEST * highest, highest), highest
        rows = self._holding(low, candidate, np.arange(n))
        low[np.setdiff1d(np.arange(n), rows)] = 0.0
        while len(rows) and (high[rows] > CLOSE * low[rows]).any():
            middle = np.sqrt(low * high)
            raised = np.isin(np.arange(n), self._holding(middle, candidate, rows))
            low, high = np.where(raised, middle, low), np.where(raised, high, middle)
        return low

    def _first(self, candidate: Gains, least: Array) -> Array:
        """The first of ``FACTORS`` that keeps the margin (n,), as ``largest``.

        Less of gains that were searched together may keep less of a margin.
        """
        factor = np.zeros(len(least))
        for tried in FACTORS:
            rows = np.flatnonzero((factor == 0) & (least <= tried))
            factor[self._holding(np.full(len(least), tried), candidate, rows)] = tried
        return factor

    def _holding(self, factor: Array, candidate: Gains, rows: Array) -> Array:
        return rows[self.loops.holds(self.tried(candidate, factor), self.aim.margin, rows)]


def proportional(task: Task) -> Tuned:
    """Position loops alone, one gain for all joints (n); 0 where none keeps the margin."""
    return best_of(task, [Gains(1.0, 0.0)])


def damped(task: Task) -> Tuned:
    """One position gain and one loss factor η for all loops (n)."""
    return best_of(task, [Gains(1.0, eta) for eta in LOSS_FACTORS])


class Tuned(NamedTuple):
    """Controllers of n poses, and figures of their loops."""

    controller: Controller
    figures: LoopFigures

    def or_wider(self, other: Tuned) -> Tuned:
        """At each pose these or the others, whose narrowest loop is wider."""
        better = self.figures.narrowest >= other.figures.narrowest
        position, pressure = (
            np.where(
                better[:, None], getattr(self.controller, name), getattr(other.controller, name)
            )
            for name in ("position", "pressure")
        )
        controller = replace(self.controller, position=position, pressure=pressure)
        return Tuned(controller, self.figures.where(better, other.figures))


def best_of(task: Task, candidates: Sequence[Gains]) -> Tuned:
    """Controllers (n) of the candidates with the widest bandwidth where the margin allows it.

    The position gains of each candidate are made as large as the margin allows.
    """
    kappa, eta = _unit_gains(task)
    kappa, widest = 0.0 * kappa, np.zeros(len(kappa))
    for candidate in candidates:
        factor = task.largest(candidate, WIDER * widest / candidate.width)
        better = np.flatnonzero(factor)
        tried = task.tried(candidate, factor)
        # Beyond a band of instability a grid may seem to keep the margin again.
        better = better[stable(task.plant[better], tried[better])]
        kappa[better] = (factor[:, None] * candidate.kappa)[better]
        eta[better] = candidate.eta
        widest[better] = factor[better] * candidate.width
    controller = settled(task, task.controller(kappa, eta))
    return Tuned(controller, task.loops.figures(controller))


def searched(task: Task) -> list[Gains]:
    """Gains of their own for each loop, searched at every pose of a few: Nelder and Mead (1965).

    The objective is the narrowest bandwidth of all loops, and a little of the others.
    """
    from scipy.optimize import minimize

    kappa, eta = task.without_units(damped(task).controller)
    answers, (_, nq) = [], kappa.shape
    for pose in np.flatnonzero(kappa.all(axis=1)):
        plant = task.plant[np.array([pose])]
        alone = replace(task, plant=plant, loops=Loops.of(plant, FINE))
        start = np.log(np.concatenate([kappa[pose], RAISED * eta[pose]]))
        simplex = start + np.vstack([np.zeros(len(start)), 0.4 * np.eye(len(start))])
        options = {"maxfev": SEARCHED, "initial_simplex": simplex, "adaptive": True}
        result = minimize(_cost, start, (alone, nq), method="Nelder-Mead", options=options)
        x = np.exp(result.x)
        width = alone.loops.figures(alone.controller(x[None, :nq], x[None, nq:])).narrowest
        answers.append(Gains(x[:nq], x[nq:], float(width[0] / plant.omega[0]), True))
    return answers


def _cost(x: Array, task: Task, nq: int) -> float:
    controller = task.controller(np.exp(x[None, :nq]), np.exp(x[None, nq:]))
    figures = task.loops.figures(controller)
    bandwidth = np.log(figures.bandwidth[0])
    missing = max(float(np.log(task.aim.margin / figures.margin[0])), 0.0)
    unstable = missing < ALMOST and not stable(task.plant, controller)[0]
    return float(-bandwidth.min() - 0.1 * bandwidth.mean() + 20 * missing + 10 * unstable)


def settled(task: Task, controller: Controller) -> Controller:
    """The controllers with gains reduced until margin and stability hold on a fine grid.

    The fine grid has frequencies at the resonances of the closed loops. Where no reduction is
    enough all gains are 0.
    """
    poles = np.linalg.eigvals(closed_loop(task.plant, controller)[0])
    loops, share = Loops.of(task.plant, FINE, poles), np.zeros(len(poles))
    rows = np.flatnonzero(controller.position.any(axis=1))
    for tried in RETREATS:
        position, pressure = tried * controller.position, tried * controller.pressure
        less = replace(controller, position=position, pressure=pressure)
        rows_kept = rows[loops.holds(less, task.aim.margin, rows)]
        rows_kept = rows_kept[stable(task.plant[rows_kept], less[rows_kept])]
        share[rows_kept] = tried
        rows = np.setdiff1d(rows, rows_kept)
        if len(rows) == 0:
            break
    position, pressure = (share[:, None] * x for x in (controller.position, controller.pressure))
    return replace(controller, position=position, pressure=pressure)


def stable(plant: LoopPlant, controller: Controller) -> Flags:
    """Whether each closed loop is stable (n,), by its eigenvalues, but for what creeps anyway."""
    return _decays(plant, np.linalg.eigvals(closed_loop(plant, controller)[0]))


def critical_factor(plant: LoopPlant, controller: Controller) -> Array:
    """Factor on all position gains at which each loop becomes unstable (n,), by eigenvalues.

    At most ``MOST_CRITICAL``; 0 where the gains are 0.
    """
    n = len(plant)
    low, high = np.ones(n), np.full(n, MOST_CRITICAL)
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        raised = replace(controller, position=controller.position * middle[:, None])
        holds = stable(plant, raised)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    return np.where(controller.position.any(axis=1), np.sqrt(low * high), 0.0)


def _decays(plant: LoopPlant, poles: Array) -> Flags:
    return np.asarray(poles.real.max(axis=1) < CREEP * plant.omega + CREEPING * plant.creep)


def _unit_gains(task: Task, feedback: float = 0.0) -> tuple[Array, Array]:
    """Gains 1 of all position loops (n, nq), and of all pressure feedbacks (n, nc)."""
    n, nc, nq = task.plant.moment_arms.shape
    return np.ones((n, nq)), np.full((n, nc), feedback)
