"""Provenance of designs: within which requirements and by which command a new machine was made."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from armdesign.design.program.problem import Problem
from armdesign.design.requirements.settings import Requirements
from armdesign.machine.file import machine_file
from armdesign.machine.machine import Machine
from armdesign.machine.provenance import as_toml, retold

_TABLE = "requirements."


def documented(machine: Machine, problem: Problem, command: str) -> Machine:
    """The new machine, as by ``retold``, within what requirements and by what command it was made.

    The command is as typed in a terminal or in Python.
    """
    story = (f"Command: {command}", f"Requirements: {stated_requirements(problem)}.")
    return retold(machine, problem.machine, "optimized", story)


def call(function: str, **arguments: Any) -> str:
    """A call of this package as Python writes it, without arguments that ask for nothing."""
    given = {name: value for name, value in arguments.items() if value is not None}
    words = ", ".join(f"{name}={value!r}" for name, value in given.items())
    return f"armdesign.{function}({words})"


def stated_requirements(problem: Problem) -> str:
    """Every requirement of today's file, defaults included, and what was asked for instead.

    The catalogue is the one that sizes were chosen from.
    """
    stated = machine_file.flat(problem.machine.section)
    stated |= {f"{_TABLE}catalogue": problem.grid.catalogue}
    words = ", ".join(
        f"{path.removeprefix(_TABLE)} {as_toml(value)}"
        for path, value in stated.items()
        if path.startswith(_TABLE)
    )
    of_file = Requirements.of(problem.machine)
    pairs = (
        (f.name, getattr(problem.requirements, f.name), getattr(of_file, f.name))
        for f in fields(Requirements)
    )
    instead = ", ".join(f"{name} = {value!r}" for name, value, before in pairs if value != before)
    return f"{words}; instead of these, in SI units: {instead}" if instead else words
