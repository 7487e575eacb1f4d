"""What an inspection finds: a part of a machine, and what looks odd about it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something worth a second look: a key path or part, and what about it."""

    part: str
    words: str
