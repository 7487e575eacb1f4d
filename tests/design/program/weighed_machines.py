"""Machines whose cylinders and four-bars have masses."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from armdesign import Machine, Requirements, Workspace
from armdesign.design.program.problem import Problem
from tests.design.designs import sprung
from tests.machines import BOOM, BUCKET, FOLD, LIFT, STICK, CylinderSpec, build


@cache
def bars(name: str, share: float = 1.0) -> Machine:
    """Machines whose cylinders weigh, and their four-bar; made up, heavier than real ones."""
    heavy = f"barrel_kg = {110 * share}\nrod_kg = {85 * share}"
    lift, fold = replace(LIFT, extra=heavy), replace(FOLD, extra=heavy)
    if name == "single":
        return build([BOOM], [lift])
    if name == "double":
        return build([BOOM, STICK], [lift, fold])
    if name == "sprung":
        return sprung(heavy)
    tilt = CylinderSpec(
        "tilt", ("stick", (0.2, 0, 0.5)), pivot=("stick", (1.3, 0, -0.1)),
        lug=("bucket", (0.1, 0.02, -0.2)), knee="right", extra=f"count = 2\n{heavy}",
    )  # fmt: skip
    machine = build([BOOM, STICK, BUCKET], [lift, fold, tilt])
    four_bar = {"rocker_kg": 40 * share, "coupler_kg": 30 * share}
    return machine.replace(
        {f"cylinder.tilt.four_bar.{key}": value for key, value in four_bar.items()}
    )


def posed(
    machine: Machine,
    vary: tuple[str, ...],
    points: int = 4,
    proportional: bool = False,
    **change: object,
) -> Problem:
    """The problem of a machine; changes are to its requirements."""
    return Problem.of(
        machine=machine,
        workspace=Workspace.grid(machine, points=points),
        requirements=replace(Requirements.of(machine), **change),  # type: ignore[arg-type]
        vary=vary,
        proportional=proportional,
    )
