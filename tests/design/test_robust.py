"""Designs for bands of what is not known exactly: for the worst within them, and for the least
gain over today's machine; the bands' own search, which evaluates whole machines, is the judge.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import Requirements, Workspace
from armdesign.design.catalogue.sizes import sized
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import check
from armdesign.frequency.cases import scaled_links
from armdesign.frequency.modes import hertz
from armdesign.report.designs import design_sheets, summary
from armdesign.report.trade_offs import pareto_sheet
from tests import machines
from tests.checks import worst_within
from tests.design.designs import MACHINES, as_machine, problem_of, some_x, workspace_of
from tests.machines import machine_with, named
from tests.sprung import rocking

BANDS = ad.Bands(
    bulk_modulus=(0.7, 1.1), dead_volume=(1.0, 1.2), payload=(0.8, 1.25), link_mass=(0.95, 1.05)
)
YIELDING = ad.Bands(structure=(0.0, 1.0))
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


@pytest.mark.parametrize("bands", [BANDS, AIRY, YIELDING], ids=["masses", "air", "structure"])
@pytest.mark.parametrize(
    "name", ["single", "double", "odd", pytest.param("excavator", marks=pytest.mark.slow)]
)
def test_the_problem_counts_the_least_gain_within_the_bands(name: str, bands: ad.Bands) -> None:
    """Its lowest ω² belongs to the least f_new/f_today over all corners, times today's worst
    frequency with the file's values.
    """
    problem = problem_of(name, bands=bands, gain=True)
    machine, workspace = problem.machine, problem.workspace
    today = ad.frequency_band(machine, workspace, bands)
    for x in (problem.vector.start, some_x(problem, 3)):
        new = ad.frequency_band(as_machine(problem, x), workspace, bands, today=machine)
        gains = [
            one.frequency / other.frequency
            for one, other in zip(new.scenarios, today.scenarios, strict=True)
        ]
        reached = hertz(problem.dynamics.omega_squared(x).min()) / today.nominal
        assert_allclose(reached, min(gains), rtol=1e-9)
        judged = problem.dynamics.corners.judged(as_machine(problem, x))
        assert_allclose(judged, reached * today.nominal, rtol=1e-9)


def test_springs_are_within_the_gain() -> None:
    """A rocking excavator whose spring is soft or stiff, against whole machines."""
    machine, bands = rocking(), ad.Bands(structure=(0.0, 1.0), spring_stiffness=(0.5, 2.0))
    workspace = Workspace.grid(machine, points=(4, 4, 5))
    problem = Problem.of(
        machine=machine, workspace=workspace, requirements=Requirements.of(machine),
        vary=("areas", "pins"), bands=bands, gain=True,
    )  # fmt: skip
    x = some_x(problem, 3)
    today = ad.frequency_band(machine, workspace, bands)
    new = ad.frequency_band(as_machine(problem, x), workspace, bands, today=machine).scenarios
    gains = [n.frequency / o.frequency for n, o in zip(new, today.scenarios, strict=True)]
    reached = hertz(problem.dynamics.omega_squared(x).min())
    assert_allclose(reached / today.nominal, min(gains), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double", "odd"])
def test_slopes_within_bands_are_differences(name: str) -> None:
    """vᵀ(∂K − ω² ∂M)v of the lowest mode against central differences, at rows of every corner."""
    problem = problem_of(name, bands=YIELDING, gain=True)
    x, step = some_x(problem, 4), 1e-5
    rows = np.arange(0, len(problem.dynamics.rows), 7)
    assert set(problem.dynamics.rows.corner[rows]) == {0, 1}
    for row in rows:
        one = np.array([row])
        squared = float(problem.dynamics.omega_squared(x, one)[0])
        base, slopes = problem.dynamics.scaled_stiffness_and_gradient(x, one, squared)
        vector = np.linalg.eigh(base[0])[1][:, 0]
        for v in np.flatnonzero(np.ptp(problem.bounds, axis=0) > 0):
            ends = [x + sign * step * (np.arange(len(x)) == v) for sign in (1, -1)]
            up, down = (problem.dynamics.omega_squared(end, one)[0] for end in ends)
            slope = vector @ slopes[v, 0] @ vector
            # differences lose 1e-16/1e-5 of ω² to rounding
            assert_allclose(slope, (up - down) / (2 * step), rtol=2e-5, atol=1e-8 * squared)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double", "excavator"])
def test_no_end_of_the_band_pays_for_another(name: str) -> None:
    """The least gain is not below the gains by the soft end alone and by the file's values; both
    ends gain, and no proof says less than is reached.
    """
    machine, workspace = MACHINES[name](), workspace_of(name)
    today = ad.frequency_band(machine, workspace, YIELDING)
    gain, worst, nominal = (
        ad.optimize(machine, workspace, bands=bands, objective=objective)
        for bands, objective in ((YIELDING, "gain"), (YIELDING, "worst"), (ad.Bands(), "gain"))
    )
    search = 1e-4  # where the searches stop
    for other in (worst, nominal):
        reached = gain.problem.dynamics.omega_squared(other.x).min()
        assert gain.unrounded >= (1 - search) * hertz(float(reached))
    rounding = 3e-3  # what 0.1 mm cost at most on these small machines
    new = ad.frequency_band(gain.machine, workspace, YIELDING, today=machine)
    assert gain.unrounded / today.nominal - 1 == pytest.approx(new.least_gain(today), abs=rounding)
    assert new.least_gain(today) > 0.01
    assert gain.bound is not None
    assert gain.bound >= gain.unrounded


@pytest.mark.slow
def test_the_bound_on_the_gain_holds_for_random_designs() -> None:
    """No allowed design between today's and the optimum gains more at its poorest corner."""
    machine, workspace = MACHINES["double"](), workspace_of("double")
    design = ad.optimize(machine, workspace, bands=YIELDING)
    problem, random = design.problem, np.random.default_rng(5)
    allowed, bound = 0, design.bound
    assert bound is not None
    for _ in range(300):
        between = problem.vector.start + random.uniform() * (design.x - problem.vector.start)
        x = np.clip(between + random.normal(0, 0.005, len(between)), *problem.bounds)
        if constraints_at(problem, x).values.min() >= 0:
            allowed += 1
            assert hertz(float(problem.dynamics.omega_squared(x).min())) <= bound
    assert allowed > 10


