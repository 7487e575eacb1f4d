"""The check of a machine against requirements: two machines as their files describe them, nothing of the optimiser."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.absolute import digging_forces as forces_at_tool
from armdesign.design.requirements.absolute import estimated_masses
from armdesign.design.requirements.candidate import Built, Condition, Frame, Resized, frame_of
from armdesign.design.requirements.relative import conditions, guaranteed, static_loads_held
from armdesign.design.requirements.settings import Requirements
from armdesign.frequency.cases import load_cases
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.units import Units

SWEEP = (
    181  # poses over a joint's range at which moment arms and transmission angles are looked at
)


@dataclass(frozen=True, kw_only=True)
class Check:
    """One requirement, judged: ``value`` against ``limit`` in ``unit``.

    ``slack`` ≥ 0 where it is met.

    The slack is the distance to the limit over the limit (over the pin box, the stroke, the
    outline's size or today's value where the limit is a length that may be zero). ``words`` say
    what it is about; ``at_least`` whether the limit is a lower one.
    """

    name: str
    value: float
    limit: float
    unit: str
    slack: float
    words: str
    at_least: bool = False
    setting: str = ""

    @classmethod
    def of(cls, condition: Condition) -> Check:
        """The condition where it has least slack."""
        slack = condition.slack[0]
        worst = int(slack.argmin())
        return cls(
            name=condition.name,
            value=float(condition.value[0, worst].real),
            limit=float(condition.limit),
            unit=condition.unit,
            slack=float(slack[worst]),
            words=condition.words,
            at_least=condition.at_least,
            setting=condition.setting,
        )

    def sentence(self, worth: float, at_margin: float, units: Units) -> str:
        """That it binds, and the relative gain in frequency that relaxing it by 1 % would buy, ``worth``.

        And what the first of that would buy per 1 %, ``at_margin``, where that is clearly more.
        """
        bound, eased = ("at least", "1 % less") if self.at_least else ("at most", "1 % more")
        limit, value = units.short(self.limit, self.unit), units.short(self.value, self.unit)
        soon = (
            f" ({100 * at_margin:.2g} % at the margin: then another limit binds)"
            if at_margin > 1.2 * worth
            else ""
        )
        return (
            f"{self.words} ({self.name}) binds: it is {value}, {bound} {limit} is allowed; "
            f"{eased} would buy {100 * worth:.2g} % of frequency{soon}"
        )


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
    frame = frame_of(today, requirements, SWEEP)
    judged = _judged(
        Built(machine, frame), frame, workspace, loads or static_loads(machine, workspace)
    )
    return tuple(Check.of(condition) for condition in judged)


def meets(
    machine: Machine,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array] | None = None,
    tolerance: float = 0.0,
) -> bool:
    """Whether no slack of ``check`` is below −``tolerance``; it stops at the first that is."""
    frame = frame_of(today, requirements, SWEEP)
    judged = _judged(
        Built(machine, frame), frame, workspace, loads or static_loads(machine, workspace)
    )
    return all(condition.slack.min() >= -tolerance for condition in judged)


def slacks(
    machine: Machine,
    areas: Array,
    today: Machine,
    workspace: Workspace,
    requirements: Requirements,
    loads: tuple[Array, Array],
) -> tuple[list[str], Array]:
    """Names of the requirements (m), and what ``check`` finds as their slacks (b, m) for many sizes on one machine.

    Args:
        machine: pins, strokes and supply.
        areas: of all actuators (b, nc, 2) [m²], which static loads must not depend on.
        today: as of ``check``.
        workspace: as of ``check``.
        requirements: as of ``check``.
        loads: as of ``check``.
    """
    frame = frame_of(today, requirements, SWEEP)
    judged = list(_judged(Resized(machine, frame, areas), frame, workspace, loads))
    least = [np.broadcast_to(condition.slack.min(axis=1), len(areas)) for condition in judged]
    return [condition.name for condition in judged], np.stack(least, axis=1)


def _judged(
    new: Built, frame: Frame, workspace: Workspace, loads: tuple[Array, Array]
) -> Iterator[Condition]:
    yield from conditions(new, frame)
    push, pull = loads
    yield from static_loads_held(new, frame, np.stack([push, -pull])[None])
    yield from guaranteed(new, frame, frame.requirements.box(frame.today, workspace))


def static_loads(machine: Machine, workspace: Workspace) -> tuple[Array, Array]:
    """Largest push and largest pull that each actuator must hold, all poses and load cases (nc,) [N, N m, ≥ 0]."""
    push = pull = np.zeros(len(machine.actuators))
    for case in load_cases(machine, workspace):
        forces = case.evaluate().cylinder_forces
        push = np.maximum(push, forces.max(axis=0, initial=0.0))
        pull = np.maximum(pull, -forces.min(axis=0, initial=0.0))
    return push, pull


def digging_forces(machine: Machine) -> dict[str, float]:
    """Largest force of each cylinder at the tool [N]: see ``explicit.digging_forces``."""
    frame = frame_of(machine, Requirements(), SWEEP)
    return {name: float(force[0]) for name, force in forces_at_tool(frame.old, frame).items()}


def cylinder_mass(machine: Machine) -> float:
    """Estimated mass of all cylinders together [kg]."""
    return float(estimated_masses(frame_of(machine, Requirements(), SWEEP).old)[0])
