"""Rows of CSV files as people write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from armdesign.csv_rows import plain_cells, read_rows
from armdesign.errors import ArmDesignError, SimulationError
from armdesign.output import write_csv

SMALL = ["-.5e-3", ""]


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("", ([], [])),
        ("a,,\n1,,\n", (["a", "", ""], [(2, ["1", "", ""])])),
        ("# a comment\n", ([], [])),
        ("a,b\n# c\n\n 1 , x\n", (["a", "b"], [(4, ["1", "x"])])),
        ("\ufeffa;b\n1,5;x,y\n-,5e-3;\n", (["a", "b"], [(2, ["1.5", "x,y"]), (3, SMALL)])),
        ('a,b\n"1,5",2\n', (["a", "b"], [(2, ["1,5", "2"])])),
        ('a\n"two\nlines"\n\n3\n', (["a"], [(2, ["two\nlines"]), (5, ["3"])])),
        ('a\r\n"x\r\n\r\n# y"\r\n', (["a"], [(2, ["x\r\n\r\n# y"])])),
        ("a\nx\u2028y\n", (["a"], [(2, ["x\u2028y"])])),
    ],
)  # fmt: skip
def test_rows(text: str, rows: object, tmp_path: Path) -> None:
    path = tmp_path / "some.csv"
    path.write_text(text, encoding="utf-8", newline="")
    assert read_rows(path) == rows


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b,a\n1,2,3\n", 'column "a" is there twice; leave one out'),
        ("a,b\n1,2\n\n1\n", "1 fields in line 4, 2 names; give one field per name"),
        ("a,b\n1,2,3\n", "3 fields in line 2, 2 names"),
        ('a,b\n"1,2\n', "is no CSV file"),
        ("a,,\n1,,2\n", "a field in line 2 is below no name; name its column"),
        (None, "cannot be read (No such file or directory); give a CSV file"),
    ],
)
def test_faults(text: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "some.csv"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    for kind in (ArmDesignError, SimulationError):
        with pytest.raises(kind) as caught:
            read_rows(path, kind)
        assert type(caught.value) is kind
        assert str(caught.value).startswith(f"{path}: {message}")


@pytest.mark.parametrize("encoding", ["utf-16", "cp1252"])
def test_a_text_in_another_encoding_is_to_be_saved_again(encoding: str, tmp_path: Path) -> None:
    """As spreadsheets write it; "a line of column names" was there."""
    path = tmp_path / "some.csv"
    path.write_text("time_s,débit_l_min\n0,1\n", encoding=encoding)
    with pytest.raises(ArmDesignError, match=r"is not UTF-8 text; save it as CSV in UTF-8$"):
        read_rows(path)


def test_more_rows_than_are_allowed(tmp_path: Path) -> None:
    path = tmp_path / "some.csv"
    path.write_text("a\n1\n2\n3\n", encoding="utf-8")
    assert len(read_rows(path, most=3)[1]) == 3
    with pytest.raises(ArmDesignError, match="has more than 2 rows; give fewer"):
        read_rows(path, most=2)


def test_tables_are_written_as_pandas_does(tmp_path: Path) -> None:
    """To the letter: digits, blanks for what is not there, quotes; pandas is the reference.

    But for control characters, which are shown as Python writes them.
    """
    frame = pd.DataFrame(
        {
            "a": [1 / 3, np.nan, np.inf, -1e-300],
            "b,c": ["x", 'say "no"', None, "two\nlines"],
            "mixed": [1 / 3, None, "t\tu", True],
            "whole": [1, 2, 3, 4],
            "flag": [True, False, True, False],
            "few": pd.array([1, None, 3, 4], dtype="Int64"),
            5: ["", "-5", "x y", "1"],
            "kind": pd.Categorical(["u", "v", "u", None]),
        }
    )
    for part in (frame, frame.iloc[:0], frame[["a"]], frame[[5]]):
        ours, theirs = tmp_path / "ours.csv", tmp_path / "theirs.csv"
        write_csv(part, ours)
        plain_cells(part).to_csv(theirs, index=False, float_format="%.9g")
        assert ours.read_bytes() == theirs.read_bytes()
