"""Workspaces and frequency maps that many tests look at, each made once."""

from __future__ import annotations

from functools import cache

import armdesign as ad
from tests import machines


@cache
def workspace(name: str, points: int | tuple[int, ...] = 5) -> ad.Workspace:
    return ad.Workspace.grid(machines.named(name), points)


@cache
def mapped(name: str, points: int | tuple[int, ...] = 5) -> ad.FrequencyMap:
    return ad.frequency_map(machines.named(name), workspace(name, points))
