"""Machines of one drawing: against machines built one by one, and where the estimate fails."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import armdesign as ad
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.worst_frequency import worst_anywhere
from armdesign.influence.family import rebuilt
from armdesign.influence.widths import family_of, widths_of
from armdesign.machine.changes import changed_machine
from armdesign.units import share_text
from tests import machines

ALL = """
pin_mm = 1.0
bar_mm = 1.0
payload_percent = 10
link_mass_percent = 5
cylinder_mass_percent = 10
bulk_modulus_percent = 10
entrained_air_percent = 0.2
dead_volume_percent = 10
compliance_percent = 30
keys = { "cylinder.boom.bore_mm" = 0.1 }
"""


def toleranced(name: str, widths: str = ALL) -> ad.Machine:
    machine = machines.named(name)
    text = machine.text.split("\n[tolerances]")[0]  # it stands last in shipped files
    return ad.Machine.from_text(
        f"{text}\n[tolerances]\n{widths}", machine.urdf_text, machine.source
    )


@pytest.fixture(scope="module")
def answer() -> ad.Tolerances:
    machine = toleranced("excavator_20t")
    return ad.tolerances(machine, ad.Workspace.grid(machine, points=5), count=512)


def test_the_batch_is_machines_built_one_by_one(answer: ad.Tolerances) -> None:
    """Numbers by a changed file, pins in the four-bar among them, and links by a changed URDF."""
    machine, rival = answer.machine, answer.rivals[0]
    rows = (0, 100, 511)
    family = family_of(machine, answer.widths, answer.values[list(rows)])
    poses = rival.ends.follow(family, rival.pose.q)
    for row, q in zip(rows, poses, strict=True):
        values, factors = {}, {}
        for width, value in zip(answer.widths, answer.values[row], strict=True):
            if width.number is None:
                factors[machine.arm.coordinates[width.body].name] = float(value)
            else:
                values[width.number.location] = float(value)
        assert len(values) > 20
        other = rebuilt(machine, values).with_payload(rival.pose.payload)
        bodies = zip(machine.arm.coordinates, machine.arm.bodies_apart, strict=True)
        parts = [
            (factors[joint.name], body.rigid_poses(q[None])) for joint, body in bodies
        ]  # their sum is tested against a heavier URDF in test_family.py
        rigid = machine.rigid_poses(q[None])
        for name in ("mass_matrix", "gravity_torque", "gravity_stiffness"):
            total = sum(factor * getattr(part, name) for factor, part in parts)
            object.__setattr__(rigid, name, total)
        expected = lowest_frequency(other.evaluate(rigid))[0]
        assert answer.of_rivals[row, 0] == pytest.approx(expected, rel=1e-9)


def test_machines_touch_their_own_end_stops(answer: ad.Tolerances) -> None:
    """Each machine's boom is at its own stop less the end margin, exactly."""
    machine, rival = answer.machine, answer.rivals[0]
    family = family_of(machine, answer.widths, answer.values[:64])
    poses = rival.ends.follow(family, rival.pose.q)
    assert np.ptp(poses, axis=0).max() > 1e-3
    np.testing.assert_allclose(rival.ends.room(family, poses), 0.0, atol=1e-12)


@pytest.mark.slow
def test_a_machine_searched_anew_is_what_the_batch_says() -> None:
    """With its file changed, its own ranges and its own workspace: not only at that pose."""
    machine = toleranced("excavator_20t", ALL.replace("link_mass_percent = 5\n", ""))
    answer = ad.tolerances(machine, ad.Workspace.grid(machine, points=7), count=16)
    for row in (3, 12):
        values = {
            width.number.location: float(value)
            for width, value in zip(answer.widths, answer.values[row], strict=True)
            if width.number is not None
        }
        other = rebuilt(machine, values)
        worst = ad.frequency_map(other, ad.Workspace.grid(other, points=7)).worst.frequency
        assert answer.frequencies[row] == pytest.approx(worst, rel=1e-6)


