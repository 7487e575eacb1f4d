"""Bad URDFs, and texts that are no TOML: one clear line with what is wrong, and where."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from tests.machine.file.bad_files import DATA, TEXT, URDF, assert_clear, outcome

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
    *(
        (re.sub(rf"(<{tag} [^>]*/>)", r"\1\1", URDF, count=1), f"has more than one <{tag}>")
        for tag in ("axis", "limit", "parent", "child")
    ),
    *(
        (
            re.sub(rf"(<{tag} [^>]*/>)", r"\1\1", URDF, count=1),
            f"has more than one <{tag}> in its <inertial>",
        )
        for tag in ("mass", "inertia")
    ),
    (
        re.sub(r"(<inertial>.*?</inertial>)", r"\1\1", URDF, count=1, flags=re.DOTALL),
        "has more than one <inertial>",
    ),
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
        ("", r"x\.toml: name: missing; add name.*6 more"),
        ("# nothing\n", r"x\.toml: name: missing"),
        ("name = ", r"not valid TOML: Invalid value"),
        (TEXT + "\n[fluid]\n", r"not valid TOML: .*fluid.*twice.*line \d+"),
        ("a = " + "[" * 5000 + "]" * 5000, "not valid TOML"),
        (
            "a = " + "1" * 10_000,
            r"not valid TOML: a whole number of thousands of digits \(at line 1",
        ),
        ("name = 1979-05-27", r"x\.toml: name: 1979-05-27 is a date .* quotes \(line 1"),
        ("a = 1\n[b]\nc = [{d = 07:32:00}]", r"b\.c\.0\.d: 07:32:00 is a date or time.*line 3"),
        (".".join(["a"] * 3000) + " = 1", "a key has more than 32 parts; write"),
        ("\0" * 10, "not valid TOML"),
        (URDF, "not valid TOML: .*; give the .toml file that names the URDF"),
    ],
)
def test_text_that_is_no_machine_file(text: str, message: str) -> None:
    assert re.search(message, outcome(text))


def refusal(path: Any) -> str:
    """What is said of a file that cannot be read."""
    with pytest.raises(ad.ArmDesignError) as caught:
        ad.load(path)
    assert_clear(str(caught.value))
    return str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    message = refusal(tmp_path / "binary.toml")
    assert re.search(r"binary\.toml: is not UTF-8 text; save it as UTF-8", message)
    assert "holds no" in refusal(tmp_path)
    (tmp_path / "folder.toml").mkdir()
    assert "holds no" in refusal(tmp_path / "folder.toml")
    assert "no such file" in refusal(tmp_path / "none.toml")
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    assert "cannot be read" in refusal(tmp_path / "loop.toml")


@pytest.mark.parametrize("urdf", ["none.urdf", ".", "binary.toml", "a\\u0000b", "a\\nb"])
def test_a_urdf_that_cannot_be_read(urdf: str, tmp_path: Path) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "a.toml").write_text(TEXT.replace(DATA["urdf"], urdf, 2), encoding="utf-8")
    refusal(tmp_path / "a.toml")


def test_a_missing_urdf_is_named(tmp_path: Path) -> None:
    (tmp_path / "f.toml").write_text(TEXT.replace(DATA["urdf"], "missing.urdf"), encoding="utf-8")
    message = refusal(tmp_path / "f.toml")
    assert re.search(r'f\.toml: urdf: "missing\.urdf": no such file', message)


@pytest.mark.parametrize(
    "path",
    [
        *("", "x" * 5000, "a\0b", "/", "/proc/self/mem"),
        *(None, 5, b"excavator_20t", ["excavator_20t"]),
    ],
    ids=range(9),
)
def test_what_is_no_path(path: Any) -> None:
    refusal(path)


def test_a_misspelt_machine_is_offered() -> None:
    assert 'did you mean "excavator_20t"' in refusal("excavater_20t")


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
