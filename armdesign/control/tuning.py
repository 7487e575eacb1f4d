"""Gains of controllers: the largest whose loops, all closed at once, keep a disk margin.

Gains are found in numbers without unit, which differ little from pose to pose: position gains
κ = K/ω_1, and pressure gains η = c k/(A_1 ω_1), the loss factor that pressure feedback gives an
oil spring k. Position loops alone have one gain κ; with pressure feedback they have one η too.
Gains of their own for each loop are searched from these, see ``own_gains``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.control.closed_loops import LoopFigures
from armdesign.control.controller import CORNER, Controller, Filter
from armdesign.control.loop_plant import LoopPlant
from armdesign.control.loop_sight import margins_hold, narrowest
from armdesign.control.loops import FINE, Loops
from armdesign.control.refined_loops import refined
from armdesign.control.stability import stability, stable
from armdesign.units import bar

# η of one gain for all, from which on it is sought by factors, the first of which is WIDER
LOSS_FACTORS, WIDER = (0.012, 0.02, 0.03, 0.05, 0.08, 0.13, 0.2, 0.33, 0.53, 0.85, 1.4), 1.27
KEPT = 0.75  # of gains that a finer grid allows; below, other η may allow more
LARGEST, SMALLEST = 1.5, 1e-4  # κ, and of that
BOUND = 2.5  # ζ, of κ without pressure feedback; Merritt's is 2 ζ, over the part PASSED
PASSED = 0.8  # of a mode by valve and delay, Re V: the bound has room for as little
CLOSE = 1.03  # factor within which gains are found, and by which others are better
CLOSER = 1.003  # the same at the end of a search
EXACT = 1.00001  # the same where small changes of a machine are to be seen
# Shares of gains, of which a finer grid allows one; the last ones where the resonance of a mode
# that is hardly damped lay between the frequencies of the grid.
RETREATS = (1.0, 0.985, 0.96, 0.93, 0.86, 0.75, 0.6, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
GROWN = 1  # halvings of gaps of a grid that grows
HALVINGS = 12  # of gains between which and 0 a grid has missed a band of instability


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


@dataclass(frozen=True, eq=False)
class Task:
    """Plants whose controllers are searched, their loops, and the aim.

    ``close`` is the factor within which gains are found: ``CLOSE``, ``CLOSER`` or ``EXACT``.
    """

    plant: LoopPlant
    loops: Loops
    aim: Aim
    close: float = CLOSE

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

    def __getitem__(self, rows: Array) -> Task:
        """The task at some of the poses (mask or indices)."""
        return replace(self, plant=self.plant[rows], loops=self.loops[rows])

    def grown(self, controller: Controller) -> Task:
        """The task on a grid that has the frequencies at which these loops are decided, too."""
        ringing = stability(self.plant, controller).ringing
        grid = refined(self.plant, self.loops, controller, ringing, GROWN)
        return replace(self, loops=grid.joined)

    @cached_property
    def fine(self) -> Loops:
        """The loops on a fine grid."""
        return Loops.of(self.plant, FINE)

    @property
    def closer(self) -> Task:
        """The task at the end of a search: gains are found within ``CLOSER``, or closer."""
        return replace(self, close=min(self.close, CLOSER))

    @property
    def resting(self) -> Tuned:
        """Controllers (n,) without gains."""
        n, nq = self.shapes[0]
        return Tuned(self.controller(*map(np.zeros, self.shapes)), LoopFigures.none(n, nq))

    @property
    def shapes(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Of the gains κ (n, nq) and η (n, nc)."""
        n, nc, nq = self.plant.moment_arms.shape
        return (n, nq), (n, nc)

    def without_units(self, controller: Controller) -> tuple[Array, Array]:
        """Gains κ (n, nq) and η (n, nc) of controllers."""
        unit = self.controller(*map(np.ones, self.shapes))
        return controller.position / unit.position, controller.pressure / unit.pressure

    def common(self, kappa: Array, eta: Array) -> Controller:
        """The controllers of one κ and one η for all loops at each pose (n,)."""
        ones, more = (np.ones(shape) for shape in self.shapes)
        return self.controller(ones * kappa[:, None], more * eta[:, None])

    def largest(self, eta: Array, least: Array) -> Array:
        """Largest κ of all loops that keeps the margin (n,), with the η of each pose (n,).

        0 where it is not larger than the ``least`` that is of interest (n,).
        """
        n, highest = len(least), np.where(eta > 0, LARGEST, self._highest)
        low, high = np.clip(least, SMALLEST * highest, highest), highest
        rows = self._holding(low, eta, np.arange(n))
        low[np.setdiff1d(np.arange(n), rows)] = 0.0
        while len(rows := rows[high[rows] > self.close * low[rows]]):
            middle = np.sqrt(low * high)
            raised = self._holding(middle, eta, rows)
            high[rows] = np.where(np.isin(rows, raised), high[rows], middle[rows])
            low[raised] = middle[raised]
        return low

    @property
    def _highest(self) -> Array:
        """κ of position loops alone (n,) beyond which another band may seem to be stable."""
        return self._ringing[:, 0]

    @property
    def highest_alone(self) -> Array:
        """κ (n,) that no position loop alone exceeds: it would be unstable at every mode."""
        return np.asarray(self._ringing.max(axis=1))

    @cached_property
    def _ringing(self) -> Array:
        """κ (n, k) beyond which position loops alone are unstable at each mode, or ``LARGEST``.

        About a mode the loops run through a circle from 0 to −κ V ω_1/(2 ζ_k ω_k), which holds −1
        if κ Re V > 2 ζ_k ω_k/ω_1. Where V, the response of valve and delay, has turned the phase
        by 90° and more no gain makes the mode ring.
        """
        plant = self.plant
        decay = plant.damping * plant.frequencies / plant.frequencies[:, :1]
        passed = plant.valve(2j * math.pi * plant.frequencies).real.min(axis=2)
        with np.errstate(divide="ignore"):
            return np.minimum(LARGEST, BOUND * decay / np.clip(passed / PASSED, 0.0, 1.0))

    def smallest(self) -> Controller:
        """The controllers (n,) of the smallest gains that are tried: of position loops alone."""
        return self.common(SMALLEST * self._highest, np.zeros(len(self.plant)))

    def _holding(self, kappa: Array, eta: Array, rows: Array) -> Array:
        return rows[margins_hold(self.loops, self.common(kappa, eta), self.aim.margin, rows)]


