"""The bound's last certificate again, with ends rounded outward: what is proved of real numbers.

A bound rests on multipliers of some rows, and for every cylinder on cells that cover all its
designs, each with an upper bound on its term (``regions``). Multipliers are floats of any origin:
here their weights become Z = R Rᵀ in fractions, semidefinite to the last bit, and what no design
changes is summed in fractions too. The term is enclosed over every cell again in intervals whose
ends are rounded outward, by the same formulas of shapes; a cell that is then above what is stated
is halved, and what stays above counts. Of a catalogue's areas, which are exact numbers, a cell has
the pairs between its ends, which halves share, so that none is lost.

Inertia, gravity torques and their slopes are sums of products in floats: each entry may be wrong
by ``LOST`` of what it is made of, more than a thousand times what balls find of the links
(``tests/design/bound/test_ball_dynamics.py``), and the bound is for all of that. Scales and
volumes are taken wider by it, and oil with air has its modulus to within it.

Taken as they are: the numbers of the file and coefficients of shapes made of them, in floats;
which cells hold nothing that is allowed, and to which scales and volumes a cell shrinks, since
requirements are wider there by ``CONSTRAINT_TOLERANCE``, millions of times what floats lose; own
masses' share of the terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.branching import Maximum, halves
from armdesign.design.bound.cylinder_shape import Enclosure, Natural
from armdesign.design.bound.cylinder_spring import CylinderSpring
from armdesign.design.bound.cylinder_term import TOGETHER, Cells, CylinderTerm
from armdesign.design.bound.intervals import Interval, Outward, interval
from armdesign.design.bound.lagrangian import LagrangianDual, Multipliers
from armdesign.design.search.semidefinite import exactly, positive_product, rounded_up

LOST = 1e-12  # relative: more than floats lose where a formula is not taken outward
ABOVE = 1e-10  # of ω², by which a cell may lie above what is stated of it
HALVINGS = 4  # of cells that lie above that


@dataclass(frozen=True, eq=False)
class Proof:
    """Multipliers, and the most that each drive's term is at them, with the cells that show it."""

    dual: LagrangianDual
    multipliers: Multipliers
    maxima: tuple[Maximum, ...]


def certified(proof: Proof) -> float:
    """An upper bound on ω² over the reference of all designs of a proof's drives."""
    dual, given = proof.dual, proof.multipliers
    exact = positive_product(given.weight)
    diagonal = np.arange(given.weight.shape[1])
    up = np.frompyfunc(rounded_up, 1, 1)(exact[:, diagonal, diagonal]).astype(float)
    up[~given.weight.any(axis=(1, 2))] = 0.0  # rows that do not count
    exact[:, diagonal, diagonal] = exactly(up)
    pick = np.ix_(given.rows, np.array(dual.free), np.array(dual.free))
    mass, slope = dual.fixed.mass[pick], dual.fixed.slope[pick]
    lighter, steeper = lost(exact, mass, slope)
    budget, today = dual.budget
    multipliers = replace(
        given,
        weight=exact.astype(float),
        constant=(exact * exactly(slope)).sum()
        + steeper
        + (exactly(given.oil) * exactly(today)).sum() * Fraction(budget),
        light=((exact * exactly(mass)).sum() - lighter) * Fraction(dual.reference),
    )
    most = [
        replace(one, upper=most_of(term, one))
        for term, one in zip(dual.terms(multipliers), proof.maxima, strict=True)
    ]
    return dual.bound(multipliers, most)


def lost(weight: Array, mass: Array, slope: Array) -> tuple[Fraction, Fraction]:
    """Most that Σ ⟨Z, M⟩ and Σ ⟨Z, ∂g/∂q⟩ may be wrong by where each entry is wrong by ``LOST``.

    An entry of M is a sum of products no larger than √(M_ii M_jj); those of ∂g/∂q are measured by
    the largest of all. Arguments (n, k, k), weights in fractions.
    """
    size = np.abs(weight)
    root = np.sqrt(np.diagonal(mass, axis1=1, axis2=2))
    entries = exactly(root[:, :, None] * root[:, None])
    share = Fraction(LOST)
    steepest = Fraction(float(np.abs(slope).max(initial=0.0)))
    return share * (size * entries).sum(), share * size.sum() * steepest


def most_of(term: CylinderTerm, most: Maximum) -> float:
    """The most that a term is over the leaves of a maximum, rounded outward."""
    stated = most.upper + ABOVE * max(1.0, abs(most.upper))
    cells, known = most.leaves, -math.inf
    for step in range(HALVINGS):
        starts = range(0, len(cells.bound), TOGETHER)
        parts = [_upper(term, cells[k : k + TOGETHER]) for k in starts]
        upper = np.concatenate([part[1] for part in parts]) if parts else np.empty(0)
        above = upper > stated
        last = step == HALVINGS - 1
        known = max(known, float(upper[~above | last].max(initial=-math.inf)))
        if last or not above.any():
            break
        kept = np.concatenate([part[0] + k for k, part in zip(starts, parts, strict=True)])
        worse = kept[above]
        cells = term.upper(*halves(term.upper(cells.low[worse], cells.high[worse])))
    return known


