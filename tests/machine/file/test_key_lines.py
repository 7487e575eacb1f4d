"""Lines of keys and elements: found in files as people write them, and said by every error that
names one.
"""

from __future__ import annotations

import pickle
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.machine.file.toml_reading import KeyLines
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from tests import machines

EXCAVATOR = machines.named("excavator_20t")


def flat(value: Any, path: str = "") -> dict[str, Any]:
    """Every key path of parsed TOML, tables and list items too."""
    items = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    values = {path: value} if path else {}
    for key, item in items:
        values |= flat(item, f"{path}.{key}" if path else str(key))
    return values


def assert_found(text: str) -> None:
    """Every key is found; what is noted as its value parses to its value; its name stands in the
    line that is noted.
    """
    key_lines, data = KeyLines(text), tomllib.loads(text)
    assert set(key_lines.by_path) == set(flat(data))
    lines = text.split("\n")
    for path, value in flat(data).items():
        place = key_lines.by_path[path]
        if not isinstance(value, dict) or place.written:
            assert tomllib.loads(f"x = {place.written}")["x"] == value, path
        last = re.split(r"\.", path)[-1]
        if not last.isdigit():
            assert last in lines[place.line - 1], (path, lines[place.line - 1])


@pytest.mark.parametrize("name", sorted(shipped()))
def test_shipped_files(name: str) -> None:
    text = machines.named(name).text
    assert_found(text)
    # independent: every plain "key = value" line of these files
    for number, line in enumerate(text.split("\n"), 1):
        match = re.match(r"(\w+)\s*=", line)
        if match:
            assert number in {
                p.line for path, p in KeyLines(text).by_path.items() if path.endswith(match[1])
            }


ODD = (
    """# a comment with = and [brackets]
  "name" = 'x # no comment'
joints = [ # one
  "boom",
  "stick]", # two
]
tool.link = "a=b" ; """.replace(" ; ", "")
    + '''
tool . "at_mm" = [1.5,
   -2, 3e3]
text = """
key = 1
[no.table]
"""
raw = \'\'\'[x]
y = 2\'\'\'
[cylinder.boom.valve]   # before its table
rated = 1_000
[cylinder.boom]
base = { link = "c", at_mm = [1, 2, 3], "odd key" = { x.y = true } }
when = 1979-05-27 07:32:00
[ payload . "full" ]
mass_kg=5
\t[requirements]
lift.a.joint_deg = { boom = 1, stick = 2 }
points = [[1, 2], [3, 4], ["a,b", "]"]]
'''
)


def test_a_file_as_nobody_should_write_it() -> None:
    assert_found(ODD)
    key_lines = KeyLines(ODD)
    expected = {
        "name": 2,
        "joints": 3,
        "joints.1": 5,
        "tool.link": 7,
        "tool": 7,
        "tool.at_mm": 8,
        "tool.at_mm.2": 9,
    }
    expected |= {
        "text": 10,
        "raw": 14,
        "cylinder.boom": 18,
        "cylinder.boom.valve.rated": 17,
        "cylinder": 16,
    }
    expected |= {
        "cylinder.boom.base.odd key.x.y": 19,
        "payload.full": 21,
        "payload.full.mass_kg": 22,
    }
    expected |= {"requirements.lift.a.joint_deg.stick": 24, "requirements.points.1.0": 25}
    assert {path: key_lines.line_of(path) for path in expected} == expected  # by counting
    assert key_lines.line_of("payload.full.at_mm") == 21, "a key that is missing: its table"
    assert key_lines.line_of("nothing") is None
    windows = ODD.replace("\n", "\r\n")
    assert {k: v.line for k, v in KeyLines(windows).by_path.items()} == {
        k: v.line for k, v in key_lines.by_path.items()
    }


KEY = st.from_regex(r"[a-z]{1,3}", fullmatch=True)
VALUE = st.recursive(
    st.one_of(st.integers(-99, 99), st.booleans(), st.text("ab#[]{},=\" \\'", max_size=5)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEY, inner, max_size=3),
    max_leaves=5,
)


