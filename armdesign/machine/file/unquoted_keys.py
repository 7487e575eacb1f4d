"""Key paths as keys of a table: ``a.b = 1`` without quotes is a table in TOML, and means "a.b"."""

from __future__ import annotations

from typing import Any


def joined_keys(table: Any) -> Any:
    """A table of key paths, from one in which they may be nested; anything else as it is."""
    if not isinstance(table, dict):
        return table
    joined: dict[str, Any] = {}
    for key, value in table.items():
        inner = joined_keys(value)
        pairs = inner.items() if isinstance(inner, dict) else [("", inner)]
        joined |= {f"{key}.{subkey}" if subkey else key: item for subkey, item in pairs}
    return joined
