"""Small design problems, and the machine that a vector of design variables describes,
unrounded.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from armdesign import Machine, Requirements, Workspace
from armdesign.design.program.problem import Problem
from armdesign.design.search.sequential_sdp import Search
from armdesign.hydraulics.actuator import Cylinder
from tests.machines import (
    ANY_LIFT_AND_TORQUE,
    BOOM,
    BUCKET,
    FOLD,
    LIFT,
    SOFT,
    STICK,
    CylinderSpec,
    Joint,
    build,
    named,
    rigid,
)
from tests.sprung import VALVE, spring


@cache
def single() -> Machine:
    """One joint, one cylinder."""
    return build([BOOM], [LIFT])


@cache
def double(reverse: bool = False) -> Machine:
    """Two joints, a cylinder each, in one order of the file or the other."""
    return build([BOOM, STICK], [FOLD, LIFT] if reverse else [LIFT, FOLD])


@cache
def relieved() -> Machine:
    """Two joints, a cylinder each; the first's reliefs open at 180 of the supply's 300 bar."""
    relief = VALVE.replace(" }", ", relief_bar = 180 }")
    return build([BOOM, STICK], [replace(LIFT, extra=relief), FOLD])


@cache
def yielding() -> Machine:
    """Two joints, a cylinder each, on structure about as soft as the oil."""
    soft = "compliance_m_per_N = 3e-8"
    return build([BOOM, STICK], [replace(LIFT, extra=soft), replace(FOLD, extra=soft)])


@cache
def twins() -> Machine:
    """Two arms that feel neither each other nor gravity: the same cylinder each, the second turns
    twice the inertia.
    """
    joints = [
        Joint(name, "root", xyz=(0.1, 0, 0.5), com=(0, 0, 0), mass=m)
        for name, m in (("light", 300), ("heavy", 600))
    ]
    return build(
        joints,
        [replace(LIFT, name=f"lift_{j.name}", rod_end=(j.name, (1.1, 0, 0.4))) for j in joints],
        payload_kg=0,
    )


@cache
def odd() -> Machine:
    """Everything at once: a four-bar with its knee right, pairs of cylinders, air, hoses,
    compliance.
    """
    tilt = CylinderSpec(
        "tilt", ("stick", (0.2, 0, 0.5)), pivot=("stick", (1.3, 0, -0.1)),
        lug=("bucket", (0.1, 0.02, -0.2)), knee="right", extra=SOFT,
    )  # fmt: skip
    return build([BOOM, STICK, BUCKET], [replace(LIFT, extra=SOFT), FOLD, tilt], air_percent=0.5)


@cache
def sprung(extra: str = "") -> Machine:
    """Two joints, a cylinder each with more keys, on a carriage that rocks."""
    carriage = Joint("rock", "root", mass=800, com=(0, 0, 0.3))
    joints = [carriage, replace(BOOM, parent="rock"), STICK]
    lift = replace(LIFT, base=("rock", LIFT.base[1]), extra=extra)
    table = spring("carriage", "rock", 1.5e6)
    return build(joints, [lift, replace(FOLD, extra=extra)], order=["boom", "stick"], more=table)


MACHINES = {
    "single": single,
    "double": double,
    "relieved": relieved,
    "yielding": yielding,
    "twins": twins,
    "sprung": sprung,
    "odd": odd,
    "excavator": lambda: rigid("excavator_20t"),
    "shipped": lambda: named("excavator_20t"),
}
POINTS = {
    "single": (9,),
    "double": (5, 5),
    "relieved": (5, 5),
    "yielding": (5, 5),
    "twins": (5, 5),
    "sprung": (5, 5),
    "odd": (4, 4, 4),
    "excavator": (5, 5, 9),
    "shipped": (5, 5, 9),
}


@cache
def workspace_of(name: str) -> Workspace:
    return Workspace.grid(MACHINES[name](), points=POINTS[name])


def any_lift_and_torque(name: str) -> Requirements:
    """A machine's requirements, of which neither lift nor torque is one."""
    return replace(Requirements.of(MACHINES[name]()), **ANY_LIFT_AND_TORQUE)


def problem_of(name: str, vary: tuple[str, ...] = ("areas", "pins"), **settings: Any) -> Problem:
    """The problem of a named machine; settings go to Problem or Requirements."""
    machine = MACHINES[name]()
    names = ("proportional", "bands", "gain")
    own = {key: settings.pop(key) for key in names if key in settings}
    requirements = replace(Requirements.of(machine), **settings)
    return Problem.of(
        machine=machine, workspace=workspace_of(name), requirements=requirements, vary=vary, **own
    )


def some_x(problem: Problem, seed: int, size: float = 0.05) -> np.ndarray:
    """A design near today's."""
    free = np.ptp(problem.bounds, axis=0) > 0
    return (
        problem.vector.start
        + np.random.default_rng(seed).uniform(-size, size, len(problem.vector.start)) * free
    )


def as_machine(problem: Problem, x: np.ndarray) -> Machine:
    """The machine at x with all its digits."""
    closed, stroke = problem.vector.strokes(x)
    cylinders = []
    for i, (cylinder, (a1, a2)) in enumerate(
        zip(problem.machine.cylinders, problem.vector.areas(x), strict=True)
    ):
        bore, rod = (2 * math.sqrt(area / cylinder.count / math.pi) for area in (a1, a1 - a2))
        sizes = {
            "bore": bore,
            "rod": rod,
            "closed_length": float(closed[i]),
            "stroke": float(stroke[i]),
        }
        if problem.dynamics.corners.proportional:
            old = problem.vector.areas_today[i]
            sizes["cap_dead_volume"] = cylinder.cap_dead_volume * a1 / old[0]
            sizes["annulus_dead_volume"] = cylinder.annulus_dead_volume * a2 / old[1]
        cylinders.append(_weighed(replace(cylinder, **sizes), cylinder))
        new, old = problem.vector.linkages(x)[i], problem.machine.linkages[i]
        bars = {
            bar: mass * getattr(new, bar) / getattr(old, bar)
            for bar, mass in cylinder.linkage_masses
        }
        cylinders[i] = replace(cylinders[i], linkage_masses=tuple(bars.items()))
    return replace(
        problem.machine, cylinders=tuple(cylinders), linkages=tuple(problem.vector.linkages(x))
    )


def _weighed(new: Cylinder, old: Cylinder) -> Cylinder:
    """Barrel and rod as heavy as their area × length says."""
    longer = new.closed_length / old.closed_length
    barrel, rod = (new.bore / old.bore) ** 2 * longer, (new.rod / old.rod) ** 2 * longer
    return replace(new, barrel_mass=old.barrel_mass * barrel, rod_mass=old.rod_mass * rod)


def solved(problem: Problem, tolerance: float = 1e-7) -> Search:
    """The search from today's machine, finished."""
    trust = 1.0 if problem.vector.vary == ("areas",) else 0.2
    return Search(problem=problem, x=problem.vector.start).run(trust=trust, tolerance=tolerance)
