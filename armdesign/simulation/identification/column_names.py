"""Names of the columns of a recording: what they measure, in which unit, of which part.

``<cylinder>_cap_bar`` (or ``head``), ``<cylinder>_rod_bar`` (or ``annulus``)
    Chamber pressures; also in MPa, kPa, Pa, psi.
``<cylinder>_pin_to_pin_mm``, ``<cylinder>_length_mm``, ``<joint>_deg``
    What tells the pose.
``…_deg_per_s``, ``…_mm_per_s``, ``…_m_per_s2`` and others
    Speeds and accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.errors import SimulationError
from armdesign.simulation.identification.recording import Recording
from armdesign.simulation.identification.windows import strongest
from armdesign.units import bar

PRESSURES = {"bar": bar, "MPa": 1e6, "kPa": 1e3, "Pa": 1.0, "psi": 6894.757}
KINDS = (
    tuple(PRESSURES),
    ("deg_per_s", "rad_per_s", "mm_per_s", "m_per_s", "rpm"),
    ("m_per_s2", "mm_per_s2", "g", "rad_per_s2", "deg_per_s2"),
)
SIDES = {"cap": "cap", "head": "cap", "rod": "annulus", "annulus": "annulus"}
LENGTHS = ("_pin_to_pin_mm", "_length_mm")
INCLINED = ("inclin", "tilt_sensor", "_imu_")


def strongest_column(recording: Recording) -> str:
    """The pressure that rings most; if there is none, the speed, or the acceleration."""
    if len(recording.time) < 2:
        raise SimulationError(recording.source, "holds no samples", "give a row per instant")
    step = float(np.median(np.diff(recording.time)))
    for units in KINDS:
        sizes = {
            name: strongest(step, values[np.isfinite(values)])[1]
            for name, values in recording.columns.items()
            if unit_of(name, units) and np.sum(np.isfinite(values)) > 1
        }
        if sizes:
            return max(sizes, key=lambda name: sizes[name])
    problem = f"no column is a pressure, speed or acceleration ({', '.join(recording.columns)})"
    remedy = "name the column, or end the names in a unit as _bar, _deg_per_s, _m_per_s2"
    raise SimulationError(recording.source, problem, remedy)


def unit_of(name: str, units: Sequence[str]) -> str:
    """Which of the units a column's name ends in, the longest; empty if in none."""
    fitting = [unit for unit in units if name.endswith(f"_{unit}")]
    longer = [unit for kind in KINDS for unit in kind if name.endswith(f"_{unit}")]
    best = max(longer, key=len, default="")
    return best if best in fitting else ""


def sides_of(part: Recording) -> dict[tuple[str, str], str]:
    """Columns of pressures by cylinder and side."""
    columns: dict[tuple[str, str], str] = {}
    for name in part.columns:
        unit = unit_of(name, KINDS[0])
        cylinder, _, side = name.removesuffix(f"_{unit}").rpartition("_")
        if unit and cylinder and side in SIDES:
            columns.setdefault((cylinder, SIDES[side]), name)
    return columns


def means_of(part: Recording) -> dict[str, float]:
    """Means of lengths, angles and pressures, named as in a file of measurements."""
    names = {}
    for name in part.columns:
        length = next((end for end in LENGTHS if name.endswith(end)), "")
        if length:
            names[name] = f"{name.removesuffix(length)}_length_mm"
        elif name.endswith("_deg") and not inclined(name):
            names[name] = name
    means = {new: float(np.nanmean(part.columns[old])) for old, new in names.items()}
    for (cylinder, side), name in sides_of(part).items():
        factor = PRESSURES[unit_of(name, KINDS[0])] / bar
        means[f"{cylinder}_{side}_bar"] = float(np.nanmean(part.columns[name])) * factor
    return means


def inclined(name: str) -> bool:
    """Whether a column is an inclinometer's."""
    return any(word in name.lower() for word in INCLINED)
