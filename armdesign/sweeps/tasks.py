"""Tasks that a sweep can set for every machine, each answered by numbers and words by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from armdesign.arguments import refuse_unless
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.maps import frequency_map
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.sweeps import numbers
from armdesign.sweeps.numbers import Numbers
from armdesign.sweeps.reach import identity_of_function
from armdesign.units import bar

Task = Callable[..., Numbers]


def map_(machine: Machine, workspace: Workspace) -> Numbers:
    """Worst frequency with its pose, and the median [Hz]."""
    return numbers.of_map(frequency_map(machine, workspace))


def design(
    machine: Machine,
    workspace: Workspace,
    vary: str | Sequence[str] = ("areas", "pins"),
    starts: int | None = None,
    seed: int = 0,
    objective: str = "gain",
    catalogue: str | Sequence[Sequence[float]] | None = None,
    damping: float | None = None,
) -> Numbers:
    """Worst frequency today and of the best machine [Hz], its gains, and every changed number.

    ``vary``: a list, or words with commas as on the command line.
    """
    from armdesign.design.optimize import size_cylinders
    from armdesign.optimization import only_sizes, optimize

    vary = tuple(vary.replace(",", " ").split() if isinstance(vary, str) else vary)
    if only_sizes(vary, objective, damping):
        if starts is not None:
            fault = "counts for pins, or for the objective bandwidth; areas alone need no starts"
            raise ArmDesignError("options.starts", fault, "leave it out")
        best = size_cylinders(machine, workspace, objective=objective, catalogue=catalogue)
    else:
        best = optimize(
            machine, workspace, vary=vary, starts=starts, seed=seed, objective=objective,
            catalogue=catalogue, damping=damping,
        )  # fmt: skip
    return numbers.of_design(best)


def validate(machine: Machine, workspace: Workspace) -> Numbers:
    """Largest deviation of identified from linear frequencies, and of the lowest mode its run."""
    from armdesign.simulation import validation

    return numbers.of_validation(validation.validate(machine, workspace=workspace))


def control(
    machine: Machine, workspace: Workspace, damping: float | None = None, delay: float = 0.0
) -> Numbers:
    """Least bandwidth of each kind of position loop [Hz], and the lowest frequency beside it."""
    from armdesign.control.bandwidth_map import bandwidth_map

    bandwidths = bandwidth_map(machine, workspace, damping=damping, delay=delay)
    return numbers.of_bandwidths(bandwidths)


def simulate(
    machine: Machine,
    workspace: Workspace,
    cylinder: str = "",
    opening: float = 0.2,
    pulse: float = 0.5,
    duration: float = 2.0,
) -> Numbers:
    """Largest pressures [bar] and events of a pulse of one valve at the worst pose of the map.

    ``cylinder``: whose valve opens, by default the first; by ``opening`` (−1…1) for ``pulse`` [s].
    """
    from armdesign.simulation.excitation import Step
    from armdesign.simulation.plant.hydraulics import refuse_without_valves
    from armdesign.simulation.simulate import simulate as simulated

    refuse_without_valves(machine)
    names = [a.name for a in machine.actuators]
    name = cylinder or names[0]
    if name not in names:
        raise ArmDesignError("cylinder", f'there is no "{name}"', choose(name, names))
    if not -1.0 <= opening <= 1.0:
        fault = f"{opening:g} is not allowed"
        raise ArmDesignError("opening", fault, "give a number from −1 to 1")
    if not pulse > 0:
        raise ArmDesignError("pulse", f"{pulse:g} s is not allowed", "give a positive number")
    worst = frequency_map(machine, workspace).worst
    command = {name: Step(size=opening, end=pulse)}
    run = simulated(machine, worst.q, command=command, duration=duration, payload=worst.payload)
    largest = (run.pressures.max(axis=(0, 2)) / bar).tolist()
    return {
        "frequency_hz": worst.frequency,
        **{f"{actuator}_bar": p for actuator, p in zip(run.cylinders, largest, strict=True)},
        **{f"tool_{a}_m": x for a, x in zip("xyz", run.tool[-1].tolist(), strict=True)},
        "events": "; ".join(run.events),
    }


TASKS: dict[str, Task] = {
    "map": map_,
    "design": design,
    "validate": validate,
    "control": control,
    "simulate": simulate,
}


def task_named(name: str) -> Task:
    """The task of a name.

    Raises:
        ArmDesignError: there is none.
    """
    if name not in TASKS:
        raise ArmDesignError("task", f'"{name}" is none', choose(name, TASKS))
    return TASKS[name]


def identity_of(task: str | Task) -> str:
    """Identity of a task: its name, or a function's code and all of the user's that it reaches.

    Raises:
        ArmDesignError: a function that holds or reads what cannot be written down.
    """
    if isinstance(task, str):
        task_named(task)
        return task
    return identity_of_function(task)


def refuse_options(task: str | Task, options: Mapping[str, Any]) -> None:
    """Raise for options that a task does not have, or of another kind than one of ours takes.

    And for a function that does not take machine and workspace before them.
    """
    if not isinstance(options, Mapping):
        raise ArmDesignError("options", f"{options!r} is no set", "give values by name")
    for name in options:
        if not isinstance(name, str):
            raise ArmDesignError("options", f"the name {name!r} is no text", "give texts as names")
    function = task_named(task) if isinstance(task, str) else task
    try:
        parameters = inspect.signature(function).parameters
    except (TypeError, ValueError):  # of a class or function in C
        remedy = "give a function of machine and workspace"
        raise ArmDesignError("task", "does not say what it is given", remedy) from None
    _refuse_other_beginning(list(parameters.values()), options)
    if any(p.kind is p.VAR_KEYWORD for p in parameters.values()):
        return
    known = list(parameters)[2:]
    for name in options:
        if name not in known:
            remedy = choose(name, known) if known else "leave it out"
            raise ArmDesignError(f"options.{name}", "is no option of the task", remedy)
        if isinstance(task, str):
            refuse_unless(f"options.{name}", options[name], parameters[name].annotation)


def _refuse_other_beginning(
    parameters: list[inspect.Parameter], options: Mapping[str, Any]
) -> None:
    """Raise for a function whose first two parameters are not for machine and workspace."""
    remedy = "begin its parameters with machine and workspace; options come after them"
    if any(p.kind is p.VAR_POSITIONAL for p in parameters[:2]):
        return
    first = [p for p in parameters[:2] if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if len(first) < 2:
        raise ArmDesignError("task", "does not take a machine and a workspace", remedy)
    second = first[1]
    other = second.default not in (second.empty, None) and second.name != "workspace"
    if other or second.name in options:
        fault = f"its second parameter, {second.name}, would be given the workspace"
        raise ArmDesignError("task", fault, remedy)
