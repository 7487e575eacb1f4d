"""Co-design of every shipped machine against differential evolution, SLSQP multi-start and CMA-ES.

Run on an otherwise idle machine: ``python -m benchmarks.against_optimisers [linkages] [machine
…]``, half an hour for all. Each rival is given 20 × our time. ``linkages`` frees all of the
four-bars too. Variables, boxes, requirements and objective are the same: the lowest coupled
frequency over the default workspace and all load cases. Times are processor times of one process
on one core.

What the rivals are given: variables scaled to [0, 1], areas boxed to 0.5 … 1.5 of today's; today's
machine among the first; not the workspace's 30 000 rows but some hundreds, to which the lowest and
most loaded join whenever the whole is looked at; requirements without derivatives where none are
used, by the package's own formulas; exact derivatives of the eigenvalues and requirements for
SLSQP. Each remembers its best design that meets all on the whole workspace as nearly as ours must.
In the end every design is built as a machine and judged by ``check`` and ``frequency_map``, which
know nothing of any optimiser.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import cma
import numpy as np
from scipy.optimize import differential_evolution, minimize

import armdesign as ad
from armdesign.arrays import Array
from armdesign.design.program.constraints import constraints_at, holding_rows
from armdesign.design.program.corners import Pistons
from armdesign.design.program.design_vector import RANGE_POSES, Geometry
from armdesign.design.program.dynamics import lowest
from armdesign.design.program.gradient import SteppedDesign
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.candidate import reference_of
from armdesign.design.requirements.check import check
from armdesign.design.requirements.settings import evaluations
from armdesign.design.search.sequential_sdp import MISSED
from armdesign.frequency.modes import hertz
from armdesign.mechanism.arm import RigidPoses

MACHINES = (
    "excavator_20t",
    "mini_excavator_2t",
    "excavator_12t",
    "loader_crane",
    "patu_boom",
    "paper_1dof",
)
# gain that is asked for
LEAST = {"excavator_20t": 0.36, "mini_excavator_2t": 0.35, "excavator_12t": 0.08}
# slack by which the check of a built machine may be missed: it looks at finer joint ranges
FEASIBLE = 1e-4
RIVALS = 20  # times our processor time that each rival has
LONGEST = 60  # times for differential evolution on the first machine, to reach what we did
FASTER = 30  # times that we must be faster than that
ALIKE = 1e-4  # of a frequency: what searches that stop at 1e-5 of ω² may differ by
CLOSE = 1e-3  # of a frequency: what counts as reached besides all of it
PRICE = 5.0  # of ω² (relative) per unit of missed requirement
FEW, MORE = 150, 12  # poses that a rival starts with, and that join at each look
# rows that join a programme of SLSQP at each round, and rounds from one start
LOWEST, ROUNDS = 20, 10
METHODS = {
    "evolution": "differential evolution",
    "adaptation": "CMA-ES",
    "programming": "SLSQP multi-start",
}
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
        """See ``Candidate``."""
        return self.vector.areas(self.x)[None]

    @cached_property
    def sweeps(self) -> list[tuple[Array, Array] | None]:
        """See ``Candidate``."""
        found: list[tuple[Array, Array] | None] = []
        end = len(self.poses) - sum(len(p) for p in self.vector.range_poses if p is not None)
        for i, (linkage, poses) in enumerate(
            zip(self.machine.linkages, self.vector.range_poses, strict=True)
        ):
            if poses is None:
                found.append(None)
                continue
            rows, end = slice(end, end + len(poses)), end + len(poses)
            found.append(
                (
                    self.on_all_poses.length[None, rows, i],
                    self.on_all_poses.arm[None, rows, i, linkage.joints[0]],
                )
            )
        return found

    @cached_property
    def _closed_and_stroke(self) -> tuple[Array, Array]:
        closed, stroke = self.vector.strokes(self.x)
        return closed[None], stroke[None]

    def place(self, i: int, name: str) -> Array | None:
        """See ``Candidate``."""
        place = self.linkages[i].place(name)
        return None if place is None else np.array([place])

    def transmission(self, i: int) -> Array:
        """See ``Candidate``."""
        poses = self.vector.range_poses[i]
        assert poses is not None
        return self.linkages[i].transmission(poses)[0][None]


@dataclass(frozen=True, eq=False)
class Judge:
    """Objective and requirements of a problem, without derivatives."""

    problem: Problem

    @cached_property
    def poses(self) -> RigidPoses:
        """The workspace's and those of the joint ranges."""
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
        reference = reference_of(problem.machine, problem.requirements, RANGE_POSES)
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
        return Judge(Problem.of(self.problem.machine, some, limits_, self.problem.vector.vary))

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
        found = differential_evolution(
            task.cost,
            [(0.0, 1.0)] * size,
            init=population,
            maxiter=GENERATIONS,
            tol=0.0,
            polish=False,
            rng=np.random.default_rng(round_),
            callback=lambda *_: task.over,
        )
        population, round_ = found.population, round_ + 1
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
    problem, width, scale = (
        task.judge.problem,
        (task.high - task.low)[task.free],
        task.problem.dynamics.omega_squared_scale,
    )
    holding = holding_rows(problem, task.x(start))
    known: dict[bytes, tuple[Array, Array]] = {}

    def constraints(z: Array) -> tuple[Array, Array]:
        """Values ≥ 0 and their derivatives at the free variables and t."""
        x = task.x(z[:-1])
        if known and not problem.vector.closes(x):  # a line search went too far
            value, jacobian = next(iter(known.values()))
            return np.full_like(value, -10.0), jacobian
        if z.tobytes() not in known:
            task.evaluations += 1
            at = constraints_at(problem, x, holding)
            base, slopes = (
                part / scale
                for part in problem.dynamics.scaled_stiffness_and_gradient(x, rows, z[-1] * scale)
            )
            squared, vectors = np.linalg.eigh(base)
            slope = np.einsum("nik,vnij,njk->nkv", vectors, slopes, vectors)[:, :2].reshape(
                -1, len(x)
            )
            value = np.concatenate([squared[:, :2].ravel() - z[-1], at.values])
            jacobian = np.concatenate([slope, at.jacobian])[:, task.free] * width
            t = np.concatenate([-np.ones(len(slope)), np.zeros(len(at.values))])
            known.clear()
            known[z.tobytes()] = value, np.column_stack([jacobian, t])
        return known[z.tobytes()]

    def stop(*_: object) -> None:
        if task.over:
            raise StopIteration

    lowest = float(problem.dynamics.omega_squared(task.x(start), rows).min()) / scale
    found = minimize(
        lambda z: -z[-1],
        np.append(start, lowest),
        jac=lambda z: np.append(np.zeros(len(start)), -1.0),
        bounds=[(0.0, 1.0)] * len(start) + [(None, None)],
        constraints={
            "type": "ineq",
            "fun": lambda z: constraints(z)[0],
            "jac": lambda z: constraints(z)[1],
        },
        method="SLSQP",
        callback=stop,
        options={"maxiter": 100, "ftol": 1e-8},
    )
    return np.clip(found.x[:-1], 0, 1)


