"""Machine file and URDF on the way to the disk: both or none, and nothing of somebody else's replaced unasked."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Mapping
from pathlib import Path

from armdesign import transaction
from armdesign.errors import MachineFileError

MADE = "# Made by armdesign"  # begins a comment at the top of files that hold a design
DIRECTIVE = "#:schema"  # begins the line that names an editor's JSON Schema

_written: set[str] = set()  # files that this process wrote, links followed


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
                written = (
                    folder / Path(os.path.realpath(path.parent)).relative_to(base) / path.name
                )
                written.parent.mkdir(parents=True, exist_ok=True)
                written.write_bytes(text.encode())
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise MachineFileError(
            str(first), f"cannot be written ({reason})", "name another place"
        ) from None
    _written.update(map(os.path.realpath, changed))


def _text(path: Path) -> str | None:
    """What a file holds; None where there is none, or no text."""
    try:
        return path.read_bytes().decode("utf-8")
    except (OSError, ValueError):
        return None


def tells_of_making(text: str) -> bool:
    """Whether the head of a machine file says that this package made it as a design."""
    lines = text.removeprefix("\ufeff").splitlines()
    heading = itertools.takewhile(lambda line: not line.strip() or line.startswith("#"), lines)
    return any(line.startswith(MADE) for line in heading)


def refuse_foreign(path: Path, text: str) -> None:
    """Raise if writing a machine file would replace one that this package did not make.

    It made what says so at its top, and what this process has written before.

    Args:
        path: of the machine file.
        text: to be written; a file that holds it already is not replaced by anything else.

    Raises:
        MachineFileError: there is such a file.
    """
    if not os.path.lexists(path) or path.is_dir():  # a folder is refused in any case
        return
    there = _text(path)
    ours = os.path.realpath(path) in _written or tells_of_making(there or "")
    if not ours and there != text:
        remedy = "name another place, or give overwrite=True"
        raise MachineFileError(str(path), "exists, and armdesign did not make it", remedy)


def schema_beside(text: str) -> tuple[str, str]:
    """The text with the JSON Schema that its ``#:schema`` line names beside it, and the schema's file name.

    The name is empty where the line is missing, or names an address or an absolute path, which
    hold anywhere.
    """
    line = re.search(rf"(?m)^{DIRECTIVE}[ \t]+(\S+)", text)
    if line is None or "://" in line[1] or Path(line[1]).is_absolute():
        return text, ""
    name = Path(line[1]).name
    return f"{text[: line.start(1)]}./{name}{text[line.end(1) :]}", name
