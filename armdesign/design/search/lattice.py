"""Designs on a coarse drawing grid: pins, bars, closed lengths and strokes in whole steps.

Near a design stiffness and requirements are almost linear in these whole numbers k. Of

    max t − penalty · Σ e   with   uᵀ(A_j + Σ k_v B_jv) u ≥ t,   c + C k + e ≥ 0,   e ≥ 0

for poses j and directions u HiGHS finds the optimum. Directions are added until t is the lowest
eigenvalue (Kelley's cutting planes): first for any numbers k, which takes a hundredth of the time,
then for whole ones. The programme is set up again where the answer lies, until it promises nothing
better than is known; where an answer comes again, or is far from what was promised, fewer steps
are allowed. Where any design will do, there are no poses, and the first that keeps all limits is
the answer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.sizes import FINE
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.file_changes import grid_of
from armdesign.design.search.sequential_sdp import PENALTY, Search, Trial, amounts_missed
from armdesign.errors import InfeasibleError
from armdesign.units import mm

REACH = 10.0  # steps of the grid that a coordinate may move to either side,
LENGTHENED, STROKE = 3.0, 0.2  # and for each of them a closed length and a stroke
STRICT = 30.0  # times that a missed requirement is dearer than while pins are in real numbers
ROUNDS = 10  # of setting up again where the answer lies, better or not
# where limits bend an answer goes astray: its merit is so far below its promise, and only half as
# many steps are allowed from then on
ASTRAY = 0.1
# after so many answers that are no better or went astray it goes on from the best, or the search,
# with half as many steps
FAILED = 2
PROMISED = 2e-5  # of the lowest ω², relative: what is not as much better is not better,
WORTH = 1e-4  # and less is not worth another round, unless so much is won by missing less
LONGER = 1e-6  # that each step of a closed length costs: of equal designs the shorter
# decimals of steps to which a search's end is known, and digits of its ω²: rounding of last bits,
# which differs from processor to processor, is not to decide where branch and bound goes
DECIMALS, DIGITS = 3, 6
# factor on limits: HiGHS may miss them by 1e-6, which at their price is forty times what counts
FINELY = 1e3
CUTS = 8  # times of adding directions at most, to either kind of numbers, until t is
CLOSE = 1e-5  # that near to the lowest eigenvalue: no nearer than branch and bound comes,
NODES, GAP = 2_000, 1e-5  # to the best, relative, with so many nodes


def on_lattice(search: Search, any_will_do: bool = False) -> Search:
    """The best design near a search with all lengths on the drawing grid, where that is coarse.

    Coordinates that did not move stay. The first that meets all requirements if ``any_will_do``.
    """
    if search.problem.grid == FINE or not search.problem.vector.moving:
        return search
    lattice = Lattice.of(search, any_will_do)
    about = home = lattice.start
    best, reach, failed = None, REACH, 0
    for _ in range(ROUNDS):
        promise = lattice.step(about, reach)
        if best and about is home and not promise.worth_a_round(best):
            break
        about = lattice.at(promise.numbers)
        better = best is None or about.merit > best.merit + PROMISED
        best = about if better else best
        if better and any_will_do and about.trial.limits.values.min() >= 0:
            break
        astray = about.merit < promise.merit - ASTRAY
        home, failed = (about, 0) if better and not astray else (home, failed + 1)
        if astray or failed == FAILED:
            reach /= 2
        if failed == FAILED:
            about, failed = home, 0
    return search if best is None else best.search.taking(best.trial)


@dataclass(frozen=True, eq=False)
class Point:
    """A design, in a problem with its lengths, as the watched rows see it.

    Its ``merit`` is the trial's, or where any design will do what limits cost, without frequency.
    """

    search: Search
    trial: Trial
    merit: float

    @classmethod
    def of(cls, search: Search, any_will_do: bool = False) -> Point:
        """The design at which a search stands."""
        trial = search.trial(search.x)
        return cls(search, trial, -_cost(trial) if any_will_do else trial.merit)


@dataclass(frozen=True, eq=False)
class Promise:
    """Whole numbers k that are best where all is linear, the merit there, and limits missed.

    ``missed`` is the sum of all amounts.
    """

    numbers: Array
    merit: float
    missed: float

    def worth_a_round(self, best: Point) -> bool:
        """Whether there is enough to win on the best trial, in frequency or by missing less."""
        won = self.merit - best.merit
        kept = _cost(best.trial) - PENALTY * STRICT * self.missed
        return won > WORTH or (won > PROMISED and kept > PROMISED)


def _cost(trial: Trial) -> float:
    """What its missed limits cost."""
    return PENALTY * STRICT * float(amounts_missed(trial.limits).sum())


@dataclass(frozen=True, eq=False)
class Lattice:
    """Whole numbers k around a search: its coordinates, then closed lengths and strokes.

    Attributes:
        start: the search, with the lengths that its pins want.
        entries: entries of x that are coordinates on the grid.
        cylinders: cylinders whose lengths follow their pins.
        origin: values where k is zero, of x or [m].
        unit: what a step of k adds to them.
        ease: steps for each step of a coordinate.
        low: least k.
        high: largest k.
        any_will_do: whether frequency is left aside.
    """

    start: Point
    entries: list[int]
    cylinders: list[int]
    origin: Array
    unit: Array
    ease: Array
    low: Array
    high: Array
    any_will_do: bool = False

    @classmethod
    def of(cls, search: Search, any_will_do: bool = False) -> Lattice:
        """The lattice of the drawing grid; today's place where none of it is within bounds."""
        problem, vector = search.problem, search.problem.vector
        entries, rows = [], []
        for entry in map(int, np.flatnonzero(vector.is_coordinate)):
            if (grid := grid_of(problem, search.x, entry)) is None:
                continue
            low, high = ((end[entry] - grid[0]) / grid[1] for end in search.bounds)
            least, most = math.ceil(low - 1e-9), math.floor(high + 1e-9)
            rows.append((*grid, 1.0, least, most) if least <= most else (0.0, 1.0, 1.0, 0, 0))
            entries.append(entry)
        cylinders = [i for i in vector.moving if vector.range_poses[i] is not None]
        lengths = [
            (0.0, problem.grid.lengths * mm, LENGTHENED, 1, math.inf),
            (0.0, problem.grid.strokes * mm, STROKE, 1, math.inf),
        ]
        columns = np.array([*rows, *len(cylinders) * lengths], dtype=float).reshape(-1, 5).T
        x, (origin, unit) = search.x.copy(), columns[:2, : len(entries)]
        x[entries] = origin + unit * np.round((x[entries] - origin) / unit, DECIMALS)
        own = np.stack(vector.strokes(x), axis=1)
        start = replace(
            search, strictness=STRICT, reference=float(f"{search.reference:.{DIGITS}g}")
        )
        start = start.of(_with_lengths(problem, cylinders, own[cylinders]), x)
        lattice = cls(Point.of(start, any_will_do), entries, cylinders, *columns)
        return replace(lattice, any_will_do=any_will_do)

    def at(self, numbers: Array) -> Point:
        """The design of numbers k."""
        values, count = self.origin + self.unit * numbers, len(self.entries)
        x = self.start.trial.x.copy()
        x[self.entries] = values[:count]
        problem = _with_lengths(self.start.search.problem, self.cylinders, values[count:])
        return Point.of(self.start.search.of(problem, x), self.any_will_do)

    def numbers(self, point: Point) -> Array:
        """The numbers k of a design; not whole between points of the lattice."""
        chosen = point.search.problem.vector.chosen_lengths
        lengths = [length for i in self.cylinders for length in chosen[i] or ()]
        return (np.array([*point.trial.x[self.entries], *lengths]) - self.origin) / self.unit

    def step(self, about: Point, reach: float) -> Promise:
        """The best numbers, all linear about a design.

        Raises:
            InfeasibleError: branch and bound gave up.
        """
        at, far = self.numbers(about), reach * self.ease + 1e-6
        low = np.maximum(self.low, np.minimum(np.ceil(at - far), np.floor(at + 1e-6)))
        high = np.minimum(self.high, np.maximum(np.floor(at + far), np.ceil(at - 1e-6)))
        base, slopes, values, jacobian = self._linear(about)
        base = base - np.einsum("v,vnij->nij", at, slopes)
        values = values - jacobian @ at
        near = values + np.minimum(jacobian * low, jacobian * high).sum(axis=1) < 0
        costs = np.zeros(len(at))
        costs[len(self.entries) :: 2] = LONGER
        return _solved(base, slopes, values[near], jacobian[near], (low, high), costs)

    def _linear(self, about: Point) -> tuple[Array, Array, Array, Array]:
        """Stiffness and limits at a design, each with its change by a step of every number."""
        search, trial = about.search, about.trial
        rows, squared = search.active(trial.squared), float(trial.squared.min())
        rows = rows[:0] if self.any_will_do else rows
        dynamics, limits = search.problem.dynamics, trial.limits
        base, of_x = dynamics.scaled_stiffness_and_gradient(trial.x, rows, squared)
        unit = self.unit
        slopes = [unit[v] * of_x[entry] for v, entry in enumerate(self.entries)]
        jacobian = [unit[v] * limits.jacobian[:, entry] for v, entry in enumerate(self.entries)]
        for other in self._longer(about):
            stiffness = other.dynamics.scaled_stiffness(trial.x, rows, trial.x, squared)
            slopes.append(stiffness - base)
        jacobian += self._limits_by_length
        scale = search.reference
        return base / scale, np.array(slopes) / scale, limits.values, np.array(jacobian).T

    def _longer(self, about: Point) -> Iterator[Problem]:
        """The problem of a design with each closed length and stroke a step longer."""
        own = self.origin + self.unit * self.numbers(about)
        for lengths in (own + np.diag(self.unit))[len(self.entries) :, len(self.entries) :]:
            yield _with_lengths(about.search.problem, self.cylinders, lengths)

    @cached_property
    def _limits_by_length(self) -> list[Array]:
        """Changes of the limits (m,) by a step of each closed length and stroke.

        They hardly depend on where the pins are.
        """
        search, trial = self.start.search, self.start.trial
        return [
            constraints_at(other, trial.x, search.holding).values - trial.limits.values
            for other in self._longer(self.start)
        ]


