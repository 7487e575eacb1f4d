"""Numbers of a machine file: every one by its key path, with the step that people think in.

A number is one float: of a list each element is one, ``cylinder.boom.base.at_mm.0``. Counts and
words are none.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from armdesign.errors import ArmDesignError, choose
from armdesign.machine.file.key_paths import (
    Location,
    allowed,
    annotation,
    bounds,
    is_table,
    unit_of,
)
from armdesign.machine.file.schema import BY_ACTUATOR, MachineSection, TolerancesSection
from armdesign.machine.file.section import Section

# natural steps by the unit of a key; of all others a tenth of the value
STEPS = {"mm": 10.0, "kg": 100.0, "%": 1.0, "bar": 10.0, "deg": 1.0, "l": 1.0, "N/m": 10e6}
STIFFER = 10e6  # [N/m] step of the stiffness that a compliance in series stands for
SOFTER, TURNING = 1e-9, 1e-8  # [m/N, rad/(N m)] steps where the structure is rigid


@dataclass(frozen=True, kw_only=True)
class Number:
    """One number of a machine file.

    Attributes:
        location: its key path in parts.
        value: in the file's unit.
        unit: that unit; empty if the key names none.
        low: least value that the schema allows.
        high: largest.
    """

    location: Location
    value: float
    unit: str
    low: float
    high: float

    @property
    def path(self) -> str:
        """Its key path, as ``cylinder.boom.bore_mm``."""
        return ".".join(map(str, self.location))

    @property
    def step(self) -> tuple[float, str]:
        """A change in natural units: in the file's unit, and in words.

        10 mm, 100 kg, 1 %, 10 bar, 1°, 1 l, 10 MN/m; a tenth of all others. A compliance in series
        changes by what makes its stiffness 10 MN/m higher.
        """
        if self.unit == "m/N":
            if self.value == 0:
                return SOFTER, f"{SOFTER:g} m/N"
            return -STIFFER * self.value**2, f"{STIFFER / 1e6:g} MN/m"
        if self.unit == "rad/(N m)" and self.value == 0:
            return TURNING, f"{TURNING:g} rad/(N m)"
        if self.unit == "N/m":
            return STIFFER, f"{STIFFER / 1e6:g} MN/m"
        if self.unit in STEPS:
            return STEPS[self.unit], f"{STEPS[self.unit]:g} {self.unit}"
        return (0.1 * self.value or 0.1), ("10 %" if self.value else f"0.1 {self.unit}".strip())


def numbers_of(section: MachineSection) -> dict[str, Number]:
    """Every number of a machine file by its key path, defaults included."""
    return {number.path: number for number in _numbers(section, ())}


def _numbers(node: Any, location: Location) -> Iterator[Number]:
    if isinstance(node, Section):
        for key, item in node:
            yield from _numbers(item, (*location, key))
    elif isinstance(node, Mapping):
        for key, item in node.items():
            yield from _numbers(item, (*location, key))
    elif isinstance(node, list):
        for index, item in enumerate(node):
            yield from _numbers(item, (*location, index))
    elif isinstance(node, float | int) and annotation(location)[0] is float:
        low, high = bounds(location)
        unit = unit_of(location).strip()
        yield Number(location=location, value=float(node), unit=unit, low=low, high=high)


def may_be(section: MachineSection, values: Mapping[Location, float]) -> bool:
    """Whether the schema allows other values of numbers, each by itself."""
    numbers = (n for n in numbers_of(section).values() if n.location in values)
    return all(number.low <= values[number.location] <= number.high for number in numbers)


def chosen_numbers(section: MachineSection, path: str, part: str) -> list[Number]:
    """The number at a key path, or all of the list there; ``part`` names it in errors.

    Raises:
        ArmDesignError: there is none; with the nearest key.
    """
    every = numbers_of(section).items()
    known = {name: number for name, number in every if number.location[0] != "tolerances"}
    chosen = [number for name, number in known.items() if _names(path, number, name)]
    if not chosen:
        raise ArmDesignError(part, *(_missing_table(section, path) or _unknown(path, list(known))))
    return chosen


def _names(path: str, number: Number, name: str) -> bool:
    """Whether a key path names a number, or the list that it stands in."""
    in_list = isinstance(number.location[-1], int)
    return path == name or (in_list and path == name.rpartition(".")[0])


def _unknown(path: str, known: list[str]) -> tuple[str, str]:
    """Why a key path names no number, and what to give instead."""
    below = [name for name in known if name.startswith(f"{path}.")]
    if below:
        return "is a table", f"name one of its numbers, such as {below[0]}"
    table, _, leaf = path.rpartition(".")
    location = tuple(path.split("."))
    try:
        limits, kind = allowed(location), annotation(location)[0]
    except (KeyError, TypeError, AttributeError):
        limits, kind = "", None
    if kind is not None and not leaf.isdigit():
        if kind is not float:
            return "is no number that can vary", f"name one such as {_nearest(path, known)}"
        # one number there, or none, is for all
        share = table == "tolerances" or table.rpartition(".")[2] in BY_ACTUATOR
        depth = _known_parts(path, known)
        holder, _ = annotation(location[:depth])
        if share or (is_table(holder) and location[depth] in holder.model_fields):
            return "has no value in the file", f"write one first: {limits}"
    if location[0] == "tolerances":
        return "there is no such width", choose(leaf, list(TolerancesSection.model_fields))
    return "the machine file has no such number", _meant(path, known)


def _missing_table(section: MachineSection, path: str) -> tuple[str, str] | None:
    """That a file lacks the whole table of a key path, and what to do; None where it has it."""
    key, _, rest = path.partition(".")
    if not rest or key not in MachineSection.model_fields or getattr(section, key):
        return None
    if key == "links":
        return f"this machine's links are in its URDF, {section.urdf}", "change them there"
    kind = annotation((key,))[0]
    named = "" if is_table(kind) or key == "frozen" else ".…"
    keys = f", with {', '.join(kind.model_fields)}" if is_table(kind) else ""
    return f"the file has no [{key}{named}]", f"write it first{keys}"


def _known_parts(path: str, known: list[str]) -> int:
    """How many first parts of a key path begin a known one too."""
    given = path.split(".")
    parts = [name.split(".") for name in known]
    longest = min(len(given), max(map(len, parts)))
    return max(k for k in range(longest + 1) if any(p[:k] == given[:k] for p in parts))


def _meant(path: str, known: list[str]) -> str:
    """The key path that was meant, or what there is beside its first part that is not known."""
    given, parts = path.split("."), [name.split(".") for name in known]
    depth = _known_parts(path, known)
    beside = [p for p in parts if p[:depth] == given[:depth]]
    there = dict.fromkeys(p[depth] for p in beside if depth < len(p))
    if not there:
        return f"{'.'.join(given[:depth])} is one number"
    for name in difflib.get_close_matches(given[depth], there, 1):
        same = [".".join(p) for p in beside if p[depth] == name]
        return f'did you mean "{difflib.get_close_matches(path, same, 1, 0)[0]}"?'
    if not depth:
        with suppress(KeyError, TypeError, AttributeError):
            if annotation(("requirements", *given))[0] is float:
                return f'did you mean "requirements.{path}"?'
    return f"{'.'.join(given[:depth]) or 'it'} has: {', '.join(there)}"


def _nearest(path: str, known: list[str]) -> str:
    """The key path that shares most of its parts with another."""
    parts = set(path.split("."))
    return max(known, key=lambda name: len(parts & set(name.split("."))))


def with_values(section: MachineSection, values: Mapping[Location, Any]) -> MachineSection:
    """The section with other values at key paths, unchecked: they may be arrays."""
    node: Any = section
    for location, value in values.items():
        node = _with(node, location, value)
    whole: MachineSection = node
    return whole


def _with(node: Any, location: Location, value: Any) -> Any:
    if not location:
        return value
    key, *deeper = location
    if isinstance(node, Section):
        return node.model_copy(update={key: _with(getattr(node, key), tuple(deeper), value)})
    if isinstance(node, Mapping):
        return {**node, key: _with(node[key], tuple(deeper), value)}
    return [_with(item, tuple(deeper), value) if i == key else item for i, item in enumerate(node)]
