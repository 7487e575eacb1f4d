"""CSV files: rows as people write them, and texts that no spreadsheet takes for a formula.

People write comments, blank lines, semicolons with decimal commas. A name in a machine file or
URDF may begin with ``=`` or another sign of a formula; written with an apostrophe before it, it
is a text for every spreadsheet, also behind a semicolon, at which some part cells. Reading takes
the apostrophe off again.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

from armdesign import text_files
from armdesign.errors import ArmDesignError, printable

if TYPE_CHECKING:
    import pandas as pd

Row = tuple[int, list[str]]
DIGITS = 9  # significant, of numbers that are written
INSTANTS, DECIMALS = ("time_s", "begin_s", "end_s"), 6  # of clocks that may count from 1970
DECIMAL = re.compile(r"[-+]?\d*,\d+(e[-+]?\d+)?", re.IGNORECASE)

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?", re.IGNORECASE)
FORMULA = re.compile(
    r"[=+\-@\t\r＝＋－＠].", re.DOTALL
)  # how a formula begins, for one spreadsheet or another


def digits_of(name: str, values: Iterable[float]) -> int:
    """Significant digits of a column's numbers: of instants so many that microseconds are told."""
    if name not in INSTANTS:
        return DIGITS
    largest = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    return max(DIGITS, len(f"{largest:.0f}") + DECIMALS)


def plain_text(text: str) -> str:
    """The text as a cell or head of a column, with an apostrophe where it looks like a formula."""
    return ";".join(f"'{part}" if _is_formula(part) else part for part in text.split(";"))


def _is_formula(text: str) -> bool:
    return bool(FORMULA.match(text)) and not NUMBER.fullmatch(text)


def as_written(text: str) -> str:
    """The text as it is written: as ``plain_text``, and printable."""
    return plain_text(printable(text))


def plain_cells(table: pd.DataFrame) -> pd.DataFrame:
    """The table with every text in its heads and cells ``as_written``."""
    import pandas as pd

    plain = table.copy()
    for k, (_, column) in enumerate(table.items()):
        if column.dtype.kind == "O":  # in which whole numbers keep all digits
            cells = [as_written(c) if isinstance(c, str) else c for c in column]
            plain.isetitem(k, pd.Series(cells, index=column.index, dtype=object).array)
    return plain.rename(columns=lambda name: as_written(str(name)))


def read_rows(
    path: str | Path, kind: type[ArmDesignError] = ArmDesignError, most: int | None = None
) -> tuple[list[str], list[Row]]:
    """Names of the columns, and the fields of every row after the number of its first line.

    Fields are without blanks at their ends, numbers with a decimal point; in quotes they may go
    over several lines. Lines that begin with ``#`` are comments. Both are empty where the file
    holds nothing.

    Args:
        path: of the file.
        kind: of the errors.
        most: rows that are allowed.

    Raises:
        ArmDesignError: a file that cannot be read or has too many rows, a column that is there
            twice, or a row with more or fewer fields than names.
    """
    remedy = "give a CSV file with a line of column names"
    try:
        text = text_files.read(path, text_files.LARGEST_TABLE)
    except UnicodeDecodeError:
        raise kind(str(path), "is not UTF-8 text", "save it as CSV in UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        reason = getattr(error, "strerror", None) or error
        raise kind(str(path) or "CSV file", f"cannot be read ({reason})", remedy) from None
    try:
        rows = list(islice(_rows(text), None if most is None else most + 2))
    except csv.Error as error:
        raise kind(str(path), f"is no CSV file ({error})", remedy) from None
    if most is not None and len(rows) > most + 1:
        raise kind(str(path), f"has more than {most} rows", "give fewer")
    names = rows[0][1] if rows else []
    for name, count in Counter(names).items():
        if count > 1 and name:
            raise kind(str(path), f'column "{name}" is there twice', "leave one out")
    for number, fields in rows[1:]:
        if len(fields) != len(names):
            fault = f"{len(fields)} fields in line {number}, {len(names)} names"
            raise kind(str(path), fault, "give one field per name")
        if "" in names and any(f for f, name in zip(fields, names, strict=True) if not name):
            fault = f"a field in line {number} is below no name"
            raise kind(str(path), fault, "name its column, or leave it out")
    return names, rows[1:]


def _rows(text: str) -> Iterator[Row]:
    """Rows of a text, whose fields in quotes may go over several lines."""
    separator = ""
    lines = enumerate(io.StringIO(text, newline=""), 1)  # with their ends
    for number, line in lines:
        if line.isspace() or line.startswith("#"):
            continue
        separator = separator or (";" if line.count(";") > line.count(",") else ",")
        row = chain([line], (further for _, further in lines))
        yield number, _fields(next(csv.reader(row, delimiter=separator, strict=True)), separator)


def _fields(row: list[str], separator: str) -> list[str]:
    """Fields without blanks at their ends, with decimal points."""
    fields = [_read(field.strip()) for field in row]
    if separator == ",":
        return fields
    return [f.replace(",", ".") if DECIMAL.fullmatch(f) else f for f in fields]


def _read(field: str) -> str:
    """A field as it was before ``plain_text``."""
    parts = field.split(";")
    return ";".join(
        part[1:] if part[:1] == "'" and _is_formula(part[1:]) else part for part in parts
    )
