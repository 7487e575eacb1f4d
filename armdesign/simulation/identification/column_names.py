"""Names of the columns of a recording: what they measure, in which unit, of which part.

``<cylinder>_cap_bar`` (or ``head``), ``<cylinder>_rod_bar`` (or ``annulus``)
    Chamber pressures; also in MPa, kPa, Pa, psi.
``<cylinder>_pin_to_pin_mm``, ``<cylinder>_length_mm``, ``<joint>_deg``, of a slide ``<joint>_mm``
    What tells the pose.
``…_deg_per_s``, ``…_mm_per_s``, ``…_m_per_s2`` and others
    Speeds and accelerations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.errors import SimulationError
from armdesign.hydraulics.actuator import SIDES
from armdesign.machine.measured_poses import inclined
from armdesign.simulation.identification.recording import Recording
from armdesign.simulation.identification.windows import strongest
from armdesign.units import MPa, bar, psi

PRESSURES = {"bar": bar, "MPa": MPa, "kPa": 1e3, "Pa": 1.0, "psi": psi}
KINDS = (
    tuple(PRESSURES),
    ("deg_per_s", "rad_per_s", "mm_per_s", "m_per_s", "rpm"),
    ("m_per_s2", "mm_per_s2", "g", "rad_per_s2", "deg_per_s2"),
)
SIDE_WORDS = {**dict(zip(SIDES, SIDES, strict=True)), "head": "cap", "rod": "annulus"}
LENGTHS = ("_pin_to_pin_mm", "_length_mm")
POSITIONS = ("_deg", "_mm")


def strongest_column(recording: Recording, excitation: str = "") -> str:
    """The pressure that rings most; if there is none, the speed, or the acceleration.

    The excitation does not count.

    Raises:
        SimulationError: there is none, or most time stamps repeat or step back.
    """
    recording.refuse_single("give a row per instant")
    step = float(np.median(np.diff(recording.time)))
    if step <= 0:
        recording.refuse_uneven()
    for units in KINDS:
        sizes = {
            name: strongest(step, values[np.isfinite(values)])[1]
            for name, values in recording.columns.items()
            if name != excitation and unit_of(name, units) and np.isfinite(values).sum() > 1
        }
        if sizes:
            return max(sizes, key=lambda name: sizes[name])
    named = [n for n in recording.columns if n != excitation and any(unit_of(n, u) for u in KINDS)]
    if named:
        fault = f"{', '.join(named)}: fewer than two values"
        raise SimulationError(recording.source, fault, "give a value per instant")
    fault = f"no column is a pressure, speed or acceleration ({', '.join(recording.columns)})"
    remedy = "name the column, or end the names in a unit as _bar, _deg_per_s, _m_per_s2"
    raise SimulationError(recording.source, fault, remedy)


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
        if unit and cylinder and side in SIDE_WORDS:
            columns.setdefault((cylinder, SIDE_WORDS[side]), name)
    return columns


def tells_pose(name: str) -> bool:
    """Whether a column is of lengths or of positions of joints."""
    return name.endswith(POSITIONS) and not inclined(name)


def means_of(part: Recording) -> dict[str, float]:
    """Means of lengths, positions and pressures, named as in a file of measurements.

    Columns that are blank throughout have none.
    """
    names = {}
    for name in part.columns:
        length = next((end for end in LENGTHS if name.endswith(end)), "")
        if length:
            names[name] = f"{name.removesuffix(length)}_length_mm"
        elif tells_pose(name):
            names[name] = name
    factors = dict.fromkeys(names, 1.0)
    for (cylinder, side), name in sides_of(part).items():
        names[name] = f"{cylinder}_{side}_bar"
        factors[name] = PRESSURES[unit_of(name, KINDS[0])] / bar
    known = {name: values[np.isfinite(values)] for name, values in part.columns.items()}
    return {
        new: float(known[old].mean()) * factors[old]
        for old, new in names.items()
        if len(known[old])
    }
