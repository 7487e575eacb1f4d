"""What a search changes for nothing stays as it is today."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.design.program.problem import Problem
from armdesign.design.search.idle_changes import without_idle_changes
from armdesign.design.search.rounding import CheckedMachine
from armdesign.design.search.sequential_sdp import Search
from armdesign.units import mm

OWN = [(100 * mm, 56 * mm), (50 * mm, 35 * mm)]  # sizes of today's cylinders


@pytest.mark.parametrize(("catalogue", "rod"), [(None, 36 * mm), (OWN, 35 * mm)])
def test_a_telescopes_pins_stay_and_the_lifting_ones_move(
    catalogue: list[tuple[float, float]] | None, rod: float
) -> None:
    """At its worst pose the telescope stands at its end, where oil and arm of its cylinder do not
    depend on the pins; they were moved by 54 mm. The lift cylinder's gain almost all. The file's
    catalogue has no rod of 35 mm.
    """
    machine = ad.load("loader_crane")
    space = ad.Workspace.grid(machine, points=5)
    design = ad.optimize(machine, space, starts=1, catalogue=catalogue)
    new = design.machine
    assert new.linkages[2] == machine.linkages[2]
    assert new.linkages[0].pin("base") != machine.linkages[0].pin("base")
    telescope, own = new.cylinders[2], machine.cylinders[2]
    assert (telescope.stroke, telescope.closed_length) == (own.stroke, own.closed_length)
    assert (telescope.bore, telescope.rod) == pytest.approx((50 * mm, rod))
    assert all(check.slack >= -1e-9 for check in design.checks)
    moved = {"cylinder.extension.base.at_mm": [-363, 0, 180]}
    moved |= {"cylinder.extension.rod_end.at_mm": [2004, 0, -16]}
    moved |= {"cylinder.extension.closed_length_mm": 1952}
    other = ad.frequency_map(new.replace(moved), space).worst.frequency
    np.testing.assert_allclose(design.after.worst.frequency, other, rtol=1e-6)
    assert design.gain > 0.05


@pytest.mark.parametrize("catalogue", ["free", [*OWN, (104 * mm, 58 * mm), (52.4 * mm, 36 * mm)]])
def test_a_telescopes_size_stays_where_sizes_alone_vary(
    catalogue: str | list[tuple[float, float]],
) -> None:
    """It does not count at the worst pose; it took 5 % more oil for 1e-6 of the frequency."""
    machine = ad.load("loader_crane")
    space = ad.Workspace.grid(machine, points=5)
    more = ad.Requirements.of(machine, oil_total_share=1.3, oil_each_share=1.6)
    design = ad.size_cylinders(machine, space, more, catalogue=catalogue)
    lift, _, telescope = design.machine.cylinders
    assert lift.bore > 103 * mm
    assert (telescope.bore, telescope.rod) == pytest.approx((50 * mm, 35 * mm))
    assert design.gain > 0.02


def test_a_cylinder_is_tried_again_once_the_oil_that_kept_it_is_back() -> None:
    """The lift cylinder's bore was lessened for the telescope's, which gains nothing.

    It comes first in the file: with the telescope's larger bore its own old one is too much oil.
    """
    machine = ad.load("loader_crane")
    space = ad.Workspace.grid(machine, points=3)
    shares = {"lift": 0.8, "torque": 0.8, "buckling": 0.8, "thrust": 1.2, "oil_each": 1.6}
    shares |= {"oil_total": 1.0}
    given = {f"{name}_share": share for name, share in shares.items()}
    problem = Problem.of(machine, space, ad.Requirements.of(machine, **given), ("areas",))
    larger = {"cylinder.extension.bore_mm": 51.0}
    new, first = (
        CheckedMachine.of(machine.replace(changes), problem)
        for changes in (larger | {"cylinder.lift.bore_mm": 98.5}, larger)
    )
    assert new.allowed
    assert not first.allowed
    search = Search(problem=problem, x=problem.vector.start).look()
    assert without_idle_changes(new, search, None).machine.cylinders == machine.cylinders
