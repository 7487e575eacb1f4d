"""Frequency maps: natural frequencies over a workspace and all load cases, and the worst pose of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.errors import PoseError
from armdesign.machine import Machine
from armdesign.modes import Modes, energy_shares, lowest_frequency, natural_modes
from armdesign.poses import Poses
from armdesign.workspace import Workspace, onto_pitch_limit, tipping_joints

if TYPE_CHECKING:
    import pandas as pd

STARTS = 4  # local searches per load case


@dataclass(frozen=True, eq=False)
class WorstPose:
    """Where the lowest coupled natural frequency [Hz] of a map is, off the grid.

    Attributes:
        q: joint positions (nq,) [rad, m].
        payload: name of the load case.
        frequency: lowest coupled natural frequency there [Hz].
        cylinder: the one with the largest share of that mode's oil-spring energy.
        tool: position of the tool (3,) [m].
        joints: names of the coordinates.
    """

    q: Array
    payload: str
    frequency: float
    cylinder: str
    tool: Array
    joints: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class FrequencyMap:
    """Natural frequencies of a machine over a workspace, every load case at the poses where it exists.

    Attributes:
        frame: one row per pose and load case; columns: each joint [rad, m], ``payload``, ``tool_x_m`` …,
            ``f1_hz`` … (coupled), ``locked_<cylinder>_hz``, ``rigid_<cylinder>_hz``, ``<cylinder>_force_n``,
            ``<cylinder>_extension``.
        worst: the worst pose, refined off the grid.
        limiting: for each row, the cylinder with the largest share in the lowest mode.
        machine: the machine.
        workspace: the poses.
    """

    frame: pd.DataFrame
    worst: WorstPose
    limiting: Array
    machine: Machine
    workspace: Workspace

    def plot(self, ax: Any = None, plane: str = "joints", **limits: float) -> Any:
        """Heatmap of the lowest coupled frequency over two joints or over reach and height; returns the axes."""
        from armdesign import plots

        return plots.frequency_map(self, ax, plane, **limits)


def frequency_map(machine: Machine, workspace: Workspace) -> FrequencyMap:
    """Coupled, locked and rigid-load frequencies at every pose of the workspace under every load case.

    Raises:
        PoseError: a pose that this machine cannot take, or a load case that exists at none of them.
    """
    import pandas as pd

    frames, limiting, worst = [], [], []
    for payload in machine.payloads:
        case = machine.with_payload(payload.name)
        rows = np.flatnonzero(case.holds(workspace.rigid))
        if len(rows) == 0:
            raise PoseError(
                f"{machine.source.name}: payload.{payload.name}.pitch_deg",
                f"link {payload.link} has that pitch at no pose of the workspace",
                "widen it, or remove the load case",
            )
        poses = case.at(workspace.rigid[rows])
        try:
            modes = natural_modes(poses)
        except PoseError as error:
            where = f"{machine.source.name}: payload.{payload.name}"
            raise PoseError(where, f"the {error.part} {error.problem}", error.remedy) from None
        frames.append(_frame(case, poses, modes))
        limiting.append(energy_shares(poses, modes)[:, 0].argmax(axis=1))
        worst.append(_worst(case, workspace, poses.q, modes.frequencies[:, 0]))
    names = np.array([cylinder.name for cylinder in machine.cylinders])
    return FrequencyMap(
        frame=pd.concat(frames, ignore_index=True),
        worst=min(worst, key=lambda pose: pose.frequency),
        limiting=names[np.concatenate(limiting)],
        machine=machine,
        workspace=workspace,
    )


def _frame(machine: Machine, poses: Poses, modes: Modes) -> pd.DataFrame:
    import pandas as pd

    names = [cylinder.name for cylinder in machine.cylinders]
    columns: dict[str, Any] = dict(zip(machine.joints, poses.q.T, strict=True))
    columns["payload"] = machine.payload.name
    columns |= {f"tool_{axis}_m": poses.tool[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"f{i + 1}_hz": f for i, f in enumerate(modes.frequencies.T)}
    columns |= {f"locked_{name}_hz": f for name, f in zip(names, modes.locked_frequencies.T, strict=True)}
    columns |= {f"rigid_{name}_hz": f for name, f in zip(names, modes.rigid_frequencies.T, strict=True)}
    columns |= {f"{name}_force_n": f for name, f in zip(names, poses.cylinder_forces.T, strict=True)}
    columns |= {f"{name}_extension": e for name, e in zip(names, poses.extensions.T, strict=True)}
    return pd.DataFrame(columns)


# ------------------------------------------------------------------------------------------------- the worst pose


def _worst(machine: Machine, workspace: Workspace, q: Array, frequency: Array) -> WorstPose:
    """Refine the lowest grid poses of one load case by a local method and take the lowest of all."""
    best_q, best = q[frequency.argmin()], float(frequency.min())
    for start in _distinct_minima(workspace, q, frequency):
        refined = _descend(machine, workspace, start)
        if refined is not None:
            value = float(lowest_frequency(machine.at(refined))[0])
            if value < best:
                best_q, best = refined, value
    poses = machine.at(best_q)
    share = energy_shares(poses, natural_modes(poses))[0, 0]
    return WorstPose(
        q=best_q,
        payload=machine.payload.name,
        frequency=best,
        cylinder=machine.cylinders[int(share.argmax())].name,
        tool=poses.tool[0],
        joints=machine.joints,
    )


def _distinct_minima(workspace: Workspace, q: Array, frequency: Array) -> list[Array]:
    """Up to ``STARTS`` of the lowest poses that are a fifth of a joint range or more apart."""
    span = np.ptp(workspace.ranges, axis=1)
    chosen: list[Array] = []
    for row in np.argsort(frequency)[: max(200, len(q) // 20)]:
        if all(np.abs((q[row] - other) / span).max() > 0.2 for other in chosen):
            chosen.append(q[row])
        if len(chosen) == STARTS:
            break
    return chosen


def _descend(machine: Machine, workspace: Workspace, start: Array) -> Array | None:
    """Local minimum of the lowest frequency inside the workspace (SLSQP), or None where it leaves the workspace."""
    from scipy.optimize import minimize

    low, high = workspace.ranges.T
    span = high - low
    payload, nq = machine.payload, len(low)

    def value(x: Array) -> float:
        return float(lowest_frequency(machine.evaluate(machine.rigid_poses(low + x * span)))[0])

    def gradient(x: Array) -> Array:
        ends = np.clip(x + 1e-6 * np.concatenate([np.eye(nq), -np.eye(nq)]), 0.0, 1.0)
        f = lowest_frequency(machine.evaluate(machine.rigid_poses(low + ends * span)))
        return (f[:nq] - f[nq:]) / (ends[:nq] - ends[nq:]).diagonal()

    def room(x: Array) -> Array:
        rigid = machine.arm.kinematics((low + x * span)[None])
        stroke = machine.margins(rigid)[0] - workspace.end_margin
        tip = -machine.pitch_excess(rigid, payload) if payload.pitch else np.empty(0)
        return np.concatenate([stroke[[len(k.joints) > 1 for k in machine.linkages]], tip])

    constrained = payload.pitch is not None or any(len(k.joints) > 1 for k in machine.linkages)
    result = minimize(
        value,
        (start - low) / span,
        jac=gradient,
        bounds=[(0.0, 1.0)] * nq,
        constraints=[{"type": "ineq", "fun": room}] if constrained else [],
        method="SLSQP",
        options={"maxiter": 60, "ftol": 1e-10},
    )
    return _inside(machine, workspace, np.clip(low + result.x * span, low, high))


def _inside(machine: Machine, workspace: Workspace, q: Array) -> Array | None:
    """The pose, put back exactly onto a pitch limit that it oversteps by a hair; None if it is not in the workspace."""
    rigid = machine.arm.kinematics(q[None])
    payload = machine.payload
    if not machine.holds(rigid)[0] and machine.pitch_excess(rigid, payload)[0] < 1e-3:
        moved = [
            onto_pitch_limit(machine, payload, q[None], joint, limit)
            for joint in tipping_joints(machine, payload)
            for limit in payload.pitch or ()
        ]
        near = [p for p in np.concatenate(moved) if np.abs(p - q).max() < 2e-3 and _in_box(p, workspace)]
        q = near[0] if near else q
    within = _in_box(q, workspace) and bool(machine.holds(q)[0])
    return q if within and machine.margins(q).min() >= workspace.end_margin - 1e-9 else None


def _in_box(q: Array, workspace: Workspace) -> bool:
    low, high = workspace.ranges.T
    return bool(np.all((q >= low) & (q <= high)))
