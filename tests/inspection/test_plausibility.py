"""Files that look wrong: the unit, comma or axis that is most likely meant is named first; no
sound machine is blamed.

What was meant is known: a shipped machine's number is divided by the size of the other unit, and
must be given back.
"""

from __future__ import annotations

import copy
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign.inspection.inspection import inspect
from armdesign.inspection.yardstick import Finding
from armdesign.machine import template
from armdesign.machine.file import machine_file, toml_writing
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from armdesign.units import deg
from tests import machines
from tests.machine.as_links import with_links
from tests.scaled_machines import scaled

EXCAVATOR, CRANE = machines.named("excavator_20t"), machines.named("loader_crane")
IN = {
    "metres": 1000,
    "centimetres": 10,
    "inches": 25.4,
    "MPa": 10,
    "Pa": 1e-5,
    "kPa": 0.01,
    "psi": 0.06894757,
}
IN |= {
    "m³": 1000,
    "cm³": 1e-3,
    "t": 1000,
    "g": 1e-3,
    "kg/l": 1000,
    "m³/s": 60000,
    "l/s": 60,
    "per cent": 0.01,
}
IN |= {"radians": 1 / deg, "s": 1000, "l": 1000}  # l: of cm³
OF_MPA = {"GPa": 1000, "Pa": 1e-6, "bar": 0.1, "psi": 0.006894757}


def findings(machine: Machine, points: int = 3) -> list[Finding]:
    return inspect(machine, ad.Workspace.grid(machine, points)).findings()


def with_value(
    machine: Machine, path: str, value: Any, urdf: str = ""
) -> tuple[Machine | None, str]:
    """The machine with another value at a key path, or the message with which it is refused."""
    data = copy.deepcopy(tomllib.loads(machine.text))
    *tables, leaf = path.split(".")
    node = data
    for key in tables:
        node = node.setdefault(key, {})
    node[leaf] = value
    try:
        return (
            Machine.from_text(
                toml_writing.dump(data, "x"), urdf or machine.urdf_text, Path("x.toml")
            ),
            "",
        )
    except ad.ArmDesignError as error:
        return None, str(error)


def rounded(values: Any, factor: float) -> Any:
    if isinstance(values, list):
        return [rounded(value, factor) for value in values]
    return float(f"{values / factor:.6g}")


CASES = [
    *[
        (f"cylinder.boom.{key}_mm", unit)
        for key in ("bore", "stroke", "closed_length")
        for unit in ("metres", "inches")
    ],
    *[
        (f"cylinder.bucket.{key}_mm", "centimetres")
        for key in ("bore", "rod", "stroke", "closed_length")
    ],
    ("cylinder.stick.rod_mm", "metres"),
    *[
        (f"cylinder.{name}.{pin}.at_mm", "metres")
        for name in ("boom", "stick")
        for pin in ("base", "rod_end")
    ],
    *[(f"cylinder.bucket.four_bar.{key}", "metres") for key in ("rocker_mm", "coupler_mm")],
    ("payload.full.at_mm", "metres"),
    ("tool.at_mm", "metres"),
    ("requirements.pin_box_mm", "metres"),
    *[("supply.pressure_bar", unit) for unit in ("MPa", "Pa", "kPa", "psi")],
    *[("fluid.bulk_modulus_MPa", unit) for unit in ("GPa", "Pa", "bar", "psi")],
    ("fluid.density_kg_per_m3", "kg/l"),
    *[("cylinder.boom.dead_volume_l.cap", unit) for unit in ("m³", "cm³")],
    *[("supply.flow_l_per_min", unit) for unit in ("m³/s", "l/s")],
    ("cylinder.boom.valve.rated_flow_l_per_min", "m³/s"),
    ("cylinder.boom.valve.rated_drop_bar", "Pa"),
    ("cylinder.boom.valve.damping_ratio", "per cent"),
    ("requirements.digging.share", "per cent"),
    *[("payload.full.mass_kg", unit) for unit in ("t", "g")],
    ("payload.full.pitch_deg", "radians"),
    ("motor.swing.displacement_cm3", "l"),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "unit"), CASES, ids=[f"{path} in {unit}" for path, unit in CASES]
)
def test_another_unit_is_named_first(path: str, unit: str) -> None:
    """Refused or found odd, the first words name the key, the unit, and the number as it was."""
    node: Any = tomllib.loads(EXCAVATOR.text)
    for key in path.split("."):
        node = node[key]
    size = (OF_MPA if path.endswith("MPa") else IN)[unit]
    changed, message = with_value(EXCAVATOR, path, rounded(node, size))
    if changed is not None:
        first = findings(changed)[0]
        message = f"{first.part}: {first.words}"
    assert message.removeprefix("x.toml: ").startswith(path), message
    assert re.search(rf"looks? like (\w+ or )?{unit}", message), message
    assert re.search(r"\(line \d+\)$", message), message
    written = message.partition("write ")[2]
    numbers = [
        float(x) for x in re.findall(r"-?\d+\.?\d*(?:e[+-]\d+)?", written.partition(" (line")[0])
    ]
    meant = node if isinstance(node, list) else [node]
    assert any(
        numbers[i : i + len(meant)] == pytest.approx(meant, rel=1e-4) for i in range(len(numbers))
    ), message


