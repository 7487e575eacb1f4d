"""The joint-coupled load at θ = π/2: its frequency, eq. (42), and transfer function, (35)–(40).

Symbols, assumptions and source: see ``formulas``, where all equations of the paper are gathered.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armdesign.frequency.modes import hertz
from armdesign.paper.arguments import numbers
from armdesign.paper.mechanism import joint_inertia, moment_arm
from armdesign.paper.rigid_load import spring_stiffness
from armdesign.units import GRAVITY


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
    """Natural frequency of the joint-coupled load [Hz], eq. (42) as printed, with √(Q/K).

    f = 1/(2π) √((2 d1 cos α A² − m2 g l2 n_θ V0/β) / (V0/β m2 (a1² + l2²) n_θ)) with
    cos α = a1/√(a1² + d1²), n_θ = 1/(d1 cos α). Its first line prints √(K/Q), which is no
    frequency; the second prints Q/K.

    Wrong: the gravity term −m2 g l2. Right: ``joint_coupled``, with these arguments. Both agree
    without gravity.
    """
    spring = spring_stiffness(
        "joint_coupled_as_printed", stiffness, area, chamber_volume, bulk_modulus
    )
    lengths = (link_pin_distance, base_pin_distance, link_length)
    m2, a1, d1, l2 = _mechanism("joint_coupled_as_printed", load_mass, *lengths, spring)
    return _frequency(spring, m2, a1, d1, l2, gravity=m2 * GRAVITY * l2)


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
    """Natural frequency of the joint-coupled load at θ = π/2 [Hz], eq. (42) corrected, exact.

    ω² = [k_h r² − m2 g a1 (1 + l2 d1/(a1² + d1²))] / (m2 (a1² + l2²)),  r = a1 d1/√(a1² + d1²).
    In the gravity term, the 1 is ∂/∂θ of eq. (22), the rest −F0 ∂r/∂θ: the moment arm changes
    under static load.

    Args:
        load_mass: m2 [kg].
        link_pin_distance: a1, joint to rod pin, along the link [m].
        base_pin_distance: d1, joint to base pin [m].
        link_length: l2, from the rod pin to the load, across the link [m]; negative where the
            load is on the other side of the link.
        stiffness: k_h [N/m], or else the symmetric data:
        area: A [m²].
        chamber_volume: V0 of each chamber [m³].
        bulk_modulus: β [Pa].

    Raises:
        ArmDesignError: not exactly one of stiffness and symmetric data, or a value out of its
            range.
    """
    spring = spring_stiffness("joint_coupled", stiffness, area, chamber_volume, bulk_modulus)
    lengths = (link_pin_distance, base_pin_distance, link_length)
    m2, a1, d1, l2 = _mechanism("joint_coupled", load_mass, *lengths, spring)
    return _frequency(spring, m2, a1, d1, l2, gravity=_gravity_stiffness(m2, a1, d1, l2))


class TransferFunction(NamedTuple):
    """Coefficients of piston displacement over valve signal, eq. (35).

    X_p/U = μ/(K s³ + F s² + Q s − H).
    """

    mu: Any
    K: Any
    F: Any
    Q: Any
    H: Any


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

    K = V0/β m2 (a1² + l2²) n_θ,  F = 2 C_L m2 (a1² + l2²) n_θ,
    Q = 2 d1 cos α A² − m2 g l2 n_θ V0/β,  H = 2 C_L m2 g l2 n_θ,  μ = d1 cos α · 2A K_v √(p_p/ρ0).

    Wrong: the gravity term in Q and H, and the 2 in μ. Right: ``transfer_function``, with these
    arguments.
    """
    lengths = (link_pin_distance, base_pin_distance, link_length)
    m2, a1, d1, l2 = _mechanism("transfer_function", load_mass, *lengths)
    coefficients = _coefficients(
        (m2, a1, d1, l2),
        m2 * GRAVITY * l2,
        area=area,
        chamber_volume=chamber_volume,
        bulk_modulus=bulk_modulus,
        leakage=leakage,
        valve_gain=valve_gain,
        supply_pressure=supply_pressure,
        density=density,
    )
    return coefficients._replace(mu=2 * coefficients.mu)


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
    """Coefficients (36)–(40) corrected, symmetric piston at θ = π/2 and mid-stroke.

    K = V0/β J n_θ,  F = 2 C_L J n_θ,  Q = 2 r A² − G n_θ V0/β,  H = 2 C_L G n_θ,
    μ = r A K_v √(p_p/ρ0) with J = m2 (a1² + l2²), r = d1 cos α, n_θ = 1/r and
    G = m2 g a1 (1 + l2 d1/(a1² + d1²)).

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
    lengths = (link_pin_distance, base_pin_distance, link_length)
    mechanism = _mechanism("transfer_function", load_mass, *lengths)
    return _coefficients(
        mechanism,
        _gravity_stiffness(*mechanism),
        area=area,
        chamber_volume=chamber_volume,
        bulk_modulus=bulk_modulus,
        leakage=leakage,
        valve_gain=valve_gain,
        supply_pressure=supply_pressure,
        density=density,
    )


def _frequency(spring: Any, m2: Any, a1: Any, d1: Any, l2: Any, *, gravity: Any) -> Any:
    """√((k_h r² − gravity)/J)/(2π) [Hz]; ``gravity`` [N m/rad] is what it takes from stiffness."""
    r = moment_arm(link_pin_distance=a1, base_pin_distance=d1)
    inertia = joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2)
    return hertz((spring * r**2 - gravity) / inertia)


def _coefficients(
    mechanism: tuple[Any, Any, Any, Any], gravity: Any, **hydraulics: Any
) -> TransferFunction:
    """Coefficients (36)–(40) at a gravity stiffness [N m/rad], μ without its factor 2."""
    m2, a1, d1, l2 = mechanism
    A, V0, beta, C_L, K_v, p_p, rho, J, r = numbers(
        "transfer_function",
        **hydraulics,
        joint_inertia=joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2),
        moment_arm=moment_arm(link_pin_distance=a1, base_pin_distance=d1),
    )
    return TransferFunction(
        mu=r * A * K_v * np.sqrt(p_p / rho),
        K=V0 / beta * J / r,
        F=2 * C_L * J / r,
        Q=2 * r * A**2 - gravity / r * V0 / beta,
        H=2 * C_L * gravity / r,
    )


def _gravity_stiffness(m2: Any, a1: Any, d1: Any, l2: Any) -> Any:
    """Stiffness that gravity takes away at θ = π/2 [N m/rad]: −∂g/∂θ + F0 ∂r/∂θ."""
    return m2 * GRAVITY * a1 * (1 + l2 * d1 / (a1**2 + d1**2))


def _mechanism(
    part: str, load_mass: Any, a1: Any, d1: Any, l2: Any, spring: Any = 1.0
) -> tuple[Any, Any, Any, Any]:
    """m2, a1, d1, l2 as arrays, checked, of shapes that go with the spring's."""
    lengths = {"link_pin_distance": a1, "base_pin_distance": d1, "link_length": l2}
    m2, a1, d1, l2, _ = numbers(
        part, above_zero="load_mass", load_mass=load_mass, **lengths, stiffness=spring
    )
    return m2, a1, d1, l2
