"""Which shaper a move needs: for modes at its end, over its way, or over the whole workspace."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import pairwise
from operator import mul

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.frequency.modes import natural_modes
from armdesign.machine.machine import Machine
from armdesign.motion.shapers import TOLERATED, Shaper
from armdesign.simulation.linearization import linearize

AT_END = {"zv": Shaper.zv, "zvd": Shaper.zvd, "ei": Shaper.ei}
KINDS = ("none", *AT_END, "band", "workspace")
POINTS = 21  # of each leg at which frequencies are looked at


def end_modes(machine: Machine, q: Array) -> tuple[Array, Array]:
    """Natural frequencies [Hz] and damping ratios at a pose (nq,), ascending, by ``linearize``.

    Dry friction, which has no derivative at rest, is left out.
    """
    model = linearize(machine, q)
    return model.natural_frequencies, model.damping_ratios


def shaper_for(
    kind: str,
    machine: Machine,
    poses: Array,
    masses: Sequence[float],
    modes: int = 2,
    damping: float | None = None,
) -> Shaper:
    """The shaper of a kind for a move.

    Args:
        kind: one of ``KINDS``.
        machine: under its load.
        poses: at which the move rests (k, nq) [rad, m].
        masses: of the payload that may be met [kg], the machine's own first.
        modes: how many of the lowest modes it is made for.
        damping: ratio that it is made for; None: of each mode at the end of the move, of a band
            the least of them.

    Raises:
        ArmDesignError: no such kind.
    """
    if kind not in KINDS:
        raise ArmDesignError(f"shaper {kind}", "there is no such kind", choose(kind, KINDS))
    if kind == "none":
        return Shaper.none()
    frequencies, ratios = (values[:modes] for values in end_modes(machine, poses[-1]))
    ratios = ratios if damping is None else np.full(len(ratios), damping)
    if kind == "workspace":
        return workspace_shaper(frequency_map(machine), float(ratios.min()), modes)
    if kind == "band":
        low, high = _way_band(machine, poses, masses, modes)
        return Shaper.band(low, high, float(ratios.min()))
    pairs = zip(frequencies.tolist(), ratios.tolist(), strict=True)
    return reduce(mul, (AT_END[kind](frequency, ratio) for frequency, ratio in pairs))


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


def _way_band(
    machine: Machine, poses: Array, masses: Sequence[float], modes: int
) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of some modes over the legs of a move and payloads."""
    shares = np.linspace(0.0, 1.0, POINTS)[:, None]
    way = np.concatenate([a + shares * (b - a) for a, b in pairwise(poses)])
    loaded = [machine, *(machine.with_payload(mass) for mass in masses[1:])]
    of_all = np.concatenate([natural_modes(one.at(way)).frequencies[:, :modes] for one in loaded])
    return float(of_all.min()), float(of_all.max())
