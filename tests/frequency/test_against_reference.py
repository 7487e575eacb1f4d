"""Frequencies and joint ranges of an independent implementation in the plane."""

from __future__ import annotations

from pathlib import Path

import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from tests import machines
from tests.reference_planar import Reference

SHIPPED = Path(__file__).parents[2] / "robots"


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof"])
def test_frequencies_agree_with_an_independent_implementation(name: str) -> None:
    """tests/reference_planar.py: complex steps and differences of energies in the plane; its own
    error is near 1e-9.
    """
    reference = Reference.load(SHIPPED / name / f"{name}.toml")
    machine = machines.named(name)
    q = machines.inner_poses(machine, 12, seed=5)
    for payload in machine.payloads:
        ours = ad.natural_modes(machine.with_payload(payload.name).at(q)).frequencies
        assert_allclose(ours, reference.frequencies(q, payload.name), rtol=1e-6)


def test_ranges_agree_with_an_independent_implementation() -> None:
    reference = Reference.load(SHIPPED / "excavator_20t" / "excavator_20t.toml")
    assert_allclose(
        machines.named("excavator_20t").range_within(0.02), reference.ranges_with(0.02), atol=1e-8
    )
