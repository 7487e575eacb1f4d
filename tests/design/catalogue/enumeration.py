"""Exhaustive enumeration of a catalogue's combinations, each a machine of its own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from armdesign import Machine, Requirements, Workspace
from armdesign.design.catalogue.sizes import sized
from armdesign.design.requirements.check import check
from armdesign.frequency.modes import lowest_frequency
from armdesign.units import mm
from tests.machines import ANY_LIFT_AND_TORQUE

LOOSE = Requirements(
    oil_total_share=1.0,
    oil_each_share=1.6,
    thrust_share=1.6,
    holding_share=3.0,
    **ANY_LIFT_AND_TORQUE,
)


BORES, RODS = (80, 90, 95, 100, 105, 110, 125), (50, 56, 60, 63, 65, 70, 80)


AROUND = [(bore * mm, rod * mm) for bore in BORES for rod in RODS if rod < bore]


def enumerated(
    machine: Machine,
    workspace: Workspace,
    limits: Requirements,
    sizes: Iterable[tuple[float, float]],
    share: bool = False,
    stoutness: float = 0.0,
) -> float:
    """Best worst frequency [Hz] of all allowed combinations, each a machine of its own; −inf if
    none is allowed.
    """
    best = -math.inf
    cases = [machine.with_payload(p.name) for p in machine.payloads]
    for choice in itertools.product(sizes, repeat=len(machine.cylinders)):
        cylinders = tuple(
            sized(c, *size, share) for c, size in zip(machine.cylinders, choice, strict=True)
        )
        if (
            min(
                c.slack
                for c in check(replace(machine, cylinders=cylinders), machine, workspace, limits)
            )
            < -1e-9
        ):
            continue
        if min(c.rod / c.bore for c in cylinders) < stoutness:
            continue
        held = [
            (replace(c, cylinders=cylinders), workspace.rigid[c.holds(workspace.rigid)])
            for c in cases
        ]
        worst = min(
            float(lowest_frequency(c.evaluate(rigid)).min()) for c, rigid in held if len(rigid) > 0
        )
        best = max(best, worst)
    return best


def around(machine: Machine, seed: int, count: int) -> list[tuple[float, float]]:
    """Sizes near the machine's, no two alike."""
    random = np.random.default_rng(seed)
    chosen = random.integers(0, len(machine.cylinders), count)
    bores = np.array([machine.cylinders[i].bore for i in chosen]) * random.uniform(
        0.85, 1.2, count
    )
    rods = np.array([machine.cylinders[i].rod for i in chosen]) * random.uniform(0.95, 1.25, count)
    return [(float(b), float(min(r, 0.9 * b))) for b, r in zip(bores, rods, strict=True)]
