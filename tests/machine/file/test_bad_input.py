"""Bad input: one clear line that names file, key, value, range and remedy; nothing else, ever.

Whatever a file holds, it either loads and its map can be made (or says in the package's own words
why not), or it is refused with one line. Warnings are errors here too, and every case has a time
limit.
"""

from __future__ import annotations

import contextlib
import copy
import json
import math
import random
import re
import signal
import time
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.machine.machine import Machine
from tests import machines

EXCAVATOR = machines.named("excavator_20t")
TEXT, DATA = EXCAVATOR.text, tomllib.loads(EXCAVATOR.text)
SLOWEST = 2.0  # [s] of processor time per case


def _bare(urdf: str) -> str:
    """Without visuals, so that random damage meets what matters."""
    robot = ET.fromstring(urdf)
    for link in robot.findall("link"):
        for part in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(part)
    return ET.tostring(robot, encoding="unicode")


URDF = _bare(EXCAVATOR.urdf_text)


def outcome(text: str, urdf: str = URDF, use: str = "modes") -> str:
    """The message with which a machine is refused, or "" if it loads and answers; anything else
    fails the test.

    ``use``: whether the loaded machine then gives its "modes" on a coarse grid, a whole "map", or
    nothing.
    """
    start, loaded = time.process_time(), False
    message = ""
    try:
        machine = Machine.from_text(text, urdf, Path("x.toml"))
        loaded = True
        answers(machine, use)
    except ad.ArmDesignError as error:
        message = str(error)
        assert_clear(message)
        if not loaded:
            assert message.startswith(("x.toml", DATA["urdf"])), message
            assert "; " in message, f"no remedy: {message}"
    assert time.process_time() - start < SLOWEST
    return message


def answers(machine: Machine, use: str) -> None:
    """Ask for the modes on a coarse grid, a whole map, or nothing."""
    if use == "map":
        found = ad.frequency_map(machine, ad.Workspace.grid(machine, points=2))
        assert math.isfinite(found.worst.frequency)
    elif use == "modes":
        space = ad.Workspace.grid(machine, points=2)
        for payload in machine.payloads:
            modes = ad.natural_modes(machine.with_payload(payload.name).at(space.rigid))
            assert np.isfinite(modes.frequencies).all()


def assert_clear(message: str) -> None:
    assert message
    assert "\n" not in message
    assert len(message) < 700, message
    assert "Traceback" not in message
    assert not re.search(r"\{\w*\}|<class |<function |object at 0x", message), message


