"""What a sweep is given: names, numbers, machines, options, and what it makes of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.machine.changes import changed_machine
from armdesign.sweeps.numbers import of_design
from armdesign.sweeps.study_file import read_study

MODULI = {"fluid.bulk_modulus_MPa": [900.0, 1000.0, 1200.0, 1400.0]}


def test_a_misspelt_answer_is_refused_after_the_first_case() -> None:
    told = list[str]()
    with pytest.raises(ad.ArmDesignError, match=r"no case has 'wrost_hz'; did you mean"):
        ad.sweep("paper_1dof", MODULI, points=3, outputs=["wrost_hz"], say=told.append)
    assert told == []


def test_numbers_of_numpy_are_numbers() -> None:
    """They were refused as no JSON; `np.linspace` alone was not."""
    masses = {"payload.load.mass_kg": np.arange(100, 300, 100)}
    plain = ad.sweep("paper_1dof", {"payload.load.mass_kg": [100, 200]}, points=3)
    of_numpy = ad.sweep("paper_1dof", masses, points=3)
    assert [case.key for case in of_numpy.cases] == [case.key for case in plain.cases]
    at = ad.sweep("paper_1dof", [{"cylinder.lift.base.at_mm": np.array([-490, 0, 0])}], points=3)
    assert not at.failures


def test_the_gain_over_a_machine_that_does_not_swing_is_without_end() -> None:
    """As ``Design.gain`` says it; a worst frequency of 0 Hz was a division by zero."""
    from types import SimpleNamespace as Named

    machine = ad.load("paper_1dof")
    maps = [Named(worst=Named(frequency=hz)) for hz in (0.0, 1.0)]
    rest = dict.fromkeys(("least_gain", "unrounded", "lift_share", "bandwidths"))
    design = Named(
        today=machine, machine=machine, before=maps[0], after=maps[1], binding=[], **rest
    )
    design.gain = ad.Design.gain.fget(design)  # type: ignore[attr-defined]
    assert of_design(design)["gain"] == np.inf  # type: ignore[arg-type]


def test_a_masked_number_is_no_answer() -> None:
    """NumPy's ``item`` gives what is beneath the mask, 0.0 for the mean of masked numbers."""

    def mean(*_: object) -> dict[str, object]:
        return {"mean": np.ma.array([1.0, 2.0], mask=True).mean()}

    failed = ad.sweep("paper_1dof", task=mean, points=3).failures  # type: ignore[arg-type]
    assert list(failed.values()) == [
        "answer mean: is MaskedConstant; give a number, a text or a truth value"
    ]


def test_ends_of_a_sobol_sequence_may_be_made_one_by_one() -> None:
    """As the values of a grid; they were used up by the check, and float() was refused."""
    listed = ad.sweep("paper_1dof", {"payload.load.mass_kg": [100, 200]}, points=3, sobol=2)
    made = {"payload.load.mass_kg": (100 * k for k in (1, 2))}
    one_by_one = ad.sweep("paper_1dof", made, points=3, sobol=2)
    assert [case.key for case in one_by_one.cases] == [case.key for case in listed.cases]


def test_a_machine_changed_part_by_part_has_answers_of_its_own(tmp_path: Path) -> None:
    """A journal took it for the unchanged one, whose texts it has."""
    machine = ad.load("paper_1dof")
    softer = replace(machine, fluid=replace(machine.fluid, bulk_modulus=9e8))
    journal = tmp_path / "j.sqlite"
    hard, soft = (
        ad.sweep(one, points=3, journal=journal).frame["worst_hz"][0] for one in (machine, softer)
    )
    assert soft < 0.9 * hard


def test_a_text_of_another_notation_has_no_number_in_front(tmp_path: Path) -> None:
    """Not 6 mm of "6_0", nor 0 of "0x3c"."""
    rows = tmp_path / "rows.csv"
    rows.write_text("cylinder.lift.bore_mm\n6_0\n0x3c\n")
    errors = ad.sweep("paper_1dof", rows, points=3).failures.values()
    assert len(errors) == 2
    for error in errors:
        assert "number alone" not in error


def test_a_number_beside_its_own_list_is_refused() -> None:
    """The later one won, and both orders had one key."""
    both = {"cylinder.lift.base.at_mm.0": -500, "cylinder.lift.base.at_mm": [-490, 0, 0]}
    for changes in (both, dict(reversed(both.items()))):
        (error,) = ad.sweep("paper_1dof", [changes], points=3).failures.values()
        assert "at_mm.0: is one of the numbers of cylinder.lift.base.at_mm" in error


def test_a_catalogue_of_a_study_is_a_file_beside_it(tmp_path: Path) -> None:
    (tmp_path / "sizes.csv").write_text("bore_mm,rod_mm\n63,36\n")
    study = tmp_path / "study.toml"
    study.write_text(
        'machine = "paper_1dof"\ntask = "design"\npoints = 3\n'
        '[options]\ncatalogue = "sizes.csv"\nvary = "areas"\n'
    )
    read = read_study(study, ad.load)
    assert read["options"]["catalogue"] == [[pytest.approx(0.063), pytest.approx(0.036)]]
    study.write_text(study.read_text().replace('"sizes.csv"', "[[63, 36]]"))
    with pytest.raises(ad.ArmDesignError, match=r'is a list; name a CSV file .* "sizes\.csv"'):
        read_study(study, ad.load)
    answers = ad.sweep(**read)
    assert not answers.failures


def test_the_value_that_the_file_has_changes_nothing() -> None:
    """63 was written as 63.0, and a journal of the file was another one's."""
    machine = ad.load("paper_1dof")
    bore = machine.section.cylinder["lift"].bore_mm
    for value in (bore, int(bore)):
        assert changed_machine(machine, {"cylinder.lift.bore_mm": value}).text == machine.text
    assert changed_machine(machine, {"cylinder.lift.bore_mm": bore + 1}).text != machine.text