def test_all_of_a_cylinder_in_metres() -> None:
    data = tomllib.loads(EXCAVATOR.text)["cylinder"]["stick"]
    for key in ("bore_mm", "rod_mm", "stroke_mm", "closed_length_mm"):
        data[key] /= 1000
    _, message = with_value(EXCAVATOR, "cylinder.stick", data)
    assert re.search(
        r"stick\.stroke_mm: 1\.504 and 1\.8 mm look like metres: .* write stroke_mm = 1504 and",
        message,
    )
    for pin in ("base", "rod_end"):
        data[pin]["at_mm"] = [x / 1000 for x in data[pin]["at_mm"]]
    _, message = with_value(EXCAVATOR, "cylinder.stick", data)
    assert re.search(
        r"cylinder\.stick: its lengths and pins look like metres: .*write all of its lengths"
        r" in mm",
        message,
    )


def test_a_cylinder_too_long_for_its_pins_is_not_in_metres() -> None:
    """1.66 m closed where the pins are up to 1.46 m apart: as metres it would be longer than any
    machine.
    """
    new = Machine.from_text(template.new("x"), "", Path("x.toml"))
    with pytest.raises(ad.ArmDesignError, match=r"never within \[1\.6600, ") as caught:
        new.replace({"cylinder.stick.closed_length_mm": 1660.0})
    assert "metres" not in str(caught.value)


@pytest.mark.parametrize(
    ("table", "path"),
    [
        ("[lift_chart]\nat_mm = [{}]", "lift_chart.at_mm"),
        (
            "[stability]\nmass_kg = 15000\nfront_mm = 1800\nrear_mm = 1800\nat_mm = [{}]",
            "stability.at_mm",
        ),
    ],
)
def test_a_point_whose_table_names_no_link(table: str, path: str) -> None:
    """Judged beside the largest link: plausible in millimetres, and in metres not."""
    for point, odd in (("0.0, 0.0, 400.0", False), ("0.0, 0.0, 0.4", True)):
        changed = f"{EXCAVATOR.text}\n{table.format(point)}\n"
        machine = Machine.from_text(changed, EXCAVATOR.urdf_text, EXCAVATOR.source)
        found = [finding for finding in findings(machine) if path in finding.part]
        assert bool(found) == odd


def scaled_urdf(urdf: str, factor: float) -> str:
    def times(match: re.Match[str]) -> str:
        return f'{match[1]}{" ".join(repr(factor * float(x)) for x in match[2].split())}"'

    return re.sub(r'(<origin xyz=")([^"]*)"', times, urdf)


@pytest.mark.parametrize("name", ["excavator_20t", "mini_excavator_2t", "patu_boom", "paper_1dof"])
def test_a_urdf_in_millimetres(name: str) -> None:
    """Refused where a cylinder's pins are then too far apart; else the first that looks odd."""
    machine = machines.named(name)
    urdf = scaled_urdf(machine.urdf_text, 1000)
    try:
        changed = Machine.from_text(machine.text, urdf, Path("x.toml"))
    except ad.ArmDesignError as error:
        message = str(error)
    else:
        if name == "paper_1dof":  # its URDF has no lengths: there is nothing wrong with it
            return
        message = f"{findings(changed)[0].part}: {findings(changed)[0].words}"
    assert message.startswith(
        f"{machine.section.urdf}: its lengths look like millimetres beside the cylinders' lengths"
    )