def toml(data: Any) -> str:
    """TOML of a file's data, as inline tables; at the top level one line per key."""
    return "".join(f"{json.dumps(key)} = {_inline(value)}\n" for key, value in data.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{"
            + ", ".join(f"{json.dumps(key)} = {_inline(item)}" for key, item in value.items())
            + "}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)


def changed(path: str, value: Any) -> str:
    """The excavator's file with one key path set, or removed where the value is `KeyError`."""
    data = copy.deepcopy(DATA)
    *tables, leaf = path.split(".")
    node = data
    for key in tables:
        node = node.setdefault(key, {})
    if value is KeyError:
        node.pop(leaf)
    else:
        node[leaf] = value
    return toml(data)


def paths(data: dict[str, Any] = DATA, start: str = "") -> list[str]:
    """All key paths of the file, tables and leaves."""
    found = []
    for key, value in data.items():
        found.append(start + key)
        if isinstance(value, dict):
            found += paths(value, f"{start}{key}.")
    return found


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
        "fluid.entrained_air_percent",
        "fluid.density_kg_per_m3",
        "cylinder.boom.count",
    ),
    *("supply.return_pressure_bar", "payload.full.pitch_deg", "payload.empty", "payload.full"),
    *(f"cylinder.{name}.valve" for name in DATA["cylinder"]),
    *("motor", "motor.swing", "motor.swing.valve"),
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


@pytest.mark.parametrize("path", DIFFERENT)
def test_a_value_that_cannot_be_is_refused_with_its_key(path: str) -> None:
    good = _kind(path)
    for value in [*ALWAYS_WRONG, True, -1e30, 1e30, "text", -1, 1.5]:
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


# ------------------------------------------------------------------------ one thing wrong, by name

BOOM, BUCKET = DATA["cylinder"]["boom"], DATA["cylinder"]["bucket"]
FULL = DATA["payload"]["full"]
BARS = "cylinder.bucket.four_bar."
CASES: list[tuple[str, Any, str]] = [
    ("joints", ["boom", "boom", "bucket"], r"x\.toml: joints: a joint is named twice"),
    ("joints", [], r"joints: \[\] is not allowed; give a list of at least 1"),
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
    ("cylinder.boom", KeyError, r'joints: no cylinder or motor moves "boom"'),
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
        r"cylinder\.bucket\.four_bar: opens at .bucket. = 0\.6\d+ rad, before stroke",
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
    ("urdf", "..", r'urdf: "\.\." is not a file name'),
    ("name", "../up", r'name: "\.\./up" is not allowed; give a text of letters, digits'),
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


def test_massless_link_under_an_empty_load_case() -> None:
    bare = re.sub(
        r'(<link name="bucket">\s*)<inertial>.*?</inertial>', r"\1", URDF, flags=re.DOTALL
    )
    assert re.match(
        r"x\.toml: payload\.empty: .*a joint moves no mass", outcome(TEXT, bare, use="map")
    )


# ---------------------------------------------------------------------------------------- the URDF

URDF_CASES = [
    ("", "not well-formed XML"),
    ("<html/>", "the XML root is <html>, not <robot>"),
    ('<robot xmlns="http://a"/>', "not <robot>"),
    ("<robot/>", "joint .* is not in the URDF \\(named in joints\\); choose from: none"),
    (URDF.replace('link="boom"', 'link="bom"'), 'link "bom" does not exist; did you mean "boom"'),
    (URDF.replace('<child link="boom" />', ""), 'joint boom: has no child; add <child link="…"/>'),
    (URDF.replace('link name="stick"', 'link name="boom"'), 'two links are named "boom"'),
    (URDF.replace('joint name="stick"', 'joint name="boom"'), 'two joints are named "boom"'),
    (
        URDF.replace('<parent link="chassis" />', '<parent link="bucket" />'),
        "not connected to the root",
    ),
    (
        URDF.replace('name="stick" type="revolute"', 'name="stick" type="floating"'),
        'type "floating" cannot be used',
    ),
    (
        URDF.replace('name="bucket" type="revolute"', 'name="bucket" type="prismatic"'),
        "one revolute joint",
    ),
    (
        URDF.replace('lower="-2.71404"', 'lower="5"'),
        r"joint stick: limits \[5, -0\.5801\] are empty",
    ),
    (
        URDF.replace('lower="-2.71404"', 'lower="nan"'),
        'joint stick: lower="nan" is not 1 finite number',
    ),
    (URDF.replace('effort="600000"', 'effort="-1"'), "joint boom: effort -1 is negative"),
    (
        URDF.replace('mass value="1010"', 'mass value="-1010"'),
        "link stick: mass -1010 kg is negative",
    ),
    (URDF.replace("<limit", "<limitt"), "has no <limit>"),
    (re.sub(r'axis xyz="[^"]*"', 'axis xyz="0 0 0"', URDF), "the axis has no length"),
    (re.sub(r'ixx="[^"]*"', 'ixx="-5"', URDF), "no body has principal inertias"),
    (re.sub(r"<inertia [^>]*>", "", URDF), "<inertial> lacks <mass> or <inertia>"),
    (
        URDF.replace('<parent link="boom" />', '<parent link="boom" /><mimic joint="boom"/>'),
        "mimics another joint",
    ),
]


@pytest.mark.parametrize(
    ("urdf", "message"), URDF_CASES, ids=[message[:30] for _, message in URDF_CASES]
)
def test_what_is_wrong_in_the_urdf_is_said(urdf: str, message: str) -> None:
    assert re.search(message, outcome(TEXT, urdf))


def test_entities_do_not_explode() -> None:
    """Ten to the ninth characters from nine short lines."""
    lines = ['<!ENTITY a "aaaaaaaaaa">']
    lines += [f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise("abcdefghi")]
    assert outcome(TEXT, f'<!DOCTYPE r [{"".join(lines)}]><robot name="&i;"/>')


# ----------------------------------------------------------------------------------- the TOML text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"x\.toml: name: missing; add name.*7 more"),
        ("# nothing\n", r"x\.toml: name: missing"),
        ("name = ", r"not valid TOML: Invalid value"),
        (TEXT + "\n[fluid]\n", r"not valid TOML: .*fluid.*twice.*line \d+"),
        ("a = " + "[" * 5000 + "]" * 5000, "not valid TOML"),
        ("a = " + "1" * 10_000, "not valid TOML"),
        (".".join(["a"] * 3000) + " = 1", "a: unknown key"),
        ("\0" * 10, "not valid TOML"),
        (URDF, "not valid TOML: .*; give the .toml file that names the URDF"),
    ],
)
def test_text_that_is_no_machine_file(text: str, message: str) -> None:
    assert re.search(message, outcome(text))


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    def refused(path: Any) -> str:
        with pytest.raises(ad.ArmDesignError) as caught:
            ad.load(path)
        assert_clear(str(caught.value))
        return str(caught.value)

    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    assert re.search(
        r"binary\.toml: is not UTF-8 text; save it as UTF-8", refused(tmp_path / "binary.toml")
    )
    assert "holds no" in refused(tmp_path)
    (tmp_path / "folder.toml").mkdir()
    assert "holds no" in refused(tmp_path / "folder.toml")
    assert "no such file" in refused(tmp_path / "none.toml")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    assert "cannot be read" in refused(tmp_path / "loop.toml")
    for name, urdf in {
        "a": "none.urdf",
        "b": ".",
        "c": "binary.toml",
        "d": "a\\u0000b",
        "e": "a\\nb",
    }.items():
        (tmp_path / f"{name}.toml").write_text(
            TEXT.replace(DATA["urdf"], urdf, 2), encoding="utf-8"
        )
        refused(tmp_path / f"{name}.toml")
    (tmp_path / "f.toml").write_text(TEXT.replace(DATA["urdf"], "missing.urdf"), encoding="utf-8")
    assert re.search(r'f\.toml: urdf: "missing\.urdf": no such file', refused(tmp_path / "f.toml"))
    assert 'did you mean "excavator_20t"' in refused("excavater_20t")
    for path in (
        "",
        "x" * 5000,
        "a\0b",
        "/",
        None,
        5,
        b"excavator_20t",
        ["excavator_20t"],
        "/proc/self/mem",
    ):
        refused(path)


