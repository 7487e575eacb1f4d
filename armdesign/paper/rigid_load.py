"""A load rigidly connected to the rod: eq. (11) and (12), and the masses that stand for it.

Symbols, assumptions and source: see ``formulas``, where all equations of the paper are gathered.
"""

from __future__ import annotations

import math

import numpy as np

from armdesign.arrays import Numbers
from armdesign.errors import ArmDesignError
from armdesign.frequency.modes import hertz
from armdesign.paper.arguments import numbers
from armdesign.units import GRAVITY


def symmetric_stiffness(
    *, area: Numbers, chamber_volume: Numbers, bulk_modulus: Numbers
) -> Numbers:
    """Oil stiffness of a symmetric piston at mid-stroke [N/m], in eq. (11): k_h = 2βA²/V0.

    Args:
        area: A, piston area [m²].
        chamber_volume: V0, oil in each of the two equal chambers [m³].
        bulk_modulus: β [Pa].

    Example:
        >>> import armdesign as ad
        >>> oil = {"chamber_volume": 3e-4, "bulk_modulus": 1.2e9}
        >>> value = ad.formulas.symmetric_stiffness(area=3e-3, **oil)
        >>> print(f"{value:.4g}")
        7.2e+07
    """
    beta, A, V0 = numbers(
        "symmetric_stiffness", bulk_modulus=bulk_modulus, area=area, chamber_volume=chamber_volume
    )
    return 2 * beta * A**2 / V0


def rigid_load(
    *,
    mass: Numbers,
    stiffness: Numbers = None,
    area: Numbers = None,
    chamber_volume: Numbers = None,
    bulk_modulus: Numbers = None,
) -> Numbers:
    """Natural frequency of a mass rigidly connected to the rod [Hz], eq. (11).

    f = √(2βA²/(M V0))/(2π) = √(k_h/M)/(2π).

    Args:
        mass: M [kg]; inf Hz where it is 0.
        stiffness: k_h [N/m], or else the symmetric data:
        area: A [m²].
        chamber_volume: V0 of each chamber [m³].
        bulk_modulus: β [Pa].

    Raises:
        ArmDesignError: not exactly one of stiffness and symmetric data, or a value that is not
            positive.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.rigid_load(mass=1000, stiffness=72e6)
        >>> print(f"{value:.4g}")
        42.71
    """
    spring = spring_stiffness("rigid_load", stiffness, area, chamber_volume, bulk_modulus)
    spring, M = numbers("rigid_load", stiffness=spring, mass=mass)
    with np.errstate(divide="ignore"):
        return hertz(spring / M)


def rigid_load_asymmetric_as_printed(
    *,
    mass: Numbers,
    bulk_modulus: Numbers,
    bore_area: Numbers,
    annulus_area: Numbers,
    cap_volume: Numbers,
    annulus_volume: Numbers,
) -> Numbers:
    """Natural frequency of a rigid load on an asymmetric piston [Hz], eq. (12) as printed.

    f = 1/(2π) √(2β/M (A1²/V01 + A2²/V02)). Wrong: the factor 2 counts both chambers twice; with
    A1 = A2 and V01 = V02 it is √2 times eq. (11). Right: ``rigid_load_asymmetric``, with these
    arguments.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.rigid_load_asymmetric_as_printed(
        ...     mass=1000, bulk_modulus=1.2e9, bore_area=3e-3, annulus_area=2e-3,
        ...     cap_volume=3e-4, annulus_volume=2e-4,
        ... )
        >>> print(f"{value:.4g}")
        55.13
    """
    return math.sqrt(2) * rigid_load_asymmetric(**locals())


def rigid_load_asymmetric(
    *,
    mass: Numbers,
    bulk_modulus: Numbers,
    bore_area: Numbers,
    annulus_area: Numbers,
    cap_volume: Numbers,
    annulus_volume: Numbers,
) -> Numbers:
    """Natural frequency of a rigid load on an asymmetric piston [Hz], eq. (12) corrected.

    f = 1/(2π) √(β/M (A1²/V01 + A2²/V02)).

    Args:
        mass: M [kg].
        bulk_modulus: β [Pa].
        bore_area: A1 [m²].
        annulus_area: A2 [m²].
        cap_volume: V01, oil on the bore side [m³].
        annulus_volume: V02, oil on the rod side [m³].

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.rigid_load_asymmetric(
        ...     mass=1000, bulk_modulus=1.2e9, bore_area=3e-3, annulus_area=2e-3,
        ...     cap_volume=3e-4, annulus_volume=2e-4,
        ... )
        >>> print(f"{value:.4g}")
        38.98
    """
    cylinder = {name: value for name, value in locals().items() if name != "mass"}
    beta, A1, A2, V01, V02 = numbers("rigid_load_asymmetric", **cylinder)
    return rigid_load(mass=mass, stiffness=beta * (A1**2 / V01 + A2**2 / V02))


def equivalent_mass(*, static_force: Numbers) -> Numbers:
    """Mass whose weight is the static load on the cylinder [kg], |F0|/9.81, section 4.

    The paper puts it into eq. (11). It vanishes where gravity does not load the cylinder, and it
    is no inertia: see ``reflected_mass``.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.equivalent_mass(static_force=9810)
        >>> print(f"{value:.4g}")
        1000
    """
    (force,) = numbers("equivalent_mass", **locals())
    return np.abs(force) / GRAVITY


def reflected_mass(*, joint_inertia: Numbers, moment_arm: Numbers) -> Numbers:
    """Mass with the inertia that the piston moves [kg]: J/r².

    With it eq. (11) *is* eq. (42) without gravity.

    Args:
        joint_inertia: J about the joint [kg m²].
        moment_arm: r [m], its size.

    Raises:
        ArmDesignError: a negative inertia, or a moment arm that is not positive.

    Example:
        >>> import armdesign as ad
        >>> value = ad.formulas.reflected_mass(joint_inertia=200, moment_arm=0.15)
        >>> print(f"{value:.4g}")
        8889
    """
    J, r = numbers("reflected_mass", **locals())
    return J / r**2


def spring_stiffness(
    part: str, stiffness: Numbers, area: Numbers, chamber_volume: Numbers, bulk_modulus: Numbers
) -> Numbers:
    """Oil stiffness k_h [N/m], given or from the symmetric data; exactly one of the two."""
    symmetric = {"area": area, "chamber_volume": chamber_volume, "bulk_modulus": bulk_modulus}
    given = [name for name, value in symmetric.items() if value is not None]
    remedy = "give either stiffness, or area, chamber_volume and bulk_modulus"
    if stiffness is not None and given:
        fault = f"stiffness and {', '.join(given)} describe the cylinder twice"
        raise ArmDesignError(part, fault, remedy)
    if stiffness is not None:
        return numbers(part, stiffness=stiffness)[0]
    if missing := [name for name in symmetric if name not in given]:
        words = ", ".join(missing) if given else "the cylinder"
        raise ArmDesignError(part, f"{words} not given", remedy)
    return symmetric_stiffness(**symmetric)
