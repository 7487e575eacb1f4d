"""The machine on which laws of the nonlinear model are tested one by one."""

from __future__ import annotations

import pytest

import armdesign as ad
from tests import machines


@pytest.fixture(scope="session")
def excavator() -> ad.Machine:
    """The 20 t machine with a full bucket, at a pump that holds its pressure."""
    ideal = machines.named("excavator_20t").replace({"supply.pump": "ideal"})
    return ideal.with_payload("full")