def proportional(task: Task) -> Tuned:
    """Position loops alone, one gain for all joints (n); 0 where none keeps the margin."""
    return best_of(task, (0.0,))


def damped(task: Task) -> Tuned:
    """One position gain and one loss factor η for all loops (n).

    κ rises with η up to where pressure feedback takes the margin itself, and along a tongue beyond
    in which both rise together: so η is sought from the smallest on.
    """
    kappa, eta = _widest_together(task)
    found = safe(task.closer, task.common(kappa, eta))
    left = task.without_units(found.controller)[0][:, 0]
    few = np.flatnonzero(left <= KEPT * kappa)
    if len(few) == 0:
        return found
    return found.replaced(few, best_of(task[few], LOSS_FACTORS[::-1]).or_wider(found[few]))


def _widest_together(task: Task) -> tuple[Array, Array]:
    """κ and η of all loops (n,) that make the narrowest the widest, as the grid has it."""
    kappa, eta = np.zeros(len(task.plant)), np.full(len(task.plant), LOSS_FACTORS[0])
    width = np.zeros(len(eta))

    def try_with(other: Array, within: Task) -> None:
        tried = _out_of_bands(task, within.largest(other, within.close * kappa), other, kappa)
        rows = np.flatnonzero(tried)
        widths = narrowest(task.loops, task.common(tried, other), task.aim.margin, rows)
        rows, widths = rows[widths > width[rows]], widths[widths > width[rows]]
        kappa[rows], eta[rows], width[rows] = tried[rows], other[rows], widths

    for each in LOSS_FACTORS:
        try_with(np.full(len(eta), each), task)
    factor, finer = WIDER, task.closer
    while factor > finer.close:
        within = task if factor > task.close else finer
        try_with(eta * factor, within)
        try_with(eta / factor, within)
        factor = math.sqrt(factor)
    return np.maximum(_out_of_bands(task, finer.largest(eta, kappa), eta, kappa), kappa), eta


@dataclass(frozen=True, eq=False)
class Tuned:
    """Controllers of n poses, and figures of their loops."""

    controller: Controller
    figures: LoopFigures

    def __getitem__(self, rows: Array) -> Tuned:
        """These at some of the poses (mask or indices)."""
        return Tuned(self.controller[rows], LoopFigures(*(each[rows] for each in self.figures)))

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

    def replaced(self, rows: Array, other: Tuned) -> Tuned:
        """These controllers (n,), but at some of the poses (m,) the others (m,)."""

        def both(mine: Array, theirs: Array) -> Array:
            values = mine.copy()
            values[rows] = theirs
            return values

        mine, theirs = self.controller, other.controller
        controller = replace(
            mine,
            position=both(mine.position, theirs.position),
            pressure=both(mine.pressure, theirs.pressure),
            corner=both(mine.corner, theirs.corner),
        )
        figures = LoopFigures(*map(both, self.figures, other.figures))
        return Tuned(controller, figures)


