"""The mechanism of the paper's Figure 2: geometry, inertia, gravity, static force, eq. (13)–(27).

Symbols, assumptions and source: see ``formulas``, where all equations of the paper are gathered.
"""

from __future__ import annotations

import math

import numpy as np

from armdesign.arrays import Numbers
from armdesign.errors import ArmDesignError
from armdesign.paper.arguments import numbers
from armdesign.units import GRAVITY

_DEAD_CENTRE = 1e-12  # |sin θ| below which a cylinder counts as in line with the joint


def cylinder_length(
    *, link_pin_distance: Numbers, base_pin_distance: Numbers, angle: Numbers
) -> Numbers:
    """Pin-to-pin length x_p of the cylinder [m], eq. (13), which is missing in print.

    x_p² = a1² + d1² − 2 a1 d1 cos θ; eq. (26) at θ = π/2.

    Args:
        link_pin_distance: a1, joint to rod pin [m].
        base_pin_distance: d1, joint to base pin [m].
        angle: θ between the two [rad].

    Raises:
        ArmDesignError: a distance that is not positive.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.cylinder_length(
        ...     link_pin_distance=0.15, base_pin_distance=0.5,
        ...     angle=90 * ad.units.deg,
        ... )
        >>> print(f"{value:.4g}")
        0.522
    """
    return _length(*numbers("cylinder_length", **locals()))


def joint_angle(
    *, link_pin_distance: Numbers, base_pin_distance: Numbers, length: Numbers
) -> Numbers:
    """Angle θ in [0, π] [rad] at a pin-to-pin length [m], eq. (14).

    θ = arccos((a1² + d1² − x_p²)/(2 a1 d1)).

    Raises:
        ArmDesignError: a distance that is not positive, or a length that the two cannot span.

    Example:
        >>> import armdesign as ad
        >>> pins = {"link_pin_distance": 0.15, "base_pin_distance": 0.5}
        >>> value = ad.formulas.joint_angle(**pins, length=0.522)
        >>> print(f"{value:.4g}")
        1.571
    """
    a1, d1, x = numbers("joint_angle", **locals())
    cosine = (a1**2 + d1**2 - x**2) / (2 * a1 * d1)
    if not np.all(np.abs(cosine) <= 1 + 1e-12):
        fault, remedy = "the three sides make no triangle", "give a length in [|a1 − d1|, a1 + d1]"
        raise ArmDesignError("joint_angle: length", fault, remedy)
    return np.arccos(np.clip(cosine, -1, 1))


def moment_arm(
    *, link_pin_distance: Numbers, base_pin_distance: Numbers, angle: Numbers = math.pi / 2
) -> Numbers:
    """Moment arm of the cylinder [m], eq. (21): r = d1 cos α = a1 d1 sin θ/x_p.

    N_θ of eq. (30) is 1/r.

    Args:
        link_pin_distance: a1, joint to rod pin [m].
        base_pin_distance: d1, joint to base pin [m].
        angle: θ between the two [rad].

    Raises:
        ArmDesignError: a distance that is not positive, or two pins in one place.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.moment_arm(link_pin_distance=0.15, base_pin_distance=0.5)
        >>> print(f"{value:.4g}")
        0.1437
    """
    a1, d1, theta = numbers("moment_arm", **locals())
    length = _length(a1, d1, theta)
    if np.any(length == 0):
        fault = "both pins of the cylinder are in one place"
        raise ArmDesignError("moment_arm: angle", fault, "give it in (0, π)")
    return a1 * d1 * np.sin(theta) / length


def joint_inertia(
    *, load_mass: Numbers, link_pin_distance: Numbers, link_length: Numbers
) -> Numbers:
    """Inertia of the load about the joint [kg m²]: J = m2 (a1² + l2²), as in eq. (22).

    Eq. (16) with m1 = I1 = I2 = 0 and γ = π/2. It prints "l1" and "l2" where the links' own
    inertias I1 and I2 belong; both are neglected here.

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.

    Raises:
        ArmDesignError: a negative mass, a distance that is not positive, or a length that is not
            finite.

    Example:
        >>> import armdesign as ad
        >>> lengths = {"link_pin_distance": 0.15, "link_length": 1.0}
        >>> value = ad.formulas.joint_inertia(load_mass=200, **lengths)
        >>> print(f"{value:.4g}")
        204.5
    """
    m2, a1, l2 = numbers("joint_inertia", **locals())
    return m2 * (a1**2 + l2**2)