def _with_lengths(problem: Problem, cylinders: list[int], lengths: Array) -> Problem:
    """The problem with closed lengths and strokes [m] of some cylinders."""
    chosen: list[tuple[float, float] | None] = [None] * len(problem.machine.cylinders)
    for i, (closed, stroke) in zip(cylinders, lengths.reshape(-1, 2), strict=True):
        chosen[i] = float(closed), float(stroke)
    return problem.with_lengths(tuple(chosen))


def _solved(
    base: Array,
    slopes: Array,
    values: Array,
    jacobian: Array,
    ends: tuple[Array, Array],
    costs: Array,
) -> Promise:
    """Whole numbers k within ends that are best.

    Of stiffness base + Σ k · slopes over the reference, and limits values + jacobian · k.

    Raises:
        InfeasibleError: branch and bound gave up.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    m, count = jacobian.shape
    values, jacobian, penalty = FINELY * values, FINELY * jacobian, PENALTY * STRICT / FINELY
    limits = LinearConstraint(np.hstack([jacobian, np.zeros((m, 1)), np.eye(m)]), -values, np.inf)
    cuts, least = np.empty((0, count + 1 + m)), np.empty(0)
    pose, direction = np.repeat(np.arange(len(base)), base.shape[1]), np.linalg.eigh(base)[1]
    direction = direction.swapaxes(1, 2).reshape(-1, base.shape[1])
    whole = False
    for cut in range(2 * CUTS):
        constant = np.einsum("ki,kij,kj->k", direction, base[pose], direction)
        slope = np.einsum("ki,vkij,kj->kv", direction, slopes[:, pose], direction)
        others = np.hstack([-np.ones((len(slope), 1)), np.zeros((len(slope), m))])
        cuts = np.concatenate([cuts, np.hstack([slope, others])])
        least = np.concatenate([least, -constant])
        answer = milp(
            np.concatenate([costs, [-1.0], np.full(m, penalty)]),
            integrality=np.concatenate([np.full(count, whole), np.zeros(1 + m)]),
            bounds=Bounds(
                np.concatenate([ends[0], [-np.inf], np.zeros(m)]),
                np.concatenate([ends[1], [np.inf if len(base) else 0.0], np.full(m, np.inf)]),
            ),
            constraints=[limits, LinearConstraint(cuts, least, np.inf)],
            options={"node_limit": NODES, "mip_rel_gap": GAP},
        )
        if answer.x is None:
            raise InfeasibleError("design step", answer.message, "loosen the requirements")
        numbers, reached = answer.x[:count], answer.x[count]
        numbers = np.round(numbers) if whole else numbers
        size, vectors = np.linalg.eigh(base + np.einsum("v,vnij->nij", numbers, slopes))
        pose = np.flatnonzero(size[:, 0] <= reached - CLOSE)
        if whole and len(pose) == 0:
            break
        whole = whole or len(pose) == 0 or cut + 1 == CUTS
        direction = vectors[pose, :, 0]
    missed = float(answer.x[count + 1 :].sum())
    return Promise(numbers, float(reached - penalty * missed), missed / FINELY)