def test_bands_of_the_file_count_unless_told(excavator: ad.Machine) -> None:
    """By every door; ``Bands()`` are the file's values alone."""
    stated = machine_with(MACHINES["double"](), "structure = [0.0, 1.0]")
    workspace = Workspace.grid(stated, points=(5, 5))
    of_file = ad.size_cylinders(stated, workspace)
    assert of_file.made_for == "gain"
    assert of_file.bands == YIELDING
    assert ad.size_cylinders(stated, workspace, bands=ad.Bands()).made_for == "nominal"
    worst = ad.size_cylinders(stated, workspace, objective="worst")
    assert worst.made_for == "worst"
    assert "Command: armdesign.size_cylinders(dead_volume='fixed', objective='worst')" in (
        worst.machine.text
    )
    with pytest.raises(ad.ArmDesignError, match="'best' is not allowed; choose from: gain, worst"):
        ad.optimize(stated, workspace, objective="best")


def test_no_gain_over_what_is_unstable() -> None:
    """A load ten times as heavy on soft oil and structure falls: the band says so itself."""
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    machine = machine.replace({"fluid.bulk_modulus_MPa": 800})
    bands = ad.Bands(structure=(0.0, 10.0), payload=(1.0, 10.0), bulk_modulus=(0.1, 1.0))
    assert ad.frequency_band(machine, workspace, bands).low.frequency == 0
    words = r"bands of excavator_20t: today's machine is unstable at one of their corners"
    with pytest.raises(ad.ArmDesignError, match=words):
        ad.optimize(machine, workspace, bands=bands)


@pytest.mark.slow
def test_a_gain_that_vanishes_is_said_first() -> None:
    """A thicker cylinder with a shorter arm gains from its oil alone, and loses where the
    structure gives most; a much thinner one has no gain that could vanish.
    """
    stated = machine_with(MACHINES["double"](), "structure = [0.0, 10.0]")
    design = ad.size_cylinders(stated, Workspace.grid(stated, points=(5, 5)), bands=ad.Bands())
    thicker = {"bore_mm": 104.0, "rod_end.at_mm": [1060.0, 0.0, 400.0]}
    longer = {"stroke_mm": 1023.4, "closed_length_mm": 384.5}
    changes = {f"cylinder.lift.{key}": value for key, value in (thicker | longer).items()}
    poorer = replace(design, machine=design.machine.replace(changes))
    least = poorer.band_after.least_gain(poorer.band_before)
    assert least < 0 < poorer.gain
    sheets = design_sheets(poorer)
    words = f"the gain vanishes within the bands: {100 * least:+.1f} % there; "
    assert sheets[0].note.startswith(words)
    assert sheets[1].columns == ("", "softest", "at file values", "rigid")
    assert f"the gain vanishes there: {100 * least:+.1f} %" in summary(poorer)
    assert "vanishes" not in design_sheets(design)[0].note
    lost = replace(design, machine=design.machine.replace({"cylinder.lift.bore_mm": 70.0}))
    assert lost.gain < 0
    assert "vanishes" not in design_sheets(lost)[0].note + summary(lost)
    assert f"Hz, in the worst case {100 * lost.least_gain:+.1f} %." in summary(lost)


