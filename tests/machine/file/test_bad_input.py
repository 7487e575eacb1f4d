"""Bad input: one clear line that names file, key, value, range and remedy; nothing else, ever.

Whatever a file holds, it either loads and its map can be made (or says in the package's own words
why not), or it is refused with one line. Warnings are errors here too, and every case has a time
limit.
"""

from __future__ import annotations

import copy
import math
import re
from typing import Any

import pytest

from tests.machine.file.bad_files import (
    BARS,
    BOOM,
    DATA,
    FULL,
    TEXT,
    URDF,
    changed,
    outcome,
    paths,
    toml,
)

# --------------------------------------------------------------------------- every key of the file

OPTIONAL = {  # have a default
    *(
        "title",
        "frozen",
        "frozen.swing",
        "requirements",
        "requirements.digging",
        "requirements.digging.share",
    ),
    *(
        "requirements.pin_box_mm",
        "requirements.catalogue",
        "requirements.outline",
        "requirements.clearance",
        "fluid.entrained_air_percent",
        "fluid.density_kg_per_m3",
        "cylinder.boom.count",
    ),
    *("supply.return_pressure_bar", "payload.full.pitch_deg", "payload.empty", "payload.full"),
    *(
        f"cylinder.{name}.{key}"
        for name, table in DATA["cylinder"].items()
        for key in (
            "valve",
            "compliance_m_per_N",
            "valve.leakage_l_per_min_per_bar",
            "friction",
            *(f"friction.{key}" for key in table["friction"]),
        )
    ),
    *(
        f"requirements.{kind}.{name}{key}"
        for kind, optional in (("outline", ".pin_radius_mm"), ("clearance", ".distance_mm"))
        for name in DATA["requirements"][kind]
        for key in ("", optional)
    ),
    *("motor", "motor.swing", "motor.swing.valve", "bands", "bands.structure", "tolerances"),
    *(f"tolerances.{key}" for key in DATA["tolerances"]),
    *("motor.swing.valve.leakage_l_per_min_per_bar", "motor.swing.friction"),
    *(f"motor.swing.friction.{key}" for key in DATA["motor"]["swing"]["friction"]),
}


@pytest.mark.parametrize("path", paths())
def test_a_missing_key_is_named(path: str) -> None:
    message = outcome(changed(path, KeyError), use="")
    if path in OPTIONAL:
        assert message == ""
        return
    name = path.rpartition(".")[2]
    assert name in message
    assert re.search("missing|neither|no cylinder", message), message


@pytest.mark.parametrize("path", paths())
def test_a_misspelt_key_is_named_and_the_right_one_offered(path: str) -> None:
    leaf = path.rpartition(".")[2]
    text = toml(_renamed(path, f"{leaf[:1]}z{leaf[1:]}"))
    message = outcome(text, use="")
    named = path.split(".")
    # names of the author's own
    if len(named) == 2 and named[0] in ("cylinder", "motor", "payload", "frozen"):
        return
    if len(named) == 3 and named[:2] == ["requirements", "clearance"]:
        return
    if len(named) == 3 and named[:2] == ["requirements", "outline"]:
        assert re.search(rf'no link "{leaf[:1]}z.*did you mean "{leaf}"', message), message
        return
    wrong = f"{leaf[:1]}z{leaf[1:]}"
    assert f"{wrong}: unknown key" in message
    assert f'did you mean "{leaf}"?' in message


def _renamed(path: str, name: str) -> dict[str, Any]:
    data = copy.deepcopy(DATA)
    *tables, leaf = path.split(".")
    node = data
    for key in tables:
        node = node[key]
    node[name] = node.pop(leaf)
    return data


# One cylinder stands for all; the bucket's adds its four-bar.
DIFFERENT = [
    path for path in paths() if not re.match(r"cylinder\.(stick|bucket)\.(?!four_bar)", path)
]


ALWAYS_WRONG = [
    math.nan,
    math.inf,
    -math.inf,
    [],
    [True] * 3,
    [[1]],
    "",
    {},
    {"a": 1},
    10**400,
    [math.nan] * 3,
]


def _kind(path: str) -> Any:
    node: Any = DATA
    for key in path.split("."):
        node = node[key]
    return node


WRONG = [*ALWAYS_WRONG, True, -1e30, 1e30, "text", -1, 1.5]
FEW = [math.nan, {"a": 1}]  # every day: a number that is none, and no number


@pytest.mark.parametrize("path", DIFFERENT)
@pytest.mark.parametrize("values", [FEW, pytest.param(WRONG, marks=pytest.mark.slow)])
def test_a_value_that_cannot_be_is_refused_with_its_key(path: str, values: list[Any]) -> None:
    good = _kind(path)
    for value in values:
        message = outcome(changed(path, value), use="")
        number = (
            isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e29
        )
        plausible = isinstance(good, int | float) and number
        plausible |= isinstance(good, str) and value == "text"
        plausible |= isinstance(good, dict) and isinstance(value, dict)
        plausible |= path == "requirements.digging.cylinders" and value == []
        if not plausible:
            assert path in message, f"{value}: {message}"
            assert re.search("give|add", message), message


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [path for path in DIFFERENT if isinstance(_kind(path), int | float)]
)
def test_numbers_of_the_wrong_size(path: str) -> None:
    """Nothing, almost nothing, tenfold, negative, the largest allowed: refused or answered."""
    for value in (
        0,
        1e-30,
        1e-6,
        0.5 * _kind(path),
        10 * _kind(path),
        -_kind(path) or -1,
        99_999.0,
    ):
        message = outcome(changed(path, value), use="map" if value == 1e-6 else "modes")
        if value < 0 and path != "frozen.swing":
            assert path in message
            assert "give a number in" in message or "whole number in" in message


