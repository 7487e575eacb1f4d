"""Rivals of the co-design: differential evolution, CMA-ES and SLSQP multi-start.

What they are given: variables scaled to [0, 1], areas boxed to 0.5 … 1.5 of today's; today's
machine among the first; not the workspace's 30 000 rows but some hundreds, to which the lowest and
most loaded join whenever the whole is looked at; requirements without derivatives where none are
used, by the package's own formulas; exact derivatives of the eigenvalues and requirements for
SLSQP. Each remembers its best design that meets all on the whole workspace as nearly as ours must.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import cma
import numpy as np
from scipy.optimize import differential_evolution, minimize

from armdesign.arrays import Array
from armdesign.design.program.constraints import constraints_at, holding_rows
from armdesign.design.program.corners import Pistons
from armdesign.design.program.design_vector import PROGRAMME_POSES, Geometry
from armdesign.design.program.gradient import SteppedDesign
from armdesign.design.program.lowest_eigenvalues import lowest
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.candidate import reference_of
from armdesign.design.requirements.settings import evaluations
from armdesign.design.search.sequential_sdp import MISSED
from armdesign.frequency.modes import hertz
from armdesign.mechanism.rigid_poses import RigidPoses

PRICE = 5.0  # of ω² (relative) per unit of missed requirement
FEW, MORE = 150, 12  # poses that a rival starts with, and that join at each look
# rows that join a programme of SLSQP at each round, and rounds from one start
LOWEST, ROUNDS = 20, 10
POPULATION, GENERATIONS = 5, 20  # of differential evolution: designs per variable; between looks
LOOKS = 40  # looks at the whole workspace in the time that rivals have


@dataclass(frozen=True, eq=False)
class Plain(SteppedDesign):
    """The design at x as a candidate without derivatives; each linkage is evaluated once.

    The poses are the workspace's and after them each cylinder's over its joint's range.
    """

    poses: RigidPoses

    @cached_property
    def on_all_poses(self) -> Geometry:
        """Every linkage at all poses."""
        return self.vector.geometry(self.x, self.poses)

    @cached_property
    def areas(self) -> Array:
        """Areas (1, nc, 2) [m²]."""
        return self.vector.areas(self.x)[None]

    @cached_property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """Lengths [m] and arms [m/rad] of each cylinder over its joint's range; None without."""
        ranges: list[tuple[Array, Array] | None] = []
        end = len(self.poses) - sum(len(p) for p in self.vector.range_poses if p is not None)
        for i, (linkage, poses) in enumerate(
            zip(self.machine.linkages, self.vector.range_poses, strict=True)
        ):
            if poses is None:
                ranges.append(None)
                continue
            rows, end = slice(end, end + len(poses)), end + len(poses)
            ranges.append(
                (
                    self.on_all_poses.length[None, rows, i],
                    self.on_all_poses.arm[None, rows, i, linkage.joints[0]],
                )
            )
        return ranges

    @cached_property
    def _closed_and_stroke(self) -> tuple[Array, Array]:
        closed, stroke = self.vector.strokes(self.x)
        return closed[None], stroke[None]

    def place(self, i: int, name: str) -> Array | None:
        """A place of a linkage (1, 2) [m]; None where it has none."""
        place = self.linkages[i].place(name)
        return None if place is None else np.array([place])

    def transmission(self, i: int) -> Array:
        """Transmission of a four-bar over its joint's range (1, n)."""
        poses = self.vector.range_poses[i]
        assert poses is not None
        return self.linkages[i].transmission(poses)[None]


