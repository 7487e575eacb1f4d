"""A kind of linkage is one file: one that the package does not know works by its class alone, and
no other module names what belongs to a single kind.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.exchange.cylinder_bodies import cylinder_bodies
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.linkage.base import Linkage, Pin
from armdesign.mechanism.linkage.direct import Direct
from armdesign.mechanism.linkage.kinds import KINDS
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.simulation.plant.equilibrium import find_equilibrium
from armdesign.simulation.plant.plant import Plant
from tests.checks import assert_same
from tests.machines import inner_poses, named

PACKAGE = Path(ad.__file__).parent


@dataclass(frozen=True, kw_only=True)
class Bracket(Linkage):
    """A rod end on a bracket welded to a link at its foot, along the link's x axis."""

    key = "bracket"
    title = "bracket"
    pin_names = ("base", "foot")
    bar_names = ("arm_length",)

    foot: Pin
    arm_length: float

    @property
    def outer(self) -> Pin:
        x, y, z = self.foot.at
        return Pin(link=self.foot.link, at=(x + self.arm_length, y, z))

    def rod_end_from(self, poses: RigidPoses, link: str, joints: tuple[int, ...]) -> VectorJet:
        return self._motion(poses, self.outer, link, joints)

    def rod_end_record(self) -> dict[str, Any]:
        return {"far": self.outer}


def bracketed(machine: ad.Machine, i: int) -> ad.Machine:
    """The machine with its direct linkage ``i`` told as a bracket of 0.1 m."""
    direct, linkages = machine.linkages[i], list(machine.linkages)
    assert isinstance(direct, Direct)
    x, y, z = direct.rod_end.at
    foot = replace(direct.rod_end, at=(x - 0.1, y, z))
    linkages[i] = Bracket(base=direct.base, foot=foot, arm_length=0.1, arm=machine.arm)
    return replace(machine, linkages=tuple(linkages))


@pytest.mark.parametrize(("name", "i"), [("excavator_20t", 1), ("heavy_bars", 0), ("branched", 0)])
def test_another_kind_is_a_class_of_its_own(name: str, i: int) -> None:
    """Limiting case: a bracket is a pin further out; every answer of the machine is the same."""
    plain = named(name)
    other = bracketed(plain, i)
    q = inner_poses(plain, 5)
    one, same = plain.at(q), other.at(q)
    for key in ("lengths", "moment_arms", "moment_arm_derivatives", "mass_matrix"):
        assert_allclose(getattr(same, key), getattr(one, key), rtol=1e-12, atol=1e-12)
    assert_allclose(
        ad.natural_modes(same).frequencies, ad.natural_modes(one).frequencies, rtol=1e-12
    )
    assert_allclose(other.ranges, plain.ranges, rtol=1e-12, atol=1e-12)
    assert_allclose(other.margins(q), plain.margins(q), rtol=1e-10)


def test_places_of_another_kind() -> None:
    """Keys, values and derivatives of pins and bars come from their names alone."""
    machine = bracketed(named("excavator_20t"), 1)
    linkage, poses = machine.linkages[1], machine.arm.kinematics(inner_poses(machine, 3))
    assert linkage.places == ("base", "foot", "arm_length")
    assert linkage.own_places == ("foot", "arm_length")
    assert [linkage.key_of(place) for place in linkage.places] == [
        "base.at_mm",
        "bracket.foot.at_mm",
        "bracket.arm_length_mm",
    ]
    assert linkage.mass_key_of("arm_length") == "bracket.arm_length_kg"
    assert linkage.closes(poses).all()
    for place, axis in (("base", 2), ("foot", 0), ("foot", 2), ("arm_length", 0)):
        step = np.zeros(len(linkage.place(place) or ()))
        step[axis] = 1e-6
        ends = [
            linkage.with_places({place: tuple(np.array(linkage.place(place)) + sign * step)})
            for sign in (1, -1)
        ]
        exact = linkage.stepped_actuation(poses, [(place, axis)], 1e-30)
        lengths, arms = zip(
            *((k.length(poses), k.actuation(poses).moment_arm) for k in ends), strict=True
        )
        assert_same(exact.length.imag / 1e-30, (lengths[0] - lengths[1]) / 2e-6, 1e-7)
        assert_same(exact.moment_arm.imag / 1e-30, (arms[0] - arms[1]) / 2e-6, 1e-7)


