"""A family of machines against the machines themselves, one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import Array
from armdesign.influence.family import Family, can_matter, rebuilt
from armdesign.machine import template
from armdesign.machine.file.key_paths import Location
from armdesign.machine.file.numbers import numbers_of
from armdesign.units import deg
from tests.machines import middle

COUNT = 3


def changes(machine: ad.Machine, share: float = 1e-3) -> dict[Location, Array]:
    """Every number that can matter, changed by chance; zero becomes positive."""
    random = np.random.default_rng(1)
    values = {}
    for number in numbers_of(machine.section).values():
        if can_matter(number.location):
            by_chance = random.uniform(-share, share, COUNT)
            zero = 1e-3 * min(number.high, 1.0) if number.unit != "m/N" else 1e-9
            changed = zero * np.abs(by_chance) if number.value == 0 else number.value * by_chance
            values[number.location] = number.value + changed
    return values


def test_members_are_what_their_files_say(machine: ad.Machine) -> None:
    """All numbers of the file changed at once: pins, four-bars, oil, masses, motors, springs."""
    values = changes(machine)
    q, payload = middle(machine), machine.payload.name
    members = Family.of(machine, values, COUNT).at(q, payload)
    for row in range(COUNT):
        own = rebuilt(machine, {path: float(array[row]) for path, array in values.items()})
        poses = own.with_payload(payload).evaluate(own.rigid_poses(q[None]))
        for name in ("mass_matrix", "stiffness_matrix", "cylinder_forces", "extensions"):
            expected = getattr(poses, name)[0]
            size = np.abs(expected).max()
            np.testing.assert_allclose(getattr(members, name)[row], expected, atol=1e-12 * size)


def test_bodies_add_up_to_the_arm(machine: ad.Machine) -> None:
    """M, g and ∂g/∂q are linear in the masses of the links."""
    q = middle(machine)[None]
    whole = machine.rigid_poses(q)
    parts = [body.rigid_poses(q) for body in machine.arm.bodies_apart]
    for name in ("mass_matrix", "gravity_torque", "gravity_stiffness"):
        total = sum(getattr(part, name) for part in parts)
        size = np.abs(getattr(whole, name)).max()
        np.testing.assert_allclose(total, getattr(whole, name), atol=1e-12 * size)


def test_factors_on_the_mass_of_links_are_those_of_the_urdf() -> None:
    """The stick of the excavator 5 % heavier in the URDF, mass and inertia."""
    machine = ad.load("excavator_20t")
    import re

    urdf = re.search(r'(?s)<link name="stick">.*?</link>', machine.urdf_text)
    assert urdf is not None
    heavier = re.sub(
        r'(mass value|i[xyz]{2})="([^"]+)"',
        lambda match: f'{match[1]}="{1.05 * float(match[2])!r}"',
        urdf[0],
    )
    text = machine.urdf_text.replace(urdf[0], heavier)
    other = ad.Machine.from_text(machine.text, text, machine.source)
    q = middle(machine)
    family = Family.of(machine, {}, 1, np.array([[1.0, 1.05, 1.0]]))
    expected = other.at(q).mass_matrix
    np.testing.assert_allclose(family.at(q, "empty").mass_matrix, expected, rtol=1e-12)


def test_limits_of_links_are_numbers_of_any_library() -> None:
    """Limits of NumPy's numbers were written as words, and read back as none."""
    machine = ad.Machine.from_text(template.new("loader", links=2), "", Path("loader.toml"))
    location = ("links", machine.joints[0], "limits_deg", 1)
    for value in (-4.0, np.float64(-4.0)):
        assert rebuilt(machine, {location: value}).arm.limits[0, 1] == pytest.approx(-4 * deg)


@pytest.mark.parametrize("rows", [[0], [2, 0, 0]])
def test_some_members_are_those_members(rows: list[int]) -> None:
    machine = ad.load("mini_excavator_2t").with_payload("full")
    family = Family.of(machine, changes(machine), COUNT)
    q = middle(machine)
    whole, some = (f.at(q, "full").stiffness_matrix for f in (family, family.some(np.array(rows))))
    np.testing.assert_array_equal(some, whole[rows])
