"""An upper bound on the worst frequency that no pins and areas, or no areas, can exceed.

Areas are any, or a catalogue's sizes, where a problem has one and pins move.

The lowest ω² of a design is at most a sum of terms, one per cylinder, for any multipliers of rows
and oil (``lagrangian``). The most that a term can be under the cylinder's own requirements is
enclosed from above by branch and bound on intervals (``branching``), which no local optimum
can fool, and what is stated in the end once more in intervals rounded ``outward``. Every round of
better multipliers gives a bound; the lowest counts. The duality gap between designs and their
mixtures shrinks where the designs are taken in parts (``regions``).

A subset of rows, and of joints with the others held, keeps the bound valid: fewer poses to be good
at, and a stiffer arm.

Areas alone, for given pins: stiffness, convex in the areas, is replaced by its chord over the box
of allowed areas, and so is buckling, which is reverse-convex; the multipliers of that semidefinite
programme certify the bound, see ``dual_bound``. Own masses are affine in the areas: see
``bound_of_moving_mass``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.columns import joint_drives
from armdesign.design.bound.lagrangian import LagrangianDual
from armdesign.design.bound.mass_enclosure import bar_enclosures
from armdesign.design.bound.regions import lowest_bound
from armdesign.design.catalogue.sizes import relative_areas
from armdesign.design.program.constraints import (
    CONSTRAINT_TOLERANCE,
    constraints_at,
    convex_relaxation,
)
from armdesign.design.program.problem import Problem
from armdesign.design.search.semidefinite import (
    bound_of_moving_mass,
    contradicted,
    dual_bound,
    exact_certificate,
    padded,
    programme,
)
from armdesign.design.search.sequential_sdp import Search
from armdesign.errors import InfeasibleError
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import hertz
from armdesign.journal.finished import Form, all_finished
from armdesign.processes import in_processes

# the bound of areas: programmes with more poses each
ROUNDS_OF_AREAS = 6
JOINING = 8  # poses at a time
CLOSE_FOR_AREAS = 1e-4  # of ω², between the bound and the lowest pose, where rounds end


def areas_bound(search: Search) -> float | None:
    """Worst frequency [Hz] that no areas can exceed with a search's pins; None where unknown."""
    try:
        enclosed = convex_relaxation(search.problem)
    except InfeasibleError:  # by less than the search lets pass
        return None
    if enclosed is None:
        return None
    linear, low, high = enclosed
    bound = _lowest_dual_bound(
        search,
        (*padded(linear.values, linear.jacobian), np.zeros(len(low)), high - low),
        (low, high),
    )
    return hertz(bound * search.reference) if math.isfinite(bound) else None


def _lowest_dual_bound(
    search: Search, room: tuple[Array, ...], ends: tuple[Array, Array]
) -> float:
    """The lowest bound on ω² over the reference of a few programmes of few poses each."""
    problem, x, rows, bound = search.problem, search.x, search.rows, math.inf
    squared = problem.dynamics.omega_squared(x, rows)
    near = squared.min() if problem.vector.moving_masses else 0.0
    base, slopes = (
        part / search.reference
        for part in problem.dynamics.scaled_stiffness_chords(*ends, rows, x, near)
    )
    light = problem.dynamics.scaled_fixed_mass(x, rows)
    chosen = np.flatnonzero(np.isin(rows, search.active(squared)))
    for _ in range(ROUNDS_OF_AREAS):
        one = programme(len(chosen), base.shape[1], len(room[0]), len(ends[0]))
        try:
            step = one.solve(base[chosen], slopes[:, chosen], *room)
        except InfeasibleError:  # the solver gave up: what is known so far still holds
            break
        of_chords = dual_bound(step, base[chosen], slopes[:, chosen], *room)
        of_moving_masses = bound_of_moving_mass(
            of_chords, near / search.reference, exact_certificate(step), light[chosen]
        )
        bound = min(bound, of_moving_masses)
        lowest = np.linalg.eigvalsh(base + np.einsum("vnij,v->nij", slopes, step.change))[:, 0]
        worse = np.setdiff1d(np.argsort(lowest)[:JOINING], chosen)
        if len(worse) == 0 or lowest.min() > bound * (1 - CLOSE_FOR_AREAS):
            break
        chosen = np.concatenate([chosen, worse])
    return bound


WATCHED = 300  # lowest rows that may enter, of a corner of the bands
ALONE = 2  # ends of oil, structure and springs bounded one by one: those at which x gains least
SAME_AREA = 1e-6  # relative: a size of a catalogue
USEFUL = 2.0  # times what a design reaches, up to which a bound is stated beside it
# relative: more than own masses' terms and the way to Hz lose; all else is rounded ``outward``
ROUNDING = 1e-9
SPARE = 1e-6  # of ω², by which a wanted bound is sought lower, for what rounding adds


