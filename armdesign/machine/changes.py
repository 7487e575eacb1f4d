"""Changes of numbers and words of a machine file, by key path and value."""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

from armdesign.errors import ArmDesignError, MachineFileError
from armdesign.machine.changed_parts import refuse_changed_parts
from armdesign.machine.file.key_paths import Location, is_requirement
from armdesign.machine.file.machine_file import flat
from armdesign.machine.file.numbers import chosen_numbers, numbers_of
from armdesign.machine.file.toml_writing import edit
from armdesign.machine.machine import Machine

SHOWN = 3  # changes in a message


def read_changes(words: Sequence[str], part: str = "what-if") -> dict[str, Any]:
    """Changes stated as ``KEY=VALUE``, values as in TOML; what is no TOML value is a text.

    ``part`` is what states them, for messages.

    Raises:
        ArmDesignError: a word without key or value, or a key twice.
    """
    changes: dict[str, Any] = {}
    for word in words:
        path, equals, value = (part.strip() for part in word.partition("="))
        if not (path and equals and value):
            remedy = "give KEY=VALUE, as cylinder.boom.bore_mm=125"
            raise ArmDesignError(part, f'"{word}" is not understood', remedy)
        if path in changes:
            raise ArmDesignError(f"{part} {path}", "is there twice", "leave one out")
        changes[path] = toml_value(value)
    return changes


def toml_value(text: str) -> Any:
    """A value as in TOML, or the text itself where it is none."""
    try:
        lines = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):  # no TOML, or a whole number of 5000 digits
        return text
    return lines["value"] if len(lines) == 1 else text


def changed_machine(
    machine: Machine, changes: Mapping[str, Any], part: str = "what-if", *, check: bool = True
) -> Machine:
    """The machine with other values at key paths; of a list, each number has one, as ``at_mm.0``.

    Args:
        machine: the machine.
        changes: values by key path; below ``requirements`` also tables, and keys that the file
            leaves out. A key path within another changes what that one gives.
        part: what states them, for messages.
        check: whether the machine must fit together; one that does not can be drawn.

    Raises:
        ArmDesignError: a path or value that the file cannot have, or a part changed in memory.
    """
    if not changes:
        raise ArmDesignError(part, "nothing changes", f"give KEY=VALUE, as {_example(machine)}")
    refuse_changed_parts(machine)
    known, whole = flat(machine.section), dict[str, Any]()
    for path, value in changes.items():
        table, _, leaf = path.rpartition(".")
        if leaf.isdigit() and isinstance(known.get(table), list):
            if table in changes:
                fault = f"is one of the numbers of {table}, which is given, too"
                raise ArmDesignError(f"{part} {path}", fault, "leave one out")
            number = chosen_numbers(machine.section, path, f"{part} {path}")[0]
            row = list(whole.get(table, known[table]))
            row[int(number.location[-1])] = value
            whole[table] = row
        else:
            if path == "urdf":  # is read with the file
                remedy = "write a machine file that names it"
                raise ArmDesignError(f"{part} urdf", "is another file, no number of this", remedy)
            if path not in known and not is_requirement(tuple(path.split("."))):
                _refuse_unknown(machine, path, f"{part} {path}")
            whole[path] = value
    values = dict[str, Any]()
    for path, value in sorted(whole.items(), key=lambda item: item[0].count(".")):
        within = _is_within_another(path, whole, part)
        new = _as_before(known.get(path), value)
        if within or not _same(known.get(path), new):
            values[path] = new
    source = machine.source
    try:
        if check:
            return machine.replace(values)
        text = edit(machine.text, values, source.name)
        return Machine.unchecked(text, machine.urdf_text, source)
    except MachineFileError as error:
        _blame(error, changes, part, source.name)
        raise


def _is_within_another(path: str, changes: Mapping[str, Any], part: str) -> bool:
    """Whether a key path above this one changes, too: it then changes what that one gives.

    Raises:
        ArmDesignError: one of them gives the value at the path already.
    """
    keys = path.split(".")
    wholes = [table for table in accumulate(keys[:-1], "{}.{}".format) if table in changes]
    for table in wholes:
        inner = changes[table]
        for key in keys[table.count(".") + 1 :]:
            inner = inner.get(key) if isinstance(inner, Mapping) else None
        if inner is not None:
            fault = f"is in {table}, which is given, too"
            raise ArmDesignError(f"{part} {path}", fault, "leave one out")
    return bool(wholes)


def _blame(error: MachineFileError, changes: Mapping[str, Any], part: str, source: str) -> None:
    """Name the change at fault, not the file's line; beside another key, all changes."""
    at, line = error.part.removeprefix(f"{source}: "), error.line
    own = [
        path for path in changes if f"{at}.".startswith(f"{path}.") or path.startswith(f"{at}.")
    ]
    if own:
        error.part, line = f"{part} {own[0]}", None
    else:
        stated = [f"{path}={value}" for path, value in changes.items()]
        more = f" and {len(stated) - SHOWN} more" if len(stated) > SHOWN else ""
        error.part = f"{part} {', '.join(stated[:SHOWN])}{more}: {at}"
    error.tell_line(line, source)


def _example(machine: Machine) -> str:
    """A change that the machine's file could have."""
    for name, cylinder in machine.section.cylinder.items():
        return f"cylinder.{name}.bore_mm={cylinder.bore_mm + 5:g}"
    return f"fluid.bulk_modulus_MPa={machine.section.fluid.bulk_modulus_MPa + 100:g}"


def _refuse_unknown(machine: Machine, path: str, part: str) -> None:
    """Raise unless the schema has a value at a path that the file leaves out."""
    try:
        chosen_numbers(machine.section, path, part)
    except ArmDesignError as error:
        if error.fault != "has no value in the file":
            raise


def _as_before(before: Any, value: Any) -> Any:
    """A whole number as a float where the file has floats."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    if isinstance(value, list):
        return [_as_before(0.0, item) for item in value]
    if not whole or isinstance(before, int | str) or abs(value) > sys.float_info.max:
        return value
    return float(value)


def _same(before: Any, value: Any) -> bool:
    """Whether a value is the one that the file has: its text then stays, however written."""
    return type(before) is type(value) and before == value


def numeric_changes(machine: Machine, other: Machine) -> dict[Location, tuple[float, float]]:
    """Every number of the file that differs in another, before and after, by key path.

    Empty if anything else differs: a count, a word, or a number that one file lacks.
    """
    one, two = flat(machine.section), flat(other.section)
    before, after = numbers_of(machine.section), numbers_of(other.section)
    if one.keys() != two.keys() or before.keys() != after.keys():
        return {}
    for path, value in one.items():
        numeric = path in before or (isinstance(value, list) and f"{path}.0" in before)
        if value != two[path] and not numeric:
            return {}
    return {
        number.location: (number.value, after[path].value)
        for path, number in before.items()
        if number.value != after[path].value
    }
