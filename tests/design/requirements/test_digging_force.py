"""Digging forces by the independent planar reference."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from armdesign import ArmDesignError, Machine, Requirements, Workspace
from armdesign.design.requirements.check import check, digging_forces
from armdesign.design.requirements.performance import performances
from armdesign.errors import MachineFileError
from armdesign.inspection.file_faults import faults
from tests.design.designs import MACHINES
from tests.design.requirements.shared import own, reference
from tests.machines import BOOM, LIFT, CylinderSpec, Joint, build, redundant


def test_digging_force_by_the_independent_reference() -> None:
    """ISO 6015 at the tool, the bucket standing where it digs best; 1e-5 for sampling (20 001
    poses there).
    """
    old = reference()
    checks = own(digging_force={"stick": 100e3, "bucket": 125e3})
    for name, (force, _) in old.digging(["stick", "bucket"], old.ranges).items():
        assert checks[f"digging_force.{name}"].value == pytest.approx(force, rel=1e-5)
        assert digging_forces(MACHINES["excavator"]())[name] == pytest.approx(force, rel=1e-5)
    assert checks["digging_force.stick"].slack == pytest.approx(
        checks["digging_force.stick"].value / 100e3 - 1
    )


def test_a_relief_below_the_supply_digs_with_its_own_pressure() -> None:
    """The stick's at 200 of 350 bar; where cylinders dig best no pressure counts."""
    machine = MACHINES["excavator"]()
    before = digging_forces(machine)
    after = digging_forces(machine.replace({"cylinder.stick.valve.relief_bar": 200.0}))
    expected = before | {"stick": before["stick"] * 200 / 350}
    assert after == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("reverse", [False, True])
def test_each_of_two_cylinders_on_one_joint_has_its_force(reverse: bool) -> None:
    """About one joint forces are as torques, p A r; the order of the file does not matter."""
    machine = redundant(reverse)
    forces, other = digging_forces(machine), digging_forces(redundant(not reverse))
    assert set(forces) == {"lift", "help", "fold"}
    torques = {machine.actuators[p.actuator].name: p.largest[0] for p in performances(machine)}
    assert forces["lift"] / forces["help"] == pytest.approx(torques["lift"] / torques["help"])
    assert forces == pytest.approx(other)


@pytest.mark.parametrize(
    ("key", "value"), [("digging_kN.push", 3.0), ("digging.cylinders", ["lift", "push"])]
)
def test_a_telescope_has_no_digging_force(key: str, value: Any, tmp_path: Path) -> None:
    """Asked for in a file, ``load`` and ``check`` refuse it alike; and optimising, where it is
    asked for by argument.
    """
    machine = telescope()
    fault = (
        "the push cylinder has no digging force: it turns no single joint between root and tool"
    )
    with pytest.raises(MachineFileError, match=rf"requirements\.{key}: {fault}; leave it out"):
        machine.replace({f"requirements.{key}": value})
    path = machine.save(tmp_path / "slide.toml")
    path.write_text(f"{path.read_text()}\n[requirements]\n{key} = {json.dumps(value)}\n")
    (only,) = faults(path)
    assert str(only).startswith(f"slide.toml: requirements.{key}: {fault}")
    requirements = Requirements(digging_force={"push": 3e3})
    with pytest.raises(ArmDesignError, match=r"^requirements\.digging_kN\.push: the push"):
        check(machine, machine, Workspace.grid(machine, 3), requirements)


def telescope() -> Machine:
    """A slide on the boom, its limits from -1.2 to 3 m; the tool 0.2 m below its line."""
    slide = Joint(
        "slide", "boom", xyz=(2.5, 0, 0), axis=(1, 0, 0), kind="prismatic", limits=(-1.2, 3.0)
    )
    push = CylinderSpec("push", ("boom", (0.2, 0, 0.3)), ("slide", (0.0, 0, 0.3)))
    return build([BOOM, slide], [LIFT, push])


def test_a_telescope_stands_at_the_middle_of_its_stroke() -> None:
    """Its limits reach from -1.2 to 3 m, but its cylinder, 2.3 m long at 0, is 1.45 times as long
    when open. The tool is 0.2 m below the line along which it slides, 3.5 m out at 0.
    """
    machine = telescope()
    middle = (-1.2 + 0.45 * 2.3) / 2
    torque = next(float(p.largest[0]) for p in performances(machine))
    force = torque / math.hypot(3.5 + middle, 0.2)
    assert digging_forces(machine) == {"lift": pytest.approx(force, rel=1e-6)}
