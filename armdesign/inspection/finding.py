"""A finding of an inspection: a part of a machine, and why its value is implausible."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Finding:
    """An implausible value: its key path or part, and the reason in words."""

    part: str
    words: str
