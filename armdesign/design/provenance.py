"""Provenance of designs: within which requirements and by which command a new machine was made."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from armdesign.design.requirements.settings import Requirements
from armdesign.machine.file import machine_file
from armdesign.machine.machine import Machine
from armdesign.machine.provenance import as_toml, retold

_TABLE = "requirements."


def documented(
    machine: Machine, today: Machine, requirements: Requirements, command: str
) -> Machine:
    """The new machine, as by ``retold``, within what requirements and by what command it was made.

    The command is as typed in a terminal or in Python.
    """
    story = (f"Command: {command}", f"Requirements: {stated_requirements(today, requirements)}.")
    return retold(machine, today, "optimized", story)


def call(function: str, **arguments: Any) -> str:
    """A call of this package as Python writes it, without arguments that ask for nothing."""
    given = {name: value for name, value in arguments.items() if value is not None}
    words = ", ".join(f"{name}={value!r}" for name, value in given.items())
    return f"armdesign.{function}({words})"


def stated_requirements(today: Machine, requirements: Requirements) -> str:
    """Every requirement of today's file, defaults included, and what was asked for instead."""
    words = ", ".join(
        f"{path.removeprefix(_TABLE)} {as_toml(value)}"
        for path, value in machine_file.flat(today.section).items()
        if path.startswith(_TABLE)
    )
    of_file = Requirements.of(today)
    pairs = (
        (f.name, getattr(requirements, f.name), getattr(of_file, f.name))
        for f in fields(Requirements)
    )
    instead = ", ".join(f"{name} = {value!r}" for name, value, before in pairs if value != before)
    return f"{words}; instead of these, in SI units: {instead}" if instead else words