@pytest.mark.slow
@pytest.mark.parametrize("path", [path for path in paths() if path.endswith("at_mm")])
def test_pins_anywhere(path: str) -> None:
    for value in (
        [0, 0, 0],
        [1e5, 1e5, 1e5],
        [1e-9, 0, 0],
        [0, 500, 0],
        _kind(path)[::-1],
        [-x for x in _kind(path)],
    ):
        outcome(changed(path, value))


CASES: list[tuple[str, Any, str]] = [
    ("joints", ["boom", "boom", "bucket"], r"x\.toml: joints: a joint is named twice"),
    ("damped", 1, "damped: 1 is not allowed; give true or false"),
    ("damped", "TRUE", 'damped: "TRUE" is not allowed; give true or false'),
    ("joints", [], r"joints: \[\] is not allowed; give a list of 1 to 20"),
    (
        "joints",
        ["boom", "stick", "buckett"],
        r'joint buckett: is not in the URDF \(named in joints\); did you mean "bucket"\?',
    ),
    (
        "joints",
        ["boom", "stick", "bucket", "boom_foot"],
        r"joint boom_foot: is fixed and cannot be a coordinate",
    ),
    ("joints", ["payload"], r'"payload" is a column of the CSV'),
    ("joints", ["damping"], r'"damping" is a column of the CSV'),
    ("joints", ["boom_extension"], r'"boom_extension" is a column of the CSV'),
    ("frozen", {"boom_foot": 0.1}, r"joint boom_foot: is fixed in the URDF and cannot be frozen"),
    ("frozen", {"nothing": 0.1}, r"joint nothing: is not in the URDF"),
    ("tool.link", "bukket", r'tool\.link: no link "bukket" in the URDF; did you mean "bucket"\?'),
    ("payload", {}, r"payload: an empty table"),
    (
        "payload.full.link",
        "spoon",
        r'payload\.full\.link: no link "spoon" in the URDF; choose from',
    ),
    ("payload.full.link", KeyError, r"payload\.full\.link: missing: a mass must sit somewhere"),
    ("payload.full.at_mm", KeyError, r"payload\.full\.at_mm: missing: a mass must sit somewhere"),
    (
        "payload.full.mass_kg",
        -1,
        r"payload\.full\.mass_kg: -1 is not allowed; give a number in \[0, 1e\+06\] kg",
    ),
    ("payload.full.pitch_deg", [240, 120], r"payload\.full\.pitch_deg: \[240, 120\] deg is empty"),
    ("payload.full.pitch_deg", [120, 120], r"pitch_deg: \[120, 120\] deg is empty"),
    ("payload.full.pitch_deg", [-350, 350], r"pitch_deg: .* within one turn"),
    (
        "payload.empty",
        {"mass_kg": 0, "pitch_deg": [0, 10]},
        r"payload\.empty\.link: missing: pitch_deg needs a link",
    ),
    (
        "payload",
        {"full": {**FULL, "link": "chassis"}},
        (
            r"payload\.full\.pitch_deg: link chassis has that pitch at no pose of the workspace;"
            r" widen"
        ),
    ),
    ("payload", {"a b": {"mass_kg": 0}}, r"payload\.a b: is not a usable name"),
    (
        "supply.return_pressure_bar",
        350,
        r"return_pressure_bar: 350 bar is not below the supply's 350 bar",
    ),
    ("cylinder", {}, r"cylinder: an empty table"),
    (
        "cylinder.boom",
        KeyError,
        r'clearance\.frame\.cylinders: no cylinder "boom"; choose from: s',
    ),
    (
        "cylinder.boom.count",
        10**9,
        r"count: 1000000000 is not allowed; give a whole number in \[1, 16\]",
    ),
    (
        "cylinder.boom.rod_mm",
        120,
        r"rod_mm: 120 mm does not fit the bore; give a rod in \(0, 120\) mm",
    ),
    (
        "cylinder.boom.stroke_mm",
        -1,
        r"stroke_mm: -1 is not allowed; give a number in \(0, 100000\] mm",
    ),
    (
        "cylinder.boom.closed_length_mm",
        9000,
        r"stroke_mm: over joint .*boom.* apart, never within \[9\.0000, 10\.2600\] m",
    ),
    (
        "cylinder.boom.closed_length_mm",
        5,
        r"stroke_mm: over joint .* never within \[0\.0050, 1\.2650\] m; change",
    ),
    ("cylinder.boom.rod_end", BOOM["base"], r"cylinder\.boom: no joint lies between its pins"),
    ("cylinder.boom.rod_end", KeyError, r"rod_end: neither rod_end nor four_bar given"),
    (
        "cylinder.boom.base.link",
        "chasis",
        r'base\.link: no link "chasis" in the URDF; did you mean "chassis"\?',
    ),
    (
        "cylinder.boom.base.at_mm",
        [0, 0, 0],
        r"cylinder\.boom: .*dead centre .*singular pose.*; move its pins",
    ),
    (
        "cylinder.boom.hose",
        {"cap_l": 7},
        r"hose\.cap_l: 7 l exceeds the dead volume; give a volume in \[0, 5\.6\] l",
    ),
    (
        "cylinder.boom.friction",
        {"coulomb_N": 9, "static_N": 5},
        r"static_N: 5 N is below the Coulomb friction",
    ),
    ("cylinder.bucket.rod_end", BOOM["rod_end"], r"rod_end: both rod_end and four_bar given"),
    (BARS + "rocker_mm", 5000, r"cylinder\.bucket\.four_bar: does not close at any"),
    (BARS + "coupler_mm", 1, r"cylinder\.bucket\.four_bar: (does not close|opens) at"),
    (
        BARS + "rocker_mm",
        868.05,
        r"cylinder\.bucket\.four_bar: opens at .bucket. = 3\d\.\d°, before stroke",
    ),
    (BARS + "knee", "up", r'knee: "up" is not allowed; give one of "left", "right"'),
    (
        BARS + "pivot.link",
        "boom",
        r"four_bar: pivot and lug are not on the two links of one revolute joint",
    ),
    (BARS + "lug.at_mm", [0, 0, 0], r"cylinder\.bucket: .*dead centre"),
    (
        "requirements.digging.cylinders",
        ["spade"],
        r'digging\.cylinders: no cylinder "spade"; choose from: boom, stick',
    ),
    (
        "requirements.end_margin",
        0.5,
        r"end_margin: 0\.5 is not allowed; give a number in \[0, 0\.5\)",
    ),
    (
        "requirements.catalogue",
        "own.csv",
        r'"iso", "5mm"; sizes of your own go with a command: --catalogue "own\.csv"',
    ),
    ("urdf", "..", r'urdf: "\.\." is not a file name'),
    ("name", "../up", r'name: "\.\./up" is not allowed; give a text of letters a to z, digits'),
    ("name", "x" * 65, r"name: .* is not allowed; give a text .* _ and -, at most 64 characters"),
    ("title", "x" * 201, r"title: .* is not allowed; give a text of at most 200 characters"),
]