@pytest.mark.slow
def test_small_tolerances_are_linear() -> None:
    """A tenth of the width, a hundredth of the error; and the share equals the linear one."""
    errors = []
    for scale in (1.0, 0.1):
        widths = f"pin_mm = {scale}\npayload_percent = {10 * scale}\ncompliance_percent = {scale}"
        machine = toleranced("excavator_20t", widths)
        answer = ad.tolerances(machine, ad.Workspace.grid(machine, points=5), count=256)
        errors.append(np.abs(answer.linear - answer.frequencies).max())
    assert errors[1] < 0.02 * errors[0]
    assert answer.share == pytest.approx(answer.linear_share, abs=0.02)
    assert answer.share == pytest.approx(0.5, abs=0.05)


def test_variance_adds_up(answer: ad.Tolerances) -> None:
    """Of independent numbers: the deviation of the linear estimate follows from its parts."""
    table = answer.by_number
    assert table["variance"].sum() == pytest.approx(1.0)
    assert table["number"].iloc[0] == "fluid.entrained_air_percent"
    assert table["curvature_hz"].iloc[0] > 0.03
    low, high = (np.array([w.limits[i] for w in answer.widths]) for i in (0, 1))
    spread = answer.slopes[0, :, 0] * (high - low) / np.sqrt(12)
    assert answer.linear.std() == pytest.approx(np.sqrt(spread @ spread), rel=0.02)


@pytest.mark.slow
def test_equal_seeds_give_equal_machines(answer: ad.Tolerances) -> None:
    again, other = (
        ad.tolerances(
            answer.machine, ad.Workspace.grid(answer.machine, points=5), count=64, seed=s
        )
        for s in (0, 1)
    )
    np.testing.assert_array_equal(again.frame["worst_hz"], answer.frame["worst_hz"][:64])
    assert not np.any(other.values == again.values)


def test_normal_widths_are_two_deviations() -> None:
    widths = 'distribution = "normal"\npin_mm = 1.0\nentrained_air_percent = 0.2'
    machine = toleranced("excavator_20t", widths)
    answer = ad.tolerances(machine, ad.Workspace.grid(machine, points=4), count=4096)
    names = [width.name for width in answer.widths]
    pin = answer.values[:, names.index("cylinder.boom.base.at_mm.0")]
    assert pin.std() == pytest.approx(0.5, rel=0.01)
    air = answer.values[:, names.index("fluid.entrained_air_percent")]
    assert air.min() == 0.0
    assert np.mean(air == 0.0) == pytest.approx(0.5, abs=0.01)


@pytest.mark.slow
def test_the_least_frequency_is_stated_or_that_of_the_file() -> None:
    widths = "pin_mm = 1.0\nleast_hz = 0.75"
    machine = toleranced("excavator_20t", widths)
    workspace = ad.Workspace.grid(machine, points=4)
    stated = ad.tolerances(machine, workspace, count=64)
    given = ad.tolerances(machine, workspace, count=64, least=0.9)
    assert (stated.least, stated.share) == (0.75, 1.0)
    assert (given.least, given.share) == (0.9, 0.0)
    assert "of at least 0.750 Hz (stated)" in stated.sheets()[0].rows[1][1]


def test_a_pose_that_moves_is_counted() -> None:
    """With nearly as much in the empty bucket as in the full one the worst pose may be either."""
    machine = toleranced(
        "excavator_20t", 'payload_percent = 80\nkeys = { "fluid.bulk_modulus_MPa" = 1 }'
    )
    machine = machine.replace({"payload.full.mass_kg": 800.0})
    answer = ad.tolerances(machine, ad.Workspace.grid(machine, points=5), count=256)
    lowest = answer.of_rivals.argmin(axis=1)
    assert answer.moved == pytest.approx(np.mean(lowest > 0))


def test_tables_and_picture(answer: ad.Tolerances) -> None:
    summary, _, percentiles, numbers = answer.sheets()
    assert summary.rows[0][1] == f"512, {len(answer.widths)} numbers differ"
    assert "of this file: none is stated" in summary.rows[1][1]
    assert len(percentiles.rows) == 3
    assert numbers.rows[0][0] == "fluid.entrained_air_percent"
    assert "–" not in f"{numbers.rows}{numbers.note}"  # which is explained where it stands
    assert answer.plot().get_xlabel() == "worst frequency [Hz]"


