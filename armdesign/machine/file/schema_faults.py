"""Faults that the schema finds in a machine file, in the package's words and with a likely cause.

A fault names file, key path, value, range and remedy.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import ValidationError

from armdesign.errors import MachineFileError
from armdesign.machine.file.key_paths import (
    Location,
    allowed,
    annotation,
    bounds,
    is_table,
    lengths,
    unit_of,
    unwrap,
)
from armdesign.machine.file.likely_values import USUAL, is_usual_at, likely_units
from armdesign.machine.file.schema import FORMS, MachineSection
from armdesign.machine.file.section import NAME_RULE
from armdesign.machine.file.toml_reading import KeyLines, list_meant, number_meant

FEW = 20  # entries of a table, above which a message says how many there are


def first_fault(error: ValidationError, source: str, key_lines: KeyLines) -> MachineFileError:
    """The fault that most likely holds the remedy, and how many more there are.

    An unknown key next to a missing one is most likely a misspelling, so it comes first.
    """
    faults = error.errors(include_url=False)
    fault = next((f for f in faults if f["type"] == "extra_forbidden"), faults[0])
    more = f" ({len(faults) - 1} more in this file)" if len(faults) > 1 else ""
    return explained(fault, source, key_lines, more)


def unnamed_tables(data: Any, source: str) -> Iterator[MachineFileError]:
    """Tables of named entries with an entry's own keys: ``[spring]`` for ``[spring.name]``."""
    for key, field in MachineSection.model_fields.items():
        entries, table = unwrap(field.annotation)[0], data.get(key)
        if get_origin(entries) is not dict or not isinstance(table, dict):
            continue
        entry = unwrap(get_args(entries)[-1])[0]
        own = [name for name, value in table.items() if not isinstance(value, dict)]
        if is_table(entry) and set(own) & set(entry.model_fields):
            fault = f"has no name beside the keys of one {key}, {', '.join(own)}"
            yield MachineFileError(f"{source}: {key}", fault, f"write [{key}.…] with a name")


def location_of(fault: Any) -> Location:
    """Key path of a fault."""
    return tuple(part for part in fault["loc"] if part not in ("[key]", *FORMS))


def of_name(fault: Any) -> bool:
    """Whether a fault is that of the name of a table."""
    return bool(fault["loc"][-1:] == ("[key]",))


def explained(fault: Any, source: str, key_lines: KeyLines, more: str = "") -> MachineFileError:
    """One fault of the schema, the most likely cause first; ``more`` ends its remedy."""
    location = location_of(fault)
    path = ".".join(str(part) for part in location)
    words, remedy = _words(fault, location, key_lines.written(path))
    return MachineFileError(f"{source}: {path}", words, remedy + more)


def _words(fault: Any, location: Location, written: str) -> tuple[str, str]:
    """Words and remedy of a fault; ``written`` is the value as the file has it."""
    may_be = allowed(location)
    if fault["type"] == "missing":
        return "missing", f"add {location[-1]}: {may_be}"
    if fault["type"] == "extra_forbidden":
        known = annotation(location[:-1])[0].model_fields
        close = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
        keys = f"known keys: {', '.join(known)}"
        return "unknown key", f'did you mean "{close[0]}"?' if close else keys
    if of_name(fault):
        return "is not a usable name", NAME_RULE
    words = f"{_shown(fault['input'])} is not allowed"
    remedy = f"give {may_be or 'another value'}"
    cause, correction = _likely_cause(fault["input"], location, written)
    if cause:
        return f"{cause}: {words}", f"{correction}; {remedy}"
    return words, f"{remedy}; {correction}" if correction else remedy


def _likely_cause(value: Any, location: Location, written: str) -> tuple[str, str]:
    """Likeliest meaning of a value that is not allowed, and the correction; "" if unknown."""
    kind, constraints = annotation(location)
    if kind in (int, float) and isinstance(value, str):
        return number_meant(value, unit_of(location).strip())
    if isinstance(value, list) and get_origin(kind) is list:
        points = list_meant(written, lengths(constraints)[1] or 0) if written else ""
        return ("decimal commas", f"write {points}") if points else ("", "")
    if location[-1] == "catalogue" and str(value).endswith(".csv"):
        return "", f"sizes of your own go with a command: --catalogue {_shown(value)}"
    if kind is float:
        lower, upper = bounds(location)
        plausible = is_usual_at(location) if location[-1] in USUAL else lambda x: lower < x < upper
        if other := likely_units(location, value, plausible):
            return f"looks like {other.unit}", other.remedy
    return "", ""


def _shown(value: Any) -> str:
    """A value as a message shows it."""
    if isinstance(value, dict):
        many = f" of {len(value)} entries" * (len(value) > FEW)
        return f"a table{many}" if value else "an empty table"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    if isinstance(value, list):
        text = f"[{', '.join(_shown(item) for item in value)}]"
    elif isinstance(value, str):
        text = f'"{value}"'
    return text if len(text) <= 60 else text[:57] + "…"


# -------------------------------------------------------------------------------------- stand-ins


STAND_IN = "stand_in"  # a name that no file gives: faults that speak of it are none of the file's


def mend(data: Any, location: Location) -> None:
    """Take out what is wrong at a key path, or put a stand-in where something is needed.

    A name is needed where one is written: a link without parent would be a root, not a joint.
    """
    node = data
    try:
        for key in location[:-1]:
            node = node[key]
        parent, _ = annotation(location[:-1])
    except (KeyError, IndexError, TypeError):
        return  # gone with a table that was wrong as a whole
    fields = parent.model_fields if is_table(parent) else {}
    leaf = location[-1]
    if isinstance(node, list):
        if leaf < len(node):
            node[leaf] = _stand_in(location)
    elif leaf in fields and (fields[leaf].is_required() or annotation(location)[0] is str):
        node[leaf] = _stand_in(location)
    else:
        node.pop(leaf, None)


def _stand_in(location: Location) -> Any:
    """A value that the schema allows at a key path, tables empty."""
    kind, constraints = annotation(location)
    if get_origin(kind) is Literal:
        return get_args(kind)[0]
    if kind in (float, int):
        return kind(1)
    if get_origin(kind) is list:
        return [_stand_in((*location, 0))] * lengths(constraints)[0]
    if kind is str:
        return STAND_IN
    return {STAND_IN: {}} if get_origin(kind) is dict else {}