@dataclass(frozen=True, eq=False)
class Judge:
    """Objective and requirements of a problem, without derivatives."""

    problem: Problem

    @cached_property
    def poses(self) -> RigidPoses:
        """Of the workspace and of the joint ranges."""
        parts = [
            self.problem.workspace.rigid,
            *(poses for poses in self.problem.vector.range_poses if poses is not None),
        ]
        return RigidPoses(
            *(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(RigidPoses))
        )

    def at(self, x: Array) -> tuple[Array, Array, Array]:
        """Lowest ω² (n,) [rad²/s²] and forces (n, nc) [N] of rows, and violations ≥ 0."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self._at(x)

    def _at(self, x: Array) -> tuple[Array, Array, Array]:
        problem, new = self.problem, Plain(self.problem.vector, x, self.poses)
        dynamics, g = problem.dynamics, new.on_all_poses
        pose, rows = dynamics.rows.pose, np.arange(len(dynamics.rows))
        mass, gravity, slope = dynamics.inertia_and_gravity(x, dynamics.rows, rows)
        forces = dynamics.static_forces(g.arm[pose], gravity, new.areas[0])
        extension = g.length[pose] - new.closed[0]
        pistons = Pistons(extension, new.stroke[0], new.areas[0], forces)
        stiffness = dynamics.actuator_stiffness(dynamics.rows.corner, g[pose], pistons) + slope
        lower = dynamics.inverse_cholesky_of(mass, rows)
        reference = reference_of(problem.machine, problem.requirements, PROGRAMME_POSES)
        evaluated = evaluations(new, reference, lambda: forces[None])
        values = np.array([e.constraint[0].real.min() for e in evaluated])
        missed = np.where(np.isfinite(values), np.maximum(-values, 0.0), 10.0)
        return lowest(lower @ stiffness @ np.swapaxes(lower, 1, 2)), forces, missed


@dataclass(eq=False)
class Task:
    """A problem as a rival sees it, the clock, and the allowed designs that the rival found."""

    problem: Problem
    seconds: float  # processor time that it has
    goal: float = math.inf  # frequency [Hz] at which it may stop
    poses: Array = field(init=False)
    # seconds, frequency [Hz], x of each record
    trace: list[tuple[float, float, Array]] = field(default_factory=list)
    # merits and designs found since the last look
    hopes: list[tuple[float, Array]] = field(default_factory=list)
    evaluations: int = 0
    looked: float = 0.0

    def __post_init__(self) -> None:
        low, high = self.problem.bounds
        areas = np.array([v.pin is None for v in self.problem.vector.variables])
        self.low, self.high = (
            np.where(areas, np.maximum(low, 0.5), low),
            np.where(areas, np.minimum(high, 1.5), high),
        )
        self.free = self.high > self.low
        squared = self.problem.dynamics.omega_squared(self.problem.vector.start)
        rows = np.concatenate(
            [
                np.argsort(squared)[: FEW // 2],
                np.arange(0, len(squared), max(1, 2 * len(squared) // FEW)),
            ]
        )
        self.poses = np.unique(self.problem.dynamics.rows.pose[rows])
        self.random = np.random.default_rng(0)
        self.began = time.process_time()

    @property
    def spent(self) -> float:
        """Processor time since it began [s]."""
        return time.process_time() - self.began

    @property
    def over(self) -> bool:
        """Whether time is up or the goal is reached."""
        return self.spent > self.seconds or bool(self.trace and self.trace[-1][1] >= self.goal)

    @property
    def best(self) -> Array:
        """The best design found; today's if none."""
        return self.trace[-1][2] if self.trace else self.problem.vector.start

    @cached_property
    def whole(self) -> Judge:
        """Over the whole workspace."""
        return Judge(self.problem)

    @cached_property
    def judge(self) -> Judge:
        """Over the poses that count so far."""
        whole = self.problem.workspace
        some = whole.subset(self.poses)
        limits_ = replace(self.problem.requirements, pin_box=self.problem.vector.pin_box)
        corners = self.problem.dynamics.corners
        of_some = Problem.of(
            self.problem.machine,
            some,
            limits_,
            self.problem.vector.vary,
            proportional=corners.proportional,
            bands=corners.bands,
            gain=corners.gain,
        )
        return Judge(of_some)

    @property
    def keys(self) -> Array:
        """A number for every row of ``judge`` that stays the same when poses join."""
        rows = self.judge.problem.dynamics.rows
        return np.asarray(rows.payload * len(self.problem.workspace) + self.poses[rows.pose])

    def x(self, u: Array) -> Array:
        """The design at the free variables u in [0, 1]."""
        x = self.problem.vector.start.copy()
        x[self.free] = self.low[self.free] + np.clip(u, 0, 1) * (self.high - self.low)[self.free]
        return x

    def u(self, x: Array) -> Array:
        """The free variables of a design in [0, 1]."""
        return ((x - self.low)[self.free] / (self.high - self.low)[self.free]).clip(0, 1)

    def drawn(self) -> Array:
        """Free variables drawn over half of their boxes, about today's."""
        today = self.u(self.problem.vector.start)
        return np.clip(today + self.random.uniform(-0.25, 0.25, len(today)), 0, 1)

    def cost(self, u: Array) -> float:
        """Lowest ω² over today's, negative, and the price of what is missed, on the few poses."""
        self.evaluations += 1
        x = self.x(u)
        squared, _, missed = self.judge.at(x)
        merit = float(squared.min()) / self.problem.dynamics.omega_squared_scale
        if missed.max() <= MISSED:
            self.hope(merit, x)
        return float(PRICE * missed.sum()) - merit

    def hope(self, merit: float, x: Array) -> None:
        """Remember a design that may be the best; look at the whole workspace now and then."""
        if not self.hopes or merit > self.hopes[-1][0]:
            self.hopes.append((merit, x))
        if self.spent > self.looked + self.seconds / LOOKS:
            self.look()

    def look(self) -> bool:
        """Judge the best since the last look on the whole workspace; whether poses joined."""
        grown = False
        for _, x in self.hopes[-1:]:
            squared, forces, missed = self.whole.at(x)
            frequency = hertz(float(squared.min()))
            if missed.max() <= MISSED and (not self.trace or frequency > self.trace[-1][1]):
                self.trace.append((self.spent, frequency, x))
            rows = np.concatenate(
                [np.argsort(squared)[:MORE], holding_rows(self.problem, x, forces)]
            )
            poses = np.union1d(self.poses, self.problem.dynamics.rows.pose[rows])
            grown = len(poses) > len(self.poses)
            if grown:
                self.poses = poses
                del self.judge
        self.hopes, self.looked = [], self.spent
        return grown