def test_a_design_moves_the_places_of_another_kind() -> None:
    """Its places are variables, with boxes and derivatives, without a line of the design's own."""
    machine = bracketed(named("excavator_20t"), 1)
    names = tuple(f"cylinder.stick.bracket.{key}" for key in ("foot", "arm_length_mm"))
    workspace = ad.Workspace.grid(machine, points=3)
    problem = Problem.of(
        machine=machine, workspace=workspace, requirements=ad.Requirements(), vary=names
    )
    moved = [(v.pin, v.axis) for v in problem.vector.variables if v.pin is not None]
    assert moved == [("foot", 0), ("foot", 2), ("arm_length", 0)]
    assert problem.vector.moves_within
    assert constraints_at(problem, problem.vector.start).values.min() > -1e-9


@pytest.mark.slow
def test_another_kind_is_simulated() -> None:
    """Limiting case: accelerations are the same from any state, bars of the cylinder included."""
    plain = named("heavy_bars")
    q = inner_poses(plain, 1)[0]
    plants = [Plant(machine) for machine in (plain, bracketed(plain, 0))]
    state = find_equilibrium(plants[0], q).state.copy()
    state[len(q) : 2 * len(q)] = 0.3
    shut = np.zeros((1, len(plain.actuators)))
    one, same = (plant.derivative(state[None], shut)[0] for plant in plants)
    assert np.abs(one[len(q) : 2 * len(q)]).max() > 1e-3
    assert_allclose(same, one, rtol=1e-9, atol=1e-9)


def test_another_kind_is_exported() -> None:
    """Limiting case: its cylinder ends on the same point of the same link."""
    plain = named("excavator_20t")
    q = inner_poses(plain, 3)
    pairs = zip(
        *(cylinder_bodies(one, q, q[1]) for one in (plain, bracketed(plain, 1))), strict=True
    )
    for one, same in pairs:
        assert (one.name, one.parent, one.closes) == (same.name, same.parent, same.closes)
        assert_allclose(same.pin, one.pin, atol=1e-12)
        assert_allclose(same.positions, one.positions, atol=1e-12)


def test_kinds_have_keys_of_their_own() -> None:
    assert len({kind.key for kind in KINDS}) == len(KINDS)


# May name a pin, a bar or the key of one kind: its own module, its table and that table's
# descriptions for editors, its compiled rod end.
OF_ONE_KIND = {
    *("mechanism.linkage.four_bar", "machine.file.schema", "machine.file.json_schema"),
    *("simulation.plant.kinematics", "machine.parallelogram"),
}


@pytest.mark.slow
def test_no_other_module_asks_for_the_four_bar() -> None:
    """Neither an attribute nor a text of the code, but for words that people read."""
    names = {"four_bar", "pivot", "lug", "rocker", "coupler", "knee"}
    named_in = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        tree = ast.parse(path.read_text(encoding="utf-8"))
        attributes = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        attributes |= {
            word
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
            if " " not in node.value
            for word in re.split(r"[.:]", node.value)
        }
        if attributes & names and module not in OF_ONE_KIND:
            named_in[module] = attributes & names
        kinds = ("linkage.direct", "linkage.four_bar")
        modules = {
            node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)
        }
        if module not in {*OF_ONE_KIND, "mechanism.linkage.kinds"}:
            assert not [name for name in modules if name.endswith(kinds)], module
    assert not named_in


def test_a_pin_given_a_list_is_that_of_a_tuple() -> None:
    """Ranges are kept by linkages and cylinders, which must have a hash."""
    machine = ad.load("paper_1dof")
    (linkage,) = machine.linkages
    listed: Any = list(linkage.base.at)
    other = replace(linkage, base=Pin(link=linkage.base.link, at=listed))
    assert hash(other) == hash(linkage)
    assert_allclose(replace(machine, linkages=(other,)).ranges, machine.ranges, rtol=0, atol=0)
