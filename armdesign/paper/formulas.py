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

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.frequency.modes import hertz
from armdesign.paper.arguments import numbers
from armdesign.units import GRAVITY

_DEAD_CENTRE = 1e-12  # |sin θ| below which a cylinder counts as in line with the joint


class TransferFunction(NamedTuple):
    """Coefficients of piston displacement over valve signal, X_p/U = μ/(K s³ + F s² + Q s − H), eq. (35)."""

    mu: Any
    K: Any
    F: Any
    Q: Any
    H: Any


# -------------------------------------------------------------------------- rigidly connected load


def symmetric_stiffness(*, area: Any, chamber_volume: Any, bulk_modulus: Any) -> Any:
    """Oil stiffness of a symmetric piston at mid-stroke [N/m]: k_h = 2βA²/V0, the spring in eq. (11).

    Args:
        area: A, piston area [m²].
        chamber_volume: V0, oil in each of the two equal chambers [m³].
        bulk_modulus: β [Pa].
    """
    beta, A, V0 = numbers(
        "symmetric_stiffness", bulk_modulus=bulk_modulus, area=area, chamber_volume=chamber_volume
    )
    return 2 * beta * A**2 / V0


def rigid_load(
    *,
    mass: Any,
    stiffness: Any = None,
    area: Any = None,
    chamber_volume: Any = None,
    bulk_modulus: Any = None,
) -> Any:
    """Natural frequency of a mass rigidly connected to the rod [Hz], eq. (11): f = √(2βA²/(M V0))/(2π) = √(k_h/M)/(2π).

    Args:
        mass: M [kg]; inf Hz where it is 0.
        stiffness: k_h [N/m], or else the symmetric data:
        area: A [m²].
        chamber_volume: V0 of each chamber [m³].
        bulk_modulus: β [Pa].

    Raises:
        ArmDesignError: not exactly one of stiffness and symmetric data, or a value that is not
            positive.
    """
    spring = _spring("rigid_load", stiffness, area, chamber_volume, bulk_modulus)
    spring, M = numbers("rigid_load", stiffness=spring, mass=mass)
    with np.errstate(divide="ignore"):
        return hertz(spring / M)


def rigid_load_asymmetric_as_printed(
    *,
    mass: Any,
    bulk_modulus: Any,
    bore_area: Any,
    annulus_area: Any,
    cap_volume: Any,
    annulus_volume: Any,
) -> Any:
    """Rigid load on an asymmetric piston [Hz] as eq. (12) prints it: f = 1/(2π) √(2β/M (A1²/V01 + A2²/V02)).

    Wrong: the factor 2 counts both chambers twice; with A1 = A2 and V01 = V02 it is √2 times eq.
    (11). Right: ``rigid_load_asymmetric``, whose arguments these are.
    """
    return math.sqrt(2) * rigid_load_asymmetric(
        mass=mass,
        bulk_modulus=bulk_modulus,
        bore_area=bore_area,
        annulus_area=annulus_area,
        cap_volume=cap_volume,
        annulus_volume=annulus_volume,
    )


def rigid_load_asymmetric(
    *,
    mass: Any,
    bulk_modulus: Any,
    bore_area: Any,
    annulus_area: Any,
    cap_volume: Any,
    annulus_volume: Any,
) -> Any:
    """Rigid load on an asymmetric piston [Hz], eq. (12) put right: f = 1/(2π) √(β/M (A1²/V01 + A2²/V02)).

    Args:
        mass: M [kg].
        bulk_modulus: β [Pa].
        bore_area: A1 [m²].
        annulus_area: A2 [m²].
        cap_volume: V01, oil on the bore side [m³].
        annulus_volume: V02, oil on the rod side [m³].
    """
    beta, A1, A2, V01, V02 = numbers(
        "rigid_load_asymmetric",
        bulk_modulus=bulk_modulus,
        bore_area=bore_area,
        annulus_area=annulus_area,
        cap_volume=cap_volume,
        annulus_volume=annulus_volume,
    )
    return rigid_load(mass=mass, stiffness=beta * (A1**2 / V01 + A2**2 / V02))


