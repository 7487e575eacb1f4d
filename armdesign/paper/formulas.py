"""The equations of the source paper, as printed and exact.

M. Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019. One equation, one function, elementwise on arrays, SI in and out, frequencies in Hz.
Where the paper prints an equation wrongly there are two: ``…_as_printed`` reproduces the paper,
the plain name is right and is what the rest of the package agrees with.

The mechanism (its Figure 2): a joint at the origin; the cylinder's base pin at a distance d1 from
it, its rod pin at a1 on the link; θ the angle between the two; the load m2 at a1 along the link
and l2 across it (γ = π/2). The linearised equations (23)–(42) hold at θ0 = π/2. The cylinder
enters either by its ``stiffness`` k_h [N/m], whatever cylinder it is, or by the paper's symmetric
data ``area``, ``chamber_volume`` and ``bulk_modulus``, for which k_h = 2βA²/V0 with both chambers
at V0.

Assumptions: massless cylinder and link, constant bulk modulus, small motion, valve shut. An ω² < 0
(gravity overcomes the oil) gives 0 Hz.
"""

from armdesign.paper.joint_coupled import (
    TransferFunction,
    joint_coupled,
    joint_coupled_as_printed,
    transfer_function,
    transfer_function_as_printed,
)
from armdesign.paper.mechanism import (
    cylinder_length,
    gravity_torque,
    joint_angle,
    joint_inertia,
    moment_arm,
    static_force,
    static_pressure_difference,
    static_pressure_difference_as_printed,
)
from armdesign.paper.rigid_load import (
    equivalent_mass,
    reflected_mass,
    rigid_load,
    rigid_load_asymmetric,
    rigid_load_asymmetric_as_printed,
    symmetric_stiffness,
)

__all__ = [
    "TransferFunction",
    "cylinder_length",
    "equivalent_mass",
    "gravity_torque",
    "joint_angle",
    "joint_coupled",
    "joint_coupled_as_printed",
    "joint_inertia",
    "moment_arm",
    "reflected_mass",
    "rigid_load",
    "rigid_load_asymmetric",
    "rigid_load_asymmetric_as_printed",
    "static_force",
    "static_pressure_difference",
    "static_pressure_difference_as_printed",
    "symmetric_stiffness",
    "transfer_function",
    "transfer_function_as_printed",
]
