"""Designs for the worst within bands of what is not known exactly; the bands' own search is the
independent judge.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import Requirements, Workspace
from armdesign.design.catalogue.sizes import sized
from armdesign.design.program.constraints import constraints_at
from armdesign.design.requirements.check import check
from armdesign.frequency.bands import worst_within
from armdesign.frequency.cases import scaled_links
from armdesign.frequency.modes import hertz
from armdesign.report.designs import design_sheets, pareto_sheet
from tests.design.designs import MACHINES, as_machine, problem_of, some_x, workspace_of
from tests.machines import named

BANDS = ad.Bands(
    bulk_modulus=(0.7, 1.1), dead_volume=(1.0, 1.2), payload=(0.8, 1.25), link_mass=(0.95, 1.05)
)
AIRY = ad.Bands(bulk_modulus=(0.8, 1.0), air=(0.0, 0.02), payload=(0.8, 1.25))


@pytest.mark.parametrize("bands", [BANDS, AIRY], ids=["masses", "air"])
@pytest.mark.parametrize("name", ["single", "double", "odd", "excavator"])
def test_the_problem_counts_the_worst_within_the_bands(name: str, bands: ad.Bands) -> None:
    """Its lowest ω² against ``bands.py``, which evaluates whole machines, at today's and at
    another design.
    """
    problem = problem_of(name, bands=bands)
    for x in (problem.vector.start, some_x(problem, 3)):
        judged = worst_within(as_machine(problem, x), problem.workspace, bands).frequency
        assert_allclose(hertz(problem.dynamics.omega_squared(x).min()), judged, rtol=1e-9)


@pytest.mark.parametrize("name", ["odd", "excavator"])
def test_requirements_are_judged_at_the_values_of_the_file(name: str) -> None:
    nominal = problem_of(name)
    robust = problem_of(name, bands=BANDS)
    x = some_x(nominal, 5)
    one, other = constraints_at(nominal, x), constraints_at(robust, x)
    assert one.names == other.names
    assert_allclose(one.values, other.values, rtol=0, atol=1e-12)
    assert_allclose(one.jacobian, other.jacobian, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_exact_bands_change_nothing() -> None:
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    one, other = (
        ad.optimize(machine, workspace, starts=1, bands=bands) for bands in (None, ad.Bands())
    )
    assert one.machine.text == other.machine.text
    assert one.unrounded == other.unrounded


@pytest.mark.slow
@pytest.mark.parametrize("bands", [BANDS, AIRY], ids=["masses", "air"])
@pytest.mark.parametrize(
    ("name", "vary"),
    [("double", ("areas",)), ("double", ("pins",)), ("excavator", ("areas", "pins"))],
)
def test_the_worst_case_is_not_below_that_of_the_nominal_optimum(
    name: str, vary: tuple[str, ...], bands: ad.Bands
) -> None:
    """And the other way round: where all is as the file says, the nominal optimum is not below the
    robust one.
    """
    machine, workspace = MACHINES[name](), workspace_of(name)
    nominal, robust = (ad.optimize(machine, workspace, vary=vary, bands=b) for b in (None, bands))
    search = 1e-4  # where the searches stop
    assert robust.unrounded >= (1 - search) * hertz(
        robust.problem.dynamics.omega_squared(nominal.x).min()
    )
    assert nominal.unrounded >= (1 - search) * hertz(
        nominal.problem.dynamics.omega_squared(robust.x).min()
    )
    assert robust.bound is None or robust.bound >= robust.unrounded
    assert min(robust.slacks.values()) >= -1e-9
    rounding = 3e-3  # what 0.1 mm cost at most on these small machines
    assert robust.band_after.low.frequency == pytest.approx(robust.unrounded, rel=rounding)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double", "odd", "excavator"])
def test_sizes_for_bands_are_those_of_optimize(name: str) -> None:
    """Two doors, one answer, and a bound that holds for the worst within the bands."""
    machine, workspace = MACHINES[name](), workspace_of(name)
    one = ad.size_cylinders(machine, workspace, bands=BANDS)
    other = ad.optimize(machine, workspace, vary=("areas",), bands=BANDS)
    assert one.unrounded == pytest.approx(other.unrounded, rel=1e-4)
    assert one.bands == BANDS
    assert one.unrounded < ad.size_cylinders(machine, workspace).unrounded
    assert one.bound is None or one.bound >= one.unrounded


@pytest.mark.slow
@pytest.mark.parametrize("bands", [BANDS, AIRY], ids=["masses", "air"])
@pytest.mark.parametrize("name", ["single", "double", "crossing", "excavator"])
def test_sizes_of_a_catalogue_for_bands(name: str, bands: ad.Bands) -> None:
    """Every combination built as a machine and judged by its worst within the bands; the answer is
    the best.
    """
    machine = MACHINES[name]() if name in MACHINES else named(name)
    space = workspace_of(name) if name in MACHINES else Workspace.grid(machine, points=3)
    bores, rods = ((0.93, 1.04), (1.0, 1.1)) if len(machine.cylinders) < 3 else ((1.03,), (1.05,))
    sizes = [
        (share * c.bore, other * c.rod)
        for c in machine.cylinders
        for share in bores
        for other in rods
    ]
    sizes += [(c.bore, c.rod) for c in machine.cylinders]
    requirements = replace(
        Requirements.of(machine), oil_total_share=1.1, holding_share=3.0, moment_arm_share=0.0
    )
    wanted = -math.inf
    for choice in itertools.product(sizes, repeat=len(machine.cylinders)):
        cylinders = tuple(
            sized(c, *size) for c, size in zip(machine.cylinders, choice, strict=True)
        )
        made = replace(machine, cylinders=cylinders)
        if min(c.slack for c in check(made, machine, space, requirements)) >= -1e-9:
            wanted = max(wanted, worst_within(made, space, bands).frequency)
    design = ad.size_cylinders(machine, space, requirements, bands=bands, catalogue=sizes)
    assert wanted > 0
    assert design.unrounded == pytest.approx(wanted, rel=1e-9)
    assert design.selection is not None
    assert design.selection.bound == design.selection.frequency
    assert design.bound == pytest.approx(wanted, rel=1e-9)
    # its file has 1e-6 mm
    assert design.band_after.low.frequency == pytest.approx(wanted, rel=1e-7)


@pytest.mark.slow
def test_pins_for_sizes_of_a_catalogue_and_bands() -> None:
    """Better in the worst of the bands than sizes alone, and than the sizes and pins that bands
    were not asked for.
    """
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    robust = ad.optimize(machine, workspace, starts=1, bands=BANDS, catalogue="5mm")
    sizes = ad.size_cylinders(machine, workspace, bands=BANDS, catalogue="5mm")
    assert robust.unrounded > 1.1 * sizes.unrounded
    assert min(robust.slacks.values()) >= -1e-9
    chosen = np.array([(c.bore, c.rod) for c in robust.machine.cylinders]) / 5e-3
    assert_allclose(chosen, np.rint(chosen), rtol=0, atol=1e-9)
    # pins on the 0.1 mm grid
    assert robust.band_after.low.frequency == pytest.approx(robust.unrounded, rel=3e-3)


def test_trade_off_for_bands() -> None:
    """Every point is the robust optimum of its own limit, and says its worst within the bands."""
    machine, workspace = MACHINES["double"](), workspace_of("double")
    found = ad.pareto(
        machine, workspace, against="oil", values=(0.9, 1.0), vary=("areas",), bands=BANDS
    )
    assert found.robust
    for design, (_, row) in zip(found.designs, found.frame.iterrows(), strict=True):
        alone = ad.size_cylinders(machine, workspace, design.requirements, bands=BANDS)
        assert design.unrounded == pytest.approx(alone.unrounded, rel=1e-4)
        assert row["banded_hz"] == worst_within(design.machine, workspace, BANDS).frequency
        assert row["banded_hz"] < row["frequency_hz"]
    sheet = pareto_sheet(found)
    assert sheet.columns[3] == "in the bands"
    assert {len(row) for row in sheet.rows} == {len(sheet.columns)}
    assert "worst within the bands" in [line.get_label() for line in found.plot().lines][2]


@pytest.mark.slow
def test_no_sample_within_the_bands_is_worse() -> None:
    """Monte Carlo through the file: other oil, volumes and loads by key path, links by their own
    masses.
    """
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    new = ad.optimize(machine, workspace, starts=1, bands=BANDS)
    low, random = new.band_after.low.frequency, np.random.default_rng(7)
    found = []
    for _ in range(40):
        modulus, volume, load, link = (
            random.uniform(*band)
            for band in (BANDS.bulk_modulus, BANDS.dead_volume, BANDS.payload, BANDS.link_mass)
        )
        section = new.machine.section
        changes: dict[str, object] = {
            "fluid.bulk_modulus_MPa": modulus * section.fluid.bulk_modulus_MPa
        }
        changes |= {
            f"payload.{name}.mass_kg": load * payload.mass_kg
            for name, payload in section.payload.items()
        }
        for name, cylinder in section.cylinder.items():
            for side in ("cap", "annulus"):
                litres = volume * getattr(cylinder.dead_volume_l, side)
                changes[f"cylinder.{name}.dead_volume_l.{side}"] = litres
        sample, lowest = new.machine.replace(changes), math.inf
        for payload in sample.payloads:
            case = sample.with_payload(payload.name)
            rigid = scaled_links(workspace.rigid[case.holds(workspace.rigid)], link)
            lowest = min(lowest, ad.natural_modes(case.evaluate(rigid)).frequencies[:, 0].min())
        found.append(lowest)
    assert min(found) >= low * (1 - 1e-9)
    assert min(found) < 1.1 * low, "samples come near the worst, or this says nothing"


@pytest.mark.slow
def test_the_report_shows_the_bands_of_the_file() -> None:
    """In the file or given; without either there is no such sheet."""
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    text = machine.text + "\n[bands]\nbulk_modulus_share = [0.7, 1.1]\n"
    stated = ad.Machine.from_text(text, machine.urdf_text, machine.source)
    found = ad.size_cylinders(stated, workspace)
    sheet = design_sheets(found)[1]
    assert sheet.title.startswith("Worst frequency within the bands")
    assert sheet.rows[0][1:] == tuple(
        f"{f:.3f} Hz"
        for f in (
            found.band_before.low.frequency,
            found.band_before.nominal,
            found.band_before.high.frequency,
        )
    )
    assert "oil 0.7 to 1.1 ×" in sheet.note
    robust = design_sheets(
        ad.optimize(stated, workspace, vary=("areas",), bands=ad.Bands.of(stated))
    )
    assert ": in the worst case of the bands; before rounding" in robust[0].note
    assert robust[1].note.endswith("; the new machine was designed for the lowest")
    assert "bands" not in design_sheets(ad.size_cylinders(machine, workspace))[1].title
