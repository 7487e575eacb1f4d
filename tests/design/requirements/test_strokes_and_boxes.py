"""Pin boxes."""

from __future__ import annotations

from numpy.testing import assert_allclose

from armdesign import Requirements
from tests.design.designs import workspace_of
from tests.design.requirements.shared import shipped_reference
from tests.machines import named


def test_default_pin_box() -> None:
    """2.5 % of the largest distance from the first joint to the tool (DESIGN.md), by the
    independent reference.
    """
    machine = named("excavator_20t")
    box = Requirements().box(machine, workspace_of("excavator"))
    # it scans other poses
    assert_allclose(1000 * box, shipped_reference(machine).default_pin_box_mm(), rtol=0.01)
