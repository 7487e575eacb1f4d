"""Designs for corners of the bands of which some are soft and others stiff, by brute force: each
combination of ends is a machine of its own, with bands of no width.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign import Workspace
from armdesign.design.program.constraints import constraints_at
from tests.design.designs import MACHINES, as_machine, workspace_of


def least_of_all_ends(new: ad.Machine, today: ad.Machine, space: Workspace, **bands: Any) -> float:
    """Least gain of all machines whose bands each stand at one of their ends."""
    gains = []
    for at in itertools.product(*bands.values()):
        exact = ad.Bands(**{name: (end, end) for name, end in zip(bands, at, strict=True)})
        both = (ad.frequency_band(m, space, exact, today=today) for m in (new, today))
        after, before = (band.low.frequency for band in both)
        gains.append(after / before - 1)
    return min(gains)


MIXED: list[tuple[str, dict[str, tuple[float, float]]]] = [
    ("twins", {"bulk_modulus": (0.5, 1.2), "structure": (0.0, 1.0)}),
    ("odd", {"air": (0.0, 0.02), "structure": (0.0, 2.0)}),
    ("double", {"bulk_modulus": (0.7, 1.2), "dead_volume": (0.5, 2.0), "structure": (0.0, 1.0)}),
]


@pytest.mark.parametrize(("name", "bands"), MIXED, ids=["oil", "air", "three"])
def test_designs_are_made_for_corners_of_which_some_are_soft_and_others_stiff(
    name: str, bands: dict[str, tuple[float, float]]
) -> None:
    """What the search reached is the least gain of all combinations, and no allowed sizes near
    there gain more.
    """
    machine, space, random = MACHINES[name](), workspace_of(name), np.random.default_rng(2)
    design = ad.size_cylinders(machine, space, bands=ad.Bands(**bands))
    problem = design.problem
    known = least_of_all_ends(design.machine, machine, space, **bands)
    assert design.least_gain == pytest.approx(known, abs=1e-9)
    today = problem.dynamics.corners.nominal
    unrounded = as_machine(problem, design.x)
    reached = least_of_all_ends(unrounded, machine, space, **bands)
    assert design.unrounded / today - 1 == pytest.approx(reached, abs=1e-9)
    assert design.bound is not None
    assert design.bound / today - 1 >= reached
    allowed, start = 0, problem.vector.start
    for _ in range(250):
        share = random.uniform(0.5, 1.0)
        x = start + share * (design.x - start) + random.normal(0, 0.003 * (1 - share), len(start))
        if constraints_at(problem, x).values.min() >= 0:
            allowed += 1
            other = least_of_all_ends(as_machine(problem, x), machine, space, **bands)
            assert other <= reached + 1e-4  # where the search stops
    assert allowed > 2


def test_of_many_bands_those_of_the_oil_go_together_in_designs_not_in_gains() -> None:
    """Six bands; with air masses count between their ends too."""
    bands: dict[str, Any] = {
        "bulk_modulus": (0.5, 1.2), "dead_volume": (0.2, 3.0), "air": (0.0, 0.05),
        "structure": (0.0, 1.0), "payload": (0.8, 1.2), "link_mass": (0.9, 1.1),
    }  # fmt: skip
    machine, space = MACHINES["odd"](), workspace_of("odd")
    design = ad.size_cylinders(machine, space, bands=ad.Bands(**bands))
    oil = {"bulk_modulus", "dead_volume", "air"}
    assert design.bands.ends == ({*oil, "structure"}, oil, {"structure"}, frozenset())
    assert len(design.bands.between) == 15 + 4 * (16 - 4)
    known = least_of_all_ends(design.machine, machine, space, **bands)
    assert design.least_gain <= known + 1e-9
    assert known < design.judged / design.problem.dynamics.corners.nominal - 1.01
