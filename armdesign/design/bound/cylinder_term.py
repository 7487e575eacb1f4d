"""One cylinder's term of the upper bound, enclosed over cells.

With swept volumes v = A S of both sides the term is

    Σ_j w_j k_j r_j² − G_j τ_j − μ·v,    k r² = β (v1² ρ²/(v1 σ + D1) + v2² ρ²/(v2 (1 − σ) + D2)),

w ≥ 0 and D dead volumes. Air softens each chamber to β(p) at its static pressure: over a cell and
all volumes allowed in it β is taken at the greatest pressure that there can be. For a given shape
it is then convex in v, so its maximum lies at a vertex of any polygon around the allowed (v1, v2).
Over a cell of shapes it is enclosed twice, naturally and in the mean value form.

Of a catalogue's areas v = A S takes few values: cells are then of b, scale and areas, and hold the
volumes between two v1 and two v2/v1, of one pair a line.

Tangents of structure in series (``cylinder_spring``) leave a term of the same form, and a constant
times r², which the scale enters. Air and tangents are near only for small ranges of volumes, so
cells are of volumes too there, unless they are of areas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from armdesign.arrays import Array, Flags, Numbers
from armdesign.design.bound.cylinder_constraints import AllowedBoxes, CylinderConstraints
from armdesign.design.bound.cylinder_shape import Enclosure, Natural, Shape
from armdesign.design.bound.cylinder_spring import Air, CylinderSpring, Stiffening, Structure
from armdesign.design.bound.intervals import Interval, interval, total

TINY = 1e-12  # [m³] of oil
TOGETHER = 400  # cells in one pass, whose arrays stay in the processor's cache


@dataclass(frozen=True, eq=False, kw_only=True)
class Cells:
    """Cells (m, 3) of b and scale, with air or structure (m, 5) of swept volumes too.

    Of areas instead where they are of a catalogue.

    Upper bound, the swept volumes (m, 2) that it is for, what each axis adds to it, and angles of
    the limits that count in it (m, n), see ``AllowedBoxes``.
    """

    low: Array
    high: Array
    bound: Array
    volume: Array
    added: Array
    useful: Flags
    source: Array  # (m,) index among the cells passed to ``CylinderTerm.upper``

    def __getitem__(self, rows: Array | slice) -> Cells:
        return Cells(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


@dataclass(frozen=True, eq=False, kw_only=True)
class CylinderTerm:
    """The term to be maximised: weights at the shape's angles, prices of the swept volumes."""

    shape: Shape
    limits: CylinderConstraints
    weight: Array  # (n,) w β ≥ 0
    bend: Interval  # (n,) G
    price: Array  # (2,) μ
    dead: Array  # (2,) dead volumes of oil [m³]
    hoses: Array  # (2,) what hoses add, as oil without air [m³]
    air: Air | None = None
    structure: Structure | None = None
    # what barrel and rod add per bore and rod area, at most [1/m²]
    own: Sequence[float] = 0.0, 0.0

    def upper(self, low: Array, high: Array) -> Cells:
        """Upper bounds over cells, infinite if not known; cells with nothing allowed left out."""
        starts = range(0, max(len(low), 1), TOGETHER)
        parts = [self._upper(low[k : k + TOGETHER], high[k : k + TOGETHER]) for k in starts]
        sources = (
            replace(part, source=k + part.source) for k, part in zip(starts, parts, strict=True)
        )
        return together(*sources)

    def _upper(self, low: Array, high: Array) -> Cells:
        """Upper bounds over some cells."""
        designs, allowed = np.array_equal(low, high), self.limits.allowed(low, high)
        scale, vertices = allowed.scale, np.ascontiguousarray(allowed.volume.T)
        low, high = low[allowed.kept], high[allowed.kept]
        e = self.shape.enclose(low[:, :2], high[:, :2])
        costs = self._costs(e.stroke * scale)
        spring = self.spring(e, scale, vertices, costs)
        bound, spread, known = self.enclosed(e, vertices, costs, spring)
        bound = np.where(np.isnan(bound), np.inf, bound)
        rows, best = np.arange(len(low)), bound.argmax(axis=0)
        most = bound[best, rows]
        if allowed.oil is not None:  # as built it costs no less, whatever volumes are best
            unpaid = (bound + _paid(self.price, vertices)).max(axis=0)
            most = np.minimum(most, unpaid - allowed.oil @ self.price)
        ends = [[low[:, :2], scale.low], [high[:, :2], scale.high]]
        if low.shape[1] > 3:
            ends[0], ends[1] = [*ends[0], allowed.low], [*ends[1], allowed.high]
        added = np.zeros(low.shape)
        if not designs:  # which nobody halves
            at = spread[:, best, rows], vertices[:, best, rows], known[best, rows]
            added[:, :3] = self._added(e, scale, *at, spring).T
            if low.shape[1] > 3:
                added[:, 3:] = self._added_by_others(e, allowed, *at[1:], spring).T
        return Cells(
            low=np.column_stack(ends[0]),
            high=np.column_stack(ends[1]),
            bound=most,
            volume=vertices[:, best, rows].T,
            added=added,
            useful=allowed.useful,
            source=allowed.kept,
        )

    def _costs(self, stroke: Interval) -> Array:
        """Least cost of the swept volumes (2, m): oil's, less what barrel and rod add."""
        with np.errstate(divide="ignore"):  # a stroke of nothing
            barrel, rod = (
                added / (stroke.low if added > 0 else stroke.high) for added in self.own
            )
        return np.stack([self.price[0] - barrel - rod, self.price[1] + rod])

    def enclosed(
        self, e: Enclosure, volume: Array, costs: Array, spring: CylinderSpring
    ) -> tuple[Array, Array, Flags]:
        """Upper bounds (v, m) at swept volumes (2, v, m) of some price (2, m).

        Also what b adds to the mean value form (2, v, m), and whether it holds (v, m).
        """
        if e.is_point:
            spread, known = np.zeros(volume.shape), self._filled(e, volume, spring)[1]
        else:
            slopes, known = self.slopes(e, volume, spring)
            spread = slopes * e.reach[:, None]
        mean_value = np.where(
            known, self._value(e.centre, volume, costs, spring) + total(spread, 0), np.inf
        )
        return np.minimum(self._natural(e, volume, costs, spring), mean_value), spread, known

    def spring(self, e: Enclosure, scale: Interval, volume: Array, costs: Array) -> CylinderSpring:
        """Oil and structure over cells of some scales (m,) and volumes (2, v, m) of costs (2, m).

        The tangent is taken at the volumes that are best at the centre.
        """
        stiffening = self._stiffening(e, volume)
        if self.structure is None:
            return CylinderSpring(stiffening=stiffening)
        middle = (scale.low + scale.high) / 2
        spring = CylinderSpring(
            stiffening=stiffening,
            shift=self.structure.shift(e.rate_above_nothing, e.stroke * scale),
        )
        volume = np.concatenate([volume, volume.mean(axis=1, keepdims=True)], axis=1)
        place, stroke = e.centre.place.low, e.centre.stroke.low * middle
        t = self.structure.yielding(self._oil(place, place, volume, spring), stroke)
        soft = (self.structure.compliance * self.structure.modulus)[:, None]
        # k/(1 + c k) = t/c
        stiff = self.weight[:, None] * (e.centre.rate.low * stroke) ** 2 / soft
        value = (t * stiff).sum(axis=1) - _paid(costs, volume)
        best = np.nan_to_num(value, nan=-np.inf).argmax(axis=0)
        t = t[best, np.arange(len(soft))[:, None], np.arange(len(best))]
        return replace(spring, oil=(1 - t) ** 2, structure=t**2 * scale.high**2 / soft)

    def _stiffening(self, e: Enclosure, volume: Array) -> Stiffening:
        """Largest bulk moduli of both chambers over oil's alone, over volumes (2, v, m)."""
        if self.air is None:
            return 1.0, 1.0
        return self.air.stiffening(e.rate_above_nothing, volume.min(axis=1), volume.max(axis=1))

    def _added_by_others(
        self,
        e: Enclosure,
        allowed: AllowedBoxes,
        volume: Array,
        known: Flags,
        spring: CylinderSpring,
    ) -> Array:
        """Rough share of volumes or areas of a cell in its bound (2, m), at its best volumes."""
        if self.limits.areas.pairs is None:
            others = self._by_volume(e, allowed, volume, spring)
        else:
            others = self._by_area(e, allowed, volume, spring)
        # elsewhere nothing is known of the shape yet
        return np.where(known, others, 0.0)

    def _by_volume(
        self, e: Enclosure, allowed: AllowedBoxes, best: Array, spring: CylinderSpring
    ) -> Array:
        """Rough share of each volume's ends (2, m) through air's pressure and the tangent.

        ``best`` (2, m) are the volumes of the bound.
        """
        rate, scale, added = e.rate_above_nothing, allowed.scale, np.zeros(best.shape)
        least, most = allowed.volume.min(axis=1).T, allowed.volume.max(axis=1).T
        if self.air is not None:
            square = self.weight @ e.rate.high**2
            for side in (0, 1):
                soft, stiff = (self.air.stiffening(rate, end, most)[side] for end in (most, least))
                added[side] = square * most[side] * (stiff - soft).max(axis=0)
        if self.structure is not None:
            place, stroke = e.centre.place.low, e.centre.stroke.low * (scale.low + scale.high) / 2
            oil = self._oil(place, place, best[:, None], spring)[0]
            t = self.structure.yielding(oil, stroke)
            with np.errstate(invalid="ignore"):  # no oil left
                # of the tangent, over β r²/S²
                excess = oil * (t + np.sqrt(spring.oil) - 1) ** 2 / t
            added += (self.weight @ (excess * e.centre.rate.low**2)) * (1 - least / most)
        return added

    def _by_area(
        self, e: Enclosure, allowed: AllowedBoxes, best: Array, spring: CylinderSpring
    ) -> Array:
        """Rough share of each area's ends (2, m) in the stiffness at volumes (2, m)."""
        with np.errstate(invalid="ignore"):  # no oil left, or an area from zero on
            value = self._value(e.centre, best[:, None], np.zeros_like(best), spring)
            return np.abs(value) * (allowed.high / allowed.low - 1).T

    def _added(
        self,
        e: Enclosure,
        scale: Interval,
        spread: Array,
        volume: Array,
        known: Flags,
        spring: CylinderSpring,
    ) -> Array:
        """Rough share of each axis of a cell in its bound (3, m).

        Including how b and scale change the volumes that the limits allow.
        """
        plain = replace(spring, stiffening=(1.0, 1.0))
        value = np.abs(self._value(e.centre, volume[:, None], np.zeros_like(volume), plain)[0])
        by_stroke = value * e.wide.stroke_slope.size * e.reach / e.stroke.low
        by_scale = 0.25 * value * (scale.high / scale.low - 1)
        if spring.structure is not None:
            of_structure = self._of_structure(e.centre.arm.low**2, spring)
            by_scale = by_scale + of_structure * (1 - (scale.low / scale.high) ** 2)
        added = np.vstack([spread + by_stroke, by_scale])
        return np.where(known, added, np.vstack([e.reach, np.zeros(len(value))]))

    def _natural(self, e: Enclosure, volume: Array, costs: Array, spring: CylinderSpring) -> Array:
        """Upper bound (v, m) at swept volumes (2, v, m), everything at its end."""
        empty, full = np.maximum(e.place.low, 0.0), np.minimum(e.place.high, 1.0)
        oil = self._oil(empty, full, volume, spring)
        value = self._sum(oil, e.rate.square().high, e.bend, volume, costs, spring)
        return value + self._of_structure(e.arm.square().high, spring)

    def _value(
        self, centre: Natural, volume: Array, costs: Array, spring: CylinderSpring
    ) -> Array:
        """The term (v, m) at the centres of cells."""
        oil = self._oil(centre.place.low, centre.place.low, volume, spring)
        value = self._sum(oil, centre.rate.low**2, centre.bend, volume, costs, spring)
        return value + self._of_structure(centre.arm.low**2, spring)

    def _oil(self, first: Array, last: Array, volume: Array, spring: CylinderSpring) -> Array:
        """Oil k S²/β (v, n, m) [m³], the piston at ``first`` (cap) and at ``last`` (annulus)."""
        (cap, annulus), dead = spring.stiffening, self.dead_volumes(spring)
        push, pull = volume[:, :, None]
        filled = (
            (first + spring.shift.low) * push + dead[0],
            (1 - last - spring.shift.high) * pull + dead[1],
        )
        with np.errstate(divide="ignore", invalid="ignore"):  # no oil left: no bound
            return np.asarray(
                cap * push**2 / np.maximum(filled[0], 0.0)
                + annulus * pull**2 / np.maximum(filled[1], 0.0)
            )

    def _sum(
        self,
        oil: Array,
        square: Array,
        bend: Interval,
        volume: Array,
        costs: Array,
        spring: CylinderSpring,
    ) -> Array:
        """Σ w k r² − G τ − μ·v, of k the oil's share."""
        with np.errstate(invalid="ignore"):
            stiff = (oil * (self.weight[:, None] * square * spring.oil)).sum(axis=1)
        bent = (bend * self.bend[:, None]).low.sum(axis=0)
        return np.asarray(stiff - bent - _paid(costs, volume))

    def _of_structure(self, arm_squared: Array, spring: CylinderSpring) -> Array:
        """Structure's share (m,) of Σ w k r²."""
        if spring.structure is None:
            return np.zeros(arm_squared.shape[1])
        return np.asarray((self.weight[:, None] * spring.structure * arm_squared).sum(axis=0))

    def dead_volumes(self, spring: CylinderSpring) -> tuple[Numbers, Numbers]:
        """Dead volumes (n, …) with hoses as oil that has air [m³]."""
        each = np.ones((len(self.weight), 1))
        whole = [s if isinstance(s, Interval) else s * each for s in spring.stiffening]
        return self.dead[0] + self.hoses[0] * whole[0], self.dead[1] + self.hoses[1] * whole[1]

    def _filled(
        self, e: Enclosure, volume: Numbers, spring: CylinderSpring
    ) -> tuple[list[tuple[Interval, Array]], Flags]:
        """Oil (v, n, m) in cap and annulus, each with half of what is dead, and ``known``.

        That is whether slopes hold over the cells: also for a piston beyond its ends.
        """
        chambers, known = [], e.wide.whole
        places = e.place + spring.shift.low, 1 - e.place - spring.shift.high
        volumes = volume[0][:, None], volume[1][:, None]
        for v, share, dead in zip(volumes, places, self.dead_volumes(spring), strict=True):
            filled, half = share * v + dead, interval(dead).high / 2
            known = known & np.all(filled.low[:, 2:] > half[2:], axis=1)
            chambers.append((filled, half))
        return chambers, known

    def slopes(self, e: Enclosure, volume: Numbers, spring: CylinderSpring) -> tuple[Array, Flags]:
        """Largest absolute derivatives by b (2, v, m) over the cells, at swept volumes (2, v, m).

        And where they hold (v, m).
        """
        volumes = volume[0][:, None], volume[1][:, None]
        chambers, known = self._filled(e, volume, spring)
        springs, changes = [], []
        for v, (filled, half), stiff in zip(volumes, chambers, spring.stiffening, strict=True):
            emptiness = filled.above(half + TINY).reciprocal()
            springs.append(emptiness * (stiff * (v * v)))
            changes.append((emptiness * v).square() * (stiff * v))
        weight = self.weight[:, None] * spring.oil
        by_rate = e.rate * (springs[0] + springs[1]) * (2 * weight)
        by_place = e.rate.square() * (changes[1] - changes[0]) * weight
        bend = (e.wide.bend_slope * self.bend[:, None]).sum(axis=1)  # whatever G is
        by_b = []
        for k in (0, 1):
            oil = by_rate * e.wide.rate_slope[k] + by_place * e.wide.place_slope[k]
            change = oil.sum(axis=1) - bend[k]
            if spring.structure is not None:
                doubled = 2 * self.weight[:, None] * spring.structure
                change = change + (e.arm * e.wide.arm_slope[k] * doubled).sum(axis=0)
            by_b.append(change.size)
        return np.stack(by_b), known


def _paid(costs: Array, volume: Array) -> Array:
    """What swept volumes (2, v, m) cost (v, m), at costs (2,) or (2, m)."""
    return np.asarray(costs[0] * volume[0] + costs[1] * volume[1])


def together(*parts: Cells) -> Cells:
    """All cells of several parts."""
    names = [f.name for f in fields(Cells)]
    return Cells(**{name: np.concatenate([getattr(one, name) for one in parts]) for name in names})
