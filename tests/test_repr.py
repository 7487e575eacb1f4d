"""What an interactive session shows of a machine fits on a screen."""

from __future__ import annotations

import pytest

import armdesign as ad
from armdesign.machine.loading import shipped


@pytest.mark.parametrize("name", [*shipped()])
def test_a_machine_is_a_few_lines(name: str) -> None:
    machine = ad.load(name)
    lines = repr(machine).splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) < 400
    for word in (name, *machine.joints, *(c.name for c in machine.payloads)):
        assert word in repr(machine)


def test_units_are_public() -> None:
    """π rad are 180°, 1 bar is 1e5 Pa."""
    assert 180 * ad.units.deg == pytest.approx(3.14159265358979)
    assert 350 * ad.units.bar == 35e6
