"""Conflicts ask for the share of single actuators, and what they ask for can be granted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Machine, Requirements
from armdesign.design.requirements.check import check
from armdesign.errors import InfeasibleError
from armdesign.machine.file.schema import BY_ACTUATOR
from tests.design.designs import MACHINES, workspace_of


def test_one_cylinder_gives_and_the_other_keeps() -> None:
    """A ≤ 0.9 and A ≥ 0.99 of today's for one cylinder: the numbers of ``test_two_by_hand``."""
    machine, space = MACHINES["double"](), workspace_of("double")
    requirements = Requirements(
        thrust_share={"lift": 0.9},
        torque_share={"lift": 0.99},
        buckling_share={"lift": 0.1},
        oil_total_share=1.2,
        oil_each_share=1.2,
    )
    with pytest.raises(InfeasibleError) as error:
        ad.optimize(machine, space, requirements, ("areas",), starts=1)
    thrust, torque = error.value.conflict
    assert (thrust.setting, torque.setting) == ("thrust_share.lift", "torque_share.lift")
    assert torque.name == "torque.extending.lift"
    # a grid step of the bore is 0.2 % of its area
    assert thrust.together / thrust.limit == pytest.approx(0.09 / 1.89, rel=0.03)
    assert "thrust_share.lift = " in str(error.value)
    granted = requirements.granting(error.value.conflict)
    assert granted.thrust_share == {"default": 1.1, "lift": thrust.value}
    assert granted.torque_share == {"default": 0.95, "lift": torque.value}
    design = ad.optimize(machine, space, granted, ("areas",), starts=1)
    assert min(c.slack for c in design.checks) >= -1e-9
    file = machine.replace({f"requirements.{c.setting}": c.value for c in error.value.conflict})
    assert Requirements.of(file).thrust_share == granted.thrust_share


Asked = Callable[[Machine, np.random.Generator], dict[str, Any]]


def _some(key: str, low: float, high: float) -> Asked:
    """A share for all actuators, or for one of them."""

    def settings_at_random(machine: Machine, random: np.random.Generator) -> dict[str, Any]:
        share = random.uniform(low, high)
        name = random.choice([actuator.name for actuator in machine.actuators])
        return {key: {str(name): share} if random.random() < 0.7 else share}

    return settings_at_random


ASKED: dict[str, Asked] = {
    "torque": _some("torque_share", 1.0, 1.2),
    "ends": _some("end_torque_share", 1.0, 1.2),
    "thrust": _some("thrust_share", 0.6, 0.95),
    "each oil": _some("oil_each_share", 0.6, 0.9),
    "arms": _some("moment_arm_share", 1.0, 1.2),
    "holding": _some("holding_share", 0.2, 0.6),
    "rods": _some("buckling_share", 1.0, 1.6),
}


@pytest.mark.slow
@pytest.mark.parametrize("vary", [("areas",), ("areas", "pins")])
@pytest.mark.parametrize("name", ["single", "double"])
@pytest.mark.parametrize("seed", range(6))
def test_granting_what_a_conflict_says_gives_a_design(
    name: str, vary: tuple[str, ...], seed: int
) -> None:
    """Random shares: with all that is said to be given at once there is a design, by the check.

    Nothing is granted to another actuator than the conflict names.
    """
    machine, workspace = MACHINES[name](), workspace_of(name)
    random, given = np.random.default_rng(seed), dict[str, Any]()
    for kind in random.choice(sorted(ASKED), size=random.integers(3, 6), replace=False):
        given |= ASKED[kind](machine, random)
    granted = requirements = replace(Requirements.of(machine), **given)
    try:
        design = ad.optimize(machine, workspace, requirements, vary=vary, starts=1)
    except InfeasibleError as error:
        granted = requirements.granting(error.conflict)
        design = ad.optimize(machine, workspace, granted, vary=vary, starts=1)
        named = {c.setting for c in error.conflict}
        for key in BY_ACTUATOR:
            for actuator in machine.actuators:
                path = f"{key}.{actuator.name}"
                assert path in named or granted.setting(path) == requirements.setting(path)
    stated = replace(granted, pin_box=granted.box(machine, workspace))
    assert min(c.slack for c in check(design.machine, machine, workspace, stated)) >= -1e-9