def equivalent_mass(*, static_force: Any) -> Any:
    """Mass that the paper puts into eq. (11) [kg], section 4: the static load on the cylinder as a weight, |F0|/9.81.

    It vanishes where gravity does not load the cylinder, and it is no inertia: see
    ``reflected_mass``.
    """
    (force,) = numbers("equivalent_mass", static_force=static_force)
    return np.abs(force) / GRAVITY


def reflected_mass(*, joint_inertia: Any, moment_arm: Any) -> Any:
    """Mass that the piston feels [kg]: J/r². With it eq. (11) *is* eq. (42) without gravity.

    Args:
        joint_inertia: J about the joint [kg m²].
        moment_arm: r [m], its size.

    Raises:
        ArmDesignError: a negative inertia, or a moment arm that is not positive.
    """
    J, r = numbers("reflected_mass", joint_inertia=joint_inertia, moment_arm=moment_arm)
    return J / r**2


# ----------------------------------------------------------------------------------- the mechanism


def cylinder_length(*, link_pin_distance: Any, base_pin_distance: Any, angle: Any) -> Any:
    """Pin-to-pin length x_p [m], eq. (13) (missing in print): x_p² = a1² + d1² − 2 a1 d1 cos θ.

    Eq. (26) at θ = π/2.

    Args:
        link_pin_distance: a1, joint to rod pin [m].
        base_pin_distance: d1, joint to base pin [m].
        angle: θ between the two [rad].

    Raises:
        ArmDesignError: a distance that is not positive.
    """
    lengths = {"link_pin_distance": link_pin_distance, "base_pin_distance": base_pin_distance}
    return _length(*numbers("cylinder_length", **lengths, angle=angle))


def joint_angle(*, link_pin_distance: Any, base_pin_distance: Any, length: Any) -> Any:
    """Angle θ in [0, π] [rad] at a pin-to-pin length [m], eq. (14): θ = arccos((a1² + d1² − x_p²)/(2 a1 d1)).

    Raises:
        ArmDesignError: a distance that is not positive, or a length that the two cannot span.
    """
    a1, d1, x = numbers(
        "joint_angle",
        link_pin_distance=link_pin_distance,
        base_pin_distance=base_pin_distance,
        length=length,
    )
    cosine = (a1**2 + d1**2 - x**2) / (2 * a1 * d1)
    if not np.all(np.abs(cosine) <= 1 + 1e-12):
        raise ArmDesignError(
            "joint_angle: length",
            "the three sides make no triangle",
            "give a length in [|a1 − d1|, a1 + d1]",
        )
    return np.arccos(np.clip(cosine, -1, 1))


def moment_arm(*, link_pin_distance: Any, base_pin_distance: Any, angle: Any = math.pi / 2) -> Any:
    """Moment arm of the cylinder [m], eq. (21): r = d1 cos α = a1 d1 sin θ/x_p.

    N_θ of eq. (30) is 1/r.

    Args:
        link_pin_distance: a1, joint to rod pin [m].
        base_pin_distance: d1, joint to base pin [m].
        angle: θ between the two [rad].

    Raises:
        ArmDesignError: a distance that is not positive, or two pins in one place.
    """
    lengths = {"link_pin_distance": link_pin_distance, "base_pin_distance": base_pin_distance}
    a1, d1, theta = numbers("moment_arm", **lengths, angle=angle)
    length = _length(a1, d1, theta)
    if np.any(length == 0):
        raise ArmDesignError(
            "moment_arm: angle", "both pins of the cylinder are in one place", "give it in (0, π)"
        )
    return a1 * d1 * np.sin(theta) / length


def joint_inertia(*, load_mass: Any, link_pin_distance: Any, link_length: Any) -> Any:
    """Inertia about the joint [kg m²], eq. (16) with m1 = I1 = I2 = 0 and γ = π/2, as in eq. (22): J = m2 (a1² + l2²).

    Eq. (16) prints "l1" and "l2" where the links' own inertias I1 and I2 belong; both are
    neglected here.

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.

    Raises:
        ArmDesignError: a negative mass, a distance that is not positive, or a length that is not
            finite.
    """
    lengths = {"link_pin_distance": link_pin_distance, "link_length": link_length}
    m2, a1, l2 = numbers("joint_inertia", load_mass=load_mass, **lengths)
    return m2 * (a1**2 + l2**2)


