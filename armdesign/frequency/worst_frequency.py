"""The worst frequency over all poses and load cases, at the poses of a workspace and between them.

``worst_frequency`` compares only the poses of the workspace; ``refined`` searches locally from the
lowest of them too, so it may return a worse pose off the grid; ``worst_anywhere`` does so for all
load cases.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.cases import CasePoses, in_chunks, load_cases, poses_of
from armdesign.frequency.modes import energy_shares, lowest_frequency, natural_modes
from armdesign.frequency.spread import onto_pitch_limit, tipping_joints
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine

STARTS = 4  # local searches per load case


class Worst(NamedTuple):
    """The lowest coupled natural frequency [Hz] of many poses, its load case and pose (nq,)."""

    frequency: float
    payload: str
    q: Array

    @classmethod
    def of(cls, machine: Machine, workspace: Workspace, frequency: Array, case: Array) -> Worst:
        """The worst of frequencies and load cases that ``lowest_of_poses`` gives."""
        worst = int(frequency.argmin())
        name = machine.payloads[case[worst]].name
        return cls(float(frequency[worst]), name, workspace.q[worst])


@dataclass(frozen=True, eq=False)
class WorstPose:
    """The pose with the lowest coupled natural frequency [Hz] of a map, on the grid or off it.

    Attributes:
        q: joint positions (nq,) [rad, m].
        payload: name of the load case.
        frequency: lowest coupled natural frequency there [Hz].
        cylinder: the actuator or spring with the largest share of that mode's elastic energy.
        tool: position of the tool (3,) [m].
        joints: names of the coordinates.
    """

    q: Array
    payload: str
    frequency: float
    cylinder: str
    tool: Array
    joints: tuple[str, ...]


def worst_frequency(
    machine: Machine, workspace: Workspace, payload_share: float = 1.0, link_share: float = 1.0
) -> Worst:
    """The worst frequency among a workspace's poses, not between them, and all load cases.

    Shares of masses as in ``load_cases``.

    Raises:
        PoseError: a pose that this machine cannot take.
    """
    lowest = lowest_of_poses(machine, workspace, payload_share, link_share)
    return Worst.of(machine, workspace, *lowest)


def lowest_of_poses(
    machine: Machine, workspace: Workspace, payload_share: float = 1.0, link_share: float = 1.0
) -> tuple[Array, Array]:
    """The lowest frequency at each pose over its load cases (n,) [Hz], and whose it is (n,).

    inf where no load case exists. Arguments and errors as of ``worst_frequency``.
    """
    cases = list(load_cases(machine, workspace, payload_share, link_share))
    lowest, whose = np.full(len(workspace), np.inf), np.zeros(len(workspace), dtype=int)
    for case, indices, rigid in in_chunks(cases, f"{machine.name}: worst frequency"):
        if len(indices) > 0:
            frequency = lowest_frequency(poses_of(cases, case, rigid))
            lower = frequency < lowest[indices]
            lowest[indices[lower]], whose[indices[lower]] = frequency[lower], cases.index(case)
    return lowest, whose


def worst_anywhere(
    machine: Machine, workspace: Workspace, payload_share: float = 1.0, link_share: float = 1.0
) -> WorstPose:
    """The worst pose over all load cases, on a workspace's poses and between them.

    Arguments and errors as of ``worst_frequency``.
    """
    cases = list(load_cases(machine, workspace, payload_share, link_share))
    lowest: dict[CasePoses, list[Array]] = {case: [] for case in cases if case.exists.any()}
    for case, indices, rigid in in_chunks(cases, f"{machine.name}: worst frequency"):
        if len(indices) > 0:
            lowest[case].append(lowest_frequency(poses_of(cases, case, rigid)))
    worst = (refined(case, np.concatenate(values)) for case, values in lowest.items())
    return min(worst, key=lambda pose: pose.frequency)


def refined(case: CasePoses, frequency: Array) -> WorstPose:
    """The worst pose of a load case, on its poses and between.

    Local searches start from the poses of the lowest ``frequency`` (m,) [Hz].
    """
    q = case.workspace.q[case.exists]
    lowest = q[frequency.argmin()], float(frequency.min())
    return worst_pose(case, *min((lowest, *local_minima(case, frequency)), key=lambda at: at[1]))


def local_minima(case: CasePoses, frequency: Array) -> Iterator[tuple[Array, float]]:
    """Poses (nq,) at which the frequency has a local minimum, with it [Hz].

    Local searches start from the poses of the lowest ``frequency`` (m,) [Hz].
    """
    for start in _distinct_minima(case.workspace, case.workspace.q[case.exists], frequency):
        minimum = _descend(case, start)
        if minimum is not None:
            poses = case.machine.at(case.rigid_at(minimum))
            yield minimum, float(lowest_frequency(poses)[0])


def worst_pose(case: CasePoses, q: Array, frequency: float) -> WorstPose:
    """Record of a pose (nq,) with a lowest frequency [Hz]."""
    machine = case.machine
    poses = machine.at(case.rigid_at(q))
    share = energy_shares(poses, natural_modes(poses))[0, 0]
    return WorstPose(
        q=q,
        payload=machine.payload.name,
        frequency=frequency,
        cylinder=machine.yielding[int(share.argmax())].name,
        tool=poses.tool[0],
        joints=machine.joints,
    )


def _distinct_minima(workspace: Workspace, q: Array, frequency: Array) -> list[Array]:
    """Up to ``STARTS`` of the lowest poses that are a fifth of a joint range or more apart."""
    span = np.ptp(workspace.ranges, axis=1)
    lowest = q[np.argsort(frequency)[: max(200, len(q) // 20)]]
    chosen: list[Array] = []
    while len(lowest) > 0 and len(chosen) < STARTS:
        chosen.append(lowest[0])
        lowest = lowest[np.abs((lowest - lowest[0]) / span).max(axis=1) > 0.2]
    return chosen


def _descend(case: CasePoses, start: Array) -> Array | None:
    """Local minimum of the lowest frequency (SLSQP); None if it lies outside the workspace."""
    from scipy.optimize import minimize

    machine, workspace = case.machine, case.workspace
    low, high = workspace.ranges.T
    span = high - low
    payload, nq = machine.payload, len(low)

    def value_and_gradient(x: Array) -> tuple[float, Array]:
        ends = np.clip(x + 1e-6 * np.concatenate([np.eye(nq), -np.eye(nq)]), 0.0, 1.0)
        at = low + np.concatenate([x[None], ends]) * span
        f = lowest_frequency(machine.evaluate(case.rigid_at(at)))
        slopes = (f[1 : nq + 1] - f[nq + 1 :]) / (ends[:nq] - ends[nq:]).diagonal()
        return float(f[0]), slopes

    def room(x: Array) -> Array:
        rigid = machine.arm.kinematics((low + x * span)[None])
        stroke = workspace.machine.margins(rigid)[0] - workspace.end_margin
        tip = -machine.pitch_excess(rigid, payload) if payload.limits else np.empty(0)
        return np.concatenate([stroke[[len(k.joints) > 1 for k in machine.drives]], tip])

    constrained = bool(payload.limits) or any(len(k.joints) > 1 for k in machine.linkages)
    result = minimize(
        value_and_gradient,
        (start - low) / span,
        jac=True,
        bounds=[(0.0, 1.0)] * nq,
        constraints=[{"type": "ineq", "fun": room}] if constrained else [],
        method="SLSQP",
        options={"maxiter": 60, "ftol": 1e-10},
    )
    return _in_workspace(machine, workspace, np.clip(low + result.x * span, low, high))


def _in_workspace(machine: Machine, workspace: Workspace, q: Array) -> Array | None:
    """The pose if it lies in the workspace, else None.

    A pose slightly beyond a pitch limit is first moved exactly onto it.
    """
    rigid = machine.arm.kinematics(q[None])
    payload = machine.payload
    if not machine.holds(rigid)[0] and machine.pitch_excess(rigid, payload)[0] < 1e-3:
        moved = [
            onto_pitch_limit(machine, payload, q[None], joint, limit)[1]
            for joint in tipping_joints(machine, payload)
            for limit in payload.limits
        ]
        close = (p for p in np.concatenate(moved) if np.abs(p - q).max() < 2e-3)
        q = next((p for p in close if _in_box(p, workspace)), q)
    if not _in_box(q, workspace) or not machine.holds(q)[0]:
        return None
    # end stops belong to the machine of the workspace, not to this one
    return q if workspace.machine.margins(q).min() >= workspace.end_margin - 1e-9 else None


def _in_box(q: Array, workspace: Workspace) -> bool:
    low, high = workspace.ranges.T
    return bool(np.all((q >= low) & (q <= high)))
