"""What a sweep is given: names, numbers, machines, options, and what it makes of them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.machine.changes import changed_machine
from armdesign.machine.file.schema import RequirementsSection
from armdesign.sweeps.numbers import of_design
from armdesign.sweeps.study_file import read_study
from armdesign.threads import threads

BOX = [[-9000, -9000], [9000, -9000], [9000, 9000], [-9000, 9000]]
FAR = [[8000, 8000], [9000, 8000], [9000, 9000]]
TABLES: dict[str, Any] = {  # requirements that are tables, and two that few files have
    "lift_share": {"lift": 0.8},
    "digging": {"cylinders": ["lift"], "share": 0.9},
    "digging_kN": {"lift": 20.0},
    "buckling_factor": 2.5,
    "pin_boxes_mm": {"lift": {"base": 50.0}},
    "catalogue": "5mm",
    "speed": {"up": {"joint_deg_per_s": {"JOINT": 10.0}, "at": "every"}},
    "lift": {"pipe": {"mass_kg": 50.0, "joint_deg": {"JOINT": 20.0}}},
    "outline": {"LINK": {"points_mm": BOX, "pin_radius_mm": 60.0}},
    "clearance": {"rail": {"cylinders": ["lift"], "link": "LINK", "points_mm": FAR}},
}
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


def named(value: Any, names: dict[str, str]) -> Any:
    """A requirement with the names of a machine's own parts."""
    if isinstance(value, dict):
        return {names.get(key, key): named(item, names) for key, item in value.items()}
    return names.get(value, value) if isinstance(value, str) else value


def contained(part: Any, whole: Any) -> bool:
    """Whether a table has all that another says, beside defaults."""
    if isinstance(part, dict):
        return all(contained(item, whole[key]) for key, item in part.items())
    return bool(part == whole)


@pytest.mark.parametrize(
    ("machine", "names"),
    [
        ("paper_1dof", {"JOINT": "boom", "LINK": "boom"}),
        ("loader_crane", {"JOINT": "lift_boom", "LINK": "lift_boom"}),
    ],
)
def test_every_requirement_can_be_set_whether_the_file_has_it_or_not(
    machine: str, names: dict[str, str]
) -> None:
    """As a whole, in place of what the file has; only numbers that it has could be."""
    model = ad.load(machine)
    fields = RequirementsSection.model_fields
    for key, field in fields.items():
        before = getattr(model.section.requirements, key)
        plain = "stepped" if key == "buckling_column" else field.default or 100.0
        value = named(TABLES.get(key, plain), names)
        changed = changed_machine(model, {f"requirements.{key}": value}, "sweep")
        after = changed.section.requirements.model_dump()
        assert contained(value, after[key]), key
        if isinstance(value, dict) and isinstance(before, dict):
            assert set(after[key]) <= {"default", *value}
        kept = model.section.requirements.model_dump()
        assert all(after[other] == kept[other] for other in fields if other != key)


def test_requirements_of_a_sweep_are_values_and_tables() -> None:
    """They were "no number that can vary", and a table could not be set at all."""
    crane: list[dict[str, Any]] = [
        {"torque_share": 0.9},
        {"torque_share": {"extension": 0.9}},
        {"catalogue": "5mm"},
        {"torque_share": {"nobody": 0.9}},
        {"speed": {"up": {"at": "never"}}},
        {"torque_share.extension": 0.8, "torque_share": 0.9},
        {"torque_share": 0.9, "torque_share.extension": 0.94},  # which the file says, too
    ]
    twice = [{"torque_share": {"extension": 0.9}, "torque_share.extension": 0.8}]
    with pytest.raises(ad.ArmDesignError, match=r"torque_share\.extension: is there twice"):
        ad.sweep("loader_crane", None, "map", requirements=twice, points=2)

    def asked(machine: ad.Machine, _: ad.Workspace) -> dict[str, Any]:
        rules = machine.section.requirements
        return {"share": str(rules.torque_share), "sizes": rules.catalogue}

    frame = ad.sweep("loader_crane", None, asked, requirements=crane, points=2).frame
    assert frame["share"].tolist()[:2] == ["0.9", "{'default': 0.95, 'extension': 0.9}"]
    assert frame["sizes"].tolist()[:3] == ["iso", "iso", "5mm"]
    assert frame["share"][5] == "{'default': 0.9, 'extension': 0.8}"
    assert frame["share"][6] == "{'default': 0.9, 'extension': 0.94}"
    nobody, never = frame["error"].tolist()[3:5]
    assert 'requirements.torque_share.nobody: no actuator "nobody"' in nobody
    assert 'requirements.speed.up.at: "never" is not allowed; give one of "mean", "every"' in never