def _upper(term: CylinderTerm, cells: Cells) -> tuple[Array, Array]:
    """Cells that may hold an allowed design, and an upper bound on the term over each."""
    limits = term.limits.at(np.flatnonzero(cells.useful.any(axis=0)))
    allowed = limits.allowed(cells.low, cells.high)
    kept, vertices = allowed.kept, allowed.volume
    low, high = cells.low[kept, :2], cells.high[kept, :2]
    nearest = term.shape.enclose(low, high)
    e = _enclosed(term, low, high)
    vertices = np.ascontiguousarray(vertices.T)
    # scales and volumes are solved for in floats
    scale = _wider(allowed.scale)
    volume = _wider(interval(vertices))
    plain = term.spring(nearest, scale, vertices, term.price[:, None])
    spring = _spring(term, e, scale, plain)
    slopes, whole = term.slopes(e, volume, spring)
    spread = Outward.like(slopes).spread(e.reach[:, None], 0)
    place = e.place.within(Interval(np.array(0.0), np.array(1.0)))
    natural = _value(term, place, e.rate, e.bend, e.arm, volume, spring)
    at = e.centre
    middle = _value(term, at.place, at.rate, at.bend, at.arm, volume, spring)
    around = np.where(whole, np.nextafter(middle.high + spread, np.inf), np.inf)
    total, stroke = Outward.like(np.fmin(natural.high, around)), e.stroke * scale
    upper = (total - _cost(term, stroke, volume)).high.max(axis=0)
    if allowed.oil is not None:
        oil = Outward.like(allowed.oil * (1 - LOST))
        paid = oil[:, 0] * term.price[0] + oil[:, 1] * term.price[1]
        others = _cost(replace(term, price=np.zeros(2)), stroke, volume)
        upper = np.fmin(upper, ((total - others) - paid).high.max(axis=0))
    return kept, np.where(np.isnan(upper), np.inf, upper)


def _wider(numbers: Interval) -> Interval:
    """Numbers > 0 that floats have lost some of."""
    return Outward(numbers.low * (1 - LOST), numbers.high * (1 + LOST))


def _enclosed(term: CylinderTerm, low: Array, high: Array) -> Enclosure:
    """The shape over boxes of b (m, 2)."""
    low, high = np.ascontiguousarray(low.T), np.ascontiguousarray(high.T)
    middle = (low + high) / 2
    reach = np.maximum((Outward.like(high) - middle).high, (middle - Outward.like(low)).high)
    boxes = Natural(term.shape, Outward(low, high))
    return Enclosure(boxes, Natural(term.shape, Outward.like(middle)), reach)


def _spring(
    term: CylinderTerm, e: Enclosure, scale: Interval, plain: CylinderSpring
) -> CylinderSpring:
    """A spring in intervals: its tangents are as good as any."""
    stiffening = [Outward.like(np.ones((len(term.weight), 1))) * s for s in plain.stiffening]
    if term.air is not None:
        stiffening = [s * Interval(np.array(1.0), np.array(1 + LOST)) for s in stiffening]
    if term.structure is None or plain.structure is None:
        return replace(plain, stiffening=tuple(stiffening), oil=Outward.like(plain.oil))
    t = Outward.like(1 - np.sqrt(plain.oil))
    soft = Outward.like(term.structure.compliance[:, None]) * term.structure.modulus
    return CylinderSpring(
        stiffening=tuple(stiffening),
        shift=term.structure.shift(e.rate_above_nothing, e.stroke * scale),
        oil=(1 - t).square(),
        structure=t.square() * scale.square() * soft.reciprocal(),
    )


def _value(
    term: CylinderTerm,
    place: Interval,
    rate: Interval,
    bend: Interval,
    arm: Interval,
    volume: Interval,
    spring: CylinderSpring,
) -> Interval:
    """Σ w k r² − G τ (v, m) at volumes (2, v, m)."""
    (cap, annulus), (dead_cap, dead_annulus) = spring.stiffening, term.dead_volumes(spring)
    weight = Outward.like(term.weight[:, None] * (1 + LOST))
    volumes = volume[0][:, None], volume[1][:, None]
    filled = (
        (place + spring.shift) * volumes[0] + dead_cap,
        (1 - place - spring.shift) * volumes[1] + dead_annulus,
    )
    with np.errstate(divide="ignore", invalid="ignore"):  # no oil left: no bound
        oil = cap * volumes[0].square() * filled[0].above(0.0).reciprocal()
        oil = oil + annulus * volumes[1].square() * filled[1].above(0.0).reciprocal()
        stiff = oil * (rate.square() * (weight * spring.oil))
        total = stiff[:, 2:].sum(axis=1)
    rest = -(bend * _torque(term)[:, None]).sum(axis=0)
    if spring.structure is not None:
        rest = rest + (arm.square() * (weight * spring.structure))[2:].sum(axis=0)
    return total + rest


def _torque(term: CylinderTerm) -> Interval:
    """G (n,), which is a sum in floats of no more than some dozen products."""
    lost = LOST * np.maximum(term.bend.size.max(initial=0.0), term.bend.size)
    return Outward(term.bend.low - lost, term.bend.high + lost)


def _cost(term: CylinderTerm, stroke: Interval, volume: Interval) -> Interval:
    """μ·v, less what barrel and rod add, (v, m)."""
    cap, annulus = volume[0], volume[1]
    cost = cap * term.price[0] + annulus * term.price[1]
    if not any(term.own):
        return cost
    per_stroke = stroke.reciprocal()
    rod = (cap - annulus).above(0.0)
    own = [interval(np.array(added * (1 + np.sign(added) * LOST))) for added in term.own]
    return cost - (cap * own[0] + rod * own[1]) * per_stroke
