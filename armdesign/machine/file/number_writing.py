"""Numbers that are written as TOML does not have them: with a decimal comma, a unit, in quotes."""

from __future__ import annotations

import re
import tomllib

from armdesign.machine.file.key_paths import UNIT_END, UNITS

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
    """What is wrong with a number in a line that is no TOML, its column, and what to write.

    Args:
        line: of the file.
        column: where the parser stopped, counted from 1.
    """
    if point := _bare_point(line):
        return "no digit on one side of a point", column, point
    if number := re.search(rf"(?<==)\s*({_GROUPED.pattern})", line):
        remedy = f"write {without_groups(number[1])}"
        return f"points and commas in {number[1]}", number.start(1) + 1, remedy
    if number := re.search(rf"(?<==)\s*({_COMMA.pattern})", line):
        comma = number.start(1) + number[1].index(",") + 1
        return f"a decimal comma in {number[1]}", comma, with_point(number[1])
    number, unit = _AT_END.search(line[: column - 1]), _UNIT.match(line, column - 1)
    if number and unit and not (number[1] == "0" and unit[0][0] in "xob"):
        remedy = _without_unit(number[1], unit[0], line[: number.start(1)])
        return f"a unit behind the number {number[1]}", column, remedy
    return None


def _without_unit(number: str, unit: str, before: str) -> str:
    """Remedy for a number with a unit; ``before`` is the line up to the number, with its keys."""
    named = [UNIT_END.search(key) for key in re.findall(r"([\w-]+)[\"']?\s*=", before)]
    units = [UNITS[match[1]] for match in named if match]
    if not units:
        return "write the number alone"
    same = unit.replace(" ", "").lower() == units[-1].replace(" ", "").lower()
    value = number if same else "the number alone"
    return f"write {value}: the key says that it is in {units[-1]}"


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
    return (
        "[" + ", ".join(map(str, items)) + "]" if points != written and len(items) == count else ""
    )


def number_meant(text: str, unit: str) -> tuple[str, str]:
    """What is wrong with a text where a number belongs, beside the quotes, and the remedy.

    Either is "" where there is nothing to say.
    """
    text = text.strip()
    if _GROUPED.fullmatch(text):
        return "points and commas, and a text", f"write {without_groups(text)}"
    if _COMMA.fullmatch(text):
        return "decimal comma, and a text", with_point(text)
    if match := _NUMBER.fullmatch(text):
        words = (
            f"write the number alone, in {unit}"
            if match[2] and unit
            else "write it without quotes"
        )
        return "", f"{words}: {match[1]}"
    return "", ""