BAD = [
    ("", "tolerances: states no width; add some"),
    ("least_hz = 0.7", "tolerances: states no width"),
    ("pin_mm = 0", r"pin_mm: 0(.0)? is not allowed; give a number in \(0, 100000\]"),
    ("pins_mm = 1", 'did you mean "pin_mm"'),
    ('keys = { "cylinder.boom.bora_mm" = 1 }', 'did you mean "cylinder.boom.bore_mm"'),
    ('keys = { "cylinder.boom" = 1 }', "is a table; name one of its numbers"),
    ('keys = { "payload.full.pitch_deg.0" = 1 }', "has no tolerance: all machines have the same"),
    ("spring_stiffness_percent = 5", "spring_stiffness_percent give no number a width"),
]


def test_machines_whose_linkage_opens_are_one_line() -> None:
    """Bars and pins far from where they are drawn: stiffness is infinite in some, no number."""
    wide = toleranced("excavator_20t", "bar_mm = 300\npin_mm = 100")
    workspace = ad.Workspace.grid(wide, points=3)
    with pytest.raises(ad.ArmDesignError, match="of the machines cannot take the worst") as caught:
        ad.tolerances(wide, workspace, count=1024)
    named = re.search(r"they can: pin_mm = (\S+), bar_mm = (\S+)$", str(caught.value))
    assert named
    pin, bar = map(float, named.groups())
    assert bar / 300 == pytest.approx(pin / 100, rel=0.01)
    widths = (f"bar_mm = {share * bar}\npin_mm = {share * pin}" for share in (1.0, 1.03))
    working, failing = (toleranced("excavator_20t", each) for each in widths)
    assert len(ad.tolerances(working, workspace, count=1024).values) == 1024
    with pytest.raises(ad.ArmDesignError, match="cannot take the worst pose"):
        ad.tolerances(failing, workspace, count=1024)


@pytest.mark.parametrize(("widths", "words"), BAD)
def test_bad_widths_are_one_line(widths: str, words: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=words) as caught:
        ad.tolerances(toleranced("excavator_20t", widths), count=16)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"count": 4}, "count: 4 is not allowed"),
        ({"least": -1.0}, "least: -1 Hz is not allowed"),
        ({"seed": -1}, "seed: -1 is not allowed"),
    ],
)
def test_bad_options_are_one_line(options: dict[str, float], words: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=words):
        ad.tolerances(toleranced("paper_1dof", "pin_mm = 1"), **options)


def test_a_file_without_tolerances_takes_a_width_by_its_key_path() -> None:
    """As the refusal of a file without widths says."""
    written = ad.load("paper_1dof").replace({"tolerances.pin_mm": 0.5})
    changed = changed_machine(ad.load("paper_1dof"), {"tolerances.pin_mm": 0.5}, "--set")
    assert written.section == changed.section
    assert len(ad.tolerances(changed, count=16).values) == 16


def test_key_paths_need_no_quotes() -> None:
    """Unquoted they are tables in TOML."""
    widths = (
        "pin_mm = 1\n[tolerances.keys]\ncylinder.boom.bore_mm = 0.1\nfluid.bulk_modulus_MPa = 9"
    )
    stated = toleranced("excavator_20t", widths).section.tolerances.keys
    assert stated == {"cylinder.boom.bore_mm": 0.1, "fluid.bulk_modulus_MPa": 9.0}


def test_saving_keeps_the_widths(tmp_path: object) -> None:
    machine = toleranced("excavator_20t").replace({"cylinder.boom.bore_mm": 125.0})
    assert machine.section.tolerances.keys == {"cylinder.boom.bore_mm": 0.1}
    assert widths_of(ad.load(machine.save(f"{tmp_path}/excavator_20t.toml"))) == widths_of(machine)


def test_machines_that_no_search_near_finds_do_not_count() -> None:
    """Pins ± 600 mm: some machines take no pose at all; their sheets count the rest."""
    wide = toleranced("patu_boom", "pin_mm = 600")
    answer = ad.tolerances(wide, ad.Workspace.grid(wide, points=5), count=64)
    note = answer.sheets()[0].note
    assert np.isnan(answer.searched).any()
    assert f"in {np.isfinite(answer.searched).sum()} of the machines" in note
    assert "nan" not in note


