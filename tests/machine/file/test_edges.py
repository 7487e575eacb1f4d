"""Files at the edge of what can be: pins in one place, bars of no length, links of none."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest

from armdesign.errors import MachineFileError
from armdesign.machine.machine import Machine
from tests import machines
from tests.machine.file.bad_files import BARS, BOOM, BUCKET, TEXT, URDF, changed, outcome

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


@pytest.mark.parametrize("toward", [0, 1950, 4000])
def test_a_range_of_one_point_is_none(toward: float) -> None:
    """A cylinder as long, closed, as its pins are ever apart, whichever way that rounds."""
    crane = machines.named("loader_crane")
    text = crane.text.replace(
        "closed_length_mm = 1950", f"closed_length_mm = {math.nextafter(1950, toward)}"
    )
    reverse = 'xyz="-1 0 0"'
    urdf = re.sub(
        r'(joint name="extension".*?<axis )xyz="1 0 0"',
        rf"\1{reverse}",
        crane.urdf_text,
        flags=re.S,
    )
    assert text != crane.text
    assert urdf != crane.urdf_text
    with pytest.raises(MachineFileError, match=r"extension: its axis .* looks reversed"):
        Machine.from_text(text, urdf, Path("x.toml"))


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
