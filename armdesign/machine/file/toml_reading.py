"""TOML text to data: where its keys stand, and the likeliest cause where it is no TOML.

Neither ``tomllib`` nor ``tomlkit`` (python-poetry/tomlkit, issue 55) tells where a key was read,
so the text is scanned once more: headers of tables, dotted and quoted keys, inline tables, lists.
Only text that ``tomllib`` has read without fault may be scanned.
"""

from __future__ import annotations

import bisect
import contextlib
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date, time
from functools import cached_property
from typing import Any

from armdesign.errors import ArmDesignError, MachineFileError
from armdesign.machine.file.key_paths import UNIT_END, UNITS
from armdesign.machine.file.schema import BY_ACTUATOR

DEEPEST = 32  # tables in tables, or parts of a dotted key; a machine file has six
MOST = {"tables": 1_000, "values": 20_000}  # values: keys, items of lists; a file has hundreds
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w.-])(?:{_PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}")
FEWER = "write the keys of a machine file, or of a study with cases in a CSV file"
_PLACE = re.compile(r"\(at line (\d+), column (\d+)\)$")


def read_toml(text: str, source: str) -> dict[str, Any]:
    """The data of a TOML text; ``source`` is its name in messages.

    Raises:
        MachineFileError: it is no TOML.
    """
    if long_key := _LONG_KEY.search(text):  # the parser's time grows with the square of its parts
        line = text.count("\n", 0, long_key.start()) + 1
        raise MachineFileError(source, f"a key has more than {DEEPEST} parts", FEWER, line)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        words, at_end = str(error).removesuffix("(at end of document)").strip(), True
    except ValueError:
        words, at_end = "a whole number of thousands of digits", False
    except RecursionError:
        words, at_end = "nested too deeply", False
    else:
        if excess := _excess(data):
            raise MachineFileError(source, excess, FEWER)
        _refuse_dates(data, KeyLines(text), source)
        return data
    place = _PLACE.search(words)
    if place is None:
        words += f" (at {_end_or_longest_line(text, at_end)})"
    elif fault := fault_of_line(text.split("\n")[int(place[1]) - 1], int(place[2])):
        words, column, remedy = fault
        words = f"not valid TOML: {words} (at line {place[1]}, column {column})"
        raise MachineFileError(source, words, remedy)
    xml = text.lstrip().startswith("<")  # most likely the URDF itself was given
    remedy = "give the .toml file that names the URDF" if xml else "correct the file at that place"
    raise MachineFileError(source, f"not valid TOML: {words}", remedy)


def _excess(data: dict[str, Any]) -> str:
    """Depth or number of values that no machine file has, in words; "" if neither."""
    level: list[Any] = [data]
    counts = dict.fromkeys(MOST, 0)
    for _ in range(DEEPEST):
        counts["tables"] += sum(isinstance(node, dict) for node in level)
        counts["values"] += sum(map(len, level))
        items = (node.values() if isinstance(node, dict) else node for node in level)
        level = [item for each in items for item in each if isinstance(item, dict | list)]
    if level:
        return f"more than {DEEPEST} tables or lists are within each other"
    excess = (kind for kind in MOST if counts[kind] > MOST[kind])
    return next((f"{counts[kind]} {kind}, more than {MOST[kind]}" for kind in excess), "")


def _refuse_dates(node: Any, lines: KeyLines, source: str, *keys: str) -> None:
    """Raise for a date or time, which TOML has and no key takes."""
    if isinstance(node, date | time):
        path, remedy = ".".join(keys), "give a number, or a text in quotes"
        fault = f"{node} is a date or time, which no key takes"
        raise MachineFileError(f"{source}: {path}", fault, remedy, lines.line_of(path))
    if isinstance(node, dict | list):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            _refuse_dates(value, lines, source, *keys, str(key))


def _end_or_longest_line(text: str, at_end: bool) -> str:
    """Line and column of what the parser found wrong without saying where.

    It is the end, or a huge number or a deep nest: then the longest line, of any file that was not
    built to make it another.
    """
    at = len(text) if at_end else text.index(max(text.split("\n"), key=len))
    return f"line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)}"


# -------------------------------------------------------------- numbers as TOML does not have them


_COMMA = re.compile(r"([+-]?\d[\d_]*),(\d+)")
_THOUSANDS = re.compile(r"[+-]?\d\d?\d?,\d\d\d")
_GROUPED = re.compile(r"[+-]?\d\d?\d?(?:(?:\.\d\d\d)+,\d+|(?:,\d\d\d)+\.\d+)")
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*)?")
_AT_END = re.compile(r"[=,\[]\s*([+-]?\d[\d_]*(?:\.\d[\d_]*)?(?:[eE][+-]?\d+)?)\s*$")
_UNIT = re.compile(r"(?:[A-Za-zµ°%][\w°%/³²·^]*)(?: [A-Za-z]\w*)*(?=\s*(?:[,\]}#]|$))")