def changed_joint(urdf: str, joint: str, pattern: str, new: Any) -> str:
    text, count = re.subn(
        rf'(<joint name="{joint}".*?){pattern}', new, urdf, count=1, flags=re.DOTALL
    )
    assert count == 1
    return text


DRIVEN = [
    (n, j)
    for n in ("excavator_20t", "loader_crane", "mini_excavator_2t", "patu_boom")
    for j in machines.named(n).joints
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "joint"), DRIVEN)
def test_limits_in_degrees(name: str, joint: str) -> None:
    machine = machines.named(name)
    at = machine.arm.joints[machine.joints.index(joint)]
    if not at.revolute:
        return
    low, high = at.lower / deg, at.upper / deg
    new = rf'\g<1>lower="{low:.6f}" upper="{high:.6f}"'
    urdf = changed_joint(machine.urdf_text, joint, 'lower="[^"]*" upper="[^"]*"', new)
    try:
        first = findings(Machine.from_text(machine.text, urdf, Path("x.toml")))[0]
        message = f"{first.part}: {first.words}"
    except ad.ArmDesignError as error:
        message = str(error)
    assert f"joint {joint}: limits [{low:g}, {high:g}] rad look like degrees" in message
    words = re.search(r'write lower="(\S+)" upper="(\S+)"', message)
    assert words
    assert [float(words[1]), float(words[2])] == pytest.approx([at.lower, at.upper], abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "joint"), DRIVEN)
def test_a_reversed_axis(name: str, joint: str) -> None:
    """Named first, with the axis that is right and its line, whether the machine can be used or
    not.
    """
    machine = machines.named(name)
    axis = re.search(rf'<joint name="{joint}".*?<axis xyz="([^"]*)"', machine.urdf_text, re.DOTALL)
    assert axis
    other = " ".join(f"{-float(x) + 0.0:g}" for x in axis[1].split())
    urdf = changed_joint(
        machine.urdf_text, joint, f'<axis xyz="{axis[1]}"', rf'\g<1><axis xyz="{other}"'
    )
    line = (
        urdf[: re.search(rf'<joint name="{joint}".*?<axis', urdf, re.DOTALL).end()].count("\n") + 1
    )  # type: ignore[union-attr]
    try:
        first = findings(Machine.from_text(machine.text, urdf, Path("x.toml")))[0]
        message = f"{first.part}: {first.words}"
    except ad.ArmDesignError as error:
        message = str(error)
    assert (
        f"joint {joint}: its axis ({other}) looks reversed: with ({axis[1]}) the strokes fit its"
        " limits" in message
    )
    assert f'write <axis xyz="{axis[1]}"/>' in message
    assert message.endswith(f"(line {line})")


@pytest.mark.parametrize("links", [False, True], ids=["URDF", "[links]"])
@pytest.mark.parametrize("name", ["excavator_20t", "mini_excavator_2t", "loader_crane"])
def test_a_knee_on_the_wrong_side(name: str, links: bool) -> None:
    """Named with the right one and its line, whether the machine can be used or not; an axis that
    is right is not blamed.
    """
    machine = with_links(machines.named(name)) if links else machines.named(name)
    text = machine.text.replace('knee = "left"', 'knee = "right"')
    line = text[: text.index("knee =")].count("\n") + 1
    try:
        changed = Machine.from_text(text, "" if links else machine.urdf_text, Path("x.toml"))
        message = "\n".join(f"{one.part}: {one.words}" for one in findings(changed))
    except ad.ArmDesignError as error:
        message = str(error)
    assert 'four_bar.knee: "right" looks like the wrong side: with "left" the strokes' in message
    assert 'write knee = "left"' in message
    assert f"(line {line})" in message
    assert "reversed" not in message


