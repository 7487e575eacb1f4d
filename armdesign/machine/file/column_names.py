"""Names of columns of the CSV files: each joint is a column of these, and may be no other one."""

from __future__ import annotations

import re
from collections.abc import Iterable

COLUMNS = frozenset(
    (
        # of poses, load cases and modes
        *("payload", "cylinder", "mode", "tool_x_m", "tool_y_m", "tool_z_m", "omega_squared"),
        *("hydraulic", "gravity", "geometric", "springs"),
        # of lift charts
        *("reach_m", "height_m", "capacity_kg", "hydraulic_kg", "tipping_kg", "limiting"),
        # of control
        *("works", "damping", "bounding_hz", "bounding_damping", "merritt_hz", "rule_hz"),
        *("critical_gain_per_s", "closed_damping", "corner_rad_per_s", "filter", "command"),
        # of validations
        *("linear_hz", "identified_hz", "deviation", "linear_damping", "identified_damping"),
        *("amplitude", "pose", "at_rest_hz", "with_friction_hz", "with_friction_damping"),
        *("remark", "peak_hz", "energy_error", "identified_hz_sigma", "identified_damping_sigma"),
        "version",
        # of measured frequencies
        *("measured_hz", "deviation_hz", "before_hz", "before_error", "calibrated_hz"),
        *("calibrated_error", "left_out_error"),
    )
)
FAMILIES = re.compile(r"f\d+_hz|(?:proportional|individual|damped|own)_.+")
OF_ACTUATOR = (
    *("locked_{}_hz", "rigid_{}_hz", "{}_force_n", "{}_torque_n_m", "{}_extension"),
    *("{}_pressure_gain_m_per_s_bar", "{}_pressure_gain_rad_per_s_bar"),
    *("{}_load_bar", "{}_calibrated_load_bar"),
)
OF_JOINT = "{}_mean", "{}_span", "{}_gain_per_s", "{}_gain_without_feedback_per_s"


def is_column(name: str, joints: Iterable[str], actuators: Iterable[str]) -> bool:
    """Whether a column of a machine's CSV files has this name and is no joint position."""
    of_both = (OF_ACTUATOR, actuators), (OF_JOINT, joints)
    named = (form.format(one) for forms, names in of_both for one in names for form in forms)
    return name in COLUMNS or FAMILIES.fullmatch(name) is not None or name in named
