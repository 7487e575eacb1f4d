"""Regions: parts of the designs, each with a lower bound of its own; the largest counts.

At any multipliers a bound weighs several poses, and its multipliers mix designs: where one place
of a pin is best at one pose and another place at another, the mixture takes a share of both, which
no cylinder can be. That is the duality gap. In two regions with the cut between the two places
each mixture has one of them only, and multipliers of its own (branch and bound: Falk and Soland,
Management Science 15, 1969). The region of the largest bound is cut, across the coordinate along
which the mixture gains most over its mean.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.design.bound.branching import Maximum
from armdesign.design.bound.columns import LEAST, Columns, JointDrive
from armdesign.design.bound.lagrangian import LagrangianDual, Multipliers
from armdesign.design.bound.outward import Proof, certified
from armdesign.errors import InfeasibleError

REGIONS = 24  # looked at
# rounds of multipliers and branching of the first and of the others; fewer with air in the oil,
# which makes two more numbers of every cylinder
ROUNDS, ROUNDS_OF_PARTS, AIRY = 6, 3, 2
CLOSE = 3e-3  # of ω², between bound and mixtures, where rounds end
NEARER = 0.5  # of a mixture's gain over the design at hand, where cutting pays more than rounds
# tolerances of branching, of ω²: at first, and where a bound may then be low enough
VAGUE, COARSE, FINE = 0.02, 0.01, 1e-3
VAGUE_OF_REST = 0.25  # the first too, of what a region's bound exceeds its mixtures by
# of frequency, over the design at hand: where cutting ends; for each cylinder, where rounds end
ENOUGH, PLENTY = 0.024, 0.0033
SLICE = 0.1  # of a region, the least that a cut leaves on either side
MIXED = 1e-3  # share of a mixture that counts
TINY = 1e-12
PART = 0.02  # share of a mixture, of sizes, that is worth a cut
Cut: TypeAlias = tuple[float, int, int, float]  # gain, drive, axis and place
STROKE = 5  # axis of the strokes that are built, after those of places


@dataclass(frozen=True, eq=False, kw_only=True)
class Region:
    """Designs of the drives of ``dual``, none of which exceeds ``bound`` [ω² over the reference].

    Attributes:
        multipliers: the last ones, which mix its designs; None where there are none.
        maxima: of each drive's term at them.
        proof: what the bound rests on.
    """

    dual: LagrangianDual
    bound: float
    multipliers: Multipliers | None = None
    maxima: tuple[Maximum, ...] = ()
    proof: Proof | None = None

    def improved(
        self, dual: LagrangianDual, multipliers: Multipliers, maxima: Sequence[Maximum]
    ) -> Region:
        """The region with another bound on its designs, if that is lower."""
        bound = dual.bound(multipliers, maxima)
        if bound >= self.bound:
            return self
        return replace(self, bound=bound, proof=Proof(dual, multipliers, tuple(maxima)))


def lowest_bound(dual: LagrangianDual, wanted: float | None = None) -> float:
    """The lowest bound on ω² that is found, over the reference; infinite where none is.

    With what ends rounded outward add to it (``certified``). Sought until it is no more than is
    ``wanted``, over the reference too; by default until it is near to what the design at hand
    reaches.
    """
    reached = max(dual.reached, 0.0)
    enough = reached * (1 + ENOUGH) ** 2
    plenty = reached * (1 + PLENTY * len(dual.drives)) ** 2
    if wanted is not None:
        enough = plenty = wanted
    regions = [_refined(Region(dual=dual, bound=math.inf), ROUNDS, plenty, enough)]
    looked = 1
    while looked < REGIONS and math.isfinite(regions[0].bound) and regions[0].bound > enough:
        if (cut := _cut(regions[0])) is None:
            break
        parts = [_part(regions[0], *cut, upper, enough) for upper in (False, True)]
        looked += 2
        regions = [*regions[1:], *(part for part in parts if part.bound > -math.inf)]
        if not regions:  # though a design is at hand
            return math.inf
        regions.sort(key=lambda region: -region.bound)
    return max(max(r.bound, certified(r.proof)) if r.proof else math.inf for r in regions)


def _refined(region: Region, rounds: int, plenty: float, enough: float) -> Region:
    """The region with better multipliers, until they are close or its bound is low: plenty.

    Where it is ``enough`` they end too, if less than half of its gap can still be closed. Where
    even mixtures exceed that, cutting does more than rounds and finer branching. Branching is
    vague at first, and ends there where what designs reach rules out that the bound is lowered, or
    where it is low enough and nothing else is plenty.
    """
    dual = region.dual
    for _ in range(AIRY if dual.problem.machine.fluid.air > 0 else rounds):
        try:
            multipliers = dual.converged()
        except InfeasibleError:  # the solver gave up: what is known so far still holds
            break
        mixed = multipliers.mixed
        gain = mixed - min(dual.reached, enough)
        known = plenty if mixed < plenty else region.bound
        left = 0.1 * max(known - mixed, mixed - enough)  # to rounds, or to cuts
        tolerance = float(np.clip(left, FINE, COARSE))
        far = VAGUE_OF_REST * (region.bound - mixed) if math.isfinite(region.bound) else 0.0
        maxima = tuple(dual.maxima(multipliers, max(VAGUE, far)))
        decided = plenty == enough and dual.bound(multipliers, maxima) <= enough
        possible = dual.bound(multipliers, _reached(maxima))
        last = possible - mixed < max(CLOSE, NEARER * gain)
        if possible < (region.bound if last else known) and not decided:
            maxima = tuple(
                dual.maximum(multipliers, k, tolerance, begun) for k, begun in enumerate(maxima)
            )
        region = replace(region, multipliers=multipliers, maxima=maxima)
        region = region.improved(dual, multipliers, maxima)
        bound = region.bound
        close = max(CLOSE, (1.0 if bound <= enough else NEARER) * gain)
        found = all(math.isfinite(most.value) for most in maxima)
        # branching may find more in other rounds, where a bound that is low enough counts alone
        least = bound if plenty == enough else dual.bound(multipliers, _reached(maxima))
        if bound <= plenty or least - mixed < close or not found:
            break
        dual.learn(multipliers, maxima)
    return region


def _reached(maxima: Sequence[Maximum]) -> list[Maximum]:
    """Maxima that are no more than what designs reach."""
    return [replace(most, upper=most.value) for most in maxima]


def _cut(region: Region) -> tuple[int, int, float] | None:
    """Drive, coordinate and place where the mixture gains most; None where it does not.

    What it gains along a coordinate is its mean value less the value at its mean, all other
    coordinates at their means (Jensen).
    """
    multipliers, dual = region.multipliers, region.dual
    if multipliers is None:
        return None
    columns, shares = multipliers.columns, multipliers.mixture
    sizes: list[Cut] = []
    strokes: list[Cut] = []
    gains: list[Cut] = []
    for k, drive in enumerate(dual.drives):
        own = np.flatnonzero((columns.drive == k) & (shares > MIXED))
        weight, places = shares[own] / shares[own].sum(), columns.place[own]
        mean = weight @ places
        trials = np.tile(mean, (6, len(own), 1))  # at the mean, and along each coordinate
        for axis in range(5):
            trials[1 + axis, :, axis] = places[:, axis]
        values = dual.values(_columns(k, drive, trials), multipliers).reshape(6, -1)
        at_mean, *along = values @ weight
        low, high = drive.region
        inside = (mean > low) & (mean < high)
        place = np.clip(mean, *(low + share * (high - low) for share in (SLICE, 1 - SLICE)))
        gains += [(along[a] - at_mean, k, a, place[a]) for a in range(5) if inside[a]]
        if drive.limits.drawn is not None:
            sizes += _between_sizes(k, columns[own], weight)
            strokes += _between_strokes(k, columns[own], weight, multipliers)
            # steps hide what is gained: the widest mixture is cut last of all
            spread = weight @ np.abs(places - mean) / np.maximum(high - low, TINY)
            gains += [(TINY * spread[a], k, a, place[a]) for a in range(5) if inside[a]]
    best = max(sizes or strokes or gains, default=(0.0, 0, 0, 0.0))
    return best[1:] if best[0] > 0 else None


def _between_sizes(k: int, columns: Columns, weight: Array) -> list[Cut]:
    """Cuts between sizes of a catalogue that a mixture of designs of drive ``k`` mixes."""
    cuts: list[Cut] = []
    for axis in (3, 4):
        areas = columns.place[:, axis]
        mean = float(weight @ areas)
        low = areas < mean
        share = float(min(weight[low].sum(), weight[~low].sum()))
        if share > PART:
            cuts.append((share * float(np.ptp(areas)) / mean, k, axis, mean))
    return cuts


def _between_strokes(
    k: int, columns: Columns, weight: Array, multipliers: Multipliers
) -> list[Cut]:
    """A cut between strokes of the drawing's grid that a mixture of designs of drive ``k`` mixes.

    It gains the oil by which the least stroke on the grid above the mean exceeds that.
    """
    built, mean = columns.oil[:, 0] / columns.place[:, 3], weight @ columns.place[:, 3:]
    middle = float(weight @ built)
    above, below = built[built > middle + LEAST], built[built < middle - LEAST]
    if min(len(above), len(below)) == 0:
        return []
    place = (above.min() + below.max()) / 2
    return [(float(multipliers.oil @ mean) * (above.min() - middle), k, STROKE, float(place))]


def _columns(k: int, drive: JointDrive, places: Array) -> Columns:
    """Columns of drive ``k`` at places (…, 5) of its region, on no grid."""
    flat = places.reshape(-1, 5)
    volume = drive.volume(flat)
    return Columns(drive=np.full(len(flat), k), place=flat, volume=volume, oil=volume)


def _part(region: Region, k: int, axis: int, place: float, upper: bool, enough: float) -> Region:
    """The designs of a region on one side of a place, bounded; of −∞ where none is allowed.

    First by the multipliers of the whole, at which only drive ``k`` changes; branching finds it a
    design with which the search goes on.
    """
    assert region.multipliers is not None
    drive = region.dual.drives[k]
    if axis == STROKE:
        drive = drive.of_strokes(*((place, math.inf) if upper else (0.0, place)))
    else:
        low, high = drive.region
        (low if upper else high)[axis] = place
        drive = drive.within(low, high)
    dual = region.dual.within(k, drive, region.multipliers)
    tolerance = float(np.clip(0.2 * (region.bound - enough), FINE, COARSE))
    maxima = list(region.maxima)
    maxima[k] = dual.maximum(region.multipliers, k, tolerance)
    if maxima[k].upper == -math.inf:
        return replace(region, bound=-math.inf)
    part = Region(dual=dual, bound=region.bound, proof=region.proof)
    part = part.improved(dual, region.multipliers, maxima)
    if part.bound <= enough or not math.isfinite(maxima[k].value):
        return part
    dual.join(k, maxima[k])
    return _refined(part, ROUNDS_OF_PARTS, enough, enough)
