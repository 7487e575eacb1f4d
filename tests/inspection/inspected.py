"""Inspections of the excavator with other values."""

from __future__ import annotations

from pathlib import Path

import armdesign as ad
from armdesign.inspection.inspection import Inspection, inspect
from tests import machines

EXCAVATOR = machines.named("excavator_20t")


def inspected(changes: dict[str, object], name: str = "excavator_20t") -> Inspection:
    machine = machines.named(name).replace(changes)
    return inspect(machine, ad.Workspace.grid(machine, points=7))


def odd(changes: dict[str, object], name: str = "excavator_20t") -> dict[str, str]:
    return {finding.part: finding.words for finding in inspected(changes, name).findings()}


def written(folder: Path, *pairs: tuple[str, str]) -> str:
    """The excavator with some texts changed, as a file."""
    text = EXCAVATOR.text
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "x.toml").write_text(text, encoding="utf-8")
    (folder / "excavator_20t.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    return str(folder / "x.toml")
