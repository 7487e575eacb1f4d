"""Type, range and unit that the schema states at a key path of the machine file."""

from __future__ import annotations

import math
import re
from dataclasses import asdict
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen

from armdesign.machine.file.schema import MachineSection
from armdesign.machine.file.section import Name, Section

Location = tuple[Any, ...]  # a key path in its parts: names of keys, indices of lists

UNITS = {  # by the end of the key, longer ends first
    "kg_per_m3": "kg/m³",
    "kg_m2": "kg m²",
    "rad_per_N_m": "rad/(N m)",
    "N_m_s_per_rad": "N m s/rad",
    "deg_per_s": "deg/s",
    "cm3": "cm³",
    "l_per_min_per_bar": "l/min/bar",
    "l_per_min": "l/min",
    "mm_per_s": "mm/s",
    "m_per_N": "m/N",
    "N_s_per_m": "N s/m",
    "N_m_per_rad": "N m/rad",
    "N_per_m": "N/m",
    "ms": "ms",
    "percent": "%",
    "MPa": "MPa",
    "bar": "bar",
    "deg": "deg",
    "mm": "mm",
    "kg": "kg",
    "hz": "Hz",
    "kN": "kN",
    "N_m": "N m",
    "N": "N",
    "l": "l",
}
UNIT_END = re.compile(rf"_({'|'.join(UNITS)})$")


def unwrap(annotation: Any) -> tuple[Any, list[Any]]:
    """Type and constraints of an annotation, without Annotated and ``| None``."""
    constraints: list[Any] = []
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *extra = get_args(annotation)
            for item in extra:
                constraints += getattr(item, "metadata", [item])
            continue
        arguments = [a for a in get_args(annotation) if a is not type(None)]
        if type(None) in get_args(annotation) and len(arguments) == 1:
            annotation = arguments[0]
            continue
        return annotation, constraints


def is_table(kind: Any) -> bool:
    """Whether a type of the schema is a table with keys of its own."""
    return isinstance(kind, type) and issubclass(kind, Section)


def forms(kind: Any) -> tuple[Any, ...]:
    """Number and table of a key that may be either; else the type alone."""
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def annotation(location: Location) -> tuple[Any, list[Any]]:
    """Type and constraints that the schema has at a key path; KeyError where it has none.

    Of a key that may be a number or a table, the number's.
    """
    kind: Any = MachineSection
    constraints: list[Any] = []
    for key in location:
        kind, _ = unwrap(forms(kind)[-1])
        if is_table(kind):
            field = kind.model_fields[key]
            kind, constraints = unwrap(field.annotation)
            constraints = [*constraints, *field.metadata]
        elif get_origin(kind) in (dict, list):
            kind, constraints = unwrap(get_args(kind)[-1])
        else:
            raise KeyError(key)
    return unwrap(forms(kind)[0]) if len(forms(kind)) > 1 else (kind, constraints)


def is_requirement(location: Location) -> bool:
    """Whether the schema has a key path below ``[requirements]``: it may be set in any file."""
    try:
        annotation(location)
    except (KeyError, TypeError, AttributeError):
        return False
    return len(location) > 1 and location[0] == "requirements"


def allowed(location: Location) -> str:
    """Description of the values that a key path may have."""
    try:
        kind, constraints = annotation(location)
    except KeyError:
        return ""
    if get_origin(kind) is Literal:
        return "one of " + ", ".join(f'"{choice}"' for choice in get_args(kind))
    if kind is bool:
        return "true or false"
    if kind in (float, int):
        number = "a whole number" if kind is int else "a number"
        return f"{number} in {_interval(constraints)}{unit_of(location)}"
    if get_origin(kind) is list:
        return f"a list of {_how_many(constraints)}, each {allowed((*location, 0))}"
    if kind is str:
        is_name = (kind, constraints) == unwrap(Name)
        letters = "letters a to z, digits, _ and -, " if is_name else ""
        most = [limit.max_length for limit in constraints if isinstance(limit, MaxLen)]
        return f"a text of {letters}at most {most[0]} characters" if most else "a text"
    if get_origin(kind) is dict:
        longest = lengths(constraints)[1]
        few = f"at most {longest} " if longest else ""
        return f"a table of {few}named entries (names of letters a to z, digits, _ and -)"
    required = [name for name, field in kind.model_fields.items() if field.is_required()]
    return f"a table with {', '.join(required)}" if required else "a table"


def _limits(constraints: list[Any]) -> dict[str, Any]:
    """The limits of a number among its constraints, by gt, ge, lt, le."""
    limits = (asdict(one) for one in constraints if isinstance(one, Gt | Ge | Lt | Le))
    return {name: value for limit in limits for name, value in limit.items()}


def _interval(constraints: list[Any]) -> str:
    limits, low, high = _limits(constraints), "(-∞", "∞)"
    if "gt" in limits or "ge" in limits:
        low = f"({limits['gt']:g}" if "gt" in limits else f"[{limits['ge']:g}"
    if "lt" in limits or "le" in limits:
        high = f"{limits['lt']:g})" if "lt" in limits else f"{limits['le']:g}]"
    return f"{low}, {high}"


def _how_many(constraints: list[Any]) -> str:
    least, most = lengths(constraints)
    if least == most:
        return f"{least} values"
    if most is not None:
        return f"{least} to {most} values"
    return f"at least {least}" if least else "any number of values"


def lengths(constraints: list[Any]) -> tuple[int, int | None]:
    """Least and largest number of values in a list; None without a largest."""
    least = next((c.min_length for c in constraints if isinstance(c, MinLen)), 0)
    return least, next((c.max_length for c in constraints if isinstance(c, MaxLen)), None)


def bounds(location: Location) -> tuple[float, float]:
    """Least and largest number that a key path may have; beside an end that it may not have."""
    limits = _limits(annotation(location)[1])
    low, high = limits.get("ge", -math.inf), limits.get("le", math.inf)
    if "gt" in limits:
        low = math.nextafter(limits["gt"], math.inf)
    if "lt" in limits:
        high = math.nextafter(limits["lt"], -math.inf)
    return low, high


def unit_of(location: Location) -> str:
    """Unit of a number after a space, from its key or from the list or table that holds it."""
    kind: Any = MachineSection
    unit = ""
    for key in location:
        kind, _ = unwrap(forms(kind)[-1])
        if is_table(kind) and key in kind.model_fields:
            kind, _ = unwrap(kind.model_fields[key].annotation)
            unit = named_unit(key, kind) or unit
        elif get_origin(kind) in (dict, list):
            # the names of entries are the author's: a joint may be called arm_mm
            kind, _ = unwrap(get_args(kind)[-1])
    return f" {unit}" if unit else ""


def named_unit(key: str, kind: Any) -> str:
    """The unit that a key names; none for a table whose own keys name theirs, as four_bar."""
    match = UNIT_END.search(key)
    own = kind.model_fields if is_table(kind) else {}
    return UNITS[match[1]] if match and not any(map(UNIT_END.search, own)) else ""