def written(value: Any, draw: Any) -> str:
    """A value as TOML, strings in any of the quotes that can hold them, lists over several
    lines.
    """
    if isinstance(value, dict):
        return (
            "{ "
            + ", ".join(
                f"{key}= {written(item, draw).replace(chr(10), ' ')}"
                for key, item in value.items()
            )
            + "}"
        )
    if isinstance(value, list):
        gap = draw(st.sampled_from([" ", "\n  ", " # ]\n"]))
        if gap.startswith(" #") or "\n" in gap:
            return (
                "["
                + "".join(f"{gap}{written(item, draw)}," for item in value)
                + gap.replace("# ]", "")
                + "]"
            )
        return "[" + ", ".join(written(item, draw) for item in value) + "]"
    if isinstance(value, str):
        literal = [f"'{value}'", f"'''{value}'''"] if "'" not in value else []
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return draw(st.sampled_from([f'"{escaped}"', f'"""{escaped}"""', *literal]))
    return str(value).lower()


@st.composite
def documents(draw: Any) -> str:
    """TOML of random keys, tables, dotted and quoted keys, comments and empty lines."""
    lines: list[str] = []
    for i in range(draw(st.integers(0, 4))):
        if i:
            dots = draw(st.sampled_from([".", " . "]))
            lines += [draw(st.sampled_from(["", "# [c] = 1"])), f"[t{i}{dots}{draw(KEY)}]  # head"]
        for key, value in draw(st.dictionaries(KEY, VALUE, max_size=4)).items():
            name = draw(st.sampled_from([key, f'"{key}"', f"d{key}.sub", f"  {key}"]))
            lines.append(
                f"{name} = {written(value, draw)}" + draw(st.sampled_from(["", "  # 'x"]))
            )
    return "\n".join(lines)


def is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:  # e.g. a comment within an inline table
        return False
    return True


@pytest.mark.slow
@given(documents().filter(is_toml))
def test_random_files(text: str) -> None:
    """Keys, values and lines of any file that tomllib reads."""
    key_lines = KeyLines(text)
    data = tomllib.loads(text)
    assert set(key_lines.by_path) == set(flat(data))
    for path, value in flat(data).items():
        place = key_lines.by_path[path]
        if place.written:
            assert tomllib.loads(f"x = {place.written}")["x"] == value
            assert text.split("\n")[place.line - 1].count(place.written.split("\n")[0])
        else:
            assert isinstance(value, dict)


# ----------------------------------------------------------------------------------- what they say

CASES = [
    ("bore_mm = 120", "bore_mm = -1", "cylinder.boom.bore_mm"),
    ("rod_mm = 85", "rod_mm = 130", "cylinder.boom.rod_mm"),
    ("closed_length_mm = 1825", "closed_length_mm = 9000", "cylinder.boom.stroke_mm"),
    ("return_pressure_bar = 5", "return_pressure_bar = 400", "supply.return_pressure_bar"),
    ('base    = { link = "chassis"', 'base    = { link = "chasis"', "cylinder.boom.base.link"),
    ("at_mm = [645, 0, 435]", "", "payload.full"),
    ("coupler_mm = 561.0", "coupler_mm = 5000", "cylinder.bucket.four_bar"),
    ('joints = ["boom", "stick", "bucket"]', 'joints = ["boom", "boom"]', "joints"),
    ("pitch_deg = [120, 240]", "pitch_deg = [240, 120]", "payload.full.pitch_deg"),
    ("share = 0.95", 'share = "x"', "requirements.digging.share"),
    ("at_mm = [461.5, 0, -602.5]", "at_mm = [461.5, 0, true]", "cylinder.boom.base.at_mm.2"),
]