def gravity_torque(*, load_mass: Any, link_pin_distance: Any, link_length: Any, angle: Any) -> Any:
    """Gravity term of eq. (22) [N m]: m2 g (a1 cos θ − l2 sin θ), what the cylinder's torque has to balance.

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        angle: θ [rad].

    Raises:
        ArmDesignError: a negative mass, a distance that is not positive, a length or angle that is
            not finite.
    """
    lengths = {"link_pin_distance": link_pin_distance, "link_length": link_length}
    m2, a1, l2, theta = numbers("gravity_torque", load_mass=load_mass, **lengths, angle=angle)
    return m2 * GRAVITY * (a1 * np.cos(theta) - l2 * np.sin(theta))


def static_force(
    *,
    load_mass: Any,
    link_pin_distance: Any,
    base_pin_distance: Any,
    link_length: Any,
    angle: Any = math.pi / 2,
) -> Any:
    """Cylinder force that holds the load [N, + pushes], eq. (21), (22) at rest: F0 = g(θ)/r(θ).

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        base_pin_distance: d1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        angle: θ [rad].

    Raises:
        ArmDesignError: a negative mass, a distance that is not positive, or a dead centre, where
            no force holds a load.
    """
    pins = {"link_pin_distance": link_pin_distance, "base_pin_distance": base_pin_distance}
    lengths = {**pins, "link_length": link_length}
    m2, a1, d1, l2, theta = numbers("static_force", load_mass=load_mass, **lengths, angle=angle)
    if np.any(dead := np.abs(np.sin(theta)) < _DEAD_CENTRE):
        problem = f"{theta[dead].flat[0]:g} rad is a dead centre: the cylinder has no moment arm"
        raise ArmDesignError("static_force: angle", problem, "give it between 0 and π")
    torque = gravity_torque(load_mass=m2, link_pin_distance=a1, link_length=l2, angle=theta)
    return torque / moment_arm(link_pin_distance=a1, base_pin_distance=d1, angle=theta)


def static_pressure_difference_as_printed(
    *, load_mass: Any, link_pin_distance: Any, base_pin_distance: Any, link_length: Any, area: Any
) -> Any:
    """Static p1 − p2 [Pa] at θ = π/2 as eq. (27) prints it: m2 g l2/(d1 cos α0 A).

    Wrong sign: by eq. (22) the load pulls the rod. Right: ``static_pressure_difference``.
    """
    return -static_pressure_difference(
        load_mass=load_mass,
        link_pin_distance=link_pin_distance,
        base_pin_distance=base_pin_distance,
        link_length=link_length,
        area=area,
    )


def static_pressure_difference(
    *, load_mass: Any, link_pin_distance: Any, base_pin_distance: Any, link_length: Any, area: Any
) -> Any:
    """Static p1 − p2 of the symmetric piston [Pa] at θ = π/2, eq. (27) put right: −m2 g l2/(d1 cos α0 A) = F0/A.

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        base_pin_distance: d1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        area: A [m²].

    Raises:
        ArmDesignError: a value out of its range.
    """
    force = static_force(
        load_mass=load_mass,
        link_pin_distance=link_pin_distance,
        base_pin_distance=base_pin_distance,
        link_length=link_length,
    )
    force, A = numbers("static_pressure_difference", static_force=force, area=area)
    return force / A


# ------------------------------------------------------------------------------ joint-coupled load


def joint_coupled_as_printed(
    *,
    load_mass: Any,
    link_pin_distance: Any,
    base_pin_distance: Any,
    link_length: Any,
    stiffness: Any = None,
    area: Any = None,
    chamber_volume: Any = None,
    bulk_modulus: Any = None,
) -> Any:
    """Natural frequency of the joint-coupled load [Hz], eq. (42) as printed, with the fraction Q/K under the root.

    f = 1/(2π) √((2 d1 cos α A² − m2 g l2 n_θ V0/β) / (V0/β m2 (a1² + l2²) n_θ)),  cos α = a1/√(a1²
    + d1²), n_θ = 1/(d1 cos α). Its first line prints √(K/Q), which is no frequency; the second
    prints Q/K.

    Wrong: the gravity term −m2 g l2; see ``joint_coupled``, whose arguments these are. Both agree
    without gravity.
    """
    spring = _spring("joint_coupled_as_printed", stiffness, area, chamber_volume, bulk_modulus)
    m2, a1, d1, l2 = _mechanism(
        "joint_coupled_as_printed",
        load_mass,
        link_pin_distance,
        base_pin_distance,
        link_length,
        spring,
    )
    r = moment_arm(link_pin_distance=a1, base_pin_distance=d1)
    inertia = joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2)
    return hertz((spring * r**2 - m2 * GRAVITY * l2) / inertia)


