"""What is asked of a small machine and refused, or granted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import armdesign as ad
from armdesign import Requirements
from armdesign.errors import InfeasibleError
from tests.design.designs import MACHINES, workspace_of
from tests.machines import ANY_LIFT_AND_TORQUE

# the thrust against the digging torque of one cylinder
TWO = {"thrust_share": 0.9, "digging": ("lift",), "digging_share": 0.99}


def refused(name: str, vary: tuple[str, ...], **settings: Any) -> InfeasibleError:
    machine = MACHINES[name]()
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(
            machine,
            workspace_of(name),
            replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE | settings),
            vary=vary,
            starts=1,
        )
    return error.value


def allowed(name: str, vary: tuple[str, ...], **settings: Any) -> None:
    """A design meets them: does not raise."""
    machine = MACHINES[name]()
    ad.optimize(
        machine,
        workspace_of(name),
        replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE | settings),
        vary=vary,
        starts=1,
    )
