"""Which shaper a move needs: for modes at its end, over its way, or over the whole workspace."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from operator import mul

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.motion.shapers import TOLERATED, Shaper
from armdesign.motion.way import WayModes, way_modes

AT_END = {"zv": Shaper.zv, "zvd": Shaper.zvd, "ei": Shaper.ei}
KINDS = ("none", *AT_END, "band", "workspace")
HIGHEST = 1 / math.sqrt(TOLERATED)  # of modes that count, over the lowest


def shaper_for(
    kind: str,
    way: WayModes,
    masses: Sequence[float],
    modes: int | None = None,
    damping: float | None = None,
) -> tuple[Shaper, Array | None]:
    """The shaper of a kind for a move, and of each leg the paces of its modes: ``trajectory``.

    Args:
        kind: one of ``KINDS``.
        way: modes along the move.
        masses: of the payload that may be met [kg], the machine's own first.
        modes: how many of the lowest modes it is made for; None: all that count. A step of
            acceleration makes a mode swing with 1/ω²: those above 4.5 times the lowest, 1/√5 %,
            do not.
        damping: ratio that it is made for; None: of each mode at the end of the move, of a band
            the least of them.

    Raises:
        ArmDesignError: no such kind, or no mode that rings at the end.
    """
    if kind not in KINDS:
        raise ArmDesignError(f"shaper {kind}", "there is no such kind", choose(kind, KINDS))
    if not len(way.end):
        fault = "no mode rings where it ends, so large is friction: there is nothing to plan for"
        raise ArmDesignError(f"{way.machine.name}: move", fault, "lower it, or use ad.simulate")
    if kind == "none":
        return Shaper.none(), None
    count = int((way.end <= HIGHEST * way.end[0]).sum()) if modes is None else modes
    ratios = way.damping[:count] if damping is None else np.full(len(way.end[:count]), damping)
    if kind == "workspace":
        return workspace_shaper(frequency_map(way.machine), float(ratios.min()), count), None
    if kind == "band":
        loaded = (way.machine.with_payload(mass) for mass in masses[1:])
        others = (way_modes(machine, way.legs) for machine in loaded)
        met = [one.frequencies[..., :count] for one in (way, *others)]
        low, high = min(one.min() for one in met), max(one.max() for one in met)
        return Shaper.band(float(low), float(high), float(ratios.min())), None
    pairs = zip(way.end.tolist(), ratios.tolist(), strict=False)
    shaper = reduce(mul, (AT_END[kind](frequency, ratio) for frequency, ratio in pairs))
    return shaper, way.paces(count)


@checked
def workspace_shaper(
    frequencies: FrequencyMap, damping: float = 0.0, modes: int = 1, residual: float = TOLERATED
) -> Shaper:
    """The shaper for all poses and load cases of a frequency map.

    From the lowest frequency, refined off the grid, to the highest of the ``modes`` lowest modes
    on it. The map may be of any workspace: one of a region makes a shaper for that region.

    Args:
        frequencies: over the poses and load cases.
        damping: ratio of all modes.
        modes: how many of the lowest modes it is made for.
        residual: most that may be left at any of them.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> shaper = ad.workspace_shaper(ad.frequency_map(machine, workspace))
        >>> print(shaper.name, f"{shaper.low:.1f} to {shaper.high:.1f} Hz, {shaper.delay:.3f} s")
        band of 5 impulses 7.5 to 16.6 Hz, 0.139 s
    """
    count = len(frequencies.machine.arm.coordinates)
    highest = frequencies.frame[f"f{min(modes, count)}_hz"].max()
    return Shaper.band(frequencies.worst.frequency, float(highest), damping, residual)
