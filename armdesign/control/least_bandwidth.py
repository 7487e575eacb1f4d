"""Least bandwidth over a workspace, and how bandwidth goes with frequency from pose to pose.

Bandwidth is reached with one position gain and one gain of pressure feedback for all joints, the
scheme ``damped`` of ``bandwidth_map``: it needs no search, so that machines are compared alike.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from armdesign.arrays import Array
from armdesign.control.loop_plant import workable
from armdesign.control.map_parts import ControlOptions
from armdesign.control.pose_bandwidth import common_gains
from armdesign.errors import PoseError
from armdesign.frequency.cases import CasePoses, load_cases
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine

POSES = 400  # of a workspace, at which bandwidths are computed

Places: TypeAlias = dict[str, Array]  # numbers under each load case at all poses of a workspace


def sample_of(workspace: Workspace) -> Workspace:
    """Poses of a workspace that stand for all of it, the same at every call."""
    count = len(workspace.q)
    if count <= POSES:
        return workspace
    return workspace.subset(np.sort(np.random.default_rng(0).permutation(count)[:POSES]))


def bandwidths(
    machine: Machine, workspace: Workspace, damping: float | None = None
) -> tuple[Places, Places]:
    """Bandwidths, and over the lowest natural frequency, under each load case at every pose (n,).

    Bandwidths are of the narrowest loop [Hz]; NaN where no controller works or the load case
    does not exist, 0 where no gains keep the margins. ``damping`` as in ``bandwidth_map``.

    Raises:
        PoseError: at no pose there are gains that keep the margins.
        SimulationError: an actuator has no valve.
        ArmDesignError: no damping on which a bandwidth could rest.
    """
    widths, ratios = Places(), Places()
    for case in load_cases(machine, workspace):
        widths[case.name], ratios[case.name] = _of_case(case, damping)
    if not any((each > 0).any() for each in widths.values()):
        fault = "at no pose of the workspace do gains keep the margins"
        remedy = "raise supply.pressure_bar or reliefs, or give lighter load cases or more damping"
        raise PoseError(f"{machine.name}: control", fault, remedy)
    return widths, ratios


def _of_case(case: CasePoses, damping: float | None) -> tuple[Array, Array]:
    poses, options = case.evaluate(), ControlOptions(damping=damping)
    width, ratio = np.full((2, len(case.exists)), np.nan)
    works = np.flatnonzero(workable(case.machine, poses)) if len(poses) else np.zeros(0, dtype=int)
    if len(works):
        reached, at = common_gains(case.machine, poses[works], options), case.indices[works]
        width[at] = reached.damped
        ratio[at] = width[at] / reached.plant.frequencies[:, 0]
    return width, ratio


def least_bandwidth(widths: Places, today: Places) -> float:
    """Least bandwidth [Hz] of the places where today's machine has one; 0 where one is lost."""
    return min(
        float(np.nan_to_num(widths[name][each > 0]).min(initial=np.inf))
        for name, each in today.items()
    )


def narrowest(widths: Places, today: Places, count: int) -> Array:
    """Poses of the least bandwidths of every load case, where today's machine has one."""
    chosen = []
    for name, each in today.items():
        counted = np.flatnonzero(each > 0)
        order = np.argsort(np.nan_to_num(widths[name][counted]))
        chosen.append(counted[order[:count]])
    return np.unique(np.concatenate(chosen))


def spread(
    values: Places, sample: Workspace, workspace: Workspace, reserve: float = 1.0
) -> Places:
    """Values at poses of a sample under each load case, at all poses of its workspace.

    Each other pose has the values of the nearest pose at which they are known, by shares of the
    joints' ranges, times a reserve; NaN for a load case with none.
    """
    from scipy.spatial import KDTree

    low, high = workspace.ranges.T
    everywhere = Places()
    for name, value in values.items():
        flat = value.reshape(len(value), -1)
        near = np.flatnonzero(np.isfinite(flat).all(axis=1))
        everywhere[name] = np.full((len(workspace.q), *value.shape[1:]), np.nan)
        if len(near):
            tree = KDTree((sample.q[near] - low) / (high - low))
            away, nearest = tree.query((workspace.q - low) / (high - low))
            times = np.where(away > 1e-9, reserve, 1.0).reshape(-1, *[1] * (value.ndim - 1))
            everywhere[name] = value[near[nearest]] * times
    return everywhere
