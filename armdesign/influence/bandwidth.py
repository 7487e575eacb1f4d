"""Bandwidth at the lowest pose of a map, or at any, as a quantity beside others.

The narrowest loop with one common gain, proportional and with pressure feedback. Gains of their
own are left out: their search does not answer small changes smoothly. The common ones are found
exactly for this, so that bandwidths differ from those of a map, mostly by less than 3 %, and by
more where two loss factors allow almost the same gains.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.control.map_parts import ControlOptions
from armdesign.control.pose_bandwidth import pose_bandwidth
from armdesign.control.tuning import EXACT
from armdesign.frequency.maps import FrequencyMap
from armdesign.machine.machine import Machine

SCHEMES = ("proportional", "damped")


def bandwidths(
    frequencies: FrequencyMap, damping: float | None = None
) -> dict[str, tuple[float, str]]:
    """Bandwidth [Hz] of each scheme at the lowest pose of a map's grid, by name.

    ``damping`` is a ratio of all modes in place of the file's damping.

    Raises:
        ArmDesignError: as ``pose_bandwidth``.
    """
    frame = frequencies.frame
    lowest = frame.iloc[int(frame["f1_hz"].to_numpy().argmin())]
    q = lowest[list(frequencies.machine.joints)].to_numpy(dtype=float)
    widths = at_pose(frequencies.machine, q, str(lowest["payload"]), damping)
    pairs = zip(SCHEMES, widths.tolist(), strict=True)
    return {name_of(scheme): (width, "Hz") for scheme, width in pairs}


def name_of(scheme: str) -> str:
    """Name of the bandwidth of a scheme among other quantities."""
    return f"bandwidth.{scheme}"


def at_pose(machine: Machine, q: Array, payload: str, damping: float | None = None) -> Array:
    """Bandwidth [Hz] of each scheme at a pose q (nq,) under a load case (2,).

    Raises:
        ArmDesignError: as ``pose_bandwidth``.
    """
    loaded = machine.with_payload(payload)
    widths = pose_bandwidth(loaded, loaded.at(q[None]), ControlOptions(damping=damping), EXACT)
    return np.array([getattr(widths, scheme) for scheme in SCHEMES])