def test_tables_of_requirements_add_to_those_of_the_file(tmp_path: Path) -> None:
    """In a list from Python they replaced them, so that speeds asked for were asked no more."""
    model = ad.load("paper_1dof").replace({"requirements.oil_each_share": 1.05})
    model = model.replace({"requirements.speed": {"up": {"joint_deg_per_s": {"boom": 10.0}}}})
    model.save(tmp_path / "paper_1dof" / "paper_1dof.toml")
    study = tmp_path / "study.toml"
    study.write_text(
        'machine = "paper_1dof"\npoints = 2\n[[requirements]]\noil_each_share = { lift = 1.2 }\n'
        "speed = { down = { joint_deg_per_s = { boom = 5 } } }\n"
    )
    rules = {"oil_each_share": {"lift": 1.2}, "speed": {"down": {"joint_deg_per_s": {"boom": 5}}}}

    def asked(machine: ad.Machine, _: ad.Workspace) -> dict[str, Any]:
        section = machine.section.requirements
        return {"speeds": " ".join(section.speed), "shares": str(section.oil_each_share)}

    by_list = ad.sweep(model, None, asked, requirements=[rules], points=2)
    by_file = ad.sweep(**{**read_study(study, ad.load), "task": asked})
    assert by_file.frame["speeds"].tolist() == by_list.frame["speeds"].tolist() == ["up down"]
    assert by_list.frame["shares"].tolist() == ["{'default': 1.05, 'lift': 1.2}"]
    assert by_file.frame["shares"].tolist() == by_list.frame["shares"].tolist()
    assert list(by_file.frame)[:4] == list(by_list.frame)[:4]


