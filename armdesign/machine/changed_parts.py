"""Parts of a machine that were changed in memory, so that its file does not have them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armdesign.errors import MachineFileError
from armdesign.machine import parts

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

REMEDY = "give that change too by key path of the file, or make it in a function of your own"


def refuse_changed_parts(machine: Machine) -> None:
    """Raise for a part that would be lost where the machine is made again from its file.

    Raises:
        MachineFileError: the oil, the pump, an actuator … is not as the file has it.
    """
    if changed := _changed_parts(machine):
        fault = "was changed in memory, and would again be as in the file"
        raise MachineFileError(f"{machine.source.name}: {changed[0]}", fault, REMEDY)


def _changed_parts(machine: Machine) -> list[str]:
    """Key paths of tables whose part is not as the file has it."""
    section = machine.section
    moving, idle = parts.cylinders_with_linkages(section, machine.arm)
    given = {
        "name": (machine.name, section.name),
        "fluid": (machine.fluid, parts.fluid(section.fluid)),
        "supply": (machine.supply, parts.supply(section.supply)),
        "tool": (machine.tool, parts.pin(section.tool)),
        "cylinder": (
            (tuple(zip(machine.cylinders, machine.linkages, strict=True)), machine.idle_cylinders),
            (moving, idle),
        ),
        "motor": (machine.motors, parts.motors(section)),
        "spring": (machine.springs, parts.springs_of(section)),
    }
    of_file = {case.name: case for case in parts.load_cases(section)}
    for case in (*machine.payloads, machine.payload):
        if case.name in of_file:
            given[f"payload.{case.name}"] = (case, of_file[case.name])
    return [path for path, (own, in_file) in given.items() if repr(own) != repr(in_file)]
