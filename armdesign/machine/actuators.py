"""A machine with all of its cylinders and motors changed alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol, TypeVar

from armdesign.hydraulics.actuator import Cylinder, Motor
from armdesign.machine.machine import Machine

F = TypeVar("F", Cylinder, Motor)


class Change(Protocol):
    """What becomes of a cylinder or a motor."""

    def __call__(self, actuator: F, /) -> F:
        """The changed actuator, of the same kind."""


def with_each(machine: Machine, change: Change) -> Machine:
    """The machine with every cylinder and motor changed."""
    cylinders, motors = tuple(map(change, machine.cylinders)), tuple(map(change, machine.motors))
    return replace(machine, cylinders=cylinders, motors=motors)
