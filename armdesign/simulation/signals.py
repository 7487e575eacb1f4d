"""Names of states, inputs and outputs of a linear model, in groups with their slices."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate, pairwise
from typing import NamedTuple

from armdesign.machine.machine import Machine

Groups = Mapping[str, slice]
CHAMBERS = ("cap pressures", "annulus pressures")  # groups of states


class Signals(NamedTuple):
    """Groups of states, inputs and outputs, and all names in their order."""

    states: Groups
    inputs: Groups
    outputs: Groups
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]


def signals_of(machine: Machine) -> Signals:
    """Signals of a machine; its states are in the order of the plant's."""
    joints = [joint.name for joint in machine.arm.coordinates]
    actuators = [actuator.name for actuator in machine.actuators]
    k, nc, line = len(joints), len(actuators), int(machine.supply.flow_limited)
    chambers = dict.fromkeys(CHAMBERS, nc)
    spools = {"spools": nc, "spool speeds": nc}
    outputs = {
        "piston positions": [f"{name} piston position" for name in actuators],
        "piston speeds": [f"{name} piston speed" for name in actuators],
        "joint positions": [f"{name} position" for name in joints],
        "joint speeds": [f"{name} velocity" for name in joints],
        "cap pressures": [f"{name} cap pressure" for name in actuators],
        "annulus pressures": [f"{name} annulus pressure" for name in actuators],
        "tool position": [f"tool position {axis}" for axis in "xyz"],
        "tool acceleration": [f"tool acceleration {axis}" for axis in "xyz"],
    }
    forces = [f"tool force {axis}" for axis in "xyz"]
    return Signals(
        _slices({"positions": k, "speeds": k, **chambers, "supply pressure": line, **spools}),
        _slices({"commands": nc, "tool force": len(forces)}),
        _slices({group: len(names) for group, names in outputs.items()}),
        (*actuators, *forces),
        tuple(name for names in outputs.values() for name in names),
    )


def _slices(counts: Mapping[str, int]) -> Groups:
    edges = accumulate(counts.values(), initial=0)
    return dict(zip(counts, (slice(*pair) for pair in pairwise(edges)), strict=True))
