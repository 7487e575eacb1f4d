"""The machine file: its text, and the checked data in it.

A fault is answered with file, key path, value, range and remedy.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from armdesign import text_files
from armdesign.errors import MachineFileError
from armdesign.machine.file.contradictions import contradictions
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.file.schema_faults import (
    STAND_IN,
    explained,
    first_fault,
    location_of,
    mend,
    of_name,
    unnamed_tables,
)
from armdesign.machine.file.section import plain
from armdesign.machine.file.toml_reading import KeyLines, lines_of, read_toml
from armdesign.text_files import LARGEST_MACHINE_FILE, LARGEST_URDF

MENDING = 8  # passes in which tables that stand in for others are filled
MOST = 200  # faults of the schema that are told at once


def path_of(value: str | Path) -> Path:
    """The path that a text may be.

    Raises:
        MachineFileError: it is none, too long for one, or in a folder that may not be read.
    """
    try:
        path = Path(value)
        path.is_dir()
    except TypeError:
        raise MachineFileError(str(value), "is not a path", "give a path or a name") from None
    except OSError as error:
        raise unreadable(path, error) from None
    return path


def unreadable(path: Path, error: OSError | ValueError) -> MachineFileError:
    """The error of a path that cannot be read, by what the system says."""
    reason = getattr(error, "strerror", None) or error
    part = str(path) if getattr(error, "errno", None) != errno.ENAMETOOLONG else f"{path!s:.60}…"
    return MachineFileError(part, f"cannot be read ({reason})", "check the path")


def read_text(path: Path, largest: int = LARGEST_MACHINE_FILE) -> str:
    """Text of a machine file or URDF of at most so many bytes.

    Raises:
        MachineFileError: the file is missing, too large, no regular file or no text.
    """
    try:
        # line ends stay as they are: saving changes values only
        return text_files.read(path, largest)
    except FileNotFoundError:
        raise MachineFileError(str(path), "no such file", "check the path") from None
    except UnicodeDecodeError:
        raise MachineFileError(str(path), "is not UTF-8 text", "save it as UTF-8") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path
        raise unreadable(path, error) from None


def leads_out(folder: Path, urdf: str) -> bool:
    """Whether a URDF's path, symbolic links followed, ends outside a folder."""
    try:
        return not Path(os.path.realpath(folder / urdf)).is_relative_to(os.path.realpath(folder))
    except ValueError:  # a NUL in the path, which reading refuses
        return False


def read_urdf(path: Path, section: MachineSection, allow_outside: bool) -> str:
    """Text of the URDF that the machine file at a path names, relative to it.

    Empty where the file has ``[links]`` in its place.

    Raises:
        MachineFileError: it lies outside of the file's folder, is missing or is no text.
    """
    part, urdf = f"{path.name}: urdf", section.urdf
    if urdf is None:
        return ""
    if not allow_outside and leads_out(path.parent, urdf):
        allow = "--allow-outside, in Python load(…, allow_outside=True)"
        remedy = f"put it beside the file, or allow it: {allow}"
        raise MachineFileError(part, f'"{urdf}" is outside the folder of the machine file', remedy)
    try:
        return read_text(path.parent / urdf, LARGEST_URDF)
    except MachineFileError as error:
        raise MachineFileError(part, f'"{urdf}": {error.fault}', error.remedy) from None


def parse(text: str, source: str) -> MachineSection:
    """The data of a machine file's text, checked against the schema; ``source`` is its name.

    Raises:
        MachineFileError: not TOML, or a key that is missing, unknown, of a wrong type or out of
            its range.
    """
    data = read_toml(text, source)
    with lines_of(text, source):
        for unnamed in unnamed_tables(data, source):
            raise unnamed
        try:
            section = MachineSection.model_validate(data)
        except ValidationError as error:
            raise first_fault(error, source, KeyLines(text)) from None
        for fault in contradictions(section, source):
            raise fault
    return section


def faults(
    text: str, source: str
) -> tuple[MachineSection | None, list[MachineFileError], set[str]]:
    """Faults that a machine file's text has by itself, not the first alone, but at most 200.

    Returns the file with stand-ins where it is wrong (None where it is no TOML), its faults, and
    the key paths at which a stand-in stands.
    """
    try:
        data = read_toml(text, source)
    except MachineFileError as error:
        return None, [error], set()
    all_faults: list[MachineFileError] = list(unnamed_tables(data, source))
    wrong = {fault.part.removeprefix(f"{source}: ") for fault in all_faults}
    unnamed, key_lines, stand_ins = frozenset(wrong), KeyLines(text), False
    unusable = set[str]()  # names of tables, taken out with them: others may point there
    for _ in range(MENDING):
        try:
            section = MachineSection.model_validate(data)
            break
        except ValidationError as error:
            invalid = error.errors(include_url=False)
            if not stand_ins:  # later ones are faults of stand-ins
                named = [fault for fault in invalid if fault["loc"][0] not in unnamed]
                all_faults += [explained(fault, source, key_lines) for fault in named[:MOST]]
                unusable |= {f'"{location_of(fault)[-1]}"' for fault in named if of_name(fault)}
            stand_ins = True
            for location in map(location_of, invalid):
                wrong.add(".".join(map(str, location)))
                mend(data, location)
    else:
        return None, all_faults, wrong
    tables = {_table(path) for path in wrong}
    all_faults += [
        fault
        for fault in contradictions(section, source)
        if _table(fault.part.removeprefix(f"{source}: ")) not in tables
        and not any(name in str(fault) for name in (STAND_IN, *unusable))
    ]
    return section, all_faults, wrong


def flat(section: MachineSection) -> dict[str, Any]:
    """Every value of a machine file by its key path, defaults included; lists whole."""
    return dict(_leaves(plain(section)))


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Values that differ, of one and the other by key path; None where one has none."""
    pairs = {path: (one.get(path), other.get(path)) for path in {**one, **other}}
    return {path: pair for path, pair in pairs.items() if pair[0] != pair[1]}


def _leaves(table: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, item in table.items():
        if isinstance(item, dict):
            yield from _leaves(item, f"{before}{key}.")
        elif item is not None:
            yield f"{before}{key}", item


def _table(path: str) -> str:
    """Table whose keys must agree: ``cylinder.boom`` of ``cylinder.boom.rod_mm``."""
    words = path.split(".")
    return ".".join(words[: 2 if words[0] in ("payload", "cylinder", "spring") else 1])