def test_a_saved_design_keeps_the_steel(tmp_path: Path) -> None:
    """Bands of its file are shares of its own oil: at both ends today's compliance in m/N."""
    stated = machine_with(MACHINES["double"](), "structure = [0.2, 1.0]")
    design = ad.size_cylinders(stated, Workspace.grid(stated, points=(5, 5)))
    saved = ad.load(design.machine.save(tmp_path / "new.toml"))
    assert [c.bore for c in saved.cylinders] != [c.bore for c in stated.cylinders]
    both = [(one, ad.Bands.of(one)) for one in (saved, stated)]
    for end in (0, 1):
        own, today = (bands.at_end(one, bands.ends[end]).cylinders for one, bands in both)
        for new, old in zip(own, today, strict=True):
            assert new.compliance == pytest.approx(old.compliance, rel=1e-5)  # six digits
    assert own[0].compliance > 0


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
    assert one.machine.section == other.machine.section
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
    nominal, robust = (
        ad.optimize(machine, workspace, vary=vary, bands=b, objective="worst")
        for b in (None, bands)
    )
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
@pytest.mark.parametrize("objective", ["gain", "worst"])
@pytest.mark.parametrize("name", ["double", "odd", "excavator"])
def test_sizes_for_bands_are_those_of_optimize(name: str, objective: str) -> None:
    """Two doors, one answer, and a bound that holds within the bands."""
    machine, workspace = MACHINES[name](), workspace_of(name)
    one = ad.size_cylinders(machine, workspace, bands=BANDS, objective=objective)
    other = ad.optimize(machine, workspace, vary=("areas",), bands=BANDS, objective=objective)
    assert one.unrounded == pytest.approx(other.unrounded, rel=1e-4)
    assert one.bands == BANDS
    assert one.bound is None or one.bound >= one.unrounded


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["gain", "worst"])
@pytest.mark.parametrize("bands", [BANDS, AIRY, YIELDING], ids=["masses", "air", "structure"])
@pytest.mark.parametrize("name", ["single", "double", "crossing", "excavator"])
def test_sizes_of_a_catalogue_for_bands(name: str, bands: ad.Bands, objective: str) -> None:
    """Every combination built as a machine and judged by its worst frequency or least gain within
    the bands; the answer is the best.
    """
    machine = MACHINES[name]() if name in MACHINES else named(name)
    space = workspace_of(name) if name in MACHINES else Workspace.grid(machine, points=3)
    bores, rods = ((0.93, 1.04), (1.0, 1.1)) if len(machine.cylinders) < 3 else ((1.03,), (1.05,))
    shares = [(1.0, 1.0), *itertools.product(bores, rods)]
    sizes = [(share * c.bore, other * c.rod) for c in machine.cylinders for share, other in shares]
    requirements = replace(
        Requirements.of(machine), oil_total_share=1.1, holding_share=3.0, moment_arm_share=0.0
    )
    today = ad.frequency_band(machine, space, bands)

    def reached(changed: ad.Machine) -> float:
        if objective == "worst":
            return worst_within(changed, space, bands, machine).frequency
        new = ad.frequency_band(changed, space, bands, today=machine).scenarios
        gains = [n.frequency / o.frequency for n, o in zip(new, today.scenarios, strict=True)]
        return today.nominal * min(gains)

    wanted = -math.inf
    for choice in itertools.product(sizes, repeat=len(machine.cylinders)):
        cylinders = tuple(
            sized(c, *size) for c, size in zip(machine.cylinders, choice, strict=True)
        )
        changed = replace(machine, cylinders=cylinders)
        if min(c.slack for c in check(changed, machine, space, requirements)) >= -1e-9:
            wanted = max(wanted, reached(changed))
    design = ad.size_cylinders(
        machine, space, requirements, bands=bands, objective=objective, catalogue=sizes
    )
    assert wanted > 0
    assert design.unrounded == pytest.approx(wanted, rel=1e-9)
    assert design.best_sizes is not None
    assert design.best_sizes.bound == design.best_sizes.frequency
    assert design.bound == pytest.approx(wanted, rel=1e-9)
    # its file has 1e-6 mm
    assert reached(design.machine) == pytest.approx(wanted, rel=1e-7)