# --------------------------------------------------------------------------------------- the table


@dataclass(frozen=True, eq=False)
class Found:
    """What a method found, judged as a machine.

    ``frequency`` [Hz] is on the workspace's poses, ``refined`` off them.
    """

    method: str
    frequency: float
    refined: float
    slack: float
    seconds: float

    @classmethod
    def of(cls, method: str, problem: Problem, x: Array, seconds: float) -> Found:
        """Judged by what knows nothing of optimisers."""
        machine = built(problem, x)
        map_ = ad.frequency_map(machine, problem.workspace)
        checks = check(machine, problem.machine, problem.workspace, problem.requirements)
        lowest_ = float(map_.frame["f1_hz"].min())
        return cls(method, lowest_, map_.worst.frequency, min(c.slack for c in checks), seconds)

    @property
    def feasible(self) -> bool:
        """Whether all requirements are met."""
        return self.slack >= -FEASIBLE


def built(problem: Problem, x: Array) -> ad.Machine:
    """The machine at x with all its digits."""
    machine, sizes = problem.vector.with_pins(x), []
    for cylinder, (bore_area, annulus_area) in zip(
        machine.cylinders, problem.vector.areas(x), strict=False
    ):
        one = 4 / math.pi / cylinder.count
        bore, rod = math.sqrt(one * bore_area), math.sqrt(one * (bore_area - annulus_area))
        sizes.append(replace(cylinder, bore=bore, rod=rod))
    return replace(machine, cylinders=tuple(sizes))


