"""Numbers as people write them and TOML does not: the message says what to write instead."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.machine.machine import Machine
from tests import machines

EXCAVATOR = machines.named("excavator_20t")
WRITTEN = [
    (
        "stroke_mm = 1260",
        "stroke_mm = 673,6",
        r"decimal comma in 673,6 \(at line 36, column 16\); write 673\.6$",
    ),
    (
        "stroke_mm = 1260",
        "stroke_mm = 1,260",
        r"write 1\.260, or 1260 where the comma parts thousands",
    ),
    (
        "swing = 0.0 }",
        "swing = 0,5 }",
        r"decimal comma in 0,5 \(at line 8, column 21\); write 0\.5",
    ),
    ("cap = 5.6,", "cap = 5,6,", r"decimal comma in 5,6 \(at line 38, column 26\); write 5\.6"),
    ("annulus = 5.6 }", "annulus = 5,6 }", r"decimal comma in 5,6 .*; write 5\.6"),
    (
        "[461.5, 0, -602.5]",
        "[461,5, 0, -602,5]",
        r"boom\.base\.at_mm: decimal commas.*write \[461\.5, 0, -602\.5\].*line 40",
    ),
    ("[461.5, 0, -602.5]", "[461,5,0,-602,5]", r"write \[461\.5, 0, -602\.5\]"),
    ("[120, 240]", "[120,5, 240]", r"pitch_deg: decimal commas.*write \[120\.5, 240\]"),
    (
        "bore_mm = 120",
        'bore_mm = "120,5"',
        r'boom\.bore_mm: decimal comma, and a text: "120,5" .*write 120\.5; give a number',
    ),
    (
        "bore_mm = 120",
        'bore_mm = "120"',
        r'"120" is not allowed; give a number .*; write it without quotes: 120',
    ),
    (
        "bore_mm = 120",
        'bore_mm = "120 mm"',
        r'"120 mm" is not allowed; .*; write the number alone, in mm: 120',
    ),
    (
        "bore_mm = 120",
        'bore_mm = "12 cm"',
        r'"12 cm" is not allowed; .*; write the number alone, in mm \(',
    ),
    (
        "bore_mm = 120",
        "bore_mm = .5",
        r"no digit on one side of a point \(at line 34, column \d+\); write 0\.5",
    ),
    (
        "stroke_mm = 1260",
        "stroke_mm = 1.260,5",
        r"points and commas in 1\.260,5 \(at line 36, column 13\); write 1260\.5$",
    ),
    (
        "stroke_mm = 1260",
        "stroke_mm = 1,260.5",
        r"points and commas in 1,260\.5 \(at line 36, .*; write 1260\.5$",
    ),
    (
        "[461.5, 0, -602.5]",
        "[1.461,5, 0, -602,5]",
        r"boom\.base\.at_mm: decimal commas.*write \[1461\.5, 0, -602\.5\].*line 40",
    ),
    ("bore_mm = 120", 'bore_mm = "1.120,5"', r"points and commas, and a text.*write 1120\.5;"),
    (
        "bore_mm = 120",
        "bore_mm = 120 mm",
        r"a unit behind the number 120 \(at line 34, column 15\); "
        r"write 120: the key says that it is in mm$",
    ),
    ("bore_mm = 120", "bore_mm = 120mm", r"\(at line 34, column 14\); write 120: the key says"),
    (
        "bore_mm = 120",
        "bore_mm = 12 cm  # bore",
        r"the number 12 \(.*; write the number alone: the key says that it is in mm$",
    ),
    (
        "flow_l_per_min = 429",
        "flow_l_per_min = 429 l/min",
        r"number 429 \(.*; write 429: the key says that it is in l/min$",
    ),
    ("annulus = 5.6 }", "annulus = 5.6 l }", r"number 5\.6 \(.*; write 5\.6: .* is in l$"),
    (
        "[461.5, 0, -602.5]",
        "[461.5 mm, 0, -602.5 mm]",
        r"number 461\.5 \(at line 40, .*; write 461\.5: the key says that it is in mm$",
    ),
    ("swing = 0.0 }", "swing = 0.5 rad }", r"number 0\.5 \(.*; write the number alone$"),
    ("stroke_mm = 1260", "stroke_mm = 0x1G", r"not valid TOML: Expected newline .* line 36"),
]


@pytest.mark.parametrize(("old", "new", "message"), WRITTEN, ids=[new for _, new, _ in WRITTEN])
def test_numbers_as_other_people_write_them(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    text = EXCAVATOR.text.replace(old, new, 1)
    assert text != EXCAVATOR.text
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    (tmp_path / "excavator_20t.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    (fault,) = faults(tmp_path / "x.toml")
    assert re.search(message, str(fault)), str(fault)


def test_three_whole_numbers_are_no_decimal_commas() -> None:
    with pytest.raises(ad.ArmDesignError, match="give a list of 3 values") as caught:
        EXCAVATOR.replace({"tool.at_mm": [1, 2]})
    assert "comma" not in str(caught.value)


@pytest.mark.parametrize("text", ["0,5 0 0", "0.5, 0, 0", "0,5, 0, 0", "0.5,0,0"])
def test_commas_in_the_urdf(text: str) -> None:
    urdf = EXCAVATOR.urdf_text.replace('xyz="5.6479 0 0" rpy="0 0 0"', f'xyz="{text}"', 1)
    with pytest.raises(
        ad.ArmDesignError, match=r'decimal comma\? write xyz="0\.5 0(\.0)? 0" \(line 287\)'
    ):
        Machine.from_text(EXCAVATOR.text, urdf, Path("x.toml"))
