"""Exact derivatives of the worst frequency against machines with another number."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import Array
from armdesign.frequency.worst_frequency import worst_anywhere
from armdesign.influence.family import Family, rebuilt
from armdesign.influence.rivals import Rival, rivals
from armdesign.influence.slopes import change_along, eigenvalue_slopes, mass_slopes, slopes
from armdesign.machine.file.numbers import Number, numbers_of
from tests import machines
from tests.machines import CylinderSpec, Joint

MANY_NUMBERS = ("excavator_20t", "loader_crane", "rocking", "heavy_bars")  # two machines for each


def worst(name: str, points: int = 5) -> tuple[ad.Machine, Rival]:
    machine = machines.named(name)
    return machine, rivals(machine, ad.Workspace.grid(machine, points=points))[0]


def by_differences(machine: ad.Machine, rival: Rival, number: Number) -> float:
    """Fourth order, of machines with their own files, at poses that follow their ends."""

    def frequency(value: float) -> float:
        family = Family.of(rebuilt(machine, {number.location: value}), {}, 1)
        return float(rival.frequencies(family)[0])

    step = 1e-4 * (abs(number.value) or 1e-9)
    near, far = (
        frequency(number.value + k * step) - frequency(number.value - k * step) for k in (1, 2)
    )
    return (8 * near - far) / (12 * step)


@pytest.mark.parametrize(
    "name",
    [
        "crossing",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("redundant", "rotator", *MANY_NUMBERS)
        ),
    ],
)
def test_slopes_are_those_of_differences(name: str) -> None:
    """Of every number that is not zero, at which the schema's bounds would be crossed."""
    machine, rival = worst(name)
    own = {"end_margin", "pitch_deg"}  # ends move with these alone: see the test below
    numbers = [
        number
        for number in numbers_of(machine.section).values()
        if number.value != 0 and not own & set(number.location)
    ]
    exact = slopes(machine, rival, numbers)[:, 0]
    measured = np.array([by_differences(machine, rival, number) for number in numbers])
    sizes = np.array([abs(number.value) for number in numbers])
    tolerance = 1e-7 * rival.frequency
    np.testing.assert_allclose(exact * sizes, measured * sizes, rtol=1e-6, atol=tolerance)
    assert np.count_nonzero(np.abs(exact * sizes) > 1e-3 * rival.frequency) > 5


KEYS = [
    ("cylinder.boom.closed_length_mm", 1825.0, 0.5),
    ("cylinder.boom.bore_mm", 120.0, 0.1),
    ("cylinder.bucket.four_bar.rocker_mm", 578.7, 0.2),
    ("payload.full.mass_kg", 1600.0, 5.0),
    ("payload.full.pitch_deg.1", 240.0, 0.2),
    ("requirements.end_margin", 0.02, 2e-4),
]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "value", "step"), KEYS)
def test_the_worst_pose_of_the_new_machine_has_the_slope(
    path: str, value: float, step: float
) -> None:
    """The worst pose looked for anew over its own ranges, not followed."""
    machine, rival = worst("excavator_20t", points=7)
    number = numbers_of(machine.section)[path]
    assert number.value == value

    def lowest(at: float) -> float:
        other = rebuilt(machine, {number.location: at})
        return rivals(other, ad.Workspace.grid(other, points=7))[0].frequency

    measured = (lowest(value + step) - lowest(value - step)) / (2 * step)
    assert slopes(machine, rival, [number])[0, 0] == pytest.approx(measured, rel=2e-4)


