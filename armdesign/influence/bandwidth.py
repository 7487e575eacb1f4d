"""Bandwidth at the lowest pose of a map, or at any, as a quantity beside others.

The narrowest loop with one common gain, proportional and with pressure feedback. Gains of their
own are left out: their search does not answer small changes smoothly.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.control.bandwidth_map import bandwidth_map
from armdesign.control.map_parts import ControlOptions
from armdesign.control.pose_bandwidth import pose_bandwidth
from armdesign.frequency.maps import FrequencyMap
from armdesign.machine.machine import Machine

SCHEMES = ("proportional", "damped")


def bandwidths(frequencies: FrequencyMap) -> dict[str, tuple[float, str]]:
    """Bandwidth [Hz] of each scheme at the lowest pose of a map's grid, by name.

    Raises:
        SimulationError: an actuator has no valve.
        PoseError: no controller works there.
    """
    frame, workspace = frequencies.frame, frequencies.workspace
    lowest = frame.iloc[int(frame["f1_hz"].to_numpy().argmin())]
    q = lowest[list(frequencies.machine.joints)].to_numpy(dtype=float)
    nearest = int(np.abs(workspace.q - q).sum(axis=1).argmin())
    loops = bandwidth_map(frequencies.machine, workspace.subset(np.array([nearest])))
    own = loops.frame[loops.frame["payload"] == lowest["payload"]].iloc[0]
    return {f"bandwidth.{scheme}": (float(own[f"{scheme}_hz"]), "Hz") for scheme in SCHEMES}


def at_pose(machine: Machine, q: Array, payload: str, damping: float | None = None) -> Array:
    """Bandwidth [Hz] of each scheme at a pose q (nq,) under a load case (2,).

    Raises:
        ArmDesignError: as ``pose_bandwidth``.
    """
    loaded = machine.with_payload(payload)
    widths = pose_bandwidth(loaded, loaded.at(q[None]), ControlOptions(damping=damping))
    return np.array([getattr(widths, scheme) for scheme in SCHEMES])
