"""Machines from other people's URDFs: `Machine.from_urdf`."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from tests import machines

EXCAVATOR = machines.named("excavator_20t")
DATA = tomllib.loads(EXCAVATOR.text)
URDF = EXCAVATOR.urdf_text


def machine_from_urdf(
    urdf: Any = URDF, cylinders: Any = DATA["cylinder"], **others: Any
) -> ad.Machine:
    return ad.Machine.from_urdf(urdf, cylinders, **others)


def test_the_shipped_machine_from_its_parts() -> None:
    """URDF text and tables of the file give the same machine: same joints found, same modes."""
    machine = machine_from_urdf(
        payloads=DATA["payload"], tool=DATA["tool"], fluid=DATA["fluid"], supply=DATA["supply"]
    )
    assert machine.joints == EXCAVATOR.joints
    q = EXCAVATOR.ranges.mean(axis=1)
    for payload in ("empty", "full"):
        one, other = (
            ad.natural_modes(m.with_payload(payload).at(q)).frequencies
            for m in (machine, EXCAVATOR)
        )
        assert one == pytest.approx(other, rel=1e-12)


def test_a_motor_makes_its_joint_a_coordinate() -> None:
    machine = machine_from_urdf(motors=DATA["motor"])
    assert machine.joints == ("swing", *EXCAVATOR.joints)
    assert machine.motors == EXCAVATOR.replace({"joints": list(machine.joints)}).motors


def test_defaults() -> None:
    machine = machine_from_urdf()
    assert machine.name == "excavator_20t"  # the robot's name
    assert machine.tool.link == "bucket"
    assert [(p.name, p.mass) for p in machine.payloads] == [("empty", 0.0)]
    assert machine.fluid.bulk_modulus == pytest.approx(1.2e9)
    assert machine.supply.pressure == pytest.approx(250e5)
    assert machine_from_urdf(supply={"pressure_bar": 300}).supply.return_pressure == pytest.approx(
        5e5
    )


def test_replace_and_save(tmp_path: Path) -> None:
    machine = machine_from_urdf().replace(
        {"cylinder.boom.bore_mm": 130, "cylinder.stick.base.at_mm": [3400, 0, 1147.5]}
    )
    again = ad.load(machine.save(tmp_path / "mine.toml"))
    assert again.cylinders[0].bore == pytest.approx(0.130)
    q = machine.ranges.mean(axis=1)
    assert ad.natural_modes(again.at(q)).frequencies == pytest.approx(
        ad.natural_modes(machine.at(q)).frequencies
    )
    assert "made from" in machine.text
    assert 'base = {link = "chassis", at_mm = [461.5, 0, -602.5]}' in machine.text


def test_from_a_path(tmp_path: Path) -> None:
    (tmp_path / "my robot.urdf").write_text(URDF, encoding="utf-8")
    for path in (tmp_path / "my robot.urdf", str(tmp_path / "my robot.urdf")):
        machine = machine_from_urdf(path)
        assert machine.name == "my_robot"
        assert machine.source == tmp_path / "my robot.toml"
    assert list(tmp_path.iterdir()) == [tmp_path / "my robot.urdf"]


def test_joints_no_cylinder_spans_are_frozen() -> None:
    machine = machine_from_urdf(cylinders={"stick": DATA["cylinder"]["stick"]})
    assert machine.joints == ("stick",)
    with pytest.raises(
        ad.ArmDesignError, match=r"joint bucket: is frozen at 0\.9, outside its limits"
    ):
        machine_from_urdf(cylinders={"stick": DATA["cylinder"]["stick"]}, frozen={"bucket": 0.9})
    frozen = machine_from_urdf(
        cylinders={"stick": DATA["cylinder"]["stick"]}, frozen={"bucket": -1.0}
    )
    q = machine.ranges.mean(axis=1)
    assert frozen.at(q).mass_matrix[0, 0, 0] != pytest.approx(machine.at(q).mass_matrix[0, 0, 0])


def test_continuous_joints_work() -> None:
    """Without limits the stroke alone ends the range, at the same place."""
    urdf = re.sub(r'(<joint name="boom" type=)"revolute"', r'\1"continuous"', URDF)
    assert urdf != URDF
    assert machine_from_urdf(urdf).ranges == pytest.approx(EXCAVATOR.ranges, abs=1e-4)


def test_numpy_numbers() -> None:
    boom = {**DATA["cylinder"]["boom"], "bore_mm": np.float64(120)}
    boom["base"] = {"link": "chassis", "at_mm": np.array([461.5, 0.0, -602.5])}
    assert machine_from_urdf(cylinders={**DATA["cylinder"], "boom": boom}).cylinders[
        0
    ].bore == pytest.approx(0.12)


def with_stick(kind: str) -> str:
    return re.sub(r'(<joint name="stick" type=)"revolute"', rf'\1"{kind}"', URDF)


STICK = '<joint name="stick" type="revolute">'
BAD = [
    (
        {"urdf": with_stick("planar")},
        'joint stick: type "planar" cannot be used; use revolute, continuous',
    ),
    ({"urdf": with_stick("floating")}, 'joint stick: type "floating" cannot be used'),
    (
        {"urdf": URDF.replace(STICK, STICK + '<mimic joint="boom"/>')},
        "joint stick: mimics another joint",
    ),
    ({"urdf": "<robot"}, "not well-formed XML"),
    ({"urdf": '<sdf version="1.7"/>'}, "machine.urdf: the XML root is <sdf>, not <robot>"),
    (
        {
            "urdf": re.sub(r'(?s)(name="stick".*?lower=)"[^"]*"', r'\1"9"', URDF),
            "joints": ["boom"],
        },
        "joint stick: limits [9, -0.5801] are empty; lower must be below upper",
    ),
    ({"urdf": "none.urdf"}, "none.urdf: no such file"),
    ({"urdf": 5}, "urdf: type int is not allowed; give a path or the URDF's text"),
    ({"cylinders": {}}, "cylinder: an empty table is not allowed"),
    ({"cylinders": []}, "cylinders: type list is not allowed; expected {key: value}"),
    ({"cylinders": {"boom": 5}}, "cylinder.boom: 5 is not allowed; give a table with bore_mm"),
    ({"cylinders": {"boom": {"bore": 1}}}, "cylinder.boom.bore: unknown key"),
    (
        {"cylinders": {"boom": {**DATA["cylinder"]["boom"], "bore_mm": object()}}},
        "cylinder.boom.bore_mm: cannot hold",
    ),
    ({"joints": ["bom"]}, "joint bom: is not in the URDF"),
    (
        {"joints": ["boom", "slide"], "frozen": {"stick": -1}},
        "joint slide: is not in the URDF (named in joints)",
    ),
    ({"tool": {"link": "none", "at_mm": [0, 0, 0]}}, 'tool.link: no link "none" in the URDF'),
    (
        {"payloads": {"full": {"mass_kg": 5}}},
        "payload.full.link: missing: a mass must sit somewhere",
    ),
    ({"fluid": {"beta": 5}}, "fluid.beta: unknown key"),
    ({"supply": 5}, "supply: type int is not allowed"),
    ({"name": "a b"}, 'name: "a b" is not allowed'),
]


@pytest.mark.parametrize(("words", "message"), BAD, ids=[message[:30] for _, message in BAD])
def test_bad_input(
    words: dict[str, Any], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ad.ArmDesignError) as caught:
        machine_from_urdf(**words)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