@dataclass(frozen=True, kw_only=True)
class Certificate:
    """No design within boxes and requirements has a worst frequency above ``frequency`` [Hz].

    Attributes:
        frequency: on the poses and load cases of the problem [Hz]; infinite where nothing is
            proved.
        held: cylinders that it takes as rigid, because nothing is known about all of their
            designs.
        assumptions: what it takes for granted, in words.
        refused: why nothing is proved, in words; else empty.
    """

    frequency: float
    held: tuple[str, ...]
    assumptions: tuple[str, ...]
    refused: str = ""

    def above(self, reached: float) -> Certificate:
        """The bound as it may be stated beside an allowed design that reaches so much [Hz].

        Never below it: raised to it, where only rounding lies between; where more does, the proof
        is wrong.
        """
        if not contradicted(self.frequency, reached):
            return replace(self, frequency=max(self.frequency, reached))
        words = (
            f"the one found, {self.frequency:.3f} Hz, lies below {reached:.3f} Hz, which a design"
            " reaches"
        )
        return replace(self, frequency=math.inf, refused=words)

    def useful(self, reached: float) -> Certificate:
        """The bound, or none where it says next to nothing of a design that reaches so much."""
        if not math.isfinite(self.frequency) or self.frequency <= USEFUL * reached:
            return self
        rigid = f" with the {' and the '.join(self.held)} cylinder rigid" if self.held else ""
        words = (
            f"no useful one was found: {self.frequency:.3g} Hz{rigid} is more than"
            f" {USEFUL:g} times the {reached:.3f} Hz that this design reaches"
        )
        return replace(self, frequency=math.inf, refused=words)


def certificate_within_bands(problem: Problem, x: Array, rows: Array) -> Certificate | None:
    """The bound on all designs of a problem, for whatever objective within its bands.

    None where none is known. Where only structure and masses differ within the bands, multipliers
    weigh poses at all corners. Else, what no design exceeds at one corner bounds the least gain:
    of each end of oil and structure the corner counts at which x gains least.

    Args:
        problem: the design problem.
        x: a good design, as in ``certificate_of``.
        rows: rows that may enter.
    """
    return certificates_within_bands([Search(problem=problem, x=x, rows=rows)])[0]


def certificates_within_bands(
    searches: Sequence[Search],
    workers: int = 1,
    wanted: Sequence[float] | None = None,
    drawn: bool = False,
) -> list[Certificate | None]:
    """``certificate_within_bands`` of several problems, on so many processes.

    Each is sought until it is no more than is ``wanted`` of it [Hz], or as long as it falls. With
    lengths on the drawing's grid, of designs that are ``drawn``, it is less.
    """
    enough: Sequence[float | None] = wanted or [None] * len(searches)

    def identity(k: int) -> Any:
        search = searches[k]
        problem, x, rows = search.problem.identity, search.x.tolist(), search.rows.tolist()
        return [problem, x, rows, enough[k], *(["drawn"] if drawn else [])]

    def compute(numbers: list[int]) -> Iterator[tuple[int, Certificate | None]]:
        some = [(searches[k], enough[k]) for k in numbers]
        tasks = (
            partial(_computed_within_bands, s.problem, s.x, s.rows, w, drawn) for s, w in some
        )
        yield from zip(numbers, in_processes(tasks, workers, ordered=True), strict=True)

    def read(_: int, answer: Mapping[str, Any]) -> Certificate | None:
        if not answer:
            return None
        words = {name: tuple(answer[name]) for name in ("held", "assumptions")}
        return Certificate(**{**answer, **words})

    form = Form(write=lambda _, bound: asdict(bound) if bound else {}, read=read)
    return all_finished("bound", len(searches), identity, compute, form)


def _computed_within_bands(
    problem: Problem, x: Array, rows: Array, wanted: float | None, drawn: bool
) -> Certificate | None:
    """``certificate_within_bands``, computed until it is no more than is ``wanted`` [Hz]."""
    dynamics = problem.dynamics
    if not dynamics.corners.gain:
        return certificate_of(problem.softest, x, rows, wanted, drawn)
    corners, squared = dynamics.corners, dynamics.omega_squared(x)
    least = [squared[dynamics.rows.corner == k].min() for k in range(len(corners.all))]
    if _alike(problem):
        all_own = [np.flatnonzero(dynamics.rows.corner == k) for k in range(len(corners.all))]
        lowest_of = [own[np.argsort(squared[own])[:WATCHED]] for own in all_own]
        watched = np.unique(np.concatenate([rows, *lowest_of]))
        return certificate_of(problem, x, watched, wanted, drawn)
    ends = range(len(corners.ends))
    poorest = [min(np.flatnonzero(corners.end == end), key=least.__getitem__) for end in ends]
    bounds = []
    for k in sorted(sorted(poorest, key=least.__getitem__)[:ALONE]):
        own = np.flatnonzero(dynamics.rows.corner == k)
        lowest = own[np.argsort(squared[own])[:WATCHED]]
        watched = np.union1d(lowest, rows[dynamics.rows.corner[rows] == k]) - own[0]
        ratio = math.sqrt(corners.weights[k])
        here = None if wanted is None else wanted * ratio
        if bound := certificate_of(problem.at_corner(int(k)), x, watched, here, drawn):
            bounds.append(replace(bound, frequency=bound.frequency / ratio))
            if wanted is not None and bounds[-1].frequency <= wanted:
                break
    return min(bounds, key=lambda bound: bound.frequency, default=None)