def test_limits_of_a_slide_in_millimetres() -> None:
    """In the line of the URDF where they stand, and nothing else is blamed for what follows from
    them.
    """
    urdf = changed_joint(CRANE.urdf_text, "extension", 'upper="[^"]*"', r'\g<1>upper="1550"')
    line = urdf[: urdf.index('upper="1550"')].count("\n") + 1
    (suspicion,) = suspected(Machine.from_text(CRANE.text, urdf, Path("x.toml")))
    assert suspicion.part == "joint extension"
    assert "limits [0, 1550] m look like millimetres" in suspicion.words
    assert f'upper="1.55" (line {line})' in suspicion.words


def test_other_angles_of_the_urdf() -> None:
    urdf = EXCAVATOR.urdf_text.replace(
        '<origin xyz="0.769 0 0.222" rpy="0 0 0"/>', '<origin xyz="0.769 0 0.222" rpy="0 90 0"/>'
    )
    first = findings(Machine.from_text(EXCAVATOR.text, urdf, Path("x.toml")))[0]
    assert first.part == "link stick"
    assert first.words.startswith('rpy="0 90 0" looks like degrees: write rpy="0 1.5708 0" (line ')
    first = findings(EXCAVATOR.replace({"frozen.swing": 90}))[0]
    assert (first.part, first.words) == (
        "frozen.swing",
        "90 rad looks like degrees: write 1.5708 (line 8)",
    )


def test_inertia_and_mass_that_do_not_go_together() -> None:
    """Masses in t, inertias in kg m² (the radius of gyration grows √1000-fold); or inertias in kg
    mm².
    """
    tonnes = re.sub(
        r'mass value="(\d+)"', lambda m: f'mass value="{float(m[1]) / 1000}"', EXCAVATOR.urdf_text
    )
    words = {
        f.part: f.words
        for f in findings(Machine.from_text(EXCAVATOR.text, tonnes, Path("x.toml")))
    }
    assert re.search(
        r"an inertia of 1364 kg m² at 1\.01 kg fits .*; the mass like t \(line \d+\)",
        words["link stick"],
    )
    mini = machines.named("mini_excavator_2t")
    drawn = re.sub(
        r'(i[xyz]{2})="([^"]+)"', lambda m: f'{m[1]}="{1e6 * float(m[2])!r}"', mini.urdf_text
    )
    words = {
        f.part: f.words for f in findings(Machine.from_text(mini.text, drawn, Path("x.toml")))
    }
    assert "the inertia like kg mm²" in words["link stick"]


# ---------------------------------------------------------------------------------- sound machines


def suspected(machine: Machine) -> list[Finding]:
    return inspect(machine, ad.Workspace.grid(machine, 3)).suspicions


def test_no_sound_machine_is_suspected(machine: Machine) -> None:
    """All of the test suite: shipped, odd, random."""
    assert suspected(machine) == []


@pytest.mark.parametrize("links", [1, 2, 3, 4, 5, 6])
def test_no_new_machine_is_suspected(links: int) -> None:
    assert suspected(Machine.from_text(template.new("x", links=links), "", Path("x.toml"))) == []


@pytest.mark.slow
@pytest.mark.parametrize("length", [0.1, 0.3, 4.0])
@pytest.mark.parametrize("name", sorted(shipped()))
def test_no_copy_of_another_size_is_suspected(name: str, length: float) -> None:
    """Laboratory models and mining shovels, of the same mass or of the same density."""
    for mass in (1.0, length**3):
        assert suspected(scaled(machines.named(name), length=length, mass=mass)) == []


@pytest.mark.parametrize("length", [0.03, 0.1])
@pytest.mark.parametrize("name", ["mini_excavator_2t", "loader_crane"])
def test_no_small_pump_is_suspected(name: str, length: float) -> None:
    """Flows of a copy that moves as its original does shrink with the squares of its lengths."""
    machine = scaled(machines.named(name), length=length, mass=length**3)
    flows = {
        path: value * length**2
        for path, value in machine_file.flat(machine.section).items()
        if path.endswith("flow_l_per_min")
    }
    assert suspected(machine.replace(flows)) == []
