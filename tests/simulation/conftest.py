"""The machines on which laws of the nonlinear model are tested one by one: without losses."""

from __future__ import annotations

import pytest

import armdesign as ad
from tests import machines
from tests.simulation.valves import without_losses


@pytest.fixture
def machine(machine: ad.Machine) -> ad.Machine:
    """Each machine in turn, without losses."""
    return without_losses(machine)


@pytest.fixture(scope="session")
def excavator() -> ad.Machine:
    """The 20 t machine with a full bucket, without losses, at a pump that holds its pressure."""
    ideal = machines.rigid("excavator_20t").replace({"supply.pump": "ideal"})
    return without_losses(ideal.with_payload("full"))