@pytest.mark.slow
def test_pins_for_sizes_of_a_catalogue_and_bands() -> None:
    """Better in the worst of the bands than sizes alone, and than the sizes and pins that bands
    were not asked for.
    """
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    given: Any = {"bands": BANDS, "objective": "worst", "catalogue": "5mm"}
    robust = ad.optimize(machine, workspace, starts=1, **given)
    sizes = ad.size_cylinders(machine, workspace, **given)
    assert robust.unrounded > 1.1 * sizes.unrounded
    assert min(robust.slacks.values()) >= -1e-9
    chosen = np.array([(c.bore, c.rod) for c in robust.machine.cylinders]) / 5e-3
    assert_allclose(chosen, np.rint(chosen), rtol=0, atol=1e-9)
    # pins on whole millimetres, strokes on 5 mm: some 0.4 %
    assert 0.995 < robust.band_after.low.frequency / robust.unrounded < 1 + 1e-6
    judged = robust.problem.dynamics.corners.judged(robust.machine)
    assert robust.band_after.low.frequency == pytest.approx(judged, rel=1e-6)


@pytest.mark.slow
def test_trade_off_for_bands() -> None:
    """Every point is the optimum of its own limit for the bands, and says its worst frequency and
    its least gain within them.
    """
    machine, workspace = MACHINES["double"](), workspace_of("double")
    front = ad.pareto(
        machine, workspace, against="oil", values=(0.9, 1.0), vary=("areas",), bands=BANDS
    )
    assert front.robust
    for design, (_, row) in zip(front.designs, front.frame.iterrows(), strict=True):
        alone = ad.size_cylinders(machine, workspace, design.requirements, bands=BANDS)
        assert design.unrounded == pytest.approx(alone.unrounded, rel=1e-4)
        assert row["banded_hz"] == worst_within(design.machine, workspace, BANDS).frequency
        assert row["banded_hz"] < row["frequency_hz"]
        before = ad.frequency_band(machine, workspace, BANDS)
        after = ad.frequency_band(design.machine, workspace, BANDS, today=machine)
        assert row["least_gain"] == after.least_gain(before)
    sheet = pareto_sheet(front)
    assert sheet.columns[3:5] == ("in the bands", "least gain")
    assert {len(row) for row in sheet.rows} == {len(sheet.columns)}
    assert (
        "lowest of the poses in the bands" in [line.get_label() for line in front.plot().lines][2]
    )


@pytest.mark.slow
def test_no_sample_within_the_bands_is_worse() -> None:
    """Monte Carlo through the file: other oil, volumes and loads by key path, links by their own
    masses.
    """
    machine, workspace = MACHINES["excavator"](), workspace_of("excavator")
    new = ad.optimize(machine, workspace, starts=1, bands=BANDS, objective="worst")
    low, random = new.band_after.low.frequency, np.random.default_rng(7)
    sampled = []
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
        sampled.append(lowest)
    assert min(sampled) >= low * (1 - 1e-9)
    assert min(sampled) < 1.1 * low, "samples come near the worst, or this says nothing"


@pytest.mark.slow
def test_the_report_shows_the_bands_of_the_file() -> None:
    """Whatever the design was made for; without bands rigid and soft structure are assumed."""
    stated = machine_with(machines.rigid("excavator_20t"), "bulk_modulus_share = [0.7, 1.1]")
    workspace = workspace_of("excavator")
    given: dict[str, Any] = {"nominal": {"bands": ad.Bands()}, "worst": {"objective": "worst"}}
    for made_for, words in (
        ("nominal", "for the file's values alone"),
        ("worst", "for the lowest"),
        ("gain", "for the least gain"),
    ):
        design = ad.size_cylinders(stated, workspace, **given.get(made_for, {}))
        first, sheet = design_sheets(design)[:2]
        assert sheet.title.startswith("Lowest frequency of the poses within the bands")
        assert sheet.rows[0][1:] == tuple(
            f"{f:.3f} Hz"
            for f in (
                design.band_before.low.frequency,
                design.band_before.nominal,
                design.band_before.high.frequency,
            )
        )
        assert "oil 0.7 to 1.1 ×" in sheet.note
        least = f"least gain within the bands {100 * design.least_gain:+.1f} %"
        assert sheet.note.endswith(f"; the new machine was designed {words}; {least}")
        worst = ": of the poses, in the worst case of the bands; before rounding"
        assert (worst in first.note) == (made_for == "worst")
        gain = 100 * (design.unrounded / design.band_before.nominal - 1)
        assert (f"before rounding {gain:+.1f} %" in first.note) == (made_for == "gain")
    plain = machine_with(stated, "")
    assumed = ad.size_cylinders(plain, workspace)
    assert assumed.made_for == "nominal"
    sheet = design_sheets(assumed)[1]
    assert sheet.columns == ("", "softest", "at file values", "rigid")
    soft = ad.frequency_band(plain, workspace, ad.Bands(structure=(1.0, 1.0))).low.frequency
    assert sheet.rows[0] == ("today", f"{soft:.3f} Hz", *2 * (sheet.rows[0][3],))
    words = "structure 0 to 1 × as soft as today's oil, assumed: the file states none; "
    assert sheet.note.startswith(words)
    assert "Within the bands of what is not known exactly, assumed, " in summary(assumed)
