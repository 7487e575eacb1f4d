"""Provenance of a report: by what, when, how and from which files it was made, to be repeated."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet
from armdesign.report.unreadable import COMMAND, VERSION

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine


@dataclass(frozen=True, kw_only=True)
class Origin:
    """A run of a command: its words, all its options with their values, and when it began."""

    command: str
    options: Mapping[str, object]
    begun: datetime

    @classmethod
    def begin(cls, command: str, options: Mapping[str, object]) -> Origin:
        """A run that begins now."""
        return cls(command=command, options=dict(options), begun=datetime.now(UTC))

    def sheet(self, machines: Mapping[str, Machine], **more: str) -> Sheet:
        """Provenance as a table, of the machines by their labels, with more rows by name."""
        now = datetime.now(UTC)
        libraries = ", ".join(f"{name} {version(name)}" for name in ("pin", "numpy", "scipy"))
        rows = [
            (VERSION, version("armdesign")),
            ("Python", f"{platform.python_version()} on {platform.system()}; {libraries}"),
            ("begun", f"{self.begun:%Y-%m-%d %H:%M:%S} UTC"),
            ("written", f"{now:%Y-%m-%d %H:%M:%S} UTC, {(now - self.begun).seconds} s later"),
            (COMMAND, self.command),
            ("options", ", ".join(f"{k} = {_words(v)}" for k, v in self.options.items())),
        ]
        for label, machine in machines.items():
            name = f"{label}: " if label else ""
            rows.append((f"{name}machine file", _hashed(machine.source.name, machine.text)))
            urdf = machine.section.urdf or "URDF made of [links]"
            rows.append((f"{name}URDF", _hashed(urdf, machine.urdf_text)))
        rows += [(name.replace("_", " "), words) for name, words in more.items() if words]
        note = "SHA-256 of the files as they were read; the same command repeats the report"
        return Sheet(title="", rows=tuple(rows), note=note)


def _words(value: object) -> str:
    return "not given" if value in (None, "") else str(value)


def _hashed(name: str, text: str) -> str:
    return f"{name}, SHA-256 {hashlib.sha256(text.encode('utf-8')).hexdigest()}"
