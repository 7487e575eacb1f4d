"""The repr of a result: what it holds, in at most ten lines, arrays by shape and range."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any

LINES, COLUMNS = 10, 99


def short_repr(result: Any) -> str:
    """Fields of a dataclass, without what has its default, as its class's ``__repr__``.

    Arrays of more than six numbers are told by shape, least and greatest; SI units, as inside. A
    class whose fields do not say what matters has a ``headline``, which stands before them on one
    line or two.
    """
    name, headline = type(result).__name__, getattr(result, "headline", "")
    text = f"{name}: {_fields(result, 0) or 'as by default'}"
    style: Any = {"width": COLUMNS, "placeholder": " …", "subsequent_indent": "  "}
    if not headline:
        return "\n".join(textwrap.wrap(text, max_lines=LINES, **style))
    first = textwrap.wrap(f"{name} {headline}", max_lines=2, break_on_hyphens=False, **style)
    lines = textwrap.wrap(text, max_lines=LINES - len(first), **style)
    lines[0] = "  " + lines[0].removeprefix(f"{name}: ")
    return "\n".join([*first, *lines])


def machine_repr(machine: Any) -> str:
    """Name, joints, actuators, load cases and file of a machine, a line each."""
    cases = (f"{c.name} {c.mass:g} kg" for c in machine.payloads)
    sizes = (f"{c.name} {1e3 * c.bore:g}/{1e3 * c.rod:g} mm" for c in machine.cylinders)
    lines = {
        "joints": machine.joints,
        "cylinders": sizes,
        "motors": (motor.name for motor in machine.motors),
        "springs": (spring.name for spring in machine.springs),
        "load cases": cases,
        "file": [str(machine.source)],
    }
    texts = ((what, ", ".join(words)) for what, words in lines.items())
    return "\n".join([f"Machine {machine.name}", *(f"  {a}: {b}" for a, b in texts if b)])


def _fields(value: Any, depth: int) -> str:
    stated = [f for f in fields(value) if f.repr and not _is_default(f, getattr(value, f.name))]
    return "; ".join(f"{f.name} {_in_words(getattr(value, f.name), depth + 1)}" for f in stated)


def _is_default(field: Field[Any], value: Any) -> bool:
    if hasattr(value, "shape"):
        return False
    if field.default_factory is not MISSING:
        return bool(value == field.default_factory())
    return field.default is not MISSING and bool(value == field.default)


def _in_words(value: Any, depth: int) -> str:
    """One value in a few words; parts of parts by their names only."""
    if hasattr(value, "columns") and hasattr(value, "shape"):
        return f"{len(value)} rows x {len(value.columns)} columns"
    if hasattr(value, "shape") and value.shape:
        return _array(value)
    if isinstance(value, bool | str | None):
        return textwrap.shorten(str(value), 80, placeholder=" …")
    if isinstance(value, Mapping):
        parts = [f"{key}: {_in_words(value[key], depth + 1)}" for key in [*value][:4]]
        return _several(parts, value)
    if isinstance(value, tuple | list):
        return _several([_in_words(part, depth + 1) for part in value[:4]], value)
    if is_dataclass(value):
        name = getattr(value, "name", None)
        if isinstance(name, str):
            return name
        small = depth == 1 and sum(f.repr for f in fields(value)) <= 6
        return f"({_fields(value, depth)})" if small else type(value).__name__
    try:
        return f"{value:.6g}"
    except (TypeError, ValueError):
        return type(value).__name__


def _several(words: list[str], whole: Any) -> str:
    more = f", … {len(whole)} in all" if len(whole) > len(words) else ""
    return f"({', '.join(words)}{more})"


def _array(value: Any) -> str:
    if value.size <= 6 and value.ndim == 1:
        return f"({', '.join(_in_words(x, 9) for x in value.tolist())})"
    shape = " x ".join(map(str, value.shape))
    if not value.size or value.dtype.kind not in "biuf":
        return f"[{shape}]"
    known = value[value == value]
    if not known.size:
        return f"[{shape}] of nan"
    return f"[{shape}] from {known.min():.4g} to {known.max():.4g}"