def gravity_torque(
    *, load_mass: Numbers, link_pin_distance: Numbers, link_length: Numbers, angle: Numbers
) -> Numbers:
    """Gravity torque that the cylinder balances [N m], eq. (22): m2 g (a1 cos θ − l2 sin θ).

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        angle: θ [rad].

    Raises:
        ArmDesignError: a negative mass, a distance that is not positive, a length or angle that is
            not finite.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.gravity_torque(
        ...     load_mass=200, link_pin_distance=0.15, link_length=1.0,
        ...     angle=90 * ad.units.deg,
        ... )
        >>> print(f"{value:.4g}")
        -1962
    """
    m2, a1, l2, theta = numbers("gravity_torque", **locals())
    return m2 * GRAVITY * (a1 * np.cos(theta) - l2 * np.sin(theta))


def static_force(
    *,
    load_mass: Numbers,
    link_pin_distance: Numbers,
    base_pin_distance: Numbers,
    link_length: Numbers,
    angle: Numbers = math.pi / 2,
) -> Numbers:
    """Cylinder force that holds the load [N, + pushes]: F0 = g(θ)/r(θ), eq. (21) and (22).

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        base_pin_distance: d1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        angle: θ [rad].

    Raises:
        ArmDesignError: a negative mass, a distance that is not positive, or a dead centre, where
            no force holds a load.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.static_force(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ... )
        >>> print(f"{value:.4g}")
        -1.366e+04
    """
    m2, a1, d1, l2, theta = numbers("static_force", **locals())
    if np.any(dead := np.abs(np.sin(theta)) < _DEAD_CENTRE):
        fault = f"{theta[dead].flat[0]:g} rad is a dead centre: the cylinder has no moment arm"
        raise ArmDesignError("static_force: angle", fault, "give it between 0 and π")
    torque = gravity_torque(load_mass=m2, link_pin_distance=a1, link_length=l2, angle=theta)
    return torque / moment_arm(link_pin_distance=a1, base_pin_distance=d1, angle=theta)


def static_pressure_difference_as_printed(
    *,
    load_mass: Numbers,
    link_pin_distance: Numbers,
    base_pin_distance: Numbers,
    link_length: Numbers,
    area: Numbers,
) -> Numbers:
    """Static pressure difference p1 − p2 at θ = π/2 [Pa], eq. (27) as printed.

    m2 g l2/(d1 cos α0 A). The sign is wrong: by eq. (22) the load pulls the rod. Right:
    ``static_pressure_difference``, with these arguments.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.static_pressure_difference_as_printed(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ...     area=3e-3,
        ... )
        >>> print(f"{value:.4g}")
        4.552e+06
    """
    return -static_pressure_difference(**locals())


def static_pressure_difference(
    *,
    load_mass: Numbers,
    link_pin_distance: Numbers,
    base_pin_distance: Numbers,
    link_length: Numbers,
    area: Numbers,
) -> Numbers:
    """Static pressure difference p1 − p2 at θ = π/2 [Pa], eq. (27) corrected: F0/A.

    For the symmetric piston, F0/A = −m2 g l2/(d1 cos α0 A).

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        base_pin_distance: d1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        area: A [m²].

    Raises:
        ArmDesignError: a value out of its range.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.static_pressure_difference(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ...     area=3e-3,
        ... )
        >>> print(f"{value:.4g}")
        -4.552e+06
    """
    force = static_force(**{name: value for name, value in locals().items() if name != "area"})
    force, A = numbers("static_pressure_difference", static_force=force, area=area)
    return force / A


def _length(a1: Numbers, d1: Numbers, theta: Numbers) -> Numbers:
    """x_p of eq. (13), as √((a1 − d1)² + 4 a1 d1 sin²(θ/2)): rounding makes no square negative."""
    return np.sqrt((a1 - d1) ** 2 + 4 * a1 * d1 * np.sin(theta / 2) ** 2)