def test_a_machine_beside_a_study_is_its_machine_from_every_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder beside it was overlooked, unless the command was typed there."""
    other = ad.load("paper_1dof").replace({"payload.load.mass_kg": 123.0})
    other.save(tmp_path / "paper_1dof" / "paper_1dof.toml")
    for folder, mass in ((tmp_path, 123.0), (tmp_path / "alone", 200.0)):
        folder.mkdir(exist_ok=True)
        (folder / "study.toml").write_text('machine = "paper_1dof"\n')
        for here in (tmp_path, tmp_path / "alone", tmp_path.parent):
            here.mkdir(exist_ok=True)
            monkeypatch.chdir(here)
            (machine,) = read_study(folder / "study.toml", ad.load)["machine"]
            assert machine.payload.mass == mass


def test_tables_of_requirements_in_a_study_are_key_paths(tmp_path: Path) -> None:
    study = tmp_path / "study.toml"
    study.write_text(
        'machine = "paper_1dof"\npoints = 2\n[[requirements]]\ncatalogue = "iso"\n'
        'speed.up = { joint_deg_per_s = { boom = 10 }, at = "every" }\n'
    )
    answers = ad.sweep(**read_study(study, ad.load))
    assert not answers.failures
    assert answers.frame["requirements.speed.up.joint_deg_per_s.boom"].tolist() == [10]


def test_an_array_that_is_one_number_is_no_list_of_values() -> None:
    alone = {"cylinder.lift.bore_mm": np.array(60.0)}
    with pytest.raises(ad.ArmDesignError, match="is no list of values"):
        ad.sweep("paper_1dof", alone, points=2)
    with pytest.raises(ad.ArmDesignError, match="is no range"):
        ad.sweep("paper_1dof", alone, points=2, sobol=2)


def test_whole_numbers_of_a_sobol_sequence_may_be_numpys() -> None:
    bores = {"cylinder.lift.bore_mm": [60, 70]}
    how: dict[str, Any] = {"sobol": np.int64(2), "seed": np.int64(1)}
    of_numpy = ad.sweep("paper_1dof", bores, points=2, **how)
    plain = ad.sweep("paper_1dof", bores, points=2, sobol=2, seed=1)
    assert [case.key for case in of_numpy.cases] == [case.key for case in plain.cases]


@pytest.mark.parametrize("more", [{}, {"sobol": 2}])
@pytest.mark.parametrize("seed", [True, False])
def test_a_truth_value_is_no_seed(more: dict[str, int], seed: bool) -> None:
    with pytest.raises(ad.ArmDesignError, match=f"seed: {seed} is not allowed; give a whole"):
        ad.sweep("paper_1dof", {"cylinder.lift.bore_mm": [60, 70]}, seed=seed, **more)


def test_arrays_are_no_options_of_functions() -> None:
    """They were given as lists, of which twice is a longer one: another mean, and no error."""

    def mean(machine: ad.Machine, _: ad.Workspace, gains: Any) -> dict[str, float]:
        return {"mean": float(np.mean(gains * 2))}

    for given in (np.array([1.0, 2.0, 3.0]), {"of": [np.ones(2)]}):
        with pytest.raises(ad.ArmDesignError, match=r"options\.gains.*is an array"):
            ad.sweep("paper_1dof", None, mean, options=[{"gains": given}], points=2)
    scalar = ad.sweep("paper_1dof", None, mean, options={"gains": np.float64(2.0)}, points=2)
    assert scalar.frame["mean"].tolist() == [4.0]


def test_the_changes_of_a_sweep_can_be_given_again() -> None:
    """By its cases; its frame has more columns, and NaN where a case keeps the file's number."""
    changes = [{"fluid.bulk_modulus_MPa": 900.0}, {"cylinder.lift.bore_mm": 61.0}]
    first = ad.sweep("paper_1dof", changes, points=3)
    frame = first.frame
    again = ad.sweep("paper_1dof", [case.changes for case in first.cases], points=3)
    assert again.frame["error"].tolist() == ["", ""]
    assert again.frame["worst_hz"].tolist() == frame["worst_hz"].tolist()
    with pytest.raises(ad.ArmDesignError, match=r"\[case\.changes for case in sweep\.cases\]"):
        ad.sweep("paper_1dof", frame.to_dict("records"), points=3)
    rows = frame[list(first.paths)].to_dict("records")
    assert (
        ad.sweep("paper_1dof", rows, points=3).frame["error"].str.contains("nan is not all").all()
    )


def in_threads_of_its_own(machine: ad.Machine, _: ad.Workspace) -> dict[str, float]:
    """A task that sweeps in two threads."""

    def worst(modulus: float) -> float:
        sweep = ad.sweep(machine, {"fluid.bulk_modulus_MPa": [modulus]}, points=3)
        return float(sweep.frame["worst_hz"][0])

    with ThreadPoolExecutor(2) as pool:
        soft, stiff = pool.map(worst, [900.0, 1000.0])
    return {"soft": soft, "stiff": stiff}


def test_a_task_may_sweep_in_threads() -> None:
    """They waited for each other for ever; afterwards BLAS has its threads again."""
    before = threads()
    found = ad.sweep("paper_1dof", None, in_threads_of_its_own, points=3).frame
    grid = {"fluid.bulk_modulus_MPa": [900.0, 1000.0]}
    alone = ad.sweep("paper_1dof", grid, points=3).frame["worst_hz"]
    assert [found["soft"][0], found["stiff"][0]] == alone.tolist()
    assert threads() == before
