"""The joint-coupled load at θ = π/2: its frequency, eq. (42), and transfer function, (35)–(40).

Symbols, assumptions and source: see ``formulas``, where all equations of the paper are gathered.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypedDict, Unpack

import numpy as np

from armdesign.arguments import with_options
from armdesign.arrays import Numbers
from armdesign.frequency.modes import hertz
from armdesign.paper.arguments import numbers
from armdesign.paper.mechanism import joint_inertia, moment_arm
from armdesign.paper.rigid_load import spring_stiffness
from armdesign.units import GRAVITY

SPRING = "stiffness", "area", "chamber_volume", "bulk_modulus"


def joint_coupled_as_printed(
    *,
    load_mass: Numbers,
    link_pin_distance: Numbers,
    base_pin_distance: Numbers,
    link_length: Numbers,
    stiffness: Numbers = None,
    area: Numbers = None,
    chamber_volume: Numbers = None,
    bulk_modulus: Numbers = None,
) -> Numbers:
    """Natural frequency of the joint-coupled load [Hz], eq. (42) as printed, with √(Q/K).

    f = 1/(2π) √((2 d1 cos α A² − m2 g l2 n_θ V0/β) / (V0/β m2 (a1² + l2²) n_θ)) with
    cos α = a1/√(a1² + d1²), n_θ = 1/(d1 cos α). Its first line prints √(K/Q), which is no
    frequency; the second prints Q/K.

    Wrong: the gravity term −m2 g l2. Right: ``joint_coupled``, with these arguments. Both agree
    without gravity.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.joint_coupled_as_printed(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ...     stiffness=18e6,
        ... )
        >>> print(f"{value:.4g}")
        6.766
    """
    return _frequency("joint_coupled_as_printed", _printed_gravity, **locals())


def joint_coupled(
    *,
    load_mass: Numbers,
    link_pin_distance: Numbers,
    base_pin_distance: Numbers,
    link_length: Numbers,
    stiffness: Numbers = None,
    area: Numbers = None,
    chamber_volume: Numbers = None,
    bulk_modulus: Numbers = None,
) -> Numbers:
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

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.joint_coupled(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ...     stiffness=18e6,
        ... )
        >>> print(f"{value:.4g}")
        6.776
    """
    return _frequency("joint_coupled", _gravity_stiffness, **locals())


class TransferFunction(NamedTuple):
    """Coefficients of piston displacement over valve signal, eq. (35).

    X_p/U = μ/(K s³ + F s² + Q s − H).
    """

    mu: Numbers
    K: Numbers
    F: Numbers
    Q: Numbers
    H: Numbers


class Mechanism(TypedDict):
    """The mechanism and its load."""

    load_mass: Numbers
    link_pin_distance: Numbers
    base_pin_distance: Numbers
    link_length: Numbers


class ValveDrive(Mechanism):
    """The mechanism, its symmetric cylinder, oil and valve."""

    area: Numbers
    chamber_volume: Numbers
    bulk_modulus: Numbers
    leakage: Numbers
    valve_gain: Numbers
    supply_pressure: Numbers
    density: Numbers


@with_options(ValveDrive, {})
def transfer_function_as_printed(**drive: Unpack[ValveDrive]) -> TransferFunction:
    """Coefficients (36)–(40) as printed.

    K = V0/β m2 (a1² + l2²) n_θ,  F = 2 C_L m2 (a1² + l2²) n_θ,
    Q = 2 d1 cos α A² − m2 g l2 n_θ V0/β,  H = 2 C_L m2 g l2 n_θ,  μ = d1 cos α · 2A K_v √(p_p/ρ0).

    Wrong: the gravity term in Q and H, and the 2 in μ. Right: ``transfer_function``, with these
    arguments.

    Example:
        >>> import armdesign as ad
        >>> plant = ad.formulas.transfer_function_as_printed(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ...     area=3e-3, chamber_volume=3e-4, bulk_modulus=1.2e9,
        ...     leakage=0.0, valve_gain=1e-7, supply_pressure=2.1e7, density=870,
        ... )
        >>> print(f"{plant.mu:.3g}")  # twice what it is
        1.34e-08
    """
    coefficients = _coefficients(_printed_gravity, **drive)
    return coefficients._replace(mu=2 * coefficients.mu)


@with_options(ValveDrive, {})
def transfer_function(**drive: Unpack[ValveDrive]) -> TransferFunction:
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

    Example:
        >>> import armdesign as ad
        >>> plant = ad.formulas.transfer_function(
        ...     load_mass=200, link_pin_distance=0.15, base_pin_distance=0.5, link_length=1.0,
        ...     area=3e-3, chamber_volume=3e-4, bulk_modulus=1.2e9,
        ...     leakage=0.0, valve_gain=1e-7, supply_pressure=2.1e7, density=870,
        ... )
        >>> print(f"{plant.mu:.3g}; natural frequency {(plant.Q / plant.K) ** 0.5:.2f} rad/s")
        6.7e-09; natural frequency 85.23 rad/s
    """
    return _coefficients(_gravity_stiffness, **drive)


def _frequency(part: str, gravity: Callable[..., Numbers], **arguments: Numbers) -> Numbers:
    """√((k_h r² − G)/J)/(2π) [Hz]; ``gravity`` gives the G [N m/rad] that lowers the stiffness."""
    spring = spring_stiffness(part, *(arguments.pop(name) for name in SPRING))
    m2, a1, d1, l2, _ = numbers(part, above_zero="load_mass", **arguments, stiffness=spring)
    r = moment_arm(link_pin_distance=a1, base_pin_distance=d1)
    inertia = joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2)
    return hertz((spring * r**2 - gravity(m2, a1, d1, l2)) / inertia)


def _coefficients(gravity: Callable[..., Numbers], **arguments: Numbers) -> TransferFunction:
    """Coefficients (36)–(40) with the gravity stiffness G [N m/rad], μ without its factor 2."""
    mechanism = {name: arguments.pop(name) for name in Mechanism.__annotations__}
    m2, a1, d1, l2 = numbers("transfer_function", above_zero="load_mass", **mechanism)
    G = gravity(m2, a1, d1, l2)
    A, V0, beta, C_L, K_v, p_p, rho, J, r = numbers(
        "transfer_function",
        **arguments,
        joint_inertia=joint_inertia(load_mass=m2, link_pin_distance=a1, link_length=l2),
        moment_arm=moment_arm(link_pin_distance=a1, base_pin_distance=d1),
    )
    return TransferFunction(
        mu=r * A * K_v * np.sqrt(p_p / rho),
        K=V0 / beta * J / r,
        F=2 * C_L * J / r,
        Q=2 * r * A**2 - G / r * V0 / beta,
        H=2 * C_L * G / r,
    )


def _printed_gravity(m2: Numbers, a1: Numbers, d1: Numbers, l2: Numbers) -> Numbers:
    """The term that the paper has in its place [N m/rad]."""
    return m2 * GRAVITY * l2


def _gravity_stiffness(m2: Numbers, a1: Numbers, d1: Numbers, l2: Numbers) -> Numbers:
    """Stiffness that gravity takes away at θ = π/2 [N m/rad]: −∂g/∂θ + F0 ∂r/∂θ."""
    return m2 * GRAVITY * a1 * (1 + l2 * d1 / (a1**2 + d1**2))