@pytest.mark.parametrize(
    ("path", "step"),
    [
        ("cylinder.boom.stroke_mm", 0.5),
        ("cylinder.boom.base.at_mm.0", 0.5),
        ("cylinder.bucket.four_bar.coupler_mm", 0.2),
        ("cylinder.bucket.rod_mm", 0.1),
        ("payload.full.mass_kg", 0.2),
        ("supply.return_pressure_bar", 0.02),
    ],
)
def test_a_worst_pose_without_load_on_a_cylinder_stays_in_the_kink(path: str, step: float) -> None:
    """In oil with air; found anew for each number: by the slopes at its place it was 7 × less."""
    machine = ad.load("mini_excavator_2t").replace({"fluid.entrained_air_percent": 1.0})
    number = numbers_of(machine.section)[path]

    def first(value: float) -> Rival:
        other = rebuilt(machine, {number.location: value})
        return rivals(other, ad.Workspace.grid(other, points=5))[0]

    worst = first(number.value)
    words = [end.words for end in worst.ends.ends]
    assert words == ["boom out", "stick in", "no load on bucket"]
    more, less = (first(number.value + sign * step).frequency for sign in (1, -1))
    measured = (more - less) / (2 * step)
    found = slopes(machine, worst, [number])[0]
    assert found[0] == found[1] == pytest.approx(measured, rel=5e-3)


SLEWING = """
name = "slewing"
joints = ["slew", "boom"]
tool = { link = "boom", at_mm = [2000, 0, 0] }
[links.ground]
[links.slew]
parent = "ground"
at_mm = [0, 0, 1000]
type = "continuous"
axis = [0, 0, 1]
mass_kg = 300
centre_mm = [200, 0, 100]
inertia_kg_m2 = [20, 30, 30]
[links.boom]
parent = "slew"
at_mm = [300, 0, 0]
length_mm = 2000
mass_kg = 200
limits_deg = [-20, 60]
[payload.full]
mass_kg = 400
link = "boom"
at_mm = [2000, 0, 0]
[fluid]
bulk_modulus_MPa = 1200
entrained_air_percent = 1
[supply]
pressure_bar = 250
return_pressure_bar = 5
flow_l_per_min = 100
[motor.slew]
displacement_cm3 = 160
gear_ratio = 24
trapped_volume_l = { a = 2, b = 2 }
[cylinder.lift]
bore_mm = 100
rod_mm = 56
stroke_mm = 700
closed_length_mm = 800
dead_volume_l = { cap = 1.5, annulus = 1.5 }
base = { link = "slew", at_mm = [200, 0, -700] }
rod_end = { link = "boom", at_mm = [800, 0, -50] }
"""


def tilted(path: str) -> tuple[ad.Machine, Rival, Number, Callable[[float], float]]:
    """The slewing machine, and by how much a tilt changes its worst frequency, sought anew."""
    machine = ad.Machine.from_text(SLEWING, "", Path("slewing.toml"))
    rival = rivals(machine, ad.Workspace.grid(machine, points=9))[0]
    number = numbers_of(machine.section)[path]

    def change(step: float) -> float:
        other = rebuilt(machine, {number.location: step})
        anew = worst_anywhere(other, ad.Workspace.grid(other, points=[25, 9]))
        return anew.frequency - rival.frequency

    return machine, rival, number, change


@pytest.mark.parametrize("path", ["links.slew.axis.0", "links.slew.axis.1"])
def test_a_tilt_of_the_slew_makes_another_turn_the_worst_to_either_side(path: str) -> None:
    """Against worst poses sought anew over all turns; at one turn both sides had one slope."""
    machine, rival, number, change = tilted(path)
    found = slopes(machine, rival, [number])[0]
    for way, slope in zip((1, -1), found, strict=True):
        near, far = change(way * 1e-3), change(way * 2e-3)
        assert slope == pytest.approx(way * (4 * near - far) / 2e-3, rel=2e-3)
        assert slope * way < -0.04


def test_two_tilts_at_once_make_one_turn_the_worst() -> None:
    """Along both, against worst poses sought anew; the sum of each alone is that of two turns."""
    machine = ad.Machine.from_text(SLEWING, "", Path("slewing.toml"))
    rival = rivals(machine, ad.Workspace.grid(machine, points=9))[0]
    known = numbers_of(machine.section)
    numbers = [known[f"links.slew.axis.{k}"] for k in (0, 1)]

    def change(step: float) -> float:
        other = rebuilt(machine, {number.location: step for number in numbers})
        anew = worst_anywhere(other, ad.Workspace.grid(other, points=[25, 9]))
        return anew.frequency - rival.frequency

    along = change_along(machine, rival, dict.fromkeys(numbers, 1.0))
    assert along == pytest.approx((4 * change(1e-3) - change(2e-3)) / 2e-3, rel=2e-3)
    assert along > 0.9 * slopes(machine, rival, numbers)[:, 0].sum()