def joint_coupled(
    *,
    load_mass: Any,
    link_pin_distance: Any,
    base_pin_distance: Any,
    link_length: Any,
    stiffness: Any = None,
    area: Any = None,
    chamber_volume: Any = None,
    bulk_modulus: Any = None,
) -> Any:
    """Natural frequency of the joint-coupled load at θ = π/2 [Hz], eq. (42) put right: the exact linearisation.

    ω² = [k_h r² − m2 g a1 (1 + l2 d1/(a1² + d1²))] / (m2 (a1² + l2²)),  r = a1 d1/√(a1² + d1²).
    In the gravity term, the 1 is ∂/∂θ of eq. (22), the rest −F0 ∂r/∂θ: the moment arm changes
    under static load.

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1, joint to rod pin, along the link [m].
        base_pin_distance: d1, joint to base pin [m].
        link_length: l2, from the rod pin to the load, across the link [m]; negative: on the other
            side.
        stiffness: k_h [N/m], or else the symmetric data:
        area: A [m²].
        chamber_volume: V0 of each chamber [m³].
        bulk_modulus: β [Pa].

    Raises:
        ArmDesignError: not exactly one of stiffness and symmetric data, or a value out of its
            range.
    """
    spring = _spring("joint_coupled", stiffness, area, chamber_volume, bulk_modulus)
    m2, a1, d1, l2 = _mechanism(
        "joint_coupled", load_mass, link_pin_distance, base_pin_distance, link_length, spring
    )
    r = moment_arm(link_pin_distance=a1, base_pin_distance=d1)
    inertia = joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2)
    return hertz((spring * r**2 - _gravity_stiffness(m2, a1, d1, l2)) / inertia)


def transfer_function_as_printed(
    *,
    load_mass: Any,
    link_pin_distance: Any,
    base_pin_distance: Any,
    link_length: Any,
    area: Any,
    chamber_volume: Any,
    bulk_modulus: Any,
    leakage: Any,
    valve_gain: Any,
    supply_pressure: Any,
    density: Any,
) -> TransferFunction:
    """Coefficients (36)–(40) as printed.

    K = V0/β m2 (a1² + l2²) n_θ,  F = 2 C_L m2 (a1² + l2²) n_θ,  Q = 2 d1 cos α A² − m2 g l2 n_θ
    V0/β, H = 2 C_L m2 g l2 n_θ,  μ = d1 cos α · 2A K_v √(p_p/ρ0).

    Wrong: the gravity term in Q and H, and the 2 in μ; see ``transfer_function``, whose arguments
    these are.
    """
    mechanism = _mechanism(
        "transfer_function", load_mass, link_pin_distance, base_pin_distance, link_length
    )
    hydraulics = (
        area,
        chamber_volume,
        bulk_modulus,
        leakage,
        valve_gain,
        supply_pressure,
        density,
    )
    terms = _coefficients(*mechanism, mechanism[0] * GRAVITY * mechanism[3], *hydraulics)
    return terms._replace(mu=2 * terms.mu)


def transfer_function(
    *,
    load_mass: Any,
    link_pin_distance: Any,
    base_pin_distance: Any,
    link_length: Any,
    area: Any,
    chamber_volume: Any,
    bulk_modulus: Any,
    leakage: Any,
    valve_gain: Any,
    supply_pressure: Any,
    density: Any,
) -> TransferFunction:
    """Coefficients (36)–(40) put right, symmetric piston at θ = π/2 and mid-stroke.

    K = V0/β J n_θ,  F = 2 C_L J n_θ,  Q = 2 r A² − G n_θ V0/β,  H = 2 C_L G n_θ,  μ = r A K_v
    √(p_p/ρ0) with J = m2 (a1² + l2²), r = d1 cos α, n_θ = 1/r and G = m2 g a1 (1 + l2 d1/(a1² +
    d1²)).

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1 [m].
        base_pin_distance: d1 [m].
        link_length: l2 [m]; negative where the load is on the other side of the link.
        area: A [m²].
        chamber_volume: V0 [m³].
        bulk_modulus: β [Pa].
        leakage: C_L, across the piston [m³/s/Pa].
        valve_gain: K_v of eq. (6), flow per valve signal and √(Pa m³/kg) [m²].
        supply_pressure: p_p [Pa].
        density: ρ0 [kg/m³].
    """
    mechanism = _mechanism(
        "transfer_function", load_mass, link_pin_distance, base_pin_distance, link_length
    )
    hydraulics = (
        area,
        chamber_volume,
        bulk_modulus,
        leakage,
        valve_gain,
        supply_pressure,
        density,
    )
    return _coefficients(*mechanism, _gravity_stiffness(*mechanism), *hydraulics)


