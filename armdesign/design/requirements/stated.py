"""Statements of requirements in a machine file: each field knows its key there.

By it a field is read from the file, asked for and changed in the key's own unit, and checked.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, is_dataclass, replace
from typing import Any

import numpy as np

from armdesign.errors import ArmDesignError, MachineFileError
from armdesign.machine.file.schema import DEFAULT, RequirementsSection, Shares, share_of
from armdesign.machine.machine import Machine
from armdesign.units import deg, mm

Names = Iterator[tuple[str, str, Collection[str], Collection[str]]]  # where, of what, names, known


def fault_of(
    machine: Machine, path: str, in_file: bool, fault: str, remedy: str
) -> ArmDesignError:
    """A fault of a requirement at a key path, with its line where the machine's file states it."""
    part = f"requirements.{path}"
    if not in_file:
        return ArmDesignError(part, fault, remedy)
    line = machine.line_of(part)
    return MachineFileError(f"{machine.source.name}: {part}", fault, remedy, line)


class FrozenMapping(dict[str, Any]):
    """A mapping that is hashed by what it holds, and not to be changed."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))


def frozen(value: Any) -> Any:
    """A setting that can be hashed: mappings and lists frozen, whatever is in them."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return FrozenMapping({key: frozen(part) for key, part in value.items()})
    return tuple(map(frozen, value)) if isinstance(value, list | tuple) else value


class Frozen:
    """Base of dataclasses whose fields are frozen on construction."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, frozen(value))


@dataclass(frozen=True, kw_only=True)
class Stated:
    """Statement of one field in the file.

    Attributes:
        key: under ``[requirements]``.
        read: the field of a machine's file.
        number_of: the field's number that is relaxed, by the rest of the key path, in the key's
            unit.
        changed: the field with that number changed.
        names: what the field names that a machine may not have.
        completed: the field with what it leaves to defaults.
        own: what of the rest of a key path the field states for itself.
        check: raises for what is not allowed.
    """

    key: str
    read: Callable[[Machine], Any]
    number_of: Callable[[Any, str], float] = lambda value, subkey: float(value)
    changed: Callable[[Any, str, float], Any] = lambda value, subkey, number: number
    names: Callable[[Any, Machine], Names] = lambda value, machine: iter(())
    check: Callable[[Any], None] = lambda value: None
    completed: Callable[[Any], Any] = lambda value: value
    own: Callable[[Any, str], str] = lambda value, subkey: subkey

    def subkey(self, path: str) -> str | None:
        """Rest of a key path after the key; None where the path is not below the key."""
        return path.removeprefix(self.key)[1:] if f"{path}.".startswith(f"{self.key}.") else None


def stated(how: Stated, default: Any = MISSING) -> Any:
    """A field of the requirements with its statement in the file; the default is the schema's."""
    default = RequirementsSection.model_fields[how.key].default if default is MISSING else default
    if isinstance(default, Mapping):
        return field(default_factory=FrozenMapping, metadata={"stated": how})
    return field(default=default, metadata={"stated": how})


def number(key: str, unit: float = 1.0) -> Any:
    """A field that one number of the file states, in SI; the schema has the default."""

    def si(value: float | None) -> float | None:
        return None if value is None else value * unit

    how = Stated(
        key=key,
        read=lambda machine: si(getattr(machine.section.requirements, key)),
        number_of=lambda value, _: float(value / unit),
        changed=lambda value, _, new: new * unit,
    )
    return stated(how, si(RequirementsSection.model_fields[key].default))


def shares(key: str) -> Any:
    """A field of shares: one for all actuators, or by actuator with a default for the others.

    Of actuators that stand still none; the schema has the default's default.
    """
    schema_default = RequirementsSection.model_fields[key].default

    def read(machine: Machine) -> Shares:
        value: Shares = getattr(machine.section.requirements, key)
        if isinstance(value, Mapping):
            return {name: v for name, v in value.items() if name not in machine.idle}
        return value

    def changed(value: Shares, actuator: str, new: float) -> Shares:
        every = value if isinstance(value, Mapping) else {DEFAULT: value}
        return completed({**every, actuator or DEFAULT: new})

    def completed(value: Shares) -> Shares:
        if not isinstance(value, Mapping):
            return value
        every = {DEFAULT: schema_default, **value}
        return every if len(every) > 1 else every[DEFAULT]

    how = Stated(
        key=key,
        read=read,
        number_of=share_of,
        changed=changed,
        names=lambda value, machine: iter(
            [(key, "actuator", _with_own(value), [a.name for a in machine.actuators])]
        ),
        check=lambda value: _refuse_negative(key, value),
        completed=completed,
        own=lambda value, actuator: actuator if actuator in _with_own(value) else "",
    )
    return stated(how)


def _with_own(shares: Shares) -> list[str]:
    """Names of the actuators that have a share of their own."""
    return [name for name in shares if name != DEFAULT] if isinstance(shares, Mapping) else []


