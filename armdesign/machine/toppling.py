"""Toppling: what is too soft to hold a machine upright, and how stiff it must be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armdesign.arrays import Array
from armdesign.errors import TopplingError
from armdesign.units import outward

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

ALONE = 3.0  # times the factor of all springs together: one spring that is named alone


def spring_too_soft(machine: Machine, where: str, factors: Array) -> TopplingError:
    """A pose that topples, and how stiff one spring must be, or all, by ``factors`` (ns + 1,)."""
    alone = int(factors[:-1].argmin())  # all together need less, but one is easier to stiffen
    chosen = alone if factors[alone] <= ALONE * factors[-1] else len(factors) - 1
    factor = outward(float(factors[chosen]), 4, up=True)
    spring = machine.springs[min(chosen, len(machine.springs) - 1)]
    path = f"spring.{spring.name}.{spring.stiffness_key}"
    stated = float(getattr(machine.section.spring[spring.name], spring.stiffness_key))
    at_end = math.isclose(spring.stiffness, stated, rel_tol=1e-9)
    share = "" if at_end else f" ({spring.stiffness / stated:.3g} of it, within the bands)"
    least = f"{outward(factor * stated, 4, up=True):g} {spring.stiffness_unit}"
    remedy = f"give more than {least}"
    if chosen == len(machine.springs):
        names = ", ".join(spring.name for spring in machine.springs)
        remedy = f"multiply the stiffness of all springs ({names}) by more than {factor:g}"
    fault = (
        f"{stated:g} {spring.stiffness_unit}{share} does not hold the machine upright at"
        f" {where}: gravity overcomes it"
    )
    place = f"{machine.source.name}: {path}"
    return TopplingError(place, fault, remedy, machine.line_of(path))


def actuator_too_soft(
    machine: Machine, where: str, stiffness: Array, factors: Array
) -> TopplingError:
    """A pose that topples, and how stiff the actuator must be that is easiest to stiffen.

    By the ``stiffness`` of all (nc,) [N/m, N m/rad] and the ``factors`` on it (nc,).
    """
    i = int(factors.argmin())
    actuator = machine.actuators[i]
    is_motor = actuator.kind == "motor"
    unit, sizes = ("N m/rad", "gear_ratio") if is_motor else ("N/m", "bore_mm")
    least = outward(float(factors[i] * stiffness[i]), 4, up=True)
    fault = (
        f"the {stiffness[i]:.4g} {unit} of its trapped oil and structure do not hold the machine"
        f" upright at {where}: gravity overcomes them"
    )
    path = f"{actuator.kind}.{actuator.name}"
    remedy = f"raise {sizes}, or give less oil: there more than {least:g} {unit} are needed"
    return TopplingError(f"{machine.source.name}: {path}", fault, remedy, machine.line_of(path))
