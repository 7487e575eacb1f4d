"""Rows of CSV files that people write: comments, blank lines, semicolons with decimal commas."""

from __future__ import annotations

import csv
import re
from pathlib import Path

from armdesign.errors import ArmDesignError

Row = tuple[int, list[str]]
DECIMAL = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?", re.IGNORECASE)


def read_rows(
    path: str | Path, kind: type[ArmDesignError] = ArmDesignError
) -> tuple[list[str], list[Row]]:
    """Names of the columns, and the fields of every row after the number of its line.

    Fields are without blanks at their ends, numbers with a decimal point. Lines that begin with
    ``#`` are comments. Both are empty where the file holds nothing.

    Args:
        path: of the file.
        kind: of the errors.

    Raises:
        ArmDesignError: a file that cannot be read, a column that is there twice, or a row with
            more or fewer fields than names.
    """
    remedy = "give a CSV file with a line of column names"
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise kind(str(path), f"cannot be read ({reason})", remedy) from None
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    head = lines[0][1] if lines else ""
    separator = ";" if head.count(";") > head.count(",") else ","
    reader = csv.reader([line for _, line in lines], delimiter=separator, strict=True)
    try:
        rows = [(lines[reader.line_num - 1][0], _fields(row, separator)) for row in reader]
    except csv.Error as error:
        raise kind(str(path), f"is no CSV file ({error})", remedy) from None
    names = rows[0][1] if rows else []
    for name in names:
        if names.count(name) > 1:
            raise kind(str(path), f'column "{name}" is there twice', "leave one out")
    for number, fields in rows[1:]:
        if len(fields) != len(names):
            fault = f"{len(fields)} fields in line {number}, {len(names)} names"
            raise kind(str(path), fault, "give one field per name")
    return names, rows[1:]


def _fields(row: list[str], separator: str) -> list[str]:
    """Fields without blanks at their ends, with decimal points."""
    fields = [field.strip() for field in row]
    if separator == ",":
        return fields
    return [f.replace(",", ".") if DECIMAL.fullmatch(f) else f for f in fields]