def _alike(problem: Problem) -> bool:
    """Whether pins vary, no own masses do, and corners differ but in structure and masses."""
    bands = problem.dynamics.corners.bands
    masses = {"payload": Bands().payload, "link_mass": Bands().link_mass}
    plain = replace(bands, structure=None, structures=None, **masses)
    moving = bool(problem.vector.moving)
    return moving and problem.vector.moving_masses is None and plain == Bands()


def certificate_of(
    problem: Problem, x: Array, rows: Array, wanted: float | None = None, drawn: bool = False
) -> Certificate | None:
    """The bound on the worst frequency of all designs of a problem with exact oil and structure.

    None where none is known. Where no pin varies it is the search's own.

    Args:
        problem: the design problem.
        x: a good design: multipliers are sought around it. The bound holds whatever it is.
        rows: rows that may enter, such as those that a search has watched.
        wanted: bound [Hz] that is low enough; None: one near to what x reaches.
        drawn: whether designs have lengths on the drawing's grid, which x need not.

    Bars that weigh are enclosed by intervals over all pins and areas. None is known if no cylinder
    has a joint to itself and pins that ``shape_of_pins`` knows. A bound that x exceeds, though it
    is allowed and has sizes of the catalogue, is refused.
    """
    bound = _before_check(problem, x, rows, wanted, drawn)
    allowed = constraints_at(problem, x).values.min() >= -CONSTRAINT_TOLERANCE
    if bound is None or drawn or not (allowed and _has_offered_sizes(problem, x)):
        return bound
    return bound.above(hertz(float(problem.dynamics.omega_squared(x).min())))


def _has_offered_sizes(problem: Problem, x: Array) -> bool:
    """Whether all cylinders whose sizes vary have one of the catalogue's, if there is any."""
    if not problem.grid.sizes:
        return True
    for i, cylinder in enumerate(problem.machine.cylinders):
        own, sizes = x[2 * i : 2 * i + 2], problem.grid.sizes
        offered = [relative_areas(cylinder, bore, rod) for bore, rod in sizes]
        same = np.isclose(own, offered, rtol=SAME_AREA, atol=0.0).all(axis=1)
        if any(problem.vector.resized[i]) and not same.any():
            return False
    return True


def _before_check(
    problem: Problem, x: Array, rows: Array, wanted: float | None, drawn: bool
) -> Certificate | None:
    """``certificate_of``, whatever x reaches."""
    if not problem.vector.moving:
        known = areas_bound(Search(problem=problem, x=x, rows=rows))
        if known is not None:
            return Certificate(frequency=known, held=(), assumptions=_assumptions(problem, ()))
    bars = bar_enclosures(problem)
    if bars is None or problem.dynamics.corners.proportional:
        return None
    driving = joint_drives(problem, bars, drawn)
    if not driving:
        return None
    dual = LagrangianDual.start(problem, driving, x, rows, bars)
    if wanted is not None:
        wanted = (2 * math.pi * wanted) ** 2 * (1 - SPARE) / dual.reference
    best = lowest_bound(dual, wanted)
    if not math.isfinite(best):
        return None
    driven = {d.cylinder for d in driving}
    held = tuple(c.name for i, c in enumerate(problem.machine.cylinders) if i not in driven)
    return Certificate(
        frequency=hertz(best * dual.reference) * (1 + ROUNDING),
        held=held,
        assumptions=_assumptions(problem, held, drawn),
    )


def _assumptions(problem: Problem, held: tuple[str, ...], drawn: bool = False) -> tuple[str, ...]:
    words = [
        "today's workspace and load cases",
        "pins in their boxes, and requirements as the optimiser takes them",
        (
            "dead volumes in proportion to the areas"
            if problem.dynamics.corners.proportional
            else "dead volumes as they are"
        ),
        "moment arms that keep their sign between the poses looked at",
    ]
    if problem.vector.moving_masses is not None:
        words.append("own masses in proportion to areas and lengths")
    bands, exact = problem.dynamics.corners.bands, Bands()
    if (bands.payload, bands.link_mass) != (exact.payload, exact.link_mass):
        words.append("masses as they are tried within their bands")
    if problem.vector.moving:
        words.append(f"each requirement wider by {CONSTRAINT_TOLERANCE:g}")
        if problem.grid.sizes:
            grid = "lengths on the drawing's grid" if drawn else "strokes and pins on no grid"
            words.append(f"sizes of the catalogue, {grid}")
    words += [f"the {name} cylinder rigid" for name in held]
    return tuple(words)
