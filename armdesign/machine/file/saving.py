"""Saving a machine file with its URDF: both or none, and no foreign file is replaced unasked."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from armdesign import text_files, transaction
from armdesign.errors import MachineFileError
from armdesign.machine.file import machine_file
from armdesign.machine.file.json_schema import json_schema
from armdesign.machine.file.toml_writing import edit
from armdesign.text_files import LARGEST_URDF

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

MADE = "# Made by armdesign"  # begins a comment at the top of files that hold a design
DIRECTIVE = "#:schema"  # begins the line that names an editor's JSON Schema

_written: set[str] = set()  # files that this process wrote, links followed


def files(machine: Machine, path: str | Path) -> dict[Path, str]:
    """Paths and texts that ``save`` writes: machine file, URDF, JSON Schema if it is missing.

    A file with ``[links]`` has no URDF.

    Raises:
        MachineFileError: a path that no machine file can have.
    """
    target, text = machine_file.path_of(path), machine.text
    if target.suffix != ".toml":
        raise MachineFileError(str(target), "is not a .toml path", "end the name in .toml")
    named, own = machine.section.urdf, dict[Path, str]()
    if named is not None:
        urdf = target.parent / named
        if any(machine_file.leads_out(file.parent, named) for file in (machine.source, target)):
            urdf = target.parent / Path(named).name
            text = edit(text, {"urdf": urdf.name}, machine.source.name)
        if urdf == target:
            remedy = "give machine file and URDF two names"
            raise MachineFileError(str(urdf), "is the name of the URDF too", remedy)
        own = {urdf: machine.urdf_text}
    text, schema = _with_schema_beside(text)
    place = target.parent / schema
    missing = {place: json_schema()} if schema and not place.exists() else {}
    return {target: text, **own, **missing}


def save(machine: Machine, path: str | Path, overwrite: bool) -> Path:
    """Write the files of a machine, and return the path of the machine file.

    Raises:
        MachineFileError: a place that cannot be written, or holds a file of somebody else.
    """
    texts = files(machine, path)
    target = next(iter(texts))
    if not overwrite:
        refuse_foreign(target, texts[target])
        if urdf := other_urdf(machine, texts):
            remedy = "save into another folder, or give overwrite=True"
            raise MachineFileError(str(urdf), "another URDF of this name exists", remedy)
    write_files(texts)
    return target


def other_urdf(machine: Machine, texts: Mapping[Path, str]) -> Path | None:
    """The URDF that writing a machine's ``files`` would replace by another; None if none."""
    _, *others = texts
    urdf = others[0] if machine.section.urdf is not None else None
    present = (_text(urdf) or "").removeprefix("\ufeff") if urdf and urdf.is_file() else None
    return None if present in (None, machine.urdf_text) else urdf


def write_files(texts: Mapping[Path, str]) -> None:
    """Write files of one folder and those below it, all of them or none.

    The first names the folder.

    Raises:
        MachineFileError: a file or folder that cannot be written.
    """
    first = next(iter(texts))
    changed = [path for path, text in texts.items() if _text(path) != text]
    try:
        with transaction.staged(first.parent) as folder:
            base = os.path.realpath(first.parent)
            for path, text in texts.items():
                within = Path(os.path.realpath(path.parent)).relative_to(base)
                (folder / within).mkdir(parents=True, exist_ok=True)
                (folder / within / path.name).write_bytes(text.encode())
    except (OSError, ValueError) as error:
        fault = f"cannot be written ({getattr(error, 'strerror', None) or error})"
        raise MachineFileError(str(first), fault, "name another place") from None
    _written.update(map(os.path.realpath, changed))


def _text(path: Path) -> str | None:
    """Text of a file; None where there is none, or it is no text."""
    try:
        return text_files.read(path, LARGEST_URDF)
    except (OSError, ValueError):
        return None


def is_made(text: str) -> bool:
    """Whether the head of a machine file says that this package made it as a design."""
    lines = text.removeprefix("\ufeff").splitlines()
    heading = itertools.takewhile(lambda line: not line.strip() or line.startswith("#"), lines)
    return any(line.startswith(MADE) for line in heading)


def refuse_foreign(path: Path, text: str) -> None:
    """Raise if writing a machine file would replace one that this package did not make.

    It made what says so at its top, and what this process has written before. A file that holds
    the text already is not replaced by anything else.

    Raises:
        MachineFileError: there is such a file.
    """
    if not os.path.lexists(path) or path.is_dir():  # a folder is refused in any case
        return
    present = _text(path)
    ours = os.path.realpath(path) in _written or is_made(present or "")
    if not ours and present != text:
        remedy = "name another place, or give overwrite=True"
        raise MachineFileError(str(path), "exists, and armdesign did not make it", remedy)


def _with_schema_beside(text: str) -> tuple[str, str]:
    """The text with the schema of its ``#:schema`` line beside it, and the schema's file name.

    The name is empty where the line is missing, or names an address or an absolute path, which
    hold anywhere.
    """
    line = re.search(rf"(?m)^{DIRECTIVE}[ \t]+(\S+)", text)
    if line is None or "://" in line[1] or Path(line[1]).is_absolute():
        return text, ""
    name = Path(line[1]).name
    return f"{text[: line.start(1)]}./{name}{text[line.end(1) :]}", name