def timed(action: Callable[[], ad.Design]) -> tuple[float, ad.Design]:
    """Least processor time [s] of two runs, and the last result."""
    seconds = math.inf
    for _ in range(2):
        start = time.process_time()
        design = action()
        seconds = min(seconds, time.process_time() - start)
    return seconds, design


def compared(name: str, vary: tuple[str, ...]) -> None:
    """One machine: a line of the table for every method."""
    machine = ad.load(name)
    workspace = ad.Workspace.grid(machine)
    _ = workspace.rigid
    seconds, design = timed(lambda: ad.optimize(machine, workspace, vary=vary))
    problem, today = design.problem, float(design.before.frame["f1_hz"].min())
    budget, first = RIVALS * seconds, name == MACHINES[0]
    ours = Found.of("co-design", problem, design.x, seconds)
    count = int((np.ptp(problem.bounds, axis=0) > 0).sum())
    print(
        f"{name}: {count} variables, {len(problem.dynamics.rows)} rows, today {today:.4f} Hz",
        flush=True,
    )
    told(ours, ours, today)
    best = 0.0
    for method in (evolution, adaptation, programming):
        longer = first and method is evolution
        task = Task(
            problem,
            LONGEST * seconds if longer else budget,
            ours.frequency if longer else math.inf,
        )
        method(task)
        in_time = [x for spent, _, x in task.trace if spent <= budget]
        x = in_time[-1] if in_time else problem.vector.start
        found = Found.of(METHODS[method.__name__], problem, x, min(task.spent, budget))
        told(found, ours, today)
        best = max(best, found.frequency if found.feasible else 0.0)
        if longer:
            raced(task, ours, seconds)
    print(
        f"  never below the best of the others: {judgement(best <= ours.frequency * (1 + ALIKE))}",
        flush=True,
    )
    if name in LEAST:
        gain = ours.frequency / today - 1
        print(f"  gain {gain:+.1%}, target {LEAST[name]:+.0%}: {judgement(gain >= LEAST[name])}")


def told(found: Found, ours: Found, today: float) -> None:
    """One line of the table."""
    figures = (
        f"{found.frequency:8.4f} Hz {found.frequency / today - 1:+7.2%}, off the grid"
        f" {found.refined:8.4f} Hz"
    )
    met = f"{'feasible' if found.feasible else 'infeasible'} (slack {found.slack:+.0e})"
    of_ours = f"{found.frequency / ours.frequency - 1:+.3%} of ours" if found is not ours else ""
    print(
        f"  {found.method:<24} {figures}  {met}  {found.seconds:6.1f} s  {of_ours}".rstrip(),
        flush=True,
    )


def raced(task: Task, ours: Found, seconds: float) -> None:
    """How long differential evolution took to what we found."""
    for share in (1 - CLOSE, 1 - 1e-6):
        times = [
            spent for spent, frequency, _ in task.trace if frequency >= share * ours.frequency
        ]
        ratio = (times[0] if times else task.spent) / seconds
        reached = f"after {ratio:.0f} ×" if times else f"not in {ratio:.0f} ×"
        words = f"differential evolution reached {share:.4%} of it {reached} our time"
        print(f"  {words}; target ≥ {FASTER} ×: {judgement(ratio >= FASTER)}", flush=True)


def judgement(reached: bool) -> str:
    """In a word."""
    return "ok" if reached else "MISSED"


def main() -> None:
    """Measure and print everything."""
    words = sys.argv[1:]
    vary = ("areas", "linkages" if "linkages" in words else "pins")
    for name in [word for word in words if word != "linkages"] or MACHINES:
        compared(name, vary)


if __name__ == "__main__":
    main()