def _refuse_negative(key: str, shares: Shares) -> None:
    for name, share in shares.items() if isinstance(shares, Mapping) else ():
        if share < 0:
            where = f"requirements.{key}.{name}"
            raise ArmDesignError(where, f"{share!r} is not allowed", "give a number ≥ 0")


def numbers_by_cylinder(key: str, unit: float, name: str) -> Any:
    """A field of numbers by cylinder, SI; of cylinders that stand still none."""

    def read(machine: Machine) -> dict[str, float]:
        values: Mapping[str, float] = getattr(machine.section.requirements, key)
        return {c: value * unit for c, value in values.items() if at_work(machine, c)}

    how = Stated(
        key=key,
        read=read,
        number_of=lambda values, cylinder: float(values[cylinder] / unit),
        changed=lambda values, cylinder, new: {**values, cylinder: new * unit},
        names=lambda values, machine: iter([(name, "cylinder", values, cylinders(machine))]),
    )
    return stated(how)


def entries(
    table: str,
    read: Callable[[Machine, str, Any], Any],
    relaxed: tuple[str, str, float],
    names: Callable[[Any, Machine], Names],
    *,
    label: str = "name",
    check: Callable[[Any], None] = lambda entry: None,
) -> Any:
    """A field of entries, one for each named table of the file, without those that read as None.

    Args:
        table: key of the tables.
        read: the entry of one of them, by its name and section.
        relaxed: key, attribute and unit of the number that is relaxed.
        names: what an entry names that a machine may not have.
        label: attribute that is the name of the table.
        check: raises for what is not allowed in an entry.
    """
    key, attribute, unit = relaxed

    def every(machine: Machine) -> tuple[Any, ...]:
        sections = getattr(machine.section.requirements, table)
        every_entry = (read(machine, name, section) for name, section in sections.items())
        return tuple(entry for entry in every_entry if entry is not None)

    def is_of(entry: Any, subkey: str) -> bool:
        return bool(getattr(entry, label) == subkey.removesuffix(f".{key}"))

    def number_of(values: Any, subkey: str) -> float:
        entry = next(entry for entry in values if is_of(entry, subkey))
        return float(getattr(entry, attribute) / unit)

    def changed(values: Any, subkey: str, new: float) -> tuple[Any, ...]:
        return tuple(
            replace(entry, **{attribute: new * unit}) if is_of(entry, subkey) else entry
            for entry in values
        )

    def check_all(values: Any) -> None:
        for entry in values:
            check(entry)

    how = Stated(
        key=table,
        read=every,
        number_of=number_of,
        changed=changed,
        names=lambda values, machine: (each for entry in values for each in names(entry, machine)),
        check=check_all,
    )
    return stated(how, ())


def cylinders(machine: Machine) -> list[str]:
    """Names of a machine's cylinders."""
    return [cylinder.name for cylinder in machine.cylinders]


def at_work(machine: Machine, cylinder: str) -> bool:
    """Whether a cylinder moves a joint; true of one that the file does not have, a fault."""
    return cylinder not in machine.idle


def by_joint(
    machine: Machine, path: str, turning: Mapping[str, float], sliding: Mapping[str, float]
) -> dict[str, float]:
    """Numbers by joint [rad, m], from those in degrees and those in millimetres."""
    for key, given, revolute in (("deg", turning, True), ("mm", sliding, False)):
        for name in given:
            if machine.arm.joints[machine.joints.index(name)].revolute != revolute:
                kind, other = ("slides", "mm") if revolute else ("turns", "deg")
                raise MachineFileError(
                    f"{machine.source.name}: requirements.{path}",
                    f'"{name}" {kind}, so nothing of it is in {key}',
                    f"give it in {other}",
                    machine.line_of(f"requirements.{path}"),
                )
    return {name: value * deg for name, value in turning.items()} | {
        n: value * mm for n, value in sliding.items()
    }


def check_word(name: str, word: str, allowed: tuple[str, ...]) -> None:
    """Raise for a word that is none of those allowed."""
    if word not in allowed:
        remedy = f"give {' or '.join(map(repr, allowed))}"
        raise ArmDesignError(f"requirements.{name}", f"{word!r} is not allowed", remedy)


def check_kind(path: str, value: Any, kind: str) -> None:
    """Raise for what is no number in a setting whose kind is one, or one for each actuator."""
    if value is None and "None" in kind:
        return
    parts = value.values() if isinstance(value, Mapping) and "Mapping" in kind else [value]
    for part in parts:
        if isinstance(part, bool) or not isinstance(part, float | int | np.number):
            raise ArmDesignError(path, f"{part!r} is not allowed", "give a number")


def check_numbers(path: str, value: Any) -> None:
    """Raise for a number within a setting that is not finite."""
    if isinstance(value, float | int) and not np.isfinite(value):
        raise ArmDesignError(path, f"{value!r} is not allowed", "give a finite number")
    if isinstance(value, Mapping):
        for name, part in value.items():
            check_numbers(f"{path}.{name}", part)
    elif isinstance(value, tuple):
        for part in value:
            check_numbers(path, part)
    elif is_dataclass(value):
        check_numbers(path, FrozenMapping(vars(value)))
