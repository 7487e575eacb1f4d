"""The friction curve by hand."""

from __future__ import annotations

import pytest

from armdesign.hydraulics.friction import Friction, friction_force


def test_friction_curve() -> None:
    """Static at 0.3 Stribeck speeds (tanh 3 = 0.995, e^−0.09 = 0.914), Coulomb and viscous far
    above.
    """
    friction = Friction(coulomb=1000, static=1500, stribeck_velocity=0.01, viscous=2000)
    assert friction_force(friction, 0.5) == pytest.approx(1000 + 2000 * 0.5)
    assert friction_force(friction, 0.003) == pytest.approx(
        (1000 + 500 * 0.9139) * 0.9951 + 6, rel=1e-3
    )
    assert friction_force(friction, -0.5) == -friction_force(friction, 0.5)
    assert friction_force(friction, 0.0) == 0
