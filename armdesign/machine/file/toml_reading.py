"""TOML text to data; what is wrong with a text that is no TOML, and the likeliest cause."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from armdesign.errors import MachineFileError
from armdesign.machine.file.number_writing import fault_of_line

_PLACE = re.compile(r"\(at line (\d+), column (\d+)\)$")


def read_toml(text: str, source: str) -> dict[str, Any]:
    """The data of a TOML text.

    Args:
        text: TOML.
        source: file name for messages.

    Raises:
        MachineFileError: it is no TOML.
    """
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, or a whole number of 5000 digits
        words = str(error).removesuffix("(at end of document)").strip()
        at_end = isinstance(error, tomllib.TOMLDecodeError)
    except RecursionError:
        words, at_end = "nested too deeply", False
    place = _PLACE.search(words)
    if place is None:
        words += f" (at {_end_or_longest_line(text, at_end)})"
    elif fault := fault_of_line(text.split("\n")[int(place[1]) - 1], int(place[2])):
        problem, column, remedy = fault
        problem = f"not valid TOML: {problem} (at line {place[1]}, column {column})"
        raise MachineFileError(source, problem, remedy)
    xml = text.lstrip().startswith("<")  # most likely the URDF itself was given
    remedy = "give the .toml file that names the URDF" if xml else "correct the file at that place"
    raise MachineFileError(source, f"not valid TOML: {words}", remedy)


def _end_or_longest_line(text: str, at_end: bool) -> str:
    """Line and column of what the parser found wrong without saying where.

    It is the end, or a huge number or a deep nest: then the longest line, of any file that was not
    built to make it another.
    """
    at = len(text) if at_end else text.index(max(text.split("\n"), key=len))
    return f"line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)}"
