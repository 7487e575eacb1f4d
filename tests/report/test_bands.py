"""The sheet of the bands: which ends it names, and that no machine is without one."""

from __future__ import annotations

import pytest

import armdesign as ad
from armdesign.report.bands import widths
from armdesign.report.map_reports import headline, least_between, poses_of_ends
from armdesign.report.maps import map_sheets
from tests import machines
from tests.machines import machine_with, named
from tests.sprung import rocking

CASES = [
    ("structure = [0.0, 1.0]", ("softest", "rigid"), "structure 0 to 1 × as soft"),
    ("structure = [0.3, 1.0]", ("softest", "stiffest"), "structure 0.3 to 1 × as soft"),
    (
        "structures = { boom = [0.0, 1.0] }",
        ("softest", "stiffest"),
        "structure of boom 0 to 1 × as soft",
    ),
    ("bulk_modulus_share = [0.9, 1.1]", ("softest", "stiffest"), "oil 0.9 to 1.1 ×"),
    (
        "structure = [0.0, 1.0]\ndead_volume_share = [0.9, 1.0]",
        ("softest", "stiffest"),
        "structure",
    ),
    (
        "structure = [0.0, 1.0]\nentrained_air_percent = [0, 1]",
        ("softest", "stiffest"),
        "structure",
    ),
    ("payload_share = [0.8, 1.2]", ("lowest", "highest"), "payload 0.8 to 1.2 ×"),
    ("structure = [0.4, 0.4]", ("lowest", "highest"), "structure 0.4 × as soft"),
    ("", ("softest", "rigid"), "structure 0 to 1 × as soft as today's oil, assumed: the file"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("bands", "ends", "words"), CASES)
def test_a_map_shows_the_ends_of_the_bands(bands: str, ends: tuple[str, str], words: str) -> None:
    machine = machine_with(ad.load("excavator_20t"), bands)
    workspace = ad.Workspace.grid(machine, points=4)
    sheet = map_sheets(ad.frequency_map(machine, workspace))[1]
    band = ad.frequency_band(machine, workspace, ad.Bands.shown(machine))
    assert sheet.columns == ("", ends[0], "at file values", ends[1])
    frequencies = band.low.frequency, band.nominal, band.high.frequency
    own = tuple(f"{frequency:.3f} Hz" for frequency in frequencies)
    assert sheet.rows == (("lowest of the poses", *own),)
    assert sheet.note.startswith(words)


def test_a_machine_that_topples_at_the_soft_end_has_a_map() -> None:
    """A rocking carriage with a tenth of its stiffness falls over; the reason is said."""
    stated = machine_with(rocking(stiffness=4e6), "spring_stiffness_share = [0.1, 1.0]")
    frequencies = ad.frequency_map(stated, ad.Workspace.grid(stated, points=3))
    sheet = map_sheets(frequencies)[1]
    assert sheet.rows == (("softest", "unstable"),)
    assert "0.1 of it, within the bands) does not hold the machine upright" in sheet.note


@pytest.mark.parametrize(("air", "oil"), [(0.0, "today's oil"), (0.7, "today's oil without air")])
def test_structure_is_told_by_the_oil_that_it_is_measured_by(air: float, oil: str) -> None:
    """As at mid stroke, whatever air: the oil alone, 1/(β A1²/V1 + β A2²/V2)."""
    machine = ad.load("paper_1dof").replace({"fluid.entrained_air_percent": air})
    said = widths(machine, ad.Bands(structure=(0.0, 0.9)))
    assert said == f"structure 0 to 0.9 × as soft as {oil}"
    (lift,), modulus = machine.cylinders, machine.fluid.bulk_modulus
    sides = (lift.bore_area, lift.cap_dead_volume), (lift.annulus_area, lift.annulus_dead_volume)
    volumes = [area * lift.stroke / 2 + dead for area, dead in sides]
    stiffness = sum(modulus * sides[k][0] ** 2 / volumes[k] for k in (0, 1))
    soft = ad.Bands(structure=(1.0, 1.0))
    (yielding,) = soft.at_end(machine, soft.ends[0]).cylinders
    assert yielding.compliance == pytest.approx(1 / stiffness, rel=1e-9)


def test_rigid_machines_on_springs_are_not_called_rigid() -> None:
    machine = machine_with(rocking(), "structure = [0.0, 1.0]")
    sheet = map_sheets(ad.frequency_map(machine, ad.Workspace.grid(machine, points=3)))[1]
    assert sheet.columns[-1] == "stiffest"
    assert machines.rigid("excavator_20t").section.bands.structure is None


@pytest.mark.slow
def test_all_numbers_of_the_headline_are_searched_between_the_poses() -> None:
    """At each end as in the map of a machine of its own, whose worst pose is off the grid."""
    bands = ad.Bands(bulk_modulus=(0.8, 1.2), structure=(0.2, 1.0))
    machine = named("spatial")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=2))
    band = ad.frequency_band(machine, frequencies.workspace, bands)
    numbers = headline(poses_of_ends({"": frequencies}, bands, [band]), machine, bands)
    soft, *_, stiff = (bands.at_end(machine, end) for end in bands.ends)
    ends = (stiff, machine, soft)
    on_grid = band.high.frequency, band.nominal, band.low.frequency
    for number, end, coarse in zip(numbers, ends, on_grid, strict=True):
        worst = ad.frequency_map(end, frequencies.workspace).worst
        assert worst.frequency < 0.9 * coarse
        assert number.value == f"{worst.frequency:.3f}\u00a0Hz"
        assert number.words.endswith(f"limited by {worst.cylinder}")


@pytest.mark.slow
def test_a_gain_compares_worst_frequencies_between_the_poses() -> None:
    machine = named("spatial")
    stiffer = machine.replace({"cylinder.lift.bore_mm": 160})
    workspace, bands = ad.Workspace.grid(machine, points=2), ad.Bands(bulk_modulus=(0.8, 1.2))
    maps = {"today": ad.frequency_map(machine, workspace)}
    maps["new"] = ad.frequency_map(stiffer, workspace)
    known = [ad.frequency_band(one.machine, workspace, bands) for one in maps.values()]
    pairs, gains = poses_of_ends(maps, bands, known), []
    numbers = headline(pairs, machine, bands)
    soft, stiff = bands.ends
    for end, number in zip((stiff, None, soft), numbers, strict=True):
        today, new = (
            ad.frequency_map(
                one.machine if end is None else bands.at_end(one.machine, end), workspace
            ).worst.frequency
            for one in maps.values()
        )
        assert number.value == f"{today:.3f} → {new:.3f}\u00a0Hz"
        gains.append(new / today - 1)
        assert number.words.startswith(f"{100 * gains[-1]:+.1f} %: ")
    least = min(gains)
    assert least_between(pairs, least + 0.01).endswith(f" it is {100 * least:+.1f} %.")
    assert not least_between(pairs, least)
    assert least_between(pairs, least - 0.01)
