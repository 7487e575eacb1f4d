"""The answer of a command as one JSON document, for other programs, and its schema."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ConfigDict, Field

from armdesign.csv_rows import DIGITS, digits_of
from armdesign.errors import ArmDesignError

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.arrays import Array
    from armdesign.report.sheet import Sheet

    Tables = Mapping[str, pd.DataFrame | Mapping[str, Array]]

Cell = int | float | str | bool | None


class Part(BaseModel):
    """A part of the document, without other keys than its own."""

    model_config = ConfigDict(extra="forbid")


class Fault(Part):
    """A fault of the input, as on stderr."""

    part: str = Field(description="what is at fault: a key path, a file, an option, a cylinder")
    fault: str = Field(description="value with unit and allowed range")
    remedy: str = Field(description="what to do about it; may be empty")
    line: int | None = Field(description="line of the machine file; null where it has none")
    table: str = Field(description="what more there is to say, in lines: of requirements, amounts")


class PrintedSheet(Part):
    """A table as it is printed, in the units of --units."""

    title: str = Field(description="of the table")
    columns: list[str] = Field(description="heads with units; empty: names and values")
    rows: list[list[str]] = Field(description="cells as printed")
    note: str = Field(description="what to know about the table; may be empty")


class Document(Part):
    """The answer of an armdesign command with --json: one document on stdout, also of faults."""

    armdesign: str = Field(description="version of armdesign")
    command: str = Field(description="name of the command, as map")
    command_line: str = Field(description="the command as typed")
    finished: bool = Field(
        default=False, description="whether it ran to its end: false after faults and Ctrl-C"
    )
    numbers: dict[str, Cell] = Field(
        default={}, description="what the answer comes down to, by name, in SI"
    )
    tables: dict[str, list[dict[str, Cell]]] = Field(
        default={}, description="rows by the name of the CSV file that has them, with its columns"
    )
    sheets: list[PrintedSheet] = Field(default=[], description="tables as printed")
    sentences: list[str] = Field(default=[], description="sentences as printed")
    folder: str | None = Field(default=None, description="where the files are; null: no files")
    files: list[str] = Field(default=[], description="files written, in the folder")
    faults: list[Fault] = Field(default=[], description="what is wrong with the input")

    def add(self, items: Any) -> None:
        """Add sheets and sentences as they are printed."""
        self.sentences += [item for item in items if isinstance(item, str)]
        self.sheets += [_printed(item) for item in items if not isinstance(item, str)]

    def add_answers(self, numbers: Mapping[str, Any], tables: Tables) -> None:
        """Add numbers by name, and tables by the name of their CSV file."""
        self.numbers |= {name: _value(value) for name, value in numbers.items()}
        for name, table in tables.items():
            columns = {str(head): column.tolist() for head, column in table.items()}
            digits = {head: digits_of(head, cells) for head, cells in columns.items()}
            written = [[_value(c, digits[head]) for c in cells] for head, cells in columns.items()]
            rows = zip(*written, strict=True)
            self.tables[name] = [dict(zip(columns, row, strict=True)) for row in rows]

    def add_fault(self, error: ArmDesignError) -> None:
        """Add a fault."""
        words = {"part": error.part, "fault": error.fault, "remedy": error.remedy}
        self.faults.append(Fault(**words, line=error.line, table=error.table))

    def text(self) -> str:
        """The document, in which no number is infinite or missing but null."""
        return json.dumps(self.model_dump(), indent=1, allow_nan=False)


def schema() -> str:
    """JSON Schema of the document, with the meaning of the numbers' names."""
    from armdesign.sweeps.numbers import MEANINGS

    described = Document.model_json_schema()
    described["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    names = {name: {"description": text} for name, text in MEANINGS.items() if "<" not in name}
    numbers = described["properties"]["numbers"]
    numbers["properties"] = names
    families = "; ".join(f"{name}: {text}" for name, text in MEANINGS.items() if "<" in name)
    numbers["description"] += f". Further names – {families}"
    return json.dumps(described, indent=1, ensure_ascii=False) + "\n"


def _printed(sheet: Sheet) -> PrintedSheet:
    return PrintedSheet(
        title=sheet.title,
        columns=list(sheet.columns),
        rows=[list(row) for row in sheet.rows],
        note=sheet.note,
    )


def _value(value: Any, digits: int = DIGITS) -> Cell:
    """A cell as JSON has it: numbers with the digits of CSV files, what is missing as null."""
    plain = value.item() if hasattr(value, "item") else value
    if plain is None or isinstance(plain, bool | int):
        return plain
    if isinstance(plain, float):
        return float(f"{plain:.{digits}g}") if math.isfinite(plain) else None
    return str(plain)