def best_of(task: Task, loss_factors: Sequence[float]) -> Tuned:
    """Controllers (n) of the widest loops that some η of all loops allows.

    What counts is what is left where gains are reduced, see ``safe``: the η of the largest κ on a
    coarse grid may lose more of it than another.
    """
    best, tuned = np.zeros(len(task.plant)), task.resting
    for each in loss_factors:
        eta = np.full(len(best), each)
        kappa = _out_of_bands(task, task.largest(eta, task.close * best), eta, best)
        kept = safe(task, task.common(kappa, eta))
        wider = np.flatnonzero(kept.figures.narrowest > tuned.figures.narrowest)
        best[wider] = task.without_units(kept.controller)[0][wider, 0]
        tuned = tuned.replaced(wider, kept[wider])
    return tuned


def _out_of_bands(task: Task, kappa: Array, eta: Array, least: Array) -> Array:
    """κ (n,) that leaves each loop stable; 0 where it would not be larger than ``least`` (n,).

    A grid may miss the resonance of a mode that is hardly damped, and seem to keep the margin
    beyond its band of instability.
    """
    sound = kappa.copy()
    rows = np.flatnonzero(kappa)
    for _ in range(HALVINGS):
        rows = rows[~stable(task.plant[rows], task.common(sound, eta)[rows])]
        if len(rows) == 0:
            break
        sound[rows] /= 2
        rows, lost = rows[sound[rows] > least[rows]], rows[sound[rows] <= least[rows]]
        sound[lost] = 0.0
    sound[rows] = 0.0
    return sound


def safe(task: Task, controller: Controller, least: Tuned | None = None) -> Tuned:
    """The controllers with gains reduced until margin and stability hold on a fine grid.

    And at the resonances of the closed loops, and where else their figures are decided. Gains are
    reduced towards those of controllers that hold, ``least`` (None: 0), which remain where no
    reduction is enough.
    """
    least = least or task.resting
    kept, share = least, np.zeros(len(task.plant))
    rows = np.flatnonzero(controller.position.any(axis=1))
    for tried in RETREATS:
        less = _between(least.controller, controller, np.full(len(share), tried))
        holding, tuned = keeping(task, less, rows)
        kept, share[holding] = kept.replaced(holding, tuned), tried
        rows = np.setdiff1d(rows, holding)
        if len(rows) == 0:
            break
    return _raised(task, controller, least, kept, share)


def keeping(task: Task, controller: Controller, rows: Array) -> tuple[Array, Tuned]:
    """Those of some poses at which loops are stable and keep the margin, and their controllers."""
    rows = rows[margins_hold(task.fine, controller, task.aim.margin, rows)]
    found = stability(task.plant[rows], controller[rows])
    rows, ringing = rows[found.stable], found.ringing[found.stable]
    if len(rows) == 0:
        return rows, task.resting[rows]
    own = controller[rows]
    figures = refined(task.plant[rows], task.fine[rows], own, ringing).figures
    holds = figures.margin >= task.aim.margin
    return rows[holds], Tuned(own, figures)[holds]


def _raised(task: Task, controller: Controller, least: Tuned, kept: Tuned, share: Array) -> Tuned:
    """Kept gains raised from their share (n,) towards the next of ``RETREATS``, which fails."""
    tried = np.array(RETREATS[::-1])
    following = np.minimum(np.searchsorted(tried, share) + 1, len(tried) - 1)
    above = np.where(share > 0, tried[following], 0.0)
    while len(rows := np.flatnonzero(above > task.close * share)):
        middle = (share + above) / 2
        holding, tuned = keeping(task, _between(least.controller, controller, middle), rows)
        kept, share[holding] = kept.replaced(holding, tuned), middle[holding]
        lost = np.setdiff1d(rows, holding)
        above[lost] = middle[lost]
    return kept


def _between(least: Controller, most: Controller, share: Array) -> Controller:
    """Controllers whose gains are a share (n,) of the way from the least to the most."""
    position, pressure = (
        low + share[:, None] * (high - low)
        for low, high in ((least.position, most.position), (least.pressure, most.pressure))
    )
    return replace(most, position=position, pressure=pressure)