# ----------------------------------------------------------------------------------- random damage

LETTERS = "0123456789.-e[]{}\"'=#<>/ \x00é\t"
NUMBERS = [
    "0",
    "-1",
    "1e30",
    "1e-30",
    "nan",
    "1e9",
    "1e-9",
    "inf",
    "1e400",
    "1_0",
    '"x"',
    "-0.0",
    "true",
    "[]",
    "",
]
NUMBER, WORD = r"-?\d+\.?\d*(?:e-?\d+)?", r"[\w.-]+"
QUOTED, ATTRIBUTE, ELEMENT = r'"[^"\n]*"', r' \w+="[^"]*"', r"<(\w+)[^<>]*/>"
SMALL = ("excavator_20t", "loader_crane", "mini_excavator_2t", "patu_boom", "spatial")
PER_MACHINE = 200  # times the machines: a thousand files, and a thousand URDFs


def _one_of(pattern: str, text: str, chance: random.Random) -> tuple[int, int]:
    """Where a random match starts and ends; a random place where there is none."""
    found = [match.span() for match in re.finditer(pattern, text)]
    i = chance.randrange(max(len(text), 1))
    return chance.choice(found or [(i, i)])


def _characters(text: str, chance: random.Random) -> str:
    i = chance.randrange(max(len(text), 1))
    j = i + chance.choice([1, 1, 2, 5, 30])
    return (
        text[:i]
        + chance.choice(["", text[i:j] * 2, text[i:j][::-1], chance.choice(LETTERS)])
        + text[j:]
    )


def _lines(text: str, chance: random.Random) -> str:
    """One deleted, doubled elsewhere, or two swapped; in XML on one line the elements are the
    lines.
    """
    glue = "\n" if text.count("\n") > 5 else ">"
    lines = text.split(glue)
    a, b = chance.randrange(len(lines)), chance.randrange(len(lines))
    kind = chance.randrange(3)
    if kind == 0:
        del lines[a]
    elif kind == 1:
        lines.insert(b, lines[a])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return glue.join(lines)


def _number(text: str, chance: random.Random) -> str:
    start, end = _one_of(NUMBER, text, chance)
    new = chance.choice([*NUMBERS, f"-{text[start:end]}", f"{text[start:end]}0"])
    return text[:start] + new + text[end:]