def test_along_one_number_the_change_is_its_slope() -> None:
    """Of links, oil, load and pins, to either side."""
    machine = ad.Machine.from_text(SLEWING, "", Path("slewing.toml"))
    rival = rivals(machine, ad.Workspace.grid(machine, points=9))[0]
    numbers = [*numbers_of(machine.section).values()]
    for number, pair in zip(numbers, slopes(machine, rival, numbers), strict=True):
        for way, slope in zip((1, -1), pair, strict=True):
            if number.low <= number.value + 0.01 * way <= number.high:
                along = change_along(machine, rival, {number: 0.01 * way})
                assert along == pytest.approx(0.01 * way * slope, rel=1e-5, abs=1e-9)


@pytest.mark.slow
def test_the_exact_effect_of_a_tilt_is_that_of_the_worst_turn() -> None:
    """In a kink, where the tilt leaves the slew without load: from one turn it was not found."""
    machine, _, number, change = tilted("links.slew.axis.1")
    answer = ad.sensitivity(machine, ad.Workspace.grid(machine, points=9))
    row = answer.frame.set_index("key").loc[number.path]
    assert row["up_exact_hz"] == pytest.approx(change(0.1), abs=1e-5)
    assert row["down_exact_hz"] == pytest.approx(change(-0.1), abs=1e-5)


@pytest.mark.parametrize("tilt", [-4, 4])
def test_the_ends_of_a_whole_turn_hold_no_pose(tilt: float) -> None:
    """A tilted slew, whose worst turn is 180°, in a kink: a tilt across turns the pose alone.

    By symmetry the slope is 0; held at 180° it was another, of the same pose at −180°, too.
    """
    text = SLEWING.replace("axis = [0, 0, 1]", f"axis = [0, 0, 1]\nturn_deg = [0, {tilt}, 0]")
    machine = ad.Machine.from_text(text, "", Path("slewing.toml"))
    found = rivals(machine, ad.Workspace.grid(machine, points=9))
    numbers = [numbers_of(machine.section)["links.slew.turn_deg.0"]]
    for rival in found:
        assert not any("slew" in end.words for end in rival.ends.ends if end.kind == "joint")
        if any(end.kind == "load" for end in rival.ends.ends):
            assert slopes(machine, rival, numbers) == pytest.approx(np.zeros((1, 2)), abs=1e-6)
    for k, rival in enumerate(found):
        for other in found[:k]:
            apart = rival.pose.q - other.pose.q
            assert np.abs([np.sin(apart[0] / 2), apart[1]]).max() > 1e-3


def test_no_worst_pose_follows_a_load_that_is_none_at_all_poses() -> None:
    """On a level slide a barrel alone, a little inclined, loads its cylinder: 1e-6 of its thrust.
    By that as a kink the barrel's mass had a slope 0.8 % off, and poses left their ranges.
    """
    weight = "barrel_kg = 20\nrod_kg = 40"
    machine = machines.build(
        [
            Joint("slide", "root", xyz=(0, 0, 1), axis=(1, 0, 0), kind="prismatic"),
            Joint("luff", "slide", xyz=(1.2, 0, 0)),
        ],
        [
            CylinderSpec(
                "push", ("root", (-1.5, 0, 1.02)), ("slide", (0.5, 0, 0.03)), extra=weight
            ),
            CylinderSpec("lift", ("slide", (0.5, 0, -0.4)), ("luff", (0.6, 0, -0.1))),
        ],
        air_percent=2.0,
    ).replace({"supply.return_pressure_bar": 0.0})
    worst = rivals(machine, ad.Workspace.grid(machine, points=5))[0]
    assert "no load on push" not in [end.words for end in worst.ends.ends]
    number = numbers_of(machine.section)["cylinder.push.barrel_kg"]
    more, less = (machine.replace({number.path: value}) for value in (21.0, 19.0))
    new, old = (rivals(m, ad.Workspace.grid(m, points=5))[0].frequency for m in (more, less))
    found = slopes(machine, worst, [number])[0]
    assert found[0] == pytest.approx((new - old) / 2, rel=1e-4)


