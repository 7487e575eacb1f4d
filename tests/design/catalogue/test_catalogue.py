"""Sizes from a catalogue: by hand, against exhaustive enumeration through the front door, and what
no list can meet.
"""

from __future__ import annotations

import itertools
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
from armdesign.design.requirements.check import check, slacks, static_loads
from armdesign.design.search.sequential_sdp import Search
from armdesign.errors import InfeasibleError
from armdesign.frequency.modes import hertz, lowest_frequency
from armdesign.units import mm
from tests.design.designs import MACHINES, double, single, workspace_of
from tests.design.requirements.shared import EVERYTHING
from tests.machines import named

LOOSE = Requirements(oil_total_share=1.0, oil_each_share=1.6, thrust_share=1.6, holding_share=3.0)
BORES, RODS = (80, 90, 95, 100, 105, 110, 125), (50, 56, 60, 63, 65, 70, 80)
AROUND = [(bore * mm, rod * mm) for bore in BORES for rod in RODS if rod < bore]


def enumerated(
    machine: Machine,
    workspace: Workspace,
    limits: Requirements,
    sizes: list[tuple[float, float]],
    share: bool = False,
    stoutness: float = 0.0,
) -> float:
    """Best worst frequency [Hz] of all allowed combinations, each a machine of its own; −inf if
    none is allowed.
    """
    best = -math.inf
    cases = [machine.with_payload(p.name) for p in machine.payloads]
    for choice in itertools.product(sizes, repeat=len(machine.cylinders)):
        made = tuple(
            sized(c, *size, share) for c, size in zip(machine.cylinders, choice, strict=True)
        )
        if (
            min(
                c.slack
                for c in check(replace(machine, cylinders=made), machine, workspace, limits)
            )
            < -1e-9
        ):
            continue
        if min(c.rod / c.bore for c in made) < stoutness:
            continue
        held = [
            (replace(c, cylinders=made), workspace.rigid[c.holds(workspace.rigid)]) for c in cases
        ]
        worst = min(
            float(lowest_frequency(c.evaluate(rigid)).min()) for c, rigid in held if len(rigid) > 0
        )
        best = max(best, worst)
    return best


def around(machine: Machine, seed: int, count: int) -> list[tuple[float, float]]:
    """Sizes near those of the machine, no two alike."""
    random = np.random.default_rng(seed)
    chosen = random.integers(0, len(machine.cylinders), count)
    bores = np.array([machine.cylinders[i].bore for i in chosen]) * random.uniform(
        0.85, 1.2, count
    )
    rods = np.array([machine.cylinders[i].rod for i in chosen]) * random.uniform(0.95, 1.25, count)
    return [(float(b), float(min(r, 0.9 * b))) for b, r in zip(bores, rods, strict=True)]


