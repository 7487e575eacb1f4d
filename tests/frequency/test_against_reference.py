"""Frequencies and joint ranges of an independent implementation in the plane."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
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


def test_other_links_on_the_poses_of_a_workspace_agree_too(tmp_path: Path) -> None:
    """Masses times three, the boom 2 % longer: the reference reads the changed files. The machine
    that the workspace was made for has its own numbers before and after.
    """
    machine = machines.named("excavator_20t")
    space = ad.Workspace.grid(machine, 3, end_margin=0.2)
    before = ad.frequency_map(machine, space).lowest
    urdf = re.sub(
        r'<mass value="([^"]+)"', lambda m: f'<mass value="{3 * float(m[1])}"', machine.urdf_text
    )
    urdf = re.sub(r'(<joint name="stick".*?<origin xyz=")([^ ]+)', _further, urdf, flags=re.DOTALL)
    other = ad.Machine.from_text(machine.text, urdf, machine.source)
    reference = Reference.load(other.save(tmp_path / "other" / "other.toml"))
    for _ in range(2):
        mapped = ad.frequency_map(other, space)
        for payload in other.payloads:
            rows = mapped.rows_of(payload.name)
            ours = np.stack([mapped.columns[f"f{k}_hz"][rows] for k in (1, 2, 3)], axis=1)
            theirs = reference.frequencies(mapped.q[rows], payload.name)
            assert_allclose(ours, theirs, rtol=1e-6)
        assert_allclose(ad.frequency_map(machine, space).lowest, before, rtol=0, atol=0)


def _further(found: re.Match[str]) -> str:
    return f"{found[1]}{1.02 * float(found[2])}"


def test_ranges_agree_with_an_independent_implementation() -> None:
    reference = Reference.load(SHIPPED / "excavator_20t" / "excavator_20t.toml")
    assert_allclose(
        machines.named("excavator_20t").range_within(0.02), reference.ranges_with(0.02), atol=1e-8
    )
