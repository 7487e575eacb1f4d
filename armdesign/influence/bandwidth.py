"""Bandwidth at the lowest pose of a map, as a quantity beside others: ``what_if(…, more=…)``.

The narrowest loop with one common gain, proportional and with pressure feedback. Gains of their
own are left out: their search does not answer small changes smoothly.
"""

from __future__ import annotations

import numpy as np

from armdesign.control.bandwidth_map import bandwidth_map
from armdesign.frequency.maps import FrequencyMap

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
