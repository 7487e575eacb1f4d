"""Springs: joints that no actuator drives, against closed forms and against the total energy."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.frequency.modes import energy_shares
from armdesign.inspection.file_faults import faults
from tests.checks import assert_same, difference
from tests.commands import Refused
from tests.energy import Energy
from tests.machines import BOOM, LIFT, CylinderSpec, Joint, build, named
from tests.sprung import off_middle, random_sprung, rocking, spring, two_masses, written

SEEDS = range(8)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS[2:])]
)
def test_matrices_are_derivatives_of_the_total_energy(seed: int) -> None:
    """K is the curvature of the potential energy at rest, M the kinetic energy's; no force is
    left: the springs' preload holds what gravity needs.
    """
    machine = random_sprung(seed)
    energy, poses = Energy(machine, off_middle(machine)), machine.at(off_middle(machine))

    def slope(x: np.ndarray) -> np.ndarray:
        return difference(lambda y: np.array([energy.potential(row) for row in y]), x)

    curvature = difference(slope, energy.equilibrium[None])[0]
    scale = np.abs(poses.gravity_torque).max()
    assert_allclose(slope(energy.equilibrium[None])[0], 0, atol=1e-8 * scale)
    assert_same(poses.stiffness_matrix[0], curvature, 1e-7)
    units = np.eye(len(energy.equilibrium))
    kinetic = [
        [energy.kinetic(a + b) - energy.kinetic(a) - energy.kinetic(b) for a in units]
        for b in units
    ]
    assert_same(poses.mass_matrix[0], np.array(kinetic), 1e-8)


def test_two_masses() -> None:
    """M over a spring, m on oil upon it: ω⁴ − (k/m + (k + κ)/M) ω² + kκ/(mM) = 0, and with the
    cylinder locked √(κ/(M + m)).
    """
    m, big, kappa = 400.0, 900.0, 3e6
    machine = two_masses(kappa, big)
    poses = machine.at([0.05])
    modes, k = ad.natural_modes(poses), float(poses.oil_stiffness[0, 0])
    half = (k / m + (k + kappa) / big) / 2
    root = math.sqrt(half**2 - k * kappa / (m * big))
    expected = np.sqrt([half - root, half + root]) / (2 * math.pi)
    assert_allclose(modes.frequencies[0], expected, rtol=1e-12)
    x = k / (k - m * (2 * math.pi * expected[0]) ** 2)  # of the slide per carriage, in one mode
    oil, structure = k * (x - 1) ** 2, kappa
    shares = energy_shares(poses, modes)[0, 0]
    assert_allclose(shares, np.array([oil, structure]) / (oil + structure), rtol=1e-10)
    assert_allclose(poses.gravity_torque, 0, atol=1e-9)


@pytest.mark.parametrize("name", ["excavator_20t", "mini_excavator_2t"])
def test_stiff_springs_make_the_machine_without_springs(name: str) -> None:
    rigid, machine = ad.load(name), rocking(name, 1e15)
    q = off_middle(rigid)
    first, second = (ad.natural_modes(m.at(q)) for m in (rigid, machine))
    assert_allclose(second.frequencies[:, :3], first.frequencies, rtol=1e-6)
    assert_allclose(second.locked_frequencies, first.locked_frequencies, rtol=1e-6)
    assert_allclose(second.rigid_frequencies, first.rigid_frequencies, rtol=1e-12)
    assert_allclose(machine.at(q).cylinder_forces, rigid.at(q).cylinder_forces, rtol=1e-12)


def test_locked_frequencies_leave_springs_free() -> None:
    """The lowest of the other cylinders' oil made a million times stiffer, but for inertia that
    they no longer let pass: what is left is the locked frequency.
    """
    machine = rocking()
    poses = machine.at(off_middle(machine))
    locked = ad.natural_modes(poses).locked_frequencies[0]
    for i in range(3):
        oil = np.where(np.arange(3) == i, poses.oil_stiffness[0], 1e6 * poses.oil_stiffness[0])
        r = poses.moment_arms[0]
        k = poses.stiffness_matrix[0] + r.T @ np.diag(oil - poses.oil_stiffness[0]) @ r
        lowest = np.linalg.eigvals(np.linalg.solve(poses.mass_matrix[0], k)).real.min()
        assert locked[i] == pytest.approx(math.sqrt(lowest) / (2 * math.pi), rel=1e-5)


def test_a_spring_limits_and_is_named() -> None:
    """On a soft carriage the carriage has most of the energy; on a stiff one the boom has."""
    for stiffness, limiting in ((3e6, "carriage"), (1e9, "boom")):
        machine = rocking(stiffness=stiffness)
        frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=4))
        assert frequencies.worst.cylinder == limiting
        assert frequencies.limiting_shares.idxmax() == limiting
        assert frequencies.limiting_shares.sum() == pytest.approx(1)
        assert list(frequencies.limiting_shares.index) == ["boom", "stick", "bucket", "carriage"]
        assert [c for c in frequencies.frame.columns if c[0] == "f" and c.endswith("_hz")] == [
            f"f{i}_hz" for i in (1, 2, 3, 4)
        ]
        assert_allclose(frequencies.part_shares.sum(axis=1), 1)
        squared = (2 * math.pi * frequencies.frame["f1_hz"]) ** 2
        assert_allclose(frequencies.stiffness["omega_squared"], squared, rtol=1e-9)


def test_softer_springs_lower_every_frequency() -> None:
    """K grows with κ and M stays, so every eigenvalue does (Courant and Fischer)."""
    soft, stiff = (rocking(stiffness=k) for k in (1e7, 2e7))
    q = off_middle(soft)
    assert np.all(
        ad.natural_modes(soft.at(q)).frequencies < ad.natural_modes(stiff.at(q)).frequencies
    )


def test_stiffness_is_a_key_path() -> None:
    machine = rocking()
    path = "spring.carriage.stiffness_N_m_per_rad"
    other = machine.replace({path: 5e7})
    assert other.springs[0].stiffness == 5e7
    assert other.arm is machine.arm
    tilted = machine.replace({"spring.carriage.at_deg": 1.0})
    tip = tilted.at(off_middle(machine)).tool - machine.at(off_middle(machine)).tool
    assert np.linalg.norm(tip) > 0.05, "the machine stands where its spring does"


def test_workspace_and_ranges_are_those_of_the_joints() -> None:
    machine, rigid = rocking(), ad.load("excavator_20t")
    assert machine.joints == rigid.joints
    assert_allclose(machine.ranges, rigid.ranges, rtol=1e-12)
    one, other = (ad.Workspace.grid(m, points=4) for m in (machine, rigid))
    assert_allclose(one.q, other.q, rtol=1e-12)


def test_a_spring_too_soft_for_gravity_is_refused_with_what_it_needs() -> None:
    """The stiffness named is enough, a thousandth less is not."""
    path = "spring.carriage.stiffness_N_m_per_rad"
    machine = rocking(stiffness=1e5).with_payload("full")
    q = ad.Workspace.grid(machine, points=4).q
    q = q[machine.holds(q)]
    with pytest.raises(ad.ArmDesignError, match="does not hold the machine upright") as caught:
        machine.at(q)
    error = caught.value
    assert error.part.endswith(path)
    assert "boom" in error.fault
    assert "payload full" in error.fault
    assert error.line is not None
    least = float(error.remedy.removeprefix("give more than ").removesuffix(" N m/rad"))
    machine.replace({path: 1.0005 * least}).at(q)
    with pytest.raises(ad.ArmDesignError, match="upright"):
        machine.replace({path: 0.999 * least}).at(q)


def heeled(gear_ratio: float) -> ad.Machine:
    """A boom on a slew, on a carriage that a spring holds at a heel of 5°."""
    rock = Joint("rock", "root", mass=800, com=(0, 0, 0.3), limits=(-0.3, 0.3))
    slew = Joint(
        "slew", "rock", xyz=(0, 0, 0.5), axis=(0, 0, 1), kind="continuous",
        mass=500, com=(0.5, 0, 0.5),
    )  # fmt: skip
    motor = (
        f"[motor.turn]\njoint = 'slew'\ndisplacement_cm3 = 160\ngear_ratio = {gear_ratio!r}\n"
        "trapped_volume_l = { a = 0.6, b = 0.6 }\n"
    )
    joints = [rock, slew, replace(BOOM, parent="slew")]
    lift = replace(LIFT, base=("slew", LIFT.base[1]))
    more = motor + spring("carriage", "rock", 1e5, "at_deg = 5")
    return build(joints, [lift], order=["slew", "boom"], more=more)


def test_an_actuator_too_soft_is_told_by_its_own_stiffness() -> None:
    """A gear of 0.5 holds 1.2 GPa (160 cm³ · 0.5/2π)² 2/0.6 l = 648.5 N m/rad. The least is where
    K without it, taken from a gear of 1, has a determinant of 0.
    """
    oil = 2 * 1.2e9 * (160e-6 / (2 * math.pi)) ** 2 / 0.6e-3  # of a gear of 1; by its square
    q = [0.7, 0.1]
    stiff = heeled(1.0).at(q).stiffness_matrix[0]
    least = oil - np.linalg.det(stiff) / np.linalg.det(stiff[1:, 1:])
    with pytest.raises(ad.ArmDesignError, match=r"upright at slew 40\.1°") as caught:
        heeled(0.5).at(q)
    error = caught.value
    assert error.part.endswith(": motor.turn")
    assert f"the {0.25 * oil:.4g} N m/rad of its trapped oil" in error.fault
    assert float(error.remedy.split()[-5]) == pytest.approx(least, rel=1e-3)
    heeled(1.001 * math.sqrt(least / oil)).at(q)
    with pytest.raises(ad.ArmDesignError, match=r"motor\.turn"):
        heeled(0.999 * math.sqrt(least / oil)).at(q)


def test_a_spring_too_soft_within_the_bands_is_told_in_the_numbers_of_the_file() -> None:
    """Enough as the file says, too soft at half of it; the stiffness named is enough there too."""
    path, bands = "spring.carriage.stiffness_N_m_per_rad", ad.Bands(spring_stiffness=(0.5, 1.0))
    machine = rocking(stiffness=1e5).with_payload("full")
    q = ad.Workspace.grid(machine, points=4).q
    q = q[machine.holds(q)]
    given = "give more than "
    with pytest.raises(ad.ArmDesignError, match=given) as caught:
        machine.at(q)
    enough = float(caught.value.remedy.removeprefix(given).removesuffix(" N m/rad"))
    machine = machine.replace({path: 1.5 * enough})
    machine.at(q)
    with pytest.raises(ad.ArmDesignError, match=r"N m/rad \(0.5 of it, within the b") as caught:
        bands.at_end(machine, bands.ends[0]).at(q)
    assert f"{1.5 * enough:g} N m/rad" in caught.value.fault
    least = float(caught.value.remedy.removeprefix(given).removesuffix(" N m/rad"))
    bands.at_end(machine.replace({path: 1.0005 * least}), bands.ends[0]).at(q)
    with pytest.raises(ad.ArmDesignError, match="upright"):
        bands.at_end(machine.replace({path: 0.995 * least}), bands.ends[0]).at(q)


def test_a_command_says_it_in_one_line(
    refused: Refused, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = written(rocking(stiffness=1e5), tmp_path_factory.mktemp("soft"))
    refused(["map", str(path), "--points", "4"], "does not hold the machine upright")


def test_several_springs_too_soft() -> None:
    """Two springs in a row under a tall mass: no single one is enough, both together are."""
    joints = [
        Joint("low", "root", mass=10.0, com=(0, 0, 0.5)),
        Joint("high", "low", xyz=(0, 0, 1.0), mass=10.0, com=(0, 0, 0.5)),
        Joint("arm", "high", xyz=(0, 0, 1.0), mass=2000.0, com=(0.3, 0, 0.5)),
    ]
    lift = CylinderSpec("lift", ("high", (0.7, 0, 0.1)), ("arm", (1.1, 0, 0.4)))
    tables = "\n\n".join(spring(name, name, 1e3) for name in ("low", "high"))
    machine = build(joints, [lift], order=["arm"], more=tables)
    with pytest.raises(ad.ArmDesignError, match="all springs") as caught:
        machine.at([0.0])
    factor = float(caught.value.remedy.rpartition(" ")[2])

    def times(factor: float) -> ad.Machine:
        keys = [f"spring.{name}.stiffness_N_m_per_rad" for name in ("low", "high")]
        return machine.replace(dict.fromkeys(keys, factor * 1e3))

    times(1.001 * factor).at([0.0])
    with pytest.raises(ad.ArmDesignError, match="upright"):
        times(0.998 * factor).at([0.0])


ROCK = 'joint = "rocking"\n'
STIFF = "stiffness_N_m_per_rad = 2.5e7\n"
BAD = {
    "one_of_joints": ('joint = "boom"\n' + STIFF, r"spring\.s\.joint: .*one of joints"),
    "driven": ('joint = "swing"\n' + STIFF, r"spring\.s\.joint: .*driven by motor\.swing"),
    "unknown": ('joint = "rockin"\n' + STIFF, r'is not in the URDF.*did you mean "rocking"'),
    "fixed": ('joint = "boom_foot"\n' + STIFF, "is fixed and cannot be a coordinate"),
    "unit_of_stiffness": (ROCK + "stiffness_N_per_m = 1e7\n", '"rocking" turns; give stiffness_N'),
    "unit_of_at": (ROCK + STIFF + "at_mm = 1.0\n", r"at_mm: .*give at_deg"),
    "no_stiffness": (ROCK, "neither stiffness_N_m_per_rad nor stiffness_N_per_m given"),
    "two": (ROCK + STIFF + "stiffness_N_per_m = 1e7\n", "both stiffness_N_m_per_rad and"),
    "zero": (ROCK + "stiffness_N_m_per_rad = 0\n", r"0 .*in \(0, 1e\+15\] N m/rad"),
    "negative": (ROCK + "stiffness_N_m_per_rad = -1.0\n", r"-1\.0 .*in \(0, 1e\+15\] N m/rad"),
    "nan": (ROCK + "stiffness_N_m_per_rad = nan\n", r"in \(0, 1e\+15\] N m/rad"),
    "outside": (ROCK + STIFF + "at_deg = 30.0\n", r"at_deg: 30 .*\[-5\.72958, 5\.72958\]"),
    "damping": (ROCK + STIFF + "damping_ratio = -0.1\n", r"in \[0, 10\]"),
    "unknown_key": (ROCK + STIFF + "mass_kg = 1.0\n", "mass_kg"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_springs(name: str, tmp_path: Path) -> None:
    """One line each, and one alone; `check` says the same."""
    table, words = BAD[name]
    machine = rocking()
    text = machine.text.partition("[spring.carriage]")[0] + "[spring.s]\n" + table
    with pytest.raises(ad.ArmDesignError, match=words) as caught:
        ad.Machine.from_text(text, machine.urdf_text, machine.source)
    assert "\n" not in str(caught.value)
    path = tmp_path / machine.source.name
    path.write_text(text, encoding="utf-8")
    (tmp_path / machine.section.urdf).write_text(machine.urdf_text, encoding="utf-8")
    assert list(map(str, faults(path))) == [str(caught.value)]


def test_a_frozen_joint_carries_no_spring() -> None:
    crane = named("loader_crane")
    text = crane.text + '\n[spring.s]\njoint = "slew"\n' + STIFF
    with pytest.raises(ad.ArmDesignError, match=r"spring\.s\.joint: .*frozen too; take it out"):
        ad.Machine.from_text(text, crane.urdf_text, crane.source)


def test_a_joint_between_pins_carries_no_spring() -> None:
    """Freed from `joints`, the stick would still be driven by its cylinder."""
    machine = rocking()
    text = machine.text.replace('joints = ["boom", "stick", "bucket"]', 'joints = ["boom"]')
    assert text != machine.text
    text = text.replace('joint = "rocking"', 'joint = "stick"')
    with pytest.raises(ad.ArmDesignError, match=r"lies between the pins of cylinder\.stick"):
        ad.Machine.from_text(text, machine.urdf_text, machine.source)


def test_a_spring_needs_a_joint_and_a_name_of_its_own() -> None:
    again = "[spring.{name}]\njoint = 'rocking'\nstiffness_N_m_per_rad = 1e7"
    with pytest.raises(ad.ArmDesignError, match=r'spring\.mast\.joint: "rocking" carries spring'):
        rocking(more=again.format(name="mast"))
    machine = rocking()
    boom = machine.text.replace("[spring.carriage]", "[spring.boom]")
    with pytest.raises(ad.ArmDesignError, match=r"spring\.boom: is the name of an actuator too"):
        ad.Machine.from_text(boom, machine.urdf_text, machine.source)
