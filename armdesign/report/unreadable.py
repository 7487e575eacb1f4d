"""Why a ``report.json`` cannot be read: another version wrote it, or it is damaged."""

from __future__ import annotations

import json
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from armdesign.errors import ArmDesignError, printable

AGAIN = "run the command that wrote the folder again"
VERSION, COMMAND = "armdesign", "command"  # rows of the provenance


def unreadable(text: str, part: str, reads: int, place: str) -> ArmDesignError:
    """What is wrong with a text that this version cannot read.

    Args:
        text: of the file.
        part: the file.
        reads: the format that this version reads.
        place: where the text is not as expected, as a path of keys; "" where the format alone is.
    """
    known = _loosely(text)
    told = dict(_provenance(known.get("sections")))
    writer, reader, format_ = told.get(VERSION, ""), version("armdesign"), known.get("format")
    remedy = f"make it anew: {told[COMMAND]}" if COMMAND in told else AGAIN
    if isinstance(format_, int) and format_ != reads:
        whose = f"{writer}, format {format_}".removeprefix(", ")
        fault = f"another version of armdesign wrote it ({whose})"
        return ArmDesignError(part, f"{fault}; this one, {reader}, reads format {reads}", remedy)
    if writer and writer != reader:
        fault = f"another version of armdesign wrote it ({writer})"
        return ArmDesignError(part, f"{fault}; this one, {reader}, cannot read {place}", remedy)
    return ArmDesignError(part, f"is damaged: {_damage(text, place)}", remedy)


def lost_keys(known: Any, read: Any, place: str = "") -> Iterator[str]:
    """Paths of keys that a file lacks and ``read``, of what it says, has: all of them are written.

    Both without faults of types.
    """
    if isinstance(read, dict):
        for key, value in read.items():
            if key not in known:
                yield f"{place}{key}"
            else:
                yield from lost_keys(known[key], value, f"{place}{key}.")
    elif isinstance(read, tuple | list):
        for i, (one, other) in enumerate(zip(known, read, strict=True)):
            yield from lost_keys(one, other, f"{place}{i}.")


def _loosely(text: str) -> dict[str, Any]:
    """What a file says, whoever wrote it; nothing where it is no table."""
    try:
        known = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    return known if isinstance(known, dict) else {}


def _damage(text: str, place: str) -> str:
    try:
        json.loads(text)
    except json.JSONDecodeError as error:
        return f"it ends or breaks off at line {error.lineno}, column {error.colno}"
    except (ValueError, RecursionError):
        return "it is no JSON"
    return f"{place} is not what armdesign writes there" if place else "it is no report"


def _provenance(part: Any) -> Iterator[tuple[str, str]]:
    """Version and command from the tables of a report of whatever format."""
    if isinstance(part, dict):
        rows = part.get("rows")
        for row in rows if isinstance(rows, list) else ():
            if isinstance(row, list) and len(row) == 2 and row[0] in (VERSION, COMMAND):
                yield row[0], printable(str(row[1]))
        yield from _provenance(part.get("sheets"))
    elif isinstance(part, list):
        for one in part:
            yield from _provenance(one)