def _token(text: str, chance: random.Random) -> str:
    """A word deleted, or two words exchanged."""
    return (
        _exchanged(WORD, text, chance) if chance.random() < 0.5 else _without(WORD, text, chance)
    )


def _without(pattern: str, text: str, chance: random.Random) -> str:
    start, end = _one_of(pattern, text, chance)
    return text[:start] + text[end:]


def _exchanged(pattern: str, text: str, chance: random.Random) -> str:
    (a, b), (c, d) = sorted(_one_of(pattern, text, chance) for _ in range(2))
    return text if b > c else text[:a] + text[c:d] + text[b:c] + text[a:b] + text[d:]


def _link(text: str, chance: random.Random) -> str:
    """A quoted name, mostly that of a link or joint, in the place of another."""
    return _exchanged(QUOTED, text, chance)


def _structure(text: str, chance: random.Random) -> str:
    """An attribute or a whole element out of a URDF; a key's value, a table's head out of a
    machine file.
    """
    patterns = (
        [ATTRIBUTE, ELEMENT]
        if "<robot" in text
        else [r"(?m)= .*$", r"(?m)^\[.*\]$", r"(?m)^\w+ *= .*$"]
    )
    return _without(chance.choice(patterns), text, chance)


WOUNDS = (_characters, _lines, _number, _number, _token, _link, _structure)


def damaged(text: str, chance: random.Random) -> str:
    """One to four random wounds."""
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        text = chance.choice(WOUNDS)(text, chance)
    return text


def damaged_bytes(text: str, chance: random.Random) -> bytes:
    """As ``damaged``; every tenth has some bytes overwritten instead, which then seldom are
    UTF-8.
    """
    if chance.random() > 0.1:
        return damaged(text, chance).encode()
    found = bytearray(text.encode())
    for _ in range(chance.choice([1, 3])):
        found[chance.randrange(len(found))] = chance.randrange(256)
    return bytes(found)