SMALL = {
    "single": (7,), "double": (5, 5), "excavator_20t": (3, 3, 5), "random_1": 4, "random_2": 4,
    "random_7": 3,
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
    found = select(allowed_sizes(machine, machine, space, limits, sizes_of(sizes), proportional))
    assert wanted > 0
    assert_allclose(found.frequency, wanted, rtol=1e-9)
    assert found.bound == found.frequency


def test_one_actuator_by_hand() -> None:
    """k grows with both areas (THEORY §3), so the largest annulus that oil and rod allow on the
    largest bore wins.

    Today 100/63: with 25 % more thrust a bore of 110 fits (1.21), one of 112 does not (1.254).
    Euler, d⁴/D² ≥ 63⁴/100², wants a rod of at least 63 √1.1 = 66.08: 66 is too thin, 67 is the
    next (its annulus 1.262 of today's); 70 leaves less annulus.
    """
    sizes = [(b * mm, r * mm) for b in (100, 105, 110, 112) for r in (63, 65, 66, 67, 70)]
    limits = Requirements(oil_total_share=1.3, oil_each_share=1.3, thrust_share=1.25)
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
    poses, _ = scaled_poses(machine, space, [(1.0, 1.0)])
    tree = BranchAndBound(offered, poses, machine)
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
        names, found = slacks(machine, areas, *others)
        least = np.sqrt(1 - areas[..., 1] / areas[..., 0]).min(axis=1)
        return [*names, "stout"], np.column_stack([found, least / level - 1])

    monkeypatch.setattr("armdesign.design.catalogue.separable.slacks", stricter)
    machine, space = double(), workspace_of("double")
    found = select(allowed_sizes(machine, machine, space, LOOSE, sizes_of(AROUND)))
    assert_allclose(
        found.frequency, enumerated(machine, space, LOOSE, AROUND, stoutness=level), rtol=1e-9
    )
    assert min(rod / bore for bore, rod in found.sizes) >= level
    assert found.bound == found.frequency


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
    made = [
        replace(
            machine,
            cylinders=tuple(
                sized(c, *size) for c, size in zip(machine.cylinders, pair, strict=True)
            ),
        )
        for pair in np.stack([bores, rods], axis=2)
    ]
    areas = np.array([[[c.bore_area, c.annulus_area] for c in new.cylinders] for new in made])
    names, found = slacks(machine, areas, machine, space, limits, static_loads(machine, space))
    for new, row in zip(made, found, strict=True):
        judged = check(new, machine, space, limits)
        assert names == [c.name for c in judged]
        assert_allclose(row, [c.slack for c in judged], rtol=1e-12, atol=1e-12)
    assert found[0, names.index("holding.bucket")] == -math.inf
    assert np.isfinite(found[1:]).all()


def test_what_does_not_vary_stays() -> None:
    """A bore that varies by itself is taken of the pairs with today's rod alone; brute force over
    these.
    """
    machine, space = double(), workspace_of("double")
    lift, fold = machine.cylinders
    sizes = [
        (bore * mm, rod * mm) for bore in (98, 99, 101, 102, 103, 104, 120) for rod in (63, 64)
    ]
    limits = Requirements(oil_total_share=1.1, thrust_share=1.1)
    design = ad.optimize(machine, space, limits, vary=("cylinder.lift.bore_mm",), catalogue=sizes)
    reached = []
    for bore in sorted({bore for bore, _ in sizes}):
        made = replace(machine, cylinders=(replace(lift, bore=bore), fold))
        if min(c.slack for c in check(made, machine, space, limits)) >= -1e-9:
            reached.append(float(lowest_frequency(made.evaluate(space.rigid)).min()))
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


# ---------------------------------------------------------------------------------------- pins too


@pytest.mark.slow
def test_a_start_with_free_sizes_or_those_of_a_catalogue() -> None:
    """Whatever sizes it has, the answer's are of the catalogue; from its own answer no worse."""
    machine, space = double(), workspace_of("double")
    first = ad.optimize(machine, space, starts=1)
    for start in (first, ad.optimize(machine, space, catalogue=AROUND, starts=1, start=first)):
        found = ad.optimize(machine, space, catalogue=AROUND, starts=1, start=start)
        assert {(round(c.bore, 9), round(c.rod, 9)) for c in found.machine.cylinders} <= {
            (round(bore, 9), round(rod, 9)) for bore, rod in AROUND
        }
    assert found.unrounded >= start.unrounded * (1 - 1e-6)


@pytest.mark.slow
def test_no_size_of_one_cylinder_is_better() -> None:
    """Every neighbouring bore or rod of every cylinder, the pins tuned for it: none reaches
    more.
    """
    machine, space = double(), workspace_of("double")
    both = ad.optimize(machine, space, catalogue="5mm", starts=1)
    sizes = [(c.bore, c.rod) for c in both.machine.cylinders]
    tried = 0
    for i, (bore, rod) in enumerate(sizes):
        for more in ((5 * mm, 0), (-5 * mm, 0), (0, 5 * mm), (0, -5 * mm)):
            other = list(sizes)
            other[i] = (bore + more[0], rod + more[1])
            problem = replace(both.problem, sizes=tuple(other))
            start = np.clip(both.x, *problem.bounds)
            search = Search(problem=problem, x=start).run(trust=0.1, tolerance=1e-4)
            if search.violation < 1e-6:
                tried += 1
                assert hertz(search.squared) <= both.unrounded * (1 + 1e-4)
    assert tried >= 2


def test_what_no_size_meets_is_said_of_sizes_that_were_tried() -> None:
    """Pins may follow, but 120/80 thrusts 1.44 of today: that conflict is found with the sizes as
    they are.
    """
    with pytest.raises(
        InfeasibleError, match=r"with the sizes of the catalogue that were tried, .*thrust"
    ) as error:
        ad.optimize(
            double(),
            workspace_of("double"),
            Requirements(),
            catalogue=[(120 * mm, 80 * mm)],
            starts=1,
        )
    # each by itself
    assert {one.name for one in error.value.conflict} == {"thrust.lift", "thrust.fold"}
    for one in error.value.conflict:
        least = one.limit * (1.44 / 1.1 - 1)
        # with a little for rounding, see ``refusal.MORE``
        assert least <= one.together <= 1.001 * least


@pytest.mark.slow
def test_pins_follow_the_chosen_sizes() -> None:
    """Better than the same catalogue with today's pins, no better than free sizes, and in the
    catalogue.
    """
    machine = named("excavator_20t")
    space = Workspace.grid(machine, points=(4, 4, 7))
    fixed = ad.size_cylinders(machine, space, catalogue="5mm")
    both = ad.optimize(machine, space, catalogue="5mm", starts=1)
    free = ad.optimize(machine, space, starts=1)
    assert fixed.unrounded < both.unrounded < free.unrounded
    assert min(both.slacks.values()) >= 0
    for cylinder in both.machine.cylinders:
        assert (cylinder.bore / (5 * mm)) % 1 == pytest.approx(0, abs=1e-9)
        assert (cylinder.rod / (5 * mm)) % 1 == pytest.approx(0, abs=1e-9)
    assert both.today is machine
    assert both.catalogue
    assert not free.catalogue
    assert both.bound is not None  # of free sizes and pins: so of those of a catalogue too
    assert both.bound >= free.unrounded
    # of sizes that do not move
    assert not any(gain for name, gain in both.prices.items() if name.startswith("thrust"))


# -------------------------------------------------------------------------------------- what fails


def test_says_what_no_combination_meets() -> None:
    machine, space = double(), workspace_of("double")
    # by hand: 1.2² of today's bore area sweeps and pushes 44 % too much; each of these conflicts
    # by itself
    with pytest.raises(
        InfeasibleError, match=r"meet oil.cap.total, nor .*, nor thrust.fold; relax them: "
    ) as error:
        ad.size_cylinders(
            machine, space, Requirements(thrust_share=1.0), catalogue=[(120 * mm, 80 * mm)]
        )
    assert error.value.table.count("(44 %)") == 3
    given = {c.name: c for c in error.value.conflict}
    assert len(given) == len({c.part for c in given.values()})
    for name in ("oil.cap.total", "thrust.lift", "thrust.fold"):
        assert given[name].together == pytest.approx(0.44 * given[name].limit)
    granted = Requirements(thrust_share=1.0).granting(error.value.conflict)
    ad.size_cylinders(machine, space, granted, catalogue=[(120 * mm, 80 * mm)])
    limits = Requirements(oil_total_share=0.99, oil_each_share=2, thrust_share=2)
    with pytest.raises(InfeasibleError, match=r"oil.cap.total") as error:
        ad.size_cylinders(
            machine, space, limits, catalogue=[(100 * mm, 63 * mm), (110 * mm, 70 * mm)]
        )
    assert error.value.conflict[0].together == pytest.approx(error.value.conflict[0].limit / 99)
    # by hand: 100/50 buckles (50⁴/100² < 63⁴/100²), 115/80 thrusts 1.32 times as much; either
    # limit could be met
    limits = Requirements(oil_total_share=1.5, oil_each_share=1.5, thrust_share=1.2)
    with pytest.raises(
        InfeasibleError, match=r"meet thrust.(lift|fold) together with buckling.\1, nor "
    ) as error:
        ad.size_cylinders(
            machine, space, limits, catalogue=[(100 * mm, 50 * mm), (115 * mm, 80 * mm)]
        )
    assert "\n" not in str(error.value)
    given = {c.name: c for c in error.value.conflict}
    assert set(given) == {
        f"{kind}.{name}" for kind in ("thrust", "buckling") for name in ("lift", "fold")
    }
    for name in ("lift", "fold"):  # a conflict of each cylinder's own
        thrust, buckling = given[f"thrust.{name}"], given[f"buckling.{name}"]
        assert thrust.part == buckling.part
        assert thrust.together / thrust.limit == pytest.approx(1.15**2 / 1.2 - 1)
        assert thrust.alone == pytest.approx(thrust.together)
        assert buckling.together == 0
        assert buckling.alone == pytest.approx(buckling.limit * (1 - (50 / 63) ** 4))


@pytest.mark.parametrize("seed", range(12))
def test_the_conflict_of_a_catalogue_against_enumeration(seed: int) -> None:
    """No combination meets it, some meet it without any one; what it gives is least, together and
    each alone.
    """
    machine, space, random = double(), workspace_of("double"), np.random.default_rng(seed)
    sizes = sizes_of([AROUND[k] for k in random.choice(len(AROUND), 4, replace=False)])
    shares = dict(
        zip(
            ("oil_total_share", "oil_each_share", "thrust_share"),
            random.uniform(0.8, 1.3, 3),
            strict=True,
        )
    )
    limits = Requirements(**shares, holding_share=0.5)
    pairs = itertools.product(sizes, repeat=2)
    made = [
        tuple(sized(c, *s) for c, s in zip(machine.cylinders, pair, strict=True)) for pair in pairs
    ]
    areas = np.array([[[c.bore_area, c.annulus_area] for c in cylinders] for cylinders in made])
    names, found = slacks(machine, areas, machine, space, limits, static_loads(machine, space))
    try:
        allowed_sizes(machine, machine, space, limits, sizes)
    except InfeasibleError as error:
        conflict = error.conflict
    else:
        assert np.any(np.all(found >= 0, axis=1))
        return
    assert conflict
    columns = [names.index(c.name) for c in conflict]
    allowed = np.full(len(names), -1e-9)  # least slack when all give what is said
    allowed[columns] -= [c.together / c.limit for c in conflict]
    assert np.any(np.all(found >= allowed, axis=1))
    for column, c in zip(columns, conflict, strict=True):
        part = [names.index(other.name) for other in conflict if other.part == c.part]
        rest = [j for j in part if j != column]
        assert not np.any(np.all(found[:, part] >= -1e-9, axis=1))
        assert np.any(np.all(found[:, rest] >= -1e-9, axis=1))
        limit = allowed.copy()
        limit[rest], limit[column] = -1e-9, -np.inf
        alone = np.all(found >= limit, axis=1)
        assert (c.alone is not None) == alone.any()
        if c.alone is not None:
            assert c.alone / c.limit == pytest.approx(
                max(0.0, -found[alone, column].max()), abs=1e-9
            )
    others = np.all(np.delete(found, columns, axis=1) >= -1e-9, axis=1)
    share = np.maximum(-found[np.ix_(others, columns)], 0.0).max(axis=1).min()
    assert max(c.together / c.limit for c in conflict) == pytest.approx(share, rel=2e-3)


@pytest.mark.slow
def test_what_no_pins_meet_either_is_a_conflict() -> None:
    """No catalogue can give what free sizes cannot: less steel than nothing."""
    with pytest.raises(InfeasibleError, match="no design meets cylinder_mass") as error:
        ad.optimize(
            double(),
            workspace_of("double"),
            Requirements(cylinder_mass=1.0),
            catalogue=AROUND,
            starts=1,
        )
    assert "cylinder_mass" in [c.name for c in error.value.conflict]


def test_catalogue_needs_sizes_that_vary_and_forces_that_do_not_hang_on_them() -> None:
    with pytest.raises(ArmDesignError, match='add "areas"'):
        ad.optimize(double(), workspace_of("double"), vary=("pins",), catalogue="iso")
    machine = named("redundant")
    with pytest.raises(ArmDesignError, match="4 cylinders on 2 joints"):
        ad.size_cylinders(machine, Workspace.grid(machine, points=3), catalogue="iso")