def evolution(task: Task) -> None:
    """Differential evolution with an exact penalty; its population stays while poses join."""
    size = len(task.u(task.problem.vector.start))
    population, round_ = None, 0
    while not task.over:
        if population is None or np.ptp(population, axis=0).max() < 1e-5:
            population = np.array(
                [task.u(task.best), *(task.drawn() for _ in range(POPULATION * size - 1))]
            )
        outcome = differential_evolution(
            task.cost,
            [(0.0, 1.0)] * size,
            init=population,
            maxiter=GENERATIONS,
            tol=0.0,
            polish=False,
            rng=np.random.default_rng(round_),
            callback=lambda *_: task.over,
        )
        population, round_ = outcome.population, round_ + 1
        task.look()


def adaptation(task: Task) -> None:
    """CMA-ES with an exact penalty.

    It restarts with twice the population, from today's, from the best, from anywhere.
    """
    size, round_ = 4 + int(3 * math.log(len(task.u(task.problem.vector.start)))), 0
    while not task.over:
        start = (
            (task.drawn(), task.u(task.best))[round_ % 2]
            if round_
            else task.u(task.problem.vector.start)
        )
        settings = {
            "bounds": [0, 1],
            "seed": round_ + 1,
            "popsize": size * 2 ** min(round_, 5),
            "verbose": -9,
        }
        strategy = cma.CMAEvolutionStrategy(start, 0.1, settings)
        while not strategy.stop() and not task.over:
            designs = strategy.ask()
            strategy.tell(designs, [task.cost(u) for u in designs])
        round_ += 1
        task.look()


def programming(task: Task) -> None:
    """SLSQP from many starts: maximise t below the two lowest ω² of the lowest poses."""
    u = task.u(task.problem.vector.start)
    while not task.over:
        kept = np.empty(0, dtype=int)
        for _ in range(ROUNDS):
            squared = task.judge.problem.dynamics.omega_squared(task.x(u))
            known, kept = kept, np.union1d(kept, task.keys[np.argsort(squared)[:LOWEST]])
            if len(kept) == len(known):
                break
            u = _solved(task, u, np.flatnonzero(np.isin(task.keys, kept)))
            if not task.problem.vector.closes(task.x(u)):
                break
            task.cost(u)
            task.look()
        u = task.drawn()
        while not task.problem.vector.closes(task.x(u)):
            u = task.drawn()


def _solved(task: Task, start: Array, rows: Array) -> Array:
    """The design to which SLSQP leads from another, by the frequencies of some rows."""
    constraints = _Constraints(task, rows, holding_rows(task.judge.problem, task.x(start)))

    def stop(*_: object) -> None:
        if task.over:
            raise StopIteration

    lowest = float(constraints.problem.dynamics.omega_squared(task.x(start), rows).min())
    outcome = minimize(
        lambda z: -z[-1],
        np.append(start, lowest / constraints.scale),
        jac=lambda z: np.append(np.zeros(len(start)), -1.0),
        bounds=[(0.0, 1.0)] * len(start) + [(None, None)],
        constraints={
            "type": "ineq",
            "fun": lambda z: constraints.at(z)[0],
            "jac": lambda z: constraints.at(z)[1],
        },
        method="SLSQP",
        callback=stop,
        options={"maxiter": 100, "ftol": 1e-8},
    )
    return np.clip(outcome.x[:-1], 0, 1)


class _Constraints:
    """Values ≥ 0 and their derivatives at the free variables and t; the last are remembered."""

    def __init__(self, task: Task, rows: Array, holding: Array) -> None:
        self.task, self.rows, self.holding = task, rows, holding
        self.problem = task.judge.problem
        self.width = (task.high - task.low)[task.free]
        self.scale = task.problem.dynamics.omega_squared_scale
        self.last: tuple[bytes, Array, Array] | None = None

    def at(self, z: Array) -> tuple[Array, Array]:
        """Values (m,) and Jacobian (m, n + 1) at z (n + 1,)."""
        x, last = self.task.x(z[:-1]), self.last
        if last and not self.problem.vector.closes(x):  # a line search went too far
            return np.full_like(last[1], -10.0), last[2]
        if last is None or z.tobytes() != last[0]:
            self.task.evaluations += 1
            self.last = last = z.tobytes(), *self._computed(x, z[-1])
        return last[1:]

    def _computed(self, x: Array, t: float) -> tuple[Array, Array]:
        at = constraints_at(self.problem, x, self.holding)
        dynamics, scale = self.problem.dynamics, self.scale
        pair = dynamics.scaled_stiffness_and_gradient(x, self.rows, t * scale)
        base, slopes = (part / scale for part in pair)
        squared, vectors = np.linalg.eigh(base)
        slope = np.einsum("nik,vnij,njk->nkv", vectors, slopes, vectors)[:, :2]
        slope = slope.reshape(-1, len(x))
        value = np.concatenate([squared[:, :2].ravel() - t, at.values])
        jacobian = np.concatenate([slope, at.jacobian])[:, self.task.free] * self.width
        by_t = np.concatenate([-np.ones(len(slope)), np.zeros(len(at.values))])
        return value, np.column_stack([jacobian, by_t])