@contextlib.contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Break off what takes more processor time than that."""

    def late(*_: object) -> None:
        raise AssertionError(f"takes longer than {seconds} s")

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def asked(path: Path, use: str) -> str:
    """The message with which a file is refused, by reading it or by asking the machine; "" if it
    answers.
    """
    folder, loaded = str(path.parent), False
    with no_longer_than(SLOWEST):
        try:
            machine = ad.load(path)
            loaded = True
            answers(machine, use)
        except ad.ArmDesignError as error:
            message = str(error).replace(f"{folder}/", "")
            assert_clear(message)
            assert "; " in message or loaded, f"no remedy: {message}"
            file = message.partition(": ")[0]
            assert loaded or file == "x.toml" or f'"{file}"' in path.read_text(encoding="utf-8"), (
                message
            )
            if "not valid TOML" in message or "not well-formed XML" in message:
                assert re.search(r"line \d+, column \d+\)", message), message
            return message
    return ""


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
@pytest.mark.parametrize("what", ["toml", "urdf"])
def test_random_damage(
    what: str, name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """200 seeded wounds of each file of five machines; nothing is printed on the way (parsers in
    C++ like to).
    """
    machine = machines.named(name)
    texts = {"toml": machine.text, "urdf": _bare(machine.urdf_text)}
    files = {"toml": tmp_path / "x.toml", "urdf": tmp_path / machine.section.urdf}
    for kind, file in files.items():
        file.write_text(texts[kind], encoding="utf-8")
    refused = 0
    for seed in range(PER_MACHINE):
        files[what].write_bytes(damaged_bytes(texts[what], random.Random(f"{name} {seed}")))
        try:
            refused += bool(asked(files["toml"], "map" if seed % 10 == 0 else "modes"))
        except Exception as error:
            raise AssertionError(f"{name}, {what}, seed {seed}: {error!r}") from error
    assert PER_MACHINE / 4 < refused < PER_MACHINE
    assert capfd.readouterr() == ("", "")


# ------------------------------------------------------------------------------------------- edges

STICK = DATA["cylinder"]["stick"]
FOUR_BAR = BUCKET["four_bar"]
PIN = {"link": "bucket", "at_mm": [0, 0, 0]}
EDGES: list[tuple[str, str, Any, str]] = [
    ("pivot on the lug's joint", BARS + "pivot.at_mm", [2942.5, 0, 0], ""),
    (
        "lug on the joint, pivot on it too",
        "cylinder.bucket.four_bar",
        {**FOUR_BAR, "lug": PIN},
        "dead centre",
    ),
    ("bars of no length", BARS + "rocker_mm", 1e-30, "does not close at any"),
    ("bars that never end", BARS + "coupler_mm", 1e30, r"coupler_mm: 1e\+30 is not allowed"),
    ("bars just stretched", BARS + "rocker_mm", 868.05, "opens at"),
    (
        "both pins in one place on one link",
        "cylinder.boom.rod_end",
        BOOM["base"],
        "no joint lies between",
    ),
    ("base on the joint", "cylinder.boom.base.at_mm", [0, 0, 0], "dead centre"),
    ("rod end on the joint", "cylinder.boom.rod_end.at_mm", [0, 0, 0], "dead centre|never within"),
    ("pins a hair apart", "cylinder.boom.rod_end.at_mm", [461.5, 0, -602.5], "never within"),
    ("no closed length", "cylinder.boom.closed_length_mm", 1e-30, "never within"),
    ("a stroke of nothing", "cylinder.boom.stroke_mm", 1e-30, "never within|stroke"),
]


@pytest.mark.parametrize(
    ("path", "value", "message"), [edge[1:] for edge in EDGES], ids=[edge[0] for edge in EDGES]
)
def test_edges(path: str, value: Any, message: str) -> None:
    assert re.search(message, outcome(changed(path, value), use="map"))


@pytest.mark.parametrize("joint", ["boom", "stick", "bucket"])
def test_a_link_of_no_length(joint: str) -> None:
    """The next joint (or the tool) lies on this one: an arm all the same, unless a cylinder's pins
    then cannot be.
    """
    urdf = re.sub(
        rf'(joint name="{joint}".*?origin xyz=)"[^"]*"',
        r'\1"0 0 0"',
        URDF,
        count=1,
        flags=re.DOTALL,
    )
    assert urdf.count('xyz="0 0 0"') > URDF.count('xyz="0 0 0"') or joint == "boom"
    message = outcome(TEXT, urdf, use="map")
    assert not message or re.search("never within|does not close|opens|dead centre", message)


@pytest.mark.slow
@pytest.mark.parametrize("number", ["1e30", "-1e30", "1e300", "1e-30", "1e-300"])
def test_one_number_of_the_urdf_absurd(number: str) -> None:
    """Each number in its turn: too large a one is refused with joint or link and attribute, a
    small one may be used.

    Only what a frozen joint could do, were it free, does not matter.
    """
    swing = re.search(r'joint name="swing".*?</joint>', URDF, re.DOTALL)
    assert swing
    for match in list(re.finditer(r'(?<==")-?\d[\d.e-]*(?=")|(?<=xyz=")-?[\d.e-]+', URDF)):
        message = outcome(TEXT, URDF[: match.start()] + number + URDF[match.end() :], use="")
        if "e-" not in number and not swing.start() < match.start() < swing.end():
            assert re.search(r'urdf: (joint|link) \w+: \w+="[^"]*1e', message), message


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("name = ", r"line 1, column 8\)"),
        ("a = 1\nb = [1,\n", r"line 3, column 1\)"),
        ("a = 1\nb = = 2\n", r"line 2, column 5\)"),
        ('a = "x\n', r"line 1, column 7\)"),
        ("a = 1\na = 2\n", r"line 2, column 6\)"),
        (f"a = 1\nb = {'[' * 5000}{']' * 5000}", r"line 2, column 1\)"),
        (f"a = 1\n\nb = {'1' * 10_000}", r"line 3, column 1\)"),
        (TEXT.replace("[supply]", "[supply"), r"line 25, column \d+\)"),
    ],
)
def test_malformed_toml_gives_line_and_column(text: str, place: str) -> None:
    """By hand: where the value is missing, the file ends, the second key stands; the line of what
    is too big.
    """
    assert re.search(r"x\.toml: not valid TOML: .* \(at " + place, outcome(text))


# --------------------------------------------------------------------------------- wrong arguments

MIDDLE = EXCAVATOR.ranges.mean(axis=1)
BAD_POSES = [
    MIDDLE[:2],
    [[1]],
    [],
    [[]],
    0,
    None,
    "a",
    [["a", "b", "c"]],
    np.zeros((2, 2, 3)),
    [MIDDLE, MIDDLE[:2]],
]
BAD_POSES += [MIDDLE + 1j, {}, [[1, 2, 3, 4]], [np.inf, 0, 0], [np.nan] * 3, [None] * 3]


@pytest.mark.parametrize("q", BAD_POSES, ids=[str(index) for index in range(len(BAD_POSES))])
@pytest.mark.parametrize("question", ["at", "margins", "holds", "rigid_poses"])
def test_poses_of_a_wrong_shape_or_not_finite(question: str, q: Any) -> None:
    with pytest.raises(ad.ArmDesignError, match="excavator_20t: q: ") as caught:
        getattr(EXCAVATOR, question)(q)
    assert_clear(str(caught.value))


def test_no_pose_is_a_question_too() -> None:
    assert len(EXCAVATOR.at(np.zeros((0, 3)))) == 0


def test_a_pose_out_of_stroke_says_how_far_and_where_to_stay() -> None:
    q = MIDDLE.copy()
    q[1] = 0.0
    message = (
        r"stick cylinder: length 1\.\d{4} m is outside its stroke \[1\.8000, 3\.3040\] m at boom"
        r" .* rad, stick 0\.0000 "
        r'rad, .*; stay in the range of joint "stick" \[-2\.7\d+, -0\.5\d+\] rad'
    )
    with pytest.raises(ad.ArmDesignError, match=message):
        EXCAVATOR.at(q)


def test_an_open_four_bar_says_so() -> None:
    """The lug of this machine goes round its joint further from the pivot than rocker + coupler
    can reach.
    """
    machine = machines.named("four_bar_left")
    q = np.zeros((400, 3))
    q[:, 2] = np.linspace(-np.pi, np.pi, 400)
    open_ = machine.margins(q)[:, 2] == -np.inf
    assert 0 < open_.sum() < 400
    q = q[open_][:1]
    with pytest.raises(
        ad.ArmDesignError,
        match=r"tilt cylinder: its four-bar does not close at .*; stay in the range",
    ):
        machine.at(q)


@pytest.mark.parametrize(
    "name", ["excavator_20t", "paper_1dof", "spatial", "four_bar_right", "branched", "redundant"]
)
def test_margins_never_raise_for_a_pose(name: str) -> None:
    """Any finite joint positions, near and absurd: a number or −∞, never NaN."""
    machine = machines.named(name)
    chance = np.random.default_rng(0)
    for scale in (1e-300, 1.0, 10.0, 1e6, 1e100):
        margins = machine.margins(chance.uniform(-scale, scale, (300, len(machine.joints))))
        assert margins.shape == (300, len(machine.cylinders))
        assert not np.isnan(margins).any()
        assert margins.max() <= 0.5


@pytest.mark.parametrize(
    "payload", ["ful", "", "800", None, -1, math.nan, math.inf, True, [1], {}, 1j, b"full"]
)
def test_payloads_that_cannot_be(payload: Any) -> None:
    with pytest.raises(ad.ArmDesignError, match=r"excavator_20t: payload") as caught:
        EXCAVATOR.with_payload(payload)
    assert_clear(str(caught.value))


BAD_POINTS = [
    0,
    1,
    -3,
    "5",
    "x",
    3.0,
    2.7,
    [3, 3],
    [3, 3, 1],
    [3, 3, 3.5],
    10**9,
    [10**6] * 3,
    [],
    True,
    {},
]
BAD_POINTS += [
    [None] * 3,
    math.nan,
    math.inf,
    "3,3,3",
    ["3"] * 3,
    [[3] * 3],
    2**62,
    [3, 3, 3, 3],
    [True] * 3,
]


@pytest.mark.parametrize("points", BAD_POINTS, ids=str)
def test_grids_that_cannot_be(points: Any) -> None:
    with pytest.raises(
        ad.ArmDesignError, match=r"points: .*; give (one number ≥ 2, or 3|at most 5 million)"
    ):
        ad.Workspace.grid(EXCAVATOR, points=points)


@pytest.mark.parametrize("margin", [0.5, -1, math.nan, math.inf, "x", [0.1], True])
def test_end_margins_that_cannot_be(margin: Any) -> None:
    with pytest.raises(
        ad.ArmDesignError,
        match=r"end_margin: .* is not allowed; give a share of the stroke in \[0, 0",
    ):
        ad.Workspace.grid(EXCAVATOR, points=3, end_margin=margin)