def with_point(written: str) -> str:
    """Remedy for a number with a decimal comma."""
    point = written.replace(",", ".")
    if _THOUSANDS.fullmatch(written):
        return f"write {point}, or {written.replace(',', '')} where the comma parts thousands"
    return f"write {point}"


def without_groups(written: str) -> str:
    """A number without the separators between its thousands, and with a decimal point."""
    return re.sub(r"[.,](?=.*[.,])", "", written).replace(",", ".")


def fault_of_line(line: str, column: int) -> tuple[str, int, str] | None:
    """Fault of a number or share in a line that is no TOML, its column, and the remedy.

    ``column`` is where the parser stopped, counted from 1.
    """
    share = re.match(r"\s*([\w-]+)\.([\w-]+)\s*=\s*([\d.]+)", line)
    if share and share[1] in BY_ACTUATOR:
        remedy = f"write {share[1]} = {{ default = …, {share[2]} = {share[3]} }} for both"
        return f"{share[1]} is a number before", column, remedy
    if point := _bare_point(line):
        return "no digit on one side of a point", column, point
    if number := re.search(rf"(?<==)\s*({_GROUPED.pattern})", line):
        remedy = f"write {without_groups(number[1])}"
        return f"points and commas in {number[1]}", number.start(1) + 1, remedy
    if number := re.search(rf"(?<==)\s*({_COMMA.pattern})", line):
        comma = number.start(1) + number[1].index(",") + 1
        return f"a decimal comma in {number[1]}", comma, with_point(number[1])
    number, unit = _AT_END.search(line[: column - 1]), _UNIT.match(line, column - 1)
    if number and unit and not _other_notation(number[1], unit[0]):
        remedy = _without_unit(number[1], unit[0], line[: number.start(1)])
        return f"a unit behind the number {number[1]}", column, remedy
    return None


def _without_unit(number: str, unit: str, before: str) -> str:
    """Remedy for a number with a unit; ``before`` is the line up to the number, with its keys."""
    named = [UNIT_END.search(key) for key in re.findall(r"([\w-]+)[\"']?\s*=", before)]
    units = [UNITS[match[1]] for match in named if match]
    if not units:
        return "write the number alone"
    value = number if _same_unit(unit, units[-1]) else "the number alone"
    return f"write {value}: the key says that it is in {units[-1]}"


def _same_unit(one: str, other: str) -> bool:
    return one.replace(" ", "").lower() == other.replace(" ", "").lower()


def _bare_point(line: str) -> str:
    """Remedy for a line with a number that begins or ends with its point; "" if it has none."""
    match = re.search(r"[=,\[]\s*([+-]?)(?:(\.\d+)|(\d+)\.)\s*(?:[,\]}#\r]|$)", line)
    return f"write {match[1]}{f'0{match[2]}' if match[2] else f'{match[3]}.0'}" if match else ""


def list_meant(written: str, count: int) -> str:
    """A list of so many numbers that was written with decimal commas, as TOML has it; else ""."""
    points = _GROUPED.sub(lambda number: without_groups(number[0]), written)
    points = _COMMA.sub(r"\1.\2", points)
    try:
        items = tomllib.loads(f"list = {points}")["list"]
    except tomllib.TOMLDecodeError:
        return ""
    return f"[{', '.join(map(str, items))}]" * (points != written and len(items) == count)


def with_digits(number: str) -> str:
    """A number as TOML has it, with a digit on both sides of its point."""
    return re.sub(r"(?<!\d)\.", "0.", re.sub(r"\.(?!\d)", ".0", number))


def number_meant(text: str, unit: str) -> tuple[str, str]:
    """Fault of a text where a number belongs, and the remedy; "" where there is nothing to say."""
    text = text.strip()
    if _GROUPED.fullmatch(text):
        return "points and commas, and a text", f"write {without_groups(text)}"
    if _COMMA.fullmatch(text):
        return "decimal comma, and a text", with_point(text)
    if (match := _NUMBER.fullmatch(text)) and not _other_notation(match[1], match[2] or ""):
        written = with_digits(match[1])
        if not (match[2] and unit):
            if written != match[1]:
                return "no digit beside the point, and a text", f"write {written}"
            return "", f"write it without quotes: {written}"
        number = f": {written}" if _same_unit(match[2], unit) else ""  # nothing is converted
        return "", f"write the number alone, in {unit}{number}"
    return "", ""