# ------------------------------------------------------------------------------------------ shared


def _coefficients(
    m2: Any,
    a1: Any,
    d1: Any,
    l2: Any,
    gravity: Any,
    A: Any,
    V0: Any,
    beta: Any,
    C_L: Any,
    K_v: Any,
    p_p: Any,
    rho: Any,
) -> TransferFunction:
    """Eq.

    (36)–(40) with a given destabilising gravity stiffness [N m/rad], and μ without its factor 2.
    """
    r = moment_arm(link_pin_distance=a1, base_pin_distance=d1)
    J = joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2)
    A, V0, beta, rho, C_L, K_v, p_p, J, r = numbers(
        "transfer_function",
        area=A,
        chamber_volume=V0,
        bulk_modulus=beta,
        density=rho,
        leakage=C_L,
        valve_gain=K_v,
        supply_pressure=p_p,
        joint_inertia=J,
        moment_arm=r,
    )
    return TransferFunction(
        mu=r * A * K_v * np.sqrt(p_p / rho),
        K=V0 / beta * J / r,
        F=2 * C_L * J / r,
        Q=2 * r * A**2 - gravity / r * V0 / beta,
        H=2 * C_L * gravity / r,
    )


def _gravity_stiffness(m2: Any, a1: Any, d1: Any, l2: Any) -> Any:
    """What gravity takes from the stiffness at θ = π/2 [N m/rad]: −∂g/∂θ + F0 ∂r/∂θ."""
    return m2 * GRAVITY * a1 * (1 + l2 * d1 / (a1**2 + d1**2))


def _spring(part: str, stiffness: Any, area: Any, chamber_volume: Any, bulk_modulus: Any) -> Any:
    """k_h [N/m] from exactly one of its two descriptions."""
    symmetric = {"area": area, "chamber_volume": chamber_volume, "bulk_modulus": bulk_modulus}
    given = [name for name, value in symmetric.items() if value is not None]
    remedy = "give either stiffness, or area, chamber_volume and bulk_modulus"
    if stiffness is not None and given:
        raise ArmDesignError(
            part, f"stiffness and {', '.join(given)} describe the cylinder twice", remedy
        )
    if stiffness is not None:
        return numbers(part, stiffness=stiffness)[0]
    if len(given) < len(symmetric):
        missing = (
            ", ".join(name for name in symmetric if name not in given) if given else "the cylinder"
        )
        raise ArmDesignError(part, f"{missing} not given", remedy)
    return symmetric_stiffness(area=area, chamber_volume=chamber_volume, bulk_modulus=bulk_modulus)


def _length(a1: Any, d1: Any, theta: Any) -> Any:
    """x_p of eq.

    (13); written as (a1 − d1)² + 4 a1 d1 sin²(θ/2), of which no rounding makes a negative square.
    """
    return np.sqrt((a1 - d1) ** 2 + 4 * a1 * d1 * np.sin(theta / 2) ** 2)


def _mechanism(
    part: str, load_mass: Any, a1: Any, d1: Any, l2: Any, spring: Any = 1.0
) -> tuple[Any, Any, Any, Any]:
    """m2, a1, d1, l2 as arrays, checked, of shapes that go with the spring's."""
    lengths = {"link_pin_distance": a1, "base_pin_distance": d1, "link_length": l2}
    m2, a1, d1, l2, _ = numbers(
        part, above_zero="load_mass", load_mass=load_mass, **lengths, stiffness=spring
    )
    return m2, a1, d1, l2
