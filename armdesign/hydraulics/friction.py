"""Friction of a cylinder or motor: Coulomb, static, Stribeck and viscous."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Numbers


@dataclass(frozen=True, kw_only=True)
class Friction:
    """Friction of one cylinder: Coulomb and static [N], Stribeck velocity [m/s], viscous [N s/m].

    Of one motor: torques [N m] at the joint over its speed [rad/s].
    """

    coulomb: float = 0.0
    static: float = 0.0
    stribeck_velocity: float = 5e-3
    viscous: float = 0.0


NO_FRICTION = Friction()


def friction_force(friction: Friction, speed: Numbers) -> Numbers:
    """Friction [N] of one cylinder against the speed of its piston [m/s].

    F = (F_C + (F_S − F_C) exp(−(v/v_s)²)) tanh(10 v/v_s) + b v: Stribeck curve and viscous share.
    The steep tanh replaces the step at rest.
    """
    ratio = speed / friction.stribeck_velocity
    fade = np.exp(-np.minimum(ratio * ratio, 100.0))
    dry = friction.coulomb + (friction.static - friction.coulomb) * fade
    return dry * np.tanh(10 * ratio) + friction.viscous * speed
