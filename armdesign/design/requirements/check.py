"""The check of a machine against requirements: two machines as their files describe them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import (
    CHECKED_POSES,
    MachineCandidate,
    Reference,
    SizeCandidates,
    reference_of,
)
from armdesign.design.requirements.leverage import digging_forces as forces_at_tool
from armdesign.design.requirements.record import Check, Evaluation
from armdesign.design.requirements.settings import Requirements, evaluations
from armdesign.design.requirements.strength import estimated_masses
from armdesign.design.requirements.strokes_and_boxes import strokes_and_boxes
from armdesign.frequency.cases import load_cases
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine


def check(
    machine: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array] | None = None,
) -> tuple[Check, ...]:
    """Judge a machine by every requirement, relative to today's machine on today's workspace.

    Args:
        machine: the new machine.
        today: the machine that the limits refer to.
        workspace: today's workspace.
        requirements: the limits.
        loads: ``static_loads`` of the machine on the workspace, if known.
    """
    return tuple(map(Check.of, _of_machine(machine, today, workspace, requirements, loads)))


def meets(
    machine: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array] | None = None,
    tolerance: float = 0.0,
) -> bool:
    """Whether no slack of ``check`` is below −``tolerance``; it stops at the first that is."""
    evaluated = _of_machine(machine, today, workspace, requirements, loads)
    return all(evaluation.slack.min() >= -tolerance for evaluation in evaluated)


def slacks(
    machine: Machine,
    areas: Array,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array],
) -> tuple[list[str], Array]:
    """Names of the requirements (m), and their slacks (b, m) for many sizes on one machine.

    Args:
        machine: pins, strokes and supply.
        areas: of all actuators (b, nc, 2) [m²], which static loads must not depend on.
        today: as of ``check``.
        workspace: as of ``check``.
        requirements: as of ``check``.
        loads: as of ``check``.
    """
    reference = reference_of(today, requirements, CHECKED_POSES)
    candidates = SizeCandidates(machine, reference, areas)
    evaluated = list(_evaluated(candidates, reference, workspace, loads))
    least = [np.broadcast_to(each.slack.min(axis=1), len(areas)) for each in evaluated]
    return [each.name for each in evaluated], np.stack(least, axis=1)


def _of_machine(
    machine: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array] | None,
) -> Iterator[Evaluation]:
    reference = reference_of(today, requirements, CHECKED_POSES)
    candidate = MachineCandidate(machine, reference)
    return _evaluated(candidate, reference, workspace, loads or static_loads(machine, workspace))


def _evaluated(
    new: MachineCandidate, reference: Reference, workspace: Workspace, loads: tuple[Array, Array]
) -> Iterator[Evaluation]:
    push, pull = loads
    yield from evaluations(new, reference, lambda: np.stack([push, -pull])[None])
    yield from strokes_and_boxes(
        new, reference, reference.requirements.box(reference.today, workspace)
    )


def static_loads(machine: Machine, workspace: Workspace) -> tuple[Array, Array]:
    """Largest push and pull that each actuator must hold in all load cases (nc,) [N, N m, ≥ 0]."""
    push = pull = np.zeros(len(machine.actuators))
    for case in load_cases(machine, workspace):
        forces = case.evaluate().cylinder_forces
        push = np.maximum(push, forces.max(axis=0, initial=0.0))
        pull = np.maximum(pull, -forces.min(axis=0, initial=0.0))
    return push, pull


def digging_forces(machine: Machine) -> dict[str, float]:
    """Largest force of each cylinder at the tool [N]: it alone, extending (ISO 6015)."""
    reference = reference_of(machine, Requirements(), CHECKED_POSES)
    forces = forces_at_tool(reference.old, reference)
    return {name: float(force[0]) for name, force in forces.items()}


def cylinder_mass(machine: Machine) -> float:
    """Estimated mass of all cylinders together [kg]."""
    reference = reference_of(machine, Requirements(), CHECKED_POSES)
    return float(estimated_masses(reference.old)[0])
