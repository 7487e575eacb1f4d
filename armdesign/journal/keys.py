"""Keys of cases: a digest of everything that decides an answer."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

OWN = dict, list, str, int, float, bool, type(None)  # kinds that JSON has


def canonical(value: Any) -> str:
    """JSON that is equal for equal values: keys in order, every bit of a number kept.

    A value that JSON does not have stands there by its ``identity``, everything that decides it.

    Raises:
        TypeError: a value without one.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_identity)


def exact(value: Any) -> Any:
    """A value that is canonical JSON equals only for equal values of equal kinds: no list a tuple.

    It is the value itself where all that is in it is of JSON's own kinds.
    """
    kinds = list(_kinds(value))
    return [value, kinds] if kinds else value


def _kinds(value: Any, *place: Any) -> Iterator[list[Any]]:
    """Kinds of what is in a value and not of JSON's own kinds, each after its place."""
    kind = type(value)
    if kind not in OWN:
        yield [*place, f"{kind.__module__}.{kind.__qualname__}"]
    if isinstance(value, dict):
        for key in sorted(value):
            yield from _kinds(value[key], *place, key)
    elif isinstance(value, list | tuple):
        for k, one in enumerate(value):
            yield from _kinds(one, *place, k)


@cache
def version_of_sources() -> str:
    """Version of the package with a digest of its sources, which who develops it changes.

    What decides an answer beside its input; as ``0.1.0+3f9a2c71``. Once in a process: Python is
    begun anew after an edit.
    """
    root, seal = Path(__file__).parents[1], hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        if path.is_file():  # no editor's link to a lock
            seal.update(f"{path.relative_to(root).as_posix()}\n".encode() + path.read_bytes())
    return f"{version('armdesign')}+{seal.hexdigest()[:8]}"


def digest(value: Any) -> str:
    """SHA-256 of the canonical JSON of a value, in hexadecimal digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def _identity(value: Any) -> Any:
    try:
        return value.identity
    except AttributeError:
        raise TypeError(f"a value of type {type(value).__name__}") from None
