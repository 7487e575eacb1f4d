"""Lift that remains: at every point of today's lift chart, a share of what today's machine lifts.

Capacities are hydraulic (``machine/lifting.py``); tipping does not change with cylinders and pins
of no mass. The new machine may take, of the poses that bring the point to its place, the one in
which it lifts most itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference
from armdesign.design.requirements.holding import every_share, masses_held, spare_force
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import shares
from armdesign.machine.lift_chart import HYDRAULIC_SHARE, ChartPoses, lift_chart_if_any
from armdesign.machine.lifting import liftable_masses
from armdesign.machine.machine import Machine


@dataclass(frozen=True, kw_only=True)
class LiftShare:
    """Settings: the lift chart.

    Attributes:
        lift_share: of today's hydraulic lift at every point of its lift chart, at least; 0: not
            asked.
    """

    lift_share: float | Mapping[str, float] = shares("lift_share")


@names_begin_with("lift_share")
def lift_share(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Lift over today's that each actuator allows at every point that today's machine lifts.

    Each actuator that the mass loads there at all is a requirement: the bound takes them apart.
    """
    share = every_share(reference.today, reference.requirements.lift_share)
    known = chart_today(reference.today) if share.any() else None
    if known is None:
        return
    poses, today = known
    mass, per_mass = masses_held(new, poses.rigid, poses.torque, HYDRAULIC_SHARE)
    best = poses.best(mass.real.min(axis=2))[:, today > 0, None]
    mass, per_mass = (np.take_along_axis(part, best, axis=1) for part in (mass, per_mass))
    lifted = today[today > 0, None]
    constraint, per_limit = spare_force(reference, mass, per_mass, share * lifted)
    loaded = np.isfinite(mass)  # complex infinities do not divide
    over_today = np.where(loaded, np.where(loaded, mass, 0.0) / lifted, np.inf)
    for i, actuator in enumerate(reference.today.actuators):
        if not (share[i] and loaded[..., i].any()):
            continue
        yield Evaluation(
            name=f"lift_share.{actuator.name}",
            words=f"lift over today's that the {actuator.name} {actuator.kind} allows",
            unit="",
            value=over_today[..., i],
            limit=float(share[i]),
            at_least=True,
            reformulated=(constraint[..., i], per_limit[..., i]),
            setting=f"lift_share.{actuator.name}",
        )


@lru_cache(maxsize=16)
def chart_today(machine: Machine) -> tuple[ChartPoses, Array] | None:
    """Poses of a machine's lift chart, and its hydraulic capacity at each place (n,) [kg].

    None where the chart has no point and the file asks for none.
    """
    chart = lift_chart_if_any(machine)
    if chart is None:
        return None
    poses = chart.poses
    known = poses.rigid, poses.arms, poses.torque
    least = liftable_masses(machine, *known, HYDRAULIC_SHARE).min(axis=1)
    return poses, least[poses.best(least)]