def test_machines_without_a_pose_in_stroke_meet_nothing() -> None:
    """Pins ± 600 mm: what has no pose within its stroke by itself had 0 or 11.6 Hz."""
    wide = toleranced("patu_boom", "pin_mm = 600")
    answer = ad.tolerances(wide, ad.Workspace.grid(wide, points=5), count=64, least=1.0)
    without = []
    for row, values in enumerate(answer.values):
        stated = zip(answer.widths, values.tolist(), strict=True)
        other = rebuilt(wide, {width.number.location: value for width, value in stated})
        try:
            ad.Workspace.grid(other, points=25)
        except ad.ArmDesignError as error:
            if "pins are" in str(error):  # apart, never within the stroke
                without.append(row)
    assert len(without) > 5
    assert not answer.working[without].any()
    lost = np.count_nonzero(~answer.working)
    assert answer.share == np.count_nonzero(answer.frequencies >= 1.0) / 64
    assert np.all(answer.acceptance.slacks[~answer.working, 0] == -1.0)
    summary, _, percentiles, numbers = answer.sheets()
    assert summary.rows[2][1].startswith(f"{lost}: no pose near those of the drawing is in stroke")
    assert "nan" not in f"{summary.rows}{percentiles.rows}{numbers.rows}"
    assert any("–" in row for row in numbers.rows) == ("–: no pose" in numbers.note)
    assert answer.plot().get_xlabel() == "worst frequency [Hz]"


def test_machines_whose_worst_pose_is_out_of_stroke_are_searched_in_it() -> None:
    """Pins ± 50 mm: as their own maps have it."""
    wide = toleranced("patu_boom", "pin_mm = 50")
    answer = ad.tolerances(wide, ad.Workspace.grid(wide, points=5), count=64)
    for values, found in zip(answer.values, answer.searched, strict=False):
        stated = {
            width.number.location: float(value)
            for width, value in zip(answer.widths, values, strict=True)
            if width.number is not None
        }
        other = rebuilt(wide, stated)
        worst = worst_anywhere(other, ad.Workspace.grid(other, points=21))
        assert found == pytest.approx(worst.frequency, rel=2e-3)


def test_no_machine_is_taken_beyond_another_end_than_the_one_its_worst_pose_follows() -> None:
    """Pins ± 20 mm: poses out of stroke or beyond joint limits counted, at 0 Hz for some."""
    wide = toleranced("mini_excavator_2t", "pin_mm = 20")
    answer = ad.tolerances(wide, ad.Workspace.grid(wide, points=5), count=64)
    assert np.all(answer.frequencies[:32] >= (1 - 1e-4) * answer.searched)


def test_poses_that_only_air_makes_the_worst_are_found() -> None:
    """As their own maps have it: the 5th percentile of both was 10 % too high."""
    machine = toleranced("paper_1dof", "entrained_air_percent = 1.0\nbulk_modulus_percent = 5")
    answer = ad.tolerances(machine, count=32)
    maps = []
    for values in answer.values:
        stated = zip(answer.widths, values.tolist(), strict=True)
        other = rebuilt(machine, {w.number.location: value for w, value in stated if w.number})
        maps.append(worst_anywhere(other, answer.workspace).frequency)
    assert len(answer.rivals) == 1
    assert len(answer.others) == 1
    np.testing.assert_allclose(answer.searched, maps, rtol=1e-4)
    np.testing.assert_allclose(answer.frequencies, maps, rtol=0.01)
    low, mapped = (np.percentile(found, 5) for found in (answer.frequencies, maps))
    assert low == pytest.approx(mapped, rel=1e-4)


def test_the_search_sees_what_the_poses_miss() -> None:
    """Without the pose that air makes the worst, the sheet says how much lower the worst is."""
    machine = toleranced("paper_1dof", "entrained_air_percent = 1.0")
    answer = ad.tolerances(machine, count=16)
    blind = replace(answer, others=(), of_rivals=answer.of_rivals[:, :1])
    seen = 1 - float(np.min(answer.searched / blind.frequencies))
    assert seen > 0.1
    assert f"finds {share_text(seen)} less at most, in 16" in blind.sheets()[0].note
