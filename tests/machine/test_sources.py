"""Every number of a shipped machine has its source in SOURCE.md, and known deviations are true."""

from __future__ import annotations

import re
import tomllib
import xml.etree.ElementTree as ET
from fnmatch import fnmatchcase

import pytest
from numpy.testing import assert_allclose

from tests import machines
from tests.machine.shipped_facts import (
    EXCAVATORS,
    FACTS,
    REAL,
    SHIPPED,
    digging,
    loading_height,
    reach_at_ground,
    source_text,
    tool_positions,
)


def table(name: str, heading: str) -> list[list[str]]:
    """Rows of the tables under a heading of SOURCE.md, split into cells."""
    section = source_text(name).split(f"## {heading}\n")[1].split("\n## ")[0]
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section.splitlines()
        if line.startswith("|") and not line.startswith("|---")
    ]


def numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text)]


def leaves(tree: object, path: str = "") -> list[tuple[str, list[float]]]:
    """Key path and numbers of every entry of a machine file."""
    if isinstance(tree, dict):
        return [
            leaf
            for key, value in tree.items()
            for leaf in leaves(value, f"{path}.{key}" if path else key)
        ]
    values = tree if isinstance(tree, list) else [tree]
    return [
        (
            path,
            [float(x) for x in values if isinstance(x, int | float) and not isinstance(x, bool)],
        )
    ]


def patterns(cell: str) -> list[str]:
    """Key paths that a table's first cell names: `cylinder.*.bore_mm`, `rod_mm`; … stands for what
    is left out.
    """
    names = [word.replace("….", "*.") for word in re.findall(r"`([^`]+)`", cell)]
    first = names[0].rpartition(".")[0] if names else ""
    return [word if i == 0 or "." in word else f"{first}.{word}" for i, word in enumerate(names)]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_number_of_the_machine_file_has_its_source(name: str) -> None:
    rows = [(patterns(row[0]), numbers(row[1])) for row in table(name, "Machine file")]
    data = tomllib.loads(machines.named(name).text)
    lost = []
    for path, values in leaves(data):
        stated = [
            number
            for keys, given in rows
            if any(fnmatchcase(path, key) or fnmatchcase(path, f"{key}.*") for key in keys)
            for number in given
        ]
        lost += [f"{path} = {value:g}" for value in values if value not in stated]
    lost += [  # corners of polygons: a row for all of them
        path
        for path, _ in leaves(data)
        if path.endswith(".points_mm")
        and not any(fnmatchcase(path, key) for keys, _ in rows for key in keys)
    ]
    assert lost == []


@pytest.mark.parametrize("name", SHIPPED)
def test_every_number_of_the_urdf_has_its_source(name: str) -> None:
    """Masses, centres of mass, inertias, frames and limits; kilo-units in the table stand for
    units in the URDF.
    """
    robot = ET.fromstring(machines.named(name).urdf_text)
    stated = {abs(number) for row in table(name, "URDF") for number in numbers(" ".join(row[1:]))}
    stated |= {1e3 * number for number in stated} | {0.0}
    used: list[tuple[str, str]] = []
    for link in robot.findall("link/inertial"):
        used += [("mass", str(mass.get("value"))) for mass in link.findall("mass")]
        used += [
            ("inertia", value)
            for inertia in link.findall("inertia")
            for value in inertia.attrib.values()
        ]
        used += [
            ("centre", x)
            for origin in link.findall("origin")
            for x in str(origin.get("xyz")).split()
        ]
    for joint in robot.findall("joint"):
        used += [
            (str(joint.get("name")), value)
            for limit in joint.findall("limit")
            for value in limit.attrib.values()
        ]
        used += [
            (str(joint.get("name")), x)
            for o in joint.findall("origin")
            for x in str(o.get("xyz")).split()
        ]
    assert [pair for pair in used if abs(float(pair[1])) not in stated] == []


def known(name: str) -> dict[str, float]:
    """What the tables of known deviations speak of, as computed [m, kN, kg]."""
    machine, tool = machines.named(name), tool_positions(name)
    facts = {
        "largest reach at ground level": reach_at_ground(name),
        "largest reach": tool[:, 0].max(),
        "largest height": tool[:, 2].max(),
        "largest cutting height": tool[:, 2].max(),
        "largest depth": -tool[:, 2].min(),
        "largest digging depth": -tool[:, 2].min(),
        "lowest tip": tool[:, 2].min(),
    }
    if name in EXCAVATORS:
        forces = digging(name)
        facts["loading height"] = loading_height(name)
        facts |= {f"{cylinder} digging force": forces[cylinder][0] for cylinder in forces}
    if name == "excavator_20t":
        facts["operating weight"] = FACTS[name].mass
    arms = FACTS[name].moment_arms
    facts["moment arm of the cylinder"] = facts["moment arm of the lift cylinder"] = arms.get(
        "lift", (0.0,)
    )[0]
    facts["moment arm of the tilt cylinder"] = arms.get("tilt", (0.0,))[0]
    lift = machine.supply.pressure * machine.cylinders[0].bore_area * next(iter(arms.values()))[1]
    return facts | {"lifting torque": lift / 1e3}


@pytest.mark.parametrize("name", REAL)
def test_known_deviations_are_what_the_machine_gives(name: str) -> None:
    """Ours as printed within 1 % (extremes are sampled); the difference from each sheet within one
    per cent point.
    """
    computed = known(name)
    header, *rows = table(name, "Known deviations")
    ours = header.index("this machine")
    for row in rows:
        key = max((k for k in computed if row[0].startswith(k)), key=len)
        assert numbers(row[ours])[0] == pytest.approx(computed[key], rel=0.01, abs=0.006), row[0]
        if "difference" in header:
            sheets = [float(x) for x in re.findall(r"(\d+(?:\.\d+)?) (?:m|kN|kg)\b", row[1])]
            percents = numbers(row[header.index("difference")].replace("+", ""))
            assert len(sheets) == len(percents) > 0, row[0]
            differences = [100 * (computed[key] / sheet - 1) for sheet in sheets]
            assert_allclose(percents, differences, rtol=0, atol=1.3, err_msg=row[0])