@pytest.mark.parametrize(
    ("path", "value", "message"), CASES, ids=[f"{p}={str(v)[:20]}" for p, v, _ in CASES]
)
def test_what_is_wrong_is_said(path: str, value: Any, message: str) -> None:
    assert re.search(message, outcome(changed(path, value), use="map"))


def test_dead_centre_inside_the_range() -> None:
    """Base pin, joint and rod pin in line near the middle of the range: a stroke long enough
    reaches that pose.
    """
    boom = {
        **BOOM,
        "base": {"link": "chassis", "at_mm": [-2000, 0, -800]},
        "closed_length_mm": 1000,
        "stroke_mm": 4000,
    }
    message = outcome(changed("cylinder.boom", boom))
    assert re.search(r"x\.toml: cylinder\.boom: .*dead centre at .boom. = -?\d.*singular", message)


def test_pins_that_meet() -> None:
    """Base and rod-end pin in one place at some pose of the range: the length is 0 and has no
    derivative there.
    """
    pin = [1000, 0, 0]
    boom = {
        **BOOM,
        "base": {"link": "chassis", "at_mm": pin},
        "rod_end": {"link": "boom", "at_mm": pin},
    }
    assert "dead centre" in outcome(
        changed("cylinder.boom", {**boom, "closed_length_mm": 1e-9, "stroke_mm": 1e5})
    )
    assert "never within" in outcome(changed("cylinder.boom", boom)) or not outcome(
        changed("cylinder.boom", boom)
    )


def test_two_cylinders_that_exclude_each_other() -> None:
    """Each has room alone, both together none: neither's numbers are wrong, so both are named."""
    short = {**BOOM, "stroke_mm": 300}
    long = {**BOOM, "closed_length_mm": 2500, "stroke_mm": 500}
    message = outcome(changed("cylinder", {**DATA["cylinder"], "boom": short, "second": long}))
    assert "are the cylinders boom, second in stroke together" in message


def test_a_joint_that_nothing_moves() -> None:
    """Its cylinder is gone, and with it every requirement that named it."""
    data = copy.deepcopy(DATA)
    del data["cylinder"]["boom"], data["requirements"]
    assert 'joints: no cylinder or motor moves "boom"' in outcome(toml(data))


def test_massless_link_under_an_empty_load_case() -> None:
    bare = re.sub(
        r'(<link name="bucket">\s*)<inertial>.*?</inertial>', r"\1", URDF, flags=re.DOTALL
    )
    assert re.match(
        r"x\.toml: payload\.empty: .*a joint moves no mass", outcome(TEXT, bare, use="map")
    )
