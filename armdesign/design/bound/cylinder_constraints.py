"""Requirements of one cylinder alone, over boxes of shapes and swept volumes.

For a given shape a larger scale means more moment arm, dead length and thrust, but a more slender
rod: with v = A S the rod must keep v1 − v2 ≥ ℓ_max √(C S v1). Holding, lifting and digging are
torques, pressure × v ρ, and do not know the scale. The requirements themselves are in
``requirements/`` (``oil``, ``strength``, ``leverage``, ``torque``, ``holding``);
``test_branching_against_dense_sampling`` and ``test_limits_of_single_cylinders`` tie
the two statements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.design.bound.cylinder_areas import CylinderAreas
from armdesign.design.bound.cylinder_loads import Loads, loads_of
from armdesign.design.bound.cylinder_shape import LEAST, Enclosure, Shape
from armdesign.design.bound.drawn_lengths import DrawnLengths, largest
from armdesign.design.bound.intervals import Interval
from armdesign.design.bound.mass_enclosure import BarEnclosure
from armdesign.design.bound.shape_of_pins import shape_of
from armdesign.design.program.constraints import CONSTRAINT_TOLERANCE, least_rod_area_factor
from armdesign.design.program.problem import Problem
from armdesign.machine.file.schema import share_of

# of the largest moment arm: by what a parabola through its samples may rise above them
PEAK = 1e-3
BOXES = (24, 24, 1)  # of a region along b and scale, over which angles are compared
NO_LOADS = Loads(angle=np.empty(0), held=np.empty((2, 0)), place=np.empty(0, dtype=int))


@dataclass(frozen=True, eq=False, kw_only=True)
class AllowedBoxes:
    """Boxes that may hold an allowed design, and what it is like there.

    Attributes:
        kept: their indices (k,) among all boxes.
        scale: scales (k,).
        volume: vertices (k, v, 2) of a polygon around the swept volumes [m³].
        low, high: ends (k, 2) of the swept volumes; of the areas where they are of a catalogue.
        useful: angles of the shape after its ends (k, n) that may ask for most in a box or its
            parts; of no box those that never do.
        oil: least oil (k, 2) that is swept as built [m³]; None where lengths are on no grid.
    """

    kept: Array
    scale: Interval
    volume: Array
    low: Array
    high: Array
    useful: Flags
    oil: Array | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class CylinderConstraints:
    """Limits of one cylinder; sides are cap and annulus.

    Attributes:
        shape: the cylinder's, at the angles where requirements are looked at.
        areas: that it may have, > 0.
        volume: least and largest swept volumes (2, 2: ends, sides) [m³].
        rod: area [m²] of a rod that stays while its bore varies; 0 where it varies too, or neither
            does.
        dead_length: least closed length less stroke [m].
        arm: least moment arm [m/rad] at the first ``ranged`` angles of the shape, which stand for
            the joint's range.
        ranged: how many.
        buckling: C in rod area ≥ L √(C A1).
        torque: least area × largest moment arm (2,: sides) at the first ``ranged`` angles
            [m³/rad].
        end_torque: least area × moment arm (2, 2: closed and open, sides) at the ends [m³/rad].
        loads: that it must hold, at the last angles of the shape.
        supply, back: available pressure and the return's [Pa].
        drawn: the drawing's grid of its lengths, beside areas of a catalogue; None: on no grid.
    """

    shape: Shape
    areas: CylinderAreas
    volume: Array
    rod: float
    dead_length: float
    arm: float
    ranged: int
    buckling: float
    torque: Array
    end_torque: Array
    loads: Loads
    supply: float
    back: float
    drawn: DrawnLengths | None = None

    @property
    def others(self) -> Array:
        """Ends (2, 2) of what boxes (m, 5) have beside b and scale: volumes, or areas of pairs."""
        return self.volume if self.areas.pairs is None else self.areas.ends

    def within(self, low: Array, high: Array) -> CylinderConstraints:
        """The same in a part of the region, between ends (5,) of b, scale and others."""
        scale = float(low[2]), float(high[2])
        part = replace(self, shape=replace(self.shape, low=low[:2], high=high[:2], scale=scale))
        if self.areas.pairs is None:
            return replace(part, volume=np.stack([low[3:], high[3:]])).of_useful_angles()
        areas = self.areas.within(low[3:], high[3:])
        assert areas is not None  # ends of areas are ends of pairs
        return replace(part, areas=areas).of_useful_angles()

    def allowed(self, low: Array, high: Array) -> AllowedBoxes:
        """Boxes (m, 3) of b and scale, or (m, 5) with ``others``, that may hold a design.

        Ends of volumes count each on its own, so that a rod that stays is let go. A box is left
        out only where nothing can be allowed, so never for what is not a number.
        """
        kept, e, scale = self._placed(low, high)
        if self.areas.pairs is not None:
            return self._of_pairs(kept, e, scale, low[kept, 3:], high[kept, 3:])
        floor, top = (low[kept, 3:], high[kept, 3:]) if low.shape[1] > 3 else self.volume
        least = self._least_volumes(e, scale, floor)
        area = self.areas.ends
        most = np.minimum(top, area[1] * (e.stroke.high * scale.high)[:, None])
        # at scale 1; grows with its 3/2th power
        slender = e.wide.open.low * np.sqrt(e.stroke.low * self.buckling)
        scale = self._buildable(e, scale, least, most, slender)
        most = np.minimum(most, area[1] * (e.stroke.high * scale.high)[:, None])
        left = ~(np.any(least > most, axis=1) | (scale.low > scale.high))
        least, most, slender = least[left], most[left], slender[left] * scale.low[left] ** 1.5
        if self.rod > 0 and low.shape[1] == 3:
            vertices, possible = _around_rod(
                least, most, slender, (e.stroke * scale)[left] * self.rod
            )
        else:
            vertices, possible = _vertices(least, most, slender)
        left = np.flatnonzero(left)[possible]
        return AllowedBoxes(
            kept=kept[left],
            scale=scale[left],
            volume=vertices,
            low=vertices.min(axis=1),
            high=vertices.max(axis=1),
            useful=self._useful(e)[left],
        )

    def _placed(self, low: Array, high: Array) -> tuple[Array, Enclosure, Interval]:
        """Boxes of b and scale in which pins may be, their shapes and scales."""
        kept = np.arange(len(low))
        scale = Interval(low[:, 2], high[:, 2])
        if self.shape.pin_boxes is not None:
            scale = self.shape.pin_boxes.scales(low[:, :2], high[:, :2], scale)
            kept = np.flatnonzero(~(scale.low > scale.high))
        if self.drawn is not None:
            kept = kept[self.drawn.held(low[kept, :2], high[kept, :2])]
        e = self.shape.enclose(low[kept, :2], high[kept, :2])
        return kept, e, self._as_drawn(e, self._long_enough(e, scale[kept]))

    def _as_drawn(self, e: Enclosure, scale: Interval) -> Interval:
        """The scales, none where no stroke on the drawing's grid fits."""
        if self.drawn is None:
            return scale
        closed = e.wide.closed.high * scale.high
        stroke = self.built(e.stroke.low * scale.low, e, scale)
        room = self.drawn.closed(closed, self.drawn.stays(e.wide.b)) - self.dead_length
        fits = (stroke <= self.drawn.most) & (stroke <= room + self.drawn.allowance)
        return Interval(np.where(fits, scale.low, np.inf), scale.high)

    def built(self, stroke: Array, e: Enclosure, scale: Interval) -> Array:
        """Least strokes (…, m) on the drawing's grid, of no less than some over boxes (m,) [m]."""
        assert self.drawn is not None
        stays = self.drawn.stays(e.wide.b)
        closed, opened = e.wide.closed.high * scale.high, e.wide.open.low * scale.low
        return self.drawn.built(stroke, closed, opened, stays)

    def _of_pairs(
        self, kept: Array, e: Enclosure, scale: Interval, low: Array, high: Array
    ) -> AllowedBoxes:
        """The boxes ``kept`` in which a pair of areas, between ends (m, 0 or 2), may be allowed.

        Each pair has strokes of its own; their volumes lie between two v1 and two v2/v1.
        """
        pairs = self.areas.pairs
        assert pairs is not None
        inside = np.ones((len(pairs), len(low)), dtype=bool)
        if low.shape[1] > 0:
            each = pairs.T[..., None]
            inside = np.all((each >= low.T[:, None]) & (each <= high.T[:, None]), axis=0)
            some = inside.any(axis=1)
            pairs, inside = pairs[some], inside[some]
        whole, (cap, annulus) = scale, pairs.T[..., None]
        stroke, scale = self._of_each_pair(e, scale, pairs)
        possible = inside & ~((stroke.low > stroke.high) | (scale.low > scale.high))
        left = np.flatnonzero(possible.any(axis=0))

        def span(low: Array, high: Array) -> Interval:
            """Of what is possible (k,)."""
            return Interval(
                np.where(possible, low, np.inf).min(axis=0, initial=np.inf)[left],
                np.where(possible, high, -np.inf).max(axis=0, initial=-np.inf)[left],
            )

        volume, ratio = span(cap * stroke.low, cap * stroke.high), span(*2 * [annulus / cap])
        corners = [(v, r) for v in (volume.low, volume.high) for r in (ratio.low, ratio.high)]
        areas = [span(area, area) for area in (cap, annulus)]
        oil = None
        if self.drawn is not None:
            built = self.built(stroke.low, e, whole)
            swept = (area * built for area in (cap, annulus))
            oil = np.stack([span(one, one).low for one in swept], axis=1)
        return AllowedBoxes(
            kept=kept[left],
            scale=span(scale.low, scale.high),
            volume=np.stack([np.stack([v, v * r], axis=1) for v, r in corners], axis=1),
            low=np.stack([area.low for area in areas], axis=1),
            high=np.stack([area.high for area in areas], axis=1),
            useful=self._useful(e)[left],
            oil=oil,
        )

    def _of_each_pair(
        self, e: Enclosure, scale: Interval, pairs: Array
    ) -> tuple[Interval, Interval]:
        """Strokes and scales (p, m) that boxes of scales (m,) allow each pair of areas."""
        cap, annulus = pairs.T[..., None]
        with np.errstate(divide="ignore"):  # no buckling
            longest = (cap - annulus) / np.sqrt(self.buckling * cap)
        longest, own = longest / e.wide.open.low, e.stroke
        most = (self.volume[1] / pairs).min(axis=1)[:, None]
        if self.drawn is not None:
            most = np.minimum(self.drawn.fitting(most), self.drawn.most) + self.drawn.allowance
        scale = Interval(scale.low, np.minimum(scale.high, longest))
        stroke = Interval(
            np.maximum(own.low * scale.low, self._least_strokes(e, pairs)),
            np.minimum(own.high * scale.high, most),
        )
        return stroke, scale.within(Interval(stroke.low / own.high, stroke.high / own.low))

    def of_useful_pairs(self) -> CylinderConstraints | None:
        """The same with the pairs of areas that may be allowed somewhere; None if none may."""
        pairs = self.areas.pairs
        if pairs is None:
            return self
        _, e, scale = self._placed(*self.shape.cut())
        stroke, scale = self._of_each_pair(e, scale, pairs)
        possible = ~((stroke.low > stroke.high) | (scale.low > scale.high))
        areas = CylinderAreas.of_pairs(pairs[possible.any(axis=1)])
        return None if areas is None else replace(self, areas=areas)

    def of_useful_angles(self) -> CylinderConstraints:
        """The same without angles that ask for less than others do, wherever in the region."""
        useful = self.allowed(*self.shape.cut(BOXES)).useful
        return self.at(np.flatnonzero(useful.any(axis=0))) if len(useful) > 0 else self

    def at(self, angles: Array) -> CylinderConstraints:
        """The same at some of the shape's angles after its ends, by their ascending indices."""
        ranged = self.ranged - 2
        first, loads = angles[angles < ranged], angles[angles >= ranged] - ranged
        return replace(
            self, shape=self.shape.at(angles), ranged=2 + len(first), loads=self.loads[loads]
        )

    def _useful(self, e: Enclosure) -> Flags:
        """Angles after the ends (m, n) that may ask for most in boxes of a shape.

        Others have neither the least nor the largest moment arm there, nor a load of a place that
        can ask for most.
        """
        if e.is_point:
            return np.ones((e.reach.shape[1], len(self.shape.constant) - 2), dtype=bool)
        arm, size = e.wide.arm.above(LEAST), e.rate_above_nothing
        arm, ranged = arm[: self.ranged], size[: self.ranged]
        useful = arm.low <= arm.high.min(axis=0)
        if self.torque.any():
            useful |= ranged.high >= ranged.low.max(axis=0)
        return np.concatenate([useful[2:], self.loads.greatest(size[self.ranged :])]).T

    def _long_enough(self, e: Enclosure, scale: Interval) -> Interval:
        """The scales at which moment arm and dead length may suffice."""
        low = np.maximum(scale.low, self.arm / e.wide.arm.high[: self.ranged].min(axis=0))
        spare = e.wide.closed.high - e.stroke.low
        with np.errstate(divide="ignore", invalid="ignore"):
            needed = self.dead_length / spare
        if self.dead_length > 0:
            return Interval(np.where(spare <= 0, np.inf, np.maximum(low, needed)), scale.high)
        return Interval(low, np.where(spare < 0, np.minimum(scale.high, needed), scale.high))

    def _least_volumes(self, e: Enclosure, scale: Interval, floor: Array) -> Array:
        """Swept volumes (m, 2) that torques and loads need at least, from a floor up."""
        least = self.areas.ends[0] * (e.stroke.low * np.minimum(scale.low, scale.high))[:, None]
        cap, annulus = np.maximum(np.maximum(least, self._turning(e).T), floor).T
        push, pull = self._held(e)
        for _ in range(2):
            cap = np.maximum(
                cap, np.where(push > 0, push + self.back * annulus, 0.0) / self.supply
            )
            annulus = np.maximum(
                annulus, np.where(pull > 0, pull + self.back * cap, 0.0) / self.supply
            )
        return np.stack([cap, annulus], axis=1)

    def _least_strokes(self, e: Enclosure, pairs: Array) -> Array:
        """Strokes (p, m) that pairs of areas (p, 2) need at least for torques and loads."""
        areas = pairs.T[..., None]
        least = (self._turning(e)[:, None] / areas).max(axis=0)
        for force, own, other in zip(self._held(e), areas, areas[::-1], strict=True):
            area = np.maximum(self.supply * own - self.back * other, 0.0)
            with np.errstate(divide="ignore", invalid="ignore"):  # no load on no area
                least = np.fmax(least, force / area)
        return np.asarray(least)

    def _turning(self, e: Enclosure) -> Array:
        """Swept volumes (2, m) that torques need at least."""
        rate = e.rate.high
        most = rate[: self.ranged].max(axis=0)
        if self.drawn is not None and self.drawn.pin is not None:  # exact at a place of a pin
            at = np.flatnonzero(np.all(e.reach == 0, axis=0))
            most[at] = self.drawn.peaks(e.centre.b.low[:, at].T) / e.stroke.low[at] * (1 - PEAK)
        least = self.torque[:, None] / most
        return np.maximum(least, (self.end_torque[..., None] / rate[:2, None]).max(axis=0))

    def _held(self, e: Enclosure) -> Array:
        """Pressure times swept volume (2, m) by which loads push and pull."""
        return self.loads.most(e.rate.high[self.ranged :])

    def _buildable(
        self, e: Enclosure, scale: Interval, least: Array, most: Array, slender: Array
    ) -> Interval:
        """The scales at which areas are not too large and rods not too thin for the volumes."""
        low = np.maximum(scale.low, (least / self.areas.ends[1]).max(axis=1) / e.stroke.high)
        high = np.minimum(scale.high, (most / self.areas.ends[0]).min(axis=1) / e.stroke.low)
        with np.errstate(divide="ignore", invalid="ignore"):
            rod = np.maximum(most[:, 0] - least[:, 1], 0.0) / np.sqrt(most[:, 0])
            return Interval(low, np.fmin(high, (rod / slender) ** (2 / 3)))