def _other_notation(number: str, rest: str) -> bool:
    """Whether what follows digits is no unit but more of a number, as in 6_0 and 0x3c."""
    return rest.startswith("_") or (number == "0" and rest.startswith(("x", "o", "b")))


# ----------------------------------------------------------------------------------- lines of keys


Keys = tuple[str, ...]
_SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\r\n]*")
_QUOTED = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}(?!")' r"|'''.*?'{3,5}(?!')" r'|"(?:\\.|[^"\\\n])*"' r"|'[^'\n]*'",
    re.DOTALL,
)


@dataclass(frozen=True)
class KeyLine:
    """Line of a key, counted from 1, and its value as it is written; "" of a table."""

    line: int
    written: str


def tell_line(error: ArmDesignError, key_lines: KeyLines, source: str) -> None:
    """Give an error the line of the key that it names, if it is about a key of this file."""
    if error.part.startswith(f"{source}: "):
        error.tell_line(key_lines.line_of(error.part.removeprefix(f"{source}: ")))
    elif error.key:
        error.tell_line(key_lines.line_of(error.key), source)


@contextlib.contextmanager
def lines_of(text: str, source: str) -> Iterator[None]:
    """Within it, errors about keys of a file say the line of its text, if it has the key.

    The text is without fault wherever a key is spoken of; ``source`` is its name in messages.
    """
    try:
        yield
    except ArmDesignError as error:
        tell_line(error, KeyLines(text), source)
        raise


class KeyLines:
    """Lines and values of all keys of a TOML text without fault."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._lines: dict[Keys, KeyLine] = {}

    @cached_property
    def by_path(self) -> dict[str, KeyLine]:
        """Line of every key, list item and table (header, or the key that makes it) by path."""
        table: Keys = ()
        at = self._past_space(0)
        while at < len(self._text):
            if self._text[at] == "[":
                brackets = 2 if self._text.startswith("[[", at) else 1
                table, end = self._key(at + brackets)
                self._note(table, at, "")
                at = self._text.index("]", end) + brackets
            else:
                at = self._pair(table, at)
            at = self._past_space(at)
        return {".".join(keys): place for keys, place in self._lines.items()}

    def line_of(self, path: str) -> int | None:
        """Line of a key path, or of the nearest table above it in the text; None if neither."""
        while path and path not in self.by_path:
            path = path.rpartition(".")[0]
        return self.by_path[path].line if path else None

    def written(self, path: str) -> str:
        """The value at a key path as it is written; "" where there is none."""
        return self.by_path[path].written if path in self.by_path else ""

    @cached_property
    def _line_ends(self) -> list[int]:
        return [match.start() for match in re.finditer("\n", self._text)]

    def _note(self, keys: Keys, at: int, written: str) -> None:
        """Note a key that stands at ``at``, and the tables that it makes."""
        line = bisect.bisect_left(self._line_ends, at) + 1
        for depth in range(1, len(keys)):
            self._lines.setdefault(keys[:depth], KeyLine(line, ""))
        self._lines[keys] = KeyLine(line, written)

    def _past_space(self, at: int) -> int:
        match = _SPACE.match(self._text, at)
        return match.end() if match else at

    def _key(self, at: int) -> tuple[Keys, int]:
        """The parts of a dotted key and where it ends."""
        parts: list[str] = []
        while True:
            at = self._past_space(at)
            if quoted := _QUOTED.match(self._text, at):
                parts.append(str(tomllib.loads(f"key = {quoted[0]}")["key"]))
            match = quoted or _BARE.match(self._text, at)
            if match is None:
                raise ValueError(f"no key at {at}: the text is not TOML")
            if not quoted:
                parts.append(match[0])
            at = self._past_space(match.end())
            if self._text[at] != ".":
                return tuple(parts), at
            at += 1

    def _pair(self, table: Keys, at: int) -> int:
        """Read ``key = value``; where it ends."""
        key, equals = self._key(at)
        start = self._past_space(equals + 1)
        end = self._value((*table, *key), start)
        self._note((*table, *key), at, self._text[start:end].rstrip())
        return end

    def _value(self, keys: Keys, at: int) -> int:
        """Read a value and what is in it; where it ends."""
        opening = self._text[at]
        if opening not in "[{":
            match = _QUOTED.match(self._text, at) or _SCALAR.match(self._text, at)
            return match.end() if match else at
        at, index = self._past_space(at + 1), 0
        while self._text[at] not in "]}":
            if self._text[at] == ",":
                at += 1
            elif opening == "{":
                at = self._pair(keys, at)
            else:
                end = self._value((*keys, str(index)), at)
                self._note((*keys, str(index)), at, self._text[at:end].rstrip())
                at, index = end, index + 1
            at = self._past_space(at)
        return at + 1
