"""Sizes of a catalogue: by name, from a file, or none."""

from __future__ import annotations

import math
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

import armdesign as ad
from armdesign import ArmDesignError
from armdesign.design.catalogue.sizes import CATALOGUES, read_sizes, sizes_of
from armdesign.machine.file.schema import RequirementsSection
from armdesign.units import mm
from tests.design.designs import double, workspace_of


@pytest.mark.parametrize(
    ("catalogue", "words"),
    [
        ("din", 'give "iso", "5mm"'),
        ([], "is empty"),
        (
            [(140, 100)],
            r"\(140, 100\) m is not 0 < rod < bore, 0.001 to 2 m; give pairs of bore and rod in m",
        ),
        ([(0.1, 0.1)], "is not 0 < rod < bore"),
        ([(0.1, math.nan)], "is not 0 < rod < bore"),
        ([0.1, 0.2], "is not a pair of numbers"),
    ],
)
def test_what_is_no_catalogue(catalogue: object, words: str) -> None:
    with pytest.raises(ArmDesignError, match=words):
        ad.size_cylinders(double(), workspace_of("double"), catalogue=catalogue)  # type: ignore[arg-type]


def test_named_catalogues() -> None:
    """The public pairs of ISO 3320 sizes, and sizes of makers of excavators."""
    pairs = {(round(b / mm), round(r / mm)) for b, r in sizes_of("iso")}
    public = {(50, 36), (63, 45), (80, 56), (100, 70), (125, 90), (140, 90), (160, 110),
              (180, 110), (200, 140),
              (250, 180), (320, 220)}  # fmt: skip
    assert public <= pairs
    bores = {round(b / mm) for b, _ in sizes_of("5mm")}
    assert {105, 115, 120, 135, 145} <= bores
    for name in ("iso", "5mm"):
        assert all(0 < rod < bore for bore, rod in sizes_of(name))


def test_catalogue_file(tmp_path: Path) -> None:
    good = tmp_path / "own.csv"
    good.write_text("name, rod_mm, bore_mm\nb, 63, 100\na, 45, 80\n", encoding="utf-8")
    assert read_sizes(good) == pytest.approx(np.array([(0.08, 0.045), (0.1, 0.063)]))
    good.write_text("# a shop's\nbore_mm;rod_mm\n\n100,5;63\n", encoding="utf-8")
    assert read_sizes(good) == pytest.approx(np.array([(0.1005, 0.063)]))
    for text, words in (
        ("bore,rod\n1,2\n", "has columns bore, rod"),
        ("", "has columns none"),
        ("bore_mm,rod_mm\n100,63\nx,63\n", "line 3: is not a pair"),
        ("bore_mm,rod_mm\n100\n", "1 fields in line 2, 2 names"),
        ("bore_mm,rod_mm\n", "has no sizes; give a line for each"),
        (
            "bore_mm,rod_mm\n20,30\n",
            "line 2: rod 30 mm in bore 20 mm; give 0 < rod_mm < bore_mm, 1 to 2000",
        ),
        (
            "bore_mm,rod_mm\n0.063,0.036\n",
            "line 2: rod 0.036 mm in bore 0.063 mm; give 0 < rod_mm < bore_mm, 1 to 2000",
        ),
    ):
        (tmp_path / "bad.csv").write_text(text, encoding="utf-8")
        with pytest.raises(ArmDesignError, match=words):
            read_sizes(tmp_path / "bad.csv")
    with pytest.raises(ArmDesignError, match="cannot be read"):
        read_sizes(tmp_path / "none.csv")


def test_the_schema_names_the_catalogues() -> None:
    (choice, _) = get_args(get_type_hints(RequirementsSection)["catalogue"])
    assert get_args(choice) == tuple(CATALOGUES)