def _vertices(least: Array, most: Array, slender: Array) -> tuple[Array, Flags]:
    """Corners (k, 5, 2) of the hull of least ≤ v ≤ most, v2 ≤ v1 − slender √v1; where any are."""

    def cap_for(annulus: Array) -> Array:
        return np.asarray((slender + np.sqrt(slender**2 + 4 * annulus)) ** 2 / 4)

    (low, floor), high = least.T, most[:, 0]
    low = np.maximum(low, cap_for(floor))
    top = np.minimum(most[:, 1], high - slender * np.sqrt(high))
    possible = ~((low > high) | (floor > top))
    low, floor, high, top, slender = (part[possible] for part in (low, floor, high, top, slender))
    knee = np.clip(cap_for(top), low, high)
    corner = np.clip(low - slender * np.sqrt(low), floor, top)
    cap = np.stack([low, low, knee, high, high], axis=1)
    return np.stack([cap, np.stack([floor, corner, top, top, floor], axis=1)], axis=2), possible


def _around_rod(least: Array, most: Array, slender: Array, rod: Interval) -> tuple[Array, Flags]:
    """Corners (k, 6, 2) where v1 − v2 is the volume (k,) of a rod that stays, ≥ slender √v1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        stout = np.fmin(np.inf, (rod.high / slender) ** 2)
    a, b = (
        np.maximum(least[:, 0], least[:, 1] + rod.low),
        np.minimum(most[:, 0], most[:, 1] + rod.high),
    )
    b = np.minimum(b, stout)
    c, d = np.maximum(least[:, 1], a - rod.high), np.minimum(most[:, 1], b - rod.low)
    possible = ~((a > b) | (c > d))
    a, b, c, d, thin, thick = (part[possible] for part in (a, b, c, d, rod.low, rod.high))
    cap = np.stack([a, a, np.minimum(b, d + thin), b, b, np.minimum(b, c + thick)], axis=1)
    annulus = np.stack([c, np.minimum(d, a - thin), d, d, np.maximum(c, b - thick), c], axis=1)
    return np.stack([cap, annulus], axis=2), possible


def cylinder_constraints(
    problem: Problem,
    i: int,
    bars: Sequence[BarEnclosure] = (),
    alone: bool = True,
    drawn: bool = False,
) -> CylinderConstraints | None:
    """Limits of cylinder ``i`` under ``bars``, each wider by ``CONSTRAINT_TOLERANCE``; or None.

    Without loads where it does not move its joint ``alone``. With lengths on the drawing's grid
    where they are ``drawn`` and sizes are of a catalogue.
    """
    machine, r, cylinder = problem.machine, problem.requirements, problem.machine.cylinders[i]
    vector, poses, more = problem.vector, problem.vector.range_poses[i], 1 + CONSTRAINT_TOLERANCE
    if poses is None:
        return None
    arms, today = np.abs(vector.arms_today[i]), vector.areas_today[i]
    all_angles = poses.q[:, machine.linkages[i].joints[0]]
    sign = float(np.sign(vector.arms_today[i][0]))
    torque, end_torque = _torques(problem, i)
    # of all poses one has the largest arm; the least may be looked for at some
    ranged = poses.q[:: 1 if torque.any() else 10, machine.linkages[i].joints[0]]
    loads = loads_of(problem, i, bars, sign) if alone else NO_LOADS
    shape = shape_of(problem, i, np.concatenate([ranged, loads.angle]))
    areas = CylinderAreas.of(problem, i)
    if shape is None or areas is None:
        return None
    oil = share_of(r.oil_each_share, cylinder.name)
    bore_varies, rod_varies = vector.resized[i]
    limits = CylinderConstraints(
        shape=shape,
        areas=areas,
        volume=np.stack([np.zeros(2), oil * today * cylinder.stroke * more]),
        rod=float(today[0] - today[1]) if bore_varies and not rod_varies else 0.0,
        dead_length=cylinder.dead_length - CONSTRAINT_TOLERANCE * cylinder.stroke,
        arm=share_of(r.moment_arm_share, cylinder.name) * float(arms.min()) / more,
        ranged=2 + len(ranged),
        buckling=least_rod_area_factor(problem, i) / more**2,
        torque=torque * (1 - PEAK) / more,
        end_torque=end_torque / more,
        loads=replace(loads, held=loads.held / more),
        supply=cylinder.available_pressure(machine.supply),
        back=machine.supply.return_pressure,
        drawn=(
            DrawnLengths.of(problem, i, shape_of(problem, i, all_angles))
            if drawn and areas.pairs is not None
            else None
        ),
    )
    useful = limits.of_useful_pairs()
    return None if useful is None else useful.of_useful_angles()


def _torques(problem: Problem, i: int) -> tuple[Array, Array]:
    """Area × moment arm that cylinder ``i`` keeps: the largest (2,), and at the ends (2, 2)."""
    r, name = problem.requirements, problem.machine.cylinders[i].name
    arms, areas = np.abs(problem.vector.arms_today[i]), problem.vector.areas_today[i]
    share = np.full(2, share_of(r.torque_share, name))
    if name in r.digging:
        share[0] = max(share[0], r.digging_share)
    closed = 0 if problem.vector.arms_today[i][0] > 0 else -1
    ends = arms[[closed, -1 - closed]]
    of_ends = share_of(r.end_torque_share, name) * np.outer(ends, areas)
    return share * largest(arms[None]) * areas, of_ends