def test_bulk_modulus_is_worth_half_the_share_of_the_oil() -> None:
    """Without air and compliance only the oil's share of ω² is proportional to it."""
    machine = machines.rigid("excavator_20t")
    workspace = ad.Workspace.grid(machine, points=5)
    rival = rivals(machine, workspace)[0]
    number = numbers_of(machine.section)["fluid.bulk_modulus_MPa"]
    poses = machine.with_payload(rival.pose.payload).at(rival.pose.q)
    shape = ad.natural_modes(poses).shapes[0, :, 0]
    share = shape @ poses.hydraulic_stiffness[0] @ shape
    share /= shape @ poses.stiffness_matrix[0] @ shape
    expected = rival.frequency * share / 2
    assert slopes(machine, rival, [number])[0, 0] * number.value == pytest.approx(expected)


def test_all_masses_together_are_worth_half_the_frequency() -> None:
    """Times 1 + e: f falls by e/2 of itself; with gravity the forces grow, too."""
    machine, rival = worst("rotator")
    payload = numbers_of(machine.section)["payload.load.mass_kg"]
    total = mass_slopes(machine, rival)[:, 0].sum()
    total += slopes(machine, rival, [payload])[0, 0] * payload.value
    heavier = machine.replace({payload.path: 1.001 * payload.value})
    family = Family.of(heavier, {}, 1, np.full((1, len(machine.arm.coordinates)), 1.001))
    lighter = machine.replace({payload.path: 0.999 * payload.value})
    other = Family.of(lighter, {}, 1, np.full((1, len(machine.arm.coordinates)), 0.999))
    measured = (rival.frequencies(family)[0] - rival.frequencies(other)[0]) / 0.002
    assert total == pytest.approx(measured, rel=1e-5)
    assert total == pytest.approx(-rival.frequency / 2, rel=0.5)


def test_where_modes_coincide_up_and_down_differ() -> None:
    """K = diag(2, 2, 5), M = 1: along diag(1, −3, 9) the lowest falls either way."""
    mass, stiffness = np.eye(3), np.diag([2.0, 2.0, 5.0])
    along = np.array([np.diag([1.0, -3.0, 9.0]), [[0, 1, 0], [1, 0, 0], [0, 0, 0]]])
    both_slopes = eigenvalue_slopes(mass, stiffness, np.zeros((2, 3, 3)), along)
    np.testing.assert_allclose(both_slopes, [[-3.0, 1.0], [-1.0, 1.0]], atol=1e-12)

    def lowest(step: float, direction: Array) -> float:
        return float(np.linalg.eigvalsh(stiffness + step * direction)[0])

    for slope, direction in zip(both_slopes, along, strict=True):
        for step, one_sided in ((1e-6, slope[0]), (-1e-6, slope[1])):
            change = lowest(step, direction) - 2.0
            assert change == pytest.approx(one_sided * step, abs=1e-11)


def test_a_mass_that_grows_lowers_the_eigenvalue() -> None:
    """K = 2, M = 1 + p: λ = 2/(1 + p)."""
    one = np.ones((1, 1))
    both_slopes = eigenvalue_slopes(one, 2 * one, one[None], 0 * one[None])
    np.testing.assert_allclose(both_slopes, [[-2.0, -2.0]])


def test_a_number_alone_has_the_slope_that_it_has_among_all() -> None:
    """Of a machine on springs: a stiffness that steps alone was a traceback."""
    machine, rival = worst("rocking", points=3)
    numbers = list(numbers_of(machine.section).values())
    together = slopes(machine, rival, numbers)
    alone = np.concatenate([slopes(machine, rival, [number]) for number in numbers])
    np.testing.assert_allclose(alone, together, rtol=1e-9, atol=1e-12 * np.abs(together).max())
