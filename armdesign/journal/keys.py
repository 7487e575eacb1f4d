"""Keys of cases: a digest of everything that decides an answer."""

from __future__ import annotations

import hashlib
import json
from typing import Any


def canonical(value: Any) -> str:
    """JSON that is equal for equal values: keys in order, every bit of a number kept.

    A value that JSON does not have stands there by its ``identity``, everything that decides it.

    Raises:
        TypeError: a value without one.
    """
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=_identity)


def digest(value: Any) -> str:
    """SHA-256 of the canonical JSON of a value, in hexadecimal digits."""
    return hashlib.sha256(canonical(value).encode()).hexdigest()


def _identity(value: Any) -> Any:
    try:
        return value.identity
    except AttributeError:
        fault = f"Object of type {type(value).__name__} is not JSON serializable"
        raise TypeError(fault) from None