@pytest.mark.parametrize(("old", "new", "path"), CASES, ids=[path for *_, path in CASES])
def test_errors_of_the_file_say_the_line(old: str, new: str, path: str, tmp_path: Path) -> None:
    """That of the text, found by searching it; `load`, `from_text`, `check` and `replace` say the
    same.
    """
    text = EXCAVATOR.text.replace(old, new, 1)
    assert text != EXCAVATOR.text
    elsewhere = {  # than where the text was changed
        "payload.full": "[payload.full]",
        "cylinder.bucket.four_bar": "[cylinder.bucket.four_bar]",
        "cylinder.boom.stroke_mm": "stroke_mm = 1260",
    }
    before = EXCAVATOR.text[: EXCAVATOR.text.index(elsewhere.get(path, old))]
    line = before.count("\n") + 1
    key = path.split(".")[1 if path in ("payload.full", "cylinder.bucket.four_bar") else -1]
    assert key in EXCAVATOR.text.split("\n")[line - 1] or path.endswith((".link", ".2"))
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    (tmp_path / "excavator_20t.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    with pytest.raises(ad.ArmDesignError) as one:
        Machine.from_text(text, EXCAVATOR.urdf_text, Path("x.toml"))
    with pytest.raises(ad.ArmDesignError) as other:
        ad.load(tmp_path / "x.toml")
    assert str(one.value) == str(other.value)
    assert one.value.line == line
    assert str(one.value).endswith(f"(line {line})")
    assert any(fault.line == line for fault in faults(tmp_path / "x.toml"))


@pytest.mark.parametrize(
    ("old", "new", "name", "line"),
    [
        ('joints = ["boom", "stick",', 'joints = [\n  "boom",\n  "stik",', "stik", 2),
        ("frozen = { swing", "frozen = { swingg", "swingg", 0),
    ],
)
def test_a_joint_that_the_urdf_lacks_says_the_line_of_the_machine_file(
    old: str, new: str, name: str, line: int, tmp_path: Path
) -> None:
    """Its part is the URDF, which has no such line; `load`, `from_text` and `check` say the
    same, between processes too.
    """
    line += EXCAVATOR.text[: EXCAVATOR.text.index(old)].count("\n") + 1
    text = EXCAVATOR.text.replace(old, new, 1)
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    (tmp_path / "excavator_20t.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    with pytest.raises(ad.ArmDesignError) as one:
        Machine.from_text(text, EXCAVATOR.urdf_text, Path("x.toml"))
    with pytest.raises(ad.ArmDesignError) as other:
        ad.load(tmp_path / "x.toml")
    fault = str(one.value)
    assert fault.startswith(f"excavator_20t.urdf: joint {name}: is not in the URDF")
    assert fault.endswith(f" (line {line} of x.toml)")
    assert str(other.value) == fault
    assert str(pickle.loads(pickle.dumps(one.value))) == fault
    assert fault in map(str, faults(tmp_path / "x.toml"))


def test_replace_says_the_line_of_the_file_and_generated_files_none() -> None:
    with pytest.raises(ad.ArmDesignError, match=r"bore_mm: -1 .* \(line 34\)$"):
        EXCAVATOR.replace({"cylinder.boom.bore_mm": -1})
    with pytest.raises(ad.ArmDesignError, match=r"boom\.bore: unknown key; .* \(line 32\)$"):
        EXCAVATOR.replace({"cylinder.boom.bore": 130})
    cylinders = tomllib.loads(EXCAVATOR.text)["cylinder"]
    with pytest.raises(ad.ArmDesignError) as caught:
        Machine.from_urdf(
            EXCAVATOR.urdf_text, {**cylinders, "boom": {**cylinders["boom"], "bore_mm": -1}}
        )
    assert caught.value.line is None


URDF_CASES = [
    ('lower="-2.71404"', 'lower="5"', '<limit lower="-2.71404"'),
    ('mass value="1010"', 'mass value="-1010"', '<mass value="1010"'),
    (
        '<joint name="stick" type="revolute">',
        '<joint name="stick" type="planar">',
        '<joint name="stick"',
    ),
    ('iyy="1364"', 'iyy="9e9"', 'iyy="1364"'),
    ('<child link="stick"/>', '<child link="stik"/>', '<child link="stick"/>'),
]


@pytest.mark.parametrize(
    ("old", "new", "where"), URDF_CASES, ids=[new for _, new, _ in URDF_CASES]
)
def test_faults_of_the_urdf_say_its_line(old: str, new: str, where: str) -> None:
    line = EXCAVATOR.urdf_text[: EXCAVATOR.urdf_text.index(where)].count("\n") + 1
    with pytest.raises(ad.ArmDesignError) as caught:
        Machine.from_text(EXCAVATOR.text, EXCAVATOR.urdf_text.replace(old, new, 1), Path("x.toml"))
    assert caught.value.line == line
    assert str(caught.value).startswith("excavator_20t.urdf: ")
