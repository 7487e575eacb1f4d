"""Reach figures as data sheets state them, over the full strokes and exact, not of grid points.

Each is the largest value of a linear function of the places of the tool and of its pivot, the
revolute joint nearest to it, over the joint ranges; two have a condition besides. The best poses
of a grid are refined by SLSQP with exact slopes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from armdesign.arrays import Array, mesh
from armdesign.frequency.joint_grid import joint_axes
from armdesign.machine.machine import Machine
from armdesign.machine.reaching import place_and_slopes
from armdesign.machine.room import across, room
from armdesign.mechanism.linkage.base import Pin
from armdesign.threads import one_blas_thread

STARTS = 4  # poses of the grid that are refined
ACCURACY = 1e-7  # [m] to which the condition is met
REACH, HEIGHT, PIVOT_REACH, PIVOT_HEIGHT = np.eye(4)  # of tool and pivot


@dataclass(frozen=True, kw_only=True)
class ReachFigures:
    """Reach from the root's vertical axis and heights over its origin, which is the ground [m].

    Attributes:
        reach: largest reach of the tool at any height.
        reach_at_ground: largest reach of the tool at height 0; None where it never is there.
        depth: how far below height 0 the tool gets; negative where it always stays above.
        height: largest height of the tool (cutting height).
        dump_height: largest height of the tool while it is straight below its pivot (dump or
            loading height); None where it never is.
    """

    reach: float
    reach_at_ground: float | None
    depth: float
    height: float
    dump_height: float | None


@lru_cache(maxsize=8)
def reach_figures(machine: Machine) -> ReachFigures:
    """The figures of a machine over its joint ranges, no end margin kept; remembered."""
    envelope = _Envelope.of(machine)
    reach, depth, height = (_known(envelope.largest(aim)) for aim in (REACH, -HEIGHT, HEIGHT))
    return ReachFigures(
        reach=reach,
        reach_at_ground=envelope.largest(REACH, HEIGHT),
        depth=depth,
        height=height,
        dump_height=envelope.largest(HEIGHT, REACH - PIVOT_REACH, PIVOT_HEIGHT - HEIGHT),
    )


def _known(value: float | None) -> float:
    assert value is not None  # without a condition every start is a pose
    return value


@dataclass(frozen=True, eq=False)
class _Envelope:
    """Places (n, 4) of tool and pivot at poses (n, nq), from which a largest value is sought."""

    machine: Machine
    q: Array
    places: Array

    @classmethod
    def of(cls, machine: Machine) -> _Envelope:
        q = mesh(joint_axes(machine, None, 0.0))
        q = q[machine.margins(q).min(axis=1) >= -1e-9] if across(machine) else q
        return cls(machine, q, _places(machine, q)[0])

    @one_blas_thread()
    def largest(
        self, aim: Array, zero: Array | None = None, least: Array | None = None
    ) -> float | None:
        """Largest ``aim`` · places over the ranges; ``zero`` · places = 0, ``least`` · places ≥ 0.

        None where no pose meets that: all of the grid are on one side.
        """
        rows = np.arange(len(self.q)) if least is None else np.flatnonzero(self.places @ least > 0)
        places = self.places[rows]
        if zero is not None and (np.all(places @ zero > 0) or np.all(places @ zero < 0)):
            return None
        score = places @ aim - (0.0 if zero is None else 10 * np.abs(places @ zero))
        starts = self.q[rows[np.argsort(score)[-STARTS:]]]
        return self._best(self._tried(starts, aim, zero, least), aim, zero, least)

    def _tried(self, starts: Array, aim: Array, zero: Array | None, least: Array | None) -> Array:
        """All poses (n, nq) that descents from some starts come by."""
        from scipy.optimize import minimize

        low, high = self.machine.ranges.T
        span, tried = high - low, list[Array]()

        def at(u: Array) -> Array:
            return np.asarray(low + np.clip(u, 0.0, 1.0) * span)

        def along(line: Array, sign: float = 1.0) -> dict[str, Any]:
            return {
                "fun": lambda u: sign * float(self._at(at(u))[0] @ line),
                "jac": lambda u: sign * (line @ self._at(at(u))[1]) * span,
            }

        def falling(u: Array) -> float:
            tried.append(at(u))
            return -float(self._at(tried[-1])[0] @ aim)

        conditions: list[dict[str, Any]] = []
        if zero is not None:
            conditions.append({"type": "eq", **along(zero)})
        if least is not None:
            conditions.append({"type": "ineq", **along(least)})
        if across(self.machine):
            conditions.append({"type": "ineq", "fun": lambda u: self._room(at(u))})
        for start in starts:
            minimize(
                **{**along(aim, -1.0), "fun": falling},
                x0=(start - low) / span,
                method="SLSQP",
                bounds=[(0.0, 1.0)] * len(span),
                constraints=conditions,
                options={"ftol": 1e-13, "maxiter": 50},
            )
        return np.array(tried).reshape(-1, len(span))

    def _best(self, q: Array, aim: Array, zero: Array | None, least: Array | None) -> float | None:
        """Largest value at those poses (n, nq) that meet all; None if none does."""
        places = _places(self.machine, q)[0]
        kept = self.machine.margins(q).min(axis=1) > -1e-6
        if zero is not None:
            kept &= np.abs(places @ zero) < ACCURACY
        if least is not None:
            kept &= places @ least > -ACCURACY
        return max((places @ aim)[kept].tolist(), default=None)

    def _at(self, q: Array) -> tuple[Array, Array]:
        places, slopes = _places(self.machine, q[None])
        return places[0], slopes[0]

    def _room(self, q: Array) -> Array:
        return room(self.machine, self.machine.arm.kinematics(q[None]))[0]


def _places(machine: Machine, q: Array) -> tuple[Array, Array]:
    """Places of tool and pivot (n, 4) [m], and their slopes by the joints (n, 4, nq)."""
    joints = tuple(range(q.shape[1]))
    both = [place_and_slopes(machine, at, joints, q) for at in (machine.tool, _pivot(machine))]
    places, slopes = zip(*both, strict=True)
    return np.concatenate(places, axis=1), np.concatenate(slopes, axis=1)


def _pivot(machine: Machine) -> Pin:
    """Origin of the revolute joint nearest to the tool; the root's where there is none."""
    arm = machine.arm
    turning = [j for j in arm.chain(machine.tool.link) if arm.coordinates[j].revolute]
    if not turning:
        return Pin(link=arm.root, at=(0.0, 0.0, 0.0))
    link = next(link for link in arm.links.values() if link.joint == turning[-1])
    x, y, z = (-link.rotation.T @ link.translation).tolist()
    return Pin(link=link.name, at=(x, y, z))
