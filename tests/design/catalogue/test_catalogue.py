"""Sizes from a catalogue: by hand, against exhaustive enumeration through the front door, and what
no list can meet.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import ArmDesignError, Machine, Requirements, Workspace
from armdesign.design.catalogue import branch_and_bound
from armdesign.design.catalogue.branch_and_bound import BranchAndBound, select
from armdesign.design.catalogue.separable import allowed_sizes
from armdesign.design.catalogue.separable_bound import scaled_poses
from armdesign.design.catalogue.sizes import sized, sizes_of
from armdesign.design.program.corners import Corners
from armdesign.design.requirements.check import check, slacks, static_loads
from armdesign.frequency.modes import lowest_frequency
from armdesign.units import mm
from tests.design.catalogue.enumeration import AROUND, LOOSE, around, enumerated
from tests.design.designs import MACHINES, double, single, workspace_of
from tests.design.requirements.shared import EVERYTHING
from tests.machines import ANY_LIFT_AND_TORQUE, named

SMALL = {
    "single": (7,), "double": (5, 5), "sprung": (5, 5), "excavator_20t": (3, 3, 5), "random_1": 4,
    "random_2": 4, "random_7": 3,
    "crossing": 4, "four_bar_right": 4, "branched": 3, "rotator": 3, "slewing": (2, 2, 2, 3),
    "mini_excavator_2t": 3, "loader_crane": 2, "patu_boom": 7,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("proportional", [False, True])
def test_as_good_as_exhaustive_enumeration(name: str, proportional: bool) -> None:
    """Every combination built, checked and mapped as a machine; air, compliance, motors, cylinders
    across joints.
    """
    machine = MACHINES[name]() if name in MACHINES else named(name)
    space = Workspace.grid(machine, points=SMALL[name])
    sizes = around(machine, 3, {1: 20, 2: 11, 3: 5}.get(len(machine.cylinders), 2))
    sizes += [(c.bore, c.rod) for c in machine.cylinders]
    limits = replace(LOOSE, oil_total_share=1.1, moment_arm_share=0.0)
    wanted = enumerated(machine, space, limits, sizes, proportional)
    best_sizes = select(
        allowed_sizes(machine, machine, space, limits, sizes_of(sizes), proportional)
    )
    assert wanted > 0
    assert_allclose(best_sizes.frequency, wanted, rtol=1e-9)
    assert best_sizes.bound == best_sizes.frequency


def test_lift_and_torque_are_kept() -> None:
    """Every combination judged as a machine of its own; without them another one is best."""
    machine, space = double(), workspace_of("double")
    sizes = around(machine, 3, 11) + [(c.bore, c.rod) for c in machine.cylinders]
    limits = replace(LOOSE, oil_total_share=1.1, moment_arm_share=0.0)
    kept = replace(limits, lift_share=0.9, torque_share=0.95, end_torque_share=0.9)
    best, free = (
        select(allowed_sizes(machine, machine, space, each, sizes_of(sizes))).frequency
        for each in (kept, limits)
    )
    assert best == pytest.approx(enumerated(machine, space, kept, sizes), rel=1e-9)
    assert best < 0.999 * free


def test_one_actuator_by_hand() -> None:
    """k grows with both areas, so the largest annulus that oil and rod allow on the
    largest bore wins.

    Today 100/63: with 25 % more thrust a bore of 110 fits (1.21), one of 112 does not (1.254).
    Euler, d⁴/D² ≥ 63⁴/100², wants a rod of at least 63 √1.1 = 66.08: 66 is too thin, 67 is the
    next (its annulus 1.262 of today's); 70 leaves less annulus.
    """
    sizes = [(b * mm, r * mm) for b in (100, 105, 110, 112) for r in (63, 65, 66, 67, 70)]
    limits = Requirements(
        oil_total_share=1.3, oil_each_share=1.3, thrust_share=1.25, **ANY_LIFT_AND_TORQUE
    )
    design = ad.size_cylinders(single(), workspace_of("single"), limits, catalogue=sizes)
    (cylinder,) = design.machine.cylinders
    assert (cylinder.bore, cylinder.rod) == pytest.approx((110 * mm, 67 * mm))
    assert design.bound == pytest.approx(design.unrounded, rel=1e-12)
    # what depends on sizes, the tightest first, by hand; pins and strokes do not
    annulus = 1 - (110**2 - 67**2) / (100**2 - 63**2) / 1.3
    by_hand = {
        "oil.annulus.lift": annulus,
        "thrust.lift": 1 - 1.21 / 1.25,
        "buckling.lift": (67 / 63) ** 4 / 1.21 - 1,
    }
    by_hand["oil.cap.lift"] = 1 - 1.21 / 1.3
    assert [c.name for c in design.tightest if "total" not in c.name] == [*by_hand, "holding.lift"]
    assert [c.slack for c in design.tightest if c.name in by_hand] == pytest.approx(
        list(by_hand.values())
    )


def test_two_actuators_share_the_oil() -> None:
    """By hand: of 100/63 (today's) and 105/67 each stroke can be filled by either, the oil decides
    which.

    The larger bore sweeps 1.1025 of the smaller one's volume. The oil allowed is today's and what
    the larger bore takes more on one cylinder: so it fits there, and on the other only where its
    stroke is no longer.
    """
    machine, space = double(), workspace_of("double")
    volume = np.array([c.bore_area * c.stroke for c in machine.cylinders])
    sizes = [(100 * mm, 63 * mm), (105 * mm, 67 * mm)]
    for i, other in ((0, 1), (1, 0)):
        share = 1 + (1.05**2 - 1) * volume[i] / volume.sum() + 1e-6
        limits = Requirements(oil_total_share=share, oil_each_share=1.2, thrust_share=1.2)
        design = ad.size_cylinders(machine, space, limits, catalogue=sizes)
        larger = [c.bore > 0.102 for c in design.machine.cylinders]
        assert sum(larger) <= 1
        if volume[other] > volume[i]:
            assert not larger[other]
        assert design.unrounded == pytest.approx(
            enumerated(machine, space, limits, sizes), rel=1e-9
        )


def test_a_larger_catalogue_never_hurts() -> None:
    machine, space = double(), workspace_of("double")
    sizes = [AROUND[k] for k in np.random.default_rng(5).permutation(len(AROUND))] + [
        (100 * mm, 63 * mm)
    ]
    reached = []
    for count in (6, 14, 30, len(sizes)):
        offered = sizes_of(sizes[-count:])
        reached.append(select(allowed_sizes(machine, machine, space, LOOSE, offered)).frequency)
    assert np.all(np.diff(reached) >= 0)
    assert reached[-1] > reached[0]
    free = ad.size_cylinders(machine, space, LOOSE)
    assert free.bound is not None
    assert reached[-1] <= free.bound


def test_order_does_not_matter() -> None:
    """Of the cylinders in the file, and of the list; pairs given twice count once."""
    space = [Workspace.grid(double(reverse), points=5) for reverse in (False, True)]
    one = ad.size_cylinders(double(), space[0], LOOSE, catalogue=AROUND)
    other = ad.size_cylinders(double(True), space[1], LOOSE, catalogue=AROUND[::-1] + AROUND)
    assert one.unrounded == pytest.approx(other.unrounded, rel=1e-9)
    sizes = [{c.name: (c.bore, c.rod) for c in d.machine.cylinders} for d in (one, other)]
    assert sizes[0] == sizes[1]


def test_what_is_left_of_the_proof_when_it_is_cut_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """With few combinations kept the bound stays above the answer, and above the true optimum."""
    machine, space = double(), workspace_of("double")
    limits = replace(LOOSE, oil_total_share=1.1)
    offered = allowed_sizes(machine, machine, space, limits, sizes_of(AROUND))
    best = select(offered)
    monkeypatch.setattr(branch_and_bound, "LIMIT", 1)
    cut = select(offered)
    assert cut.frequency <= best.frequency <= cut.bound * (1 + 1e-12)


def test_bounds_hold_for_every_combination() -> None:
    """Weak duality: no allowed combination exceeds its own bound."""
    machine, space = double(), workspace_of("double")
    offered = allowed_sizes(machine, machine, space, LOOSE, sizes_of(AROUND))
    corners = Corners(today=machine, workspace=space)
    poses, _ = scaled_poses(machine, corners)
    tree = BranchAndBound(offered, poses, corners)
    combinations, bounds, _ = tree.above(-math.inf)
    assert len(combinations) > 20
    values = [tree.evaluate(c) for c in combinations]
    assert np.all(bounds >= np.array(values) - 1e-9)
    assert bounds.max() < 1.2 * max(values)


@pytest.mark.slow
@pytest.mark.parametrize("level", [0.6, 0.66])
def test_requirements_that_are_no_sums(level: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """The thinnest rod of all cylinders over their bores, a minimum, as enumeration judges it
    too.
    """

    def stricter(
        machine: Machine, areas: np.ndarray, *others: Any
    ) -> tuple[list[str], np.ndarray]:
        names, slack = slacks(machine, areas, *others)
        least = np.sqrt(1 - areas[..., 1] / areas[..., 0]).min(axis=1)
        return [*names, "stout"], np.column_stack([slack, least / level - 1])

    monkeypatch.setattr("armdesign.design.catalogue.separable.slacks", stricter)
    machine, space = double(), workspace_of("double")
    slack = select(allowed_sizes(machine, machine, space, LOOSE, sizes_of(AROUND)))
    assert_allclose(
        slack.frequency, enumerated(machine, space, LOOSE, AROUND, stoutness=level), rtol=1e-9
    )
    assert min(rod / bore for bore, rod in slack.sizes) >= level
    assert slack.bound == slack.frequency


def test_many_sizes_are_judged_as_machines_are() -> None:
    """Every requirement there is, on random sizes at once and on each as a machine of its own; one
    pulls nothing.
    """
    machine, space = MACHINES["excavator"](), workspace_of("excavator")
    limits = replace(Requirements.of(machine), **EVERYTHING)
    random = np.random.default_rng(2)
    bores = np.array([c.bore for c in machine.cylinders]) * random.uniform(0.8, 1.2, (7, 3))
    rods = np.array([c.rod for c in machine.cylinders]) * random.uniform(0.9, 1.1, (7, 3))
    rods[0, 2] = 0.995 * bores[0, 2]
    machines = [
        replace(
            machine,
            cylinders=tuple(
                sized(c, *size) for c, size in zip(machine.cylinders, pair, strict=True)
            ),
        )
        for pair in np.stack([bores, rods], axis=2)
    ]
    areas = np.array([[[c.bore_area, c.annulus_area] for c in new.cylinders] for new in machines])
    names, slack = slacks(machine, areas, machine, space, limits, static_loads(machine, space))
    for new, row in zip(machines, slack, strict=True):
        judged = check(new, machine, space, limits)
        assert names == [c.name for c in judged]
        assert_allclose(row, [c.slack for c in judged], rtol=1e-12, atol=1e-12)
    assert slack[0, names.index("holding.bucket")] == -math.inf
    assert np.isfinite(slack[1:]).all()


def test_what_does_not_vary_stays() -> None:
    """A bore that varies by itself is taken of the pairs with today's rod alone; brute force over
    these.
    """
    machine, space = double(), workspace_of("double")
    lift, fold = machine.cylinders
    sizes = [
        (bore * mm, rod * mm) for bore in (98, 99, 101, 102, 103, 104, 120) for rod in (63, 64)
    ]
    limits = Requirements(oil_total_share=1.1, thrust_share=1.1, **ANY_LIFT_AND_TORQUE)
    design = ad.optimize(machine, space, limits, vary=("cylinder.lift.bore_mm",), catalogue=sizes)
    reached = []
    for bore in sorted({bore for bore, _ in sizes}):
        changed = replace(machine, cylinders=(replace(lift, bore=bore), fold))
        if min(c.slack for c in check(changed, machine, space, limits)) >= -1e-9:
            reached.append(float(lowest_frequency(changed.evaluate(space.rigid)).min()))
    assert 1 < len(reached) < 7
    assert design.unrounded == pytest.approx(max(reached), rel=1e-9)
    assert design.machine.cylinders[1] == fold
    assert design.machine.cylinders[0].rod == lift.rod
    with pytest.raises(
        ArmDesignError,
        match=r"no size with the rod of the lift cylinder, 63 mm; offer one, or let",
    ):
        ad.optimize(
            machine,
            space,
            limits,
            vary=("cylinder.lift.bore_mm",),
            catalogue=[(100 * mm, 64 * mm)],
        )
